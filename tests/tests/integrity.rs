//! Bits that flip in memory: nothing is reported where none does, and what does is found.

use cogmint::replay::{Setup, inputs, step};
use cogmint::scenario::Scenario;
use cogmint::simulator::Simulator;
use std::path::Path;

fn setup(name: &str, seed: u64, cycles: usize) -> (cogmint::recording::Recording, Setup) {
    let (scenario, _) = Scenario::find(name).unwrap();
    let simulator = Simulator::new(&scenario, None, 0, Some(seed)).unwrap();
    let recording = simulator.record(cycles, || {});
    let setup = Setup::new(&recording, Path::new(name), None).unwrap();
    (recording, setup)
}

#[test]
fn where_no_bit_flips_nothing_is_reported() {
    for name in ["seminar-room", "dw3000-office"] {
        let (recording, setup) = setup(name, 7, 150);
        let mut tracker = setup.tracker::<4>().unwrap();
        for (cycle, input) in inputs(&recording).enumerate() {
            let report = step(&mut tracker, &input, &mut ()).unwrap().report;
            assert!(report.integrity.is_intact(), "{name}, cycle {cycle}: {:?}", report.integrity);
        }
    }
}
