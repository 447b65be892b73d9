//! `cogmint experiment survival`: how much interference each controller survives.

use super::super::progress_of;
use super::carriers::Carriers;
use super::controllers::all;
use super::{print, print_json};
use crate::Failure;
use clap::builder::PossibleValuesParser;
use cogmint::demo;
use cogmint::experiment::controllers::Controller;
use cogmint::experiment::survival::figures::{Figures, Level, Row};
use cogmint::experiment::survival::{Sweep, survive};
use cogmint::scenario::Scenario;

/// Controllers that are compared where nothing else is asked for.
const USUAL: [Controller; 3] = [Controller::Fixed, Controller::Greedy, Controller::Cognitive];

#[derive(clap::Args)]
pub struct Options {
    /// A built-in scenario's name, or a scenario file.
    #[arg(long, default_value = "seminar-room")]
    scenario: String,
    /// Runs per controller and level; each takes the next of the scenario's trajectories.
    #[arg(long, default_value_t = 30, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    runs: u32,
    /// Seed of the first run; the others count on.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Controllers beside the fixed carrier, separated by commas; without, fixed, greedy and cognitive.
    #[arg(long, value_delimiter = ',', value_name = "NAME", value_parser = names())]
    only: Vec<String>,
    /// Carriers to choose from, in place of the scenario's.
    #[arg(long, value_enum)]
    library: Option<Carriers>,
    /// The main job's interferer (2 GHz wide at 7 GHz, from 0.35 to 0.75 of the way) begins so weak that it leaves the
    /// paths in use this median SINR on the first way, dB.
    #[arg(long, value_name = "DB", default_value_t = -1.0, allow_negative_numbers = true)]
    weakest: f64,
    /// Power from level to level, dB.
    #[arg(long, value_name = "DB", default_value_t = 1.0, value_parser = step)]
    step: f64,
    /// Levels to stride over while they are survived.
    #[arg(long, value_name = "LEVELS", default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=100))]
    stride: u32,
    /// The strongest power to try, dB over the weakest.
    #[arg(long, value_name = "DB", default_value_t = 40.0, value_parser = strongest)]
    strongest: f64,
    /// Print one JSON object instead of a table.
    #[arg(long)]
    json: bool,
}

fn step(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(step_db) if (0.01..=30.0).contains(&step_db) => Ok(step_db),
        _ => Err("must be a number from 0.01 to 30".into()),
    }
}

fn strongest(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(power_db) if (0.0..=100.0).contains(&power_db) => Ok(power_db),
        _ => Err("must be a number from 0 to 100".into()),
    }
}

fn names() -> PossibleValuesParser {
    PossibleValuesParser::new(all().filter(|one| *one != Controller::Genie).map(Controller::name))
}

pub fn run(options: &Options) -> Result<(), Failure> {
    let (mut scenario, folder) = Scenario::find(&options.scenario)?;
    if let Some(library) = options.library {
        scenario.radio.library = Some(library.library());
    }
    let controllers: Vec<Controller> = if options.only.is_empty() {
        USUAL.into()
    } else {
        all().filter(|one| options.only.iter().any(|name| name == one.name())).collect()
    };
    let sweep = Sweep {
        weakest: demo::interferer(options.weakest),
        step_db: options.step,
        stride: options.stride as usize,
        strongest: (options.strongest / options.step).round() as usize,
        controllers,
        runs: options.runs as usize,
        seed: options.seed,
    };
    let bar = progress_of(sweep.rounds(), "interfering", "rounds at most");
    let figures = survive(&scenario, folder.as_deref(), &sweep, || bar.inc(1))?;
    bar.finish_and_clear();
    if options.json {
        return print_json(&figures);
    }
    print_figures(&figures);
    Ok(())
}

fn print_figures(figures: &Figures) {
    let [from, to] = figures.judged_cycles;
    print(&format!(
        "{}: {} runs, cycles {from} to {to}; survived: 90 % of all errors below {} m\n\
         Power over that of the weakest level, whose Omega_1 is {:.1} dB over a direct path of 1 m\n",
        figures.scenario, figures.runs, figures.limit_m, figures.weakest_omega_1_db
    ));
    print("90 % of all errors, mean over the runs of each run's, metres; runs that lost the tag");
    let head: String = figures.controllers.iter().map(|row| format!(" {:>18}", row.name)).collect();
    print(&format!("{:>8} {:>9}{head}", "power dB", "SINR dB"));
    let mut powers: Vec<(f64, Option<f64>)> = figures
        .controllers
        .iter()
        .flat_map(|row| row.levels.iter().map(|level| (level.power_db, level.median_sinr_db)))
        .collect();
    powers.sort_by(|a, b| a.0.total_cmp(&b.0));
    powers.dedup_by_key(|(power_db, _)| *power_db);
    for (power_db, sinr_db) in powers {
        let at = |row: &Row| cell(row.levels.iter().find(|level| level.power_db == power_db));
        let cells: String = figures.controllers.iter().map(at).collect();
        print(format!("{power_db:>8.1} {:>9}{cells}", decibels(sinr_db)).trim_end());
    }
    print("");
    print(&format!(
        "{:<16} {:>11} {:>9} {:>13} {:>16}",
        "controller", "survived dB", "SINR dB", "failed at dB", "beyond fixed dB"
    ));
    for row in &figures.controllers {
        print(&format!(
            "{:<16} {:>11} {:>9} {:>13} {:>16}",
            row.name,
            survived(row),
            decibels(row.survived_median_sinr_db),
            decibels(row.first_failed_db),
            beyond(row)
        ));
    }
}

fn cell(level: Option<&Level>) -> String {
    level.map_or_else(
        || " ".repeat(19),
        |level| format!(" {:>6.3} {:>6.3} {:>4}", level.p90_m, level.p90_mean_m, level.diverged.len()),
    )
}

fn survived(row: &Row) -> String {
    match (row.survived_db, row.first_failed_db) {
        (None, _) => "none".into(),
        (Some(all), None) => format!("all, {all:.1}"),
        (Some(power_db), Some(_)) => format!("{power_db:.2}"),
    }
}

fn beyond(row: &Row) -> String {
    match (row.beyond_fixed_db, row.beyond_fixed_error_db) {
        (Some(beyond_db), Some(error_db)) => format!("{beyond_db:.2} +- {error_db:.2}"),
        (Some(beyond_db), None) => format!("{beyond_db:.2}"),
        (None, _) => "-".into(),
    }
}

fn decibels(value: Option<f64>) -> String {
    value.map_or_else(|| "-".into(), |value| format!("{value:.1}"))
}
