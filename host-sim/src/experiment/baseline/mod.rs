//! Known methods for finding paths, to measure the core's channel estimator against, on the same responses.
//!
//! Each is written as one who relies on it would write it: delays between the samples, a level taken from the frame
//! itself, a threshold set by the same rate of false paths. What they share is in `frame.rs` (band-limited
//! interpolation, the pulse), `level.rs` (level and threshold), `climb.rs` (the maximum between the samples) and
//! `least_squares.rs` (joint amplitudes). Positions are in samples after the first.

mod clean;
mod climb;
mod esprit;
mod frame;
mod least_squares;
mod level;
mod line_spectrum;
mod matched_filter;
mod pursuit;

pub mod program;

use clean::Clean;
use esprit::Esprit;
use level::LevelModel;
use matched_filter::MatchedFilter;
use pursuit::Pursuit;

use super::estimator::PathFinder;

/// The methods' names, in the order of the comparison.
pub const NAMES: [&str; 8] = [
    "matched-filter",
    "matched-filter-local",
    "clean",
    "clean-local",
    "omp",
    "omp-local",
    "esprit",
    "esprit-local",
];

/// The method of a name: with one level for the whole frame, or with one around every sample (`-local`).
pub fn method(name: &str) -> Option<Box<dyn PathFinder>> {
    use LevelModel::{LocalMean, LocalMedian, White};
    Some(match name {
        "matched-filter" => Box::new(MatchedFilter::new(White)),
        "matched-filter-local" => Box::new(MatchedFilter::new(LocalMedian)),
        "clean" => Box::new(Clean::new(White)),
        "clean-local" => Box::new(Clean::new(LocalMean)),
        "omp" => Box::new(Pursuit::new(White)),
        "omp-local" => Box::new(Pursuit::new(LocalMean)),
        "esprit" => Box::new(Esprit::new(White)),
        "esprit-local" => Box::new(Esprit::new(LocalMean)),
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::super::response::{ResponseMaker, TruePath};
    use super::*;
    use crate::channel::cis;
    use crate::channel::pulse::PulseSpectrum;
    use crate::channel::random::{Purpose, stream, uniform};

    const PULSE_S: f64 = 0.5e-9;

    fn maker() -> ResponseMaker {
        ResponseMaker::new(PulseSpectrum::root_raised_cosine(PULSE_S, 0.6), 400, 0.25e-9)
    }

    fn all() -> Vec<Box<dyn PathFinder>> {
        NAMES.iter().filter_map(|name| method(name)).collect()
    }

    #[test]
    fn every_name_has_its_method() {
        let names: Vec<String> = all().iter().map(|method| method.name().to_owned()).collect();
        assert_eq!(names, NAMES);
    }

    #[test]
    fn every_method_finds_an_isolated_path_of_25_db_within_three_times_its_bound() {
        let mut maker = maker();
        let turn_per_s = std::f64::consts::TAU * 633.66e6;
        let bound_s = 1.0 / (turn_per_s * (2.0 * 10f64.powf(2.5)).sqrt());
        for method in all() {
            let (mut squares, mut alone) = (0.0, 0);
            for trial in 0..20 {
                let mut rng = stream(7, Purpose::Experiment, &[trial]);
                let delay_s = 40e-9 + 1e-9 * uniform(&mut rng);
                let amplitude = cis(6.0 * uniform(&mut rng)) * 10f64.powf(1.25);
                let samples = maker.draw(&mut rng, &[TruePath { delay_s, amplitude }], None);
                let found = method.find(&samples, 0.01);
                let error = |path: &super::super::estimator::Found| (path.delay_s - delay_s).abs();
                squares += found.iter().map(error).fold(1.0, f64::min).powi(2) / 20.0;
                alone += usize::from(found.len() == 1);
            }
            let name = method.name();
            assert!(squares.sqrt() < 3.0 * bound_s, "{name}: {} s, bound {bound_s} s", squares.sqrt());
            assert!(alone >= 17, "{name}: {alone} of 20 with one path only");
        }
    }

    #[test]
    fn every_method_finds_two_equal_paths_two_pulses_apart() {
        let mut maker = maker();
        for method in all() {
            let mut both = 0;
            for trial in 0..10 {
                let mut rng = stream(8, Purpose::Experiment, &[trial]);
                let first_s = 40e-9 + 1e-9 * uniform(&mut rng);
                let paths = [0.0, 2.0 * PULSE_S].map(|more_s| TruePath {
                    delay_s: first_s + more_s,
                    amplitude: cis(6.0 * uniform(&mut rng)) * 10f64.powf(1.25),
                });
                let found = method.find(&maker.draw(&mut rng, &paths, None), 0.01);
                let near = |path: &TruePath| {
                    found.iter().any(|found| (found.delay_s - path.delay_s).abs() < 0.2 * PULSE_S)
                };
                both += usize::from(paths.iter().all(near));
            }
            assert_eq!(both, 10, "{}", method.name());
        }
    }

    #[test]
    fn no_method_finds_anything_in_silence() {
        for method in all() {
            assert!(method.find(&[[0.0; 2]; 400], 0.01).is_empty(), "{}", method.name());
        }
    }

    /// The threshold belongs to the level that a method takes, so that the rate asked for is the rate had.
    #[test]
    fn every_method_keeps_the_rate_of_false_paths_in_white_noise() {
        let mut maker = maker();
        for method in all() {
            let count = |trial: usize| {
                let mut rng = stream(9, Purpose::Experiment, &[trial]);
                method.find(&maker.draw(&mut rng, &[], None), 1.0).len()
            };
            let rate = (0..100).map(count).sum::<usize>() as f64 / 100.0;
            // ESPRIT proposes 16 delays wherever they fall, so that it may miss a maximum, but never makes more of them.
            let least = if method.name().starts_with("esprit") { 0.1 } else { 0.5 };
            assert!((least..2.0).contains(&rate), "{}: {rate}", method.name());
        }
    }
}
