//! The tracker: the perception-action cycle over all stages.
//!
//! Every stage takes values and its own state and returns a value. [`Tracker`] holds the states; [`Tracker::finish`] is the
//! cycle, in the order of its diagram: receive, estimate, predict, expect, associate, update, remember, reward, learn, plan,
//! act.

mod entries;
mod integrity;
pub mod joining;
pub mod map;
pub mod over_radio;
mod stages;
mod start;
mod state;
mod store;
mod values;
mod work;

use self::integrity::Seals;
use self::stages::{
    Claimed, Explained, Heard, act, claim, conclude, hear, look_beside, look_through, propose_places, reader,
    remember, revise_map,
};
use self::values::{Known, Place, Told, walls_now};
use self::work::{planning, slots};
use crate::config::Config;
use crate::controller::Controllers;
use crate::controller::reward::reward;
use crate::error::Error;
use crate::information::entropy::position_entropy_nat;
use crate::memory::channel::ChannelMemory;
use crate::memory::clutter::ClutterMemory;
use crate::memory::discovery::Discovery;
use crate::memory::environment::EnvironmentMemory;
use crate::memory::lateness::LatenessMemory;
use crate::memory::transmission::TransmissionMemory;
use crate::model::anchor::Anchor;
use crate::model::motion::Agent;
use crate::model::observation::TagHeight;
use crate::model::plan::FloorPlan;
use crate::model::work::{COMPONENT, CYCLE, HYPOTHESIS, LESSON, Work};
use crate::observer::{Observer, Stage};
use crate::perceptor::association::outcome::Outcomes;
use crate::perceptor::belief::component::{LEAPT, apart};
use crate::perceptor::belief::{BeliefSettings, TagBelief};
use crate::perceptor::receiver::{Delivered, Receiver, Scans};
use crate::radio::library::{Action, Library};
use crate::report::{CycleReport, Integrity, MapChanges};
use heapless::Vec;

/// The tracker: all state of the cognitive system, in fixed memory, for so many anchors, surfaces, images, segments of walls
/// (and corners of the outline), paths per anchor, actions, components of the belief, and points (a byte each, about four per pulse
/// duration) of what paths leave of the frames of an anchor, and candidates for virtual anchors that no plan told of, per anchor. Without
/// points, frames are read no further than to their paths; without candidates, no virtual anchors are looked for. With 0 `FRAMES` in place
/// of 1, ranges alone are received: see [`RangeTracker`].
#[derive(Clone, Debug)]
pub struct Tracker<
    const ANCHORS: usize,
    const SURFACES: usize,
    const SOURCES: usize,
    const SEGMENTS: usize,
    const PATHS: usize,
    const ACTIONS: usize,
    const COMPONENTS: usize,
    const POINTS: usize,
    const CANDIDATES: usize,
    const FRAMES: usize = 1,
> {
    config: Config,
    anchors: Vec<Anchor, ANCHORS>,
    /// Mean and standard deviation of every anchor's range bias beforehand, metres.
    range_biases_m: [[f32; 2]; ANCHORS],
    plan: FloorPlan<SEGMENTS>,
    library: Library<ACTIONS>,

    receiver: Receiver<ANCHORS, PATHS, POINTS, FRAMES>,
    belief: TagBelief<ANCHORS, SURFACES, COMPONENTS>,
    environment: EnvironmentMemory<SURFACES, SOURCES>,
    transmission: TransmissionMemory<SEGMENTS>,
    discovery: Discovery<ANCHORS, CANDIDATES>,
    clutter: ClutterMemory<ANCHORS>,
    lateness: LatenessMemory<ANCHORS>,
    channel: ChannelMemory<ANCHORS, SOURCES, ACTIONS>,
    controllers: Controllers<ANCHORS, ACTIONS>,

    /// Digest of the map told.
    map: u64,
    cycle: u32,
    /// The tag at the end of the last cycle in which anything was heard.
    last_heard: Agent,
    /// Where the antenna in use is on the body of the tag: ahead of its centre and to its left, metres.
    lever_arm_m: [f32; 2],
    phase: Phase,
    /// The cycle begun.
    begun: Begun<ANCHORS>,
    /// What was received in it.
    scans: Scans<ANCHORS, PATHS>,
    /// By which bits that flip are found.
    seals: Seals<COMPONENTS>,
}

/// A tracker of ranges alone, without a map: for so many anchors, ranges per anchor and cycle, and components of the belief. It links
/// neither channel estimator nor planning, and refuses frames. [`Tracker::empty`] makes one; it is started with one action, of whose pulse
/// it has the resolution of ranges.
pub type RangeTracker<const ANCHORS: usize, const RANGES: usize, const COMPONENTS: usize> =
    Tracker<ANCHORS, 0, 0, 0, RANGES, 1, COMPONENTS, 0, 0, 0>;

/// What a tracker can do next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// It is empty: be started.
    Empty,
    /// Begin a cycle.
    Between,
    /// Receive, and finish the cycle.
    Begun,
}

/// A cycle that was begun.
#[derive(Clone, Copy, Debug)]
struct Begun<const ANCHORS: usize> {
    elapsed_s: f32,
    tag_height: Option<TagHeight>,
    delivered: Delivered<ANCHORS>,
    integrity: Integrity,
}

impl<const ANCHORS: usize> Begun<ANCHORS> {
    const NONE: Self =
        Self { elapsed_s: 0.0, tag_height: None, delivered: Delivered::NONE, integrity: Integrity::NONE };
}

impl<
    const ANCHORS: usize,
    const SURFACES: usize,
    const SOURCES: usize,
    const SEGMENTS: usize,
    const PATHS: usize,
    const ACTIONS: usize,
    const COMPONENTS: usize,
    const POINTS: usize,
    const CANDIDATES: usize,
    const FRAMES: usize,
> Tracker<ANCHORS, SURFACES, SOURCES, SEGMENTS, PATHS, ACTIONS, COMPONENTS, POINTS, CANDIDATES, FRAMES>
{
    /// Ends the cycle that [`Self::begin`] began, by what was received since. Returns what was made of it and the next action.
    ///
    /// # Errors
    /// [`Error::NotBegun`] or [`Error::NotStarted`]; nothing has changed then.
    pub fn finish(&mut self) -> Result<CycleReport, Error> {
        self.finish_observed(&mut ())
    }

    /// [`Self::finish`], watched by an observer.
    ///
    /// # Errors
    /// [`Error::NotBegun`] or [`Error::NotStarted`]; nothing has changed then.
    pub fn finish_observed(
        &mut self,
        observer: &mut impl Observer<SOURCES, PATHS>,
    ) -> Result<CycleReport, Error> {
        self.check_begun()?;
        let mut report = self.finish_unswept(observer);
        report.integrity.add(&self.sweep());
        observer.stage(Stage::Done);
        Ok(report)
    }

    /// [`Self::finish_observed`] without the sweep of the state, of a cycle that is begun.
    // Kept apart, as its stages are, so that each reuses the stack of the one before.
    #[inline(never)]
    fn finish_unswept(&mut self, observer: &mut impl Observer<SOURCES, PATHS>) -> CycleReport {
        self.phase = Phase::Between;
        let Begun { elapsed_s, tag_height, integrity, .. } = self.begun;
        let Self {
            config,
            anchors,
            range_biases_m: _,
            plan,
            library,
            receiver,
            belief,
            environment,
            transmission,
            discovery,
            clutter,
            lateness,
            channel,
            controllers,
            map: _,
            cycle,
            last_heard,
            lever_arm_m,
            phase: _,
            begun: _,
            scans,
            seals: _,
        } = self;
        let told = Told { config, anchors, library, tag_height, lever_arm_m: *lever_arm_m };
        receiver.complete(scans);
        let is_heard = !scans.is_empty();
        let unheard_s = receiver.unheard_s(scans);

        observer.stage(Stage::Predict);
        belief.begin(scans.len(), slots(belief, &told, environment, scans));
        let last = belief.leader().agent();
        belief.predict(elapsed_s, is_heard.then_some(unheard_s));
        let mut work = Work::of(CYCLE);
        work.add(COMPONENT, belief.components().len());
        scans.iter().for_each(|scan| work.add_all(scan.work));
        let predicted = belief.leader().agent();
        let silent_s = if is_heard { 0.0 } else { unheard_s };
        let predicted_entropy_nat = position_entropy_nat(&belief.covariance_m2(silent_s));
        if is_heard {
            // Over the whole time since anything was heard, however many cycles that were.
            discovery.predict(last_heard, &predicted, &config.motion.step(unheard_s));
        }
        environment.predict(config.association.map_change_per_s, elapsed_s);
        channel.predict(elapsed_s);

        observer.stage(Stage::Associate);
        let BeliefSettings { walls_bar_ways: bar, walls_hide_paths: hide, .. } = config.belief;
        let walls = &walls_now(plan, belief.leader(), environment, hide, |wall| transmission.through(wall));
        if is_heard && belief.proposes() {
            let (trusted, turn) = (belief.trusted(), belief.turn());
            let places =
                propose_places(trusted, &told, environment, channel, clutter, plan, scans, turn, &mut work);
            for place in &places {
                belief.enter(place);
            }
        }
        let mut outcomes = Outcomes::none();
        let mut claimed = Claimed::<ANCHORS, PATHS, CANDIDATES>::new();
        let mut explained = Explained::default();
        for scan in scans.iter() {
            let claims = claim(discovery, &told, belief.leader(), clutter, scan, &mut claimed);
            work.add(HYPOTHESIS, discovery.hypotheses(scan.anchor));
            let Some(claims) = claims else { continue };
            let surroundings = (&*plan, walls);
            let reader = reader(&told, receiver, clutter, scan);
            let heard = hear(
                belief,
                &told,
                environment,
                channel,
                clutter,
                &lateness.of(scan.anchor),
                surroundings,
                (scan, reader.as_ref()),
                &claims,
                &mut outcomes,
                &mut work,
                |outcome| {
                    let expected = &outcome.expected;
                    observer.expectations(scan.anchor, &expected.direct, &expected.virtual_anchors);
                    observer.beliefs(scan.anchor, &scan.measurements, &outcome.beliefs);
                    explained = explained.with(outcome);
                },
            );
            if heard.is_none() {
                // It has no outcome.
                claimed.pop();
            }
        }

        observer.stage(Stage::Update);
        let was_searching = belief.is_searching();
        if is_heard {
            belief.explain(explained.strong, explained.known);
            conclude(belief, environment, plan, bar);
        } else {
            belief.sum_up(silent_s);
        }
        let posterior = belief.leader().agent();
        let has_leapt = apart(&predicted, &posterior) > LEAPT;
        if has_leapt {
            // Candidates are located relative to a tag that is elsewhere.
            discovery.clear();
        } else {
            discovery.follow(&predicted, &posterior);
        }
        let (searching, is_sure) = (belief.is_searching(), belief.is_sure() && !has_leapt);

        observer.stage(Stage::Remember);
        work.add(LESSON, outcomes.sources());
        work.add_all(planning(&told, anchors.len() + environment.iter().count()));
        let known = (searching, is_sure);
        remember(
            environment,
            channel,
            clutter,
            lateness,
            receiver,
            &told,
            |anchor| belief.is_lost(anchor),
            known,
            controllers,
            &outcomes,
        );
        if is_sure {
            look_beside(clutter, &told, receiver, &outcomes);
            look_through(transmission, &told, walls, &Place::of(&posterior), &outcomes);
        }

        observer.stage(Stage::Discover);
        let map = if is_sure {
            revise_map(belief, environment, channel, discovery, clutter, &told, &outcomes, &claimed)
        } else {
            MapChanges::default()
        };

        observer.stage(Stage::Act);
        let posterior = belief.leader().agent();
        let earned =
            reward(config.controller.reward, &last.covariance, &predicted.covariance, &posterior.covariance);
        let filter = belief.leader();
        let known = Known { filter, environment, channel, plan, walls };
        let is_lost = |anchor| belief.is_lost(anchor);
        let decision = act(
            controllers,
            &known,
            &told,
            earned,
            (searching, is_lost),
            scans,
            (receiver.threshold(), elapsed_s),
        );

        // While the tag is looked for, nothing is associated with certainty.
        let heard = if searching { Heard::default() } else { Heard::of(&outcomes) };
        let report = CycleReport {
            cycle: *cycle,
            position_m: belief.summary().position_m,
            position_covariance_m2: belief.summary().covariance_m2,
            velocity_m_s: [posterior.mean.z, posterior.mean.w],
            velocity_covariance_m2_s2: posterior.velocity_covariance_m2_s2(),
            probability: belief.summary().probability,
            predicted_entropy_nat,
            entropy_nat: position_entropy_nat(&belief.summary().covariance_m2),
            reward: earned,
            anchors_heard: heard.anchors,
            measurements: heard.measurements,
            left_out: scans.iter().fold(0, |sum, scan| sum + scan.left_out),
            work: work.instructions(),
            cut_short: scans.iter().fold(0, |sum, scan| sum + u32::from(scan.cut_short)),
            crowded_out: belief.crowded_out(),
            associated: heard.associated,
            searching,
            lost: searching && !was_searching,
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
            integrity,
        };
        if is_heard {
            *last_heard = posterior;
        }
        *cycle = cycle.wrapping_add(1);
        report
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::motion::Start;
    use crate::model::observation::{Frame, Observation, Range, RangeScan, Samples};
    use crate::model::plan::Map;
    use crate::radio::library::LIBRARY_PUBLISHED;

    #[test]
    fn a_tag_that_was_carried_elsewhere_is_found_again_by_ranges_alone() {
        let places_m = [[0.0_f32, 0.0_f32], [10.0, 0.0], [5.0, 8.0]];
        let anchors = places_m.map(|position_m| Anchor { position_m, height_m: 0.0 });
        let start = Start { position_m: [2.0, 2.0], position_std_m: 0.3, velocity_std_m_s: 0.3 };
        let config = Config { start, ..Config::default() };
        let library = &LIBRARY_PUBLISHED;
        let mut tracker = Tracker::<3, 1, 1, 1, 4, 40, 8, 0, 6>::new();
        tracker.start(&config, &anchors, &Map::default(), library, 1).unwrap();
        let mut hear = |[x, y]: [f32; 2]| {
            let ranges =
                places_m.map(|[ax, ay]| [Range { range_m: (x - ax).hypot(y - ay), variance_m2: 4e-4 }]);
            let scans =
                [0, 1, 2].map(|anchor| Observation::Ranges(RangeScan { anchor, ranges: &ranges[anchor] }));
            let report = tracker.cycle(&scans, 0.1, None).unwrap();
            let [own_x, own_y] = report.position_m;
            (own_x - x).hypot(own_y - y)
        };
        let settled = (0..20).fold(0.0, |_, _| hear([2.0, 2.0]));
        assert!(settled < 0.05, "{settled}");
        let cycles = (0..300).take_while(|_| !(hear([8.0, 4.0]) < 0.1)).count();
        std::println!("carried 6.3 m away, three ranges a cycle: found within {cycles} cycles");
        assert!(cycles < 30, "{cycles}");
    }

    #[test]
    fn the_report_has_the_velocity_of_a_tag_that_walks_straight() {
        let places_m = [[0.0_f32, 0.0_f32], [10.0, 0.0], [5.0, 8.0]];
        let anchors = places_m.map(|position_m| Anchor { position_m, height_m: 0.0 });
        let start = Start { position_m: [2.0, 2.0], position_std_m: 0.3, velocity_std_m_s: 1.0 };
        let config = Config { start, ..Config::default() };
        let mut tracker = Tracker::<3, 1, 1, 1, 4, 40, 8, 0, 6>::new();
        tracker.start(&config, &anchors, &Map::default(), &LIBRARY_PUBLISHED, 1).unwrap();
        for cycle in 1..=50_u8 {
            let walked_s = 0.1 * f32::from(cycle);
            let [x, y] = [2.0 + 0.8 * walked_s, 2.0 + 0.3 * walked_s];
            let ranges =
                places_m.map(|[ax, ay]| [Range { range_m: (x - ax).hypot(y - ay), variance_m2: 4e-4 }]);
            let scans =
                [0, 1, 2].map(|anchor| Observation::Ranges(RangeScan { anchor, ranges: &ranges[anchor] }));
            let report = tracker.cycle(&scans, 0.1, None).unwrap();
            let agent = tracker.filter().agent();
            assert_eq!(report.velocity_m_s, [agent.mean.z, agent.mean.w]);
            let covariance = report.velocity_covariance_m2_s2;
            assert_eq!([covariance.m11, covariance.m22], [agent.covariance.m33, agent.covariance.m44]);
            assert_eq!([covariance.m12, covariance.m21], [agent.covariance.m34, agent.covariance.m43]);
            if cycle == 50 {
                let [vx, vy] = report.velocity_m_s;
                assert!((vx - 0.8).abs() < 0.05 && (vy - 0.3).abs() < 0.05, "{vx} {vy}");
                assert!(covariance.m11 > 0.0 && covariance.m11 < 0.01, "{covariance}");
            }
        }
    }

    #[test]
    fn of_ranges_alone_a_tracker_without_estimator_map_and_planning_makes_what_any_other_does_and_refuses_frames()
     {
        let places_m = [[0.0_f32, 0.0_f32], [10.0, 0.0], [5.0, 8.0]];
        let anchors = places_m.map(|position_m| Anchor { position_m, height_m: 0.0 });
        let start = Start { position_m: [2.0, 2.0], position_std_m: 0.3, velocity_std_m_s: 0.3 };
        let config = Config { start, ..Config::default() };
        let library = &LIBRARY_PUBLISHED[..1];
        let mut own = RangeTracker::<3, 2, 4>::empty();
        let mut other = Tracker::<3, 1, 1, 1, 2, 1, 4, 16, 0>::new();
        own.start(&config, &anchors, &Map::default(), library, 1).unwrap();
        other.start(&config, &anchors, &Map::default(), library, 1).unwrap();
        assert!(size_of_val(&own) + 4000 < size_of_val(&other));
        let mut searched = false;
        for cycle in 0..100_u8 {
            // It is carried away in between, and found again.
            let [x, y] = if (30..60).contains(&cycle) { [8.0, 4.0] } else { [2.0, 2.0] };
            let noise_m = 0.01 * f32::from(cycle % 7);
            let scans = places_m.map(|[ax, ay]| {
                let range_m = (x - ax).hypot(y - ay) + noise_m;
                [Range { range_m, variance_m2: 4e-4 }, Range { range_m: range_m + 3.0, variance_m2: 1e-2 }]
            });
            let scans =
                [0, 1, 2].map(|anchor| Observation::Ranges(RangeScan { anchor, ranges: &scans[anchor] }));
            let report = own.cycle(&scans, 0.1, None).unwrap();
            searched |= report.searching;
            assert_eq!(report.map_full, 0);
            let expected = other.cycle(&scans, 0.1, None).unwrap();
            assert_eq!(report.position_m, expected.position_m, "{cycle}");
            assert_eq!(report.position_covariance_m2, expected.position_covariance_m2);
            assert_eq!(report.reward.to_bits(), expected.reward.to_bits());
            assert_eq!(own.belief().leader().agent(), other.belief().leader().agent());
        }
        assert!(searched);
        let before = own.hash();
        let samples = [[1.0, 0.0]; 100];
        let frame = Observation::Frame(Frame {
            anchor: 0,
            action: 0,
            sequence: None,
            first_sample_delay_s: 0.0,
            samples: Samples::Complex(&samples),
        });
        let refused = Error::FrameLength { anchor: 0, given: 100, expected: 0 };
        assert_eq!(own.cycle(&[frame], 0.1, None).err(), Some(refused));
        assert_eq!(own.hash(), before);
    }
}
