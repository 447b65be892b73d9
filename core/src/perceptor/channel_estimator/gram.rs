//! The K x K algebra of the channel estimator: a symmetric positive definite matrix of at most N rows.

use crate::real::{larger, sqrt};

/// A square matrix of capacity N, addressed without a panic path: reads outside give zero, writes outside do
/// nothing.
#[derive(Clone, Debug)]
pub(super) struct Square<const N: usize> {
    entries: [[f32; N]; N],
}

impl<const N: usize> Square<N> {
    pub fn zero() -> Self {
        Self { entries: [[0.0; N]; N] }
    }

    pub fn at(&self, row: usize, column: usize) -> f32 {
        self.row(row).get(column).copied().unwrap_or(0.0)
    }

    pub fn row(&self, row: usize) -> &[f32] {
        self.entries.get(row).map_or(&[], |entries| entries.as_slice())
    }

    pub fn set(&mut self, row: usize, column: usize, value: f32) {
        if let Some(entry) = self.entries.get_mut(row).and_then(|entries| entries.get_mut(column)) {
            *entry = value;
        }
    }

    /// Inverse of the leading `size` x `size` block, which must be symmetric positive definite: by its Cholesky
    /// factor L, then Sigma = L^-T L^-1. Pivots are kept above 1e-6 (the diagonal of a Gram matrix is at least 1).
    pub fn inverse(&self, size: usize) -> Self {
        let mut factor = Self::zero();
        for column in 0..size {
            for row in column..size {
                let mut sum = self.at(row, column);
                for k in 0..column {
                    sum -= factor.at(row, k) * factor.at(column, k);
                }
                if row == column {
                    factor.set(row, column, sqrt(larger(sum, 1e-6)));
                } else {
                    factor.set(row, column, sum / factor.at(column, column));
                }
            }
        }
        let mut inverse_factor = Self::zero();
        for column in 0..size {
            for row in column..size {
                let mut sum = if row == column { 1.0 } else { 0.0 };
                for k in column..row {
                    sum -= factor.at(row, k) * inverse_factor.at(k, column);
                }
                inverse_factor.set(row, column, sum / factor.at(row, row));
            }
        }
        let mut inverse = Self::zero();
        for row in 0..size {
            for column in 0..=row {
                let mut sum = 0.0;
                for k in row..size {
                    sum += inverse_factor.at(k, row) * inverse_factor.at(k, column);
                }
                inverse.set(row, column, sum);
                inverse.set(column, row, sum);
            }
        }
        inverse
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_inverse_times_the_matrix_is_the_identity() {
        let mut gram = Square::<6>::zero();
        for row in 0..6 {
            for column in 0..6 {
                let distance = row as f32 - column as f32;
                gram.set(
                    row,
                    column,
                    (-0.3 * distance * distance).exp() + if row == column { 0.05 } else { 0.0 },
                );
            }
        }
        for size in 1..=6 {
            let inverse = gram.inverse(size);
            for row in 0..size {
                for column in 0..size {
                    let product: f32 = (0..size).map(|k| gram.at(row, k) * inverse.at(k, column)).sum();
                    let expected = if row == column { 1.0 } else { 0.0 };
                    assert!((product - expected).abs() < 1e-4, "{row}, {column}: {product}");
                }
            }
        }
    }
}
