//! Capacities, which are fixed when the library is built.

/// Anchors at most.
#[cfg(not(feature = "ranges"))]
pub const COGMINT_MOST_ANCHORS: usize = 2;
/// Anchors at most.
#[cfg(feature = "ranges")]
pub const COGMINT_MOST_ANCHORS: usize = 4;

/// Surfaces at most: walls, and virtual anchors whose walls are not known.
pub const COGMINT_MOST_SURFACES: usize = 8;

/// Sources at most: virtual anchors told, found or shown by the walls.
#[cfg(not(feature = "ranges"))]
pub const COGMINT_MOST_SOURCES: usize = 24;
/// Sources at most: virtual anchors told, found or shown by the walls.
#[cfg(feature = "ranges")]
pub const COGMINT_MOST_SOURCES: usize = 12;

/// Walls, segments of walls and corners of the outline at most, of each.
pub const COGMINT_MOST_SEGMENTS: usize = 32;

/// Paths or ranges of an anchor that a cycle keeps; what is received beyond them is counted and left out.
#[cfg(not(feature = "ranges"))]
pub const COGMINT_MOST_PATHS: usize = 16;
/// Paths or ranges of an anchor that a cycle keeps; what is received beyond them is counted and left out.
#[cfg(feature = "ranges")]
pub const COGMINT_MOST_PATHS: usize = 8;

/// Actions (carriers and pulses) at most.
#[cfg(not(feature = "ranges"))]
pub const COGMINT_MOST_ACTIONS: usize = 40;
/// Actions (carriers and pulses) at most.
#[cfg(feature = "ranges")]
pub const COGMINT_MOST_ACTIONS: usize = 6;

/// Places where the tag may be that are followed at a time, at most.
pub const COGMINT_MOST_COMPONENTS: usize = 8;

/// Points of what paths leave of a frame: 0 where frames are read no further than to their paths.
#[cfg(not(feature = "ranges"))]
pub const COGMINT_MOST_POINTS: usize = 800;
/// Points of what paths leave of a frame: 0 where frames are read no further than to their paths.
#[cfg(feature = "ranges")]
pub const COGMINT_MOST_POINTS: usize = 0;

/// Candidates for virtual anchors that nobody told of, per anchor, at most.
pub const COGMINT_MOST_CANDIDATES: usize = 6;

/// Ranges that one call of cogmint_receive_ranges takes at most.
pub const COGMINT_MOST_RANGES: usize = 64;

/// Samples of a window of the accumulator at most.
pub const COGMINT_MOST_CIR_SAMPLES: usize = 256;

/// Samples of a pulse's autocorrelation.
pub const COGMINT_PULSE_SAMPLES: usize = 33;

/// Bytes of memory that a tracker is sure to fit in. cogmint_tracker_size() tells how many it takes.
#[cfg(all(not(feature = "ranges"), target_pointer_width = "32"))]
pub const COGMINT_TRACKER_SIZE: usize = 41984;
/// Bytes of memory that a tracker is sure to fit in. cogmint_tracker_size() tells how many it takes.
#[cfg(all(not(feature = "ranges"), target_pointer_width = "64"))]
pub const COGMINT_TRACKER_SIZE: usize = 42496;
/// Bytes of memory that a tracker is sure to fit in. cogmint_tracker_size() tells how many it takes.
#[cfg(all(feature = "ranges", target_pointer_width = "32"))]
pub const COGMINT_TRACKER_SIZE: usize = 50944;
/// Bytes of memory that a tracker is sure to fit in. cogmint_tracker_size() tells how many it takes.
#[cfg(all(feature = "ranges", target_pointer_width = "64"))]
pub const COGMINT_TRACKER_SIZE: usize = 51968;

/// Alignment of that memory, bytes.
pub const COGMINT_TRACKER_ALIGN: usize = 8;
