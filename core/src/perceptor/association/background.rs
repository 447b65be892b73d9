//! Background: what belongs to no known feature, at each measurement of a scan.
//!
//! False alarms of the measurement's strength come at any range; paths that are not in the map only after the direct path. So
//! with lambda the usual density of both and lambda_fa that of false alarms, where the direct path is expected at d,
//!
//! lambda_m = lambda_fa f_m + (lambda - lambda_fa) p(z_m > d) + lambda (c_m - 1),
//!
//! f_m being the density of false alarms so strong over that of all, and c_m what candidates for virtual anchors claim.

use crate::model::detection::LOGISTIC;
use crate::model::measurement::{Clutter, Measurement};
use crate::perceptor::expectation::Expectation;
use crate::real::{exp, limited, ln, sqrt};
use heapless::Vec;

/// Guard: against overflow: exponents go no further.
pub const LARGEST_EXPONENT: f32 = 40.0;

/// What belongs to no known feature.
#[derive(Clone, Debug)]
pub struct Background<const PATHS: usize> {
    /// lambda: per metre.
    usual_per_m: f32,
    /// lambda_m: per metre, by measurement.
    per_m: [f32; PATHS],
}

impl<const PATHS: usize> Background<PATHS> {
    /// Of these measurements, where the direct path is expected so; `claims` says, per measurement, how much more probable
    /// something that is not in the map makes it than clutter would (1: nothing).
    pub fn new(
        measurements: &Vec<Measurement, PATHS>,
        direct: &Expectation,
        clutter: &Clutter,
        claims: &[f32; PATHS],
    ) -> Self {
        let Clutter { all_per_m, false_alarms_per_m } = *clutter;
        let mut per_m = [all_per_m; PATHS];
        for ((density, measurement), claim) in per_m.iter_mut().zip(measurements).zip(claims) {
            let deviation = sqrt(direct.variance_m2 + measurement.variance_m2);
            let earlier = LOGISTIC * ((direct.range_m - measurement.range_m) / deviation);
            let later = 1.0 / (1.0 + exp(limited(earlier, -LARGEST_EXPONENT, LARGEST_EXPONENT)));
            *density = false_alarms_per_m * measurement.false_alarm
                + (all_per_m - false_alarms_per_m) * later
                + all_per_m * (claim - 1.0);
        }
        Self { usual_per_m: all_per_m, per_m }
    }

    /// The density at each measurement, per metre.
    pub fn per_m(&self) -> &[f32; PATHS] {
        &self.per_m
    }

    /// Evidence of so many measurements, nats, were none of a known feature: over that of the usual density.
    pub fn evidence_nat(&self, measurements: usize) -> f32 {
        self.per_m.iter().take(measurements).fold(0.0, |sum, per_m| sum + ln(per_m / self.usual_per_m))
    }
}
