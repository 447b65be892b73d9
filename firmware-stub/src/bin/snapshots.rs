//! Snapshots from machine to machine: the tracker of `main.rs` replays the first half of a feed, writes a snapshot as `snapshot.bin`,
//! and goes on. Where there is a `restore.bin`, it goes on from that in place of the first half. Prints the hash of every cycle of the
//! second half. `tests/on_target.sh` runs it in QEMU, in more memory than `memory.x` has: a snapshot takes as much as the tracker.

#![no_std]
#![no_main]

use cogmint_board::Once;
use cogmint_board::feed::Feed;
use cogmint_board::host::{self, Fault, File, Line};
use cogmint_board::replay::start;
use cogmint_core::Tracker;
use cogmint_core::model::observation::Complex;
use core::cell::UnsafeCell;
use cortex_m_rt::entry;

/// As in `main.rs`.
type BoardTracker = Tracker<2, 8, 24, 32, 16, 40, 8, 800, 6>;

static TRACKER: Once<BoardTracker> = Once(UnsafeCell::new(Tracker::new()));
/// The samples of one cycle.
static FRAMES: Once<[Complex; 2 * 1024]> = Once(UnsafeCell::new([[0.0; 2]; 2 * 1024]));

static SNAPSHOT: Once<[u8; 48 * 1024]> = Once(UnsafeCell::new([0; 48 * 1024]));

#[entry]
fn main() -> ! {
    // SAFETY: see `Once`.
    let (tracker, samples, bytes) =
        unsafe { (&mut *TRACKER.0.get(), &mut *FRAMES.0.get(), &mut *SNAPSHOT.0.get()) };
    host::end(run(tracker, samples, bytes))
}

fn run(tracker: &mut BoardTracker, samples: &mut [Complex], bytes: &mut [u8]) -> Result<(), Fault> {
    let mut feed = Feed::open().ok_or(Fault::FEED)?;
    let cycles = start(tracker, &mut feed)?;
    let cut = cycles / 2;
    let mut restored = File::open(b"restore.bin\0");
    for cycle in 0..cycles {
        let input = feed.cycle::<2, 16>(samples).ok_or(Fault::FEED)?;
        if cycle == cut {
            match &mut restored {
                Some(file) => restore(tracker, file, bytes)?,
                None => {
                    let length =
                        tracker.snapshot(bytes).map_err(|_| Fault(b"error no room for the snapshot\n"))?;
                    let written = bytes.get(..length).unwrap_or_default();
                    if !host::write_file(b"snapshot.bin\0", written) {
                        return Err(Fault(b"error the snapshot cannot be written\n"));
                    }
                    Line::new().text(b"snapshot ").decimal(length as u32).end();
                }
            }
        }
        if cycle < cut && restored.is_some() {
            continue;
        }
        let observations = input.observations::<4>(samples);
        tracker.switch_antenna(input.lever_arm_m).map_err(|_| Fault(b"error refused antenna\n"))?;
        tracker
            .cycle(&observations, input.elapsed_s, input.tag_height)
            .map_err(|_| Fault(b"error refused cycle\n"))?;
        if cycle >= cut {
            Line::new().decimal(cycle).text(b" ").hex(tracker.hash()).end();
        }
    }
    Ok(())
}

fn restore(tracker: &mut BoardTracker, file: &mut File, bytes: &mut [u8]) -> Result<(), Fault> {
    let length = file.length();
    let bytes = bytes.get_mut(..length).ok_or(Fault(b"error the snapshot is too long\n"))?;
    if !file.read(bytes) {
        return Err(Fault(b"error the snapshot cannot be read\n"));
    }
    tracker.restore(bytes).map_err(|_| Fault(b"error refused snapshot\n"))
}
