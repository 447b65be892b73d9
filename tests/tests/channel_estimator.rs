//! The channel estimator against closed forms: the Cramer-Rao bound, the set rate of false paths, resolution.

use cogmint::channel::pulse::PulseSpectrum;
use cogmint::experiment::response::{Dense, ResponseMaker};
use cogmint_core::model::observation::Samples;
use cogmint_core::perceptor::channel_estimator::{ChannelEstimate, ChannelEstimator, EstimatorSettings};
use cogmint_core::radio::pulse::{Pulse, PulseShape};
use rand_core::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro128PlusPlus;
use rayon::prelude::*;

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
        self.frame_in(paths, None)
    }

    /// The same in dense multipath of a power over the white noise's and an onset in ns: white in a quarter of a
    /// pulse, weighted by the soft-onset profile, and filtered by R.
    fn frame_in(&mut self, paths: &[(f64, [f64; 2])], dense: Option<(f64, f64)>) -> Vec<[f32; 2]> {
        let step_ns = SPACING_NS / 2.0;
        let scatterers: Vec<[f64; 2]> = dense.map_or(Vec::new(), |(power, onset_ns)| {
            let draw = |n: i32| {
                let t = f64::from(n - 32) * step_ns - onset_ns;
                let rise = 1.0 - 0.98 * (-t / 5.0).exp();
                let density = if t < 0.0 { 0.0 } else { rise * (-t / 20.0).exp() / (20.0 - 0.98 * 4.0) };
                let scale = (power * density * step_ns).sqrt();
                self.normal().map(|x| scale * x)
            };
            (0..2 * SAMPLES as i32 + 65).map(draw).collect()
        });
        let pulse: Vec<f64> = (-32..=32).map(|n| f64::from(PULSE.autocorrelation(n as f32 * 0.25))).collect();
        let white: Vec<[f64; 2]> = (0..SAMPLES + self.taps.len()).map(|_| self.normal()).collect();
        (0..SAMPLES)
            .map(|n| {
                let mut sum = [0.0, 0.0];
                for (tap, [re, im]) in self.taps.iter().zip(&white[n..]) {
                    sum = [sum[0] + tap * re, sum[1] + tap * im];
                }
                for (r, [re, im]) in pulse.iter().zip(scatterers.iter().skip(2 * n)) {
                    sum = [sum[0] + r * re, sum[1] + r * im];
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
    ChannelEstimator::new(PULSE, 0.25e-9, SAMPLES, false_paths, EstimatorSettings::default())
}

fn estimate(estimator: &ChannelEstimator<16>, frame: &[[f32; 2]]) -> ChannelEstimate<16> {
    estimator.estimate(Samples::Complex(frame), 0.0).expect("finite samples")
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

fn magnitudes(estimator: &ChannelEstimator<16>, frame: &[[f32; 2]]) -> ChannelEstimate<16> {
    let magnitudes: Vec<f32> = frame.iter().map(|[re, im]| re.hypot(*im)).collect();
    estimator.estimate(Samples::Magnitude(&magnitudes), 0.0).expect("finite samples")
}

#[test]
fn magnitudes_alone_give_the_delay_as_precisely_as_the_bound_allows_and_say_so() {
    let estimator = estimator(0.01);
    let mut channel = Channel::new(4);
    for decibels in [15.0_f64, 20.0, 30.0] {
        let snr = 10_f64.powf(decibels / 10.0);
        let bound_ns = 1e9
            / (8.0 * std::f64::consts::PI.powi(2) * f64::from(PULSE.rms_bandwidth_hz()).powi(2) * snr).sqrt();
        let (mut squared, mut normalised, mut found, mut extra) = (0.0, 0.0, 0, 0);
        for _ in 0..600 {
            let delay_ns = 40.0 + channel.uniform();
            let amplitude = channel.phased(snr.sqrt());
            let estimate = magnitudes(&estimator, &channel.frame(&[(delay_ns, amplitude)]));
            let near =
                estimate.paths.iter().find(|path| (f64::from(path.delay_s) * 1e9 - delay_ns).abs() < 0.25);
            extra += estimate.paths.len() - usize::from(near.is_some());
            if let Some(path) = near {
                let error_ns = f64::from(path.delay_s) * 1e9 - delay_ns;
                squared += error_ns.powi(2);
                normalised += error_ns.powi(2) / (f64::from(path.delay_variance_s2) * 1e18);
                found += 1;
            }
        }
        let ratio = (squared / f64::from(found)).sqrt() / bound_ns;
        let normalised = normalised / f64::from(found);
        println!(
            "{decibels} dB: RMSE / CRLB {ratio:.3}, squared error over its variance {normalised:.3}, {extra} extra"
        );
        assert!(found >= 594 && extra < 20 && ratio < 1.2 && normalised > 0.7 && normalised < 1.4);
    }
}

#[test]
fn the_delay_of_a_magnitude_has_no_bias_between_the_samples() {
    // A parabola through the magnitudes is up to 9 ps off here, one through their squares 22 ps.
    let estimator = estimator(0.01);
    let mut channel = Channel::new(5);
    for step in 0..10 {
        let delay_ns = 40.0 + SPACING_NS * f64::from(step) / 10.0;
        let mut error_ns = 0.0;
        for _ in 0..100 {
            let amplitude = channel.phased(100.0);
            let estimate = magnitudes(&estimator, &channel.frame(&[(delay_ns, amplitude)]));
            let path = estimate.paths.first().expect("a path of 40 dB");
            error_ns += (f64::from(path.delay_s) * 1e9 - delay_ns) / 100.0;
        }
        assert!(error_ns.abs() < 1e-3, "{error_ns} ns at {step} tenths of a sample");
    }
}

#[test]
fn magnitudes_of_noise_and_dense_multipath_give_the_false_paths_asked_for() {
    let mut channel = Channel::new(6);
    for rate in [0.1_f32, 1.0] {
        let estimator = estimator(rate);
        for dense in [None, Some((300.0, 12.0))] {
            let frames = 1500;
            let count = |_| {
                let frame = channel.frame_in(&[], dense);
                magnitudes(&estimator, &frame).paths.len()
            };
            let measured = (0..frames).map(count).sum::<usize>() as f64 / f64::from(frames);
            println!("asked for {rate}, got {measured:.3} with dense multipath {dense:?}");
            let most = if dense.is_some() { 2.5 } else { 2.0 };
            assert!(
                measured > f64::from(rate) / 2.0 && measured < f64::from(rate) * most,
                "{rate}: {measured}"
            );
        }
    }
}

#[test]
fn magnitudes_of_two_paths_a_pulse_and_a_half_apart_are_two_paths() {
    let estimator = estimator(0.01);
    let mut channel = Channel::new(7);
    for apart_ns in [0.75, 1.0, 1.5] {
        let (mut resolved, mut normalised) = (0, 0.0);
        for _ in 0..300 {
            let delay_ns = 40.0 + channel.uniform();
            let amplitudes = [channel.phased(17.8), channel.phased(17.8)];
            let frame = channel.frame(&[(delay_ns, amplitudes[0]), (delay_ns + apart_ns, amplitudes[1])]);
            let estimate = magnitudes(&estimator, &frame);
            if let ([_, _], Some(first)) = (
                estimate.paths.as_slice(),
                estimate.paths.iter().min_by(|a, b| a.delay_s.total_cmp(&b.delay_s)),
            ) {
                let error_ns = f64::from(first.delay_s) * 1e9 - delay_ns;
                normalised += error_ns.powi(2) / (f64::from(first.delay_variance_s2) * 1e18);
                resolved += usize::from(error_ns.abs() < 0.25);
            }
        }
        let normalised = normalised / f64::from(resolved as u32);
        println!("{apart_ns} ns apart: {resolved} of 300, squared error over its variance {normalised:.2}");
        assert!(resolved >= 285 && normalised < 1.5, "{apart_ns} ns: {resolved} of 300, {normalised}");
    }
}

#[test]
fn no_two_paths_of_magnitudes_are_closer_than_a_pulse() {
    let estimator = estimator(1.0);
    let mut channel = Channel::new(8);
    for _ in 0..200 {
        let paths: Vec<_> = (0..12).map(|_| (20.0 + 5.0 * channel.uniform(), channel.phased(30.0))).collect();
        let mut delays_ns: Vec<f32> = magnitudes(&estimator, &channel.frame(&paths))
            .paths
            .iter()
            .map(|path| path.delay_s * 1e9)
            .collect();
        delays_ns.sort_by(f32::total_cmp);
        // Found a pulse apart, they may then move by a fraction of a sample.
        assert!(delays_ns.windows(2).all(|pair| pair[1] - pair[0] > 0.3), "{delays_ns:?}");
    }
}

#[test]
fn a_strong_path_in_dense_multipath_is_one_path_and_its_side_lobes_none() {
    let estimator = estimator(0.1);
    let mut channel = Channel::new(9);
    let (mut found, mut extra) = (0, 0);
    for _ in 0..300 {
        let delay_ns = 12.0 + channel.uniform();
        let amplitude = channel.phased(56.2);
        let frame = channel.frame_in(&[(delay_ns, amplitude)], Some((300.0, delay_ns)));
        let estimate = magnitudes(&estimator, &frame);
        let near = |delay_s: f32| (f64::from(delay_s) * 1e9 - delay_ns).abs() < 0.25;
        let hits = estimate.paths.iter().filter(|path| near(path.delay_s)).count();
        found += usize::from(hits == 1);
        extra += estimate.paths.len() - hits;
    }
    println!("{found} of 300 found, {extra} extra");
    assert!(found == 300 && extra < 90, "{found}, {extra}");
}

#[test]
fn magnitudes_without_a_pulse_give_no_path() {
    let estimator = estimator(1.0);
    for shape in [|_| 1.0, |n| n as f32, |n| (n % 2) as f32, |n| 400.0 - n as f32] {
        let samples: Vec<f32> = (0..SAMPLES).map(shape).collect();
        assert!(estimator.estimate(Samples::Magnitude(&samples), 0.0).unwrap().paths.is_empty());
    }
}

/// Pulses of 0.5 and 2 ns, short and long frames, white noise alone and dense multipath up to 27 dB above it.
#[test]
fn the_rate_of_false_paths_holds_for_any_pulse_frame_and_dense_multipath() {
    const TRIALS: usize = 3000;
    const RATE: f64 = 0.1;
    for (duration_s, roll_off, spacing_s, samples) in
        [(0.5e-9, 0.6, 0.25e-9, 400), (2e-9, 0.5, 1.0016e-9, 1016), (0.5e-9, 0.6, 0.1e-9, 1000)]
    {
        let pulse = Pulse::root_raised_cosine(duration_s as f32, roll_off as f32);
        let estimator = ChannelEstimator::<16>::new(
            pulse,
            spacing_s as f32,
            samples,
            RATE as f32,
            EstimatorSettings::default(),
        );
        for omega in [0.0, 316.0, 5000.0] {
            let maker = || {
                let spectrum = PulseSpectrum::root_raised_cosine(duration_s, roll_off);
                ResponseMaker::new(spectrum, samples, spacing_s)
            };
            let false_paths = |maker: &mut ResponseMaker, trial: usize| {
                let mut rng = Xoshiro128PlusPlus::seed_from_u64(trial as u64);
                let part = 0.1 + 0.3 * f64::from(rng.next_u32()) / 4_294_967_296.0;
                let onset_s = part * samples as f64 * spacing_s;
                let dense = (omega > 0.0).then_some(Dense { omega, onset_s });
                estimate(&estimator, &maker.draw(&mut rng, &[], dense)).paths.len()
            };
            let found: usize = (0..TRIALS).into_par_iter().map_init(maker, false_paths).sum();
            let rate = found as f64 / TRIALS as f64;
            println!("T_p {duration_s:e} s, {samples} samples, Omega {omega}: {rate:.3} of {RATE}");
            assert!(rate > 0.6 * RATE && rate < 1.6 * RATE, "T_p {duration_s:e}, Omega {omega}: {rate}");
        }
    }
}

/// A pulse that is no raised cosine, as samples of its autocorrelation: exp(-(t/w)^2). Paths come to within
/// the bound, and no others.
#[test]
fn a_sampled_pulse_is_as_good_as_a_known_one() {
    let width_ns = 0.35;
    let at = |t_ns: f64| (-(t_ns / width_ns).powi(2)).exp();
    let step_ns = 0.0625;
    let shape = PulseShape::Sampled {
        step_s: 1e-9 * step_ns as f32,
        autocorrelation: std::array::from_fn(|lag| at(lag as f64 * step_ns) as f32),
    };
    let pulse = Pulse { duration_s: 0.5e-9, shape };
    let estimator = ChannelEstimator::<16>::new(pulse, 0.25e-9, SAMPLES, 0.01, EstimatorSettings::default());
    // Noise of the spectrum that the matched filter leaves: white noise through exp(-2 (t/w)^2).
    let taps: Vec<f64> = (-8..=8).map(|k| at(2f64.sqrt() * f64::from(k) * SPACING_NS)).collect();
    let scale = taps.iter().map(|tap| tap * tap).sum::<f64>().sqrt();
    let mut channel = Channel::new(12);
    let (mut squares, mut found, mut others) = (0.0, 0.0, 0);
    const TRIALS: usize = 1500;
    let sinr = 100.0;
    for _ in 0..TRIALS {
        let delay_ns = 40.0 + channel.uniform();
        let [re, im] = channel.phased(f64::sqrt(sinr));
        let white: Vec<[f64; 2]> = (0..SAMPLES + taps.len()).map(|_| channel.normal()).collect();
        let frame: Vec<[f32; 2]> = (0..SAMPLES)
            .map(|n| {
                let r = at(n as f64 * SPACING_NS - delay_ns);
                let noise = |part: usize| {
                    taps.iter().zip(&white[n..]).map(|(tap, z)| tap * z[part]).sum::<f64>() / scale
                };
                [(re * r + noise(0)) as f32, (im * r + noise(1)) as f32]
            })
            .collect();
        for path in &estimate(&estimator, &frame).paths {
            let error_ns = f64::from(path.delay_s) * 1e9 - delay_ns;
            if error_ns.abs() < 0.25 {
                squares += error_ns * error_ns;
                found += 1.0;
            } else {
                others += 1;
            }
        }
    }
    // beta = 1 / (sqrt(2) pi w).
    let beta_ghz = 1.0 / (2f64.sqrt() * std::f64::consts::PI * width_ns);
    let bound_ns = 1.0 / (8.0 * (std::f64::consts::PI * beta_ghz).powi(2) * sinr).sqrt();
    let ratio = (squares / found).sqrt() / bound_ns;
    println!("{found} of {TRIALS} found, {others} others, delay RMSE {ratio:.3} of its bound");
    assert!(found >= 0.999 * TRIALS as f64 && ratio < 1.1, "{found} found, {ratio}");
    assert!(others as f64 <= 0.02 * TRIALS as f64, "{others} others");
}
