//! What the paths of an estimate leave of their frame: z = |r|^2 / lambda in sixteenths, at 1, 2 or 4 points per sample, so that
//! there are three and a half per pulse or more.
//!
//! Of complex samples the paths are taken off, and the rest is interpolated; magnitudes are interpolated, and the energy of the
//! paths is added to lambda. Nothing is kept within 0.6 pulses of a path.

use super::{ChannelEstimate, ChannelEstimator, power};
use crate::reference::real::{Real, floor, larger, smaller, speed_of_light, square};
use cogmint_core::model::observation::Samples;
use cogmint_core::perceptor::channel_estimator::noise::{
    COMPLEX_CUT, LENGTH_DECAYS, MAGNITUDE_CUT, MOST_OWN,
};
use cogmint_core::perceptor::channel_estimator::residual::{FINEST, MOST, POINTS_PER_PULSE, STEPS};
use cogmint_core::radio::pulse::MERGED;

/// What is left of a frame.
#[derive(Clone, Debug)]
pub struct Residual<T> {
    first_m: T,
    points_per_m: T,
    /// Sixteenths of the level; nothing near the paths.
    pub energies: Vec<Option<u8>>,
}

impl<T: Real> Residual<T> {
    /// The energy for a path of this length: between two points by the line through them, rounded.
    pub fn energy(&self, range_m: T) -> Option<u8> {
        let place = (range_m - self.first_m) * self.points_per_m;
        if place < T::ZERO {
            return None;
        }
        let before = place.whole() as usize;
        let pair = self.energies.get(before..before + 2)?;
        let (low, high) = (T::of_count(usize::from(pair[0]?)), T::of_count(usize::from(pair[1]?)));
        let share = place - T::of_count(before);
        Some((low + share * (high - low) + T::of(0.5)).whole() as u8)
    }
}

impl<T: Real> ChannelEstimator<T> {
    /// What an estimate leaves of its frame, up to paths of this length.
    pub fn residual(
        &self,
        samples: Samples<'_>,
        first_sample_delay_s: T,
        estimate: &ChannelEstimate<T>,
        longest_m: T,
    ) -> Residual<T> {
        let per_pulse = self.table.samples_per_pulse();
        let mut points = 1;
        while points < FINEST && per_pulse * T::of_count(points) < T::of(POINTS_PER_PULSE) {
            points *= 2;
        }
        let first_m = first_sample_delay_s * speed_of_light();
        let points_per_m = T::of_count(points) / (self.sample_spacing_s * speed_of_light());
        let paths: Vec<(T, [T; 2])> = estimate
            .paths
            .iter()
            .map(|path| ((path.delay_s - first_sample_delay_s) / self.sample_spacing_s, path.amplitude))
            .collect();
        let (mut rest, is_complex): (Vec<[T; 2]>, bool) = match samples {
            Samples::Complex(all) => (all.iter().map(|sample| sample.map(T::of)).collect(), true),
            Samples::Magnitude(all) => (all.iter().map(|value| [T::of(*value), T::ZERO]).collect(), false),
        };
        if is_complex {
            for (n, value) in rest.iter_mut().enumerate() {
                for (position, amplitude) in &paths {
                    let r = self.table.at(T::of_count(n) - *position);
                    value[0] -= amplitude[0] * r;
                    value[1] -= amplitude[1] * r;
                }
            }
        }
        let levels = estimate.noise.at_samples(rest.len() + 1);
        // One of as many samples as a profile is long.
        let length_s = T::of(LENGTH_DECAYS) * self.profile[0];
        let by = if is_complex { &COMPLEX_CUT } else { &MAGNITUDE_CUT };
        let own = smaller(self.pulse.effective_duration_s() / length_s * T::of(by.own[0]), T::of(MOST_OWN));
        let mut energies = Vec::new();
        let share = T::ONE / T::of_count(points);
        for n in 0..rest.len() {
            for k in 0..points {
                let past = T::of_count(k) * share;
                let position = T::of_count(n) + past;
                let value = match k {
                    0 => rest[n],
                    half if 2 * half == points => self.interpolation.midway(&rest, n),
                    _ => self.interpolation.at(&rest, position),
                };
                let mut level = levels[n] + past * (levels[n + 1] - levels[n]);
                let energy = if is_complex {
                    power(value) / level
                } else {
                    let mut taken = T::ZERO;
                    for (own, amplitude) in &paths {
                        taken += power(*amplitude) * square(self.table.at(position - *own));
                    }
                    level += taken;
                    square(larger(value[0], T::ZERO)) / level
                };
                // Less what the point itself has lifted the level by.
                let cut = smaller(energy, T::of(by.levels)) * T::of(by.own[1]);
                energies.push(Some(sixteenths(energy * (T::ONE - own) / (T::ONE - own * cut))));
            }
        }
        // As far as the longest path, and one point more to interpolate to.
        let reach = (longest_m - first_m) * points_per_m;
        let wanted = larger(floor(reach) + T::of(2.0), T::ZERO);
        energies.truncate(wanted.whole() as usize);
        let mask = T::of(MERGED) * per_pulse;
        for (index, energy) in energies.iter_mut().enumerate() {
            let place = T::of_count(index);
            // Order: the bounds are points.
            let is_near = |(position, _): &(T, [T; 2])| {
                place > (*position - mask) * T::of_count(points)
                    && place <= (*position + mask) * T::of_count(points)
            };
            if paths.iter().any(is_near) {
                *energy = None;
            }
        }
        Residual { first_m, points_per_m, energies }
    }
}

/// Rounded, and no more than is kept.
fn sixteenths<T: Real>(energy: T) -> u8 {
    let steps = T::of(STEPS) * energy + T::of(0.5);
    if steps < T::of_count(usize::from(MOST)) { steps.whole() as u8 } else { MOST }
}
