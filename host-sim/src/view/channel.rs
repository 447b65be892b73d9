//! One cycle of a recording: the received signals with their true and estimated paths.

use crate::input_error::InputError;
use crate::plot::{ChannelFigure, ChannelPath, Picture};
use crate::recording::{ARRAYS_FILE, Cycle, Frame, Recording, Samples};
use crate::replay::{PATHS, pulse_shape};
use cogmint_core::Config;
use cogmint_core::model::observation;
use cogmint_core::model::observation::SampleFault;
use cogmint_core::perceptor::channel_estimator::{ChannelEstimator, EstimatorSettings, FirstPathDetector};
use cogmint_core::radio::pulse::Pulse;
use std::path::Path;

/// How much is shown before the first path and behind the last one, seconds.
const BEFORE_S: f64 = 30e-9;
const BEHIND_S: f64 = 100e-9;

/// The picture of a cycle at the tracker's own rate of false paths: a panel per anchor with a frame, or for `anchor`
/// alone. `folder` is where the recording is,
/// for messages.
///
/// # Errors
/// There is no such cycle or anchor, or nothing was received.
pub fn picture(
    recording: &Recording,
    folder: &Path,
    cycle: usize,
    anchor: Option<usize>,
) -> Result<Picture, InputError> {
    let false_paths = Config::default().radio.false_paths_per_frame;
    picture_at(recording, folder, cycle, anchor, false_paths)
}

/// The same at a given rate of false paths per frame.
pub(super) fn picture_at(
    recording: &Recording,
    folder: &Path,
    cycle: usize,
    anchor: Option<usize>,
    false_paths: f32,
) -> Result<Picture, InputError> {
    let Some(received) = recording.cycles.get(cycle) else {
        return Err(InputError::new(folder, format!("has no cycle {cycle}"))
            .allowed(format!("0 to {}", recording.cycles.len() - 1)));
    };
    if let Some(anchor) = anchor.filter(|&anchor| anchor >= recording.anchors.len()) {
        return Err(InputError::new(folder, format!("has no anchor {anchor}"))
            .allowed(format!("0 to {}", recording.anchors.len() - 1)));
    }
    let wanted = |frame: &&Frame| anchor.is_none_or(|anchor| frame.anchor == anchor);
    let mut panels = Vec::new();
    for frame in received.frames.iter().filter(wanted) {
        let panel = panel(recording, received, cycle, frame, false_paths).map_err(|fault| {
            let name = &recording.anchors[frame.anchor].name;
            InputError::new(
                folder.join(ARRAYS_FILE),
                format!("holds no frame to estimate from in cycle {cycle}, {name}: {fault}"),
            )
        })?;
        panels.push(vec![panel.into()]);
    }
    if panels.is_empty() {
        return Err(InputError::new(
            folder.join(ARRAYS_FILE),
            format!("holds no such frame in cycle {cycle}"),
        )
        .for_item("frame_cycle"));
    }
    Ok(Picture { rows: panels })
}

fn panel(
    recording: &Recording,
    received: &Cycle,
    cycle: usize,
    frame: &Frame,
    false_paths: f32,
) -> Result<ChannelFigure, SampleFault> {
    let spacing_s = recording.radio.sample_spacing_s.unwrap_or(recording.radio.pulse_duration_s);
    let action = &recording.actions[frame.action];
    let first_s = frame.first_sample_delay_s;
    let count = frame.samples.len();
    let (magnitude, samples): (Vec<f64>, _) = match &frame.samples {
        Samples::Complex(samples) => (
            samples.iter().map(|[re, im]| f64::from(*re).hypot(f64::from(*im))).collect(),
            observation::Samples::Complex(samples),
        ),
        Samples::Magnitude(samples) => {
            (samples.iter().map(|m| f64::from(*m)).collect(), observation::Samples::Magnitude(samples))
        }
    };
    let duration_s = action.pulse_duration_s as f32;
    let shape = pulse_shape(&recording.radio);
    let pulse = Pulse { duration_s, shape }.sampled_every(spacing_s as f32);
    let estimator = ChannelEstimator::<PATHS>::new(
        pulse,
        spacing_s as f32,
        count,
        false_paths,
        EstimatorSettings {
            begins_with_path: recording.radio.begins_with_path,
            ..EstimatorSettings::default()
        },
    );
    let estimate = estimator.estimate(samples, first_s as f32)?;
    let estimated = estimate.paths.iter().map(|path| {
        let [re, im] = path.amplitude.map(f64::from);
        ChannelPath { delay_s: f64::from(path.delay_s), magnitude: re.hypot(im), label: String::new() }
    });
    let estimated: Vec<ChannelPath> = estimated.collect();
    let level = |n: usize| f64::from(estimate.noise.level(n as f32, spacing_s as f32)).sqrt();
    let own_paths = received.truth_paths.iter().filter(|path| path.anchor == frame.anchor);
    let true_paths = own_paths.map(|path| ChannelPath {
        delay_s: path.delay_s,
        magnitude: path.magnitude,
        label: path.virtual_anchor.map_or_else(|| "direct".into(), |index| format!("VA {index}")),
    });
    let true_paths: Vec<ChannelPath> = true_paths.collect();
    let delay_s = |n: usize| first_s + n as f64 * spacing_s;
    // Radios log far more than holds a path, and what is found before the response begins is none.
    let first_path = FirstPathDetector::new(&pulse, spacing_s as f32, false_paths).detect(samples, 0.0);
    let begin_s = first_path.map_or(f64::NEG_INFINITY, |first| first_s + f64::from(first.delay_s) - BEFORE_S);
    let found = estimated.iter().filter(|path| path.delay_s > begin_s);
    let delays = || true_paths.iter().chain(found.clone()).map(|path| path.delay_s);
    let from_s = delays().fold(f64::INFINITY, f64::min) - BEFORE_S;
    let to_s = delays().fold(f64::NEG_INFINITY, f64::max) + BEHIND_S;
    let shown: Vec<usize> = match delays().next() {
        Some(_) => (0..count).filter(|&n| (from_s..to_s).contains(&delay_s(n))).collect(),
        None => (0..count).collect(),
    };
    Ok(ChannelFigure {
        title: format!(
            "{}, cycle {cycle}, anchor {}, {:.3} GHz",
            recording.name,
            recording.anchors[frame.anchor].name,
            action.carrier_hz * 1e-9
        ),
        delay_s: shown.iter().map(|&n| delay_s(n)).collect(),
        magnitude: shown.iter().map(|&n| magnitude[n]).collect(),
        noise_level: shown.iter().map(|&n| level(n)).collect(),
        true_paths,
        estimated_paths: estimated,
        unit: "sample units".into(),
        db: true,
    })
}
