//! Below the threshold: what the rest of a frame says of sources whose paths were not found, in frames of which it is known what is
//! in them.

use cogmint::channel::pulse::PulseSpectrum;
use cogmint::experiment::response::{Dense, ResponseMaker, TruePath};
use cogmint_core::model::observation::{Frame, Observation, Samples};
use cogmint_core::perceptor::below_threshold::strength::{Background, CLASSES, Likelihoods, Strength};
use cogmint_core::perceptor::channel_estimator::residual::Residual;
use cogmint_core::perceptor::channel_estimator::{ChannelEstimator, EstimatorSettings};
use cogmint_core::radio::library::Action;
use cogmint_core::radio::pulse::{Pulse, PulseShape};
use cogmint_core::{Anchor, Config, Map, MappedVirtualAnchor, Tracker};
use rand_core::SeedableRng;
use rand_xoshiro::Xoshiro128PlusPlus;

const PULSE: Pulse = Pulse { duration_s: 0.5e-9, shape: PulseShape::RootRaisedCosine { roll_off: 0.6 } };
const SPACING_S: f64 = 0.25e-9;
const SAMPLES: usize = 400;
const C_M_S: f64 = 299_792_458.0;

fn maker() -> ResponseMaker {
    ResponseMaker::new(PulseSpectrum::root_raised_cosine(0.5e-9, 0.6), SAMPLES, SPACING_S)
}

fn estimator() -> ChannelEstimator<16> {
    ChannelEstimator::new(PULSE, SPACING_S as f32, SAMPLES, 0.1, EstimatorSettings::default())
}

fn magnitudes(frame: &[[f32; 2]]) -> Vec<f32> {
    frame.iter().map(|[re, im]| re.hypot(*im)).collect()
}

/// A path of this delay, nanoseconds, and amplitude.
fn path(delay_ns: f64, amplitude: f64) -> TruePath {
    TruePath { delay_s: delay_ns * 1e-9, amplitude: amplitude.into() }
}

/// What is left of frames of these paths and of this dense multipath at points two pulse durations apart, where anything is known.
fn energies(
    frames: u64,
    paths: &[TruePath],
    dense: Option<Dense>,
    is_complex: bool,
    keep: impl Fn(f64) -> bool,
) -> Vec<u8> {
    let (own, mut maker) = (estimator(), maker());
    let mut rng = Xoshiro128PlusPlus::seed_from_u64(7);
    let mut all = Vec::new();
    for _ in 0..frames {
        let frame = maker.draw(&mut rng, paths, dense);
        let magnitude = magnitudes(&frame);
        let samples = if is_complex { Samples::Complex(&frame) } else { Samples::Magnitude(&magnitude) };
        let estimate = own.estimate(samples, 0.0).unwrap();
        let mut residual = Residual::<800>::default();
        own.leave(samples, 0.0, &estimate, 100.0, &mut residual);
        for step in 2..98 {
            let delay_s = f64::from(step) * 1e-9 + 0.13e-9;
            if keep(delay_s) {
                all.extend(residual.energy((delay_s * C_M_S) as f32));
            }
        }
    }
    all
}

/// The background that these energies teach, and the mean of a path's likelihood over them, before and after.
fn mean_ratios(energies: &[u8], samples: &Samples<'_>) -> [f64; 2] {
    let likelihoods = Likelihoods::new(estimator().threshold(samples));
    let mut learnt = Background::USUAL;
    for batch in energies.chunks(50).cycle().take(4000) {
        let mut mean = Background { noise: 0.0, paths: [0.0; CLASSES] };
        for energy in batch {
            let posterior = learnt.posterior(*energy, &likelihoods);
            mean.noise += posterior.noise / batch.len() as f32;
            for (sum, path) in mean.paths.iter_mut().zip(posterior.paths) {
                *sum += path / batch.len() as f32;
            }
        }
        learnt.mix(&mean, 0.01);
    }
    let strength = Strength::about(10_f32.ln(), 1.0, &likelihoods);
    [Background { noise: 1.0, paths: [0.0; CLASSES] }, learnt].map(|background| {
        let ratios = energies.iter().map(|energy| strength.ratio(*energy, &likelihoods, &background));
        ratios.map(f64::from).sum::<f64>() / energies.len() as f64
    })
}

#[test]
fn where_there_is_no_path_its_likelihood_is_one_on_average() {
    let dense = Dense { omega: 300.0, onset_s: 20e-9 };
    for is_complex in [true, false] {
        for dense in [None, Some(dense)] {
            let energies = energies(600, &[], dense, is_complex, |_| true);
            let of = if is_complex { Samples::Complex(&[]) } else { Samples::Magnitude(&[]) };
            let [_, learnt] = mean_ratios(&energies, &of);
            println!("complex {is_complex}, dense multipath {}: {learnt}", dense.is_some());
            assert!((learnt - 1.0).abs() < 0.02, "complex {is_complex}, {dense:?}: {learnt}");
        }
    }
}

/// Paths that are in no map: without what is learnt, each would be taken for the one expected.
#[test]
fn what_is_in_no_map_flattens_the_likelihood() {
    // One in three of the places looked at has a path of 4 dB, which is hardly ever found.
    let paths: Vec<TruePath> = (1..33).map(|k| path(3.0 * f64::from(k) + 0.13, 1.6)).collect();
    let energies = energies(300, &paths, None, true, |_| true);
    let [noise, learnt] = mean_ratios(&energies, &Samples::Complex(&[]));
    println!("as in noise {noise}, as learnt {learnt}");
    assert!(noise > 1.5, "the planted paths must show: {noise}");
    assert!((learnt - 1.0).abs() < 0.02, "{learnt}");
}

#[test]
fn a_path_below_the_threshold_is_seen_where_it_is() {
    let own = Likelihoods::new(estimator().threshold(&Samples::Complex(&[])));
    let strength = Strength::about(2.0, 1.0, &own);
    let weak = path(50.13, 2.3);
    let mean_nat = |at_s: f64| {
        let energies = energies(400, &[weak], None, true, |delay_s| (delay_s - at_s).abs() < 1e-12);
        let ratio = |energy: &u8| f64::from(strength.ratio(*energy, &own, &Background::USUAL)).ln();
        energies.iter().map(ratio).sum::<f64>() / energies.len() as f64
    };
    let (there, elsewhere) = (mean_nat(50.13e-9), mean_nat(70.13e-9));
    assert!(there > 0.5 && elsewhere < -0.3, "{there} {elsewhere}");
}

/// A tag that stands somewhere, told of images that are not there: two seconds of noise alone must not make it sure of anything.
#[test]
fn noise_alone_makes_nobody_sure() {
    let anchors =
        [Anchor { position_m: [0.0, 0.0], height_m: 0.0 }, Anchor { position_m: [8.0, 1.0], height_m: 0.0 }];
    let image = |anchor: usize, position_m: [f32; 2]| MappedVirtualAnchor { anchor, position_m, std_m: 0.02 };
    let images = [
        image(0, [0.0, 12.0]),
        image(0, [-6.0, 0.0]),
        image(0, [16.0, 0.0]),
        image(1, [8.0, 11.0]),
        image(1, [-14.0, 1.0]),
    ];
    let actions = [Action { carrier_hz: 7e9, pulse_duration_s: PULSE.duration_s }];
    let mut maker = maker();
    let mut rng = Xoshiro128PlusPlus::seed_from_u64(11);
    let (mut sum, mut runs) = (0.0, 0.0);
    for run in 0..40_u32 {
        let mut config = Config { discovery: false, ..Config::default() };
        config.start.position_m = [4.0, 4.0];
        config.start.position_std_m = 0.15;
        let map = Map { virtual_anchors: &images, plan: None };
        let mut tracker = Tracker::<2, 5, 5, 1, 16, 1, 8, 800, 6>::new();
        tracker.start(&config, &anchors, &map, &actions, run.into()).unwrap();
        // Where the tag truly stands: as the start says, by a spiral of equal areas.
        let radius = 0.15 * (-2.0 * (1.0 - (f64::from(run) + 0.5) / 40.0).ln()).sqrt();
        let angle = 2.399_963 * f64::from(run);
        let truth = [4.0 + radius * angle.cos(), 4.0 + radius * angle.sin()];
        for _ in 0..20 {
            let frames: Vec<Vec<[f32; 2]>> = (0..2)
                .map(|_| maker.draw(&mut rng, &[], Some(Dense { omega: 50.0, onset_s: 15e-9 })))
                .collect();
            let observations: Vec<_> = frames
                .iter()
                .enumerate()
                .map(|(anchor, samples)| {
                    Observation::Frame(Frame {
                        anchor,
                        action: 0,
                        first_sample_delay_s: 0.0,
                        samples: Samples::Complex(samples),
                        sequence: None,
                    })
                })
                .collect();
            tracker.cycle(&observations, 0.1, None).unwrap();
        }
        // The leading place: the tag may also be anywhere, where none of its paths is seen.
        let agent = tracker.filter().agent();
        let c = agent.covariance.map(f64::from);
        let [dx, dy] = [f64::from(agent.mean.x) - truth[0], f64::from(agent.mean.y) - truth[1]];
        let determinant = c.m11 * c.m22 - c.m21 * c.m21;
        sum += (c.m22 * dx * dx - 2.0 * c.m21 * dx * dy + c.m11 * dy * dy) / determinant;
        runs += 1.0;
    }
    let nees = sum / runs;
    println!("NEES {nees}");
    // Two for two coordinates that are as wrong as they are claimed to be.
    assert!(nees > 1.0 && nees < 3.0, "{nees}");
}
