//! What a tracker is told between cycles, and what can be read of its state.

use super::integrity::Seals;
use super::values::{Known, Place, Told, planning_state, walls_now};
use super::{Begun, Phase, Tracker};
use crate::application::waypoint::{WaypointChoice, WaypointError, WaypointSettings, choose_waypoint};
use crate::config::Config;
use crate::controller::Controller;
use crate::error::Error;
use crate::memory::channel::ChannelMemory;
use crate::memory::discovery::Discovery;
use crate::memory::environment::{EnvironmentMemory, Placed};
use crate::memory::lateness::LatenessMemory;
use crate::memory::transmission::TransmissionMemory;
use crate::model::anchor::Anchor;
use crate::model::measurement::Measurement;
use crate::model::observation::TagHeight;
use crate::model::plan::FloorPlan;
use crate::model::source::Source;
use crate::model::surface::Surface;
use crate::perceptor::belief::TagBelief;
use crate::perceptor::below_threshold::strength::Background;
use crate::perceptor::expectation::Sighting;
use crate::perceptor::gain_control::GainControl;
use crate::perceptor::state_filter::StateFilter;
use crate::radio::library::Library;
use crate::real::{larger, sqrt};
use crate::report::WallEstimate;
use crate::trace::TraceHash;

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
    /// Narrows what may be chosen for `anchor` to these actions of the library: what its radio can do, or may. Where all
    /// anchors share one choice, it is narrowed for all. To be called before the first cycle: an action that is no longer
    /// allowed gives way at once, which the other end of the link is not told.
    ///
    /// # Errors
    /// There is no such anchor or action, or nothing that was allowed is left, or not the rendezvous; [`Error::ToldChanged`]. Nothing has
    /// changed then.
    pub fn restrict(&mut self, anchor: usize, actions: &[usize]) -> Result<(), Error> {
        if self.phase != Phase::Empty {
            self.check_told()?;
        }
        self.controllers.restrict(anchor, actions, &self.library)?;
        self.seals = Seals::of_told(self.seal_told());
        Ok(())
    }

    /// The controller that chooses for an anchor: its own, or the one for all; `None` for an anchor there is not.
    pub fn controller_of(&self, anchor: usize) -> Option<&Controller<ACTIONS>> {
        self.controllers.of(anchor)
    }

    /// Chooses one of `candidates` (positions, metres) on the way to `goal`, by all that the tracker knows after its
    /// last cycle and with the carrier of the next one. Plans with the mean of the tag's height. Changes nothing.
    ///
    /// # Errors
    /// The first bad input, or [`WaypointError::Searching`] while it is not known where the tag is.
    pub fn choose_waypoint(
        &self,
        candidates: &[[f32; 2]],
        goal: Option<[f32; 2]>,
        tag_height: Option<TagHeight>,
        settings: &WaypointSettings,
    ) -> Result<WaypointChoice, WaypointError> {
        if self.belief.is_searching() {
            return Err(WaypointError::Searching);
        }
        if !tag_height.is_none_or(|height| height.is_in_range()) {
            return Err(WaypointError::TagHeight);
        }
        let state = planning_state(&self.config, &self.filter().agent(), self.threshold(), settings.period_s);
        let Self { config, anchors, plan, library, environment, channel, .. } = self;
        let filter = self.filter();
        let told = Told { config, anchors, library, tag_height, lever_arm_m: self.lever_arm_m };
        let hide = config.belief.walls_hide_paths;
        let walls = &walls_now(plan, filter, environment, hide, |wall| self.transmission.through(wall));
        let known = Known { filter, environment, channel, plan, walls };
        let std_m = Place::of(&filter.agent()).std_m;
        let sources = |position_m: [f32; 2]| {
            known.visible(&told, Place { position_m, std_m }).filter_map(|sight| {
                let controller = self.controller_of(sight.source.anchor())?;
                Some((sight, controller.action_index()))
            })
        };
        choose_waypoint(candidates, goal, settings, &state, sources, channel, library)
    }

    /// What is known of every anchor's frames where the receiver controls its gain.
    pub fn gain_control(&self) -> &[GainControl; ANCHORS] {
        self.receiver.gain_control()
    }

    /// The state filter: that of the leading component.
    pub fn filter(&self) -> &StateFilter<ANCHORS, SURFACES> {
        self.belief.leader()
    }

    /// The environment memory.
    pub fn environment(&self) -> &EnvironmentMemory<SURFACES, SOURCES> {
        &self.environment
    }

    /// Where the image of the source in `slot` is expected, metres, and the covariance of that, square metres; `None` for a
    /// free slot.
    pub fn image(&self, slot: usize) -> Option<Placed> {
        let record = self.environment.get(slot)?;
        self.filter().placed(self.anchors.get(record.anchor)?.position_m, &record.sequence)
    }

    /// The wall in a slot of the state filter; `None` where there is none, or a private surface of one image.
    pub fn wall(&self, slot: usize) -> Option<WallEstimate> {
        let (Surface::Wall(line), state, c) = self.filter().surface(slot)? else { return None };
        let record = self.environment.surface(slot)?;
        Some(WallEstimate {
            line: line.moved(state.x, state.y),
            offset_std_m: sqrt(larger(c.m11, 0.0)),
            rotation_std_rad: sqrt(larger(c.m22, 0.0)),
            existence: record.existence,
            is_told: record.is_told,
        })
    }

    /// Probability that the plan lets the path of a source through to a place (metres) that is known as well as the tag's is;
    /// 1 without a plan, 0 for a source that there is not.
    pub fn availability(&self, source: Source, place_m: [f32; 2]) -> f32 {
        let Self { config, anchors, plan, environment, channel, .. } = self;
        let (filter, hide) = (self.filter(), config.belief.walls_hide_paths);
        let walls = &walls_now(plan, filter, environment, hide, |wall| self.transmission.through(wall));
        let known = Known { filter, environment, channel, plan, walls };
        let Some(anchor) = anchors.get(source.anchor()) else { return 0.0 };
        let paths = walls.paths(anchor.position_m, place_m, Place::of(&filter.agent()).std_m);
        match source {
            Source::Direct { .. } => paths.direct(),
            Source::Virtual { slot, .. } => {
                environment.get(slot).map_or(0.0, |record| known.available(&paths, &record.sequence).0)
            }
        }
    }

    /// The floor plan told.
    pub fn plan(&self) -> &FloorPlan<SEGMENTS> {
        &self.plan
    }

    /// What the walls of the plan let through.
    pub fn transmission(&self) -> &TransmissionMemory<SEGMENTS> {
        &self.transmission
    }

    /// The channel memory.
    pub fn channel(&self) -> &ChannelMemory<ANCHORS, SOURCES, ACTIONS> {
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
        self.seals = self.seals.opened();
        Ok(())
    }

    /// The candidates for virtual anchors.
    pub fn discovery(&self) -> &Discovery<ANCHORS, CANDIDATES> {
        &self.discovery
    }

    /// Where the tag may be.
    pub fn belief(&self) -> &TagBelief<ANCHORS, SURFACES, COMPONENTS> {
        &self.belief
    }

    /// What is left of every anchor's frames where no source is expected.
    pub fn backgrounds(&self) -> &[Background; ANCHORS] {
        self.clutter.backgrounds()
    }

    /// Mean number of measurements per scan of each anchor that nothing known explains.
    pub fn unexplained(&self) -> &[f32; ANCHORS] {
        self.clutter.unexplained()
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

    /// How late ranges are, by anchor.
    pub fn lateness(&self) -> &LatenessMemory<ANCHORS> {
        &self.lateness
    }

    /// Threshold on the normalised energy of a path, of the pulse last used.
    pub fn threshold(&self) -> f32 {
        self.receiver.threshold()
    }

    /// 64-bit hash over all state, that of a cycle begun included: equal hashes after the same inputs mean equal bits.
    pub fn hash(&self) -> u64 {
        let mut hash = TraceHash::default();
        hash.word(self.cycle);
        self.controllers.links().lost().iter().for_each(|lost| hash.word(*lost));
        hash.word(u32::from(self.channel.is_full_band()));
        for controller in self.controllers.all() {
            controller.words().into_iter().for_each(|word| hash.word(word));
        }
        self.receiver.gain_control().iter().for_each(|control| control.visit(|v| hash.float(v)));
        for (slot, record) in self.environment.iter() {
            hash.word(slot as u32);
            hash.word(record.anchor as u32);
            hash.word(u32::from(record.sequence.first));
            hash.word(record.sequence.second.map_or(u32::MAX, u32::from));
            hash.word(u32::from(record.sighting == Sighting::Hidden));
            hash.word(record.hits);
        }
        for slot in 0..SURFACES {
            hash.float(self.environment.surface(slot).map_or(-1.0, |record| record.existence));
        }
        hash.word(self.environment.turn());
        self.transmission.visit(self.plan.walls().len(), |v| hash.float(v));
        self.channel.visit(|v| hash.float(v));
        self.discovery.visit(|v| hash.float(v));
        self.belief.visit(|v| hash.float(v));
        for controller in self.controllers.all() {
            let (values, policy) = (controller.values().values(), controller.policy());
            values.iter().chain(policy).for_each(|v| hash.float(*v));
            hash.float(controller.planned_reward().unwrap_or(0.0));
            hash.float(controller.turn_s());
        }
        self.clutter.unexplained().iter().for_each(|v| hash.float(*v));
        for background in self.clutter.backgrounds() {
            hash.float(background.noise);
            background.paths.iter().for_each(|v| hash.float(*v));
        }
        self.lateness.visit(|v| hash.float(v));
        self.lever_arm_m.iter().for_each(|v| hash.float(*v));
        self.receiver.silent_s().iter().flatten().for_each(|v| hash.float(*v));
        hash.float(self.receiver.threshold());
        self.last_heard.mean.iter().for_each(|v| hash.float(*v));
        self.last_heard.covariance.iter().for_each(|v| hash.float(*v));
        for last in *self.receiver.last_sequence() {
            hash.word(u32::from(last.is_some()));
            hash.word(last.unwrap_or(0));
        }
        if self.phase == Phase::Begun {
            self.hash_begun(&self.begun, &mut hash);
        }
        hash.value()
    }

    /// Adds the cycle begun, and what was received in it.
    fn hash_begun(&self, begun: &Begun<ANCHORS>, hash: &mut TraceHash) {
        hash.float(begun.elapsed_s);
        hash.word(u32::from(begun.tag_height.is_some()));
        let TagHeight { mean_m, std_m } = begun.tag_height.unwrap_or(TagHeight::exact(0.0));
        hash.float(mean_m);
        hash.float(std_m);
        for scan in &self.scans {
            hash.word(scan.anchor as u32);
            hash.word(scan.action as u32);
            hash.word(u32::from(scan.is_framed()));
            hash.word(scan.left_out);
            hash.word(u32::from(scan.cut_short));
            hash.word(scan.measurements.len() as u32);
            for measurement in &scan.measurements {
                let Measurement { range_m, variance_m2, sinr, energy, false_alarm } = *measurement;
                [range_m, variance_m2, sinr, energy, false_alarm].into_iter().for_each(|v| hash.float(v));
            }
            let energies = self.receiver.residual(scan).map_or(&[][..], |residual| residual.energies());
            energies.iter().for_each(|energy| hash.word(u32::from(*energy)));
        }
    }
}
