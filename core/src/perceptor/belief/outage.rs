//! Outage: that what is heard of an anchor has nothing to do with the tag.
//!
//! An anchor that is switched off, jammed or behind a door gives frames of clutter. Every hypothesis of where the tag is has one of
//! its own for each anchor: with the probability of an outage the misses cost nothing and the measurements move nothing. Of the
//! likelihood ratio L of a scan to clutter,
//!
//! den = (1 - p) L + p, p <- p / den,
//!
//! and den is the evidence. Outages begin and end by chance, at rates per second.

use super::BeliefSettings;
use crate::real::{exp, larger, ln};

/// Probability of an outage, by anchor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outages<const ANCHORS: usize>([f32; ANCHORS]);

impl<const ANCHORS: usize> Outages<ANCHORS> {
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

/// What is left of the evidence of a scan (nats) where there may be an outage, and the probability of it afterwards.
pub fn weigh(outage: f32, evidence_nat: f32) -> (f32, f32) {
    // Relative to the more probable of both.
    let most = larger(evidence_nat, 0.0);
    let (heard, out) = ((1.0 - outage) * exp(evidence_nat - most), outage * exp(-most));
    (most + ln(larger(heard + out, f32::MIN_POSITIVE)), out / larger(heard + out, f32::MIN_POSITIVE))
}
