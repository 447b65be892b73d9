//! What the core refuses, and why.
//!
//! Every error names the offending input. A call that returns an error has changed nothing: the state is
//! the same to the bit as before it.

use core::fmt;

/// A refused call.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Error {
    /// A configuration value is outside its range.
    Configuration(Setting),
    /// More anchors than `ANCHORS`, or none.
    AnchorCount {
        /// Anchors given.
        given: usize,
        /// The capacity.
        limit: usize,
    },
    /// More virtual anchors in the map than `SURFACES` or `SOURCES`.
    VirtualAnchorCount {
        /// Virtual anchors given.
        given: usize,
        /// The capacity.
        limit: usize,
    },
    /// A cycle is begun that was not finished.
    AlreadyBegun,
    /// The tracker was not started, or its start was refused.
    NotStarted,
    /// No cycle is begun.
    NotBegun,
    /// An anchor's or a virtual anchor's geometry is not finite or out of range.
    Geometry {
        /// Index in the list given.
        index: usize,
    },
    /// More walls, segments or corners of the outline than `SEGMENTS`.
    PlanSize {
        /// The most given of any.
        given: usize,
        /// The capacity.
        limit: usize,
    },
    /// The plan's turn is not 0 to 1 rad, or its reflections more than 2.
    PlanSettings,
    /// A wall of the plan has no segment, or a deviation out of range.
    PlanWall {
        /// Its index.
        index: usize,
    },
    /// A segment of the plan is of no wall, off its wall's line, without length, or out of range.
    PlanSegment {
        /// Its index.
        index: usize,
    },
    /// A corner of the outline is out of range, or there are fewer than three.
    PlanOutline {
        /// Its index.
        index: usize,
    },
    /// No anchor with this index.
    UnknownAnchor {
        /// The index asked for.
        anchor: usize,
    },
    /// No action with this index in the library.
    UnknownAction {
        /// The index asked for.
        action: usize,
    },
    /// Two observations of the same kind for one anchor in one cycle, or the sequence number of its last frame again.
    DuplicateFrame {
        /// The anchor.
        anchor: usize,
    },
    /// Time stands still, runs backwards, or jumps beyond the longest gap.
    Time {
        /// The elapsed time given, seconds.
        elapsed_s: f32,
    },
    /// A frame with another number of samples than configured.
    FrameLength {
        /// The anchor.
        anchor: usize,
        /// Samples given.
        given: usize,
        /// Samples expected.
        expected: usize,
    },
    /// A sample is NaN, infinite or beyond 1e12.
    SampleNotFinite {
        /// The anchor.
        anchor: usize,
        /// Index of the first such sample.
        sample: usize,
    },
    /// Every sample of the frame is zero.
    SilentFrame {
        /// The anchor.
        anchor: usize,
    },
    /// Samples stand at the converter's full scale.
    SaturatedFrame {
        /// The anchor.
        anchor: usize,
        /// How many samples.
        samples: usize,
    },
    /// A magnitude below zero.
    NegativeMagnitude {
        /// The anchor.
        anchor: usize,
        /// Index of the first such sample.
        sample: usize,
    },
    /// The delay of the frame's first sample is not finite or beyond the longest range.
    FrameDelay {
        /// The anchor.
        anchor: usize,
    },
    /// A range is not finite, not positive, or beyond the longest range.
    Range {
        /// The anchor.
        anchor: usize,
        /// Index in the scan.
        index: usize,
    },
    /// A range's variance is not finite, or outside (1 mm)^2 to (100 m)^2.
    RangeVariance {
        /// The anchor.
        anchor: usize,
        /// Index in the scan.
        index: usize,
    },
    /// More ranges in one scan than [`crate::model::observation::LONGEST_SCAN`].
    RangeCount {
        /// The anchor.
        anchor: usize,
        /// Ranges given.
        given: usize,
        /// The most allowed.
        limit: usize,
    },
    /// The tag's height is not finite or beyond 1 km, or its deviation negative or beyond 100 m.
    TagHeight,
    /// The antenna is too far from the centre of the tag's body, or no heading is estimated.
    LeverArm,
    /// A SINR told to the channel memory is not finite, or there is not one per action.
    ToldSinr,
    /// What the tracker was told (configuration, anchors, plan, actions) is not what it was: a bit has flipped in it.
    ToldChanged,
}

/// The configuration values that can be out of range.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[allow(missing_docs)] // named after the fields they stand for
#[non_exhaustive]
pub enum Setting {
    AccelerationDensity,
    /// Time constant of the velocity's decay.
    VelocityDecay,
    VirtualAnchorWalk,
    StartPosition,
    StartDeviation,
    BiasPrior,
    /// `ranging.late_m`.
    Lateness,
    /// `has_heading`: there is no surface to spare for it.
    Heading,
    RangeVarianceInflation,
    RangeFloor,
    DetectionProbability,
    ClutterPerAnchor,
    UnmappedPerAnchor,
    MaxRange,
    MapChange,
    Turns,
    Elsewhere,
    Outages,
    SplitAbove,
    Comparisons,
    ChannelMemory,
    DiscoveryBegin,
    DiscoveryHits,
    DiscoveryWeight,
    PulseDuration,
    RollOff,
    PulseShape,
    SampleSpacing,
    SampleCount,
    FullScale,
    FalsePaths,
    DenseDecay,
    AnchorWork,
    MergeDistance,
    Carrier,
    LibraryEmpty,
    LibraryLength,
    FirstAction,
    Rendezvous,
    Restriction,
    LearningRate,
    Discount,
    Temperature,
    Exploration,
    /// Patience of the search for a lost tag.
    Patience,
    Hysteresis,
    PlannedActions,
    Horizon,
    PriorSinr,
    RewardScale,
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Error::Configuration(setting) => write!(f, "the configuration's {setting:?} is out of range"),
            Error::AnchorCount { given, limit } => write!(f, "{given} anchors given, 1 to {limit} allowed"),
            Error::VirtualAnchorCount { given, limit } => {
                write!(f, "{given} virtual anchors given, at most {limit} allowed")
            }
            Error::Geometry { index } => {
                write!(f, "the position or deviation of entry {index} is out of range")
            }
            Error::PlanSize { given, limit } => {
                write!(
                    f,
                    "a plan of {given} walls, segments or corners given, at most {limit} of each allowed"
                )
            }
            Error::PlanSettings => write!(f, "the plan's turn or its number of reflections is out of range"),
            Error::PlanWall { index } => {
                write!(f, "wall {index} of the plan has no segment, or a deviation out of range")
            }
            Error::PlanSegment { index } => {
                write!(
                    f,
                    "segment {index} of the plan is out of range, without length or off its wall's line"
                )
            }
            Error::PlanOutline { index } => {
                write!(f, "corner {index} of the outline is out of range, or fewer than three are given")
            }
            Error::UnknownAnchor { anchor } => write!(f, "there is no anchor {anchor}"),
            Error::UnknownAction { action } => write!(f, "there is no action {action} in the library"),
            Error::NotStarted => write!(f, "the tracker is not started"),
            Error::AlreadyBegun => write!(f, "a cycle is begun that was not finished"),
            Error::NotBegun => write!(f, "no cycle is begun"),
            Error::DuplicateFrame { anchor } => write!(f, "anchor {anchor} delivered the same frame twice"),
            Error::Time { elapsed_s } => {
                write!(f, "{elapsed_s} s since the last cycle: time must advance, by at most an hour")
            }
            Error::FrameLength { anchor, given, expected } => {
                write!(f, "the frame of anchor {anchor} has {given} samples, {expected} expected")
            }
            Error::SampleNotFinite { anchor, sample } => {
                write!(f, "sample {sample} of anchor {anchor} is not a finite number")
            }
            Error::SilentFrame { anchor } => write!(f, "every sample of anchor {anchor} is zero"),
            Error::SaturatedFrame { anchor, samples } => {
                write!(f, "{samples} samples of anchor {anchor} stand at full scale")
            }
            Error::NegativeMagnitude { anchor, sample } => {
                write!(f, "magnitude {sample} of anchor {anchor} is negative")
            }
            Error::FrameDelay { anchor } => write!(f, "the frame delay of anchor {anchor} is out of range"),
            Error::Range { anchor, index } => write!(f, "range {index} of anchor {anchor} is out of range"),
            Error::RangeVariance { anchor, index } => {
                write!(f, "the variance of range {index} of anchor {anchor} is out of range")
            }
            Error::RangeCount { anchor, given, limit } => {
                write!(f, "anchor {anchor} delivered {given} ranges, at most {limit} allowed")
            }
            Error::TagHeight => write!(f, "the tag's height or its deviation is out of range"),
            Error::LeverArm => {
                write!(f, "the antenna's lever arm is out of range, or no heading is estimated")
            }
            Error::ToldSinr => {
                write!(f, "one finite SINR per action must be told, of a source that is there")
            }
            Error::ToldChanged => {
                write!(f, "a bit has flipped in what the tracker was told: it must be started anew")
            }
        }
    }
}

impl core::error::Error for Error {}
