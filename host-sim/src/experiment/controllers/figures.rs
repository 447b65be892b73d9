//! Figures of a comparison of controllers.

use super::onset::{Answer, answers, slowest};
use super::{Comparison, Controller, Run};
use crate::experiment::over_runs::{mean, standard_error};
use serde::Serialize;

/// All controllers in one scenario.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Figures {
    /// The scenario's name.
    pub scenario: String,
    /// Runs per controller.
    pub runs: usize,
    /// Cycles that gains are means over: those under interference where there is any, else all.
    pub judged_cycles: [usize; 2],
    /// The controllers.
    pub controllers: Vec<Row>,
}

/// One controller.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// Its name.
    pub name: &'static str,
    /// Whether its memory was told the SINR of every carrier, which no radio can know.
    pub full_band: bool,
    /// Mean over the judged cycles and runs of the entropy of the fixed carrier less its own, nats.
    pub information_gain_nat: f64,
    /// Standard error of that over the runs, nats; 0 for one run.
    pub information_gain_error_nat: f64,
    /// The same over all cycles, nats.
    pub information_gain_all_nat: f64,
    /// Its gain over the genie's.
    pub fraction_of_genie: f64,
    /// Root mean square error over all runs, metres.
    pub rmse_m: f64,
    /// Mean over the runs of the 90 % quantile of the error, metres.
    pub p90_m: f64,
    /// Runs that lost the tag.
    pub diverged: usize,
    /// Their seeds.
    pub diverged_seeds: Vec<u64>,
    /// Runs.
    pub runs: usize,
    /// Changes of the action per cycle.
    pub switches_per_cycle: f64,
    /// The slowest of `onsets`, cycles; none where one was never answered, or without interference.
    pub cycles_to_90_percent: Option<usize>,
    /// How soon it had reached 90 % of the reachable gain after each onset of interference.
    pub onsets: Vec<Answer>,
}

impl Figures {
    /// Of these runs, which must all have the same controllers.
    pub fn new(scenario: &str, comparisons: &[Comparison]) -> Self {
        let names: Vec<Controller> = comparisons
            .first()
            .map_or(Vec::new(), |first| first.runs.iter().map(|run| run.controller).collect());
        let rows: Vec<Row> = names.iter().map(|&controller| row(controller, comparisons)).collect();
        let genie = rows.iter().find(|row| row.name == Controller::Genie.name());
        let genie_nat = genie.map_or(f64::NAN, |row| row.information_gain_nat);
        let judged = comparisons.first().map_or(0..0, Comparison::judged);
        Self {
            scenario: scenario.into(),
            runs: comparisons.len(),
            judged_cycles: [judged.start, judged.end],
            controllers: rows
                .into_iter()
                .map(|row| Row { fraction_of_genie: share(row.information_gain_nat, genie_nat), ..row })
                .collect(),
        }
    }
}

impl Comparison {
    /// The cycles that count.
    fn judged(&self) -> std::ops::Range<usize> {
        let cycles = self.runs.first().map_or(0, |run| run.actions.len());
        if self.interfered.is_empty() { 0..cycles } else { self.interfered.clone() }
    }

    /// The run of one controller.
    pub fn of(&self, controller: Controller) -> Option<&Run> {
        self.runs.iter().find(|run| run.controller == controller)
    }

    /// Entropy of the fixed carrier less that of a controller, cycle by cycle.
    fn gains_nat(&self, controller: Controller) -> Vec<f64> {
        let (Some(fixed), Some(run)) = (self.of(Controller::Fixed), self.of(controller)) else {
            return Vec::new();
        };
        fixed.entropies_nat.iter().zip(&run.entropies_nat).map(|(fixed, own)| fixed - own).collect()
    }
}

/// What a gain is of the genie's; not a number where the genie has nothing to gain.
fn share(gain_nat: f64, genie_nat: f64) -> f64 {
    if genie_nat > 1e-9 { gain_nat / genie_nat } else { f64::NAN }
}

fn row(controller: Controller, comparisons: &[Comparison]) -> Row {
    let own = || comparisons.iter().filter_map(|comparison| Some((comparison, comparison.of(controller)?)));
    let runs = own().count();
    let gains: Vec<Vec<f64>> = comparisons.iter().map(|one| one.gains_nat(controller)).collect();
    let judged: Vec<f64> =
        gains.iter().zip(comparisons).map(|(gains, one)| mean(&gains[one.judged()])).collect();
    let all: Vec<f64> = gains.iter().map(|gains| mean(gains)).collect();
    let errors = own().filter_map(|(_, run)| Some((run.score.rmse_m?, run.score.p90_m?)));
    let (rmse_m, p90_m): (Vec<f64>, Vec<f64>) = errors.unzip();
    let switches = own().map(|(_, run)| {
        let switches = run.actions.windows(2).filter(|pair| pair[0] != pair[1]).count();
        switches as f64 / run.actions.len().max(1) as f64
    });
    let onsets = answers(controller, comparisons);
    Row {
        name: controller.name(),
        full_band: controller == Controller::FullBand,
        information_gain_nat: mean(&judged),
        information_gain_error_nat: standard_error(&judged),
        information_gain_all_nat: mean(&all),
        fraction_of_genie: f64::NAN,
        rmse_m: mean(&rmse_m.iter().map(|rmse| rmse * rmse).collect::<Vec<_>>()).sqrt(),
        p90_m: mean(&p90_m),
        diverged: own().filter(|(_, run)| run.score.diverged).count(),
        diverged_seeds: own().filter(|(_, run)| run.score.diverged).map(|(one, _)| one.seed).collect(),
        runs,
        switches_per_cycle: mean(&switches.collect::<Vec<_>>()),
        cycles_to_90_percent: slowest(&onsets),
        onsets,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::experiment::controllers::onset::Onset;
    use crate::score::Score;

    /// Twenty cycles, ten of them under interference; entropies by cycle.
    fn run(controller: Controller, entropy_nat: impl Fn(usize) -> f64) -> Run {
        Run {
            controller,
            actions: (0..20).map(|cycle| vec![cycle / 10]).collect(),
            entropies_nat: (0..20).map(entropy_nat).collect(),
            score: Score::new(20, &[0.3, 0.4], 0.0),
        }
    }

    #[test]
    fn gains_count_under_interference_and_are_reached_when_the_mean_of_five_is() {
        let comparison = Comparison {
            seed: 7,
            interfered: 10..20,
            watched: None,
            onsets: vec![Onset { cycle: 10, until: 20, hits: vec![true, true], held_nat: vec![-1.0; 20] }],
            runs: vec![
                run(Controller::Fixed, |_| -1.0),
                run(Controller::Greedy, |cycle| if cycle < 13 { -1.0 } else { -5.0 }),
                run(Controller::Genie, |cycle| if cycle < 10 { -2.0 } else { -5.0 }),
            ],
        };
        let figures = Figures::new("room", &[comparison.clone(), comparison]);
        assert_eq!((figures.runs, figures.judged_cycles), (2, [10, 20]));
        let [fixed, greedy, genie] = &figures.controllers[..] else { panic!("three rows") };
        assert_eq!((fixed.information_gain_nat, fixed.fraction_of_genie), (0.0, 0.0));
        assert!((greedy.information_gain_nat - 2.8).abs() < 1e-12);
        assert!((greedy.information_gain_all_nat - 1.4).abs() < 1e-12);
        assert!((greedy.fraction_of_genie - 0.7).abs() < 1e-12 && greedy.information_gain_error_nat < 1e-12);
        assert_eq!((greedy.cycles_to_90_percent, genie.cycles_to_90_percent), (Some(3), Some(0)));
        assert!((greedy.switches_per_cycle - 0.05).abs() < 1e-12);
        assert!((greedy.rmse_m - 0.125_f64.sqrt()).abs() < 1e-12 && greedy.diverged == 0);
    }
}
