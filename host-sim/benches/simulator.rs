//! How fast frames are simulated: `cargo bench -p cogmint --bench simulator`.

use cogmint::scenario::Scenario;
use cogmint::simulator::Simulator;
use divan::Bencher;
use divan::counter::ItemsCount;

fn main() {
    divan::main();
}

/// All frames of a built-in scenario's first trajectory on all cores; what a wall does is worked out anew each time.
#[divan::bench(args = ["seminar-room", "corridor", "l-shaped-office", "dw3000-office"], sample_count = 5, sample_size = 1)]
fn frames(bencher: Bencher<'_, '_>, name: &str) {
    let (scenario, folder) = Scenario::find(name).expect("is built in");
    let simulator = || Simulator::new(&scenario, folder.as_deref(), 0, None).expect("is usable");
    let frames = simulator().cycles() * scenario.anchors.len();
    bencher
        .counter(ItemsCount::new(frames))
        .with_inputs(simulator)
        .bench_values(|simulator| simulator.record(usize::MAX, || {}));
}
