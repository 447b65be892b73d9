//! Anchors: the physical ones, and the virtual ones a floor plan tells of.

use crate::error::Error;
use crate::real::abs;
use crate::snapshot::written;

/// A physical anchor.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Anchor {
    /// Horizontal position, metres (within 10 km of the origin).
    pub position_m: [f32; 2],
    /// Height, metres (within 1 km). Enters only in cycles whose tag height is given.
    pub height_m: f32,
}

/// A virtual anchor known from a floor plan.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct MappedVirtualAnchor {
    /// Index of the physical anchor whose image it is.
    pub anchor: usize,
    /// Position, metres.
    pub position_m: [f32; 2],
    /// Standard deviation per axis, metres (1e-4 to 100); 0 where the position is known exactly: it is then held fixed.
    pub std_m: f32,
}

impl Anchor {
    /// Checks the ranges above.
    pub(crate) fn check(&self, index: usize) -> Result<(), Error> {
        let [x, y] = self.position_m;
        let within = abs(x) <= 1e4 && abs(y) <= 1e4 && abs(self.height_m) <= 1e3;
        if within { Ok(()) } else { Err(Error::Geometry { index }) }
    }
}

impl MappedVirtualAnchor {
    /// Checks the ranges above; `anchors` is the number of physical anchors.
    pub(crate) fn check(&self, index: usize, anchors: usize) -> Result<(), Error> {
        if self.anchor >= anchors {
            return Err(Error::UnknownAnchor { anchor: self.anchor });
        }
        let [x, y] = self.position_m;
        let told = self.std_m == 0.0 || (self.std_m >= 1e-4 && self.std_m <= 100.0);
        let within = abs(x) <= 1e4 && abs(y) <= 1e4 && told;
        if within { Ok(()) } else { Err(Error::Geometry { index }) }
    }
}

written!(Anchor { position_m, height_m });
written!(MappedVirtualAnchor { anchor, position_m, std_m });
