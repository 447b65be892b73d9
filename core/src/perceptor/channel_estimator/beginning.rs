//! Where a response begins, and how heavy the tail of the noise ahead of it is.
//!
//! Where [`EstimatorSettings::begins_with_path`](super::EstimatorSettings) says that dense multipath begins with a path, one of the
//! nodes that the level is a sum of stands where the response begins, and the fit begins with a path there, which has to be worth its
//! threshold once the level has been fitted beside it. Else what rises behind a wall, all of it within a few pulses, is taken for dense
//! multipath as a whole.
//!
//! The noise of real radios is no Gaussian: artefacts of the receiver's correlator, 30 to 40 dB below the strongest path, stand out of it
//! wherever they fall. Their energies over the level are taken as exponentially distributed beyond [`TAIL_FROM`] with a mean excess of
//! their own, as that of Gaussian noise is 1, and the threshold is further out by as much.

use crate::real::{exp, larger};

/// Mathematics: how far before the strongest sample a response may begin, seconds: three decay times of 20 ns, that of dense multipath in
/// offices; 5 % of its energy are later than that. What is earlier is noise.
pub const SEARCH_S: f32 = 3.0 * 20e-9;
/// Mathematics: the tail begins here, levels: 2 % of the samples of Gaussian noise are in it.
pub const TAIL_FROM: f32 = 4.0;
/// Guard: against a tail that rests on a handful of samples: so many of Gaussian noise count beside those of the frame.
pub const TAIL_PRIOR: f32 = 10.0;
/// Guard: against more false paths than are asked for, where dense multipath begins by itself: their share that those at the beginning
/// may be.
pub const BEGINNING_SHARE: f32 = 0.25;

/// Where a response begins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Beginning {
    /// Sample of its first maximum.
    pub sample: usize,
    /// So many samples are ahead of the search.
    pub ahead: usize,
}

impl Beginning {
    /// At the first maximum above `threshold`, at most [`SEARCH_S`] before the strongest sample; `None` where nothing is above it.
    pub fn find(
        power: impl Fn(usize) -> f32,
        samples: usize,
        sample_spacing_s: f32,
        threshold: f32,
    ) -> Option<Self> {
        let mut strongest = (0, 0.0);
        for n in 0..samples {
            let here = power(n);
            if here > strongest.1 {
                strongest = (n, here);
            }
        }
        let search = (SEARCH_S / sample_spacing_s) as usize + 1;
        let ahead = strongest.0.saturating_sub(search);
        let mut searched = ahead..=strongest.0;
        let is_first = |&n: &usize| power(n) > threshold && (n == strongest.0 || power(n + 1) <= power(n));
        Some(Self { sample: searched.find(is_first)?, ahead })
    }
}

/// The tail of the noise ahead of a response.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tail {
    excess: f32,
    count: f32,
}

impl Tail {
    /// That of energies over the level, beside Gaussian noise.
    pub fn of(energies: impl Iterator<Item = f32>) -> Self {
        let mut tail = Self { excess: TAIL_PRIOR, count: TAIL_PRIOR };
        for energy in energies.filter(|energy| *energy > TAIL_FROM) {
            tail.excess += energy - TAIL_FROM;
            tail.count += 1.0;
        }
        tail
    }

    /// The threshold that is exceeded as often as `threshold` is by Gaussian noise; never less.
    pub fn threshold(&self, threshold: f32) -> f32 {
        threshold + larger(threshold - TAIL_FROM, 0.0) * larger(self.excess / self.count - 1.0, 0.0)
    }
}

/// kappa of a path beside which the level was fitted, to `fitted` independent samples without its own: energies over the mean of so
/// many exponentially distributed ones exceed x with probability (1 + x / n)^-n.
pub(super) fn threshold_beside(fitted: f32, threshold: f32) -> f32 {
    fitted * (exp(threshold / fitted) - 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_core::{Rng, SeedableRng};

    #[test]
    fn a_response_begins_with_its_first_maximum_above_the_threshold_within_reach_of_the_strongest() {
        let mut powers = [1.0_f32; 64];
        for (n, power) in [(5, 50.0), (20, 9.0), (21, 40.0), (22, 30.0), (30, 400.0)] {
            powers[n] = power;
        }
        // The search goes back 13 samples, or 61.
        let find = |spacing_s, threshold| {
            Beginning::find(|n| powers[n], 64, spacing_s, threshold).map(|found| (found.sample, found.ahead))
        };
        assert_eq!(find(1e-9, 8.0), Some((5, 0)));
        assert_eq!(find(5e-9, 8.0), Some((21, 17)));
        assert_eq!(find(5e-9, 45.0), Some((30, 17)));
        assert_eq!(find(5e-9, 400.0), None);
        assert_eq!(Beginning::find(|_| 0.0, 0, 1e-9, 8.0), None);
    }

    #[test]
    fn the_threshold_follows_the_tail() {
        let mut rng = rand_xoshiro::Xoshiro128PlusPlus::seed_from_u64(7);
        let mut exponential = || -((rng.next_u32() as f32 + 1.0) / 4_294_967_808.0).ln();
        let gaussian = Tail::of((0..20_000).map(|_| exponential()));
        let heavy = Tail::of(
            (0..20_000).map(|n| if n % 20 == 0 { 4.0 + 3.0 * exponential() } else { exponential() }),
        );
        assert!((gaussian.threshold(9.0) - 9.0).abs() < 0.5, "{gaussian:?}");
        // 368 of 20,000 have an excess of 1, 1000 one of 3.
        assert!((heavy.threshold(9.0) - (4.0 + 5.0 * (368.0 + 3000.0) / 1368.0)).abs() < 0.7, "{heavy:?}");
        // Thresholds within the bulk of the noise have no tail.
        assert_eq!(heavy.threshold(3.0), 3.0);
    }

    #[test]
    fn the_threshold_beside_a_path_is_exceeded_as_often() {
        let mut rng = rand_xoshiro::Xoshiro128PlusPlus::seed_from_u64(9);
        let mut exponential = || -((rng.next_u32() as f32 + 1.0) / 4_294_967_808.0).ln();
        let mut exceeded = 0;
        let kappa = threshold_beside(20.0, 4.0);
        for _ in 0..100_000 {
            let level = (0..20).map(|_| exponential()).sum::<f32>() / 20.0;
            exceeded += u32::from(exponential() > kappa * level);
        }
        // e^-4 of them: 1832, and four deviations.
        assert!(exceeded.abs_diff(1832) < 172, "{exceeded}");
    }
}
