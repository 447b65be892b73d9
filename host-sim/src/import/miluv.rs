//! Flights of the MILUV data set: DWM1000 radios, ranges and magnitude responses, motion-capture truth, in one NPZ
//! file.

use std::path::Path;

use super::{DW1000_SAMPLE_SPACING_S, SPEED_OF_LIGHT_M_S};
use crate::input_error::InputError;
use crate::recording::npz::{Archive, Array, Element};
use crate::recording::{
    Action, Anchor, AssociationModel, Cycle, Frame, MAX_ANCHORS, Motion, Radio, Range, Recording, Samples,
    Start,
};

/// Responses are logged at most this long after the range of their exchange; rows of one link are seconds apart.
const MAX_LOG_DELAY_S: f64 = 0.3;

// Columns of the range table that are used. The calibrated range and its deviation have seen the truth: never those.
const TIME: usize = 0;
const TAG: usize = 1;
const TARGET: usize = 2;
const RAW_RANGE: usize = 4;

/// Choices of an import.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MiluvOptions {
    /// Whether the tag's height is taken from the altitude of the truth, as if from a perfect barometer.
    pub heights: bool,
    /// How many samples after its first-path index the radio's pulse peaks. A property of the radio, given with the
    /// data as about 2.0.
    pub pulse_peak_samples: f64,
}

impl Default for MiluvOptions {
    fn default() -> Self {
        Self { heights: true, pulse_peak_samples: 2.0 }
    }
}

/// An imported flight.
#[derive(Clone, Debug, PartialEq)]
pub struct Miluv {
    /// The flight.
    pub recording: Recording,
    /// What was left out, in sentences for people; also a part of [`Recording::source`].
    pub notes: Vec<String>,
}

/// Imports a flight.
///
/// Each row of the range table whose target is an anchor becomes a cycle with one raw range. Each response becomes
/// the magnitude frame of the latest cycle of its tag and anchor, if that is at most 0.3 s old. The truth is the
/// body's centre, interpolated; two tags ride on the body, about a quarter of a metre from it, and are taken for it.
///
/// # Errors
///
/// A file that cannot be read, an array that is missing or has another shape, or no usable row.
pub fn miluv(npz: &Path, options: MiluvOptions) -> Result<Miluv, InputError> {
    let mut archive = Archive::open(npz)?;
    let anchors_m = archive.read("anchors_m")?;
    anchors_m.expect_shape(&[None, Some(3)])?;
    let anchor_count = anchors_m.shape()[0];
    if anchor_count == 0 || anchor_count > MAX_ANCHORS {
        return Err(anchors_m
            .refuse(format!("has {anchor_count} rows"))
            .allowed(format!("1 to {MAX_ANCHORS}")));
    }
    let anchors: Vec<Anchor> = (0..anchor_count)
        .map(|index| Anchor {
            name: format!("anchor {index}"),
            position_m: [anchors_m.float(3 * index), anchors_m.float(3 * index + 1)],
            height_m: anchors_m.float(3 * index + 2),
        })
        .collect();
    let truth = Truth::read(&archive.read("mocap_time_s")?, &archive.read("mocap_position_m")?)?;
    let mut notes = Vec::new();
    let table = archive.read("range_table")?;
    let rows = read_rows(&table, anchor_count, &truth, &mut notes)?;

    let mut cycles: Vec<Cycle> = Vec::with_capacity(rows.len());
    let mut cycle_of_row = Vec::with_capacity(rows.len());
    for row in &rows {
        let range = Range { anchor: row.anchor, range_m: row.raw_range_m, std_m: None };
        match cycles.last_mut() {
            // Time must go on from cycle to cycle: rows of the same instant share one.
            Some(last) if last.time_s == row.time_s => last.ranges.push(range),
            _ => {
                let position_m = truth.at(row.time_s);
                cycles.push(Cycle {
                    time_s: row.time_s,
                    truth_position_m: Some([position_m[0], position_m[1]]),
                    tag_height_m: options.heights.then_some(position_m[2]),
                    ranges: vec![range],
                    ..Cycle::default()
                });
            }
        }
        cycle_of_row.push(cycles.len() - 1);
    }
    attach_responses(&mut archive, options, &rows, &cycle_of_row, &mut cycles, &mut notes)?;

    let mean =
        |axis: usize| anchors.iter().map(|anchor| anchor.position_m[axis]).sum::<f64>() / anchor_count as f64;
    let pulse_duration_s = 2e-9;
    let stem = npz.file_stem().unwrap_or_default().to_string_lossy();
    let recording = Recording {
        name: format!("miluv {stem}"),
        source: format!(
            "Imported from the MILUV flight {stem}: DWM1000 radios, raw ranges, one cycle per range. The truth is the \
             body's centre by motion capture; the two tags, which ride about a quarter of a metre from it, are taken \
             for it. {}Channel 2 and the pulse are assumed, the pulse to peak {} samples after the first path. {}",
            if options.heights { "The tag's height is the altitude of the truth. " } else { "" },
            options.pulse_peak_samples,
            notes.join(" ")
        )
        .trim_end()
        .to_owned(),
        motion: Motion { acceleration_std_m_s2: 1.0 },
        start: Start {
            position_m: [mean(0), mean(1)],
            position_std_m: 1.5,
            velocity_std_m_s: 0.5,
            disc_radius_m: None,
            drawn_about_m: None,
        },
        association: AssociationModel {
            detection_probability: 0.95,
            clutter_per_anchor: 0.1,
            max_range_m: 30.0,
        },
        radio: Radio {
            pulse_duration_s,
            roll_off: 0.5,
            sampled_pulse: None,
            gain_control: true,
            sample_spacing_s: Some(DW1000_SAMPLE_SPACING_S),
            // A flying drone's ranges, the body's shadow included.
            range_std_m: 0.35,
            range_bias_mean_m: 0.0,
            // The antenna delay is unknown.
            range_bias_std_m: 0.15,
        },
        anchors,
        virtual_anchors: Vec::new(),
        walls: Vec::new(),
        plan: None,
        actions: vec![Action { carrier_hz: 3993.6e6, pulse_duration_s }],
        cycles,
    };
    Ok(Miluv { recording, notes })
}

/// One usable row of the range table.
struct Row {
    time_s: f64,
    tag: f64,
    anchor: usize,
    raw_range_m: f64,
}

/// The rows to anchors, in order of time. Rows to other tags are not ours.
fn read_rows(
    table: &Array,
    anchor_count: usize,
    truth: &Truth,
    notes: &mut Vec<String>,
) -> Result<Vec<Row>, InputError> {
    table.expect_shape(&[None, Some(11)])?;
    let (mut unusable, mut outside) = (0, 0);
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
        if !usable {
            unusable += 1;
        } else if !truth.covers(time_s) {
            outside += 1;
        } else {
            rows.push(Row { time_s, tag: cell(TAG), anchor: target as usize, raw_range_m });
        }
    }
    rows.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
    if unusable > 0 {
        notes
            .push(format!("{unusable} rows whose time, target or raw range is no such value were left out."));
    }
    if outside > 0 {
        notes.push(format!("{outside} rows before or after the truth were left out."));
    }
    if rows.is_empty() {
        return Err(table.refuse("has no usable range to an anchor"));
    }
    Ok(rows)
}

fn attach_responses(
    archive: &mut Archive<std::io::BufReader<std::fs::File>>,
    options: MiluvOptions,
    rows: &[Row],
    cycle_of_row: &[usize],
    cycles: &mut [Cycle],
    notes: &mut Vec<String>,
) -> Result<(), InputError> {
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
    let mut dropped = 0;
    for index in 0..count {
        let (time_s, tag, anchor) = (times.float(index), tags.float(index), anchors.float(index));
        let past = rows.partition_point(|row| row.time_s <= time_s);
        let row = (0..past)
            .rev()
            .take_while(|&row| time_s - rows[row].time_s <= MAX_LOG_DELAY_S)
            .find(|&row| rows[row].tag == tag && rows[row].anchor as f64 == anchor);
        let first_path = first_paths.float(index);
        let (Some(row), true) = (row, first_path.is_finite()) else {
            dropped += 1;
            continue;
        };
        let cycle = &mut cycles[cycle_of_row[row]];
        if cycle.frames.iter().any(|frame| frame.anchor == rows[row].anchor) {
            dropped += 1;
            continue;
        }
        cycle.frames.push(Frame {
            anchor: rows[row].anchor,
            action: 0,
            first_sample_delay_s: rows[row].raw_range_m / SPEED_OF_LIGHT_M_S
                - (first_path + options.pulse_peak_samples) * DW1000_SAMPLE_SPACING_S,
            first_path_index: Some(first_path),
            line_of_sight: None,
            samples: Samples::Magnitude(magnitudes.float_row(index)),
        });
    }
    notes.push(format!(
        "{} of {count} responses were attached to a range; {dropped} had none of their link within {MAX_LOG_DELAY_S} s \
         before them.",
        count - dropped
    ));
    Ok(())
}

/// The true positions of the body's centre.
struct Truth {
    times_s: Vec<f64>,
    positions_m: Vec<[f64; 3]>,
}

impl Truth {
    fn read(times: &Array, positions: &Array) -> Result<Self, InputError> {
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
        Ok(Self { times_s, positions_m })
    }

    fn covers(&self, time_s: f64) -> bool {
        self.times_s.first().is_some_and(|&first_s| time_s >= first_s)
            && self.times_s.last().is_some_and(|&last_s| time_s <= last_s)
    }

    /// The position at a time that is covered, by linear interpolation.
    fn at(&self, time_s: f64) -> [f64; 3] {
        let after = self.times_s.partition_point(|&other_s| other_s < time_s).min(self.times_s.len() - 1);
        let before = after.saturating_sub(1);
        let (start_s, end_s) = (self.times_s[before], self.times_s[after]);
        let part = if end_s > start_s { (time_s - start_s) / (end_s - start_s) } else { 1.0 };
        std::array::from_fn(|axis| {
            let (start_m, end_m) = (self.positions_m[before][axis], self.positions_m[after][axis]);
            start_m + part * (end_m - start_m)
        })
    }
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::io::Cursor;

    use super::super::tests::shared_data;
    use super::*;
    use crate::recording::npz::ArchiveWriter;
    use crate::recording::tests::Folder;

    /// Two anchors, three ranges (the last to another tag), three responses (one too late, one of a link without one).
    fn import(options: MiluvOptions) -> Miluv {
        let folder = Folder::new();
        let path = folder.0.join("flight.npz");
        let mut writer = ArchiveWriter::new(Cursor::new(Vec::new()));
        let mut add = |name: &str, shape: &[usize], values: &[f64]| {
            let bytes = values.iter().flat_map(|value| value.to_le_bytes());
            writer.add(name, Element::F64, shape, bytes).expect("is written");
        };
        add("anchors_m", &[2, 3], &[1.0, 2.0, 1.8, 3.0, 4.0, 1.9]);
        add("mocap_time_s", &[2], &[0.0, 10.0]);
        add("mocap_position_m", &[2, 3], &[0.0, 0.0, 0.0, 10.0, 20.0, 1.0]);
        let row = |time_s, target, raw_m| [time_s, 10.0, target, -9.0, raw_m, -9.0, -9.0, 0.0, 0.0, 0.0, 0.0];
        let table = [row(2.0, 1.0, 4.0), row(1.0, 0.0, 3.0), row(1.5, 11.0, 9.0)].concat();
        add("range_table", &[3, 11], &table);
        add("cir_time_s", &[3], &[1.15, 2.5, 2.1]);
        add("cir_tag", &[3], &[10.0, 10.0, 11.0]);
        add("cir_anchor", &[3], &[0.0, 1.0, 1.0]);
        add("cir_first_path_index", &[3], &[2.5, 2.5, 2.5]);
        add("cir_magnitude", &[3, 4], &[0.0, 1.0, 2.0, 3.0, 0.0, 1.0, 2.0, 3.0, 0.0, 1.0, 2.0, 3.0]);
        fs::write(&path, writer.finish().expect("ends").into_inner()).expect("is written");
        miluv(&path, options).expect("is imported")
    }

    #[test]
    fn rows_become_cycles_in_order_of_time_with_their_raw_range() {
        let Miluv { recording, .. } = import(MiluvOptions::default());
        assert_eq!(recording.cycles.len(), 2);
        let first = &recording.cycles[0];
        assert_eq!(first.time_s, 1.0);
        assert_eq!(first.truth_position_m, Some([1.0, 2.0]));
        assert_eq!(first.tag_height_m, Some(0.1));
        assert_eq!(first.ranges, [Range { anchor: 0, range_m: 3.0, std_m: None }]);
        assert_eq!(recording.start.position_m, [2.0, 3.0]);
        assert_eq!(
            import(MiluvOptions { heights: false, ..MiluvOptions::default() }).recording.cycles[0]
                .tag_height_m,
            None
        );
    }

    #[test]
    fn responses_go_to_the_range_of_their_link_or_are_counted() {
        let Miluv { recording, notes } = import(MiluvOptions::default());
        let frame = &recording.cycles[0].frames[0];
        assert_eq!(frame.samples, Samples::Magnitude(vec![0.0, 1.0, 2.0, 3.0]));
        let peak_s = frame.first_sample_delay_s + 4.5 * DW1000_SAMPLE_SPACING_S;
        assert!((peak_s * SPEED_OF_LIGHT_M_S - 3.0).abs() < 1e-9);
        assert!(recording.cycles[1].frames.is_empty());
        assert!(notes[0].starts_with("1 of 3 responses"), "{notes:?}");
        assert!(recording.source.contains(&notes[0]));
    }

    #[test]
    fn the_flight_is_imported_whole() {
        let Some(folder) = shared_data("miluv") else { return };
        let Miluv { recording, notes } =
            miluv(&folder.join("random_1.npz"), MiluvOptions::default()).expect("is imported");
        assert_eq!(recording.cycles.len(), 954);
        assert_eq!(recording.anchors.len(), 6);
        let frames: usize = recording.cycles.iter().map(|cycle| cycle.frames.len()).sum();
        assert_eq!(frames, 576, "{notes:?}");
        assert_eq!(recording.cycles[0].ranges[0].range_m, 3.474_100_112_915_039);
        let copy = Folder::new();
        recording.write(&copy.0).expect("is written");
        assert_eq!(Recording::read(&copy.0).expect("is read"), recording);
    }
}
