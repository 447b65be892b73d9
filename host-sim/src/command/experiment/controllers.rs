//! `cogmint experiment controllers`: what choosing the carrier is worth.

use super::super::{metres, progress_of, variants, write_picture};
use super::carriers::Carriers;
use super::{percent, print, print_json};
use crate::Failure;
use clap::builder::PossibleValuesParser;
use cogmint::demo;
use cogmint::experiment::controllers::figures::{Figures, Row};
use cogmint::experiment::controllers::onset::Answer;
use cogmint::experiment::controllers::picture::Pictures;
use cogmint::experiment::controllers::{ABLATIONS, Campaign, Comparison, Controller, compare_each};
use cogmint::plot::Picture;
use cogmint::scenario::Scenario;
use cogmint_core::Variant;
use std::path::{Path, PathBuf};

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
    /// Controllers beside the fixed carrier and the genie, separated by commas, among them those of the ablation; without,
    /// all but these.
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
    #[arg(long, value_name = "DB", allow_negative_numbers = true, value_parser = median_sinr_db)]
    interference: Option<f64>,
    /// Draws what the controllers do over time into this folder: carrier, entropy, value and policy. All but the
    /// entropies are those of the first run.
    #[arg(long, value_name = "DIR")]
    plot: Option<PathBuf>,
    /// Moves that interferer to this carrier, hertz, half-way through its time; it leaves as much there.
    #[arg(long, value_name = "HZ", requires = "interference", value_parser = carrier_hz)]
    then: Option<f64>,
    /// The variant of all trackers.
    #[arg(long, value_name = "NAME", default_value = "soft", value_parser = variants())]
    variant: Variant,
    /// Tells all trackers exactly where the N strongest virtual anchors are, and of no other, whatever the scenario does.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=24))]
    exact_map: Option<u32>,
    /// Print one JSON object instead of a table.
    #[arg(long)]
    json: bool,
}

/// What `--json` prints.
#[derive(serde::Serialize)]
struct Printed<'a> {
    #[serde(flatten)]
    figures: &'a Figures,
    #[serde(flatten)]
    drawn: Option<&'a Drawn>,
}

/// What was drawn.
#[derive(serde::Serialize)]
struct Drawn {
    /// Every picture as SVG and PNG.
    pictures: Vec<[PathBuf; 2]>,
    /// Sentences.
    left_out: Vec<String>,
}

/// All controllers, the core's changed ones last.
pub(super) fn all() -> impl Iterator<Item = Controller> {
    let changed = (0..ABLATIONS.len()).map(Controller::Ablated);
    Controller::ALL.into_iter().chain([Controller::FullBand, Controller::GeniePerAnchor]).chain(changed)
}

fn names() -> PossibleValuesParser {
    PossibleValuesParser::new(all().map(Controller::name))
}

pub fn run(options: &Options) -> Result<(), Failure> {
    let (mut scenario, folder) = Scenario::find(&options.scenario)?;
    if let Some(library) = options.library {
        scenario.radio.library = Some(library.library());
    }
    if let Some(median_sinr_db) = options.interference {
        match options.then {
            None => scenario.interference.push(demo::interferer(median_sinr_db)),
            Some(then_hz) => scenario.interference.extend(demo::moving_interferer(median_sinr_db, then_hz)),
        }
    }
    if let Some(strongest) = options.exact_map {
        let plan = &mut scenario.prior.floor_plan;
        (plan.known, plan.exact, plan.max_virtual_anchors) = (true, true, strongest as usize);
    }
    let controllers: Vec<Controller> = if options.ablation {
        let ablated = (0..ABLATIONS.len()).map(Controller::Ablated);
        [Controller::Greedy, Controller::Cognitive].into_iter().chain(ablated).collect()
    } else if options.only.is_empty() {
        Controller::ALL.into()
    } else {
        all().filter(|one| options.only.iter().any(|name| name == one.name())).collect()
    };
    if let Some(folder) = &options.plot {
        // A folder that cannot be should not be noticed after minutes.
        std::fs::create_dir_all(folder)
            .map_err(|error| Failure::Work(format!("{}: {error}", folder.display())))?;
    }
    let bar = progress_of(options.runs as usize * controllers.len(), "steering", "runs");
    let comparisons = compare_each(
        &scenario,
        folder.as_deref(),
        &controllers,
        &Campaign {
            runs: options.runs,
            seed: options.seed,
            variant: options.variant,
            watched: options.plot.is_some(),
        },
        || bar.inc(1),
    )?;
    bar.finish_and_clear();
    let figures = Figures::new(&scenario.name, &comparisons);
    // Figures are printed even if the disk refuses the pictures.
    let drawn = options.plot.as_deref().map(|to| draw(to, &scenario.name, &comparisons)).transpose();
    if options.json {
        print_json(&Printed { figures: &figures, drawn: drawn.as_ref().ok().and_then(Option::as_ref) })?;
        return drawn.map(|_| ());
    }
    print_figures(&figures);
    if let Some(drawn) = drawn? {
        print("");
        for [_, png] in &drawn.pictures {
            print(&format!("Figure: {}", png.display()));
        }
        drawn.left_out.iter().for_each(|sentence| print(sentence));
    }
    Ok(())
}

fn draw(to: &Path, scenario: &str, comparisons: &[Comparison]) -> Result<Drawn, Failure> {
    let Pictures { named, left_out } = Pictures::new(scenario, comparisons);
    let write = |(name, picture): &(&str, Picture)| write_picture(picture, &to.join(name));
    Ok(Drawn { pictures: named.iter().map(write).collect::<Result<_, _>>()?, left_out })
}

/// What an interferer may leave.
fn median_sinr_db(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(sinr_db) if (-60.0..=60.0).contains(&sinr_db) => Ok(sinr_db),
        _ => Err("must be a number of decibels from -60 to 60".into()),
    }
}

/// The bounds within which a scenario may have it.
fn carrier_hz(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(carrier_hz) if (2e9..=3e10).contains(&carrier_hz) => Ok(carrier_hz),
        _ => Err("must be a number of hertz from 2e9 to 3e10".into()),
    }
}

/// After every onset, in order.
fn to_90_percent(row: &Row) -> String {
    let cycles = |answer: &Answer| answer.cycles_to_90_percent.map_or_else(|| "-".into(), |n| n.to_string());
    let all: Vec<String> = row.onsets.iter().map(cycles).collect();
    if all.is_empty() { "-".into() } else { all.join(", ") }
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
            row.diverged,
            row.switches_per_cycle,
            to_90_percent(row),
        ));
    }
}
