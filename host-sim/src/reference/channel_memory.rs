//! Channel memory: how well each source (direct path or virtual anchor) is heard with each action.
//!
//! ln SINR is kept at the first action's carrier, f_1: a path loses as f^2, so 2 ln(f / f_1) is added on entry and taken
//! off on reading. A sample at one action counts at another by share = weight rho^4, rho the overlap of the two spectra;
//! with n <- n (1 - share / window) + share, a mean moves to the sample by max(forgetting share, share / (n + share)). On
//! reading, the slow mean over all actions, which rises faster than it falls, counts for one sample.
//!
//! What was missed is explained by a two-state chain, visible or hidden, and by the SINR that the source's energy gives
//! over the frame's own noise.

use super::association::Measurement;
use super::controller::Library;
use super::real::{Real, exp, larger, limited, ln, square};
use cogmint_core::perceptor::state_filter::Source;
use std::fmt;

const WINDOW: f32 = 40.0;
const AGEING: f32 = 0.995;
const FORGETTING: f32 = 0.15;
const NOISE_FORGETTING: f32 = 0.4;
const LEVEL_WINDOW: f32 = 500.0;
const LEVEL_RISE: f32 = 0.01;
const LEVEL_FALL: f32 = 0.002;
const LEVEL_COUNT: f32 = 1.0;
const TURNING: f32 = 0.02;

/// A forgetting mean of ln SINR.
#[derive(Clone, Copy, Debug)]
struct Heard<T> {
    count: T,
    sinr_ln: T,
}

impl<T: Real> Heard<T> {
    const NOTHING: Self = Self { count: T::ZERO, sinr_ln: T::ZERO };

    fn enter(&mut self, sample_ln: T, share: T, forgetting: f32, window: f32) {
        let by_count = share / (self.count + share + T::of(1e-6));
        self.sinr_ln += larger(T::of(forgetting) * share, by_count) * (sample_ln - self.sinr_ln);
        self.count = self.count * (T::ONE - share * (T::ONE / T::of(window))) + share;
    }
}

/// One source.
#[derive(Clone, Debug)]
struct Row<T> {
    level: Heard<T>,
    energy_ln: T,
    visibility: T,
    actions: Vec<Heard<T>>,
}

impl<T: Real> Row<T> {
    fn empty(actions: usize) -> Self {
        let actions = vec![Heard::NOTHING; actions];
        Self { level: Heard::NOTHING, energy_ln: T::ZERO, visibility: T::ONE, actions }
    }

    fn is_seen(&self) -> bool {
        self.level.count > T::ZERO
    }

    fn enter(&mut self, shares: &[T], sample_ln: T, weight: T, forgetting: f32) {
        let slow = if sample_ln > self.level.sinr_ln { LEVEL_RISE } else { LEVEL_FALL };
        self.level.enter(sample_ln, weight, slow, LEVEL_WINDOW);
        for c in 0..self.actions.len() {
            self.actions[c].enter(sample_ln, weight * shares[c], forgetting, WINDOW);
        }
    }
}

/// All sources.
#[derive(Clone, Debug)]
pub struct ChannelMemory<T> {
    direct: Vec<Row<T>>,
    virtual_anchors: Vec<Row<T>>,
    prior_ln: T,
    /// Whether actions tell of each other.
    neighbours: bool,
    /// 2 ln(f / f_1); 0 beyond the library.
    loss_ln: Vec<T>,
}

impl<T: Real> ChannelMemory<T> {
    /// An empty memory of `[anchors, slots, actions]`.
    pub fn new(
        [anchors, slots, actions]: [usize; 3],
        prior_sinr: T,
        neighbours: bool,
        library: &Library<T>,
    ) -> Self {
        let mut loss_ln = vec![T::ZERO; actions];
        for c in 0..library.len() {
            loss_ln[c] = T::of(2.0) * ln(library.carrier_hz(c) / library.carrier_hz(0));
        }
        Self {
            direct: vec![Row::empty(actions); anchors],
            virtual_anchors: vec![Row::empty(actions); slots],
            prior_ln: ln(prior_sinr),
            neighbours,
            loss_ln,
        }
    }

    fn row(&self, source: Source) -> &Row<T> {
        match source {
            Source::Direct { anchor } => &self.direct[anchor],
            Source::Virtual { slot, .. } => &self.virtual_anchors[slot],
        }
    }

    fn row_mut(&mut self, source: Source) -> &mut Row<T> {
        match source {
            Source::Direct { anchor } => &mut self.direct[anchor],
            Source::Virtual { slot, .. } => &mut self.virtual_anchors[slot],
        }
    }

    /// What a sample at `action` counts at every action: the square of the square of the overlap.
    pub fn shares(&self, action: usize, library: &Library<T>) -> Vec<T> {
        let mut shares = vec![T::ZERO; self.loss_ln.len()];
        for c in 0..library.len() {
            if self.neighbours || c == action {
                shares[c] = square(square(library.overlap(action, c)));
            }
        }
        shares
    }

    /// Counts lose one part in 200; what is visible hides, and the other way round, with probability 0.02.
    pub fn age(&mut self) {
        for row in self.direct.iter_mut().chain(&mut self.virtual_anchors) {
            if !row.is_seen() {
                continue;
            }
            row.visibility += T::of(TURNING) * (T::ONE - T::of(2.0) * row.visibility);
            for heard in &mut row.actions {
                heard.count *= T::of(AGEING);
            }
        }
    }

    /// Enters a path heard with `action` that belongs to `source` with probability `weight`.
    pub fn remember(
        &mut self,
        source: Source,
        action: usize,
        shares: &[T],
        path: &Measurement<T>,
        weight: T,
    ) {
        let loss_ln = self.loss_ln[action];
        let row = self.row_mut(source);
        let sample_ln = ln(limited(path.sinr, T::of(1e-3), T::of(1e12))) + loss_ln;
        row.enter(shares, sample_ln, weight, FORGETTING);
        // Order: the level's count includes this sample.
        let gain = larger(T::of(FORGETTING) * weight, weight / larger(row.level.count, weight));
        let energy = larger(path.energy * square(path.range_m), T::of(1e-30));
        row.energy_ln += gain * (ln(energy) + loss_ln - row.energy_ln);
    }

    /// Enters that `source` was missed with probability `missed`; visible, it would have had this SINR and been found with
    /// probability `found`.
    pub fn remember_missed(
        &mut self,
        source: Source,
        action: usize,
        shares: &[T],
        [sinr, found]: [T; 2],
        missed: T,
    ) {
        let loss_ln = self.loss_ln[action];
        let row = self.row_mut(source);
        if !row.is_seen() {
            return;
        }
        // Bayes: visible and not found, over not found.
        let before = row.visibility;
        let visible = before * (T::ONE - found) / larger(T::ONE - before * found, T::of(1e-6));
        row.visibility = T::ONE + missed * (visible - T::ONE);
        if missed > T::of(0.5) {
            let sample_ln = ln(limited(sinr, T::of(1e-3), T::of(1e12))) + loss_ln;
            row.enter(shares, sample_ln, missed * visible, NOISE_FORGETTING);
        }
    }

    /// Enters the SINR that a source would have over the noise of a frame in which no path is known to be its own.
    pub fn remember_noise(&mut self, source: Source, action: usize, shares: &[T], sinr: T) {
        let loss_ln = self.loss_ln[action];
        let row = self.row_mut(source);
        if row.is_seen() {
            let sample_ln = ln(limited(sinr, T::of(1e-3), T::of(1e12))) + loss_ln;
            row.enter(shares, sample_ln, T::ONE, NOISE_FORGETTING);
        }
    }

    /// Forgets a virtual anchor.
    pub fn forget(&mut self, slot: usize) {
        self.virtual_anchors[slot] = Row::empty(self.loss_ln.len());
    }

    /// Whether a source was ever seen.
    pub fn has_seen(&self, source: Source) -> bool {
        self.row(source).is_seen()
    }

    /// Probability that nothing hides a source.
    pub fn visibility(&self, source: Source) -> T {
        self.row(source).visibility
    }

    /// ln SINR expected of a source with an action.
    pub fn sinr_ln(&self, source: Source, action: usize) -> T {
        let row = self.row(source);
        let expected_ln = if row.is_seen() {
            let heard = row.actions[action];
            let level_ln = row.level.sinr_ln;
            level_ln + heard.count / (heard.count + T::of(LEVEL_COUNT)) * (heard.sinr_ln - level_ln)
        } else {
            self.prior_ln
        };
        expected_ln - self.loss_ln[action]
    }

    /// SINR (linear) expected of a source with an action.
    pub fn sinr(&self, source: Source, action: usize) -> T {
        exp(self.sinr_ln(source, action))
    }

    /// SINR of a source's energy at a range over this noise; none if it was never seen.
    pub fn sinr_over(&self, source: Source, action: usize, range_m: T, level: T) -> Option<T> {
        let row = self.row(source);
        if !row.is_seen() {
            return None;
        }
        let energy = exp(row.energy_ln - self.loss_ln[action]);
        Some(energy / larger(level * square(range_m), T::of(1e-30)))
    }

    /// Every number with its name, in the order of the core's `visit`.
    pub fn visit(&self, f: &mut dyn FnMut(fmt::Arguments<'_>, T)) {
        for (kind, rows) in [("direct path", &self.direct), ("virtual anchor", &self.virtual_anchors)] {
            for (index, row) in rows.iter().enumerate() {
                f(format_args!("sample count of {kind} {index}"), row.level.count);
                f(format_args!("mean ln SINR of {kind} {index}"), row.level.sinr_ln);
                f(format_args!("ln energy of {kind} {index}"), row.energy_ln);
                f(format_args!("visibility of {kind} {index}"), row.visibility);
                for (action, heard) in row.actions.iter().enumerate() {
                    f(format_args!("sample count of {kind} {index} at action {action}"), heard.count);
                    f(format_args!("ln SINR of {kind} {index} at action {action}"), heard.sinr_ln);
                }
            }
        }
    }
}
