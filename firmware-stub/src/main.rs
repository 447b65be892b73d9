//! The cogmint tracker on a Cortex-M4F.
//!
//! Replays a feed of recorded cycles (written by `cogmint trace --feed FILE`, read from the debugger's host) through
//! the same [`Tracker`] as on the host, and prints for every cycle the hash over all state and the instructions per
//! stage; at the end, how much stack was used since reset. Ends with an error where the stack is used up or a cycle is
//! longer than the counter. `tests/on_target.sh` builds it, runs it in QEMU and compares.

#![no_std]
#![no_main]

use cogmint_board::feed::Feed;
use cogmint_board::host::{self, Fault, Line};
use cogmint_board::meter::{StageMeter, stack};
use cogmint_board::{FRAMES, Once, SAMPLES};
use cogmint_core::Tracker;
use cogmint_core::model::observation::Complex;
use core::cell::UnsafeCell;
use cortex_m_rt::entry;

/// Capacity of the reference size: 2 anchors, 8 surfaces, 24 sources, 32 segments, 16 paths, 40 actions, 8 components,
/// 800 points of what paths leave of a frame.
type BoardTracker = Tracker<2, 8, 24, 32, 16, 40, 8, 800>;

static TRACKER: Once<BoardTracker> = Once(UnsafeCell::new(Tracker::new()));

#[entry]
fn main() -> ! {
    // SAFETY: see `Once`.
    let (tracker, samples) = unsafe { (&mut *TRACKER.0.get(), &mut *FRAMES.0.get()) };
    host::end(replay(tracker, samples))
}

/// Starts the tracker; how many cycles follow. Apart from the replay, whose stack the set-up would take.
#[inline(never)]
fn start(tracker: &mut BoardTracker, feed: &mut Feed) -> Result<u32, Fault> {
    let setup = feed.setup().ok_or(Fault(b"error malformed feed\n"))?;
    tracker
        .start(&setup.config, &setup.anchors, &setup.map(), &setup.actions, setup.seed)
        .map_err(|_| Fault(b"error refused set-up\n"))?;
    Ok(setup.cycles)
}

/// Replays the whole feed.
fn replay(tracker: &mut BoardTracker, samples: &mut [Complex; SAMPLES]) -> Result<(), Fault> {
    let mut feed = Feed::open().ok_or(Fault(b"error no feed\n"))?;
    let cycles = start(tracker, &mut feed)?;
    Line::new().text(b"start stack ").decimal(stack::deepest_from_reset()?).end();
    for cycle in 0..cycles {
        let input = feed.cycle(samples).ok_or(Fault(b"error malformed cycle\n"))?;
        let observations = input.observations(samples);
        let mut stages = StageMeter::default();
        tracker.switch_antenna(input.lever_arm_m).map_err(|_| Fault(b"error refused antenna\n"))?;
        tracker
            .cycle_observed(&observations, input.elapsed_s, input.tag_height, &mut stages)
            .map_err(|_| Fault(b"error refused cycle\n"))?;
        let mut line = Line::new();
        line.text(b"cycle ").decimal(cycle).text(b" hash ").hex(tracker.hash());
        for instructions in stages.per_stage()? {
            line.text(b" ").instructions(instructions);
        }
        line.end();
    }
    Line::new()
        .text(b"stack ")
        .decimal(stack::deepest_from_reset()?)
        .text(b" tracker ")
        .decimal(size_of::<BoardTracker>() as u32)
        .text(b" frames ")
        .decimal(size_of_val(samples) as u32)
        .end();
    Ok(())
}
