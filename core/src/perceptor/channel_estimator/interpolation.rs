//! Band-limited interpolation of a frame between its samples.

use crate::model::observation::Complex;
use crate::real::{floor, sin};
use crate::snapshot::written;

/// Mathematics: taps of the windowed sinc.
pub const TAPS: usize = 16;
/// Mathematics: taps before the position.
pub const BEFORE: usize = TAPS / 2 - 1;
/// Mathematics: grid of phases per sample, between which taps are interpolated linearly (error below 4e-4).
pub const PHASES: usize = 64;
/// Mathematics: phases kept; the other half mirrors them.
const KEPT: usize = PHASES / 2;

/// The weights of the taps at one place between two samples.
#[derive(Clone, Copy, Debug)]
pub(super) struct Kernel {
    /// From the first tap to the last, or, mirrored, from the last to the first.
    weights: [f32; TAPS],
    is_mirrored: bool,
}

impl Kernel {
    /// The value midway between two samples, of a window of [`TAPS`] of them: taps lie opposite each other.
    pub fn midway(&self, window: &[Complex]) -> Complex {
        let mut total = [0.0; 2];
        let pairs = window.iter().zip(window.iter().rev()).take(TAPS / 2);
        for (([a_re, a_im], [b_re, b_im]), weight) in pairs.zip(&self.weights) {
            total = [total[0] + weight * (a_re + b_re), total[1] + weight * (a_im + b_im)];
        }
        total
    }

    /// The value there of a window of [`TAPS`] samples.
    pub fn of(&self, window: &[Complex]) -> Complex {
        let weights = self.weights.iter().copied();
        if self.is_mirrored { sum(window.iter().rev().zip(weights)) } else { sum(window.iter().zip(weights)) }
    }
}

/// A 16-tap sinc under the window (1 - (d/8)^2)^2, tabulated over the position between two samples.
#[derive(Clone, Debug)]
pub(super) struct Interpolation {
    kernels: [[f32; TAPS]; KEPT + 1],
}

impl Interpolation {
    /// No weights: to be filled.
    pub const fn empty() -> Self {
        Self { kernels: [[0.0; TAPS]; KEPT + 1] }
    }

    /// Tabulates the weights.
    #[inline(never)]
    pub fn fill(&mut self) {
        for (phase, kernel) in self.kernels.iter_mut().enumerate() {
            let fraction = phase as f32 / PHASES as f32;
            for (tap, weight) in kernel.iter_mut().enumerate() {
                let distance = fraction + BEFORE as f32 - tap as f32;
                let half = (TAPS / 2) as f32;
                let taper = 1.0 - (distance / half) * (distance / half);
                let angle = core::f32::consts::PI * distance;
                *weight = if distance == 0.0 { 1.0 } else { sin(angle) / angle * (taper * taper) };
            }
        }
    }

    /// The weights of the taps for positions `fraction` of a sample after the one with the number [`BEFORE`].
    pub fn kernel(&self, fraction: f32) -> Kernel {
        let mut weights = [0.0; TAPS];
        let (low, high, between) = self.weights(fraction);
        for ((weight, low), high) in weights.iter_mut().zip(low).zip(high) {
            *weight = low + between * (high - low);
        }
        Kernel { weights, is_mirrored: fraction > 0.5 }
    }

    /// The weights of the taps at the phases before and after, and how far it is between them; in the second half of a sample from the
    /// last tap to the first, as those of the first half.
    fn weights(&self, fraction: f32) -> (&[f32; TAPS], &[f32; TAPS], f32) {
        // Not negative, so truncation is the floor.
        let phase = PHASES as f32 * if fraction > 0.5 { 1.0 - fraction } else { fraction };
        let step = (phase as usize).min(KEPT - 1);
        let between = phase - step as f32;
        match self.kernels.get(step..step + 2) {
            Some([low, high]) => (low, high, between),
            // A step below the last has one after it.
            _ => (&[0.0; TAPS], &[0.0; TAPS], between),
        }
    }

    /// The frame at `position`, samples into it; samples beyond the frame count as zero.
    pub fn at(&self, samples: &[Complex], position: f32) -> Complex {
        let base = floor(position);
        let fraction = position - base;
        let first = base as i32 - BEFORE as i32;
        let inside = usize::try_from(first).ok().and_then(|first| samples.get(first..first + TAPS));
        if let Some(window) = inside.and_then(|window| window.first_chunk()) {
            return self.weigh(window, fraction);
        }
        // At the frame's edges: a window of its own.
        let mut window = [[0.0; 2]; TAPS];
        for (n, value) in (first..).zip(&mut window) {
            *value = usize::try_from(n).ok().and_then(|n| samples.get(n)).copied().unwrap_or([0.0; 2]);
        }
        self.weigh(&window, fraction)
    }

    /// The sum of the taps of a window, `fraction` of a sample after its middle.
    fn weigh(&self, window: &[Complex; TAPS], fraction: f32) -> Complex {
        let (low, high, between) = self.weights(fraction);
        let weights = low.iter().zip(high).map(|(low, high)| low + between * (high - low));
        if fraction > 0.5 { sum(window.iter().rev().zip(weights)) } else { sum(window.iter().zip(weights)) }
    }
}

fn sum<'a>(terms: impl Iterator<Item = (&'a Complex, f32)>) -> Complex {
    let mut total = [0.0; 2];
    for ([re, im], weight) in terms {
        total = [total[0] + weight * re, total[1] + weight * im];
    }
    total
}

written!(Interpolation { kernels });

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_band_limited_frame_is_found_between_its_samples() {
        // Up to 0.4 cycles per sample, as a roll-off of 0.6 at two samples per pulse leaves it.
        let mut table = Interpolation::empty();
        table.fill();
        for cycles in [0.05_f64, 0.2, 0.4] {
            let at = |n: f64| {
                let angle = std::f64::consts::TAU * cycles * n;
                [angle.cos() as f32, angle.sin() as f32]
            };
            let samples: std::vec::Vec<Complex> = (0..64).map(|n| at(f64::from(n))).collect();
            for i in 0..200 {
                let position = 20.0 + f64::from(i) * 0.1;
                let [re, im] = table.at(&samples, position as f32);
                let [x, y] = at(position);
                assert!((re - x).hypot(im - y) < 0.02, "{cycles} cycles per sample at {position}");
            }
        }
    }

    #[test]
    fn beyond_the_frame_there_is_nothing() {
        let mut table = Interpolation::empty();
        table.fill();
        let samples = [[1.0, 0.0]; 20];
        assert_eq!(table.at(&samples, -40.0), [0.0, 0.0]);
        assert_eq!(table.at(&samples, 60.0), [0.0, 0.0]);
    }
}
