//! The controller: which carrier to listen to next.
//!
//! A single-state value function J over the action library. [`reward`] turns entropies into a reward, [`value`]
//! learns from the action applied and from planned ones, [`planning`] predicts rewards with the filter's own model
//! and the channel memory, [`mod@policy`] turns values into a choice, and [`hop`] brings both ends of the link there.
//! [`Controller`] does all of it, once per cycle.

pub mod hop;
pub mod library;
pub mod planning;
pub mod policy;
pub mod reward;
pub mod value;

use crate::config::ControllerSettings;
use crate::memory::channel::ChannelMemory;
use hop::Hop;
use library::{Action, Library};
use planning::{Horizon, Outlook, Visible, plan};
use policy::{explore, planned_set, policy, settle};
use rand_core::SeedableRng;
use rand_xoshiro::Xoshiro128PlusPlus;
use value::ActionValues;

/// What has become of a cycle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outcome {
    /// The action its frames were received with.
    pub applied: usize,
    /// Its reward; `None` where it told nothing of the action.
    pub earned: Option<f32>,
    /// Whether anything was received.
    pub heard: bool,
}

/// Values, policy and present action over a library of at most `ACTIONS` actions.
#[derive(Clone, Debug)]
pub struct Controller<const ACTIONS: usize> {
    settings: ControllerSettings,
    library: Library<ACTIONS>,
    seed: u64,
    decisions: u32,
    values: ActionValues<ACTIONS>,
    policy: [f32; ACTIONS],
    /// The action held; the one chosen differs from it while another is tried.
    held: usize,
    action: usize,
    /// Where choices are announced to the other end before they are used.
    hop: Option<Hop>,
    /// What the present action was planned to earn; `None` where it was not planned.
    planned_reward: Option<f32>,
}

impl<const ACTIONS: usize> Controller<ACTIONS> {
    /// A controller that knows nothing yet and starts with the first action of its settings, which must be in the
    /// library. All its randomness follows from `seed`.
    pub fn new(settings: ControllerSettings, library: Library<ACTIONS>, seed: u64) -> Self {
        let values = ActionValues::default();
        let policy = policy(&values, library.len(), settings.choice.temperature_nat);
        let action = settings.first_action;
        let hop = settings.rendezvous.map(|rendezvous| Hop::new(action, rendezvous));
        Self {
            settings,
            seed,
            decisions: 0,
            policy,
            values,
            held: action,
            action,
            hop,
            planned_reward: None,
            library,
        }
    }

    /// Learns from a cycle, plans over a part of the library, and chooses; returns the action of the next cycle, which is
    /// the one chosen, or the one announced before where choices are announced.
    pub fn decide<const ANCHORS: usize, const VAS: usize>(
        &mut self,
        outcome: &Outcome,
        outlook: &Outlook,
        visible: impl Iterator<Item = Visible> + Clone,
        memory: &ChannelMemory<ANCHORS, VAS, ACTIONS>,
    ) -> usize {
        self.choose(outcome, outlook, visible, memory);
        if let Some(hop) = &mut self.hop {
            if outcome.heard { hop.decide(self.action) } else { hop.miss() }
        }
        self.action_index()
    }

    fn choose<const ANCHORS: usize, const VAS: usize>(
        &mut self,
        outcome: &Outcome,
        outlook: &Outlook,
        visible: impl Iterator<Item = Visible> + Clone,
        memory: &ChannelMemory<ANCHORS, VAS, ACTIONS>,
    ) {
        let settings = self.settings;
        let count = self.library.len();
        // One generator per decision, from seed and number: randomness is no state to save.
        let mut rng = Xoshiro128PlusPlus::seed_from_u64(
            self.seed ^ u64::from(self.decisions).wrapping_mul(0x9e37_79b9_7f4a_7c15),
        );
        self.decisions = self.decisions.wrapping_add(1);
        if let (Some(earned), Some(planned)) = (outcome.earned, self.planned_reward)
            && outcome.applied == self.action
        {
            self.values.correct(self.action, earned - planned, &settings.learning);
        }
        self.policy = policy(&self.values, count, settings.choice.temperature_nat);
        if settings.planned_actions == 0 || count < 2 {
            return;
        }
        let keep = [self.held, self.values.best(count)];
        let planned = planned_set(&self.policy, count, settings.planned_actions, keep, &mut rng);
        let horizon = Horizon {
            steps: settings.horizon,
            discount: settings.learning.discount,
            reward: settings.reward,
        };
        let rewards = plan(&planned, &horizon, outlook, visible, memory, &self.library);
        let reward = |action: usize| rewards.get(action).copied().unwrap_or(0.0);
        let present = reward(self.held);
        for (action, _) in planned.iter().enumerate().filter(|(_, wanted)| **wanted) {
            self.values.learn(action, reward(action) - present, &self.policy, &settings.learning);
        }
        self.policy = policy(&self.values, count, settings.choice.temperature_nat);
        self.held = settle(&self.values, count, self.held, &settings.choice);
        self.values.relate_to(self.held);
        self.action = explore(&self.policy, count, &settings.choice, &mut rng).unwrap_or(self.held);
        // Exploration may take an action that was not planned.
        let known = planned.get(self.action).copied().unwrap_or(false);
        self.planned_reward = known.then(|| reward(self.action));
    }

    /// The library.
    pub fn library(&self) -> &Library<ACTIONS> {
        &self.library
    }

    /// Index of the action that the next frames use.
    pub fn action_index(&self) -> usize {
        self.hop.map_or(self.action, |hop| hop.present())
    }

    /// Index of the action that the next frame announces for the one after it; `None` where nothing is announced.
    pub fn announced(&self) -> Option<usize> {
        self.hop.map(|hop| hop.announced())
    }

    /// The action that the next frames use; `None` only where the first one configured is not in the library.
    pub fn action(&self) -> Option<&Action> {
        self.library.get(self.action_index())
    }

    /// What the action chosen was planned to earn; `None` where it was not planned.
    pub fn planned_reward(&self) -> Option<f32> {
        self.planned_reward
    }

    /// Every whole number of the state, for traces: the actions held, chosen, in use and announced, and the frames lost in a
    /// row, these last two 0 where nothing is announced.
    pub fn words(&self) -> [u32; 5] {
        let (held, chosen) = (self.held as u32, self.action as u32);
        match &self.hop {
            Some(hop) => [held, chosen, hop.present() as u32, hop.announced() as u32, hop.lost()],
            None => [held, chosen, chosen, 0, 0],
        }
    }

    /// The action values.
    pub fn values(&self) -> &ActionValues<ACTIONS> {
        &self.values
    }

    /// The policy: probabilities of the actions.
    pub fn policy(&self) -> &[f32; ACTIONS] {
        &self.policy
    }
}
