//! Random rooms: scenarios that nobody tuned for, each drawn from its seed alone.
//!
//! Every aspect of a room (floor plan, constructions, anchors, radio, rate, way, levels, what is told, what disturbs) has
//! a random stream of its own: restricting what may be drawn of one leaves the others as they are. `docs/rooms.md` lists
//! what is drawn with which probability. No room is rejected for being hard.

mod defect;
mod draws;
mod free_space;
mod incident;
mod layout;
mod way;

use crate::channel::{REFERENCE_HZ, SPEED_OF_LIGHT_M_S, friis, power_of};
use crate::geometry::{Wall, distance_m};
use crate::input_error::InputError;
use crate::recording::USUAL_TURN_STD_DEG;
use crate::scenario::{
    self, Anchor, Antenna, DenseMultipath, Errors, FORMAT, Fading, FloorPlan, Interference, Library, Log,
    LostFrames, NamedLibrary, Noise, ObstructedPaths, Obstruction, Part, Pattern, Person, Position, Prior,
    Profile, Propagation, Radio, RadioKind, Scenario, Strength, Tag,
};
use draws::{Aspect, Draws, centimetres, rounded};
use free_space::FreeSpace;
use serde::Serialize;
use std::collections::BTreeMap;

pub use defect::Defect;
pub use incident::Incident;
pub use layout::Family;
pub use way::Motion;

/// What a tracker is told of the floor plan.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub enum Plan {
    /// As it is.
    #[serde(rename = "exact")]
    Exact,
    /// Images of first order good to 0.1 m: walls off by 0.05 m and turned by 0.5 degrees.
    #[serde(rename = "0.1")]
    Within01,
    /// Images of first order good to 0.3 m: walls off by 0.15 m and turned by 1 degree.
    #[serde(rename = "0.3")]
    Within03,
    /// As `0.1`, but one wall is a metre off, turned by 2 to 4 degrees, or missing, and nobody says so.
    #[serde(rename = "wrong")]
    Wrong,
    /// As `0.1`, but turned as a whole by 2 degrees, and nobody says so. Never drawn unless it is asked for.
    #[serde(rename = "turned")]
    Turned,
    /// Nothing.
    #[serde(rename = "none")]
    None,
}

impl Plan {
    /// All of them.
    pub const ALL: [Plan; 6] =
        [Plan::Exact, Plan::Within01, Plan::Within03, Plan::Wrong, Plan::Turned, Plan::None];
    /// Those that are drawn where nothing else is asked for.
    pub const DRAWN: [Plan; 5] = [Plan::Exact, Plan::Within01, Plan::Within03, Plan::Wrong, Plan::None];

    /// Its name on the command line and in tables.
    pub fn name(self) -> &'static str {
        match self {
            Plan::Exact => "exact",
            Plan::Within01 => "0.1",
            Plan::Within03 => "0.3",
            Plan::Wrong => "wrong",
            Plan::Turned => "turned",
            Plan::None => "none",
        }
    }
}

/// What a tracker is told of the tag's first position.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub enum Start {
    /// Within a disc of 0.25 m.
    #[serde(rename = "0.25")]
    Quarter,
    /// Within a disc of 1 m.
    #[serde(rename = "1")]
    Metre,
    /// Nothing but the size of the plan's outline.
    #[serde(rename = "anywhere")]
    Anywhere,
}

impl Start {
    /// All of them.
    pub const ALL: [Start; 3] = [Start::Quarter, Start::Metre, Start::Anywhere];

    /// Its name on the command line and in tables.
    pub fn name(self) -> &'static str {
        match self {
            Start::Quarter => "0.25",
            Start::Metre => "1",
            Start::Anywhere => "anywhere",
        }
    }
}

/// What an interferer does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Disturbance {
    /// There is none.
    None,
    /// On at one carrier for a large part of the way.
    Standing,
    /// On at one carrier again and again.
    Bursting,
    /// At one carrier of the library after the other.
    Moving,
}

impl Disturbance {
    /// All of them.
    pub const ALL: [Disturbance; 4] =
        [Disturbance::None, Disturbance::Standing, Disturbance::Bursting, Disturbance::Moving];

    /// Its name on the command line and in tables.
    pub fn name(self) -> &'static str {
        match self {
            Disturbance::None => "none",
            Disturbance::Standing => "standing",
            Disturbance::Bursting => "bursting",
            Disturbance::Moving => "moving",
        }
    }
}

/// The radio of a room and what it logs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Receiver {
    /// A channel sounder, complex samples.
    Sounder,
    /// A DW1000, complex samples.
    Dw1000,
    /// A DW1000 that logs magnitudes.
    Dw1000Magnitude,
    /// A DW3000, complex samples.
    Dw3000,
    /// A DW3000 that logs magnitudes.
    Dw3000Magnitude,
}

impl Receiver {
    const WEIGHTS: [(Receiver, f64); 5] = [
        (Receiver::Sounder, 0.4),
        (Receiver::Dw1000, 0.15),
        (Receiver::Dw1000Magnitude, 0.15),
        (Receiver::Dw3000, 0.2),
        (Receiver::Dw3000Magnitude, 0.1),
    ];

    /// Its name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Receiver::Sounder => "sounder",
            Receiver::Dw1000 => "dw1000",
            Receiver::Dw1000Magnitude => "dw1000-magnitude",
            Receiver::Dw3000 => "dw3000",
            Receiver::Dw3000Magnitude => "dw3000-magnitude",
        }
    }
}

/// What may be drawn; an empty list allows all.
#[derive(Clone, Debug, Default)]
pub struct Restriction {
    /// Kinds of floor plan.
    pub families: Vec<Family>,
    /// What is told of the floor plan.
    pub plans: Vec<Plan>,
    /// What is told of the first position.
    pub starts: Vec<Start>,
    /// What interferers do.
    pub interference: Vec<Disturbance>,
    /// Numbers of anchors, 1 to 8; a list without any of them allows all as well.
    pub anchors: Vec<usize>,
}

/// What was drawn.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Drawn {
    /// The seed that all of it follows from.
    pub seed: u64,
    /// The kind of floor plan.
    pub family: Family,
    /// Number of walls.
    pub walls: usize,
    /// Number of anchors.
    pub anchors: usize,
    /// The radio.
    pub radio: Receiver,
    /// Cycles per second.
    pub rate_hz: f64,
    /// Number of cycles.
    pub cycles: usize,
    /// How the tag moves.
    pub motion: Motion,
    /// Power of a direct path of 1 m over the noise, decibels.
    pub snr_at_1_m_db: f64,
    /// Energy of the dense multipath over that of a direct path of 1 m, decibels.
    pub dense_multipath_db: f64,
    /// What is told of the floor plan.
    pub plan: Plan,
    /// What is told of the first position.
    pub start: Start,
    /// What the interferer does.
    pub interference: Disturbance,
    /// Number of anchors whose direct path is obstructed on a part of the way.
    pub obstructed: usize,
    /// Number of people.
    pub people: usize,
    /// Probability that a frame is lost.
    pub lost_frames: f64,
}

/// A random room.
#[derive(Clone, Debug)]
pub struct RandomRoom {
    /// The room as an ordinary scenario, with one trajectory and the room's seed.
    pub scenario: Scenario,
    /// What was drawn.
    pub drawn: Drawn,
}

/// The room of a seed.
///
/// # Errors
/// Never for a seed below 2^53; a scenario file holds no larger one.
pub fn room(seed: u64, restriction: &Restriction) -> Result<RandomRoom, InputError> {
    let family = {
        let allowed = all_or(&restriction.families, &Family::ALL);
        Draws::new(seed, Aspect::Family).one_of(allowed)
    };
    let layout = layout::layout(seed, family);
    let room = layout.room;
    let wall = |(ends_m, _): &([Position; 2], &str)| Wall { ends_m: *ends_m, construction: 0 };
    let walls: Vec<Wall> = scenario::walls(&room).iter().map(wall).collect();
    let space = FreeSpace::new(&room.corners_m, walls);
    let extent = Extent::of(&room.corners_m);

    let tag = tag(seed);
    let anchors =
        anchors(seed, &restriction.anchors, &space, &extent, &room.corners_m, layout.ceiling_m, tag.height_m);
    let receiver = Draws::new(seed, Aspect::Receiver).weighted(&Receiver::WEIGHTS);
    let radio = radio(seed, receiver, &extent);
    let is_sounder = receiver == Receiver::Sounder;
    let rate_hz = rounded(Draws::new(seed, Aspect::Rate).log_uniform(1.0, 50.0), 1);
    let period_s = rounded(1.0 / rate_hz, 4);
    let (trajectory, motion) = way::way(seed, &space, period_s);

    let mut levels = Draws::new(seed, Aspect::Levels);
    let snr_at_1_m_db = rounded(levels.uniform(SNR_AT_1_M_DB[0], SNR_AT_1_M_DB[1]), 1);
    let dense_multipath_db = rounded(levels.uniform(DENSE_MULTIPATH_DB[0], DENSE_MULTIPATH_DB[1]), 1);
    // Energy decays in the time that a wave takes for half to twice the room's diagonal.
    let decay_s = levels.uniform(0.5, 2.0) * extent.diagonal_m() / SPEED_OF_LIGHT_M_S;
    let profile = Profile {
        rise_s: rounded(levels.uniform(1.0, 8.0), 1) * 1e-9,
        decay_s: rounded(1e9 * decay_s, 1) * 1e-9,
        chi: rounded(levels.uniform(0.9, 1.0), 2),
    };
    let transmissions = levels.weighted(&[(0, 1.0), (1, 2.0), (2, 2.0), (3, 1.0)]);

    let plan = {
        let allowed = all_or(&restriction.plans, &Plan::DRAWN);
        let weight = |&plan: &Plan| (plan, if plan == Plan::Within01 { 2.0 } else { 1.0 });
        let weighted: Vec<(Plan, f64)> = allowed.iter().map(weight).collect();
        Draws::new(seed, Aspect::Plan).weighted(&weighted)
    };
    let start = Draws::new(seed, Aspect::Start).one_of(all_or(&restriction.starts, &Start::ALL));
    let disturbance = {
        let allowed = all_or(&restriction.interference, &Disturbance::ALL);
        let weight = |&kind: &Disturbance| (kind, if kind == Disturbance::None { 3.0 } else { 1.0 });
        let weighted: Vec<(Disturbance, f64)> = allowed.iter().map(weight).collect();
        Draws::new(seed, Aspect::Interference).weighted(&weighted)
    };
    let people = people(seed, &space);
    let obstructions = obstructions(seed, &anchors);
    let lost_frames = losses(seed);
    let floor_plan = told_plan(seed, plan, &room);
    // The deviation of an acceleration that is constant during a cycle has the density of the motion.
    let acceleration_std_m_s2 = (motion.acceleration_density_m2_s3() / period_s).sqrt();
    let (position_m, position_std_m, disc_radius_m) = match start {
        Start::Quarter => (None, 0.125, 0.25),
        Start::Metre => (None, 0.5, 1.0),
        Start::Anywhere => {
            (Some(extent.centre_m()), centimetres(extent.deviation_m()), 0.5 * extent.diagonal_m())
        }
    };
    let prior = Prior {
        acceleration_std_m_s2: rounded(acceleration_std_m_s2, 3),
        acceleration_density_m2_s3: None,
        velocity_decay_s: None,
        position_m,
        position_std_m,
        velocity_std_m_s: 0.7,
        disc_radius_m: centimetres(disc_radius_m),
        detection_probability: if is_sounder { 0.7 } else { 0.6 },
        clutter_per_anchor: 0.1,
        max_range_m: libm::ceil(extent.longest_path_m()),
        range_bias_std_m: if is_sounder { 0.0 } else { 0.1 },
        range_floor_pulses: None,
        floor_plan,
    };
    let drawn = Drawn {
        seed,
        family,
        walls: space.walls().len(),
        anchors: anchors.len(),
        radio: receiver,
        rate_hz,
        cycles: trajectory.cycles.unwrap_or(0),
        motion,
        snr_at_1_m_db,
        dense_multipath_db,
        plan,
        start,
        interference: disturbance,
        obstructed: obstructions.len(),
        people: people.len(),
        lost_frames: lost_frames.probability,
    };
    let interference = interferers(seed, disturbance, &radio, snr_at_1_m_db);
    // Anchors of a product are calibrated to some centimetres.
    let mut bias = Draws::new(seed, Aspect::Biases);
    let anchors = anchors
        .into_iter()
        .map(|anchor| Anchor {
            range_bias_m: if is_sounder { 0.0 } else { rounded(bias.normal(0.05), 3) },
            ..anchor
        })
        .collect();
    let scenario = Scenario {
        format: FORMAT,
        name: format!("Random room {seed}: {}", family.name()),
        description: format!(
            "Drawn by cogmint from seed {seed}: {}, {} told, start {}, interference {}.",
            receiver.name(),
            plan.name(),
            start.name(),
            disturbance.name()
        ),
        seed,
        room,
        materials: BTreeMap::new(),
        constructions: BTreeMap::new(),
        propagation: Propagation { reflection_order: 2, transmissions, ..Propagation::default() },
        anchors,
        tag,
        trajectories: vec![trajectory],
        radio,
        noise: Noise { snr_at_1_m_db },
        dense_multipath: DenseMultipath {
            omega_1_db: dense_multipath_db,
            profile,
            fading: Fading::Correlated,
        },
        interference,
        obstructions,
        people,
        lost_frames,
        errors: Errors { timestamp_std_s: if is_sounder { 0.0 } else { 0.15e-9 }, ..Errors::default() },
        prior,
    };
    scenario.check(&scenario.name)?;
    Ok(RandomRoom { scenario, drawn })
}

/// Power of a direct path of 1 m over the noise, decibels: from poor to rich.
const SNR_AT_1_M_DB: [f64; 2] = [40.0, 70.0];
/// Energy of dense multipath over that of a direct path of 1 m, decibels.
const DENSE_MULTIPATH_DB: [f64; 2] = [-40.0, -18.0];

fn all_or<'a, T>(allowed: &'a [T], all: &'a [T]) -> &'a [T] {
    if allowed.is_empty() { all } else { allowed }
}

/// The box around a floor plan.
struct Extent {
    low_m: Position,
    high_m: Position,
}

impl Extent {
    fn of(corners_m: &[Position]) -> Self {
        let fold = |from: f64, pick: fn(f64, f64) -> f64| {
            std::array::from_fn(|axis| corners_m.iter().map(|corner| corner[axis]).fold(from, pick))
        };
        Self { low_m: fold(f64::INFINITY, f64::min), high_m: fold(f64::NEG_INFINITY, f64::max) }
    }

    fn diagonal_m(&self) -> f64 {
        distance_m(self.low_m, self.high_m)
    }

    fn centre_m(&self) -> Position {
        std::array::from_fn(|axis| centimetres(0.5 * (self.low_m[axis] + self.high_m[axis])))
    }

    /// Root mean square over both axes of the deviation of a place that is uniform over the box.
    fn deviation_m(&self) -> f64 {
        self.diagonal_m() / 24f64.sqrt()
    }

    /// Paths of two reflections are hardly longer than this.
    fn longest_path_m(&self) -> f64 {
        1.8 * self.diagonal_m() + 3.0
    }
}

fn tag(seed: u64) -> Tag {
    let mut draws = Draws::new(seed, Aspect::Tag);
    let pattern = draws.weighted(&[(Pattern::Isotropic, 1.0), (Pattern::Dipole, 1.0)]);
    Tag {
        height_m: draws.length_m(0.9, 1.5),
        height_std_m: 0.0,
        antenna: Antenna { pattern, ..Antenna::default() },
    }
}

/// Numbers of anchors: half of the rooms have at most two.
const ANCHOR_COUNTS: [(usize, f64); 8] =
    [(1, 5.0), (2, 5.0), (3, 3.0), (4, 3.0), (5, 1.0), (6, 1.0), (7, 1.0), (8, 1.0)];

/// 1 to 8 anchors, half of the rooms with at most two, mounted beside walls and away from each other.
#[allow(clippy::too_many_arguments)] // each is a part of the room
fn anchors(
    seed: u64,
    allowed: &[usize],
    space: &FreeSpace,
    extent: &Extent,
    corners_m: &[Position],
    ceiling_m: f64,
    tag_height_m: f64,
) -> Vec<Anchor> {
    let mut draws = Draws::new(seed, Aspect::Anchors);
    let counts = ANCHOR_COUNTS.iter().copied();
    let counts: Vec<(usize, f64)> =
        counts.filter(|(count, _)| allowed.is_empty() || allowed.contains(count)).collect();
    let count = draws.weighted(if counts.is_empty() { &ANCHOR_COUNTS } else { &counts });
    let pattern = draws.weighted(&[(Pattern::Isotropic, 1.0), (Pattern::Dipole, 1.0), (Pattern::Patch, 1.0)]);
    let ripple = if draws.chance(0.5) { draws.uniform(0.05, 0.3) } else { 0.0 };
    let is_high = draws.chance(0.75);
    let mut anchors: Vec<Anchor> = Vec::new();
    for index in 0..count {
        // The best of three places: farthest from the anchors so far.
        let away = |place: &Position| {
            let others = anchors.iter().map(|anchor| distance_m(anchor.position_m, *place));
            others.fold(f64::INFINITY, f64::min)
        };
        let candidates: Vec<Position> = (0..if index == 0 { 1 } else { 3 })
            .map(|_| {
                space.place_beside_a_wall(&mut draws, corners_m).unwrap_or_else(|| space.place(&mut draws))
            })
            .collect();
        let best = candidates.iter().copied().max_by(|a, b| away(a).total_cmp(&away(b)));
        let position_m = best.unwrap_or_else(|| space.place(&mut draws));
        // Under the ceiling, or on furniture; in a stairwell anywhere between.
        let height_m = if ceiling_m > 5.0 && draws.chance(0.5) {
            draws.length_m(tag_height_m, ceiling_m - 0.3)
        } else if is_high {
            draws.length_m(2.0, ceiling_m.min(6.0) - 0.2)
        } else {
            draws.length_m(0.8, 1.8)
        };
        let [x, y] = extent.centre_m();
        let towards = libm::atan2(y - position_m[1], x - position_m[0]) * 180.0 / std::f64::consts::PI;
        let boresight_deg = rounded(towards + draws.uniform(-30.0, 30.0), 0);
        let antenna = Antenna {
            pattern,
            boresight_deg,
            gain_dbi: if pattern == Pattern::Patch { 5.0 } else { 0.0 },
            ripple: rounded(ripple, 2),
            ..Antenna::default()
        };
        anchors.push(Anchor {
            name: format!("a{}", index + 1),
            position_m,
            height_m,
            antenna,
            range_bias_m: 0.0,
        });
    }
    anchors
}

fn radio(seed: u64, receiver: Receiver, extent: &Extent) -> Radio {
    let mut draws = Draws::new(seed, Aspect::Radio);
    let is_first = draws.chance(0.5);
    let (kind, library, log) = match receiver {
        Receiver::Sounder if is_first => (RadioKind::Sounder, NamedLibrary::Published, Log::Complex),
        Receiver::Sounder => (RadioKind::Sounder, NamedLibrary::Wide, Log::Complex),
        Receiver::Dw1000 => (RadioKind::Dw1000, NamedLibrary::Dw1000, Log::Complex),
        Receiver::Dw1000Magnitude => (RadioKind::Dw1000, NamedLibrary::Dw1000, Log::Magnitude),
        Receiver::Dw3000 if is_first => (RadioKind::Dw3000, NamedLibrary::Dw3000, Log::Complex),
        Receiver::Dw3000 => (RadioKind::Dw3000, NamedLibrary::HrpEurope, Log::Complex),
        Receiver::Dw3000Magnitude => (RadioKind::Dw3000, NamedLibrary::Dw3000, Log::Magnitude),
    };
    let mut radio = Radio { kind, library: Some(Library::Named(library)), log, ..Radio::default() };
    if receiver == Receiver::Sounder {
        // A sounder's frame begins at delay 0 and must hold the longest path.
        let samples = extent.longest_path_m() / SPEED_OF_LIGHT_M_S / 0.25e-9;
        radio.samples = Some((libm::ceil(samples / 100.0) as usize * 100).clamp(200, 1000));
    } else {
        radio.first_action = Some(draws.below(radio.actions().len()));
    }
    radio
}

fn people(seed: u64, space: &FreeSpace) -> Vec<Person> {
    let mut draws = Draws::new(seed, Aspect::People);
    if draws.chance(0.5) {
        return Vec::new();
    }
    let count = draws.count(1, 4);
    (0..count)
        .map(|_| {
            let mut way_m = vec![space.place(&mut draws)];
            for _ in 0..draws.count(1, 4) {
                let goal_m = space.place(&mut draws);
                way_m.extend(space.way(way_m[way_m.len() - 1], goal_m));
            }
            Person { way_m, speed_m_s: rounded(draws.uniform(0.5, 1.4), 2), width_m: 0.5 }
        })
        .collect()
}

/// What stands in the way of direct paths and is in no plan: of 25 % of the anchors, on 30 to 70 % of the way.
fn obstructions(seed: u64, anchors: &[Anchor]) -> Vec<Obstruction> {
    let mut draws = Draws::new(seed, Aspect::Obstructions);
    let mut obstructions = Vec::new();
    for anchor in anchors {
        let is_obstructed = draws.chance(0.25);
        let share = draws.uniform(0.3, 0.7);
        let from = draws.uniform(0.0, 1.0 - share);
        let loss_db = rounded(draws.uniform(10.0, 30.0), 1);
        if is_obstructed {
            obstructions.push(Obstruction {
                during: Part([rounded(from, 3), rounded(from + share, 3)]),
                anchors: vec![anchor.name.clone()],
                paths: ObstructedPaths::Direct,
                loss_db,
                excess_m: 0.0,
            });
        }
    }
    obstructions
}

fn losses(seed: u64) -> LostFrames {
    let mut draws = Draws::new(seed, Aspect::Losses);
    let probability = if draws.chance(0.5) { rounded(draws.uniform(0.01, 0.2), 2) } else { 0.0 };
    let gaps = if draws.chance(1.0 / 6.0) {
        let from = rounded(draws.uniform(0.2, 0.8), 3);
        vec![Part([from, rounded(from + draws.uniform(0.02, 0.1), 3)])]
    } else {
        Vec::new()
    };
    LostFrames { probability, gaps }
}

/// Decay of an interferer's profile, and how long before the direct path it begins, seconds: noise-like within a frame.
const INTERFERER_DECAY_S: f64 = 1e-6;
const INTERFERER_LEAD_S: f64 = 0.5e-6;

/// The energy of an interferer, as a gain of power, that leaves `over_noise_db` over the white noise to a receiver whose
/// pulse shares 1 ns with it.
fn interferer_omega_1(over_noise_db: f64, snr_at_1_m_db: f64) -> f64 {
    let density_per_s = libm::exp(-INTERFERER_LEAD_S / INTERFERER_DECAY_S) / INTERFERER_DECAY_S;
    let over_noise = power_of(over_noise_db) / (density_per_s * 1e-9);
    over_noise / power_of(snr_at_1_m_db) * friis(1.0, REFERENCE_HZ)
}

/// Noise-like interference: it begins before every frame.
fn interferers(seed: u64, disturbance: Disturbance, radio: &Radio, snr_at_1_m_db: f64) -> Vec<Interference> {
    let mut draws = Draws::new(seed, Aspect::Interferers);
    let actions = radio.actions();
    let own_hz = actions[radio.first_action()].carrier_hz;
    let carriers: Vec<f64> = actions.iter().map(|action| action.carrier_hz).collect();
    // Half of them are just where the tag is.
    let carrier_hz = if draws.chance(0.5) { own_hz } else { draws.one_of(&carriers) };
    let omega_1 = interferer_omega_1(draws.uniform(3.0, 25.0), snr_at_1_m_db);
    let pulse_duration_s = draws.one_of(&[2e-9, 1e-9]);
    let of = |carrier_hz: f64, from: f64, to: f64| Interference {
        carrier_hz,
        pulse_duration_s,
        roll_off: 0.5,
        during: Part([rounded(from, 3), rounded(to, 3)]),
        onset_s: -INTERFERER_LEAD_S,
        fading: Fading::Independent,
        profile: Profile { rise_s: 1e-11, decay_s: INTERFERER_DECAY_S, chi: 0.0 },
        ..Interference::of(Strength::Omega1(omega_1))
    };
    match disturbance {
        Disturbance::None => Vec::new(),
        Disturbance::Standing => {
            let from = draws.uniform(0.05, 0.5);
            vec![of(carrier_hz, from, from + draws.uniform(0.25, 0.5))]
        }
        Disturbance::Bursting => {
            let count = draws.count(4, 10);
            let pitch = 0.9 / count as f64;
            let share = draws.uniform(0.3, 0.7);
            let burst = |index: usize| {
                let from = 0.05 + pitch * index as f64;
                of(carrier_hz, from, from + share * pitch)
            };
            (0..count).map(burst).collect()
        }
        Disturbance::Moving => {
            let count = draws.count(4, 8);
            let pitch = 0.9 / count as f64;
            let stay = |index: usize| {
                let carrier_hz = if index.is_multiple_of(2) { own_hz } else { draws.one_of(&carriers) };
                let from = 0.05 + pitch * index as f64;
                of(carrier_hz, from, from + pitch)
            };
            (0..count).map(stay).collect()
        }
    }
}

/// How far a wrong plan has a wall from where it is, metres, and how much it may be turned, degrees.
const WRONG_OFFSET_M: f64 = 1.0;
const WRONG_TURN_DEG: [f64; 2] = [2.0, 4.0];
/// By how much a plan that is turned is turned, degrees.
const TURNED_DEG: f64 = 2.0;

/// What is told of the floor plan, with walls drawn wrong where they are to be.
fn told_plan(seed: u64, plan: Plan, room: &scenario::Room) -> FloorPlan {
    let told = |first_order_std_m: f64, offset_std_m: f64, rotation_std_deg: f64| FloorPlan {
        first_order_std_m,
        higher_order_std_m: 2.0 * first_order_std_m,
        wall_offset_std_m: Some(offset_std_m),
        wall_rotation_std_deg: rotation_std_deg,
        turn_std_deg: USUAL_TURN_STD_DEG,
        ..FloorPlan::default()
    };
    match plan {
        // A deviation of zero is not allowed; nothing is drawn from it.
        Plan::Exact => FloorPlan { exact: true, ..told(0.01, 0.005, 0.05) },
        Plan::Within01 => told(0.1, 0.05, 0.5),
        Plan::Within03 => told(0.3, 0.15, 1.0),
        Plan::Wrong => FloorPlan { room: Some(wrong_room(seed, room)), ..told(0.1, 0.05, 0.5) },
        Plan::Turned => FloorPlan { room: Some(turned_room(seed, room)), ..told(0.1, 0.05, 0.5) },
        Plan::None => FloorPlan { known: false, ..FloorPlan::default() },
    }
}

/// The room turned about the middle of its box, to either side.
fn turned_room(seed: u64, room: &scenario::Room) -> scenario::Room {
    let side = if Draws::new(seed, Aspect::WrongPlan).chance(0.5) { 1.0 } else { -1.0 };
    let (sin, cos) = libm::sincos((side * TURNED_DEG).to_radians());
    let middle_m: [f64; 2] = std::array::from_fn(|axis| {
        let along = room.corners_m.iter().map(|corner| corner[axis]);
        0.5 * (along.clone().fold(f64::INFINITY, f64::min) + along.fold(f64::NEG_INFINITY, f64::max))
    });
    let turned = |point_m: &mut Position| {
        let [x, y] = [point_m[0] - middle_m[0], point_m[1] - middle_m[1]];
        *point_m = [middle_m[0] + cos * x - sin * y, middle_m[1] + sin * x + cos * y].map(|x| rounded(x, 4));
    };
    let mut room = room.clone();
    room.corners_m.iter_mut().for_each(turned);
    for wall in &mut room.inner_walls {
        turned(&mut wall.from_m);
        turned(&mut wall.to_m);
    }
    room
}

/// The room with one wall shifted, turned or missing. Sides are never missing: a plan has an outline.
fn wrong_room(seed: u64, room: &scenario::Room) -> scenario::Room {
    let mut draws = Draws::new(seed, Aspect::WrongPlan);
    let sides = room.corners_m.len();
    loop {
        let mut wrong = room.clone();
        let wall = draws.below(sides + room.inner_walls.len());
        let [from_m, to_m] = scenario::walls(room)[wall].0;
        let length_m = distance_m(from_m, to_m);
        let normal = [(from_m[1] - to_m[1]) / length_m, (to_m[0] - from_m[0]) / length_m];
        let sign = if draws.chance(0.5) { 1.0 } else { -1.0 };
        let turn = draws.uniform(WRONG_TURN_DEG[0], WRONG_TURN_DEG[1]) * std::f64::consts::PI / 180.0;
        let is_inner = wall >= sides;
        // How far each end moves along the normal.
        let moves_m = match draws.below(if is_inner { 3 } else { 2 }) {
            0 => [sign * WRONG_OFFSET_M; 2],
            1 => [-0.5, 0.5].map(|share| sign * share * length_m * turn),
            _ => {
                wrong.inner_walls.remove(wall - sides);
                return wrong;
            }
        };
        let moved = |end_m: Position, by_m: f64| -> Position {
            std::array::from_fn(|axis| rounded(end_m[axis] + by_m * normal[axis], 3))
        };
        let (from_m, to_m) = (moved(from_m, moves_m[0]), moved(to_m, moves_m[1]));
        if is_inner {
            let inner = &mut wrong.inner_walls[wall - sides];
            (inner.from_m, inner.to_m) = (from_m, to_m);
        } else {
            (wrong.corners_m[wall], wrong.corners_m[(wall + 1) % sides]) = (from_m, to_m);
        }
        // Some walls cannot move without a floor plan that is none.
        if wrong.is_sound() {
            return wrong;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cogmint_core::trace::TraceHash;

    fn drawn(seed: u64, restriction: &Restriction) -> RandomRoom {
        room(seed, restriction).unwrap_or_else(|error| panic!("seed {seed}: {error}"))
    }

    /// The rooms are a yardstick: figures of different builds are only comparable where they are the same rooms.
    #[test]
    fn the_scenario_files_of_seeds_1_to_20_are_these() {
        let mut hash = TraceHash::default();
        for seed in 1..=20 {
            let text = drawn(seed, &Restriction::default()).scenario.to_toml().expect("is TOML");
            text.bytes().for_each(|byte| hash.word(u32::from(byte)));
        }
        assert_eq!(hash.value(), 0xc431_b363_74b7_05d2, "{:#018x}", hash.value());
    }

    #[test]
    fn a_room_read_from_its_file_is_the_room() {
        for seed in 1..=7 {
            let RandomRoom { scenario, .. } = drawn(seed, &Restriction::default());
            let text = scenario.to_toml().expect("is TOML");
            assert_eq!(Scenario::parse(&text, "room.toml").expect("is valid"), scenario);
        }
    }

    #[test]
    fn draws_have_the_shares_that_are_documented() {
        const ROOMS: u64 = 420;
        let rooms: Vec<Drawn> = (1..=ROOMS).map(|seed| drawn(seed, &Restriction::default()).drawn).collect();
        // Within four deviations of a binomial share.
        let assert_share = |what: &str, expected: f64, is: &dyn Fn(&Drawn) -> bool| {
            let share = rooms.iter().filter(|drawn| is(drawn)).count() as f64 / ROOMS as f64;
            let margin = 4.0 * (expected * (1.0 - expected) / ROOMS as f64).sqrt();
            assert!((share - expected).abs() < margin, "{what}: {share} instead of {expected}");
        };
        for family in Family::ALL {
            assert_share(family.name(), 1.0 / 7.0, &|drawn| drawn.family == family);
        }
        assert_share("at most two anchors", 0.5, &|drawn| drawn.anchors <= 2);
        assert_share("one anchor", 0.25, &|drawn| drawn.anchors == 1);
        assert_share("plan within 0.1 m", 1.0 / 3.0, &|drawn| drawn.plan == Plan::Within01);
        assert_share("start anywhere", 1.0 / 3.0, &|drawn| drawn.start == Start::Anywhere);
        assert_share("no interference", 0.5, &|drawn| drawn.interference == Disturbance::None);
        assert_share("sounder", 0.4, &|drawn| drawn.radio == Receiver::Sounder);
        let library = |seed: u64| drawn(seed, &Restriction::default()).scenario.radio.library;
        for (radio, first) in
            [(Receiver::Sounder, NamedLibrary::Published), (Receiver::Dw3000, NamedLibrary::Dw3000)]
        {
            let of_radio: Vec<&Drawn> = rooms.iter().filter(|drawn| drawn.radio == radio).collect();
            let named = Some(Library::Named(first));
            let firsts = of_radio.iter().filter(|drawn| library(drawn.seed) == named).count();
            let margin = 4.0 * (0.25 * of_radio.len() as f64).sqrt();
            assert!(
                (firsts as f64 - 0.5 * of_radio.len() as f64).abs() < margin,
                "{firsts} of {}",
                of_radio.len()
            );
        }
        assert_share("people", 0.5, &|drawn| drawn.people > 0);
        assert_share("lost frames", 0.5, &|drawn| drawn.lost_frames > 0.0);
        assert!(rooms.iter().all(|drawn| (300..=600).contains(&drawn.cycles)));
        assert!(rooms.iter().all(|drawn| (1.0..=50.0).contains(&drawn.rate_hz)));
    }

    #[test]
    fn restricting_one_draw_leaves_the_others() {
        let restriction = Restriction { plans: vec![Plan::None], ..Restriction::default() };
        for seed in 1..=20 {
            let (all, restricted) = (drawn(seed, &Restriction::default()), drawn(seed, &restriction));
            assert_eq!(restricted.drawn, Drawn { plan: Plan::None, ..all.drawn });
            let prior = Prior {
                floor_plan: FloorPlan { known: false, ..FloorPlan::default() },
                ..all.scenario.prior
            };
            let description = restricted.scenario.description.clone();
            assert_eq!(restricted.scenario, Scenario { prior, description, ..all.scenario });
        }
    }

    #[test]
    fn a_wrong_plan_differs_in_one_wall() {
        let restriction = Restriction { plans: vec![Plan::Wrong], ..Restriction::default() };
        for seed in 1..=40 {
            let RandomRoom { scenario, .. } = drawn(seed, &restriction);
            let wrong = scenario.prior.floor_plan.room.clone().expect("is told another room");
            let (right, wrong_walls) = (scenario::walls(&scenario.room), scenario::walls(&wrong));
            if wrong_walls.len() == right.len() {
                // A side that moves takes the ends of its neighbours along.
                let moved = right.iter().zip(&wrong_walls).filter(|(a, b)| a.0 != b.0).count();
                assert!((1..=3).contains(&moved), "seed {seed}: {moved} walls moved");
            } else {
                assert_eq!(wrong_walls.len() + 1, right.len());
            }
        }
    }
}
