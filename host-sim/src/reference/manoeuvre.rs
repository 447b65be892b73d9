//! Manoeuvres: whether the tag moves as the motion prior has it.
//!
//! Where less than 0.7 of the direct paths that are likely seen lie within two deviations of a measurement, the motion as configured
//! competes with one of ten times the acceleration: the evidence for the place it predicts must be larger by 4 nats.

use super::real::Real;

/// A manoeuvre's acceleration over the configured one.
pub const ACCELERATION_FACTOR: f32 = 10.0;
const COST_NAT: f32 = 4.0;
const LIKELY: f32 = 0.5;
const NEAR: f32 = 4.0;
const ENOUGH: f32 = 0.7;

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

/// Whether the manoeuvre wins.
pub fn is_manoeuvre<T: Real>(motion_nat: T, manoeuvre_nat: T) -> bool {
    manoeuvre_nat - motion_nat > T::of(COST_NAT)
}
