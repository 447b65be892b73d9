//! Evidence of a scan for the place it was compared at.

use super::factors::GATE;
use crate::model::measurement::{Clutter, Measurement, is_earlier};
use crate::perceptor::expectation::Expectation;
use crate::real::{TAU, abs, exp, ln, sqrt};

/// Mathematics: scale of the Cauchy distribution of where the paths of a tag that is elsewhere are, metres.
pub const ELSEWHERE_M: f32 = 1.0;

/// Evidence of one scan that the tag is where these features are expected from, nats: the direct path, and the virtual anchors.
pub fn evidence_nat<'a>(
    measurements: &[Measurement],
    direct: &'a Expectation,
    virtual_anchors: impl Iterator<Item = &'a Expectation> + Clone,
    clutter: &Clutter,
) -> f32 {
    let unmapped_per_m = clutter.all_per_m - clutter.false_alarms_per_m;
    let mut evidence_nat = 0.0;
    for measurement in measurements {
        let before_direct_m = direct.range_m - measurement.range_m;
        let is_earlier = is_earlier(measurement, direct.range_m, direct.variance_m2);
        let false_alarms_per_m = measurement.false_alarm * clutter.false_alarms_per_m;
        let mut here = if is_earlier { false_alarms_per_m } else { clutter.all_per_m };
        let later = 0.5 - 0.5 * before_direct_m / (ELSEWHERE_M + abs(before_direct_m));
        let mut elsewhere = false_alarms_per_m + unmapped_per_m * later;
        for (index, feature) in core::iter::once(direct).chain(virtual_anchors.clone()).enumerate() {
            let probability = feature.existence * feature.detection;
            let innovation = measurement.range_m - feature.range_m;
            let squared = innovation * innovation;
            let variance = feature.variance_m2 + measurement.variance_m2;
            if squared < GATE * GATE * variance && !(is_earlier && index > 0) {
                here += probability * exp(-0.5 * (squared / variance)) / sqrt(TAU * variance);
            }
            elsewhere += probability * (2.0 * ELSEWHERE_M / TAU) / (ELSEWHERE_M * ELSEWHERE_M + squared);
        }
        evidence_nat += ln(here / elsewhere);
    }
    evidence_nat
}
