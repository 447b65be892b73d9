//! The configuration: the settings that users touch, over those of a preset.

use crate::capacity::COGMINT_PULSE_SAMPLES;
use crate::error::{CogmintError, code};
use crate::pointer::{put, shared};
use cogmint_core::Config;
use cogmint_core::radio::presets::RadioPreset;
use cogmint_core::radio::pulse::PulseShape;

/// No index: of `rendezvous`, and of `announced_action` in a report.
pub const COGMINT_NO_INDEX: u32 = 0xffff_ffff;

/// Bytes of cogmint_config.
pub const COGMINT_CONFIG_SIZE: usize = 268;
const _: () = assert!(size_of::<CogmintConfig>() == COGMINT_CONFIG_SIZE);

/// Who carries the tag: where all settings come from that are not in cogmint_config.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CogmintProfile {
    /// The published set-up: 1 cm per cycle, in a room.
    Published = 0,
    /// Somebody who walks.
    Pedestrian = 1,
    /// A robot on wheels, at 0.3 to 0.8 m/s.
    Robot = 2,
}

/// A radio.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CogmintRadio {
    /// The published channel sounder: 2 GHz of band, frames and no ranges.
    Sounder = 0,
    /// DW1000.
    Dw1000 = 1,
    /// DW3000.
    Dw3000 = 2,
}

/// The settings that users touch. To be filled by cogmint_config_published, _pedestrian or _robot, then changed field by field.
/// What it does not have is as the preset of `profile` and `radio` has it.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CogmintConfig {
    /// A cogmint_profile. As filled.
    pub profile: u32,
    /// A cogmint_radio. As filled.
    pub radio: u32,

    /// Where the tag starts, metres (within 10 km of the origin).
    pub start_position_m: [f32; 2],
    /// Its standard deviation per axis, metres (1e-3 to 1e3).
    pub start_position_std_m: f32,
    /// Standard deviation of the first velocity per axis around zero, m/s (1e-3 to 1e3).
    pub start_velocity_std_m_s: f32,
    /// Spectral density of the acceleration per axis, m^2/s^3 (1e-12 to 1e4). Larger follows turns faster and averages less.
    pub acceleration_density_m2_s3: f32,
    /// Time constant with which a velocity decays to zero, seconds (at least 0.1).
    pub velocity_decay_s: f32,
    /// Not 0: antennas beside the centre of the tag's body take turns, and its heading is estimated.
    pub has_heading: u32,

    /// Factor on every measurement variance (1 to 100).
    pub range_variance_inflation: f32,
    /// Standard deviation that no range goes below, metres (1e-3 to 10).
    pub range_floor_m: f32,
    /// The same for paths of frames, pulse lengths (0 to 1), on top.
    pub path_floor_pulses: f32,
    /// Mean of the bias expected of every anchor's ranges, metres (-10 to 10).
    pub bias_mean_m: f32,
    /// Its standard deviation, metres (0 to 10). Above 0, one bias per anchor is estimated.
    pub bias_std_m: f32,
    /// By how much ranges are too long on average whose direct path is blocked, metres (0 to 100). 0: no range is late.
    pub late_m: f32,
    /// Ranges beyond this are refused, metres (1 to 1e4).
    pub max_range_m: f32,

    /// Probability that what is there is detected (0.01 to 0.999).
    pub detection_probability: f32,
    /// False ranges per anchor and cycle (1e-3 to 100).
    pub clutter_per_anchor: f32,
    /// Not 0: unknown virtual anchors are looked for.
    pub has_discovery: u32,

    /// Time between two samples of a frame, seconds (0.01e-9 to 10e-9).
    pub sample_spacing_s: f32,
    /// Samples of a frame (16 to 4096).
    pub samples_per_frame: u32,
    /// Full scale of the converter in the unit of the samples: frames that reach it are refused. 0: it has none.
    pub full_scale: f32,
    /// Not 0: the receiver scales every frame as it likes.
    pub has_gain_control: u32,
    /// False paths per frame in pure noise (1e-4 to 10). More finds weaker paths and more phantoms.
    pub false_paths_per_frame: f32,
    /// Not 0: dense multipath begins with a path, as of real radios in flats and halls.
    pub dense_begins_with_path: u32,

    /// 0: the pulse has `pulse_roll_off`. COGMINT_PULSE_SAMPLES: it has `pulse_step_s` and `pulse_autocorrelation`.
    pub pulse_samples: u32,
    /// Roll-off of a root-raised-cosine pulse (0 to 1).
    pub pulse_roll_off: f32,
    /// Time between two samples of the autocorrelation, seconds (1e-12 to 1e-8).
    pub pulse_step_s: f32,
    /// Autocorrelation of the pulse, from lag zero on, where it is 1.
    pub pulse_autocorrelation: [f32; COGMINT_PULSE_SAMPLES],

    /// Index of the action of the first cycle.
    pub first_action: u32,
    /// Actions planned per cycle (0: the radio never leaves its action).
    pub planned_actions: u32,
    /// Cycles that are planned ahead (1 to 16).
    pub horizon: u32,
    /// Index of the action to go to after three lost frames: every choice is then announced one cycle before it is used.
    /// COGMINT_NO_INDEX: there is none, and choices are used at once.
    pub rendezvous: u32,

    /// Work for each anchor that is heard in a cycle, about in instructions of a Cortex-M4F (20,000 to 1e9): half of it at most goes into
    /// looking for the paths of its frame, and what frames leave into comparing places with what was heard.
    pub anchor_work: u32,
    /// Comparisons of places with what an anchor delivered, per cycle at most (1 to 65,535), with two places at least.
    pub comparisons: u32,
}

impl CogmintConfig {
    /// The settings of a preset.
    fn of(profile: CogmintProfile, radio: CogmintRadio) -> Self {
        let Config {
            motion, start, has_heading, ranging, association, estimator, radio: frames, work, ..
        } = preset(profile, radio);
        let controller = preset(profile, radio).controller;
        let mut pulse_autocorrelation = [0.0; COGMINT_PULSE_SAMPLES];
        let (pulse_samples, pulse_roll_off, pulse_step_s) = match frames.pulse_shape {
            PulseShape::RootRaisedCosine { roll_off } => (0, roll_off, 0.0),
            PulseShape::Sampled { step_s, autocorrelation } => {
                pulse_autocorrelation = autocorrelation;
                (COGMINT_PULSE_SAMPLES as u32, 0.0, step_s)
            }
        };
        Self {
            profile: profile as u32,
            radio: radio as u32,
            start_position_m: start.position_m,
            start_position_std_m: start.position_std_m,
            start_velocity_std_m_s: start.velocity_std_m_s,
            acceleration_density_m2_s3: motion.acceleration_density_m2_s3,
            velocity_decay_s: motion.velocity_decay_s,
            has_heading: u32::from(has_heading),
            range_variance_inflation: ranging.variance_inflation,
            range_floor_m: ranging.floor_m,
            path_floor_pulses: ranging.floor_pulses,
            bias_mean_m: ranging.bias_mean_m,
            bias_std_m: ranging.bias_std_m,
            late_m: ranging.late_m,
            max_range_m: ranging.max_range_m,
            detection_probability: association.detection_probability,
            clutter_per_anchor: association.clutter_per_anchor,
            has_discovery: u32::from(preset(profile, radio).discovery),
            sample_spacing_s: frames.sample_spacing_s,
            samples_per_frame: frames.samples_per_frame as u32,
            full_scale: frames.full_scale.unwrap_or(0.0),
            has_gain_control: u32::from(frames.gain_control),
            false_paths_per_frame: frames.false_paths_per_frame,
            dense_begins_with_path: u32::from(estimator.begins_with_path),
            pulse_samples,
            pulse_roll_off,
            pulse_step_s,
            pulse_autocorrelation,
            first_action: controller.first_action as u32,
            planned_actions: controller.planned_actions as u32,
            horizon: controller.horizon as u32,
            rendezvous: controller.rendezvous.map_or(COGMINT_NO_INDEX, |action| action as u32),
            anchor_work: work.anchor,
            comparisons: u32::from(work.comparisons),
        }
    }

    /// The core's configuration: the preset's, with these settings in it. Ranges are checked when the tracker starts.
    #[inline(never)]
    pub(crate) fn core(&self) -> Result<Config, CogmintError> {
        let mut config = preset(profile(self.profile)?, radio(self.radio)?);
        config.start.position_m = self.start_position_m;
        config.start.position_std_m = self.start_position_std_m;
        config.start.velocity_std_m_s = self.start_velocity_std_m_s;
        config.motion.acceleration_density_m2_s3 = self.acceleration_density_m2_s3;
        config.motion.velocity_decay_s = self.velocity_decay_s;
        config.has_heading = self.has_heading != 0;
        config.ranging.variance_inflation = self.range_variance_inflation;
        config.ranging.floor_m = self.range_floor_m;
        config.ranging.floor_pulses = self.path_floor_pulses;
        config.ranging.bias_mean_m = self.bias_mean_m;
        config.ranging.bias_std_m = self.bias_std_m;
        config.ranging.late_m = self.late_m;
        config.ranging.max_range_m = self.max_range_m;
        config.association.detection_probability = self.detection_probability;
        config.association.clutter_per_anchor = self.clutter_per_anchor;
        config.discovery = self.has_discovery != 0;
        config.radio.sample_spacing_s = self.sample_spacing_s;
        config.radio.samples_per_frame = self.samples_per_frame as usize;
        config.radio.full_scale = if self.full_scale == 0.0 { None } else { Some(self.full_scale) };
        config.radio.gain_control = self.has_gain_control != 0;
        config.radio.false_paths_per_frame = self.false_paths_per_frame;
        config.estimator.begins_with_path = self.dense_begins_with_path != 0;
        config.radio.pulse_shape = match self.pulse_samples as usize {
            0 => PulseShape::RootRaisedCosine { roll_off: self.pulse_roll_off },
            COGMINT_PULSE_SAMPLES => {
                PulseShape::Sampled { step_s: self.pulse_step_s, autocorrelation: self.pulse_autocorrelation }
            }
            _ => return Err(CogmintError::SettingPulse),
        };
        config.controller.first_action = self.first_action as usize;
        config.controller.planned_actions = self.planned_actions as usize;
        config.controller.horizon = self.horizon as usize;
        config.controller.rendezvous = match self.rendezvous {
            COGMINT_NO_INDEX => None,
            action => Some(action as usize),
        };
        config.work.anchor = self.anchor_work;
        // What is out of range stays so.
        config.work.comparisons = u16::try_from(self.comparisons).unwrap_or(0);
        Ok(config)
    }
}

/// The preset of a radio.
pub(crate) fn radio_preset(radio: CogmintRadio) -> RadioPreset {
    match radio {
        CogmintRadio::Sounder => RadioPreset::Sounder,
        CogmintRadio::Dw1000 => RadioPreset::Dw1000,
        CogmintRadio::Dw3000 => RadioPreset::Dw3000,
    }
}

/// The radio of a number from C.
pub(crate) fn radio(number: u32) -> Result<CogmintRadio, CogmintError> {
    [CogmintRadio::Sounder, CogmintRadio::Dw1000, CogmintRadio::Dw3000]
        .into_iter()
        .find(|radio| *radio as u32 == number)
        .ok_or(CogmintError::UnknownChoice)
}

fn profile(number: u32) -> Result<CogmintProfile, CogmintError> {
    [CogmintProfile::Published, CogmintProfile::Pedestrian, CogmintProfile::Robot]
        .into_iter()
        .find(|profile| *profile as u32 == number)
        .ok_or(CogmintError::UnknownChoice)
}

#[inline(never)]
fn preset(profile: CogmintProfile, radio: CogmintRadio) -> Config {
    let preset = radio_preset(radio);
    match profile {
        CogmintProfile::Published => Config { radio: preset.radio(), ..Config::published() },
        CogmintProfile::Pedestrian => Config::pedestrian(preset),
        CogmintProfile::Robot => Config::robot(preset),
    }
}

/// Fills in the published set-up, with the channel sounder.
///
/// # Safety
/// `config`: of a cogmint_config that may be written to, or NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cogmint_config_published(config: *mut CogmintConfig) -> CogmintError {
    // SAFETY: as the caller promises.
    unsafe { fill(config, CogmintProfile::Published, CogmintRadio::Sounder as u32) }
}

/// Fills in somebody who walks indoors, with this cogmint_radio. `start_position_m` is the user's: the middle of the room, say.
///
/// # Safety
/// `config`: of a cogmint_config that may be written to, or NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cogmint_config_pedestrian(config: *mut CogmintConfig, radio: u32) -> CogmintError {
    // SAFETY: as the caller promises.
    unsafe { fill(config, CogmintProfile::Pedestrian, radio) }
}

/// Fills in a robot on wheels, at 0.3 to 0.8 m/s, with this cogmint_radio.
///
/// # Safety
/// `config`: of a cogmint_config that may be written to, or NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cogmint_config_robot(config: *mut CogmintConfig, radio: u32) -> CogmintError {
    // SAFETY: as the caller promises.
    unsafe { fill(config, CogmintProfile::Robot, radio) }
}

/// # Safety
/// As [`put`].
unsafe fn fill(config: *mut CogmintConfig, profile: CogmintProfile, number: u32) -> CogmintError {
    code(radio(number).and_then(|radio| {
        // SAFETY: as the caller promises.
        unsafe { put(config, CogmintConfig::of(profile, radio)) }
    }))
}

/// Standard deviation of the ranges of a cogmint_radio that come on time, metres, for `variance_m2` of cogmint_range; 0 where it
/// has no ranges of its own, or is none.
#[unsafe(no_mangle)]
pub extern "C" fn cogmint_radio_range_std_m(radio: u32) -> f32 {
    self::radio(radio).ok().and_then(|radio| radio_preset(radio).range_std_m()).unwrap_or(0.0)
}

/// The core's configuration of one in C.
///
/// # Safety
/// As [`shared`].
pub(crate) unsafe fn read(config: *const CogmintConfig) -> Result<(Config, CogmintRadio), CogmintError> {
    // SAFETY: as the caller promises.
    let config = unsafe { shared(config)? };
    Ok((config.core()?, radio(config.radio)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_filled_in_is_the_preset_and_comes_back_whole() {
        for profile in [CogmintProfile::Published, CogmintProfile::Pedestrian, CogmintProfile::Robot] {
            for radio in [CogmintRadio::Sounder, CogmintRadio::Dw1000, CogmintRadio::Dw3000] {
                assert_eq!(CogmintConfig::of(profile, radio).core(), Ok(preset(profile, radio)));
            }
        }
        assert_eq!(preset(CogmintProfile::Published, CogmintRadio::Sounder), Config::default());
    }

    #[test]
    fn unknown_choices_are_refused() {
        let filled = CogmintConfig::of(CogmintProfile::Robot, CogmintRadio::Dw1000);
        let refused = |config: CogmintConfig| config.core().err();
        assert_eq!(refused(CogmintConfig { profile: 3, ..filled }), Some(CogmintError::UnknownChoice));
        assert_eq!(refused(CogmintConfig { radio: 3, ..filled }), Some(CogmintError::UnknownChoice));
        assert_eq!(refused(CogmintConfig { pulse_samples: 32, ..filled }), Some(CogmintError::SettingPulse));
    }
}
