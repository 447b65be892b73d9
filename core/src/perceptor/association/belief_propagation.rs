//! Loopy belief propagation (Williams and Lau) over the features whose clusters are too large for [`super::exact`].
//!
//! With the messages mu_km = psi_km / (psi_k0 + sum_{m' != m} psi_km' nu_m'k) and
//! nu_mk = 1 / (1 + sum_{k' != k} mu_k'm), p(b_k = m) ~ psi_km nu_mk. Sums that leave one term out are formed from
//! the terms before and after it, never by subtraction, so no digits are lost.

use super::Belief;
use super::factors::{Row, Rows, Stage, members};
use crate::real::{abs, ln};

/// Guard: against endless small changes: relative change of every message below which the iteration has converged.
pub const TOLERANCE: f32 = 1e-4;
/// Capacity: iterations, which bound the time.
pub const ITERATIONS: usize = 60;

impl<const SOURCES: usize, const PATHS: usize> Rows<SOURCES, PATHS> {
    /// Exchanges messages between the loopy features and the measurements within their gates until they stand
    /// still; returns the iterations used (zero where no feature is loopy).
    #[inline(never)]
    pub(super) fn propagate(&mut self) -> usize {
        let mut iterations = 0;
        while iterations < ITERATIONS && self.loopy().next().is_some() {
            iterations += 1;
            for row in self.loopy() {
                row.send_to_measurements();
            }
            if !self.send_to_features() {
                break;
            }
        }
        iterations
    }

    /// Evidence of the loopy features, nats, by Bethe's approximation:
    ///
    /// sum_k ln (psi_k0 + sum_m psi_km nu_mk) + sum_m ln (1 + sum_k mu_km) - sum_km ln (1 + mu_km nu_mk).
    pub(super) fn evidence_nat(&self) -> f32 {
        let mut evidence_nat = 0.0;
        let mut sums = [1.0; PATHS];
        for row in self.iter().filter(|row| row.stage == Stage::Loopy) {
            let mut own = row.absent;
            for m in members(row.gated) {
                let messages = row.psi.get(m).zip(row.nu.get(m)).zip(row.mu.get(m)).zip(sums.get_mut(m));
                if let Some((((psi, nu), mu), sum)) = messages {
                    own += psi * nu;
                    *sum += mu;
                    evidence_nat -= ln(1.0 + mu * nu);
                }
            }
            evidence_nat += ln(own);
        }
        for sum in sums {
            if sum > 1.0 {
                evidence_nat += ln(sum);
            }
        }
        evidence_nat
    }

    fn loopy(&mut self) -> impl DoubleEndedIterator<Item = &mut Row<PATHS>> {
        self.iter_mut().filter(|row| row.stage == Stage::Loopy)
    }

    /// The messages nu from every measurement to every feature; true while any still moves.
    fn send_to_features(&mut self) -> bool {
        let mut sums = [1.0; PATHS];
        for row in self.loopy() {
            for m in members(row.gated) {
                if let (Some(above), Some(sum), Some(mu)) =
                    (row.above.get_mut(m), sums.get_mut(m), row.mu.get(m))
                {
                    *above = *sum;
                    *sum += mu;
                }
            }
        }
        let mut below = [0.0; PATHS];
        let mut moving = false;
        for row in self.loopy().rev() {
            for m in members(row.gated) {
                let messages = row.nu.get_mut(m).zip(row.mu.get(m));
                let sums = row.above.get(m).zip(below.get_mut(m));
                if let (Some((nu, mu)), Some((above, sum))) = (messages, sums) {
                    let next = 1.0 / (above + *sum);
                    moving |= abs(next - *nu) > TOLERANCE * *nu;
                    *nu = next;
                    *sum += mu;
                }
            }
        }
        moving
    }
}

impl<const PATHS: usize> Row<PATHS> {
    /// The messages mu from this feature to every measurement.
    #[inline(never)]
    fn send_to_measurements(&mut self) {
        let mut before = self.absent;
        for m in members(self.gated) {
            if let (Some(mu), Some(psi), Some(nu)) = (self.mu.get_mut(m), self.psi.get(m), self.nu.get(m)) {
                *mu = before;
                before += psi * nu;
            }
        }
        let mut after = 0.0;
        for m in members(self.gated.reverse_bits()).map(|place| 31_usize.wrapping_sub(place)) {
            if let (Some(mu), Some(psi), Some(nu)) = (self.mu.get_mut(m), self.psi.get(m), self.nu.get(m)) {
                *mu = psi / (*mu + after);
                after += psi * nu;
            }
        }
    }

    /// Writes the marginals that the messages give.
    #[inline(never)]
    pub(super) fn conclude(&self, belief: &mut Belief<PATHS>) {
        let mut sum = self.absent;
        for m in members(self.gated) {
            if let (Some(p), Some(psi), Some(nu)) =
                (belief.associated.get_mut(m), self.psi.get(m), self.nu.get(m))
            {
                *p = psi * nu;
                sum += *p;
            }
        }
        for m in members(self.gated) {
            if let Some(p) = belief.associated.get_mut(m) {
                *p /= sum;
            }
        }
        belief.missed = self.absent / sum;
    }
}
