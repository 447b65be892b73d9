//! What measurements tell of the position.
//!
//! Entropy of a Gaussian position, h = 1/2 ln det C + ln(2 pi e), and Fisher information: a range of variance s along
//! the unit vector u adds u u' / s.

use super::Matrix;
use super::motion::{AGENT, PX, PY};
use super::real::{Real, abs, larger, ln, sqrt, square};

/// ln(2 pi e).
const LN_TAU_E: f32 = 2.837_877;

/// Entropy of the position of an agent covariance, nats.
pub fn position_entropy_nat<T: Real>(c: &Matrix<T>) -> T {
    // Order: the quotient before the product.
    let least = T::of(1e-15);
    let first = larger(c[PX][PX], least);
    let second = larger(c[PY][PY] - c[PY][PX] * (c[PY][PX] / first), least);
    T::of(0.5) * (ln(first) + ln(second)) + T::of(LN_TAU_E)
}

/// Determinant of an agent covariance: the product of the pivots of C = L D L'. Pivots below zero count as zero.
pub fn determinant<T: Real>(c: &Matrix<T>) -> T {
    let least = T::of(1e-30);
    // e is L times D; l is L.
    let mut e = super::zeros::<T>(AGENT, AGENT);
    let mut l = super::zeros::<T>(AGENT, AGENT);
    let mut product = T::ONE;
    for j in 0..AGENT {
        let mut pivot = c[j][j];
        for k in 0..j {
            pivot -= l[j][k] * e[j][k];
        }
        pivot = larger(pivot, if j == 0 { least } else { T::ZERO });
        let safe = larger(pivot, least);
        for i in j + 1..AGENT {
            let mut entry = c[i][j];
            for k in 0..j {
                entry -= l[i][k] * e[j][k];
            }
            e[i][j] = entry;
            l[i][j] = entry / safe;
        }
        product *= pivot;
    }
    product
}

/// Fisher information J of the position.
#[derive(Clone, Copy, Debug)]
pub struct PositionInformation<T> {
    /// xx entry.
    pub xx: T,
    /// yx entry.
    pub yx: T,
    /// yy entry.
    pub yy: T,
}

/// Slope of a range at d = p - a and a height difference.
pub fn range_slope<T: Real>(d: [T; 2], height_m: T) -> [T; 2] {
    let length = larger(sqrt(square(d[0]) + square(d[1]) + square(height_m)), T::of(1e-6));
    [d[0] / length, d[1] / length]
}

impl<T: Real> PositionInformation<T> {
    /// No information.
    pub fn none() -> Self {
        Self { xx: T::ZERO, yx: T::ZERO, yy: T::ZERO }
    }

    /// Adds a range.
    pub fn add(&mut self, slope: [T; 2], variance_m2: T) {
        self.add_weighted(slope, T::ONE / larger(variance_m2, T::of(1e-12)));
    }

    /// Adds a range of this inverse variance.
    pub fn add_weighted(&mut self, slope: [T; 2], weight: T) {
        let [ux, uy] = slope;
        self.xx += weight * square(ux);
        self.yx += weight * (ux * uy);
        self.yy += weight * square(uy);
    }

    /// C - C_xp T C_px, T = J (I + C_pp J)^-1: what a Kalman filter would make of an agent covariance.
    pub fn posterior(&self, c: &Matrix<T>) -> Matrix<T> {
        let j = [[self.xx, self.yx], [self.yx, self.yy]];
        // A = I + C_pp J. Order: the 1 is added to the finished product.
        let mut a = [[T::ZERO; 2]; 2];
        for row in 0..2 {
            for column in 0..2 {
                a[row][column] = c[row][PX] * j[PX][column] + c[row][PY] * j[PY][column];
            }
            a[row][row] = T::ONE + a[row][row];
        }
        // det A is at least 1.
        let inverse = T::ONE / larger(abs(a[0][0] * a[1][1] - a[0][1] * a[1][0]), T::ONE);
        let t_xx = (self.xx * a[1][1] - self.yx * a[1][0]) * inverse;
        let t_yx = (self.yx * a[1][1] - self.yy * a[1][0]) * inverse;
        let t_yy = (self.yy * a[0][0] - self.yx * a[0][1]) * inverse;
        let mut posterior = c.clone();
        for row in 0..AGENT {
            // (C_xp T) of this row.
            let gain_x = c[row][PX] * t_xx + c[row][PY] * t_yx;
            let gain_y = c[row][PX] * t_yx + c[row][PY] * t_yy;
            for column in 0..=row {
                let reduction = gain_x * c[column][PX] + gain_y * c[column][PY];
                posterior[row][column] = c[row][column] - reduction;
                posterior[column][row] = posterior[row][column];
            }
        }
        posterior
    }
}
