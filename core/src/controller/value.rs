//! Action values J: what each action is believed to be worth beyond the present one.
//!
//! What a cycle earns falls and rises with the posterior, for all actions alike. Values that kept the level of rewards
//! would compare an action planned today with one planned long ago. So J is kept relative to the present action, whose
//! value is near 0; softmax and choice, which see differences only, are the published ones.

use crate::radio::library::Allowed;
use crate::snapshot::{stored, written};

/// Learning parameters.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Learning {
    /// Learning rate alpha of planned rewards, 0 to 1: larger follows changes faster and averages less.
    pub rate: f32,
    /// Learning rate of experience, what the applied action has earned beyond what was planned, 0 to 1. Experience
    /// also knows what the models do not, but a single cycle's is noisy.
    pub experience_rate: f32,
    /// Discount gamma of later rewards, 0 to 1.
    pub discount: f32,
    /// Whether the bootstrap term gamma sum pi J enters. It is the same for all actions, so it cannot change
    /// their order but inflates those updated often; off by default.
    pub bootstrap: bool,
}

/// J over the library.
#[derive(Clone, Debug)]
pub struct ActionValues<const ACTIONS: usize> {
    values: [f32; ACTIONS],
}

impl<const ACTIONS: usize> Default for ActionValues<ACTIONS> {
    fn default() -> Self {
        Self { values: [0.0; ACTIONS] }
    }
}

impl<const ACTIONS: usize> ActionValues<ACTIONS> {
    /// The values.
    pub fn values(&self) -> &[f32; ACTIONS] {
        &self.values
    }

    /// Value of one action; 0 for an unknown one.
    pub fn get(&self, action: usize) -> f32 {
        self.values.get(action).copied().unwrap_or(0.0)
    }

    /// J(c) <- (1 - alpha) J(c) + alpha (r + gamma sum pi J), the sum only with the bootstrap.
    pub fn learn(&mut self, action: usize, reward: f32, policy: &[f32; ACTIONS], learning: &Learning) {
        let mut target = reward;
        if learning.bootstrap {
            let mut expected = 0.0;
            for (p, value) in policy.iter().zip(&self.values) {
                expected += p * value;
            }
            target += learning.discount * expected;
        }
        if let Some(value) = self.values.get_mut(action) {
            *value = (1.0 - learning.rate) * *value + learning.rate * target;
        }
    }

    /// J(c) <- J(c) + beta (earned - planned): experience with the applied action.
    pub fn correct(&mut self, action: usize, surprise_nat: f32, learning: &Learning) {
        if let Some(value) = self.values.get_mut(action) {
            *value += learning.experience_rate * surprise_nat;
        }
    }

    /// Makes the values of all actions allowed relative to one of them, whose own becomes 0.
    pub fn relate_to(&mut self, action: usize, allowed: &Allowed<ACTIONS>) {
        let reference = self.get(action);
        for (value, &allowed) in self.values.iter_mut().zip(allowed) {
            if allowed {
                *value -= reference;
            }
        }
    }

    /// The action of largest value among those allowed; the first of equals.
    pub fn best(&self, allowed: &Allowed<ACTIONS>) -> usize {
        let mut best = (0, f32::NEG_INFINITY);
        for ((action, &value), &allowed) in self.values.iter().enumerate().zip(allowed) {
            if allowed && value > best.1 {
                best = (action, value);
            }
        }
        best.0
    }
}

stored!(ActionValues<const ACTIONS> { values } told {});
written!(Learning { rate, experience_rate, discount, bootstrap });
