use cogmint_core::{Anchor, MappedVirtualAnchor};
pub const ANCHORS: [Anchor; 0] = [];
pub const VIRTUAL_ANCHORS: [MappedVirtualAnchor; 0] = [];
pub const OUTLINE_M: [[f32; 2]; 0] = [];
