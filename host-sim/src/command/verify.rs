//! TEMP
use super::{print, print_json, progress, recording_or_room};
use crate::Failure;
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

pub fn run(options: &Options) -> Result<(), Failure> { let _ = options; todo!() }
