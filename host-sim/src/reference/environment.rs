//! Environment memory: the surfaces believed to exist, and the sources seen in them.
//!
//! A surface's existence is a chain of two states with time; each image of its own (one reflection) multiplies its odds by what
//! association multiplies those of the image by. An image of two surfaces exists where both do. A source counts above 1/2. A
//! surface that no plan tells of is forgotten below 1/1000. What is hidden tells nothing; what was never seen tells little.

use super::Square;
use super::clock::probability;
use super::real::{Real, smaller, square};
pub use cogmint_core::memory::environment::CONFIRMED;
use cogmint_core::memory::environment::{FORGOTTEN, LOOKS_PER_S, MOST_CERTAIN, NEAR_M, Origin};
use cogmint_core::model::image::Sequence;
use cogmint_core::model::source::Source;
use cogmint_core::perceptor::expectation::Sighting;

/// A source.
#[derive(Clone, Copy, Debug)]
pub struct Record {
    /// The physical anchor it mirrors.
    pub anchor: usize,
    /// The surfaces it is seen in.
    pub sequence: Sequence,
    /// Whether its path could be seen in the last scan.
    pub sighting: Sighting,
    /// Scans with a path.
    pub hits: u32,
}

/// A surface.
#[derive(Clone, Copy, Debug)]
pub struct SurfaceRecord<T> {
    /// Probability that it exists.
    pub existence: T,
    /// Whether a plan tells of it.
    pub is_told: bool,
    /// Whether it was discovered.
    pub may_join: bool,
}

/// A source taken out, and the surfaces that went with it.
#[derive(Clone, Copy, Debug)]
pub struct Removed {
    /// Slot of the source.
    pub slot: usize,
    /// Slots of the surfaces.
    pub surfaces: [Option<usize>; 2],
}

/// What association made of a source in a scan.
#[derive(Clone, Copy, Debug)]
pub struct Look<T> {
    /// Probability that it exists, before.
    pub prior: T,
    /// And after.
    pub posterior: T,
    /// Whether it was seen.
    pub seen: bool,
    /// Whether it could be.
    pub sighting: Sighting,
    /// Share of its detection probability that does not rest on its coming out again.
    pub lasting: T,
}

/// Sources and surfaces by slot.
#[derive(Clone, Debug)]
pub struct EnvironmentMemory<T> {
    /// `None` where a slot is free.
    pub sources: Vec<Option<Record>>,
    /// `None` where a slot is free.
    pub surfaces: Vec<Option<SurfaceRecord<T>>>,
    /// Whose turn it is to be joined.
    pub turn: u32,
}

impl<T: Real> EnvironmentMemory<T> {
    /// A memory of so many free slots.
    pub fn new(surfaces: usize, sources: usize) -> Self {
        Self { sources: vec![None; sources], surfaces: vec![None; surfaces], turn: 0 }
    }

    /// Slots and records of all sources.
    pub fn in_use(&self) -> Vec<(usize, Record)> {
        let mut list = Vec::new();
        for slot in 0..self.sources.len() {
            if let Some(record) = self.sources[slot] {
                list.push((slot, record));
            }
        }
        list
    }

    /// The sources of an anchor: its direct path, then its images by slot.
    pub fn sources_of(&self, anchor: usize) -> Vec<Source> {
        let mut sources = vec![Source::Direct { anchor }];
        for (slot, record) in self.in_use() {
            if record.anchor == anchor {
                sources.push(Source::Virtual { anchor, slot });
            }
        }
        sources
    }

    /// What reflects a source's path; nothing for direct paths.
    pub fn sequence(&self, source: Source) -> Option<Sequence> {
        match source {
            Source::Direct { .. } => None,
            Source::Virtual { slot, .. } => self.sources[slot].map(|record| record.sequence),
        }
    }

    /// Whether a source is an image that is on the map but was never seen.
    pub fn is_unseen(&self, source: Source) -> bool {
        match source {
            Source::Direct { .. } => false,
            Source::Virtual { slot, .. } => self.sources[slot].is_some_and(|record| record.hits == 0),
        }
    }

    /// Probability that a source exists: that all its surfaces do.
    pub fn existence(&self, source: Source) -> T {
        let mut existence = T::ONE;
        for surface in self.sequence(source).iter().flat_map(Sequence::surfaces) {
            existence *= self.surfaces[surface].map_or(T::ZERO, |record| record.existence);
        }
        existence
    }

    /// The first free slot of a source.
    pub fn free_slot(&self) -> Option<usize> {
        self.sources.iter().position(Option::is_none)
    }

    /// How many sources there is room for.
    pub fn free_slots(&self) -> usize {
        self.sources.iter().filter(|source| source.is_none()).count()
    }

    /// The first free slot of a surface.
    pub fn free_surface(&self) -> Option<usize> {
        self.surfaces.iter().position(Option::is_none)
    }

    /// Fills a free slot with a surface.
    pub fn insert_surface(&mut self, slot: usize, existence: T, origin: Origin) {
        let existence = smaller(existence, T::of(MOST_CERTAIN));
        let (is_told, may_join) = (origin == Origin::Plan, origin == Origin::Discovered);
        self.surfaces[slot] = Some(SurfaceRecord { existence, is_told, may_join });
    }

    /// Fills a free slot with a source; `hits` scans have shown it so far.
    pub fn insert(&mut self, slot: usize, anchor: usize, sequence: Sequence, hits: u32) {
        self.sources[slot] = Some(Record { anchor, sequence, sighting: Sighting::Open, hits });
    }

    /// `dt` seconds pass: a surface may have gone, or come back, unless all its own images are hidden.
    pub fn predict(&mut self, change_per_s: f32, dt: T) {
        // A symmetric chain forgets its state at twice the rate of its turns.
        let changed = T::of(0.5) * probability(2.0 * change_per_s, dt);
        let mut open = vec![false; self.surfaces.len()];
        for (_, record) in self.in_use() {
            if record.sequence.order() == 1 && record.sighting == Sighting::Open {
                open[usize::from(record.sequence.first)] = true;
            }
        }
        for slot in 0..open.len() {
            if let Some(surface) = &mut self.surfaces[slot]
                && open[slot]
            {
                surface.existence += changed * (T::ONE - T::of(2.0) * surface.existence);
            }
        }
    }

    /// Enters the outcome of a scan, `dt` seconds after the last, for the source in `slot`.
    pub fn remember(&mut self, slot: usize, look: &Look<T>, dt: T) {
        let Some(record) = &mut self.sources[slot] else { return };
        let was_seen = record.hits > 0;
        record.sighting = look.sighting;
        if look.seen {
            record.hits = record.hits.saturating_add(1);
        }
        let sequence = record.sequence;
        if sequence.order() == 1
            && let Some(surface) = &mut self.surfaces[usize::from(sequence.first)]
        {
            let r = surface.existence;
            // Odds r / (1 - r) times those of the posterior over those of the prior.
            let with = r * (look.posterior * (T::ONE - look.prior));
            let without = (T::ONE - r) * ((T::ONE - look.posterior) * look.prior);
            let mut next = with / (with + without);
            let drop = r - next;
            if drop > T::ZERO {
                let is_hidden = look.sighting == Sighting::Hidden;
                let share = if was_seen && !surface.is_told {
                    look.lasting
                } else if !is_hidden {
                    T::ONE
                } else if was_seen {
                    T::ZERO
                } else {
                    probability(LOOKS_PER_S, dt)
                };
                next = r - share * drop;
            }
            surface.existence = smaller(next, T::of(MOST_CERTAIN));
        }
    }

    /// Of the surfaces of a source, the first that no plan tells of and in which nothing else is seen.
    pub fn only_surface_of(&self, slot: usize) -> Option<usize> {
        let sequence = self.sources[slot]?.sequence;
        sequence.surfaces().find(|&surface| {
            let is_told = self.surfaces[surface].is_none_or(|record| record.is_told);
            let others = self.in_use().into_iter().filter(|(other, _)| *other != slot);
            !is_told && !others.into_iter().any(|(_, record)| record.sequence.has(surface))
        })
    }

    /// Takes a source out, and the surfaces that are its alone.
    pub fn remove(&mut self, slot: usize) -> Removed {
        let mut surfaces = [None; 2];
        for gone in &mut surfaces {
            *gone = self.only_surface_of(slot);
            if let Some(surface) = *gone {
                self.surfaces[surface] = None;
            }
        }
        self.sources[slot] = None;
        Removed { slot, surfaces }
    }

    /// The source that is this image of an anchor.
    pub fn source_of(&self, anchor: usize, sequence: &Sequence) -> Option<usize> {
        let all = self.in_use();
        // In either order the image is one.
        let is_it = |own: Sequence| {
            let swapped = (own.second, Some(own.first)) == (Some(sequence.first), sequence.second);
            let straight = (own.first, own.second) == (sequence.first, sequence.second);
            straight || (swapped && (own.is_either_order || sequence.is_either_order))
        };
        let same = all.iter().find(|(_, record)| record.anchor == anchor && is_it(record.sequence));
        same.map(|(slot, _)| *slot)
    }

    /// A source is seen in these surfaces, not in its private one, which is gone. They exist unless neither did:
    /// 1 - r <- (1 - r) (1 - r_private).
    pub fn join(&mut self, slot: usize, sequence: Sequence) {
        let Some(record) = &mut self.sources[slot] else { return };
        let private = usize::from(record.sequence.first);
        record.sequence = sequence;
        let Some(SurfaceRecord { existence: seen, .. }) = self.surfaces[private].take() else { return };
        for surface in sequence.surfaces() {
            if let Some(record) = &mut self.surfaces[surface] {
                let neither = (T::ONE - record.existence) * (T::ONE - seen);
                record.existence = smaller(T::ONE - neither, T::of(MOST_CERTAIN));
            }
        }
    }

    /// Takes out the source that tells least, existence times detection probability, if that is at most one half (the first of
    /// equals); if a surface is needed too, of those that have one for themselves.
    pub fn give_way(&mut self, detections: &[T], needs_surface: bool) -> Option<Removed> {
        let mut least: Option<(usize, T)> = None;
        for (slot, record) in self.in_use() {
            if needs_surface && self.only_surface_of(slot).is_none() {
                continue;
            }
            let worth = self.existence(Source::Virtual { anchor: record.anchor, slot }) * detections[slot];
            if worth <= T::of(CONFIRMED) && least.is_none_or(|(_, least)| worth < least) {
                least = Some((slot, worth));
            }
        }
        let (slot, _) = least?;
        Some(self.remove(slot))
    }

    /// Takes out all sources of surfaces that have become improbable and that no plan tells of; then, of two images of an anchor
    /// that are one, the younger. `placed`: where the image in a slot is, and its covariance. In order.
    pub fn revise(&mut self, placed: impl Fn(usize) -> ([T; 2], Square<T>)) -> Vec<Removed> {
        let mut removed = Vec::new();
        for (slot, record) in self.in_use() {
            let is_forgotten = record.sequence.surfaces().any(|surface| {
                self.surfaces[surface]
                    .is_some_and(|record| !record.is_told && record.existence < T::of(FORGOTTEN))
            });
            if is_forgotten {
                removed.push(self.remove(slot));
            }
        }
        for (slot, record) in self.in_use() {
            // Only what has a surface of its own was found; what a plan tells of is older than anything.
            if record.hits == 0 || self.only_surface_of(slot).is_none() {
                continue;
            }
            let is_double = self.in_use().into_iter().any(|(other, twin)| {
                let is_rival = twin.anchor == record.anchor && other != slot;
                let is_older = self.only_surface_of(other).is_none()
                    || twin.hits > record.hits
                    || (twin.hits == record.hits && other < slot);
                is_rival && is_older && are_one(placed(slot), placed(other))
            });
            if is_double {
                removed.push(self.remove(slot));
            }
        }
        removed
    }
}

/// Whether two images may be one: nearer than 0.3 m, and within one deviation.
fn are_one<T: Real>((a, c): ([T; 2], Square<T>), (b, d): ([T; 2], Square<T>)) -> bool {
    let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
    let (xx, yx, yy) = (c[0][0] + d[0][0], c[1][0] + d[1][0], c[1][1] + d[1][1]);
    let form = yy * square(dx) - T::of(2.0) * (yx * (dx * dy)) + xx * square(dy);
    square(dx) + square(dy) < square(T::of(NEAR_M)) && form < xx * yy - square(yx)
}
