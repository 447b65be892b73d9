//! What a DW1000's magnitudes show of rooms that nobody tuned for: true paths found, false ones, the level beneath.

use cogmint::estimate::link::AgainstTruth;
use cogmint::estimate::truth::Tally;
use cogmint::estimate::{Options, estimate};
use cogmint::recording::Recording;
use cogmint::rooms::{Disturbance, Restriction, room};
use cogmint::simulator::Simulator;
use std::path::Path;

/// Nothing of the estimator was chosen on these.
const FIRST_SEED: u64 = 250_301;
const ROOMS: usize = 12;
/// So many cycles of each room, evenly along its way.
const CYCLES: usize = 8;

fn figures() -> AgainstTruth {
    let restriction = Restriction { interference: vec![Disturbance::None], ..Restriction::default() };
    let rooms = (FIRST_SEED..).filter_map(|seed| {
        let room = room(seed, &restriction).expect("every seed has a room");
        let drawn = serde_json::to_value(room.drawn).expect("what is drawn is plain data");
        (drawn["radio"] == "dw1000-magnitude").then_some(room)
    });
    let mut tally = Tally::default();
    for room in rooms.take(ROOMS) {
        let simulator = Simulator::new(&room.scenario, None, 0, None).expect("a room is a scenario");
        let step = simulator.cycles() / CYCLES;
        let cycles =
            (0..CYCLES).map(|n| simulator.cycle(n * step, simulator.scheduled_action(n * step))).collect();
        let recording = Recording { cycles, ..simulator.before() };
        let options = Options { false_paths: 0.1, from: 0, cycles: usize::MAX, anchor: None };
        let frames = estimate(&recording, Path::new("room"), &options, || {}).expect("frames to estimate");
        tally.add(&recording, &frames);
    }
    tally.figures().expect("simulated rooms know their paths")
}

#[test]
fn magnitudes_of_rooms_show_the_paths_that_noise_allows() {
    let figures = figures();
    println!("{figures:?}");
    // Of the paths above 9 dB every fourth is within half a pulse duration of a stronger one: nobody finds these.
    let found = figures.detected_share_above_9_db.expect("there are such paths");
    assert!(found >= 0.4, "{found}");
    let far = figures.far_false_paths_per_frame;
    assert!((0.05..=0.15).contains(&far), "{far} false paths per frame where 0.1 were asked for");
    let level = figures.level_ratio_median.expect("there are paths");
    assert!(level < 2.5, "{level}");
}
