//! The state filter's problem at full size (52 states, 26 ranges per step) in the filters of other crates, in f32 and as
//! each crate means it to be used. `tests/benches/state_filter.rs` compares them with the core's.
//!
//! Every unscented filter has alpha = 1, beta = 0, kappa = 0: points at sqrt(52) standard deviations, all weights alike.
//! An extended one takes all ranges at once, linearised at the predicted state, or one after the other, whichever costs
//! its crate less.

#![no_std]

extern crate alloc;

/// With `std`, its products are blocked; the workspace's own nalgebra has no `std`.
pub use nalgebra;

pub mod kfilter_crate;
pub mod minikalman_crate;
pub mod textbook;

/// Physical anchors.
pub const ANCHORS: usize = 2;
/// Virtual anchors.
pub const VAS: usize = 24;
/// The tag's position and velocity, then the virtual anchors.
pub const STATES: usize = 4 + 2 * VAS;
/// One per anchor, physical ones first.
pub const RANGES: usize = ANCHORS + VAS;
/// Sigma points of the textbook.
pub const POINTS: usize = 2 * STATES + 1;

/// What every filter is told at the start.
#[derive(Clone, Debug)]
pub struct Scene {
    /// State and the variances of its entries.
    pub mean: [f32; STATES],
    /// See `mean`.
    pub variance: [f32; STATES],
    /// Physical anchors, metres.
    pub anchors_m: [[f32; 2]; ANCHORS],
    /// Variance of a range, square metres.
    pub range_variance_m2: f32,
    /// Seconds per step.
    pub step_s: f32,
    /// Standard deviation of the tag's acceleration, m/s^2.
    pub acceleration_density_m2_s3: f32,
    /// Random walk of a virtual anchor per step, metres.
    pub virtual_anchor_walk_m_sqrt_s: f32,
}

/// A filter in the middle of its work.
pub trait Filter {
    /// Prediction and update with the ranges of one step.
    fn step(&mut self, ranges_m: &[f32; RANGES]);
    /// Entry of the mean.
    fn state(&self, index: usize) -> f32;
}

impl Scene {
    /// Scene of a start given by position, standard deviations of position, velocity and virtual anchors, and places.
    pub fn started(mut self, start_m: [f32; 2], std: [f32; 3], virtual_anchors_m: &[[f32; 2]; VAS]) -> Self {
        let [position, velocity, image] = std.map(|std| std * std);
        let agent_m = [start_m, [0.0; 2]].into_iter().flatten();
        let agent = [position, position, velocity, velocity].into_iter();
        let places = agent_m.chain(virtual_anchors_m.iter().flatten().copied());
        let variances = agent.chain(core::iter::repeat(image));
        for ((mean, variance), (place, own)) in
            self.mean.iter_mut().zip(&mut self.variance).zip(places.zip(variances))
        {
            (*mean, *variance) = (place, own);
        }
        self
    }

    /// Calls `f` with row, column and value of every entry of F - I.
    pub fn each_transition(&self, mut f: impl FnMut(usize, usize, f32)) {
        f(0, 2, self.step_s);
        f(1, 3, self.step_s);
    }

    /// Calls `f` with row, column and value of every entry of Q.
    pub fn each_noise(&self, mut f: impl FnMut(usize, usize, f32)) {
        let q = self.acceleration_density_m2_s3;
        let dt = self.step_s;
        for axis in 0..2 {
            f(axis, axis, q * dt * dt * dt / 3.0);
            f(axis, axis + 2, q * dt * dt / 2.0);
            f(axis + 2, axis, q * dt * dt / 2.0);
            f(axis + 2, axis + 2, q * dt);
        }
        for state in 4..STATES {
            f(state, state, self.virtual_anchor_walk_m_sqrt_s * self.virtual_anchor_walk_m_sqrt_s * dt);
        }
    }

    /// Difference of the tag and the anchor of a range, where `x` gives the state's entries.
    pub fn difference(&self, range: usize, x: impl Fn(usize) -> f32) -> [f32; 2] {
        match self.anchors_m.get(range) {
            Some([ax, ay]) => [x(0) - ax, x(1) - ay],
            None => [x(0) - x(image(range)), x(1) - x(image(range) + 1)],
        }
    }

    /// Expected range, metres.
    pub fn range(&self, range: usize, x: impl Fn(usize) -> f32) -> f32 {
        let [dx, dy] = self.difference(range, x);
        root(dx * dx + dy * dy)
    }

    /// Calls `f` with column and value of every entry of a range's gradient that is not zero.
    pub fn slope(&self, range: usize, x: impl Fn(usize) -> f32, mut f: impl FnMut(usize, f32)) {
        let [dx, dy] = self.difference(range, x);
        let length = root(dx * dx + dy * dy);
        for (axis, slope) in [dx / length, dy / length].into_iter().enumerate() {
            f(axis, slope);
            if range >= ANCHORS {
                f(image(range) + axis, -slope);
            }
        }
    }
}

/// Index of the virtual anchor's x behind a range.
fn image(range: usize) -> usize {
    4 + 2 * (range - ANCHORS)
}

fn root(x: f32) -> f32 {
    nalgebra::ComplexField::sqrt(x)
}
