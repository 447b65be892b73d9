//! Magnitude-only mode, for radios that log no phase.
//!
//! Stated model: |y(t)| is, around each path, the magnitude of one pulse in white noise; paths are at least
//! one pulse duration apart. Where pulses overlap, their unknown phases make the sum of magnitudes
//! meaningless, so no superposition is resolved: each local maximum of |y|^2 whose energy over the noise level
//! exceeds kappa, and which is not a side lobe of a stronger one, is one path. Sub-sample delays come from the
//! parabola through the maximum and its neighbours.

use super::noise::{NoiseLevel, white_level};
use super::{ChannelEstimate, ChannelEstimator};
use crate::real::{abs, larger, sqrt};
use heapless::Vec;

/// A maximum this far (as an energy ratio) below a stronger one within the pulse's support is its side lobe: the
/// raised-cosine pulses in use have side lobes of at most -17 dB.
const SIDE_LOBE: f32 = 0.02;

impl<const PATHS: usize> ChannelEstimator<PATHS> {
    pub(super) fn estimate_magnitude(
        &self,
        samples: &[f32],
        first_sample_delay_s: f32,
    ) -> ChannelEstimate<PATHS> {
        let white = white_level(|| samples.iter().map(|m| m * m), samples.len());
        // (position, energy, SINR), strongest first.
        let mut peaks: Vec<(f32, f32, f32), PATHS> = Vec::new();
        let floor = self.known_threshold * white;
        // Each pass takes the strongest maximum not yet taken or shadowed.
        for _ in 0..PATHS {
            let mut best: Option<(f32, f32)> = None;
            for (n, window) in samples.windows(3).enumerate() {
                let &[before, here, after] = window else { continue };
                let energy = here * here;
                if energy <= floor || here < before || here <= after {
                    continue;
                }
                if best.is_some_and(|(_, strongest)| energy <= strongest) {
                    continue;
                }
                let position = n as f32 + 1.0 + parabola_vertex(before, here, after);
                let shadowed = peaks.iter().any(|&(at, stronger, _)| {
                    let distance = abs(position - at);
                    distance < self.table.samples_per_pulse()
                        || (distance < self.table.support_samples() && energy < SIDE_LOBE * stronger)
                });
                if !shadowed {
                    best = Some((position, energy));
                }
            }
            let Some((position, energy)) = best else { break };
            let sinr = larger(energy / white - 1.0, 1e-3);
            if peaks.push((position, energy, sinr)).is_err() {
                break;
            }
        }
        let mut estimate = self.without_paths(NoiseLevel::white(white));
        for &(position, energy, sinr) in &peaks {
            // Capacities are equal: every push succeeds.
            let _ = estimate.paths.push(self.path(position, first_sample_delay_s, [sqrt(energy), 0.0], sinr));
        }
        estimate
    }
}

/// Offset of the vertex of the parabola through three equidistant values whose middle one is the largest;
/// within -0.5 to 0.5.
pub(super) fn parabola_vertex(before: f32, here: f32, after: f32) -> f32 {
    let curvature = before - 2.0 * here + after;
    if curvature < 0.0 { 0.5 * (before - after) / curvature } else { 0.0 }
}
