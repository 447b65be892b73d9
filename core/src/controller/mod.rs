//! The controller: which carrier to listen to next.
//!
//! A single-state value function J over the action library. [`reward`] turns entropies into a reward, [`value`]
//! learns from the action applied and from planned ones, [`planning`] predicts rewards with the filter's own model
//! and the channel memory, [`mod@policy`] turns values into a choice, and [`crate::radio::link`] brings both ends of the link there.
//! [`Controller`] does all of it, once per cycle: one for all anchors, or one for each.

pub mod planning;
pub mod policy;
pub mod reward;
pub mod value;

mod all_anchors;

pub use all_anchors::{Controllers, Decision};

use crate::model::channel::ChannelKnowledge;
use crate::radio::library::Allowed;
use crate::radio::link::Hop;
use crate::real::is_probability;
use crate::snapshot::{stored, written};
use planning::{Ahead, Horizon, Planner, Visible};
use policy::{Choice, LEAST_TURN_CYCLES, draw_other, explore, planned_set, policy, settle};
use rand_core::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro128PlusPlus;
use reward::Reward;
use value::{ActionValues, Learning};

/// How the next action is found.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ControllerSettings {
    /// What is maximised.
    pub reward: Reward,
    /// Learning rate and discount.
    pub learning: Learning,
    /// Temperature, exploration, hysteresis, patience.
    pub choice: Choice,
    /// Actions planned per cycle (0: none, the radio then never leaves its action; as many as the library has, or more: all).
    pub planned_actions: usize,
    /// Planning horizon, cycles (1 to 16).
    pub horizon: usize,
    /// The action of the first cycle.
    pub first_action: usize,
    /// SINR (linear) assumed of a source never observed, with the library's first action (0.01 to 1e6).
    pub prior_sinr: f32,
    /// Whether what is heard with an action also tells of those whose spectra it overlaps.
    pub neighbours: bool,
    /// Whether every anchor gets an action of its own, for links that can be tuned apart; without, all share one. Anchors
    /// whose pulses differ in duration cost an estimator built anew for each.
    pub per_anchor: bool,
    /// The action to go to after three lost frames. Where there is one, every choice is announced to the other end one
    /// cycle before it is used; without, it is used at once.
    pub rendezvous: Option<usize>,
}

/// What has become of a cycle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outcome {
    /// The action its frames were received with.
    pub applied: usize,
    /// Its reward; `None` where it told nothing of the action.
    pub earned: Option<f32>,
    /// Whether anything was received.
    pub heard: bool,
    /// How long it was, seconds.
    pub elapsed_s: f32,
    /// Whether it is not known where the tag is.
    pub lost: bool,
    /// Whether an anchor that shares the choice is to be met at the rendezvous, where there is one.
    pub called: bool,
}

/// Values, policy and present action over a library of at most `ACTIONS` actions.
#[derive(Clone, Debug)]
pub struct Controller<const ACTIONS: usize> {
    settings: ControllerSettings,
    allowed: Allowed<ACTIONS>,
    seed: u64,
    decisions: u32,
    values: ActionValues<ACTIONS>,
    policy: [f32; ACTIONS],
    /// The action held; the one chosen differs from it while another is tried.
    held: usize,
    chosen: usize,
    /// While the tag is lost: cycles and seconds of the present turn, and the action tried in it where it is not the one held.
    turn_cycles: u32,
    turn_s: f32,
    sought_with: Option<usize>,
    /// Where choices are announced to the other end before they are used.
    hop: Option<Hop>,
    /// What the present action was planned to earn; `None` where it was not planned.
    planned_reward: Option<f32>,
}

impl<const ACTIONS: usize> Controller<ACTIONS> {
    /// A controller that knows nothing yet and starts with the first action of its settings, which must be allowed. All its
    /// randomness follows from `seed`.
    pub fn new(settings: ControllerSettings, allowed: Allowed<ACTIONS>, seed: u64) -> Self {
        let values = ActionValues::default();
        let policy = policy(&values, &allowed, settings.choice.temperature_nat);
        let first = settings.first_action;
        let hop = settings.rendezvous.map(|rendezvous| Hop::new(first, rendezvous));
        Self {
            settings,
            allowed,
            seed,
            decisions: 0,
            policy,
            values,
            held: first,
            chosen: first,
            turn_cycles: 0,
            turn_s: 0.0,
            sought_with: None,
            hop,
            planned_reward: None,
        }
    }

    /// Learns from a cycle, plans over a part of the library, and chooses the action of the next cycle, which is the one
    /// chosen, or the one announced before where choices are announced. `visible` are the sources received with it,
    /// `given` is what the others will tell.
    pub fn decide(
        &mut self,
        outcome: &Outcome,
        planner: &Planner<'_, impl ChannelKnowledge, ACTIONS>,
        visible: impl Iterator<Item = Visible> + Clone,
        given: &Ahead,
    ) {
        self.choose(outcome, planner, visible, given);
        if let Some(hop) = &mut self.hop {
            let next = if outcome.called { hop.rendezvous() } else { self.chosen };
            if outcome.heard { hop.decide(next) } else { hop.miss() }
        }
    }

    fn choose(
        &mut self,
        outcome: &Outcome,
        planner: &Planner<'_, impl ChannelKnowledge, ACTIONS>,
        visible: impl Iterator<Item = Visible> + Clone,
        given: &Ahead,
    ) {
        let settings = self.settings;
        // One generator per decision, from seed and number: randomness is no state to save.
        let mut rng = Xoshiro128PlusPlus::seed_from_u64(
            self.seed ^ u64::from(self.decisions).wrapping_mul(0x9e37_79b9_7f4a_7c15),
        );
        self.decisions = self.decisions.wrapping_add(1);
        if let (Some(earned), Some(planned)) = (outcome.earned, self.planned_reward)
            && outcome.applied == self.chosen
        {
            self.values.correct(self.chosen, earned - planned, &settings.learning);
        }
        if !outcome.lost
            && let Some(found_with) = self.sought_with.take()
            && outcome.heard
            && outcome.applied == found_with
        {
            self.held = found_with;
        }
        self.policy = policy(&self.values, &self.allowed, settings.choice.temperature_nat);
        let alternatives = self.allowed.iter().filter(|allowed| **allowed).count();
        if ACTIONS < 2 || settings.planned_actions == 0 || alternatives < 2 {
            return;
        }
        let keep = [self.held, self.values.best(&self.allowed)];
        let planned = planned_set(&self.policy, &self.allowed, settings.planned_actions, keep, &mut rng);
        let rewards = planner.plan(&planned, visible, given);
        let reward = |action: usize| rewards.get(action).copied().unwrap_or(0.0);
        let present = reward(self.held);
        for (action, _) in planned.iter().enumerate().filter(|(_, wanted)| **wanted) {
            self.values.learn(action, reward(action) - present, &self.policy, &settings.learning);
        }
        self.policy = policy(&self.values, &self.allowed, settings.choice.temperature_nat);
        // What is heard while the tag is lost need not be what would find it: a turn is not cut short.
        if self.sought_with.is_none() {
            self.held = settle(&self.values, &self.allowed, self.held, &settings.choice);
        }
        self.values.relate_to(self.held, &self.allowed);
        let explored = explore(&self.policy, &self.allowed, &settings.choice, outcome.elapsed_s, &mut rng);
        self.seek(outcome, &mut rng);
        self.chosen = self.sought_with.or(explored).unwrap_or(self.held);
        // Exploration may take an action that was not planned.
        let known = planned.get(self.chosen).copied().unwrap_or(false);
        self.planned_reward = known.then(|| reward(self.chosen));
    }

    /// A tag that is lost in spite of the best action may be so because of it: in turn, it is sought with another. Where
    /// nothing at all is heard with that, its turn ends all the same.
    fn seek(&mut self, outcome: &Outcome, rng: &mut impl Rng) {
        let patience_s = self.settings.choice.patience_s;
        if !outcome.lost {
            (self.turn_cycles, self.turn_s) = (0, 0.0);
        } else if patience_s > 0.0 && (outcome.heard || self.sought_with.is_some()) {
            self.turn_cycles += 1;
            self.turn_s += outcome.elapsed_s;
            if self.turn_cycles >= LEAST_TURN_CYCLES && self.turn_s >= patience_s {
                (self.turn_cycles, self.turn_s) = (0, 0.0);
                self.sought_with = match self.sought_with {
                    None => draw_other(&self.allowed, self.held, rng),
                    Some(_) => None,
                };
            }
        }
    }

    /// How far and for what it plans.
    pub fn horizon(&self) -> Horizon {
        let ControllerSettings { horizon, reward, learning, .. } = self.settings;
        Horizon { steps: horizon, discount: learning.discount, reward }
    }

    /// Forbids every action but these. One that is in use gives way to the first that is left; where none is, or the
    /// rendezvous is not among them, nothing changes and the answer is false.
    pub fn restrict(&mut self, actions: &[usize]) -> bool {
        let mut left = self.allowed;
        for (action, allowed) in left.iter_mut().enumerate() {
            *allowed &= actions.contains(&action);
        }
        let is_left = |action: usize| left.get(action).copied().unwrap_or(false);
        let Some(first) = left.iter().position(|allowed| *allowed) else { return false };
        if self.settings.rendezvous.is_some_and(|rendezvous| !is_left(rendezvous)) {
            return false;
        }
        let announced = self.announced().unwrap_or(self.chosen);
        let in_use = [self.held, self.chosen, self.action_index(), announced];
        if !in_use.into_iter().all(is_left) {
            (self.held, self.chosen, self.planned_reward) = (first, first, None);
            self.hop = self.settings.rendezvous.map(|rendezvous| Hop::new(first, rendezvous));
        }
        self.allowed = left;
        (self.turn_cycles, self.turn_s, self.sought_with) = (0, 0.0, None);
        self.policy = policy(&self.values, &self.allowed, self.settings.choice.temperature_nat);
        true
    }

    /// Whether finite numbers are what they may be, and actions those that are allowed.
    pub(crate) fn is_sound(&self) -> bool {
        let is_allowed = |action: usize| self.allowed.get(action) == Some(&true);
        let in_use = [self.held, self.chosen, self.action_index(), self.announced().unwrap_or(self.chosen)];
        in_use.into_iter().chain(self.sought_with).all(is_allowed)
            && self.policy.iter().all(|probability| is_probability(*probability))
            && self.turn_s >= 0.0
    }

    /// Forgets everything but what it was told.
    #[inline(never)]
    pub(crate) fn reset(&mut self) {
        let first = self.settings.first_action;
        *self = Self::new(self.settings, self.allowed, self.seed);
        if self.allowed.get(first) != Some(&true)
            && let Some(first) = self.allowed.iter().position(|allowed| *allowed)
        {
            (self.held, self.chosen) = (first, first);
            self.hop = self.settings.rendezvous.map(|rendezvous| Hop::new(first, rendezvous));
        }
    }

    /// That of its randomness.
    pub fn seed(&self) -> u64 {
        self.seed
    }

    /// The actions it may choose.
    pub fn allowed(&self) -> &Allowed<ACTIONS> {
        &self.allowed
    }

    /// Index of the action held, which the next frames use unless another is tried or announced.
    pub fn held(&self) -> usize {
        self.held
    }

    /// The action that a lost tag is sought with in place of the one held; `None` where it is that one, or the tag not lost.
    pub fn sought_with(&self) -> Option<usize> {
        self.sought_with
    }

    /// Index of the action that the next frames use.
    pub fn action_index(&self) -> usize {
        self.hop.map_or(self.chosen, |hop| hop.present())
    }

    /// Index of the action that the next frame announces for the one after it; `None` where nothing is announced.
    pub fn announced(&self) -> Option<usize> {
        self.hop.map(|hop| hop.announced())
    }

    /// What the action chosen was planned to earn; `None` where it was not planned.
    pub fn planned_reward(&self) -> Option<f32> {
        self.planned_reward
    }

    /// Every whole number of the state, for traces: the actions held, chosen, in use and announced, and the frames lost in a
    /// row (these last two 0 where nothing is announced); the cycles of the present turn of a search, and the action it is
    /// for, counted from 1, 0 where it is the one held.
    pub fn words(&self) -> [u32; 7] {
        let (held, chosen) = (self.held as u32, self.chosen as u32);
        let (present, announced, lost_frames) = match &self.hop {
            Some(hop) => (hop.present() as u32, hop.announced() as u32, hop.lost()),
            None => (chosen, 0, 0),
        };
        let sought_with = self.sought_with.map_or(0, |action| action as u32 + 1);
        [held, chosen, present, announced, lost_frames, self.turn_cycles, sought_with]
    }

    /// Seconds of the present turn of a search.
    pub fn turn_s(&self) -> f32 {
        self.turn_s
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

stored!(
    Controller<const ACTIONS> {
        decisions, values, policy, held, chosen, turn_cycles, turn_s, sought_with, hop, planned_reward
    }
    told { settings, allowed, seed }
);
written!(ControllerSettings {
    reward,
    learning,
    choice,
    planned_actions,
    horizon,
    first_action,
    prior_sinr,
    neighbours,
    per_anchor,
    rendezvous
});

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Config;

    #[test]
    fn a_lost_tag_is_sought_with_the_action_held_and_with_others_in_turn() {
        // As long as fifteen cycles, give or take rounding.
        let mut settings = Config::default().controller;
        settings.choice.patience_s = 1.4;
        let mut controller = Controller::new(settings, [true, false, true], 1);
        let patience = LEAST_TURN_CYCLES as usize;
        let mut rng = Xoshiro128PlusPlus::seed_from_u64(1);
        let lost =
            Outcome { applied: 0, earned: None, heard: true, elapsed_s: 0.1, lost: true, called: false };
        for cycle in 1..5 * patience {
            if controller.sought_with.is_none() {
                // What nobody answers says nothing of the action held.
                controller.seek(&Outcome { heard: false, ..lost }, &mut rng);
            }
            controller.seek(&lost, &mut rng);
            let elsewhere = if (cycle / patience) % 2 == 1 { Some(2) } else { None };
            assert_eq!(controller.sought_with, elsewhere, "{cycle}");
        }
        // Nor is the radio stuck where nobody answers.
        (0..patience).for_each(|_| controller.seek(&lost, &mut rng));
        assert_eq!(controller.sought_with, Some(2));
        (0..patience).for_each(|_| controller.seek(&Outcome { heard: false, ..lost }, &mut rng));
        assert_eq!(controller.sought_with, None);
    }

    #[test]
    fn what_is_forbidden_gives_way_and_is_never_chosen_again() {
        let settings =
            ControllerSettings { rendezvous: Some(1), first_action: 3, ..Config::default().controller };
        let mut controller = Controller::new(settings, [true, true, true, true, false], 1);
        assert!(!controller.restrict(&[]) && !controller.restrict(&[4]) && !controller.restrict(&[0, 2]));
        assert_eq!((controller.held(), controller.allowed()), (3, &[true, true, true, true, false]));
        assert!(controller.restrict(&[1, 2, 3, 4]));
        assert_eq!(controller.held(), 3);
        assert!(controller.restrict(&[2, 1]));
        assert_eq!((controller.held(), controller.action_index(), controller.announced()), (1, 1, Some(1)));
        assert_eq!(controller.allowed(), &[false, true, true, false, false]);
        let [zero, half, other, three, four] = *controller.policy();
        assert!(zero + three + four == 0.0 && (half + other - 1.0).abs() < 1e-6);
    }
}
