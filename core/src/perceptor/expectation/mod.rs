//! Expectation: what every source of a scan is expected to show, once per scan and place of the tag.
//!
//! Range and its variance come from the regression on the state, existence from the map, detection from what the plan lets
//! through to the place, from what is known of the channel, and from the scan's own noise. Paths of a frame disturb each other
//! ([`overlap`]): their ranges are worth less, and two may be found as one.

pub mod overlap;

use self::overlap::{Arrival, Nearness, Overlap};
use super::scan::Scan;
use crate::model::channel::ChannelPrior;
use crate::model::detection::{HIDDEN_DETECTION, UNAVAILABLE_DETECTION, detection_probability};
use crate::model::lateness::{Lateness, Timing};
use crate::model::measurement::Measurement;
use crate::model::range::Regression;
use crate::radio::pulse::Pulse;
use crate::real::{limited, smaller};
use crate::snapshot::{Blank, Reader, Sink, SnapshotError, Stored, Written};
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
    /// How late ranges to it are.
    pub lateness: Lateness,
}

impl Expectation {
    /// Whether a measurement, were it of this feature, may be late.
    pub fn may_be_late(&self, measurement: &Measurement) -> bool {
        measurement.is_range() && self.lateness.is_any()
    }

    /// What a measurement says, were it of this feature, where that may be late; `None` where it is on time or not at all.
    #[inline]
    pub fn timing(&self, measurement: &Measurement) -> Option<Timing> {
        if !self.may_be_late(measurement) {
            return None;
        }
        let innovation_m = measurement.range_m - self.range_m;
        Some(self.lateness.timing(innovation_m, self.variance_m2 + measurement.variance_m2))
    }
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
    /// Probability that the plan lets its path through to where the tag is; 1 without a plan.
    pub availability: f32,
}

/// Whether the path of a source that exists can be seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Sighting {
    /// It is expected to be seen.
    Open,
    /// Something hides it, the noise among others; or it is a virtual anchor that nobody has seen yet.
    Hidden,
}

/// How probable it is that the path of an existing source is found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Detection {
    /// The probability.
    pub probability: f32,
    /// The probability if nothing hides the source but the plan and the noise.
    pub found: f32,
    /// Whether it can be seen.
    pub sighting: Sighting,
}

impl Prospect {
    /// How probable it is that its path is found: see [`detection`].
    pub fn detection<const PATHS: usize>(&self, scan: &Scan<PATHS>, told: f32) -> Detection {
        detection(scan, told, &self.channel, self.sinr_here, self.is_unseen_image, self.availability)
    }
}

/// SINR as remembered, or less where the frame is noisier.
fn sinr_now(channel: &ChannelPrior, here: Option<f32>) -> f32 {
    here.map_or(channel.sinr, |here| smaller(channel.sinr, here))
}

/// How probable it is that the path of an existing source is found in a scan: of frames by its SINR as remembered, or less
/// where the frame is noisier; `told` is the probability for ranges that nothing hides and for what was never seen. All of it
/// where the plan lets the path through, hardly any where it does not.
pub fn detection<const PATHS: usize>(
    scan: &Scan<PATHS>,
    told: f32,
    channel: &ChannelPrior,
    sinr_here: Option<f32>,
    is_unseen_image: bool,
    availability: f32,
) -> Detection {
    let (found, visible, is_unknown) = if scan.is_framed() {
        let found = detection_probability(sinr_now(channel, sinr_here), scan.threshold());
        match (channel.seen, is_unseen_image) {
            (true, _) => (found, channel.visibility * found, false),
            (false, true) => (found, HIDDEN_DETECTION, true),
            (false, false) => (found, told, false),
        }
    } else {
        (told, channel.visibility * told, false)
    };
    let is_hidden = is_unknown || visible * availability <= HIDDEN_DETECTION;
    let open = limited(visible, HIDDEN_DETECTION, told);
    Detection {
        probability: open - (open - UNAVAILABLE_DETECTION) * (1.0 - availability),
        found: found * availability,
        sighting: if is_hidden { Sighting::Hidden } else { Sighting::Open },
    }
}

/// What is expected of the sources of one anchor: their regressions, and what association makes of them.
#[derive(Clone, Debug)]
pub struct Expectations<const SOURCES: usize> {
    /// The direct path on the state.
    pub direct: Regression,
    /// The direct path.
    pub direct_path: Expectation,
    /// The anchor's virtual anchors on the state, in the order of their slots.
    pub virtual_anchors: Vec<Regression, SOURCES>,
    /// What is expected of each of them.
    pub expectations: Vec<Expectation, SOURCES>,
    /// How each can be seen, the direct path first.
    pub(in crate::perceptor) views: (View, Vec<View, SOURCES>),
}

/// How a source can be seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// SINR where nothing hides it.
    sinr: f32,
    /// Probability that its path is found if nothing hides it but the noise.
    pub found: f32,
    /// Share (0 to 1) of its detection that does not rest on its coming out again.
    pub lasting: f32,
    /// Whether it can be seen.
    pub sighting: Sighting,
    /// Probability that its path is there, found or not.
    pub present: f32,
    /// SINR of its path then, over the noise of this frame.
    pub sinr_now: f32,
    /// Whether a frame has shown it.
    pub is_seen: bool,
}

impl View {
    /// Of a source that nothing shows.
    const NONE: Self = Self {
        sinr: 0.0,
        found: 0.0,
        lasting: 0.0,
        sighting: Sighting::Hidden,
        present: 0.0,
        sinr_now: 0.0,
        is_seen: false,
    };
}

impl<const SOURCES: usize> Expectations<SOURCES> {
    /// Nothing is expected.
    // A function: of a constant, all room for virtual anchors would be copied out of the flash.
    #[inline(always)]
    pub(crate) const fn none() -> Self {
        Self {
            direct: Regression::NONE,
            direct_path: Expectation {
                range_m: 0.0,
                variance_m2: 0.0,
                existence: 0.0,
                detection: 0.0,
                lateness: Lateness::NONE,
            },
            virtual_anchors: Vec::new(),
            expectations: Vec::new(),
            views: (View::NONE, Vec::new()),
        }
    }

    /// What a direct path is expected to show, and no virtual anchors yet.
    pub fn new(direct: &Prospect, detection: &Detection) -> Self {
        let mut expected = Self::none();
        expected.begin(direct, detection);
        expected
    }

    /// [`Self::new`], in place of what was expected before.
    pub fn begin(&mut self, direct: &Prospect, detection: &Detection) {
        self.direct = direct.regression;
        self.direct_path = expectation(&direct.regression, 1.0, detection);
        self.virtual_anchors.clear();
        self.expectations.clear();
        self.views.0 = view(direct, detection);
        self.views.1.clear();
    }

    /// Adds a virtual anchor that exists with probability `existence`.
    pub fn add(&mut self, image: &Prospect, existence: f32, detection: &Detection) {
        // One per slot at most: the pushes succeed.
        let _ = self.virtual_anchors.push(image.regression);
        let _ = self.expectations.push(expectation(&image.regression, existence, detection));
        let _ = self.views.1.push(view(image, detection));
    }

    /// Takes into account how late ranges of the direct path are.
    pub fn delay(&mut self, lateness: Lateness) {
        self.direct_path.lateness = lateness;
    }

    /// How every source can be seen, the direct path first.
    pub fn views(&self) -> impl Iterator<Item = &View> + Clone {
        core::iter::once(&self.views.0).chain(&self.views.1)
    }

    /// Probability that each source exists, the direct path first.
    pub fn existences(&self) -> impl Iterator<Item = f32> + Clone {
        core::iter::once(&self.direct_path).chain(&self.expectations).map(|expectation| expectation.existence)
    }

    /// Probability that each source shows a path, the direct path first.
    pub fn paths(&self) -> impl Iterator<Item = f32> + Clone {
        core::iter::once(&self.direct_path)
            .chain(&self.expectations)
            .map(|expectation| expectation.existence * expectation.detection)
    }

    /// Every regression, the direct path's first.
    pub fn regressions(&self) -> impl Iterator<Item = &Regression> + Clone {
        core::iter::once(&self.direct).chain(&self.virtual_anchors)
    }

    /// Takes into account that paths received with this pulse disturb each other.
    #[inline(never)]
    pub fn disturb(&mut self, pulse: &Pulse) {
        if SOURCES == 0 {
            return; // The direct path has no neighbours.
        }
        let Self { direct, direct_path, virtual_anchors, expectations, views } = self;
        let first = arrival(direct_path, views.0.sinr);
        let mut others: Vec<Arrival, SOURCES> = Vec::new();
        for (expectation, view) in expectations.iter().zip(&views.1) {
            // Capacities are equal: every push succeeds.
            let _ = others.push(arrival(expectation, view.sinr));
        }
        let apply = |overlap: &Overlap, regression: &mut Regression, expectation: &mut Expectation| {
            regression.residual_m2 += overlap.variance_m2;
            expectation.variance_m2 = regression.variance_m2();
            expectation.detection = overlap.resolved(expectation.detection);
        };
        // How near two paths are is worked out once for both. Each adds up its neighbours in their order.
        let mut of_first = Overlap::default();
        let mut overlaps = [Overlap::default(); SOURCES];
        for (own, overlap) in others.iter().zip(&mut overlaps) {
            if let Some(near) = Nearness::of(pulse, own, &first) {
                of_first.add(&near, &first, own);
                overlap.add(&near, own, &first);
            }
        }
        let mut rest = (others.as_slice(), overlaps.as_mut_slice());
        while let ([own, others @ ..], [own_overlap, overlaps @ ..]) = rest {
            for (other, overlap) in others.iter().zip(overlaps.iter_mut()) {
                if let Some(near) = Nearness::of(pulse, own, other) {
                    own_overlap.add(&near, own, other);
                    overlap.add(&near, other, own);
                }
            }
            rest = (others, overlaps);
        }
        apply(&of_first, direct, direct_path);
        let sources = virtual_anchors.iter_mut().zip(expectations);
        for (overlap, (regression, expectation)) in overlaps.iter().zip(sources) {
            apply(overlap, regression, expectation);
        }
    }
}

fn arrival(expectation: &Expectation, sinr: f32) -> Arrival {
    Arrival { range_m: expectation.range_m, presence: expectation.existence * expectation.detection, sinr }
}

fn expectation(regression: &Regression, existence: f32, detection: &Detection) -> Expectation {
    Expectation {
        range_m: regression.range_m,
        variance_m2: regression.variance_m2(),
        existence,
        detection: detection.probability,
        lateness: Lateness::NONE,
    }
}

fn view(prospect: &Prospect, detection: &Detection) -> View {
    let Prospect { channel, availability, .. } = prospect;
    let ChannelPrior { lasting, sinr, seen, present, .. } = *channel;
    let lasting = smaller(lasting * detection.found / detection.probability, 1.0);
    View {
        sinr,
        found: detection.found,
        lasting,
        sighting: detection.sighting,
        present: present * (UNAVAILABLE_DETECTION + (1.0 - UNAVAILABLE_DETECTION) * availability),
        sinr_now: sinr_now(channel, prospect.sinr_here),
        is_seen: seen,
    }
}

impl Written for Sighting {
    fn write(&self, to: &mut impl Sink) {
        (*self == Self::Hidden).write(to);
    }
}

impl Stored for Sighting {
    fn read(&mut self, from: &mut Reader<'_>) -> Result<(), SnapshotError> {
        let mut is_hidden = *self == Self::Hidden;
        is_hidden.read(from)?;
        *self = if is_hidden { Self::Hidden } else { Self::Open };
        Ok(())
    }
}

impl Blank for Sighting {
    fn blank() -> Self {
        Self::Open
    }
}
