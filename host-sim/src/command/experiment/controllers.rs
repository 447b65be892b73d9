//! `cogmint experiment controllers`: what choosing the carrier is worth.

use super::super::{metres, progress_of};
use super::{percent, print, print_json};
use crate::Failure;
use clap::builder::PossibleValuesParser;
use cogmint::demo;
use cogmint::experiment::controllers::figures::Figures;
use cogmint::experiment::controllers::{ABLATIONS, Controller, compare};
use cogmint::scenario::{Library, NamedLibrary, Scenario};

#[derive(clap::Args)]
pub struct Options {
    /// A built-in scenario's name, or a scenario file.
    #[arg(long, default_value = "seminar-room")]
    scenario: String,
    /// Runs per controller; each takes the next of the scenario's trajectories.
    #[arg(long, default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    runs: u32,
    /// Seed of the first run; the others count on.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Controllers beside the fixed carrier and the genie, separated by commas; without, all.
    #[arg(long, value_delimiter = ',', value_name = "NAME", value_parser = names())]
    only: Vec<String>,
    /// The core's controller with one thing changed at a time, in place of other controllers.
    #[arg(long, conflicts_with = "only")]
    ablation: bool,
    /// Carriers to choose from, in place of the scenario's.
    #[arg(long, value_enum)]
    library: Option<Carriers>,
    /// Adds the main job's interferer (2 GHz wide at 7 GHz, from 0.35 to 0.75 of the way), so strong that it leaves the
    /// paths in use this median SINR, dB.
    #[arg(long, value_name = "DB", allow_negative_numbers = true)]
    interference: Option<f64>,
    /// Print one JSON object instead of a table.
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum Carriers {
    Published,
    Wide,
    Dw1000,
    Dw3000,
}

impl Carriers {
    fn library(self) -> Library {
        Library::Named(match self {
            Self::Published => NamedLibrary::Published,
            Self::Wide => NamedLibrary::Wide,
            Self::Dw1000 => NamedLibrary::Dw1000,
            Self::Dw3000 => NamedLibrary::Dw3000,
        })
    }
}

fn names() -> PossibleValuesParser {
    PossibleValuesParser::new(Controller::ALL.map(Controller::name))
}

pub fn run(options: &Options) -> Result<(), Failure> {
    let (mut scenario, folder) = Scenario::find(&options.scenario)?;
    if let Some(library) = options.library {
        scenario.radio.library = Some(library.library());
    }
    if let Some(median_sinr_db) = options.interference {
        scenario.interference.push(demo::interferer(median_sinr_db));
    }
    let asked = |controller: &Controller| {
        options.only.is_empty() || options.only.iter().any(|name| name == controller.name())
    };
    let controllers: Vec<Controller> = if options.ablation {
        let ablated = (0..ABLATIONS.len()).map(Controller::Ablated);
        [Controller::Greedy, Controller::Cognitive].into_iter().chain(ablated).collect()
    } else {
        Controller::ALL.into_iter().filter(asked).collect()
    };
    let bar = progress_of(options.runs as usize * controllers.len(), "steering", "runs");
    let figures =
        compare(&scenario, folder.as_deref(), &controllers, options.runs, options.seed, || bar.inc(1))?;
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
        "{}: {} runs; gains over the fixed carrier in cycles {from} to {to}, by the simulator's own knowledge\n",
        figures.scenario, figures.runs
    ));
    print(&format!(
        "{:<16} {:>16} {:>9} {:>9} {:>8} {:>8} {:>9} {:>10} {:>10}",
        "controller",
        "gain nat",
        "of genie",
        "all, nat",
        "RMSE m",
        "90 % m",
        "diverged",
        "switches",
        "to 90 %"
    ));
    for row in &figures.controllers {
        print(&format!(
            "{:<16} {:>7.3} +- {:<5.3} {:>9} {:>9.3} {:>8} {:>8} {:>9} {:>10.3} {:>10}",
            row.name,
            row.information_gain_nat,
            row.information_gain_error_nat,
            percent(row.fraction_of_genie),
            row.information_gain_all_nat,
            metres(Some(row.rmse_m)),
            metres(Some(row.p90_m)),
            row.diverged.len(),
            row.switches_per_cycle,
            row.cycles_to_90_percent.map_or_else(|| "-".into(), |cycles| cycles.to_string()),
        ));
    }
}
