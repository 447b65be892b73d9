//! The whole cycle, stage by stage: [`Reference::cycle`] reads top to bottom.

use super::Matrix;
use super::association::{Beliefs, Clutter, Expectation, Measurement, associate};
use super::channel_estimator::{ChannelEstimate, ChannelEstimator};
use super::channel_memory::ChannelMemory;
use super::controller::{
    Horizon, Library, Outlook, Visible, choose, learn, plan_one, planned_set, policy, reward,
};
use super::discovery::{Discovered, Discovery, Viewpoint};
use super::environment::{CONFIRMED, EnvironmentMemory};
use super::information::position_entropy_nat;
use super::pulse::Pulse;
use super::real::{Real, abs, larger, speed_of_light, square};
use super::state_filter::{Innovation, PX, PY, Prior, Regression, Sight, StateFilter};
use cogmint_core::controller::library::Action;
use cogmint_core::observation::{Frame, Observation, RangeScan};
use cogmint_core::perceptor::association::Mode;
use cogmint_core::perceptor::state_filter::Source;
use cogmint_core::{Anchor, Config, MappedVirtualAnchor};
use rand_core::SeedableRng;
use rand_xoshiro::Xoshiro128PlusPlus;

/// The sizes that are part of the core's type.
#[derive(Clone, Copy, Debug)]
pub struct Capacity {
    /// Anchors.
    pub anchors: usize,
    /// Virtual anchors.
    pub virtual_anchors: usize,
    /// Paths per anchor.
    pub paths: usize,
    /// Actions.
    pub actions: usize,
}

/// The paths of a frame, with its anchor.
pub type AnchorEstimate<T> = (usize, ChannelEstimate<T>);

/// What one anchor delivered.
#[derive(Clone, Debug)]
pub struct Scan<T> {
    /// The anchor.
    pub anchor: usize,
    /// The action its frame was received with.
    pub action: usize,
    /// Ranges, then paths.
    pub measurements: Vec<Measurement<T>>,
    /// Whether there was a frame, in which a missing path means something.
    pub framed: bool,
}

/// A scan and what was made of it; features are the direct path, then the anchor's virtual anchors by slot.
#[derive(Clone, Debug)]
pub struct AssociatedScan<T> {
    /// The scan.
    pub scan: Scan<T>,
    /// Per feature, the range expected.
    pub regressions: Vec<Regression<T>>,
    /// Per feature, the beliefs.
    pub beliefs: Beliefs<T>,
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
    pub associated: u32,
    pub discovered: u32,
    pub forgotten: u32,
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
    pub heard: Vec<AssociatedScan<T>>,
    /// The report.
    pub report: Report<T>,
}

/// The tracker.
#[derive(Clone, Debug)]
pub struct Reference<T> {
    config: Config,
    capacity: Capacity,
    anchors: Vec<Anchor>,
    library: Library<T>,
    seed: u64,
    /// The estimator of each pulse met so far.
    estimators: Vec<(Pulse<T>, ChannelEstimator<T>)>,

    /// Cycles run.
    pub cycle: u32,
    /// Tag, biases and virtual anchors.
    pub filter: StateFilter<T>,
    /// Which virtual anchors exist.
    pub environment: EnvironmentMemory<T>,
    /// How well sources are heard.
    pub channel: ChannelMemory<T>,
    /// Candidates for virtual anchors.
    pub discovery: Discovery<T>,
    /// Action values J.
    pub values: Vec<T>,
    /// Policy pi.
    pub policy: Vec<T>,
    /// The present action.
    pub action: usize,
    /// Mean number of measurements per scan of unknown origin, by anchor.
    pub unexplained: Vec<T>,
    /// Last frame counter seen, by anchor.
    pub last_sequence: Vec<Option<u32>>,
}

impl<T: Real> Reference<T> {
    /// A tracker at its start; the arguments are those of a core tracker that was accepted.
    pub fn new(
        config: Config,
        anchors: &[Anchor],
        map: &[MappedVirtualAnchor],
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
        let mut filter = StateFilter::new(capacity.anchors, capacity.virtual_anchors, config.motion, &prior);
        let mut environment = EnvironmentMemory::new(capacity.virtual_anchors);
        for slot in 0..map.len() {
            filter.insert_independent(slot, map[slot].position_m.map(T::of), T::of(map[slot].std_m));
            environment.insert(slot, map[slot].anchor, T::of(0.9));
        }
        let values = vec![T::ZERO; capacity.actions];
        let policy = policy(&values, actions.len(), T::of(config.controller.choice.temperature_nat));
        let association = &config.association;
        let unexplained = T::of(association.clutter_per_anchor) + T::of(association.unmapped_per_anchor);
        Self {
            config,
            capacity,
            anchors: anchors.to_vec(),
            library: Library::new(actions),
            seed,
            estimators: Vec::new(),
            cycle: 0,
            filter,
            environment,
            channel: ChannelMemory::new(
                capacity.anchors,
                capacity.virtual_anchors,
                capacity.actions,
                T::of(config.controller.prior_sinr),
            ),
            discovery: Discovery::new(capacity.anchors),
            values,
            policy,
            action: config.controller.first_action,
            unexplained: vec![unexplained; capacity.anchors],
            last_sequence: vec![None; capacity.anchors],
        }
    }

    /// One cycle of input that the core accepts.
    pub fn cycle(
        &mut self,
        observations: &[Observation<'_>],
        elapsed_s: f32,
        tag_height_m: Option<f32>,
    ) -> Intermediates<T> {
        let elapsed_s = T::of(elapsed_s);
        let heights = self.heights(tag_height_m);
        let (estimates, scans) = self.estimate(observations);

        let previous = self.filter.agent_covariance();
        self.filter.predict(elapsed_s);
        let predicted = self.filter.agent_covariance();

        // All scans are associated, and all regressions taken, before the first update.
        let heard: Vec<_> = scans.into_iter().map(|scan| self.associate(scan, &heights)).collect();

        let mut innovations = Vec::new();
        for scan in &heard {
            innovations.extend(innovations_of(scan));
        }
        self.filter.update(&innovations);
        let posterior = self.filter.agent_covariance();

        let mut report = self.blank_report();
        self.remember(&heard, &mut report);
        self.discover(&heard, &heights, &mut report);
        // The action received with earns the reward.
        for associated in &heard {
            if associated.scan.framed {
                report.action = associated.scan.action;
                break;
            }
        }
        self.act([&previous, &predicted, &posterior], elapsed_s, &heights, &mut report);

        for observation in observations {
            if let Observation::Frame(Frame { anchor, sequence: Some(sequence), .. }) = *observation {
                self.last_sequence[anchor] = Some(sequence);
            }
        }
        self.cycle = self.cycle.wrapping_add(1);
        Intermediates { estimates, heard, report }
    }

    /// Height of each anchor above the tag; 0 where the tag's is unknown.
    fn heights(&self, tag_height_m: Option<f32>) -> Vec<T> {
        let height =
            |anchor: &Anchor| tag_height_m.map_or(T::ZERO, |tag| T::of(anchor.height_m) - T::of(tag));
        self.anchors.iter().map(height).collect()
    }

    fn sight(&self, anchor: usize, heights: &[T]) -> Sight<T> {
        Sight { anchor_m: self.anchors[anchor].position_m.map(T::of), height_m: heights[anchor] }
    }

    // Receive and estimate.

    /// The paths of every frame, and one scan per anchor heard.
    fn estimate(&mut self, observations: &[Observation<'_>]) -> (Vec<AnchorEstimate<T>>, Vec<Scan<T>>) {
        let mut estimates = Vec::new();
        let mut scans = Vec::new();
        for anchor in 0..self.anchors.len() {
            let mine: Vec<_> = observations.iter().filter(|o| o.anchor() == anchor).collect();
            if mine.is_empty() {
                continue;
            }
            let mut scan = Scan { anchor, action: self.action, measurements: Vec::new(), framed: false };
            // Ranges first: they outrank the paths near them.
            for observation in &mine {
                if let Observation::Ranges(ranges) = observation {
                    self.take_ranges(ranges, &mut scan);
                }
            }
            for observation in &mine {
                if let Observation::Frame(frame) = observation {
                    estimates.push((anchor, self.take_frame(frame, &mut scan)));
                }
            }
            scans.push(scan);
        }
        (estimates, scans)
    }

    fn take_ranges(&self, ranges: &RangeScan<'_>, scan: &mut Scan<T>) {
        for range in ranges.ranges {
            scan.measurements.push(Measurement {
                range_m: T::of(range.range_m),
                variance_m2: self.measurement_variance(T::of(range.variance_m2)),
                sinr: T::ZERO,
                energy: T::ZERO,
            });
        }
    }

    fn take_frame(&mut self, frame: &Frame<'_>, scan: &mut Scan<T>) -> ChannelEstimate<T> {
        let pulse = self.library.pulse(frame.action, &self.config.radio.pulse_shape);
        let estimator = self.estimator(&pulse);
        let estimate = estimator.estimate(frame.samples, T::of(frame.first_sample_delay_s));
        scan.action = frame.action;
        scan.framed = true;
        let ranges = scan.measurements.clone();
        let resolution_m = pulse.duration_s * speed_of_light();
        for path in &estimate.paths {
            let range_m = path.delay_s * speed_of_light();
            let near_range = ranges.iter().any(|range| abs(range.range_m - range_m) < resolution_m);
            let outside = range_m <= T::ZERO || range_m > T::of(self.config.ranging.max_range_m);
            if near_range || outside || scan.measurements.len() == self.capacity.paths {
                continue;
            }
            scan.measurements.push(Measurement {
                range_m,
                variance_m2: self.measurement_variance(pulse.range_variance_m2(path.sinr)),
                sinr: path.sinr,
                energy: square(path.amplitude[0]) + square(path.amplitude[1]),
            });
        }
        estimate
    }

    /// The estimator of a pulse.
    fn estimator(&mut self, pulse: &Pulse<T>) -> &ChannelEstimator<T> {
        let index = match self.estimators.iter().position(|(known, _)| known == pulse) {
            Some(index) => index,
            None => {
                let radio = &self.config.radio;
                let estimator = ChannelEstimator::new(
                    pulse.clone(),
                    T::of(radio.sample_spacing_s),
                    radio.samples_per_frame,
                    T::of(radio.false_paths_per_frame),
                    self.capacity.paths,
                );
                self.estimators.push((pulse.clone(), estimator));
                self.estimators.len() - 1
            }
        };
        &self.estimators[index].1
    }

    /// Inflated, and at least the floor.
    fn measurement_variance(&self, variance_m2: T) -> T {
        let ranging = &self.config.ranging;
        T::of(ranging.variance_inflation) * variance_m2 + square(T::of(ranging.floor_m))
    }

    // Associate.

    fn associate(&self, scan: Scan<T>, heights: &[T]) -> AssociatedScan<T> {
        let settings = &self.config.association;
        let sight = self.sight(scan.anchor, heights);
        let mut regressions = vec![self.filter.regress(Source::Direct { anchor: scan.anchor }, &sight)];
        let mut existences = vec![T::ONE];
        for (slot, record) in self.environment.in_use() {
            if record.anchor == scan.anchor {
                regressions.push(self.filter.regress(Source::Virtual { anchor: scan.anchor, slot }, &sight));
                let survival = T::of(settings.survival_probability);
                existences.push(EnvironmentMemory::expected_existence(&record, survival));
            }
        }
        let mut expectations = Vec::new();
        for k in 0..regressions.len() {
            expectations.push(Expectation {
                range_m: regressions[k].range_m,
                variance_m2: regressions[k].variance_m2(),
                existence: existences[k],
                detection: T::of(settings.detection_probability),
            });
        }
        let per_m = T::ONE / T::of(self.config.ranging.max_range_m);
        let clutter = Clutter {
            false_alarms_per_m: T::of(settings.clutter_per_anchor) * per_m,
            all_per_m: self.unexplained[scan.anchor] * per_m,
        };
        let mut beliefs = associate(&expectations, &scan.measurements, &clutter);
        if settings.mode == Mode::Map {
            beliefs.harden();
        }
        AssociatedScan { scan, regressions, beliefs }
    }

    // Remember.

    /// Existence, SINR, and how much of each scan nothing explained.
    fn remember(&mut self, heard: &[AssociatedScan<T>], report: &mut Report<T>) {
        self.channel.age();
        for AssociatedScan { scan, regressions, beliefs } in heard {
            for k in 0..regressions.len() {
                let source = regressions[k].source;
                let belief = &beliefs.features[k];
                if let Source::Virtual { slot, .. } = source {
                    self.environment.remember(slot, belief.existence, belief.missed < T::of(0.5));
                }
                for m in 0..scan.measurements.len() {
                    let weight = belief.associated[m];
                    if weight > T::of(0.5) && scan.measurements[m].sinr > T::ZERO {
                        let path = &scan.measurements[m];
                        self.channel.remember(source, scan.action, &self.library, path, weight);
                    }
                }
                if scan.framed && self.exists(source) && belief.missed > T::of(0.5) {
                    self.channel.remember_missed(source, scan.action, &self.library, belief.missed);
                }
            }
            report.anchors_heard += 1;
            let mut unexplained = T::ZERO;
            for free in &beliefs.unassociated {
                unexplained += *free;
                report.measurements += 1;
                if *free <= T::of(0.5) {
                    report.associated += 1;
                }
            }
            let mean = T::of(0.95) * self.unexplained[scan.anchor] + T::of(0.05) * unexplained;
            self.unexplained[scan.anchor] = larger(mean, T::of(self.config.association.clutter_per_anchor));
        }
    }

    /// Direct paths always do, virtual anchors when confirmed.
    fn exists(&self, source: Source) -> bool {
        match source {
            Source::Direct { .. } => true,
            Source::Virtual { slot, .. } => {
                self.environment.records[slot].is_some_and(|record| record.existence > T::of(CONFIRMED))
            }
        }
    }

    // Discover.

    /// Forgets improbable virtual anchors, feeds the candidates, and takes resolved ones into the map.
    fn discover(&mut self, heard: &[AssociatedScan<T>], heights: &[T], report: &mut Report<T>) {
        for slot in self.environment.forget() {
            self.take_out(slot, report);
        }
        if !self.config.discovery {
            return;
        }
        for AssociatedScan { scan, beliefs, .. } in heard {
            let sight = self.sight(scan.anchor, heights);
            let c = self.filter.agent_covariance();
            let viewpoint = Viewpoint {
                position_m: self.filter.position_m(),
                covariance_m2: [c[PX][PX], c[PY][PX], c[PY][PY]],
                height_m: sight.height_m,
            };
            let mut leftovers = Vec::new();
            for m in 0..scan.measurements.len() {
                if beliefs.unassociated[m] > T::of(0.5) {
                    let mut leftover = scan.measurements[m];
                    leftover.range_m -= self.filter.bias_m(scan.anchor);
                    leftovers.push(leftover);
                }
            }
            self.discovery.observe(scan.anchor, &viewpoint, &leftovers);
            while let Some(found) = self.discovery.take_resolved(scan.anchor) {
                self.take_in(scan.anchor, &sight, &found, report);
            }
        }
    }

    fn take_out(&mut self, slot: usize, report: &mut Report<T>) {
        self.filter.remove(slot);
        self.channel.forget(slot);
        report.forgotten += 1;
    }

    /// Enters a discovery into the map, unless it is known or there is no room.
    fn take_in(&mut self, anchor: usize, sight: &Sight<T>, found: &Discovered<T>, report: &mut Report<T>) {
        if self.is_known(anchor, sight, found) {
            return;
        }
        let slot = match self.environment.free_slot() {
            Some(slot) => slot,
            None => match self.environment.give_way() {
                Some(slot) => {
                    self.take_out(slot, report);
                    slot
                }
                None => {
                    report.map_full += 1;
                    return;
                }
            },
        };
        self.filter.insert_relative(slot, found.position_m, found.covariance_m2);
        self.environment.insert(slot, anchor, T::of(0.9));
        report.discovered += 1;
    }

    /// Within 0.3 m of the anchor or one of its virtual anchors.
    fn is_known(&self, anchor: usize, sight: &Sight<T>, found: &Discovered<T>) -> bool {
        let mut known = vec![sight.anchor_m];
        for (slot, record) in self.environment.in_use() {
            if record.anchor == anchor {
                known.push(self.filter.virtual_anchor_m(slot));
            }
        }
        let [x, y] = found.position_m;
        known.iter().any(|[kx, ky]| square(x - *kx) + square(y - *ky) < T::of(0.09))
    }

    // Act.

    /// Reward, learning, planning, choice. `[before, after prediction, after the update]` of the agent's covariance.
    fn act(
        &mut self,
        [previous, predicted, posterior]: [&Matrix<T>; 3],
        elapsed_s: T,
        heights: &[T],
        report: &mut Report<T>,
    ) {
        let settings = self.config.controller;
        let count = self.library.len();
        let temperature = T::of(settings.choice.temperature_nat);
        // One generator per cycle, from seed and cycle number.
        let mixed = self.seed ^ u64::from(self.cycle).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        let mut rng = Xoshiro128PlusPlus::seed_from_u64(mixed);

        let earned = reward(settings.reward, previous, predicted, posterior);
        learn(&mut self.values, report.action, earned, &self.policy, &settings.learning);
        self.policy = policy(&self.values, count, temperature);

        if settings.planned_actions > 0 && count > 1 {
            let keep = [self.action, super::controller::best(&self.values, count)];
            let planned = planned_set(&self.policy, count, settings.planned_actions, keep, &mut rng);
            let outlook = self.outlook(posterior, elapsed_s);
            let visible = self.visible(heights);
            let horizon = Horizon {
                steps: settings.horizon,
                discount: settings.learning.discount,
                reward: settings.reward,
            };
            for action in 0..count {
                if planned[action] {
                    let expected =
                        plan_one(action, &horizon, &outlook, &visible, &self.channel, &self.library);
                    learn(&mut self.values, action, expected, &self.policy, &settings.learning);
                }
            }
            self.policy = policy(&self.values, count, temperature);
            self.action = choose(&self.values, &self.policy, count, self.action, &settings.choice, &mut rng);
        }

        report.position_m = self.filter.position_m();
        // Order: the lower triangle's covariance, twice.
        let cross = posterior[PY][PX];
        report.position_covariance_m2 = [[posterior[PX][PX], cross], [cross, posterior[PY][PY]]];
        report.predicted_entropy_nat = position_entropy_nat(predicted);
        report.entropy_nat = position_entropy_nat(posterior);
        report.reward = earned;
        report.next_action = self.action;
        report.next = self.library.actions[self.action];
    }

    fn outlook(&self, posterior: &Matrix<T>, elapsed_s: T) -> Outlook<T> {
        Outlook {
            position_m: self.filter.position_m(),
            velocity_m_s: self.filter.velocity_m_s(),
            covariance: posterior.clone(),
            elapsed_s,
            acceleration_std_m_s2: T::of(self.config.motion.acceleration_std_m_s2),
            variance_inflation: T::of(self.config.ranging.variance_inflation),
            range_floor_m: T::of(self.config.ranging.floor_m),
            pulse_shape: self.config.radio.pulse_shape,
        }
    }

    /// The sources planning counts on: all direct paths, and the confirmed virtual anchors by slot.
    fn visible(&self, heights: &[T]) -> Vec<Visible<T>> {
        let mut visible = Vec::new();
        for anchor in 0..self.anchors.len() {
            visible.push(Visible {
                source: Source::Direct { anchor },
                position_m: self.anchors[anchor].position_m.map(T::of),
                height_m: heights[anchor],
                covariance_m2: [[T::ZERO; 2]; 2],
            });
        }
        for (slot, record) in self.environment.in_use() {
            if record.existence > T::of(CONFIRMED) {
                visible.push(Visible {
                    source: Source::Virtual { anchor: record.anchor, slot },
                    position_m: self.filter.virtual_anchor_m(slot),
                    height_m: heights[record.anchor],
                    covariance_m2: self.filter.virtual_anchor_covariance_m2(slot),
                });
            }
        }
        visible
    }

    fn blank_report(&self) -> Report<T> {
        Report {
            cycle: self.cycle,
            position_m: [T::ZERO; 2],
            position_covariance_m2: [[T::ZERO; 2]; 2],
            predicted_entropy_nat: T::ZERO,
            entropy_nat: T::ZERO,
            reward: T::ZERO,
            anchors_heard: 0,
            measurements: 0,
            associated: 0,
            discovered: 0,
            forgotten: 0,
            map_full: 0,
            action: self.action,
            next_action: self.action,
            next: self.library.actions[self.action],
        }
    }
}

/// What the measurements of each feature amount to; features with hardly any probability are left out.
fn innovations_of<T: Real>(associated: &AssociatedScan<T>) -> Vec<Innovation<T>> {
    let mut innovations = Vec::new();
    for k in 0..associated.regressions.len() {
        let regression = associated.regressions[k];
        let mut weight = T::ZERO;
        let mut first_m = T::ZERO;
        let mut second_m2 = T::ZERO;
        let mut variance = T::ZERO;
        for m in 0..associated.scan.measurements.len() {
            let measurement = &associated.scan.measurements[m];
            let p = associated.beliefs.features[k].associated[m];
            let nu = measurement.range_m - regression.range_m;
            weight += p;
            first_m += p * nu;
            second_m2 += p * square(nu);
            variance += p * measurement.variance_m2;
        }
        if weight >= T::of(1e-3) {
            let variance_m2 = variance / weight;
            innovations.push(Innovation { regression, weight, first_m, second_m2, variance_m2 });
        }
    }
    innovations
}
