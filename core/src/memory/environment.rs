//! Environment memory: which virtual anchors exist, and how sure that is.
//!
//! The state filter holds where they are; this memory holds that they are. Existence follows the Bernoulli
//! recursion r <- P_s r between scans and the association's posterior after each; a virtual anchor is confirmed
//! above 0.5 and forgotten below 1e-3, or after 200 scans without the path that was expected. A virtual anchor that is
//! hidden (its SINR says so) neither proves nor disproves that it exists, and keeps its existence; one that was never seen
//! loses it slowly.

use crate::real::smaller;

/// Existence above which a virtual anchor counts for planning and in reports.
pub const CONFIRMED: f32 = 0.5;
/// Existence below which it is forgotten.
const FORGOTTEN: f32 = 1e-3;
/// Scans without a path, since the last with one, after which it is forgotten; only those in which one was expected
/// count.
const MISSES: u16 = 200;
/// Detection probability up to which a virtual anchor counts as hidden, and above which a path is expected.
const HIDDEN: f32 = 0.1;
const EXPECTED: f32 = 0.5;
/// What hides a virtual anchor that was never seen hides it for many cycles: five looks
/// from there are worth one.
const REPEATED_LOOK: f32 = 0.2;
/// Existence is never certain: a wall can be taken down.
const MOST_CERTAIN: f32 = 0.999;

/// One virtual anchor.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Record {
    /// Index of the physical anchor whose image it is.
    pub anchor: usize,
    /// Probability that it exists.
    pub existence: f32,
    /// Scans without the path that was expected, since the last with one.
    pub misses: u16,
    /// Scans with a path.
    pub hits: u32,
}

/// The virtual anchors by slot.
#[derive(Clone, Debug)]
pub struct EnvironmentMemory<const VAS: usize> {
    records: [Option<Record>; VAS],
}

impl<const VAS: usize> Default for EnvironmentMemory<VAS> {
    fn default() -> Self {
        Self { records: [None; VAS] }
    }
}

impl<const VAS: usize> EnvironmentMemory<VAS> {
    /// The record in `slot`; `None` where the slot is free.
    pub fn get(&self, slot: usize) -> Option<&Record> {
        self.records.get(slot)?.as_ref()
    }

    /// Slots and records of all virtual anchors.
    pub fn iter(&self) -> impl Iterator<Item = (usize, &Record)> + Clone {
        self.records.iter().enumerate().filter_map(|(slot, record)| Some((slot, record.as_ref()?)))
    }

    /// The first free slot.
    pub fn free_slot(&self) -> Option<usize> {
        self.records.iter().position(Option::is_none)
    }

    /// Fills a free slot with a virtual anchor seen `hits` times so far; does nothing where it is taken or does not exist.
    pub fn insert(&mut self, slot: usize, anchor: usize, existence: f32, hits: u32) {
        if let Some(record @ None) = self.records.get_mut(slot) {
            *record = Some(Record { anchor, existence: smaller(existence, MOST_CERTAIN), misses: 0, hits });
        }
    }

    /// Existence of the virtual anchor in `slot` before a scan: P_s r, or r where it is hidden.
    pub fn expected_existence(&self, slot: usize, survival: f32, detection: f32) -> f32 {
        let survival = if detection <= HIDDEN { 1.0 } else { survival };
        self.get(slot).map_or(0.0, |record| smaller(record.existence * survival, MOST_CERTAIN))
    }

    /// Enters the outcome of a scan: the posterior existence, whether a path was (probably) seen, and how probable it was.
    pub fn remember(&mut self, slot: usize, existence: f32, seen: bool, detection: f32) {
        if let Some(Some(record)) = self.records.get_mut(slot) {
            let drop = record.existence - existence;
            // Where a path is hardly expected, having none tells little; having one tells as much as ever.
            let existence = match detection <= HIDDEN && drop > 0.0 {
                true if record.hits > 0 => record.existence,
                true => record.existence - REPEATED_LOOK * drop,
                false => existence,
            };
            record.existence = smaller(existence, MOST_CERTAIN);
            if seen {
                record.misses = 0;
                record.hits = record.hits.saturating_add(1);
            } else if detection > EXPECTED {
                record.misses = record.misses.saturating_add(1);
            }
        }
    }

    /// When the map is full: forgets the virtual anchor that tells least, the product of its existence and of its detection
    /// probability (by slot), if that is at most 1/2; returns its slot.
    pub fn give_way(&mut self, detections: &[f32; VAS]) -> Option<usize> {
        let mut least: Option<(usize, f32)> = None;
        for ((slot, record), detection) in self.records.iter().enumerate().zip(detections) {
            let Some(record) = record else { continue };
            let worth = record.existence * detection;
            if worth <= CONFIRMED && least.is_none_or(|(_, least)| worth < least) {
                least = Some((slot, worth));
            }
        }
        let (slot, _) = least?;
        self.remove(slot);
        Some(slot)
    }

    /// Forgets the virtual anchor in `slot`.
    pub fn remove(&mut self, slot: usize) {
        if let Some(record) = self.records.get_mut(slot) {
            *record = None;
        }
    }

    /// Forgets the first virtual anchor that has become improbable; returns its slot.
    pub fn forget_one(&mut self) -> Option<usize> {
        let slot = self.records.iter().position(|record| {
            record.as_ref().is_some_and(|record| record.existence < FORGOTTEN || record.misses > MISSES)
        })?;
        if let Some(record) = self.records.get_mut(slot) {
            *record = None;
        }
        Some(slot)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Existence after `scans` scans without a path that is there with probability `detection`.
    fn after_misses(hits: u32, detection: f32, scans: usize) -> f32 {
        let mut memory = EnvironmentMemory::<1>::default();
        memory.insert(0, 0, 0.9, hits);
        for _ in 0..scans {
            let r = memory.expected_existence(0, 0.999, detection);
            // Bernoulli: missed although it exists, or because it does not.
            let missed = r * (1.0 - detection) / (1.0 - r * detection);
            memory.remember(0, missed, false, detection);
        }
        memory.get(0).map_or(0.0, |record| record.existence)
    }

    #[test]
    fn what_is_missed_where_it_is_expected_is_forgotten_and_what_is_hidden_is_not() {
        assert!(after_misses(5, 0.95, 5) < FORGOTTEN);
        assert!(after_misses(5, HIDDEN, 10_000) == 0.9);
    }

    #[test]
    fn what_a_plan_tells_of_and_nobody_sees_fades_in_hundreds_of_scans() {
        assert!(after_misses(0, HIDDEN, 100) > CONFIRMED * 0.5);
        assert!(after_misses(0, HIDDEN, 1000) < FORGOTTEN);
    }
}
