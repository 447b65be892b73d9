//! Joint amplitudes of paths at given positions, and which of them are worth keeping.
//!
//! After the matched filter white noise has the autocorrelation R, so least squares needs the frame only at the paths'
//! positions: G alpha = y, G_kl = R(tau_k - tau_l). Taking path k away would leave |alpha_k|^2 / (G^-1)_kk more.

use super::super::estimator::Found;
use super::frame::{Component, Frame};
use super::level::{LevelModel, level_at};
use nalgebra::DMatrix;
use rustfft::num_complex::Complex64;

/// Paths whose part that no other explains is less than this share of their energy are the same path.
const LEAST_OWN_SHARE: f64 = 1e-3;

/// The components with their joint amplitudes, and the energy that each explains alone. `None` where two cannot be told
/// apart.
pub(super) fn solve(frame: &Frame, positions: &[f64]) -> Option<(Vec<Component>, Vec<f64>)> {
    let count = positions.len();
    let gram =
        DMatrix::from_fn(count, count, |row, column| frame.radio.pulse(positions[row] - positions[column]));
    let factor = gram.cholesky()?;
    // The squares on the factor's diagonal are what each path has beside those before it.
    if factor.l_dirty().diagonal().iter().any(|own| own * own < LEAST_OWN_SHARE) {
        return None;
    }
    let inverse = factor.inverse();
    let seen: Vec<Complex64> = positions.iter().map(|&position| frame.at(position)).collect();
    let of = |(k, position): (usize, &f64)| {
        let amplitude = inverse.column(k).iter().zip(&seen).map(|(share, value)| value * *share).sum();
        Component { position: *position, amplitude }
    };
    let components: Vec<Component> = positions.iter().enumerate().map(of).collect();
    let energy = |(k, one): (usize, &Component)| one.amplitude.norm_sqr() / inverse[(k, k)];
    let energies = components.iter().enumerate().map(energy).collect();
    Some((components, energies))
}

/// Takes away, one at a time, the path that explains least over its level, until all that stay exceed the threshold.
pub(super) fn keep_worthy(
    frame: &Frame,
    mut positions: Vec<f64>,
    model: LevelModel,
    threshold: f64,
) -> Vec<Found> {
    while !positions.is_empty() {
        let Some((components, energies)) = solve(frame, &positions) else {
            // Two on top of each other: the later one goes.
            positions = apart(positions);
            continue;
        };
        let levels = model.levels(&frame.residual_powers(&components), frame.radio);
        let worth =
            components.iter().zip(&energies).map(|(one, energy)| energy / level_at(&levels, one.position));
        let least = worth.enumerate().min_by(|a, b| a.1.total_cmp(&b.1));
        match least {
            Some((index, worth)) if worth < threshold => {
                positions.remove(index);
            }
            _ => return components.iter().map(|one| found(frame, one, &levels)).collect(),
        }
    }
    Vec::new()
}

/// What is reported of a component.
pub(super) fn found(frame: &Frame, component: &Component, levels: &[f64]) -> Found {
    Found {
        delay_s: component.position * frame.radio.spacing_s,
        sinr: component.amplitude.norm_sqr() / level_at(levels, component.position),
    }
}

/// Without the later one of the closest two.
fn apart(mut positions: Vec<f64>) -> Vec<f64> {
    positions.sort_by(f64::total_cmp);
    let gaps = positions.windows(2).map(|pair| pair[1] - pair[0]);
    match gaps.enumerate().min_by(|a, b| a.1.total_cmp(&b.1)) {
        Some((index, _)) => positions.remove(index + 1),
        None => positions.remove(0),
    };
    positions
}

#[cfg(test)]
mod tests {
    use super::super::frame::Radio;
    use super::*;

    #[test]
    fn overlapping_paths_without_noise_get_their_amplitudes_back() {
        let radio = Radio::of_the_experiment();
        let truth = [
            Component { position: 100.2, amplitude: Complex64::new(3.0, -1.0) },
            Component { position: 101.5, amplitude: Complex64::new(-2.0, 4.0) },
            Component { position: 140.7, amplitude: Complex64::new(0.5, 0.1) },
        ];
        let at = |n: usize| -> [f32; 2] {
            let sum: Complex64 =
                truth.iter().map(|one| one.amplitude * radio.pulse(n as f64 - one.position)).sum();
            [sum.re as f32, sum.im as f32]
        };
        let samples: Vec<[f32; 2]> = (0..400).map(at).collect();
        let frame = Frame::new(&radio, &samples);
        let (components, energies) =
            solve(&frame, &truth.map(|one| one.position)).expect("three paths apart");
        for (one, truth) in components.iter().zip(&truth) {
            assert!((one.amplitude - truth.amplitude).norm() < 5e-3, "{one:?} {truth:?}");
        }
        assert!((energies[2] - truth[2].amplitude.norm_sqr()).abs() < 1e-3);
        assert!(energies[0] < 0.9 * truth[0].amplitude.norm_sqr());
        assert!(solve(&frame, &[100.2, 100.21]).is_none());
    }
}
