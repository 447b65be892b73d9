//! Sources of paths: an anchor's direct path and its virtual anchors, and how the anchor is seen.

/// Where a path comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Source {
    /// The direct path of physical anchor `anchor`.
    Direct {
        /// Index of the anchor.
        anchor: usize,
    },
    /// The virtual anchor in slot `slot`, belonging to physical anchor `anchor`.
    Virtual {
        /// Index of the anchor.
        anchor: usize,
        /// Slot of the virtual anchor.
        slot: usize,
    },
}

impl Source {
    /// Index of the physical anchor.
    pub fn anchor(&self) -> usize {
        match *self {
            Source::Direct { anchor } | Source::Virtual { anchor, .. } => anchor,
        }
    }
}

/// Geometry of one measurement: the fixed position of the anchor (for direct paths) and its height above the tag.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sight {
    /// Position of the physical anchor, metres.
    pub anchor_m: [f32; 2],
    /// Height of the physical anchor above the tag, metres; 0 where ranges are horizontal.
    pub height_m: f32,
    /// Standard deviation of that height, metres.
    pub height_std_m: f32,
    /// Where the antenna is on the body of the tag: ahead of its centre and to its left, metres.
    pub lever_arm_m: [f32; 2],
}
