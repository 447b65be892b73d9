//! The state filter's problem at full size: 52 states, 26 ranges per step. A tag walks a loop between two physical
//! anchors and 24 virtual ones; every anchor is heard at every step.

use cogmint_core::model::motion::Motion;
use cogmint_core::model::source::{Sight, Source};
use cogmint_core::perceptor::association::outcome::Innovation;
use cogmint_core::perceptor::state_filter::StateFilter;
use cogmint_core::trace::TraceHash;
use rand_core::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro128PlusPlus;

/// Physical anchors.
pub const ANCHORS: usize = 2;
/// Virtual anchors.
pub const VAS: usize = 24;
/// The tag's position and velocity, and the virtual anchors.
pub const STATES: usize = 4 + 2 * VAS;
/// One per anchor of either kind.
pub const RANGES: usize = ANCHORS + VAS;
/// Seconds between steps.
pub const STEP_S: f32 = 0.1;
/// How the tag moves.
pub const MOTION: Motion = Motion {
    acceleration_density_m2_s3: 0.3,
    velocity_decay_s: f32::INFINITY,
    virtual_anchor_walk_m_sqrt_s: 1e-4,
    position_std_limit_m: 30.0,
};
/// Where the physical anchors stand, metres.
pub const ANCHORS_M: [[f32; 2]; ANCHORS] = [[0.5, 7.0], [5.2, 3.2]];
/// Standard deviations at the start: position, velocity, coordinates of the virtual anchors.
pub const PRIOR_STD: [f32; 3] = [0.1, 0.3, 0.03];
/// Standard deviation of every range, metres.
pub const RANGE_STD_M: f32 = 0.03;

/// What a filter is given.
pub struct Problem {
    /// Where the tag is thought to start, metres.
    pub start_m: [f32; 2],
    /// Where the virtual anchors are thought to be, metres.
    pub virtual_anchors_m: [[f32; 2]; VAS],
    /// The ranges of every step, metres: physical anchors first.
    pub ranges_m: Vec<[f32; RANGES]>,
    /// Where the tag is after every step, metres.
    pub truth_m: Vec<[f64; 2]>,
}

struct Noise(Xoshiro128PlusPlus);

impl Noise {
    fn uniform(&mut self) -> f64 {
        (f64::from(self.0.next_u32()) + 0.5) / 4_294_967_296.0
    }

    fn normal(&mut self) -> f64 {
        (-2.0 * self.uniform().ln()).sqrt() * (std::f64::consts::TAU * self.uniform()).cos()
    }
}

impl Problem {
    /// The problem over so many steps.
    pub fn new(steps: usize) -> Self {
        let mut noise = Noise(Xoshiro128PlusPlus::seed_from_u64(52));
        let way = |t: f64| [3.0 + (0.3 * t).sin(), 6.0 + (0.3 * t).cos()];
        let images: [[f64; 2]; VAS] =
            std::array::from_fn(|_| [30.0 * noise.uniform() - 12.0, 30.0 * noise.uniform() - 10.0]);
        let around = |noise: &mut Noise, place: [f64; 2], std_m: f32| {
            place.map(|coordinate| (coordinate + f64::from(std_m) * noise.normal()) as f32)
        };
        let [position_std_m, _, image_std_m] = PRIOR_STD;
        let start_m = around(&mut noise, way(0.0), position_std_m);
        let virtual_anchors_m = images.map(|image| around(&mut noise, image, image_std_m));
        let mut ranges_m = Vec::new();
        let mut truth_m = Vec::new();
        for step in 1..=steps {
            let [x, y] = way(step as f64 * f64::from(STEP_S));
            let mut ranges = [0.0; RANGES];
            let anchors = ANCHORS_M.iter().map(|anchor| anchor.map(f64::from)).chain(images);
            for (range, [ax, ay]) in ranges.iter_mut().zip(anchors) {
                *range = ((x - ax).hypot(y - ay) + f64::from(RANGE_STD_M) * noise.normal()) as f32;
            }
            ranges_m.push(ranges);
            truth_m.push([x, y]);
        }
        Self { start_m, virtual_anchors_m, ranges_m, truth_m }
    }

    /// The problem in little-endian 32-bit words, as the firmware's `filter` reads it: `COGF`; steps; motion
    /// (four words); start; deviations at the start (three); anchors; virtual anchors; variance of a range;
    /// seconds per step; then the ranges of every step.
    pub fn feed(&self) -> Vec<u8> {
        let mut feed = b"COGF".to_vec();
        feed.extend((self.ranges_m.len() as u32).to_le_bytes());
        let motion = [
            MOTION.acceleration_density_m2_s3,
            MOTION.velocity_decay_s,
            MOTION.virtual_anchor_walk_m_sqrt_s,
            MOTION.position_std_limit_m,
        ];
        let numbers = motion
            .into_iter()
            .chain(self.start_m)
            .chain(PRIOR_STD)
            .chain(ANCHORS_M.into_iter().flatten())
            .chain(self.virtual_anchors_m.into_iter().flatten())
            .chain([RANGE_STD_M * RANGE_STD_M, STEP_S])
            .chain(self.ranges_m.iter().flatten().copied());
        feed.extend(numbers.flat_map(f32::to_le_bytes));
        feed
    }

    /// The core's filter at the start.
    pub fn filter(&self) -> StateFilter<ANCHORS, VAS> {
        let [position, velocity, image] = PRIOR_STD;
        let mut filter = StateFilter::new(MOTION, self.start_m, position, velocity, 0.0, 0.0);
        for (slot, place) in self.virtual_anchors_m.iter().enumerate() {
            assert!(filter.insert_independent(slot, *place, image), "slot {slot} was free");
        }
        filter
    }
}

/// What the ranges of a step belong to, in their order.
pub fn sources() -> impl Iterator<Item = Source> {
    let direct = (0..ANCHORS).map(|anchor| Source::Direct { anchor });
    direct.chain((0..VAS).map(|slot| Source::Virtual { anchor: slot % ANCHORS, slot }))
}

/// One step of the core's filter: prediction, all regressions, all updates.
pub fn step(filter: &mut StateFilter<ANCHORS, VAS>, ranges_m: &[f32; RANGES]) {
    filter.predict(STEP_S);
    let mut lines = [None; RANGES];
    for (line, source) in lines.iter_mut().zip(sources()) {
        let anchor_m = ANCHORS_M[source.anchor()];
        *line = filter.regress(source, &Sight { anchor_m, height_m: 0.0, height_std_m: 0.0 });
    }
    filter.update(lines.into_iter().flatten().zip(ranges_m).map(|(regression, range_m)| {
        let nu = range_m - regression.range_m;
        let variance_m2 = RANGE_STD_M * RANGE_STD_M;
        Innovation::hard(regression, nu, variance_m2)
    }));
}

/// Hash over all bits of the filter.
pub fn hash(filter: &StateFilter<ANCHORS, VAS>) -> u64 {
    let mut hash = TraceHash::default();
    filter.visit(|value| hash.float(value));
    hash.value()
}
