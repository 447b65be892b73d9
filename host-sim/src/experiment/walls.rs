//! Walls: those that grow on the map of rooms with two anchors and no plan told, against those that two anchors' images or a
//! second reflection show; and how far those of a plan are from where they are, before and after the way.

use super::over_runs::{mean_of, quantile};
use crate::floor_plan;
use crate::input_error::InputError;
use crate::replay::Setup;
use crate::scenario::{Scenario, Told};
use crate::score::walls::{FoundWall, GrownWall, ToldWall, WallScore, grown, told};
use crate::simulator::Simulator;
use crate::track::track_setup;
use rayon::prelude::*;
use serde::Serialize;
use std::path::Path;

/// Rooms as they stand, and the anchors that a map without a plan grows from.
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
    pub walls: Vec<FoundWall>,
    /// How far those that are right are from where they are.
    pub grown_walls: Vec<GrownWall>,
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
            grown_walls: grown(&recording, &track.walls),
            walls: track.walls,
            virtual_anchors: track.virtual_anchors,
        })
    });
    runs.collect()
}

/// Deviations that the walls of a plan are told with: of the offset, metres, and of the rotation, degrees.
const TOLD: (f64, f64) = (0.07, 0.5);

/// The walls of a plan that were seen on a way, believed at its end or not.
#[derive(Clone, Debug, Serialize)]
pub struct ToldRun {
    /// The room.
    pub room: &'static str,
    /// The seed.
    pub seed: u64,
    /// How far each is from where it is.
    pub walls: Vec<ToldWall>,
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
        let file = Path::new(name);
        let track = track_setup(&Setup::new(&recording, file, Some(*seed))?, &recording, file, || {})?;
        on_run();
        let walls = told(&recording, &truth, &track.walls);
        Ok(ToldRun { room: name, seed: *seed, walls, rmse_m: track.score.rmse_m })
    });
    runs.collect()
}

/// Errors over the deviations that the tracker gave them: 0.67 and 1.64 where it is right.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Ratios {
    /// How many there are.
    pub count: usize,
    /// Their median.
    pub median: Option<f64>,
    /// Their 90 % quantile.
    pub p90: Option<f64>,
}

impl Ratios {
    fn of(errors: impl Iterator<Item = (f64, f64)>) -> Self {
        let ratios: Vec<f64> = errors.map(|(error, std)| error / std).collect();
        let at = |share| quantile(share, ratios.iter().copied());
        Self { count: ratios.len(), median: at(0.5), p90: at(0.9) }
    }
}

/// The walls of a room over all runs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// The room.
    pub room: &'static str,
    /// Walls told that were seen on the way.
    pub told: usize,
    /// Of those, doubted at the end.
    pub doubted: usize,
    /// How far they are off as told, doubted ones included, mean in metres.
    pub told_m: Option<f64>,
    /// The same after the way.
    pub after_m: Option<f64>,
    /// The same of those that are believed.
    pub believed_m: Option<f64>,
    /// Offsets of all of them after the way over their deviations.
    pub told_offset: Ratios,
    /// Offsets of the grown walls that are right over their deviations.
    pub grown_offset: Ratios,
    /// Angles of the same.
    pub grown_rotation: Ratios,
}

/// The figures of every room.
pub fn summaries(runs: &[Run], told: &[ToldRun]) -> Vec<Summary> {
    let of = |&(room, _): &(&'static str, _)| {
        let walls = || told.iter().filter(move |run| run.room == room).flat_map(|run| &run.walls);
        let grown = || runs.iter().filter(move |run| run.room == room).flat_map(|run| &run.grown_walls);
        Summary {
            room,
            told: walls().count(),
            doubted: walls().filter(|wall| wall.is_doubted).count(),
            told_m: mean_of(walls().map(|wall| wall.told_m)),
            after_m: mean_of(walls().map(|wall| wall.after_m)),
            believed_m: mean_of(walls().filter(|wall| !wall.is_doubted).map(|wall| wall.after_m)),
            told_offset: Ratios::of(walls().map(|wall| (wall.after_m, wall.std_m))),
            grown_offset: Ratios::of(grown().map(|wall| (wall.offset_m, wall.offset_std_m))),
            grown_rotation: Ratios::of(grown().map(|wall| (wall.rotation_rad, wall.rotation_std_rad))),
        }
    };
    ROOMS.iter().map(of).collect()
}
