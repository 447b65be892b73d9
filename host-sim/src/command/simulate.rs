//! `cogmint simulate`: a scenario becomes a recording.

use super::{print, print_json, progress};
use crate::Failure;
use cogmint::channel;
use cogmint::input_error::InputError;
use cogmint::recording::{MAX_FRAMES, Recording};
use cogmint::scenario::Scenario;
use cogmint::simulator::Simulator;
use serde::Serialize;
use std::path::PathBuf;

#[derive(clap::Args)]
pub struct Options {
    /// A built-in scenario's name, or a scenario file.
    scenario: String,
    /// The recording's folder: new, empty, or an older recording, which is replaced.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Seed of everything random; without, the scenario's own.
    #[arg(long)]
    seed: Option<u64>,
    /// Which of the scenario's trajectories, counted from 0.
    #[arg(long, value_name = "K", default_value_t = 0)]
    trajectory: usize,
    /// Stop after this many cycles.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    cycles: Option<u32>,
    /// Print one JSON object instead of a sentence.
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Outcome<'a> {
    scenario: &'a str,
    trajectory: usize,
    seed: u64,
    cycles: usize,
    frames: usize,
    lost_frames: usize,
    virtual_anchors: usize,
    known_virtual_anchors: usize,
    interference_omega_1_db: Vec<f64>,
    seconds: f64,
    frames_per_second: f64,
    out: &'a PathBuf,
}

/// Bytes that a recording's arrays may unpack to, as its reader insists.
const MAX_BYTES: usize = 1 << 30;

pub fn run(options: &Options) -> Result<(), Failure> {
    let (scenario, folder) = Scenario::find(&options.scenario)?;
    // What cannot be written is better refused before the work.
    Recording::may_replace(&options.out)?;
    let way = channel::poses(&scenario, folder.as_deref(), options.trajectory)?;
    let cycles = way.len().min(options.cycles.map_or(usize::MAX, |cycles| cycles as usize));
    let anchors = scenario.anchors.len();
    let per_frame = 8 * scenario.radio.samples();
    if cycles * anchors > MAX_FRAMES.min(MAX_BYTES / per_frame) {
        let most = MAX_FRAMES.min(MAX_BYTES / per_frame) / anchors;
        let reason = format!("has {cycles} cycles of {anchors} anchors, more than one recording holds");
        return Err(InputError::new(&options.scenario, reason)
            .allowed(format!("--cycles up to {most}"))
            .into());
    }
    let simulator = Simulator::new(&scenario, folder.as_deref(), options.trajectory, options.seed)?;
    let bar = progress(cycles, "simulating");
    let begin = std::time::Instant::now();
    let recording = simulator.record(cycles, || bar.inc(1));
    let seconds = begin.elapsed().as_secs_f64();
    bar.finish_and_clear();
    recording.write(&options.out)?;
    let frames: usize = recording.cycles.iter().map(|cycle| cycle.frames.len()).sum();
    let known = recording.virtual_anchors.iter().filter(|va| va.known).count();
    let omega_1_db: Vec<f64> =
        simulator.channel().interference_omega_1().iter().map(|omega| 10.0 * omega.log10()).collect();
    if options.json {
        return print_json(&Outcome {
            scenario: &scenario.name,
            trajectory: options.trajectory,
            seed: simulator.channel().seed(),
            cycles,
            frames,
            lost_frames: cycles * anchors - frames,
            virtual_anchors: recording.virtual_anchors.len(),
            known_virtual_anchors: known,
            interference_omega_1_db: omega_1_db,
            seconds,
            frames_per_second: (cycles * anchors) as f64 / seconds,
            out: &options.out,
        });
    }
    print(&format!(
        "{}: {cycles} cycles, {frames} frames of {anchors} anchors ({} lost), {} virtual anchors ({known} known); \
         {:.0} frames per second. Written to {}.",
        recording.name,
        cycles * anchors - frames,
        recording.virtual_anchors.len(),
        (cycles * anchors) as f64 / seconds,
        options.out.display()
    ));
    for (index, db) in omega_1_db.iter().enumerate() {
        print(&format!("interference {index}: Omega_1 is {db:.1} dB over a direct path of 1 m at 7 GHz"));
    }
    Ok(())
}
