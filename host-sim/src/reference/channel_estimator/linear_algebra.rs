//! The inverse of a symmetric positive definite matrix.

use crate::reference::real::{Real, larger};
use crate::reference::{Matrix, zeros};

/// A^-1 = M' D^-1 M with A = L D L', M = L^-1. Pivots are kept above 1e-6.
///
/// Order: every inner product is subtracted from (or added to) its start term by term, in index order.
pub fn inverse<T: Real>(a: &Matrix<T>) -> Matrix<T> {
    let size = a.len();
    // A = L D L', L with a unit diagonal.
    let mut l = zeros::<T>(size, size);
    let mut d = vec![T::ZERO; size];
    for j in 0..size {
        for i in j..size {
            let mut sum = a[i][j];
            for k in 0..j {
                sum -= l[i][k] * l[j][k] * d[k];
            }
            if i == j {
                d[j] = larger(sum, T::of(1e-6));
                l[j][j] = T::ONE;
            } else {
                l[i][j] = sum / d[j];
            }
        }
    }
    // M = L^-1: its columns from their diagonals down.
    let mut m = zeros::<T>(size, size);
    for j in 0..size {
        m[j][j] = T::ONE;
        for i in j + 1..size {
            let mut sum = l[i][j];
            for k in j + 1..i {
                sum += l[i][k] * m[k][j];
            }
            m[i][j] = -sum;
        }
    }
    // M' D^-1 M. Order: (M_ki M_kj) / d_k.
    let mut inverse = zeros::<T>(size, size);
    for i in 0..size {
        for j in 0..=i {
            let mut sum = m[i][j] / d[i];
            for k in i + 1..size {
                sum += m[k][i] * m[k][j] / d[k];
            }
            inverse[i][j] = sum;
            inverse[j][i] = sum;
        }
    }
    inverse
}
