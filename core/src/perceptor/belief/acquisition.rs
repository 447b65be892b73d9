//! Acquisition: where the tag is when the state filter cannot know, at the start or after a loss.
//!
//! A single Gaussian that starts half a metre off takes an image for the direct path and stays there. Until the
//! measurements leave only one place, the tag is therefore a mixture of Gaussians of [p, v], each compared with the
//! direct paths and the known virtual anchors of every anchor heard:
//!
//! L_j = prod_k [1 - r_k P_d + r_k P_d sum_m nu_m N(z_m; mean_jk, S_jk) / lambda],
//!
//! features one by one, the direct path first, nu_m being what earlier features left of measurement m, times
//! lambda_fa / lambda for every measurement clearly shorter than the direct path would be: it must be a false alarm.
//! lambda is larger near the ranges of the last two scans, because a path of an unmapped virtual anchor stays where it is:
//! that it is there again says little for a place, and a shorter path that stays speaks against one.
//!
//! Places are proposed by the scans: an early range puts the tag on a circle around its anchor, cut into
//! [`DIRECTIONS`] arcs; each arc is weighed by the prior and by all measurements, and the heaviest stay. What is among no
//! places yet is weighed as well, as a tag that may be anywhere; until that has become too light to matter, every scan
//! proposes places, and none is settled on.

use crate::model::measurement::{Measurement, is_earlier};
use crate::model::motion::{Agent, MotionStep};
use crate::model::range::{DistanceRegression, LEAST_RADIUS2_M2, height_variance_m2, regress_distance};
use crate::model::soft_update::{LEAST_WEIGHT, Moments, SoftUpdate};
use crate::real::{TAU, exp, larger, ln, smaller, sqrt};
use heapless::Vec;
use nalgebra::{Matrix4, Vector4};

/// Capacity: places held at once, which bound memory and time.
pub const PLACES: usize = 26;
/// Mathematics: grid of arcs on a circle.
pub const DIRECTIONS: usize = 64;
/// Mathematics: cosine and sine of the rotation from one arc to the next, 2 pi / 64.
pub const NEXT_DIRECTION: [f32; 2] = [0.995_184_7, 0.098_017_14];
/// Mathematics: standard deviation of an arc along the circle, radians: 1.2 times half its length, so that arcs overlap.
pub const ARC_STD: f32 = 0.06;
/// Guard: against a plan believed to the letter: least probability that the tag is outside the outline told.
pub const OUTSIDE: f32 = 1e-3;
/// Guard: against the rounding of an arc's covariance: least share of its variance in that along its radius.
pub const ROUNDING_MARGIN: f32 = 1.0 / 1_048_576.0;
/// Capacity: ranges per anchor, the shortest first, that are tried as the direct path; they bound the time.
pub const EARLIEST: usize = 4;
/// Capacity: ranges per anchor that are remembered from one scan to the next.
pub const EARLIER: usize = 8;
/// Capacity: scans back that are remembered.
const SCANS: usize = 2;
/// Capacity: branches of one place in one cycle, which bound the time.
pub const BRANCHES: usize = 8;
/// Guard: against work on what explains nothing: gate, squared standard deviations.
pub const GATE2: f32 = 9.0;
/// Guard: against work on arcs out of the prior's reach: their gate, squared standard deviations.
pub const PRIOR_GATE2: f32 = 36.0;
/// Guard: against a prior that was wrong: where no arc is within its reach, its position's variances grow by this factor.
pub const DOUBT: f32 = 4.0;
/// Capacity: places lighter than this, of the heaviest, make room.
pub const LIGHTEST: f32 = 1e-9;
/// Guard: against ln 0: least factor of a weight.
pub const LEAST_FACTOR: f32 = 1e-12;
/// Guard: against the division by it: least determinant of a position's covariance.
pub const LEAST_DETERMINANT: f32 = 1e-20;
/// Capacity: ranges of one sweep that reflections tell apart.
const RANGES: usize = 32;

/// When it is taken to be known where the tag is.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct AcquisitionSettings {
    /// Weight that all places not proposed yet may have, of the heaviest's, until no more are proposed (1e-8 to 0.1). Less:
    /// longer acquisitions. More: now and then the right place is never proposed. With this, none of 300 seeds of each SLAM
    /// scenario lost the tag.
    pub newcomer_weight: f32,
    /// Share of the weight that the places around the heaviest hold once the tag is found (0.5 to 0.9999999). Less: sooner, and
    /// now and then in a mirror image. Chosen on development rooms.
    pub settled_weight: f32,
    /// Cycles with measurements, since places were last proposed, before it is found (1 to 1000). Less: sooner, by evidence of
    /// fewer cycles. Chosen on development rooms.
    pub settled_cycles: u16,
    /// Places nearer than this to the heaviest count as one with it, metres (0.01 to 10). Less: places that mean the same
    /// delay it. More: one Gaussian stands for places that are apart. Chosen on development rooms.
    pub settled_within_m: f32,
}

impl Default for AcquisitionSettings {
    fn default() -> Self {
        Self { newcomer_weight: 1e-5, settled_weight: 0.999_999, settled_cycles: 8, settled_within_m: 0.3 }
    }
}

/// What a place expects to hear: a direct path or a virtual anchor.
#[derive(Clone, Copy, Debug)]
pub struct Landmark {
    /// Position, metres.
    pub position_m: [f32; 2],
    /// Its covariance (xx, yx, yy), square metres; zero for a physical anchor.
    pub covariance_m2: [f32; 3],
    /// Height above the tag, metres.
    pub height_m: f32,
    /// Its standard deviation, metres.
    pub height_std_m: f32,
    /// Probability that it exists and is detected.
    pub detection: f32,
}

/// One anchor's ranges, with the intensities of what nothing explains.
#[derive(Clone, Copy, Debug)]
pub struct Sweep<'a> {
    /// The ranges.
    pub measurements: &'a [Measurement],
    /// Bias of the anchor's ranges, metres.
    pub bias_m: f32,
    /// Its variance, square metres.
    pub bias_variance_m2: f32,
    /// Intensity at each range of measurements that belong to no landmark, per metre; see [`Acquisition::backgrounds`].
    pub all_per_m: &'a [f32],
    /// Of these, false alarms.
    pub false_alarms_per_m: f32,
    /// Density of a range that may be any, per metre: that of the longest.
    pub anywhere_per_m: f32,
}

/// One place the tag may be at.
#[derive(Clone, Copy, Debug)]
struct Place {
    agent: Agent,
    /// Logarithm of the weight, relative.
    weight_ln: f32,
}

/// The mixture.
#[derive(Clone, Debug)]
pub struct Acquisition<const ANCHORS: usize> {
    prior: Agent,
    /// Variance of a velocity that nothing is known of, per axis.
    speed_m2_s2: f32,
    settings: AcquisitionSettings,
    places: Vec<Place, PLACES>,
    /// Cycles with measurements since places were last proposed.
    scans: u16,
    /// Logarithm of the weight that a place proposed now starts with: in the scans before, it was heard by none.
    newcomer_ln: f32,
    /// The shortest ranges of each anchor's last scan, metres; 0 for none.
    earlier_m: [[[f32; EARLIER]; SCANS]; ANCHORS],
    /// How long ago these scans were, seconds.
    earlier_age_s: [[f32; SCANS]; ANCHORS],
}

impl<const ANCHORS: usize> Acquisition<ANCHORS> {
    /// Nothing heard yet; the tag is somewhere around the prior. `speed_m2_s2` is the variance per axis of a velocity that
    /// nothing is known of.
    #[inline(always)] // built where it stays
    pub fn new(prior: Agent, speed_m2_s2: f32, settings: AcquisitionSettings) -> Self {
        Self {
            prior,
            speed_m2_s2,
            settings,
            places: Vec::new(),
            scans: 0,
            newcomer_ln: 0.0,
            earlier_m: [[[0.0; EARLIER]; SCANS]; ANCHORS],
            earlier_age_s: [[0.0; SCANS]; ANCHORS],
        }
    }

    /// A place that is as probable as all others together, before anything is heard.
    pub fn suggest(&mut self, agent: Agent) {
        self.offer(Place { agent, weight_ln: 0.0 });
    }

    /// Moves all places `elapsed_s` seconds ahead. Where nothing would be known of a place any more, the tag is within reach
    /// of it all the same, but what its velocity was tells nothing.
    pub fn predict(&mut self, step: &MotionStep, position_std_limit_m: f32, elapsed_s: f32) {
        let limit = position_std_limit_m * position_std_limit_m;
        self.earlier_age_s.iter_mut().flatten().for_each(|age_s| *age_s += elapsed_s);
        for agent in
            self.places.iter_mut().map(|place| &mut place.agent).chain(core::iter::once(&mut self.prior))
        {
            let v = agent.mean;
            let c = step.predicted(&agent.covariance);
            if larger(c.m11, c.m22) > limit {
                let (x, y) = (smaller(c.m11, limit), smaller(c.m22, limit));
                agent.mean = Vector4::new(v.x, v.y, 0.0, 0.0);
                agent.covariance =
                    Matrix4::from_diagonal(&Vector4::new(x, y, self.speed_m2_s2, self.speed_m2_s2));
            } else {
                step.carry_mean(&mut agent.mean);
                agent.covariance = c;
            }
        }
    }

    /// Intensities, per metre, of what belongs to no landmark at each range of a scan: `all_per_m`, and more where the scan before
    /// had a range too, because a virtual anchor that is not mapped yet stays where it is. `unmapped` is the share of
    /// `all_per_m` that is not false alarms, times their detection probability.
    pub fn backgrounds<const PATHS: usize>(
        &self,
        anchor: usize,
        measurements: &Vec<Measurement, PATHS>,
        all_per_m: f32,
        unmapped: f32,
    ) -> [f32; PATHS] {
        let c = &self.prior.covariance;
        let velocity_m2_s2 = c.m33 + c.m44;
        let mut backgrounds = [all_per_m; PATHS];
        for (background, measurement) in backgrounds.iter_mut().zip(measurements) {
            let mut most = 0.0;
            let ages_s = self.earlier_age_s.get(anchor).into_iter().flatten();
            for (scan, age_s) in self.earlier_m.get(anchor).into_iter().flatten().zip(ages_s) {
                let variance = 2.0 * measurement.variance_m2 + (age_s * age_s) * velocity_m2_s2;
                let mut density = 0.0;
                for earlier_m in scan {
                    let apart = measurement.range_m - earlier_m;
                    let nis = apart * apart / variance;
                    if nis < GATE2 && *earlier_m > 0.0 {
                        density += exp(-0.5 * nis) / sqrt(TAU * variance);
                    }
                }
                most = larger(most, density);
            }
            *background += unmapped * most;
        }
        backgrounds
    }

    /// Remembers the shortest ranges of a scan for the next.
    fn remember(&mut self, anchor: usize, measurements: &[Measurement]) {
        let Some(earlier_m) = self.earlier_m.get_mut(anchor) else { return };
        let [last, before] = earlier_m;
        *before = *last;
        if let Some([last_s, before_s]) = self.earlier_age_s.get_mut(anchor) {
            *before_s = core::mem::replace(last_s, 0.0);
        }
        let mut after = 0.0;
        for range_m in last {
            let mut next = f32::INFINITY;
            for measurement in measurements {
                if measurement.range_m > after && measurement.range_m < next {
                    next = measurement.range_m;
                }
            }
            *range_m = if next < f32::INFINITY { next } else { 0.0 };
            after = next;
        }
    }

    /// Compares all places with one cycle's sweeps; false where these are empty. `landmarks` gives those of the anchor of sweep
    /// i, the direct path first; `inside` the probability that a tag may be around a place (metres), known within a deviation
    /// (metres).
    #[inline(never)]
    pub fn observe<'a, L: Iterator<Item = Landmark> + Clone>(
        &mut self,
        sweeps: impl Iterator<Item = (usize, Sweep<'a>)> + Clone,
        landmarks: impl Fn(usize) -> L,
        inside: impl Fn([f32; 2], f32) -> f32,
    ) -> bool {
        if sweeps.clone().all(|(_, sweep)| sweep.measurements.is_empty()) {
            return false;
        }
        self.scans = self.scans.saturating_add(1);
        let newcomers_matter = self.newcomer_ln > ln(self.settings.newcomer_weight);
        let places = core::mem::take(&mut self.places);
        for place in &places {
            for branch in &place.hear(sweeps.clone(), &landmarks, None) {
                self.offer(*branch);
            }
        }
        if newcomers_matter {
            self.scans = 0;
            for (anchor, sweep) in sweeps.clone() {
                self.propose(anchor, &sweep, sweeps.clone(), &landmarks, &inside);
            }
        }
        for (anchor, sweep) in sweeps {
            self.remember(anchor, sweep.measurements);
            self.newcomer_ln += sweep.anywhere_ln(landmarks(anchor));
        }
        self.thin();
        if self.places.is_empty() {
            // No place within the prior's reach, or no weight that is a number.
            let c = &self.prior.covariance;
            let doubted = symmetric(
                [DOUBT * c.m11, DOUBT * c.m21, 0.0, 0.0],
                [DOUBT * c.m22, 0.0, 0.0],
                [c.m33, c.m43, c.m44],
            );
            let doubtful = Agent { mean: self.prior.mean, covariance: doubted };
            *self = Self::new(doubtful, self.speed_m2_s2, self.settings);
        }
        true
    }

    /// Proposes the places at which one of the earliest ranges of an anchor would be its direct path.
    #[inline(never)]
    fn propose<'a, L: Iterator<Item = Landmark> + Clone>(
        &mut self,
        anchor: usize,
        sweep: &Sweep<'a>,
        sweeps: impl Iterator<Item = (usize, Sweep<'a>)> + Clone,
        landmarks: &impl Fn(usize) -> L,
        inside: &impl Fn([f32; 2], f32) -> f32,
    ) {
        let Some(direct) = landmarks(anchor).next() else { return };
        let mut after = 0.0;
        for _ in 0..EARLIEST {
            let Some(measurement) = sweep
                .measurements
                .iter()
                .filter(|measurement| measurement.range_m > after)
                .reduce(|a, b| if b.range_m < a.range_m { b } else { a })
            else {
                break;
            };
            after = measurement.range_m;
            let height2 = direct.height_m * direct.height_m;
            let slant = after - sweep.bias_m;
            let radius = sqrt(larger(slant * slant - height2, LEAST_RADIUS2_M2));
            let of_height = height_variance_m2(direct.height_m, direct.height_std_m, slant);
            let mut direction = [1.0, 0.0];
            for _ in 0..DIRECTIONS {
                let variance_m2 = measurement.variance_m2 + sweep.bias_variance_m2 + of_height;
                // Most arcs are out of reach of the prior.
                if let Some(mut place) = self.on_arc(&direct, direction, radius, variance_m2) {
                    place.weight_ln += ln(larger(inside_of(&place.agent, inside), OUTSIDE));
                    for branch in &place.hear(sweeps.clone(), landmarks, Some((anchor, after))) {
                        self.offer(*branch);
                    }
                }
                let ([x, y], [c, s]) = (direction, NEXT_DIRECTION);
                direction = [x * c - y * s, x * s + y * c];
            }
        }
    }

    /// The prior, given that the tag is on an arc of the circle around an anchor; `None` where that is beyond the gate.
    fn on_arc(
        &self,
        direct: &Landmark,
        direction: [f32; 2],
        radius_m: f32,
        variance_m2: f32,
    ) -> Option<Place> {
        let [ux, uy] = direction;
        let [ax, ay] = direct.position_m;
        let across = (ARC_STD * radius_m) * (ARC_STD * radius_m);
        let along = variance_m2 + ROUNDING_MARGIN * across;
        // Covariance R of the arc.
        let xx = along * (ux * ux) + across * (uy * uy);
        let yx = (along - across) * (ux * uy);
        let yy = along * (uy * uy) + across * (ux * ux);
        let arc = [ax + radius_m * ux, ay + radius_m * uy];
        // Kalman update by the position. With S = C + R, S^-1 R = (adj(C) R + det(R) 1) / det(S) and
        // C S^-1 R = (det(C) R + det(R) C) / det(S): whichever of C and R is the smaller, no digits cancel.
        let c = &self.prior.covariance;
        let (of_prior, of_arc) = (c.m11 * c.m22 - c.m21 * c.m21, along * across);
        let mixed = c.m11 * yy + c.m22 * xx - 2.0 * (c.m21 * yx);
        let determinant = larger(of_prior + of_arc + mixed, LEAST_DETERMINANT);
        let inverse = 1.0 / determinant;
        let (ixx, iyx, iyy) = ((c.m22 + yy) * inverse, -((c.m21 + yx) * inverse), (c.m11 + xx) * inverse);
        let [px, py] = arc;
        let (nx, ny) = (px - self.prior.mean.x, py - self.prior.mean.y);
        let form = nx * (ixx * nx + iyx * ny) + ny * (iyx * nx + iyy * ny);
        if form > PRIOR_GATE2 {
            return None;
        }
        let gain = |a: f32, b: f32| [a * ixx + b * iyx, a * iyx + b * iyy];
        let rows = [[c.m11, c.m21], [c.m21, c.m22], [c.m31, c.m32], [c.m41, c.m42]];
        let gains = rows.map(|[a, b]| gain(a, b));
        let [g1, g2, g3, g4] = gains.map(|[gx, gy]| gx * nx + gy * ny);
        let mut agent = self.prior;
        agent.mean += Vector4::new(g1, g2, g3, g4);
        let position = |own: f32, prior: f32| (of_prior * own + of_arc * prior) * inverse;
        let left_x = [(c.m22 * xx - c.m21 * yx + of_arc) * inverse, (c.m11 * yx - c.m21 * xx) * inverse];
        let left_y = [(c.m22 * yx - c.m21 * yy) * inverse, (c.m11 * yy - c.m21 * yx + of_arc) * inverse];
        let cross = |a: f32, b: f32, [lx, ly]: [f32; 2]| a * lx + b * ly;
        let [_, _, [zx, zy], [wx, wy]] = gains;
        agent.covariance = symmetric(
            [
                position(xx, c.m11),
                position(yx, c.m21),
                cross(c.m31, c.m32, left_x),
                cross(c.m41, c.m42, left_x),
            ],
            [position(yy, c.m22), cross(c.m31, c.m32, left_y), cross(c.m41, c.m42, left_y)],
            [
                c.m33 - (zx * c.m31 + zy * c.m32),
                c.m43 - (wx * c.m31 + wy * c.m32),
                c.m44 - (wx * c.m41 + wy * c.m42),
            ],
        );
        // An arc stands for its share of the circle: with the radius, so many metres times the prior's density there.
        let weight_ln =
            self.newcomer_ln + ln(radius_m * (1.0 / DIRECTIONS as f32)) - 0.5 * (form + ln(determinant));
        Some(Place { agent, weight_ln })
    }

    /// Takes a place in, if it is heavier than the lightest.
    fn offer(&mut self, place: Place) {
        keep_heaviest(&mut self.places, place);
    }

    /// Scales the weights to a maximum of 1, drops light places, and joins those that ran together.
    fn thin(&mut self) {
        let mut most = f32::NEG_INFINITY;
        for place in &self.places {
            most = larger(place.weight_ln, most);
        }
        for place in &mut self.places {
            place.weight_ln -= most;
        }
        self.newcomer_ln -= most;
        let least = ln(LIGHTEST);
        self.places.retain(|place| place.weight_ln > least);
        // In place: the first `count` are those that stay.
        let mut count = 0;
        for index in 0..self.places.len() {
            let Some(place) = self.places.get(index).copied() else { break };
            match self.places.iter_mut().take(count).find(|other| other.is_same(&place)) {
                Some(other) => other.absorb(&place),
                None => {
                    if let Some(free) = self.places.get_mut(count) {
                        *free = place;
                    }
                    count += 1;
                }
            }
        }
        self.places.truncate(count);
    }

    /// The mixture as one Gaussian: what is known of the tag meanwhile.
    pub fn summary(&self) -> Agent {
        let mut union: Option<Place> = None;
        for place in &self.places {
            match &mut union {
                Some(union) => union.absorb(place),
                None => union = Some(*place),
            }
        }
        union.map_or(self.prior, |place| place.agent)
    }

    /// Where the tag is, once all places that matter are one ([`AcquisitionSettings`]).
    pub fn settled(&self) -> Option<Agent> {
        let AcquisitionSettings { settled_weight, settled_cycles, settled_within_m, .. } = self.settings;
        if self.scans < settled_cycles {
            return None;
        }
        let heaviest = self.places.iter().reduce(|a, b| if b.weight_ln > a.weight_ln { b } else { a })?;
        let (mut near, mut all) = (0.0, 0.0);
        for place in &self.places {
            let weight = exp(place.weight_ln - heaviest.weight_ln);
            let away = place.agent.mean - heaviest.agent.mean;
            all += weight;
            if away.x * away.x + away.y * away.y < settled_within_m * settled_within_m {
                near += weight;
            }
        }
        (near > settled_weight * all).then(|| self.summary())
    }

    /// Every number of the state, in a fixed order, for traces.
    pub fn visit(&self, mut f: impl FnMut(f32)) {
        f(f32::from(self.scans));
        f(self.newcomer_ln);
        f(self.places.len() as f32);
        let agents = self.places.iter().map(|place| &place.agent);
        for agent in agents.chain(core::iter::once(&self.prior)) {
            agent.mean.iter().for_each(|v| f(*v));
            agent.covariance.iter().for_each(|v| f(*v));
        }
        self.places.iter().for_each(|place| f(place.weight_ln));
        self.earlier_m.iter().flatten().flatten().for_each(|range_m| f(*range_m));
        self.earlier_age_s.iter().flatten().for_each(|age_s| f(*age_s));
    }
}

/// Probability that a tag may be where this one is.
fn inside_of(agent: &Agent, inside: &impl Fn([f32; 2], f32) -> f32) -> f32 {
    let c = &agent.covariance;
    inside([agent.mean.x, agent.mean.y], sqrt(larger(0.5 * (c.m11 + c.m22), 0.0)))
}

impl Place {
    /// What becomes of the place when all sweeps are heard: one branch for every choice of direct paths that matters.
    /// `origin` is the anchor and range that put it there; these are not counted again.
    #[inline(never)]
    fn hear<'a, L: Iterator<Item = Landmark> + Clone>(
        &self,
        sweeps: impl Iterator<Item = (usize, Sweep<'a>)>,
        landmarks: &impl Fn(usize) -> L,
        origin: Option<(usize, f32)>,
    ) -> Vec<Place, BRANCHES> {
        let mut branches: Vec<Place, BRANCHES> = Vec::new();
        // A first branch always fits.
        let _ = branches.push(*self);
        for (anchor, sweep) in sweeps {
            let given = origin.and_then(|(of, range_m)| (of == anchor).then_some(range_m));
            let mut grown = Vec::new();
            for branch in &branches {
                branch.branch(&sweep, landmarks(anchor), given, &mut grown);
            }
            branches = grown;
        }
        branches
    }

    /// One sweep: every choice of the direct path among the gated ranges, or none, with all virtual anchors weighed in.
    #[inline(never)]
    fn branch(
        &self,
        sweep: &Sweep<'_>,
        landmarks: impl Iterator<Item = Landmark> + Clone,
        given: Option<f32>,
        grown: &mut Vec<Place, BRANCHES>,
    ) {
        let Some(direct) = landmarks.clone().next() else { return };
        let (line, explained) = self.regress(&direct);
        if given.is_none() {
            let expected = [line.range_m + sweep.bias_m, explained + sweep.bias_variance_m2];
            let [expected_m, variance_m2] = expected;
            let shorter = sweep.shorter_cost(expected_m, variance_m2);
            let mut missed = *self;
            missed.weight_ln += ln(larger((1.0 - direct.detection) * shorter, LEAST_FACTOR));
            missed.weigh_reflections(sweep, landmarks.clone().skip(1), None, expected);
            keep_heaviest(grown, missed);
        }
        for (index, (measurement, all_per_m)) in sweep.measurements.iter().zip(sweep.all_per_m).enumerate() {
            if given.is_some_and(|range_m| range_m != measurement.range_m) {
                continue;
            }
            let own = measurement.variance_m2 + sweep.bias_variance_m2;
            let innovation = measurement.range_m - sweep.bias_m - line.range_m;
            let variance = explained + own;
            let nis = innovation * innovation / variance;
            if nis >= GATE2 && given.is_none() {
                continue;
            }
            let mut heard = *self;
            let shorter = sweep.shorter_cost(measurement.range_m, own);
            // Of the range that put the place where it is, the arc's weight is the integral.
            let density = if given.is_some() { 1.0 } else { exp(-0.5 * nis) / sqrt(TAU * variance) };
            heard.weight_ln += ln(larger(direct.detection * density * shorter / all_per_m, LEAST_FACTOR));
            if given.is_none() {
                let hard = Moments { weight: 1.0, first_m: innovation, second_m2: innovation * innovation };
                heard.correct(&line, explained, own, &hard);
            }
            heard.weigh_reflections(
                sweep,
                landmarks.clone().skip(1),
                Some(index),
                [measurement.range_m, own],
            );
            keep_heaviest(grown, heard);
        }
    }

    /// Regression of a landmark's range on the tag's place; the variance of the range expected.
    fn regress(&self, landmark: &Landmark) -> (DistanceRegression, f32) {
        let c = &self.agent.covariance;
        let [xx, yx, yy] = landmark.covariance_m2;
        let [ax, ay] = landmark.position_m;
        let line = regress_distance(
            [self.agent.mean.x - ax, self.agent.mean.y - ay],
            [c.m11 + xx, c.m21 + yx, c.m22 + yy],
            landmark.height_m,
            landmark.height_std_m,
        );
        (line, line.explained_m2 + line.residual_m2)
    }

    /// Weighs the place by the reflections of a sweep, one after the other, softly; `taken` is the direct path, and no
    /// reflection is shorter than that, of this range and variance.
    #[inline(never)]
    fn weigh_reflections(
        &mut self,
        sweep: &Sweep<'_>,
        reflections: impl Iterator<Item = Landmark>,
        taken: Option<usize>,
        [direct_m, direct_variance_m2]: [f32; 2],
    ) {
        let mut left = [1.0_f32; RANGES];
        if let Some(taken) = taken.and_then(|taken| left.get_mut(taken)) {
            *taken = 0.0;
        }
        for landmark in reflections {
            let (line, explained) = self.regress(&landmark);
            let [mut weight, mut first, mut second, mut noise] = [0.0; 4];
            let mut shares = [0.0_f32; RANGES];
            let rows = sweep.measurements.iter().zip(sweep.all_per_m).zip(&left).zip(&mut shares);
            for (((measurement, all_per_m), left), share) in rows {
                let own = measurement.variance_m2 + sweep.bias_variance_m2;
                let innovation = measurement.range_m - sweep.bias_m - line.range_m;
                let variance = explained + own;
                let nis = innovation * innovation / variance;
                if nis >= GATE2 || is_earlier(measurement, direct_m, direct_variance_m2) {
                    continue;
                }
                let density = landmark.detection * exp(-0.5 * nis) / sqrt(TAU * variance);
                let p = *left * density / all_per_m;
                *share = p;
                weight += p;
                first += p * innovation;
                second += p * (innovation * innovation);
                noise += p * own;
            }
            let total = weight + (1.0 - landmark.detection);
            self.weight_ln += ln(larger(total, LEAST_FACTOR));
            for (left, share) in left.iter_mut().zip(&shares) {
                *left *= larger(1.0 - share / total, 0.0);
            }
            // The error of a virtual anchor is the same in every scan: only where it is smaller than that of the range may
            // it move the tag, scan after scan.
            let [gx, gy] = line.slope;
            let [xx, yx, yy] = landmark.covariance_m2;
            let own = gx * (gx * xx + gy * yx) + gy * (gx * yx + gy * yy);
            if weight > LEAST_WEIGHT * total && own * weight < noise {
                let moments =
                    Moments { weight: weight / total, first_m: first / total, second_m2: second / total };
                self.correct(&line, explained, noise / weight, &moments);
            }
        }
    }

    /// Moves the tag by ranges of total probability, first and second moment of the innovation: only the tag, a virtual
    /// anchor's own error is noise.
    fn correct(&mut self, line: &DistanceRegression, explained: f32, noise: f32, moments: &Moments) {
        let c = &self.agent.covariance;
        let [gx, gy] = line.slope;
        let (wx, wy) = (gx * c.m11 + gy * c.m21, gx * c.m21 + gy * c.m22);
        let (wu, wv) = (gx * c.m31 + gy * c.m32, gx * c.m41 + gy * c.m42);
        let of_tag = gx * wx + gy * wy;
        let SoftUpdate { mean: step, covariance: scale } =
            SoftUpdate::new(moments, explained + noise, of_tag);
        self.agent.mean += Vector4::new(wx * step, wy * step, wu * step, wv * step);
        let (sx, sy, su, sv) = (scale * wx, scale * wy, scale * wu, scale * wv);
        self.agent.covariance = symmetric(
            [c.m11 + sx * wx, c.m21 + sy * wx, c.m31 + su * wx, c.m41 + sv * wx],
            [c.m22 + sy * wy, c.m32 + su * wy, c.m42 + sv * wy],
            [c.m33 + su * wu, c.m43 + sv * wu, c.m44 + sv * wv],
        );
    }

    /// Whether it is within one standard deviation of another place, as a Mahalanobis distance.
    fn is_same(&self, other: &Place) -> bool {
        let (a, b) = (&self.agent, &other.agent);
        let (dx, dy) = (b.mean.x - a.mean.x, b.mean.y - a.mean.y);
        let xx = a.covariance.m11 + b.covariance.m11;
        let yx = a.covariance.m21 + b.covariance.m21;
        let yy = a.covariance.m22 + b.covariance.m22;
        let determinant = xx * yy - yx * yx;
        yy * (dx * dx) - 2.0 * (yx * (dx * dy)) + xx * (dy * dy) < determinant
    }

    /// Moment-matched union.
    fn absorb(&mut self, other: &Place) {
        let top = larger(self.weight_ln, other.weight_ln);
        let (p, q) = (exp(self.weight_ln - top), exp(other.weight_ln - top));
        let (a, b) = (p / (p + q), q / (p + q));
        let away = other.agent.mean - self.agent.mean;
        let apart = a * b;
        let (c, o) = (&self.agent.covariance, &other.agent.covariance);
        let mixed = |own: f32, others: f32, u: f32, v: f32| a * own + b * others + apart * (u * v);
        self.agent.covariance = symmetric(
            [
                mixed(c.m11, o.m11, away.x, away.x),
                mixed(c.m21, o.m21, away.x, away.y),
                mixed(c.m31, o.m31, away.x, away.z),
                mixed(c.m41, o.m41, away.x, away.w),
            ],
            [
                mixed(c.m22, o.m22, away.y, away.y),
                mixed(c.m32, o.m32, away.y, away.z),
                mixed(c.m42, o.m42, away.y, away.w),
            ],
            [
                mixed(c.m33, o.m33, away.z, away.z),
                mixed(c.m43, o.m43, away.z, away.w),
                mixed(c.m44, o.m44, away.w, away.w),
            ],
        );
        self.agent.mean += Vector4::new(b * away.x, b * away.y, b * away.z, b * away.w);
        self.weight_ln = top + ln(p + q);
    }
}

impl Sweep<'_> {
    /// Logarithm of the weight of a place that may be anywhere: every landmark's range is uniform up to the longest.
    #[inline(never)]
    fn anywhere_ln(&self, mut landmarks: impl Iterator<Item = Landmark>) -> f32 {
        let mut left = [1.0_f32; RANGES];
        let Some(direct) = landmarks.next() else { return 0.0 };
        // The direct path is one of the ranges, or missing between two of them; either costs those that are shorter.
        let density = direct.detection * self.anywhere_per_m;
        let mut total = 0.0;
        for (measurement, all_per_m) in self.measurements.iter().zip(self.all_per_m) {
            // The next shorter range is where the gap before this one begins.
            let mut before_m = 0.0;
            for other in self.measurements {
                if other.range_m < measurement.range_m {
                    before_m = larger(before_m, other.range_m);
                }
            }
            let gap = (measurement.range_m - before_m) * self.anywhere_per_m;
            let cost = self.shorter_cost(measurement.range_m, 0.0);
            total += cost * ((1.0 - direct.detection) * gap + density / all_per_m);
        }
        let mut weight_ln = ln(larger(total, LEAST_FACTOR));
        for landmark in landmarks {
            let density = landmark.detection * self.anywhere_per_m;
            let mut weight = 0.0;
            for (left, all_per_m) in left.iter().zip(self.all_per_m).take(self.measurements.len()) {
                weight += left * density / all_per_m;
            }
            let total = weight + (1.0 - landmark.detection);
            weight_ln += ln(larger(total, LEAST_FACTOR));
            for (left, all_per_m) in left.iter_mut().zip(self.all_per_m).take(self.measurements.len()) {
                *left *= larger(1.0 - *left * density / all_per_m / total, 0.0);
            }
        }
        weight_ln
    }

    /// First-arrival rule: what is clearly shorter than the direct path is a false alarm, whether the direct path itself
    /// is heard or not. The probability of that, relative to paths of unmapped virtual anchors.
    fn shorter_cost(&self, direct_m: f32, variance_m2: f32) -> f32 {
        let mut factor = 1.0;
        for (other, all_per_m) in self.measurements.iter().zip(self.all_per_m) {
            if is_earlier(other, direct_m, variance_m2) {
                factor *= other.false_alarm * self.false_alarms_per_m / all_per_m;
            }
        }
        factor
    }
}

/// Adds a place, where there is no room in place of the lightest if that is lighter.
fn keep_heaviest<const N: usize>(places: &mut Vec<Place, N>, place: Place) {
    if let Err(place) = places.push(place)
        && let Some(lightest) = places.iter_mut().reduce(|a, b| if b.weight_ln < a.weight_ln { b } else { a })
        && lightest.weight_ln < place.weight_ln
    {
        *lightest = place;
    }
}

/// A symmetric matrix from its lower triangle: column 1, column 2 from the diagonal on, and (33, 43, 44).
fn symmetric(
    [m11, m21, m31, m41]: [f32; 4],
    [m22, m32, m42]: [f32; 3],
    [m33, m43, m44]: [f32; 3],
) -> Matrix4<f32> {
    Matrix4::new(m11, m21, m31, m41, m21, m22, m32, m42, m31, m32, m33, m43, m41, m42, m43, m44)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::motion::Motion;
    use crate::perceptor::state_filter::StateFilter;

    const ANCHORS: [[f32; 2]; 3] = [[0.0, 0.0], [12.0, 1.0], [3.0, 9.0]];

    fn motion() -> Motion {
        Motion {
            acceleration_density_m2_s3: 1e-3,
            velocity_decay_s: f32::INFINITY,
            virtual_anchor_walk_m_sqrt_s: 3e-4,
            position_std_limit_m: 1e4,
        }
    }

    /// An acquisition from a prior of `std_m` at the origin, after `scans` scans of exact ranges of `deviation_m` to a tag
    /// at rest at (7, 4); all lengths of the room times `size`.
    fn acquired(size: f32, std_m: f32, deviation_m: f32, scans: usize) -> Acquisition<3> {
        let prior = StateFilter::<1, 1>::new(motion(), [0.0, 0.0], std_m, 0.1, 0.0, 0.0).agent();
        let mut acquisition = Acquisition::<3>::new(prior, 0.01, AcquisitionSettings::default());
        let ranges = ANCHORS.map(|[x, y]| {
            let range_m = size * (7.0 - x).hypot(4.0 - y);
            [Measurement {
                range_m,
                variance_m2: deviation_m * deviation_m,

                sinr: 0.0,
                energy: 0.0,
                false_alarm: 1.0,
            }]
        });
        for _ in 0..scans {
            acquisition.predict(&motion().step(0.1), 1e4, 0.1);
            let sweeps = ranges.iter().enumerate().map(|(anchor, measurements)| {
                let sweep = Sweep {
                    measurements,
                    bias_m: 0.0,
                    bias_variance_m2: 0.0,
                    all_per_m: &[0.2],
                    false_alarms_per_m: 0.03,
                    anywhere_per_m: 0.03,
                };
                (anchor, sweep)
            });
            let landmarks = |anchor: usize| {
                core::iter::once(Landmark {
                    position_m: ANCHORS[anchor].map(|coordinate| size * coordinate),
                    covariance_m2: [0.0; 3],
                    height_m: 0.0,
                    height_std_m: 0.0,
                    detection: 0.95,
                })
            };
            acquisition.observe(sweeps, landmarks, |_, _| 1.0);
        }
        acquisition
    }

    /// Whether elimination leaves positive pivots.
    fn is_positive_definite(c: &Matrix4<f32>) -> bool {
        let mut c = c.map(f64::from);
        for pivot in 0..4 {
            if !(c[(pivot, pivot)] > 0.0) {
                return false;
            }
            for row in pivot + 1..4 {
                let factor = c[(row, pivot)] / c[(pivot, pivot)];
                for column in pivot..4 {
                    c[(row, column)] -= factor * c[(pivot, column)];
                }
            }
        }
        true
    }

    #[test]
    fn places_stay_positive_definite_however_little_was_known() {
        for (size, std_m) in
            [1.0, 100.0].into_iter().flat_map(|size| [1e-3, 0.25, 3.0, 30.0, 1e3].map(|std_m| (size, std_m)))
        {
            for scans in 1..=10 {
                let acquisition = acquired(size, std_m, 5e-3, scans);
                for place in &acquisition.places {
                    let c = &place.agent.covariance;
                    assert!(is_positive_definite(c), "{size}, {std_m} m, {scans} scans: {c}");
                }
            }
        }
    }

    #[test]
    fn a_tag_anywhere_is_found() {
        for std_m in [3.0, 30.0, 1e3] {
            let agent = acquired(1.0, std_m, 0.02, 10).settled().unwrap();
            let off_m = (agent.mean.x - 7.0).hypot(agent.mean.y - 4.0);
            assert!(off_m < 0.02, "{std_m} m: {off_m} m off");
        }
    }

    #[test]
    fn a_mixture_without_weights_starts_over() {
        let mut acquisition = acquired(1.0, 3.0, 0.02, 2);
        acquisition.places.iter_mut().for_each(|place| place.weight_ln = f32::NAN);
        acquisition.newcomer_ln = f32::NAN;
        let sweep = Sweep {
            measurements: &[Measurement {
                range_m: 8.0,
                variance_m2: 1e-4,

                sinr: 0.0,
                energy: 0.0,
                false_alarm: 1.0,
            }],
            bias_m: 0.0,
            bias_variance_m2: 0.0,
            all_per_m: &[0.2],
            false_alarms_per_m: 0.03,
            anywhere_per_m: 0.03,
        };
        let landmark = Landmark {
            position_m: [0.0, 0.0],
            covariance_m2: [0.0; 3],
            height_m: 0.0,
            height_std_m: 0.0,
            detection: 0.95,
        };
        for _ in 0..2 {
            acquisition.observe(core::iter::once((0, sweep)), |_| core::iter::once(landmark), |_, _| 1.0);
        }
        assert!(!acquisition.places.is_empty() && acquisition.newcomer_ln.is_finite());
    }
}
