//! The line that a range follows around a Gaussian: one five-point regression for all.
//!
//! For z of mean m and covariance C = L L' in two dimensions, the sigma points are m, m +- sqrt(3) L_1 and m +- sqrt(3) L_2, of
//! weights 1/3 and 1/6 each. From f at these points follow the mean of f(z), its slope C^-1 cov(z, f), the variance along that
//! line and the variance around it.

use super::real::{Real, abs, larger, sqrt, square};
pub use cogmint_core::model::range::SMALLEST_SPREAD_M2;
use cogmint_core::model::source::Source;

/// Shortest range that is divided by, metres.
const SHORTEST_M: f32 = 1e-6;
/// Spread of the sigma points, standard deviations: the square root of 3.
const ROOT_3: f32 = 1.732_050_8;

/// Where an anchor is seen from.
#[derive(Clone, Copy, Debug)]
pub struct Sight<T> {
    /// Position of the anchor, metres.
    pub anchor_m: [T; 2],
    /// Its height above the tag, metres: mean and standard deviation.
    pub height_m: [T; 2],
    /// Where the tag's antenna is: ahead of its body's centre and to its left, metres.
    pub lever_arm_m: [T; 2],
}

/// The line that a range follows around the predicted state.
#[derive(Clone, Copy, Debug)]
pub struct Regression<T> {
    /// The feature.
    pub source: Source,
    /// Expected range, metres.
    pub range_m: T,
    /// Slope g over d = p - m, m the image.
    pub slope: [T; 2],
    /// Slopes -D'g over the two numbers of each surface that reflects the path, with the surface's slot.
    pub surfaces: [Option<(usize, [T; 2])>; 3],
    /// Variance around the line, square metres.
    pub residual_m2: T,
    /// Variance along it, square metres.
    pub explained_m2: T,
}

impl<T: Real> Regression<T> {
    /// Variance of the expected range.
    pub fn variance_m2(&self) -> T {
        self.explained_m2 + self.residual_m2
    }
}

/// A function of two Gaussian variables as a line.
#[derive(Clone, Copy, Debug)]
pub struct Line<T> {
    /// Value at the mean of the variables.
    pub centre: T,
    /// Mean.
    pub mean: T,
    /// Slope over both variables.
    pub slope: [T; 2],
    /// Variance along the line.
    pub explained: T,
    /// Variance around it.
    pub residual: T,
}

/// Five-point regression of `f`, given as a function of how far the two variables are from their means. `covariance`: xx, yx,
/// yy; `least`: what xx and the part of yy that x does not explain count as, at least.
pub fn five_points<T: Real>(covariance: [T; 3], least: [f32; 2], f: impl Fn([T; 2]) -> T) -> Line<T> {
    let num = T::of;
    let [xx, yx, yy] = covariance;
    let l11 = sqrt(larger(xx, num(least[0])));
    let l21 = yx / l11;
    let l22 = sqrt(larger(yy - square(l21), num(least[1])));
    let steps = [[num(ROOT_3) * l11, num(ROOT_3) * l21], [T::ZERO, num(ROOT_3) * l22]];
    // Order: all relative to the centre, ahead and back along the first step, then along the second.
    let centre = f([T::ZERO; 2]);
    let (mut sum, mut squares, mut along) = (T::ZERO, T::ZERO, [T::ZERO; 2]);
    for (axis, [x, y]) in steps.into_iter().enumerate() {
        let (ahead, back) = (f([x, y]) - centre, f([-x, -y]) - centre);
        sum = sum + ahead + back;
        squares = squares + square(ahead) + square(back);
        along[axis] = (ahead - back) * (num(0.5) / num(ROOT_3));
    }
    let sixth = T::ONE / num(6.0);
    let mean = sum * sixth;
    let explained = square(along[0]) + square(along[1]);
    let residual = larger(squares * sixth - square(mean) - explained, T::ZERO);
    // The slope from L' slope = along.
    let over_y = along[1] / l22;
    let over_x = (along[0] - l21 * over_y) / l11;
    Line { centre, mean: centre + mean, slope: [over_x, over_y], explained, residual }
}

/// The line of r(d) = sqrt(|d|^2 + height^2) for a Gaussian d with covariance `spread` (xx, yx, yy). The height has a mean and a
/// deviation; the latter adds to the variance around the line.
pub fn regress_distance<T: Real>([dx, dy]: [T; 2], spread: [T; 3], height_m: [T; 2]) -> Line<T> {
    let mut line = five_points(spread, [SMALLEST_SPREAD_M2; 2], |[x, y]| {
        sqrt(square(dx + x) + square(dy + y) + square(height_m[0]))
    });
    line.residual += height_variance_m2(height_m, line.centre);
    line
}

/// Variance of a range of `range_m` from the deviation of the height between its ends: slope times deviation, squared.
pub fn height_variance_m2<T: Real>([mean_m, std_m]: [T; 2], range_m: T) -> T {
    // No range is shorter than its height.
    let range_m = larger(larger(range_m, abs(mean_m)), T::of(SHORTEST_M));
    square(mean_m / range_m * std_m)
}
