//! Paths of a complex frame, by sparse Bayesian learning.
//!
//! Each path k has a delay tau_k and a prior variance g_k relative to the noise level there. With G the pulse's
//! autocorrelation between delays, Sigma = (G + diag(1/g))^-1 is the posterior covariance of the amplitudes (over the
//! noise level) and alpha = Sigma y(tau) their mean. A new path at t gains |q|^2 / s in likelihood, with
//! s = 1 - r' Sigma r, r_k = R(t - tau_k), and q the residual at t over the root of the noise level; its best prior
//! variance is (|q|^2 - s) / s^2 (Tipping and Faul). Paths whose gain falls below kappa go.
//!
//! A round: add the best new path, then move delays and settle until they stand still. Once no strong path is left the
//! noise is fitted to the residual, and again in every round from then on. Only delays that a neighbour's change can have moved are moved.
//!
//! This twin keeps buffers of the residual and inverts whole matrices; the core recomputes the residual where needed
//! and inverts cluster by cluster.

use super::beginning::{beginning, farther, tail};
use super::linear_algebra::inverse;
use super::noise::{NoiseLevel, level_floor, white_level};
use super::{ChannelEstimator, Cost, Path, parabola_vertex, power};
use crate::reference::real::{Real, abs, larger, smaller, sqrt, square};
use crate::reference::{Matrix, zeros};
use cogmint_core::perceptor::channel_estimator::complex::{
    DOUBTFUL, FIRST_REFINEMENTS, LEAST_PRIOR, PASSES, REACH_PULSES, REFINEMENTS, RIDGE, SCALLOPING,
    SKIP_PULSES, SMALLEST_S, STILL_SAMPLES, STRONG_SINR,
};
use cogmint_core::perceptor::channel_estimator::noise::COMPLEX_CUT;
use cogmint_core::perceptor::channel_estimator::work::{FRAME, LEVEL, MOVE, SEARCH, SOLVE};
use cogmint_core::perceptor::channel_estimator::{LEAST_SINR, SPARE_ROUNDS};

/// A path in the making.
#[derive(Clone, Copy, Debug)]
struct Component<T> {
    /// tau, samples into the frame.
    position: T,
    /// Whether it may move: it or a neighbour came, went or moved.
    moving: bool,
    /// g.
    prior: T,
    /// Noise level at tau.
    level: T,
    /// y(tau).
    matched: [T; 2],
    /// alpha.
    amplitude: [T; 2],
    /// |q|^2 / s, as if this component were added last.
    gain: T,
    /// Its kappa.
    threshold: T,
}

struct Fit<'a, T> {
    estimator: &'a ChannelEstimator<T>,
    samples: &'a [[T; 2]],
    components: Vec<Component<T>>,
    noise: NoiseLevel<T>,
    /// Least white noise.
    floor: T,
    /// Sigma.
    posterior: Matrix<T>,
    /// kappa of further components.
    threshold: T,
    /// Cost so far.
    work: u32,
    /// Of that, before the search.
    fixed_work: u32,
    cut_short: bool,
}

pub(super) fn estimate<T: Real>(
    estimator: &ChannelEstimator<T>,
    samples: &[[T; 2]],
    first_sample_delay_s: T,
) -> (Vec<Path<T>>, NoiseLevel<T>, T, Cost) {
    let powers: Vec<T> = samples.iter().map(|sample| power(*sample)).collect();
    let white = white_level(&powers);
    let begins = beginning(estimator, &powers, estimator.fitted_threshold * white);
    let start = begins.filter(|_| estimator.settings.begins_with_path);
    let noise = estimator.open_noise(white, samples.len(), start);
    let floor = level_floor(powers.iter().fold(T::ZERO, |most, p| larger(most, *p)));
    let threshold = estimator.fitted_threshold;
    let (components, posterior) = (Vec::new(), Vec::new());
    let work = FRAME[0] + FRAME[1] * samples.len() as u32;
    let mut fit = Fit {
        estimator,
        samples,
        components,
        noise,
        floor,
        posterior,
        threshold,
        work,
        fixed_work: 0,
        cut_short: false,
    };
    if let Some([n, _]) = start {
        let beside = |n: Option<usize>| n.and_then(|n| powers.get(n)).copied().unwrap_or(T::ZERO);
        let vertex = parabola_vertex(beside(n.checked_sub(1)), powers[n], beside(Some(n + 1)));
        let position = T::of_count(n) + vertex;
        let matched = estimator.interpolation.at(samples, position);
        let gain = powers[n] / white;
        fit.add(Component {
            position,
            moving: true,
            prior: gain,
            level: white,
            matched,
            amplitude: matched,
            gain,
            threshold: T::ZERO,
        });
    }
    for _ in 0..FIRST_REFINEMENTS {
        fit.fit_noise();
    }
    fit.fixed_work = fit.work;
    if let Some([_, ahead]) = begins {
        let tail = tail(&powers[..ahead], &fit.noise.at_samples(ahead));
        fit.threshold = farther(estimator.fitted_threshold, tail);
        for component in &mut fit.components {
            component.threshold = farther(estimator.beginning_threshold, tail);
        }
    }
    if start.is_some() {
        fit.set_levels();
        fit.settle();
        fit.move_until_still();
    }
    let mut refined = false;
    for _ in 0..estimator.most_paths + SPARE_ROUNDS {
        if fit.is_used_up() {
            break;
        }
        if refined {
            fit.fit_noise();
            fit.set_levels();
            fit.settle();
        }
        let mut candidate = fit.strongest();
        let sure = T::of(DOUBTFUL) * fit.threshold;
        let full = fit.components.len() == estimator.most_paths;
        if !refined && (full || candidate.is_none_or(|candidate| candidate.gain < sure)) {
            refined = true;
            fit.refine();
            candidate = fit.strongest();
        }
        let Some(candidate) = candidate else { break };
        if fit.components.len() == estimator.most_paths {
            break;
        }
        fit.add(candidate);
        fit.move_until_still();
    }
    if !refined {
        fit.refine();
    }
    fit.finish(first_sample_delay_s)
}

impl<T: Real> Fit<'_, T> {
    /// Whether nothing more may be begun; notes it.
    fn is_used_up(&mut self) -> bool {
        let is_used_up = self.work - self.fixed_work >= self.estimator.most_work;
        self.cut_short |= is_used_up;
        is_used_up
    }

    /// Moves and settles until everything stands still.
    fn move_until_still(&mut self) {
        for _ in 0..PASSES {
            if self.is_used_up() || !self.move_delays() {
                break;
            }
            self.settle();
        }
    }

    /// The level beside what was found, and that in it.
    fn refine(&mut self) {
        for _ in 0..REFINEMENTS {
            self.fit_noise();
        }
        self.set_levels();
        self.settle();
    }

    /// Counts a pass over the samples, by what it costs at each and at each that a path reaches.
    fn count_pass(&mut self, [sample, path]: [u32; 2]) {
        let samples = self.samples.len();
        let each = self.estimator.pulse_samples().min(samples);
        let reached = self.components.len() * each;
        self.work += sample * samples as u32 + path * reached as u32;
    }

    /// A value at `position` less all components but one. Order: component by component.
    fn subtract(&self, value: [T; 2], position: T, except: Option<usize>) -> [T; 2] {
        let table = &self.estimator.table;
        let mut rest = value;
        for j in 0..self.components.len() {
            let component = &self.components[j];
            let lag = position - component.position;
            if Some(j) != except && abs(lag) < table.support_samples() {
                let r = table.at(lag);
                rest[0] -= component.amplitude[0] * r;
                rest[1] -= component.amplitude[1] * r;
            }
        }
        rest
    }

    /// Powers of the residual at all samples.
    fn residual_powers(&self) -> Vec<T> {
        let mut powers = Vec::new();
        for n in 0..self.samples.len() {
            powers.push(power(self.subtract(self.samples[n], T::of_count(n), None)));
        }
        powers
    }

    /// Fits the noise to the residual, but for the surroundings of strong paths.
    fn fit_noise(&mut self) {
        self.count_pass(LEVEL);
        let skip = T::of(SKIP_PULSES) * self.estimator.table.samples_per_pulse();
        let residual = self.residual_powers();
        let mut powers = Vec::new();
        for n in 0..residual.len() {
            let near_strong = self.components.iter().any(|component| {
                component.gain > T::of(STRONG_SINR) && abs(T::of_count(n) - component.position) < skip
            });
            powers.push(if near_strong { None } else { Some(residual[n]) });
        }
        self.noise.update(&COMPLEX_CUT, &powers, self.floor);
    }

    /// Gives every component the level at its delay.
    fn set_levels(&mut self) {
        for component in &mut self.components {
            component.level = self.noise.at(component.position, self.estimator.sample_spacing_s);
        }
    }

    /// s(t) = 1 - r' Sigma r. Order: row by row, each r_k (Sigma_kk r_k + 2 sum of Sigma_kl r_l left of the diagonal),
    /// over the components whose pulses reach t.
    fn uncertainty(&self, position: T) -> T {
        let table = &self.estimator.table;
        let mut reached = Vec::new();
        for k in 0..self.components.len() {
            let lag = position - self.components[k].position;
            if abs(lag) < table.support_samples() {
                reached.push((k, table.at(lag)));
            }
        }
        let mut s = T::ONE;
        for (place, &(k, r_k)) in reached.iter().enumerate() {
            let mut cross = T::ZERO;
            for &(l, r_l) in &reached[..place] {
                cross += self.posterior[k][l] * r_l;
            }
            s -= r_k * (self.posterior[k][k] * r_k + T::of(2.0) * cross);
        }
        s
    }

    /// The gain of a path at sample `n`; zero outside the frame and where the others explain it.
    fn gain_at(&self, n: usize) -> T {
        if n >= self.samples.len() {
            return T::ZERO;
        }
        let position = T::of_count(n);
        let s = self.uncertainty(position);
        if s < T::of(SMALLEST_S) {
            return T::ZERO;
        }
        let residual = power(self.subtract(self.samples[n], position, None));
        residual / (s * self.noise.at(position, self.estimator.sample_spacing_s))
    }

    /// The path of largest gain, if it exceeds kappa.
    fn strongest(&mut self) -> Option<Component<T>> {
        self.count_pass(SEARCH);
        let num = T::of;
        let spacing = self.estimator.sample_spacing_s;
        let residual = self.residual_powers();
        let levels = self.noise.at_samples(self.samples.len());
        // Off the grid, a path may be stronger than on it. Order: compared by products, (gain)(s lambda).
        let mut best = (None, num(SCALLOPING) * self.threshold);
        for n in 0..residual.len() {
            let s = self.uncertainty(T::of_count(n));
            let scale = s * levels[n];
            if residual[n] > best.1 * scale && s >= num(SMALLEST_S) {
                best = (Some(n), residual[n] / scale);
            }
        }
        let (n, gain) = (best.0?, best.1);
        let left = if n > 0 { self.gain_at(n - 1) } else { T::ZERO };
        let position = T::of_count(n) + parabola_vertex(left, gain, self.gain_at(n + 1));

        let s = larger(self.uncertainty(position), num(SMALLEST_S));
        let level = self.noise.at(position, spacing);
        let matched = self.estimator.interpolation.at(self.samples, position);
        let amplitude = self.subtract(matched, position, None);
        let q2 = power(amplitude) / level;
        let gain = larger(gain, q2 / s);
        if gain <= self.threshold {
            return None;
        }
        let prior = larger((q2 - s) / square(s), T::ONE);
        let threshold = self.threshold;
        Some(Component { position, moving: true, prior, level, matched, amplitude, gain, threshold })
    }

    /// Adds a component in its place by delay, behind equal ones.
    fn add(&mut self, added: Component<T>) {
        let place = self.components.partition_point(|component| component.position <= added.position);
        self.components.insert(place, added);
        let first = self.components.iter().position(|component| component.position == added.position);
        self.wake_neighbours(first.unwrap_or(place));
    }

    /// Component `k` came, went or moved: what its pulse may reach can move.
    fn wake_neighbours(&mut self, k: usize) {
        let reached = self.reached(k);
        for component in &mut self.components[reached] {
            component.moving = true;
        }
    }

    /// The components that the pulse of component `k` may reach while it moves, itself among them.
    fn reached(&self, k: usize) -> std::ops::Range<usize> {
        let table = &self.estimator.table;
        let far = table.support_samples() + T::of(REACH_PULSES) * table.samples_per_pulse();
        let position = self.components[k].position;
        let near = |other: &Component<T>| abs(other.position - position) < far;
        // Outwards from k, up to the first that is far.
        let from = (0..k).rev().find(|&j| !near(&self.components[j])).map_or(0, |j| j + 1);
        let end = self.components.len();
        let to = (k + 1..end).find(|&j| !near(&self.components[j])).unwrap_or(end);
        from..to
    }

    /// The matched filter at a position without all components but `k`.
    fn without_others(&self, k: usize, position: T) -> [T; 2] {
        let matched = self.estimator.interpolation.at(self.samples, position);
        self.subtract(matched, position, Some(k))
    }

    /// Moves each moving delay, twice, to the vertex of the parabola through the energies a quarter sample around it, if
    /// that gains. False if none was moving.
    fn move_delays(&mut self) -> bool {
        let num = T::of;
        let mut any = false;
        let step = num(0.25);
        let limit = num(0.2) * self.estimator.table.samples_per_pulse();
        for k in 0..self.components.len() {
            if !self.components[k].moving {
                continue;
            }
            self.components[k].moving = false;
            any = true;
            let cost = MOVE[0] + MOVE[1] * self.reached(k).len() as u32;
            let mut furthest = T::ZERO;
            for _ in 0..2 {
                self.work += cost;
                let present = self.components[k].position;
                let here = power(self.subtract(self.components[k].matched, present, Some(k)));
                let left = power(self.without_others(k, present - step));
                let right = power(self.without_others(k, present + step));
                let curvature = left - num(2.0) * here + right;
                let shift = if curvature < T::ZERO {
                    // Order: ((step 0.5) difference) / curvature.
                    step * num(0.5) * (left - right) / curvature
                } else if left > right {
                    -step
                } else {
                    step
                };
                let shift = smaller(larger(shift, -limit), limit);
                let position = present + shift;
                let moved = self.without_others(k, position);
                if power(moved) <= here {
                    break;
                }
                furthest = larger(furthest, abs(shift));
                let component = &mut self.components[k];
                component.position = position;
                component.matched = self.estimator.interpolation.at(self.samples, position);
                component.level = self.noise.at(position, self.estimator.sample_spacing_s);
                component.amplitude = moved;
                if shift == T::ZERO {
                    break;
                }
            }
            if furthest >= num(STILL_SAMPLES) {
                self.wake_neighbours(k);
            }
        }
        self.components.sort_by(|a, b| a.position.to_f64().total_cmp(&b.position.to_f64()));
        any
    }

    /// Posterior, gains and priors in turn, until no component has to go.
    fn settle(&mut self) {
        for _ in 0..=self.estimator.most_paths {
            self.solve();
            self.reestimate();
            let Some(drop) = self.to_drop() else { break };
            self.wake_neighbours(drop);
            self.components.remove(drop);
        }
        self.solve();
    }

    /// G + a diagonal.
    fn gram(&self, diagonal: impl Fn(&Component<T>) -> T) -> Matrix<T> {
        let size = self.components.len();
        let mut gram = zeros(size, size);
        for k in 0..size {
            for l in 0..k {
                let lag = self.components[k].position - self.components[l].position;
                gram[k][l] = self.estimator.table.at(lag);
                gram[l][k] = gram[k][l];
            }
            gram[k][k] = T::ONE + diagonal(&self.components[k]);
        }
        gram
    }

    /// Sigma, and alpha_k = sqrt(lambda_k) sum over l of Sigma_kl y(tau_l) / sqrt(lambda_l).
    fn solve(&mut self) {
        // Components in a row that reach each other are inverted together.
        let support = self.estimator.table.support_samples();
        for row in self.components.chunk_by(|a, b| b.position - a.position < support) {
            self.work += SOLVE[0] * row.len() as u32 + SOLVE[1] * row.len().pow(3) as u32;
        }
        self.posterior = inverse(&self.gram(|component| T::ONE / component.prior));
        for k in 0..self.components.len() {
            let mut mean = [T::ZERO; 2];
            for l in 0..self.components.len() {
                let other = &self.components[l];
                let scale = self.posterior[k][l] / sqrt(other.level);
                mean[0] += scale * other.matched[0];
                mean[1] += scale * other.matched[1];
            }
            let unit = sqrt(self.components[k].level);
            self.components[k].amplitude = [mean[0] * unit, mean[1] * unit];
        }
    }

    /// Gains and priors: s = 1 / Sigma_kk - 1 / g, q = alpha / (sqrt(lambda) Sigma_kk).
    fn reestimate(&mut self) {
        let num = T::of;
        for k in 0..self.components.len() {
            let component = &mut self.components[k];
            // A covariance is at least that of the component alone.
            let alone = T::ONE + T::ONE / component.prior;
            let sigma = larger(self.posterior[k][k], T::ONE / alone);
            let s = larger(T::ONE / sigma - T::ONE / component.prior, num(SMALLEST_S));
            let q2 = power(component.amplitude) / (component.level * square(sigma));
            component.gain = q2 / s;
            component.prior = larger((q2 - s) / square(s), num(LEAST_PRIOR));
        }
    }

    /// The weakest component below kappa; else the weaker of two that ran together.
    fn to_drop(&self) -> Option<usize> {
        let mut weakest: Option<usize> = None;
        for k in 0..self.components.len() {
            let gain = self.components[k].gain;
            let weaker = weakest.is_none_or(|weakest| gain < self.components[weakest].gain);
            if gain < self.components[k].threshold && weaker {
                weakest = Some(k);
            }
        }
        if weakest.is_some() {
            return weakest;
        }
        let merge = T::of(self.estimator.settings.merge_pulses) * self.estimator.table.samples_per_pulse();
        for k in 1..self.components.len() {
            let (a, b) = (&self.components[k - 1], &self.components[k]);
            if b.position - a.position < merge {
                return Some(if b.gain < a.gain { k } else { k - 1 });
            }
        }
        None
    }

    /// The paths, with amplitudes by least squares (no prior).
    fn finish(self, first_sample_delay_s: T) -> (Vec<Path<T>>, NoiseLevel<T>, T, Cost) {
        let inverse = inverse(&self.gram(|_| T::of(RIDGE)));
        let mut paths = Vec::new();
        for k in 0..self.components.len() {
            let mut amplitude = [T::ZERO; 2];
            for l in 0..self.components.len() {
                amplitude[0] += inverse[k][l] * self.components[l].matched[0];
                amplitude[1] += inverse[k][l] * self.components[l].matched[1];
            }
            let component = &self.components[k];
            if !(power(amplitude) < T::of(f32::MAX)) {
                amplitude = component.amplitude;
            }
            let sinr = larger(component.gain - T::ONE, T::of(LEAST_SINR));
            paths.push(self.estimator.path(component.position, first_sample_delay_s, amplitude, sinr));
        }
        (paths, self.noise, self.threshold, Cost { work: self.work, cut_short: self.cut_short })
    }
}
