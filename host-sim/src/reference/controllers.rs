//! The choices for all anchors: one for each, or one for all.

use super::channel_memory::ChannelMemory;
use super::controller::{Controller, Library, Outcome, Outlook, Prospect, Visible};
use super::real::Real;
use super::receiver::{Link, Scan};
use cogmint_core::config::ControllerSettings;
use cogmint_core::radio::link::{CALL, CALL_AGAIN, LOST_FRAMES};

/// The controllers.
#[derive(Clone, Debug)]
pub struct Controllers<T> {
    /// One for each anchor, or one for all.
    pub all: Vec<Controller<T>>,
    anchors: usize,
    /// Cycles in a row in which an anchor was not heard.
    pub missing: Vec<u32>,
}

/// What was decided.
#[derive(Clone, Copy, Debug)]
pub struct Decision {
    /// The action that the first controller's anchors were received with.
    pub applied: usize,
    /// The action of their next frame.
    pub next: usize,
}

impl<T: Real> Controllers<T> {
    /// For so many anchors; `[anchors, actions]` there is room for.
    pub fn new(
        settings: ControllerSettings,
        anchors: usize,
        library: &Library<T>,
        seed: u64,
        room: [usize; 2],
    ) -> Self {
        let controller = |index: usize| {
            let seed = seed ^ (index as u64).wrapping_mul(0xd1b5_4a32_d192_ed03);
            Controller::new(settings, library, room[1], seed)
        };
        let choices = if settings.per_anchor { anchors } else { 1 };
        Self { all: (0..choices).map(controller).collect(), anchors, missing: vec![0; room[0]] }
    }

    /// The controller that chooses for an anchor.
    pub fn of(&self, anchor: usize) -> &Controller<T> {
        &self.all[if self.all.len() == 1 { 0 } else { anchor }]
    }

    /// The link to every anchor.
    pub fn links(&self, is_lost: impl Fn(usize) -> bool) -> Vec<Link> {
        let link = |anchor: usize| {
            let Controller { action, held, sought_with, .. } = *self.of(anchor);
            Link { expected: action, held, sought_with, is_lost: is_lost(anchor) }
        };
        (0..self.anchors).map(link).collect()
    }

    /// Learns from cycle number `cycle`, which earned this, and chooses the actions of the next.
    #[allow(clippy::too_many_arguments)] // values of as many stages
    pub fn decide(
        &mut self,
        cycle: u32,
        earned: T,
        searching: bool,
        out: &[bool],
        scans: &[&Scan<T>],
        outlook: &Outlook<T>,
        visible: &[Visible<T>],
        memory: &ChannelMemory<T>,
        library: &Library<T>,
    ) -> Decision {
        let common = self.all.len() == 1;
        for (anchor, missing) in self.missing.iter_mut().enumerate() {
            let answered = scans.iter().any(|scan| scan.anchor == anchor);
            *missing = if answered { 0 } else { missing.saturating_add(1) };
        }
        let is_called =
            |&missing: &u32| missing >= LOST_FRAMES && (missing - LOST_FRAMES) % CALL_AGAIN < CALL;
        let called = common && self.missing[..self.anchors].iter().any(is_called);
        let mut decision = Decision { applied: self.all[0].action, next: 0 };
        for index in 0..self.all.len() {
            let of_own = |anchor: usize| common || anchor == index;
            let own: Vec<_> = scans.iter().filter(|scan| of_own(scan.anchor)).collect();
            // The action received with earns the reward: of the first, where frames differ.
            let framed = own.iter().find(|scan| scan.frame.is_some());
            let heard = !own.is_empty();
            let lost =
                searching || (0..self.anchors).filter(|&anchor| of_own(anchor)).all(|anchor| out[anchor]);
            let outcome = Outcome {
                applied: framed.map_or(self.all[index].action, |scan| scan.action),
                earned: (heard && !searching).then_some(earned),
                heard,
                elapsed_s: outlook.elapsed_s,
                lost,
                called,
            };
            let with = |source: &Visible<T>| (*source, self.of(source.source.anchor()).held);
            let (own, others): (Vec<_>, Vec<_>) =
                visible.iter().partition(|visible| of_own(visible.source.anchor()));
            let prospect = Prospect {
                outlook,
                own: own.into_iter().copied().collect(),
                others: others.into_iter().map(with).collect(),
                memory,
                library,
            };
            self.all[index].decide(cycle, &outcome, &prospect);
            if index == 0 {
                decision.applied = outcome.applied;
            }
        }
        decision.next = self.all[0].action;
        decision
    }
}
