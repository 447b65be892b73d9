//! How the tag moves: near-constant velocity, driven by an acceleration that is constant over a step.
//!
//! x = [p, v], p <- p + dt v, C <- F C F' + Q.

use super::Matrix;
use super::real::{Real, square};

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

/// The tag alone: its four states and their covariance.
#[derive(Clone, Debug)]
pub struct Agent<T> {
    /// Means.
    pub mean: Vec<T>,
    /// Covariance.
    pub covariance: Matrix<T>,
}

/// F C F'. With p, v the blocks: C_pp + dt (C_pv + C_vp) + dt^2 C_vv, C_vp + dt C_vv, C_vv.
pub fn carried<T: Real>(c: &Matrix<T>, dt: T) -> Matrix<T> {
    let mut next = c.clone();
    for a in 0..2 {
        for b in 0..2 {
            let (va, vb) = (a + 2, b + 2);
            next[a][b] = c[a][b] + dt * (c[a][vb] + c[va][b]) + dt * dt * c[va][vb];
            next[va][b] = c[va][b] + dt * c[va][vb];
        }
    }
    mirror(&mut next);
    next
}

/// C + Q, Q the covariance that an acceleration of this standard deviation makes of [p, v] in `dt` seconds.
pub fn disturbed<T: Real>(c: &Matrix<T>, dt: T, acceleration_std_m_s2: T) -> Matrix<T> {
    let half = T::of(0.5) * dt;
    // Order: each is formed from the one before.
    let velocity = square(acceleration_std_m_s2) * square(dt);
    let both = velocity * half;
    let position = both * half;
    let mut next = c.clone();
    for p in 0..2 {
        let v = p + 2;
        next[p][p] += position;
        next[v][p] += both;
        next[v][v] += velocity;
    }
    mirror(&mut next);
    next
}

/// F C F' + Q.
pub fn predicted<T: Real>(c: &Matrix<T>, dt: T, acceleration_std_m_s2: T) -> Matrix<T> {
    disturbed(&carried(c, dt), dt, acceleration_std_m_s2)
}

/// Symmetric by copy: the lower triangle is what was computed.
pub fn mirror<T: Real>(c: &mut Matrix<T>) {
    for i in 0..c.len() {
        for j in 0..i {
            c[j][i] = c[i][j];
        }
    }
}
