//! How the tag moves: a velocity that decays to zero, driven by white acceleration (Ornstein and Uhlenbeck).
//!
//! dp = v dt, dv = -v / tau dt + dw, w of spectral density q. A step dt, with a = dt / tau and e = exp(-a), carries a velocity
//! for tau (1 - e) seconds and leaves e of it, and adds per axis
//!
//! Q_vv = q tau / 2 (1 - e^2), Q_pv = q tau^2 / 2 (1 - e)^2, Q_pp = q tau^3 (a - 2 (1 - e) + (1 - e^2) / 2),
//!
//! each formed as its value at constant velocity (tau infinite: q dt, q dt^2 / 2, q dt^3 / 3) times a share.

use super::Matrix;
use super::real::{Real, exp, exp_m1, square};
use cogmint_core::model::motion::{Motion, SERIES_BELOW};

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

/// Below this a, the share of Q_pp is taken as a series of so many terms.
const TERMS: usize = 8;

/// The tag alone: its four states and their covariance.
#[derive(Clone, Debug)]
pub struct Agent<T> {
    /// Means.
    pub mean: Vec<T>,
    /// Covariance.
    pub covariance: Matrix<T>,
}

/// What a step adds to the covariance of [p, v], per axis.
#[derive(Clone, Copy, Debug)]
pub struct ProcessNoise<T> {
    /// Q_pp, square metres.
    pub position: T,
    /// Q_pv, m^2/s.
    pub both: T,
    /// Q_vv, m^2/s^2.
    pub velocity: T,
}

impl<T: Real> ProcessNoise<T> {
    /// Of a velocity that changes once by this variance, at any time in `dt` seconds.
    pub fn of_turn(velocity: T, dt: T) -> Self {
        let both = velocity * (T::of(0.5) * dt);
        let position = velocity * square(dt) * T::of(1.0 / 3.0);
        Self { position, both, velocity }
    }

    /// C + Q.
    pub fn add_to(&self, c: &mut Matrix<T>) {
        for (p, v) in [(PX, VX), (PY, VY)] {
            c[p][p] += self.position;
            c[v][p] += self.both;
            c[v][v] += self.velocity;
        }
        mirror(c);
    }
}

/// A step.
#[derive(Clone, Copy, Debug)]
pub struct MotionStep<T> {
    /// How long a velocity carries, seconds.
    pub drift_s: T,
    /// What is left of it.
    pub decay: T,
    /// Q.
    pub noise: ProcessNoise<T>,
}

impl<T: Real> MotionStep<T> {
    /// Of `dt` seconds.
    pub fn new(motion: &Motion, dt: T) -> Self {
        let num = T::of;
        let a = dt / num(motion.velocity_decay_s);
        let two_a = num(2.0) * a;
        // 1 - e, and 1 - e^2.
        let (lost, lost2) = (-exp_m1(-a), -exp_m1(-two_a));
        let (mut drift, mut spread) = (T::ONE, T::ONE);
        if a > T::ZERO {
            drift = lost / a;
            spread = lost2 / two_a;
        }
        let reach = if a < num(SERIES_BELOW) {
            reach_series(a)
        } else {
            (a - num(2.0) * lost + num(0.5) * lost2) / (a * a * a)
        };
        let velocity = num(motion.acceleration_density_m2_s3) * dt;
        let noise = ProcessNoise {
            position: velocity * square(dt) * reach,
            both: velocity * (num(0.5) * dt) * square(drift),
            velocity: velocity * spread,
        };
        Self { drift_s: dt * drift, decay: exp(-a), noise }
    }

    /// x <- F x, C <- F C F' + Q.
    pub fn predicted(&self, agent: &Agent<T>) -> Agent<T> {
        let (mut next, c) = (agent.clone(), &agent.covariance);
        let (drift, decay) = (self.drift_s, self.decay);
        for (p, v) in [(PX, VX), (PY, VY)] {
            next.mean[p] += drift * agent.mean[v];
            next.mean[v] *= decay;
            for (q, u) in [(PX, VX), (PY, VY)] {
                // C_pp + drift (C_pv + C_vp) + drift^2 C_vv, (C_vp + drift C_vv) decay, C_vv decay^2.
                next.covariance[p][q] = c[p][q] + drift * (c[p][u] + c[v][q]) + drift * drift * c[v][u];
                next.covariance[v][q] = (c[v][q] + drift * c[v][u]) * decay;
                next.covariance[v][u] *= square(decay);
            }
        }
        mirror(&mut next.covariance);
        self.noise.add_to(&mut next.covariance);
        next
    }
}

/// (a - 2 (1 - e) + (1 - e^2) / 2) / a^3 as the series of (-1)^n (2^(n + 2) - 2) / (n + 3)! a^n. Order: Horner's.
fn reach_series<T: Real>(a: T) -> T {
    let mut coefficients = Vec::new();
    let (mut power, mut factorial, mut sign) = (T::of(4.0), T::of(6.0), T::ONE);
    for n in 0..TERMS {
        coefficients.push(sign * ((power - T::of(2.0)) / factorial));
        power *= T::of(2.0);
        factorial *= T::of_count(n + 4);
        sign = -sign;
    }
    let mut sum = T::ZERO;
    for coefficient in coefficients.into_iter().rev() {
        sum = sum * a + coefficient;
    }
    sum
}

/// Symmetric by copy: the lower triangle is what was computed.
pub fn mirror<T: Real>(c: &mut Matrix<T>) {
    for i in 0..c.len() {
        for j in 0..i {
            c[j][i] = c[i][j];
        }
    }
}
