//! Stages by themselves, without a tracker: the channel estimator finds the paths of a frame, the state filter follows a tag by ranges.
//!
//!     cargo run -p cogmint-core --example one_stage

#![cfg_attr(target_os = "none", no_std, no_main)]

mod simulated;

use cogmint_core::model::motion::Motion;
use cogmint_core::model::observation::{SampleFault, Samples};
use cogmint_core::model::source::{Sight, Source};
use cogmint_core::perceptor::association::outcome::Innovation;
use cogmint_core::perceptor::channel_estimator::{ChannelEstimator, EstimatorSettings};
use cogmint_core::perceptor::state_filter::StateFilter;
use cogmint_core::radio::pulse::Pulse;
use cogmint_core::real::{SPEED_OF_LIGHT_M_S, abs, sqrt};
use simulated::Noise;

/// Lengths and amplitudes of the paths of a frame: a direct one, and a reflection 0.9 m behind it.
const PATHS: [(f32, f32); 2] = [(5.0, 1.0), (5.9, 0.4)];
const SPACING_S: f32 = 0.25e-9;
const SAMPLES: usize = 256;

/// By how much the paths found in a frame are wrong at most, metres; `None`: not as many as there are.
fn estimate() -> Result<Option<f32>, SampleFault> {
    let pulse = Pulse::root_raised_cosine(0.5e-9, 0.6);
    let mut noise = Noise(1);
    let mut samples = [[0.0; 2]; SAMPLES];
    for (n, sample) in samples.iter_mut().enumerate() {
        *sample = [0.01 * noise.normal(), 0.01 * noise.normal()];
        let [real, _] = sample;
        for (length_m, amplitude) in PATHS {
            let off_s = n as f32 * SPACING_S - length_m / SPEED_OF_LIGHT_M_S;
            *real += amplitude * pulse.autocorrelation(off_s / pulse.duration_s);
        }
    }
    // At most 8 paths, of which 0.1 in a frame of noise.
    let estimator = ChannelEstimator::<8>::new(pulse, SPACING_S, SAMPLES, 0.1, EstimatorSettings::default());
    let estimate = estimator.estimate(Samples::Complex(&samples), 0.0)?;
    if estimate.paths.len() != PATHS.len() {
        return Ok(None);
    }
    let errors = estimate.paths.iter().zip(PATHS).map(|(path, (length_m, _))| abs(path.range_m() - length_m));
    Ok(Some(errors.fold(0.0, f32::max)))
}

/// The filter's error after 50 steps of ranges to three anchors, metres.
fn follow() -> f32 {
    let anchors_m = [[0.0, 0.0], [10.0, 0.0], [5.0, 8.0]];
    let motion = Motion {
        acceleration_density_m2_s3: 0.1,
        velocity_decay_s: 10.0,
        virtual_anchor_walk_m_sqrt_s: 3e-4,
    };
    // Of 3 anchors without walls; around (3, 3) within 1 m, at rest within 0.7 m/s; no biases.
    let mut filter = StateFilter::<3, 0>::new(motion, 30.0, [3.0, 3.0], 1.0, 0.7, 0.0, 0.0);
    let mut noise = Noise(2);
    let mut error_m = 0.0;
    for step in 1..=50_u8 {
        let [x, y] = [2.5 + 0.05 * f32::from(step), 3.5];
        filter.predict(0.1);
        let lines = [0, 1, 2].map(|anchor| {
            let anchor_m = anchors_m.get(anchor).copied().unwrap_or_default();
            let sight = Sight { anchor_m, height_m: 0.0, height_std_m: 0.0, lever_arm_m: [0.0; 2] };
            let [ax, ay] = anchor_m;
            let range_m = sqrt((x - ax) * (x - ax) + (y - ay) * (y - ay)) + 0.05 * noise.normal();
            (filter.regress(Source::Direct { anchor }, &sight, None), range_m)
        });
        filter.update(lines.into_iter().filter_map(|(line, range_m)| {
            let line = line?;
            Some(Innovation::hard(line, range_m - line.range_m, 0.05 * 0.05))
        }));
        let [own_x, own_y] = filter.position_m();
        error_m = sqrt((own_x - x) * (own_x - x) + (own_y - y) * (own_y - y));
    }
    error_m
}

/// What both come to.
fn run() -> (Result<Option<f32>, SampleFault>, f32) {
    (estimate(), follow())
}

#[cfg(not(target_os = "none"))]
fn main() -> Result<(), SampleFault> {
    let (paths, error_m) = run();
    let paths_m = paths?.unwrap_or(f32::INFINITY);
    println!("both paths found within {paths_m:.4} m; the filter is {error_m:.3} m off");
    assert!(paths_m < 0.01, "{paths_m} m");
    assert!(error_m < 0.1, "{error_m} m");
    Ok(())
}

/// Keeps the code in a program that has no start of its own.
#[cfg(target_os = "none")]
#[used]
static RUN: fn() -> (Result<Option<f32>, SampleFault>, f32) = run;
