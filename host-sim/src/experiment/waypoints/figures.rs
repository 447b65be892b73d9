//! Figures of a comparison of waypoint choosers.

use super::{Chooser, Run, Walk};
use crate::experiment::over_runs::{mean, standard_error};
use serde::Serialize;

/// All choosers in one scenario.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Figures {
    /// The scenario's name.
    pub scenario: String,
    /// Runs per chooser.
    pub runs: usize,
    /// What the core's chooser gave for a nat, metres.
    pub metres_per_nat: f64,
    /// From start to goal, mean over the runs, metres.
    pub straight_m: f64,
    /// The choosers.
    pub choosers: Vec<Row>,
}

/// One chooser.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// Its name.
    pub name: &'static str,
    /// Root mean square error: over the cycles of each walk, then over the runs, metres.
    pub rmse_m: f64,
    /// Mean over the runs of the straight walk's root mean square error less its own, metres.
    pub rmse_gain_m: f64,
    /// Standard error of that over the runs, metres; 0 for one run.
    pub rmse_gain_error_m: f64,
    /// Mean over the runs of the 90 % quantile of the error, metres.
    pub p90_m: f64,
    /// Mean entropy of the position by the posterior bound of the way walked, nats.
    pub entropy_nat: f64,
    /// Mean over the runs of the straight walk's entropy less its own, nats.
    pub entropy_gain_nat: f64,
    /// Standard error of that over the runs, nats; 0 for one run.
    pub entropy_gain_error_nat: f64,
    /// Mean length of the way walked, metres.
    pub path_m: f64,
    /// Runs that stopped of themselves, at the goal.
    pub arrivals: usize,
    /// Seeds of the runs that lost the tag.
    pub diverged: Vec<u64>,
    /// Runs.
    pub runs: usize,
}

impl Figures {
    /// Of these runs.
    pub fn new(scenario: &str, metres_per_nat: f64, runs: &[Run]) -> Self {
        Self {
            scenario: scenario.into(),
            runs: runs.len(),
            metres_per_nat,
            straight_m: mean(&runs.iter().map(|run| run.straight_m).collect::<Vec<_>>()),
            choosers: Chooser::ALL.map(|chooser| row(chooser, runs)).into(),
        }
    }
}

fn row(chooser: Chooser, runs: &[Run]) -> Row {
    let walks = |of: Chooser| -> Vec<&Walk> {
        runs.iter().filter_map(|run| run.walks.iter().find(|walk| walk.chooser == of)).collect()
    };
    let (own, straight) = (walks(chooser), walks(Chooser::Straight));
    let all = |figure: fn(&Walk) -> f64| -> Vec<f64> { own.iter().map(|walk| figure(walk)).collect() };
    let gains = |figure: fn(&Walk) -> f64| -> Vec<f64> {
        straight.iter().zip(&own).map(|(straight, own)| figure(straight) - figure(own)).collect()
    };
    let rmse = |walk: &Walk| walk.score.rmse_m.unwrap_or(f64::NAN);
    let (rmse_gains, entropy_gains) = (gains(rmse), gains(|walk| walk.entropy_nat));
    Row {
        name: chooser.name(),
        rmse_m: mean(&all(|walk| walk.score.rmse_m.map_or(f64::NAN, |rmse| rmse * rmse))).sqrt(),
        rmse_gain_m: mean(&rmse_gains),
        rmse_gain_error_m: standard_error(&rmse_gains),
        p90_m: mean(&all(|walk| walk.score.p90_m.unwrap_or(f64::NAN))),
        entropy_nat: mean(&all(|walk| walk.entropy_nat)),
        entropy_gain_nat: mean(&entropy_gains),
        entropy_gain_error_nat: standard_error(&entropy_gains),
        path_m: mean(&all(|walk| walk.path_m)),
        arrivals: own.iter().filter(|walk| walk.arrived).count(),
        diverged: runs
            .iter()
            .zip(&own)
            .filter(|(_, walk)| walk.score.diverged)
            .map(|(run, _)| run.seed)
            .collect(),
        runs: own.len(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::score::Score;

    #[test]
    fn gains_are_paired_by_run() {
        let walk = |chooser, error_m: f64, entropy_nat, arrived| Walk {
            chooser,
            score: Score::new(2, &[error_m, error_m], 0.0),
            entropy_nat,
            path_m: 7.0,
            arrived,
        };
        let run = |seed, level: f64| Run {
            seed,
            straight_m: 5.0,
            walks: vec![
                walk(Chooser::Straight, 0.1 * level, -level, true),
                walk(Chooser::Random, 3.0, 0.0, false),
                walk(Chooser::Informed, 0.1 * level - 0.02, -level - 0.5, true),
            ],
        };
        let figures = Figures::new("room", 1.0, &[run(1, 1.0), run(2, 4.0)]);
        let [straight, random, informed] = &figures.choosers[..] else { panic!("three rows") };
        assert_eq!((straight.entropy_gain_nat, straight.rmse_gain_m), (0.0, 0.0));
        assert!((straight.rmse_m - 0.085_f64.sqrt()).abs() < 1e-12);
        assert!((informed.entropy_gain_nat - 0.5).abs() < 1e-12 && informed.entropy_gain_error_nat < 1e-12);
        assert!((informed.rmse_gain_m - 0.02).abs() < 1e-12 && informed.rmse_gain_error_m < 1e-12);
        assert!((random.entropy_gain_error_nat - 1.5).abs() < 1e-12);
        assert_eq!((random.diverged.as_slice(), random.arrivals), ([1, 2].as_slice(), 0));
        assert_eq!((informed.arrivals, informed.runs), (2, 2));
    }
}
