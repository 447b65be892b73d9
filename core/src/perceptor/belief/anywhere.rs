//! Anywhere: that the tag is at none of the places held.
//!
//! A hypothesis of its own, uniform over a [`crate::model::region::Region`]. Its sources are those that the leader expects, with the
//! same probabilities q_k of a path, but the range of each may be any up to the reach R. So, of K sources and M measurements,
//!
//! L = prod_k (1 - q_k) prod_m [1 + max(K - m, 1) / K O / (R lambda_m)], O = sum_k q_k / (1 - q_k), m = 0 .. M - 1,
//!
//! each source giving one measurement at most. It pays the misses that the leader pays, and a leader that explains what is heard
//! pays them back manifold.

use crate::model::measurement::{Clutter, Measurement};
use crate::real::{larger, ln, smaller};

/// Guard: against the division by what is left of 1: largest probability of a path.
pub const MOST_EXPECTED: f32 = 0.95;

/// ln L, over that of clutter of the usual density; `expected` are the q_k.
pub fn evidence_nat<'a>(
    expected: impl Iterator<Item = f32>,
    measurements: impl Iterator<Item = &'a Measurement>,
    clutter: &Clutter,
    reach_m: f32,
) -> f32 {
    let Clutter { all_per_m, false_alarms_per_m } = *clutter;
    let (mut evidence_nat, mut odds, mut sources) = (0.0, 0.0, 0.0);
    for q in expected {
        let q = smaller(q, MOST_EXPECTED);
        evidence_nat += ln(1.0 - q);
        odds += q / (1.0 - q);
        sources += 1.0;
    }
    let sources = larger(sources, 1.0);
    let mut left = sources;
    for measurement in measurements {
        let per_m = false_alarms_per_m * measurement.false_alarm + (all_per_m - false_alarms_per_m);
        let own = left / sources * odds / reach_m;
        evidence_nat += ln((per_m + own) / all_per_m);
        left = larger(left - 1.0, 1.0);
    }
    evidence_nat
}

#[cfg(test)]
mod tests {
    use super::*;

    const CLUTTER: Clutter = Clutter { all_per_m: 0.2, false_alarms_per_m: 0.03 };
    const REACH_M: f32 = 30.0;

    fn path(false_alarm: f32) -> Measurement {
        Measurement { range_m: 5.0, variance_m2: 0.01, sinr: 100.0, energy: 1.0, false_alarm }
    }

    fn evidence(expected: &[f32], paths: &[Measurement]) -> f32 {
        evidence_nat(expected.iter().copied(), paths.iter(), &CLUTTER, REACH_M)
    }

    #[test]
    fn of_one_source_it_is_the_sum_over_what_its_path_may_be() {
        // No path, or any one of them at any range of the reach: exact for one measurement.
        for (q, false_alarm) in [(0.1, 0.0), (0.7, 1.0), (0.9, 0.3)] {
            let per_m = 0.03 * f64::from(false_alarm) + 0.17;
            let exact = ((1.0 - q) + q / (30.0 * per_m)).ln() + (per_m / 0.2).ln();
            let found = evidence(&[q as f32], &[path(false_alarm)]);
            assert!((f64::from(found) - exact).abs() < 1e-5, "{found} {exact}");
        }
    }

    #[test]
    fn misses_cost_what_they_cost_a_leader_and_paths_pay_less_than_one_that_is_where_it_is_expected() {
        let misses = evidence(&[0.8, 0.5, 0.3], &[]);
        assert!((misses - ln(0.2 * 0.5 * 0.7)).abs() < 1e-6);
        assert_eq!(evidence(&[], &[]), 0.0);
        // Nothing is expected: it is the clutter's own.
        assert!((evidence(&[], &[path(0.0)]) - ln(0.17 / 0.2)).abs() < 1e-6);
        // A leader has it at N(0; 0, 0.05^2) = 8 per metre.
        let placed = ln(0.2 + 0.8 * 8.0 / 0.2);
        assert!(evidence(&[0.8], &[path(1.0)]) < placed - 3.0);
    }
}
