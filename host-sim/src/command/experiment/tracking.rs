//! `cogmint experiment tracking`: the whole tracker over named scenarios, or over a recording from many starts.

use super::super::{metres, progress_of, told_recording, tracker_variants};
use super::{percent, print, print_json};
use crate::Failure;
use clap::builder::{PossibleValue, PossibleValuesParser};
use cogmint::cycle_choice::CycleChoice;
use cogmint::experiment::tracking::figures::Figures;
use cogmint::experiment::tracking::target::{TARGETS, Verdict};
use cogmint::experiment::tracking::{cases, run_recording};
use cogmint::input_error::InputError;
use cogmint::replay::TrackerVariant;
use cogmint_core::Variant;
use std::path::PathBuf;

#[derive(clap::Args)]
pub struct Options {
    /// Runs per scenario.
    #[arg(long, default_value_t = 20, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    runs: u32,
    /// Seed of the first run; the others count on.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Run these scenarios only, separated by commas.
    #[arg(long, value_delimiter = ',', value_name = "NAME", value_parser = names(), conflicts_with = "recording")]
    only: Vec<String>,
    /// A recording's folder to run instead of the scenarios.
    #[arg(long, value_name = "DIR")]
    recording: Option<PathBuf>,
    /// Starts to draw within the recording's prior, one run each.
    #[arg(long, requires = "recording", conflicts_with = "runs", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    starts: Option<u32>,
    /// What `cogmint calibrate` wrote: the recording is tracked as it is with it.
    #[arg(long, value_name = "FILE", requires = "recording")]
    calibration: Option<PathBuf>,
    /// Score these cycles of the recording alone, counted from 0: odd, even, all, or FROM..TO without TO itself.
    #[arg(long, value_name = "CHOICE", requires = "recording")]
    score: Option<CycleChoice>,
    /// Variants of the tracker to compare, separated by commas; conventional needs scenarios with a floor plan.
    #[arg(long, value_delimiter = ',', value_name = "NAME", default_value = "soft", value_parser = tracker_variants())]
    variant: Vec<TrackerVariant>,
    /// Print one JSON object instead of tables.
    #[arg(long)]
    json: bool,
}

/// What `--json` prints.
#[derive(serde::Serialize)]
struct Answer {
    seed: u64,
    scenarios: Vec<Figures>,
}

fn names() -> PossibleValuesParser {
    PossibleValuesParser::new(
        cases().into_iter().map(|case| PossibleValue::new(case.name).help(case.summary)),
    )
}

pub fn run(options: &Options) -> Result<(), Failure> {
    let variants = &options.variant;
    let runs = options.starts.unwrap_or(options.runs);
    let seeds: Vec<u64> = (0..u64::from(runs)).map(|run| options.seed.wrapping_add(run)).collect();
    let scenarios = match &options.recording {
        Some(folder) => {
            let scored = options.score.unwrap_or_default();
            let recording = told_recording(folder, options.calibration.as_deref(), scored)?;
            let bar = progress_of(variants.len() * seeds.len(), "tracking", "runs");
            let figures: Result<Vec<_>, _> = variants
                .iter()
                .map(|&variant| run_recording(&recording, folder, variant, &seeds, || bar.inc(1)))
                .collect();
            bar.finish_and_clear();
            figures?
        }
        None => {
            let asked = |name: &str| options.only.is_empty() || options.only.iter().any(|only| only == name);
            let cases: Vec<_> = cases().into_iter().filter(|case| asked(case.name)).collect();
            let without: Vec<_> =
                cases.iter().filter(|case| !case.has_floor_plan()).map(|case| case.name).collect();
            if variants.contains(&Variant::Conventional.into()) && !without.is_empty() {
                let without = without.join(", ");
                let reason =
                    format!("needs a floor plan; name scenarios with --only that have one, not {without}");
                return Err(InputError::new("--variant conventional", reason).into());
            }
            let bar = progress_of(cases.len() * variants.len() * seeds.len(), "tracking", "runs");
            let pairs = cases.iter().flat_map(|case| variants.iter().map(move |&variant| (case, variant)));
            let figures: Result<Vec<_>, _> =
                pairs.map(|(case, variant)| case.run(variant, &seeds, || bar.inc(1))).collect();
            bar.finish_and_clear();
            figures?
        }
    };
    if options.json {
        return print_json(&Answer { seed: options.seed, scenarios });
    }
    print(&format!("The tracker, {runs} runs each, seeds from {}\n", options.seed));
    print_figures(&scenarios);
    print_diverged(&scenarios);
    if options.recording.is_none() {
        print_targets(&scenarios);
    }
    Ok(())
}

fn number(value: Option<f64>) -> String {
    value.map_or_else(|| "-".into(), |value| format!("{value:.2}"))
}

/// The scenario, with the variant where it is not the default.
fn row_name(figures: &Figures) -> String {
    let Figures { scenario, variant, .. } = figures;
    if *variant == Variant::Soft.name() { scenario.clone() } else { format!("{scenario}, {variant}") }
}

fn print_figures(scenarios: &[Figures]) {
    let wide = scenarios.iter().map(|figures| row_name(figures).len()).max().unwrap_or(0).max(8);
    print(&format!(
        "{:<wide$}      RMSE in m       95 % m  diverged   NEES  within    NIS   OSPA   VAs    VAs  us per  posterior    RMSE /",
        ""
    ));
    print(&format!(
        "{:<wide$}  mean median  worst  worst               /dof    95 %             m  true  found   cycle     CRLB m      CRLB",
        "scenario"
    ));
    for figures in scenarios {
        print(&format!(
            "{:<wide$} {:>5} {:>6} {:>6} {:>6} {:>9} {:>6} {:>7} {:>6} {:>6} {:>5} {:>6.1} {:>7.1} {:>10} {:>9}",
            row_name(figures),
            metres(figures.rmse_m),
            metres(figures.rmse_median_m),
            metres(figures.rmse_worst_m),
            metres(figures.p95_worst_m),
            figures.diverged.len(),
            number(figures.nees),
            figures.nees_within_95.map_or_else(|| "-".into(), percent),
            number(figures.nis),
            metres(figures.ospa_m),
            figures.virtual_anchors_true.map_or_else(|| "-".into(), |count| format!("{count:.1}")),
            figures.virtual_anchors_found,
            figures.us_per_cycle,
            figures.posterior_crlb_m.map_or_else(|| "-".into(), |m| format!("{m:.4}")),
            number(figures.rmse_over_posterior_crlb),
        ));
    }
}

/// Which runs to look at.
fn print_diverged(scenarios: &[Figures]) {
    for figures in scenarios {
        if !figures.diverged.is_empty() {
            let seeds: Vec<String> = figures.diverged.iter().map(u64::to_string).collect();
            print(&format!("{}: diverged with seed {}", row_name(figures), seeds.join(", ")));
        }
        if figures.refused_cycles > 0 {
            print(&format!("{}: {} cycles refused", row_name(figures), figures.refused_cycles));
        }
    }
}

fn print_targets(scenarios: &[Figures]) {
    let soft = Variant::Soft.name();
    if scenarios.iter().all(|figures| figures.variant != soft) {
        return;
    }
    let limits = |[least, most]: [f64; 2]| {
        if least > 0.0 { format!("{least} to {most}") } else { format!("{most}") }
    };
    print(&format!(
        "\n{:<18} {:<26} {:>9} {:>12} {:>12}",
        "scenario", "figure", "measured", "must be", "aim"
    ));
    // What is to be reached is asked of the default.
    let is_asked = |figures: &&Figures, scenario| figures.scenario == scenario && figures.variant == soft;
    for target in TARGETS {
        let Some(figures) = scenarios.iter().find(|figures| is_asked(figures, target.scenario)) else {
            continue;
        };
        let verdict = match target.verdict(figures) {
            None => "",
            Some(Verdict::Aim) => "aim reached",
            Some(Verdict::Must) => "met",
            Some(Verdict::Missed) => "missed",
        };
        let measured = (target.measured)(figures).map_or_else(|| "-".into(), |value| format!("{value:.3}"));
        print(
            format!(
                "{:<18} {:<26} {measured:>9} {:>12} {:>12}  {verdict}",
                target.scenario,
                target.figure,
                limits(target.must),
                limits(target.aim)
            )
            .trim_end(),
        );
    }
}
