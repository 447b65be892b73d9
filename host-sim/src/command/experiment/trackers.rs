//! `cogmint experiment trackers`: trackers side by side over recordings.

use super::rooms::{asked, number, one_of};
use super::{print, print_json};
use crate::Failure;
use cogmint::experiment::side_by_side::run::Judging;
use cogmint::experiment::side_by_side::{SideBySide, Tracker, run_recording};
use cogmint::recording::Recording;
use cogmint::replay::Setup;
use serde::Serialize;
use std::path::PathBuf;

#[derive(clap::Args)]
pub struct Options {
    /// Folders of recordings.
    #[arg(required = true)]
    folders: Vec<PathBuf>,
    /// Run these trackers only; without, all but particles.
    #[arg(long, value_delimiter = ',', value_name = "TRACKER", value_parser = one_of(&Tracker::ALL, Tracker::name))]
    only: Vec<Tracker>,
    /// Draw the starts within the recordings' priors; without, a start is the prior's mean.
    #[arg(long)]
    seed: Option<u64>,
    /// Leave the first 5 s out of errors and losses: the start is anywhere.
    #[arg(long)]
    anywhere: bool,
    /// Print one JSON object instead of a table.
    #[arg(long)]
    json: bool,
}

/// What `--json` prints for a recording.
#[derive(Serialize)]
struct Outcome {
    recording: String,
    #[serde(flatten)]
    trackers: SideBySide,
}

pub fn run(options: &Options) -> Result<(), Failure> {
    let trackers = asked(&options.only);
    let outcomes: Vec<Outcome> = options
        .folders
        .iter()
        .map(|folder| {
            let recording = Recording::read(folder)?;
            let setup = Setup::new(&recording, folder, options.seed)?;
            let judging = Judging { starts_anywhere: options.anywhere, ..Judging::default() };
            let trackers = run_recording(&recording, &setup, folder, &trackers, &judging)?;
            Ok(Outcome { recording: recording.name, trackers })
        })
        .collect::<Result<_, Failure>>()?;
    if options.json {
        return print_json(&outcomes);
    }
    for Outcome { recording, trackers } in &outcomes {
        let bound = trackers.bound_m.map_or_else(String::new, |bound_m| format!(", bound {bound_m:.3} m"));
        let answerable = match trackers.answerable {
            Some(true) => "answerable",
            Some(false) => "not answerable",
            None => "true paths unknown: nothing to tell `told`, no bound",
        };
        print(&format!(
            "{recording}: {:.1} paths per frame, {answerable}{bound}\n",
            trackers.paths_per_frame
        ));
        print(
            "tracker      RMSE m   95 % m   lost  lies %  search %  inside 95 %   > 5 sigma %      NEES/dof",
        );
        for run in &trackers.runs {
            let percent = |share: f64| format!("{:.1}", 100.0 * share);
            print(&format!(
                "{:<10} {:>8} {:>8} {:>6} {:>7} {:>9} {:>12} {:>13} {:>13}",
                run.tracker,
                number(run.rmse_m, 3),
                number(run.p95_m, 3),
                if run.lost { "yes" } else { "no" },
                percent(run.confident_lies),
                percent(run.searching),
                percent(run.inside_95),
                percent(run.above_5_sigma),
                number(run.nees, 2),
            ));
        }
        print("");
    }
    Ok(())
}
