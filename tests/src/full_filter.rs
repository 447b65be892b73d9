//! The state filter's problem at full size, in two forms. A tag walks a loop between two physical anchors and 24 virtual
//! ones; every anchor is heard at every step: 26 ranges. As published, each virtual anchor is a private surface: 52 states.
//! With a plan, they are images in 8 walls, to the second order: 20 states.

use cogmint_core::model::image::Sequence;
use cogmint_core::model::motion::Motion;
use cogmint_core::model::source::{Sight, Source};
use cogmint_core::model::surface::{Line, Surface};
use cogmint_core::nalgebra::Vector2;
use cogmint_core::perceptor::association::outcome::Innovation;
use cogmint_core::perceptor::state_filter::StateFilter;
use cogmint_core::trace::TraceHash;
use rand_core::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro128PlusPlus;

/// Physical anchors.
pub const ANCHORS: usize = 2;
/// Virtual anchors.
pub const VAS: usize = 24;
/// Walls of the form with a plan.
pub const WALLS: usize = 8;
/// As published: the tag's position and velocity, and the virtual anchors.
pub const STATES: usize = 4 + 2 * VAS;
/// One per anchor of either kind.
pub const RANGES: usize = ANCHORS + VAS;
/// Seconds between steps.
pub const STEP_S: f32 = 0.1;
/// Reach of the radio, metres.
pub const REACH_M: f32 = 30.0;
/// How the tag moves.
pub const MOTION: Motion = Motion {
    acceleration_density_m2_s3: 0.3,
    velocity_decay_s: f32::INFINITY,
    virtual_anchor_walk_m_sqrt_s: 1e-4,
};
/// Where the physical anchors stand, metres.
pub const ANCHORS_M: [[f32; 2]; ANCHORS] = [[0.5, 7.0], [5.2, 3.2]];
/// Standard deviations at the start: position, velocity, coordinates of the virtual anchors.
pub const PRIOR_STD: [f32; 3] = [0.1, 0.3, 0.03];
/// Standard deviations of a wall at the start: offset (metres) and rotation (radians).
pub const WALL_STD: [f32; 2] = [0.07, 0.0087];
/// Standard deviation of every range, metres.
pub const RANGE_STD_M: f32 = 0.03;

/// The walls as told, by their centres and normals: of a room, and of four pieces in it.
const LINES: [([f64; 2], [f64; 2]); WALLS] = [
    ([3.0, 0.0], [0.0, 1.0]),
    ([7.0, 5.0], [-1.0, 0.0]),
    ([3.0, 10.0], [0.0, -1.0]),
    ([-1.0, 5.0], [1.0, 0.0]),
    ([5.8, 8.7], [-0.6, -0.8]),
    ([0.2, 1.1], [0.8, 0.6]),
    ([3.0, 1.2], [-0.28, 0.96]),
    ([6.3, 6.0], [-0.96, 0.28]),
];
/// Walls that reflect one after the other, of both anchors alike.
const PAIRS: [[u8; 2]; 4] = [[0, 1], [1, 2], [2, 4], [3, 6]];

/// A surface as a filter is told of it.
#[derive(Clone, Copy, Debug)]
pub struct Told {
    /// What it is.
    pub surface: Surface,
    /// Its two numbers.
    pub state: [f32; 2],
    /// Their standard deviations.
    pub std: [f32; 2],
}

/// What a filter is given.
pub struct Problem {
    /// Where the tag is thought to start, metres.
    pub start_m: [f32; 2],
    /// The surfaces, by slot.
    pub surfaces: Vec<Told>,
    /// The virtual anchors: of which anchor, and in which surfaces.
    pub images: Vec<(usize, Sequence)>,
    /// The ranges of every step, metres: physical anchors first.
    pub ranges_m: Vec<[f32; RANGES]>,
    /// Where the tag is after every step, metres.
    pub truth_m: Vec<[f64; 2]>,
    /// What the surfaces' numbers are in truth.
    pub true_states: Vec<[f64; 2]>,
}

struct Noise(Xoshiro128PlusPlus);

impl Noise {
    fn uniform(&mut self) -> f64 {
        (f64::from(self.0.next_u32()) + 0.5) / 4_294_967_296.0
    }

    fn normal(&mut self) -> f64 {
        (-2.0 * self.uniform().ln()).sqrt() * (std::f64::consts::TAU * self.uniform()).cos()
    }

    fn around(&mut self, place: [f64; 2], std: f32) -> [f32; 2] {
        place.map(|coordinate| (coordinate + f64::from(std) * self.normal()) as f32)
    }
}

/// Where the tag is at a time, metres.
fn way(t: f64) -> [f64; 2] {
    [3.0 + (0.3 * t).sin(), 6.0 + (0.3 * t).cos()]
}

/// The mirror image of a point in a wall that is shifted and turned.
fn mirrored(
    point: [f64; 2],
    ([cx, cy], [nx, ny]): ([f64; 2], [f64; 2]),
    [offset, turn]: [f64; 2],
) -> [f64; 2] {
    let theta = 2.0 * (0.5 * turn).atan();
    let [ux, uy] = [nx * theta.cos() - ny * theta.sin(), ny * theta.cos() + nx * theta.sin()];
    let away = ux * (point[0] - cx) + uy * (point[1] - cy) - offset;
    [point[0] - 2.0 * away * ux, point[1] - 2.0 * away * uy]
}

impl Problem {
    /// The published form over so many steps.
    pub fn published(steps: usize) -> Self {
        let mut noise = Noise(Xoshiro128PlusPlus::seed_from_u64(52));
        let places: [[f64; 2]; VAS] =
            std::array::from_fn(|_| [30.0 * noise.uniform() - 12.0, 30.0 * noise.uniform() - 10.0]);
        let [position_std_m, _, image_std_m] = PRIOR_STD;
        let start_m = noise.around(way(0.0), position_std_m);
        let surfaces = places.map(|place| Told {
            surface: Surface::Private,
            state: noise.around(place, image_std_m),
            std: [image_std_m; 2],
        });
        let images = (0..VAS).map(|slot| (slot % ANCHORS, Sequence::of(slot as u8))).collect();
        Self::walked(steps, noise, start_m, surfaces.to_vec(), images, places.to_vec(), places.to_vec())
    }

    /// The form with a plan over so many steps.
    pub fn walls(steps: usize) -> Self {
        let mut noise = Noise(Xoshiro128PlusPlus::seed_from_u64(20));
        let true_states: Vec<[f64; 2]> =
            (0..WALLS).map(|_| WALL_STD.map(|std| f64::from(std) * noise.normal())).collect();
        let start_m = noise.around(way(0.0), PRIOR_STD[0]);
        let line = |([x, y], [u, v]): ([f64; 2], [f64; 2])| Line {
            centre_m: [x as f32, y as f32],
            normal: [u as f32, v as f32],
        };
        let told = |wall| Told { surface: Surface::Wall(line(wall)), state: [0.0; 2], std: WALL_STD };
        let sequences = (0..WALLS as u8).map(Sequence::of).chain(PAIRS.map(|[first, second]| Sequence {
            first,
            second: Some(second),
            is_either_order: false,
        }));
        let images: Vec<(usize, Sequence)> =
            sequences.flat_map(|sequence| (0..ANCHORS).map(move |anchor| (anchor, sequence))).collect();
        let place = |(anchor, sequence): &(usize, Sequence)| {
            let anchor_m = ANCHORS_M[*anchor].map(f64::from);
            sequence.surfaces().fold(anchor_m, |point, wall| mirrored(point, LINES[wall], true_states[wall]))
        };
        let places = images.iter().map(place).collect();
        Self::walked(steps, noise, start_m, LINES.map(told).to_vec(), images, places, true_states)
    }

    /// With the ranges to the images at these places.
    fn walked(
        steps: usize,
        mut noise: Noise,
        start_m: [f32; 2],
        surfaces: Vec<Told>,
        images: Vec<(usize, Sequence)>,
        places: Vec<[f64; 2]>,
        true_states: Vec<[f64; 2]>,
    ) -> Self {
        let mut ranges_m = Vec::new();
        let mut truth_m = Vec::new();
        for step in 1..=steps {
            let [x, y] = way(step as f64 * f64::from(STEP_S));
            let mut ranges = [0.0; RANGES];
            let anchors = ANCHORS_M.iter().map(|anchor| anchor.map(f64::from)).chain(places.iter().copied());
            for (range, [ax, ay]) in ranges.iter_mut().zip(anchors) {
                *range = ((x - ax).hypot(y - ay) + f64::from(RANGE_STD_M) * noise.normal()) as f32;
            }
            ranges_m.push(ranges);
            truth_m.push([x, y]);
        }
        Self { start_m, surfaces, images, ranges_m, truth_m, true_states }
    }

    /// The problem in little-endian 32-bit words, as the firmware's `filter` reads it: `COGF`; steps; surfaces; motion
    /// (four words); start; deviations of position and velocity; anchors; per surface whether it is a wall, centre, normal
    /// (0 for a private one), its two numbers and their deviations; per virtual anchor its anchor, first and second surface
    /// (counted from 1; 0 where there is none); variance of a range; seconds per step; then the ranges of every step.
    pub fn feed(&self) -> Vec<u8> {
        let mut feed = b"COGF".to_vec();
        let count = |feed: &mut Vec<u8>, count: usize| feed.extend((count as u32).to_le_bytes());
        let floats = |feed: &mut Vec<u8>, floats: &[f32]| {
            feed.extend(floats.iter().copied().flat_map(f32::to_le_bytes));
        };
        count(&mut feed, self.ranges_m.len());
        count(&mut feed, self.surfaces.len());
        let [position, velocity, _] = PRIOR_STD;
        floats(
            &mut feed,
            &[
                MOTION.acceleration_density_m2_s3,
                MOTION.velocity_decay_s,
                MOTION.virtual_anchor_walk_m_sqrt_s,
                REACH_M,
            ],
        );
        floats(&mut feed, &self.start_m);
        floats(&mut feed, &[position, velocity]);
        floats(&mut feed, ANCHORS_M.as_flattened());
        for Told { surface, state, std } in &self.surfaces {
            let (is_wall, line) = match surface {
                Surface::Private => (0, Line { centre_m: [0.0; 2], normal: [0.0; 2] }),
                Surface::Wall(line) => (1, *line),
                Surface::Heading { .. } => unreachable!("no heading is told"),
            };
            count(&mut feed, is_wall);
            [line.centre_m, line.normal, *state, *std].iter().for_each(|pair| floats(&mut feed, pair));
        }
        for (anchor, sequence) in &self.images {
            count(&mut feed, *anchor);
            count(&mut feed, usize::from(sequence.first) + 1);
            count(&mut feed, sequence.second.map_or(0, |second| usize::from(second) + 1));
        }
        floats(&mut feed, &[RANGE_STD_M * RANGE_STD_M, STEP_S]);
        floats(&mut feed, self.ranges_m.as_flattened());
        feed
    }

    /// The core's filter at the start.
    pub fn filter<const SURFACES: usize>(&self) -> StateFilter<ANCHORS, SURFACES> {
        let [position, velocity, _] = PRIOR_STD;
        let mut filter = StateFilter::new(MOTION, REACH_M, self.start_m, position, velocity, 0.0, 0.0);
        for (slot, Told { surface, state: [x, y], std }) in self.surfaces.iter().enumerate() {
            assert!(
                filter.insert_independent(slot, *surface, Vector2::new(*x, *y), *std),
                "slot {slot} is free"
            );
        }
        filter
    }

    /// One step of the core's filter: prediction, all regressions, all updates.
    pub fn step<const SURFACES: usize>(
        &self,
        filter: &mut StateFilter<ANCHORS, SURFACES>,
        ranges_m: &[f32; RANGES],
    ) {
        filter.predict(STEP_S);
        let mut lines = [None; RANGES];
        let direct = (0..ANCHORS).map(|anchor| (Source::Direct { anchor }, None));
        let images = self.images.iter().enumerate();
        let images = images
            .map(|(slot, (anchor, sequence))| (Source::Virtual { anchor: *anchor, slot }, Some(sequence)));
        for (line, (source, sequence)) in lines.iter_mut().zip(direct.chain(images)) {
            let anchor_m = ANCHORS_M[source.anchor()];
            *line = filter.regress(
                source,
                &Sight { anchor_m, height_m: 0.0, height_std_m: 0.0, lever_arm_m: [0.0; 2] },
                sequence,
            );
        }
        filter.update(lines.into_iter().flatten().zip(ranges_m).map(|(regression, range_m)| {
            let nu = range_m - regression.range_m;
            let variance_m2 = RANGE_STD_M * RANGE_STD_M;
            Innovation::hard(regression, nu, variance_m2)
        }));
    }

    /// Hash over all bits of the filter of so many surfaces after every step.
    pub fn hashes<const SURFACES: usize>(&self) -> Vec<u64> {
        let mut filter = self.filter::<SURFACES>();
        let after = |ranges_m: &[f32; RANGES]| {
            self.step(&mut filter, ranges_m);
            let mut hash = TraceHash::default();
            filter.visit(|value| hash.float(value));
            hash.value()
        };
        self.ranges_m.iter().map(after).collect()
    }
}
