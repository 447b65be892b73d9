//! The ways in: construction, a whole cycle at once, and a cycle by its observations.

use super::{Begun, Tracker};
use crate::config::Config;
use crate::controller::{Controller, Controllers};
use crate::error::{Error, Setting};
use crate::memory::channel::ChannelMemory;
use crate::memory::clutter::ClutterMemory;
use crate::memory::discovery::Discovery;
use crate::memory::environment::{EnvironmentMemory, TOLD};
use crate::model::anchor::{Anchor, MappedVirtualAnchor};
use crate::model::observation::{Observation, TagHeight};
use crate::observer::{Observer, Stage};
use crate::perceptor::belief::TagBelief;
use crate::perceptor::receiver::{Delivered, LinkView, Receiver};
use crate::perceptor::state_filter::StateFilter;
use crate::radio::library::{Action, Library};
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
    #[inline(always)] // built where it stays
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
        for (slot, mapped) in map.iter().enumerate() {
            mapped.check(slot, anchors.len())?;
        }
        Ok(Self {
            receiver: Receiver::new(config.radio, config.estimator, ranging, config.radio.pulse(first)),
            belief: TagBelief::new(
                config.motion,
                start.velocity_std_m_s,
                start.agent(),
                config.acquisition,
                config.belief,
            ),
            filter: Self::filter_at_start(&config, map),
            environment: {
                let mut environment = EnvironmentMemory::default();
                for (slot, mapped) in map.iter().enumerate() {
                    environment.insert(slot, mapped.anchor, TOLD, 0);
                }
                environment
            },
            discovery: Discovery::new(config.discovery_settings),
            clutter: ClutterMemory::new(config.association, &ranging),
            channel: ChannelMemory::new(
                config.channel,
                config.controller.prior_sinr,
                config.controller.neighbours,
                &library,
            ),
            controllers: Controllers::new(config.controller, checked.len(), &library, seed),
            config,
            anchors: checked,
            library,
            cycle: 0,
            last_heard: start.agent(),
            begun: None,
            scans: Vec::new(),
        })
    }

    #[inline(always)] // built where it stays
    fn filter_at_start(config: &Config, map: &[MappedVirtualAnchor]) -> StateFilter<ANCHORS, VAS> {
        let Config { start, ranging, motion, exact_map, .. } = config;
        let mut filter = StateFilter::new(
            *motion,
            start.position_m,
            start.position_std_m,
            start.velocity_std_m_s,
            ranging.bias_mean_m,
            ranging.bias_std_m,
        );
        for (slot, mapped) in map.iter().enumerate() {
            let std_m = if *exact_map { 0.0 } else { mapped.std_m };
            filter.insert_independent(slot, mapped.position_m, std_m);
        }
        filter
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
        tag_height: Option<TagHeight>,
    ) -> Result<CycleReport, Error> {
        self.cycle_observed(observations, elapsed_s, tag_height, &mut ())
    }

    /// [`Self::cycle`], watched by an observer.
    ///
    /// # Errors
    /// The first bad input; nothing has changed then.
    pub fn cycle_observed(
        &mut self,
        observations: &[Observation<'_>],
        elapsed_s: f32,
        tag_height: Option<TagHeight>,
        observer: &mut impl Observer<VAS, PATHS>,
    ) -> Result<CycleReport, Error> {
        observer.stage(Stage::Receive);
        let mut begun = self.check_begin(elapsed_s, tag_height)?;
        for observation in observations {
            self.receiver.check(observation, self.anchors.len(), &self.library, &mut begun.delivered)?;
        }
        observer.stage(Stage::Estimate);
        self.begin(elapsed_s, tag_height)?;
        // By anchor, as the estimates are shown to the observer.
        for anchor in 0..self.anchors.len() {
            for observation in observations.iter().filter(|observation| observation.anchor() == anchor) {
                let link = self.link(observation);
                self.receiver.receive(&mut self.scans, observation, &link, &self.library, |estimate| {
                    observer.estimate(observation.anchor(), estimate);
                });
            }
        }
        self.finish_observed(observer)
    }

    /// Begins a cycle whose observations come one by one: of the last `elapsed_s` seconds, with the tag's height where it is
    /// known. [`Self::receive`] takes the observations, [`Self::finish`] ends it.
    ///
    /// # Errors
    /// Bad input, or [`Error::AlreadyBegun`]; nothing has changed then.
    pub fn begin(&mut self, elapsed_s: f32, tag_height: Option<TagHeight>) -> Result<(), Error> {
        self.begun = Some(self.check_begin(elapsed_s, tag_height)?);
        self.receiver.advance(elapsed_s);
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
        let link = self.link(observation);
        self.receiver.receive(&mut self.scans, observation, &link, &self.library, |estimate| {
            observer.estimate(observation.anchor(), estimate);
        });
        Ok(())
    }

    /// Whether a cycle is begun and how it would begin.
    fn check_begin(&self, elapsed_s: f32, tag_height: Option<TagHeight>) -> Result<Begun<ANCHORS>, Error> {
        if self.begun.is_some() {
            return Err(Error::AlreadyBegun);
        }
        if !(elapsed_s > 0.0 && elapsed_s <= 3600.0) {
            return Err(Error::Time { elapsed_s });
        }
        if !tag_height.is_none_or(|height| height.is_in_range()) {
            return Err(Error::TagHeight);
        }
        Ok(Begun { elapsed_s, tag_height, delivered: Delivered::default() })
    }

    /// What the receiver is told of the link to an observation's anchor.
    fn link(&self, observation: &Observation<'_>) -> LinkView {
        let controller = self.controllers.of(observation.anchor());
        let action = match observation {
            Observation::Frame(frame) => frame.action,
            Observation::Ranges(_) => 0,
        };
        LinkView {
            expected: controller.map_or(0, Controller::action_index),
            held: controller.map_or(0, Controller::held),
            sought_with: controller.and_then(Controller::sought_with),
            is_lost: self.belief.is_acquiring(),
            loss_ln: self.channel.loss_ln(action),
        }
    }
}
