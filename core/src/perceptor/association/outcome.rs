//! A scan with what it was compared to and what came out: what the update and the memories read.

use super::background::Background;
use super::exact::STATES;
use super::{Belief, Beliefs, Mode, associate_within};
use crate::model::lateness::Timing;
use crate::model::measurement::Clutter;
use crate::model::range::Regression;
use crate::model::soft_update::{LEAST_WEIGHT, Moments};
use crate::perceptor::expectation::{Expectation, Expectations, View};
use crate::perceptor::scan::Scan;
use heapless::Vec;

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

/// One source of a scan.
#[derive(Clone, Copy, Debug)]
struct Feature<const PATHS: usize> {
    regression: Regression,
    expectation: Expectation,
    view: View,
    belief: Belief<PATHS>,
}

/// A scan of a cycle as it is kept; its images are among those of all scans.
#[derive(Clone, Debug)]
struct KeptScan<'a, const PATHS: usize> {
    scan: &'a Scan<PATHS>,
    direct: Feature<PATHS>,
    images: usize,
    unassociated: [f32; PATHS],
    iterations: usize,
    evidence_nat: f32,
    outage: f32,
}

/// The outcomes of all scans of a cycle. An image is of one anchor, and every anchor has one scan: all of them together have no more
/// images than there are.
#[derive(Clone, Debug)]
pub struct Outcomes<'a, const ANCHORS: usize, const SOURCES: usize, const PATHS: usize> {
    scans: Vec<KeptScan<'a, PATHS>, ANCHORS>,
    images: Vec<Feature<PATHS>, SOURCES>,
}

impl<'a, const ANCHORS: usize, const SOURCES: usize, const PATHS: usize>
    Outcomes<'a, ANCHORS, SOURCES, PATHS>
{
    /// None yet.
    pub const fn none() -> Self {
        Self { scans: Vec::new(), images: Vec::new() }
    }

    /// Keeps an outcome: in place of the last one, if that is of the same scan.
    #[inline(never)]
    pub fn keep(&mut self, outcome: &AssociatedScan<'a, SOURCES, PATHS>) {
        let AssociatedScan { scan, expected, beliefs } = outcome;
        if let Some(last) = self.scans.last().filter(|last| last.scan.anchor == scan.anchor) {
            self.images.truncate(self.images.len().saturating_sub(last.images));
            self.scans.truncate(self.scans.len().saturating_sub(1));
        }
        let kept = KeptScan {
            scan,
            direct: Feature {
                regression: expected.direct,
                expectation: expected.direct_path,
                view: expected.views.0,
                belief: beliefs.direct,
            },
            images: beliefs.virtual_anchors.len(),
            unassociated: beliefs.unassociated,
            iterations: beliefs.iterations,
            evidence_nat: beliefs.evidence_nat,
            outage: beliefs.outage,
        };
        // One per anchor, and one per image: the pushes succeed.
        let _ = self.scans.push(kept);
        let regressions = expected.virtual_anchors.iter().zip(&expected.expectations);
        let images = regressions.zip(&expected.views.1).zip(&beliefs.virtual_anchors);
        for (((regression, expectation), view), belief) in images {
            let (regression, expectation, view, belief) = (*regression, *expectation, *view, *belief);
            let _ = self.images.push(Feature { regression, expectation, view, belief });
        }
    }

    /// How many sources all of them are about.
    pub fn sources(&self) -> usize {
        self.scans.len() + self.images.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.scans.is_empty()
    }

    /// The scans.
    pub fn scans(&self) -> impl Iterator<Item = &'a Scan<PATHS>> + '_ {
        self.scans.iter().map(|kept| kept.scan)
    }

    /// Makes an outcome the last one kept.
    pub fn last(&self, outcome: &mut AssociatedScan<'a, SOURCES, PATHS>) {
        let Some(last) = self.scans.last() else { return };
        let before = self.images.len().saturating_sub(last.images);
        last.unpack(self.images.get(before..).unwrap_or(&[]), outcome);
    }

    /// Shows every outcome, one after the other, in the same memory.
    #[inline(always)] // by whom it is shown
    pub fn each(&self, mut show: impl FnMut(&AssociatedScan<'a, SOURCES, PATHS>)) {
        let Some(first) = self.scans.first() else { return };
        let mut outcome = AssociatedScan::of(first.scan);
        let mut images = self.images.as_slice();
        for kept in &self.scans {
            let Some((own, others)) = images.split_at_checked(kept.images) else { return };
            kept.unpack(own, &mut outcome);
            show(&outcome);
            images = others;
        }
    }
}

impl<'a, const PATHS: usize> KeptScan<'a, PATHS> {
    /// The outcome, with its images.
    #[inline(never)]
    fn unpack<const SOURCES: usize>(
        &self,
        images: &[Feature<PATHS>],
        outcome: &mut AssociatedScan<'a, SOURCES, PATHS>,
    ) {
        let AssociatedScan { scan, expected, beliefs } = outcome;
        let Feature { regression, expectation, view, belief } = self.direct;
        *scan = self.scan;
        (expected.direct, expected.direct_path, expected.views.0) = (regression, expectation, view);
        expected.virtual_anchors.clear();
        expected.expectations.clear();
        expected.views.1.clear();
        beliefs.direct = belief;
        beliefs.virtual_anchors.clear();
        for Feature { regression, expectation, view, belief } in images {
            // They were in such lists: the pushes succeed.
            let _ = expected.virtual_anchors.push(*regression);
            let _ = expected.expectations.push(*expectation);
            let _ = expected.views.1.push(*view);
            let _ = beliefs.virtual_anchors.push(*belief);
        }
        beliefs.unassociated = self.unassociated;
        beliefs.iterations = self.iterations;
        beliefs.evidence_nat = self.evidence_nat;
        beliefs.outage = self.outage;
    }
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

impl<'a, const SOURCES: usize, const PATHS: usize> AssociatedScan<'a, SOURCES, PATHS> {
    /// A scan of which nothing was expected yet.
    #[inline(always)] // built where it stays
    pub fn of(scan: &'a Scan<PATHS>) -> Self {
        Self { scan, expected: Expectations::none(), beliefs: Beliefs::none() }
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

/// Which measurement of a scan belongs to which source, by what is expected of it: fills in the beliefs. `claims` says, per
/// measurement, how much more probable something that is not expected makes it than clutter would.
#[inline(never)]
pub fn associate_scan<const SOURCES: usize, const PATHS: usize>(
    outcome: &mut AssociatedScan<'_, SOURCES, PATHS>,
    claims: &[f32; PATHS],
    clutter: &Clutter,
    outage: f32,
    mode: Mode,
) {
    let AssociatedScan { scan, expected: Expectations { direct_path, expectations, .. }, beliefs } = outcome;
    let background = Background::new(&scan.measurements, direct_path, clutter, claims);
    associate_within(direct_path, expectations, &scan.measurements, &background, STATES, mode, beliefs);
    if mode == Mode::Map {
        beliefs.harden();
    }
    let existences = core::iter::once(&*direct_path).chain(&*expectations).map(|own| own.existence);
    beliefs.doubt(outage, existences, scan.measurements.len());
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
        if p == 0.0 {
            continue; // Beyond the gate: it moves nothing.
        }
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

/// Mean normalised innovation squared of what was associated.
#[derive(Clone, Copy, Debug, Default)]
pub struct NormalisedInnovation {
    weight: f32,
    squares: f32,
}

impl NormalisedInnovation {
    /// Adds what was associated in a scan.
    pub fn add<const SOURCES: usize, const PATHS: usize>(
        &mut self,
        outcome: &AssociatedScan<'_, SOURCES, PATHS>,
    ) {
        for innovation in outcome.innovations() {
            self.weight += innovation.moments.weight;
            self.squares +=
                innovation.moments.second_m2 / (innovation.regression.variance_m2() + innovation.variance_m2);
        }
    }

    /// The mean: 1 where the filter knows how wrong it is, 0 without measurements.
    pub fn mean(&self) -> f32 {
        if self.weight > 0.0 { self.squares / self.weight } else { 0.0 }
    }
}
