//! Late ranges: an exponential excess on top of the normal error, and what is learnt of it.
//!
//! Z = (1 - w) N + w E, with E the density of the sum of both errors. Moments of an innovation that make a soft update move the state
//! as the logarithm of Z and its curvature say: S Z' / Z, and S^2 Z'' / Z + S.

use super::real::{Real, erfc, exp, larger, limited, smaller, sqrt, square};
use cogmint_core::memory::lateness::{
    FIRST_LATE, FIRST_RANGES, FIRST_SHARE, LEAST_MEAN_M, MOST_RANGES, SHARES,
};
use cogmint_core::model::lateness::TAIL;
use std::fmt;

/// 1 / sqrt(2 pi).
const NORMAL: f32 = 0.398_942_3;

/// How late the ranges of an anchor are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lateness<T> {
    /// Share of late ones.
    pub share: T,
    /// Their mean excess, metres.
    pub mean_m: T,
}

/// What a range says with some innovation.
#[derive(Clone, Copy, Debug)]
pub struct Timing<T> {
    /// Z, per metre.
    pub per_m: T,
    /// The moments, metres and square metres.
    pub moments: [T; 2],
    /// Probability that it is late, and its mean excess then, metres.
    pub late: [T; 2],
}

impl<T: Real> Lateness<T> {
    /// No range is late.
    pub fn none() -> Self {
        Self { share: T::ZERO, mean_m: T::ONE }
    }

    /// Whether some are.
    pub fn is_any(&self) -> bool {
        self.share > T::ZERO
    }

    /// Innovations that a range may have, metres.
    pub fn gate_m(&self, deviations: f32, std_m: T) -> [T; 2] {
        let gate = T::of(deviations);
        [-(gate * std_m), gate * std_m + T::of(0.5) * (gate * gate) * self.mean_m]
    }

    /// Of an innovation, metres, with this variance.
    pub fn timing(&self, innovation_m: T, variance_m2: T) -> Timing<T> {
        let half = T::of(0.5);
        let std_m = sqrt(variance_m2);
        let nu = innovation_m / std_m;
        let steepness = std_m / self.mean_m;
        let x = nu - steepness;
        let normal = exp(-half * square(nu)) * (T::of(NORMAL) / std_m);
        let (convolved, hazard);
        if x < T::ZERO {
            // Order: N times (s / lambda times the ratio of distribution and density).
            let ratio = mills(-x);
            convolved = normal * (steepness * ratio);
            hazard = T::ONE / ratio;
        } else {
            let distribution = T::ONE - mills(x) * phi(x);
            convolved = exp(half * square(steepness) - nu * steepness) * (distribution / self.mean_m);
            hazard = phi(x) / distribution;
        }
        let late_m = self.share * convolved;
        let per_m = larger((T::ONE - self.share) * normal + late_m, T::of(f32::MIN_POSITIVE));
        let late = late_m / per_m;
        let on_time = T::ONE - late;
        let slope = steepness - hazard;
        let bend = square(steepness) - hazard * (steepness + nu);
        Timing {
            per_m,
            moments: [
                std_m * (on_time * nu + late * slope),
                variance_m2 * (on_time * square(nu) + late * (bend + T::ONE)),
            ],
            late: [late, larger(std_m * (x + hazard), T::ZERO)],
        }
    }
}

/// Standard normal density.
fn phi<T: Real>(x: T) -> T {
    T::of(NORMAL) * exp(T::of(-0.5) * square(x))
}

/// Mills's ratio of the upper tail: of probability and density.
fn mills<T: Real>(t: T) -> T {
    if t < T::of(TAIL) {
        return T::of(0.5) * erfc(t * T::of(std::f32::consts::FRAC_1_SQRT_2)) / phi(t);
    }
    // The continued fraction, from the fifth level up.
    let mut ratio = t;
    for level in (1..=5).rev() {
        ratio = t + T::of(level as f32) / ratio;
    }
    T::ONE / ratio
}

/// What is known of one anchor.
#[derive(Clone, Debug)]
pub struct Learnt<T> {
    /// Ranges that the share rests on.
    pub ranges: T,
    /// Late ones that the mean rests on.
    pub late: T,
    /// Both.
    pub lateness: Lateness<T>,
}

/// What is learnt, by anchor.
#[derive(Clone, Debug)]
pub struct LatenessMemory<T>(pub Vec<Learnt<T>>);

impl<T: Real> LatenessMemory<T> {
    /// Of so many anchors, whose late ranges are `mean_m` too long; 0: none is late.
    pub fn new(mean_m: f32, anchors: usize) -> Self {
        let mut lateness = Lateness::none();
        if mean_m > 0.0 {
            let mean_m = larger(T::of(mean_m), T::of(LEAST_MEAN_M));
            lateness = Lateness { share: T::of(FIRST_SHARE), mean_m };
        }
        let own = Learnt { ranges: T::of(FIRST_RANGES), late: T::of(FIRST_LATE), lateness };
        Self(vec![own; anchors])
    }

    /// Learns from a range that is of the direct path with this probability.
    pub fn remember(&mut self, anchor: usize, timing: &Timing<T>, probability: T) {
        let Learnt { ranges, late, lateness } = &mut self.0[anchor];
        if !lateness.is_any() {
            return;
        }
        let [p, excess_m] = timing.late;
        let own = probability * p;
        *ranges = smaller(*ranges + probability, T::of(MOST_RANGES));
        *late = smaller(*late + own, T::of(MOST_RANGES));
        let share = lateness.share + (own - probability * lateness.share) / *ranges;
        lateness.share = limited(share, T::of(SHARES[0]), T::of(SHARES[1]));
        let mean_m = lateness.mean_m + own * (excess_m - lateness.mean_m) / *late;
        lateness.mean_m = larger(mean_m, T::of(LEAST_MEAN_M));
    }

    /// Every number with its name, in the core's order.
    pub fn visit(&self, f: &mut dyn FnMut(fmt::Arguments<'_>, T)) {
        for (anchor, Learnt { ranges, late, lateness }) in self.0.iter().enumerate() {
            f(format_args!("ranges of anchor {anchor} that its share of late ones rests on"), *ranges);
            f(format_args!("late ones of anchor {anchor} that their mean rests on"), *late);
            f(format_args!("share of late ranges of anchor {anchor}"), lateness.share);
            f(format_args!("mean excess of late ranges of anchor {anchor}"), lateness.mean_m);
        }
    }
}
