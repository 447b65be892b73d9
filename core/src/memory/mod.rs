//! The memories: the map of virtual anchors, and how well each is heard on each carrier.

pub mod channel;
pub mod environment;
