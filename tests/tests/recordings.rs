//! The recordings that nobody here made: what the tracker must reach on them.

use cogmint::import;
use cogmint::recording::Recording;
use cogmint::scenario::Scenario;
use cogmint::simulator::Simulator;
use cogmint::track::track;
use cogmint_tests::{Folder, cogmint, shared_data};
use std::path::Path;

/// The belief-propagation SLAM reference scenario of one seed.
fn bp_slam(seed: u32) -> Option<Recording> {
    let folder = shared_data("bp-slam")?;
    let ranges = folder.join(format!("measurements_seed{seed}.csv"));
    Some(
        import::bp_slam(&folder.join("anchors_vas.csv"), &folder.join("true_trajectory.csv"), &ranges)
            .unwrap(),
    )
}

#[test]
fn bp_slam_is_tracked_from_two_anchors_and_no_map() {
    for measurements in [1, 2] {
        let Some(recording) = bp_slam(measurements) else { return };
        let (mut sum, mut worst) = (0.0, 0.0_f64);
        for start in 1..=20 {
            let run = track(&recording, Path::new("bp-slam"), Some(start), || {}).unwrap();
            let rmse = run.score.rmse_m.unwrap();
            println!("measurements {measurements}, start {start}: RMSE {rmse:.3} m");
            assert!(
                !run.score.diverged && rmse <= 0.12 && run.map.ospa_m.unwrap() <= 0.5,
                "measurements {measurements}, start {start}: {rmse} m"
            );
            assert_eq!(run.refused, 0);
            sum += rmse;
            worst = worst.max(rmse);
        }
        println!(
            "measurements {measurements}: mean RMSE {:.3} m, worst {worst:.3} m of 20 starts",
            sum / 20.0
        );
        assert!(sum / 20.0 <= 0.08);
    }
}

/// The recordings of the flight, by tag or by drone.
fn miluv(bodies: bool) -> Option<Vec<(String, Recording)>> {
    let folder = shared_data("miluv")?;
    let options = import::MiluvOptions { bodies, ..import::MiluvOptions::default() };
    Some(import::miluv(&folder.join("random_1.npz"), options).unwrap().recordings)
}

#[test]
fn a_flight_is_tracked_from_raw_ranges_and_responses() {
    let Some(recordings) = miluv(true) else { return };
    assert_eq!(recordings.len(), 1);
    let (name, recording) = &recordings[0];
    let run = track(recording, Path::new(name), None, || {}).unwrap();
    let rmse = run.score.rmse_m.unwrap();
    println!("{name}: RMSE {rmse:.3} m");
    assert!(!run.score.diverged && rmse <= 0.45, "{rmse} m");
    assert_eq!(run.refused, 0);
    assert_eq!(run.bias_m.len(), 6);
    // Truth is not known before the first response of either tag, nor after the last of both.
    let known = recording.cycles.iter().filter(|cycle| cycle.truth_position_m.is_some()).count();
    assert_eq!(run.errors_m.len(), known);
    assert!(known < recording.cycles.len() && known > 900, "{known}");
}

#[test]
fn each_tag_of_a_flight_is_tracked_and_scored_against_its_own_antenna() {
    let Some(recordings) = miluv(false) else { return };
    for (name, recording) in &recordings {
        let run = track(recording, Path::new(name), None, || {}).unwrap();
        let rmse = run.score.rmse_m.unwrap();
        println!("{name}: RMSE {rmse:.3} m of {} scored cycles", run.errors_m.len());
        assert_eq!(run.refused, 0);
        // One range a cycle, two cycles in three seconds: a tag alone is followed less well than the body with both.
        assert!(rmse <= 0.75, "{name}: {rmse} m");
    }
}

/// What the data's description says of the hall: one base station, and six virtual anchors fitted with the truth.
fn kampusareena(seed: u64) -> Option<Recording> {
    let folder = shared_data("kampusareena")?;
    let options = import::SnapshotOptions {
        anchor_m: [2.25, 2.5],
        map_m: vec![[5.8, 3.3], [-7.0, -18.5], [-6.5, -4.8], [22.4, -8.8], [-2.3, 2.5], [8.9, -7.2]],
        seed,
    };
    Some(import::snapshot(&folder.join("places.csv"), &folder.join("paths.csv"), &options).unwrap())
}

#[test]
fn the_hall_measured_place_by_place_is_taken_whole_and_scored_at_every_place() {
    for seed in 1..=5 {
        let Some(recording) = kampusareena(seed) else { return };
        let run = track(&recording, Path::new("kampusareena"), None, || {}).unwrap();
        println!("start {seed}: RMSE {:.2} m", run.score.rmse_m.unwrap());
        assert_eq!((run.errors_m.len(), run.refused, run.left_out), (45, 0, 0));
        // The start is within 0.2 m of the first place; the first second may add what a walk can.
        assert!(run.errors_m[0].1 < 1.0, "{} m", run.errors_m[0].1);
    }
}

#[test]
fn rooms_that_were_not_used_in_development_are_valid_and_are_simulated() {
    let Some(data) = shared_data("rooms") else { return };
    let folder = Folder::new("shared-rooms");
    let mut rooms = 0;
    let mut files: Vec<_> = std::fs::read_dir(data).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    for file in files.iter().filter(|file| file.extension().is_some_and(|extension| extension == "toml")) {
        let path = file.canonicalize().unwrap().to_string_lossy().into_owned();
        let output = cogmint(folder.path(), &["scenario", "check", &path]);
        assert!(output.status.success(), "{path}: {}", String::from_utf8_lossy(&output.stderr));
        let scenario = Scenario::read(file).unwrap();
        let recording = Simulator::new(&scenario, file.parent(), 0, None).unwrap().record(3, || {});
        assert_eq!(recording.anchors.len(), scenario.anchors.len(), "{path}");
        assert!(recording.cycles.iter().any(|cycle| !cycle.frames.is_empty()), "{path}");
        recording.write(folder.path().join("room")).unwrap();
        assert_eq!(Recording::read(folder.path().join("room")).unwrap(), recording, "{path}");
        let run = track(&recording, file, None, || {}).unwrap();
        assert_eq!((run.errors_m.len(), run.refused), (3, 0), "{path}");
        rooms += 1;
    }
    assert!(rooms >= 8, "{rooms}");
}
