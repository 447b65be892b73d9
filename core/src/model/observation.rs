//! What the radio delivers in one cycle: raw frames, or ranges somebody else estimated.

use crate::error::Error;
use crate::radio::accumulator::Cir;
use crate::real::{SPEED_OF_LIGHT_M_S, abs};

/// Guard: against overflow: largest sample magnitude accepted: energies times squared ranges, summed over a frame, stay finite in f32.
const LARGEST_SAMPLE: f32 = 1e12;

/// Complex baseband sample: real and imaginary part.
pub type Complex = [f32; 2];

/// The samples of one frame, evenly spaced, as they leave the receiver's matched filter (what radios log as
/// the channel impulse response).
#[derive(Clone, Copy, Debug)]
pub enum Samples<'a> {
    /// Amplitude and phase.
    Complex(&'a [Complex]),
    /// Amplitude alone, for radios that log no phase; not negative.
    Magnitude(&'a [f32]),
}

impl Samples<'_> {
    /// Number of samples.
    pub fn len(&self) -> usize {
        match self {
            Samples::Complex(samples) => samples.len(),
            Samples::Magnitude(samples) => samples.len(),
        }
    }

    /// Whether there is no sample.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Whether paths can be looked for in these samples.
    ///
    /// # Errors
    /// The first fault.
    pub fn check(&self) -> Result<(), SampleFault> {
        if self.is_empty() {
            return Err(SampleFault::Empty);
        }
        if self.len() > usize::from(u16::MAX) {
            return Err(SampleFault::TooMany);
        }
        let mut silent = true;
        match self {
            Samples::Complex(samples) => {
                for (sample, value) in samples.iter().enumerate() {
                    for part in value {
                        if !(abs(*part) < LARGEST_SAMPLE) {
                            return Err(SampleFault::NotFinite { sample });
                        }
                        silent &= *part == 0.0;
                    }
                }
            }
            Samples::Magnitude(samples) => {
                for (sample, value) in samples.iter().enumerate() {
                    if !(abs(*value) < LARGEST_SAMPLE) {
                        return Err(SampleFault::NotFinite { sample });
                    }
                    if *value < 0.0 {
                        return Err(SampleFault::Negative { sample });
                    }
                    silent &= *value == 0.0;
                }
            }
        }
        if silent { Err(SampleFault::Silent) } else { Ok(()) }
    }

    /// How many samples reach a level with either part.
    fn reaching(&self, level: f32) -> usize {
        match self {
            Samples::Complex(samples) => {
                samples.iter().filter(|value| value.iter().any(|part| abs(*part) >= level)).count()
            }
            Samples::Magnitude(samples) => samples.iter().filter(|value| **value >= level).count(),
        }
    }
}

/// Why samples are refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum SampleFault {
    /// There is none.
    Empty,
    /// There are more than 65535.
    TooMany,
    /// One is NaN, infinite or beyond 1e12.
    NotFinite {
        /// Index of the first such sample.
        sample: usize,
    },
    /// A magnitude is below zero.
    Negative {
        /// Index of the first such sample.
        sample: usize,
    },
    /// All are zero.
    Silent,
}

impl core::fmt::Display for SampleFault {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Empty => write!(f, "the frame has no samples"),
            Self::TooMany => write!(f, "the frame has more than 65535 samples"),
            Self::NotFinite { sample } => {
                write!(f, "sample {sample} is not a finite number below 1e12 in magnitude")
            }
            Self::Negative { sample } => write!(f, "sample {sample} is a negative magnitude"),
            Self::Silent => write!(f, "all samples are zero"),
        }
    }
}

impl core::error::Error for SampleFault {}

/// One received channel impulse response.
#[derive(Clone, Copy, Debug)]
pub struct Frame<'a> {
    /// Index of the anchor.
    pub anchor: usize,
    /// Index of the action (carrier and pulse) the frame was received with.
    pub action: usize,
    /// The radio's frame counter, where it has one: the anchor's last value again is refused as a duplicate.
    pub sequence: Option<u32>,
    /// Propagation delay that the first sample stands for, seconds; may be negative.
    pub first_sample_delay_s: f32,
    /// The samples.
    pub samples: Samples<'a>,
}

/// Here and not beside its type, as a radio knows no model.
impl<const N: usize> Cir<N> {
    /// The frame of this response, whose samples it borrows: of an anchor, received with an action (indexes), without a sequence number.
    /// Its delays follow from the length of the first path as ranging has it (metres) and from by how many samples the pulse's
    /// maximum comes behind the radio's first-path index: [`crate::radio::accumulator`] has the formula. The tracker refuses what is
    /// not finite.
    pub fn frame(
        &self,
        anchor: usize,
        action: usize,
        first_path_range_m: f32,
        peak_after_first_path_samples: f32,
    ) -> Frame<'_> {
        Frame {
            anchor,
            action,
            sequence: None,
            first_sample_delay_s: self
                .first_sample_delay_s(first_path_range_m, peak_after_first_path_samples),
            samples: Samples::Complex(self.samples()),
        }
    }
}

/// A range estimated outside cogmint.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Range {
    /// Distance, metres.
    pub range_m: f32,
    /// Variance, square metres.
    pub variance_m2: f32,
}

/// Capacity: the most ranges that a scan may have: what an untrusted source can make a cycle look at.
pub const LONGEST_SCAN: usize = 4096;

/// The ranges of one anchor in one cycle, in any order; which of them is the direct path is not known.
///
/// All of them are checked, and the best `PATHS` are kept: those of the smallest variance, which tell most; among
/// equals the shortest, since paths lose energy on their way and false ranges do not; among those the first. How
/// many were left out is reported.
#[derive(Clone, Copy, Debug)]
pub struct RangeScan<'a> {
    /// Index of the anchor.
    pub anchor: usize,
    /// At most [`LONGEST_SCAN`] ranges.
    pub ranges: &'a [Range],
}

/// One anchor's contribution to a cycle. An anchor may deliver both a frame and a scan: the scan's ranges then
/// replace the frame's paths within a pulse duration of them.
#[derive(Clone, Copy, Debug)]
pub enum Observation<'a> {
    /// Raw samples.
    Frame(Frame<'a>),
    /// Ranges.
    Ranges(RangeScan<'a>),
}

impl Observation<'_> {
    /// Index of the anchor.
    pub fn anchor(&self) -> usize {
        match self {
            Observation::Frame(frame) => frame.anchor,
            Observation::Ranges(scan) => scan.anchor,
        }
    }
}

/// What a frame must satisfy.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FrameRules {
    pub samples: usize,
    pub full_scale: Option<f32>,
    pub max_range_m: f32,
}

/// Checks a frame's samples and delay; says what is wrong with the first offending one.
pub(crate) fn check_frame(frame: &Frame<'_>, rules: &FrameRules) -> Result<(), Error> {
    let anchor = frame.anchor;
    let given = frame.samples.len();
    if given != rules.samples {
        return Err(Error::FrameLength { anchor, given, expected: rules.samples });
    }
    let longest_delay_s = rules.max_range_m / SPEED_OF_LIGHT_M_S;
    // Radios log before the first path as well: up to 10 us of lead is normal.
    if !(frame.first_sample_delay_s > -1e-5 && frame.first_sample_delay_s < longest_delay_s) {
        return Err(Error::FrameDelay { anchor });
    }
    frame.samples.check().map_err(|fault| match fault {
        SampleFault::Empty | SampleFault::TooMany => {
            Error::FrameLength { anchor, given, expected: rules.samples }
        }
        SampleFault::NotFinite { sample } => Error::SampleNotFinite { anchor, sample },
        SampleFault::Negative { sample } => Error::NegativeMagnitude { anchor, sample },
        SampleFault::Silent => Error::SilentFrame { anchor },
    })?;
    let saturated = rules.full_scale.map_or(0, |full_scale| frame.samples.reaching(full_scale));
    // One sample may graze full scale; two or more mean a clipped pulse.
    if saturated > 1 {
        return Err(Error::SaturatedFrame { anchor, samples: saturated });
    }
    Ok(())
}

/// The tag's height as it is told: a mean with a deviation, in the frame of the anchors' heights.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct TagHeight {
    /// Mean, metres (-1000 to 1000).
    pub mean_m: f32,
    /// Standard deviation, metres (0 to 100). The larger, the less ranges count of anchors seen steeply from the tag.
    pub std_m: f32,
}

impl TagHeight {
    /// A height known exactly.
    pub const fn exact(mean_m: f32) -> Self {
        Self { mean_m, std_m: 0.0 }
    }

    /// Whether both are within their limits; not with NaN.
    pub(crate) fn is_in_range(&self) -> bool {
        abs(self.mean_m) <= 1000.0 && self.std_m >= 0.0 && self.std_m <= 100.0
    }
}

/// Checks a scan's length and every one of its ranges.
pub(crate) fn check_scan(scan: &RangeScan<'_>, max_range_m: f32) -> Result<(), Error> {
    let anchor = scan.anchor;
    if scan.ranges.len() > LONGEST_SCAN {
        return Err(Error::RangeCount { anchor, given: scan.ranges.len(), limit: LONGEST_SCAN });
    }
    for (index, range) in scan.ranges.iter().enumerate() {
        if !(range.range_m > 0.0 && range.range_m <= max_range_m) {
            return Err(Error::Range { anchor, index });
        }
        if !(range.variance_m2 >= 1e-6 && range.variance_m2 <= 1e4) {
            return Err(Error::RangeVariance { anchor, index });
        }
    }
    Ok(())
}
