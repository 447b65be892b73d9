//! Scores: how good a track and its map are, and whether the filter knew how good.

pub mod assignment;
pub mod consistency;
pub mod map;
pub mod position;
pub mod walls;

pub use position::Score;
