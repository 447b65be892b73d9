//! How good the channel estimator is: precision against the Cramer-Rao bound, resolution, false paths, detection in
//! dense multipath, SINR, interference. T_p = 0.5 ns, roll-off 0.6, 400 samples over 100 ns.

use super::response::{Dense, ResponseMaker, TruePath};
use crate::channel::cis;
use crate::channel::pulse::PulseSpectrum;
use crate::channel::random::{Purpose, stream, uniform};
use cogmint_core::model::observation::Samples;
use cogmint_core::perceptor::channel_estimator::{ChannelEstimator, EstimatorSettings};
use cogmint_core::radio::pulse::Pulse;
use rand_xoshiro::Xoshiro128PlusPlus;
use rayon::prelude::*;
use rustfft::num_complex::Complex64;
use serde::Serialize;

pub(super) const DURATION_S: f64 = 0.5e-9;
pub(super) const ROLL_OFF: f64 = 0.6;
pub(super) const SPACING_S: f64 = 0.25e-9;
pub(super) const SAMPLES: usize = 400;
pub(super) const PATHS: usize = 16;
/// Rate of false paths at which resolution is measured: at 0.01, one trial in a hundred would have a false path
/// elsewhere, whatever the method makes of the two.
const RESOLUTION_RATE: f64 = 0.001;
/// SINRs of isolated paths, decibels.
const ISOLATED_DB: [f64; 6] = [12.0, 15.0, 18.0, 21.0, 25.0, 30.0];
/// The seven paths: delay in ns and SINR in dB; dense multipath 10 dB below the first one's 35 dB over the noise.
const SEVEN: [(f64, f64); 7] =
    [(12.0, 34.0), (17.0, 20.0), (22.5, 18.0), (29.0, 14.0), (37.0, 12.6), (46.0, 11.3), (57.0, 8.2)];
const SEVEN_OMEGA: f64 = 316.227_766;

/// An estimated path: delay in seconds and SINR.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Found {
    /// Delay after the first sample, seconds.
    pub delay_s: f64,
    /// SINR as the method sees it; not a number where it does not.
    pub sinr: f64,
}

/// Anything that finds paths in a response: `false_paths` is the rate of false ones per response that it may have.
pub trait PathFinder: Sync {
    /// Its name.
    fn name(&self) -> &str;
    /// The paths of a response.
    fn find(&self, samples: &[[f32; 2]], false_paths: f64) -> Vec<Found>;
}

/// The core's estimator.
pub struct Core;

impl PathFinder for Core {
    fn name(&self) -> &str {
        "cogmint"
    }

    fn find(&self, samples: &[[f32; 2]], false_paths: f64) -> Vec<Found> {
        find(Samples::Complex(samples), false_paths)
    }
}

/// The core's estimator in its magnitude-only mode.
pub struct CoreMagnitude;

impl PathFinder for CoreMagnitude {
    fn name(&self) -> &'static str {
        "cogmint, magnitudes only"
    }

    fn find(&self, samples: &[[f32; 2]], false_paths: f64) -> Vec<Found> {
        let magnitudes: Vec<f32> = samples.iter().map(|[re, im]| re.hypot(*im)).collect();
        find(Samples::Magnitude(&magnitudes), false_paths)
    }
}

fn find(samples: Samples<'_>, false_paths: f64) -> Vec<Found> {
    let pulse = Pulse::root_raised_cosine(DURATION_S as f32, ROLL_OFF as f32);
    let estimator = ChannelEstimator::<PATHS>::new(
        pulse,
        SPACING_S as f32,
        SAMPLES,
        false_paths as f32,
        EstimatorSettings::default(),
    );
    let estimate = estimator.estimate(samples, 0.0).expect("the responses are finite and not silent");
    let found = |path: &cogmint_core::perceptor::channel_estimator::Path| Found {
        delay_s: f64::from(path.delay_s),
        sinr: f64::from(path.sinr),
    };
    estimate.paths.iter().map(found).collect()
}

/// The quality of a method.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Quality {
    /// The method.
    pub method: String,
    /// Responses per figure.
    pub trials: usize,
    /// Root mean square delay error of detected isolated paths over the bound, at the worst of 12 to 30 dB.
    pub delay_rmse_over_crlb: f64,
    /// Share of trials in which two equal paths of 25 dB, 0.5 T_p apart, were both found and nothing else.
    pub resolved_0_5_tp: f64,
    /// The same, 0.7 T_p apart.
    pub resolved_0_7_tp: f64,
    /// The same, 1.0 T_p apart.
    pub resolved_1_0_tp: f64,
    /// The same, 1.5 T_p apart.
    pub resolved_1_5_tp: f64,
    /// The same, 2 T_p apart.
    pub resolved_2_0_tp: f64,
    /// The same, 3 T_p apart.
    pub resolved_3_0_tp: f64,
    /// False paths per response of dense multipath and noise where 0.01 were asked for.
    pub false_paths_at_0_01: f64,
    /// The same where 0.1 was asked for.
    pub false_paths_at_0_1: f64,
    /// The same where 1 was asked for.
    pub false_paths_at_1: f64,
    /// Share of the seven paths' fifth (12.6 dB) that was detected, at the 0.01 rate.
    pub detected_12_6_db: f64,
    /// Share of the seven paths' last (8.2 dB) that was detected.
    pub detected_8_2_db: f64,
    /// Detection of all seven.
    pub detected: Vec<f64>,
    /// False paths per response beside the seven.
    pub seven_false_paths: f64,
    /// Median of the absolute SINR error of detected isolated paths of 5 to 30 dB, decibels, at the rate of 1.
    pub sinr_median_error_db: f64,
    /// False paths per response where dense multipath begins elsewhere than the direct path, at the 0.01 rate.
    pub interference_false_paths: f64,
    /// Responses of the seven paths per second on all cores.
    pub frames_per_second: f64,
}

/// One trial's generator of responses and randomness.
struct Trial {
    rng: Xoshiro128PlusPlus,
}

impl Trial {
    /// An amplitude of a power and a random phase.
    fn phased(&mut self, power: f64) -> Complex64 {
        cis(std::f64::consts::TAU * uniform(&mut self.rng)) * power.sqrt()
    }

    fn between(&mut self, from: f64, to: f64) -> f64 {
        from + (to - from) * uniform(&mut self.rng)
    }
}

/// Runs `trials` trials of an experiment, each with a stream of its own, on all cores.
fn run<T: Send>(
    seed: u64,
    experiment: usize,
    trials: usize,
    trial: impl Fn(&mut ResponseMaker, &mut Trial) -> T + Sync,
) -> Vec<T> {
    let maker =
        || ResponseMaker::new(PulseSpectrum::root_raised_cosine(DURATION_S, ROLL_OFF), SAMPLES, SPACING_S);
    (0..trials)
        .into_par_iter()
        .map_init(maker, |maker, index| {
            let mut own = Trial { rng: stream(seed, Purpose::Experiment, &[experiment, index]) };
            trial(maker, &mut own)
        })
        .collect()
}

/// Bound of the delay's standard deviation at a SINR, seconds.
fn bound_s(sinr: f64) -> f64 {
    let beta_hz = PulseSpectrum::root_raised_cosine(DURATION_S, ROLL_OFF).rms_bandwidth_hz();
    1.0 / (8.0 * (std::f64::consts::PI * beta_hz) * (std::f64::consts::PI * beta_hz) * sinr).sqrt()
}

/// Measures a method.
pub fn measure(method: &dyn PathFinder, trials: usize, seed: u64) -> Quality {
    let [
        resolved_0_5_tp,
        resolved_0_7_tp,
        resolved_1_0_tp,
        resolved_1_5_tp,
        resolved_2_0_tp,
        resolved_3_0_tp,
    ] = [0.5, 0.7, 1.0, 1.5, 2.0, 3.0].map(|apart| resolved(method, trials, seed, apart));
    let [false_paths_at_0_01, false_paths_at_0_1, false_paths_at_1] =
        [0.01, 0.1, 1.0].map(|rate| false_paths(method, trials, seed, rate));
    let (detected, seven_false_paths, frames_per_second) = seven(method, trials, seed);
    Quality {
        method: method.name().into(),
        trials,
        delay_rmse_over_crlb: precision(method, trials, seed),
        resolved_0_5_tp,
        resolved_0_7_tp,
        resolved_1_0_tp,
        resolved_1_5_tp,
        resolved_2_0_tp,
        resolved_3_0_tp,
        false_paths_at_0_01,
        false_paths_at_0_1,
        false_paths_at_1,
        detected_12_6_db: detected[4],
        detected_8_2_db: detected[6],
        detected,
        seven_false_paths,
        sinr_median_error_db: sinr_error(method, trials, seed),
        interference_false_paths: interference(method, trials, seed),
        frames_per_second,
    }
}

fn precision(method: &dyn PathFinder, trials: usize, seed: u64) -> f64 {
    let ratios = ISOLATED_DB.iter().enumerate().map(|(level, db)| {
        let sinr = 10f64.powf(db / 10.0);
        let errors = run(seed, level, trials, |maker, trial| {
            let path = TruePath { delay_s: trial.between(40e-9, 41e-9), amplitude: trial.phased(sinr) };
            let found = method.find(&maker.draw(&mut trial.rng, &[path], None), 0.01);
            let error = |found: &Found| (found.delay_s - path.delay_s).abs();
            found.iter().map(error).filter(|&error| error < 0.5 * DURATION_S).reduce(f64::min)
        });
        let found: Vec<f64> = errors.into_iter().flatten().collect();
        (found.iter().map(|error| error * error).sum::<f64>() / found.len() as f64).sqrt() / bound_s(sinr)
    });
    ratios.fold(0.0, f64::max)
}

fn resolved(method: &dyn PathFinder, trials: usize, seed: u64, pulses_apart: f64) -> f64 {
    let experiment = 100 + (10.0 * pulses_apart) as usize;
    let outcomes = run(seed, experiment, trials, |maker, trial| {
        let apart_s = pulses_apart * DURATION_S;
        let first_s = trial.between(40e-9, 41e-9);
        let power = 10f64.powf(2.5);
        let paths = [0.0, apart_s]
            .map(|more_s| TruePath { delay_s: first_s + more_s, amplitude: trial.phased(power) });
        let mut found = method.find(&maker.draw(&mut trial.rng, &paths, None), RESOLUTION_RATE);
        found.sort_by(|a, b| a.delay_s.total_cmp(&b.delay_s));
        let near = |(found, path): (&Found, &TruePath)| (found.delay_s - path.delay_s).abs() < 0.5 * apart_s;
        found.len() == 2 && found.iter().zip(&paths).all(near)
    });
    share(&outcomes)
}

fn false_paths(method: &dyn PathFinder, trials: usize, seed: u64, rate: f64) -> f64 {
    let experiment = if rate < 0.5 { 200 } else { 201 };
    let counts = run(seed, experiment, trials, |maker, trial| {
        let dense = Dense { omega: SEVEN_OMEGA, onset_s: 12e-9 };
        method.find(&maker.draw(&mut trial.rng, &[], Some(dense)), rate).len()
    });
    counts.iter().sum::<usize>() as f64 / trials as f64
}

fn seven(method: &dyn PathFinder, trials: usize, seed: u64) -> (Vec<f64>, f64, f64) {
    let dense = Some(Dense { omega: SEVEN_OMEGA, onset_s: SEVEN[0].0 * 1e-9 });
    let responses = run(seed, 300, trials, |maker, trial| {
        let paths = SEVEN.map(|(delay_ns, sinr_db)| {
            let delay_s = (delay_ns + trial.between(-0.25, 0.25)) * 1e-9;
            let power = 10f64.powf(sinr_db / 10.0) * maker.level(dense, delay_ns * 1e-9);
            TruePath { delay_s, amplitude: trial.phased(power) }
        });
        let dense = dense.map(|dense| Dense { onset_s: paths[0].delay_s, ..dense });
        (paths, maker.draw(&mut trial.rng, &paths, dense))
    });
    let begin = std::time::Instant::now();
    let found: Vec<Vec<Found>> =
        responses.par_iter().map(|(_, samples)| method.find(samples, 0.01)).collect();
    let frames_per_second = trials as f64 / begin.elapsed().as_secs_f64();
    let near = |found: &Found, path: &TruePath| (found.delay_s - path.delay_s).abs() < 0.5 * DURATION_S;
    let detected = |k: usize| {
        let hits =
            responses.iter().zip(&found).map(|((paths, _), found)| found.iter().any(|f| near(f, &paths[k])));
        share(&hits.collect::<Vec<_>>())
    };
    let extra = responses.iter().zip(&found).map(|((paths, _), found)| {
        found.iter().filter(|found| !paths.iter().any(|path| near(found, path))).count()
    });
    ((0..7).map(detected).collect(), extra.sum::<usize>() as f64 / trials as f64, frames_per_second)
}

fn sinr_error(method: &dyn PathFinder, trials: usize, seed: u64) -> f64 {
    let errors = run(seed, 400, trials, |maker, trial| {
        let sinr_db = trial.between(5.0, 30.0);
        let power = 10f64.powf(sinr_db / 10.0);
        let path = TruePath { delay_s: trial.between(40e-9, 41e-9), amplitude: trial.phased(power) };
        let found = method.find(&maker.draw(&mut trial.rng, &[path], None), 1.0);
        let near = found.iter().find(|found| (found.delay_s - path.delay_s).abs() < 0.5 * DURATION_S);
        near.map(|found| (10.0 * found.sinr.log10() - sinr_db).abs())
    });
    let mut errors: Vec<f64> = errors.into_iter().flatten().collect();
    errors.sort_by(f64::total_cmp);
    errors.get(errors.len() / 2).copied().unwrap_or(f64::NAN)
}

fn interference(method: &dyn PathFinder, trials: usize, seed: u64) -> f64 {
    let counts = run(seed, 500, trials, |maker, trial| {
        let path = TruePath { delay_s: trial.between(12e-9, 20e-9), amplitude: trial.phased(3162.0) };
        // It begins anywhere in the frame, also before the direct path.
        let dense = Dense { omega: 1000.0, onset_s: trial.between(0.0, 60e-9) };
        let found = method.find(&maker.draw(&mut trial.rng, &[path], Some(dense)), 0.01);
        found.iter().filter(|found| (found.delay_s - path.delay_s).abs() >= 0.5 * DURATION_S).count()
    });
    counts.iter().sum::<usize>() as f64 / trials as f64
}

fn share(outcomes: &[bool]) -> f64 {
    outcomes.iter().filter(|&&outcome| outcome).count() as f64 / outcomes.len() as f64
}
