//! TEMP
use super::anchor::Anchor;
use super::plan::FloorPlan;
use heapless::Vec;
/// TEMP
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs)]
pub struct Listed {
    pub anchor: usize,
    pub walls: [Option<u16>; 2],
    pub is_either_order: bool,
    pub seen_share: f32,
}
/// TEMP
pub fn list<const SEGMENTS: usize, const SOURCES: usize>(
    _plan: &FloorPlan<SEGMENTS>,
    _anchors: &[Anchor],
    _reflections: usize,
    _max_range_m: f32,
    _most_walls: usize,
) -> Vec<Listed, SOURCES> {
    Vec::new()
}
