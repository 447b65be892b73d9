//! Manoeuvres: cycles in which the tag does not go on as the motion prior has it.
//!
//! Somebody who turns on his heel changes his velocity by more than a metre per second within one cycle: ten deviations
//! of an acceleration that fits the rest of his way. The next paths then lie outside all gates, and what lies inside
//! belongs to something else. So where direct paths are not near where they are expected, two hypotheses compete: the motion
//! as configured, and one in which the velocity was drawn anew once. (A virtual anchor that is off says as much about
//! the map as about the motion, and raises no suspicion.) Each is weighed by the evidence of the scans for the place that it
//! predicts (see [`super::loss`]); the manoeuvre wins if it gains more than its own improbability costs.

use crate::model::clock::probability;
use crate::real::{larger, ln};

/// Mathematics: direct paths that are more probably seen than not count for the suspicion.
pub const LIKELY: f32 = 0.5;
/// Mathematics: squared deviations within which a measurement lies near what is expected: 95 %.
pub const NEAR: f32 = 4.0;
/// Tuned: against weighing two hypotheses in every cycle: share of those that have a measurement near them, below which a manoeuvre is thought of.
pub const ENOUGH: f32 = 0.7;

/// How many of the direct paths counted on were found where they were expected.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Suspicion {
    expected: f32,
    near: f32,
}

impl Suspicion {
    /// Enters a direct path that a scan shows with probability `detection`, and the smallest normalised innovation squared
    /// that any of the scan's measurements has to it.
    pub fn enter(&mut self, detection: f32, nearest: f32) {
        if detection > LIKELY {
            self.expected += detection;
            if nearest < NEAR {
                self.near += detection;
            }
        }
    }

    /// Whether to think of a manoeuvre.
    pub fn is_raised(&self) -> bool {
        self.near < ENOUGH * self.expected
    }
}

/// Whether there was a manoeuvre in the last `elapsed_s` seconds, by the evidence for the place that each hypothesis predicts:
/// with so many per second, it must outweigh the odds ln((1 - p) / p) of its own probability p.
pub fn is_manoeuvre(
    evidence_of_motion_nat: f32,
    evidence_of_manoeuvre_nat: f32,
    turns_per_s: f32,
    elapsed_s: f32,
) -> bool {
    let turned = probability(turns_per_s, elapsed_s);
    // Written so that no turn at all is none.
    evidence_of_manoeuvre_nat - evidence_of_motion_nat > ln((1.0 - turned) / larger(turned, 1e-9))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn suspicion_counts_only_on_what_is_likely_seen() {
        let mut suspicion = Suspicion::default();
        assert!(!suspicion.is_raised());
        suspicion.enter(0.9, 0.5);
        suspicion.enter(0.9, 3.0);
        suspicion.enter(0.9, 1.0);
        suspicion.enter(0.3, 100.0);
        assert!(!suspicion.is_raised());
        suspicion.enter(0.8, 5.0);
        assert!(!suspicion.is_raised());
        suspicion.enter(0.8, f32::INFINITY);
        assert!(suspicion.is_raised());
    }
}
