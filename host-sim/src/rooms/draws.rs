//! Draws from one stream, in the terms that a room is described in.

use crate::channel::random::{Purpose, normal, stream, uniform};
use rand_xoshiro::Xoshiro128PlusPlus;

/// What a stream of a room is for: every aspect has a stream of its own, so that restricting one leaves the others as
/// they are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Aspect {
    Family,
    Layout,
    Constructions,
    Tag,
    Anchors,
    Biases,
    Radio,
    Rate,
    Way,
    Levels,
    Plan,
    WrongPlan,
    Start,
    Interference,
    Interferers,
    People,
    Obstructions,
    Losses,
    Receiver,
    Incident,
}

/// A stream of draws.
#[derive(Clone, Debug)]
pub(super) struct Draws(Xoshiro128PlusPlus);

impl Draws {
    pub(super) fn new(seed: u64, aspect: Aspect) -> Self {
        Self(stream(seed, Purpose::Room, &[aspect as usize]))
    }

    /// Uniform between two bounds.
    pub(super) fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * uniform(&mut self.0)
    }

    /// A length between two bounds, in whole centimetres.
    pub(super) fn length_m(&mut self, low: f64, high: f64) -> f64 {
        centimetres(self.uniform(low, high))
    }

    /// The logarithm is uniform between those of two bounds.
    pub(super) fn log_uniform(&mut self, low: f64, high: f64) -> f64 {
        low * libm::exp(self.uniform(0.0, libm::log(high / low)))
    }

    pub(super) fn normal(&mut self, std: f64) -> f64 {
        std * normal(&mut self.0)
    }

    /// A whole number from `low` to `high`, both included.
    pub(super) fn count(&mut self, low: usize, high: usize) -> usize {
        low + self.below(high - low + 1)
    }

    /// A whole number below `count`, which is above 0.
    pub(super) fn below(&mut self, count: usize) -> usize {
        ((uniform(&mut self.0) * count as f64) as usize).min(count - 1)
    }

    pub(super) fn chance(&mut self, probability: f64) -> bool {
        uniform(&mut self.0) < probability
    }

    /// One of the values, all as likely.
    pub(super) fn one_of<T: Copy>(&mut self, values: &[T]) -> T {
        values[self.below(values.len())]
    }

    /// One of the values by weight; the weights need not add up to 1.
    pub(super) fn weighted<T: Copy>(&mut self, values: &[(T, f64)]) -> T {
        let total: f64 = values.iter().map(|(_, weight)| weight).sum();
        let mut left = self.uniform(0.0, total);
        for &(value, weight) in values {
            left -= weight;
            if left < 0.0 {
                return value;
            }
        }
        values[values.len() - 1].0
    }
}

/// Rounded to whole centimetres, so that a scenario file stays readable.
pub(super) fn centimetres(length_m: f64) -> f64 {
    libm::round(100.0 * length_m) / 100.0
}

/// Rounded to `digits` digits after the point.
pub(super) fn rounded(value: f64, digits: i32) -> f64 {
    let scale = libm::exp10(f64::from(digits));
    libm::round(scale * value) / scale
}
