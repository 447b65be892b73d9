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
    /// Variance that a share of measurements ([`Clutter::tail`]) has on top, square metres; 0 where there are no such.
    pub tail_m2: f32,
    /// Component SINR where the measurement is an estimated path; 0 where nothing is known of it.
    pub sinr: f32,
    /// Energy of the path, in squared units of the samples or in the frame's white noise; 0 where nothing is known of it.
    pub energy: f32,
    /// Density of false alarms of its strength over that of all false alarms, 0 to 1; 1 where nothing is known of it.
    pub false_alarm: f32,
}

/// Tuned: share of estimated paths that others pull along which nobody expects, before any was seen.
pub const USUAL_TAIL: f32 = 0.25;
/// Tuned: standard deviation of how far they are pulled, pulse lengths.
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
    /// Probability that it is of the tail.
    pub tail: f32,
}

impl Measurement {
    /// Likelihood of an innovation of `innovation_m` where the range was expected with variance `expected_m2`: a normal
    /// distribution and, for a share `tail` of paths, a wider one; `None` beyond `gate` deviations.
    pub fn likelihood(
        &self,
        innovation_m: f32,
        expected_m2: f32,
        tail: f32,
        gate: f32,
    ) -> Option<Likelihood> {
        let squared = innovation_m * innovation_m;
        let narrow_m2 = expected_m2 + self.variance_m2;
        let wide_m2 = narrow_m2 + self.tail_m2;
        if squared >= gate * gate * wide_m2 {
            return None;
        }
        let a = 1.0 / narrow_m2;
        let narrow = exp(-0.5 * (squared * a)) / sqrt(TAU * narrow_m2);
        if self.tail_m2 <= 0.0 {
            return Some(Likelihood { per_m: narrow, precision: a, squared_precision: a * a, tail: 0.0 });
        }
        let b = 1.0 / wide_m2;
        let narrow = (1.0 - tail) * narrow;
        let wide = tail * (exp(-0.5 * (squared * b)) / sqrt(TAU * wide_m2));
        let per_m = narrow + wide;
        let wide = wide / larger(per_m, f32::MIN_POSITIVE);
        let narrow = 1.0 - wide;
        Some(Likelihood {
            per_m,
            precision: narrow * a + wide * b,
            squared_precision: narrow * (a * a) + wide * (b * b),
            tail: wide,
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
    /// Share of paths whose ranges have the tail.
    pub tail: f32,
}

/// Whether a measurement is clearly, by two deviations, shorter than a direct path of this range and variance.
pub fn is_earlier(measurement: &Measurement, direct_m: f32, variance_m2: f32) -> bool {
    measurement.range_m < direct_m - 2.0 * sqrt(variance_m2 + measurement.variance_m2)
}
