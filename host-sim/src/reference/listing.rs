//! TEMPORARY: until the one of branch `avail` is here.

use super::plan::FloorPlan;
use cogmint_core::Anchor;

/// A source.
#[derive(Clone, Copy, Debug)]
pub struct Listed {
    /// Anchor.
    pub anchor: usize,
    /// First.
    pub first: usize,
    /// Second.
    pub second: Option<usize>,
    /// Order.
    pub is_either_order: bool,
}

/// List.
pub fn list<T>(
    _plan: &FloorPlan<T>,
    _anchors: &[Anchor],
    _reflections: usize,
    _max_range_m: T,
    _most_walls: usize,
    _most: usize,
) -> Vec<Listed> {
    Vec::new()
}
