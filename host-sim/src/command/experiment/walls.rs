//! `cogmint experiment walls`: the walls that grow on a map without a plan, and what becomes of those that a plan tells.

use super::super::{metres, progress_of};
use super::{percent, print, print_json};
use crate::Failure;
use cogmint::experiment::walls::{Ratios, Run, Summary, ToldRun, run as run_all, run_told, summaries};

#[derive(clap::Args)]
pub struct Options {
    /// Runs per room.
    #[arg(long, default_value_t = 20, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    runs: u32,
    /// Seed of the first run; the others count on.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Print one JSON object instead of tables.
    #[arg(long)]
    json: bool,
}

#[derive(serde::Serialize)]
struct Answer {
    runs: Vec<Run>,
    told: Vec<ToldRun>,
    rooms: Vec<Summary>,
}

pub fn run(options: &Options) -> Result<(), Failure> {
    let seeds: Vec<u64> = (0..u64::from(options.runs)).map(|run| options.seed.wrapping_add(run)).collect();
    let bar = progress_of(4 * seeds.len(), "tracking", "runs");
    let runs = run_all(&seeds, || bar.inc(1))?;
    let told = run_told(&seeds, || bar.inc(1))?;
    bar.finish_and_clear();
    let rooms = summaries(&runs, &told);
    if options.json {
        return print_json(&Answer { runs, told, rooms });
    }
    print("room              seed  shown  found  grown  false  images  mapped   RMSE m");
    for Run { room, seed, score, rmse_m, .. } in &runs {
        let [images, mapped] = score.images;
        print(&format!(
            "{room:<16} {seed:>5} {:>6} {:>6} {:>6} {:>6} {images:>7} {mapped:>7} {:>8}",
            score.shown,
            score.found,
            score.grown,
            score.false_ones,
            metres(*rmse_m)
        ));
    }
    let sum = |of: fn(&Run) -> usize| runs.iter().map(of).sum::<usize>();
    let share = |part: usize, all: usize| percent(part as f64 / all as f64);
    print(&format!(
        "\nOf {} walls shown {} found (must be 60 %, aim 85 %); of {} grown {} false (must be 10 %, aim 3 %)",
        sum(|run| run.score.shown),
        share(sum(|run| run.score.found), sum(|run| run.score.shown)),
        sum(|run| run.score.grown),
        share(sum(|run| run.score.false_ones), sum(|run| run.score.grown)),
    ));
    let ratio = |value: Option<f64>| value.map_or_else(|| "-".into(), |value| format!("{value:.2}"));
    let both = |ratios: &Ratios| format!("{:>6} {:>6}", ratio(ratios.median), ratio(ratios.p90));
    print(
        "\nWalls grown that are right: error over the tracker's deviation, median and 90 % (0.67 and 1.64 where it is right)",
    );
    print("room              walls        offset          angle");
    for Summary { room, grown_offset, grown_rotation, .. } in &rooms {
        print(&format!(
            "{room:<16} {:>6} {}   {}",
            grown_offset.count,
            both(grown_offset),
            both(grown_rotation)
        ));
    }
    print(
        "\nPlan told within 0.07 m and 0.5 degrees: how far the walls that were seen are off at their centre, mean over all of\n\
         them and over those believed at the end; error after the way over the tracker's deviation, median and 90 %",
    );
    print("room              walls  doubted    told m   after m  believed m   median   90 %");
    for summary in &rooms {
        print(&format!(
            "{:<16} {:>6} {:>8} {:>9} {:>9} {:>11} {:>8} {:>6}",
            summary.room,
            summary.told,
            summary.doubted,
            metres(summary.told_m),
            metres(summary.after_m),
            metres(summary.believed_m),
            ratio(summary.told_offset.median),
            ratio(summary.told_offset.p90)
        ));
    }
    Ok(())
}
