//! Paths of a frame without phase: its peaks, strongest first.
//!
//! A sample is a peak if it is not below its neighbours, its energy exceeds kappa times the noise level, and it stands
//! clear of the stronger peaks: more than a pulse duration away, and not in their side lobes.

use super::noise::{NoiseLevel, white_level};
use super::{ChannelEstimator, Path, parabola_vertex};
use crate::reference::real::{Real, abs, larger, sqrt, square};

/// Energy below which, as a share of a stronger peak's, a peak within its pulse is a side lobe.
const SIDE_LOBE: f32 = 0.02;

pub(super) fn estimate<T: Real>(
    estimator: &ChannelEstimator<T>,
    samples: &[T],
    first_sample_delay_s: T,
) -> (Vec<Path<T>>, NoiseLevel<T>) {
    let energies: Vec<T> = samples.iter().map(|sample| square(*sample)).collect();
    let white = white_level(&energies);
    let floor = estimator.threshold * white;
    // Position and energy.
    let mut peaks: Vec<(T, T)> = Vec::new();
    while peaks.len() < estimator.most_paths {
        let mut best: Option<(T, T)> = None;
        for n in 1..samples.len() - 1 {
            let (before, here, after) = (samples[n - 1], samples[n], samples[n + 1]);
            if energies[n] <= floor || here < before || here <= after {
                continue;
            }
            // Order: the first of equals.
            if best.is_some_and(|(_, strongest)| energies[n] <= strongest) {
                continue;
            }
            let position = T::of_count(n) + parabola_vertex(before, here, after);
            if !is_shadowed(estimator, position, energies[n], &peaks) {
                best = Some((position, energies[n]));
            }
        }
        let Some(peak) = best else { break };
        peaks.push(peak);
    }
    let mut paths = Vec::new();
    for (position, energy) in peaks {
        let sinr = larger(energy / white - T::ONE, T::of(1e-3));
        paths.push(estimator.path(position, first_sample_delay_s, [sqrt(energy), T::ZERO], sinr));
    }
    (paths, NoiseLevel::white(white))
}

/// Whether a stronger peak explains one.
fn is_shadowed<T: Real>(estimator: &ChannelEstimator<T>, position: T, energy: T, peaks: &[(T, T)]) -> bool {
    for &(at, stronger) in peaks {
        let distance = abs(position - at);
        let side_lobe = energy < T::of(SIDE_LOBE) * stronger;
        if distance < estimator.table.samples_per_pulse()
            || (distance < estimator.table.support_samples() && side_lobe)
        {
            return true;
        }
    }
    false
}
