//! Surfaces that reflect: walls, which may be shifted and turned, and images whose wall nobody knows.

use super::real::{Real, square};

/// A line by a point on it and its unit normal n; its tangent t is n turned left.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Line<T> {
    /// A point on it, metres.
    pub centre_m: [T; 2],
    /// n.
    pub normal: [T; 2],
}

impl<T: Real> Line<T> {
    /// t.
    pub fn tangent(&self) -> [T; 2] {
        [-self.normal[1], self.normal[0]]
    }

    /// n . (x - c), metres.
    pub fn distance_m(&self, point_m: [T; 2]) -> T {
        dot(self.normal, less(point_m, self.centre_m))
    }

    /// t . (x - c), metres.
    pub fn place_m(&self, point_m: [T; 2]) -> T {
        dot(self.tangent(), less(point_m, self.centre_m))
    }

    /// x - 2 (n . (x - c)) n.
    pub fn mirrored_m(&self, point_m: [T; 2]) -> [T; 2] {
        let twice = T::of(2.0) * self.distance_m(point_m);
        [point_m[0] - twice * self.normal[0], point_m[1] - twice * self.normal[1]]
    }

    /// Shifted along its normal u after a turn about its centre by theta, `rotation` = 2 tan(theta / 2).
    pub fn moved(&self, offset_m: T, rotation: T) -> Self {
        let t = self.tangent();
        // Sine and cosine by half the angle's tangent. Order: times the inverse of 1 + tan^2.
        let tan2 = T::of(0.25) * square(rotation);
        let scale = T::ONE / (T::ONE + tan2);
        let (cos, sin) = ((T::ONE - tan2) * scale, rotation * scale);
        let u = [cos * self.normal[0] + sin * t[0], cos * self.normal[1] + sin * t[1]];
        Self { centre_m: [self.centre_m[0] + offset_m * u[0], self.centre_m[1] + offset_m * u[1]], normal: u }
    }
}

/// A surface; two numbers of the state belong to it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Surface<T> {
    /// A wall on this line, but for its two numbers: offset (metres) and rotation.
    Wall(Line<T>),
    /// The image of one anchor: its two numbers are its position (metres).
    Private,
    /// Which way the tag's body faces: its two numbers are a unit vector, drawn anew so often per second.
    Heading {
        /// Turns per second.
        turns_per_s: f32,
    },
}

/// The scalar product.
pub fn dot<T: Real>(a: [T; 2], b: [T; 2]) -> T {
    a[0] * b[0] + a[1] * b[1]
}

/// a - b.
pub fn less<T: Real>(a: [T; 2], b: [T; 2]) -> [T; 2] {
    [a[0] - b[0], a[1] - b[1]]
}
