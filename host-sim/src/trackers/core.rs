//! `cogmint` itself, and `direct`: the same without any reflection.

use super::Estimate;
use crate::input_error::InputError;
use crate::recording::Recording;
use crate::replay::{LARGE_ANCHORS, SMALL_ANCHORS, Setup, inputs, step};
use std::path::Path;

/// Runs the core over a recording; `file` is named in messages. Pass [`Setup::without_reflections`] for `direct`.
///
/// # Errors
/// The core refuses the set-up, or the recording's time cannot be followed.
pub fn run(setup: &Setup, recording: &Recording, file: &Path) -> Result<Vec<Estimate>, InputError> {
    if setup.anchors.len() <= SMALL_ANCHORS {
        run_sized::<SMALL_ANCHORS>(setup, recording, file)
    } else {
        run_sized::<LARGE_ANCHORS>(setup, recording, file)
    }
}

fn run_sized<const A: usize>(
    setup: &Setup,
    recording: &Recording,
    file: &Path,
) -> Result<Vec<Estimate>, InputError> {
    let mut tracker = setup.tracker::<A>().map_err(|error| InputError::new(file, error.to_string()))?;
    let cycle = |(index, input)| {
        let step = step(&mut tracker, &input, &mut ())
            .map_err(|error| InputError::new(file, format!("cycle {index}: {error}")))?;
        let covariance = &step.report.position_covariance_m2;
        Ok(Estimate {
            position_m: step.report.position_m.map(f64::from),
            covariance_m2: [covariance.m11, covariance.m21, covariance.m22].map(f64::from),
            probability: Some(f64::from(step.report.probability)),
            searching: step.report.searching || step.report.lost,
            seconds: step.seconds,
        })
    };
    inputs(recording).enumerate().map(cycle).collect()
}
