//! The life of virtual anchors: found, merged, forgotten.

use super::Tracker;
use super::associate::AssociatedScan;
use super::receive::Scan;
use crate::memory::environment::Record;
use crate::perceptor::discovery::{Background, Discovered, Viewpoint};
use crate::perceptor::state_filter::{Sight, Source};
use crate::real::SPEED_OF_LIGHT_M_S;
use crate::report::CycleReport;
use heapless::Vec;

/// Virtual anchors of one anchor that are nearer than this may be one, metres.
const NEAR_M: f32 = 0.3;

impl<const ANCHORS: usize, const VAS: usize, const PATHS: usize, const ACTIONS: usize>
    Tracker<ANCHORS, VAS, PATHS, ACTIONS>
{
    /// The life of virtual anchors: forgets improbable ones, offers what nothing explained to the candidates, and
    /// takes resolved candidates into the map.
    #[inline(never)]
    pub(super) fn discover(
        &mut self,
        heard: &Vec<AssociatedScan<'_, VAS, PATHS>, ANCHORS>,
        tag_height_m: Option<f32>,
        report: &mut CycleReport,
    ) {
        for _ in 0..VAS {
            let Some(slot) = self.environment.forget_one() else { break };
            self.take_out(slot, report);
        }
        self.merge(report);
        if !self.config.discovery {
            return;
        }
        for associated in heard {
            let anchor = associated.scan.anchor;
            let Some(sight) = self.sight(anchor, tag_height_m) else { continue };
            let Some(viewpoint) = self.viewpoint(anchor, tag_height_m) else { continue };
            let background = self.background(anchor);
            let AssociatedScan { scan, claims, beliefs, .. } = associated;
            let free = &beliefs.unassociated;
            let known_m = associated.features().map(|(regression, _)| regression.range_m);
            let resolution_m = self.resolution_m(scan);
            self.discovery.observe(
                anchor,
                &viewpoint,
                &scan.measurements,
                claims,
                free,
                &background,
                known_m,
                resolution_m,
            );
            while let Some(found) = self.discovery.take_resolved(anchor) {
                self.take_in(scan, &sight, &found, report);
            }
        }
    }

    /// How far apart two paths of a scan must be to be told apart, metres; 0 where the scan has ranges alone.
    fn resolution_m(&self, scan: &Scan<PATHS>) -> f32 {
        match self.library.get(scan.action) {
            Some(action) if scan.framed => action.pulse_duration_s * SPEED_OF_LIGHT_M_S,
            _ => 0.0,
        }
    }

    /// From where an anchor's candidates are seen.
    pub(super) fn viewpoint(&self, anchor: usize, tag_height_m: Option<f32>) -> Option<Viewpoint> {
        let sight = self.sight(anchor, tag_height_m)?;
        let (bias_m, _) = self.filter.bias_m(anchor)?;
        let direct = self.filter.regress(Source::Direct { anchor }, &sight)?;
        Some(Viewpoint {
            agent: self.filter.agent(),
            height_m: sight.height_m,
            bias_m,
            direct_m: direct.range_m,
            direct_variance_m2: direct.variance_m2(),
        })
    }

    /// What the candidates of an anchor compete with.
    pub(super) fn background(&self, anchor: usize) -> Background {
        let per_m = 1.0 / self.config.ranging.max_range_m;
        let settings = &self.config.association;
        Background {
            all_per_m: self.unexplained.get(anchor).copied().unwrap_or(0.0) * per_m,
            false_alarms_per_m: settings.clutter_per_anchor * per_m,
            detection_probability: settings.detection_probability,
        }
    }

    /// Forgets the younger of two virtual anchors of an anchor that are one.
    fn merge(&mut self, report: &mut CycleReport) {
        for slot in 0..VAS {
            let Some(record) = self.environment.get(slot).copied() else { continue };
            let Some((a, c)) = self.filter.virtual_anchor(slot) else { continue };
            let is_same = |(other, twin): (usize, &Record)| {
                let (b, d) = self.filter.virtual_anchor(other)?;
                let (dx, dy) = (b.x - a.x, b.y - a.y);
                let (xx, yx, yy) = (c.m11 + d.m11, c.m21 + d.m21, c.m22 + d.m22);
                let form = yy * (dx * dx) - 2.0 * (yx * (dx * dy)) + xx * (dy * dy);
                let near = dx * dx + dy * dy < NEAR_M * NEAR_M && form < xx * yy - yx * yx;
                let older = twin.hits > record.hits || (twin.hits == record.hits && other < slot);
                (twin.anchor == record.anchor && other != slot && near && older).then_some(())
            };
            let doubled = record.hits > 0 && self.environment.iter().any(|entry| is_same(entry).is_some());
            if doubled {
                self.environment.remove(slot);
                self.take_out(slot, report);
            }
        }
    }

    /// Forgets a virtual anchor outside the environment memory.
    fn take_out(&mut self, slot: usize, report: &mut CycleReport) {
        self.filter.remove(slot);
        self.channel.forget(slot);
        report.forgotten += 1;
    }

    /// Enters a discovery into the map, in the place of the virtual anchor that tells least if there is no other.
    fn take_in(&mut self, scan: &Scan<PATHS>, sight: &Sight, found: &Discovered, report: &mut CycleReport) {
        let anchor = scan.anchor;
        if self.is_known(anchor, sight, found) {
            return;
        }
        let mut slot = self.environment.free_slot();
        if slot.is_none() {
            let detections = self.detections(scan);
            slot = self.environment.give_way(&detections);
            if let Some(slot) = slot {
                self.take_out(slot, report);
            }
        }
        let Some(slot) = slot else {
            report.map_full += 1;
            return;
        };
        self.filter.insert_relative(slot, found.position, &found.gain, &found.covariance);
        self.environment.insert(slot, anchor, 0.9, 1);
        report.discovered += 1;
    }

    /// Whether a discovery lies within 0.3 m of the anchor or of one of its virtual anchors.
    fn is_known(&self, anchor: usize, sight: &Sight, found: &Discovered) -> bool {
        let near = |x: f32, y: f32| {
            let (dx, dy) = (found.position.x - x, found.position.y - y);
            dx * dx + dy * dy < NEAR_M * NEAR_M
        };
        let [x, y] = sight.anchor_m;
        near(x, y)
            || self.environment.iter().any(|(slot, record)| {
                record.anchor == anchor
                    && self.filter.virtual_anchor(slot).is_some_and(|(a, _)| near(a.x, a.y))
            })
    }
}
