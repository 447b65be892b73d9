//! Traces of the smaller trackers that the firmware is built with: writes the feed of a recording, and prints the hash of every
//! cycle in the tracker of that size.
//!
//!     cargo run --release -p cogmint-tests --example sized_trace -- four_anchors|one_anchor RECORDING FEED

use cogmint::recording::Recording;
use cogmint::replay::{Setup, inputs};
use cogmint::trace::feed;
use cogmint_core::Tracker;
use std::error::Error;
use std::path::Path;
use std::process::ExitCode;

/// Replays a recording in a tracker of these capacities, which are those of the program of this name in `firmware-stub/src/bin`.
macro_rules! sized {
    ($setup:expr, $recording:expr, $($size:literal),*) => {{
        let setup: &Setup = $setup;
        let mut tracker = Box::new(Tracker::<$($size),*>::new());
        setup.start(&mut tracker)?;
        for (cycle, input) in inputs($recording).enumerate() {
            tracker.switch_antenna(input.arm_m(&setup.config))?;
            tracker.cycle(&input.observations(), input.elapsed_s, input.tag_height)?;
            println!("{cycle} {:016x}", tracker.hash());
        }
    }};
}

fn run(size: &str, folder: &Path, to: &Path) -> Result<(), Box<dyn Error>> {
    let recording = Recording::read(folder)?;
    let setup = Setup::new(&recording, folder, None)?;
    std::fs::write(to, feed(&setup, &recording, folder)?)?;
    match size {
        "four_anchors" => sized!(&setup, &recording, 4, 6, 12, 8, 8, 2, 4, 256, 2),
        "one_anchor" => sized!(&setup, &recording, 1, 4, 8, 8, 8, 2, 4, 256, 0),
        _ => return Err(format!("unknown size {size} (known: four_anchors, one_anchor)").into()),
    }
    Ok(())
}

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [size, folder, to] = arguments.as_slice() else {
        eprintln!("sized_trace: needs a size, a recording and the feed's file");
        return ExitCode::from(2);
    };
    match run(size, Path::new(folder), Path::new(to)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("sized_trace: {folder}: {error}");
            ExitCode::FAILURE
        }
    }
}
