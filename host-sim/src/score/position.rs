//! How far a track was from the truth.

use serde::Serialize;

/// An error above this, metres, counts towards divergence.
const LOST_M: f64 = 1.0;

/// Position errors of one run.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Score {
    /// Cycles run.
    pub cycles: usize,
    /// Cycles whose true position is known.
    pub scored: usize,
    /// Root mean square error, metres.
    pub rmse_m: Option<f64>,
    /// Median error, metres.
    pub p50_m: Option<f64>,
    /// 90 % quantile, metres.
    pub p90_m: Option<f64>,
    /// 95 % quantile, metres.
    pub p95_m: Option<f64>,
    /// Largest error, metres.
    pub max_m: Option<f64>,
    /// Above 1 m at the end, or for more than a tenth of the positions.
    pub diverged: bool,
    /// Mean time of the core per cycle, microseconds.
    pub us_per_cycle: f64,
}

impl Score {
    /// Scores the errors of a run of `cycles` cycles that took the core `seconds`.
    pub fn new(cycles: usize, errors_m: &[f64], seconds: f64) -> Self {
        let mut sorted = errors_m.to_vec();
        sorted.sort_by(f64::total_cmp);
        let quantile = |q: f64| {
            let last = sorted.len().checked_sub(1)?;
            sorted.get((q * last as f64).round() as usize).copied()
        };
        let squares: f64 = sorted.iter().map(|e| e * e).sum();
        // NaN counts as lost.
        let lost = |e: &f64| !(*e <= LOST_M);
        let lost_count = errors_m.iter().filter(|e| lost(e)).count();
        Self {
            cycles,
            scored: sorted.len(),
            rmse_m: (!sorted.is_empty()).then(|| (squares / sorted.len() as f64).sqrt()),
            p50_m: quantile(0.5),
            p90_m: quantile(0.9),
            p95_m: quantile(0.95),
            max_m: quantile(1.0),
            diverged: errors_m.last().is_some_and(lost) || lost_count * 10 > errors_m.len(),
            us_per_cycle: if cycles > 0 { seconds * 1e6 / cycles as f64 } else { 0.0 },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_quantiles_are_those_of_the_sorted_errors() {
        let errors: Vec<f64> = (0..=100).rev().map(|n| f64::from(n) / 200.0).collect();
        let score = Score::new(101, &errors, 0.0);
        assert_eq!((score.p50_m, score.p90_m, score.max_m), (Some(0.25), Some(0.45), Some(0.5)));
        assert!(!score.diverged);
    }

    #[test]
    fn a_run_lost_at_its_end_or_for_long_has_diverged() {
        assert!(Score::new(10, &[0.1, 0.1, 1.5], 0.0).diverged);
        assert!(Score::new(10, &[1.5, 1.5, 0.1, 0.1], 0.0).diverged);
        assert!(Score::new(2, &[0.1, f64::NAN], 0.0).diverged);
        assert!(!Score::new(0, &[], 0.0).diverged);
    }
}
