//! The ways in: construction, a whole cycle at once, and a cycle by its observations.

use super::integrity::Seals;
use super::start::{broken_bound, enter_heading, enter_plan, enter_virtual_anchors, take_in};
use super::{Begun, Phase, Tracker};
use crate::config::{Config, ControllerSettings};
use crate::controller::{Controller, Controllers};
use crate::error::{Error, Setting};
use crate::memory::channel::ChannelMemory;
use crate::memory::clutter::ClutterMemory;
use crate::memory::discovery::{Discovery, DiscoverySettings};
use crate::memory::environment::EnvironmentMemory;
use crate::memory::lateness::LatenessMemory;
use crate::memory::transmission::TransmissionMemory;
use crate::model::anchor::Anchor;
use crate::model::motion::Agent;
use crate::model::observation::{Observation, TagHeight};
use crate::model::plan::{FloorPlan, Map};
use crate::model::region::Region;
use crate::observer::{Observer, Stage};
use crate::perceptor::belief::TagBelief;
use crate::perceptor::receiver::{Delivered, LinkView, Receiver};
use crate::radio::library::{Action, Library};
use crate::real::abs;
use crate::report::{CycleReport, Integrity, Part};
use heapless::Vec;

/// Whether an antenna can be there. Written so that NaN fails.
pub(super) fn is_lever_arm(lever_arm_m: [f32; 2]) -> bool {
    lever_arm_m.iter().all(|arm_m| abs(*arm_m) <= 1000.0)
}

impl<
    const ANCHORS: usize,
    const SURFACES: usize,
    const SOURCES: usize,
    const SEGMENTS: usize,
    const PATHS: usize,
    const ACTIONS: usize,
    const COMPONENTS: usize,
    const POINTS: usize,
    const CANDIDATES: usize,
> Tracker<ANCHORS, SURFACES, SOURCES, SEGMENTS, PATHS, ACTIONS, COMPONENTS, POINTS, CANDIDATES>
{
    /// An empty tracker, to be started where it stays: of a static, all zeros, which take no flash.
    ///
    /// Capacities out of their bounds do not compile, and the error names the bound:
    ///
    /// ```compile_fail,E0080
    /// // PATHS is above 32: sets of paths have 32 bits
    /// static TRACKER: cogmint_core::Tracker<1, 1, 1, 1, 33, 1, 1, 0, 0> = cogmint_core::Tracker::new();
    /// ```
    #[inline(always)] // built where it stays
    #[allow(clippy::new_without_default)] // a default is made on the stack
    pub const fn new() -> Self {
        Self::empty()
    }
}

impl<
    const ANCHORS: usize,
    const SURFACES: usize,
    const SOURCES: usize,
    const SEGMENTS: usize,
    const PATHS: usize,
    const ACTIONS: usize,
    const COMPONENTS: usize,
    const POINTS: usize,
    const CANDIDATES: usize,
    const FRAMES: usize,
> Tracker<ANCHORS, SURFACES, SOURCES, SEGMENTS, PATHS, ACTIONS, COMPONENTS, POINTS, CANDIDATES, FRAMES>
{
    /// Does not compile where a capacity is out of its bounds, and says which.
    #[allow(clippy::panic)] // of the compiler
    const BOUNDS: () = {
        let broken = broken_bound(ANCHORS, SURFACES, SEGMENTS, PATHS, ACTIONS, COMPONENTS, POINTS, FRAMES);
        if let Some(bound) = broken {
            panic!("{}", bound);
        }
    };

    /// [`Self::new`] of any tracker, one that takes ranges alone ([`RangeTracker`](crate::RangeTracker)) among them.
    #[inline(always)] // built where it stays
    pub const fn empty() -> Self {
        let () = Self::BOUNDS;
        Self {
            config: Config::NONE,
            anchors: Vec::new(),
            range_biases_m: [[0.0; 2]; ANCHORS],
            plan: FloorPlan::empty(),
            library: Library::empty(),
            receiver: Receiver::empty(),
            belief: TagBelief::empty(),
            environment: EnvironmentMemory::empty(),
            transmission: TransmissionMemory::empty(),
            discovery: Discovery::new(DiscoverySettings::NONE),
            clutter: ClutterMemory::empty(),
            lateness: LatenessMemory::empty(),
            channel: ChannelMemory::empty(),
            controllers: Controllers::empty(),
            map: 0,
            cycle: 0,
            last_heard: Agent::NONE,
            lever_arm_m: [0.0; 2],
            phase: Phase::Empty,
            begun: Begun::NONE,
            scans: Vec::new(),
            seals: Seals::NONE,
        }
    }

    /// Starts the tracker, afresh where it was started before: as configured, of these anchors (1 to `ANCHORS`) and actions (1 to
    /// `ACTIONS`), and told of its surroundings by the map. `seed`: of all randomness. Virtual anchors of the map take the first slots,
    /// each with a private surface; then come the sources that the plan shows ([`crate::model::listing`]), the most useful first, as
    /// many as fit.
    ///
    /// # Errors
    /// The first value out of range; the tracker is empty then.
    pub fn start(
        &mut self,
        config: &Config,
        anchors: &[Anchor],
        map: &Map<'_>,
        actions: &[Action],
        seed: u64,
    ) -> Result<(), Error> {
        let Self {
            config: own,
            anchors: own_anchors,
            range_biases_m,
            plan,
            library,
            receiver,
            belief,
            environment,
            transmission,
            discovery,
            clutter,
            lateness,
            channel,
            controllers,
            map: digest,
            cycle,
            last_heard,
            lever_arm_m,
            phase,
            begun,
            scans,
            seals,
        } = self;
        *phase = Phase::Empty;
        *seals = Seals::NONE;
        *range_biases_m = [[0.0; 2]; ANCHORS];
        *begun = Begun::NONE;
        *own = Config::NONE;
        receiver.clear();
        belief.clear();
        environment.clear();
        *transmission = TransmissionMemory::empty();
        discovery.start(DiscoverySettings::NONE);
        *clutter = ClutterMemory::empty();
        *lateness = LatenessMemory::empty();
        channel.clear();
        controllers.clear();
        (*digest, *cycle, *lever_arm_m) = (0, 0, [0.0; 2]);
        *last_heard = Agent::NONE;
        scans.clear();
        let first = take_in(config, anchors, map, actions, (SURFACES, SOURCES), (own_anchors, plan, library));
        let pulse = match first {
            Ok(first) => config.radio.pulse(&first),
            Err(error) => {
                own_anchors.clear();
                plan.clear();
                library.clear();
                return Err(error);
            }
        };
        *own = *config;
        // Of a map that there is no room for, nothing is told.
        *digest = if SOURCES == 0 && SEGMENTS == 0 { 0 } else { map.digest() };
        let own = &*own;
        let Config { start, ranging, .. } = own;
        receiver.start(own.radio, own.estimator, *ranging, pulse, own.belief.reads_below_threshold);
        environment.start();
        let reached = Region::reached(own_anchors, ranging.max_range_m);
        let region = Region::inside(plan.outline_m()).unwrap_or(reached);
        belief.start(start.velocity_std_m_s, region, own.belief, |filter| {
            filter.start(
                own.motion,
                ranging.max_range_m,
                start.position_m,
                start.position_std_m,
                start.velocity_std_m_s,
                ranging.bias_mean_m,
                ranging.bias_std_m,
            );
            if own.has_heading {
                enter_heading(filter, environment, own.belief.turns_per_s);
            }
            enter_virtual_anchors(filter, environment, map.virtual_anchors, own.exact_map);
            if SEGMENTS > 0
                && let Some(told) = &map.plan
            {
                enter_plan(filter, environment, plan, told, own_anchors, own, library.shortest_pulse_m());
            }
        });
        discovery.start(own.discovery_settings);
        clutter.start(own.association, ranging);
        *lateness = LatenessMemory::new(ranging.late_m);
        let ControllerSettings { prior_sinr, neighbours, .. } = own.controller;
        channel.start(own.channel, prior_sinr, neighbours, library);
        controllers.start(own.controller, own_anchors.len(), library, seed);
        *last_heard = start.agent();
        *phase = Phase::Between;
        *range_biases_m = [[ranging.bias_mean_m, ranging.bias_std_m]; ANCHORS];
        self.seals = Seals::of_told(self.seal_told());
        Ok(())
    }

    /// Tells the range bias of one anchor, before the first cycle: its mean (-10 to 10 m) and standard deviation (0 to 10 m; 0 where it
    /// is known exactly). Without, it is that of the configuration ([`Ranging::bias_mean_m`](crate::model::measurement::Ranging)).
    ///
    /// # Errors
    /// There is no such anchor, or a value is out of range; [`Error::AlreadyBegun`] once there was a cycle; [`Error::NotStarted`],
    /// [`Error::ToldChanged`]. Nothing has changed then.
    pub fn tell_range_bias(&mut self, anchor: usize, mean_m: f32, std_m: f32) -> Result<(), Error> {
        match self.phase {
            Phase::Empty => return Err(Error::NotStarted),
            Phase::Between if self.cycle == 0 => self.check_told()?,
            Phase::Between | Phase::Begun => return Err(Error::AlreadyBegun),
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
    /// antennas tell.
    ///
    /// # Errors
    /// [`Error::LeverArm`] where it is out of range, or no heading is estimated; [`Error::AlreadyBegun`]. Nothing has changed then.
    pub fn switch_antenna(&mut self, lever_arm_m: [f32; 2]) -> Result<(), Error> {
        if self.phase == Phase::Begun {
            return Err(Error::AlreadyBegun);
        }
        let is_centre = lever_arm_m == [0.0; 2];
        if !is_lever_arm(lever_arm_m) || !(is_centre || self.filter().heading().is_some()) {
            return Err(Error::LeverArm);
        }
        // A bit that has flipped beside it keeps the seal by which it is found.
        let is_intact = self.is_as_sealed(Part::Cycle);
        self.lever_arm_m = lever_arm_m;
        if is_intact {
            self.seals = self.seals.renewed(Part::Cycle, self.seal_of(Part::Cycle));
        }
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
    /// Bad input, [`Error::AlreadyBegun`] or [`Error::NotStarted`]; nothing has changed then.
    pub fn begin(&mut self, elapsed_s: f32, tag_height: Option<TagHeight>) -> Result<(), Error> {
        let begun = self.check_begin(elapsed_s, tag_height)?;
        self.check_told()?;
        self.begun = Begun { integrity: self.check_seals(), ..begun };
        self.phase = Phase::Begun;
        self.receiver.advance(elapsed_s);
        self.scans.clear();
        Ok(())
    }

    /// Takes one observation of the cycle begun: one frame and one scan of ranges of each anchor, in any order. What is
    /// made of them has the bits of [`Self::cycle`] with all of them.
    ///
    /// # Errors
    /// Bad input, [`Error::NotBegun`] or [`Error::NotStarted`]; nothing has changed then.
    pub fn receive(&mut self, observation: &Observation<'_>) -> Result<(), Error> {
        self.receive_observed(observation, &mut ())
    }

    /// [`Self::receive`], watched by an observer.
    ///
    /// # Errors
    /// Bad input, [`Error::NotBegun`] or [`Error::NotStarted`]; nothing has changed then.
    pub fn receive_observed(
        &mut self,
        observation: &Observation<'_>,
        observer: &mut impl Observer<SOURCES, PATHS>,
    ) -> Result<(), Error> {
        self.check_begun()?;
        let delivered = &mut self.begun.delivered;
        self.receiver.check(observation, self.anchors.len(), &self.library, delivered)?;
        let link = self.link(observation);
        self.receiver.receive(&mut self.scans, observation, &link, &self.library, |estimate| {
            observer.estimate(observation.anchor(), estimate);
        });
        Ok(())
    }

    /// Whether the tracker was started, and still has what it was told.
    pub(super) fn check_ready(&self) -> Result<(), Error> {
        match self.phase {
            Phase::Empty => Err(Error::NotStarted),
            Phase::Between | Phase::Begun => self.check_told(),
        }
    }

    /// Whether a cycle is begun.
    pub(super) fn check_begun(&self) -> Result<(), Error> {
        match self.phase {
            Phase::Empty => Err(Error::NotStarted),
            Phase::Between => Err(Error::NotBegun),
            Phase::Begun => Ok(()),
        }
    }

    /// Whether a cycle can begin, and how it would.
    fn check_begin(&self, elapsed_s: f32, tag_height: Option<TagHeight>) -> Result<Begun<ANCHORS>, Error> {
        match self.phase {
            Phase::Empty => return Err(Error::NotStarted),
            Phase::Begun => return Err(Error::AlreadyBegun),
            Phase::Between => {}
        }
        if !(elapsed_s > 0.0 && elapsed_s <= 3600.0) {
            return Err(Error::Time { elapsed_s });
        }
        if !tag_height.is_none_or(|height| height.is_in_range()) {
            return Err(Error::TagHeight);
        }
        Ok(Begun { elapsed_s, tag_height, delivered: Delivered::NONE, integrity: Integrity::NONE })
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
            most_work: self.config.work.frame(),
        }
    }
}
