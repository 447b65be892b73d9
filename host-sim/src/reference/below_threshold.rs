//! Below the threshold: what the rest of a frame says of the sources whose paths were not found.
//!
//! With the SINR s, an energy z over the level is T_s(z) = exp(z s / (1 + s)) / (1 + s) times as probable as in noise, over P_s where
//! it is known to be below the threshold, where it is with probability P_s. SINRs are
//! shared out over a few classes, and the rest of a frame is noise and paths of these classes where no source is expected. With the
//! prediction N(r) of a length and g(r) = 1 - e + e rho(z(r)), the missed source is W, the mean of g, times as probable, and mean and variance
//! of N g are what is known of r afterwards; all to the power that a frame soon after the last counts.

use super::association::outcome::Outcome;
use super::channel_estimator::Residual;
use super::known::Expected;
use super::real::{Real, abs, exp, larger, limited, ln, smaller, sqrt, square};
use super::state_filter::{Reading, StateFilter};
use cogmint_core::perceptor::below_threshold::strength::{self, CLASSES, FIRST_LN, STEP_LN};
use cogmint_core::perceptor::below_threshold::{
    APART_PULSES, LEAST_CHANGE, LEAST_PRESENCE, LEAST_RATIO, NODE_STD, NODE_SUMS, NODES, SEEN_STEPS,
    UNSEEN_STEPS, VARIANCE_LEFT,
};
use cogmint_core::radio::pulse::MERGED;

/// What residuals are made of where nothing is expected: noise, and each class of paths.
#[derive(Clone, Debug)]
pub struct Background<T> {
    /// Share of noise alone.
    pub noise: T,
    /// Share of every class.
    pub paths: Vec<T>,
}

impl<T: Real> Background<T> {
    /// Before anything was seen.
    pub fn usual() -> Self {
        let usual = strength::Background::USUAL;
        Self { noise: T::of(usual.noise), paths: usual.paths.map(T::of).to_vec() }
    }

    /// own + share (other - own).
    pub fn mix(&mut self, other: &Self, share: T) {
        self.noise += share * (other.noise - self.noise);
        for class in 0..CLASSES {
            let own = self.paths[class];
            self.paths[class] = own + share * (other.paths[class] - own);
        }
    }
}

/// T_s of the classes.
struct Classes<T> {
    /// 1 / (1 + s).
    shares: Vec<T>,
    /// Probability that such a path is not found.
    missed: Vec<T>,
}

impl<T: Real> Classes<T> {
    fn new(threshold: T) -> Self {
        let sinr = |class: usize| exp(T::of(FIRST_LN) + T::of(STEP_LN) * T::of_count(class));
        let shares: Vec<T> = (0..CLASSES).map(|class| T::ONE / (T::ONE + sinr(class))).collect();
        let missed = shares.iter().map(|share| T::ONE - exp(-threshold * *share)).collect();
        Self { shares, missed }
    }

    /// T_s(z) / P_s. Order: the exponential by repeated multiplication, for each of two hexadecimal digits of z.
    fn ratio(&self, class: usize, energy: u8) -> T {
        let slope = T::ONE - self.shares[class];
        let scale = self.shares[class] / self.missed[class];
        let power = |base: T, times: u8| (0..times).fold(T::ONE, |product, _| product * base);
        let (high, low) = (power(exp(slope), energy / 16), power(exp(slope / T::of(16.0)), energy % 16));
        scale * (high * low)
    }
}

/// What is assumed of the SINR of a source.
struct Strength<T> {
    /// Probabilities of the classes among the paths that were missed.
    weights: Vec<T>,
    missed: T,
}

impl<T: Real> Strength<T> {
    fn new(expected: &Expected<T>, classes: &Classes<T>) -> Self {
        let steps = T::of(if expected.is_seen { SEEN_STEPS } else { UNSEEN_STEPS });
        let most = T::of_count(CLASSES - 1);
        let place = limited((expected.sinr_ln - T::of(FIRST_LN)) / T::of(STEP_LN), T::ZERO, most);
        let mut weights = Vec::new();
        let (mut all, mut missed) = (T::ZERO, T::ZERO);
        for class in 0..CLASSES {
            let prior = cubic_spline(abs(T::of_count(class) - place) / steps);
            all += prior;
            weights.push(prior * classes.missed[class]);
            missed += weights[class];
        }
        Self { weights: weights.into_iter().map(|weight| weight / missed).collect(), missed: missed / all }
    }
}

/// Six times the cubic B-spline.
fn cubic_spline<T: Real>(x: T) -> T {
    if x < T::ONE {
        T::of(4.0) - x * x * (T::of(6.0) - T::of(3.0) * x)
    } else {
        let rest = T::of(2.0) - smaller(x, T::of(2.0));
        rest * rest * rest
    }
}

/// Reads the rest of a scan's frame.
pub struct Reader<'a, T> {
    residual: &'a Residual<T>,
    background: &'a Background<T>,
    classes: Classes<T>,
    pulse_m: T,
    exponent: T,
}

impl<'a, T: Real> Reader<'a, T> {
    /// For an outcome's scan; `exponent` is what its frame counts.
    pub fn new(
        residual: &'a Residual<T>,
        background: &'a Background<T>,
        [threshold, pulse_m]: [T; 2],
        exponent: T,
    ) -> Self {
        Self { residual, background, classes: Classes::new(threshold), pulse_m, exponent }
    }

    /// Updates a filter by an associated scan and by what is left; returns ln W of all.
    pub fn update(&self, filter: &mut StateFilter<T>, outcome: &mut Outcome<T>) -> T {
        let mut evidence_nat = T::ZERO;
        let mut rests = vec![T::ONE; outcome.expected.len()];
        let mut before: Vec<(T, T)> = Vec::new();
        let mut asked = Vec::new();
        let outage = outcome.beliefs.outage;
        for (k, expected) in outcome.expected.iter().enumerate() {
            let missed = outcome.beliefs.features[k].missed - outage;
            let present = expected.feature.existence * expected.present;
            if missed * present > T::of(LEAST_PRESENCE) {
                asked.push((expected.regression, (k, missed, present)));
            }
        }
        let innovations = outcome.innovations();
        let expected = &outcome.expected;
        filter.update_and_read(&innovations, &asked, |(k, missed, present), range_m, variance_m2| {
            if variance_m2 > square(self.pulse_m) {
                return None;
            }
            let strength = Strength::new(&expected[k], &self.classes);
            let there = present * strength.missed / (T::ONE - present * (T::ONE - strength.missed));
            let std_m = sqrt(variance_m2);
            let [mean, ratio, shift, variance] = self.look(&strength, there, range_m, std_m);
            // What one path may be shares it: sources, and what is in no map.
            let mut sharing = T::ONE + (T::ONE - self.background.noise);
            for (other_m, other) in &before {
                let lag = abs(*other_m - range_m) / self.pulse_m;
                if lag < T::of(APART_PULSES) {
                    sharing += *other * exp(-square(lag / T::of(MERGED)));
                }
            }
            before.push((range_m, present));
            let exponent = self.exponent / sharing;
            rests[k] = exp(exponent * ln(larger(mean, T::of(LEAST_RATIO))));
            let ratio = exp(exponent * ln(ratio));
            let all = T::ONE - missed * (T::ONE - ratio);
            evidence_nat += ln(all);
            let precision = T::ONE + exponent * (T::ONE / variance - T::ONE);
            let shift = exponent * shift / variance / precision;
            let least = T::of(LEAST_CHANGE);
            if abs(shift) <= least && abs(precision - T::ONE) <= least {
                return None;
            }
            Some(Reading {
                probability: missed * ratio / all,
                shift_m: std_m * shift,
                variance_m2: variance_m2 / precision,
            })
        });
        for (belief, rest) in outcome.beliefs.features.iter_mut().zip(rests) {
            belief.rest = rest;
        }
        evidence_nat
    }

    /// rho(z).
    fn rho(&self, strength: &Strength<T>, energy: u8) -> T {
        let (mut path, mut rest) = (T::ZERO, self.background.noise);
        for class in 0..CLASSES {
            let ratio = self.classes.ratio(class, energy);
            path += strength.weights[class] * ratio;
            rest += self.background.paths[class] * ratio;
        }
        path / rest
    }

    /// Mean of rho; W; mean and variance of N g, over the predicted deviation and variance.
    fn look(&self, strength: &Strength<T>, there: T, range_m: T, std_m: T) -> [T; 4] {
        let mut sums = [T::ZERO; 3];
        // Order: the middle, then outwards, above before below.
        for (node, weight) in NODES.iter().enumerate() {
            let away = T::of(NODE_STD) * T::of_count(node);
            for deviation in if node == 0 { vec![away] } else { vec![away, -away] } {
                let energy = self.residual.energy(range_m + deviation * std_m);
                let weighted = T::of(*weight) * energy.map_or(T::ONE, |energy| self.rho(strength, energy));
                sums[0] += weighted;
                sums[1] += weighted * deviation;
                sums[2] += weighted * square(deviation);
            }
        }
        let mean = sums[0] / T::of(NODE_SUMS[0]);
        let ratio = T::ONE - there * (T::ONE - mean);
        let shift = there * (sums[1] / T::of(NODE_SUMS[0])) / ratio;
        let squares = ((T::ONE - there) + there * (sums[2] / T::of(NODE_SUMS[1]))) / ratio;
        let [least, most] = VARIANCE_LEFT.map(T::of);
        [mean, ratio, shift, limited(squares - square(shift), least, most)]
    }

    /// Of what the residual is where nothing is expected: 1.25 times a pulse and two deviations before and after each source that may
    /// be there, and not so near to any other.
    pub fn beside(&self, expected: &[Expected<T>]) -> Option<Background<T>> {
        let width = |own: &Expected<T>| self.pulse_m + T::of(2.0) * sqrt(own.regression.variance_m2());
        let first_m = expected[0].regression.range_m - self.pulse_m;
        let mut mean: Option<Background<T>> = None;
        let mut count = T::ZERO;
        for own in expected {
            let is_wide = own.regression.variance_m2() > square(self.pulse_m);
            if is_wide || own.present < T::of(LEAST_PRESENCE) {
                continue;
            }
            let away_m = T::of(1.25) * width(own);
            for at_m in [own.regression.range_m - away_m, own.regression.range_m + away_m] {
                let near = |other: &Expected<T>| {
                    let past_m = abs(other.regression.range_m - at_m) - self.pulse_m;
                    past_m < T::ZERO || square(past_m) < T::of(4.0) * other.regression.variance_m2()
                };
                if at_m < first_m || expected.iter().any(near) {
                    continue;
                }
                let Some(energy) = self.residual.energy(at_m) else { continue };
                let posterior = self.posterior(energy);
                count += T::ONE;
                match &mut mean {
                    None => mean = Some(posterior),
                    Some(mean) => mean.mix(&posterior, T::ONE / count),
                }
            }
        }
        mean
    }

    /// Probabilities of what an energy beside the sources is.
    fn posterior(&self, energy: u8) -> Background<T> {
        let prior = self.background;
        let mut noise = prior.noise;
        let mut paths = Vec::new();
        let mut all = noise;
        for class in 0..CLASSES {
            let path = self.classes.ratio(class, energy) * prior.paths[class];
            all += path;
            paths.push(path);
        }
        noise /= all;
        Background { noise, paths: paths.into_iter().map(|path| path / all).collect() }
    }
}
