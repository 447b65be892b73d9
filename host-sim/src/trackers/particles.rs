//! `particles`.
use super::{CycleScans, Estimate};
use crate::recording::Recording;
use crate::replay::Setup;

/// The usual number of particles.
pub const PARTICLES: usize = 20_000;

/// Runs `count` particles over the scans of a recording.
pub fn run(
    _recording: &Recording,
    _setup: &Setup,
    _cycles: &[CycleScans],
    _count: usize,
    _seed: u64,
) -> Vec<Estimate> {
    Vec::new()
}
