//! `cogmint verify`: the core against the float reference.

use super::{print, print_json, progress, recording_or_room};
use crate::Failure;
use cogmint::verify::verify;
use std::path::PathBuf;

#[derive(clap::Args)]
pub struct Options {
    /// A recording's folder; the seminar room where none is given.
    #[arg(long, value_name = "DIR")]
    recording: Option<PathBuf>,
    /// Cycles to compare: all of a recording, 200 of the seminar room where not given.
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..))]
    cycles: Option<u32>,
    /// Seed of the seminar room, of the start within the recording's prior and of the tracker.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

/// Cycles of the seminar room.
const ROOM_CYCLES: usize = 200;

pub fn run(options: &Options) -> Result<(), Failure> {
    let wanted = options.cycles.map(|cycles| cycles as usize);
    let room_cycles = wanted.unwrap_or(ROOM_CYCLES);
    let (recording, file) = recording_or_room(options.recording.as_deref(), options.seed, room_cycles)?;
    let length = wanted.unwrap_or(usize::MAX).min(recording.cycles.len());
    let bar = progress(length, "verifying");
    let outcome =
        verify(&recording, &file, Some(options.seed), wanted, |cycle| bar.set_position(cycle as u64))?;
    bar.finish_and_clear();
    if options.json {
        print_json(&outcome)?;
    } else {
        print(&format!(
            "{}: {} cycles, {} numbers compared bit for bit: {}",
            recording.name,
            outcome.cycles,
            outcome.compared,
            if outcome.equal { "all equal" } else { "NOT equal" }
        ));
        print(&format!(
            "against the reference in f64: position apart by {:.2e} m rms, {:.2e} m at most",
            outcome.f64_position_error_rms_m, outcome.f64_position_error_max_m
        ));
        if let Some(difference) = &outcome.f64_first_decision_difference {
            print(&format!(
                "first decision that rounding tipped: cycle {}, {}; before it {:.2e} m at most",
                difference.cycle, difference.decision, outcome.f64_position_error_before_max_m
            ));
        }
    }
    if outcome.not_finite > 0 {
        return Err(Failure::Work(format!("{} of the core's numbers are not finite", outcome.not_finite)));
    }
    match outcome.first_difference {
        None => Ok(()),
        Some(difference) => Err(Failure::Work(difference.to_string())),
    }
}
