//! Region: where a tag may be of which nothing else is known.

use super::anchor::Anchor;
use crate::real::{TAU, larger};
use crate::snapshot::written;

/// Guard: against the division by it: least area of a region, square metres.
pub const LEAST_AREA_M2: f32 = 1.0;

/// A uniform distribution over the plane: its moments and its area.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Region {
    /// Mean, metres.
    pub centre_m: [f32; 2],
    /// Variance of x, covariance, variance of y, square metres.
    pub covariance_m2: [f32; 3],
    /// Square metres.
    pub area_m2: f32,
}

impl Region {
    /// No region.
    pub(crate) const NONE: Self = Self { centre_m: [0.0; 2], covariance_m2: [0.0; 3], area_m2: 0.0 };

    /// What these anchors reach: a disc about their mean.
    pub fn reached(anchors: &[Anchor], reach_m: f32) -> Self {
        let share = 1.0 / larger(anchors.len() as f32, 1.0);
        let mut centre_m = [0.0; 2];
        for anchor in anchors {
            let [x, y] = anchor.position_m;
            let [sum_x, sum_y] = centre_m;
            centre_m = [sum_x + share * x, sum_y + share * y];
        }
        let variance_m2 = 0.25 * (reach_m * reach_m);
        Self {
            centre_m,
            covariance_m2: [variance_m2, 0.0, variance_m2],
            area_m2: 0.5 * (TAU * (reach_m * reach_m)),
        }
    }

    /// What lies inside an outline (corners in order, either way round, metres); `None` where it has hardly an area.
    pub fn inside(outline_m: &[[f32; 2]]) -> Option<Self> {
        let [x0, y0] = *outline_m.first()?;
        // Triangles from the first corner on, twice their areas with a sign; moments relative to that corner.
        let (mut twice, mut x, mut y) = (0.0, 0.0, 0.0);
        let (mut xx, mut yx, mut yy) = (0.0, 0.0, 0.0);
        for ([ax, ay], [bx, by]) in outline_m.iter().zip(outline_m.iter().skip(1)) {
            let (ax, ay, bx, by) = (ax - x0, ay - y0, bx - x0, by - y0);
            let own = ax * by - bx * ay;
            twice += own;
            x += own * (ax + bx);
            y += own * (ay + by);
            xx += own * (ax * ax + ax * bx + bx * bx);
            yx += own * (ax * ay + bx * by + 0.5 * (ax * by + bx * ay));
            yy += own * (ay * ay + ay * by + by * by);
        }
        let area_m2 = 0.5 * larger(twice, -twice);
        if !(area_m2 >= LEAST_AREA_M2) {
            return None;
        }
        let (x, y) = (x / (3.0 * twice), y / (3.0 * twice));
        let sixth = 1.0 / (6.0 * twice);
        let covariance_m2 = [sixth * xx - x * x, sixth * yx - y * x, sixth * yy - y * y];
        Some(Self { centre_m: [x0 + x, y0 + y], covariance_m2, area_m2 })
    }
}

written!(Region { centre_m, covariance_m2, area_m2 });

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_are_those_of_points_spread_evenly() {
        let l = [[0.0, 0.0], [10.0, 0.0], [10.0, 4.0], [5.0, 4.0], [5.0, 8.0], [0.0, 8.0]];
        let turned = l.map(|[x, y]: [f32; 2]| [30.0 + 0.6 * x - 0.8 * y, -20.0 + 0.8 * x + 0.6 * y]);
        let mut back = turned;
        back.reverse();
        // Points on a grid, in f64.
        let mut points = std::vec::Vec::new();
        for n in 0..1000 {
            for m in 0..800 {
                let (x, y) = (0.01 * (f64::from(n) + 0.5), 0.01 * (f64::from(m) + 0.5));
                if x < 5.0 || y < 4.0 {
                    points.push((30.0 + 0.6 * x - 0.8 * y, -20.0 + 0.8 * x + 0.6 * y));
                }
            }
        }
        let mean = |f: &dyn Fn(f64, f64) -> f64| {
            points.iter().map(|(x, y)| f(*x, *y)).sum::<f64>() / points.len() as f64
        };
        let (x, y) = (mean(&|x, _| x), mean(&|_, y| y));
        let exact = [
            mean(&|px, _| (px - x) * (px - x)),
            mean(&|px, py| (px - x) * (py - y)),
            mean(&|_, py| (py - y) * (py - y)),
        ];
        for outline in [turned, back] {
            let region = Region::inside(&outline).unwrap();
            assert!((region.area_m2 - 60.0).abs() < 1e-3);
            assert!((f64::from(region.centre_m[0]) - x).abs() < 1e-3);
            assert!((f64::from(region.centre_m[1]) - y).abs() < 1e-3);
            for (found, exact) in region.covariance_m2.into_iter().zip(exact) {
                assert!((f64::from(found) - exact).abs() < 2e-3, "{found} {exact}");
            }
        }
        assert_eq!(Region::inside(&[]), None);
        assert_eq!(Region::inside(&[[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]]), None);
    }

    #[test]
    fn anchors_reach_a_disc_about_their_mean() {
        let anchors = [[1.0, 2.0], [3.0, 8.0]].map(|position_m| Anchor { position_m, height_m: 0.0 });
        let region = Region::reached(&anchors, 20.0);
        assert_eq!((region.centre_m, region.covariance_m2), ([2.0, 5.0], [100.0, 0.0, 100.0]));
        assert!((region.area_m2 - 1256.637).abs() < 1e-2);
    }
}
