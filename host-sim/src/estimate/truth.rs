//! Estimated paths against true ones.

use super::EstimatedPath;
use crate::recording::TruthPath;

/// True paths above this SINR are counted by themselves, decibels: below, an estimator with few false paths must miss
/// some.
pub(super) const STRONG_DB: f64 = 12.0;

/// What became of the true paths of one frame, and of the estimated ones.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Matches {
    /// True paths inside the frame, and how many of them were found.
    pub paths: usize,
    pub found: usize,
    /// The same for the strong ones.
    pub strong: usize,
    pub strong_found: usize,
    /// Estimated paths that are no true one.
    pub false_paths: usize,
    /// Estimated minus true delay of each path found, seconds.
    pub errors_s: Vec<f64>,
}

/// Pairs each true path, the strongest first, with the nearest estimated path not taken yet, if that is within
/// `within_s`.
pub(super) fn matches<'a>(
    truth: impl Iterator<Item = &'a TruthPath>,
    estimated: &[EstimatedPath],
    within_s: f64,
) -> Matches {
    let mut truth: Vec<&TruthPath> = truth.collect();
    truth.sort_by(|a, b| b.sinr.total_cmp(&a.sinr));
    let mut free: Vec<f64> = estimated.iter().map(|path| path.delay_s).collect();
    let mut outcome = Matches::default();
    for path in truth {
        let strong = 10.0 * path.sinr.log10() >= STRONG_DB;
        outcome.paths += 1;
        outcome.strong += usize::from(strong);
        let apart = |delay_s: &f64| (delay_s - path.delay_s).abs();
        let nearest = (0..free.len()).min_by(|&a, &b| apart(&free[a]).total_cmp(&apart(&free[b])));
        if let Some(nearest) = nearest.filter(|&nearest| apart(&free[nearest]) < within_s) {
            outcome.errors_s.push(free.swap_remove(nearest) - path.delay_s);
            outcome.found += 1;
            outcome.strong_found += usize::from(strong);
        }
    }
    outcome.false_paths = free.len();
    outcome
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_estimated_path_is_one_true_path_at_most() {
        let truth = [(10e-9, 100.0), (10.2e-9, 30.0), (40e-9, 2.0), (60e-9, 50.0)].map(|(delay_s, sinr)| {
            TruthPath { anchor: 0, virtual_anchor: None, delay_s, magnitude: 1.0, sinr }
        });
        let estimated = [10.1e-9, 40.3e-9, 90e-9].map(|delay_s| EstimatedPath {
            delay_s,
            range_m: 0.0,
            delay_std_s: 0.0,
            amplitude: [1.0, 0.0],
            sinr_db: 20.0,
        });
        let found = matches(truth.iter(), &estimated, 0.5e-9);
        assert_eq!((found.paths, found.found), (4, 2));
        assert_eq!((found.strong, found.strong_found), (3, 1));
        assert_eq!(found.false_paths, 1);
        assert!((found.errors_s[0] - 0.1e-9).abs() < 1e-15 && (found.errors_s[1] - 0.3e-9).abs() < 1e-15);
    }
}
