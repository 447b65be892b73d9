//! The textbook's unscented filter written plainly with nalgebra's static matrices: points drawn for the prediction, and
//! again for the update.

use crate::{Filter, POINTS, RANGES, STATES, Scene};
use nalgebra::{SMatrix, SVector};

/// The filter.
pub struct Textbook {
    scene: Scene,
    x: SVector<f32, STATES>,
    p: SMatrix<f32, STATES, STATES>,
    noise: SMatrix<f32, STATES, STATES>,
}

impl Textbook {
    /// At the start.
    pub fn new(scene: &Scene) -> Self {
        let mut noise = SMatrix::zeros();
        scene.each_noise(|row, column, value| noise[(row, column)] = value);
        let p = SMatrix::from_diagonal(&SVector::from(scene.variance));
        Self { scene: scene.clone(), x: SVector::from(scene.mean), p, noise }
    }

    /// The mean, then x +- sqrt(n) times each column of the Cholesky factor; the first has the weight 0.
    fn points(&self) -> SMatrix<f32, STATES, POINTS> {
        let root = self.p.cholesky().expect("positive definite").l() * crate::root(STATES as f32);
        let mut points = SMatrix::<f32, STATES, POINTS>::zeros();
        points.set_column(0, &self.x);
        for i in 0..STATES {
            points.set_column(1 + i, &(self.x + root.column(i)));
            points.set_column(1 + STATES + i, &(self.x - root.column(i)));
        }
        points
    }
}

/// Weight of every point but the first.
const WEIGHT: f32 = 1.0 / (2.0 * STATES as f32);

/// Mean of the columns but the first, and their differences from it (the first's is 0).
fn mean<const N: usize>(points: &SMatrix<f32, N, POINTS>) -> (SVector<f32, N>, SMatrix<f32, N, POINTS>) {
    let mut mean = SVector::zeros();
    for column in points.column_iter().skip(1) {
        mean += column;
    }
    mean *= WEIGHT;
    let mut around = *points;
    for (i, mut column) in around.column_iter_mut().enumerate() {
        if i == 0 { column.fill(0.0) } else { column -= mean }
    }
    (mean, around)
}

impl Filter for Textbook {
    fn step(&mut self, ranges_m: &[f32; RANGES]) {
        let scene = &self.scene;
        let mut points = self.points();
        for mut point in points.column_iter_mut() {
            scene.each_transition(|row, column, value| point[row] += value * point[column]);
        }
        let (x, around) = mean(&points);
        self.x = x;
        self.p = around * around.transpose() * WEIGHT + self.noise;

        let points = self.points();
        let images = SMatrix::<f32, RANGES, POINTS>::from_fn(|range, point| {
            scene.range(range, |i| points[(i, point)])
        });
        let (_, around) = mean(&points);
        let (expected, images) = mean(&images);
        let pzz = images * images.transpose() * WEIGHT + SMatrix::identity() * scene.range_variance_m2;
        let pxz = around * images.transpose() * WEIGHT;
        // K' = pzz^-1 pxz'.
        let gain = pzz.cholesky().expect("positive definite").solve(&pxz.transpose()).transpose();
        self.x += gain * (SVector::from(*ranges_m) - expected);
        self.p -= gain * pxz.transpose();
        self.p = self.p.symmetric_part();
    }

    fn state(&self, index: usize) -> f32 {
        self.x[index]
    }
}
