//! What the memories keep of a cycle.

use super::Tracker;
use super::associate::AssociatedScan;
use super::receive::Scan;
use crate::memory::environment::CONFIRMED;
use crate::perceptor::association::Belief;
use crate::perceptor::state_filter::Source;
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
            for (regression, belief) in associated.features() {
                if self.loss.is_doubtful() {
                    // What is missing from here may be where it was: the tag is not.
                    break;
                }
                if let Source::Virtual { slot, .. } = regression.source {
                    let detection = self.detection(regression.source, scan);
                    self.environment.remember(slot, belief.existence, belief.missed < 0.5, detection);
                }
                self.remember_channel(regression.source, scan, belief);
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

    /// SINR of a source from what one scan showed of it.
    fn remember_channel(&mut self, source: Source, scan: &Scan<PATHS>, belief: &Belief<PATHS>) {
        for (measurement, &weight) in scan.measurements.iter().zip(&belief.associated) {
            if weight > 0.5 && measurement.sinr > 0.0 {
                self.channel.remember(source, scan.action, self.controller.library(), measurement, weight);
            }
        }
        let exists = match source {
            Source::Direct { .. } => true,
            Source::Virtual { slot, .. } => {
                self.environment.get(slot).is_some_and(|record| record.existence > CONFIRMED)
            }
        };
        if scan.framed && exists && belief.missed > 0.5 {
            self.channel.remember_missed(source, scan.action, self.controller.library(), belief.missed);
        }
    }
}
