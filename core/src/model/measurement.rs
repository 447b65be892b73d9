//! Measurements of one anchor, and what they may be if they belong to nothing known.

use crate::real::{TAU, exp, larger, sqrt};

/// What a range is worth.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Ranging {
    /// Factor on every measurement variance (1 to 100). Above 1, the filter forgives errors that the bound does
    /// not know of; 2.25 is common.
    pub variance_inflation: f32,
    /// Standard deviation that no range goes below, metres (1e-3 to 10): calibration, wall delays.
    pub floor_m: f32,
    /// Mean of the range bias expected of every anchor, metres (-10 to 10).
    pub bias_mean_m: f32,
    /// Its standard deviation, metres (0 to 10). Above 0, one bias per anchor is estimated.
    pub bias_std_m: f32,
    /// Ranges beyond this are refused, metres (1 to 1e4).
    pub max_range_m: f32,
}

impl Ranging {
    /// The variance the filter works with: inflated, and never below the floor.
    pub(crate) fn measurement_variance_m2(&self, variance_m2: f32) -> f32 {
        self.variance_inflation * variance_m2 + self.floor_m * self.floor_m
    }
}

/// A measurement as association and filter see it.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Measurement {
    /// Distance, metres.
    pub range_m: f32,
    /// Variance, square metres.
    pub variance_m2: f32,
    /// Variance that a share [`TAIL_SHARE`] of measurements has on top, square metres; 0 where there are no such.
    pub tail_m2: f32,
    /// Component SINR where the measurement is an estimated path; 0 where nothing is known of it.
    pub sinr: f32,
    /// Energy of the path, in squared units of the samples or in the frame's white noise; 0 where nothing is known of it.
    pub energy: f32,
    /// Density of false alarms of its strength over that of all false alarms, 0 to 1; 1 where nothing is known of it.
    pub false_alarm: f32,
}

/// Tuned: share of estimated paths that another one, which nobody knows of, pulls along.
pub const TAIL_SHARE: f32 = 0.25;
/// Tuned: standard deviation of how far it does, pulse lengths.
pub const TAIL_PULSES: f32 = 0.2;

/// How probable an innovation is, and what it weighs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Likelihood {
    /// Density, per metre.
    pub per_m: f32,
    /// Mean of the inverse of the innovation's variance, 1/m^2.
    pub precision: f32,
    /// Mean of its square, 1/m^4.
    pub squared_precision: f32,
}

impl Measurement {
    /// Likelihood of this measurement where `innovation_m` of it is not what was expected with variance `expected_m2`: a
    /// mixture of two normal distributions; `None` beyond `gate` deviations of the wider one.
    pub fn likelihood(&self, innovation_m: f32, expected_m2: f32, gate: f32) -> Option<Likelihood> {
        let squared = innovation_m * innovation_m;
        let narrow_m2 = expected_m2 + self.variance_m2;
        if self.tail_m2 <= 0.0 {
            if squared >= gate * gate * narrow_m2 {
                return None;
            }
            let precision = 1.0 / narrow_m2;
            let per_m = exp(-0.5 * (squared * precision)) / sqrt(TAU * narrow_m2);
            return Some(Likelihood { per_m, precision, squared_precision: precision * precision });
        }
        let wide_m2 = narrow_m2 + self.tail_m2;
        if squared >= gate * gate * wide_m2 {
            return None;
        }
        let (a, b) = (1.0 / narrow_m2, 1.0 / wide_m2);
        let t = crate::real::tune(12, TAIL_SHARE);
        let narrow = (1.0 - t) * (exp(-0.5 * (squared * a)) / sqrt(TAU * narrow_m2));
        let wide = t * (exp(-0.5 * (squared * b)) / sqrt(TAU * wide_m2));
        let per_m = narrow + wide;
        let inverse = 1.0 / larger(per_m, f32::MIN_POSITIVE);
        let (narrow, wide) = (narrow * inverse, wide * inverse);
        Some(Likelihood {
            per_m,
            precision: narrow * a + wide * b,
            squared_precision: narrow * (a * a) + wide * (b * b),
        })
    }
}

/// Intensities of measurements that come from no known feature, per metre of range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clutter {
    /// False alarms.
    pub false_alarms_per_m: f32,
    /// False alarms and paths of virtual anchors not in the map.
    pub all_per_m: f32,
}

/// Whether a measurement is clearly, by two deviations, shorter than a direct path of this range and variance.
pub fn is_earlier(measurement: &Measurement, direct_m: f32, variance_m2: f32) -> bool {
    measurement.range_m < direct_m - 2.0 * sqrt(variance_m2 + measurement.variance_m2)
}
