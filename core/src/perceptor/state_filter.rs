//! State filter: the joint Gaussian of tag and virtual anchors, in the reduced form of the unscented filter.
//!
//! State: agent x = [p, v] (position and velocity, 2-D), range bias b_j of each anchor (optional), virtual
//! anchors a_k. Covariance in blocks: `C_xx`, `C_xb[j]`, `C_bb[j][i]`, `C_xa[k]`, `C_ba[k][j]`, `C_aa[k][l]`.
//!
//! **Prediction** is linear: x <- F x, C_xx <- F C_xx F' + Q, C_xa <- F C_xa, C_xb <- F C_xb
//! ([`crate::model::motion`]), and a small random walk for the virtual anchors. Nothing else moves.
//!
//! **Measurement.** A range z = |d| + b depends on d = p - a alone (the anchor's height above the tag enters
//! |d|). Five sigma points on the 2 x 2 covariance of d (centre weight 1/3, spread sqrt 3: all moments of a
//! Gaussian to the fifth order) give the statistical linear regression z = mean + g'(d - E d) + residual, which
//! the joint covariance carries to all other states. All regressions of a cycle are taken before its first
//! update, and each innovation is corrected by how far the state has moved since: the batch result with
//! diagonal residuals, whatever the order. Each update is one rank-one change, also where the association is
//! soft: with S the innovation variance, beta the total probability, and nu the innovations,
//! C <- C + (spread / S^2 - beta / S) w w', w = C h.
//!
//! **Cheap.** C_aa is nearly the whole covariance, and an update needs only the row of the virtual anchor it is about.
//! So the changes of C_aa wait until there are four of them (`Pending`) and are made in one pass; the row that an
//! update needs is taken as it stands with those that wait. Every entry still sees the same changes in the same
//! order: the bits are those of one change after the other.
//!
//! **Positive definite in f32.** Three things keep it so. An update is never allowed to shrink a variance by
//! more than 2^-10 at once (a smaller measurement variance is raised to that, and the next cycle takes the
//! rest). Each update first adds 2^-19 of its own variance to every state, the size of its rounding errors. Variances of the predicted range are sums of squares, never differences.
//!
//! **Exact.** A virtual anchor inserted with a deviation of 0 is known exactly: it has no variance and no covariance
//! with anything, prediction leaves it out, every update moves it by w = 0. It stays where it is, to the bit, and its
//! range tells as much as that of a physical anchor in its place.
//!
//! **Bounded.** What is never observed must not grow without end: after a prediction, each state whose variance
//! exceeds its limit is scaled back, C <- D C D with a diagonal D (which keeps C positive definite). A bias is
//! limited to its prior, the position to the reach of the radio.

use crate::model::motion::{Agent, Motion, ProcessNoise};
use crate::model::range::{Regression, SMALLEST_SPREAD_M2, regress_distance};
use crate::model::soft_update::{Moments, SoftUpdate};
use crate::model::source::{Sight, Source};
use crate::perceptor::association::outcome::Innovation;
use crate::real::{larger, sqrt};
use nalgebra::{Matrix2, Matrix4, Matrix4x2, Vector2, Vector4};

/// Guard: against the rounding of the updates of a cycle: relative growth of every variance before them, 2^-19.
pub const ROUNDING_MARGIN: f32 = 1.0 / 524_288.0;
/// Guard: against overflow: largest variance of a velocity, (1 km/s)^2.
pub const VELOCITY_LIMIT: f32 = 1e6;
/// Guard: against overflow: largest variance of a virtual anchor's coordinate, (1 km)^2.
pub const VIRTUAL_ANCHOR_LIMIT_M2: f32 = 1e6;
/// Joint covariance in blocks. Of C_aa, the blocks with l <= k are kept.
#[derive(Clone, Debug)]
struct Covariance<const ANCHORS: usize, const VAS: usize> {
    xx: Matrix4<f32>,
    xb: [Vector4<f32>; ANCHORS],
    bb: [[f32; ANCHORS]; ANCHORS],
    xa: [Matrix4x2<f32>; VAS],
    ba: [[Vector2<f32>; ANCHORS]; VAS],
    aa: [[Matrix2<f32>; VAS]; VAS],
}

/// The mean, and with it the direction of an update.
#[derive(Clone, Debug)]
struct StateVector<const ANCHORS: usize, const VAS: usize> {
    agent: Vector4<f32>,
    bias_m: [f32; ANCHORS],
    virtual_anchors: [Vector2<f32>; VAS],
}

/// Changes scale w w' that C_aa lacks as yet: at most `N`.
struct Pending<const VAS: usize, const N: usize> {
    waiting: usize,
    scale: [f32; N],
    /// Of every virtual anchor, its part of each w.
    w: [[Vector2<f32>; N]; VAS],
}

/// Capacity: so many changes of C_aa are made in one pass: as many as the registers hold.
const CHANGES_PER_PASS: usize = 4;

impl<const VAS: usize, const N: usize> Pending<VAS, N> {
    fn new() -> Self {
        Self { waiting: 0, scale: [0.0; N], w: [[Vector2::new(0.0, 0.0); N]; VAS] }
    }

    fn push(&mut self, scale: f32, w: &[Vector2<f32>; VAS]) {
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

    /// One of the changes, alone.
    fn only(&self, change: usize) -> Option<Pending<VAS, 1>> {
        let mut only = Pending::new();
        for (place, w) in only.w.iter_mut().zip(&self.w) {
            *place = [*w.get(change)?];
        }
        only.scale = [*self.scale.get(change)?];
        only.waiting = 1;
        Some(only)
    }

    /// The virtual anchor's parts of all w, times their scales.
    fn scaled(&self, w: &[Vector2<f32>; N]) -> [Vector2<f32>; N] {
        let mut scaled = *w;
        for (w, scale) in scaled.iter_mut().zip(&self.scale) {
            *w = Vector2::new(scale * w.x, scale * w.y);
        }
        scaled
    }
}

/// C_aa[k][l] <- C_aa[k][l] + (scale w_k) w_l'.
#[inline(always)]
fn change_once(block: &mut Matrix2<f32>, k: &Vector2<f32>, l: &Vector2<f32>) {
    block.m11 += k.x * l.x;
    block.m12 += k.x * l.y;
    block.m21 += k.y * l.x;
    block.m22 += k.y * l.y;
}

/// The same for every change.
fn change<'a>(
    block: &mut Matrix2<f32>,
    scaled_k: impl IntoIterator<Item = &'a Vector2<f32>>,
    w_l: impl IntoIterator<Item = &'a Vector2<f32>>,
) {
    for (k, l) in scaled_k.into_iter().zip(w_l) {
        change_once(block, k, l);
    }
}

/// The same for a full pass, unrolled by hand: the target's image is optimised for size.
#[inline(always)]
fn change_all(block: &mut Matrix2<f32>, scaled_k: &[Vector2<f32>], w_l: &[Vector2<f32>]) {
    if let ([a, b, c, d], [e, f, g, h]) = (scaled_k, w_l) {
        let mut changed = *block;
        change_once(&mut changed, a, e);
        change_once(&mut changed, b, f);
        change_once(&mut changed, c, g);
        change_once(&mut changed, d, h);
        *block = changed;
    } else {
        change(block, scaled_k, w_l);
    }
}

/// The joint filter of a tag and up to `VAS` virtual anchors, seen from up to `ANCHORS` physical ones.
#[derive(Clone, Debug)]
pub struct StateFilter<const ANCHORS: usize, const VAS: usize> {
    mean: StateVector<ANCHORS, VAS>,
    covariance: Covariance<ANCHORS, VAS>,
    occupied: [bool; VAS],
    estimate_bias: bool,
    bias_limit_m2: f32,
    motion: Motion,
}

impl<const ANCHORS: usize, const VAS: usize> StateFilter<ANCHORS, VAS> {
    /// A tag somewhere around `position_m` with no virtual anchors. A `bias_std_m` of 0 switches the biases off
    /// (they stay at `bias_mean_m`).
    #[inline(always)] // built where it stays
    pub fn new(
        motion: Motion,
        position_m: [f32; 2],
        position_std_m: f32,
        velocity_std_m_s: f32,
        bias_mean_m: f32,
        bias_std_m: f32,
    ) -> Self {
        let [x, y] = position_m;
        let position = position_std_m * position_std_m;
        let velocity = velocity_std_m_s * velocity_std_m_s;
        let mut bb = [[0.0; ANCHORS]; ANCHORS];
        for (j, row) in bb.iter_mut().enumerate() {
            if let Some(variance) = row.get_mut(j) {
                *variance = bias_std_m * bias_std_m;
            }
        }
        Self {
            mean: StateVector {
                agent: Vector4::new(x, y, 0.0, 0.0),
                bias_m: [bias_mean_m; ANCHORS],
                virtual_anchors: [Vector2::new(0.0, 0.0); VAS],
            },
            covariance: Covariance {
                xx: Matrix4::from_diagonal(&Vector4::new(position, position, velocity, velocity)),
                xb: [Vector4::new(0.0, 0.0, 0.0, 0.0); ANCHORS],
                bb,
                xa: [Matrix4x2::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0); VAS],
                ba: [[Vector2::new(0.0, 0.0); ANCHORS]; VAS],
                aa: [[Matrix2::new(0.0, 0.0, 0.0, 0.0); VAS]; VAS],
            },
            occupied: [false; VAS],
            estimate_bias: bias_std_m > 0.0,
            bias_limit_m2: bias_std_m * bias_std_m,
            motion,
        }
    }

    /// Position of the tag, metres.
    pub fn position_m(&self) -> [f32; 2] {
        [self.mean.agent.x, self.mean.agent.y]
    }

    /// Velocity of the tag, m/s.
    pub fn velocity_m_s(&self) -> [f32; 2] {
        [self.mean.agent.z, self.mean.agent.w]
    }

    /// Position and velocity with their covariance.
    pub fn agent(&self) -> Agent {
        Agent { mean: self.mean.agent, covariance: self.covariance.xx }
    }

    /// Covariance of position and velocity.
    pub fn agent_covariance(&self) -> Matrix4<f32> {
        self.covariance.xx
    }

    /// Covariance of the position, square metres.
    pub fn position_covariance_m2(&self) -> Matrix2<f32> {
        let c = &self.covariance.xx;
        Matrix2::new(c.m11, c.m12, c.m21, c.m22)
    }

    /// Range bias of an anchor and its variance.
    pub fn bias_m(&self, anchor: usize) -> Option<(f32, f32)> {
        let mean = self.mean.bias_m.get(anchor)?;
        let variance = self.covariance.bb.get(anchor)?.get(anchor)?;
        Some((*mean, *variance))
    }

    /// Position of the virtual anchor in `slot` and its covariance; `None` for a free slot.
    pub fn virtual_anchor(&self, slot: usize) -> Option<(Vector2<f32>, Matrix2<f32>)> {
        if !*self.occupied.get(slot)? {
            return None;
        }
        Some((*self.mean.virtual_anchors.get(slot)?, *self.covariance.aa.get(slot)?.get(slot)?))
    }

    /// Puts the tag somewhere else: its covariance with everything else is gone.
    pub fn place(&mut self, agent: &Agent) {
        self.mean.agent = agent.mean;
        let c = &mut self.covariance;
        c.xx = agent.covariance;
        c.xb.iter_mut().for_each(|cross| cross.fill(0.0));
        c.xa.iter_mut().for_each(|cross| cross.fill(0.0));
    }

    /// Adds a virtual anchor that is not correlated with anything; false where `slot` is taken or does not exist. With a
    /// `std_m` of 0 it is known exactly and stays where it is.
    pub fn insert_independent(&mut self, slot: usize, position_m: [f32; 2], std_m: f32) -> bool {
        let [x, y] = position_m;
        let variance = std_m * std_m;
        self.insert(slot, Vector2::new(x, y), Matrix2::new(variance, 0.0, 0.0, variance))
    }

    /// Adds a virtual anchor located relative to the tag's position p: its deviation is `gain` (p - E p) plus an error
    /// of covariance `own`. Hence C_aa = G C_pp G' + C_own and C_a* = G C_p* for every other state.
    pub fn insert_relative(
        &mut self,
        slot: usize,
        position: Vector2<f32>,
        gain: &Matrix2<f32>,
        own: &Matrix2<f32>,
    ) -> bool {
        if !self.insert(slot, position, *own) {
            return false;
        }
        let c = &mut self.covariance;
        // Row of C_a* for a column (x, y) of C_p*.
        let carried = |x: f32, y: f32| (gain.m11 * x + gain.m12 * y, gain.m21 * x + gain.m22 * y);
        let xx = c.xx;
        let (m11, m12) = carried(xx.m11, xx.m21);
        let (m21, m22) = carried(xx.m21, xx.m22);
        let (m31, m32) = carried(xx.m31, xx.m32);
        let (m41, m42) = carried(xx.m41, xx.m42);
        if let Some(cross) = c.xa.get_mut(slot) {
            *cross = Matrix4x2::new(m11, m12, m21, m22, m31, m32, m41, m42);
        }
        if let Some(row) = c.ba.get_mut(slot) {
            for (ba, xb) in row.iter_mut().zip(&c.xb) {
                let (x, y) = carried(xb.x, xb.y);
                *ba = Vector2::new(x, y);
            }
        }
        // Earlier slots: this row's blocks. Later slots: the blocks of their rows, transposed.
        for (row, xa) in c.aa.iter_mut().zip(&c.xa).skip(slot + 1) {
            if let Some(block) = row.get_mut(slot) {
                let ((xx, yx), (xy, yy)) = (carried(xa.m11, xa.m21), carried(xa.m12, xa.m22));
                *block = Matrix2::new(xx, yx, xy, yy);
            }
        }
        if let Some(row) = c.aa.get_mut(slot) {
            for (block, xa) in row.iter_mut().zip(&c.xa).take(slot) {
                let ((xx, yx), (xy, yy)) = (carried(xa.m11, xa.m21), carried(xa.m12, xa.m22));
                *block = Matrix2::new(xx, xy, yx, yy);
            }
            if let Some(block) = row.get_mut(slot) {
                let ((xx, yx), (_, yy)) = (carried(m11, m21), carried(m12, m22));
                *block = Matrix2::new(own.m11 + xx, own.m21 + yx, own.m21 + yx, own.m22 + yy);
            }
        }
        true
    }

    fn insert(&mut self, slot: usize, position: Vector2<f32>, own: Matrix2<f32>) -> bool {
        let Some(occupied) = self.occupied.get_mut(slot) else { return false };
        if *occupied {
            return false;
        }
        *occupied = true;
        if let Some(mean) = self.mean.virtual_anchors.get_mut(slot) {
            *mean = position;
        }
        self.clear_covariance(slot);
        if let Some(block) = self.covariance.aa.get_mut(slot).and_then(|row| row.get_mut(slot)) {
            *block = own;
        }
        true
    }

    /// Takes a virtual anchor out of the state; false where `slot` is free.
    pub fn remove(&mut self, slot: usize) -> bool {
        let Some(occupied) = self.occupied.get_mut(slot) else { return false };
        let was = *occupied;
        *occupied = false;
        self.clear_covariance(slot);
        if let Some(mean) = self.mean.virtual_anchors.get_mut(slot) {
            *mean = Vector2::new(0.0, 0.0);
        }
        was
    }

    fn clear_covariance(&mut self, slot: usize) {
        let c = &mut self.covariance;
        if let Some(block) = c.xa.get_mut(slot) {
            block.fill(0.0);
        }
        if let Some(row) = c.ba.get_mut(slot) {
            row.iter_mut().for_each(|cross| cross.fill(0.0));
        }
        if let Some(row) = c.aa.get_mut(slot) {
            row.iter_mut().for_each(|block| block.fill(0.0));
        }
        for row in &mut c.aa {
            if let Some(block) = row.get_mut(slot) {
                block.fill(0.0);
            }
        }
    }

    /// Moves the state `elapsed_s` seconds ahead. Linear, in closed form: cannot fail.
    pub fn predict(&mut self, elapsed_s: f32) {
        let step = self.motion.step(elapsed_s);
        step.carry_mean(&mut self.mean.agent);
        let c = &mut self.covariance;
        step.carry_covariance(&mut c.xx);
        let (drift, decay) = (step.drift_s, step.decay);
        if self.estimate_bias {
            for cross in &mut c.xb {
                cross.x += drift * cross.z;
                cross.y += drift * cross.w;
                cross.z *= decay;
                cross.w *= decay;
            }
        }
        let walk_m2 =
            self.motion.virtual_anchor_walk_m_sqrt_s * self.motion.virtual_anchor_walk_m_sqrt_s * elapsed_s;
        for (k, ((cross, row), occupied)) in c.xa.iter_mut().zip(&mut c.aa).zip(&self.occupied).enumerate() {
            if !occupied {
                continue;
            }
            cross.m11 += drift * cross.m31;
            cross.m21 += drift * cross.m41;
            cross.m12 += drift * cross.m32;
            cross.m22 += drift * cross.m42;
            cross.m31 *= decay;
            cross.m41 *= decay;
            cross.m32 *= decay;
            cross.m42 *= decay;
            if let Some(block) = row.get_mut(k) {
                // What has no variance is known exactly.
                if block.m11 > 0.0 {
                    block.m11 += walk_m2;
                }
                if block.m22 > 0.0 {
                    block.m22 += walk_m2;
                }
            }
        }
        self.limit();
    }

    /// Adds the share of every variance that the rounding of an update may take.
    fn cover_rounding(&mut self) {
        let margin = 1.0 + ROUNDING_MARGIN;
        let c = &mut self.covariance;
        c.xx.m11 *= margin;
        c.xx.m22 *= margin;
        c.xx.m33 *= margin;
        c.xx.m44 *= margin;
        if self.estimate_bias {
            for (j, row) in c.bb.iter_mut().enumerate() {
                if let Some(variance) = row.get_mut(j) {
                    *variance *= margin;
                }
            }
        }
        for (k, (row, occupied)) in c.aa.iter_mut().zip(&self.occupied).enumerate() {
            if let Some(block) = row.get_mut(k)
                && *occupied
            {
                block.m11 *= margin;
                block.m22 *= margin;
            }
        }
    }

    /// After a prediction: as if this noise had acted over the same step as well.
    pub fn disturb(&mut self, noise: &ProcessNoise) {
        noise.add_to(&mut self.covariance.xx);
    }

    /// Takes the last disturbance back; `predicted` is the covariance of position and velocity from before it.
    pub fn undisturb(&mut self, predicted: &Matrix4<f32>) {
        self.covariance.xx = *predicted;
    }

    /// Scales back every state whose variance exceeds its limit.
    fn limit(&mut self) {
        let c = &mut self.covariance;
        let reach = self.motion.position_std_limit_m * self.motion.position_std_limit_m;
        let mut exceeded = false;
        let mut factor = |variance: f32, limit: f32| {
            if variance > limit {
                exceeded = true;
                sqrt(limit / variance)
            } else {
                1.0
            }
        };
        let x = Vector4::new(
            factor(c.xx.m11, reach),
            factor(c.xx.m22, reach),
            factor(c.xx.m33, VELOCITY_LIMIT),
            factor(c.xx.m44, VELOCITY_LIMIT),
        );
        let mut b = [1.0; ANCHORS];
        if self.estimate_bias {
            for (j, (factor_b, row)) in b.iter_mut().zip(&c.bb).enumerate() {
                if let Some(variance) = row.get(j) {
                    *factor_b = factor(*variance, self.bias_limit_m2);
                }
            }
        }
        let mut a = [Vector2::new(1.0, 1.0); VAS];
        for (k, (factor_a, row)) in a.iter_mut().zip(&c.aa).enumerate() {
            if let Some(own) = row.get(k) {
                factor_a.x = factor(own.m11, VIRTUAL_ANCHOR_LIMIT_M2);
                factor_a.y = factor(own.m22, VIRTUAL_ANCHOR_LIMIT_M2);
            }
        }
        if !exceeded {
            return;
        }
        for (column, fc) in c.xx.column_iter_mut().zip(x.iter()) {
            scale(column, x.iter(), *fc);
        }
        for ((xb, row), fb) in c.xb.iter_mut().zip(&mut c.bb).zip(&b) {
            scale(xb.column_mut(0), x.iter(), *fb);
            for (entry, other) in row.iter_mut().zip(&b) {
                *entry *= fb * other;
            }
        }
        for (((xa, ba), row), fa) in c.xa.iter_mut().zip(&mut c.ba).zip(&mut c.aa).zip(&a) {
            for (column, fc) in xa.column_iter_mut().zip(fa.iter()) {
                scale(column, x.iter(), *fc);
            }
            for (cross, fb) in ba.iter_mut().zip(&b) {
                scale(cross.column_mut(0), fa.iter(), *fb);
            }
            for (block, fl) in row.iter_mut().zip(&a) {
                for (column, fc) in block.column_iter_mut().zip(fl.iter()) {
                    scale(column, fa.iter(), *fc);
                }
            }
        }
    }

    /// Regression of the range to `source` on the current state; `None` for a free slot or unknown anchor.
    pub fn regress(&self, source: Source, sight: &Sight) -> Option<Regression> {
        let c = &self.covariance;
        let agent = &self.mean.agent;
        let anchor = source.anchor();
        let bias = *self.mean.bias_m.get(anchor)?;
        let (distance, spread, bias_cross) = match source {
            Source::Direct { .. } => {
                let [ax, ay] = sight.anchor_m;
                let xb = c.xb.get(anchor)?;
                let xx = &c.xx;
                ([agent.x - ax, agent.y - ay], [xx.m11, xx.m21, xx.m22], [xb.x, xb.y])
            }
            Source::Virtual { slot, .. } => {
                let (a, own) = self.virtual_anchor(slot)?;
                let xa = c.xa.get(slot)?;
                let xb = c.xb.get(anchor)?;
                let ba = c.ba.get(slot)?.get(anchor)?;
                let spread = [
                    c.xx.m11 - 2.0 * xa.m11 + own.m11,
                    c.xx.m21 - (xa.m21 + xa.m12) + own.m21,
                    c.xx.m22 - 2.0 * xa.m22 + own.m22,
                ];
                ([agent.x - a.x, agent.y - a.y], spread, [xb.x - ba.x, xb.y - ba.y])
            }
        };
        let line = regress_distance(distance, spread, sight.height_m, sight.height_std_m);
        let [gx, gy] = line.slope;
        let mut explained_m2 = line.explained_m2;
        if self.estimate_bias {
            let own = c.bb.get(anchor)?.get(anchor)?;
            let [cx, cy] = bias_cross;
            explained_m2 = larger(explained_m2 + 2.0 * (gx * cx + gy * cy) + own, SMALLEST_SPREAD_M2);
        }
        Some(Regression {
            source,
            range_m: line.range_m + bias,
            slope: line.slope,
            residual_m2: line.residual_m2,
            explained_m2,
        })
    }

    /// Applies the innovations of one cycle, whose regressions must all have been taken since [`Self::predict`].
    pub fn update(&mut self, innovations: impl IntoIterator<Item = Innovation>) {
        let mut innovations = innovations.into_iter().peekable();
        if innovations.peek().is_none() {
            return;
        }
        self.cover_rounding();
        let prior = self.mean.clone();
        let mut pending = Pending::<VAS, CHANGES_PER_PASS>::new();
        for innovation in innovations {
            self.apply(&innovation, &prior, &mut pending);
            if pending.waiting == CHANGES_PER_PASS {
                self.settle(&pending);
                pending.waiting = 0;
            }
        }
        for change in 0..pending.waiting {
            if let Some(change) = pending.only(change) {
                self.settle(&change);
            }
        }
    }

    fn apply<const N: usize>(
        &mut self,
        innovation: &Innovation,
        prior: &StateVector<ANCHORS, VAS>,
        pending: &mut Pending<VAS, N>,
    ) {
        let regression = &innovation.regression;
        let Some((direction, explained, shift)) = self.direction(regression, prior, pending) else { return };
        // Innovations are relative to the prior; the state has moved by `shift` along the slope since.
        let Moments { weight, first_m, second_m2 } = innovation.moments;
        let moments = Moments {
            weight,
            first_m: first_m - weight * shift,
            second_m2: second_m2 - 2.0 * (shift * first_m) + weight * (shift * shift),
        };
        let variance_m2 = explained + (innovation.variance_m2 + regression.residual_m2);
        let change = SoftUpdate::new(&moments, variance_m2, explained);
        self.step(&direction, change.mean, change.covariance);
        pending.push(change.covariance, &direction.virtual_anchors);
    }

    /// w = C h, h' C h, and h'(x - x_prior), for the linear form h of a regression.
    fn direction<const N: usize>(
        &self,
        regression: &Regression,
        prior: &StateVector<ANCHORS, VAS>,
        pending: &Pending<VAS, N>,
    ) -> Option<(StateVector<ANCHORS, VAS>, f32, f32)> {
        let c = &self.covariance;
        let [gx, gy] = regression.slope;
        let anchor = regression.source.anchor();
        let xx = &c.xx;
        let mut agent = Vector4::new(
            gx * xx.m11 + gy * xx.m21,
            gx * xx.m21 + gy * xx.m22,
            gx * xx.m31 + gy * xx.m32,
            gx * xx.m41 + gy * xx.m42,
        );
        let mut bias_m = [0.0; ANCHORS];
        let mut virtual_anchors = [Vector2::new(0.0, 0.0); VAS];
        for ((w, xa), occupied) in virtual_anchors.iter_mut().zip(&c.xa).zip(&self.occupied) {
            if *occupied {
                w.x = gx * xa.m11 + gy * xa.m21;
                w.y = gx * xa.m12 + gy * xa.m22;
            }
        }
        let mut moved = [self.mean.agent.x - prior.agent.x, self.mean.agent.y - prior.agent.y];
        let target = match regression.source {
            Source::Direct { .. } => None,
            Source::Virtual { slot, .. } => Some(slot),
        };
        if let Some(slot) = target {
            let xa = c.xa.get(slot)?;
            agent.x -= gx * xa.m11 + gy * xa.m12;
            agent.y -= gx * xa.m21 + gy * xa.m22;
            agent.z -= gx * xa.m31 + gy * xa.m32;
            agent.w -= gx * xa.m41 + gy * xa.m42;
            // C_aa's row of this slot with what waits: blocks up to its own, then those of the later rows.
            let own = pending.w.get(slot)?;
            let own_scaled = pending.scaled(own);
            let earlier = virtual_anchors.iter_mut().zip(c.aa.get(slot)?).zip(&pending.w);
            for (l, ((w, block), other)) in earlier.take(slot + 1).enumerate() {
                let mut block = *block;
                change(&mut block, own_scaled.iter().take(pending.waiting), other);
                if l == slot {
                    block.m12 = block.m21;
                }
                w.x -= gx * block.m11 + gy * block.m21;
                w.y -= gx * block.m12 + gy * block.m22;
            }
            let later = virtual_anchors.iter_mut().zip(&c.aa).zip(&pending.w);
            for ((w, row), other) in later.skip(slot + 1) {
                let mut block = *row.get(slot)?;
                change(&mut block, pending.scaled(other).iter().take(pending.waiting), own);
                w.x -= gx * block.m11 + gy * block.m12;
                w.y -= gx * block.m21 + gy * block.m22;
            }
            let now = self.mean.virtual_anchors.get(slot)?;
            let then = prior.virtual_anchors.get(slot)?;
            let [mx, my] = moved;
            moved = [mx - (now.x - then.x), my - (now.y - then.y)];
        }
        let [mx, my] = moved;
        let mut shift = gx * mx + gy * my;
        if self.estimate_bias {
            let xb = c.xb.get(anchor)?;
            agent.x += xb.x;
            agent.y += xb.y;
            agent.z += xb.z;
            agent.w += xb.w;
            for ((w, xb), row) in bias_m.iter_mut().zip(&c.xb).zip(&c.bb) {
                *w = gx * xb.x + gy * xb.y + row.get(anchor)?;
            }
            if let Some(slot) = target {
                for (w, ba) in bias_m.iter_mut().zip(c.ba.get(slot)?) {
                    *w -= gx * ba.x + gy * ba.y;
                }
            }
            for ((w, row), occupied) in virtual_anchors.iter_mut().zip(&c.ba).zip(&self.occupied) {
                if *occupied {
                    let ba = row.get(anchor)?;
                    w.x += ba.x;
                    w.y += ba.y;
                }
            }
            shift += self.mean.bias_m.get(anchor)? - prior.bias_m.get(anchor)?;
        }
        let mut explained = gx * agent.x + gy * agent.y;
        if let Some(slot) = target {
            let w = virtual_anchors.get(slot)?;
            explained -= gx * w.x + gy * w.y;
        }
        if self.estimate_bias {
            explained += bias_m.get(anchor)?;
        }
        Some((StateVector { agent, bias_m, virtual_anchors }, larger(explained, 0.0), shift))
    }

    /// x <- x + w gain; C <- C + scale w w' but for C_aa, every entry as (scale w_row) w_column with the row of the
    /// later state.
    fn step(&mut self, w: &StateVector<ANCHORS, VAS>, gain: f32, scale: f32) {
        let mean = &mut self.mean;
        mean.agent.x += w.agent.x * gain;
        mean.agent.y += w.agent.y * gain;
        mean.agent.z += w.agent.z * gain;
        mean.agent.w += w.agent.w * gain;
        let c = &mut self.covariance;
        let (x1, x2, x3, x4) = (w.agent.x, w.agent.y, w.agent.z, w.agent.w);
        {
            let p = &mut c.xx;
            let (s2, s3, s4) = (scale * x2, scale * x3, scale * x4);
            p.m11 += scale * x1 * x1;
            p.m21 += s2 * x1;
            p.m22 += s2 * x2;
            p.m31 += s3 * x1;
            p.m32 += s3 * x2;
            p.m33 += s3 * x3;
            p.m41 += s4 * x1;
            p.m42 += s4 * x2;
            p.m43 += s4 * x3;
            p.m44 += s4 * x4;
            p.m12 = p.m21;
            p.m13 = p.m31;
            p.m23 = p.m32;
            p.m14 = p.m41;
            p.m24 = p.m42;
            p.m34 = p.m43;
        }
        if self.estimate_bias {
            for (bias, wb) in mean.bias_m.iter_mut().zip(&w.bias_m) {
                *bias += wb * gain;
            }
            for ((xb, row), wb) in c.xb.iter_mut().zip(&mut c.bb).zip(&w.bias_m) {
                let s = scale * wb;
                xb.x += s * x1;
                xb.y += s * x2;
                xb.z += s * x3;
                xb.w += s * x4;
                for (entry, other) in row.iter_mut().zip(&w.bias_m) {
                    *entry += scale * (wb * other);
                }
            }
        }
        let rows = c.xa.iter_mut().zip(&mut c.ba).zip(&mut mean.virtual_anchors);
        let slots = rows.zip(&w.virtual_anchors).zip(&self.occupied);
        for ((((xa, ba), a), wa), occupied) in slots {
            if !occupied {
                continue;
            }
            a.x += wa.x * gain;
            a.y += wa.y * gain;
            let (sx, sy) = (scale * wa.x, scale * wa.y);
            xa.m11 += sx * x1;
            xa.m21 += sx * x2;
            xa.m31 += sx * x3;
            xa.m41 += sx * x4;
            xa.m12 += sy * x1;
            xa.m22 += sy * x2;
            xa.m32 += sy * x3;
            xa.m42 += sy * x4;
            if self.estimate_bias {
                for (cross, wb) in ba.iter_mut().zip(&w.bias_m) {
                    cross.x += sx * wb;
                    cross.y += sy * wb;
                }
            }
        }
    }

    /// Makes the changes that C_aa lacks, all `N` in one pass.
    fn settle<const N: usize>(&mut self, pending: &Pending<VAS, N>) {
        let rows = self.covariance.aa.iter_mut().zip(&pending.w).zip(&self.occupied);
        for (k, ((row, own), occupied)) in rows.enumerate() {
            if !occupied {
                continue;
            }
            let scaled = pending.scaled(own);
            for (block, other) in row.iter_mut().zip(&pending.w).take(k) {
                change_all(block, &scaled, other);
            }
            if let Some(block) = row.get_mut(k) {
                change_all(block, &scaled, own);
                block.m12 = block.m21;
            }
        }
    }

    /// Every number of the state, in a fixed order, for traces.
    pub fn visit(&self, mut f: impl FnMut(f32)) {
        self.mean.agent.iter().for_each(|v| f(*v));
        self.mean.bias_m.iter().for_each(|v| f(*v));
        self.mean.virtual_anchors.iter().for_each(|v| v.iter().for_each(|v| f(*v)));
        let c = &self.covariance;
        c.xx.iter().for_each(|v| f(*v));
        c.xb.iter().for_each(|v| v.iter().for_each(|v| f(*v)));
        c.bb.iter().for_each(|row| row.iter().for_each(|v| f(*v)));
        for (k, ((xa, ba), aa)) in c.xa.iter().zip(&c.ba).zip(&c.aa).enumerate() {
            xa.iter().for_each(|v| f(*v));
            ba.iter().for_each(|v| v.iter().for_each(|v| f(*v)));
            aa.iter().take(k + 1).for_each(|block| block.iter().for_each(|v| f(*v)));
        }
    }
}

/// Multiplies a column's entries by their rows' factors and the column's own, as (row x column) x entry.
fn scale<'a, R: nalgebra::Dim, S: nalgebra::RawStorageMut<f32, R>>(
    mut column: nalgebra::Matrix<f32, R, nalgebra::U1, S>,
    rows: impl Iterator<Item = &'a f32>,
    factor: f32,
) {
    for (entry, row) in column.iter_mut().zip(rows) {
        *entry *= row * factor;
    }
}
