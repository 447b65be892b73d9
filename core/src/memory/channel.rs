//! Channel memory: the SINR of every source (direct path or virtual anchor) at every action.
//!
//! A path observed with one carrier also tells of its spectral neighbours, in proportion to the fourth power of
//! the overlap rho of the two pulses' spectra. Per source and action it keeps a sample count n and the first two
//! moments of the distance-compensated energy e = |alpha|^2 d^2, all with a window of 40 and slow ageing. The
//! method of moments (the estimator of the Ricean K factor) gives SINR = A / (m1 - A), A = sqrt(m1^2 - var).
//! While samples are few, the logarithmic mean of the channel estimator's own SINR stands in for it; and it
//! bounds the moments from above, because it follows a sudden interferer within a few samples.
//!
//! A source that should have been seen and was not counts as a sample without energy: otherwise the memory of a
//! jammed carrier would keep its good days for ever.

use crate::controller::library::Library;
use crate::perceptor::association::Measurement;
use crate::perceptor::state_filter::Source;
use crate::real::{exp, larger, limited, ln, smaller, sqrt};

/// Window of the moments, samples.
const WINDOW: f32 = 40.0;
/// Ageing of every count per cycle.
const AGEING: f32 = 0.999;
/// Forgetting of the instant estimate per sample.
const INSTANT_FORGETTING: f32 = 0.2;
/// Samples from which the moments are fully trusted.
const TRUSTED: f32 = 8.0;
/// The moments are believed up to this multiple of the instant estimate.
const OPTIMISM: f32 = 2.0;
/// SINR taken for a source that was missed.
const MISSED_SINR: f32 = 0.5;
/// Energies enter relative to a reference of the same order, so that their squares stay within f32.
const REFERENCE_FLOOR: f32 = 1e-30;

/// What is known of one source at one action.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Moments {
    /// Effective number of samples.
    pub count: f32,
    /// Sum of energies over the reference.
    pub first: f32,
    /// Sum of their squares.
    pub second: f32,
    /// Forgetting mean of ln SINR, as the channel estimator saw it.
    pub instant_ln: f32,
}

/// What is known of one source.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Row<const ACTIONS: usize> {
    /// Energy that all others are relative to: the first one seen; 0 before.
    pub reference: f32,
    pub moments: [Moments; ACTIONS],
}

impl<const ACTIONS: usize> Default for Row<ACTIONS> {
    fn default() -> Self {
        Self { reference: 0.0, moments: [Moments::default(); ACTIONS] }
    }
}

/// SINR of `ANCHORS` direct paths and `VAS` virtual anchors at `ACTIONS` actions.
#[derive(Clone, Debug)]
pub struct ChannelMemory<const ANCHORS: usize, const VAS: usize, const ACTIONS: usize> {
    direct: [Row<ACTIONS>; ANCHORS],
    virtual_anchors: [Row<ACTIONS>; VAS],
    prior_sinr: f32,
}

impl<const ANCHORS: usize, const VAS: usize, const ACTIONS: usize> ChannelMemory<ANCHORS, VAS, ACTIONS> {
    /// An empty memory; `prior_sinr` (linear) is assumed where nothing is known.
    pub fn new(prior_sinr: f32) -> Self {
        Self { direct: [Row::default(); ANCHORS], virtual_anchors: [Row::default(); VAS], prior_sinr }
    }

    fn row(&self, source: Source) -> Option<&Row<ACTIONS>> {
        match source {
            Source::Direct { anchor } => self.direct.get(anchor),
            Source::Virtual { slot, .. } => self.virtual_anchors.get(slot),
        }
    }

    fn row_mut(&mut self, source: Source) -> Option<&mut Row<ACTIONS>> {
        match source {
            Source::Direct { anchor } => self.direct.get_mut(anchor),
            Source::Virtual { slot, .. } => self.virtual_anchors.get_mut(slot),
        }
    }

    /// Ages every count by one cycle.
    pub fn age(&mut self) {
        for row in self.direct.iter_mut().chain(&mut self.virtual_anchors) {
            if row.reference == 0.0 {
                continue;
            }
            for moments in &mut row.moments {
                moments.count *= AGEING;
                moments.first *= AGEING;
                moments.second *= AGEING;
            }
        }
    }

    /// Enters a path observed with `action` and believed to belong to `source` with probability `weight`.
    pub fn remember(
        &mut self,
        source: Source,
        action: usize,
        library: &Library<ACTIONS>,
        path: &Measurement,
        weight: f32,
    ) {
        let compensated = path.energy * (path.range_m * path.range_m);
        self.enter(source, action, library, compensated, path.sinr, weight);
    }

    /// Enters that `source` was expected in a frame received with `action` and, with probability `weight`, missed.
    pub fn remember_missed(
        &mut self,
        source: Source,
        action: usize,
        library: &Library<ACTIONS>,
        weight: f32,
    ) {
        self.enter(source, action, library, 0.0, MISSED_SINR, weight);
    }

    fn enter(
        &mut self,
        source: Source,
        action: usize,
        library: &Library<ACTIONS>,
        compensated: f32,
        sinr: f32,
        weight: f32,
    ) {
        let Some(row) = self.row_mut(source) else { return };
        if row.reference == 0.0 {
            if compensated == 0.0 {
                // Never seen yet: nothing to compare a miss to.
                return;
            }
            row.reference = limited(compensated, REFERENCE_FLOOR, 1.0 / REFERENCE_FLOOR);
        }
        let relative = limited(compensated / row.reference, 0.0, 1e6);
        let sinr_ln = ln(limited(sinr, 1e-3, 1e12));
        for (other, moments) in row.moments.iter_mut().enumerate().take(library.len()) {
            let overlap = library.overlap(action, other);
            let squared = overlap * overlap;
            let share = weight * (squared * squared);
            let keep = 1.0 - share * (1.0 / WINDOW);
            let known = moments.count;
            moments.count = moments.count * keep + share;
            moments.first = moments.first * keep + share * relative;
            moments.second = moments.second * keep + share * (relative * relative);
            // The first samples count in full: a mean of one sample is that sample.
            let forgetting = larger(INSTANT_FORGETTING * share, share / (known + share + 1e-6));
            moments.instant_ln += forgetting * (sinr_ln - moments.instant_ln);
        }
    }

    /// Forgets the virtual anchor in `slot`.
    pub fn forget(&mut self, slot: usize) {
        if let Some(row) = self.virtual_anchors.get_mut(slot) {
            *row = Row::default();
        }
    }

    /// Whether `source` was ever seen.
    pub fn has_seen(&self, source: Source) -> bool {
        self.row(source).is_some_and(|row| row.reference > 0.0)
    }

    /// Effective number of samples known of `source` at `action`, neighbours and age counted in; at most the window of 40.
    pub fn samples(&self, source: Source, action: usize) -> f32 {
        self.row(source).and_then(|row| row.moments.get(action)).map_or(0.0, |moments| moments.count)
    }

    /// SINR (linear, 0.01 to 1e6) expected of `source` at `action`.
    pub fn sinr(&self, source: Source, action: usize) -> f32 {
        let Some(moments) = self.row(source).and_then(|row| row.moments.get(action)) else {
            return self.prior_sinr;
        };
        if moments.count < 1e-3 {
            return self.prior_sinr;
        }
        // Few samples have no variance to speak of: the estimator's own SINR, itself blended in as it comes.
        let seen = limited(moments.count, 0.0, 1.0);
        let prior_ln = ln(self.prior_sinr);
        let instant_ln = prior_ln + seen * (moments.instant_ln - prior_ln);
        let ceiling = OPTIMISM * exp(instant_ln);
        let trust = limited(moments.count / TRUSTED, 0.0, 1.0);
        let by_moments = sinr_by_moments(moments);
        if trust >= 1.0 {
            return smaller(by_moments, ceiling);
        }
        smaller(exp(instant_ln + trust * (ln(by_moments) - instant_ln)), ceiling)
    }

    /// Every number of the state, in a fixed order, for traces.
    pub fn visit(&self, mut f: impl FnMut(f32)) {
        for row in self.direct.iter().chain(&self.virtual_anchors) {
            f(row.reference);
            for moments in &row.moments {
                f(moments.count);
                f(moments.first);
                f(moments.second);
                f(moments.instant_ln);
            }
        }
    }
}

/// Method of moments; 0.01 where the energies vary more than noise alone would.
fn sinr_by_moments(moments: &Moments) -> f32 {
    let mean = moments.first / moments.count;
    let spread = moments.second / moments.count - mean * mean;
    // Unbiased variance from the effective count.
    let variance = spread * moments.count / larger(moments.count - 1.0, 0.5);
    let deterministic = mean * mean - larger(variance, 0.0);
    if deterministic <= 0.0 {
        return 0.01;
    }
    let line = sqrt(deterministic);
    limited(line / larger(mean - line, mean * 1e-6), 0.01, 1e6)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::controller::library::LIBRARY_PUBLISHED;
    use rand_core::{Rng, SeedableRng};

    #[test]
    fn the_moments_recover_the_sinr_and_neighbours_share_it() {
        let library = Library::<40>::new(&LIBRARY_PUBLISHED).unwrap();
        let mut rng = rand_xoshiro::Xoshiro128PlusPlus::seed_from_u64(1);
        let mut uniform = || (rng.next_u32() >> 8) as f32 / 16_777_216.0 + 3e-8;
        let mut estimates = std::vec::Vec::new();
        for _ in 0..200 {
            let mut memory = ChannelMemory::<1, 1, 40>::new(10.0);
            let source = Source::Direct { anchor: 0 };
            for _ in 0..60 {
                memory.age();
                // |1 + CN(0, 1/10)|^2: SINR 10.
                let radius = (-uniform().ln() / 10.0).sqrt();
                let angle = crate::real::TAU * uniform();
                let energy = (1.0 + radius * angle.cos()).powi(2) + (radius * angle.sin()).powi(2);
                let path =
                    Measurement { range_m: 2.0, variance_m2: 1e-4, sinr: 10.0, energy, false_alarm: 1.0 };
                memory.remember(source, 20, &library, &path, 1.0);
            }
            estimates.push(memory.sinr(source, 20));
            let neighbour = memory.sinr(source, 21);
            assert!((neighbour / memory.sinr(source, 20)).ln().abs() < 0.7);
        }
        estimates.sort_by(f32::total_cmp);
        assert!((8.0..13.0).contains(&estimates[100]), "{}", estimates[100]);
    }

    #[test]
    fn nothing_known_gives_the_prior() {
        let memory = ChannelMemory::<1, 1, 40>::new(10.0);
        assert_eq!(memory.sinr(Source::Virtual { anchor: 0, slot: 0 }, 3), 10.0);
    }
}
