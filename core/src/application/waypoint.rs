//! Waypoints: which of several places to go to next, for information and for a goal.
//!
//! For each candidate the covariance of position and velocity is carried along the straight way there, a cycle at a time:
//! the state filter's own prediction, then the information of all sources expected to be visible from the place reached
//! by then. What is left on arrival is the expected entropy h of the position. With the distance r that remains from the
//! candidate to the goal (0 without a goal) a candidate costs
//!
//! r + metres_per_nat h, in metres,
//!
//! and the least cost wins, the first of equals. So `metres_per_nat` is the detour that one nat less is worth: 0 goes
//! straight to the goal, and without a goal any positive weight seeks information alone. One nat in two dimensions is a
//! deviation that is smaller by the factor e^(1/2) on both axes. Candidates should be about equally far away: a longer
//! way there is more cycles of measurements and more progress at once.
//!
//! SINRs come from the channel memory, at one action for each source. It knows them as they are at the present distance of tag and source;
//! from another place the power of the path is that of free space, SINR (present distance / distance there)^2, over
//! unchanged noise. Sources never observed have the memory's prior SINR, at every distance. No source comes into sight and
//! none goes out of it on the way: the memories hold no walls. As in [`crate::controller::planning`], a path counts by the
//! probability that it is visible and found, and correlations of tag and virtual anchors are left out.

use crate::controller::library::Library;
use crate::controller::planning::{Outlook, Visible};
use crate::cycle::Tracker;
use crate::information::entropy::{position_block, position_entropy_nat};
use crate::information::fisher::{PositionInformation, range_slope};
use crate::memory::channel::ChannelMemory;
use crate::perceptor::association::detection_probability;
use crate::perceptor::state_filter::predict_agent;
use crate::pulse::Pulse;
use crate::real::{abs, larger, sqrt};
use core::fmt;
use nalgebra::Matrix4;

/// Candidates per choice at most: what bounds its duration, with [`LONGEST_LEG_CYCLES`].
pub const MOST_CANDIDATES: usize = 32;
/// Cycles that the way to a candidate may take.
pub const LONGEST_LEG_CYCLES: u32 = 1000;
/// Coordinates of candidates and goal lie within this, metres, as those of anchors do.
const REACH_M: f32 = 1e4;
/// A leg longer than so many steps by less than this is not given another one, steps.
const ROUNDING: f32 = 1e-3;
/// Nearer than this, power no longer grows as in free space, metres.
const NEAREST_M: f32 = 0.1;

/// How a waypoint is chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct WaypointSettings {
    /// Speed of the tag on its way, m/s (1e-3 to 100).
    pub speed_m_s: f32,
    /// Time from cycle to cycle, seconds (above 0, at most 3600).
    pub period_s: f32,
    /// What one nat less of expected entropy is worth in metres nearer to the goal (0 to 1e6).
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
    /// What it costs: remaining_m + metres_per_nat entropy_nat, metres.
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
    /// Position or covariance to start from are not finite.
    Outlook,
    /// It is not known where the tag is: its covariance says nothing yet.
    Acquiring,
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
            Self::Outlook => write!(f, "position and covariance to start from are not finite"),
            Self::Acquiring => write!(f, "it is not known yet where the tag is"),
        }
    }
}

impl core::error::Error for WaypointError {}

/// Chooses one of `candidates` (positions, metres; 1 to [`MOST_CANDIDATES`]) on the way to `goal`, by what the memories
/// know. `visible` are the sources with the action each is received with; `outlook` is where the tag starts; its velocity and its length of a cycle are not used, since the way
/// is the one to the candidate and `settings` has the period.
///
/// # Errors
/// The first bad input.
pub fn choose_waypoint<const ANCHORS: usize, const VAS: usize, const ACTIONS: usize>(
    candidates: &[[f32; 2]],
    goal: Option<[f32; 2]>,
    settings: &WaypointSettings,
    outlook: &Outlook,
    visible: impl Iterator<Item = (Visible, usize)> + Clone,
    memory: &ChannelMemory<ANCHORS, VAS, ACTIONS>,
    library: &Library<ACTIONS>,
) -> Result<WaypointChoice, WaypointError> {
    check(candidates, goal, settings, outlook)?;
    if visible.clone().any(|(_, action)| library.get(action).is_none()) {
        return Err(WaypointError::Action);
    }
    let mut units_m2 = [0.0; ACTIONS];
    for (action, unit_m2) in units_m2.iter_mut().enumerate() {
        if let Some(entry) = library.get(action) {
            let pulse = Pulse { duration_s: entry.pulse_duration_s, shape: outlook.pulse_shape };
            *unit_m2 = outlook.variance_inflation * pulse.range_variance_m2(1.0);
        }
    }
    let ranging = Ranging {
        memory,
        units_m2,
        floor_m2: outlook.range_floor_m * outlook.range_floor_m,
        threshold: outlook.threshold,
    };
    let mut best: Option<WaypointChoice> = None;
    for (index, &candidate) in candidates.iter().enumerate() {
        let Some(cycles) = cycles_to(candidate, outlook.position_m, settings) else {
            return Err(WaypointError::TooFar { index });
        };
        let arrival = travel(candidate, cycles, settings.period_s, outlook, visible.clone(), &ranging);
        let entropy_nat = position_entropy_nat(&position_block(&arrival));
        let remaining_m = goal.map_or(0.0, |goal| distance_m(candidate, goal));
        let cost_m = remaining_m + settings.metres_per_nat * entropy_nat;
        if best.is_none_or(|best| cost_m < best.cost_m) {
            best = Some(WaypointChoice { index, entropy_nat, remaining_m, cost_m });
        }
    }
    best.ok_or(WaypointError::NoCandidates)
}

impl<const ANCHORS: usize, const VAS: usize, const PATHS: usize, const ACTIONS: usize>
    Tracker<ANCHORS, VAS, PATHS, ACTIONS>
{
    /// Chooses one of `candidates` (positions, metres) on the way to `goal`, by all that the tracker knows after its last
    /// cycle and with the carrier of the next one. Changes nothing.
    ///
    /// # Errors
    /// The first bad input, or [`WaypointError::Acquiring`] while it is not known where the tag is.
    pub fn choose_waypoint(
        &self,
        candidates: &[[f32; 2]],
        goal: Option<[f32; 2]>,
        tag_height_m: Option<f32>,
        settings: &WaypointSettings,
    ) -> Result<WaypointChoice, WaypointError> {
        if self.acquisition().is_some() {
            return Err(WaypointError::Acquiring);
        }
        let config = self.config();
        let outlook = Outlook {
            position_m: self.filter().position_m(),
            velocity_m_s: self.filter().velocity_m_s(),
            covariance: self.filter().agent_covariance(),
            elapsed_s: settings.period_s,
            acceleration_std_m_s2: config.motion.acceleration_std_m_s2,
            variance_inflation: config.ranging.variance_inflation,
            range_floor_m: config.ranging.floor_m,
            pulse_shape: config.radio.pulse_shape,
            threshold: self.threshold(),
        };
        let sources = self.sources(tag_height_m).filter_map(|sight| {
            let controller = self.controller_of(sight.source.anchor())?;
            Some((sight, controller.action_index()))
        });
        choose_waypoint(candidates, goal, settings, &outlook, sources, self.channel(), self.library())
    }
}

/// What ranges are worth.
struct Ranging<'a, const ANCHORS: usize, const VAS: usize, const ACTIONS: usize> {
    memory: &'a ChannelMemory<ANCHORS, VAS, ACTIONS>,
    /// Variance of a range at SINR 1, by action, square metres.
    units_m2: [f32; ACTIONS],
    floor_m2: f32,
    threshold: f32,
}

fn check(
    candidates: &[[f32; 2]],
    goal: Option<[f32; 2]>,
    settings: &WaypointSettings,
    outlook: &Outlook,
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
    let [x, y] = outlook.position_m;
    let known = abs(x) <= 1e6 && abs(y) <= 1e6 && outlook.covariance.iter().all(|entry| abs(*entry) <= 1e12);
    if known { Ok(()) } else { Err(WaypointError::Outlook) }
}

fn distance_m([x, y]: [f32; 2], [u, v]: [f32; 2]) -> f32 {
    sqrt((x - u) * (x - u) + (y - v) * (y - v))
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

/// Covariance of position and velocity on arrival at a candidate after so many cycles.
fn travel<const ANCHORS: usize, const VAS: usize, const ACTIONS: usize>(
    candidate: [f32; 2],
    cycles: u32,
    period_s: f32,
    outlook: &Outlook,
    visible: impl Iterator<Item = (Visible, usize)> + Clone,
    ranging: &Ranging<'_, ANCHORS, VAS, ACTIONS>,
) -> Matrix4<f32> {
    let ([x, y], [to_x, to_y]) = (outlook.position_m, candidate);
    let mut covariance = outlook.covariance;
    for cycle in 1..=cycles {
        let share = cycle as f32 / cycles as f32;
        let place_m = [x + share * (to_x - x), y + share * (to_y - y)];
        let predicted = predict_agent(&covariance, period_s, outlook.acceleration_std_m_s2);
        let mut information = PositionInformation::default();
        for (sight, action) in visible.clone() {
            ranging.add(&mut information, (&sight, action), outlook.position_m, place_m);
        }
        covariance = information.posterior(&predicted);
    }
    covariance
}

impl<const ANCHORS: usize, const VAS: usize, const ACTIONS: usize> Ranging<'_, ANCHORS, VAS, ACTIONS> {
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
        let mut sinr = self.memory.sinr(sight.source, action);
        if self.memory.has_seen(sight.source) {
            let squared = |place: [f32; 2]| {
                let distance = distance_m(place, sight.position_m);
                larger(distance * distance + sight.height_m * sight.height_m, NEAREST_M * NEAREST_M)
            };
            sinr *= squared(present_m) / squared(place_m);
        }
        // A path tells something only if it is found.
        let found = self.memory.visibility(sight.source) * detection_probability(sinr, self.threshold);
        let unit_m2 = self.units_m2.get(action).copied().unwrap_or(0.0);
        information.add(slope, (unit_m2 / sinr + self.floor_m2 + map_m2) / found);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Config;
    use crate::anchor::Anchor;
    use crate::controller::library::LIBRARY_PUBLISHED;
    use crate::perceptor::association::Measurement;
    use crate::perceptor::state_filter::Source;
    use crate::pulse::PulseShape;
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
            (Visible { source: Source::Direct { anchor }, position_m, height_m, covariance_m2 }, ACTION)
        };
        anchors_m.iter().enumerate().map(visible).collect()
    }

    fn outlook(covariance: Matrix4<f32>) -> Outlook {
        Outlook {
            position_m: [0.0, 0.0],
            velocity_m_s: [0.0, 0.0],
            covariance,
            elapsed_s: 1.0,
            acceleration_std_m_s2: 1e-6,
            variance_inflation: 1.0,
            range_floor_m: 0.0,
            pulse_shape: PulseShape::RootRaisedCosine { roll_off: 0.6 },
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
        for _ in 0..200 {
            let shares = memory.shares(ACTION, &library());
            memory.remember(Source::Direct { anchor }, ACTION, &shares, &path, 1.0);
        }
    }

    /// A position without velocity, which prediction leaves as it is.
    fn fixed(xx: f32, yy: f32) -> Matrix4<f32> {
        Matrix4::from_diagonal(&Vector4::new(xx, yy, 0.0, 0.0))
    }

    /// Prior variances a << b along x and y. At a candidate beside the anchor in y its range removes the variance of y:
    /// det = a / (1 / b + J); beside it in x that of x: det = b / (1 / a + J). The difference of entropies is
    /// 1/2 ln ((1 + b J) / (1 + a J)), and so is the weight at which a metre of detour is given up for it.
    #[test]
    fn the_place_that_sees_the_uncertain_direction_wins_where_the_closed_form_says_so() {
        let (a, b) = (1e-4_f32, 4e-2_f32);
        let outlook = outlook(fixed(a, b));
        let (memory, library) = (Memory::new(1e4, true, &library()), library());
        // Both candidates are a metre from the tag and from the anchor, which was never seen: the prior, everywhere.
        let anchor_m = [1.0, 1.0];
        let candidates = [[0.0, 1.0], [1.0, 0.0]];
        let goal = Some([-1.0, 1.0]);
        let choose = |metres_per_nat: f32, goal: Option<[f32; 2]>| {
            let visible = direct(&[anchor_m], 0.0);
            let settings = settings(metres_per_nat);
            choose_waypoint(&candidates, goal, &settings, &outlook, visible.into_iter(), &memory, &library)
                .unwrap()
        };
        let seeking = choose(1.0, None);
        assert_eq!((seeking.index, seeking.remaining_m), (1, 0.0));
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
        let remaining = 5_f64.sqrt() - 1.0;
        let turning = (remaining / difference) as f32;
        assert!(difference > 1.0, "{difference}");
        assert_eq!(choose(0.99 * turning, goal).index, 0);
        assert_eq!(choose(1.01 * turning, goal).index, 1);
        assert_eq!(choose(0.0, goal).cost_m, 1.0);
    }

    /// Where the range says nearly all along its direction, halving the distance divides its variance by four: ln 2 of
    /// entropy.
    #[test]
    fn half_as_far_from_a_source_that_was_seen_is_ln_2_less_of_entropy() {
        let outlook = outlook(fixed(1.0, 1.0));
        let library = library();
        let mut memory = Memory::new(10.0, true, &library);
        see(&mut memory, 0, 10.0);
        let entropy = |candidate: [f32; 2], speed_m_s: f32| {
            let settings = WaypointSettings { speed_m_s, ..settings(1.0) };
            let visible = direct(&[[8.0, 0.0]], 0.0);
            let chosen = choose_waypoint(
                &[candidate],
                None,
                &settings,
                &outlook,
                visible.into_iter(),
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

    /// Against the textbook: predict with F and Q as matrices, then one extended Kalman update per anchor in Joseph form,
    /// all in double precision.
    #[test]
    fn the_expected_entropy_is_that_of_an_extended_kalman_filter_on_the_way() {
        let library = library();
        let mut memory = Memory::new(10.0, true, &library);
        let (anchors_m, height_m) = ([[4.0, 3.0], [-2.0, 5.0], [1.0, -6.0]], 1.3_f32);
        for (anchor, sinr) in [(0, 200.0), (1, 30.0), (2, 8.0)] {
            see(&mut memory, anchor, sinr);
        }
        let root = Matrix4::new(
            0.3_f32, 0.0, 0.0, 0.0, 0.1, 0.2, 0.0, 0.0, 0.05, -0.1, 0.4, 0.0, 0.1, 0.0, 0.1, 0.3,
        );
        let mut outlook = outlook(root * root.transpose());
        outlook.acceleration_std_m_s2 = 0.8;
        outlook.variance_inflation = 1.44;
        outlook.range_floor_m = 0.01;
        outlook.threshold = 6.0;
        outlook.position_m = [0.5, 0.25];
        let settings = WaypointSettings { speed_m_s: 0.7, period_s: 0.1, metres_per_nat: 1.0 };
        let pulse = Pulse { duration_s: 0.5e-9, shape: outlook.pulse_shape };
        let mut spread = [f64::INFINITY, f64::NEG_INFINITY];
        for turn in 0..8 {
            let angle = core::f64::consts::TAU * f64::from(turn) / 8.0;
            let leg = [1.5 * angle.cos(), 1.5 * angle.sin()];
            let candidate = [(0.5 + leg[0]) as f32, (0.25 + leg[1]) as f32];
            // 1.5 m at 7 cm per cycle.
            let cycles = 22;
            let dt = 0.1;
            let mut f = Matrix4::<f64>::identity();
            (f.m13, f.m24) = (dt, dt);
            let g = nalgebra::Matrix4x2::new(0.5 * dt * dt, 0.0, 0.0, 0.5 * dt * dt, dt, 0.0, 0.0, dt);
            let mut p = outlook.covariance.cast::<f64>();
            for cycle in 1..=cycles {
                let share = f64::from(cycle) / f64::from(cycles);
                let place = [0.5 + share * leg[0], 0.25 + share * leg[1]];
                p = f * p * f.transpose() + g * g.transpose() * (0.8 * 0.8);
                for (anchor, [u, v]) in anchors_m.iter().enumerate() {
                    let source = Source::Direct { anchor };
                    let height = f64::from(height_m);
                    let length = |[x, y]: [f64; 2]| {
                        ((x - f64::from(*u)).powi(2) + (y - f64::from(*v)).powi(2) + height * height).sqrt()
                    };
                    let range = length(place);
                    let compensation = (length([0.5, 0.25]) / range).powi(2);
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
            }
            let tau_e = core::f64::consts::TAU * core::f64::consts::E;
            let expected = 0.5 * (p.m11 * p.m22 - p.m12 * p.m21).ln() + tau_e.ln();
            let visible = direct(&anchors_m, height_m);
            let ours = choose_waypoint(
                &[candidate],
                None,
                &settings,
                &outlook,
                visible.into_iter(),
                &memory,
                &library,
            )
            .unwrap();
            assert!((f64::from(ours.entropy_nat) - expected).abs() < 1e-3, "{ours:?} {expected}");
            spread = [spread[0].min(expected), spread[1].max(expected)];
        }
        // Where one goes matters here.
        assert!(spread[1] - spread[0] > 0.1, "{spread:?}");
    }

    #[test]
    fn bad_input_is_named() {
        let library = library();
        let memory = Memory::new(10.0, true, &library);
        let good = settings(1.0);
        let tag = outlook(fixed(1.0, 1.0));
        let asked = |candidates: &[[f32; 2]], goal, settings: &WaypointSettings, tag: &Outlook, action| {
            let visible = direct(&[[3.0, 0.0]], 0.0).into_iter().map(|(sight, _)| (sight, action));
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
        let lost = outlook(fixed(f32::NAN, 1.0));
        assert_eq!(asked(&one, None, &good, &lost, 0), Err(WaypointError::Outlook));
    }

    #[test]
    fn a_tracker_that_does_not_know_where_it_is_says_so() {
        let anchors = [Anchor { position_m: [0.0, 0.0], height_m: 0.0 }];
        let tracker =
            Tracker::<1, 1, 4, 40>::new(Config::default(), &anchors, &[], &LIBRARY_PUBLISHED, 1).unwrap();
        let answer = tracker.choose_waypoint(&[[1.0, 0.0]], None, None, &settings(1.0));
        assert_eq!(answer, Err(WaypointError::Acquiring));
    }
}
