//! Clutter memory: how many measurements of each anchor belong to nothing known.

use crate::model::clock::gain;
use crate::model::measurement::Clutter;
use crate::model::measurement::Ranging;
use crate::perceptor::association::AssociationSettings;
use crate::real::larger;

/// Tuned: forgetting in one scan: how fast the number changes, as the variance of its walk per second over that of one
/// count.
pub const WALK_PER_S: f32 = 0.026;

/// Mean number of measurements per scan that belong to nothing known, by anchor.
#[derive(Clone, Debug)]
pub struct ClutterMemory<const ANCHORS: usize> {
    settings: AssociationSettings,
    per_m: f32,
    unexplained: [f32; ANCHORS],
    recent: [[(f32, f32); 24]; ANCHORS],
}

impl<const ANCHORS: usize> ClutterMemory<ANCHORS> {
    /// What is expected at the start.
    pub fn new(settings: AssociationSettings, ranging: &Ranging) -> Self {
        let unexplained = settings.clutter_per_anchor + settings.unmapped_per_anchor;
        Self { settings, per_m: 1.0 / ranging.max_range_m, unexplained: [unexplained; ANCHORS], recent: [[(0.0, 0.0); 24]; ANCHORS] }
    }

    /// Intensities of what an anchor delivers that belongs to nothing known.
    pub fn clutter(&self, anchor: usize) -> Clutter {
        Clutter {
            all_per_m: self.unexplained.get(anchor).copied().unwrap_or(0.0) * self.per_m,
            false_alarms_per_m: self.settings.clutter_per_anchor * self.per_m,
            tail_m2: 0.0,
        }
    }

    /// Enters the expected number of measurements of a scan that belong to nothing known, `elapsed_s` seconds after the last.
    pub fn observe(&mut self, anchor: usize, expected: f32, elapsed_s: f32) {
        let gain = gain(WALK_PER_S, elapsed_s);
        if let Some(unexplained) = self.unexplained.get_mut(anchor) {
            *unexplained =
                larger(*unexplained + gain * (expected - *unexplained), self.settings.clutter_per_anchor);
        }
    }

    /// Density of what was there before, over the usual.
    pub fn persistent<const PATHS: usize>(&self, scan: &crate::perceptor::scan::Scan<PATHS>) -> [f32; PATHS] {
        use crate::knob::knob;
        let mut persistent = [0.0; PATHS];
        if knob(1) == 0.0 { return persistent; }
        let std = larger(0.08, 0.3 * scan.resolution_m());
        let all = self.clutter(scan.anchor).all_per_m;
        let Some(recent) = self.recent.get(scan.anchor) else { return persistent };
        for (m, p) in scan.measurements.iter().zip(&mut persistent) {
            let v = std * std + m.variance_m2;
            let mut sum = 0.0;
            for &(z, w) in recent {
                let d = m.range_m - z;
                if w > 0.0 { sum += w * crate::real::exp(-0.5 * (d * d / v)) / crate::real::sqrt(crate::real::TAU * v); }
            }
            *p = knob(1) * sum / all;
        }
        persistent
    }

    /// Keeps a scan.
    pub fn keep<const PATHS: usize>(&mut self, scan: &crate::perceptor::scan::Scan<PATHS>, _free: &[f32; PATHS]) {
        let Some(recent) = self.recent.get_mut(scan.anchor) else { return };
        *recent = [(0.0, 0.0); 24];
        for (m, slot) in scan.measurements.iter().zip(recent) {
            *slot = (m.range_m, if m.false_alarm > 0.6 { 0.3 } else { 1.0 });
        }
    }

    /// Mean number of measurements per scan that belong to nothing known, by anchor.
    pub fn unexplained(&self) -> &[f32; ANCHORS] {
        &self.unexplained
    }
}
