//! Strength of paths: how probable an energy over the level is, where a path of some SINR is.
//!
//! The amplitude of a path is complex Gaussian from frame to frame, as its phase and those of unresolved neighbours turn. So with
//! the mean SINR s, z is exponentially distributed with mean 1 + s, and more probable than in noise by
//!
//! T_s(z) = exp(z s / (1 + s)) / (1 + s);
//!
//! it stays below the detector's threshold kappa with probability P_s = 1 - exp(-kappa / (1 + s)), and given that it does, z is
//! T_s(z) / P_s times as probable. SINRs are known within some dB only: they are shared out over a few classes.

use crate::real::{abs, exp, limited, smaller};
use crate::snapshot::stored;

/// Mathematics: grid of SINRs: classes.
pub const CLASSES: usize = 5;
/// Mathematics: ln SINR of the first class: 0 dB. A weaker path hardly differs from noise.
pub const FIRST_LN: f32 = 0.0;
/// Mathematics: grid of SINRs: step as ln, 7.5 dB.
pub const STEP_LN: f32 = 1.726_939;
/// Mathematics: digits of an energy in sixteenths, as two hexadecimal ones.
const DIGITS: usize = 16;

/// T_s(z) / P_s of every class of SINR s, by energies in steps of [`crate::perceptor::channel_estimator::residual::STEPS`].
#[derive(Clone, Debug)]
pub struct Likelihoods {
    /// exp(z s / (1 + s)) of both digits of z.
    high: [[f32; CLASSES]; DIGITS],
    low: [[f32; CLASSES]; DIGITS],
    /// 1 / (1 + s) / P_s.
    scales: [f32; CLASSES],
    /// Probability that such a path is not found.
    missed: [f32; CLASSES],
}

impl Likelihoods {
    /// Below this threshold on the energy of a path.
    pub fn new(threshold: f32) -> Self {
        let mut own = Self {
            high: [[1.0; CLASSES]; DIGITS],
            low: [[1.0; CLASSES]; DIGITS],
            scales: [1.0; CLASSES],
            missed: [1.0; CLASSES],
        };
        let mut steps = [[1.0; 2]; CLASSES];
        let classes = own.scales.iter_mut().zip(&mut own.missed).zip(&mut steps);
        for (class, ((scale, missed), step)) in classes.enumerate() {
            let share = 1.0 / (1.0 + exp(FIRST_LN + STEP_LN * class as f32));
            *missed = 1.0 - exp(-threshold * share);
            *scale = share / *missed;
            let slope = 1.0 - share;
            *step = [exp(slope), exp(slope / DIGITS as f32)];
        }
        let mut last = [[1.0; 2]; CLASSES];
        for (high, low) in own.high.iter_mut().zip(&mut own.low) {
            let digits = high.iter_mut().zip(low);
            for (((high, low), last), step) in digits.zip(&mut last).zip(&steps) {
                (*high, *low) = (last[0], last[1]);
                *last = [last[0] * step[0], last[1] * step[1]];
            }
        }
        own
    }

    /// T_s(z) / P_s of every class.
    pub fn of(&self, energy: u8) -> [f32; CLASSES] {
        let mut ratios = self.scales;
        if let Some((high, low)) = self.digits(energy) {
            for ((ratio, high), low) in ratios.iter_mut().zip(high).zip(low) {
                *ratio *= high * low;
            }
        }
        ratios
    }

    /// exp(z s / (1 + s)) of both digits of z: both are there.
    fn digits(&self, energy: u8) -> Option<(&[f32; CLASSES], &[f32; CLASSES])> {
        let (high, low) = (usize::from(energy) / DIGITS, usize::from(energy) % DIGITS);
        Some((self.high.get(high)?, self.low.get(low)?))
    }
}

/// What is known of the SINR of a path that was not found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Strength {
    /// Probability of every class, among those that were not found.
    weights: [f32; CLASSES],
    /// Probability that such a path is not found.
    pub missed: f32,
}

impl Strength {
    /// About this ln SINR, within about `steps` steps of the classes: shared out by the cubic B-spline, a Gaussian of the standard
    /// deviation 0.58 steps.
    pub fn about(sinr_ln: f32, steps: f32, likelihoods: &Likelihoods) -> Self {
        let most = (CLASSES - 1) as f32;
        let place = limited((sinr_ln - FIRST_LN) / STEP_LN, 0.0, most);
        let mut weights = [0.0; CLASSES];
        let (mut sum, mut missed) = (0.0, 0.0);
        for (class, (weight, own_missed)) in weights.iter_mut().zip(&likelihoods.missed).enumerate() {
            let prior = cubic(abs(class as f32 - place) / steps);
            *weight = prior * own_missed;
            sum += prior;
            missed += *weight;
        }
        for weight in &mut weights {
            *weight /= missed;
        }
        Self { weights, missed: missed / sum }
    }

    /// How much more probable an energy is where a path of this strength was not found than where there is `background`: on average
    /// over energies below the threshold, distributed as in the background, 1.
    pub fn ratio(&self, energy: u8, likelihoods: &Likelihoods, background: &Background) -> f32 {
        let Some((high, low)) = likelihoods.digits(energy) else { return 1.0 };
        let (mut path, mut rest) = (0.0, background.noise);
        let shares = self.weights.iter().zip(&background.paths);
        for (((weight, share), scale), (high, low)) in
            shares.zip(&likelihoods.scales).zip(high.iter().zip(low))
        {
            // Of T_s(z) / P_s, as in [`Likelihoods::of`].
            let ratio = scale * (high * low);
            path += weight * ratio;
            rest += share * ratio;
        }
        path / rest
    }
}

/// The cubic B-spline but for its height.
fn cubic(x: f32) -> f32 {
    if x < 1.0 {
        4.0 - x * x * (6.0 - 3.0 * x)
    } else {
        let rest = 2.0 - smaller(x, 2.0);
        rest * rest * rest
    }
}

/// What the residual is made of where no source is expected: of noise, and of paths that are in no map, side lobes and what else was
/// badly subtracted, by class of SINR. It sums to 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Background {
    /// Share of noise alone.
    pub noise: f32,
    /// Share of every class.
    pub paths: [f32; CLASSES],
}

impl Background {
    /// That of a tracker that is not started.
    pub(crate) const NONE: Self = Self { noise: 0.0, paths: [0.0; CLASSES] };
    /// Before anything was seen: one point in ten has more than noise, half as many the stronger.
    pub const USUAL: Self = Self { noise: 0.9, paths: [0.052, 0.026, 0.013, 0.0065, 0.0025] };

    /// Of what, probably, an energy is one.
    pub fn posterior(&self, energy: u8, likelihoods: &Likelihoods) -> Self {
        let mut own = Self { noise: self.noise, paths: likelihoods.of(energy) };
        let mut sum = own.noise;
        for (path, share) in own.paths.iter_mut().zip(&self.paths) {
            *path *= share;
            sum += *path;
        }
        own.noise /= sum;
        own.paths.iter_mut().for_each(|path| *path /= sum);
        own
    }

    /// Mixes another one in, with this share.
    pub fn mix(&mut self, other: &Self, share: f32) {
        self.noise += share * (other.noise - self.noise);
        for (own, other) in self.paths.iter_mut().zip(&other.paths) {
            *own += share * (other - *own);
        }
    }
}

stored!(Background { noise, paths } told {});

#[cfg(test)]
mod tests {
    use super::*;

    const THRESHOLD: f32 = 8.5;

    /// The mean of a function of the energy over exponential distributions cut off at the threshold: noise, and paths of these shares.
    fn mean(background: &Background, of: impl Fn(u8) -> f32) -> f64 {
        let (mut sum, mut all) = (0.0, 0.0);
        for step in 0..(16.0 * THRESHOLD) as u8 {
            let z = (f64::from(step) + 0.5) / 16.0;
            let mut density = f64::from(background.noise) * (-z).exp();
            for (class, share) in background.paths.iter().enumerate() {
                let s = f64::from(FIRST_LN + STEP_LN * class as f32).exp();
                let missed = 1.0 - (-f64::from(THRESHOLD) / (1.0 + s)).exp();
                density += f64::from(*share) * (-z / (1.0 + s)).exp() / (1.0 + s) / missed;
            }
            // At the middle of a step, between two codes.
            let ratio = 0.5 * (f64::from(of(step)) + f64::from(of(step + 1)));
            sum += density * ratio;
            all += density;
        }
        sum / all
    }

    #[test]
    fn likelihoods_are_those_of_exponential_distributions() {
        let likelihoods = Likelihoods::new(THRESHOLD);
        for energy in [0, 1, 15, 16, 37, 136, 254] {
            let z = f64::from(energy) / 16.0;
            for (class, ratio) in likelihoods.of(energy).into_iter().enumerate() {
                let s = f64::from(FIRST_LN + STEP_LN * class as f32).exp();
                let missed = 1.0 - (-f64::from(THRESHOLD) / (1.0 + s)).exp();
                let exact = (-z / (1.0 + s)).exp() / (1.0 + s) / missed / (-z).exp();
                assert!((f64::from(ratio) / exact - 1.0).abs() < 1e-4, "{energy} {class}: {ratio} {exact}");
            }
        }
    }

    #[test]
    fn without_a_path_its_likelihood_is_one_on_average_whatever_the_background() {
        let likelihoods = Likelihoods::new(THRESHOLD);
        let quiet = Background { noise: 1.0, paths: [0.0; CLASSES] };
        let busy = Background { noise: 0.5, paths: [0.2, 0.15, 0.1, 0.03, 0.02] };
        for background in [quiet, Background::USUAL, busy] {
            for sinr_ln in [-3.0, 0.0, 1.2, 3.5, 9.0] {
                for steps in [1.0, 2.0] {
                    let strength = Strength::about(sinr_ln, steps, &likelihoods);
                    let mean = mean(&background, |energy| strength.ratio(energy, &likelihoods, &background));
                    assert!((mean - 1.0).abs() < 0.01, "{sinr_ln} {steps}: {mean}");
                    // Where there is one, it is more.
                    let there = strength.ratio(100, &likelihoods, &background);
                    assert!(sinr_ln < 1.0 || there > 1.0, "{sinr_ln} {steps}: {there}");
                }
            }
        }
    }

    #[test]
    fn a_busy_background_takes_an_energy_for_less() {
        let likelihoods = Likelihoods::new(THRESHOLD);
        let strength = Strength::about(2.5, 1.0, &likelihoods);
        let ratio = |noise: f32| {
            let busy = Background { noise, paths: [(1.0 - noise) / CLASSES as f32; CLASSES] };
            strength.ratio(96, &likelihoods, &busy)
        };
        let [quiet, usual, busy] = [1.0, 0.95, 0.5].map(ratio);
        assert!(quiet > 2.0 * usual && usual > 2.0 * busy, "{quiet} {usual} {busy}");
    }

    #[test]
    fn the_background_learns_what_there_is() {
        let likelihoods = Likelihoods::new(THRESHOLD);
        let truth = Background { noise: 0.7, paths: [0.0, 0.3, 0.0, 0.0, 0.0] };
        let mut own = Background::USUAL;
        for _ in 0..400 {
            // The mean posterior over the truth's energies.
            let part = |of: &dyn Fn(&Background) -> f32| {
                mean(&truth, |energy| of(&own.posterior(energy, &likelihoods))) as f32
            };
            let learnt = Background {
                noise: part(&|posterior| posterior.noise),
                paths: core::array::from_fn(|class| part(&|posterior| posterior.paths[class])),
            };
            own.mix(&learnt, 0.3);
        }
        let sum = own.noise + own.paths.iter().sum::<f32>();
        assert!((sum - 1.0).abs() < 1e-3, "{sum}");
        let strength = Strength::about(2.5, 1.0, &likelihoods);
        let mean = mean(&truth, |energy| strength.ratio(energy, &likelihoods, &own));
        let wrong = Background { noise: 1.0, paths: [0.0; CLASSES] };
        let unlearnt = super::tests::mean(&truth, |energy| strength.ratio(energy, &likelihoods, &wrong));
        assert!((mean - 1.0).abs() < 0.01 && unlearnt > 1.5, "{mean} {unlearnt} {own:?}");
    }
}
