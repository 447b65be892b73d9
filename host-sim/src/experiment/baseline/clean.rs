//! CLEAN (Hogbom 1974): the strongest peak is taken away as a whole pulse, then the strongest of what is left.

use super::super::estimator::{Found, PATHS, PathFinder};
use super::climb::climb;
use super::frame::{Component, Frame, Radio};
use super::least_squares::found;
use super::level::{LevelModel, level_at};

/// A peak nearer than this to a path already found, in pulse durations, corrects it instead of being another.
const SAME_PULSES: f64 = 0.25;
/// Peaks taken at most: each path may be corrected a few times.
const ROUNDS: usize = 4 * PATHS;

/// CLEAN with delays between the samples.
#[derive(Clone, Debug)]
pub struct Clean {
    radio: Radio,
    level: LevelModel,
}

impl Clean {
    /// With a way of taking the level.
    pub fn new(level: LevelModel) -> Self {
        Self { radio: Radio::of_the_experiment(), level }
    }
}

impl PathFinder for Clean {
    fn name(&self) -> &str {
        self.level.name("clean", "clean-local")
    }

    fn find(&self, samples: &[[f32; 2]], false_paths: f64) -> Vec<Found> {
        let frame = Frame::new(&self.radio, samples);
        let threshold = self.level.threshold(samples.len(), &self.radio, false_paths);
        let same = SAME_PULSES * self.radio.spectrum.duration_s() / self.radio.spacing_s;
        let mut taken: Vec<Component> = Vec::new();
        let mut paths: Vec<Component> = Vec::new();
        let mut levels = Vec::new();
        for _ in 0..ROUNDS {
            levels = self.level.levels(&frame.residual_powers(&taken), &self.radio);
            let Some(start) = strongest(&frame, &taken, &levels) else { break };
            let position = climb(|position| frame.residual(position, &taken).norm_sqr(), start, 8);
            let peak = Component { position, amplitude: frame.residual(position, &taken) };
            if !frame.holds(position) || peak.amplitude.norm_sqr() < threshold * level_at(&levels, position) {
                break;
            }
            taken.push(peak);
            let full = paths.len() >= PATHS;
            match paths.iter_mut().find(|path| (path.position - position).abs() < same) {
                Some(path) => path.amplitude += peak.amplitude,
                None if !full => paths.push(peak),
                None => break,
            }
        }
        paths.iter().map(|path| found(&frame, path, &levels)).collect()
    }
}

/// The position, to half a sample, where what is left stands highest over its level; `None` in silence.
pub(super) fn strongest(frame: &Frame, taken: &[Component], levels: &[f64]) -> Option<f64> {
    let left = frame.half_residual(taken);
    let over = |(n, value): (usize, &rustfft::num_complex::Complex64)| {
        let position = 0.5 * n as f64;
        (position, value.norm_sqr() / level_at(levels, position))
    };
    let (position, over) = left.iter().enumerate().map(over).max_by(|a, b| a.1.total_cmp(&b.1))?;
    (over > 0.0).then_some(position)
}
