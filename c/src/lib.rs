//! The cogmint tracker for C: `include/cogmint.h` is made of these sources (`header.sh`), and `docs/c.md` says how to use it.
//!
//! Every tracker is in memory of the caller's; there is no heap and no global state. All pointers are checked for NULL and for
//! alignment, all counts against the capacities ([`capacity`]); what else the core refuses becomes a [`CogmintError`]. What cannot be
//! checked is that a pointer points at what its type says: that is the caller's promise, and the only reason for `unsafe` here.

#![cfg_attr(not(test), no_std)]
// Tests run on a host, where a panic is how a test fails.
#![cfg_attr(test, allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::indexing_slicing))]

mod capacity;
mod config;
mod error;
mod pointer;
mod radio;
mod surroundings;
mod tracker;

pub use capacity::*;
pub use config::*;
pub use error::{CogmintError, cogmint_error_string};
pub use radio::*;
pub use surroundings::{
    CogmintAction, CogmintAnchor, CogmintMap, CogmintPlan, CogmintSegment, CogmintVirtualAnchor, CogmintWall,
};

use cogmint_core::model::observation::{Frame, Observation, Range, RangeScan, Samples, TagHeight};
use cogmint_core::radio::library::Action;
use cogmint_core::{Anchor, Config, CycleReport, Map, MapRestored, SnapshotError};
use core::ffi::c_void;
use core::mem::MaybeUninit;
use error::code;
use pointer::{exclusive, put, shared, slice, slice_mut};
use surroundings::{filled, with};
use tracker::Tracker;

/// Bytes of cogmint_report.
pub const COGMINT_REPORT_SIZE: usize = 140;
const _: () = assert!(size_of::<CogmintReport>() == COGMINT_REPORT_SIZE);

/// A tracker, in the memory that cogmint_start was given.
pub struct CogmintTracker {
    _opaque: (),
}

/// What samples are.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CogmintSamples {
    /// In-phase part and quadrature, two numbers per sample.
    Complex = 0,
    /// Amplitude alone, one number per sample, not negative.
    Magnitude = 1,
}

/// A frame: one received channel impulse response.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct CogmintFrame {
    /// Index of the anchor.
    pub anchor: u32,
    /// Index of the action that it was received with.
    pub action: u32,
    /// Not 0: `sequence` counts. The anchor's last value again is refused as a duplicate.
    pub has_sequence: u32,
    /// The radio's frame counter.
    pub sequence: u32,
    /// Propagation delay that the first sample stands for, seconds; may be negative.
    pub first_sample_delay_s: f32,
    /// A cogmint_samples.
    pub kind: u32,
    /// The numbers.
    pub samples: *const f32,
    /// How many samples: half as many as numbers where they are complex.
    pub sample_count: usize,
}

/// A range that somebody else estimated.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CogmintRange {
    /// Distance, metres.
    pub range_m: f32,
    /// Variance, square metres ((1 mm)^2 to (100 m)^2).
    pub variance_m2: f32,
}

/// The tag's height.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CogmintTagHeight {
    /// Mean, metres.
    pub mean_m: f32,
    /// Standard deviation, metres (0 to 100).
    pub std_m: f32,
}

/// What a cycle did.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CogmintReport {
    /// Number of the cycle, from 0.
    pub cycle: u32,
    /// Position, metres: of the leading place.
    pub position_m: [f32; 2],
    /// Its covariance over all places that the tag may be at, square metres: of xx, xy, yy.
    pub position_covariance_m2: [f32; 3],
    /// Velocity, m/s. Meaningless while `searching`.
    pub velocity_m_s: [f32; 2],
    /// Its covariance, m^2/s^2: of xx, xy, yy.
    pub velocity_covariance_m2_s2: [f32; 3],
    /// Probability that the tag is at the leading place.
    pub probability: f32,
    /// Entropy of the position before the measurements, nats.
    pub predicted_entropy_nat: f32,
    /// And after.
    pub entropy_nat: f32,
    /// Reward of the action applied.
    pub reward: f32,
    /// Mean normalised innovation squared of the ranges associated: near 1 where the filter knows how wrong it is.
    pub nis: f32,
    /// Anchors heard.
    pub anchors_heard: u32,
    /// Paths or ranges received and kept.
    pub measurements: u32,
    /// Paths or ranges left out because no more than COGMINT_MOST_PATHS are kept.
    pub left_out: u32,
    /// What the cycle has cost, about in instructions of a Cortex-M4F.
    pub work: u32,
    /// Frames whose estimate was ended for its work: weak paths may be missing.
    pub cut_short: u32,
    /// Places that counted and found no room among those that are followed.
    pub crowded_out: u32,
    /// Of the measurements, how many belong to something known.
    pub associated: u32,
    /// 1 while it is not known where the tag is.
    pub searching: u32,
    /// 1 where that is so since this cycle.
    pub lost: u32,
    /// Virtual anchors discovered in this cycle.
    pub discovered: u32,
    /// Virtual anchors forgotten in this cycle.
    pub forgotten: u32,
    /// Discoveries dropped because the map was full.
    pub map_full: u32,
    /// Index of the action applied.
    pub action: u32,
    /// Index of the next action.
    pub next_action: u32,
    /// Index of the action after that, which the next frame is to announce; COGMINT_NO_INDEX where nothing is announced.
    pub announced_action: u32,
    /// The next action.
    pub next: CogmintAction,
    /// Parts of the state in which a bit has flipped, one bit each; 0 where all is as it was.
    pub flipped: u32,
    /// Parts that were reset because of that.
    pub reset: u32,
}

impl CogmintReport {
    fn of(report: &CycleReport) -> Self {
        let (position, velocity) = (report.position_covariance_m2, report.velocity_covariance_m2_s2);
        Self {
            cycle: report.cycle,
            position_m: report.position_m,
            position_covariance_m2: [position.m11, position.m12, position.m22],
            velocity_m_s: report.velocity_m_s,
            velocity_covariance_m2_s2: [velocity.m11, velocity.m12, velocity.m22],
            probability: report.probability,
            predicted_entropy_nat: report.predicted_entropy_nat,
            entropy_nat: report.entropy_nat,
            reward: report.reward,
            nis: report.nis,
            anchors_heard: report.anchors_heard,
            measurements: report.measurements,
            left_out: report.left_out,
            work: report.work,
            cut_short: report.cut_short,
            crowded_out: report.crowded_out,
            associated: report.associated,
            searching: u32::from(report.searching),
            lost: u32::from(report.lost),
            discovered: report.discovered,
            forgotten: report.forgotten,
            map_full: report.map_full,
            action: report.action as u32,
            next_action: report.next_action as u32,
            announced_action: report.announced_action.map_or(COGMINT_NO_INDEX, |action| action as u32),
            next: CogmintAction {
                carrier_hz: report.next.carrier_hz,
                pulse_duration_s: report.next.pulse_duration_s,
            },
            flipped: u32::from(report.integrity.flipped.bits()),
            reset: u32::from(report.integrity.reset.bits()),
        }
    }
}

/// What of a map there was room for.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CogmintMapRestored {
    /// Surfaces taken over.
    pub surfaces: u32,
    /// Surfaces left out: there is no room for them, or for any source that is seen in them.
    pub surfaces_left_out: u32,
    /// Sources taken over.
    pub sources: u32,
    /// Sources left out: there is no room for them, or for a surface that they are seen in.
    pub sources_left_out: u32,
}

impl CogmintMapRestored {
    fn of(restored: &MapRestored) -> Self {
        let MapRestored { surfaces, surfaces_left_out, sources, sources_left_out, .. } = *restored;
        Self { surfaces, surfaces_left_out, sources, sources_left_out }
    }
}

/// Bytes of memory that a tracker takes: at most COGMINT_TRACKER_SIZE.
#[unsafe(no_mangle)]
pub extern "C" fn cogmint_tracker_size() -> usize {
    size_of::<Tracker>()
}

/// Alignment of that memory, bytes: at most COGMINT_TRACKER_ALIGN.
#[unsafe(no_mangle)]
pub extern "C" fn cogmint_tracker_align() -> usize {
    align_of::<Tracker>()
}

/// Starts a tracker in `memory`, which holds `length` bytes, and writes it to `tracker`. The memory is the tracker's from then on; the tracker
/// needs no end: the memory may be used for something else, or be started in again, at any time. Everything else is copied and may
/// go. `map` may be NULL: nothing is known of the surroundings. `actions` may be NULL with a count of 0: those of the configuration's
/// radio. `seed`: of all randomness.
///
/// Where it is refused, `tracker` is not written to, and what the memory holds means nothing.
///
/// # Safety
/// All pointers are of what their types say, in the numbers told, or NULL; nothing else uses the memory.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cogmint_start(
    memory: *mut c_void,
    length: usize,
    config: *const CogmintConfig,
    anchors: *const CogmintAnchor,
    anchor_count: usize,
    map: *const CogmintMap,
    actions: *const CogmintAction,
    action_count: usize,
    seed: u64,
    tracker: *mut *mut CogmintTracker,
) -> CogmintError {
    let start = || {
        if memory.is_null() || tracker.is_null() {
            return Err(CogmintError::NullPointer);
        }
        let slot = memory.cast::<MaybeUninit<Tracker>>();
        if length < size_of::<Tracker>() {
            return Err(CogmintError::MemorySize);
        }
        // SAFETY: long enough; alignment is checked; the rest is the caller's promise, and what is there may be anything.
        let started = unsafe { exclusive(slot)? }.write(Tracker::new());
        // SAFETY: as the caller promises.
        unsafe { begin(started, config, anchors, anchor_count, map, actions, action_count, seed)? };
        // SAFETY: as the caller promises.
        unsafe { put(tracker, (&raw mut *started).cast()) }
    };
    code(start())
}

/// Starts an empty tracker where it stays.
///
/// # Safety
/// As [`cogmint_start`].
#[inline(never)]
#[allow(clippy::too_many_arguments)] // those of cogmint_start
unsafe fn begin(
    tracker: &mut Tracker,
    config: *const CogmintConfig,
    anchors: *const CogmintAnchor,
    anchor_count: usize,
    map: *const CogmintMap,
    actions: *const CogmintAction,
    action_count: usize,
    seed: u64,
) -> Result<(), CogmintError> {
    // SAFETY: as the caller promises.
    let (config, radio): (Config, CogmintRadio) = unsafe { config::read(config)? };
    // SAFETY: as the caller promises.
    let (anchors, actions) = unsafe { (slice(anchors, anchor_count)?, slice(actions, action_count)?) };
    let mut room = [Anchor { position_m: [0.0; 2], height_m: 0.0 }; COGMINT_MOST_ANCHORS];
    let anchors = filled(&mut room, anchors, CogmintError::AnchorCount, CogmintAnchor::core)?;
    let mut room = [Action { carrier_hz: 0.0, pulse_duration_s: 0.0 }; COGMINT_MOST_ACTIONS];
    let actions = if actions.is_empty() {
        radio_preset(radio).library()
    } else {
        filled(&mut room, actions, CogmintError::ActionCount, CogmintAction::core)?
    };
    let mut start = |map: &Map<'_>| Ok(tracker.start(&config, anchors, map, actions, seed)?);
    if map.is_null() {
        return start(&Map::default());
    }
    // SAFETY: as the caller promises.
    unsafe { with(shared(map)?, start) }
}

/// Tells the range bias of one anchor, before the first cycle: its mean (-10 to 10 m) and standard deviation (0 to 10 m; 0 where it is
/// known exactly). Without, it is that of the configuration.
///
/// # Safety
/// `tracker` is a tracker that was started, or NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cogmint_tell_range_bias(
    tracker: *mut CogmintTracker,
    anchor: u32,
    mean_m: f32,
    std_m: f32,
) -> CogmintError {
    // SAFETY: as the caller promises.
    let tracker = unsafe { exclusive(tracker.cast::<Tracker>()) };
    code(tracker.and_then(|tracker| Ok(tracker.tell_range_bias(anchor as usize, mean_m, std_m)?)))
}

/// From now on everything is received with an antenna that is this far ahead of the centre of the tag's body, and to its left, metres.
/// Between two cycles.
///
/// # Safety
/// `tracker` is a tracker that was started, or NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cogmint_switch_antenna(
    tracker: *mut CogmintTracker,
    ahead_m: f32,
    left_m: f32,
) -> CogmintError {
    // SAFETY: as the caller promises.
    let tracker = unsafe { exclusive(tracker.cast::<Tracker>()) };
    code(tracker.and_then(|tracker| Ok(tracker.switch_antenna([ahead_m, left_m])?)))
}

/// Begins a cycle of the last `elapsed_s` seconds (above 0, at most an hour). `tag_height`: NULL where it is not known.
///
/// # Safety
/// `tracker` is a tracker that was started, or NULL; `tag_height` may be read, or is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cogmint_begin(
    tracker: *mut CogmintTracker,
    elapsed_s: f32,
    tag_height: *const CogmintTagHeight,
) -> CogmintError {
    let begin = || {
        // SAFETY: as the caller promises.
        let tracker = unsafe { exclusive(tracker.cast::<Tracker>())? };
        let height = if tag_height.is_null() {
            None
        } else {
            // SAFETY: as the caller promises.
            let CogmintTagHeight { mean_m, std_m } = *unsafe { shared(tag_height)? };
            Some(TagHeight { mean_m, std_m })
        };
        Ok(tracker.begin(elapsed_s, height)?)
    };
    code(begin())
}

/// Takes a frame of the cycle begun: one of each anchor. The samples are not needed any more afterwards.
///
/// # Safety
/// `tracker` is a tracker that was started, or NULL; `frame` and its samples may be read, or are NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cogmint_receive_frame(
    tracker: *mut CogmintTracker,
    frame: *const CogmintFrame,
) -> CogmintError {
    let receive = || {
        // SAFETY: as the caller promises.
        let tracker = unsafe { exclusive(tracker.cast::<Tracker>())? };
        // SAFETY: as the caller promises.
        let frame = unsafe { shared(frame)? };
        let samples = match frame.kind {
            0 => {
                // SAFETY: as the caller promises: twice as many numbers as samples.
                Samples::Complex(unsafe { slice(frame.samples.cast::<[f32; 2]>(), frame.sample_count)? })
            }
            // SAFETY: as the caller promises.
            1 => Samples::Magnitude(unsafe { slice(frame.samples, frame.sample_count)? }),
            _ => return Err(CogmintError::UnknownChoice),
        };
        let observation = Observation::Frame(Frame {
            anchor: frame.anchor as usize,
            action: frame.action as usize,
            sequence: (frame.has_sequence != 0).then_some(frame.sequence),
            first_sample_delay_s: frame.first_sample_delay_s,
            samples,
        });
        Ok(tracker.receive(&observation)?)
    };
    code(receive())
}

/// Takes all ranges of an anchor in the cycle begun: at most COGMINT_MOST_RANGES, in one call per anchor.
///
/// # Safety
/// `tracker` is a tracker that was started, or NULL; so many `ranges` may be read, or they are NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cogmint_receive_ranges(
    tracker: *mut CogmintTracker,
    anchor: u32,
    ranges: *const CogmintRange,
    range_count: usize,
) -> CogmintError {
    let receive = || {
        // SAFETY: as the caller promises.
        let tracker = unsafe { exclusive(tracker.cast::<Tracker>())? };
        // SAFETY: as the caller promises.
        let given = unsafe { slice(ranges, range_count)? };
        let mut room = [Range { range_m: 0.0, variance_m2: 0.0 }; COGMINT_MOST_RANGES];
        let ranges = filled(&mut room, given, CogmintError::RangeCount, |range: CogmintRange| Range {
            range_m: range.range_m,
            variance_m2: range.variance_m2,
        })?;
        Ok(tracker.receive(&Observation::Ranges(RangeScan { anchor: anchor as usize, ranges }))?)
    };
    code(receive())
}

/// Ends the cycle begun, by what was received since, and writes what was made of it to `report`.
///
/// # Safety
/// `tracker` is a tracker that was started, or NULL; `report` may be written to, or is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cogmint_finish(
    tracker: *mut CogmintTracker,
    report: *mut CogmintReport,
) -> CogmintError {
    let finish = || {
        // SAFETY: as the caller promises.
        let tracker = unsafe { exclusive(tracker.cast::<Tracker>())? };
        // Before anything changes; it may hold anything yet.
        // SAFETY: as the caller promises.
        let report = unsafe { exclusive(report.cast::<MaybeUninit<CogmintReport>>())? };
        report.write(CogmintReport::of(&tracker.finish()?));
        Ok(())
    };
    code(finish())
}

/// Writes a hash over all state to `hash`: the same on every machine after the same input.
///
/// # Safety
/// `tracker` is a tracker that was started, or NULL; `hash` may be written to, or is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cogmint_hash(tracker: *const CogmintTracker, hash: *mut u64) -> CogmintError {
    // SAFETY: as the caller promises.
    let tracker = unsafe { shared(tracker.cast::<Tracker>()) };
    // SAFETY: as the caller promises.
    code(tracker.and_then(|tracker| unsafe { put(hash, tracker.hash()) }))
}

/// Writes the state between two cycles to `buffer`, which has room for `*length` bytes, and the bytes of the snapshot to `length`. What the tracker
/// was told at the start is not in it. With a NULL buffer and a length of 0, COGMINT_ERROR_SNAPSHOT_ROOM and the bytes needed.
///
/// # Safety
/// `tracker` is a tracker that was started, or NULL; `buffer` and `length` may be written to, or are NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cogmint_snapshot(
    tracker: *const CogmintTracker,
    buffer: *mut u8,
    length: *mut usize,
) -> CogmintError {
    // SAFETY: as the caller promises.
    code(unsafe { write_out(tracker, buffer, length, Tracker::snapshot) })
}

/// Has a tracker write bytes to a buffer, and tells how many they are, or would be where there is no room.
///
/// # Safety
/// As [`cogmint_snapshot`].
unsafe fn write_out(
    tracker: *const CogmintTracker,
    buffer: *mut u8,
    length: *mut usize,
    write: impl FnOnce(&Tracker, &mut [u8]) -> Result<usize, SnapshotError>,
) -> Result<(), CogmintError> {
    // SAFETY: as the caller promises.
    let tracker = unsafe { shared(tracker.cast::<Tracker>())? };
    // SAFETY: as the caller promises.
    let length = unsafe { exclusive(length)? };
    // SAFETY: as the caller promises.
    let buffer = unsafe { slice_mut(buffer, *length)? };
    let written = write(tracker, buffer);
    if let Ok(bytes) | Err(SnapshotError::Room { needed: bytes }) = written {
        *length = bytes;
    }
    written?;
    Ok(())
}

/// Goes on from a snapshot: of a tracker that was started with the same, between two cycles. What follows it in `bytes` does no harm.
///
/// # Safety
/// `tracker` is a tracker that was started, or NULL; so many `bytes` may be read, or they are NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cogmint_restore(
    tracker: *mut CogmintTracker,
    bytes: *const u8,
    length: usize,
) -> CogmintError {
    let restore = || {
        // SAFETY: as the caller promises.
        let tracker = unsafe { exclusive(tracker.cast::<Tracker>())? };
        // SAFETY: as the caller promises.
        let bytes = unsafe { slice(bytes, length)? };
        Ok(tracker.restore(bytes)?)
    };
    code(restore())
}

/// Writes the map alone between two cycles to `buffer`, which has room for `*length` bytes, and its bytes to `length`: what was learnt of walls
/// and virtual anchors. Unlike a snapshot it outlives other settings, actions and capacities. With a NULL buffer and a length of 0,
/// COGMINT_ERROR_SNAPSHOT_ROOM and the bytes needed.
///
/// # Safety
/// `tracker` is a tracker that was started, or NULL; `buffer` and `length` may be written to, or are NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cogmint_map_snapshot(
    tracker: *const CogmintTracker,
    buffer: *mut u8,
    length: *mut usize,
) -> CogmintError {
    // SAFETY: as the caller promises.
    code(unsafe { write_out(tracker, buffer, length, Tracker::map_snapshot) })
}

/// Takes over a map: before the first cycle of a tracker that was started with the same anchors and the same map, whatever else is
/// another. What follows it in `bytes` does no harm. Writes to `restored` what there was room for, where that is not NULL.
///
/// COGMINT_ERROR_SNAPSHOT_TOLD: of other anchors or another map told; COGMINT_ERROR_ALREADY_BEGUN: after the first cycle was begun. Nothing
/// has changed then.
///
/// # Safety
/// `tracker` is a tracker that was started, or NULL; so many `bytes` may be read, or they are NULL; `restored` may be written to, or is NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cogmint_map_restore(
    tracker: *mut CogmintTracker,
    bytes: *const u8,
    length: usize,
    restored: *mut CogmintMapRestored,
) -> CogmintError {
    let restore = || {
        // SAFETY: as the caller promises.
        let tracker = unsafe { exclusive(tracker.cast::<Tracker>())? };
        // SAFETY: as the caller promises.
        let bytes = unsafe { slice(bytes, length)? };
        // Before anything changes; it may hold anything yet.
        let room = if restored.is_null() {
            None
        } else {
            // SAFETY: as the caller promises.
            Some(unsafe { exclusive(restored.cast::<MaybeUninit<CogmintMapRestored>>())? })
        };
        let own = CogmintMapRestored::of(&tracker.restore_map(bytes)?);
        if let Some(room) = room {
            room.write(own);
        }
        Ok(())
    };
    code(restore())
}

/// No panic is reachable: with the feature `panics-do-not-link`, a program that reached this one would not link.
#[cfg(not(test))]
#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    #[cfg(feature = "panics-do-not-link")]
    {
        unsafe extern "C" {
            fn cogmint_has_a_reachable_panic() -> !;
        }
        // SAFETY: the symbol does not exist: what reaches this line does not link.
        unsafe { cogmint_has_a_reachable_panic() }
    }
    #[cfg(not(feature = "panics-do-not-link"))]
    loop {
        core::hint::spin_loop();
    }
}

/// What unwinding would call, of which the compiler's own functions for hosts speak. Nothing unwinds.
#[cfg(all(not(test), not(target_os = "none")))]
#[unsafe(no_mangle)]
extern "C" fn rust_eh_personality() {}
