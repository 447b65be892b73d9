//! scratch
use cogmint::import::*;
use std::path::Path;
fn main() {
    let d = Path::new("/work/shared/data/");
    for s in 1..=2 {
        bp_slam(
            &d.join("bp-slam/anchors_vas.csv"),
            &d.join("bp-slam/true_trajectory.csv"),
            &d.join(format!("bp-slam/measurements_seed{s}.csv")),
        )
        .unwrap()
        .write(Path::new(&format!("/tmp/rec/bp{s}")))
        .unwrap();
    }
    let m = miluv(&d.join("miluv/random_1.npz"), MiluvOptions { heights: true, pulse_peak_samples: 2.0 })
        .unwrap();
    println!("{:?}", m.notes);
    m.recording.write(Path::new("/tmp/rec/miluv")).unwrap();
    for (n, r) in warsaw(&d.join("warsaw")).unwrap() {
        r.write(Path::new(&format!("/tmp/rec/warsaw/{n}"))).unwrap();
    }
}
