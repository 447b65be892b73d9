//! Clutter memory: how many measurements of each anchor nothing known explains.

use super::association::Clutter;
use super::below_threshold::Background;
use super::clock::gain;
use super::real::{Real, larger};
use cogmint_core::config::{AssociationSettings, Ranging};
use cogmint_core::memory::clutter::{FADING, WALK_PER_S};

/// The memory.
#[derive(Clone, Debug)]
pub struct ClutterMemory<T> {
    settings: AssociationSettings,
    per_m: T,
    /// Mean number of measurements per scan of unknown origin, by anchor.
    pub unexplained: Vec<T>,
    /// What is left of frames where nothing is expected, by anchor.
    pub backgrounds: Vec<Background<T>>,
}

impl<T: Real> ClutterMemory<T> {
    /// What is expected of so many anchors at the start.
    pub fn new(settings: AssociationSettings, ranging: &Ranging, anchors: usize) -> Self {
        let unexplained = T::of(settings.clutter_per_anchor) + T::of(settings.unmapped_per_anchor);
        Self {
            settings,
            per_m: T::ONE / T::of(ranging.max_range_m),
            unexplained: vec![unexplained; anchors],
            backgrounds: vec![Background::usual(); anchors],
        }
    }

    /// Intensities of what an anchor delivers of unknown origin: even, up to the longest range.
    pub fn clutter(&self, anchor: usize) -> Clutter<T> {
        Clutter {
            all_per_m: self.unexplained[anchor] * self.per_m,
            false_alarms_per_m: T::of(self.settings.clutter_per_anchor) * self.per_m,
        }
    }

    /// Enters the number of measurements of a scan that nothing known explains, `dt` seconds after the last.
    pub fn remember(&mut self, anchor: usize, unexplained: T, dt: T) {
        let before = self.unexplained[anchor];
        let mean = before + gain(WALK_PER_S, dt) * (unexplained - before);
        self.unexplained[anchor] = larger(mean, T::of(self.settings.clutter_per_anchor));
    }

    /// Enters what was left of a frame beside its sources, `dt` seconds after the last; some of the usual comes back.
    pub fn remember_background(&mut self, anchor: usize, background: &Background<T>, dt: T) {
        let gain = gain(WALK_PER_S, dt);
        let own = &mut self.backgrounds[anchor];
        own.mix(background, gain);
        own.mix(&Background::usual(), T::of(FADING) * gain);
    }
}
