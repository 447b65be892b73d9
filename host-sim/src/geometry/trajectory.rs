//! The ways of tags and people: where they are at which time.

use std::path::Path;

use super::{between, length, sub};
use crate::input_error::{InputError, in_one_line};
use crate::scenario::{Position, Trajectory, Way, Waypoint};

/// No way has more poses than this.
pub const MAX_POSES: usize = 1_000_000;

/// A pose this little past the end of a way still belongs to it, in steps.
pub(crate) const ROUNDING: f64 = 1e-6;

/// No recorded way is longer than this.
const MAX_BYTES: u64 = 256 << 20;

/// Where a tag is in one cycle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Time, seconds.
    pub time_s: f64,
    /// Horizontal position, metres.
    pub position_m: [f64; 2],
    /// Height, metres, where the way gives one.
    pub height_m: Option<f64>,
}

/// The pose in every cycle of a trajectory, the first at the start of its way. `folder` is where the scenario's file
/// lies; the file of a recorded way is relative to it.
///
/// # Errors
///
/// A recorded way that cannot be read, by line and column; a way of fewer than `cycles` or, without that key, of more
/// than [`MAX_POSES`]. Errors that concern no file of their own name the folder.
pub fn poses(trajectory: &Trajectory, folder: Option<&Path>) -> Result<Vec<Pose>, InputError> {
    let folder = folder.unwrap_or(Path::new("."));
    match &trajectory.way {
        Way::Polyline { vertices_m, step_m } => {
            sampled(trajectory, folder, &by_distance(vertices_m), *step_m, "step_m")
        }
        Way::Waypoints { points } => {
            sampled(trajectory, folder, &by_time(points), trajectory.period_s, "period_s")
        }
        Way::Recorded { file } => {
            let file = folder.join(file);
            let mut poses = recorded(&file, trajectory.period_s)?;
            poses.truncate(cycles(trajectory, &file, poses.len())?);
            Ok(poses)
        }
    }
}

/// Where somebody is who walks the polyline `way_m` at constant speed there and back again, from its first point at
/// time 0. A way without length stands still; one without points is nowhere (NaN).
pub fn person_at(way_m: &[[f64; 2]], speed_m_s: f64, time_s: f64) -> [f64; 2] {
    let stations = by_distance(way_m);
    let way_m = end(&stations);
    let walked_m = if way_m > 0.0 { (speed_m_s * time_s).rem_euclid(2.0 * way_m) } else { 0.0 };
    at(&stations, walked_m.min(2.0 * way_m - walked_m))
}

/// A point of a way and how far along it lies, in metres or seconds.
type Station = (f64, Position);

fn by_distance(vertices_m: &[Position]) -> Vec<Station> {
    let mut walked_m = 0.0;
    let mut before_m = vertices_m.first().copied();
    let station = |&vertex_m: &Position| {
        walked_m += length(sub(vertex_m, before_m.replace(vertex_m).unwrap_or(vertex_m)));
        (walked_m, vertex_m)
    };
    vertices_m.iter().map(station).collect()
}

fn by_time(points: &[Waypoint]) -> Vec<Station> {
    let mut time_s = 0.0;
    let mut stations = Vec::with_capacity(2 * points.len());
    for (index, point) in points.iter().enumerate() {
        stations.push((time_s, point.position_m));
        time_s += point.pause_s;
        stations.push((time_s, point.position_m));
        if let Some(next) = points.get(index + 1) {
            time_s += length(sub(next.position_m, point.position_m)) / point.speed_m_s;
        }
    }
    stations
}

fn end(stations: &[Station]) -> f64 {
    stations.last().map_or(0.0, |&(end, _)| end)
}

/// The position at `along`; beyond the ends of the way, its ends.
fn at(stations: &[Station], along: f64) -> Position {
    let next = stations.partition_point(|&(station, _)| station <= along);
    match (next.checked_sub(1).map(|before| stations[before]), stations.get(next)) {
        (Some((from, a)), Some(&(to, b))) => between(a, b, (along - from) / (to - from)),
        (Some((_, only)), None) | (None, Some(&(_, only))) => only,
        (None, None) => [f64::NAN; 2],
    }
}

/// Poses at every multiple of `step` along the way.
fn sampled(
    trajectory: &Trajectory,
    file: &Path,
    stations: &[Station],
    step: f64,
    key: &str,
) -> Result<Vec<Pose>, InputError> {
    // As a float: a way may have more steps than an integer holds.
    let steps = (end(stations) / step + ROUNDING).floor();
    let all = if steps < MAX_POSES as f64 { steps as usize + 1 } else { usize::MAX };
    if all == usize::MAX && trajectory.cycles.is_none_or(|wanted| wanted > MAX_POSES) {
        return Err(InputError::new(file, format!("is {step}, which gives more than {MAX_POSES} cycles"))
            .for_item(key)
            .allowed(format!("at least {}", end(stations) / (MAX_POSES - 1) as f64)));
    }
    let pose = |cycle: usize| Pose {
        time_s: cycle as f64 * trajectory.period_s,
        position_m: at(stations, cycle as f64 * step),
        height_m: None,
    };
    Ok((0..cycles(trajectory, file, all)?).map(pose).collect())
}

/// How many of the `all` cycles that a way has are wanted.
fn cycles(trajectory: &Trajectory, file: &Path, all: usize) -> Result<usize, InputError> {
    match trajectory.cycles {
        Some(wanted) if wanted > all => Err(InputError::new(
            file,
            format!("is {wanted}, but the way of trajectory \"{}\" has {all}", trajectory.name),
        )
        .for_item("cycles")
        .allowed(format!("1 to {all}"))),
        Some(wanted) => Ok(wanted),
        None => Ok(all),
    }
}

/// The columns that a recorded way may have: the first two must be there.
const COLUMNS: [(&str, f64); 4] = [("x_m", 1e3), ("y_m", 1e3), ("time_s", 1e10), ("height_m", 100.0)];

/// A recorded way: one pose a row.
fn recorded(file: &Path, period_s: f64) -> Result<Vec<Pose>, InputError> {
    let refuse = |error: csv::Error| {
        let line = error.position().map(csv::Position::line);
        let reason = match error.kind() {
            csv::ErrorKind::Io(error) => format!("cannot be read: {}", in_one_line(error)),
            csv::ErrorKind::UnequalLengths { expected_len, len, .. } => {
                format!("has {len} columns where the header has {expected_len}")
            }
            csv::ErrorKind::Utf8 { .. } => "is not text in UTF-8".into(),
            _ => in_one_line(error),
        };
        InputError::new(file, reason).at_line(line)
    };
    // Neither a device without end nor a file of another kind is read into memory.
    let usable = std::fs::metadata(file).is_ok_and(|about| about.is_file() && about.len() <= MAX_BYTES);
    if file.exists() && !usable {
        return Err(
            InputError::new(file, "is no file, or too long").allowed(format!("at most {MAX_BYTES} bytes"))
        );
    }
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_path(file).map_err(refuse)?;
    let columns = columns(file, reader.headers().map_err(refuse)?)?;
    let mut poses: Vec<Pose> = Vec::new();
    for record in reader.records() {
        let record = record.map_err(refuse)?;
        let line = record.position().map(csv::Position::line);
        if poses.len() == MAX_POSES {
            return Err(InputError::new(file, "has more rows")
                .at_line(line)
                .allowed(format!("{MAX_POSES} rows")));
        }
        let number = |column: usize| -> Result<Option<f64>, InputError> {
            let (name, largest) = COLUMNS[column];
            let Some(text) = columns[column].and_then(|place| record.get(place)) else { return Ok(None) };
            match text.parse::<f64>() {
                Ok(value) if value.abs() <= largest => Ok(Some(value)),
                _ => Err(InputError::new(file, format!("is {text:?}"))
                    .at_line(line)
                    .for_item(name)
                    .allowed(format!("-{largest} to {largest}"))),
            }
        };
        let (Some(x_m), Some(y_m)) = (number(0)?, number(1)?) else { continue };
        let time_s = number(2)?.unwrap_or(poses.len() as f64 * period_s);
        if let Some(before) = poses.last()
            && !(time_s > before.time_s)
        {
            return Err(InputError::new(
                file,
                format!("is {time_s}, not after the {} before it", before.time_s),
            )
            .at_line(line)
            .for_item("time_s"));
        }
        poses.push(Pose { time_s, position_m: [x_m, y_m], height_m: number(3)? });
    }
    if poses.is_empty() {
        return Err(InputError::new(file, "has no rows"));
    }
    Ok(poses)
}

/// Where each of [`COLUMNS`] is in the rows.
fn columns(file: &Path, header: &csv::StringRecord) -> Result<[Option<usize>; 4], InputError> {
    let refuse = |name: &str, reason: &str| Err(InputError::new(file, reason).at_line(1).for_item(name));
    let mut places = [None; 4];
    for (place, name) in header.iter().enumerate() {
        let Some(column) = COLUMNS.iter().position(|&(known, _)| known == name) else {
            return refuse(name, "is no column of a way")
                .map_err(|error| error.allowed("x_m, y_m, time_s and height_m"));
        };
        if places[column].replace(place).is_some() {
            return refuse(name, "is there twice");
        }
    }
    for column in 0..2 {
        if places[column].is_none() {
            return refuse(COLUMNS[column].0, "is missing");
        }
    }
    Ok(places)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn along(way: Way, cycles: Option<usize>) -> Result<Vec<Pose>, InputError> {
        poses(&Trajectory { name: "walk".into(), period_s: 0.5, cycles, way }, Some(Path::new("folder")))
    }

    fn polyline(vertices_m: &[Position], step_m: f64) -> Way {
        Way::Polyline { vertices_m: vertices_m.to_vec(), step_m }
    }

    fn near(a: Position, b: Position) {
        assert!(length(sub(a, b)) < 1e-9, "{a:?} instead of {b:?}");
    }

    /// The error, or how many poses there are, of a recorded way of these lines.
    fn from_csv(test: &str, text: &str) -> Result<Vec<Pose>, InputError> {
        let folder = std::env::temp_dir().join(format!("cogmint-trajectory-{test}-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(folder.join("way.csv"), text).unwrap();
        let way = Way::Recorded { file: "way.csv".into() };
        let result =
            poses(&Trajectory { name: String::new(), period_s: 0.5, cycles: None, way }, Some(&folder));
        std::fs::remove_dir_all(&folder).unwrap();
        result
    }

    #[test]
    fn a_polyline_is_stepped_along_its_length_up_to_its_end() {
        let poses = along(polyline(&[[0.0, 0.0], [1.0, 0.0], [1.0, 0.0], [1.0, 0.5]], 0.3), None).unwrap();
        assert_eq!(poses.len(), 6);
        near(poses[3].position_m, [0.9, 0.0]);
        near(poses[4].position_m, [1.0, 0.2]);
        near(poses[5].position_m, [1.0, 0.5]);
        assert_eq!(poses[5].time_s, 2.5);
        assert_eq!(poses[5].height_m, None);
        // An end between two steps is not reached.
        assert_eq!(along(polyline(&[[0.0, 0.0], [1.0, 0.0]], 0.3), None).unwrap().len(), 4);
    }

    #[test]
    fn the_published_way_has_a_thousand_steps_of_a_centimetre() {
        let vertices_m = [
            [3.02, 7.82],
            [2.22, 7.82],
            [2.22, 5.52],
            [1.02, 5.52],
            [1.02, 4.22],
            [0.52, 4.22],
            [0.52, 3.18],
            [2.964, 1.710],
        ];
        let poses = along(polyline(&vertices_m, 0.01), None).unwrap();
        // The last leg is 2.852 m long where its 286 steps want 2.86 m.
        assert_eq!(poses.len(), 1000);
        for (index, vertex_m) in [0, 80, 310, 430, 560, 610, 714].into_iter().zip(vertices_m) {
            near(poses[index].position_m, vertex_m);
        }
    }

    #[test]
    fn waypoints_are_sampled_in_time_with_their_speeds_and_pauses() {
        let waypoint = |x_m, speed_m_s, pause_s| Waypoint { position_m: [x_m, 1.0], speed_m_s, pause_s };
        let points = vec![waypoint(0.0, 2.0, 1.0), waypoint(4.0, 0.5, 0.0), waypoint(4.5, 1.0, 0.25)];
        let poses = along(Way::Waypoints { points }, None).unwrap();
        let x_m: Vec<f64> = poses.iter().map(|pose| pose.position_m[0]).collect();
        // One second of pause, two seconds at 2 m/s, one second at 0.5 m/s; 0.25 s of pause are no whole cycle.
        assert_eq!(x_m, [0.0, 0.0, 0.0, 1.0, 2.0, 3.0, 4.0, 4.25, 4.5]);
        assert_eq!(poses[8].time_s, 4.0);
    }

    #[test]
    fn cycles_cuts_a_way_and_more_than_it_has_are_refused_with_how_many_it_has() {
        let way = polyline(&[[0.0, 0.0], [1.0, 0.0]], 0.1);
        assert_eq!(along(way.clone(), Some(4)).unwrap().len(), 4);
        assert_eq!(along(way.clone(), Some(11)).unwrap().len(), 11);
        let error = along(way, Some(12)).unwrap_err();
        assert_eq!(error.item(), Some("cycles"));
        assert_eq!(
            error.to_string(),
            "folder: `cycles` is 12, but the way of trajectory \"walk\" has 11; allowed is 1 to 11."
        );
    }

    #[test]
    fn a_way_of_too_many_cycles_is_refused_unless_it_is_cut() {
        let way = polyline(&[[-1000.0, 0.0], [1000.0, 0.0]], 1e-4);
        assert_eq!(along(way.clone(), None).unwrap_err().item(), Some("step_m"));
        let cut = along(way, Some(3)).unwrap();
        near(cut[2].position_m, [-999.9998, 0.0]);
        let pause = Waypoint { position_m: [0.0; 2], speed_m_s: 1.0, pause_s: 1e5 };
        let points = vec![pause; 6];
        assert_eq!(along(Way::Waypoints { points }, None).unwrap_err().item(), Some("period_s"));
    }

    #[test]
    fn a_recorded_way_has_its_own_times_and_heights_where_it_gives_them() {
        let poses = from_csv("plain", "y_m, x_m\n1, 2\n-1000, 1e3\n").unwrap();
        assert_eq!(poses[0], Pose { time_s: 0.0, position_m: [2.0, 1.0], height_m: None });
        assert_eq!(poses[1], Pose { time_s: 0.5, position_m: [1000.0, -1000.0], height_m: None });
        let poses = from_csv("full", "time_s,x_m,y_m,height_m\n-1.5,1,2,0.9\n7,3,4,1\n").unwrap();
        assert_eq!(poses[0], Pose { time_s: -1.5, position_m: [1.0, 2.0], height_m: Some(0.9) });
        assert_eq!(poses[1].time_s, 7.0);
    }

    #[test]
    fn a_bad_recorded_way_is_refused_by_line_and_column() {
        for (text, line, item) in [
            ("x_m,y_m\n1,2\n1,NaN\n", Some(3), Some("y_m")),
            ("x_m,y_m\n1000.5,2\n", Some(2), Some("x_m")),
            ("x_m,y_m\n1,\n", Some(2), Some("y_m")),
            ("x_m,y_m\n1,2\n1,2,3\n", Some(3), None),
            ("x_m,y_m,time_s\n1,2,5\n1,2,5\n", Some(3), Some("time_s")),
            ("x_m,y_m,height_m\n1,2,inf\n", Some(2), Some("height_m")),
            ("x_m,y_m,z\n1,2,3\n", Some(1), Some("z")),
            ("x_m,y_m,x_m\n1,2,3\n", Some(1), Some("x_m")),
            ("x_m,time_s\n1,2\n", Some(1), Some("y_m")),
            ("x_m,y_m\n", None, None),
            ("", Some(1), Some("x_m")),
        ] {
            let error = from_csv("bad", text).unwrap_err();
            assert_eq!((error.line(), error.item()), (line, item), "{text:?}: {error}");
            assert!(error.file().ends_with("way.csv"), "{error}");
        }
        let missing = along(Way::Recorded { file: "none.csv".into() }, None).unwrap_err();
        assert_eq!(missing.file(), Path::new("folder/none.csv"));
    }

    #[test]
    fn people_walk_there_and_back_again() {
        let way_m = [[0.0, 0.0], [3.0, 0.0], [3.0, 1.0]];
        for (time_s, expected_m) in
            [(0.0, [0.0, 0.0]), (1.75, [3.0, 0.5]), (2.0, [3.0, 1.0]), (3.0, [2.0, 0.0]), (8.25, [0.5, 0.0])]
        {
            near(person_at(&way_m, 2.0, time_s), expected_m);
        }
        assert_eq!(person_at(&[[1.0, 2.0]], 1.0, 9.0), [1.0, 2.0]);
        assert_eq!(person_at(&[[1.0, 2.0], [1.0, 2.0]], 1.0, 9.0), [1.0, 2.0]);
        assert!(person_at(&[], 1.0, 9.0)[0].is_nan());
    }
}
