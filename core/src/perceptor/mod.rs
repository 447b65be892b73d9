//! The perceptor: from raw samples to the state of tag and map.
//!
//! Data passes through the stages in this order, and each can be used alone: [`receiver`] refuses bad input and makes a
//! [`scan`] of every anchor's paths, which [`channel_estimator`] finds in frames and [`gain_control`] gives a unit;
//! [`expectation`] says what every source of a scan is expected to show, [`association`] which measurement belongs to which
//! source, [`below_threshold`] what the rest of a frame says of the others, [`belief`] where the tag is in the large, and
//! [`state_filter`] moves the estimate.

pub mod association;
pub mod belief;
pub mod below_threshold;
pub mod channel_estimator;
pub mod expectation;
pub mod gain_control;
pub mod receiver;
pub mod scan;
pub mod smoother;
pub mod state_filter;
