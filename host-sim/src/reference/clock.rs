//! Time in memories: how far they follow in the seconds that passed.

use super::real::{Real, exp_m1, limited, sqrt, square};

/// 1 - exp(-rate dt): that something happens in `dt` seconds.
pub fn probability<T: Real>(rate_per_s: f32, dt: T) -> T {
    limited(-exp_m1(-(T::of(rate_per_s) * dt)), T::ZERO, T::ONE)
}

/// Gain K of the Kalman filter of a random walk in its steady state, K^2 = s (1 - K), s the walk's variance in `dt` seconds over
/// that of an observation: 2 s / (s + sqrt(s^2 + 4 s)).
pub fn gain<T: Real>(walk_per_s: f32, dt: T) -> T {
    let num = T::of;
    let s = num(walk_per_s) * dt;
    let root = sqrt(square(s) + num(4.0) * s);
    limited(num(2.0) * s / (s + root + num(f32::MIN_POSITIVE)), T::ZERO, T::ONE)
}
