//! Whether the tag is where the filter believes it to be: detections expected and found, with forgetting.

use super::real::Real;

const FORGETTING: f32 = 0.9;
const ENOUGH: f32 = 3.0;
const LEAST_SHARE: f32 = 0.3;
const WIDEST_M2: f32 = 2.0;

/// The two counts.
#[derive(Clone, Copy, Debug)]
pub struct LossMonitor<T> {
    /// Detections expected.
    pub expected: T,
    /// Detections found.
    pub found: T,
}

impl<T: Real> LossMonitor<T> {
    /// Nothing counted yet.
    pub fn new() -> Self {
        Self { expected: T::ZERO, found: T::ZERO }
    }

    /// Enters a cycle.
    pub fn observe(&mut self, expected: T, found: T) {
        self.expected = T::of(FORGETTING) * self.expected + expected;
        self.found = T::of(FORGETTING) * self.found + found;
    }

    /// Far less found than expected.
    pub fn is_lost(&self) -> bool {
        self.expected > T::of(ENOUGH) && self.found < T::of(LEAST_SHARE) * self.expected
    }

    /// Too uncertain for one Gaussian.
    pub fn is_too_wide(xx: T, yy: T) -> bool {
        xx + yy > T::of(WIDEST_M2)
    }
}

impl<T: Real> Default for LossMonitor<T> {
    fn default() -> Self {
        Self::new()
    }
}
