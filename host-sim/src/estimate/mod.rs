//! Estimation: the frames of a recording through the core's channel estimator, and what its paths are worth.

pub mod link;
pub mod registration;
pub mod spread;
pub mod summary;
pub mod truth;

use crate::input_error::InputError;
use crate::recording::{ARRAYS_FILE, Cycle, Frame, META_FILE, Recording, Samples};
use crate::replay::{PATHS, pulse_shape};
use cogmint_core::model::observation::{self, SampleFault};
use cogmint_core::perceptor::channel_estimator::{
    self, ChannelEstimate, ChannelEstimator, EstimatorSettings, FirstPathDetector,
};
use cogmint_core::radio::pulse::{Pulse, PulseTable};
use rayon::prelude::*;
use serde::Serialize;
use std::path::Path;

/// Speed of light, metres per second.
pub(crate) const SPEED_OF_LIGHT_M_S: f64 = 299_792_458.0;

/// Below this SINR a true path tells no level: its power is lost in rounding.
const LEAST_SINR: f64 = 1e-6;

/// Which frames are estimated, and how.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Paths found per frame of pure noise, on average: 1e-4 to 10.
    pub false_paths: f64,
    /// First cycle, counted from 0.
    pub from: usize,
    /// Cycles from there on, at most.
    pub cycles: usize,
    /// One anchor alone, counted from 0.
    pub anchor: Option<usize>,
}

/// One estimated path.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct EstimatedPath {
    /// Delay, seconds.
    pub delay_s: f64,
    /// Length, metres.
    pub range_m: f64,
    /// Standard deviation of the delay that the estimator states, seconds.
    pub delay_std_s: f64,
    /// Amplitude at the matched filter's output: real and imaginary part, in the unit of the samples.
    pub amplitude: [f64; 2],
    /// Component SINR, decibels.
    pub sinr_db: f64,
}

impl EstimatedPath {
    fn new(path: &channel_estimator::Path) -> Self {
        let delay_s = f64::from(path.delay_s);
        Self {
            delay_s,
            range_m: delay_s * SPEED_OF_LIGHT_M_S,
            delay_std_s: f64::from(path.delay_variance_s2).sqrt(),
            amplitude: path.amplitude.map(f64::from),
            sinr_db: 10.0 * f64::from(path.sinr).log10(),
        }
    }

    /// |amplitude|^2.
    pub fn power(&self) -> f64 {
        let [re, im] = self.amplitude;
        re * re + im * im
    }
}

/// The first path of a frame, by its leading edge.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct FirstPath {
    /// Delay, seconds.
    pub delay_s: f64,
    /// Length, metres.
    pub range_m: f64,
    /// Standard deviation that the noise gives the delay, seconds.
    pub delay_std_s: f64,
    /// Magnitude at the response's first maximum, in the unit of the samples.
    pub magnitude: f64,
    /// Its energy over that of the noise ahead, decibels.
    pub snr_db: f64,
}

/// What was found in one frame, and what is known of it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct EstimatedFrame {
    /// Index of the cycle.
    pub cycle: usize,
    /// Index of the anchor.
    pub anchor: usize,
    /// True distance from anchor to tag, metres.
    pub true_range_m: Option<f64>,
    /// The radio's own range, metres, where the cycle has one of this anchor.
    pub radio_range_m: Option<f64>,
    /// Delay at which the radio itself saw the first path, on the frame's axis of delay, seconds.
    pub radio_first_path_s: Option<f64>,
    /// Whether the direct path is free, where known.
    pub line_of_sight: Option<bool>,
    /// Power of the white noise, in squared units of the samples.
    pub white_noise: f64,
    /// Power of the dense multipath: integral of its profile, in squared units of the samples.
    pub dense_power: f64,
    /// Its mean delay, seconds.
    pub dense_mean_delay_s: f64,
    /// Its root mean square delay spread, seconds.
    pub dense_rms_delay_spread_s: f64,
    /// Energy of the frame without its paths over that with them; magnitudes have none.
    pub residual_share: Option<f64>,
    /// The share of the frame's energy that is white noise.
    pub noise_share: f64,
    /// Level of noise and dense multipath over the true one, at each true path in the frame.
    pub level_ratios: Vec<f64>,
    /// Where the response begins.
    pub first_path: Option<FirstPath>,
    /// The paths, by delay.
    pub paths: Vec<EstimatedPath>,
}

/// Estimates the chosen frames of a recording, in order; `folder` is where it is, for messages. `progress` is called
/// after every frame.
///
/// # Errors
/// No such cycle, anchor or frame, or frames that the core does not take.
pub fn estimate(
    recording: &Recording,
    folder: &Path,
    options: &Options,
    progress: impl Fn() + Sync,
) -> Result<Vec<EstimatedFrame>, InputError> {
    estimate_told(recording, folder, options, &progress)
}

/// Not generic: compiled here once, not again in every crate that calls it.
fn estimate_told(
    recording: &Recording,
    folder: &Path,
    options: &Options,
    progress: &(dyn Fn() + Sync),
) -> Result<Vec<EstimatedFrame>, InputError> {
    let chosen = chosen_frames(recording, folder, options)?;
    let spacing_s = checked_spacing_s(recording, folder, chosen[0].2.samples.len())?;
    let stages: Vec<Stage> = recording
        .actions
        .iter()
        .map(|action| {
            let shape = pulse_shape(&recording.radio);
            let duration_s = action.pulse_duration_s as f32;
            let pulse = Pulse { duration_s, shape }.sampled_every(spacing_s as f32);
            let begins = recording.radio.begins_with_path;
            Stage::new(&pulse, spacing_s, chosen[0].2.samples.len(), begins, options)
        })
        .collect();
    let found = chosen.par_iter().map(|&(index, cycle, frame)| {
        let found = stages[frame.action].frame(recording, index, cycle, frame);
        progress();
        found.map_err(|fault| {
            let name = &recording.anchors[frame.anchor].name;
            let reason = format!("holds no frame to estimate from in cycle {index}, {name}: {fault}");
            InputError::new(folder.join(ARRAYS_FILE), reason)
        })
    });
    found.collect()
}

/// The number of frames that [`estimate`] would estimate.
///
/// # Errors
/// No such cycle, anchor or frame.
pub fn count(recording: &Recording, folder: &Path, options: &Options) -> Result<usize, InputError> {
    chosen_frames(recording, folder, options).map(|chosen| chosen.len())
}

fn chosen_frames<'a>(
    recording: &'a Recording,
    folder: &Path,
    options: &Options,
) -> Result<Vec<(usize, &'a Cycle, &'a Frame)>, InputError> {
    let cycles = recording.cycles.len();
    if options.from >= cycles {
        let reason = format!("has no cycle {}", options.from);
        return Err(InputError::new(folder, reason).allowed(format!("0 to {}", cycles - 1)));
    }
    let anchors = recording.anchors.len();
    if let Some(anchor) = options.anchor.filter(|&anchor| anchor >= anchors) {
        let reason = format!("has no anchor {anchor}");
        return Err(InputError::new(folder, reason).allowed(format!("0 to {}", anchors - 1)));
    }
    let wanted = |frame: &&Frame| options.anchor.is_none_or(|anchor| frame.anchor == anchor);
    let cycles = recording.cycles.iter().enumerate().skip(options.from).take(options.cycles);
    let chosen: Vec<_> = cycles
        .flat_map(|(index, cycle)| cycle.frames.iter().filter(wanted).map(move |frame| (index, cycle, frame)))
        .collect();
    if chosen.is_empty() {
        let reason = "holds no such frame: there is nothing to estimate";
        return Err(InputError::new(folder.join(ARRAYS_FILE), reason).for_item("frame_cycle"));
    }
    Ok(chosen)
}

/// The sample spacing, if the core takes it, the pulses and frames of `samples` samples.
fn checked_spacing_s(recording: &Recording, folder: &Path, samples: usize) -> Result<f64, InputError> {
    let refuse = |file: &str, item: &str, value: String, allowed: &str| {
        Err(InputError::new(folder.join(file), format!("is {value}, which the estimator does not take"))
            .for_item(item)
            .allowed(allowed))
    };
    if !(16..=4096).contains(&samples) {
        let item = "frame_samples or frame_magnitude";
        return refuse(ARRAYS_FILE, item, format!("{samples} samples long"), "16 to 4096 samples");
    }
    let spacing_s = recording.radio.sample_spacing_s.unwrap_or(f64::NAN);
    if !(1e-11..=1e-8).contains(&spacing_s) {
        return refuse(META_FILE, "radio.sample_spacing_s", format!("{spacing_s:e}"), "1e-11 to 1e-8");
    }
    for (index, action) in recording.actions.iter().enumerate() {
        let duration_s = action.pulse_duration_s;
        if !(1e-10..=1e-8).contains(&duration_s) {
            let item = format!("actions.{index}.pulse_duration_s");
            return refuse(META_FILE, &item, format!("{duration_s:e}"), "1e-10 to 1e-8");
        }
    }
    Ok(spacing_s)
}

/// The estimator of one pulse.
struct Stage {
    estimator: ChannelEstimator<PATHS>,
    first_path: FirstPathDetector,
    table: PulseTable,
    spacing_s: f64,
}

impl Stage {
    fn new(pulse: &Pulse, spacing_s: f64, samples: usize, begins_with_path: bool, options: &Options) -> Self {
        let spacing = spacing_s as f32;
        Self {
            estimator: ChannelEstimator::new(
                *pulse,
                spacing,
                samples,
                options.false_paths as f32,
                EstimatorSettings { begins_with_path, ..EstimatorSettings::default() },
            ),
            first_path: FirstPathDetector::new(pulse, spacing, options.false_paths as f32),
            table: PulseTable::new(pulse, spacing),
            spacing_s,
        }
    }

    fn frame(
        &self,
        recording: &Recording,
        index: usize,
        cycle: &Cycle,
        frame: &Frame,
    ) -> Result<EstimatedFrame, SampleFault> {
        let samples = match &frame.samples {
            Samples::Complex(samples) => observation::Samples::Complex(samples),
            Samples::Magnitude(samples) => observation::Samples::Magnitude(samples),
        };
        // Delays count from the first sample while they are single precision: that of a late frame would be coarse.
        let estimate = self.estimator.estimate(samples, 0.0)?;
        let first_path = self.first_path.detect(samples, 0.0).map(|first| {
            let delay_s = frame.first_sample_delay_s + f64::from(first.delay_s);
            FirstPath {
                delay_s,
                range_m: delay_s * SPEED_OF_LIGHT_M_S,
                delay_std_s: f64::from(first.delay_variance_s2).sqrt(),
                magnitude: first.magnitude.into(),
                snr_db: 10.0 * f64::from(first.snr).log10(),
            }
        });
        let mut paths: Vec<_> = estimate.paths.iter().collect();
        paths.sort_by(|a, b| a.delay_s.total_cmp(&b.delay_s));
        let energy = energy(&frame.samples);
        let white_noise = f64::from(estimate.noise.white);
        let mut ranges = cycle.ranges.iter().filter(|range| range.anchor == frame.anchor);
        Ok(EstimatedFrame {
            cycle: index,
            anchor: frame.anchor,
            true_range_m: true_range_m(recording, cycle, frame.anchor),
            // Of several ranges nobody knows which one is the direct path's.
            radio_range_m: ranges.next().filter(|_| ranges.next().is_none()).map(|range| range.range_m),
            radio_first_path_s: frame
                .first_path_index
                .map(|index| frame.first_sample_delay_s + index * self.spacing_s),
            line_of_sight: frame.line_of_sight.or_else(|| sees_direct_path(recording, cycle, frame.anchor)),
            white_noise,
            dense_power: f64::from(estimate.dense.power),
            dense_mean_delay_s: frame.first_sample_delay_s + f64::from(estimate.dense.mean_delay_s),
            dense_rms_delay_spread_s: f64::from(estimate.dense.rms_delay_spread_s),
            residual_share: self.residual_energy(&frame.samples, &estimate).map(|left| left / energy),
            noise_share: white_noise * frame.samples.len() as f64 / energy,
            level_ratios: self.level_ratios(cycle, frame, &estimate),
            first_path,
            paths: paths
                .into_iter()
                .map(|path| {
                    let mut path = EstimatedPath::new(path);
                    path.delay_s += frame.first_sample_delay_s;
                    path.range_m = path.delay_s * SPEED_OF_LIGHT_M_S;
                    path
                })
                .collect(),
        })
    }

    /// The fitted level over the true one, which is a path's power over its SINR, at the frame's true paths.
    fn level_ratios(&self, cycle: &Cycle, frame: &Frame, estimate: &ChannelEstimate<PATHS>) -> Vec<f64> {
        let samples = frame.samples.len() as f64;
        let own =
            cycle.truth_paths.iter().filter(|path| path.anchor == frame.anchor && path.sinr > LEAST_SINR);
        own.filter_map(|path| {
            let position = (path.delay_s - frame.first_sample_delay_s) / self.spacing_s;
            let truth = path.magnitude * path.magnitude / path.sinr;
            let level = f64::from(estimate.noise.level(position as f32, self.spacing_s as f32));
            (position >= 0.0 && position < samples).then_some(level / truth)
        })
        .collect()
    }

    /// Energy that is left of complex samples without the paths.
    fn residual_energy(&self, samples: &Samples, estimate: &ChannelEstimate<PATHS>) -> Option<f64> {
        let Samples::Complex(samples) = samples else { return None };
        let left = samples.iter().enumerate().map(|(n, sample)| {
            let [mut re, mut im] = sample.map(f64::from);
            for path in &estimate.paths {
                let position = path.delay_s / self.spacing_s as f32;
                let pulse = f64::from(self.table.at(n as f32 - position));
                re -= pulse * f64::from(path.amplitude[0]);
                im -= pulse * f64::from(path.amplitude[1]);
            }
            re * re + im * im
        });
        Some(left.sum())
    }
}

fn energy(samples: &Samples) -> f64 {
    let parts = match samples {
        Samples::Complex(samples) => samples.as_flattened(),
        Samples::Magnitude(samples) => samples,
    };
    parts.iter().map(|&part| f64::from(part) * f64::from(part)).sum()
}

/// Distance from anchor to tag; horizontal where the tag's height is not known.
fn true_range_m(recording: &Recording, cycle: &Cycle, anchor: usize) -> Option<f64> {
    let [x, y] = cycle.truth_position_m?;
    let anchor = recording.anchors.get(anchor)?;
    let up = cycle.tag_height_m.map_or(0.0, |height_m| height_m - anchor.height_m);
    let [anchor_x, anchor_y] = anchor.position_m;
    Some((x - anchor_x).hypot(y - anchor_y).hypot(up))
}

/// Whether the anchor's direct path is among the true ones, where those are known at all.
fn sees_direct_path(recording: &Recording, cycle: &Cycle, anchor: usize) -> Option<bool> {
    let known = recording.cycles.iter().any(|cycle| !cycle.truth_paths.is_empty());
    known.then(|| cycle.truth_paths.iter().any(|path| path.anchor == anchor && path.virtual_anchor.is_none()))
}
