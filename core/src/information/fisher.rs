//! Fisher information of the position, and what the filter would make of it.
//!
//! A range of variance s along the unit vector u carries the information u u' / s. For a virtual anchor of
//! covariance C_a the effective variance is s + u' C_a u (cross-covariances with the tag are left out: this is
//! what planning can afford). The position error bound is sqrt(tr J^-1).

use crate::real::{abs, larger, sqrt};
use nalgebra::{Matrix2, Matrix4};

/// Information about the two position coordinates, 1/m^2.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PositionInformation {
    /// xx entry.
    pub xx: f32,
    /// yx entry.
    pub yx: f32,
    /// yy entry.
    pub yy: f32,
}

/// Slope of the range at a tag `d` = p - a away horizontally and `height_m` vertically, and its length; zero at
/// the anchor itself.
pub fn range_slope(d: [f32; 2], height_m: f32) -> [f32; 2] {
    let [dx, dy] = d;
    let length = larger(sqrt(dx * dx + dy * dy + height_m * height_m), 1e-6);
    [dx / length, dy / length]
}

impl PositionInformation {
    /// Adds a range of variance `variance_m2` along `slope`.
    pub fn add(&mut self, slope: [f32; 2], variance_m2: f32) {
        self.add_weighted(slope, 1.0 / larger(variance_m2, 1e-12));
    }

    /// Adds a range of inverse variance `weight` (1/m^2) along `slope`.
    pub fn add_weighted(&mut self, slope: [f32; 2], weight: f32) {
        let [ux, uy] = slope;
        self.xx += weight * (ux * ux);
        self.yx += weight * (ux * uy);
        self.yy += weight * (uy * uy);
    }

    /// Position error bound sqrt(tr J^-1), metres; infinite where the position is not observable.
    pub fn error_bound_m(&self) -> f32 {
        let determinant = self.xx * self.yy - self.yx * self.yx;
        if determinant <= 0.0 {
            return f32::INFINITY;
        }
        sqrt((self.xx + self.yy) / determinant)
    }

    /// Covariance of position and velocity after measurements of this information J on the position:
    /// C - C_xp J (I + C_pp J)^-1 C_px.
    pub fn posterior(&self, c: &Matrix4<f32>) -> Matrix4<f32> {
        // A = I + C_pp J.
        let a11 = 1.0 + (c.m11 * self.xx + c.m21 * self.yx);
        let a12 = c.m11 * self.yx + c.m21 * self.yy;
        let a21 = c.m21 * self.xx + c.m22 * self.yx;
        let a22 = 1.0 + (c.m21 * self.yx + c.m22 * self.yy);
        let determinant = a11 * a22 - a12 * a21;
        // det A >= 1 for positive semidefinite C_pp and J; rounding must not turn that over.
        let inverse = 1.0 / larger(abs(determinant), 1.0);
        // T = J A^-1, symmetric.
        let t11 = (self.xx * a22 - self.yx * a21) * inverse;
        let t21 = (self.yx * a22 - self.yy * a21) * inverse;
        let t22 = (self.yy * a11 - self.yx * a12) * inverse;
        let gain = |x: f32, y: f32| (x * t11 + y * t21, x * t21 + y * t22);
        let (g1x, g1y) = gain(c.m11, c.m21);
        let (g2x, g2y) = gain(c.m21, c.m22);
        let (g3x, g3y) = gain(c.m31, c.m32);
        let (g4x, g4y) = gain(c.m41, c.m42);
        let m11 = c.m11 - (g1x * c.m11 + g1y * c.m21);
        let m21 = c.m21 - (g2x * c.m11 + g2y * c.m21);
        let m22 = c.m22 - (g2x * c.m21 + g2y * c.m22);
        let m31 = c.m31 - (g3x * c.m11 + g3y * c.m21);
        let m32 = c.m32 - (g3x * c.m21 + g3y * c.m22);
        let m33 = c.m33 - (g3x * c.m31 + g3y * c.m32);
        let m41 = c.m41 - (g4x * c.m11 + g4y * c.m21);
        let m42 = c.m42 - (g4x * c.m21 + g4y * c.m22);
        let m43 = c.m43 - (g4x * c.m31 + g4y * c.m32);
        let m44 = c.m44 - (g4x * c.m41 + g4y * c.m42);
        Matrix4::new(m11, m21, m31, m41, m21, m22, m32, m42, m31, m32, m33, m43, m41, m42, m43, m44)
    }

    /// The inverse: the covariance that this information alone allows; `None` where it is singular.
    pub fn covariance_m2(&self) -> Option<Matrix2<f32>> {
        let determinant = self.xx * self.yy - self.yx * self.yx;
        if determinant <= 0.0 {
            return None;
        }
        let scale = 1.0 / determinant;
        Some(Matrix2::new(self.yy * scale, -self.yx * scale, -self.yx * scale, self.xx * scale))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bound_of_two_orthogonal_ranges_is_their_common_deviation() {
        let mut information = PositionInformation::default();
        information.add(range_slope([3.0, 0.0], 0.0), 0.01);
        information.add(range_slope([0.0, -2.0], 0.0), 0.01);
        assert!((information.error_bound_m() - (0.02_f32).sqrt()).abs() < 1e-6);
    }

    #[test]
    fn the_posterior_is_the_kalman_update() {
        let a = Matrix4::new(
            1.0_f64, 0.2, -0.3, 0.4, 0.0, 0.9, 0.1, -0.2, 0.5, 0.0, 1.2, 0.3, 0.1, 0.2, 0.0, 0.8,
        );
        let c = a * a.transpose();
        let mut information = PositionInformation::default();
        let ranges = [([0.6_f32, 0.8_f32], 0.04_f32), ([-1.0, 0.0], 0.09), ([0.28, -0.96], 0.5)];
        let mut kalman = c;
        for (slope, variance) in ranges {
            information.add(slope, variance);
            let h = nalgebra::Vector4::new(f64::from(slope[0]), f64::from(slope[1]), 0.0, 0.0);
            let w = kalman * h;
            kalman -= w * w.transpose() / (h.dot(&w) + f64::from(variance));
        }
        let posterior = information.posterior(&c.cast::<f32>());
        for (ours, exact) in posterior.iter().zip(kalman.iter()) {
            assert!((f64::from(*ours) - exact).abs() < 1e-5, "{posterior} {kalman}");
        }
    }
}
