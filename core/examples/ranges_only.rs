//! A tag that is told ranges and nothing else: no frames, no plan, a start that is 2 m off.
//!
//!     cargo run -p cogmint-core --example ranges_only

#![cfg_attr(target_os = "none", no_std, no_main)]

mod simulated;

use cogmint_core::model::observation::{Observation, Range, RangeScan};
use cogmint_core::radio::presets::RadioPreset;
use cogmint_core::real::sqrt;
use cogmint_core::{Anchor, Config, Error, Map, RangeTracker};
use simulated::Noise;

const ANCHORS: [Anchor; 3] = [
    Anchor { position_m: [0.0, 0.0], height_m: 0.0 },
    Anchor { position_m: [10.0, 0.0], height_m: 0.0 },
    Anchor { position_m: [5.0, 8.0], height_m: 0.0 },
];
const CYCLE_S: f32 = 0.1;
const NOISE_M: f32 = 0.07;

/// 3 anchors, 2 ranges of each, 4 components of the belief.
type TagTracker = RangeTracker<3, 2, 4>;

/// The error after ten seconds of a walk, metres.
fn run() -> Result<f32, Error> {
    let mut config = Config::pedestrian(RadioPreset::Dw1000);
    config.start.position_m = [4.0, 3.0];
    // One channel, and nothing to choose.
    let actions = RadioPreset::Dw1000.library().get(..1).unwrap_or_default();
    let mut tracker = TagTracker::empty();
    tracker.start(&config, &ANCHORS, &Map::default(), actions, 1)?;

    let mut noise = Noise(1);
    let mut error_m = 0.0;
    for n in 1..=100_u8 {
        let walked_s = CYCLE_S * f32::from(n);
        let [x, y] = [2.0 + 0.5 * walked_s, 2.0 + 0.2 * walked_s];
        let scans = ANCHORS.map(|Anchor { position_m: [ax, ay], .. }| {
            let range_m = sqrt((x - ax) * (x - ax) + (y - ay) * (y - ay)) + NOISE_M * noise.normal();
            [Range { range_m, variance_m2: NOISE_M * NOISE_M }]
        });
        tracker.begin(CYCLE_S, None)?;
        for (anchor, ranges) in scans.iter().enumerate() {
            tracker.receive(&Observation::Ranges(RangeScan { anchor, ranges }))?;
        }
        let [own_x, own_y] = tracker.finish()?.position_m;
        error_m = sqrt((own_x - x) * (own_x - x) + (own_y - y) * (own_y - y));
    }
    Ok(error_m)
}

#[cfg(not(target_os = "none"))]
fn main() -> Result<(), Error> {
    let error_m = run()?;
    println!("{error_m:.3} m off after 100 cycles; the tracker has {} bytes", size_of::<TagTracker>());
    assert!(error_m < 0.2, "{error_m} m");
    Ok(())
}

/// Keeps the code in a program that has no start of its own.
#[cfg(target_os = "none")]
#[used]
static RUN: fn() -> Result<f32, Error> = run;
