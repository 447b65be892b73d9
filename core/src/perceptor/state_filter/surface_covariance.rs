//! C_ss: the covariance of the surfaces' numbers, every entry once.
//!
//! Blocks of 2 x 2, C_ss[k][l] between surface k (rows) and surface l (columns), and C_ss[l][k] its transpose. Of a pair k > l,
//! cell [k][l] holds the entries (1, 1) and (2, 2) of block [k][l], and cell [l][k] the entries (1, 2) and (2, 1). Cell [k][k]
//! holds the variances of surface k; the covariance of its two numbers stands beside. N (2 N + 1) numbers of N surfaces: as many
//! as the matrix has.
//!
//! C_ss is nearly the whole covariance, and an update needs only the rows of the surfaces it is about. So changes wait
//! ([`Pending`]) until several are made in one pass, and a row that an update needs is taken as it stands with those that wait.
//! Every entry sees the same changes in the same order: the bits are those of one change after the other.

use crate::snapshot::stored;

use nalgebra::{Matrix2, Vector2};

/// The covariance of `SURFACES` surfaces.
#[derive(Clone, Copy, Debug)]
pub(super) struct SurfaceCovariance<const SURFACES: usize> {
    cells: [[[f32; 2]; SURFACES]; SURFACES],
    /// Of every surface, the covariance of its two numbers.
    beside: [f32; SURFACES],
}

/// Changes scale w w' that C_ss lacks as yet: at most `N`.
pub(super) struct Pending<const SURFACES: usize, const N: usize> {
    waiting: usize,
    scale: [f32; N],
    /// Of every surface, its part of each w.
    w: [[Vector2<f32>; N]; SURFACES],
}

/// Capacity: so many changes of C_ss are made in one pass: as many as the registers hold.
pub(super) const CHANGES_PER_PASS: usize = 4;

impl<const SURFACES: usize, const N: usize> Pending<SURFACES, N> {
    /// None.
    pub(super) fn new() -> Self {
        Self { waiting: 0, scale: [0.0; N], w: [[Vector2::new(0.0, 0.0); N]; SURFACES] }
    }

    /// How many wait.
    pub(super) fn waiting(&self) -> usize {
        self.waiting
    }

    /// One more; beyond `N` it is lost.
    pub(super) fn push(&mut self, scale: f32, w: &[Vector2<f32>; SURFACES]) {
        if let Some(place) = self.scale.get_mut(self.waiting) {
            *place = scale;
        }
        for (places, w) in self.w.iter_mut().zip(w) {
            if let Some(place) = places.get_mut(self.waiting) {
                *place = *w;
            }
        }
        self.waiting += 1;
    }

    /// None waits any more.
    pub(super) fn clear(&mut self) {
        self.waiting = 0;
    }

    /// One of the changes, alone.
    pub(super) fn only(&self, change: usize) -> Option<Pending<SURFACES, 1>> {
        let mut only = Pending::new();
        for (place, w) in only.w.iter_mut().zip(&self.w) {
            *place = [*w.get(change)?];
        }
        only.scale = [*self.scale.get(change)?];
        only.waiting = 1;
        Some(only)
    }

    /// A surface's parts of all w, times their scales.
    fn scaled(&self, w: &[Vector2<f32>; N]) -> [Vector2<f32>; N] {
        let mut scaled = *w;
        for (w, scale) in scaled.iter_mut().zip(&self.scale) {
            *w = Vector2::new(scale * w.x, scale * w.y);
        }
        scaled
    }
}

/// The block of a pair from its two cells: entries (1, 1) and (2, 2), and (1, 2) and (2, 1).
#[inline(always)]
fn block([m11, m22]: &[f32; 2], [m12, m21]: &[f32; 2]) -> Matrix2<f32> {
    Matrix2::new(*m11, *m12, *m21, *m22)
}

/// Block [k][l] <- block + (scale w_k) w_l'.
#[inline(always)]
fn change_once(block: &mut Matrix2<f32>, k: &Vector2<f32>, l: &Vector2<f32>) {
    block.m11 += k.x * l.x;
    block.m12 += k.x * l.y;
    block.m21 += k.y * l.x;
    block.m22 += k.y * l.y;
}

/// The same for the first `waiting` changes, of fewer than a full pass, unrolled by hand.
#[inline(always)]
fn change_waiting(
    block: &mut Matrix2<f32>,
    waiting: usize,
    w_k: &[Vector2<f32>; CHANGES_PER_PASS],
    scale: &[f32; CHANGES_PER_PASS],
    w_l: &[Vector2<f32>; CHANGES_PER_PASS],
) {
    let ([a, b, c, _], [s, t, u, _], [e, f, g, _]) = (w_k, scale, w_l);
    let scaled = |scale: &f32, w: &Vector2<f32>| Vector2::new(scale * w.x, scale * w.y);
    if waiting > 0 {
        change_once(block, &scaled(s, a), e);
    }
    if waiting > 1 {
        change_once(block, &scaled(t, b), f);
    }
    if waiting > 2 {
        change_once(block, &scaled(u, c), g);
    }
}

/// The same for a full pass, unrolled by hand: the target's image is optimised for size.
#[inline(always)]
fn change_all(block: &mut Matrix2<f32>, scaled_k: &[Vector2<f32>], w_l: &[Vector2<f32>]) {
    if let ([a, b, c, d], [e, f, g, h]) = (scaled_k, w_l) {
        change_once(block, a, e);
        change_once(block, b, f);
        change_once(block, c, g);
        change_once(block, d, h);
    } else {
        for (k, l) in scaled_k.iter().zip(w_l) {
            change_once(block, k, l);
        }
    }
}

impl<const SURFACES: usize> SurfaceCovariance<SURFACES> {
    /// All zero.
    pub(super) const fn zero() -> Self {
        Self { cells: [[[0.0; 2]; SURFACES]; SURFACES], beside: [0.0; SURFACES] }
    }

    /// Block [k][l]; `None` where a surface does not exist.
    pub(super) fn get(&self, k: usize, l: usize) -> Option<Matrix2<f32>> {
        let (here, there) = (self.cells.get(k)?.get(l)?, self.cells.get(l)?.get(k)?);
        if k == l {
            let beside = *self.beside.get(k)?;
            return Some(block(here, &[beside; 2]));
        }
        if k > l {
            return Some(block(here, there));
        }
        let [m12, m21] = *here;
        Some(block(there, &[m21, m12]))
    }

    /// Sets block [k][l], and with it block [l][k]. Of a surface's own block, entry (1, 2) is not read: it is entry (2, 1).
    pub(super) fn set(&mut self, k: usize, l: usize, block: &Matrix2<f32>) {
        let diagonal = [block.m11, block.m22];
        let (of_diagonal, across) =
            if k < l { ((l, k), [block.m21, block.m12]) } else { ((k, l), [block.m12, block.m21]) };
        let (row, column) = of_diagonal;
        if let Some(cell) = self.cells.get_mut(row).and_then(|cells| cells.get_mut(column)) {
            *cell = diagonal;
        }
        if k == l {
            if let Some(beside) = self.beside.get_mut(k) {
                *beside = block.m21;
            }
        } else if let Some(cell) = self.cells.get_mut(column).and_then(|cells| cells.get_mut(row)) {
            *cell = across;
        }
    }

    /// The variances of every surface's two numbers.
    pub(super) fn variances(&self) -> impl Iterator<Item = &[f32; 2]> {
        self.cells.iter().enumerate().filter_map(|(k, row)| row.get(k))
    }

    /// The same, to be changed.
    pub(super) fn variances_mut(&mut self) -> impl Iterator<Item = &mut [f32; 2]> {
        self.cells.iter_mut().enumerate().filter_map(|(k, row)| row.get_mut(k))
    }

    /// Makes a surface known exactly: without variances and covariances.
    pub(super) fn clear(&mut self, slot: usize) {
        if let Some(row) = self.cells.get_mut(slot) {
            *row = [[0.0; 2]; SURFACES];
        }
        for row in &mut self.cells {
            if let Some(cell) = row.get_mut(slot) {
                *cell = [0.0; 2];
            }
        }
        if let Some(beside) = self.beside.get_mut(slot) {
            *beside = 0.0;
        }
    }

    /// Makes every entry a function of it and of the same entry of another one.
    pub(super) fn mix(&mut self, other: &Self, mix: impl Fn(f32, f32) -> f32) {
        let own = self.cells.iter_mut().flatten().flatten().chain(&mut self.beside);
        let others = other.cells.iter().flatten().flatten().chain(&other.beside);
        for (own, other) in own.zip(others) {
            *own = mix(*own, *other);
        }
    }

    /// C_ss <- D C_ss D of a diagonal D, two factors per surface. Order: (factor of the row x that of the column) x entry.
    pub(super) fn scale(&mut self, factors: &[Vector2<f32>; SURFACES]) {
        for (k, (row, own)) in self.cells.iter_mut().zip(factors).enumerate() {
            for (l, (cell, other)) in row.iter_mut().zip(factors).enumerate() {
                let [first, second] = cell;
                if l <= k {
                    *first *= own.x * other.x;
                    *second *= own.y * other.y;
                } else {
                    // Entries (1, 2) and (2, 1) of block [l][k].
                    *first *= own.y * other.x;
                    *second *= own.x * other.y;
                }
            }
        }
        for (beside, own) in self.beside.iter_mut().zip(factors) {
            *beside *= own.x * own.y;
        }
    }

    /// w <- w + C_ss h for a form h of one surface, as C_ss stands with the changes that wait, fewer than a full pass. `None`
    /// where it does not exist.
    pub(super) fn add_row(
        &self,
        slot: usize,
        [hx, hy]: [f32; 2],
        pending: &Pending<SURFACES, CHANGES_PER_PASS>,
        w: &mut [Vector2<f32>; SURFACES],
    ) -> Option<()> {
        let own = pending.w.get(slot)?;
        let own_scaled = pending.scaled(own);
        let Pending { waiting, scale, .. } = pending;
        let mut blocks = w.iter_mut().zip(self.cells.get(slot)?).zip(&self.cells).zip(&pending.w);
        for (((w, here), row), other) in blocks.by_ref().take(slot) {
            let mut block = block(here, row.get(slot)?);
            change_waiting(&mut block, *waiting, &own_scaled, &[1.0; CHANGES_PER_PASS], other);
            w.x += hx * block.m11 + hy * block.m21;
            w.y += hx * block.m12 + hy * block.m22;
        }
        if let Some((((w, here), _), other)) = blocks.next() {
            let mut block = block(here, &[*self.beside.get(slot)?; 2]);
            change_waiting(&mut block, *waiting, &own_scaled, &[1.0; CHANGES_PER_PASS], other);
            w.x += hx * block.m11 + hy * block.m21;
            w.y += hx * block.m21 + hy * block.m22;
        }
        for (((w, here), row), other) in blocks {
            let mut block = block(row.get(slot)?, here);
            change_waiting(&mut block, *waiting, other, scale, own);
            w.x += hx * block.m11 + hy * block.m12;
            w.y += hx * block.m21 + hy * block.m22;
        }
        Some(())
    }

    /// Makes the changes that wait, all `N` in one pass. `used` says of every surface whether it is there.
    pub(super) fn settle<const N: usize>(
        &mut self,
        pending: &Pending<SURFACES, N>,
        used: impl Iterator<Item = bool>,
    ) {
        for (k, ((own, beside), _)) in
            pending.w.iter().zip(&mut self.beside).zip(used).enumerate().filter(|(_, (_, used))| *used)
        {
            let Some((earlier, later)) = self.cells.split_at_mut_checked(k) else { return };
            let Some((row, _)) = later.split_first_mut() else { return };
            let scaled = pending.scaled(own);
            let mut cells = row.iter_mut();
            for ((row, other), here) in earlier.iter_mut().zip(&pending.w).zip(cells.by_ref()) {
                let Some(there) = row.get_mut(k) else { return };
                let mut changed = block(here, there);
                change_all(&mut changed, &scaled, other);
                (*here, *there) = ([changed.m11, changed.m22], [changed.m12, changed.m21]);
            }
            if let Some(here) = cells.next() {
                let mut changed = block(here, &[*beside; 2]);
                change_all(&mut changed, &scaled, own);
                (*here, *beside) = ([changed.m11, changed.m22], changed.m21);
            }
        }
    }
}

stored!(blank SurfaceCovariance<const SURFACES> { cells, beside });

#[cfg(test)]
mod tests {
    use super::*;

    const SURFACES: usize = 4;

    /// Entry (row, column) of block [k][l], different everywhere, the matrix symmetric.
    fn entry([k, row]: [usize; 2], [l, column]: [usize; 2]) -> f32 {
        let (a, b) = (2 * k + row, 2 * l + column);
        (10 * a.max(b) + a.min(b)) as f32
    }

    fn block_of(k: usize, l: usize) -> Matrix2<f32> {
        Matrix2::from_fn(|row, column| entry([k, row], [l, column]))
    }

    fn numbered() -> SurfaceCovariance<SURFACES> {
        let mut own = SurfaceCovariance::zero();
        for k in 0..SURFACES {
            for l in 0..=k {
                own.set(k, l, &block_of(k, l));
            }
        }
        own
    }

    #[test]
    fn every_block_is_what_was_set_whichever_way_around() {
        assert_eq!(
            size_of::<SurfaceCovariance<SURFACES>>(),
            size_of::<f32>() * SURFACES * (2 * SURFACES + 1)
        );
        let mut other = SurfaceCovariance::<SURFACES>::zero();
        for l in 0..SURFACES {
            for k in 0..=l {
                other.set(k, l, &block_of(k, l));
            }
        }
        for own in [numbered(), other] {
            for k in 0..SURFACES {
                for l in 0..SURFACES {
                    assert_eq!(own.get(k, l), Some(block_of(k, l)), "{k} {l}");
                }
            }
            assert!(own.get(0, SURFACES).is_none() && own.get(SURFACES, 0).is_none());
            let variances: std::vec::Vec<_> = own.variances().copied().collect();
            assert_eq!(variances, [[0.0, 11.0], [22.0, 33.0], [44.0, 55.0], [66.0, 77.0]]);
        }
    }

    #[test]
    fn a_surface_that_is_cleared_leaves_the_others_alone() {
        let mut own = numbered();
        own.clear(1);
        for k in 0..SURFACES {
            for l in 0..SURFACES {
                let expected = if k == 1 || l == 1 { Matrix2::zeros() } else { block_of(k, l) };
                assert_eq!(own.get(k, l), Some(expected), "{k} {l}");
            }
        }
    }

    #[test]
    fn every_entry_is_scaled_by_the_factors_of_its_row_and_column() {
        let factors: [Vector2<f32>; SURFACES] =
            core::array::from_fn(|k| Vector2::new(1.0 + k as f32, 0.5 - k as f32));
        let mut own = numbered();
        own.scale(&factors);
        for k in 0..SURFACES {
            for l in 0..SURFACES {
                let exact = Matrix2::from_fn(|row, column| {
                    factors[k][row] * factors[l][column] * entry([k, row], [l, column])
                });
                assert_eq!(own.get(k, l), Some(exact), "{k} {l}");
            }
        }
    }

    #[test]
    fn entries_are_mixed_with_the_same_entries() {
        let mut own = numbered();
        let mut other = numbered();
        other.scale(&[Vector2::new(3.0, 3.0); SURFACES]);
        own.mix(&other, |own, other| other - own);
        for k in 0..SURFACES {
            for l in 0..SURFACES {
                assert_eq!(own.get(k, l), Some(8.0 * block_of(k, l)));
            }
        }
    }

    #[test]
    fn changes_in_one_pass_are_those_one_by_one_and_a_row_knows_those_that_wait() {
        let used = [true, true, false, true];
        let part = |change: usize, k: usize| {
            let seed = (7 * change + 3 * k) as f32;
            if used[k] { Vector2::new(0.1 + 0.3 * seed, 0.7 - 0.2 * seed) } else { Vector2::zeros() }
        };
        let mut pending = Pending::<SURFACES, CHANGES_PER_PASS>::new();
        let mut one_by_one = numbered();
        one_by_one.clear(2);
        let untouched = one_by_one;
        for change in 0..CHANGES_PER_PASS {
            // With fewer than a full pass waiting, rows are those after all of them.
            for slot in [0, 1, 3] {
                let mut w = [Vector2::new(0.5, -0.5); SURFACES];
                let h = Vector2::new(0.3, -0.9);
                untouched.add_row(slot, [h.x, h.y], &pending, &mut w).unwrap();
                for (l, w) in w.iter().enumerate() {
                    let c = one_by_one.get(l, slot).unwrap();
                    let exact = Vector2::new(0.5, -0.5)
                        + Vector2::new(h.x * c.m11 + h.y * c.m12, h.x * c.m21 + h.y * c.m22);
                    assert_eq!(*w, exact, "{change} {slot} {l}");
                }
            }
            let scale = 0.1 - 0.07 * change as f32;
            let w: [Vector2<f32>; SURFACES] = core::array::from_fn(|k| part(change, k));
            pending.push(scale, &w);
            let mut alone = Pending::<SURFACES, 1>::new();
            alone.push(scale, &w);
            one_by_one.settle(&alone, used.into_iter());
        }
        assert_eq!(pending.waiting(), CHANGES_PER_PASS);
        let mut in_one_pass = untouched;
        in_one_pass.settle(&pending, used.into_iter());
        for k in 0..SURFACES {
            for l in 0..SURFACES {
                let before = untouched.get(k, l).unwrap();
                let exact = (0..CHANGES_PER_PASS).fold(before, |sum, change| {
                    let scale = 0.1 - 0.07 * change as f32;
                    sum + scale * part(change, k) * part(change, l).transpose()
                });
                let found = in_one_pass.get(k, l).unwrap();
                assert_eq!(found, one_by_one.get(k, l).unwrap(), "{k} {l}");
                assert!((found - exact).abs().max() < 1e-3, "{found} {exact}");
            }
        }
    }
}
