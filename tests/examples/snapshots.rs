//! Snapshots from machine to machine, on the host: for `tests/on_target.sh`.
//!
//!     cargo run --release -p cogmint-tests --example snapshots -- RECORDING CYCLES RESTORE SNAPSHOT
//!
//! Replays so many cycles of a recording in a tracker of the target's size and writes its snapshot in the middle as the file RESTORE; then another
//! such tracker goes on from the target's, the file SNAPSHOT, if that is there. Prints the hash of every cycle of the second half of the
//! latter, of the former else. Fails where the two snapshots are not the same bytes.

use cogmint::recording::Recording;
use cogmint::replay::{CycleInput, Setup, inputs};
use cogmint_core::Tracker;
use std::error::Error;
use std::path::Path;

/// As in `firmware-stub/src/bin/snapshots.rs`: a snapshot is of its capacities.
type BoardTracker = Tracker<2, 8, 24, 32, 16, 40, 8, 800, 6>;

fn started(setup: &Setup) -> Result<Box<BoardTracker>, cogmint_core::Error> {
    let mut tracker = Box::new(BoardTracker::new());
    setup.start(&mut tracker)?;
    Ok(tracker)
}

fn step(tracker: &mut BoardTracker, input: &CycleInput<'_>) -> Result<u64, cogmint_core::Error> {
    tracker.switch_antenna(input.arm_m(tracker.config()))?;
    tracker.cycle(&input.observations(), input.elapsed_s, input.tag_height)?;
    Ok(tracker.hash())
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [recording, cycles, restore, snapshot] = arguments.as_slice() else {
        return Err("needs a recording, a number of cycles and two files".into());
    };
    let file = Path::new(recording);
    let mut recording = Recording::read(file)?;
    recording.cycles.truncate(cycles.parse()?);
    let cut = recording.cycles.len() / 2;
    let setup = Setup::new(&recording, file, Some(1))?;
    let mut tracker = started(&setup)?;
    for input in inputs(&recording).take(cut) {
        step(&mut tracker, &input)?;
    }
    let mut bytes = vec![0; 1 << 18];
    let length = tracker.snapshot(&mut bytes)?;
    bytes.truncate(length);
    std::fs::write(restore, &bytes)?;
    if let Ok(other) = std::fs::read(snapshot) {
        if other != bytes {
            return Err("the target's snapshot is not the host's".into());
        }
        tracker = started(&setup)?;
        tracker.restore(&other)?;
    }
    for (cycle, input) in inputs(&recording).enumerate().skip(cut) {
        println!("{cycle} {:016x}", step(&mut tracker, &input)?);
    }
    Ok(())
}
