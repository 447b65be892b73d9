//! Configuration: plain data, every field with its unit, its range and what more or less of it does.

pub use crate::controller::ControllerSettings;
use crate::controller::planning::LONGEST_HORIZON;
use crate::controller::policy::Choice;
use crate::controller::reward::Reward;
use crate::controller::value::Learning;
use crate::error::{Error, Setting};
use crate::memory::channel::ChannelMemorySettings;
use crate::memory::discovery::DiscoverySettings;
pub use crate::model::measurement::Ranging;
use crate::model::motion::Motion;
pub use crate::model::motion::Start;
pub use crate::perceptor::association::AssociationSettings;
use crate::perceptor::association::Mode;
use crate::perceptor::belief::BeliefSettings;
use crate::perceptor::channel_estimator::EstimatorSettings;
pub use crate::radio::Radio;
use crate::radio::pulse::PulseShape;
use crate::snapshot::written;

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
    /// Whether antennas beside the centre of the tag's body take turns ([`crate::Tracker::switch_antenna`]): which way it faces is
    /// then estimated, in the place of one surface.
    pub has_heading: bool,
    /// What a range is worth.
    pub ranging: Ranging,
    /// What association assumes.
    pub association: AssociationSettings,
    /// Where the tag may be, and how it turns.
    pub belief: BeliefSettings,
    /// How the channel memory follows what it hears.
    pub channel: ChannelMemorySettings,
    /// Whether unknown virtual anchors are looked for.
    pub discovery: bool,
    /// How much it takes to find one.
    pub discovery_settings: DiscoverySettings,
    /// Whether every virtual anchor of the map is exactly where it is told to be: the deviations told then count as 0,
    /// and the virtual anchors are held fixed.
    pub exact_map: bool,
    /// What is a path in a frame, and what dense multipath.
    pub estimator: EstimatorSettings,
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
                acceleration_density_m2_s3: 1e-5,
                velocity_decay_s: 10.0,
                virtual_anchor_walk_m_sqrt_s: 3e-4,
            },
            start: Start { position_m: [0.0, 0.0], position_std_m: 0.25, velocity_std_m_s: 0.03 },
            has_heading: false,
            ranging: Ranging {
                variance_inflation: 1.44,
                floor_m: 2e-3,
                floor_pulses: 0.1,
                alike_s: 0.3,
                bias_mean_m: 0.0,
                bias_std_m: 0.0,
                late_m: 0.0,
                max_range_m: 30.0,
            },
            association: AssociationSettings {
                mode: Mode::Soft,
                detection_probability: 0.95,
                clutter_per_anchor: 1.0,
                unmapped_per_anchor: 5.0,
                map_change_per_s: 1e-4,
            },
            belief: BeliefSettings::default(),
            channel: ChannelMemorySettings::default(),
            discovery: true,
            discovery_settings: DiscoverySettings::default(),
            exact_map: false,
            estimator: EstimatorSettings::default(),
            radio: Radio {
                pulse_shape: PulseShape::RootRaisedCosine { roll_off: 0.6 },
                sample_spacing_s: 0.25e-9,
                samples_per_frame: 400,
                full_scale: None,
                gain_control: false,
                false_paths_per_frame: 0.1,
            },
            controller: ControllerSettings {
                reward: Reward::InformationGain,
                learning: Learning { rate: 0.5, experience_rate: 0.02, discount: 0.5, bootstrap: false },
                choice: Choice {
                    temperature_nat: 0.1,
                    exploration_per_s: 0.003,
                    hysteresis_nat: 0.01,
                    patience_s: 1.4,
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
            has_heading: _,
            ranging,
            association,
            belief,
            channel,
            discovery: _,
            discovery_settings,
            exact_map: _,
            estimator,
            radio,
            controller,
        } = self;
        within(motion.acceleration_density_m2_s3, 1e-12, 1e4, Setting::AccelerationDensity)?;
        within(motion.velocity_decay_s, 0.1, f32::INFINITY, Setting::VelocityDecay)?;
        within(motion.virtual_anchor_walk_m_sqrt_s, 1e-7, 1.0, Setting::VirtualAnchorWalk)?;
        for coordinate in start.position_m {
            within(coordinate, -1e4, 1e4, Setting::StartPosition)?;
        }
        within(start.position_std_m, 1e-3, 1e3, Setting::StartDeviation)?;
        within(start.velocity_std_m_s, 1e-3, 1e3, Setting::StartDeviation)?;
        within(ranging.variance_inflation, 1.0, 100.0, Setting::RangeVarianceInflation)?;
        within(ranging.floor_m, 1e-3, 10.0, Setting::RangeFloor)?;
        within(ranging.floor_pulses, 0.0, 1.0, Setting::RangeFloor)?;
        within(ranging.alike_s, 0.0, 100.0, Setting::RangeFloor)?;
        within(ranging.bias_mean_m, -10.0, 10.0, Setting::BiasPrior)?;
        within(ranging.bias_std_m, 0.0, 10.0, Setting::BiasPrior)?;
        within(ranging.late_m, 0.0, 100.0, Setting::Lateness)?;
        within(ranging.max_range_m, 1.0, 1e4, Setting::MaxRange)?;
        within(association.detection_probability, 0.01, 0.999, Setting::DetectionProbability)?;
        within(association.clutter_per_anchor, 1e-3, 100.0, Setting::ClutterPerAnchor)?;
        within(association.unmapped_per_anchor, 0.0, 100.0, Setting::UnmappedPerAnchor)?;
        within(association.map_change_per_s, 0.0, 10.0, Setting::MapChange)?;
        let BeliefSettings {
            turns_per_s,
            elsewhere_per_s,
            outages_per_s,
            returns_per_s,
            split_above_m,
            comparisons,
            walls_bar_ways: _,
            walls_hide_paths: _,
            reads_below_threshold: _,
        } = *belief;
        within(turns_per_s, 0.0, 10.0, Setting::Turns)?;
        within(elsewhere_per_s, 1e-9, 1.0, Setting::Elsewhere)?;
        within(outages_per_s, 0.0, 10.0, Setting::Outages)?;
        within(returns_per_s, 1e-3, 100.0, Setting::Outages)?;
        within(split_above_m, 0.01, 100.0, Setting::SplitAbove)?;
        within(f32::from(comparisons), 1.0, f32::from(u16::MAX), Setting::Comparisons)?;
        let ChannelMemorySettings {
            forgetting_per_s,
            energy_walk_per_s,
            noise_walk_per_s,
            place_ln,
            hiding_per_s,
        } = *channel;
        for walk_per_s in [energy_walk_per_s, noise_walk_per_s] {
            within(walk_per_s, 0.0, 100.0, Setting::ChannelMemory)?;
        }
        for value in [forgetting_per_s, place_ln, hiding_per_s] {
            within(value, 0.0, 10.0, Setting::ChannelMemory)?;
        }
        let DiscoverySettings { begin_below_m, resolved_hits, resolved_weight } = *discovery_settings;
        within(begin_below_m, 1e-3, 1.0, Setting::DiscoveryBegin)?;
        within(f32::from(resolved_hits), 2.0, 1000.0, Setting::DiscoveryHits)?;
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
        let EstimatorSettings { dense_decay_s, dense_decay_pulses, strong_sinr, merge_pulses } = *estimator;
        within(dense_decay_s, 0.99e-9, 1.01e-7, Setting::DenseDecay)?;
        within(dense_decay_pulses, 2.0, 100.0, Setting::DenseDecay)?;
        within(strong_sinr, 10.0, 1e6, Setting::StrongSinr)?;
        within(merge_pulses, 0.05, 1.0, Setting::MergeDistance)?;
        within(controller.learning.rate, 0.0, 1.0, Setting::LearningRate)?;
        within(controller.learning.experience_rate, 0.0, 1.0, Setting::LearningRate)?;
        within(controller.learning.discount, 0.0, 1.0, Setting::Discount)?;
        within(controller.choice.temperature_nat, 1e-3, 100.0, Setting::Temperature)?;
        within(controller.choice.exploration_per_s, 0.0, 1e3, Setting::Exploration)?;
        within(controller.choice.patience_s, 0.0, 1e6, Setting::Patience)?;
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

written!(Config {
    motion,
    start,
    has_heading,
    ranging,
    association,
    belief,
    channel,
    discovery,
    discovery_settings,
    exact_map,
    estimator,
    radio,
    controller
});
