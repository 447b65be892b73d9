//! `cogmint experiment`: Monte Carlo experiments.

use super::{print, print_json};
use crate::Failure;
use cogmint::experiment::eight_paths::eight_paths;
use cogmint::experiment::estimator::{Core, CoreMagnitude, measure};
use cogmint::recording::Recording;
use std::path::PathBuf;

#[derive(clap::Subcommand)]
pub enum Experiment {
    /// The channel estimator: precision, resolution, false paths, detection, against the bound.
    Estimator(EstimatorOptions),
    /// Writes frames of eight known paths in dense multipath as a recording, for `cogmint estimate` and the target.
    EightPaths(EightPathsOptions),
}

#[derive(clap::Args)]
pub struct EstimatorOptions {
    /// Responses per figure.
    #[arg(long, default_value_t = 2000, value_parser = clap::value_parser!(u32).range(10..=1_000_000))]
    trials: u32,
    /// Seed of all responses.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Give the estimator magnitudes without phase.
    #[arg(long)]
    magnitude: bool,
    /// Print one JSON object instead of a table.
    #[arg(long)]
    json: bool,
}

#[derive(clap::Args)]
pub struct EightPathsOptions {
    /// The recording's folder: new, empty, or an older recording, which is replaced.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Frames to write.
    #[arg(long, default_value_t = 60, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    frames: u32,
    /// Seed of all frames.
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

pub fn run(experiment: &Experiment) -> Result<(), Failure> {
    match experiment {
        Experiment::Estimator(options) => estimator(options),
        Experiment::EightPaths(options) => {
            Recording::may_replace(&options.out)?;
            Ok(eight_paths(options.frames as usize, options.seed).write(&options.out)?)
        }
    }
}

fn estimator(options: &EstimatorOptions) -> Result<(), Failure> {
    let trials = options.trials as usize;
    let quality = if options.magnitude {
        measure(&CoreMagnitude, trials, options.seed)
    } else {
        measure(&Core, trials, options.seed)
    };
    if options.json {
        return print_json(&quality);
    }
    print(&format!(
        "Channel estimator ({}), T_p 0.5 ns, roll-off 0.6, 400 samples over 100 ns, {} responses per figure\n",
        quality.method, quality.trials
    ));
    let percent = |share: f64| format!("{:.1} %", 100.0 * share);
    let rows = [
        (
            "delay RMSE over its bound, worst of 12 to 30 dB",
            format!("{:.3}", quality.delay_rmse_over_crlb),
            "1.2",
        ),
        ("two equal paths of 25 dB, 0.5 T_p apart, both found", percent(quality.resolved_0_5_tp), "55 %"),
        ("the same, 0.7 T_p apart", percent(quality.resolved_0_7_tp), "85 %"),
        ("the same, 1.0 T_p apart", percent(quality.resolved_1_0_tp), "99 %"),
        ("the same, 1.5 T_p apart", percent(quality.resolved_1_5_tp), "99 %"),
        ("the same, 2 T_p apart", percent(quality.resolved_2_0_tp), "99 %"),
        ("the same, 3 T_p apart", percent(quality.resolved_3_0_tp), "99 %"),
        (
            "false paths in dense multipath, 0.01 asked for",
            format!("{:.4}", quality.false_paths_at_0_01),
            "0.005 to 0.02",
        ),
        (
            "false paths in dense multipath, 0.1 asked for",
            format!("{:.3}", quality.false_paths_at_0_1),
            "0.05 to 0.2",
        ),
        (
            "false paths in dense multipath, 1 asked for",
            format!("{:.3}", quality.false_paths_at_1),
            "0.5 to 2",
        ),
        ("seven paths: the one of 12.6 dB detected", percent(quality.detected_12_6_db), "75 %"),
        ("seven paths: the one of 8.2 dB detected", percent(quality.detected_8_2_db), "8 %"),
        ("seven paths: false paths", format!("{:.4}", quality.seven_false_paths), ""),
        ("median SINR error, 5 to 30 dB", format!("{:.2} dB", quality.sinr_median_error_db), "1 dB"),
        (
            "false paths under interference from elsewhere",
            format!("{:.4}", quality.interference_false_paths),
            "0.03",
        ),
        ("responses per second", format!("{:.0}", quality.frames_per_second), ""),
    ];
    print(&format!("{:<54} {:>10}   must be", "figure", "measured"));
    for (figure, measured, must) in rows {
        // Without phase, paths within about a pulse of each other are one: nothing is asked for there.
        let unasked =
            options.magnitude && ["0.5 T_p", "0.7 T_p", "1.0 T_p"].iter().any(|near| figure.contains(near));
        let must = if unasked { "" } else { must };
        print(format!("{figure:<54} {measured:>10}   {must}").trim_end());
    }
    Ok(())
}
