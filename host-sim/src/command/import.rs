//! `cogmint import`: data of others become recordings.

use super::print;
use crate::Failure;
use cogmint::import::{self, MiluvOptions};
use cogmint::recording::Recording;
use std::path::{Path, PathBuf};

#[derive(clap::Subcommand)]
pub enum Source {
    /// Ranges of the belief-propagation SLAM reference scenario (three CSV files).
    BpSlam {
        /// Anchors and virtual anchors.
        #[arg(long, value_name = "FILE")]
        anchors: PathBuf,
        /// The true trajectory.
        #[arg(long, value_name = "FILE")]
        truth: PathBuf,
        /// The ranges.
        #[arg(long, value_name = "FILE")]
        ranges: PathBuf,
        /// Folder of the recording to write.
        #[arg(long, value_name = "DIR")]
        out: PathBuf,
    },
    /// A flight of the MILUV data set: DWM1000 ranges and channel impulse responses.
    Miluv {
        /// The flight's NPZ file.
        file: PathBuf,
        /// Folder of the recording to write.
        #[arg(long, value_name = "DIR")]
        out: PathBuf,
        /// Leave the tag's height out: ranges are then taken as horizontal.
        #[arg(long)]
        without_heights: bool,
        /// Samples from the radio's first-path index to the pulse's peak.
        #[arg(long, default_value_t = MiluvOptions::default().pulse_peak_samples)]
        pulse_peak_samples: f64,
    },
    /// Static links of the Warsaw flat: one recording per link.
    Warsaw {
        /// Folder with cir.npz, links.csv and walls.csv.
        folder: PathBuf,
        /// Folder to write the links' recordings into.
        #[arg(long, value_name = "DIR")]
        out: PathBuf,
    },
}

pub fn run(source: &Source) -> Result<(), Failure> {
    match source {
        Source::BpSlam { anchors, truth, ranges, out } => {
            write(&import::bp_slam(anchors, truth, ranges)?, out)
        }
        Source::Miluv { file, out, without_heights, pulse_peak_samples } => {
            let options = MiluvOptions { heights: !without_heights, pulse_peak_samples: *pulse_peak_samples };
            let imported = import::miluv(file, options)?;
            for note in &imported.notes {
                print(note);
            }
            write(&imported.recording, out)
        }
        Source::Warsaw { folder, out } => {
            let links = import::warsaw(folder)?;
            // All or none: nothing is written when one could not be.
            for (name, _) in &links {
                Recording::may_replace(out.join(name))?;
            }
            for (name, recording) in links {
                write(&recording, &out.join(name))?;
            }
            Ok(())
        }
    }
}

fn write(recording: &Recording, out: &Path) -> Result<(), Failure> {
    recording.write(out)?;
    let frames: usize = recording.cycles.iter().map(|cycle| cycle.frames.len()).sum();
    let ranges: usize = recording.cycles.iter().map(|cycle| cycle.ranges.len()).sum();
    print(&format!(
        "{}: {} cycles, {} anchors, {ranges} ranges, {frames} frames",
        out.display(),
        recording.cycles.len(),
        recording.anchors.len()
    ));
    Ok(())
}
