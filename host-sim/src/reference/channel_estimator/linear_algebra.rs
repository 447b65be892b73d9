//! The inverse of a symmetric positive definite matrix.

use crate::reference::real::{Real, larger, sqrt};
use crate::reference::{Matrix, zeros};

/// A^-1 = L^-T L^-1 with A = L L'. Squared pivots are kept above 1e-6.
///
/// Order: every inner product is subtracted from (or added to) its start term by term, in index order.
pub fn inverse<T: Real>(a: &Matrix<T>) -> Matrix<T> {
    let size = a.len();
    // A = L L'.
    let mut l = zeros::<T>(size, size);
    for i in 0..size {
        for j in 0..=i {
            let mut sum = a[i][j];
            for k in 0..j {
                sum -= l[i][k] * l[j][k];
            }
            l[i][j] = if i == j { sqrt(larger(sum, T::of(1e-6))) } else { sum / l[j][j] };
        }
    }
    // M = L^-1, by forward substitution of the unit vectors.
    let mut m = zeros::<T>(size, size);
    for j in 0..size {
        for i in j..size {
            let mut sum = if i == j { T::ONE } else { T::ZERO };
            for k in j..i {
                sum -= l[i][k] * m[k][j];
            }
            m[i][j] = sum / l[i][i];
        }
    }
    // M' M.
    let mut inverse = zeros::<T>(size, size);
    for i in 0..size {
        for j in 0..=i {
            let mut sum = T::ZERO;
            for k in i..size {
                sum += m[k][i] * m[k][j];
            }
            inverse[i][j] = sum;
            inverse[j][i] = sum;
        }
    }
    inverse
}
