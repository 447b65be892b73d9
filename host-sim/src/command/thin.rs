//! `cogmint thin`: less of a recording.

use super::print;
use crate::Failure;
use cogmint::recording::Recording;
use cogmint::thin::Thinning;
use std::path::PathBuf;

#[derive(clap::Args)]
#[command(group(clap::ArgGroup::new("what").required(true).multiple(true)))]
pub struct Options {
    /// The recording's folder.
    recording: PathBuf,
    /// Folder of the recording to write.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Keep a cycle only this long after the last one kept, seconds.
    #[arg(long, value_name = "T", value_parser = seconds, group = "what")]
    every_s: Option<f64>,
    /// Keep at most so many ranges of a cycle, and the frames of their anchors; anchors take turns.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..), group = "what")]
    ranges_per_cycle: Option<u32>,
}

pub fn run(options: &Options) -> Result<(), Failure> {
    let Options { recording, out, every_s, ranges_per_cycle } = options;
    let whole = Recording::read(recording)?;
    let ranges_per_cycle = ranges_per_cycle.map(|most| most as usize);
    let thinned = Thinning { every_s: *every_s, ranges_per_cycle }.of(&whole);
    thinned.write(out)?;
    let ranges =
        |recording: &Recording| recording.cycles.iter().map(|cycle| cycle.ranges.len()).sum::<usize>();
    let frames =
        |recording: &Recording| recording.cycles.iter().map(|cycle| cycle.frames.len()).sum::<usize>();
    print(&format!(
        "{}: {} of {} cycles, {} of {} ranges, {} of {} frames",
        out.display(),
        thinned.cycles.len(),
        whole.cycles.len(),
        ranges(&thinned),
        ranges(&whole),
        frames(&thinned),
        frames(&whole)
    ));
    Ok(())
}

fn seconds(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value > 0.0 && value <= 1e6 => Ok(value),
        _ => Err("is not a time above 0 and up to 1e6 s".into()),
    }
}
