//! `cogmint experiment rooms`: trackers side by side in random rooms.

use super::super::progress_of;
use super::{print, print_json};
use crate::Failure;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use cogmint::experiment::rooms::setting::BeliefSetting;
use cogmint::experiment::rooms::summary::{Group, Summary, TrackerFigures, groups};
use cogmint::experiment::rooms::{RoomRuns, Wrong, run_rooms};
use cogmint::experiment::side_by_side::Tracker;
use cogmint::experiment::side_by_side::run::Run;
use cogmint::input_error::InputError;
use cogmint::rooms::{
    Defect, Disturbance, Drawn, Family, Incident, Plan, RandomRoom, Restriction, Start, room,
};
use cogmint::whole_file;
use serde::Serialize;
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
pub struct Options {
    /// Number of rooms.
    #[arg(long, default_value_t = 100, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    count: u32,
    /// Seed of the first room; the others count on.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u64).range(0..=9_007_199_254_000_000))]
    seed: u64,
    /// Draw these kinds of floor plan only, separated by commas.
    #[arg(long, value_delimiter = ',', value_name = "NAME", value_parser = one_of(&Family::ALL, Family::name))]
    family: Vec<Family>,
    /// Tell the plan only so: exact, images of first order within 0.1 m or 0.3 m, one wall wrong, or nothing.
    #[arg(long, value_delimiter = ',', value_name = "NAME", value_parser = one_of(&Plan::ALL, Plan::name))]
    plan: Vec<Plan>,
    /// Tell the start only so: within a disc of 0.25 m or 1 m, or nothing.
    #[arg(long, value_delimiter = ',', value_name = "NAME", value_parser = one_of(&Start::ALL, Start::name))]
    start: Vec<Start>,
    /// Draw these kinds of interference only.
    #[arg(long, value_delimiter = ',', value_name = "NAME", value_parser = one_of(&Disturbance::ALL, Disturbance::name))]
    interference: Vec<Disturbance>,
    /// Draw so many anchors only, 1 to 8, separated by commas.
    #[arg(long, value_delimiter = ',', value_name = "N", value_parser = clap::value_parser!(u8).range(1..=8))]
    anchors: Vec<u8>,
    /// What happens in every room besides, and no tracker is told of: an anchor is 3 m off, drifts by 0.1 m/s or is moved by 2 m;
    /// no frame arrives for up to 10 s, or only clutter does; or the tag is carried elsewhere, unheard (docs/rooms.md).
    #[arg(long, value_name = "NAME", value_parser = one_of(&Incident::ALL, Incident::name), conflicts_with_all = ["draw", "write"])]
    incident: Option<Incident>,
    /// What is wrong with the radio in every room, and no tracker is told of: pulses are told 20 % too long, their peak is 0.1 m late,
    /// samples have 8 bits, or pulses have side lobes of -10 dB (docs/rooms.md).
    #[arg(long, value_name = "NAME", value_parser = one_of(&Defect::ALL, Defect::name), conflicts_with_all = ["incident", "draw", "write"])]
    defect: Option<Defect>,
    /// Change a setting of the core's belief, to see what a part of it is worth; more than once for several. `components=N` sets
    /// `comparisons` to N times the number of anchors (docs/rooms.md).
    #[arg(long, value_name = "NAME=VALUE", conflicts_with = "draw")]
    belief: Vec<BeliefSetting>,
    /// Run these trackers only; without, all but particles.
    #[arg(long, value_delimiter = ',', value_name = "TRACKER", value_parser = one_of(&Tracker::ALL, Tracker::name))]
    only: Vec<Tracker>,
    /// Write every room as a scenario file into this folder.
    #[arg(long, value_name = "DIR")]
    write: Option<PathBuf>,
    /// Draw the rooms (and write them) without running any tracker.
    #[arg(long, conflicts_with_all = ["only", "csv"])]
    draw: bool,
    /// Write one row per room and tracker into this file.
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// Print one JSON object instead of tables.
    #[arg(long)]
    json: bool,
}

/// Parses one of a few named values.
pub(super) fn one_of<T: Copy + Send + Sync + 'static>(
    all: &'static [T],
    name: fn(T) -> &'static str,
) -> impl TypedValueParser<Value = T> {
    let parser = PossibleValuesParser::new(all.iter().map(move |&value| name(value)));
    // The parser before lets no other name pass.
    parser.map(move |text| all.iter().copied().find(|&value| name(value) == text).unwrap_or(all[0]))
}

/// The trackers asked for, each once; the usual ones where none is named.
pub(super) fn asked(only: &[Tracker]) -> Vec<Tracker> {
    let mut asked = Vec::new();
    for &tracker in if only.is_empty() { &Tracker::USUAL } else { only } {
        if !asked.contains(&tracker) {
            asked.push(tracker);
        }
    }
    asked
}

/// What `--json` prints.
#[derive(Serialize)]
struct Answer<'a> {
    seed: u64,
    #[serde(skip_serializing_if = "Option::is_none")]
    incident: Option<Incident>,
    #[serde(skip_serializing_if = "Option::is_none")]
    defect: Option<Defect>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    belief: Vec<String>,
    #[serde(flatten)]
    summary: Summary,
    groups: Vec<Group>,
    runs: Vec<Row<'a>>,
}

/// One tracker in one room.
#[derive(Serialize)]
struct Row<'a> {
    #[serde(flatten)]
    drawn: Drawn,
    #[serde(skip_serializing_if = "Option::is_none")]
    incident: Option<Incident>,
    #[serde(skip_serializing_if = "Option::is_none")]
    defect: Option<Defect>,
    answerable: bool,
    bound_m: Option<f64>,
    paths_per_frame: f64,
    direct_detected_least: f64,
    #[serde(flatten)]
    run: &'a Run,
}

pub fn run(options: &Options) -> Result<(), Failure> {
    let restriction = Restriction {
        families: options.family.clone(),
        plans: options.plan.clone(),
        starts: options.start.clone(),
        interference: options.interference.clone(),
        anchors: options.anchors.iter().map(|&count| usize::from(count)).collect(),
    };
    let seeds = options.seed..options.seed + u64::from(options.count);
    let rooms: Vec<RandomRoom> =
        seeds.map(|seed| room(seed, &restriction)).collect::<Result<_, InputError>>()?;
    if let Some(folder) = &options.write {
        write_rooms(&rooms, folder)?;
    }
    if let Some(file) = &options.csv {
        whole_file::check(file)?;
    }
    if options.draw {
        return print_drawn(&rooms, options.json);
    }
    let trackers = asked(&options.only);
    // The command line takes one of them only.
    let wrong = options.incident.map(Wrong::Incident).or(options.defect.map(Wrong::Defect));
    let bar = progress_of(rooms.len(), "tracking", "rooms");
    let runs = run_rooms(&rooms, wrong, &options.belief, &trackers, || bar.inc(1))?;
    bar.finish_and_clear();
    let rows: Vec<Row> = runs.iter().flat_map(|room| rows(room, options)).collect();
    if let Some(file) = &options.csv {
        write_csv(&rows, file)?;
    }
    let everything: Vec<&RoomRuns> = runs.iter().collect();
    let summary = Summary::new(&everything);
    if options.json {
        return print_json(&Answer {
            seed: options.seed,
            incident: options.incident,
            defect: options.defect,
            belief: options.belief.iter().map(BeliefSetting::to_string).collect(),
            summary,
            groups: groups(&runs),
            runs: rows,
        });
    }
    print(&format!(
        "{} random rooms, seeds from {}; {} answerable\n",
        summary.rooms, options.seed, summary.answerable
    ));
    if let Some(defect) = options.defect {
        print(&format!("defect of every radio: {}\n", defect.name()));
    }
    for setting in &options.belief {
        print(&format!("belief: {setting}\n"));
    }
    print_figures("answerable rooms", &summary.trackers_answerable);
    print_figures("all rooms", &summary.trackers);
    print_claims(&summary.trackers_answerable);
    if let Some(incident) = options.incident {
        print_incident(incident, &summary.trackers);
    }
    print_groups(&groups(&runs));
    print_lost(&runs);
    for tracker in &trackers {
        let of_room = |room: &RoomRuns| -> f64 {
            let runs = room.trackers.runs.iter().zip(&room.trackers.seconds);
            runs.filter(|(run, _)| run.tracker == tracker.name()).map(|(_, seconds)| seconds).sum()
        };
        let seconds: f64 = runs.iter().map(of_room).sum();
        eprintln!("{}: {seconds:.1} s in all rooms", tracker.name());
    }
    Ok(())
}

fn rows<'a>(room: &'a RoomRuns, options: &Options) -> impl Iterator<Item = Row<'a>> + use<'a> {
    let trackers = &room.trackers;
    let (incident, defect) = (options.incident, options.defect);
    trackers.runs.iter().map(move |run| Row {
        drawn: room.drawn,
        incident,
        defect,
        answerable: room.is_answerable(),
        bound_m: trackers.bound_m,
        paths_per_frame: trackers.paths_per_frame,
        direct_detected_least: trackers.direct_detected.iter().copied().fold(1.0, f64::min),
        run,
    })
}

fn write_rooms(rooms: &[RandomRoom], folder: &Path) -> Result<(), Failure> {
    let failed = |error: &dyn std::fmt::Display| Failure::Work(format!("{}: {error}", folder.display()));
    for room in rooms {
        let text = room.scenario.to_toml().map_err(|error| failed(&error))?;
        let file = folder.join(format!("room-{:06}.toml", room.drawn.seed));
        whole_file::write(&file, |to| to.write_all(text.as_bytes()))?;
    }
    Ok(())
}

fn write_csv(rows: &[Row], file: &Path) -> Result<(), Failure> {
    whole_file::write(file, |to| {
        let mut writer = csv::Writer::from_writer(to);
        for (index, row) in rows.iter().enumerate() {
            // Nested rows have no header of their own: each becomes a flat object first.
            let value = serde_json::to_value(row)?;
            let Some(object) = value.as_object() else { continue };
            if index == 0 {
                writer.write_record(object.keys())?;
            }
            let cell = |value: &serde_json::Value| match value {
                serde_json::Value::Null => String::new(),
                serde_json::Value::String(text) => text.clone(),
                other => other.to_string(),
            };
            writer.write_record(object.values().map(cell))?;
        }
        writer.flush()
    })?;
    Ok(())
}

fn print_drawn(rooms: &[RandomRoom], json: bool) -> Result<(), Failure> {
    if json {
        let drawn: Vec<&Drawn> = rooms.iter().map(|room| &room.drawn).collect();
        return print_json(&drawn);
    }
    print(
        "    seed family    walls anchors radio             rate Hz cycles motion      plan  start    interference people lost",
    );
    for RandomRoom { drawn, .. } in rooms {
        print(&format!(
            "{:>8} {:<10} {:>4} {:>7} {:<17} {:>7.1} {:>6} {:<11} {:<5} {:<8} {:<12} {:>6} {:>4.2}",
            drawn.seed,
            drawn.family.name(),
            drawn.walls,
            drawn.anchors,
            drawn.radio.name(),
            drawn.rate_hz,
            drawn.cycles,
            drawn.motion.name(),
            drawn.plan.name(),
            drawn.start.name(),
            drawn.interference.name(),
            drawn.people,
            drawn.lost_frames,
        ));
    }
    Ok(())
}

pub(super) fn number(value: Option<f64>, digits: usize) -> String {
    value.map_or_else(|| "-".into(), |value| format!("{value:.digits$}"))
}

fn percent(value: Option<f64>) -> String {
    value.map_or_else(|| "-".into(), |value| format!("{:.1}", 100.0 * value))
}

fn print_figures(what: &str, trackers: &[TrackerFigures]) {
    print(&format!("Over {what}"));
    print(
        "            lost %   (95 %)       RMSE m    (95 %)         RMSE m over   over   lies search inside   >5   NEES  known after losses",
    );
    print(
        "tracker                           median                      p90  told  bound      %      %   95 % sigma   /dof            s   said",
    );
    for tracker in trackers {
        let interval = |interval: Option<[f64; 2]>, scale: f64, digits: usize| {
            interval.map_or_else(
                || "-".into(),
                |[low, high]| format!("{:.digits$} to {:.digits$}", scale * low, scale * high),
            )
        };
        print(
            format!(
                "{:<10} {:>7} {:>14} {:>7} {:>15} {:>9} {:>5} {:>6} {:>6} {:>6} {:>6} {:>5} {:>6} {:>12} {:>6}",
                tracker.name,
                percent(tracker.lost_share),
                interval(tracker.lost_share_interval, 100.0, 1),
                number(tracker.rmse_median_m, 3),
                interval(tracker.rmse_median_interval_m, 1.0, 3),
                number(tracker.rmse_p90_m, 3),
                number(tracker.ratio_to_told_median, 2),
                number(tracker.ratio_to_bound_median, 2),
                percent(tracker.confident_lies_share),
                percent(tracker.searching_share),
                percent(tracker.inside_95_share),
                percent(tracker.above_5_sigma_share),
                number(tracker.nees_median, 2),
                number(tracker.first_known_median_s, 1),
                number(tracker.losses_said_mean, 1),
            )
            .trim_end(),
        );
    }
    print("");
}

/// How far a probability above 0.9 can be relied on, of trackers that give one.
fn print_claims(answerable: &[TrackerFigures]) {
    for tracker in answerable.iter().filter(|tracker| tracker.sure_right_share.is_some()) {
        print(&format!(
            "{}, answerable rooms: where its probability is above 0.9, the error is below 1 m or 3 claimed deviations in {} % of the cycles\n",
            tracker.name,
            percent(tracker.sure_right_share),
        ));
    }
}

/// What an incident did to the trackers, over all rooms.
fn print_incident(incident: Incident, trackers: &[TrackerFigures]) {
    print(&format!("Incident in all rooms: {}", incident.name()));
    print("            ends above 1 m   unheard: lies   above 3 sigma   found within 5 s");
    for tracker in trackers {
        print(&format!(
            "{:<10} {:>15} {:>15} {:>15} {:>18}",
            tracker.name,
            percent(tracker.end_above_1_m_share),
            percent(tracker.unheard_lies_share),
            percent(tracker.unheard_above_3_sigma_share),
            percent(tracker.found_within_5_s_share),
        ));
    }
    print("");
}

/// By every draw: rooms, and per tracker the share lost and the median error, over answerable rooms and over all.
fn print_groups(groups: &[Group]) {
    let Some(first) = groups.first() else { return };
    let head: String =
        first.trackers.iter().map(|tracker| format!(" {:>12} {:>12}", tracker.name, "")).collect();
    print(&format!("{:<13} {:<17} {:>5} {:>10}{head}", "by", "", "rooms", "answerable"));
    let columns: String =
        first.trackers.iter().map(|_| format!(" {:>12} {:>12}", "lost %", "RMSE m")).collect();
    print(&format!("{:<48}{columns}   (each: answerable / all)", ""));
    for group in groups {
        // Without an answerable room there are no figures for any tracker.
        let cells: String = group
            .trackers
            .iter()
            .map(|all| {
                let of = |value: fn(&TrackerFigures) -> String| {
                    let answerable = group.trackers_answerable.iter().find(|one| one.name == all.name);
                    format!("{} / {}", answerable.map_or_else(|| "-".into(), value), value(all))
                };
                let lost = of(|figures| {
                    figures.lost_share.map_or_else(|| "-".into(), |share| format!("{:.0}", 100.0 * share))
                });
                format!(" {lost:>12} {:>12}", of(|figures| number(figures.rmse_median_m, 2)))
            })
            .collect();
        print(&format!(
            "{:<13} {:<17} {:>5} {:>10}{cells}",
            group.by, group.value, group.rooms, group.answerable
        ));
    }
    print("");
}

/// Which runs to look at.
fn print_lost(rooms: &[RoomRuns]) {
    let Some(first) = rooms.first() else { return };
    for (index, run) in first.trackers.runs.iter().enumerate() {
        let lost = rooms.iter().filter(|room| room.is_answerable() && room.trackers.runs[index].lost);
        let seeds: Vec<String> = lost.map(|room| room.drawn.seed.to_string()).collect();
        if !seeds.is_empty() {
            print(&format!("{} lost in answerable rooms: seeds {}", run.tracker, seeds.join(", ")));
        }
    }
}
