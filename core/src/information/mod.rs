//! What a measurement tells about the position: Fisher information, and the entropy that feeds back to the
//! controller.

pub mod entropy;
pub mod fisher;
