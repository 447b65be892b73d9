//! Threshold on the matched filter's output: its local maxima, side lobes of stronger ones left out.

use super::super::estimator::{Found, PATHS, PathFinder};
use super::climb::climb;
use super::frame::{Component, Frame, Radio};
use super::least_squares::found;
use super::level::{LevelModel, level_at};

/// A maximum below this many times what a stronger one may leave there, in amplitude, is taken for its side lobe.
const SIDE_LOBE_MARGIN: f64 = 2.0;

/// The threshold matched filter.
#[derive(Clone, Debug)]
pub struct MatchedFilter {
    radio: Radio,
    level: LevelModel,
}

impl MatchedFilter {
    /// With a way of taking the level.
    pub fn new(level: LevelModel) -> Self {
        Self { radio: Radio::of_the_experiment(), level }
    }
}

impl PathFinder for MatchedFilter {
    fn name(&self) -> &str {
        self.level.name("matched-filter", "matched-filter-local")
    }

    fn find(&self, samples: &[[f32; 2]], false_paths: f64) -> Vec<Found> {
        let frame = Frame::new(&self.radio, samples);
        let threshold = self.level.threshold(samples.len(), &self.radio, false_paths);
        let levels = self.level.levels(&frame.residual_powers(&[]), &self.radio);
        let powers: Vec<f64> = frame.half_residual(&[]).iter().map(|value| value.norm_sqr()).collect();
        let mut maxima: Vec<Component> = Vec::new();
        for n in 1..powers.len().saturating_sub(1) {
            if powers[n] > powers[n - 1] && powers[n] >= powers[n + 1] {
                let position = climb(|position| frame.at(position).norm_sqr(), 0.5 * n as f64, 8);
                maxima.push(Component { position, amplitude: frame.at(position) });
            }
        }
        maxima.retain(|one| one.amplitude.norm_sqr() > threshold * level_at(&levels, one.position));
        maxima.sort_by(|a, b| b.amplitude.norm_sqr().total_cmp(&a.amplitude.norm_sqr()));
        let mut kept: Vec<Component> = Vec::new();
        for one in maxima {
            let lobe = |stronger: &Component| {
                stronger.amplitude.norm() * self.radio.envelope(one.position - stronger.position)
            };
            let is_own = kept.iter().all(|stronger| one.amplitude.norm() > SIDE_LOBE_MARGIN * lobe(stronger));
            if is_own && kept.len() < PATHS {
                kept.push(one);
            }
        }
        kept.iter().map(|one| found(&frame, one, &levels)).collect()
    }
}
