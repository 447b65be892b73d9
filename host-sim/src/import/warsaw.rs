//! Static links in a flat in Warsaw (Kolakowski 2018): EVK1000 radios, repeated complex responses.

use std::path::Path;

use serde::Deserialize;

use super::{DW1000_SAMPLE_SPACING_S, SPEED_OF_LIGHT_M_S, csv_rows, finite};
use crate::input_error::InputError;
use crate::recording::npz::{Archive, Element};
use crate::recording::{
    Action, Anchor, AssociationModel, Cycle, Frame, Motion, Radio, Range, Recording, Samples, Start,
};

#[derive(Deserialize)]
struct LinkRow {
    link: u32,
    label: String,
    anchor: u32,
    anchor_x_m: f64,
    anchor_y_m: f64,
    tag: u32,
    tag_x_m: f64,
    tag_y_m: f64,
}

#[derive(Deserialize)]
struct WallRow {
    x1: f64,
    y1: f64,
    x2: f64,
    y2: f64,
}

/// Imports all links of the folder `dir`, which holds `links.csv`, `walls.csv` and `cir.npz`.
///
/// Each link becomes one recording, named `link_K`: its anchor, and the repeated responses and ranges as cycles one
/// second apart. The first sample's delay is such that the first-path index lies at the measured range. The start is
/// the middle of the walls with a deviation that covers the flat: one anchor's range alone cannot fix a position, so
/// these recordings serve the channel estimator.
///
/// # Errors
///
/// A file that cannot be read, a row that makes no sense, an array that is missing or has another shape.
pub fn warsaw(dir: &Path) -> Result<Vec<(String, Recording)>, InputError> {
    let start = start_within(&dir.join("walls.csv"))?;
    let links_path = dir.join("links.csv");
    let links: Vec<(u64, LinkRow)> = csv_rows(&links_path)?;
    let mut archive = Archive::open(&dir.join("cir.npz"))?;
    let mut recordings: Vec<(String, Recording)> = Vec::with_capacity(links.len());
    for (line, link) in &links {
        let name = format!("link_{}", link.link);
        if recordings.iter().any(|(other, _)| *other == name) {
            return Err(InputError::new(&links_path, format!("{} is there twice", link.link))
                .at_line(*line)
                .for_item("link"));
        }
        let number = |column: &str, value: f64| finite(&links_path, *line, column, value);
        let anchor_m = [number("anchor_x_m", link.anchor_x_m)?, number("anchor_y_m", link.anchor_y_m)?];
        let tag_m = [number("tag_x_m", link.tag_x_m)?, number("tag_y_m", link.tag_y_m)?];
        let cycles = read_cycles(&mut archive, link.link, tag_m, link.label.trim() == "LOS")?;
        recordings.push((name, recording_of(link, start, anchor_m, cycles)));
    }
    Ok(recordings)
}

fn recording_of(link: &LinkRow, start: Start, anchor_m: [f64; 2], cycles: Vec<Cycle>) -> Recording {
    let pulse_duration_s = 2e-9;
    Recording {
        name: format!("warsaw link {}", link.link),
        source: format!(
            "Imported from the responses measured in a flat in Warsaw (Kolakowski 2018, CC BY 4.0), link {}, {}: \
             EVK1000 radios on channel 2, anchor {} to the static tag {}. Repetitions are set one second apart; the \
             pulse's shape is assumed. One anchor's range alone cannot fix a position.",
            link.link, link.label, link.anchor, link.tag
        ),
        motion: Motion::of_acceleration(0.01),
        start,
        association: AssociationModel {
            detection_probability: 0.95,
            clutter_per_anchor: 0.1,
            max_range_m: 30.0,
        },
        radio: Radio {
            pulse_duration_s,
            roll_off: 0.5,
            sampled_pulse: None,
            gain_control: true,
            begins_with_path: true,
            sample_spacing_s: Some(DW1000_SAMPLE_SPACING_S),
            // The radio's usual scatter, and an antenna delay that is unknown.
            range_std_m: 0.1,
            range_bias_mean_m: 0.0,
            range_bias_std_m: 0.15,
            range_late_m: 0.0,
            range_floor_pulses: None,
        },
        anchors: vec![Anchor::new(format!("anchor {}", link.anchor), anchor_m, 0.0)],
        virtual_anchors: Vec::new(),
        walls: Vec::new(),
        plan: None,
        antennas: Vec::new(),
        actions: vec![Action { carrier_hz: 3993.6e6, pulse_duration_s }],
        cycles,
    }
}

/// The middle of the walls; half their longer extent as deviation covers the flat.
fn start_within(path: &Path) -> Result<Start, InputError> {
    let walls: Vec<(u64, WallRow)> = csv_rows(path)?;
    let (mut low_m, mut high_m) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for (line, wall) in walls {
        let ends = [("x1", wall.x1, 0), ("y1", wall.y1, 1), ("x2", wall.x2, 0), ("y2", wall.y2, 1)];
        for (column, value, axis) in ends {
            let coordinate_m = finite(path, line, column, value)?;
            low_m[axis] = low_m[axis].min(coordinate_m);
            high_m[axis] = high_m[axis].max(coordinate_m);
        }
    }
    let extent_m = (high_m[0] - low_m[0]).max(high_m[1] - low_m[1]);
    if extent_m <= 0.0 {
        return Err(InputError::new(path, "has walls of no extent"));
    }
    Ok(Start {
        position_m: [0.5 * (low_m[0] + high_m[0]), 0.5 * (low_m[1] + high_m[1])],
        position_std_m: 0.5 * extent_m,
        velocity_std_m_s: 0.01,
        disc_radius_m: None,
        drawn_about_m: None,
    })
}

fn read_cycles(
    archive: &mut Archive<std::io::BufReader<std::fs::File>>,
    link: u32,
    tag_m: [f64; 2],
    line_of_sight: bool,
) -> Result<Vec<Cycle>, InputError> {
    let responses = archive.read(&format!("cir_{link}"))?;
    responses.expect(Element::Complex64, &[None, None])?;
    let count = responses.shape()[0];
    let first_paths = archive.read(&format!("first_path_index_{link}"))?;
    first_paths.expect_shape(&[Some(count)])?;
    let ranges = archive.read(&format!("measured_range_m_{link}"))?;
    ranges.expect_shape(&[Some(count)])?;
    (0..count)
        .map(|index| {
            let (first_path, range_m) = (first_paths.float(index), ranges.float(index));
            if !first_path.is_finite() {
                return Err(first_paths.refuse(format!("is {first_path} at index {index}")));
            }
            if !(range_m >= 0.0 && range_m.is_finite()) {
                return Err(ranges.refuse(format!("is {range_m} at index {index}")).allowed("from 0"));
            }
            Ok(Cycle {
                time_s: index as f64,
                truth_position_m: Some(tag_m),
                ranges: vec![Range { anchor: 0, range_m, std_m: None, angles: None }],
                frames: vec![Frame {
                    anchor: 0,
                    action: 0,
                    first_sample_delay_s: range_m / SPEED_OF_LIGHT_M_S - first_path * DW1000_SAMPLE_SPACING_S,
                    first_path_index: Some(first_path),
                    line_of_sight: Some(line_of_sight),
                    samples: Samples::Complex(responses.complex_row(index)),
                }],
                ..Cycle::default()
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::super::tests::shared_data;
    use super::*;
    use crate::recording::tests::Folder;

    #[test]
    fn the_start_is_the_middle_of_the_walls_and_covers_them() {
        let folder = Folder::new();
        let path = folder.0.join("walls.csv");
        fs::write(&path, "x1,y1,x2,y2\n0,0,4,0\n4,0,4,10\n").expect("is written");
        let start = start_within(&path).expect("is read");
        assert_eq!((start.position_m, start.position_std_m), ([2.0, 5.0], 5.0));
        fs::write(&path, "x1,y1,x2,y2\n0,0,4,NaN\n").expect("is written");
        let error = start_within(&path).expect_err("is refused");
        assert_eq!((error.line(), error.item()), (Some(2), Some("y2")));
    }

    #[test]
    fn a_folder_without_the_files_is_refused() {
        let folder = Folder::new();
        assert!(warsaw(&folder.0).expect_err("is refused").file().ends_with("walls.csv"));
    }

    #[test]
    fn all_links_are_imported_with_the_first_path_at_the_measured_range() {
        let Some(folder) = shared_data("warsaw") else { return };
        let recordings = warsaw(&folder).expect("is imported");
        assert_eq!(recordings.len(), 18);
        let copies = Folder::new();
        for (name, recording) in &recordings {
            assert_eq!(recording.cycles.len(), 40);
            recording.write(copies.0.join(name)).expect("is written");
        }
        let (name, recording) = &recordings[0];
        assert_eq!(name, "link_1");
        assert!(recording.source.contains(", LOS:"));
        assert!(recording.cycles.iter().all(|cycle| cycle.frames[0].line_of_sight == Some(true)));
        let free = |(_, link): &&(String, Recording)| link.cycles[0].frames[0].line_of_sight == Some(true);
        assert_eq!(recordings.iter().filter(free).count(), 5);
        assert_eq!(&Recording::read(copies.0.join(name)).expect("is read"), recording);
        let first = &recording.cycles[0];
        let first_path_s = first.frames[0].first_sample_delay_s + 745.3125 * DW1000_SAMPLE_SPACING_S;
        assert!((first_path_s * SPEED_OF_LIGHT_M_S - 2.693148).abs() < 1e-6);
        assert_eq!(first.frames[0].samples.len(), 1016);
    }
}
