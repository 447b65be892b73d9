//! The life of the map: improbable surfaces are forgotten, doubled images merged, resolved candidates taken in, images joined.

use super::association::outcome::Outcome;
use super::belief::Belief;
use super::channel_memory::ChannelMemory;
use super::clutter::ClutterMemory;
use super::discovery::{Discovered, Discovery};
use super::environment::{EnvironmentMemory, Removed};
use super::joining::{self, Joining};
use super::known::{Prospect, Told, detection, discovery_view};
use super::real::{Real, square};
use super::receiver::Scan;
use cogmint_core::memory::environment::{CONFIRMED, NEAR_M, Origin, TOLD};
use cogmint_core::model::image::Sequence;
use cogmint_core::model::source::Source;

/// What happened to the map in a cycle.
#[derive(Clone, Copy, Debug, Default)]
pub struct Changes {
    /// Virtual anchors discovered.
    pub discovered: u32,
    /// Virtual anchors forgotten.
    pub forgotten: u32,
    /// Images that became images in a surface of others.
    pub joined: u32,
    /// Discoveries dropped because the map was full.
    pub map_full: u32,
}

/// The states that hold the map.
pub struct Map<'a, T> {
    /// Where surfaces are.
    pub belief: &'a mut Belief<T>,
    /// That they are, and what is seen in them.
    pub environment: &'a mut EnvironmentMemory<T>,
    /// How well sources are heard.
    pub channel: &'a mut ChannelMemory<T>,
    /// What may be a new image.
    pub discovery: &'a mut Discovery<T>,
    /// When images are joined.
    pub joining: &'a joining::Constants,
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
        let records = self.environment.sources.clone();
        let filter = self.belief.leading();
        let removed = self.environment.revise(|slot| match records[slot] {
            Some(record) => filter.placed(told.sight(record.anchor).anchor_m, &record.sequence),
            None => unreachable!("only sources in use are asked for"),
        });
        for removed in removed {
            self.take_out(&removed);
            changes.forgotten += 1;
        }
        if !told.config.discovery {
            return changes;
        }
        for Outcome { scan, expected, claims, beliefs, .. } in outcomes {
            let (viewpoint, background) =
                discovery_view(told, self.belief.leading(), clutter, scan.anchor, &expected[0].regression);
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
                self.take_in(told, scan, &found, &mut changes);
            }
        }
        // Where nothing was heard, nobody's turn comes.
        if outcomes.is_empty() {
            return changes;
        }
        let leader = self.belief.leader;
        let mut joining = Joining {
            filter: &mut self.belief.components[leader].filter,
            environment: &mut *self.environment,
            anchors: told.anchors,
            max_range_m: told.config.ranging.max_range_m,
            constants: self.joining,
        };
        if let Some(joined) = joining.join() {
            self.belief.follow();
            changes.joined += 1;
            if let Some(removed) = joined.removed {
                self.take_out(&removed);
            }
        }
        changes
    }

    fn take_out(&mut self, removed: &Removed) {
        for surface in removed.surfaces.into_iter().flatten() {
            self.belief.remove(surface);
        }
        self.channel.forget(removed.slot);
    }

    /// Enters a discovery into the map with a private surface, unless it is known or there is no room.
    fn take_in(&mut self, told: &Told<'_, T>, scan: &Scan<T>, found: &Discovered<T>, changes: &mut Changes) {
        if self.is_known(told, scan.anchor, found) {
            return;
        }
        let doubtful = self.images_near(told, scan.anchor, found).first().copied();
        if let Some(slot) = doubtful {
            let removed = self.environment.remove(slot);
            self.take_out(&removed);
            changes.forgotten += 1;
        }
        let needs_surface = self.environment.free_surface().is_none();
        if (needs_surface || self.environment.free_slot().is_none())
            && let Some(removed) = self.environment.give_way(&self.detections(told, scan), needs_surface)
        {
            self.take_out(&removed);
            changes.forgotten += 1;
        }
        let (Some(slot), Some(surface)) = (self.environment.free_slot(), self.environment.free_surface())
        else {
            changes.map_full += 1;
            return;
        };
        self.channel.forget(slot);
        self.belief.discover(surface, found.position_m, found.gain, found.covariance_m2);
        self.environment.insert_surface(surface, T::of(TOLD), Origin::Discovered);
        self.environment.insert(slot, scan.anchor, Sequence::of(surface as u8), 1);
        changes.discovered += 1;
    }

    /// Within 0.3 m of the anchor or of one of its images that is confirmed or seen in what others are seen in.
    fn is_known(&self, told: &Told<'_, T>, anchor: usize, found: &Discovered<T>) -> bool {
        let confirmed = |slot: usize| {
            self.environment.existence(Source::Virtual { anchor, slot }) > T::of(CONFIRMED)
                || self.environment.only_surface_of(slot).is_none()
        };
        is_near(told.sight(anchor).anchor_m, found)
            || self.images_near(told, anchor, found).into_iter().any(confirmed)
    }

    /// The slots of an anchor's images within 0.3 m.
    fn images_near(&self, told: &Told<'_, T>, anchor: usize, found: &Discovered<T>) -> Vec<usize> {
        let anchor_m = told.sight(anchor).anchor_m;
        let mut near = Vec::new();
        for (slot, record) in self.environment.in_use() {
            if record.anchor == anchor
                && is_near(self.belief.leading().placed(anchor_m, &record.sequence).0, found)
            {
                near.push(slot);
            }
        }
        near
    }

    /// Detection probabilities by slot, wherever the tag is; 0 where it is free.
    fn detections(&self, told: &Told<'_, T>, scan: &Scan<T>) -> Vec<T> {
        let mut detections = vec![T::ZERO; self.environment.sources.len()];
        for (slot, record) in self.environment.in_use() {
            let source = Source::Virtual { anchor: record.anchor, slot };
            let anywhere = Prospect::anywhere(source);
            detections[slot] = detection(told, scan, self.environment, self.channel, &anywhere).probability;
        }
        detections
    }
}

/// Whether a discovery is within 0.3 m of a place.
fn is_near<T: Real>([x, y]: [T; 2], found: &Discovered<T>) -> bool {
    let [u, v] = found.position_m;
    square(u - x) + square(v - y) < square(T::of(NEAR_M))
}
