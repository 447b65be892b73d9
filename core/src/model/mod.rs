//! The model that all stages share: anchors and sources, what is observed of them, how the tag moves, how a range depends on
//! both, and what a range does to a Gaussian state.

pub mod anchor;
pub mod availability;
pub mod channel;
pub mod clock;
pub mod detection;
pub mod image;
pub mod lateness;
pub mod listing;
pub mod matrix;
pub mod measurement;
pub mod motion;
pub mod observation;
pub mod plan;
pub mod range;
pub mod region;
pub mod soft_update;
pub mod source;
pub mod surface;
pub mod transceiver;
pub mod work;
