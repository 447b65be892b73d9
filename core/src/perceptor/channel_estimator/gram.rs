//! The K x K algebra of the channel estimator: a symmetric positive definite matrix of at most N rows.

use crate::real::larger;

/// A symmetric matrix of capacity N, of which only the lower triangle counts. Addressed without a panic path: reads
/// outside give zero, writes outside do nothing.
#[derive(Clone, Debug)]
pub(super) struct Symmetric<const N: usize> {
    entries: [[f32; N]; N],
}

impl<const N: usize> Symmetric<N> {
    pub fn zero() -> Self {
        Self { entries: [[0.0; N]; N] }
    }

    /// The entry at (row, column), column <= row.
    fn lower(&self, row: usize, column: usize) -> f32 {
        self.entries.get(row).and_then(|entries| entries.get(column)).copied().unwrap_or(0.0)
    }

    pub fn at(&self, row: usize, column: usize) -> f32 {
        if column > row { self.lower(column, row) } else { self.lower(row, column) }
    }

    /// Entries (row, from) to (row, row - 1): those left of the diagonal.
    pub fn left_of_diagonal(&self, row: usize, from: usize) -> &[f32] {
        self.entries.get(row).and_then(|entries| entries.get(from..row)).unwrap_or(&[])
    }

    /// Sets the entry at (row, column), column <= row.
    pub fn set(&mut self, row: usize, column: usize, value: f32) {
        if let Some(entry) = self.entries.get_mut(row).and_then(|entries| entries.get_mut(column)) {
            *entry = value;
        }
    }

    /// Sets what lies left of the diagonal block of rows `from..to` to zero.
    pub fn clear_left_of_block(&mut self, from: usize, to: usize) {
        for row in self.entries.iter_mut().take(to).skip(from) {
            row.iter_mut().take(from).for_each(|entry| *entry = 0.0);
        }
    }

    /// Replaces the diagonal block of rows `from..to`, symmetric positive definite, by its inverse, in place: by
    /// A = L D L', M = L^-1, A^-1 = M' D^-1 M. Pivots are kept above 1e-6 (the diagonal of a Gram matrix is at
    /// least 1).
    pub fn invert_block(&mut self, from: usize, to: usize) {
        // L below the diagonal, D on it.
        for column in from..to {
            for row in column..to {
                let mut sum = self.lower(row, column);
                for k in from..column {
                    sum -= self.lower(row, k) * self.lower(column, k) * self.lower(k, k);
                }
                let value = if row == column { larger(sum, 1e-6) } else { sum / self.lower(column, column) };
                self.set(row, column, value);
            }
        }
        // M instead of L, column by column: each needs only columns right of it.
        for column in from..to {
            for row in column + 1..to {
                let mut sum = self.lower(row, column);
                for k in column + 1..row {
                    sum += self.lower(row, k) * self.lower(k, column);
                }
                self.set(row, column, -sum);
            }
        }
        // Row by row: each needs only rows below it, and its own diagonal last.
        for row in from..to {
            for column in from..=row {
                // M's diagonal is one.
                let own = if row == column { 1.0 } else { self.lower(row, column) };
                let mut sum = own / self.lower(row, row);
                for k in row + 1..to {
                    sum += self.lower(k, row) * self.lower(k, column) / self.lower(k, k);
                }
                self.set(row, column, sum);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entry(row: usize, column: usize) -> f32 {
        let distance = row as f32 - column as f32;
        (-0.3 * distance * distance).exp() + if row == column { 0.05 } else { 0.0 }
    }

    #[test]
    fn the_inverse_of_a_block_times_the_block_is_the_identity_and_nothing_else_changes() {
        for (from, to) in [(0, 1), (0, 6), (2, 5), (5, 6)] {
            let mut gram = Symmetric::<6>::zero();
            for row in 0..6 {
                for column in 0..=row {
                    gram.set(row, column, entry(row, column));
                }
            }
            gram.invert_block(from, to);
            for row in 0..6 {
                for column in 0..6 {
                    if (from..to).contains(&row) && (from..to).contains(&column) {
                        let product: f32 = (from..to).map(|k| entry(row, k) * gram.at(k, column)).sum();
                        let expected = if row == column { 1.0 } else { 0.0 };
                        assert!((product - expected).abs() < 1e-4, "{row}, {column}: {product}");
                    } else {
                        assert_eq!(gram.at(row, column), entry(row, column));
                    }
                }
            }
        }
    }
}
