//! Manoeuvres: whether the tag moves as the motion prior has it.
//!
//! Where less than 0.7 of the direct paths that are likely seen lie within two deviations of a measurement, the motion as
//! configured competes with one in which the velocity was drawn anew once: the evidence for the place it predicts must be larger
//! by the odds ln((1 - p) / p), p the probability of a turn in that time.

use super::clock::probability;
use super::real::{Real, larger, ln};
use cogmint_core::perceptor::belief::manoeuvre::{ENOUGH, LIKELY, NEAR};

/// Whether the prediction is to be doubted: per direct path its detection probability, and the smallest normalised innovation
/// squared of any measurement, where there is one.
pub fn is_doubtful<T: Real>(paths: &[(T, Option<T>)]) -> bool {
    let (mut expected, mut near) = (T::ZERO, T::ZERO);
    for (detection, nearest) in paths {
        if *detection > T::of(LIKELY) {
            expected += *detection;
            if nearest.is_some_and(|nis| nis < T::of(NEAR)) {
                near += *detection;
            }
        }
    }
    near < T::of(ENOUGH) * expected
}

/// Whether the manoeuvre wins, after `dt` seconds.
pub fn is_manoeuvre<T: Real>(motion_nat: T, manoeuvre_nat: T, turns_per_s: f32, dt: T) -> bool {
    let turned = probability(turns_per_s, dt);
    manoeuvre_nat - motion_nat > ln((T::ONE - turned) / larger(turned, T::of(1e-9)))
}
