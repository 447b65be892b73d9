//! The tag's motion and what was measured of it, as a hypothesis needs them that holds a position p of its own.
//!
//! Given p, the tag's velocity is v + C_vp C_pp^-1 (p' - p). A prediction over which a velocity
//! carries for dt is therefore p <- A p + noise with A = I + dt C_vp C_pp^-1, and the noise what is missing to the state filter's new covariance. An update is the
//! information it brought: the matrix J = C_pp+^-1 - C_pp^-1 and the vector C_pp+^-1 (p+ - p).

use crate::reference::motion::{Agent, PX, PY, VX};
use crate::reference::real::{Real, larger, sqrt, square};
use crate::reference::{Square, product, transposed};

/// M v.
pub fn applied<T: Real>(m: &Square<T>, v: [T; 2]) -> [T; 2] {
    [m[0][0] * v[0] + m[0][1] * v[1], m[1][0] * v[0] + m[1][1] * v[1]]
}

/// M^-1, as if the determinant were at least `least`. Order: times the inverse of the determinant.
pub fn inverse<T: Real>(m: &Square<T>, least: T) -> Square<T> {
    let determinant = larger(m[0][0] * m[1][1] - m[0][1] * m[1][0], least);
    let scale = T::ONE / determinant;
    [[m[1][1] * scale, -(m[0][1] * scale)], [-(m[1][0] * scale), m[0][0] * scale]]
}

/// C^-1 of a covariance, which may be all but singular.
pub fn precision<T: Real>(covariance: &Square<T>) -> Square<T> {
    let least = T::of(1e-6) * (covariance[0][0] * covariance[1][1]);
    inverse(covariance, larger(least, T::of(1e-30)))
}

/// `new - old` for precisions or covariances, without the eigenvalues below zero: with l1 >= 0 > l2 it is l1 (M - l2 I) / (l1 - l2).
fn positive_part<T: Real>(new: &Square<T>, old: &Square<T>) -> Square<T> {
    let half = T::of(0.5);
    let [xx, yx, yy] = [new[0][0] - old[0][0], new[1][0] - old[1][0], new[1][1] - old[1][1]];
    let mean = half * (xx + yy);
    let root = sqrt(square(half * (xx - yy)) + square(yx));
    let (least, most) = (mean - root, mean + root);
    if least >= T::ZERO {
        [[xx, yx], [yx, yy]]
    } else if most <= T::ZERO {
        [[T::ZERO; 2]; 2]
    } else {
        let scale = most / (most - least);
        let x = larger(scale * (xx - least), T::ZERO);
        let y = larger(scale * (yy - least), T::ZERO);
        [[x, scale * yx], [scale * yx, y]]
    }
}

/// Block of the agent's covariance: rows from `row` on, columns of the position.
fn block<T: Real>(agent: &Agent<T>, row: usize) -> Square<T> {
    let c = &agent.covariance;
    [[c[row][PX], c[row][PY]], [c[row + 1][PX], c[row + 1][PY]]]
}

/// p <- A p + noise.
pub struct Prediction<T> {
    /// A.
    pub transition: Square<T>,
    /// Covariance of the noise.
    pub noise: Square<T>,
}

impl<T: Real> Prediction<T> {
    /// From the agent before and after the state filter's prediction, over which a velocity carries for `dt` seconds.
    pub fn new(before: &Agent<T>, after: &Agent<T>, dt: T) -> Self {
        let position = block(before, PX);
        let gain = product(&block(before, VX), &precision(&position));
        let transition =
            [[T::ONE + dt * gain[0][0], dt * gain[0][1]], [dt * gain[1][0], T::ONE + dt * gain[1][1]]];
        let carried = product(&product(&transition, &position), &transposed(&transition));
        Self { transition, noise: positive_part(&block(after, PX), &carried) }
    }
}

/// What was measured of the position.
pub struct Correction<T> {
    /// J.
    pub information: Square<T>,
    /// C_pp+^-1 (p+ - p).
    pub vector: [T; 2],
    /// p+ - p.
    pub shift: [T; 2],
}

impl<T: Real> Correction<T> {
    /// From the agent before and after the state filter's update.
    pub fn new(before: &Agent<T>, after: &Agent<T>) -> Self {
        let old = precision(&block(before, PX));
        let new = precision(&block(after, PX));
        let shift = [after.mean[PX] - before.mean[PX], after.mean[PY] - before.mean[PY]];
        Self { information: positive_part(&new, &old), vector: applied(&new, shift), shift }
    }
}
