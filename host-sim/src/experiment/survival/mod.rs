//! How much interference a controller survives: the same interferer at one power after another, until the tag is lost.
//!
//! Powers are steps above the weakest and the same in all runs, so that differences between controllers are decibels of
//! interference; which median SINR a power leaves is told beside it. A run's noise, way and start are the same at every
//! power and for every controller. Up to the interferer's onset nothing depends on its power: every run is tracked
//! until there once per controller, and goes on from there at each level. Its end is not looked at: the tag may be found
//! again when the interferer is gone, which tells nothing about what was survived.
//!
//! Each controller goes upwards in strides until a level is not survived, then step by step from the last that was: the
//! first level tried that fails counts. One that would fail between two that are survived goes unseen.

pub mod figures;
pub mod strength;

use super::controllers::steered::Steered;
use super::controllers::{Controller, set_up};
use crate::input_error::InputError;
use crate::replay::{LARGE_ANCHORS, SMALL_ANCHORS};
use crate::scenario::{self, Interference, Scenario};
use crate::simulator::Simulator;
use figures::{Errors, Figures, LIMIT_M, Scale};
use rayon::prelude::*;
use std::ops::Range;
use std::path::Path;
use strength::Strength;

/// What is swept.
#[derive(Clone, Debug)]
pub struct Sweep {
    /// The interferer at its weakest.
    pub weakest: Interference,
    /// Power from level to level, dB.
    pub step_db: f64,
    /// Levels that are strided over while they are survived; those between are tried where the next one is not.
    pub stride: usize,
    /// The strongest level, counted from 0; at most [`Sweep::rounds`] rounds of all controllers find what is survived.
    pub strongest: usize,
    /// Controllers beside the fixed carrier; the genie is not asked, since it looks at more than a tracker can.
    pub controllers: Vec<Controller>,
    /// Runs per controller and level; each takes the next of the scenario's trajectories.
    pub runs: usize,
    /// Seed of the first run; the others count on.
    pub seed: u64,
}

impl Sweep {
    /// The most rounds that there can be, in each of which every controller is tried at a level of its own.
    pub fn rounds(&self) -> usize {
        self.strongest.div_ceil(self.stride.max(1)) + self.stride
    }
}

/// Finds how much of an interferer each controller survives in a scenario. `on_round` is called after each round of
/// controllers.
///
/// # Errors
/// The scenario cannot be simulated, or no power leaves the SINR stated for the weakest level.
pub fn survive(
    scenario: &Scenario,
    folder: Option<&Path>,
    sweep: &Sweep,
    mut on_round: impl FnMut(),
) -> Result<Figures, InputError> {
    survive_told(scenario, folder, sweep, &mut on_round)
}

/// Not generic: compiled here once, not again in every crate that calls it.
fn survive_told(
    scenario: &Scenario,
    folder: Option<&Path>,
    sweep: &Sweep,
    on_round: &mut dyn FnMut(),
) -> Result<Figures, InputError> {
    if scenario.anchors.len() <= SMALL_ANCHORS {
        Levels { scenario, folder, sweep }.figures::<SMALL_ANCHORS>(on_round)
    } else {
        Levels { scenario, folder, sweep }.figures::<LARGE_ANCHORS>(on_round)
    }
}

/// A run up to the interferer's onset.
struct Start<const A: usize> {
    trajectory: usize,
    seed: u64,
    interfered: Range<usize>,
    /// By controller.
    steered: Vec<Steered<A>>,
}

struct Levels<'a> {
    scenario: &'a Scenario,
    folder: Option<&'a Path>,
    sweep: &'a Sweep,
}

impl Levels<'_> {
    fn figures<const A: usize>(&self, on_round: &mut dyn FnMut()) -> Result<Figures, InputError> {
        let sweep = self.sweep;
        let strength = Strength::new(self.scenario, self.folder, &sweep.weakest)?;
        let others =
            sweep.controllers.iter().filter(|one| !matches!(one, Controller::Fixed | Controller::Genie));
        let controllers: Vec<Controller> = [Controller::Fixed].into_iter().chain(others.copied()).collect();
        let weakest = self.at(strength.omega_1);
        let starts = (0..sweep.runs).into_par_iter().map(|run| self.start(&weakest, run, &controllers));
        let starts: Vec<Start<A>> = starts.collect::<Result<_, _>>()?;
        let mut errors: Vec<Errors> = controllers.iter().map(|&one| Errors::new(one)).collect();
        loop {
            let next = |(index, own): (usize, &Errors)| {
                Some((index, own.next_level(sweep.stride.max(1), sweep.strongest)?))
            };
            // Those at the same level one after another: they share a simulator.
            let mut tries: Vec<(usize, usize)> = errors.iter().enumerate().filter_map(next).collect();
            tries.sort_by_key(|&(_, level)| level);
            if tries.is_empty() {
                break;
            }
            let runs = starts.par_iter().map(|start| self.go_on(&strength, start, &tries));
            let runs: Vec<Vec<Vec<f64>>> = runs.collect::<Result<_, _>>()?;
            for (place, &(index, level)) in tries.iter().enumerate() {
                let of_try = runs.iter().map(|tried| tried[place].clone()).collect();
                errors[index].levels.insert(level, of_try);
            }
            on_round();
        }
        let scale = Scale {
            step_db: sweep.step_db,
            first_seed: sweep.seed,
            median_sinr_db: &|power_db| strength.median_sinr_db(power_db),
        };
        let judged = starts.first().map_or(0..0, |start| start.interfered.clone());
        Ok(Figures {
            scenario: self.scenario.name.clone(),
            runs: sweep.runs,
            judged_cycles: [judged.start, judged.end],
            limit_m: LIMIT_M,
            weakest_omega_1_db: strength.over_direct_path_db(),
            controllers: errors.iter().map(|own| own.row(&errors[0], &scale)).collect(),
        })
    }

    /// The scenario with the interferer at a power.
    fn at(&self, omega_1: f64) -> Scenario {
        let mut scenario = self.scenario.clone();
        let strength = scenario::Strength::Omega1(omega_1);
        scenario.interference.push(Interference { strength, ..self.sweep.weakest.clone() });
        scenario
    }

    /// A run up to the onset.
    fn start<const A: usize>(
        &self,
        scenario: &Scenario,
        run: usize,
        controllers: &[Controller],
    ) -> Result<Start<A>, InputError> {
        let trajectory = run % self.scenario.trajectories.len().max(1);
        let seed = self.sweep.seed.wrapping_add(run as u64);
        let simulator = Simulator::new(scenario, self.folder, trajectory, Some(seed))?;
        let setup = set_up(&simulator)?;
        let interfered = simulator.channel().cycles_of(self.sweep.weakest.during);
        let steered = controllers.iter().map(|&controller| {
            let mut steered = Steered::new(&simulator, &setup, controller, &[])?;
            for cycle in 0..interfered.start {
                steered.cycle(&simulator, cycle)?;
            }
            Ok(steered)
        });
        let steered = steered.collect::<Result<_, InputError>>()?;
        Ok(Start { trajectory, seed, interfered, steered })
    }

    /// The position errors from there to the interferer's end, metres, of controllers (by index) each at a level.
    fn go_on<const A: usize>(
        &self,
        strength: &Strength,
        start: &Start<A>,
        tries: &[(usize, usize)],
    ) -> Result<Vec<Vec<f64>>, InputError> {
        let mut errors_m = Vec::new();
        for same in tries.chunk_by(|(_, one), (_, other)| one == other) {
            let level = same.first().map_or(0, |(_, level)| *level);
            let scenario = self.at(strength.omega_1_at(level as f64 * self.sweep.step_db));
            let simulator = Simulator::new(&scenario, self.folder, start.trajectory, Some(start.seed))?;
            for &(index, _) in same {
                let mut steered = start.steered[index].clone();
                let error_m = |cycle| Ok(steered.cycle(&simulator, cycle)?.error_m);
                errors_m.push(start.interfered.clone().map(error_m).collect::<Result<_, InputError>>()?);
            }
        }
        Ok(errors_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::demo;
    use crate::scenario::Part;

    /// Short ways, most of them under interference.
    fn room() -> Scenario {
        let (mut scenario, _) = Scenario::find("seminar-room").expect("is built in");
        for way in &mut scenario.trajectories {
            way.cycles = Some(30);
        }
        scenario
    }

    fn sweep(weakest: Interference) -> Sweep {
        let controllers = vec![Controller::Random, Controller::Cognitive];
        let weakest = Interference { during: Part([0.2, 0.9]), ..weakest };
        Sweep { weakest, step_db: 30.0, stride: 1, strongest: 2, controllers, runs: 2, seed: 1 }
    }

    #[test]
    fn what_does_not_reach_the_anchors_is_survived_at_any_power() {
        // Nothing of a band at 20 GHz passes any receiver.
        let strength = scenario::Strength::Omega1(1e-6);
        let far = Interference { carrier_hz: 20e9, strength, ..demo::interferer(0.0) };
        let figures = survive(&room(), None, &sweep(far), || {}).expect("runs");
        assert_eq!((figures.judged_cycles, figures.controllers.len()), ([6, 27], 3));
        for row in &figures.controllers {
            assert_eq!((row.survived_db, row.first_failed_db), (Some(60.0), None), "{}", row.name);
            assert!(row.levels.iter().all(|level| level.p90_m == row.levels[0].p90_m), "{}", row.name);
        }
    }

    #[test]
    fn the_first_cycles_are_those_of_an_uninterrupted_run_on_any_number_of_threads() {
        let scenario = room();
        let sweep = sweep(demo::interferer(5.0));
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads start");
            pool.install(|| survive(&scenario, None, &sweep, || {}).expect("runs"))
        };
        let figures = run(1);
        assert_eq!(figures, run(3));
        // The second level of the cognitive tracker once more, from the first cycle to the last without a clone.
        let strength = Strength::new(&scenario, None, &sweep.weakest).expect("there is such a power");
        let levels = Levels { scenario: &scenario, folder: None, sweep: &sweep };
        let interfered = levels.at(strength.omega_1_at(30.0));
        let mut runs = Vec::new();
        for (trajectory, seed) in [(0, 1), (1, 2)] {
            let simulator = Simulator::new(&interfered, None, trajectory, Some(seed)).expect("is simulated");
            let setup = set_up(&simulator).expect("is taken");
            let mut steered: Steered<SMALL_ANCHORS> =
                Steered::new(&simulator, &setup, Controller::Cognitive, &[]).expect("is taken");
            let errors_m: Vec<f64> =
                (0..27).map(|cycle| steered.cycle(&simulator, cycle).expect("runs").error_m).collect();
            runs.push(errors_m[6..].to_vec());
        }
        let alone = Errors { controller: Controller::Cognitive, levels: [(1, runs)].into() };
        let level = &figures.controllers[2].levels[1];
        assert_eq!(alone.p90_m(), [(1, level.p90_m)]);
        assert!((level.power_db - 30.0).abs() < 1e-12);
    }
}
