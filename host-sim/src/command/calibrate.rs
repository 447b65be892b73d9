//! `cogmint calibrate`: antenna delays, anchors and pulse from recordings.

use super::{Format, check_writable, print, print_json, recordings_in};
use crate::Failure;
use cogmint::calibrate::file::Calibration;
use cogmint::calibrate::{Options as Asked, calibrate};
use cogmint::cycle_choice::CycleChoice;
use cogmint::recording::Recording;
use cogmint::track::way;
use cogmint::whole_file;
use std::path::PathBuf;

#[derive(clap::Args)]
pub struct Options {
    /// Folders of recordings of the same anchors, or of folders of them.
    #[arg(required = true, value_name = "DIR")]
    folders: Vec<PathBuf>,
    /// Write the calibration for `cogmint track --calibration`.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// The cycles to look at, counted from 0: odd, even, all, or FROM..TO without TO itself.
    #[arg(long, value_name = "CHOICE", default_value = "all")]
    cycles: CycleChoice,
    /// Estimate the way too, even where the truth is known.
    #[arg(long)]
    no_truth: bool,
    /// Standard deviation per axis of the anchors' positions as told, metres; 0: they are exact.
    #[arg(long, value_name = "M", default_value_t = 0.0, value_parser = metres_up_to_100)]
    anchor_std_m: f64,
    /// Standard deviation of range biases beforehand, metres; without, the recording's (0.3 where it tells none).
    #[arg(long, value_name = "M", value_parser = metres_above_0)]
    bias_std_m: Option<f64>,
    /// How it is printed.
    #[arg(long, value_enum, default_value_t = Format::Table)]
    format: Format,
    /// Print one JSON object.
    #[arg(long, conflicts_with = "format")]
    json: bool,
}

fn metres_up_to_100(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if (0.0..=100.0).contains(&value) => Ok(value),
        _ => Err("allowed is 0 to 100 m".into()),
    }
}

fn metres_above_0(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value > 0.0 && value <= 100.0 => Ok(value),
        _ => Err("allowed is above 0 to 100 m".into()),
    }
}

pub fn run(options: &Options) -> Result<(), Failure> {
    options.out.as_deref().map(check_writable).transpose()?;
    let mut sources = Vec::new();
    for folder in recordings_in(&options.folders)? {
        sources.push((Recording::read(&folder)?, folder));
    }
    let asked = Asked {
        cycles: options.cycles,
        uses_truth: !options.no_truth,
        anchor_std_m: options.anchor_std_m,
        bias_std_m: options.bias_std_m,
    };
    let calibration = calibrate(&sources, &asked, &way)?;
    let toml = calibration.to_toml().map_err(|error| Failure::Work(error.to_string()))?;
    if let Some(to) = &options.out {
        whole_file::write(to, |file| file.write_all(toml.as_bytes()))?;
    }
    if options.json {
        return print_json(&calibration);
    }
    match options.format {
        Format::Table => print_table(&calibration),
        Format::Toml => print(toml.trim_end()),
        Format::Rust => print(calibration.to_rust().trim_end()),
    }
    if let (Some(to), Format::Table) = (&options.out, options.format) {
        print(&format!("\nCalibration: {}", to.display()));
    }
    Ok(())
}

fn print_table(calibration: &Calibration) {
    let Calibration { recordings, cycles, errors, anchors, antennas, pulse, unknown, .. } = calibration;
    print(&format!(
        "{}: {} ranges, cycles: {cycles}, {}",
        recordings.join(", "),
        errors.ranges,
        if calibration.with_truth { "with the truth" } else { "the way estimated with it" }
    ));
    print(
        "\n                              range bias, m    with excess, m  deviations, m     excess     position, m",
    );
    print(
        "anchor               ranges   mean      std     mean    std    noise   all         share        x     std        y     std",
    );
    for anchor in anchors {
        let ([x, y], [sx, sy]) = (anchor.position_m, anchor.position_std_m);
        print(&format!(
            "{:<20} {:>6} {:>7.3} {:>7.3} {:>8.3} {:>6.3} {:>7.3} {:>6.3} {:>12.1} % {:>9.3} {:>6.3} {:>9.3} {:>6.3}",
            anchor.name,
            anchor.ranges,
            anchor.range_bias_m,
            anchor.range_bias_std_m,
            anchor.mean_error_m,
            anchor.mean_error_std_m,
            anchor.noise_std_m,
            anchor.error_std_m,
            100.0 * anchor.excess_share,
            x,
            sx,
            y,
            sy
        ));
    }
    for antenna in antennas {
        print(&format!(
            "{}: its ranges are {:.3} m longer than the antennas' mean, deviation {:.3} m",
            antenna.name, antenna.difference_m, antenna.difference_std_m
        ));
    }
    print(&format!(
        "\nranges too long or false: {:.1} %; an excess is {:.3} m long on average; false: {:.2} %",
        100.0 * errors.suspicious_share,
        errors.excess_m,
        100.0 * errors.false_share
    ));
    if let Some(pulse) = pulse {
        print(&format!(
            "pulse, of {} frames: {:.2} times as long as told, deviation {:.2}; roll-off {:.2}, deviation {:.2}; \
             unexplained {:.1} %",
            pulse.frames,
            pulse.duration_factor,
            pulse.duration_factor_std,
            pulse.roll_off,
            pulse.roll_off_std,
            100.0 * pulse.unexplained_share
        ));
        if let Some((offset_m, std_m)) = pulse.peak_offset_m.zip(pulse.peak_offset_std_m) {
            print(&format!("its peak lies {offset_m:.3} m behind the radio's range, deviation {std_m:.3} m"));
        }
    }
    print("\nWhat cannot be known from this:");
    unknown.iter().for_each(|sentence| print(&format!("- {sentence}")));
}
