//! Recordings: what a tag measured over time, and what is known about where and how.
//!
//! A recording is a folder with two files. `recording.toml` says what it means (motion, start, anchors, radio,
//! carriers), `recording.npz` holds the arrays, readable by `numpy.load`. `docs/recording-format.md` lists every key
//! with its unit and allowed range; here are the arrays, for N cycles, R ranges, F frames and S samples per frame:
//!
//! | array | type and shape | meaning |
//! | --- | --- | --- |
//! | `cycle_time_s` | float64 `[N]` | time of each cycle, strictly increasing |
//! | `truth_position_m` | float64 `[N, 2]` | optional: true horizontal position of the tag; NaN in the cycles where nobody knew it |
//! | `tag_height_m` | float64 `[N]` | optional: height of the tag, in the frame of the anchors' heights |
//! | `tag_height_std_m` | float64 `[N]` | optional, beside it: its standard deviation |
//! | `cycle_antenna` | uint8 `[N]` | index of the antenna that the cycle was measured with; where there are `antennas` |
//! | `range_cycle` | uint32 `[R]` | index of the cycle that the range belongs to |
//! | `range_anchor` | uint8 `[R]` | index of its anchor |
//! | `range_m` | float64 `[R]` | length of a path, unordered within an anchor and cycle |
//! | `range_std_m` | float64 `[R]` | optional: standard deviation of each range; no NaN |
//! | `range_departure_angle_rad` | float64 `[R]` | optional: direction in which the path leaves the anchor, from the anchor's own heading |
//! | `range_arrival_angle_rad` | float64 `[R]` | beside it: direction from which it reaches the tag, from the tag's own heading |
//! | `frame_cycle` | uint32 `[F]` | index of the cycle that the frame belongs to |
//! | `frame_anchor` | uint8 `[F]` | index of its anchor; at most one frame per anchor and cycle |
//! | `frame_action` | uint16 `[F]` | index of the action (carrier and pulse) it was sent with |
//! | `frame_first_sample_delay_s` | float64 `[F]` | delay after transmission that the first sample shows; may be negative |
//! | `frame_samples` | complex64 `[F, S]` | complex baseband samples, or |
//! | `frame_magnitude` | float32 `[F, S]` | magnitudes, from radios that give no phase |
//! | `frame_first_path_index` | float64 `[F]` | optional: sample at which the radio itself saw the first path |
//! | `frame_line_of_sight` | uint8 `[F]` | optional truth: 1 where the direct path is free, 0 where it is not |
//! | `truth_path_cycle` | uint32 `[P]` | index of the cycle in which a true path existed |
//! | `truth_path_anchor` | uint8 `[P]` | index of its anchor |
//! | `truth_path_virtual_anchor` | uint16 `[P]` | index of its virtual anchor; 65535: the direct path |
//! | `truth_path_delay_s` | float64 `[P]` | its delay |
//! | `truth_path_magnitude` | float64 `[P]` | its peak in a frame, in the unit of the samples |
//! | `truth_path_sinr` | float64 `[P]` | its power over noise, dense multipath and interference |
//!
//! All `range_` arrays are absent when there are no ranges, all `frame_` arrays when there are no frames, all
//! `truth_path_` arrays when no true paths are known. Arrays and keys that are not listed are refused: a misspelt name
//! would otherwise lose data silently. Optional arrays cover all cycles (or ranges) or none.
//!
//! [`Recording::read`] and [`Recording::write`] apply the same checks, so that what was written can be read.

mod check;
pub(crate) mod npz;
mod plan;
mod read;
mod write;

use serde::{Deserialize, Serialize};

pub use crate::input_error::InputError;
pub(crate) use plan::off_line_m;
pub use plan::{
    LINE_TOLERANCE_M, MAX_PLAN_SEGMENTS, MAX_PLAN_WALLS, MAX_SEQUENCE, Plan, PlanWall, USUAL_TURN_STD_DEG,
    WallSequence,
};

/// The version of the format that this crate reads and writes: the key `format` of `recording.toml`.
pub const FORMAT: u32 = 1;
/// The name of the file that says what a recording means.
pub const META_FILE: &str = "recording.toml";
/// The name of the file that holds the arrays.
pub const ARRAYS_FILE: &str = "recording.npz";
/// The virtual anchor of a direct path in `truth_path_virtual_anchor`.
const DIRECT_PATH: u16 = u16::MAX;
/// No recording has more anchors than this.
pub const MAX_ANCHORS: usize = 64;
/// No body has more antennas than this.
pub const MAX_ANTENNAS: usize = 16;
/// No recording has more cycles than this; at 10 per second they take 116 hours.
pub const MAX_CYCLES: usize = 1 << 22;
/// No recording has more ranges than this.
pub const MAX_RANGES: usize = 1 << 24;
/// No recording has more frames than this.
pub const MAX_FRAMES: usize = 1 << 22;
/// No recording knows more true paths than this.
pub const MAX_TRUTH_PATHS: usize = 1 << 25;
/// No frame has more samples than this.
pub const MAX_SAMPLES: usize = 1 << 16;

/// Everything about one run of one tag.
#[derive(Clone, Debug, PartialEq)]
pub struct Recording {
    /// A short name, for tables and figures.
    pub name: String,
    /// Where the data come from and how they were made, for people.
    pub source: String,
    /// How the tag moves.
    pub motion: Motion,
    /// What is known of the tag's first position and velocity.
    pub start: Start,
    /// How paths are detected and missed.
    pub association: AssociationModel,
    /// The radio and its errors.
    pub radio: Radio,
    /// The physical anchors; their positions are known.
    pub anchors: Vec<Anchor>,
    /// Mirror images of the anchors. All serve as truth for scoring; the known ones are given to the tracker.
    pub virtual_anchors: Vec<VirtualAnchor>,
    /// The antennas of a body that has several, which take turns; empty where the tag is its own only antenna.
    pub antennas: Vec<Antenna>,
    /// The carriers and pulses that frames were sent with. At least one when there are frames.
    pub actions: Vec<Action>,
    /// Walls of the room, each from end to end, for figures.
    pub walls: Vec<[[f64; 2]; 2]>,
    /// The floor plan that the tracker is told, if it is told of walls.
    pub plan: Option<Plan>,
    /// The measurements, in order of time.
    pub cycles: Vec<Cycle>,
}

/// How the tag moves. One of the first two is there.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Motion {
    /// Standard deviation of an acceleration per axis that is constant within a usual cycle, in m/s^2. Larger follows turns,
    /// smaller smooths.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub acceleration_std_m_s2: Option<f64>,
    /// Spectral density of the white acceleration per axis, in m^2/s^3, whatever the cycles are.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub acceleration_density_m2_s3: Option<f64>,
    /// Time constant with which a velocity decays, in seconds; infinite: constant velocity. The tracker's own when absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub velocity_decay_s: Option<f64>,
}

impl Motion {
    /// Of an acceleration that is constant within a usual cycle.
    pub const fn of_acceleration(acceleration_std_m_s2: f64) -> Self {
        Self {
            acceleration_std_m_s2: Some(acceleration_std_m_s2),
            acceleration_density_m2_s3: None,
            velocity_decay_s: None,
        }
    }

    /// The same, of a velocity that does not decay: the published model.
    pub const fn published(acceleration_std_m_s2: f64) -> Self {
        Self { velocity_decay_s: Some(f64::INFINITY), ..Self::of_acceleration(acceleration_std_m_s2) }
    }
}

/// Density of a white acceleration, m^2/s^3, that changes the velocity over a cycle of `period_s` seconds as much as one of
/// this deviation that is constant within it.
pub fn density_m2_s3(acceleration_std_m_s2: f64, period_s: f64) -> f64 {
    acceleration_std_m_s2 * acceleration_std_m_s2 * period_s
}

impl Recording {
    /// Median time from cycle to cycle, seconds.
    pub fn usual_period_s(&self) -> f64 {
        usual_period_s(self.cycles.iter().map(|cycle| cycle.time_s))
    }

    /// Density of the tag's white acceleration, m^2/s^3: that told, or that of the acceleration told over a usual cycle.
    pub fn acceleration_density_m2_s3(&self) -> f64 {
        let Motion { acceleration_std_m_s2, acceleration_density_m2_s3, .. } = self.motion;
        let of_deviation = |std_m_s2| density_m2_s3(std_m_s2, self.usual_period_s());
        // One is there, as the checks saw.
        acceleration_density_m2_s3.or(acceleration_std_m_s2.map(of_deviation)).unwrap_or(0.0)
    }
}

/// Median time, seconds, from one of these times to the next; 1 where there is but one.
pub fn usual_period_s(times_s: impl Iterator<Item = f64> + Clone) -> f64 {
    let mut periods_s: Vec<f64> =
        times_s.clone().skip(1).zip(times_s).map(|(now, then)| now - then).collect();
    periods_s.sort_by(f64::total_cmp);
    periods_s.get(periods_s.len() / 2).copied().unwrap_or(1.0)
}

/// The prior of the first position and velocity.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Start {
    /// Mean of the first position, in metres.
    pub position_m: [f64; 2],
    /// Standard deviation of the first position per axis, in metres.
    pub position_std_m: f64,
    /// Standard deviation of the first velocity per axis, in m/s; its mean is zero.
    pub velocity_std_m_s: f64,
    /// When present, a run with a seed draws its start uniformly inside a disc of this radius.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub disc_radius_m: Option<f64>,
    /// The place about which a run with a seed draws its start, in metres; without, about the mean. A simulation draws
    /// the mean itself, and what is drawn twice would be further off than the prior says.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub drawn_about_m: Option<[f64; 2]>,
}

/// How paths are detected, missed and invented.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AssociationModel {
    /// Probability that the path of a visible anchor or virtual anchor is among the ranges.
    pub detection_probability: f64,
    /// Mean number of false ranges per anchor and cycle.
    pub clutter_per_anchor: f64,
    /// False ranges are uniform from zero to this, in metres.
    pub max_range_m: f64,
}

/// The radio and the errors of its ranges.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Radio {
    /// Duration Tp of the root-raised-cosine pulse, in seconds.
    pub pulse_duration_s: f64,
    /// Roll-off of the pulse, 0 to 1; of a sampled one, the roll-off that has its rms bandwidth.
    pub roll_off: f64,
    /// The pulse behind the matched filter, where it is no root-raised-cosine.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sampled_pulse: Option<SampledPulse>,
    /// Time between two samples of a frame, in seconds. Required when there are frames.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sample_spacing_s: Option<f64>,
    /// Whether the receiver scaled every frame as it liked (automatic gain control).
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub gain_control: bool,
    /// Whether dense multipath begins with a path.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub begins_with_path: bool,
    /// Standard deviation of the ranges that carry none of their own, in metres.
    pub range_std_m: f64,
    /// Prior mean of the bias that all ranges of an anchor share, in metres.
    pub range_bias_mean_m: f64,
    /// Prior standard deviation of that bias, in metres; zero means that no bias is estimated.
    pub range_bias_std_m: f64,
    /// By how much ranges are too long on average whose direct path is blocked, in metres, as assumed at the start; zero means that
    /// none is.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub range_late_m: f64,
    /// Standard deviation that no path's range goes below, pulse lengths; without it, the tracker's own. 0 where all paths are
    /// known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub range_floor_pulses: Option<f64>,
}

#[allow(clippy::trivially_copy_pass_by_ref)] // as serde asks
fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

/// A pulse behind the matched filter, R(t), sampled from its middle on: what a radio shows of a cable.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SampledPulse {
    /// Time between two samples, in seconds.
    pub step_s: f64,
    /// R at lags of 0, 1, 2, ... steps: 33 values, the first 1.
    pub autocorrelation: Vec<f64>,
}

/// A physical anchor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Anchor {
    /// Its name, unique in the recording.
    pub name: String,
    /// Its horizontal position, in metres.
    pub position_m: [f64; 2],
    /// Its height, in metres.
    pub height_m: f64,
    /// Prior mean of the bias of its ranges, in metres; without, that of the radio.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub range_bias_mean_m: Option<f64>,
    /// Its prior standard deviation, in metres; without, that of the radio.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub range_bias_std_m: Option<f64>,
}

impl Anchor {
    /// An anchor whose bias is as the radio's.
    pub fn new(name: impl Into<String>, position_m: [f64; 2], height_m: f64) -> Self {
        Self { name: name.into(), position_m, height_m, range_bias_mean_m: None, range_bias_std_m: None }
    }
}

/// One of several antennas on one body.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Antenna {
    /// Its name, unique in the recording.
    pub name: String,
    /// Where it sits on the body: horizontal offset from the body's centre in metres, along axes that turn with the
    /// body.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lever_arm_m: Option<[f64; 2]>,
}

/// A mirror image of an anchor.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VirtualAnchor {
    /// Index of the anchor that it mirrors.
    pub anchor: usize,
    /// Its horizontal position, in metres.
    pub position_m: [f64; 2],
    /// Standard deviation of that position per axis, in metres. Positive for a known one, else unused.
    pub std_m: f64,
    /// Whether the tracker is told of it before it starts. An unknown one serves for scoring only.
    pub known: bool,
    /// Where the tracker is told that it is, in metres; without, at its position.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub told_position_m: Option<[f64; 2]>,
    /// Whether it is there. A mistake of the floor plan is not, and is no truth to score against.
    #[serde(default = "exists", skip_serializing_if = "is_true")]
    pub exists: bool,
    /// The walls of [`Recording::plan`] that reflect its paths, in order from the anchor outwards.
    #[serde(default, skip_serializing_if = "WallSequence::is_empty")]
    pub walls: WallSequence,
}

impl VirtualAnchor {
    /// One that is there: given to the tracker with the deviation `std_m`, or kept for scoring.
    pub fn new(anchor: usize, position_m: [f64; 2], std_m: f64, known: bool) -> Self {
        Self {
            anchor,
            position_m,
            std_m,
            known,
            told_position_m: None,
            exists: true,
            walls: WallSequence::default(),
        }
    }
}

fn exists() -> bool {
    true
}

fn is_true(value: &bool) -> bool {
    *value
}

/// What a frame was sent with.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Action {
    /// Carrier frequency, in hertz.
    pub carrier_hz: f64,
    /// Duration of the pulse, in seconds.
    pub pulse_duration_s: f64,
}

/// What was measured at one time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Cycle {
    /// The time, in seconds from any zero.
    pub time_s: f64,
    /// The true horizontal position of the tag (of a body with several antennas: of its centre), in metres, when
    /// somebody knew it.
    pub truth_position_m: Option<[f64; 2]>,
    /// The height of the tag (of the antenna in use), in metres.
    pub tag_height_m: Option<f64>,
    /// Its standard deviation, in metres; exact when absent. There only beside the height.
    pub tag_height_std_m: Option<f64>,
    /// Index of the antenna that everything in this cycle was measured with; there where the recording has antennas.
    pub antenna: Option<usize>,
    /// Lengths of paths, in any order; any number per anchor.
    pub ranges: Vec<Range>,
    /// Sampled channel responses; at most one per anchor.
    pub frames: Vec<Frame>,
    /// The paths that really existed, when somebody knew them.
    pub truth_paths: Vec<TruthPath>,
}

/// A path that really existed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TruthPath {
    /// Index of the anchor.
    pub anchor: usize,
    /// Index of the virtual anchor; none for the direct path.
    pub virtual_anchor: Option<usize>,
    /// Its delay, in seconds.
    pub delay_s: f64,
    /// The largest magnitude that it has in the frame, in the unit of the samples.
    pub magnitude: f64,
    /// Its power over that of noise, dense multipath and interference after the matched filter.
    pub sinr: f64,
}

/// The length of one path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    /// Index of the anchor.
    pub anchor: usize,
    /// The length, in metres.
    pub range_m: f64,
    /// Its standard deviation, in metres; [`Radio::range_std_m`] applies when absent.
    pub std_m: Option<f64>,
    /// Its directions, from radios that measure them. The tracker does not use them.
    pub angles: Option<Angles>,
}

/// The directions of one path, in radians, counter-clockwise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Angles {
    /// In which it leaves the anchor, relative to the anchor's own heading.
    pub departure_rad: f64,
    /// From which it reaches the tag, relative to the tag's own heading.
    pub arrival_rad: f64,
}

/// The sampled response of the channel to one pulse.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Index of the anchor.
    pub anchor: usize,
    /// Index of the action it was sent with.
    pub action: usize,
    /// The delay after transmission, in seconds, that the first sample shows. Negative when sampling began earlier.
    pub first_sample_delay_s: f64,
    /// Where the radio itself saw the first path, in samples from the first one; fractional.
    pub first_path_index: Option<f64>,
    /// Whether the direct path is free, when somebody knew it. Serves for scoring alone.
    pub line_of_sight: Option<bool>,
    /// The samples, [`Radio::sample_spacing_s`] apart.
    pub samples: Samples,
}

/// Samples of a frame. All frames of a recording have the same kind and length.
#[derive(Clone, Debug, PartialEq)]
pub enum Samples {
    /// Complex baseband, as pairs of real and imaginary part.
    Complex(Vec<[f32; 2]>),
    /// Magnitudes, from radios that give no phase.
    Magnitude(Vec<f32>),
}

impl Samples {
    /// The number of samples.
    pub fn len(&self) -> usize {
        match self {
            Self::Complex(samples) => samples.len(),
            Self::Magnitude(samples) => samples.len(),
        }
    }

    /// Whether there are no samples.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use std::path::PathBuf;
    use std::sync::atomic::{AtomicU32, Ordering};

    use super::*;

    /// A small recording with everything in it.
    pub(crate) fn example() -> Recording {
        let action = Action { carrier_hz: 7e9, pulse_duration_s: 0.5e-9 };
        let anchor = |name: &str, x| Anchor::new(name, [x, 7.0], 1.5);
        let frame = |anchor| Frame {
            anchor,
            action: anchor,
            first_sample_delay_s: -1e-9,
            first_path_index: Some(1.25),
            line_of_sight: Some(anchor == 0),
            samples: Samples::Complex((0..5).map(|n| [n as f32, -0.5]).collect()),
        };
        Recording {
            name: "example".into(),
            source: "made for a test\nover two lines".into(),
            motion: Motion { velocity_decay_s: Some(2.5), ..Motion::of_acceleration(0.01) },
            start: Start {
                position_m: [3.0, 7.0],
                position_std_m: 0.25,
                velocity_std_m_s: 0.03,
                disc_radius_m: Some(0.5),
                drawn_about_m: Some([3.1, 7.1]),
            },
            association: AssociationModel {
                detection_probability: 0.95,
                clutter_per_anchor: 1.0,
                max_range_m: 30.0,
            },
            radio: Radio {
                pulse_duration_s: 0.5e-9,
                roll_off: 0.6,
                sampled_pulse: None,
                gain_control: false,
                begins_with_path: false,
                sample_spacing_s: Some(0.1e-9),
                range_std_m: 0.1,
                range_bias_mean_m: 0.0,
                range_bias_std_m: 0.0,
                range_late_m: 0.0,
                range_floor_pulses: Some(0.05),
            },
            anchors: vec![anchor("A", 0.5), anchor("B", 5.2)],
            walls: vec![[[0.0, 0.0], [6.0, 0.5]]],
            plan: Some(Plan {
                outline_m: vec![[0.0, 0.0], [6.0, 0.0], [6.0, 9.0]],
                turn_std_rad: 0.02,
                reflections: 1,
                most_sources: 12,
                walls: vec![
                    PlanWall {
                        segments_m: vec![[[0.0, 0.0], [2.0, 0.0]], [[3.0, 0.0], [6.0, 0.0]]],
                        offset_std_m: 0.05,
                        rotation_std_rad: 0.01,
                        construction: "brick".into(),
                    },
                    PlanWall {
                        segments_m: vec![[[6.0, 0.0], [6.0, 9.0]]],
                        offset_std_m: 0.0,
                        rotation_std_rad: 0.0,
                        construction: "glass".into(),
                    },
                ],
            }),
            antennas: vec![
                Antenna { name: "left".into(), lever_arm_m: Some([0.0, 0.2]) },
                Antenna { name: "right".into(), lever_arm_m: None },
            ],
            virtual_anchors: vec![
                VirtualAnchor {
                    told_position_m: Some([-5.9, 2.2]),
                    exists: false,
                    walls: WallSequence::new(&[1, 0]).expect("are two"),
                    ..VirtualAnchor::new(1, [-5.8, 2.3], 0.01, true)
                },
                VirtualAnchor::new(0, [1.0, -7.0], 0.0, false),
            ],
            actions: vec![action, Action { carrier_hz: 6e9, ..action }],
            cycles: (0..3)
                .map(|step| Cycle {
                    time_s: f64::from(step) * 0.1,
                    truth_position_m: (step < 2).then(|| [3.0, 7.0 + f64::from(step) * 0.01]),
                    tag_height_m: Some(1.0),
                    tag_height_std_m: Some(0.2),
                    antenna: Some(step as usize % 2),
                    ranges: vec![
                        Range {
                            anchor: 1,
                            range_m: 3.3 + f64::from(step),
                            std_m: Some(0.1),
                            angles: Some(Angles { departure_rad: -0.5, arrival_rad: 0.25 * f64::from(step) })
                        };
                        2
                    ],
                    frames: if step == 1 { Vec::new() } else { vec![frame(1), frame(0)] },
                    truth_paths: vec![
                        TruthPath {
                            anchor: 0,
                            virtual_anchor: [None, Some(1), None][step as usize],
                            delay_s: 1e-8,
                            magnitude: 3.5,
                            sinr: 12.0
                        };
                        step as usize
                    ],
                })
                .collect(),
        }
    }

    /// A folder of this test's own, removed in the end.
    pub(crate) struct Folder(pub(crate) PathBuf);

    impl Folder {
        pub(crate) fn new() -> Self {
            static COUNT: AtomicU32 = AtomicU32::new(0);
            let count = COUNT.fetch_add(1, Ordering::Relaxed);
            let path = std::env::temp_dir().join(format!("cogmint-test-{}-{count}", std::process::id()));
            std::fs::create_dir_all(&path).expect("a temporary folder");
            Self(path)
        }
    }

    impl Drop for Folder {
        fn drop(&mut self) {
            let _ = std::fs::remove_dir_all(&self.0);
        }
    }
}
