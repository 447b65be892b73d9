//! A tracker and the controller that steers it, cycle by cycle through a simulation.

use super::choice::{Bandit, Choose, Decided, OfTheCore, Random, Seen};
use super::on_memory::{OnMemory, Reading};
use super::truth::{Actions, action_of};
use super::{ABLATIONS, Controller, full_band};
use crate::input_error::InputError;
use crate::recording::Recording;
use crate::replay::{Setup, SizedTracker, Step, input, step};
use crate::simulator::Simulator;
use std::path::Path;

/// Time from the last cycle to the one after it that never comes, seconds.
const AFTER_THE_LAST_S: f64 = 0.1;

/// A tracker and the controller that steers it. A clone goes on from the same cycle on its own.
pub struct Steered<const A: usize> {
    /// The tracker.
    pub tracker: Box<SizedTracker<A>>,
    chooser: Box<dyn Choose<A>>,
    /// The actions of the next cycle.
    next: Actions,
    /// Number of actions there are.
    actions: usize,
    /// Whether it is told the SINR of every carrier.
    full_band: bool,
    /// What the tracker knew before it started.
    before: Recording,
}

impl<const A: usize> Clone for Steered<A> {
    fn clone(&self) -> Self {
        Self {
            tracker: self.tracker.clone(),
            chooser: self.chooser.again(),
            next: self.next.clone(),
            actions: self.actions,
            full_band: self.full_band,
            before: self.before.clone(),
        }
    }
}

/// A cycle of a steered tracker.
#[derive(Clone, Debug)]
pub struct SteeredCycle {
    /// The actions it was received with.
    pub actions: Actions,
    /// What the tracker made of it.
    pub step: Step,
    /// Distance from the true position, metres.
    pub error_m: f64,
}

impl<const A: usize> Steered<A> {
    /// A controller and its fresh tracker; the genie needs its actions.
    ///
    /// # Errors
    /// The core refuses the set-up, which would be a defect.
    pub fn new(
        simulator: &Simulator,
        setup: &Setup,
        controller: Controller,
        genie: &[Actions],
    ) -> Result<Self, InputError> {
        let actions = setup.actions.len();
        let mut setup = setup.clone();
        match controller {
            Controller::Cognitive | Controller::FullBand => {}
            Controller::Ablated(index) => {
                if let Some((_, change)) = ABLATIONS.get(index) {
                    change(&mut setup.config.controller);
                }
            }
            _ => setup.config.controller.planned_actions = 0,
        }
        let chooser: Box<dyn Choose<A>> = match controller {
            Controller::Fixed | Controller::Cognitive | Controller::FullBand | Controller::Ablated(_) => {
                Box::new(OfTheCore)
            }
            Controller::Random => Box::new(Random::new(setup.seed)),
            Controller::Bandit => Box::new(Bandit::new(actions)),
            Controller::Greedy => Box::new(OnMemory::new(Reading::Guess)),
            Controller::Ucb => Box::new(OnMemory::new(Reading::Optimist)),
            Controller::Thompson => Box::new(OnMemory::new(Reading::sample(setup.seed))),
            Controller::Genie | Controller::GeniePerAnchor => Box::new(Decided { actions: genie.to_vec() }),
        };
        let tracker = setup.tracker::<A>().map_err(|error| refused(simulator, error))?;
        let first = simulator.channel().receiver().first_action;
        let next = genie.first().cloned().unwrap_or(vec![first]);
        let full_band = controller == Controller::FullBand;
        Ok(Self { tracker, chooser, next, actions, full_band, before: simulator.before() })
    }

    /// Receives a cycle and chooses the action of the next; cycles must be taken in order, from the first.
    ///
    /// # Errors
    /// The core refuses the cycle, which would be a defect.
    pub fn cycle(&mut self, simulator: &Simulator, cycle: usize) -> Result<SteeredCycle, InputError> {
        let channel = simulator.channel();
        let poses = channel.poses();
        if self.full_band {
            full_band::tell(&mut self.tracker, channel, cycle).map_err(|error| refused(simulator, error))?;
        }
        let received = simulator.cycle_with(cycle, |anchor| action_of(&self.next, anchor));
        let previous_s = cycle.checked_sub(1).map(|previous| poses[previous].time_s);
        let step = step(&mut self.tracker, &input(&self.before, &received, previous_s), &mut ())
            .map_err(|error| refused(simulator, error))?;
        let ([x, y], [u, v]) = (poses[cycle].position_m, step.report.position_m);
        let next = poses.get(cycle + 1);
        let chosen = self.chooser.next(&Seen {
            tracker: &self.tracker,
            report: &step.report,
            actions: self.actions,
            elapsed_s: next.map_or(AFTER_THE_LAST_S, |next| next.time_s - poses[cycle].time_s),
            tag_height_m: channel.tag_height_m(cycle),
        });
        let actions = std::mem::replace(&mut self.next, chosen);
        Ok(SteeredCycle { actions, step, error_m: (x - f64::from(u)).hypot(y - f64::from(v)) })
    }
}

fn refused(simulator: &Simulator, error: cogmint_core::Error) -> InputError {
    InputError::new(Path::new(&simulator.channel().scenario().name), error.to_string())
}
