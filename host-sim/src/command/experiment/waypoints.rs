//! `cogmint experiment waypoints`: what choosing waypoints is worth.

use super::super::{metres, progress_of};
use super::{print, print_json};
use crate::Failure;
use cogmint::experiment::waypoints::figures::Figures;
use cogmint::experiment::waypoints::{Chooser, compare};
use cogmint::scenario::Scenario;

#[derive(clap::Args)]
pub struct Options {
    /// A built-in scenario's name, or a scenario file.
    #[arg(long, default_value = "l-shaped-office")]
    scenario: String,
    /// Runs per chooser, each with a start and a goal of its own.
    #[arg(long, default_value_t = 20, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    runs: u32,
    /// Seed of the first run; the others count on.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// What the informed chooser gives for one nat less of expected entropy on each metre of the way: metres of detour.
    #[arg(long, default_value_t = 1.0, value_name = "M", value_parser = metres_per_nat)]
    metres_per_nat: f64,
    /// Print one JSON object instead of a table.
    #[arg(long)]
    json: bool,
}

fn metres_per_nat(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| "is no number".to_owned())?;
    if (0.0..=1e6).contains(&value) { Ok(value) } else { Err("must be 0 to 1e6".into()) }
}

pub fn run(options: &Options) -> Result<(), Failure> {
    let (scenario, folder) = Scenario::find(&options.scenario)?;
    let bar = progress_of(options.runs as usize * Chooser::ALL.len(), "walking", "walks");
    let figures =
        compare(&scenario, folder.as_deref(), options.metres_per_nat, options.runs, options.seed, || {
            bar.inc(1)
        })?;
    bar.finish_and_clear();
    if options.json {
        return print_json(&figures);
    }
    print_figures(&figures);
    Ok(())
}

fn print_figures(figures: &Figures) {
    print(&format!(
        "{}: {} runs, goals {:.2} m away in the mean, {} m per nat; gains over the straight walk\n",
        figures.scenario, figures.runs, figures.straight_m, figures.metres_per_nat
    ));
    print(&format!(
        "{:<10} {:>8} {:>18} {:>8} {:>9} {:>16} {:>8} {:>9} {:>9}",
        "chooser", "RMSE m", "gain m", "90 % m", "bound nat", "gain nat", "path m", "arrivals", "diverged"
    ));
    for row in &figures.choosers {
        print(&format!(
            "{:<10} {:>8} {:>8.4} +- {:<6.4} {:>8} {:>9.3} {:>7.3} +- {:<5.3} {:>8.2} {:>9} {:>9}",
            row.name,
            metres(Some(row.rmse_m)),
            row.rmse_gain_m,
            row.rmse_gain_error_m,
            metres(Some(row.p90_m)),
            row.entropy_nat,
            row.entropy_gain_nat,
            row.entropy_gain_error_nat,
            row.path_m,
            format!("{}/{}", row.arrivals, row.runs),
            row.diverged.len(),
        ));
    }
}
