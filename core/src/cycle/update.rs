//! The state moves by what was associated.

use super::Tracker;
use super::associate::AssociatedScan;
use crate::perceptor::association::{Belief, Measurement};
use crate::perceptor::state_filter::{Innovation, Regression};
use heapless::Vec;

impl<const ANCHORS: usize, const VAS: usize, const PATHS: usize, const ACTIONS: usize>
    Tracker<ANCHORS, VAS, PATHS, ACTIONS>
{
    /// Moves the state by everything associated: direct paths first, then virtual anchors, by anchor.
    pub(super) fn update(&mut self, heard: &Vec<AssociatedScan<'_, VAS, PATHS>, ANCHORS>) {
        let innovations = heard.iter().flat_map(|associated| {
            let scan = &associated.scan;
            associated
                .features()
                .filter_map(move |(regression, belief)| innovation(regression, &scan.measurements, belief))
        });
        self.filter.update(innovations);
    }

    /// Mean normalised innovation squared of what was associated: 1 where the filter knows how wrong it is, 0 without
    /// measurements.
    pub(super) fn normalised_innovation(heard: &Vec<AssociatedScan<'_, VAS, PATHS>, ANCHORS>) -> f32 {
        let (mut weight, mut squares) = (0.0, 0.0);
        for associated in heard {
            for (regression, belief) in associated.features() {
                if let Some(innovation) = innovation(regression, &associated.scan.measurements, belief) {
                    weight += innovation.weight;
                    squares += innovation.second_m2 / (regression.variance_m2() + innovation.variance_m2);
                }
            }
        }
        if weight > 0.0 { squares / weight } else { 0.0 }
    }
}

/// Sums up the measurements associated with a feature; `None` where hardly any probability is.
pub(super) fn innovation<const PATHS: usize>(
    regression: &Regression,
    measurements: &Vec<Measurement, PATHS>,
    belief: &Belief<PATHS>,
) -> Option<Innovation> {
    let mut weight = 0.0;
    let mut first_m = 0.0;
    let mut second_m2 = 0.0;
    let mut variance = 0.0;
    for (measurement, &p) in measurements.iter().zip(&belief.associated) {
        let nu = measurement.range_m - regression.range_m;
        weight += p;
        first_m += p * nu;
        second_m2 += p * (nu * nu);
        variance += p * measurement.variance_m2;
    }
    if weight < 1e-3 {
        return None;
    }
    Some(Innovation { regression: *regression, weight, first_m, second_m2, variance_m2: variance / weight })
}
