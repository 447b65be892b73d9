//! `cogmint plan`: what a device is told of a floor plan.

use super::{Format, print, print_json};
use crate::Failure;
use cogmint::floor_plan::check::{Check, check};
use cogmint::floor_plan::export::Export;
use cogmint::input_error::InputError;
use cogmint::recording::Recording;
use cogmint::scenario::{Scenario, Told};
use std::path::Path;

#[derive(clap::Args)]
pub struct Options {
    /// A scenario file, a built-in scenario's name, or a recording's folder.
    file: String,
    /// How it is printed.
    #[arg(long, value_enum, default_value_t = Format::Table)]
    format: Format,
    /// Draw the walls' errors as a recording of this seed has them; without, the plan is told as it stands.
    #[arg(long)]
    seed: Option<u64>,
    /// Check the plan against the simulated channel instead: which sources have a path where it calls them unavailable or
    /// clear. All sources of the plan are looked at, also where recordings of the scenario do not tell it.
    #[arg(long, conflicts_with_all = ["format", "seed"])]
    check: bool,
    /// Print one JSON object.
    #[arg(long, conflicts_with = "format")]
    json: bool,
}

pub fn run(options: &Options) -> Result<(), Failure> {
    if options.check {
        if Path::new(&options.file).is_dir() {
            let reason = "is a recording, which cannot say where paths would be";
            return Err(InputError::new(&options.file, reason).allowed("a scenario").into());
        }
        let (scenario, folder) = Scenario::find(&options.file)?;
        let check = check(&scenario, folder.as_deref())?;
        if options.json {
            return print_json(&check);
        }
        print_check(&check, remark(&scenario));
        return Ok(());
    }
    let (export, remark) = find(options)?;
    if options.json {
        return print_json(&export);
    }
    match options.format {
        Format::Table => print_table(&export, remark),
        Format::Toml => {
            let text = export.to_toml().map_err(|error| Failure::Work(error.to_string()))?;
            print(text.trim_end());
        }
        Format::Rust => print(export.to_rust().trim_end()),
    }
    Ok(())
}

fn print_check(check: &Check, remark: &str) {
    if !remark.is_empty() {
        print(remark);
    }
    print("the plan calls a source     looks   with a path   share");
    let rows = [
        ("unavailable (below 0.1)", &check.unavailable),
        ("neither", &check.between),
        ("clear (above 0.9)", &check.clear),
    ];
    for (name, looks) in rows {
        let share = looks.share().map_or_else(|| "-".into(), |share| format!("{share:.3}"));
        print(&format!("{name:<24} {:>8} {:>13} {share:>7}", looks.looks, looks.with_path));
    }
}

fn find(options: &Options) -> Result<(Export, &'static str), Failure> {
    if Path::new(&options.file).is_dir() {
        if options.seed.is_some() {
            let reason = "is a recording, whose plan is drawn already";
            return Err(InputError::new(&options.file, reason).allowed("no --seed, or a scenario").into());
        }
        return Ok((Export::of_recording(&Recording::read(&options.file)?), ""));
    }
    let (scenario, _) = Scenario::find(&options.file)?;
    Ok((Export::of_scenario(&scenario, options.seed)?, remark(&scenario)))
}

/// What must be known of a plan that recordings do not tell.
fn remark(scenario: &Scenario) -> &'static str {
    let plan = &scenario.prior.floor_plan;
    match (plan.known, plan.told) {
        (false, _) => "Recordings of this scenario tell nothing of it: prior.floor_plan.known is false.",
        (true, Told::VirtualAnchors) => {
            "Recordings of this scenario tell virtual anchors along the way instead, each with an error of its own."
        }
        (true, Told::Walls) => "",
    }
}

fn print_table(export: &Export, remark: &str) {
    let walls = export.plan.as_ref().map_or(0, |plan| plan.walls.len());
    let count = |number: usize, what: &str| format!("{number} {what}{}", if number == 1 { "" } else { "s" });
    print(&format!(
        "{}: {}, {}, {}",
        export.name,
        count(walls, "wall"),
        count(export.anchors.len(), "anchor"),
        count(export.sources.len(), "source")
    ));
    if !remark.is_empty() {
        print(remark);
    }
    print("\nanchor      x_m      y_m  height_m  name");
    for (index, anchor) in export.anchors.iter().enumerate() {
        let [x, y] = anchor.position_m;
        print(&format!("{index:>6} {x:>8.3} {y:>8.3} {:>9.3}  {}", anchor.height_m, anchor.name));
    }
    if let Some(plan) = &export.plan {
        print("\n  wall  offset_std_m  rotation_std_deg  construction, segments_m");
        for (index, wall) in plan.walls.iter().enumerate() {
            let segment = |[[a, b], [c, d]]: &[[f64; 2]; 2]| format!("({a:.3}, {b:.3})-({c:.3}, {d:.3})");
            let segments: Vec<String> = wall.segments_m.iter().map(segment).collect();
            print(&format!(
                "{index:>6} {:>13.3} {:>17.2}  {}, {}",
                wall.offset_std_m,
                wall.rotation_std_rad.to_degrees(),
                wall.construction,
                segments.join(" ")
            ));
        }
    }
    print(
        "\nsource  anchor    walls      x_m      y_m    std_m  seen_share   (walls from the anchor on; a/b: in either order)",
    );
    let figure = |value: Option<f64>| value.map_or_else(|| "-".into(), |value| format!("{value:.2}"));
    for (index, source) in export.sources.iter().enumerate() {
        let walls: Vec<String> = source.walls.iter().map(|wall| wall.to_string()).collect();
        let between = if source.is_either_order == Some(true) { "/" } else { " " };
        let walls = if walls.is_empty() { "-".into() } else { walls.join(between) };
        let ([x, y], share) = (source.position_m, source.seen_share);
        print(&format!(
            "{index:>6} {:>7} {walls:>8} {x:>8.3} {y:>8.3} {:>8.3} {:>11}",
            source.anchor,
            source.std_m,
            figure(share)
        ));
    }
}
