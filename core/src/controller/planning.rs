//! Planning: what each action would earn, by the filter's own model.
//!
//! For every planned action the agent's covariance is carried ahead, step by step: prediction, then the
//! information of all sources expected visible at the predicted position, with range variances from the channel
//! memory at that action, times the probability that the path is found at all. Geometry does not depend on the action:
//! it is computed once for a batch of them.
//! The same action is held over the horizon; its rewards are discounted by gamma^(l-1) and normalised.
//!
//! Where every anchor has an action of its own, one anchor's is planned at a time, and the others' paths are given.

use super::reward::{Reward, reward};
use crate::information::fisher::{PositionInformation, range_slope};
use crate::model::channel::ChannelKnowledge;
use crate::model::detection::missed_odds;
use crate::model::motion::{Motion, MotionStep};
use crate::model::source::Source;
use crate::radio::Radio;
use crate::radio::library::Library;
use crate::real::{SPEED_OF_LIGHT_M_S, exp, larger, sqrt};
use heapless::Vec;
use nalgebra::{Matrix2, Matrix4};

/// A source expected to be visible.
#[derive(Clone, Copy, Debug)]
pub struct Visible {
    /// Which one.
    pub source: Source,
    /// Its position, metres.
    pub position_m: [f32; 2],
    /// Its height above the tag, metres.
    pub height_m: f32,
    /// Covariance of its position, square metres.
    pub covariance_m2: Matrix2<f32>,
    /// Probability that the plan lets its path through to where the tag is; 1 without a plan.
    pub availability: f32,
}

/// Where planning starts from.
#[derive(Clone, Copy, Debug)]
pub struct PlanningState {
    /// Position of the tag, metres.
    pub position_m: [f32; 2],
    /// Velocity of the tag, m/s.
    pub velocity_m_s: [f32; 2],
    /// Covariance of position and velocity.
    pub covariance: Matrix4<f32>,
    /// Length of a cycle, seconds.
    pub elapsed_s: f32,
    /// How the tag moves.
    pub motion: Motion,
    /// Factor on the single-path bound of a range's variance.
    pub variance_inflation: f32,
    /// Standard deviation that no range goes below, metres.
    pub range_floor_m: f32,
    /// The same that comes on top for paths, pulse lengths.
    pub range_floor_pulses: f32,
    /// The radio.
    pub radio: Radio,
    /// Threshold on the normalised energy of a path below which it is not found.
    pub threshold: f32,
}

/// Capacity: longest horizon, cycles; it bounds memory and time.
pub const LONGEST_HORIZON: usize = 16;
/// Capacity: actions that are planned at a time; it bounds the scratch memory.
const BATCH: usize = 8;

/// A source as it will be seen, steps ahead.
#[derive(Clone, Copy)]
struct View {
    slope: [f32; 2],
    /// Variance that a range has at any SINR, square metres.
    rest_m2: f32,
}

/// What is planned for.
#[derive(Clone, Copy, Debug)]
pub struct Horizon {
    /// Steps ahead, cycles: 1 to 16.
    pub steps: usize,
    /// Discount gamma per step.
    pub discount: f32,
    /// What is earned.
    pub reward: Reward,
}

/// Information about the position in each of the next cycles.
pub type Ahead = [PositionInformation; LONGEST_HORIZON];

/// What holds for all actions planned.
#[derive(Clone, Copy)]
pub struct Planner<'a, C, const ACTIONS: usize> {
    horizon: Horizon,
    state: &'a PlanningState,
    /// The motion over one cycle.
    step: MotionStep,
    threshold_root: f32,
    channel: &'a C,
    library: &'a Library<ACTIONS>,
}

/// What a path tells at one action, whatever the geometry.
struct PathQuality {
    /// Visibility x availability x SINR.
    found: f32,
    /// 1 / P_d.
    odds: f32,
    /// Variance of a range at SINR 1, square metres.
    unit_m2: f32,
    /// Variance that a range has at any SINR with this action, square metres.
    floor_m2: f32,
    sinr: f32,
}

impl PathQuality {
    /// A path tells something only if it is found: P_d / (unit / SINR + rest + floor), 1/m^2.
    #[inline(always)]
    fn weight(&self, view: &View) -> f32 {
        self.found / (self.odds * (self.unit_m2 + (view.rest_m2 + self.floor_m2) * self.sinr))
    }
}

impl<'a, C: ChannelKnowledge, const ACTIONS: usize> Planner<'a, C, ACTIONS> {
    /// Looks that far from there, by what is known of the channels at these actions.
    pub fn new(
        horizon: Horizon,
        state: &'a PlanningState,
        channel: &'a C,
        library: &'a Library<ACTIONS>,
    ) -> Self {
        let threshold_root = sqrt(larger(state.threshold, 0.0));
        let step = state.motion.step(state.elapsed_s);
        Self { horizon, state, step, threshold_root, channel, library }
    }

    /// Discounted, normalised rewards of the actions in `planned`, each for all of `visible`; zero for the others. `given`
    /// is what is learned whichever is taken.
    pub fn plan(
        &self,
        planned: &[bool; ACTIONS],
        visible: impl Iterator<Item = Visible> + Clone,
        given: &Ahead,
    ) -> [f32; ACTIONS] {
        let mut rewards = [0.0; ACTIONS];
        let mut batch: Vec<usize, BATCH> = Vec::new();
        for (action, _) in planned.iter().enumerate().filter(|(_, wanted)| **wanted) {
            // Never full here: the push succeeds.
            let _ = batch.push(action);
            if batch.is_full() {
                self.plan_batch(&batch, visible.clone(), given, &mut rewards);
                batch.clear();
            }
        }
        self.plan_batch(&batch, visible, given, &mut rewards);
        rewards
    }

    /// What each of these sources will tell with its action.
    pub fn ahead(&self, sources: impl Iterator<Item = (Visible, usize)>) -> Ahead {
        let mut ahead = [PositionInformation::default(); LONGEST_HORIZON];
        if ACTIONS < 2 {
            return ahead; // There is nothing to plan.
        }
        let mut views = Vec::new();
        for (sight, action) in sources {
            self.look_ahead(&sight, &mut views);
            let quality = self.quality(&sight, action, self.variances_m2(action));
            for (sum, view) in ahead.iter_mut().zip(&views) {
                sum.add_weighted(view.slope, quality.weight(view));
            }
        }
        ahead
    }

    #[inline(never)]
    fn plan_batch(
        &self,
        batch: &Vec<usize, BATCH>,
        visible: impl Iterator<Item = Visible>,
        given: &Ahead,
        rewards: &mut [f32; ACTIONS],
    ) {
        let mut variances_m2 = [[0.0; 2]; BATCH];
        for (variances_m2, &action) in variances_m2.iter_mut().zip(batch) {
            *variances_m2 = self.variances_m2(action);
        }
        let mut information = given.map(|sum| [sum; BATCH]);
        let mut views = Vec::new();
        for sight in visible {
            self.look_ahead(&sight, &mut views);
            for (place, (&action, &variances_m2)) in batch.iter().zip(&variances_m2).enumerate() {
                let quality = self.quality(&sight, action, variances_m2);
                for (sums, view) in information.iter_mut().zip(&views) {
                    if let Some(sum) = sums.get_mut(place) {
                        sum.add_weighted(view.slope, quality.weight(view));
                    }
                }
            }
        }
        for (place, &action) in batch.iter().enumerate() {
            let sums = information.iter().filter_map(|sums| sums.get(place)).take(self.horizon.steps);
            if let Some(reward) = rewards.get_mut(action) {
                *reward = discounted(sums, &self.horizon, &self.state.covariance, &self.step);
            }
        }
    }

    /// Variance of a range at SINR 1, which SINR then divides, and what comes on top at any.
    fn variances_m2(&self, action: usize) -> [f32; 2] {
        self.library.get(action).map_or([0.0; 2], |entry| {
            let pulse = self.state.radio.pulse(entry);
            let floor_m = self.state.range_floor_pulses * (pulse.duration_s * SPEED_OF_LIGHT_M_S);
            [self.state.variance_inflation * pulse.range_variance_m2(1.0), floor_m * floor_m]
        })
    }

    #[inline(always)]
    fn quality(&self, sight: &Visible, action: usize, [unit_m2, floor_m2]: [f32; 2]) -> PathQuality {
        let root = exp(0.5 * self.channel.sinr_ln(sight.source, action));
        let sinr = root * root;
        PathQuality {
            found: self.channel.visibility(sight.source) * sight.availability * sinr,
            odds: 1.0 + missed_odds(root, self.threshold_root),
            unit_m2,
            floor_m2,
            sinr,
        }
    }

    /// How a source will be seen in each of the cycles to the horizon.
    fn look_ahead(&self, sight: &Visible, views: &mut Vec<View, LONGEST_HORIZON>) {
        let state = self.state;
        let floor_m2 = state.range_floor_m * state.range_floor_m;
        let ([x, y], [vx, vy]) = (state.position_m, state.velocity_m_s);
        let [ax, ay] = sight.position_m;
        let c = &sight.covariance_m2;
        views.clear();
        let (mut x, mut y, mut vx, mut vy) = (x - ax, y - ay, vx, vy);
        for _ in 0..self.horizon.steps.min(LONGEST_HORIZON) {
            (x, y) = (x + self.step.drift_s * vx, y + self.step.drift_s * vy);
            (vx, vy) = (self.step.decay * vx, self.step.decay * vy);
            let slope = range_slope([x, y], sight.height_m);
            let [ux, uy] = slope;
            let map_m2 = ux * ux * c.m11 + 2.0 * (ux * uy) * c.m21 + uy * uy * c.m22;
            // As many as the horizon is long: the push succeeds.
            let _ = views.push(View { slope, rest_m2: floor_m2 + map_m2 });
        }
    }
}

/// Mean reward of a covariance that gets this information step by step, discounted by gamma^(l-1).
fn discounted<'a>(
    information: impl Iterator<Item = &'a PositionInformation>,
    horizon: &Horizon,
    covariance: &Matrix4<f32>,
    step: &MotionStep,
) -> f32 {
    let mut covariance = *covariance;
    let (mut total, mut weight, mut weights) = (0.0, 1.0, 0.0);
    for sum in information {
        let predicted = step.predicted(&covariance);
        let posterior = sum.posterior(&predicted);
        total += weight * reward(horizon.reward, &covariance, &predicted, &posterior);
        weights += weight;
        weight *= horizon.discount;
        covariance = posterior;
    }
    total / larger(weights, 1e-6)
}
