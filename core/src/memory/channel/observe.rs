//! What the channel memory keeps of a scan.

use super::{ChannelMemory, Shares, jump};
use crate::model::range::Regression;
use crate::model::source::Source;
use crate::perceptor::association::Belief;
use crate::perceptor::association::outcome::AssociatedScan;
use crate::perceptor::scan::Scan;
use crate::radio::library::Library;
use crate::real::larger;

impl<const ANCHORS: usize, const SOURCES: usize, const ACTIONS: usize>
    ChannelMemory<ANCHORS, SOURCES, ACTIONS>
{
    /// Visibility of every source of a scan of ranges, of which it is known only whether they are there.
    pub fn observe_ranges<const PATHS: usize>(&mut self, associated: &AssociatedScan<'_, SOURCES, PATHS>) {
        for ((regression, belief), view) in associated.features().zip(associated.expected.views()) {
            self.remember_missed(regression.source, view.found, belief.missed, 1.0);
        }
    }

    /// SINR and visibility of every source of a frame whose path was probably seen; from roughly where the tag is (`is_placed` false), what
    /// the noise of the frame tells alone.
    #[inline(never)]
    pub fn observe_frame<const PATHS: usize>(
        &mut self,
        associated: &AssociatedScan<'_, SOURCES, PATHS>,
        library: &Library<ACTIONS>,
        is_placed: bool,
    ) {
        let scan = associated.scan;
        let shares = self.shares(scan.action, library);
        let jump = self.jump(associated);
        for ((regression, belief), view) in associated.features().zip(associated.expected.views()) {
            if is_placed {
                self.observe_source(regression, scan, &shares, belief, jump);
                // Of what was never seen in a frame, it is not known what would be found.
                if self.has_seen(regression.source) {
                    self.remember_missed(regression.source, view.found, belief.missed, belief.rest);
                } else {
                    self.remember_unseen(regression.source, belief.missed, belief.rest);
                }
            } else {
                self.observe_level(regression, scan, &shares, jump);
            }
        }
        self.remember_frame(scan.anchor, &shares);
    }

    /// The tag was found with `found_with`: where that needed another action, the one held may have been jammed, which gain
    /// control had hidden. `images` are the slots of the anchor's virtual anchors.
    pub fn reattribute(
        &mut self,
        anchor: usize,
        images: impl Iterator<Item = usize>,
        [held, found_with]: [usize; 2],
        excess_ln: f32,
        library: &Library<ACTIONS>,
    ) {
        let mut shares = self.shares(held, library);
        // What was found with is quiet, whatever it overlaps.
        if let Some(share) = shares.get_mut(found_with) {
            *share = 0.0;
        }
        self.unmask(Source::Direct { anchor }, &shares, excess_ln);
        for slot in images {
            self.unmask(Source::Virtual { anchor, slot }, &shares, excess_ln);
        }
    }

    /// How far the noise of a frame has changed because interference came or went.
    fn jump<const PATHS: usize>(&self, associated: &AssociatedScan<'_, SOURCES, PATHS>) -> f32 {
        let scan = associated.scan;
        let (mut sum, mut count) = (0.0, 0.0);
        for (regression, _) in associated.features() {
            if let Some(level) = scan.level(regression.range_m)
                && let Some(innovation) = self.noise_innovation_ln(regression.source, scan.action, level)
            {
                sum += innovation;
                count += 1.0;
            }
        }
        jump(sum / larger(count, 1.0))
    }

    fn observe_level<const PATHS: usize>(
        &mut self,
        regression: &Regression,
        scan: &Scan<PATHS>,
        shares: &Shares<ACTIONS>,
        jump: f32,
    ) {
        let Regression { source, range_m, .. } = *regression;
        if let Some(level) = scan.level(range_m) {
            self.remember_noise(source, scan.action, shares, (range_m, level), jump, scan.since_frame_s());
        }
    }

    /// SINR and visibility of a source from what one frame showed of it.
    fn observe_source<const PATHS: usize>(
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
                self.remember(source, scan.action, path, *weight, scan.since_frame_s());
            }
        }
        self.observe_level(regression, scan, shares, jump);
    }
}
