//! Sparse Bayesian estimation of the paths of a complex frame.
//!
//! Each path carries a prior variance g (relative to the noise level lambda at its delay). With G the pulse's
//! autocorrelation between all path delays, Sigma = (G + diag(1/g))^-1 and the posterior amplitudes are
//! mu = Sigma b, b_k = y(tau_k) / sqrt(lambda_k). For a delay t, with r_k = R(t - tau_k),
//! s = 1 - r' Sigma r and q = y(t)/sqrt(lambda) - r' mu; |q|^2 / s is the gain in marginal likelihood of a path
//! at t, and g = (|q|^2 - s) / s^2 its optimal prior variance (Tipping and Faul's fast marginal likelihood).
//!
//! Loop: add the path with the largest gain if it exceeds kappa; move delays to the maximum of the matched filter
//! without the other paths, until they stand still; re-estimate every g; prune what fell below kappa and merge what ran
//! together. The noise level is fitted to the residual once no strong path is left, and follows every path from then
//! on. Bounded by `PATHS + 4` rounds. Where
//! dense multipath begins with a path, that is the first one, if the level leaves it its threshold.
//!
//! Paths stay in order of delay, so that G falls into blocks of neighbours and each sample knows the few paths that
//! reach it.

use super::beginning::{Beginning, Tail};
use super::component::{Component, Reach, cluster_end, sort};
use super::gram::Symmetric;
use super::noise::{
    COMPLEX_CUT, Cell, CellPowers, CutPowers, LevelSteps, LevelWalk, NoiseLevel, level_floor, white_level,
};
use super::work::{FrameWork, LEVEL, MOVE, SEARCH};
use super::{ChannelEstimate, ChannelEstimator, LEAST_SINR, Path, SPARE_ROUNDS};
use crate::model::observation::Complex;
use crate::real::{abs, larger, smaller};
use heapless::Vec;

/// Guard: against subtraction errors of a strong path, which look like dense multipath: half the width that the fit of the
/// level leaves out around it, pulse durations.
pub const SKIP_PULSES: f32 = 1.5;
/// Guard: against the same: SINR above which it leaves that out.
pub const STRONG_SINR: f32 = 316.0;
/// Guard: against missing a path between two samples, where it has lost up to 1.2 dB: share of kappa from which on a sample is
/// looked at.
pub const SCALLOPING: f32 = 0.7;
/// Guard: against rounding: samples of a cell in which all are below this share of what would be looked at are passed over at once.
const QUIET: f32 = 0.999;
/// Capacity: passes of the noise fit before the first path, which bound its time; what stands out far needs no exact level.
pub const FIRST_REFINEMENTS: usize = 7;
/// Capacity: passes of the noise fit once no strong path is left, or no room, which bound its time: as many in every frame.
pub const REFINEMENTS: usize = 6;
/// Guard: against fitting the level while a path above this many times kappa is still in the residual.
pub const DOUBTFUL: f32 = 2.0;
/// Capacity: passes over the moving delays after each new path, which bound their time.
pub const PASSES: usize = 24;
/// Guard: against endless small steps; a delay stands still that moves no further than this, samples.
pub const STILL_SAMPLES: f32 = 0.004;
/// Guard: against a neighbour left out that comes within reach while it moves, by this many pulse durations.
pub const REACH_PULSES: f32 = 1.5;
/// Guard: against a singular Gram matrix in the final amplitudes; added to its diagonal.
pub const RIDGE: f32 = 1e-3;
/// Guard: against the division by s; a candidate whose s is below this is explained by the paths already there.
pub const SMALLEST_S: f32 = 0.02;
/// Guard: against a prior variance of zero, by which the posterior divides.
pub const LEAST_PRIOR: f32 = 1e-3;

/// A frame and what is known of it.
struct Fit<'a, const PATHS: usize> {
    estimator: &'a ChannelEstimator<PATHS>,
    samples: &'a [Complex],
    /// In order of delay.
    components: Vec<Component, PATHS>,
    noise: &'a mut NoiseLevel,
    steps: LevelSteps,
    /// Of the samples as they are.
    cells: CellPowers,
    /// White noise is never taken as less than this: -120 dB of the strongest sample.
    floor: f32,
    /// Sigma.
    posterior: Symmetric<PATHS>,
    /// kappa in this frame.
    threshold: f32,
    /// Done so far.
    work: FrameWork,
}

impl<const PATHS: usize> ChannelEstimator<PATHS> {
    pub(super) fn estimate_complex(
        &self,
        samples: &[Complex],
        first_sample_delay_s: f32,
        most_work: u32,
    ) -> ChannelEstimate<PATHS> {
        let white = white_level(|| samples.iter().map(power), samples.len());
        let strongest = samples.iter().map(power).fold(0.0, larger);
        let powers = |n: usize| samples.get(n).map_or(0.0, power);
        let beginning = Beginning::find(powers, samples.len(), self.sample_spacing_s, self.threshold * white);
        let begins = beginning.filter(|_| self.settings.begins_with_path).map(|beginning| beginning.sample);
        let steps = LevelSteps::new(self.profile, self.sample_spacing_s, samples.len(), begins.unwrap_or(0));
        let mut estimate = self.without_paths(NoiseLevel::open(white, &steps));
        let mut fit = Fit {
            estimator: self,
            samples,
            components: Vec::new(),
            noise: &mut estimate.noise,
            cells: CellPowers::new(&steps, powers),
            steps,
            floor: level_floor(strongest),
            posterior: Symmetric::zero(),
            threshold: self.threshold,
            work: FrameWork::of(samples.len(), most_work),
        };
        if let Some(sample) = begins {
            fit.begin(sample);
        }
        for _ in 0..FIRST_REFINEMENTS {
            fit.fit_noise();
        }
        fit.work.begin_search(0);
        if let Some(Beginning { ahead, .. }) = beginning {
            fit.measure_tail(ahead);
        }
        if begins.is_some() {
            fit.set_levels();
            fit.settle();
            fit.move_until_still();
        }
        let mut refined = false;
        for _ in 0..PATHS + SPARE_ROUNDS {
            if fit.work.is_used_up() {
                break;
            }
            if refined {
                fit.fit_noise();
                fit.set_levels();
                fit.settle();
            }
            let mut candidate = fit.strongest();
            let strong = candidate.is_some_and(|candidate| candidate.gain >= DOUBTFUL * fit.threshold);
            if !refined && (!strong || fit.components.is_full()) {
                refined = true;
                fit.refine();
                candidate = fit.strongest();
            }
            if !candidate.is_some_and(|candidate| fit.add(candidate)) {
                break;
            }
            fit.move_until_still();
        }
        if !refined {
            fit.refine();
        }
        estimate.threshold = fit.threshold;
        (estimate.work, estimate.cut_short) = (fit.work.done(), fit.work.is_cut_short());
        fit.take_paths(first_sample_delay_s, &mut estimate.paths);
        estimate.dense = self.dense_multipath(&estimate.noise, first_sample_delay_s);
        estimate
    }
}

impl<const PATHS: usize> Fit<'_, PATHS> {
    /// The path at the response's beginning, sample `n`, as it is in white noise.
    fn begin(&mut self, n: usize) {
        let powers = |n: Option<usize>| n.and_then(|n| self.samples.get(n)).map_or(0.0, power);
        let here = powers(Some(n));
        let position = n as f32 + parabola_vertex(powers(n.checked_sub(1)), here, powers(Some(n + 1)));
        let matched = self.estimator.interpolation.at(self.samples, position);
        let mut component = Component::new(position, matched, &self.estimator.table);
        component.set_level(self.noise.white);
        component.gain = here / self.noise.white;
        component.prior = component.gain;
        self.add(component);
    }

    /// The threshold, from the tail of the noise in so many samples ahead of the response.
    fn measure_tail(&mut self, ahead: usize) {
        let mut walk = LevelWalk::new(self.noise, &self.steps);
        let tail = Tail::of(self.samples.iter().take(ahead).map(|sample| power(sample) / walk.next()));
        self.threshold = tail.threshold(self.estimator.threshold);
        for component in &mut self.components {
            component.threshold = tail.threshold(self.estimator.beginning_threshold);
        }
    }

    /// Moves delays until they stand still.
    fn move_until_still(&mut self) {
        for _ in 0..PASSES {
            if self.work.is_used_up() || !self.move_delays() {
                break;
            }
            self.settle();
        }
    }

    /// The level as it is beside the paths found, and the paths in it.
    fn refine(&mut self) {
        for _ in 0..REFINEMENTS {
            self.fit_noise();
        }
        self.set_levels();
        self.settle();
    }

    /// Samples that components reach, each counted for every one of them.
    fn reached(&self) -> usize {
        let reach = (2.0 * self.estimator.table.support_samples()) as usize;
        self.components.len() * reach.min(self.samples.len())
    }

    /// One pass over the residual refines the levels of white noise and dense multipath.
    fn fit_noise(&mut self) {
        self.work.add_pass(LEVEL, self.samples.len(), self.reached());
        let table = &self.estimator.table;
        let skip = SKIP_PULSES * table.samples_per_pulse();
        let mut reach = Reach::new(&self.components);
        self.noise.refine(&self.steps, &COMPLEX_CUT, self.floor, |Cell { node, from, to }, cut| {
            let (_, active, until) = reach.at(from);
            if active.is_empty()
                && until >= to
                && let Some(sum) = self.cells.below(node, cut)
            {
                return CutPowers::whole(sum, to - from);
            }
            let mut powers = CutPowers::default();
            let mut n = from;
            while n < to {
                let (_, active, until) = reach.at(n);
                let run = self.samples.get(n..until.min(to)).unwrap_or(&[]);
                if active.is_empty() {
                    for sample in run {
                        powers.add(power(sample), cut);
                    }
                } else {
                    // Counted in floats, exact for any frame.
                    let mut place = n as f32;
                    for sample in run {
                        let [mut re, mut im] = *sample;
                        let mut near_strong = false;
                        for component in active {
                            let lag = place - component.position;
                            near_strong |= component.gain > STRONG_SINR && abs(lag) < skip;
                            let r = table.at(lag);
                            let [a_re, a_im] = component.amplitude;
                            re -= a_re * r;
                            im -= a_im * r;
                        }
                        if !near_strong {
                            powers.add(re * re + im * im, cut);
                        }
                        place += 1.0;
                    }
                }
                n = until.min(to);
            }
            powers
        });
    }

    /// Gives every component the noise level at its delay.
    fn set_levels(&mut self) {
        for component in &mut self.components {
            component.set_level(self.noise.level(component.position, self.estimator.sample_spacing_s));
        }
    }

    /// Gain in marginal likelihood of a path at `position`, times the noise level, where the components `active` reach,
    /// the first of which has the index `first`: |residual|^2 / s, and s. Zero where s says that nothing can be there.
    fn scaled_gain(&self, sample: Complex, position: f32, first: usize, active: &[Component]) -> Residual {
        let table = &self.estimator.table;
        let [mut re, mut im] = sample;
        let mut s = 1.0;
        // Nearly always there is only one.
        if let [component] = active {
            let r = table.at(position - component.position);
            let [a_re, a_im] = component.amplitude;
            re -= a_re * r;
            im -= a_im * r;
            s -= r * (self.posterior.at(first, first) * r);
            return Residual { amplitude: [re, im], power: re * re + im * im, s };
        }
        let mut lags: Vec<f32, PATHS> = Vec::new();
        for component in active {
            let r = table.at(position - component.position);
            let [a_re, a_im] = component.amplitude;
            re -= a_re * r;
            im -= a_im * r;
            // As many lags as components at most: the push succeeds.
            let _ = lags.push(r);
        }
        for (k, &r_k) in lags.iter().enumerate() {
            let mut cross = 0.0;
            for (sigma, r_l) in self.posterior.left_of_diagonal(first + k, first).iter().zip(&lags) {
                cross += sigma * r_l;
            }
            s -= r_k * (self.posterior.at(first + k, first + k) * r_k + 2.0 * cross);
        }
        Residual { amplitude: [re, im], power: re * re + im * im, s }
    }

    /// The gain over the noise level at sample `n`, as [`Self::strongest`] sees it; zero outside the frame.
    fn gain_at(&self, n: Option<usize>) -> f32 {
        let Some((n, sample)) = n.and_then(|n| Some((n, self.samples.get(n)?))) else { return 0.0 };
        let (first, active, _) = Reach::new(&self.components).at(n);
        let residual = self.scaled_gain(*sample, n as f32, first, active);
        if residual.s < SMALLEST_S {
            return 0.0;
        }
        residual.power / (residual.s * self.noise.level(n as f32, self.estimator.sample_spacing_s))
    }

    /// The path with the largest gain above kappa.
    fn strongest(&mut self) -> Option<Component> {
        self.work.add_pass(SEARCH, self.samples.len(), self.reached());
        let table = &self.estimator.table;
        let mut best = (None, SCALLOPING * self.threshold);
        let mut walk = LevelWalk::new(self.noise, &self.steps);
        let mut reach = Reach::new(&self.components);
        let mut n = 0;
        while n < self.samples.len() {
            let (first, active, until) = reach.at(n);
            let mut until = until.min(self.samples.len());
            if active.is_empty() {
                let (node, left) = walk.node();
                // The level is nowhere below the white noise but for rounding.
                let quiet = QUIET * (best.1 * self.noise.white);
                if until.saturating_sub(n) >= left && self.cells.below(node, quiet).is_some() {
                    walk.leave_node();
                    n += left.max(1);
                    continue;
                }
                until = until.min(n + left.max(1));
                for (n, sample) in (n..).zip(self.samples.get(n..until).unwrap_or(&[])) {
                    let level = walk.next();
                    let power = power(sample);
                    if power > best.1 * level {
                        best = (Some(n), power / level);
                    }
                }
            } else {
                for (n, sample) in (n..).zip(self.samples.get(n..until).unwrap_or(&[])) {
                    let residual = self.scaled_gain(*sample, n as f32, first, active);
                    let scale = residual.s * walk.next();
                    if residual.power > best.1 * scale && residual.s >= SMALLEST_S {
                        best = (Some(n), residual.power / scale);
                    }
                }
            }
            n = until.max(n + 1);
        }
        let (n, gain) = (best.0?, best.1);
        let vertex = parabola_vertex(self.gain_at(n.checked_sub(1)), gain, self.gain_at(Some(n + 1)));
        let position = n as f32 + vertex;
        let matched = self.estimator.interpolation.at(self.samples, position);
        let residual = self.scaled_gain(matched, position, 0, &self.components);
        let level = self.noise.level(position, self.estimator.sample_spacing_s);
        let s = larger(residual.s, SMALLEST_S);
        let q2 = residual.power / level;
        let gain = larger(gain, q2 / s);
        if gain <= self.threshold {
            return None;
        }
        let mut component = Component::new(position, matched, table);
        component.set_level(level);
        component.prior = larger((q2 - s) / (s * s), 1.0);
        component.amplitude = residual.amplitude;
        component.gain = gain;
        component.threshold = self.threshold;
        Some(component)
    }

    /// Adds a path; false where there is no room.
    fn add(&mut self, component: Component) -> bool {
        if self.components.push(component).is_err() {
            return false;
        }
        sort(&mut self.components);
        if let Some(k) = self.components.iter().position(|other| other.position == component.position) {
            self.wake_neighbours(k);
        }
        true
    }

    /// One pass over the components that have not come to rest: each delay moves to the vertex of the parabola through
    /// the matched filter's energy, without the other components, a quarter sample to either side; twice; and only if
    /// that gains. False where all rest.
    fn move_delays(&mut self) -> bool {
        let mut moved = false;
        for k in 0..self.components.len() {
            let Some(component) = self.components.get_mut(k) else { break };
            if !component.moving {
                continue;
            }
            component.moving = false;
            moved = true;
            let (from, to) = self.neighbours(k);
            let mut furthest = 0.0;
            for _ in 0..2 {
                self.work.add(MOVE, to - from);
                let shift = self.move_delay(k, from, to);
                furthest = larger(furthest, abs(shift));
                if shift == 0.0 {
                    break;
                }
            }
            if furthest >= STILL_SAMPLES {
                self.wake_neighbours(k);
            }
        }
        sort(&mut self.components);
        moved
    }

    /// The components, from and to, whose pulses may reach those of component `k` while it moves.
    fn neighbours(&self, k: usize) -> (usize, usize) {
        let table = &self.estimator.table;
        let far = table.support_samples() + REACH_PULSES * table.samples_per_pulse();
        let position = self.components.get(k).map_or(0.0, |component| component.position);
        let near = |other: &&Component| abs(other.position - position) < far;
        let before = self.components.iter().take(k).rev().take_while(near).count();
        let after = self.components.iter().skip(k + 1).take_while(near).count();
        (k - before, k + 1 + after)
    }

    /// Component `k` came, went or moved: it and its neighbours may move.
    fn wake_neighbours(&mut self, k: usize) {
        let (from, to) = self.neighbours(k);
        for component in self.components.iter_mut().take(to).skip(from) {
            component.moving = true;
        }
    }

    /// Moves one delay; by how much, samples. `from..to` are its neighbours.
    fn move_delay(&mut self, k: usize, from: usize, to: usize) -> f32 {
        let Some(component) = self.components.get(k) else { return 0.0 };
        let present = component.position;
        let interpolation = &self.estimator.interpolation;
        let energy = |position: f32| {
            power(&self.without(k, from, to, position, interpolation.at(self.samples, position)))
        };
        let here = power(&self.without(k, from, to, present, component.matched));
        let step = 0.25;
        let left = energy(present - step);
        let right = energy(present + step);
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
        let position = present + shift;
        let matched = interpolation.at(self.samples, position);
        let amplitude = self.without(k, from, to, position, matched);
        if power(&amplitude) <= here {
            return 0.0;
        }
        let level = self.noise.level(position, self.estimator.sample_spacing_s);
        if let Some(component) = self.components.get_mut(k) {
            component.move_to(position, matched, &self.estimator.table);
            component.set_level(level);
            component.amplitude = amplitude;
        }
        shift
    }

    /// The matched filter's output `matched` at a position without the components `from..to` but `k`.
    fn without(&self, k: usize, from: usize, to: usize, position: f32, matched: Complex) -> Complex {
        let [mut re, mut im] = matched;
        for (j, component) in self.components.iter().enumerate().take(to).skip(from) {
            if j != k {
                let r = self.estimator.table.at(position - component.position);
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
            let Some(dropped) = self.weakest_or_merged() else { break };
            self.wake_neighbours(dropped);
            let mut k = 0;
            self.components.retain(|_| {
                k += 1;
                k - 1 != dropped
            });
        }
        self.solve();
    }

    /// G, and on its diagonal 1 + `ridge`, cluster by cluster inverted into `self.posterior`.
    fn invert_gram(&mut self, ridge: impl Fn(&Component) -> f32) {
        let table = &self.estimator.table;
        let mut from = 0;
        while from < self.components.len() {
            let to = cluster_end(&self.components, from, table);
            for (k, a) in self.components.iter().enumerate().take(to).skip(from) {
                for (l, b) in self.components.iter().enumerate().take(k).skip(from) {
                    self.posterior.set(k, l, table.at(a.position - b.position));
                }
                self.posterior.set(k, k, 1.0 + ridge(a));
            }
            self.posterior.clear_left_of_block(from, to);
            self.posterior.invert_block(from, to);
            self.work.add_solution(to - from);
            from = to;
        }
    }

    /// Sigma and the posterior amplitudes.
    fn solve(&mut self) {
        self.invert_gram(|component| 1.0 / component.prior);
        let mut from = 0;
        while from < self.components.len() {
            let to = cluster_end(&self.components, from, &self.estimator.table);
            for k in from..to {
                let mut mean = [0.0, 0.0];
                for (l, other) in self.components.iter().enumerate().take(to).skip(from) {
                    let scale = self.posterior.at(k, l) / other.unit;
                    let [re, im] = other.matched;
                    mean = [mean[0] + scale * re, mean[1] + scale * im];
                }
                if let Some(component) = self.components.get_mut(k) {
                    component.amplitude = [mean[0] * component.unit, mean[1] * component.unit];
                }
            }
            from = to;
        }
    }

    /// Gain and prior variance of each component, as if it were added last. With D = diag(1/g) and
    /// G = Sigma^-1 - D, the textbook's S and Q become S = (1 - Sigma_kk / g) / g and Q = mu_k / g, so that
    /// s = S / (1 - g S) = 1 / Sigma_kk - 1 / g and q = Q / (1 - g S) = mu_k / Sigma_kk.
    fn reestimate(&mut self) {
        for (k, component) in self.components.iter_mut().enumerate() {
            // Never less than alone: where rounding says so, the Gram matrix was near singular.
            let alone = 1.0 + 1.0 / component.prior;
            let sigma = larger(self.posterior.at(k, k), 1.0 / alone);
            let s = larger(1.0 / sigma - 1.0 / component.prior, SMALLEST_S);
            let q2 = power(&component.amplitude) / (component.level * (sigma * sigma));
            component.gain = q2 / s;
            component.prior = larger((q2 - s) / (s * s), LEAST_PRIOR);
        }
    }

    /// The component to drop: the weakest of those below kappa, or the weaker of two that ran together.
    fn weakest_or_merged(&self) -> Option<usize> {
        let mut drop: Option<(usize, f32)> = None;
        for (k, component) in self.components.iter().enumerate() {
            if component.gain < component.threshold && drop.is_none_or(|(_, gain)| component.gain < gain) {
                drop = Some((k, component.gain));
            }
        }
        if drop.is_none() {
            let merge = self.estimator.settings.merge_pulses * self.estimator.table.samples_per_pulse();
            for (k, pair) in self.components.windows(2).enumerate() {
                if let [a, b] = pair
                    && b.position - a.position < merge
                {
                    return Some(if b.gain < a.gain { k + 1 } else { k });
                }
            }
        }
        drop.map(|(k, _)| k)
    }

    /// Paths with their final amplitudes, by least squares (no shrinkage), in order of delay.
    fn take_paths(mut self, first_sample_delay_s: f32, paths: &mut Vec<Path, PATHS>) {
        self.invert_gram(|_| RIDGE);
        let mut from = 0;
        while from < self.components.len() {
            let to = cluster_end(&self.components, from, &self.estimator.table);
            for (k, component) in self.components.iter().enumerate().take(to).skip(from) {
                let mut amplitude = [0.0, 0.0];
                for (l, other) in self.components.iter().enumerate().take(to).skip(from) {
                    let weight = self.posterior.at(k, l);
                    let [re, im] = other.matched;
                    amplitude = [amplitude[0] + weight * re, amplitude[1] + weight * im];
                }
                // A pulse cut off at its table's end can make G singular: then the posterior mean is all there is.
                if !(power(&amplitude) < f32::MAX) {
                    amplitude = component.amplitude;
                }
                let sinr = larger(component.gain - 1.0, LEAST_SINR);
                let path = self.estimator.path(component.position, first_sample_delay_s, amplitude, sinr);
                // Capacities are equal: every push succeeds.
                let _ = paths.push(path);
            }
            from = to;
        }
    }
}

/// What is left of the matched filter's output at a delay, its power, and s, what a path there would still explain.
struct Residual {
    amplitude: Complex,
    power: f32,
    s: f32,
}

/// |z|^2.
fn power(sample: &Complex) -> f32 {
    let [re, im] = *sample;
    re * re + im * im
}

/// Offset of the vertex of the parabola through three equidistant values whose middle one is the largest;
/// within -0.5 to 0.5.
fn parabola_vertex(before: f32, here: f32, after: f32) -> f32 {
    let curvature = before - 2.0 * here + after;
    if curvature < 0.0 { 0.5 * (before - after) / curvature } else { 0.0 }
}
