//! Bits that flip in memory: what was told is refused then, state is mended.
//!
//! At the end of a cycle every part of the state is swept (numbers finite, variances positive, probabilities within 0 to 1, indices of
//! something there is, lists within their memory) and sealed; a part that is broken is reset to what it is after the start. Before the
//! next cycle the seals are compared. The leading component of the belief, receiver and environment are swept and sealed in every
//! cycle; each other component, the other memories, controllers and the estimator's tables have their turn in one of eight. A part whose seal is another is reported; where it is broken as well, it is reset before anything is
//! made of it. The belief has a seal for each component, and what flipped is replaced whenever another piece has the same.
//!
//! What was told (configuration, anchors, plan, actions) never changes and has a seal of its own: with that broken, no cycle is begun.
//! What flips during a cycle is sealed with the rest at its end; the sweep alone finds it. Booleans and variants of enumerations have
//! values that no program of safe Rust can look at before it trusts them.

use super::Tracker;
use super::entries::is_lever_arm;
use super::start::told_filter;
use crate::error::Error;
use crate::memory::environment::{Origin, TOLD};
use crate::memory::lateness::LatenessMemory;
use crate::memory::transmission::TransmissionMemory;
use crate::perceptor::belief::integrity::{BeliefSeals, BrokenBelief};
use crate::perceptor::state_filter::StateFilter;
use crate::report::{Integrity, Part};
use crate::snapshot::{Sealed, Told, Written, seal, seal_with};

/// Capacity: parts with one seal each: all but the belief.
const PARTS: usize = Part::ALL.len() - 1;
/// Capacity: cycles in which it is the turn once of each part that is not sealed in every cycle, so that the seals take less than a fiftieth of a cycle.
const TURN: u32 = 8;

/// A planted failure: nothing is looked at, so that it can be seen that the campaign of flips (`tests/tests/integrity.rs`) finds what
/// becomes of them then. No feature, which a dependency could switch on.
const UNSWEPT: bool = cfg!(cogmint_unswept);

/// The seals of all state.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seals<const COMPONENTS: usize> {
    /// Of what was told.
    told: u32,
    /// Whether the rest was sealed since the state was last changed from outside.
    is_made: bool,
    belief: BeliefSeals<COMPONENTS>,
    /// In the order of [`Part`]; of those whose turn it was.
    parts: [Option<Sealed>; PARTS],
}

impl<const COMPONENTS: usize> Seals<COMPONENTS> {
    /// None is made yet.
    pub(super) const NONE: Self =
        Self { told: 0, is_made: false, belief: BeliefSeals::NONE, parts: [None; PARTS] };

    /// State was changed from outside: it is swept before the next cycle, not compared.
    pub(super) fn opened(self) -> Self {
        Self { is_made: false, ..self }
    }

    /// Of a part other than the belief, whose turn it was.
    fn of(&self, part: Part) -> Option<Sealed> {
        Part::ALL.into_iter().skip(1).zip(self.parts).find(|(own, _)| *own == part)?.1
    }

    /// A part other than the belief was changed from outside, and was as sealed before.
    pub(super) fn renewed(self, part: Part, sealed: Sealed) -> Self {
        let mut parts = self.parts;
        let places = Part::ALL.into_iter().skip(1).zip(&mut parts);
        places.filter(|(own, _)| *own == part).for_each(|(_, place)| *place = Some(sealed));
        Self { parts, ..self }
    }

    /// What was told was changed: this is its seal.
    pub(super) fn of_told(told: u32) -> Self {
        Self { told, ..Self::NONE }
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
    /// Seal of all that was told.
    #[inline(never)]
    pub(super) fn seal_told(&self) -> u32 {
        let Self { receiver, belief, discovery, clutter, channel, controllers, .. } = self;
        seal_with(|to| {
            self.write_told(to);
            receiver.write_told(to);
            belief.write_told(to);
            discovery.write_told(to);
            clutter.write_told(to);
            channel.write_told(to);
            controllers.write_told(to);
        })
        .sum
    }

    /// Whether what was told is what it was.
    pub(super) fn check_told(&self) -> Result<(), Error> {
        if UNSWEPT || self.seals.told == self.seal_told() { Ok(()) } else { Err(Error::ToldChanged) }
    }

    /// Seals a part other than the belief.
    #[inline(never)]
    pub(super) fn seal_of(&self, part: Part) -> Sealed {
        match part {
            Part::Belief => Sealed::NOTHING,
            Part::Estimator => self.receiver.seal_estimator(),
            Part::Receiver => self.receiver.seal(),
            Part::Environment => seal(&self.environment),
            Part::Transmission => seal(&self.transmission),
            Part::Discovery => seal(&self.discovery),
            Part::Clutter => seal(&self.clutter),
            Part::Lateness => seal(&self.lateness),
            Part::Channel => seal(&self.channel),
            Part::Controllers => seal(&self.controllers),
            Part::Cycle => seal_with(|to| {
                self.cycle.write(to);
                self.last_heard.write(to);
                self.lever_arm_m.write(to);
            }),
        }
    }

    /// Whether a part other than the belief is as it was sealed.
    pub(super) fn is_as_sealed(&self, part: Part) -> bool {
        self.seals.of(part).is_some_and(|last| last == self.seal_of(part))
    }

    /// Whether a part is sealed at the end of this cycle.
    fn is_due(&self, part: Part) -> bool {
        let turn = self.cycle % TURN;
        match part {
            Part::Belief | Part::Receiver | Part::Environment | Part::Cycle => true,
            Part::Transmission => turn == 0,
            Part::Estimator => turn == 1,
            Part::Clutter => turn == 2,
            Part::Discovery => turn == 3,
            Part::Lateness => turn == 4,
            Part::Controllers => turn == 5,
            Part::Channel => turn == 6,
        }
    }

    /// Whether a part whose numbers are finite is what it may be.
    fn is_sound(&self, part: Part) -> bool {
        match part {
            Part::Belief | Part::Estimator => true,
            Part::Cycle => is_lever_arm(self.lever_arm_m),
            Part::Receiver => self.receiver.is_sound(),
            Part::Environment => {
                let leader = self.belief.leader();
                self.environment.is_sound(self.anchors.len(), |slot| leader.surface(slot).is_some())
            }
            Part::Transmission => self.transmission.is_sound(),
            Part::Discovery => self.discovery.is_sound(),
            Part::Clutter => self.clutter.is_sound(),
            Part::Lateness => self.lateness.is_sound(),
            Part::Channel => self.channel.is_sound(),
            Part::Controllers => self.controllers.is_sound(),
        }
    }

    /// Whether a state is what it may be.
    fn is_filter_sound(&self, filter: &StateFilter<ANCHORS, SURFACES>) -> bool {
        filter.is_sound(&self.config.motion, self.config.ranging.max_range_m, &self.range_biases_m)
    }

    /// Compares the seals with the last ones, and mends what is broken. To be called before a cycle.
    #[inline(never)]
    pub(super) fn check_seals(&mut self) -> Integrity {
        if UNSWEPT {
            return Integrity::NONE;
        }
        if !self.seals.is_made {
            return self.sweep();
        }
        let mut integrity = Integrity::NONE;
        let last = &self.seals.belief;
        let broken = BrokenBelief::flipped(&self.belief.seals(&last.sealed()), last);
        if broken.is_any() {
            integrity.flipped.add(Part::Belief);
        }
        for (part, last) in Part::ALL.into_iter().skip(1).zip(self.seals.parts) {
            let Some(last) = last else { continue };
            let own = self.seal_of(part);
            if own == last {
                continue;
            }
            integrity.flipped.add(part);
            // The estimator can be made anew with no loss.
            if part == Part::Estimator || !own.is_whole() || !self.is_sound(part) {
                integrity.reset.add(part);
            }
        }
        // Entries outside of memory are not for a later cycle to find.
        if !self.discovery.fits() {
            integrity.flipped.add(Part::Discovery);
            integrity.reset.add(Part::Discovery);
        }
        if !integrity.is_intact() {
            self.mend(&broken, &mut integrity);
        }
        integrity
    }

    /// Sweeps the state, mends what is broken, and seals it. To be called at the end of a cycle.
    #[inline(never)]
    pub(super) fn sweep(&mut self) -> Integrity {
        let mut integrity = Integrity::NONE;
        if UNSWEPT {
            return integrity;
        }
        let is_first = !self.seals.is_made;
        self.seals.is_made = true;
        let turn = (self.cycle % TURN) as usize;
        let is_component_due = |component: usize| is_first || component % TURN as usize == turn;
        self.seals.belief = self.belief.seals(&core::array::from_fn(is_component_due));
        let broken = self.belief.broken(&self.seals.belief, |filter| self.is_filter_sound(filter));
        let mut parts = [None; PARTS];
        for (part, place) in Part::ALL.into_iter().skip(1).zip(&mut parts) {
            if !is_first && !self.is_due(part) {
                continue;
            }
            let own = self.seal_of(part);
            *place = Some(own);
            if !own.is_whole() || !self.is_sound(part) {
                integrity.reset.add(part);
            }
        }
        self.seals.parts = parts;
        if broken.is_any() || !integrity.is_intact() {
            self.mend(&broken, &mut integrity);
            self.seals.belief = self.belief.seals(&[true; COMPONENTS]);
            for (part, place) in Part::ALL.into_iter().skip(1).zip(&mut parts) {
                *place = Some(self.seal_of(part));
            }
            self.seals.parts = parts;
        }
        integrity
    }

    /// Resets what is broken to what it is after the start.
    #[cold]
    #[inline(never)]
    fn mend(&mut self, broken: &BrokenBelief<COMPONENTS>, integrity: &mut Integrity) {
        let Self {
            range_biases_m,
            config,
            anchors,
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
            last_heard,
            lever_arm_m,
            ..
        } = self;
        let reset = &mut integrity.reset;
        if broken.is_any() {
            belief.mend(broken, || told_filter(config, range_biases_m, plan));
            reset.add(Part::Belief);
        }
        let Some(first) = library.get(config.controller.first_action) else { return };
        let pulse = config.radio.pulse(first);
        if reset.has(Part::Estimator) {
            receiver.rebuild(pulse);
        }
        if reset.has(Part::Receiver) {
            let keeps = config.belief.reads_below_threshold;
            receiver.start(config.radio, config.estimator, config.ranging, pulse, keeps);
        }
        if reset.has(Part::Environment) || reset.has(Part::Belief) {
            environment.mend(anchors.len(), |slot| belief.leader().surface(slot).is_some());
            for slot in 0..SURFACES {
                if belief.leader().surface(slot).is_none() || environment.surface(slot).is_some() {
                    continue;
                }
                let is_heading = config.has_heading && slot + 1 == SURFACES;
                if is_heading || plan.wall_of(slot).is_some() {
                    environment.insert_surface(slot, TOLD, Origin::Plan);
                } else {
                    belief.remove(slot);
                }
            }
            for slot in (0..SOURCES).filter(|slot| environment.get(*slot).is_none()) {
                channel.forget(slot);
            }
        }
        if reset.has(Part::Transmission) {
            *transmission = TransmissionMemory::empty();
        }
        if reset.has(Part::Discovery) {
            discovery.clear();
        }
        if reset.has(Part::Clutter) {
            clutter.start(config.association, &config.ranging);
        }
        if reset.has(Part::Lateness) {
            *lateness = LatenessMemory::new(config.ranging.late_m);
        }
        if reset.has(Part::Channel) {
            let settings = &config.controller;
            channel.start(config.channel, settings.prior_sinr, settings.neighbours, library);
        }
        if reset.has(Part::Controllers) {
            controllers.reset();
        }
        if reset.has(Part::Cycle) {
            *last_heard = belief.leader().agent();
            if !is_lever_arm(*lever_arm_m) {
                *lever_arm_m = [0.0; 2];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;
    use crate::model::anchor::Anchor;
    use crate::model::observation::{Observation, Range, RangeScan};
    use crate::model::plan::Map;
    use crate::radio::library::LIBRARY_DW1000;
    use std::boxed::Box;

    type Small = Tracker<3, 2, 1, 1, 2, 6, 4, 0, 0>;
    const ARMS_M: [[f32; 2]; 2] = [[0.2, 0.1], [-0.2, 0.0]];

    /// One cycle of ranges to a tag at (4, 3) m that faces along x.
    fn cycle(tracker: &mut Small, arm_m: [f32; 2]) -> Integrity {
        let scans = [[0.0, 0.0], [10.0, 0.0], [5.0, 8.0]].map(|[x, y]: [f32; 2]| {
            let range_m = (x - 4.0 - arm_m[0]).hypot(y - 3.0 - arm_m[1]);
            [Range { range_m, variance_m2: 4e-4 }]
        });
        tracker.begin(0.1, None).unwrap();
        for (anchor, ranges) in scans.iter().enumerate() {
            tracker.receive(&Observation::Ranges(RangeScan { anchor, ranges })).unwrap();
        }
        tracker.finish().unwrap().integrity
    }

    /// A tracker whose antennas took turns for 20 cycles, of which nothing was reported; the second is in use.
    fn turned() -> Box<Small> {
        let anchors =
            [[0.0, 0.0], [10.0, 0.0], [5.0, 8.0]].map(|position_m| Anchor { position_m, height_m: 0.0 });
        let mut tracker = Box::new(Small::new());
        let config = Config { has_heading: true, ..Config::default() };
        tracker.start(&config, &anchors, &Map::default(), &LIBRARY_DW1000, 1).unwrap();
        for turn in 0..20 {
            let arm_m = ARMS_M[turn % 2];
            tracker.switch_antenna(arm_m).unwrap();
            assert!(cycle(&mut tracker, arm_m).is_intact(), "turn {turn}");
        }
        tracker
    }

    #[test]
    fn every_bit_that_flips_in_the_lever_arm_is_reported_and_a_broken_arm_is_the_centre() {
        let sound = turned();
        for (axis, bit) in (0..2).flat_map(|axis| (0..32).map(move |bit| (axis, bit))) {
            let mut tracker = sound.clone();
            let arm_m = &mut tracker.lever_arm_m[axis];
            *arm_m = f32::from_bits(arm_m.to_bits() ^ 1 << bit);
            let is_broken = !is_lever_arm(tracker.lever_arm_m);
            let integrity = cycle(&mut tracker, ARMS_M[1]);
            assert!(integrity.flipped.has(Part::Cycle), "axis {axis}, bit {bit}");
            assert_eq!(integrity.reset.has(Part::Cycle), is_broken, "axis {axis}, bit {bit}");
            assert!(!is_broken || tracker.lever_arm_m == [0.0; 2]);
        }
        let mut tracker = sound.clone();
        tracker.lever_arm_m = [f32::NAN, 0.0];
        assert!(cycle(&mut tracker, ARMS_M[1]).reset.has(Part::Cycle) && tracker.lever_arm_m == [0.0; 2]);
    }

    #[test]
    fn a_bit_that_flips_beside_the_lever_arm_is_reported_though_antennas_are_switched() {
        let mut tracker = turned();
        tracker.last_heard.mean.x = f32::from_bits(tracker.last_heard.mean.x.to_bits() ^ 1);
        tracker.switch_antenna(ARMS_M[0]).unwrap();
        assert!(cycle(&mut tracker, ARMS_M[0]).flipped.has(Part::Cycle));
        assert!(cycle(&mut tracker, ARMS_M[0]).is_intact());
    }
}
