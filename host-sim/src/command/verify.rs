//! `cogmint verify`: the core against the float reference.

use crate::Failure;
use std::path::PathBuf;

#[derive(clap::Args)]
pub struct Options {
    /// A recording's folder; the built-in room where none is given.
    #[arg(long, value_name = "DIR")]
    recording: Option<PathBuf>,
}

pub fn run(_options: &Options) -> Result<(), Failure> {
    Ok(())
}
