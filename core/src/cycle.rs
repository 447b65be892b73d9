//! The perception-action cycle: receive, estimate, associate, update, remember, discover, reward, learn, plan,
//! act.

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
use crate::memory::environment::{CONFIRMED, EnvironmentMemory};
use crate::observation::{Frame, FrameRules, Observation, RangeScan, check_frame, check_scan};
use crate::observer::{Observer, Stage};
use crate::perceptor::association::{Belief, Beliefs, Clutter, Expectation, Measurement, Mode, associate};
use crate::perceptor::channel_estimator::ChannelEstimator;
use crate::perceptor::discovery::{Discovered, Discovery, Viewpoint};
use crate::perceptor::state_filter::{Innovation, Regression, Sight, Source, StateFilter};
use crate::pulse::Pulse;
use crate::real::{SPEED_OF_LIGHT_M_S, abs, larger};
use crate::report::CycleReport;
use crate::trace::TraceHash;
use heapless::Vec;
use nalgebra::{Matrix2, Matrix4};

/// What an anchor delivered, as measurements, and the action its frame was received with.
struct Scan<const PATHS: usize> {
    anchor: usize,
    action: usize,
    measurements: Vec<Measurement, PATHS>,
    /// Whether a frame was received: only then does a missing path say something about the carrier.
    framed: bool,
}

/// A scan with what it was compared to, and the outcome.
struct AssociatedScan<'a, const VAS: usize, const PATHS: usize> {
    scan: &'a Scan<PATHS>,
    direct: Regression,
    virtual_anchors: Vec<Regression, VAS>,
    beliefs: Beliefs<VAS, PATHS>,
}

impl<const VAS: usize, const PATHS: usize> AssociatedScan<'_, VAS, PATHS> {
    /// Every feature with the beliefs about it, the direct path first.
    fn features(&self) -> impl Iterator<Item = (&Regression, &Belief<PATHS>)> {
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
        let mut environment = EnvironmentMemory::default();
        for (slot, mapped) in map.iter().enumerate() {
            mapped.check(slot, anchors.len())?;
            filter.insert_independent(slot, mapped.position_m, mapped.std_m);
            environment.insert(slot, mapped.anchor, 0.9);
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
        let previous = self.filter.agent_covariance();
        self.filter.predict(elapsed_s);
        let predicted = self.filter.agent_covariance();

        observer.stage(Stage::Associate);
        let heard = self.associate(&scans, tag_height_m, observer);

        observer.stage(Stage::Update);
        self.update(&heard);
        let posterior = self.filter.agent_covariance();

        observer.stage(Stage::Remember);
        let mut report = self.blank_report();
        self.remember(&heard, &mut report);

        observer.stage(Stage::Discover);
        self.discover(&heard, tag_height_m, &mut report);

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
                Observation::Ranges(scan) => check_scan(scan, PATHS, rules.max_range_m)?,
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
            let measurement = Measurement { range_m: range.range_m, variance_m2, sinr: 0.0, energy: 0.0 };
            // Checked against the capacity: every push succeeds.
            let _ = into.measurements.push(measurement);
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
            // Where ranges took up room, the latest paths are dropped.
            let _ = into.measurements.push(measurement);
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
        let settings = &self.config.association;
        let sight = self.sight(anchor, tag_height_m)?;
        let expectation = |regression: &Regression, existence: f32| Expectation {
            range_m: regression.range_m,
            variance_m2: regression.variance_m2(),
            existence,
            detection: settings.detection_probability,
        };
        let direct = self.filter.regress(Source::Direct { anchor }, &sight)?;
        let mut virtual_anchors = Vec::new();
        let mut expectations: Vec<Expectation, VAS> = Vec::new();
        for (slot, record) in self.environment.iter() {
            if record.anchor == anchor {
                let regression = self.filter.regress(Source::Virtual { anchor, slot }, &sight)?;
                let existence = self.environment.expected_existence(slot, settings.survival_probability);
                // One per slot at most: the pushes succeed.
                let _ = virtual_anchors.push(regression);
                let _ = expectations.push(expectation(&regression, existence));
            }
        }
        let per_m = 1.0 / self.config.ranging.max_range_m;
        let unexplained = self.unexplained.get(anchor)?;
        let clutter = Clutter {
            false_alarms_per_m: settings.clutter_per_anchor * per_m,
            all_per_m: unexplained * per_m,
        };
        let mut beliefs = associate(&expectation(&direct, 1.0), &expectations, &scan.measurements, &clutter);
        if settings.mode == Mode::Map {
            beliefs.harden();
        }
        Some(AssociatedScan { scan, direct, virtual_anchors, beliefs })
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

    /// Existence of virtual anchors, SINR of every source whose path was probably seen, and how much of each scan
    /// nothing explained.
    #[inline(never)]
    fn remember(&mut self, heard: &Vec<AssociatedScan<'_, VAS, PATHS>, ANCHORS>, report: &mut CycleReport) {
        self.channel.age();
        for associated in heard {
            let scan = &associated.scan;
            for (regression, belief) in associated.features() {
                if let Source::Virtual { slot, .. } = regression.source {
                    self.environment.remember(slot, belief.existence, belief.missed < 0.5);
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
        if !self.config.discovery {
            return;
        }
        for associated in heard {
            let anchor = associated.scan.anchor;
            let Some(sight) = self.sight(anchor, tag_height_m) else { continue };
            let viewpoint = Viewpoint {
                position_m: self.filter.position_m(),
                covariance_m2: self.filter.position_covariance_m2(),
                height_m: sight.height_m,
            };
            let bias_m = self.filter.bias_m(anchor).map_or(0.0, |(mean, _)| mean);
            let mut leftovers: Vec<Measurement, PATHS> = Vec::new();
            for (measurement, &free) in
                associated.scan.measurements.iter().zip(&associated.beliefs.unassociated)
            {
                if free > 0.5 {
                    // As many as measurements: the push succeeds.
                    let _ =
                        leftovers.push(Measurement { range_m: measurement.range_m - bias_m, ..*measurement });
                }
            }
            self.discovery.observe(anchor, &viewpoint, &leftovers);
            while let Some(found) = self.discovery.take_resolved(anchor) {
                self.take_in(anchor, &sight, &found, report);
            }
        }
    }

    /// Forgets a virtual anchor outside the environment memory.
    fn take_out(&mut self, slot: usize, report: &mut CycleReport) {
        self.filter.remove(slot);
        self.channel.forget(slot);
        report.forgotten += 1;
    }

    /// Enters a discovery into the map, in the place of an unconfirmed virtual anchor if there is no other.
    fn take_in(&mut self, anchor: usize, sight: &Sight, found: &Discovered, report: &mut CycleReport) {
        if self.is_known(anchor, sight, found) {
            return;
        }
        let mut slot = self.environment.free_slot();
        if slot.is_none() {
            slot = self.environment.give_way();
            if let Some(slot) = slot {
                self.take_out(slot, report);
            }
        }
        let Some(slot) = slot else {
            report.map_full += 1;
            return;
        };
        self.filter.insert_relative(slot, found.position, found.covariance);
        self.environment.insert(slot, anchor, 0.9);
        report.discovered += 1;
    }

    /// Whether a discovery lies within 0.3 m of the anchor or of one of its virtual anchors.
    fn is_known(&self, anchor: usize, sight: &Sight, found: &Discovered) -> bool {
        let near = |x: f32, y: f32| {
            let (dx, dy) = (found.position.x - x, found.position.y - y);
            dx * dx + dy * dy < 0.09
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
            associated: 0,
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
