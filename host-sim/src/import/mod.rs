//! Importers: data of other people, in their own formats, become [`Recording`](crate::recording::Recording)s.
//!
//! An importer gives the tracker only what a tag in the field would have had. Truth goes into the recording for
//! scoring alone.

mod bp_slam;
mod miluv;
mod snapshot;
mod warsaw;

pub use bp_slam::bp_slam;
pub use miluv::{Miluv, MiluvOptions, miluv};
pub use snapshot::{SnapshotOptions, snapshot};
pub use warsaw::warsaw;

use std::path::Path;

use serde::de::DeserializeOwned;

use crate::input_error::{InputError, in_one_line};

const SPEED_OF_LIGHT_M_S: f64 = 299_792_458.0;
/// The time between two samples of a DW1000's accumulator: half a cycle of 499.2 MHz.
const DW1000_SAMPLE_SPACING_S: f64 = 1.0016e-9;

/// The rows of a CSV file with a header, each with its line.
fn csv_rows<T: DeserializeOwned>(path: &Path) -> Result<Vec<(u64, T)>, InputError> {
    let mut reader = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .from_path(path)
        .map_err(|error| InputError::new(path, format!("cannot be opened: {}", in_one_line(error))))?;
    let headers = reader.headers().map_err(|error| csv_error(path, &error))?.clone();
    let mut rows = Vec::new();
    for record in reader.records() {
        let record = record.map_err(|error| csv_error(path, &error))?;
        let line = record.position().map_or(0, csv::Position::line);
        let row =
            record.deserialize(Some(&headers)).map_err(|error| csv_error(path, &error).at_line(line))?;
        rows.push((line, row));
    }
    if rows.is_empty() {
        return Err(InputError::new(path, "has no rows"));
    }
    Ok(rows)
}

fn csv_error(path: &Path, error: &csv::Error) -> InputError {
    let line = error.position().map(csv::Position::line);
    // The line is ours to say; the rest of the library's sentence repeats it.
    let reason = match error.kind() {
        csv::ErrorKind::Deserialize { err, .. } => match err.kind() {
            csv::DeserializeErrorKind::Message(message) => message.clone(),
            kind => in_one_line(kind),
        },
        csv::ErrorKind::UnequalLengths { expected_len, len, .. } => {
            format!("has {len} columns where the header has {expected_len}")
        }
        _ => in_one_line(error),
    };
    InputError::new(path, reason).at_line(line)
}

/// A number of a CSV row must be one.
fn finite(path: &Path, line: u64, column: &str, value: f64) -> Result<f64, InputError> {
    if value.is_finite() {
        return Ok(value);
    }
    Err(InputError::new(path, format!("is {value}"))
        .at_line(line)
        .for_item(column)
        .allowed("any finite number"))
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    /// The folder of outside data, which is not a part of the project; tests without it say so and pass.
    pub(super) fn shared_data(name: &str) -> Option<PathBuf> {
        let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../shared/data").join(name);
        if folder.is_dir() {
            return Some(folder);
        }
        eprintln!("skipped: there is no {}", folder.display());
        None
    }
}
