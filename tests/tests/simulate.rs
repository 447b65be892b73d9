//! The simulator as a user meets it: recordings that the rest takes, truth, pictures, and refusals.

use cogmint::channel::SPEED_OF_LIGHT_M_S;
use cogmint::geometry::Wall;
use cogmint::geometry::image_source::image_sources;
use cogmint::recording::{Cycle, Recording, TruthPath, VirtualAnchor};
use cogmint::scenario::{self, BUILT_IN, BuiltIn, Room, Scenario, Told};
use cogmint::simulator::Simulator;
use cogmint_tests::mutation::{answered_in_a_sentence, damaged, mutation, runner};
use cogmint_tests::{Folder, cogmint, command};
use proptest::prelude::*;
use std::cell::{Cell, RefCell};
use std::fs;
use std::path::Path;
use std::process::{Output, Stdio};
use std::time::{Duration, Instant};

/// A room of 6 m by 4 m with one anchor, to which tests add what they need.
const SMALL: &str = r#"
format = 1
name = "Small"
room = { corners_m = [[0, 0], [6, 0], [6, 4], [0, 4]] }
anchors = [{ name = "A", position_m = [1.0, 1.0] }]
trajectories = [{ cycles = 40, way.polyline = { vertices_m = [[1.0, 3.0], [5.0, 3.0]], step_m = 0.1 } }]
"#;

fn small(addition: &str) -> Scenario {
    Scenario::parse(&format!("{SMALL}{addition}"), "small.toml").unwrap_or_else(|error| panic!("{error}"))
}

fn record(scenario: &Scenario) -> Recording {
    let simulator = Simulator::new(scenario, None, 0, None).unwrap();
    simulator.record(simulator.cycles(), || {})
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

#[track_caller]
fn json(output: &Output) -> serde_json::Value {
    assert!(output.status.success(), "{}", text(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{error}: {}", text(&output.stdout)))
}

/// Asserts exit code 2 and one sentence with all of `parts`.
#[track_caller]
fn refused(output: &Output, parts: &[&str]) {
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.ends_with(".\n") && said.lines().count() == 1, "{said}");
    for part in parts {
        assert!(said.contains(part), "{part:?} is missing in: {said}");
    }
    assert!(output.stdout.is_empty());
}

/// What lies in a folder, in order.
fn names(folder: &Path) -> Vec<String> {
    let entry = |entry: std::io::Result<fs::DirEntry>| text(entry.unwrap().file_name().as_encoded_bytes());
    let mut names: Vec<String> = fs::read_dir(folder).unwrap().map(entry).collect();
    names.sort();
    names
}

fn files(folder: &Path) -> [Vec<u8>; 2] {
    ["recording.toml", "recording.npz"].map(|name| fs::read(folder.join(name)).unwrap())
}

#[test]
fn recordings_of_every_built_in_scenario_are_tracked_and_verified() {
    let folder = Folder::new("simulate-track");
    let run = |arguments: &[&str]| cogmint(folder.path(), arguments);
    for BuiltIn { name, .. } in BUILT_IN {
        let made = json(&run(&["simulate", name, "--out", name, "--cycles", "30", "--json"]));
        let recording = Recording::read(folder.path().join(name)).unwrap();
        assert_eq!((&made["cycles"], recording.cycles.len()), (&30.into(), 30), "{made}");
        assert!(recording.anchors.len() <= 8);
        let tracked = json(&run(&["track", name, "--json"]));
        assert_eq!((&tracked["cycles"], &tracked["refused_cycles"]), (&30.into(), &0.into()), "{tracked}");
        let verified = json(&run(&["verify", "--recording", name, "--json"]));
        assert_eq!((&verified["cycles"], &verified["equal"]), (&30.into(), &true.into()), "{verified}");
        println!("{name}: {} frames per second, RMSE {} m", made["frames_per_second"], tracked["rmse_m"]);
    }
}

#[test]
fn the_outcome_has_the_keys_promised() {
    let folder = Folder::new("simulate-json");
    let outcome = json(&cogmint(
        folder.path(),
        &["simulate", "l-shaped-office", "--out", "r", "--cycles", "50", "--seed", "3", "--json"],
    ));
    for key in [
        "scenario",
        "trajectory",
        "seed",
        "cycles",
        "frames",
        "lost_frames",
        "virtual_anchors",
        "known_virtual_anchors",
        "interference_omega_1_db",
        "seconds",
        "frames_per_second",
        "out",
    ] {
        assert!(!outcome[key].is_null(), "{key} is missing in {outcome}");
    }
    assert_eq!((&outcome["scenario"], &outcome["seed"]), (&"L-shaped office".into(), &3.into()));
    let number = |key: &str| outcome[key].as_u64().unwrap();
    assert_eq!(number("frames") + number("lost_frames"), 50 * 3);
    assert!(outcome["frames_per_second"].as_f64().unwrap() > 0.0);
    let recording = Recording::read(folder.path().join("r")).unwrap();
    let known = recording.virtual_anchors.iter().filter(|va| va.known).count() as u64;
    let frames: usize = recording.cycles.iter().map(|cycle| cycle.frames.len()).sum();
    assert_eq!(number("frames"), frames as u64);
    assert_eq!(number("virtual_anchors"), recording.virtual_anchors.len() as u64);
    assert_eq!(number("known_virtual_anchors"), known);
}

#[test]
fn the_same_seed_gives_the_same_bytes_and_another_one_other_frames_of_the_same_truth() {
    let folder = Folder::new("simulate-seeds");
    for BuiltIn { name, .. } in BUILT_IN {
        let make = |out: &str, more: &[&str]| {
            let arguments = [&["simulate", name, "--out", out, "--cycles", "5"], more].concat();
            let output = cogmint(folder.path(), &arguments);
            assert!(output.status.success(), "{}", text(&output.stderr));
            folder.path().join(out)
        };
        let (one, same) = (make("one", &[]), make("same", &[]));
        assert!(files(&one) == files(&same), "{name}");
        // Over an older recording as well.
        assert!(files(&make("one", &[])) == files(&same), "{name}");
        let [one, other] = [one, make("other", &["--seed", "77"])].map(|dir| Recording::read(dir).unwrap());
        let recordings = [&one, &other];
        for (one, other) in one.cycles.iter().zip(&other.cycles) {
            assert_eq!(one.truth_position_m, other.truth_position_m);
            // Where images are, and not how they are listed: the plans told differ.
            assert_eq!(placed(recordings[0], one), placed(recordings[1], other), "{name}");
            let samples = |cycle: &Cycle| -> Vec<_> {
                cycle.frames.iter().map(|frame| frame.samples.clone()).collect()
            };
            assert_ne!(samples(one), samples(other), "{name}");
        }
    }
}

#[test]
fn another_trajectory_is_another_way_and_one_that_is_not_there_is_refused() {
    let folder = Folder::new("simulate-trajectory");
    let make = |out: &str, trajectory: &str| {
        let arguments = ["simulate", "seminar-room", "--out", out, "--cycles", "5"];
        cogmint(folder.path(), &[&arguments[..], &["--trajectory", trajectory]].concat())
    };
    assert!(make("zero", "0").status.success() && make("one", "1").status.success());
    let [zero, one] = ["zero", "one"].map(|out| Recording::read(folder.path().join(out)).unwrap());
    for (zero, one) in zero.cycles.iter().zip(&one.cycles) {
        let ([x, y], [u, v]) = (zero.truth_position_m.unwrap(), one.truth_position_m.unwrap());
        assert!((x - u - 0.05).abs() < 1e-9 && (y - v).abs() < 1e-9, "5 cm west of ({x}, {y}): ({u}, {v})");
        assert_ne!(zero.frames, one.frames);
    }
    refused(&make("five", "5"), &["trajectory 5", "0 to 4"]);
    assert!(!folder.path().join("five").exists());
}

#[test]
fn a_folder_with_other_files_is_refused_at_once_and_stays_as_it_was() {
    let folder = Folder::new("simulate-precious");
    let precious = folder.path().join("precious");
    fs::create_dir(&precious).unwrap();
    fs::write(precious.join("thesis.txt"), "years").unwrap();
    let begin = Instant::now();
    refused(&cogmint(folder.path(), &["simulate", "seminar-room", "--out", "precious"]), &["precious"]);
    assert!(begin.elapsed() < Duration::from_secs(5), "the work was done first");
    fs::write(folder.path().join("file"), "text").unwrap();
    refused(&cogmint(folder.path(), &["simulate", "seminar-room", "--out", "file"]), &["file"]);
    assert_eq!(names(folder.path()), ["file", "precious"]);
    assert_eq!(names(&precious), ["thesis.txt"]);
    assert_eq!(fs::read_to_string(precious.join("thesis.txt")).unwrap(), "years");
}

/// Asserts that every true path is as long as the straight line from its image to the tag.
fn assert_delays(recording: &Recording, name: &str) -> usize {
    let mut count = 0;
    for cycle in &recording.cycles {
        let [x, y] = cycle.truth_position_m.unwrap();
        for path in &cycle.truth_paths {
            let anchor = &recording.anchors[path.anchor];
            let image = path.virtual_anchor.map(|index| &recording.virtual_anchors[index]);
            assert!(image.is_none_or(|image| image.exists && image.anchor == path.anchor), "{name}");
            let [u, v] = image.map_or(anchor.position_m, |image| image.position_m);
            let up = cycle.tag_height_m.unwrap() - anchor.height_m;
            let off_m = path.delay_s * SPEED_OF_LIGHT_M_S - (x - u).hypot(y - v).hypot(up);
            assert!(off_m.abs() < 1e-6, "{name}: {path:?} is {off_m} m longer");
            count += 1;
        }
    }
    count
}

#[test]
fn true_paths_are_as_long_as_the_line_from_image_to_tag_and_each_source_has_one_at_most() {
    for built_in in BUILT_IN {
        let scenario = Scenario::parse(built_in.text, built_in.name).unwrap();
        let simulator = Simulator::new(&scenario, None, 0, None).unwrap();
        // Two hundred cycles from all over the way.
        let step = simulator.cycles().div_ceil(200);
        let action = |cycle| simulator.scheduled_action(cycle);
        let cycles = (0..simulator.cycles()).step_by(step).map(|cycle| simulator.cycle(cycle, action(cycle)));
        let recording = Recording { cycles: cycles.collect(), ..simulator.before() };
        let paths = assert_delays(&recording, built_in.name);
        println!("{}: {paths} paths in {} cycles", built_in.name, recording.cycles.len());
        assert!(paths > recording.cycles.len(), "{}: only {paths} paths", built_in.name);
        for cycle in &recording.cycles {
            let mut sources: Vec<_> =
                cycle.truth_paths.iter().map(|path| (path.anchor, path.virtual_anchor)).collect();
            sources.sort();
            assert!(sources.windows(2).all(|pair| pair[0] != pair[1]), "{}: {sources:?}", built_in.name);
        }
    }
}

#[test]
fn a_first_path_window_and_heights_and_clock_errors_leave_the_true_delays_alone() {
    let addition = r#"
        tag = { height_m = -1.0 }
        errors = { clock_offset_s = 5e-9, clock_drift = 1e-9, timestamp_std_s = 1e-10 }
        radio = { window.first_path.sample = 40 }
    "#;
    assert!(assert_delays(&record(&small(addition)), "small") > 40);
}

#[test]
fn at_most_24_virtual_anchors_are_told_and_those_that_err_one_by_one_are_wrong_by_as_much_as_stated() {
    let (mut squares, mut numbers) = (0.0, 0.0);
    for built_in in BUILT_IN {
        let mut scenario = Scenario::parse(built_in.text, built_in.name).unwrap();
        scenario.trajectories[0].cycles = Some(100);
        scenario.prior.floor_plan.told = Told::VirtualAnchors;
        let plan = scenario.prior.floor_plan.clone();
        for seed in 1..=5 {
            let simulator = Simulator::new(&scenario, None, 0, Some(seed)).unwrap();
            let before = simulator.before();
            let known: Vec<_> =
                before.virtual_anchors.iter().enumerate().filter(|(_, va)| va.known).collect();
            assert!((1..=24).contains(&known.len()), "{}: {}", built_in.name, known.len());
            for (index, va) in known {
                let first = simulator.order(index) == 1;
                assert_eq!(va.std_m, if first { plan.first_order_std_m } else { plan.higher_order_std_m });
                for (told, is) in va.told_position_m.unwrap().into_iter().zip(va.position_m) {
                    let error = (told - is) / va.std_m;
                    assert!(error.abs() < 5.0, "{}: {va:?}", built_in.name);
                    squares += error * error;
                    numbers += 1.0;
                }
            }
        }
    }
    // The mean of n squares of normal numbers is 1 with the standard deviation sqrt(2 / n).
    let (mean, deviation) = (squares / numbers, f64::sqrt(2.0 / numbers));
    println!("mean square of {numbers} errors: {mean:.3}, expected 1 with {deviation:.3}");
    assert!((mean - 1.0).abs() < 4.0 * deviation);
}

/// 2000 cycles of little frames with what `lost_frames` says.
fn arrived(lost_frames: &str) -> Vec<bool> {
    let addition = format!(
        "lost_frames = {lost_frames}\nradio = {{ samples = 16 }}\npropagation = {{ reflection_order = 0 }}"
    );
    let mut scenario = small(&addition);
    scenario.trajectories[0].cycles = Some(2000);
    let scenario::Way::Polyline { step_m, .. } = &mut scenario.trajectories[0].way else { unreachable!() };
    *step_m = 0.002;
    let recording = record(&scenario);
    assert!(recording.cycles.iter().all(|cycle| cycle.truth_paths.len() == 1), "the truth is never lost");
    recording.cycles.iter().map(|cycle| cycle.frames.len() == 1).collect()
}

#[test]
fn frames_are_lost_with_the_stated_probability_and_in_gaps() {
    let lost = arrived("{ probability = 0.3 }").iter().filter(|arrived| !**arrived).count() as f64;
    let deviation = f64::sqrt(2000.0 * 0.3 * 0.7);
    println!("{lost} of 2000 lost, expected 600 with {deviation:.1}");
    assert!((lost - 600.0).abs() < 4.0 * deviation);
    let with_gap = arrived("{ gaps = [[0.25, 0.5]] }");
    assert!((0..2000).all(|cycle| with_gap[cycle] != (500..1000).contains(&cycle)));
    let both = arrived("{ probability = 0.3, gaps = [[0.25, 0.5]] }");
    let lost = (0..2000).filter(|&cycle| !both[cycle]).count() as f64;
    assert!((500..1000).all(|cycle| !both[cycle]));
    assert!((lost - 500.0 - 450.0).abs() < 4.0 * f64::sqrt(1500.0 * 0.3 * 0.7), "{lost}");
    assert!(arrived("{ probability = 1.0 }").iter().all(|arrived| !arrived));
}

/// The images of an anchor in a room.
fn images(room: &Room, anchor: [f64; 2]) -> Vec<[f64; 2]> {
    let walls: Vec<Wall> =
        scenario::walls(room).into_iter().map(|(ends_m, _)| Wall { ends_m, construction: 0 }).collect();
    image_sources(&walls, anchor, 2).into_iter().map(|image| image.position_m).collect()
}

/// Distance to the nearest of some places.
fn nearest_m(places: &[[f64; 2]], [x, y]: [f64; 2]) -> f64 {
    places.iter().map(|[u, v]| (x - u).hypot(y - v)).fold(f64::INFINITY, f64::min)
}

#[test]
fn of_a_wrong_floor_plan_the_tracker_is_told_the_plan_and_the_truth_stays_the_rooms() {
    // The east wall is 0.3 m off; the wall in the middle is not there.
    let scenario = small(
        r#"
        [prior.floor_plan]
        wall_offset_std_m = 0.0005
        wall_rotation_std_deg = 0.0
        [prior.floor_plan.room]
        corners_m = [[0, 0], [6.3, 0], [6.3, 4], [0, 4]]
        inner_walls = [{ from_m = [3, 1.5], to_m = [3, 2] }]
        "#,
    );
    let recording = record(&scenario);
    let anchor = scenario.anchors[0].position_m;
    let real = images(&scenario.room, anchor);
    let planned = images(scenario.prior.floor_plan.room.as_ref().unwrap(), anchor);
    for va in &recording.virtual_anchors {
        assert_eq!(va.told_position_m.is_some(), va.known);
        if let Some(told) = va.told_position_m {
            assert!(nearest_m(&planned, told) < 0.006, "{va:?} is not in the plan");
        }
        assert!(va.known || va.exists, "{va:?}");
        assert_eq!(va.exists, nearest_m(&real, va.position_m) < 1e-9, "{va:?}");
    }
    let at = |place: [f64; 2]| {
        let here = |va: &&VirtualAnchor| nearest_m(&[place], va.position_m) < 1e-9;
        recording.virtual_anchors.iter().find(here).unwrap_or_else(|| panic!("none at {place:?}"))
    };
    let moved = at([11.0, 1.0]);
    assert!(moved.exists && nearest_m(&[[11.6, 1.0]], moved.told_position_m.unwrap()) < 0.006, "{moved:?}");
    let phantom = at([5.0, 1.0]);
    assert!(phantom.known && !phantom.exists, "{phantom:?}");
    assert!(assert_delays(&recording, "small") > 40);
}

#[test]
fn an_exact_plan_tells_just_where_and_a_start_has_the_mean_that_is_told() {
    let recording = record(&small(
        r#"
        [prior]
        position_m = [2.5, 2.0]
        floor_plan = { told = "virtual-anchors", exact = true, first_order_std_m = 0.5 }
        "#,
    ));
    assert_eq!(recording.start.position_m, [2.5, 2.0]);
    assert_ne!(recording.cycles[0].truth_position_m, Some([2.5, 2.0]));
    let told = recording.virtual_anchors.iter().filter(|va| va.known);
    assert!(told.clone().any(|va| va.std_m == 0.5));
    assert!(told.clone().all(|va| va.told_position_m == Some(va.position_m)));
}

#[test]
fn of_a_told_room_a_wall_that_swallows_all_is_one_that_the_plan_lacks() {
    let plan = |east: &str| {
        let scenario = small(&format!(
            r#"
            constructions.absorber = {{ reflection_loss_db = 100.0, transmission_loss_db = 200.0 }}
            [prior.floor_plan.room]
            corners_m = [[0, 0], [6, 0], [6, 4], [0, 4]]
            sides = ["concrete", "{east}", "concrete", "concrete"]
            "#
        ));
        record(&scenario).virtual_anchors
    };
    // The anchor is at (1, 1): its image in the east wall at (11, 1).
    let told = |plan: &[VirtualAnchor]| {
        plan.iter().find(|va| nearest_m(&[[11.0, 1.0]], va.position_m) < 1e-9).map(|va| (va.known, va.exists))
    };
    assert_eq!(told(&plan("concrete")), Some((true, true)));
    assert_eq!(told(&plan("absorber")), Some((false, true)));
}

/// The true paths of a cycle with their images' places in place of their indexes.
fn placed(recording: &Recording, cycle: &Cycle) -> Vec<(usize, Option<[f64; 2]>, f64)> {
    let place =
        |path: &TruthPath| path.virtual_anchor.map(|index| recording.virtual_anchors[index].position_m);
    cycle.truth_paths.iter().map(|path| (path.anchor, place(path), path.delay_s)).collect()
}

#[test]
fn a_floor_plan_that_is_not_known_tells_nothing() {
    let known = record(&small(""));
    let unknown = record(&small("prior.floor_plan.known = false"));
    assert!(known.virtual_anchors.iter().any(|va| va.known));
    assert!(unknown.virtual_anchors.iter().all(|va| !va.known && va.exists && va.told_position_m.is_none()));
    // The same truth, whatever the order of the list.
    for (one, other) in known.cycles.iter().zip(&unknown.cycles) {
        assert_eq!(one.frames, other.frames);
        assert_eq!(placed(&known, one), placed(&unknown, other));
    }
}

/// Writes the small scenario with its way from `way.csv`, in the folder `scenarios`.
fn with_way(folder: &Path, csv: &str) {
    let place = folder.join("scenarios");
    fs::create_dir_all(&place).unwrap();
    let kept: String =
        SMALL.lines().filter(|line| !line.contains("traject")).map(|l| format!("{l}\n")).collect();
    fs::write(place.join("my.toml"), kept + "trajectories = [{ way.recorded = { file = \"way.csv\" } }]\n")
        .unwrap();
    fs::write(place.join("way.csv"), csv).unwrap();
}

#[test]
fn a_recorded_way_lies_beside_the_scenarios_file() {
    let folder = Folder::new("simulate-recorded");
    with_way(folder.path(), "time_s,x_m,y_m,height_m\n-3.5,2,2,0.5\n-3.4,2.5,2,0.6\n10,2.5,3,-0.7\n");
    let output = cogmint(folder.path(), &["simulate", "scenarios/my.toml", "--out", "r"]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let recording = Recording::read(folder.path().join("r")).unwrap();
    let poses: Vec<_> = recording
        .cycles
        .iter()
        .map(|cycle| (cycle.time_s, cycle.truth_position_m.unwrap(), cycle.tag_height_m.unwrap()))
        .collect();
    assert_eq!(poses, [(-3.5, [2.0, 2.0], 0.5), (-3.4, [2.5, 2.0], 0.6), (10.0, [2.5, 3.0], -0.7)]);
    assert!(assert_delays(&recording, "recorded") >= 3);
    with_way(folder.path(), "x_m,y_m\n2,2\n2,wall\n");
    let output = cogmint(folder.path(), &["simulate", "scenarios/my.toml", "--out", "bad"]);
    refused(&output, &["way.csv", "line 3", "y_m"]);
    fs::remove_file(folder.path().join("scenarios/way.csv")).unwrap();
    let output = cogmint(folder.path(), &["simulate", "scenarios/my.toml", "--out", "bad"]);
    refused(&output, &["way.csv"]);
    assert_eq!(names(folder.path()), ["r", "scenarios"]);
}

#[test]
fn a_recorded_way_that_leaves_the_room_is_refused() {
    let folder = Folder::new("simulate-outside");
    for csv in ["x_m,y_m\n2,2\n7,2\n", "x_m,y_m\n2,2\n6,2\n"] {
        with_way(folder.path(), csv);
        let output = cogmint(folder.path(), &["simulate", "scenarios/my.toml", "--out", "r"]);
        refused(&output, &["way.csv"]);
        assert_eq!(names(folder.path()), ["scenarios"]);
    }
}

/// Per cycle what `addition` does to each path, as a factor of its magnitude.
fn factors(addition: &str) -> Vec<Vec<(TruthPath, f64)>> {
    let (without, with) = (record(&small("")), record(&small(addition)));
    let pairs = without.cycles.iter().zip(&with.cycles).map(|(without, with)| {
        assert_eq!(without.truth_paths.len(), with.truth_paths.len());
        let paths = without.truth_paths.iter().zip(&with.truth_paths);
        paths.map(|(before, after)| (*after, after.magnitude / before.magnitude)).collect()
    });
    pairs.collect()
}

#[test]
fn an_obstruction_weakens_the_direct_path_by_its_loss_on_its_part_of_the_way() {
    for (paths, all) in [("direct", false), ("all", true)] {
        let addition =
            format!("obstructions = [{{ during = [0.25, 0.5], loss_db = 20, paths = \"{paths}\" }}]");
        for (cycle, paths) in factors(&addition).into_iter().enumerate() {
            assert!(paths.iter().any(|(path, _)| path.virtual_anchor.is_none()), "no direct path in {cycle}");
            for (path, factor) in paths {
                let obstructed = (10..20).contains(&cycle) && (all || path.virtual_anchor.is_none());
                let expected = if obstructed { 0.1 } else { 1.0 };
                assert!((factor / expected - 1.0).abs() < 1e-9, "cycle {cycle}: {factor} of {path:?}");
            }
        }
    }
}

#[test]
fn a_detour_makes_the_direct_path_longer_by_as_much() {
    let addition = "obstructions = [{ during = [0.5, 1.0], loss_db = 3, excess_m = 0.5 }]";
    let (without, with) = (record(&small("")), record(&small(addition)));
    for (cycle, (without, with)) in without.cycles.iter().zip(&with.cycles).enumerate() {
        let more_m = (with.truth_paths[0].delay_s - without.truth_paths[0].delay_s) * SPEED_OF_LIGHT_M_S;
        let expected_m = if cycle >= 20 { 0.5 } else { 0.0 };
        assert!((more_m - expected_m).abs() < 1e-9, "cycle {cycle}: {more_m} m");
    }
}

#[test]
fn a_person_on_the_direct_path_lowers_it_by_more_than_5_db_and_one_far_away_hardly() {
    // On the straight line to the tag of cycle 20.
    let paths = &factors("people = [{ way_m = [[2.0, 2.0]], width_m = 0.5 }]")[20];
    let (_, factor) = paths.iter().find(|(path, _)| path.virtual_anchor.is_none()).unwrap();
    let loss_db = -20.0 * factor.log10();
    println!("{loss_db:.1} dB");
    assert!((5.0..40.0).contains(&loss_db), "{loss_db} dB");
    let paths = &factors("people = [{ way_m = [[5.5, 0.5]], width_m = 0.5 }]")[0];
    let (_, factor) = paths.iter().find(|(path, _)| path.virtual_anchor.is_none()).unwrap();
    assert!((factor - 1.0).abs() < 0.03, "{factor}");
}

/// Asserts that there is a figure of more than 10 kB in both formats.
#[track_caller]
fn assert_figure(path: &Path) {
    let begins = [("svg", &b"<svg"[..]), ("png", b"\x89PNG")];
    for (extension, begin) in begins {
        let bytes = fs::read(path.with_extension(extension)).unwrap();
        assert!(bytes.len() > 10_000, "{} bytes of {extension}", bytes.len());
        let head = &bytes[..200];
        assert!(head.windows(begin.len()).any(|window| window == begin), "{}", text(head));
    }
}

#[test]
fn rooms_carriers_and_channels_are_drawn() {
    let folder = Folder::new("simulate-plots");
    let run = |arguments: &[&str]| cogmint(folder.path(), arguments);
    let room = json(&run(&["plot", "room", "l-shaped-office", "--plot", "figures/room", "--json"]));
    assert!(room["figure"].is_array(), "{room}");
    assert_figure(&folder.path().join("figures/room"));
    let made = run(&["simulate", "corridor", "--out", "r", "--cycles", "3"]);
    assert!(made.status.success(), "{}", text(&made.stderr));
    assert!(run(&["plot", "channel", "r", "--cycle", "2"]).status.success());
    assert_figure(&folder.path().join("cogmint-out/r-channel-2"));
    assert!(run(&["plot", "channel", "r", "--cycle", "0", "--anchor", "1", "--plot", "c"]).status.success());
    assert_figure(&folder.path().join("c"));
    let before = names(folder.path());
    refused(&run(&["plot", "channel", "r", "--cycle", "3", "--plot", "d"]), &["cycle 3", "0 to 2"]);
    refused(
        &run(&["plot", "channel", "r", "--cycle", "0", "--anchor", "2", "--plot", "d"]),
        &["anchor 2", "0 to 1"],
    );
    refused(
        &run(&["plot", "room", "corridor", "--trajectory", "9", "--plot", "d"]),
        &["trajectory 9", "0 to"],
    );
    refused(&run(&["plot", "carriers", "attic", "--plot", "d"]), &["attic", "seminar-room"]);
    assert_eq!(names(folder.path()), before);
}

#[test]
fn carriers_differ_in_the_seminar_room() {
    let folder = Folder::new("simulate-carriers");
    let outcome =
        json(&cogmint(folder.path(), &["plot", "carriers", "seminar-room", "--plot", "c", "--json"]));
    assert_figure(&folder.path().join("c"));
    let sources = outcome["sources"].as_array().unwrap();
    let mut spreads = Vec::new();
    for source in sources {
        let values: Vec<f64> =
            source["sinr_db"].as_array().unwrap().iter().map(|value| value.as_f64().unwrap()).collect();
        let low = values.iter().copied().fold(f64::INFINITY, f64::min);
        let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        assert_eq!(values.len(), 40);
        let spread = source["spread_db"].as_f64().unwrap();
        assert!((spread - (high - low)).abs() < 1e-9, "{source}");
        spreads.push(spread);
    }
    spreads.sort_by(f64::total_cmp);
    let median = outcome["median_spread_db"].as_f64().unwrap();
    println!("{} sources, spread {:.2} to {:.2} dB, median {median:.2} dB", spreads.len(), spreads[0], {
        spreads[spreads.len() - 1]
    });
    assert!(median > 0.5 && spreads.contains(&median), "{median} dB");
    assert!(outcome["best_median_error_bound_m"].as_f64().unwrap() > 0.0);
}

/// Runs the command for at most `limit`; what it said, unless it took longer.
fn run_for(folder: &Path, arguments: &[&str], limit: Duration) -> Option<Output> {
    let mut command = command(folder, arguments);
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let begin = Instant::now();
    while child.try_wait().unwrap().is_none() {
        if begin.elapsed() > limit {
            child.kill().unwrap();
            child.wait().unwrap();
            return None;
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    Some(child.wait_with_output().unwrap())
}

#[test]
fn damaged_scenarios_give_one_sentence_or_a_whole_recording() {
    let folder = Folder::new("simulate-damage");
    let (accepted, slow) = (Cell::new(0), RefCell::new(Vec::new()));
    runner(100)
        .run(&(0..BUILT_IN.len(), prop::collection::vec(mutation(), 1..3)), |(which, mutations)| {
            fs::write(folder.path().join("damaged.toml"), damaged(BUILT_IN[which].text, &mutations)).unwrap();
            let begin = Instant::now();
            let arguments = ["simulate", "damaged.toml", "--out", "made", "--cycles", "2"];
            let output = run_for(folder.path(), &arguments, Duration::from_secs(60));
            let Some(output) = output else { return Err(TestCaseError::fail("takes more than a minute")) };
            let seconds = begin.elapsed().as_secs_f64();
            if seconds > 5.0 {
                slow.borrow_mut().push(format!("{seconds:.1} s: {}, {mutations:?}", BUILT_IN[which].name));
            }
            if output.status.success() {
                accepted.set(accepted.get() + 1);
                prop_assert!(output.stderr.is_empty(), "{}", text(&output.stderr));
                let recording = Recording::read(folder.path().join("made"));
                let recording = recording.map_err(|error| TestCaseError::fail(error.to_string()))?;
                prop_assert!((1..=2).contains(&recording.cycles.len()));
                prop_assert_eq!(names(folder.path()), ["damaged.toml", "made"]);
                prop_assert_eq!(names(&folder.path().join("made")), ["recording.npz", "recording.toml"]);
                fs::remove_dir_all(folder.path().join("made")).unwrap();
                return Ok(());
            }
            prop_assert_eq!(names(folder.path()), ["damaged.toml"]);
            answered_in_a_sentence(&output, "damaged.toml")
        })
        .unwrap_or_else(|error| panic!("{error}"));
    let slow = slow.into_inner();
    println!("{} of 100 still make a recording; slower than 5 s: {slow:#?}", accepted.get());
    assert!((5..90).contains(&accepted.get()), "{} were accepted", accepted.get());
}
