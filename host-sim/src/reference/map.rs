//! The life of virtual anchors: improbable ones are forgotten, doubled ones merged, resolved candidates taken in.

use super::association::outcome::Outcome;
use super::channel_memory::ChannelMemory;
use super::clutter::ClutterMemory;
use super::discovery::{Discovered, Discovery};
use super::environment::EnvironmentMemory;
use super::known::{Known, Told};
use super::real::{Real, square};
use super::receiver::Scan;
use super::state_filter::StateFilter;
use cogmint_core::memory::environment::{NEAR_M, TOLD};
use cogmint_core::model::source::Source;

/// What happened to the map in a cycle.
#[derive(Clone, Copy, Debug, Default)]
pub struct Changes {
    /// Virtual anchors discovered.
    pub discovered: u32,
    /// Virtual anchors forgotten.
    pub forgotten: u32,
    /// Discoveries dropped because the map was full.
    pub map_full: u32,
}

/// The states that hold the map.
pub struct Map<'a, T> {
    /// Where virtual anchors are.
    pub filter: &'a mut StateFilter<T>,
    /// That they are.
    pub environment: &'a mut EnvironmentMemory<T>,
    /// How well they are heard.
    pub channel: &'a mut ChannelMemory<T>,
    /// What may be one.
    pub discovery: &'a mut Discovery<T>,
}

impl<T: Real> Map<'_, T> {
    /// Revises the map by the scans of a cycle.
    pub fn revise(
        &mut self,
        told: &Told<'_, T>,
        clutter: &ClutterMemory<T>,
        outcomes: &[Outcome<T>],
    ) -> Changes {
        let mut changes = Changes::default();
        for slot in self.environment.forget() {
            self.take_out(slot, &mut changes);
        }
        self.merge(&mut changes);
        if !told.config.discovery {
            return changes;
        }
        for Outcome { scan, expected, claims, beliefs, .. } in outcomes {
            let (viewpoint, background) =
                self.known(clutter).discovery_view(told, scan.anchor, &expected[0].regression);
            let known_m: Vec<T> = expected.iter().map(|expected| expected.regression.range_m).collect();
            self.discovery.observe(
                scan.anchor,
                &viewpoint,
                &scan.measurements,
                claims,
                &beliefs.unassociated,
                &background,
                &known_m,
                scan.resolution_m(),
            );
            while let Some(found) = self.discovery.take_resolved(scan.anchor) {
                self.take_in(told, clutter, scan, &found, &mut changes);
            }
        }
        changes
    }

    fn known<'b>(&'b self, clutter: &'b ClutterMemory<T>) -> Known<'b, T> {
        Known { filter: self.filter, environment: self.environment, channel: self.channel, clutter }
    }

    fn take_out(&mut self, slot: usize, changes: &mut Changes) {
        self.filter.remove(slot);
        self.channel.forget(slot);
        changes.forgotten += 1;
    }

    /// Of two virtual anchors of an anchor that are one, the younger goes.
    fn merge(&mut self, changes: &mut Changes) {
        let placed = |slot: usize| {
            (self.filter.virtual_anchor_m(slot), self.filter.virtual_anchor_covariance_m2(slot))
        };
        let mut doubled = Vec::new();
        for (slot, record) in self.environment.in_use() {
            let is_double_of = |other: usize| {
                let ((a, c), (b, d)) = (placed(slot), placed(other));
                let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
                let (xx, yx, yy) = (c[0][0] + d[0][0], c[1][0] + d[1][0], c[1][1] + d[1][1]);
                let form = yy * square(dx) - T::of(2.0) * (yx * (dx * dy)) + xx * square(dy);
                square(dx) + square(dy) < square(T::of(NEAR_M)) && form < xx * yy - square(yx)
            };
            let is_younger = self.environment.in_use().into_iter().any(|(other, twin)| {
                let older = twin.hits > record.hits || (twin.hits == record.hits && other < slot);
                let rivals = twin.anchor == record.anchor && other != slot && !doubled.contains(&other);
                rivals && older && is_double_of(other)
            });
            if record.hits > 0 && is_younger {
                doubled.push(slot);
            }
        }
        for slot in doubled {
            self.environment.records[slot] = None;
            self.take_out(slot, changes);
        }
    }

    /// Enters a discovery into the map, unless it is known or there is no room.
    fn take_in(
        &mut self,
        told: &Told<'_, T>,
        clutter: &ClutterMemory<T>,
        scan: &Scan<T>,
        found: &Discovered<T>,
        changes: &mut Changes,
    ) {
        if self.is_known(told, scan.anchor, found) {
            return;
        }
        let slot = match self.environment.free_slot() {
            Some(slot) => slot,
            None => match self.environment.give_way(&self.detections(told, clutter, scan)) {
                Some(slot) => {
                    self.take_out(slot, changes);
                    slot
                }
                None => {
                    changes.map_full += 1;
                    return;
                }
            },
        };
        self.filter.insert_relative(slot, found.position_m, found.gain, found.covariance_m2);
        self.environment.insert(slot, scan.anchor, T::of(TOLD), 1);
        changes.discovered += 1;
    }

    /// Within 0.3 m of the anchor or one of its virtual anchors.
    fn is_known(&self, told: &Told<'_, T>, anchor: usize, found: &Discovered<T>) -> bool {
        let [x, y] = found.position_m;
        self.environment.sources_of(anchor).into_iter().any(|source| {
            let [kx, ky] = match source {
                Source::Direct { .. } => told.sight(anchor).anchor_m,
                Source::Virtual { slot, .. } => self.filter.virtual_anchor_m(slot),
            };
            square(x - kx) + square(y - ky) < square(T::of(NEAR_M))
        })
    }

    /// Detection probabilities by slot; 0 where it is free.
    fn detections(&self, told: &Told<'_, T>, clutter: &ClutterMemory<T>, scan: &Scan<T>) -> Vec<T> {
        let mut detections = vec![T::ZERO; self.environment.records.len()];
        for (slot, record) in self.environment.in_use() {
            let source = Source::Virtual { anchor: record.anchor, slot };
            detections[slot] = self.known(clutter).detection(told, scan, source, None).probability;
        }
        detections
    }
}
