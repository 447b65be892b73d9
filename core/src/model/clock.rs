//! Time in memories: how much of a value is left, and how far it follows what is observed, by the seconds that passed.

use crate::real::{expm1, limited, sqrt};

/// Probability (0 to 1) that something that happens at this rate happens within `elapsed_s` seconds: 1 - exp(-rate dt).
pub fn probability(rate_per_s: f32, elapsed_s: f32) -> f32 {
    limited(-expm1(-(rate_per_s * elapsed_s)), 0.0, 1.0)
}

/// Gain (0 to 1) by which a level follows an observation `elapsed_s` seconds after the last: that of the Kalman filter of a
/// random walk in its steady state. `walk_per_s` is the variance by which the level walks in a second, over the variance of an
/// observation. With s = walk dt, K^2 = s (1 - K).
pub fn gain(walk_per_s: f32, elapsed_s: f32) -> f32 {
    let s = walk_per_s * elapsed_s;
    // 2 / (1 + sqrt(1 + 4 / s)) in a form that is right at 0 as well.
    let root = sqrt(s * s + 4.0 * s);
    limited(2.0 * s / (s + root + f32::MIN_POSITIVE), 0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_gain_is_that_of_the_riccati_recursion() {
        for (walk_per_s, elapsed_s) in [(0.5_f32, 0.1_f32), (0.02, 0.01), (3.0, 10.0), (0.1, 1.0)] {
            let (mut variance, mut kalman) = (1.0_f64, 0.0);
            for _ in 0..10_000 {
                let predicted = variance + f64::from(walk_per_s) * f64::from(elapsed_s);
                kalman = predicted / (predicted + 1.0);
                variance = (1.0 - kalman) * predicted;
            }
            let gain = f64::from(gain(walk_per_s, elapsed_s));
            assert!((gain - kalman).abs() < 1e-5, "{walk_per_s} {elapsed_s}: {gain} {kalman}");
        }
        assert_eq!(gain(1.0, 0.0), 0.0);
    }

    #[test]
    fn probabilities_of_parts_of_a_time_make_that_of_the_whole() {
        let part = probability(0.3, 0.5);
        assert!((1.0 - (1.0 - part) * (1.0 - part) - probability(0.3, 1.0)).abs() < 1e-6);
    }
}
