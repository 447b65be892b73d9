//! Band-limited interpolation of a frame between its samples.

use crate::observation::Complex;
use crate::real::{floor, sin};

/// Taps of the kernel.
const TAPS: usize = 16;
/// Taps before the position.
const BEFORE: usize = TAPS / 2 - 1;
/// Tabulated phases per sample; between two, taps are interpolated linearly (error below 4e-4).
const PHASES: usize = 64;

/// A 16-tap sinc under the window (1 - (d/8)^2)^2, tabulated over the position between two samples.
#[derive(Clone, Debug)]
pub(super) struct Interpolation {
    kernels: [[f32; TAPS]; PHASES + 1],
}

impl Interpolation {
    pub fn new() -> Self {
        let mut kernels = [[0.0; TAPS]; PHASES + 1];
        for (phase, kernel) in kernels.iter_mut().enumerate() {
            let fraction = phase as f32 / PHASES as f32;
            for (tap, weight) in kernel.iter_mut().enumerate() {
                let distance = fraction + BEFORE as f32 - tap as f32;
                let half = (TAPS / 2) as f32;
                let taper = 1.0 - (distance / half) * (distance / half);
                let angle = core::f32::consts::PI * distance;
                *weight = if distance == 0.0 { 1.0 } else { sin(angle) / angle * (taper * taper) };
            }
        }
        Self { kernels }
    }

    /// The frame at `position`, samples into it; samples beyond the frame count as zero.
    pub fn at(&self, samples: &[Complex], position: f32) -> Complex {
        let base = floor(position);
        let phase = (position - base) * PHASES as f32;
        // A position so little below zero that its fraction rounds to one still has its two kernels.
        let step = (phase as usize).min(PHASES - 1);
        let between = phase - step as f32;
        let (Some(low), Some(high)) = (self.kernels.get(step), self.kernels.get(step + 1)) else {
            return [0.0, 0.0];
        };
        let first = base as i32 - BEFORE as i32;
        let mut re = 0.0;
        let mut im = 0.0;
        let mut add = |sample: &Complex, low: &f32, high: &f32| {
            let weight = low + between * (high - low);
            let [s_re, s_im] = *sample;
            re += weight * s_re;
            im += weight * s_im;
        };
        let inside = usize::try_from(first).ok().and_then(|first| samples.get(first..first + TAPS));
        if let Some(window) = inside {
            for ((sample, low), high) in window.iter().zip(low).zip(high) {
                add(sample, low, high);
            }
        } else {
            // At the frame's edges, tap by tap.
            for (tap, (low, high)) in (first..).zip(low.iter().zip(high)) {
                if let Some(sample) = usize::try_from(tap).ok().and_then(|tap| samples.get(tap)) {
                    add(sample, low, high);
                }
            }
        }
        [re, im]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_band_limited_frame_is_found_between_its_samples() {
        // Up to 0.4 cycles per sample, as a roll-off of 0.6 at two samples per pulse leaves it.
        let table = Interpolation::new();
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
        let table = Interpolation::new();
        let samples = [[1.0, 0.0]; 20];
        assert_eq!(table.at(&samples, -40.0), [0.0, 0.0]);
        assert_eq!(table.at(&samples, 60.0), [0.0, 0.0]);
    }
}
