//! Environment memory: which surfaces exist, and what is seen in them.
//!
//! The state filter holds where surfaces are; this memory holds that they are. Existence belongs to the surface: a wall that
//! is not there makes none of its images. It follows the Bernoulli recursion of a two-state chain with time and, by each of
//! the surface's own images (one reflection), the ratio in which association raised or lowered the odds that the image
//! exists. An image of two surfaces exists where both do. Missing a source that is hidden (its SINR says so) disproves
//! nothing; one that was never seen lowers existence slowly. Of a wall that a plan tells of it is known where its
//! images are seen from, and so that they must come out again; how long an image that was found stays out of sight nobody
//! knows: only the moment in which it went tells of it. A private surface is forgotten below 1e-3; a wall that a plan tells of
//! becomes doubtful and stays.

use crate::model::clock::probability;
use crate::model::image::Sequence;
use crate::model::source::Source;
use crate::perceptor::association::outcome::AssociatedScan;
use crate::perceptor::expectation::Sighting;
use crate::real::{is_probability, smaller};
use crate::snapshot::{Blank, Reader, Sink, SnapshotError, Stored, Written, stored};
use heapless::Vec;
use nalgebra::{Matrix2, Vector2};

/// Mathematics: more probable than not: existence above which a source counts for planning and in reports.
pub const CONFIRMED: f32 = 0.5;
/// Guard: against a full map: existence below which a surface is forgotten.
pub const FORGOTTEN: f32 = 1e-3;
/// Tuned: against a plan erased by silence: what hides a source that was never seen does so for a while, in which
/// looking again tells nothing new: so many independent looks in a second.
pub const LOOKS_PER_S: f32 = 0.5;
/// Guard: against certainty, which no miss would change: a wall can be taken down.
pub const MOST_CERTAIN: f32 = 0.999;

/// Tuned: against two entries for one wall: images of one anchor that are nearer than this may be one, metres.
pub const NEAR_M: f32 = 0.3;

/// Tuned: prior probability that a surface exists of which a plan tells, or discovery: nine of ten.
pub const TOLD: f32 = 0.9;

/// Position of an image (metres) and its covariance (square metres).
pub type Placed = (Vector2<f32>, Matrix2<f32>);

/// What has become of a discovery.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Admission {
    /// It lies within 0.3 m of the anchor, or of one of its images that is confirmed or shares its surface.
    Known,
    /// There is no room.
    Full,
    /// It is in the map.
    Entered {
        /// The slot of the source.
        slot: usize,
        /// The slot of its private surface.
        surface: usize,
        /// What gave way.
        replaced: Option<Removed>,
    },
}

/// A source taken out of the map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Removed {
    /// Its slot.
    pub slot: usize,
    /// The slots of the surfaces that nothing is seen in any more.
    pub surfaces: [Option<usize>; 2],
}

/// A source: an image of an anchor.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Record {
    /// Index of the physical anchor whose image it is.
    pub anchor: usize,
    /// The surfaces that it is seen in.
    pub sequence: Sequence,
    /// Whether its path could be seen in the last scan.
    pub sighting: Sighting,
    /// Scans with a path.
    pub hits: u32,
}

/// What is known of a surface but where it is.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SurfaceRecord {
    /// Probability that it exists.
    pub existence: f32,
    /// Whether a plan tells of it: it is then never forgotten.
    pub is_told: bool,
    /// Whether it was discovered, and may be joined with others. A virtual anchor that was told by its position stays what was
    /// told: a random variable of its own.
    pub may_join: bool,
}

/// Where a surface is known from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Origin {
    /// A plan tells of it.
    Plan,
    /// A virtual anchor was told by its position.
    Position,
    /// It was discovered.
    Discovered,
}

/// `N` places, free or taken; none before the start. A list, because one without entries is all zeros, which an array of free places
/// is not: a static tracker of zeros takes no flash.
#[derive(Clone, Debug)]
struct Slots<T, const N: usize>(Vec<Option<T>, N>);

impl<T: Clone, const N: usize> Slots<T, N> {
    const fn empty() -> Self {
        Self(Vec::new())
    }

    /// All places, free.
    fn start(&mut self) {
        self.0.clear();
        while self.0.push(None).is_ok() {}
    }

    /// As many places as there is memory for: free ones where some are missing, all free where there were more.
    fn mend(&mut self) {
        if self.0.len() > N {
            self.0.clear();
        }
        while self.0.push(None).is_ok() {}
    }
}

impl<T, const N: usize> core::ops::Deref for Slots<T, N> {
    type Target = [Option<T>];

    // Where there is no room the compiler knows that there is no entry.
    fn deref(&self) -> &Self::Target {
        if N == 0 { &[] } else { &self.0 }
    }
}

impl<T, const N: usize> core::ops::DerefMut for Slots<T, N> {
    fn deref_mut(&mut self) -> &mut [Option<T>] {
        if N == 0 { &mut [] } else { &mut self.0 }
    }
}

impl<T: Written, const N: usize> Written for Slots<T, N> {
    fn write(&self, to: &mut impl Sink) {
        self.0.write(to);
    }
}

impl<T: Blank, const N: usize> Stored for Slots<T, N> {
    fn read(&mut self, from: &mut Reader<'_>) -> Result<(), SnapshotError> {
        self.0.read(from)
    }
}

/// The sources and their surfaces by slot.
#[derive(Clone, Debug)]
pub struct EnvironmentMemory<const SURFACES: usize, const SOURCES: usize> {
    sources: Slots<Record, SOURCES>,
    surfaces: Slots<SurfaceRecord, SURFACES>,
    /// Whose turn it is to be joined, counted on.
    turn: u32,
}

impl<const SURFACES: usize, const SOURCES: usize> Default for EnvironmentMemory<SURFACES, SOURCES> {
    fn default() -> Self {
        let mut own = Self::empty();
        own.start();
        own
    }
}

impl<const SURFACES: usize, const SOURCES: usize> EnvironmentMemory<SURFACES, SOURCES> {
    /// Without any places: to be started.
    pub const fn empty() -> Self {
        Self { sources: Slots::empty(), surfaces: Slots::empty(), turn: 0 }
    }

    /// All places are free.
    pub fn start(&mut self) {
        self.sources.start();
        self.surfaces.start();
        self.turn = 0;
    }

    /// Without any places again.
    pub fn clear(&mut self) {
        self.sources.0.clear();
        self.surfaces.0.clear();
        self.turn = 0;
    }

    /// The source in `slot`; `None` where the slot is free.
    pub fn get(&self, slot: usize) -> Option<&Record> {
        self.sources.get(slot)?.as_ref()
    }

    /// The surface in `slot`; `None` where the slot is free.
    pub fn surface(&self, slot: usize) -> Option<&SurfaceRecord> {
        self.surfaces.get(slot)?.as_ref()
    }

    /// Slots and records of all sources.
    pub fn iter(&self) -> impl Iterator<Item = (usize, &Record)> + Clone {
        self.sources.iter().enumerate().filter_map(|(slot, record)| Some((slot, record.as_ref()?)))
    }

    /// Probability that the source in `slot` exists: that all its surfaces do. 0 for a free slot.
    pub fn existence(&self, slot: usize) -> f32 {
        self.get(slot).map_or(0.0, |record| self.existence_of(&record.sequence))
    }

    fn existence_of(&self, sequence: &Sequence) -> f32 {
        let of = |slot: usize| self.surface(slot).map_or(0.0, |surface| surface.existence);
        sequence.surfaces().fold(1.0, |product, slot| product * of(slot))
    }

    /// Counts the turns on in which images are compared with the others. Returns the one that it was.
    pub fn next_turn(&mut self) -> u32 {
        let turn = self.turn;
        self.turn = turn.wrapping_add(1);
        turn
    }

    /// The turn that is next.
    pub fn turn(&self) -> u32 {
        self.turn
    }

    /// The first free slot of a source.
    pub fn free_slot(&self) -> Option<usize> {
        self.sources.iter().position(Option::is_none)
    }

    /// Fills a free slot with a surface; does nothing where it is taken or does not exist.
    pub fn insert_surface(&mut self, slot: usize, existence: f32, origin: Origin) {
        if let Some(place @ None) = self.surfaces.get_mut(slot) {
            *place = Some(SurfaceRecord {
                existence: smaller(existence, MOST_CERTAIN),
                is_told: origin == Origin::Plan,
                may_join: origin == Origin::Discovered,
            });
        }
    }

    /// Sets the probability that a surface exists, from a stored map.
    pub(crate) fn set_existence(&mut self, slot: usize, existence: f32) {
        if let Some(Some(surface)) = self.surfaces.get_mut(slot) {
            surface.existence = smaller(existence, MOST_CERTAIN);
        }
    }

    /// Takes out a surface that nothing is seen in.
    pub(crate) fn remove_surface(&mut self, slot: usize) {
        if let Some(surface) = self.surfaces.get_mut(slot) {
            *surface = None;
        }
    }

    /// Takes all sources out, surfaces stay.
    pub(crate) fn take_sources(&mut self) -> Vec<Option<Record>, SOURCES> {
        let taken = self.sources.0.clone();
        self.sources.start();
        taken
    }

    /// Enters a source in the first free slot where it is not there yet; false where there is no room.
    pub(crate) fn enter(&mut self, anchor: usize, sequence: Sequence, hits: u32) -> bool {
        if self.iter().any(|(_, record)| record.anchor == anchor && record.sequence == sequence) {
            return true;
        }
        let Some(slot) = self.free_slot() else { return false };
        self.insert(slot, anchor, sequence, hits);
        true
    }

    /// Fills a free slot with a source seen `hits` times so far; does nothing where it is taken or does not exist.
    pub fn insert(&mut self, slot: usize, anchor: usize, sequence: Sequence, hits: u32) {
        if let Some(place @ None) = self.sources.get_mut(slot) {
            *place = Some(Record { anchor, sequence, sighting: Sighting::Open, hits });
        }
    }

    /// Time passes: what is known of surfaces gets old, but for those whose images are all hidden. A wall that was there may
    /// be gone, and one that was not may be there again: silence makes doubtful and never forgets.
    pub fn predict(&mut self, change_per_s: f32, elapsed_s: f32) {
        // A symmetric two-state chain forgets its state at twice the rate at which it turns.
        let changed = 0.5 * probability(2.0 * change_per_s, elapsed_s);
        let mut is_open = [false; SURFACES];
        for record in self.sources.iter().flatten() {
            if record.sequence.order() == 1
                && record.sighting == Sighting::Open
                && let Some(is_open) = is_open.get_mut(usize::from(record.sequence.first))
            {
                *is_open = true;
            }
        }
        for (surface, is_open) in self.surfaces.iter_mut().zip(is_open) {
            if let Some(surface) = surface
                && is_open
            {
                surface.existence += changed * (1.0 - 2.0 * surface.existence);
            }
        }
    }

    /// Enters the outcome of a scan for every image of its anchor.
    pub fn observe<const PATHS: usize>(&mut self, associated: &AssociatedScan<'_, SOURCES, PATHS>) {
        let look = probability(LOOKS_PER_S, associated.scan.elapsed_s);
        let expected = &associated.expected;
        let features = associated.features().zip(expected.views()).zip(expected.existences());
        for (((regression, belief), view), prior) in features {
            if let Source::Virtual { slot, .. } = regression.source {
                self.remember(
                    slot,
                    [prior, belief.existence],
                    belief.missed < 0.5,
                    view.sighting,
                    [view.lasting, look],
                );
            }
        }
    }

    /// Enters the outcome of a scan: the existence before and after, whether a path was (probably) seen, and whether it could
    /// be; `lasting` is the share of its detection that does not rest on its coming out again, `look` the probability that the
    /// scan tells something new of what is hidden.
    fn remember(
        &mut self,
        slot: usize,
        [prior, posterior]: [f32; 2],
        seen: bool,
        sighting: Sighting,
        [lasting, look]: [f32; 2],
    ) {
        let Some(Some(record)) = self.sources.get_mut(slot) else { return };
        let was_seen = record.hits > 0;
        record.sighting = sighting;
        if seen {
            record.hits = record.hits.saturating_add(1);
        }
        // What is not seen by two reflections may be either's fault.
        if record.sequence.order() != 1 {
            return;
        }
        let Some(Some(surface)) = self.surfaces.get_mut(usize::from(record.sequence.first)) else { return };
        // The odds change by the ratio in which those of the image did.
        let r = surface.existence;
        let with = r * (posterior * (1.0 - prior));
        let without = (1.0 - r) * ((1.0 - posterior) * prior);
        let updated = with / (with + without);
        let drop = r - updated;
        // What was never seen may be hidden for long; what was seen, no plan says for how long it is out of sight.
        let share = match (was_seen, surface.is_told, sighting) {
            (false, _, Sighting::Hidden) => look,
            (true, false, _) => lasting,
            (true, _, Sighting::Hidden) => 0.0,
            _ => 1.0,
        };
        let updated = if drop > 0.0 { r - share * drop } else { updated };
        surface.existence = smaller(updated, MOST_CERTAIN);
    }

    /// Whether a source is an image that was never seen.
    pub fn is_unseen(&self, source: Source) -> bool {
        match source {
            Source::Direct { .. } => false,
            Source::Virtual { slot, .. } => self.get(slot).is_some_and(|record| record.hits == 0),
        }
    }

    /// Slots of the images of an anchor.
    pub fn images_of(&self, anchor: usize) -> impl Iterator<Item = usize> + Clone {
        self.iter().filter(move |(_, record)| record.anchor == anchor).map(|(slot, _)| slot)
    }

    /// When there is no room: takes out the source that tells least, the product of its existence and of its detection
    /// probability (by slot), if that is at most 1/2. With `frees_surface`, one whose surface goes with it.
    pub fn give_way(&mut self, detections: &[f32; SOURCES], frees_surface: bool) -> Option<Removed> {
        let mut least: Option<(usize, f32)> = None;
        for ((slot, record), detection) in self.sources.iter().enumerate().zip(detections) {
            let Some(record) = record else { continue };
            let worth = self.existence_of(&record.sequence) * detection;
            if worth <= CONFIRMED
                && least.is_none_or(|(_, least)| worth < least)
                && (!frees_surface || self.only_surface_of(slot).is_some())
            {
                least = Some((slot, worth));
            }
        }
        let (slot, _) = least?;
        Some(self.remove(slot))
    }

    /// The surface of which no plan tells and in which nothing but the source in `slot` is seen.
    fn only_surface_of(&self, slot: usize) -> Option<usize> {
        let own = self.get(slot)?;
        let is_shared =
            |surface: usize| self.iter().any(|(other, record)| other != slot && record.sequence.has(surface));
        own.sequence.surfaces().find(|&surface| {
            self.surface(surface).is_some_and(|record| !record.is_told) && !is_shared(surface)
        })
    }

    /// The slot of the image of an anchor in a sequence of surfaces.
    pub fn source_of(&self, anchor: usize, sequence: &Sequence) -> Option<usize> {
        let is_it = |record: &Record| record.anchor == anchor && record.sequence.is_same(sequence);
        self.iter().find(|(_, record)| is_it(record)).map(|(slot, _)| slot)
    }

    /// Takes the source in `slot` out, and those of its surfaces in which nothing else is seen and of which no plan tells.
    pub fn remove(&mut self, slot: usize) -> Removed {
        let mut surfaces = [None; 2];
        for gone in &mut surfaces {
            *gone = self.only_surface_of(slot);
            if let Some(surface) = gone.and_then(|surface| self.surfaces.get_mut(surface)) {
                *surface = None;
            }
        }
        if let Some(record) = self.sources.get_mut(slot) {
            *record = None;
        }
        Removed { slot, surfaces }
    }

    /// The image in `slot` that was seen in a private surface is one in `sequence`: those surfaces exist where that one did or
    /// they did before. The private surface is gone; its slot is returned.
    pub fn join(&mut self, slot: usize, sequence: Sequence) -> Option<usize> {
        let record = self.sources.get_mut(slot)?.as_mut()?;
        let private = usize::from(record.sequence.first);
        record.sequence = sequence;
        let seen = self.surfaces.get_mut(private)?.take()?.existence;
        for surface in sequence.surfaces() {
            if let Some(Some(surface)) = self.surfaces.get_mut(surface) {
                let doubt = (1.0 - surface.existence) * (1.0 - seen);
                surface.existence = smaller(1.0 - doubt, MOST_CERTAIN);
            }
        }
        Some(private)
    }

    /// Takes out what is seen in surfaces that have become improbable and that no plan tells of, and the younger of two images
    /// of an anchor that are one; `placed` gives where the one in a slot is.
    pub fn revise(&mut self, placed: impl Fn(&Self, usize) -> Option<Placed>) -> Vec<Removed, SOURCES> {
        let mut removed = Vec::new();
        for slot in 0..SOURCES {
            let is_forgotten = |surface: usize| {
                self.surface(surface).is_some_and(|record| !record.is_told && record.existence < FORGOTTEN)
            };
            if self.get(slot).is_some_and(|record| record.sequence.surfaces().any(is_forgotten)) {
                // One per slot at most: the pushes succeed.
                let _ = removed.push(self.remove(slot));
            }
        }
        for slot in 0..SOURCES {
            if self.is_doubled(slot, &placed) {
                let _ = removed.push(self.remove(slot));
            }
        }
        removed
    }

    /// Whether an older image of the same anchor is where that of a private surface in `slot` is.
    fn is_doubled(&self, slot: usize, placed: impl Fn(&Self, usize) -> Option<Placed>) -> bool {
        let Some(record) = self.get(slot) else { return false };
        if record.hits == 0 || self.only_surface_of(slot).is_none() {
            return false;
        }
        let Some((a, c)) = placed(self, slot) else { return false };
        let is_same = |(other, twin): (usize, &Record)| {
            if twin.anchor != record.anchor || other == slot {
                return None;
            }
            let is_told = self.only_surface_of(other).is_none();
            let is_older = is_told || twin.hits > record.hits || (twin.hits == record.hits && other < slot);
            if !is_older {
                return None;
            }
            let (b, d) = placed(self, other)?;
            let (dx, dy) = (b.x - a.x, b.y - a.y);
            let (xx, yx, yy) = (c.m11 + d.m11, c.m21 + d.m21, c.m22 + d.m22);
            let form = yy * (dx * dx) - 2.0 * (yx * (dx * dy)) + xx * (dy * dy);
            let is_near = dx * dx + dy * dy < NEAR_M * NEAR_M && form < xx * yy - yx * yx;
            is_near.then_some(())
        };
        self.iter().any(|entry| is_same(entry).is_some())
    }

    /// Takes an image of `anchor` (at `anchor_m`, metres) in that was discovered at `position`, with a private surface, in
    /// the place of the source that tells least if there is no other; `detections` are the detection probabilities by slot,
    /// asked for only then.
    pub fn admit(
        &mut self,
        anchor: usize,
        anchor_m: [f32; 2],
        position: Vector2<f32>,
        placed: impl Fn(&Self, usize) -> Option<Placed>,
        detections: impl FnOnce(&Self) -> [f32; SOURCES],
    ) -> Admission {
        let is_near = |x: f32, y: f32| {
            let (dx, dy) = (position.x - x, position.y - y);
            dx * dx + dy * dy < NEAR_M * NEAR_M
        };
        let [x, y] = anchor_m;
        if is_near(x, y) {
            return Admission::Known;
        }
        let mut doubtful = None;
        for (slot, record) in self.iter().filter(|(_, record)| record.anchor == anchor) {
            if placed(self, slot).is_some_and(|(a, _)| is_near(a.x, a.y)) {
                if self.existence_of(&record.sequence) > CONFIRMED || self.only_surface_of(slot).is_none() {
                    return Admission::Known;
                }
                doubtful = doubtful.or(Some(slot));
            }
        }
        // What is found where a doubtful image is takes its place.
        let mut replaced = doubtful.map(|slot| self.remove(slot));
        let mut room = self.room();
        if room.is_none() {
            let detections = detections(self);
            let is_surface_free = self.surfaces.iter().any(Option::is_none);
            replaced = self.give_way(&detections, !is_surface_free);
            room = self.room();
        }
        let Some((slot, surface)) = room else { return Admission::Full };
        self.insert_surface(surface, TOLD, Origin::Discovered);
        self.insert(slot, anchor, Sequence::of(surface as u8), 1);
        Admission::Entered { slot, surface, replaced }
    }

    /// Whether all entries are what they may be, of so many anchors, where the state filter has these surfaces.
    pub(crate) fn is_sound(&self, anchors: usize, has_surface: impl Fn(usize) -> bool) -> bool {
        let agrees =
            |(slot, surface): (usize, &Option<SurfaceRecord>)| surface.is_some() == has_surface(slot);
        self.surfaces.iter().enumerate().all(agrees)
            && self.sources.len() == SOURCES
            && self.surfaces.len() == SURFACES
            && self.surfaces.iter().flatten().all(|surface| is_probability(surface.existence))
            && self.sources.iter().flatten().all(|record| self.is_seen(record, anchors))
    }

    fn is_seen(&self, record: &Record, anchors: usize) -> bool {
        record.anchor < anchors && record.sequence.surfaces().all(|slot| self.surface(slot).is_some())
    }

    /// Takes out what is not sound: sources of no anchor or no surface, surfaces that the state filter has not, with the last
    /// source those that it was seen in; a surface whose existence is no probability exists as one that was told.
    pub(crate) fn mend(&mut self, anchors: usize, has_surface: impl Fn(usize) -> bool) {
        self.sources.mend();
        self.surfaces.mend();
        for (slot, place) in self.surfaces.iter_mut().enumerate() {
            if !has_surface(slot) {
                *place = None;
            }
            if let Some(surface) = place
                && !is_probability(surface.existence)
            {
                surface.existence = TOLD;
            }
        }
        for slot in 0..SOURCES {
            if !self.get(slot).is_none_or(|record| self.is_seen(record, anchors)) {
                self.remove(slot);
            }
        }
    }

    /// The first free slots of sources and surfaces.
    fn room(&self) -> Option<(usize, usize)> {
        Some((self.free_slot()?, self.surfaces.iter().position(Option::is_none)?))
    }
}

stored!(blank Record { anchor, sequence, sighting, hits });
stored!(blank SurfaceRecord { existence, is_told, may_join });
stored!(EnvironmentMemory<const SURFACES, const SOURCES> { sources, surfaces, turn } told {});

#[cfg(test)]
mod tests {
    use super::*;

    /// Existence after `scans` scans without a path that is there with probability `detection`.
    fn after_misses(origin: Origin, hits: u32, detection: f32, sighting: Sighting, scans: usize) -> f32 {
        let mut memory = EnvironmentMemory::<1, 1>::default();
        let lasting = if sighting == Sighting::Open { 1.0 } else { 0.0 };
        memory.insert_surface(0, 0.9, origin);
        memory.insert(0, 0, Sequence::of(0), hits);
        for _ in 0..scans {
            memory.predict(1e-4, 0.1);
            let r = memory.existence(0);
            // Bernoulli: missed although it exists, or because it does not.
            let missed = r * (1.0 - detection) / (1.0 - r * detection);
            memory.remember(0, [r, missed], false, sighting, [lasting, probability(LOOKS_PER_S, 0.1)]);
        }
        memory.existence(0)
    }

    #[test]
    fn what_is_missed_where_it_is_expected_is_forgotten_and_what_is_hidden_is_not() {
        assert!(after_misses(Origin::Discovered, 5, 0.95, Sighting::Open, 5) < FORGOTTEN);
        // A path that is hardly ever detected is no hidden one.
        assert!(after_misses(Origin::Discovered, 5, 0.1, Sighting::Open, 100) < FORGOTTEN);
        for origin in [Origin::Discovered, Origin::Plan] {
            assert!(after_misses(origin, 5, 0.1, Sighting::Hidden, 10_000) > 0.898);
        }
    }

    #[test]
    fn what_is_told_and_nobody_sees_fades_in_thousands_of_scans() {
        assert!(after_misses(Origin::Discovered, 0, 0.1, Sighting::Hidden, 100) > CONFIRMED * 0.5);
        assert!(after_misses(Origin::Discovered, 0, 0.1, Sighting::Hidden, 4000) < FORGOTTEN);
    }
}
