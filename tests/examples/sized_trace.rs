//! Traces of the smaller trackers that the firmware is built with: writes the feed of a recording, and prints the hash of every
//! cycle in the tracker of that size.
//!
//!     cargo run --release -p cogmint-tests --example sized_trace -- four_anchors|one_anchor|ranges_only RECORDING FEED

use cogmint::channel::random::{Purpose, normal, stream, uniform};
use cogmint::recording::{Range, Recording};
use cogmint::replay::{Setup, inputs};
use cogmint::trace::feed;
use cogmint_core::{RangeTracker, Tracker};
use std::error::Error;
use std::path::Path;
use std::process::ExitCode;

/// Replays a recording in a tracker that is that of the program of this name in `firmware-stub/src/bin`.
macro_rules! sized {
    ($setup:expr, $recording:expr, $tracker:expr) => {{
        let setup: &Setup = $setup;
        let mut tracker = Box::new($tracker);
        setup.start(&mut tracker)?;
        for (cycle, input) in inputs($recording).enumerate() {
            tracker.switch_antenna(input.arm_m(&setup.config))?;
            tracker.cycle(&input.observations(), input.elapsed_s, input.tag_height)?;
            println!("{cycle} {:016x}", tracker.hash());
        }
    }};
}

/// In place of every frame its anchor's distance from where the tag was, with an error of 0.1 m, one in 20 of them long by up to 5 m; and
/// one action and no map. A tenth of the way from the end the tag is carried 4 m away.
fn ranges_in_place_of_frames(recording: &mut Recording) {
    let Recording { anchors, actions, cycles, plan, virtual_anchors, .. } = recording;
    actions.truncate(1);
    virtual_anchors.clear();
    *plan = None;
    let mut rng = stream(1, Purpose::Experiment, &[]);
    let carried = cycles.len() - cycles.len() / 10;
    for (number, cycle) in cycles.iter_mut().enumerate() {
        let Some([x, y]) = cycle.truth_position_m else { continue };
        let x = if number < carried { x } else { x + 4.0 };
        for frame in std::mem::take(&mut cycle.frames) {
            let [ax, ay] = anchors[frame.anchor].position_m;
            let late_m = if uniform(&mut rng) < 0.05 { 5.0 * uniform(&mut rng) } else { 0.0 };
            let range_m = (x - ax).hypot(y - ay) + 0.1 * normal(&mut rng) + late_m;
            cycle.ranges.push(Range { anchor: frame.anchor, range_m, std_m: Some(0.1), angles: None });
        }
    }
}

fn run(size: &str, folder: &Path, to: &Path) -> Result<(), Box<dyn Error>> {
    let mut recording = Recording::read(folder)?;
    if size == "ranges_only" {
        ranges_in_place_of_frames(&mut recording);
    }
    let setup = Setup::new(&recording, folder, None)?;
    std::fs::write(to, feed(&setup, &recording, folder)?)?;
    match size {
        "four_anchors" => sized!(&setup, &recording, Tracker::<4, 6, 12, 8, 8, 2, 4, 256, 2>::new()),
        "one_anchor" => sized!(&setup, &recording, Tracker::<1, 4, 8, 8, 8, 2, 4, 256, 0>::new()),
        "ranges_only" => sized!(&setup, &recording, RangeTracker::<3, 2, 4>::empty()),
        _ => return Err(format!("unknown size {size} (known: four_anchors, one_anchor, ranges_only)").into()),
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
