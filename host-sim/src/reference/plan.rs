//! The floor plan: walls as lines with segments on them, and an outline.
//!
//! A wall's line runs through the middle of its extent along its first segment; its normal is that direction turned left.

use super::real::{Real, larger, limited, smaller, sqrt, square};
use cogmint_core::model::plan::{Plan, PlanWall};

/// A wall.
#[derive(Clone, Debug)]
pub struct Wall<T> {
    /// The middle of its extent, metres.
    pub centre_m: [T; 2],
    /// Unit normal.
    pub normal: [T; 2],
    /// Half its extent, metres.
    pub half_length_m: T,
    /// Begin and end of its segments along the tangent, from the centre, metres.
    pub segments_m: Vec<[T; 2]>,
    /// How far it may be from there.
    pub told: PlanWall,
}

impl<T: Real> Wall<T> {
    /// The normal turned left.
    pub fn tangent(&self) -> [T; 2] {
        [-self.normal[1], self.normal[0]]
    }

    /// How far a point is from the line, on the normal's side, metres.
    pub fn distance_m(&self, point_m: [T; 2]) -> T {
        dot(self.normal, less(point_m, self.centre_m))
    }

    /// Where a point is along the line, metres.
    pub fn place_m(&self, point_m: [T; 2]) -> T {
        dot(self.tangent(), less(point_m, self.centre_m))
    }

    /// The mirror image of a point, metres.
    pub fn mirrored_m(&self, point_m: [T; 2]) -> [T; 2] {
        let twice = T::of(2.0) * self.distance_m(point_m);
        [point_m[0] - twice * self.normal[0], point_m[1] - twice * self.normal[1]]
    }
}

/// The scalar product.
pub fn dot<T: Real>(a: [T; 2], b: [T; 2]) -> T {
    a[0] * b[0] + a[1] * b[1]
}

/// a - b.
pub fn less<T: Real>(a: [T; 2], b: [T; 2]) -> [T; 2] {
    [a[0] - b[0], a[1] - b[1]]
}

/// The walls of a plan that the core accepts.
pub fn walls<T: Real>(plan: &Plan<'_>) -> Vec<Wall<T>> {
    let num = T::of;
    let mut walls = Vec::new();
    for index in 0..plan.walls.len() {
        let mut ends: Vec<[[T; 2]; 2]> = Vec::new();
        for segment in plan.segments {
            if segment.wall == index {
                ends.push(segment.ends_m.map(|end_m| end_m.map(num)));
            }
        }
        let [from, to] = ends[0];
        let way = less(to, from);
        let length = sqrt(square(way[0]) + square(way[1]));
        let tangent = [way[0] / length, way[1] / length];
        let (mut begin, mut end) = (T::ZERO, length);
        for [a, b] in &ends {
            for point in [a, b] {
                let place = dot(tangent, less(*point, from));
                begin = smaller(begin, place);
                end = larger(end, place);
            }
        }
        let middle = num(0.5) * (begin + end);
        let mut wall = Wall {
            centre_m: [from[0] + middle * tangent[0], from[1] + middle * tangent[1]],
            normal: [-tangent[1], tangent[0]],
            half_length_m: num(0.5) * (end - begin),
            segments_m: Vec::new(),
            told: plan.walls[index],
        };
        for [a, b] in ends {
            let (a, b) = (wall.place_m(a), wall.place_m(b));
            wall.segments_m.push([smaller(a, b), larger(a, b)]);
        }
        walls.push(wall);
    }
    walls
}

/// Whether a point is in the outline; everywhere is, where there is none.
pub fn is_inside<T: Real>(plan: &Plan<'_>, point_m: [T; 2]) -> bool {
    let corners: Vec<[T; 2]> = plan.outline_m.iter().map(|corner_m| corner_m.map(T::of)).collect();
    let [x, y] = point_m;
    // On the outline its distance is a zero, which counts as inside whatever its sign.
    let (mut is_inside, mut nearest) = (corners.is_empty(), T::ONE);
    for n in 0..corners.len() {
        let ([ax, ay], [bx, by]) = (corners[n], corners[(n + 1) % corners.len()]);
        if (ay > y) != (by > y) && x < (bx - ax) * ((y - ay) / (by - ay)) + ax {
            is_inside = !is_inside;
        }
        let side = [bx - ax, by - ay];
        let length2 = larger(square(side[0]) + square(side[1]), T::of(f32::MIN_POSITIVE));
        let share = limited(dot([x - ax, y - ay], side) / length2, T::ZERO, T::ONE);
        let away = [x - (ax + share * side[0]), y - (ay + share * side[1])];
        nearest = smaller(nearest, square(away[0]) + square(away[1]));
    }
    is_inside || nearest == T::ZERO
}
