//! Bits that flip in memory: nothing is reported where none does, and what does is found.

#[path = "integrity/flips.rs"]
mod flips;

use cogmint::replay::{Setup, inputs, step};
use cogmint::scenario::Scenario;
use cogmint::simulator::Simulator;
use flips::Outcome;
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

#[test]
fn the_child_of_the_campaign() {
    flips::child();
}

/// A thousand flips, or as many as are told: `COGMINT_FLIPS=10000 cargo test --release -p cogmint-tests --test integrity -- --nocapture
/// campaign`. With `COGMINT_WORDS=1` all bits of a word become ones. With `RUSTFLAGS="--cfg cogmint_unswept"` as well, the core looks at
/// nothing, and the campaign must show what comes of that.
#[test]
fn a_campaign_of_bits_that_flip_in_memory() {
    let told = std::env::var("COGMINT_FLIPS").ok();
    let number = told.map_or(1000, |flips| flips.parse().unwrap());
    let outcomes = flips::campaign("the_child_of_the_campaign", 0, number);
    flips::print(&outcomes);
    let all = |outcome| flips::count(&outcomes, |_| true, outcome);
    let wrong = all(Outcome::SilentlyWrong) + all(Outcome::NotANumber) + all(Outcome::Stuck);
    if cfg!(cogmint_unswept) {
        assert!(wrong > 0, "the campaign sees nothing");
        return;
    }
    assert!(all(Outcome::Refused) > 0 && all(Outcome::Reported) > 0);
    assert_eq!(wrong + all(Outcome::Hung), 0);
    // Whatever flips in what was told and is read is found.
    let told = |outcome| flips::count(&outcomes, |part| part == "told", outcome);
    assert_eq!(told(Outcome::Healed) + told(Outcome::Searching) + told(Outcome::Crashed), 0);
    // Variants of enumerations that are none: safe Rust cannot look at them before it jumps by them.
    assert!(all(Outcome::Crashed) as u64 <= 1 + number / 500, "{} crashed", all(Outcome::Crashed));
}
