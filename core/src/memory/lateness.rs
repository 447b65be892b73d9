//! Lateness memory: which share of an anchor's ranges is late, and by how much, learnt while running.
//!
//! Both are means over the ranges that are of its direct path, each with the probability that it is late and the excess that is then
//! expected of it: the steps of expectation maximisation, taken one range at a time.

use crate::model::lateness::{Lateness, Timing};
use crate::real::{is_probability, larger, limited, smaller};
use crate::snapshot::stored;

/// Guard: against a share learnt from a handful: ranges that what is assumed at the start is worth.
pub const FIRST_RANGES: f32 = 10.0;
/// Guard: against a mean learnt from a handful: late ranges that what is assumed at the start is worth.
pub const FIRST_LATE: f32 = 5.0;
/// Guard: against a memory that nothing new changes: most ranges that what was learnt is worth.
pub const MOST_RANGES: f32 = 500.0;
/// Mathematics: as probable as not: share that is assumed to be late at the start.
pub const FIRST_SHARE: f32 = 0.5;
/// Guard: against certainty: least and most share.
pub const SHARES: [f32; 2] = [0.01, 0.99];
/// Guard: against lost digits, where the excess is nothing beside the noise: least mean excess, metres.
pub const LEAST_MEAN_M: f32 = 0.01;

/// What is known of one anchor.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Learnt {
    /// Ranges that the share rests on.
    ranges: f32,
    /// Late ones that the mean rests on.
    late: f32,
    lateness: Lateness,
}

/// The lateness of `ANCHORS` anchors.
#[derive(Clone, Debug)]
pub struct LatenessMemory<const ANCHORS: usize> {
    own: [Learnt; ANCHORS],
}

impl<const ANCHORS: usize> LatenessMemory<ANCHORS> {
    /// Nothing is known: to be started.
    pub const fn empty() -> Self {
        let lateness = Lateness { share: 0.0, mean_m: 0.0 };
        Self { own: [Learnt { ranges: 0.0, late: 0.0, lateness }; ANCHORS] }
    }

    /// Half of all ranges are late, by `mean_m` metres on average, a centimetre at least; with 0, none ever is.
    pub fn new(mean_m: f32) -> Self {
        let lateness = if mean_m > 0.0 {
            Lateness { share: FIRST_SHARE, mean_m: larger(mean_m, LEAST_MEAN_M) }
        } else {
            Lateness::NONE
        };
        Self { own: [Learnt { ranges: FIRST_RANGES, late: FIRST_LATE, lateness }; ANCHORS] }
    }

    /// What is expected of an anchor's ranges.
    pub fn of(&self, anchor: usize) -> Lateness {
        self.own.get(anchor).map_or(Lateness::NONE, |own| own.lateness)
    }

    /// Enters a range of an anchor, which is its direct path with this probability.
    pub fn observe(&mut self, anchor: usize, timing: &Timing, probability: f32) {
        let Some(own) = self.own.get_mut(anchor).filter(|own| own.lateness.is_any()) else { return };
        let Lateness { share, mean_m } = &mut own.lateness;
        let late = probability * timing.late;
        own.ranges = smaller(own.ranges + probability, MOST_RANGES);
        own.late = smaller(own.late + late, MOST_RANGES);
        let [least, most] = SHARES;
        *share = limited(*share + (late - probability * *share) / own.ranges, least, most);
        *mean_m = larger(*mean_m + late * (timing.excess_m - *mean_m) / own.late, LEAST_MEAN_M);
    }

    /// Whether finite numbers are what they may be.
    pub(crate) fn is_sound(&self) -> bool {
        self.own.iter().all(|own| {
            own.ranges > 0.0
                && own.late > 0.0
                && is_probability(own.lateness.share)
                && own.lateness.mean_m >= 0.0
        })
    }

    /// Every number of the state, in a fixed order, for traces.
    pub fn visit(&self, mut f: impl FnMut(f32)) {
        for Learnt { ranges, late, lateness: Lateness { share, mean_m } } in self.own {
            [ranges, late, share, mean_m].into_iter().for_each(&mut f);
        }
    }
}

stored!(Learnt { ranges, late, lateness } told {});
stored!(LatenessMemory<const ANCHORS> { own } told {});

#[cfg(test)]
mod tests {
    use super::*;
    use rand_core::{Rng, SeedableRng};

    /// Ranges whose truth is told: a fifth is late by 0.4 m.
    #[test]
    fn share_and_mean_are_learnt() {
        let mut rng = rand_xoshiro::Xoshiro128PlusPlus::seed_from_u64(5);
        let mut uniform = || (rng.next_u32() >> 8) as f32 / 16_777_216.0 + 3e-8;
        let mut memory = LatenessMemory::<2>::new(1.0);
        for _ in 0..3000 {
            let normal = (0..12).map(|_| uniform()).sum::<f32>() - 6.0;
            let excess = if uniform() < 0.2 { -0.4 * uniform().ln() } else { 0.0 };
            let timing = memory.of(1).timing(0.1 * normal + excess, 0.01);
            memory.observe(1, &timing, 1.0);
        }
        let Lateness { share, mean_m } = memory.of(1);
        assert!((share - 0.2).abs() < 0.07 && (mean_m - 0.4).abs() < 0.12, "{share} {mean_m}");
        assert_eq!(memory.of(0), Lateness { share: FIRST_SHARE, mean_m: 1.0 });
    }

    #[test]
    fn who_is_never_late_learns_nothing() {
        let mut memory = LatenessMemory::<1>::new(0.0);
        let timing = Lateness { share: 0.5, mean_m: 1.0 }.timing(3.0, 0.01);
        memory.observe(0, &timing, 1.0);
        assert_eq!(memory.of(0), Lateness::NONE);
    }
}
