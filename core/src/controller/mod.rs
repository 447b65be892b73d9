//! The controller: which carrier to listen to next.
//!
//! A single-state value function J over the action library. [`reward`] turns entropies into a reward, [`value`]
//! learns from the action applied and from planned ones, [`planning`] predicts rewards with the filter's own model
//! and the channel memory, [`mod@policy`] turns values into a choice. [`Controller`] does all of it, once per cycle.

pub mod library;
pub mod planning;
pub mod policy;
pub mod reward;
pub mod value;

use crate::config::ControllerSettings;
use crate::memory::channel::ChannelMemory;
use library::{Action, Library};
use planning::{Outlook, Visible, plan};
use policy::{choose, planned_set, policy};
use rand_core::SeedableRng;
use rand_xoshiro::Xoshiro128PlusPlus;
use value::ActionValues;

/// Values, policy and present action over a library of at most `ACTIONS` actions.
#[derive(Clone, Debug)]
pub struct Controller<const ACTIONS: usize> {
    settings: ControllerSettings,
    library: Library<ACTIONS>,
    seed: u64,
    decisions: u32,
    values: ActionValues<ACTIONS>,
    policy: [f32; ACTIONS],
    action: usize,
}

impl<const ACTIONS: usize> Controller<ACTIONS> {
    /// A controller that knows nothing yet and starts with the first action of its settings, which must be in the
    /// library. All its randomness follows from `seed`.
    pub fn new(settings: ControllerSettings, library: Library<ACTIONS>, seed: u64) -> Self {
        let values = ActionValues::default();
        let policy = policy(&values, library.len(), settings.choice.temperature_nat);
        Self { settings, seed, decisions: 0, policy, values, action: settings.first_action, library }
    }

    /// Learns what the action `applied` has `earned`, plans over a part of the library, and chooses the next action.
    pub fn decide<const ANCHORS: usize, const VAS: usize>(
        &mut self,
        applied: usize,
        earned: f32,
        outlook: &Outlook,
        visible: impl Iterator<Item = Visible> + Clone,
        memory: &ChannelMemory<ANCHORS, VAS, ACTIONS>,
    ) -> usize {
        let settings = self.settings;
        let count = self.library.len();
        // One generator per decision, from seed and number: randomness is no state to save.
        let mut rng = Xoshiro128PlusPlus::seed_from_u64(
            self.seed ^ u64::from(self.decisions).wrapping_mul(0x9e37_79b9_7f4a_7c15),
        );
        self.decisions = self.decisions.wrapping_add(1);
        self.values.learn(applied, earned, &self.policy, &settings.learning);
        self.policy = policy(&self.values, count, settings.choice.temperature_nat);
        if settings.planned_actions == 0 || count < 2 {
            return self.action;
        }
        let keep = [self.action, self.values.best(count)];
        let planned = planned_set(&self.policy, count, settings.planned_actions, keep, &mut rng);
        let (horizon, discount) = (settings.horizon, settings.learning.discount);
        let rewards =
            plan(&planned, horizon, discount, settings.reward, outlook, visible, memory, &self.library);
        for (action, (&reward, &wanted)) in rewards.iter().zip(&planned).enumerate() {
            if wanted {
                self.values.learn(action, reward, &self.policy, &settings.learning);
            }
        }
        self.policy = policy(&self.values, count, settings.choice.temperature_nat);
        self.action = choose(&self.values, &self.policy, count, self.action, &settings.choice, &mut rng);
        self.action
    }

    /// The library.
    pub fn library(&self) -> &Library<ACTIONS> {
        &self.library
    }

    /// Index of the present action.
    pub fn action_index(&self) -> usize {
        self.action
    }

    /// The present action; `None` only where the first one configured is not in the library.
    pub fn action(&self) -> Option<&Action> {
        self.library.get(self.action)
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
