//! The level of what is no path, from the powers that a frame leaves beside its paths, and the threshold on it.

use super::frame::Radio;

/// How a level is taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LevelModel {
    /// One level for the whole frame: the median of all powers.
    White,
    /// A level for every sample: mean of the powers around it, weighted by exp(-|t| / 5 ns), without the pulse itself.
    LocalMean,
    /// The same by the median within 10 ns to either side, which stands unresolved paths (ordered-statistic CFAR).
    LocalMedian,
}

/// Decay of the local mean's weights and reach of the local median, seconds.
const MEAN_DECAY_S: f64 = 5e-9;
const MEDIAN_REACH_S: f64 = 10e-9;
/// Left out around the sample in question, pulse durations.
const GUARD_PULSES: f64 = 1.5;
/// The mean of n exponentially distributed powers is as certain as the median of this many times n: 1 / ln(2)^2.
const MEDIAN_COST: f64 = 2.081_368_981;

impl LevelModel {
    /// A method's name with its way of taking the level.
    pub(super) fn name(self, white: &'static str, local: &'static str) -> &'static str {
        if self == Self::White { white } else { local }
    }

    /// The level at every sample.
    pub(super) fn levels(self, powers: &[f64], radio: &Radio) -> Vec<f64> {
        let guard = (GUARD_PULSES * radio.spectrum.duration_s() / radio.spacing_s).round() as usize;
        match self {
            Self::White => vec![median(powers.to_vec()); powers.len()],
            Self::LocalMean => local_means(powers, libm::exp(-radio.spacing_s / MEAN_DECAY_S), guard),
            Self::LocalMedian => {
                let reach = (MEDIAN_REACH_S / radio.spacing_s).round() as usize;
                let around = |n: usize| {
                    let window = powers.iter().enumerate().skip(n.saturating_sub(reach));
                    let window = window.take_while(|(other, _)| *other <= n + reach);
                    median(window.filter(|(other, _)| other.abs_diff(n) > guard).map(|(_, p)| *p).collect())
                };
                (0..powers.len()).map(around).collect()
            }
        }
    }

    /// The threshold on energy over level for a rate of false paths per frame of `samples` samples: kappa of
    /// rate = (2 beta sqrt(pi kappa) T + 1) exp(-kappa), made larger because the level is uncertain. The mean of n
    /// independent powers is exceeded kappa' times with probability (1 + kappa' / n)^-n, so kappa' =
    /// n (exp(kappa / n) - 1) takes kappa's place.
    pub(super) fn threshold(self, samples: usize, radio: &Radio, false_paths: f64) -> f64 {
        let window_s = samples as f64 * radio.spacing_s;
        let turns = radio.spectrum.rms_bandwidth_hz() * window_s;
        let mut kappa = 6.0_f64;
        for _ in 0..30 {
            let crossings = 2.0 * turns * (std::f64::consts::PI * kappa).sqrt() + 1.0;
            kappa = (crossings / false_paths).ln().max(1.0);
        }
        let guard_s = 2.0 * GUARD_PULSES * radio.spectrum.duration_s();
        let seen_s = match self {
            Self::White => window_s / MEDIAN_COST,
            // (sum w)^2 / sum w^2 of the exponential is four times its decay.
            Self::LocalMean => 4.0 * MEAN_DECAY_S - guard_s,
            Self::LocalMedian => (2.0 * MEDIAN_REACH_S - guard_s) / MEDIAN_COST,
        };
        let independent = seen_s / radio.spectrum.effective_duration_s();
        independent * ((kappa / independent).exp() - 1.0)
    }
}

/// Mean of exponentially distributed powers by their median, mean * ln 2.
fn median(mut powers: Vec<f64>) -> f64 {
    if powers.is_empty() {
        return 0.0;
    }
    let middle = powers.len() / 2;
    let (_, median, _) = powers.select_nth_unstable_by(middle, f64::total_cmp);
    *median / std::f64::consts::LN_2
}

/// Means of the powers more than `guard` samples away to either side, each weighted by `decay` per sample.
fn local_means(powers: &[f64], decay: f64, guard: usize) -> Vec<f64> {
    let one_side = |powers: &mut dyn Iterator<Item = f64>| -> Vec<[f64; 2]> {
        let mut sums = [0.0; 2];
        powers
            .map(|power| {
                sums = [sums[0] * decay + power, sums[1] * decay + 1.0];
                sums
            })
            .collect()
    };
    let before = one_side(&mut powers.iter().copied());
    let mut after = one_side(&mut powers.iter().rev().copied());
    after.reverse();
    let mean = |n: usize| {
        let left = n.checked_sub(guard + 1).and_then(|n| before.get(n)).copied().unwrap_or([0.0; 2]);
        let right = after.get(n + guard + 1).copied().unwrap_or([0.0; 2]);
        (left[0] + right[0]) / (left[1] + right[1]).max(f64::MIN_POSITIVE)
    };
    (0..powers.len()).map(mean).collect()
}

/// Level at a position between the samples; never zero, so that silence has no path.
pub(super) fn level_at(levels: &[f64], position: f64) -> f64 {
    let nearest = (position.max(0.0).round() as usize).min(levels.len().saturating_sub(1));
    levels.get(nearest).copied().unwrap_or(0.0).max(1e-30)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::channel::random::{Purpose, stream, uniform};

    #[test]
    fn every_model_finds_the_level_of_exponential_powers() {
        let radio = Radio::of_the_experiment();
        let mut rng = stream(3, Purpose::Experiment, &[]);
        for model in [LevelModel::White, LevelModel::LocalMean, LevelModel::LocalMedian] {
            let mut mean = 0.0;
            for _ in 0..100 {
                let powers: Vec<f64> = (0..400).map(|_| -3.0 * uniform(&mut rng).ln()).collect();
                mean += model.levels(&powers, &radio).iter().sum::<f64>() / 400.0 / 100.0;
            }
            assert!((mean / 3.0 - 1.0).abs() < 0.04, "{model:?}: {mean}");
        }
    }

    #[test]
    fn the_local_levels_follow_a_step_and_the_white_one_does_not() {
        let radio = Radio::of_the_experiment();
        let powers: Vec<f64> = (0..400).map(|n| if n < 200 { 1.0 } else { 100.0 }).collect();
        for model in [LevelModel::LocalMean, LevelModel::LocalMedian] {
            let levels = model.levels(&powers, &radio);
            assert!(levels[350] / levels[50] > 40.0, "{model:?}");
        }
        let levels = LevelModel::White.levels(&powers, &radio);
        assert_eq!(levels[350], levels[50]);
    }
}
