//! Loopy belief propagation (Williams and Lau) over the features whose clusters are too large for [`super::exact`].
//!
//! With the messages mu_km = psi_km / (psi_k0 + sum_{m' != m} psi_km' nu_m'k) and
//! nu_mk = 1 / (1 + sum_{k' != k} mu_k'm), p(b_k = m) ~ psi_km nu_mk. Sums that leave one term out are formed from
//! the terms before and after it, never by subtraction, so no digits are lost.

use super::factors::{Row, Rows, Stage, members};
use super::{Belief, Beliefs};
use crate::model::work::MESSAGE;
use crate::real::{LnProduct, abs};

/// Guard: against endless small changes: relative change of every message below which the iteration has converged.
pub const TOLERANCE: f32 = 1e-3;
/// Capacity: messages to measurements after which no more are exchanged, which bound the time.
pub const MESSAGES: usize = 1_500;

/// What is kept of a feature's messages beside nu, which stand where its marginals will be.
#[derive(Clone, Copy, Debug)]
struct Messages<const PATHS: usize> {
    /// To the measurements.
    mu: [f32; PATHS],
    /// Running sum over the rows before this one.
    above: [f32; PATHS],
}

impl<const PATHS: usize> Messages<PATHS> {
    const NONE: Self = Self { mu: [0.0; PATHS], above: [0.0; PATHS] };
}

/// Loopy features with their messages.
struct Loopy<'a, const SOURCES: usize, const PATHS: usize> {
    rows: &'a Rows<SOURCES, PATHS>,
    beliefs: &'a mut Beliefs<SOURCES, PATHS>,
    direct: &'a mut Messages<PATHS>,
    images: &'a mut [Messages<PATHS>; SOURCES],
}

/// Gives the loopy features their marginals, and adds their evidence; `sums` gets, per measurement, the sum of the messages to
/// it. Kept apart, so that its messages use the stack of the exact solution.
#[inline(never)]
pub(super) fn propagate<const SOURCES: usize, const PATHS: usize>(
    rows: &Rows<SOURCES, PATHS>,
    beliefs: &mut Beliefs<SOURCES, PATHS>,
    sums: &mut [f32; PATHS],
) {
    let mut direct = Messages::NONE;
    let mut images = [Messages::NONE; SOURCES];
    let mut loopy = Loopy { rows, beliefs, direct: &mut direct, images: &mut images };
    for (row, nu, _) in loopy.features() {
        for m in members(row.gated) {
            if let Some(nu) = nu.associated.get_mut(m) {
                *nu = 1.0;
            }
        }
    }
    loopy.exchange();
    let evidence_nat = loopy.evidence_nat();
    loopy.beliefs.evidence_nat += evidence_nat;
    for (row, belief, messages) in loopy.features() {
        row.conclude(belief);
        for m in members(row.gated) {
            if let Some((sum, mu)) = sums.get_mut(m).zip(messages.mu.get(m)) {
                *sum += mu;
            }
        }
    }
}

impl<const SOURCES: usize, const PATHS: usize> Loopy<'_, SOURCES, PATHS> {
    /// The loopy features, the direct path first, with what holds their messages.
    fn features(
        &mut self,
    ) -> impl DoubleEndedIterator<Item = (&Row<PATHS>, &mut Belief<PATHS>, &mut Messages<PATHS>)> {
        let Self { rows, beliefs, direct, images } = self;
        let Beliefs { direct: of_direct, virtual_anchors, .. } = &mut **beliefs;
        let first = core::iter::once((&rows.direct, of_direct, &mut **direct));
        let others = rows.virtual_anchors.iter().zip(virtual_anchors.iter_mut()).zip(images.iter_mut());
        let others = others.map(|((row, belief), messages)| (row, belief, messages));
        first.chain(others).filter(|(row, ..)| row.stage == Stage::Loopy)
    }

    /// Exchanges messages between the features and the measurements within their gates until they stand still; notes the iterations
    /// used.
    fn exchange(&mut self) {
        let gated = self.features().fold(0, |sum, (row, ..)| sum + row.gated.count_ones() as usize);
        let (mut iterations, mut sent) = (0, 0);
        while sent < MESSAGES {
            (iterations, sent) = (iterations + 1, sent + gated);
            let mut sums = [1.0; PATHS];
            for (row, nu, messages) in self.features() {
                row.send_to_measurements(&nu.associated, messages, &mut sums);
            }
            if !self.send_to_features() {
                break;
            }
        }
        self.beliefs.iterations = iterations;
        self.beliefs.work.add(MESSAGE, sent);
    }

    /// Evidence of the loopy features, nats, by Bethe's approximation:
    ///
    /// sum_k ln (psi_k0 + sum_m psi_km nu_mk) + sum_m ln (1 + sum_k mu_km) - sum_km ln (1 + mu_km nu_mk).
    fn evidence_nat(&mut self) -> f32 {
        let (mut more, mut less) = (LnProduct::ONE, LnProduct::ONE);
        let mut sums = [1.0; PATHS];
        for (row, nu, messages) in self.features() {
            let mut own = row.absent;
            for m in members(row.gated) {
                let terms = row.psi.get(m).zip(nu.associated.get(m)).zip(messages.mu.get(m));
                if let Some((((psi, nu), mu), sum)) = terms.zip(sums.get_mut(m)) {
                    own += psi * nu;
                    *sum += mu;
                    less.times(1.0 + mu * nu);
                }
            }
            more.times(own);
        }
        for sum in sums {
            if sum > 1.0 {
                more.times(sum);
            }
        }
        more.ln() - less.ln()
    }

    /// The messages nu from every measurement to every feature; true while any still moves.
    fn send_to_features(&mut self) -> bool {
        let mut below = [0.0; PATHS];
        let mut moving = false;
        for (row, nu, messages) in self.features().rev() {
            for m in members(row.gated) {
                let terms = nu.associated.get_mut(m).zip(messages.mu.get(m));
                let sums = messages.above.get(m).zip(below.get_mut(m));
                if let (Some((nu, mu)), Some((above, sum))) = (terms, sums) {
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
    /// The messages mu from this feature to every measurement; `sums` are those of the features before it, and then with it.
    #[inline(never)]
    fn send_to_measurements(
        &self,
        nu: &[f32; PATHS],
        messages: &mut Messages<PATHS>,
        sums: &mut [f32; PATHS],
    ) {
        let Messages { mu: messages, above } = messages;
        let mut before = self.absent;
        for m in members(self.gated) {
            if let (Some(mu), Some(psi), Some(nu)) = (messages.get_mut(m), self.psi.get(m), nu.get(m)) {
                *mu = before;
                before += psi * nu;
            }
        }
        let mut after = 0.0;
        for m in members(self.gated.reverse_bits()).map(|place| 31_usize.wrapping_sub(place)) {
            let terms = messages.get_mut(m).zip(self.psi.get(m)).zip(nu.get(m));
            if let Some((((mu, psi), nu), (above, sum))) = terms.zip(above.get_mut(m).zip(sums.get_mut(m))) {
                *mu = psi / (*mu + after);
                after += psi * nu;
                *above = *sum;
                *sum += *mu;
            }
        }
    }

    /// Makes marginals of the messages nu.
    #[inline(never)]
    fn conclude(&self, belief: &mut Belief<PATHS>) {
        let mut sum = self.absent;
        for m in members(self.gated) {
            if let (Some(p), Some(psi)) = (belief.associated.get_mut(m), self.psi.get(m)) {
                *p *= psi;
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
