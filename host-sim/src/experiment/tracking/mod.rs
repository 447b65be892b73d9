//! How well the whole tracker does: many runs of named scenarios, or of a recording from many starts.
//!
//! Every run has one seed. It makes the measurements, draws the start within its prior and seeds the tracker; runs go
//! to all processor cores, and nothing but the time per cycle depends on how.

pub mod figures;
pub mod seminar_room;
pub mod slam_ranges;
pub mod target;

use crate::input_error::InputError;
use crate::recording::Recording;
use crate::replay::{Setup, TrackerVariant};
use crate::track::{Track, track_setup};
use figures::{Figures, Outcome};
use rayon::prelude::*;
use seminar_room::{Plan, SeminarRoom, against_bound};
use slam_ranges::SlamRanges;
use std::path::Path;

/// Seeds of the simulated ranges begin here: a start and its ranges share no generator.
const RANGES_SEED: u64 = 1000;

/// A named scenario.
#[derive(Clone, Debug, PartialEq)]
pub struct Case {
    /// Its name on the command line.
    pub name: &'static str,
    /// What it is, in a line.
    pub summary: &'static str,
    made: Made,
}

/// How a case's recordings are made.
#[derive(Clone, Debug, PartialEq)]
enum Made {
    /// Ranges, drawn.
    Ranges(SlamRanges),
    /// Frames, simulated.
    Frames(SeminarRoom),
}

/// Deviation of a virtual anchor that is exact, metres.
const EXACT_STD_M: f64 = 1e-3;
/// The same where layered walls shift the delays, metres: as far as thin layers do.
const LAYERED_STD_M: f64 = 0.03;

/// All scenarios.
pub fn cases() -> Vec<Case> {
    let usual = SlamRanges::default();
    let ranges = |name, summary, ranges| Case { name, summary, made: Made::Ranges(ranges) };
    let frames = |name, summary, room| Case { name, summary, made: Made::Frames(room) };
    let rough = || SeminarRoom::with(Plan::Rough);
    let layered = || SeminarRoom::with(Plan::Exact(LAYERED_STD_M));
    vec![
        ranges("slam", "ranges of 0.1 m deviation: two anchors, no map, start within 0.5 m", usual.clone()),
        ranges(
            "slam-clutter",
            "the same with 5 false ranges per anchor and step",
            SlamRanges { clutter_per_anchor: 5.0, ..usual.clone() },
        ),
        ranges(
            "slam-detection",
            "the same with 60 % of the ranges there",
            SlamRanges { detection_probability: 0.6, ..usual.clone() },
        ),
        ranges(
            "slam-frames-lost",
            "the same with a tenth of each anchor's scans lost",
            SlamRanges { loss_probability: 0.1, ..usual.clone() },
        ),
        ranges(
            "slam-gap",
            "the same with nothing received for 3 s in the middle",
            SlamRanges { gap: 450..453, ..usual.clone() },
        ),
        ranges(
            "slam-long-gap",
            "the same with nothing received for 60 s, while the tag moves on",
            SlamRanges { gap: 450..510, ..usual.clone() },
        ),
        ranges(
            "slam-whole-room",
            "the same, the start anywhere: the mirror image in the line of the anchors explains everything as well",
            SlamRanges { start_unknown: true, ..usual },
        ),
        frames(
            "known-plan",
            "frames of the seminar room with frequency-flat walls, plan told exactly",
            SeminarRoom { walls_flat: true, ..SeminarRoom::with(Plan::Exact(EXACT_STD_M)) },
        ),
        frames("layered-walls", "the same with layered walls, told with a deviation of 3 cm", layered()),
        frames(
            "one-anchor",
            "the same with the first anchor alone",
            SeminarRoom { one_anchor: true, ..layered() },
        ),
        frames("rough-plan", "layered walls, virtual anchors told 0.1 or 0.2 m off", rough()),
        frames(
            "plan-walls-off",
            "the same with every wall of the plan 0.3 m off, by a sign of its own",
            SeminarRoom::with(Plan::WallsOff),
        ),
        frames(
            "plan-wall-missing",
            "rough plan without one of the walls",
            SeminarRoom::with(Plan::WallMissing),
        ),
        frames(
            "plan-wall-added",
            "rough plan with a wall across the room that is not there",
            SeminarRoom::with(Plan::WallAdded),
        ),
        frames(
            "frames-lost",
            "rough plan, a tenth of the frames lost",
            SeminarRoom { loss_probability: 0.1, ..rough() },
        ),
        frames("gap", "rough plan, no frame for 3 s in the middle", SeminarRoom { gap: true, ..rough() }),
        frames(
            "whole-room-start",
            "rough plan, a start at either end of the way, of which only the room is known",
            SeminarRoom { start_unknown: true, ..rough() },
        ),
    ]
}

impl Case {
    /// Whether the tracker is told of virtual anchors, without which the conventional variant cannot be.
    pub fn has_floor_plan(&self) -> bool {
        matches!(self.made, Made::Frames(_))
    }

    /// Runs a variant of the tracker through it, once per seed.
    ///
    /// # Errors
    /// The variant needs a floor plan and the case has none. Else the core refuses a recording, which would be a defect.
    pub fn run(
        &self,
        variant: TrackerVariant,
        seeds: &[u64],
        on_run: impl Fn() + Sync,
    ) -> Result<Figures, InputError> {
        let outcomes = seeds.par_iter().map(|&seed| {
            let outcome = self.run_once(variant, seed);
            on_run();
            outcome
        });
        Ok(Figures::new(self.name, variant, &outcomes.collect::<Result<Vec<_>, _>>()?))
    }

    /// Runs it with one seed.
    fn run_once(&self, variant: TrackerVariant, seed: u64) -> Result<Outcome, InputError> {
        let file = Path::new(self.name);
        match &self.made {
            Made::Ranges(ranges) => {
                let recording = ranges.record(RANGES_SEED.wrapping_add(seed));
                Ok(outcome(seed, &run_variant(&recording, file, variant, seed)?))
            }
            Made::Frames(room) => {
                let simulator = room.simulator(seed)?;
                let recording = simulator.record(simulator.cycles(), || {});
                let run = run_variant(&recording, file, variant, seed)?;
                let against_bound = Some(against_bound(&simulator, &recording, &run));
                Ok(Outcome { against_bound, ..outcome(seed, &run) })
            }
        }
    }
}

/// Runs a variant of the tracker through a recording, once per seed: each draws its start.
///
/// # Errors
/// The tracker cannot take the recording, or the variant needs a floor plan and it has none.
pub fn run_recording(
    recording: &Recording,
    folder: &Path,
    variant: TrackerVariant,
    seeds: &[u64],
    on_run: impl Fn() + Sync,
) -> Result<Figures, InputError> {
    let outcomes = seeds.par_iter().map(|&seed| {
        let run = run_variant(recording, folder, variant, seed)?;
        on_run();
        Ok(outcome(seed, &run))
    });
    Ok(Figures::new(&recording.name, variant, &outcomes.collect::<Result<Vec<_>, InputError>>()?))
}

fn run_variant(
    recording: &Recording,
    file: &Path,
    variant: TrackerVariant,
    seed: u64,
) -> Result<Track, InputError> {
    let setup = Setup::new(recording, file, Some(seed))?.with_variant(variant, file)?;
    track_setup(&setup, recording, file, || {})
}

fn outcome(seed: u64, run: &Track) -> Outcome {
    Outcome {
        seed,
        score: run.score.clone(),
        map: run.map,
        consistency: run.consistency,
        refused: run.refused,
        against_bound: None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_unique_and_targets_name_cases() {
        let cases = cases();
        let names: Vec<_> = cases.iter().map(|case| case.name).collect();
        for name in &names {
            assert_eq!(names.iter().filter(|other| other == &name).count(), 1, "{name}");
        }
        for target in target::TARGETS {
            assert!(names.contains(&target.scenario), "{}", target.scenario);
        }
    }

    #[test]
    fn the_number_of_threads_changes_no_figure_but_the_time() {
        let case = &cases()[0];
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads start");
            let figures =
                pool.install(|| case.run(TrackerVariant::default(), &[1, 2, 3], || {})).expect("it runs");
            Figures { us_per_cycle: 0.0, ..figures }
        };
        let alone = run(1);
        assert_eq!(alone, run(3));
        assert!(alone.rmse_m.is_some_and(|m| m > 0.01 && m < 1.0), "{alone:?}");
    }
}
