//! How the tag moves: position and velocity driven by white acceleration.

use nalgebra::{Matrix4, Vector4};

/// How the tag moves and how much the map breathes.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Motion {
    /// Standard deviation of the tag's acceleration per axis, m/s^2 (1e-6 to 100). Larger follows turns faster
    /// and averages less.
    pub acceleration_std_m_s2: f32,
    /// Random walk of each virtual anchor per cycle and axis, metres (1e-7 to 1); those known exactly stay. Larger
    /// forgets map errors faster.
    pub virtual_anchor_walk_m: f32,
    /// The position's standard deviation never exceeds this, metres (1 to 1e4): a tag that is still heard is within
    /// reach, however long it was not.
    pub position_std_limit_m: f32,
}

/// The tag alone: mean and covariance of x = [p, v].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Agent {
    /// Position (metres) and velocity (m/s).
    pub mean: Vector4<f32>,
    /// Their covariance.
    pub covariance: Matrix4<f32>,
}

/// Covariance that acceleration adds to [p, v] per axis over a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProcessNoise {
    /// Position variance, square metres.
    pub position_m2: f32,
    /// Covariance of position and velocity, m^2/s.
    pub cross_m2_s: f32,
    /// Velocity variance, m^2/s^2.
    pub velocity_m2_s2: f32,
}

impl ProcessNoise {
    /// Of an acceleration of this standard deviation that is constant for `elapsed_s` seconds.
    pub fn new(acceleration_std_m_s2: f32, elapsed_s: f32) -> Self {
        let velocity_m2_s2 = acceleration_std_m_s2 * acceleration_std_m_s2 * (elapsed_s * elapsed_s);
        let cross_m2_s = velocity_m2_s2 * (0.5 * elapsed_s);
        Self { position_m2: cross_m2_s * (0.5 * elapsed_s), cross_m2_s, velocity_m2_s2 }
    }

    /// C <- C + Q.
    pub fn add_to(&self, c: &mut Matrix4<f32>) {
        c.m11 += self.position_m2;
        c.m22 += self.position_m2;
        c.m31 += self.cross_m2_s;
        c.m42 += self.cross_m2_s;
        c.m13 = c.m31;
        c.m24 = c.m42;
        c.m33 += self.velocity_m2_s2;
        c.m44 += self.velocity_m2_s2;
    }
}

/// C <- F C F' of a step at constant velocity, `elapsed_s` seconds long.
pub fn carry(c: &mut Matrix4<f32>, elapsed_s: f32) {
    let dt = elapsed_s;
    let pv12 = c.m32 + c.m41;
    c.m11 = c.m11 + dt * (2.0 * c.m31) + dt * dt * c.m33;
    c.m21 = c.m21 + dt * pv12 + dt * dt * c.m43;
    c.m22 = c.m22 + dt * (2.0 * c.m42) + dt * dt * c.m44;
    c.m31 += dt * c.m33;
    c.m32 += dt * c.m43;
    c.m41 += dt * c.m43;
    c.m42 += dt * c.m44;
    c.m12 = c.m21;
    c.m13 = c.m31;
    c.m23 = c.m32;
    c.m14 = c.m41;
    c.m24 = c.m42;
    c.m34 = c.m43;
}

/// F C F' + Q.
pub fn predicted(c: &Matrix4<f32>, elapsed_s: f32, acceleration_std_m_s2: f32) -> Matrix4<f32> {
    let mut predicted = *c;
    carry(&mut predicted, elapsed_s);
    ProcessNoise::new(acceleration_std_m_s2, elapsed_s).add_to(&mut predicted);
    predicted
}
