//! Monte Carlo experiments: what a stage of the system, or all of it, achieves beside the bound that nothing can beat.

pub mod baseline;
pub mod controllers;
pub mod eight_paths;
pub mod estimator;
mod over_runs;
pub mod response;
pub mod rooms;
pub mod side_by_side;
pub mod survival;
pub mod tracking;
pub mod walls;
pub mod waypoints;
