//! What the state filter's prediction and update of the tag mean for a hypothesis, which has a view of its own of where
//! the tag is.
//!
//! The tag's error is no noise of single ranges but a shift common to many of them. A filter that only considers it
//! (Schmidt) has coloured innovations, and a product of their densities takes one shift for many proofs. A hypothesis
//! therefore carries the joint Gaussian of virtual anchor h and tag position p. Of the tag's velocity it knows what the
//! state filter knows given p: p <- p + drift (v + C_vp C_pp^-1 (p_own - p)); measurements of other sources reach it as the
//! information on p that they gave the state filter: J = C_pp+^-1 - C_pp^-1.

use crate::model::matrix::product;
use crate::model::motion::Agent;
use crate::real::{larger, sqrt};
use nalgebra::{Matrix2, Vector2};

/// M v.
pub(super) fn applied(m: &Matrix2<f32>, v: &Vector2<f32>) -> Vector2<f32> {
    Vector2::new(m.m11 * v.x + m.m12 * v.y, m.m21 * v.x + m.m22 * v.y)
}

/// Inverse, with a determinant of at least `least`.
pub(super) fn inverse(m: &Matrix2<f32>, least: f32) -> Matrix2<f32> {
    let scale = 1.0 / larger(m.m11 * m.m22 - m.m12 * m.m21, least);
    Matrix2::new(m.m22 * scale, -(m.m12 * scale), -(m.m21 * scale), m.m11 * scale)
}

/// Inverse of a covariance; a correlation beyond 0.9999995 counts as that.
pub(super) fn precision(covariance: &Matrix2<f32>) -> Matrix2<f32> {
    inverse(covariance, larger(1e-6 * (covariance.m11 * covariance.m22), 1e-30))
}

fn position(agent: &Agent) -> Matrix2<f32> {
    let c = &agent.covariance;
    Matrix2::new(c.m11, c.m21, c.m21, c.m22)
}

/// A prediction: p <- A p, C_pp <- A C_pp A' + Q.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Prediction {
    pub transition: Matrix2<f32>,
    pub noise: Matrix2<f32>,
}

impl Prediction {
    /// From the agent before and after the state filter's prediction, over which a velocity carries for `drift_s` seconds.
    pub fn new(before: &Agent, after: &Agent, drift_s: f32) -> Self {
        let old = position(before);
        let c = &before.covariance;
        let velocity = Matrix2::new(c.m31, c.m32, c.m41, c.m42);
        let gain = product(&velocity, &precision(&old));
        let transition = Matrix2::new(
            1.0 + drift_s * gain.m11,
            drift_s * gain.m12,
            drift_s * gain.m21,
            1.0 + drift_s * gain.m22,
        );
        let carried = product(&product(&transition, &old), &transition.transpose());
        let new = position(after);
        // A component that was split is narrower than it was carried.
        let noise = positive_part([new.m11 - carried.m11, new.m21 - carried.m21, new.m22 - carried.m22]);
        Self { transition, noise }
    }
}

/// An update: the information J on the position and its vector relative to the predicted position.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Correction {
    /// J.
    pub information: Matrix2<f32>,
    /// C_pp+^-1 (p+ - p).
    pub vector: Vector2<f32>,
    /// p+ - p.
    pub shift: Vector2<f32>,
}

impl Correction {
    /// From the agent before and after the state filter's update.
    pub fn new(before: &Agent, after: &Agent) -> Self {
        let (old, new) = (precision(&position(before)), precision(&position(after)));
        let shift = Vector2::new(after.mean.x - before.mean.x, after.mean.y - before.mean.y);
        let information = positive_part([new.m11 - old.m11, new.m21 - old.m21, new.m22 - old.m22]);
        Self { information, vector: applied(&new, &shift), shift }
    }
}

/// A difference of two precisions or covariances (xx, yx, yy) without its negative eigenvalue: in a direction where rounding or
/// a soft association took information away, none came. With only the diagonal limited, the rest of such a loss would be
/// taken for information across it.
fn positive_part([xx, yx, yy]: [f32; 3]) -> Matrix2<f32> {
    let (mean, half) = (0.5 * (xx + yy), 0.5 * (xx - yy));
    let root = sqrt(half * half + yx * yx);
    let (least, most) = (mean - root, mean + root);
    if least >= 0.0 {
        return Matrix2::new(xx, yx, yx, yy);
    }
    if most <= 0.0 {
        return Matrix2::new(0.0, 0.0, 0.0, 0.0);
    }
    // The projector on the other eigenvector is (J - least) / (most - least).
    let scale = most / (most - least);
    let cross = scale * yx;
    Matrix2::new(larger(scale * (xx - least), 0.0), cross, cross, larger(scale * (yy - least), 0.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix4, Vector4};

    /// An agent at rest at the origin with a position covariance (xx, yx, yy).
    fn agent([xx, yx, yy]: [f32; 3]) -> Agent {
        let mut covariance = Matrix4::identity();
        covariance.m11 = xx;
        covariance.m21 = yx;
        covariance.m12 = yx;
        covariance.m22 = yy;
        Agent { mean: Vector4::new(0.0, 0.0, 0.0, 0.0), covariance }
    }

    /// v' M v.
    fn along(m: &Matrix2<f32>, [x, y]: [f32; 2]) -> f32 {
        m.m11 * x * x + 2.0 * m.m21 * x * y + m.m22 * y * y
    }

    #[test]
    fn a_range_tells_its_own_precision_along_its_line_and_nothing_across() {
        for angle in [0.0_f32, 0.4, 0.8, 2.5] {
            let (uy, ux) = angle.sin_cos();
            // A range of 2 cm on a tag known to 5 cm: C - C u u' C / S.
            let shrink = 2.5e-3 * 2.5e-3 / (2.5e-3 + 4e-4);
            let before = agent([2.5e-3, 0.0, 2.5e-3]);
            let after = agent([2.5e-3 - shrink * ux * ux, -shrink * ux * uy, 2.5e-3 - shrink * uy * uy]);
            let information = Correction::new(&before, &after).information;
            assert!((along(&information, [ux, uy]) / 2500.0 - 1.0).abs() < 1e-3, "{information:?}");
            assert!(along(&information, [-uy, ux]).abs() < 1.0, "{information:?}");
        }
    }

    #[test]
    fn an_update_that_widens_in_one_direction_gives_no_information_in_any() {
        for angle in [0.0_f32, 0.4, 0.8, 2.5] {
            let (uy, ux) = angle.sin_cos();
            let widened = 1e-3;
            let before = agent([2.5e-3, 0.0, 2.5e-3]);
            let after = agent([2.5e-3 + widened * ux * ux, widened * ux * uy, 2.5e-3 + widened * uy * uy]);
            let information = Correction::new(&before, &after).information;
            for k in 0..16 {
                let (y, x) = (0.2 * k as f32).sin_cos();
                // Against 400 per square metre that the tag was known to.
                assert!(along(&information, [x, y]).abs() < 0.1, "{angle}: {information:?}");
            }
        }
    }
}
