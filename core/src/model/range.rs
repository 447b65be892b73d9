//! Regression of a range on where tag and source are: five sigma points on two dimensions.
//!
//! Centre weight 1/3, spread sqrt 3: all moments of a Gaussian to the fifth order. The line explains a part of the
//! range's variance; the rest is its curvature.

use super::source::Source;
use crate::real::{abs, larger, sqrt};

/// Guard: against the division by their spread: least variance that sigma points are spread by, square metres.
pub const SMALLEST_SPREAD_M2: f32 = 1e-12;
/// Guard: against the slope of a range of no length: shortest range divided by, metres.
const SHORTEST_M: f32 = 1e-6;
/// Mathematics: spread of the sigma points, standard deviations.
pub const SIGMA_POINT: f32 = 1.732_050_8;
/// Guard: against the division by it: least squared radius of the circle that a range leaves of a height, square metres.
pub const LEAST_RADIUS2_M2: f32 = 1e-4;

/// Statistical linear regression of one range on the state, taken at the prior.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Regression {
    /// What the range belongs to.
    pub source: Source,
    /// Expected range, bias included, metres.
    pub range_m: f32,
    /// Slope g of the range over the tag's position.
    pub slope: [f32; 2],
    /// Its slopes over the numbers of the surfaces that reflect the path.
    pub surfaces: [SurfaceSlope; 2],
    /// Its slope over the numbers of the heading; 0 where it does not depend on it.
    pub heading: [f32; 2],
    /// Part of the range's variance that the line does not explain, square metres.
    pub residual_m2: f32,
    /// Part that it does: g' C_d g and the bias, square metres.
    pub explained_m2: f32,
}

/// Slope of a range over the two numbers of a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceSlope {
    /// The surface's slot in the state filter; `None` where there is none.
    pub surface: Option<usize>,
    /// The slope; 0 where there is none.
    pub slope: [f32; 2],
}

impl SurfaceSlope {
    /// Over no surface.
    pub const NONE: Self = Self { surface: None, slope: [0.0; 2] };
}

impl Regression {
    /// Of a range that depends on nothing.
    pub(crate) const NONE: Self = Self {
        source: Source::Direct { anchor: 0 },
        range_m: 0.0,
        slope: [0.0; 2],
        surfaces: [SurfaceSlope::NONE; 2],
        heading: [0.0; 2],
        residual_m2: 0.0,
        explained_m2: 0.0,
    };

    /// Variance of the expected range, square metres.
    pub fn variance_m2(&self) -> f32 {
        self.explained_m2 + self.residual_m2
    }
}

/// A function of two independent standard normal variables by its values at five sigma points: the centre, and
/// [`SIGMA_POINT`] deviations ahead and back along each variable.
#[derive(Clone, Copy, Debug)]
pub struct FivePoints {
    /// Mean, relative to the value at the centre.
    pub offset: f32,
    /// Slope of the regression line along each variable.
    pub along: [f32; 2],
    /// Variance that the line explains.
    pub explained: f32,
    /// Variance that it does not.
    pub residual: f32,
}

impl FivePoints {
    /// From the values (ahead, back) along each variable relative to the centre's, so that the small differences keep their
    /// digits.
    pub fn new([a1, b1]: [f32; 2], [a2, b2]: [f32; 2]) -> Self {
        let offset = (a1 + b1 + a2 + b2) * (1.0 / 6.0);
        let along1 = (a1 - b1) * (0.5 / SIGMA_POINT);
        let along2 = (a2 - b2) * (0.5 / SIGMA_POINT);
        let second = (a1 * a1 + b1 * b1 + a2 * a2 + b2 * b2) * (1.0 / 6.0);
        let explained = along1 * along1 + along2 * along2;
        let residual = larger(second - offset * offset - explained, 0.0);
        Self { offset, along: [along1, along2], explained, residual }
    }
}

/// Regression of a distance on its two-dimensional difference vector.
#[derive(Clone, Copy, Debug)]
pub struct DistanceRegression {
    /// Expected distance, metres.
    pub range_m: f32,
    /// Slope over the difference vector.
    pub slope: [f32; 2],
    /// Variance that the line does not explain, square metres.
    pub residual_m2: f32,
    /// Variance that it does, square metres.
    pub explained_m2: f32,
}

/// Variance of a range (square metres) that comes of the height of its ends' difference: of mean `height_m` and deviation
/// `height_std_m`, at a range of `range_m` (metres). To first order: (z height_std)^2, z = height / range its slope. Exactly 0
/// for a height that is exact.
pub fn height_variance_m2(height_m: f32, height_std_m: f32, range_m: f32) -> f32 {
    let along = height_m / larger(larger(range_m, abs(height_m)), SHORTEST_M) * height_std_m;
    along * along
}

/// Five-point unscented regression of sqrt(|d|^2 + height^2) for d of mean `distance` (metres) and covariance `spread`
/// (xx, yx, yy; square metres); the height's deviation `height_std_m` is part of what the line does not explain.
pub fn regress_distance(
    distance: [f32; 2],
    spread: [f32; 3],
    height_m: f32,
    height_std_m: f32,
) -> DistanceRegression {
    let [dx, dy] = distance;
    let [sxx, syx, syy] = spread;
    let l11 = sqrt(larger(sxx, SMALLEST_SPREAD_M2));
    let l21 = syx / l11;
    let l22 = sqrt(larger(syy - l21 * l21, SMALLEST_SPREAD_M2));
    let (e1x, e1y, e2y) = (SIGMA_POINT * l11, SIGMA_POINT * l21, SIGMA_POINT * l22);
    let height2 = height_m * height_m;
    let length = |x: f32, y: f32| sqrt(x * x + y * y + height2);
    let centre = length(dx, dy);
    let first = [length(dx + e1x, dy + e1y) - centre, length(dx - e1x, dy - e1y) - centre];
    let second = [length(dx, dy + e2y) - centre, length(dx, dy - e2y) - centre];
    let FivePoints { offset, along: [along1, along2], explained, residual } = FivePoints::new(first, second);
    let gy = along2 / l22;
    let gx = (along1 - l21 * gy) / l11;
    DistanceRegression {
        range_m: centre + offset,
        slope: [gx, gy],
        residual_m2: residual + height_variance_m2(height_m, height_std_m, centre),
        explained_m2: explained,
    }
}
