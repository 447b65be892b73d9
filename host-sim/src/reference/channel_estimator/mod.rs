//! Channel estimator: a frame's paths.
//!
//! Behind the matched filter, y(t) = sum over k of alpha_k R(t - tau_k) + noise of level lambda(t). Complex frames go
//! through sparse Bayesian learning (`complex`), magnitudes through a fit of single pulses (`magnitude`). Both keep
//! what exceeds kappa, set by the rate of false paths mu: kappa = ln((2 B sqrt(pi kappa) + 1) / mu), with B the product
//! of rms bandwidth and window.

mod beginning;
mod complex;
mod interpolation;
mod linear_algebra;
mod magnitude;
mod noise;
mod residual;

use super::pulse::{Pulse, PulseTable};
use super::real::{Real, larger, limited, ln, pi, speed_of_light, sqrt, square};
use cogmint_core::model::observation::Samples;
use cogmint_core::perceptor::channel_estimator::beginning::BEGINNING_SHARE;
use cogmint_core::perceptor::channel_estimator::noise::{COMPLEX_CUT, Cut, LENGTH_DECAYS, MAGNITUDE_CUT};
use cogmint_core::perceptor::channel_estimator::work::MOST_WORK;
use cogmint_core::perceptor::channel_estimator::{EstimatorSettings, LEAST_SINR, MOST_SINR};
use interpolation::Interpolation;

pub use noise::{DenseMultipath, NoiseLevel};
pub use residual::Residual;

/// One path.
#[derive(Clone, Copy, Debug)]
pub struct Path<T> {
    /// Propagation delay, seconds.
    pub delay_s: T,
    /// Amplitude: real and imaginary part.
    pub amplitude: [T; 2],
    /// Component SINR (linear).
    pub sinr: T,
    /// Variance of the delay, square seconds.
    pub delay_variance_s2: T,
}

/// The paths of a frame, in order of delay (complex frames), and its noise.
#[derive(Clone, Debug)]
pub struct ChannelEstimate<T> {
    /// The paths.
    pub paths: Vec<Path<T>>,
    /// White noise and dense multipath.
    pub noise: NoiseLevel<T>,
    /// The dense multipath as a whole.
    pub dense: DenseMultipath<T>,
    /// kappa in this frame.
    pub threshold: T,
    /// What it has cost.
    pub cost: Cost,
}

/// What a frame has cost.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cost {
    /// Work on it.
    pub work: u32,
    /// Whether it was ended for that.
    pub cut_short: bool,
}

/// An estimator for one pulse and sample spacing.
#[derive(Clone, Debug)]
pub struct ChannelEstimator<T> {
    pulse: Pulse<T>,
    table: PulseTable<T>,
    interpolation: Interpolation<T>,
    sample_spacing_s: T,
    /// Decay and rise time of what dense multipath is a sum of.
    profile: [T; 2],
    /// kappa beside a level fitted to n samples: kappa / (1 + share / n), n those of a profile's length.
    fitted_threshold: T,
    /// The same of magnitudes.
    magnitude_threshold: T,
    /// Of a path at the beginning.
    beginning_threshold: T,
    /// Most paths reported.
    most_paths: usize,
    /// Most work on a frame.
    pub most_work: u32,
    settings: EstimatorSettings,
}

impl<T: Real> ChannelEstimator<T> {
    /// An estimator for frames of `samples` samples that finds `false_paths` paths per frame of noise.
    pub fn new(
        pulse: Pulse<T>,
        sample_spacing_s: T,
        samples: usize,
        false_paths: T,
        most_paths: usize,
        settings: EstimatorSettings,
    ) -> Self {
        let num = T::of;
        let window_s = T::of_count(samples) * sample_spacing_s;
        let bandwidth_window = pulse.rms_bandwidth_hz() * window_s;
        let kappa = |rate: T| {
            let mut kappa = num(6.0);
            for _ in 0..20 {
                let crossings = num(2.0) * bandwidth_window * sqrt(pi::<T>() * kappa) + T::ONE;
                kappa = larger(ln(crossings / rate), T::ONE);
            }
            kappa
        };
        let threshold = kappa(false_paths);
        let profile = NoiseLevel::profile(pulse.effective_duration_s(), &settings);
        let worth = num(LENGTH_DECAYS) * profile[0] / pulse.effective_duration_s();
        let fitted = |cut: &Cut| threshold / (T::ONE + num(cut.self_share) / worth);
        Self {
            table: PulseTable::new(&pulse, sample_spacing_s),
            pulse,
            interpolation: Interpolation::new(),
            sample_spacing_s,
            profile,
            fitted_threshold: fitted(&COMPLEX_CUT),
            magnitude_threshold: fitted(&MAGNITUDE_CUT),
            beginning_threshold: beginning::beside(kappa(num(BEGINNING_SHARE) * false_paths), worth),
            most_paths,
            most_work: MOST_WORK,
            settings,
        }
    }

    /// Samples that a path reaches in a long frame.
    fn pulse_samples(&self) -> usize {
        (T::of(2.0) * self.table.support_samples()).whole() as usize
    }

    /// kappa, of complex frames or of magnitudes.
    pub fn threshold(&self, samples: &Samples<'_>) -> T {
        match samples {
            Samples::Complex(_) => self.fitted_threshold,
            Samples::Magnitude(_) => self.magnitude_threshold,
        }
    }

    /// Estimates a frame's paths.
    pub fn estimate(&self, samples: Samples<'_>, first_sample_delay_s: T) -> ChannelEstimate<T> {
        let (paths, noise, threshold, cost) = match samples {
            Samples::Complex(samples) => {
                let samples: Vec<[T; 2]> = samples.iter().map(|sample| sample.map(T::of)).collect();
                complex::estimate(self, &samples, first_sample_delay_s)
            }
            Samples::Magnitude(samples) => {
                let samples: Vec<T> = samples.iter().map(|sample| T::of(*sample)).collect();
                magnitude::estimate(self, &samples, first_sample_delay_s)
            }
        };
        let dense = noise.dense_multipath(
            first_sample_delay_s,
            self.sample_spacing_s,
            self.pulse.effective_duration_s(),
        );
        ChannelEstimate { paths, noise, dense, threshold, cost }
    }

    /// The noise that a fit begins with.
    fn open_noise(&self, white: T, samples: usize, beginning: Option<[usize; 2]>) -> NoiseLevel<T> {
        let beginning = beginning.map_or(0, |[sample, _]| sample);
        NoiseLevel::everywhere(white, self.profile, samples, self.sample_spacing_s, beginning)
    }

    /// A path `position` samples into the frame.
    fn path(&self, position: T, first_sample_delay_s: T, amplitude: [T; 2], sinr: T) -> Path<T> {
        let sinr = limited(sinr, T::of(LEAST_SINR), T::of(MOST_SINR));
        Path {
            delay_s: first_sample_delay_s + position * self.sample_spacing_s,
            amplitude,
            sinr,
            delay_variance_s2: self.pulse.range_variance_m2(sinr) / square(speed_of_light::<T>()),
        }
    }
}

/// |z|^2.
fn power<T: Real>(z: [T; 2]) -> T {
    square(z[0]) + square(z[1])
}

/// Offset of the vertex of the parabola through three equidistant values whose middle one is largest.
fn parabola_vertex<T: Real>(before: T, here: T, after: T) -> T {
    let num = T::of;
    let curvature = before - num(2.0) * here + after;
    if curvature < T::ZERO { num(0.5) * (before - after) / curvature } else { T::ZERO }
}
