//! The transmitted pulse as the receiver's matched filter sees it.
//!
//! A unit-energy root-raised-cosine pulse of symbol time `T_p` and roll-off `b` leaves the matched filter as
//! the raised-cosine pulse R(t) = sinc(t/T_p) cos(pi b t/T_p) / (1 - (2 b t/T_p)^2). Its rms bandwidth is
//! beta = sqrt(1/12 + b^2 (1/4 - 2/pi^2)) / T_p, which sets what a range can be worth:
//! sigma^2 = c^2 / (8 pi^2 beta^2 SINR).

use crate::real::{SPEED_OF_LIGHT_M_S, abs, cos, larger, sin, sqrt};

/// Table steps per pulse duration.
const STEPS: usize = 64;
/// The pulse is taken as zero beyond this many pulse durations.
pub const SUPPORT: usize = 4;
/// Table entries: zero to [`SUPPORT`] pulse durations, and one more to interpolate into.
const ENTRIES: usize = STEPS * SUPPORT + 2;

/// A root-raised-cosine pulse.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Pulse {
    /// Symbol time T_p, seconds; 0.1 ns to 10 ns. The nominal bandwidth is its inverse.
    pub duration_s: f32,
    /// Roll-off b, 0 to 1.
    pub roll_off: f32,
}

impl Pulse {
    /// Raised-cosine autocorrelation R at lag `lag` (in pulse durations); R(0) = 1.
    pub fn autocorrelation(&self, lag: f32) -> f32 {
        let pi = core::f32::consts::PI;
        let x = abs(lag);
        let sinc = if x < 1e-4 { 1.0 } else { sin(pi * x) / (pi * x) };
        let edge = 2.0 * self.roll_off * x;
        let taper_denominator = 1.0 - edge * edge;
        // At the pole |t| = T_p / (2 b) numerator and denominator vanish together; their ratio is pi / 4.
        let taper = if abs(taper_denominator) < 1e-4 {
            pi / 4.0
        } else {
            cos(pi * self.roll_off * x) / taper_denominator
        };
        sinc * taper
    }

    /// Rms (effective) bandwidth beta, hertz.
    pub fn rms_bandwidth_hz(&self) -> f32 {
        let pi = core::f32::consts::PI;
        let b = self.roll_off;
        sqrt(1.0 / 12.0 + b * b * (0.25 - 2.0 / (pi * pi))) / self.duration_s
    }

    /// Variance of a range estimated at `sinr` (linear power ratio): the single-path Cramer-Rao bound, square metres.
    pub fn range_variance_m2(&self, sinr: f32) -> f32 {
        let beta_over_c = self.rms_bandwidth_hz() / SPEED_OF_LIGHT_M_S;
        1.0 / (2.0 * (crate::real::TAU * crate::real::TAU) * (beta_over_c * beta_over_c) * larger(sinr, 1e-3))
    }
}

/// R(t) tabulated at `T_p / 64` up to 4 `T_p`; linear interpolation between entries errs by at most 1.5e-4.
#[derive(Clone, Debug)]
pub struct PulseTable {
    values: [f32; ENTRIES],
    /// Table steps per sample of the frame.
    steps_per_sample: f32,
}

impl PulseTable {
    /// Tabulates `pulse` for frames sampled every `sample_spacing_s` seconds.
    pub fn new(pulse: &Pulse, sample_spacing_s: f32) -> Self {
        let mut values = [0.0; ENTRIES];
        for (step, value) in values.iter_mut().enumerate() {
            if step < STEPS * SUPPORT {
                *value = pulse.autocorrelation(step as f32 / STEPS as f32);
            }
        }
        Self { values, steps_per_sample: sample_spacing_s / pulse.duration_s * STEPS as f32 }
    }

    /// R at a lag of `lag_samples` samples.
    pub fn at(&self, lag_samples: f32) -> f32 {
        let position = abs(lag_samples) * self.steps_per_sample;
        if position >= (STEPS * SUPPORT) as f32 {
            return 0.0;
        }
        // Not negative, so truncation is the floor.
        let step = position as usize;
        let fraction = position - step as f32;
        match (self.values.get(step), self.values.get(step + 1)) {
            (Some(&low), Some(&high)) => low + fraction * (high - low),
            _ => 0.0,
        }
    }

    /// Samples on either side of a path beyond which R is zero.
    pub fn support_samples(&self) -> f32 {
        (STEPS * SUPPORT) as f32 / self.steps_per_sample
    }

    /// Samples per pulse duration.
    pub fn samples_per_pulse(&self) -> f32 {
        STEPS as f32 / self.steps_per_sample
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rms_bandwidth_and_range_deviation_match_the_published_numbers() {
        let pulse = Pulse { duration_s: 0.5e-9, roll_off: 0.6 };
        assert!((pulse.rms_bandwidth_hz() / 633.6626e6 - 1.0).abs() < 1e-5);
        assert!((pulse.range_variance_m2(100.0).sqrt() - 5.32e-3).abs() < 5e-6);
        assert!((pulse.range_variance_m2(1.0).sqrt() - 53.2e-3).abs() < 5e-5);
    }

    #[test]
    fn the_table_follows_the_closed_form() {
        for roll_off in [0.0, 0.25, 0.5, 0.6, 1.0] {
            let pulse = Pulse { duration_s: 2.0e-9, roll_off };
            let table = PulseTable::new(&pulse, 1.0016e-9);
            for i in 0..1000 {
                let lag_samples = i as f32 * 0.0075;
                let lag = f64::from(lag_samples) * 1.0016 / 2.0;
                let pi = core::f64::consts::PI;
                let b = f64::from(roll_off);
                let sinc = if lag == 0.0 { 1.0 } else { (pi * lag).sin() / (pi * lag) };
                let denominator = 1.0 - (2.0 * b * lag).powi(2);
                let taper =
                    if denominator.abs() < 1e-6 { pi / 4.0 } else { (pi * b * lag).cos() / denominator };
                let error = f64::from(table.at(lag_samples)) - sinc * taper;
                assert!(error.abs() < 3e-4, "roll-off {roll_off}, lag {lag}: {error}");
            }
        }
    }
}
