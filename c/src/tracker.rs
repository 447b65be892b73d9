//! The tracker of these capacities, and whether what the header says of it holds.

use crate::capacity::{
    COGMINT_MOST_ACTIONS, COGMINT_MOST_ANCHORS, COGMINT_MOST_CANDIDATES, COGMINT_MOST_COMPONENTS,
    COGMINT_MOST_PATHS, COGMINT_MOST_POINTS, COGMINT_MOST_SEGMENTS, COGMINT_MOST_SOURCES,
    COGMINT_MOST_SURFACES, COGMINT_PULSE_SAMPLES, COGMINT_TRACKER_ALIGN, COGMINT_TRACKER_SIZE,
};

/// A tracker of these capacities.
///
/// cbindgen:ignore
pub(crate) type Tracker = cogmint_core::Tracker<
    COGMINT_MOST_ANCHORS,
    COGMINT_MOST_SURFACES,
    COGMINT_MOST_SOURCES,
    COGMINT_MOST_SEGMENTS,
    COGMINT_MOST_PATHS,
    COGMINT_MOST_ACTIONS,
    COGMINT_MOST_COMPONENTS,
    COGMINT_MOST_POINTS,
    COGMINT_MOST_CANDIDATES,
>;

/// The layout is the compiler's, and another version of it may need a few bytes more or less: a little room, but no more.
const ROOM: usize = 512;
const _: () = assert!(size_of::<Tracker>() <= COGMINT_TRACKER_SIZE);
const _: () = assert!(COGMINT_TRACKER_SIZE - size_of::<Tracker>() < ROOM);
const _: () = assert!(align_of::<Tracker>() <= COGMINT_TRACKER_ALIGN);
const _: () = assert!(COGMINT_PULSE_SAMPLES == cogmint_core::radio::pulse::PULSE_SAMPLES);
