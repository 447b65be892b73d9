//! Channel estimator: the specular paths in one frame.
//!
//! The frame is the matched filter's output, y(t) = sum_k alpha_k R(t - tau_k) + noise, whose noise has the
//! level lambda(t) = N0 + dense multipath. Complex frames go through sparse Bayesian learning (`complex.rs`);
//! frames without phase through a fit of single pulses (`magnitude.rs`). Both keep a path only where its
//! normalised energy exceeds kappa, which follows from the false-path rate asked for:
//! mu_FA = (2 beta sqrt(pi kappa) T + 1) exp(-kappa), the Rice up-crossing rate of the noise envelope. The envelope is
//! what magnitudes show, so the rate holds for either mode.
//!
//! What rises at once, as behind a wall, is not all dense multipath: `beginning.rs`, which also measures the tail of the noise.
//! Where a frame begins, for ranging, is a matter of its own: `first_path.rs`.
//!
//! Fixed memory: no copy of the frame is made; the residual is recomputed from the paths where it is needed.

pub mod beginning;
pub mod complex;
mod component;
mod first_path;
mod gram;
pub mod interpolation;
pub mod magnitude;
pub mod noise;
pub mod residual;
pub mod work;

use crate::model::observation::{Complex, SampleFault, Samples};
use crate::radio::pulse::{Pulse, PulseTable};
use crate::real::{SPEED_OF_LIGHT_M_S, larger, limited, ln, sqrt};
use crate::snapshot::written;
use beginning::{BEGINNING_SHARE, threshold_beside};
use heapless::Vec;
use interpolation::Interpolation;
use noise::{COMPLEX_CUT, Cut, MAGNITUDE_CUT, Profile};
use work::MOST_WORK;

pub use first_path::{FirstPath, FirstPathDetector};
pub use noise::{DenseMultipath, NoiseLevel};

/// One specular path.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Path {
    /// Propagation delay, seconds.
    pub delay_s: f32,
    /// Amplitude at the matched filter's output, in the unit of the samples; the imaginary part is zero in
    /// magnitude mode.
    pub amplitude: Complex,
    /// Component SINR: energy over the local level of noise and dense multipath (linear); in magnitude mode over that
    /// of neighbours of unknown phase as well. 1e-3 to 1e12.
    pub sinr: f32,
    /// Variance of the delay, square seconds: the single-path bound at this SINR. Paths within a pulse duration of each
    /// other know their delays less well than this.
    pub delay_variance_s2: f32,
}

impl Path {
    /// Distance travelled, metres.
    pub fn range_m(&self) -> f32 {
        self.delay_s * SPEED_OF_LIGHT_M_S
    }
}

/// The paths of one frame, in order of delay (complex frames), and the noise they stand in.
#[derive(Clone, Debug, PartialEq)]
pub struct ChannelEstimate<const PATHS: usize> {
    /// At most `PATHS` paths.
    pub paths: Vec<Path, PATHS>,
    /// White noise and dense multipath.
    pub noise: NoiseLevel,
    /// The dense multipath as a whole.
    pub dense: DenseMultipath,
    /// kappa in this frame, whose noise may have a heavier tail than Gaussian.
    pub threshold: f32,
    /// What it cost, about in instructions of a Cortex-M4F: see [`work`].
    pub work: u32,
    /// Whether it was ended for that: weak paths may be missing.
    pub cut_short: bool,
}

/// What an estimator takes for a path, for two, and for dense multipath. How many false paths it may report is told apart
/// ([`crate::config::Radio::false_paths_per_frame`]).
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct EstimatorSettings {
    /// Shortest decay time of dense multipath, seconds (1e-9 to 1e-7): slower decays are sums of such profiles. Less: weak
    /// paths are taken for dense multipath. More: where it decays faster, false paths. Found on simulated frames at the pulses
    /// of the published radio and of a DW1000.
    pub dense_decay_s: f32,
    /// The same in effective pulse durations (2 to 100), for long pulses; the longer of the two holds. Less: a single path
    /// lifts the level under itself and is lost in it. Found as `dense_decay_s`.
    pub dense_decay_pulses: f32,
    /// Two paths closer than this are one, pulse durations (0.05 to 1). Less: one path is now and then reported as two. More:
    /// two are reported as one. Chosen on simulated pairs of equal paths, half a pulse duration apart and more.
    pub merge_pulses: f32,
    /// Whether dense multipath begins with a path. What rises at once is one then, as behind a wall, where real radios have no other; where
    /// dense multipath far above the noise begins by itself, as an interferer's, it costs a false path in one frame of five.
    pub begins_with_path: bool,
}

impl EstimatorSettings {
    /// Those of a tracker that is not started.
    pub(crate) const NONE: Self =
        Self { dense_decay_s: 0.0, dense_decay_pulses: 0.0, merge_pulses: 0.0, begins_with_path: false };
}

impl Default for EstimatorSettings {
    fn default() -> Self {
        Self { dense_decay_s: 8e-9, dense_decay_pulses: 11.4, merge_pulses: 0.3, begins_with_path: false }
    }
}

/// A channel estimator for frames of one pulse and sample spacing; `PATHS` bounds the paths it reports.
#[derive(Clone, Debug)]
pub struct ChannelEstimator<const PATHS: usize> {
    pulse: Pulse,
    table: PulseTable,
    interpolation: Interpolation,
    sample_spacing_s: f32,
    /// What dense multipath is a sum of.
    profile: Profile,
    /// kappa beside a level that was fitted to dense multipath: of complex frames, and of magnitudes.
    threshold: f32,
    magnitude_threshold: f32,
    /// kappa of a path at the beginning.
    beginning_threshold: f32,
    settings: EstimatorSettings,
}

/// Capacity: rounds of the search beyond `PATHS`, which bound its time; a round may drop a path.
pub const SPARE_ROUNDS: usize = 4;
/// Guard: against the division by a SINR of zero: the least one reported.
pub const LEAST_SINR: f32 = 1e-3;
/// Guard: against overflow: the largest SINR reported. The level is never taken as less than -120 dB of the strongest sample,
/// so more means nothing.
pub const MOST_SINR: f32 = 1e12;

impl<const PATHS: usize> ChannelEstimator<PATHS> {
    /// An estimator for frames of `samples` samples, `sample_spacing_s` seconds apart ([`Pulse::sampled_every`] tells what
    /// they leave of a pulse), that reports `false_paths` paths per frame of pure noise on average (1e-4 to 10). What is out of
    /// range is taken as the nearest value in it; the settings are taken as they are.
    pub fn new(
        pulse: Pulse,
        sample_spacing_s: f32,
        samples: usize,
        false_paths: f32,
        settings: EstimatorSettings,
    ) -> Self {
        let mut estimator = Self::empty();
        estimator.start(pulse, sample_spacing_s, samples, false_paths, settings);
        estimator
    }

    /// An estimator without a pulse: to be started.
    #[inline(always)] // built where it stays
    pub const fn empty() -> Self {
        Self {
            pulse: Pulse::NONE,
            table: PulseTable::empty(),
            interpolation: Interpolation::empty(),
            sample_spacing_s: 0.0,
            profile: Profile::NONE,
            threshold: 0.0,
            magnitude_threshold: 0.0,
            beginning_threshold: 0.0,
            settings: EstimatorSettings::NONE,
        }
    }

    /// As [`Self::new`], where it stays.
    pub fn start(
        &mut self,
        pulse: Pulse,
        sample_spacing_s: f32,
        samples: usize,
        false_paths: f32,
        settings: EstimatorSettings,
    ) {
        self.interpolation.fill();
        self.change(pulse, sample_spacing_s, samples, false_paths, settings);
    }

    /// The same for another pulse.
    #[inline(never)]
    pub(crate) fn change(
        &mut self,
        pulse: Pulse,
        sample_spacing_s: f32,
        samples: usize,
        false_paths: f32,
        settings: EstimatorSettings,
    ) {
        // Out of range they would stall the set-up: spacings from 1 ps to 1 us, pulses from 10 ps to 1 us.
        let sample_spacing_s = limited(sample_spacing_s, 1e-12, 1e-6);
        let pulse = Pulse { duration_s: limited(pulse.duration_s, 1e-11, 1e-6), ..pulse };
        let false_paths = limited(false_paths, 1e-4, 10.0);
        let profile = Profile::new(pulse.effective_duration_s(), &settings);
        let window_s = samples as f32 * sample_spacing_s;
        let bandwidth_window = pulse.rms_bandwidth_hz() * window_s;
        let known_threshold = detection_threshold(bandwidth_window, false_paths);
        let beginning = detection_threshold(bandwidth_window, BEGINNING_SHARE * false_paths);
        self.table.fill(&pulse, sample_spacing_s);
        self.pulse = pulse;
        self.sample_spacing_s = sample_spacing_s;
        self.profile = profile;
        self.threshold = fitted_threshold(&pulse, &profile, &COMPLEX_CUT, known_threshold);
        self.magnitude_threshold = fitted_threshold(&pulse, &profile, &MAGNITUDE_CUT, known_threshold);
        self.beginning_threshold = threshold_beside(fitted_samples(&pulse, &profile), beginning);
        self.settings = settings;
    }

    /// Threshold kappa on a path's normalised energy in such samples, where their noise is Gaussian.
    pub fn threshold(&self, samples: &Samples<'_>) -> f32 {
        match samples {
            Samples::Complex(_) => self.threshold,
            Samples::Magnitude(_) => self.magnitude_threshold,
        }
    }

    /// Estimates the paths of a frame whose first sample stands for a delay of `first_sample_delay_s`; none where
    /// nothing stands out of the noise.
    ///
    /// # Errors
    /// What is wrong with the samples.
    pub fn estimate(
        &self,
        samples: Samples<'_>,
        first_sample_delay_s: f32,
    ) -> Result<ChannelEstimate<PATHS>, SampleFault> {
        self.estimate_within(samples, first_sample_delay_s, MOST_WORK)
    }

    /// [`Self::estimate`], ended where looking for paths has cost this much ([`work`]; [`MOST_WORK`] otherwise).
    ///
    /// # Errors
    /// What is wrong with the samples.
    pub fn estimate_within(
        &self,
        samples: Samples<'_>,
        first_sample_delay_s: f32,
        most_work: u32,
    ) -> Result<ChannelEstimate<PATHS>, SampleFault> {
        samples.check()?;
        Ok(self.estimate_checked(samples, first_sample_delay_s, most_work))
    }

    /// [`Self::estimate_within`] of samples that passed [`Samples::check`].
    pub(crate) fn estimate_checked(
        &self,
        samples: Samples<'_>,
        first_sample_delay_s: f32,
        most_work: u32,
    ) -> ChannelEstimate<PATHS> {
        match samples {
            Samples::Complex(samples) => self.estimate_complex(samples, first_sample_delay_s, most_work),
            Samples::Magnitude(samples) => self.estimate_magnitude(samples, first_sample_delay_s, most_work),
        }
    }

    /// The beginning of an estimate: its noise.
    fn without_paths(&self, noise: NoiseLevel) -> ChannelEstimate<PATHS> {
        ChannelEstimate {
            paths: Vec::new(),
            noise,
            dense: DenseMultipath::default(),
            threshold: 0.0,
            work: 0,
            cut_short: false,
        }
    }

    /// The dense multipath as a whole of a frame's noise.
    fn dense_multipath(&self, noise: &NoiseLevel, first_sample_delay_s: f32) -> DenseMultipath {
        let effective_s = self.pulse.effective_duration_s();
        noise.dense_multipath(first_sample_delay_s, self.sample_spacing_s, effective_s)
    }

    /// A path at `position` samples into the frame.
    fn path(&self, position: f32, first_sample_delay_s: f32, amplitude: Complex, sinr: f32) -> Path {
        let sinr = limited(sinr, LEAST_SINR, MOST_SINR);
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

/// What a level fitted to such samples is cut off at.
fn cut_of(samples: &Samples<'_>) -> &'static Cut {
    match samples {
        Samples::Complex(_) => &COMPLEX_CUT,
        Samples::Magnitude(_) => &MAGNITUDE_CUT,
    }
}

/// kappa where the level is fitted to n samples: a peak lifts the level under it, and the level's own errors add.
fn fitted_threshold(pulse: &Pulse, profile: &Profile, cut: &Cut, threshold: f32) -> f32 {
    threshold / (1.0 + cut.self_share / fitted_samples(pulse, profile))
}

/// Independent samples that a level is fitted to.
fn fitted_samples(pulse: &Pulse, profile: &Profile) -> f32 {
    profile.length_s() / pulse.effective_duration_s()
}

written!(EstimatorSettings { dense_decay_s, dense_decay_pulses, merge_pulses, begins_with_path });

written!(ChannelEstimator<const PATHS> {
    pulse,
    table,
    interpolation,
    sample_spacing_s,
    profile,
    threshold,
    magnitude_threshold,
    beginning_threshold,
    settings
});

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_threshold_follows_the_false_path_rate() {
        let pulse = Pulse::root_raised_cosine(0.5e-9, 0.6);
        let bandwidth_window = pulse.rms_bandwidth_hz() * 100e-9;
        for (rate, kappa) in [(5.0, 4.57), (1.0, 6.34), (0.1, 8.81), (0.01, 11.23)] {
            assert!((detection_threshold(bandwidth_window, rate) - kappa).abs() < 0.01, "{rate}");
        }
    }
}
