//! Environment memory: which virtual anchors exist, and how sure that is.
//!
//! The state filter holds where they are; this memory holds that they are. Existence follows the Bernoulli
//! recursion of a two-state chain with time and the association's posterior after each; a virtual anchor is confirmed
//! above 0.5 and forgotten below 1e-3. A virtual anchor that is hidden (its SINR says so) neither proves nor disproves that
//! it exists, and keeps its existence; one that was never seen loses it slowly.

use crate::model::clock::probability;
use crate::model::source::Source;
use crate::perceptor::association::outcome::AssociatedScan;
use crate::perceptor::expectation::Sighting;
use crate::real::smaller;
use heapless::Vec;
use nalgebra::{Matrix2, Vector2};

/// Mathematics: more probable than not: existence above which a virtual anchor counts for planning and in reports.
pub const CONFIRMED: f32 = 0.5;
/// Guard: against a full map: existence below which it is forgotten.
pub const FORGOTTEN: f32 = 1e-3;
/// Tuned: against a plan erased by silence: what hides a virtual anchor that was never seen does so for a while, in which
/// looking again tells nothing new: so many independent looks in a second.
pub const LOOKS_PER_S: f32 = 2.0;
/// Guard: against certainty, which no miss would change: a wall can be taken down.
pub const MOST_CERTAIN: f32 = 0.999;

/// Tuned: against two entries for one wall: virtual anchors of one anchor that are nearer than this may be one, metres.
pub const NEAR_M: f32 = 0.3;

/// Tuned: prior probability that a virtual anchor exists of which a plan tells, or discovery: nine of ten.
pub const TOLD: f32 = 0.9;

/// Position of a virtual anchor (metres) and its covariance (square metres).
pub type Placed = (Vector2<f32>, Matrix2<f32>);

/// What has become of a discovery.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Admission {
    /// It lies within 0.3 m of the anchor or of one of its virtual anchors.
    Known,
    /// There is no room.
    Full,
    /// It is in the map.
    Entered {
        /// Its slot.
        slot: usize,
        /// Whether another one gave way.
        replaced: bool,
    },
}

/// One virtual anchor.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Record {
    /// Index of the physical anchor whose image it is.
    pub anchor: usize,
    /// Probability that it exists.
    pub existence: f32,
    /// Whether its path could be seen in the last scan.
    pub sighting: Sighting,
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
            *record = Some(Record {
                anchor,
                existence: smaller(existence, MOST_CERTAIN),
                sighting: Sighting::Open,
                hits,
            });
        }
    }

    /// Time passes: what is known of virtual anchors gets old, but for those that are hidden. A wall that was there may be gone,
    /// and one that was not may be there again: silence makes doubtful and never forgets.
    pub fn predict(&mut self, change_per_s: f32, elapsed_s: f32) {
        // A symmetric two-state chain forgets its state at twice the rate at which it turns.
        let changed = 0.5 * probability(2.0 * change_per_s, elapsed_s);
        for record in self.records.iter_mut().flatten() {
            if record.sighting == Sighting::Open {
                record.existence += changed * (1.0 - 2.0 * record.existence);
            }
        }
    }

    /// Enters the outcome of a scan for every virtual anchor of its anchor.
    pub fn observe<const PATHS: usize>(&mut self, associated: &AssociatedScan<'_, VAS, PATHS>) {
        let look = probability(LOOKS_PER_S, associated.scan.elapsed_s);
        for ((regression, belief), view) in associated.features().zip(associated.expected.views()) {
            if let Source::Virtual { slot, .. } = regression.source {
                self.remember(slot, belief.existence, belief.missed < 0.5, view.sighting, look);
            }
        }
    }

    /// Enters the outcome of a scan: the posterior existence, whether a path was (probably) seen, and whether it could be;
    /// `look` is the probability that it tells something new of what is hidden.
    fn remember(&mut self, slot: usize, existence: f32, seen: bool, sighting: Sighting, look: f32) {
        if let Some(Some(record)) = self.records.get_mut(slot) {
            let drop = record.existence - existence;
            // Where a path is hardly expected, having none tells little; having one tells as much as ever.
            let existence = match sighting == Sighting::Hidden && drop > 0.0 {
                true if record.hits > 0 => record.existence,
                true => record.existence - look * drop,
                false => existence,
            };
            record.existence = smaller(existence, MOST_CERTAIN);
            record.sighting = sighting;
            if seen {
                record.hits = record.hits.saturating_add(1);
            }
        }
    }

    /// Whether a source is a virtual anchor that was never seen.
    pub fn is_unseen(&self, source: Source) -> bool {
        match source {
            Source::Direct { .. } => false,
            Source::Virtual { slot, .. } => self.get(slot).is_some_and(|record| record.hits == 0),
        }
    }

    /// Slots of the virtual anchors of an anchor.
    pub fn images_of(&self, anchor: usize) -> impl Iterator<Item = usize> + Clone {
        self.iter().filter(move |(_, record)| record.anchor == anchor).map(|(slot, _)| slot)
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

    /// Forgets the virtual anchors that have become improbable, and the younger of two of an anchor that are one;
    /// `placed` gives where the one in a slot is. Returns their slots.
    pub fn revise(&mut self, placed: impl Fn(usize) -> Option<Placed>) -> Vec<usize, VAS> {
        let mut forgotten = Vec::new();
        for slot in 0..VAS {
            if self.get(slot).is_some_and(|record| record.existence < FORGOTTEN) {
                self.remove(slot);
                // One per slot at most: the pushes succeed.
                let _ = forgotten.push(slot);
            }
        }
        for slot in 0..VAS {
            if self.is_doubled(slot, &placed) {
                self.remove(slot);
                let _ = forgotten.push(slot);
            }
        }
        forgotten
    }

    /// Whether an older virtual anchor of the same anchor is where the one in `slot` is.
    fn is_doubled(&self, slot: usize, placed: impl Fn(usize) -> Option<Placed>) -> bool {
        let Some(record) = self.get(slot) else { return false };
        let Some((a, c)) = placed(slot) else { return false };
        let is_same = |(other, twin): (usize, &Record)| {
            let (b, d) = placed(other)?;
            let (dx, dy) = (b.x - a.x, b.y - a.y);
            let (xx, yx, yy) = (c.m11 + d.m11, c.m21 + d.m21, c.m22 + d.m22);
            let form = yy * (dx * dx) - 2.0 * (yx * (dx * dy)) + xx * (dy * dy);
            let near = dx * dx + dy * dy < NEAR_M * NEAR_M && form < xx * yy - yx * yx;
            let older = twin.hits > record.hits || (twin.hits == record.hits && other < slot);
            (twin.anchor == record.anchor && other != slot && near && older).then_some(())
        };
        record.hits > 0 && self.iter().any(|entry| is_same(entry).is_some())
    }

    /// Takes a virtual anchor of `anchor` (at `anchor_m`, metres) in that was discovered at `position`, in the place of the
    /// one that tells least if there is no other; `detections` are the detection probabilities by slot, asked for only then.
    pub fn admit(
        &mut self,
        anchor: usize,
        anchor_m: [f32; 2],
        position: Vector2<f32>,
        placed: impl Fn(usize) -> Option<Placed>,
        detections: impl FnOnce(&Self) -> [f32; VAS],
    ) -> Admission {
        let is_near = |x: f32, y: f32| {
            let (dx, dy) = (position.x - x, position.y - y);
            dx * dx + dy * dy < NEAR_M * NEAR_M
        };
        let [x, y] = anchor_m;
        let is_known = is_near(x, y)
            || self.iter().any(|(slot, record)| {
                record.anchor == anchor && placed(slot).is_some_and(|(a, _)| is_near(a.x, a.y))
            });
        if is_known {
            return Admission::Known;
        }
        let (slot, replaced) = match self.free_slot() {
            Some(slot) => (Some(slot), false),
            None => {
                let detections = detections(self);
                (self.give_way(&detections), true)
            }
        };
        let Some(slot) = slot else { return Admission::Full };
        self.insert(slot, anchor, TOLD, 1);
        Admission::Entered { slot, replaced }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Existence after `scans` scans without a path that is there with probability `detection`.
    fn after_misses(hits: u32, detection: f32, sighting: Sighting, scans: usize) -> f32 {
        let mut memory = EnvironmentMemory::<1>::default();
        memory.insert(0, 0, 0.9, hits);
        for _ in 0..scans {
            memory.predict(1e-4, 0.1);
            let r = memory.get(0).map_or(0.0, |record| record.existence);
            // Bernoulli: missed although it exists, or because it does not.
            let missed = r * (1.0 - detection) / (1.0 - r * detection);
            memory.remember(0, missed, false, sighting, probability(LOOKS_PER_S, 0.1));
        }
        memory.get(0).map_or(0.0, |record| record.existence)
    }

    #[test]
    fn what_is_missed_where_it_is_expected_is_forgotten_and_what_is_hidden_is_not() {
        assert!(after_misses(5, 0.95, Sighting::Open, 5) < FORGOTTEN);
        // A path that is hardly ever detected is no hidden one.
        assert!(after_misses(5, 0.1, Sighting::Open, 100) < FORGOTTEN);
        assert!(after_misses(5, 0.1, Sighting::Hidden, 10_000) > 0.898);
    }

    #[test]
    fn what_a_plan_tells_of_and_nobody_sees_fades_in_hundreds_of_scans() {
        assert!(after_misses(0, 0.1, Sighting::Hidden, 100) > CONFIRMED * 0.5);
        assert!(after_misses(0, 0.1, Sighting::Hidden, 1000) < FORGOTTEN);
    }
}
