//! How probable it is that a path of a given SINR is found at all.
//!
//! Where noise alone passes the threshold kappa with the rate that was asked for, a path passes it with
//! P_d = Q_1(sqrt(2 SINR), sqrt(2 kappa)) (Marcum). Here by Q_1(a, b) = Phi(a - b), Phi the normal distribution, and that
//! by the logistic curve: within 0.08 of the exact value.

use crate::real::{exp, larger, limited, sqrt};

/// Mathematics: logistic slope that comes closest to the normal distribution.
pub const LOGISTIC: f32 = 1.702;
/// Mathematics: the same for the difference of roots instead of doubled ones.
const LOGISTIC_ROOTS: f32 = LOGISTIC * core::f32::consts::SQRT_2;

/// Tuned: against taking a hidden path for one that never comes: detection probability of a path that is hidden at present, and
/// of a virtual anchor that a floor plan tells of and that was never seen: most are hidden from most places, and a few steps on
/// another one comes out. No memory of misses may make it less, or a path that comes back would go to a false neighbour.
pub const HIDDEN_DETECTION: f32 = 0.1;

/// Tuned: against a plan believed to the letter: probability that a path is found which, by the plan, cannot come. Over twelve
/// rooms of others such paths were found in 1 to 6 of a hundred scans: false paths and furniture.
pub const UNAVAILABLE_DETECTION: f32 = 0.03;

/// Probability (0 to 1) that a path of `sinr` passes `threshold`, both on normalised energy.
pub fn detection_probability(sinr: f32, threshold: f32) -> f32 {
    1.0 / (1.0 + missed_odds(sqrt(larger(sinr, 0.0)), sqrt(larger(threshold, 0.0))))
}

/// Odds against finding a path, (1 - P_d) / P_d, from the square roots of its SINR and of the threshold.
pub fn missed_odds(sinr_root: f32, threshold_root: f32) -> f32 {
    exp(LOGISTIC_ROOTS * (threshold_root - sinr_root))
}

/// Guard: against certainty that no false alarm is so strong, whatever a radio may do: their least density, over that of all.
pub const LEAST_FALSE_ALARM: f32 = 1e-4;

/// Density of false alarms of `sinr` over that of all that pass `threshold`, 1e-4 to 1.
///
/// Noise of the level assumed passes an energy E with probability e^-E; of twice that level, which an estimated level may
/// be off by, with e^(-E/2). Strong paths are no false alarms.
pub fn false_alarm(sinr: f32, threshold: f32) -> f32 {
    limited(exp(0.5 * (threshold - sinr)), LEAST_FALSE_ALARM, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Q_1(a, b) as the integral of x exp(-(x^2 + a^2) / 2) I_0(a x) from b, I_0 as its own integral.
    fn marcum(a: f64, b: f64) -> f64 {
        let step = 0.01;
        let bessel = |y: f64| {
            let points = 200;
            let term =
                |n: i32| ((core::f64::consts::PI * (f64::from(n) + 0.5) / f64::from(points)).cos() - 1.0) * y;
            (0..points).map(|n| term(n).exp()).sum::<f64>() / f64::from(points)
        };
        (0..3000)
            .map(|n| b + (f64::from(n) + 0.5) * step)
            .map(|x| x * (-0.5 * (x - a) * (x - a)).exp() * bessel(a * x) * step)
            .sum()
    }

    #[test]
    fn the_curve_is_that_of_marcum() {
        for threshold in [4.57_f64, 6.34, 8.81] {
            for sinr_db in 0..20 {
                let sinr = 10_f64.powf(0.1 * f64::from(sinr_db));
                let exact = marcum((2.0 * sinr).sqrt(), (2.0 * threshold).sqrt());
                let ours = f64::from(detection_probability(sinr as f32, threshold as f32));
                assert!((ours - exact).abs() < 0.08, "{threshold} {sinr_db} dB: {ours} {exact}");
            }
        }
    }
}
