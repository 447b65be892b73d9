//! `told`.
use super::{CycleScans, Estimate};
use crate::recording::Recording;
use crate::replay::Setup;

/// Runs the filter over the scans of a recording.
pub fn run(_recording: &Recording, _setup: &Setup, _cycles: &[CycleScans]) -> Vec<Estimate> {
    Vec::new()
}
