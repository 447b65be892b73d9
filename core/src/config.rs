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
use crate::perceptor::channel_estimator::work::MOST_WORK;
pub use crate::radio::Radio;
use crate::radio::presets::RadioPreset;
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
    /// How much a cycle may cost.
    pub work: WorkLimits,
}

/// How much a cycle may cost: what bounds its longest, whatever is received. [`CycleReport`](crate::CycleReport) says what was left over.
/// Beside these, a cycle is bounded by the tracker's sizes, by the exact solution's states and the rounds of messages
/// ([`crate::perceptor::association`]), and by how many actions are planned, how far
/// ([`ControllerSettings::planned_actions`], [`ControllerSettings::horizon`]).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct WorkLimits {
    /// Work for each anchor that is heard in a cycle, about in instructions of a Cortex-M4F (20,000 to 1e9; [`crate::model::work`]): half of
    /// it at most goes into looking for the paths of its frame ([`crate::perceptor::channel_estimator::work`]), and what frames leave
    /// into comparing components of the belief with the scans, two at least. Less: the weakest of many paths are missed in crowded
    /// frames, a lost tag is found later, and one of two places may be dropped.
    pub anchor: u32,
    /// How often components of the belief are compared with scans at most (1 to 65,535), each scan with two at least. Where more is
    /// heard, fewer components are carried.
    pub comparisons: u16,
}

impl WorkLimits {
    /// Those of a tracker that is not started.
    pub(crate) const NONE: Self = Self { anchor: 0, comparisons: 0 };

    /// Work on the paths of a frame after which no more are looked for, on top of what every frame costs.
    pub const fn frame(&self) -> u32 {
        self.anchor / 2
    }
}

impl Default for WorkLimits {
    fn default() -> Self {
        Self { anchor: 2 * MOST_WORK, comparisons: 64 }
    }
}

written!(WorkLimits { anchor, comparisons });

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
            radio: RadioPreset::Sounder.radio(),
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
            work: WorkLimits::default(),
        }
    }
}

impl Config {
    /// That of a tracker that is not started.
    pub(crate) const NONE: Self = Self {
        motion: Motion::NONE,
        start: Start { position_m: [0.0; 2], position_std_m: 0.0, velocity_std_m_s: 0.0 },
        has_heading: false,
        ranging: Ranging::NONE,
        association: AssociationSettings::NONE,
        belief: BeliefSettings::NONE,
        channel: ChannelMemorySettings::NONE,
        discovery: false,
        discovery_settings: DiscoverySettings::NONE,
        exact_map: false,
        estimator: EstimatorSettings::NONE,
        radio: Radio::NONE,
        work: WorkLimits::NONE,
        controller: ControllerSettings {
            reward: Reward::InformationGain,
            learning: Learning { rate: 0.0, experience_rate: 0.0, discount: 0.0, bootstrap: false },
            choice: Choice {
                temperature_nat: 0.0,
                exploration_per_s: 0.0,
                hysteresis_nat: 0.0,
                patience_s: 0.0,
            },
            planned_actions: 0,
            horizon: 0,
            first_action: 0,
            prior_sinr: 0.0,
            neighbours: false,
            per_anchor: false,
            rendezvous: None,
        },
    };

    /// The published set-up, which is the default: its tag, its radio ([`RadioPreset::Sounder`]) and how many actions are planned. The
    /// algorithm is the core's, for example with velocities that decay (published: constant); [`Self::with_variant`] tells the
    /// published ways of association apart.
    pub fn published() -> Self {
        Self::default()
    }

    /// A tag that somebody carries indoors, with this radio. The library is the radio's ([`RadioPreset::library`]). `start.position_m` is
    /// the user's: the middle of the room, say, with the deviation of a place anywhere in it.
    ///
    /// | setting | value | why |
    /// | --- | --- | --- |
    /// | acceleration density | 0.1 m^2/s^3 | as told of people in the random rooms of the simulator: 1 m/s^2 for 0.1 s at a time |
    /// | velocity decay | 10 s | the default; with it the speed is sqrt(density x decay) = 1.0 m/s rms, that of somebody who walks |
    /// | deviation of the first velocity, and of one after a turn | 0.7 m/s per axis | the same speed, in any direction |
    /// | deviation of the first position | 1.5 m per axis | as the importer of MILUV |
    ///
    /// With a DW1000 or DW3000, as the importer of MILUV, which found them on one flight:
    ///
    /// | setting | value | why |
    /// | --- | --- | --- |
    /// | ranges late by | 1 m at first | people and walls block the direct path; each anchor's share and excess are learnt |
    /// | bias of an anchor's ranges | 0 +- 0.15 m | antenna delays that nobody calibrated; 0.05 m or less where somebody did |
    /// | false ranges | 0.02 per anchor and cycle | a radio that ranges rarely measures something else |
    ///
    /// Dense multipath begins with a path ([`EstimatorSettings::begins_with_path`]), as in responses of such radios in flats and halls. The
    /// deviation of ranges comes with them ([`RadioPreset::range_std_m`]). All else is the default, `ranging.max_range_m` = 30 m among
    /// it: more where the radio is heard further.
    pub fn pedestrian(radio: RadioPreset) -> Self {
        Self::mobile(radio, 0.1, 0.7)
    }

    /// A robot on wheels, at 0.3 to 0.8 m/s. As [`Self::pedestrian`], but:
    ///
    /// | setting | value | why |
    /// | --- | --- | --- |
    /// | acceleration density | 0.035 m^2/s^3 | as told of robots in the random rooms, median over 300 ways along walls |
    /// | deviation of the first velocity, and of one after a turn | 0.42 m/s per axis | the speed that follows: 0.6 m/s rms |
    ///
    /// A faster one has the density times the square of its speed over 0.6 m/s, and the deviation of its speed over sqrt 2.
    pub fn robot(radio: RadioPreset) -> Self {
        Self::mobile(radio, 0.035, 0.42)
    }

    /// What the profiles have in common.
    fn mobile(radio: RadioPreset, acceleration_density_m2_s3: f32, velocity_std_m_s: f32) -> Self {
        let mut config = Self { radio: radio.radio(), ..Self::default() };
        config.motion.acceleration_density_m2_s3 = acceleration_density_m2_s3;
        config.start.position_std_m = 1.5;
        config.start.velocity_std_m_s = velocity_std_m_s;
        if radio.range_std_m().is_some() {
            config.ranging.late_m = 1.0;
            config.ranging.bias_std_m = 0.15;
            config.association.clutter_per_anchor = 0.02;
            config.estimator.begins_with_path = true;
        }
        config
    }

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
            work,
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
            walls_bar_ways: _,
            walls_hide_paths: _,
            reads_below_threshold: _,
        } = *belief;
        within(turns_per_s, 0.0, 10.0, Setting::Turns)?;
        within(elsewhere_per_s, 1e-9, 1.0, Setting::Elsewhere)?;
        within(outages_per_s, 0.0, 10.0, Setting::Outages)?;
        within(returns_per_s, 1e-3, 100.0, Setting::Outages)?;
        within(split_above_m, 0.01, 100.0, Setting::SplitAbove)?;
        within(f32::from(work.comparisons), 1.0, f32::from(u16::MAX), Setting::Comparisons)?;
        if !(20_000..=1_000_000_000).contains(&work.anchor) {
            return Err(Error::Configuration(Setting::AnchorWork));
        }
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
        let EstimatorSettings { dense_decay_s, dense_decay_pulses, merge_pulses, .. } = *estimator;
        within(dense_decay_s, 0.99e-9, 1.01e-7, Setting::DenseDecay)?;
        within(dense_decay_pulses, 2.0, 100.0, Setting::DenseDecay)?;
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
    controller,
    work
});

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::anchor::Anchor;
    use crate::model::observation::{Observation, Range, RangeScan};
    use crate::model::plan::Map;
    use crate::radio::accumulator::{AccumulatorFormat, Cir, Window, first_path_index};
    use crate::tracker::Tracker;

    const PLACES_M: [[f32; 2]; 4] = [[0.3, 0.2], [9.7, 0.4], [9.6, 7.7], [0.2, 7.8]];

    fn tracker(config: Config, preset: RadioPreset) -> Result<Tracker<4, 2, 2, 1, 4, 40, 8, 0, 6>, Error> {
        let anchors = PLACES_M.map(|position_m| Anchor { position_m, height_m: 0.0 });
        let mut tracker = Tracker::new();
        tracker.start(&config, &anchors, &Map::default(), preset.library(), 1)?;
        Ok(tracker)
    }

    #[test]
    fn every_preset_is_accepted() {
        assert_eq!(Config::published(), Config::default());
        assert_eq!(Config::published().radio, RadioPreset::Sounder.radio());
        for preset in RadioPreset::ALL {
            for config in [Config::pedestrian(preset), Config::robot(preset)] {
                config.validate().unwrap();
                for variant in Variant::ALL {
                    tracker(config.with_variant(variant), preset).unwrap();
                }
                // The speed told is the one that the motion has by itself.
                let Motion { acceleration_density_m2_s3, velocity_decay_s, .. } = config.motion;
                let per_axis_m_s = (0.5 * acceleration_density_m2_s3 * velocity_decay_s).sqrt();
                assert!((config.start.velocity_std_m_s / per_axis_m_s - 1.0).abs() < 0.02, "{per_axis_m_s}");
            }
        }
        tracker(Config::published(), RadioPreset::Sounder).unwrap();
    }

    /// Normal deviates (Box and Muller 1958) of a linear congruence.
    struct Noise(u64);

    impl Noise {
        fn uniform(&mut self) -> f64 {
            self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((self.0 >> 11) as f64 + 0.5) / (1_u64 << 53) as f64
        }

        fn normal(&mut self) -> f64 {
            (-2.0 * self.uniform().ln()).sqrt() * (core::f64::consts::TAU * self.uniform()).cos()
        }
    }

    /// Root mean squared errors of position (metres) and velocity (m/s) after the first 5 s of 60 s on a circle of 2.5 m at this speed,
    /// at 10 cycles per second, with the four anchors at once or in turn. A share of the ranges is late by 1 m on average.
    fn circle(config: Config, speed_m_s: f64, at_once: bool, late: f64, seed: u64) -> [f64; 2] {
        let config = Config { start: Start { position_m: [5.0, 4.0], ..config.start }, ..config };
        let mut tracker = tracker(config, RadioPreset::Dw1000).unwrap();
        let std_m = RadioPreset::Dw1000.range_std_m().unwrap();
        let mut noise = Noise(seed);
        let mut squares = [0.0; 2];
        let (cycles, settled) = (600, 50);
        for cycle in 0..cycles {
            let angle = 0.1 * f64::from(cycle) * speed_m_s / 2.5;
            let (sin, cos) = angle.sin_cos();
            let place_m = [5.0 + 2.5 * cos, 4.0 + 2.5 * sin];
            let velocity_m_s = [-speed_m_s * sin, speed_m_s * cos];
            let ranges = PLACES_M.map(|[x, y]| {
                let direct_m = (place_m[0] - f64::from(x)).hypot(place_m[1] - f64::from(y));
                let excess_m = if noise.uniform() < late { -noise.uniform().ln() } else { 0.0 };
                let range_m = (direct_m + excess_m + f64::from(std_m) * noise.normal()) as f32;
                [Range { range_m, variance_m2: std_m * std_m }]
            });
            let scans =
                [0, 1, 2, 3].map(|anchor| Observation::Ranges(RangeScan { anchor, ranges: &ranges[anchor] }));
            let turn = cycle as usize % 4;
            let heard = if at_once { &scans[..] } else { &scans[turn..=turn] };
            let report = tracker.cycle(heard, 0.1, None).unwrap();
            if cycle >= settled {
                for (square, (own, truth)) in squares
                    .iter_mut()
                    .zip([(report.position_m, place_m), (report.velocity_m_s, velocity_m_s)])
                {
                    *square +=
                        (f64::from(own[0]) - truth[0]).powi(2) + (f64::from(own[1]) - truth[1]).powi(2);
                }
            }
        }
        squares.map(|square| (square / f64::from(cycles - settled)).sqrt())
    }

    /// The same circle, all anchors at once, with the bytes of each one's response beside its range: a pulse that is greatest 2.0 samples
    /// behind the index, a reflection that is 4 m longer with half its amplitude, and noise 30 dB below the pulse.
    #[test]
    fn responses_from_the_accumulator_are_tracked_beside_the_ranges() {
        let preset = RadioPreset::Dw1000;
        let start = Start { position_m: [5.0, 4.0], ..Config::pedestrian(preset).start };
        let config = Config { start, ..Config::pedestrian(preset) };
        let mut tracker = tracker(config, preset).unwrap();
        let std_m = preset.range_std_m().unwrap();
        let peak_samples = preset.peak_after_first_path_samples().unwrap();
        let mut noise = Noise(3);
        let (mut square_m2, mut paths) = (0.0, 0);
        let pi = core::f64::consts::PI;
        let sample_m = 299_792_458.0 / 998.4e6;
        let pulse = |lag_m: f64| {
            let x = lag_m / (2e-9 * 299_792_458.0) + 1e-9;
            (pi * x).sin() / (pi * x) * (0.5 * pi * x).cos() / (1.0 - x * x)
        };
        for cycle in 0..300 {
            let angle = 0.1 * f64::from(cycle) * 1.2 / 2.5;
            let place_m = [5.0 + 2.5 * angle.cos(), 4.0 + 2.5 * angle.sin()];
            let links = PLACES_M.map(|[x, y]| {
                let direct_m = (place_m[0] - f64::from(x)).hypot(place_m[1] - f64::from(y));
                let range_m = (direct_m + f64::from(std_m) * noise.normal()) as f32;
                let register = 745 * 64 + (64.0 * noise.uniform()) as u16;
                let index = first_path_index(register);
                let first = Window::USUAL.first_sample(index).unwrap();
                let phase = core::f64::consts::TAU * noise.uniform();
                let mut bytes = std::vec::Vec::new();
                for n in first..first + Window::USUAL.len() {
                    let lag_m = (n as f64 - f64::from(index) - 2.0) * sample_m;
                    let amplitude = 8000.0 * (pulse(lag_m) + 0.5 * pulse(lag_m - 4.0));
                    for part in [phase.cos(), phase.sin()] {
                        let value = amplitude * part + 8000.0 * 0.0316 / 2.0_f64.sqrt() * noise.normal();
                        bytes.extend((value.round() as i16).to_le_bytes());
                    }
                }
                let format = AccumulatorFormat::Bits16;
                let cir = Cir::<128>::from_accumulator(&bytes, first, format, index, Window::USUAL).unwrap();
                (cir, [Range { range_m, variance_m2: std_m * std_m }])
            });
            let mut observations = std::vec::Vec::new();
            for (anchor, (cir, ranges)) in links.iter().enumerate() {
                observations.push(Observation::Frame(cir.frame(anchor, 0, ranges[0].range_m, peak_samples)));
                observations.push(Observation::Ranges(RangeScan { anchor, ranges }));
            }
            let report = tracker.cycle(&observations, 0.1, None).unwrap();
            if cycle >= 50 {
                let [x, y] = report.position_m.map(f64::from);
                square_m2 += (x - place_m[0]).powi(2) + (y - place_m[1]).powi(2);
                paths += report.measurements;
            }
        }
        let rmse_m = (square_m2 / 250.0_f64).sqrt();
        std::println!(
            "with responses: {rmse_m:.3} m, {:.2} measurements per anchor",
            f64::from(paths) / 1000.0
        );
        assert!(rmse_m < 0.2, "{rmse_m}");
        // The range, which replaces the direct path, and the reflection.
        assert!(paths > 1800 && paths < 2400, "{paths}");
    }

    #[test]
    fn both_profiles_track_who_walks_in_a_circle() {
        let profiles = [
            ("pedestrian", Config::pedestrian(RadioPreset::Dw1000), 1.2),
            ("robot", Config::robot(RadioPreset::Dw1000), 0.6),
            ("robot, told of somebody who walks", Config::robot(RadioPreset::Dw1000), 1.2),
        ];
        for (name, config, speed_m_s) in profiles {
            for (how, at_once, late, most_m) in [
                ("all at once", true, 0.0, 0.2),
                ("one in ten late", true, 0.1, 0.2),
                ("in turn", false, 0.0, 0.2),
            ] {
                let mut worst = [0.0_f64; 2];
                for seed in 1..=5 {
                    let errors = circle(config, speed_m_s, at_once, late, seed);
                    worst = [0, 1].map(|of| worst[of].max(errors[of]));
                }
                std::println!("{name}, {how}: {:.3} m, {:.3} m/s at worst of 5", worst[0], worst[1]);
                assert!(worst[0] < most_m && worst[1] < 0.5 * speed_m_s, "{name}, {how}: {worst:?}");
            }
        }
    }
}
