//! Images of an anchor in surfaces, and how they move with them.
//!
//! The image of a in a wall with the centre c, the offset o and the normal u turned by theta, with t = u turned left,
//! s = u . (a - c) - o and q = t . (a - c):
//!
//! m = a - 2 s u,  dm/do = 2 u,  dm/dtheta = -2 (q u + s t),
//! d2m/dtheta2 = 2 (2 s + o) u - 4 q t,  d2m/do dtheta = 2 t,  d2m/do2 = 0.
//!
//! A second wall mirrors what the first one's image does: its slopes and curvatures are multiplied by R = I - 2 u u', and
//! dR/dtheta = -2 (t u' + u t') makes the curvatures that the two walls have in common.

use super::surface::{Line, Surface};
use crate::snapshot::stored;
use nalgebra::{Matrix2, Vector2};

/// The surfaces that reflect a path, in order from the anchor outwards: one or two.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Sequence {
    /// The first surface, by its slot in the state filter.
    pub first: u8,
    /// The second one.
    pub second: Option<u8>,
    /// Whether the two may come in either order: at right angles to each other they make one image.
    pub is_either_order: bool,
}

impl Sequence {
    /// A single surface.
    pub const fn of(first: u8) -> Self {
        Self { first, second: None, is_either_order: false }
    }

    /// Number of reflections.
    pub const fn order(&self) -> usize {
        match self.second {
            None => 1,
            Some(_) => 2,
        }
    }

    /// The surfaces in order.
    pub fn surfaces(&self) -> impl Iterator<Item = usize> + Clone {
        core::iter::once(self.first).chain(self.second).map(usize::from)
    }

    /// Whether it contains a surface.
    pub fn has(&self, surface: usize) -> bool {
        self.surfaces().any(|own| own == surface)
    }

    /// Whether it makes the image that another one makes: two surfaces that may come in either order do so in both.
    pub fn is_same(&self, other: &Self) -> bool {
        let is_order = |other: &Self| (self.first, self.second) == (other.first, other.second);
        is_order(other) || ((self.is_either_order || other.is_either_order) && is_order(&other.reversed()))
    }

    /// The other order.
    #[must_use]
    pub const fn reversed(&self) -> Self {
        match self.second {
            None => *self,
            Some(second) => Self { first: second, second: Some(self.first), ..*self },
        }
    }
}

/// An image by the two numbers of each surface that makes it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Image {
    /// Its position, metres.
    pub position_m: Vector2<f32>,
    /// Slopes of the position over the numbers of the first surface (by columns) and the second; 0 where there is none.
    pub slopes: [Matrix2<f32>; 2],
    /// Second derivatives: of the first surface over offset and rotation, over rotation twice; of the second likewise; 0 for
    /// private surfaces.
    curvatures: [[Vector2<f32>; 2]; 2],
    /// Derivatives over the second surface's rotation of the first one's two slopes.
    common: Matrix2<f32>,
}

const NOWHERE: Vector2<f32> = Vector2::new(0.0, 0.0);
const NOTHING: Matrix2<f32> = Matrix2::new(0.0, 0.0, 0.0, 0.0);

impl Image {
    /// The image of a point that moves with nothing.
    pub fn still([x, y]: [f32; 2]) -> Self {
        Self {
            position_m: Vector2::new(x, y),
            slopes: [NOTHING; 2],
            curvatures: [[NOWHERE; 2]; 2],
            common: NOTHING,
        }
    }

    /// The image of an anchor in a surface whose two numbers are `state`.
    pub fn first([x, y]: [f32; 2], surface: &Surface, state: &Vector2<f32>) -> Self {
        let (position_m, slope, curvature) = match surface {
            // Nothing is seen in a heading.
            Surface::Private | Surface::Heading { .. } => {
                (*state, Matrix2::new(1.0, 0.0, 0.0, 1.0), [NOWHERE; 2])
            }
            Surface::Wall(line) => Mirror::new(line, state).reflect(&Vector2::new(x, y)),
        };
        Self { position_m, slopes: [slope, NOTHING], curvatures: [curvature, [NOWHERE; 2]], common: NOTHING }
    }

    /// The image of this image of one surface in a second one; a private surface has none, and leaves it where it is.
    #[must_use]
    pub fn second(&self, surface: &Surface, state: &Vector2<f32>) -> Self {
        let Surface::Wall(line) = surface else { return *self };
        let mirror = Mirror::new(line, state);
        let (position_m, slope, curvature) = mirror.reflect(&self.position_m);
        let [own, _] = &self.slopes;
        let [bend, _] = &self.curvatures;
        Self {
            position_m,
            slopes: [mirror.turned(own), slope],
            curvatures: [[mirror.mirrored(&bend[0]), mirror.mirrored(&bend[1])], curvature],
            common: mirror.turning(own),
        }
    }

    /// How far the expected position is from the position at the expected numbers, to the second order, metres: `own` are the
    /// covariances of the first surface's numbers and of the second's, `cross` that of the first (rows) with the second.
    pub fn shift_m(&self, own: &[Matrix2<f32>; 2], cross: &Matrix2<f32>) -> Vector2<f32> {
        let mut shift = NOWHERE;
        for ([common, twice], c) in self.curvatures.iter().zip(own) {
            shift.x += common.x * c.m21 + 0.5 * (twice.x * c.m22);
            shift.y += common.y * c.m21 + 0.5 * (twice.y * c.m22);
        }
        let k = &self.common;
        shift.x += k.m11 * cross.m12 + k.m12 * cross.m22;
        shift.y += k.m21 * cross.m12 + k.m22 * cross.m22;
        shift
    }
}

/// A wall as it stands.
struct Mirror<'a> {
    line: &'a Line,
    offset_m: f32,
    /// Unit normal and tangent, turned.
    normal: [f32; 2],
    tangent: [f32; 2],
    /// d theta over the rotation's own number, and its derivative.
    rate: f32,
    rate_slope: f32,
}

impl<'a> Mirror<'a> {
    fn new(line: &'a Line, state: &Vector2<f32>) -> Self {
        // As `Line::moved` turns it.
        let ([nx, ny], [tx, ty]) = (line.normal, line.tangent());
        let quarter = 0.25 * (state.y * state.y);
        let rate = 1.0 / (1.0 + quarter);
        let (cos, sin) = ((1.0 - quarter) * rate, state.y * rate);
        let [ux, uy] = [cos * nx + sin * tx, cos * ny + sin * ty];
        Self {
            line,
            offset_m: state.x,
            normal: [ux, uy],
            tangent: [-uy, ux],
            rate,
            rate_slope: -0.5 * (state.y * (rate * rate)),
        }
    }

    /// Image of a point, its slopes over offset and rotation, and its curvatures over both and over rotation twice.
    fn reflect(&self, point_m: &Vector2<f32>) -> (Vector2<f32>, Matrix2<f32>, [Vector2<f32>; 2]) {
        let ([ux, uy], [tx, ty]) = (self.normal, self.tangent);
        let [cx, cy] = self.line.centre_m;
        let (dx, dy) = (point_m.x - cx, point_m.y - cy);
        let s = ux * dx + uy * dy - self.offset_m;
        let q = tx * dx + ty * dy;
        let position_m = Vector2::new(point_m.x - 2.0 * s * ux, point_m.y - 2.0 * s * uy);
        let turn = [-2.0 * (q * ux + s * tx), -2.0 * (q * uy + s * ty)];
        let [turn_x, turn_y] = turn;
        let slope = Matrix2::new(2.0 * ux, self.rate * turn_x, 2.0 * uy, self.rate * turn_y);
        let along_u = 2.0 * (2.0 * s + self.offset_m);
        let along_t = -4.0 * q;
        let squared = self.rate * self.rate;
        let twice = Vector2::new(
            squared * (along_u * ux + along_t * tx) + self.rate_slope * turn_x,
            squared * (along_u * uy + along_t * ty) + self.rate_slope * turn_y,
        );
        let common = Vector2::new(2.0 * self.rate * tx, 2.0 * self.rate * ty);
        (position_m, slope, [common, twice])
    }

    /// R v.
    fn mirrored(&self, v: &Vector2<f32>) -> Vector2<f32> {
        let [ux, uy] = self.normal;
        let twice = 2.0 * (ux * v.x + uy * v.y);
        Vector2::new(v.x - twice * ux, v.y - twice * uy)
    }

    /// R S.
    fn turned(&self, slope: &Matrix2<f32>) -> Matrix2<f32> {
        let first = self.mirrored(&Vector2::new(slope.m11, slope.m21));
        let second = self.mirrored(&Vector2::new(slope.m12, slope.m22));
        Matrix2::new(first.x, second.x, first.y, second.y)
    }

    /// dR / d rotation S.
    fn turning(&self, slope: &Matrix2<f32>) -> Matrix2<f32> {
        let ([ux, uy], [tx, ty]) = (self.normal, self.tangent);
        let of = |x: f32, y: f32| {
            let (along_u, along_t) = (ux * x + uy * y, tx * x + ty * y);
            let scale = -2.0 * self.rate;
            Vector2::new(scale * (tx * along_u + ux * along_t), scale * (ty * along_u + uy * along_t))
        };
        let (first, second) = (of(slope.m11, slope.m21), of(slope.m12, slope.m22));
        Matrix2::new(first.x, second.x, first.y, second.y)
    }
}

stored!(blank Sequence { first, second, is_either_order });

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    const WALLS: [Line; 2] = [
        Line { centre_m: [3.0, 4.0], normal: [0.6, 0.8] },
        Line { centre_m: [-2.0, 5.0], normal: [-0.28, 0.96] },
    ];
    const ANCHOR_M: [f32; 2] = [1.0, -0.5];
    const STATES: [[f32; 2]; 2] = [[0.2, -0.1], [-0.3, 0.15]];

    /// Mirrors a point in f64, wall after wall, from line, offset and angle.
    fn image(states: &[[f64; 2]]) -> [f64; 2] {
        let mut point = ANCHOR_M.map(f64::from);
        for (line, [offset_m, rotation]) in WALLS.iter().zip(states) {
            let theta = 2.0 * (0.5 * rotation).atan();
            let [nx, ny] = line.normal.map(f64::from);
            let u = [nx * theta.cos() - ny * theta.sin(), ny * theta.cos() + nx * theta.sin()];
            let c = line.centre_m.map(f64::from);
            let s = u[0] * (point[0] - c[0]) + u[1] * (point[1] - c[1]) - offset_m;
            point = [point[0] - 2.0 * s * u[0], point[1] - 2.0 * s * u[1]];
        }
        point
    }

    fn ours(order: usize) -> Image {
        let state = |n: usize| Vector2::new(STATES[n][0], STATES[n][1]);
        let first = Image::first(ANCHOR_M, &Surface::Wall(WALLS[0]), &state(0));
        if order == 1 { first } else { first.second(&Surface::Wall(WALLS[1]), &state(1)) }
    }

    fn at(order: usize, changes: &[(usize, usize, f64)]) -> [f64; 2] {
        let mut states = STATES.map(|state| state.map(f64::from));
        for &(wall, number, change) in changes {
            states[wall][number] += change;
        }
        image(&states[..order])
    }

    #[test]
    fn images_are_mirror_images() {
        for order in [1, 2] {
            let (image, exact) = (ours(order), at(order, &[]));
            assert!((f64::from(image.position_m.x) - exact[0]).abs() < 1e-5, "{order}");
            assert!((f64::from(image.position_m.y) - exact[1]).abs() < 1e-5, "{order}");
        }
        let line = WALLS[0].moved(STATES[0][0], STATES[0][1]);
        let [x, y] = line.mirrored_m(ANCHOR_M);
        let away = Vector2::new(x, y) - ours(1).position_m;
        assert!(away.x.hypot(away.y) < 1e-5);
        assert!(line.distance_m(line.centre_m).abs() < 1e-6);
        // The middle between a point and its image is on the line, and the way there is along the normal.
        let middle = [0.5 * (x + ANCHOR_M[0]), 0.5 * (y + ANCHOR_M[1])];
        assert!(line.distance_m(middle).abs() < 1e-5);
        assert!((line.place_m(ANCHOR_M) - line.place_m([x, y])).abs() < 1e-5);
    }

    #[test]
    fn slopes_are_the_finite_differences() {
        let step = 1e-5;
        for order in [1, 2] {
            let image = ours(order);
            for wall in 0..order {
                for number in 0..2 {
                    let [ahead, back] = [step, -step].map(|change| at(order, &[(wall, number, change)]));
                    for axis in 0..2 {
                        let slope = (ahead[axis] - back[axis]) / (2.0 * step);
                        let own = f64::from(image.slopes[wall][(axis, number)]);
                        assert!((own - slope).abs() < 1e-4, "{order} {wall} {number} {axis}: {own} {slope}");
                    }
                }
            }
        }
    }

    /// Half the sum of all second derivatives by the covariances, from finite differences.
    #[test]
    fn the_shift_is_that_of_the_second_derivatives() {
        let own = [Matrix2::new(0.04, 0.003, 0.003, 0.01), Matrix2::new(0.09, -0.01, -0.01, 0.02)];
        let cross = Matrix2::new(0.01, 0.002, -0.003, 0.004);
        let covariance = |a: (usize, usize), b: (usize, usize)| -> f64 {
            f64::from(match (a.0, b.0) {
                (0, 1) => cross[(a.1, b.1)],
                (1, 0) => cross[(b.1, a.1)],
                (wall, _) => own[wall][(a.1, b.1)],
            })
        };
        let step = 1e-4;
        for order in [1, 2] {
            let numbers: Vec<(usize, usize)> = (0..order).flat_map(|wall| [(wall, 0), (wall, 1)]).collect();
            let mut expected = [0.0; 2];
            for &a in &numbers {
                for &b in &numbers {
                    let value = |x: f64, y: f64| at(order, &[(a.0, a.1, x * step), (b.0, b.1, y * step)]);
                    let values = [value(1.0, 1.0), value(1.0, -1.0), value(-1.0, 1.0), value(-1.0, -1.0)];
                    for (axis, expected) in expected.iter_mut().enumerate() {
                        let [pp, pm, mp, mm] = values.map(|value| value[axis]);
                        *expected += 0.5 * covariance(a, b) * (pp - pm - mp + mm) / (4.0 * step * step);
                    }
                }
            }
            let given = if order == 1 { [own[0], NOTHING] } else { own };
            let cross = if order == 1 { NOTHING } else { cross };
            let shift = ours(order).shift_m(&given, &cross);
            for (axis, expected) in expected.iter().enumerate() {
                assert!(
                    (f64::from(shift[axis]) - expected).abs() < 1e-4,
                    "{order} {axis} {shift} {expected}"
                );
            }
        }
    }

    #[test]
    fn a_private_surface_is_its_image() {
        let image = Image::first(ANCHOR_M, &Surface::Private, &Vector2::new(7.0, -3.0));
        assert_eq!(image.position_m, Vector2::new(7.0, -3.0));
        assert_eq!(image.slopes, [Matrix2::identity(), NOTHING]);
        let own = [Matrix2::new(1.0, 0.5, 0.5, 1.0), NOTHING];
        assert_eq!(image.shift_m(&own, &NOTHING), NOWHERE);
    }

    #[test]
    fn a_sequence_is_its_surfaces_in_order() {
        let two = Sequence { first: 4, second: Some(7), is_either_order: true };
        assert_eq!(two.surfaces().collect::<Vec<_>>(), [4, 7]);
        assert_eq!(two.reversed().surfaces().collect::<Vec<_>>(), [7, 4]);
        assert!(two.has(7) && !two.has(5) && two.order() == 2);
        assert_eq!(Sequence::of(3).reversed(), Sequence::of(3));
        let facing = Sequence { is_either_order: false, ..two };
        assert!(two.is_same(&two.reversed()) && facing.is_same(&two.reversed()) && facing.is_same(&facing));
        assert!(!facing.is_same(&facing.reversed()) && !two.is_same(&Sequence::of(4)));
    }
}
