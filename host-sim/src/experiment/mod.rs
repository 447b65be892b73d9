//! Monte Carlo experiments: what a stage of the system achieves, beside the bound that nothing can beat.

pub mod baseline;
pub mod eight_paths;
pub mod estimator;
pub mod response;
