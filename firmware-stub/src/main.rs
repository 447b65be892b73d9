//! The cogmint tracker on a Cortex-M4F.
//!
//! Replays a feed of recorded cycles (written by `cogmint trace --feed FILE`, read from the debugger's host) through
//! the same [`Tracker`] as on the host, and prints for every cycle the hash over all state and the instructions per
//! stage; at the end, how much stack was used. `tests/on_target.sh` builds it, runs it in QEMU and compares.

#![no_std]
#![no_main]

use cogmint_board::feed::Feed;
use cogmint_board::host::{self, Line};
use cogmint_board::meter::{StackMeter, StageMeter};
use cogmint_board::{FRAMES, Once, SAMPLES};
use cogmint_core::Tracker;
use cogmint_core::observation::Complex;
use core::cell::UnsafeCell;
use core::mem::MaybeUninit;
use cortex_m_rt::entry;

/// Capacity of the reference size: 2 anchors, 24 virtual anchors, 16 paths, 40 actions.
type BoardTracker = Tracker<2, 24, 16, 40>;

static TRACKER: Once<MaybeUninit<BoardTracker>> = Once(UnsafeCell::new(MaybeUninit::uninit()));

#[entry]
fn main() -> ! {
    // SAFETY: see `Once`.
    let (tracker, samples) = unsafe { (&mut *TRACKER.0.get(), &mut *FRAMES.0.get()) };
    let done = match Feed::open() {
        Some(feed) => replay(feed, tracker, samples),
        None => {
            host::write(b"error no feed\n");
            false
        }
    };
    host::exit(done)
}

/// Replays the whole feed; false where it is malformed or the core refuses it.
fn replay(mut feed: Feed, slot: &mut MaybeUninit<BoardTracker>, samples: &mut [Complex; SAMPLES]) -> bool {
    let Some(setup) = feed.setup() else {
        host::write(b"error malformed feed\n");
        return false;
    };
    let stack = StackMeter::paint();
    let tracker = match Tracker::new(setup.config, &setup.anchors, &setup.map, &setup.actions, setup.seed) {
        Ok(tracker) => slot.write(tracker),
        Err(_) => {
            host::write(b"error refused set-up\n");
            return false;
        }
    };
    let mut line = Line::new();
    line.text(b"constructor stack ").decimal(stack.used()).end();
    let stack = StackMeter::paint();
    for cycle in 0..setup.cycles {
        let Some(input) = feed.cycle(samples) else {
            host::write(b"error malformed cycle\n");
            return false;
        };
        let observations = input.observations(samples);
        let mut stages = StageMeter::default();
        let outcome = tracker.cycle_observed(&observations, input.elapsed_s, input.tag_height_m, &mut stages);
        if outcome.is_err() {
            host::write(b"error refused cycle\n");
            return false;
        }
        let mut line = Line::new();
        line.text(b"cycle ").decimal(cycle).text(b" hash ").hex(tracker.hash());
        for instructions in stages.per_stage() {
            line.text(b" ").decimal(instructions);
        }
        line.end();
    }
    let mut line = Line::new();
    line.text(b"stack ")
        .decimal(stack.used())
        .text(b" tracker ")
        .decimal(size_of::<BoardTracker>() as u32)
        .end();
    true
}
