//! The recordings that nobody here made: what the tracker must reach on them.

use cogmint::import;
use cogmint::recording::Recording;
use cogmint::track::track;
use cogmint_tests::shared_data;
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

#[test]
fn a_flight_is_tracked_from_raw_ranges_and_responses() {
    let Some(folder) = shared_data("miluv") else { return };
    let imported = import::miluv(&folder.join("random_1.npz"), import::MiluvOptions::default()).unwrap();
    let run = track(&imported.recording, Path::new("miluv"), None, || {}).unwrap();
    let rmse = run.score.rmse_m.unwrap();
    println!("RMSE {rmse:.3} m");
    assert!(!run.score.diverged && rmse <= 0.45, "{rmse} m");
    assert_eq!(run.refused, 0);
    assert_eq!(run.bias_m.len(), 6);
}
