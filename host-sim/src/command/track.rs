//! `cogmint track`: a recording through the core.

use super::{
    OUTPUT_FOLDER, check_writable, metres, print, print_json, progress, told_recording, tracker_variants,
    write_picture,
};
use crate::Failure;
use cogmint::cycle_choice::CycleChoice;
use cogmint::estimate_table::{self, Format};
use cogmint::replay::{PATHS, Setup, TrackerVariant};
use cogmint::score::Score;
use cogmint::score::consistency::Consistency;
use cogmint::score::map::MapScore;
use cogmint::score::walls::FoundWall;
use cogmint::track::{MappedVirtualAnchor, track_setup};
use serde::Serialize;
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
pub struct Options {
    /// The recording's folder.
    folder: PathBuf,
    /// Draw the start within the recording's prior; without, the start is the prior's mean.
    #[arg(long)]
    seed: Option<u64>,
    /// Variant of the tracker, for comparison.
    #[arg(long, value_name = "NAME", default_value = "soft", value_parser = tracker_variants())]
    variant: TrackerVariant,
    /// Also tell where the tag was this many seconds ago, by what was heard since: scored beside the estimate, and two more
    /// columns of the table.
    #[arg(long, value_name = "SECONDS", value_parser = lag_s)]
    lag: Option<f64>,
    /// Write the estimate of every cycle as a table, CSV or NPZ by the extension (docs/estimate-table.md).
    #[arg(long, value_name = "FILE")]
    table: Option<PathBuf>,
    /// What `cogmint calibrate` wrote: the recording is tracked as it is with it.
    #[arg(long, value_name = "FILE")]
    calibration: Option<PathBuf>,
    /// Score these cycles alone, counted from 0: odd, even, all, or FROM..TO without TO itself. All are tracked.
    #[arg(long, value_name = "CHOICE", default_value = "all")]
    score: CycleChoice,
    /// Where the figure goes, without extension.
    #[arg(long, value_name = "PATH")]
    plot: Option<PathBuf>,
    /// Draw and write no figure.
    #[arg(long, conflicts_with = "plot")]
    no_figure: bool,
    /// Print one JSON object instead of a table.
    #[arg(long)]
    json: bool,
}

fn lag_s(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value > 0.0 && value <= 3600.0 => Ok(value),
        _ => Err("is not a time above 0 and up to 3600 s".into()),
    }
}

#[derive(Serialize)]
struct Outcome<'a> {
    recording: &'a str,
    variant: &'static str,
    calibration: &'a Option<PathBuf>,
    cycles_scored: CycleChoice,
    #[serde(flatten)]
    score: &'a Score,
    #[serde(skip_serializing_if = "Option::is_none")]
    lag_s: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    rmse_lag_m: Option<Option<f64>>,
    virtual_anchors: &'a MapScore,
    #[serde(flatten)]
    consistency: &'a Consistency,
    measurements_left_out: u64,
    cycles_searching: usize,
    losses_noticed: usize,
    discoveries_without_room: u64,
    refused_cycles: usize,
    first_refusal: &'a Option<String>,
    virtual_anchors_found: &'a [MappedVirtualAnchor],
    walls_found: &'a [FoundWall],
    images_joined: u64,
    range_bias_m: &'a [[f64; 2]],
    figure: &'a Option<[PathBuf; 2]>,
    table: &'a Option<PathBuf>,
}

pub fn run(options: &Options) -> Result<(), Failure> {
    let folder = &options.folder;
    let recording = told_recording(folder, options.calibration.as_deref(), options.score)?;
    let format = options.table.as_deref().map(Format::of).transpose()?;
    let setup = Setup::new(&recording, folder, options.seed)?.with_variant(options.variant, folder)?;
    options.table.as_deref().map(check_writable).transpose()?;
    let bar = progress(recording.cycles.len(), "tracking");
    let run = track_setup(&setup, &recording, folder, || bar.inc(1))?;
    bar.finish_and_clear();
    let lagged = options.lag.map(|lag_s| run.lagged(&setup, &recording, lag_s));
    if let Some((to, format)) = options.table.as_ref().zip(format) {
        let lagged_m = lagged.as_ref().map(|lagged| &lagged.positions_m[..]);
        estimate_table::write(&recording, &run.estimates, lagged_m, format, to)?;
    }
    let figure = if options.no_figure {
        None
    } else {
        Some(write_picture(&run.picture(&recording), &figure_place(options))?)
    };
    let score = &run.score;
    if options.json {
        return print_json(&Outcome {
            recording: &recording.name,
            variant: options.variant.name(),
            calibration: &options.calibration,
            cycles_scored: options.score,
            score,
            lag_s: options.lag,
            rmse_lag_m: lagged.map(|lagged| lagged.rmse_m),
            virtual_anchors: &run.map,
            consistency: &run.consistency,
            measurements_left_out: run.left_out,
            cycles_searching: run.searching,
            losses_noticed: run.losses,
            discoveries_without_room: run.map_full,
            refused_cycles: run.refused,
            first_refusal: &run.first_refusal,
            virtual_anchors_found: &run.virtual_anchors,
            walls_found: &run.walls,
            images_joined: run.joined,
            range_bias_m: &run.bias_m,
            figure: &figure,
            table: &options.table,
        });
    }
    let (cycles, anchors) = (score.cycles, recording.anchors.len());
    let variant = options.variant.name();
    print(&format!("{}: {cycles} cycles, {anchors} anchors, {variant} variant.", recording.name));
    if let Some(calibration) = &options.calibration {
        print(&format!("calibrated with {}", calibration.display()));
    }
    if options.score != CycleChoice::All {
        print(&format!("scored in {} of them ({})", score.scored, options.score));
    }
    print("\n  RMSE m  median m   90 % m   95 % m    max m  diverged  us/cycle");
    print(&format!(
        "{:>8} {:>9} {:>8} {:>8} {:>8} {:>9} {:>9.1}",
        metres(score.rmse_m),
        metres(score.p50_m),
        metres(score.p90_m),
        metres(score.p95_m),
        metres(score.max_m),
        if score.scored == 0 {
            "unknown"
        } else if score.diverged {
            "yes"
        } else {
            "no"
        },
        score.us_per_cycle,
    ));
    if let Some((lag_s, lagged)) = options.lag.zip(lagged) {
        print(&format!("{lag_s} s later: RMSE {} m", metres(lagged.rmse_m)));
    }
    print_consistency(&run.consistency);
    print_map_score(&run.map);
    if !run.virtual_anchors.is_empty() {
        print("\nvirtual anchor of       x m      y m  deviation m  existence");
        for va in &run.virtual_anchors {
            let [xx, _, yy] = va.covariance_m2;
            let anchor = recording.anchors.get(va.anchor).map_or("?", |anchor| anchor.name.as_str());
            let [x, y] = va.position_m;
            print(&format!(
                "{anchor:<17} {x:>9.2} {y:>8.2} {:>12.3} {:>10.3}",
                (xx + yy).sqrt(),
                va.existence
            ));
        }
    }
    if !run.walls.is_empty() {
        print(
            "\nwall through    x m      y m  normal deg  moved m  offset dev. m  rotation dev. deg  existence",
        );
        for wall in &run.walls {
            let ([x, y], [nx, ny]) = (wall.centre_m, wall.normal);
            print(&format!(
                "{:<10} {x:>8.2} {y:>8.2} {:>11.1} {:>8} {:>14.3} {:>18.2} {:>10.3}{}",
                if wall.is_told { "told" } else { "grown" },
                ny.atan2(nx).to_degrees(),
                metres(wall.moved_m),
                wall.offset_std_m,
                wall.rotation_std_rad.to_degrees(),
                wall.existence,
                if wall.is_doubted { "  doubted" } else { "" }
            ));
        }
    }
    for (anchor, [bias, deviation]) in recording.anchors.iter().zip(&run.bias_m) {
        print(&format!("range bias of {}: {bias:.3} m, deviation {deviation:.3} m", anchor.name));
    }
    print(&format!("tag searched for in {} cycles, loss noticed {} times", run.searching, run.losses));
    if run.map_full > 0 {
        print(&format!("{} virtual anchors found no room in the map", run.map_full));
    }
    if run.left_out > 0 {
        print(&format!(
            "{} ranges or paths left out: more than {PATHS} of an anchor in a cycle",
            run.left_out
        ));
    }
    if let Some(reason) = &run.first_refusal {
        print(&format!("{} cycles refused, the first because {reason}", run.refused));
    }
    if let Some([_, png]) = &figure {
        print(&format!("\nFigure: {}", png.display()));
    }
    if let Some(to) = &options.table {
        print(&format!("{}Table: {}", if figure.is_none() { "\n" } else { "" }, to.display()));
    }
    Ok(())
}

/// Where the figure goes, without extension.
fn figure_place(options: &Options) -> PathBuf {
    let name = options.folder.file_name();
    let name = name.map_or_else(|| "recording".into(), |name| name.to_string_lossy().into_owned());
    options.plot.clone().unwrap_or_else(|| Path::new(OUTPUT_FOLDER).join(format!("{name}-track")))
}

fn print_consistency(consistency: &Consistency) {
    let number = |value: Option<f64>| value.map_or_else(|| "-".into(), |value| format!("{value:.2}"));
    let within =
        consistency.nees_within_95.map_or_else(|| "-".into(), |share| format!("{:.1} %", 100.0 * share));
    print("\n  NEES/dof  within 95 % ellipse       NIS");
    print(&format!("{:>10} {within:>20} {:>9}", number(consistency.nees), number(consistency.nis)));
}

fn print_map_score(map: &MapScore) {
    let count = |value: Option<usize>| value.map_or_else(|| "-".into(), |value| value.to_string());
    print("\nvirtual anchors:  true  found  spurious   OSPA m");
    print(&format!(
        "{:>22} {:>6} {:>9} {:>8}",
        count(map.truth),
        map.found,
        count(map.spurious),
        metres(map.ospa_m)
    ));
}
