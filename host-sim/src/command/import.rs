//! `cogmint import`: data of others become recordings.

use super::print;
use crate::Failure;
use cogmint::import::{self, MiluvOptions, SnapshotOptions};
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
    /// A flight of the MILUV data set: DWM1000 ranges and channel impulse responses; one recording per tag.
    Miluv {
        /// The flight's NPZ file.
        file: PathBuf,
        /// Folder to write the recordings into: DIR/tag-10 and so on.
        #[arg(long, value_name = "DIR")]
        out: PathBuf,
        /// One recording per drone instead, its tags as antennas of one body: DIR/drone-1 and so on.
        #[arg(long)]
        bodies: bool,
        /// Leave the tag's height out: ranges are then taken as horizontal.
        #[arg(long)]
        without_heights: bool,
        /// Samples from the radio's first-path index to the pulse's peak.
        #[arg(long, default_value_t = MiluvOptions::default().pulse_peak_samples)]
        pulse_peak_samples: f64,
    },
    /// Paths measured place by place from one base station (two CSV files), one second per place.
    Snapshot {
        /// The places: place, x_m, y_m.
        #[arg(long, value_name = "FILE")]
        places: PathBuf,
        /// The paths: place, range_m, departure_angle_rad, arrival_angle_rad.
        #[arg(long, value_name = "FILE")]
        paths: PathBuf,
        /// Where the base station is, metres.
        #[arg(long, value_name = "X,Y", value_parser = position, allow_hyphen_values = true)]
        anchor: [f64; 2],
        /// A virtual anchor that the tracker is told, with a deviation of 0.3 m; may be given many times.
        #[arg(long, value_name = "X,Y", value_parser = position, allow_hyphen_values = true)]
        map: Vec<[f64; 2]>,
        /// Seed of the told start, which is drawn within 0.2 m of the first place.
        #[arg(long, default_value_t = 1)]
        seed: u64,
        /// Folder of the recording to write.
        #[arg(long, value_name = "DIR")]
        out: PathBuf,
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
        Source::Miluv { file, out, bodies, without_heights, pulse_peak_samples } => {
            let options = MiluvOptions {
                bodies: *bodies,
                heights: !without_heights,
                pulse_peak_samples: *pulse_peak_samples,
            };
            let imported = import::miluv(file, options)?;
            for note in &imported.notes {
                print(note);
            }
            write_all(&imported.recordings, out)
        }
        Source::Snapshot { places, paths, anchor, map, seed, out } => {
            let options = SnapshotOptions { anchor_m: *anchor, map_m: map.clone(), seed: *seed };
            write(&import::snapshot(places, paths, &options)?, out)
        }
        Source::Warsaw { folder, out } => write_all(&import::warsaw(folder)?, out),
    }
}

/// A position on the command line.
fn position(text: &str) -> Result<[f64; 2], String> {
    let (x, y) = text.split_once(',').ok_or("is not two numbers with a comma between")?;
    let coordinate = |text: &str| match text.trim().parse::<f64>() {
        Ok(value) if value.abs() <= 1e6 => Ok(value),
        _ => Err(format!("{text:?} is not a number of metres from -1e6 to 1e6")),
    };
    Ok([coordinate(x)?, coordinate(y)?])
}

/// Writes several recordings, each into its folder in `out`: all or none, as far as that can be told before.
fn write_all(recordings: &[(String, Recording)], out: &Path) -> Result<(), Failure> {
    for (name, _) in recordings {
        Recording::may_replace(out.join(name))?;
    }
    for (name, recording) in recordings {
        write(recording, &out.join(name))?;
    }
    Ok(())
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
