//! Surfaces: what reflects, and what of it is uncertain.
//!
//! A wall is known but for two numbers: by how much it is shifted along its normal, and by how much it is turned about its
//! centre. Where no wall is known, the image that is seen in it is uncertain itself: a private surface of one anchor.

use crate::snapshot::{Blank, Reader, Sink, SnapshotError, Stored, Written, written};

/// A line in the plane by a point on it and its unit normal.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Line {
    /// A point on it, metres.
    pub centre_m: [f32; 2],
    /// Unit normal.
    pub normal: [f32; 2],
}

impl Line {
    /// The unit vector along the line: the normal turned left.
    pub fn tangent(&self) -> [f32; 2] {
        let [x, y] = self.normal;
        [-y, x]
    }

    /// How far a point lies from the line, positive on the normal's side, metres.
    pub fn distance_m(&self, [x, y]: [f32; 2]) -> f32 {
        let ([cx, cy], [nx, ny]) = (self.centre_m, self.normal);
        nx * (x - cx) + ny * (y - cy)
    }

    /// Where a point lies along the line, from its centre along its tangent, metres.
    pub fn place_m(&self, [x, y]: [f32; 2]) -> f32 {
        let ([cx, cy], [tx, ty]) = (self.centre_m, self.tangent());
        tx * (x - cx) + ty * (y - cy)
    }

    /// The mirror image of a point, metres.
    pub fn mirrored_m(&self, point_m: [f32; 2]) -> [f32; 2] {
        let ([x, y], [nx, ny]) = (point_m, self.normal);
        let twice = 2.0 * self.distance_m(point_m);
        [x - twice * nx, y - twice * ny]
    }

    /// The line shifted and turned: the points x with u . (x - c) = offset, u the normal turned left by theta with
    /// rotation = 2 tan(theta / 2). That is theta but for a part in 12 / theta^2, and needs no sine.
    pub fn moved(&self, offset_m: f32, rotation: f32) -> Self {
        let ([cx, cy], [nx, ny], [tx, ty]) = (self.centre_m, self.normal, self.tangent());
        let quarter = 0.25 * (rotation * rotation);
        let scale = 1.0 / (1.0 + quarter);
        let (cos, sin) = ((1.0 - quarter) * scale, rotation * scale);
        let normal = [cos * nx + sin * tx, cos * ny + sin * ty];
        let [ux, uy] = normal;
        Self { centre_m: [cx + offset_m * ux, cy + offset_m * uy], normal }
    }
}

/// A surface that images are seen in; its two numbers are states of the filter.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
// None of them is 0, so that no surface is: a static tracker of zeros takes no flash.
#[repr(u8)]
pub enum Surface {
    /// A wall on this line but for an offset (metres) and a rotation (radians; see [`Line::moved`]), its two numbers.
    Wall(Line) = 1,
    /// One anchor's image alone: its position (metres) is the two numbers.
    Private = 2,
    /// No surface, but two numbers like those of one, that the antennas of a body have in common: the unit vector along its axis,
    /// which is drawn anew as often as this, per second. Of an antenna x ahead of the body's centre and y to its left, the place is
    /// linear in it.
    Heading {
        /// Turns per second.
        turns_per_s: f32,
    } = 3,
}

written!(Line { centre_m, normal });

impl Written for Surface {
    fn write(&self, to: &mut impl Sink) {
        // As long for every kind.
        // One after the other, not by a table: what flipped to no variant is written as one of them, and its seal is another.
        let (kind, numbers): (u8, [f32; 4]) =
            if let Self::Wall(Line { centre_m: [x, y], normal: [nx, ny] }) = self {
                (0, [*x, *y, *nx, *ny])
            } else if let Self::Heading { turns_per_s } = self {
                (2, [*turns_per_s, 0.0, 0.0, 0.0])
            } else {
                (1, [0.0; 4])
            };
        (kind, numbers).write(to);
    }
}

impl Stored for Surface {
    fn read(&mut self, from: &mut Reader<'_>) -> Result<(), SnapshotError> {
        let [kind] = from.take()?;
        let mut numbers = [0.0; 4];
        for number in &mut numbers {
            *number = f32::from_le_bytes(from.take()?);
        }
        let [x, y, nx, ny] = numbers;
        let surface = match kind {
            0 => Self::Wall(Line { centre_m: [x, y], normal: [nx, ny] }),
            1 => Self::Private,
            2 => Self::Heading { turns_per_s: x },
            _ => return Err(SnapshotError::Damaged),
        };
        if !from.is_trial() {
            *self = surface;
        }
        Ok(())
    }
}

impl Blank for Surface {
    fn blank() -> Self {
        Self::Private
    }
}
