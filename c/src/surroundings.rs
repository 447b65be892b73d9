//! Anchors, actions and the map: what a tracker is told at the start.

use crate::capacity::{COGMINT_MOST_SEGMENTS, COGMINT_MOST_SOURCES};
use crate::error::CogmintError;
use crate::pointer::{shared, slice};
use cogmint_core::radio::library::Action;
use cogmint_core::{Anchor, Map, MappedVirtualAnchor, Plan, PlanSegment, PlanWall};

/// An anchor.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CogmintAnchor {
    /// Horizontal position, metres (within 10 km of the origin).
    pub position_m: [f32; 2],
    /// Height, metres (within 1 km). Counts only in cycles whose tag height is given.
    pub height_m: f32,
}

/// What the radio can be told.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CogmintAction {
    /// Carrier frequency, hertz (0.1e9 to 100e9).
    pub carrier_hz: f32,
    /// Pulse duration, seconds (0.1e-9 to 10e-9).
    pub pulse_duration_s: f32,
}

/// The image of an anchor in a wall, told by its position.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CogmintVirtualAnchor {
    /// Index of the anchor.
    pub anchor: u32,
    /// Position of the image, metres.
    pub position_m: [f32; 2],
    /// Its standard deviation per axis, metres (1e-4 to 100; 0: it is exactly there).
    pub std_m: f32,
}

/// A wall: how far it may be from where it is told. 0 and 0: it is exactly there.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CogmintWall {
    /// Standard deviation of its offset along its normal, metres (0, or 1e-4 to 100).
    pub offset_std_m: f32,
    /// Standard deviation of its rotation about its centre, radians (0, or 1e-6 to 1).
    pub rotation_std_rad: f32,
}

/// A segment of a wall. All segments of a wall are on one line.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CogmintSegment {
    /// Index of its wall.
    pub wall: u32,
    /// Both ends, metres: x and y of the one, then of the other.
    pub ends_m: [[f32; 2]; 2],
}

/// A floor plan.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct CogmintPlan {
    /// Corners of the outline in order, metres: the tag is inside. NULL and 0 where there is none.
    pub outline_m: *const [f32; 2],
    /// How many corners.
    pub corner_count: usize,
    /// The walls, those of the outline among them.
    pub walls: *const CogmintWall,
    /// How many walls.
    pub wall_count: usize,
    /// What the walls consist of.
    pub segments: *const CogmintSegment,
    /// How many segments.
    pub segment_count: usize,
    /// Standard deviation of the angle by which the plan as a whole may be turned, radians (0 to 1).
    pub turn_std_rad: f32,
    /// Reflections per path that are followed: 0 to 2.
    pub reflections: u32,
    /// Images that are listed at most; no more than fit are.
    pub most_sources: u32,
}

/// What is known of the surroundings before the start.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct CogmintMap {
    /// Virtual anchors whose walls are not known. NULL and 0 where there is none.
    pub virtual_anchors: *const CogmintVirtualAnchor,
    /// How many virtual anchors.
    pub virtual_anchor_count: usize,
    /// The floor plan, or NULL.
    pub plan: *const CogmintPlan,
}

impl CogmintAnchor {
    pub(crate) fn core(self) -> Anchor {
        Anchor { position_m: self.position_m, height_m: self.height_m }
    }
}

impl CogmintAction {
    pub(crate) fn core(self) -> Action {
        Action { carrier_hz: self.carrier_hz, pulse_duration_s: self.pulse_duration_s }
    }
}

/// `items` made into the core's, in `room`; the error where they are more.
pub(crate) fn filled<'a, C: Copy, T>(
    room: &'a mut [T],
    items: &[C],
    error: CogmintError,
    core: impl Fn(C) -> T,
) -> Result<&'a [T], CogmintError> {
    let room = room.get_mut(..items.len()).ok_or(error)?;
    for (place, item) in room.iter_mut().zip(items) {
        *place = core(*item);
    }
    Ok(room)
}

/// Does something with the core's map.
///
/// # Safety
/// `map` and all that it points at are as their descriptions say.
pub(crate) unsafe fn with(
    map: &CogmintMap,
    then: impl FnOnce(&Map<'_>) -> Result<(), CogmintError>,
) -> Result<(), CogmintError> {
    // SAFETY: as the caller promises.
    let given = unsafe { slice(map.virtual_anchors, map.virtual_anchor_count)? };
    let mut room =
        [MappedVirtualAnchor { anchor: 0, position_m: [0.0; 2], std_m: 0.0 }; COGMINT_MOST_SOURCES];
    let virtual_anchors = filled(&mut room, given, CogmintError::VirtualAnchorCount, |mapped| {
        let CogmintVirtualAnchor { anchor, position_m, std_m } = mapped;
        MappedVirtualAnchor { anchor: anchor as usize, position_m, std_m }
    })?;
    if map.plan.is_null() {
        return then(&Map { virtual_anchors, plan: None });
    }
    // SAFETY: as the caller promises.
    let plan = unsafe { shared(map.plan)? };
    // SAFETY: as the caller promises.
    let (outline_m, walls, segments) = unsafe {
        (
            slice(plan.outline_m, plan.corner_count)?,
            slice(plan.walls, plan.wall_count)?,
            slice(plan.segments, plan.segment_count)?,
        )
    };
    let mut room = [PlanWall { offset_std_m: 0.0, rotation_std_rad: 0.0 }; COGMINT_MOST_SEGMENTS];
    let walls = filled(&mut room, walls, CogmintError::PlanSize, |wall| {
        let CogmintWall { offset_std_m, rotation_std_rad } = wall;
        PlanWall { offset_std_m, rotation_std_rad }
    })?;
    let mut room = [PlanSegment { wall: 0, ends_m: [[0.0; 2]; 2] }; COGMINT_MOST_SEGMENTS];
    let segments = filled(&mut room, segments, CogmintError::PlanSize, |segment| {
        let CogmintSegment { wall, ends_m } = segment;
        PlanSegment { wall: wall as usize, ends_m }
    })?;
    let plan = Plan {
        outline_m,
        walls,
        segments,
        turn_std_rad: plan.turn_std_rad,
        reflections: plan.reflections as usize,
        most_sources: plan.most_sources as usize,
    };
    then(&Map { virtual_anchors, plan: Some(plan) })
}
