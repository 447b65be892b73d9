//! The memories: which surfaces and images there are, with the candidates for new ones, what walls let through, how well
//! each source is heard on each carrier, and how late ranges are.

pub mod channel;
pub mod clutter;
pub mod discovery;
pub mod environment;
pub mod lateness;
pub mod transmission;
