//! Configuration: plain data, every field with its unit, its range and what more or less of it does.

use crate::controller::planning::LONGEST_HORIZON;
use crate::controller::policy::Choice;
use crate::controller::reward::Reward;
use crate::controller::value::Learning;
use crate::error::{Error, Setting};
use crate::memory::discovery::DiscoverySettings;
use crate::model::motion::Motion;
use crate::perceptor::association::Mode;
use crate::perceptor::belief::acquisition::AcquisitionSettings;
use crate::perceptor::channel_estimator::EstimatorSettings;
use crate::radio::library::Action;
use crate::radio::pulse::{Pulse, PulseShape};

/// Where the tag is believed to be before the first cycle.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Start {
    /// Position, metres (within 10 km of the origin).
    pub position_m: [f32; 2],
    /// Its standard deviation per axis, metres (1e-3 to 1e3).
    pub position_std_m: f32,
    /// Standard deviation of the velocity per axis around zero, m/s (1e-3 to 1e3).
    pub velocity_std_m_s: f32,
}

/// What a range is worth.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Ranging {
    /// Factor on every measurement variance (1 to 100). Above 1, the filter forgives errors that the bound does
    /// not know of; 2.25 is common.
    pub variance_inflation: f32,
    /// Standard deviation that no range goes below, metres (1e-3 to 10): calibration, wall delays.
    pub floor_m: f32,
    /// Mean of the range bias expected of every anchor, metres (-10 to 10).
    pub bias_mean_m: f32,
    /// Its standard deviation, metres (0 to 10). Above 0, one bias per anchor is estimated.
    pub bias_std_m: f32,
    /// Ranges beyond this are refused, metres (1 to 1e4).
    pub max_range_m: f32,
}

impl Ranging {
    /// The variance the filter works with: inflated, and never below the floor.
    pub(crate) fn measurement_variance_m2(&self, variance_m2: f32) -> f32 {
        self.variance_inflation * variance_m2 + self.floor_m * self.floor_m
    }
}

/// What association assumes.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct AssociationSettings {
    /// Soft or most probable.
    pub mode: Mode,
    /// Probability that an existing feature is detected (0.01 to 0.999).
    pub detection_probability: f32,
    /// Mean number of false alarms per anchor and cycle (1e-3 to 100), uniform up to the longest range.
    pub clutter_per_anchor: f32,
    /// Expected number of paths per anchor that come from virtual anchors not in the map, at the start (0 to 100);
    /// adapted to what is seen.
    pub unmapped_per_anchor: f32,
    /// Probability that a virtual anchor survives a cycle (0.5 to 1).
    pub survival_probability: f32,
}

/// What the radio's frames look like.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Radio {
    /// Shape of the pulse: roll-off 0 to 1, or samples of its autocorrelation (1 at first, none beyond 1.001, the second
    /// below the first, 1e-12 to 1e-8 s apart). Its duration is the action's.
    pub pulse_shape: PulseShape,
    /// Sample spacing, seconds (0.01 to 10 ns); at most 1 / (bandwidth), half the pulse duration is usual.
    pub sample_spacing_s: f32,
    /// Samples per frame (16 to 4096).
    pub samples_per_frame: usize,
    /// Full scale of the converter in the unit of the samples, if it has one: frames that reach it are refused.
    pub full_scale: Option<f32>,
    /// Whether the receiver scales every frame as it likes (automatic gain control): powers are then measured in the frame's
    /// white noise ([`crate::perceptor::gain_control`]).
    pub gain_control: bool,
    /// False paths per frame in pure noise (1e-4 to 10). More finds weaker paths and more phantoms.
    pub false_paths_per_frame: f32,
    /// What is a path, and what dense multipath.
    pub estimator: EstimatorSettings,
}

impl Radio {
    /// The pulse of an action, as the receiver keeps it.
    pub fn pulse(&self, action: &Action) -> Pulse {
        Pulse { duration_s: action.pulse_duration_s, shape: self.pulse_shape }
            .sampled_every(self.sample_spacing_s)
    }
}

/// How the next action is found.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ControllerSettings {
    /// What is maximised.
    pub reward: Reward,
    /// Learning rate and discount.
    pub learning: Learning,
    /// Temperature, exploration, hysteresis, patience.
    pub choice: Choice,
    /// Actions planned per cycle (0: none, the radio then never leaves its action; as many as the library has, or more: all).
    pub planned_actions: usize,
    /// Planning horizon, cycles (1 to 16).
    pub horizon: usize,
    /// The action of the first cycle.
    pub first_action: usize,
    /// SINR (linear) assumed of a source never observed, with the library's first action (0.01 to 1e6).
    pub prior_sinr: f32,
    /// Whether what is heard with an action also tells of those whose spectra it overlaps.
    pub neighbours: bool,
    /// Whether every anchor gets an action of its own, for links that can be tuned apart; without, all share one. Anchors
    /// whose pulses differ in duration cost an estimator built anew for each.
    pub per_anchor: bool,
    /// The action to go to after three lost frames. Where there is one, every choice is announced to the other end one
    /// cycle before it is used; without, it is used at once.
    pub rendezvous: Option<usize>,
}

/// The variants of multipath-assisted tracking that are told apart in publications (MINT: multipath-assisted indoor
/// navigation and tracking), for comparison; [`Config::with_variant`] selects one.
///
/// All of them remember the SINR and the existence of virtual anchors, so that none relies for long on a wall that is
/// not there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Variant {
    /// Conventional MINT: the floor plan is taken for perfect. Its virtual anchors are exactly where they are told to
    /// be and stay there, none is discovered, and the most probable association is the only one.
    Conventional,
    /// Probabilistic MINT: virtual anchors are random variables, told with a deviation or discovered; the most probable
    /// association is the only one.
    Probabilistic,
    /// As `Probabilistic`, but every association counts by its probability. The default.
    Soft,
}

impl Variant {
    /// All of them.
    pub const ALL: [Variant; 3] = [Variant::Conventional, Variant::Probabilistic, Variant::Soft];

    /// Its name, in one lower-case word.
    pub const fn name(self) -> &'static str {
        match self {
            Variant::Conventional => "conventional",
            Variant::Probabilistic => "probabilistic",
            Variant::Soft => "soft",
        }
    }
}

/// The whole configuration of a tracker.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Config {
    /// How the tag moves.
    pub motion: Motion,
    /// Where it starts.
    pub start: Start,
    /// What a range is worth.
    pub ranging: Ranging,
    /// What association assumes.
    pub association: AssociationSettings,
    /// When it is known where the tag is.
    pub acquisition: AcquisitionSettings,
    /// Whether unknown virtual anchors are looked for.
    pub discovery: bool,
    /// How much it takes to find one.
    pub discovery_settings: DiscoverySettings,
    /// Whether every virtual anchor of the map is exactly where it is told to be: the deviations told then count as 0,
    /// and the virtual anchors are held fixed.
    pub exact_map: bool,
    /// What frames look like.
    pub radio: Radio,
    /// How the next action is found.
    pub controller: ControllerSettings,
}

impl Default for Config {
    /// The published set-up: a tag at 1 cm per cycle in a room, a 2 GHz radio, 40 actions of which 20 planned.
    fn default() -> Self {
        Self {
            motion: Motion {
                acceleration_std_m_s2: 0.01,
                virtual_anchor_walk_m: 1e-4,
                position_std_limit_m: 30.0,
            },
            start: Start { position_m: [0.0, 0.0], position_std_m: 0.25, velocity_std_m_s: 0.03 },
            ranging: Ranging {
                variance_inflation: 1.44,
                floor_m: 2e-3,
                bias_mean_m: 0.0,
                bias_std_m: 0.0,
                max_range_m: 30.0,
            },
            association: AssociationSettings {
                mode: Mode::Soft,
                detection_probability: 0.95,
                clutter_per_anchor: 1.0,
                unmapped_per_anchor: 5.0,
                survival_probability: 0.999,
            },
            acquisition: AcquisitionSettings::default(),
            discovery: true,
            discovery_settings: DiscoverySettings::default(),
            exact_map: false,
            radio: Radio {
                pulse_shape: PulseShape::RootRaisedCosine { roll_off: 0.6 },
                sample_spacing_s: 0.25e-9,
                samples_per_frame: 400,
                full_scale: None,
                gain_control: false,
                false_paths_per_frame: 0.1,
                estimator: EstimatorSettings::default(),
            },
            controller: ControllerSettings {
                reward: Reward::InformationGain,
                learning: Learning { rate: 0.5, experience_rate: 0.02, discount: 0.5, bootstrap: false },
                choice: Choice {
                    temperature_nat: 0.1,
                    exploration: 0.001,
                    hysteresis_nat: 0.01,
                    patience_cycles: 15,
                },
                planned_actions: 20,
                horizon: 1,
                first_action: 0,
                prior_sinr: 10.0,
                neighbours: true,
                per_anchor: false,
                rendezvous: None,
            },
        }
    }
}

impl Config {
    /// The same configuration for another variant: sets `association.mode`, `discovery` and `exact_map`, nothing else.
    /// Range biases are independent of it: see [`Ranging::bias_std_m`].
    #[must_use]
    pub fn with_variant(mut self, variant: Variant) -> Self {
        (self.association.mode, self.discovery, self.exact_map) = match variant {
            Variant::Conventional => (Mode::Map, false, true),
            Variant::Probabilistic => (Mode::Map, true, false),
            Variant::Soft => (Mode::Soft, true, false),
        };
        self
    }

    /// Checks every value against its range.
    ///
    /// # Errors
    /// [`Error::Configuration`] naming the first one outside.
    pub fn validate(&self) -> Result<(), Error> {
        let within = |value: f32, low: f32, high: f32, setting: Setting| {
            // Written so that NaN fails.
            if value >= low && value <= high { Ok(()) } else { Err(Error::Configuration(setting)) }
        };
        let Config {
            motion,
            start,
            ranging,
            association,
            acquisition,
            discovery: _,
            discovery_settings,
            exact_map: _,
            radio,
            controller,
        } = self;
        within(motion.acceleration_std_m_s2, 1e-6, 100.0, Setting::AccelerationStd)?;
        within(motion.virtual_anchor_walk_m, 1e-7, 1.0, Setting::VirtualAnchorWalk)?;
        within(motion.position_std_limit_m, 1.0, 1e4, Setting::PositionLimit)?;
        for coordinate in start.position_m {
            within(coordinate, -1e4, 1e4, Setting::StartPosition)?;
        }
        within(start.position_std_m, 1e-3, 1e3, Setting::StartDeviation)?;
        within(start.velocity_std_m_s, 1e-3, 1e3, Setting::StartDeviation)?;
        within(ranging.variance_inflation, 1.0, 100.0, Setting::RangeVarianceInflation)?;
        within(ranging.floor_m, 1e-3, 10.0, Setting::RangeFloor)?;
        within(ranging.bias_mean_m, -10.0, 10.0, Setting::BiasPrior)?;
        within(ranging.bias_std_m, 0.0, 10.0, Setting::BiasPrior)?;
        within(ranging.max_range_m, 1.0, 1e4, Setting::MaxRange)?;
        within(association.detection_probability, 0.01, 0.999, Setting::DetectionProbability)?;
        within(association.clutter_per_anchor, 1e-3, 100.0, Setting::ClutterPerAnchor)?;
        within(association.unmapped_per_anchor, 0.0, 100.0, Setting::UnmappedPerAnchor)?;
        within(association.survival_probability, 0.5, 1.0, Setting::SurvivalProbability)?;
        let AcquisitionSettings { newcomer_weight, settled_weight, settled_cycles, settled_within_m } =
            *acquisition;
        within(newcomer_weight, 1e-8, 0.1, Setting::NewcomerWeight)?;
        within(settled_weight, 0.5, 0.999_999_9, Setting::SettledWeight)?;
        within(f32::from(settled_cycles), 1.0, 1000.0, Setting::SettledCycles)?;
        within(settled_within_m, 0.01, 10.0, Setting::SettledWithin)?;
        let DiscoverySettings { begin_below_m, resolved_hits, resolved_existence, resolved_weight } =
            *discovery_settings;
        within(begin_below_m, 1e-3, 1.0, Setting::DiscoveryBegin)?;
        within(f32::from(resolved_hits), 2.0, 1000.0, Setting::DiscoveryHits)?;
        within(resolved_existence, 0.5, 0.99, Setting::DiscoveryExistence)?;
        within(resolved_weight, 0.5, 0.99999, Setting::DiscoveryWeight)?;
        match &radio.pulse_shape {
            PulseShape::RootRaisedCosine { roll_off } => within(*roll_off, 0.0, 1.0, Setting::RollOff)?,
            PulseShape::Sampled { step_s, autocorrelation } => {
                within(*step_s, 1e-12, 1e-8, Setting::PulseShape)?;
                let [first, second, ..] = *autocorrelation;
                within(first, 0.999, 1.001, Setting::PulseShape)?;
                within(second, -1.0, 0.9999, Setting::PulseShape)?;
                for sample in autocorrelation {
                    within(*sample, -1.001, 1.001, Setting::PulseShape)?;
                }
            }
        }
        within(radio.sample_spacing_s, 0.99e-11, 1.01e-8, Setting::SampleSpacing)?;
        within(radio.samples_per_frame as f32, 16.0, 4096.0, Setting::SampleCount)?;
        if let Some(full_scale) = radio.full_scale {
            within(full_scale, 1e-12, 1e12, Setting::FullScale)?;
        }
        within(radio.false_paths_per_frame, 1e-4, 10.0, Setting::FalsePaths)?;
        let EstimatorSettings { dense_decay_s, dense_decay_pulses, strong_sinr, merge_pulses } =
            radio.estimator;
        within(dense_decay_s, 0.99e-9, 1.01e-7, Setting::DenseDecay)?;
        within(dense_decay_pulses, 2.0, 100.0, Setting::DenseDecay)?;
        within(strong_sinr, 10.0, 1e6, Setting::StrongSinr)?;
        within(merge_pulses, 0.05, 1.0, Setting::MergeDistance)?;
        within(controller.learning.rate, 0.0, 1.0, Setting::LearningRate)?;
        within(controller.learning.experience_rate, 0.0, 1.0, Setting::LearningRate)?;
        within(controller.learning.discount, 0.0, 1.0, Setting::Discount)?;
        within(controller.choice.temperature_nat, 1e-3, 100.0, Setting::Temperature)?;
        within(controller.choice.exploration, 0.0, 1.0, Setting::Exploration)?;
        within(controller.choice.hysteresis_nat, 0.0, 100.0, Setting::Hysteresis)?;
        within(controller.planned_actions as f32, 0.0, 1e3, Setting::PlannedActions)?;
        within(controller.horizon as f32, 1.0, LONGEST_HORIZON as f32, Setting::Horizon)?;
        within(controller.prior_sinr, 0.01, 1e6, Setting::PriorSinr)?;
        if let Reward::Published { scale } = controller.reward {
            within(scale, 1e-30, 1e30, Setting::RewardScale)?;
        }
        Ok(())
    }
}
