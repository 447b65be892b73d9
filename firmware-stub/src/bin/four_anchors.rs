//! The same as `cogmint-firmware` for four DW3000 anchors and a plan of six walls: what a smaller tracker takes of RAM.

#![no_std]
#![no_main]

use cogmint_board::replay::replay;
use cogmint_board::{Once, host};
use cogmint_core::Tracker;
use cogmint_core::model::observation::Complex;
use core::cell::UnsafeCell;
use cortex_m_rt::entry;

/// 4 anchors, 6 surfaces, 12 sources, 8 segments, 8 paths, 2 actions, 4 components, 256 points, 2 candidates.
type BoardTracker = Tracker<4, 6, 12, 8, 8, 2, 4, 256, 2>;

static TRACKER: Once<BoardTracker> = Once(UnsafeCell::new(Tracker::new()));

/// The samples of one cycle.
static FRAMES: Once<[Complex; 4 * 128]> = Once(UnsafeCell::new([[0.0; 2]; 4 * 128]));

#[entry]
fn main() -> ! {
    // SAFETY: see `Once`.
    let (tracker, samples) = unsafe { (&mut *TRACKER.0.get(), &mut *FRAMES.0.get()) };
    // A frame and ranges of every anchor.
    host::end(replay::<4, 6, 12, 8, 8, 2, 4, 256, 2, 1, 8>(tracker, samples))
}
