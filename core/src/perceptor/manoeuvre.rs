//! Manoeuvres: cycles in which the tag does not go on as the motion prior has it.
//!
//! Somebody who turns on his heel changes his velocity by more than a metre per second within one cycle: ten deviations
//! of an acceleration that fits the rest of his way. The next paths then lie outside all gates, and what lies inside
//! belongs to something else. So where direct paths are not near where they are expected, two hypotheses compete (a virtual
//! anchor that is off says as much about the map as about the motion, and does not count there): the motion as configured, and one of [`ACCELERATION_FACTOR`] times the acceleration. With beliefs about feature k of
//! p(b_k = 0) = psi_k0 / sum_m psi_km nu_m, the log-likelihood of a scan is, up to what both have in common,
//! - sum_k ln p(b_k = 0); the manoeuvre wins if it gains more than its own improbability costs.

use super::association::Belief;
use crate::real::{larger, ln};

/// A manoeuvre's acceleration over the configured one.
pub const ACCELERATION_FACTOR: f32 = 10.0;
/// ln((1 - p) / p) of the probability p that a cycle is a manoeuvre: a turn every fifty cycles.
const COST_NAT: f32 = 4.0;
/// Direct paths that are more probably seen than not count for the suspicion.
const LIKELY: f32 = 0.5;
/// Squared deviations within which a measurement lies near what is expected: 95 %.
const NEAR: f32 = 4.0;
/// Share of those that have a measurement near them, below which a manoeuvre is thought of.
const ENOUGH: f32 = 0.7;
/// A belief is never more certain than this.
const SUREST: f32 = 1e-6;

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

/// What beliefs have against the prediction that they rest on, nats; comparable between predictions for the same scans.
pub fn surprise_nat<'a, const PATHS: usize>(beliefs: impl Iterator<Item = &'a Belief<PATHS>>) -> f32 {
    let mut surprise = 0.0;
    for belief in beliefs {
        surprise += ln(larger(belief.missed, SUREST));
    }
    surprise
}

/// Whether it was a manoeuvre, by the surprise that each hypothesis leaves.
pub fn is_manoeuvre(surprise_of_motion_nat: f32, surprise_of_manoeuvre_nat: f32) -> bool {
    surprise_of_motion_nat - surprise_of_manoeuvre_nat > COST_NAT
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
