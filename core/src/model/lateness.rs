//! Lateness of ranges: where the direct path is blocked, the first one to arrive has gone another way, and the range is too long.
//! It is never too short.
//!
//! With nu the range's innovation and S its variance, a range is on time with probability 1 - w, N(nu; 0, S), and otherwise late by
//! an excess that is exponentially distributed with mean lambda. The convolution of both densities is, with s = sqrt(S),
//! x = nu / s - s / lambda, and phi and Phi the standard normal density and distribution,
//!
//! E(nu) = exp(S / (2 lambda^2) - nu / lambda) Phi(x) / lambda = N(nu; 0, S) (s / lambda) Phi(x) / phi(x).
//!
//! What such a range says of a Gaussian state is, to second order (assumed density filtering), in Z = (1 - w) N + w E and its
//! derivatives over the predicted range: the mean moves by Z' / Z times the covariance, which changes by (Z' / Z)^2 - Z'' / Z. That is
//! what a soft update makes of the moments S Z' / Z and S^2 Z'' / Z + S of an innovation.

use crate::real::{erfc, exp, larger, sqrt};
use crate::snapshot::stored;

/// Mathematics: from this many deviations on the continued fraction of the tail of the normal distribution is exact to f32.
pub const TAIL: f32 = 4.0;
/// Mathematics: 1 / sqrt(2 pi).
const NORMAL: f32 = 0.398_942_3;

/// How late the ranges of an anchor are.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Lateness {
    /// Share of those that are late: w, below 1.
    pub share: f32,
    /// Their mean excess lambda, metres, above 0.
    pub mean_m: f32,
}

/// What a range says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Timing {
    /// Its density Z, per metre.
    pub per_m: f32,
    /// S Z' / Z: the innovation, but for what of it is excess, metres.
    pub first_m: f32,
    /// S^2 Z'' / Z + S: its square, metres^2.
    pub second_m2: f32,
    /// Probability that it is late.
    pub late: f32,
    /// Its mean excess if it is, metres.
    pub excess_m: f32,
}

impl Lateness {
    /// Never.
    pub const NONE: Self = Self { share: 0.0, mean_m: 1.0 };

    /// Whether any range is late.
    pub fn is_any(&self) -> bool {
        self.share > 0.0
    }

    /// How much longer than expected a range may be, metres, that is `gate` deviations off at most if it is on time: the density of
    /// late ones falls by as much.
    pub fn reach_m(&self, gate: f32, std_m: f32) -> f32 {
        gate * std_m + 0.5 * (gate * gate) * self.mean_m
    }

    /// What a range says with this innovation, metres, of this variance, square metres; its measurement noise included.
    #[inline(never)] // out of the way of ranges that are never late
    pub fn timing(&self, innovation_m: f32, variance_m2: f32) -> Timing {
        let Self { share, mean_m } = *self;
        let std_m = sqrt(variance_m2);
        let (nu, steepness) = (innovation_m / std_m, std_m / mean_m);
        let x = nu - steepness;
        let normal = exp(-0.5 * (nu * nu)) * (NORMAL / std_m);
        // E and phi(x) / Phi(x); ahead of its mean by the tail, whose exponentials cancel.
        let (late_per_m, hazard) = if x < 0.0 {
            let tail = upper_tail(-x);
            (normal * (steepness * tail), 1.0 / tail)
        } else {
            let below = 1.0 - upper_tail(x) * density(x);
            (exp(0.5 * (steepness * steepness) - nu * steepness) * (below / mean_m), density(x) / below)
        };
        let (on_time, late) = ((1.0 - share) * normal, share * late_per_m);
        let per_m = larger(on_time + late, f32::MIN_POSITIVE);
        let p = late / per_m;
        // Of the late ones, in deviations: E' / E and E'' / E.
        let first = steepness - hazard;
        let second = steepness * steepness - hazard * (steepness + nu);
        Timing {
            per_m,
            first_m: std_m * ((1.0 - p) * nu + p * first),
            second_m2: variance_m2 * ((1.0 - p) * (nu * nu) + p * (second + 1.0)),
            late: p,
            excess_m: larger(std_m * (x + hazard), 0.0),
        }
    }
}

/// phi(x).
fn density(x: f32) -> f32 {
    NORMAL * exp(-0.5 * (x * x))
}

/// (1 - Phi(t)) / phi(t) for t >= 0 (Mills's ratio).
fn upper_tail(t: f32) -> f32 {
    if t < TAIL {
        0.5 * erfc(t * core::f32::consts::FRAC_1_SQRT_2) / density(t)
    } else {
        1.0 / (t + 1.0 / (t + 2.0 / (t + 3.0 / (t + 4.0 / (t + 5.0 / t)))))
    }
}

stored!(Lateness { share, mean_m } told {});

#[cfg(test)]
mod tests {
    use super::*;

    /// Z, Z' / Z and Z'' / Z over the predicted range, probability and mean of the excess, by sums over the excess in f64.
    fn exact(own: &Lateness, nu: f64, variance: f64) -> [f64; 5] {
        let (share, mean) = (f64::from(own.share), f64::from(own.mean_m));
        let normal = |nu: f64| (-0.5 * nu * nu / variance).exp() / (core::f64::consts::TAU * variance).sqrt();
        let step = mean.min(variance.sqrt()) / 200.0;
        let mut sums = [0.0; 4];
        let mut add = |weight: f64, nu: f64, excess: f64| {
            let density = weight * normal(nu);
            sums[0] += density;
            sums[1] += density * nu / variance;
            sums[2] += density * (nu * nu / variance - 1.0) / variance;
            sums[3] += density * excess;
        };
        add(1.0 - share, nu, 0.0);
        let on_time = (1.0 - share) * normal(nu);
        for n in 0..200_000 {
            let excess = (f64::from(n) + 0.5) * step;
            if excess > 30.0 * mean + 10.0 * variance.sqrt() {
                break;
            }
            add(share * step * (-excess / mean).exp() / mean, nu - excess, excess);
        }
        let late = sums[0] - on_time;
        [sums[0], sums[1] / sums[0], sums[2] / sums[0], late / sums[0], sums[3] / late]
    }

    #[test]
    fn a_range_says_what_its_density_and_both_derivatives_do() {
        for share in [0.05, 0.5, 0.9] {
            for (mean_m, variance_m2) in [(0.3_f32, 0.01_f32), (0.3, 1.0), (2.0, 0.04), (0.05, 0.09)] {
                let own = Lateness { share, mean_m };
                for deviations in [-4.0, -2.0, -0.5, 0.0, 0.7, 2.0, 4.0, 8.0] {
                    let nu = deviations * variance_m2.sqrt();
                    let timing = own.timing(nu, variance_m2);
                    let variance = f64::from(variance_m2);
                    let [per_m, first, second, late, excess] = exact(&own, f64::from(nu), variance);
                    let case =
                        std::format!("{own:?} {variance_m2} {deviations}: {timing:?} {first} {second}");
                    assert!((f64::from(timing.per_m) / per_m - 1.0).abs() < 2e-3, "{per_m} {case}");
                    let std = variance.sqrt();
                    assert!((f64::from(timing.first_m) / std - first * std).abs() < 5e-3, "{case}");
                    let moment = variance * second + 1.0;
                    let error = (f64::from(timing.second_m2) / variance - moment).abs();
                    assert!(error < 5e-3 * (1.0 + moment.abs()), "{case}");
                    assert!((f64::from(timing.late) - late).abs() < 2e-3, "{case} {late}");
                    assert!(
                        (f64::from(timing.excess_m) - excess).abs() < 5e-3 * (std + excess),
                        "{case} {excess}"
                    );
                }
            }
        }
    }

    #[test]
    fn ranges_that_are_never_late_are_normal() {
        for nu in [-0.3_f32, 0.0, 0.2] {
            let timing = Lateness::NONE.timing(nu, 0.01);
            assert!((timing.first_m - nu).abs() < 1e-6 && (timing.second_m2 - nu * nu).abs() < 1e-6);
            let normal = NORMAL * (-0.5 * nu * nu / 0.01).exp() / 0.1;
            assert!((timing.per_m / normal - 1.0).abs() < 1e-5);
        }
    }

    #[test]
    fn however_long_and_short_a_range_is_it_says_numbers() {
        for share in [0.0, 1e-3, 0.5, 0.99] {
            for mean_m in [1e-3, 1.0, 100.0] {
                for variance_m2 in [1e-6, 1.0, 1e4] {
                    for nu in [-1e4, -10.0, 0.0, 10.0, 1e4] {
                        let Timing { per_m, first_m, second_m2, late, excess_m } =
                            Lateness { share, mean_m }.timing(nu, variance_m2);
                        let all = [per_m, first_m, second_m2, late, excess_m];
                        assert!(
                            all.iter().all(|v| v.is_finite()),
                            "{share} {mean_m} {variance_m2} {nu}: {all:?}"
                        );
                    }
                }
            }
        }
    }
}
