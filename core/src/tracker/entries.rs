//! The ways in: construction, a whole cycle at once, and a cycle by its observations.

use super::{Begun, Tracker};
use crate::config::Config;
use crate::controller::{Controller, Controllers};
use crate::error::{Error, Setting};
use crate::memory::channel::ChannelMemory;
use crate::memory::clutter::ClutterMemory;
use crate::memory::discovery::Discovery;
use crate::memory::environment::EnvironmentMemory;
use crate::model::anchor::{Anchor, MappedVirtualAnchor};
use crate::model::observation::Observation;
use crate::observer::{Observer, Stage};
use crate::perceptor::belief::Belief;
use crate::perceptor::receiver::{Delivered, LinkView, Receiver};
use crate::perceptor::state_filter::StateFilter;
use crate::radio::library::{Action, Library};
use crate::real::abs;
use crate::report::CycleReport;
use heapless::Vec;

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
        let start_speed_m_s = start.velocity_std_m_s;
        let mut environment = EnvironmentMemory::default();
        for (slot, mapped) in map.iter().enumerate() {
            mapped.check(slot, anchors.len())?;
            let std_m = if config.exact_map { 0.0 } else { mapped.std_m };
            filter.insert_independent(slot, mapped.position_m, std_m);
            environment.insert(slot, mapped.anchor, 0.9, 0);
        }
        Ok(Self {
            receiver: Receiver::new(config.radio, ranging, config.radio.pulse(first)),
            belief: Belief::new(config.motion, start_speed_m_s, filter.agent(), config.acquisition),
            filter,
            environment,
            discovery: Discovery::new(config.discovery_settings),
            clutter: ClutterMemory::new(config.association, &ranging),
            channel: ChannelMemory::new(config.controller.prior_sinr, config.controller.neighbours, &library),
            controllers: Controllers::new(config.controller, checked.len(), &library, seed),
            config,
            anchors: checked,
            library,
            cycle: 0,
            begun: None,
            scans: Vec::new(),
        })
    }

    /// One cycle at once: what was received in the last `elapsed_s` seconds (one frame or scan per anchor at most, none for
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

    /// [`Self::cycle`], watched by an observer.
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
        let mut begun = self.check_begin(elapsed_s, tag_height_m)?;
        for observation in observations {
            self.receiver.check(observation, self.anchors.len(), &self.library, &mut begun.delivered)?;
        }
        observer.stage(Stage::Estimate);
        self.scans.clear();
        self.begun = Some(begun);
        // By anchor, as the estimates are shown to the observer.
        for anchor in 0..self.anchors.len() {
            for observation in observations.iter().filter(|observation| observation.anchor() == anchor) {
                self.take(observation, observer);
            }
        }
        self.finish_observed(observer)
    }

    /// Begins a cycle whose observations come one by one: of the last `elapsed_s` seconds, with the tag's height where it is
    /// known. [`Self::receive`] takes the observations, [`Self::finish`] ends it.
    ///
    /// # Errors
    /// Bad input, or [`Error::AlreadyBegun`]; nothing has changed then.
    pub fn begin(&mut self, elapsed_s: f32, tag_height_m: Option<f32>) -> Result<(), Error> {
        self.begun = Some(self.check_begin(elapsed_s, tag_height_m)?);
        self.scans.clear();
        Ok(())
    }

    /// Takes one observation of the cycle begun: one frame and one scan of ranges of each anchor, in any order. What is
    /// made of them has the bits of [`Self::cycle`] with all of them.
    ///
    /// # Errors
    /// Bad input, or [`Error::NotBegun`]; nothing has changed then.
    pub fn receive(&mut self, observation: &Observation<'_>) -> Result<(), Error> {
        self.receive_observed(observation, &mut ())
    }

    /// [`Self::receive`], watched by an observer.
    ///
    /// # Errors
    /// Bad input, or [`Error::NotBegun`]; nothing has changed then.
    pub fn receive_observed(
        &mut self,
        observation: &Observation<'_>,
        observer: &mut impl Observer<VAS, PATHS>,
    ) -> Result<(), Error> {
        let begun = self.begun.as_mut().ok_or(Error::NotBegun)?;
        self.receiver.check(observation, self.anchors.len(), &self.library, &mut begun.delivered)?;
        self.take(observation, observer);
        Ok(())
    }

    /// Whether a cycle is begun and how it would begin.
    fn check_begin(&self, elapsed_s: f32, tag_height_m: Option<f32>) -> Result<Begun<ANCHORS>, Error> {
        if self.begun.is_some() {
            return Err(Error::AlreadyBegun);
        }
        if !(elapsed_s > 0.0 && elapsed_s <= 3600.0) {
            return Err(Error::Time { elapsed_s });
        }
        if let Some(height) = tag_height_m
            && !(abs(height) <= 1000.0)
        {
            return Err(Error::TagHeight);
        }
        Ok(Begun { elapsed_s, tag_height_m, delivered: Delivered::default() })
    }

    fn take(&mut self, observation: &Observation<'_>, observer: &mut impl Observer<VAS, PATHS>) {
        let anchor = observation.anchor();
        let controller = self.controllers.of(anchor);
        let frame_action = match observation {
            Observation::Frame(frame) => frame.action,
            Observation::Ranges(_) => 0,
        };
        let link = LinkView {
            expected: controller.map_or(0, Controller::action_index),
            held: controller.map_or(0, Controller::held),
            sought_with: controller.and_then(Controller::sought_with),
            is_lost: self.belief.is_acquiring(),
            loss_ln: self.channel.loss_ln(frame_action),
        };
        self.receiver.receive(&mut self.scans, observation, &link, &self.library, observer);
    }
}
