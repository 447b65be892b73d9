//! What becomes of walls, from samples to the map: those that a plan tells and that are not there or elsewhere, and those that
//! nobody tells.
//!
//! Every test runs a room as it is told wrongly beside the same room told rightly, or counts over seeds what must not come from
//! luck. Counts of failures are what was measured: fewer is better, none is what must be.

use cogmint::floor_plan;
use cogmint::recording::Recording;
use cogmint::replay::Setup;
use cogmint::scenario::Scenario;
use cogmint::score::walls::{self, FoundWall};
use cogmint::simulator::Simulator;
use cogmint::track::{Track, track_setup};
use std::path::Path;

/// Seeds of a test's runs.
const SEEDS: std::ops::RangeInclusive<u64> = 1..=10;
/// A walk past all walls.
const WALK_M: [[f64; 2]; 6] = [[1.5, 3.0], [6.5, 1.0], [7.0, 3.5], [2.5, 5.2], [3.0, 2.0], [6.0, 2.5]];
/// Slower than anybody walks: doubt takes time.
const SLOW_M_S: f64 = 0.15;

/// A room of 8 m by 6 m with two anchors, a walk through it and the deviation of the walls told.
fn room(walk_m: &[[f64; 2]], speed_m_s: f64, wall_std_m: f64, inner: &str, told: &str) -> Scenario {
    let point = |point_m: &[f64; 2]| format!("{{ position_m = {point_m:?}, speed_m_s = {speed_m_s} }}");
    let points: Vec<String> = walk_m.iter().map(point).collect();
    let text = format!(
        r#"
        format = 1
        name = "Walls"
        anchors = [{{ name = "A", position_m = [1.0, 1.5] }}, {{ name = "B", position_m = [6.5, 4.8] }}]
        trajectories = [{{ period_s = 0.1, way.waypoints.points = [{}] }}]
        propagation.reflection_order = 2
        radio.kind = "sounder"
        prior.acceleration_std_m_s2 = 0.5
        prior.velocity_std_m_s = 0.5
        prior.floor_plan.wall_offset_std_m = {wall_std_m}
        room.corners_m = [[0, 0], [8, 0], [8, 6], [0, 6]]
        room.construction = "concrete"
        room.inner_walls = [{inner}]
        {told}
        "#,
        points.join(", ")
    );
    Scenario::parse(&text, "walls.toml").unwrap_or_else(|error| panic!("{error}"))
}

/// A plan of another room, exactly as that stands.
fn told_another(corners_m: &str, inner: &str) -> String {
    format!(
        "prior.floor_plan.exact = true\nprior.floor_plan.room.corners_m = {corners_m}\n\
         prior.floor_plan.room.construction = \"concrete\"\nprior.floor_plan.room.inner_walls = [{inner}]\n"
    )
}

fn run(scenario: &Scenario, seed: u64) -> (Recording, Track) {
    let file = Path::new("walls");
    let simulator = Simulator::new(scenario, None, 0, Some(seed)).unwrap();
    let recording = simulator.record(simulator.cycles(), || {});
    let setup = Setup::new(&recording, file, Some(seed)).unwrap();
    let track = track_setup(&setup, &recording, file, || {}).unwrap();
    (recording, track)
}

fn wall_of(track: &Track, plan_wall: usize) -> &FoundWall {
    track.walls.iter().find(|wall| wall.plan_wall == Some(plan_wall)).expect("a source is reflected by it")
}

/// Asserts that the tag was known all the way: never lost, and near at the end.
fn assert_kept(track: &Track, seed: u64) {
    let end_m = track.errors_m.last().map_or(f64::INFINITY, |(_, error_m)| *error_m);
    assert!(
        track.losses == 0 && !track.score.diverged && end_m < 0.3,
        "seed {seed}: {:?} {end_m}",
        track.score
    );
}

#[test]
fn a_wall_of_the_plan_that_is_not_there_is_doubted_and_the_tag_is_kept() {
    const INNER: &str = r#"{ from_m = [0.0, 4.0], to_m = [6.0, 4.0], construction = "concrete" }"#;
    const SQUARE: &str = "[[0, 0], [8, 0], [8, 6], [0, 6]]";
    let walk_m = [[2.0, 3.0], [5.5, 3.2], [6.0, 2.0], [1.5, 1.0], [3.0, 3.0], [2.5, 1.5]];
    let absent = room(&walk_m, SLOW_M_S, 0.03, "", &told_another(SQUARE, INNER));
    let there = room(&walk_m, SLOW_M_S, 0.03, INNER, "prior.floor_plan.exact = true");
    let mut believed = Vec::new();
    for seed in 31..=90 {
        let (_, track) = run(&absent, seed);
        assert_kept(&track, seed);
        let wall = wall_of(&track, 4);
        println!("seed {seed}: existence {:.3}", wall.existence);
        if wall.existence > 0.5 {
            believed.push(seed);
        }
    }
    // Too many: a path of something else is taken for its image (docs/map.md, known defects). Of a hundred runs it is believed in 33,
    // and in 39 where nothing is read below the threshold.
    assert!(believed.len() <= 24, "believed in the runs of seeds {believed:?}");
    // The wall itself is not what is doubted: where it is, it is believed.
    let (_, track) = run(&there, 1);
    assert!(wall_of(&track, 4).existence > 0.9, "{:?}", wall_of(&track, 4));
}

#[test]
fn a_wall_that_stands_a_metre_off_is_learnt_anew_or_doubted() {
    let moved = room(&WALK_M, SLOW_M_S, 0.1, "", &told_another("[[0, 0], [8, 0], [8, 7], [0, 7]]", ""));
    let (mut wrong, mut learnt) = (Vec::new(), 0);
    for seed in SEEDS {
        let (_, track) = run(&moved, seed);
        assert_kept(&track, seed);
        let wall = wall_of(&track, 2);
        let [_, ny] = wall.normal;
        let off_m = (ny * (6.0 - wall.centre_m[1]) + wall.normal[0] * (4.0 - wall.centre_m[0])).abs();
        println!("seed {seed}: off by {off_m:.3} m, existence {:.3}", wall.existence);
        learnt += usize::from(off_m < 0.15);
        if off_m >= 0.15 && !wall.is_doubted {
            wrong.push(seed);
        }
    }
    assert!(wrong.len() <= 3, "believed where it is not in the runs of seeds {wrong:?}");
    assert!(learnt >= 5, "{learnt}");
}

#[test]
fn a_map_without_a_plan_grows_walls_of_the_seminar_room() {
    let (mut scenario, _) = Scenario::find("seminar-room").unwrap();
    scenario.prior.floor_plan.known = false;
    for seed in 1..=3 {
        let (recording, track) = run(&scenario, seed);
        assert_kept(&track, seed);
        let is_wall = |found: &FoundWall, along_y_m: f64| {
            let ([nx, ny], [cx, cy]) = (found.normal, found.centre_m);
            recording.walls.iter().any(|[[ax, ay], [bx, by]]| {
                let length_m = (bx - ax).hypot(by - ay);
                let sin = (nx * (bx - ax) + ny * (by - ay)) / length_m;
                let away_m = nx * (0.5 * (ax + bx) - cx) + ny * (0.5 * (ay + by) + along_y_m - cy);
                sin.abs() < 3.0_f64.to_radians().sin() && away_m.abs() < 0.3
            })
        };
        let grown = || track.walls.iter().filter(|wall| !wall.is_told && !wall.is_doubted);
        let right = |along_y_m| grown().filter(|wall| is_wall(wall, along_y_m)).count();
        println!("seed {seed}: {} walls, {} right", grown().count(), right(0.0));
        assert!(right(0.0) >= 1, "seed {seed}: {:?}", track.walls);
        // What counts as right is no accident: of a room pushed aside, fewer are.
        assert!(right(1.0) < right(0.0), "seed {seed}");
    }
}

#[test]
fn the_offsets_of_walls_learnt_are_off_by_what_their_deviations_say() {
    let [told, learnt] = squares(&room(&WALK_M, 0.5, 0.1, "", ""));
    // 1 where deviations are right, 4 where they are half of what they should be. Measured: 0.18, so that here they are too large
    // by more than a factor of two.
    assert!((0.3..2.5).contains(&told), "as told {told:.2}");
    assert!(learnt < 2.0, "after the way {learnt:.2}");
}

/// Mean squares of how far the walls that were seen are off, as told and after the way, over their deviations.
fn squares(scenario: &Scenario) -> [f64; 2] {
    let truth = floor_plan::told(scenario, None).unwrap().plan.walls;
    let std_m = truth[0].offset_std_m;
    let (mut told, mut learnt) = (Vec::new(), Vec::new());
    for seed in SEEDS {
        let (recording, track) = run(scenario, seed);
        assert_kept(&track, seed);
        for wall in walls::told(&recording, &truth, &track.walls) {
            told.push((wall.told_m / std_m).powi(2));
            learnt.push((wall.after_m / wall.std_m).powi(2));
        }
    }
    assert!(told.len() >= 30, "{}", told.len());
    let means = [told, learnt].map(|squares| squares.iter().sum::<f64>() / squares.len() as f64);
    println!("{}: mean squares as told {:.2}, after the way {:.2}", scenario.name, means[0], means[1]);
    means
}
