//! `cogmint estimate`: the frames of recordings through the channel estimator.

use super::{
    OUTPUT_FOLDER, check_writable, metres, print, print_json, progress, recordings_in, write_picture,
};
use crate::Failure;
use clap::builder::RangedU64ValueParser;
use cogmint::estimate::link::{AgainstTruth, Link, links};
use cogmint::estimate::spread::Spread;
use cogmint::estimate::summary::{Share, Summary, summaries};
use cogmint::estimate::truth::Tally;
use cogmint::estimate::{EstimatedFrame, count, estimate};
use cogmint::recording::Recording;
use cogmint::view;
use cogmint::whole_file;
use serde::Serialize;
use std::io::Write;
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
pub struct Options {
    /// Folders of recordings, or of folders of recordings.
    #[arg(required = true, value_name = "DIR")]
    folders: Vec<PathBuf>,
    /// Paths found per frame of pure noise, on average: 1e-4 to 10.
    #[arg(long, default_value_t = 0.1, value_parser = false_path_rate)]
    false_paths: f64,
    /// First cycle, counted from 0.
    #[arg(long, value_name = "N", default_value_t = 0)]
    from: usize,
    /// Cycles from there on; all where not given.
    #[arg(long, value_name = "N", value_parser = RangedU64ValueParser::<usize>::new().range(1..))]
    cycles: Option<usize>,
    /// One anchor alone, counted from 0.
    #[arg(long, value_name = "J")]
    anchor: Option<usize>,
    /// Write all paths of all frames as a table of comma-separated values.
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// The cycle whose responses are drawn, counted from 0; the first that is estimated where not given.
    #[arg(long, value_name = "N")]
    draw: Option<usize>,
    /// Where the figure of the first recording goes, without extension.
    #[arg(long, value_name = "PATH")]
    plot: Option<PathBuf>,
    /// Print one JSON object, with all paths of all frames, instead of a table.
    #[arg(long)]
    json: bool,
}

fn false_path_rate(text: &str) -> Result<f64, String> {
    let rate: f64 = text.parse().map_err(|_| "is no number".to_owned())?;
    // NaN is in no range.
    if (1e-4..=10.0).contains(&rate) { Ok(rate) } else { Err("allowed is 1e-4 to 10".into()) }
}

#[derive(Serialize)]
struct Estimated {
    name: String,
    folder: PathBuf,
    links: Vec<Link>,
    frames: Vec<EstimatedFrame>,
}

#[derive(Serialize)]
struct Outcome<'a> {
    false_paths: f64,
    recordings: &'a [Estimated],
    truth: Option<AgainstTruth>,
    summaries: &'a [Summary],
    figure: [PathBuf; 2],
}

pub fn run(options: &Options) -> Result<(), Failure> {
    let folders = recordings_in(&options.folders)?;
    let chosen = cogmint::estimate::Options {
        false_paths: options.false_paths,
        from: options.from,
        cycles: options.cycles.unwrap_or(usize::MAX),
        anchor: options.anchor,
    };
    options.csv.as_deref().map(check_writable).transpose()?;
    let mut estimated: Vec<Estimated> = Vec::with_capacity(folders.len());
    let mut picture = None;
    let mut tally = Tally::default();
    for folder in folders {
        let recording = Recording::read(&folder)?;
        let bar = progress(count(&recording, &folder, &chosen)?, "estimating");
        let frames = estimate(&recording, &folder, &chosen, || bar.inc(1))?;
        bar.finish_and_clear();
        if picture.is_none() {
            let cycle = options.draw.unwrap_or(frames[0].cycle);
            picture = Some(view::estimate::picture(&recording, &folder, &chosen, &frames, cycle)?);
        }
        let links = links(&recording, &frames);
        tally.add(&recording, &frames);
        estimated.push(Estimated { name: recording.name, folder, links, frames });
    }
    let stem = estimated[0].folder.file_name().map_or("recording".into(), |name| name.to_string_lossy());
    let to =
        options.plot.clone().unwrap_or_else(|| Path::new(OUTPUT_FOLDER).join(format!("{stem}-estimate")));
    let figure = write_picture(&picture.unwrap_or_default(), &to)?;
    if let Some(to) = &options.csv {
        whole_file::write(to, |file| write_csv(file, &estimated))?;
    }
    let all_links: Vec<&Link> = estimated.iter().flat_map(|recording| &recording.links).collect();
    let summaries = summaries(&all_links);
    let truth = tally.figures();
    if options.json {
        return print_json(&Outcome {
            false_paths: options.false_paths,
            recordings: &estimated,
            truth,
            summaries: &summaries,
            figure,
        });
    }
    print_links(&all_links);
    print_truth(&all_links, truth.as_ref());
    print_registered(&all_links);
    summaries.iter().for_each(print_summary);
    print(&format!("\nFigure: {}", figure[1].display()));
    Ok(())
}

fn percent(share: Option<f64>) -> String {
    share.map_or_else(|| "-".into(), |share| format!("{:.1} %", 100.0 * share))
}

fn print_links(links: &[&Link]) {
    print(
        "                              direct          paths     first path, m                     radio's range, m \
         \x20        peak over  residual  noise",
    );
    print(
        "recording, anchor             path    frames  /frame     median      std   robust   error     median     \
         std   robust   error   noise dB    energy  alone",
    );
    for link in links {
        // A moving tag's range spreads by its motion: then what counts is the error's spread.
        let spread = |range: Option<Spread>, error: Option<Spread>| match (range, error.or(range)) {
            (Some(range), Some(error)) => {
                format!("{:>10.3} {:>8.4} {:>8.4}", range.median, error.std, error.robust_std)
            }
            _ => format!("{:>10} {:>8} {:>8}", "-", "-", "-"),
        };
        print(&format!(
            "{:<29} {:<7} {:>6} {:>7.2} {} {:>7} {} {:>7} {:>10} {:>9} {:>6}",
            name_of(link),
            direct_path(link.line_of_sight),
            link.frames,
            link.paths_per_frame,
            spread(link.first_path_range_m, link.first_path_error_m),
            metres(link.first_path_error_m.map(|error| error.median)),
            spread(link.radio_range_m, link.radio_error_m),
            metres(link.radio_error_m.map(|error| error.median)),
            link.strongest_over_noise_db.map_or_else(|| "-".into(), |db| format!("{db:.1}")),
            percent(link.residual_share),
            percent(Some(link.noise_share)),
        ));
    }
}

fn direct_path(line_of_sight: Option<bool>) -> &'static str {
    match line_of_sight {
        Some(true) => "free",
        Some(false) => "blocked",
        None => "unknown",
    }
}

/// The name of a link in a column of 29: of a long recording's name, its beginning.
fn name_of(link: &Link) -> String {
    let anchor = short(&link.name, 12);
    let recording = short(&link.recording, 27 - anchor.chars().count());
    format!("{recording}, {anchor}")
}

fn short(text: &str, length: usize) -> String {
    if text.chars().count() <= length {
        text.into()
    } else {
        text.chars().take(length - 1).chain(['…']).collect()
    }
}

fn print_truth(links: &[&Link], all: Option<&AgainstTruth>) {
    let Some(all) = all else { return };
    print(
        "\nagainst true paths            paths   found    of 9 dB   of 12 dB  false/frame  far off  level 50 %  95 %  \
         delay RMSE ps  first path error m: std",
    );
    let row = |name: &str, truth: &AgainstTruth, error: Option<Spread>| {
        let ratio = |ratio: Option<f64>| ratio.map_or_else(|| "-".into(), |ratio| format!("{ratio:.2}"));
        print(&format!(
            "{:<29} {:>5} {:>7} {:>10} {:>10} {:>12.3} {:>8.3} {:>11} {:>5} {:>14} {:>24}",
            name,
            truth.paths,
            percent(truth.detected_share),
            percent(truth.detected_share_above_9_db),
            percent(truth.detected_share_above_12_db),
            truth.false_paths_per_frame,
            truth.far_false_paths_per_frame,
            ratio(truth.level_ratio_median),
            ratio(truth.level_ratio_95),
            truth.delay_rmse_s.map_or_else(|| "-".into(), |rmse_s| format!("{:.1}", 1e12 * rmse_s)),
            error.map_or_else(|| "-".into(), |error| format!("{:.4}", error.std)),
        ));
    };
    for link in links {
        if let Some(truth) = &link.truth {
            row(&name_of(link), truth, link.first_path_error_m);
        }
    }
    if links.len() > 1 {
        row("all frames", all, None);
    }
}

fn print_registered(links: &[&Link]) {
    if links.iter().all(|link| link.registered.is_none()) {
        return;
    }
    print("\nfirst path against the registered response, m");
    print(
        "recording, anchor             alike  unlike       std   robust   radio's index: std   robust   ideal range: std",
    );
    for link in links {
        let Some(registered) = &link.registered else { continue };
        let radio = registered.radio_first_path_m;
        let part = |value: Option<f64>| value.map_or_else(|| "-".into(), |value| format!("{value:.4}"));
        print(&format!(
            "{:<29} {:>5} {:>7} {:>9.4} {:>8.4} {:>20} {:>8} {:>18.4}",
            name_of(link),
            registered.responses,
            registered.unlike,
            registered.first_path_m.std,
            registered.first_path_m.robust_std,
            part(radio.map(|radio| radio.std)),
            part(radio.map(|radio| radio.robust_std)),
            registered.ideal_range_m.std,
        ));
    }
}

fn print_summary(summary: &Summary) {
    print(&format!(
        "\ndirect path {}: {} links, {} frames",
        direct_path(summary.line_of_sight),
        summary.links,
        summary.frames
    ));
    print(&format!(
        "  frames without a path {}, with one at the first path {}; paths ahead of it {:.3} per frame",
        percent(Some(summary.without_path_share)),
        percent(Some(summary.first_path_share)),
        summary.paths_ahead_per_frame
    ));
    let share = |what: &str, share: &Option<Share>| {
        if let Some(share) = share {
            print(&format!(
                "  {what:<66} {:>7} of {} links (robust: {})",
                percent(Some(share.by_std)),
                share.links,
                percent(Some(share.by_robust_std))
            ));
        }
    };
    share("first-path range spreads no more than the radio's own", &summary.range_spread_no_larger);
    share(
        "an ideal detector's range spreads no more than the radio's own",
        &summary.ideal_range_spread_no_larger,
    );
    share(
        "registered first path spreads no more than the radio's range",
        &summary.first_path_spread_no_larger_than_range,
    );
    share(
        "registered first path spreads no more than the radio's index",
        &summary.first_path_spread_no_larger_than_radio,
    );
    if let Some([mean, uncertainty]) = summary.range_index_correlation {
        print(&format!(
            "  correlation of the radio's range with its index's error {mean:.2}, uncertain by {uncertainty:.2}"
        ));
    }
    if let (Some(own), Some(radio)) = (summary.first_path_std_m, summary.radio_first_path_std_m) {
        print(&format!(
            "  median spread of the registered first path {own:.4} m, of the radio's index {radio:.4} m"
        ));
    }
    if let Some(bias) = &summary.bias_m {
        let radio = summary.radio_bias_m.map_or_else(String::new, |bias| {
            format!("; the radio's {:.3} m, {:.3} m", bias.median, bias.std)
        });
        print(&format!(
            "  median error of a link {:.3} m, spread from link to link {:.3} m{radio}",
            bias.median, bias.std
        ));
    }
    if let Some(left) = summary.residual_share {
        print(&format!("  median residual energy {}", percent(Some(left))));
    }
}

fn write_csv(file: &mut dyn Write, estimated: &[Estimated]) -> std::io::Result<()> {
    writeln!(
        file,
        "recording,cycle,anchor,first_path_range_m,delay_s,range_m,delay_std_s,real,imaginary,sinr_db"
    )?;
    for recording in estimated {
        // A name may hold anything on one line.
        let name = recording.name.replace('"', "\"\"");
        for frame in &recording.frames {
            let first_path = frame.first_path.map_or_else(String::new, |first| first.range_m.to_string());
            for path in &frame.paths {
                let [re, im] = path.amplitude;
                writeln!(
                    file,
                    "\"{name}\",{},{},{first_path},{:e},{},{:e},{:e},{:e},{}",
                    frame.cycle,
                    frame.anchor,
                    path.delay_s,
                    path.range_m,
                    path.delay_std_s,
                    re,
                    im,
                    path.sinr_db,
                )?;
            }
        }
    }
    Ok(())
}
