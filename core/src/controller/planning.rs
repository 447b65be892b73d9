//! Planning: what each action would earn, by the filter's own model.
//!
//! For every planned action the agent's covariance is carried ahead, step by step: prediction, then the
//! information of all sources expected visible at the predicted position, with range variances from the channel
//! memory at that action. Geometry does not depend on the action, so each step computes it once for all.
//! The same action is held over the horizon; its rewards are discounted by gamma^(l-1) and normalised.

use super::library::Library;
use super::reward::{Reward, reward};
use crate::information::fisher::{PositionInformation, range_slope};
use crate::memory::channel::ChannelMemory;
use crate::perceptor::state_filter::{Source, predict_agent};
use crate::pulse::{Pulse, PulseShape};
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
}

/// Where planning starts from.
#[derive(Clone, Copy, Debug)]
pub struct Outlook {
    /// Position of the tag, metres.
    pub position_m: [f32; 2],
    /// Velocity of the tag, m/s.
    pub velocity_m_s: [f32; 2],
    /// Covariance of position and velocity.
    pub covariance: Matrix4<f32>,
    /// Length of a cycle, seconds.
    pub elapsed_s: f32,
    /// Standard deviation of the acceleration, m/s^2.
    pub acceleration_std_m_s2: f32,
    /// Factor on the single-path bound of a range's variance.
    pub variance_inflation: f32,
    /// Standard deviation that no range goes below, metres.
    pub range_floor_m: f32,
    /// Shape of the pulse.
    pub pulse_shape: PulseShape,
}

/// Discounted, normalised rewards of the actions in `planned`; zero for the others.
#[allow(clippy::too_many_arguments)] // each argument is one thing the plan depends on
pub fn plan<const ANCHORS: usize, const VAS: usize, const ACTIONS: usize>(
    planned: &[bool; ACTIONS],
    horizon: usize,
    discount: f32,
    kind: Reward,
    outlook: &Outlook,
    visible: impl Iterator<Item = Visible> + Clone,
    memory: &ChannelMemory<ANCHORS, VAS, ACTIONS>,
    library: &Library<ACTIONS>,
) -> [f32; ACTIONS] {
    let mut rewards = [0.0; ACTIONS];
    let mut covariances = [outlook.covariance; ACTIONS];
    let floor = outlook.range_floor_m * outlook.range_floor_m;
    // Range variance at SINR 1, which SINR then divides.
    let mut unit_variances = [0.0; ACTIONS];
    for (action, unit) in unit_variances.iter_mut().enumerate() {
        if let Some(entry) = library.get(action) {
            let pulse = Pulse { duration_s: entry.pulse_duration_s, shape: outlook.pulse_shape };
            *unit = outlook.variance_inflation * pulse.range_variance_m2(1.0);
        }
    }
    let mut weight = 1.0;
    let mut weights = 0.0;
    for step in 1..=horizon {
        let ahead_s = step as f32 * outlook.elapsed_s;
        let [x, y] = outlook.position_m;
        let [vx, vy] = outlook.velocity_m_s;
        let (x, y) = (x + ahead_s * vx, y + ahead_s * vy);
        let mut information = [PositionInformation::default(); ACTIONS];
        for sight in visible.clone() {
            let [ax, ay] = sight.position_m;
            let slope = range_slope([x - ax, y - ay], sight.height_m);
            let [ux, uy] = slope;
            let c = &sight.covariance_m2;
            let map = ux * ux * c.m11 + 2.0 * (ux * uy) * c.m21 + uy * uy * c.m22;
            for (action, ((sum, unit), wanted)) in
                information.iter_mut().zip(&unit_variances).zip(planned).enumerate()
            {
                if *wanted {
                    let sinr = memory.sinr(sight.source, action);
                    sum.add(slope, unit / sinr + floor + map);
                }
            }
        }
        weights += weight;
        let rows = rewards.iter_mut().zip(&mut covariances).zip(&information).zip(planned);
        for (((total, covariance), sum), wanted) in rows {
            if *wanted {
                let predicted = predict_agent(covariance, outlook.elapsed_s, outlook.acceleration_std_m_s2);
                let posterior = sum.posterior(&predicted);
                *total += weight * reward(kind, covariance, &predicted, &posterior);
                *covariance = posterior;
            }
        }
        weight *= discount;
    }
    if weights > 0.0 {
        for total in &mut rewards {
            *total /= weights;
        }
    }
    rewards
}
