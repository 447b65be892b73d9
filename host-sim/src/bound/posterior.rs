//! What a tracker could know at best: the posterior Cramer-Rao bound of position and velocity with a known map.
//!
//! With the tracker's own motion model (white acceleration, x <- F x, Q = sigma_a^2 G G') and start prior, and the
//! information I_n that a cycle's paths carry about the position (H picks the position out of the state),
//!
//! J_{n+1} = (Q + F J_n^-1 F')^-1 + H' I_{n+1} H.
//!
//! Kept as P = J^-1, which needs no inverse of a singular matrix: predict P <- F P F' + Q, then
//! P <- P - P H' (1 + I H P H')^-1 I H P. The expectation over states is taken at the true path, as is usual for one
//! given path; a path that is no sample of the motion model (legs and corners) can be met with errors below or above.
//!
//! Source: Tichavsky, Muravchik, Nehorai 1998, for linear motion and a state that the measurements see in part.

use super::Information;

/// The bound after the cycles so far: the covariance of x, y, and their velocities.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Posterior {
    covariance: [[f64; 4]; 4],
}

impl Posterior {
    /// Before the first cycle: independent deviations of the position, metres, and the velocity, m/s, per axis.
    pub fn new(position_std_m: f64, velocity_std_m_s: f64) -> Self {
        let mut covariance = [[0.0; 4]; 4];
        for (index, std) in
            [position_std_m, position_std_m, velocity_std_m_s, velocity_std_m_s].iter().enumerate()
        {
            covariance[index][index] = std * std;
        }
        Self { covariance }
    }

    /// From a covariance of x, y, and their velocities.
    pub fn of(covariance: nalgebra::Matrix4<f64>) -> Self {
        Self {
            covariance: std::array::from_fn(|row| std::array::from_fn(|column| covariance[(row, column)])),
        }
    }

    /// Time passes: `elapsed_s` seconds with a white acceleration of that density per axis, m^2/s^3.
    pub fn predict(&mut self, elapsed_s: f64, acceleration_density_m2_s3: f64) {
        let p = &mut self.covariance;
        // F P, then (F P) F'.
        let [x, y, u, v] = p;
        for (position, velocity) in [(x, u), (y, v)] {
            for (of_position, of_velocity) in position.iter_mut().zip(velocity.iter()) {
                *of_position += elapsed_s * of_velocity;
            }
        }
        for row in p.iter_mut() {
            for axis in 0..2 {
                row[axis] += elapsed_s * row[axis + 2];
            }
        }
        let velocity = acceleration_density_m2_s3 * elapsed_s;
        let noise = [
            [velocity * elapsed_s * elapsed_s / 3.0, velocity * elapsed_s / 2.0],
            [velocity * elapsed_s / 2.0, velocity],
        ];
        for axis in 0..2 {
            for (i, row) in noise.iter().enumerate() {
                for (j, entry) in row.iter().enumerate() {
                    p[axis + 2 * i][axis + 2 * j] += entry;
                }
            }
        }
    }

    /// A cycle's paths tell of the position.
    pub fn update(&mut self, [xx, xy, yy]: Information) {
        let information = [[xx, xy], [xy, yy]];
        let prior = self.covariance;
        // M = 1 + I P_pp, and M^-1 I, which is symmetric.
        let mut m = [[1.0, 0.0], [0.0, 1.0]];
        for i in 0..2 {
            for j in 0..2 {
                m[i][j] += information[i][0] * prior[0][j] + information[i][1] * prior[1][j];
            }
        }
        let determinant = m[0][0] * m[1][1] - m[0][1] * m[1][0];
        let inverse = [
            [m[1][1] / determinant, -m[0][1] / determinant],
            [-m[1][0] / determinant, m[0][0] / determinant],
        ];
        let mut gain = [[0.0; 2]; 2];
        for i in 0..2 {
            for j in 0..2 {
                gain[i][j] = inverse[i][0] * information[0][j] + inverse[i][1] * information[1][j];
            }
        }
        for (row, covariance) in self.covariance.iter_mut().enumerate() {
            for (column, value) in covariance.iter_mut().enumerate() {
                for i in 0..2 {
                    for j in 0..2 {
                        *value -= prior[row][i] * gain[i][j] * prior[j][column];
                    }
                }
            }
        }
        // Rounding must not make it lopsided.
        for row in 0..4 {
            for column in 0..row {
                let mean = 0.5 * (self.covariance[row][column] + self.covariance[column][row]);
                self.covariance[row][column] = mean;
                self.covariance[column][row] = mean;
            }
        }
    }

    /// Entropy of a Gaussian position of this covariance, nats: 1/2 ln det + ln(2 pi e).
    pub fn position_entropy_nat(&self) -> f64 {
        let [[xx, _, ..], [yx, yy, ..], ..] = self.covariance;
        0.5 * (xx * yy - yx * yx).ln() + (std::f64::consts::TAU * std::f64::consts::E).ln()
    }

    /// Least mean square error of the position, m^2: the trace of its block.
    pub fn position_trace_m2(&self) -> f64 {
        self.covariance[0][0] + self.covariance[1][1]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix2, Matrix4};

    /// The steady state of the Kalman-Bucy filter of a double integrator, sqrt(2) q^(1/4) r^(3/4) per axis, which frequent
    /// updates come near: r is the variance of one times the time between two.
    #[test]
    fn in_the_steady_state_it_is_the_kalman_bucy_filters() {
        for (sigma_m, period_s, density) in [(0.5_f64, 1e-4_f64, 0.1_f64), (5.0, 1e-4, 2.0)] {
            let spectral_m2_s = sigma_m * sigma_m * period_s;
            let expected_m2 = 2.0 * 2.0_f64.sqrt() * density.powf(0.25) * spectral_m2_s.powf(0.75);
            let mut posterior = Posterior::new(0.25, 0.03);
            for _ in 0..100_000 {
                posterior.predict(period_s, density);
                posterior.update([1.0 / (sigma_m * sigma_m), 0.0, 1.0 / (sigma_m * sigma_m)]);
            }
            let trace_m2 = posterior.position_trace_m2();
            assert!((trace_m2 / expected_m2 - 1.0).abs() < 2e-3, "{trace_m2} {expected_m2}");
        }
    }

    /// The recursion as it is published, with inverses, on information that differs from cycle to cycle.
    #[test]
    fn it_is_the_published_recursion() {
        let (period_s, acceleration) = (0.7_f64, 0.05);
        let mut f = Matrix4::identity();
        f[(0, 2)] = period_s;
        f[(1, 3)] = period_s;
        let (xx, xv, vv) = (period_s.powi(3) / 3.0, period_s.powi(2) / 2.0, period_s);
        #[rustfmt::skip]
        let q = acceleration * Matrix4::new(
            xx, 0.0, xv, 0.0,
            0.0, xx, 0.0, xv,
            xv, 0.0, vv, 0.0,
            0.0, xv, 0.0, vv,
        );
        let mut j = Matrix4::from_diagonal(&nalgebra::Vector4::new(4.0, 4.0, 100.0, 100.0));
        let mut posterior = Posterior::new(0.5, 0.1);
        for n in 0..200 {
            let angle = 0.37 * f64::from(n);
            let (c, s) = (angle.cos(), angle.sin());
            // One direction only, nothing at all every fifth time.
            let strength = if n % 5 == 4 { 0.0 } else { 50.0 + 10.0 * f64::from(n % 7) };
            let information = [strength * c * c, strength * c * s, strength * s * s];
            let predicted = q + f * j.try_inverse().expect("is regular") * f.transpose();
            j = predicted.try_inverse().expect("is regular");
            let block = Matrix2::new(information[0], information[1], information[1], information[2]);
            let seen = j.fixed_view::<2, 2>(0, 0) + block;
            j.fixed_view_mut::<2, 2>(0, 0).copy_from(&seen);
            posterior.predict(period_s, acceleration);
            posterior.update(information);
            let covariance = j.try_inverse().expect("is regular");
            let expected_m2 = covariance[(0, 0)] + covariance[(1, 1)];
            assert!((posterior.position_trace_m2() / expected_m2 - 1.0).abs() < 1e-9, "cycle {n}");
        }
    }
}
