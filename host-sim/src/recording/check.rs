//! What every recording must fulfil, whether it was read, made or imported.

use std::fmt;

use crate::input_error::number;

use cogmint_core::radio::pulse::PULSE_SAMPLES;

use super::{
    Anchor, Angles, Cycle, LINE_TOLERANCE_M, MAX_ANCHORS, MAX_ANTENNAS, MAX_CYCLES, MAX_FRAMES,
    MAX_PLAN_SEGMENTS, MAX_PLAN_WALLS, MAX_RANGES, MAX_SAMPLES, MAX_SEQUENCE, MAX_TRUTH_PATHS, Motion, Plan,
    Recording, SampledPulse, Samples,
};

/// What is wrong with a recording and where.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Fault {
    pub(super) place: Place,
    pub(super) reason: String,
    pub(super) allowed: Option<String>,
}

/// Which file of a recording a fault is in.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Place {
    /// A key of `recording.toml`, its parts joined by dots; indexes count from 0.
    Key(String),
    /// An array of `recording.npz`.
    Array(&'static str),
}

impl Fault {
    fn key(key: impl Into<String>, reason: impl Into<String>) -> Self {
        Self { place: Place::Key(key.into()), reason: reason.into(), allowed: None }
    }

    pub(super) fn array(name: &'static str, reason: impl Into<String>) -> Self {
        Self { place: Place::Array(name), reason: reason.into(), allowed: None }
    }

    pub(super) fn allowed(mut self, allowed: impl ToString) -> Self {
        self.allowed = Some(allowed.to_string());
        self
    }
}

/// An interval of finite numbers.
#[derive(Clone, Copy)]
struct Interval {
    low: f64,
    low_included: bool,
    high: f64,
}

const fn above_zero_to(high: f64) -> Interval {
    Interval { low: 0.0, low_included: false, high }
}

const fn from_to(low: f64, high: f64) -> Interval {
    Interval { low, low_included: true, high }
}

const POSITION: Interval = from_to(-1e6, 1e6);
const PULSE_DURATION: Interval = above_zero_to(1e-6);
const TIME: Interval = from_to(-1e10, 1e10);
const RANGE: Interval = from_to(0.0, 1e6);
const HEIGHT_STD: Interval = from_to(0.0, 100.0);
const RANGE_STD: Interval = above_zero_to(1e4);
const DELAY: Interval = from_to(-1.0, 1.0);
const FIRST_PATH: Interval = from_to(-65536.0, 65536.0);
/// A full turn either way.
const ANGLE: Interval = from_to(-6.3, 6.3);
const LEVER_ARM: Interval = from_to(-1e3, 1e3);
const STRENGTH: Interval = from_to(0.0, 1e30);

impl Interval {
    fn holds(self, value: f64) -> bool {
        // NaN fails every comparison.
        value <= self.high && if self.low_included { value >= self.low } else { value > self.low }
    }
}

impl fmt::Display for Interval {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { low, low_included, high } = *self;
        let above = if low_included { "" } else { "above " };
        write!(formatter, "{above}{} to {}", number(low), number(high))
    }
}

fn check_key(key: impl Into<String>, value: f64, interval: Interval) -> Result<(), Fault> {
    if interval.holds(value) {
        return Ok(());
    }
    Err(Fault::key(key, format!("is {value}")).allowed(interval))
}

fn check_element(name: &'static str, cycle: usize, value: f64, interval: Interval) -> Result<(), Fault> {
    if interval.holds(value) {
        return Ok(());
    }
    Err(Fault::array(name, format!("is {value} in cycle {cycle}")).allowed(interval))
}

fn check_pulse(pulse: &SampledPulse) -> Result<(), Fault> {
    check_key("radio.sampled_pulse.step_s", pulse.step_s, from_to(1e-12, 1e-8))?;
    let key = "radio.sampled_pulse.autocorrelation";
    if pulse.autocorrelation.len() != PULSE_SAMPLES {
        let reason = format!("has {} values", pulse.autocorrelation.len());
        return Err(Fault::key(key, reason).allowed(format!("{PULSE_SAMPLES} values, from lag 0 on")));
    }
    for (lag, value) in pulse.autocorrelation.iter().enumerate() {
        let interval = match lag {
            0 => from_to(0.999, 1.001),
            1 => from_to(-1.0, 0.9999),
            _ => from_to(-1.001, 1.001),
        };
        check_key(format!("{key}.{lag}"), *value, interval)?;
    }
    Ok(())
}

fn check_plan(plan: &Plan) -> Result<(), Fault> {
    let corners = plan.outline_m.len();
    if !(3..=MAX_PLAN_SEGMENTS).contains(&corners) {
        return Err(Fault::key("plan.outline_m", format!("has {corners} corners"))
            .allowed(format!("3 to {MAX_PLAN_SEGMENTS}")));
    }
    for &coordinate_m in plan.outline_m.as_flattened() {
        check_key("plan.outline_m", coordinate_m, POSITION)?;
    }
    check_key("plan.turn_std_rad", plan.turn_std_rad, from_to(0.0, 1.0))?;
    if plan.reflections > MAX_SEQUENCE {
        return Err(Fault::key("plan.reflections", format!("is {}", plan.reflections))
            .allowed(format!("at most {MAX_SEQUENCE}")));
    }
    if plan.walls.len() > MAX_PLAN_WALLS {
        return Err(Fault::key("plan.walls", format!("has {} entries", plan.walls.len()))
            .allowed(format!("at most {MAX_PLAN_WALLS}")));
    }
    for (index, wall) in plan.walls.iter().enumerate() {
        let key = |field: &str| format!("plan.walls.{index}.{field}");
        let segments = wall.segments_m.len();
        if !(1..=MAX_PLAN_SEGMENTS).contains(&segments) {
            return Err(Fault::key(key("segments_m"), format!("has {segments} entries"))
                .allowed(format!("1 to {MAX_PLAN_SEGMENTS}")));
        }
        for [a, b] in &wall.segments_m {
            for &coordinate_m in a.iter().chain(b) {
                check_key(key("segments_m"), coordinate_m, POSITION)?;
            }
            let length_m = (b[0] - a[0]).hypot(b[1] - a[1]);
            if !(length_m > LINE_TOLERANCE_M) {
                return Err(Fault::key(key("segments_m"), format!("has one of {} m", number(length_m)))
                    .allowed(format!("above {LINE_TOLERANCE_M} m")));
            }
        }
        let off_line_m = wall.off_line_m();
        if !(off_line_m <= LINE_TOLERANCE_M) {
            let reason = format!("has an end {} m beside the line of all", number(off_line_m));
            return Err(Fault::key(key("segments_m"), reason)
                .allowed(format!("segments on one line to {LINE_TOLERANCE_M} m")));
        }
        check_key(key("offset_std_m"), wall.offset_std_m, from_to(0.0, 100.0))?;
        check_key(key("rotation_std_rad"), wall.rotation_std_rad, from_to(0.0, 1.6))?;
    }
    Ok(())
}

impl Recording {
    /// The first fault, if any.
    pub(super) fn check(&self) -> Result<(), Fault> {
        self.check_meta()?;
        self.check_cycles()
    }

    fn check_motion(&self) -> Result<(), Fault> {
        let Motion { acceleration_std_m_s2, acceleration_density_m2_s3, velocity_decay_s } = self.motion;
        match (acceleration_std_m_s2, acceleration_density_m2_s3) {
            (Some(std_m_s2), None) => {
                check_key("motion.acceleration_std_m_s2", std_m_s2, above_zero_to(1e3))?;
            }
            (None, Some(density)) => {
                check_key("motion.acceleration_density_m2_s3", density, above_zero_to(1e6))?;
            }
            (None, None) => {
                return Err(Fault::key("motion.acceleration_std_m_s2", "is missing")
                    .allowed("this or `motion.acceleration_density_m2_s3`"));
            }
            (Some(_), Some(_)) => {
                let reason = "is given beside `motion.acceleration_std_m_s2`";
                return Err(Fault::key("motion.acceleration_density_m2_s3", reason).allowed("one of them"));
            }
        }
        match velocity_decay_s {
            // NaN is refused.
            Some(decay_s) if !(decay_s > 0.0) => {
                Err(Fault::key("motion.velocity_decay_s", format!("is {decay_s}")).allowed("above 0 to inf"))
            }
            _ => Ok(()),
        }
    }

    pub(super) fn check_meta(&self) -> Result<(), Fault> {
        if self.name.trim().is_empty()
            || self.name.chars().count() > 200
            || self.name.contains(char::is_control)
        {
            return Err(
                Fault::key("name", "is empty, too long or not on one line").allowed("1 to 200 characters")
            );
        }
        self.check_motion()?;
        for coordinate_m in self.start.position_m {
            check_key("start.position_m", coordinate_m, POSITION)?;
        }
        check_key("start.position_std_m", self.start.position_std_m, above_zero_to(1e6))?;
        check_key("start.velocity_std_m_s", self.start.velocity_std_m_s, above_zero_to(1e4))?;
        if let Some(radius_m) = self.start.disc_radius_m {
            check_key("start.disc_radius_m", radius_m, above_zero_to(1e6))?;
        }
        for coordinate_m in self.start.drawn_about_m.into_iter().flatten() {
            check_key("start.drawn_about_m", coordinate_m, POSITION)?;
        }
        let association = &self.association;
        check_key(
            "association.detection_probability",
            association.detection_probability,
            above_zero_to(1.0),
        )?;
        check_key("association.clutter_per_anchor", association.clutter_per_anchor, from_to(0.0, 1e3))?;
        check_key("association.max_range_m", association.max_range_m, above_zero_to(1e6))?;
        let radio = &self.radio;
        check_key("radio.pulse_duration_s", radio.pulse_duration_s, PULSE_DURATION)?;
        check_key("radio.roll_off", radio.roll_off, from_to(0.0, 1.0))?;
        if let Some(pulse) = &radio.sampled_pulse {
            check_pulse(pulse)?;
        }
        if let Some(spacing_s) = radio.sample_spacing_s {
            check_key("radio.sample_spacing_s", spacing_s, above_zero_to(1e-6))?;
        }
        check_key("radio.range_std_m", radio.range_std_m, RANGE_STD)?;
        check_key("radio.range_bias_mean_m", radio.range_bias_mean_m, from_to(-1e3, 1e3))?;
        check_key("radio.range_late_m", radio.range_late_m, from_to(0.0, 100.0))?;
        if let Some(floor) = radio.range_floor_pulses {
            check_key("radio.range_floor_pulses", floor, from_to(0.0, 1.0))?;
        }
        check_key("radio.range_bias_std_m", radio.range_bias_std_m, from_to(0.0, 1e3))?;
        self.check_anchors()?;
        self.check_antennas()?;
        if self.actions.len() > usize::from(u16::MAX) + 1 {
            return Err(
                Fault::key("actions", format!("has {} entries", self.actions.len())).allowed("at most 65536")
            );
        }
        for (index, wall) in self.walls.iter().enumerate() {
            for &coordinate_m in wall.as_flattened() {
                check_key(format!("walls.{index}"), coordinate_m, POSITION)?;
            }
        }
        if let Some(plan) = &self.plan {
            check_plan(plan)?;
        }
        for (index, action) in self.actions.iter().enumerate() {
            check_key(format!("actions.{index}.carrier_hz"), action.carrier_hz, from_to(1e6, 1e12))?;
            check_key(format!("actions.{index}.pulse_duration_s"), action.pulse_duration_s, PULSE_DURATION)?;
        }
        Ok(())
    }

    fn check_anchors(&self) -> Result<(), Fault> {
        if self.anchors.is_empty() || self.anchors.len() > MAX_ANCHORS {
            return Err(Fault::key("anchors", format!("has {} entries", self.anchors.len()))
                .allowed(format!("1 to {MAX_ANCHORS}")));
        }
        for (index, anchor) in self.anchors.iter().enumerate() {
            let Anchor { name, position_m, height_m, range_bias_mean_m, range_bias_std_m } = anchor;
            if name.trim().is_empty() || name.contains(char::is_control) {
                return Err(Fault::key(format!("anchors.{index}.name"), "is empty or not on one line"));
            }
            if self.anchors[..index].iter().any(|other| other.name == *name) {
                return Err(Fault::key(
                    format!("anchors.{index}.name"),
                    format!("repeats the name {name:?}"),
                ));
            }
            for &coordinate_m in position_m {
                check_key(format!("anchors.{index}.position_m"), coordinate_m, POSITION)?;
            }
            check_key(format!("anchors.{index}.height_m"), *height_m, POSITION)?;
            if let Some(mean_m) = range_bias_mean_m {
                check_key(format!("anchors.{index}.range_bias_mean_m"), *mean_m, from_to(-1e3, 1e3))?;
            }
            if let Some(std_m) = range_bias_std_m {
                check_key(format!("anchors.{index}.range_bias_std_m"), *std_m, from_to(0.0, 1e3))?;
            }
        }
        if self.virtual_anchors.len() > usize::from(u16::MAX) {
            return Err(Fault::key("virtual_anchors", format!("has {} entries", self.virtual_anchors.len()))
                .allowed("at most 65535"));
        }
        for (index, virtual_anchor) in self.virtual_anchors.iter().enumerate() {
            let key = |field: &str| format!("virtual_anchors.{index}.{field}");
            if virtual_anchor.anchor >= self.anchors.len() {
                return Err(Fault::key(key("anchor"), format!("is {}", virtual_anchor.anchor))
                    .allowed(format!("0 to {}", self.anchors.len() - 1)));
            }
            for coordinate_m in virtual_anchor.position_m {
                check_key(key("position_m"), coordinate_m, POSITION)?;
            }
            for coordinate_m in virtual_anchor.told_position_m.into_iter().flatten() {
                check_key(key("told_position_m"), coordinate_m, POSITION)?;
            }
            for wall in virtual_anchor.walls.iter() {
                let count = self.plan.as_ref().map_or(0, |plan| plan.walls.len());
                if wall >= count {
                    let fault = Fault::key(key("walls"), format!("names wall {wall}"));
                    return Err(match count {
                        0 => fault.allowed("nothing, as there is no plan with walls"),
                        _ => fault.allowed(format!("0 to {}, the indexes of `plan.walls`", count - 1)),
                    });
                }
            }
            let interval = if virtual_anchor.known { above_zero_to(1e6) } else { from_to(0.0, 1e6) };
            check_key(key("std_m"), virtual_anchor.std_m, interval)?;
        }
        Ok(())
    }

    fn check_antennas(&self) -> Result<(), Fault> {
        if self.antennas.len() > MAX_ANTENNAS {
            return Err(Fault::key("antennas", format!("has {} entries", self.antennas.len()))
                .allowed(format!("at most {MAX_ANTENNAS}")));
        }
        for (index, antenna) in self.antennas.iter().enumerate() {
            let key = |field: &str| format!("antennas.{index}.{field}");
            if antenna.name.trim().is_empty() || antenna.name.contains(char::is_control) {
                return Err(Fault::key(key("name"), "is empty or not on one line"));
            }
            if self.antennas[..index].iter().any(|other| other.name == antenna.name) {
                return Err(Fault::key(key("name"), format!("repeats the name {:?}", antenna.name)));
            }
            for coordinate_m in antenna.lever_arm_m.into_iter().flatten() {
                check_key(key("lever_arm_m"), coordinate_m, LEVER_ARM)?;
            }
        }
        Ok(())
    }

    fn check_cycles(&self) -> Result<(), Fault> {
        if self.cycles.is_empty() {
            return Err(Fault::array("cycle_time_s", "is empty").allowed("at least one cycle"));
        }
        let range_count = self.cycles.iter().map(|cycle| cycle.ranges.len()).sum();
        let frame_count = self.cycles.iter().map(|cycle| cycle.frames.len()).sum();
        check_count("cycle_time_s", self.cycles.len(), MAX_CYCLES)?;
        check_count("range_cycle", range_count, MAX_RANGES)?;
        check_count("frame_cycle", frame_count, MAX_FRAMES)?;
        let truth_path_count = self.cycles.iter().map(|cycle| cycle.truth_paths.len()).sum();
        check_count("truth_path_cycle", truth_path_count, MAX_TRUTH_PATHS)?;
        let mut previous_time_s = f64::NEG_INFINITY;
        for (index, cycle) in self.cycles.iter().enumerate() {
            check_element("cycle_time_s", index, cycle.time_s, TIME)?;
            if cycle.time_s <= previous_time_s {
                return Err(Fault::array(
                    "cycle_time_s",
                    format!(
                        "is {} in cycle {index}, not after the {previous_time_s} before it",
                        cycle.time_s
                    ),
                ));
            }
            previous_time_s = cycle.time_s;
            for coordinate_m in cycle.truth_position_m.into_iter().flatten() {
                check_element("truth_position_m", index, coordinate_m, POSITION)?;
            }
            if let Some(height_m) = cycle.tag_height_m {
                check_element("tag_height_m", index, height_m, POSITION)?;
            }
            if let Some(std_m) = cycle.tag_height_std_m {
                check_element("tag_height_std_m", index, std_m, HEIGHT_STD)?;
                if cycle.tag_height_m.is_none() {
                    return Err(Fault::array("tag_height_std_m", "has no `tag_height_m` beside it"));
                }
            }
            self.check_antenna_index(index, cycle.antenna)?;
            self.check_ranges(index, cycle)?;
            self.check_frames(index, cycle)?;
            self.check_truth_paths(index, cycle)?;
        }
        all_or_none("tag_height_m", self.cycles.iter().map(|cycle| cycle.tag_height_m.is_some()))?;
        all_or_none("tag_height_std_m", self.cycles.iter().map(|cycle| cycle.tag_height_std_m.is_some()))?;
        let ranges = || self.cycles.iter().flat_map(|cycle| &cycle.ranges);
        all_or_none("range_std_m", ranges().map(|range| range.std_m.is_some()))?;
        all_or_none("range_departure_angle_rad", ranges().map(|range| range.angles.is_some()))?;
        let frames = || self.cycles.iter().flat_map(|cycle| &cycle.frames);
        all_or_none("frame_first_path_index", frames().map(|frame| frame.first_path_index.is_some()))?;
        all_or_none("frame_line_of_sight", frames().map(|frame| frame.line_of_sight.is_some()))?;
        self.check_samples_agree()
    }

    fn check_ranges(&self, index: usize, cycle: &Cycle) -> Result<(), Fault> {
        for range in &cycle.ranges {
            self.check_anchor_index("range_anchor", index, range.anchor)?;
            check_element("range_m", index, range.range_m, RANGE)?;
            if let Some(std_m) = range.std_m {
                check_element("range_std_m", index, std_m, RANGE_STD)?;
            }
            if let Some(Angles { departure_rad, arrival_rad }) = range.angles {
                check_element("range_departure_angle_rad", index, departure_rad, ANGLE)?;
                check_element("range_arrival_angle_rad", index, arrival_rad, ANGLE)?;
            }
        }
        Ok(())
    }

    fn check_frames(&self, index: usize, cycle: &Cycle) -> Result<(), Fault> {
        for (count, frame) in cycle.frames.iter().enumerate() {
            self.check_anchor_index("frame_anchor", index, frame.anchor)?;
            if cycle.frames[..count].iter().any(|other| other.anchor == frame.anchor) {
                return Err(Fault::array(
                    "frame_anchor",
                    format!("holds anchor {} twice in cycle {index}", frame.anchor),
                )
                .allowed("one frame per anchor and cycle"));
            }
            if self.actions.is_empty() {
                return Err(
                    Fault::key("actions", "is empty although there are frames").allowed("1 to 65536 entries")
                );
            }
            if frame.action >= self.actions.len() {
                return Err(Fault::array("frame_action", format!("is {} in cycle {index}", frame.action))
                    .allowed(format!("0 to {}, the indexes of `actions`", self.actions.len() - 1)));
            }
            check_element("frame_first_sample_delay_s", index, frame.first_sample_delay_s, DELAY)?;
            if let Some(first_path) = frame.first_path_index {
                check_element("frame_first_path_index", index, first_path, FIRST_PATH)?;
            }
            let (name, finite) = match &frame.samples {
                Samples::Complex(samples) => {
                    ("frame_samples", samples.iter().flatten().all(|part| part.is_finite()))
                }
                Samples::Magnitude(samples) => {
                    ("frame_magnitude", samples.iter().all(|&value| value.is_finite() && value >= 0.0))
                }
            };
            if !finite {
                return Err(Fault::array(
                    name,
                    format!("has a sample in cycle {index} that is no such value"),
                )
                .allowed(match frame.samples {
                    Samples::Complex(_) => "any finite number",
                    Samples::Magnitude(_) => "any finite number from 0",
                }));
            }
        }
        Ok(())
    }

    fn check_truth_paths(&self, index: usize, cycle: &Cycle) -> Result<(), Fault> {
        for path in &cycle.truth_paths {
            self.check_anchor_index("truth_path_anchor", index, path.anchor)?;
            if let Some(source) = path.virtual_anchor
                && self.virtual_anchors.get(source).is_none_or(|source| source.anchor != path.anchor)
            {
                let reason = format!("is {source} in cycle {index}, which is no image of its anchor");
                return Err(Fault::array("truth_path_virtual_anchor", reason)
                    .allowed("65535, and the indexes of `virtual_anchors` of that anchor"));
            }
            check_element("truth_path_delay_s", index, path.delay_s, DELAY)?;
            check_element("truth_path_magnitude", index, path.magnitude, STRENGTH)?;
            check_element("truth_path_sinr", index, path.sinr, STRENGTH)?;
        }
        Ok(())
    }

    fn check_anchor_index(&self, name: &'static str, cycle: usize, anchor: usize) -> Result<(), Fault> {
        if anchor < self.anchors.len() {
            return Ok(());
        }
        Err(Fault::array(name, format!("is {anchor} in cycle {cycle}"))
            .allowed(format!("0 to {}, the indexes of `anchors`", self.anchors.len() - 1)))
    }

    fn check_antenna_index(&self, cycle: usize, antenna: Option<usize>) -> Result<(), Fault> {
        match antenna {
            None if self.antennas.is_empty() => Ok(()),
            None => Err(Fault::array("cycle_antenna", "is missing although there are `antennas`")),
            Some(antenna) if antenna < self.antennas.len() => Ok(()),
            Some(_) if self.antennas.is_empty() => {
                Err(Fault::array("cycle_antenna", "is there although there are no `antennas`"))
            }
            Some(antenna) => Err(Fault::array("cycle_antenna", format!("is {antenna} in cycle {cycle}"))
                .allowed(format!("0 to {}, the indexes of `antennas`", self.antennas.len() - 1))),
        }
    }

    fn check_samples_agree(&self) -> Result<(), Fault> {
        let mut frames = self.cycles.iter().flat_map(|cycle| &cycle.frames);
        let Some(first) = frames.next() else { return Ok(()) };
        let kind = |samples: &Samples| matches!(samples, Samples::Complex(_));
        let name = if kind(&first.samples) { "frame_samples" } else { "frame_magnitude" };
        if self.radio.sample_spacing_s.is_none() {
            return Err(Fault::key("radio.sample_spacing_s", "is missing although there are frames"));
        }
        if first.samples.is_empty() || first.samples.len() > MAX_SAMPLES {
            return Err(Fault::array(name, format!("has frames of {} samples", first.samples.len()))
                .allowed(format!("1 to {MAX_SAMPLES}")));
        }
        if frames.any(|frame| {
            kind(&frame.samples) != kind(&first.samples) || frame.samples.len() != first.samples.len()
        }) {
            return Err(Fault::array(name, "has frames of different kinds or lengths"));
        }
        Ok(())
    }
}

fn check_count(name: &'static str, count: usize, limit: usize) -> Result<(), Fault> {
    if count <= limit {
        return Ok(());
    }
    Err(Fault::array(name, format!("has {count} entries")).allowed(format!("at most {limit}")))
}

fn all_or_none(name: &'static str, mut present: impl Iterator<Item = bool>) -> Result<(), Fault> {
    let Some(first) = present.next() else { return Ok(()) };
    if present.all(|other| other == first) {
        return Ok(());
    }
    Err(Fault::array(name, "is known for a part only").allowed("all or none"))
}

#[cfg(test)]
mod tests {
    use super::super::WallSequence;
    use super::super::tests::example;
    use super::*;

    fn fault_after(change: impl FnOnce(&mut Recording)) -> Fault {
        let mut recording = example();
        change(&mut recording);
        recording.check().expect_err("has a fault")
    }

    #[test]
    fn the_example_has_no_fault() {
        assert_eq!(example().check(), Ok(()));
    }

    #[test]
    fn a_number_out_of_its_range_is_named_with_the_range() {
        let fault = fault_after(|recording| recording.start.position_std_m = -1.0);
        assert_eq!(fault.place, Place::Key("start.position_std_m".into()));
        assert_eq!(fault.allowed.as_deref(), Some("above 0 to 1e6"));
        let fault = fault_after(|recording| recording.anchors[1].position_m[0] = f64::NAN);
        assert_eq!(fault.place, Place::Key("anchors.1.position_m".into()));
        let fault = fault_after(|recording| recording.association.detection_probability = 0.0);
        assert_eq!(fault.allowed.as_deref(), Some("above 0 to 1"));
    }

    #[test]
    fn time_that_stands_still_is_a_fault() {
        let fault = fault_after(|recording| recording.cycles[2].time_s = recording.cycles[1].time_s);
        assert_eq!(fault.place, Place::Array("cycle_time_s"));
    }

    #[test]
    fn indexes_out_of_range_are_faults() {
        let fault = fault_after(|recording| recording.cycles[0].ranges[0].anchor = 2);
        assert_eq!(fault.place, Place::Array("range_anchor"));
        let fault = fault_after(|recording| recording.cycles[0].frames[0].action = 2);
        assert_eq!(fault.place, Place::Array("frame_action"));
        let fault = fault_after(|recording| recording.virtual_anchors[0].anchor = 2);
        assert_eq!(fault.place, Place::Key("virtual_anchors.0.anchor".into()));
        let fault =
            fault_after(|recording| recording.virtual_anchors[0].walls = WallSequence::new(&[2]).unwrap());
        assert_eq!(fault.place, Place::Key("virtual_anchors.0.walls".into()));
        assert_eq!(fault.allowed.as_deref(), Some("0 to 1, the indexes of `plan.walls`"));
        let fault = fault_after(|recording| recording.plan = None);
        assert_eq!(fault.place, Place::Key("virtual_anchors.0.walls".into()));
    }

    #[test]
    fn a_plan_has_an_outline_and_walls_of_segments_on_one_line() {
        let plan_fault = |change: fn(&mut Plan)| {
            fault_after(|recording| change(recording.plan.as_mut().expect("has a plan")))
        };
        let key = |text: &str| Place::Key(text.into());
        assert_eq!(plan_fault(|plan| plan.outline_m.truncate(2)).place, key("plan.outline_m"));
        assert_eq!(plan_fault(|plan| plan.outline_m[1][0] = f64::NAN).place, key("plan.outline_m"));
        let segments = key("plan.walls.0.segments_m");
        assert_eq!(plan_fault(|plan| plan.walls[0].segments_m.clear()).place, segments);
        assert_eq!(plan_fault(|plan| plan.walls[0].segments_m[1][0] = [3.0, 0.01]).place, segments);
        assert_eq!(plan_fault(|plan| plan.walls[0].segments_m[0][1] = [0.0, 0.0]).place, segments);
        assert_eq!(plan_fault(|plan| plan.walls[0].segments_m[0][1][1] = f64::INFINITY).place, segments);
        assert_eq!(
            plan_fault(|plan| plan.walls[1].offset_std_m = -0.1).place,
            key("plan.walls.1.offset_std_m")
        );
        let rotation = key("plan.walls.1.rotation_std_rad");
        assert_eq!(plan_fault(|plan| plan.walls[1].rotation_std_rad = f64::NAN).place, rotation);
    }

    #[test]
    fn truth_may_be_known_in_some_cycles_only_but_never_by_half() {
        let mut recording = example();
        recording.cycles[1].truth_position_m = None;
        assert_eq!(recording.check(), Ok(()));
        let fault = fault_after(|recording| recording.cycles[1].truth_position_m = Some([1.0, f64::NAN]));
        assert_eq!(fault.place, Place::Array("truth_position_m"));
    }

    #[test]
    fn angles_are_there_for_all_ranges_or_none_and_within_a_turn() {
        let fault = fault_after(|recording| recording.cycles[1].ranges[0].angles = None);
        assert_eq!(fault.place, Place::Array("range_departure_angle_rad"));
        let turned = |departure_rad, arrival_rad| {
            fault_after(|recording| {
                recording.cycles[1].ranges[1].angles = Some(Angles { departure_rad, arrival_rad });
            })
        };
        let fault = turned(90.0, 0.0);
        assert_eq!(fault.place, Place::Array("range_departure_angle_rad"));
        assert_eq!(fault.allowed.as_deref(), Some("-6.3 to 6.3"));
        assert_eq!(turned(0.0, f64::NAN).place, Place::Array("range_arrival_angle_rad"));
    }

    #[test]
    fn every_cycle_names_one_of_the_antennas_and_none_where_there_are_none() {
        let fault = fault_after(|recording| recording.cycles[1].antenna = Some(2));
        assert_eq!(fault.place, Place::Array("cycle_antenna"));
        assert_eq!(fault.allowed.as_deref(), Some("0 to 1, the indexes of `antennas`"));
        let fault = fault_after(|recording| recording.cycles[1].antenna = None);
        assert_eq!(fault.place, Place::Array("cycle_antenna"));
        let fault = fault_after(|recording| recording.antennas.clear());
        assert_eq!(fault.place, Place::Array("cycle_antenna"));
        let fault = fault_after(|recording| recording.antennas[1].name = "left".into());
        assert_eq!(fault.place, Place::Key("antennas.1.name".into()));
        let fault = fault_after(|recording| recording.antennas[0].lever_arm_m = Some([0.0, f64::INFINITY]));
        assert_eq!(fault.place, Place::Key("antennas.0.lever_arm_m".into()));
    }

    #[test]
    fn frames_must_agree_and_come_once_per_anchor_and_cycle() {
        let fault = fault_after(|recording| recording.cycles[0].frames[1].anchor = 1);
        assert_eq!(fault.place, Place::Array("frame_anchor"));
        let fault = fault_after(|recording| {
            recording.cycles[2].frames[0].samples = Samples::Complex(vec![[0.0; 2]; 4]);
        });
        assert_eq!(fault.place, Place::Array("frame_samples"));
        let fault = fault_after(|recording| {
            recording.cycles[2].frames[0].samples = Samples::Magnitude(vec![0.0; 5]);
        });
        assert_eq!(fault.place, Place::Array("frame_samples"));
        let fault = fault_after(|recording| recording.radio.sample_spacing_s = None);
        assert_eq!(fault.place, Place::Key("radio.sample_spacing_s".into()));
    }

    #[test]
    fn deviations_and_what_is_known_of_frames_are_there_for_all_or_none() {
        let fault = fault_after(|recording| recording.cycles[1].ranges[0].std_m = None);
        assert_eq!(fault.place, Place::Array("range_std_m"));
        let fault = fault_after(|recording| recording.cycles[2].frames[0].line_of_sight = None);
        assert_eq!(fault.place, Place::Array("frame_line_of_sight"));
        let fault = fault_after(|recording| recording.cycles[2].frames[0].first_path_index = None);
        assert_eq!(fault.place, Place::Array("frame_first_path_index"));
        let fault = fault_after(|recording| recording.cycles[2].frames[0].first_path_index = Some(f64::NAN));
        assert_eq!(fault.place, Place::Array("frame_first_path_index"));
    }
}
