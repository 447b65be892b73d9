//! State filter: the joint Gaussian of tag and surfaces, in the reduced form of the unscented filter.
//!
//! State: agent x = [p, v] (position and velocity, 2-D), range bias b_j of each anchor (optional), two numbers s_k of each
//! surface ([`crate::model::surface`]). Covariance in blocks: `C_xx`, `C_xb[j]`, `C_bb[j][i]`, `C_xs[k]`, `C_bs[k][j]`,
//! `C_ss[k][l]`.
//!
//! **Prediction** is linear: x <- F x, C_xx <- F C_xx F' + Q, C_xs <- F C_xs, C_xb <- F C_xb
//! ([`crate::model::motion`]), and a small random walk for the surfaces. Nothing else moves.
//!
//! **Measurement.** A range z = |d| + b depends on d = p - m alone, m being the source's image (the anchor's height above
//! the tag enters |d|). To first order m moves with its one or two surfaces by its slopes D ([`crate::model::image`]; its
//! curvature shifts its mean). Five sigma points on the 2 x 2 covariance of d (centre weight 1/3, spread sqrt 3: all moments
//! of a Gaussian to the fifth order) give the statistical linear regression z = mean + g'(d - E d) + residual, hence slopes g
//! over p and -D'g over each surface, which the joint covariance carries to all other states. All regressions of a cycle
//! are taken before its first update, and each innovation is corrected by how far the state has moved since: the batch
//! result with diagonal residuals, whatever the order. Each update is one rank-one change, also where the association is
//! soft: with S the innovation variance, beta the total probability, and nu the innovations,
//! C <- C + (spread / S^2 - beta / S) w w', w = C h.
//!
//! **Cheap.** The changes of C_ss wait until there are four of them and are made in one pass (`surface_covariance`).
//!
//! **Positive definite in f32.** Three things keep it so. An update is never allowed to shrink a variance by
//! more than 2^-10 at once (a smaller measurement variance is raised to that, and the next cycle takes the
//! rest). Each update first adds 2^-19 of its own variance to every state, the size of its rounding errors. Variances of the predicted range are sums of squares, never differences.
//!
//! **Exact.** A surface inserted with deviations of 0 is known exactly: it has no variance and no covariance with
//! anything, prediction leaves it out, every update moves it by w = 0. It stays where it is, to the bit, and the range of
//! its image tells as much as that of a physical anchor in its place.
//!
//! **Heading.** Of a body with several antennas, the unit vector u along its axis has a slot like a surface's, the last: an antenna x
//! ahead of the body's centre and y to its left is at p + x u + y u_left, linear in the state. Nothing known of it is a mean of 0 and
//! a variance of 1/2 per number, which is where it goes as the body turns, u <- exp(-turns) u. One antenna has none.
//!
//! **Bounded.** What is never observed must not grow without end: after a prediction, each state whose variance
//! exceeds its limit is scaled back, C <- D C D with a diagonal D (which keeps C positive definite). A bias is
//! limited to its prior, the position to the reach of the radio.

mod surface_covariance;

use self::surface_covariance::{CHANGES_PER_PASS, Pending, SurfaceCovariance};
use crate::model::image::{Image, Sequence};
use crate::model::matrix::{product, product_transposed, sandwiched};
use crate::model::motion::{Agent, Motion, ProcessNoise};
use crate::model::range::{Regression, SMALLEST_SPREAD_M2, SurfaceSlope, regress_distance};
use crate::model::soft_update::{Moments, SoftUpdate};
use crate::model::source::{Sight, Source};
use crate::model::surface::Surface;
use crate::perceptor::association::outcome::Innovation;
use crate::real::{exp, larger, smaller, sqrt};
use crate::snapshot::stored;
use nalgebra::{Matrix2, Matrix4, Matrix4x2, Vector2, Vector4};

/// Guard: against the rounding of the updates of a cycle: relative growth of every variance before them, 2^-19.
pub const ROUNDING_MARGIN: f32 = 1.0 / 524_288.0;
/// Guard: against overflow: largest variance of a velocity, (1 km/s)^2.
pub const VELOCITY_LIMIT: f32 = 1e6;
/// Guard: against overflow: largest variance of a surface's number that is a length, (1 km)^2.
pub const SURFACE_LIMIT_M2: f32 = 1e6;
/// Guard: against a wall that may be turned any way: largest variance of a wall's rotation, (1 rad)^2.
pub const ROTATION_LIMIT: f32 = 1.0;
/// Guard: against certainty: a wall's rotation walks as if its offset 5 m from the centre did: rad per metre, squared.
pub const ROTATION_WALK_PER_M2: f32 = 0.04;

/// Joint covariance in blocks.
// A copy as a whole: number by number it would be 0.3 KB of code, wherever a state is cloned.
#[derive(Clone, Copy, Debug)]
struct Covariance<const ANCHORS: usize, const SURFACES: usize> {
    xx: Matrix4<f32>,
    xb: [Vector4<f32>; ANCHORS],
    bb: [[f32; ANCHORS]; ANCHORS],
    xs: [Matrix4x2<f32>; SURFACES],
    bs: [[Vector2<f32>; ANCHORS]; SURFACES],
    ss: SurfaceCovariance<SURFACES>,
}

/// The mean, and with it the direction of an update.
#[derive(Clone, Copy, Debug)]
struct StateVector<const ANCHORS: usize, const SURFACES: usize> {
    agent: Vector4<f32>,
    bias_m: [f32; ANCHORS],
    surfaces: [Vector2<f32>; SURFACES],
}

/// The joint filter of a tag and up to `SURFACES` surfaces, seen from up to `ANCHORS` physical anchors.
#[derive(Clone, Debug)]
pub struct StateFilter<const ANCHORS: usize, const SURFACES: usize> {
    mean: StateVector<ANCHORS, SURFACES>,
    covariance: Covariance<ANCHORS, SURFACES>,
    surfaces: [Option<Surface>; SURFACES],
    estimate_bias: bool,
    bias_limits_m2: [f32; ANCHORS],
    motion: Motion,
    /// The position's standard deviation never exceeds this, metres.
    reach_m: f32,
}

impl<const ANCHORS: usize, const SURFACES: usize> StateFilter<ANCHORS, SURFACES> {
    /// A tag somewhere around `position_m` with no surfaces, of which never less is known than that it is within `reach_m`, metres.
    /// A `bias_std_m` of 0 switches the biases off
    /// (they stay at `bias_mean_m`).
    pub fn new(
        motion: Motion,
        reach_m: f32,
        position_m: [f32; 2],
        position_std_m: f32,
        velocity_std_m_s: f32,
        bias_mean_m: f32,
        bias_std_m: f32,
    ) -> Self {
        let mut own = Self::empty();
        own.start(motion, reach_m, position_m, position_std_m, velocity_std_m_s, bias_mean_m, bias_std_m);
        own
    }

    /// All zeros: to be started.
    #[inline(always)] // built where it stays
    pub const fn empty() -> Self {
        const fn xx() -> Matrix4<f32> {
            Matrix4::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        }
        Self {
            mean: StateVector {
                agent: Vector4::new(0.0, 0.0, 0.0, 0.0),
                bias_m: [0.0; ANCHORS],
                surfaces: [Vector2::new(0.0, 0.0); SURFACES],
            },
            covariance: Covariance {
                xx: xx(),
                xb: [Vector4::new(0.0, 0.0, 0.0, 0.0); ANCHORS],
                bb: [[0.0; ANCHORS]; ANCHORS],
                xs: [Matrix4x2::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0); SURFACES],
                bs: [[Vector2::new(0.0, 0.0); ANCHORS]; SURFACES],
                ss: SurfaceCovariance::zero(),
            },
            surfaces: [None; SURFACES],
            estimate_bias: false,
            bias_limits_m2: [0.0; ANCHORS],
            motion: Motion::NONE,
            reach_m: 0.0,
        }
    }

    /// As [`Self::new`], of one that is empty, where it stays.
    #[allow(clippy::too_many_arguments)] // each is one number of the start
    pub fn start(
        &mut self,
        motion: Motion,
        reach_m: f32,
        position_m: [f32; 2],
        position_std_m: f32,
        velocity_std_m_s: f32,
        bias_mean_m: f32,
        bias_std_m: f32,
    ) {
        let [x, y] = position_m;
        let position = position_std_m * position_std_m;
        let velocity = velocity_std_m_s * velocity_std_m_s;
        self.mean.agent = Vector4::new(x, y, 0.0, 0.0);
        self.mean.bias_m = [bias_mean_m; ANCHORS];
        self.covariance.xx = Matrix4::from_diagonal(&Vector4::new(position, position, velocity, velocity));
        for (j, row) in self.covariance.bb.iter_mut().enumerate() {
            if let Some(variance) = row.get_mut(j) {
                *variance = bias_std_m * bias_std_m;
            }
        }
        self.estimate_bias = bias_std_m > 0.0;
        self.bias_limits_m2 = [bias_std_m * bias_std_m; ANCHORS];
        self.motion = motion;
        self.reach_m = reach_m;
    }

    /// Whether finite numbers are what they may be: what it was told is that, no variance is negative, and no covariance is far beyond what its variances allow.
    pub(crate) fn is_sound(
        &self,
        motion: &Motion,
        reach_m: f32,
        range_biases_m: &[[f32; 2]; ANCHORS],
    ) -> bool {
        let Covariance { xx, xb, bb, xs, bs, ss } = &self.covariance;
        let is_told = self.motion == *motion
            && self.reach_m == reach_m
            && self.bias_limits_m2 == range_biases_m.map(|[_, std_m]| std_m * std_m)
            && self.estimate_bias == range_biases_m.iter().any(|[_, std_m]| *std_m > 0.0);
        let agent_m2 = [xx.m11, xx.m22, xx.m33, xx.m44];
        let is_variance = |variance: f32| variance >= 0.0;
        let mut is_sound = is_told && agent_m2.into_iter().all(is_variance);
        for (column, a) in xx.column_iter().zip(agent_m2) {
            is_sound &= may_be(column.as_slice(), a, &agent_m2);
        }
        let mut biases_m2 = [0.0; ANCHORS];
        for (anchor, (variance_m2, row)) in biases_m2.iter_mut().zip(bb).enumerate() {
            *variance_m2 = row.get(anchor).copied().unwrap_or(0.0);
        }
        for ((own_m2, row), cross) in biases_m2.iter().zip(bb).zip(xb) {
            is_sound &= is_variance(*own_m2)
                && may_be(row, *own_m2, &biases_m2)
                && may_be(cross.as_slice(), *own_m2, &agent_m2);
        }
        for ((([first, second], xs), bs), surface) in ss.variances().zip(xs).zip(bs).zip(&self.surfaces) {
            if surface.is_none() {
                continue;
            }
            is_sound &= is_variance(*first) && is_variance(*second);
            for (column, own) in xs.column_iter().zip([*first, *second]) {
                is_sound &= may_be(column.as_slice(), own, &agent_m2);
            }
            for (c, other) in bs.iter().zip(&biases_m2) {
                is_sound &= may_be(c.as_slice(), *other, &[*first, *second]);
            }
        }
        is_sound
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

    /// Takes the range bias of an anchor for `mean_m` give or take `std_m` (0: exactly), metres, whatever was known of it; it is never
    /// known worse. Without such an anchor, nothing changes.
    pub fn tell_bias(&mut self, anchor: usize, mean_m: f32, std_m: f32) {
        let Covariance { xb, bb, bs, .. } = &mut self.covariance;
        let (Some(mean), Some(limit_m2)) =
            (self.mean.bias_m.get_mut(anchor), self.bias_limits_m2.get_mut(anchor))
        else {
            return;
        };
        *mean = mean_m;
        *limit_m2 = std_m * std_m;
        if let Some(cross) = xb.get_mut(anchor) {
            cross.fill(0.0);
        }
        for (j, row) in bb.iter_mut().enumerate() {
            for (k, entry) in row.iter_mut().enumerate() {
                if j == anchor || k == anchor {
                    *entry = if j == k { *limit_m2 } else { 0.0 };
                }
            }
        }
        for cross in bs.iter_mut().filter_map(|row| row.get_mut(anchor)) {
            cross.fill(0.0);
        }
        self.estimate_bias = self.bias_limits_m2.iter().any(|limit_m2| *limit_m2 > 0.0);
    }

    /// What the surface in `slot` is, its two numbers and their covariance; `None` for a free slot.
    pub fn surface(&self, slot: usize) -> Option<(Surface, Vector2<f32>, Matrix2<f32>)> {
        let surface = (*self.surfaces.get(slot)?)?;
        Some((surface, *self.mean.surfaces.get(slot)?, self.covariance.ss.get(slot, slot)?))
    }

    /// The first free slot.
    pub fn free_slot(&self) -> Option<usize> {
        self.surfaces.iter().position(Option::is_none)
    }

    /// The image of an anchor in a sequence of surfaces; `None` where one of them is free.
    pub fn image(&self, anchor_m: [f32; 2], sequence: &Sequence) -> Option<Image> {
        let surface = |slot: u8| {
            let slot = usize::from(slot);
            Some((self.surfaces.get(slot)?.as_ref()?, self.mean.surfaces.get(slot)?))
        };
        let (surface_1, state) = surface(sequence.first)?;
        let image = Image::first(anchor_m, surface_1, state);
        let Some(second) = sequence.second else { return Some(image) };
        let (surface_2, state) = surface(second)?;
        Some(image.second(surface_2, state))
    }

    /// Where an image is expected, metres, and the covariance of its position, square metres.
    pub fn placed(&self, anchor_m: [f32; 2], sequence: &Sequence) -> Option<(Vector2<f32>, Matrix2<f32>)> {
        let image = self.image(anchor_m, sequence)?;
        let [first, second] = self.slots(sequence);
        let mut spread = self.own_spread(&image, first, second)?;
        spread.m12 = spread.m21;
        Some((self.expected_m(&image, first, second)?, spread))
    }

    /// The slots of a sequence.
    fn slots(&self, sequence: &Sequence) -> [Option<usize>; 2] {
        [Some(usize::from(sequence.first)), sequence.second.map(usize::from)]
    }

    /// Where an image is expected: its curvature shifts the mean.
    fn expected_m(&self, image: &Image, first: Option<usize>, second: Option<usize>) -> Option<Vector2<f32>> {
        let none = Matrix2::new(0.0, 0.0, 0.0, 0.0);
        let own = |slot: Option<usize>| slot.map_or(Some(none), |slot| self.covariance.ss.get(slot, slot));
        let cross = match (first, second) {
            (Some(first), Some(second)) => self.covariance.ss.get(first, second)?,
            _ => none,
        };
        let shift = image.shift_m(&[own(first)?, own(second)?], &cross);
        Some(Vector2::new(image.position_m.x + shift.x, image.position_m.y + shift.y))
    }

    /// D C_ss D' of an image: its entries on and below the diagonal.
    fn own_spread(&self, image: &Image, first: Option<usize>, second: Option<usize>) -> Option<Matrix2<f32>> {
        let [d1, d2] = &image.slopes;
        let first = first?;
        let mut spread = sandwiched(d1, &self.covariance.ss.get(first, first)?);
        if let Some(second) = second {
            let own = sandwiched(d2, &self.covariance.ss.get(second, second)?);
            // D_1 C_12 D_2' and its transpose.
            let c = self.covariance.ss.get(first, second)?;
            let k = product_transposed(&product(d1, &c), d2);
            spread.m11 += own.m11 + 2.0 * k.m11;
            spread.m21 += own.m21 + (k.m21 + k.m12);
            spread.m22 += own.m22 + 2.0 * k.m22;
        }
        Some(spread)
    }

    /// Puts the tag somewhere else: its covariance with everything else is gone.
    pub fn place(&mut self, agent: &Agent) {
        self.mean.agent = agent.mean;
        let c = &mut self.covariance;
        c.xx = agent.covariance;
        c.xb.iter_mut().for_each(|cross| cross.fill(0.0));
        c.xs.iter_mut().for_each(|cross| cross.fill(0.0));
    }

    /// Adds a surface that is not correlated with anything, with the standard deviations of its two numbers; false where
    /// `slot` is taken or does not exist. With deviations of 0 it is known exactly and stays where it is.
    pub fn insert_independent(
        &mut self,
        slot: usize,
        surface: Surface,
        state: Vector2<f32>,
        std: [f32; 2],
    ) -> bool {
        let [first, second] = std;
        self.insert(slot, surface, state, Matrix2::new(first * first, 0.0, 0.0, second * second))
    }

    /// Puts a surface where it was in a stored map, whatever was there.
    pub(crate) fn restore(&mut self, slot: usize, surface: Surface, state: Vector2<f32>, own: Matrix2<f32>) {
        self.remove(slot);
        self.insert(slot, surface, state, own);
    }

    /// Block of C_ss between two surfaces; 0 where there are none.
    pub(crate) fn block(&self, k: usize, l: usize) -> Matrix2<f32> {
        self.covariance.ss.get(k, l).unwrap_or(Matrix2::new(0.0, 0.0, 0.0, 0.0))
    }

    /// Sets that block between two surfaces of a stored map.
    pub(crate) fn restore_block(&mut self, k: usize, l: usize, block: &Matrix2<f32>) {
        self.covariance.ss.set(k, l, block);
    }

    /// Adds a private surface located relative to the tag's position p: its deviation is `gain` (p - E p) plus an error
    /// of covariance `own`. Hence C_ss = G C_pp G' + C_own and C_s* = G C_p* for every other state.
    pub fn insert_relative(
        &mut self,
        slot: usize,
        position: Vector2<f32>,
        gain: &Matrix2<f32>,
        own: &Matrix2<f32>,
    ) -> bool {
        if !self.insert(slot, Surface::Private, position, *own) {
            return false;
        }
        let c = &mut self.covariance;
        // Row of C_s* for a column (x, y) of C_p*.
        let carried = |x: f32, y: f32| (gain.m11 * x + gain.m12 * y, gain.m21 * x + gain.m22 * y);
        let xx = c.xx;
        let (m11, m12) = carried(xx.m11, xx.m21);
        let (m21, m22) = carried(xx.m21, xx.m22);
        let (m31, m32) = carried(xx.m31, xx.m32);
        let (m41, m42) = carried(xx.m41, xx.m42);
        if let Some(cross) = c.xs.get_mut(slot) {
            *cross = Matrix4x2::new(m11, m12, m21, m22, m31, m32, m41, m42);
        }
        if let Some(row) = c.bs.get_mut(slot) {
            for (bs, xb) in row.iter_mut().zip(&c.xb) {
                let (x, y) = carried(xb.x, xb.y);
                *bs = Vector2::new(x, y);
            }
        }
        for (other, (xs, _)) in
            c.xs.iter().zip(&self.surfaces).enumerate().filter(|(_, (_, surface))| surface.is_some())
        {
            let ((xx, yx), (xy, yy)) = (carried(xs.m11, xs.m21), carried(xs.m12, xs.m22));
            let block = if other == slot {
                Matrix2::new(own.m11 + xx, own.m21 + yx, own.m21 + yx, own.m22 + yy)
            } else {
                Matrix2::new(xx, xy, yx, yy)
            };
            c.ss.set(slot, other, &block);
        }
        true
    }

    fn insert(&mut self, slot: usize, surface: Surface, state: Vector2<f32>, own: Matrix2<f32>) -> bool {
        let Some(place @ None) = self.surfaces.get_mut(slot) else { return false };
        *place = Some(surface);
        if let Some(mean) = self.mean.surfaces.get_mut(slot) {
            *mean = state;
        }
        self.clear_covariance(slot);
        self.covariance.ss.set(slot, slot, &own);
        true
    }

    /// A deviation that surfaces have in common, of this variance: `slopes` tells what of it each surface's two numbers
    /// are. C_ss <- C_ss + variance h h'; surfaces known exactly have none.
    pub fn correlate(&mut self, variance: f32, slopes: impl Fn(usize, &Surface) -> [f32; 2]) {
        let mut common = [Vector2::new(0.0, 0.0); SURFACES];
        let own = self.surfaces.iter().zip(self.covariance.ss.variances());
        for (slot, (common, (surface, [first_m2, second_m2]))) in common.iter_mut().zip(own).enumerate() {
            if let Some(surface) = surface {
                let [first, second] = slopes(slot, surface);
                common.x = if *first_m2 > 0.0 { first } else { 0.0 };
                common.y = if *second_m2 > 0.0 { second } else { 0.0 };
            }
        }
        let mut pending = Pending::<SURFACES, 1>::new();
        pending.push(variance, &common);
        self.settle(&pending);
    }

    /// Covariance of a linear form of surfaces, the sum of D_k s_k over its parts (the slot of s_k, D_k); `None` where a slot
    /// does not exist.
    pub fn form_covariance(&self, parts: &[(usize, Matrix2<f32>)]) -> Option<Matrix2<f32>> {
        let mut sum = Matrix2::new(0.0, 0.0, 0.0, 0.0);
        for (k, d_k) in parts {
            for (l, d_l) in parts {
                let c = product_transposed(&product(d_k, &self.covariance.ss.get(*k, *l)?), d_l);
                sum.m11 += c.m11;
                sum.m21 += c.m21;
                sum.m12 += c.m12;
                sum.m22 += c.m22;
            }
        }
        Some(sum)
    }

    /// Says that a linear form of surfaces, the sum of D_k s_k over its parts (the slot of s_k, D_k), is larger by `gap` than
    /// it is, but for an error of `variance` in each of both numbers: two rank-one updates.
    pub fn constrain(&mut self, parts: &[(usize, Matrix2<f32>)], gap: [f32; 2], variance: f32) {
        self.cover_rounding();
        let prior = self.mean.surfaces;
        for (number, gap) in gap.into_iter().enumerate() {
            let row = |d: &Matrix2<f32>| if number == 0 { [d.m11, d.m12] } else { [d.m21, d.m22] };
            let Some((direction, explained)) = self.form_direction(parts, row) else { return };
            let mut innovation = gap;
            for (slot, d) in parts {
                let [hx, hy] = row(d);
                if let (Some(now), Some(then)) = (self.mean.surfaces.get(*slot), prior.get(*slot)) {
                    innovation -= hx * (now.x - then.x) + hy * (now.y - then.y);
                }
            }
            let moments = Moments { weight: 1.0, first_m: innovation, second_m2: innovation * innovation };
            let change = SoftUpdate::new(&moments, explained + variance, explained);
            self.change(&direction, change.mean, change.covariance);
        }
    }

    /// w = C h and h' C h for the form h that has this row of every part.
    fn form_direction(
        &self,
        parts: &[(usize, Matrix2<f32>)],
        row: impl Fn(&Matrix2<f32>) -> [f32; 2],
    ) -> Option<(StateVector<ANCHORS, SURFACES>, f32)> {
        let c = &self.covariance;
        let mut agent = Vector4::new(0.0, 0.0, 0.0, 0.0);
        let mut bias_m = [0.0; ANCHORS];
        let mut surfaces = [Vector2::new(0.0, 0.0); SURFACES];
        let nothing = Pending::<SURFACES, CHANGES_PER_PASS>::new();
        for (slot, d) in parts {
            let [hx, hy] = row(d);
            let xs = c.xs.get(*slot)?;
            agent.x += hx * xs.m11 + hy * xs.m12;
            agent.y += hx * xs.m21 + hy * xs.m22;
            agent.z += hx * xs.m31 + hy * xs.m32;
            agent.w += hx * xs.m41 + hy * xs.m42;
            for (w, bs) in bias_m.iter_mut().zip(c.bs.get(*slot)?) {
                *w += hx * bs.x + hy * bs.y;
            }
            c.ss.add_row(*slot, [hx, hy], &nothing, &mut surfaces)?;
        }
        let mut explained = 0.0;
        for (slot, d) in parts {
            let [hx, hy] = row(d);
            let w = surfaces.get(*slot)?;
            explained += hx * w.x + hy * w.y;
        }
        Some((StateVector { agent, bias_m, surfaces }, larger(explained, 0.0)))
    }

    /// Describes a surface by other numbers: `state` are the new ones now, and `slopes` those of the new over the old. Its
    /// rows of the covariance are multiplied by them, its own block from both sides. False for a free slot.
    pub fn rebase(
        &mut self,
        slot: usize,
        surface: Surface,
        state: Vector2<f32>,
        slopes: &Matrix2<f32>,
    ) -> bool {
        let Some(place @ Some(_)) = self.surfaces.get_mut(slot) else { return false };
        *place = Some(surface);
        if let Some(mean) = self.mean.surfaces.get_mut(slot) {
            *mean = state;
        }
        let t = slopes;
        let c = &mut self.covariance;
        if let Some(xs) = c.xs.get_mut(slot) {
            let carried = |x: f32, y: f32| (t.m11 * x + t.m12 * y, t.m21 * x + t.m22 * y);
            let ((a, e), (b, f)) = (carried(xs.m11, xs.m12), carried(xs.m21, xs.m22));
            let ((c, g), (d, h)) = (carried(xs.m31, xs.m32), carried(xs.m41, xs.m42));
            *xs = Matrix4x2::new(a, e, b, f, c, g, d, h);
        }
        for bs in c.bs.get_mut(slot).into_iter().flatten() {
            *bs = Vector2::new(t.m11 * bs.x + t.m12 * bs.y, t.m21 * bs.x + t.m22 * bs.y);
        }
        for (other, _) in self.surfaces.iter().enumerate().filter(|(_, surface)| surface.is_some()) {
            let Some(block) = c.ss.get(slot, other) else { continue };
            let carried = product(t, &block);
            c.ss.set(slot, other, &if other == slot { product_transposed(&carried, t) } else { carried });
        }
        true
    }

    /// Moves a surface to another slot; what was there is gone. False where `from` is free, or there is no slot `to`.
    pub fn relocate(&mut self, from: usize, to: usize) -> bool {
        let Some(Some(surface)) = self.surfaces.get(from).copied() else { return false };
        if from == to || self.surfaces.get(to).is_none() {
            return from == to;
        }
        self.remove(to);
        let mut blocks = [Matrix2::new(0.0, 0.0, 0.0, 0.0); SURFACES];
        for (other, block) in blocks.iter_mut().enumerate() {
            let other = if other == to { from } else { other };
            if let Some(between) = self.covariance.ss.get(from, other) {
                *block = between;
            }
        }
        let c = &mut self.covariance;
        let (xs, bs) = (c.xs.get(from).copied(), c.bs.get(from).copied());
        if let (Some(place), Some(xs)) = (c.xs.get_mut(to), xs) {
            *place = xs;
        }
        if let (Some(place), Some(bs)) = (c.bs.get_mut(to), bs) {
            *place = bs;
        }
        let state = self.mean.surfaces.get(from).copied();
        if let (Some(place), Some(state)) = (self.mean.surfaces.get_mut(to), state) {
            *place = state;
        }
        if let Some(place) = self.surfaces.get_mut(to) {
            *place = Some(surface);
        }
        self.remove(from);
        for (other, block) in blocks.iter().enumerate().filter(|(other, _)| *other != from) {
            self.covariance.ss.set(to, other, block);
        }
        true
    }

    /// The tag has turned, some time in the last `elapsed_s` seconds: its velocity is drawn anew with this variance per axis, and
    /// tells nothing of anything else.
    pub fn turn(&mut self, velocity_m2_s2: f32, elapsed_s: f32) {
        self.mean.agent.z = 0.0;
        self.mean.agent.w = 0.0;
        let c = &mut self.covariance;
        let (m11, m21, m22) = (c.xx.m11, c.xx.m21, c.xx.m22);
        c.xx = Matrix4::new(m11, m21, 0.0, 0.0, m21, m22, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
        for cross in &mut c.xb {
            cross.z = 0.0;
            cross.w = 0.0;
        }
        for cross in &mut c.xs {
            *cross = Matrix4x2::new(cross.m11, cross.m12, cross.m21, cross.m22, 0.0, 0.0, 0.0, 0.0);
        }
        ProcessNoise::of_turn(velocity_m2_s2, elapsed_s).add_to(&mut c.xx);
    }

    /// One of the parts into which a Gaussian is split along a `direction` (a unit vector) of the tag's position: moved by so many
    /// standard deviations along it, with this `share` of the variance there left. All other states follow by their covariance.
    pub fn narrow(&mut self, [ex, ey]: [f32; 2], deviations: f32, share: f32) {
        let c = &self.covariance;
        let xx = &c.xx;
        let agent = Vector4::new(
            ex * xx.m11 + ey * xx.m21,
            ex * xx.m21 + ey * xx.m22,
            ex * xx.m31 + ey * xx.m32,
            ex * xx.m41 + ey * xx.m42,
        );
        let variance = ex * agent.x + ey * agent.y;
        if variance <= 0.0 {
            return;
        }
        let mut w =
            StateVector { agent, bias_m: [0.0; ANCHORS], surfaces: [Vector2::new(0.0, 0.0); SURFACES] };
        for (w, xb) in w.bias_m.iter_mut().zip(&c.xb) {
            *w = ex * xb.x + ey * xb.y;
        }
        for (w, xs) in w.surfaces.iter_mut().zip(&c.xs) {
            *w = Vector2::new(ex * xs.m11 + ey * xs.m21, ex * xs.m12 + ey * xs.m22);
        }
        self.change(&w, deviations / sqrt(variance), (share - 1.0) / variance);
    }

    /// The mixture of this Gaussian with another one over the same surfaces, whose weight is this `share`, as one Gaussian of the
    /// same mean and covariance.
    pub fn merge(&mut self, other: &Self, share: f32) {
        let mut apart = other.mean;
        apart.agent -= self.mean.agent;
        for (apart, own) in apart.bias_m.iter_mut().zip(&self.mean.bias_m) {
            *apart -= own;
        }
        for (apart, own) in apart.surfaces.iter_mut().zip(&self.mean.surfaces) {
            *apart -= own;
        }
        let rest = 1.0 - share;
        let mix = |own: f32, other: f32| rest * own + share * other;
        let (c, o) = (&mut self.covariance, &other.covariance);
        c.xx = c.xx.zip_map(&o.xx, mix);
        for (c, o) in c.xb.iter_mut().zip(&o.xb) {
            *c = c.zip_map(o, mix);
        }
        for (c, o) in c.bb.iter_mut().flatten().zip(o.bb.iter().flatten()) {
            *c = mix(*c, *o);
        }
        for (c, o) in c.xs.iter_mut().zip(&o.xs) {
            *c = c.zip_map(o, mix);
        }
        for (c, o) in c.bs.iter_mut().flatten().zip(o.bs.iter().flatten()) {
            *c = c.zip_map(o, mix);
        }
        c.ss.mix(&o.ss, mix);
        self.change(&apart, share, share * rest);
    }

    /// x <- x + w gain, C <- C + scale w w'.
    fn change(&mut self, w: &StateVector<ANCHORS, SURFACES>, gain: f32, scale: f32) {
        self.step(w, gain, scale);
        let mut pending = Pending::<SURFACES, 1>::new();
        pending.push(scale, &w.surfaces);
        self.settle(&pending);
    }

    /// Takes over what surfaces another state has and this one has not, or has otherwise, as independent of everything else; what
    /// the other one has not goes.
    pub fn follow_map(&mut self, other: &Self) {
        for slot in 0..SURFACES {
            if self.surfaces.get(slot) != other.surfaces.get(slot) {
                self.remove(slot);
                if let Some((surface, state, own)) = other.surface(slot) {
                    self.insert(slot, surface, state, own);
                }
            }
        }
    }

    /// Begins to estimate which way the body of the tag faces, in the last slot: nothing is known of it. False where that is taken or
    /// does not exist.
    pub fn insert_heading(&mut self, turns_per_s: f32) -> bool {
        let Some(last) = SURFACES.checked_sub(1) else { return false };
        // Of a unit vector in any direction.
        let own = Matrix2::new(0.5, 0.0, 0.0, 0.5);
        self.insert(last, Surface::Heading { turns_per_s }, Vector2::new(0.0, 0.0), own)
    }

    /// Mean and covariance of the unit vector along the body's axis; `None` where it is not estimated.
    pub fn heading(&self) -> Option<(Vector2<f32>, Matrix2<f32>)> {
        let (_, mean, covariance) = self.surface(self.heading_slot()?)?;
        Some((mean, covariance))
    }

    fn heading_slot(&self) -> Option<usize> {
        matches!(self.surfaces.last()?, Some(Surface::Heading { .. })).then_some(SURFACES - 1)
    }

    /// The heading was drawn anew, as often as this times `elapsed_s`: what is known of it fades.
    fn turn_body(&mut self, slot: usize, turns: f32) {
        let kept = exp(-turns);
        if let Some(mean) = self.mean.surfaces.get_mut(slot) {
            mean.x *= kept;
            mean.y *= kept;
        }
        let c = &mut self.covariance;
        if let Some(cross) = c.xs.get_mut(slot) {
            cross.iter_mut().for_each(|entry| *entry *= kept);
        }
        for cross in c.bs.get_mut(slot).into_iter().flatten() {
            cross.x *= kept;
            cross.y *= kept;
        }
        let mut factors = [Vector2::new(1.0, 1.0); SURFACES];
        if let Some(factor) = factors.get_mut(slot) {
            *factor = Vector2::new(kept, kept);
        }
        c.ss.scale(&factors);
        if let Some([first, second]) = c.ss.variances_mut().nth(slot) {
            let renewed = 0.5 * (1.0 - kept * kept);
            *first += renewed;
            *second += renewed;
        }
    }

    /// Takes a surface out of the state; false where `slot` is free.
    pub fn remove(&mut self, slot: usize) -> bool {
        let Some(surface) = self.surfaces.get_mut(slot) else { return false };
        let was = surface.take().is_some();
        self.clear_covariance(slot);
        if let Some(mean) = self.mean.surfaces.get_mut(slot) {
            *mean = Vector2::new(0.0, 0.0);
        }
        was
    }

    fn clear_covariance(&mut self, slot: usize) {
        let c = &mut self.covariance;
        if let Some(block) = c.xs.get_mut(slot) {
            block.fill(0.0);
        }
        if let Some(row) = c.bs.get_mut(slot) {
            row.iter_mut().for_each(|cross| cross.fill(0.0));
        }
        c.ss.clear(slot);
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
        for ((cross, [first_m2, second_m2]), surface) in
            c.xs.iter_mut().zip(c.ss.variances_mut()).zip(&self.surfaces)
        {
            let Some(surface) = surface else { continue };
            cross.m11 += drift * cross.m31;
            cross.m21 += drift * cross.m41;
            cross.m12 += drift * cross.m32;
            cross.m22 += drift * cross.m42;
            cross.m31 *= decay;
            cross.m41 *= decay;
            cross.m32 *= decay;
            cross.m42 *= decay;
            let second = match surface {
                Surface::Private => walk_m2,
                Surface::Wall(_) => walk_m2 * ROTATION_WALK_PER_M2,
                Surface::Heading { .. } => continue,
            };
            // What has no variance is known exactly.
            if *first_m2 > 0.0 {
                *first_m2 += walk_m2;
            }
            if *second_m2 > 0.0 {
                *second_m2 += second;
            }
        }
        if let Some(Some(Surface::Heading { turns_per_s })) = self.surfaces.last() {
            self.turn_body(SURFACES - 1, turns_per_s * elapsed_s);
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
        for ([first_m2, second_m2], surface) in c.ss.variances_mut().zip(&self.surfaces) {
            if surface.is_some() {
                *first_m2 *= margin;
                *second_m2 *= margin;
            }
        }
    }

    /// Scales back every state whose variance exceeds its limit.
    fn limit(&mut self) {
        let c = &mut self.covariance;
        let reach = self.reach_m * self.reach_m;
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
            for (j, ((factor_b, row), limit_m2)) in
                b.iter_mut().zip(&c.bb).zip(&self.bias_limits_m2).enumerate()
            {
                if let Some(variance) = row.get(j) {
                    *factor_b = factor(*variance, *limit_m2);
                }
            }
        }
        let mut s = [Vector2::new(1.0, 1.0); SURFACES];
        for ((factor_s, [first_m2, second_m2]), surface) in
            s.iter_mut().zip(c.ss.variances()).zip(&self.surfaces)
        {
            let second = match surface {
                Some(Surface::Wall(_)) => ROTATION_LIMIT,
                _ => SURFACE_LIMIT_M2,
            };
            factor_s.x = factor(*first_m2, SURFACE_LIMIT_M2);
            factor_s.y = factor(*second_m2, second);
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
        for ((xs, bs), fs) in c.xs.iter_mut().zip(&mut c.bs).zip(&s) {
            for (column, fc) in xs.column_iter_mut().zip(fs.iter()) {
                scale(column, x.iter(), *fc);
            }
            for (cross, fb) in bs.iter_mut().zip(&b) {
                scale(cross.column_mut(0), fs.iter(), *fb);
            }
        }
        c.ss.scale(&s);
    }

    /// Regression of the range to `source` on the current state; `sequence` is what reflects it, `None` for a direct path.
    /// `None` for a free slot or unknown anchor.
    pub fn regress(&self, source: Source, sight: &Sight, sequence: Option<&Sequence>) -> Option<Regression> {
        let c = &self.covariance;
        let agent = &self.mean.agent;
        let anchor = source.anchor();
        let bias = *self.mean.bias_m.get(anchor)?;
        let xb = c.xb.get(anchor)?;
        let xx = &c.xx;
        let image = match sequence {
            None => Image::still(sight.anchor_m),
            Some(sequence) => self.image(sight.anchor_m, sequence)?,
        };
        let slots = sequence.map_or([None; 2], |sequence| self.slots(sequence));
        let [first, second] = slots;
        let mut position_m = image.position_m;
        let mut spread = [xx.m11, xx.m21, xx.m22];
        let mut bias_cross = [xb.x, xb.y];
        if first.is_some() {
            position_m = self.expected_m(&image, first, second)?;
            let [mut sxx, mut syx, mut syy] = spread;
            let [mut cx, mut cy] = bias_cross;
            for (slot, d) in slots.iter().zip(&image.slopes) {
                let Some(slot) = *slot else { continue };
                // C_pm of this surface's part.
                let xs = c.xs.get(slot)?;
                let k = product_transposed(&Matrix2::new(xs.m11, xs.m12, xs.m21, xs.m22), d);
                sxx -= 2.0 * k.m11;
                syx -= k.m21 + k.m12;
                syy -= 2.0 * k.m22;
                let bs = c.bs.get(slot)?.get(anchor)?;
                cx -= d.m11 * bs.x + d.m12 * bs.y;
                cy -= d.m21 * bs.x + d.m22 * bs.y;
            }
            let own = self.own_spread(&image, first, second)?;
            spread = [sxx + own.m11, syx + own.m21, syy + own.m22];
            bias_cross = [cx, cy];
        }
        let mut distance = [agent.x - position_m.x, agent.y - position_m.y];
        let [ahead, left] = sight.lever_arm_m;
        let heading = if ahead == 0.0 && left == 0.0 { None } else { self.heading_slot() };
        if let Some(slot) = heading {
            // Where the antenna is from the centre: linear in the heading.
            let arm = Matrix2::new(ahead, -left, left, ahead);
            let u = self.mean.surfaces.get(slot)?;
            let [dx, dy] = distance;
            distance = [dx + (ahead * u.x - left * u.y), dy + (left * u.x + ahead * u.y)];
            let [mut sxx, mut syx, mut syy] = spread;
            let xs = c.xs.get(slot)?;
            let k = product_transposed(&Matrix2::new(xs.m11, xs.m12, xs.m21, xs.m22), &arm);
            let own = sandwiched(&arm, &c.ss.get(slot, slot)?);
            sxx += 2.0 * k.m11 + own.m11;
            syx += (k.m21 + k.m12) + own.m21;
            syy += 2.0 * k.m22 + own.m22;
            for (surface, d) in slots.iter().zip(&image.slopes) {
                let Some(surface) = *surface else { continue };
                let k = product_transposed(&product(&arm, &c.ss.get(slot, surface)?), d);
                sxx -= 2.0 * k.m11;
                syx -= k.m21 + k.m12;
                syy -= 2.0 * k.m22;
            }
            spread = [sxx, syx, syy];
            let bs = c.bs.get(slot)?.get(anchor)?;
            let [cx, cy] = bias_cross;
            bias_cross = [cx + (ahead * bs.x - left * bs.y), cy + (left * bs.x + ahead * bs.y)];
        }
        let line = regress_distance(distance, spread, sight.height_m, sight.height_std_m);
        let [gx, gy] = line.slope;
        let mut explained_m2 = line.explained_m2;
        if self.estimate_bias {
            let own = c.bb.get(anchor)?.get(anchor)?;
            let [cx, cy] = bias_cross;
            explained_m2 = larger(explained_m2 + 2.0 * (gx * cx + gy * cy) + own, SMALLEST_SPREAD_M2);
        }
        let [d1, d2] = &image.slopes;
        let over = |slot: Option<usize>, d: &Matrix2<f32>| SurfaceSlope {
            surface: slot,
            slope: [-(gx * d.m11 + gy * d.m21), -(gx * d.m12 + gy * d.m22)],
        };
        Some(Regression {
            source,
            range_m: line.range_m + bias,
            slope: line.slope,
            surfaces: [over(first, d1), over(second, d2)],
            heading: match heading {
                Some(_) => [gx * ahead + gy * left, gy * ahead - gx * left],
                None => [0.0; 2],
            },
            residual_m2: line.residual_m2,
            explained_m2,
        })
    }

    /// Applies the innovations of one cycle, whose regressions must all have been taken since [`Self::predict`].
    pub fn update(&mut self, innovations: impl IntoIterator<Item = Innovation>) {
        self.update_and_read(innovations, core::iter::empty::<(&Regression, ())>(), |(), _, _| None);
    }

    /// The same, and then what else is known of ranges, each of which is `asked` for and `read` where the state expects it by then:
    /// at this mean, metres, and with this variance, square metres.
    pub fn update_and_read<'r, T>(
        &mut self,
        innovations: impl IntoIterator<Item = Innovation>,
        asked: impl IntoIterator<Item = (&'r Regression, T)>,
        mut read: impl FnMut(T, f32, f32) -> Option<Reading>,
    ) {
        let mut innovations = innovations.into_iter().peekable();
        let mut asked = asked.into_iter().peekable();
        if innovations.peek().is_none() && asked.peek().is_none() {
            return;
        }
        self.cover_rounding();
        let prior = self.mean;
        let mut pending = Pending::<SURFACES, CHANGES_PER_PASS>::new();
        for innovation in innovations {
            self.apply(&innovation, &prior, &mut pending);
            if pending.waiting() == CHANGES_PER_PASS {
                self.settle(&pending);
                pending.clear();
            }
        }
        for (regression, of) in asked {
            let Some((direction, explained, shift)) = self.direction(regression, &prior, &pending) else {
                continue;
            };
            let variance_m2 = explained + regression.residual_m2;
            let Some(reading) = read(of, regression.range_m + shift, variance_m2) else { continue };
            let change = reading.change(variance_m2);
            self.step(&direction, change.mean, change.covariance);
            pending.push(change.covariance, &direction.surfaces);
            if pending.waiting() == CHANGES_PER_PASS {
                self.settle(&pending);
                pending.clear();
            }
        }
        self.settle_all(&pending);
    }

    /// Makes the changes that wait, one by one.
    fn settle_all<const N: usize>(&mut self, pending: &Pending<SURFACES, N>) {
        for change in 0..pending.waiting() {
            if let Some(change) = pending.only(change) {
                self.settle(&change);
            }
        }
    }

    fn apply(
        &mut self,
        innovation: &Innovation,
        prior: &StateVector<ANCHORS, SURFACES>,
        pending: &mut Pending<SURFACES, CHANGES_PER_PASS>,
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
        let variance_m2 = explained + (innovation.variance_m2 + regression.residual_m2 + innovation.alike_m2);
        let change = SoftUpdate::new(&moments, variance_m2, explained);
        self.step(&direction, change.mean, change.covariance);
        pending.push(change.covariance, &direction.surfaces);
    }

    /// w = C h, h' C h, and h'(x - x_prior), for the linear form h of a regression.
    fn direction(
        &self,
        regression: &Regression,
        prior: &StateVector<ANCHORS, SURFACES>,
        pending: &Pending<SURFACES, CHANGES_PER_PASS>,
    ) -> Option<(StateVector<ANCHORS, SURFACES>, f32, f32)> {
        let c = &self.covariance;
        let [gx, gy] = regression.slope;
        let anchor = regression.source.anchor();
        let heading = if regression.heading == [0.0; 2] { None } else { self.heading_slot() };
        let heading = heading.map(|slot| SurfaceSlope { surface: Some(slot), slope: regression.heading });
        let parts = regression.surfaces.iter().chain(heading.as_ref());
        let xx = &c.xx;
        let mut agent = Vector4::new(
            gx * xx.m11 + gy * xx.m21,
            gx * xx.m21 + gy * xx.m22,
            gx * xx.m31 + gy * xx.m32,
            gx * xx.m41 + gy * xx.m42,
        );
        let mut bias_m = [0.0; ANCHORS];
        let mut surfaces = [Vector2::new(0.0, 0.0); SURFACES];
        for ((w, xs), surface) in surfaces.iter_mut().zip(&c.xs).zip(&self.surfaces) {
            if surface.is_some() {
                w.x = gx * xs.m11 + gy * xs.m21;
                w.y = gx * xs.m12 + gy * xs.m22;
            }
        }
        let mut shift = gx * (self.mean.agent.x - prior.agent.x) + gy * (self.mean.agent.y - prior.agent.y);
        for SurfaceSlope { surface, slope: [hx, hy] } in parts.clone() {
            let Some(slot) = *surface else { continue };
            let xs = c.xs.get(slot)?;
            agent.x += hx * xs.m11 + hy * xs.m12;
            agent.y += hx * xs.m21 + hy * xs.m22;
            agent.z += hx * xs.m31 + hy * xs.m32;
            agent.w += hx * xs.m41 + hy * xs.m42;
            c.ss.add_row(slot, [*hx, *hy], pending, &mut surfaces)?;
            let now = self.mean.surfaces.get(slot)?;
            let then = prior.surfaces.get(slot)?;
            shift += hx * (now.x - then.x) + hy * (now.y - then.y);
        }
        if self.estimate_bias {
            let xb = c.xb.get(anchor)?;
            agent.x += xb.x;
            agent.y += xb.y;
            agent.z += xb.z;
            agent.w += xb.w;
            for ((w, xb), row) in bias_m.iter_mut().zip(&c.xb).zip(&c.bb) {
                *w = gx * xb.x + gy * xb.y + row.get(anchor)?;
            }
            for SurfaceSlope { surface, slope: [hx, hy] } in parts.clone() {
                let Some(slot) = *surface else { continue };
                for (w, bs) in bias_m.iter_mut().zip(c.bs.get(slot)?) {
                    *w += hx * bs.x + hy * bs.y;
                }
            }
            for ((w, row), surface) in surfaces.iter_mut().zip(&c.bs).zip(&self.surfaces) {
                if surface.is_some() {
                    let bs = row.get(anchor)?;
                    w.x += bs.x;
                    w.y += bs.y;
                }
            }
            shift += self.mean.bias_m.get(anchor)? - prior.bias_m.get(anchor)?;
        }
        let mut explained = gx * agent.x + gy * agent.y;
        for SurfaceSlope { surface, slope: [hx, hy] } in parts.clone() {
            let Some(slot) = *surface else { continue };
            let w = surfaces.get(slot)?;
            explained += hx * w.x + hy * w.y;
        }
        if self.estimate_bias {
            explained += bias_m.get(anchor)?;
        }
        Some((StateVector { agent, bias_m, surfaces }, larger(explained, 0.0), shift))
    }

    /// x <- x + w gain; C <- C + scale w w' but for C_ss, every entry as (scale w_row) w_column with the row of the
    /// later state.
    fn step(&mut self, w: &StateVector<ANCHORS, SURFACES>, gain: f32, scale: f32) {
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
        let rows = c.xs.iter_mut().zip(&mut c.bs).zip(&mut mean.surfaces);
        let slots = rows.zip(&w.surfaces).zip(&self.surfaces);
        for ((((xs, bs), s), ws), surface) in slots {
            if surface.is_none() {
                continue;
            }
            s.x += ws.x * gain;
            s.y += ws.y * gain;
            let (sx, sy) = (scale * ws.x, scale * ws.y);
            xs.m11 += sx * x1;
            xs.m21 += sx * x2;
            xs.m31 += sx * x3;
            xs.m41 += sx * x4;
            xs.m12 += sy * x1;
            xs.m22 += sy * x2;
            xs.m32 += sy * x3;
            xs.m42 += sy * x4;
            if self.estimate_bias {
                for (cross, wb) in bs.iter_mut().zip(&w.bias_m) {
                    cross.x += sx * wb;
                    cross.y += sy * wb;
                }
            }
        }
    }

    /// Makes the changes that C_ss lacks, all `N` in one pass.
    fn settle<const N: usize>(&mut self, pending: &Pending<SURFACES, N>) {
        self.covariance.ss.settle(pending, self.surfaces.iter().map(Option::is_some));
    }

    /// Every number of the state, in a fixed order, for traces.
    #[inline(never)]
    pub fn visit(&self, mut f: impl FnMut(f32)) {
        self.mean.agent.iter().for_each(|v| f(*v));
        self.mean.bias_m.iter().for_each(|v| f(*v));
        self.mean.surfaces.iter().for_each(|v| v.iter().for_each(|v| f(*v)));
        for surface in &self.surfaces {
            let kind = if let Some(Surface::Wall(line)) = surface {
                line.centre_m.iter().chain(&line.normal).for_each(|v| f(*v));
                2.0
            } else if let Some(Surface::Heading { .. }) = surface {
                3.0
            } else {
                f32::from(u8::from(surface.is_some()))
            };
            f(kind);
        }
        let c = &self.covariance;
        c.xx.iter().for_each(|v| f(*v));
        c.xb.iter().for_each(|v| v.iter().for_each(|v| f(*v)));
        c.bb.iter().for_each(|row| row.iter().for_each(|v| f(*v)));
        for (k, (xs, bs)) in c.xs.iter().zip(&c.bs).enumerate() {
            xs.iter().for_each(|v| f(*v));
            bs.iter().for_each(|v| v.iter().for_each(|v| f(*v)));
            let blocks = (0..=k).filter_map(|l| c.ss.get(k, l));
            blocks.for_each(|block| block.iter().for_each(|v| f(*v)));
        }
    }
}

/// Whether numbers may be the covariances of one of this variance with others of those.
#[inline(never)]
fn may_be(covariances: &[f32], variance: f32, others: &[f32]) -> bool {
    // Twice as much as is possible leaves room for rounding.
    covariances.iter().zip(others).all(|(c, other)| c * c <= 4.0 * (variance * other) + f32::MIN_POSITIVE)
}

/// What is known of a range after something else than measurements of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// Probability of what says so.
    pub probability: f32,
    /// By how much the range is longer then than expected, metres.
    pub shift_m: f32,
    /// Its variance then, square metres.
    pub variance_m2: f32,
}

impl Reading {
    /// What it does to a state that expects the range with this variance: with the probability p, the mean moves along w = C h by
    /// shift / S, and C becomes C + (V / S - 1) / S w w'; what is not certain widens it.
    fn change(&self, variance_m2: f32) -> SoftUpdate {
        let inverse = 1.0 / variance_m2;
        let (p, shift) = (self.probability, self.shift_m * inverse);
        let within = p * ((self.variance_m2 * inverse - 1.0) * inverse);
        let covariance = smaller(within + p * (1.0 - p) * (shift * shift), inverse);
        SoftUpdate { mean: p * shift, covariance }
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

stored!(blank Covariance<const ANCHORS, const SURFACES> { xx, xb, bb, xs, bs, ss });
stored!(blank StateVector<const ANCHORS, const SURFACES> { agent, bias_m, surfaces });
stored!(
    blank StateFilter<const ANCHORS, const SURFACES> {
        mean, covariance, surfaces, estimate_bias, bias_limits_m2, motion, reach_m
    }
);

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::SMatrix;
    use std::vec::Vec;

    const ANCHORS: usize = 2;
    const SURFACES: usize = 4;
    const BEFORE: usize = 4 + ANCHORS;
    const SIZE: usize = BEFORE + 2 * SURFACES;
    /// The free slot.
    const FREE: usize = 1;
    type Dense = SMatrix<f64, SIZE, SIZE>;
    type Column = SMatrix<f64, SIZE, 1>;
    type Filter = StateFilter<ANCHORS, SURFACES>;

    /// The joint covariance as one matrix.
    fn dense(filter: &Filter) -> Dense {
        let c = &filter.covariance;
        Dense::from_fn(|row, column| {
            let (row, column) = (row.max(column), row.min(column));
            f64::from(if row < 4 {
                c.xx[(row, column)]
            } else if row < BEFORE {
                if column < 4 { c.xb[row - 4][column] } else { c.bb[row - 4][column - 4] }
            } else {
                let (k, axis) = ((row - BEFORE) / 2, (row - BEFORE) % 2);
                if column < 4 {
                    c.xs[k][(column, axis)]
                } else if column < BEFORE {
                    c.bs[k][column - 4][axis]
                } else {
                    c.ss.get(k, (column - BEFORE) / 2).unwrap()[(axis, (column - BEFORE) % 2)]
                }
            })
        })
    }

    fn mean(filter: &Filter) -> Column {
        let m = &filter.mean;
        let surfaces = m.surfaces.iter().flat_map(|state| [state.x, state.y]);
        let all: Vec<f32> = m.agent.iter().copied().chain(m.bias_m).chain(surfaces).collect();
        Column::from_iterator(all.into_iter().map(f64::from))
    }

    /// A filter in which everything depends on everything but the free slot.
    fn filter() -> Filter {
        let motion = crate::config::Config::default().motion;
        let mut filter = Filter::new(motion, 30.0, [1.0, 2.0], 0.3, 0.2, 0.05, 0.1);
        for slot in (0..SURFACES).filter(|slot| *slot != FREE) {
            let state = Vector2::new(slot as f32 + 3.0, 4.0 - slot as f32);
            assert!(filter.insert_independent(slot, Surface::Private, state, [0.4, 0.3]));
        }
        let mut seed = 1_u32;
        let mut draw = || {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (seed >> 8) as f32 / 8_388_608.0 - 1.0
        };
        let is_free = |n: usize| n >= BEFORE && (n - BEFORE) / 2 == FREE;
        let noise = SMatrix::<f32, SIZE, SIZE>::from_fn(|row, _| if is_free(row) { 0.0 } else { draw() });
        let whole = noise * noise.transpose() * 0.01;
        let c = &mut filter.covariance;
        let at = |row: usize, column: usize| whole[(row, column)];
        c.xx = Matrix4::from_fn(at);
        c.xb = core::array::from_fn(|j| Vector4::from_fn(|row, _| at(row, 4 + j)));
        c.bb = core::array::from_fn(|j| core::array::from_fn(|i| at(4 + j, 4 + i)));
        c.xs = core::array::from_fn(|k| Matrix4x2::from_fn(|row, axis| at(row, BEFORE + 2 * k + axis)));
        c.bs = core::array::from_fn(|k| {
            core::array::from_fn(|j| Vector2::from_fn(|axis, _| at(BEFORE + 2 * k + axis, 4 + j)))
        });
        for k in 0..SURFACES {
            for l in 0..=k {
                let block = |row: usize, column: usize| at(BEFORE + 2 * k + row, BEFORE + 2 * l + column);
                c.ss.set(k, l, &Matrix2::from_fn(block));
            }
        }
        filter
    }

    const FORM: [(usize, Matrix2<f32>); 3] = [
        (3, Matrix2::new(1.0, 0.0, 0.0, 1.0)),
        (0, Matrix2::new(-0.3, 0.8, 0.5, 0.2)),
        (2, Matrix2::new(0.1, -0.6, -0.7, -0.4)),
    ];

    /// The form as rows over the whole state.
    fn rows() -> SMatrix<f64, 2, SIZE> {
        let mut rows = SMatrix::<f64, 2, SIZE>::zeros();
        for (slot, d) in FORM {
            let own = Matrix2::from_fn(|row, column| f64::from(d[(row, column)]));
            rows.fixed_view_mut::<2, 2>(0, BEFORE + 2 * slot).copy_from(&own);
        }
        rows
    }

    fn assert_near<const COLUMNS: usize>(
        ours: &SMatrix<f64, SIZE, COLUMNS>,
        exact: &SMatrix<f64, SIZE, COLUMNS>,
        what: &str,
    ) {
        let worst = (ours - exact).abs().max();
        assert!(worst < 3e-6 * exact.abs().max().max(1.0), "{what}: {worst}");
    }

    #[test]
    fn a_constraint_is_the_kalman_update_of_the_textbook() {
        let mut filter = filter();
        let (h, c, x) = (rows(), dense(&filter), mean(&filter));
        let own = filter.form_covariance(&FORM).unwrap();
        let exact = h * c * h.transpose();
        for (row, column) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            assert!((f64::from(own[(row, column)]) - exact[(row, column)]).abs() < 1e-6);
        }
        let (gap, variance) = ([0.2, -0.1], 0.01);
        filter.constrain(&FORM, gap, variance);
        let s = exact + f64::from(variance) * Matrix2::identity();
        let determinant = s.m11 * s.m22 - s.m12 * s.m21;
        let inverse = Matrix2::new(s.m22, -s.m12, -s.m21, s.m11) / determinant;
        let gain = c * h.transpose() * inverse;
        let moved = x + gain * Vector2::from(gap.map(f64::from));
        let left = c - gain * s * gain.transpose();
        assert_near(&mean(&filter), &moved, "mean");
        assert_near(&dense(&filter), &left, "covariance");
    }

    #[test]
    fn a_change_of_variables_multiplies_rows_and_columns() {
        for slot in [0, 2, 3] {
            let mut filter = filter();
            let c = dense(&filter);
            let slopes = Matrix2::new(0.4, -0.3, 0.2, 0.7);
            let line = crate::model::surface::Line { centre_m: [1.0, 2.0], normal: [0.6, 0.8] };
            let state = Vector2::new(0.1, -0.2);
            assert!(filter.rebase(slot, Surface::Wall(line), state, &slopes));
            let mut t = Dense::identity();
            let own = Matrix2::from_fn(|row, column| f64::from(slopes[(row, column)]));
            t.fixed_view_mut::<2, 2>(BEFORE + 2 * slot, BEFORE + 2 * slot).copy_from(&own);
            assert_near(&dense(&filter), &(t * c * t.transpose()), "covariance");
            assert_eq!(
                filter.surface(slot).map(|(surface, now, _)| (surface, now)),
                Some((Surface::Wall(line), state))
            );
        }
        assert!(!filter().rebase(FREE, Surface::Private, Vector2::zeros(), &Matrix2::identity()));
    }

    /// Its zeros are positive, whatever is multiplied with others' rows: updates may add zeros to them or not.
    #[test]
    fn a_free_slot_has_no_negative_zeros() {
        let mut filter = filter();
        let slopes = Matrix2::new(-0.4, -0.3, -0.2, -0.7);
        assert!(filter.remove(0));
        assert!(filter.insert_relative(0, Vector2::zeros(), &slopes, &Matrix2::identity()));
        for slot in [0, 2, 3] {
            assert!(filter.rebase(slot, Surface::Private, Vector2::zeros(), &slopes));
            let block = filter.covariance.ss.get(slot, FREE).unwrap();
            assert!(block.iter().all(|value| value.to_bits() == 0), "{slot}: {block}");
        }
    }

    #[test]
    fn a_surface_that_moves_to_another_slot_keeps_its_correlations() {
        for (from, to) in [(0, 3), (3, 0), (2, FREE), (0, FREE)] {
            let mut filter = filter();
            let (c, x) = (dense(&filter), mean(&filter));
            assert!(filter.relocate(from, to));
            let mut t = Dense::identity();
            for axis in 0..2 {
                let (from, to) = (BEFORE + 2 * from + axis, BEFORE + 2 * to + axis);
                t[(to, to)] = 0.0;
                t[(to, from)] = 1.0;
                t[(from, from)] = 0.0;
            }
            assert_eq!(dense(&filter), t * c * t.transpose(), "{from} to {to}");
            assert_eq!(mean(&filter), t * x, "{from} to {to}");
            assert!(filter.surface(from).is_none() && filter.surface(to).is_some());
        }
    }

    /// Two walls, a private image, and one that is known exactly; all but the last depend on one another.
    fn walls_and_images() -> Filter {
        let mut filter = filter();
        for (slot, normal) in [(0, [0.6, 0.8]), (3, [0.0, 1.0])] {
            filter.surfaces[slot] = Some(Surface::Wall(crate::model::surface::Line {
                centre_m: [slot as f32 + 3.0, -4.0],
                normal,
            }));
            filter.mean.surfaces[slot] = Vector2::new(0.05, -0.02);
        }
        assert!(filter.insert_independent(FREE, Surface::Private, EXACT, [0.0, 0.0]));
        filter
    }

    /// Where the exact image is.
    const EXACT: Vector2<f32> = Vector2::new(7.0, -3.0);

    /// The image known exactly is where it was, and nothing depends on it.
    fn assert_exact(filter: &Filter, what: &str) {
        let (surface, state, own) = filter.surface(FREE).unwrap();
        assert_eq!((surface, state, own), (Surface::Private, EXACT, Matrix2::zeros()), "{what}");
        let c = dense(filter);
        for n in [BEFORE + 2 * FREE, BEFORE + 2 * FREE + 1] {
            assert!(c.row(n).iter().chain(c.column(n).iter()).all(|entry| *entry == 0.0), "{what}");
        }
    }

    /// Mean and covariance of a mixture.
    fn moments(parts: &[(f64, Column, Dense)]) -> (Column, Dense) {
        let middle = parts.iter().fold(Column::zeros(), |sum, (weight, x, _)| sum + *weight * x);
        let spread = parts.iter().fold(Dense::zeros(), |sum, (weight, x, c)| {
            let off = x - middle;
            sum + *weight * (c + off * off.transpose())
        });
        (middle, spread)
    }

    #[test]
    fn the_parts_of_a_split_component_have_its_mean_and_covariance() {
        use crate::perceptor::belief::BeliefSettings;
        use crate::perceptor::belief::component::Component;
        use crate::perceptor::belief::outage::Outages;
        let outages = Outages::usual(&BeliefSettings::default());
        for swap in [false, true] {
            let mut whole = walls_and_images();
            if swap {
                // The longest axis is the other one.
                whole.covariance.xx.swap_rows(0, 1);
                whole.covariance.xx.swap_columns(0, 1);
                for xb in &mut whole.covariance.xb {
                    xb.swap_rows(0, 1);
                }
                for xs in &mut whole.covariance.xs {
                    xs.swap_rows(0, 1);
                }
            }
            let c = whole.position_covariance_m2().map(f64::from);
            // In closed form by the angle of the longest axis.
            let angle = 0.5 * (2.0 * c.m21).atan2(c.m11 - c.m22);
            let axis = Vector2::new(angle.cos(), angle.sin());
            let widest = (axis.transpose() * c * axis)[0];
            let mut middle = Component::newcomer(whole.clone(), -1.0, outages);
            assert!(middle.axis_above(widest as f32 * 1.001).is_none());
            let along = middle.axis_above(widest as f32 * 0.999).unwrap();
            let mut sides = [middle.clone(), middle.clone()];
            middle.split(along, &mut sides);
            let [left, right] = sides;
            let parts = [&left, &middle, &right].map(|part| {
                (f64::from(part.weight_nat + 1.0).exp(), mean(&part.filter), dense(&part.filter))
            });
            let (x, c) = moments(&parts);
            assert!((parts.iter().map(|part| part.0).sum::<f64>() - 1.0).abs() < 1e-6);
            assert_near(&x, &mean(&whole), "mean");
            assert_near(&c, &dense(&whole), "covariance");
            for (part, deviations) in [&left, &middle, &right].into_iter().zip([1.0, 0.0, 1.0]) {
                let own = part.filter.position_covariance_m2().map(f64::from);
                assert!(((axis.transpose() * own * axis)[0] / widest - 0.5).abs() < 1e-5);
                let [x, y] = part.filter.position_m().map(f64::from);
                let [x0, y0] = whole.position_m().map(f64::from);
                let moved = axis.x * (x - x0) + axis.y * (y - y0);
                assert!((moved.abs() - deviations * widest.sqrt()).abs() < 1e-5);
                assert_exact(&part.filter, "split");
            }
        }
    }

    #[test]
    fn a_part_of_a_gaussian_is_moved_and_narrowed_as_its_covariance_says() {
        let whole = walls_and_images();
        let (x, c) = (mean(&whole), dense(&whole));
        for (direction, deviations, share) in
            [([1.0, 0.0], -1.0, 0.5), ([0.0, 1.0], 2.0, 0.25), ([-0.6, 0.8], 0.0, 0.9)]
        {
            let mut part = whole.clone();
            part.narrow(direction, deviations, share);
            let mut h = Column::zeros();
            (h[0], h[1]) = (f64::from(direction[0]), f64::from(direction[1]));
            let w = c * h;
            let variance = h.dot(&w);
            assert_near(&mean(&part), &(x + w * (f64::from(deviations) / variance.sqrt())), "mean");
            let less = w * w.transpose() * ((f64::from(share) - 1.0) / variance);
            assert_near(&dense(&part), &(c + less), "covariance");
            assert_exact(&part, "narrow");
        }
        // A tag that is known exactly has no parts.
        let mut still = whole.clone();
        still.place(&Agent { mean: Vector4::zeros(), covariance: Matrix4::zeros() });
        let before = dense(&still);
        still.narrow([1.0, 0.0], 1.0, 0.5);
        assert_eq!(dense(&still), before);
    }

    #[test]
    fn a_merged_state_has_the_moments_of_the_mixture() {
        let own = walls_and_images();
        let mut other = walls_and_images();
        let sight = Sight { anchor_m: [-2.0, 5.0], height_m: 0.0, height_std_m: 0.0, lever_arm_m: [0.0; 2] };
        let regression = other.regress(Source::Direct { anchor: 1 }, &sight, None).unwrap();
        other.update([Innovation::hard(regression, 0.4, 0.02)]);
        other.predict(0.5);
        assert!(
            (mean(&own) - mean(&other)).abs().max() > 0.05
                && (dense(&own) - dense(&other)).abs().max() > 0.01
        );
        for share in [0.0_f32, 1e-4, 0.3, 0.5, 1.0] {
            let mut merged = own.clone();
            merged.merge(&other, share);
            let weight = f64::from(share);
            let (x, c) =
                moments(&[(1.0 - weight, mean(&own), dense(&own)), (weight, mean(&other), dense(&other))]);
            assert_near(&mean(&merged), &x, "mean");
            assert_near(&dense(&merged), &c, "covariance");
            assert_exact(&merged, "merge");
        }
    }

    #[test]
    fn a_turn_draws_the_velocity_anew_at_any_time_and_keeps_everything_else() {
        let before = walls_and_images();
        let (speed2, elapsed_s) = (0.9_f32, 0.7_f32);
        let mut turned = before.clone();
        turned.turn(speed2, elapsed_s);
        // v = 0 and independent of everything, then moments of (v s, v) over all times s that are left.
        let mut keep = Dense::identity();
        (keep[(2, 2)], keep[(3, 3)]) = (0.0, 0.0);
        let mut exact = keep * dense(&before) * keep;
        let steps = 10_000;
        for step in 0..steps {
            let left_s = f64::from(elapsed_s) * (f64::from(step) + 0.5) / f64::from(steps);
            for axis in 0..2 {
                let own = [(axis, left_s), (axis + 2, 1.0)];
                for (row, a) in own {
                    for (column, b) in own {
                        exact[(row, column)] += f64::from(speed2) * a * b / f64::from(steps);
                    }
                }
            }
        }
        assert_near(&dense(&turned), &exact, "covariance");
        assert_near(&mean(&turned), &(keep * mean(&before)), "mean");
        assert_exact(&turned, "turn");
    }

    #[test]
    fn following_a_map_changes_what_differs_and_nothing_else() {
        let before = walls_and_images();
        let mut leader = walls_and_images();
        let line = crate::model::surface::Line { centre_m: [1.0, 2.0], normal: [1.0, 0.0] };
        // Slot 0 becomes another wall, slot 2 is gone; slots 1 and 3 are what they were, with other numbers.
        assert!(leader.rebase(
            0,
            Surface::Wall(line),
            Vector2::new(0.3, 0.01),
            &Matrix2::new(0.5, 0.1, 0.0, 0.2)
        ));
        assert!(leader.remove(2));
        leader.narrow([1.0, 0.0], 1.0, 0.5);
        let mut follower = before.clone();
        follower.follow_map(&leader);
        let mut keep = Dense::identity();
        for n in [BEFORE, BEFORE + 1, BEFORE + 4, BEFORE + 5] {
            keep[(n, n)] = 0.0;
        }
        let (mut c, mut x) = (keep * dense(&before) * keep, keep * mean(&before));
        let theirs = dense(&leader);
        let own = theirs.fixed_view::<2, 2>(BEFORE, BEFORE).into_owned();
        c.fixed_view_mut::<2, 2>(BEFORE, BEFORE).copy_from(&own);
        x.fixed_rows_mut::<2>(BEFORE).copy_from(&mean(&leader).fixed_rows::<2>(BEFORE));
        assert_eq!(dense(&follower), c);
        assert_eq!(mean(&follower), x);
        assert_eq!(follower.surfaces, leader.surfaces);
        assert_exact(&follower, "follow");
        // A map that is the same already, and one that is told a surface known exactly.
        let same = follower.clone();
        follower.follow_map(&leader);
        assert_eq!((dense(&follower), mean(&follower)), (dense(&same), mean(&same)));
        assert!(follower.remove(FREE));
        follower.follow_map(&leader);
        assert_exact(&follower, "told");
    }

    /// Least variance of a state given those before it, over its own: above 0 where the covariance is positive definite. States
    /// without variance are left out.
    fn least_pivot(filter: &Filter) -> f64 {
        let mut rest = dense(filter);
        let own = rest.diagonal();
        let mut least = f64::INFINITY;
        for n in (0..SIZE).filter(|n| own[*n] != 0.0) {
            let pivot = rest[(n, n)];
            least = least.min(pivot / own[n]);
            let column = rest.column(n).into_owned();
            rest -= column * column.transpose() / pivot;
        }
        least
    }

    #[test]
    fn ten_thousand_operations_leave_a_covariance() {
        let mut filter = walls_and_images();
        filter.motion.acceleration_density_m2_s3 = 0.1;
        let told = filter.clone();
        let mut seed = 9_u32;
        let mut draw = || {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (seed >> 8) as f32 / 16_777_216.0
        };
        let sights = [[-6.0, 1.0], [8.0, 5.0]].map(|anchor_m| Sight {
            anchor_m,
            height_m: 0.0,
            height_std_m: 0.0,
            lever_arm_m: [0.0; 2],
        });
        let (mut least, mut counts) = (f64::INFINITY, [0; 6]);
        for _ in 0..10_000 {
            let kind = (draw() * 6.0) as usize;
            counts[kind] += 1;
            match kind {
                0 => filter.predict(0.2 * draw()),
                1 => filter.turn(0.5, 0.2 * draw()),
                2 | 3 => {
                    let angle = core::f32::consts::TAU * draw();
                    let direction = [crate::real::cos(angle), crate::real::sin(angle)];
                    if kind == 2 {
                        filter.narrow(direction, 2.0 * draw() - 1.0, 0.5);
                    } else {
                        let mut other = filter.clone();
                        other.narrow(direction, 2.0 * draw() - 1.0, draw());
                        filter.merge(&other, draw());
                    }
                }
                4 => {
                    let slot = (draw() * 4.0) as u8;
                    let anchor = (draw() * 2.0) as usize;
                    let sequence = Sequence::of(slot);
                    let images = [None, Some(&sequence)];
                    let regressions: Vec<Regression> = images
                        .into_iter()
                        .filter_map(|sequence| {
                            filter.regress(Source::Direct { anchor }, &sights[anchor], sequence)
                        })
                        .collect();
                    let innovation_m = 0.1 * (draw() - 0.5);
                    filter.update(
                        regressions
                            .into_iter()
                            .map(|regression| Innovation::hard(regression, innovation_m, 1e-4)),
                    );
                }
                _ => {
                    let slot = [0, 2, 3][(draw() * 3.0) as usize];
                    if draw() < 0.05 {
                        // Somebody else's map has another surface there.
                        filter.remove(slot);
                        filter.follow_map(&told);
                    }
                }
            }
            least = least.min(least_pivot(&filter));
        }
        std::println!(
            "least share of a variance that nothing explains, in 10,000 operations {counts:?}: {least:.1e}"
        );
        assert_exact(&filter, "ten thousand operations");
        assert!(least > 0.0, "{least:e}");
        assert!(mean(&filter).iter().all(|number| number.is_finite()));
    }
}
