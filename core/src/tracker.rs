//! The tracker: the perception-action cycle over all stages.
//!
//! Every stage takes values and its own state and returns a value. [`Tracker`] holds the states; [`Tracker::finish`] is the
//! cycle, in the order of its diagram: receive, estimate, predict, expect, associate, update, remember, reward, learn, plan,
//! act.

mod entries;
pub mod joining;
mod stages;
mod start;
mod state;
mod values;

use self::stages::{Heard, associate, expect, locate, look_through, remember, revise_map};
use self::values::{Known, Place, Seen, Told, planning_state, walls_now};
use crate::config::Config;
use crate::controller::Controllers;
use crate::controller::reward::reward;
use crate::error::Error;
use crate::information::entropy::{position_block, position_entropy_nat};
use crate::memory::channel::ChannelMemory;
use crate::memory::clutter::ClutterMemory;
use crate::memory::discovery::Discovery;
use crate::memory::environment::EnvironmentMemory;
use crate::memory::transmission::TransmissionMemory;
use crate::model::anchor::Anchor;
use crate::model::motion::Agent;
use crate::model::observation::TagHeight;
use crate::model::plan::FloorPlan;
use crate::observer::{Observer, Stage};
use crate::perceptor::belief::TagBelief;
use crate::perceptor::receiver::{Delivered, Receiver, Scans};
use crate::perceptor::state_filter::StateFilter;
use crate::radio::library::{Action, Library};
use crate::report::{CycleReport, MapChanges};
use heapless::Vec;

/// The tracker: all state of the cognitive system, in fixed memory, for so many anchors, surfaces, images, segments of walls
/// (and corners of the outline), paths per anchor and actions.
#[derive(Clone, Debug)]
pub struct Tracker<
    const ANCHORS: usize,
    const SURFACES: usize,
    const SOURCES: usize,
    const SEGMENTS: usize,
    const PATHS: usize,
    const ACTIONS: usize,
> {
    config: Config,
    anchors: Vec<Anchor, ANCHORS>,
    plan: FloorPlan<SEGMENTS>,
    library: Library<ACTIONS>,

    receiver: Receiver<ANCHORS, PATHS>,
    belief: TagBelief<ANCHORS>,
    filter: StateFilter<ANCHORS, SURFACES>,
    environment: EnvironmentMemory<SURFACES, SOURCES>,
    transmission: TransmissionMemory<SEGMENTS>,
    discovery: Discovery<ANCHORS>,
    clutter: ClutterMemory<ANCHORS>,
    channel: ChannelMemory<ANCHORS, SOURCES, ACTIONS>,
    controllers: Controllers<ANCHORS, ACTIONS>,

    cycle: u32,
    /// The tag at the end of the last cycle in which anything was heard.
    last_heard: Agent,
    /// The cycle begun and not finished.
    begun: Option<Begun<ANCHORS>>,
    /// What was received in it.
    scans: Scans<ANCHORS, PATHS>,
}

/// A cycle that was begun.
#[derive(Clone, Copy, Debug)]
struct Begun<const ANCHORS: usize> {
    elapsed_s: f32,
    tag_height: Option<TagHeight>,
    delivered: Delivered<ANCHORS>,
}

impl<
    const ANCHORS: usize,
    const SURFACES: usize,
    const SOURCES: usize,
    const SEGMENTS: usize,
    const PATHS: usize,
    const ACTIONS: usize,
> Tracker<ANCHORS, SURFACES, SOURCES, SEGMENTS, PATHS, ACTIONS>
{
    /// Ends the cycle that [`Self::begin`] began, by what was received since. Returns what was made of it and the next action.
    ///
    /// # Errors
    /// [`Error::NotBegun`]; nothing has changed then.
    pub fn finish(&mut self) -> Result<CycleReport, Error> {
        self.finish_observed(&mut ())
    }

    /// [`Self::finish`], watched by an observer.
    ///
    /// # Errors
    /// [`Error::NotBegun`]; nothing has changed then.
    // Kept apart, as its stages are, so that each reuses the stack of the one before.
    #[inline(never)]
    pub fn finish_observed(
        &mut self,
        observer: &mut impl Observer<SOURCES, PATHS>,
    ) -> Result<CycleReport, Error> {
        let Begun { elapsed_s, tag_height, .. } = self.begun.take().ok_or(Error::NotBegun)?;
        let Self {
            config,
            anchors,
            plan,
            library,
            receiver,
            belief,
            filter,
            environment,
            transmission,
            discovery,
            clutter,
            channel,
            controllers,
            cycle,
            last_heard,
            begun: _,
            scans,
        } = self;
        let told = Told { config, anchors, library, tag_height };
        receiver.complete(scans);
        let is_heard = !scans.is_empty();
        let unheard_s = receiver.unheard_s(scans);

        observer.stage(Stage::Predict);
        let last = filter.agent();
        let step = config.motion.step(elapsed_s);
        filter.predict(elapsed_s);
        let predicted = filter.agent();
        belief.predict(&step, elapsed_s);
        if is_heard {
            // Over the whole time since anything was heard, however many cycles that were.
            discovery.predict(last_heard, &predicted, &config.motion.step(unheard_s));
            belief.bridge(last_heard, &predicted);
        }
        environment.predict(config.association.map_change_per_s, elapsed_s);
        channel.predict(elapsed_s);

        observer.stage(Stage::Associate);
        let walls = &walls_now(plan, filter, environment, transmission);
        if belief.is_acquiring() {
            // Candidates are located relative to a tag that is about to jump.
            discovery.clear();
            let known = Known { filter, environment, channel, clutter, plan, walls };
            if let Some(agent) = locate(belief, &told, &known, scans) {
                filter.place(&agent);
            }
        }
        let manoeuvre_over_s = (!belief.is_acquiring()).then_some(unheard_s);
        let expected =
            expect(filter, &told, environment, channel, clutter, (plan, walls), scans, manoeuvre_over_s);
        let known = Known { filter, environment, channel, clutter, plan, walls };
        let outcomes = associate(&told, &known, discovery, &expected, observer);
        let evidence_nat = outcomes.iter().fold(0.0, |sum, (outcome, _)| sum + outcome.evidence_nat);
        let lost = belief.watch(evidence_nat, filter.agent());

        let acquiring = belief.is_acquiring();
        if !acquiring {
            observer.stage(Stage::Update);
            let before = filter.agent();
            filter.update(outcomes.iter().flat_map(|(outcome, _)| outcome.innovations()));
            discovery.follow(&before, &filter.agent());
        }

        observer.stage(Stage::Remember);
        remember(environment, channel, clutter, receiver, &told, belief, controllers, &outcomes);
        if !acquiring && !belief.is_doubtful() {
            look_through(transmission, &told, walls, &Place::of(&filter.agent()), &outcomes);
        }

        observer.stage(Stage::Discover);
        let map = if acquiring || belief.is_doubtful() {
            MapChanges::default()
        } else {
            revise_map(filter, environment, channel, discovery, clutter, &told, &outcomes)
        };

        observer.stage(Stage::Act);
        let posterior = filter.agent();
        let entropy_nat = |agent: &Agent| position_entropy_nat(&position_block(&agent.covariance));
        let earned =
            reward(config.controller.reward, &last.covariance, &predicted.covariance, &posterior.covariance);
        let state = planning_state(config, &posterior, receiver.threshold(), elapsed_s);
        let known = Known { filter, environment, channel, clutter, plan, walls };
        let seen = Seen::<ANCHORS, SOURCES>::new(known.visible(&told, Place::of(&posterior)));
        let decision = controllers.decide(earned, acquiring, scans, &state, seen.iter(), channel, library);

        // While the tag is looked for, nothing is associated with certainty.
        let heard = if acquiring { Heard::default() } else { Heard::of(&outcomes) };
        let report = CycleReport {
            cycle: *cycle,
            position_m: filter.position_m(),
            position_covariance_m2: position_block(&posterior.covariance),
            predicted_entropy_nat: entropy_nat(&predicted),
            entropy_nat: entropy_nat(&posterior),
            reward: earned,
            anchors_heard: heard.anchors,
            measurements: heard.measurements,
            left_out: scans.iter().fold(0, |sum, scan| sum + scan.left_out),
            associated: heard.associated,
            acquiring,
            lost,
            nis: heard.nis,
            discovered: map.discovered,
            forgotten: map.forgotten,
            joined: map.joined,
            map_full: map.map_full,
            action: decision.applied,
            next_action: decision.next,
            announced_action: decision.announced,
            next: library
                .get(decision.next)
                .copied()
                .unwrap_or(Action { carrier_hz: 0.0, pulse_duration_s: 0.0 }),
        };
        if is_heard {
            *last_heard = posterior;
        }
        *cycle = cycle.wrapping_add(1);
        observer.stage(Stage::Done);
        Ok(report)
    }
}
