//! The same as `cogmint-firmware` for one DW3000 anchor and a known room: what a small tracker takes of RAM.

#![no_std]
#![no_main]

use cogmint_board::replay::replay;
use cogmint_board::{Once, host};
use cogmint_core::Tracker;
use cogmint_core::model::observation::Complex;
use core::cell::UnsafeCell;
use cortex_m_rt::entry;

/// 1 anchor, 4 surfaces, 8 sources, 8 segments, 8 paths, 2 actions, 4 components, 256 points; nothing is looked for.
type BoardTracker = Tracker<1, 4, 8, 8, 8, 2, 4, 256, 0>;

static TRACKER: Once<BoardTracker> = Once(UnsafeCell::new(Tracker::new()));

/// The samples of one cycle.
static FRAMES: Once<[Complex; 128]> = Once(UnsafeCell::new([[0.0; 2]; 128]));

#[entry]
fn main() -> ! {
    // SAFETY: see `Once`.
    let (tracker, samples) = unsafe { (&mut *TRACKER.0.get(), &mut *FRAMES.0.get()) };
    // A frame and ranges of every anchor.
    host::end(replay::<1, 4, 8, 8, 8, 2, 4, 256, 0, 1, 2>(tracker, samples))
}
