//! `ekf`: a plain extended Kalman filter on the first path, or the shortest range, of every anchor: what is done where
//! reflections are no information.
//!
//! State: position and velocity, and a bias per anchor where the set-up tells of one; white acceleration; the variance
//! of a range inflated and floored as in the core. First order, nothing gated.

use super::gaussian::Gaussian;
use super::map::Map;
use super::{CycleScans, Estimate, Source, rise_m};
use crate::recording::Recording;
use crate::replay::Setup;
use std::time::Instant;

/// Runs the filter over the scans of a recording.
pub fn run(recording: &Recording, setup: &Setup, cycles: &[CycleScans]) -> Vec<Estimate> {
    let map = Map::new(recording, setup, |_| None);
    let mut gaussian = Gaussian::prior(&map);
    let ranging = &setup.config.ranging;
    let (inflation, floor_m) = (f64::from(ranging.variance_inflation), f64::from(ranging.floor_m));
    let cycle = |cycle: &CycleScans| {
        let begin = Instant::now();
        gaussian.predict(cycle.elapsed_s, map.acceleration_density);
        for scan in &cycle.scans {
            let Some(first) = scan.paths.iter().min_by(|a, b| a.range_m.total_cmp(&b.range_m)) else {
                continue;
            };
            let Some(place) = map.place(scan.anchor, Source::Direct, &gaussian.mean) else { continue };
            let rise_m = rise_m(setup, scan.anchor, cycle.tag_height_m);
            let look = map.look(scan.anchor, &place, rise_m, &gaussian.mean, &gaussian.covariance);
            let (w, explained_m2) = gaussian.along(&look.slope);
            let s = explained_m2 + inflation * first.std_m * first.std_m + floor_m * floor_m;
            gaussian.step(&w, (first.range_m - look.range_m) / s, -1.0 / s);
        }
        gaussian.symmetrise();
        Estimate {
            position_m: [gaussian.mean[0], gaussian.mean[1]],
            covariance_m2: gaussian.position_m2(),
            probability: None,
            searching: false,
            seconds: begin.elapsed().as_secs_f64(),
        }
    };
    cycles.iter().map(cycle).collect()
}
