//! Loopy belief propagation (Williams and Lau) over the features whose clusters are too large for [`super::exact`].
//!
//! With the messages mu_km = psi_km / (psi_k0 + sum_{m' != m} psi_km' nu_m'k) and
//! nu_mk = 1 / (1 + sum_{k' != k} mu_k'm), p(b_k = m) ~ psi_km nu_mk. Sums that leave one term out are formed from
//! the terms before and after it, never by subtraction, so no digits are lost.

use super::Belief;
use super::factors::{Row, Rows, Stage};
use crate::real::abs;

/// Relative change of every message below which the iteration has converged.
const TOLERANCE: f32 = 1e-4;
/// Iteration cap.
const ITERATIONS: usize = 60;

impl<const VAS: usize, const PATHS: usize> Rows<VAS, PATHS> {
    /// Exchanges messages between the loopy features and the first `count` measurements until they stand still;
    /// returns the iterations used (zero where no feature is loopy).
    #[inline(never)]
    pub(super) fn propagate(&mut self, count: usize) -> usize {
        let mut iterations = 0;
        while iterations < ITERATIONS && self.loopy().next().is_some() {
            iterations += 1;
            for row in self.loopy() {
                row.send_to_measurements(count);
            }
            if !self.send_to_features(count) {
                break;
            }
        }
        iterations
    }

    fn loopy(&mut self) -> impl DoubleEndedIterator<Item = &mut Row<PATHS>> {
        self.iter_mut().filter(|row| row.stage == Stage::Loopy)
    }

    /// The messages nu from every measurement to every feature; true while any still moves.
    fn send_to_features(&mut self, count: usize) -> bool {
        let mut sums = [1.0; PATHS];
        for row in self.loopy() {
            for ((above, sum), mu) in row.above.iter_mut().zip(&mut sums).zip(&row.mu).take(count) {
                *above = *sum;
                *sum += mu;
            }
        }
        let mut below = [0.0; PATHS];
        let mut moving = false;
        for row in self.loopy().rev() {
            for (((nu, above), sum), mu) in
                row.nu.iter_mut().zip(&row.above).zip(&mut below).zip(&row.mu).take(count)
            {
                let next = 1.0 / (above + *sum);
                moving |= abs(next - *nu) > TOLERANCE * *nu;
                *nu = next;
                *sum += mu;
            }
        }
        moving
    }
}

impl<const PATHS: usize> Row<PATHS> {
    /// The messages mu from this feature to every measurement.
    #[inline(never)]
    fn send_to_measurements(&mut self, count: usize) {
        let mut before = self.absent;
        for ((mu, psi), nu) in self.mu.iter_mut().zip(&self.psi).zip(&self.nu).take(count) {
            *mu = before;
            before += psi * nu;
        }
        let mut after = 0.0;
        let reversed = self.mu.iter_mut().zip(&self.psi).zip(&self.nu).take(count);
        for ((mu, psi), nu) in reversed.rev() {
            *mu = psi / (*mu + after);
            after += psi * nu;
        }
    }

    /// Writes the marginals that the messages give.
    #[inline(never)]
    pub(super) fn conclude(&self, belief: &mut Belief<PATHS>, count: usize) {
        let mut sum = self.absent;
        for ((p, psi), nu) in belief.associated.iter_mut().zip(&self.psi).zip(&self.nu).take(count) {
            *p = psi * nu;
            sum += *p;
        }
        for p in belief.associated.iter_mut().take(count) {
            *p /= sum;
        }
        belief.missed = self.absent / sum;
    }
}
