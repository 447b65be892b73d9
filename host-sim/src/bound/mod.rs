//! What a cycle could tell at best: the Cramer-Rao bound of the position from all paths of all anchors.
//!
//! Delays tau and amplitudes alpha of an anchor's paths are unknown together. Around the matched filter's output with
//! noise whitened at each path's own level, and G_kl = R(tau_k - tau_l), D_kl = R'(tau_k - tau_l), the information
//! about the delays alone is
//!
//! E_kl = 2 Re{alpha_k* alpha_l} (-R''(tau_k - tau_l) - (D G^-1 D')_kl),
//!
//! which for paths that do not overlap is 8 pi^2 beta^2 SINR_k on the diagonal. With the slopes U of the path lengths
//! over the position, J = U E U' / c^2; the position error bound is sqrt(tr J^-1).

pub mod posterior;

use crate::channel::pulse::PulseSpectrum;
use crate::channel::{Channel, Component, SPEED_OF_LIGHT_M_S};

/// Paths further apart than this many pulse durations do not overlap. Nearer a cut would make the matrix indefinite.
const REACH: f64 = 30.0;

/// Information about the position, 1/m^2: xx, xy, yy.
pub type Information = [f64; 3];

/// Information about the position from the paths of one anchor, seen from `directions` (unit vectors from each path's
/// image source to the tag, times the cosine of the elevation).
pub fn information(pulse: &PulseSpectrum, components: &[Component], directions: &[[f64; 2]]) -> Information {
    let count = components.len();
    let reach_s = REACH * pulse.duration_s();
    let lag = |k: usize, l: usize| {
        let lag_s = components[k].delay_s - components[l].delay_s;
        if lag_s.abs() < reach_s { pulse.autocorrelation(lag_s) } else { [0.0; 3] }
    };
    let lags: Vec<Vec<[f64; 3]>> = (0..count).map(|k| (0..count).map(|l| lag(k, l)).collect()).collect();
    let mut gram: Vec<Vec<f64>> = lags.iter().map(|row| row.iter().map(|r| r[0]).collect()).collect();
    // Paths at the very same delay cannot be told apart: their information is small, not infinite.
    (0..count).for_each(|k| gram[k][k] += 1e-6);
    let slopes: Vec<Vec<f64>> = lags.iter().map(|row| row.iter().map(|r| r[1]).collect()).collect();
    let factor = cholesky(gram);
    // Rows of D L^-T: their products are D G^-1 D'.
    let solved: Vec<Vec<f64>> = slopes.iter().map(|row| forward(&factor, row)).collect();
    // What metal lets through may be nothing at all.
    let whitened = |k: usize| {
        let magnitude = components[k].magnitude().max(f64::MIN_POSITIVE);
        components[k].amplitude * (components[k].sinr.sqrt() / magnitude)
    };
    let mut sum = [0.0; 3];
    for k in 0..count {
        for l in 0..count {
            let product: f64 = solved[k].iter().zip(&solved[l]).map(|(a, b)| a * b).sum();
            let both = (whitened(k).conj() * whitened(l)).re;
            let entry = 2.0 * both * (-lags[k][l][2] - product) / (SPEED_OF_LIGHT_M_S * SPEED_OF_LIGHT_M_S);
            let ([ux, uy], [vx, vy]) = (directions[k], directions[l]);
            sum[0] += entry * ux * vx;
            sum[1] += entry * 0.5 * (ux * vy + uy * vx);
            sum[2] += entry * uy * vy;
        }
    }
    sum
}

/// sqrt(tr J^-1), metres; infinite where the position is not observable.
pub fn error_bound_m([xx, xy, yy]: Information) -> f64 {
    let determinant = xx * yy - xy * xy;
    // What rounding leaves of a singular matrix is no information.
    if determinant <= 1e-12 * xx * yy { f64::INFINITY } else { ((xx + yy) / determinant).sqrt() }
}

/// Information about the position in a cycle when all anchors use `action`.
pub fn cycle_information(channel: &Channel, cycle: usize, action: usize) -> Information {
    let mut sum = [0.0; 3];
    for anchor in 0..channel.scenario().anchors.len() {
        let own = frame_information(channel, cycle, anchor, action);
        (0..3).for_each(|n| sum[n] += own[n]);
    }
    sum
}

/// Information about the position in one anchor's frame, per action, where a path of a SINR is found with the probability
/// `found(action, sinr)`: its SINR counts as that share of itself.
pub fn information_found(
    channel: &Channel,
    cycle: usize,
    anchor: usize,
    found: impl Fn(usize, f64) -> f64,
) -> Vec<Information> {
    let paths = channel.paths(cycle, anchor);
    let of_action = |action| {
        let mut components = channel.components_of(&paths, cycle, anchor, action);
        for component in &mut components {
            component.sinr *= found(action, component.sinr);
        }
        let directions: Vec<[f64; 2]> =
            components.iter().map(|component| direction(channel, cycle, anchor, component)).collect();
        information(channel.pulse(action), &components, &directions)
    };
    (0..channel.receiver().actions.len()).map(of_action).collect()
}

/// Information about the position in one anchor's frame.
pub fn frame_information(channel: &Channel, cycle: usize, anchor: usize, action: usize) -> Information {
    let components = channel.components(cycle, anchor, action);
    let directions: Vec<[f64; 2]> =
        components.iter().map(|component| direction(channel, cycle, anchor, component)).collect();
    information(channel.pulse(action), &components, &directions)
}

/// Change of a path's length over the tag's position.
fn direction(channel: &Channel, cycle: usize, anchor: usize, component: &Component) -> [f64; 2] {
    let [x, y] = channel.poses()[cycle].position_m;
    let [u, v] = channel.images(anchor)[component.source].position_m;
    let rise = channel.tag_height_m(cycle) - channel.scenario().anchors[anchor].height_m;
    let length = ((x - u) * (x - u) + (y - v) * (y - v) + rise * rise).sqrt().max(1e-6);
    [(x - u) / length, (y - v) / length]
}

/// Lower factor of a symmetric positive definite matrix.
pub(crate) fn cholesky(mut matrix: Vec<Vec<f64>>) -> Vec<Vec<f64>> {
    for row in 0..matrix.len() {
        for column in 0..=row {
            let known = matrix[row].iter().zip(&matrix[column]).take(column);
            let sum = matrix[row][column] - known.map(|(a, b)| a * b).sum::<f64>();
            matrix[row][column] =
                if row == column { sum.max(1e-12).sqrt() } else { sum / matrix[column][column] };
        }
    }
    matrix
}

/// Solves L x = b.
pub(crate) fn forward(factor: &[Vec<f64>], b: &[f64]) -> Vec<f64> {
    let mut x: Vec<f64> = Vec::with_capacity(b.len());
    for (row, value) in b.iter().enumerate() {
        let sum: f64 = x.iter().zip(&factor[row]).map(|(x, l)| x * l).sum();
        x.push((value - sum) / factor[row][row]);
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;
    use rustfft::num_complex::Complex64;

    fn component(delay_ns: f64, sinr: f64, phase: f64) -> Component {
        Component {
            source: 0,
            delay_s: delay_ns * 1e-9,
            amplitude: Complex64::from_polar(sinr.sqrt(), phase),
            sinr,
        }
    }

    #[test]
    fn two_separate_orthogonal_paths_give_the_closed_form() {
        let pulse = PulseSpectrum::root_raised_cosine(0.5e-9, 0.6);
        let components = [component(10.0, 100.0, 0.3), component(30.0, 25.0, 2.0)];
        let bound_m = error_bound_m(information(&pulse, &components, &[[1.0, 0.0], [0.0, -1.0]]));
        // sigma(20 dB) = 5.32 mm, and twice that at a quarter of the SINR.
        let expected_m = 5.32e-3 * 5f64.sqrt();
        assert!((bound_m / expected_m - 1.0).abs() < 1e-3, "{bound_m} {expected_m}");
        assert_eq!(error_bound_m(information(&pulse, &components[..1], &[[0.6, 0.8]])), f64::INFINITY);
    }

    /// Against the information matrix of all delays and amplitudes by numerical derivatives of the signal.
    #[test]
    fn overlapping_paths_give_what_derivatives_of_the_signal_give() {
        let pulse = PulseSpectrum::root_raised_cosine(0.5e-9, 0.6);
        let components =
            [component(10.0, 400.0, 0.4), component(10.35, 900.0, 1.9), component(11.1, 50.0, -2.0)];
        let parameters =
            |n: usize| components.iter().map(move |c| [c.delay_s * 1e9, c.amplitude.re, c.amplitude.im][n]);
        let theta: Vec<f64> = (0..3).flat_map(parameters).collect();
        // The signal in frequency, sqrt(P) as the pulse, unit noise.
        let points = 800;
        let step_hz = 3.3e9 / f64::from(points);
        let signal = |theta: &[f64]| -> Vec<Complex64> {
            (0..points)
                .map(|n| {
                    let f_hz = -1.65e9 + (f64::from(n) + 0.5) * step_hz;
                    let paths = (0..3).map(|k| {
                        let turn = -std::f64::consts::TAU * f_hz * theta[k] * 1e-9;
                        Complex64::new(theta[3 + k], theta[6 + k]) * Complex64::from_polar(1.0, turn)
                    });
                    paths.sum::<Complex64>() * (pulse.power(f_hz) * step_hz).sqrt()
                })
                .collect()
        };
        let slope = |n: usize| -> Vec<Complex64> {
            let (mut up, mut down) = (theta.clone(), theta.clone());
            let h = 1e-5;
            up[n] += h;
            down[n] -= h;
            signal(&up).iter().zip(signal(&down)).map(|(a, b)| (a - b) / (2.0 * h)).collect()
        };
        let slopes: Vec<_> = (0..9).map(slope).collect();
        let fisher = nalgebra::SMatrix::<f64, 9, 9>::from_fn(|i, j| {
            2.0 * slopes[i].iter().zip(&slopes[j]).map(|(a, b)| (a.conj() * b).re).sum::<f64>()
        });
        let covariance = fisher.try_inverse().expect("is regular");
        let delays = covariance.fixed_view::<3, 3>(0, 0).into_owned() * 1e-18;
        let expected = delays.try_inverse().expect("is regular") / (SPEED_OF_LIGHT_M_S * SPEED_OF_LIGHT_M_S);
        let directions = [[0.6, 0.8], [-1.0, 0.0], [0.0, 1.0]];
        let slopes = nalgebra::SMatrix::<f64, 2, 3>::from_fn(|axis, k| directions[k][axis]);
        let j = slopes * expected * slopes.transpose();
        let ours = information(&pulse, &components, &directions);
        for (ours, theirs) in ours.iter().zip([j[(0, 0)], j[(0, 1)], j[(1, 1)]]) {
            assert!((ours / theirs - 1.0).abs() < 1e-3, "{ours} {theirs}");
        }
    }
}
