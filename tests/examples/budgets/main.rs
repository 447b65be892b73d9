//! Prints all budgets of `budgets.toml` beside what the meters say now, and fails where a figure is worse than the last by
//! over 5 %, where a must is missed and not marked so, where one is marked as missed but met, and where a meter fails.
//! `tests/budgets.sh` runs it.
//!
//! Options: `--all` runs the slow meters too, `--json` prints one line of JSON, `--ledger FILE` takes another ledger.

mod ledger;

use cogmint::input_error::InputError;
use ledger::{Budget, Ledger};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};

fn main() -> ExitCode {
    let mut arguments = std::env::args().skip(1);
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut file = root.join("budgets.toml");
    let (mut all, mut as_json) = (false, false);
    while let Some(argument) = arguments.next() {
        match (argument.as_str(), arguments.len()) {
            ("--all", _) => all = true,
            ("--json", _) => as_json = true,
            ("--ledger", 1..) => file = PathBuf::from(arguments.next().unwrap_or_default()),
            _ => {
                eprintln!("budgets: unknown option {argument} (known: --all, --json, --ledger FILE)");
                return ExitCode::from(2);
            }
        }
    }
    match read(&file) {
        Ok(ledger) => {
            if check(&ledger, &root, all, as_json) {
                ExitCode::SUCCESS
            } else {
                ExitCode::FAILURE
            }
        }
        Err(error) => {
            eprintln!("budgets: {error}");
            ExitCode::from(2)
        }
    }
}

fn read(file: &Path) -> Result<Ledger, InputError> {
    let text = std::fs::read_to_string(file).map_err(|error| InputError::new(file, error.to_string()))?;
    Ledger::parse(&text, file)
}

/// Runs the meters and prints every row; whether nothing is wrong.
fn check(ledger: &Ledger, root: &Path, all: bool, as_json: bool) -> bool {
    let mut is_good = true;
    let mut printed: BTreeMap<&str, Value> = BTreeMap::new();
    for (name, meter) in ledger.meters.iter().filter(|(_, meter)| all || !meter.slow) {
        match measure(&meter.command, root) {
            Ok(value) => {
                printed.insert(name, value);
            }
            Err(reason) => {
                eprintln!("budgets: meter {name}: {reason}");
                is_good = false;
            }
        }
    }
    let mut rows = Vec::new();
    for budget in &ledger.budget {
        let of_meter = budget.figure.as_ref().and_then(|[meter, _]| printed.get(meter.as_str()));
        let (figure, faults) = budget.faults(of_meter);
        is_good &= faults.is_empty();
        for fault in &faults {
            eprintln!("budgets: {} {}", budget.what, fault.sentence());
        }
        rows.push((budget, figure, faults));
    }
    if as_json {
        let rows: Vec<Value> = rows
            .iter()
            .map(|(budget, figure, faults)| {
                json!({
                    "what": budget.what,
                    "must": budget.must,
                    "aim": budget.aim,
                    "last": budget.last,
                    "now": figure,
                    "missed": budget.missed,
                    "unmeasured": budget.unmeasured,
                    "faults": faults.iter().map(|fault| fault.sentence()).collect::<Vec<_>>(),
                })
            })
            .collect();
        println!("{}", json!({ "good": is_good, "budgets": rows }));
    } else {
        println!("| what | must | aim | last | now | |\n| --- | --- | --- | --- | --- | --- |");
        for (budget, figure, faults) in &rows {
            print_row(budget, *figure, faults);
        }
    }
    is_good
}

fn print_row(budget: &Budget, figure: Option<f64>, faults: &[ledger::Fault]) {
    let show = |figure: Option<f64>| figure.map_or("-".into(), |figure| budget.unit.show(figure));
    let mut verdict: Vec<&str> = faults.iter().map(ledger::Fault::sentence).collect();
    if let Some(reason) = &budget.unmeasured {
        verdict.push("unmeasured:");
        verdict.push(reason);
    } else if faults.is_empty() {
        verdict.push(if budget.missed { "missed" } else { "met" });
        if figure.is_none() {
            verdict.push("(not run)");
        }
    }
    println!(
        "| {} | {} | {} | {} | {} | {} |",
        budget.what,
        show(Some(budget.must)),
        show(Some(budget.aim)),
        show(budget.last),
        show(figure),
        verdict.join(" ")
    );
}

/// The JSON object that a command prints.
fn measure(command: &str, root: &Path) -> Result<Value, String> {
    let output = Command::new("bash")
        .args(["-c", command])
        .current_dir(root)
        .stderr(Stdio::inherit())
        .output()
        .map_err(|error| format!("bash: {error}"))?;
    if !output.status.success() {
        return Err(format!("`{command}` ended with {}", output.status));
    }
    let text = String::from_utf8_lossy(&output.stdout);
    serde_json::from_str(&text).map_err(|error| format!("`{command}` printed no JSON object: {error}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_meter_that_fails_or_prints_nonsense_gives_no_figure() {
        let root = Path::new(".");
        assert_eq!(measure("echo '{\"a\": 1}'", root).unwrap()["a"], 1);
        assert!(measure("echo '{\"a\": 1}'; exit 1", root).unwrap_err().contains("ended with"));
        assert!(measure("echo fine", root).unwrap_err().contains("no JSON"));
    }

    #[test]
    fn a_failing_meter_fails_the_check() {
        let ledger = |command: &str| {
            let row = "[[budget]]\nwhat = \"w\"\nunit = \"count\"\nmust = 2\naim = 1\nfigure = [\"m\", \"/a\"]\nlast = 1\n";
            let text = format!("[meters.m]\ncommand = '''{command}'''\n{row}");
            Ledger::parse(&text, Path::new("budgets.toml")).unwrap()
        };
        let check = |command: &str| check(&ledger(command), Path::new("."), false, true);
        assert!(check("echo '{\"a\": 1}'"));
        assert!(!check("echo '{\"a\": 2}'"));
        assert!(!check("echo '{\"a\": 1}'; exit 1"));
        assert!(!check("echo '{\"b\": 1}'"));
    }
}
