//! Paths of a frame without phase: single pulses fitted to its maxima, the strongest first.
//!
//! With the path's phase taken out, y = a R(t - tau) + noise in its real part, and E[y | m] = m A(2 m a R / lambda) for
//! a magnitude m. Three samples half a pulse apart are fitted by generalised least squares, alternating with this
//! expectation. What counts as noise: lambda, and the energy of the other paths, whose phases are unknown.
//!
//! A path stays where its amplitude less all that the others could add, a - sum a_j |R|, has an energy above
//! kappa lambda.

use super::beginning::{beginning, farther, tail};
use super::noise::{NoiseLevel, level_floor, white_level};
use super::{ChannelEstimator, Cost, Path};
use crate::reference::pulse::PulseTable;
use crate::reference::real::{Real, abs, larger, limited, sqrt, square};
use cogmint_core::perceptor::channel_estimator::SPARE_ROUNDS;
use cogmint_core::perceptor::channel_estimator::magnitude::{
    EXPLAINED, FIRST_REFINEMENTS, OWN_PULSES, PASSES, REFINEMENTS, RIDGE, SCALLOPING, SLOPE_PULSES,
};
use cogmint_core::perceptor::channel_estimator::noise::MAGNITUDE_CUT;
use cogmint_core::perceptor::channel_estimator::work::{FIT, FRAME, LEVEL, MAXIMUM};

#[derive(Clone, Copy, Debug)]
struct Peak<T> {
    sample: usize,
    /// Samples into the frame.
    position: T,
    amplitude: T,
    level: T,
    /// Unexplained energy over the level.
    gain: T,
    /// Its kappa.
    threshold: T,
}

/// What a frame has cost.
struct Work {
    done: u32,
    /// From where on nothing more is begun.
    most: u32,
    cut_short: bool,
}

impl Work {
    /// Whether nothing more may be begun; notes it.
    fn is_used_up(&mut self) -> bool {
        let is_used_up = self.done >= self.most;
        self.cut_short |= is_used_up;
        is_used_up
    }
}

pub(super) fn estimate<T: Real>(
    estimator: &ChannelEstimator<T>,
    samples: &[T],
    first_sample_delay_s: T,
) -> (Vec<Path<T>>, NoiseLevel<T>, T, Cost) {
    let num = T::of;
    let powers: Vec<T> = samples.iter().map(|sample| square(*sample)).collect();
    let mut strongest = T::ZERO;
    for power in &powers {
        strongest = larger(strongest, *power);
    }
    let floor = level_floor(strongest);
    let white = white_level(&powers);
    let mut kappa = estimator.magnitude_threshold;
    let begins = beginning(estimator, &powers, kappa * white);
    let start = begins.filter(|_| estimator.settings.begins_with_path);
    let mut noise = estimator.open_noise(white, samples.len(), start);
    let mut peaks: Vec<Peak<T>> = Vec::new();
    if let Some([n, _]) = start {
        peaks.extend(fit(estimator, samples, &noise, &peaks, None, n));
    }
    let mut work =
        Work { done: FRAME[0] + FRAME[1] * samples.len() as u32, most: u32::MAX, cut_short: false };
    let level_cost = |peaks: &[Peak<T>]| {
        let reached = peaks.len() * estimator.pulse_samples().min(samples.len());
        LEVEL[0] * samples.len() as u32 + LEVEL[1] * reached as u32
    };
    for _ in 0..FIRST_REFINEMENTS {
        work.done += level_cost(&peaks);
        noise.update(&MAGNITUDE_CUT, &beside(estimator, &powers, &peaks), floor);
    }
    // Looking at as many maxima as there can be comes with every frame.
    work.most = work.done + MAXIMUM[0] * (samples.len() / 2) as u32 + estimator.most_work;
    if let Some([_, ahead]) = begins {
        let tail = tail(&powers[..ahead], &noise.at_samples(ahead));
        kappa = farther(kappa, tail);
        for peak in &mut peaks {
            peak.threshold = farther(estimator.beginning_threshold, tail);
        }
    }
    if start.is_some() {
        work.done += refit(estimator, samples, &noise, &mut peaks);
    }
    for round in 0..estimator.most_paths + SPARE_ROUNDS {
        if round > 0 || start.is_some() {
            for _ in 0..REFINEMENTS {
                work.done += level_cost(&peaks);
                noise.update(&MAGNITUDE_CUT, &beside(estimator, &powers, &peaks), floor);
            }
            work.done += refit(estimator, samples, &noise, &mut peaks);
        }
        if work.is_used_up() {
            break;
        }
        let peak = strongest_peak(estimator, samples, &noise, &peaks, kappa, &mut work);
        let Some(peak) = peak else { break };
        if peaks.len() == estimator.most_paths {
            break;
        }
        peaks.push(Peak { threshold: kappa, ..peak });
    }
    let paths = (0..peaks.len()).map(|k| {
        let peak = peaks[k];
        let level = peak.level + overlap(estimator, &peaks, k);
        let sinr = square(peak.amplitude) / level - num(0.5);
        estimator.path(peak.position, first_sample_delay_s, [peak.amplitude, T::ZERO], sinr)
    });
    (paths.collect(), noise, kappa, Cost { work: work.done, cut_short: work.cut_short })
}

/// The powers that tell the level: those in which no path has much energy.
fn beside<T: Real>(estimator: &ChannelEstimator<T>, powers: &[T], peaks: &[Peak<T>]) -> Vec<Option<T>> {
    let mut kept = Vec::new();
    for n in 0..powers.len() {
        let mut explained = false;
        for peak in peaks {
            let share = peak.amplitude * estimator.table.at(T::of_count(n) - peak.position);
            explained |= square(share) > T::of(EXPLAINED) * peak.level;
        }
        kept.push(if explained { None } else { Some(powers[n]) });
    }
    kept
}

fn strongest_peak<T: Real>(
    estimator: &ChannelEstimator<T>,
    samples: &[T],
    noise: &NoiseLevel<T>,
    peaks: &[Peak<T>],
    kappa: T,
    work: &mut Work,
) -> Option<Peak<T>> {
    let num = T::of;
    let beside = |[once, each]: [u32; 2]| once + each * peaks.len() as u32;
    let share = num(SCALLOPING) * square(estimator.table.at(num(0.5)));
    let mut floor = share * kappa;
    let mut best: Option<Peak<T>> = None;
    for n in 1..samples.len() - 1 {
        let at = T::of_count(n);
        if samples[n] < samples[n - 1] || samples[n] <= samples[n + 1] {
            continue;
        }
        if work.is_used_up() {
            break;
        }
        let own_samples = num(OWN_PULSES) * estimator.table.samples_per_pulse();
        let near = |peak: &Peak<T>| abs(at - peak.position) < own_samples;
        if peaks.iter().any(near) {
            continue;
        }
        work.done += beside(MAXIMUM);
        let energy = square(unexplained(estimator, peaks, None, at, samples[n]));
        if energy <= floor * noise.white || energy <= floor * noise.at(at, estimator.sample_spacing_s) {
            continue;
        }
        work.done += beside(FIT);
        let Some(peak) = fit(estimator, samples, noise, peaks, None, n) else { continue };
        // Order: the first of equals.
        if peak.gain > kappa && best.is_none_or(|best| peak.gain > best.gain) {
            floor = share * peak.gain;
            best = Some(peak);
        }
    }
    best
}

/// A magnitude less what all peaks but one may have added.
fn unexplained<T: Real>(
    estimator: &ChannelEstimator<T>,
    peaks: &[Peak<T>],
    own: Option<usize>,
    position: T,
    magnitude: T,
) -> T {
    let mut left = magnitude;
    for k in 0..peaks.len() {
        if own != Some(k) {
            left -= peaks[k].amplitude * abs(estimator.table.at(position - peaks[k].position));
        }
    }
    larger(left, T::ZERO)
}

/// Every peak anew; without the weakest that fell to kappa.
fn refit<T: Real>(
    estimator: &ChannelEstimator<T>,
    samples: &[T],
    noise: &NoiseLevel<T>,
    peaks: &mut Vec<Peak<T>>,
) -> u32 {
    let cost = peaks.len() as u32 * (FIT[0] + FIT[1] * peaks.len() as u32);
    for k in 0..peaks.len() {
        if let Some(peak) = fit(estimator, samples, noise, peaks, Some(k), peaks[k].sample) {
            peaks[k] = Peak { threshold: peaks[k].threshold, ..peak };
        }
    }
    let mut weakest: Option<usize> = None;
    for k in 0..peaks.len() {
        let below = peaks[k].gain <= peaks[k].threshold;
        if below && weakest.is_none_or(|weakest| peaks[k].gain < peaks[weakest].gain) {
            weakest = Some(k);
        }
    }
    if let Some(weakest) = weakest {
        peaks.remove(weakest);
    }
    cost
}

/// The pulse around a maximum; none where the frame cuts it off.
fn fit<T: Real>(
    estimator: &ChannelEstimator<T>,
    samples: &[T],
    noise: &NoiseLevel<T>,
    peaks: &[Peak<T>],
    own: Option<usize>,
    n: usize,
) -> Option<Peak<T>> {
    let num = T::of;
    let table = &estimator.table;
    let triple = Triple::new(table);
    let stride = triple.stride;
    if n < stride || n + stride >= samples.len() {
        return None;
    }
    let level = noise.at(T::of_count(n), estimator.sample_spacing_s);
    let places = [n - stride, n, n + stride];
    let magnitudes = places.map(|place| samples[place]);
    let levels = places.map(|place| {
        let mut sum = level;
        for k in 0..peaks.len() {
            if own != Some(k) {
                sum += square(peaks[k].amplitude * table.at(T::of_count(place) - peaks[k].position));
            }
        }
        sum
    });
    let reach = T::of_count(stride);
    let mut amplitude = magnitudes[1];
    let mut shift = T::ZERO;
    for _ in 0..PASSES {
        let lags = [-reach - shift, -shift, reach - shift];
        let shape = lags.map(|lag| table.at(lag));
        // dR/dtau = -R'.
        let slope = lags.map(|lag| -slope(table, lag));
        let mut misfit = [T::ZERO; 3];
        for i in 0..3 {
            // Order: (m / lambda) (a R), twice.
            let concentration = num(2.0) * (magnitudes[i] / levels[i]) * (amplitude * shape[i]);
            misfit[i] = magnitudes[i] * mean_cosine(concentration) / amplitude - shape[i];
        }
        let [ss, sd, dd] =
            [triple.inner(&shape, &shape), triple.inner(&shape, &slope), triple.inner(&slope, &slope)];
        let [sm, dm] = [triple.inner(&shape, &misfit), triple.inner(&slope, &misfit)];
        let determinant = ss * dd - square(sd);
        if !(determinant > num(1e-6) * (ss * dd)) {
            break;
        }
        let growth = (dd * sm - sd * dm) / determinant;
        let step = (ss * dm - sd * sm) / determinant;
        amplitude *= T::ONE + limited(growth, num(-0.5), T::ONE);
        shift += limited(step, num(-0.5) * reach, num(0.5) * reach);
        shift = limited(shift, num(-0.75) * reach, num(0.75) * reach);
    }
    let position = T::of_count(n) + shift;
    let left = unexplained(estimator, peaks, own, position, amplitude);
    let gain = square(left) / level + num(0.5);
    Some(Peak { sample: n, position, amplitude, level, gain, threshold: T::ZERO })
}

/// R' at a lag, per sample.
fn slope<T: Real>(table: &PulseTable<T>, lag: T) -> T {
    let h = T::of(SLOPE_PULSES) * table.samples_per_pulse();
    (table.at(lag + h) - table.at(lag - h)) / (T::of(2.0) * h)
}

/// Level at which noise would move a peak's delay as far as the others' overlap does: sum a_j^2 R'^2 / -R''(0).
fn overlap<T: Real>(estimator: &ChannelEstimator<T>, peaks: &[Peak<T>], own: usize) -> T {
    let table = &estimator.table;
    let h = T::of(SLOPE_PULSES) * table.samples_per_pulse();
    let curvature = T::of(2.0) * (T::ONE - table.at(h)) / square(h);
    let mut sum = T::ZERO;
    for k in 0..peaks.len() {
        if k != own {
            let slope = slope(table, peaks[own].position - peaks[k].position);
            sum += square(peaks[k].amplitude) * (square(slope) / curvature);
        }
    }
    sum
}

/// Noise of three samples, split in (m_+ - m_-) / 2, m_0 and (m_+ + m_-) / 2: the inverse covariance of each part.
struct Triple<T> {
    stride: usize,
    odd: T,
    /// Of m_0 and the half sum: diagonal, off it, diagonal.
    rest: [T; 3],
}

impl<T: Real> Triple<T> {
    fn new(table: &PulseTable<T>) -> Self {
        let num = T::of;
        let stride = ((num(0.5) * table.samples_per_pulse() + num(0.5)).whole() as usize).max(1);
        let near = table.at(T::of_count(stride));
        let far = table.at(num(2.0) * T::of_count(stride));
        let odd = num(0.5) * (T::ONE - far) + num(RIDGE);
        let even = num(0.5) * (T::ONE + far) + num(RIDGE);
        let middle = T::ONE + num(RIDGE);
        let determinant = larger(middle * even - square(near), num(RIDGE));
        Self {
            stride,
            odd: T::ONE / odd,
            rest: [even / determinant, -near / determinant, middle / determinant],
        }
    }

    fn inner(&self, u: &[T; 3], v: &[T; 3]) -> T {
        let half = T::of(0.5);
        let split = |x: &[T; 3]| [half * (x[2] - x[0]), x[1], half * (x[2] + x[0])];
        let ([u_odd, u_here, u_even], [v_odd, v_here, v_even]) = (split(u), split(v));
        // Order: odd, middle, mixed, even.
        self.odd * (u_odd * v_odd)
            + self.rest[0] * (u_here * v_here)
            + self.rest[1] * (u_here * v_even + u_even * v_here)
            + self.rest[2] * (u_even * v_even)
    }
}

/// I_1 / I_0 by Amos's bound.
fn mean_cosine<T: Real>(x: T) -> T {
    x / (T::of(0.5) + sqrt(square(x) + T::of(2.25)))
}
