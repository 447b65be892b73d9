//! The simulated radio of the firmware on the host: what `firmware-stub/src/bin/simulated_radio` prints on the target, line by line.
//!
//!     cargo run --release -p cogmint-tests --example simulated_radio -- 0 0
//!
//! The two numbers are those of its feed: what is wrong with the radio, and in which cycle.

use cogmint_core::CycleError;
use cogmint_tests::simulated_radio::{Defect, Event, RoomTracker, SimulatedRadio, run, start};

fn main() {
    let numbers: Vec<u32> =
        std::env::args().skip(1).map(|number| number.parse().expect("a number")).collect();
    let defect = match numbers[..] {
        [0, _] => Defect::None,
        [1, _] => Defect::Stays,
        [2, cycle] => Defect::FailsIn(cycle),
        _ => panic!("two numbers: 0 to 2, and a cycle"),
    };
    let mut tracker = RoomTracker::new();
    start(&mut tracker).expect("starts");
    run(&mut tracker, &mut SimulatedRadio::new(defect), |radio, event| match event {
        Event::Cycle(report, hash) => {
            let off_mm = 1000.0 * radio.off_m(&report);
            println!(
                "cycle {} hash {hash:016x} action {} next {} off {} mm",
                report.cycle, report.action, report.next_action, off_mm as u32
            );
        }
        Event::Stop(cycle, CycleError::Radio(_)) => println!("the radio failed in cycle {cycle}"),
        Event::Stop(cycle, CycleError::Tracker(_)) => println!("the tracker refused in cycle {cycle}"),
    });
}
