//! Discovery: candidates for virtual anchors, from measurements that nothing explains.
//!
//! A range puts a virtual anchor on a circle around the tag. A candidate is a ring of Gaussians in polar coordinates
//! (direction, radius) around the place where it was first heard. Directions are unit vectors; an angle a between two of
//! them is held as t = 2 tan(a/2), so cos a = (4 - t^2)/(4 + t^2) and sin a = 4t/(4 + t^2). Every later range z updates each of them (a Kalman
//! update over a five-point regression) and weighs it by its likelihood: w <- w exp(-nis/2) / sqrt(S), normalised.
//! Light ones are dropped, neighbours that ran together are merged. One heavy, small Gaussian is a discovery.

use super::association::Measurement;
use super::real::{Real, exp, larger, pi, smaller, sqrt, square};
use super::state_filter::{FivePoints, ROOT_3};
use std::fmt;

/// Most candidates per anchor.
const CANDIDATES: usize = 8;
/// Gaussians on a ring.
const HYPOTHESES: usize = 16;
/// Direction of the first of them, pi/16, and the turn from each to the next, pi/8: cosine and sine.
const FIRST_DIRECTION: [f32; 2] = [0.980_785_25, 0.195_090_32];
const NEXT_DIRECTION: [f32; 2] = [0.923_879_5, 0.382_683_43];
const GATE: f32 = 3.0;
/// Share of the tag's variance that counts as independent from scan to scan.
const TAG_SHARE: f32 = 0.3;
const LIGHTEST: f32 = 1e-3;
const MERGE_DISTANCE2: f32 = 1.0;
const MISSES: u16 = 8;
const PROBATION: u16 = 8;
const HIT_SHARE: f32 = 0.6;
const SETTLED_SHARE: f32 = 0.6;
const SETTLED_M2: f32 = 2.5e-3;
const RESOLVED_HITS: u16 = 100;
const RESOLVED_WEIGHT: f32 = 0.999;
const RESOLVED_TRACE_M2: f32 = 0.16;
const RESOLVED_INFLATION: f32 = 3.0;
/// Least variances of angle and radius.
const SMALLEST_ANGLE: f32 = 1e-14;
const SMALLEST_RADIUS: f32 = 1e-12;

/// Where the tag is believed to be.
#[derive(Clone, Copy, Debug)]
pub struct Viewpoint<T> {
    /// Position, metres.
    pub position_m: [T; 2],
    /// Covariance: xx, yx, yy, square metres.
    pub covariance_m2: [T; 3],
    /// Height of the anchor above the tag, metres.
    pub height_m: T,
}

/// A virtual anchor found.
#[derive(Clone, Copy, Debug)]
pub struct Discovered<T> {
    /// Position, metres.
    pub position_m: [T; 2],
    /// Covariance relative to the tag, square metres.
    pub covariance_m2: [[T; 2]; 2],
}

/// One Gaussian of a ring.
#[derive(Clone, Copy, Debug)]
pub struct Hypothesis<T> {
    /// A unit vector.
    direction: [T; 2],
    radius_m: T,
    /// angle-angle, radius-angle, radius-radius.
    covariance: [T; 3],
    weight: T,
}

/// A ring.
#[derive(Clone, Debug)]
pub struct Candidate<T> {
    origin_m: [T; 2],
    hypotheses: Vec<Hypothesis<T>>,
    hits: u16,
    age: u16,
    misses: u16,
}

/// A range as a line over angle and radius.
struct Line<T> {
    range_m: T,
    slope: [T; 2],
    residual: T,
    explained: T,
}

/// The candidates of every anchor.
#[derive(Clone, Debug)]
pub struct Discovery<T> {
    candidates: Vec<Vec<Candidate<T>>>,
}

impl<T: Real> Discovery<T> {
    /// No candidates.
    pub fn new(anchors: usize) -> Self {
        Self { candidates: vec![Vec::new(); anchors] }
    }

    /// Number of candidates of an anchor.
    pub fn candidates(&self, anchor: usize) -> usize {
        self.candidates[anchor].len()
    }

    /// Gives an anchor's leftovers to its candidates, nearest pair first; the rest start candidates of their own.
    pub fn observe(&mut self, anchor: usize, viewpoint: &Viewpoint<T>, leftovers: &[Measurement<T>]) {
        let candidates = &mut self.candidates[anchor];
        let expected: Vec<(T, T)> = candidates.iter().map(|c| c.expectation(viewpoint)).collect();
        let mut served = vec![false; candidates.len()];
        let mut used = vec![false; leftovers.len()];
        loop {
            let mut nearest: Option<(usize, usize)> = None;
            let mut least = T::ZERO;
            for i in 0..candidates.len() {
                for m in 0..leftovers.len() {
                    if served[i] || used[m] {
                        continue;
                    }
                    let (range_m, variance_m2) = expected[i];
                    let innovation = leftovers[m].range_m - range_m;
                    let nis = square(innovation) / (variance_m2 + leftovers[m].variance_m2);
                    if nis < T::of(GATE) * T::of(GATE) && (nearest.is_none() || nis < least) {
                        nearest = Some((i, m));
                        least = nis;
                    }
                }
            }
            let Some((i, m)) = nearest else { break };
            served[i] = true;
            used[m] = true;
            candidates[i].update(viewpoint, &leftovers[m]);
        }
        for i in 0..candidates.len() {
            candidates[i].age = candidates[i].age.saturating_add(1);
            if !served[i] {
                candidates[i].misses += 1;
            }
        }
        candidates.retain(Candidate::is_plausible);
        let tag = T::of(0.5) * (viewpoint.covariance_m2[0] + viewpoint.covariance_m2[2]);
        for m in 0..leftovers.len() {
            let share = T::of(SETTLED_SHARE) * leftovers[m].variance_m2;
            let settled = tag < larger(share, T::of(SETTLED_M2));
            if !used[m] && settled && candidates.len() < CANDIDATES {
                candidates.push(Candidate::ring(viewpoint, &leftovers[m]));
            }
        }
    }

    /// Takes the first resolved candidate of an anchor out.
    pub fn take_resolved(&mut self, anchor: usize) -> Option<Discovered<T>> {
        for i in 0..self.candidates[anchor].len() {
            if let Some(found) = self.candidates[anchor][i].resolved() {
                self.candidates[anchor].remove(i);
                return Some(found);
            }
        }
        None
    }

    /// Every number with its name, in the order of the core's `visit`.
    pub fn visit(&self, f: &mut dyn FnMut(fmt::Arguments<'_>, T)) {
        let length = |n: usize| T::of(n as f32);
        for j in 0..self.candidates.len() {
            f(format_args!("number of candidates of anchor {j}"), length(self.candidates[j].len()));
        }
        for j in 0..self.candidates.len() {
            for i in 0..self.candidates[j].len() {
                let candidate = &self.candidates[j][i];
                let count = |n: u16| T::of(f32::from(n));
                let hypotheses = length(candidate.hypotheses.len());
                f(format_args!("number of hypotheses of candidate {i} of anchor {j}"), hypotheses);
                f(format_args!("hits of candidate {i} of anchor {j}"), count(candidate.hits));
                f(format_args!("age of candidate {i} of anchor {j}"), count(candidate.age));
                f(format_args!("misses of candidate {i} of anchor {j}"), count(candidate.misses));
                f(format_args!("origin x of candidate {i} of anchor {j}"), candidate.origin_m[0]);
                f(format_args!("origin y of candidate {i} of anchor {j}"), candidate.origin_m[1]);
                for h in 0..candidate.hypotheses.len() {
                    let hypothesis = &candidate.hypotheses[h];
                    let numbers = [
                        ("direction x", hypothesis.direction[0]),
                        ("direction y", hypothesis.direction[1]),
                        ("radius", hypothesis.radius_m),
                        ("angle variance", hypothesis.covariance[0]),
                        ("radius-angle covariance", hypothesis.covariance[1]),
                        ("radius variance", hypothesis.covariance[2]),
                        ("weight", hypothesis.weight),
                    ];
                    for (name, value) in numbers {
                        f(format_args!("{name} of hypothesis {h} of candidate {i} of anchor {j}"), value);
                    }
                }
            }
        }
    }
}

impl<T: Real> Candidate<T> {
    /// A full ring around the tag at the distance measured, each Gaussian as wide as half its share.
    fn ring(viewpoint: &Viewpoint<T>, measurement: &Measurement<T>) -> Self {
        let num = T::of;
        let slant = measurement.range_m;
        let radius_m = sqrt(larger(square(slant) - square(viewpoint.height_m), num(1e-4)));
        // d radius = (slant / radius) d slant.
        let stretch = slant / radius_m;
        let half_angle = pi::<T>() / T::of_count(HYPOTHESES);
        let mut hypotheses = Vec::new();
        // Order: each direction is the one before, turned once more.
        let mut direction = FIRST_DIRECTION.map(T::of);
        for _ in 0..HYPOTHESES {
            hypotheses.push(Hypothesis {
                direction,
                radius_m,
                covariance: [square(half_angle), T::ZERO, measurement.variance_m2 * square(stretch)],
                weight: T::ONE / T::of_count(HYPOTHESES),
            });
            direction = turned(direction, NEXT_DIRECTION.map(T::of));
        }
        Self { origin_m: viewpoint.position_m, hypotheses, hits: 1, age: 1, misses: 0 }
    }

    /// From the tag to the origin.
    fn offset(&self, viewpoint: &Viewpoint<T>) -> [T; 2] {
        [self.origin_m[0] - viewpoint.position_m[0], self.origin_m[1] - viewpoint.position_m[1]]
    }

    /// Mean and variance of the mixture's range. Order: moments relative to the first hypothesis' mean.
    fn expectation(&self, viewpoint: &Viewpoint<T>) -> (T, T) {
        let num = T::of;
        let offset = self.offset(viewpoint);
        let first = self.hypotheses[0].regress(offset, viewpoint.height_m).range_m;
        let mut mean = T::ZERO;
        let mut second = T::ZERO;
        for hypothesis in &self.hypotheses {
            let line = hypothesis.regress(offset, viewpoint.height_m);
            let relative = line.range_m - first;
            mean += hypothesis.weight * relative;
            second += hypothesis.weight * (square(relative) + line.explained + line.residual);
        }
        let [xx, _, yy] = viewpoint.covariance_m2;
        let tag = num(TAG_SHARE) * num(0.5) * (xx + yy);
        (first + mean, larger(second - square(mean), T::ZERO) + tag)
    }

    /// The heaviest hypothesis (the first of equals).
    fn heaviest(&self) -> &Hypothesis<T> {
        let mut best = &self.hypotheses[0];
        for hypothesis in &self.hypotheses {
            if hypothesis.weight > best.weight {
                best = hypothesis;
            }
        }
        best
    }

    /// Updates every hypothesis by a range, and their weights by its likelihood.
    fn update(&mut self, viewpoint: &Viewpoint<T>, measurement: &Measurement<T>) {
        let num = T::of;
        self.hits = self.hits.saturating_add(1);
        self.misses = 0;
        let offset = self.offset(viewpoint);

        // Variance of the tag along the line of sight to the heaviest hypothesis.
        let heaviest = self.heaviest();
        let dx = -offset[0] - heaviest.radius_m * heaviest.direction[0];
        let dy = -offset[1] - heaviest.radius_m * heaviest.direction[1];
        let [xx, yx, yy] = viewpoint.covariance_m2;
        let length2 = larger(square(dx) + square(dy), num(1e-6));
        let tag = (square(dx) * xx + num(2.0) * (dx * dy) * yx + square(dy) * yy) / length2;
        let noise = measurement.variance_m2 + num(TAG_SHARE) * tag;

        let mut likelihoods = Vec::new();
        let mut least_nis = T::of(f32::INFINITY);
        for hypothesis in &mut self.hypotheses {
            let line = hypothesis.regress(offset, viewpoint.height_m);
            let variance = line.explained + line.residual + noise;
            let innovation = measurement.range_m - line.range_m;
            hypothesis.correct(&line, innovation, variance);
            let nis = square(innovation) / variance;
            least_nis = smaller(nis, least_nis);
            likelihoods.push((nis, variance));
        }

        let mut sum = T::ZERO;
        for h in 0..self.hypotheses.len() {
            let (nis, variance) = likelihoods[h];
            // The common factor exp(least / 2) keeps the largest from vanishing.
            self.hypotheses[h].weight *= exp(num(-0.5) * (nis - least_nis)) / sqrt(variance);
            sum += self.hypotheses[h].weight;
        }
        self.hypotheses.retain(|hypothesis| hypothesis.weight > num(LIGHTEST) * sum);
        let mut kept = T::ZERO;
        for hypothesis in &self.hypotheses {
            kept += hypothesis.weight;
        }
        for hypothesis in &mut self.hypotheses {
            hypothesis.weight /= kept;
        }
        self.merge_neighbours();
    }

    /// Merges neighbours on the ring: along it, then the last with the first.
    fn merge_neighbours(&mut self) {
        let mut merged: Vec<Hypothesis<T>> = Vec::new();
        for hypothesis in &self.hypotheses {
            match merged.last_mut() {
                Some(last) if last.is_close(hypothesis) => last.absorb(hypothesis),
                _ => merged.push(*hypothesis),
            }
        }
        if merged.len() > 1 {
            let first = merged[0];
            let last = merged.len() - 1;
            if merged[last].is_close(&first) {
                merged[last].absorb(&first);
                merged.remove(0);
            }
        }
        self.hypotheses = merged;
    }

    fn is_plausible(&self) -> bool {
        let proven = self.age < PROBATION || f32::from(self.hits) >= HIT_SHARE * f32::from(self.age);
        self.misses < MISSES && proven && !self.hypotheses.is_empty()
    }

    /// The discovery, once one hypothesis is heavy and small; in Cartesian coordinates.
    fn resolved(&self) -> Option<Discovered<T>> {
        let num = T::of;
        let heaviest = self.heaviest();
        let [aa, ra, rr] = heaviest.covariance;
        let radius = heaviest.radius_m;
        let across2 = aa * square(radius);
        let large = rr + across2 >= num(RESOLVED_TRACE_M2);
        let light = heaviest.weight <= num(RESOLVED_WEIGHT);
        if self.hits < RESOLVED_HITS || light || large || self.misses > 0 {
            return None;
        }
        let [ux, uy] = heaviest.direction;
        let across = ra * radius;
        // rr u u' + across (u t' + t u') + across2 t t', with t = (-uy, ux).
        let xx = rr * square(ux) - num(2.0) * (across * (ux * uy)) + across2 * square(uy);
        let yx = (rr - across2) * (ux * uy) + across * (square(ux) - square(uy));
        let yy = rr * square(uy) + num(2.0) * (across * (ux * uy)) + across2 * square(ux);
        let scale = num(RESOLVED_INFLATION);
        Some(Discovered {
            position_m: [self.origin_m[0] + radius * ux, self.origin_m[1] + radius * uy],
            covariance_m2: [[scale * xx, scale * yx], [scale * yx, scale * yy]],
        })
    }
}

impl<T: Real> Hypothesis<T> {
    /// Five-point regression of the range; `offset` leads from the tag to the origin.
    fn regress(&self, offset: [T; 2], height_m: T) -> Line<T> {
        let num = T::of;
        let [aa, ra, rr] = self.covariance;
        let l11 = sqrt(larger(aa, num(SMALLEST_ANGLE)));
        let l21 = ra / l11;
        let l22 = sqrt(larger(rr - square(l21), num(SMALLEST_RADIUS)));
        let range = |direction: [T; 2], radius: T| {
            let dx = offset[0] + radius * direction[0];
            let dy = offset[1] + radius * direction[1];
            sqrt(square(dx) + square(dy) + square(height_m))
        };
        let here = self.direction;
        let centre = range(here, self.radius_m);
        let (step1a, step1r, step2r) = (num(ROOT_3) * l11, num(ROOT_3) * l21, num(ROOT_3) * l22);
        let [cos, sin] = rotation(step1a);
        let line = FivePoints::new([
            range(turned(here, [cos, sin]), self.radius_m + step1r) - centre,
            range(turned(here, [cos, -sin]), self.radius_m - step1r) - centre,
            range(here, self.radius_m + step2r) - centre,
            range(here, self.radius_m - step2r) - centre,
        ]);
        let over_radius = line.along[1] / l22;
        let over_angle = (line.along[0] - l21 * over_radius) / l11;
        Line {
            range_m: centre + line.mean,
            slope: [over_angle, over_radius],
            residual: line.residual,
            explained: line.explained,
        }
    }

    /// Kalman update; `variance` is the innovation's.
    fn correct(&mut self, line: &Line<T>, innovation: T, variance: T) {
        let num = T::of;
        let [ga, gr] = line.slope;
        let [aa, ra, rr] = self.covariance;
        let (wa, wr) = (ga * aa + gr * ra, ga * ra + gr * rr);
        // No update shrinks a variance by more than 2^-10.
        let variance = larger(variance, line.explained * (T::ONE + T::ONE / num(1024.0)));
        let (ka, kr) = (wa / variance, wr / variance);
        self.turn(ka * innovation);
        self.radius_m += kr * innovation;
        self.covariance = [
            larger(aa - ka * wa, num(SMALLEST_ANGLE)),
            ra - kr * wa,
            larger(rr - kr * wr, num(SMALLEST_RADIUS)),
        ];
    }

    /// Turns by an angle, and restores the direction's length.
    fn turn(&mut self, angle: T) {
        let [x, y] = turned(self.direction, rotation(angle));
        let length = sqrt(square(x) + square(y));
        self.direction = [x / length, y / length];
    }

    /// Angle from this hypothesis to another: 2 tan(a/2) = 2 sin a / (1 + cos a).
    fn angle_to(&self, other: &Self) -> T {
        let num = T::of;
        let ([x, y], [u, v]) = (self.direction, other.direction);
        let (cos, sin) = (x * u + y * v, x * v - y * u);
        num(2.0) * sin / larger(T::ONE + cos, num(1e-3))
    }

    /// Whether the squared Mahalanobis distance, under both covariances together, is small. Order: as a quadratic form
    /// against the determinant, without a division.
    fn is_close(&self, other: &Self) -> bool {
        let ([x, y], [u, v]) = (self.direction, other.direction);
        if x * u + y * v <= T::ZERO {
            return false;
        }
        let num = T::of;
        let da = self.angle_to(other);
        let dr = other.radius_m - self.radius_m;
        let aa = self.covariance[0] + other.covariance[0];
        let ra = self.covariance[1] + other.covariance[1];
        let rr = self.covariance[2] + other.covariance[2];
        let form = rr * square(da) - num(2.0) * (ra * (da * dr)) + aa * square(dr);
        form < num(MERGE_DISTANCE2) * (aa * rr - square(ra))
    }

    /// Becomes the Gaussian with the moments of both.
    fn absorb(&mut self, other: &Self) {
        let weight = self.weight + other.weight;
        let (a, b) = (self.weight / weight, other.weight / weight);
        let da = self.angle_to(other);
        let dr = other.radius_m - self.radius_m;
        let apart = [square(da), da * dr, square(dr)];
        for entry in 0..3 {
            self.covariance[entry] =
                a * self.covariance[entry] + b * other.covariance[entry] + a * b * apart[entry];
        }
        self.turn(b * da);
        self.radius_m += b * dr;
        self.weight = weight;
    }
}

/// Cosine and sine of an angle a given as 2 tan(a/2). Order: times the inverse of the denominator.
fn rotation<T: Real>(angle: T) -> [T; 2] {
    let num = T::of;
    let scale = T::ONE / (num(4.0) + square(angle));
    [(num(4.0) - square(angle)) * scale, num(4.0) * angle * scale]
}

/// A direction turned by an angle given by its cosine and sine.
fn turned<T: Real>(direction: [T; 2], rotation: [T; 2]) -> [T; 2] {
    let ([x, y], [cos, sin]) = (direction, rotation);
    [x * cos - y * sin, x * sin + y * cos]
}
