//! One Gaussian of a ring: virtual anchor and tag together.
//!
//! State: angle and radius of the virtual anchor h around the candidate's origin, and the tag's position p, seen by this
//! hypothesis alone. The mean direction is a unit vector; an angle a away from it is held as t = 2 tan(a/2), so
//! cos a = (4 - t^2)/(4 + t^2) and sin a = 4t/(4 + t^2). Covariance in blocks: C_hh, C = C_hp, and T = C_pp.

use super::common_motion::{Correction, Prediction, applied, inverse, precision};
use crate::reference::range::{five_points, height_variance_m2};
use crate::reference::real::{Real, larger, sqrt, square};
use crate::reference::soft_update::{Moments, SoftUpdate};
use crate::reference::{Square, product, transposed};
use cogmint_core::memory::discovery::hypothesis::{LEAST_ANGLE, LEAST_RADIUS_M2, LEAST_TAG_M2};
use std::fmt;

/// A hypothesis.
#[derive(Clone, Copy, Debug)]
pub struct Hypothesis<T> {
    /// A unit vector.
    pub direction: [T; 2],
    /// Horizontal distance from the origin, metres.
    pub radius_m: T,
    /// C_hh: angle-angle, radius-angle, radius-radius.
    pub covariance: [T; 3],
    /// C_hp: rows of angle and radius.
    pub cross: Square<T>,
    /// Position of the tag relative to where the state filter sees it, metres.
    pub tag_shift_m: [T; 2],
    /// T, square metres.
    pub tag_covariance: Square<T>,
    /// Its weight in the ring.
    pub weight: T,
}

/// A range as a line over the hypothesis' state.
pub struct Line<T> {
    /// Expected range, metres.
    pub range_m: T,
    /// Covariance of the range with angle and radius,
    with_own: [T; 2],
    /// and with the tag's position.
    with_tag: [T; 2],
    /// Variance of the range, square metres.
    pub variance_m2: T,
}

impl<T: Real> Hypothesis<T> {
    /// The line of the range; `offset` leads from the state filter's tag to the origin. Five sigma points in angle and
    /// radius; the tag moves the range by the cosines of its direction.
    pub fn regress(&self, offset: [T; 2], height: [T; 2]) -> Line<T> {
        let num = T::of;
        let offset = [offset[0] - self.tag_shift_m[0], offset[1] - self.tag_shift_m[1]];
        let [aa, ra, rr] = self.covariance;
        let here = self.direction;
        let line = five_points(self.covariance, [LEAST_ANGLE, LEAST_RADIUS_M2], |[angle, ahead]| {
            let (direction, radius) = (turned(here, rotation(angle)), self.radius_m + ahead);
            let dx = offset[0] + radius * direction[0];
            let dy = offset[1] + radius * direction[1];
            sqrt(square(dx) + square(dy) + square(height[0]))
        });
        let [over_angle, over_radius] = line.slope;
        let slant = larger(line.centre, num(1e-3));
        let mut over_tag = [T::ZERO; 2];
        for axis in 0..2 {
            over_tag[axis] = -(offset[axis] + self.radius_m * here[axis]) / slant;
        }

        // C h of the joint covariance, and h' C h. Order: what belongs to the tag is summed first.
        let joint = [[aa, ra], [ra, rr]];
        let (cross, tag) = (&self.cross, &self.tag_covariance);
        let mut with_own = [T::ZERO; 2];
        let mut with_tag = [T::ZERO; 2];
        for i in 0..2 {
            with_own[i] = over_angle * joint[0][i]
                + over_radius * joint[1][i]
                + (over_tag[0] * cross[i][0] + over_tag[1] * cross[i][1]);
            with_tag[i] = over_angle * cross[0][i]
                + over_radius * cross[1][i]
                + (over_tag[0] * tag[0][i] + over_tag[1] * tag[1][i]);
        }
        let explained = over_angle * with_own[0]
            + over_radius * with_own[1]
            + (over_tag[0] * with_tag[0] + over_tag[1] * with_tag[1]);
        let explained = larger(explained, num(LEAST_RADIUS_M2));
        let residual = line.residual + height_variance_m2(height, line.centre);
        Line { range_m: line.mean, with_own, with_tag, variance_m2: explained + residual }
    }

    /// Soft Kalman update; `variance` is an innovation's.
    pub fn correct(&mut self, line: &Line<T>, moments: &Moments<T>, variance: T) {
        let num = T::of;
        let change = SoftUpdate::new(moments, variance, line.variance_m2);
        let ([wa, wr], [wx, wy]) = (line.with_own, line.with_tag);
        self.turn(wa * change.mean);
        self.radius_m += wr * change.mean;
        self.tag_shift_m[0] += wx * change.mean;
        self.tag_shift_m[1] += wy * change.mean;
        let scale = change.covariance;

        // C <- C + scale w w'. Order: (scale w_row) w_column.
        let [aa, ra, rr] = self.covariance;
        self.covariance = [
            larger(aa + scale * wa * wa, num(LEAST_ANGLE)),
            ra + scale * wr * wa,
            larger(rr + scale * wr * wr, num(LEAST_RADIUS_M2)),
        ];
        for (row, w) in [wa, wr].into_iter().enumerate() {
            self.cross[row][0] += scale * w * wx;
            self.cross[row][1] += scale * w * wy;
        }
        let t = self.tag_covariance;
        let yx = t[1][0] + scale * wy * wx;
        self.set_tag_covariance([t[0][0] + scale * wx * wx, yx, t[1][1] + scale * wy * wy]);
    }

    /// From xx, yx, yy, floored.
    fn set_tag_covariance(&mut self, [xx, yx, yy]: [T; 3]) {
        let least = T::of(LEAST_TAG_M2);
        self.tag_covariance = [[larger(xx, least), yx], [yx, larger(yy, least)]];
    }

    /// p <- A p, C <- C A', T <- A T A' + noise.
    pub fn predict(&mut self, step: &Prediction<T>) {
        let a = &step.transition;
        self.tag_shift_m = applied(a, self.tag_shift_m);
        self.cross = product(&self.cross, &transposed(a));
        let carried = product(&product(a, &self.tag_covariance), &transposed(a));
        for row in 0..2 {
            for column in 0..=row {
                let value = carried[row][column] + step.noise[row][column];
                self.tag_covariance[row][column] = value;
                self.tag_covariance[column][row] = value;
            }
        }
    }

    /// Update by information J on p: with B = (I + T J)^-1, what p lacks e = J z - J p,
    /// p <- p + B T e, h <- h + C B' e, T <- B T, C <- C B', C_hh <- C_hh - C J B C'.
    pub fn follow(&mut self, step: &Correction<T>) {
        let j = &step.information;
        let tj = product(&self.tag_covariance, j);
        let b = inverse(&[[T::ONE + tj[0][0], tj[0][1]], [tj[1][0], T::ONE + tj[1][1]]], T::ONE);
        let claimed = applied(j, self.tag_shift_m);
        let lacking = [step.vector[0] - claimed[0], step.vector[1] - claimed[1]];
        let old = self.cross;
        let [angle, radius] = applied(&old, applied(&transposed(&b), lacking));
        let shrunk = product(&product(&old, &product(j, &b)), &transposed(&old));
        let posterior = product(&b, &self.tag_covariance);

        // Relative to where the state filter sees the tag now.
        let moved = applied(&posterior, lacking);
        for axis in 0..2 {
            self.tag_shift_m[axis] += moved[axis] - step.shift[axis];
        }
        self.set_tag_covariance([posterior[0][0], posterior[1][0], posterior[1][1]]);
        self.cross = product(&old, &transposed(&b));
        let [aa, ra, rr] = self.covariance;
        self.covariance = [
            larger(aa - shrunk[0][0], T::of(LEAST_ANGLE)),
            ra - shrunk[1][0],
            larger(rr - shrunk[1][1], T::of(LEAST_RADIUS_M2)),
        ];
        self.turn(angle);
        self.radius_m += radius;
    }

    /// The virtual anchor given the tag's position, in Cartesian coordinates: mean where the state filter sees the tag,
    /// slope G = D C T^-1, and covariance D (C_hh - C T^-1 C') D', with D = d(x, y) / d(angle, radius).
    pub fn given_tag(&self, origin_m: [T; 2]) -> ([T; 2], Square<T>, Square<T>) {
        let ([ux, uy], radius) = (self.direction, self.radius_m);
        let d = [[-(radius * uy), ux], [radius * ux, uy]];
        let slope = product(&self.cross, &precision(&self.tag_covariance));
        let explained = product(&slope, &transposed(&self.cross));
        let [aa, ra, rr] = self.covariance;
        let cross = ra - explained[1][0];
        let left = [
            [larger(aa - explained[0][0], T::of(LEAST_ANGLE)), cross],
            [cross, larger(rr - explained[1][1], T::of(LEAST_RADIUS_M2))],
        ];
        let gain = product(&d, &slope);
        let back = applied(&gain, self.tag_shift_m);
        let position_m = [origin_m[0] + radius * ux - back[0], origin_m[1] + radius * uy - back[1]];
        (position_m, gain, product(&product(&d, &left), &transposed(&d)))
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

    /// Within 60 degrees of another.
    pub fn is_beside(&self, other: &Self) -> bool {
        let ([x, y], [u, v]) = (self.direction, other.direction);
        x * u + y * v > T::of(0.5)
    }

    /// Whether the squared Mahalanobis distance, under both covariances together, is small. Order: as a quadratic form
    /// against the determinant, without a division.
    pub fn is_close(&self, other: &Self) -> bool {
        let num = T::of;
        let da = self.angle_to(other);
        let dr = other.radius_m - self.radius_m;
        let aa = self.covariance[0] + other.covariance[0];
        let ra = self.covariance[1] + other.covariance[1];
        let rr = self.covariance[2] + other.covariance[2];
        let form = rr * square(da) - num(2.0) * (ra * (da * dr)) + aa * square(dr);
        self.is_beside(other) && form < (aa * rr - square(ra))
    }

    /// Becomes the Gaussian with the moments of both.
    pub fn absorb(&mut self, other: &Self) {
        let weight = self.weight + other.weight;
        let (a, b) = (self.weight / weight, other.weight / weight);
        let own = [self.angle_to(other), other.radius_m - self.radius_m];
        let mut tag = [T::ZERO; 2];
        for axis in 0..2 {
            tag[axis] = other.tag_shift_m[axis] - self.tag_shift_m[axis];
        }
        // a C + b C' + a b u v'.
        let mixed = |mine: T, theirs: T, u: T, v: T| a * mine + b * theirs + a * b * (u * v);
        for (entry, (row, column)) in [(0, 0), (0, 1), (1, 1)].into_iter().enumerate() {
            self.covariance[entry] =
                mixed(self.covariance[entry], other.covariance[entry], own[row], own[column]);
        }
        for row in 0..2 {
            for column in 0..2 {
                self.cross[row][column] =
                    mixed(self.cross[row][column], other.cross[row][column], own[row], tag[column]);
                self.tag_covariance[row][column] = mixed(
                    self.tag_covariance[row][column],
                    other.tag_covariance[row][column],
                    tag[row],
                    tag[column],
                );
            }
        }
        self.turn(b * own[0]);
        self.radius_m += b * own[1];
        for axis in 0..2 {
            self.tag_shift_m[axis] += b * tag[axis];
        }
        self.weight = weight;
    }

    /// Every number with its name, in the order of the core's `visit`.
    pub fn visit(&self, f: &mut dyn FnMut(fmt::Arguments<'_>, T)) {
        let (c, t) = (&self.cross, &self.tag_covariance);
        let numbers = [
            ("direction x", self.direction[0]),
            ("direction y", self.direction[1]),
            ("radius", self.radius_m),
            ("angle variance", self.covariance[0]),
            ("radius-angle covariance", self.covariance[1]),
            ("radius variance", self.covariance[2]),
            ("covariance of angle with tag x", c[0][0]),
            ("covariance of radius with tag x", c[1][0]),
            ("covariance of angle with tag y", c[0][1]),
            ("covariance of radius with tag y", c[1][1]),
            ("shift of tag x", self.tag_shift_m[0]),
            ("shift of tag y", self.tag_shift_m[1]),
            ("variance of tag x", t[0][0]),
            ("covariance of tag y with tag x", t[1][0]),
            ("covariance of tag x with tag y", t[0][1]),
            ("variance of tag y", t[1][1]),
            ("weight", self.weight),
        ];
        for (name, value) in numbers {
            f(format_args!("{name}"), value);
        }
    }
}

/// Cosine and sine of an angle a given as 2 tan(a/2). Order: times the inverse of the denominator.
fn rotation<T: Real>(angle: T) -> [T; 2] {
    let num = T::of;
    let scale = T::ONE / (num(4.0) + square(angle));
    [(num(4.0) - square(angle)) * scale, num(4.0) * angle * scale]
}

/// A direction turned by an angle given by its cosine and sine.
pub fn turned<T: Real>(direction: [T; 2], rotation: [T; 2]) -> [T; 2] {
    let ([x, y], [cos, sin]) = (direction, rotation);
    [x * cos - y * sin, x * sin + y * cos]
}
