//! Clutter memory: how many measurements of each anchor belong to nothing known, and how many paths others pull along.

use crate::model::clock::gain;
use crate::model::measurement::{Clutter, Ranging, USUAL_TAIL};
use crate::perceptor::association::AssociationSettings;
use crate::real::{larger, limited};

/// Tuned: forgetting in one scan: how fast the number changes, as the variance of its walk per second over that of one
/// count.
pub const WALK_PER_S: f32 = 0.026;

/// Guard: against certainty, from which no path would lead back: least and most share of paths with a tail.
pub const LEAST_TAIL: f32 = 0.01;
/// See [`LEAST_TAIL`].
pub const MOST_TAIL: f32 = 0.9;

/// Mean number of measurements per scan that belong to nothing known, by anchor.
#[derive(Clone, Debug)]
pub struct ClutterMemory<const ANCHORS: usize> {
    settings: AssociationSettings,
    per_m: f32,
    unexplained: [f32; ANCHORS],
    tail: [f32; ANCHORS],
}

impl<const ANCHORS: usize> ClutterMemory<ANCHORS> {
    /// What is expected at the start.
    pub fn new(settings: AssociationSettings, ranging: &Ranging) -> Self {
        let unexplained = settings.clutter_per_anchor + settings.unmapped_per_anchor;
        Self {
            settings,
            per_m: 1.0 / ranging.max_range_m,
            unexplained: [unexplained; ANCHORS],
            tail: [crate::real::tune(12, USUAL_TAIL); ANCHORS],
        }
    }

    /// Intensities of what an anchor delivers that belongs to nothing known.
    pub fn clutter(&self, anchor: usize) -> Clutter {
        Clutter {
            all_per_m: self.unexplained.get(anchor).copied().unwrap_or(0.0) * self.per_m,
            false_alarms_per_m: self.settings.clutter_per_anchor * self.per_m,
            tail: self.tail.get(anchor).copied().unwrap_or(USUAL_TAIL),
        }
    }

    /// Enters the expected number of measurements of a scan that belong to nothing known, and of the `paths` associated those
    /// that are of the tail, `elapsed_s` seconds after the last.
    pub fn observe(&mut self, anchor: usize, expected: f32, [paths, tailed]: [f32; 2], elapsed_s: f32) {
        let gain = gain(WALK_PER_S, elapsed_s);
        if let Some(tail) = self.tail.get_mut(anchor) {
            // The step of expectation maximisation that one scan is worth.
            let next = *tail + crate::real::tune(14, 1.0) * gain * (tailed - paths * *tail);
            *tail = limited(next, LEAST_TAIL, MOST_TAIL);
        }
        if let Some(unexplained) = self.unexplained.get_mut(anchor) {
            *unexplained =
                larger(*unexplained + gain * (expected - *unexplained), self.settings.clutter_per_anchor);
        }
    }

    /// Share of paths whose ranges have the tail, by anchor.
    pub fn tail(&self) -> &[f32; ANCHORS] {
        &self.tail
    }

    /// Mean number of measurements per scan that belong to nothing known, by anchor.
    pub fn unexplained(&self) -> &[f32; ANCHORS] {
        &self.unexplained
    }
}
