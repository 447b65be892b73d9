//! Random rooms: trackers side by side on the same path estimates, in rooms that nobody tuned for.
//!
//! Every room is simulated once, its frames go through the channel estimator once, and all trackers start with what the
//! recording tells: see [`crate::trackers`] and [`super::side_by_side`].

pub mod setting;
pub mod summary;

use self::setting::BeliefSetting;
use super::side_by_side::run::Judging;
use super::side_by_side::{SideBySide, Tracker, answerable, run_recording};
use crate::input_error::InputError;
use crate::replay::Setup;
use crate::rooms::{Defect, Drawn, Incident, RandomRoom, Start};
use crate::simulator::Simulator;
use rayon::prelude::*;
use serde::Serialize;
use std::path::Path;

/// All trackers in one room.
#[derive(Clone, Debug, Serialize)]
pub struct RoomRuns {
    /// What was drawn.
    #[serde(flatten)]
    pub drawn: Drawn,
    /// What the trackers made of it.
    #[serde(flatten)]
    pub trackers: SideBySide,
}

impl RoomRuns {
    /// Whether a tracker with the true associations could keep the tag. Of a simulated room that is always known.
    pub fn is_answerable(&self) -> bool {
        self.trackers.answerable == Some(true)
    }
}

/// What is wrong in a room besides what rooms draw; no tracker is told of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wrong {
    /// Something happens in it.
    Incident(Incident),
    /// The radio is not what is told.
    Defect(Defect),
}

/// Runs the trackers in a room, in which something may be wrong, with these settings of the core changed.
///
/// # Errors
/// The room cannot be simulated, or the core refuses what it gives.
pub fn run_room(
    room: &RandomRoom,
    wrong: Option<Wrong>,
    settings: &[BeliefSetting],
    trackers: &[Tracker],
) -> Result<RoomRuns, InputError> {
    let file = Path::new(&room.scenario.name);
    let simulator = Simulator::new(&room.scenario, None, 0, None)?;
    let mut recording = simulator.record(usize::MAX, || {});
    let mut judging =
        Judging { starts_anywhere: room.drawn.start == Start::Anywhere, unheard_s: None, answerable: None };
    if let Some(wrong) = wrong {
        // The same rooms are answerable whatever is wrong in them.
        judging.answerable = answerable(&recording, &Setup::new(&recording, file, None)?);
        match wrong {
            Wrong::Incident(incident) => judging.unheard_s = incident.befall(room, &mut recording)?,
            Wrong::Defect(defect) => defect.spoil(room, &mut recording)?,
        }
    }
    let mut setup = Setup::new(&recording, file, None)?;
    for setting in settings {
        setting.apply(&mut setup.config, setup.anchors.len());
    }
    let trackers = run_recording(&recording, &setup, file, trackers, &judging)?;
    Ok(RoomRuns { drawn: room.drawn, trackers })
}

/// Runs the trackers in many rooms, on all processor cores; the results are in the order of the rooms whatever their
/// number. `on_room` is called after each.
///
/// # Errors
/// As [`run_room`], of the first room that fails.
pub fn run_rooms(
    rooms: &[RandomRoom],
    wrong: Option<Wrong>,
    settings: &[BeliefSetting],
    trackers: &[Tracker],
    on_room: impl Fn() + Sync,
) -> Result<Vec<RoomRuns>, InputError> {
    let run = |room| {
        let runs = run_room(room, wrong, settings, trackers);
        on_room();
        runs
    };
    // Rooms differ in length a hundredfold: one at a time to whoever is free.
    rooms.par_iter().with_max_len(1).map(run).collect()
}
