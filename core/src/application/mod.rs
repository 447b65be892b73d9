//! The application layer, optional: where to go next.
//!
//! It is fed by the memories alone (environment, channel, state filter) and changes none of them: a tag that is carried
//! by something that can be steered asks [`crate::Tracker::choose_waypoint`] when it is about to move, others never do.

pub mod waypoint;
