//! The factors of the features of one anchor, and which features compete for the same measurements.

use super::background::Background;
use crate::model::measurement::{Measurement, is_earlier};
use crate::perceptor::expectation::Expectation;
use crate::real::{TAU, exp, larger, sqrt};
use heapless::Vec;

/// Guard: against work on what explains nothing: beyond this many standard deviations a measurement cannot belong to a feature.
pub const GATE: f32 = 4.0;
/// Guard: against the division by it: least probability that a feature gives no measurement. One that cannot be missed would
/// leave no room for lost paths either.
pub const LEAST_ABSENT: f32 = 1e-6;

/// How a feature's beliefs are formed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Stage {
    /// Not decided yet.
    Waiting,
    /// A member of the cluster at hand.
    Gathered,
    /// A member of it that has taken its place in the order.
    Listed,
    /// With its whole cluster, exactly.
    Exact,
    /// By loopy belief propagation.
    Loopy,
}

/// One feature's factors.
#[derive(Clone, Copy, Debug)]
pub(super) struct Row<const PATHS: usize> {
    pub(super) stage: Stage,
    /// Expected range, metres.
    pub(super) range_m: f32,
    /// psi_k0.
    pub(super) absent: f32,
    /// psi_km.
    pub(super) psi: [f32; PATHS],
    /// Bit m is set where psi_km is above zero.
    pub(super) gated: u32,
}

impl<const PATHS: usize> Row<PATHS> {
    /// A feature that is never detected.
    fn blank() -> Self {
        Self { stage: Stage::Waiting, range_m: 0.0, absent: 1.0, psi: [0.0; PATHS], gated: 0 }
    }

    /// The factors of a feature, in a blank row.
    #[inline(never)]
    fn fill(
        &mut self,
        expectation: &Expectation,
        measurements: &Vec<Measurement, PATHS>,
        background: &Background<PATHS>,
    ) {
        let detected = expectation.existence * expectation.detection;
        for ((factor, measurement), per_m) in self.psi.iter_mut().zip(measurements).zip(background.per_m()) {
            let innovation = measurement.range_m - expectation.range_m;
            let variance = expectation.variance_m2 + measurement.variance_m2;
            let nis = innovation * innovation / variance;
            if expectation.may_be_late(measurement) {
                let std = sqrt(variance);
                if innovation > -(GATE * std)
                    && innovation < expectation.lateness.reach_m(GATE, std)
                    && let Some(timing) = expectation.timing(measurement)
                {
                    *factor = detected * timing.per_m / per_m;
                }
            } else if nis < GATE * GATE {
                *factor = detected * exp(-0.5 * nis) / (sqrt(TAU * variance) * per_m);
            }
        }
        let absent = expectation.existence * (1.0 - expectation.detection) + (1.0 - expectation.existence);
        self.range_m = expectation.range_m;
        self.absent = larger(absent, LEAST_ABSENT);
    }

    /// Marks the measurements above zero, and puts those of `barred` there.
    fn bar(&mut self, barred: u32) {
        let mut bit = 1_u32;
        for psi in &mut self.psi {
            if barred & bit != 0 {
                *psi = 0.0;
            }
            if *psi > 0.0 {
                self.gated |= bit;
            }
            bit = bit.wrapping_add(bit);
        }
    }

    /// Where the direct path is a measurement, all that are clearly shorter (by two deviations) are false alarms.
    fn discount_later_arrivals(
        &mut self,
        measurements: &Vec<Measurement, PATHS>,
        background: &Background<PATHS>,
    ) {
        for (factor, measurement) in self.psi.iter_mut().zip(measurements).filter(|(psi, _)| **psi > 0.0) {
            let clearly_shorter = measurement.range_m - 2.0 * sqrt(measurement.variance_m2);
            for (other, false_alarm) in measurements.iter().zip(background.false_alarms()) {
                if other.range_m < clearly_shorter {
                    *factor *= false_alarm;
                }
            }
        }
    }
}

/// The indices of the ones in `set`, upwards.
pub(super) fn members(set: u32) -> impl Iterator<Item = usize> {
    let mut rest = set;
    core::iter::from_fn(move || {
        (rest != 0).then(|| {
            let index = rest.trailing_zeros();
            rest &= rest.wrapping_sub(1);
            index as usize
        })
    })
}

/// The features of one anchor: number 0 is the direct path, the virtual anchors follow in the order given.
#[derive(Clone, Debug)]
pub(super) struct Rows<const SOURCES: usize, const PATHS: usize> {
    pub(super) direct: Row<PATHS>,
    pub(super) virtual_anchors: Vec<Row<PATHS>, SOURCES>,
}

impl<const SOURCES: usize, const PATHS: usize> Rows<SOURCES, PATHS> {
    /// No features yet. They come with [`Self::fill`]: built in place, the rows need not be moved, and so stand on the
    /// stack once.
    pub(super) fn empty() -> Self {
        const { assert!(PATHS <= 32, "sets of measurements are 32 bits") };
        Self { direct: Row::blank(), virtual_anchors: Vec::new() }
    }

    #[inline(never)]
    pub(super) fn fill(
        &mut self,
        direct: &Expectation,
        virtual_anchors: &Vec<Expectation, SOURCES>,
        measurements: &Vec<Measurement, PATHS>,
        background: &Background<PATHS>,
    ) {
        self.direct.fill(direct, measurements, background);
        self.direct.discount_later_arrivals(measurements, background);
        self.direct.bar(0);
        // No reflection arrives before the direct path, wherever its virtual anchor is believed to be.
        let mut earlier = 0_u32;
        for (m, measurement) in measurements.iter().enumerate() {
            if is_earlier(measurement, direct.range_m, direct.variance_m2) {
                earlier |= 1_u32.wrapping_shl(m as u32);
            }
        }
        for expectation in virtual_anchors {
            // Capacities are equal: every push succeeds.
            let _ = self.virtual_anchors.push(Row::blank());
            if let Some(row) = self.virtual_anchors.last_mut() {
                row.fill(expectation, measurements, background);
                row.bar(earlier);
            }
        }
    }

    pub(super) fn iter(&self) -> impl DoubleEndedIterator<Item = &Row<PATHS>> {
        core::iter::once(&self.direct).chain(&self.virtual_anchors)
    }

    pub(super) fn iter_mut(&mut self) -> impl DoubleEndedIterator<Item = &mut Row<PATHS>> {
        core::iter::once(&mut self.direct).chain(&mut self.virtual_anchors)
    }

    pub(super) fn get(&self, feature: usize) -> Option<&Row<PATHS>> {
        match feature.checked_sub(1) {
            None => Some(&self.direct),
            Some(slot) => self.virtual_anchors.get(slot),
        }
    }

    /// Marks the members of one more cluster as gathered; how many they are, 0 where no feature waits any more.
    ///
    /// Two features are of one cluster where a measurement is within the gates of both, or a chain of such pairs
    /// joins them.
    #[inline(never)]
    pub(super) fn gather_cluster(&mut self) -> usize {
        let (mut measurements, mut gathered) = (None, 0);
        loop {
            let mut grown = false;
            for row in self.iter_mut().filter(|row| row.stage == Stage::Waiting) {
                let joined = match measurements {
                    None => Some(row.gated),
                    Some(members) if members & row.gated != 0 => Some(members | row.gated),
                    Some(_) => None,
                };
                if joined.is_some() {
                    measurements = joined;
                    row.stage = Stage::Gathered;
                    gathered += 1;
                    grown = true;
                }
            }
            if !grown {
                return gathered;
            }
        }
    }

    /// Ends the work on the cluster at hand.
    pub(super) fn settle_cluster(&mut self, stage: Stage) {
        for row in self.iter_mut().filter(|row| matches!(row.stage, Stage::Gathered | Stage::Listed)) {
            row.stage = stage;
        }
    }

    /// The gathered feature with the shortest expected range, the first of equals; so many are gathered.
    #[inline(never)]
    pub(super) fn shortest_gathered(&mut self, gathered: usize) -> Option<(usize, &mut Row<PATHS>)> {
        let mut shortest: Option<(usize, &mut Row<PATHS>)> = None;
        let all = self.iter_mut().enumerate().filter(|(_, row)| row.stage == Stage::Gathered);
        for (feature, row) in all.take(gathered) {
            if shortest.as_ref().is_none_or(|(_, least)| row.range_m < least.range_m) {
                shortest = Some((feature, row));
            }
        }
        shortest
    }
}
