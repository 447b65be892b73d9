//! Random rooms: trackers side by side on the same path estimates, in rooms that nobody tuned for.
//!
//! Every room is simulated once, its frames go through the channel estimator once, and all trackers start with what the
//! recording tells: see [`crate::trackers`]. A room is **answerable** if the posterior bound along the true way, from the
//! paths that were detected with the deviations told, is below 0.3 m in 90 % of the cycles; no tracker enters into it.

pub mod run;
pub mod summary;

use crate::input_error::InputError;
use crate::recording::Recording;
use crate::replay::Setup;
use crate::rooms::{Drawn, RandomRoom, Start};
use crate::simulator::Simulator;
use crate::trackers::{self, CycleScans, Estimate, bound};
use rayon::prelude::*;
use run::{Judged, Run};
use serde::Serialize;
use std::path::Path;

/// A tracker of the comparison.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tracker {
    /// The core.
    Cogmint,
    /// An extended Kalman filter that is told the true associations.
    Told,
    /// The core without any reflection.
    Direct,
    /// A plain extended Kalman filter on the first path of every anchor.
    Ekf,
    /// A particle filter with the plan.
    Particles,
}

impl Tracker {
    /// All of them.
    pub const ALL: [Tracker; 5] =
        [Tracker::Cogmint, Tracker::Told, Tracker::Direct, Tracker::Ekf, Tracker::Particles];
    /// Those that run unless others are asked for.
    pub const USUAL: [Tracker; 4] = [Tracker::Cogmint, Tracker::Told, Tracker::Direct, Tracker::Ekf];

    /// Its name on the command line and in tables.
    pub fn name(self) -> &'static str {
        match self {
            Tracker::Cogmint => "cogmint",
            Tracker::Told => "told",
            Tracker::Direct => "direct",
            Tracker::Ekf => "ekf",
            Tracker::Particles => "particles",
        }
    }

    fn run(
        self,
        recording: &Recording,
        setup: &Setup,
        cycles: &[CycleScans],
        file: &Path,
    ) -> Result<Vec<Estimate>, InputError> {
        match self {
            Tracker::Cogmint => trackers::core::run(setup, recording, file),
            Tracker::Direct => trackers::core::run(&setup.clone().without_reflections(), recording, file),
            Tracker::Told => Ok(trackers::told::run(recording, setup, cycles)),
            Tracker::Ekf => Ok(trackers::first_path_ekf::run(recording, setup, cycles, None)),
            Tracker::Particles => {
                Ok(trackers::particles::run(recording, setup, cycles, trackers::particles::PARTICLES, 1))
            }
        }
    }
}

/// All trackers in one room.
#[derive(Clone, Debug, Serialize)]
pub struct RoomRuns {
    /// What was drawn.
    #[serde(flatten)]
    pub drawn: Drawn,
    /// Whether a tracker with the true associations could keep the tag.
    pub answerable: bool,
    /// Root mean square over the cycles of the least error that the frames allow, metres; none where it is unbounded.
    pub bound_m: Option<f64>,
    /// Share of the direct paths of each anchor that were detected, over its frames.
    pub direct_detected: Vec<f64>,
    /// Mean number of paths found per frame.
    pub paths_per_frame: f64,
    /// The trackers, in the order asked for.
    pub runs: Vec<Run>,
    /// Time that each of them took, seconds.
    #[serde(skip)]
    pub seconds: Vec<f64>,
}

/// Runs the trackers in a room.
///
/// # Errors
/// The room cannot be simulated, or the core refuses what it gives.
pub fn run_room(room: &RandomRoom, trackers: &[Tracker]) -> Result<RoomRuns, InputError> {
    let file = Path::new(&room.scenario.name);
    let simulator = Simulator::new(&room.scenario, None, 0, None)?;
    let recording = simulator.record(usize::MAX, || {});
    let setup = Setup::new(&recording, file, None)?;
    let cycles = trackers::scans(&recording, &setup);
    let bound_m = bound::frames(&recording, &setup, &cycles);
    let answerable = bound::answerable(&bound::detected(&recording, &setup, &cycles));
    let starts_anywhere = room.drawn.start == Start::Anywhere;
    let first_s = recording.cycles.first().map_or(0.0, |cycle| cycle.time_s);
    let mut runs = Vec::new();
    let mut seconds = Vec::new();
    for &tracker in trackers {
        let begin = std::time::Instant::now();
        let estimates = tracker.run(&recording, &setup, &cycles, file)?;
        seconds.push(begin.elapsed().as_secs_f64());
        let judged: Vec<Judged> = recording
            .cycles
            .iter()
            .zip(&bound_m)
            .zip(&estimates)
            .filter_map(|((cycle, &bound_m), &estimate)| {
                let truth_m = cycle.truth_position_m?;
                Some(Judged { time_s: cycle.time_s - first_s, truth_m, bound_m, estimate })
            })
            .collect();
        runs.push(Run::new(tracker.name(), &judged, starts_anywhere));
    }
    let rmse_of_told = runs.iter().find(|run| run.tracker == Tracker::Told.name()).and_then(|run| run.rmse_m);
    for run in &mut runs {
        run.ratio_to_told = run.rmse_m.zip(rmse_of_told).map(|(own, told)| own / told);
    }
    let mean_square = bound_m.iter().map(|bound| bound * bound).sum::<f64>() / bound_m.len() as f64;
    let scans = cycles.iter().flat_map(|cycle| &cycle.scans);
    let (frames, paths) = scans.fold((0, 0), |(frames, paths), scan| (frames + 1, paths + scan.paths.len()));
    Ok(RoomRuns {
        drawn: room.drawn,
        answerable,
        bound_m: Some(mean_square.sqrt()).filter(|bound| bound.is_finite()),
        direct_detected: (0..recording.anchors.len())
            .map(|anchor| direct_detected(&cycles, anchor))
            .collect(),
        paths_per_frame: if frames > 0 { paths as f64 / frames as f64 } else { 0.0 },
        runs,
        seconds,
    })
}

/// Share of an anchor's frames in which its direct path was found; 0 without frames.
fn direct_detected(cycles: &[CycleScans], anchor: usize) -> f64 {
    let scans = cycles.iter().flat_map(|cycle| &cycle.scans).filter(|scan| scan.anchor == anchor);
    let is_direct = |path: &trackers::ScanPath| path.source == Some(trackers::Source::Direct);
    let (mut frames, mut found) = (0, 0);
    for scan in scans {
        frames += 1;
        found += usize::from(scan.paths.iter().any(is_direct));
    }
    if frames > 0 { f64::from(found as u32) / f64::from(frames) } else { 0.0 }
}

/// Runs the trackers in many rooms, on all processor cores; the results are in the order of the rooms whatever their
/// number. `on_room` is called after each.
///
/// # Errors
/// As [`run_room`], of the first room that fails.
pub fn run_rooms(
    rooms: &[RandomRoom],
    trackers: &[Tracker],
    on_room: impl Fn() + Sync,
) -> Result<Vec<RoomRuns>, InputError> {
    let run = |room| {
        let runs = run_room(room, trackers);
        on_room();
        runs
    };
    // Rooms differ in length a hundredfold: one at a time to whoever is free.
    rooms.par_iter().with_max_len(1).map(run).collect()
}
