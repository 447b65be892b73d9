//! What many runs of one scenario come to.

use crate::experiment::over_runs::mean_of;
use crate::replay::TrackerVariant;
use crate::score::Score;
use crate::score::consistency::Consistency;
use crate::score::map::MapScore;
use serde::Serialize;

/// What one run came to.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// Its seed.
    pub seed: u64,
    /// How far the track was from the truth.
    pub score: Score,
    /// How good the map was at the end.
    pub map: MapScore,
    /// Whether the filter knew how wrong it was.
    pub consistency: Consistency,
    /// Cycles whose observations the core refused.
    pub refused: usize,
    /// Where a bound is known.
    pub against_bound: Option<AgainstBound>,
}

/// Squared errors beside their bound, over the cycles of a run.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AgainstBound {
    /// Sum of the squared position errors, m^2.
    pub squares_m2: f64,
    /// Sum of the traces of the posterior bound of the position, m^2.
    pub bounds_m2: f64,
}

/// The figures of a scenario. Means over runs, where nothing else is said; none where nothing is known.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Figures {
    /// The scenario, or the recording's name.
    pub scenario: String,
    /// The variant of the tracker, by name.
    pub variant: &'static str,
    /// Runs.
    pub runs: usize,
    /// Root mean square error of the position, metres.
    pub rmse_m: Option<f64>,
    /// The median run's, metres.
    pub rmse_median_m: Option<f64>,
    /// The worst run's, metres.
    pub rmse_worst_m: Option<f64>,
    /// The 95 % quantile of the errors in the run in which it is largest, metres.
    pub p95_worst_m: Option<f64>,
    /// Seeds of the runs that diverged.
    pub diverged: Vec<u64>,
    /// Normalised estimation error squared of the position, per degree of freedom.
    pub nees: Option<f64>,
    /// Share of the cycles whose true position lies within the 95 % ellipse.
    pub nees_within_95: Option<f64>,
    /// Normalised innovation squared.
    pub nis: Option<f64>,
    /// OSPA distance of the map at the end, cut-off 1 m, metres.
    pub ospa_m: Option<f64>,
    /// Virtual anchors that are there and could have been seen.
    pub virtual_anchors_true: Option<f64>,
    /// Virtual anchors in the map at the end.
    pub virtual_anchors_found: f64,
    /// Those of them that are none.
    pub virtual_anchors_spurious: Option<f64>,
    /// Root mean square of the errors of all cycles and runs over that of the posterior Cramer-Rao bound of a tracker
    /// that knows the true map.
    pub rmse_over_posterior_crlb: Option<f64>,
    /// Root mean square of that bound, metres.
    pub posterior_crlb_m: Option<f64>,
    /// Cycles whose observations the core refused, in all runs together.
    pub refused_cycles: usize,
    /// Time of the core per cycle on this machine, microseconds.
    pub us_per_cycle: f64,
}

impl Figures {
    /// Sums up the runs of a variant through a scenario.
    pub fn new(scenario: &str, variant: TrackerVariant, outcomes: &[Outcome]) -> Self {
        let each = |figure: fn(&Outcome) -> Option<f64>| -> Vec<f64> {
            let mut values: Vec<f64> = outcomes.iter().filter_map(figure).collect();
            values.sort_by(f64::total_cmp);
            values
        };
        let average = |figure| mean_of(each(figure).into_iter());
        let rmse_m = each(|run| run.score.rmse_m);
        let bound = outcomes.iter().filter_map(|run| run.against_bound).reduce(|a, b| AgainstBound {
            squares_m2: a.squares_m2 + b.squares_m2,
            bounds_m2: a.bounds_m2 + b.bounds_m2,
        });
        let cycles: usize =
            outcomes.iter().filter(|run| run.against_bound.is_some()).map(|run| run.score.scored).sum();
        Self {
            scenario: scenario.into(),
            variant: variant.name(),
            runs: outcomes.len(),
            rmse_m: mean_of(rmse_m.iter().copied()),
            rmse_median_m: median(&rmse_m),
            rmse_worst_m: rmse_m.last().copied(),
            p95_worst_m: each(|run| run.score.p95_m).last().copied(),
            diverged: outcomes.iter().filter(|run| run.score.diverged).map(|run| run.seed).collect(),
            nees: average(|run| run.consistency.nees),
            nees_within_95: average(|run| run.consistency.nees_within_95),
            nis: average(|run| run.consistency.nis),
            ospa_m: average(|run| run.map.ospa_m),
            virtual_anchors_true: average(|run| run.map.truth.map(|count| count as f64)),
            virtual_anchors_found: average(|run| Some(run.map.found as f64)).unwrap_or(0.0),
            virtual_anchors_spurious: average(|run| run.map.spurious.map(|count| count as f64)),
            rmse_over_posterior_crlb: bound.map(|sums| (sums.squares_m2 / sums.bounds_m2).sqrt()),
            posterior_crlb_m: bound.map(|sums| (sums.bounds_m2 / cycles as f64).sqrt()),
            refused_cycles: outcomes.iter().map(|run| run.refused).sum(),
            us_per_cycle: average(|run| Some(run.score.us_per_cycle)).unwrap_or(0.0),
        }
    }
}

/// Of sorted values.
fn median(sorted: &[f64]) -> Option<f64> {
    let upper = *sorted.get(sorted.len() / 2)?;
    let lower = *sorted.get((sorted.len() - 1) / 2)?;
    Some(0.5 * (lower + upper))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn outcome(seed: u64, errors_m: &[f64], bounds_m2: f64) -> Outcome {
        Outcome {
            seed,
            score: Score::new(errors_m.len(), errors_m, 1e-6 * seed as f64 * errors_m.len() as f64),
            map: MapScore::default(),
            consistency: Consistency::default(),
            refused: 1,
            against_bound: Some(AgainstBound {
                squares_m2: errors_m.iter().map(|error| error * error).sum(),
                bounds_m2,
            }),
        }
    }

    #[test]
    fn runs_are_summed_up_as_their_names_say() {
        let runs = [
            outcome(4, &[0.3, 0.3], 0.01),
            outcome(5, &[0.1, 0.1], 0.01),
            outcome(6, &[2.0, 2.0], 0.03),
            outcome(7, &[0.1, 0.1], 0.03),
        ];
        let figures = Figures::new("any", TrackerVariant::default(), &runs);
        let near = |value: Option<f64>, expected: f64| {
            assert!(value.is_some_and(|value| (value - expected).abs() < 1e-12), "{value:?}, not {expected}");
        };
        near(figures.rmse_m, 0.625);
        near(figures.rmse_median_m, 0.2);
        near(figures.rmse_worst_m, 2.0);
        near(figures.p95_worst_m, 2.0);
        assert_eq!(figures.diverged, vec![6]);
        // 8.22 m^2 of error where 0.08 m^2 are the bound, over 8 cycles.
        near(figures.rmse_over_posterior_crlb, (8.22_f64 / 0.08).sqrt());
        near(figures.posterior_crlb_m, 0.1);
        near(Some(figures.us_per_cycle), 5.5);
        assert_eq!((figures.runs, figures.refused_cycles, figures.ospa_m), (4, 4, None));
        assert_eq!(Figures::new("none", TrackerVariant::default(), &[]).rmse_median_m, None);
    }
}
