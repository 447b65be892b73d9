//! Whether the tag is where the filter believes it to be: evidence of the measurements, scan by scan.

use super::association::{Clutter, Expectation, Measurement, is_earlier};
use super::real::{Real, abs, exp, larger, ln, sqrt, square, tau};
use cogmint_core::perceptor::association::evidence::ELSEWHERE_M;
use cogmint_core::perceptor::association::factors::GATE;
use cogmint_core::perceptor::belief::loss::{BeliefSettings, WIDEST_M2};

/// What speaks against the place.
#[derive(Clone, Copy, Debug)]
pub struct LossMonitor<T> {
    /// Evidence against it that no evidence for it has made up for, nats.
    pub doubt_nat: T,
}

/// ln p(measurements | here) - ln p(measurements | elsewhere), given how many there are. `expectations`: the direct path
/// first.
pub fn evidence_nat<T: Real>(
    measurements: &[Measurement<T>],
    expectations: &[Expectation<T>],
    clutter: &Clutter<T>,
) -> T {
    let half = T::of(0.5);
    let spread = T::of(ELSEWHERE_M);
    let Clutter { false_alarms_per_m, all_per_m } = *clutter;
    let unmapped_per_m = all_per_m - false_alarms_per_m;
    let direct = &expectations[0];
    let mut evidence = T::ZERO;
    for z in measurements {
        // Before the direct path there are false alarms only. A tag elsewhere may be nearer.
        let ahead = direct.range_m - z.range_m;
        let earlier = is_earlier(z, direct.range_m, direct.variance_m2);
        let false_alarms_per_m = z.false_alarm * false_alarms_per_m;
        let nearer = half - half * ahead / (spread + abs(ahead));
        let mut here = if earlier { false_alarms_per_m } else { all_per_m };
        let mut elsewhere = false_alarms_per_m + unmapped_per_m * nearer;
        for (k, feature) in expectations.iter().enumerate() {
            let shown = feature.existence * feature.detection;
            let squared = square(z.range_m - feature.range_m);
            let variance = feature.variance_m2 + z.variance_m2;
            if squared < square(T::of(GATE)) * variance && (k == 0 || !earlier) {
                here += shown * exp(T::of(-0.5) * (squared / variance)) / sqrt(tau::<T>() * variance);
            }
            // Cauchy.
            elsewhere += shown * (T::of(2.0) * spread / tau::<T>()) / (square(spread) + squared);
        }
        evidence += ln(here / elsewhere);
    }
    evidence
}

impl<T: Real> LossMonitor<T> {
    /// No doubt yet.
    pub fn new() -> Self {
        Self { doubt_nat: T::ZERO }
    }

    /// Enters a cycle.
    pub fn observe(&mut self, evidence_nat: T) {
        self.doubt_nat = larger(self.doubt_nat - evidence_nat, T::ZERO);
    }

    /// The map must not be judged from here.
    pub fn is_doubtful(&self, settings: &BeliefSettings) -> bool {
        self.doubt_nat > T::of(settings.doubtful_nat)
    }

    /// The tag is elsewhere.
    pub fn is_lost(&self, settings: &BeliefSettings) -> bool {
        self.doubt_nat > T::of(settings.lost_nat)
    }

    /// Too uncertain for one Gaussian.
    pub fn is_too_wide(xx: T, yy: T) -> bool {
        xx + yy > T::of(WIDEST_M2)
    }
}

impl<T: Real> Default for LossMonitor<T> {
    fn default() -> Self {
        Self::new()
    }
}
