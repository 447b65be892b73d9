//! Loss: whether the tag is still where the state filter believes it to be.
//!
//! Every measurement is asked which of two it speaks for: that the tag is here, so that paths lie where they are expected,
//! or that it is elsewhere, a metre off or more, so that they are spread about there. With q_k the probability that
//! feature k exists and is detected and lambda the intensity of what nothing explains, the evidence of measurement m is
//!
//! ln (lambda + sum_k q_k N(z_m; mean_k, S_km)) - ln (lambda + sum_k q_k K(z_m - mean_k)),
//!
//! K a Cauchy density of one metre. Ahead of the direct path only false alarms arrive, from here (lambda is lambda_fa, no
//! virtual anchor counts), and those are weak: a strong path there says that the tag is nearer. How many measurements there are says nothing: a jammed radio is not a lost tag.
//! The evidence against the place adds up, that for it pays doubt back but is not saved (Page's test). Where the
//! prediction has become too wide for one Gaussian, the tag is as good as lost.

use crate::real::larger;

/// When the tag is taken for lost.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct BeliefSettings {
    /// Evidence against the place, nats (0 to 100), from which on the map is not judged by what is heard: e^3 to one. Less: the
    /// map stands still at every doubtful scan. More: it is judged from a wrong place.
    pub doubtful_nat: f32,
    /// Evidence from which on the tag is lost, nats (1 to 1000): e^15 to one. Less: lost for nothing. More: noticed later.
    pub lost_nat: f32,
    /// Turns of the tag per second (0 to 10): the prior of the velocity being drawn anew. More follows turns sooner and takes
    /// false paths for turns.
    pub turns_per_s: f32,
}

impl Default for BeliefSettings {
    fn default() -> Self {
        Self { doubtful_nat: 3.0, lost_nat: 15.0, turns_per_s: 0.2 }
    }
}

/// Tuned: against updates far beyond a range's line: sum of the position's variances beyond which one Gaussian cannot be updated by ranges any more, square metres.
pub const WIDEST_M2: f32 = 2.0;

/// The loss monitor.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LossMonitor {
    doubt_nat: f32,
}

impl LossMonitor {
    /// Enters the evidence of a cycle.
    pub fn observe(&mut self, evidence_nat: f32) {
        self.doubt_nat = larger(self.doubt_nat - evidence_nat, 0.0);
    }

    /// Whether so much speaks against the place that the map must not be judged from it.
    pub fn is_doubtful(&self, settings: &BeliefSettings) -> bool {
        self.doubt_nat > settings.doubtful_nat
    }

    /// Whether the tag must be elsewhere.
    pub fn is_lost(&self, settings: &BeliefSettings) -> bool {
        self.doubt_nat > settings.lost_nat
    }

    /// Whether a position of these variances (xx, yy; square metres) is too uncertain to be tracked.
    pub fn is_too_wide(xx: f32, yy: f32) -> bool {
        xx + yy > WIDEST_M2
    }

    /// Every number of the state, in a fixed order, for traces.
    pub fn visit(&self, mut f: impl FnMut(f32)) {
        f(self.doubt_nat);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::measurement::{Clutter, Measurement};
    use crate::perceptor::association::evidence::evidence_nat;
    use crate::perceptor::expectation::Expectation;

    const CLUTTER: Clutter = Clutter { false_alarms_per_m: 1.0 / 30.0, all_per_m: 2.0 / 30.0 };

    fn expectation(range_m: f32) -> Expectation {
        Expectation { range_m, variance_m2: 0.0064, existence: 1.0, detection: 0.95 }
    }

    fn evidence(ranges_m: &[f32], expected_m: &[f32]) -> f32 {
        let measurements: std::vec::Vec<_> = ranges_m
            .iter()
            .map(|&range_m| Measurement {
                range_m,
                variance_m2: 0.0036,
                sinr: 0.0,
                energy: 0.0,
                false_alarm: 1.0,
            })
            .collect();
        let features: std::vec::Vec<_> = expected_m.iter().map(|&range_m| expectation(range_m)).collect();
        evidence_nat(&measurements, &features[0], features[1..].iter(), &CLUTTER)
    }

    #[test]
    fn the_evidence_of_one_range_is_the_closed_form() {
        // The deviation of the innovation is 0.1 m.
        let peak = 0.95 / (0.1 * (2.0 * std::f32::consts::PI).sqrt());
        let cauchy = |off_m: f32| 0.95 / (std::f32::consts::PI * (1.0 + off_m * off_m));
        let (false_alarms, all) = (1.0 / 30.0, 2.0 / 30.0);
        let at_the_direct_path = ((all + peak) / (0.5 * (false_alarms + all) + cauchy(0.0))).ln();
        assert!((evidence(&[4.0], &[4.0]) - at_the_direct_path).abs() < 1e-4);
        // A metre too short for the direct path: a false alarm here; elsewhere, in a quarter of cases no longer.
        let shorter = (false_alarms / (false_alarms + 0.25 * (all - false_alarms) + cauchy(1.0))).ln();
        assert!((evidence(&[3.0], &[4.0]) - shorter).abs() < 1e-4);
        // Two metres beyond: unmapped in either case.
        let beyond = (all / (false_alarms + 0.833_333_3 * (all - false_alarms) + cauchy(2.0))).ln();
        assert!((evidence(&[6.0], &[4.0]) - beyond).abs() < 1e-4);
    }

    #[test]
    fn a_tag_heard_where_it_is_expected_is_not_lost_and_one_a_metre_off_is_within_ten_cycles() {
        let expected_m = [3.0, 4.5, 6.1, 7.2];
        let mut monitor = LossMonitor::default();
        for _ in 0..100 {
            monitor.observe(evidence(&[3.05, 4.4, 7.3, 11.0], &expected_m));
            assert!(!monitor.is_doubtful(&BeliefSettings::default()));
        }
        let cycles = (1..).find(|_| {
            monitor.observe(evidence(&[2.2, 5.3, 5.3, 8.0, 11.0], &expected_m));
            monitor.is_lost(&BeliefSettings::default())
        });
        assert!(cycles.is_some_and(|cycles| (2..=10).contains(&cycles)), "{cycles:?}");
    }

    #[test]
    fn a_strong_path_ahead_of_the_direct_one_is_told_at_once_and_no_virtual_anchor_explains_it() {
        let strong =
            Measurement { range_m: 3.0, variance_m2: 0.0036, sinr: 1000.0, energy: 0.0, false_alarm: 1e-4 };
        let weak = Measurement { false_alarm: 1.0, ..strong };
        // A virtual anchor is believed to be just there.
        let features = [expectation(4.0), expectation(3.0)];
        let of = |measurement: Measurement| {
            evidence_nat(&[measurement], &features[0], features[1..].iter(), &CLUTTER)
        };
        assert!(of(strong) < -10.0 && of(weak) > -4.0, "{} {}", of(strong), of(weak));
    }

    #[test]
    fn a_radio_that_hears_nothing_or_only_the_direct_path_is_not_lost() {
        let mut monitor = LossMonitor::default();
        for _ in 0..1000 {
            monitor.observe(evidence(&[], &[3.0, 4.5, 6.1, 7.2]));
            monitor.observe(evidence(&[3.05], &[3.0, 4.5, 6.1, 7.2]));
            assert!(!monitor.is_doubtful(&BeliefSettings::default()));
        }
    }
}
