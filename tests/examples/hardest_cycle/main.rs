//! The hardest legal cycle: cases are searched by the work that the core counts, and the worst are written as feeds for the firmware,
//! whose instructions decide. `tests/hardest_cycle.sh` runs both halves:
//!
//! - `search --cycles N --seconds T --worst K --seed S [--uncapped] --out DIR` writes the worst K cases to folders `DIR/1`, `DIR/2`, ...;
//! - `report --out DIR [--json]` reads what the firmware said of them; it fails where work and instructions do not agree.

mod case;
mod report;
mod search;

use search::Extent;
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
            let extent = Extent {
                cycles: number("--cycles", 1_000_000_000)?,
                time: Duration::from_secs(number("--seconds", 1_000_000)?),
                is_uncapped: arguments.iter().any(|a| a == "--uncapped"),
            };
            let seed = number("--seed", case::SEEDS)?;
            let mut found = search::search(seed, &extent);
            found.worst.truncate(number("--worst", 10_000)? as usize);
            report::write(&out, seed, &extent, &found).map_err(Failure::Work)
        }
        Some("report") => {
            let report = report::read(&out).map_err(Failure::Work)?;
            if arguments.iter().any(|a| a == "--json") {
                println!("{}", serde_json::to_string(&report).map_err(|e| Failure::Work(e.to_string()))?);
            } else {
                report.print();
            }
            report.check().map_err(Failure::Work)
        }
        _ => Err(Failure::Usage("what to do is search or report".into())),
    }
}
