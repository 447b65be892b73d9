//! Whether the images are where the plan lets them be seen: its availability beside the paths of the simulated channel.
//!
//! At the true places of the scenario's ways, with the plan as it stands: of the sources that the plan calls unavailable, how
//! many have a path all the same, and of those that it calls clear, how many have one. The sources are all that the core lists
//! of the plan, also where recordings do not tell it (`prior.floor_plan.known = false`): what is checked is the plan, not what
//! a tracker makes of it.

use super::told;
use crate::channel::Channel;
use crate::geometry::distance_m;
use crate::input_error::InputError;
use crate::scenario::Scenario;
use crate::told_plan;
use cogmint_core::model::availability::{WallNow, Walls};
use serde::Serialize;
use std::path::Path;

/// Availability below which a source counts as unavailable.
const UNAVAILABLE: f32 = 0.1;
/// Availability above which it counts as clear.
const CLEAR: f32 = 0.9;
/// The place is known this well, metres: true places are exact but walls are thick.
const PLACE_STD_M: f32 = 0.05;
/// Share that comes through a wall of which nothing is known.
const THROUGH: f32 = cogmint_core::model::availability::USUAL_THROUGH;
/// The image of a source is the channel's within this distance, metres.
const SAME_M: f64 = 0.01;
/// Places looked at on each way, at most.
const LOOKS: usize = 250;

/// Of some looks at sources, how many there were and how many showed a path.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Looks {
    /// Looks.
    pub looks: usize,
    /// Looks with a path.
    pub with_path: usize,
}

impl Looks {
    fn add(&mut self, has_path: bool) {
        self.looks += 1;
        self.with_path += usize::from(has_path);
    }

    /// Share of the looks with a path; none without a look.
    pub fn share(&self) -> Option<f64> {
        (self.looks > 0).then(|| self.with_path as f64 / self.looks as f64)
    }
}

/// The plan's availability beside the channel's paths.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Check {
    /// Of sources with an availability below 0.1.
    pub unavailable: Looks,
    /// Of those between.
    pub between: Looks,
    /// Of those above 0.9.
    pub clear: Looks,
}

impl Check {
    /// Adds another check's looks.
    pub fn add(&mut self, other: &Self) {
        let pairs = [
            (&mut self.unavailable, other.unavailable),
            (&mut self.between, other.between),
            (&mut self.clear, other.clear),
        ];
        for (sum, looks) in pairs {
            sum.looks += looks.looks;
            sum.with_path += looks.with_path;
        }
    }
}

/// Checks a scenario's plan on all its ways, without errors of the walls; `folder` is where its files are.
///
/// # Errors
/// The scenario has no plan of its own room, or a file of it cannot be read.
pub fn check(scenario: &Scenario, folder: Option<&Path>) -> Result<Check, InputError> {
    if scenario.prior.floor_plan.room.is_some() {
        let reason = "has a floor plan of another room, which is not that of the paths";
        return Err(InputError::new(&scenario.name, reason).for_item("prior.floor_plan.room"));
    }
    let told = told(scenario, None)?;
    let plan = told_plan::ToldPlan::new(&told.plan).kept(&scenario.name, "room")?;
    let walls = Walls::new(&plan, |_, wall| WallNow::told(wall, THROUGH));
    let mut check = Check::default();
    for trajectory in 0..scenario.trajectories.len() {
        let channel = Channel::new(scenario, folder, trajectory, None)?;
        let image_of: Vec<Option<usize>> = told
            .sources
            .iter()
            .map(|source| {
                let images = channel.images(source.anchor);
                (1..images.len())
                    .find(|&image| distance_m(images[image].position_m, source.position_m) < SAME_M)
            })
            .collect();
        let step = channel.poses().len().div_ceil(LOOKS).max(1);
        for cycle in (0..channel.poses().len()).step_by(step) {
            let place_m = channel.poses()[cycle].position_m.map(|x| x as f32);
            for (index, anchor) in scenario.anchors.iter().enumerate() {
                let present: Vec<usize> =
                    channel.paths(cycle, index).iter().map(crate::channel::path::Path::source).collect();
                let paths = walls.paths(anchor.position_m.map(|x| x as f32), place_m, PLACE_STD_M);
                for (source, image) in told.sources.iter().zip(&image_of) {
                    let Some(image) = image else { continue };
                    if source.anchor != index {
                        continue;
                    }
                    let sequence: Vec<usize> = source.walls.iter().collect();
                    let availability = match sequence[..] {
                        [first] => paths.reflected(first, None),
                        [first, second] if source.is_either_order => paths.either_order([first, second]).0,
                        [first, second] => paths.reflected(first, Some(second)),
                        _ => continue,
                    };
                    let looks = match availability {
                        a if a < UNAVAILABLE => &mut check.unavailable,
                        a if a > CLEAR => &mut check.clear,
                        _ => &mut check.between,
                    };
                    looks.add(present.contains(image));
                }
            }
        }
    }
    Ok(check)
}
