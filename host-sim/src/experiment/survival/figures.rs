//! Up to which power of an interferer a controller survives, and by how much more than the fixed carrier.

use crate::channel::random::uniform;
use crate::experiment::controllers::Controller;
use crate::score::Score;
use rand_core::SeedableRng;
use rand_xoshiro::Xoshiro128PlusPlus;
use serde::Serialize;
use std::collections::BTreeMap;

/// A controller survives while the 90 % quantile of its errors is below this, metres.
pub const LIMIT_M: f64 = 0.3;
/// The quantile.
const SHARE: f64 = 0.9;
/// Resamplings of the runs that standard errors come from.
const RESAMPLINGS: usize = 200;

/// What one controller made of the levels that it was tried at: position errors under interference, metres.
#[derive(Clone, Debug)]
pub struct Errors {
    /// Which controller.
    pub controller: Controller,
    /// By level (0: the weakest), per run, per cycle.
    pub levels: BTreeMap<usize, Vec<Vec<f64>>>,
}

/// How much interference controllers survive in a scenario.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Figures {
    /// The scenario's name.
    pub scenario: String,
    /// Runs per controller and level.
    pub runs: usize,
    /// The cycles that errors are taken over: those of the interferer on the first way.
    pub judged_cycles: [usize; 2],
    /// The 90 % quantile must stay below this, metres.
    pub limit_m: f64,
    /// Power of the weakest level: Omega_1 over the power of a direct path of 1 m, both at 7 GHz, dB.
    pub weakest_omega_1_db: f64,
    /// The controllers, the fixed carrier first.
    pub controllers: Vec<Row>,
}

/// One controller.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// Its name.
    pub name: &'static str,
    /// The power at which its 90 % quantile reaches the limit, dB over the weakest level: between `first_failed_db` and the
    /// next weaker level tried, on the straight line of ln p90 over the power. The strongest level where none failed; none
    /// where the weakest failed.
    pub survived_db: Option<f64>,
    /// Median SINR that this power leaves to the paths in use on the first way, dB.
    pub survived_median_sinr_db: Option<f64>,
    /// The weakest level tried that was not survived, dB over the weakest; none where all were survived.
    pub first_failed_db: Option<f64>,
    /// Power that it survives beyond what the fixed carrier does, dB; none where one of them fails at the weakest.
    pub beyond_fixed_db: Option<f64>,
    /// Standard error of that, dB: over resamplings of the runs, the same for both.
    pub beyond_fixed_error_db: Option<f64>,
    /// The levels that it was tried at, weakest first.
    pub levels: Vec<Level>,
}

/// A controller at one power of the interferer.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Level {
    /// Power over the weakest level's, dB.
    pub power_db: f64,
    /// Median SINR that it leaves to the paths in use on the first way, dB; none where none is in use.
    pub median_sinr_db: Option<f64>,
    /// 90 % quantile of the position errors of all runs and interfered cycles together, metres.
    pub p90_m: f64,
    /// Mean over the runs of the 90 % quantile of each, metres.
    pub p90_mean_m: f64,
    /// Seeds of the runs that lost the tag under interference: above 1 m at its end, or for more than a tenth of it.
    pub diverged: Vec<u64>,
}

/// What the levels are.
pub struct Scale<'a> {
    /// Power from level to level, dB.
    pub step_db: f64,
    /// Seed of the first run.
    pub first_seed: u64,
    /// Median SINR that a power (dB over the weakest level's) leaves, dB.
    pub median_sinr_db: &'a dyn Fn(f64) -> Option<f64>,
}

/// A quantile of the values of all runs together, as [`Score`] has it; NaN where there is none.
fn pooled_quantile<'a>(runs: impl Iterator<Item = &'a Vec<f64>>, share: f64) -> f64 {
    let mut values: Vec<f64> = runs.flatten().copied().collect();
    let Some(last) = values.len().checked_sub(1) else { return f64::NAN };
    *values.select_nth_unstable_by((share * last as f64).round() as usize, f64::total_cmp).1
}

/// NaN fails.
fn fails(p90_m: f64) -> bool {
    !(p90_m < LIMIT_M)
}

/// The level at which the quantile reaches the limit, in part (see [`Row::survived_db`]); levels are in order.
fn survived(levels: &[(usize, f64)]) -> Option<f64> {
    let Some(first) = levels.iter().position(|(_, p90_m)| fails(*p90_m)) else {
        return levels.last().map(|(level, _)| *level as f64);
    };
    let (last, below_m) = levels[first.checked_sub(1)?];
    let (failed, above_m) = levels[first];
    let share = (LIMIT_M / below_m).ln() / (above_m / below_m).ln();
    Some(last as f64 + if share.is_finite() { share * (failed - last) as f64 } else { 0.0 })
}

impl Errors {
    /// Nothing tried yet.
    pub fn new(controller: Controller) -> Self {
        Self { controller, levels: BTreeMap::new() }
    }

    /// The 90 % quantile of all runs together at the levels tried, in order, metres.
    pub fn p90_m(&self) -> Vec<(usize, f64)> {
        self.levels.iter().map(|(&level, runs)| (level, pooled_quantile(runs.iter(), SHARE))).collect()
    }

    /// The same of chosen runs.
    fn p90_of_m(&self, chosen: &[usize]) -> Vec<(usize, f64)> {
        let of =
            |runs: &Vec<Vec<f64>>| pooled_quantile(chosen.iter().filter_map(|&run| runs.get(run)), SHARE);
        self.levels.iter().map(|(&level, runs)| (level, of(runs))).collect()
    }

    /// The level to try next: upwards in strides of `stride` levels until one fails, then one by one from the last that was
    /// survived to the first that is not. None where that is found, or `strongest` is survived.
    pub fn next_level(&self, stride: usize, strongest: usize) -> Option<usize> {
        let p90_m = self.p90_m();
        let survived = p90_m.iter().take_while(|(_, p90_m)| !fails(*p90_m)).last().map(|(level, _)| *level);
        let failed = p90_m.iter().find(|(_, p90_m)| fails(*p90_m)).map(|(level, _)| *level);
        match (survived, failed) {
            (None, None) => Some(0),
            (None, Some(_)) => None,
            (Some(survived), None) => (survived < strongest).then(|| (survived + stride).min(strongest)),
            (Some(survived), Some(failed)) => (survived + 1 < failed).then_some(survived + 1),
        }
    }

    /// The figures of these errors beside those of the fixed carrier.
    pub fn row(&self, fixed: &Self, scale: &Scale) -> Row {
        let p90_m = self.p90_m();
        let own = survived(&p90_m);
        let beyond = own.zip(survived(&fixed.p90_m())).map(|(own, fixed)| own - fixed);
        let beyond = beyond.filter(|_| self.controller != Controller::Fixed);
        let of_level = |level: usize, runs: &[Vec<f64>], p90_m: f64| {
            let scores: Vec<Score> =
                runs.iter().map(|errors_m| Score::new(errors_m.len(), errors_m, 0.0)).collect();
            let p90s_m = scores.iter().map(|score| score.p90_m.unwrap_or(f64::NAN));
            let seeds = scale.first_seed..;
            let power_db = level as f64 * scale.step_db;
            Level {
                power_db,
                median_sinr_db: (scale.median_sinr_db)(power_db),
                p90_m,
                p90_mean_m: p90s_m.sum::<f64>() / runs.len() as f64,
                diverged: seeds
                    .zip(&scores)
                    .filter(|(_, score)| score.diverged)
                    .map(|(seed, _)| seed)
                    .collect(),
            }
        };
        let survived_db = own.map(|levels| levels * scale.step_db);
        Row {
            name: self.controller.name(),
            survived_db,
            survived_median_sinr_db: survived_db.and_then(scale.median_sinr_db),
            first_failed_db: p90_m
                .iter()
                .find(|(_, p90_m)| fails(*p90_m))
                .map(|(level, _)| *level as f64 * scale.step_db),
            beyond_fixed_db: beyond.map(|levels| levels * scale.step_db),
            beyond_fixed_error_db: beyond
                .and_then(|_| self.beyond_error(fixed))
                .map(|levels| levels * scale.step_db),
            levels: self
                .levels
                .iter()
                .zip(&p90_m)
                .map(|((&level, runs), &(_, p90_m))| of_level(level, runs, p90_m))
                .collect(),
        }
    }

    /// Standard error of the levels survived beyond the fixed carrier; none for a single run.
    fn beyond_error(&self, fixed: &Self) -> Option<f64> {
        let runs = self.levels.values().next().map_or(0, Vec::len);
        if runs < 2 {
            return None;
        }
        let mut rng = Xoshiro128PlusPlus::seed_from_u64(1);
        let mut beyond = || {
            let chosen: Vec<usize> = (0..runs).map(|_| (uniform(&mut rng) * runs as f64) as usize).collect();
            // Within the levels tried: one that fails at once survives up to the weakest at most.
            let levels = |errors: &Self| survived(&errors.p90_of_m(&chosen)).unwrap_or(0.0);
            levels(self) - levels(fixed)
        };
        let values: Vec<f64> = (0..RESAMPLINGS).map(|_| beyond()).collect();
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        let squares: f64 = values.iter().map(|value| (value - mean) * (value - mean)).sum();
        Some((squares / (values.len() - 1) as f64).sqrt())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two runs of five cycles at every level, all with the same errors.
    fn errors(controller: Controller, p90_m: &[f64]) -> Errors {
        let level = |p90_m: &f64| vec![vec![*p90_m; 5]; 2];
        Errors { controller, levels: p90_m.iter().map(level).enumerate().collect() }
    }

    fn scale(step_db: f64) -> Scale<'static> {
        Scale { step_db, first_seed: 5, median_sinr_db: &|power_db| Some(-power_db) }
    }

    #[test]
    fn the_quantile_is_that_of_all_runs_together_and_not_the_mean_of_theirs() {
        // Together 1, 2, .. 11, of which the tenth; alone the eighth of 1 .. 9 (place 7.2 from 0), and 11 of two.
        let runs: [Vec<f64>; 2] = [(1..=9).map(f64::from).collect(), vec![11.0, 10.0]];
        assert!((pooled_quantile(runs.iter(), 0.9) - 10.0).abs() < 1e-12);
        let errors = Errors { controller: Controller::Greedy, levels: [(0, runs.into())].into() };
        let row = errors.row(&errors.clone(), &scale(1.0));
        assert!((row.levels[0].p90_m - 10.0).abs() < 1e-12);
        assert!((row.levels[0].p90_mean_m - 9.5).abs() < 1e-12);
        assert_eq!(row.levels[0].diverged, [5, 6]);
        assert_eq!((row.survived_db, row.first_failed_db), (None, Some(0.0)));
    }

    #[test]
    fn the_first_level_that_fails_counts() {
        let all = |p90_m: &[f64]| survived(&p90_m.iter().copied().enumerate().collect::<Vec<_>>());
        assert_eq!(all(&[0.1, 0.2, 0.29]), Some(2.0));
        assert_eq!((all(&[0.4, 0.1]), all(&[f64::NAN]), all(&[])), (None, None, None));
        // 0.3 is halfway between 0.1 and 0.9 on the logarithm.
        let crossed = all(&[0.05, 0.1, 0.9, 0.1, 0.9]).expect("the weakest is survived");
        assert!((crossed - 1.5).abs() < 1e-12, "{crossed}");
        let crossed = survived(&[(0, 0.05), (4, 0.1), (6, 0.9), (8, 0.9)]).expect("the weakest is survived");
        assert!((crossed - 5.0).abs() < 1e-12, "{crossed}");
        assert_eq!(all(&[0.1, f64::INFINITY]), Some(0.0));
        // The limit itself is no longer below it.
        assert!(fails(LIMIT_M) && fails(f64::NAN) && !fails(0.299));
    }

    #[test]
    fn strides_find_the_first_level_that_fails() {
        for (first_failed, tried) in [
            (0, vec![0]),
            (1, vec![0, 1, 4]),
            (4, vec![0, 1, 2, 3, 4]),
            (7, vec![0, 4, 5, 6, 7, 8]),
            (10, vec![0, 4, 8, 9, 10]),
            (11, vec![0, 4, 8, 10]),
        ] {
            let mut errors = Errors::new(Controller::Greedy);
            while let Some(level) = errors.next_level(4, 10) {
                let p90_m = if level < first_failed { 0.1 } else { 0.9 };
                assert!(errors.levels.insert(level, vec![vec![p90_m]]).is_none(), "level {level} twice");
            }
            let levels: Vec<usize> = errors.levels.keys().copied().collect();
            assert_eq!(levels, tried, "{first_failed}");
        }
    }

    #[test]
    fn what_is_survived_beyond_fixed_is_in_decibels() {
        let fixed = errors(Controller::Fixed, &[0.1, 0.9, 0.9]);
        let own = errors(Controller::Cognitive, &[0.1, 0.1, 0.1, 0.1, 0.9, 0.9]);
        let row = own.row(&fixed, &scale(0.5));
        assert!((row.beyond_fixed_db.expect("both survive something") - 1.5).abs() < 1e-12);
        assert!((row.survived_db.expect("some") - 1.75).abs() < 1e-12);
        assert!((row.survived_median_sinr_db.expect("some") + 1.75).abs() < 1e-12);
        assert_eq!(row.first_failed_db, Some(2.0));
        assert!((row.levels[3].power_db - 1.5).abs() < 1e-12);
        // All runs are alike: whichever are drawn, the figure is the same.
        assert!(row.beyond_fixed_error_db.expect("two runs") < 1e-12);
        assert_eq!(fixed.row(&fixed.clone(), &scale(0.5)).beyond_fixed_db, None);
    }
}
