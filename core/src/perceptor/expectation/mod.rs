//! Expectation: what every source of a scan is expected to show, once per scan and place of the tag.
//!
//! Range and its variance come from the regression on the state, existence from the map, detection from what is known of
//! the channel and from the scan's own noise. Paths of a frame disturb each other ([`overlap`]): their ranges are worth
//! less, and two may be found as one.

pub mod overlap;

use self::overlap::{Arrival, Overlap};
use super::scan::Scan;
use crate::model::channel::ChannelPrior;
use crate::model::detection::{HIDDEN_DETECTION, detection_probability};
use crate::model::range::Regression;
use crate::radio::pulse::Pulse;
use crate::real::{limited, smaller};
use heapless::Vec;

/// What is expected of one feature before the measurements arrive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Expectation {
    /// Expected range, metres.
    pub range_m: f32,
    /// Variance of the expected range, square metres, measurement noise not included.
    pub variance_m2: f32,
    /// Probability that the feature exists.
    pub existence: f32,
    /// Probability that an existing feature is detected.
    pub detection: f32,
}

/// What is known of a source before a scan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prospect {
    /// Its range on the state.
    pub regression: Regression,
    /// What is known of its channel at the scan's action.
    pub channel: ChannelPrior,
    /// SINR over the scan's own noise where it is expected; `None` if that is not known.
    pub sinr_here: Option<f32>,
    /// Whether it is a virtual anchor that was never seen.
    pub is_unseen_image: bool,
}

impl Prospect {
    /// Probability that the path of the source is found if the source exists: of frames by its SINR.
    pub fn detection<const PATHS: usize>(&self, scan: &Scan<PATHS>, told: f32) -> f32 {
        detection(scan, told, &self.channel, self.sinr_here, self.is_unseen_image)
    }
}

/// SINR of a source in a scan if nothing hides it, and the probability that it is then found: what is remembered, or
/// less where the frame is noisier.
pub fn found<const PATHS: usize>(scan: &Scan<PATHS>, sinr: f32, sinr_here: Option<f32>) -> f32 {
    let sinr = sinr_here.map_or(sinr, |here| smaller(sinr, here));
    detection_probability(sinr, scan.threshold())
}

/// Probability that the path of an existing source is found in a scan: of frames by its SINR as remembered; `told` is that
/// of ranges and of what was never seen.
pub fn detection<const PATHS: usize>(
    scan: &Scan<PATHS>,
    told: f32,
    channel: &ChannelPrior,
    sinr_here: Option<f32>,
    is_unseen_image: bool,
) -> f32 {
    if !scan.is_framed() {
        return told;
    }
    if channel.seen {
        let found = found(scan, channel.sinr, sinr_here);
        return limited(channel.visibility * found, HIDDEN_DETECTION, told);
    }
    if is_unseen_image { HIDDEN_DETECTION } else { told }
}

/// What is expected of the sources of one anchor: their regressions, and what association makes of them.
#[derive(Clone, Debug)]
pub struct Expectations<const VAS: usize> {
    /// The direct path on the state.
    pub direct: Regression,
    /// The direct path.
    pub direct_path: Expectation,
    /// The anchor's virtual anchors on the state, in the order of their slots.
    pub virtual_anchors: Vec<Regression, VAS>,
    /// What is expected of each of them.
    pub expectations: Vec<Expectation, VAS>,
    /// SINR of each, the direct path first.
    sinr: (f32, Vec<f32, VAS>),
}

impl<const VAS: usize> Expectations<VAS> {
    /// What a direct path with this probability of detection is expected to show, and no virtual anchors yet.
    pub fn new(direct: &Prospect, detection: f32) -> Self {
        Self {
            direct: direct.regression,
            direct_path: expectation(&direct.regression, 1.0, detection),
            virtual_anchors: Vec::new(),
            expectations: Vec::new(),
            sinr: (direct.channel.sinr, Vec::new()),
        }
    }

    /// Adds a virtual anchor that exists with probability `existence`.
    pub fn add(&mut self, image: &Prospect, existence: f32, detection: f32) {
        // One per slot at most: the pushes succeed.
        let _ = self.virtual_anchors.push(image.regression);
        let _ = self.expectations.push(expectation(&image.regression, existence, detection));
        let _ = self.sinr.1.push(image.channel.sinr);
    }

    /// Every regression, the direct path's first.
    pub fn regressions(&self) -> impl Iterator<Item = &Regression> + Clone {
        core::iter::once(&self.direct).chain(&self.virtual_anchors)
    }

    /// Takes into account that paths received with this pulse disturb each other.
    #[inline(never)]
    pub fn disturb(&mut self, pulse: &Pulse) {
        let Self { direct, direct_path, virtual_anchors, expectations, sinr } = self;
        let arrival = |expectation: &Expectation, sinr: f32| Arrival {
            range_m: expectation.range_m,
            presence: expectation.existence * expectation.detection,
            sinr,
        };
        let first = arrival(direct_path, sinr.0);
        let mut others: Vec<Arrival, VAS> = Vec::new();
        for (expectation, sinr) in expectations.iter().zip(&sinr.1) {
            // Capacities are equal: every push succeeds.
            let _ = others.push(arrival(expectation, *sinr));
        }
        let apply = |overlap: &Overlap, regression: &mut Regression, expectation: &mut Expectation| {
            regression.residual_m2 += overlap.variance_m2;
            expectation.variance_m2 = regression.variance_m2();
            expectation.detection = overlap.resolved(expectation.detection);
        };
        let mut overlap = Overlap::default();
        for other in &others {
            overlap.add(pulse, &first, other);
        }
        apply(&overlap, direct, direct_path);
        let sources = virtual_anchors.iter_mut().zip(expectations);
        for ((k, own), (regression, expectation)) in others.iter().enumerate().zip(sources) {
            let mut overlap = Overlap::default();
            overlap.add(pulse, own, &first);
            for (l, other) in others.iter().enumerate() {
                if l != k {
                    overlap.add(pulse, own, other);
                }
            }
            apply(&overlap, regression, expectation);
        }
    }
}

fn expectation(regression: &Regression, existence: f32, detection: f32) -> Expectation {
    Expectation { range_m: regression.range_m, variance_m2: regression.variance_m2(), existence, detection }
}
