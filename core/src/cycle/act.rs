//! Reward, learning, planning and the next action.

use super::Tracker;
use crate::anchor::Anchor;
use crate::controller::Outcome;
use crate::controller::planning::{Outlook, Visible};
use crate::controller::reward::reward;
use crate::information::entropy::{position_block, position_entropy_nat};
use crate::memory::environment::{CONFIRMED, EnvironmentMemory};
use crate::perceptor::state_filter::{Source, StateFilter};
use crate::report::CycleReport;
use heapless::Vec;
use nalgebra::{Matrix2, Matrix4};

impl<const ANCHORS: usize, const VAS: usize, const PATHS: usize, const ACTIONS: usize>
    Tracker<ANCHORS, VAS, PATHS, ACTIONS>
{
    /// Reward, learning, planning and the next action.
    #[inline(never)]
    pub(super) fn act(
        &mut self,
        previous: &Matrix4<f32>,
        predicted: &Matrix4<f32>,
        posterior: &Matrix4<f32>,
        (elapsed_s, heard): (f32, bool),
        tag_height_m: Option<f32>,
        report: &mut CycleReport,
    ) {
        let earned = reward(self.config.controller.reward, previous, predicted, posterior);
        let outlook = Outlook {
            position_m: self.filter.position_m(),
            velocity_m_s: self.filter.velocity_m_s(),
            covariance: *posterior,
            elapsed_s,
            acceleration_std_m_s2: self.config.motion.acceleration_std_m_s2,
            variance_inflation: self.config.ranging.variance_inflation,
            range_floor_m: self.config.ranging.floor_m,
            pulse_shape: self.config.radio.pulse_shape,
            threshold: self.estimator.threshold(),
        };
        let visible = visible(&self.anchors, &self.environment, &self.filter, tag_height_m);
        // While the tag is looked for, no measurement is taken: what a cycle earns then says nothing of its action.
        let learned = (!report.acquiring && heard).then_some(earned);
        let outcome = Outcome { applied: report.action, earned: learned, heard };
        report.next_action = self.controller.decide(&outcome, &outlook, visible, &self.channel);
        report.announced_action = self.controller.announced();
        report.position_m = self.filter.position_m();
        report.position_covariance_m2 = position_block(posterior);
        report.predicted_entropy_nat = position_entropy_nat(&position_block(predicted));
        report.entropy_nat = position_entropy_nat(&position_block(posterior));
        report.reward = earned;
        if let Some(next) = self.controller.action() {
            report.next = *next;
        }
    }
}

/// The sources planning counts on: all direct paths, and the virtual anchors that are confirmed.
pub(super) fn visible<'a, const ANCHORS: usize, const VAS: usize>(
    anchors: &'a Vec<Anchor, ANCHORS>,
    environment: &'a EnvironmentMemory<VAS>,
    filter: &'a StateFilter<ANCHORS, VAS>,
    tag_height_m: Option<f32>,
) -> impl Iterator<Item = Visible> + Clone + 'a {
    let height = move |anchor: &Anchor| tag_height_m.map_or(0.0, |height| anchor.height_m - height);
    let direct = anchors.iter().enumerate().map(move |(index, anchor)| Visible {
        source: Source::Direct { anchor: index },
        position_m: anchor.position_m,
        height_m: height(anchor),
        covariance_m2: Matrix2::new(0.0, 0.0, 0.0, 0.0),
    });
    let reflected = environment.iter().filter_map(move |(slot, record)| {
        if record.existence <= CONFIRMED {
            return None;
        }
        let (position, covariance_m2) = filter.virtual_anchor(slot)?;
        Some(Visible {
            source: Source::Virtual { anchor: record.anchor, slot },
            position_m: [position.x, position.y],
            height_m: height(anchors.get(record.anchor)?),
            covariance_m2,
        })
    });
    direct.chain(reflected)
}

impl<const ANCHORS: usize, const VAS: usize, const PATHS: usize, const ACTIONS: usize>
    Tracker<ANCHORS, VAS, PATHS, ACTIONS>
{
    /// The sources planning counts on, seen from a tag of this height.
    pub(crate) fn sources(&self, tag_height_m: Option<f32>) -> impl Iterator<Item = Visible> + Clone + '_ {
        visible(&self.anchors, &self.environment, &self.filter, tag_height_m)
    }

    /// Index of the action that the next frames should use.
    pub fn action_index(&self) -> usize {
        self.controller.action_index()
    }
}
