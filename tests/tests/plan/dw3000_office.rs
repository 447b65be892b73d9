// What a device is told of DW3000 office: made by `cogmint plan`.
use cogmint_core::{Anchor, MappedVirtualAnchor};

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

/// The virtual anchors that follow from the plan's walls, the most useful first.
pub const VIRTUAL_ANCHORS: [MappedVirtualAnchor; 24] = [
    // north-west, wall 0
    MappedVirtualAnchor { anchor: 3, position_m: [0.3, -6.7], std_m: 0.120515 },
    // south-west, walls 3 and 0
    MappedVirtualAnchor { anchor: 0, position_m: [-0.3, -0.3], std_m: 0.122866794 },
    // south-west, wall 0
    MappedVirtualAnchor { anchor: 0, position_m: [0.3, -0.3], std_m: 0.08775211 },
    // south-east, wall 0
    MappedVirtualAnchor { anchor: 1, position_m: [8.7, -0.3], std_m: 0.08775211 },
    // north-east, wall 0
    MappedVirtualAnchor { anchor: 2, position_m: [8.7, -6.7], std_m: 0.120515 },
    // south-east, walls 1 and 0
    MappedVirtualAnchor { anchor: 1, position_m: [9.3, -0.3], std_m: 0.122866794 },
    // north-west, walls 3 and 0
    MappedVirtualAnchor { anchor: 3, position_m: [-0.3, -6.7], std_m: 0.14805296 },
    // north-west, wall 3
    MappedVirtualAnchor { anchor: 3, position_m: [-0.3, 6.7], std_m: 0.08107619 },
    // south-west, wall 3
    MappedVirtualAnchor { anchor: 0, position_m: [-0.3, 0.3], std_m: 0.08107619 },
    // north-east, walls 1 and 0
    MappedVirtualAnchor { anchor: 2, position_m: [9.3, -6.7], std_m: 0.14805296 },
    // north-east, wall 1
    MappedVirtualAnchor { anchor: 2, position_m: [9.3, 6.7], std_m: 0.08107619 },
    // north-east, wall 2
    MappedVirtualAnchor { anchor: 2, position_m: [8.7, 7.3], std_m: 0.08775211 },
    // north-east, walls 1 and 2
    MappedVirtualAnchor { anchor: 2, position_m: [9.3, 7.3], std_m: 0.122866794 },
    // south-east, wall 1
    MappedVirtualAnchor { anchor: 1, position_m: [9.3, 0.3], std_m: 0.08107619 },
    // north-west, walls 3 and 2
    MappedVirtualAnchor { anchor: 3, position_m: [-0.3, 7.3], std_m: 0.122866794 },
    // north-east, wall 3
    MappedVirtualAnchor { anchor: 2, position_m: [-8.7, 6.7], std_m: 0.13449122 },
    // north-east, walls 0 and 3
    MappedVirtualAnchor { anchor: 2, position_m: [-8.7, -6.7], std_m: 0.21656017 },
    // north-west, wall 2
    MappedVirtualAnchor { anchor: 3, position_m: [0.3, 7.3], std_m: 0.08775211 },
    // north-east, walls 2 and 3
    MappedVirtualAnchor { anchor: 2, position_m: [-8.7, 7.3], std_m: 0.16256696 },
    // north-west, walls 2 and 0
    MappedVirtualAnchor { anchor: 3, position_m: [0.3, -7.3], std_m: 0.15330914 },
    // south-west, wall 5
    MappedVirtualAnchor { anchor: 0, position_m: [0.3, 12.7], std_m: 0.10848493 },
    // south-east, wall 3
    MappedVirtualAnchor { anchor: 1, position_m: [-8.7, 0.3], std_m: 0.13449122 },
    // south-east, walls 0 and 3
    MappedVirtualAnchor { anchor: 1, position_m: [-8.7, -0.3], std_m: 0.16256696 },
    // south-east, wall 2
    MappedVirtualAnchor { anchor: 1, position_m: [8.7, 13.7], std_m: 0.120515 },
];

/// Corners of the outline, metres.
pub const OUTLINE_M: [[f32; 2]; 4] = [
    [0.0, 0.0],
    [9.0, 0.0],
    [9.0, 7.0],
    [0.0, 7.0],
];

/// Segments of the walls: index of the wall, and both ends, metres.
pub const WALL_SEGMENTS_M: [(usize, [[f32; 2]; 2]); 6] = [
    (0, [[0.0, 0.0], [9.0, 0.0]]),
    (1, [[9.0, 0.0], [9.0, 7.0]]),
    (2, [[9.0, 7.0], [0.0, 7.0]]),
    (3, [[0.0, 7.0], [0.0, 0.0]]),
    (4, [[5.5, 0.0], [5.5, 2.8]]),
    (5, [[1.5, 6.5], [4.0, 6.5]]),
];

/// Per wall the standard deviations of its offset, metres, and of its rotation, radians.
pub const WALL_DEVIATIONS: [[f32; 2]; 6] = [
    [0.05, 0.008726646],
    [0.05, 0.008726646],
    [0.05, 0.008726646],
    [0.05, 0.008726646],
    [0.05, 0.008726646],
    [0.05, 0.008726646],
];
