//! How the tag moves: a position, and a velocity that decays to zero, driven by white acceleration.
//!
//! dp = v dt, dv = -v / tau dt + dw, w of spectral density q per axis (Ornstein and Uhlenbeck 1930): a tag of which nothing is
//! heard comes to rest. With tau infinite it is the published model of nearly constant velocity. Over a step dt, with
//! a = dt / tau and e = exp(-a), exactly:
//!
//! p <- p + tau (1 - e) v, v <- e v, Q_vv = q tau / 2 (1 - e^2), Q_pv = q tau^2 / 2 (1 - e)^2,
//! Q_pp = q tau^3 (a - 2 (1 - e) + (1 - e^2) / 2),
//!
//! so that cutting a step in two changes nothing but rounding.

use crate::real::{exp, expm1};
use crate::snapshot::{Blank, Reader, Sink, SnapshotError, Stored, Written, stored, written};
use nalgebra::{Matrix2, Matrix4, Vector4};

/// How the tag moves and how much the map changes.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Motion {
    /// Spectral density of the white acceleration per axis, m^2/s^3 (1e-12 to 1e4). Larger follows turns faster and averages
    /// less. An acceleration of deviation s that is constant for T seconds at a time has s^2 T.
    pub acceleration_density_m2_s3: f32,
    /// Time constant with which a velocity decays to zero, seconds (at least 0.1); infinite: constant velocity, as published.
    /// Shorter expects the tag to stop or turn sooner.
    pub velocity_decay_s: f32,
    /// Random walk of each virtual anchor per axis, metres per square root of a second (1e-7 to 1); those known exactly
    /// stay. Larger forgets map errors faster.
    pub virtual_anchor_walk_m_sqrt_s: f32,
}

/// Where the tag is believed to be before the first cycle.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Start {
    /// Position, metres (within 10 km of the origin).
    pub position_m: [f32; 2],
    /// Its standard deviation per axis, metres (1e-3 to 1e3).
    pub position_std_m: f32,
    /// Standard deviation of the velocity per axis around zero, m/s (1e-3 to 1e3).
    pub velocity_std_m_s: f32,
}

/// The tag alone: mean and covariance of x = [p, v].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Agent {
    /// Position (metres) and velocity (m/s).
    pub mean: Vector4<f32>,
    /// Their covariance.
    pub covariance: Matrix4<f32>,
}

impl Motion {
    /// That of a tracker that is not started.
    pub(crate) const NONE: Self =
        Self { acceleration_density_m2_s3: 0.0, velocity_decay_s: 0.0, virtual_anchor_walk_m_sqrt_s: 0.0 };
}

impl Agent {
    /// All zeros.
    pub(crate) const NONE: Self = Self {
        mean: Vector4::new(0.0, 0.0, 0.0, 0.0),
        covariance: Matrix4::new(
            0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0,
        ),
    };

    /// Covariance of the velocity alone, m^2/s^2.
    pub fn velocity_covariance_m2_s2(&self) -> Matrix2<f32> {
        let c = &self.covariance;
        Matrix2::new(c.m33, c.m34, c.m43, c.m44)
    }
}

impl Start {
    /// The tag where it starts.
    pub(crate) fn agent(&self) -> Agent {
        let [x, y] = self.position_m;
        let position = self.position_std_m * self.position_std_m;
        let velocity = self.velocity_std_m_s * self.velocity_std_m_s;
        Agent {
            mean: Vector4::new(x, y, 0.0, 0.0),
            covariance: Matrix4::from_diagonal(&Vector4::new(position, position, velocity, velocity)),
        }
    }
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
    /// Of a velocity that changes once in `elapsed_s` seconds, at any time, by this variance.
    pub fn of_turn(velocity_m2_s2: f32, elapsed_s: f32) -> Self {
        let cross_m2_s = velocity_m2_s2 * (0.5 * elapsed_s);
        Self {
            position_m2: velocity_m2_s2 * (elapsed_s * elapsed_s) * (1.0 / 3.0),
            cross_m2_s,
            velocity_m2_s2,
        }
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

/// The motion over one step of time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionStep {
    /// How far a velocity carries, seconds: tau (1 - e).
    pub drift_s: f32,
    /// What is left of a velocity: e.
    pub decay: f32,
    /// What acceleration adds.
    pub noise: ProcessNoise,
}

/// Guard: against lost digits: below this a = dt / tau, the series of Q_pp is taken in place of its closed form.
pub const SERIES_BELOW: f32 = 0.5;
/// Mathematics: coefficients of the series of (a - 2 (1 - e^-a) + (1 - e^-2a) / 2) / a^3: of a^n, (-1)^n (2^(n+2) - 2) / (n + 3)!.
const SERIES: [f32; 8] = [
    1.0 / 3.0,
    -1.0 / 4.0,
    7.0 / 60.0,
    -1.0 / 24.0,
    31.0 / 2520.0,
    -1.0 / 320.0,
    127.0 / 181_440.0,
    -17.0 / 120_960.0,
];

impl Motion {
    /// Over `elapsed_s` seconds.
    pub fn step(&self, elapsed_s: f32) -> MotionStep {
        let dt = elapsed_s;
        let a = dt / self.velocity_decay_s;
        let lost = -expm1(-a);
        // Shares of their values at constant velocity; 1 where a is 0.
        let (drift, spread) = if a > 0.0 { (lost / a, -expm1(-2.0 * a) / (2.0 * a)) } else { (1.0, 1.0) };
        let reach = if a < SERIES_BELOW {
            SERIES.iter().rev().fold(0.0, |sum, coefficient| sum * a + coefficient)
        } else {
            (a - 2.0 * lost - 0.5 * expm1(-2.0 * a)) / (a * a * a)
        };
        let velocity = self.acceleration_density_m2_s3 * dt;
        MotionStep {
            drift_s: dt * drift,
            decay: exp(-a),
            noise: ProcessNoise {
                position_m2: velocity * (dt * dt) * reach,
                cross_m2_s: velocity * (0.5 * dt) * (drift * drift),
                velocity_m2_s2: velocity * spread,
            },
        }
    }
}

impl MotionStep {
    /// x <- F x.
    pub fn carry_mean(&self, x: &mut Vector4<f32>) {
        x.x += self.drift_s * x.z;
        x.y += self.drift_s * x.w;
        x.z *= self.decay;
        x.w *= self.decay;
    }

    /// C <- F C F' + Q.
    pub fn carry_covariance(&self, c: &mut Matrix4<f32>) {
        let (drift, decay) = (self.drift_s, self.decay);
        let crossed = c.m32 + c.m41;
        c.m11 = c.m11 + drift * (2.0 * c.m31) + drift * drift * c.m33;
        c.m21 = c.m21 + drift * crossed + drift * drift * c.m43;
        c.m22 = c.m22 + drift * (2.0 * c.m42) + drift * drift * c.m44;
        c.m31 = (c.m31 + drift * c.m33) * decay;
        c.m32 = (c.m32 + drift * c.m43) * decay;
        c.m41 = (c.m41 + drift * c.m43) * decay;
        c.m42 = (c.m42 + drift * c.m44) * decay;
        c.m33 *= decay * decay;
        c.m43 *= decay * decay;
        c.m44 *= decay * decay;
        c.m12 = c.m21;
        c.m23 = c.m32;
        c.m14 = c.m41;
        c.m34 = c.m43;
        self.noise.add_to(c);
    }

    /// F C F' + Q.
    pub fn predicted(&self, c: &Matrix4<f32>) -> Matrix4<f32> {
        let mut predicted = *c;
        self.carry_covariance(&mut predicted);
        predicted
    }
}

impl Written for Motion {
    fn write(&self, to: &mut impl Sink) {
        let Self { acceleration_density_m2_s3, velocity_decay_s, virtual_anchor_walk_m_sqrt_s } = self;
        to.float(*acceleration_density_m2_s3);
        // It may be infinite, which no other number is.
        to.word(velocity_decay_s.to_bits());
        to.float(*virtual_anchor_walk_m_sqrt_s);
    }
}

impl Stored for Motion {
    fn read(&mut self, from: &mut Reader<'_>) -> Result<(), SnapshotError> {
        let Self { acceleration_density_m2_s3, velocity_decay_s, virtual_anchor_walk_m_sqrt_s } = self;
        [acceleration_density_m2_s3, velocity_decay_s, virtual_anchor_walk_m_sqrt_s]
            .into_iter()
            .try_for_each(|number| number.read(from))
    }
}

impl Blank for Motion {
    fn blank() -> Self {
        Self { acceleration_density_m2_s3: 0.0, velocity_decay_s: 0.0, virtual_anchor_walk_m_sqrt_s: 0.0 }
    }
}

written!(Start { position_m, position_std_m, velocity_std_m_s });
stored!(Agent { mean, covariance } told {});

#[cfg(test)]
mod tests {
    use super::*;

    fn motion(velocity_decay_s: f32) -> Motion {
        Motion { acceleration_density_m2_s3: 0.3, velocity_decay_s, virtual_anchor_walk_m_sqrt_s: 1e-4 }
    }

    /// Moments of the differential equation, integrated in f64 by small steps of the midpoint rule.
    fn integrated(decay_s: f64, density: f64, elapsed_s: f64) -> [f64; 5] {
        let steps = 20_000;
        let dt = elapsed_s / f64::from(steps);
        // Drift and decay of a velocity of 1; the covariance from zero.
        let rate = |[_, v, _, xv, vv]: [f64; 5]| {
            [v, -v / decay_s, 2.0 * xv, vv - xv / decay_s, density - 2.0 * vv / decay_s]
        };
        let mut y = [0.0, 1.0, 0.0, 0.0, 0.0];
        for _ in 0..steps {
            let half: [f64; 5] = core::array::from_fn(|i| y[i] + 0.5 * dt * rate(y)[i]);
            y = core::array::from_fn(|i| y[i] + dt * rate(half)[i]);
        }
        y
    }

    #[test]
    fn a_step_has_the_moments_of_the_differential_equation() {
        for decay_s in [0.1_f32, 0.7, 1.5, 1.99, 2.01, 20.0, 1e4, f32::INFINITY] {
            for elapsed_s in [1e-3_f32, 0.1, 1.0, 30.0] {
                let step = motion(decay_s).step(elapsed_s);
                let ProcessNoise { position_m2, cross_m2_s, velocity_m2_s2 } = step.noise;
                let found = [step.drift_s, step.decay, position_m2, cross_m2_s, velocity_m2_s2];
                let expected = integrated(f64::from(decay_s), 0.3_f32.into(), elapsed_s.into());
                for (found, expected) in found.iter().zip(expected) {
                    let error = (f64::from(*found) - expected).abs();
                    assert!(error < 2e-5 * expected + 1e-12, "{decay_s} {elapsed_s}: {found} {expected}");
                }
            }
        }
    }

    #[test]
    fn cutting_a_step_changes_nothing_but_rounding() {
        let c = Matrix4::from_diagonal(&Vector4::new(0.04, 0.09, 1.0, 0.25));
        for decay_s in [0.3, 1.5, 10.0, f32::INFINITY] {
            let whole = motion(decay_s).step(1.0).predicted(&c);
            for parts in [2, 10, 100] {
                let step = motion(decay_s).step(1.0 / parts as f32);
                let cut = (0..parts).fold(c, |c, _| step.predicted(&c));
                for (whole, cut) in whole.iter().zip(cut.iter()) {
                    assert!((whole - cut).abs() <= 1e-5 * whole.abs(), "{decay_s} {parts}: {whole} {cut}");
                }
            }
        }
    }
}
