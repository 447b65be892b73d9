//! Loss: whether the tag is still where the state filter believes it to be.
//!
//! Every scan that arrives should show the direct path and the virtual anchors that exist, each with its detection
//! probability. Where over the last scans far less was found than expected, the tag is elsewhere: a wrong place
//! explains next to nothing. Where the prediction has become too wide for one Gaussian, it is as good as lost.

/// Forgetting of both counts per cycle with measurements: the last ten cycles count.
const FORGETTING: f32 = 0.9;
/// Expected detections from which on the counts mean something.
const ENOUGH: f32 = 3.0;
/// Share of the expected detections below which the tag is lost.
const LEAST_SHARE: f32 = 0.3;
/// Sum of the position's variances beyond which one Gaussian cannot be updated by ranges any more, square metres.
const WIDEST_M2: f32 = 2.0;

/// The loss monitor.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LossMonitor {
    expected: f32,
    found: f32,
}

impl LossMonitor {
    /// Enters a cycle with measurements: the number of detections expected and found.
    pub fn observe(&mut self, expected: f32, found: f32) {
        self.expected = FORGETTING * self.expected + expected;
        self.found = FORGETTING * self.found + found;
    }

    /// Whether far less was found than expected.
    pub fn is_lost(&self) -> bool {
        self.expected > ENOUGH && self.found < LEAST_SHARE * self.expected
    }

    /// Whether a position of these variances (xx, yy; square metres) is too uncertain to be tracked.
    pub fn is_too_wide(xx: f32, yy: f32) -> bool {
        xx + yy > WIDEST_M2
    }

    /// Every number of the state, in a fixed order, for traces.
    pub fn visit(&self, mut f: impl FnMut(f32)) {
        f(self.expected);
        f(self.found);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tag_that_is_heard_as_expected_is_not_lost_and_one_that_is_not_is_within_fifteen_cycles() {
        let mut monitor = LossMonitor::default();
        assert!(!monitor.is_lost());
        for _ in 0..100 {
            monitor.observe(5.7, 4.0);
            assert!(!monitor.is_lost());
        }
        let cycles = (1..).find(|_| {
            monitor.observe(5.7, 0.3);
            monitor.is_lost()
        });
        assert!(cycles.is_some_and(|cycles| cycles <= 15), "{cycles:?}");
    }
}
