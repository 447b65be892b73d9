//! What every scan is expected to show, and which measurement belongs to what.

use super::Tracker;
use super::receive::Scan;
use crate::observer::Observer;
use crate::perceptor::association::{
    Belief, Beliefs, Clutter, Expectation, Mode, associate, detection_probability,
};
use crate::perceptor::discovery::Claims;
use crate::perceptor::loss::evidence_nat;
use crate::perceptor::overlap::{Arrival, Overlap};
use crate::perceptor::state_filter::{Regression, Source};
use crate::real::{limited, smaller};
use heapless::Vec;

/// Detection probability of a path that is hidden at present, and of a virtual anchor that a floor plan tells of and that
/// was never seen: most are hidden from most places, and a few steps on another one comes out. No memory of misses
/// may make it less, or a path that comes back would go to a false neighbour.
const HIDDEN_DETECTION: f32 = 0.1;

/// What is expected of the features of one anchor: their regressions, and what association makes of them.
pub(super) struct Expected<const VAS: usize> {
    pub(super) direct: Regression,
    pub(super) direct_path: Expectation,
    pub(super) virtual_anchors: Vec<Regression, VAS>,
    pub(super) expectations: Vec<Expectation, VAS>,
}

impl<const VAS: usize> Expected<VAS> {
    /// See [`evidence_nat`].
    pub(super) fn evidence_nat<const PATHS: usize>(&self, scan: &Scan<PATHS>, clutter: &Clutter) -> f32 {
        evidence_nat(&scan.measurements, &self.direct_path, self.expectations.iter(), clutter)
    }
}

/// A scan with what it was compared to, and the outcome.
pub(super) struct AssociatedScan<'a, const VAS: usize, const PATHS: usize> {
    pub(super) scan: &'a Scan<PATHS>,
    pub(super) direct: Regression,
    pub(super) virtual_anchors: Vec<Regression, VAS>,
    pub(super) claims: Claims<PATHS>,
    pub(super) beliefs: Beliefs<VAS, PATHS>,
    /// Evidence that the tag is where it is believed to be, nats.
    pub(super) evidence_nat: f32,
}

impl<const VAS: usize, const PATHS: usize> AssociatedScan<'_, VAS, PATHS> {
    /// Every feature with the beliefs about it, the direct path first.
    pub(super) fn features(&self) -> impl Iterator<Item = (&Regression, &Belief<PATHS>)> + Clone {
        core::iter::once(&self.direct).chain(&self.virtual_anchors).zip(self.beliefs.features())
    }
}

impl<const ANCHORS: usize, const VAS: usize, const PATHS: usize, const ACTIONS: usize>
    Tracker<ANCHORS, VAS, PATHS, ACTIONS>
{
    /// Compares every scan with its anchor's features at the predicted state.
    pub(super) fn associate<'a>(
        &self,
        scans: &'a Vec<Scan<PATHS>, ANCHORS>,
        tag_height_m: Option<f32>,
        observer: &mut impl Observer<VAS, PATHS>,
    ) -> Vec<AssociatedScan<'a, VAS, PATHS>, ANCHORS> {
        let mut heard: Vec<AssociatedScan<'a, VAS, PATHS>, ANCHORS> = Vec::new();
        for scan in scans {
            let anchor = scan.anchor;
            if let Some(associated) = self.associate_scan(scan, tag_height_m) {
                observer.expectations(anchor, &associated.direct, &associated.virtual_anchors);
                observer.beliefs(anchor, &associated.scan.measurements, &associated.beliefs);
                // As many as scans: the push succeeds.
                let _ = heard.push(associated);
            }
        }
        heard
    }

    #[inline(never)]
    fn associate_scan<'a>(
        &self,
        scan: &'a Scan<PATHS>,
        tag_height_m: Option<f32>,
    ) -> Option<AssociatedScan<'a, VAS, PATHS>> {
        let anchor = scan.anchor;
        let expected = self.expect(scan, tag_height_m)?;
        let clutter = self.clutter(anchor);
        let evidence_nat = expected.evidence_nat(scan, &clutter);
        let Expected { direct, virtual_anchors, direct_path, expectations } = expected;
        let viewpoint = self.viewpoint(anchor, tag_height_m)?;
        let claims = self.discovery.claim(anchor, &viewpoint, &scan.measurements, &self.background(anchor));
        let mut beliefs =
            associate(&direct_path, &expectations, &scan.measurements, &claims.totals(), &clutter);
        if self.config.association.mode == Mode::Map {
            beliefs.harden();
        }
        Some(AssociatedScan { scan, direct, virtual_anchors, claims, beliefs, evidence_nat })
    }

    /// What is expected of an anchor's features before a scan.
    #[inline(never)]
    pub(super) fn expect(&self, scan: &Scan<PATHS>, tag_height_m: Option<f32>) -> Option<Expected<VAS>> {
        let anchor = scan.anchor;
        let sight = self.sight(anchor, tag_height_m)?;
        let expectation = |regression: &Regression, existence: f32, detection: f32| Expectation {
            range_m: regression.range_m,
            variance_m2: regression.variance_m2(),
            existence,
            detection,
        };
        let direct = self.filter.regress(Source::Direct { anchor }, &sight)?;
        let direct_path =
            expectation(&direct, 1.0, self.detection(direct.source, scan, Some(direct.range_m)));
        let mut expected =
            Expected { direct, direct_path, virtual_anchors: Vec::new(), expectations: Vec::new() };
        for (slot, record) in self.environment.iter() {
            if record.anchor == anchor {
                let regression = self.filter.regress(Source::Virtual { anchor, slot }, &sight)?;
                let detection = self.detection(regression.source, scan, Some(regression.range_m));
                let survival = self.config.association.survival_probability;
                let existence = self.environment.expected_existence(slot, survival, detection);
                // One per slot at most: the pushes succeed.
                let _ = expected.virtual_anchors.push(regression);
                let _ = expected.expectations.push(expectation(&regression, existence, detection));
            }
        }
        self.overlap(scan, &mut expected);
        Some(expected)
    }

    /// Intensities of what an anchor delivers that belongs to nothing known.
    pub(super) fn clutter(&self, anchor: usize) -> Clutter {
        let background = self.background(anchor);
        Clutter { false_alarms_per_m: background.false_alarms_per_m, all_per_m: background.all_per_m }
    }

    /// Takes into account that paths of a frame disturb each other: their ranges are worth less, and two may be found
    /// as one.
    #[inline(never)]
    fn overlap(&self, scan: &Scan<PATHS>, expected: &mut Expected<VAS>) {
        let Expected { direct, direct_path, virtual_anchors, expectations } = expected;
        let Some(action) = self.library.get(scan.action) else { return };
        if !scan.framed {
            return;
        }
        let pulse = self.config.radio.pulse(action);
        let arrival = |regression: &Regression, expectation: &Expectation| Arrival {
            range_m: expectation.range_m,
            presence: expectation.existence * expectation.detection,
            sinr: self.channel.sinr(regression.source, scan.action),
        };
        let first = arrival(direct, direct_path);
        let mut others: Vec<Arrival, VAS> = Vec::new();
        for (regression, expectation) in virtual_anchors.iter().zip(expectations.iter()) {
            // Capacities are equal: every push succeeds.
            let _ = others.push(arrival(regression, expectation));
        }
        let apply = |overlap: &Overlap, regression: &mut Regression, expectation: &mut Expectation| {
            regression.residual_m2 += overlap.variance_m2;
            expectation.variance_m2 = regression.variance_m2();
            expectation.detection = overlap.resolved(expectation.detection);
        };
        let mut overlap = Overlap::default();
        for other in &others {
            overlap.add(&pulse, &first, other);
        }
        apply(&overlap, direct, direct_path);
        let features = virtual_anchors.iter_mut().zip(expectations);
        for ((k, own), (regression, expectation)) in others.iter().enumerate().zip(features) {
            let mut overlap = Overlap::default();
            overlap.add(&pulse, own, &first);
            for (l, other) in others.iter().enumerate() {
                if l != k {
                    overlap.add(&pulse, own, other);
                }
            }
            apply(&overlap, regression, expectation);
        }
    }

    /// Probability that the path of an existing source is found in a scan: of frames by its SINR as remembered.
    pub(super) fn detection(&self, source: Source, scan: &Scan<PATHS>, range_m: Option<f32>) -> f32 {
        let told = self.config.association.detection_probability;
        if !scan.framed {
            return told;
        }
        if self.channel.has_seen(source) {
            let (_, found) = self.expected_sinr(source, scan, range_m);
            return limited(self.channel.visibility(source) * found, HIDDEN_DETECTION, told);
        }
        match source {
            Source::Virtual { slot, .. }
                if self.environment.get(slot).is_some_and(|record| record.hits == 0) =>
            {
                HIDDEN_DETECTION
            }
            _ => told,
        }
    }

    /// SINR of a source in a scan if nothing hides it, and the probability that it is then found: what is remembered, or
    /// less where the frame is noisier.
    pub(super) fn expected_sinr(
        &self,
        source: Source,
        scan: &Scan<PATHS>,
        range_m: Option<f32>,
    ) -> (f32, f32) {
        let mut sinr = self.channel.sinr(source, scan.action);
        if let Some(range_m) = range_m
            && let Some(level) = scan.level(range_m)
            && let Some(now) = self.channel.sinr_over(source, scan.action, range_m, level)
        {
            sinr = smaller(sinr, now);
        }
        (sinr, detection_probability(sinr, scan.threshold))
    }

    /// The same for every slot of the map; 0 for free ones.
    pub(super) fn detections(&self, scan: &Scan<PATHS>) -> [f32; VAS] {
        let mut detections = [0.0; VAS];
        for (slot, record) in self.environment.iter() {
            if let Some(detection) = detections.get_mut(slot) {
                *detection = self.detection(Source::Virtual { anchor: record.anchor, slot }, scan, None);
            }
        }
        detections
    }
}
