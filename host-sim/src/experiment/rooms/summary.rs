//! Figures over many rooms: by tracker, over all rooms and by everything that was drawn.

use super::RoomRuns;
use crate::channel::random::{Purpose, stream, uniform};
use crate::experiment::over_runs::{mean_of, quantile};
use crate::experiment::side_by_side::run::Run;
use crate::rooms::Drawn;
use serde::Serialize;

/// Resamplings of the bootstrap.
const RESAMPLINGS: usize = 1000;

/// A tracker over a set of rooms. Shares are means over its runs; intervals are the central 95 % of the bootstrap over
/// rooms (Efron 1979, percentile method).
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TrackerFigures {
    /// Name of the tracker.
    pub name: String,
    /// Share of runs that lost the tag.
    pub lost_share: Option<f64>,
    /// Its interval.
    pub lost_share_interval: Option<[f64; 2]>,
    /// The same over answerable rooms.
    pub lost_share_answerable: Option<f64>,
    /// Its interval.
    pub lost_share_answerable_interval: Option<[f64; 2]>,
    /// Median over the runs of the root mean square error, metres.
    pub rmse_median_m: Option<f64>,
    /// Its interval.
    pub rmse_median_interval_m: Option<[f64; 2]>,
    /// 90 % quantile of the same, metres.
    pub rmse_p90_m: Option<f64>,
    /// Median over the runs of the RMSE over that of `told` in the same room.
    pub ratio_to_told_median: Option<f64>,
    /// Median over the runs of the RMSE over the bound of the frames.
    pub ratio_to_bound_median: Option<f64>,
    /// Mean share of cycles that are confident lies.
    pub confident_lies_share: Option<f64>,
    /// Mean share of cycles searching.
    pub searching_share: Option<f64>,
    /// Mean share of cycles with the truth inside the claimed 95 % ellipse.
    pub inside_95_share: Option<f64>,
    /// Mean share of cycles with an error above 5 claimed deviations.
    pub above_5_sigma_share: Option<f64>,
    /// Median over the runs of the mean normalised error squared per degree of freedom: 1 is honest.
    pub nees_median: Option<f64>,
    /// Median over the runs of the time at which the tag was first said to be known, seconds; none where most never knew.
    pub first_known_median_s: Option<f64>,
    /// Mean number of losses said.
    pub losses_said_mean: Option<f64>,
    /// Of the cycles of all runs with a probability above 0.9, the share in which the claim was right.
    pub sure_right_share: Option<f64>,
    /// Share of runs that end more than 1 m off.
    pub end_above_1_m_share: Option<f64>,
    /// While nothing of the tag is heard: mean share of confident lies.
    pub unheard_lies_share: Option<f64>,
    /// Mean share of errors above 3 claimed deviations meanwhile.
    pub unheard_above_3_sigma_share: Option<f64>,
    /// Share of the runs in which the tag was found within 5 s of being heard again; those that end before are left out
    /// where it was not.
    pub found_within_5_s_share: Option<f64>,
}

/// The rooms in which one thing was drawn alike.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Group {
    /// What was drawn: `family`, `anchors`, `plan`, ...
    pub by: &'static str,
    /// As what.
    pub value: String,
    /// Number of rooms.
    pub rooms: usize,
    /// Answerable ones among them.
    pub answerable: usize,
    /// The trackers over all of them.
    pub trackers: Vec<TrackerFigures>,
    /// The trackers over the answerable ones.
    pub trackers_answerable: Vec<TrackerFigures>,
}

/// The trackers over some rooms.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// Number of rooms.
    pub rooms: usize,
    /// Answerable ones among them.
    pub answerable: usize,
    /// The trackers over all rooms.
    pub trackers: Vec<TrackerFigures>,
    /// The trackers over the answerable ones.
    pub trackers_answerable: Vec<TrackerFigures>,
}

impl Summary {
    /// Of these rooms.
    pub fn new(rooms: &[&RoomRuns]) -> Self {
        let answerable: Vec<&RoomRuns> = rooms.iter().copied().filter(|room| room.is_answerable()).collect();
        Self {
            rooms: rooms.len(),
            answerable: answerable.len(),
            trackers: figures(rooms),
            trackers_answerable: figures(&answerable),
        }
    }
}

/// Something that was drawn: its name, and how what was drawn is written.
type Draw = (&'static str, fn(&Drawn) -> String);

/// What rooms are grouped by.
const DRAWS: [Draw; 10] = [
    ("family", |drawn| drawn.family.name().into()),
    ("anchors", |drawn| drawn.anchors.to_string()),
    ("plan", |drawn| drawn.plan.name().into()),
    ("start", |drawn| drawn.start.name().into()),
    ("interference", |drawn| drawn.interference.name().into()),
    ("radio", |drawn| drawn.radio.name().into()),
    ("motion", |drawn| drawn.motion.name().into()),
    ("rate_hz", |drawn| {
        let edges = [(3.0, "1 to 3"), (10.0, "3 to 10")];
        edges.iter().find(|(edge, _)| drawn.rate_hz < *edge).map_or("10 to 50", |(_, name)| name).into()
    }),
    ("people", |drawn| drawn.people.to_string()),
    ("lost_frames", |drawn| if drawn.lost_frames > 0.0 { "some" } else { "none" }.into()),
];

/// The rooms by everything that was drawn, each value in the order of its first room.
pub fn groups(rooms: &[RoomRuns]) -> Vec<Group> {
    let mut groups = Vec::new();
    for (by, value_of) in DRAWS {
        let mut values: Vec<String> = rooms.iter().map(|room| value_of(&room.drawn)).collect();
        values.sort();
        values.dedup();
        groups.extend(values.into_iter().map(|value| {
            let inside: Vec<&RoomRuns> = rooms.iter().filter(|room| value_of(&room.drawn) == value).collect();
            let Summary { rooms, answerable, trackers, trackers_answerable } = Summary::new(&inside);
            Group { by, value, rooms, answerable, trackers, trackers_answerable }
        }));
    }
    groups
}

fn figures(rooms: &[&RoomRuns]) -> Vec<TrackerFigures> {
    // Where no true path is known, nothing can be told: such a room has no run of that tracker.
    let most = rooms.iter().max_by_key(|room| room.trackers.runs.len());
    let names = most.map_or(&[][..], |room| &room.trackers.runs[..]).iter().map(|run| run.tracker);
    names.map(|name| tracker_figures(name, rooms)).collect()
}

fn tracker_figures(name: &str, rooms: &[&RoomRuns]) -> TrackerFigures {
    let runs: Vec<&Run> = rooms
        .iter()
        .copied()
        .filter_map(|room| room.trackers.runs.iter().find(|run| run.tracker == name))
        .collect();
    let answerable: Vec<&Run> = rooms
        .iter()
        .copied()
        .filter(|room| room.is_answerable())
        .filter_map(|room| room.trackers.runs.iter().find(|run| run.tracker == name))
        .collect();
    let lost = |runs: &[&Run]| mean_of(runs.iter().map(|run| f64::from(u8::from(run.lost))));
    let rmse = |runs: &[&Run]| quantile(0.5, runs.iter().map(|run| run.rmse_m.unwrap_or(f64::INFINITY)));
    let share = |of: fn(&Run) -> f64| mean_of(runs.iter().map(|run| of(run)));
    // What is unknown is worse than anything known.
    let median =
        |of: fn(&Run) -> Option<f64>| quantile(0.5, runs.iter().map(|run| of(run).unwrap_or(f64::INFINITY)));
    let unheard = || runs.iter().filter_map(|run| run.unheard);
    TrackerFigures {
        name: name.into(),
        lost_share: lost(&runs),
        lost_share_interval: bootstrap(&runs, lost),
        lost_share_answerable: lost(&answerable),
        lost_share_answerable_interval: bootstrap(&answerable, lost),
        rmse_median_m: rmse(&runs),
        rmse_median_interval_m: bootstrap(&runs, rmse),
        rmse_p90_m: quantile(0.9, runs.iter().map(|run| run.rmse_m.unwrap_or(f64::INFINITY))),
        ratio_to_told_median: median(|run| run.ratio_to_told),
        ratio_to_bound_median: median(|run| run.ratio_to_bound),
        confident_lies_share: share(|run| run.confident_lies),
        searching_share: share(|run| run.searching),
        inside_95_share: share(|run| run.inside_95),
        above_5_sigma_share: share(|run| run.above_5_sigma),
        nees_median: median(|run| run.nees),
        first_known_median_s: median(|run| run.first_known_s),
        losses_said_mean: mean_of(runs.iter().map(|run| run.losses_said as f64)),
        sure_right_share: sure_right(&runs),
        end_above_1_m_share: mean_of(runs.iter().map(|run| {
            let is_off = run.end_error_m.is_none_or(|error_m| error_m > 1.0);
            f64::from(u8::from(is_off))
        })),
        unheard_lies_share: mean_of(unheard().filter_map(|unheard| unheard.unheard_lies)),
        unheard_above_3_sigma_share: mean_of(unheard().filter_map(|unheard| unheard.unheard_above_3_sigma)),
        found_within_5_s_share: mean_of(unheard().filter_map(|unheard| {
            let is_found = unheard.found_s.is_some_and(|found_s| found_s <= 5.0);
            (is_found || unheard.heard_again_s >= 5.0).then(|| f64::from(u8::from(is_found)))
        })),
    }
}

/// See [`TrackerFigures::sure_right_share`].
fn sure_right(runs: &[&Run]) -> Option<f64> {
    let cycles: usize = runs.iter().map(|run| run.sure_cycles).sum();
    let right = runs.iter().filter_map(|run| Some(run.sure_right? * run.sure_cycles as f64));
    (cycles > 0).then(|| right.sum::<f64>() / cycles as f64)
}

/// The central 95 % of a figure over resamplings of the runs; none where the figure has no value in most of them.
fn bootstrap(runs: &[&Run], figure: impl Fn(&[&Run]) -> Option<f64>) -> Option<[f64; 2]> {
    if runs.len() < 2 {
        return None;
    }
    let mut rng = stream(1, Purpose::Experiment, &[runs.len()]);
    let values: Vec<f64> = (0..RESAMPLINGS)
        .map(|_| {
            let drawn = |_| runs[((uniform(&mut rng) * runs.len() as f64) as usize).min(runs.len() - 1)];
            let sample: Vec<&Run> = (0..runs.len()).map(drawn).collect();
            figure(&sample).unwrap_or(f64::INFINITY)
        })
        .collect();
    Some([quantile(0.025, values.iter().copied())?, quantile(0.975, values.iter().copied())?])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(lost: bool) -> Run {
        Run {
            tracker: "x",
            lost,
            rmse_m: Some(if lost { 3.0 } else { 0.1 }),
            p95_m: None,
            ratio_to_bound: None,
            ratio_to_told: None,
            nees: None,
            confident_lies: 0.0,
            searching: 0.0,
            inside_95: 1.0,
            above_5_sigma: 0.0,
            first_known_s: None,
            losses_said: 0,
            end_error_m: None,
            sure_right: None,
            sure_cycles: 0,
            unheard: None,
        }
    }

    /// The interval of a share is that of the binomial distribution, about.
    #[test]
    fn the_bootstrap_of_a_share_has_the_binomial_deviation() {
        let runs: Vec<Run> = (0..200).map(|index| run(index % 4 == 0)).collect();
        let runs: Vec<&Run> = runs.iter().collect();
        let share = |runs: &[&Run]| mean_of(runs.iter().map(|run| f64::from(u8::from(run.lost))));
        let [low, high] = bootstrap(&runs, share).unwrap();
        let expected = 1.96 * (0.25 * 0.75 / 200.0_f64).sqrt();
        assert!(
            (0.25 - low - expected).abs() < 0.012 && (high - 0.25 - expected).abs() < 0.012,
            "{low} {high}"
        );
    }

    #[test]
    fn claims_are_counted_by_cycles() {
        let sure = |sure_right: Option<f64>, sure_cycles| Run { sure_right, sure_cycles, ..run(false) };
        let runs = [sure(Some(0.0), 1), sure(Some(1.0), 599), sure(None, 0)];
        let share = sure_right(&runs.iter().collect::<Vec<_>>()).unwrap();
        assert!((share - 599.0 / 600.0).abs() < 1e-12);
        assert_eq!(sure_right(&[&runs[2]]), None);
    }
}
