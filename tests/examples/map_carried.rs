//! The map alone, carried into a tracker that is started anew, on the host: for `tests/c_interface.sh`, whose `c/examples/replay.c` does the same.
//!
//!     cargo run --release -p cogmint-tests --example map_carried -- RECORDING CYCLES
//!
//! Replays so many cycles of a recording in a tracker of the target's size, takes its map into a fresh one, and prints what one cycle makes of it
//! in which every anchor is 3 m away; then the same of a fresh one without the map.

use cogmint::recording::Recording;
use cogmint::replay::{Setup, TargetTracker, inputs};
use cogmint_core::MapRestored;
use cogmint_core::model::observation::{Observation, Range, RangeScan};
use std::error::Error;
use std::path::Path;

fn show(
    name: &str,
    map: &[u8],
    tracker: &mut TargetTracker,
    restored: MapRestored,
) -> Result<(), Box<dyn Error>> {
    let ranges = [Range { range_m: 3.0, variance_m2: 0.01 }];
    tracker.begin(0.1, None)?;
    for anchor in 0..tracker.anchors().len() {
        tracker.receive(&Observation::Ranges(RangeScan { anchor, ranges: &ranges }))?;
    }
    let report = tracker.finish()?;
    let [x, y] = report.position_m.map(f32::to_bits);
    println!(
        "{name} {} {} {} {} {} {} {x} {y} {} hash {:016x}",
        map.len(),
        restored.surfaces,
        restored.surfaces_left_out,
        restored.sources,
        restored.sources_left_out,
        report.associated,
        report.entropy_nat.to_bits(),
        tracker.hash()
    );
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [recording, cycles] = arguments.as_slice() else {
        return Err("needs a recording and a number of cycles".into());
    };
    let file = Path::new(recording);
    let mut recording = Recording::read(file)?;
    recording.cycles.truncate(cycles.parse()?);
    let setup = Setup::new(&recording, file, Some(1))?;
    let mut tracker = setup.target_tracker()?;
    for input in inputs(&recording) {
        tracker.switch_antenna(input.arm_m(tracker.config()))?;
        tracker.cycle(&input.observations(), input.elapsed_s, input.tag_height)?;
    }
    let mut map = vec![0; 1 << 16];
    let length = tracker.map_snapshot(&mut map)?;
    map.truncate(length);
    let (mut fresh, mut without) = (setup.target_tracker()?, setup.target_tracker()?);
    let restored = fresh.restore_map(&map)?;
    show("map", &map, &mut fresh, restored)?;
    show("without", &[], &mut without, MapRestored::default())
}
