//! The cogmint tracker on a Cortex-M4F.
//!
//! Replays a feed of recorded cycles (written by `cogmint trace --feed FILE`, read from the debugger's host) through
//! the same [`Tracker`] as on the host, and prints for every cycle the hash over all state and the instructions per
//! stage; at the end, how much stack was used since reset. Ends with an error where the stack is used up or a cycle is
//! longer than the counter. `tests/on_target.sh` builds it, runs it in QEMU and compares.

#![no_std]
#![no_main]

use cogmint_board::replay::replay;
use cogmint_board::{Once, host};
use cogmint_core::Tracker;
use cogmint_core::model::observation::Complex;
use core::cell::UnsafeCell;
use cortex_m_rt::entry;

/// Capacity of the reference size: 2 anchors, 8 surfaces, 24 sources, 32 segments, 16 paths, 40 actions, 8 components,
/// 800 points of what paths leave of a frame, 6 candidates.
type BoardTracker = Tracker<2, 8, 24, 32, 16, 40, 8, 800, 6>;

static TRACKER: Once<BoardTracker> = Once(UnsafeCell::new(Tracker::new()));

/// The samples of one cycle.
static FRAMES: Once<[Complex; 2 * 1024]> = Once(UnsafeCell::new([[0.0; 2]; 2 * 1024]));

#[entry]
fn main() -> ! {
    // SAFETY: see `Once`.
    let (tracker, samples) = unsafe { (&mut *TRACKER.0.get(), &mut *FRAMES.0.get()) };
    // A frame and ranges of every anchor.
    host::end(replay::<2, 8, 24, 32, 16, 40, 8, 800, 6, 1, 4>(tracker, samples))
}
