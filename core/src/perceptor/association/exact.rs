//! Exact beliefs of one cluster: a recursion over its features that remembers only which contested measurements
//! are used.
//!
//! The features stand in the order of their expected ranges, steps k = 0, 1, ... A measurement is open between the
//! first and the last feature that can take it; only of the open ones it matters whether they are used. So the sum
//! over all joint associations is one over paths through a trellis whose states s are sets of used measurements:
//!
//! B_k(s) = psi_k0 B_k+1(s) + sum_{m not in s} psi_km B_k+1(s + m), B_K = 1,
//!
//! and A_k(s) likewise from the first feature on. The marginals are
//! p(b_k = m) ~ sum_{s without m} A_k(s) psi_km B_k+1(s + m). With the largest term in place of the sum, the best
//! path is the joint association of greatest probability. Every step is divided by B_k(no measurement used), the
//! largest of its states, so that all values stay near 1.
//!
//! Order: states count upwards as binary numbers, in which each open measurement has a bit, its seat: the lowest
//! one free when it opens, after the seats of those that close have been freed. Within a state, "missed" comes
//! first and then the measurements by index.

use super::factors::{Rows, Stage, members};
use super::{Beliefs, Joint};
use crate::model::work::{STEP, TAKING, Work};
use crate::real::{LnProduct, larger};
use heapless::Vec;

/// Capacity: values held at once, which bound the memory: (features + 2) times the states of the widest step must fit. Six features that contest six
/// measurements do, or thirty where no more than four are open at a time.
pub const STATES: usize = 512;
/// Capacity: features of one cluster.
pub const FEATURES: usize = 32;

/// When a measurement of the cluster is open.
#[derive(Clone, Copy, Debug)]
struct Seat {
    /// First and last step whose feature can take it.
    first: usize,
    last: usize,
    /// Its bit; 0 where only one feature can take it.
    bit: u32,
}

/// What a feature can do in one step: take a measurement.
#[derive(Clone, Copy, Debug)]
struct Taking {
    measurement: usize,
    psi: f32,
    /// Its bit in the states before the step; 0 where it opens with it.
    before: u32,
    /// Its bit in the states after the step; 0 where it closes with it.
    after: u32,
}

/// All a feature can do in one step.
#[derive(Clone, Debug)]
struct Step<const PATHS: usize> {
    feature: usize,
    absent: f32,
    takings: Vec<Taking, PATHS>,
    /// Bits of the measurements open before the step.
    open: u32,
    /// Those of them still open after it.
    keep: u32,
}

/// Values of all states, layer by layer.
#[derive(Clone, Debug)]
struct Layers {
    values: [f32; STATES],
    /// Length of a layer.
    length: usize,
}

impl Layers {
    fn value(&self, layer: usize, state: u32) -> f32 {
        let at = layer.wrapping_mul(self.length).wrapping_add(state as usize);
        self.values.get(at).copied().unwrap_or(0.0)
    }

    fn value_mut(&mut self, layer: usize, state: u32) -> Option<&mut f32> {
        let at = layer.wrapping_mul(self.length).wrapping_add(state as usize);
        self.values.get_mut(at)
    }

    fn set(&mut self, layer: usize, state: u32, value: f32) {
        if let Some(cell) = self.value_mut(layer, state) {
            *cell = value;
        }
    }

    /// Adds `weight` to A_k+1(`state`) and returns weight times B_k+1(`state`).
    fn carry(&mut self, k: usize, state: u32, weight: f32) -> f32 {
        if let Some(reached) = self.value_mut(k + 1, state) {
            *reached += weight;
        }
        weight * self.value(k + 2, state)
    }
}

/// Memory for one cluster after the other.
#[derive(Clone, Debug)]
pub(super) struct Trellis<const PATHS: usize> {
    /// The cluster's features, by expected range.
    features: Vec<usize, FEATURES>,
    /// Valid for the measurements of the cluster.
    seats: [Seat; PATHS],
    /// Bits open before each step.
    open: Vec<u32, FEATURES>,
    /// B_k(no measurement used) before it was divided by itself.
    totals: [f32; FEATURES],
    /// A_k(s) in layer k over B_k(s) in layer k + 1: when A_k+1 is written, B_k is no longer needed.
    layers: Layers,
    /// The one at hand.
    step: Step<PATHS>,
    /// What was done so far.
    work: Work,
}

impl<const PATHS: usize> Trellis<PATHS> {
    pub(super) fn new() -> Self {
        Self {
            features: Vec::new(),
            seats: [Seat { first: 0, last: 0, bit: 0 }; PATHS],
            open: Vec::new(),
            totals: [1.0; FEATURES],
            layers: Layers { values: [0.0; STATES], length: 1 },
            step: Step { feature: 0, absent: 1.0, takings: Vec::new(), open: 0, keep: 0 },
            work: Work::NONE,
        }
    }

    /// Writes the beliefs of the cluster of so many features `gathered` in `rows`, and its best path where that is asked for, and
    /// multiplies the evidence by its own; false where it needs more
    /// than `limit` values or its probabilities leave the range of `f32`.
    #[inline(never)]
    pub(super) fn solve<const SOURCES: usize>(
        &mut self,
        rows: &mut Rows<SOURCES, PATHS>,
        gathered: usize,
        beliefs: &mut Beliefs<SOURCES, PATHS>,
        evidence: &mut LnProduct,
        limit: usize,
        with_best: bool,
    ) -> bool {
        if !(self.line_up(rows, gathered) && self.seat(rows, limit)) {
            return false;
        }
        self.backward(rows, false);
        let mut with_cluster = *evidence;
        for total in self.totals.iter().take(self.features.len()) {
            with_cluster.times(*total);
        }
        if !self.forward(rows, beliefs) {
            return false;
        }
        *evidence = with_cluster;
        if with_best {
            self.backward(rows, true);
            self.follow(rows, beliefs);
        }
        true
    }

    /// What all solutions so far have cost.
    pub(super) fn work(&self) -> Work {
        self.work
    }

    /// Lists the gathered features by expected range; false where they are too many.
    fn line_up<const SOURCES: usize>(&mut self, rows: &mut Rows<SOURCES, PATHS>, gathered: usize) -> bool {
        self.features.clear();
        if gathered > FEATURES {
            return false;
        }
        for left in (1..=gathered).rev() {
            let Some((feature, row)) = rows.shortest_gathered(left) else { return false };
            row.stage = Stage::Listed;
            // Not more than there is room for: the push succeeds.
            let _ = self.features.push(feature);
        }
        true
    }

    /// Gives every contested measurement its seat; false where the states are too many.
    fn seat<const SOURCES: usize>(&mut self, rows: &Rows<SOURCES, PATHS>, limit: usize) -> bool {
        let mut seen = 0_u32;
        for (step, &feature) in self.features.iter().enumerate() {
            let Some(row) = rows.get(feature) else { return false };
            for m in members(row.gated) {
                let Some(seat) = self.seats.get_mut(m) else { return false };
                seat.bit = 0;
                seat.last = step;
                if seen & 1_u32.wrapping_shl(m as u32) == 0 {
                    seat.first = step;
                }
            }
            seen |= row.gated;
        }
        self.open.clear();
        let (mut open, mut all) = (0_u32, 0_u32);
        for (step, &feature) in self.features.iter().enumerate() {
            let Some(row) = rows.get(feature) else { return false };
            // Capacities are equal: every push succeeds.
            let _ = self.open.push(open);
            for m in members(row.gated) {
                if let Some(seat) = self.seats.get(m)
                    && seat.last == step
                {
                    open &= !seat.bit;
                }
            }
            for m in members(row.gated) {
                if let Some(seat) = self.seats.get_mut(m)
                    && seat.first == step
                    && seat.last > step
                {
                    seat.bit = !open & open.wrapping_add(1);
                    open |= seat.bit;
                }
            }
            all |= open;
        }
        // Seats are filled from below: the bits used are ones without gap.
        self.layers.length = (all as usize).saturating_add(1);
        self.layers.length.saturating_mul(self.features.len().saturating_add(2)) <= limit.min(STATES)
    }

    /// What the feature of a step can do.
    #[inline(never)]
    fn take_step<const SOURCES: usize>(&mut self, rows: &Rows<SOURCES, PATHS>, step: usize) -> Option<()> {
        let &feature = self.features.get(step)?;
        let row = rows.get(feature)?;
        let &open = self.open.get(step)?;
        let mut keep = open;
        let takings = &mut self.step.takings;
        takings.clear();
        for measurement in members(row.gated) {
            let (seat, &psi) = (self.seats.get(measurement)?, row.psi.get(measurement)?);
            let before = if seat.first == step { 0 } else { seat.bit };
            let after = if seat.last == step { 0 } else { seat.bit };
            if after == 0 {
                keep &= !before;
            }
            // Capacities are equal: every push succeeds.
            let _ = takings.push(Taking { measurement, psi, before, after });
        }
        // Each contested measurement is free in half of the states.
        self.work.add_each([STEP, TAKING], 1, ((2 + takings.len()) << open.count_ones()) / 2);
        (self.step.feature, self.step.absent) = (feature, row.absent);
        (self.step.open, self.step.keep) = (open, keep);
        Some(())
    }

    /// B_k(s) of all steps, as sums or, for the `best` path alone, as largest terms.
    #[inline(never)]
    fn backward<const SOURCES: usize>(&mut self, rows: &Rows<SOURCES, PATHS>, best: bool) {
        let steps = self.features.len();
        self.layers.set(steps + 1, 0, 1.0);
        for k in (0..steps).rev() {
            let Some(()) = self.take_step(rows, k) else { return };
            let Self { step, layers, .. } = self;
            let mut total = 1.0;
            for state in subsets(step.open) {
                let kept = state & step.keep;
                let mut value = step.absent * layers.value(k + 2, kept);
                for taking in step.takings.iter().filter(|taking| state & taking.before == 0) {
                    let term = taking.psi * layers.value(k + 2, kept | taking.after);
                    value = if best { larger(term, value) } else { value + term };
                }
                if state == 0 {
                    total = value;
                }
                layers.set(k + 1, state, value / total);
            }
            if let Some(kept) = self.totals.get_mut(k) {
                *kept = total;
            }
        }
    }

    /// A_k(s) of all steps and the marginals; false where these lost their digits.
    #[inline(never)]
    fn forward<const SOURCES: usize>(
        &mut self,
        rows: &Rows<SOURCES, PATHS>,
        beliefs: &mut Beliefs<SOURCES, PATHS>,
    ) -> bool {
        self.layers.set(0, 0, 1.0);
        for k in 0..self.features.len() {
            let Some(()) = self.take_step(rows, k) else { return false };
            let Self { step, layers, .. } = self;
            let Some(belief) = beliefs.get_mut(step.feature) else { return false };
            for state in subsets(self.open.get(k + 1).copied().unwrap_or(0)) {
                layers.set(k + 1, state, 0.0);
            }
            let total = self.totals.get(k).copied().unwrap_or(1.0);
            let mut missed = 0.0;
            for state in subsets(step.open) {
                let kept = state & step.keep;
                let reached = layers.value(k, state) / total;
                missed += layers.carry(k, kept, reached * step.absent);
                for taking in step.takings.iter().filter(|taking| state & taking.before == 0) {
                    let mass = layers.carry(k, kept | taking.after, reached * taking.psi);
                    if let Some(p) = belief.associated.get_mut(taking.measurement) {
                        *p += mass;
                    }
                }
            }
            let mut sum = missed;
            for taking in &step.takings {
                sum += belief.associated.get(taking.measurement).copied().unwrap_or(0.0);
            }
            // The divisions by the totals make it 1 but for rounding.
            if !(sum > 0.5 && sum < 2.0) {
                return false;
            }
            belief.missed = missed / sum;
            for taking in &step.takings {
                if let Some(p) = belief.associated.get_mut(taking.measurement) {
                    *p /= sum;
                }
            }
        }
        true
    }

    /// Writes the best path; of equals, the first.
    #[inline(never)]
    fn follow<const SOURCES: usize>(
        &mut self,
        rows: &Rows<SOURCES, PATHS>,
        beliefs: &mut Beliefs<SOURCES, PATHS>,
    ) {
        let mut state = 0;
        for k in 0..self.features.len() {
            let Some(()) = self.take_step(rows, k) else { return };
            let Self { step, layers, .. } = self;
            let kept = state & step.keep;
            let mut joint = Joint::Missed;
            let mut most = step.absent * layers.value(k + 2, kept);
            let mut next = kept;
            for taking in step.takings.iter().filter(|taking| state & taking.before == 0) {
                let after = kept | taking.after;
                let term = taking.psi * layers.value(k + 2, after);
                if term > most {
                    (joint, most, next) = (Joint::Measurement(taking.measurement), term, after);
                }
            }
            if let Some(belief) = beliefs.get_mut(step.feature) {
                belief.joint = joint;
            }
            state = next;
        }
    }
}

/// All subsets of the ones in `bits`, upwards.
fn subsets(bits: u32) -> impl Iterator<Item = u32> {
    core::iter::successors(Some(0), move |&subset: &u32| {
        // The next number once the bits that must stay zero are jumped over; after the last one comes zero.
        let next = subset.wrapping_sub(bits) & bits;
        (next != 0).then_some(next)
    })
}
