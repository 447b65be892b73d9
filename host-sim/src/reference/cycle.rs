//! The whole cycle: [`Reference::cycle`] reads top to bottom, as the diagram does. Every stage takes values and its own state,
//! and returns a value.

use super::association::outcome::{Outcome, associate_scan, normalised_innovation};
use super::availability::availability;
use super::belief::{Belief, anywhere_nat, apart};
use super::below_threshold::Reader;
use super::channel_memory::ChannelMemory;
use super::clutter::ClutterMemory;
use super::controller::{Library, reward};
use super::controllers::Controllers;
use super::discovery::Discovery;
use super::environment::EnvironmentMemory;
use super::information::position_entropy_nat;
use super::joining;
use super::known::{Known, Place, Told, leader_view, outlook, sweep, walls_now};
use super::lateness::LatenessMemory;
use super::map::{Changes, Map as Revision};
use super::motion::{Agent, MotionStep};
use super::plan::FloorPlan;
use super::proposal::propose;
use super::real::Real;
use super::receiver::{AnchorEstimate, Receiver, Scan};
use super::region::Region;
use super::remember::{Memories, look_through};
use super::start::Start;
use super::state_filter::{Prior, StateFilter};
use super::transmission::TransmissionMemory;
use super::work::slots;
use cogmint_core::memory::environment::{Origin, TOLD};
use cogmint_core::model::observation::{Observation, TagHeight};
use cogmint_core::perceptor::belief::component::LEAPT;
use cogmint_core::perceptor::belief::proposal::STRONG;
use cogmint_core::radio::library::Action;
use cogmint_core::real::SPEED_OF_LIGHT_M_S;
use cogmint_core::{Anchor, Config, Map};

/// The sizes that are part of the core's type.
#[derive(Clone, Copy, Debug)]
pub struct Capacity {
    /// Anchors.
    pub anchors: usize,
    /// Surfaces.
    pub surfaces: usize,
    /// Images of anchors.
    pub sources: usize,
    /// Segments of walls.
    pub segments: usize,
    /// Paths per anchor.
    pub paths: usize,
    /// Actions.
    pub actions: usize,
    /// Components of the belief.
    pub components: usize,
    /// Points of what is left of a frame.
    pub points: usize,
}

/// What a cycle did; see the core's report.
#[derive(Clone, Debug)]
#[allow(missing_docs)] // the fields of `cogmint_core::CycleReport`
pub struct Report<T> {
    pub cycle: u32,
    pub position_m: [T; 2],
    pub position_covariance_m2: [[T; 2]; 2],
    pub probability: T,
    pub predicted_entropy_nat: T,
    pub entropy_nat: T,
    pub reward: T,
    pub anchors_heard: u32,
    pub measurements: u32,
    pub left_out: u32,
    pub cut_short: u32,
    /// Components that counted and found no room.
    pub crowded_out: u32,
    pub associated: u32,
    pub searching: bool,
    pub lost: bool,
    pub nis: T,
    pub discovered: u32,
    pub forgotten: u32,
    pub joined: u32,
    pub map_full: u32,
    pub action: usize,
    pub next_action: usize,
    pub next: Action,
}

/// Everything a cycle computed on its way.
#[derive(Clone, Debug)]
pub struct Intermediates<T> {
    /// The frames' paths, by anchor.
    pub estimates: Vec<AnchorEstimate<T>>,
    /// Scans with their beliefs, by anchor.
    pub heard: Vec<Outcome<T>>,
    /// The report.
    pub report: Report<T>,
}

/// The tracker.
#[derive(Clone, Debug)]
pub struct Reference<T> {
    config: Config,
    anchors: Vec<Anchor>,
    plan: FloorPlan<T>,
    library: Library<T>,

    /// Where the antenna in use is: ahead of the centre of the tag's body and to its left, metres.
    pub lever_arm_m: [f32; 2],
    /// Cycles run.
    pub cycle: u32,
    /// The receivers.
    pub receiver: Receiver<T>,
    /// Where the tag may be: tag, biases and surfaces, in components.
    pub belief: Belief<T>,
    /// Which surfaces exist, and what is seen in them.
    pub environment: EnvironmentMemory<T>,
    /// What walls let through.
    pub transmission: TransmissionMemory<T>,
    /// Candidates for virtual anchors.
    pub discovery: Discovery<T>,
    /// When images are joined; it stays as it is.
    pub joining: joining::Constants,
    /// What nothing explains.
    pub clutter: ClutterMemory<T>,
    /// How late ranges are.
    pub lateness: LatenessMemory<T>,
    /// How well sources are heard.
    pub channel: ChannelMemory<T>,
    /// The choices.
    pub controllers: Controllers<T>,
    /// The tag after the last cycle in which anything was heard.
    pub last_heard: Agent<T>,
}

impl<T: Real> Reference<T> {
    /// A tracker at its start; the arguments are those of a core tracker that was accepted.
    pub fn new(
        config: Config,
        anchors: &[Anchor],
        map: &Map<'_>,
        actions: &[Action],
        seed: u64,
        capacity: Capacity,
    ) -> Self {
        let prior = Prior {
            reach_m: config.ranging.max_range_m,
            position_m: config.start.position_m,
            position_std_m: config.start.position_std_m,
            velocity_std_m_s: config.start.velocity_std_m_s,
            bias_mean_m: config.ranging.bias_mean_m,
            bias_std_m: config.ranging.bias_std_m,
        };
        let mut filter = StateFilter::new(capacity.anchors, capacity.surfaces, config.motion, &prior);
        let mut environment = EnvironmentMemory::new(capacity.surfaces, capacity.sources);
        if config.has_heading {
            filter.insert_heading(config.belief.turns_per_s);
            environment.insert_surface(capacity.surfaces - 1, T::of(TOLD), Origin::Plan);
        }
        let mut plan = FloorPlan::new(&map.plan.unwrap_or_default());
        let mut start = Start { filter: &mut filter, environment: &mut environment };
        start.enter_virtual_anchors(map.virtual_anchors, &config);
        if let Some(told) = &map.plan {
            let shortest_s =
                actions.iter().map(|action| action.pulse_duration_s).fold(f32::INFINITY, f32::min);
            start.enter_plan(&mut plan, told, anchors, &config, SPEED_OF_LIGHT_M_S * shortest_s);
        }
        let region = Region::inside(&plan.outline_m)
            .unwrap_or_else(|| Region::reached(anchors, config.ranging.max_range_m));
        let library = Library::new(actions);
        let first = library.pulse(config.controller.first_action, &config.radio);
        let channel = ChannelMemory::new(
            [capacity.anchors, capacity.sources, capacity.actions],
            config.channel,
            T::of(config.controller.prior_sinr),
            config.controller.neighbours,
            &library,
        );
        let room = [capacity.anchors, capacity.actions];
        let last_heard = filter.agent();
        Self {
            last_heard,
            receiver: Receiver::new(&config, [capacity.anchors, capacity.paths, capacity.points], &first),
            belief: Belief::new(
                filter,
                config.start.velocity_std_m_s,
                region,
                config.belief,
                capacity.components,
            ),
            environment,
            transmission: TransmissionMemory::new(plan.walls.len()),
            joining: joining::Constants::default(),
            discovery: Discovery::new(capacity.anchors, config.discovery_settings),
            clutter: ClutterMemory::new(config.association, &config.ranging, capacity.anchors),
            lateness: LatenessMemory::new(config.ranging.late_m, capacity.anchors),
            channel,
            controllers: Controllers::new(config.controller, anchors.len(), &library, seed, room),
            config,
            anchors: anchors.to_vec(),
            plan,
            library,
            lever_arm_m: [0.0; 2],
            cycle: 0,
        }
    }

    /// Tells the prior of one anchor's range bias, metres, before the first cycle.
    pub fn tell_range_bias(&mut self, anchor: usize, mean_m: f32, std_m: f32) {
        let Belief { trusted, components, .. } = &mut self.belief;
        trusted.tell_bias(anchor, mean_m, std_m);
        components.iter_mut().for_each(|component| component.filter.tell_bias(anchor, mean_m, std_m));
    }

    /// One cycle of input that the core accepts.
    pub fn cycle(
        &mut self,
        observations: &[Observation<'_>],
        elapsed_s: f32,
        tag_height: Option<TagHeight>,
    ) -> Intermediates<T> {
        let elapsed_s = T::of(elapsed_s);
        let Self { config, anchors, plan, library, receiver, belief, environment, .. } = self;
        let Self {
            transmission,
            discovery,
            clutter,
            lateness,
            channel,
            controllers,
            last_heard,
            joining,
            ..
        } = self;
        let told = Told { config, anchors, library, tag_height, lever_arm_m: self.lever_arm_m };

        // Receive and estimate.
        let links = controllers.links(|anchor| belief.is_searching() || belief.is_out(anchor));
        let (estimates, scans) =
            receiver.receive(observations, elapsed_s, &links, channel.losses_ln(), library);

        // Predict.
        let sources = |anchor: usize| environment.sources_of(anchor).len() - 1;
        belief.begin(scans.len(), slots(&told, &scans, sources, belief.will_propose()));
        let last = belief.leading().agent();
        let unheard_s = receiver.unheard_s(&scans);
        let is_heard = !scans.is_empty();
        belief.predict(elapsed_s, is_heard.then_some(unheard_s));
        let predicted = belief.leading().agent();
        let (_, predicted_m2) = belief.moments(if is_heard { T::ZERO } else { unheard_s });
        if is_heard {
            discovery.predict(last_heard, &predicted, &MotionStep::new(&config.motion, unheard_s));
        }
        environment.predict(config.association.map_change_per_s, elapsed_s);
        channel.predict(elapsed_s);

        // The walls as they stand, for the whole cycle.
        let walls = walls_now(plan, belief.leading(), environment, |wall| transmission.through(wall));
        let (plan, walls) = (&*plan, &walls);

        // Propose.
        if is_heard && belief.proposes() {
            let sweep = |scan: &Scan<T>| sweep(&told, &belief.trusted, environment, channel, clutter, scan);
            let sweeps: Vec<_> = scans.iter().map(sweep).collect();
            for proposal in propose(&sweeps, |place_m, std_m| plan.inside(place_m, std_m), belief.turn()) {
                belief.enter(&proposal);
            }
        }

        // Expect, associate and update: scan by scan, all components alike.
        let mut outcomes: Vec<Outcome<T>> = Vec::new();
        let (mut strong, mut explained) = (T::ZERO, T::ZERO);
        for scan in scans {
            let (viewpoint, background) = leader_view(&told, belief.leading(), clutter, scan.anchor);
            let claims = discovery.claim(scan.anchor, &viewpoint, &scan.measurements, &background);
            let reader = reader(&scan, clutter);
            let clutter = clutter.clutter(scan.anchor);
            let mut best: Option<(T, Outcome<T>)> = None;
            let settings = &config.belief;
            for component in &mut belief.components {
                let known = Known { filter: &component.filter, environment, channel, plan, walls };
                let mut expected = known.expect(&told, &scan);
                expected[0].feature.lateness = lateness.0[scan.anchor].lateness;
                let mode = config.association.mode;
                let outage = component.outages.predict(scan.anchor, scan.elapsed_s, settings);
                let mut outcome =
                    associate_scan(scan.clone(), expected, claims.clone(), &clutter, outage, mode);
                component.outages.0[scan.anchor] = outcome.beliefs.outage;
                component.weight_nat += outcome.beliefs.evidence_nat;
                match &reader {
                    Some(reader) => {
                        component.weight_nat += reader.update(&mut component.filter, &mut outcome);
                    }
                    None => component.filter.update(&outcome.innovations()),
                }
                // Order: the first of equals.
                if best.as_ref().is_none_or(|(most, _)| component.weight_nat > *most) {
                    best = Some((component.weight_nat, outcome));
                }
            }
            belief.reduce();
            let Some((_, outcome)) = best else { continue };
            let (measurements, reach_m) = (&outcome.scan.measurements, T::of(config.ranging.max_range_m));
            let paths: Vec<T> =
                outcome.expected.iter().map(|own| own.feature.existence * own.feature.detection).collect();
            let evidence_nat = anywhere_nat(&paths, measurements, &clutter, reach_m);
            belief.hear_anywhere(outcome.scan.anchor, outcome.scan.elapsed_s, evidence_nat);
            for (z, free) in outcome.scan.measurements.iter().zip(&outcome.beliefs.unassociated) {
                if z.is_strong(STRONG) {
                    strong += T::ONE;
                    explained += T::ONE - *free;
                }
            }
            outcomes.push(outcome);
        }

        // Conclude: nobody walks through walls, or is outside.
        let was_searching = belief.is_searching();
        if is_heard {
            belief.explain(strong, explained);
            let barrier = walls_now(plan, belief.leading(), environment, |_| T::ZERO);
            belief.conclude(
                |from_m, to_m, std_m| {
                    if !config.belief.walls_bar_ways {
                        return T::ONE;
                    }
                    availability(&barrier, from_m, &[], to_m, std_m)
                },
                |place_m, std_m| plan.inside(place_m, std_m),
            );
        } else {
            belief.summarise(unheard_s);
        }
        let posterior = belief.leading().agent();
        let has_leapt = apart(&predicted, &posterior) > T::of(LEAPT);
        if has_leapt {
            discovery.clear();
        } else {
            discovery.follow(&predicted, &posterior);
        }
        let (searching, is_sure) = (belief.is_searching(), belief.is_sure() && !has_leapt);

        // Remember, and discover.
        let out: Vec<bool> = (0..anchors.len()).map(|anchor| belief.is_out(anchor)).collect();
        let mut memories = Memories { environment, channel, clutter, lateness };
        memories.remember(&told, &out, (searching, is_sure), receiver, controllers, &outcomes);
        let mut changes = Changes::default();
        if is_sure {
            for Outcome { scan, expected, .. } in &outcomes {
                let beside = reader(scan, clutter).and_then(|reader| reader.beside(expected));
                if let (Some(beside), Some(frame)) = (beside, &scan.frame) {
                    clutter.remember_background(scan.anchor, &beside, frame.elapsed_s);
                }
            }
            look_through(transmission, &told, walls, &Place::of(&posterior), &outcomes);
            let mut map = Revision { belief, environment, channel, discovery, joining };
            changes = map.revise(&told, clutter, &outcomes);
        }

        // Reward, learn, plan, act.
        let posterior = belief.leading().agent();
        let [before, after] = [&predicted.covariance, &posterior.covariance];
        let earned = reward(config.controller.reward, &last.covariance, before, after);
        let outlook = outlook(config, &posterior, receiver.threshold, elapsed_s);
        let visible = Known { filter: belief.leading(), environment, channel, plan, walls }
            .visible(&told, &Place::of(&posterior));
        let heard: Vec<_> = outcomes.iter().map(|outcome| &outcome.scan).collect();
        let cycle = self.cycle;
        let decision =
            controllers.decide(cycle, earned, searching, &out, &heard, &outlook, &visible, channel, library);

        // While the tag is looked for, nothing is associated with certainty.
        let certain: &[Outcome<T>] = if searching { &[] } else { &outcomes };
        let free: Vec<T> = certain.iter().flat_map(|outcome| outcome.beliefs.unassociated.clone()).collect();
        let report = Report {
            cycle,
            position_m: belief.summary.position_m,
            position_covariance_m2: belief.summary.covariance_m2,
            probability: belief.summary.probability,
            predicted_entropy_nat: position_entropy_nat(&predicted_m2.map(Vec::from).to_vec()),
            entropy_nat: position_entropy_nat(&belief.summary.covariance_m2.map(Vec::from).to_vec()),
            reward: earned,
            anchors_heard: certain.len() as u32,
            measurements: free.len() as u32,
            crowded_out: belief.crowded_out,
            left_out: heard.iter().map(|scan| scan.left_out).sum(),
            cut_short: heard.iter().map(|scan| u32::from(scan.cost.cut_short)).sum(),
            associated: free.iter().filter(|free| **free <= T::of(0.5)).count() as u32,
            searching,
            lost: searching && !was_searching,
            nis: normalised_innovation(certain),
            discovered: changes.discovered,
            forgotten: changes.forgotten,
            joined: changes.joined,
            map_full: changes.map_full,
            action: decision.applied,
            next_action: decision.next,
            next: library.actions[decision.next],
        };
        if !heard.is_empty() {
            *last_heard = posterior.clone();
        }
        self.cycle = cycle.wrapping_add(1);
        Intermediates { estimates, heard: outcomes, report }
    }
}

/// What reads the rest of a scan's frame, where that is kept.
fn reader<'a, T: Real>(scan: &'a Scan<T>, clutter: &'a ClutterMemory<T>) -> Option<Reader<'a, T>> {
    let frame = scan.frame.as_ref()?;
    let background = &clutter.backgrounds[scan.anchor];
    Some(Reader::new(
        frame.residual.as_ref()?,
        background,
        [frame.threshold, frame.resolution_m],
        frame.share,
    ))
}
