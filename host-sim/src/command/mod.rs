//! The command's subcommands: each parses its options, calls the library, prints.

pub mod calibrate;
pub mod demo;
pub mod estimate;
pub mod experiment;
pub mod import;
pub mod plan;
pub mod plot;
pub mod scenario;
pub mod simulate;
pub mod thin;
pub mod trace;
pub mod track;
pub mod verify;

use crate::Failure;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use cogmint::calibrate::file::Calibration;
use cogmint::cycle_choice::CycleChoice;
use cogmint::input_error::InputError;
use cogmint::plot::Picture;
use cogmint::recording::{META_FILE, Recording};
use cogmint::replay::TrackerVariant;
use cogmint::whole_file;
use cogmint_core::Variant;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde::Serialize;
use std::io::{IsTerminal, Write};
use std::path::{Path, PathBuf};

/// Where figures go unless told otherwise.
const OUTPUT_FOLDER: &str = "cogmint-out";

/// The variants of the core's tracker by name, with what the help says of them.
fn named_variants() -> [PossibleValue; Variant::ALL.len()] {
    Variant::ALL.map(|variant| {
        let summary = match variant {
            Variant::Conventional => "virtual anchors exactly where the floor plan has them, held fixed, none discovered; MAP association",
            Variant::Probabilistic => "virtual anchors as random variables, also discovered; MAP association",
            Variant::Soft => "the same, with every association weighted by its probability",
        };
        PossibleValue::new(variant.name()).help(summary)
    })
}

/// Parses the name of a variant of the core's tracker; the help lists the names.
fn variants() -> impl TypedValueParser<Value = Variant> {
    // The parser before lets no other name pass.
    PossibleValuesParser::new(named_variants())
        .map(|name| Variant::ALL.into_iter().find(|variant| variant.name() == name).unwrap_or(Variant::Soft))
}

/// The same, and the tracker without any reflection, where that is to be compared.
fn tracker_variants() -> impl TypedValueParser<Value = TrackerVariant> {
    let direct = PossibleValue::new(TrackerVariant::Direct.name())
        .help("no virtual anchor known or discovered: every reflection is clutter");
    let named = named_variants().into_iter().chain([direct]);
    PossibleValuesParser::new(named).map(|name| {
        TrackerVariant::ALL.into_iter().find(|variant| variant.name() == name).unwrap_or_default()
    })
}

/// A progress bar over cycles on the terminal; silent where there is none.
fn progress(length: usize, what: &str) -> ProgressBar {
    progress_of(length, what, "cycles")
}

/// A progress bar over anything.
fn progress_of(length: usize, what: &str, unit: &str) -> ProgressBar {
    let target = if std::io::stderr().is_terminal() {
        ProgressDrawTarget::stderr()
    } else {
        ProgressDrawTarget::hidden()
    };
    let bar = ProgressBar::with_draw_target(Some(length as u64), target);
    let template = format!("{{msg:12}} [{{bar:40}}] {{pos}}/{{len}} {unit}, {{eta}} left");
    if let Ok(style) = ProgressStyle::with_template(&template) {
        bar.set_style(style.progress_chars("=> "));
    }
    bar.set_message(what.to_owned());
    bar
}

/// Prints to standard output. A closed pipe ends the printing; any other failure, such as a full disk, the command.
fn print(text: &str) {
    if let Err(error) = writeln!(std::io::stdout(), "{text}")
        && error.kind() != std::io::ErrorKind::BrokenPipe
    {
        eprintln!("cogmint: standard output: {error}");
        std::process::exit(1);
    }
}

fn print_json(value: &impl Serialize) -> Result<(), Failure> {
    print(&serde_json::to_string_pretty(value).map_err(|error| Failure::Work(error.to_string()))?);
    Ok(())
}

/// Writes a picture as SVG and PNG, making the folder first; `to` has no extension.
fn write_picture(picture: &Picture, to: &Path) -> Result<[PathBuf; 2], Failure> {
    Ok(picture.write(to)?)
}

/// Refuses, before the work, a file to write that cannot be written, or that a recording would be broken by.
fn check_writable(to: &Path) -> Result<(), Failure> {
    if Recording::is_part_of_one(to) {
        return Err(InputError::new(to, "is part of a recording, which it would overwrite").into());
    }
    Ok(whole_file::check(to)?)
}

/// The recording of a folder, or of the built-in seminar room where none is given, with the name to speak of it.
fn recording_or_room(
    folder: Option<&Path>,
    seed: u64,
    cycles: usize,
) -> Result<(Recording, PathBuf), Failure> {
    match folder {
        Some(folder) => Ok((Recording::read(folder)?, folder.to_owned())),
        None => {
            let room = cogmint::demo::seminar_room(seed, cycles)?;
            let run = cogmint::demo::run(&room, true, seed, || {})?;
            Ok((run.recording, PathBuf::from("the seminar room")))
        }
    }
}

/// How what a device is told is printed.
#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Format {
    /// For people.
    Table,
    /// As a file keeps it.
    Toml,
    /// Constants for firmware.
    Rust,
}

/// A recording as the tracker is told it: with a calibration where one is given, and the truth of the cycles to be scored.
fn told_recording(
    folder: &Path,
    calibration: Option<&Path>,
    scored: CycleChoice,
) -> Result<Recording, InputError> {
    let recording = Recording::read(folder)?;
    let recording = match calibration {
        Some(path) => Calibration::read(path)?.applied(recording, path)?,
        None => recording,
    };
    if scored == CycleChoice::All { Ok(recording) } else { scored.scored(recording, folder) }
}

/// The folders themselves where they are recordings, else the recordings in them.
fn recordings_in(folders: &[PathBuf]) -> Result<Vec<PathBuf>, InputError> {
    let mut found = Vec::new();
    for folder in folders {
        if folder.join(META_FILE).is_file() {
            found.push(folder.clone());
            continue;
        }
        let mut inside: Vec<PathBuf> = std::fs::read_dir(folder)
            .map_err(|_| InputError::new(folder, "is not a folder with a recording"))?
            .filter_map(|entry| entry.ok().map(|entry| entry.path()))
            .filter(|path| path.join(META_FILE).is_file())
            .collect();
        if inside.is_empty() {
            return Err(InputError::new(folder, "is not a folder with a recording or with folders of them"));
        }
        // `link_5` comes before `link_10`.
        inside.sort_by_key(|path| (path.as_os_str().len(), path.clone()));
        found.append(&mut inside);
    }
    Ok(found)
}

/// A length in metres for a table, or a dash.
fn metres(value: Option<f64>) -> String {
    value.map_or_else(|| "-".into(), |value| format!("{value:.3}"))
}
