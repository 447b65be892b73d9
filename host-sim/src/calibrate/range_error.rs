//! The errors of a radio's ranges: noise, a one-sided excess where the direct path is weak or blocked, and false ranges.
//!
//! p(e) = (1 - f) [(1 - w) N(e; 0, sigma^2) + w E(e; sigma, m)] + f / L
//!
//! with E the density of noise plus an exponential excess of mean m (exponentially modified Gaussian), w the share of ranges
//! with excess, f that of false ranges, which are uniform over L. With t = e/sigma - sigma/m and Mills' ratio
//! M(t) = Phi(t)/phi(t), E = (sigma/m) N(e) M(t).

use libm::erfc;
use std::f64::consts::{PI, SQRT_2};

/// The parameters that scores and information are about, in this order: the error itself (a shift of it), ln sigma, ln m,
/// logit w, logit f.
pub const PARAMETERS: usize = 5;
/// Points of the information's integral over noise and excess.
const POINTS: usize = 240;
/// Step of numeric slopes, in logarithms and logits.
const SLOPE_STEP: f64 = 1e-3;
/// Below this the Gaussian tail is taken from its asymptotic series.
const DEEP: f64 = -6.0;

/// What the errors of ranges look like.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RangeError {
    /// Standard deviation sigma of the noise, metres.
    pub noise_std_m: f64,
    /// Share w of the ranges that are too long, 0 to 1.
    pub excess_share: f64,
    /// Their mean excess m, metres.
    pub excess_m: f64,
    /// Share f of false ranges, 0 to 1.
    pub false_share: f64,
    /// They are uniform over this length L, metres.
    pub longest_m: f64,
}

/// Derivatives of a density's logarithm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Score {
    /// ln p.
    pub ln_density: f64,
    /// Its derivatives over the parameters.
    pub slopes: [f64; PARAMETERS],
}

impl RangeError {
    /// ln p(e) and its derivatives.
    pub fn score(&self, error_m: f64) -> Score {
        let Self { noise_std_m: s, excess_share: w, excess_m: m, false_share: f, longest_m } = *self;
        let z = error_m / s;
        let normal = (-0.5 * z * z).exp() / (s * (2.0 * PI).sqrt());
        let excess = excess_density(error_m, s, m);
        // Of the Gaussian; the heat equation gives slopes over sigma: dE/d(sigma^2) = E''/2.
        let normal_slope = -z / s * normal;
        let excess_slope = (normal - excess) / m;
        let excess_curve = (normal_slope - excess_slope) / m;
        let sm2 = (s / m) * (s / m);
        let inlier = (1.0 - w) * normal + w * excess;
        let uniform = 1.0 / longest_m;
        let p = ((1.0 - f) * inlier + f * uniform).max(f64::MIN_POSITIVE);
        let slopes = [
            (1.0 - f) * ((1.0 - w) * normal_slope + w * excess_slope),
            (1.0 - f) * ((1.0 - w) * normal * (z * z - 1.0) + w * s * s * excess_curve),
            (1.0 - f) * w * (excess * (error_m / m - 1.0 - sm2) + sm2 * normal),
            (1.0 - f) * w * (1.0 - w) * (excess - normal),
            f * (1.0 - f) * (uniform - inlier),
        ];
        Score { ln_density: p.ln(), slopes: slopes.map(|slope| slope / p) }
    }

    /// Probability that a range with this error has an excess or is false.
    pub fn suspicion(&self, error_m: f64) -> f64 {
        let Self { noise_std_m: s, excess_share: w, false_share: f, .. } = *self;
        let z = error_m / s;
        let normal = (-0.5 * z * z).exp() / (s * (2.0 * PI).sqrt());
        (1.0 - (1.0 - f) * (1.0 - w) * normal / self.score(error_m).ln_density.exp()).clamp(0.0, 1.0)
    }

    /// Expected information of one range on the parameters, by Simpson's rule.
    pub fn information(&self) -> [[f64; PARAMETERS]; PARAMETERS] {
        let mut information = [[0.0; PARAMETERS]; PARAMETERS];
        let Self { noise_std_m: s, excess_m: m, .. } = *self;
        let (from_m, noise_to_m, to_m) = (-8.0 * s, 8.0 * s, 8.0 * s + 14.0 * m);
        // The noise is narrow, the excess long: each with a step of its own.
        for (from_m, to_m) in [(from_m, noise_to_m), (noise_to_m, to_m)] {
            let step_m = (to_m - from_m) / POINTS as f64;
            for n in 0..=POINTS {
                let weight = if n == 0 || n == POINTS { 1.0 } else { 2.0 + 2.0 * (n % 2) as f64 } / 3.0;
                let Score { ln_density, slopes } = self.score(from_m + step_m * n as f64);
                let mass = weight * step_m * ln_density.exp();
                for (row, a) in information.iter_mut().zip(slopes) {
                    row.iter_mut().zip(slopes).for_each(|(entry, b)| *entry += mass * a * b);
                }
            }
        }
        // Elsewhere a range is false beyond doubt: p = f / L, which tells of f alone.
        let beyond = self.false_share * (1.0 - (to_m - from_m) / self.longest_m).max(0.0);
        information[4][4] += beyond * (1.0 - self.false_share).powi(2);
        information
    }

    /// Slopes of the logarithm of [`RangeError::information`]'s first entry, the weight of a range as a length, over ln sigma, ln m,
    /// logit w and logit f, by differences.
    pub fn precision_slopes(&self) -> [f64; PARAMETERS - 1] {
        std::array::from_fn(|parameter| {
            let at = |by: f64| self.moved(parameter, by).information()[0][0].ln();
            (at(SLOPE_STEP) - at(-SLOPE_STEP)) / (2.0 * SLOPE_STEP)
        })
    }

    /// With one of ln sigma, ln m, logit w and logit f, counted from 0, moved.
    pub fn moved(self, parameter: usize, by: f64) -> Self {
        let share = |share: f64| 1.0 / (1.0 + (1.0 / share - 1.0) * (-by).exp());
        match parameter {
            0 => Self { noise_std_m: self.noise_std_m * by.exp(), ..self },
            1 => Self { excess_m: self.excess_m * by.exp(), ..self },
            2 => Self { excess_share: share(self.excess_share), ..self },
            _ => Self { false_share: share(self.false_share), ..self },
        }
    }

    /// Mean and standard deviation of the error of a range that is not false, metres: what a tracker that knows Gaussians alone
    /// is told.
    pub fn moments_m(&self) -> (f64, f64) {
        let Self { noise_std_m: s, excess_share: w, excess_m: m, .. } = *self;
        (w * m, (s * s + 2.0 * w * m * m - w * w * m * m).sqrt())
    }
}

/// Density of normal noise plus an exponential excess.
fn excess_density(error_m: f64, s: f64, m: f64) -> f64 {
    let z = error_m / s;
    let t = z - s / m;
    if t < DEEP {
        // Mills' ratio: M(t) = (1 - 1/t^2 + 3/t^4 - 15/t^6) / |t|.
        let u = 1.0 / (t * t);
        let mills = (1.0 - u * (1.0 - 3.0 * u * (1.0 - 5.0 * u))) / -t;
        return (-0.5 * z * z).exp() / (m * (2.0 * PI).sqrt()) * mills;
    }
    (0.5 * (s / m) * (s / m) - error_m / m).exp() * 0.5 * erfc(-t / SQRT_2) / m
}

#[cfg(test)]
mod tests {
    use super::*;

    fn usual() -> RangeError {
        RangeError { noise_std_m: 0.1, excess_share: 0.25, excess_m: 0.4, false_share: 0.02, longest_m: 30.0 }
    }

    #[test]
    fn slopes_are_those_of_the_logarithm() {
        let error = usual();
        for error_m in [-2.0, -0.7, -0.3, 0.0, 0.12, 0.5, 3.0, 12.0] {
            let slopes = error.score(error_m).slopes;
            for (parameter, slope) in slopes.into_iter().enumerate() {
                let step = 1e-5;
                let moved = |by: f64| if parameter == 0 { error } else { error.moved(parameter - 1, by) };
                let at = |by: f64| {
                    let moved_m = if parameter == 0 { by } else { 0.0 };
                    moved(by).score(error_m + moved_m).ln_density
                };
                let numeric = (at(step) - at(-step)) / (2.0 * step);
                assert!((slope - numeric).abs() < 1e-4 * (1.0 + slope.abs()), "{parameter} at {error_m} m");
            }
        }
    }

    #[test]
    fn the_density_is_one_in_all_and_has_the_moments_it_says() {
        let error = RangeError { false_share: 1e-12, ..usual() };
        let (step_m, mut sums) = (1e-3, [0.0; 3]);
        for n in -3000..12_000 {
            let error_m = step_m * f64::from(n);
            let mass = step_m * error.score(error_m).ln_density.exp();
            for (power, sum) in sums.iter_mut().enumerate() {
                *sum += mass * error_m.powi(power as i32);
            }
        }
        let (mean_m, std_m) = error.moments_m();
        assert!((sums[0] - 1.0).abs() < 1e-6, "{sums:?}");
        assert!((sums[1] - mean_m).abs() < 1e-5, "{sums:?}");
        assert!((sums[2] - sums[1] * sums[1] - std_m * std_m).abs() < 1e-5, "{sums:?}");
    }

    #[test]
    fn without_excess_the_information_is_that_of_a_gaussian() {
        let error = RangeError { excess_share: 1e-9, false_share: 1e-9, ..usual() };
        let information = error.information();
        assert!((information[0][0] * 0.01 - 1.0).abs() < 1e-4, "{information:?}");
        assert!((information[1][1] - 2.0).abs() < 1e-3, "{information:?}");
        // One in four with an excess of four deviations leaves about that share less.
        let with = usual().information()[0][0] * 0.01;
        assert!((0.5..0.8).contains(&with), "{with}");
    }

    #[test]
    fn deep_in_the_tail_both_forms_are_one() {
        let (s, m) = (0.1, 0.4);
        let at = |t: f64| excess_density((t + s / m) * s, s, m);
        let (below, above) = (at(DEEP - 1e-9), at(DEEP + 1e-9));
        assert!((below / above - 1.0).abs() < 1e-4, "{below} {above}");
    }
}
