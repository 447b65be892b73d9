//! Outages: an anchor of which nothing but clutter is heard.

use super::real::{Real, exp, larger, ln};
use cogmint_core::perceptor::belief::BeliefSettings;

/// Probability of an outage, by anchor.
#[derive(Clone, Debug)]
pub struct Outages<T>(pub Vec<T>);

impl<T: Real> Outages<T> {
    /// The stationary ones.
    pub fn usual(anchors: usize, settings: &BeliefSettings) -> Self {
        Self(vec![stationary(settings); anchors])
    }

    /// That of an anchor `dt` seconds after it was last heard.
    pub fn predict(&mut self, anchor: usize, dt: T, settings: &BeliefSettings) -> T {
        let usual = stationary::<T>(settings);
        let rate = T::of(settings.outages_per_s) + T::of(settings.returns_per_s);
        self.0[anchor] = usual + (self.0[anchor] - usual) * exp(-rate * dt);
        self.0[anchor]
    }

    /// Mixes others in.
    pub fn merge(&mut self, other: &Self, share: T) {
        for (own, other) in self.0.iter_mut().zip(&other.0) {
            *own += share * (*other - *own);
        }
    }
}

fn stationary<T: Real>(settings: &BeliefSettings) -> T {
    let begins = T::of(settings.outages_per_s);
    begins / (begins + T::of(settings.returns_per_s))
}

/// ln of (1 - p) L + p, and what p becomes, for ln L.
pub fn weigh<T: Real>(outage: T, evidence_nat: T) -> (T, T) {
    // Order: both terms relative to the larger of 1 and L.
    let most = larger(evidence_nat, T::ZERO);
    let heard = (T::ONE - outage) * exp(evidence_nat - most);
    let out = outage * exp(-most);
    let sum = larger(heard + out, T::of(f32::MIN_POSITIVE));
    (most + ln(sum), out / sum)
}
