// What a device is told of DW3000 office: made by `cogmint plan`.
use cogmint_core::{Anchor, Map, Plan, PlanSegment, PlanWall};

/// The anchors.
pub const ANCHORS: [Anchor; 4] = [
    // south-west
    Anchor { position_m: [0.3, 0.3], height_m: 2.5 },
    // south-east
    Anchor { position_m: [8.7, 0.3], height_m: 2.5 },
    // north-east
    Anchor { position_m: [8.7, 6.7], height_m: 2.5 },
    // north-west
    Anchor { position_m: [0.3, 6.7], height_m: 2.5 },
];

/// Corners of the outline, metres.
pub const OUTLINE_M: [[f32; 2]; 4] = [
    [0.0, 0.0],
    [9.0, 0.0],
    [9.0, 7.0],
    [0.0, 7.0],
];

/// The walls.
pub const WALLS: [PlanWall; 6] = [
    PlanWall { offset_std_m: 0.05, rotation_std_rad: 0.008726646 },
    PlanWall { offset_std_m: 0.05, rotation_std_rad: 0.008726646 },
    PlanWall { offset_std_m: 0.05, rotation_std_rad: 0.008726646 },
    PlanWall { offset_std_m: 0.05, rotation_std_rad: 0.008726646 },
    PlanWall { offset_std_m: 0.05, rotation_std_rad: 0.008726646 },
    PlanWall { offset_std_m: 0.05, rotation_std_rad: 0.008726646 },
];

/// What they consist of.
pub const SEGMENTS: [PlanSegment; 6] = [
    PlanSegment { wall: 0, ends_m: [[0.0, 0.0], [9.0, 0.0]] },
    PlanSegment { wall: 1, ends_m: [[9.0, 0.0], [9.0, 7.0]] },
    PlanSegment { wall: 2, ends_m: [[9.0, 7.0], [0.0, 7.0]] },
    PlanSegment { wall: 3, ends_m: [[0.0, 7.0], [0.0, 0.0]] },
    PlanSegment { wall: 4, ends_m: [[5.5, 0.0], [5.5, 2.8]] },
    PlanSegment { wall: 5, ends_m: [[1.5, 6.5], [4.0, 6.5]] },
];

/// The plan. The core lists these sources, the most useful first:
///
/// - north-east, wall 3
/// - north-west, wall 1
/// - north-west, wall 0
/// - north-east, wall 0
/// - south-east, wall 2
/// - south-east, wall 3
/// - north-east, wall 1
/// - south-east, wall 1
/// - south-west, wall 3
/// - north-west, wall 3
/// - south-west, wall 2
/// - south-west, wall 1
/// - north-west, wall 2
/// - north-east, wall 2
/// - south-east, wall 0
/// - south-west, wall 0
/// - north-east, walls 1 and 3
/// - north-west, walls 3 and 1
/// - north-west, walls 2 and 0
/// - north-east, walls 2 and 3
/// - north-west, walls 0 and 3
/// - north-east, walls 0 and 3
/// - south-west, walls 0 and 3
/// - south-east, walls 2 and 0
pub const PLAN: Plan<'static> = Plan {
    outline_m: &OUTLINE_M,
    walls: &WALLS,
    segments: &SEGMENTS,
    turn_std_rad: 0.008726646,
    reflections: 2,
    most_sources: 24,
};

/// What the tracker is told.
pub const MAP: Map<'static> = Map { virtual_anchors: &[], plan: Some(PLAN) };
