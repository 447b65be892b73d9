//! Flights of the MILUV data set: DWM1000 radios, ranges and magnitude responses, motion-capture truth, in one NPZ
//! file.

use std::collections::BTreeMap;
use std::path::Path;

use super::{DW1000_SAMPLE_SPACING_S, SPEED_OF_LIGHT_M_S};
use crate::input_error::InputError;
use crate::recording::npz::{Archive, Array, Element};
use crate::recording::{
    Action, Anchor, Antenna, AssociationModel, Cycle, Frame, MAX_ANCHORS, Motion, Radio, Range, Recording,
    Samples, Start,
};

/// Responses are logged at most this long after the range of their exchange; rows of one link are seconds apart.
const MAX_LOG_DELAY_S: f64 = 0.3;
/// Where two true positions of a tag are further apart in time, a drone has turned in between: nothing is scored.
const MAX_TRUTH_GAP_S: f64 = 4.0;
/// No tag sits further than this from the centre of its own drone.
const MAX_LEVER_ARM_M: f64 = 1.0;
/// A tag's distance to the centre of its own drone is constant to less than this; the file's own is to 1e-14 m.
const RIGID_M: f64 = 0.01;
/// Cycles of two antennas at the same instant are set this far apart, as time must go on.
const SAME_INSTANT_S: f64 = 1e-6;
/// Tags are numbered ten times the drone's number and onward.
const TAGS_PER_DRONE: u32 = 10;
/// Tag numbers end here.
const MAX_TAG: f64 = 65535.0;

// Columns of the range table that are used. The calibrated range and its deviation have seen the truth: never those.
const TIME: usize = 0;
const TAG: usize = 1;
const TARGET: usize = 2;
const RAW_RANGE: usize = 4;

/// Choices of an import.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MiluvOptions {
    /// Whether each drone becomes one recording with its tags as antennas, instead of each tag one.
    pub bodies: bool,
    /// Whether the antenna's height is taken from the altitude of the truth, as if from a perfect barometer.
    pub heights: bool,
    /// How many samples after its first-path index the radio's pulse peaks. A property of the radio, given with the
    /// data as about 2.0.
    pub pulse_peak_samples: f64,
}

impl Default for MiluvOptions {
    fn default() -> Self {
        Self { bodies: false, heights: true, pulse_peak_samples: 2.0 }
    }
}

/// An imported flight.
#[derive(Clone, Debug, PartialEq)]
pub struct Miluv {
    /// One recording per tag (`tag-10`), or per drone (`drone-1`), each with the name of its folder, by number.
    pub recordings: Vec<(String, Recording)>,
    /// What was left out, in sentences for people; what concerns one recording is a part of its
    /// [`Recording::source`].
    pub notes: Vec<String>,
}

/// Imports a flight.
///
/// Each row of the range table whose target is an anchor becomes a cycle of its tag with one raw range. Each response
/// becomes the magnitude frame of the latest cycle of its tag and anchor, if that is at most 0.3 s old. The truth is
/// interpolated between the tag's own true positions, known at its responses; of a drone it is the mean of its tags'.
/// Cycles before the first and after the last of them, and in gaps of more than 4 s, have none. The file's motion
/// capture is of one body: it is used between the positions of those tags alone whose distance to it is constant.
///
/// # Errors
///
/// A file that cannot be read, an array that is missing or has another shape, or no usable row.
pub fn miluv(npz: &Path, options: MiluvOptions) -> Result<Miluv, InputError> {
    let mut archive = Archive::open(npz)?;
    let anchors = read_anchors(&mut archive)?;
    let mut notes = Vec::new();
    let rows = read_rows(&archive.read("range_table")?, anchors.len(), &mut notes)?;
    let responses = Responses::read(&mut archive)?;
    let mocap = read_mocap(&mut archive)?;
    let truths = read_truths(&mut archive, &responses, mocap.as_ref(), &mut notes)?;

    // Every tag that ranges, or whose truth is known: the centre of a drone is the mean of all its tags.
    let mut carriers: BTreeMap<u32, Carrier> = BTreeMap::new();
    let mut all_tags: Vec<u32> = rows.iter().map(|row| row.tag).chain(truths.keys().copied()).collect();
    all_tags.sort_unstable();
    all_tags.dedup();
    for tag in all_tags {
        let number = if options.bodies { tag / TAGS_PER_DRONE } else { tag };
        carriers.entry(number).or_default().tags.push(tag);
    }
    for row in rows {
        let number = if options.bodies { row.tag / TAGS_PER_DRONE } else { row.tag };
        carriers.entry(number).or_default().rows.push(row);
    }
    let kind = if options.bodies { "drone" } else { "tag" };
    let stem = npz.file_stem().unwrap_or_default().to_string_lossy();
    let mut recordings = Vec::new();
    for (number, carrier) in carriers {
        let folder = format!("{kind}-{number}");
        if carrier.rows.is_empty() {
            notes.push(format!("{folder}: left out, as it has no range to an anchor."));
            continue;
        }
        let (cycles, own_notes) = carrier.cycles(&responses, &truths, options);
        let source = format!(
            "Imported from the MILUV flight {stem} (McGill University), {kind} {number}: DWM1000 radios, raw ranges, \
             one cycle per range. {}{}Channel 2 and the pulse are assumed, the pulse to peak {} samples after the \
             first path. {}",
            if options.bodies {
                "The truth is the centre of the drone, the mean of its tags' by motion capture; its tags take turns \
                 as antennas. "
            } else {
                "The truth is the tag's antenna by motion capture. "
            },
            if options.heights { "The antenna's height is the altitude of the truth. " } else { "" },
            options.pulse_peak_samples,
            own_notes.join(" ")
        );
        notes.extend(own_notes.iter().map(|note| format!("{folder}: {note}")));
        let antennas = if options.bodies { carrier.antennas(&truths) } else { Vec::new() };
        let name = format!("miluv {stem} {kind} {number}");
        recordings.push((folder, recording_of(name, source, anchors.clone(), antennas, cycles)));
    }
    Ok(Miluv { recordings, notes })
}

fn recording_of(
    name: String,
    source: String,
    anchors: Vec<Anchor>,
    antennas: Vec<Antenna>,
    cycles: Vec<Cycle>,
) -> Recording {
    let mean = |axis: usize| {
        anchors.iter().map(|anchor| anchor.position_m[axis]).sum::<f64>() / anchors.len() as f64
    };
    let pulse_duration_s = 2e-9;
    Recording {
        name,
        source,
        // A drone hovers and turns: in-sample, on random_1.
        motion: Motion {
            acceleration_density_m2_s3: Some(0.15),
            velocity_decay_s: Some(1.5),
            ..Motion::default()
        },
        start: Start {
            position_m: [mean(0), mean(1)],
            position_std_m: 1.5,
            velocity_std_m_s: 0.5,
            disc_radius_m: None,
            drawn_about_m: None,
        },
        association: AssociationModel {
            detection_probability: 0.95,
            // A radio that ranges rarely measures something else.
            clutter_per_anchor: 0.02,
            max_range_m: 30.0,
        },
        radio: Radio {
            pulse_duration_s,
            roll_off: 0.5,
            sampled_pulse: None,
            gain_control: true,
            begins_with_path: true,
            sample_spacing_s: Some(DW1000_SAMPLE_SPACING_S),
            // In-sample, on random_1: ranges on time, and those that the body or the room blocks.
            range_std_m: 0.07,
            range_bias_mean_m: 0.0,
            // The antenna delay is unknown.
            range_bias_std_m: 0.15,
            range_late_m: 1.0,
            range_floor_pulses: None,
        },
        anchors,
        virtual_anchors: Vec::new(),
        walls: Vec::new(),
        plan: None,
        antennas,
        actions: vec![Action { carrier_hz: 3993.6e6, pulse_duration_s }],
        cycles,
    }
}

fn read_anchors(archive: &mut Archive<std::io::BufReader<std::fs::File>>) -> Result<Vec<Anchor>, InputError> {
    let anchors_m = archive.read("anchors_m")?;
    anchors_m.expect_shape(&[None, Some(3)])?;
    let count = anchors_m.shape()[0];
    if count == 0 || count > MAX_ANCHORS {
        return Err(anchors_m.refuse(format!("has {count} rows")).allowed(format!("1 to {MAX_ANCHORS}")));
    }
    if let Some(index) = (0..anchors_m.len()).find(|&index| !anchors_m.float(index).is_finite()) {
        return Err(anchors_m.refuse(format!("is {} in row {}", anchors_m.float(index), index / 3)));
    }
    Ok((0..count)
        .map(|index| {
            Anchor::new(
                format!("anchor {index}"),
                [anchors_m.float(3 * index), anchors_m.float(3 * index + 1)],
                anchors_m.float(3 * index + 2),
            )
        })
        .collect())
}

/// What one recording is made of: a tag, or a drone with its tags.
#[derive(Default)]
struct Carrier {
    /// Numbers of the tags, ascending.
    tags: Vec<u32>,
    /// Its rows of the range table, in order of time.
    rows: Vec<Row>,
}

impl Carrier {
    /// Its cycles, and what to say about them.
    fn cycles(
        &self,
        responses: &Responses,
        truths: &BTreeMap<u32, TagTruth<'_>>,
        options: MiluvOptions,
    ) -> (Vec<Cycle>, Vec<String>) {
        // A format with heights has them in all cycles: one tag without a truth leaves all without.
        let heights = options.heights && self.rows.iter().all(|row| truths.contains_key(&row.tag));
        let mut cycles: Vec<Cycle> = Vec::with_capacity(self.rows.len());
        let mut cycle_of_row = Vec::with_capacity(self.rows.len());
        let mut last_row = (f64::NEG_INFINITY, 0);
        for row in &self.rows {
            let range = Range { anchor: row.anchor, range_m: row.raw_range_m, std_m: None, angles: None };
            match cycles.last_mut() {
                // Time must go on from cycle to cycle: rows of one antenna at the same instant share one.
                Some(last) if last_row == (row.time_s, row.tag) => last.ranges.push(range),
                last => {
                    let earliest_s = last.map_or(f64::NEG_INFINITY, |last| last.time_s + SAME_INSTANT_S);
                    let antenna = self.tags.iter().position(|tag| *tag == row.tag);
                    cycles.push(Cycle {
                        time_s: row.time_s.max(earliest_s),
                        truth_position_m: self.centre_m(truths, row.time_s),
                        tag_height_m: truths
                            .get(&row.tag)
                            .filter(|_| heights)
                            .map(|truth| truth.height_m(row.time_s)),
                        antenna: antenna.filter(|_| options.bodies),
                        ranges: vec![range],
                        ..Cycle::default()
                    });
                }
            }
            last_row = (row.time_s, row.tag);
            cycle_of_row.push(cycles.len() - 1);
        }
        let mut notes = self.attach_responses(responses, options, &cycle_of_row, &mut cycles);
        let unscored = cycles.iter().filter(|cycle| cycle.truth_position_m.is_none()).count();
        if unscored > 0 {
            notes.push(format!(
                "{unscored} of {} cycles are unscored: the true position is not known then.",
                cycles.len()
            ));
        }
        if options.heights && !heights {
            notes.push("There are no heights, as a tag has no true position.".into());
        }
        (cycles, notes)
    }

    /// Attaches each response of the tags to the cycle of its range, and says how many there were.
    fn attach_responses(
        &self,
        responses: &Responses,
        options: MiluvOptions,
        cycle_of_row: &[usize],
        cycles: &mut [Cycle],
    ) -> Vec<String> {
        let (mut count, mut dropped) = (0, 0);
        for index in (0..responses.times.len())
            .filter(|&index| self.tags.iter().any(|tag| f64::from(*tag) == responses.tags.float(index)))
        {
            count += 1;
            let (time_s, tag) = (responses.times.float(index), responses.tags.float(index));
            let (anchor, first_path) = (responses.anchors.float(index), responses.first_paths.float(index));
            let past = self.rows.partition_point(|row| row.time_s <= time_s);
            let row = (0..past)
                .rev()
                .take_while(|&row| time_s - self.rows[row].time_s <= MAX_LOG_DELAY_S)
                .find(|&row| f64::from(self.rows[row].tag) == tag && self.rows[row].anchor as f64 == anchor);
            let (Some(row), true) = (row, first_path.is_finite()) else {
                dropped += 1;
                continue;
            };
            let cycle = &mut cycles[cycle_of_row[row]];
            let row = &self.rows[row];
            if cycle.frames.iter().any(|frame| frame.anchor == row.anchor) {
                dropped += 1;
                continue;
            }
            cycle.frames.push(Frame {
                anchor: row.anchor,
                action: 0,
                first_sample_delay_s: row.raw_range_m / SPEED_OF_LIGHT_M_S
                    - (first_path + options.pulse_peak_samples) * DW1000_SAMPLE_SPACING_S,
                first_path_index: Some(first_path),
                line_of_sight: None,
                samples: Samples::Magnitude(responses.magnitudes.float_row(index)),
            });
        }
        vec![format!(
            "{} of {count} responses were attached to a range; {dropped} had none of their link within \
             {MAX_LOG_DELAY_S} s before them.",
            count - dropped
        )]
    }

    /// The mean of the tags' true positions, where all of them are known.
    fn centre_m(&self, truths: &BTreeMap<u32, TagTruth<'_>>, time_s: f64) -> Option<[f64; 2]> {
        let positions_m: Vec<[f64; 3]> =
            self.tags.iter().map(|tag| truths.get(tag)?.at(time_s)).collect::<Option<_>>()?;
        let mean =
            |axis: usize| positions_m.iter().map(|at_m| at_m[axis]).sum::<f64>() / positions_m.len() as f64;
        Some([mean(0), mean(1)])
    }

    /// The tags as antennas. The body's first axis points from its centre to the first antenna. Lever arms are medians
    /// over the flight, to the millimetre, as from a drawing of the drone: turns blur single ones.
    fn antennas(&self, truths: &BTreeMap<u32, TagTruth<'_>>) -> Vec<Antenna> {
        let mut arms_m = vec![[const { Vec::new() }; 2]; self.tags.len()];
        let times_s = self.tags.iter().filter_map(|tag| truths.get(tag)).flat_map(|truth| &truth.own.times_s);
        for &time_s in times_s {
            let Some(centre_m) = self.centre_m(truths, time_s) else { continue };
            let from_centre_m = self.tags.iter().filter_map(|tag| {
                let [x, y, _] = truths.get(tag)?.at(time_s)?;
                Some([x - centre_m[0], y - centre_m[1]])
            });
            let from_centre_m: Vec<[f64; 2]> = from_centre_m.collect();
            let Some(&[x, y]) = from_centre_m.first() else { continue };
            let (sin, cos) = y.atan2(x).sin_cos();
            for (arm_m, [x, y]) in arms_m.iter_mut().zip(from_centre_m) {
                arm_m[0].push(cos * x + sin * y);
                arm_m[1].push(cos * y - sin * x);
            }
        }
        let antenna = |(tag, arm_m): (&u32, [Vec<f64>; 2])| {
            let [along_m, across_m] = arm_m.map(median);
            Antenna { name: format!("tag {tag}"), lever_arm_m: along_m.zip(across_m).map(|(x, y)| [x, y]) }
        };
        self.tags.iter().zip(arms_m).map(antenna).collect()
    }
}

/// The median, in whole thousandths.
fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let middle = values.get(values.len() / 2)?;
    // Adding zero makes a negative zero plain.
    Some((middle * 1e3).round() / 1e3 + 0.0)
}

/// One usable row of the range table.
struct Row {
    time_s: f64,
    tag: u32,
    anchor: usize,
    raw_range_m: f64,
}

/// The rows to anchors, in order of time. Rows to other tags are not ours.
fn read_rows(table: &Array, anchor_count: usize, notes: &mut Vec<String>) -> Result<Vec<Row>, InputError> {
    table.expect_shape(&[None, Some(11)])?;
    let mut unusable = 0;
    let mut rows = Vec::new();
    for index in 0..table.shape()[0] {
        let cell = |column: usize| table.float(11 * index + column);
        let (time_s, target, raw_range_m) = (cell(TIME), cell(TARGET), cell(RAW_RANGE));
        if target >= anchor_count as f64 {
            continue;
        }
        // NaN is in no range.
        let usable = (0.0..=f64::MAX).contains(&raw_range_m)
            && (0.0..=f64::MAX).contains(&target)
            && target.fract() == 0.0
            && time_s.is_finite();
        match tag_number(cell(TAG)).filter(|_| usable) {
            None => unusable += 1,
            Some(tag) => rows.push(Row { time_s, tag, anchor: target as usize, raw_range_m }),
        }
    }
    rows.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
    if unusable > 0 {
        notes.push(format!(
            "{unusable} rows whose time, tag, target or raw range is no such value were left out."
        ));
    }
    if rows.is_empty() {
        return Err(table.refuse("has no usable range to an anchor"));
    }
    Ok(rows)
}

fn tag_number(value: f64) -> Option<u32> {
    ((0.0..=MAX_TAG).contains(&value) && value.fract() == 0.0).then_some(value as u32)
}

/// The responses, as arrays of the same length.
struct Responses {
    times: Array,
    tags: Array,
    anchors: Array,
    first_paths: Array,
    magnitudes: Array,
}

impl Responses {
    fn read(archive: &mut Archive<std::io::BufReader<std::fs::File>>) -> Result<Self, InputError> {
        let times = archive.read("cir_time_s")?;
        times.expect_shape(&[None])?;
        let count = times.len();
        let tags = archive.read("cir_tag")?;
        tags.expect_shape(&[Some(count)])?;
        let anchors = archive.read("cir_anchor")?;
        anchors.expect_shape(&[Some(count)])?;
        let first_paths = archive.read("cir_first_path_index")?;
        first_paths.expect_shape(&[Some(count)])?;
        let magnitudes = archive.read("cir_magnitude")?;
        magnitudes.expect_shape(&[Some(count), None])?;
        if magnitudes.expect(Element::Complex64, &[None, None]).is_ok() {
            return Err(magnitudes.refuse("holds complex numbers").allowed("magnitudes"));
        }
        Ok(Self { times, tags, anchors, first_paths, magnitudes })
    }
}

/// The motion capture of the one body that the file has it of, if it has it.
fn read_mocap(archive: &mut Archive<std::io::BufReader<std::fs::File>>) -> Result<Option<Truth>, InputError> {
    let Some(times) = archive.read_optional("mocap_time_s")? else { return Ok(None) };
    let positions = archive.read("mocap_position_m")?;
    times.expect_shape(&[None])?;
    let times_s = times.floats();
    positions.expect_shape(&[Some(times_s.len()), Some(3)])?;
    if times_s.is_empty() || times_s.iter().any(|time_s| !time_s.is_finite()) {
        return Err(times.refuse("is empty or not finite"));
    }
    if times_s.windows(2).any(|pair| pair[1] <= pair[0]) {
        return Err(times.refuse("does not increase strictly"));
    }
    let positions_m: Vec<[f64; 3]> = positions.floats().as_chunks().0.to_vec();
    if positions_m.iter().flatten().any(|coordinate_m| !coordinate_m.is_finite()) {
        return Err(positions.refuse("is not finite"));
    }
    Ok(Some(Truth { times_s, positions_m }))
}

/// What is known of each tag's own way: its true position at each of its responses.
fn read_truths<'a>(
    archive: &mut Archive<std::io::BufReader<std::fs::File>>,
    responses: &Responses,
    mocap: Option<&'a Truth>,
    notes: &mut Vec<String>,
) -> Result<BTreeMap<u32, TagTruth<'a>>, InputError> {
    let positions = archive.read("cir_true_tag_position_m")?;
    let count = responses.times.len();
    positions.expect_shape(&[Some(count), Some(3)])?;
    let mut rows: Vec<(f64, u32, [f64; 3])> = Vec::with_capacity(count);
    let mut unusable = 0;
    for index in 0..count {
        let position_m: [f64; 3] = std::array::from_fn(|axis| positions.float(3 * index + axis));
        let time_s = responses.times.float(index);
        let usable = time_s.is_finite() && position_m.iter().all(|coordinate_m| coordinate_m.is_finite());
        match tag_number(responses.tags.float(index)).filter(|_| usable) {
            None => unusable += 1,
            Some(tag) => rows.push((time_s, tag, position_m)),
        }
    }
    if unusable > 0 {
        notes.push(format!(
            "{unusable} true positions whose time, tag or coordinates are no such value were left out."
        ));
    }
    rows.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut own: BTreeMap<u32, Truth> = BTreeMap::new();
    for (time_s, tag, position_m) in rows {
        let truth = own.entry(tag).or_default();
        if truth.times_s.last() != Some(&time_s) {
            truth.times_s.push(time_s);
            truth.positions_m.push(position_m);
        }
    }
    Ok(own.into_iter().map(|(tag, own)| (tag, TagTruth::new(own, mocap))).collect())
}

/// The way of one tag.
struct TagTruth<'a> {
    /// Its own true positions, at least one.
    own: Truth,
    /// The way of the body that it is fixed to, and its offset from that at the times of its own positions.
    body: Option<(&'a Truth, Truth)>,
}

impl<'a> TagTruth<'a> {
    /// The motion capture is that of the tag's own body if, at all of the tag's true positions, the distance between
    /// the two is the same.
    fn new(own: Truth, mocap: Option<&'a Truth>) -> Self {
        let offsets =
            mocap.filter(|mocap| own.times_s.iter().all(|&time_s| mocap.covers(time_s))).map(|mocap| {
                let offset_m = |(&time_s, at_m): (&f64, &[f64; 3])| {
                    let centre_m = mocap.at(time_s);
                    std::array::from_fn(|axis| at_m[axis] - centre_m[axis])
                };
                let positions_m = own.times_s.iter().zip(&own.positions_m).map(offset_m).collect();
                (mocap, Truth { times_s: own.times_s.clone(), positions_m })
            });
        let is_rigid = |offsets: &Truth| {
            let lengths_m = offsets.positions_m.iter().map(|[x, y, z]| x.hypot(*y).hypot(*z));
            let (low_m, high_m) = lengths_m
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), length| {
                    (low.min(length), high.max(length))
                });
            high_m - low_m <= RIGID_M && high_m <= MAX_LEVER_ARM_M
        };
        Self { body: offsets.filter(|(_, offsets)| is_rigid(offsets)), own }
    }

    /// The position, where it is known.
    fn at(&self, time_s: f64) -> Option<[f64; 3]> {
        (self.own.covers(time_s) && self.own.gap_s(time_s) <= MAX_TRUTH_GAP_S).then(|| self.nearest(time_s))
    }

    /// The altitude; outside the time of the truth that at its end, as a barometer would go on.
    fn height_m(&self, time_s: f64) -> f64 {
        self.nearest(time_s)[2]
    }

    fn nearest(&self, time_s: f64) -> [f64; 3] {
        match &self.body {
            Some((mocap, offsets)) if self.own.covers(time_s) => {
                let (centre_m, offset_m) = (mocap.at(time_s), offsets.at(time_s));
                std::array::from_fn(|axis| centre_m[axis] + offset_m[axis])
            }
            _ => self.own.at(time_s),
        }
    }
}

/// Positions at times that increase strictly.
#[derive(Default)]
struct Truth {
    times_s: Vec<f64>,
    positions_m: Vec<[f64; 3]>,
}

impl Truth {
    fn covers(&self, time_s: f64) -> bool {
        self.times_s.first().is_some_and(|&first_s| time_s >= first_s)
            && self.times_s.last().is_some_and(|&last_s| time_s <= last_s)
    }

    /// The indexes of the positions before and after a time.
    fn around(&self, time_s: f64) -> (usize, usize) {
        let after = self.times_s.partition_point(|&other_s| other_s < time_s).min(self.times_s.len() - 1);
        // At the very time of a position there is no gap.
        let before = if self.times_s[after] == time_s { after } else { after.saturating_sub(1) };
        (before, after)
    }

    /// The time between the positions before and after.
    fn gap_s(&self, time_s: f64) -> f64 {
        let (before, after) = self.around(time_s);
        self.times_s[after] - self.times_s[before]
    }

    /// The position by linear interpolation; before the first and after the last that one.
    fn at(&self, time_s: f64) -> [f64; 3] {
        let (before, after) = self.around(time_s);
        let (start_s, end_s) = (self.times_s[before], self.times_s[after]);
        let part =
            if end_s > start_s { ((time_s - start_s) / (end_s - start_s)).clamp(0.0, 1.0) } else { 1.0 };
        std::array::from_fn(|axis| {
            let (start_m, end_m) = (self.positions_m[before][axis], self.positions_m[after][axis]);
            start_m + part * (end_m - start_m)
        })
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;
    use std::fs;
    use std::io::Cursor;

    use super::super::tests::shared_data;
    use super::*;
    use crate::recording::npz::ArchiveWriter;
    use crate::recording::tests::Folder;

    /// The arrays of a flight.
    #[derive(Default)]
    struct Flight {
        anchors_m: Vec<[f64; 3]>,
        /// Time, position.
        mocap: Vec<(f64, [f64; 3])>,
        /// Time, tag, target, raw range.
        ranges: Vec<[f64; 4]>,
        /// Time, tag, anchor, true position of the tag.
        responses: Vec<(f64, f64, f64, [f64; 3])>,
    }

    impl Flight {
        fn import(&self, options: MiluvOptions) -> Result<Miluv, InputError> {
            let folder = Folder::new();
            let path = folder.0.join("flight.npz");
            let mut writer = ArchiveWriter::new(Cursor::new(Vec::new()));
            let mut add = |name: &str, shape: &[usize], values: Vec<f64>| {
                let bytes = values.iter().flat_map(|value| value.to_le_bytes());
                writer.add(name, Element::F64, shape, bytes).expect("is written");
            };
            add("anchors_m", &[self.anchors_m.len(), 3], self.anchors_m.concat());
            if !self.mocap.is_empty() {
                let count = self.mocap.len();
                add("mocap_time_s", &[count], self.mocap.iter().map(|row| row.0).collect());
                add("mocap_position_m", &[count, 3], self.mocap.iter().flat_map(|row| row.1).collect());
            }
            // What must not be used is absurd.
            let row = |[time_s, tag, target, raw_m]: &[f64; 4]| {
                [*time_s, *tag, *target, -9.0, *raw_m, -9.0, -9.0, 0.0, 0.0, 0.0, 0.0]
            };
            add("range_table", &[self.ranges.len(), 11], self.ranges.iter().flat_map(row).collect());
            let count = self.responses.len();
            add("cir_time_s", &[count], self.responses.iter().map(|row| row.0).collect());
            add("cir_tag", &[count], self.responses.iter().map(|row| row.1).collect());
            add("cir_anchor", &[count], self.responses.iter().map(|row| row.2).collect());
            add("cir_first_path_index", &[count], vec![2.5; count]);
            add("cir_magnitude", &[count, 4], [0.0, 1.0, 2.0, 3.0].repeat(count));
            let positions_m = self.responses.iter().flat_map(|row| row.3);
            add("cir_true_tag_position_m", &[count, 3], positions_m.collect());
            fs::write(&path, writer.finish().expect("ends").into_inner()).expect("is written");
            miluv(&path, options)
        }
    }

    /// Two anchors; tag 10 moves at (1, 2, 0.1) m/s from the origin, with ranges at 1 and 2 s.
    fn one_tag() -> Flight {
        let along = |time_s: f64| [time_s, 2.0 * time_s, 0.1 * time_s];
        Flight {
            anchors_m: vec![[1.0, 2.0, 1.8], [3.0, 4.0, 1.9]],
            mocap: Vec::new(),
            ranges: vec![
                [2.0, 10.0, 1.0, 4.0],
                [1.0, 10.0, 0.0, 3.0],
                [1.5, 10.0, 11.0, 9.0],
                [6.5, 10.0, 1.0, 5.0],
            ],
            responses: vec![
                (0.5, 10.0, 1.0, along(0.5)),
                (1.15, 10.0, 0.0, along(1.15)),
                (2.1, 11.0, 1.0, [40.0, 50.0, 9.0]),
                (2.5, 10.0, 1.0, along(2.5)),
            ],
        }
    }

    /// Where tag 10 d + k of drone d is: each drone on its own circle, turning at its own speed, its two tags on
    /// opposite sides of it.
    fn true_position_m(tag: u32, time_s: f64) -> [f64; 3] {
        let (drone, side) = (f64::from(tag / 10), f64::from(tag % 10));
        let (way, heading) = (TAU * time_s / (20.0 + drone), 0.3 * drone * time_s + 0.5 * TAU * side);
        [
            3.0 * drone + 1.5 * way.cos() + 0.2 * heading.cos(),
            -2.0 * drone + 1.5 * way.sin() + 0.2 * heading.sin(),
            drone,
        ]
    }

    fn drone_centre_m(drone: u32, time_s: f64) -> [f64; 3] {
        let [left, right] = [10 * drone, 10 * drone + 1].map(|tag| true_position_m(tag, time_s));
        std::array::from_fn(|axis| 0.5 * (left[axis] + right[axis]))
    }

    const TAGS: [u32; 6] = [10, 11, 20, 21, 30, 31];

    /// Three drones with two tags each. One link at a time, every 0.1 s; responses 0.05 s later from 5 s to 30 s.
    /// The motion capture is the first drone's.
    fn three_drones() -> Flight {
        let anchors_m = vec![[0.0, 0.0, 2.0], [8.0, 0.0, 2.1], [0.0, -9.0, 2.2]];
        let mut flight = Flight { anchors_m: anchors_m.clone(), ..Flight::default() };
        for n in 0..4000 {
            let time_s = 0.01 * f64::from(n);
            flight.mocap.push((time_s, drone_centre_m(1, time_s)));
        }
        for n in 0..350_u32 {
            let (time_s, tag, anchor) = (0.1 * f64::from(n), TAGS[n as usize % 6], n as usize / 6 % 3);
            let at_m = true_position_m(tag, time_s);
            let range_m =
                (0..3).map(|axis| (at_m[axis] - anchors_m[anchor][axis]).powi(2)).sum::<f64>().sqrt();
            flight.ranges.push([time_s, f64::from(tag), anchor as f64, range_m]);
            let logged_s = time_s + 0.05;
            if (5.0..30.0).contains(&logged_s) {
                let position_m = true_position_m(tag, logged_s);
                flight.responses.push((logged_s, f64::from(tag), anchor as f64, position_m));
            }
        }
        flight
    }

    fn distance_m([x, y]: [f64; 2], to: [f64; 3]) -> f64 {
        (x - to[0]).hypot(y - to[1])
    }

    #[test]
    fn rows_become_cycles_in_order_of_time_with_their_raw_range() {
        let Miluv { recordings, .. } = one_tag().import(MiluvOptions::default()).expect("is imported");
        // Tag 11 has a response, but no range to an anchor.
        assert_eq!(recordings.len(), 1);
        let (folder, recording) = &recordings[0];
        assert_eq!(folder, "tag-10");
        assert_eq!(recording.cycles.len(), 3);
        let first = &recording.cycles[0];
        assert_eq!(first.time_s, 1.0);
        assert!(distance_m(first.truth_position_m.expect("is known"), [1.0, 2.0, 0.0]) < 1e-9);
        assert!((first.tag_height_m.expect("is known") - 0.1).abs() < 1e-9);
        assert_eq!(first.ranges, [Range { anchor: 0, range_m: 3.0, std_m: None, angles: None }]);
        assert_eq!(recording.start.position_m, [2.0, 3.0]);
        assert!(recording.antennas.is_empty() && first.antenna.is_none());
        let options = MiluvOptions { heights: false, ..MiluvOptions::default() };
        let without = one_tag().import(options).expect("is imported");
        assert_eq!(without.recordings[0].1.cycles[0].tag_height_m, None);
    }

    #[test]
    fn responses_go_to_the_range_of_their_link_or_are_counted() {
        let Miluv { recordings, notes } = one_tag().import(MiluvOptions::default()).expect("is imported");
        let recording = &recordings[0].1;
        let frame = &recording.cycles[0].frames[0];
        assert_eq!(frame.samples, Samples::Magnitude(vec![0.0, 1.0, 2.0, 3.0]));
        let peak_s = frame.first_sample_delay_s + 4.5 * DW1000_SAMPLE_SPACING_S;
        assert!((peak_s * SPEED_OF_LIGHT_M_S - 3.0).abs() < 1e-9);
        assert!(recording.cycles[1].frames.is_empty());
        assert!(notes[0].starts_with("tag-10: 1 of 3 responses"), "{notes:?}");
        assert!(recording.source.contains("1 of 3 responses"), "{}", recording.source);
        assert!(notes.iter().any(|note| note.starts_with("tag-11: left out")), "{notes:?}");
    }

    #[test]
    fn cycles_outside_the_known_truth_and_in_long_gaps_are_unscored() {
        let mut flight = one_tag();
        let scored = |flight: &Flight| {
            let Miluv { recordings, notes } = flight.import(MiluvOptions::default()).expect("is imported");
            let truth = recordings[0].1.cycles.iter().map(|cycle| cycle.truth_position_m.is_some());
            (truth.collect::<Vec<bool>>(), notes)
        };
        let (truth, notes) = scored(&flight);
        assert_eq!(truth, [true, true, false]);
        assert!(notes.iter().any(|note| note.starts_with("tag-10: 1 of 3 cycles are unscored")), "{notes:?}");
        flight.responses.push((6.4, 10.0, 1.0, [6.5, 13.0, 0.6]));
        assert_eq!(scored(&flight).0, [true, true, false]);
        flight.responses.push((6.6, 10.0, 1.0, [6.5, 13.0, 0.6]));
        assert_eq!(scored(&flight).0, [true, true, true]);
        flight.ranges.push([4.0, 10.0, 1.0, 5.0]);
        assert_eq!(scored(&flight).0, [true, true, true, true]);
        // 2.5 s to 6.6 s is too long.
        flight.responses.retain(|row| row.0 != 6.4);
        assert_eq!(scored(&flight).0, [true, true, false, false]);
        let recording = &flight.import(MiluvOptions::default()).expect("is imported").recordings[0].1;
        assert!(recording.cycles.iter().all(|cycle| cycle.tag_height_m.is_some()));
        let copy = Folder::new();
        recording.write(&copy.0).expect("is written");
        assert_eq!(&Recording::read(&copy.0).expect("is read"), recording);
    }

    #[test]
    fn of_three_drones_every_tag_gets_its_own_ranges_and_its_own_truth() {
        let flight = three_drones();
        let Miluv { recordings, notes } = flight.import(MiluvOptions::default()).expect("is imported");
        let folders: Vec<&str> = recordings.iter().map(|(folder, _)| folder.as_str()).collect();
        assert_eq!(folders, ["tag-10", "tag-11", "tag-20", "tag-21", "tag-30", "tag-31"], "{notes:?}");
        for ((_, recording), tag) in recordings.iter().zip(TAGS) {
            let own: Vec<_> = flight.ranges.iter().filter(|row| row[1] == f64::from(tag)).collect();
            assert_eq!(recording.cycles.len(), own.len());
            assert_eq!(recording.anchors.len(), 3);
            for (cycle, [time_s, _, anchor, range_m]) in recording.cycles.iter().zip(own) {
                let range = &cycle.ranges[0];
                assert_eq!((cycle.time_s, cycle.ranges.len()), (*time_s, 1));
                assert_eq!((range.anchor as f64, range.range_m), (*anchor, *range_m));
                let known = (5.7..29.3).contains(time_s);
                assert!(!known || cycle.truth_position_m.is_some(), "tag {tag} at {time_s} s");
                assert!(*time_s > 5.0 && *time_s < 30.0 || cycle.truth_position_m.is_none());
                let Some(truth_m) = cycle.truth_position_m else { continue };
                // Positions are 0.6 s apart: half way, a chord is 6 mm off the drone's way and 7 mm off the tag's turn.
                let error_m = distance_m(truth_m, true_position_m(tag, *time_s));
                assert!(error_m < 0.012, "tag {tag} at {time_s} s: {error_m} m");
                let anchor = &recording.anchors[range.anchor];
                let up_m = cycle.tag_height_m.expect("is known") - anchor.height_m;
                let [x, y] = anchor.position_m;
                let length_m = (truth_m[0] - x).hypot(truth_m[1] - y).hypot(up_m);
                assert!((length_m - range.range_m).abs() < 0.012);
            }
            let frames: usize = recording.cycles.iter().map(|cycle| cycle.frames.len()).sum();
            let responses = flight.responses.iter().filter(|row| row.1 == f64::from(tag)).count();
            assert_eq!(frames, responses);
        }
    }

    #[test]
    fn of_three_drones_each_becomes_one_body_with_two_antennas_and_its_own_centre() {
        let flight = three_drones();
        let options = MiluvOptions { bodies: true, ..MiluvOptions::default() };
        let Miluv { recordings, notes } = flight.import(options).expect("is imported");
        let folders: Vec<&str> = recordings.iter().map(|(folder, _)| folder.as_str()).collect();
        assert_eq!(folders, ["drone-1", "drone-2", "drone-3"], "{notes:?}");
        for ((_, recording), drone) in recordings.iter().zip(1..) {
            let own: Vec<_> = flight.ranges.iter().filter(|row| row[1] as u32 / 10 == drone).collect();
            assert_eq!(recording.cycles.len(), own.len());
            let names: Vec<&str> = recording.antennas.iter().map(|antenna| antenna.name.as_str()).collect();
            assert_eq!(names, [format!("tag {drone}0"), format!("tag {drone}1")]);
            for (antenna, along_m) in recording.antennas.iter().zip([0.2, -0.2]) {
                let [x, y] = antenna.lever_arm_m.expect("is known");
                assert!((x - along_m).abs() < 0.004 && y.abs() < 0.004, "{antenna:?}");
            }
            for (cycle, [time_s, tag, anchor, range_m]) in recording.cycles.iter().zip(own) {
                assert_eq!((cycle.time_s, cycle.antenna), (*time_s, Some(*tag as usize % 10)));
                assert_eq!((cycle.ranges[0].anchor as f64, cycle.ranges[0].range_m), (*anchor, *range_m));
                let known = (5.7..29.3).contains(time_s);
                assert!(!known || cycle.truth_position_m.is_some(), "drone {drone} at {time_s} s");
                let Some(truth_m) = cycle.truth_position_m else { continue };
                assert!(distance_m(truth_m, drone_centre_m(drone, *time_s)) < 0.012);
            }
            assert!(recording.cycles.iter().any(|cycle| cycle.truth_position_m.is_none()));
            let copy = Folder::new();
            recording.write(&copy.0).expect("is written");
            assert_eq!(&Recording::read(&copy.0).expect("is read"), recording);
        }
    }

    #[test]
    fn motion_capture_serves_between_the_positions_of_its_own_drone_and_of_no_other() {
        let mut flight = three_drones();
        // Positions are 3 s apart now: a chord cuts 0.15 m off the way, and the turn of the tag besides.
        flight.responses.retain(|row| {
            let slot = ((row.0 - 0.05) / 0.1).round() as u32 / 6;
            slot.is_multiple_of(5)
        });
        let worst_m = |flight: &Flight, tag: u32| {
            let Miluv { recordings, .. } = flight.import(MiluvOptions::default()).expect("is imported");
            let (_, recording) =
                recordings.iter().find(|(name, _)| *name == format!("tag-{tag}")).expect("is there");
            let errors_m = recording.cycles.iter().filter_map(|cycle| {
                Some(distance_m(cycle.truth_position_m?, true_position_m(tag, cycle.time_s)))
            });
            errors_m.fold(0.0, f64::max)
        };
        let (own_m, other_m) = (worst_m(&flight, 10), worst_m(&flight, 20));
        let without = Flight { mocap: Vec::new(), ..three_drones() };
        let without = Flight { responses: flight.responses.clone(), ..without };
        assert!(own_m < 0.05 && worst_m(&without, 10) > 0.1, "{own_m} m");
        assert_eq!(other_m, worst_m(&without, 20), "the motion capture of drone 1 does not touch drone 2");
    }

    #[test]
    fn antennas_that_range_at_the_same_instant_get_a_cycle_each() {
        let mut flight = three_drones();
        let time_s = flight.ranges[102][0];
        flight.ranges.push([time_s, 11.0, 1.0, 4.0]);
        flight.ranges.push([time_s, 10.0, 2.0, 4.5]);
        let options = MiluvOptions { bodies: true, ..MiluvOptions::default() };
        let Miluv { recordings, .. } = flight.import(options).expect("is imported");
        let cycles = recordings[0].1.cycles.iter();
        let there: Vec<_> = cycles.filter(|cycle| (cycle.time_s - time_s).abs() < 0.01).collect();
        let antennas: Vec<_> = there.iter().map(|cycle| cycle.antenna).collect();
        // The first is the flight's own.
        assert_eq!(antennas, [Some(0), Some(1), Some(0)]);
        assert!(there.windows(2).all(|pair| pair[1].time_s > pair[0].time_s));
    }

    #[test]
    fn arrays_that_cannot_be_used_are_refused_by_name() {
        let refused = |change: fn(&mut Flight)| {
            let mut flight = one_tag();
            change(&mut flight);
            flight.import(MiluvOptions::default()).expect_err("is refused").item().map(str::to_owned)
        };
        assert_eq!(refused(|flight| flight.anchors_m.clear()).as_deref(), Some("anchors_m"));
        assert_eq!(refused(|flight| flight.anchors_m[1][2] = f64::NAN).as_deref(), Some("anchors_m"));
        assert_eq!(refused(|flight| flight.ranges.clear()).as_deref(), Some("range_table"));
        let mocap = refused(|flight| flight.mocap = vec![(1.0, [0.0; 3]), (1.0, [0.0; 3])]);
        assert_eq!(mocap.as_deref(), Some("mocap_time_s"));
        // A row that cannot be used costs itself alone.
        let mut flight = one_tag();
        flight.ranges.push([3.0, 10.5, 0.0, 2.0]);
        flight.ranges.push([3.0, 10.0, 0.0, f64::NAN]);
        flight.responses.push((4.0, 10.0, 0.0, [f64::NAN, 0.0, 0.0]));
        let Miluv { recordings, notes } = flight.import(MiluvOptions::default()).expect("is imported");
        assert_eq!(recordings[0].1.cycles.len(), 3);
        assert!(notes[0].starts_with("2 rows") && notes[1].starts_with("1 true position"), "{notes:?}");
    }

    #[test]
    fn the_flight_is_imported_whole() {
        let Some(folder) = shared_data("miluv") else { return };
        let import = |bodies| {
            let options = MiluvOptions { bodies, ..MiluvOptions::default() };
            miluv(&folder.join("random_1.npz"), options).expect("is imported")
        };
        let Miluv { recordings, notes } = import(false);
        let counts = |recording: &Recording| {
            let frames: usize = recording.cycles.iter().map(|cycle| cycle.frames.len()).sum();
            let scored = recording.cycles.iter().filter(|cycle| cycle.truth_position_m.is_some()).count();
            (recording.cycles.len(), frames, scored)
        };
        assert_eq!(recordings.len(), 2);
        assert_eq!(
            (counts(&recordings[0].1), counts(&recordings[1].1)),
            ((479, 272, 476), (475, 304, 475)),
            "{notes:?}"
        );
        let (_, tag) = &recordings[0];
        assert_eq!(tag.anchors.len(), 6);
        assert_eq!(tag.cycles[0].ranges[0].range_m, 3.474_100_112_915_039);
        let drones = import(true).recordings;
        assert_eq!(drones.len(), 1);
        let (folder, drone) = &drones[0];
        assert_eq!(folder, "drone-1");
        assert_eq!(drone.cycles.len(), 954);
        assert_eq!(drone.antennas.len(), 2);
        for (_, recording) in recordings.iter().chain(&drones) {
            let copy = Folder::new();
            recording.write(&copy.0).expect("is written");
            assert_eq!(&Recording::read(&copy.0).expect("is read"), recording);
        }
    }
}
