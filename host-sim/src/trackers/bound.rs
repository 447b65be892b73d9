//! Bounds.
use super::CycleScans;
use crate::recording::Recording;
use crate::replay::Setup;

/// What the frames allow: per cycle the least rms position error, metres.
pub fn frames(_recording: &Recording, _setup: &Setup, _cycles: &[CycleScans]) -> Vec<f64> {
    Vec::new()
}

/// The same from the paths that were detected.
pub fn detected(_recording: &Recording, _setup: &Setup, _cycles: &[CycleScans]) -> Vec<f64> {
    Vec::new()
}

/// Whether a run can be answered.
pub fn answerable(_detected_m: &[f64]) -> bool {
    false
}
