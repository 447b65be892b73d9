//! Where paths run: walls, image sources, visibility, and the ways that tags take. All horizontal, in metres.

pub mod image_source;
pub mod polygon;
pub mod trajectory;
pub mod visibility;

/// A thin straight wall that reflects on both sides.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wall {
    /// Its ends, metres.
    pub ends_m: [[f64; 2]; 2],
    /// Index of its construction.
    pub construction: usize,
}

/// Points nearer than this touch, metres.
const TOUCH_M: f64 = 1e-6;

impl Wall {
    /// From the first end to the second.
    fn direction_m(&self) -> [f64; 2] {
        sub(self.ends_m[1], self.ends_m[0])
    }

    /// Distance of `point_m` from the wall's plane, positive on the left seen from the first end; NaN for a wall
    /// without length.
    fn offset_m(&self, point_m: [f64; 2]) -> f64 {
        let along = self.direction_m();
        cross(along, sub(point_m, self.ends_m[0])) / length(along)
    }

    /// `point_m` mirrored in the wall's plane, which is `offset_m` away from it.
    fn mirror(&self, point_m: [f64; 2], offset_m: f64) -> [f64; 2] {
        let along = self.direction_m();
        let scale = 2.0 * offset_m / length(along);
        [point_m[0] + scale * along[1], point_m[1] - scale * along[0]]
    }
}

fn sub(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0] - b[0], a[1] - b[1]]
}

/// The point at share `t` of the way from `a` to `b`.
fn between(a: [f64; 2], b: [f64; 2], t: f64) -> [f64; 2] {
    [a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])]
}

fn dot(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

fn cross(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[1] - a[1] * b[0]
}

fn length(a: [f64; 2]) -> f64 {
    dot(a, a).sqrt()
}

/// Distance of two points, metres.
pub(crate) fn distance_m(a: [f64; 2], b: [f64; 2]) -> f64 {
    length(sub(a, b))
}

/// What the tests of the modules share.
#[cfg(test)]
mod shared {
    use super::Wall;

    pub(super) fn wall(a: [f64; 2], b: [f64; 2]) -> Wall {
        Wall { ends_m: [a, b], construction: 0 }
    }

    /// The sides of a polygon.
    pub(super) fn polygon(corners_m: &[[f64; 2]]) -> Vec<Wall> {
        (0..corners_m.len()).map(|n| wall(corners_m[n], corners_m[(n + 1) % corners_m.len()])).collect()
    }

    /// The seminar room of the published measurements, with its projecting wall at x = 4.32 m. The height of that
    /// corner, 6 m, is not published.
    pub(super) fn seminar_room() -> Vec<Wall> {
        polygon(&[[-0.306, 0.0], [5.775, 0.0], [5.775, 6.0], [4.32, 6.0], [4.32, 8.547], [-0.306, 8.547]])
    }

    /// A room of ten walls, two of them inside.
    pub(super) fn room_of_ten_walls() -> Vec<Wall> {
        let corners_m =
            [[0.0, 0.0], [9.0, 0.3], [9.4, 4.0], [6.0, 4.1], [6.2, 7.0], [3.0, 8.1], [2.8, 6.0], [-0.2, 6.3]];
        let mut walls = polygon(&corners_m);
        walls.push(wall([3.0, 0.1], [3.3, 2.0]));
        walls.push(wall([4.5, 3.0], [5.5, 4.5]));
        walls
    }
}
