//! The whole cycle: [`Reference::cycle`] reads top to bottom, as the diagram does. Every stage takes values and its own state,
//! and returns a value.

use super::association::outcome::{Outcome, associate_scan, normalised_innovation};
use super::belief::Belief;
use super::channel_memory::ChannelMemory;
use super::clutter::ClutterMemory;
use super::controller::{Library, reward};
use super::controllers::Controllers;
use super::discovery::Discovery;
use super::environment::EnvironmentMemory;
use super::information::position_entropy_nat;
use super::joining;
use super::known::{Expected, Known, Place, Told, discovery_view, outlook, walls_now};
use super::loss::evidence_nat;
use super::manoeuvre::{is_doubtful, is_manoeuvre};
use super::map::{Changes, Map as Revision};
use super::motion::{Agent, MotionStep, PX, PY, ProcessNoise};
use super::plan::FloorPlan;
use super::real::{Real, smaller, square};
use super::receiver::{AnchorEstimate, Receiver, Scan};
use super::remember::{Memories, look_through};
use super::start::Start;
use super::state_filter::{Prior, StateFilter};
use super::transmission::TransmissionMemory;
use cogmint_core::model::observation::{Observation, TagHeight};
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
}

/// What a cycle did; see the core's report.
#[derive(Clone, Debug)]
#[allow(missing_docs)] // the fields of `cogmint_core::CycleReport`
pub struct Report<T> {
    pub cycle: u32,
    pub position_m: [T; 2],
    pub position_covariance_m2: [[T; 2]; 2],
    pub predicted_entropy_nat: T,
    pub entropy_nat: T,
    pub reward: T,
    pub anchors_heard: u32,
    pub measurements: u32,
    pub left_out: u32,
    pub associated: u32,
    pub acquiring: bool,
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

    /// Cycles run.
    pub cycle: u32,
    /// The receivers.
    pub receiver: Receiver<T>,
    /// Whether it is known where the tag is.
    pub belief: Belief<T>,
    /// Tag, biases and surfaces.
    pub filter: StateFilter<T>,
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
            position_m: config.start.position_m,
            position_std_m: config.start.position_std_m,
            velocity_std_m_s: config.start.velocity_std_m_s,
            bias_mean_m: config.ranging.bias_mean_m,
            bias_std_m: config.ranging.bias_std_m,
        };
        let mut filter = StateFilter::new(capacity.anchors, capacity.surfaces, config.motion, &prior);
        let mut environment = EnvironmentMemory::new(capacity.surfaces, capacity.sources);
        let mut plan = FloorPlan::new(&map.plan.unwrap_or_default());
        let mut start = Start { filter: &mut filter, environment: &mut environment };
        start.enter_virtual_anchors(map.virtual_anchors, &config);
        if let Some(told) = &map.plan {
            let shortest_s =
                actions.iter().map(|action| action.pulse_duration_s).fold(f32::INFINITY, f32::min);
            start.enter_plan(&mut plan, told, anchors, &config, SPEED_OF_LIGHT_M_S * shortest_s);
        }
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
            receiver: Receiver::new(&config, [capacity.anchors, capacity.paths], &first),
            belief: Belief::new(&config, filter.agent(), capacity.anchors),
            filter,
            environment,
            transmission: TransmissionMemory::new(plan.walls.len()),
            joining: joining::Constants::default(),
            discovery: Discovery::new(capacity.anchors, config.discovery_settings),
            clutter: ClutterMemory::new(config.association, &config.ranging, capacity.anchors),
            channel,
            controllers: Controllers::new(config.controller, anchors.len(), &library, seed, room),
            config,
            anchors: anchors.to_vec(),
            plan,
            library,
            cycle: 0,
        }
    }

    /// One cycle of input that the core accepts.
    pub fn cycle(
        &mut self,
        observations: &[Observation<'_>],
        elapsed_s: f32,
        tag_height: Option<TagHeight>,
    ) -> Intermediates<T> {
        let elapsed_s = T::of(elapsed_s);
        let Self { config, anchors, plan, library, receiver, belief, filter, environment, .. } = self;
        let Self { transmission, discovery, clutter, channel, controllers, last_heard, joining, .. } = self;
        let told = Told { config, anchors, library, tag_height };

        // Receive and estimate.
        let links = controllers.links(belief.is_acquiring());
        let (estimates, scans) =
            receiver.receive(observations, elapsed_s, &links, channel.losses_ln(), library);

        // Predict.
        let last = filter.agent();
        let step = MotionStep::new(&config.motion, elapsed_s);
        filter.predict(elapsed_s);
        let predicted = filter.agent();
        belief.predict(&step, elapsed_s);
        let unheard_s = receiver.unheard_s(&scans);
        if !scans.is_empty() {
            discovery.predict(last_heard, &predicted, &MotionStep::new(&config.motion, unheard_s));
            belief.bridge(last_heard, &predicted);
        }
        environment.predict(config.association.map_change_per_s, elapsed_s);
        channel.predict(elapsed_s);

        // The walls as they stand, for the whole cycle.
        let walls = walls_now(plan, filter, environment, transmission);
        let (plan, walls) = (&*plan, &walls);

        // Locate, where it is not known where the tag is.
        if let Some(acquisition) = &belief.acquisition {
            // Candidates are relative to a tag that is about to jump.
            discovery.clear();
            let known = Known { filter, environment, channel, clutter, plan, walls };
            let sweep = |scan: &Scan<T>| known.sweep(&told, scan, acquisition);
            let sweeps: Vec<_> = scans.iter().map(sweep).collect();
            if let Some(agent) = belief.locate(&sweeps, plan) {
                filter.place(&agent);
            }
        }

        // Expect: the prediction is widened where a manoeuvre explains the scans better by far.
        let all = |filter: &StateFilter<T>| -> Vec<_> {
            let known = Known { filter, environment, channel, clutter, plan, walls };
            scans.iter().map(|scan| known.expect(&told, scan)).collect()
        };
        let mut expected = all(filter);
        if !belief.is_acquiring() && are_direct_paths_missing(&scans, &expected) {
            let before = filter.agent_covariance();
            let velocity = square(T::of(config.start.velocity_std_m_s));
            filter.disturb(&ProcessNoise::of_turn(velocity, unheard_s));
            let widened = all(filter);
            let [motion, manoeuvre] =
                [&expected, &widened].map(|expected| total_evidence_nat(&scans, expected, clutter));
            if is_manoeuvre(motion, manoeuvre, config.belief.turns_per_s, unheard_s) {
                expected = widened;
            } else {
                filter.set_agent_covariance(&before);
            }
        }

        // Associate: all scans, before the first update.
        let mut outcomes = Vec::new();
        let mut evidence_nat = T::ZERO;
        for (scan, expected) in scans.into_iter().zip(expected) {
            let (viewpoint, background) =
                discovery_view(&told, filter, clutter, scan.anchor, &expected[0].regression);
            let claims = discovery.claim(scan.anchor, &viewpoint, &scan.measurements, &background);
            let clutter = clutter.clutter(scan.anchor);
            let outcome = associate_scan(scan, expected, claims, &clutter, config.association.mode);
            evidence_nat += outcome.evidence_nat;
            outcomes.push(outcome);
        }
        let lost = belief.watch(evidence_nat, &filter.agent());
        let acquiring = belief.is_acquiring();

        // Update.
        if !acquiring {
            let before = filter.agent();
            let innovations: Vec<_> = outcomes.iter().flat_map(Outcome::innovations).collect();
            filter.update(&innovations);
            discovery.follow(&before, &filter.agent());
        }

        // Remember, and discover.
        let mut memories = Memories { environment, channel, clutter };
        memories.remember(&told, belief, receiver, controllers, &outcomes);
        let mut changes = Changes::default();
        if !acquiring && !belief.is_doubtful() {
            look_through(transmission, &told, walls, &Place::of(&filter.agent()), &outcomes);
            let mut map = Revision { filter, environment, channel, discovery, joining };
            changes = map.revise(&told, clutter, &outcomes);
        }

        // Reward, learn, plan, act.
        let posterior = filter.agent();
        let [before, after] = [&predicted.covariance, &posterior.covariance];
        let earned = reward(config.controller.reward, &last.covariance, before, after);
        let outlook = outlook(config, &posterior, receiver.threshold, elapsed_s);
        let visible = Known { filter, environment, channel, clutter, plan, walls }
            .visible(&told, &Place::of(&posterior));
        let heard: Vec<_> = outcomes.iter().map(|outcome| &outcome.scan).collect();
        let cycle = self.cycle;
        let decision =
            controllers.decide(cycle, earned, acquiring, &heard, &outlook, &visible, channel, library);

        // While the tag is looked for, nothing is associated with certainty.
        let certain: &[Outcome<T>] = if acquiring { &[] } else { &outcomes };
        let free: Vec<T> = certain.iter().flat_map(|outcome| outcome.beliefs.unassociated.clone()).collect();
        // Order: the lower triangle's covariance, twice.
        let cross = after[PY][PX];
        let report = Report {
            cycle,
            position_m: [posterior.mean[PX], posterior.mean[PY]],
            position_covariance_m2: [[after[PX][PX], cross], [cross, after[PY][PY]]],
            predicted_entropy_nat: position_entropy_nat(before),
            entropy_nat: position_entropy_nat(after),
            reward: earned,
            anchors_heard: certain.len() as u32,
            measurements: free.len() as u32,
            left_out: heard.iter().map(|scan| scan.left_out).sum(),
            associated: free.iter().filter(|free| **free <= T::of(0.5)).count() as u32,
            acquiring,
            lost,
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

/// Whether to think of a manoeuvre.
fn are_direct_paths_missing<T: Real>(scans: &[Scan<T>], expected: &[Vec<Expected<T>>]) -> bool {
    let mut direct = Vec::new();
    for (scan, expected) in scans.iter().zip(expected) {
        let path = &expected[0].feature;
        let nis = scan.measurements.iter().map(|measurement| {
            square(measurement.range_m - path.range_m) / (path.variance_m2 + measurement.variance_m2)
        });
        direct.push((path.detection, nis.reduce(smaller)));
    }
    is_doubtful(&direct)
}

/// Evidence of all scans that the tag is where they were expected from.
fn total_evidence_nat<T: Real>(
    scans: &[Scan<T>],
    expected: &[Vec<Expected<T>>],
    clutter: &ClutterMemory<T>,
) -> T {
    let mut evidence = T::ZERO;
    for (scan, expected) in scans.iter().zip(expected) {
        let features: Vec<_> = expected.iter().map(|expected| expected.feature).collect();
        evidence += evidence_nat(&scan.measurements, &features, &clutter.clutter(scan.anchor));
    }
    evidence
}
