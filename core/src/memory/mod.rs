//! The memories: which surfaces and images there are, with the candidates for new ones, what walls let through, and how well
//! each source is heard on each carrier.

pub mod channel;
pub mod clutter;
pub mod discovery;
pub mod environment;
pub mod transmission;
