//! Estimates of a recording: one cycle's responses with their paths, and the first paths over all frames.

use super::channel;
use crate::estimate::{EstimatedFrame, Options, SPEED_OF_LIGHT_M_S};
use crate::input_error::InputError;
use crate::plot::{HeatMap, HeatRows, Picture, Series};
use crate::recording::{Recording, Samples};
use std::path::Path;

/// How much is shown before the earliest first path and behind the latest, metres.
const BEFORE_M: f64 = 5.0;
const BEHIND_M: f64 = 15.0;
/// Rows of the map.
const ROWS: usize = 200;
/// Columns of the map, at most: frames beyond are skipped evenly.
const COLUMNS: usize = 800;
/// Faintest colour, decibels below a frame's peak.
const FAINTEST_DB: f64 = -45.0;

/// The picture: a panel per response of `cycle`, then a map of all frames of the anchor shown first. `folder` is where
/// the recording is, for messages.
///
/// # Errors
/// The cycle is not there, or nothing was received in it.
pub fn picture(
    recording: &Recording,
    folder: &Path,
    options: &Options,
    frames: &[EstimatedFrame],
    cycle: usize,
) -> Result<Picture, InputError> {
    let picture = channel::picture_at(recording, folder, cycle, options.anchor, options.false_paths as f32)?;
    let shown = recording.cycles[cycle].frames.iter().map(|frame| frame.anchor);
    let anchor = options.anchor.or_else(|| shown.min()).unwrap_or(0);
    let own: Vec<&EstimatedFrame> = frames.iter().filter(|frame| frame.anchor == anchor).collect();
    Ok(match map(recording, anchor, &own) {
        Some(map) => picture.below(map),
        None => picture,
    })
}

/// The responses of an anchor as columns over range; none of a single frame, or without any first path.
fn map(recording: &Recording, anchor: usize, frames: &[&EstimatedFrame]) -> Option<HeatMap> {
    let firsts = || frames.iter().filter_map(|frame| frame.first_path.map(|path| path.range_m));
    if frames.len() < 2 || firsts().next().is_none() {
        return None;
    }
    let begin_m = recording
        .cycles
        .iter()
        .flat_map(|cycle| &cycle.frames)
        .filter(|raw| raw.anchor == anchor)
        .map(|raw| raw.first_sample_delay_s * SPEED_OF_LIGHT_M_S)
        .fold(f64::INFINITY, f64::min);
    let low_m = (firsts().fold(f64::INFINITY, f64::min) - BEFORE_M).max(begin_m);
    let high_m = firsts().fold(f64::NEG_INFINITY, f64::max) + BEHIND_M;
    let spacing_s = recording.radio.sample_spacing_s?;
    let every = frames.len().div_ceil(COLUMNS);
    let columns: Vec<&&EstimatedFrame> = frames.iter().step_by(every).collect();
    let mut values = vec![vec![f64::NAN; columns.len()]; ROWS];
    for (column, frame) in columns.iter().enumerate() {
        let raw = recording.cycles[frame.cycle].frames.iter().find(|raw| raw.anchor == anchor)?;
        let power: Vec<f64> = match &raw.samples {
            Samples::Complex(samples) => {
                samples.iter().map(|[re, im]| f64::from(*re).hypot(f64::from(*im)).powi(2)).collect()
            }
            Samples::Magnitude(samples) => samples.iter().map(|m| f64::from(*m).powi(2)).collect(),
        };
        let peak = power.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
        for (row, values) in values.iter_mut().enumerate() {
            let range_m = low_m + (row as f64 + 0.5) / ROWS as f64 * (high_m - low_m);
            let position = (range_m / SPEED_OF_LIGHT_M_S - raw.first_sample_delay_s) / spacing_s;
            if position >= 0.0
                && let Some(power) = power.get(position.round() as usize)
            {
                values[column] = (10.0 * (power / peak).log10()).max(FAINTEST_DB);
            }
        }
    }
    let line = |label: &str, faint: bool, range_m: &dyn Fn(&EstimatedFrame) -> Option<f64>| Series {
        label: label.into(),
        points: frames
            .iter()
            .enumerate()
            .filter_map(|(index, frame)| Some([index as f64 + 0.5, range_m(frame)?]))
            .collect(),
        faint,
    };
    let lines = [
        line("true range", false, &|frame| frame.true_range_m),
        line("radio's own range", false, &|frame| frame.radio_range_m),
        line("first path", false, &|frame| Some(frame.first_path?.range_m)),
    ];
    Some(HeatMap {
        title: format!("{}, anchor {}: all frames", recording.name, recording.anchors[anchor].name),
        x_label: "frame".into(),
        y_label: "range in m".into(),
        value_label: "dB under the frame's peak".into(),
        x: [0.0, frames.len() as f64],
        rows: HeatRows::Axis([low_m, high_m]),
        values,
        lines: lines.into_iter().filter(|line| !line.points.is_empty()).collect(),
        ..HeatMap::default()
    })
}
