//! Values of a frame between its samples: a 16-tap sinc under the window (1 - (d/8)^2)^2, from a table of 64 phases
//! between which the taps are interpolated linearly.

use crate::reference::real::{Real, floor, pi, sin, square};

const TAPS: usize = 16;
/// Taps before the position.
const BEFORE: usize = TAPS / 2 - 1;
const PHASES: usize = 64;

/// The table.
#[derive(Clone, Debug)]
pub struct Interpolation<T> {
    /// By phase and tap.
    kernels: Vec<Vec<T>>,
}

impl<T: Real> Interpolation<T> {
    /// The table.
    pub fn new() -> Self {
        let mut kernels = Vec::new();
        for phase in 0..=PHASES {
            let mut kernel = Vec::new();
            for tap in 0..TAPS {
                let fraction = T::of_count(phase) / T::of_count(PHASES);
                let distance = fraction + T::of_count(BEFORE) - T::of_count(tap);
                let taper = T::ONE - square(distance / T::of_count(TAPS / 2));
                let angle = pi::<T>() * distance;
                let sinc = if distance == T::ZERO { T::ONE } else { sin(angle) / angle };
                kernel.push(sinc * square(taper));
            }
            kernels.push(kernel);
        }
        Self { kernels }
    }

    /// The frame at `position`; beyond it, zero.
    pub fn at(&self, samples: &[[T; 2]], position: T) -> [T; 2] {
        let base = floor(position);
        let phase = (position - base) * T::of_count(PHASES);
        // A position so little below zero that its fraction rounds to one belongs to the last pair of kernels.
        let step = (phase.whole() as usize).min(PHASES - 1);
        let between = phase - T::of_count(step);
        let mut sum = [T::ZERO; 2];
        for tap in 0..TAPS {
            let (low, high) = (self.kernels[step][tap], self.kernels[step + 1][tap]);
            let weight = low + between * (high - low);
            let n = base.whole() + tap as i64 - BEFORE as i64;
            if n >= 0 && n < samples.len() as i64 {
                sum[0] += weight * samples[n as usize][0];
                sum[1] += weight * samples[n as usize][1];
            }
        }
        sum
    }
}
