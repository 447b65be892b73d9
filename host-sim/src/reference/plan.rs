//! The floor plan told.

use super::real::{Real, larger, smaller, sqrt, square};
use super::surface::Line;
use cogmint_core::{Plan, PlanWall};

/// A wall: all of its segments are on one line.
#[derive(Clone, Copy, Debug)]
pub struct Wall<T> {
    /// Its line, about the middle of its extent.
    pub line: Line<T>,
    /// Half the extent, metres.
    pub half_length_m: T,
    /// How far it may be from there.
    pub told: PlanWall,
    /// Its slot in the state filter, where a source is reflected by it.
    pub surface: Option<usize>,
}

/// A part of a wall's line.
#[derive(Clone, Copy, Debug)]
pub struct Segment<T> {
    /// Index of its wall.
    pub wall: usize,
    /// Where it begins and ends along the tangent from the centre, metres.
    pub extent_m: [T; 2],
}

/// The plan; all empty where none is told.
#[derive(Clone, Debug)]
pub struct FloorPlan<T> {
    /// The walls.
    pub walls: Vec<Wall<T>>,
    /// Their segments.
    pub segments: Vec<Segment<T>>,
    /// Corners of the outline, metres.
    pub outline_m: Vec<[T; 2]>,
}

impl<T: Real> FloorPlan<T> {
    /// As told.
    pub fn new(plan: &Plan<'_>) -> Self {
        let mut walls = Vec::new();
        for index in 0..plan.walls.len() {
            let own = plan.segments.iter().filter(|segment| segment.wall == index);
            let ends: Vec<[T; 2]> =
                own.flat_map(|segment| segment.ends_m).map(|end| end.map(T::of)).collect();
            walls.push(wall(&ends, plan.walls[index]));
        }
        let mut segments = Vec::new();
        for segment in plan.segments {
            let line = walls[segment.wall].line;
            let [a, b] = segment.ends_m.map(|end| line.place_m(end.map(T::of)));
            segments.push(Segment { wall: segment.wall, extent_m: [smaller(a, b), larger(a, b)] });
        }
        let outline_m = plan.outline_m.iter().map(|corner| corner.map(T::of)).collect();
        Self { walls, segments, outline_m }
    }

    /// Index of the wall whose slot in the state filter this is.
    pub fn wall_of(&self, surface: usize) -> Option<usize> {
        self.walls.iter().position(|wall| wall.surface == Some(surface))
    }

    /// The middle of the outline's box; without an outline, of that of the walls' centres, metres.
    pub fn middle_m(&self) -> [T; 2] {
        let mut points = self.outline_m.clone();
        if points.is_empty() {
            points = self.walls.iter().map(|wall| wall.line.centre_m).collect();
        }
        let mut middle = [T::ZERO; 2];
        for axis in 0..2 {
            let (mut low, mut high) = (points[0][axis], points[0][axis]);
            for point in &points {
                low = smaller(low, point[axis]);
                high = larger(high, point[axis]);
            }
            middle[axis] = T::of(0.5) * (low + high);
        }
        middle
    }
}

/// The wall that segments with these ends make; the first one gives its direction.
fn wall<T: Real>(ends: &[[T; 2]], told: PlanWall) -> Wall<T> {
    let (a, b) = (ends[0], ends[1]);
    let d = [b[0] - a[0], b[1] - a[1]];
    let length_m = sqrt(square(d[0]) + square(d[1]));
    let t = [d[0] / length_m, d[1] / length_m];
    let (mut from_m, mut to_m) = (T::ZERO, length_m);
    for end in ends {
        let place_m = t[0] * (end[0] - a[0]) + t[1] * (end[1] - a[1]);
        (from_m, to_m) = (smaller(from_m, place_m), larger(to_m, place_m));
    }
    let middle_m = T::of(0.5) * (from_m + to_m);
    let line = Line { centre_m: [a[0] + middle_m * t[0], a[1] + middle_m * t[1]], normal: [-t[1], t[0]] };
    Wall { line, half_length_m: T::of(0.5) * (to_m - from_m), told, surface: None }
}
