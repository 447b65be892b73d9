//! Walls from nothing: rooms with two anchors, no plan told; the walls that grow on the map against those that two anchors'
//! images or a second reflection show.

use crate::input_error::InputError;
use crate::replay::Setup;
use crate::scenario::Scenario;
use crate::score::walls::WallScore;
use crate::simulator::Simulator;
use crate::track::track_setup;
use rayon::prelude::*;
use serde::Serialize;
use std::path::Path;

/// Rooms, and the anchors that are there.
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
        // The room as such: nobody in it, and no partitions.
        scenario.people.clear();
        scenario.room.inner_walls.clear();
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
