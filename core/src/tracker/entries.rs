//! The ways in: construction, a whole cycle at once, and a cycle by its observations.

use super::integrity::Seals;
use super::start::{enter_heading, enter_plan, enter_virtual_anchors};
use super::{Begun, Tracker};
use crate::config::Config;
use crate::controller::{Controller, Controllers};
use crate::error::{Error, Setting};
use crate::memory::channel::ChannelMemory;
use crate::memory::clutter::ClutterMemory;
use crate::memory::discovery::Discovery;
use crate::memory::environment::EnvironmentMemory;
use crate::memory::lateness::LatenessMemory;
use crate::memory::transmission::TransmissionMemory;
use crate::model::anchor::Anchor;
use crate::model::observation::{Observation, TagHeight};
use crate::model::plan::{FloorPlan, Map};
use crate::model::region::Region;
use crate::observer::{Observer, Stage};
use crate::perceptor::belief::TagBelief;
use crate::perceptor::receiver::{Delivered, LinkView, Receiver};
use crate::perceptor::state_filter::StateFilter;
use crate::radio::library::{Action, Library};
use crate::real::abs;
use crate::report::{CycleReport, Integrity};
use heapless::Vec;

impl<
    const ANCHORS: usize,
    const SURFACES: usize,
    const SOURCES: usize,
    const SEGMENTS: usize,
    const PATHS: usize,
    const ACTIONS: usize,
    const COMPONENTS: usize,
    const POINTS: usize,
> Tracker<ANCHORS, SURFACES, SOURCES, SEGMENTS, PATHS, ACTIONS, COMPONENTS, POINTS>
{
    /// A tracker at the start configured that is told of its surroundings: [`Self::untold`], then [`Self::tell`].
    ///
    /// # Errors
    /// The first value out of range.
    pub fn new(
        config: Config,
        anchors: &[Anchor],
        map: &Map<'_>,
        actions: &[Action],
        seed: u64,
    ) -> Result<Self, Error> {
        let mut tracker = Self::untold(config, anchors, actions, seed)?;
        tracker.tell(map)?;
        Ok(tracker)
    }

    /// A tracker at the start configured that knows nothing of its surroundings. `anchors`: 1 to `ANCHORS`; `actions`: 1 to
    /// `ACTIONS`; `seed`: of all randomness. It is built where it stays.
    ///
    /// # Errors
    /// The first value out of range.
    #[inline(always)] // built where it stays
    pub fn untold(config: Config, anchors: &[Anchor], actions: &[Action], seed: u64) -> Result<Self, Error> {
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
        let Config { start, ranging, .. } = config;
        if config.has_heading && SURFACES == 0 {
            return Err(Error::Configuration(Setting::Heading));
        }
        Ok(Self {
            receiver: Receiver::new(
                config.radio,
                config.estimator,
                ranging,
                config.radio.pulse(first),
                config.belief.reads_below_threshold,
            ),
            belief: TagBelief::new(
                StateFilter::new(
                    config.motion,
                    ranging.max_range_m,
                    start.position_m,
                    start.position_std_m,
                    start.velocity_std_m_s,
                    ranging.bias_mean_m,
                    ranging.bias_std_m,
                ),
                start.velocity_std_m_s,
                Region::reached(&checked, ranging.max_range_m),
                config.belief,
            ),
            environment: EnvironmentMemory::default(),
            transmission: TransmissionMemory::default(),
            discovery: Discovery::new(config.discovery_settings),
            clutter: ClutterMemory::new(config.association, &ranging),
            lateness: LatenessMemory::new(ranging.late_m),
            channel: ChannelMemory::new(
                config.channel,
                config.controller.prior_sinr,
                config.controller.neighbours,
                &library,
            ),
            controllers: Controllers::new(config.controller, checked.len(), &library, seed),
            config,
            anchors: checked,
            range_biases_m: [[ranging.bias_mean_m, ranging.bias_std_m]; ANCHORS],
            plan: FloorPlan::default(),
            library,
            map: 0,
            cycle: 0,
            last_heard: start.agent(),
            lever_arm_m: [0.0; 2],
            begun: None,
            scans: Vec::new(),
            seals: Seals::NONE,
        })
    }

    /// Tells a tracker of its surroundings, once, before its first cycle. Virtual anchors of the map take the first slots, each
    /// with a private surface; then come the sources that the plan shows ([`crate::model::listing`]), the most useful first, as
    /// many as fit.
    ///
    /// # Errors
    /// The first value out of range, or [`Error::AlreadyTold`]; nothing has changed then.
    pub fn tell(&mut self, map: &Map<'_>) -> Result<(), Error> {
        let is_told = self.environment.iter().next().is_some() || self.plan != FloorPlan::default();
        if self.cycle > 0 || self.begun.is_some() || is_told {
            return Err(Error::AlreadyTold);
        }
        let given = map.virtual_anchors.len();
        let limit = SURFACES.saturating_sub(usize::from(self.config.has_heading)).min(SOURCES);
        if given > limit {
            return Err(Error::VirtualAnchorCount { given, limit });
        }
        for (slot, mapped) in map.virtual_anchors.iter().enumerate() {
            mapped.check(slot, self.anchors.len())?;
        }
        let Self { config, anchors, library, belief, environment, plan, map: digest, .. } = self;
        if let Some(told) = &map.plan {
            plan.keep(told)?;
            if let Some(region) = Region::inside(plan.outline_m()) {
                belief.bound(region);
            }
        }
        belief.tell(|filter| {
            if config.has_heading {
                enter_heading(filter, environment, config.belief.turns_per_s);
            }
            enter_virtual_anchors(filter, environment, map.virtual_anchors, config.exact_map);
            if let Some(told) = &map.plan {
                enter_plan(filter, environment, plan, told, anchors, config, library.shortest_pulse_m());
            }
        });
        *digest = map.digest();
        self.seals = Seals::of_told(self.seal_told());
        Ok(())
    }

    /// Tells the range bias of one anchor, before the first cycle: its mean (-10 to 10 m) and standard deviation (0 to 10 m; 0 where it
    /// is known exactly). Without, it is that of the configuration ([`Ranging::bias_mean_m`](crate::model::measurement::Ranging)).
    ///
    /// # Errors
    /// There is no such anchor, or a value is out of range, or [`Error::AlreadyTold`]; nothing has changed then.
    pub fn tell_range_bias(&mut self, anchor: usize, mean_m: f32, std_m: f32) -> Result<(), Error> {
        if self.cycle > 0 || self.begun.is_some() {
            return Err(Error::AlreadyTold);
        }
        if anchor >= self.anchors.len() {
            return Err(Error::UnknownAnchor { anchor });
        }
        // Written so that NaN fails.
        if !(abs(mean_m) <= 10.0 && (0.0..=10.0).contains(&std_m)) {
            return Err(Error::Configuration(Setting::BiasPrior));
        }
        if let Some(told) = self.range_biases_m.get_mut(anchor) {
            *told = [mean_m, std_m];
        }
        self.belief.tell(|filter| filter.tell_bias(anchor, mean_m, std_m));
        self.seals = Seals::of_told(self.seal_told());
        Ok(())
    }

    /// From now on everything is received with an antenna that is this far ahead of the centre of the tag's body, and to its left
    /// (metres, within 1 km). With [`Config::has_heading`](crate::Config::has_heading), which way the body faces is estimated from what the
    /// antennas tell; it is entered with the surroundings, by [`Self::tell`].
    ///
    /// # Errors
    /// [`Error::LeverArm`] where it is out of range, or no heading is estimated; [`Error::AlreadyBegun`]. Nothing has changed then.
    pub fn switch_antenna(&mut self, lever_arm_m: [f32; 2]) -> Result<(), Error> {
        if self.begun.is_some() {
            return Err(Error::AlreadyBegun);
        }
        let is_centre = lever_arm_m == [0.0; 2];
        // Written so that NaN fails.
        if !lever_arm_m.iter().all(|arm_m| abs(*arm_m) <= 1000.0)
            || !(is_centre || self.filter().heading().is_some())
        {
            return Err(Error::LeverArm);
        }
        self.lever_arm_m = lever_arm_m;
        Ok(())
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
        observer: &mut impl Observer<SOURCES, PATHS>,
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
        let begun = self.check_begin(elapsed_s, tag_height)?;
        if !self.is_told_intact() {
            return Err(Error::ToldChanged);
        }
        self.begun = Some(Begun { integrity: self.check_seals(), ..begun });
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
        observer: &mut impl Observer<SOURCES, PATHS>,
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
        Ok(Begun { elapsed_s, tag_height, delivered: Delivered::default(), integrity: Integrity::default() })
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
            is_lost: self.belief.is_lost(observation.anchor()),
            loss_ln: self.channel.loss_ln(action),
        }
    }
}
