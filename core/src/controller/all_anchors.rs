//! The controllers of all anchors: one for each, or one for all.

use super::planning::{Planner, PlanningState, Visible};
use super::{Controller, ControllerSettings, Outcome};
use crate::error::{Error, Setting};
use crate::model::channel::ChannelKnowledge;
use crate::perceptor::scan::Scan;
use crate::radio::library::Library;
use crate::radio::link::LinkStatus;
use crate::snapshot::{Reader, Sink, SnapshotError, Stored, Told, Written};
use heapless::Vec;

/// One controller for each anchor, or one for all, and who answered of late.
#[derive(Clone, Debug)]
pub struct Controllers<const ANCHORS: usize, const ACTIONS: usize> {
    controllers: Vec<Controller<ACTIONS>, ANCHORS>,
    anchors: usize,
    links: LinkStatus<ANCHORS>,
}

/// What was decided for the next cycle. Where each anchor has its own action, these are the first one's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Decision {
    /// Index of the action that this cycle's frames were received with.
    pub applied: usize,
    /// Index of the next action.
    pub next: usize,
    /// Index of the action after that, where choices are announced.
    pub announced: Option<usize>,
}

impl<const ANCHORS: usize, const ACTIONS: usize> Controllers<ANCHORS, ACTIONS> {
    /// Controllers of `anchors` anchors that know nothing yet.
    pub fn start(
        &mut self,
        settings: ControllerSettings,
        anchors: usize,
        library: &Library<ACTIONS>,
        seed: u64,
    ) {
        self.clear();
        self.anchors = anchors;
        let own = if settings.per_anchor { anchors } else { 1 };
        for index in 0..own {
            let seed = seed ^ (index as u64).wrapping_mul(0xd1b5_4a32_d192_ed03);
            // No more than anchors: the push succeeds.
            let _ = self.controllers.push(Controller::new(settings, library.all(), seed));
        }
    }

    /// None, of no anchors: to be started.
    pub const fn empty() -> Self {
        Self { controllers: Vec::new(), anchors: 0, links: LinkStatus::empty() }
    }

    /// None again.
    pub fn clear(&mut self) {
        self.controllers.clear();
        self.anchors = 0;
        self.links = LinkStatus::empty();
    }

    /// That of all randomness.
    pub fn seed(&self) -> u64 {
        self.controllers.first().map_or(0, Controller::seed)
    }

    /// Learns from a cycle that earned this, plans and decides. `sources` are those expected to be visible.
    #[inline(never)]
    #[allow(clippy::too_many_arguments)] // each is one thing that a choice depends on
    pub fn decide<const PATHS: usize>(
        &mut self,
        earned: f32,
        is_searching: bool,
        is_lost: impl Fn(usize) -> bool,
        scans: &Vec<Scan<PATHS>, ANCHORS>,
        state: &PlanningState,
        sources: impl Iterator<Item = Visible> + Clone,
        channel: &impl ChannelKnowledge,
        library: &Library<ACTIONS>,
    ) -> Decision {
        self.links.enter(|anchor| scans.iter().any(|scan| scan.anchor == anchor));
        let is_common = self.controllers.len() == 1;
        let mut first_applied = 0;
        for index in 0..self.controllers.len() {
            let mut held = [0; ANCHORS];
            for (held, controller) in held.iter_mut().zip(&self.controllers) {
                *held = controller.held();
            }
            let Some(controller) = self.controllers.get_mut(index) else { break };
            let is_own = move |anchor: usize| is_common || anchor == index;
            let own = scans.iter().filter(|scan| is_own(scan.anchor));
            // An action with which none of its anchors is heard may be the reason.
            let lost = (0..self.anchors).filter(|anchor| is_own(*anchor)).all(&is_lost);
            let framed = own.clone().find(|scan| scan.is_framed());
            let heard = own.count() > 0;
            let called = is_common && self.links.calls(self.anchors);
            // The reward belongs to the action received with, which need not be the one that was asked for.
            let applied = framed.map_or(controller.action_index(), |scan| scan.action);
            // While the tag is looked for, no measurement is taken: what a cycle earns then says nothing of its action.
            let earned = (!is_searching && heard).then_some(earned);
            let planner = Planner::new(controller.horizon(), state, channel, library);
            let others = sources.clone().filter_map(|sight| {
                let anchor = sight.source.anchor();
                if is_own(anchor) { None } else { Some((sight, *held.get(anchor)?)) }
            });
            let given = planner.ahead(others);
            let visible = sources.clone().filter(|sight| is_own(sight.source.anchor()));
            let outcome = Outcome { applied, earned, heard, elapsed_s: state.elapsed_s, lost, called };
            controller.decide(&outcome, &planner, visible, &given);
            if index == 0 {
                first_applied = applied;
            }
        }
        let first = self.controllers.first();
        Decision {
            applied: first_applied,
            next: first.map_or(0, Controller::action_index),
            announced: first.and_then(Controller::announced),
        }
    }

    /// Narrows what may be chosen for `anchor`: see [`Controller::restrict`].
    ///
    /// # Errors
    /// There is no such anchor or action, or nothing that was allowed is left, or not the rendezvous; nothing has changed
    /// then.
    pub fn restrict(
        &mut self,
        anchor: usize,
        actions: &[usize],
        library: &Library<ACTIONS>,
    ) -> Result<(), Error> {
        if anchor >= self.anchors {
            return Err(Error::UnknownAnchor { anchor });
        }
        if let Some(&action) = actions.iter().find(|action| library.get(**action).is_none()) {
            return Err(Error::UnknownAction { action });
        }
        let index = self.index(anchor);
        let narrowed = self.controllers.get_mut(index).is_some_and(|controller| controller.restrict(actions));
        if narrowed { Ok(()) } else { Err(Error::Configuration(Setting::Restriction)) }
    }

    /// The controller that chooses for an anchor: its own, or the one for all; `None` for an anchor there is not.
    pub fn of(&self, anchor: usize) -> Option<&Controller<ACTIONS>> {
        if anchor >= self.anchors {
            return None;
        }
        self.controllers.get(self.index(anchor))
    }

    fn index(&self, anchor: usize) -> usize {
        if self.controllers.len() == 1 { 0 } else { anchor }
    }

    /// All controllers.
    pub fn all(&self) -> &[Controller<ACTIONS>] {
        &self.controllers
    }

    /// Whether all of them are sound.
    pub(crate) fn is_sound(&self) -> bool {
        self.controllers.iter().all(Controller::is_sound)
    }

    /// They forget everything but what they were told.
    pub(crate) fn reset(&mut self) {
        self.controllers.iter_mut().for_each(Controller::reset);
        self.links = LinkStatus::empty();
    }

    /// Who answered of late.
    pub fn links(&self) -> &LinkStatus<ANCHORS> {
        &self.links
    }
}

impl<const ANCHORS: usize, const ACTIONS: usize> Written for Controllers<ANCHORS, ACTIONS> {
    fn write(&self, to: &mut impl Sink) {
        let Self { controllers, anchors: _, links } = self;
        controllers.iter().for_each(|controller| controller.write(to));
        links.write(to);
    }
}

/// There are as many as were told.
impl<const ANCHORS: usize, const ACTIONS: usize> Stored for Controllers<ANCHORS, ACTIONS> {
    fn read(&mut self, from: &mut Reader<'_>) -> Result<(), SnapshotError> {
        let Self { controllers, anchors: _, links } = self;
        controllers.iter_mut().try_for_each(|controller| controller.read(from))?;
        links.read(from)
    }
}

impl<const ANCHORS: usize, const ACTIONS: usize> Told for Controllers<ANCHORS, ACTIONS> {
    fn write_told(&self, to: &mut impl Sink) {
        let Self { controllers, anchors, links: _ } = self;
        anchors.write(to);
        // With its length, which state that is written has not.
        if to.list(controllers.len(), ANCHORS) {
            controllers.iter().for_each(|controller| controller.write_told(to));
        }
    }
}
