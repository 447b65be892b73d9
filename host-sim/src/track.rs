//! A recording through the core, from end to end: the run, its score and its picture.

use crate::estimate_table::Estimate;
use crate::input_error::InputError;
use crate::plot::{LineFigure, MappedAnchor, MappedWall, Panel, Picture, Series, TrackFigure, WallKind};
use crate::recording::{Cycle, Recording};
use crate::replay::{
    CycleInput, LARGE_ANCHORS, SMALL_ANCHORS, SURFACES, Setup, SizedTracker, Step, inputs, step,
};
use crate::score::Score;
use crate::score::consistency::{Consistency, Innovations};
use crate::score::map::{self, MapScore};
use crate::score::walls::{FoundWall, WallScore};
use cogmint_core::CycleReport;
use cogmint_core::memory::environment::CONFIRMED;
use cogmint_core::model::motion::Agent;
use cogmint_core::perceptor::smoother::FixedLag;
use serde::Serialize;
use std::path::Path;

/// A virtual anchor that the tracker holds at the end of a run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MappedVirtualAnchor {
    /// Index of the physical anchor whose image it is.
    pub anchor: usize,
    /// Position, metres.
    pub position_m: [f64; 2],
    /// Covariance of the position, square metres: xx, xy, yy.
    pub covariance_m2: [f64; 3],
    /// Probability that it exists.
    pub existence: f64,
}

/// What became of a recording.
#[derive(Clone, Debug)]
pub struct Track {
    /// Every cycle.
    pub steps: Vec<Step>,
    /// What the tracker believed after every cycle.
    pub estimates: Vec<Estimate>,
    /// The tag of the leading component after every cycle: what a smoother is given.
    pub agents: Vec<Agent>,
    /// Position errors of the cycles whose truth is known, metres, with the cycle.
    pub errors_m: Vec<(usize, f64)>,
    /// The score of the position.
    pub score: Score,
    /// The score of the map at the end.
    pub map: MapScore,
    /// Whether the filter knew how wrong it was.
    pub consistency: Consistency,
    /// Virtual anchors with an existence above one half at the end.
    pub virtual_anchors: Vec<MappedVirtualAnchor>,
    /// Walls at the end, believed or doubted.
    pub walls: Vec<FoundWall>,
    /// Those that no plan told of against those that could be found.
    pub wall_score: WallScore,
    /// Images that one surface explained together with others.
    pub joined: u64,
    /// Range bias of each anchor and its standard deviation at the end, metres; empty where none is estimated.
    pub bias_m: Vec<[f64; 2]>,
    /// Ranges and paths that the core left out because a scan had too many.
    pub left_out: u64,
    /// Cycles in which it was not known where the tag is.
    pub searching: usize,
    /// How often the loss of the tag was noticed.
    pub losses: usize,
    /// Discoveries for which the map had no room.
    pub map_full: u64,
    /// Cycles whose observations the core refused, and why the first was.
    pub refused: usize,
    /// Why the first refused cycle was.
    pub first_refusal: Option<String>,
}

/// Runs a recording through the core.
///
/// # Errors
/// The recording asks for more than the tracker holds, or its time cannot be followed.
pub fn track(
    recording: &Recording,
    file: &Path,
    seed: Option<u64>,
    on_cycle: impl FnMut(),
) -> Result<Track, InputError> {
    track_setup(&Setup::new(recording, file, seed)?, recording, file, on_cycle)
}

/// Where the tracker puts the tag in every cycle, metres, from the start's mean on.
///
/// # Errors
/// As [`track`].
pub fn way(recording: &Recording, file: &Path) -> Result<Vec<[f64; 2]>, InputError> {
    let run = track(recording, file, None, || {})?;
    Ok(run.estimates.iter().map(|estimate| estimate.position_m).collect())
}

/// [`track`] with a set-up of one's own.
///
/// # Errors
/// The core refuses the set-up, or the recording's time cannot be followed.
pub fn track_setup(
    setup: &Setup,
    recording: &Recording,
    file: &Path,
    mut on_cycle: impl FnMut(),
) -> Result<Track, InputError> {
    run_of_capacity(setup, recording, file, &mut on_cycle)
}

/// Not generic: compiled here once, not again in every crate that calls it.
fn run_of_capacity(
    setup: &Setup,
    recording: &Recording,
    file: &Path,
    on_cycle: &mut dyn FnMut(),
) -> Result<Track, InputError> {
    if setup.anchors.len() <= SMALL_ANCHORS {
        run::<SMALL_ANCHORS>(setup, recording, file, on_cycle)
    } else {
        run::<LARGE_ANCHORS>(setup, recording, file, on_cycle)
    }
}

fn run<const A: usize>(
    setup: &Setup,
    recording: &Recording,
    file: &Path,
    on_cycle: &mut dyn FnMut(),
) -> Result<Track, InputError> {
    let mut tracker = setup.tracker::<A>().map_err(|error| InputError::new(file, error.to_string()))?;
    let mut steps = Vec::new();
    let mut estimates = Vec::new();
    let mut agents = Vec::new();
    let mut errors_m = Vec::new();
    let mut claimed = Vec::new();
    let mut innovations = Innovations::default();
    for (index, (cycle, input)) in recording.cycles.iter().zip(inputs(recording)).enumerate() {
        let step = step(&mut tracker, &input, &mut innovations)
            .map_err(|error| InputError::new(file, format!("cycle {index}: {error}")))?;
        let estimate = estimate(cycle, &input, &step, tracker.filter().velocity_m_s());
        if let Some([x, y]) = cycle.truth_position_m {
            let [u, v] = estimate.position_m;
            errors_m.push((index, estimate.error_m([x, y])));
            claimed.push(([u - x, v - y], estimate.covariance_m2));
        }
        estimates.push(estimate);
        agents.push(tracker.filter().agent());
        steps.push(step);
        on_cycle();
    }
    let virtual_anchors: Vec<MappedVirtualAnchor> = tracker
        .environment()
        .iter()
        .filter(|(slot, _)| tracker.environment().existence(*slot) > CONFIRMED)
        .filter_map(|(slot, record)| {
            let (a, c) = tracker.image(slot)?;
            Some(MappedVirtualAnchor {
                anchor: record.anchor,
                position_m: [a.x, a.y].map(f64::from),
                covariance_m2: [c.m11, c.m21, c.m22].map(f64::from),
                existence: f64::from(tracker.environment().existence(slot)),
            })
        })
        .collect();
    let bias_m = (0..recording.anchors.len())
        .filter(|_| setup.config.ranging.bias_std_m > 0.0)
        .filter_map(|anchor| tracker.filter().bias_m(anchor))
        .map(|(mean, variance)| [f64::from(mean), f64::from(variance).sqrt()])
        .collect();
    let errors: Vec<f64> = errors_m.iter().map(|(_, error)| *error).collect();
    let score = Score::new(steps.len(), &errors, steps.iter().map(|step| step.seconds).sum());
    let found: Vec<_> = virtual_anchors.iter().map(|va| (va.anchor, va.position_m)).collect();
    let walls = walls(&tracker, &estimates);
    let wall_score = WallScore::new(recording, &walls, &found);
    let joined = steps.iter().map(|step| u64::from(step.report.joined)).sum();
    let map = MapScore::new(map::truth(recording).as_deref(), &found);
    let consistency = Consistency::new(&claimed, &innovations);
    let mut refusals = steps.iter().filter_map(|step| step.refused);
    let first_refusal = refusals.next().map(|error| error.to_string());
    let refused = steps.iter().filter(|step| step.refused.is_some()).count();
    let left_out = steps.iter().map(|step| u64::from(step.report.left_out)).sum();
    let count = |is: fn(&CycleReport) -> bool| steps.iter().filter(|step| is(&step.report)).count();
    let (searching, losses) = (count(|report| report.searching), count(|report| report.lost));
    let map_full = steps.iter().map(|step| u64::from(step.report.map_full)).sum();
    Ok(Track {
        searching,
        losses,
        map_full,
        steps,
        estimates,
        agents,
        errors_m,
        score,
        map,
        consistency,
        virtual_anchors,
        walls,
        wall_score,
        joined,
        bias_m,
        left_out,
        refused,
        first_refusal,
    })
}

/// A wall of the plan is drawn as believed where it is this far from where it is told, metres.
const MOVED_M: f64 = 0.01;

/// The walls that the tracker holds: the plan's segments, or as far as reflections on the estimated way were seen.
fn walls<const A: usize>(tracker: &SizedTracker<A>, estimates: &[Estimate]) -> Vec<FoundWall> {
    let wall = |slot: usize| {
        let wall = tracker.wall(slot)?;
        let (_, _, covariance) = tracker.filter().surface(slot)?;
        let line = wall.line;
        let [x, y] = line.centre_m.map(f64::from);
        let [tx, ty] = line.tangent().map(f64::from);
        let plan_wall = tracker.plan().wall_of(slot);
        let told = plan_wall.and_then(|wall| tracker.plan().walls().get(wall));
        let between = |[begin_m, end_m]: [f64; 2]| {
            [[x + begin_m * tx, y + begin_m * ty], [x + end_m * tx, y + end_m * ty]]
        };
        let mut extents_m = Vec::new();
        let mut moved_m: Option<f64> = None;
        match told {
            Some(told) => {
                let ([cx, cy], [ux, uy]) = (told.line.centre_m, told.line.tangent());
                for segment in tracker.plan().segments_of(told) {
                    extents_m.push(segment.extent_m.map(|place_m| {
                        let end_m = [cx + place_m * ux, cy + place_m * uy];
                        let off_m = f64::from(line.distance_m(end_m)).abs();
                        moved_m = Some(moved_m.map_or(off_m, |most_m| most_m.max(off_m)));
                        f64::from(line.place_m(end_m))
                    }));
                }
            }
            None => {
                let mut extent_m = [f64::INFINITY, f64::NEG_INFINITY];
                let mut cover =
                    |place_m: f64| extent_m = [extent_m[0].min(place_m), extent_m[1].max(place_m)];
                for (_, record) in tracker.environment().iter() {
                    if record.sequence.order() != 1 || !record.sequence.has(slot) {
                        continue;
                    }
                    let anchor_m = tracker.anchors()[record.anchor].position_m;
                    let [from_m, a] = [line.distance_m(anchor_m), line.place_m(anchor_m)].map(f64::from);
                    for estimate in estimates.iter().filter(|estimate| !estimate.searching) {
                        let tag_m = estimate.position_m.map(|x| x as f32);
                        let [to_m, b] = [line.distance_m(tag_m), line.place_m(tag_m)].map(f64::from);
                        if from_m * to_m > 0.0 {
                            cover(a + (b - a) * from_m / (from_m + to_m));
                        }
                    }
                }
                extents_m.push(if extent_m[0] <= extent_m[1] { extent_m } else { [0.0; 2] });
            }
        }
        Some(FoundWall {
            centre_m: [x, y],
            normal: line.normal.map(f64::from),
            offset_std_m: f64::from(wall.offset_std_m),
            rotation_std_rad: f64::from(wall.rotation_std_rad),
            offset_rotation_m_rad: f64::from(covariance.m21),
            existence: f64::from(wall.existence),
            is_doubted: wall.existence <= CONFIRMED,
            is_told: wall.is_told,
            plan_wall,
            moved_m,
            segments_m: extents_m.into_iter().map(between).collect(),
        })
    };
    (0..SURFACES).filter_map(wall).collect()
}

/// A wall as the figure draws it; none where it stands as told and is believed.
fn mapped_wall(wall: &FoundWall) -> Option<MappedWall> {
    let kind = match wall {
        FoundWall { is_doubted: true, .. } => WallKind::Doubted,
        FoundWall { is_told: false, .. } => WallKind::Grown,
        FoundWall { moved_m, .. } if moved_m.is_some_and(|moved_m| moved_m > MOVED_M) => WallKind::Moved,
        FoundWall { .. } => return None,
    };
    let deviations_m = |ends_m: &[[f64; 2]; 2]| {
        std::array::from_fn(|n| {
            let share = n as f64 / (MappedWall::PLACES - 1) as f64;
            let [[ax, ay], [bx, by]] = *ends_m;
            wall.deviation_m([ax + share * (bx - ax), ay + share * (by - ay)])
        })
    };
    let segments = wall.segments_m.iter().map(|ends_m| (*ends_m, deviations_m(ends_m))).collect();
    Some(MappedWall { kind, segments })
}

/// What is believed after a cycle. While the tag is searched for, the velocity is that of one of many places, and no column tells
/// its deviation: it is not known then.
fn estimate(cycle: &Cycle, input: &CycleInput<'_>, step: &Step, velocity_m_s: [f32; 2]) -> Estimate {
    let report = &step.report;
    let c = &report.position_covariance_m2;
    let framed = step.refused.is_none() && !cycle.frames.is_empty();
    Estimate {
        position_m: report.position_m.map(f64::from),
        velocity_m_s: (!report.searching).then(|| velocity_m_s.map(f64::from)),
        covariance_m2: [c.m11, c.m21, c.m22].map(f64::from),
        searching: report.searching,
        probability: Some(f64::from(report.probability)),
        action: framed.then_some(report.action),
        entropy_nat: Some(f64::from(report.entropy_nat)),
        // What the tracker was told, without the rounding to its precision.
        height_m: input.tag_height.and(cycle.tag_height_m),
    }
}

/// Most cycles that a lag may take.
const LONGEST_LAG_CYCLES: usize = 4096;

/// Where the tag was, known a lag later.
#[derive(Clone, Debug)]
pub struct Lagged {
    /// By cycle, metres; none at the end, of which too little is known by then.
    pub positions_m: Vec<Option<[f64; 2]>>,
    /// Root mean square of its errors where the truth is known, metres; none where it never is.
    pub rmse_m: Option<f64>,
}

impl Track {
    /// What the core's smoother knows of every cycle `lag_s` seconds later.
    pub fn lagged(&self, setup: &Setup, recording: &Recording, lag_s: f64) -> Lagged {
        let mut smoother = Box::new(FixedLag::<LONGEST_LAG_CYCLES>::new(lag_s as f32, setup.config.motion));
        let mut positions_m = vec![None; self.agents.len()];
        for (cycle, (agent, input)) in self.agents.iter().zip(inputs(recording)).enumerate() {
            smoother.enter(*agent, input.elapsed_s, |past| {
                let [x, y] = [past.agent.mean.x, past.agent.mean.y];
                positions_m[cycle - past.cycles] = Some([f64::from(x), f64::from(y)]);
            });
        }
        let pairs = recording.cycles.iter().zip(&positions_m);
        let squared = pairs.filter_map(|(cycle, at)| {
            let ([x, y], [u, v]) = (cycle.truth_position_m?, (*at)?);
            Some((u - x).powi(2) + (v - y).powi(2))
        });
        let (sum, count) = squared.fold((0.0, 0), |(sum, count), squared| (sum + squared, count + 1));
        let rmse_m = (count > 0).then(|| (sum / f64::from(count)).sqrt());
        Lagged { positions_m, rmse_m }
    }

    /// The track over the anchors and the map of virtual anchors, above the error and the entropy over time.
    pub fn picture(&self, recording: &Recording) -> Picture {
        let estimates: Vec<[f64; 2]> =
            self.steps.iter().map(|step| step.report.position_m.map(f64::from)).collect();
        let truth = recording.cycles.iter().filter_map(|cycle| cycle.truth_position_m).collect();
        let true_ones = recording.virtual_anchors.iter().filter(|va| va.exists).map(|va| MappedAnchor {
            label: String::new(),
            position_m: va.position_m,
            covariance_m2: None,
            is_truth: true,
        });
        let found = self.virtual_anchors.iter().map(|va| MappedAnchor {
            label: format!("{}", va.anchor + 1),
            position_m: va.position_m,
            covariance_m2: Some(va.covariance_m2),
            is_truth: false,
        });
        let plan_walls = recording.plan.iter().flat_map(|plan| &plan.walls);
        let every = (self.steps.len() / 20).max(1);
        let ellipses = self.steps.iter().zip(&estimates).step_by(every).map(|(step, position)| {
            let c = &step.report.position_covariance_m2;
            (*position, [c.m11, c.m21, c.m22].map(f64::from))
        });
        let track = TrackFigure {
            title: format!("{}: track", recording.name),
            truth,
            estimates: vec![("estimate".into(), estimates.clone())],
            anchors: recording.anchors.iter().map(|a| (a.name.clone(), a.position_m)).collect(),
            virtual_anchors: true_ones.chain(found).collect(),
            walls: recording.walls.clone(),
            told_walls: plan_walls.flat_map(|wall| wall.segments_m.clone()).collect(),
            found_walls: self.walls.iter().filter_map(mapped_wall).collect(),
            ellipses: ellipses.collect(),
            shows_map: false,
        };
        // Virtual anchors lie around the room: a map of them leaves the track small.
        let map = (!track.virtual_anchors.is_empty()).then(|| TrackFigure {
            title: "Map at the end".into(),
            ellipses: Vec::new(),
            shows_map: true,
            ..track.clone()
        });
        let first_s = recording.cycles.first().map_or(0.0, |cycle| cycle.time_s);
        let time = |index: usize| recording.cycles.get(index).map_or(0.0, |cycle| cycle.time_s - first_s);
        let line = |title: &str, y_label: &str, log_y: bool, points: Vec<[f64; 2]>| LineFigure {
            title: title.into(),
            x_label: "time in s".into(),
            y_label: y_label.into(),
            series: vec![Series { label: "estimate".into(), points, faint: false }],
            spans: Vec::new(),
            log_y,
        };
        let mut rows = vec![vec![Panel::Track(track)]];
        rows.extend(map.map(|map| vec![Panel::Track(map)]));
        if !self.errors_m.is_empty() {
            let points = self.errors_m.iter().map(|(index, error)| [time(*index), error.max(1e-4)]).collect();
            rows.push(vec![line("Position error", "error in m", true, points).into()]);
        }
        let entropy = self.steps.iter().enumerate();
        let points = entropy.map(|(n, step)| [time(n), f64::from(step.report.entropy_nat)]).collect();
        rows.push(vec![line("Entropy of the position", "entropy in nat", false, points).into()]);
        Picture { rows }
    }
}
