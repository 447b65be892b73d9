//! Orthogonal matching pursuit with delays refined by Newton's method after every addition (NOMP: Mamandipoor, Ramasamy
//! and Madhow 2016), and a last look at whether each path is still worth its threshold.

use super::super::estimator::{Found, PATHS, PathFinder};
use super::clean::strongest;
use super::climb::climb;
use super::frame::{Component, Frame, Radio};
use super::least_squares::{keep_worthy, solve};
use super::level::{LevelModel, level_at};

/// Cycles over all paths after an addition, and at the end.
const CYCLES: usize = 3;
const LAST_CYCLES: usize = 10;
/// Cycles end when no delay moves by more, samples.
const STILL: f64 = 1e-3;

/// Orthogonal matching pursuit with refined delays.
#[derive(Clone, Debug)]
pub struct Pursuit {
    radio: Radio,
    level: LevelModel,
}

impl Pursuit {
    /// With a way of taking the level.
    pub fn new(level: LevelModel) -> Self {
        Self { radio: Radio::of_the_experiment(), level }
    }
}

impl PathFinder for Pursuit {
    fn name(&self) -> &str {
        self.level.name("omp", "omp-local")
    }

    fn find(&self, samples: &[[f32; 2]], false_paths: f64) -> Vec<Found> {
        let frame = Frame::new(&self.radio, samples);
        let threshold = self.level.threshold(samples.len(), &self.radio, false_paths);
        let mut components: Vec<Component> = Vec::new();
        while components.len() < PATHS {
            let levels = self.level.levels(&frame.residual_powers(&components), &self.radio);
            let Some(start) = strongest(&frame, &components, &levels) else { break };
            let power = |position: f64| frame.residual(position, &components).norm_sqr();
            let position = climb(power, start, 8);
            if !frame.holds(position) || power(position) < threshold * level_at(&levels, position) {
                break;
            }
            let mut positions: Vec<f64> = components.iter().map(|one| one.position).collect();
            positions.push(position);
            // A peak on top of a path that is already there cannot be told from it.
            let Some((more, _)) = solve(&frame, &positions) else { break };
            components = refine(&frame, more, CYCLES);
        }
        let components = refine(&frame, components, LAST_CYCLES);
        let positions = components.iter().map(|one| one.position).collect();
        keep_worthy(&frame, positions, self.level, threshold)
    }
}

/// Moves each delay in turn to where its path explains most beside the others, with joint amplitudes after each cycle.
fn refine(frame: &Frame, mut components: Vec<Component>, cycles: usize) -> Vec<Component> {
    for _ in 0..cycles {
        let before = components.clone();
        for k in 0..components.len() {
            let others: Vec<Component> =
                components.iter().enumerate().filter(|(other, _)| *other != k).map(|(_, one)| *one).collect();
            let power = |position: f64| frame.residual(position, &others).norm_sqr();
            let position = climb(power, components[k].position, 2);
            components[k] = Component { position, amplitude: frame.residual(position, &others) };
        }
        let positions: Vec<f64> = components.iter().map(|one| one.position).collect();
        match solve(frame, &positions) {
            Some((solved, _)) => components = solved,
            None => return before,
        }
        let moved = |(one, before): (&Component, &Component)| (one.position - before.position).abs();
        if components.iter().zip(&before).map(moved).fold(0.0, f64::max) < STILL {
            break;
        }
    }
    components
}
