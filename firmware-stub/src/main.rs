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
use core::mem::MaybeUninit;
use cortex_m_rt::entry;

/// Capacity of the reference size: 2 anchors, 8 surfaces, 24 sources, 32 segments, 16 paths, 40 actions, 8 components,
/// 800 points of what paths leave of a frame.
type BoardTracker = Tracker<2, 8, 24, 32, 16, 40, 8, 800>;

static TRACKER: Once<MaybeUninit<BoardTracker>> = Once(UnsafeCell::new(MaybeUninit::uninit()));

#[entry]
fn main() -> ! {
    // SAFETY: see `Once`.
    let (tracker, samples) = unsafe { (&mut *TRACKER.0.get(), &mut *FRAMES.0.get()) };
    host::end(replay(tracker, samples))
}

/// Constructs the tracker where it stays; how many cycles follow. Apart from the replay, whose stack the set-up and the
/// temporaries of the construction would take.
#[inline(never)]
fn build<'a>(
    slot: &'a mut MaybeUninit<BoardTracker>,
    feed: &mut Feed,
) -> Result<(&'a mut BoardTracker, u32), Fault> {
    let setup = feed.setup().ok_or(Fault(b"error malformed feed\n"))?;
    let tracker = match Tracker::untold(setup.config, &setup.anchors, &setup.actions, setup.seed) {
        Ok(tracker) => slot.write(tracker),
        Err(_) => return Err(Fault(b"error refused set-up\n")),
    };
    for (anchor, [mean_m, std_m]) in setup.range_biases_m.iter().enumerate() {
        tracker.tell_range_bias(anchor, *mean_m, *std_m).map_err(|_| Fault(b"error refused bias\n"))?;
    }
    match tracker.tell(&setup.map()) {
        Ok(()) => Ok((tracker, setup.cycles)),
        Err(_) => Err(Fault(b"error refused map\n")),
    }
}

/// Replays the whole feed.
fn replay(slot: &mut MaybeUninit<BoardTracker>, samples: &mut [Complex; SAMPLES]) -> Result<(), Fault> {
    let mut feed = Feed::open().ok_or(Fault(b"error no feed\n"))?;
    let (tracker, cycles) = build(slot, &mut feed)?;
    Line::new().text(b"constructor stack ").decimal(stack::deepest_from_reset()?).end();
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
