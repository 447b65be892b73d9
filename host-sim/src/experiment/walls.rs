//! Walls: those that grow on the map of rooms with two anchors and no plan told, against those that two anchors' images or a
//! second reflection show; and how far those of a plan are from where they are, before and after the way.

use crate::floor_plan;
use crate::input_error::InputError;
use crate::recording::{PlanWall, Recording};
use crate::replay::Setup;
use crate::scenario::{Scenario, Told};
use crate::score::walls::WallScore;
use crate::simulator::Simulator;
use crate::track::track_setup;
use rayon::prelude::*;
use serde::Serialize;
use std::path::Path;

/// Rooms as they stand, with their first two anchors.
const ROOMS: [(&str, [usize; 2]); 2] = [("seminar-room", [0, 1]), ("l-shaped-office", [0, 1])];

/// A run.
#[derive(Clone, Debug, Serialize)]
pub struct Run {
    /// The room.
    pub room: &'static str,
    /// The seed.
    pub seed: u64,
    /// What was found.
    #[serde(flatten)]
    pub score: WallScore,
    /// Root mean square error of the position, metres.
    pub rmse_m: Option<f64>,
    /// Images by one reflection that were seen and are not in the map, by anchor and position in metres.
    pub missed: Vec<(usize, [f64; 2])>,
    /// The walls.
    pub walls: Vec<crate::score::walls::FoundWall>,
    /// The virtual anchors.
    pub virtual_anchors: Vec<crate::track::MappedVirtualAnchor>,
}

/// Runs every room with every seed: seed 1 goes the room's first way, seed 2 its second, and so on round.
///
/// # Errors
/// None: the scenarios are built in.
pub fn run(seeds: &[u64], on_run: impl Fn() + Sync) -> Result<Vec<Run>, InputError> {
    let pairs: Vec<_> = ROOMS.iter().flat_map(|room| seeds.iter().map(move |seed| (room, *seed))).collect();
    let runs = pairs.par_iter().map(|((name, anchors), seed)| {
        let (mut scenario, _) = Scenario::find(name)?;
        let mut index = 0..;
        scenario.anchors.retain(|_| index.next().is_some_and(|index| anchors.contains(&index)));
        scenario.prior.floor_plan.known = false;
        let way = seed.wrapping_sub(1) % scenario.trajectories.len() as u64;
        let simulator = Simulator::new(&scenario, None, way as usize, Some(*seed))?;
        let recording = simulator.record(simulator.cycles(), || {});
        let file = Path::new(name);
        let track = track_setup(&Setup::new(&recording, file, Some(*seed))?, &recording, file, || {})?;
        on_run();
        let images: Vec<_> = track.virtual_anchors.iter().map(|va| (va.anchor, va.position_m)).collect();
        Ok(Run {
            room: name,
            seed: *seed,
            score: track.wall_score,
            rmse_m: track.score.rmse_m,
            missed: WallScore::missed(&recording, &images),
            walls: track.walls,
            virtual_anchors: track.virtual_anchors,
        })
    });
    runs.collect()
}

/// Deviations that the walls of a plan are told with: of the offset, metres, and of the rotation, degrees.
const TOLD: (f64, f64) = (0.07, 0.5);
/// A wall is seen where a path by it alone is this strong (power ratio) in so many cycles.
const SEEN: (f64, usize) = (3.0, 20);

/// The walls of a plan that were seen on a way: how far each is from where it is at its centre, along its normal, metres.
#[derive(Clone, Debug, Serialize)]
pub struct ToldRun {
    /// The room.
    pub room: &'static str,
    /// The seed.
    pub seed: u64,
    /// As told.
    pub told_m: Vec<f64>,
    /// After the way.
    pub after_m: Vec<f64>,
    /// Root mean square error of the position, metres.
    pub rmse_m: Option<f64>,
}

/// Runs every room with every seed and a plan told with errors of its walls.
///
/// # Errors
/// None: the scenarios are built in.
pub fn run_told(seeds: &[u64], on_run: impl Fn() + Sync) -> Result<Vec<ToldRun>, InputError> {
    let pairs: Vec<_> = ROOMS.iter().flat_map(|room| seeds.iter().map(move |seed| (room, *seed))).collect();
    let runs = pairs.par_iter().map(|((name, _), seed)| {
        let (mut scenario, _) = Scenario::find(name)?;
        let plan = &mut scenario.prior.floor_plan;
        (plan.known, plan.exact, plan.told) = (true, false, Told::Walls);
        (plan.wall_offset_std_m, plan.wall_rotation_std_deg) = (Some(TOLD.0), TOLD.1);
        let way = seed.wrapping_sub(1) % scenario.trajectories.len() as u64;
        let truth = floor_plan::told(&scenario, None)?.plan.walls;
        let simulator = Simulator::new(&scenario, None, way as usize, Some(*seed))?;
        let recording = simulator.record(simulator.cycles(), || {});
        let told = recording.plan.as_ref().map_or(&[][..], |plan| &plan.walls);
        let file = Path::new(name);
        let track = track_setup(&Setup::new(&recording, file, Some(*seed))?, &recording, file, || {})?;
        on_run();
        let (mut told_m, mut after_m) = (Vec::new(), Vec::new());
        for wall in seen(&recording, told.len()) {
            let found = track.walls.iter().find(|found| found.plan_wall == Some(wall));
            let Some(found) = found else { continue };
            told_m.push(away_m(&truth[wall], told[wall].centre_m(), told[wall].normal()));
            after_m.push(away_m(&truth[wall], found.centre_m, found.normal));
        }
        Ok(ToldRun { room: name, seed: *seed, told_m, after_m, rmse_m: track.score.rmse_m })
    });
    runs.collect()
}

/// How far a line is from a wall at the wall's centre, metres.
fn away_m(wall: &PlanWall, on_line_m: [f64; 2], [nx, ny]: [f64; 2]) -> f64 {
    let [x, y] = wall.centre_m();
    (nx * (x - on_line_m[0]) + ny * (y - on_line_m[1])).abs()
}

/// The walls of a plan by which single reflections were seen.
fn seen(recording: &Recording, walls: usize) -> Vec<usize> {
    let mut strong = vec![0; walls];
    for path in recording.cycles.iter().flat_map(|cycle| &cycle.truth_paths) {
        let Some(source) = path.virtual_anchor.map(|index| &recording.virtual_anchors[index]) else {
            continue;
        };
        let sequence: Vec<usize> = source.walls.iter().collect();
        if let [wall] = sequence[..]
            && path.sinr > SEEN.0
        {
            strong[wall] += 1;
        }
    }
    (0..walls).filter(|&wall| strong[wall] >= SEEN.1).collect()
}
