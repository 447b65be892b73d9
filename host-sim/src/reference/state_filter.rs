//! The state filter: one mean vector, one covariance matrix.
//!
//! State, in this order: the tag (p_x, p_y, v_x, v_y), one range bias per anchor, two coordinates per slot of the map.
//! A slot without a virtual anchor keeps zeros and is left out of every loop; so are the biases when they are not
//! estimated.
//!
//! Prediction: x <- F x, C <- F C F' + Q ([`super::motion`]), and a random walk of the virtual anchors.
//!
//! Measurement: z = |d| + b with d = p - a, linearised over the spread of d (five sigma points) to z = mean + h' (x -
//! E x) + residual, where h has the slope g at p, -g at a, and 1 at b. With w = C h, the update is the soft one along w ([`super::soft_update`]), with S = h' w + residual + measurement variance.

use super::motion::{AGENT, Agent, MotionStep, PX, PY, ProcessNoise, VX, VY};
use super::range::{Regression, SMALLEST_SPREAD_M2, Sight, regress_distance};
use super::real::{Real, larger, sqrt, square};
use super::soft_update::{Moments, SoftUpdate};
use super::{Matrix, zeros};
use cogmint_core::model::motion::Motion;
use cogmint_core::model::source::Source;
use cogmint_core::perceptor::state_filter::{ROUNDING_MARGIN, VELOCITY_LIMIT, VIRTUAL_ANCHOR_LIMIT_M2};
use std::fmt;

/// What the measurements of one feature amount to.
#[derive(Clone, Copy, Debug)]
pub struct Innovation<T> {
    /// The feature and its line.
    pub regression: Regression<T>,
    /// Its innovations.
    pub moments: Moments<T>,
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
            // A virtual anchor without variance is known exactly and does not walk.
            if !self.is_bias(i) && self.covariance[i][i] > T::ZERO {
                self.covariance[i][i] += walk;
            }
        }
        self.limit();
    }

    /// After a prediction: further noise over the same step.
    pub fn disturb(&mut self, noise: &ProcessNoise<T>) {
        let mut covariance = self.agent_covariance();
        noise.add_to(&mut covariance);
        self.set_agent_covariance(&covariance);
    }

    /// Changes the covariance of position and velocity.
    pub fn set_agent_covariance(&mut self, covariance: &Matrix<T>) {
        for i in 0..AGENT {
            self.covariance[i][..AGENT].copy_from_slice(&covariance[i]);
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
        let line = regress_distance(distance, spread, sight.height_m);
        let mut explained_m2 = line.explained;
        if self.estimate_bias {
            let cross = line.slope[0] * bias_cross[0] + line.slope[1] * bias_cross[1];
            explained_m2 = larger(explained_m2 + num(2.0) * cross + c[b][b], num(SMALLEST_SPREAD_M2));
        }
        Regression {
            source,
            range_m: line.mean + self.mean[b],
            slope: line.slope,
            residual_m2: line.residual,
            explained_m2,
        }
    }

    /// Applies the innovations of a cycle in the order given. All lines were taken at the state as it is now.
    pub fn update(&mut self, innovations: &[Innovation<T>]) {
        if innovations.is_empty() {
            return;
        }
        // Every variance grows by what rounding may take.
        for i in self.active() {
            self.covariance[i][i] *= T::ONE + T::of(ROUNDING_MARGIN);
        }
        let prior = self.mean.clone();
        for innovation in innovations {
            self.apply(innovation, &prior);
        }
    }

    fn apply(&mut self, innovation: &Innovation<T>, prior: &[T]) {
        let Innovation { regression, moments, variance_m2 } = innovation;
        let active = self.active();
        let mut w = vec![T::ZERO; self.mean.len()];
        for &i in &active {
            w[i] = self.covariance_with(regression, i);
        }
        let explained = larger(self.form(regression, &w), T::ZERO);
        // The line was taken at the prior; since then the state has moved along it.
        let moved: Vec<T> = (0..w.len()).map(|i| self.mean[i] - prior[i]).collect();
        let moments = moments.shifted(self.shift(regression, &moved));
        // Order: what the state does not explain first.
        let variance = explained + (*variance_m2 + regression.residual_m2);
        let change = SoftUpdate::new(&moments, variance, explained);

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
