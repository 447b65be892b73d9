//! Error codes.

use cogmint_core::radio::accumulator::CirError;
use cogmint_core::radio::two_way::TwoWayError;
use cogmint_core::{Error, Setting, SnapshotError};
use core::ffi::{CStr, c_char};

/// Why a call was refused. A call that is refused has changed nothing but what its description says.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CogmintError {
    /// Nothing is wrong.
    None = 0,

    /// A pointer is NULL that must not be.
    NullPointer = 1,
    /// A pointer is not aligned as its type needs.
    Alignment = 2,
    /// The memory is smaller than cogmint_tracker_size().
    MemorySize = 3,
    /// A count, or an index, is larger than anything that fits in memory.
    Count = 4,
    /// A profile, a radio, a kind of samples or a format that there is not.
    UnknownChoice = 5,

    /// No anchor, or more than COGMINT_MOST_ANCHORS.
    AnchorCount = 20,
    /// More virtual anchors than there are surfaces or sources.
    VirtualAnchorCount = 21,
    /// The position of an anchor or virtual anchor, or its deviation, is out of range.
    Geometry = 22,
    /// More walls, segments or corners than COGMINT_MOST_SEGMENTS.
    PlanSize = 23,
    /// The plan's turn or its number of reflections is out of range.
    PlanSettings = 24,
    /// A wall of the plan has no segment, or a deviation out of range.
    PlanWall = 25,
    /// A segment of the plan is out of range, without length, of no wall or off its wall's line.
    PlanSegment = 26,
    /// A corner of the outline is out of range, or there are fewer than three.
    PlanOutline = 27,

    /// A cycle is begun that was not finished.
    AlreadyBegun = 40,
    /// No cycle is begun.
    NotBegun = 41,
    /// The tracker is not started.
    NotStarted = 42,
    /// There is no such anchor.
    UnknownAnchor = 43,
    /// There is no such action.
    UnknownAction = 44,
    /// A second frame or scan of an anchor in one cycle, or the sequence number of its last frame again.
    DuplicateFrame = 45,
    /// The time elapsed is not above 0 and at most an hour.
    Time = 46,
    /// A frame with another number of samples than configured.
    FrameLength = 47,
    /// A sample is NaN, infinite or beyond 1e12.
    SampleNotFinite = 48,
    /// All samples of a frame are zero.
    SilentFrame = 49,
    /// Samples stand at the converter's full scale.
    SaturatedFrame = 50,
    /// A magnitude is below zero.
    NegativeMagnitude = 51,
    /// The delay of a frame's first sample is not finite or beyond the longest range.
    FrameDelay = 52,
    /// A range is not finite, not positive, or beyond the longest range.
    Range = 53,
    /// A range's variance is not finite, or not within (1 mm)^2 to (100 m)^2.
    RangeVariance = 54,
    /// More than COGMINT_MOST_RANGES ranges.
    RangeCount = 55,
    /// The tag's height or its deviation is out of range.
    TagHeight = 56,
    /// The antenna's lever arm is out of range, or no heading is estimated.
    LeverArm = 57,
    /// Something else that is refused.
    Refused = 58,
    /// A bit has flipped in what the tracker was told: start it anew.
    ToldChanged = 59,

    /// The buffer is too short for the snapshot; the bytes needed were written to `length`.
    SnapshotRoom = 70,
    /// The bytes are no snapshot, or one that is cut short.
    SnapshotForeign = 71,
    /// A snapshot of another version of its format.
    SnapshotVersion = 72,
    /// A snapshot of a tracker that was told something else, or that has other capacities; a map of other anchors or of another map told.
    SnapshotTold = 73,
    /// The snapshot is damaged.
    SnapshotDamaged = 74,

    /// The first-path index is NaN, negative, or 1024 or more.
    CirIndex = 80,
    /// The window has no sample, more than COGMINT_MOST_CIR_SAMPLES, or more than there is room for.
    CirLength = 81,
    /// The window begins ahead of the accumulator, or of the samples given.
    CirOutside = 82,
    /// The bytes of the accumulator end before the window does.
    CirBytes = 83,

    /// Two time stamps of one clock are in the wrong order, or 8.6 s or more apart.
    TwoWayOrder = 90,
    /// The clock offset is NaN or beyond 1e-4.
    TwoWayOffset = 91,
    /// A round takes no longer than the antenna delay in it.
    TwoWayDelay = 92,
    /// The time stamps make a range that is not positive, or beyond 10 km.
    TwoWayRange = 93,

    /// A setting is out of range that cogmint_config does not have.
    Setting = 100,
    /// `acceleration_density_m2_s3` is out of range.
    SettingAcceleration = 101,
    /// `velocity_decay_s` is out of range.
    SettingVelocityDecay = 102,
    /// `start_position_m` is out of range.
    SettingStartPosition = 103,
    /// `start_position_std_m` or `start_velocity_std_m_s` is out of range.
    SettingStartDeviation = 104,
    /// `has_heading`: there is no surface to spare for it.
    SettingHeading = 105,
    /// `range_variance_inflation` is out of range.
    SettingRangeInflation = 106,
    /// `range_floor_m` or `path_floor_pulses` is out of range.
    SettingRangeFloor = 107,
    /// `bias_mean_m` or `bias_std_m` is out of range.
    SettingBias = 108,
    /// `late_m` is out of range.
    SettingLateness = 109,
    /// `max_range_m` is out of range.
    SettingMaxRange = 110,
    /// `detection_probability` is out of range.
    SettingDetection = 111,
    /// `clutter_per_anchor` is out of range.
    SettingClutter = 112,
    /// `pulse_roll_off` is out of range.
    SettingRollOff = 113,
    /// `pulse_step_s` or `pulse_autocorrelation` is out of range, or `pulse_samples` neither 0 nor COGMINT_PULSE_SAMPLES.
    SettingPulse = 114,
    /// `sample_spacing_s` is out of range.
    SettingSampleSpacing = 115,
    /// `samples_per_frame` is out of range.
    SettingSampleCount = 116,
    /// `full_scale` is out of range.
    SettingFullScale = 117,
    /// `false_paths_per_frame` is out of range.
    SettingFalsePaths = 118,
    /// `first_action` is no index of an action.
    SettingFirstAction = 119,
    /// `rendezvous` is no index of an action.
    SettingRendezvous = 120,
    /// `planned_actions` is out of range.
    SettingPlannedActions = 121,
    /// `horizon` is out of range.
    SettingHorizon = 122,
    /// No action, or more than COGMINT_MOST_ACTIONS.
    ActionCount = 123,
    /// The carrier of an action is out of range.
    ActionCarrier = 124,
    /// The pulse duration of an action is out of range.
    ActionPulse = 125,
}

impl CogmintError {
    /// All of them.
    const ALL: [Self; 73] = [
        Self::None,
        Self::NullPointer,
        Self::Alignment,
        Self::MemorySize,
        Self::Count,
        Self::UnknownChoice,
        Self::AnchorCount,
        Self::VirtualAnchorCount,
        Self::Geometry,
        Self::PlanSize,
        Self::PlanSettings,
        Self::PlanWall,
        Self::PlanSegment,
        Self::PlanOutline,
        Self::AlreadyBegun,
        Self::NotBegun,
        Self::NotStarted,
        Self::UnknownAnchor,
        Self::UnknownAction,
        Self::DuplicateFrame,
        Self::Time,
        Self::FrameLength,
        Self::SampleNotFinite,
        Self::SilentFrame,
        Self::SaturatedFrame,
        Self::NegativeMagnitude,
        Self::FrameDelay,
        Self::Range,
        Self::RangeVariance,
        Self::RangeCount,
        Self::TagHeight,
        Self::LeverArm,
        Self::Refused,
        Self::ToldChanged,
        Self::SnapshotRoom,
        Self::SnapshotForeign,
        Self::SnapshotVersion,
        Self::SnapshotTold,
        Self::SnapshotDamaged,
        Self::CirIndex,
        Self::CirLength,
        Self::CirOutside,
        Self::CirBytes,
        Self::TwoWayOrder,
        Self::TwoWayOffset,
        Self::TwoWayDelay,
        Self::TwoWayRange,
        Self::Setting,
        Self::SettingAcceleration,
        Self::SettingVelocityDecay,
        Self::SettingStartPosition,
        Self::SettingStartDeviation,
        Self::SettingHeading,
        Self::SettingRangeInflation,
        Self::SettingRangeFloor,
        Self::SettingBias,
        Self::SettingLateness,
        Self::SettingMaxRange,
        Self::SettingDetection,
        Self::SettingClutter,
        Self::SettingRollOff,
        Self::SettingPulse,
        Self::SettingSampleSpacing,
        Self::SettingSampleCount,
        Self::SettingFullScale,
        Self::SettingFalsePaths,
        Self::SettingFirstAction,
        Self::SettingRendezvous,
        Self::SettingPlannedActions,
        Self::SettingHorizon,
        Self::ActionCount,
        Self::ActionCarrier,
        Self::ActionPulse,
    ];

    /// What is wrong, in English.
    const fn text(self) -> &'static CStr {
        match self {
            Self::None => c"nothing is wrong",
            Self::NullPointer => c"a pointer is NULL that must not be",
            Self::Alignment => c"a pointer is not aligned as its type needs",
            Self::MemorySize => c"the memory is smaller than cogmint_tracker_size()",
            Self::Count => c"a count, or an index, is larger than anything that fits in memory",
            Self::UnknownChoice => c"a profile, a radio, a kind of samples or a format that there is not",
            Self::AnchorCount => c"no anchor, or more than COGMINT_MOST_ANCHORS",
            Self::VirtualAnchorCount => c"more virtual anchors than there are surfaces or sources",
            Self::Geometry => c"the position of an anchor or virtual anchor, or its deviation, is out of range",
            Self::PlanSize => c"more walls, segments or corners than COGMINT_MOST_SEGMENTS",
            Self::PlanSettings => c"the plan's turn or its number of reflections is out of range",
            Self::PlanWall => c"a wall of the plan has no segment, or a deviation out of range",
            Self::PlanSegment => c"a segment of the plan is out of range, without length, of no wall or off its wall's line",
            Self::PlanOutline => c"a corner of the outline is out of range, or there are fewer than three",
            Self::AlreadyBegun => c"a cycle is begun that was not finished",
            Self::NotBegun => c"no cycle is begun",
            Self::NotStarted => c"the tracker is not started",
            Self::UnknownAnchor => c"there is no such anchor",
            Self::UnknownAction => c"there is no such action",
            Self::DuplicateFrame => c"a second frame or scan of an anchor in one cycle, or the sequence number of its last frame again",
            Self::Time => c"the time elapsed is not above 0 and at most an hour",
            Self::FrameLength => c"a frame with another number of samples than configured",
            Self::SampleNotFinite => c"a sample is NaN, infinite or beyond 1e12",
            Self::SilentFrame => c"all samples of a frame are zero",
            Self::SaturatedFrame => c"samples stand at the converter's full scale",
            Self::NegativeMagnitude => c"a magnitude is below zero",
            Self::FrameDelay => c"the delay of a frame's first sample is not finite or beyond the longest range",
            Self::Range => c"a range is not finite, not positive, or beyond the longest range",
            Self::RangeVariance => c"a range's variance is not finite, or not within (1 mm)^2 to (100 m)^2",
            Self::RangeCount => c"more than COGMINT_MOST_RANGES ranges",
            Self::TagHeight => c"the tag's height or its deviation is out of range",
            Self::LeverArm => c"the antenna's lever arm is out of range, or no heading is estimated",
            Self::Refused => c"something else that is refused",
            Self::ToldChanged => c"a bit has flipped in what the tracker was told",
            Self::SnapshotRoom => c"the buffer is too short for the snapshot; the bytes needed were written to length",
            Self::SnapshotForeign => c"the bytes are no snapshot, or one that is cut short",
            Self::SnapshotVersion => c"a snapshot of another version of its format",
            Self::SnapshotTold => c"a snapshot of a tracker that was told something else, or that has other capacities, or a map of other surroundings",
            Self::SnapshotDamaged => c"the snapshot is damaged",
            Self::CirIndex => c"the first-path index is NaN, negative, or 1024 or more",
            Self::CirLength => c"the window has no sample, more than COGMINT_MOST_CIR_SAMPLES, or more than there is room for",
            Self::CirOutside => c"the window begins ahead of the accumulator, or of the samples given",
            Self::CirBytes => c"the bytes of the accumulator end before the window does",
            Self::TwoWayOrder => c"two time stamps of one clock are in the wrong order, or 8.6 s or more apart",
            Self::TwoWayOffset => c"the clock offset is NaN or beyond 1e-4",
            Self::TwoWayDelay => c"a round takes no longer than the antenna delay in it",
            Self::TwoWayRange => c"the time stamps make a range that is not positive, or beyond 10 km",
            Self::Setting => c"a setting is out of range that cogmint_config does not have",
            Self::SettingAcceleration => c"acceleration_density_m2_s3 is out of range",
            Self::SettingVelocityDecay => c"velocity_decay_s is out of range",
            Self::SettingStartPosition => c"start_position_m is out of range",
            Self::SettingStartDeviation => c"start_position_std_m or start_velocity_std_m_s is out of range",
            Self::SettingHeading => c"has_heading: there is no surface to spare for it",
            Self::SettingRangeInflation => c"range_variance_inflation is out of range",
            Self::SettingRangeFloor => c"range_floor_m or path_floor_pulses is out of range",
            Self::SettingBias => c"bias_mean_m or bias_std_m is out of range",
            Self::SettingLateness => c"late_m is out of range",
            Self::SettingMaxRange => c"max_range_m is out of range",
            Self::SettingDetection => c"detection_probability is out of range",
            Self::SettingClutter => c"clutter_per_anchor is out of range",
            Self::SettingRollOff => c"pulse_roll_off is out of range",
            Self::SettingPulse => c"pulse_step_s or pulse_autocorrelation is out of range, or pulse_samples neither 0 nor COGMINT_PULSE_SAMPLES",
            Self::SettingSampleSpacing => c"sample_spacing_s is out of range",
            Self::SettingSampleCount => c"samples_per_frame is out of range",
            Self::SettingFullScale => c"full_scale is out of range",
            Self::SettingFalsePaths => c"false_paths_per_frame is out of range",
            Self::SettingFirstAction => c"first_action is no index of an action",
            Self::SettingRendezvous => c"rendezvous is no index of an action",
            Self::SettingPlannedActions => c"planned_actions is out of range",
            Self::SettingHorizon => c"horizon is out of range",
            Self::ActionCount => c"no action, or more than COGMINT_MOST_ACTIONS",
            Self::ActionCarrier => c"the carrier of an action is out of range",
            Self::ActionPulse => c"the pulse duration of an action is out of range",
        }
    }
}

/// What is wrong, in English: a string that stays. Of a number that is no error code, a text that says so.
#[unsafe(no_mangle)]
pub extern "C" fn cogmint_error_string(code: u32) -> *const c_char {
    let known = CogmintError::ALL.into_iter().find(|error| *error as u32 == code);
    known.map_or(c"no error code of cogmint", CogmintError::text).as_ptr()
}

/// The code of what became of a call.
pub(crate) fn code(outcome: Result<(), CogmintError>) -> CogmintError {
    outcome.err().unwrap_or(CogmintError::None)
}

impl From<Error> for CogmintError {
    fn from(error: Error) -> Self {
        match error {
            Error::Configuration(setting) => Self::from(setting),
            Error::AnchorCount { .. } => Self::AnchorCount,
            Error::VirtualAnchorCount { .. } => Self::VirtualAnchorCount,
            Error::AlreadyBegun => Self::AlreadyBegun,
            Error::NotStarted => Self::NotStarted,
            Error::NotBegun => Self::NotBegun,
            Error::Geometry { .. } => Self::Geometry,
            Error::PlanSize { .. } => Self::PlanSize,
            Error::PlanSettings => Self::PlanSettings,
            Error::PlanWall { .. } => Self::PlanWall,
            Error::PlanSegment { .. } => Self::PlanSegment,
            Error::PlanOutline { .. } => Self::PlanOutline,
            Error::UnknownAnchor { .. } => Self::UnknownAnchor,
            Error::UnknownAction { .. } => Self::UnknownAction,
            Error::DuplicateFrame { .. } => Self::DuplicateFrame,
            Error::Time { .. } => Self::Time,
            Error::FrameLength { .. } => Self::FrameLength,
            Error::SampleNotFinite { .. } => Self::SampleNotFinite,
            Error::SilentFrame { .. } => Self::SilentFrame,
            Error::SaturatedFrame { .. } => Self::SaturatedFrame,
            Error::NegativeMagnitude { .. } => Self::NegativeMagnitude,
            Error::FrameDelay { .. } => Self::FrameDelay,
            Error::Range { .. } => Self::Range,
            Error::RangeVariance { .. } => Self::RangeVariance,
            Error::RangeCount { .. } => Self::RangeCount,
            Error::TagHeight => Self::TagHeight,
            Error::LeverArm => Self::LeverArm,
            Error::ToldSinr => Self::Refused,
            Error::ToldChanged => Self::ToldChanged,
            // What a later core adds.
            #[allow(unreachable_patterns)]
            _ => Self::Refused,
        }
    }
}

impl From<Setting> for CogmintError {
    fn from(setting: Setting) -> Self {
        match setting {
            Setting::AccelerationDensity => Self::SettingAcceleration,
            Setting::VelocityDecay => Self::SettingVelocityDecay,
            Setting::StartPosition => Self::SettingStartPosition,
            Setting::StartDeviation => Self::SettingStartDeviation,
            Setting::Heading => Self::SettingHeading,
            Setting::RangeVarianceInflation => Self::SettingRangeInflation,
            Setting::RangeFloor => Self::SettingRangeFloor,
            Setting::BiasPrior => Self::SettingBias,
            Setting::Lateness => Self::SettingLateness,
            Setting::MaxRange => Self::SettingMaxRange,
            Setting::DetectionProbability => Self::SettingDetection,
            Setting::ClutterPerAnchor => Self::SettingClutter,
            Setting::RollOff => Self::SettingRollOff,
            Setting::PulseShape => Self::SettingPulse,
            Setting::SampleSpacing => Self::SettingSampleSpacing,
            Setting::SampleCount => Self::SettingSampleCount,
            Setting::FullScale => Self::SettingFullScale,
            Setting::FalsePaths => Self::SettingFalsePaths,
            Setting::FirstAction => Self::SettingFirstAction,
            Setting::Rendezvous => Self::SettingRendezvous,
            Setting::PlannedActions => Self::SettingPlannedActions,
            Setting::Horizon => Self::SettingHorizon,
            Setting::LibraryEmpty | Setting::LibraryLength => Self::ActionCount,
            Setting::Carrier => Self::ActionCarrier,
            Setting::PulseDuration => Self::ActionPulse,
            // What only the presets set.
            _ => Self::Setting,
        }
    }
}

impl From<SnapshotError> for CogmintError {
    fn from(error: SnapshotError) -> Self {
        match error {
            SnapshotError::Room { .. } => Self::SnapshotRoom,
            SnapshotError::Begun => Self::AlreadyBegun,
            SnapshotError::NotStarted => Self::NotStarted,
            SnapshotError::Foreign => Self::SnapshotForeign,
            SnapshotError::Version { .. } => Self::SnapshotVersion,
            SnapshotError::Told => Self::SnapshotTold,
            SnapshotError::Damaged => Self::SnapshotDamaged,
            // What a later core adds.
            #[allow(unreachable_patterns)]
            _ => Self::Refused,
        }
    }
}

impl From<CirError> for CogmintError {
    fn from(error: CirError) -> Self {
        match error {
            CirError::FirstPathIndex { .. } => Self::CirIndex,
            CirError::WindowLength { .. } => Self::CirLength,
            CirError::WindowOutside { .. } => Self::CirOutside,
            CirError::TooFewBytes { .. } => Self::CirBytes,
            // What a later core adds.
            #[allow(unreachable_patterns)]
            _ => Self::Refused,
        }
    }
}

impl From<TwoWayError> for CogmintError {
    fn from(error: TwoWayError) -> Self {
        match error {
            TwoWayError::Order => Self::TwoWayOrder,
            TwoWayError::ClockOffset { .. } => Self::TwoWayOffset,
            TwoWayError::AntennaDelay => Self::TwoWayDelay,
            TwoWayError::Range { .. } => Self::TwoWayRange,
            // What a later core adds.
            #[allow(unreachable_patterns)]
            _ => Self::Refused,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_code_has_a_text_of_its_own() {
        let texts = CogmintError::ALL.map(|error| {
            // SAFETY: the function returns a string that ends and stays.
            unsafe { CStr::from_ptr(cogmint_error_string(error as u32)) }
        });
        for (index, text) in texts.iter().enumerate() {
            assert!(!text.is_empty());
            assert_eq!(texts.iter().position(|other| other == text), Some(index), "{text:?}");
        }
        // SAFETY: as above.
        let unknown = unsafe { CStr::from_ptr(cogmint_error_string(u32::MAX)) };
        assert_eq!(unknown, c"no error code of cogmint");
    }
}
