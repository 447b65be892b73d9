//! Rewards: what a cycle was worth.

use crate::information::entropy::{determinant, position_block, position_entropy_nat};
use crate::real::{abs, limited, ln};
use crate::snapshot::{Sink, Written};
use nalgebra::Matrix4;

/// Which reward the controller maximises.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Reward {
    /// h(n|n-1) - h(n|n) of the position, nats: the mutual information of measurement and position. Never
    /// negative for a hard association, attributable to the action alone.
    InformationGain,
    /// h(n-1|n-1) - h(n|n) of the position, nats, limited to +-3.
    EntropyChange,
    /// The published reward sign(D) |ln |D||, D = scale (det C(n-1|n-1) - det C(n|n)) of the agent block. It is
    /// not monotone: it grows as D -> 0 when |D| < 1, so `scale` should bring determinants far above 1 (1e24
    /// for metres to millimetres).
    Published {
        /// Factor on the determinants.
        scale: f32,
    },
}

/// Guard: against overflow of the values learnt: no reward is larger than this, either way. Beyond it covariances have left the range of sense.
const LARGEST: f32 = 100.0;

/// Reward of a cycle from the agent's covariance before prediction, after prediction and after the update; within
/// +-100.
pub fn reward(
    kind: Reward,
    previous: &Matrix4<f32>,
    predicted: &Matrix4<f32>,
    posterior: &Matrix4<f32>,
) -> f32 {
    let entropy = |c: &Matrix4<f32>| position_entropy_nat(&position_block(c));
    match kind {
        Reward::InformationGain => limited(entropy(predicted) - entropy(posterior), -LARGEST, LARGEST),
        Reward::EntropyChange => limited(entropy(previous) - entropy(posterior), -3.0, 3.0),
        Reward::Published { scale } => {
            let change = limited(scale * (determinant(previous) - determinant(posterior)), -1e37, 1e37);
            if abs(change) < 1e-37 {
                0.0
            } else if change > 0.0 {
                abs(ln(change))
            } else {
                -abs(ln(-change))
            }
        }
    }
}

impl Written for Reward {
    fn write(&self, to: &mut impl Sink) {
        let (kind, scale): (u8, f32) = match self {
            Self::InformationGain => (0, 0.0),
            Self::EntropyChange => (1, 0.0),
            Self::Published { scale } => (2, *scale),
        };
        (kind, scale).write(to);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_gain_of_halving_both_deviations_is_two_ln_two() {
        let c = Matrix4::from_diagonal_element(0.04_f32);
        let half = c * 0.25;
        assert!((reward(Reward::InformationGain, &c, &c, &half) - 4.0_f32.ln()).abs() < 1e-5);
        assert!((reward(Reward::EntropyChange, &c, &c, &half) - 4.0_f32.ln()).abs() < 1e-5);
    }

    #[test]
    fn the_published_reward_prefers_the_smaller_gain_in_metres() {
        let c = Matrix4::from_diagonal_element(1e-3_f32);
        let published = |ratio: f32| reward(Reward::Published { scale: 1.0 }, &c, &c, &(c * ratio));
        assert!(published(0.99) > published(0.5));
    }
}
