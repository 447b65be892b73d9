//! Where paths run: walls, image sources, visibility, and the ways that tags take. All horizontal, in metres.

pub mod image_source;
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
