//! Whether the filter knew how wrong it was: normalised errors of its position and of its innovations.
//!
//! **NEES** per degree of freedom: e' C^-1 e / 2 with the position error e and the covariance C claimed for it. An
//! honest filter has a mean of 1 and 95 % of its cycles below 5.99 / 2. Errors of one run hang together from cycle
//! to cycle, so the mean of a single run strays further from 1 than its number of cycles suggests: judge by many.
//!
//! **NIS**: nu^2 / S with the innovation nu = z - E z at the predicted state and its variance S = var(E z) + R as the
//! filter sees them (R with its inflation and floor), weighted by the probability that the measurement z belongs to
//! that source. An honest filter has a mean of 1, one that asks for more variance than there is has less. The gate of
//! the association leaves out what is beyond 16.
//!
//! Source: Bar-Shalom, Li, Kirubarajan 2001, section 5.4.

use crate::replay::{PATHS, SOURCES};
use cogmint_core::model::measurement::Measurement;
use cogmint_core::model::range::Regression;
use cogmint_core::observer::Observer;
use cogmint_core::perceptor::association::Beliefs;
use serde::Serialize;

/// 95 % quantile of chi-square with two degrees of freedom: -2 ln 0.05.
pub(crate) const CHI_SQUARE_95: f64 = 5.991_464_547_107_982;

/// Normalised errors of a run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Consistency {
    /// Mean normalised estimation error squared of the position, per degree of freedom; none without truth, infinite
    /// where an error is claimed to be impossible.
    pub nees: Option<f64>,
    /// Share of the cycles whose true position lies within the 95 % ellipse; none without truth.
    pub nees_within_95: Option<f64>,
    /// Mean normalised innovation squared per associated measurement; none where nothing was associated.
    pub nis: Option<f64>,
}

impl Consistency {
    /// Sums up the position errors of a run, each with the covariance (xx, xy, yy) claimed for it, in metres and
    /// square metres, and its innovations.
    pub fn new(errors: &[([f64; 2], [f64; 3])], innovations: &Innovations) -> Self {
        let squares: Vec<f64> = errors.iter().map(|(error, c)| normalised_square(*error, *c)).collect();
        let mean = |sum: f64| (!squares.is_empty()).then(|| sum / squares.len() as f64);
        let within = squares.iter().filter(|square| **square <= CHI_SQUARE_95).count();
        Self {
            nees: mean(squares.iter().sum::<f64>() / 2.0),
            nees_within_95: mean(within as f64),
            nis: innovations.mean(),
        }
    }
}

/// e' C^-1 e; infinite where C is no covariance.
pub(crate) fn normalised_square([x, y]: [f64; 2], [xx, xy, yy]: [f64; 3]) -> f64 {
    let determinant = xx * yy - xy * xy;
    if !(determinant > 0.0 && xx > 0.0) {
        return f64::INFINITY;
    }
    (yy * x * x - 2.0 * xy * x * y + xx * y * y) / determinant
}

/// What a source's range is expected to be.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Expected {
    range_m: f64,
    variance_m2: f64,
}

/// The innovations of a run, whose cycles it watches as an observer.
#[derive(Clone, Debug, Default)]
pub struct Innovations {
    /// Of the anchor whose beliefs come next: its direct path, then its virtual anchors.
    expected: Vec<Expected>,
    weight: f64,
    squares: f64,
}

impl Innovations {
    fn enter(&mut self, expected: Expected, measurement: &Measurement, probability: f64) {
        let innovation_m = f64::from(measurement.range_m) - expected.range_m;
        let variance_m2 = expected.variance_m2 + f64::from(measurement.variance_m2);
        self.weight += probability;
        self.squares += probability * (innovation_m * innovation_m / variance_m2);
    }

    /// The mean so far.
    fn mean(&self) -> Option<f64> {
        (self.weight > 0.0).then(|| self.squares / self.weight)
    }
}

impl Observer<SOURCES, PATHS> for Innovations {
    fn expectations(&mut self, _anchor: usize, direct: &Regression, virtual_anchors: &[Regression]) {
        let expected = |line: &Regression| Expected {
            range_m: f64::from(line.range_m),
            variance_m2: f64::from(line.variance_m2()),
        };
        self.expected = std::iter::once(direct).chain(virtual_anchors).map(expected).collect();
    }

    fn beliefs(&mut self, _anchor: usize, measurements: &[Measurement], beliefs: &Beliefs<SOURCES, PATHS>) {
        for (expected, belief) in std::mem::take(&mut self.expected).into_iter().zip(beliefs.features()) {
            for (measurement, probability) in measurements.iter().zip(&belief.associated) {
                self.enter(expected, measurement, f64::from(*probability));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::channel::random::{Purpose, normal, stream};
    use crate::recording::{Cycle, META_FILE, Range, Recording, VirtualAnchor, tests::example};
    use crate::track::track;
    use std::path::Path;

    /// Errors drawn from the covariance claimed for them, which changes from cycle to cycle, times `factor`.
    fn drawn(count: usize, factor: f64) -> Vec<([f64; 2], [f64; 3])> {
        let mut rng = stream(7, Purpose::Experiment, &[]);
        (0..count)
            .map(|n| {
                // Lower triangular root L, C = L L'.
                let (l11, l21, l22) = (0.02 + 0.01 * (n % 5) as f64, 0.3 * (n % 3) as f64 - 0.2, 0.07);
                let (u, v) = (normal(&mut rng), normal(&mut rng));
                let error = [factor * l11 * u, factor * (l21 * u + l22 * v)];
                (error, [l11 * l11, l11 * l21, l21 * l21 + l22 * l22])
            })
            .collect()
    }

    #[test]
    fn errors_as_large_as_claimed_have_a_nees_of_one() {
        let count = 4000;
        let score = Consistency::new(&drawn(count, 1.0), &Innovations::default());
        // The sum is chi-square with 2 x count degrees of freedom; five of its deviations.
        let band = 5.0 / (count as f64).sqrt();
        let nees = score.nees.expect("there are errors");
        assert!((nees - 1.0).abs() < band, "{nees}");
        let within = score.nees_within_95.expect("there are errors");
        assert!((within - 0.95).abs() < 5.0 * (0.95 * 0.05 / count as f64).sqrt(), "{within}");
        assert_eq!(score.nis, None);
        // Twice as far off as claimed: four times the NEES, and exp(-5.99 / 8) leave the ellipse.
        let proud = Consistency::new(&drawn(count, 2.0), &Innovations::default());
        assert!((proud.nees.expect("there are errors") / nees - 4.0).abs() < 1e-9);
        let left = 0.05_f64.powf(0.25);
        let within = proud.nees_within_95.expect("there are errors");
        assert!((within - (1.0 - left)).abs() < 5.0 * (left * (1.0 - left) / count as f64).sqrt());
    }

    #[test]
    fn closed_cases() {
        assert_eq!(normalised_square([3.0, 0.0], [9.0, 0.0, 1.0]), 1.0);
        assert_eq!(normalised_square([0.0, 2.0], [9.0, 0.0, 1.0]), 4.0);
        // Along (1, 1) the variance is 1.5, along (1, -1) 0.5.
        assert!((normalised_square([1.0, 1.0], [1.0, 0.5, 1.0]) - 2.0 / 1.5).abs() < 1e-12);
        assert!((normalised_square([1.0, -1.0], [1.0, 0.5, 1.0]) - 2.0 / 0.5).abs() < 1e-12);
        assert_eq!(normalised_square([0.0, 0.0], [1.0, 1.0, 1.0]), f64::INFINITY);
        assert_eq!(normalised_square([0.0, 0.0], [f64::NAN, 0.0, 1.0]), f64::INFINITY);
        assert_eq!(Consistency::new(&[], &Innovations::default()), Consistency::default());
        let mut innovations = Innovations::default();
        let measurement =
            Measurement { range_m: 5.5, variance_m2: 0.0625, sinr: 0.0, energy: 0.0, false_alarm: 1.0 };
        innovations.enter(Expected { range_m: 5.0, variance_m2: 0.1875 }, &measurement, 0.75);
        innovations.enter(Expected { range_m: 5.5, variance_m2: 0.1875 }, &measurement, 0.25);
        assert_eq!(innovations.mean(), Some(0.75));
    }

    /// A tag at rest, ranged by two anchors and two virtual ones with normal errors of `true_std_m`, told as `told_std_m`.
    fn at_rest(true_std_m: f64, told_std_m: f64) -> Recording {
        let mut rng = stream(8, Purpose::Experiment, &[]);
        let mut recording = example();
        let tag = recording.start.position_m;
        recording.start.disc_radius_m = None;
        recording.motion.acceleration_std_m_s2 = Some(1e-3);
        recording.association.clutter_per_anchor = 1e-3;
        recording.virtual_anchors = [[12.0, 14.0], [-9.0, 15.0]]
            .map(|position_m| VirtualAnchor::new(1, position_m, 0.01, true))
            .to_vec();
        recording.actions.clear();
        recording.antennas.clear();
        recording.anchors[0].position_m = [-2.0, 3.0];
        recording.anchors[1].position_m = [8.0, 3.0];
        let direct = recording.anchors.iter().enumerate().map(|(anchor, own)| (anchor, own.position_m));
        let reflected = recording.virtual_anchors.iter().map(|va| (va.anchor, va.position_m));
        let sources: Vec<(usize, [f64; 2])> = direct.chain(reflected).collect();
        recording.cycles = (0..1500)
            .map(|n| Cycle {
                time_s: 0.1 * f64::from(n),
                truth_position_m: Some(tag),
                ranges: sources
                    .iter()
                    .map(|(anchor, [x, y])| Range {
                        anchor: *anchor,
                        range_m: (tag[0] - x).hypot(tag[1] - y) + true_std_m * normal(&mut rng),
                        std_m: Some(told_std_m),
                        angles: None,
                    })
                    .collect(),
                ..Cycle::default()
            })
            .collect();
        recording
    }

    #[test]
    fn the_nis_of_a_track_is_the_variance_there_is_over_the_variance_asked_for() {
        // R = 1.44 sigma^2 + (2 mm)^2 is what the core's defaults make of a deviation.
        for (true_std_m, told_std_m) in [(0.05, 0.05), (0.05, 0.1), (0.075, 0.05)] {
            let recording = at_rest(true_std_m, told_std_m);
            let run = track(&recording, Path::new(META_FILE), None, || {}).expect("it runs");
            let asked = 1.44 * told_std_m * told_std_m + 4e-6;
            let nis = run.consistency.nis.expect("ranges were associated");
            let ratio = nis * asked / (true_std_m * true_std_m);
            // 6000 ranges: five deviations are 0.09; the state's own variance is small beside R.
            assert!((ratio - 1.0).abs() < 0.15, "{true_std_m} told as {told_std_m}: {nis}, {ratio}");
        }
    }
}
