//! The state filter: one mean vector, one covariance matrix.
//!
//! State, in this order: the tag (p_x, p_y, v_x, v_y), one range bias per anchor, two coordinates per slot of the map.
//! A slot without a virtual anchor keeps zeros and is left out of every loop; so are the biases when they are not
//! estimated.
//!
//! Prediction: x <- F x, C <- F C F' + Q.
//!
//! Measurement: z = |d| + b with d = p - a, linearised over the spread of d (five sigma points) to z = mean + h' (x -
//! E x) + residual, where h has the slope g at p, -g at a, and 1 at b. With w = C h:
//!
//! x <- x + w nu / S, C <- C + (spread / S^2 - beta / S) w w', S = h' w + noise,
//!
//! where beta is the probability that the feature was seen at all, nu the mean innovation and spread the variance of
//! the candidates around it (a hard association has beta = 1 and no spread: the Kalman filter).

use super::Matrix;
use super::real::{Real, larger, smaller, sqrt, square};
use super::zeros;
use cogmint_core::model::motion::Motion;
use cogmint_core::model::source::Source;
use std::fmt;

/// Indices of the tag's states.
pub const PX: usize = 0;
/// See [`PX`].
pub const PY: usize = 1;
/// See [`PX`].
pub const VX: usize = 2;
/// See [`PX`].
pub const VY: usize = 3;
/// Number of the tag's states.
pub const AGENT: usize = 4;

/// Most that one update may shrink a variance.
const LARGEST_SHRINK: f32 = 1.0 / 1024.0;
/// Growth of every variance per prediction, to cover rounding.
const ROUNDING_MARGIN: f32 = 1.0 / 524_288.0;
/// Largest variance of a velocity and of a virtual anchor's coordinate.
const VELOCITY_LIMIT: f32 = 1e6;
const VIRTUAL_ANCHOR_LIMIT_M2: f32 = 1e6;
/// Least variance that sigma points are spread by, square metres.
const SMALLEST_SPREAD_M2: f32 = 1e-12;
/// Spread of the sigma points, standard deviations: the square root of 3.
pub(super) const ROOT_3: f32 = 1.732_050_8;

/// Where an anchor is seen from.
#[derive(Clone, Copy, Debug)]
pub struct Sight<T> {
    /// Position of the anchor, metres.
    pub anchor_m: [T; 2],
    /// Its height above the tag, metres.
    pub height_m: T,
    /// Standard deviation of that height, metres.
    pub height_std_m: T,
}

/// The line that a range follows around the predicted state.
#[derive(Clone, Copy, Debug)]
pub struct Regression<T> {
    /// The feature.
    pub source: Source,
    /// Expected range, metres.
    pub range_m: T,
    /// Slope g over d = p - a.
    pub slope: [T; 2],
    /// Variance around the line, square metres.
    pub residual_m2: T,
    /// Variance along it, square metres.
    pub explained_m2: T,
}

impl<T: Real> Regression<T> {
    /// Variance of the expected range.
    pub fn variance_m2(&self) -> T {
        self.explained_m2 + self.residual_m2
    }
}

/// What the measurements of one feature amount to.
#[derive(Clone, Copy, Debug)]
pub struct Innovation<T> {
    /// The feature and its line.
    pub regression: Regression<T>,
    /// Sum of the association probabilities.
    pub weight: T,
    /// Their sum times the innovations, metres.
    pub first_m: T,
    /// Their sum times the squared innovations, square metres.
    pub second_m2: T,
    /// Measurement variance, square metres.
    pub variance_m2: T,
}

/// The filter.
#[derive(Clone, Debug)]
pub struct StateFilter<T> {
    anchors: usize,
    mean: Vec<T>,
    covariance: Matrix<T>,
    occupied: Vec<bool>,
    estimate_bias: bool,
    bias_limit_m2: T,
    motion: Motion,
}

/// The tag alone: its four states and their covariance.
#[derive(Clone, Debug)]
pub struct Agent<T> {
    /// Means.
    pub mean: Vec<T>,
    /// Covariance.
    pub covariance: Matrix<T>,
}

/// The prior of the tag and the biases, in the terms of the configuration.
#[derive(Clone, Copy, Debug)]
pub struct Prior {
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

/// F C F' + Q of the tag for a near-constant velocity over `dt`; `growth` multiplies the variances before Q is added.
///
/// With p, v the blocks: C_pp + dt (C_pv + C_vp) + dt^2 C_vv, C_vp + dt C_vv, C_vv; Q from a white acceleration.
pub fn predict_agent<T: Real>(c: &Matrix<T>, dt: T, acceleration_std_m_s2: T, growth: T) -> Matrix<T> {
    let num = T::of;
    // Order: each is formed from the one before.
    let velocity_noise = square(acceleration_std_m_s2) * square(dt);
    let both_noise = velocity_noise * (num(0.5) * dt);
    let position_noise = both_noise * (num(0.5) * dt);
    let mut next = c.clone();
    for a in 0..2 {
        for b in 0..2 {
            let (va, vb) = (a + 2, b + 2);
            next[a][b] = c[a][b] + dt * (c[a][vb] + c[va][b]) + dt * dt * c[va][vb];
            next[va][b] = c[va][b] + dt * c[va][vb];
        }
    }
    for a in 0..2 {
        let va = a + 2;
        next[a][a] = next[a][a] * growth + position_noise;
        next[va][a] += both_noise;
        next[va][va] = next[va][va] * growth + velocity_noise;
    }
    // Symmetric by copy: the lower triangle is what was computed.
    for row in 0..AGENT {
        for column in row + 1..AGENT {
            next[row][column] = next[column][row];
        }
    }
    next
}

impl<T: Real> StateFilter<T> {
    /// A filter for `anchors` biases and `slots` virtual anchors, at its prior.
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
        let bias_limit_m2 = square(T::of(prior.bias_std_m));
        Self { anchors, mean, covariance, occupied: vec![false; slots], estimate_bias, bias_limit_m2, motion }
    }

    /// Index of an anchor's bias.
    fn bias(&self, anchor: usize) -> usize {
        AGENT + anchor
    }

    /// Index of a virtual anchor's x; y follows.
    fn slot(&self, slot: usize) -> usize {
        AGENT + self.anchors + 2 * slot
    }

    fn is_bias(&self, index: usize) -> bool {
        index >= AGENT && index < AGENT + self.anchors
    }

    /// Indices of all states in use, in order.
    fn active(&self) -> Vec<usize> {
        let mut indices: Vec<usize> = (0..AGENT).collect();
        if self.estimate_bias {
            indices.extend((0..self.anchors).map(|anchor| self.bias(anchor)));
        }
        for slot in 0..self.occupied.len() {
            if self.occupied[slot] {
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

    /// Position of a virtual anchor, metres.
    pub fn virtual_anchor_m(&self, slot: usize) -> [T; 2] {
        [self.mean[self.slot(slot)], self.mean[self.slot(slot) + 1]]
    }

    /// Covariance of a virtual anchor's position, square metres.
    pub fn virtual_anchor_covariance_m2(&self, slot: usize) -> [[T; 2]; 2] {
        let a = self.slot(slot);
        let c = &self.covariance;
        [[c[a][a], c[a][a + 1]], [c[a + 1][a], c[a + 1][a + 1]]]
    }

    /// Adds a virtual anchor that is correlated with nothing; exact where `std_m` is 0.
    pub fn insert_independent(&mut self, slot: usize, position_m: [T; 2], std_m: T) {
        let variance = square(std_m);
        self.fill(slot, position_m);
        let a = self.slot(slot);
        self.covariance[a][a] = variance;
        self.covariance[a + 1][a + 1] = variance;
    }

    /// Adds a virtual anchor a known relative to the tag's position p: a = E a + G (p - E p) + own error, so
    /// C_a* = G C_p* and C_aa = own + G C_pa.
    pub fn insert_relative(&mut self, slot: usize, position_m: [T; 2], gain: [[T; 2]; 2], own: [[T; 2]; 2]) {
        self.fill(slot, position_m);
        let a = self.slot(slot);
        for axis in 0..2 {
            for i in 0..self.mean.len() {
                if i != a && i != a + 1 {
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

    fn fill(&mut self, slot: usize, position_m: [T; 2]) {
        self.remove(slot);
        self.occupied[slot] = true;
        let a = self.slot(slot);
        self.mean[a] = position_m[0];
        self.mean[a + 1] = position_m[1];
    }

    /// Takes a virtual anchor out: its mean and all its covariances become zero.
    pub fn remove(&mut self, slot: usize) {
        self.occupied[slot] = false;
        for a in [self.slot(slot), self.slot(slot) + 1] {
            self.mean[a] = T::ZERO;
            for i in 0..self.mean.len() {
                self.set_symmetric(a, i, T::ZERO);
            }
        }
    }

    /// Moves the state `dt` seconds ahead.
    pub fn predict(&mut self, dt: T) {
        let growth = T::ONE + T::of(ROUNDING_MARGIN);
        for axis in 0..2 {
            self.mean[axis] = self.mean[axis] + dt * self.mean[2 + axis];
        }
        let acceleration = T::of(self.motion.acceleration_density_m2_s3);
        let agent = predict_agent(&self.agent_covariance(), dt, acceleration, growth);
        let walk = square(T::of(self.motion.virtual_anchor_walk_m_sqrt_s));
        for i in self.active() {
            if i < AGENT {
                self.covariance[i][..AGENT].copy_from_slice(&agent[i]);
                continue;
            }
            // C_p* <- C_p* + dt C_v*.
            for axis in 0..2 {
                let moved = self.covariance[axis][i] + dt * self.covariance[2 + axis][i];
                self.set_symmetric(axis, i, moved);
            }
            // A virtual anchor without variance is known exactly and does not walk.
            let exact = self.covariance[i][i] == T::ZERO;
            self.covariance[i][i] *= growth;
            if !self.is_bias(i) && !exact {
                self.covariance[i][i] += walk;
            }
        }
        self.limit();
    }

    /// After a prediction over `dt`: a further random acceleration over the same time.
    pub fn disturb(&mut self, acceleration_std_m_s2: T, dt: T) {
        // Order: each is formed from the one before.
        let velocity_noise = square(acceleration_std_m_s2) * square(dt);
        let both_noise = velocity_noise * (T::of(0.5) * dt);
        let position_noise = both_noise * (T::of(0.5) * dt);
        for axis in 0..2 {
            self.covariance[axis][axis] += position_noise;
            let both = self.covariance[2 + axis][axis] + both_noise;
            self.set_symmetric(2 + axis, axis, both);
            self.covariance[2 + axis][2 + axis] += velocity_noise;
        }
    }

    /// Puts the covariance of position and velocity back to `predicted`.
    pub fn undisturb(&mut self, predicted: &Matrix<T>) {
        for i in 0..AGENT {
            self.covariance[i][..AGENT].copy_from_slice(&predicted[i]);
        }
    }

    /// C <- D C D, D diagonal, so that no variance exceeds its limit. Order: the factors of row and column first.
    fn limit(&mut self) {
        let size = self.mean.len();
        let mut factor = vec![T::ONE; size];
        let mut exceeded = false;
        for i in self.active() {
            let limit = if i == PX || i == PY {
                square(T::of(self.motion.position_std_limit_m))
            } else if i < AGENT {
                T::of(VELOCITY_LIMIT)
            } else if self.is_bias(i) {
                self.bias_limit_m2
            } else {
                T::of(VIRTUAL_ANCHOR_LIMIT_M2)
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

    /// The line of a range to `source` around the present state.
    pub fn regress(&self, source: Source, sight: &Sight<T>) -> Regression<T> {
        let num = T::of;
        let c = &self.covariance;
        let b = self.bias(source.anchor());
        let distance;
        let spread;
        let mut bias_cross = [c[PX][b], c[PY][b]];
        match source {
            Source::Direct { .. } => {
                distance = [self.mean[PX] - sight.anchor_m[0], self.mean[PY] - sight.anchor_m[1]];
                spread = [c[PX][PX], c[PY][PX], c[PY][PY]];
            }
            Source::Virtual { slot, .. } => {
                // Covariance of p - a: C_pp - C_pa - C_ap + C_aa.
                let (ax, ay) = (self.slot(slot), self.slot(slot) + 1);
                distance = [self.mean[PX] - self.mean[ax], self.mean[PY] - self.mean[ay]];
                spread = [
                    c[PX][PX] - num(2.0) * c[PX][ax] + c[ax][ax],
                    c[PY][PX] - (c[PY][ax] + c[PX][ay]) + c[ay][ax],
                    c[PY][PY] - num(2.0) * c[PY][ay] + c[ay][ay],
                ];
                bias_cross = [bias_cross[0] - c[ax][b], bias_cross[1] - c[ay][b]];
            }
        }
        let (range_m, slope, residual_m2, mut explained_m2) =
            regress_distance(distance, spread, [sight.height_m, sight.height_std_m]);
        if self.estimate_bias {
            let cross = slope[0] * bias_cross[0] + slope[1] * bias_cross[1];
            explained_m2 = larger(explained_m2 + num(2.0) * cross + c[b][b], num(SMALLEST_SPREAD_M2));
        }
        Regression { source, range_m: range_m + self.mean[b], slope, residual_m2, explained_m2 }
    }

    /// Applies the innovations of a cycle in the order given. All lines were taken at the state as it is now.
    pub fn update(&mut self, innovations: &[Innovation<T>]) {
        let prior = self.mean.clone();
        for innovation in innovations {
            self.apply(innovation, &prior);
        }
    }

    fn apply(&mut self, innovation: &Innovation<T>, prior: &[T]) {
        let num = T::of;
        let Innovation { regression, weight, first_m, second_m2, variance_m2 } = innovation;
        let active = self.active();
        let mut w = vec![T::ZERO; self.mean.len()];
        for &i in &active {
            w[i] = self.covariance_with(regression, i);
        }
        let explained = larger(self.form(regression, &w), T::ZERO);
        // The line was taken at the prior; since then the state has moved by `shift` along it.
        let moved: Vec<T> = (0..w.len()).map(|i| self.mean[i] - prior[i]).collect();
        let shift = self.shift(regression, &moved);

        let noise = larger(*variance_m2 + regression.residual_m2, explained * num(LARGEST_SHRINK));
        let inverse = T::ONE / (explained + noise);
        let first = *first_m - *weight * shift;
        let second = *second_m2 - num(2.0) * (shift * *first_m) + *weight * square(shift);
        let spread = larger(second - square(first), T::ZERO);
        let scale = smaller((spread * inverse - *weight) * inverse, inverse);
        let gain = first * inverse;

        for &i in &active {
            self.mean[i] += w[i] * gain;
        }
        for &i in &active {
            for &j in active.iter().filter(|&&j| j <= i) {
                // Order: (scale w_i) w_j with i the later state; between biases scale (w_i w_j).
                let change = if self.is_bias(i) && self.is_bias(j) {
                    scale * (w[i] * w[j])
                } else {
                    scale * w[i] * w[j]
                };
                let value = self.covariance[i][j] + change;
                self.set_symmetric(i, j, value);
            }
        }
    }

    /// (C h)_i: covariance of the range with state i.
    ///
    /// Order: (tag - virtual anchor) + bias; in the rows of the biases (tag + bias) - virtual anchor.
    fn covariance_with(&self, regression: &Regression<T>, i: usize) -> T {
        let c = &self.covariance;
        let [gx, gy] = regression.slope;
        let bias = c[self.bias(regression.source.anchor())][i];
        let mut sum = gx * c[PX][i] + gy * c[PY][i];
        if self.is_bias(i) {
            sum += bias;
        }
        if let Source::Virtual { slot, .. } = regression.source {
            let a = self.slot(slot);
            sum -= gx * c[a][i] + gy * c[a + 1][i];
        }
        if self.estimate_bias && !self.is_bias(i) {
            sum += bias;
        }
        sum
    }

    /// h' w. Order: tag, virtual anchor, bias.
    fn form(&self, regression: &Regression<T>, w: &[T]) -> T {
        let [gx, gy] = regression.slope;
        let mut sum = gx * w[PX] + gy * w[PY];
        if let Source::Virtual { slot, .. } = regression.source {
            let a = self.slot(slot);
            sum -= gx * w[a] + gy * w[a + 1];
        }
        if self.estimate_bias {
            sum += w[self.bias(regression.source.anchor())];
        }
        sum
    }

    /// h' w once more. Order: here the differences of tag and virtual anchor are formed before the slope.
    fn shift(&self, regression: &Regression<T>, moved: &[T]) -> T {
        let [gx, gy] = regression.slope;
        let [mut dx, mut dy] = [moved[PX], moved[PY]];
        if let Source::Virtual { slot, .. } = regression.source {
            let a = self.slot(slot);
            dx -= moved[a];
            dy -= moved[a + 1];
        }
        let mut shift = gx * dx + gy * dy;
        if self.estimate_bias {
            shift += moved[self.bias(regression.source.anchor())];
        }
        shift
    }

    /// Every number of the state with its name, in the order of the core's `visit`.
    pub fn visit(&self, f: &mut dyn FnMut(fmt::Arguments<'_>, T)) {
        const NAMES: [&str; AGENT] = ["px", "py", "vx", "vy"];
        const AXES: [&str; 2] = ["x", "y"];
        let slots = self.occupied.len();
        for i in 0..AGENT {
            f(format_args!("mean of agent {}", NAMES[i]), self.mean[i]);
        }
        for j in 0..self.anchors {
            f(format_args!("mean of bias {j}"), self.mean[self.bias(j)]);
        }
        for k in 0..slots {
            for axis in 0..2 {
                let value = self.mean[self.slot(k) + axis];
                f(format_args!("mean of virtual anchor {k} {}", AXES[axis]), value);
            }
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
                let name = AXES[axis];
                for i in 0..AGENT {
                    let agent = NAMES[i];
                    f(
                        format_args!("covariance of virtual anchor {k} {name} with agent {agent}"),
                        c[i][a + axis],
                    );
                }
            }
            for j in 0..self.anchors {
                for axis in 0..2 {
                    let name = AXES[axis];
                    let value = c[a + axis][self.bias(j)];
                    f(format_args!("covariance of virtual anchor {k} {name} with bias {j}"), value);
                }
            }
            for l in 0..=k {
                for column in 0..2 {
                    for row in 0..2 {
                        let (own, other) = (AXES[row], AXES[column]);
                        f(
                            format_args!(
                                "covariance of virtual anchor {k} {own} with virtual anchor {l} {other}"
                            ),
                            c[a + row][self.slot(l) + column],
                        );
                    }
                }
            }
        }
    }
}

/// Five-point regression of r(d) = sqrt(|d|^2 + height^2) for a Gaussian d with covariance `spread` (xx, yx, yy).
///
/// With L the Cholesky factor of the covariance, the points are d, d +- sqrt(3) L_1 and d +- sqrt(3) L_2, of weights
/// 1/3 and 1/6 each. Returns the mean, the slope g = C^-1 cov(d, r), the variance around the line and along it.
/// Everything is formed relative to the centre r(d). The height has a mean and a deviation; the latter adds to the variance
/// around the line.
pub(super) fn regress_distance<T: Real>(
    distance: [T; 2],
    spread: [T; 3],
    height: [T; 2],
) -> (T, [T; 2], T, T) {
    let [height_m, _] = height;
    let num = T::of;
    let [dx, dy] = distance;
    let [xx, yx, yy] = spread;
    let l11 = sqrt(larger(xx, num(SMALLEST_SPREAD_M2)));
    let l21 = yx / l11;
    let l22 = sqrt(larger(yy - square(l21), num(SMALLEST_SPREAD_M2)));
    let range = |x: T, y: T| sqrt(square(x) + square(y) + square(height_m));
    let (step1x, step1y, step2y) = (num(ROOT_3) * l11, num(ROOT_3) * l21, num(ROOT_3) * l22);
    let centre = range(dx, dy);
    let points = [
        range(dx + step1x, dy + step1y) - centre,
        range(dx - step1x, dy - step1y) - centre,
        range(dx, dy + step2y) - centre,
        range(dx, dy - step2y) - centre,
    ];
    let line = FivePoints::new(points);
    let gy = line.along[1] / l22;
    let gx = (line.along[0] - l21 * gy) / l11;
    (centre + line.mean, [gx, gy], line.residual + height_variance_m2(height, centre), line.explained)
}

/// Variance of a range of `range_m` from the deviation of the height between its ends: slope times deviation, squared.
pub(super) fn height_variance_m2<T: Real>([mean_m, std_m]: [T; 2], range_m: T) -> T {
    // No range is shorter than its height.
    let shortest_m = if mean_m < T::ZERO { -mean_m } else { mean_m };
    square(mean_m / larger(larger(range_m, shortest_m), T::of(1e-6)) * std_m)
}

/// What four sigma points (ahead and back along each column of the Cholesky factor) tell, relative to the centre.
pub(super) struct FivePoints<T> {
    /// Mean.
    pub mean: T,
    /// Covariance with each standardised direction.
    pub along: [T; 2],
    /// Variance along the line.
    pub explained: T,
    /// Variance around it.
    pub residual: T,
}

impl<T: Real> FivePoints<T> {
    /// From the values ahead and back along the first direction, then along the second.
    pub fn new(points: [T; 4]) -> Self {
        let num = T::of;
        let sixth = T::ONE / num(6.0);
        let half_step = num(0.5) / num(ROOT_3);
        let mut sum = points[0];
        let mut squares = square(points[0]);
        for point in &points[1..] {
            sum += *point;
            squares += square(*point);
        }
        let mean = sum * sixth;
        let along = [(points[0] - points[1]) * half_step, (points[2] - points[3]) * half_step];
        let explained = square(along[0]) + square(along[1]);
        let residual = larger(squares * sixth - square(mean) - explained, T::ZERO);
        Self { mean, along, explained, residual }
    }
}
