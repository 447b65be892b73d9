//! A frame as a line spectrum: its frequency samples inside the pulse's band over the pulse's own, so that a path of
//! delay tau is the line exp(-j 2 pi f tau); and paths again from the delays that a line-spectral method gives.

use super::super::estimator::{Found, PATHS};
use super::frame::{Frame, Radio};
use super::least_squares::keep_worthy;
use super::level::LevelModel;
use crate::channel::cis;
use rustfft::num_complex::Complex64;

/// The band used: where the pulse's power is at least this share of its middle's. Less would be mostly noise, more would
/// throw bandwidth away.
const LEAST_POWER: f64 = 0.25;
/// Delays nearer than this to each other, in samples, are one.
const SAME: f64 = 0.2;

/// Frequency samples `step_hz` apart around the carrier, in increasing order.
#[derive(Clone, Debug)]
pub(super) struct LineSpectrum {
    radio: Radio,
    samples: usize,
    /// Largest frequency in steps.
    last: i64,
    /// exp(-j 2 pi n / samples).
    turns: Vec<Complex64>,
    /// Inverse of the pulse's share at every frequency.
    weights: Vec<f64>,
}

impl LineSpectrum {
    /// For frames of `samples` samples.
    pub fn new(radio: Radio, samples: usize) -> Self {
        let step_hz = 1.0 / (samples as f64 * radio.spacing_s);
        let middle = radio.spectrum.power(0.0);
        let share = |n: i64| radio.spectrum.power(n as f64 * step_hz) / middle;
        let last =
            (0..samples as i64 / 2).take_while(|&n| share(n) >= LEAST_POWER - 1e-9).last().unwrap_or(0);
        let turn = |n: usize| cis(-std::f64::consts::TAU * n as f64 / samples as f64);
        Self {
            samples,
            last,
            turns: (0..samples).map(turn).collect(),
            weights: (-last..=last).map(|n| 1.0 / share(n)).collect(),
            radio,
        }
    }

    /// Radio that the frames come from.
    pub fn radio(&self) -> &Radio {
        &self.radio
    }

    /// Distance between two frequencies, hertz.
    pub fn step_hz(&self) -> f64 {
        1.0 / (self.samples as f64 * self.radio.spacing_s)
    }

    /// The frame's line spectrum.
    pub fn of(&self, frame: &Frame) -> Vec<Complex64> {
        let bin = |(k, weight): (i64, &f64)| {
            let step = k.rem_euclid(self.samples as i64) as usize;
            let sum: Complex64 = frame
                .samples
                .iter()
                .enumerate()
                .map(|(n, value)| value * self.turns[(step * n) % self.samples])
                .sum();
            sum * *weight
        };
        (-self.last..=self.last).zip(&self.weights).map(bin).collect()
    }

    /// The paths at these delays: joint amplitudes, and only those that exceed the threshold.
    pub fn paths(&self, frame: &Frame, delays_s: &[f64], level: LevelModel, false_paths: f64) -> Vec<Found> {
        let mut positions: Vec<f64> = delays_s.iter().map(|delay_s| delay_s / self.radio.spacing_s).collect();
        positions.retain(|&position| position.is_finite() && frame.holds(position));
        positions.sort_by(f64::total_cmp);
        positions.dedup_by(|later, earlier| *later - *earlier < SAME);
        positions.truncate(2 * PATHS);
        let threshold = level.threshold(frame.samples.len(), &self.radio, false_paths);
        keep_worthy(frame, positions, level, threshold)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_is_one_line_of_constant_size() {
        let radio = Radio::of_the_experiment();
        let spectrum = LineSpectrum::new(radio.clone(), 400);
        let samples: Vec<[f32; 2]> =
            (0..400).map(|n| [radio.pulse(f64::from(n) - 150.3) as f32, 0.0]).collect();
        let lines = spectrum.of(&Frame::new(&radio, &samples));
        assert_eq!(lines.len(), 241);
        let step = cis(-std::f64::consts::TAU * spectrum.step_hz() * 150.3 * radio.spacing_s);
        for pair in lines.windows(2) {
            assert!((pair[1] / pair[0] - step).norm() < 2e-3, "{}", pair[1] / pair[0]);
        }
    }
}
