//! Below the threshold: what the rest of a frame says of sources whose paths were not found.
//!
//! A path that is too weak to be told from noise anywhere in a frame may still be told from it where it is expected. With r the
//! length of the path, N(r; mean, S) what is predicted of it, z(r) the energy that is left there
//! ([`crate::perceptor::channel_estimator::residual`]) and rho(z) how much more probable that is if the path is there and was not
//! found ([`strength`]), the outcome "missed" is more probable than without the rest of the frame by
//!
//! W = integral of N(r) g(r), g(r) = 1 - e + e rho(z(r)),
//!
//! e being the probability that the path is there, given that it was not found. W is 1 on average where there is none. Mean and
//! variance of N g are what is known of r afterwards, and move tag and map as a measured range does. The prediction is that after
//! what was found: the better the tag is known, the narrower it is looked for.
//!
//! **Alike.** The paths that disturb others change only as the tag walks by: frame after frame tells less than frames apart, as of
//! the paths found ([`Ranging`](crate::model::measurement::Ranging)), and likelihoods are raised to a power below 1. Those that one
//! path may be share it likewise: other sources, and paths that are in no map.

pub mod strength;

use self::strength::{Background, Likelihoods, Strength};
use super::association::Beliefs;
use super::association::outcome::AssociatedScan;
use super::channel_estimator::residual::Residual;
use super::expectation::View;
use super::scan::Scan;
use super::state_filter::Reading;
use crate::model::range::Regression;
use crate::radio::pulse::unresolved;
use crate::real::{abs, exp, larger, limited, ln, sqrt};
use heapless::Vec;

/// Mathematics: weights of the nodes of the quadrature over a Gaussian: at 0, and at so many times [`NODE_STD`] on either side.
pub const NODES: [f32; 6] = [1.0, 0.835_270_2, 0.486_752_3, 0.197_898_7, 0.056_134_8, 0.011_109];
/// Mathematics: grid step of the nodes, standard deviations.
pub const NODE_STD: f32 = 0.6;
/// Mathematics: sum of all weights, and of them times squared deviations.
pub const NODE_SUMS: [f32; 2] = [4.174_33, 4.132_259];
/// Guard: against work on what says hardly anything: least probability that a path is there and was not found.
pub const LEAST_PRESENCE: f32 = 0.02;
/// Guard: against work on what changes hardly anything: least change of mean or variance, predicted deviations or variances.
pub const LEAST_CHANGE: f32 = 0.02;
/// Guard: against what a few nodes make of a narrow peak, and of two: bounds of the variance left, predicted variances.
pub const VARIANCE_LEFT: [f32; 2] = [0.02, 1.5];
/// Guard: against certainty from one frame: least likelihood of what is left where the path is there.
pub const LEAST_RATIO: f32 = 0.01;
/// Mathematics: how far ln SINR of a source that frames have shown may be from what is remembered, in steps of the classes.
pub const SEEN_STEPS: f32 = 1.0;
/// Mathematics: the same of one that none has shown.
pub const UNSEEN_STEPS: f32 = 2.0;
/// Mathematics: beyond this many pulse durations no path is mistaken for another.
pub const APART_PULSES: f32 = 2.0;

/// Reads what is left of a frame.
#[derive(Clone, Debug)]
pub struct Reader<'a, const POINTS: usize> {
    residual: &'a Residual<POINTS>,
    background: &'a Background,
    likelihoods: Likelihoods,
    pulse_m: f32,
    /// Power to which likelihoods are raised.
    exponent: f32,
}

/// A source that was probably missed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Missed {
    /// Its number among the features of the scan: 0 for the direct path.
    feature: usize,
    /// Probability that it was missed.
    missed: f32,
    /// Probability, before the scan, that its path is there.
    present: f32,
    /// SINR that it has then, and whether a frame has shown it.
    sinr: f32,
    is_seen: bool,
}

/// The sources of a scan that were probably missed, with their regressions.
pub fn missed<'o, const SOURCES: usize, const PATHS: usize>(
    outcome: &'o AssociatedScan<'_, SOURCES, PATHS>,
) -> impl Iterator<Item = (&'o Regression, Missed)> {
    let AssociatedScan { expected, beliefs, .. } = outcome;
    let sources = expected.views().zip(expected.existences());
    let features = outcome.features().zip(sources).enumerate();
    features.filter_map(|(feature, ((regression, belief), (view, existence)))| {
        // An anchor that is out says nothing of what is there.
        let missed = belief.missed - beliefs.outage;
        let present = existence * view.present;
        let View { sinr_now: sinr, is_seen, .. } = *view;
        let source = Missed { feature, missed, present, sinr, is_seen };
        (missed * present > LEAST_PRESENCE).then_some((regression, source))
    })
}

/// What was looked at in a frame, and what came out.
#[derive(Clone, Debug)]
pub struct Looks<'a, const POINTS: usize, const SOURCES: usize> {
    reader: &'a Reader<'a, POINTS>,
    /// Where, metres, and how probably something is there.
    looked: Vec<(f32, f32), SOURCES>,
    /// How much more probable what is left is if the path is there: of the direct path, and of the others.
    rests: (f32, [f32; SOURCES]),
    evidence_nat: f32,
}

impl<const POINTS: usize, const SOURCES: usize> Looks<'_, POINTS, SOURCES> {
    /// Looks for a source that is expected at this range, metres, with this variance, square metres; `None` where that says nothing
    /// new of it.
    pub fn look(&mut self, source: &Missed, range_m: f32, variance_m2: f32) -> Option<Reading> {
        let reader = self.reader;
        let Missed { feature, missed, present, .. } = *source;
        if variance_m2 > reader.pulse_m * reader.pulse_m {
            return None;
        }
        let strength = reader.strength(source);
        let there = present * strength.missed / (1.0 - present * (1.0 - strength.missed));
        let std_m = sqrt(variance_m2);
        let look = reader.look(&strength, there, range_m, std_m);
        let mut sharing = 1.0 + (1.0 - reader.background.noise);
        for (other_m, other) in &self.looked {
            let lag = abs(other_m - range_m) / reader.pulse_m;
            if lag < APART_PULSES {
                sharing += other * unresolved(lag);
            }
        }
        // Where there is no room, the rest share less.
        let _ = self.looked.push((range_m, present));
        let exponent = reader.exponent / sharing;
        let raised = |ratio: f32| exp(exponent * ln(ratio));
        let rest = match feature.checked_sub(1) {
            None => Some(&mut self.rests.0),
            Some(image) => self.rests.1.get_mut(image),
        };
        if let Some(rest) = rest {
            *rest = raised(larger(look.mean, LEAST_RATIO));
        }
        let ratio = raised(look.ratio);
        let total = 1.0 - missed * (1.0 - ratio);
        self.evidence_nat += ln(total);
        // To a power: the precision gained, and what the mean moves by it.
        let precision = 1.0 + exponent * (1.0 / look.variance - 1.0);
        let shift = exponent * look.shift / look.variance / precision;
        let is_news = abs(shift) > LEAST_CHANGE || abs(precision - 1.0) > LEAST_CHANGE;
        is_news.then_some(Reading {
            probability: missed * ratio / total,
            shift_m: std_m * shift,
            variance_m2: variance_m2 / precision,
        })
    }

    /// How many sources were looked for.
    pub fn count(&self) -> usize {
        self.looked.len()
    }

    /// Notes in the beliefs what is left of the frame, and returns ln of how much more probable that is than without paths.
    pub fn note<const PATHS: usize>(self, beliefs: &mut Beliefs<SOURCES, PATHS>) -> f32 {
        let (of_direct, rests) = self.rests;
        beliefs.direct.rest = of_direct;
        for (belief, rest) in beliefs.virtual_anchors.iter_mut().zip(rests) {
            belief.rest = rest;
        }
        self.evidence_nat
    }
}

/// What there is where a path is looked for.
#[derive(Clone, Copy, Debug)]
struct Look {
    /// Mean of rho.
    mean: f32,
    /// W.
    ratio: f32,
    /// Mean and variance of N g over the predicted deviation and variance.
    shift: f32,
    variance: f32,
}

impl<'a, const POINTS: usize> Reader<'a, POINTS> {
    /// Of what is left of the frame in a scan, beside that background; a frame tells this `share` of what one would that comes long
    /// after the last.
    pub fn new<const PATHS: usize>(
        scan: &Scan<PATHS>,
        residual: &'a Residual<POINTS>,
        background: &'a Background,
        share: f32,
    ) -> Self {
        let likelihoods = Likelihoods::new(scan.threshold());
        Self { residual, background, likelihoods, pulse_m: scan.resolution_m(), exponent: share }
    }

    /// Begins to look for the sources of a scan.
    pub fn begin<const SOURCES: usize>(&self) -> Looks<'_, POINTS, SOURCES> {
        Looks { reader: self, looked: Vec::new(), rests: (1.0, [1.0; SOURCES]), evidence_nat: 0.0 }
    }

    fn strength(&self, source: &Missed) -> Strength {
        let steps = if source.is_seen { SEEN_STEPS } else { UNSEEN_STEPS };
        Strength::about(ln(larger(source.sinr, f32::MIN_POSITIVE)), steps, &self.likelihoods)
    }

    /// Looks for a path of this strength, which is there with this probability, where it is expected.
    fn look(&self, strength: &Strength, there: f32, range_m: f32, std_m: f32) -> Look {
        let (mut of_path, mut first, mut second) = (0.0, 0.0, 0.0);
        let mut look = |deviation: f32, weight: f32| {
            let ratio = match self.residual.energy(range_m + deviation * std_m) {
                Some(energy) => strength.ratio(energy, &self.likelihoods, self.background),
                None => 1.0,
            };
            let weighted = weight * ratio;
            of_path += weighted;
            first += weighted * deviation;
            second += weighted * (deviation * deviation);
        };
        for (node, weight) in NODES.into_iter().enumerate() {
            let deviation = NODE_STD * node as f32;
            look(deviation, weight);
            if node > 0 {
                look(-deviation, weight);
            }
        }
        let [sum, squares] = NODE_SUMS;
        let mean = of_path / sum;
        let ratio = 1.0 - there * (1.0 - mean);
        let shift = there * (first / sum) / ratio;
        let square = ((1.0 - there) + there * (second / squares)) / ratio;
        let [least, most] = VARIANCE_LEFT;
        Look { mean, ratio, shift, variance: limited(square - shift * shift, least, most) }
    }

    /// What there is where none of the sources of a scan is expected, a little more than a pulse beside them; `None` where there is no
    /// such place. To be asked from where the tag surely is.
    pub fn background<const SOURCES: usize, const PATHS: usize>(
        &self,
        outcome: &AssociatedScan<'_, SOURCES, PATHS>,
    ) -> Option<Background> {
        let expected = &outcome.expected;
        let is_beside = |other: &Regression, at_m: f32| {
            let past_m = abs(other.range_m - at_m) - self.pulse_m;
            past_m < 0.0 || past_m * past_m < 4.0 * other.variance_m2()
        };
        let first_m = expected.direct.range_m - self.pulse_m;
        let mut mean: Option<Background> = None;
        let mut count = 0.0;
        for (regression, view) in expected.regressions().zip(expected.views()) {
            if regression.variance_m2() > self.pulse_m * self.pulse_m || view.present < LEAST_PRESENCE {
                continue;
            }
            // So far that it is not beside itself.
            let away_m = 1.25 * (self.pulse_m + 2.0 * sqrt(regression.variance_m2()));
            for at_m in [regression.range_m - away_m, regression.range_m + away_m] {
                let mut others = expected.regressions();
                if at_m < first_m || others.any(|other| is_beside(other, at_m)) {
                    continue;
                }
                let Some(energy) = self.residual.energy(at_m) else { continue };
                let own = self.background.posterior(energy, &self.likelihoods);
                count += 1.0;
                match &mut mean {
                    None => mean = Some(own),
                    Some(mean) => mean.mix(&own, 1.0 / count),
                }
            }
        }
        mean
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::observation::Samples;
    use crate::perceptor::channel_estimator::{ChannelEstimate, ChannelEstimator, EstimatorSettings};
    use crate::radio::pulse::Pulse;
    use crate::real::SPEED_OF_LIGHT_M_S;

    const SPACING_S: f32 = 0.25e-9;
    const SAMPLES: usize = 200;

    /// What is left of a frame of a path this long of energy `energy`, in unit noise that is everywhere as strong as it is on average.
    fn left(range_m: f32, energy: f32) -> Residual<400> {
        let pulse = Pulse::root_raised_cosine(0.5e-9, 0.6);
        let own = ChannelEstimator::<4>::new(pulse, SPACING_S, SAMPLES, 0.1, EstimatorSettings::default());
        let position = range_m / SPEED_OF_LIGHT_M_S / SPACING_S;
        let sample = |n: usize| {
            let r = pulse.autocorrelation((n as f32 - position) * SPACING_S / pulse.duration_s);
            // In quadrature, so that energies add up.
            [energy.sqrt() * r, 1.0]
        };
        let frame: std::vec::Vec<_> = (0..SAMPLES).map(sample).collect();
        let noise = own.estimate(Samples::Complex(&[[1.0, 0.0]; SAMPLES]), 0.0).unwrap();
        let estimate = ChannelEstimate { paths: Vec::new(), ..noise };
        let mut residual = Residual::default();
        own.leave(Samples::Complex(&frame), 0.0, &estimate, 100.0, &mut residual);
        residual
    }

    fn reader(residual: &Residual<400>) -> Reader<'_, 400> {
        let likelihoods = Likelihoods::new(8.5);
        Reader { residual, background: &Background::USUAL, likelihoods, pulse_m: 0.15, exponent: 1.0 }
    }

    /// W, mean and variance of N g by a fine sum.
    fn exact(own: &Reader<'_, 400>, strength: &Strength, there: f64, mean_m: f32, std_m: f32) -> [f64; 3] {
        let (mut sums, mut all) = ([0.0; 3], 0.0);
        for step in -3000..=3000 {
            let x = f64::from(step) / 1000.0;
            let weight = (-0.5 * x * x).exp();
            let rho = match own.residual.energy(mean_m + x as f32 * std_m) {
                Some(energy) => f64::from(strength.ratio(energy, &own.likelihoods, own.background)),
                None => 1.0,
            };
            let g = weight * (1.0 - there + there * rho);
            all += weight;
            sums = [sums[0] + g, sums[1] + g * x, sums[2] + g * x * x];
        }
        let mean = sums[1] / sums[0];
        // What the tails beyond three deviations lack.
        [sums[0] / all, mean, (sums[2] / sums[0]) / 0.9735 - mean * mean]
    }

    #[test]
    fn a_look_is_the_mean_likelihood_and_the_moments_of_where_it_is() {
        let range_m = 6.0;
        let residual = left(range_m, 7.0);
        let own = reader(&residual);
        let strength = Strength::about(2.0, 1.0, &own.likelihoods);
        for std_m in [0.01, 0.03, 0.08] {
            for off in [-1.5, -0.5, 0.0, 1.0] {
                let expected_m = range_m + off * std_m;
                let look = own.look(&strength, 0.7, expected_m, std_m);
                let [ratio, shift, variance] = exact(&own, &strength, 0.7, expected_m, std_m);
                let case = std::format!("{std_m} {off}: {look:?}, {ratio} {shift} {variance}");
                assert!((f64::from(look.ratio) / ratio - 1.0).abs() < 0.1, "{case}");
                assert!((f64::from(look.shift) - shift).abs() < 0.06, "{case}");
                assert!((f64::from(look.variance) - variance).abs() < 0.08, "{case}");
                // Towards the path, and better known.
                assert!(look.shift * off <= 0.01 && (std_m < 0.05 || look.variance < 0.9), "{case}");
            }
        }
        // Where there is nothing, it is less probable that it is there.
        assert!(own.look(&strength, 0.7, 9.0, 0.03).ratio < 0.9);
    }
}
