//! Channel estimator: the specular paths in one frame.
//!
//! The frame is the matched filter's output, y(t) = sum_k alpha_k R(t - tau_k) + noise, whose noise has the
//! level lambda(t) = N0 + dense multipath. Complex frames go through sparse Bayesian learning (`complex.rs`);
//! frames without phase through a peak model of their own (`magnitude.rs`). Both keep a path only where its
//! normalised energy exceeds kappa, which follows from the false-path rate asked for:
//! mu_FA = (2 beta sqrt(pi kappa) T + 1) exp(-kappa), the Rice up-crossing rate of the noise envelope.
//!
//! Where a frame begins, for ranging, is a matter of its own: `first_path.rs`.
//!
//! Fixed memory: no copy of the frame is made; the residual is recomputed from the paths where it is needed.

mod complex;
mod first_path;
mod gram;
mod interpolation;
mod magnitude;
mod noise;

use crate::observation::{Complex, Samples};
use crate::pulse::{Pulse, PulseTable};
use crate::real::{SPEED_OF_LIGHT_M_S, exp, larger, ln, sqrt};
use heapless::Vec;
use interpolation::Interpolation;

pub use first_path::{FirstPath, FirstPathDetector};
pub use noise::NoiseLevel;

/// One specular path.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Path {
    /// Propagation delay, seconds.
    pub delay_s: f32,
    /// Amplitude at the matched filter's output, in the unit of the samples; the imaginary part is zero in
    /// magnitude mode.
    pub amplitude: Complex,
    /// Component SINR: energy over the local level of noise and dense multipath (linear).
    pub sinr: f32,
    /// Variance of the delay, square seconds: the single-path bound at this SINR.
    pub delay_variance_s2: f32,
}

impl Path {
    /// Distance travelled, metres.
    pub fn range_m(&self) -> f32 {
        self.delay_s * SPEED_OF_LIGHT_M_S
    }
}

/// The paths of one frame, strongest SINR first found first, and the noise they stand in.
#[derive(Clone, Debug, PartialEq)]
pub struct ChannelEstimate<const PATHS: usize> {
    /// At most `PATHS` paths.
    pub paths: Vec<Path, PATHS>,
    /// White noise and dense multipath.
    pub noise: NoiseLevel,
}

/// A channel estimator for frames of one pulse and sample spacing; `PATHS` bounds the paths it reports.
#[derive(Clone, Debug)]
pub struct ChannelEstimator<const PATHS: usize> {
    pulse: Pulse,
    table: PulseTable,
    interpolation: Interpolation,
    sample_spacing_s: f32,
    /// kappa beside a level that is known: magnitudes.
    known_threshold: f32,
    /// kappa beside a level that was fitted to dense multipath: complex frames.
    threshold: f32,
}

impl<const PATHS: usize> ChannelEstimator<PATHS> {
    /// An estimator for frames of `samples` samples, `sample_spacing_s` seconds apart, that reports
    /// `false_paths` paths per frame of pure noise on average (1e-4 to 10).
    pub fn new(pulse: Pulse, sample_spacing_s: f32, samples: usize, false_paths: f32) -> Self {
        let window_s = samples as f32 * sample_spacing_s;
        let known_threshold = detection_threshold(pulse.rms_bandwidth_hz() * window_s, false_paths);
        Self {
            pulse,
            table: PulseTable::new(&pulse, sample_spacing_s),
            interpolation: Interpolation::new(),
            sample_spacing_s,
            known_threshold,
            threshold: fitted_threshold(&pulse, known_threshold),
        }
    }

    /// Threshold kappa on a path's normalised energy in complex frames.
    pub fn threshold(&self) -> f32 {
        self.threshold
    }

    /// Estimates the paths of a frame whose first sample stands for a delay of `first_sample_delay_s`.
    ///
    /// Never fails: a frame without a path gives none. The samples must be finite.
    pub fn estimate(&self, samples: Samples<'_>, first_sample_delay_s: f32) -> ChannelEstimate<PATHS> {
        match samples {
            Samples::Complex(samples) => self.estimate_complex(samples, first_sample_delay_s),
            Samples::Magnitude(samples) => self.estimate_magnitude(samples, first_sample_delay_s),
        }
    }

    /// A path at `position` samples into the frame.
    fn path(&self, position: f32, first_sample_delay_s: f32, amplitude: Complex, sinr: f32) -> Path {
        let variance_m2 = self.pulse.range_variance_m2(sinr);
        Path {
            delay_s: first_sample_delay_s + position * self.sample_spacing_s,
            amplitude,
            sinr,
            delay_variance_s2: variance_m2 / (SPEED_OF_LIGHT_M_S * SPEED_OF_LIGHT_M_S),
        }
    }
}

/// kappa such that noise alone exceeds it `false_paths` times per frame on average: the fixed point of
/// kappa = ln((2 B sqrt(pi kappa) + 1) / mu_FA), B the product of rms bandwidth and window.
fn detection_threshold(bandwidth_window: f32, false_paths: f32) -> f32 {
    let mut threshold = 6.0;
    for _ in 0..20 {
        let crossings = 2.0 * bandwidth_window * sqrt(core::f32::consts::PI * threshold) + 1.0;
        threshold = larger(ln(crossings / false_paths), 1.0);
    }
    threshold
}

/// Independent samples that a fitted level is worth: those within 2.5 decay times of the dense multipath.
const LEVEL_DECAYS: f32 = 2.5;

/// kappa where the level is a mean of n samples itself: the energy over it then exceeds kappa with probability
/// (1 + kappa / n)^-n instead of exp(-kappa), so that n (exp(kappa / n) - 1) takes kappa's place.
fn fitted_threshold(pulse: &Pulse, threshold: f32) -> f32 {
    // T_eff: what the matched filter makes one sample of.
    let sample_s = pulse.duration_s * (1.0 - 0.25 * pulse.roll_off);
    let samples = LEVEL_DECAYS * noise::DECAY_S / sample_s;
    samples * (exp(threshold / samples) - 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_threshold_follows_the_false_path_rate() {
        let pulse = Pulse { duration_s: 0.5e-9, roll_off: 0.6 };
        let bandwidth_window = pulse.rms_bandwidth_hz() * 100e-9;
        for (rate, kappa) in [(5.0, 4.57), (1.0, 6.34), (0.1, 8.81), (0.01, 11.23)] {
            assert!((detection_threshold(bandwidth_window, rate) - kappa).abs() < 0.01, "{rate}");
        }
    }
}
