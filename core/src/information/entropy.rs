//! Entropy of the position, in nats.

use crate::real::{larger, ln};
use nalgebra::{Matrix2, Matrix4};

/// Mathematics: ln(2 pi e), the entropy of a two-dimensional Gaussian of unit determinant.
const LN_TAU_E: f32 = 2.837_877;

/// h = 1/2 ln det C + ln(2 pi e) of a position covariance C in square metres, from the logarithms of its pivots, so
/// that nothing overflows. Pivots below 1e-15 count as 1e-15.
pub fn position_entropy_nat(covariance_m2: &Matrix2<f32>) -> f32 {
    let first = larger(covariance_m2.m11, 1e-15);
    let second = larger(covariance_m2.m22 - covariance_m2.m21 * (covariance_m2.m21 / first), 1e-15);
    0.5 * (ln(first) + ln(second)) + LN_TAU_E
}

/// The position block of an agent covariance.
pub fn position_block(agent: &Matrix4<f32>) -> Matrix2<f32> {
    Matrix2::new(agent.m11, agent.m21, agent.m21, agent.m22)
}

/// Determinant of a symmetric positive definite 4 x 4 matrix, as the product of the pivots of its LDL'
/// decomposition; pivots below zero count as zero.
pub fn determinant(c: &Matrix4<f32>) -> f32 {
    let d1 = larger(c.m11, 1e-30);
    let (l21, l31, l41) = (c.m21 / d1, c.m31 / d1, c.m41 / d1);
    let d2 = larger(c.m22 - l21 * c.m21, 0.0);
    let safe2 = larger(d2, 1e-30);
    let (e32, e42) = (c.m32 - l31 * c.m21, c.m42 - l41 * c.m21);
    let (l32, l42) = (e32 / safe2, e42 / safe2);
    let d3 = larger(c.m33 - l31 * c.m31 - l32 * e32, 0.0);
    let safe3 = larger(d3, 1e-30);
    let e43 = c.m43 - l41 * c.m31 - l42 * e32;
    let l43 = e43 / safe3;
    let d4 = larger(c.m44 - l41 * c.m41 - l42 * e42 - l43 * e43, 0.0);
    d1 * d2 * d3 * d4
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_entropy_of_a_disc_of_one_centimetre_is_the_closed_form() {
        let h = position_entropy_nat(&Matrix2::new(1e-4, 0.0, 0.0, 1e-4));
        let exact = 0.5 * (1e-8_f64).ln() + (core::f64::consts::TAU * core::f64::consts::E).ln();
        assert!((f64::from(h) - exact).abs() < 1e-5);
    }

    #[test]
    fn the_determinant_of_a_factor_squared_is_the_product_of_its_pivots_squared() {
        // C = L L' with a unit lower-triangular part: det C is the squared product of the diagonal of L.
        let l = Matrix4::new(
            0.5_f32, 0.0, 0.0, 0.0, 0.2, 1.5, 0.0, 0.0, -0.3, 0.1, 0.8, 0.0, 0.4, -0.2, 0.3, 2.0,
        );
        let exact = (0.5_f32 * 1.5 * 0.8 * 2.0).powi(2);
        assert!((determinant(&(l * l.transpose())) / exact - 1.0).abs() < 1e-5);
    }
}
