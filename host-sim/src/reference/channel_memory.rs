//! Channel memory: how well each source (direct path or virtual anchor) is heard with each action.
//!
//! ln SINR of source k at action c is e_k - 2 ln d_k - 2 ln(f_c / f_1) - n_k - x_kc: its energy at a metre and at the first
//! action's carrier, its distance when the anchor was heard last, Friis's loss, the level of noise where its path arrives,
//! and what interference adds to that at the action. A frame shows the level, so n_k + x_kc; x takes a part of what is new,
//! the more the less the action was heard, or up to 0.6 where the noise of all sources has jumped, and n a part of the rest, up
//! to 0.7 above a slow mean of its own. Other actions take their share of x, rho^4, rho the overlap of the two spectra. Levels
//! follow by the gain of a random walk ([`super::clock`]).
//!
//! What was missed is explained by a two-state chain, visible or hidden.

use super::association::Measurement;
use super::clock::{gain, probability};
use super::controller::Library;
use super::real::{Real, abs, exp, larger, limited, ln, smaller, square};
use cogmint_core::memory::channel::{
    ChannelMemorySettings, EXCESS_JUMP, EXCESS_NEWS, EXCESS_WALK_PER_S, JUMP_LN, JUMP_WIDTH_LN,
    LEAST_SINR_LN, MOST_ENERGY_LN, MOST_SINR_LN, USUAL_FALL_PER_S, USUAL_RISE_PER_S,
};
use cogmint_core::model::source::Source;
use std::fmt;

/// One source.
#[derive(Clone, Debug)]
struct Row<T> {
    /// Paths seen; zero until the first.
    paths: T,
    energy_ln: T,
    /// 2 ln of its distance.
    spread_ln: T,
    visibility: T,
    /// Probability that nothing has hidden it since it was last seen.
    lasting: T,
    /// Probability that its path is there, though none was found yet.
    unseen: T,
    /// None before the first frame.
    noise_ln: Option<T>,
    usual_ln: T,
    excess_ln: Vec<T>,
}

impl<T: Real> Row<T> {
    fn empty(actions: usize) -> Self {
        Self {
            paths: T::ZERO,
            energy_ln: T::ZERO,
            spread_ln: T::ZERO,
            visibility: T::ONE,
            lasting: T::ONE,
            unseen: T::of(0.5),
            noise_ln: None,
            usual_ln: T::ZERO,
            excess_ln: vec![T::ZERO; actions],
        }
    }

    fn is_seen(&self) -> bool {
        self.paths > T::ZERO
    }
}

/// A frame received: with which action, what that tells of every action, and whether its noise has jumped.
#[derive(Clone, Debug)]
pub struct Received<T> {
    /// The action.
    pub action: usize,
    /// Seconds since the last frame.
    pub elapsed_s: T,
    /// What a sample at this action counts at every action.
    pub shares: Vec<T>,
    /// How far interference came or went: 0 to 1.
    pub jump: T,
}

/// The jump that a mean change of ln noise is.
pub fn jump<T: Real>(change_ln: T) -> T {
    limited((abs(change_ln) - T::of(JUMP_LN)) / T::of(JUMP_WIDTH_LN), T::ZERO, T::ONE)
}

fn power_ln<T: Real>(power: T) -> T {
    ln(limited(power, T::of(1e-30), T::of(1e30)))
}

/// All sources.
#[derive(Clone, Debug)]
pub struct ChannelMemory<T> {
    settings: ChannelMemorySettings,
    direct: Vec<Row<T>>,
    virtual_anchors: Vec<Row<T>>,
    /// By anchor and action: frames heard and not forgotten.
    heard: Vec<Vec<T>>,
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
        settings: ChannelMemorySettings,
        prior_sinr: T,
        neighbours: bool,
        library: &Library<T>,
    ) -> Self {
        let mut loss_ln = vec![T::ZERO; actions];
        for c in 0..library.len() {
            loss_ln[c] = T::of(2.0) * ln(library.carrier_hz(c) / library.carrier_hz(0));
        }
        Self {
            settings,
            direct: vec![Row::empty(actions); anchors],
            virtual_anchors: vec![Row::empty(actions); slots],
            heard: vec![vec![T::ZERO; actions]; anchors],
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

    /// `dt` seconds pass: frames are forgotten; what is visible hides, and the other way round.
    pub fn predict(&mut self, dt: T) {
        // A symmetric chain forgets its state at twice the rate of its turns.
        let turned = T::of(0.5) * probability(2.0 * self.settings.hiding_per_s, dt);
        let kept = T::ONE - probability(self.settings.forgetting_per_s, dt);
        for row in self.direct.iter_mut().chain(&mut self.virtual_anchors) {
            for state in [&mut row.visibility, &mut row.unseen] {
                *state += turned * (T::ONE - T::of(2.0) * *state);
            }
            row.lasting *= T::ONE - turned;
        }
        for count in self.heard.iter_mut().flatten() {
            *count *= kept;
        }
    }

    /// ln energy of a path at a metre and at the first carrier.
    fn standard_ln(&self, action: usize, path: &Measurement<T>) -> T {
        power_ln(path.energy * square(path.range_m)) + self.loss_ln[action]
    }

    /// How far a level of noise is above that known where a source's path arrives; none if nothing is known.
    pub fn noise_change(&self, source: Source, action: usize, level: T) -> Option<T> {
        let row = self.row(source);
        row.noise_ln.map(|noise_ln| power_ln(level) - (noise_ln + row.excess_ln[action]))
    }

    /// 1 for an action never heard, 1 / (1 + n) after n frames.
    fn news(&self, source: Source, action: usize) -> T {
        T::ONE / (T::ONE + self.heard[source.anchor()][action])
    }

    /// Enters the level of noise at a source's range.
    pub fn remember_noise(&mut self, source: Source, received: &Received<T>, [range_m, level]: [T; 2]) {
        let settings = self.settings;
        let action = received.action;
        let now_ln = power_ln(level);
        let dt = received.elapsed_s;
        let steady = gain(EXCESS_WALK_PER_S, dt) + T::of(EXCESS_NEWS) * self.news(source, action);
        let rate = larger(T::of(EXCESS_JUMP) * received.jump, steady);
        let of_direct = self.direct[source.anchor()].excess_ln.clone();
        let row = self.row_mut(source);
        row.spread_ln = ln(larger(square(range_m), T::of(1e-6)));
        if row.noise_ln.is_none() {
            row.usual_ln = now_ln - of_direct[action];
            row.noise_ln = Some(row.usual_ln);
            row.excess_ln = of_direct;
        }
        let before_ln = row.noise_ln.unwrap_or(T::ZERO);
        let change = now_ln - (before_ln + row.excess_ln[action]);
        // The place takes a part, up to 0.7 nat above the usual; the rest is interference.
        let rest = (T::ONE - rate) * change;
        let mut noise_ln = before_ln + gain(settings.noise_walk_per_s, dt) * (T::ONE - received.jump) * rest;
        let above = larger(noise_ln - (row.usual_ln + T::of(settings.place_ln)), T::ZERO);
        let entered = rate * change + above;
        noise_ln -= above;
        let kept = T::ONE - probability(settings.forgetting_per_s, dt);
        for c in 0..row.excess_ln.len() {
            row.excess_ln[c] = kept * row.excess_ln[c] + received.shares[c] * entered;
        }
        let walk_per_s = if noise_ln < row.usual_ln { USUAL_FALL_PER_S } else { USUAL_RISE_PER_S };
        row.usual_ln += gain(walk_per_s, dt) * (noise_ln - row.usual_ln);
        row.noise_ln = Some(noise_ln);
    }

    /// What was thought quiet with the action of these shares was not, by this.
    pub fn unmask(&mut self, source: Source, shares: &[T], excess_ln: T) {
        let row = self.row_mut(source);
        row.energy_ln = smaller(row.energy_ln + excess_ln, T::of(MOST_ENERGY_LN));
        for (excess, share) in row.excess_ln.iter_mut().zip(shares) {
            *excess += *share * excess_ln;
        }
        row.noise_ln = None;
    }

    /// Enters a path that belongs to `source` with probability `weight`.
    pub fn remember(&mut self, source: Source, received: &Received<T>, path: &Measurement<T>, weight: T) {
        let settings = self.settings;
        let now_ln = self.standard_ln(received.action, path);
        let familiar = T::ONE - self.news(source, received.action);
        let familiar = gain(settings.energy_walk_per_s, received.elapsed_s) * familiar * weight;
        let row = self.row_mut(source);
        let by_count = weight / (row.paths + weight + T::of(1e-6));
        row.energy_ln += larger(familiar, by_count) * (now_ln - row.energy_ln);
        if !row.is_seen() {
            (row.visibility, row.lasting) = (T::ONE, T::ONE);
        }
        row.paths += weight;
    }

    /// Enters that `source` was missed with probability `missed`; visible, it would have been found with probability `found`, and if
    /// not found, the rest of the frame is `rest` times as probable.
    pub fn remember_missed(&mut self, source: Source, found: T, missed: T, rest: T) {
        let row = self.row_mut(source);
        // Bayes: visible and not found, over not found; all along likewise, but no more than before.
        let there = (T::ONE - found) * rest;
        let ratio = there / larger(T::ONE - row.visibility * (T::ONE - there), T::of(1e-6));
        row.visibility = T::ONE + missed * (row.visibility * ratio - T::ONE);
        row.lasting = T::ONE + missed * (row.lasting * smaller(ratio, T::ONE) - T::ONE);
    }

    /// The same of a source that was never found: by the rest of the frame alone.
    pub fn remember_unseen(&mut self, source: Source, missed: T, rest: T) {
        let row = self.row_mut(source);
        let ratio = rest / larger(T::ONE - row.unseen * (T::ONE - rest), T::of(1e-6));
        row.unseen = T::ONE + missed * (row.unseen * ratio - T::ONE);
    }

    /// Counts a frame of an anchor.
    pub fn remember_frame(&mut self, anchor: usize, received: &Received<T>) {
        for (count, share) in self.heard[anchor].iter_mut().zip(&received.shares) {
            *count += *share;
        }
    }

    /// 2 ln(f / f_1) of every action.
    pub fn losses_ln(&self) -> &[T] {
        &self.loss_ln
    }

    /// Forgets a virtual anchor.
    pub fn forget(&mut self, slot: usize) {
        self.virtual_anchors[slot] = Row::empty(self.loss_ln.len());
    }

    /// Whether a source was ever seen.
    pub fn has_seen(&self, source: Source) -> bool {
        self.row(source).is_seen()
    }

    /// Probability that nothing has hidden a source since it was last seen.
    pub fn lasting(&self, source: Source) -> [T; 2] {
        let row = self.row(source);
        [if row.is_seen() { row.lasting } else { T::ONE }, row.lasting]
    }

    /// Probability that nothing hides a source: from frames, once one has shown it; from ranges.
    pub fn visibility(&self, source: Source) -> [T; 2] {
        let row = self.row(source);
        [if row.is_seen() { row.visibility } else { T::ONE }, row.visibility]
    }

    /// Probability that the path of a source is there, found or not.
    pub fn present(&self, source: Source) -> T {
        let row = self.row(source);
        if row.is_seen() { row.visibility } else { row.unseen }
    }

    /// ln SINR expected of a source with an action, between 1e-3 and 1e12.
    pub fn sinr_ln(&self, source: Source, action: usize) -> T {
        let row = self.row(source);
        let bounded = |ln: T| limited(ln, T::of(LEAST_SINR_LN), T::of(MOST_SINR_LN));
        if !row.is_seen() {
            return bounded(self.prior_ln - self.loss_ln[action] - row.excess_ln[action]);
        }
        // Order: the losses are summed, and the noise, before they are taken off.
        let losses_ln = row.spread_ln + self.loss_ln[action];
        let noise_ln = row.noise_ln.unwrap_or(T::ZERO) + row.excess_ln[action];
        bounded(row.energy_ln - losses_ln - noise_ln)
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
                f(format_args!("paths of {kind} {index}"), row.paths);
                f(format_args!("ln energy of {kind} {index}"), row.energy_ln);
                f(format_args!("ln squared distance of {kind} {index}"), row.spread_ln);
                f(format_args!("visibility of {kind} {index}"), row.visibility);
                f(format_args!("lasting visibility of {kind} {index}"), row.lasting);
                f(format_args!("presence of unseen {kind} {index}"), row.unseen);
                f(format_args!("ln noise of {kind} {index}"), row.noise_ln.unwrap_or(T::ZERO));
                f(format_args!("usual ln noise of {kind} {index}"), row.usual_ln);
                for (action, excess) in row.excess_ln.iter().enumerate() {
                    f(format_args!("ln excess of {kind} {index} at action {action}"), *excess);
                }
            }
        }
        for (anchor, heard) in self.heard.iter().enumerate() {
            for (action, count) in heard.iter().enumerate() {
                f(format_args!("frames of anchor {anchor} at action {action}"), *count);
            }
        }
    }
}
