//! `cogmint` without a command: the seminar room under interference.

use super::{OUTPUT_FOLDER, metres, print, print_json, progress, write_picture};
use crate::Failure;
use cogmint::demo::{Carrier, LOWEST, Run, interfered, picture, run_with, seminar_room};
use cogmint::score::Score;
use serde::Serialize;
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
pub struct Options {
    /// Seed of the room's randomness and of the tracker.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Cycles; the tag moves 1 cm in each.
    #[arg(long, default_value_t = 1000, value_parser = clap::value_parser!(u32).range(10..=1000))]
    cycles: u32,
    /// Where the figure goes, without extension.
    #[arg(long, value_name = "PATH")]
    plot: Option<PathBuf>,
    /// Print one JSON object instead of a table.
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Row<'a> {
    name: &'a str,
    #[serde(flatten)]
    score: &'a Score,
    rmse_before_m: Option<f64>,
    rmse_interfered_m: Option<f64>,
    rmse_after_m: Option<f64>,
    carrier_switches: usize,
}

#[derive(Serialize)]
struct Outcome<'a> {
    room: &'a str,
    seed: u64,
    interfered_cycles: [usize; 2],
    reward: &'a str,
    runs: Vec<Row<'a>>,
    figure: [PathBuf; 2],
}

fn row<'a>(run: &'a Run, [from, to]: [usize; 2]) -> Row<'a> {
    let part = |from: usize, to: usize| Score::new(0, run.errors_m.get(from..to).unwrap_or(&[]), 0.0).rmse_m;
    let switches = run.steps.iter().filter(|step| step.report.next_action != step.report.action).count();
    Row {
        name: &run.name,
        score: &run.score,
        rmse_before_m: part(0, from),
        rmse_interfered_m: part(from, to),
        rmse_after_m: part(to, run.errors_m.len()),
        carrier_switches: switches,
    }
}

pub fn run(options: &Options) -> Result<(), Failure> {
    let room = seminar_room(options.seed, options.cycles as usize)?;
    let mut runs = Vec::new();
    for carrier in [Carrier::First, LOWEST, Carrier::Chosen] {
        let bar = progress(room.cycles(), "tracking");
        runs.push(run_with(&room, carrier, options.seed, || bar.inc(1))?);
        bar.finish_and_clear();
    }
    let to = options.plot.clone().unwrap_or_else(|| Path::new(OUTPUT_FOLDER).join("room"));
    let figure = write_picture(&picture(&room, &runs), &to)?;
    let interfered_cycles = interfered(&room);
    let rows: Vec<Row<'_>> = runs.iter().map(|run| row(run, interfered_cycles)).collect();
    if options.json {
        return print_json(&Outcome {
            room: "seminar-room",
            seed: options.seed,
            interfered_cycles,
            reward: "information gain",
            runs: rows,
            figure,
        });
    }
    let [from, to] = interfered_cycles;
    print(&format!(
        "Seminar room, two anchors, {} cycles of 1 cm; interferer 2 GHz wide at 7 GHz in cycles {from} to {to}.",
        options.cycles
    ));
    print(
        "\ncarrier           RMSE m   before   under   after    90 % m   max m  diverged  switches  us/cycle",
    );
    for row in &rows {
        print(&format!(
            "{:<15} {:>8} {:>8} {:>7} {:>7} {:>9} {:>7} {:>9} {:>9} {:>9.0}",
            row.name,
            metres(row.score.rmse_m),
            metres(row.rmse_before_m),
            metres(row.rmse_interfered_m),
            metres(row.rmse_after_m),
            metres(row.score.p90_m),
            metres(row.score.max_m),
            if row.score.diverged { "yes" } else { "no" },
            row.carrier_switches,
            row.score.us_per_cycle,
        ));
    }
    print(
        "\nOne interferer that stands still: a carrier out of its reach does as well, for whoever knows beforehand which\n\
         one that is. What choosing is worth beyond that: docs/controller.md.",
    );
    print(&format!("\nReward: information gain in nats. Figure: {}", figure[1].display()));
    Ok(())
}
