//! The level of what is not a path: white noise N0, and dense multipath that rises softly after the first path and
//! decays: lambda(t) = N0 + D (1 - chi exp(-t/rise)) exp(-t/decay), t counted from the onset.

use crate::reference::real::{Real, exp, larger};

const DECAY_S: f32 = 20e-9;
const RISE_S: f32 = 5e-9;
/// chi.
const ONSET: f32 = 0.98;
/// Blocks of a frame whose quietest tell its noise.
const BLOCKS: usize = 16;
/// What a mean of exponentially distributed powers keeps when those above five times the mean are left out.
const TRIMMED_SHARE: f32 = 0.9661;

/// The noise of a frame.
#[derive(Clone, Copy, Debug)]
pub struct NoiseLevel<T> {
    /// N0.
    pub white: T,
    /// D.
    pub dense: T,
    /// Where the dense multipath begins, samples into the frame.
    pub(super) onset_samples: T,
}

impl<T: Real> NoiseLevel<T> {
    /// White noise only.
    pub(super) fn white(white: T) -> Self {
        Self { white, dense: T::ZERO, onset_samples: T::ZERO }
    }

    /// lambda at one position.
    pub(super) fn at(&self, position: T, sample_spacing_s: T) -> T {
        let excess_s = (position - self.onset_samples) * sample_spacing_s;
        let profile = if excess_s < T::ZERO {
            T::ZERO
        } else {
            (T::ONE - T::of(ONSET) * exp(-excess_s / T::of(RISE_S))) * exp(-excess_s / T::of(DECAY_S))
        };
        self.white + self.dense * profile
    }
}

/// The profile (1 - chi exp(-t/rise)) exp(-t/decay) at all samples of a frame.
///
/// Order: both exponentials are computed at the first sample after the onset and from there carried by multiplication.
pub(super) fn profiles<T: Real>(samples: usize, onset_samples: T, sample_spacing_s: T) -> Vec<T> {
    let rise_step = exp(-sample_spacing_s / T::of(RISE_S));
    let decay_step = exp(-sample_spacing_s / T::of(DECAY_S));
    let mut exponentials: Option<(T, T)> = None;
    let mut profiles = Vec::new();
    for n in 0..samples {
        let past_onset = T::of_count(n) - onset_samples;
        if past_onset < T::ZERO {
            profiles.push(T::ZERO);
            continue;
        }
        let (rise, decay) = match exponentials {
            Some((rise, decay)) => (rise * rise_step, decay * decay_step),
            None => (
                exp(-past_onset * sample_spacing_s / T::of(RISE_S)),
                exp(-past_onset * sample_spacing_s / T::of(DECAY_S)),
            ),
        };
        exponentials = Some((rise, decay));
        profiles.push((T::ONE - T::of(ONSET) * rise) * decay);
    }
    profiles
}

/// Mean of exponentially distributed powers from those below five times a guess of it; the guess if there are none.
pub(super) fn trimmed_mean<T: Real>(powers: &[T], guess: T) -> T {
    let mut sum = T::ZERO;
    let mut count = 0;
    for power in powers {
        if *power < T::of(5.0) * guess {
            sum += *power;
            count += 1;
        }
    }
    if count > 0 { sum / (T::of_count(count) * T::of(TRIMMED_SHARE)) } else { guess }
}

/// White noise of a frame: the fourth quietest of 16 block means, then three trimmed means.
pub(super) fn white_level<T: Real>(powers: &[T]) -> T {
    let per_block = (powers.len() / BLOCKS).max(1);
    let mut strongest = T::ZERO;
    for power in powers {
        strongest = larger(*power, strongest);
    }
    let mut means = Vec::new();
    for block in powers.chunks_exact(per_block).take(BLOCKS) {
        let mut sum = T::ZERO;
        for power in block {
            sum += *power;
        }
        means.push(sum / T::of_count(per_block));
    }
    means.sort_by(|a, b| a.to_f64().total_cmp(&b.to_f64()));
    // Frames have at least 16 samples, so there are 16 blocks.
    let mut level = means[3];
    for _ in 0..3 {
        level = trimmed_mean(powers, level);
    }
    larger(level, level_floor(strongest))
}

/// Least white noise beside samples whose strongest power is `strongest`.
pub fn level_floor<T: Real>(strongest: T) -> T {
    larger(strongest * T::of(1e-12), T::of(1e-30))
}
