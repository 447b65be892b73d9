//! The plan as a user has it: what a device is told follows from walls and anchors, and errs by wall.

use cogmint::floor_plan::export::{Export, Source};
use cogmint::floor_plan::{ToldSource, told};
use cogmint::recording::{Recording, VirtualAnchor, WallSequence};
use cogmint::replay::{LARGE_ANCHORS, Setup};
use cogmint::scenario::{BUILT_IN, Scenario, Told};
use cogmint::simulator::Simulator;
use cogmint_core::memory::environment::Record;
use cogmint_core::model::image::Sequence;
use cogmint_core::{Config, Map, Tracker};
use cogmint_tests::{Folder, cogmint, shared_data};
use std::collections::BTreeMap;
use std::path::Path;

/// What `cogmint plan dw3000-office --format rust` prints: it must compile, as it does here.
mod firmware {
    include!("plan/dw3000_office.rs");
}

/// A room with a window in the south wall, a partition in line with a side, and two anchors.
const ROOM: &str = r#"
format = 1
name = "Two rooms"
anchors = [{ name = "A", position_m = [1.0, 1.5] }, { name = "B", position_m = [7.0, 3.5], height_m = 2.0 }]
trajectories = [
    { way.polyline = { vertices_m = [[0.5, 3.5], [3.5, 3.5]], step_m = 0.5 } },
    { way.polyline = { vertices_m = [[7.5, 5.0], [4.5, 0.5]], step_m = 0.5 } },
]
propagation = { transmissions = 1 }
room.corners_m = [[0, 0], [2, 0], [3, 0], [8, 0], [8, 6], [4, 6], [4, 4], [0, 4]]
room.sides = ["brick", "glass", "brick", "concrete", "brick", "brick", "brick", "brick"]
room.inner_walls = [{ from_m = [4, 0.5], to_m = [4, 3], construction = "drywall" }]
"#;

fn room(addition: &str) -> Scenario {
    Scenario::parse(&format!("{ROOM}{addition}"), "room.toml").unwrap_or_else(|error| panic!("{error}"))
}

fn before(scenario: &Scenario, trajectory: usize, seed: u64) -> Recording {
    Simulator::new(scenario, None, trajectory, Some(seed)).unwrap().before()
}

/// What the tracker gets of the virtual anchors, in order.
fn known(recording: &Recording) -> Vec<(usize, Option<[f64; 2]>, f64, WallSequence)> {
    let known = recording.virtual_anchors.iter().filter(|va| va.known);
    known.map(|va| (va.anchor, va.told_position_m, va.std_m, va.walls)).collect()
}

fn away_m([x, y]: [f64; 2], [u, v]: [f64; 2]) -> f64 {
    (x - u).hypot(y - v)
}

#[test]
fn what_is_told_does_not_depend_on_the_way_through_the_room() {
    let scenario = room("");
    for seed in [1, 2] {
        let [one, other] = [0, 1].map(|trajectory| before(&scenario, trajectory, seed));
        assert_eq!(known(&one), known(&other));
        assert_eq!(one.plan, other.plan);
        assert!(known(&one).len() > 10, "{}", known(&one).len());
        // The ways see different images: the truth lists differ, and neither has all that is told.
        let seen = |recording: &Recording| {
            let unknown = recording.virtual_anchors.iter().filter(|va| !va.known);
            unknown.map(|va| va.position_m.map(f64::to_bits)).collect::<Vec<_>>()
        };
        assert_ne!(seen(&one), seen(&other));
        // What `cogmint plan` prints for that seed is the same list.
        let printed = Export::of_scenario(&scenario, Some(seed)).unwrap();
        let of_recording = Export::of_recording(&one);
        assert_eq!(printed.plan, of_recording.plan);
        for (a, b) in printed.sources.iter().zip(&of_recording.sources) {
            assert_eq!(
                (a.anchor, a.walls, a.position_m, a.std_m),
                (b.anchor, b.walls, b.position_m, b.std_m)
            );
        }
        assert_eq!(printed.sources.len(), of_recording.sources.len());
    }
}

#[test]
fn no_more_are_told_than_asked_for_and_those_are_the_first() {
    let all = told(&room(""), Some(3)).unwrap().sources;
    let few = told(&room("prior.floor_plan.max_virtual_anchors = 5"), Some(3)).unwrap().sources;
    assert_eq!(few, all[..5]);
    // Two reflections are worth half of one.
    let worth = |source: &ToldSource| source.seen_share / source.walls.len() as f64;
    assert!(all.is_sorted_by(|a, b| worth(a) >= worth(b)));
}

#[test]
fn collinear_segments_are_one_wall_and_move_together() {
    let scenario = room("");
    let nominal = told(&scenario, None).unwrap().plan;
    // South with its window; east; north-east; the step with the partition in line; north-west; west.
    assert_eq!(
        nominal.walls.iter().map(|wall| wall.segments_m.len()).collect::<Vec<_>>(),
        [3, 1, 1, 2, 1, 1]
    );
    let drawn = told(&scenario, Some(5)).unwrap().plan;
    for (was, is) in nominal.walls.iter().zip(&drawn.walls) {
        assert_ne!(was.segments_m, is.segments_m);
        let ends = |wall: &cogmint::recording::PlanWall| wall.segments_m.concat();
        for (a, b) in [(0, 1), (0, ends(was).len() - 1)] {
            let (before_m, after_m) = (away_m(ends(was)[a], ends(was)[b]), away_m(ends(is)[a], ends(is)[b]));
            assert!((before_m - after_m).abs() < 1e-9, "{was:?} {is:?}");
        }
        // All ends still lie on one line.
        let ([cx, cy], [nx, ny]) = (is.centre_m(), is.normal());
        assert!(ends(is).iter().all(|end| ((end[0] - cx) * nx + (end[1] - cy) * ny).abs() < 1e-9));
    }
}

#[test]
fn all_images_in_one_wall_err_together() {
    // A wall is where anchor and image have their mirror: the one of an anchor gives those of the others.
    let scenario = room("");
    let mut compared = 0;
    for seed in 1..=20 {
        let sources = told(&scenario, Some(seed)).unwrap().sources;
        let nominal = told(&scenario, None).unwrap().sources;
        let single = |anchor| sources.iter().filter(move |s| s.anchor == anchor && s.walls.len() == 1);
        for one in single(0) {
            for other in single(1).filter(|other| other.walls == one.walls) {
                let [a, b] = [0, 1].map(|anchor: usize| scenario.anchors[anchor].position_m);
                let along = [one.position_m[0] - a[0], one.position_m[1] - a[1]];
                let length = along[0].hypot(along[1]);
                let [nx, ny] = along.map(|x| x / length);
                let middle = [0.5 * (one.position_m[0] + a[0]), 0.5 * (one.position_m[1] + a[1])];
                let beyond = 2.0 * ((b[0] - middle[0]) * nx + (b[1] - middle[1]) * ny);
                let mirrored = [b[0] - beyond * nx, b[1] - beyond * ny];
                assert!(away_m(mirrored, other.position_m) < 1e-9, "seed {seed}: {one:?} {other:?}");
                let was = nominal.iter().find(|s| s.anchor == 1 && s.walls == other.walls);
                assert!(was.is_none_or(|was| away_m(was.position_m, other.position_m) > 1e-6));
                compared += 1;
            }
        }
    }
    assert!(compared > 40, "{compared}");
}

#[test]
fn images_told_are_off_by_as_much_as_their_deviations_say() {
    let scenario = room("");
    // By anchor and walls, the corner's order left aside: where the images truly are.
    let key = |source: &ToldSource| {
        let mut walls: Vec<usize> = source.walls.iter().collect();
        walls.sort();
        (source.anchor, walls)
    };
    let truth: BTreeMap<_, _> =
        told(&scenario, None).unwrap().sources.iter().map(|source| (key(source), *source)).collect();
    let mut means = Vec::new();
    for seed in 1..=300 {
        let mut squares = Vec::new();
        for source in told(&scenario, Some(seed)).unwrap().sources {
            let Some(real) = truth.get(&key(&source)) else { continue };
            // Between parallel walls the other order is another image.
            if real.walls != source.walls && away_m(real.position_m, source.position_m) > 3.0 {
                continue;
            }
            let error = away_m(real.position_m, source.position_m) / source.std_m;
            squares.push(0.5 * error * error);
        }
        means.push(squares.iter().sum::<f64>() / squares.len() as f64);
    }
    let count = means.len() as f64;
    let mean = means.iter().sum::<f64>() / count;
    let variance = means.iter().map(|one| (one - mean) * (one - mean)).sum::<f64>() / (count - 1.0);
    // Errors within a plan hang together; plans are independent.
    let deviation = (variance / count).sqrt();
    println!("mean square of errors over deviations: {mean:.3} +- {deviation:.3}");
    assert!((mean - 1.0).abs() < 4.0 * deviation && deviation < 0.06, "{mean} +- {deviation}");
}

#[test]
fn an_exact_plan_tells_where_images_are_and_keeps_its_deviations() {
    let exact = before(&room("prior.floor_plan = { exact = true, wall_offset_std_m = 0.2 }"), 0, 4);
    let told = |recording: &Recording| -> Vec<VirtualAnchor> {
        recording.virtual_anchors.iter().filter(|va| va.known).copied().collect()
    };
    assert!(told(&exact).len() > 10);
    for va in told(&exact) {
        assert!(away_m(va.told_position_m.unwrap(), va.position_m) < 1e-9 && va.exists, "{va:?}");
        assert!(va.std_m > 0.2, "{va:?}");
    }
    let drawn = before(&room(""), 0, 4);
    assert!(told(&drawn).iter().all(|va| away_m(va.told_position_m.unwrap(), va.position_m) > 1e-6));
    assert!(told(&drawn).iter().all(|va| va.exists), "every image told is one of the room");
}

#[test]
fn a_recording_keeps_the_plan_and_the_walls_of_every_image_told() {
    let folder = Folder::new("plan-recording");
    let scenario = room("radio.samples = 64");
    let simulator = Simulator::new(&scenario, None, 0, Some(1)).unwrap();
    let recording = simulator.record(3, || {});
    recording.write(folder.path().join("r")).unwrap();
    let read = Recording::read(folder.path().join("r")).unwrap();
    assert_eq!(read, recording);
    let plan = read.plan.as_ref().unwrap();
    assert_eq!((plan.outline_m.len(), plan.walls.len()), (8, 6));
    for (index, va) in read.virtual_anchors.iter().enumerate().filter(|(_, va)| va.known) {
        assert_eq!(va.walls.len(), simulator.order(index), "{va:?}");
    }
    // Where virtual anchors err one by one there is no such plan, and where it is not known none is told.
    for settings in ["told = \"virtual-anchors\"", "known = false"] {
        let before = before(&room(&format!("prior.floor_plan.{settings}")), 0, 1);
        assert!(before.plan.is_none() && before.virtual_anchors.iter().all(|va| va.walls.is_empty()));
    }
}

#[test]
fn an_anchor_hung_close_to_a_wall_stays_on_its_side_and_keeps_its_images() {
    let mut scenario = room("");
    scenario.anchors[0].position_m = [0.02, 2.0];
    let without_images = (1..=50).filter(|&seed| {
        let sources = told(&scenario, Some(seed)).unwrap().sources;
        !sources.iter().any(|source| source.anchor == 0)
    });
    assert_eq!(without_images.count(), 0);
}

#[test]
fn a_start_that_no_scenario_gives_is_drawn_in_the_disc_and_runs_with_a_seed_start_as_ever() {
    let scenario = room("prior.disc_radius_m = 0.8");
    let truth = [0.5, 3.5];
    let mut squares = 0.0;
    for seed in 1..=400 {
        let recording = Simulator::new(&scenario, None, 0, Some(seed)).unwrap().record(1, || {});
        let start = recording.start;
        let off_m = away_m(start.position_m, truth);
        assert!(off_m > 0.0 && off_m <= 0.8, "seed {seed}: {off_m}");
        squares += off_m * off_m;
        assert_eq!(start.drawn_about_m, Some(truth));
        if seed < 5 {
            let setup =
                |recording: &Recording, run| Setup::new(recording, Path::new("room"), run).unwrap().config;
            assert_eq!(setup(&recording, None).start.position_m, start.position_m.map(|x| x as f32));
            let mut at_truth = recording.clone();
            (at_truth.start.position_m, at_truth.start.drawn_about_m) = (truth, None);
            let drawn = setup(&recording, Some(seed)).start.position_m;
            assert_eq!(drawn, setup(&at_truth, Some(seed)).start.position_m);
        }
    }
    // Uniform in a disc: the mean square is half of the radius'.
    assert!((squares / 400.0 - 0.32).abs() < 4.0 * 0.64 / f64::sqrt(12.0 * 400.0), "{}", squares / 400.0);
    let given = before(&room("prior.position_m = [2.0, 1.0]"), 0, 1).start;
    assert_eq!((given.position_m, given.drawn_about_m), ([2.0, 1.0], None));
}

#[test]
fn constants_for_firmware_are_those_of_the_plan_and_the_core_takes_them() {
    let (scenario, _) = Scenario::find("dw3000-office").unwrap();
    let export = Export::of_scenario(&scenario, None).unwrap();
    let text = include_str!("plan/dw3000_office.rs");
    assert_eq!(export.to_rust(), text, "renew the file with `cogmint plan dw3000-office --format rust`");
    let Map { virtual_anchors, plan } = firmware::MAP;
    assert!(virtual_anchors.is_empty());
    let told = cogmint::told_plan::ToldPlan::new(export.plan.as_ref().unwrap());
    assert_eq!(plan, Some(told.plan()));
    let actions = [cogmint_core::radio::library::Action { carrier_hz: 6.4896e9, pulse_duration_s: 2e-9 }];
    let mut tracker = Tracker::<4, 24, 24, 64, 16, 1, 8, 800, 6>::new();
    tracker
        .start(&Config::default(), &firmware::ANCHORS, &firmware::MAP, &actions, 1)
        .unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(listed(&tracker), printed(&export));
}

/// Anchor, walls in order from it, and whether they may come in either order.
type Listed = (usize, Vec<usize>, bool);

/// The sources that a tracker lists of its plan, in order.
fn listed<
    const A: usize,
    const SU: usize,
    const SO: usize,
    const SE: usize,
    const P: usize,
    const AC: usize,
    const C: usize,
    const R: usize,
    const N: usize,
>(
    tracker: &Tracker<A, SU, SO, SE, P, AC, C, R, N>,
) -> Vec<Listed> {
    let wall =
        |surface: u8| tracker.plan().wall_of(usize::from(surface)).expect("every source is of the plan");
    let source = |record: &Record| {
        let Sequence { first, second, is_either_order } = record.sequence;
        (record.anchor, std::iter::once(first).chain(second).map(wall).collect(), is_either_order)
    };
    tracker.environment().iter().map(|(_, record)| source(record)).collect()
}

/// The sources that `cogmint plan` prints, in order.
fn printed(export: &Export) -> Vec<Listed> {
    let source = |source: &Source| {
        (source.anchor, source.walls.iter().collect(), source.is_either_order == Some(true))
    };
    export.sources.iter().map(source).collect()
}

#[test]
fn the_command_prints_the_sources_that_the_core_lists() {
    let mut scenarios: Vec<Scenario> =
        ["seminar-room", "single-anchor", "corridor", "l-shaped-office", "dw3000-office"]
            .iter()
            .map(|name| Scenario::find(name).unwrap().0)
            .collect();
    scenarios.push(room(""));
    let (mut twice, mut ordered, mut either) = (0, 0, 0);
    for scenario in &mut scenarios {
        scenario.prior.floor_plan.told = Told::Walls;
        scenario.prior.floor_plan.known = true;
        scenario.propagation.reflection_order = 2;
        for seed in 1..=3 {
            let export = Export::of_scenario(scenario, Some(seed)).unwrap();
            let setup = Setup::new(&before(scenario, 0, seed), Path::new("room"), Some(seed)).unwrap();
            let tracker = setup.tracker::<LARGE_ANCHORS>().unwrap_or_else(|error| panic!("{error}"));
            let sources = printed(&export);
            assert_eq!(listed(&tracker), sources, "{} {seed}", scenario.name);
            twice += sources.iter().filter(|(_, walls, _)| walls.len() == 2).count();
            ordered +=
                sources.iter().filter(|(_, walls, is_either)| !is_either && !walls.is_sorted()).count();
            either += sources.iter().filter(|(.., is_either)| *is_either).count();
        }
    }
    // Each of what is compared occurs: the second wall before the first, and corners.
    assert!(twice > 50 && ordered > 10 && either > 10, "{twice} {ordered} {either}");
}

#[test]
fn the_command_prints_the_plan_of_a_file_that_has_no_more_than_a_room_and_anchors() {
    let folder = Folder::new("plan-command");
    std::fs::write(folder.path().join("my.toml"), ROOM).unwrap();
    let run = |arguments: &[&str]| cogmint(folder.path(), &[&["plan"], arguments].concat());
    let printed = |arguments: &[&str]| {
        let output = run(arguments);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap()
    };
    let table = printed(&["my.toml"]);
    assert!(table.starts_with("Two rooms: 6 walls, 2 anchors, "), "{table}");
    let data: toml::Table = toml::from_str(&printed(&["my.toml", "--format", "toml"])).unwrap();
    let object: serde_json::Value = serde_json::from_str(&printed(&["my.toml", "--json"])).unwrap();
    let sources = object["sources"].as_array().unwrap();
    assert_eq!(data["sources"].as_array().unwrap().len(), sources.len());
    assert_eq!(object["plan"]["walls"].as_array().unwrap().len(), 6);
    assert!(table.lines().count() > sources.len());
    let drawn: serde_json::Value =
        serde_json::from_str(&printed(&["my.toml", "--json", "--seed", "3"])).unwrap();
    assert_ne!(drawn["plan"], object["plan"]);
    let (scenario, _) = Scenario::find("dw3000-office").unwrap();
    let rust = Export::of_scenario(&scenario, None).unwrap().to_rust();
    assert_eq!(printed(&["dw3000-office", "--format", "rust"]), rust);
    // A recording tells what its tracker is told.
    let made = cogmint(folder.path(), &["simulate", "my.toml", "--seed", "3", "--cycles", "2", "--out", "r"]);
    assert!(made.status.success());
    let recorded: serde_json::Value = serde_json::from_str(&printed(&["r", "--json"])).unwrap();
    assert_eq!(recorded["plan"], drawn["plan"]);
    for (arguments, expected) in
        [(&["your.toml"][..], "your.toml"), (&["r", "--seed", "1"][..], "drawn already")]
    {
        let output = run(arguments);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(said.contains(expected) && said.lines().count() == 1, "{said}");
    }
}

#[test]
fn published_scenarios_keep_virtual_anchors_that_err_one_by_one_and_the_others_are_told_walls() {
    for built_in in BUILT_IN {
        let scenario = Scenario::parse(built_in.text, built_in.name).unwrap();
        let published = ["seminar-room", "seminar-room-data", "single-anchor"].contains(&built_in.name);
        assert_eq!(scenario.prior.floor_plan.told == Told::VirtualAnchors, published, "{}", built_in.name);
        let told = told(&scenario, Some(1)).unwrap();
        assert!((1..=24).contains(&told.sources.len()), "{}", built_in.name);
    }
}

#[test]
fn scenario_files_made_before_walls_were_told_stay_valid_and_are_told_walls() {
    let Some(folder) = shared_data("rooms") else { return };
    let mut files = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|extension| extension == "toml") {
            let scenario = Scenario::read(&path).unwrap_or_else(|error| panic!("{error}"));
            let plan = &scenario.prior.floor_plan;
            assert_eq!(plan.wall_offset_std_m(), 0.5 * plan.first_order_std_m);
            assert_eq!((plan.told, plan.wall_rotation_std_deg), (Told::Walls, 0.5));
            let before = before(&scenario, 0, 1);
            let known = before.virtual_anchors.iter().filter(|va| va.known).count();
            assert!((1..=24).contains(&known) && before.plan.is_some(), "{}: {known}", path.display());
            println!("{}: {known} told", path.display());
            files += 1;
        }
    }
    assert!(files > 0);
}
