//! The beginning of a response and the tail of the noise ahead of it.
//!
//! Dense multipath begins with a path: the fit has one at the first maximum that exceeds kappa N0, at most 60 ns before the strongest
//! sample, and drops it where |q|^2 / s falls below n (exp(kappa / n) - 1), with kappa that of half the false paths asked
//! for and n the independent samples of a level. Energies over the level above 4 whose mean excess is mu > 1 raise every kappa to
//! 4 + mu (kappa - 4).

use super::ChannelEstimator;
use crate::reference::real::{Real, exp, larger};
use cogmint_core::perceptor::channel_estimator::beginning::{SEARCH_S, TAIL_FROM, TAIL_PRIOR};

/// The first maximum in reach of the strongest sample, and the number of samples out of its reach.
pub(super) fn beginning<T: Real>(
    estimator: &ChannelEstimator<T>,
    powers: &[T],
    threshold: T,
) -> Option<[usize; 2]> {
    // Order: the first of equals.
    let mut strongest = 0;
    for n in 1..powers.len() {
        if powers[n] > powers[strongest] {
            strongest = n;
        }
    }
    let reach = T::of(SEARCH_S) / estimator.sample_spacing_s;
    let first = strongest.saturating_sub(reach.whole() as usize + 1);
    for n in first..=strongest {
        let falls = n == strongest || powers[n + 1] <= powers[n];
        if falls && powers[n] > threshold {
            return Some([n, first]);
        }
    }
    None
}

/// Mean excess of the energies that stand out of the noise ahead of the search; at least 1.
pub(super) fn tail<T: Real>(powers: &[T], levels: &[T]) -> T {
    let num = T::of;
    let (mut excess, mut count) = (num(TAIL_PRIOR), num(TAIL_PRIOR));
    for n in 0..powers.len() {
        let energy = powers[n] / levels[n];
        if energy > num(TAIL_FROM) {
            excess += energy - num(TAIL_FROM);
            count += T::ONE;
        }
    }
    larger(excess / count, T::ONE)
}

/// kappa where the noise's mean excess is `tail`. Order: what is added to kappa.
pub(super) fn farther<T: Real>(kappa: T, tail: T) -> T {
    kappa + larger(kappa - T::of(TAIL_FROM), T::ZERO) * (tail - T::ONE)
}

/// n (exp(kappa / n) - 1).
pub(super) fn beside<T: Real>(kappa: T, samples: T) -> T {
    samples * (exp(kappa / samples) - T::ONE)
}
