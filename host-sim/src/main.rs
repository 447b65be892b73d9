//! The `cogmint` command.

mod command;

use clap::{Parser, Subcommand};
use cogmint::input_error::InputError;
use std::io;
use std::process::ExitCode;

/// Cognitive, multipath-assisted UWB tracking: simulate, import, replay, verify.
///
/// Without a command: simulates the built-in room twice, with a fixed carrier and with the tracker's own choice,
/// prints a table and draws both.
#[derive(Parser)]
#[command(version, args_conflicts_with_subcommands = true)]
struct Arguments {
    #[command(subcommand)]
    command: Option<Command>,
    #[command(flatten)]
    demo: command::demo::Options,
}

#[derive(Subcommand)]
enum Command {
    /// Turn data of others into recordings.
    #[command(subcommand)]
    Import(command::import::Source),
    /// Check, list and show scenarios.
    #[command(subcommand)]
    Scenario(command::scenario::Action),
    /// Print what a device is told of a floor plan: walls, anchors, and virtual anchors in order of use.
    Plan(command::plan::Options),
    /// Make a recording of a scenario.
    Simulate(command::simulate::Options),
    /// Draw a scenario or a cycle of a recording.
    #[command(subcommand)]
    Plot(command::plot::Subject),
    /// Measure a stage of the system in many random trials.
    #[command(subcommand)]
    Experiment(command::experiment::Experiment),
    /// Estimate the paths in the frames of recordings: first-path ranges beside the radio's own, residual energy.
    Estimate(command::estimate::Options),
    /// Estimate range biases (antenna delays), anchors' positions, errors of ranges and the pulse from recordings.
    Calibrate(command::calibrate::Options),
    /// Replay a recording through the core: table, figure, scores.
    Track(command::track::Options),
    /// Compare the core with the float reference, bit for bit.
    Verify(command::verify::Options),
    /// Make a recording of some of the cycles and ranges of another.
    Thin(command::thin::Options),
    /// Print the golden trace: a hash over all state after every cycle.
    Trace(command::trace::Options),
}

/// Why a command failed.
pub enum Failure {
    /// Bad usage or input: exit code 2.
    Input(InputError),
    /// The work itself failed: exit code 1.
    Work(String),
}

impl From<InputError> for Failure {
    fn from(error: InputError) -> Self {
        Self::Input(error)
    }
}

impl From<io::Error> for Failure {
    fn from(error: io::Error) -> Self {
        Self::Work(error.to_string())
    }
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let outcome = match arguments.command {
        None => command::demo::run(&arguments.demo),
        Some(Command::Import(source)) => command::import::run(&source),
        Some(Command::Scenario(action)) => command::scenario::run(&action),
        Some(Command::Plan(options)) => command::plan::run(&options),
        Some(Command::Simulate(options)) => command::simulate::run(&options),
        Some(Command::Plot(subject)) => command::plot::run(&subject),
        Some(Command::Experiment(experiment)) => command::experiment::run(&experiment),
        Some(Command::Estimate(options)) => command::estimate::run(&options),
        Some(Command::Calibrate(options)) => command::calibrate::run(&options),
        Some(Command::Track(options)) => command::track::run(&options),
        Some(Command::Verify(options)) => command::verify::run(&options),
        Some(Command::Thin(options)) => command::thin::run(&options),
        Some(Command::Trace(options)) => command::trace::run(&options),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(Failure::Input(error)) => {
            eprintln!("cogmint: {error}");
            ExitCode::from(2)
        }
        Err(Failure::Work(reason)) => {
            eprintln!("cogmint: {reason}");
            ExitCode::FAILURE
        }
    }
}
