//! Golden traces: the hash of every cycle, and the feed that makes the target compute the same.

use crate::input_error::InputError;
use crate::recording::Recording;
use crate::replay::{AnyTracker, CycleInput, PATHS, SMALL_ANCHORS, Setup, Step, inputs, step};
use cogmint_core::model::observation::{Observation, Samples, TagHeight};
use cogmint_core::radio::pulse::PulseShape;
use cogmint_core::{Error, Plan};
use std::path::Path;

/// Hash over all state after each cycle of a recording of at most two anchors, in the host's tracker.
///
/// # Errors
/// The recording has more anchors, or the core refuses its set-up.
pub fn trace(setup: &Setup, recording: &Recording, file: &Path) -> Result<Vec<Step>, InputError> {
    check_anchors(setup, file)?;
    replayed(setup.tracker::<SMALL_ANCHORS>(), recording, file)
}

/// The same in the tracker of the target.
///
/// # Errors
/// The recording has more anchors, virtual anchors or walls than it holds, or the core refuses its set-up.
pub fn trace_on_target(setup: &Setup, recording: &Recording, file: &Path) -> Result<Vec<Step>, InputError> {
    check_anchors(setup, file)?;
    replayed(setup.target_tracker(), recording, file)
}

fn check_anchors(setup: &Setup, file: &Path) -> Result<(), InputError> {
    if setup.anchors.len() > SMALL_ANCHORS {
        let reason = format!("has {} anchors, the target holds {SMALL_ANCHORS}", setup.anchors.len());
        return Err(InputError::new(file, reason));
    }
    Ok(())
}

/// All cycles of a recording in a fresh tracker.
fn replayed<const S: usize, const C: usize, const P: usize>(
    tracker: Result<Box<AnyTracker<SMALL_ANCHORS, S, C, P>>, Error>,
    recording: &Recording,
    file: &Path,
) -> Result<Vec<Step>, InputError> {
    let refused = |error: Error| InputError::new(file, error.to_string());
    let mut tracker = tracker.map_err(refused)?;
    inputs(recording).map(|input| step(&mut tracker, &input, &mut ()).map_err(refused)).collect()
}

/// The feed of a recording for the firmware, whose source documents the layout.
///
/// # Errors
/// The recording holds scans of more than 16 ranges, which the firmware has no room for.
pub fn feed(setup: &Setup, recording: &Recording, file: &Path) -> Result<Vec<u8>, InputError> {
    let mut feed = Feed::default();
    feed.word(u32::from_le_bytes(*b"COG5"));
    for count in [setup.anchors.len(), setup.map.len(), setup.actions.len(), recording.cycles.len()] {
        feed.count(count);
    }
    feed.word(setup.seed as u32);
    feed.word((setup.seed >> 32) as u32);
    let config = &setup.config;
    let [x, y] = config.start.position_m;
    for value in [
        config.motion.acceleration_density_m2_s3,
        config.motion.velocity_decay_s,
        x,
        y,
        config.start.position_std_m,
        config.start.velocity_std_m_s,
        config.association.detection_probability,
        config.association.clutter_per_anchor,
        config.ranging.max_range_m,
        config.ranging.bias_mean_m,
        config.ranging.bias_std_m,
        config.ranging.floor_pulses,
        config.ranging.late_m,
        config.radio.sample_spacing_s,
    ] {
        feed.float(value);
    }
    match &config.radio.pulse_shape {
        PulseShape::RootRaisedCosine { roll_off } => {
            feed.count(0);
            feed.float(*roll_off);
        }
        PulseShape::Sampled { step_s, autocorrelation } => {
            feed.count(autocorrelation.len());
            feed.float(*step_s);
            autocorrelation.iter().for_each(|r| feed.float(*r));
        }
    }
    feed.count(config.radio.samples_per_frame);
    feed.word(u32::from(config.radio.gain_control) | u32::from(config.estimator.begins_with_path) << 1);
    feed.word(u32::from(config.has_heading));
    feed.word(config.work.anchor);
    feed.word(u32::from(config.work.comparisons));
    feed.count(config.controller.first_action);
    feed.count(config.controller.planned_actions);
    for (anchor, [mean_m, std_m]) in setup.anchors.iter().zip(&setup.range_biases_m) {
        let [x, y] = anchor.position_m;
        [x, y, anchor.height_m, *mean_m, *std_m].into_iter().for_each(|value| feed.float(value));
    }
    for mapped in &setup.map {
        let [x, y] = mapped.position_m;
        feed.count(mapped.anchor);
        [x, y, mapped.std_m].into_iter().for_each(|value| feed.float(value));
    }
    feed.word(u32::from(setup.plan.is_some()));
    if let Some(plan) = setup.told().plan {
        feed.plan(&plan);
    }
    for action in &setup.actions {
        feed.float(action.carrier_hz);
        feed.float(action.pulse_duration_s);
    }
    for input in inputs(recording) {
        let is_long =
            |o: &Observation<'_>| matches!(o, Observation::Ranges(scan) if scan.ranges.len() > PATHS);
        if input.observations().iter().any(is_long) {
            let reason = format!(
                "holds more than {PATHS} ranges of an anchor in a cycle, the firmware has room for {PATHS}"
            );
            return Err(InputError::new(file, reason).for_item("range_anchor"));
        }
        feed.cycle(&input, input.arm_m(config));
    }
    Ok(feed.bytes)
}

/// Little-endian words.
#[derive(Default)]
struct Feed {
    bytes: Vec<u8>,
}

impl Feed {
    fn word(&mut self, word: u32) {
        self.bytes.extend(word.to_le_bytes());
    }

    fn count(&mut self, count: usize) {
        self.word(count as u32);
    }

    fn float(&mut self, value: f32) {
        self.word(value.to_bits());
    }

    fn plan(&mut self, plan: &Plan<'_>) {
        for count in [plan.outline_m.len(), plan.walls.len(), plan.segments.len()] {
            self.count(count);
        }
        self.float(plan.turn_std_rad);
        self.count(plan.reflections);
        self.count(plan.most_sources);
        plan.outline_m.iter().flatten().for_each(|value| self.float(*value));
        for wall in plan.walls {
            self.float(wall.offset_std_m);
            self.float(wall.rotation_std_rad);
        }
        for segment in plan.segments {
            self.count(segment.wall);
            segment.ends_m.iter().flatten().for_each(|value| self.float(*value));
        }
    }

    fn cycle(&mut self, input: &CycleInput<'_>, arm_m: [f32; 2]) {
        self.float(input.elapsed_s);
        self.word(u32::from(input.tag_height.is_some()));
        let TagHeight { mean_m, std_m } = input.tag_height.unwrap_or(TagHeight::exact(0.0));
        self.float(mean_m);
        self.float(std_m);
        arm_m.into_iter().for_each(|arm_m| self.float(arm_m));
        let observations = input.observations();
        let frames: Vec<_> = observations
            .iter()
            .filter_map(|observation| match observation {
                Observation::Frame(frame) => Some(frame),
                Observation::Ranges(_) => None,
            })
            .collect();
        self.count(frames.len());
        for frame in frames {
            self.count(frame.anchor);
            self.count(frame.action);
            self.float(frame.first_sample_delay_s);
            self.word(u32::from(matches!(frame.samples, Samples::Magnitude(_))));
            self.count(frame.samples.len());
            match frame.samples {
                Samples::Complex(samples) => samples.iter().flatten().for_each(|part| self.float(*part)),
                Samples::Magnitude(samples) => samples.iter().for_each(|value| self.float(*value)),
            }
        }
        let ranges: Vec<_> = observations
            .iter()
            .filter_map(|observation| match observation {
                Observation::Ranges(scan) => Some(scan.ranges.iter().map(|range| (scan.anchor, *range))),
                Observation::Frame(_) => None,
            })
            .flatten()
            .collect();
        self.count(ranges.len());
        for (anchor, range) in ranges {
            self.count(anchor);
            self.float(range.range_m);
            self.float(range.variance_m2);
        }
    }
}
