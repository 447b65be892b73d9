//! Outage: that what is heard of an anchor has nothing to do with the tag.
//!
//! An anchor that is switched off, jammed or behind a door gives frames of clutter. Every hypothesis of where the tag is has one of
//! its own for each anchor, a chain of two states: outages begin and end by chance, at rates per second, and every scan tells of
//! them ([`crate::perceptor::association::outage`]).

use super::BeliefSettings;
use crate::real::{exp, is_probability};
use crate::snapshot::{Blank, Reader, Sink, SnapshotError, Stored, Written};

/// Probability of an outage, by anchor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outages<const ANCHORS: usize>([f32; ANCHORS]);

impl<const ANCHORS: usize> Outages<ANCHORS> {
    /// None.
    pub(super) const NONE: Self = Self([0.0; ANCHORS]);

    /// As they are in the long run.
    pub fn usual(settings: &BeliefSettings) -> Self {
        Self([usual(settings); ANCHORS])
    }

    /// Probability of an outage of an anchor.
    pub fn of(&self, anchor: usize) -> f32 {
        self.0.get(anchor).copied().unwrap_or(0.0)
    }

    /// Lets the outages of an anchor begin and end for so many seconds, and returns its probability.
    pub fn predict(&mut self, anchor: usize, elapsed_s: f32, settings: &BeliefSettings) -> f32 {
        let Some(own) = self.0.get_mut(anchor) else { return 0.0 };
        let usual = usual(settings);
        *own = usual + (*own - usual) * exp(-(settings.outages_per_s + settings.returns_per_s) * elapsed_s);
        *own
    }

    /// Enters the probability that a scan left.
    pub fn set(&mut self, anchor: usize, probability: f32) {
        if let Some(own) = self.0.get_mut(anchor) {
            *own = probability;
        }
    }

    /// Whether they are probabilities.
    pub(super) fn is_sound(&self) -> bool {
        self.0.into_iter().all(is_probability)
    }

    /// Mixes others in, with this share.
    pub(super) fn merge(&mut self, other: &Self, share: f32) {
        for (own, other) in self.0.iter_mut().zip(&other.0) {
            *own += share * (*other - *own);
        }
    }

    /// Every number, in the order of the anchors, for traces.
    pub(super) fn visit(&self, f: impl FnMut(f32)) {
        self.0.into_iter().for_each(f);
    }
}

/// Share of the time that an anchor is out.
fn usual(settings: &BeliefSettings) -> f32 {
    settings.outages_per_s / (settings.outages_per_s + settings.returns_per_s)
}

impl<const ANCHORS: usize> Written for Outages<ANCHORS> {
    fn write(&self, to: &mut impl Sink) {
        self.0.write(to);
    }
}

impl<const ANCHORS: usize> Stored for Outages<ANCHORS> {
    fn read(&mut self, from: &mut Reader<'_>) -> Result<(), SnapshotError> {
        self.0.read(from)
    }
}

impl<const ANCHORS: usize> Blank for Outages<ANCHORS> {
    fn blank() -> Self {
        Self([0.0; ANCHORS])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outages_begin_and_end_by_chance() {
        let settings = BeliefSettings { outages_per_s: 0.4, returns_per_s: 3.0, ..BeliefSettings::default() };
        for begin in [0.0_f32, 0.3, 1.0] {
            let mut outages = Outages::<2>::usual(&settings);
            outages.set(1, begin);
            // The two rates, in small steps.
            let mut exact = f64::from(begin);
            for _ in 0..250_000 {
                exact += 1e-6 * (0.4 * (1.0 - exact) - 3.0 * exact);
            }
            // At once, and in steps.
            let mut stepped = outages;
            assert!((f64::from(outages.predict(1, 0.25, &settings)) - exact).abs() < 1e-5);
            (0..5).for_each(|_| _ = stepped.predict(1, 0.05, &settings));
            assert!((f64::from(stepped.of(1)) - exact).abs() < 1e-5);
            // The other anchor has its own, which stay as usual.
            assert!((outages.predict(0, 7.0, &settings) - 0.4 / 3.4).abs() < 1e-6);
            assert_eq!((outages.predict(2, 1.0, &settings), outages.of(2)), (0.0, 0.0));
        }
    }
}
