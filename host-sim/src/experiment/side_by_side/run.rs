//! One tracker in one room: how far off it was, what it claimed, what it said.

use crate::score::Score;
use crate::score::consistency::{CHI_SQUARE_95, normalised_square};
use crate::trackers::Estimate;
use serde::Serialize;

/// Where the start is anywhere, this long is left out of errors and of losses, seconds.
const SETTLING_S: f64 = 5.0;
/// A confident lie: an error above this, metres, with a claimed deviation below [`SMALL_CLAIM_M`].
const LARGE_ERROR_M: f64 = 1.0;
/// See [`LARGE_ERROR_M`].
const SMALL_CLAIM_M: f64 = 0.2;

/// A claim is right where the error is below the larger of 1 m and so many claimed deviations.
const CLAIM_DEVIATIONS: f64 = 3.0;
/// A tracker that says that it knows where the tag is with more than this probability.
const SURE: f64 = 0.9;

/// What of a run is judged.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Judging {
    /// Whether the tag may start anywhere: the first 5 s are left out of errors and of losses.
    pub starts_anywhere: bool,
    /// From when to when nothing of the tag is heard, seconds on the clock of the cycles.
    pub unheard_s: Option<[f64; 2]>,
    /// Whether the tag could be kept, where that is known before: see [`super::SideBySide::answerable`].
    pub answerable: Option<bool>,
}

/// While nothing of the tag was heard, and after it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Unheard {
    /// Share of those cycles that are confident lies; none where there was no cycle.
    pub unheard_lies: Option<f64>,
    /// Share of them with an error above 3 claimed deviations.
    pub unheard_above_3_sigma: Option<f64>,
    /// When the tag was found again: the first error below 1 m, without a search, seconds after it was heard again; none: never.
    pub found_s: Option<f64>,
    /// How long it was heard again, seconds.
    pub heard_again_s: f64,
}

/// A cycle with the truth beside what a tracker believed.
#[derive(Clone, Copy, Debug)]
pub struct Judged {
    /// Time since the first cycle, seconds.
    pub time_s: f64,
    /// The true position, metres.
    pub truth_m: [f64; 2],
    /// The least root mean square error that the frames allow, metres.
    pub bound_m: f64,
    /// What the tracker believed.
    pub estimate: Estimate,
}

/// Figures of one tracker in one room.
///
/// Errors, `lost` and the ratio to the bound leave out the first 5 s where the start is anywhere; everything else counts
/// all cycles. The claimed deviation is sqrt((cxx + cyy) / 2).
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Run {
    /// Name of the tracker.
    pub tracker: &'static str,
    /// Error above 1 m at the end, or in over a tenth of the cycles, searching or not.
    pub lost: bool,
    /// Root mean square error, metres; none where an error is not a number.
    pub rmse_m: Option<f64>,
    /// 95 % quantile of the error, metres.
    pub p95_m: Option<f64>,
    /// RMSE over the root mean square of the bound; none where the bound is unbounded.
    pub ratio_to_bound: Option<f64>,
    /// RMSE over that of `told` in the same room; none where `told` did not run.
    pub ratio_to_told: Option<f64>,
    /// Mean of e' C^-1 e / 2 with the error e and the claimed covariance C: 1 is honest; none where C is no covariance.
    pub nees: Option<f64>,
    /// Share of cycles with an error above 1 m, a claimed deviation below 0.2 m, and no search.
    pub confident_lies: f64,
    /// Share of cycles in which it said that it does not know where the tag is.
    pub searching: f64,
    /// Share of cycles with the truth inside the claimed 95 % ellipse.
    pub inside_95: f64,
    /// Share of cycles with an error above 5 claimed deviations.
    pub above_5_sigma: f64,
    /// When it first said that it knows where the tag is, seconds after the first cycle; none: never.
    pub first_known_s: Option<f64>,
    /// How often it said that it lost the tag: searches begun after it was known.
    pub losses_said: usize,
    /// Error at the end, metres; none where it is not a number.
    pub end_error_m: Option<f64>,
    /// Of the cycles with a probability above 0.9, the share with an error below 1 m or 3 claimed deviations, whichever is
    /// more; none without such a cycle.
    pub sure_right: Option<f64>,
    /// Number of those cycles.
    pub sure_cycles: usize,
    /// While nothing of the tag was heard; none where there is no such time.
    #[serde(flatten)]
    pub unheard: Option<Unheard>,
}

impl Run {
    /// The figures of a tracker over the cycles of a room, of which there must be one at least. Where the start is anywhere
    /// and the whole run is shorter than 5 s, nothing is left out.
    pub fn new(tracker: &'static str, cycles: &[Judged], judging: &Judging) -> Self {
        let lasts = |time_s: f64| cycles.last().is_some_and(|last| last.time_s >= time_s);
        let settled_s = if judging.starts_anywhere && lasts(SETTLING_S) { SETTLING_S } else { 0.0 };
        let settled: Vec<&Judged> = cycles.iter().filter(|cycle| cycle.time_s >= settled_s).collect();
        let errors_m: Vec<f64> = settled.iter().map(|cycle| cycle.error_m()).collect();
        let score = Score::new(errors_m.len(), &errors_m, 0.0);
        let bound_m2: f64 = settled.iter().map(|cycle| cycle.bound_m * cycle.bound_m).sum();
        let bound_m = (bound_m2 / settled.len() as f64).sqrt();
        let share = |is: &dyn Fn(&Judged) -> bool| {
            cycles.iter().filter(|cycle| is(cycle)).count() as f64 / cycles.len() as f64
        };
        let finite = |value: f64| value.is_finite().then_some(value);
        let rmse_m = score.rmse_m.and_then(finite);
        let squares: f64 = cycles.iter().map(Judged::normalised_square).sum();
        let sure: Vec<&Judged> =
            cycles.iter().filter(|cycle| cycle.estimate.probability > Some(SURE)).collect();
        let searching = cycles.iter().map(|cycle| cycle.estimate.searching);
        Self {
            tracker,
            lost: score.diverged,
            rmse_m,
            p95_m: score.p95_m.and_then(finite),
            ratio_to_bound: rmse_m.and_then(|rmse_m| finite(rmse_m / bound_m).filter(|_| bound_m > 0.0)),
            ratio_to_told: None,
            nees: finite(0.5 * squares / cycles.len() as f64),
            confident_lies: share(&Judged::is_confident_lie),
            searching: share(&|cycle| cycle.estimate.searching),
            inside_95: share(&|cycle| cycle.normalised_square() <= CHI_SQUARE_95),
            above_5_sigma: share(&|cycle| !(cycle.error_m() <= 5.0 * cycle.claimed_m())),
            first_known_s: cycles.iter().find(|cycle| !cycle.estimate.searching).map(|cycle| cycle.time_s),
            losses_said: searching
                .clone()
                .zip(searching.skip(1))
                .filter(|&(before, now)| !before && now)
                .count(),
            end_error_m: cycles.last().map(Judged::error_m).and_then(finite),
            sure_right: share_of(&sure, |cycle| {
                cycle.error_m() <= LARGE_ERROR_M.max(CLAIM_DEVIATIONS * cycle.claimed_m())
            }),
            sure_cycles: sure.len(),
            unheard: judging.unheard_s.map(|window_s| Unheard::new(cycles, window_s)),
        }
    }
}

impl Unheard {
    fn new(cycles: &[Judged], [from_s, to_s]: [f64; 2]) -> Self {
        let inside: Vec<&Judged> =
            cycles.iter().filter(|cycle| (from_s..to_s).contains(&cycle.time_s)).collect();
        let is_found = |cycle: &&Judged| cycle.error_m() < LARGE_ERROR_M && !cycle.estimate.searching;
        let found = cycles.iter().filter(|cycle| cycle.time_s >= to_s).find(is_found);
        Self {
            unheard_lies: share_of(&inside, |cycle| cycle.is_confident_lie()),
            unheard_above_3_sigma: share_of(&inside, |cycle| !(cycle.error_m() <= 3.0 * cycle.claimed_m())),
            found_s: found.map(|cycle| cycle.time_s - to_s),
            heard_again_s: cycles.last().map_or(0.0, |last| (last.time_s - to_s).max(0.0)),
        }
    }
}

/// Share of some cycles; none where there are none.
fn share_of(cycles: &[&Judged], is: impl Fn(&Judged) -> bool) -> Option<f64> {
    let count = cycles.iter().filter(|cycle| is(cycle)).count();
    (!cycles.is_empty()).then(|| count as f64 / cycles.len() as f64)
}

impl Judged {
    fn is_confident_lie(&self) -> bool {
        // NaN counts as a large error.
        !(self.error_m() <= LARGE_ERROR_M) && self.claimed_m() < SMALL_CLAIM_M && !self.estimate.searching
    }

    fn error(&self) -> [f64; 2] {
        std::array::from_fn(|axis| self.estimate.position_m[axis] - self.truth_m[axis])
    }

    fn error_m(&self) -> f64 {
        let [x, y] = self.error();
        x.hypot(y)
    }

    fn claimed_m(&self) -> f64 {
        let [xx, _, yy] = self.estimate.covariance_m2;
        (0.5 * (xx + yy)).sqrt()
    }

    fn normalised_square(&self) -> f64 {
        normalised_square(self.error(), self.estimate.covariance_m2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ANYWHERE: Judging = Judging { starts_anywhere: true, unheard_s: None, answerable: None };

    /// Cycles ten to the second with the errors given along x, and a claimed deviation per axis.
    fn cycles(errors_m: &[f64], claimed_m: f64, searching: impl Fn(usize) -> bool) -> Vec<Judged> {
        let judged = |(index, &error_m): (usize, &f64)| Judged {
            time_s: 0.1 * index as f64,
            truth_m: [3.0, 4.0],
            bound_m: 0.05,
            estimate: Estimate {
                position_m: [3.0 + error_m, 4.0],
                covariance_m2: [claimed_m * claimed_m, 0.0, claimed_m * claimed_m],
                probability: None,
                searching: searching(index),
                seconds: 0.0,
            },
        };
        errors_m.iter().enumerate().map(judged).collect()
    }

    #[test]
    fn a_steady_error_gives_the_figures_of_their_definitions() {
        let run = Run::new("x", &cycles(&[0.1; 40], 0.1, |_| false), &Judging::default());
        assert!(
            (run.rmse_m.unwrap() - 0.1).abs() < 1e-12 && (run.ratio_to_bound.unwrap() - 2.0).abs() < 1e-9
        );
        assert!((run.nees.unwrap() - 0.5).abs() < 1e-9 && run.inside_95 == 1.0 && !run.lost);
        assert_eq!((run.confident_lies, run.above_5_sigma, run.first_known_s), (0.0, 0.0, Some(0.0)));
    }

    #[test]
    fn a_confident_lie_needs_a_large_error_a_small_claim_and_no_search() {
        let lies = |error_m: f64, claimed_m: f64, searching: bool| {
            Run::new("x", &cycles(&[error_m; 10], claimed_m, |_| searching), &Judging::default())
                .confident_lies
        };
        assert_eq!(lies(1.1, 0.19, false), 1.0);
        assert_eq!(lies(f64::NAN, 0.19, false), 1.0);
        assert_eq!([lies(0.9, 0.19, false), lies(1.1, 0.21, false), lies(1.1, 0.19, true)], [0.0; 3]);
    }

    #[test]
    fn a_run_is_lost_at_its_end_or_in_over_a_tenth_of_its_cycles_even_while_it_says_so() {
        let lost = |errors: &[f64]| Run::new("x", &cycles(errors, 5.0, |_| true), &Judging::default()).lost;
        let mut errors = vec![0.1; 100];
        assert!(!lost(&errors));
        errors[99] = 1.1;
        assert!(lost(&errors));
        errors = vec![0.1; 100];
        errors[20..30].fill(1.1);
        assert!(!lost(&errors), "a tenth is not over a tenth");
        errors[30] = 1.1;
        assert!(lost(&errors));
    }

    #[test]
    fn the_first_seconds_count_unless_the_start_is_anywhere() {
        let mut errors = vec![0.1; 100];
        errors[..50].fill(7.0);
        let all = cycles(&errors, 5.0, |index| index < 50);
        assert!(Run::new("x", &all, &Judging::default()).lost && !Run::new("x", &all, &ANYWHERE).lost);
        assert!((Run::new("x", &all, &ANYWHERE).rmse_m.unwrap() - 0.1).abs() < 1e-9);
        assert_eq!(Run::new("x", &all, &ANYWHERE).first_known_s, Some(5.0));
        assert_eq!(Run::new("x", &all, &ANYWHERE).searching, 0.5);
        assert!(Run::new("x", &all[..49], &ANYWHERE).lost, "a run shorter than that counts whole");
    }

    #[test]
    fn losses_said_are_the_searches_begun_after_the_tag_was_known() {
        let run = Run::new(
            "x",
            &cycles(&[0.1; 12], 0.1, |index| matches!(index, 0 | 1 | 5 | 6 | 9)),
            &Judging::default(),
        );
        assert_eq!((run.losses_said, run.first_known_s), (2, Some(0.2)));
    }

    #[test]
    fn claims_are_right_within_a_metre_or_three_deviations() {
        let right = |error_m: f64, claimed_m: f64, probability: Option<f64>| {
            let mut all = cycles(&[error_m; 10], claimed_m, |_| false);
            all.iter_mut().skip(4).for_each(|cycle| cycle.estimate.probability = probability);
            Run::new("x", &all, &Judging::default()).sure_right
        };
        assert_eq!(right(0.9, 0.01, Some(0.91)), Some(1.0));
        assert_eq!(right(1.1, 0.3, Some(0.91)), Some(0.0));
        assert_eq!(right(1.1, 0.4, Some(0.91)), Some(1.0));
        assert_eq!([right(0.1, 0.4, Some(0.9)), right(0.1, 0.4, None)], [None; 2]);
    }

    #[test]
    fn while_nothing_is_heard_claims_are_judged_and_after_it_the_tag_is_found() {
        // 1 s to 2 s: half of it at 1.5 m, which is more than three claims of 0.15 m and a lie.
        let mut errors = vec![0.1; 40];
        errors[15..26].fill(1.5);
        let unheard = |searching: fn(usize) -> bool, errors: &[f64]| {
            let judging = Judging { unheard_s: Some([0.95, 1.95]), ..Judging::default() };
            let run = Run::new("x", &cycles(errors, 0.15, searching), &judging);
            assert!((run.end_error_m.unwrap() - errors[39]).abs() < 1e-9);
            run.unheard.unwrap()
        };
        let found = unheard(|_| false, &errors);
        assert_eq!((found.unheard_lies, found.unheard_above_3_sigma), (Some(0.5), Some(0.5)));
        assert!((found.found_s.unwrap() - 0.65).abs() < 1e-9);
        let found = unheard(|index| index < 30, &errors);
        assert_eq!((found.unheard_lies, found.unheard_above_3_sigma), (Some(0.0), Some(0.5)));
        assert!((found.found_s.unwrap() - 1.05).abs() < 1e-9);
        assert_eq!(unheard(|_| true, &errors).found_s, None);
        let judging = Judging { unheard_s: Some([5.0, 6.0]), ..Judging::default() };
        let none = Run::new("x", &cycles(&errors, 0.15, |_| false), &judging).unheard.unwrap();
        assert_eq!((none.unheard_lies, none.unheard_above_3_sigma, none.found_s), (None, None, None));
    }
}
