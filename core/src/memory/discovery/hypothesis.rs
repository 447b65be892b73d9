//! One hypothesis of where a virtual anchor is: a Gaussian in polar coordinates around the place where its candidate was
//! first heard, with its covariance with the agent.
//!
//! In polar coordinates the first range is linear and later ones nearly so; a Cartesian Gaussian would cut the
//! circle's corners and grow overconfident. The direction is a unit vector; an angle a away from it is the
//! parameter t = 2 tan(a / 2), which needs no trigonometric function: cos a = (4 - t^2) / (4 + t^2),
//! sin a = 4 t / (4 + t^2).
//!
//! The joint covariance with the tag's position, seen by this hypothesis alone, is explained in `common_motion`.

use super::common_motion::{Correction, Prediction, applied, inverse, precision};
use crate::model::matrix::product;
use crate::model::range::{FivePoints, SIGMA_POINT, height_variance_m2};
use crate::model::soft_update::{Moments, SoftUpdate};
use crate::real::{larger, sqrt};
use crate::snapshot::stored;
use nalgebra::{Matrix2, Vector2};

/// Guard: against the division by its root: least variance of an angle.
pub const LEAST_ANGLE: f32 = 1e-14;
/// Guard: against the division by its root: least variance of a radius, square metres.
pub const LEAST_RADIUS_M2: f32 = 1e-12;
/// Guard: against a covariance that is not positive: least variance of the tag's position, square metres.
pub const LEAST_TAG_M2: f32 = 1e-12;

/// One place where the virtual anchor may be, seen from the candidate's origin.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Hypothesis {
    /// Direction, a unit vector.
    pub direction: [f32; 2],
    /// Horizontal distance, metres.
    pub radius_m: f32,
    /// Covariance: angle-angle, radius-angle, radius-radius (angles as 2 tan(a / 2)).
    pub covariance: [f32; 3],
    /// Covariance of angle and radius (rows) with the tag's position.
    pub cross: Matrix2<f32>,
    /// Where this hypothesis sees the tag, relative to the state filter, metres; and its covariance.
    pub tag_shift_m: Vector2<f32>,
    pub tag_covariance: Matrix2<f32>,
    pub weight: f32,
}

/// Regression of a range on angle, radius and the tag's position.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PolarRegression {
    pub range_m: f32,
    /// Covariances of the range with angle and radius, and with the tag's position.
    own: [f32; 2],
    tag: [f32; 2],
    /// Variance of the expected range, square metres.
    pub variance_m2: f32,
}

impl Hypothesis {
    /// Five-point regression of the range over angle and radius, and its slope over the tag's position; `offset` leads
    /// from the tag, as the state filter sees it, to the origin.
    pub fn regress(&self, offset: [f32; 2], height_m: f32, height_std_m: f32) -> PolarRegression {
        let [ox, oy] = offset;
        let (ox, oy) = (ox - self.tag_shift_m.x, oy - self.tag_shift_m.y);
        let [aa, ra, rr] = self.covariance;
        let l11 = sqrt(larger(aa, LEAST_ANGLE));
        let l21 = ra / l11;
        let l22 = sqrt(larger(rr - l21 * l21, LEAST_RADIUS_M2));
        let height2 = height_m * height_m;
        let range = |[ux, uy]: [f32; 2], radius: f32| {
            let (dx, dy) = (ox + radius * ux, oy + radius * uy);
            sqrt(dx * dx + dy * dy + height2)
        };
        let here = self.direction;
        let turn = rotation(SIGMA_POINT * l11);
        let [c, s] = turn;
        let centre = range(here, self.radius_m);
        let a1 = range(turned(here, turn), self.radius_m + SIGMA_POINT * l21) - centre;
        let b1 = range(turned(here, [c, -s]), self.radius_m - SIGMA_POINT * l21) - centre;
        let a2 = range(here, self.radius_m + SIGMA_POINT * l22) - centre;
        let b2 = range(here, self.radius_m - SIGMA_POINT * l22) - centre;
        let FivePoints { offset, along: [along1, along2], residual, .. } =
            FivePoints::new([a1, b1], [a2, b2]);
        let gr = along2 / l22;
        let ga = (along1 - l21 * gr) / l11;
        // The tag moving away from the virtual anchor lengthens the range.
        let [ux, uy] = here;
        let slant = larger(centre, 1e-3);
        let (px, py) = (-(ox + self.radius_m * ux) / slant, -(oy + self.radius_m * uy) / slant);
        let (c, t) = (&self.cross, &self.tag_covariance);
        let own_a = ga * aa + gr * ra + (px * c.m11 + py * c.m12);
        let own_r = ga * ra + gr * rr + (px * c.m21 + py * c.m22);
        let tag_x = ga * c.m11 + gr * c.m21 + (px * t.m11 + py * t.m21);
        let tag_y = ga * c.m12 + gr * c.m22 + (px * t.m21 + py * t.m22);
        let of_height = height_variance_m2(height_m, height_std_m, centre);
        let linear = ga * own_a + gr * own_r + (px * tag_x + py * tag_y);
        PolarRegression {
            range_m: centre + offset,
            own: [own_a, own_r],
            tag: [tag_x, tag_y],
            variance_m2: larger(linear, LEAST_RADIUS_M2) + (residual + of_height),
        }
    }

    /// Update by the ranges associated with the hypothesis, with total probability `weight`, first and
    /// second moment of the innovations, and `variance` that of an innovation.
    pub fn correct(&mut self, line: &PolarRegression, associated: &Moments, variance: f32) {
        let [wa, wr] = line.own;
        let [aa, ra, rr] = self.covariance;
        let change = SoftUpdate::new(associated, variance, line.variance_m2);
        let scale = change.covariance;
        let (ka, kr) = (scale * wa, scale * wr);
        self.turn(wa * change.mean);
        self.radius_m += wr * change.mean;
        self.covariance =
            [larger(aa + ka * wa, LEAST_ANGLE), ra + kr * wa, larger(rr + kr * wr, LEAST_RADIUS_M2)];
        let [tx, ty] = line.tag;
        self.cross += Matrix2::new(ka * tx, ka * ty, kr * tx, kr * ty);
        self.tag_shift_m += Vector2::new(tx * change.mean, ty * change.mean);
        let (kx, ky) = (scale * tx, scale * ty);
        let t = &mut self.tag_covariance;
        *t = Matrix2::new(
            larger(t.m11 + kx * tx, LEAST_TAG_M2),
            t.m21 + ky * tx,
            t.m21 + ky * tx,
            larger(t.m22 + ky * ty, LEAST_TAG_M2),
        );
    }

    /// The state filter has predicted.
    pub fn predict(&mut self, step: &Prediction) {
        let across = step.transition.transpose();
        self.cross = product(&self.cross, &across);
        self.tag_shift_m = applied(&step.transition, &self.tag_shift_m);
        let carried = product(&product(&step.transition, &self.tag_covariance), &across);
        self.tag_covariance = Matrix2::new(
            carried.m11 + step.noise.m11,
            carried.m21 + step.noise.m21,
            carried.m21 + step.noise.m21,
            carried.m22 + step.noise.m22,
        );
    }

    /// The state filter has updated: with T the tag's covariance and B = (I + T J)^-1, T <- B T, h <- h + C J_r and
    /// C_hh <- C_hh - C J B C'.
    pub fn follow(&mut self, step: &Correction) {
        let j = &step.information;
        let t = self.tag_covariance;
        let tj = product(&t, j);
        let b = inverse(&Matrix2::new(1.0 + tj.m11, tj.m12, tj.m21, 1.0 + tj.m22), 1.0);
        let lacking = step.vector - applied(j, &self.tag_shift_m);
        let posterior = product(&b, &t);
        // (I + J T)^-1 = B'.
        let through = b.transpose();
        let moved = applied(&self.cross, &applied(&through, &lacking));
        let shrunk = product(&product(&self.cross, &product(j, &b)), &self.cross.transpose());
        let [aa, ra, rr] = self.covariance;
        self.covariance =
            [larger(aa - shrunk.m11, LEAST_ANGLE), ra - shrunk.m21, larger(rr - shrunk.m22, LEAST_RADIUS_M2)];
        self.tag_shift_m += applied(&posterior, &lacking) - step.shift;
        self.cross = product(&self.cross, &through);
        self.tag_covariance = Matrix2::new(
            larger(posterior.m11, LEAST_TAG_M2),
            posterior.m21,
            posterior.m21,
            larger(posterior.m22, LEAST_TAG_M2),
        );
        self.turn(moved.x);
        self.radius_m += moved.y;
    }

    /// What it says of the virtual anchor given the tag's position, in Cartesian coordinates around `origin_m`: expected
    /// position where the state filter sees the tag, its slope over that, and the covariance left.
    pub fn given_tag(&self, origin_m: [f32; 2]) -> (Vector2<f32>, Matrix2<f32>, Matrix2<f32>) {
        let [ux, uy] = self.direction;
        let radius = self.radius_m;
        // (dx, dy) = D (angle, radius).
        let d = Matrix2::new(-(radius * uy), ux, radius * ux, uy);
        let polar_gain = product(&self.cross, &precision(&self.tag_covariance));
        let explained = product(&polar_gain, &self.cross.transpose());
        let [aa, ra, rr] = self.covariance;
        let left = Matrix2::new(
            larger(aa - explained.m11, LEAST_ANGLE),
            ra - explained.m21,
            ra - explained.m21,
            larger(rr - explained.m22, LEAST_RADIUS_M2),
        );
        let own = product(&product(&d, &left), &d.transpose());
        let gain = product(&d, &polar_gain);
        let [ox, oy] = origin_m;
        let here = Vector2::new(ox + radius * ux, oy + radius * uy);
        (here - applied(&gain, &self.tag_shift_m), gain, own)
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

    /// Whether it lies within 60 degrees of another: farther away, angle parameters mean nothing.
    pub fn is_beside(&self, other: &Hypothesis) -> bool {
        let ([x, y], [u, v]) = (self.direction, other.direction);
        x * u + y * v > 0.5
    }

    /// Whether it is within one standard deviation of another: Mahalanobis distance under the sum of both covariances.
    pub fn is_close(&self, other: &Hypothesis) -> bool {
        if !self.is_beside(other) {
            return false;
        }
        let da = self.angle_to(other);
        let dr = other.radius_m - self.radius_m;
        let [saa, sra, srr] = self.covariance;
        let [oaa, ora, orr] = other.covariance;
        let (aa, ra, rr) = (saa + oaa, sra + ora, srr + orr);
        let determinant = aa * rr - ra * ra;
        let form = rr * (da * da) - 2.0 * (ra * (da * dr)) + aa * (dr * dr);
        form < determinant
    }

    /// Moment-matched union of two hypotheses.
    pub fn absorb(&mut self, other: &Hypothesis) {
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
        let away = other.tag_shift_m - self.tag_shift_m;
        let mixed = |own: f32, others: f32, u: f32, v: f32| a * own + b * others + apart * (u * v);
        let (c, o) = (&self.cross, &other.cross);
        self.cross = Matrix2::new(
            mixed(c.m11, o.m11, da, away.x),
            mixed(c.m12, o.m12, da, away.y),
            mixed(c.m21, o.m21, dr, away.x),
            mixed(c.m22, o.m22, dr, away.y),
        );
        let (t, o) = (&self.tag_covariance, &other.tag_covariance);
        let yx = mixed(t.m21, o.m21, away.x, away.y);
        self.tag_covariance =
            Matrix2::new(mixed(t.m11, o.m11, away.x, away.x), yx, yx, mixed(t.m22, o.m22, away.y, away.y));
        self.tag_shift_m += Vector2::new(b * away.x, b * away.y);
        self.weight = weight;
    }

    /// Every number, in a fixed order, for traces.
    pub fn visit(&self, f: &mut impl FnMut(f32)) {
        self.direction.iter().for_each(|v| f(*v));
        f(self.radius_m);
        self.covariance.iter().for_each(|v| f(*v));
        self.cross.iter().for_each(|v| f(*v));
        self.tag_shift_m.iter().for_each(|v| f(*v));
        self.tag_covariance.iter().for_each(|v| f(*v));
        f(self.weight);
    }
}

/// Cosine and sine of the angle whose parameter 2 tan(a / 2) is given.
fn rotation(parameter: f32) -> [f32; 2] {
    let square = parameter * parameter;
    let scale = 1.0 / (4.0 + square);
    [(4.0 - square) * scale, 4.0 * parameter * scale]
}

/// A direction turned by a rotation (cosine, sine).
pub(super) fn turned([x, y]: [f32; 2], [c, s]: [f32; 2]) -> [f32; 2] {
    [x * c - y * s, x * s + y * c]
}

stored!(
    blank Hypothesis { direction, radius_m, covariance, cross, tag_shift_m, tag_covariance, weight }
);
