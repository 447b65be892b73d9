//! What the memories keep of a cycle.

use super::Tracker;
use super::associate::AssociatedScan;
use super::receive::Scan;
use crate::controller::Controller;
use crate::memory::channel::{Shares, jump};
use crate::perceptor::association::Belief;
use crate::perceptor::gain_control::GainControl;
use crate::perceptor::state_filter::{Regression, Source};
use crate::real::larger;
use crate::report::CycleReport;
use heapless::Vec;

impl<const ANCHORS: usize, const VAS: usize, const PATHS: usize, const ACTIONS: usize>
    Tracker<ANCHORS, VAS, PATHS, ACTIONS>
{
    /// Existence of virtual anchors, SINR of every source whose path was probably seen, and how much of each scan
    /// nothing explained.
    #[inline(never)]
    pub(super) fn remember(
        &mut self,
        heard: &Vec<AssociatedScan<'_, VAS, PATHS>, ANCHORS>,
        report: &mut CycleReport,
    ) {
        self.channel.age();
        for associated in heard {
            let scan = &associated.scan;
            // What is missing from a doubtful place may be where it was: the tag is not.
            if self.loss.is_doubtful() {
                self.remember_noise(associated);
            } else {
                self.remember_features(associated);
            }
            let mut expected = 0.0;
            report.anchors_heard += 1;
            for (_, &free) in scan.measurements.iter().zip(&associated.beliefs.unassociated) {
                expected += free;
                report.measurements += 1;
                report.associated += u32::from(free <= 0.5);
            }
            if let Some(unexplained) = self.unexplained.get_mut(scan.anchor) {
                let clutter = self.config.association.clutter_per_anchor;
                *unexplained = larger(0.95 * *unexplained + 0.05 * expected, clutter);
            }
        }
    }

    /// Existence, and in frames SINR and visibility, of every feature of a scan.
    fn remember_features(&mut self, associated: &AssociatedScan<'_, VAS, PATHS>) {
        let scan = associated.scan;
        for (regression, belief) in associated.features() {
            if let Source::Virtual { slot, .. } = regression.source {
                let detection = self.detection(regression.source, scan, Some(regression.range_m));
                self.environment.remember(slot, belief.existence, belief.missed < 0.5, detection);
            }
        }
        if !scan.framed {
            return;
        }
        let shares = self.channel.shares(scan.action, &self.library);
        let jump = self.jump(associated);
        for (regression, belief) in associated.features() {
            self.remember_channel(regression, scan, &shares, belief, jump);
        }
        self.channel.remember_frame(scan.anchor, &shares);
    }

    /// What the noise of a frame tells of the SINR of every source, from roughly where the tag is.
    #[inline(never)]
    pub(super) fn remember_noise(&mut self, associated: &AssociatedScan<'_, VAS, PATHS>) {
        let scan = associated.scan;
        // Under gain control, what is heard with an action that a lost tag is sought with cannot be compared yet.
        let sought = self.gain_control.get(scan.anchor).and_then(GainControl::sought_with).is_some();
        if !scan.framed || sought {
            return;
        }
        let shares = self.channel.shares(scan.action, &self.library);
        let jump = self.jump(associated);
        for (regression, _) in associated.features() {
            self.remember_level(regression, scan, &shares, jump);
        }
        self.channel.remember_frame(scan.anchor, &shares);
    }

    /// The tag was found: where that needed another action, the one held may have been jammed, which gain control had hidden.
    pub(super) fn unmask(&mut self, heard: &Vec<AssociatedScan<'_, VAS, PATHS>, ANCHORS>) {
        for scan in heard.iter().map(|associated| associated.scan).filter(|scan| scan.framed) {
            let anchor = scan.anchor;
            let held = self.controller_of(anchor).map_or(0, Controller::held);
            let Some(excess_ln) = self.gain_control.get_mut(anchor).and_then(GainControl::found) else {
                continue;
            };
            let mut shares = self.channel.shares(held, &self.library);
            // What was found with is quiet, whatever it overlaps.
            if let Some(share) = shares.get_mut(scan.action) {
                *share = 0.0;
            }
            self.channel.unmask(Source::Direct { anchor }, &shares, excess_ln);
            for (slot, record) in self.environment.iter().filter(|(_, record)| record.anchor == anchor) {
                let source = Source::Virtual { anchor: record.anchor, slot };
                self.channel.unmask(source, &shares, excess_ln);
            }
        }
    }

    /// How far the noise of a frame has changed because interference came or went.
    fn jump(&self, associated: &AssociatedScan<'_, VAS, PATHS>) -> f32 {
        let scan = associated.scan;
        let (mut sum, mut count) = (0.0, 0.0);
        for (regression, _) in associated.features() {
            if let Some(level) = scan.level(regression.range_m)
                && let Some(innovation) =
                    self.channel.noise_innovation_ln(regression.source, scan.action, level)
            {
                sum += innovation;
                count += 1.0;
            }
        }
        jump(sum / larger(count, 1.0))
    }

    fn remember_level(
        &mut self,
        regression: &Regression,
        scan: &Scan<PATHS>,
        shares: &Shares<ACTIONS>,
        jump: f32,
    ) {
        let Regression { source, range_m, .. } = *regression;
        if let Some(level) = scan.level(range_m) {
            self.channel.remember_noise(source, scan.action, shares, (range_m, level), jump);
        }
    }

    /// SINR and visibility of a source from what one frame showed of it.
    fn remember_channel(
        &mut self,
        regression: &Regression,
        scan: &Scan<PATHS>,
        shares: &Shares<ACTIONS>,
        belief: &Belief<PATHS>,
        jump: f32,
    ) {
        let source = regression.source;
        for (path, weight) in scan.measurements.iter().zip(&belief.associated) {
            if *weight > 0.5 && path.sinr > 0.0 {
                self.channel.remember(source, scan.action, path, *weight);
            }
        }
        self.remember_level(regression, scan, shares, jump);
        let (_, found) = self.expected_sinr(source, scan, Some(regression.range_m));
        self.channel.remember_missed(source, found, belief.missed);
    }
}
