//! Measurements of one anchor, and what they may be if they belong to nothing known.

use crate::real::{expm1, larger, sqrt};
use crate::snapshot::written;

/// What a range is worth.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Ranging {
    /// Factor on every measurement variance (1 to 100). Above 1, the filter forgives errors that the bound does
    /// not know of; 2.25 is common.
    pub variance_inflation: f32,
    /// Standard deviation that no range goes below, metres (1e-3 to 10): calibration, wall delays.
    pub floor_m: f32,
    /// The same for paths of frames, pulse lengths (0 to 1): what other paths that nobody expects, unresolved, do to them. On top
    /// of `floor_m`. 0 where all paths are known. Less: a map and a claim that follow every pulled range; more: a slower one.
    /// Chosen on random rooms, seeds 1 to 200.
    pub floor_pulses: f32,
    /// How long such errors stay alike, seconds (0 to 100): the paths that make them change only as the tag walks by, so that frame
    /// after frame tells less than frames apart. 0: every frame is off anew. Less: claims that are too small at high rates. More:
    /// a slower map. Chosen on random rooms, seeds 1 to 100.
    pub alike_s: f32,
    /// Mean of the range bias expected of every anchor, metres (-10 to 10).
    pub bias_mean_m: f32,
    /// Its standard deviation, metres (0 to 10). Above 0, one bias per anchor is estimated.
    pub bias_std_m: f32,
    /// By how much ranges are too long on average whose direct path is blocked, metres (0 to 100), as assumed at the start; the share
    /// of such ranges and their mean are then learnt of every anchor. 0: no range is late. Paths of frames never are.
    pub late_m: f32,
    /// Ranges beyond this are refused, metres (1 to 1e4).
    pub max_range_m: f32,
}

impl Ranging {
    /// That of a tracker that is not started.
    pub(crate) const NONE: Self = Self {
        variance_inflation: 0.0,
        floor_m: 0.0,
        floor_pulses: 0.0,
        alike_s: 0.0,
        bias_mean_m: 0.0,
        bias_std_m: 0.0,
        late_m: 0.0,
        max_range_m: 0.0,
    };

    /// The variance the filter works with: inflated, and never below the floor.
    pub(crate) fn measurement_variance_m2(&self, variance_m2: f32) -> f32 {
        self.variance_inflation * variance_m2 + self.floor_m * self.floor_m
    }

    /// The same for a path received with a pulse of this length.
    pub(crate) fn path_variance_m2(&self, variance_m2: f32, pulse_m: f32) -> f32 {
        self.measurement_variance_m2(variance_m2) + self.unresolved_m2(pulse_m)
    }

    /// What unresolved paths add to it.
    pub(crate) fn unresolved_m2(&self, pulse_m: f32) -> f32 {
        let floor_m = self.floor_pulses * pulse_m;
        floor_m * floor_m
    }

    /// What the filter adds to it `elapsed_s` seconds after the last frame: of errors with the correlation rho = exp(-dt / tau)
    /// from frame to frame, a frame tells as much as one of (1 + rho) / (1 - rho) times their variance.
    pub(crate) fn alike_m2(&self, pulse_m: f32, elapsed_s: f32) -> f32 {
        self.unresolved_m2(pulse_m) * self.repeated(elapsed_s)
    }

    /// What such a frame tells of what one tells that comes long after the last, 0 to 1: (1 - rho) / (1 + rho).
    pub(crate) fn share(&self, elapsed_s: f32) -> f32 {
        1.0 / (1.0 + self.repeated(elapsed_s))
    }

    /// (1 + rho) / (1 - rho) - 1.
    fn repeated(&self, elapsed_s: f32) -> f32 {
        2.0 / larger(expm1(elapsed_s / self.alike_s), LEAST_APART)
    }
}

/// Guard: against the division by it: least exp(dt / tau) - 1 of two frames.
pub const LEAST_APART: f32 = 1e-6;

/// A measurement as association and filter see it.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Measurement {
    /// Distance, metres.
    pub range_m: f32,
    /// Variance, square metres.
    pub variance_m2: f32,
    /// Component SINR where the measurement is an estimated path; 0 where nothing is known of it.
    pub sinr: f32,
    /// Energy of the path, in squared units of the samples or in the frame's white noise; 0 where nothing is known of it.
    pub energy: f32,
    /// Density of false alarms of its strength over that of all false alarms, 0 to 1; 1 where nothing is known of it.
    pub false_alarm: f32,
}

impl Measurement {
    /// Whether somebody else measured it: nothing is known of its strength.
    pub fn is_range(&self) -> bool {
        self.sinr == 0.0
    }

    /// Whether it may be taken for a path: the density of false alarms of its strength, over that of all, is below `density`, or
    /// nothing is known of its strength.
    pub fn is_strong(&self, density: f32) -> bool {
        self.is_range() || self.false_alarm < density
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

written!(Ranging {
    variance_inflation,
    floor_m,
    floor_pulses,
    alike_s,
    bias_mean_m,
    bias_std_m,
    late_m,
    max_range_m
});
