//! The hardest legal cycle: cases are searched by the time that the core takes for them on the host, and the worst are
//! written as feeds for the firmware, whose instructions decide. `tests/hardest_cycle.sh` runs both halves:
//!
//! - `search --seconds N --seed S --out DIR` writes the worst cases to folders `DIR/1`, `DIR/2`, ...;
//! - `report --out DIR [--json]` reads what the firmware said of them.

mod case;
mod report;
mod search;

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(Failure::Usage(reason)) => {
            eprintln!("hardest_cycle: {reason}");
            ExitCode::from(2)
        }
        Err(Failure::Work(reason)) => {
            eprintln!("hardest_cycle: {reason}");
            ExitCode::FAILURE
        }
    }
}

enum Failure {
    Usage(String),
    Work(String),
}

fn run() -> Result<(), Failure> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let value = |name: &str| -> Result<&String, Failure> {
        let at = arguments.iter().position(|a| a == name);
        let value = at.and_then(|at| arguments.get(at + 1));
        value.ok_or_else(|| Failure::Usage(format!("{name} needs a value")))
    };
    let number = |name: &str, limit: u64| -> Result<u64, Failure> {
        let text = value(name)?;
        let number = text.parse::<u64>().ok().filter(|number| *number < limit);
        number.ok_or_else(|| Failure::Usage(format!("{name} {text}: allowed: whole numbers below {limit}")))
    };
    let out = PathBuf::from(value("--out")?);
    match arguments.first().map(String::as_str) {
        Some("search") => {
            let seconds = number("--seconds", 1_000_000)?;
            let seed = number("--seed", case::SEEDS)?;
            let found = search::search(seed, Duration::from_secs(seconds));
            report::write(&out, seed, &found).map_err(Failure::Work)
        }
        Some("report") => {
            let report = report::read(&out).map_err(Failure::Work)?;
            if arguments.iter().any(|a| a == "--json") {
                println!("{}", serde_json::to_string(&report).map_err(|e| Failure::Work(e.to_string()))?);
            } else {
                report.print();
            }
            Ok(())
        }
        _ => Err(Failure::Usage("what to do is search or report".into())),
    }
}
