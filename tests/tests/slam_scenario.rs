//! The SLAM reference scenario (`cogmint::experiment::tracking::slam_ranges`) over seeds of its own.

use cogmint::experiment::tracking::slam_ranges::SlamRanges;
use cogmint::replay::{Setup, inputs};
use cogmint::track::track;
use cogmint_core::{Map, Tracker};
use std::path::Path;

/// Runs of the test: a share by default, COGMINT_SLAM_RUNS for more.
fn runs() -> u64 {
    std::env::var("COGMINT_SLAM_RUNS").ok().and_then(|n| n.parse().ok()).unwrap_or(40)
}

#[test]
fn fresh_seeds_are_tracked_from_two_anchors_and_no_map() {
    let mut rmse: Vec<f64> = Vec::new();
    let mut diverged = Vec::new();
    for seed in 1..=runs() {
        let recording = SlamRanges::default().record(1000 + seed);
        let run = track(&recording, Path::new("slam scenario"), Some(seed), || {}).unwrap();
        rmse.push(run.score.rmse_m.unwrap());
        if run.score.diverged {
            diverged.push(seed);
        }
    }
    let mut sorted = rmse.clone();
    sorted.sort_by(f64::total_cmp);
    println!(
        "{} runs: RMSE median {:.3} m, 90 % {:.3} m, worst {:.3} m, diverged {diverged:?}",
        rmse.len(),
        sorted[sorted.len() / 2],
        sorted[sorted.len() * 9 / 10],
        sorted[sorted.len() - 1],
    );
    assert!(sorted[sorted.len() / 2] <= 0.08);
    assert!(diverged.is_empty(), "{diverged:?}");
}

#[test]
fn a_full_map_says_so_and_goes_on() {
    let recording = SlamRanges::default().record(2);
    let setup = Setup::new(&recording, Path::new("slam scenario"), None).unwrap();
    let mut tracker = Tracker::<2, 2, 2, 1, 16, 40, 8, 0, 6>::new();
    tracker.start(&setup.config, &setup.anchors, &Map::default(), &setup.actions, setup.seed).unwrap();
    let (mut discovered, mut map_full) = (0, 0);
    for input in inputs(&recording) {
        let report = tracker.cycle(&input.observations(), input.elapsed_s, None).unwrap();
        discovered += report.discovered;
        map_full += report.map_full;
        assert!(tracker.environment().iter().count() <= 2);
    }
    assert!(discovered >= 2 && map_full > 0, "{discovered} discovered, {map_full} turned away");
}
