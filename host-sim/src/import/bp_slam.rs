//! The reference scenario of belief-propagation multipath SLAM: synthetic ranges to two anchors and their mirror
//! images, in three CSV files.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Deserialize;

use super::{csv_rows, finite};
use crate::input_error::InputError;
use crate::recording::{
    Action, Anchor, AssociationModel, Cycle, MAX_ANCHORS, Motion, Radio, Range, Recording, Start,
    VirtualAnchor,
};

/// One physical or virtual anchor. The columns of the file are `sensor` (from 1), `index` (unused),
/// `is_physical_anchor` (0 or 1), `x_m`, `y_m`.
#[derive(Deserialize)]
struct AnchorRow {
    sensor: usize,
    is_physical_anchor: u8,
    x_m: f64,
    y_m: f64,
}

#[derive(Deserialize)]
struct TruthRow {
    step: u32,
    x_m: f64,
    y_m: f64,
}

#[derive(Deserialize)]
struct RangeRow {
    step: u32,
    sensor: usize,
    range_m: f64,
}

/// Imports the scenario from its tables of anchors, true positions and ranges.
///
/// One step is one second. The physical anchors are given; their mirror images serve for scoring only, as in the
/// original. Range deviation, detection and clutter are those that the ranges were made with, the motion that of the
/// reference filter. There are no frames: pulse and carrier are placeholders.
///
/// # Errors
///
/// A file that cannot be read, or a row that makes no sense, named by its line.
pub fn bp_slam(anchors: &Path, truth: &Path, ranges: &Path) -> Result<Recording, InputError> {
    let (physical, virtual_anchors) = read_anchors(anchors)?;
    let mut cycles = read_truth(truth)?;
    read_ranges(ranges, &physical, &mut cycles)?;
    let stem = |path: &Path| path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let first_m = cycles.values().next().and_then(|cycle| cycle.truth_position_m).unwrap_or_default();
    let pulse_duration_s = 0.5e-9;
    Ok(Recording {
        name: format!("bp-slam {}", stem(ranges)),
        source: format!(
            "Imported from the reference scenario of belief-propagation multipath SLAM ({}, {}, {}): synthetic \
             ranges, one step a second. Pulse and carrier are placeholders.",
            stem(anchors),
            stem(truth),
            stem(ranges)
        ),
        motion: Motion::published(0.01),
        start: Start {
            position_m: first_m,
            position_std_m: 0.25,
            velocity_std_m_s: 0.03,
            disc_radius_m: Some(0.5),
            drawn_about_m: None,
        },
        association: AssociationModel {
            detection_probability: 0.95,
            clutter_per_anchor: 1.0,
            max_range_m: 30.0,
        },
        radio: Radio {
            pulse_duration_s,
            roll_off: 0.6,
            sampled_pulse: None,
            gain_control: false,
            begins_with_path: false,
            sample_spacing_s: None,
            range_std_m: 0.1,
            range_bias_mean_m: 0.0,
            range_bias_std_m: 0.0,
            range_late_m: 0.0,
            range_floor_pulses: None,
        },
        anchors: physical,
        virtual_anchors,
        walls: Vec::new(),
        plan: None,
        antennas: Vec::new(),
        actions: vec![Action { carrier_hz: 7e9, pulse_duration_s }],
        cycles: cycles.into_values().collect(),
    })
}

fn read_anchors(path: &Path) -> Result<(Vec<Anchor>, Vec<VirtualAnchor>), InputError> {
    let rows: Vec<(u64, AnchorRow)> = csv_rows(path)?;
    let mut physical = BTreeMap::new();
    let mut virtual_anchors = Vec::new();
    for (line, row) in rows {
        let refuse = |item: &str, reason: String| InputError::new(path, reason).at_line(line).for_item(item);
        if row.sensor == 0 || row.sensor > MAX_ANCHORS {
            return Err(refuse("sensor", format!("is {}", row.sensor)).allowed(format!("1 to {MAX_ANCHORS}")));
        }
        let position_m = [finite(path, line, "x_m", row.x_m)?, finite(path, line, "y_m", row.y_m)?];
        match row.is_physical_anchor {
            0 => virtual_anchors.push(VirtualAnchor::new(row.sensor - 1, position_m, 0.0, false)),
            1 => {
                let anchor = Anchor::new(format!("sensor {}", row.sensor), position_m, 0.0);
                if physical.insert(row.sensor, anchor).is_some() {
                    return Err(refuse("sensor", format!("{} has a second physical anchor", row.sensor)));
                }
            }
            other => return Err(refuse("is_physical_anchor", format!("is {other}")).allowed("0 or 1")),
        }
    }
    let sensors = physical.len().max(virtual_anchors.iter().map(|image| image.anchor + 1).max().unwrap_or(0));
    if let Some(missing) = (1..=sensors).find(|sensor| !physical.contains_key(sensor)) {
        return Err(InputError::new(path, format!("has no physical anchor of sensor {missing}")));
    }
    Ok((physical.into_values().collect(), virtual_anchors))
}

fn read_truth(path: &Path) -> Result<BTreeMap<u32, Cycle>, InputError> {
    let rows: Vec<(u64, TruthRow)> = csv_rows(path)?;
    let mut cycles = BTreeMap::new();
    for (line, row) in rows {
        let position_m = [finite(path, line, "x_m", row.x_m)?, finite(path, line, "y_m", row.y_m)?];
        let cycle =
            Cycle { time_s: f64::from(row.step), truth_position_m: Some(position_m), ..Cycle::default() };
        if cycles.insert(row.step, cycle).is_some() {
            return Err(InputError::new(path, format!("{} is there twice", row.step))
                .at_line(line)
                .for_item("step"));
        }
    }
    Ok(cycles)
}

fn read_ranges(path: &Path, anchors: &[Anchor], cycles: &mut BTreeMap<u32, Cycle>) -> Result<(), InputError> {
    let rows: Vec<(u64, RangeRow)> = csv_rows(path)?;
    for (line, row) in rows {
        let refuse = |item: &str, reason: String| InputError::new(path, reason).at_line(line).for_item(item);
        let Some(cycle) = cycles.get_mut(&row.step) else {
            return Err(refuse("step", format!("{} is not among the steps of the true positions", row.step)));
        };
        if row.sensor == 0 || row.sensor > anchors.len() {
            return Err(
                refuse("sensor", format!("is {}", row.sensor)).allowed(format!("1 to {}", anchors.len()))
            );
        }
        if finite(path, line, "range_m", row.range_m)? < 0.0 {
            return Err(refuse("range_m", format!("is {}", row.range_m)).allowed("from 0"));
        }
        cycle.ranges.push(Range { anchor: row.sensor - 1, range_m: row.range_m, std_m: None, angles: None });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::super::tests::shared_data;
    use super::*;
    use crate::recording::tests::Folder;

    const ANCHORS: &str = "sensor,index,is_physical_anchor,x_m,y_m\n1,0,1,0.5,7\n1,1,0,8.1,7\n2,0,1,5,2\n";
    const TRUTH: &str = "step,x_m,y_m\n0,3,7\n1,3.01,7\n";
    const RANGES: &str = "step,sensor,range_m\n0,1,2.5\n0,2,5.4\n1,1,2.51\n1,1,12\n";

    fn import(anchors: &str, truth: &str, ranges: &str) -> Result<Recording, InputError> {
        let folder = Folder::new();
        let path = |name: &str, text: &str| {
            let path = folder.0.join(name);
            fs::write(&path, text).expect("is written");
            path
        };
        bp_slam(&path("anchors.csv", anchors), &path("truth.csv", truth), &path("ranges.csv", ranges))
    }

    #[test]
    fn sensors_become_anchors_and_their_images_truth() {
        let recording = import(ANCHORS, TRUTH, RANGES).expect("is imported");
        assert_eq!(recording.anchors.len(), 2);
        assert_eq!(recording.virtual_anchors.len(), 1);
        assert!(!recording.virtual_anchors[0].known);
        assert_eq!(recording.start.position_m, [3.0, 7.0]);
        assert_eq!(recording.cycles[1].ranges.len(), 2);
        assert_eq!(
            recording.cycles[0].ranges[1],
            Range { anchor: 1, range_m: 5.4, std_m: None, angles: None }
        );
        let folder = Folder::new();
        recording.write(&folder.0).expect("is a valid recording");
    }

    #[test]
    fn rows_that_make_no_sense_are_refused_with_their_line() {
        let cases = [
            (ANCHORS, TRUTH, "step,sensor,range_m\n0,1,2.5\n0,3,5.4\n", 3, "sensor"),
            (ANCHORS, TRUTH, "step,sensor,range_m\n9,1,2.5\n", 2, "step"),
            (ANCHORS, TRUTH, "step,sensor,range_m\n0,1,-1\n", 2, "range_m"),
            (ANCHORS, TRUTH, "step,sensor,range_m\n0,1,NaN\n", 2, "range_m"),
            (ANCHORS, "step,x_m,y_m\n0,3,inf\n", RANGES, 2, "y_m"),
            (ANCHORS, "step,x_m,y_m\n0,3,7\n0,3,7\n", RANGES, 3, "step"),
            ("sensor,index,is_physical_anchor,x_m,y_m\n0,0,1,0.5,7\n", TRUTH, RANGES, 2, "sensor"),
        ];
        for (anchors, truth, ranges, line, item) in cases {
            let error = import(anchors, truth, ranges).expect_err("is refused");
            assert_eq!((error.line(), error.item()), (Some(line), Some(item)), "{error}");
        }
    }

    #[test]
    fn text_instead_of_numbers_and_missing_columns_are_refused_with_their_line() {
        let error = import(ANCHORS, TRUTH, "step,sensor,range_m\n0,1,far\n").expect_err("is refused");
        assert_eq!(error.line(), Some(2), "{error}");
        let error = import(ANCHORS, TRUTH, "step,sensor\n0,1\n").expect_err("is refused");
        assert!(error.to_string().contains("range_m"), "{error}");
        let error = import(ANCHORS, TRUTH, "step,sensor,range_m\n0,1\n").expect_err("is refused");
        assert_eq!(error.line(), Some(2), "{error}");
        import(ANCHORS, TRUTH, "").expect_err("is refused");
        import("sensor,index,is_physical_anchor,x_m,y_m\n1,1,0,8,7\n", TRUTH, RANGES)
            .expect_err("is refused");
    }

    #[test]
    fn the_reference_scenario_is_imported_whole() {
        let Some(folder) = shared_data("bp-slam") else { return };
        for seed in 1..=2 {
            let recording = bp_slam(
                &folder.join("anchors_vas.csv"),
                &folder.join("true_trajectory.csv"),
                &folder.join(format!("measurements_seed{seed}.csv")),
            )
            .expect("is imported");
            assert_eq!((recording.anchors.len(), recording.virtual_anchors.len()), (2, 9));
            assert_eq!(recording.cycles.len(), 900);
            // Eleven visible paths at 0.95 and two false alarms make 12.45 a step.
            let ranges: usize = recording.cycles.iter().map(|cycle| cycle.ranges.len()).sum();
            assert!((11_000..11_400).contains(&ranges), "{ranges}");
            let copy = Folder::new();
            recording.write(&copy.0).expect("is written");
            assert_eq!(Recording::read(&copy.0).expect("is read"), recording);
        }
    }
}
