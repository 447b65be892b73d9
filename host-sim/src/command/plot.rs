//! `cogmint plot`: pictures of scenarios and recordings.

use super::{OUTPUT_FOLDER, print, print_json, write_picture};
use crate::Failure;
use cogmint::recording::Recording;
use cogmint::scenario::Scenario;
use cogmint::simulator::Simulator;
use cogmint::view;
use serde::Serialize;
use std::path::{Path, PathBuf};

#[derive(clap::Subcommand)]
pub enum Subject {
    /// One cycle of a recording: received signals with true and estimated paths.
    Channel(ChannelOptions),
    /// A scenario's floor plan: anchors, virtual anchors, way, and which paths are visible where.
    Room(ScenarioOptions),
    /// How carriers differ in a scenario: SINR of every path over the carrier, error bound over carrier and way.
    Carriers(ScenarioOptions),
}

#[derive(clap::Args)]
pub struct ChannelOptions {
    /// The recording's folder.
    folder: PathBuf,
    /// The cycle, counted from 0.
    #[arg(long, value_name = "N")]
    cycle: usize,
    /// One anchor alone, counted from 0.
    #[arg(long, value_name = "J")]
    anchor: Option<usize>,
    #[command(flatten)]
    output: Output,
}

#[derive(clap::Args)]
pub struct ScenarioOptions {
    /// A built-in scenario's name, or a scenario file.
    scenario: String,
    /// Which of the scenario's trajectories, counted from 0.
    #[arg(long, value_name = "K", default_value_t = 0)]
    trajectory: usize,
    #[command(flatten)]
    output: Output,
}

#[derive(clap::Args)]
struct Output {
    /// Where the figure goes, without extension.
    #[arg(long, value_name = "PATH")]
    plot: Option<PathBuf>,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Outcome<T: Serialize> {
    #[serde(flatten)]
    content: T,
    figure: [PathBuf; 2],
}

#[derive(Serialize)]
struct Nothing {}

pub fn run(subject: &Subject) -> Result<(), Failure> {
    match subject {
        Subject::Channel(options) => channel(options),
        Subject::Room(options) => {
            let simulator = simulator(options)?;
            let picture = view::room::picture(&simulator);
            finish(&options.output, &picture, &format!("{}-room", stem(&options.scenario)), Nothing {})
        }
        Subject::Carriers(options) => carriers(options),
    }
}

fn simulator(options: &ScenarioOptions) -> Result<Simulator, Failure> {
    let (scenario, folder) = Scenario::find(&options.scenario)?;
    Ok(Simulator::new(&scenario, folder.as_deref(), options.trajectory, None)?)
}

fn channel(options: &ChannelOptions) -> Result<(), Failure> {
    let recording = Recording::read(&options.folder)?;
    let picture = view::channel::picture(&recording, &options.folder, options.cycle, options.anchor)?;
    let name = format!("{}-channel-{}", stem(&options.folder.to_string_lossy()), options.cycle);
    finish(&options.output, &picture, &name, Nothing {})
}

fn carriers(options: &ScenarioOptions) -> Result<(), Failure> {
    let simulator = simulator(options)?;
    let carriers = view::carriers::compare(&simulator);
    if !options.output.json {
        // Every fourth carrier of a long library is enough to see how they differ.
        let every = carriers.carrier_hz.len().div_ceil(10);
        let shown: Vec<usize> = (0..carriers.carrier_hz.len()).step_by(every).collect();
        let heading: String =
            shown.iter().map(|&n| format!("{:>7.2}", carriers.carrier_hz[n] * 1e-9)).collect();
        print(&format!("{}: mean SINR in dB where visible, over the carrier in GHz\n", carriers.scenario));
        print(&format!("{:<16} visible{heading}  spread", "path"));
        for source in &carriers.sources {
            let label = source.virtual_anchor.map_or_else(|| "direct".into(), |index| format!("VA {index}"));
            let values: String = shown.iter().map(|&n| format!("{:>7.1}", source.sinr_db[n])).collect();
            print(&format!(
                "{:<16} {:>5.0} %{values} {:>7.1}",
                format!("{} {label}", source.anchor),
                100.0 * source.visible,
                source.spread_db
            ));
        }
        let bounds: String =
            shown.iter().map(|&n| format!("{:>7.1}", 1e3 * carriers.median_error_bound_m[n])).collect();
        print(&format!("\n{:<16}        {bounds}", "error bound, mm"));
        print(&format!(
            "Median spread {:.1} dB; median error bound with the best carrier everywhere {:.1} mm.",
            carriers.median_spread_db,
            1e3 * carriers.best_median_error_bound_m
        ));
    }
    finish(&options.output, &carriers.picture(), &format!("{}-carriers", stem(&options.scenario)), &carriers)
}

/// Writes the picture and says where it is.
fn finish(
    output: &Output,
    picture: &cogmint::plot::Picture,
    name: &str,
    content: impl Serialize,
) -> Result<(), Failure> {
    let to = output.plot.clone().unwrap_or_else(|| Path::new(OUTPUT_FOLDER).join(name));
    let figure = write_picture(picture, &to)?;
    if output.json {
        return print_json(&Outcome { content, figure });
    }
    print(&format!("Figure: {}", figure[1].display()));
    Ok(())
}

/// The name that a figure of a file, folder or built-in scenario gets.
fn stem(name: &str) -> String {
    let stem = Path::new(name).file_stem().map(|stem| stem.to_string_lossy().into_owned());
    stem.unwrap_or_else(|| "figure".into())
}
