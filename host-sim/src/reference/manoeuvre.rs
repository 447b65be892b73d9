//! Manoeuvres: whether the tag moves as the motion prior has it.
//!
//! Where less than 0.7 of the direct paths that are likely seen lie within two deviations of a measurement, the motion as configured
//! competes with one of ten times the acceleration. The log-likelihood of a scan is - sum_k ln p(b_k = 0) up to what both
//! have in common; the manoeuvre must gain 4 nats.

use super::association::Beliefs;
use super::real::{Real, larger, ln};

/// A manoeuvre's acceleration over the configured one.
pub const ACCELERATION_FACTOR: f32 = 10.0;
const COST_NAT: f32 = 4.0;
const LIKELY: f32 = 0.5;
const NEAR: f32 = 4.0;
const ENOUGH: f32 = 0.7;
const SUREST: f32 = 1e-6;

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

/// What beliefs have against their prediction, nats.
pub fn surprise_nat<T: Real>(beliefs: &Beliefs<T>) -> T {
    let mut surprise = T::ZERO;
    for belief in &beliefs.features {
        surprise += ln(larger(belief.missed, T::of(SUREST)));
    }
    surprise
}

/// Whether the manoeuvre wins.
pub fn is_manoeuvre<T: Real>(motion_nat: T, manoeuvre_nat: T) -> bool {
    motion_nat - manoeuvre_nat > T::of(COST_NAT)
}
