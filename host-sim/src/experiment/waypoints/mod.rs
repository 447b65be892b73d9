//! What choosing waypoints is worth: the core's application layer against a straight walk and a random one.
//!
//! Every run has a seed, which gives the room's scatterers, the noise, and a start and a goal within sight of each
//! other ([`floor`]). A tag is told where the anchors are and which virtual anchors a walk along the scenario's own way
//! has surveyed, if the scenario has a floor plan. After every leg of 0.5 m it is told the next waypoint, one of eight
//! around its estimate, as long as no wall is in its way; once the goal is that near, the goal is one as well. What it
//! walks is the step it was told, exactly, from where it really is: an error of the estimate stays one. It stops where
//! it believes itself at the goal, or after three times the legs of the straight walk.
//!
//! The channel is that of one leg after the other, as the way comes about. What a scenario states as parts of its way
//! (interference, obstructions, gaps) has no meaning on such a way and is left out. The carrier stays at the first
//! action, so that runs differ by their ways only.

pub mod figures;
pub mod floor;

use crate::bound::cycle_information;
use crate::bound::posterior::Posterior;
use crate::channel::random::{Purpose, stream, uniform};
use crate::geometry::distance_m;
use crate::input_error::InputError;
use crate::recording::Recording;
use crate::replay::{LARGE_ANCHORS, SMALL_ANCHORS, Setup, input, step};
use crate::scenario::{Position, Scenario, Trajectory, Way};
use crate::score::Score;
use crate::simulator::Simulator;
use cogmint_core::application::waypoint::{WaypointError, WaypointSettings};
use cogmint_core::model::observation::TagHeight;
use figures::Figures;
use floor::Floor;
use rayon::prelude::*;
use std::path::Path;

/// Length of a leg, metres.
const LEG_M: f64 = 0.5;
/// Directions that a leg may take.
const DIRECTIONS: usize = 8;
/// A tag that believes itself this near to the goal stops, metres.
const NEAR_M: f64 = 0.5 * LEG_M;
/// One that is really this near has arrived, metres.
const ARRIVED_M: f64 = LEG_M;
/// Legs at most, over those of the straight walk.
const PATIENCE: f64 = 3.0;

/// Who chooses the waypoints.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Chooser {
    /// Always the one nearest to the goal.
    Straight,
    /// Any of them.
    Random,
    /// The core's application layer.
    Informed,
}

impl Chooser {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Straight, Self::Random, Self::Informed];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Straight => "straight",
            Self::Random => "random",
            Self::Informed => "informed",
        }
    }
}

/// What one chooser made of one run.
#[derive(Clone, Debug)]
pub struct Walk {
    /// Whose.
    pub chooser: Chooser,
    /// How well the tag was tracked.
    pub score: Score,
    /// Entropy of the position by the posterior bound of the way walked, mean over its cycles, nats.
    pub entropy_nat: f64,
    /// Length of the way walked, metres.
    pub path_m: f64,
    /// Whether it stopped of itself, and at the goal.
    pub arrived: bool,
}

/// One run: the same task for every chooser.
#[derive(Clone, Debug)]
pub struct Run {
    /// Its seed.
    pub seed: u64,
    /// From start to goal, metres.
    pub straight_m: f64,
    /// The walks, in the order of [`Chooser::ALL`].
    pub walks: Vec<Walk>,
}

/// Compares all choosers in `runs` runs of a scenario, seeds from `seed` on. `metres_per_nat`: what the core's chooser
/// gives for a nat.
///
/// # Errors
/// The scenario cannot be simulated, or its room has no place for a walk.
pub fn compare(
    scenario: &Scenario,
    folder: Option<&Path>,
    metres_per_nat: f64,
    runs: u32,
    seed: u64,
    on_walk: impl Fn() + Sync,
) -> Result<Figures, InputError> {
    compare_told(scenario, folder, metres_per_nat, runs, seed, &on_walk)
}

/// Not generic: compiled here once, not again in every crate that calls it.
fn compare_told(
    scenario: &Scenario,
    folder: Option<&Path>,
    metres_per_nat: f64,
    runs: u32,
    seed: u64,
    on_walk: &(dyn Fn() + Sync),
) -> Result<Figures, InputError> {
    let mut scenario = scenario.clone();
    scenario.interference.clear();
    scenario.obstructions.clear();
    scenario.lost_frames.gaps.clear();
    let runs = (0..runs as usize).into_par_iter().map(|run| {
        let way = run % scenario.trajectories.len().max(1);
        let task = Task::new(&scenario, folder, way, seed.wrapping_add(run as u64), metres_per_nat)?;
        let walks = Chooser::ALL.map(|chooser| {
            let walk = if task.setup.anchors.len() <= SMALL_ANCHORS {
                task.walk::<SMALL_ANCHORS>(chooser)
            } else {
                task.walk::<LARGE_ANCHORS>(chooser)
            };
            on_walk();
            walk
        });
        Ok(Run {
            seed: task.seed,
            straight_m: distance_m(task.start_m, task.goal_m),
            walks: walks.into_iter().collect::<Result<_, InputError>>()?,
        })
    });
    let runs: Vec<Run> = runs.collect::<Result<_, InputError>>()?;
    Ok(Figures::new(&scenario.name, metres_per_nat, &runs))
}

/// What is the same for every chooser of a run.
struct Task {
    scenario: Scenario,
    seed: u64,
    floor: Floor,
    start_m: Position,
    goal_m: Position,
    /// Distance walked from cycle to cycle, metres.
    stride_m: f64,
    period_s: f64,
    settings: WaypointSettings,
    before: Recording,
    setup: Setup,
}

impl Task {
    fn new(
        scenario: &Scenario,
        folder: Option<&Path>,
        way: usize,
        seed: u64,
        metres_per_nat: f64,
    ) -> Result<Self, InputError> {
        let survey = Simulator::new(scenario, folder, way, Some(seed))?;
        let floor = Floor::new(&scenario.room);
        let Some([start_m, goal_m]) = floor.task(seed) else {
            let reason = "leaves no room for a walk of half its diagonal";
            return Err(InputError::new(&scenario.name, reason).for_item("room"));
        };
        // As fast as the scenario's own way where it moves.
        let steps = survey.channel().poses().windows(2).map(|pair| {
            (distance_m(pair[0].position_m, pair[1].position_m), pair[1].time_s - pair[0].time_s)
        });
        let (length_m, time_s) = steps
            .filter(|(length_m, _)| *length_m > 0.0)
            .fold((0.0, 0.0), |sum, one| (sum.0 + one.0, sum.1 + one.1));
        let period_s = scenario.trajectories[way].period_s;
        let speed_m_s = if time_s > 0.0 { length_m / time_s } else { 1.0 };
        let mut before = survey.before();
        (before.start.position_m, before.start.drawn_about_m) = (start_m, Some(start_m));
        let mut first = before.clone();
        first.cycles.push(survey.cycle(0, survey.channel().receiver().first_action));
        let mut setup = Setup::new(&first, Path::new(&scenario.name), Some(seed))?;
        setup.config.controller.planned_actions = 0;
        Ok(Self {
            scenario: scenario.clone(),
            seed,
            floor,
            start_m,
            goal_m,
            stride_m: speed_m_s * period_s,
            period_s,
            settings: WaypointSettings {
                speed_m_s: speed_m_s as f32,
                period_s: period_s as f32,
                metres_per_nat: metres_per_nat as f32,
            },
            before,
            setup,
        })
    }

    /// The simulator of leg `leg`, which begins at `time_s`. Noise and packets differ from leg to leg; the room and
    /// those who walk in it go on as they were.
    fn simulator(&self, leg: usize, ends_m: [Position; 2], time_s: f64) -> Result<Simulator, InputError> {
        let steps = (distance_m(ends_m[0], ends_m[1]) / self.stride_m - 1e-6).ceil().max(1.0);
        let length_m = distance_m(ends_m[0], ends_m[1]);
        let step_m = if length_m > 0.0 { length_m / steps } else { self.stride_m };
        let way = Trajectory {
            name: String::new(),
            period_s: self.period_s,
            cycles: None,
            way: Way::Polyline { vertices_m: ends_m.to_vec(), step_m },
        };
        let mut scenario = Scenario { trajectories: vec![way; leg + 1], ..self.scenario.clone() };
        for person in &mut scenario.people {
            let walked_m = person.speed_m_s * time_s;
            person.way_m = ahead(&person.way_m, walked_m, person.speed_m_s * (steps + 1.0) * self.period_s);
        }
        scenario.errors.clock_offset_s += scenario.errors.clock_drift * time_s;
        Simulator::new(&scenario, None, leg, Some(self.seed))
    }

    /// A tracker's walk.
    fn walk<const A: usize>(&self, chooser: Chooser) -> Result<Walk, InputError> {
        let refused = |reason: String| InputError::new(Path::new(&self.scenario.name), reason);
        let mut tracker = self.setup.tracker::<A>().map_err(|error| refused(error.to_string()))?;
        let mut rng = stream(self.seed, Purpose::Experiment, &[1]);
        let config = &self.setup.config;
        let mut bound =
            Posterior::new(f64::from(config.start.position_std_m), f64::from(config.start.velocity_std_m_s));
        let most_legs = (PATIENCE * distance_m(self.start_m, self.goal_m) / LEG_M).ceil() as usize;
        let goal_m = self.goal_m;
        let (mut here_m, mut next_m, mut path_m) = (self.start_m, self.start_m, 0.0);
        let (mut errors_m, mut entropies_nat, mut seconds) = (Vec::new(), Vec::new(), 0.0);
        let mut stopped = false;
        for leg in 0..=most_legs {
            // The first cycle of all is taken at the start; that of a leg is the last of the leg before.
            let begin_s = errors_m.len().saturating_sub(1) as f64 * self.period_s;
            let simulator = self.simulator(leg, [here_m, next_m], begin_s)?;
            let channel = simulator.channel();
            let (action, poses) = (channel.receiver().first_action, channel.poses());
            let mut estimate_m = tracker.filter().position_m().map(f64::from);
            for (cycle, pose) in poses.iter().enumerate().skip(leg.min(1)) {
                let mut received = simulator.cycle(cycle, action);
                let previous_s = errors_m.len().checked_sub(1).map(|last| last as f64 * self.period_s);
                received.time_s = errors_m.len() as f64 * self.period_s;
                let step = step(&mut tracker, &input(&self.before, &received, previous_s), &mut ())
                    .map_err(|error| refused(error.to_string()))?;
                estimate_m = step.report.position_m.map(f64::from);
                // The start is that of the first cycle, as for the tracker.
                let elapsed_s = if errors_m.is_empty() { 1e-3 } else { self.period_s };
                bound.predict(elapsed_s, f64::from(config.motion.acceleration_density_m2_s3));
                bound.update(cycle_information(channel, cycle, action));
                entropies_nat.push(bound.position_entropy_nat());
                errors_m.push(distance_m(pose.position_m, estimate_m));
                seconds += step.seconds;
            }
            path_m += distance_m(here_m, next_m);
            here_m = next_m;
            stopped = distance_m(estimate_m, goal_m) <= NEAR_M;
            let ends_m = self.ends(here_m, [goal_m[0] - estimate_m[0], goal_m[1] - estimate_m[1]]);
            if stopped || ends_m.is_empty() {
                break;
            }
            let candidates_m: Vec<Position> = ends_m
                .iter()
                .map(|end| [0, 1].map(|axis| estimate_m[axis] + end[axis] - here_m[axis]))
                .collect();
            let index = match chooser {
                Chooser::Straight => nearest(&candidates_m, goal_m),
                Chooser::Random => (uniform(&mut rng) * ends_m.len() as f64) as usize,
                Chooser::Informed => {
                    let single = |place: &Position| place.map(|coordinate| coordinate as f32);
                    let candidates: Vec<[f32; 2]> = candidates_m.iter().map(single).collect();
                    let height = TagHeight::exact(channel.tag_height_m(poses.len() - 1) as f32);
                    let goal = Some(single(&goal_m));
                    match tracker.choose_waypoint(&candidates, goal, Some(height), &self.settings) {
                        Ok(choice) => choice.index,
                        Err(WaypointError::Searching) => nearest(&candidates_m, goal_m),
                        Err(error) => return Err(refused(error.to_string())),
                    }
                }
            };
            next_m = ends_m[index];
        }
        Ok(Walk {
            chooser,
            score: Score::new(errors_m.len(), &errors_m, seconds),
            entropy_nat: entropies_nat.iter().sum::<f64>() / entropies_nat.len().max(1) as f64,
            path_m,
            arrived: stopped && distance_m(here_m, goal_m) <= ARRIVED_M,
        })
    }

    /// Where the legs from the end of the last one may end; `to_goal_m`: the way to the goal, as it is believed.
    fn ends(&self, from_m: Position, to_goal_m: Position) -> Vec<Position> {
        let compass = (0..DIRECTIONS).map(|direction| {
            let (sin, cos) = libm::sincos(std::f64::consts::TAU * direction as f64 / DIRECTIONS as f64);
            [LEG_M * cos, LEG_M * sin]
        });
        let goal = (distance_m(to_goal_m, [0.0; 2]) <= LEG_M).then_some(to_goal_m);
        compass
            .chain(goal)
            .map(|leg| [from_m[0] + leg[0], from_m[1] + leg[1]])
            .filter(|&end_m| self.floor.is_free(from_m, end_m))
            .collect()
    }
}

/// The next `length_m` of a way that is walked there and back again without end, after `walked_m`.
fn ahead(way_m: &[Position], walked_m: f64, length_m: f64) -> Vec<Position> {
    let lengths = |way_m: &[Position]| way_m.windows(2).map(|pair| distance_m(pair[0], pair[1])).sum::<f64>();
    let once_m = lengths(way_m);
    if !(once_m > 0.0) {
        return way_m.to_vec();
    }
    let mut skip_m = walked_m.rem_euclid(2.0 * once_m);
    let round = way_m.iter().chain(way_m.iter().rev().skip(1)).copied();
    let mut corners = round.collect::<Vec<_>>().into_iter().cycle();
    // The round begins and ends at the same corner; walked in a cycle, that one is there twice.
    let (mut from_m, mut left_m, mut ahead_m) = (way_m[0], length_m, Vec::new());
    while left_m > 0.0 {
        let Some(to_m) = corners.next() else { break };
        let side_m = distance_m(from_m, to_m);
        if side_m > skip_m {
            let share = skip_m / side_m;
            if ahead_m.is_empty() {
                ahead_m.push([0, 1].map(|axis| from_m[axis] + share * (to_m[axis] - from_m[axis])));
            }
            ahead_m.push(to_m);
            left_m -= side_m - skip_m;
        }
        skip_m = (skip_m - side_m).max(0.0);
        from_m = to_m;
    }
    ahead_m
}

/// The place nearest to the goal, the first of equals.
fn nearest(places_m: &[Position], goal_m: Position) -> usize {
    let all = places_m.iter().enumerate();
    let nearest = all.min_by(|(_, a), (_, b)| distance_m(**a, goal_m).total_cmp(&distance_m(**b, goal_m)));
    nearest.map_or(0, |(index, _)| index)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::trajectory::person_at;

    #[test]
    fn people_go_on_where_they_were() {
        let way_m = [[0.0, 0.0], [3.0, 0.0], [3.0, 1.0]];
        for begin in 0..40 {
            let (begin_s, speed_m_s) = (0.37 * f64::from(begin), 2.0);
            let ahead_m = ahead(&way_m, speed_m_s * begin_s, speed_m_s * 6.0);
            for later in 0..=12 {
                let later_s = 0.5 * f64::from(later);
                let expected_m = person_at(&way_m, speed_m_s, begin_s + later_s);
                let found_m = person_at(&ahead_m, speed_m_s, later_s);
                assert!(distance_m(expected_m, found_m) < 1e-9, "{begin_s} {later_s}: {found_m:?}");
            }
        }
        assert_eq!(ahead(&[[1.0, 2.0]], 3.0, 1.0), [[1.0, 2.0]]);
    }

    fn room() -> Scenario {
        Scenario::find("l-shaped-office").expect("is built in").0
    }

    #[test]
    fn the_same_seed_gives_the_same_figures_on_any_number_of_threads() {
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads start");
            pool.install(|| compare(&room(), None, 1.0, 2, 5, || {}).expect("runs"))
        };
        assert_eq!(run(1), run(3));
    }

    /// At no price for a nat the core's chooser has the goal alone in view, as the straight walk has.
    #[test]
    fn who_gives_nothing_for_a_nat_walks_straight() {
        let figures = compare(&room(), None, 0.0, 2, 3, || {}).expect("runs");
        let [straight, _, informed] = &figures.choosers[..] else { panic!("three rows") };
        assert_eq!(straight.rmse_m, informed.rmse_m);
        assert_eq!(straight.path_m, informed.path_m);
        assert_eq!(informed.entropy_gain_nat, 0.0);
    }

    /// Where anchors hang on one side, a way nearer to them is known better, and still arrives.
    #[test]
    fn a_hall_covered_from_one_side_is_worth_a_detour() {
        let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/waypoints.toml");
        let (hall, folder) = Scenario::find(file).expect("is a scenario");
        let figures = compare(&hall, folder.as_deref(), 1.0, 8, 1, || {}).expect("runs");
        let [straight, random, informed] = &figures.choosers[..] else { panic!("three rows") };
        let (gain_nat, error_nat) = (informed.entropy_gain_nat, informed.entropy_gain_error_nat);
        assert!(gain_nat > 0.05 && gain_nat > 2.0 * error_nat, "{figures:?}");
        assert!(informed.path_m < 1.3 * straight.path_m, "{figures:?}");
        assert_eq!((straight.arrivals, informed.arrivals, random.arrivals), (8, 8, 0), "{figures:?}");
        assert!(informed.diverged.is_empty(), "{figures:?}");
    }
}
