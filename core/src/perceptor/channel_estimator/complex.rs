//! Sparse Bayesian estimation of the paths of a complex frame.
//!
//! Each path carries a prior variance g (relative to the noise level lambda at its delay). With G the pulse's
//! autocorrelation between all path delays, Sigma = (G + diag(1/g))^-1 and the posterior amplitudes are
//! mu = Sigma b, b_k = y(tau_k) / sqrt(lambda_k). For a delay t, with r_k = R(t - tau_k),
//! s = 1 - r' Sigma r and q = y(t)/sqrt(lambda) - r' mu; |q|^2 / s is the gain in marginal likelihood of a path
//! at t, and g = (|q|^2 - s) / s^2 its optimal prior variance (Tipping and Faul's fast marginal likelihood).
//!
//! Loop: refine the noise level on the residual; add the path with the largest gain if it exceeds kappa; move every
//! delay to the maximum of the matched filter without the other paths; re-estimate every g; prune what fell
//! below kappa and merge what ran together. Bounded by `PATHS + 4` rounds.

use super::gram::Square;
use super::magnitude::parabola_vertex;
use super::noise::{LevelSteps, LevelWalk, NoiseLevel, level_floor, white_level};
use super::{ChannelEstimate, ChannelEstimator, Path};
use crate::observation::Complex;
use crate::real::{abs, larger, smaller, sqrt};
use heapless::Vec;

/// Paths above this SINR leave subtraction errors that look like dense multipath: the fit skips their surroundings.
const STRONG: f32 = 316.0;
/// Half the width skipped around a strong path, pulse durations.
const SKIP_PULSES: f32 = 1.5;
/// Share of its energy that a path keeps on the sample grid, at least.
const SCALLOPING: f32 = 0.7;
/// Passes of the noise fit before the first path, and before each further one.
const FIRST_REFINEMENTS: usize = 8;
const REFINEMENTS: usize = 2;
/// Passes over all delays after each new path, at most; fewer where no delay moves further than this any more, samples.
const PASSES: usize = 8;
const STILL_SAMPLES: f32 = 0.02;
/// Two paths closer than this many pulse durations are one.
const MERGE_PULSES: f32 = 0.3;
/// Added to the Gram matrix's diagonal for the final amplitudes: two paths that nearly cancel stay finite.
const RIDGE: f32 = 1e-3;
/// A candidate whose s is below this is explained by the paths already there.
const SMALLEST_S: f32 = 0.02;

/// One path while it is being estimated.
#[derive(Clone, Copy, Debug)]
struct Component {
    /// Delay, samples into the frame.
    position: f32,
    /// Prior variance over noise level.
    prior: f32,
    /// Noise level at the delay.
    level: f32,
    /// y(tau) at the delay.
    matched: Complex,
    /// Posterior mean amplitude, unit of the samples.
    amplitude: Complex,
    /// Marginal-likelihood gain |q|^2 / s without this component's own share.
    gain: f32,
}

/// A frame and what is known of it.
struct Fit<'a, const PATHS: usize> {
    estimator: &'a ChannelEstimator<PATHS>,
    samples: &'a [Complex],
    components: Vec<Component, PATHS>,
    noise: NoiseLevel,
    steps: LevelSteps,
    /// White noise is never taken as less than this: -120 dB of the strongest sample.
    floor: f32,
    posterior: Square<PATHS>,
}

impl<const PATHS: usize> ChannelEstimator<PATHS> {
    pub(super) fn estimate_complex(
        &self,
        samples: &[Complex],
        first_sample_delay_s: f32,
    ) -> ChannelEstimate<PATHS> {
        let white = white_level(|| samples.iter().map(power), samples.len());
        let strongest = samples.iter().map(power).fold(0.0, larger);
        let steps = LevelSteps::new(self.sample_spacing_s);
        let mut fit = Fit {
            estimator: self,
            samples,
            components: Vec::new(),
            noise: NoiseLevel::open(white, samples.len(), &steps),
            steps,
            floor: level_floor(strongest),
            posterior: Square::zero(),
        };
        for _ in 0..FIRST_REFINEMENTS {
            fit.fit_noise();
        }
        for round in 0..PATHS + 4 {
            if round > 0 {
                for _ in 0..REFINEMENTS {
                    fit.fit_noise();
                }
                fit.settle();
            }
            if !fit.add_strongest() {
                break;
            }
            for _ in 0..PASSES {
                let moved = fit.move_delays();
                fit.settle();
                if moved < STILL_SAMPLES {
                    break;
                }
            }
        }
        fit.into_estimate(first_sample_delay_s)
    }
}

impl<const PATHS: usize> Fit<'_, PATHS> {
    /// The residual at sample `n`: what the components do not explain.
    fn residual(&self, n: usize, sample: &Complex) -> Complex {
        let [mut re, mut im] = *sample;
        for component in &self.components {
            let lag = n as f32 - component.position;
            if abs(lag) < self.estimator.table.support_samples() {
                let r = self.estimator.table.at(lag);
                let [a_re, a_im] = component.amplitude;
                re -= a_re * r;
                im -= a_im * r;
            }
        }
        [re, im]
    }

    /// One pass over the residual refines the levels of white noise and dense multipath. The rounds of the estimation
    /// are the iterations of this fit.
    fn fit_noise(&mut self) {
        let skip = SKIP_PULSES * self.estimator.table.samples_per_pulse();
        let mut noise = self.noise;
        let powers = self.samples.iter().enumerate().map(|(n, sample)| {
            let near_strong = self
                .components
                .iter()
                .any(|component| component.gain > STRONG && abs(n as f32 - component.position) < skip);
            if near_strong { None } else { Some(power(&self.residual(n, sample))) }
        });
        noise.refine(powers, &self.steps, self.floor);
        self.noise = noise;
        for component in &mut self.components {
            component.level = noise.level(component.position, self.estimator.sample_spacing_s);
        }
    }

    /// Adds the path with the largest gain above kappa; false where there is none or no room.
    fn add_strongest(&mut self) -> bool {
        let table = &self.estimator.table;
        let spacing = self.estimator.sample_spacing_s;
        let mut walk = LevelWalk::new(&self.noise, &self.steps);
        // Gains at the two samples before n, and where the best was found with its neighbours.
        let mut before = 0.0;
        let mut best = (0_usize, 0.0_f32, 0.0_f32, 0.0_f32);
        let mut follows_best = false;
        for (n, sample) in self.samples.iter().enumerate() {
            let level = walk.next();
            let q2 = power(&self.residual(n, sample)) / level;
            let s = self.uncertainty(n as f32);
            let gain = if s < SMALLEST_S { 0.0 } else { q2 / s };
            if follows_best {
                best.3 = gain;
                follows_best = false;
            }
            if gain > best.2 {
                best = (n, before, gain, 0.0);
                follows_best = true;
            }
            before = gain;
        }
        let (n, left, gain, right) = best;
        // Between two samples a path has lost up to 1.2 dB: what falls short by more need not be looked at.
        if gain <= SCALLOPING * self.estimator.threshold {
            return false;
        }
        let position = n as f32 + parabola_vertex(left, gain, right);
        let s = larger(self.uncertainty(position), SMALLEST_S);
        let level = self.noise.level(position, spacing);
        let matched = self.estimator.interpolation.at(self.samples, position);
        let mut residual = matched;
        for component in &self.components {
            let r = table.at(position - component.position);
            let [re, im] = residual;
            let [a_re, a_im] = component.amplitude;
            residual = [re - a_re * r, im - a_im * r];
        }
        let q2 = power(&residual) / level;
        let gain = larger(gain, q2 / s);
        if gain <= self.estimator.threshold {
            return false;
        }
        let prior = larger((q2 - s) / (s * s), 1.0);
        let component = Component { position, prior, level, matched, amplitude: residual, gain };
        self.components.push(component).is_ok()
    }

    /// s(t) = 1 - r' Sigma r at a position, samples into the frame.
    fn uncertainty(&self, position: f32) -> f32 {
        let table = &self.estimator.table;
        let mut lags: Vec<(usize, f32), PATHS> = Vec::new();
        for (k, component) in self.components.iter().enumerate() {
            let lag = position - component.position;
            if abs(lag) < table.support_samples() {
                // As many lags as components at most: the push succeeds.
                let _ = lags.push((k, table.at(lag)));
            }
        }
        let mut form = 0.0;
        for &(k, r_k) in &lags {
            let row = self.posterior.row(k);
            for &(l, r_l) in &lags {
                form += r_k * row.get(l).copied().unwrap_or(0.0) * r_l;
            }
        }
        1.0 - form
    }

    /// One pass over the components: each delay moves to the vertex of the parabola through the matched filter's
    /// energy, without the other components, a quarter sample to either side; twice; and only if that gains. Gives the
    /// longest move, samples.
    fn move_delays(&mut self) -> f32 {
        let mut longest = 0.0;
        for k in 0..self.components.len() {
            for _ in 0..2 {
                let Some(&component) = self.components.get(k) else { return longest };
                let step = 0.25;
                let here = power(&self.without(k, component.position));
                let left = power(&self.without(k, component.position - step));
                let right = power(&self.without(k, component.position + step));
                let curvature = left - 2.0 * here + right;
                let shift = if curvature < 0.0 {
                    step * 0.5 * (left - right) / curvature
                } else if left > right {
                    -step
                } else {
                    step
                };
                let limit = 0.2 * self.estimator.table.samples_per_pulse();
                let shift = smaller(larger(shift, -limit), limit);
                let position = component.position + shift;
                let moved = self.without(k, position);
                if power(&moved) <= here {
                    break;
                }
                longest = larger(longest, abs(shift));
                let matched = self.estimator.interpolation.at(self.samples, position);
                let level = self.noise.level(position, self.estimator.sample_spacing_s);
                if let Some(component) = self.components.get_mut(k) {
                    component.position = position;
                    component.matched = matched;
                    component.level = level;
                    component.amplitude = moved;
                }
            }
        }
        longest
    }

    /// The matched filter's output at a position without all components but `k`.
    fn without(&self, k: usize, position: f32) -> Complex {
        let [mut re, mut im] = self.estimator.interpolation.at(self.samples, position);
        for (j, component) in self.components.iter().enumerate() {
            if j == k {
                continue;
            }
            let lag = position - component.position;
            if abs(lag) < self.estimator.table.support_samples() {
                let r = self.estimator.table.at(lag);
                let [a_re, a_im] = component.amplitude;
                re -= a_re * r;
                im -= a_im * r;
            }
        }
        [re, im]
    }

    /// Brings posterior, amplitudes and priors in agreement; prunes and merges until nothing changes.
    fn settle(&mut self) {
        for _ in 0..=PATHS {
            self.solve();
            self.reestimate();
            let Some(weakest) = self.weakest_or_merged() else { break };
            let mut k = 0;
            self.components.retain(|_| {
                k += 1;
                k - 1 != weakest
            });
        }
        self.solve();
    }

    /// Sigma and the posterior amplitudes.
    fn solve(&mut self) {
        let table = &self.estimator.table;
        let size = self.components.len();
        let mut gram = Square::<PATHS>::zero();
        for (k, a) in self.components.iter().enumerate() {
            for (l, b) in self.components.iter().enumerate().take(k) {
                let r = table.at(a.position - b.position);
                gram.set(k, l, r);
                gram.set(l, k, r);
            }
            gram.set(k, k, 1.0 + 1.0 / a.prior);
        }
        self.posterior = gram.inverse(size);
        for k in 0..size {
            let mut mean = [0.0, 0.0];
            for (component, &sigma) in self.components.iter().zip(self.posterior.row(k)) {
                let scale = sigma / sqrt(component.level);
                let [re, im] = component.matched;
                mean = [mean[0] + scale * re, mean[1] + scale * im];
            }
            if let Some(component) = self.components.get_mut(k) {
                let unit = sqrt(component.level);
                component.amplitude = [mean[0] * unit, mean[1] * unit];
            }
        }
    }

    /// Gain and prior variance of each component, as if it were added last. With D = diag(1/g) and
    /// G = Sigma^-1 - D, the textbook's S and Q become S = (1 - Sigma_kk / g) / g and Q = mu_k / g, so that
    /// s = S / (1 - g S) = 1 / Sigma_kk - 1 / g and q = Q / (1 - g S) = mu_k / Sigma_kk.
    fn reestimate(&mut self) {
        for (k, component) in self.components.iter_mut().enumerate() {
            let sigma = larger(self.posterior.at(k, k), 1e-9);
            let s = larger(1.0 / sigma - 1.0 / component.prior, SMALLEST_S);
            let q2 = power(&component.amplitude) / (component.level * (sigma * sigma));
            component.gain = q2 / s;
            component.prior = larger((q2 - s) / (s * s), 1e-3);
        }
    }

    /// The component to drop: the weakest of those below kappa, or the weaker of two that ran together.
    fn weakest_or_merged(&self) -> Option<usize> {
        let mut drop: Option<(usize, f32)> = None;
        for (k, component) in self.components.iter().enumerate() {
            if component.gain < self.estimator.threshold && drop.is_none_or(|(_, gain)| component.gain < gain)
            {
                drop = Some((k, component.gain));
            }
        }
        if drop.is_none() {
            let merge = MERGE_PULSES * self.estimator.table.samples_per_pulse();
            for (k, a) in self.components.iter().enumerate() {
                for (l, b) in self.components.iter().enumerate().take(k) {
                    if abs(a.position - b.position) < merge {
                        return Some(if a.gain < b.gain { k } else { l });
                    }
                }
            }
        }
        drop.map(|(k, _)| k)
    }

    /// Final amplitudes by least squares (no shrinkage), in order of discovery.
    fn into_estimate(mut self, first_sample_delay_s: f32) -> ChannelEstimate<PATHS> {
        let size = self.components.len();
        let mut gram = Square::<PATHS>::zero();
        for (k, a) in self.components.iter().enumerate() {
            for (l, b) in self.components.iter().enumerate().take(k) {
                let r = self.estimator.table.at(a.position - b.position);
                gram.set(k, l, r);
                gram.set(l, k, r);
            }
            gram.set(k, k, 1.0 + RIDGE);
        }
        let inverse = gram.inverse(size);
        let mut paths: Vec<Path, PATHS> = Vec::new();
        for (k, component) in self.components.iter().enumerate() {
            let mut amplitude = [0.0, 0.0];
            for (other, &weight) in self.components.iter().zip(inverse.row(k)) {
                let [re, im] = other.matched;
                amplitude = [amplitude[0] + weight * re, amplitude[1] + weight * im];
            }
            let sinr = larger(component.gain - 1.0, 1e-3);
            let path = self.estimator.path(component.position, first_sample_delay_s, amplitude, sinr);
            // Capacities are equal: every push succeeds.
            let _ = paths.push(path);
        }
        self.components.clear();
        ChannelEstimate { paths, noise: self.noise }
    }
}

/// |z|^2.
fn power(sample: &Complex) -> f32 {
    let [re, im] = *sample;
    re * re + im * im
}
