//! Anywhere: that the tag is at none of the places held.
//!
//! A hypothesis of its own, uniform over a [`crate::model::region::Region`]. Its sources are those that the leader expects, with the
//! same probabilities q_k of a path, but the range of each may be any up to the reach R. With P_j, the probability that j of them
//! are found, and e_j, the elementary symmetric polynomials of 1 / (R lambda_m), m over the measurements,
//!
//! L = sum_j P_j j! e_j,
//!
//! the sum over all associations. It pays the misses that the leader pays, and a leader that explains what is heard pays them back
//! manifold.

use crate::model::measurement::{Clutter, Measurement};
use crate::real::{larger, ln, smaller};

/// Guard: against L = 0: largest probability of a path.
pub const MOST_EXPECTED: f32 = 0.95;
/// Guard: against overflow: largest 1 / (R lambda_m).
pub const LARGEST_RATIO: f32 = 10.0;

/// ln L, over that of clutter of the usual density; `expected` are the q_k.
#[inline(never)]
pub fn evidence_nat<const PATHS: usize>(
    expected: impl Iterator<Item = f32>,
    measurements: &heapless::Vec<Measurement, PATHS>,
    clutter: &Clutter,
    reach_m: f32,
) -> f32 {
    let Clutter { all_per_m, false_alarms_per_m } = *clutter;
    let none = 0.0_f32;
    // Of j = 0, and of 1, 2, ...
    let (mut found_0, mut found) = (1.0_f32, [none; PATHS]);
    for q in expected {
        let q = smaller(q, MOST_EXPECTED);
        let mut before = found_0;
        found_0 *= 1.0 - q;
        for found in &mut found {
            let own = *found;
            *found = own * (1.0 - q) + before * q;
            before = own;
        }
    }
    let mut evidence_nat = 0.0;
    let mut selections = [none; PATHS];
    for measurement in measurements {
        let per_m = false_alarms_per_m * measurement.false_alarm + (all_per_m - false_alarms_per_m);
        evidence_nat += ln(per_m / all_per_m);
        let ratio = smaller(1.0 / (reach_m * per_m), LARGEST_RATIO);
        let (mut before, mut count) = (1.0, 1.0);
        for selection in &mut selections {
            // j! e_j: the new one is any of the j.
            let own = *selection;
            *selection = own + count * (ratio * before);
            before = own;
            count += 1.0;
        }
    }
    let sum =
        found.iter().zip(&selections).fold(found_0, |sum, (found, selections)| sum + found * selections);
    evidence_nat + ln(larger(sum, f32::MIN_POSITIVE))
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
        let measurements: heapless::Vec<Measurement, 4> = paths.iter().copied().collect();
        evidence_nat(expected.iter().copied(), &measurements, &CLUTTER, REACH_M)
    }

    /// Sum over all associations of these sources, the ratios of the measurements that are left given.
    fn sum(expected: &[f32], ratios: &[f64]) -> f64 {
        let Some((q, others)) = expected.split_first() else { return 1.0 };
        let q = f64::from(*q);
        let taken = (0..ratios.len()).map(|m| {
            let mut left = ratios.to_vec();
            let ratio = left.remove(m);
            q * ratio * sum(others, &left)
        });
        (1.0 - q) * sum(others, ratios) + taken.sum::<f64>()
    }

    #[test]
    fn it_is_the_sum_over_all_associations() {
        let strengths = [0.0, 1.0, 0.3, 0.7];
        for sources in 0..=5 {
            for paths in 0..=4 {
                let expected = &[0.1, 0.7, 0.9, 0.5, 0.3][..sources];
                let heard: std::vec::Vec<Measurement> = strengths[..paths].iter().map(|f| path(*f)).collect();
                let per_m: std::vec::Vec<f64> =
                    strengths[..paths].iter().map(|f| 0.03 * f64::from(*f) + 0.17).collect();
                let ratios: std::vec::Vec<f64> = per_m.iter().map(|per_m| 1.0 / (30.0 * per_m)).collect();
                let usual: f64 = per_m.iter().map(|per_m| (per_m / 0.2).ln()).sum();
                let exact = sum(expected, &ratios).ln() + usual;
                let found = evidence(expected, &heard);
                assert!((f64::from(found) - exact).abs() < 1e-5, "{sources} {paths}: {found} {exact}");
            }
        }
    }

    #[test]
    fn a_leader_that_is_right_is_far_ahead_and_one_without_a_source_is_not_behind() {
        assert_eq!(evidence(&[], &[]), 0.0);
        assert!((evidence(&[], &[path(0.0)]) - ln(0.17 / 0.2)).abs() < 1e-6);
        // A leader has it at N(0; 0, 0.05^2) = 8 per metre.
        let placed = ln(0.2 + 0.8 * 8.0 / 0.2);
        assert!(evidence(&[0.8], &[path(1.0)]) < placed - 3.0);
        // Whatever comes, it is a number.
        let certain = [1.0; 24];
        let many: heapless::Vec<Measurement, 16> = (0..16).map(|_| path(0.0)).collect();
        let rare = Clutter { all_per_m: 2e-6, false_alarms_per_m: 1e-6 };
        for clutter in [CLUTTER, rare] {
            for count in [0, 1, 16] {
                let heard: heapless::Vec<Measurement, 16> = many.iter().take(count).copied().collect();
                assert!(evidence_nat(certain.into_iter(), &heard, &clutter, REACH_M).is_finite());
            }
        }
    }
}
