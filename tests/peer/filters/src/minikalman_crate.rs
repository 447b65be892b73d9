//! `minikalman`: its unscented and its extended filter, with the crate's builders. The buffers lie on the heap.

use crate::{Filter, POINTS, RANGES, STATES, Scene};
use minikalman::prelude::*;
use minikalman::{extended, unscented};

/// The crate's unscented filter.
pub struct Unscented {
    scene: Scene,
    filter: unscented::builder::KalmanFilterType<STATES, POINTS, f32>,
    ranges: unscented::builder::KalmanFilterObservationType<STATES, RANGES, POINTS, f32>,
}

impl Unscented {
    /// At the start.
    pub fn new(scene: &Scene) -> Self {
        let builder = unscented::builder::KalmanFilterBuilder::<STATES, f32>::default();
        let mut filter = builder.build::<POINTS>();
        filter.set_alpha(1.0);
        filter.set_beta(0.0);
        filter.set_kappa(0.0);
        filter.state_vector_mut().apply(|x| (0..STATES).for_each(|i| x.set_row(i, scene.mean[i])));
        filter
            .estimate_covariance_mut()
            .apply(|p| (0..STATES).for_each(|i| p.set_at(i, i, scene.variance[i])));
        filter
            .direct_process_noise_mut()
            .apply(|q| scene.each_noise(|row, column, value| q.set_at(row, column, value)));
        let mut ranges = builder.observations().build::<RANGES, POINTS>();
        ranges.measurement_noise_covariance_mut().make_scalar(scene.range_variance_m2);
        Self { scene: scene.clone(), filter, ranges }
    }
}

impl Filter for Unscented {
    fn step(&mut self, ranges_m: &[f32; RANGES]) {
        let scene = &self.scene;
        self.filter.predict_nonlinear(|x| {
            scene.each_transition(|row, column, value| {
                let moved = x.as_matrix().get_at(row, 0) + value * x.as_matrix().get_at(column, 0);
                x.as_matrix_mut().set_at(row, 0, moved);
            });
        });
        self.ranges.measurement_vector_mut().apply(|z| (0..RANGES).for_each(|i| z.set_row(i, ranges_m[i])));
        self.filter.correct_sigma_point(&mut self.ranges, |points, images| {
            for range in 0..RANGES {
                for point in 0..POINTS {
                    images[range * POINTS + point] = scene.range(range, |i| points[i * POINTS + point]);
                }
            }
        });
    }

    fn state(&self, index: usize) -> f32 {
        self.filter.state_vector()[index]
    }
}

/// The crate's extended filter.
pub struct Extended {
    scene: Scene,
    filter: extended::builder::KalmanFilterType<STATES, f32>,
    ranges: extended::builder::KalmanFilterObservationType<STATES, RANGES, f32>,
}

impl Extended {
    /// At the start.
    pub fn new(scene: &Scene) -> Self {
        let builder = extended::builder::KalmanFilterBuilder::<STATES, f32>::default();
        let mut filter = builder.build();
        filter.state_vector_mut().apply(|x| (0..STATES).for_each(|i| x.set_row(i, scene.mean[i])));
        filter
            .estimate_covariance_mut()
            .apply(|p| (0..STATES).for_each(|i| p.set_at(i, i, scene.variance[i])));
        filter
            .direct_process_noise_mut()
            .apply(|q| scene.each_noise(|row, column, value| q.set_at(row, column, value)));
        filter.state_transition_jacobian_mut().apply(|f| {
            f.make_identity();
            scene.each_transition(|row, column, value| f.set_at(row, column, value));
        });
        let mut ranges = builder.observations().build::<RANGES>();
        ranges.measurement_noise_covariance_mut().make_scalar(scene.range_variance_m2);
        Self { scene: scene.clone(), filter, ranges }
    }
}

impl Filter for Extended {
    fn step(&mut self, ranges_m: &[f32; RANGES]) {
        let scene = &self.scene;
        self.filter.predict_nonlinear(|x, next| {
            (0..STATES).for_each(|i| next[i] = x[i]);
            scene.each_transition(|row, column, value| next[row] += value * x[column]);
        });
        self.ranges.measurement_vector_mut().apply(|z| (0..RANGES).for_each(|i| z.set_row(i, ranges_m[i])));
        let x = self.filter.state_vector();
        self.ranges
            .observation_jacobian_matrix_mut()
            .apply(|h| scene.each_slope(|i| x[i], |row, column, slope| h.set_at(row, column, slope)));
        self.filter.correct_nonlinear(&mut self.ranges, |x, expected| {
            (0..RANGES).for_each(|range| expected.set_row(range, scene.range(range, |i| x[i])));
        });
    }

    fn state(&self, index: usize) -> f32 {
        self.filter.state_vector()[index]
    }
}
