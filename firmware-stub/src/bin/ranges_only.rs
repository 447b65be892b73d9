//! The same as `cogmint-firmware` for three anchors of which ranges alone are received: what a tracker without channel estimator,
//! map and planning takes of flash and of RAM.

#![no_std]
#![no_main]

use cogmint_board::replay::replay;
use cogmint_board::{Once, host};
use cogmint_core::RangeTracker;
use core::cell::UnsafeCell;
use cortex_m_rt::entry;

/// 3 anchors, 2 ranges of each, 4 components; one action, which is not chosen.
type BoardTracker = RangeTracker<3, 2, 4>;

static TRACKER: Once<BoardTracker> = Once(UnsafeCell::new(BoardTracker::empty()));

#[entry]
fn main() -> ! {
    // SAFETY: see `Once`.
    let tracker = unsafe { &mut *TRACKER.0.get() };
    host::end(replay::<3, 0, 0, 0, 2, 1, 4, 0, 0, 0, 6>(tracker, &mut []))
}
