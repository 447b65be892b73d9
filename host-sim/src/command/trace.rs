//! `cogmint trace`: the golden trace of a recording, and its feed for the target.

use super::{check_writable, print, print_json, recording_or_room};
use crate::Failure;
use cogmint::replay::Setup;
use cogmint::trace::{feed, trace, trace_on_target};
use cogmint::whole_file;
use serde::Serialize;
use std::path::PathBuf;

#[derive(clap::Args)]
pub struct Options {
    /// A recording's folder; the seminar room where none is given.
    #[arg(long, value_name = "DIR")]
    recording: Option<PathBuf>,
    /// Cycles to trace.
    #[arg(long, default_value_t = 60, value_parser = clap::value_parser!(u32).range(1..))]
    cycles: u32,
    /// Seed of the seminar room and of the tracker.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Trace in the tracker of the target, and write the feed that makes the firmware compute the same.
    #[arg(long, value_name = "FILE")]
    feed: Option<PathBuf>,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Outcome {
    cycles: usize,
    hashes: Vec<String>,
}

pub fn run(options: &Options) -> Result<(), Failure> {
    let cycles = options.cycles as usize;
    let (mut recording, file) = recording_or_room(options.recording.as_deref(), options.seed, cycles)?;
    options.feed.as_deref().map(check_writable).transpose()?;
    recording.cycles.truncate(cycles);
    let setup = Setup::new(&recording, &file, Some(options.seed))?;
    let steps = if let Some(to) = &options.feed {
        let steps = trace_on_target(&setup, &recording, &file)?;
        let bytes = feed(&setup, &recording, &file)?;
        whole_file::write_all(&[(to, &bytes)])?;
        steps
    } else {
        trace(&setup, &recording, &file)?
    };
    let hashes: Vec<String> = steps.iter().map(|step| format!("{:016x}", step.hash)).collect();
    if options.json {
        return print_json(&Outcome { cycles: hashes.len(), hashes });
    }
    for (cycle, hash) in hashes.iter().enumerate() {
        print(&format!("{cycle} {hash}"));
    }
    Ok(())
}
