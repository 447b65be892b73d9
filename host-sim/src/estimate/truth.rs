//! Estimated paths against true ones.

use super::link::AgainstTruth;
use super::spread::{Spread, quantile};
use super::{EstimatedFrame, EstimatedPath};
use crate::recording::{Recording, TruthPath};

/// True paths above this SINR are counted by themselves, decibels: below, an estimator with few false paths must miss
/// some.
pub(super) const STRONG_DB: f64 = 12.0;
/// True paths above this SINR tell something of a place, and are counted by themselves, decibels.
pub(super) const TELLING_DB: f64 = 9.0;
/// A path that is found stands for a true one above this SINR, decibels: one that is weaker is noise.
pub(super) const THERE_DB: f64 = -3.0;

/// What became of the true paths of one frame, and of the estimated ones.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Matches {
    /// True paths inside the frame, and how many of them were found.
    pub paths: usize,
    pub found: usize,
    /// The same for the strong ones.
    pub strong: usize,
    pub strong_found: usize,
    /// The same for those that tell something.
    pub telling: usize,
    pub telling_found: usize,
    /// Estimated paths that are no true one.
    pub false_paths: usize,
    /// Those that are farther than a pulse duration from every true one that is there.
    pub far_false_paths: usize,
    /// Estimated minus true delay of each path found, seconds.
    pub errors_s: Vec<f64>,
}

impl Matches {
    fn add(&mut self, other: Self) {
        self.paths += other.paths;
        self.found += other.found;
        self.strong += other.strong;
        self.strong_found += other.strong_found;
        self.telling += other.telling;
        self.telling_found += other.telling_found;
        self.false_paths += other.false_paths;
        self.far_false_paths += other.far_false_paths;
        self.errors_s.extend(other.errors_s);
    }
}

/// Pairs each true path, the strongest first, with the nearest estimated path not taken yet, if that is within
/// half a pulse duration.
pub(super) fn matches<'a>(
    truth: impl Iterator<Item = &'a TruthPath>,
    estimated: &[EstimatedPath],
    pulse_s: f64,
) -> Matches {
    let mut truth: Vec<&TruthPath> = truth.collect();
    truth.sort_by(|a, b| b.sinr.total_cmp(&a.sinr));
    let mut free: Vec<f64> = estimated.iter().map(|path| path.delay_s).collect();
    let mut outcome = Matches::default();
    let is_far = |path: &&EstimatedPath| {
        let there = |other: &&&TruthPath| 10.0 * other.sinr.log10() > THERE_DB;
        truth.iter().filter(there).all(|other| (path.delay_s - other.delay_s).abs() > pulse_s)
    };
    outcome.far_false_paths = estimated.iter().filter(is_far).count();
    for path in truth {
        let sinr_db = 10.0 * path.sinr.log10();
        let (strong, telling) = (sinr_db >= STRONG_DB, sinr_db >= TELLING_DB);
        outcome.paths += 1;
        outcome.strong += usize::from(strong);
        outcome.telling += usize::from(telling);
        let apart = |delay_s: &f64| (delay_s - path.delay_s).abs();
        let nearest = (0..free.len()).min_by(|&a, &b| apart(&free[a]).total_cmp(&apart(&free[b])));
        if let Some(nearest) = nearest.filter(|&nearest| apart(&free[nearest]) < 0.5 * pulse_s) {
            outcome.errors_s.push(free.swap_remove(nearest) - path.delay_s);
            outcome.found += 1;
            outcome.strong_found += usize::from(strong);
            outcome.telling_found += usize::from(telling);
        }
    }
    outcome.false_paths = free.len();
    outcome
}

/// Frames of any recordings against the true paths.
#[derive(Clone, Debug, Default)]
pub struct Tally {
    matches: Matches,
    frames: usize,
    level_ratios: Vec<f64>,
}

impl Tally {
    /// Adds frames of `recording`; nothing where it holds no true paths.
    pub fn add<'a>(&mut self, recording: &Recording, frames: impl IntoIterator<Item = &'a EstimatedFrame>) {
        let Some(spacing_s) = recording.radio.sample_spacing_s else { return };
        if recording.cycles.iter().all(|cycle| cycle.truth_paths.is_empty()) {
            return;
        }
        for frame in frames {
            let cycle = &recording.cycles[frame.cycle];
            let Some(raw) = cycle.frames.iter().find(|raw| raw.anchor == frame.anchor) else { continue };
            let end_s = raw.first_sample_delay_s + raw.samples.len() as f64 * spacing_s;
            let inside = |delay_s: f64| (raw.first_sample_delay_s..end_s).contains(&delay_s);
            let own = |path: &&TruthPath| path.anchor == frame.anchor && inside(path.delay_s);
            let pulse_s = recording.actions[raw.action].pulse_duration_s;
            let outcome = matches(cycle.truth_paths.iter().filter(own), &frame.paths, pulse_s);
            self.matches.add(outcome);
            self.level_ratios.extend_from_slice(&frame.level_ratios);
            self.frames += 1;
        }
    }

    /// The figures of all frames; none where no true path was known.
    pub fn figures(&self) -> Option<AgainstTruth> {
        let all = &self.matches;
        let share = |part: usize, whole: usize| (whole > 0).then(|| part as f64 / whole as f64);
        let rate = |part: usize| part as f64 / self.frames as f64;
        (self.frames > 0).then(|| AgainstTruth {
            paths: all.paths,
            detected_share: share(all.found, all.paths),
            detected_share_above_9_db: share(all.telling_found, all.telling),
            detected_share_above_12_db: share(all.strong_found, all.strong),
            false_paths_per_frame: rate(all.false_paths),
            far_false_paths_per_frame: rate(all.far_false_paths),
            level_ratio_median: quantile(&self.level_ratios, 0.5),
            level_ratio_95: quantile(&self.level_ratios, 0.95),
            delay_rmse_s: Spread::of(all.errors_s.iter().copied()).map(|spread| spread.rms),
        })
    }
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
        let found = matches(truth.iter(), &estimated, 1e-9);
        assert_eq!((found.paths, found.found), (4, 2));
        assert_eq!((found.strong, found.strong_found), (3, 1));
        assert_eq!((found.telling, found.telling_found), (3, 1));
        assert_eq!((found.false_paths, found.far_false_paths), (1, 1));
        assert!((found.errors_s[0] - 0.1e-9).abs() < 1e-15 && (found.errors_s[1] - 0.3e-9).abs() < 1e-15);
    }

    /// The meter bites: paths moved off, a level that is too high, and a path that is noise are seen as such.
    #[test]
    fn a_planted_failure_shows() {
        let truth = [(10e-9, 100.0), (20e-9, 10.0), (40e-9, 0.4)].map(|(delay_s, sinr)| TruthPath {
            anchor: 0,
            virtual_anchor: None,
            delay_s,
            magnitude: 1.0,
            sinr,
        });
        let found = |delays_s: &[f64]| {
            let path = |&delay_s: &f64| EstimatedPath {
                delay_s,
                range_m: 0.0,
                delay_std_s: 0.0,
                amplitude: [1.0, 0.0],
                sinr_db: 20.0,
            };
            matches(truth.iter(), &delays_s.iter().map(path).collect::<Vec<_>>(), 1e-9)
        };
        let good = found(&[10.1e-9, 20.1e-9]);
        assert_eq!((good.telling_found, good.far_false_paths), (2, 0));
        // Within a pulse duration of a true path, but not where it is: not found, and yet no noise.
        let beside = found(&[10.7e-9, 20.7e-9]);
        assert_eq!((beside.telling_found, beside.false_paths, beside.far_false_paths), (0, 2, 0));
        let off = found(&[11.5e-9, 21.5e-9]);
        assert_eq!((off.telling_found, off.far_false_paths), (0, 2));
        // Where the true path is too weak to be seen, what is found is noise.
        assert_eq!(found(&[40.1e-9]).far_false_paths, 1);
    }
}
