//! Scratch.
use cogmint::channel::pulse::PulseSpectrum;
use cogmint::channel::random::{Purpose, stream, uniform};
use cogmint::experiment::response::{Dense, ResponseMaker};
use cogmint_core::observation::Samples;
use cogmint_core::perceptor::channel_estimator::ChannelEstimator;
use cogmint_core::pulse::Pulse;
use rayon::prelude::*;
fn main() {
    for (tp, b, ts, n) in [
        (0.5e-9, 0.6, 0.25e-9, 400),
        (2e-9, 0.5, 1.0016e-9, 1016),
        (0.5e-9, 0.6, 0.1e-9, 1000),
        (2e-9, 0.5, 1e-9, 128),
    ] {
        for omega in [0.0, 316.0, 5000.0] {
            for rate in [0.01, 0.1, 1.0] {
                let trials = 4000;
                let maker = || ResponseMaker::new(PulseSpectrum::root_raised_cosine(tp, b), n, ts);
                let est = ChannelEstimator::<16>::new(
                    Pulse::root_raised_cosine(tp as f32, b as f32),
                    ts as f32,
                    n,
                    rate as f32,
                );
                let k: usize = (0..trials)
                    .into_par_iter()
                    .map_init(maker, |m, i| {
                        let mut rng = stream(9, Purpose::Experiment, &[n, i]);
                        let onset = n as f64 * ts * (0.1 + 0.3 * uniform(&mut rng));
                        let d = if omega > 0.0 { Some(Dense { omega, onset_s: onset }) } else { None };
                        est.estimate(Samples::Complex(&m.draw(&mut rng, &[], d)), 0.0).unwrap().paths.len()
                    })
                    .sum();
                print!(
                    "Tp {tp:e} n {n} omega {omega} rate {rate}: {:.4} ratio {:.2}   ",
                    k as f64 / trials as f64,
                    k as f64 / trials as f64 / rate
                );
            }
            println!();
        }
    }
}
