//! A legal case: configuration, plan, scans and frames that the firmware's image has room for, drawn from a seed alone.
//!
//! The seed is a row of bit fields: what is drawn how ([`FIELDS`]), and the state of the random numbers. So a seed
//! re-creates its case, and a search may change one field of it and keep the rest.

use cogmint::recording::{
    Action, Anchor, AssociationModel, Cycle, Frame, Motion, Plan, PlanWall, Radio, Range, Recording, Samples,
    Start, VirtualAnchor,
};
use cogmint::replay::{ACTIONS, PATHS, SOURCES, TARGET_SURFACES};
use cogmint_core::radio::pulse::{Pulse, SUPPORT};
use rand_core::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro128PlusPlus;

/// What a seed says, with the number of bits for each. Their sum stays below 53, so that every seed is a number of JSON.
const FIELDS: [(Field, u32); 26] = [
    (Field::Randomness, 13),
    (Field::Anchors, 1),
    (Field::Told, 2),
    (Field::ToldOf, 2),
    (Field::ToldStd, 2),
    (Field::StartStd, 3),
    (Field::Speed, 1),
    (Field::Reach, 2),
    (Field::Acceleration, 1),
    (Field::Delivered, 2),
    (Field::RangeCount, 2),
    (Field::RangeStd, 3),
    (Field::RangePlaces, 2),
    (Field::Clutter, 2),
    (Field::Detection, 2),
    (Field::Jump, 1),
    (Field::Step, 1),
    (Field::Bias, 1),
    (Field::Height, 1),
    (Field::Actions, 1),
    (Field::FrameSamples, 1),
    (Field::Magnitudes, 1),
    (Field::FramePaths, 1),
    (Field::GainControl, 1),
    (Field::Cycles, 2),
    (Field::Pulses, 1),
];

/// Seeds are below this.
pub const SEEDS: u64 = 1 << 52;

#[derive(Clone, Copy, PartialEq, Eq)]
enum Field {
    Randomness,
    Anchors,
    Told,
    ToldOf,
    ToldStd,
    StartStd,
    Speed,
    Reach,
    Acceleration,
    Delivered,
    RangeCount,
    RangeStd,
    RangePlaces,
    Clutter,
    Detection,
    Jump,
    Step,
    Bias,
    Height,
    Actions,
    FrameSamples,
    Magnitudes,
    FramePaths,
    GainControl,
    Cycles,
    /// Whether actions have pulses of their own.
    Pulses,
}

/// Value of a field in a seed.
fn value(seed: u64, field: Field) -> usize {
    let mut shift = 0;
    for (own, bits) in FIELDS {
        if own == field {
            return (seed >> shift & ((1 << bits) - 1)) as usize;
        }
        shift += bits;
    }
    unreachable!("every field is listed")
}

/// The seed with one field, the `which`-th, replaced by the lowest bits of `by`.
pub fn with_field(seed: u64, which: usize, by: u64) -> u64 {
    let which = which % FIELDS.len();
    let shift: u32 = FIELDS[..which].iter().map(|(_, bits)| bits).sum();
    let mask = ((1 << FIELDS[which].1) - 1) << shift;
    seed & !mask | by << shift & mask
}

/// Number of fields of a seed.
pub const FIELD_COUNT: usize = FIELDS.len();

/// One of the choices that a field of a seed selects among.
fn pick<T: Copy>(seed: u64, field: Field, choices: &[T]) -> T {
    choices[value(seed, field) % choices.len()]
}

/// Random numbers, a stream of its own for every purpose.
struct Draw(Xoshiro128PlusPlus);

impl Draw {
    fn new(seed: u64, purpose: u64) -> Self {
        let stream = value(seed, Field::Randomness) as u64 | purpose << 32;
        Self(Xoshiro128PlusPlus::seed_from_u64(stream))
    }

    fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (f64::from(self.0.next_u32()) + 0.5) / 4_294_967_296.0
    }

    fn normal(&mut self) -> f64 {
        (-2.0 * self.uniform(0.0, 1.0).ln()).sqrt() * (std::f64::consts::TAU * self.uniform(0.0, 1.0)).cos()
    }

    fn place_m(&mut self, extent_m: f64) -> [f64; 2] {
        [self.uniform(0.0, extent_m), self.uniform(0.0, extent_m)]
    }
}

/// What an anchor delivers.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Delivered {
    Ranges,
    Frames,
    Both,
    /// One kind and the other in turn.
    Alternating,
}

/// How the ranges of a scan are chosen.
#[derive(Clone, Copy, PartialEq, Eq)]
enum RangePlaces {
    /// Of the anchor's direct path and virtual anchors, in order, then anywhere.
    Sources,
    /// Half of them of sources, half anywhere.
    Half,
    Anywhere,
    /// All near the direct path's.
    Crowded,
}

/// The recording of a seed, in the terms of the host: at most two anchors, 8 surfaces, 16 ranges per anchor, and
/// frames of at most 1024 samples.
pub fn recording(seed: u64) -> Recording {
    let reach_m = pick(seed, Field::Reach, &[15.0, 30.0, 100.0, 1000.0]);
    let extent_m = reach_m / 4.0;
    let anchors = 1 + value(seed, Field::Anchors);
    let height_known = value(seed, Field::Height) == 1;
    let mut places = Draw::new(seed, 0);
    let anchors_m: Vec<[f64; 2]> = (0..anchors).map(|_| places.place_m(extent_m)).collect();
    let start_m = places.place_m(extent_m);
    let told = pick(seed, Field::Told, &[Some(0), Some(TARGET_SURFACES / 2), Some(TARGET_SURFACES), None]);
    let virtual_anchors: Vec<VirtualAnchor> = (0..told.unwrap_or(0))
        .map(|index| {
            let anchor = match value(seed, Field::ToldOf) {
                0 => 0,
                1 => anchors - 1,
                _ => index % anchors,
            };
            let [x, y] = places.place_m(3.0 * extent_m);
            let std_m = pick(seed, Field::ToldStd, &[0.01, 0.1, 1.0, 30.0]);
            VirtualAnchor::new(anchor, [x - extent_m, y - extent_m], std_m, true)
        })
        .collect();
    let pulse_s = 0.5e-9;
    let pulses_s = pick(seed, Field::Pulses, &[[pulse_s; 2], [pulse_s, 1.1 * pulse_s]]);
    let actions = pick(seed, Field::Actions, &[1, ACTIONS]);
    let bias_std_m = pick(seed, Field::Bias, &[0.0, 0.5]);
    let mut recording = Recording {
        name: format!("case {seed}"),
        source: "drawn to be hard".into(),
        motion: Motion::of_acceleration(pick(seed, Field::Acceleration, &[0.01, 3.0])),
        start: Start {
            position_m: start_m,
            position_std_m: pick(seed, Field::StartStd, &[0.25, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0]),
            velocity_std_m_s: pick(seed, Field::Speed, &[0.03, 3.0]),
            disc_radius_m: None,
            drawn_about_m: None,
        },
        association: AssociationModel {
            detection_probability: pick(seed, Field::Detection, &[0.05, 0.5, 0.95, 0.999]),
            clutter_per_anchor: pick(seed, Field::Clutter, &[1e-3, 1.0, 10.0, 100.0]),
            max_range_m: reach_m,
        },
        radio: Radio {
            pulse_duration_s: pulse_s,
            roll_off: 0.6,
            sampled_pulse: None,
            sample_spacing_s: Some(0.5 * pulse_s),
            gain_control: value(seed, Field::GainControl) == 1,
            begins_with_path: value(seed, Field::GainControl) == 1,
            range_std_m: pick(seed, Field::RangeStd, &[1e-3, 0.01, 0.03, 0.1, 0.3, 1.0, 10.0, 100.0]),
            range_bias_mean_m: 0.0,
            range_bias_std_m: bias_std_m,
            range_late_m: 0.0,
            range_floor_pulses: None,
        },
        anchors: anchors_m
            .iter()
            .enumerate()
            .map(|(index, position_m)| Anchor::new(format!("{index}"), *position_m, 2.5))
            .collect(),
        virtual_anchors,
        actions: (0..actions)
            .map(|n| Action {
                carrier_hz: 6e9 + 50e6 * n as f64,
                pulse_duration_s: pulses_s[n % pulses_s.len()],
            })
            .collect(),
        walls: Vec::new(),
        plan: told.is_none().then(|| plan(extent_m)),
        antennas: Vec::new(),
        cycles: Vec::new(),
    };
    let cycles = pick(seed, Field::Cycles, &[1, 2, 6, 16]);
    let step_s = pick(seed, Field::Step, &[0.1, 10.0]);
    let speed_m_s = recording.start.velocity_std_m_s * places.normal();
    let mut position_m = start_m;
    for cycle in 0..cycles {
        let moved_m = (speed_m_s * step_s).clamp(-extent_m / 8.0, extent_m / 8.0);
        position_m[0] += moved_m;
        if value(seed, Field::Jump) == 1 && cycle == cycles / 2 {
            position_m = places.place_m(extent_m);
        }
        let cycle = scan(seed, &recording, cycle, position_m, step_s);
        recording.cycles.push(Cycle { tag_height_m: height_known.then_some(1.0), ..cycle });
    }
    recording
}

/// One cycle of a case at a place of the tag.
fn scan(seed: u64, recording: &Recording, number: usize, position_m: [f64; 2], step_s: f64) -> Cycle {
    let mut cycle = Cycle { time_s: number as f64 * step_s, ..Cycle::default() };
    let delivered = pick(
        seed,
        Field::Delivered,
        &[Delivered::Ranges, Delivered::Frames, Delivered::Both, Delivered::Alternating],
    );
    let (ranged, framed) = match delivered {
        Delivered::Ranges => (true, false),
        Delivered::Frames => (false, true),
        Delivered::Both => (true, true),
        Delivered::Alternating => (number.is_multiple_of(2), !number.is_multiple_of(2)),
    };
    for anchor in 0..recording.anchors.len() {
        // A stream per cycle and anchor: what one delivers does not depend on how much the others did.
        let mut draw = Draw::new(seed, (1 + number as u64) << 4 | anchor as u64);
        let sources = distances_m(recording, anchor, position_m);
        if ranged {
            cycle.ranges.extend(ranges(seed, recording, anchor, &sources, &mut draw));
        }
        if framed {
            cycle.frames.push(frame(seed, recording, anchor, number, &sources, &mut draw));
        }
    }
    cycle
}

/// As many walls as the image has surfaces: a square of this side and two more walls each way, with as many sources as it has room
/// for.
fn plan(side_m: f64) -> Plan {
    let wall = |from_m: [f64; 2], to_m: [f64; 2]| PlanWall {
        segments_m: vec![[from_m, to_m]],
        offset_std_m: 0.1,
        rotation_std_rad: 0.01,
        construction: "concrete".into(),
    };
    let shares = (0..TARGET_SURFACES / 2).map(|n| n as f64 / (TARGET_SURFACES / 2 - 1) as f64);
    let across = shares.flat_map(|share| {
        let (at_m, end_m) = (share * side_m, if share.fract() == 0.0 { side_m } else { 0.6 * side_m });
        [wall([at_m, 0.0], [at_m, end_m]), wall([0.0, at_m], [end_m, at_m])]
    });
    Plan {
        outline_m: vec![[0.0, 0.0], [side_m, 0.0], [side_m, side_m], [0.0, side_m]],
        turn_std_rad: 0.0,
        reflections: 2,
        most_sources: SOURCES,
        walls: across.collect(),
    }
}

/// Distances from a place to an anchor and its virtual anchors or images over one wall, metres, the anchor first.
fn distances_m(recording: &Recording, anchor: usize, [x, y]: [f64; 2]) -> Vec<f64> {
    let [ax, ay] = recording.anchors[anchor].position_m;
    let images = recording.virtual_anchors.iter().filter(|va| va.anchor == anchor).map(|va| va.position_m);
    let walls = recording.plan.iter().flat_map(|plan| &plan.walls).map(|wall| {
        let ([nx, ny], [[wx, wy], _]) = (wall.normal(), wall.segments_m[0]);
        let away_m = nx * (ax - wx) + ny * (ay - wy);
        [ax - 2.0 * away_m * nx, ay - 2.0 * away_m * ny]
    });
    std::iter::once([ax, ay]).chain(images).chain(walls).map(|[sx, sy]| (x - sx).hypot(y - sy)).collect()
}

fn ranges(seed: u64, recording: &Recording, anchor: usize, sources_m: &[f64], draw: &mut Draw) -> Vec<Range> {
    let reach_m = recording.association.max_range_m;
    let std_m = recording.radio.range_std_m;
    let places = pick(
        seed,
        Field::RangePlaces,
        &[RangePlaces::Sources, RangePlaces::Half, RangePlaces::Anywhere, RangePlaces::Crowded],
    );
    let count = pick(seed, Field::RangeCount, &[4, 8, 12, PATHS]);
    let bias_m = recording.radio.range_bias_std_m;
    (0..count)
        .map(|index| {
            let anywhere_m = draw.uniform(0.0, reach_m);
            let noise_m = std_m * draw.normal();
            let exact_m = match places {
                RangePlaces::Sources => sources_m.get(index).copied(),
                RangePlaces::Half => sources_m.get(index / 2).filter(|_| index % 2 == 0).copied(),
                RangePlaces::Anywhere => None,
                RangePlaces::Crowded => sources_m.first().map(|direct| direct + 0.5 * std_m * index as f64),
            };
            let range_m = exact_m.map_or(anywhere_m, |exact| exact + bias_m + noise_m);
            // Within what the core takes, at the precision of its numbers.
            Range {
                anchor,
                range_m: range_m.clamp(1e-3 * reach_m, 0.999 * reach_m),
                std_m: None,
                angles: None,
            }
        })
        .collect()
}

fn frame(
    seed: u64,
    recording: &Recording,
    anchor: usize,
    number: usize,
    sources_m: &[f64],
    draw: &mut Draw,
) -> Frame {
    /// Metres per second.
    const LIGHT: f64 = 299_792_458.0;
    let radio = &recording.radio;
    let spacing_s = radio.sample_spacing_s.unwrap_or(radio.pulse_duration_s);
    let samples = pick(seed, Field::FrameSamples, &[400, 1024]);
    let pulse = Pulse::root_raised_cosine(radio.pulse_duration_s as f32, radio.roll_off as f32)
        .sampled_every(spacing_s as f32);
    let length_s = samples as f64 * spacing_s;
    let dense = pick(seed, Field::FramePaths, &[0, 40]);
    let delays_s: Vec<f64> = sources_m
        .iter()
        .map(|m| m / LIGHT)
        .chain((0..dense).map(|_| draw.uniform(0.0, length_s)))
        .filter(|delay| *delay < length_s)
        .collect();
    let mut complex = vec![[0.0_f64; 2]; samples];
    for sample in &mut complex {
        *sample = [draw.normal(), draw.normal()];
    }
    for delay_s in delays_s {
        // From hidden in the noise to 40 dB over it.
        let amplitude = 10_f64.powf(draw.uniform(0.0, 2.0));
        let (sin, cos) = draw.uniform(0.0, std::f64::consts::TAU).sin_cos();
        // Beyond its support the pulse is nothing.
        let reach_s = SUPPORT as f64 * radio.pulse_duration_s;
        let first = ((delay_s - reach_s) / spacing_s).max(0.0) as usize;
        let count = (2.0 * reach_s / spacing_s) as usize + 2;
        for (index, [re, im]) in complex.iter_mut().enumerate().skip(first).take(count) {
            let lag = (index as f64 * spacing_s - delay_s) / radio.pulse_duration_s;
            let r = amplitude * f64::from(pulse.autocorrelation(lag as f32));
            *re += r * cos;
            *im += r * sin;
        }
    }
    let samples = if value(seed, Field::Magnitudes) == 1 {
        Samples::Magnitude(complex.iter().map(|[re, im]| re.hypot(*im) as f32).collect())
    } else {
        Samples::Complex(complex.iter().map(|[re, im]| [*re as f32, *im as f32]).collect())
    };
    Frame {
        anchor,
        action: (number + anchor) % recording.actions.len(),
        first_sample_delay_s: 0.0,
        first_path_index: None,
        line_of_sight: None,
        samples,
    }
}
