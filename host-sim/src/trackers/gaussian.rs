//! A joint Gaussian of the state of [`super::map::Map`], in double precision.

use super::map::{Map, VELOCITY};

/// Mean, covariance and weight of a Gaussian.
#[derive(Clone, Debug)]
pub(crate) struct Gaussian {
    pub(crate) mean: Vec<f64>,
    /// Row by row.
    pub(crate) covariance: Vec<f64>,
    pub(crate) ln_weight: f64,
}

impl Gaussian {
    /// The prior of a map.
    pub(crate) fn prior(map: &Map) -> Self {
        let states = map.states();
        let mut covariance = vec![0.0; states * states];
        for (index, [_, std]) in map.prior.iter().enumerate() {
            covariance[index * (states + 1)] = std * std;
        }
        Self { mean: map.prior.iter().map(|[mean, _]| *mean).collect(), covariance, ln_weight: 0.0 }
    }

    /// Number of states.
    pub(crate) fn states(&self) -> usize {
        self.mean.len()
    }

    /// Covariance of the position, square metres: xx, xy, yy.
    pub(crate) fn position_m2(&self) -> [f64; 3] {
        [self.covariance[0], self.covariance[1], self.covariance[self.states() + 1]]
    }

    /// `elapsed_s` seconds pass with a white acceleration of the density `density` per axis, m^2/s^3.
    pub(crate) fn predict(&mut self, elapsed_s: f64, density: f64) {
        let states = self.states();
        for axis in 0..2 {
            self.mean[axis] += elapsed_s * self.mean[axis + VELOCITY];
        }
        for axis in 0..2 {
            for column in 0..states {
                self.covariance[axis * states + column] +=
                    elapsed_s * self.covariance[(axis + VELOCITY) * states + column];
            }
        }
        for row in 0..states {
            for axis in 0..2 {
                self.covariance[row * states + axis] +=
                    elapsed_s * self.covariance[row * states + axis + VELOCITY];
            }
        }
        let noise = [
            density * elapsed_s * elapsed_s * elapsed_s / 3.0,
            density * elapsed_s * elapsed_s / 2.0,
            density * elapsed_s,
        ];
        for axis in 0..2 {
            let velocity = axis + VELOCITY;
            self.covariance[axis * (states + 1)] += noise[0];
            self.covariance[axis * states + velocity] += noise[1];
            self.covariance[velocity * states + axis] += noise[1];
            self.covariance[velocity * (states + 1)] += noise[2];
        }
    }

    /// w = P h and h' P h for a sparse h.
    pub(crate) fn along(&self, slope: &[(usize, f64)]) -> (Vec<f64>, f64) {
        let states = self.states();
        let mut w = vec![0.0; states];
        for (index, h) in slope {
            // Symmetric: a row is a column.
            let row = &self.covariance[index * states..(index + 1) * states];
            for (w, p) in w.iter_mut().zip(row) {
                *w += h * p;
            }
        }
        let variance = slope.iter().map(|(index, h)| h * w[*index]).sum();
        (w, variance)
    }

    /// x <- x + w `gain`, P <- P + `scale` w w'.
    pub(crate) fn step(&mut self, w: &[f64], gain: f64, scale: f64) {
        let states = self.states();
        for (x, w) in self.mean.iter_mut().zip(w) {
            *x += w * gain;
        }
        for (row, w_row) in w.iter().enumerate() {
            if *w_row == 0.0 {
                continue;
            }
            let scaled = scale * w_row;
            for (p, w) in self.covariance[row * states..(row + 1) * states].iter_mut().zip(w) {
                *p += scaled * w;
            }
        }
    }

    /// The moments of this and another one together, weights added.
    pub(crate) fn join(&mut self, other: &Gaussian) {
        let most = self.ln_weight.max(other.ln_weight);
        let (a, b) = ((self.ln_weight - most).exp(), (other.ln_weight - most).exp());
        let (a, b) = (a / (a + b), b / (a + b));
        let apart: Vec<f64> = other.mean.iter().zip(&self.mean).map(|(x, y)| x - y).collect();
        let states = self.states();
        for row in 0..states {
            for column in 0..states {
                let place = row * states + column;
                self.covariance[place] = a * self.covariance[place]
                    + b * other.covariance[place]
                    + a * b * apart[row] * apart[column];
            }
        }
        for (x, apart) in self.mean.iter_mut().zip(&apart) {
            *x += b * apart;
        }
        let (a, b) = ((self.ln_weight - most).exp(), (other.ln_weight - most).exp());
        self.ln_weight = most + (a + b).ln();
    }

    /// Squared distance from another one's position and velocity in this one's deviations, position and velocity apart;
    /// infinite where this one's covariance is none.
    pub(crate) fn distances(&self, other: &Gaussian) -> [f64; 2] {
        let states = self.states();
        [0, VELOCITY].map(|first| {
            let at = |row: usize, column: usize| self.covariance[(first + row) * states + first + column];
            let [x, y] = [other.mean[first] - self.mean[first], other.mean[first + 1] - self.mean[first + 1]];
            let determinant = at(0, 0) * at(1, 1) - at(0, 1) * at(0, 1);
            let square = (at(1, 1) * x * x - 2.0 * at(0, 1) * x * y + at(0, 0) * y * y) / determinant;
            if determinant > 0.0 { square } else { f64::INFINITY }
        })
    }

    /// Unit vector and variance of the position along its least known direction.
    pub(crate) fn major(&self) -> ([f64; 2], f64) {
        let [xx, xy, yy] = self.position_m2();
        let (mean, half) = (0.5 * (xx + yy), 0.5 * (xx - yy));
        let root = (half * half + xy * xy).sqrt();
        let angle = 0.5 * xy.atan2(half);
        ([angle.cos(), angle.sin()], mean + root)
    }

    /// Three in place of this one, side by side along the position's least known direction: weights 1/4, 1/2, 1/4, one
    /// deviation of it apart, each with half the variance. The moments stay.
    pub(crate) fn split(self) -> [Self; 3] {
        let ([x, y], variance) = self.major();
        let (w, _) = self.along(&[(0, x), (1, y)]);
        let std = variance.sqrt();
        let part = |offset: f64, share: f64| {
            let mut part = self.clone();
            // w / variance is the slope of all states over that direction.
            part.step(&w, offset * std / variance, -0.5 / variance);
            part.ln_weight += share.ln();
            part
        };
        [part(-1.0, 0.25), part(0.0, 0.5), part(1.0, 0.25)]
    }

    /// Keeps rounding from making the covariance lopsided.
    pub(crate) fn symmetrise(&mut self) {
        let states = self.states();
        for row in 0..states {
            for column in 0..row {
                let mean =
                    0.5 * (self.covariance[row * states + column] + self.covariance[column * states + row]);
                self.covariance[row * states + column] = mean;
                self.covariance[column * states + row] = mean;
            }
        }
    }

    /// The same with a velocity that is zero with the deviation `std_m_s`, whatever it was, and a position that is less certain
    /// by `jump_m`.
    pub(crate) fn turned(&self, std_m_s: f64, jump_m: f64) -> Self {
        let mut turned = self.clone();
        let states = self.states();
        for axis in 0..2 {
            let velocity = VELOCITY + axis;
            turned.mean[velocity] = 0.0;
            for other in 0..states {
                turned.covariance[velocity * states + other] = 0.0;
                turned.covariance[other * states + velocity] = 0.0;
            }
            turned.covariance[velocity * (states + 1)] = std_m_s * std_m_s;
            turned.covariance[axis * (states + 1)] += jump_m * jump_m;
        }
        turned
    }
}
