//! The tracker in a closed loop: over a simulated radio that reacts to the channel that the tracker chooses. Prints the hash over all state
//! after every cycle, which action it used and chose, and how far off it is; and what stopped a cycle.
//!
//! The feed is three words: `COGX`, what is wrong with the radio (0 nothing, 1 it stays on its channel, 2 its bus fails), and in which cycle.
//! `tests/radio_on_target.sh` runs it in QEMU and compares it with the host's.

#![no_std]
#![no_main]

mod room;

use cogmint_board::host::{self, Fault, File, Line};
use cogmint_board::{Once, meter::stack};
use cogmint_core::{CycleError, Tracker};
use core::cell::UnsafeCell;
use cortex_m_rt::entry;
use room::{Defect, Event, RoomTracker, SimulatedRadio, run, start};

static TRACKER: Once<RoomTracker> = Once(UnsafeCell::new(Tracker::new()));
static RADIO: Once<SimulatedRadio> = Once(UnsafeCell::new(SimulatedRadio::new(Defect::None)));

#[entry]
fn main() -> ! {
    // SAFETY: see `Once`.
    let (tracker, radio) = unsafe { (&mut *TRACKER.0.get(), &mut *RADIO.0.get()) };
    host::end(closed_loop(tracker, radio))
}

fn closed_loop(tracker: &mut RoomTracker, radio: &mut SimulatedRadio) -> Result<(), Fault> {
    *radio = SimulatedRadio::new(defect().ok_or(Fault::FEED)?);
    start(tracker).map_err(|_| Fault(b"error refused set-up\n"))?;
    run(tracker, radio, |radio, event| match event {
        Event::Cycle(report, hash) => {
            let (action, next) = (report.action as u32, report.next_action as u32);
            let off_mm = 1000.0 * radio.off_m(&report);
            Line::new()
                .text(b"cycle ")
                .decimal(report.cycle)
                .text(b" hash ")
                .hex(hash)
                .text(b" action ")
                .decimal(action)
                .text(b" next ")
                .decimal(next)
                .text(b" off ")
                .decimal(off_mm as u32)
                .text(b" mm")
                .end();
        }
        Event::Stop(cycle, CycleError::Radio(_)) => {
            Line::new().text(b"the radio failed in cycle ").decimal(cycle).end();
        }
        Event::Stop(cycle, CycleError::Tracker(_)) => {
            Line::new().text(b"the tracker refused in cycle ").decimal(cycle).end();
        }
    });
    Ok(stack::check_guard()?)
}

fn defect() -> Option<Defect> {
    let mut feed = File::open_feed()?;
    let mut word = || {
        let mut bytes = [0; 4];
        feed.read(&mut bytes).then(|| u32::from_le_bytes(bytes))
    };
    if word()? != u32::from_le_bytes(*b"COGX") {
        return None;
    }
    let (kind, cycle) = (word()?, word()?);
    match kind {
        0 => Some(Defect::None),
        1 => Some(Defect::Stays),
        2 => Some(Defect::FailsIn(cycle)),
        _ => None,
    }
}
