//! What scenarios and recordings look like: tables and pictures for people.

pub mod carriers;
pub mod channel;
pub mod estimate;
pub mod room;

/// A power ratio in decibels.
fn decibel(ratio: f64) -> f64 {
    10.0 * libm::log10(ratio)
}
