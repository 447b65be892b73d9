//! First-path detection: where a response begins, for ranging.
//!
//! The earliest path of a sparse estimate is a poor range: the pulse of a real radio is known roughly, so strong paths
//! leave false ones around them, before as well as behind; and where a response begins in dense multipath, its weak
//! first path is taken for that. The leading edge needs neither a model of what comes after it nor the pulse's exact
//! shape:
//!
//! 1. From the strongest sample, jump back by three decay times of dense multipath and search forward (Guvenc and
//!    Sahinoglu 2005). A path counts that exceeds both kappa times the noise ahead of the search, and the loudest
//!    sample there by 6 dB: radios have a floor of their own, some 30 dB below the strongest path, that is no Gaussian
//!    noise, but that is the same wherever there is no path.
//! 2. What a side lobe of something stronger behind it and noise can be together, by the pulse's autocorrelation, is
//!    none.
//! 3. The delay is that at which the response reaches a share of its first maximum's magnitude, and from there the pulse's
//!    own time to its maximum. The share is half in complex responses: the upper half of the rise is where a second path
//!    would already be seen. In magnitudes it is as little as stands out of the noise: there a second path within the
//!    pulse always adds to the maximum, which says less of the first one the higher it is.
//!
//! The response is first limited to the pulse's band: beyond it there is noise, and the distortion of a receiver that
//! strong paths drive to its limits.

use super::beginning::SEARCH_S;
use super::interpolation::{BEFORE, TAPS};
use super::noise::white_level;
use super::{Pulse, detection_threshold};
use crate::model::observation::{Complex, Samples};
use crate::radio::pulse::PulseTable;
use crate::real::{SPEED_OF_LIGHT_M_S, larger, limited, sin, sqrt};

/// Guard: against the radio's own floor: the noise ahead is taken from this many times as much before the search, so many
/// times more often has that floor had the chance to be as loud there as where it is mistaken for a path.
const AHEAD_SEARCHES: usize = 4;
/// Guard: against a level from too few samples ahead.
const FEWEST_AHEAD: u32 = 8;
/// Guard: against the radio's own floor: a path exceeds the loudest sample ahead by this energy ratio (6 dB).
const OVER_LOUDEST: f32 = 4.0;
/// Guard: against side lobes of a pulse known roughly: what is below this many times their magnitude (3 dB) may be one.
const SIDE_LOBE_MARGIN: f32 = 1.414;
/// Mathematics: half.
const HALF: f32 = 0.5;
/// Guard: against an edge among the pulse's own side lobes: least share of the maximum that it is taken at.
const LEAST_EDGE: f32 = 0.05;
/// Mathematics: positions per sample, at each of which the band limit has weights of its own.
const PHASES: usize = 8;

/// The first path of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct FirstPath {
    /// Propagation delay, seconds.
    pub delay_s: f32,
    /// Magnitude at the response's first maximum, in the unit of the samples.
    pub magnitude: f32,
    /// Its energy over that of the noise ahead of it.
    pub snr: f32,
    /// Variance that this noise gives the delay, square seconds. What a second path within the rise does to it is not
    /// in it.
    pub delay_variance_s2: f32,
}

impl FirstPath {
    /// Distance travelled, metres.
    pub fn range_m(&self) -> f32 {
        self.delay_s * SPEED_OF_LIGHT_M_S
    }
}

/// A detector for frames of one pulse and sample spacing.
#[derive(Clone, Debug)]
pub struct FirstPathDetector {
    table: PulseTable,
    /// Weights of the band limit at each position between two samples.
    kernels: [[f32; TAPS]; PHASES],
    /// kappa.
    threshold: f32,
    /// Samples searched before the strongest one.
    search: usize,
    /// Magnitude that no side lobe beyond the pulse's table exceeds: the largest of its last pulse duration.
    furthest_lobe: f32,
    sample_spacing_s: f32,
}

impl FirstPathDetector {
    /// A detector for frames whose samples are `sample_spacing_s` seconds apart, that finds `false_paths` paths (1e-4
    /// to 10) per search where there is only noise.
    pub fn new(pulse: &Pulse, sample_spacing_s: f32, false_paths: f32) -> Self {
        let sample_spacing_s = limited(sample_spacing_s, 1e-12, 1e-6);
        let pulse = &Pulse { duration_s: limited(pulse.duration_s, 1e-11, 2e-8), ..*pulse };
        let false_paths = limited(false_paths, 1e-4, 10.0);
        // Cycles per sample at the edge of the pulse's band; at most all that the samples hold.
        let band = pulse.half_band_hz() * sample_spacing_s;
        let mut detector = Self {
            table: PulseTable::new(pulse, sample_spacing_s),
            kernels: kernels(if band < 0.5 { band } else { 0.5 }),
            threshold: detection_threshold(pulse.rms_bandwidth_hz() * SEARCH_S, false_paths),
            search: (SEARCH_S / sample_spacing_s) as usize + 1,
            furthest_lobe: 0.0,
            sample_spacing_s,
        };
        detector.furthest_lobe = detector.largest_last_lobe();
        detector
    }

    /// The first path of a frame whose first sample stands for a delay of `first_sample_delay_s`; none where nothing
    /// stands out of the noise. The samples must be finite.
    pub fn detect(&self, samples: Samples<'_>, first_sample_delay_s: f32) -> Option<FirstPath> {
        let white = match samples {
            Samples::Complex(samples) => {
                white_level(|| samples.iter().map(|[re, im]| re * re + im * im), samples.len())
            }
            Samples::Magnitude(samples) => white_level(|| samples.iter().map(|m| m * m), samples.len()),
        };
        let is_magnitude = matches!(samples, Samples::Magnitude(_));
        let mut strongest = (0_usize, 0.0_f32);
        for n in 0..samples.len() {
            let power = power_of(samples, n);
            if power > strongest.1 {
                strongest = (n, power);
            }
        }
        let start = strongest.0.saturating_sub(self.search);
        let (level, loudest) = noise_ahead(samples, start, self.search * AHEAD_SEARCHES, white);
        let lobe = SIDE_LOBE_MARGIN * self.furthest_lobe;
        let noise = self.threshold * level;
        let threshold = larger(noise, OVER_LOUDEST * loudest);
        let threshold = larger(threshold, lobe * lobe * strongest.1);
        let magnitude = |step: usize| self.band_limited(step as i32, |n| sample_of(samples, n));
        let from = start * PHASES;
        let mut before = 0.0;
        let mut here = magnitude(from);
        for step in from..(strongest.0 + 1) * PHASES {
            let after = magnitude(step + 1);
            let is_path = here * here > threshold
                && here >= before
                && here > after
                && !self.is_side_lobe(samples, step as f32 / PHASES as f32, here - sqrt(noise));
            // Where there is no rise, the frame began too late to show it.
            let edge = || if is_magnitude { limited(sqrt(threshold) / here, LEAST_EDGE, HALF) } else { HALF };
            let edge = is_path.then(edge);
            let rise = edge.and_then(|edge| Some((edge, rise_to(edge, magnitude, from, step)?)));
            if let Some((edge, Rise { position, slope })) = rise {
                let deviation_s = self.sample_spacing_s / slope;
                return Some(FirstPath {
                    delay_s: first_sample_delay_s + (position + self.rise_from(edge)) * self.sample_spacing_s,
                    magnitude: here,
                    snr: here * here / level,
                    delay_variance_s2: 0.5 * level * (deviation_s * deviation_s),
                });
            }
            (before, here) = (here, after);
        }
        None
    }

    /// Magnitude of the band-limited response `step` eighths of a sample after sample 0 of `sample`.
    fn band_limited(&self, step: i32, sample: impl Fn(i32) -> Complex) -> f32 {
        let phases = PHASES as i32;
        let Some(kernel) = self.kernels.get(step.rem_euclid(phases) as usize) else { return 0.0 };
        let first = step.div_euclid(phases) - BEFORE as i32;
        let (mut re, mut im) = (0.0, 0.0);
        for (n, weight) in (first..).zip(kernel) {
            let [sample_re, sample_im] = sample(n);
            re += weight * sample_re;
            im += weight * sample_im;
        }
        sqrt(re * re + im * im)
    }

    /// Whether `excess`, a maximum's magnitude less what noise can add to it, may be a side lobe of what comes up to the
    /// pulse's support later.
    fn is_side_lobe(&self, samples: Samples<'_>, position: f32, excess: f32) -> bool {
        // From the furthest lag down, in half samples: the side lobes' envelope is the largest seen so far.
        let nearest = 2.0 * self.table.samples_per_pulse();
        let mut half_lag = (2.0 * self.table.support_samples()) as usize;
        let mut envelope = 0.0;
        while half_lag as f32 > nearest {
            envelope = larger(envelope, self.pulse(half_lag * (PHASES / 2)));
            let later = (position + 0.5 * half_lag as f32 + 0.5) as usize;
            if excess < SIDE_LOBE_MARGIN * envelope * sqrt(power_of(samples, later)) {
                return true;
            }
            half_lag -= 1;
        }
        false
    }

    /// Magnitude of the band-limited pulse itself, `step` eighths of a sample from its maximum.
    fn pulse(&self, step: usize) -> f32 {
        self.band_limited(step as i32, |n| [self.table.at(n as f32), 0.0])
    }

    /// From a share of its magnitude to the maximum of the pulse, samples: measured on the pulse as on a response.
    fn rise_from(&self, share: f32) -> f32 {
        let steps = (self.table.support_samples() as usize + 1) * PHASES;
        let rise = rise_to(share, |step| self.pulse(steps - step.min(steps)), 0, steps);
        rise.map_or(0.0, |rise| steps as f32 / PHASES as f32 - rise.position)
    }

    /// The largest side lobe in the last pulse duration of the pulse's support.
    fn largest_last_lobe(&self) -> f32 {
        let end = self.table.support_samples();
        let first = ((end - self.table.samples_per_pulse()) * PHASES as f32) as usize;
        let mut largest = 0.0;
        for step in first..(end * PHASES as f32) as usize {
            largest = larger(largest, self.pulse(step));
        }
        largest
    }
}

/// A crossing of a share of a maximum's magnitude.
struct Rise {
    /// Where, samples into the frame.
    position: f32,
    /// The magnitude's slope there, per sample.
    slope: f32,
}

/// The last step before `maximum`, but not before `from`, at which `share` of the magnitude of `maximum` is exceeded.
fn rise_to(share: f32, magnitude: impl Fn(usize) -> f32, from: usize, maximum: usize) -> Option<Rise> {
    let mut above = magnitude(maximum);
    let edge = share * above;
    for step in (from..maximum).rev() {
        let below = magnitude(step);
        if below < edge {
            let slope = above - below;
            let position = (step as f32 + (edge - below) / slope) / PHASES as f32;
            return Some(Rise { position, slope: slope * PHASES as f32 });
        }
        above = below;
    }
    None
}

/// Mean energy and largest energy of up to `count` samples before `start`; `white` and zero where there are too few.
fn noise_ahead(samples: Samples<'_>, start: usize, count: usize, white: f32) -> (f32, f32) {
    let (mut sum, mut loudest, mut seen) = (0.0, 0.0, 0_u32);
    for n in start.saturating_sub(count)..start {
        let power = power_of(samples, n);
        sum += power;
        loudest = larger(loudest, power);
        seen += 1;
    }
    if seen < FEWEST_AHEAD { (white, 0.0) } else { (larger(sum / seen as f32, white), loudest) }
}

/// Energy of sample `n`; zero beyond the frame.
fn power_of(samples: Samples<'_>, n: usize) -> f32 {
    let [re, im] = sample_of(samples, n as i32);
    re * re + im * im
}

/// Sample `n`; zero beyond the frame. Magnitudes are taken as they are: the phase of one path does not change over its
/// rise.
fn sample_of(samples: Samples<'_>, n: i32) -> Complex {
    let Ok(n) = usize::try_from(n) else { return [0.0, 0.0] };
    match samples {
        Samples::Complex(samples) => samples.get(n).copied().unwrap_or([0.0, 0.0]),
        Samples::Magnitude(samples) => samples.get(n).map_or([0.0, 0.0], |&magnitude| [magnitude, 0.0]),
    }
}

/// A sinc that ends at `band` cycles per sample, under the window (1 - (d/8)^2)^2; each phase's weights sum to one.
fn kernels(band: f32) -> [[f32; TAPS]; PHASES] {
    let mut kernels = [[0.0; TAPS]; PHASES];
    for (phase, kernel) in kernels.iter_mut().enumerate() {
        let fraction = phase as f32 / PHASES as f32;
        let mut sum = 0.0;
        for (tap, weight) in kernel.iter_mut().enumerate() {
            let distance = fraction + BEFORE as f32 - tap as f32;
            let reach = distance / (TAPS / 2) as f32;
            let taper = 1.0 - reach * reach;
            let angle = 2.0 * core::f32::consts::PI * band * distance;
            let sinc = if distance == 0.0 { 1.0 } else { sin(angle) / angle };
            *weight = sinc * (taper * taper);
            sum += *weight;
        }
        for weight in kernel {
            *weight /= sum;
        }
    }
    kernels
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::radio::pulse::PulseShape;
    use rand_core::{Rng, SeedableRng};
    use rand_xoshiro::Xoshiro128PlusPlus;
    use std::vec::Vec;

    const SPACING_S: f32 = 1.0016e-9;
    const PULSE: Pulse = Pulse { duration_s: 2e-9, shape: PulseShape::RootRaisedCosine { roll_off: 0.5 } };

    /// A normal deviate: the sum of twelve uniform ones, shifted.
    fn normal(rng: &mut Xoshiro128PlusPlus) -> f32 {
        (0..12).map(|_| rng.next_u32() as f32 / 4_294_967_296.0).sum::<f32>() - 6.0
    }

    /// Unit noise and paths of (position, magnitude, phase), by the closed form of the pulse.
    fn frame(rng: &mut Xoshiro128PlusPlus, paths: &[(f32, f32, f32)]) -> Vec<[f32; 2]> {
        let half = 0.5f32.sqrt();
        (0..1016)
            .map(|n| {
                let mut sample = [half * normal(rng), half * normal(rng)];
                for (position, magnitude, phase) in paths {
                    let pulse = PULSE.autocorrelation((n as f32 - position) * SPACING_S / PULSE.duration_s);
                    sample[0] += magnitude * pulse * phase.cos();
                    sample[1] += magnitude * pulse * phase.sin();
                }
                sample
            })
            .collect()
    }

    fn positions(
        paths: impl Fn(f32) -> Vec<(f32, f32, f32)>,
        trials: usize,
    ) -> Vec<Option<(f32, FirstPath)>> {
        let detector = FirstPathDetector::new(&PULSE, SPACING_S, 0.01);
        let mut rng = Xoshiro128PlusPlus::seed_from_u64(6);
        (0..trials)
            .map(|_| {
                let at = 700.0 + rng.next_u32() as f32 / 4_294_967_296.0;
                let samples = frame(&mut rng, &paths(at));
                let found = detector.detect(Samples::Complex(&samples), 0.0)?;
                Some((found.delay_s / SPACING_S - at, found))
            })
            .collect()
    }

    #[test]
    fn a_single_path_is_found_without_bias_and_as_precisely_as_stated() {
        for magnitude in [10.0, 100.0] {
            let found = positions(|at| std::vec![(at, magnitude, 1.0)], 400);
            let errors: Vec<f32> = found.iter().map(|found| found.unwrap().0).collect();
            let mean = errors.iter().sum::<f32>() / 400.0;
            let deviation = (errors.iter().map(|e| (e - mean) * (e - mean)).sum::<f32>() / 400.0).sqrt();
            let stated = found.iter().map(|found| found.unwrap().1.delay_variance_s2).sum::<f32>() / 400.0;
            let stated = stated.sqrt() / SPACING_S;
            assert!(mean.abs() < 0.02, "{magnitude}: {mean}");
            assert!((0.6..1.6).contains(&(deviation / stated)), "{magnitude}: {deviation} beside {stated}");
        }
    }

    #[test]
    fn a_weak_first_path_is_found_ahead_of_a_strong_one() {
        // 20 dB weaker, 10 and 50 samples ahead: nothing that a side lobe could be.
        for ahead in [10.0, 50.0] {
            let found = positions(|at| std::vec![(at, 20.0, 0.3), (at + ahead, 200.0, 2.0)], 100);
            let near = found.iter().filter(|found| found.is_some_and(|(error, _)| error.abs() < 0.2)).count();
            assert!(near >= 98, "{ahead}: {near}");
        }
    }

    #[test]
    fn side_lobes_and_noise_ahead_are_no_first_path() {
        // 60 dB: side lobes of -18 dB stand 42 dB out of the noise.
        let found = positions(|at| std::vec![(at, 1000.0, 0.0)], 300);
        let errors: Vec<f32> = found.iter().map(|found| found.expect("is found").0).collect();
        let worst = errors.iter().fold(0.0f32, |worst, error| worst.max(error.abs()));
        assert!(worst < 0.05, "{worst}");
        // The rate is per search of noise; a frame of noise alone has its strongest sample anywhere.
        let noise = positions(|_| Vec::new(), 1000);
        let detections = noise.iter().flatten().count();
        assert!(detections < 40, "{detections} of 1000");
    }

    #[test]
    fn a_floor_of_the_radio_is_no_first_path() {
        // Every tenth sample stands 15 dB out of the noise, before as after.
        let detector = FirstPathDetector::new(&PULSE, SPACING_S, 0.01);
        let mut rng = Xoshiro128PlusPlus::seed_from_u64(7);
        for _ in 0..100 {
            let mut samples = frame(&mut rng, &[(700.3, 200.0, 0.0)]);
            for (n, sample) in samples.iter_mut().enumerate() {
                if n % 10 == 0 {
                    sample[0] += 5.6;
                }
            }
            let found = detector.detect(Samples::Complex(&samples), 0.0).expect("is found");
            assert!((found.delay_s / SPACING_S - 700.3).abs() < 0.1, "{}", found.delay_s / SPACING_S);
        }
    }

    #[test]
    fn any_pulse_and_spacing_and_any_frame_are_taken() {
        for (duration_s, spacing_s) in [(1e-10, 1e-8), (1e-8, 1e-11), (0.5e-9, 0.25e-9)] {
            let pulse = Pulse::root_raised_cosine(duration_s, 1.0);
            let detector = FirstPathDetector::new(&pulse, spacing_s, 0.1);
            for length in [0, 1, 2, 16] {
                let ones = [[1.0, 0.0]; 16];
                let frame = &ones[..length];
                let _ = detector.detect(Samples::Complex(frame), -1.0);
                let zeros = [0.0; 16];
                assert_eq!(detector.detect(Samples::Magnitude(&zeros[..length]), 0.0), None);
            }
        }
    }
}
