//! Reward, learning, planning and the next action.

use super::Tracker;
use super::receive::Scan;
use crate::anchor::Anchor;
use crate::controller::planning::{Outlook, Scene, Visible};
use crate::controller::reward::reward;
use crate::controller::{Controller, Outcome};
use crate::error::{Error, Setting};
use crate::information::entropy::{position_block, position_entropy_nat};
use crate::memory::environment::{CONFIRMED, EnvironmentMemory};
use crate::perceptor::state_filter::{Source, StateFilter};
use crate::report::CycleReport;
use heapless::Vec;
use nalgebra::{Matrix2, Matrix4};

/// Covariance of position and velocity on its way through a cycle.
pub(super) struct Covariances {
    /// After the last cycle.
    pub(super) previous: Matrix4<f32>,
    /// After the prediction.
    pub(super) predicted: Matrix4<f32>,
    /// After the update.
    pub(super) posterior: Matrix4<f32>,
}

impl<const ANCHORS: usize, const VAS: usize, const PATHS: usize, const ACTIONS: usize>
    Tracker<ANCHORS, VAS, PATHS, ACTIONS>
{
    /// Reward, learning, planning and the next action.
    #[inline(never)]
    pub(super) fn act(
        &mut self,
        covariances: &Covariances,
        elapsed_s: f32,
        tag_height_m: Option<f32>,
        scans: &Vec<Scan<PATHS>, ANCHORS>,
        report: &mut CycleReport,
    ) {
        let Covariances { previous, predicted, posterior } = covariances;
        let earned = reward(self.config.controller.reward, previous, predicted, posterior);
        let outlook = Outlook {
            position_m: self.filter.position_m(),
            velocity_m_s: self.filter.velocity_m_s(),
            covariance: *posterior,
            elapsed_s,
            acceleration_std_m_s2: self.config.motion.acceleration_std_m_s2,
            variance_inflation: self.config.ranging.variance_inflation,
            range_floor_m: self.config.ranging.floor_m,
            radio: self.config.radio,
            threshold: self.estimator.threshold(),
        };
        self.roll.enter(|anchor| scans.iter().any(|scan| scan.anchor == anchor));
        let sources = visible(&self.anchors, &self.environment, &self.filter, tag_height_m);
        let is_common = self.controllers.len() == 1;
        for index in 0..self.controllers.len() {
            let mut held = [0; ANCHORS];
            for (held, controller) in held.iter_mut().zip(&self.controllers) {
                *held = controller.held();
            }
            let Some(controller) = self.controllers.get_mut(index) else { return };
            let is_own = move |anchor: usize| is_common || anchor == index;
            let own = scans.iter().filter(|scan| is_own(scan.anchor));
            let framed = own.clone().find(|scan| scan.framed);
            let heard = own.count() > 0;
            let called = is_common && self.roll.calls(self.anchors.len());
            // The reward belongs to the action received with, which need not be the one that was asked for.
            let applied = framed.map_or(controller.action_index(), |scan| scan.action);
            // While the tag is looked for, no measurement is taken: what a cycle earns then says nothing of its action.
            let earned = (!report.acquiring && heard).then_some(earned);
            let scene = Scene::new(controller.horizon(), &outlook, &self.channel, &self.library);
            let others = sources.clone().filter_map(|sight| {
                let anchor = sight.source.anchor();
                if is_own(anchor) { None } else { Some((sight, *held.get(anchor)?)) }
            });
            let given = scene.expect(others);
            let visible = sources.clone().filter(|sight| is_own(sight.source.anchor()));
            let outcome = Outcome { applied, earned, heard, lost: report.acquiring, called };
            controller.decide(&outcome, &scene, visible, &given);
            if index == 0 {
                report.action = applied;
            }
        }
        report.position_m = self.filter.position_m();
        report.position_covariance_m2 = position_block(posterior);
        report.predicted_entropy_nat = position_entropy_nat(&position_block(predicted));
        report.entropy_nat = position_entropy_nat(&position_block(posterior));
        report.reward = earned;
        if let Some(controller) = self.controllers.first() {
            report.next_action = controller.action_index();
            report.announced_action = controller.announced();
        }
        if let Some(next) = self.library.get(report.next_action) {
            report.next = *next;
        }
    }

    /// Narrows what may be chosen for `anchor` to these actions of the library: what its radio can do, or may. Where all
    /// anchors share one choice, it is narrowed for all. To be called before the first cycle: an action that is no longer
    /// allowed gives way at once, which the other end of the link is not told.
    ///
    /// # Errors
    /// There is no such anchor or action, or nothing that was allowed is left, or not the rendezvous; nothing has changed
    /// then.
    pub fn restrict(&mut self, anchor: usize, actions: &[usize]) -> Result<(), Error> {
        if anchor >= self.anchors.len() {
            return Err(Error::UnknownAnchor { anchor });
        }
        if let Some(&action) = actions.iter().find(|action| self.library.get(**action).is_none()) {
            return Err(Error::UnknownAction { action });
        }
        let index = self.controller_index(anchor);
        let narrowed = self.controllers.get_mut(index).is_some_and(|controller| controller.restrict(actions));
        if narrowed { Ok(()) } else { Err(Error::Configuration(Setting::Restriction)) }
    }

    /// The controller that chooses for an anchor: its own, or the one for all; `None` for an anchor there is not.
    pub fn controller_of(&self, anchor: usize) -> Option<&Controller<ACTIONS>> {
        if anchor >= self.anchors.len() {
            return None;
        }
        self.controllers.get(self.controller_index(anchor))
    }

    fn controller_index(&self, anchor: usize) -> usize {
        if self.controllers.len() == 1 { 0 } else { anchor }
    }

    /// Index of the action that the next frame of an anchor should use; that of the first for an anchor there is not.
    pub(super) fn next_action(&self, anchor: usize) -> usize {
        let own = self.controllers.get(self.controller_index(anchor)).or(self.controllers.first());
        own.map_or(0, Controller::action_index)
    }

    /// The sources planning counts on, seen from a tag of this height.
    pub(crate) fn sources(&self, tag_height_m: Option<f32>) -> impl Iterator<Item = Visible> + Clone + '_ {
        visible(&self.anchors, &self.environment, &self.filter, tag_height_m)
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
