//! The level of everything that is not a specular path: white noise, and dense multipath that rises softly
//! after the first path and decays exponentially.

use crate::real::{exp, larger};

/// Decay time of the dense multipath, seconds.
const DECAY_S: f32 = 20e-9;
/// Rise time of its soft onset, seconds.
const RISE_S: f32 = 5e-9;
/// Depth of the onset.
const ONSET: f32 = 0.98;
/// Blocks the frame is cut into to find its quietest parts.
const BLOCKS: usize = 16;

/// Noise and dense multipath at the matched filter's output.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct NoiseLevel {
    /// White noise power N0, in squared units of the samples.
    pub white: f32,
    /// Scale of the dense multipath's power profile, in squared units of the samples; 0 where none was found.
    pub dense: f32,
    /// Where the profile starts: the first path, samples into the frame.
    pub(super) onset_samples: f32,
}

impl NoiseLevel {
    /// White noise only.
    pub(super) fn white(white: f32) -> Self {
        Self { white, dense: 0.0, onset_samples: 0.0 }
    }

    /// Level `position` samples into a frame whose samples are `sample_spacing_s` seconds apart, in squared units of
    /// the samples.
    pub fn level(&self, position: f32, sample_spacing_s: f32) -> f32 {
        self.white + self.dense * profile((position - self.onset_samples) * sample_spacing_s)
    }
}

/// The dense multipath's power profile after the onset at a delay of `excess_s`, without its scale:
/// (1 - chi exp(-t / rise)) exp(-t / decay), zero before the onset.
fn profile(excess_s: f32) -> f32 {
    if excess_s < 0.0 { 0.0 } else { (1.0 - ONSET * exp(-excess_s / RISE_S)) * exp(-excess_s / DECAY_S) }
}

/// Walks the noise level lambda(n) = white + dense * profile along the samples of a frame.
///
/// Two exponentials are carried by multiplication, so a sample costs two products instead of two calls.
#[derive(Clone, Copy, Debug)]
pub(super) struct LevelWalk {
    rise: f32,
    decay: f32,
    rise_step: f32,
    decay_step: f32,
    onset_samples: f32,
    sample_spacing_s: f32,
    started: bool,
}

impl LevelWalk {
    pub fn new(onset_samples: f32, sample_spacing_s: f32) -> Self {
        Self {
            rise: 1.0,
            decay: 1.0,
            rise_step: exp(-sample_spacing_s / RISE_S),
            decay_step: exp(-sample_spacing_s / DECAY_S),
            onset_samples,
            sample_spacing_s,
            started: false,
        }
    }

    /// The profile at sample `n`; to be called for n = 0, 1, 2, ...
    pub fn next(&mut self, n: usize) -> f32 {
        let past_onset = n as f32 - self.onset_samples;
        if past_onset < 0.0 {
            return 0.0;
        }
        if self.started {
            self.rise *= self.rise_step;
            self.decay *= self.decay_step;
        } else {
            self.rise = exp(-past_onset * self.sample_spacing_s / RISE_S);
            self.decay = exp(-past_onset * self.sample_spacing_s / DECAY_S);
            self.started = true;
        }
        (1.0 - ONSET * self.rise) * self.decay
    }
}

/// Mean of exponentially distributed powers from those below five times a first guess of it. Cut off there, they
/// have 0.9661 of the full mean, which is undone; iterated, the guess converges.
#[derive(Clone, Copy, Debug)]
pub(super) struct TrimmedMean {
    guess: f32,
    sum: f32,
    count: u32,
}

impl TrimmedMean {
    pub fn below(guess: f32) -> Self {
        Self { guess, sum: 0.0, count: 0 }
    }

    pub fn add(&mut self, power: f32) {
        if power < 5.0 * self.guess {
            self.sum += power;
            self.count += 1;
        }
    }

    /// The mean; the guess where no power was below the cut.
    pub fn mean(&self) -> f32 {
        if self.count > 0 { self.sum / (self.count as f32 * 0.9661) } else { self.guess }
    }
}

/// White noise power from the powers of a frame's samples: the fourth quietest of 16 block means,
/// then three passes of [`TrimmedMean`].
///
/// `powers` is walked four times. The result is at least 1e-12 of the strongest power.
pub(super) fn white_level<I: Iterator<Item = f32>>(powers: impl Fn() -> I, samples: usize) -> f32 {
    let per_block = (samples / BLOCKS).max(1);
    let mut block_means = [f32::INFINITY; BLOCKS];
    let mut strongest = 0.0;
    {
        let mut blocks = block_means.iter_mut();
        let mut sum = 0.0;
        let mut count = 0_usize;
        for power in powers() {
            strongest = larger(power, strongest);
            sum += power;
            count += 1;
            if count == per_block {
                if let Some(mean) = blocks.next() {
                    *mean = sum / per_block as f32;
                }
                sum = 0.0;
                count = 0;
            }
        }
    }
    let mut level = 0.0;
    for _ in 0..4 {
        let mut quietest = f32::INFINITY;
        for &mean in &block_means {
            if mean < quietest {
                quietest = mean;
            }
        }
        if quietest == f32::INFINITY {
            quietest = level;
        }
        for mean in &mut block_means {
            if *mean == quietest {
                *mean = f32::INFINITY;
                break;
            }
        }
        level = larger(level, quietest);
    }
    for _ in 0..3 {
        let mut trimmed = TrimmedMean::below(level);
        powers().for_each(|power| trimmed.add(power));
        level = trimmed.mean();
    }
    larger(level, level_floor(strongest))
}

/// Least white noise beside samples whose strongest power is `strongest`: -120 dB of it, and never zero.
pub(super) fn level_floor(strongest: f32) -> f32 {
    larger(strongest * 1e-12, 1e-30)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_core::{Rng, SeedableRng};

    #[test]
    fn the_white_level_is_found_beside_strong_paths() {
        let mut rng = rand_xoshiro::Xoshiro128PlusPlus::seed_from_u64(4);
        let mut mean = 0.0;
        for _ in 0..50 {
            let mut powers = [0.0_f32; 400];
            for (n, power) in powers.iter_mut().enumerate() {
                let uniform = (rng.next_u32() as f32 + 1.0) / 4_294_967_808.0;
                *power = -3.0 * uniform.ln() + if (100..130).contains(&n) { 400.0 } else { 0.0 };
            }
            mean += white_level(|| powers.iter().copied(), 400) / 50.0;
        }
        assert!((mean / 3.0 - 1.0).abs() < 0.06, "{mean}");
    }

    #[test]
    fn the_walk_and_the_profile_agree() {
        let mut walk = LevelWalk::new(10.3, 0.25e-9);
        let noise = NoiseLevel { white: 0.5, dense: 2.0, onset_samples: 10.3 };
        for n in 0..400 {
            let walked = 0.5 + 2.0 * walk.next(n);
            assert!((walked - noise.level(n as f32, 0.25e-9)).abs() < 1e-4);
        }
    }
}
