//! The pulse behind the matched filter.
//!
//! R(t) = sinc(t/T_p) cos(pi b t/T_p) / (1 - (2 b t/T_p)^2), the autocorrelation of a root-raised-cosine pulse of
//! symbol time T_p and roll-off b; rms bandwidth beta = sqrt(1/12 + b^2 (1/4 - 2/pi^2)) / T_p; and the variance of a
//! range of a given SINR, sigma^2 = c^2 / (8 pi^2 beta^2 SINR).
//!
//! The channel estimator uses R from a table of 64 steps per T_p up to 4 T_p, interpolated linearly: the table is
//! part of the contract, not the closed form.

use super::real::{Real, abs, cos, larger, pi, sin, speed_of_light, sqrt, square, tau};

/// Table steps per pulse duration.
const STEPS: usize = 64;
/// Pulse durations beyond which R counts as zero.
const SUPPORT: usize = 4;

/// A root-raised-cosine pulse.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pulse<T> {
    /// Symbol time T_p, seconds.
    pub duration_s: T,
    /// Roll-off b.
    pub roll_off: T,
}

impl<T: Real> Pulse<T> {
    /// R at a lag in pulse durations.
    pub fn autocorrelation(&self, lag: T) -> T {
        let num = T::of;
        let x = abs(lag);
        let sinc = if x < num(1e-4) { T::ONE } else { sin(pi::<T>() * x) / (pi::<T>() * x) };
        // Order: (2 b) x, and (pi b) x.
        let edge = num(2.0) * self.roll_off * x;
        let denominator = T::ONE - square(edge);
        // At the pole both vanish; their ratio tends to pi / 4.
        let taper = if abs(denominator) < num(1e-4) {
            pi::<T>() / num(4.0)
        } else {
            cos(pi::<T>() * self.roll_off * x) / denominator
        };
        sinc * taper
    }

    /// Rms bandwidth beta, hertz.
    pub fn rms_bandwidth_hz(&self) -> T {
        let num = T::of;
        let shape = num(1.0) / num(12.0) + square(self.roll_off) * (num(0.25) - num(2.0) / square(pi::<T>()));
        sqrt(shape) / self.duration_s
    }

    /// Variance of a range estimated at `sinr` (linear), square metres.
    pub fn range_variance_m2(&self, sinr: T) -> T {
        let num = T::of;
        let beta_over_c = self.rms_bandwidth_hz() / speed_of_light();
        // Order: ((2 tau^2) (beta/c)^2) SINR.
        T::ONE / (num(2.0) * square(tau::<T>()) * square(beta_over_c) * larger(sinr, num(1e-3)))
    }
}

/// R(t), tabulated.
#[derive(Clone, Debug)]
pub struct PulseTable<T> {
    values: Vec<T>,
    steps_per_sample: T,
}

impl<T: Real> PulseTable<T> {
    /// The table of `pulse` for samples `sample_spacing_s` seconds apart.
    pub fn new(pulse: &Pulse<T>, sample_spacing_s: T) -> Self {
        let mut values = Vec::new();
        for step in 0..STEPS * SUPPORT {
            values.push(pulse.autocorrelation(T::of_count(step) / T::of_count(STEPS)));
        }
        // The pulse ends here; the last interval leads down to it.
        values.push(T::ZERO);
        Self { values, steps_per_sample: sample_spacing_s / pulse.duration_s * T::of_count(STEPS) }
    }

    /// R at a lag in samples.
    pub fn at(&self, lag_samples: T) -> T {
        let position = abs(lag_samples) * self.steps_per_sample;
        if position >= T::of_count(STEPS * SUPPORT) {
            return T::ZERO;
        }
        let step = position.whole() as usize;
        let fraction = position - T::of_count(step);
        let (low, high) = (self.values[step], self.values[step + 1]);
        low + fraction * (high - low)
    }

    /// Half the width of the pulse, samples.
    pub fn support_samples(&self) -> T {
        T::of_count(STEPS * SUPPORT) / self.steps_per_sample
    }

    /// Samples per pulse duration.
    pub fn samples_per_pulse(&self) -> T {
        T::of_count(STEPS) / self.steps_per_sample
    }
}
