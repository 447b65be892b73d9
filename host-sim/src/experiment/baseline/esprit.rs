//! ESPRIT (Roy and Kailath 1989) on the frame's line spectrum: the covariance of overlapping, forward and backward
//! pieces of it, and the rotation from one piece to the next. As many lines are taken as paths may be reported, and the
//! threshold chooses: an order by minimum description length resolves less and detects less on these responses.

use super::super::estimator::{Found, PATHS, PathFinder};
use super::frame::{Frame, Radio};
use super::level::LevelModel;
use super::line_spectrum::LineSpectrum;
use nalgebra::{DMatrix, DVector};
use rustfft::num_complex::Complex64;

/// Length of a piece over that of the spectrum: a third is the usual balance of resolution and averaging.
const PIECES: usize = 3;

/// ESPRIT, then joint amplitudes and the threshold.
pub struct Esprit {
    spectrum: LineSpectrum,
    level: LevelModel,
}

impl Esprit {
    /// With a way of taking the level.
    pub fn new(level: LevelModel) -> Self {
        let spectrum = LineSpectrum::new(Radio::of_the_experiment(), super::super::estimator::SAMPLES);
        Self { spectrum, level }
    }
}

impl PathFinder for Esprit {
    fn name(&self) -> &str {
        self.level.name("esprit", "esprit-local")
    }

    fn find(&self, samples: &[[f32; 2]], false_paths: f64) -> Vec<Found> {
        let frame = Frame::new(self.spectrum.radio(), samples);
        let delays_s = delays(&self.spectrum.of(&frame), self.spectrum.step_hz());
        self.spectrum.paths(&frame, &delays_s, self.level, false_paths)
    }
}

/// Delays of the lines, seconds, 0 to the inverse of the step.
fn delays(lines: &[Complex64], step_hz: f64) -> Vec<f64> {
    let length = lines.len() / PIECES;
    let eigen = covariance(lines, length).symmetric_eigen();
    let mut order: Vec<usize> = (0..length).collect();
    order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
    if !(eigen.eigenvalues.max() > 0.0) {
        return Vec::new();
    }
    let columns: Vec<DVector<Complex64>> =
        order.iter().take(PATHS).map(|&n| eigen.eigenvectors.column(n).into_owned()).collect();
    let basis = DMatrix::from_columns(&columns);
    let (upper, lower) = (basis.rows(0, length - 1), basis.rows(1, length - 1));
    let Some(rotation) = (upper.adjoint() * upper).lu().solve(&(upper.adjoint() * lower)) else {
        return Vec::new();
    };
    let (_, triangle) = rotation.schur().unpack();
    let turns = triangle.diagonal();
    let delay = |turn: &Complex64| (-turn.arg() / std::f64::consts::TAU).rem_euclid(1.0) / step_hz;
    turns.iter().map(delay).collect()
}

/// Covariance of all pieces of `length` lines, each also taken backwards and conjugated.
fn covariance(lines: &[Complex64], length: usize) -> DMatrix<Complex64> {
    let pieces = lines.len() - length + 1;
    let mut forward = DMatrix::<Complex64>::zeros(length, length);
    for row in 0..length {
        for column in 0..=row {
            let sum: Complex64 = (0..pieces).map(|n| lines[n + row] * lines[n + column].conj()).sum();
            forward[(row, column)] = sum;
            forward[(column, row)] = sum.conj();
        }
    }
    let scale = 0.5 / pieces as f64;
    DMatrix::from_fn(length, length, |row, column| {
        (forward[(row, column)] + forward[(length - 1 - row, length - 1 - column)].conj()) * scale
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::channel::cis;

    #[test]
    fn lines_without_noise_give_their_delays_back() {
        let truth = [12.3e-9, 40.0e-9, 40.2e-9, 91.7e-9];
        let line = |n: i64| -> Complex64 {
            truth.iter().map(|delay_s| cis(-std::f64::consts::TAU * 1e7 * n as f64 * delay_s)).sum()
        };
        let lines: Vec<Complex64> = (-120..=120).map(line).collect();
        let found = delays(&lines, 1e7);
        for delay_s in truth {
            let nearest = found.iter().map(|found| (found - delay_s).abs()).fold(1.0, f64::min);
            assert!(nearest < 1e-13, "{delay_s}: {nearest}");
        }
    }
}
