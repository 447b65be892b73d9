//! `cogmint experiment`: Monte Carlo experiments.

mod carriers;
mod controllers;
mod rooms;
mod survival;
mod trackers;
mod tracking;
mod walls;
mod waypoints;

use super::{print, print_json};
use crate::Failure;
use clap::builder::PossibleValuesParser;
use cogmint::experiment::baseline::program::Program;
use cogmint::experiment::baseline::{NAMES, method};
use cogmint::experiment::eight_paths::eight_paths;
use cogmint::experiment::estimator::{Core, CoreMagnitude, Quality, measure};
use cogmint::recording::Recording;
use std::path::PathBuf;

#[derive(clap::Subcommand)]
pub enum Experiment {
    /// The channel estimator: precision, resolution, false paths, detection, against the bound.
    Estimator(EstimatorOptions),
    /// Writes frames of eight known paths in dense multipath as a recording, for `cogmint estimate` and the target.
    EightPaths(EightPathsOptions),
    /// The whole tracker over named scenarios, or over a recording from many starts.
    Tracking(tracking::Options),
    /// What choosing the carrier is worth: the core's controller beside others, in a scenario.
    Controllers(controllers::Options),
    /// What choosing waypoints is worth: the core's application layer beside a straight walk and a random one.
    Waypoints(waypoints::Options),
    /// The walls that grow on a map without a plan, against those that could be seen.
    Walls(walls::Options),
    /// Trackers side by side in random rooms that nobody tuned for.
    Rooms(rooms::Options),
    /// Trackers side by side over recordings.
    Trackers(trackers::Options),
    /// How much interference each controller survives, in a scenario.
    Survival(survival::Options),
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
    #[arg(long, conflicts_with_all = ["against", "against_program"])]
    magnitude: bool,
    /// Known methods to measure on the same responses, separated by commas; `-local`: level taken around every sample.
    #[arg(long, value_delimiter = ',', value_name = "METHOD", value_parser = method_names())]
    against: Vec<String>,
    /// A line-spectral method in a program of its own, asked on its standard input (docs/channel-estimator.md).
    #[arg(long, value_name = "FILE")]
    against_program: Option<PathBuf>,
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

/// The core's quality, and that of the others where there are any.
#[derive(serde::Serialize)]
struct Answer {
    #[serde(flatten)]
    quality: Quality,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    against: Vec<Quality>,
}

/// Stands for every method.
const ALL: &str = "all";

fn method_names() -> PossibleValuesParser {
    PossibleValuesParser::new([ALL].into_iter().chain(NAMES))
}

pub fn run(experiment: &Experiment) -> Result<(), Failure> {
    match experiment {
        Experiment::Estimator(options) => estimator(options),
        Experiment::Tracking(options) => tracking::run(options),
        Experiment::Controllers(options) => controllers::run(options),
        Experiment::Waypoints(options) => waypoints::run(options),
        Experiment::Walls(options) => walls::run(options),
        Experiment::Rooms(options) => rooms::run(options),
        Experiment::Trackers(options) => trackers::run(options),
        Experiment::Survival(options) => survival::run(options),
        Experiment::EightPaths(options) => {
            Recording::may_replace(&options.out)?;
            Ok(eight_paths(options.frames as usize, options.seed).write(&options.out)?)
        }
    }
}

fn estimator(options: &EstimatorOptions) -> Result<(), Failure> {
    let (trials, seed) = (options.trials as usize, options.seed);
    // Started first: one that is not there should not be noticed after minutes.
    let program = options.against_program.as_deref().map(Program::start).transpose()?;
    let quality =
        if options.magnitude { measure(&CoreMagnitude, trials, seed) } else { measure(&Core, trials, seed) };
    let asked = |name: &&str| options.against.iter().any(|asked| asked == ALL || asked == name);
    let methods = NAMES.iter().copied().filter(asked).filter_map(method);
    let mut against: Vec<Quality> = methods.map(|method| measure(&*method, trials, seed)).collect();
    if let Some(program) = &program {
        let quality = measure(program, trials, seed);
        if let Some(reason) = program.failure() {
            return Err(Failure::Work(reason));
        }
        against.push(quality);
    }
    if options.json {
        return print_json(&Answer { quality, against });
    }
    print(&format!(
        "Channel estimator ({}), T_p 0.5 ns, roll-off 0.6, 400 samples over 100 ns, {} responses per figure\n",
        quality.method, quality.trials
    ));
    print_quality(&quality, options.magnitude);
    if !against.is_empty() {
        print("");
        print_comparison(&quality, &against);
    }
    Ok(())
}

/// A figure of the table: its name, that of its column in a comparison (none: it has no column), its value for a method,
/// and what it must be.
type Figure = (&'static str, Option<&'static str>, fn(&Quality) -> String, &'static str);

const FIGURES: [Figure; 16] = [
    (
        "delay RMSE over its bound, worst of 12 to 30 dB",
        Some("RMSE"),
        |quality| format!("{:.3}", quality.delay_rmse_over_crlb),
        "1.2",
    ),
    (
        "two equal paths of 25 dB, 0.5 T_p apart, both found",
        Some("0.5 T_p"),
        |quality| percent(quality.resolved_0_5_tp),
        "55 %",
    ),
    ("the same, 0.7 T_p apart", Some("0.7 T_p"), |quality| percent(quality.resolved_0_7_tp), "85 %"),
    ("the same, 1.0 T_p apart", Some("1.0 T_p"), |quality| percent(quality.resolved_1_0_tp), "99 %"),
    ("the same, 1.5 T_p apart", None, |quality| percent(quality.resolved_1_5_tp), ""),
    ("the same, 2 T_p apart", None, |quality| percent(quality.resolved_2_0_tp), ""),
    ("the same, 3 T_p apart", None, |quality| percent(quality.resolved_3_0_tp), ""),
    (
        "false paths in dense multipath, 0.01 asked for",
        Some("false .01"),
        |quality| format!("{:.4}", quality.false_paths_at_0_01),
        "0.005 to 0.02",
    ),
    (
        "false paths in dense multipath, 0.1 asked for",
        None,
        |quality| format!("{:.3}", quality.false_paths_at_0_1),
        "",
    ),
    (
        "false paths in dense multipath, 1 asked for",
        Some("false 1"),
        |quality| format!("{:.3}", quality.false_paths_at_1),
        "0.5 to 2",
    ),
    (
        "seven paths: the one of 12.6 dB detected",
        Some("12.6 dB"),
        |quality| percent(quality.detected_12_6_db),
        "75 %",
    ),
    (
        "seven paths: the one of 8.2 dB detected",
        Some("8.2 dB"),
        |quality| percent(quality.detected_8_2_db),
        "8 %",
    ),
    ("seven paths: false paths", Some("false 7"), |quality| format!("{:.4}", quality.seven_false_paths), ""),
    (
        "median SINR error, 5 to 30 dB",
        Some("SINR"),
        |quality| format!("{:.2} dB", quality.sinr_median_error_db),
        "1 dB",
    ),
    (
        "false paths under interference from elsewhere",
        Some("interf."),
        |quality| format!("{:.4}", quality.interference_false_paths),
        "0.03",
    ),
    ("responses per second", Some("per s"), |quality| format!("{:.0}", quality.frames_per_second), ""),
];

fn percent(share: f64) -> String {
    if share.is_finite() { format!("{:.1} %", 100.0 * share) } else { "-".into() }
}

/// What complex frames must reach; of magnitudes nothing was asked.
fn print_quality(quality: &Quality, magnitude: bool) {
    let head = format!("{:<54} {:>10}   {}", "figure", "measured", if magnitude { "" } else { "must be" });
    print(head.trim_end());
    for (figure, _, measured, must) in FIGURES {
        let must = if magnitude { "" } else { must };
        print(format!("{figure:<54} {:>10}   {must}", measured(quality)).trim_end());
    }
}

/// One row per method.
fn print_comparison(quality: &Quality, against: &[Quality]) {
    let row = |name: &str, cells: &mut dyn Iterator<Item = String>| {
        let cells: String = cells.map(|cell| format!(" {cell:>9}")).collect();
        print(&format!("{name:<20}{cells}"));
    };
    print("The same figures of every method:");
    row("method", &mut FIGURES.iter().filter_map(|(_, column, ..)| column.map(str::to_owned)));
    for quality in std::iter::once(quality).chain(against) {
        let cell = |(_, column, measured, _): &Figure| column.map(|_| measured(quality));
        row(&quality.method, &mut FIGURES.iter().filter_map(cell));
    }
}
