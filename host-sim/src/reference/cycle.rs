//! The whole cycle, stage by stage: [`Reference::cycle`] reads top to bottom.

use super::acquisition::{Acquisition, Landmark, Sweep};
use super::association::{
    Belief, Beliefs, Clutter, Expectation, Measurement, associate, detection_probability, false_alarm,
};
use super::channel_estimator::{ChannelEstimate, ChannelEstimator, NoiseLevel};
use super::channel_memory::{ChannelMemory, Received, jump};
use super::controller::{Controller, Library, Outcome, Outlook, Prospect, Visible, reward};
use super::discovery::{Background, Claims, Discovered, Discovery, Viewpoint};
use super::environment::{CONFIRMED, EnvironmentMemory};
use super::gain_control::GainControl;
use super::information::position_entropy_nat;
use super::loss::{LossMonitor, evidence_nat};
use super::manoeuvre::{ACCELERATION_FACTOR, is_doubtful, is_manoeuvre};
use super::overlap::{Arrival, overlap};
use super::pulse::Pulse;
use super::real::{Real, abs, larger, limited, smaller, speed_of_light, square};
use super::state_filter::{Agent, Innovation, PX, PY, Prior, Regression, Sight, StateFilter, VX, VY};
use super::{Matrix, zeros};
use cogmint_core::model::observation::{Frame, Observation, RangeScan, TagHeight};
use cogmint_core::model::source::Source;
use cogmint_core::perceptor::association::Mode;
use cogmint_core::perceptor::scan::ARTEFACT_RATIO;
use cogmint_core::radio::library::Action;
use cogmint_core::{Anchor, Config, MappedVirtualAnchor};

/// Detection probability of a source that is hidden, and of a virtual anchor that is on the map but was never seen.
const HIDDEN_DETECTION: f32 = 0.1;
/// Virtual anchors nearer than this may be one, metres.
const NEAR_M: f32 = 0.3;

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
    /// Threshold of the frame's pulse on the normalised energy of a path; 0 without a frame.
    pub threshold: T,
    /// The frame's noise and its first sample's delay, seconds.
    pub noise: Option<(NoiseLevel<T>, T)>,
    /// The power that counts as 1.
    pub unit: T,
    /// Ranges and paths that there was no room for.
    pub left_out: u32,
}

/// A scan and what was made of it; features are the direct path, then the anchor's virtual anchors by slot.
#[derive(Clone, Debug)]
pub struct AssociatedScan<T> {
    /// The scan.
    pub scan: Scan<T>,
    /// Per feature, the range expected.
    pub regressions: Vec<Regression<T>>,
    /// What the candidates of the discovery made of it.
    pub claims: Claims<T>,
    /// Per feature, the beliefs.
    pub beliefs: Beliefs<T>,
    /// Evidence that the tag is where it is believed to be, nats.
    pub evidence_nat: T,
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
    /// The estimator of each pulse met so far.
    estimators: Vec<(Pulse<T>, ChannelEstimator<T>)>,
    /// Threshold of the pulse last used.
    threshold: T,

    /// Cycles run.
    pub cycle: u32,
    /// What frames are measured in, by anchor.
    pub gain_control: Vec<GainControl<T>>,
    /// Tag, biases and virtual anchors.
    pub filter: StateFilter<T>,
    /// Which virtual anchors exist.
    pub environment: EnvironmentMemory<T>,
    /// How well sources are heard.
    pub channel: ChannelMemory<T>,
    /// Candidates for virtual anchors.
    pub discovery: Discovery<T>,
    /// Places the tag may be at, while it is not known where it is.
    pub acquisition: Option<Acquisition<T>>,
    /// Whether it is where it is believed to be.
    pub loss: LossMonitor<T>,
    /// One for each anchor, or one for all.
    pub controllers: Vec<Controller<T>>,
    /// Cycles in a row in which an anchor was not heard.
    pub missing: Vec<u32>,
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
        let speed = T::of(config.start.velocity_std_m_s);
        let acquisition =
            Some(Acquisition::new(filter.agent(), square(speed), capacity.anchors, config.acquisition));
        let mut environment = EnvironmentMemory::new(capacity.virtual_anchors);
        for slot in 0..map.len() {
            let std_m = if config.exact_map { 0.0 } else { map[slot].std_m };
            filter.insert_independent(slot, map[slot].position_m.map(T::of), T::of(std_m));
            environment.insert(slot, map[slot].anchor, T::of(0.9), 0);
        }
        let association = &config.association;
        let unexplained = T::of(association.clutter_per_anchor) + T::of(association.unmapped_per_anchor);
        let library = Library::new(actions);
        let channel = ChannelMemory::new(
            [capacity.anchors, capacity.virtual_anchors, capacity.actions],
            T::of(config.controller.prior_sinr),
            config.controller.neighbours,
            &library,
        );
        let controller = |index: usize| {
            let seed = seed ^ (index as u64).wrapping_mul(0xd1b5_4a32_d192_ed03);
            Controller::new(config.controller, &library, capacity.actions, seed)
        };
        let choices = if config.controller.per_anchor { anchors.len() } else { 1 };
        let mut reference = Self {
            config,
            controllers: (0..choices).map(controller).collect(),
            missing: vec![0; capacity.anchors],
            capacity,
            anchors: anchors.to_vec(),
            library,
            estimators: Vec::new(),
            threshold: T::ZERO,
            cycle: 0,
            gain_control: vec![GainControl::default(); capacity.anchors],
            filter,
            environment,
            channel,
            discovery: Discovery::new(capacity.anchors, config.discovery_settings),
            acquisition,
            loss: LossMonitor::new(),
            unexplained: vec![unexplained; capacity.anchors],
            last_sequence: vec![None; capacity.anchors],
        };
        let first = config.controller.first_action;
        let first = reference.library.pulse(first, &config.radio);
        reference.threshold = reference.estimator(&first).threshold();
        reference
    }

    /// One cycle of input that the core accepts.
    pub fn cycle(
        &mut self,
        observations: &[Observation<'_>],
        elapsed_s: f32,
        tag_height: Option<TagHeight>,
    ) -> Intermediates<T> {
        let elapsed_s = T::of(elapsed_s);
        let heights = self.heights(tag_height);
        let (estimates, scans) = self.estimate(observations);

        let last = self.filter.agent();
        self.filter.predict(elapsed_s);
        let predicted = self.filter.agent();
        self.discovery.predict(&last, &predicted, elapsed_s);
        let variances = (predicted.covariance[PX][PX], predicted.covariance[PY][PY]);
        let gap = self.acquisition.is_none() && LossMonitor::is_too_wide(variances.0, variances.1);
        if gap {
            self.lose_sight(&last, &predicted);
        }
        self.acquire(&scans, if gap { T::ZERO } else { elapsed_s }, &heights);
        if self.acquisition.is_none() {
            self.follow_manoeuvre(&scans, elapsed_s, &heights);
        }

        // All scans are associated, and all regressions taken, before the first update.
        let heard: Vec<_> = scans.into_iter().map(|scan| self.associate(scan, &heights)).collect();

        let mut report = self.blank_report();
        if self.acquisition.is_none() {
            report.lost = self.watch(&heard);
        }
        report.acquiring = self.acquisition.is_some();
        report.left_out = heard.iter().map(|associated| associated.scan.left_out).sum();
        if !report.acquiring {
            let before = self.filter.agent();
            let mut innovations = Vec::new();
            for scan in &heard {
                innovations.extend(innovations_of(scan));
            }
            self.filter.update(&innovations);
            self.discovery.follow(&before, &self.filter.agent());
            self.unmask(&heard);
            self.remember(&heard, &mut report);
            report.nis = normalised_innovation(&heard);
            if !self.loss.is_doubtful() {
                self.discover(&heard, &heights, &mut report);
            }
        } else {
            self.channel.age();
            for associated in &heard {
                self.remember_noise(associated);
            }
        }
        let posterior = self.filter.agent_covariance();
        let covariances = [&last.covariance, &predicted.covariance, &posterior];
        self.act(covariances, elapsed_s, &heard, &heights, &mut report);

        for observation in observations {
            if let Observation::Frame(Frame { anchor, sequence: Some(sequence), .. }) = *observation {
                self.last_sequence[anchor] = Some(sequence);
            }
        }
        self.cycle = self.cycle.wrapping_add(1);
        Intermediates { estimates, heard, report }
    }

    /// Height of each anchor above the tag, mean and deviation; 0 where the tag's is unknown.
    fn heights(&self, tag_height: Option<TagHeight>) -> Vec<[T; 2]> {
        let height = |anchor: &Anchor| {
            tag_height.map_or([T::ZERO; 2], |TagHeight { mean_m, std_m }| {
                [T::of(anchor.height_m) - T::of(mean_m), T::of(std_m)]
            })
        };
        self.anchors.iter().map(height).collect()
    }

    fn sight(&self, anchor: usize, heights: &[[T; 2]]) -> Sight<T> {
        let [height_m, height_std_m] = heights[anchor];
        Sight { anchor_m: self.anchors[anchor].position_m.map(T::of), height_m, height_std_m }
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
            let mut scan = Scan {
                anchor,
                action: self.action(anchor),
                measurements: Vec::new(),
                framed: false,
                threshold: T::ZERO,
                noise: None,
                unit: T::ONE,
                left_out: 0,
            };
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

    /// The ranges in their order, without the worst where there are too many: sorted by variance, then length, then
    /// place, those that follow the capacity.
    fn take_ranges(&self, ranges: &RangeScan<'_>, scan: &mut Scan<T>) {
        let mut all = Vec::new();
        for range in ranges.ranges {
            all.push(Measurement {
                range_m: T::of(range.range_m),
                variance_m2: self.measurement_variance(T::of(range.variance_m2)),
                sinr: T::ZERO,
                energy: T::ZERO,
                false_alarm: T::ONE,
            });
        }
        let mut best: Vec<usize> = (0..all.len()).collect();
        best.sort_by(|&i, &j| {
            let key = |n: usize| (all[n].variance_m2, all[n].range_m, n);
            key(i).partial_cmp(&key(j)).unwrap_or(std::cmp::Ordering::Equal)
        });
        let kept = all.len().min(self.capacity.paths);
        best.truncate(kept);
        best.sort_unstable();
        scan.left_out += (all.len() - kept) as u32;
        scan.measurements.extend(best.into_iter().map(|n| all[n]));
    }

    fn take_frame(&mut self, frame: &Frame<'_>, scan: &mut Scan<T>) -> ChannelEstimate<T> {
        let pulse = self.library.pulse(frame.action, &self.config.radio);
        let estimator = self.estimator(&pulse);
        let estimate = estimator.estimate(frame.samples, T::of(frame.first_sample_delay_s));
        scan.action = frame.action;
        scan.framed = true;
        let threshold = estimator.threshold();
        scan.threshold = threshold;
        scan.unit = if self.config.radio.gain_control {
            let Frame { anchor, action, samples, .. } = *frame;
            let loss_ln = self.channel.loss_ln(action);
            let Controller { held, sought_with, .. } = *self.controller(anchor);
            // The last frame of a turn may come after it, where choices are announced.
            let turn =
                sought_with == Some(action) || self.gain_control[anchor].waiting_with() == Some(action);
            let sought = self.acquisition.is_some() && action != held && turn;
            self.gain_control[anchor].unit(samples, estimate.noise.white, action, loss_ln, sought)
        } else {
            T::ONE
        };
        scan.noise = Some((estimate.noise.clone(), T::of(frame.first_sample_delay_s)));
        let ranges = scan.measurements.clone();
        self.threshold = threshold;
        let resolution_m = pulse.duration_s * speed_of_light();
        for path in &estimate.paths {
            let range_m = path.delay_s * speed_of_light();
            let near_range = ranges.iter().any(|range| abs(range.range_m - range_m) < resolution_m);
            let outside = range_m <= T::ZERO || range_m > T::of(self.config.ranging.max_range_m);
            if near_range || outside {
                continue;
            }
            if scan.measurements.len() == self.capacity.paths {
                scan.left_out += 1;
                continue;
            }
            scan.measurements.push(Measurement {
                range_m,
                variance_m2: self.measurement_variance(pulse.range_variance_m2(path.sinr)),
                sinr: path.sinr,
                energy: (square(path.amplitude[0]) + square(path.amplitude[1])) / scan.unit,
                false_alarm: false_alarm(path.sinr, scan.threshold),
            });
        }
        // What lies beside a much stronger path may be a remainder of that.
        for n in ranges.len()..scan.measurements.len() {
            let own = scan.measurements[n];
            let beside = scan.measurements.iter().any(|other| {
                abs(other.range_m - own.range_m) < resolution_m
                    && other.sinr > T::of(ARTEFACT_RATIO) * own.sinr
            });
            if beside {
                scan.measurements[n].false_alarm = T::ONE;
            }
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
                    self.config.estimator,
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

    // Acquire.

    /// While it is not known where the tag is: weighs the places it may be at. Once there is only one, it is there.
    fn acquire(&mut self, scans: &[Scan<T>], elapsed_s: T, heights: &[[T; 2]]) {
        let Some(mut acquisition) = self.acquisition.take() else { return };
        // Candidates are relative to a tag that is about to jump.
        self.discovery.clear();
        acquisition.predict(&self.config.motion, elapsed_s);
        let sweeps: Vec<_> =
            scans.iter().map(|scan| self.sweep(scan, &acquisition, elapsed_s, heights)).collect();
        if !acquisition.observe(&sweeps) {
            self.acquisition = Some(acquisition);
            return;
        }
        match acquisition.settled() {
            Some(agent) => self.filter.place(&agent),
            None => {
                self.filter.place(&acquisition.summary());
                self.acquisition = Some(acquisition);
            }
        }
    }

    /// A scan with its anchor and its virtual anchors.
    fn sweep(&self, scan: &Scan<T>, acquisition: &Acquisition<T>, dt: T, heights: &[[T; 2]]) -> Sweep<T> {
        let sight = self.sight(scan.anchor, heights);
        let height_m = [sight.height_m, sight.height_std_m];
        let mut reflections = Vec::new();
        for (slot, record) in self.environment.in_use() {
            if record.anchor == scan.anchor {
                reflections.push(Landmark {
                    position_m: self.filter.virtual_anchor_m(slot),
                    covariance_m2: self.filter.virtual_anchor_covariance_m2(slot),
                    height_m,
                    detection: record.existence
                        * self.detection(Source::Virtual { anchor: scan.anchor, slot }, scan, None),
                });
            }
        }
        let background = self.background(scan.anchor);
        let all_per_m = background.all_per_m;
        let unmapped =
            (T::ONE - background.false_alarms_per_m / all_per_m) * background.detection_probability;
        Sweep {
            anchor: scan.anchor,
            measurements: scan.measurements.clone(),
            direct: Landmark {
                position_m: sight.anchor_m,
                covariance_m2: [[T::ZERO; 2]; 2],
                height_m,
                detection: self.detection(Source::Direct { anchor: scan.anchor }, scan, None),
            },
            reflections,
            bias_m: self.filter.bias_m(scan.anchor),
            bias_variance_m2: self.filter.bias_variance_m2(scan.anchor),
            all_per_m: acquisition.backgrounds(scan.anchor, &scan.measurements, all_per_m, unmapped, dt),
            false_alarms_per_m: background.false_alarms_per_m,
            anywhere_per_m: T::ONE / T::of(self.config.ranging.max_range_m),
        }
    }

    /// What measurements of an anchor may be, other than paths of what is known.
    fn background(&self, anchor: usize) -> Background<T> {
        let per_m = T::ONE / T::of(self.config.ranging.max_range_m);
        let settings = &self.config.association;
        Background {
            all_per_m: self.unexplained[anchor] * per_m,
            false_alarms_per_m: T::of(settings.clutter_per_anchor) * per_m,
            detection_probability: T::of(settings.detection_probability),
        }
    }

    // Follow a manoeuvre.

    /// Widens the prediction where a manoeuvre explains the scans better by far.
    fn follow_manoeuvre(&mut self, scans: &[Scan<T>], elapsed_s: T, heights: &[[T; 2]]) {
        let mut direct = Vec::new();
        for scan in scans {
            let source = Source::Direct { anchor: scan.anchor };
            let line = self.filter.regress(source, &self.sight(scan.anchor, heights));
            let nis = scan.measurements.iter().map(|measurement| {
                square(measurement.range_m - line.range_m) / (line.variance_m2() + measurement.variance_m2)
            });
            direct.push((self.detection(source, scan, Some(line.range_m)), nis.reduce(smaller)));
        }
        if !is_doubtful(&direct) {
            return;
        }
        let motion = self.evidence_nat(scans, heights);
        let predicted = self.filter.agent_covariance();
        let acceleration_std_m_s2 =
            T::of(ACCELERATION_FACTOR) * T::of(self.config.motion.acceleration_density_m2_s3);
        self.filter.disturb(acceleration_std_m_s2, elapsed_s);
        if !is_manoeuvre(motion, self.evidence_nat(scans, heights)) {
            self.filter.undisturb(&predicted);
        }
    }

    /// Evidence of all scans for the present prediction.
    fn evidence_nat(&self, scans: &[Scan<T>], heights: &[[T; 2]]) -> T {
        let mut evidence = T::ZERO;
        for scan in scans {
            evidence += self.associate(scan.clone(), heights).evidence_nat;
        }
        evidence
    }

    // Associate.

    fn associate(&self, scan: Scan<T>, heights: &[[T; 2]]) -> AssociatedScan<T> {
        let settings = &self.config.association;
        let sight = self.sight(scan.anchor, heights);
        let mut regressions = vec![self.filter.regress(Source::Direct { anchor: scan.anchor }, &sight)];
        let mut existences = vec![T::ONE];
        let direct = regressions[0];
        let mut detections = vec![self.detection(direct.source, &scan, Some(direct.range_m))];
        for (slot, record) in self.environment.in_use() {
            if record.anchor == scan.anchor {
                let source = Source::Virtual { anchor: scan.anchor, slot };
                let regression = self.filter.regress(source, &sight);
                let detection = self.detection(source, &scan, Some(regression.range_m));
                let survival = T::of(settings.map_change_per_s);
                regressions.push(regression);
                existences.push(EnvironmentMemory::expected_existence(&record, survival, detection));
                detections.push(detection);
            }
        }
        if scan.framed {
            let pulse = self.library.pulse(scan.action, &self.config.radio);
            let arrivals: Vec<_> = (0..regressions.len())
                .map(|k| Arrival {
                    range_m: regressions[k].range_m,
                    presence: existences[k] * detections[k],
                    sinr: self.channel.sinr(regressions[k].source, scan.action),
                })
                .collect();
            for k in 0..regressions.len() {
                let (variance_m2, detection) = overlap(&pulse, &arrivals, k, detections[k]);
                regressions[k].residual_m2 += variance_m2;
                detections[k] = detection;
            }
        }
        let mut expectations = Vec::new();
        for k in 0..regressions.len() {
            expectations.push(Expectation {
                range_m: regressions[k].range_m,
                variance_m2: regressions[k].variance_m2(),
                existence: existences[k],
                detection: detections[k],
            });
        }
        let background = self.background(scan.anchor);
        let clutter =
            Clutter { false_alarms_per_m: background.false_alarms_per_m, all_per_m: background.all_per_m };
        let viewpoint = self.viewpoint(scan.anchor, &sight);
        let claims = self.discovery.claim(scan.anchor, &viewpoint, &scan.measurements, &background);
        let mut beliefs = associate(&expectations, &scan.measurements, &claims.totals(), &clutter);
        if settings.mode == Mode::Map {
            beliefs.harden();
        }
        let evidence_nat = evidence_nat(&scan.measurements, &expectations, &clutter);
        AssociatedScan { scan, regressions, claims, beliefs, evidence_nat }
    }

    /// Probability that the path of an existing source is found in a scan; in frames it is a matter of SINR.
    fn detection(&self, source: Source, scan: &Scan<T>, range_m: Option<T>) -> T {
        let told = T::of(self.config.association.detection_probability);
        if !scan.framed {
            return told;
        }
        if self.channel.has_seen(source) {
            let [_, found] = self.expected(source, scan, range_m);
            return limited(self.channel.visibility(source) * found, T::of(HIDDEN_DETECTION), told);
        }
        match source {
            Source::Virtual { slot, .. }
                if self.environment.records[slot].is_some_and(|record| record.hits == 0) =>
            {
                T::of(HIDDEN_DETECTION)
            }
            _ => told,
        }
    }

    /// SINR of a source in a scan, where nothing hides it, and the probability that it is found: the SINR remembered, or
    /// that over the noise of this frame where it is less.
    fn expected(&self, source: Source, scan: &Scan<T>, range_m: Option<T>) -> [T; 2] {
        let mut sinr = self.channel.sinr(source, scan.action);
        if let Some(now) = range_m.and_then(|range_m| self.sinr_over_noise(source, scan, range_m)) {
            sinr = smaller(sinr, now);
        }
        [sinr, detection_probability(sinr, scan.threshold)]
    }

    /// Noise of a frame where a path of this length arrives, in the frame's unit; none without a frame.
    fn noise_at(&self, scan: &Scan<T>, range_m: T) -> Option<T> {
        let (noise, first_s) = scan.noise.as_ref()?;
        let spacing_s = T::of(self.config.radio.sample_spacing_s);
        Some(noise.at((range_m / speed_of_light() - *first_s) / spacing_s, spacing_s) / scan.unit)
    }

    /// SINR that a source's energy has over the noise of a frame; none without a frame, or where it was never seen.
    fn sinr_over_noise(&self, source: Source, scan: &Scan<T>, range_m: T) -> Option<T> {
        self.channel.sinr_over(source, scan.action, range_m, self.noise_at(scan, range_m)?)
    }

    /// A frame as the channel memory takes it: whether the mean change of the noise is a jump.
    fn received(&self, associated: &AssociatedScan<T>) -> Received<T> {
        let AssociatedScan { scan, regressions, .. } = associated;
        let action = scan.action;
        let (mut noise, mut count) = (T::ZERO, T::ZERO);
        for regression in regressions {
            let level = self.noise_at(scan, regression.range_m);
            if let Some(change) =
                level.and_then(|level| self.channel.noise_change(regression.source, action, level))
            {
                noise += change;
                count += T::ONE;
            }
        }
        let shares = self.channel.shares(action, &self.library);
        Received { action, shares, jump: jump(noise / larger(count, T::ONE)) }
    }

    /// The tag was found: what gain control hid until another action was tried is charged to the one held.
    fn unmask(&mut self, heard: &[AssociatedScan<T>]) {
        for AssociatedScan { scan, .. } in heard {
            let anchor = scan.anchor;
            if !scan.framed {
                continue;
            }
            let Some(excess_ln) = self.gain_control[anchor].found() else { continue };
            let mut shares = self.channel.shares(self.controller(anchor).held, &self.library);
            shares[scan.action] = T::ZERO;
            self.channel.unmask(Source::Direct { anchor }, &shares, excess_ln);
            for (slot, record) in self.environment.in_use() {
                if record.anchor == anchor {
                    self.channel.unmask(Source::Virtual { anchor, slot }, &shares, excess_ln);
                }
            }
        }
    }

    /// The noise of a frame, for every source, where association means nothing.
    fn remember_noise(&mut self, associated: &AssociatedScan<T>) {
        let scan = &associated.scan;
        // What waits for the tag is not compared.
        if !scan.framed || self.gain_control[scan.anchor].waiting_with().is_some() {
            return;
        }
        let received = self.received(associated);
        for regression in &associated.regressions {
            if let Some(level) = self.noise_at(scan, regression.range_m) {
                self.channel.remember_noise(regression.source, &received, [regression.range_m, level]);
            }
        }
        self.channel.remember_frame(scan.anchor, &received);
    }

    /// Where an anchor's candidates are seen from.
    fn viewpoint(&self, anchor: usize, sight: &Sight<T>) -> Viewpoint<T> {
        let direct = self.filter.regress(Source::Direct { anchor }, sight);
        Viewpoint {
            agent: self.filter.agent(),
            height_m: [sight.height_m, sight.height_std_m],
            bias_m: self.filter.bias_m(anchor),
            direct_m: direct.range_m,
            direct_variance_m2: direct.variance_m2(),
        }
    }

    // Remember.

    /// Existence, SINR, and how much of each scan nothing explained.
    fn remember(&mut self, heard: &[AssociatedScan<T>], report: &mut Report<T>) {
        self.channel.age();
        for associated in heard {
            if self.loss.is_doubtful() {
                self.remember_noise(associated);
            }
            let AssociatedScan { scan, regressions, beliefs, .. } = associated;
            // From a doubtful place, what is missing may well be there.
            let judged = if self.loss.is_doubtful() { 0 } else { regressions.len() };
            let received = self.received(associated);
            for k in 0..judged {
                let Regression { source, range_m, .. } = regressions[k];
                let belief = &beliefs.features[k];
                if let Source::Virtual { slot, .. } = source {
                    let detection = self.detection(source, scan, Some(range_m));
                    let seen = belief.missed < T::of(0.5);
                    self.environment.remember(slot, belief.existence, seen, detection);
                }
                if !scan.framed {
                    continue;
                }
                for m in own_paths(scan, belief) {
                    self.channel.remember(source, &received, &scan.measurements[m], belief.associated[m]);
                }
                if let Some(level) = self.noise_at(scan, range_m) {
                    self.channel.remember_noise(source, &received, [range_m, level]);
                }
                let [_, found] = self.expected(source, scan, Some(range_m));
                self.channel.remember_missed(source, found, belief.missed);
            }
            if scan.framed && judged > 0 {
                self.channel.remember_frame(scan.anchor, &received);
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

    // Discover.

    /// From now on the tag may be anywhere around a position; variances of position and velocity per axis.
    fn lose(&mut self, position_m: [T; 2], position_m2: [T; 2], velocity_m2_s2: [T; 2]) {
        let mut prior = Agent { mean: vec![T::ZERO; 4], covariance: zeros(4, 4) };
        for (axis, (p, v)) in [(PX, VX), (PY, VY)].into_iter().enumerate() {
            prior.mean[p] = position_m[axis];
            prior.covariance[p][p] = position_m2[axis];
            prior.covariance[v][v] = velocity_m2_s2[axis];
        }
        let speed = T::of(self.config.start.velocity_std_m_s);
        self.loss = LossMonitor::new();
        self.acquisition =
            Some(Acquisition::new(prior, square(speed), self.capacity.anchors, self.config.acquisition));
    }

    /// After a gap: between where it was and where its velocity would have brought it.
    fn lose_sight(&mut self, last: &Agent<T>, predicted: &Agent<T>) {
        let reach = T::of(self.config.motion.position_std_limit_m);
        let speed = T::of(self.config.start.velocity_std_m_s);
        let position_m2 = [PX, PY].map(|p| {
            let way = predicted.mean[p] - last.mean[p];
            smaller(predicted.covariance[p][p] + square(way), square(reach))
        });
        let velocity_m2_s2 = [VX, VY].map(|v| square(speed) + square(last.mean[v]));
        self.lose([last.mean[PX], last.mean[PY]], position_m2, velocity_m2_s2);
    }

    /// Adds up the evidence; true where the tag must be elsewhere.
    fn watch(&mut self, heard: &[AssociatedScan<T>]) -> bool {
        let mut evidence_nat = T::ZERO;
        for associated in heard {
            evidence_nat += associated.evidence_nat;
        }
        self.loss.observe(evidence_nat);
        if !self.loss.is_lost() {
            return false;
        }
        let believed = self.filter.agent();
        let reach = T::of(self.config.motion.position_std_limit_m);
        let speed = T::of(self.config.start.velocity_std_m_s);
        let position_m = [believed.mean[PX], believed.mean[PY]];
        self.lose(position_m, [square(reach); 2], [square(speed); 2]);
        if let Some(acquisition) = &mut self.acquisition {
            acquisition.suggest(believed);
        }
        true
    }

    /// Of two virtual anchors of an anchor that are one, the younger goes.
    fn merge(&mut self, report: &mut Report<T>) {
        for (slot, record) in self.environment.in_use() {
            if record.hits == 0 {
                continue;
            }
            let (a, c) = (self.filter.virtual_anchor_m(slot), self.filter.virtual_anchor_covariance_m2(slot));
            let mut doubled = false;
            for (other, twin) in self.environment.in_use() {
                let (b, d) =
                    (self.filter.virtual_anchor_m(other), self.filter.virtual_anchor_covariance_m2(other));
                let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
                let (xx, yx, yy) = (c[0][0] + d[0][0], c[1][0] + d[1][0], c[1][1] + d[1][1]);
                let form = yy * square(dx) - T::of(2.0) * (yx * (dx * dy)) + xx * square(dy);
                let near = square(dx) + square(dy) < square(T::of(NEAR_M)) && form < xx * yy - square(yx);
                let older = twin.hits > record.hits || (twin.hits == record.hits && other < slot);
                doubled |= twin.anchor == record.anchor && other != slot && near && older;
            }
            if doubled {
                self.environment.records[slot] = None;
                self.take_out(slot, report);
            }
        }
    }

    /// Detection probabilities by slot; 0 where it is free.
    fn detections(&self, scan: &Scan<T>) -> Vec<T> {
        let mut detections = vec![T::ZERO; self.environment.records.len()];
        for (slot, record) in self.environment.in_use() {
            detections[slot] = self.detection(Source::Virtual { anchor: record.anchor, slot }, scan, None);
        }
        detections
    }

    /// Forgets improbable virtual anchors, feeds the candidates, and takes resolved ones into the map.
    fn discover(&mut self, heard: &[AssociatedScan<T>], heights: &[[T; 2]], report: &mut Report<T>) {
        for slot in self.environment.forget() {
            self.take_out(slot, report);
        }
        self.merge(report);
        if !self.config.discovery {
            return;
        }
        for AssociatedScan { scan, claims, beliefs, regressions, .. } in heard {
            let sight = self.sight(scan.anchor, heights);
            let viewpoint = self.viewpoint(scan.anchor, &sight);
            let background = self.background(scan.anchor);
            let (measurements, free) = (&scan.measurements, &beliefs.unassociated);
            let known_m: Vec<T> = regressions.iter().map(|line| line.range_m).collect();
            // Paths closer than a pulse cannot be told apart.
            let resolution_m = if scan.framed {
                self.library.pulse(scan.action, &self.config.radio).duration_s * speed_of_light()
            } else {
                T::ZERO
            };
            self.discovery.observe(
                scan.anchor,
                &viewpoint,
                measurements,
                claims,
                free,
                &background,
                &known_m,
                resolution_m,
            );
            while let Some(found) = self.discovery.take_resolved(scan.anchor) {
                self.take_in(scan, &sight, &found, report);
            }
        }
    }

    fn take_out(&mut self, slot: usize, report: &mut Report<T>) {
        self.filter.remove(slot);
        self.channel.forget(slot);
        report.forgotten += 1;
    }

    /// Enters a discovery into the map, unless it is known or there is no room.
    fn take_in(&mut self, scan: &Scan<T>, sight: &Sight<T>, found: &Discovered<T>, report: &mut Report<T>) {
        let anchor = scan.anchor;
        if self.is_known(anchor, sight, found) {
            return;
        }
        let slot = match self.environment.free_slot() {
            Some(slot) => slot,
            None => match self.environment.give_way(&self.detections(scan)) {
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
        self.filter.insert_relative(slot, found.position_m, found.gain, found.covariance_m2);
        self.environment.insert(slot, anchor, T::of(0.9), 1);
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
        known.iter().any(|[kx, ky]| square(x - *kx) + square(y - *ky) < square(T::of(NEAR_M)))
    }

    // Act.

    /// Reward, learning, planning, choice. `[before, after prediction, after the update]` of the agent's covariance.
    fn act(
        &mut self,
        [previous, predicted, posterior]: [&Matrix<T>; 3],
        elapsed_s: T,
        heard: &[AssociatedScan<T>],
        heights: &[[T; 2]],
        report: &mut Report<T>,
    ) {
        let earned = reward(self.config.controller.reward, previous, predicted, posterior);
        let outlook = self.outlook(posterior, elapsed_s);
        let visible = self.visible(heights);
        let common = self.controllers.len() == 1;
        for anchor in 0..self.missing.len() {
            let answered = heard.iter().any(|associated| associated.scan.anchor == anchor);
            self.missing[anchor] = if answered { 0 } else { self.missing[anchor].saturating_add(1) };
        }
        // From the third frame lost, and every 64 cycles after it, for five cycles.
        let called =
            common && self.missing[..self.anchors.len()].iter().any(|&lost| lost >= 3 && (lost - 3) % 64 < 5);
        for index in 0..self.controllers.len() {
            let mut outcome = Outcome {
                applied: self.controllers[index].action,
                earned: None,
                heard: false,
                lost: report.acquiring,
                called,
            };
            let mut framed = false;
            for associated in heard {
                if common || associated.scan.anchor == index {
                    outcome.heard = true;
                    // The action received with earns the reward: of the first, where frames differ.
                    if associated.scan.framed && !framed {
                        framed = true;
                        outcome.applied = associated.scan.action;
                    }
                }
            }
            if !report.acquiring && outcome.heard {
                outcome.earned = Some(earned);
            }
            let mut own = Vec::new();
            let mut others = Vec::new();
            for source in &visible {
                let anchor = source.source.anchor();
                if common || anchor == index {
                    own.push(*source);
                } else {
                    others.push((*source, self.controllers[anchor].held));
                }
            }
            let prospect =
                Prospect { outlook: &outlook, own, others, memory: &self.channel, library: &self.library };
            self.controllers[index].decide(self.cycle, &outcome, &prospect);
            if index == 0 {
                report.action = outcome.applied;
            }
        }

        report.position_m = self.filter.position_m();
        // Order: the lower triangle's covariance, twice.
        let cross = posterior[PY][PX];
        report.position_covariance_m2 = [[posterior[PX][PX], cross], [cross, posterior[PY][PY]]];
        report.predicted_entropy_nat = position_entropy_nat(predicted);
        report.entropy_nat = position_entropy_nat(posterior);
        report.reward = earned;
        report.next_action = self.action(0);
        report.next = self.library.actions[report.next_action];
    }

    /// The controller that chooses for an anchor.
    fn controller(&self, anchor: usize) -> &Controller<T> {
        &self.controllers[if self.controllers.len() == 1 { 0 } else { anchor }]
    }

    /// The action that an anchor's next frame should use.
    fn action(&self, anchor: usize) -> usize {
        self.controller(anchor).action
    }

    fn outlook(&self, posterior: &Matrix<T>, elapsed_s: T) -> Outlook<T> {
        Outlook {
            position_m: self.filter.position_m(),
            velocity_m_s: self.filter.velocity_m_s(),
            covariance: posterior.clone(),
            elapsed_s,
            acceleration_std_m_s2: T::of(self.config.motion.acceleration_density_m2_s3),
            variance_inflation: T::of(self.config.ranging.variance_inflation),
            range_floor_m: T::of(self.config.ranging.floor_m),
            radio: self.config.radio,
            threshold: self.threshold,
        }
    }

    /// The sources planning counts on: all direct paths, and the confirmed virtual anchors by slot.
    fn visible(&self, heights: &[[T; 2]]) -> Vec<Visible<T>> {
        let mut visible = Vec::new();
        for anchor in 0..self.anchors.len() {
            visible.push(Visible {
                source: Source::Direct { anchor },
                position_m: self.anchors[anchor].position_m.map(T::of),
                height_m: heights[anchor][0],
                covariance_m2: [[T::ZERO; 2]; 2],
            });
        }
        for (slot, record) in self.environment.in_use() {
            if record.existence > T::of(CONFIRMED) {
                visible.push(Visible {
                    source: Source::Virtual { anchor: record.anchor, slot },
                    position_m: self.filter.virtual_anchor_m(slot),
                    height_m: heights[record.anchor][0],
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
            left_out: 0,
            associated: 0,
            acquiring: false,
            lost: false,
            nis: T::ZERO,
            discovered: 0,
            forgotten: 0,
            map_full: 0,
            action: self.action(0),
            next_action: self.action(0),
            next: self.library.actions[self.action(0)],
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

/// Mean of nu^2 / S over everything associated; 0 without measurements.
fn normalised_innovation<T: Real>(heard: &[AssociatedScan<T>]) -> T {
    let (mut weight, mut squares) = (T::ZERO, T::ZERO);
    for associated in heard {
        for innovation in innovations_of(associated) {
            weight += innovation.weight;
            squares += innovation.second_m2 / (innovation.regression.variance_m2() + innovation.variance_m2);
        }
    }
    if weight > T::ZERO { squares / weight } else { T::ZERO }
}

/// Indices of the measurements that are probably a feature's, and come from a frame.
fn own_paths<T: Real>(scan: &Scan<T>, belief: &Belief<T>) -> Vec<usize> {
    (0..scan.measurements.len())
        .filter(|&m| belief.associated[m] > T::of(0.5) && scan.measurements[m].sinr > T::ZERO)
        .collect()
}
