//! The soft rank-one update: what the candidates for one range do to a Gaussian.
//!
//! With beta_m the probability that measurement m is the feature's, nu_m its innovation, S the innovation's variance and
//! w = C h: x <- x + w n_1 / S, C <- C + (spread / S^2 - beta / S) w w', beta, n_1 and n_2 being the sums of beta_m, beta_m nu_m
//! and beta_m nu_m^2, and spread = n_2 - n_1^2. A hard association has beta = 1 and no spread: the Kalman filter.

use super::real::{Real, larger, smaller, square};
use cogmint_core::model::soft_update::LARGEST_SHRINK;

/// The innovations associated with one feature.
#[derive(Clone, Copy, Debug)]
pub struct Moments<T> {
    /// Sum of the probabilities.
    pub weight: T,
    /// Sum of probability times innovation, metres.
    pub first_m: T,
    /// Sum of probability times squared innovation, square metres.
    pub second_m2: T,
}

impl<T: Real> Moments<T> {
    /// Of nothing.
    pub fn none() -> Self {
        Self { weight: T::ZERO, first_m: T::ZERO, second_m2: T::ZERO }
    }

    /// Adds an innovation of probability `p`.
    pub fn add(&mut self, p: T, innovation_m: T) {
        self.weight += p;
        self.first_m += p * innovation_m;
        self.second_m2 += p * square(innovation_m);
    }

    /// Adds an innovation of probability `p` of which the mean and that of its square are known.
    pub fn add_moments(&mut self, p: T, first_m: T, second_m2: T) {
        self.weight += p;
        self.first_m += p * first_m;
        self.second_m2 += p * second_m2;
    }

    /// All probabilities over `total`.
    pub fn over(&self, total: T) -> Self {
        Self { weight: self.weight / total, first_m: self.first_m / total, second_m2: self.second_m2 / total }
    }

    /// Of the innovations less `shift`.
    pub fn shifted(&self, shift: T) -> Self {
        let Self { weight, first_m, second_m2 } = *self;
        Self {
            weight,
            first_m: first_m - weight * shift,
            second_m2: second_m2 - T::of(2.0) * (shift * first_m) + weight * square(shift),
        }
    }
}

/// x <- x + w mean, C <- C + covariance w w'.
#[derive(Clone, Copy, Debug)]
pub struct SoftUpdate<T> {
    /// Factor of w in the mean.
    pub mean: T,
    /// Factor of w w' in the covariance.
    pub covariance: T,
}

impl<T: Real> SoftUpdate<T> {
    /// By innovations of variance S, `explained` = h' C h of it the state's.
    pub fn new(innovations: &Moments<T>, variance: T, explained: T) -> Self {
        let inverse = T::ONE / larger(variance, explained * (T::ONE + T::of(LARGEST_SHRINK)));
        let spread = larger(innovations.second_m2 - square(innovations.first_m), T::ZERO);
        // Wider by the spread of the candidates, at most by as much as the state knew.
        let covariance = smaller((spread * inverse - innovations.weight) * inverse, inverse);
        Self { mean: innovations.first_m * inverse, covariance }
    }
}
