//! The floor plan: walls as lines with segments on them, and an outline.
//!
//! A wall's line runs through the middle of its extent along its first segment; its normal is that direction turned left.

use super::real::{Real, exp, larger, limited, smaller, sqrt, square};
use super::surface::{Line, dot, less};
use cogmint_core::model::detection::LOGISTIC;
use cogmint_core::model::plan::OUTLINE_STD_M;
use cogmint_core::{Plan, PlanWall};

/// A wall.
#[derive(Clone, Debug)]
pub struct Wall<T> {
    /// Its line.
    pub line: Line<T>,
    /// Half its extent, metres.
    pub half_length_m: T,
    /// Begin and end of its segments along the tangent, from the centre, metres.
    pub segments_m: Vec<[T; 2]>,
    /// On which side of each of them alone the outline's inside is: 1 on the normal's, -1 on the other; else 0.
    pub inside: Vec<T>,
    /// How far it may be from there.
    pub told: PlanWall,
    /// Its slot in the state filter, where a source is reflected by it.
    pub surface: Option<usize>,
}

/// The plan; all empty where none is told.
#[derive(Clone, Debug)]
pub struct FloorPlan<T> {
    /// The walls.
    pub walls: Vec<Wall<T>>,
    /// Corners of the outline, metres.
    pub outline_m: Vec<[T; 2]>,
}

impl<T: Real> FloorPlan<T> {
    /// As told; the core accepts it.
    pub fn new(plan: &Plan<'_>) -> Self {
        let mut walls = Vec::new();
        for index in 0..plan.walls.len() {
            let own = plan.segments.iter().filter(|segment| segment.wall == index);
            let segments: Vec<[[T; 2]; 2]> =
                own.map(|segment| segment.ends_m.map(|end_m| end_m.map(T::of))).collect();
            walls.push(wall(&segments, plan.walls[index]));
        }
        let outline_m = plan.outline_m.iter().map(|corner_m| corner_m.map(T::of)).collect();
        let mut kept = Self { walls, outline_m };
        for index in 0..kept.walls.len() {
            let segments = kept.walls[index].segments_m.clone();
            kept.walls[index].inside =
                segments.iter().map(|&[begin, end]| kept.side(index, T::of(0.5) * (begin + end))).collect();
        }
        kept
    }

    /// Index of the wall whose slot in the state filter this is.
    pub fn wall_of(&self, surface: usize) -> Option<usize> {
        self.walls.iter().position(|wall| wall.surface == Some(surface))
    }

    /// Lower left and upper right corner of the outline; without one of the walls, metres; none where there is neither.
    pub fn box_m(&self) -> Option<[[T; 2]; 2]> {
        let mut corners = self.outline_m.clone();
        if corners.is_empty() {
            for Wall { line, half_length_m, .. } in &self.walls {
                let ([x, y], [tx, ty]) = (line.centre_m, line.tangent());
                let (dx, dy) = (*half_length_m * tx, *half_length_m * ty);
                corners.push([x - dx, y - dy]);
                corners.push([x + dx, y + dy]);
            }
        }
        let (mut low, mut high) = (*corners.first()?, *corners.first()?);
        for corner in &corners {
            for axis in 0..2 {
                low[axis] = smaller(low[axis], corner[axis]);
                high[axis] = larger(high[axis], corner[axis]);
            }
        }
        Some([low, high])
    }

    /// The middle of that box, metres.
    pub fn middle_m(&self) -> Option<[T; 2]> {
        let [low, high] = self.box_m()?;
        Some([T::of(0.5) * (low[0] + high[0]), T::of(0.5) * (low[1] + high[1])])
    }

    /// Whether a point is in the outline; everywhere is, where there is none.
    /// Probability that a point known within `std_m` per axis is inside the outline; 1 without one.
    pub fn inside(&self, point_m: [T; 2], std_m: T) -> T {
        let corners = &self.outline_m;
        if corners.is_empty() {
            return T::ONE;
        }
        // The distance from the nearest side, squared.
        let mut nearest = T::of(f32::INFINITY);
        for (n, a) in corners.iter().enumerate() {
            let b = corners[(n + 1) % corners.len()];
            let side = less(b, *a);
            let from = less(point_m, *a);
            let length2 = larger(square(side[0]) + square(side[1]), T::of(f32::MIN_POSITIVE));
            let share = limited(dot(from, side) / length2, T::ZERO, T::ONE);
            let off = [0, 1].map(|axis| point_m[axis] - (a[axis] + share * side[axis]));
            nearest = smaller(nearest, square(off[0]) + square(off[1]));
        }
        let distance = sqrt(nearest);
        let depth = if self.is_inside(point_m) { distance } else { -distance };
        let deviation = sqrt(square(std_m) + square(T::of(OUTLINE_STD_M)));
        T::ONE / (T::ONE + exp(-T::of(LOGISTIC) * (depth / deviation)))
    }

    /// The side of a wall's line, at a place along it, that alone is inside the outline: 0.1 m before it or behind it.
    fn side(&self, wall: usize, place_m: T) -> T {
        let line = &self.walls[wall].line;
        let (centre, normal, tangent) = (line.centre_m, line.normal, line.tangent());
        let is_inside = |off: T| {
            self.is_inside([0, 1].map(|axis| centre[axis] + place_m * tangent[axis] + off * normal[axis]))
        };
        let count = |off| if is_inside(off) { T::ONE } else { T::ZERO };
        count(T::of(0.1)) - count(-T::of(0.1))
    }

    /// Whether a point is inside the outline.
    pub fn is_inside(&self, point_m: [T; 2]) -> bool {
        let corners = &self.outline_m;
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
}

/// The wall that these segments make.
fn wall<T: Real>(segments: &[[[T; 2]; 2]], told: PlanWall) -> Wall<T> {
    let [from, to] = segments[0];
    let way = less(to, from);
    let length = sqrt(square(way[0]) + square(way[1]));
    let tangent = [way[0] / length, way[1] / length];
    let (mut begin, mut end) = (T::ZERO, length);
    for point in segments.iter().flatten() {
        let place = dot(tangent, less(*point, from));
        begin = smaller(begin, place);
        end = larger(end, place);
    }
    let middle = T::of(0.5) * (begin + end);
    let line = Line {
        centre_m: [from[0] + middle * tangent[0], from[1] + middle * tangent[1]],
        normal: [-tangent[1], tangent[0]],
    };
    let mut segments_m = Vec::new();
    for ends in segments {
        let [a, b] = ends.map(|end| line.place_m(end));
        segments_m.push([smaller(a, b), larger(a, b)]);
    }
    Wall { line, half_length_m: T::of(0.5) * (end - begin), segments_m, inside: vec![], told, surface: None }
}
