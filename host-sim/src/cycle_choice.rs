//! A choice of a recording's cycles: every second one, or a stretch. What is calibrated on some cycles is scored on others.

use crate::input_error::InputError;
use crate::recording::Recording;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::path::Path;
use std::str::FromStr;

/// Some of the cycles of a recording, counted from 0.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum CycleChoice {
    /// All of them.
    #[default]
    All,
    /// Cycles 1, 3, 5, ...
    Odd,
    /// Cycles 0, 2, 4, ...
    Even,
    /// From the first number on, up to but without the second.
    Stretch(usize, usize),
}

impl CycleChoice {
    /// Whether a cycle is among them.
    pub const fn has(self, cycle: usize) -> bool {
        match self {
            Self::All => true,
            Self::Odd => cycle % 2 == 1,
            Self::Even => cycle.is_multiple_of(2),
            Self::Stretch(from, to) => from <= cycle && cycle < to,
        }
    }

    /// The recording with the truth of these cycles alone: the others are tracked like them, and not scored.
    ///
    /// # Errors
    /// No cycle of the recording in `folder` is among them.
    pub fn scored(self, recording: Recording, folder: &Path) -> Result<Recording, InputError> {
        self.check(&recording, folder)?;
        let Recording { mut cycles, .. } = recording;
        for (_, cycle) in cycles.iter_mut().enumerate().filter(|(index, _)| !self.has(*index)) {
            cycle.truth_position_m = None;
        }
        Ok(Recording { cycles, ..recording })
    }

    /// Refuses a choice that no cycle is in.
    ///
    /// # Errors
    /// No cycle of the recording in `folder` is among them.
    pub fn check(self, recording: &Recording, folder: &Path) -> Result<(), InputError> {
        let cycles = recording.cycles.len();
        if (0..cycles).any(|cycle| self.has(cycle)) {
            return Ok(());
        }
        let allowed = format!("0 to {}", cycles.saturating_sub(1));
        Err(InputError::new(folder, format!("has none of the cycles {self}")).allowed(allowed))
    }
}

impl FromStr for CycleChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "all" => return Ok(Self::All),
            "odd" => return Ok(Self::Odd),
            "even" => return Ok(Self::Even),
            _ => {}
        }
        let refused = || "allowed is odd, even, all, or FROM..TO with either number left out".to_owned();
        let (from, to) = text.split_once("..").ok_or_else(refused)?;
        let number = |text: &str, missing: usize| match text {
            "" => Ok(missing),
            _ => text.parse().map_err(|_| refused()),
        };
        let (from, to) = (number(from, 0)?, number(to, usize::MAX)?);
        if from < to { Ok(Self::Stretch(from, to)) } else { Err("TO must be above FROM".into()) }
    }
}

impl fmt::Display for CycleChoice {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::All => formatter.write_str("all"),
            Self::Odd => formatter.write_str("odd"),
            Self::Even => formatter.write_str("even"),
            Self::Stretch(from, usize::MAX) => write!(formatter, "{from}.."),
            Self::Stretch(from, to) => write!(formatter, "{from}..{to}"),
        }
    }
}

impl TryFrom<String> for CycleChoice {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl From<CycleChoice> for String {
    fn from(choice: CycleChoice) -> Self {
        choice.to_string()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::tests::example;

    #[test]
    fn a_choice_is_read_as_it_is_written() {
        for text in ["all", "odd", "even", "3..", "0..7", "3..7"] {
            assert_eq!(text.parse::<CycleChoice>().map(|choice| choice.to_string()), Ok(text.into()));
        }
        assert_eq!("..7".parse(), Ok(CycleChoice::Stretch(0, 7)));
        for wrong in ["", "7", "7..7", "7..3", "a..b", "-1..3", "half"] {
            assert!(wrong.parse::<CycleChoice>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn both_halves_are_all_and_share_nothing() {
        for (one, other) in [("odd", "even"), ("..5", "5..")] {
            let [one, other]: [CycleChoice; 2] = [one, other].map(|text| text.parse().expect("is a choice"));
            assert!((0..20).all(|cycle| one.has(cycle) != other.has(cycle)));
        }
    }

    #[test]
    fn what_is_not_chosen_has_no_truth_and_nothing_else_changes() {
        let whole = example();
        let half = CycleChoice::Odd.scored(whole.clone(), Path::new("r")).expect("has an odd cycle");
        assert!(half.cycles[0].truth_position_m.is_none() && half.cycles[1].truth_position_m.is_some());
        let with_truth = whole.cycles.iter().map(|cycle| cycle.truth_position_m);
        let mut again = half;
        again.cycles.iter_mut().zip(with_truth).for_each(|(cycle, truth)| cycle.truth_position_m = truth);
        assert_eq!(again, whole);
        assert!(CycleChoice::Stretch(50, 60).scored(whole, Path::new("r")).is_err());
    }
}
