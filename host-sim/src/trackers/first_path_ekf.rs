//! `ekf`.
use super::{CycleScans, Estimate};
use crate::replay::Setup;

/// Runs the filter over the scans of a recording.
pub fn run(_setup: &Setup, _cycles: &[CycleScans]) -> Vec<Estimate> {
    Vec::new()
}
