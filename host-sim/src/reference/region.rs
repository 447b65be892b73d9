//! Region: a uniform distribution over what an outline holds, or over what anchors reach.

use super::real::{Real, abs, square, tau};
use cogmint_core::Anchor;
use cogmint_core::model::region::LEAST_AREA_M2;

/// Its moments and its area.
#[derive(Clone, Debug)]
pub struct Region<T> {
    /// Mean, metres.
    pub centre_m: [T; 2],
    /// Of x; of both; of y: square metres.
    pub covariance_m2: [T; 3],
    /// Square metres.
    pub area_m2: T,
}

impl<T: Real> Region<T> {
    /// A disc about the mean of the anchors.
    pub fn reached(anchors: &[Anchor], reach_m: f32) -> Self {
        let share = T::ONE / T::of_count(anchors.len());
        let centre_m = [0, 1].map(|axis| {
            anchors.iter().fold(T::ZERO, |sum, anchor| sum + share * T::of(anchor.position_m[axis]))
        });
        let reach2 = square(T::of(reach_m));
        let variance = T::of(0.25) * reach2;
        Self {
            centre_m,
            covariance_m2: [variance, T::ZERO, variance],
            area_m2: T::of(0.5) * (tau::<T>() * reach2),
        }
    }

    /// Inside an outline: the sum over the triangles that its sides make with its first corner.
    pub fn inside(outline_m: &[[T; 2]]) -> Option<Self> {
        let first = *outline_m.first()?;
        let relative = |corner: &[T; 2]| [corner[0] - first[0], corner[1] - first[1]];
        let mut twice = T::ZERO;
        let mut sums = [T::ZERO; 2];
        let mut squares = [T::ZERO; 3];
        for pair in outline_m.windows(2) {
            let (a, b) = (relative(&pair[0]), relative(&pair[1]));
            let own = a[0] * b[1] - b[0] * a[1];
            twice += own;
            for axis in 0..2 {
                sums[axis] += own * (a[axis] + b[axis]);
            }
            let mixed = a[0] * a[1] + b[0] * b[1] + T::of(0.5) * (a[0] * b[1] + b[0] * a[1]);
            squares[0] += own * (a[0] * a[0] + a[0] * b[0] + b[0] * b[0]);
            squares[1] += own * mixed;
            squares[2] += own * (a[1] * a[1] + a[1] * b[1] + b[1] * b[1]);
        }
        let area_m2 = T::of(0.5) * abs(twice);
        if area_m2 < T::of(LEAST_AREA_M2) {
            return None;
        }
        let [x, y] = sums.map(|sum| sum / (T::of(3.0) * twice));
        let sixth = T::ONE / (T::of(6.0) * twice);
        let covariance_m2 =
            [sixth * squares[0] - x * x, sixth * squares[1] - y * x, sixth * squares[2] - y * y];
        Some(Self { centre_m: [first[0] + x, first[1] + y], covariance_m2, area_m2 })
    }
}
