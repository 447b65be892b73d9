//! Multipath measured place by place along a way: delays and directions of all paths of one base station, in two CSV
//! files.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Deserialize;

use super::{csv_rows, finite};
use crate::input_error::InputError;
use crate::recording::{
    Action, Anchor, Angles, AssociationModel, Cycle, Motion, Radio, Range, Recording, Start, VirtualAnchor,
};
use crate::replay::drawn_start;

/// The told start lies within this of the first place, whoever draws it.
const START_RADIUS_M: f64 = 0.2;
/// How well a position of the map is told, per axis.
const MAP_STD_M: f64 = 0.3;
/// The range of no path is beyond this; what is reflected arrives from further than the hall is wide.
const MAX_RANGE_M: f64 = 100.0;

/// One place. A column `heading_rad` may follow; it is not used.
#[derive(Deserialize)]
struct PlaceRow {
    place: u32,
    x_m: f64,
    y_m: f64,
}

/// One path. A column `power_db` may follow; it is not used.
#[derive(Deserialize)]
struct PathRow {
    place: u32,
    range_m: f64,
    departure_angle_rad: f64,
    arrival_angle_rad: f64,
}

/// What the files do not say.
#[derive(Clone, Debug, PartialEq)]
pub struct SnapshotOptions {
    /// Where the base station is, in metres.
    pub anchor_m: [f64; 2],
    /// Virtual anchors that the tracker is told, each with a deviation of 0.3 m per axis.
    pub map_m: Vec<[f64; 2]>,
    /// Seed of the told start.
    pub seed: u64,
}

/// Imports the places and their paths.
///
/// Place n becomes the cycle at n seconds, its paths the ranges of that cycle, directions included. The told start is
/// drawn with the seed within 0.2 m of the first place. There are no frames: the carrier stands for the measurement's,
/// pulse and pulse duration are placeholders.
///
/// # Errors
///
/// A file that cannot be read, or a row that makes no sense, named by its line.
pub fn snapshot(places: &Path, paths: &Path, options: &SnapshotOptions) -> Result<Recording, InputError> {
    let mut cycles = read_places(places)?;
    read_paths(paths, &mut cycles)?;
    let pulse_duration_s = 2.5e-9;
    let first_m = cycles.values().next().and_then(|cycle| cycle.truth_position_m).unwrap_or_default();
    let mut start = Start {
        position_m: first_m,
        // Of a point uniform in the disc, per axis.
        position_std_m: 0.5 * START_RADIUS_M,
        velocity_std_m_s: 0.5,
        disc_radius_m: Some(START_RADIUS_M),
        drawn_about_m: Some(first_m),
    };
    start.position_m = drawn_start(&start, Some(options.seed));
    let stem = |path: &Path| path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let known = |position_m: &[f64; 2]| VirtualAnchor::new(0, *position_m, MAP_STD_M, true);
    let folder = places.parent().and_then(Path::file_name).map(|name| name.to_string_lossy().into_owned());
    Ok(Recording {
        name: format!("snapshot {}", folder.unwrap_or_else(|| stem(paths))),
        source: format!(
            "Imported from measurements place by place ({}, {}): one base station, ranges and directions of all paths, \
             one place a second. The told start is drawn within {START_RADIUS_M} m of the first place with seed {}. \
             Directions are relative to the headings of base station and tag. Motion, deviations, detection and clutter \
             are assumed; pulse and carrier are placeholders.",
            stem(places),
            stem(paths),
            options.seed
        ),
        motion: Motion::of_acceleration(0.3),
        start,
        association: AssociationModel {
            // Hidden and merged paths are common, and most paths come from more than one reflection.
            detection_probability: 0.7,
            clutter_per_anchor: 3.0,
            max_range_m: MAX_RANGE_M,
        },
        radio: Radio {
            pulse_duration_s,
            roll_off: 0.5,
            sampled_pulse: None,
            gain_control: false,
            begins_with_path: false,
            sample_spacing_s: None,
            range_std_m: 0.15,
            range_bias_mean_m: 0.0,
            range_bias_std_m: 0.0,
            range_late_m: 0.0,
            range_floor_pulses: None,
        },
        anchors: vec![Anchor::new("base station", options.anchor_m, 0.0)],
        virtual_anchors: options.map_m.iter().map(known).collect(),
        walls: Vec::new(),
        plan: None,
        antennas: Vec::new(),
        actions: vec![Action { carrier_hz: 60e9, pulse_duration_s }],
        cycles: cycles.into_values().collect(),
    })
}

fn read_places(path: &Path) -> Result<BTreeMap<u32, Cycle>, InputError> {
    let rows: Vec<(u64, PlaceRow)> = csv_rows(path)?;
    let mut cycles = BTreeMap::new();
    for (line, row) in rows {
        let position_m = [finite(path, line, "x_m", row.x_m)?, finite(path, line, "y_m", row.y_m)?];
        let cycle =
            Cycle { time_s: f64::from(row.place), truth_position_m: Some(position_m), ..Cycle::default() };
        if cycles.insert(row.place, cycle).is_some() {
            return Err(InputError::new(path, format!("{} is there twice", row.place))
                .at_line(line)
                .for_item("place"));
        }
    }
    Ok(cycles)
}

fn read_paths(path: &Path, cycles: &mut BTreeMap<u32, Cycle>) -> Result<(), InputError> {
    let rows: Vec<(u64, PathRow)> = csv_rows(path)?;
    for (line, row) in rows {
        let refuse = |item: &str, reason: String| InputError::new(path, reason).at_line(line).for_item(item);
        let Some(cycle) = cycles.get_mut(&row.place) else {
            return Err(refuse("place", format!("{} is not among the places", row.place)));
        };
        if !(0.0..=MAX_RANGE_M).contains(&row.range_m) {
            return Err(
                refuse("range_m", format!("is {}", row.range_m)).allowed(format!("0 to {MAX_RANGE_M}"))
            );
        }
        let angle = |column: &str, value: f64| {
            // A whole turn either way: what is larger is in degrees.
            if value.abs() <= std::f64::consts::TAU {
                return Ok(value);
            }
            Err(refuse(column, format!("is {value}")).allowed("-2 pi to 2 pi"))
        };
        let angles = Angles {
            departure_rad: angle("departure_angle_rad", row.departure_angle_rad)?,
            arrival_rad: angle("arrival_angle_rad", row.arrival_angle_rad)?,
        };
        cycle.ranges.push(Range { anchor: 0, range_m: row.range_m, std_m: None, angles: Some(angles) });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::super::tests::shared_data;
    use super::*;
    use crate::recording::tests::Folder;
    use crate::replay::Setup;

    const PLACES: &str = "place,x_m,y_m,heading_rad\n3,1,2,0\n4,1.5,2,0\n6,2.5,2,0\n";
    const PATHS: &str = "place,range_m,departure_angle_rad,arrival_angle_rad,power_db\n4,5.5,0.1,-0.2,-40\n\
                         3,5,0.3,1.5,-41\n3,9,-3.1,0,-42\n";

    fn import(places: &str, paths: &str, options: &SnapshotOptions) -> Result<Recording, InputError> {
        let folder = Folder::new();
        let path = |name: &str, text: &str| {
            let path = folder.0.join(name);
            fs::write(&path, text).expect("is written");
            path
        };
        snapshot(&path("places.csv", places), &path("paths.csv", paths), options)
    }

    fn options(seed: u64) -> SnapshotOptions {
        SnapshotOptions { anchor_m: [2.0, 7.0], map_m: vec![[2.0, -7.0], [-12.0, 7.0]], seed }
    }

    #[test]
    fn places_become_seconds_and_paths_their_ranges_with_directions() {
        let recording = import(PLACES, PATHS, &options(1)).expect("is imported");
        let times: Vec<f64> = recording.cycles.iter().map(|cycle| cycle.time_s).collect();
        assert_eq!(times, [3.0, 4.0, 6.0]);
        let counts: Vec<usize> = recording.cycles.iter().map(|cycle| cycle.ranges.len()).collect();
        assert_eq!(counts, [2, 1, 0]);
        assert_eq!(recording.cycles[1].truth_position_m, Some([1.5, 2.0]));
        let angles = Some(Angles { departure_rad: 0.1, arrival_rad: -0.2 });
        assert_eq!(recording.cycles[1].ranges, [Range { anchor: 0, range_m: 5.5, std_m: None, angles }]);
        assert_eq!(recording.anchors[0].position_m, [2.0, 7.0]);
        let told: Vec<_> =
            recording.virtual_anchors.iter().map(|va| (va.position_m, va.std_m, va.known)).collect();
        assert_eq!(told, [([2.0, -7.0], 0.3, true), ([-12.0, 7.0], 0.3, true)]);
        let folder = Folder::new();
        recording.write(&folder.0).expect("is a valid recording");
        assert_eq!(Recording::read(&folder.0).expect("is read"), recording);
    }

    #[test]
    fn the_start_is_near_the_first_place_but_never_the_truth_and_the_seed_decides() {
        let mut starts = Vec::new();
        for seed in 1..=20 {
            let recording = import(PLACES, PATHS, &options(seed)).expect("is imported");
            let again = import(PLACES, PATHS, &options(seed)).expect("is imported");
            assert_eq!(again.start, recording.start);
            for track_seed in [None, Some(1), Some(seed), Some(99)] {
                let setup = Setup::new(&recording, Path::new("snapshot"), track_seed).expect("is taken");
                let [x, y] = setup.config.start.position_m.map(f64::from);
                let error_m = (x - 1.0).hypot(y - 2.0);
                assert!(error_m > 1e-4 && error_m <= 0.2, "seed {seed}, {track_seed:?}: {error_m} m");
            }
            starts.push(recording.start.position_m);
        }
        starts.sort_by(|a, b| a[0].total_cmp(&b[0]));
        starts.dedup();
        assert_eq!(starts.len(), 20);
    }

    #[test]
    fn rows_that_make_no_sense_are_refused_with_their_line() {
        let paths =
            |row: &str| format!("place,range_m,departure_angle_rad,arrival_angle_rad\n3,5,0,0\n{row}\n");
        let cases = [
            (PLACES, paths("9,5,0,0"), 3, "place"),
            (PLACES, paths("3,-1,0,0"), 3, "range_m"),
            (PLACES, paths("3,NaN,0,0"), 3, "range_m"),
            (PLACES, paths("3,1e9,0,0"), 3, "range_m"),
            (PLACES, paths("3,5,90,0"), 3, "departure_angle_rad"),
            (PLACES, paths("3,5,0,NaN"), 3, "arrival_angle_rad"),
            ("place,x_m,y_m\n3,1,2\n4,inf,2\n", PATHS.into(), 3, "x_m"),
            ("place,x_m,y_m\n3,1,2\n3,1,2\n", PATHS.into(), 3, "place"),
        ];
        for (places, paths, line, item) in cases {
            let error = import(places, &paths, &options(1)).expect_err("is refused");
            assert_eq!((error.line(), error.item()), (Some(line), Some(item)), "{error}");
        }
    }

    #[test]
    fn text_instead_of_numbers_and_missing_columns_are_refused() {
        let refusal = |places: &str, paths: &str| import(places, paths, &options(1)).expect_err("is refused");
        let error = refusal(PLACES, "place,range_m,departure_angle_rad,arrival_angle_rad\n3,far,0,0\n");
        assert_eq!(error.line(), Some(2), "{error}");
        let error = refusal(PLACES, "place,range_m,arrival_angle_rad\n3,5,0\n");
        assert!(error.to_string().contains("departure_angle_rad"), "{error}");
        let error = refusal("place,x_m\n3,1\n", PATHS);
        assert!(error.to_string().contains("y_m") && error.file().ends_with("places.csv"), "{error}");
        assert!(refusal("", PATHS).file().ends_with("places.csv"));
        assert!(refusal(PLACES, "").file().ends_with("paths.csv"));
        let error = refusal("place,x_m,y_m\n-1,1,2\n", PATHS);
        assert_eq!(error.line(), Some(2), "{error}");
    }

    #[test]
    fn the_hall_is_imported_whole() {
        let Some(folder) = shared_data("kampusareena") else { return };
        let options =
            SnapshotOptions { anchor_m: [2.25, 2.5], map_m: vec![[5.8, 3.3], [-7.0, -18.5]], seed: 1 };
        let recording =
            snapshot(&folder.join("places.csv"), &folder.join("paths.csv"), &options).expect("is imported");
        assert_eq!(recording.cycles.len(), 45);
        let ranges = recording.cycles.iter().map(|cycle| cycle.ranges.len());
        assert_eq!(ranges.clone().sum::<usize>(), 362);
        assert_eq!((ranges.clone().min(), ranges.max()), (Some(4), Some(11)));
        // The shortest path is the direct one at all places but 0, 1 and 36, and short of 0.22 m right.
        for (place, cycle) in recording.cycles.iter().enumerate() {
            let [x, y] = cycle.truth_position_m.expect("is known");
            let direct_m = (x - 2.25).hypot(y - 2.5);
            let shortest_m = cycle.ranges.iter().map(|range| range.range_m).fold(f64::INFINITY, f64::min);
            let is_direct = (shortest_m - direct_m).abs() < 0.23;
            assert_eq!(is_direct, ![0, 1, 36].contains(&place), "place {place}: {} m", shortest_m - direct_m);
        }
    }
}
