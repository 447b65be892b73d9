//! The soft rank-one update: what the candidates for one range do to a Gaussian state.
//!
//! With the candidates' association probabilities beta_m and innovations nu_m, total probability beta, first and second
//! moment n1 and n2, innovation variance S and w = C h: x <- x + w n1 / S, C <- C + (spread / S^2 - beta / S) w w' with
//! spread = n2 - n1^2 (probabilistic data association, Bar-Shalom).

use crate::real::{larger, smaller};

/// Guard: against covariances that f32 no longer holds positive definite: most that one update may shrink a variance, 2^-10.
pub const LARGEST_SHRINK: f32 = 1.0 / 1024.0;
/// Guard: against the division by it: total probability below which an association moves nothing.
pub const LEAST_WEIGHT: f32 = 1e-3;

/// The measurements associated with one source, summed up.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Moments {
    /// Sum of beta_m: 1 for a hard association.
    pub weight: f32,
    /// Sum of beta_m nu_m, metres.
    pub first_m: f32,
    /// Sum of beta_m nu_m^2, square metres.
    pub second_m2: f32,
}

/// The change of a state along w.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SoftUpdate {
    /// x <- x + w mean.
    pub mean: f32,
    /// C <- C + covariance w w'.
    pub covariance: f32,
}

impl SoftUpdate {
    /// From the moments of the innovations and their variance, of which the state explains h' C h (square metres).
    pub fn new(moments: &Moments, variance_m2: f32, explained_m2: f32) -> Self {
        let inverse = 1.0 / larger(variance_m2, explained_m2 * (1.0 + LARGEST_SHRINK));
        let first = moments.first_m;
        let spread = larger(moments.second_m2 - first * first, 0.0);
        // A soft association widens by the spread of its candidates, at most as much as the state knew before.
        let covariance = smaller((spread * inverse - moments.weight) * inverse, inverse);
        Self { mean: first * inverse, covariance }
    }
}
