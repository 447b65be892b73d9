//! The tracker: the perception-action cycle over all stages.
//!
//! Every stage takes values and its own state and returns a value. [`Tracker`] holds the states; [`Tracker::finish`] is the
//! cycle, in the order of its diagram: receive, estimate, predict, expect, associate, update, remember, reward, learn, plan,
//! act.

mod entries;
pub mod joining;
mod sense;
mod stages;
mod start;
mod state;
mod values;

use self::sense::{propose, sense};
use self::stages::{Heard, Outcomes, look_through, remember, revise_map};
use self::values::{Known, Place, Seen, Told, discovery_view, planning_state, walls_now, walls_with};
use crate::model::source::Source;
use crate::perceptor::association::outcome::AssociatedScan;
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
use crate::perceptor::belief::mixture::Mixture;
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
    mixture: Mixture<ANCHORS, SURFACES>,
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
            mixture,
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
        mixture.begin(filter);
        mixture.predict(elapsed_s, config.belief.turns_per_s, is_heard);
        if let Some(leader) = mixture.components.first() {
            filter.clone_from(&leader.filter);
        }
        let predicted = filter.agent();
        if is_heard {
            // Over the whole time since anything was heard, however many cycles that were.
            discovery.predict(last_heard, &predicted, &config.motion.step(unheard_s));
        }
        environment.predict(config.association.map_change_per_s, elapsed_s);
        channel.predict(elapsed_s);

        observer.stage(Stage::Associate);
        let walls = &walls_now(plan, filter, environment, transmission);
        let barrier = &walls_with(plan, filter, environment, |_, existence| 1.0 - existence);
        if is_heard && mixture.proposes() {
            propose(mixture, &told, environment, channel, clutter, plan, scans, unheard_s);
        }
        let mut heard: Vec<_, ANCHORS> = Vec::new();
        let mut all_claims: Vec<_, ANCHORS> = Vec::new();
        for scan in scans.iter() {
            let claims = told.sight(scan.anchor).and_then(|sight| {
                let direct = filter.regress(Source::Direct { anchor: scan.anchor }, &sight, None)?;
                let (viewpoint, background) = discovery_view(&told, filter, clutter, scan.anchor, &direct)?;
                Some(discovery.claim(scan.anchor, &viewpoint, &scan.measurements, &background))
            });
            let Some(claims) = claims else { continue };
            let Some(outcome) =
                sense(mixture, &told, environment, channel, clutter, (plan, walls), scan, &claims.totals())
            else {
                continue;
            };
            let _ = heard.push((scan, outcome));
            let _ = all_claims.push(claims);
        }
        let mut outcomes = Outcomes::new();
        let (mut strong, mut known) = (0.0, 0.0);
        for ((scan, heard), claims) in heard.iter().zip(all_claims) {
            observer.expectations(scan.anchor, &heard.expected.direct, &heard.expected.virtual_anchors);
            observer.beliefs(scan.anchor, &scan.measurements, &heard.beliefs);
            for (m, free) in scan.measurements.iter().zip(&heard.beliefs.unassociated) {
                if m.false_alarm < 0.3 {
                    strong += 1.0;
                    known += 1.0 - free;
                }
            }
            let outcome = AssociatedScan {
                scan,
                expected: &heard.expected,
                beliefs: heard.beliefs.clone(),
                evidence_nat: 0.0,
                tail_m2: 0.0,
            };
            let _ = outcomes.push((outcome, claims));
        }
        if strong > 0.0 {
            mixture.explained += 0.1 * (known / strong - mixture.explained);
        }
        let was_searching = mixture.summary.probability < 0.5;
        mixture.conclude(
            |from, to, std_m| barrier.paths(from, to, std_m).direct(),
            |place_m, std_m| plan.inside(place_m, std_m),
            is_heard,
        );
        let acquiring = mixture.summary.probability < 0.5;
        let lost = acquiring && !was_searching;
        let is_sure = mixture.is_sure();

        observer.stage(Stage::Update);
        if let Some(leader) = mixture.components.first() {
            filter.clone_from(&leader.filter);
        }
        discovery.follow(&predicted, &filter.agent());

        observer.stage(Stage::Remember);
        remember(environment, channel, clutter, receiver, &told, (acquiring, is_sure), controllers, &outcomes);
        if is_sure {
            look_through(transmission, &told, walls, &Place::of(&filter.agent()), &outcomes);
        }

        observer.stage(Stage::Discover);
        let map = if is_sure {
            revise_map(filter, environment, channel, discovery, clutter, &told, &outcomes)
        } else {
            MapChanges::default()
        };
        mixture.follow_map(filter);

        observer.stage(Stage::Act);
        let posterior = filter.agent();
        let entropy_nat = |agent: &Agent| position_entropy_nat(&position_block(&agent.covariance));
        let earned =
            reward(config.controller.reward, &last.covariance, &predicted.covariance, &posterior.covariance);
        let state = planning_state(config, &posterior, receiver.threshold(), elapsed_s);
        let walls = &walls_now(plan, filter, environment, transmission);
        let known = Known { filter, environment, channel, clutter, plan, walls };
        let seen = Seen::<ANCHORS, SOURCES>::new(known.visible(&told, Place::of(&posterior)));
        let decision = controllers.decide(earned, acquiring, scans, &state, seen.iter(), channel, library);

        // While the tag is looked for, nothing is associated with certainty.
        let heard = if acquiring { Heard::default() } else { Heard::of(&outcomes) };
        let report = CycleReport {
            cycle: *cycle,
            position_m: mixture.summary.position_m,
            position_covariance_m2: mixture.summary.covariance_m2,
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
