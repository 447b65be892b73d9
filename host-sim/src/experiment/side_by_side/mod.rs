//! Trackers side by side over one recording: the same path estimates, the same plan, the same start.

pub mod run;

use crate::input_error::InputError;
use crate::recording::Recording;
use crate::replay::Setup;
use crate::trackers::{self, CycleScans, Estimate, bound};
use run::{Judged, Judging, Run};
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
            Tracker::Ekf => Ok(trackers::first_path_ekf::run(recording, setup, cycles)),
            Tracker::Particles => {
                Ok(trackers::particles::run(recording, setup, cycles, trackers::particles::PARTICLES, 1))
            }
        }
    }
}

/// Trackers over one recording.
#[derive(Clone, Debug, Serialize)]
pub struct SideBySide {
    /// Whether a tracker with the true associations could keep the tag: the posterior bound along the true way, from the
    /// paths that were detected and the deviations told, is below 0.3 m in 90 % of the cycles. No tracker enters into it;
    /// none where the true paths are unknown.
    pub answerable: Option<bool>,
    /// Root mean square over the cycles of the least error that the frames allow, metres; none where it is unbounded or the
    /// true paths are unknown.
    pub bound_m: Option<f64>,
    /// Share of the frames of each anchor in which its direct path was found.
    pub direct_detected: Vec<f64>,
    /// Mean number of paths found per frame.
    pub paths_per_frame: f64,
    /// The trackers, in the order asked for.
    pub runs: Vec<Run>,
    /// Time that each of them took, seconds: no two runs have the same.
    #[serde(skip)]
    pub seconds: Vec<f64>,
}

/// See [`SideBySide::answerable`].
pub fn answerable(recording: &Recording, setup: &Setup) -> Option<bool> {
    is_answerable(recording, setup, &trackers::scans(recording, setup))
}

fn is_answerable(recording: &Recording, setup: &Setup, cycles: &[CycleScans]) -> Option<bool> {
    let has_true_paths = recording.cycles.iter().any(|cycle| !cycle.truth_paths.is_empty());
    has_true_paths.then(|| bound::answerable(&bound::detected(recording, setup, cycles)))
}

/// Runs the trackers over a recording with at least one cycle of known truth; `file` is named in messages.
/// `judging` is on the recording's clock. Where no true path is known, [`Tracker::Told`] has nothing to be told and is
/// left out.
///
/// # Errors
/// The core refuses what the recording gives, or no cycle's true position is known.
pub fn run_recording(
    recording: &Recording,
    setup: &Setup,
    file: &Path,
    trackers: &[Tracker],
    judging: &Judging,
) -> Result<SideBySide, InputError> {
    let first = recording.cycles.iter().find(|cycle| cycle.truth_position_m.is_some());
    let Some(first_s) = first.map(|cycle| cycle.time_s) else {
        return Err(InputError::new(file, "has no true position to judge trackers by"));
    };
    let cycles = trackers::scans(recording, setup);
    let bound_m = bound::frames(recording, setup, &cycles);
    let has_true_paths = recording.cycles.iter().any(|cycle| !cycle.truth_paths.is_empty());
    let answerable = judging.answerable.or_else(|| is_answerable(recording, setup, &cycles));
    // On the clock of the judged cycles.
    let unheard_s = judging.unheard_s.map(|window_s| window_s.map(|time_s| time_s - first_s));
    let judging = Judging { unheard_s, ..*judging };
    let mut runs = Vec::new();
    let mut seconds = Vec::new();
    for &tracker in trackers.iter().filter(|tracker| has_true_paths || **tracker != Tracker::Told) {
        let begin = std::time::Instant::now();
        let estimates = tracker.run(recording, setup, &cycles, file)?;
        seconds.push(begin.elapsed().as_secs_f64());
        let judged: Vec<Judged> = recording
            .cycles
            .iter()
            .zip(&estimates)
            .enumerate()
            .filter_map(|(index, (cycle, &estimate))| {
                let truth_m = cycle.truth_position_m?;
                let bound_m = bound_m.get(index).copied().unwrap_or(f64::INFINITY);
                Some(Judged { time_s: cycle.time_s - first_s, truth_m, bound_m, estimate })
            })
            .collect();
        runs.push(Run::new(tracker.name(), &judged, &judging));
    }
    let rmse_of_told = runs.iter().find(|run| run.tracker == Tracker::Told.name()).and_then(|run| run.rmse_m);
    for run in &mut runs {
        run.ratio_to_told = run.rmse_m.zip(rmse_of_told).map(|(own, told)| own / told);
    }
    let mean_square = bound_m.iter().map(|bound| bound * bound).sum::<f64>() / bound_m.len() as f64;
    let scans = cycles.iter().flat_map(|cycle| &cycle.scans);
    let (frames, paths) = scans.fold((0, 0), |(frames, paths), scan| (frames + 1, paths + scan.paths.len()));
    Ok(SideBySide {
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
