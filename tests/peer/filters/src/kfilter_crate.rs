//! `kfilter`: its unscented filter, and its linear one with a measurement linearised at every step (the crate's extended
//! filter, whose prediction is linear here).

use crate::{Filter, POINTS, RANGES, STATES, Scene};
use kfilter::measurement::{LinearisableMeasurement, Measurement};
use kfilter::system::LinearNoInputSystem;
use kfilter::{Kalman, KalmanFilter, KalmanLinearNoInput, KalmanPredict, KalmanUpdate, UKFLinearNoInput};
use kfilter::{UKFParameters, UnscentedKalman};
use nalgebra::{SMatrix, SVector};

type State = SVector<f32, STATES>;
type Covariance = SMatrix<f32, STATES, STATES>;

/// All ranges of a step.
struct Ranges {
    scene: Scene,
    measured: SVector<f32, RANGES>,
    variance: SMatrix<f32, RANGES, RANGES>,
    jacobian: SMatrix<f32, RANGES, STATES>,
    transpose: SMatrix<f32, STATES, RANGES>,
}

impl Ranges {
    fn new(scene: &Scene) -> Self {
        Self {
            scene: scene.clone(),
            measured: SVector::zeros(),
            variance: SMatrix::identity() * scene.range_variance_m2,
            jacobian: SMatrix::zeros(),
            transpose: SMatrix::zeros(),
        }
    }

    fn linearise(&mut self, x: &State) {
        let Self { scene, jacobian, transpose, .. } = self;
        for range in 0..RANGES {
            scene.slope(
                range,
                |i| x[i],
                |column, slope| {
                    jacobian[(range, column)] = slope;
                    transpose[(column, range)] = slope;
                },
            );
        }
    }
}

impl Measurement<f32, STATES, RANGES> for Ranges {
    fn covariance(&self) -> &SMatrix<f32, RANGES, RANGES> {
        &self.variance
    }

    fn measurement(&self) -> &SVector<f32, RANGES> {
        &self.measured
    }

    fn set_measurement(&mut self, z: SVector<f32, RANGES>) {
        self.measured = z;
    }

    fn predict(&self, x: &State) -> SVector<f32, RANGES> {
        SVector::from_fn(|range, _| self.scene.range(range, |i| x[i]))
    }
}

impl LinearisableMeasurement<f32, STATES, RANGES> for Ranges {
    fn observation(&self) -> &SMatrix<f32, RANGES, STATES> {
        &self.jacobian
    }

    fn observation_transpose(&self) -> &SMatrix<f32, STATES, RANGES> {
        &self.transpose
    }
}

fn model(scene: &Scene) -> (Covariance, Covariance, State, Covariance) {
    let mut transition = Covariance::identity();
    scene.each_transition(|row, column, value| transition[(row, column)] = value);
    let mut noise = Covariance::zeros();
    scene.each_noise(|row, column, value| noise[(row, column)] = value);
    let prior = Covariance::from_diagonal(&State::from(scene.variance));
    (transition, noise, State::from(scene.mean), prior)
}

/// The crate's unscented filter.
pub struct Unscented {
    filter: UKFLinearNoInput<f32, STATES, POINTS>,
    ranges: Ranges,
}

impl Unscented {
    /// At the start.
    pub fn new(scene: &Scene) -> Self {
        let (transition, noise, mean, prior) = model(scene);
        let system = LinearNoInputSystem::new(transition, noise, mean);
        let parameters = UKFParameters { alpha: 1.0, beta: 0.0, kappa: 0.0 };
        let filter = UnscentedKalman::new_custom_with_params(system, prior, parameters);
        Self { filter, ranges: Ranges::new(scene) }
    }
}

impl Filter for Unscented {
    fn step(&mut self, ranges_m: &[f32; RANGES]) {
        self.ranges.measured = SVector::from(*ranges_m);
        self.filter.predict().expect("positive definite");
        self.filter.update(&self.ranges).expect("invertible");
    }

    fn state(&self, index: usize) -> f32 {
        self.filter.state()[index]
    }
}

/// The crate's linear prediction and extended update.
pub struct Extended {
    filter: KalmanLinearNoInput<f32, STATES>,
    ranges: Ranges,
}

impl Extended {
    /// At the start.
    pub fn new(scene: &Scene) -> Self {
        let (transition, noise, mean, prior) = model(scene);
        Self { filter: Kalman::new(transition, noise, mean, prior), ranges: Ranges::new(scene) }
    }
}

impl Filter for Extended {
    fn step(&mut self, ranges_m: &[f32; RANGES]) {
        self.ranges.measured = SVector::from(*ranges_m);
        self.filter.predict().expect("cannot fail");
        self.ranges.linearise(self.filter.state());
        self.filter.update(&self.ranges).expect("invertible");
    }

    fn state(&self, index: usize) -> f32 {
        self.filter.state()[index]
    }
}
