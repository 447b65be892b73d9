//! Values of a frame between its samples: a 16-tap sinc under the window (1 - (d/8)^2)^2, from a table of 64 phases
//! between which the taps are interpolated linearly; the phases of half a sample, since the other half mirrors it.

use crate::reference::real::{Real, floor, pi, sin, square};
use cogmint_core::perceptor::channel_estimator::interpolation::{BEFORE, PHASES, TAPS};

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
        for phase in 0..=PHASES / 2 {
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

    /// The frame midway between sample `n` and the next; beyond it, zero. Order: the outermost pair of taps first, both of which have
    /// one weight.
    pub fn midway(&self, samples: &[[T; 2]], n: usize) -> [T; 2] {
        let inside = |n: i64| usize::try_from(n).ok().and_then(|n| samples.get(n));
        let value = |n: i64| inside(n).copied().unwrap_or([T::ZERO; 2]);
        let mut sum = [T::ZERO; 2];
        let (low, high) = (&self.kernels[PHASES / 2 - 1], &self.kernels[PHASES / 2]);
        for tap in 0..TAPS / 2 {
            let weight = low[tap] + T::ONE * (high[tap] - low[tap]);
            let first = n as i64 + tap as i64 - BEFORE as i64;
            let (a, b) = (value(first), value(first + TAPS as i64 - 1 - 2 * tap as i64));
            sum[0] += weight * (a[0] + b[0]);
            sum[1] += weight * (a[1] + b[1]);
        }
        sum
    }

    /// The frame at `position`; beyond it, zero.
    pub fn at(&self, samples: &[[T; 2]], position: T) -> [T; 2] {
        let base = floor(position);
        let fraction = position - base;
        // The kernels of the second half are those of the first, from the last tap to the first.
        let mirrored = fraction > T::of(0.5);
        let phase = T::of_count(PHASES) * if mirrored { T::ONE - fraction } else { fraction };
        let step = (phase.whole() as usize).min(PHASES / 2 - 1);
        let between = phase - T::of_count(step);
        let mut sum = [T::ZERO; 2];
        for tap in 0..TAPS {
            let (low, high) = (self.kernels[step][tap], self.kernels[step + 1][tap]);
            let weight = low + between * (high - low);
            let from_first = if mirrored { TAPS - 1 - tap } else { tap };
            let n = base.whole() + from_first as i64 - BEFORE as i64;
            if n >= 0 && n < samples.len() as i64 {
                sum[0] += weight * samples[n as usize][0];
                sum[1] += weight * samples[n as usize][1];
            }
        }
        sum
    }
}
