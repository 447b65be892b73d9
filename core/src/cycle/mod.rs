//! The perception-action cycle: receive, estimate, acquire or associate, update, remember, discover, reward, learn,
//! plan, act.

mod act;
mod associate;
mod discover;
mod locate;
mod receive;
mod remember;
mod update;

use self::act::Covariances;
use self::receive::build_estimator;
use crate::anchor::{Anchor, MappedVirtualAnchor};
use crate::config::Config;
use crate::controller::Controller;
use crate::controller::hop::Roll;
use crate::controller::library::{Action, Library};
use crate::error::{Error, Setting};
use crate::memory::channel::ChannelMemory;
use crate::memory::environment::EnvironmentMemory;
use crate::observation::{Frame, Observation};
use crate::observer::{Observer, Stage};
use crate::perceptor::acquisition::Acquisition;
use crate::perceptor::channel_estimator::ChannelEstimator;
use crate::perceptor::discovery::Discovery;
use crate::perceptor::gain_control::GainControl;
use crate::perceptor::loss::LossMonitor;
use crate::perceptor::state_filter::{Sight, Source, StateFilter};
use crate::pulse::Pulse;
use crate::report::CycleReport;
use crate::trace::TraceHash;
use heapless::Vec;
use nalgebra::Matrix2;

/// The tracker: all state of the cognitive system, in fixed memory.
#[derive(Clone, Debug)]
pub struct Tracker<const ANCHORS: usize, const VAS: usize, const PATHS: usize, const ACTIONS: usize> {
    config: Config,
    anchors: Vec<Anchor, ANCHORS>,
    /// Estimator for the pulse it was last used with; rebuilt when the pulse changes, so no state.
    estimator: ChannelEstimator<PATHS>,
    estimator_pulse: Pulse,

    cycle: u32,
    gain_control: [GainControl; ANCHORS],
    filter: StateFilter<ANCHORS, VAS>,
    environment: EnvironmentMemory<VAS>,
    channel: ChannelMemory<ANCHORS, VAS, ACTIONS>,
    discovery: Discovery<ANCHORS>,
    /// While it is not known where the tag is.
    acquisition: Option<Acquisition<ANCHORS>>,
    loss: LossMonitor,
    library: Library<ACTIONS>,
    /// One for each anchor, or one for all.
    controllers: Vec<Controller<ACTIONS>, ANCHORS>,
    roll: Roll<ANCHORS>,
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
        if config.controller.rendezvous.is_some_and(|rendezvous| library.get(rendezvous).is_none()) {
            return Err(Error::Configuration(Setting::Rendezvous));
        }
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
        let speed = start.velocity_std_m_s;
        let start = filter.agent();
        let mut environment = EnvironmentMemory::default();
        for (slot, mapped) in map.iter().enumerate() {
            mapped.check(slot, anchors.len())?;
            let std_m = if config.exact_map { 0.0 } else { mapped.std_m };
            filter.insert_independent(slot, mapped.position_m, std_m);
            environment.insert(slot, mapped.anchor, 0.9, 0);
        }
        let mut controllers = Vec::new();
        let own = if config.controller.per_anchor { checked.len() } else { 1 };
        for index in 0..own {
            let seed = seed ^ (index as u64).wrapping_mul(0xd1b5_4a32_d192_ed03);
            // No more than anchors: the push succeeds.
            let _ = controllers.push(Controller::new(config.controller, library.all(), seed));
        }
        let pulse = config.radio.pulse(first);
        let association = &config.association;
        let unexplained = association.clutter_per_anchor + association.unmapped_per_anchor;
        Ok(Self {
            config,
            anchors: checked,
            estimator: build_estimator(&config, pulse),
            estimator_pulse: pulse,
            cycle: 0,
            gain_control: [GainControl::default(); ANCHORS],
            filter,
            environment,
            channel: ChannelMemory::new(config.controller.prior_sinr, config.controller.neighbours, &library),
            discovery: Discovery::default(),
            acquisition: Some(Acquisition::new(start, speed * speed)),
            loss: LossMonitor::default(),
            library,
            controllers,
            roll: Roll::default(),
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
        let gap = self.acquisition.is_none()
            && LossMonitor::is_too_wide(before.covariance.m11, before.covariance.m22);
        if gap {
            self.lose_sight(&last, &before);
        }

        observer.stage(Stage::Associate);
        // After a gap, the places to come are those of now.
        self.acquire(&scans, if gap { 0.0 } else { elapsed_s }, tag_height_m);
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
            self.unmask(&heard);
            self.remember(&heard, &mut report);
            report.nis = Self::normalised_innovation(&heard);

            observer.stage(Stage::Discover);
            if !self.loss.is_doubtful() {
                self.discover(&heard, tag_height_m, &mut report);
            }
        } else {
            observer.stage(Stage::Remember);
            self.channel.age();
            heard.iter().for_each(|associated| self.remember_noise(associated));
        }
        let posterior = self.filter.agent_covariance();

        observer.stage(Stage::Act);
        let covariances = Covariances { previous, predicted, posterior };
        self.act(&covariances, elapsed_s, tag_height_m, &scans, &mut report);

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

    /// Where an anchor is seen from the tag.
    fn sight(&self, anchor: usize, tag_height_m: Option<f32>) -> Option<Sight> {
        let anchor = self.anchors.get(anchor)?;
        let height_m = tag_height_m.map_or(0.0, |height| anchor.height_m - height);
        Some(Sight { anchor_m: anchor.position_m, height_m })
    }

    fn blank_report(&self) -> CycleReport {
        let action = self.next_action(0);
        let next = self.library.get(action).copied();
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
            action,
            next_action: action,
            announced_action: None,
            next: next.unwrap_or(Action { carrier_hz: 0.0, pulse_duration_s: 0.0 }),
        }
    }

    /// What is known of every anchor's frames where the receiver controls its gain.
    pub fn gain_control(&self) -> &[GainControl; ANCHORS] {
        &self.gain_control
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

    /// Tells the channel memory the SINR (linear) of a source at every action, which no radio can know: see
    /// [`ChannelMemory::tell`].
    ///
    /// # Errors
    /// A SINR that is negative or not finite, or not one per action, or a source that there is not; nothing is told then.
    pub fn tell_channel(&mut self, source: Source, sinr: &[f32]) -> Result<(), Error> {
        let is_sinr = |sinr: &f32| *sinr >= 0.0 && sinr.is_finite();
        let is_there = match source {
            Source::Direct { anchor } => anchor < self.anchors.len(),
            Source::Virtual { anchor, slot } => {
                self.environment.get(slot).is_some_and(|record| record.anchor == anchor)
            }
        };
        if sinr.len() != self.library().len() || !sinr.iter().all(is_sinr) || !is_there {
            return Err(Error::ToldSinr);
        }
        self.channel.tell(source, sinr);
        Ok(())
    }

    /// The candidates for virtual anchors.
    pub fn discovery(&self) -> &Discovery<ANCHORS> {
        &self.discovery
    }

    /// The places the tag may be at, while it is not known.
    pub fn acquisition(&self) -> Option<&Acquisition<ANCHORS>> {
        self.acquisition.as_ref()
    }

    /// Mean number of measurements per scan of each anchor that nothing known explains.
    pub fn unexplained(&self) -> &[f32; ANCHORS] {
        &self.unexplained
    }

    /// The configuration.
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// The anchors.
    pub fn anchors(&self) -> &[Anchor] {
        &self.anchors
    }

    /// The action library.
    pub fn library(&self) -> &Library<ACTIONS> {
        &self.library
    }

    /// Threshold on the normalised energy of a path, of the pulse last used.
    pub fn threshold(&self) -> f32 {
        self.estimator.threshold()
    }

    /// 64-bit hash over all state: equal hashes after the same inputs mean equal bits.
    pub fn hash(&self) -> u64 {
        let mut hash = TraceHash::default();
        hash.word(self.cycle);
        self.roll.lost().iter().for_each(|lost| hash.word(*lost));
        hash.word(u32::from(self.channel.is_full_band()));
        for controller in &self.controllers {
            controller.words().into_iter().for_each(|word| hash.word(word));
        }
        self.gain_control.iter().for_each(|control| control.visit(|v| hash.float(v)));
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
        for controller in &self.controllers {
            let (values, policy) = (controller.values().values(), controller.policy());
            values.iter().chain(policy).for_each(|v| hash.float(*v));
            hash.float(controller.planned_reward().unwrap_or(0.0));
        }
        self.unexplained.iter().for_each(|v| hash.float(*v));
        for last in self.last_sequence {
            hash.word(u32::from(last.is_some()));
            hash.word(last.unwrap_or(0));
        }
        hash.value()
    }
}
