//! The state filter: one mean vector, one covariance matrix.
//!
//! State, in this order: the tag (p_x, p_y, v_x, v_y), one range bias per anchor, two numbers per slot of the surfaces
//! ([`super::surface`]). A slot without a surface keeps zeros and is left out of every loop; so are the biases when they are not
//! estimated.
//!
//! Prediction: x <- F x, C <- F C F' + Q ([`super::motion`]), and a random walk of the surfaces.
//!
//! Measurement: z = |d| + b with d = p - m, m the image ([`super::image`]), to first order E m + D_1 (s_1 - E s_1) + D_2 (s_2 -
//! E s_2) with the numbers s of its surfaces; its curvature shifts E m. Linearised over the spread of d (five sigma points):
//! z = mean + h' (x - E x) + residual, where h has the slope g at p, -D'g at each surface, and 1 at b. With w = C h, the update
//! is the soft one along w ([`super::soft_update`]), with S = h' w + residual + measurement variance.

use super::image::Image;
use super::motion::{AGENT, Agent, MotionStep, PX, PY, ProcessNoise, VX, VY};
use super::range::{Regression, SMALLEST_SPREAD_M2, Sight, regress_distance};
use super::real::{Real, exp, larger, smaller, sqrt, square};
use super::soft_update::{Moments, SoftUpdate};
use super::surface::Surface;
use super::{Matrix, Square, product, transposed, zeros};
use cogmint_core::model::image::Sequence;
use cogmint_core::model::motion::Motion;
use cogmint_core::model::source::Source;
use cogmint_core::perceptor::state_filter::{
    ROTATION_LIMIT, ROTATION_WALK_PER_M2, ROUNDING_MARGIN, SURFACE_LIMIT_M2, VELOCITY_LIMIT,
};
use std::fmt;

/// What is known of a range by something else than measurements of it: how probably that is so, by how much longer it is than
/// expected (metres), and its variance (square metres).
#[derive(Clone, Copy, Debug)]
pub struct Reading<T> {
    /// Probability.
    pub probability: T,
    /// Metres.
    pub shift_m: T,
    /// Square metres.
    pub variance_m2: T,
}

/// What the measurements of one feature amount to.
#[derive(Clone, Copy, Debug)]
pub struct Innovation<T> {
    /// The feature and its line.
    pub regression: Regression<T>,
    /// Its innovations.
    pub moments: Moments<T>,
    /// Measurement variance, square metres.
    pub variance_m2: T,
    /// What the last error has in common with it, on top, square metres.
    pub alike_m2: T,
}

/// The filter.
#[derive(Clone, Debug)]
pub struct StateFilter<T> {
    /// Number of anchors.
    pub anchors: usize,
    mean: Vec<T>,
    covariance: Matrix<T>,
    surfaces: Vec<Option<Surface<T>>>,
    estimate_bias: bool,
    bias_limits_m2: Vec<T>,
    motion: Motion,
    reach_m: T,
}

/// The prior of the tag and the biases, in the terms of the configuration.
#[derive(Clone, Copy, Debug)]
pub struct Prior {
    /// Its standard deviation never exceeds this, metres.
    pub reach_m: f32,
    /// Position, metres.
    pub position_m: [f32; 2],
    /// Its standard deviation, metres.
    pub position_std_m: f32,
    /// Standard deviation of the velocity, m/s.
    pub velocity_std_m_s: f32,
    /// Mean of every bias, metres.
    pub bias_mean_m: f32,
    /// Its standard deviation, metres; 0 switches the biases off.
    pub bias_std_m: f32,
}

impl<T: Real> StateFilter<T> {
    /// A filter for `anchors` biases and `slots` surfaces, at its prior.
    pub fn new(anchors: usize, slots: usize, motion: Motion, prior: &Prior) -> Self {
        let size = AGENT + anchors + 2 * slots;
        let mut mean = vec![T::ZERO; size];
        let mut covariance = zeros(size, size);
        for axis in 0..2 {
            mean[axis] = T::of(prior.position_m[axis]);
            covariance[axis][axis] = square(T::of(prior.position_std_m));
            covariance[2 + axis][2 + axis] = square(T::of(prior.velocity_std_m_s));
        }
        for anchor in 0..anchors {
            mean[AGENT + anchor] = T::of(prior.bias_mean_m);
            covariance[AGENT + anchor][AGENT + anchor] = square(T::of(prior.bias_std_m));
        }
        let estimate_bias = prior.bias_std_m > 0.0;
        let bias_limits_m2 = vec![square(T::of(prior.bias_std_m)); anchors];
        Self {
            anchors,
            mean,
            covariance,
            surfaces: vec![None; slots],
            estimate_bias,
            bias_limits_m2,
            motion,
            reach_m: T::of(prior.reach_m),
        }
    }

    /// The prior of one anchor's bias is another.
    pub fn tell_bias(&mut self, anchor: usize, mean_m: f32, std_m: f32) {
        let own = self.bias(anchor);
        self.mean[own] = T::of(mean_m);
        self.bias_limits_m2[anchor] = square(T::of(std_m));
        for other in 0..self.mean.len() {
            self.covariance[own][other] = T::ZERO;
            self.covariance[other][own] = T::ZERO;
        }
        self.covariance[own][own] = self.bias_limits_m2[anchor];
        self.estimate_bias = self.bias_limits_m2.iter().any(|limit| *limit > T::ZERO);
    }

    /// Index of an anchor's bias.
    fn bias(&self, anchor: usize) -> usize {
        AGENT + anchor
    }

    /// Index of a surface's first number; the second follows.
    fn slot(&self, slot: usize) -> usize {
        AGENT + self.anchors + 2 * slot
    }

    fn is_bias(&self, index: usize) -> bool {
        index >= AGENT && index < AGENT + self.anchors
    }

    /// Whether a state is the rotation of a wall.
    fn is_rotation(&self, index: usize) -> bool {
        let first = self.slot(0);
        index >= first
            && (index - first) % 2 == 1
            && matches!(self.surfaces[(index - first) / 2], Some(Surface::Wall(_)))
    }

    /// Whether a state is a number of the heading.
    fn is_heading(&self, index: usize) -> bool {
        let first = self.slot(0);
        index >= first && matches!(self.surfaces[(index - first) / 2], Some(Surface::Heading { .. }))
    }

    /// Whether a state is a number of a slot without a surface.
    fn is_free(&self, index: usize) -> bool {
        let first = self.slot(0);
        index >= first && self.surfaces[(index - first) / 2].is_none()
    }

    /// Indices of all states in use, in order.
    fn active(&self) -> Vec<usize> {
        let mut indices: Vec<usize> = (0..AGENT).collect();
        if self.estimate_bias {
            indices.extend((0..self.anchors).map(|anchor| self.bias(anchor)));
        }
        for slot in 0..self.surfaces.len() {
            if self.surfaces[slot].is_some() {
                indices.push(self.slot(slot));
                indices.push(self.slot(slot) + 1);
            }
        }
        indices
    }

    fn set_symmetric(&mut self, i: usize, j: usize, value: T) {
        self.covariance[i][j] = value;
        self.covariance[j][i] = value;
    }

    /// Position of the tag, metres.
    pub fn position_m(&self) -> [T; 2] {
        [self.mean[PX], self.mean[PY]]
    }

    /// Velocity of the tag, m/s.
    pub fn velocity_m_s(&self) -> [T; 2] {
        [self.mean[VX], self.mean[VY]]
    }

    /// The tag's four states.
    pub fn agent(&self) -> Agent<T> {
        Agent { mean: self.mean[..AGENT].to_vec(), covariance: self.agent_covariance() }
    }

    /// Covariance of the tag's four states.
    pub fn agent_covariance(&self) -> Matrix<T> {
        (0..AGENT).map(|row| self.covariance[row][..AGENT].to_vec()).collect()
    }

    /// Range bias of an anchor, metres.
    pub fn bias_m(&self, anchor: usize) -> T {
        self.mean[self.bias(anchor)]
    }

    /// Its variance, square metres.
    pub fn bias_variance_m2(&self, anchor: usize) -> T {
        self.covariance[self.bias(anchor)][self.bias(anchor)]
    }

    /// Puts the tag somewhere else: it is correlated with nothing then.
    pub fn place(&mut self, agent: &Agent<T>) {
        for i in 0..AGENT {
            self.mean[i] = agent.mean[i];
            self.covariance[i][..AGENT].copy_from_slice(&agent.covariance[i]);
            for j in AGENT..self.mean.len() {
                self.set_symmetric(i, j, T::ZERO);
            }
        }
    }

    /// The surface in a slot, its two numbers and their covariance; none where it is free.
    pub fn surface(&self, slot: usize) -> Option<(Surface<T>, [T; 2], Square<T>)> {
        Some((self.surfaces[slot]?, self.numbers(slot), self.block(slot, slot)))
    }

    /// The first free slot.
    pub fn free_slot(&self) -> Option<usize> {
        self.surfaces.iter().position(Option::is_none)
    }

    /// How many slots are free.
    pub fn free_slots(&self) -> usize {
        self.surfaces.iter().filter(|surface| surface.is_none()).count()
    }

    /// The two numbers of a surface.
    fn numbers(&self, slot: usize) -> [T; 2] {
        [self.mean[self.slot(slot)], self.mean[self.slot(slot) + 1]]
    }

    /// Covariance of the numbers of two surfaces, those of the first in the rows.
    fn block(&self, first: usize, second: usize) -> Square<T> {
        self.corner(self.slot(first), self.slot(second))
    }

    /// The four entries of the covariance from here on.
    fn corner(&self, row: usize, column: usize) -> Square<T> {
        let c = &self.covariance;
        [[c[row][column], c[row][column + 1]], [c[row + 1][column], c[row + 1][column + 1]]]
    }

    /// The image of an anchor in a sequence of surfaces, all of them in use.
    fn image(&self, anchor_m: [T; 2], sequence: &Sequence) -> Image<T> {
        let mut walls = Vec::new();
        for slot in sequence.surfaces() {
            match self.surfaces[slot] {
                Some(Surface::Wall(line)) => walls.push((line, self.numbers(slot))),
                Some(Surface::Private) => return Image::private(self.numbers(slot)),
                Some(Surface::Heading { .. }) => unreachable!("nothing is seen in a heading"),
                None => unreachable!("sources in use are seen in surfaces in use"),
            }
        }
        Image::of(anchor_m, &walls)
    }

    /// Where an image is expected: its curvature shifts the mean, by the covariance of the surfaces' numbers.
    fn expected_m(&self, image: &Image<T>, sequence: &Sequence) -> [T; 2] {
        let slots: Vec<usize> = sequence.surfaces().collect();
        let own: Vec<[T; 2]> = slots.iter().map(|&slot| self.block(slot, slot)[1]).collect();
        let cross = match slots[..] {
            [first, second] => self.block(first, second).map(|row| row[1]),
            _ => [T::ZERO; 2],
        };
        let shift = image.shift_m(&own, cross);
        [image.position_m[0] + shift[0], image.position_m[1] + shift[1]]
    }

    /// D C_ss D' (xx, yx, yy) of an image. Order: the first surface's part, then the sum of the second's and what both have in
    /// common.
    fn spread_m2(&self, image: &Image<T>, sequence: &Sequence) -> [T; 3] {
        let slots: Vec<usize> = sequence.surfaces().collect();
        // D_a C_ab D_b'.
        let part = |a: usize, b: usize| {
            let left = transposed(&image.slopes[a]);
            product(&product(&left, &self.block(slots[a], slots[b])), &image.slopes[b])
        };
        let own = part(0, 0);
        let mut spread = [own[0][0], own[1][0], own[1][1]];
        if slots.len() == 2 {
            let (own, k) = (part(1, 1), part(0, 1));
            spread[0] += own[0][0] + T::of(2.0) * k[0][0];
            spread[1] += own[1][0] + (k[1][0] + k[0][1]);
            spread[2] += own[1][1] + T::of(2.0) * k[1][1];
        }
        spread
    }

    /// Where an image is expected, metres, and the covariance of its position, square metres.
    pub fn placed(&self, anchor_m: [T; 2], sequence: &Sequence) -> ([T; 2], Square<T>) {
        let image = self.image(anchor_m, sequence);
        let [xx, yx, yy] = self.spread_m2(&image, sequence);
        (self.expected_m(&image, sequence), [[xx, yx], [yx, yy]])
    }

    /// Adds a surface that is correlated with nothing; a number is exact where its deviation is 0.
    pub fn insert_independent(&mut self, slot: usize, surface: Surface<T>, numbers: [T; 2], std: [T; 2]) {
        self.fill(slot, surface, numbers);
        let s = self.slot(slot);
        for number in 0..2 {
            self.covariance[s + number][s + number] = square(std[number]);
        }
    }

    /// Adds the heading of the tag's body, of which nothing is known: in the last slot.
    pub fn insert_heading(&mut self, turns_per_s: f32) {
        let last = self.surfaces.len() - 1;
        self.fill(last, Surface::Heading { turns_per_s }, [T::ZERO; 2]);
        let u = self.slot(last);
        for number in u..u + 2 {
            self.covariance[number][number] = T::of(0.5);
        }
    }

    /// C <- C + variance h h', h being `slopes` (by slot) at the numbers that are not exact.
    pub fn correlate(&mut self, variance: T, slopes: impl Fn(usize) -> [T; 2]) {
        let mut h = vec![T::ZERO; self.mean.len()];
        for slot in 0..self.surfaces.len() {
            for number in 0..2 {
                let i = self.slot(slot) + number;
                if self.covariance[i][i] > T::ZERO {
                    h[i] = slopes(slot)[number];
                }
            }
        }
        let first = self.slot(0);
        for i in first..h.len() {
            for j in first..=i {
                // Order: (variance h_i) h_j with i the later state.
                let value = self.covariance[i][j] + variance * h[i] * h[j];
                self.set_symmetric(i, j, value);
            }
        }
    }

    /// Adds a private surface a known relative to the tag's position p: a = E a + G (p - E p) + own error, so
    /// C_a* = G C_p* and C_aa = own + G C_pa.
    pub fn insert_relative(&mut self, slot: usize, position_m: [T; 2], gain: Square<T>, own: Square<T>) {
        self.fill(slot, Surface::Private, position_m);
        let a = self.slot(slot);
        for axis in 0..2 {
            for i in 0..self.mean.len() {
                if i != a && i != a + 1 && !self.is_free(i) {
                    let value = self.carried(gain[axis], i);
                    self.set_symmetric(a + axis, i, value);
                }
            }
        }
        // Symmetric by copy: the lower triangle is what is computed.
        for row in 0..2 {
            for column in 0..=row {
                let value = own[row][column] + self.carried(gain[row], a + column);
                self.set_symmetric(a + row, a + column, value);
            }
        }
    }

    /// Covariance of g' p with state i.
    fn carried(&self, g: [T; 2], i: usize) -> T {
        g[0] * self.covariance[PX][i] + g[1] * self.covariance[PY][i]
    }

    fn fill(&mut self, slot: usize, surface: Surface<T>, numbers: [T; 2]) {
        self.remove(slot);
        self.surfaces[slot] = Some(surface);
        for number in 0..2 {
            let i = self.slot(slot) + number;
            self.mean[i] = numbers[number];
        }
    }

    /// H C H' of a linear form H s, the sum of D_k s_k over its parts (the slot of s_k, D_k). Order: by k, then l.
    pub fn form_covariance(&self, form: &[(usize, Square<T>)]) -> Square<T> {
        let mut sum = [[T::ZERO; 2]; 2];
        for (k, d_k) in form {
            for (l, d_l) in form {
                let c = product(&product(d_k, &self.block(*k, *l)), &transposed(d_l));
                for row in 0..2 {
                    for column in 0..2 {
                        sum[row][column] += c[row][column];
                    }
                }
            }
        }
        sum
    }

    /// The form H s is larger by `gap` than it is, but for an error of `variance` in both numbers: a Kalman update by each.
    pub fn constrain(&mut self, form: &[(usize, Square<T>)], gap: [T; 2], variance: T) {
        self.cover_rounding();
        let prior = self.mean.clone();
        for number in 0..2 {
            let h: Vec<_> = form.iter().map(|(slot, d)| (self.slot(*slot), d[number])).collect();
            let mut w = vec![T::ZERO; self.mean.len()];
            for i in self.active() {
                for &(s, [h1, h2]) in &h {
                    w[i] += h1 * self.covariance[s][i] + h2 * self.covariance[s + 1][i];
                }
            }
            let mut explained = T::ZERO;
            let mut innovation = gap[number];
            for &(s, [h1, h2]) in &h {
                explained += h1 * w[s] + h2 * w[s + 1];
                // The first number's update has moved the second.
                innovation -= h1 * (self.mean[s] - prior[s]) + h2 * (self.mean[s + 1] - prior[s + 1]);
            }
            let explained = larger(explained, T::ZERO);
            let moments = Moments { weight: T::ONE, first_m: innovation, second_m2: square(innovation) };
            self.step(&w, &SoftUpdate::new(&moments, explained + variance, explained));
        }
    }

    /// Other numbers for a surface: `numbers` now, `slopes` S over the old ones. C_s* <- S C_s*, C_ss <- S C_ss S'.
    pub fn rebase(&mut self, slot: usize, surface: Surface<T>, numbers: [T; 2], slopes: &Square<T>) {
        self.surfaces[slot] = Some(surface);
        let s = self.slot(slot);
        let own = product(&product(slopes, &self.block(slot, slot)), &transposed(slopes));
        for i in 0..self.mean.len() {
            if i != s && i != s + 1 && !self.is_free(i) {
                let old = [self.covariance[s][i], self.covariance[s + 1][i]];
                for number in 0..2 {
                    let value = slopes[number][0] * old[0] + slopes[number][1] * old[1];
                    self.set_symmetric(s + number, i, value);
                }
            }
        }
        for row in 0..2 {
            self.mean[s + row] = numbers[row];
            // Symmetric by copy of the lower triangle.
            for column in 0..=row {
                self.set_symmetric(s + row, s + column, own[row][column]);
            }
        }
    }

    /// Moves a surface to another slot, in place of what was there.
    pub fn relocate(&mut self, from: usize, to: usize) {
        if from == to {
            return;
        }
        self.remove(to);
        self.surfaces.swap(from, to);
        for number in 0..2 {
            let (a, b) = (self.slot(from) + number, self.slot(to) + number);
            self.mean.swap(a, b);
            self.covariance.swap(a, b);
            for row in &mut self.covariance {
                row.swap(a, b);
            }
        }
    }

    /// Takes a surface out: its mean and all its covariances become zero.
    pub fn remove(&mut self, slot: usize) {
        self.surfaces[slot] = None;
        for a in [self.slot(slot), self.slot(slot) + 1] {
            self.mean[a] = T::ZERO;
            for i in 0..self.mean.len() {
                self.set_symmetric(a, i, T::ZERO);
            }
        }
    }

    /// Moves the state a step of `dt` seconds ahead.
    pub fn predict(&mut self, dt: T) {
        let step = MotionStep::new(&self.motion, dt);
        let agent = step.predicted(&self.agent());
        let walk = square(T::of(self.motion.virtual_anchor_walk_m_sqrt_s)) * dt;
        for i in self.active() {
            if i < AGENT {
                self.mean[i] = agent.mean[i];
                self.covariance[i][..AGENT].copy_from_slice(&agent.covariance[i]);
                continue;
            }
            // C_x* <- F C_x*.
            for (p, v) in [(PX, VX), (PY, VY)] {
                let moved = self.covariance[p][i] + step.drift_s * self.covariance[v][i];
                let slowed = self.covariance[v][i] * step.decay;
                self.set_symmetric(p, i, moved);
                self.set_symmetric(v, i, slowed);
            }
            if self.is_heading(i) {
                continue;
            }
            // A number without variance is known exactly and does not walk.
            if !self.is_bias(i) && self.covariance[i][i] > T::ZERO {
                let share = if self.is_rotation(i) { T::of(ROTATION_WALK_PER_M2) } else { T::ONE };
                self.covariance[i][i] += walk * share;
            }
        }
        if let Some(Some(Surface::Heading { turns_per_s })) = self.surfaces.last() {
            self.turn_body(T::of(*turns_per_s) * dt);
        }
        self.limit();
    }

    /// The heading fades towards any: its numbers u to exp(-turns) u, and to the variance of a unit vector.
    fn turn_body(&mut self, turns: T) {
        let kept = exp(-turns);
        let size = self.mean.len();
        let mut factor = vec![T::ONE; size];
        for i in size - 2..size {
            self.mean[i] *= kept;
            factor[i] = kept;
        }
        for i in 0..size {
            for j in 0..size {
                self.covariance[i][j] *= factor[i] * factor[j];
            }
        }
        for i in size - 2..size {
            self.covariance[i][i] += T::of(0.5) * (T::ONE - square(kept));
        }
    }

    /// The velocity was drawn anew with this variance per axis, at any time in the last `dt` seconds.
    pub fn turn(&mut self, velocity_m2_s2: T, dt: T) {
        for v in [VX, VY] {
            self.mean[v] = T::ZERO;
            for i in 0..self.mean.len() {
                self.set_symmetric(v, i, T::ZERO);
            }
        }
        let mut covariance = self.agent_covariance();
        ProcessNoise::of_turn(velocity_m2_s2, dt).add_to(&mut covariance);
        for i in 0..AGENT {
            self.covariance[i][..AGENT].copy_from_slice(&covariance[i]);
        }
    }

    /// Moved by so many deviations along a direction of the position, with a `share` of the variance there left.
    pub fn narrow(&mut self, direction: [T; 2], deviations: T, share: T) {
        let [ex, ey] = direction;
        let along = |i: usize| ex * self.covariance[PX][i] + ey * self.covariance[PY][i];
        let w: Vec<T> = (0..self.mean.len()).map(along).collect();
        let variance = ex * w[PX] + ey * w[PY];
        if variance <= T::ZERO {
            return;
        }
        let mean = deviations / sqrt(variance);
        self.step(&w, &SoftUpdate { mean, covariance: (share - T::ONE) / variance });
    }

    /// One Gaussian of the mean and covariance of a mixture: of this one and another, whose weight is `share`.
    pub fn merge(&mut self, other: &Self, share: T) {
        let apart: Vec<T> = (0..self.mean.len()).map(|i| other.mean[i] - self.mean[i]).collect();
        let rest = T::ONE - share;
        for i in 0..self.mean.len() {
            for j in 0..self.mean.len() {
                self.covariance[i][j] = rest * self.covariance[i][j] + share * other.covariance[i][j];
            }
        }
        self.step(&apart, &SoftUpdate { mean: share, covariance: share * rest });
    }

    /// Has the surfaces of another state: those that are new or other as independent of everything.
    pub fn follow_map(&mut self, other: &Self) {
        for slot in 0..self.surfaces.len() {
            if self.surfaces[slot] == other.surfaces[slot] {
                continue;
            }
            self.remove(slot);
            if let Some((surface, numbers, own)) = other.surface(slot) {
                self.fill(slot, surface, numbers);
                for row in 0..2 {
                    for column in 0..=row {
                        self.set_symmetric(self.slot(slot) + row, self.slot(slot) + column, own[row][column]);
                    }
                }
            }
        }
    }

    /// C <- D C D, D diagonal, so that no variance exceeds its limit. Order: the factors of row and column first.
    fn limit(&mut self) {
        let size = self.mean.len();
        let mut factor = vec![T::ONE; size];
        let mut exceeded = false;
        for i in self.active() {
            let limit = if i == PX || i == PY {
                square(self.reach_m)
            } else if i < AGENT {
                T::of(VELOCITY_LIMIT)
            } else if self.is_bias(i) {
                self.bias_limits_m2[i - AGENT]
            } else if self.is_rotation(i) {
                T::of(ROTATION_LIMIT)
            } else {
                T::of(SURFACE_LIMIT_M2)
            };
            if self.covariance[i][i] > limit {
                factor[i] = sqrt(limit / self.covariance[i][i]);
                exceeded = true;
            }
        }
        if exceeded {
            for i in 0..size {
                for j in 0..size {
                    self.covariance[i][j] *= factor[i] * factor[j];
                }
            }
        }
    }

    /// The line of a range to `source` around the present state; `sequence` is what reflects the path, if anything does.
    pub fn regress(&self, source: Source, sight: &Sight<T>, sequence: Option<&Sequence>) -> Regression<T> {
        let num = T::of;
        let c = &self.covariance;
        let b = self.bias(source.anchor());
        // Of d = p - m: C_pp - C_pm - C_mp + C_mm, and C_pb - C_mb.
        let mut spread = self.corner(PX, PX);
        let mut bias_cross = [c[PX][b], c[PY][b]];
        let mut position_m = sight.anchor_m;
        let mut slopes = Vec::new();
        if let Some(sequence) = sequence {
            let image = self.image(sight.anchor_m, sequence);
            position_m = self.expected_m(&image, sequence);
            // Order: what tag and surfaces have in common, surface by surface, then what the surfaces have.
            for (slot, d) in sequence.surfaces().zip(&image.slopes) {
                let s = self.slot(slot);
                let k = product(&self.corner(PX, s), d);
                spread[0][0] -= num(2.0) * k[0][0];
                spread[1][0] -= k[1][0] + k[0][1];
                spread[1][1] -= num(2.0) * k[1][1];
                for axis in 0..2 {
                    bias_cross[axis] -= d[0][axis] * c[s][b] + d[1][axis] * c[s + 1][b];
                }
                slopes.push((slot, *d));
            }
            let [xx, yx, yy] = self.spread_m2(&image, sequence);
            spread[0][0] += xx;
            spread[1][0] += yx;
            spread[1][1] += yy;
        }
        let mut distance = [self.mean[PX] - position_m[0], self.mean[PY] - position_m[1]];
        let [ahead, left] = sight.lever_arm_m;
        let last = self.surfaces.len().wrapping_sub(1);
        let has_arm = (ahead != T::ZERO || left != T::ZERO)
            && matches!(self.surfaces.last(), Some(Some(Surface::Heading { .. })));
        if has_arm {
            // The antenna is at p + A u.
            let u = self.slot(last);
            let a = [[ahead, -left], [left, ahead]];
            let own = product(&product(&a, &self.block(last, last)), &transposed(&a));
            let k = product(&self.corner(PX, u), &transposed(&a));
            for row in 0..2 {
                distance[row] += a[row][0] * self.mean[u] + a[row][1] * self.mean[u + 1];
                bias_cross[row] += a[row][0] * c[u][b] + a[row][1] * c[u + 1][b];
            }
            spread[0][0] += num(2.0) * k[0][0] + own[0][0];
            spread[1][0] += (k[1][0] + k[0][1]) + own[1][0];
            spread[1][1] += num(2.0) * k[1][1] + own[1][1];
            for (slot, d) in &slopes {
                let k = product(&product(&a, &self.block(last, *slot)), d);
                spread[0][0] -= num(2.0) * k[0][0];
                spread[1][0] -= k[1][0] + k[0][1];
                spread[1][1] -= num(2.0) * k[1][1];
            }
        }
        let line = regress_distance(distance, [spread[0][0], spread[1][0], spread[1][1]], sight.height_m);
        let [gx, gy] = line.slope;
        let mut explained_m2 = line.explained;
        if self.estimate_bias {
            let cross = gx * bias_cross[0] + gy * bias_cross[1];
            explained_m2 = larger(explained_m2 + num(2.0) * cross + c[b][b], num(SMALLEST_SPREAD_M2));
        }
        let mut surfaces = [None; 3];
        for (place, (slot, d)) in surfaces.iter_mut().zip(slopes) {
            *place = Some((slot, d.map(|[dx, dy]| -(gx * dx + gy * dy))));
        }
        if has_arm {
            surfaces[2] = Some((last, [gx * ahead + gy * left, gy * ahead - gx * left]));
        }
        Regression {
            source,
            range_m: line.mean + self.mean[b],
            slope: line.slope,
            surfaces,
            residual_m2: line.residual,
            explained_m2,
        }
    }

    /// Applies the innovations of a cycle in the order given. All lines were taken at the state as it is now.
    pub fn update(&mut self, innovations: &[Innovation<T>]) {
        self.update_and_read(innovations, &[], |(), _, _| None);
    }

    /// The same, and then what else says where a range is: `read` with the range and its variance as they are by then.
    pub fn update_and_read<S: Copy>(
        &mut self,
        innovations: &[Innovation<T>],
        asked: &[(Regression<T>, S)],
        mut read: impl FnMut(S, T, T) -> Option<Reading<T>>,
    ) {
        if innovations.is_empty() && asked.is_empty() {
            return;
        }
        self.cover_rounding();
        let prior = self.mean.clone();
        for innovation in innovations {
            self.apply(innovation, &prior);
        }
        for (regression, of) in asked {
            let (w, explained, moved) = self.along(regression, &prior);
            let variance = explained + regression.residual_m2;
            if let Some(Reading { probability, shift_m, variance_m2 }) =
                read(*of, regression.range_m + moved, variance)
            {
                // A mixture: with this probability N(shift, V) in place of N(0, S).
                let inverse = T::ONE / variance;
                let shift = shift_m * inverse;
                let within = probability * ((variance_m2 * inverse - T::ONE) * inverse);
                let between = probability * (T::ONE - probability) * (shift * shift);
                let covariance = smaller(within + between, inverse);
                self.step(&w, &SoftUpdate { mean: probability * shift, covariance });
            }
        }
    }

    /// C h, h' C h, and by how much the range has changed since the line was taken at the prior.
    fn along(&self, regression: &Regression<T>, prior: &[T]) -> (Vec<T>, T, T) {
        let mut w = vec![T::ZERO; self.mean.len()];
        for i in self.active() {
            w[i] = self.covariance_with(regression, i);
        }
        let explained = larger(self.form(regression, &w), T::ZERO);
        let moved: Vec<T> = (0..w.len()).map(|i| self.mean[i] - prior[i]).collect();
        let moved = self.form(regression, &moved);
        (w, explained, moved)
    }

    /// Every variance grows by what rounding may take.
    fn cover_rounding(&mut self) {
        for i in self.active() {
            self.covariance[i][i] *= T::ONE + T::of(ROUNDING_MARGIN);
        }
    }

    fn apply(&mut self, innovation: &Innovation<T>, prior: &[T]) {
        let Innovation { regression, moments, variance_m2, alike_m2 } = innovation;
        let (w, explained, moved) = self.along(regression, prior);
        let moments = moments.shifted(moved);
        // Order: what the state does not explain first.
        let variance = explained + (*variance_m2 + regression.residual_m2 + *alike_m2);
        self.step(&w, &SoftUpdate::new(&moments, variance, explained));
    }

    /// x <- x + w mean, C <- C + covariance w w'.
    fn step(&mut self, w: &[T], change: &SoftUpdate<T>) {
        let active = self.active();
        for &i in &active {
            self.mean[i] += w[i] * change.mean;
        }
        for &i in &active {
            for &j in active.iter().filter(|&&j| j <= i) {
                // Order: (factor w_i) w_j with i the later state; between biases factor (w_i w_j).
                let added = if self.is_bias(i) && self.is_bias(j) {
                    change.covariance * (w[i] * w[j])
                } else {
                    change.covariance * w[i] * w[j]
                };
                let value = self.covariance[i][j] + added;
                self.set_symmetric(i, j, value);
            }
        }
    }

    /// The entries of h at the surfaces: by the index of the surface's first number.
    fn surface_slopes(&self, regression: &Regression<T>) -> Vec<(usize, [T; 2])> {
        regression.surfaces.iter().flatten().map(|&(slot, h)| (self.slot(slot), h)).collect()
    }

    /// (C h)_i: covariance of the range with state i.
    ///
    /// Order: tag, surfaces, bias; in the rows of the biases tag, bias, surfaces.
    fn covariance_with(&self, regression: &Regression<T>, i: usize) -> T {
        let c = &self.covariance;
        let [gx, gy] = regression.slope;
        let bias = c[self.bias(regression.source.anchor())][i];
        let mut sum = gx * c[PX][i] + gy * c[PY][i];
        if self.is_bias(i) {
            sum += bias;
        }
        for (s, [h1, h2]) in self.surface_slopes(regression) {
            sum += h1 * c[s][i] + h2 * c[s + 1][i];
        }
        if self.estimate_bias && !self.is_bias(i) {
            sum += bias;
        }
        sum
    }

    /// h' x. Order: tag, surfaces, bias.
    fn form(&self, regression: &Regression<T>, x: &[T]) -> T {
        let [gx, gy] = regression.slope;
        let mut sum = gx * x[PX] + gy * x[PY];
        for (s, [h1, h2]) in self.surface_slopes(regression) {
            sum += h1 * x[s] + h2 * x[s + 1];
        }
        if self.estimate_bias {
            sum += x[self.bias(regression.source.anchor())];
        }
        sum
    }

    /// Every number of the state with its name, in the order of the core's `visit`.
    pub fn visit(&self, f: &mut dyn FnMut(fmt::Arguments<'_>, T)) {
        const NAMES: [&str; AGENT] = ["px", "py", "vx", "vy"];
        const NUMBERS: [&str; 2] = ["first", "second"];
        let slots = self.surfaces.len();
        for i in 0..AGENT {
            f(format_args!("mean of agent {}", NAMES[i]), self.mean[i]);
        }
        for j in 0..self.anchors {
            f(format_args!("mean of bias {j}"), self.mean[self.bias(j)]);
        }
        for k in 0..slots {
            for axis in 0..2 {
                let value = self.mean[self.slot(k) + axis];
                f(format_args!("mean of surface {k}, {} number", NUMBERS[axis]), value);
            }
        }
        for (k, surface) in self.surfaces.iter().enumerate() {
            if let Some(Surface::Wall(line)) = surface {
                for axis in 0..2 {
                    f(format_args!("centre of surface {k} {}", ["x", "y"][axis]), line.centre_m[axis]);
                }
                for axis in 0..2 {
                    f(format_args!("normal of surface {k} {}", ["x", "y"][axis]), line.normal[axis]);
                }
            }
            let kind = match surface {
                None => 0.0,
                Some(Surface::Private) => 1.0,
                Some(Surface::Wall(_)) => 2.0,
                Some(Surface::Heading { .. }) => 3.0,
            };
            f(format_args!("kind of surface {k}"), T::of(kind));
        }
        let c = &self.covariance;
        for column in 0..AGENT {
            for row in 0..AGENT {
                let (a, b) = (NAMES[row], NAMES[column]);
                f(format_args!("covariance of agent {a} with agent {b}"), c[row][column]);
            }
        }
        for j in 0..self.anchors {
            for i in 0..AGENT {
                let name = NAMES[i];
                f(format_args!("covariance of bias {j} with agent {name}"), c[i][self.bias(j)]);
            }
        }
        for j in 0..self.anchors {
            for i in 0..self.anchors {
                let value = c[self.bias(j)][self.bias(i)];
                f(format_args!("covariance of bias {j} with bias {i}"), value);
            }
        }
        for k in 0..slots {
            let a = self.slot(k);
            for axis in 0..2 {
                let name = NUMBERS[axis];
                for i in 0..AGENT {
                    let agent = NAMES[i];
                    f(format_args!("covariance of surface {k} {name} with agent {agent}"), c[i][a + axis]);
                }
            }
            for j in 0..self.anchors {
                for axis in 0..2 {
                    let name = NUMBERS[axis];
                    let value = c[a + axis][self.bias(j)];
                    f(format_args!("covariance of surface {k} {name} with bias {j}"), value);
                }
            }
            for l in 0..=k {
                for column in 0..2 {
                    for row in 0..2 {
                        let (own, other) = (NUMBERS[row], NUMBERS[column]);
                        f(
                            format_args!("covariance of surface {k} {own} with surface {l} {other}"),
                            c[a + row][self.slot(l) + column],
                        );
                    }
                }
            }
        }
    }
}
