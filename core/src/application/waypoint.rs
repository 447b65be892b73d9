//! Waypoints: which of several places to go to next, for information and for a goal.
//!
//! For each candidate the covariance of position and velocity is carried along the straight way there, a cycle at a
//! time: the state filter's own prediction, then the information of all sources expected to be visible from the place
//! reached by then. What is left on arrival is the expected entropy h of the position. With a goal, the covariance is
//! carried on along the straight way from the candidate to the goal, and a candidate costs
//!
//! integral of 1 + metres_per_nat (h(s) - h_0) ds over its whole way to the goal, in metres,
//!
//! h_0 being the lowest entropy expected on any of the ways: a metre where the position is a nat worse known counts as
//! 1 + metres_per_nat metres. The least cost wins, the first of equals. A price of 0 goes straight to the goal.
//!
//! Why the whole way: what is known follows the place within a few cycles, so that the entropy on arrival is a property
//! of the candidate's place. Its price alone would draw the tag downhill in a landscape with hollows (around every
//! anchor), in which it stays; and a leg's own difference is too small to be worth a turn, although all legs after it
//! would gain. Every metre costs at least itself, so staying never pays. Comparing ways that go on by a plain rule is a
//! rollout policy (Bertsekas, "Rollout algorithms for discrete optimization: a survey", 2013): chosen anew at every
//! candidate, with costs that do not change, it does no worse than the plain rule, by its own prediction.
//!
//! Without a goal, a candidate costs metres_per_nat h on arrival, so that any positive price seeks information alone.
//! Then candidates should be about equally far away: a longer way there is more cycles of measurements. One nat in two
//! dimensions is a deviation that is smaller by the factor e^(1/2) on both axes.
//!
//! SINRs come from the channel memory, at one action for each source. It knows them as they are at the present distance
//! of tag and source; from another place the power of the path is that of free space, SINR (present distance / distance
//! there)^2, over unchanged noise. Sources never observed have the memory's prior SINR, at every distance. Within half
//! a metre of an anchor none of its paths counts: the tracker loses the tag within 0.2 to 0.3 m of one (measured in the
//! single-anchor room, alike at 40 and 50 dB and at pulses of 0.5 and 1 ns), while the bound has it best there. With
//! a plan, sources come into sight and go out of it on the way as its walls let them. As in
//! [`crate::controller::planning`], a path counts by the probability that it is visible and found, and correlations of
//! tag and virtual anchors are left out.

use crate::controller::planning::{PlanningState, Visible};
use crate::information::entropy::{position_block, position_entropy_nat};
use crate::information::fisher::{PositionInformation, range_slope};
use crate::model::channel::ChannelKnowledge;
use crate::model::detection::detection_probability;
use crate::model::motion::MotionStep;
use crate::model::source::Source;
use crate::radio::library::Library;
use crate::real::{SPEED_OF_LIGHT_M_S, abs, larger, smaller, sqrt};
use core::fmt;
use nalgebra::Matrix4;

/// Capacity: candidates per choice at most: what bounds its duration, with [`LONGEST_LEG_CYCLES`].
pub const MOST_CANDIDATES: usize = 32;
/// Capacity: cycles that the way to a candidate may take, and those that are looked at of the way from there to the goal.
pub const LONGEST_LEG_CYCLES: u32 = 1000;
/// Capacity: places at which information is looked at on the way from a candidate to the goal, at most.
const PLACES_TO_GOAL: u32 = 32;
/// Guard: against overflow: coordinates of candidates and goal lie within this, metres, as those of anchors do.
const REACH_M: f32 = 1e4;
/// Guard: against rounding: a leg longer than so many steps by less than this is not given another one, steps.
const ROUNDING: f32 = 1e-3;
/// Guard: against the division by zero: nearer than this, power no longer grows as in free space, metres.
const NEAREST_M: f32 = 0.1;
/// Guard: against places at an anchor, where ranges lose their direction: nearer than this, none of its paths counts, metres.
const BLIND_M: f32 = 0.5;

/// How a waypoint is chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct WaypointSettings {
    /// Speed of the tag on its way, m/s (1e-3 to 100).
    pub speed_m_s: f32,
    /// Time from cycle to cycle, seconds (above 0, at most 3600).
    pub period_s: f32,
    /// What a nat less of expected entropy, on each metre of the way to the goal, is worth: metres of detour for each
    /// such metre (0 to 1e6).
    pub metres_per_nat: f32,
}

/// The waypoint chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct WaypointChoice {
    /// Its index among the candidates.
    pub index: usize,
    /// Entropy of the position expected on arrival, nats.
    pub entropy_nat: f32,
    /// Distance from there to the goal, metres; 0 without a goal.
    pub remaining_m: f32,
    /// What it costs, metres: its whole way to the goal, each metre counted 1 + metres_per_nat (nats above the lowest
    /// entropy expected on any of the ways) times; without a goal metres_per_nat entropy_nat.
    pub cost_m: f32,
}

/// Why no waypoint is chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum WaypointError {
    /// There are no candidates.
    NoCandidates,
    /// There are more than [`MOST_CANDIDATES`].
    TooManyCandidates {
        /// Candidates given.
        given: usize,
    },
    /// A candidate is not finite or beyond 10 km.
    Candidate {
        /// Its index.
        index: usize,
    },
    /// The way to a candidate takes more than [`LONGEST_LEG_CYCLES`].
    TooFar {
        /// Its index.
        index: usize,
    },
    /// The goal is not finite or beyond 10 km.
    Goal,
    /// The speed is out of range.
    Speed,
    /// The time between cycles is out of range.
    Period,
    /// The weight of the entropy is out of range.
    Weight,
    /// The library has no such action.
    Action,
    /// The tag's height is not finite or beyond a kilometre.
    TagHeight,
    /// Position or covariance to start from are not finite.
    Start,
    /// It is not known where the tag is: its covariance says nothing yet.
    Searching,
}

impl fmt::Display for WaypointError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::NoCandidates => write!(f, "there are no waypoints to choose from"),
            Self::TooManyCandidates { given } => {
                write!(f, "{given} waypoints given, at most {MOST_CANDIDATES} allowed")
            }
            Self::Candidate { index } => write!(f, "the position of waypoint {index} is out of range"),
            Self::TooFar { index } => {
                write!(f, "the way to waypoint {index} takes more than {LONGEST_LEG_CYCLES} cycles")
            }
            Self::Goal => write!(f, "the position of the goal is out of range"),
            Self::Speed => write!(f, "the speed is out of range"),
            Self::Period => write!(f, "the time between cycles is out of range"),
            Self::Weight => write!(f, "the weight of the entropy is out of range"),
            Self::Action => write!(f, "there is no such action in the library"),
            Self::TagHeight => write!(f, "the tag's height is out of range"),
            Self::Start => write!(f, "position and covariance to start from are not finite"),
            Self::Searching => write!(f, "it is not known yet where the tag is"),
        }
    }
}

impl core::error::Error for WaypointError {}

/// Chooses one of `candidates` (positions, metres; 1 to [`MOST_CANDIDATES`]) on the way to `goal`, by what the memories
/// know. `visible` gives the sources as they are seen from a place (metres), with the action each is received with; `state`
/// is where the tag starts; its velocity and its length of a cycle are not used, since the way is the one to the candidate and `settings` has the
/// period.
///
/// # Errors
/// The first bad input.
pub fn choose_waypoint<const ACTIONS: usize, V: Iterator<Item = (Visible, usize)> + Clone>(
    candidates: &[[f32; 2]],
    goal: Option<[f32; 2]>,
    settings: &WaypointSettings,
    state: &PlanningState,
    visible: impl Fn([f32; 2]) -> V,
    channel: &impl ChannelKnowledge,
    library: &Library<ACTIONS>,
) -> Result<WaypointChoice, WaypointError> {
    check(candidates, goal, settings, state)?;
    if visible(state.position_m).any(|(_, action)| library.get(action).is_none()) {
        return Err(WaypointError::Action);
    }
    let mut variances_m2 = [[0.0; 2]; ACTIONS];
    for (action, variances_m2) in variances_m2.iter_mut().enumerate() {
        if let Some(entry) = library.get(action) {
            let pulse = state.radio.pulse(entry);
            let floor_m = state.range_floor_pulses * (pulse.duration_s * SPEED_OF_LIGHT_M_S);
            *variances_m2 = [state.variance_inflation * pulse.range_variance_m2(1.0), floor_m * floor_m];
        }
    }
    let ranging = RangeQuality {
        channel,
        variances_m2,
        floor_m2: state.range_floor_m * state.range_floor_m,
        threshold: state.threshold,
        step: state.motion.step(settings.period_s),
    };
    let mut ways = [Way::default(); MOST_CANDIDATES];
    let mut lowest_nat = f32::INFINITY;
    for (index, (&candidate, way)) in candidates.iter().zip(&mut ways).enumerate() {
        let Some(cycles) = cycles_to(candidate, state.position_m, settings) else {
            return Err(WaypointError::TooFar { index });
        };
        let mut walker =
            Walker { place_m: state.position_m, covariance: state.covariance, way: Way::default() };
        walker.walk(candidate, cycles, 1, state, &visible, &ranging);
        walker.way.arrival_nat = walker.entropy_nat();
        if let Some(goal) = goal {
            walker.way.remaining_m = distance_m(candidate, goal);
            let whole = walker.way.remaining_m / (settings.speed_m_s * settings.period_s);
            let looked_at = smaller(whole, LONGEST_LEG_CYCLES as f32);
            if looked_at > ROUNDING {
                let to_m = toward(candidate, goal, looked_at / whole);
                let cycles = (looked_at - ROUNDING) as u32 + 1;
                let stretch = cycles.div_ceil(PLACES_TO_GOAL);
                walker.walk(to_m, cycles, stretch, state, &visible, &ranging);
            }
        }
        lowest_nat = smaller(lowest_nat, walker.way.lowest_nat);
        *way = walker.way;
    }
    let mut best: Option<WaypointChoice> = None;
    for (index, (&candidate, way)) in candidates.iter().zip(&ways).enumerate() {
        let cost_m = match goal {
            Some(_) => {
                let length_m = distance_m(state.position_m, candidate) + way.remaining_m;
                length_m + settings.metres_per_nat * (way.integral_m_nat - lowest_nat * way.judged_m)
            }
            None => settings.metres_per_nat * way.arrival_nat,
        };
        if best.is_none_or(|best| cost_m < best.cost_m) {
            best = Some(WaypointChoice {
                index,
                entropy_nat: way.arrival_nat,
                remaining_m: way.remaining_m,
                cost_m,
            });
        }
    }
    best.ok_or(WaypointError::NoCandidates)
}

/// What ranges are worth.
struct RangeQuality<'a, C, const ACTIONS: usize> {
    channel: &'a C,
    /// By action, variance of a range at SINR 1 and what comes on top at any, square metres.
    variances_m2: [[f32; 2]; ACTIONS],
    floor_m2: f32,
    threshold: f32,
    /// The motion over one cycle.
    step: MotionStep,
}

fn check(
    candidates: &[[f32; 2]],
    goal: Option<[f32; 2]>,
    settings: &WaypointSettings,
    state: &PlanningState,
) -> Result<(), WaypointError> {
    // Written so that NaN fails.
    let within = |[x, y]: [f32; 2]| abs(x) <= REACH_M && abs(y) <= REACH_M;
    if candidates.is_empty() {
        return Err(WaypointError::NoCandidates);
    }
    if candidates.len() > MOST_CANDIDATES {
        return Err(WaypointError::TooManyCandidates { given: candidates.len() });
    }
    if let Some(index) = candidates.iter().position(|candidate| !within(*candidate)) {
        return Err(WaypointError::Candidate { index });
    }
    if goal.is_some_and(|goal| !within(goal)) {
        return Err(WaypointError::Goal);
    }
    if !(settings.speed_m_s >= 1e-3 && settings.speed_m_s <= 100.0) {
        return Err(WaypointError::Speed);
    }
    if !(settings.period_s > 0.0 && settings.period_s <= 3600.0) {
        return Err(WaypointError::Period);
    }
    if !(settings.metres_per_nat >= 0.0 && settings.metres_per_nat <= 1e6) {
        return Err(WaypointError::Weight);
    }
    // The tag itself may have drifted a little out of reach.
    let [x, y] = state.position_m;
    let known = abs(x) <= 1e6 && abs(y) <= 1e6 && state.covariance.iter().all(|entry| abs(*entry) <= 1e12);
    if known { Ok(()) } else { Err(WaypointError::Start) }
}

fn distance_m([x, y]: [f32; 2], [u, v]: [f32; 2]) -> f32 {
    sqrt((x - u) * (x - u) + (y - v) * (y - v))
}

fn squared_distance_m2(sight: &Visible, place_m: [f32; 2]) -> f32 {
    let distance = distance_m(place_m, sight.position_m);
    distance * distance + sight.height_m * sight.height_m
}

/// Cycles that the way to a candidate takes, at least 1; `None` where it takes too many.
fn cycles_to(candidate: [f32; 2], from: [f32; 2], settings: &WaypointSettings) -> Option<u32> {
    let steps = distance_m(candidate, from) / (settings.speed_m_s * settings.period_s);
    if !(steps <= LONGEST_LEG_CYCLES as f32) {
        return None;
    }
    // Truncation of what is not negative, and 0 of what is.
    Some((steps - ROUNDING) as u32 + 1)
}

/// The place at this share of the way.
fn toward([x, y]: [f32; 2], [u, v]: [f32; 2], share: f32) -> [f32; 2] {
    [x + share * (u - x), y + share * (v - y)]
}

/// What is expected of a way through a candidate.
#[derive(Clone, Copy)]
struct Way {
    /// Entropy on arrival at the candidate, nats.
    arrival_nat: f32,
    /// The lowest on the way, nats.
    lowest_nat: f32,
    /// Its integral over the way, metres times nats.
    integral_m_nat: f32,
    /// Length over which it was integrated, metres.
    judged_m: f32,
    /// From the candidate to the goal, metres.
    remaining_m: f32,
}

impl Default for Way {
    fn default() -> Self {
        Self {
            arrival_nat: 0.0,
            lowest_nat: f32::INFINITY,
            integral_m_nat: 0.0,
            judged_m: 0.0,
            remaining_m: 0.0,
        }
    }
}

/// Someone on the way: where, and how well that is known.
struct Walker {
    place_m: [f32; 2],
    covariance: Matrix4<f32>,
    way: Way,
}

impl Walker {
    fn entropy_nat(&self) -> f32 {
        position_entropy_nat(&position_block(&self.covariance))
    }

    /// Walks straight on to `to_m`, in so many cycles; the information is looked at once for `stretch` of them, in
    /// their middle.
    fn walk<const ACTIONS: usize, V: Iterator<Item = (Visible, usize)> + Clone>(
        &mut self,
        to_m: [f32; 2],
        cycles: u32,
        stretch: u32,
        state: &PlanningState,
        visible: &impl Fn([f32; 2]) -> V,
        ranging: &RangeQuality<'_, impl ChannelKnowledge, ACTIONS>,
    ) {
        let (from_m, whole) = (self.place_m, cycles as f32);
        let step_m = distance_m(from_m, to_m) / whole;
        let mut information = PositionInformation::default();
        let mut looked_at = 0;
        for cycle in 1..=cycles {
            if cycle > looked_at {
                let middle = smaller(cycle as f32 + 0.5 * (stretch as f32 - 1.0), whole);
                let place_m = toward(from_m, to_m, middle / whole);
                information = ranging.information(visible(place_m), state.position_m, place_m);
                looked_at += stretch;
            }
            let predicted = ranging.step.predicted(&self.covariance);
            self.covariance = information.posterior(&predicted);
            let entropy_nat = self.entropy_nat();
            self.way.lowest_nat = smaller(self.way.lowest_nat, entropy_nat);
            self.way.integral_m_nat += step_m * entropy_nat;
            self.way.judged_m += step_m;
        }
        self.place_m = to_m;
    }
}

impl<C: ChannelKnowledge, const ACTIONS: usize> RangeQuality<'_, C, ACTIONS> {
    /// What all sources tell in a cycle at `place_m`, while the tag is at `present_m`.
    fn information(
        &self,
        visible: impl Iterator<Item = (Visible, usize)> + Clone,
        present_m: [f32; 2],
        place_m: [f32; 2],
    ) -> PositionInformation {
        let anchors = visible.clone().map(|(sight, _)| sight);
        let is_blind = |anchor: usize| {
            anchors.clone().any(|sight| {
                sight.source == Source::Direct { anchor }
                    && squared_distance_m2(&sight, place_m) < BLIND_M * BLIND_M
            })
        };
        let mut information = PositionInformation::default();
        for (sight, action) in visible {
            if !is_blind(sight.source.anchor()) {
                self.add(&mut information, (&sight, action), present_m, place_m);
            }
        }
        information
    }

    /// Adds what a source tells at `place_m`, while the tag is at `present_m`.
    fn add(
        &self,
        information: &mut PositionInformation,
        (sight, action): (&Visible, usize),
        present_m: [f32; 2],
        place_m: [f32; 2],
    ) {
        let ([x, y], [ax, ay]) = (place_m, sight.position_m);
        let slope = range_slope([x - ax, y - ay], sight.height_m);
        let [ux, uy] = slope;
        let c = &sight.covariance_m2;
        let map_m2 = ux * ux * c.m11 + 2.0 * (ux * uy) * c.m21 + uy * uy * c.m22;
        let known = self.channel.prior(sight.source, action);
        let mut sinr = known.sinr;
        if known.seen {
            let squared = |place: [f32; 2]| larger(squared_distance_m2(sight, place), NEAREST_M * NEAREST_M);
            sinr *= squared(present_m) / squared(place_m);
        }
        // A path tells something only if it is found.
        let found = known.visibility * sight.availability * detection_probability(sinr, self.threshold);
        if found <= 0.0 {
            return;
        }
        let [unit_m2, path_m2] = self.variances_m2.get(action).copied().unwrap_or([0.0; 2]);
        information.add(slope, (unit_m2 / sinr + (self.floor_m2 + path_m2) + map_m2) / found);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Config;
    use crate::Tracker;
    use crate::memory::channel::{ChannelMemory, ChannelMemorySettings};
    use crate::model::anchor::Anchor;
    use crate::model::detection::detection_probability;
    use crate::model::measurement::Measurement;
    use crate::model::motion::{Motion, Start};
    use crate::model::plan::Map;
    use crate::radio::library::{LIBRARY_PUBLISHED, LIBRARY_WIDE};
    use nalgebra::{Matrix2, Vector4};
    use std::vec::Vec;

    type Memory = ChannelMemory<3, 1, 40>;
    const ACTION: usize = 20;

    fn library() -> Library<40> {
        Library::new(&LIBRARY_PUBLISHED).unwrap()
    }

    /// The direct paths of anchors at these places.
    fn direct(anchors_m: &[[f32; 2]], height_m: f32) -> Vec<(Visible, usize)> {
        let visible = |(anchor, &position_m): (usize, &[f32; 2])| {
            let covariance_m2 = Matrix2::new(0.0, 0.0, 0.0, 0.0);
            let source = Source::Direct { anchor };
            (Visible { source, position_m, height_m, covariance_m2, availability: 1.0 }, ACTION)
        };
        anchors_m.iter().enumerate().map(visible).collect()
    }

    fn motion(acceleration_density_m2_s3: f32) -> Motion {
        Motion { acceleration_density_m2_s3, velocity_decay_s: f32::INFINITY, ..Config::default().motion }
    }

    fn state(covariance: Matrix4<f32>) -> PlanningState {
        PlanningState {
            position_m: [0.0, 0.0],
            velocity_m_s: [0.0, 0.0],
            covariance,
            elapsed_s: 1.0,
            motion: motion(1e-12),
            variance_inflation: 1.0,
            range_floor_m: 0.0,
            range_floor_pulses: 0.0,
            radio: Config::default().radio,
            // Every path is found.
            threshold: 0.0,
        }
    }

    fn settings(metres_per_nat: f32) -> WaypointSettings {
        WaypointSettings { speed_m_s: 1.0, period_s: 1.0, metres_per_nat }
    }

    /// What the memory holds of an anchor seen at this SINR.
    fn see(memory: &mut Memory, anchor: usize, sinr: f32) {
        let path = Measurement { range_m: 1.0, variance_m2: 1e-4, sinr, energy: 1.0, false_alarm: 1.0 };
        let source = Source::Direct { anchor };
        let shares = memory.shares(ACTION, &library());
        memory.remember(source, ACTION, &path, 1.0, 0.1);
        memory.remember_noise(source, ACTION, &shares, (1.0, 1.0 / sinr), 0.0, 0.1);
    }

    /// A position without velocity, which prediction leaves as it is.
    fn fixed(xx: f32, yy: f32) -> Matrix4<f32> {
        Matrix4::from_diagonal(&Vector4::new(xx, yy, 0.0, 0.0))
    }

    /// Prior variances a << b along x and y. At a candidate beside the anchor in y its range removes the variance of y:
    /// det = a / (1 / b + J); beside it in x that of x: det = b / (1 / a + J). The difference of entropies is
    /// 1/2 ln ((1 + b J) / (1 + a J)).
    #[test]
    fn the_place_that_sees_the_uncertain_direction_wins_by_the_closed_form() {
        let (a, b) = (1e-4_f32, 4e-2_f32);
        let state = state(fixed(a, b));
        let (memory, library) =
            (Memory::new(ChannelMemorySettings::default(), 1e4, true, &library()), library());
        // Both candidates are a metre from the tag and from the anchor, which was never seen: the prior, everywhere.
        let anchor_m = [1.0, 1.0];
        let candidates = [[0.0, 1.0], [1.0, 0.0]];
        let choose = |candidates: &[[f32; 2]], metres_per_nat: f32, goal: Option<[f32; 2]>| {
            let visible = direct(&[anchor_m], 0.0);
            let settings = settings(metres_per_nat);
            let visible = |_| visible.iter().copied();
            choose_waypoint(candidates, goal, &settings, &state, visible, &memory, &library).unwrap()
        };
        let seeking = choose(&candidates, 1.0, None);
        assert_eq!((seeking.index, seeking.remaining_m, seeking.cost_m), (1, 0.0, seeking.entropy_nat));
        // From the bandwidth by its definition: 8 pi^2 beta^2 SINR / c^2, beta^2 of the raised cosine.
        let (roll_off, duration_s) = (0.6_f64, 0.5e-9);
        let pi = core::f64::consts::PI;
        let beta2 = (1.0 / 12.0 + roll_off * roll_off * (0.25 - 2.0 / (pi * pi))) / (duration_s * duration_s);
        let sinr = f64::from(memory.sinr(Source::Direct { anchor: 0 }, ACTION));
        let c = 299_792_458.0_f64;
        // Never seen: visible for sure, and found with the probability of the detector.
        let found = f64::from(detection_probability(sinr as f32, 0.0));
        let j = found * 8.0 * pi * pi * beta2 * sinr / (c * c);
        let difference = 0.5 * ((1.0 + f64::from(b) * j) / (1.0 + f64::from(a) * j)).ln();
        assert!(difference > 1.0, "{difference}");
        let expected = choose(&candidates[..1], 1.0, None).entropy_nat - seeking.entropy_nat;
        assert!((f64::from(expected) - difference).abs() < 0.01 * difference, "{expected} {difference}");
        // At no price the shorter way wins: a metre, and another one to the goal.
        let straight = choose(&candidates, 0.0, Some([-1.0, 1.0]));
        assert_eq!((straight.index, straight.remaining_m, straight.cost_m), (0, 1.0, 2.0));
    }

    /// Where the range says nearly all along its direction, halving the distance divides its variance by four: ln 2 of
    /// entropy.
    #[test]
    fn half_as_far_from_a_source_that_was_seen_is_ln_2_less_of_entropy() {
        let state = state(fixed(1.0, 1.0));
        let library = library();
        let mut memory = Memory::new(ChannelMemorySettings::default(), 10.0, true, &library);
        see(&mut memory, 0, 10.0);
        let entropy = |candidate: [f32; 2], speed_m_s: f32| {
            let settings = WaypointSettings { speed_m_s, ..settings(1.0) };
            let visible = direct(&[[8.0, 0.0]], 0.0);
            let chosen = choose_waypoint(
                &[candidate],
                None,
                &settings,
                &state,
                |_| visible.iter().copied(),
                &memory,
                &library,
            );
            chosen.unwrap().entropy_nat
        };
        let difference = entropy([0.0, 0.0], 100.0) - entropy([4.0, 0.0], 100.0);
        assert!((difference - 2.0_f32.ln()).abs() < 2e-3, "{difference}");
        // Sixteen looks from the same place are worth a quarter of the distance: 2 ln 2.
        let difference = entropy([0.0, 0.0], 1e-3) - entropy([0.016, 0.0], 1e-3);
        assert!((difference - 4.0_f32.ln()).abs() < 3e-3, "{difference}");
    }

    /// Against the textbook: predict with F and Q as matrices, then one extended Kalman update per anchor in Joseph
    /// form, all in double precision.
    #[test]
    fn the_expected_entropy_is_that_of_an_extended_kalman_filter_on_the_way() {
        let library = library();
        let mut memory = Memory::new(ChannelMemorySettings::default(), 10.0, true, &library);
        let (anchors_m, height_m) = ([[4.0, 3.0], [-2.0, 5.0], [1.0, -6.0]], 1.3_f32);
        for (anchor, sinr) in [(0, 200.0), (1, 30.0), (2, 8.0)] {
            see(&mut memory, anchor, sinr);
        }
        let root = Matrix4::new(
            0.3_f32, 0.0, 0.0, 0.0, 0.1, 0.2, 0.0, 0.0, 0.05, -0.1, 0.4, 0.0, 0.1, 0.0, 0.1, 0.3,
        );
        let mut state = state(root * root.transpose());
        state.motion = motion(6.4);
        state.variance_inflation = 1.44;
        state.range_floor_m = 0.01;
        state.threshold = 6.0;
        state.position_m = [0.5, 0.25];
        let settings = WaypointSettings { speed_m_s: 0.7, period_s: 0.1, metres_per_nat: 1.0 };
        let pulse = state.radio.pulse(&LIBRARY_WIDE[0]);
        let mut spread = [f64::INFINITY, f64::NEG_INFINITY];
        // Nowhere more than 32 cycles from a candidate: every cycle is looked at.
        let goal = [0.9_f64, 0.5];
        let (mut candidates, mut ways) = (Vec::new(), Vec::new());
        for turn in 0..8 {
            let angle = core::f64::consts::TAU * f64::from(turn) / 8.0;
            let leg = [1.5 * angle.cos(), 1.5 * angle.sin()];
            let candidate = [(0.5 + leg[0]) as f32, (0.25 + leg[1]) as f32];
            // 1.5 m at 7 cm per cycle, and as fast to the goal.
            let from = [0.5, 0.25];
            let end = [from[0] + leg[0], from[1] + leg[1]];
            let remaining = (goal[0] - end[0]).hypot(goal[1] - end[1]);
            let onward = (remaining / 0.07).ceil() as usize;
            let part = |from: [f64; 2], to: [f64; 2], cycles: usize| {
                (1..=cycles).map(move |cycle| {
                    let share = cycle as f64 / cycles as f64;
                    [0, 1].map(|axis| from[axis] + share * (to[axis] - from[axis]))
                })
            };
            let places: Vec<_> = part(from, end, 22).chain(part(end, goal, onward)).collect();
            let dt = 0.1;
            let mut f = Matrix4::<f64>::identity();
            (f.m13, f.m24) = (dt, dt);
            let q = 6.4_f64;
            let (xx, xv, vv) = (q * dt * dt * dt / 3.0, q * dt * dt / 2.0, q * dt);
            #[rustfmt::skip]
            let noise = Matrix4::new(
                xx, 0.0, xv, 0.0,
                0.0, xx, 0.0, xv,
                xv, 0.0, vv, 0.0,
                0.0, xv, 0.0, vv,
            );
            let mut p = state.covariance.cast::<f64>();
            let mut entropies = Vec::new();
            for place in &places {
                p = f * p * f.transpose() + noise;
                for (anchor, [u, v]) in anchors_m.iter().enumerate() {
                    let source = Source::Direct { anchor };
                    let height = f64::from(height_m);
                    let length = |[x, y]: [f64; 2]| {
                        ((x - f64::from(*u)).powi(2) + (y - f64::from(*v)).powi(2) + height * height).sqrt()
                    };
                    let range = length(*place);
                    let compensation = (length(from) / range).powi(2);
                    let sinr = f64::from(memory.sinr(source, ACTION)) * compensation;
                    let found = f64::from(memory.visibility(source))
                        * f64::from(detection_probability(sinr as f32, 6.0));
                    let r = (1.44 * f64::from(pulse.range_variance_m2(1.0)) / sinr + 1e-4) / found;
                    let h = nalgebra::RowVector4::new(
                        (place[0] - f64::from(*u)) / range,
                        (place[1] - f64::from(*v)) / range,
                        0.0,
                        0.0,
                    );
                    let k = p * h.transpose() / ((h * p * h.transpose()).x + r);
                    let i = Matrix4::identity() - k * h;
                    p = i * p * i.transpose() + k * k.transpose() * r;
                }
                let tau_e = core::f64::consts::TAU * core::f64::consts::E;
                entropies.push(0.5 * (p.m11 * p.m22 - p.m12 * p.m21).ln() + tau_e.ln());
            }
            let (on_leg, after) = entropies.split_at(22);
            let integral = 1.5 * on_leg.iter().sum::<f64>() / 22.0
                + remaining * after.iter().sum::<f64>() / onward as f64;
            let lowest = entropies.iter().copied().fold(f64::INFINITY, f64::min);
            let expected = on_leg[21];
            let choose = |candidates: &[[f32; 2]], goal: Option<[f32; 2]>| {
                let visible = direct(&anchors_m, height_m);
                let visible = |_| visible.iter().copied();
                choose_waypoint(candidates, goal, &settings, &state, visible, &memory, &library).unwrap()
            };
            let ours = choose(&[candidate], None);
            assert!((f64::from(ours.entropy_nat) - expected).abs() < 1e-3, "{ours:?} {expected}");
            spread = [spread[0].min(expected), spread[1].max(expected)];
            candidates.push(candidate);
            ways.push((1.5 + remaining, integral, lowest));
            // All the candidates so far, at a metre per nat and metre.
            let lowest = ways.iter().map(|way| way.2).fold(f64::INFINITY, f64::min);
            let costs: Vec<f64> =
                ways.iter().map(|(length, integral, _)| length + integral - lowest * length).collect();
            let least = costs.iter().copied().fold(f64::INFINITY, f64::min);
            let ours = choose(&candidates, Some(goal.map(|coordinate| coordinate as f32)));
            assert!((f64::from(ours.cost_m) - least).abs() < 2e-3, "{ours:?} {costs:?}");
            assert!((costs[ours.index] - least).abs() < 2e-3, "{ours:?} {costs:?}");
        }
        // Where one goes matters here.
        assert!(spread[1] - spread[0] > 0.1, "{spread:?}");
    }

    /// Where a tag ends that goes as it is told, from (0, 0) to (6, 0), and after how many legs of 0.5 m; channels are
    /// those of free space, SINR 1000 at 1 m.
    fn walk(anchors_m: &[[f32; 2]], height_m: f32, metres_per_nat: f32) -> (usize, Vec<[f32; 2]>) {
        let (library, goal) = (library(), [6.0_f32, 0.0]);
        let mut state = state(Matrix4::from_diagonal(&Vector4::new(1e-4, 1e-4, 1e-2, 1e-2)));
        state.motion = motion(1.0);
        let settings = WaypointSettings { speed_m_s: 1.0, period_s: 0.1, metres_per_nat };
        let mut places = Vec::from([[0.0_f32, 0.0]]);
        for leg in 0..36 {
            let here = state.position_m;
            if distance_m(here, goal) < 0.01 {
                return (leg, places);
            }
            let mut memory = Memory::new(ChannelMemorySettings::default(), 10.0, true, &library);
            for (anchor, place) in anchors_m.iter().enumerate() {
                let distance = distance_m(here, *place);
                see(&mut memory, anchor, 1e3 / (distance * distance + height_m * height_m));
            }
            let mut candidates: Vec<[f32; 2]> = (0..8)
                .map(|turn| {
                    let angle = core::f32::consts::TAU * turn as f32 / 8.0;
                    [here[0] + 0.5 * angle.cos(), here[1] + 0.5 * angle.sin()]
                })
                .collect();
            if distance_m(here, goal) < 0.5 {
                candidates.push(goal);
            }
            let visible = direct(anchors_m, height_m);
            let visible = |_| visible.iter().copied();
            let choice =
                choose_waypoint(&candidates, Some(goal), &settings, &state, visible, &memory, &library);
            state.position_m = candidates[choice.unwrap().index];
            places.push(state.position_m);
        }
        (usize::MAX, places)
    }

    /// An anchor beside the way is a hollow in the entropy: a tag goes nearer to it if that is worth it, but does not
    /// stay.
    #[test]
    fn a_tag_bends_towards_anchors_but_arrives_at_any_price() {
        let anchors_m = [[3.0, 2.0], [0.0, 6.0], [6.0, 6.0]];
        let north = |places: &[[f32; 2]]| places.iter().map(|place| place[1]).fold(0.0, f32::max);
        let (legs, places) = walk(&anchors_m, 0.5, 0.0);
        assert!(legs == 12 && north(&places) < 0.01, "{legs} {places:?}");
        let (legs, places) = walk(&anchors_m, 0.5, 1.0);
        assert!(legs <= 16 && north(&places) > 0.3, "{legs} {places:?}");
        for metres_per_nat in [5.0, 50.0] {
            let (legs, places) = walk(&anchors_m, 0.5, metres_per_nat);
            assert!(legs <= 24 && north(&places) > 0.3, "{metres_per_nat}: {legs} {places:?}");
        }
    }

    /// Next to an anchor nothing is expected of it, however strong it is there.
    #[test]
    fn nobody_is_sent_into_an_anchor() {
        let library = library();
        let mut memory = Memory::new(ChannelMemorySettings::default(), 10.0, true, &library);
        see(&mut memory, 0, 100.0);
        let state = state(fixed(1.0, 1.0));
        let entropy = |x: f32, height_m: f32| {
            let settings = WaypointSettings { speed_m_s: 100.0, ..settings(1.0) };
            let visible = direct(&[[2.0, 0.0]], height_m);
            let visible = |_| visible.iter().copied();
            choose_waypoint(&[[x, 0.0]], None, &settings, &state, visible, &memory, &library)
                .unwrap()
                .entropy_nat
        };
        // The prior of 1 m on both axes.
        let prior = position_entropy_nat(&Matrix2::new(1.0, 0.0, 0.0, 1.0));
        assert!((entropy(1.6, 0.0) - prior).abs() < 1e-5);
        assert!(entropy(1.4, 0.0) < prior - 1.0);
        // Below one that hangs high enough there is nothing to fear.
        assert!(entropy(1.6, 0.6) < prior - 1.0);
    }

    #[test]
    fn bad_input_is_named() {
        let library = library();
        let memory = Memory::new(ChannelMemorySettings::default(), 10.0, true, &library);
        let good = settings(1.0);
        let tag = state(fixed(1.0, 1.0));
        let asked =
            |candidates: &[[f32; 2]], goal, settings: &WaypointSettings, tag: &PlanningState, action| {
                let visible = direct(&[[3.0, 0.0]], 0.0);
                let visible = |_| visible.iter().map(|(sight, _)| (*sight, action));
                choose_waypoint(candidates, goal, settings, tag, visible, &memory, &library)
            };
        let one = [[1.0, 1.0]];
        assert_eq!(asked(&[], None, &good, &tag, 0), Err(WaypointError::NoCandidates));
        let many = [[0.0, 0.0]; MOST_CANDIDATES + 1];
        assert_eq!(asked(&many, None, &good, &tag, 0), Err(WaypointError::TooManyCandidates { given: 33 }));
        assert!(asked(&many[1..], None, &good, &tag, 0).is_ok());
        for bad in [f32::NAN, f32::INFINITY, -1.1e4] {
            let candidates = [[0.0, 1.0], [bad, 0.0]];
            assert_eq!(asked(&candidates, None, &good, &tag, 0), Err(WaypointError::Candidate { index: 1 }));
            assert_eq!(asked(&one, Some([0.0, bad]), &good, &tag, 0), Err(WaypointError::Goal));
        }
        for bad in [f32::NAN, 0.0, -1.0, 101.0, f32::INFINITY] {
            let settings = WaypointSettings { speed_m_s: bad, ..good };
            assert_eq!(asked(&one, None, &settings, &tag, 0), Err(WaypointError::Speed));
        }
        for bad in [f32::NAN, 0.0, -1.0, 3601.0] {
            let settings = WaypointSettings { period_s: bad, ..good };
            assert_eq!(asked(&one, None, &settings, &tag, 0), Err(WaypointError::Period));
        }
        for bad in [f32::NAN, -1.0, f32::INFINITY] {
            assert_eq!(asked(&one, None, &settings(bad), &tag, 0), Err(WaypointError::Weight));
        }
        let crawling = WaypointSettings { speed_m_s: 1e-3, period_s: f32::MIN_POSITIVE, ..good };
        assert_eq!(asked(&one, None, &crawling, &tag, 0), Err(WaypointError::TooFar { index: 0 }));
        let far = [[0.5, 0.5], [0.0, 1002.0]];
        assert_eq!(asked(&far, None, &good, &tag, 0), Err(WaypointError::TooFar { index: 1 }));
        assert_eq!(asked(&one, None, &good, &tag, 40), Err(WaypointError::Action));
        let lost = state(fixed(f32::NAN, 1.0));
        assert_eq!(asked(&one, None, &good, &lost, 0), Err(WaypointError::Start));
    }

    #[test]
    fn a_tracker_that_does_not_know_where_it_is_says_so() {
        let anchors = [Anchor { position_m: [0.0, 0.0], height_m: 0.0 }];
        let start = Start { position_m: [4.0, 0.0], position_std_m: 0.3, velocity_std_m_s: 1.0 };
        let config = Config { start, ..Config::default() };
        let library = &LIBRARY_PUBLISHED;
        let mut tracker = Tracker::<1, 1, 1, 1, 4, 40, 16, 0, 6>::new();
        tracker.start(&config, &anchors, &Map::default(), library, 1).unwrap();
        let ask = |tracker: &Tracker<1, 1, 1, 1, 4, 40, 16, 0, 6>| {
            tracker.choose_waypoint(&[[1.0, 0.0]], None, None, &settings(1.0))
        };
        assert!(ask(&tracker).is_ok());
        // Nothing is heard, and the tag may be anywhere.
        assert!((0..20).any(|_| tracker.cycle(&[], 1.0, None).unwrap().searching));
        assert_eq!(ask(&tracker), Err(WaypointError::Searching));
    }
}
