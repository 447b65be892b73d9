//! Discovery: virtual anchors that no floor plan told of, from the paths that association left over.
//!
//! A range alone puts a virtual anchor on a circle around the tag. A candidate therefore starts as a ring of
//! Gaussian hypotheses in polar coordinates around the place it was first heard at, where that first range is
//! linear and later ones nearly so (a Cartesian Gaussian would cut the circle's corners and grow overconfident).
//! The direction is a unit vector; an angle a away from it is the parameter t = 2 tan(a / 2), which needs no
//! trigonometric function: cos a = (4 - t^2) / (4 + t^2), sin a = 4 t / (4 + t^2).
//! Every later range updates each hypothesis by a five-point regression and weighs it by its likelihood. Motion
//! along a line leaves two mirror images, a turn leaves one; a candidate is resolved when one hypothesis holds
//! nearly all weight and is small. Bounded: [`CANDIDATES`] per anchor, [`HYPOTHESES`] each.
//!
//! The tag's own uncertainty is added in part to each range variance (`TAG_SHARE`): over the window of a
//! candidate the tag's error is mostly a common shift, which [`StateFilter::insert_relative`] accounts for when
//! the candidate joins the map.
//!
//! [`StateFilter::insert_relative`]: super::state_filter::StateFilter::insert_relative

use super::association::Measurement;
use crate::real::{exp, larger, smaller, sqrt};
use heapless::Vec;
use nalgebra::{Matrix2, Vector2};

/// Candidates per anchor.
pub const CANDIDATES: usize = 8;
/// Hypotheses per candidate.
pub const HYPOTHESES: usize = 16;

/// Direction of a ring's first hypothesis, at pi / 16, and the rotation to each next one, pi / 8: 16 in all.
const FIRST_DIRECTION: [f32; 2] = [0.980_785_25, 0.195_090_32];
const NEXT_DIRECTION: [f32; 2] = [0.923_879_5, 0.382_683_43];
/// Gate, standard deviations.
const GATE: f32 = 3.0;
/// Share of the tag's position variance that counts as independent between scans.
const TAG_SHARE: f32 = 0.3;
/// Hypotheses lighter than this are dropped.
const LIGHTEST: f32 = 1e-3;
/// Neighbouring hypotheses whose squared Mahalanobis distance is below this are merged.
const MERGE_DISTANCE2: f32 = 1.0;
/// Scans in a row without a range after which a candidate is dropped.
const MISSES: u16 = 8;
/// From this age on, the share of scans with a range must be at least `HIT_SHARE`.
const PROBATION: u16 = 8;
const HIT_SHARE: f32 = 0.6;
/// A ring is drawn only once the tag is known this much better than the range (variances), or to 5 cm: while the
/// estimate still moves by corrections, these would look like motion and resolve what motion has not.
const SETTLED_SHARE: f32 = 0.6;
const SETTLED_M2: f32 = 2.5e-3;
/// Resolved: at least this many ranges,
const RESOLVED_HITS: u16 = 100;
/// this much weight on one hypothesis,
const RESOLVED_WEIGHT: f32 = 0.999;
/// and a variance trace below (0.4 m)^2.
const RESOLVED_TRACE_M2: f32 = 0.16;
/// Candidates' covariances are multiplied by this on resolution: their ranges were chosen by nearest
/// neighbour and the tag's error is only shared in part.
const RESOLVED_INFLATION: f32 = 3.0;

/// One place where the virtual anchor may be, seen from the candidate's origin.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Hypothesis {
    /// Direction, a unit vector.
    pub direction: [f32; 2],
    /// Horizontal distance, metres.
    pub radius_m: f32,
    /// Covariance: angle-angle, radius-angle, radius-radius (angles as 2 tan(a / 2)).
    pub covariance: [f32; 3],
    pub weight: f32,
}

/// Regression of a range on angle and radius.
#[derive(Clone, Copy, Debug)]
struct PolarRegression {
    range_m: f32,
    /// Slopes over angle and radius.
    slope: [f32; 2],
    residual_m2: f32,
    explained_m2: f32,
}

/// A virtual anchor in the making.
#[derive(Clone, Debug)]
pub(crate) struct Candidate {
    /// Where the tag was when the candidate was first heard, metres.
    pub origin_m: [f32; 2],
    pub hypotheses: Vec<Hypothesis, HYPOTHESES>,
    pub hits: u16,
    pub age: u16,
    pub misses: u16,
}

/// A virtual anchor found: its position, and its covariance relative to the tag's position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Discovered {
    /// Position, metres.
    pub position: Vector2<f32>,
    /// Covariance, square metres, without the share of the tag's own error.
    pub covariance: Matrix2<f32>,
}

/// Where the tag is believed to be while candidates are updated.
#[derive(Clone, Copy, Debug)]
pub struct Viewpoint {
    /// Position of the tag, metres.
    pub position_m: [f32; 2],
    /// Its covariance, square metres.
    pub covariance_m2: Matrix2<f32>,
    /// Height of the anchor (and so of its images in walls) above the tag, metres.
    pub height_m: f32,
}

/// The candidates of every anchor.
#[derive(Clone, Debug)]
pub struct Discovery<const ANCHORS: usize> {
    candidates: [Vec<Candidate, CANDIDATES>; ANCHORS],
}

impl<const ANCHORS: usize> Default for Discovery<ANCHORS> {
    fn default() -> Self {
        Self { candidates: core::array::from_fn(|_| Vec::new()) }
    }
}

impl<const ANCHORS: usize> Discovery<ANCHORS> {
    /// Number of candidates of an anchor.
    pub fn candidates(&self, anchor: usize) -> usize {
        self.candidates.get(anchor).map_or(0, |candidates| candidates.len())
    }

    /// Gives an anchor's leftover measurements (bias removed) to its candidates: the pair with the smallest
    /// normalised distance first. Leftovers of the leftovers become new candidates.
    pub fn observe<const PATHS: usize>(
        &mut self,
        anchor: usize,
        viewpoint: &Viewpoint,
        leftovers: &Vec<Measurement, PATHS>,
    ) {
        let Some(candidates) = self.candidates.get_mut(anchor) else { return };
        let mut used = [false; PATHS];
        let mut expectations: Vec<Option<(f32, f32)>, CANDIDATES> = Vec::new();
        for candidate in candidates.iter() {
            // Capacities are equal: every push succeeds.
            let _ = expectations.push(Some(candidate.expectation(viewpoint)));
        }
        for _ in 0..CANDIDATES {
            let mut nearest: Option<(usize, usize, f32)> = None;
            for (i, expectation) in expectations.iter().enumerate() {
                let Some((range_m, variance_m2)) = *expectation else { continue };
                for (m, (measurement, taken)) in leftovers.iter().zip(&used).enumerate() {
                    if *taken {
                        continue;
                    }
                    let innovation = measurement.range_m - range_m;
                    let nis = innovation * innovation / (variance_m2 + measurement.variance_m2);
                    if nis < GATE * GATE && nearest.is_none_or(|(_, _, least)| nis < least) {
                        nearest = Some((i, m, nis));
                    }
                }
            }
            let Some((i, m, _)) = nearest else { break };
            if let Some(expectation) = expectations.get_mut(i) {
                *expectation = None;
            }
            if let Some(taken) = used.get_mut(m) {
                *taken = true;
            }
            if let (Some(candidate), Some(measurement)) = (candidates.get_mut(i), leftovers.get(m)) {
                candidate.update(viewpoint, measurement);
            }
        }
        // Whoever still has an expectation got no range.
        for (candidate, expectation) in candidates.iter_mut().zip(&expectations) {
            candidate.age = candidate.age.saturating_add(1);
            if expectation.is_some() {
                candidate.misses += 1;
            }
        }
        candidates.retain(Candidate::is_plausible);
        let tag = 0.5 * (viewpoint.covariance_m2.m11 + viewpoint.covariance_m2.m22);
        for (measurement, taken) in leftovers.iter().zip(&used) {
            let settled = tag < larger(SETTLED_SHARE * measurement.variance_m2, SETTLED_M2);
            if !taken && settled && !candidates.is_full() {
                let _ = candidates.push(Candidate::ring(viewpoint, measurement));
            }
        }
    }

    /// Takes a resolved candidate of an anchor out, if there is one.
    pub fn take_resolved(&mut self, anchor: usize) -> Option<Discovered> {
        let candidates = self.candidates.get_mut(anchor)?;
        let mut found = None;
        candidates.retain(|candidate| {
            if found.is_none() {
                found = candidate.resolved();
                found.is_none()
            } else {
                true
            }
        });
        found
    }

    /// Every number of the state, in a fixed order, for traces.
    pub fn visit(&self, mut f: impl FnMut(f32)) {
        for candidates in &self.candidates {
            f(candidates.len() as f32);
        }
        for candidate in self.candidates.iter().flatten() {
            f(candidate.hypotheses.len() as f32);
            f(f32::from(candidate.hits));
            f(f32::from(candidate.age));
            f(f32::from(candidate.misses));
            candidate.origin_m.iter().for_each(|v| f(*v));
            for hypothesis in &candidate.hypotheses {
                hypothesis.direction.iter().for_each(|v| f(*v));
                f(hypothesis.radius_m);
                hypothesis.covariance.iter().for_each(|v| f(*v));
                f(hypothesis.weight);
            }
        }
    }
}

impl Candidate {
    /// A ring of hypotheses around the tag, each as wide along the ring as half its share of it.
    fn ring(viewpoint: &Viewpoint, measurement: &Measurement) -> Self {
        let slant = measurement.range_m;
        let height = viewpoint.height_m;
        let radius_m = sqrt(larger(slant * slant - height * height, 1e-4));
        // d radius = (slant / radius) d slant.
        let stretch = slant / radius_m;
        let half_angle = core::f32::consts::PI / HYPOTHESES as f32;
        let mut hypotheses = Vec::new();
        let mut direction = FIRST_DIRECTION;
        for _ in 0..HYPOTHESES {
            let hypothesis = Hypothesis {
                direction,
                radius_m,
                covariance: [half_angle * half_angle, 0.0, measurement.variance_m2 * (stretch * stretch)],
                weight: 1.0 / HYPOTHESES as f32,
            };
            // The loop runs to the capacity: every push succeeds.
            let _ = hypotheses.push(hypothesis);
            direction = turned(direction, NEXT_DIRECTION);
        }
        Self { origin_m: viewpoint.position_m, hypotheses, hits: 1, age: 1, misses: 0 }
    }

    /// Mean and variance of the range that the mixture expects, the tag's share included.
    fn expectation(&self, viewpoint: &Viewpoint) -> (f32, f32) {
        let offset = self.offset(viewpoint);
        let mut mean = 0.0;
        let mut second = 0.0;
        // Relative to the first hypothesis, so that the variance keeps its digits.
        let mut origin = None;
        for hypothesis in &self.hypotheses {
            let line = hypothesis.regress(offset, viewpoint.height_m);
            let relative = line.range_m - *origin.get_or_insert(line.range_m);
            mean += hypothesis.weight * relative;
            second += hypothesis.weight * (relative * relative + line.explained_m2 + line.residual_m2);
        }
        let tag = TAG_SHARE * 0.5 * (viewpoint.covariance_m2.m11 + viewpoint.covariance_m2.m22);
        (origin.unwrap_or(0.0) + mean, larger(second - mean * mean, 0.0) + tag)
    }

    fn update(&mut self, viewpoint: &Viewpoint, measurement: &Measurement) {
        self.hits = self.hits.saturating_add(1);
        self.misses = 0;
        let offset = self.offset(viewpoint);
        let tag = self.heaviest().map_or(0.0, |heaviest| {
            // Unit vector from the hypothesis to the tag, horizontally.
            let [ox, oy] = offset;
            let [ux, uy] = heaviest.direction;
            let dx = -ox - heaviest.radius_m * ux;
            let dy = -oy - heaviest.radius_m * uy;
            let length2 = larger(dx * dx + dy * dy, 1e-6);
            let c = &viewpoint.covariance_m2;
            (dx * dx * c.m11 + 2.0 * (dx * dy) * c.m21 + dy * dy * c.m22) / length2
        });
        let noise = measurement.variance_m2 + TAG_SHARE * tag;
        let mut least_nis = f32::INFINITY;
        let mut evidence: Vec<(f32, f32), HYPOTHESES> = Vec::new();
        for hypothesis in &mut self.hypotheses {
            let line = hypothesis.regress(offset, viewpoint.height_m);
            let variance = line.explained_m2 + line.residual_m2 + noise;
            let innovation = measurement.range_m - line.range_m;
            hypothesis.correct(&line, innovation, variance);
            let nis = innovation * innovation / variance;
            least_nis = smaller(nis, least_nis);
            // Capacities are equal: every push succeeds.
            let _ = evidence.push((nis, variance));
        }
        let mut sum = 0.0;
        for (hypothesis, (nis, variance)) in self.hypotheses.iter_mut().zip(&evidence) {
            hypothesis.weight *= exp(-0.5 * (nis - least_nis)) / sqrt(*variance);
            sum += hypothesis.weight;
        }
        let mut kept = 0.0;
        self.hypotheses.retain(|hypothesis| {
            let keep = hypothesis.weight > LIGHTEST * sum;
            if keep {
                kept += hypothesis.weight;
            }
            keep
        });
        for hypothesis in &mut self.hypotheses {
            hypothesis.weight /= kept;
        }
        self.merge_neighbours();
    }

    /// From the tag to the origin, metres.
    fn offset(&self, viewpoint: &Viewpoint) -> [f32; 2] {
        let [x, y] = viewpoint.position_m;
        let [ox, oy] = self.origin_m;
        [ox - x, oy - y]
    }

    /// Merges hypotheses that ran together. They stay in the order of the ring, so only neighbours can.
    fn merge_neighbours(&mut self) {
        let mut merged: Vec<Hypothesis, HYPOTHESES> = Vec::new();
        for hypothesis in &self.hypotheses {
            if let Some(last) = merged.last_mut()
                && last.is_close(hypothesis)
            {
                last.absorb(hypothesis);
                continue;
            }
            // Capacities are equal: every push succeeds.
            let _ = merged.push(*hypothesis);
        }
        if merged.len() > 1
            && let Some(first) = merged.first().copied()
            && let Some(last) = merged.last_mut()
            && last.is_close(&first)
        {
            last.absorb(&first);
            let mut is_first = true;
            merged.retain(|_| !core::mem::take(&mut is_first));
        }
        self.hypotheses = merged;
    }

    fn heaviest(&self) -> Option<&Hypothesis> {
        self.hypotheses
            .iter()
            .reduce(|best, hypothesis| if hypothesis.weight > best.weight { hypothesis } else { best })
    }

    fn is_plausible(&self) -> bool {
        let proven = self.age < PROBATION || f32::from(self.hits) >= HIT_SHARE * f32::from(self.age);
        self.misses < MISSES && proven && !self.hypotheses.is_empty()
    }

    fn resolved(&self) -> Option<Discovered> {
        let heaviest = self.heaviest()?;
        let [aa, ra, rr] = heaviest.covariance;
        let radius = heaviest.radius_m;
        let across2 = aa * (radius * radius);
        if self.hits < RESOLVED_HITS
            || heaviest.weight <= RESOLVED_WEIGHT
            || rr + across2 >= RESOLVED_TRACE_M2
            // A candidate that has just missed may be dying.
            || self.misses > 0
        {
            return None;
        }
        let [ux, uy] = heaviest.direction;
        let across = ra * radius;
        let scale = RESOLVED_INFLATION;
        // C = rr u u' + across (u t' + t u') + across2 t t', t = (-uy, ux).
        let xx = rr * (ux * ux) - 2.0 * (across * (ux * uy)) + across2 * (uy * uy);
        let yx = (rr - across2) * (ux * uy) + across * (ux * ux - uy * uy);
        let yy = rr * (uy * uy) + 2.0 * (across * (ux * uy)) + across2 * (ux * ux);
        let [ox, oy] = self.origin_m;
        Some(Discovered {
            position: Vector2::new(ox + radius * ux, oy + radius * uy),
            covariance: Matrix2::new(scale * xx, scale * yx, scale * yx, scale * yy),
        })
    }
}

impl Hypothesis {
    /// Five-point regression of the range over angle and radius; `offset` leads from the tag to the origin.
    fn regress(&self, offset: [f32; 2], height_m: f32) -> PolarRegression {
        let [ox, oy] = offset;
        let [aa, ra, rr] = self.covariance;
        let l11 = sqrt(larger(aa, 1e-14));
        let l21 = ra / l11;
        let l22 = sqrt(larger(rr - l21 * l21, 1e-12));
        let root3 = 1.732_050_8;
        let height2 = height_m * height_m;
        let range = |[ux, uy]: [f32; 2], radius: f32| {
            let (dx, dy) = (ox + radius * ux, oy + radius * uy);
            sqrt(dx * dx + dy * dy + height2)
        };
        let here = self.direction;
        let turn = rotation(root3 * l11);
        let [c, s] = turn;
        let centre = range(here, self.radius_m);
        let a1 = range(turned(here, turn), self.radius_m + root3 * l21) - centre;
        let b1 = range(turned(here, [c, -s]), self.radius_m - root3 * l21) - centre;
        let a2 = range(here, self.radius_m + root3 * l22) - centre;
        let b2 = range(here, self.radius_m - root3 * l22) - centre;
        let mean = (a1 + b1 + a2 + b2) * (1.0 / 6.0);
        let along1 = (a1 - b1) * (0.5 / root3);
        let along2 = (a2 - b2) * (0.5 / root3);
        let second = (a1 * a1 + b1 * b1 + a2 * a2 + b2 * b2) * (1.0 / 6.0);
        let explained_m2 = along1 * along1 + along2 * along2;
        let over_radius = along2 / l22;
        let over_angle = (along1 - l21 * over_radius) / l11;
        PolarRegression {
            range_m: centre + mean,
            slope: [over_angle, over_radius],
            residual_m2: larger(second - mean * mean - explained_m2, 0.0),
            explained_m2,
        }
    }

    /// Kalman update by one range.
    fn correct(&mut self, line: &PolarRegression, innovation: f32, variance: f32) {
        let [ga, gr] = line.slope;
        let [aa, ra, rr] = self.covariance;
        let (wa, wr) = (ga * aa + gr * ra, ga * ra + gr * rr);
        // As in the state filter, no update shrinks a variance by more than 2^-10 at once.
        let variance = larger(variance, line.explained_m2 * (1.0 + 1.0 / 1024.0));
        let (ka, kr) = (wa / variance, wr / variance);
        self.turn(ka * innovation);
        self.radius_m += kr * innovation;
        self.covariance = [larger(aa - ka * wa, 1e-14), ra - kr * wa, larger(rr - kr * wr, 1e-12)];
    }

    /// Turns by an angle parameter, and restores the direction's length.
    fn turn(&mut self, parameter: f32) {
        let [x, y] = turned(self.direction, rotation(parameter));
        let length = sqrt(x * x + y * y);
        self.direction = [x / length, y / length];
    }

    /// Parameter of the angle from this hypothesis to another.
    fn angle_to(&self, other: &Hypothesis) -> f32 {
        let ([x, y], [u, v]) = (self.direction, other.direction);
        let (dot, cross) = (x * u + y * v, x * v - y * u);
        2.0 * cross / larger(1.0 + dot, 1e-3)
    }

    /// Squared Mahalanobis distance under the sum of both covariances, against the merging distance.
    fn is_close(&self, other: &Hypothesis) -> bool {
        let ([x, y], [u, v]) = (self.direction, other.direction);
        if x * u + y * v <= 0.0 {
            // Mirror images across the way: the angle's parameter means nothing so far apart.
            return false;
        }
        let da = self.angle_to(other);
        let dr = other.radius_m - self.radius_m;
        let [saa, sra, srr] = self.covariance;
        let [oaa, ora, orr] = other.covariance;
        let (aa, ra, rr) = (saa + oaa, sra + ora, srr + orr);
        let determinant = aa * rr - ra * ra;
        let form = rr * (da * da) - 2.0 * (ra * (da * dr)) + aa * (dr * dr);
        form < MERGE_DISTANCE2 * determinant
    }

    /// Moment-matched union of two hypotheses.
    fn absorb(&mut self, other: &Hypothesis) {
        let weight = self.weight + other.weight;
        let (a, b) = (self.weight / weight, other.weight / weight);
        let da = self.angle_to(other);
        let dr = other.radius_m - self.radius_m;
        self.turn(b * da);
        self.radius_m += b * dr;
        let [saa, sra, srr] = self.covariance;
        let [oaa, ora, orr] = other.covariance;
        let apart = a * b;
        self.covariance = [
            a * saa + b * oaa + apart * (da * da),
            a * sra + b * ora + apart * (da * dr),
            a * srr + b * orr + apart * (dr * dr),
        ];
        self.weight = weight;
    }
}

/// Cosine and sine of the angle whose parameter 2 tan(a / 2) is given.
fn rotation(parameter: f32) -> [f32; 2] {
    let square = parameter * parameter;
    let scale = 1.0 / (4.0 + square);
    [(4.0 - square) * scale, 4.0 * parameter * scale]
}

/// A direction turned by a rotation (cosine, sine).
fn turned([x, y]: [f32; 2], [c, s]: [f32; 2]) -> [f32; 2] {
    [x * c - y * s, x * s + y * c]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn walk(points: impl Iterator<Item = [f32; 2]>, truth: [f32; 2]) -> Option<Discovered> {
        let mut discovery = Discovery::<1>::default();
        let mut noise = 0.013;
        for [x, y] in points {
            let viewpoint = Viewpoint {
                position_m: [x, y],
                covariance_m2: Matrix2::new(1e-4, 0.0, 0.0, 1e-4),
                height_m: 0.0,
            };
            noise = -noise;
            let range_m = (x - truth[0]).hypot(y - truth[1]) + noise;
            let mut leftovers: Vec<Measurement, 4> = Vec::new();
            leftovers.push(Measurement { range_m, variance_m2: 4e-4, sinr: 0.0, energy: 0.0 }).unwrap();
            discovery.observe(0, &viewpoint, &leftovers);
            if let Some(found) = discovery.take_resolved(0) {
                return Some(found);
            }
        }
        None
    }

    #[test]
    fn a_straight_walk_leaves_the_mirror_ambiguity_open() {
        assert!(walk((0..300).map(|n| [0.01 * n as f32, 0.0]), [2.0, 5.0]).is_none());
    }

    #[test]
    fn nor_does_it_resolve_when_the_virtual_anchor_lies_broadside() {
        // The two images then lie in opposite directions.
        for broadside in 0..60 {
            let x = 1.5 + 0.01 * (broadside as f32 - 30.0);
            assert!(walk((0..300).map(|n| [0.01 * n as f32, 0.0]), [x, 4.0]).is_none(), "at {x} m");
        }
    }

    #[test]
    fn a_turn_resolves_it() {
        let bent =
            (0..600).map(|n| if n < 200 { [0.01 * n as f32, 0.0] } else { [2.0, 0.01 * (n - 200) as f32] });
        let found = walk(bent, [2.5, 6.0]).unwrap();
        let (dx, dy) = (found.position.x - 2.5, found.position.y - 6.0);
        assert!(dx.hypot(dy) < 0.3, "{found:?}");
    }
}
