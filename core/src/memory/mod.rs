//! The memories: the map of virtual anchors with the candidates for new ones, and how well each is heard on each carrier.

pub mod channel;
pub mod clutter;
pub mod discovery;
pub mod environment;
