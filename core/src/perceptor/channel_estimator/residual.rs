//! Residual: what the paths of an estimate leave of their frame, over the level of noise and dense multipath.
//!
//! On a grid of about T_p / 4, z = |r|^2 / lambda with r the matched filter's output less the paths. Where there is noise alone, z is
//! exponentially distributed with mean 1; a path of SINR s that was not found makes its mean 1 + s. Magnitudes do not add up: there
//! nothing is subtracted, and the energy of the paths found counts as noise. Around a path found, the rest says more of how well it
//! was fitted than of others, and is masked.
//!
//! The level under a point was fitted to n independent samples, of which one is its own: it was lifted by (min(z, c) / k - 1) / (f n), as
//! the fit cuts powers off at c levels, gives back what noise loses by that, 1 - k, and so follows a change of all of them by f of it.
//! That is taken back ([`super::noise::Cut`]).
//!
//! A byte per point: z in sixteenths.

use super::interpolation::{Kernel, TAPS};
use super::noise::{LevelSteps, LevelWalk};
use super::{ChannelEstimate, ChannelEstimator, cut_of};
use crate::model::observation::{Complex, Samples};
use crate::radio::pulse::MERGED;
use crate::real::{SPEED_OF_LIGHT_M_S, floor, larger, smaller};
use crate::snapshot::stored;
use heapless::Vec;

/// Mathematics: grid of the energies kept: steps per level.
pub const STEPS: f32 = 16.0;
/// Mathematics: the most that is kept of an energy, in steps.
pub const MOST: u8 = 254;
/// Mathematics: what stands for a point where nothing is known.
const MASKED: u8 = 255;
/// Mathematics: points per pulse duration, at least, as far as [`FINEST`] allows: |r|^2 has twice the bandwidth of r.
pub const POINTS_PER_PULSE: f32 = 3.5;
/// Capacity: points per sample, which bound time.
pub const FINEST: usize = 4;
/// Capacity: samples that are worked on at once, which bounds the scratch memory.
const CHUNK: usize = 32;
/// Capacity: those, and what reaches them.
const WINDOW: usize = CHUNK + TAPS - 1;
/// Mathematics: taps up to the sample at hand.
const BEFORE: usize = TAPS / 2 - 1;

/// What is left of a frame.
#[derive(Clone, Debug)]
pub struct Residual<const POINTS: usize> {
    /// Length of a path at the first point, metres.
    first_m: f32,
    points_per_m: f32,
    energies: Vec<u8, POINTS>,
}

impl<const POINTS: usize> Default for Residual<POINTS> {
    fn default() -> Self {
        Self::empty()
    }
}

impl<const POINTS: usize> Residual<POINTS> {
    /// Of no frame.
    pub const fn empty() -> Self {
        Self { first_m: 0.0, points_per_m: 0.0, energies: Vec::new() }
    }

    /// Of no frame any more.
    pub fn clear(&mut self) {
        (self.first_m, self.points_per_m) = (0.0, 0.0);
        self.energies.clear();
    }

    /// Energy over the level where a path of this length arrives, in sixteenths and not more than [`MOST`]; `None` where nothing is
    /// known: beyond the frame or what is kept of it, and around the paths that were found.
    pub fn energy(&self, range_m: f32) -> Option<u8> {
        let place = (range_m - self.first_m) * self.points_per_m;
        // Also where no frame was: 0 points per metre, and no points.
        if !(place >= 0.0 && place < POINTS as f32) {
            return None;
        }
        // Not negative, so truncation is the floor.
        let base = place as usize;
        let share = place - base as f32;
        let (low, high) = (*self.energies.get(base)?, *self.energies.get(base + 1)?);
        if low == MASKED || high == MASKED {
            return None;
        }
        let (low, high) = (f32::from(low), f32::from(high));
        Some((low + share * (high - low) + 0.5) as u8)
    }

    /// All of it, for traces.
    pub fn energies(&self) -> &[u8] {
        &self.energies
    }
}

/// A path taken off: its delay, samples into the frame, and its amplitude.
type Taken = (f32, Complex);

impl<const PATHS: usize> ChannelEstimator<PATHS> {
    /// Keeps what the paths of an estimate leave of its frame, up to paths of this length.
    #[inline(never)]
    pub fn leave<const POINTS: usize>(
        &self,
        samples: Samples<'_>,
        first_sample_delay_s: f32,
        estimate: &ChannelEstimate<PATHS>,
        longest_m: f32,
        residual: &mut Residual<POINTS>,
    ) {
        let spacing_s = self.sample_spacing_s;
        let points = self.points_per_sample();
        residual.first_m = first_sample_delay_s * SPEED_OF_LIGHT_M_S;
        residual.points_per_m = points as f32 / (spacing_s * SPEED_OF_LIGHT_M_S);
        residual.energies.clear();
        let mut taken: Vec<Taken, PATHS> = Vec::new();
        for path in &estimate.paths {
            // Capacities are equal: every push succeeds.
            let _ = taken.push(((path.delay_s - first_sample_delay_s) / spacing_s, path.amplitude));
        }
        let share = 1.0 / points as f32;
        let kernels: [Kernel; FINEST] = core::array::from_fn(|k| self.interpolation.kernel(k as f32 * share));
        let reach = (longest_m - residual.first_m) * residual.points_per_m;
        let wanted = larger(smaller(floor(reach) + 2.0, POINTS as f32), 0.0) as usize;
        let wanted = wanted.min(points * samples.len());
        let steps = LevelSteps::new(self.profile, spacing_s, samples.len(), 0);
        let mut levels = LevelWalk::new(&estimate.noise, &steps);
        let mut level = levels.next();
        // Share of a point in the level under it.
        let own = self.pulse.effective_duration_s() / self.profile.length_s();
        let cut = cut_of(&samples);
        let mut window = [[0.0; 2]; WINDOW];
        self.rest(samples, &taken, 0, window.get_mut(BEFORE..TAPS - 1).unwrap_or(&mut []));
        let support = self.table.support_samples();
        let mut from = 0;
        while residual.energies.len() < wanted {
            // The paths whose pulses reach these samples: of the others there is nothing here.
            let mut reaching: Vec<Taken, PATHS> = Vec::new();
            for path in &taken {
                let past = path.0 - from as f32;
                if past > -support && past < CHUNK as f32 + support {
                    // As many as paths at most: the push succeeds.
                    let _ = reaching.push(*path);
                }
            }
            self.rest(samples, &taken, from + TAPS / 2, window.get_mut(TAPS - 1..).unwrap_or(&mut []));
            for (n, taps) in (from..).zip(window.windows(TAPS)) {
                let next = levels.next();
                for (k, kernel) in kernels.iter().enumerate().take(points) {
                    let past = k as f32 * share;
                    let noise = level + past * (next - level);
                    let energy = match samples {
                        Samples::Complex(_) => power(&weighted(taps, kernel, k, points)) / noise,
                        Samples::Magnitude(_) => {
                            let [magnitude, _] = weighted(taps, kernel, k, points);
                            let magnitude = larger(magnitude, 0.0);
                            magnitude * magnitude / (noise + self.taken_energy(&reaching, n as f32 + past))
                        }
                    };
                    if residual.energies.len() < wanted {
                        // As much as is wanted has room: the push succeeds.
                        let _ = residual.energies.push(steps_of(cut.without_own(energy, own)));
                    }
                }
                level = next;
            }
            window.copy_within(CHUNK.., 0);
            from += CHUNK;
        }
        // Nobody else is found there.
        let mask = MERGED * self.table.samples_per_pulse();
        for (position, _) in &taken {
            let first = after((position - mask) * points as f32);
            let end = after((position + mask) * points as f32);
            for energy in residual.energies.iter_mut().take(end).skip(first) {
                *energy = MASKED;
            }
        }
    }

    /// Points per sample: 1, 2 or 4.
    fn points_per_sample(&self) -> usize {
        let mut points = 1;
        while points < FINEST && self.table.samples_per_pulse() * (points as f32) < POINTS_PER_PULSE {
            points += points;
        }
        points
    }

    /// The samples from number `first` on, less the paths taken off complex ones; zero beyond the frame.
    fn rest(&self, samples: Samples<'_>, taken: &[Taken], first: usize, rest: &mut [Complex]) {
        let all = match samples {
            Samples::Magnitude(samples) => {
                for (value, n) in rest.iter_mut().zip(first..) {
                    *value = [samples.get(n).copied().unwrap_or(0.0), 0.0];
                }
                return;
            }
            Samples::Complex(samples) => samples,
        };
        for (value, n) in rest.iter_mut().zip(first..) {
            *value = all.get(n).copied().unwrap_or([0.0; 2]);
        }
        // Beyond the frame there is nothing to take off.
        let inside = all.len().saturating_sub(first).min(rest.len());
        let support = self.table.support_samples();
        for (position, [a_re, a_im]) in taken {
            let begin = after(position - support - first as f32);
            for (value, n) in rest.iter_mut().zip(first..).take(inside).skip(begin) {
                let lag = n as f32 - position;
                if lag > support {
                    break;
                }
                let r = self.table.at(lag);
                *value = [value[0] - a_re * r, value[1] - a_im * r];
            }
        }
    }

    /// Energy that the paths have at a position, whatever their phases.
    fn taken_energy(&self, taken: &[Taken], position: f32) -> f32 {
        let mut energy = 0.0;
        for (own, amplitude) in taken {
            let r = self.table.at(position - own);
            energy += power(amplitude) * (r * r);
        }
        energy
    }
}

/// The value of a window of samples at the place of a kernel: that of this `number` of so many `points` from sample to sample.
fn weighted(taps: &[Complex], kernel: &Kernel, number: usize, points: usize) -> Complex {
    match number {
        0 => taps.get(BEFORE).copied().unwrap_or([0.0; 2]),
        half if 2 * half == points => kernel.midway(taps),
        _ => kernel.of(taps),
    }
}

/// The first whole number after a position, not below 0.
fn after(position: f32) -> usize {
    larger(floor(position) + 1.0, 0.0) as usize
}

/// |z|^2.
fn power(z: &Complex) -> f32 {
    let [re, im] = *z;
    re * re + im * im
}

/// An energy in steps; as much as there is where it is no number.
fn steps_of(energy: f32) -> u8 {
    let steps = STEPS * energy + 0.5;
    // Not negative, so truncation is the floor.
    if steps < f32::from(MOST) { steps as u8 } else { MOST }
}

stored!(Residual<const POINTS> { first_m, points_per_m, energies } told {});

#[cfg(test)]
mod tests {
    use super::super::noise::NoiseLevel;
    use super::super::{DenseMultipath, EstimatorSettings, Path};
    use super::*;
    use crate::radio::pulse::{Pulse, PulseTable};
    use std::vec::Vec as StdVec;

    const SPACING_S: f32 = 0.25e-9;
    const SAMPLES: usize = 100;
    const FIRST_S: f32 = 3e-9;

    fn estimator() -> ChannelEstimator<4> {
        let pulse = Pulse::root_raised_cosine(0.5e-9, 0.6);
        ChannelEstimator::new(pulse, SPACING_S, SAMPLES, 0.1, EstimatorSettings::default())
    }

    /// White noise of power 4, and these paths: positions in samples, and amplitudes.
    fn estimate(own: &ChannelEstimator<4>, paths: &[(f32, Complex)]) -> ChannelEstimate<4> {
        let steps = LevelSteps::new(own.profile, SPACING_S, SAMPLES, 0);
        let mut noise = NoiseLevel::open(0.0, &steps);
        noise.white = 4.0;
        let path = |(position, amplitude): &(f32, Complex)| Path {
            delay_s: FIRST_S + position * SPACING_S,
            amplitude: *amplitude,
            sinr: 100.0,
            delay_variance_s2: 0.0,
        };
        ChannelEstimate {
            work: 0,
            cut_short: false,
            paths: paths.iter().map(path).collect(),
            noise,
            dense: DenseMultipath::default(),
            threshold: 9.0,
        }
    }

    fn samples(paths: &[(f32, Complex)]) -> StdVec<Complex> {
        let table = PulseTable::new(&Pulse::root_raised_cosine(0.5e-9, 0.6), SPACING_S);
        let add = |n: usize, sum: Complex, (position, [re, im]): &(f32, Complex)| {
            let r = table.at(n as f32 - position);
            [sum[0] + re * r, sum[1] + im * r]
        };
        (0..SAMPLES).map(|n| paths.iter().fold([0.0; 2], |sum, path| add(n, sum, path))).collect()
    }

    /// An energy in steps, less what the point itself would have lifted the level by.
    fn kept(own: &ChannelEstimator<4>, energy: f32) -> f32 {
        let share = own.pulse.effective_duration_s() / own.profile.length_s();
        16.0 * energy * (1.0 - share) / (1.0 - share * energy.min(5.0))
    }

    fn range_m(position: f32) -> f32 {
        (FIRST_S + position * SPACING_S) * SPEED_OF_LIGHT_M_S
    }

    #[test]
    fn a_path_that_was_not_found_is_left_and_one_that_was_is_not() {
        let own = estimator();
        let (found, missed) = ((30.3, [40.0, -25.0]), (61.75, [0.0, 6.0]));
        for points_found in [&[found][..], &[found, missed][..]] {
            let mut residual = Residual::<200>::default();
            let frame = samples(&[found, missed]);
            let estimate = estimate(&own, points_found);
            own.leave(Samples::Complex(&frame), FIRST_S, &estimate, 50.0, &mut residual);
            assert_eq!(residual.energies().len(), 200);
            // Energy 36 over a level of 4, less what a line between two points loses, and half-way down.
            let there = residual.energy(range_m(missed.0));
            if points_found.len() == 2 {
                assert_eq!(there, None);
            } else {
                let exact = kept(&own, 9.0);
                let found = there.map(f32::from);
                assert!(
                    found.is_some_and(|found| found <= exact && found > 0.9 * exact),
                    "{found:?} {exact}"
                );
                let table = PulseTable::new(&Pulse::root_raised_cosine(0.5e-9, 0.6), SPACING_S);
                let beside = residual.energy(range_m(62.5)).unwrap();
                let r = table.at(0.75);
                assert!((f32::from(beside) - kept(&own, 9.0 * r * r)).abs() < 6.0, "{beside}");
            }
            // Within 0.6 pulses of a path nothing is known, and outside of it nothing is left.
            assert_eq!(residual.energy(range_m(found.0 + 1.1)), None);
            for position in [5.0, 20.0, 28.4, 32.3, 45.2, 90.0] {
                let energy = residual.energy(range_m(position));
                assert!(energy.is_some_and(|energy| energy <= 2), "{position}: {energy:?}");
            }
        }
    }

    #[test]
    fn of_magnitudes_the_paths_found_count_as_noise() {
        let own = estimator();
        let missed = (61.75, [0.0, 6.0]);
        let frame: StdVec<f32> = samples(&[missed]).iter().map(|z| sqrt_of(power(z))).collect();
        let energy = |found: &[(f32, Complex)]| {
            let mut residual = Residual::<200>::default();
            let estimate = estimate(&own, found);
            own.leave(Samples::Magnitude(&frame), FIRST_S, &estimate, 50.0, &mut residual);
            residual.energy(range_m(missed.0)).unwrap()
        };
        assert!((f32::from(energy(&[])) / kept(&own, 9.0) - 0.95).abs() < 0.05, "{}", energy(&[]));
        // A path 1.5 pulses before, of which a part reaches here.
        let near = (58.75, [30.0, 0.0]);
        let table = PulseTable::new(&Pulse::root_raised_cosine(0.5e-9, 0.6), SPACING_S);
        let reaching = 30.0 * table.at(3.0);
        let exact = kept(&own, 36.0 / (4.0 + reaching * reaching));
        assert!((f32::from(energy(&[near])) - exact).abs() < 8.0, "{} {exact}", energy(&[near]));
    }

    fn sqrt_of(x: f32) -> f32 {
        crate::real::sqrt(x)
    }

    #[test]
    fn what_is_not_kept_is_not_known() {
        let own = estimator();
        let frame = samples(&[(20.0, [6.0, 0.0]), (61.0, [6.0, 0.0])]);
        let estimate = estimate(&own, &[]);
        let mut residual = Residual::<64>::default();
        assert_eq!(residual.energy(1.0), None);
        own.leave(Samples::Complex(&frame), FIRST_S, &estimate, 50.0, &mut residual);
        assert!(residual.energy(range_m(20.0)).is_some_and(|energy| energy > 140));
        let beyond = [range_m(-1.0), range_m(61.0), range_m(1e4), -1e9, f32::INFINITY, f32::NAN];
        assert!(beyond.into_iter().all(|range_m| residual.energy(range_m).is_none()));
        // Nor what no path may be as long as.
        let mut residual = Residual::<200>::default();
        own.leave(Samples::Complex(&frame), FIRST_S, &estimate, range_m(40.0), &mut residual);
        assert!(residual.energy(range_m(39.9)).is_some() && residual.energy(range_m(41.0)).is_none());
        let mut residual = Residual::<0>::default();
        own.leave(Samples::Complex(&frame), FIRST_S, &estimate, 50.0, &mut residual);
        assert_eq!(residual.energy(range_m(20.0)), None);
        // Energies beyond what a byte holds stay the largest, and no numbers are no surprise.
        for strong in [1e6, 1e19, f32::INFINITY, f32::NAN] {
            let mut residual = Residual::<200>::default();
            let frame = [[strong, 0.0]; SAMPLES];
            own.leave(Samples::Complex(&frame), FIRST_S, &estimate, 50.0, &mut residual);
            assert_eq!(residual.energy(range_m(50.0)), Some(MOST));
        }
    }
}
