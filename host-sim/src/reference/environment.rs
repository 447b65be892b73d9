//! Environment memory: the virtual anchors believed to exist.
//!
//! Existence is a chain of two states with time, and the association's posterior after each scan. A virtual anchor counts
//! above 1/2, and is forgotten below 1/1000. While it is hidden its existence stays; one that was never seen loses it slowly.

use super::clock::probability;
use super::real::{Real, smaller};
pub use cogmint_core::memory::environment::CONFIRMED;
use cogmint_core::memory::environment::{FORGOTTEN, LOOKS_PER_S, MOST_CERTAIN};
use cogmint_core::model::source::Source;
use cogmint_core::perceptor::expectation::Sighting;

/// One virtual anchor.
#[derive(Clone, Copy, Debug)]
pub struct Record<T> {
    /// The physical anchor it mirrors.
    pub anchor: usize,
    /// Probability that it exists.
    pub existence: T,
    /// Whether its path could be seen in the last scan.
    pub sighting: Sighting,
    /// Scans with a path.
    pub hits: u32,
}

/// The virtual anchors by slot.
#[derive(Clone, Debug)]
pub struct EnvironmentMemory<T> {
    /// `None` where a slot is free.
    pub records: Vec<Option<Record<T>>>,
}

impl<T: Real> EnvironmentMemory<T> {
    /// A memory of `slots` free slots.
    pub fn new(slots: usize) -> Self {
        Self { records: vec![None; slots] }
    }

    /// Slots and records in use.
    pub fn in_use(&self) -> Vec<(usize, Record<T>)> {
        let mut list = Vec::new();
        for slot in 0..self.records.len() {
            if let Some(record) = self.records[slot] {
                list.push((slot, record));
            }
        }
        list
    }

    /// The sources of an anchor: its direct path, then its virtual anchors by slot.
    pub fn sources_of(&self, anchor: usize) -> Vec<Source> {
        let mut sources = vec![Source::Direct { anchor }];
        for (slot, record) in self.in_use() {
            if record.anchor == anchor {
                sources.push(Source::Virtual { anchor, slot });
            }
        }
        sources
    }

    /// Whether a source is a virtual anchor that is on the map but was never seen.
    pub fn is_unseen(&self, source: Source) -> bool {
        match source {
            Source::Direct { .. } => false,
            Source::Virtual { slot, .. } => self.records[slot].is_some_and(|record| record.hits == 0),
        }
    }

    /// Probability that a source exists.
    pub fn existence(&self, source: Source) -> T {
        match source {
            Source::Direct { .. } => T::ONE,
            Source::Virtual { slot, .. } => self.records[slot].map_or(T::ZERO, |record| record.existence),
        }
    }

    /// The first free slot.
    pub fn free_slot(&self) -> Option<usize> {
        self.records.iter().position(Option::is_none)
    }

    /// Fills a free slot; `hits` scans have shown the virtual anchor so far.
    pub fn insert(&mut self, slot: usize, anchor: usize, existence: T, hits: u32) {
        let existence = smaller(existence, T::of(MOST_CERTAIN));
        self.records[slot] = Some(Record { anchor, existence, sighting: Sighting::Open, hits });
    }

    /// `dt` seconds pass: what is not hidden may have gone, or come back.
    pub fn predict(&mut self, change_per_s: f32, dt: T) {
        // A symmetric chain forgets its state at twice the rate of its turns.
        let changed = T::of(0.5) * probability(2.0 * change_per_s, dt);
        for record in self.records.iter_mut().flatten() {
            if record.sighting == Sighting::Open {
                record.existence += changed * (T::ONE - T::of(2.0) * record.existence);
            }
        }
    }

    /// Enters the outcome of a scan, `dt` seconds after the last.
    pub fn remember(&mut self, slot: usize, existence: T, seen: bool, sighting: Sighting, dt: T) {
        if let Some(record) = &mut self.records[slot] {
            let drop = record.existence - existence;
            let mut next = existence;
            if sighting == Sighting::Hidden && drop > T::ZERO {
                next = record.existence;
                if record.hits == 0 {
                    next -= probability(LOOKS_PER_S, dt) * drop;
                }
            }
            record.existence = smaller(next, T::of(MOST_CERTAIN));
            record.sighting = sighting;
            if seen {
                record.hits = record.hits.saturating_add(1);
            }
        }
    }

    /// Frees the slot of the virtual anchor that tells least, existence times detection probability, if that is at most one
    /// half (the first of equals).
    pub fn give_way(&mut self, detections: &[T]) -> Option<usize> {
        let mut least: Option<(usize, T)> = None;
        for (slot, record) in self.in_use() {
            let worth = record.existence * detections[slot];
            if worth <= T::of(CONFIRMED) && least.is_none_or(|(_, least)| worth < least) {
                least = Some((slot, worth));
            }
        }
        let (slot, _) = least?;
        self.records[slot] = None;
        Some(slot)
    }

    /// Frees the slots of all virtual anchors that have become improbable; returns them in order.
    pub fn forget(&mut self) -> Vec<usize> {
        let mut forgotten = Vec::new();
        for (slot, record) in self.in_use() {
            if record.existence < T::of(FORGOTTEN) {
                self.records[slot] = None;
                forgotten.push(slot);
            }
        }
        forgotten
    }
}
