//! A scan with what it was compared to and what came out: what the update and the memories read.

use super::background::Background;
use super::{Belief, Beliefs, Mode, associate};
use crate::model::lateness::Timing;
use crate::model::measurement::Clutter;
use crate::model::range::Regression;
use crate::model::soft_update::{LEAST_WEIGHT, Moments};
use crate::perceptor::expectation::{Expectation, Expectations};
use crate::perceptor::scan::Scan;

/// A scan, its expectations and the beliefs about them.
#[derive(Clone, Debug)]
pub struct AssociatedScan<'a, const SOURCES: usize, const PATHS: usize> {
    /// What was received.
    pub scan: &'a Scan<PATHS>,
    /// What it was expected to show.
    pub expected: Expectations<SOURCES>,
    /// Which measurement belongs to which source.
    pub beliefs: Beliefs<SOURCES, PATHS>,
}

/// The measurements associated with one source.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Innovation {
    /// The regression the innovations refer to.
    pub regression: Regression,
    /// Their probabilities and values, relative to the expected range.
    pub moments: Moments,
    /// Variance of the measurement, square metres.
    pub variance_m2: f32,
    /// What its error has in common with the last one: on top of it, square metres.
    pub alike_m2: f32,
}

impl Innovation {
    /// Of one measurement that is `innovation_m` from what is expected, and belongs to it for certain.
    pub fn hard(regression: Regression, innovation_m: f32, variance_m2: f32) -> Self {
        let moments = Moments { weight: 1.0, first_m: innovation_m, second_m2: innovation_m * innovation_m };
        Self { regression, moments, variance_m2, alike_m2: 0.0 }
    }
}

impl<const SOURCES: usize, const PATHS: usize> AssociatedScan<'_, SOURCES, PATHS> {
    /// Every source with the beliefs about it, the direct path first.
    pub fn features(&self) -> impl Iterator<Item = (&Regression, &Belief<PATHS>)> + Clone {
        self.expected.regressions().zip(self.beliefs.features())
    }

    /// What the state is moved by: one innovation for every source with which anything is associated.
    pub fn innovations(&self) -> impl Iterator<Item = Innovation> + '_ {
        let expectations = core::iter::once(&self.expected.direct_path).chain(&self.expected.expectations);
        let features = self.features().zip(expectations);
        features.filter_map(|((regression, belief), expected)| {
            innovation(regression, expected, self.scan, belief)
        })
    }

    /// What the ranges of the scan say of how late they are, each with the probability that it is of the direct path.
    pub fn timings(&self) -> impl Iterator<Item = (Timing, f32)> + '_ {
        let ranges = self.scan.measurements.iter().zip(&self.beliefs.direct.associated);
        ranges.filter_map(|(measurement, p)| Some((self.expected.direct_path.timing(measurement)?, *p)))
    }

    /// Number of measurements, and how many of them more likely than not belong to a known source.
    pub fn counts(&self) -> (u32, u32) {
        let (mut measurements, mut associated) = (0, 0);
        for (_, &free) in self.scan.measurements.iter().zip(&self.beliefs.unassociated) {
            measurements += 1;
            associated += u32::from(free <= 0.5);
        }
        (measurements, associated)
    }

    /// Expected number of measurements that belong to nothing known.
    pub fn unexplained(&self) -> f32 {
        let free = self.beliefs.unassociated.iter().take(self.scan.measurements.len());
        free.fold(0.0, |sum, free| sum + free)
    }
}

/// Which measurement of a scan belongs to which source. `claims` says, per measurement, how much more probable something that is
/// not expected makes it than clutter would.
#[inline(never)]
pub fn associate_scan<'a, const SOURCES: usize, const PATHS: usize>(
    scan: &'a Scan<PATHS>,
    expected: Expectations<SOURCES>,
    claims: &[f32; PATHS],
    clutter: &Clutter,
    outage: f32,
    mode: Mode,
) -> AssociatedScan<'a, SOURCES, PATHS> {
    let Expectations { direct_path, expectations, .. } = &expected;
    let background = Background::new(&scan.measurements, direct_path, clutter, claims);
    let mut beliefs = associate(direct_path, expectations, &scan.measurements, &background);
    if mode == Mode::Map {
        beliefs.harden();
    }
    let existences = core::iter::once(direct_path).chain(expectations).map(|own| own.existence);
    beliefs.doubt(outage, existences, scan.measurements.len());
    AssociatedScan { scan, expected, beliefs }
}

/// Sums up the measurements associated with a source; `None` where hardly any probability is.
fn innovation<const PATHS: usize>(
    regression: &Regression,
    expected: &Expectation,
    scan: &Scan<PATHS>,
    belief: &Belief<PATHS>,
) -> Option<Innovation> {
    let mut moments = Moments::default();
    let (mut variance, mut alike) = (0.0, 0.0);
    for (measurement, &p) in scan.measurements.iter().zip(&belief.associated) {
        let nu = measurement.range_m - regression.range_m;
        moments.weight += p;
        if let Some(timing) = expected.timing(measurement) {
            moments.first_m += p * timing.first_m;
            moments.second_m2 += p * timing.second_m2;
        } else {
            moments.first_m += p * nu;
            moments.second_m2 += p * (nu * nu);
        }
        variance += p * measurement.variance_m2;
        alike += p * scan.alike_m2(measurement);
    }
    if moments.weight < LEAST_WEIGHT {
        return None;
    }
    Some(Innovation {
        regression: *regression,
        moments,
        variance_m2: variance / moments.weight,
        alike_m2: alike / moments.weight,
    })
}

/// Mean normalised innovation squared of what was associated: 1 where the filter knows how wrong it is, 0 without
/// measurements.
pub fn normalised_innovation<'a, const SOURCES: usize, const PATHS: usize>(
    heard: impl Iterator<Item = &'a AssociatedScan<'a, SOURCES, PATHS>>,
) -> f32 {
    let (mut weight, mut squares) = (0.0, 0.0);
    for innovation in heard.flat_map(AssociatedScan::innovations) {
        weight += innovation.moments.weight;
        squares +=
            innovation.moments.second_m2 / (innovation.regression.variance_m2() + innovation.variance_m2);
    }
    if weight > 0.0 { squares / weight } else { 0.0 }
}
