//! Clutter memory: how many measurements of each anchor belong to nothing known, and what is left of its frames where no source
//! is expected.

use crate::model::clock::gain;
use crate::model::measurement::Clutter;
use crate::model::measurement::Ranging;
use crate::perceptor::association::AssociationSettings;
use crate::perceptor::below_threshold::strength::Background;
use crate::real::larger;
use crate::snapshot::stored;

/// Tuned: how fast surroundings change, as the variance of the walk per second over that of one scan: 5 % at 10 Hz. So does the
/// number of measurements, and the usual noise of a place where it falls.
pub const WALK_PER_S: f32 = 0.026;

/// Guard: against shares of nothing, which no observation would raise: what comes back of the usual background, of what is observed.
pub const FADING: f32 = 0.02;

/// Mean number of measurements per scan that belong to nothing known, and what residuals are made of, by anchor.
#[derive(Clone, Debug)]
pub struct ClutterMemory<const ANCHORS: usize> {
    settings: AssociationSettings,
    per_m: f32,
    unexplained: [f32; ANCHORS],
    backgrounds: [Background; ANCHORS],
}

impl<const ANCHORS: usize> ClutterMemory<ANCHORS> {
    /// Nothing is expected: to be started.
    pub const fn empty() -> Self {
        Self {
            settings: AssociationSettings::NONE,
            per_m: 0.0,
            unexplained: [0.0; ANCHORS],
            backgrounds: [Background::NONE; ANCHORS],
        }
    }

    /// What is expected at the start.
    pub fn start(&mut self, settings: AssociationSettings, ranging: &Ranging) {
        self.settings = settings;
        self.per_m = 1.0 / ranging.max_range_m;
        self.unexplained = [settings.clutter_per_anchor + settings.unmapped_per_anchor; ANCHORS];
        self.backgrounds = [Background::USUAL; ANCHORS];
    }

    /// Intensities of what an anchor delivers that belongs to nothing known.
    pub fn clutter(&self, anchor: usize) -> Clutter {
        Clutter {
            all_per_m: self.unexplained.get(anchor).copied().unwrap_or(0.0) * self.per_m,
            false_alarms_per_m: self.settings.clutter_per_anchor * self.per_m,
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

    /// What is left of an anchor's frames where no source is expected.
    pub fn background(&self, anchor: usize) -> &Background {
        self.backgrounds.get(anchor).unwrap_or(&Background::USUAL)
    }

    /// Enters what was left of a frame, `elapsed_s` seconds after the last.
    pub fn observe_background(&mut self, anchor: usize, background: &Background, elapsed_s: f32) {
        if let Some(own) = self.backgrounds.get_mut(anchor) {
            let gain = gain(WALK_PER_S, elapsed_s);
            own.mix(background, gain);
            own.mix(&Background::USUAL, FADING * gain);
        }
    }

    /// All backgrounds, by anchor.
    pub fn backgrounds(&self) -> &[Background; ANCHORS] {
        &self.backgrounds
    }

    /// Whether finite numbers are what they may be.
    pub(crate) fn is_sound(&self) -> bool {
        self.unexplained.iter().all(|unexplained| *unexplained >= 0.0)
    }

    /// Mean number of measurements per scan that belong to nothing known, by anchor.
    pub fn unexplained(&self) -> &[f32; ANCHORS] {
        &self.unexplained
    }
}

stored!(ClutterMemory<const ANCHORS> { unexplained, backgrounds } told { settings, per_m });
