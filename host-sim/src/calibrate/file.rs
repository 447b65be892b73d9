//! The calibration as a file: what `cogmint track` takes, and constants for firmware.
//!
//! The tracker knows late ranges itself. It is told ranges without bias, their noise, the mean excess of late ones, how often a range
//! is false, anchors where they were found, and the pulse; the bias that it may still estimate has the deviation that the
//! calibration leaves. Paths in frames have no excess: they lose bias and peak offset.

use super::pulse::PulseEstimate;
use crate::cycle_choice::CycleChoice;
use crate::estimate::SPEED_OF_LIGHT_M_S;
use crate::input_error::InputError;
use crate::recording::{Radio, Recording};
use crate::toml_place;
use serde::{Deserialize, Serialize};
use std::fmt::Write;
use std::path::Path;

/// The version of the file's format.
pub const FORMAT: u32 = 1;
/// Anchors of the calibration and of a recording are the same where they are told this close to each other, metres.
const SAME_M: f64 = 1e-3;
/// Guard: the shortest range that is left of one that was shorter than its bias, metres.
const SHORTEST_M: f64 = 1e-3;
/// The largest excess that a recording may tell of, metres.
const LARGEST_EXCESS_M: f64 = 100.0;
/// The least deviation of a bias that the tracker estimates, metres: below, it estimates none.
const LEAST_BIAS_STD_M: f64 = 1e-3;

/// A calibration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Calibration {
    /// Version of the format.
    pub format: u32,
    /// Names of the recordings that it is from.
    pub recordings: Vec<String>,
    /// The cycles of theirs that were looked at.
    pub cycles: CycleChoice,
    /// Whether the truth was known.
    pub with_truth: bool,
    /// What cannot be known from these recordings, in sentences.
    pub unknown: Vec<String>,
    /// What errors of ranges look like.
    pub errors: Errors,
    /// The anchors, in the recordings' order.
    pub anchors: Vec<AnchorCalibration>,
    /// The antennas, where the recordings have several.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub antennas: Vec<AntennaCalibration>,
    /// The pulse, where frames show it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pulse: Option<PulseEstimate>,
}

/// What errors of ranges look like: noise, a share of them with an exponential excess, a share false.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Errors {
    /// Ranges that were looked at.
    pub ranges: usize,
    /// Mean of an excess, metres.
    pub excess_m: f64,
    /// Share of false ranges.
    pub false_share: f64,
    /// Whether the ranges are the radio's own first paths, one per anchor and cycle: only then the tracker is told of their errors.
    pub are_first_paths: bool,
    /// Mean probability of a range that it has an excess or is false.
    pub suspicious_share: f64,
}

/// What is known of an anchor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AnchorCalibration {
    /// Its name.
    pub name: String,
    /// Where it was told to be, metres.
    pub told_position_m: [f64; 2],
    /// Where it is, metres.
    pub position_m: [f64; 2],
    /// Standard deviation of that, metres; 0 where it was told to be exact.
    pub position_std_m: [f64; 2],
    /// Ranges of it that were looked at.
    pub ranges: usize,
    /// How much too long its ranges are where the direct path is free (antenna delays), metres.
    pub range_bias_m: f64,
    /// Standard deviation of that.
    pub range_bias_std_m: f64,
    /// Standard deviation of its noise, metres.
    pub noise_std_m: f64,
    /// Share of its ranges with an excess.
    pub excess_share: f64,
    /// Bias and mean excess together, metres.
    pub mean_error_m: f64,
    /// Standard deviation of that.
    pub mean_error_std_m: f64,
    /// Standard deviation of a range's error about that, excess included, metres.
    pub error_std_m: f64,
}

/// What is known of an antenna.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AntennaCalibration {
    /// Its name.
    pub name: String,
    /// How much longer its ranges are than the mean of all antennas', metres.
    pub difference_m: f64,
    /// Standard deviation of that.
    pub difference_std_m: f64,
}

impl Calibration {
    /// Reads the file.
    ///
    /// # Errors
    /// It cannot be read, or is no calibration.
    pub fn read(path: &Path) -> Result<Self, InputError> {
        let text = toml_place::read_text(path)?;
        toml_place::check_format(path, &text, FORMAT)?;
        let calibration: Self =
            toml::from_str(&text).map_err(|error| toml_place::refusal(path, &text, &error))?;
        calibration.check(path)?;
        Ok(calibration)
    }

    /// Refuses what no calibration has.
    fn check(&self, path: &Path) -> Result<(), InputError> {
        let refuse = |item: String, value: f64, allowed: &str| {
            Err(InputError::new(path, format!("is {value}")).for_item(item).allowed(allowed))
        };
        for (index, anchor) in self.anchors.iter().enumerate() {
            let lengths = [
                ("position_m", anchor.position_m[0], 1e6),
                ("position_m", anchor.position_m[1], 1e6),
                ("range_bias_m", anchor.range_bias_m, 1e3),
                ("mean_error_m", anchor.mean_error_m, 1e3),
            ];
            for (key, value, most) in lengths {
                if !(value.abs() <= most) {
                    return refuse(format!("anchors.{index}.{key}"), value, &format!("-{most} to {most}"));
                }
            }
            for (key, value) in [
                ("error_std_m", anchor.error_std_m),
                ("noise_std_m", anchor.noise_std_m),
                ("mean_error_std_m", anchor.mean_error_std_m),
            ] {
                if !(value > 0.0 && value <= 1e4) {
                    return refuse(format!("anchors.{index}.{key}"), value, "above 0 to 1e4");
                }
            }
        }
        if !(0.0..=1.0).contains(&self.errors.false_share) {
            return refuse("errors.false_share".into(), self.errors.false_share, "0 to 1");
        }
        for (index, antenna) in self.antennas.iter().enumerate() {
            if !(antenna.difference_m.abs() <= 1e3) {
                let item = format!("antennas.{index}.difference_m");
                return refuse(item, antenna.difference_m, "-1e3 to 1e3");
            }
        }
        if let Some(pulse) = &self.pulse {
            if !(pulse.duration_factor > 0.1 && pulse.duration_factor < 10.0) {
                return refuse("pulse.duration_factor".into(), pulse.duration_factor, "0.1 to 10");
            }
            if !(0.0..=1.0).contains(&pulse.roll_off) {
                return refuse("pulse.roll_off".into(), pulse.roll_off, "0 to 1");
            }
            let offset_m = pulse.peak_offset_m.unwrap_or(0.0);
            if !(offset_m.abs() <= 1e3) {
                return refuse("pulse.peak_offset_m".into(), offset_m, "-1e3 to 1e3");
            }
        }
        Ok(())
    }

    /// The file's text.
    ///
    /// # Errors
    /// Never for numbers that TOML can hold.
    pub fn to_toml(&self) -> Result<String, toml::ser::Error> {
        toml::to_string(self)
    }

    /// A recording as it is with this calibration: what the tracker is told, and its measurements corrected. Truth and times
    /// stay; so do virtual anchors that are told by their positions. `path` is where the calibration is from, for messages.
    ///
    /// # Errors
    /// The calibration is of other anchors or antennas.
    pub fn applied(&self, recording: Recording, path: &Path) -> Result<Recording, InputError> {
        self.check_same(&recording, path)?;
        let difference_m = |antenna: Option<usize>| {
            let of = antenna.and_then(|antenna| self.antennas.get(antenna));
            of.map_or(0.0, |antenna| antenna.difference_m)
        };
        let offset_m = self.pulse.as_ref().and_then(|pulse| pulse.peak_offset_m).unwrap_or(0.0);
        let mut cycles = recording.cycles;
        for cycle in &mut cycles {
            let difference_m = difference_m(cycle.antenna);
            for range in &mut cycle.ranges {
                let anchor = &self.anchors[range.anchor];
                range.range_m = (range.range_m - anchor.range_bias_m - difference_m).max(SHORTEST_M);
                // What a radio says of a single range is left as it is.
                if self.errors.are_first_paths && range.std_m.is_none() {
                    range.std_m = Some(anchor.noise_std_m);
                }
            }
            for frame in &mut cycle.frames {
                let later_m = self.anchors[frame.anchor].range_bias_m + difference_m + offset_m;
                frame.first_sample_delay_s -= later_m / SPEED_OF_LIGHT_M_S;
            }
        }
        let mut anchors = recording.anchors;
        for (anchor, calibrated) in anchors.iter_mut().zip(&self.anchors) {
            anchor.position_m = calibrated.position_m;
            anchor.range_bias_mean_m = None;
            anchor.range_bias_std_m = Some(left_std_m(calibrated.range_bias_std_m));
        }
        let mut association = recording.association;
        if self.errors.are_first_paths {
            association.detection_probability = 1.0 - self.errors.false_share;
            association.clutter_per_anchor = self.errors.false_share;
        }
        let mut radio =
            Radio { range_bias_mean_m: 0.0, range_bias_std_m: self.bias_std_m(), ..recording.radio };
        let mut actions = recording.actions;
        if self.errors.are_first_paths {
            radio.range_late_m = self.errors.excess_m.clamp(0.0, LARGEST_EXCESS_M);
        }
        if let Some(pulse) = self.pulse.as_ref().filter(|pulse| pulse.is_shape_known()) {
            radio.pulse_duration_s *= pulse.duration_factor;
            actions.iter_mut().for_each(|action| action.pulse_duration_s *= pulse.duration_factor);
            radio.roll_off = pulse.roll_off;
        }
        let source = format!("{}; calibrated: {}", recording.source, path.display());
        Ok(Recording { source, cycles, anchors, association, radio, actions, ..recording })
    }

    /// What is left of the anchors' bias, root mean square, metres; 0 where it is too little to be estimated.
    pub fn bias_std_m(&self) -> f64 {
        let squares = self.anchors.iter().map(|anchor| anchor.range_bias_std_m.powi(2));
        left_std_m((squares.sum::<f64>() / self.anchors.len().max(1) as f64).sqrt())
    }

    /// Refuses a recording of other anchors or antennas.
    fn check_same(&self, recording: &Recording, path: &Path) -> Result<(), InputError> {
        let refuse = |reason: String| Err(InputError::new(path, reason));
        let name = &recording.name;
        if self.anchors.len() != recording.anchors.len() {
            let (of, has) = (self.anchors.len(), recording.anchors.len());
            return refuse(format!("is a calibration of {of} anchors, and {name} has {has}"));
        }
        for (ours, theirs) in self.anchors.iter().zip(&recording.anchors) {
            if ours.name != theirs.name {
                let (ours, theirs) = (&ours.name, &theirs.name);
                return refuse(format!("is a calibration of {ours}, where {name} has {theirs}"));
            }
            let ([a, b], [x, y]) = (ours.told_position_m, theirs.position_m);
            if !((a - x).hypot(b - y) <= SAME_M) {
                let of = &ours.name;
                return refuse(format!(
                    "is a calibration of {of} told at ({a:.3}, {b:.3}) m, and {name} has it at ({x:.3}, {y:.3}) m"
                ));
            }
        }
        let antennas = |names: Vec<&str>| if names.is_empty() { "none".to_owned() } else { names.join(", ") };
        let ours = antennas(self.antennas.iter().map(|antenna| antenna.name.as_str()).collect());
        let theirs = antennas(recording.antennas.iter().map(|antenna| antenna.name.as_str()).collect());
        if ours != theirs {
            return refuse(format!("is a calibration of the antennas {ours}, and {name} has {theirs}"));
        }
        Ok(())
    }

    /// As Rust: constants for firmware. What the tracker takes no field for is what the firmware does with every range.
    pub fn to_rust(&self) -> String {
        let mut text = format!(
            "// Made by `cogmint calibrate` from {}.\nuse cogmint_core::Anchor;\n",
            self.recordings.join(", ").escape_default()
        );
        let count = self.anchors.len();
        // Writing to a string cannot fail.
        let _ = write!(
            text,
            "\n/// Where the anchors are; their heights are those told.\npub const fn anchors(heights_m: [f32; {count}]) -> \
             [Anchor; {count}] {{\n    [\n"
        );
        for (index, AnchorCalibration { name, position_m: [x, y], .. }) in self.anchors.iter().enumerate() {
            let _ = writeln!(
                text,
                "        // {}\n        Anchor {{ position_m: [{:?}, {:?}], height_m: heights_m[{index}] }},",
                name.escape_default(),
                *x as f32,
                *y as f32
            );
        }
        text.push_str("    ]\n}\n");
        let mut table = |doc: &str, name: &str, of: &dyn Fn(&AnchorCalibration) -> f64| {
            let values: Vec<String> =
                self.anchors.iter().map(|anchor| format!("{:?}", of(anchor) as f32)).collect();
            let _ =
                write!(text, "\n/// {doc}\npub const {name}: [f32; {count}] = [{}];\n", values.join(", "));
        };
        let are_first_paths = self.errors.are_first_paths;
        table("To be subtracted from every range of an anchor, metres.", "RANGE_CORRECTION_M", &|anchor| {
            anchor.range_bias_m
        });
        table(
            "To be subtracted from the first sample's delay of every frame of an anchor, as a length in metres.",
            "FRAME_CORRECTION_M",
            &|anchor| anchor.range_bias_m + self.pulse.as_ref().and_then(|p| p.peak_offset_m).unwrap_or(0.0),
        );
        table(
            "What is left of an anchor's bias, metres: for `Tracker::tell_range_bias`, with a mean of 0.",
            "RANGE_BIAS_STD_M",
            &|anchor| left_std_m(anchor.range_bias_std_m),
        );
        if are_first_paths {
            table("Variance of an anchor's range, square metres.", "RANGE_VARIANCE_M2", &|anchor| {
                anchor.noise_std_m * anchor.noise_std_m
            });
        }
        if !self.antennas.is_empty() {
            let values: Vec<String> =
                self.antennas.iter().map(|antenna| format!("{:?}", antenna.difference_m as f32)).collect();
            let _ = write!(
                text,
                "\n/// To be subtracted on top of these where an antenna of several was used, metres.\n\
                 pub const ANTENNA_CORRECTION_M: [f32; {}] = [{}];\n",
                values.len(),
                values.join(", ")
            );
        }
        let mut number = |doc: &str, name: &str, value: f64| {
            let _ = write!(text, "\n/// {doc}\npub const {name}: f32 = {:?};\n", value as f32);
        };
        if are_first_paths {
            // The core's own limits.
            let (detected, clutter) =
                ((1.0 - self.errors.false_share).clamp(0.01, 0.999), self.errors.false_share.max(1e-3));
            number("`Config::association.detection_probability`.", "DETECTION_PROBABILITY", detected);
            number("`Config::association.clutter_per_anchor`.", "CLUTTER_PER_ANCHOR", clutter);
            let late_m = self.errors.excess_m.clamp(0.0, LARGEST_EXCESS_M);
            number("`Config::ranging.late_m`.", "LATE_M", late_m);
        }
        if let Some(pulse) = self.pulse.as_ref().filter(|pulse| pulse.is_shape_known()) {
            number("Factor on the duration of every action's pulse.", "PULSE_FACTOR", pulse.duration_factor);
            number("Roll-off of the pulse.", "ROLL_OFF", pulse.roll_off);
        }
        if !self.unknown.is_empty() {
            text.push_str("\n// What could not be known:\n");
            for sentence in &self.unknown {
                let _ = writeln!(text, "// - {}", sentence.escape_default());
            }
        }
        text
    }
}

/// A deviation of what is left of a bias, metres; 0 where it is too little to be estimated.
fn left_std_m(std_m: f64) -> f64 {
    if std_m < LEAST_BIAS_STD_M { 0.0 } else { std_m }
}
