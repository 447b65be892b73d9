//! The channel estimator against closed forms: the Cramer-Rao bound, the set rate of false paths, resolution.

use cogmint_core::observation::Samples;
use cogmint_core::perceptor::channel_estimator::{ChannelEstimate, ChannelEstimator};
use cogmint_core::pulse::{Pulse, PulseShape};
use rand_core::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro128PlusPlus;

const PULSE: Pulse = Pulse { duration_s: 0.5e-9, shape: PulseShape::RootRaisedCosine { roll_off: 0.6 } };
const SPACING_NS: f64 = 0.25;
const SAMPLES: usize = 400;

struct Channel {
    rng: Xoshiro128PlusPlus,
    /// Root-raised-cosine taps, half a pulse apart: they colour the noise as the matched filter does.
    taps: Vec<f64>,
}

impl Channel {
    fn new(seed: u64) -> Self {
        let taps = (-32..=32).map(|k| root_raised_cosine(f64::from(k) * 0.5) * 0.5_f64.sqrt()).collect();
        Self { rng: Xoshiro128PlusPlus::seed_from_u64(seed), taps }
    }

    fn uniform(&mut self) -> f64 {
        (f64::from(self.rng.next_u32()) + 0.5) / 4_294_967_296.0
    }

    /// A complex number of the given magnitude and a random phase.
    fn phased(&mut self, magnitude: f64) -> [f64; 2] {
        let angle = std::f64::consts::TAU * self.uniform();
        [magnitude * angle.cos(), magnitude * angle.sin()]
    }

    fn normal(&mut self) -> [f64; 2] {
        let radius = (-self.uniform().ln()).sqrt();
        self.phased(radius)
    }

    /// Matched-filter samples of paths (delay in ns, amplitude over the noise deviation) in unit noise.
    fn frame(&mut self, paths: &[(f64, [f64; 2])]) -> Vec<[f32; 2]> {
        let white: Vec<[f64; 2]> = (0..SAMPLES + self.taps.len()).map(|_| self.normal()).collect();
        (0..SAMPLES)
            .map(|n| {
                let mut sum = [0.0, 0.0];
                for (tap, [re, im]) in self.taps.iter().zip(&white[n..]) {
                    sum = [sum[0] + tap * re, sum[1] + tap * im];
                }
                for (delay_ns, [re, im]) in paths {
                    let r =
                        f64::from(PULSE.autocorrelation(((n as f64 * SPACING_NS - delay_ns) / 0.5) as f32));
                    sum = [sum[0] + r * re, sum[1] + r * im];
                }
                sum.map(|x| x as f32)
            })
            .collect()
    }
}

fn root_raised_cosine(t: f64) -> f64 {
    let (pi, b) = (std::f64::consts::PI, 0.6);
    if t.abs() < 1e-9 {
        return 1.0 + b * (4.0 / pi - 1.0);
    }
    ((pi * t * (1.0 - b)).sin() + 4.0 * b * t * (pi * t * (1.0 + b)).cos())
        / (pi * t * (1.0 - (4.0 * b * t).powi(2)))
}

fn estimator(false_paths: f32) -> ChannelEstimator<16> {
    ChannelEstimator::new(PULSE, 0.25e-9, SAMPLES, false_paths)
}

fn estimate(estimator: &ChannelEstimator<16>, frame: &[[f32; 2]]) -> ChannelEstimate<16> {
    estimator.estimate(Samples::Complex(frame), 0.0)
}

#[test]
fn isolated_paths_are_delayed_as_precisely_as_the_bound_allows() {
    let estimator = estimator(0.01);
    let mut channel = Channel::new(1);
    for decibels in [15.0_f64, 20.0, 30.0] {
        let snr = 10_f64.powf(decibels / 10.0);
        let bound_ns = 1e9
            / (8.0 * std::f64::consts::PI.powi(2) * f64::from(PULSE.rms_bandwidth_hz()).powi(2) * snr).sqrt();
        let (mut squared, mut found, mut sinrs) = (0.0, 0, Vec::new());
        for _ in 0..600 {
            let delay_ns = 40.0 + channel.uniform();
            let amplitude = channel.phased(snr.sqrt());
            let frame = channel.frame(&[(delay_ns, amplitude)]);
            let estimate = estimate(&estimator, &frame);
            let near =
                estimate.paths.iter().find(|path| (f64::from(path.delay_s) * 1e9 - delay_ns).abs() < 0.25);
            if let Some(path) = near {
                squared += (f64::from(path.delay_s) * 1e9 - delay_ns).powi(2);
                sinrs.push(f64::from(path.sinr));
                found += 1;
            }
        }
        let ratio = (squared / f64::from(found)).sqrt() / bound_ns;
        sinrs.sort_by(f64::total_cmp);
        let median_db = 10.0 * sinrs[sinrs.len() / 2].log10();
        println!(
            "{decibels} dB: RMSE / CRLB {ratio:.3}, median SINR {median_db:.2} dB, {found} of 600 found"
        );
        assert!(found >= 594 && ratio < 1.2 && (median_db - decibels).abs() < 0.5);
    }
}

#[test]
fn pure_noise_gives_the_false_paths_asked_for() {
    let mut channel = Channel::new(2);
    for rate in [0.1_f32, 1.0] {
        let estimator = estimator(rate);
        let frames = 1500;
        let paths: usize = (0..frames).map(|_| estimate(&estimator, &channel.frame(&[])).paths.len()).sum();
        let measured = paths as f64 / f64::from(frames);
        println!("asked for {rate}, got {measured:.3}");
        assert!(measured > f64::from(rate) / 2.0 && measured < f64::from(rate) * 2.0, "{rate}: {measured}");
    }
}

#[test]
fn two_equal_paths_one_pulse_apart_are_resolved() {
    let estimator = estimator(0.01);
    let mut channel = Channel::new(3);
    let mut resolved = 0;
    for _ in 0..500 {
        let delay_ns = 40.0 + channel.uniform();
        let amplitudes = [channel.phased(17.8), channel.phased(17.8)];
        let frame = channel.frame(&[(delay_ns, amplitudes[0]), (delay_ns + 0.5, amplitudes[1])]);
        resolved += usize::from(estimate(&estimator, &frame).paths.len() == 2);
    }
    println!("{resolved} of 500 resolved at one pulse duration, 25 dB");
    assert!(resolved >= 450, "{resolved} of 500");
}

#[test]
fn magnitudes_alone_still_give_the_path_within_a_fraction_of_a_sample() {
    let estimator = ChannelEstimator::<16>::new(PULSE, 0.25e-9, SAMPLES, 0.1);
    let mut channel = Channel::new(4);
    let (mut squared, mut extra) = (0.0, 0);
    for _ in 0..300 {
        let delay_ns = 40.0 + channel.uniform();
        let amplitude = channel.phased(30.0);
        let magnitudes: Vec<f32> =
            channel.frame(&[(delay_ns, amplitude)]).iter().map(|[re, im]| re.hypot(*im)).collect();
        let estimate = estimator.estimate(Samples::Magnitude(&magnitudes), 0.0);
        let first = estimate.paths.first().expect("a path of 29.5 dB");
        squared += (f64::from(first.delay_s) * 1e9 - delay_ns).powi(2);
        extra += estimate.paths.len() - 1;
    }
    let rmse_ns = (squared / 300.0_f64).sqrt();
    println!("RMSE {rmse_ns:.4} ns, {extra} extra paths in 300 frames");
    assert!(rmse_ns < 0.03 && extra < 60, "{rmse_ns} ns, {extra}");
}

#[test]
fn degenerate_frames_give_an_answer_in_bounded_time() {
    let estimator = estimator(0.1);
    for frame in [
        vec![[1.0, 0.0]; SAMPLES],
        (0..SAMPLES).map(|n| [if n == 7 { 1e15 } else { 0.0 }, 0.0]).collect(),
        (0..SAMPLES).map(|n| [if n % 2 == 0 { 1.0 } else { -1.0 }, 1e-30]).collect(),
        vec![[1e-30, -1e-30]; SAMPLES],
        vec![[3.0, 4.0]],
        Vec::new(),
    ] {
        let estimate = estimate(&estimator, &frame);
        for path in &estimate.paths {
            assert!(path.delay_s.is_finite() && path.sinr.is_finite() && path.sinr > 0.0);
        }
        let magnitudes: Vec<f32> = frame.iter().map(|[re, im]| re.hypot(*im)).collect();
        estimator.estimate(Samples::Magnitude(&magnitudes), 0.0);
    }
}
