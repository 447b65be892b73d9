//! The ledger: what is budgeted, what was measured last, and the ratchet between the two.

use cogmint::input_error::{InputError, line_of_offset};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::Path;

/// A figure may be this much worse than the last before the ledger must be changed.
const TOLERANCE: f64 = 1.05;

/// All budgets, and the commands that measure.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ledger {
    /// By name.
    pub meters: BTreeMap<String, Meter>,
    /// In the order of the specification.
    pub budget: Vec<Budget>,
}

/// A command that prints one JSON object.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Meter {
    /// Run by bash in the repository's root.
    pub command: String,
    /// Whether it takes long, and so runs only when asked for.
    #[serde(default)]
    pub slow: bool,
}

/// One row. Of all figures, less is better.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Budget {
    /// What is measured.
    pub what: String,
    /// Unit of the figures.
    pub unit: Unit,
    /// The limit.
    pub must: f64,
    /// Better still.
    pub aim: f64,
    /// The meter and the JSON pointer of the figure in what it prints.
    pub figure: Option<[String; 2]>,
    /// The figure when the ledger was last changed.
    pub last: Option<f64>,
    /// Whether the last figure is known to miss the limit.
    #[serde(default)]
    pub missed: bool,
    /// Why no meter prints the figure yet.
    pub unmeasured: Option<String>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Unit {
    Instructions,
    Bytes,
    Count,
    Seconds,
}

impl Unit {
    /// A figure for people.
    pub fn show(self, figure: f64) -> String {
        match self {
            Self::Instructions => format!("{:.3} M", figure / 1e6),
            Self::Bytes => format!("{:.1} KiB", figure / 1024.0),
            Self::Count => format!("{figure}"),
            Self::Seconds => format!("{:.1} min", figure / 60.0),
        }
    }
}

/// What there is to say against a row.
#[derive(Clone, Debug, PartialEq)]
pub enum Fault {
    /// Worse than the last figure by more than 5 %.
    Worse,
    /// The limit is missed and the row does not say so.
    Missed,
    /// The row says that the limit is missed, and it is met.
    Met,
    /// The meter that should have printed the figure did not.
    NoFigure,
}

impl Fault {
    /// As a sentence.
    pub fn sentence(&self) -> &'static str {
        match self {
            Self::Worse => "is worse than the last by more than 5 %",
            Self::Missed => "misses its must and is not marked `missed = true`",
            Self::Met => "meets its must and is marked `missed = true`",
            Self::NoFigure => "has no figure: its meter printed none",
        }
    }
}

impl Ledger {
    /// Reads and checks the text of a ledger.
    ///
    /// # Errors
    /// A sentence with file, key and reason.
    pub fn parse(text: &str, file: &Path) -> Result<Self, InputError> {
        let ledger: Self = toml::from_str(text).map_err(|error| {
            let line = error.span().map(|span| line_of_offset(text, span.start));
            InputError::new(file, error.message().trim()).at_line(line)
        })?;
        for (index, budget) in ledger.budget.iter().enumerate() {
            let refuse = |key: &str, reason: &str| {
                Err(InputError::new(file, reason).for_item(format!("budget.{index}.{key}")))
            };
            let figures = [("must", Some(budget.must)), ("aim", Some(budget.aim)), ("last", budget.last)];
            for (key, value) in figures {
                if value.is_some_and(|value| !(value.is_finite() && value >= 0.0)) {
                    return refuse(key, "is no finite number from zero on");
                }
            }
            if budget.aim > budget.must {
                return refuse("aim", "is worse than `must`");
            }
            match (&budget.figure, budget.last, &budget.unmeasured) {
                (Some([meter, _]), Some(_), None) if ledger.meters.contains_key(meter) => {}
                (Some(_), Some(_), None) => return refuse("figure", "names no meter"),
                (None, None, Some(reason)) if !budget.missed && !reason.is_empty() => {}
                _ => {
                    return refuse("figure", "needs `last` beside it; or else `unmeasured` stands alone");
                }
            }
        }
        Ok(ledger)
    }
}

impl Budget {
    /// What is wrong with the row, given what its meter printed: `None` where the meter was not asked.
    pub fn faults(&self, printed: Option<&serde_json::Value>) -> (Option<f64>, Vec<Fault>) {
        let (Some([_, pointer]), Some(last)) = (&self.figure, self.last) else { return (None, Vec::new()) };
        let mut faults = Vec::new();
        let figure = printed.and_then(|printed| printed.pointer(pointer)).and_then(|value| value.as_f64());
        if printed.is_some() && figure.is_none() {
            faults.push(Fault::NoFigure);
        }
        if figure.is_some_and(|figure| figure > TOLERANCE * last) {
            faults.push(Fault::Worse);
        }
        match (figure.unwrap_or(last) <= self.must, self.missed) {
            (false, false) => faults.push(Fault::Missed),
            (true, true) => faults.push(Fault::Met),
            _ => {}
        }
        (figure, faults)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn row(must: f64, last: f64, missed: bool) -> Budget {
        let text = format!(
            "[meters.m]\ncommand = \"true\"\n[[budget]]\nwhat = \"w\"\nunit = \"count\"\nmust = {must:?}\naim = 0.0\n\
             figure = [\"m\", \"/deep/1\"]\nlast = {last:?}\nmissed = {missed}\n"
        );
        Ledger::parse(&text, Path::new("budgets.toml")).unwrap().budget.remove(0)
    }

    fn faults(row: &Budget, figure: f64) -> Vec<Fault> {
        row.faults(Some(&json!({"deep": [0, figure]}))).1
    }

    #[test]
    fn a_figure_within_its_must_and_near_the_last_passes() {
        for figure in [1.0, 100.0, 104.9] {
            assert_eq!(faults(&row(120.0, 100.0, false), figure), []);
        }
    }

    #[test]
    fn a_figure_worse_than_the_last_by_more_than_five_percent_fails() {
        assert_eq!(faults(&row(120.0, 100.0, false), 105.1), [Fault::Worse]);
        assert_eq!(faults(&row(0.0, 0.0, false), 1.0), [Fault::Worse, Fault::Missed]);
    }

    #[test]
    fn a_missed_must_that_is_not_marked_fails() {
        assert_eq!(faults(&row(99.0, 100.0, false), 100.0), [Fault::Missed]);
        // Also where its meter was not run.
        assert_eq!(row(99.0, 100.0, false).faults(None).1, [Fault::Missed]);
        assert_eq!(faults(&row(99.0, 100.0, true), 100.0), []);
    }

    #[test]
    fn a_met_must_that_is_marked_as_missed_fails() {
        assert_eq!(faults(&row(99.0, 100.0, true), 98.0), [Fault::Met]);
        assert_eq!(row(100.0, 100.0, true).faults(None).1, [Fault::Met]);
    }

    #[test]
    fn a_meter_that_prints_no_figure_fails() {
        let row = row(120.0, 100.0, false);
        for printed in
            [json!({}), json!({"deep": [1]}), json!({"deep": [1, "2"]}), json!({"deep": [1, null]})]
        {
            assert_eq!(row.faults(Some(&printed)).1, [Fault::NoFigure], "{printed}");
        }
    }

    #[test]
    fn a_malformed_ledger_is_refused_with_the_key() {
        let good =
            "[meters.m]\ncommand = \"true\"\n[[budget]]\nwhat = \"w\"\nunit = \"count\"\nmust = 2\naim = 1\n";
        let says = |rest: &str| {
            let error = Ledger::parse(&format!("{good}{rest}"), Path::new("budgets.toml")).unwrap_err();
            error.to_string()
        };
        assert!(says("last = 1").contains("`budget.0.figure`"));
        assert!(says("figure = [\"m\", \"/a\"]").contains("`budget.0.figure`"));
        assert!(says("figure = [\"n\", \"/a\"]\nlast = 1").contains("names no meter"));
        assert!(says("unmeasured = \"later\"\nlast = 1").contains("stands alone"));
        assert!(says("figure = [\"m\", \"/a\"]\nlast = nan").contains("`budget.0.last`"));
        assert!(says("figure = [\"m\", \"/a\"]\nlast = 1\nmised = true").contains("line 10"));
    }

    #[test]
    fn the_ledger_of_this_repository_is_sound() {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../budgets.toml");
        let ledger = Ledger::parse(&std::fs::read_to_string(&file).unwrap(), &file).unwrap();
        for budget in &ledger.budget {
            assert_eq!(budget.faults(None).1, [], "{}", budget.what);
        }
    }
}
