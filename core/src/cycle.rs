//! The perception-action cycle: receive, estimate, acquire or associate, update, remember, discover, reward, learn,
//! plan, act.

use crate::anchor::{Anchor, MappedVirtualAnchor};
use crate::config::Config;
use crate::controller::Controller;
use crate::controller::library::{Action, Library};
use crate::controller::planning::{Outlook, Visible};
use crate::controller::reward::reward;
use crate::controller::value::ActionValues;
use crate::error::{Error, Setting};
use crate::information::entropy::{position_block, position_entropy_nat};
use crate::memory::channel::ChannelMemory;
use crate::memory::environment::{CONFIRMED, EnvironmentMemory, Record};
use crate::observation::{Frame, FrameRules, Observation, RangeScan, check_frame, check_scan};
use crate::observer::{Observer, Stage};
use crate::perceptor::acquisition::{Acquisition, Landmark, Sweep};
use crate::perceptor::association::{
    Belief, Beliefs, Clutter, Expectation, Measurement, Mode, associate, detection_probability,
};
use crate::perceptor::channel_estimator::ChannelEstimator;
use crate::perceptor::discovery::{Background, Claims, Discovered, Discovery, Viewpoint};
use crate::perceptor::loss::{LossMonitor, evidence_nat};
use crate::perceptor::manoeuvre::{ACCELERATION_FACTOR, Suspicion, is_manoeuvre};
use crate::perceptor::overlap::{Arrival, Overlap};
use crate::perceptor::state_filter::{Agent, Innovation, Regression, Sight, Source, StateFilter};
use crate::pulse::Pulse;
use crate::real::{SPEED_OF_LIGHT_M_S, abs, larger, limited, smaller};
use crate::report::CycleReport;
use crate::trace::TraceHash;
use heapless::Vec;
use nalgebra::{Matrix2, Matrix4, Vector4};

/// Detection probability of a path that is hidden at present, and of a virtual anchor that a floor plan tells of and that
/// was never seen: most are hidden from most places, and a few steps on another one comes out. No memory of misses
/// may make it less, or a path that comes back would go to a false neighbour.
const HIDDEN_DETECTION: f32 = 0.1;

/// Virtual anchors of one anchor that are nearer than this may be one, metres.
const NEAR_M: f32 = 0.3;

/// What an anchor delivered, as measurements, and the action its frame was received with.
struct Scan<const PATHS: usize> {
    anchor: usize,
    action: usize,
    measurements: Vec<Measurement, PATHS>,
    /// Whether a frame was received: only then does a missing path say something about the carrier.
    framed: bool,
    /// Threshold of the frame's pulse on the normalised energy of a path; 0 without a frame.
    threshold: f32,
    /// Ranges and paths that there was no room for.
    left_out: u32,
}

impl<const PATHS: usize> Scan<PATHS> {
    /// Takes a range in; where all places are taken, in the place of the one that tells least, if that is worse: the
    /// larger variance, then the longer, then the later. The others keep their order.
    fn take_range(&mut self, measurement: Measurement) {
        let Err(measurement) = self.measurements.push(measurement) else { return };
        self.left_out += 1;
        let is_worse = |a: &Measurement, b: &Measurement| {
            a.variance_m2 > b.variance_m2 || (a.variance_m2 == b.variance_m2 && a.range_m > b.range_m)
        };
        let mut worst: Option<(usize, Measurement)> = None;
        for (index, kept) in self.measurements.iter().enumerate() {
            if worst.is_none_or(|(_, worst)| !is_worse(&worst, kept)) {
                worst = Some((index, *kept));
            }
        }
        let Some((index, worst)) = worst else { return };
        if is_worse(&worst, &measurement) {
            // The later ones move up from behind.
            let mut next = measurement;
            for place in self.measurements.iter_mut().skip(index).rev() {
                next = core::mem::replace(place, next);
            }
        }
    }
}

/// What is expected of the features of one anchor: their regressions, and what association makes of them.
struct Expected<const VAS: usize> {
    direct: Regression,
    direct_path: Expectation,
    virtual_anchors: Vec<Regression, VAS>,
    expectations: Vec<Expectation, VAS>,
}

impl<const VAS: usize> Expected<VAS> {
    /// See [`evidence_nat`].
    fn evidence_nat<const PATHS: usize>(&self, scan: &Scan<PATHS>, clutter: &Clutter) -> f32 {
        evidence_nat(&scan.measurements, &self.direct_path, self.expectations.iter(), clutter)
    }
}

/// A scan with what it was compared to, and the outcome.
struct AssociatedScan<'a, const VAS: usize, const PATHS: usize> {
    scan: &'a Scan<PATHS>,
    direct: Regression,
    virtual_anchors: Vec<Regression, VAS>,
    claims: Claims<PATHS>,
    beliefs: Beliefs<VAS, PATHS>,
    /// Evidence that the tag is where it is believed to be, nats.
    evidence_nat: f32,
}

impl<const VAS: usize, const PATHS: usize> AssociatedScan<'_, VAS, PATHS> {
    /// Every feature with the beliefs about it, the direct path first.
    fn features(&self) -> impl Iterator<Item = (&Regression, &Belief<PATHS>)> + Clone {
        core::iter::once(&self.direct).chain(&self.virtual_anchors).zip(self.beliefs.features())
    }
}

/// The tracker: all state of the cognitive system, in fixed memory.
#[derive(Clone, Debug)]
pub struct Tracker<const ANCHORS: usize, const VAS: usize, const PATHS: usize, const ACTIONS: usize> {
    config: Config,
    anchors: Vec<Anchor, ANCHORS>,
    /// Estimator for the pulse it was last used with; rebuilt when the pulse changes, so no state.
    estimator: ChannelEstimator<PATHS>,
    estimator_pulse: Pulse,

    cycle: u32,
    filter: StateFilter<ANCHORS, VAS>,
    environment: EnvironmentMemory<VAS>,
    channel: ChannelMemory<ANCHORS, VAS, ACTIONS>,
    discovery: Discovery<ANCHORS>,
    /// While it is not known where the tag is.
    acquisition: Option<Acquisition<ANCHORS>>,
    loss: LossMonitor,
    controller: Controller<ACTIONS>,
    /// Mean number of measurements per scan that belong to nothing known.
    unexplained: [f32; ANCHORS],
    last_sequence: [Option<u32>; ANCHORS],
}

impl<const ANCHORS: usize, const VAS: usize, const PATHS: usize, const ACTIONS: usize>
    Tracker<ANCHORS, VAS, PATHS, ACTIONS>
{
    /// A tracker at the start configured. `anchors`: 1 to `ANCHORS`; `map`: virtual anchors known a priori, at most
    /// `VAS`; `actions`: 1 to `ACTIONS`; `seed`: of all randomness.
    ///
    /// # Errors
    /// The first value out of range.
    pub fn new(
        config: Config,
        anchors: &[Anchor],
        map: &[MappedVirtualAnchor],
        actions: &[Action],
        seed: u64,
    ) -> Result<Self, Error> {
        config.validate()?;
        let library = Library::new(actions)?;
        let Some(first) = library.get(config.controller.first_action) else {
            return Err(Error::Configuration(Setting::FirstAction));
        };
        if anchors.is_empty() {
            return Err(Error::AnchorCount { given: 0, limit: ANCHORS });
        }
        let mut checked: Vec<Anchor, ANCHORS> = Vec::new();
        for (index, anchor) in anchors.iter().enumerate() {
            anchor.check(index)?;
            checked.push(*anchor).map_err(|_| Error::AnchorCount { given: anchors.len(), limit: ANCHORS })?;
        }
        if map.len() > VAS {
            return Err(Error::VirtualAnchorCount { given: map.len(), limit: VAS });
        }
        let Config { start, ranging, .. } = config;
        let mut filter = StateFilter::new(
            config.motion,
            start.position_m,
            start.position_std_m,
            start.velocity_std_m_s,
            ranging.bias_mean_m,
            ranging.bias_std_m,
        );
        let start = filter.agent();
        let mut environment = EnvironmentMemory::default();
        for (slot, mapped) in map.iter().enumerate() {
            mapped.check(slot, anchors.len())?;
            let std_m = if config.exact_map { 0.0 } else { mapped.std_m };
            filter.insert_independent(slot, mapped.position_m, std_m);
            environment.insert(slot, mapped.anchor, 0.9, 0);
        }
        let pulse = Pulse { duration_s: first.pulse_duration_s, shape: config.radio.pulse_shape };
        let association = &config.association;
        let unexplained = association.clutter_per_anchor + association.unmapped_per_anchor;
        Ok(Self {
            config,
            anchors: checked,
            estimator: build_estimator(&config, pulse),
            estimator_pulse: pulse,
            cycle: 0,
            filter,
            environment,
            channel: ChannelMemory::new(config.controller.prior_sinr),
            discovery: Discovery::default(),
            acquisition: Some(Acquisition::new(start)),
            loss: LossMonitor::default(),
            controller: Controller::new(config.controller, library, seed),
            unexplained: [unexplained; ANCHORS],
            last_sequence: [None; ANCHORS],
        })
    }

    /// One cycle: what was received in the last `elapsed_s` seconds (one frame or scan per anchor at most, none for
    /// anchors not heard), and the tag's height where it is known. Returns what was made of it and the next action.
    ///
    /// # Errors
    /// The first bad input; nothing has changed then.
    pub fn cycle(
        &mut self,
        observations: &[Observation<'_>],
        elapsed_s: f32,
        tag_height_m: Option<f32>,
    ) -> Result<CycleReport, Error> {
        self.cycle_observed(observations, elapsed_s, tag_height_m, &mut ())
    }

    /// [`Self::cycle`] under the eyes of an observer.
    ///
    /// # Errors
    /// The first bad input; nothing has changed then.
    pub fn cycle_observed(
        &mut self,
        observations: &[Observation<'_>],
        elapsed_s: f32,
        tag_height_m: Option<f32>,
        observer: &mut impl Observer<VAS, PATHS>,
    ) -> Result<CycleReport, Error> {
        observer.stage(Stage::Receive);
        self.check(observations, elapsed_s, tag_height_m)?;

        observer.stage(Stage::Estimate);
        let scans = self.estimate(observations, observer);

        observer.stage(Stage::Predict);
        let last = self.filter.agent();
        let previous = last.covariance;
        self.filter.predict(elapsed_s);
        let before = self.filter.agent();
        let predicted = before.covariance;
        self.discovery.predict(&last, &before, elapsed_s);
        if self.acquisition.is_none()
            && LossMonitor::is_too_wide(before.covariance.m11, before.covariance.m22)
        {
            self.lose(last);
        }

        observer.stage(Stage::Associate);
        self.acquire(&scans, elapsed_s, tag_height_m);
        if self.acquisition.is_none() {
            self.follow_manoeuvre(&scans, elapsed_s, tag_height_m);
        }
        let heard = self.associate(&scans, tag_height_m, observer);

        let mut report = self.blank_report();
        if self.acquisition.is_none() {
            report.lost = self.watch(&heard);
        }
        report.acquiring = self.acquisition.is_some();
        report.left_out = scans.iter().fold(0, |sum, scan| sum + scan.left_out);
        if !report.acquiring {
            observer.stage(Stage::Update);
            let before = self.filter.agent();
            self.update(&heard);
            let after = self.filter.agent();
            self.discovery.follow(&before, &after);

            observer.stage(Stage::Remember);
            self.remember(&heard, &mut report);
            report.nis = Self::normalised_innovation(&heard);

            observer.stage(Stage::Discover);
            if !self.loss.is_doubtful() {
                self.discover(&heard, tag_height_m, &mut report);
            }
        }
        let posterior = self.filter.agent_covariance();

        observer.stage(Stage::Act);
        // The reward belongs to the action received with, which need not be the one that was asked for.
        let framed = heard.iter().find(|associated| associated.scan.framed);
        let applied = framed.map_or(self.controller.action_index(), |associated| associated.scan.action);
        report.action = applied;
        self.act(&previous, &predicted, &posterior, elapsed_s, tag_height_m, &mut report);

        self.finish(observations);
        observer.stage(Stage::Done);
        Ok(report)
    }

    /// Counts the cycle and the frames seen.
    fn finish(&mut self, observations: &[Observation<'_>]) {
        for observation in observations {
            if let Observation::Frame(Frame { anchor, sequence: Some(sequence), .. }) = *observation
                && let Some(last) = self.last_sequence.get_mut(anchor)
            {
                *last = Some(sequence);
            }
        }
        self.cycle = self.cycle.wrapping_add(1);
    }

    /// Refuses bad input before anything is touched.
    fn check(
        &self,
        observations: &[Observation<'_>],
        elapsed_s: f32,
        tag_height_m: Option<f32>,
    ) -> Result<(), Error> {
        if !(elapsed_s > 0.0 && elapsed_s <= 3600.0) {
            return Err(Error::Time { elapsed_s });
        }
        if let Some(height) = tag_height_m
            && !(abs(height) <= 1000.0)
        {
            return Err(Error::TagHeight);
        }
        let rules = FrameRules {
            samples: self.config.radio.samples_per_frame,
            full_scale: self.config.radio.full_scale,
            max_range_m: self.config.ranging.max_range_m,
        };
        let mut framed = [false; ANCHORS];
        let mut ranged = [false; ANCHORS];
        for observation in observations {
            let anchor = observation.anchor();
            if anchor >= self.anchors.len() {
                return Err(Error::UnknownAnchor { anchor });
            }
            let seen = match observation {
                Observation::Frame(_) => framed.get_mut(anchor),
                Observation::Ranges(_) => ranged.get_mut(anchor),
            };
            let Some(seen) = seen else { return Err(Error::UnknownAnchor { anchor }) };
            if core::mem::replace(seen, true) {
                return Err(Error::DuplicateFrame { anchor });
            }
            match observation {
                Observation::Frame(frame) => {
                    if self.controller.library().get(frame.action).is_none() {
                        return Err(Error::UnknownAction { action: frame.action });
                    }
                    if let (Some(sequence), Some(Some(last))) =
                        (frame.sequence, self.last_sequence.get(anchor))
                        && sequence == *last
                    {
                        return Err(Error::DuplicateFrame { anchor });
                    }
                    check_frame(frame, &rules)?;
                }
                Observation::Ranges(scan) => check_scan(scan, rules.max_range_m)?,
            }
        }
        Ok(())
    }

    /// Frames become paths, and paths and ranges become one scan of measurements per anchor heard.
    fn estimate(
        &mut self,
        observations: &[Observation<'_>],
        observer: &mut impl Observer<VAS, PATHS>,
    ) -> Vec<Scan<PATHS>, ANCHORS> {
        let mut scans: Vec<Scan<PATHS>, ANCHORS> = Vec::new();
        for anchor in 0..self.anchors.len() {
            let mut scan = Scan {
                anchor,
                action: self.controller.action_index(),
                measurements: Vec::new(),
                framed: false,
                threshold: 0.0,
                left_out: 0,
            };
            let mut heard = false;
            // Ranges first: they outrank the paths near them.
            for observation in observations {
                match observation {
                    Observation::Ranges(ranges) if ranges.anchor == anchor => {
                        self.take_ranges(ranges, &mut scan);
                        heard = true;
                    }
                    _ => {}
                }
            }
            for observation in observations {
                match observation {
                    Observation::Frame(frame) if frame.anchor == anchor => {
                        self.take_frame(frame, &mut scan, observer);
                        heard = true;
                    }
                    _ => {}
                }
            }
            if heard {
                // One per anchor: the push succeeds.
                let _ = scans.push(scan);
            }
        }
        scans
    }

    fn take_ranges(&self, scan: &RangeScan<'_>, into: &mut Scan<PATHS>) {
        for range in scan.ranges {
            let variance_m2 = self.measurement_variance(range.variance_m2);
            into.take_range(Measurement { range_m: range.range_m, variance_m2, sinr: 0.0, energy: 0.0 });
        }
    }

    // Stages are kept apart so that each reuses the stack of the one before.
    #[inline(never)]
    fn take_frame(
        &mut self,
        frame: &Frame<'_>,
        into: &mut Scan<PATHS>,
        observer: &mut impl Observer<VAS, PATHS>,
    ) {
        let Some(action) = self.controller.library().get(frame.action) else { return };
        let pulse = Pulse { duration_s: action.pulse_duration_s, shape: self.config.radio.pulse_shape };
        if pulse != self.estimator_pulse {
            self.estimator = build_estimator(&self.config, pulse);
            self.estimator_pulse = pulse;
        }
        let estimate = self.estimator.estimate_checked(frame.samples, frame.first_sample_delay_s);
        observer.estimate(frame.anchor, &estimate);
        into.action = frame.action;
        into.framed = true;
        into.threshold = self.estimator.threshold();
        let ranges = into.measurements.len();
        let resolution_m = pulse.duration_s * SPEED_OF_LIGHT_M_S;
        for path in &estimate.paths {
            let range_m = path.range_m();
            let near_range =
                into.measurements.iter().take(ranges).any(|m| abs(m.range_m - range_m) < resolution_m);
            if near_range || range_m <= 0.0 || range_m > self.config.ranging.max_range_m {
                continue;
            }
            let variance_m2 = self.measurement_variance(pulse.range_variance_m2(path.sinr));
            let [re, im] = path.amplitude;
            let measurement =
                Measurement { range_m, variance_m2, sinr: path.sinr, energy: re * re + im * im };
            // Where ranges took up room, the latest paths are left out.
            into.left_out += u32::from(into.measurements.push(measurement).is_err());
        }
    }

    /// The variance the filter works with: inflated, and never below the floor.
    fn measurement_variance(&self, variance_m2: f32) -> f32 {
        let ranging = &self.config.ranging;
        ranging.variance_inflation * variance_m2 + ranging.floor_m * ranging.floor_m
    }

    /// Where an anchor is seen from the tag.
    fn sight(&self, anchor: usize, tag_height_m: Option<f32>) -> Option<Sight> {
        let anchor = self.anchors.get(anchor)?;
        let height_m = tag_height_m.map_or(0.0, |height| anchor.height_m - height);
        Some(Sight { anchor_m: anchor.position_m, height_m })
    }

    /// Gives the tag up: from now on it may be anywhere around `prior`.
    fn lose(&mut self, prior: Agent) {
        self.loss = LossMonitor::default();
        self.acquisition = Some(Acquisition::new(prior));
    }

    /// Notices when the tag is not where it is believed to be.
    fn watch(&mut self, heard: &Vec<AssociatedScan<'_, VAS, PATHS>, ANCHORS>) -> bool {
        self.loss.observe(heard.iter().fold(0.0, |sum, associated| sum + associated.evidence_nat));
        if !self.loss.is_lost() {
            return false;
        }
        let agent = self.filter.agent();
        let reach = self.config.motion.position_std_limit_m;
        let speed = self.config.start.velocity_std_m_s;
        let (position, velocity) = (reach * reach, speed * speed);
        self.lose(Agent {
            mean: Vector4::new(agent.mean.x, agent.mean.y, 0.0, 0.0),
            covariance: Matrix4::from_diagonal(&Vector4::new(position, position, velocity, velocity)),
        });
        if let Some(acquisition) = &mut self.acquisition {
            acquisition.suggest(agent);
        }
        true
    }

    /// While it is not known where the tag is: weighs the places it may be at, and puts it where it must be.
    #[inline(never)]
    fn acquire(&mut self, scans: &Vec<Scan<PATHS>, ANCHORS>, elapsed_s: f32, tag_height_m: Option<f32>) {
        let mut detections: Vec<(f32, [f32; VAS]), ANCHORS> = Vec::new();
        for scan in scans {
            let direct = self.detection(Source::Direct { anchor: scan.anchor }, scan);
            // As many as scans: the push succeeds.
            let _ = detections.push((direct, self.detections(scan)));
        }
        let Self { acquisition, discovery, filter, environment, anchors, unexplained, config, .. } = self;
        let Some(acquiring) = acquisition else { return };
        // Candidates are located relative to a tag that is about to jump.
        discovery.clear();
        acquiring.predict(&config.motion, elapsed_s);
        let per_m = 1.0 / config.ranging.max_range_m;
        let settings = &config.association;
        let known = &*filter;
        let mut backgrounds: Vec<[f32; PATHS], ANCHORS> = Vec::new();
        for scan in scans {
            let all_per_m = unexplained.get(scan.anchor).copied().unwrap_or(1.0) * per_m;
            let false_share = settings.clutter_per_anchor * per_m / all_per_m;
            let unmapped = (1.0 - false_share) * settings.detection_probability;
            // As many as scans: the push succeeds.
            let _ = backgrounds.push(acquiring.backgrounds(
                scan.anchor,
                &scan.measurements,
                all_per_m,
                unmapped,
                elapsed_s,
            ));
        }
        let sweeps = scans.iter().zip(&backgrounds).map(|(scan, all_per_m)| {
            let (bias_m, bias_variance_m2) = known.bias_m(scan.anchor).unwrap_or((0.0, 0.0));
            let sweep = Sweep {
                measurements: &scan.measurements,
                bias_m,
                bias_variance_m2,
                all_per_m,
                false_alarms_per_m: settings.clutter_per_anchor * per_m,
                anywhere_per_m: per_m,
            };
            (scan.anchor, sweep)
        });
        let landmarks = |anchor: usize| {
            let own = anchors.get(anchor);
            let scan = scans.iter().position(|scan| scan.anchor == anchor).unwrap_or(0);
            let detection = detections.get(scan);
            let height_m = tag_height_m.zip(own).map_or(0.0, |(height, own)| own.height_m - height);
            let direct = own.map(|own| Landmark {
                position_m: own.position_m,
                covariance_m2: [0.0; 3],
                height_m,
                detection: detection.map_or(0.0, |(direct, _)| *direct),
            });
            let reflected = environment.iter().filter(move |(_, record)| record.anchor == anchor);
            direct.into_iter().chain(reflected.filter_map(move |(slot, record)| {
                let (a, c) = known.virtual_anchor(slot)?;
                Some(Landmark {
                    position_m: [a.x, a.y],
                    covariance_m2: [c.m11, c.m21, c.m22],
                    height_m,
                    detection: record.existence * detection?.1.get(slot)?,
                })
            }))
        };
        if !acquiring.observe(sweeps, landmarks) {
            return;
        }
        match acquiring.settled() {
            Some(agent) => {
                filter.place(&agent);
                *acquisition = None;
            }
            None => filter.place(&acquiring.summary()),
        }
    }

    /// Widens the prediction where a manoeuvre explains the scans far better than the motion as configured does.
    #[inline(never)]
    fn follow_manoeuvre(
        &mut self,
        scans: &Vec<Scan<PATHS>, ANCHORS>,
        elapsed_s: f32,
        tag_height_m: Option<f32>,
    ) {
        let mut suspicion = Suspicion::default();
        for scan in scans {
            let source = Source::Direct { anchor: scan.anchor };
            let Some(sight) = self.sight(scan.anchor, tag_height_m) else { continue };
            let Some(regression) = self.filter.regress(source, &sight) else { continue };
            let mut nearest = f32::INFINITY;
            for measurement in &scan.measurements {
                let innovation = measurement.range_m - regression.range_m;
                let variance = regression.variance_m2() + measurement.variance_m2;
                nearest = smaller(nearest, innovation * innovation / variance);
            }
            suspicion.enter(self.detection(source, scan), nearest);
        }
        if !suspicion.is_raised() {
            return;
        }
        let motion = self.evidence_nat(scans, tag_height_m);
        let predicted = self.filter.agent_covariance();
        let acceleration_std_m_s2 = ACCELERATION_FACTOR * self.config.motion.acceleration_std_m_s2;
        self.filter.disturb(acceleration_std_m_s2, elapsed_s);
        let manoeuvre = self.evidence_nat(scans, tag_height_m);
        if !is_manoeuvre(motion, manoeuvre) {
            self.filter.undisturb(&predicted);
        }
    }

    /// Evidence of all scans that the tag is where it is predicted to be, nats.
    fn evidence_nat(&self, scans: &Vec<Scan<PATHS>, ANCHORS>, tag_height_m: Option<f32>) -> f32 {
        let mut evidence = 0.0;
        for scan in scans {
            if let Some(expected) = self.expect(scan, tag_height_m) {
                evidence += expected.evidence_nat(scan, &self.clutter(scan.anchor));
            }
        }
        evidence
    }

    /// Compares every scan with its anchor's features at the predicted state.
    fn associate<'a>(
        &self,
        scans: &'a Vec<Scan<PATHS>, ANCHORS>,
        tag_height_m: Option<f32>,
        observer: &mut impl Observer<VAS, PATHS>,
    ) -> Vec<AssociatedScan<'a, VAS, PATHS>, ANCHORS> {
        let mut heard: Vec<AssociatedScan<'a, VAS, PATHS>, ANCHORS> = Vec::new();
        for scan in scans {
            let anchor = scan.anchor;
            if let Some(associated) = self.associate_scan(scan, tag_height_m) {
                observer.expectations(anchor, &associated.direct, &associated.virtual_anchors);
                observer.beliefs(anchor, &associated.scan.measurements, &associated.beliefs);
                // As many as scans: the push succeeds.
                let _ = heard.push(associated);
            }
        }
        heard
    }

    #[inline(never)]
    fn associate_scan<'a>(
        &self,
        scan: &'a Scan<PATHS>,
        tag_height_m: Option<f32>,
    ) -> Option<AssociatedScan<'a, VAS, PATHS>> {
        let anchor = scan.anchor;
        let expected = self.expect(scan, tag_height_m)?;
        let clutter = self.clutter(anchor);
        let evidence_nat = expected.evidence_nat(scan, &clutter);
        let Expected { direct, virtual_anchors, direct_path, expectations } = expected;
        let viewpoint = self.viewpoint(anchor, tag_height_m)?;
        let claims = self.discovery.claim(anchor, &viewpoint, &scan.measurements, &self.background(anchor));
        let mut beliefs =
            associate(&direct_path, &expectations, &scan.measurements, &claims.totals(), &clutter);
        if self.config.association.mode == Mode::Map {
            beliefs.harden();
        }
        Some(AssociatedScan { scan, direct, virtual_anchors, claims, beliefs, evidence_nat })
    }

    /// What is expected of an anchor's features before a scan.
    #[inline(never)]
    fn expect(&self, scan: &Scan<PATHS>, tag_height_m: Option<f32>) -> Option<Expected<VAS>> {
        let anchor = scan.anchor;
        let sight = self.sight(anchor, tag_height_m)?;
        let expectation = |regression: &Regression, existence: f32, detection: f32| Expectation {
            range_m: regression.range_m,
            variance_m2: regression.variance_m2(),
            existence,
            detection,
        };
        let direct = self.filter.regress(Source::Direct { anchor }, &sight)?;
        let direct_path = expectation(&direct, 1.0, self.detection(direct.source, scan));
        let mut expected =
            Expected { direct, direct_path, virtual_anchors: Vec::new(), expectations: Vec::new() };
        for (slot, record) in self.environment.iter() {
            if record.anchor == anchor {
                let regression = self.filter.regress(Source::Virtual { anchor, slot }, &sight)?;
                let detection = self.detection(regression.source, scan);
                let survival = self.config.association.survival_probability;
                let existence = self.environment.expected_existence(slot, survival, detection);
                // One per slot at most: the pushes succeed.
                let _ = expected.virtual_anchors.push(regression);
                let _ = expected.expectations.push(expectation(&regression, existence, detection));
            }
        }
        self.overlap(scan, &mut expected);
        Some(expected)
    }

    /// Intensities of what an anchor delivers that belongs to nothing known.
    fn clutter(&self, anchor: usize) -> Clutter {
        let background = self.background(anchor);
        Clutter { false_alarms_per_m: background.false_alarms_per_m, all_per_m: background.all_per_m }
    }

    /// Takes into account that paths of a frame disturb each other: their ranges are worth less, and two may be found
    /// as one.
    #[inline(never)]
    fn overlap(&self, scan: &Scan<PATHS>, expected: &mut Expected<VAS>) {
        let Expected { direct, direct_path, virtual_anchors, expectations } = expected;
        let Some(action) = self.controller.library().get(scan.action) else { return };
        if !scan.framed {
            return;
        }
        let pulse = Pulse { duration_s: action.pulse_duration_s, shape: self.config.radio.pulse_shape };
        let arrival = |regression: &Regression, expectation: &Expectation| Arrival {
            range_m: expectation.range_m,
            presence: expectation.existence * expectation.detection,
            sinr: self.channel.sinr(regression.source, scan.action),
        };
        let first = arrival(direct, direct_path);
        let mut others: Vec<Arrival, VAS> = Vec::new();
        for (regression, expectation) in virtual_anchors.iter().zip(expectations.iter()) {
            // Capacities are equal: every push succeeds.
            let _ = others.push(arrival(regression, expectation));
        }
        let apply = |overlap: &Overlap, regression: &mut Regression, expectation: &mut Expectation| {
            regression.residual_m2 += overlap.variance_m2;
            expectation.variance_m2 = regression.variance_m2();
            expectation.detection = overlap.resolved(expectation.detection);
        };
        let mut overlap = Overlap::default();
        for other in &others {
            overlap.add(&pulse, &first, other);
        }
        apply(&overlap, direct, direct_path);
        let features = virtual_anchors.iter_mut().zip(expectations);
        for ((k, own), (regression, expectation)) in others.iter().enumerate().zip(features) {
            let mut overlap = Overlap::default();
            overlap.add(&pulse, own, &first);
            for (l, other) in others.iter().enumerate() {
                if l != k {
                    overlap.add(&pulse, own, other);
                }
            }
            apply(&overlap, regression, expectation);
        }
    }

    /// Probability that the path of an existing source is found in a scan: of frames by its SINR as remembered.
    fn detection(&self, source: Source, scan: &Scan<PATHS>) -> f32 {
        let told = self.config.association.detection_probability;
        if !scan.framed {
            return told;
        }
        if self.channel.has_seen(source) {
            let sinr = self.channel.sinr(source, scan.action);
            return limited(detection_probability(sinr, scan.threshold), HIDDEN_DETECTION, told);
        }
        match source {
            Source::Virtual { slot, .. }
                if self.environment.get(slot).is_some_and(|record| record.hits == 0) =>
            {
                HIDDEN_DETECTION
            }
            _ => told,
        }
    }

    /// The same for every slot of the map; 0 for free ones.
    fn detections(&self, scan: &Scan<PATHS>) -> [f32; VAS] {
        let mut detections = [0.0; VAS];
        for (slot, record) in self.environment.iter() {
            if let Some(detection) = detections.get_mut(slot) {
                *detection = self.detection(Source::Virtual { anchor: record.anchor, slot }, scan);
            }
        }
        detections
    }

    /// Moves the state by everything associated: direct paths first, then virtual anchors, by anchor.
    fn update(&mut self, heard: &Vec<AssociatedScan<'_, VAS, PATHS>, ANCHORS>) {
        let innovations = heard.iter().flat_map(|associated| {
            let scan = &associated.scan;
            associated
                .features()
                .filter_map(move |(regression, belief)| innovation(regression, &scan.measurements, belief))
        });
        self.filter.update(innovations);
    }

    /// Mean normalised innovation squared of what was associated: 1 where the filter knows how wrong it is, 0 without
    /// measurements.
    fn normalised_innovation(heard: &Vec<AssociatedScan<'_, VAS, PATHS>, ANCHORS>) -> f32 {
        let (mut weight, mut squares) = (0.0, 0.0);
        for associated in heard {
            for (regression, belief) in associated.features() {
                if let Some(innovation) = innovation(regression, &associated.scan.measurements, belief) {
                    weight += innovation.weight;
                    squares += innovation.second_m2 / (regression.variance_m2() + innovation.variance_m2);
                }
            }
        }
        if weight > 0.0 { squares / weight } else { 0.0 }
    }

    /// Existence of virtual anchors, SINR of every source whose path was probably seen, and how much of each scan
    /// nothing explained.
    #[inline(never)]
    fn remember(&mut self, heard: &Vec<AssociatedScan<'_, VAS, PATHS>, ANCHORS>, report: &mut CycleReport) {
        self.channel.age();
        for associated in heard {
            let scan = &associated.scan;
            for (regression, belief) in associated.features() {
                if self.loss.is_doubtful() {
                    // What is missing from here may be where it was: the tag is not.
                    break;
                }
                if let Source::Virtual { slot, .. } = regression.source {
                    let detection = self.detection(regression.source, scan);
                    self.environment.remember(slot, belief.existence, belief.missed < 0.5, detection);
                }
                self.remember_channel(regression.source, scan, belief);
            }
            let mut expected = 0.0;
            report.anchors_heard += 1;
            for (_, &free) in scan.measurements.iter().zip(&associated.beliefs.unassociated) {
                expected += free;
                report.measurements += 1;
                report.associated += u32::from(free <= 0.5);
            }
            if let Some(unexplained) = self.unexplained.get_mut(scan.anchor) {
                let clutter = self.config.association.clutter_per_anchor;
                *unexplained = larger(0.95 * *unexplained + 0.05 * expected, clutter);
            }
        }
    }

    /// SINR of a source from what one scan showed of it.
    fn remember_channel(&mut self, source: Source, scan: &Scan<PATHS>, belief: &Belief<PATHS>) {
        for (measurement, &weight) in scan.measurements.iter().zip(&belief.associated) {
            if weight > 0.5 && measurement.sinr > 0.0 {
                self.channel.remember(source, scan.action, self.controller.library(), measurement, weight);
            }
        }
        let exists = match source {
            Source::Direct { .. } => true,
            Source::Virtual { slot, .. } => {
                self.environment.get(slot).is_some_and(|record| record.existence > CONFIRMED)
            }
        };
        if scan.framed && exists && belief.missed > 0.5 {
            self.channel.remember_missed(source, scan.action, self.controller.library(), belief.missed);
        }
    }

    /// The life of virtual anchors: forgets improbable ones, offers what nothing explained to the candidates, and
    /// takes resolved candidates into the map.
    #[inline(never)]
    fn discover(
        &mut self,
        heard: &Vec<AssociatedScan<'_, VAS, PATHS>, ANCHORS>,
        tag_height_m: Option<f32>,
        report: &mut CycleReport,
    ) {
        for _ in 0..VAS {
            let Some(slot) = self.environment.forget_one() else { break };
            self.take_out(slot, report);
        }
        self.merge(report);
        if !self.config.discovery {
            return;
        }
        for associated in heard {
            let anchor = associated.scan.anchor;
            let Some(sight) = self.sight(anchor, tag_height_m) else { continue };
            let Some(viewpoint) = self.viewpoint(anchor, tag_height_m) else { continue };
            let background = self.background(anchor);
            let AssociatedScan { scan, claims, beliefs, .. } = associated;
            let free = &beliefs.unassociated;
            let known_m = associated.features().map(|(regression, _)| regression.range_m);
            let resolution_m = self.resolution_m(scan);
            self.discovery.observe(
                anchor,
                &viewpoint,
                &scan.measurements,
                claims,
                free,
                &background,
                known_m,
                resolution_m,
            );
            while let Some(found) = self.discovery.take_resolved(anchor) {
                self.take_in(scan, &sight, &found, report);
            }
        }
    }

    /// How far apart two paths of a scan must be to be told apart, metres; 0 where the scan has ranges alone.
    fn resolution_m(&self, scan: &Scan<PATHS>) -> f32 {
        match self.controller.library().get(scan.action) {
            Some(action) if scan.framed => action.pulse_duration_s * SPEED_OF_LIGHT_M_S,
            _ => 0.0,
        }
    }

    /// From where an anchor's candidates are seen.
    fn viewpoint(&self, anchor: usize, tag_height_m: Option<f32>) -> Option<Viewpoint> {
        let sight = self.sight(anchor, tag_height_m)?;
        let (bias_m, _) = self.filter.bias_m(anchor)?;
        let direct = self.filter.regress(Source::Direct { anchor }, &sight)?;
        Some(Viewpoint {
            agent: self.filter.agent(),
            height_m: sight.height_m,
            bias_m,
            direct_m: direct.range_m,
            direct_variance_m2: direct.variance_m2(),
        })
    }

    /// What the candidates of an anchor compete with.
    fn background(&self, anchor: usize) -> Background {
        let per_m = 1.0 / self.config.ranging.max_range_m;
        let settings = &self.config.association;
        Background {
            all_per_m: self.unexplained.get(anchor).copied().unwrap_or(0.0) * per_m,
            false_alarms_per_m: settings.clutter_per_anchor * per_m,
            detection_probability: settings.detection_probability,
        }
    }

    /// Forgets the younger of two virtual anchors of an anchor that are one.
    fn merge(&mut self, report: &mut CycleReport) {
        for slot in 0..VAS {
            let Some(record) = self.environment.get(slot).copied() else { continue };
            let Some((a, c)) = self.filter.virtual_anchor(slot) else { continue };
            let is_same = |(other, twin): (usize, &Record)| {
                let (b, d) = self.filter.virtual_anchor(other)?;
                let (dx, dy) = (b.x - a.x, b.y - a.y);
                let (xx, yx, yy) = (c.m11 + d.m11, c.m21 + d.m21, c.m22 + d.m22);
                let form = yy * (dx * dx) - 2.0 * (yx * (dx * dy)) + xx * (dy * dy);
                let near = dx * dx + dy * dy < NEAR_M * NEAR_M && form < xx * yy - yx * yx;
                let older = twin.hits > record.hits || (twin.hits == record.hits && other < slot);
                (twin.anchor == record.anchor && other != slot && near && older).then_some(())
            };
            let doubled = record.hits > 0 && self.environment.iter().any(|entry| is_same(entry).is_some());
            if doubled {
                self.environment.remove(slot);
                self.take_out(slot, report);
            }
        }
    }

    /// Forgets a virtual anchor outside the environment memory.
    fn take_out(&mut self, slot: usize, report: &mut CycleReport) {
        self.filter.remove(slot);
        self.channel.forget(slot);
        report.forgotten += 1;
    }

    /// Enters a discovery into the map, in the place of the virtual anchor that tells least if there is no other.
    fn take_in(&mut self, scan: &Scan<PATHS>, sight: &Sight, found: &Discovered, report: &mut CycleReport) {
        let anchor = scan.anchor;
        if self.is_known(anchor, sight, found) {
            return;
        }
        let mut slot = self.environment.free_slot();
        if slot.is_none() {
            let detections = self.detections(scan);
            slot = self.environment.give_way(&detections);
            if let Some(slot) = slot {
                self.take_out(slot, report);
            }
        }
        let Some(slot) = slot else {
            report.map_full += 1;
            return;
        };
        self.filter.insert_relative(slot, found.position, &found.gain, &found.covariance);
        self.environment.insert(slot, anchor, 0.9, 1);
        report.discovered += 1;
    }

    /// Whether a discovery lies within 0.3 m of the anchor or of one of its virtual anchors.
    fn is_known(&self, anchor: usize, sight: &Sight, found: &Discovered) -> bool {
        let near = |x: f32, y: f32| {
            let (dx, dy) = (found.position.x - x, found.position.y - y);
            dx * dx + dy * dy < NEAR_M * NEAR_M
        };
        let [x, y] = sight.anchor_m;
        near(x, y)
            || self.environment.iter().any(|(slot, record)| {
                record.anchor == anchor
                    && self.filter.virtual_anchor(slot).is_some_and(|(a, _)| near(a.x, a.y))
            })
    }

    /// Reward, learning, planning and the next action.
    #[inline(never)]
    fn act(
        &mut self,
        previous: &Matrix4<f32>,
        predicted: &Matrix4<f32>,
        posterior: &Matrix4<f32>,
        elapsed_s: f32,
        tag_height_m: Option<f32>,
        report: &mut CycleReport,
    ) {
        let earned = reward(self.config.controller.reward, previous, predicted, posterior);
        let outlook = Outlook {
            position_m: self.filter.position_m(),
            velocity_m_s: self.filter.velocity_m_s(),
            covariance: *posterior,
            elapsed_s,
            acceleration_std_m_s2: self.config.motion.acceleration_std_m_s2,
            variance_inflation: self.config.ranging.variance_inflation,
            range_floor_m: self.config.ranging.floor_m,
            pulse_shape: self.config.radio.pulse_shape,
        };
        let visible = visible(&self.anchors, &self.environment, &self.filter, tag_height_m);
        report.next_action = self.controller.decide(report.action, earned, &outlook, visible, &self.channel);
        report.position_m = self.filter.position_m();
        report.position_covariance_m2 = position_block(posterior);
        report.predicted_entropy_nat = position_entropy_nat(&position_block(predicted));
        report.entropy_nat = position_entropy_nat(&position_block(posterior));
        report.reward = earned;
        if let Some(next) = self.controller.action() {
            report.next = *next;
        }
    }

    fn blank_report(&self) -> CycleReport {
        let next = self.controller.action().copied();
        CycleReport {
            cycle: self.cycle,
            position_m: [0.0, 0.0],
            position_covariance_m2: Matrix2::new(0.0, 0.0, 0.0, 0.0),
            predicted_entropy_nat: 0.0,
            entropy_nat: 0.0,
            reward: 0.0,
            anchors_heard: 0,
            measurements: 0,
            left_out: 0,
            associated: 0,
            acquiring: false,
            lost: false,
            nis: 0.0,
            discovered: 0,
            forgotten: 0,
            map_full: 0,
            action: self.controller.action_index(),
            next_action: self.controller.action_index(),
            next: next.unwrap_or(Action { carrier_hz: 0.0, pulse_duration_s: 0.0 }),
        }
    }

    /// The state filter.
    pub fn filter(&self) -> &StateFilter<ANCHORS, VAS> {
        &self.filter
    }

    /// The environment memory.
    pub fn environment(&self) -> &EnvironmentMemory<VAS> {
        &self.environment
    }

    /// The channel memory.
    pub fn channel(&self) -> &ChannelMemory<ANCHORS, VAS, ACTIONS> {
        &self.channel
    }

    /// The candidates for virtual anchors.
    pub fn discovery(&self) -> &Discovery<ANCHORS> {
        &self.discovery
    }

    /// The places the tag may be at, while it is not known.
    pub fn acquisition(&self) -> Option<&Acquisition<ANCHORS>> {
        self.acquisition.as_ref()
    }

    /// Action values and policy.
    pub fn controller(&self) -> (&ActionValues<ACTIONS>, &[f32; ACTIONS]) {
        (self.controller.values(), self.controller.policy())
    }

    /// Mean number of measurements per scan of each anchor that nothing known explains.
    pub fn unexplained(&self) -> &[f32; ANCHORS] {
        &self.unexplained
    }

    /// The configuration.
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// The action that the next frames should use.
    pub fn action(&self) -> Option<&Action> {
        self.controller.action()
    }

    /// 64-bit hash over all state: equal hashes after the same inputs mean equal bits.
    pub fn hash(&self) -> u64 {
        let mut hash = TraceHash::default();
        hash.word(self.cycle);
        hash.word(self.controller.action_index() as u32);
        self.filter.visit(|v| hash.float(v));
        for (slot, record) in self.environment.iter() {
            hash.word(slot as u32);
            hash.word(record.anchor as u32);
            hash.float(record.existence);
            hash.word(u32::from(record.misses));
            hash.word(record.hits);
        }
        self.channel.visit(|v| hash.float(v));
        self.discovery.visit(|v| hash.float(v));
        hash.word(u32::from(self.acquisition.is_some()));
        if let Some(acquisition) = &self.acquisition {
            acquisition.visit(|v| hash.float(v));
        }
        self.loss.visit(|v| hash.float(v));
        let (values, policy) = (self.controller.values().values(), self.controller.policy());
        values.iter().chain(policy).for_each(|v| hash.float(*v));
        self.unexplained.iter().for_each(|v| hash.float(*v));
        for last in self.last_sequence {
            hash.word(u32::from(last.is_some()));
            hash.word(last.unwrap_or(0));
        }
        hash.value()
    }
}

fn build_estimator<const PATHS: usize>(config: &Config, pulse: Pulse) -> ChannelEstimator<PATHS> {
    let radio = &config.radio;
    ChannelEstimator::new(pulse, radio.sample_spacing_s, radio.samples_per_frame, radio.false_paths_per_frame)
}

/// The sources planning counts on: all direct paths, and the virtual anchors that are confirmed.
fn visible<'a, const ANCHORS: usize, const VAS: usize>(
    anchors: &'a Vec<Anchor, ANCHORS>,
    environment: &'a EnvironmentMemory<VAS>,
    filter: &'a StateFilter<ANCHORS, VAS>,
    tag_height_m: Option<f32>,
) -> impl Iterator<Item = Visible> + Clone + 'a {
    let height = move |anchor: &Anchor| tag_height_m.map_or(0.0, |height| anchor.height_m - height);
    let direct = anchors.iter().enumerate().map(move |(index, anchor)| Visible {
        source: Source::Direct { anchor: index },
        position_m: anchor.position_m,
        height_m: height(anchor),
        covariance_m2: Matrix2::new(0.0, 0.0, 0.0, 0.0),
    });
    let reflected = environment.iter().filter_map(move |(slot, record)| {
        if record.existence <= CONFIRMED {
            return None;
        }
        let (position, covariance_m2) = filter.virtual_anchor(slot)?;
        Some(Visible {
            source: Source::Virtual { anchor: record.anchor, slot },
            position_m: [position.x, position.y],
            height_m: height(anchors.get(record.anchor)?),
            covariance_m2,
        })
    });
    direct.chain(reflected)
}

/// Sums up the measurements associated with a feature; `None` where hardly any probability is.
fn innovation<const PATHS: usize>(
    regression: &Regression,
    measurements: &Vec<Measurement, PATHS>,
    belief: &Belief<PATHS>,
) -> Option<Innovation> {
    let mut weight = 0.0;
    let mut first_m = 0.0;
    let mut second_m2 = 0.0;
    let mut variance = 0.0;
    for (measurement, &p) in measurements.iter().zip(&belief.associated) {
        let nu = measurement.range_m - regression.range_m;
        weight += p;
        first_m += p * nu;
        second_m2 += p * (nu * nu);
        variance += p * measurement.variance_m2;
    }
    if weight < 1e-3 {
        return None;
    }
    Some(Innovation { regression: *regression, weight, first_m, second_m2, variance_m2: variance / weight })
}
