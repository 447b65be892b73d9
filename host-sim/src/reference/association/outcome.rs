//! A scan with what was expected in it and what came out: what update and memories read.

use super::{Beliefs, associate};
use crate::reference::association::Clutter;
use crate::reference::discovery::Claims;
use crate::reference::known::Expected;
use crate::reference::lateness::Timing;
use crate::reference::real::Real;
use crate::reference::receiver::Scan;
use crate::reference::soft_update::Moments;
use crate::reference::state_filter::Innovation;
use cogmint_core::perceptor::association::Mode;

/// Features with less probability of a measurement move nothing.
const LEAST_WEIGHT: f32 = 1e-3;

/// An associated scan.
#[derive(Clone, Debug)]
pub struct Outcome<T> {
    /// The scan.
    pub scan: Scan<T>,
    /// Per feature, what was expected of it: the direct path, then the anchor's virtual anchors by slot.
    pub expected: Vec<Expected<T>>,
    /// What the candidates of the discovery made of it.
    pub claims: Claims<T>,
    /// Per feature, the beliefs.
    pub beliefs: Beliefs<T>,
}

/// Associates a scan with what was expected in it.
pub fn associate_scan<T: Real>(
    scan: Scan<T>,
    expected: Vec<Expected<T>>,
    claims: Claims<T>,
    clutter: &Clutter<T>,
    outage: T,
    mode: Mode,
) -> Outcome<T> {
    let features: Vec<_> = expected.iter().map(|expected| expected.feature).collect();
    let mut beliefs = associate(&features, &scan.measurements, &claims.totals(), clutter);
    if mode == Mode::Map {
        beliefs.harden();
    }
    beliefs.doubt(outage, &features);
    Outcome { scan, expected, claims, beliefs }
}

impl<T: Real> Outcome<T> {
    /// What the measurements of each feature amount to; features with hardly any probability are left out.
    pub fn innovations(&self) -> Vec<Innovation<T>> {
        let mut innovations = Vec::new();
        for (Expected { regression, feature, .. }, belief) in self.expected.iter().zip(&self.beliefs.features)
        {
            let mut moments = Moments::none();
            let (mut variance, mut alike) = (T::ZERO, T::ZERO);
            for (z, &p) in self.scan.measurements.iter().zip(&belief.associated) {
                match feature.timing(z) {
                    Some(Timing { moments: [first_m, second_m2], .. }) => {
                        moments.add_moments(p, first_m, second_m2);
                    }
                    None => moments.add(p, z.range_m - regression.range_m),
                }
                variance += p * z.variance_m2;
                if z.sinr > T::ZERO
                    && let Some(frame) = &self.scan.frame
                {
                    alike += p * frame.alike_m2;
                }
            }
            if moments.weight >= T::of(LEAST_WEIGHT) {
                let variance_m2 = variance / moments.weight;
                let alike_m2 = alike / moments.weight;
                innovations.push(Innovation { regression: *regression, moments, variance_m2, alike_m2 });
            }
        }
        innovations
    }

    /// What its ranges say of how late they are, each with the probability that it is of the direct path.
    pub fn timings(&self) -> Vec<(Timing<T>, T)> {
        let feature = &self.expected[0].feature;
        let mut timings = Vec::new();
        for (z, p) in self.scan.measurements.iter().zip(&self.beliefs.features[0].associated) {
            timings.extend(feature.timing(z).map(|timing| (timing, *p)));
        }
        timings
    }

    /// Number of measurements that nothing known explains.
    pub fn unexplained(&self) -> T {
        let mut unexplained = T::ZERO;
        for free in &self.beliefs.unassociated {
            unexplained += *free;
        }
        unexplained
    }
}

/// Mean of nu^2 / S over everything associated; 0 without measurements.
pub fn normalised_innovation<T: Real>(outcomes: &[Outcome<T>]) -> T {
    let (mut weight, mut squares) = (T::ZERO, T::ZERO);
    for innovation in outcomes.iter().flat_map(Outcome::innovations) {
        weight += innovation.moments.weight;
        squares +=
            innovation.moments.second_m2 / (innovation.regression.variance_m2() + innovation.variance_m2);
    }
    if weight > T::ZERO { squares / weight } else { T::ZERO }
}
