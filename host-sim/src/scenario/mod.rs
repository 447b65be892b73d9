//! Scenarios: a room, a radio and a way through it, as a user writes them down in one TOML file.
//!
//! These types are the file format: [`Scenario::schema`] derives the published JSON schema from them, bounds included,
//! and [`Scenario::read`] holds every number to those bounds. Whatever is optional has a default that is written
//! beside it. `docs/scenario-format.md` lists every key.
//!
//! SI units; positions are horizontal, x and y in metres.

mod builtin;
mod check;
pub mod construction;
mod radio;
mod read;
mod schema;

use crate::recording::USUAL_TURN_STD_DEG;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

pub use builtin::{BUILT_IN, BuiltIn};
pub(crate) use check::CLEARANCE_M;
pub use construction::{construction, material, walls};

/// The version of the format: the key `format`.
pub const FORMAT: u32 = 1;

/// A room, a radio and ways through the room.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Scenario {
    /// Version of the format: 1.
    #[schemars(range(min = 1, max = 1))]
    pub format: u32,
    /// A short name, for tables and figures.
    #[schemars(length(min = 1, max = 150))]
    pub name: String,
    /// What the scenario is about, for people.
    #[serde(default)]
    pub description: String,
    /// Seed of everything random, unless the command is given another.
    #[serde(default = "defaults::seed")]
    #[schemars(range(min = 0, max = 9_007_199_254_740_991_u64))]
    pub seed: u64,
    /// The floor plan.
    pub room: Room,
    /// Materials beside the built-in ones (ITU-R P.2040-3), by name.
    #[serde(default)]
    pub materials: BTreeMap<String, Material>,
    /// Wall constructions beside the built-in ones, by name.
    #[serde(default)]
    pub constructions: BTreeMap<String, Construction>,
    /// How far paths are followed.
    #[serde(default)]
    pub propagation: Propagation,
    /// The anchors; their positions are exact.
    #[schemars(length(min = 1, max = 8))]
    pub anchors: Vec<Anchor>,
    /// The tag.
    #[serde(default)]
    pub tag: Tag,
    /// The ways of one or several tags through the room; a recording is made of one of them.
    #[schemars(length(min = 1, max = 1000))]
    pub trajectories: Vec<Trajectory>,
    /// The radio.
    #[serde(default)]
    pub radio: Radio,
    /// White noise.
    #[serde(default)]
    pub noise: Noise,
    /// The room's own dense multipath.
    #[serde(default)]
    pub dense_multipath: DenseMultipath,
    /// Dense multipath of interferers, each limited to its band and to a part of the way.
    #[serde(default)]
    #[schemars(length(max = 16))]
    pub interference: Vec<Interference>,
    /// Parts of the way on which paths are weakened by something that is not in the plan.
    #[serde(default)]
    #[schemars(length(max = 64))]
    pub obstructions: Vec<Obstruction>,
    /// People who walk through the room and shadow paths.
    #[serde(default)]
    #[schemars(length(max = 64))]
    pub people: Vec<Person>,
    /// Frames that never arrive.
    #[serde(default)]
    pub lost_frames: LostFrames,
    /// Errors of clock and calibration.
    #[serde(default)]
    pub errors: Errors,
    /// What a tracker is told before it starts.
    #[serde(default)]
    pub prior: Prior,
}

/// A floor plan. Walls are thin vertical sheets that reflect on both sides.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Room {
    /// Corners of the outer walls in order, either way round, metres; side n runs from corner n to the next, the last
    /// one back to corner 0.
    #[schemars(length(min = 3, max = 200))]
    #[schemars(with = "Vec<[Coordinate; 2]>")]
    pub corners_m: Vec<Position>,
    /// Construction of every outer wall that `sides` does not name.
    #[serde(default = "defaults::construction")]
    pub construction: String,
    /// Construction of each side in order; an empty list means `construction` for all.
    #[serde(default)]
    #[schemars(length(max = 200))]
    pub sides: Vec<String>,
    /// Walls inside the room.
    #[serde(default)]
    #[schemars(length(max = 200))]
    pub inner_walls: Vec<InnerWall>,
}

/// A horizontal position: x and y, metres.
pub type Position = [f64; 2];

/// A coordinate, metres. It bounds coordinates in the schema.
#[derive(JsonSchema)]
#[schemars(transparent)]
#[allow(dead_code, reason = "says what a coordinate may be; the values themselves are plain numbers")]
struct Coordinate(#[schemars(range(min = -1000.0, max = 1000.0))] f64);

/// A share of the way. It bounds shares in the schema.
#[derive(JsonSchema)]
#[schemars(transparent)]
#[allow(dead_code, reason = "says what a share may be; the values themselves are plain numbers")]
struct Share(#[schemars(range(min = 0.0, max = 1.0))] f64);

/// One part of a pulse's sample. It bounds samples in the schema.
#[derive(JsonSchema)]
#[schemars(transparent)]
#[allow(dead_code, reason = "says what a sample may be; the values themselves are plain numbers")]
struct SamplePart(#[schemars(range(min = -1e12, max = 1e12))] f64);

/// A wall inside the room.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct InnerWall {
    /// One end, metres.
    #[schemars(with = "[Coordinate; 2]")]
    pub from_m: Position,
    /// The other end, metres.
    #[schemars(with = "[Coordinate; 2]")]
    pub to_m: Position,
    /// Its construction.
    #[serde(default = "defaults::construction")]
    pub construction: String,
}

/// Electrical properties over frequency as in ITU-R P.2040: relative permittivity a f^b, conductivity c f^d in S/m, with
/// f in GHz.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Material {
    /// Relative permittivity at 1 GHz.
    #[schemars(range(min = 1.0, max = 100.0))]
    pub a: f64,
    /// Its exponent over frequency.
    #[serde(default)]
    #[schemars(range(min = -2.0, max = 2.0))]
    pub b: f64,
    /// Conductivity at 1 GHz, S/m.
    #[schemars(range(min = 0.0, max = 1e8))]
    pub c: f64,
    /// Its exponent over frequency.
    #[serde(default)]
    #[schemars(range(min = -2.0, max = 3.0))]
    pub d: f64,
}

/// How a wall is built.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged, deny_unknown_fields)]
pub enum Construction {
    /// Layers from one side to the other.
    Layered {
        /// The layers in order.
        #[schemars(length(min = 1, max = 20))]
        layers: Vec<Layer>,
    },
    /// The same loss at every frequency and angle, with no shift of the delay.
    Flat {
        /// Power lost by a reflection, decibels.
        #[schemars(range(min = 0.0, max = 100.0))]
        reflection_loss_db: f64,
        /// Power lost by passing through, decibels.
        #[schemars(range(min = 0.0, max = 200.0))]
        transmission_loss_db: f64,
    },
}

/// One layer of a wall.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Layer {
    /// A material of `materials` or a built-in one.
    pub material: String,
    /// Its thickness, metres.
    #[schemars(range(min = 1e-5, max = 5.0))]
    pub thickness_m: f64,
}

/// How far paths are followed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Propagation {
    /// Most reflections of a path.
    #[schemars(range(min = 0, max = 8))]
    pub reflection_order: usize,
    /// Most walls that a path may pass through; at 0 every wall in the way blocks it.
    #[schemars(range(min = 0, max = 8))]
    pub transmissions: usize,
    /// Polarisation of the antennas.
    pub polarisation: Polarisation,
}

impl Default for Propagation {
    fn default() -> Self {
        Self { reflection_order: 2, transmissions: 0, polarisation: Polarisation::Vertical }
    }
}

/// Polarisation of the antennas; walls are vertical.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Polarisation {
    /// Vertical: the electric field is parallel to the walls (TE).
    Vertical,
    /// Horizontal: the electric field lies in the plane of incidence (TM).
    Horizontal,
}

/// An anchor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Anchor {
    /// Its name, unique in the scenario.
    #[schemars(length(min = 1, max = 100))]
    pub name: String,
    /// Its horizontal position, metres.
    #[schemars(with = "[Coordinate; 2]")]
    pub position_m: Position,
    /// Its height, metres.
    #[serde(default = "defaults::height_m")]
    #[schemars(range(min = -100.0, max = 100.0))]
    pub height_m: f64,
    /// Its antenna.
    #[serde(default)]
    pub antenna: Antenna,
    /// Added to every range of this anchor, metres: calibration that is off.
    #[serde(default)]
    #[schemars(range(min = -10.0, max = 10.0))]
    pub range_bias_m: f64,
}

/// An antenna's gain over the direction.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Antenna {
    /// The shape of the pattern.
    pub pattern: Pattern,
    /// Direction it faces, degrees from the x axis towards the y axis.
    #[schemars(range(min = -360.0, max = 360.0))]
    pub boresight_deg: f64,
    /// Largest gain, dBi.
    #[schemars(range(min = -40.0, max = 40.0))]
    pub gain_dbi: f64,
    /// Ripple of the amplitude over azimuth, relative (0.2: 1 + 0.2 cos of the azimuth).
    #[schemars(range(min = 0.0, max = 0.9))]
    pub ripple: f64,
    /// Turn of the ripple with frequency, degrees per GHz.
    #[schemars(range(min = -720.0, max = 720.0))]
    pub ripple_turn_deg_per_ghz: f64,
}

impl Default for Antenna {
    fn default() -> Self {
        Self {
            pattern: Pattern::Isotropic,
            boresight_deg: 0.0,
            gain_dbi: 0.0,
            ripple: 0.0,
            ripple_turn_deg_per_ghz: 30.0,
        }
    }
}

/// The shape of a pattern.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Pattern {
    /// The same in every direction.
    Isotropic,
    /// A vertical half-wave dipole: uniform over azimuth, weaker towards its axis.
    Dipole,
    /// A patch: strongest ahead, 20 dB weaker behind.
    Patch,
}

/// The tag.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Tag {
    /// Its height, metres, where the trajectory gives none.
    #[schemars(range(min = -100.0, max = 100.0))]
    pub height_m: f64,
    /// Standard deviation of its height as the tracker is told it, metres. The height told is wrong by one draw of it, the
    /// same all the way; the true one is `height_m` or the trajectory's.
    #[schemars(range(min = 0.0, max = 100.0))]
    #[serde(skip_serializing_if = "is_exact")]
    pub height_std_m: f64,
    /// Its antenna; it does not turn with the motion.
    pub antenna: Antenna,
}

/// Whether a deviation says that there is none.
fn is_exact(std_m: &f64) -> bool {
    *std_m == 0.0
}

impl Default for Tag {
    fn default() -> Self {
        Self { height_m: defaults::height_m(), height_std_m: 0.0, antenna: Antenna::default() }
    }
}

/// One way through the room.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Trajectory {
    /// Its name.
    #[serde(default)]
    #[schemars(length(max = 200))]
    pub name: String,
    /// Time between two cycles, seconds.
    #[serde(default = "defaults::period_s")]
    #[schemars(range(min = 1e-4, max = 60.0))]
    pub period_s: f64,
    /// Number of cycles; without it the whole way. Must not be more than the way has.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 1, max = 1_000_000))]
    pub cycles: Option<usize>,
    /// Where it goes.
    pub way: Way,
}

/// Where a trajectory goes: exactly one of the keys.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum Way {
    /// Straight legs between vertices, with a fixed distance from cycle to cycle.
    Polyline {
        /// The vertices, metres.
        #[schemars(length(min = 2, max = 10000))]
        #[schemars(with = "Vec<[Coordinate; 2]>")]
        vertices_m: Vec<Position>,
        /// Distance between two cycles, metres.
        #[schemars(range(min = 1e-4, max = 100.0))]
        step_m: f64,
    },
    /// From waypoint to waypoint, each leg with its own speed.
    Waypoints {
        /// The waypoints in order.
        #[schemars(length(min = 2, max = 10000))]
        points: Vec<Waypoint>,
    },
    /// A recorded way.
    Recorded {
        /// CSV file with a header and the columns `x_m`, `y_m`, and optionally `time_s` and `height_m`; relative to the
        /// scenario's folder. With times, `period_s` is not used.
        file: String,
    },
}

/// A point on the way.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Waypoint {
    /// Its position, metres.
    #[schemars(with = "[Coordinate; 2]")]
    pub position_m: Position,
    /// Speed from here to the next waypoint, m/s.
    #[serde(default = "defaults::speed_m_s")]
    #[schemars(range(min = 0.001, max = 100.0))]
    pub speed_m_s: f64,
    /// Time spent here before moving on, seconds.
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 100_000.0))]
    pub pause_s: f64,
}

/// The radio. What is left out follows from `kind`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Radio {
    /// What the rest defaults to.
    pub kind: RadioKind,
    /// The pulse. Sounder: root-raised-cosine of roll-off 0.6. DW1000, DW3000: the HRP reference pulse.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pulse: Option<Pulse>,
    /// The carriers and pulse durations to choose from. Sounder: `published`. DW1000: `dw1000`. DW3000: `dw3000`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub library: Option<Library>,
    /// Index into the library of the first frame. Sounder: the entry nearest to 7 GHz; else 0.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0, max = 39))]
    pub first_action: Option<usize>,
    /// What a recording is made with.
    pub schedule: Schedule,
    /// Time between two samples, seconds. Sounder: 0.25e-9. DW1000, DW3000: 1 / 998.4 MHz.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 1e-11, max = 1e-8))]
    pub sample_spacing_s: Option<f64>,
    /// Samples per frame. Sounder: 400. DW1000, DW3000: 1016.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 16, max = 4096))]
    pub samples: Option<usize>,
    /// How the samples lie in time.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub window: Option<Window>,
    /// The converter. Sounder: none. DW1000: 16 bits. DW3000: 18 bits.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub converter: Option<Converter>,
    /// Whether every packet has a random phase. Sounder: false. DW1000, DW3000: true.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub random_phase: Option<bool>,
    /// What is logged.
    pub log: Log,
}

/// Radios with known properties.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum RadioKind {
    /// A channel sounder: pulse of 0.5 ns, two samples per pulse duration, absolute delays and phases.
    #[default]
    Sounder,
    /// Decawave DW1000.
    Dw1000,
    /// Qorvo DW3000.
    Dw3000,
}

/// A pulse.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "shape", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Pulse {
    /// Root-raised-cosine; its duration is the action's.
    RootRaisedCosine {
        /// Roll-off.
        #[schemars(range(min = 0.0, max = 1.0))]
        roll_off: f64,
    },
    /// The reference pulse of IEEE 802.15.4 HRP: root-raised-cosine of roll-off 0.5; its duration is the action's.
    Hrp,
    /// The transmitted pulse, sampled.
    Sampled {
        /// Time between two samples, seconds.
        #[schemars(range(min = 1e-12, max = 1e-8))]
        spacing_s: f64,
        /// Real and imaginary part of each sample, in any unit; the pulse is scaled to unit energy.
        #[schemars(length(min = 2, max = 4096))]
        #[schemars(with = "Vec<[SamplePart; 2]>")]
        samples: Vec<[f64; 2]>,
    },
}

/// The actions that a radio can take.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum Library {
    /// A library with a name.
    Named(NamedLibrary),
    /// Carriers and pulse durations.
    Listed(#[schemars(length(min = 1, max = 40))] Vec<Action>),
}

/// Libraries with a name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum NamedLibrary {
    /// 6.00 to 7.95 GHz in 40 steps of 50 MHz, 0.5 ns.
    Published,
    /// 5.0 to 8.9 GHz in 40 steps of 100 MHz, 0.5 ns.
    Wide,
    /// Channels 1, 2, 3 and 5 of 2 ns, 4 and 7 limited to 900 MHz.
    Dw1000,
    /// Channels 5 and 9.
    Dw3000,
    /// Channels 5, 6, 8 and 9 of IEEE 802.15.4 HRP.
    HrpEurope,
}

/// A carrier and a pulse duration.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Action {
    /// Carrier frequency, hertz.
    #[schemars(range(min = 1e9, max = 3e10))]
    pub carrier_hz: f64,
    /// Duration of the pulse, seconds.
    #[schemars(range(min = 1e-10, max = 1e-8))]
    pub pulse_duration_s: f64,
}

/// Which action each cycle of a recording uses.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Schedule {
    /// The first action throughout.
    #[default]
    Fixed,
    /// The library in order, again and again, from the first action on.
    Sweep,
    /// Drawn anew in every cycle.
    Random,
}

/// How the samples of a frame lie in time: exactly one of the keys.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Window {
    /// Every frame starts at this delay after transmission (the sounder: 0).
    Absolute {
        /// Delay of sample 0, seconds.
        #[schemars(range(min = -1e-5, max = 1e-5))]
        first_sample_delay_s: f64,
    },
    /// The receiver places the first path near this sample, on a grid of its own (DW1000, DW3000: 740); the delay of
    /// sample 0 is known as well as `errors.timestamp_std_s` says.
    FirstPath {
        /// Index of the sample.
        #[schemars(range(min = 0, max = 4095))]
        sample: usize,
    },
}

/// An analogue-to-digital converter.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Converter {
    /// Bits per real sample, the sign among them.
    #[schemars(range(min = 2, max = 24))]
    pub bits: u32,
    /// Where gain control puts the largest part of a sample, as a share of full scale; above 1 clips.
    #[serde(default = "defaults::level")]
    #[schemars(range(min = 1e-3, max = 10.0))]
    pub level: f64,
}

/// What a radio logs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Log {
    /// Complex samples.
    #[default]
    Complex,
    /// Magnitudes only.
    Magnitude,
}

/// White noise.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Noise {
    /// Power of a direct path of 1 m at 7 GHz, isotropic antennas, over the noise after the matched filter, decibels.
    #[schemars(range(min = -50.0, max = 200.0))]
    pub snr_at_1_m_db: f64,
}

impl Default for Noise {
    fn default() -> Self {
        Self { snr_at_1_m_db: 40.0 }
    }
}

/// The room's dense multipath: everything too small and too many to be a path.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct DenseMultipath {
    /// Its energy Omega_1 over that of a direct path of 1 m, at 7 GHz, decibels; -300 is none.
    #[schemars(range(min = -300.0, max = 60.0))]
    pub omega_1_db: f64,
    /// Its power over the delay, from the direct path's delay on.
    pub profile: Profile,
    /// How it changes from place to place.
    pub fading: Fading,
}

impl Default for DenseMultipath {
    fn default() -> Self {
        Self { omega_1_db: -17.0, profile: Profile::default(), fading: Fading::Correlated }
    }
}

/// Soft-onset power delay profile (Karedal): (1 - chi exp(-t / rise)) exp(-t / decay).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Profile {
    /// Rise time, seconds.
    #[schemars(range(min = 1e-11, max = 1e-6))]
    pub rise_s: f64,
    /// Decay time, seconds.
    #[schemars(range(min = 1e-10, max = 1e-6))]
    pub decay_s: f64,
    /// Depth of the onset.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub chi: f64,
}

impl Default for Profile {
    fn default() -> Self {
        Self { rise_s: 5e-9, decay_s: 20e-9, chi: 0.98 }
    }
}

/// How dense multipath changes from place to place.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Fading {
    /// Waves from fixed scatterers all around: neighbouring places and carriers see similar multipath.
    #[default]
    Correlated,
    /// Drawn anew for every frame.
    Independent,
}

/// Dense multipath of an interferer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Interference {
    /// Its carrier, hertz.
    #[serde(default = "defaults::interferer_hz")]
    #[schemars(range(min = 1e9, max = 3e10))]
    pub carrier_hz: f64,
    /// Duration of its pulse, seconds; its bandwidth is the inverse.
    #[serde(default = "defaults::interferer_pulse_s")]
    #[schemars(range(min = 1e-10, max = 1e-8))]
    pub pulse_duration_s: f64,
    /// Roll-off of its spectrum.
    #[serde(default = "defaults::roll_off")]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub roll_off: f64,
    /// The part of the way on which it is on, as shares from 0 to 1.
    #[serde(default)]
    pub during: Part,
    /// Its strength.
    pub strength: Strength,
    /// Its power over the delay.
    #[serde(default)]
    pub profile: Profile,
    /// Where its profile begins after the direct path, seconds.
    #[serde(default)]
    #[schemars(range(min = -1e-6, max = 1e-6))]
    pub onset_s: f64,
    /// How it changes from place to place.
    #[serde(default)]
    pub fading: Fading,
    /// Names of the anchors that it reaches; an empty list means all.
    #[serde(default)]
    pub anchors: Vec<String>,
}

impl Interference {
    /// An interferer of this strength that is 2 GHz wide at 7 GHz, on all the way, everything else by default.
    pub fn of(strength: Strength) -> Self {
        Self {
            carrier_hz: defaults::interferer_hz(),
            pulse_duration_s: defaults::interferer_pulse_s(),
            roll_off: defaults::roll_off(),
            during: Part::default(),
            strength,
            profile: Profile::default(),
            onset_s: 0.0,
            fading: Fading::default(),
            anchors: Vec::new(),
        }
    }
}

/// Strength of an interferer: exactly one of the keys.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Strength {
    /// Its energy Omega_1 as a power gain; 1.1615e-8 is 30 dB below a direct path of 1 m at 7 GHz.
    #[serde(rename = "omega_1")]
    Omega1(#[schemars(range(min = 0.0, max = 1e3))] f64),
    /// The median SINR, decibels, that it leaves to the paths of the anchors it reaches, at the library's entry nearest
    /// to its carrier, on its part of the way; paths that are below 4.8 dB without it do not count.
    MedianSinrDb(#[schemars(range(min = -40.0, max = 80.0))] f64),
}

/// A part of the way, from and to, as shares: 0 is the first cycle, 1 the end.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(transparent)]
pub struct Part(#[schemars(with = "[Share; 2]")] pub [f64; 2]);

impl Default for Part {
    fn default() -> Self {
        Self([0.0, 1.0])
    }
}

/// Paths weakened on a part of the way.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Obstruction {
    /// The part of the way.
    pub during: Part,
    /// Names of the anchors concerned; an empty list means all.
    #[serde(default)]
    pub anchors: Vec<String>,
    /// Which paths.
    #[serde(default)]
    pub paths: ObstructedPaths,
    /// Power lost, decibels.
    #[schemars(range(min = 0.0, max = 300.0))]
    pub loss_db: f64,
    /// Detour added to the path, metres.
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 100.0))]
    pub excess_m: f64,
}

/// Which paths an obstruction weakens.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ObstructedPaths {
    /// The direct path.
    #[default]
    Direct,
    /// All paths of the anchor.
    All,
}

/// A person: an upright screen as wide as they are, always facing the path, with diffraction at both edges.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Person {
    /// Where they walk, there and back again, metres; a single point stands still.
    #[schemars(length(min = 1, max = 1000))]
    #[schemars(with = "Vec<[Coordinate; 2]>")]
    pub way_m: Vec<Position>,
    /// How fast, m/s.
    #[serde(default = "defaults::speed_m_s")]
    #[schemars(range(min = 0.001, max = 100.0))]
    pub speed_m_s: f64,
    /// How wide they are, metres.
    #[serde(default = "defaults::person_width_m")]
    #[schemars(range(min = 0.01, max = 2.0))]
    pub width_m: f64,
}

/// Frames that never arrive.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LostFrames {
    /// Probability that a frame is lost.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub probability: f64,
    /// Parts of the way without any frame.
    #[schemars(length(max = 64))]
    pub gaps: Vec<Part>,
}

/// Errors of clock and calibration. They shift paths in the samples, not in the truth.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Errors {
    /// Offset of the tag's clock, common to all anchors, seconds.
    #[schemars(range(min = -1e-6, max = 1e-6))]
    pub clock_offset_s: f64,
    /// How the offset grows, seconds per second.
    #[schemars(range(min = -1e-6, max = 1e-6))]
    pub clock_drift: f64,
    /// Standard deviation of each frame's time stamp, seconds.
    #[schemars(range(min = 0.0, max = 1e-7))]
    pub timestamp_std_s: f64,
}

/// What a tracker is told before it starts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Prior {
    /// Standard deviation of an acceleration per axis that is constant within a usual cycle, m/s^2: of the density of its
    /// square times that cycle's length.
    #[schemars(range(min = 1e-6, max = 100.0))]
    pub acceleration_std_m_s2: f64,
    /// Spectral density of the white acceleration per axis, m^2/s^3, in place of `acceleration_std_m_s2`.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 1e-12, max = 1e4))]
    pub acceleration_density_m2_s3: Option<f64>,
    /// Time constant with which a velocity decays to zero, seconds; `inf`: constant velocity, as published. Without it, the
    /// tracker's own.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.1))]
    pub velocity_decay_s: Option<f64>,
    /// Mean of the first position, metres; without it, drawn in the disc about the true one.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<[Coordinate; 2]>")]
    pub position_m: Option<Position>,
    /// Standard deviation of the first position per axis, metres.
    #[schemars(range(min = 1e-3, max = 1e3))]
    pub position_std_m: f64,
    /// Standard deviation of the first velocity per axis, m/s.
    #[schemars(range(min = 1e-3, max = 1e3))]
    pub velocity_std_m_s: f64,
    /// A run with a seed draws its start inside a disc of this radius, metres: around that mean, or around the true
    /// first position where no mean is given.
    #[schemars(range(min = 1e-3, max = 1e3))]
    pub disc_radius_m: f64,
    /// Probability that the path of a visible source is found.
    #[schemars(range(min = 0.01, max = 1.0))]
    pub detection_probability: f64,
    /// Mean number of false paths per anchor and cycle.
    #[schemars(range(min = 0.0, max = 100.0))]
    pub clutter_per_anchor: f64,
    /// Paths longer than this are not looked for, metres.
    #[schemars(range(min = 1.0, max = 10_000.0))]
    pub max_range_m: f64,
    /// Prior standard deviation of a range bias that all ranges of an anchor share, metres; 0: none is estimated.
    #[schemars(range(min = 0.0, max = 10.0))]
    pub range_bias_std_m: f64,
    /// Standard deviation that no path's range goes below, pulse lengths: what unresolved paths do that nobody expects. Without
    /// it, the tracker's own; 0 in the published experiments, which know all paths.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub range_floor_pulses: Option<f64>,
    /// The floor plan.
    pub floor_plan: FloorPlan,
}

impl Default for Prior {
    fn default() -> Self {
        Self {
            acceleration_std_m_s2: 0.01,
            acceleration_density_m2_s3: None,
            velocity_decay_s: None,
            position_m: None,
            position_std_m: 0.25,
            velocity_std_m_s: 0.03,
            disc_radius_m: 0.5,
            detection_probability: 0.8,
            clutter_per_anchor: 0.1,
            max_range_m: 30.0,
            range_bias_std_m: 0.0,
            range_floor_pulses: None,
            floor_plan: FloorPlan::default(),
        }
    }
}

/// What a tracker is told of the floor plan.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct FloorPlan {
    /// Whether it is told of any.
    pub known: bool,
    /// Whether every wall, or every virtual anchor, is told just where the plan has it; otherwise off by its standard
    /// deviation.
    pub exact: bool,
    /// What the virtual anchors that it is told follow from.
    pub told: Told,
    /// Standard deviation of the offset of a wall along its normal, metres; without it, half of `first_order_std_m`.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0, max = 100.0))]
    pub wall_offset_std_m: Option<f64>,
    /// Standard deviation of the rotation of a wall about its centre, degrees.
    #[schemars(range(min = 0.0, max = 45.0))]
    pub wall_rotation_std_deg: f64,
    /// Standard deviation of the angle by which the plan as a whole may be turned, degrees.
    #[schemars(range(min = 0.0, max = 45.0))]
    pub turn_std_deg: f64,
    /// Standard deviation of virtual anchors of first order per axis, metres, where each has an error of its own.
    #[schemars(range(min = 1e-4, max = 100.0))]
    pub first_order_std_m: f64,
    /// The same for higher orders.
    #[schemars(range(min = 1e-4, max = 100.0))]
    pub higher_order_std_m: f64,
    /// The most virtual anchors that it is told of: the most useful ones over the outline, or, where each has an error of
    /// its own, those with the highest mean SINR along the way.
    #[schemars(range(min = 0, max = 24))]
    pub max_virtual_anchors: usize,
    /// The plan that it is told instead of the truth, for wrong ones.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub room: Option<Room>,
}

impl Default for FloorPlan {
    fn default() -> Self {
        Self {
            known: true,
            exact: false,
            told: Told::Walls,
            wall_offset_std_m: None,
            wall_rotation_std_deg: 0.5,
            turn_std_deg: USUAL_TURN_STD_DEG,
            first_order_std_m: 0.1,
            higher_order_std_m: 0.2,
            max_virtual_anchors: 24,
            room: None,
        }
    }
}

impl FloorPlan {
    /// Standard deviation of the offset of a wall along its normal, metres.
    pub fn wall_offset_std_m(&self) -> f64 {
        self.wall_offset_std_m.unwrap_or(0.5 * self.first_order_std_m)
    }
}

/// What the virtual anchors that a tracker is told follow from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Told {
    /// The plan's walls and the anchors: an error per wall, which all images in it share.
    #[default]
    Walls,
    /// The true way, as in the published experiments: the strongest along it, each with an error of its own.
    VirtualAnchors,
}

/// Defaults of single keys.
mod defaults {
    pub(super) fn seed() -> u64 {
        1
    }
    pub(super) fn construction() -> String {
        "concrete".into()
    }
    pub(super) fn height_m() -> f64 {
        1.5
    }
    pub(super) fn period_s() -> f64 {
        1.0
    }
    pub(super) fn speed_m_s() -> f64 {
        1.0
    }
    pub(super) fn level() -> f64 {
        0.5
    }
    pub(super) fn interferer_hz() -> f64 {
        7e9
    }
    pub(super) fn interferer_pulse_s() -> f64 {
        0.5e-9
    }
    pub(super) fn roll_off() -> f64 {
        0.6
    }
    pub(super) fn person_width_m() -> f64 {
        0.5
    }
}
