//! Reading of recordings.

use std::io::{Read, Seek};
use std::path::Path;

use serde::Deserialize;

use super::check::{Fault, Place};
use super::npz::{Archive, Element, printable};
use super::{
    ARRAYS_FILE, Action, Anchor, Angles, Antenna, AssociationModel, Cycle, DIRECT_PATH, FORMAT, Frame,
    MAX_CYCLES, MAX_FRAMES, MAX_RANGES, MAX_SAMPLES, MAX_TRUTH_PATHS, META_FILE, Motion, Plan, Radio, Range,
    Recording, Samples, Start, TruthPath, VirtualAnchor,
};
use crate::input_error::InputError;
use crate::toml_place;

const ARRAYS: [&str; 25] = [
    "cycle_time_s",
    "truth_position_m",
    "tag_height_m",
    "tag_height_std_m",
    "cycle_antenna",
    "range_cycle",
    "range_anchor",
    "range_m",
    "range_std_m",
    "range_departure_angle_rad",
    "range_arrival_angle_rad",
    "frame_cycle",
    "frame_anchor",
    "frame_action",
    "frame_first_sample_delay_s",
    "frame_first_path_index",
    "frame_line_of_sight",
    "frame_samples",
    "frame_magnitude",
    "truth_path_cycle",
    "truth_path_anchor",
    "truth_path_virtual_anchor",
    "truth_path_delay_s",
    "truth_path_magnitude",
    "truth_path_sinr",
];

/// The keys of `recording.toml`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Meta {
    #[serde(rename = "format")]
    _format: u32,
    name: String,
    source: String,
    motion: Motion,
    start: Start,
    association: AssociationModel,
    radio: Radio,
    anchors: Vec<Anchor>,
    #[serde(default)]
    virtual_anchors: Vec<VirtualAnchor>,
    #[serde(default)]
    antennas: Vec<Antenna>,
    #[serde(default)]
    actions: Vec<Action>,
    #[serde(default)]
    walls: Vec<[[f64; 2]; 2]>,
    plan: Option<Plan>,
}

impl Recording {
    /// Reads and checks the recording in the folder `dir`.
    ///
    /// # Errors
    ///
    /// Anything that is missing, malformed, out of range or unknown, named in one sentence.
    pub fn read(dir: impl AsRef<Path>) -> Result<Self, InputError> {
        let dir = dir.as_ref();
        if !dir.is_dir() {
            return Err(InputError::new(dir, "is not a folder with a recording"));
        }
        let meta_path = dir.join(META_FILE);
        let text = toml_place::read_text(&meta_path)?;
        let mut recording = read_meta(&meta_path, &text)?;
        let arrays_path = dir.join(ARRAYS_FILE);
        read_arrays(Archive::open(&arrays_path)?, &arrays_path, &mut recording)?;
        recording.check().map_err(|fault| located(fault, &meta_path, &text, &arrays_path))?;
        Ok(recording)
    }
}

/// Reads everything but the cycles.
fn read_meta(path: &Path, text: &str) -> Result<Recording, InputError> {
    toml_place::check_format(path, text, FORMAT)?;
    let meta: Meta = toml::from_str(text).map_err(|error| toml_place::refusal(path, text, &error))?;
    let recording = Recording {
        name: meta.name,
        source: meta.source,
        motion: meta.motion,
        start: meta.start,
        association: meta.association,
        radio: meta.radio,
        anchors: meta.anchors,
        virtual_anchors: meta.virtual_anchors,
        antennas: meta.antennas,
        actions: meta.actions,
        walls: meta.walls,
        plan: meta.plan,
        cycles: Vec::new(),
    };
    recording.check_meta().map_err(|fault| located(fault, path, text, path))?;
    Ok(recording)
}

fn located(fault: Fault, meta_path: &Path, text: &str, arrays_path: &Path) -> InputError {
    let error = match fault.place {
        Place::Key(key) => InputError::new(meta_path, fault.reason)
            .at_line(toml_place::line_of_key(text, key.split('.')))
            .for_item(key),
        Place::Array(name) => InputError::new(arrays_path, fault.reason).for_item(name),
    };
    match fault.allowed {
        Some(allowed) => error.allowed(allowed),
        None => error,
    }
}

/// Fills in the cycles.
fn read_arrays<R: Read + Seek>(
    mut archive: Archive<R>,
    path: &Path,
    recording: &mut Recording,
) -> Result<(), InputError> {
    if let Some(unknown) = archive.names().find(|name| !ARRAYS.contains(name)) {
        return Err(InputError::new(path, "is not an array of a recording")
            .for_item(printable(unknown))
            .allowed(ARRAYS.join(", ")));
    }
    let times = archive.read("cycle_time_s")?;
    times.expect(Element::F64, &[None])?;
    let cycle_count = limited(&times, MAX_CYCLES)?;
    recording.cycles =
        times.floats().into_iter().map(|time_s| Cycle { time_s, ..Cycle::default() }).collect();
    if let Some(truth) = archive.read_optional("truth_position_m")? {
        truth.expect(Element::F64, &[Some(cycle_count), Some(2)])?;
        for (index, cycle) in recording.cycles.iter_mut().enumerate() {
            let position_m = [truth.float(2 * index), truth.float(2 * index + 1)];
            cycle.truth_position_m = (!position_m.iter().all(|x| x.is_nan())).then_some(position_m);
        }
    }
    if let Some(heights) = archive.read_optional("tag_height_m")? {
        heights.expect(Element::F64, &[Some(cycle_count)])?;
        for (index, cycle) in recording.cycles.iter_mut().enumerate() {
            cycle.tag_height_m = Some(heights.float(index));
        }
    }
    if let Some(deviations) = archive.read_optional("tag_height_std_m")? {
        deviations.expect(Element::F64, &[Some(cycle_count)])?;
        for (index, cycle) in recording.cycles.iter_mut().enumerate() {
            cycle.tag_height_std_m = Some(deviations.float(index));
        }
    }
    if let Some(antennas) = archive.read_optional("cycle_antenna")? {
        antennas.expect(Element::U8, &[Some(cycle_count)])?;
        for (index, cycle) in recording.cycles.iter_mut().enumerate() {
            cycle.antenna = Some(antennas.float(index) as usize);
        }
    }
    read_ranges(&mut archive, &mut recording.cycles)?;
    read_truth_paths(&mut archive, &mut recording.cycles)?;
    read_frames(&mut archive, &mut recording.cycles)
}

/// The length of an array. A few kilobytes can unpack to very many small items, each far larger in memory.
fn limited(array: &super::npz::Array, limit: usize) -> Result<usize, InputError> {
    if array.len() > limit {
        return Err(array.refuse(format!("has {} entries", array.len())).allowed(format!("at most {limit}")));
    }
    Ok(array.len())
}

/// Whether any array of a group is there; then the others must be, too.
fn has_group<R: Read + Seek>(archive: &Archive<R>, prefix: &str) -> bool {
    archive.names().any(|name| name.starts_with(prefix))
}

fn read_ranges<R: Read + Seek>(archive: &mut Archive<R>, cycles: &mut [Cycle]) -> Result<(), InputError> {
    if !has_group(archive, "range_") {
        return Ok(());
    }
    let cycle_of = archive.read("range_cycle")?;
    cycle_of.expect(Element::U32, &[None])?;
    let count = limited(&cycle_of, MAX_RANGES)?;
    let anchors = archive.read("range_anchor")?;
    anchors.expect(Element::U8, &[Some(count)])?;
    let lengths = archive.read("range_m")?;
    lengths.expect(Element::F64, &[Some(count)])?;
    let deviations = archive.read_optional("range_std_m")?;
    if let Some(deviations) = &deviations {
        deviations.expect(Element::F64, &[Some(count)])?;
    }
    let has_angles = archive.names().any(|name| name.ends_with("_angle_rad"));
    let mut directions = |name| {
        let array = has_angles.then(|| archive.read(name)).transpose()?;
        array.iter().try_for_each(|array| array.expect(Element::F64, &[Some(count)]))?;
        Ok::<_, InputError>(array)
    };
    let departures = directions("range_departure_angle_rad")?;
    let arrivals = directions("range_arrival_angle_rad")?;
    let cycle_count = cycles.len();
    for (index, cycle) in cycle_of.indexes()?.into_iter().enumerate() {
        let Some(cycle) = cycles.get_mut(cycle) else {
            return Err(cycle_out_of_range(&cycle_of, cycle, index, cycle_count));
        };
        cycle.ranges.push(Range {
            anchor: anchors.float(index) as usize,
            range_m: lengths.float(index),
            std_m: deviations.as_ref().map(|deviations| deviations.float(index)),
            angles: departures.as_ref().zip(arrivals.as_ref()).map(|(departures, arrivals)| Angles {
                departure_rad: departures.float(index),
                arrival_rad: arrivals.float(index),
            }),
        });
    }
    Ok(())
}

fn read_truth_paths<R: Read + Seek>(
    archive: &mut Archive<R>,
    cycles: &mut [Cycle],
) -> Result<(), InputError> {
    if !has_group(archive, "truth_path_") {
        return Ok(());
    }
    let cycle_of = archive.read("truth_path_cycle")?;
    cycle_of.expect(Element::U32, &[None])?;
    let count = limited(&cycle_of, MAX_TRUTH_PATHS)?;
    let anchors = archive.read("truth_path_anchor")?;
    anchors.expect(Element::U8, &[Some(count)])?;
    let sources = archive.read("truth_path_virtual_anchor")?;
    sources.expect(Element::U16, &[Some(count)])?;
    let mut floats = |name| {
        let array = archive.read(name)?;
        array.expect(Element::F64, &[Some(count)])?;
        Ok::<_, InputError>(array)
    };
    let (delays, magnitudes) = (floats("truth_path_delay_s")?, floats("truth_path_magnitude")?);
    let sinrs = floats("truth_path_sinr")?;
    let cycle_count = cycles.len();
    for (index, cycle) in cycle_of.indexes()?.into_iter().enumerate() {
        let Some(cycle) = cycles.get_mut(cycle) else {
            return Err(cycle_out_of_range(&cycle_of, cycle, index, cycle_count));
        };
        let source = sources.float(index);
        cycle.truth_paths.push(TruthPath {
            anchor: anchors.float(index) as usize,
            virtual_anchor: (source != f64::from(DIRECT_PATH)).then_some(source as usize),
            delay_s: delays.float(index),
            magnitude: magnitudes.float(index),
            sinr: sinrs.float(index),
        });
    }
    Ok(())
}

fn read_frames<R: Read + Seek>(archive: &mut Archive<R>, cycles: &mut [Cycle]) -> Result<(), InputError> {
    if !has_group(archive, "frame_") {
        return Ok(());
    }
    let cycle_of = archive.read("frame_cycle")?;
    cycle_of.expect(Element::U32, &[None])?;
    let count = limited(&cycle_of, MAX_FRAMES)?;
    let anchors = archive.read("frame_anchor")?;
    anchors.expect(Element::U8, &[Some(count)])?;
    let actions = archive.read("frame_action")?;
    actions.expect(Element::U16, &[Some(count)])?;
    let delays = archive.read("frame_first_sample_delay_s")?;
    delays.expect(Element::F64, &[Some(count)])?;
    let first_paths = archive.read_optional("frame_first_path_index")?;
    if let Some(first_paths) = &first_paths {
        first_paths.expect(Element::F64, &[Some(count)])?;
    }
    let lines_of_sight = archive.read_optional("frame_line_of_sight")?;
    if let Some(lines_of_sight) = &lines_of_sight {
        lines_of_sight.expect(Element::U8, &[Some(count)])?;
        if let Some(index) = (0..count).find(|&index| lines_of_sight.float(index) > 1.0) {
            let reason = format!("is {} at index {index}", lines_of_sight.float(index));
            return Err(lines_of_sight.refuse(reason).allowed("0 or 1"));
        }
    }
    let magnitudes = archive.read_optional("frame_magnitude")?;
    let complex = match &magnitudes {
        None => Some(archive.read("frame_samples")?),
        Some(magnitudes) => {
            if archive.names().any(|name| name == "frame_samples") {
                return Err(magnitudes.refuse("is there beside `frame_samples`").allowed("one of the two"));
            }
            magnitudes.expect(Element::F32, &[Some(count), None])?;
            None
        }
    };
    if let Some(complex) = &complex {
        complex.expect(Element::Complex64, &[Some(count), None])?;
    }
    for array in complex.iter().chain(&magnitudes) {
        let length = array.shape()[1];
        if length == 0 || length > MAX_SAMPLES {
            return Err(array
                .refuse(format!("has frames of {length} samples"))
                .allowed(format!("1 to {MAX_SAMPLES}")));
        }
    }
    let cycle_count = cycles.len();
    for (index, cycle) in cycle_of.indexes()?.into_iter().enumerate() {
        let Some(cycle) = cycles.get_mut(cycle) else {
            return Err(cycle_out_of_range(&cycle_of, cycle, index, cycle_count));
        };
        let samples = match (&complex, &magnitudes) {
            (Some(complex), _) => Samples::Complex(complex.complex_row(index)),
            (None, Some(magnitudes)) => Samples::Magnitude(magnitudes.float_row(index)),
            (None, None) => continue,
        };
        cycle.frames.push(Frame {
            anchor: anchors.float(index) as usize,
            action: actions.float(index) as usize,
            first_sample_delay_s: delays.float(index),
            first_path_index: first_paths.as_ref().map(|indexes| indexes.float(index)),
            line_of_sight: lines_of_sight.as_ref().map(|free| free.float(index) > 0.0),
            samples,
        });
    }
    Ok(())
}

fn cycle_out_of_range(
    array: &super::npz::Array,
    cycle: usize,
    index: usize,
    cycle_count: usize,
) -> InputError {
    let error = array.refuse(format!("is {cycle} at index {index}"));
    if cycle_count == 0 {
        return error.allowed("nothing, as there are no cycles");
    }
    error.allowed(format!("0 to {}, the indexes of the cycles", cycle_count - 1))
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::super::tests::{Folder, example};
    use super::*;

    fn refusal_after_edit(edit: impl FnOnce(String) -> String) -> InputError {
        let folder = Folder::new();
        let dir = folder.0.join("recording");
        example().write(&dir).expect("is written");
        let path = dir.join(META_FILE);
        let text = fs::read_to_string(&path).expect("is there");
        fs::write(&path, edit(text)).expect("is written");
        Recording::read(&dir).expect_err("is refused")
    }

    #[test]
    fn an_unknown_key_is_refused_with_its_line() {
        let error = refusal_after_edit(|text| text.replace("[motion]\n", "[motion]\nspeed = 3\n"));
        assert!(error.line().is_some(), "{error}");
        assert!(error.to_string().contains("speed"), "{error}");
    }

    #[test]
    fn a_value_out_of_range_is_refused_with_its_key_line_and_range() {
        let mut line = 0;
        let error = refusal_after_edit(|text| {
            line = 1 + text.lines().position(|line| line.starts_with("position_std_m")).expect("is there")
                as u64;
            text.replace("position_std_m = 0.25", "position_std_m = -1")
        });
        assert_eq!(error.line(), Some(line), "{error}");
        assert_eq!(error.item(), Some("start.position_std_m"));
        assert!(error.to_string().ends_with("is -1; allowed is above 0 to 1e6."), "{error}");
    }

    #[test]
    fn a_value_out_of_range_in_a_list_of_tables_is_refused_with_its_line() {
        let mut line = 0;
        let error = refusal_after_edit(|text| {
            let text = text.replacen("height_m = 1.5", "height_m = nan", 1);
            line = 1 + text.lines().position(|line| line.ends_with("nan")).expect("is there") as u64;
            text
        });
        assert_eq!(error.line(), Some(line), "{error}");
        assert_eq!(error.item(), Some("anchors.0.height_m"));
    }

    #[test]
    fn a_value_of_a_wrong_type_is_refused_with_its_key() {
        let error = refusal_after_edit(|text| text.replace("roll_off = 0.6", "roll_off = \"wide\""));
        assert_eq!(error.item(), Some("radio.roll_off"), "{error}");
        let error = refusal_after_edit(|text| text.replace("known = true", "known = 3"));
        assert_eq!(error.item(), Some("virtual_anchors.0.known"), "{error}");
        let error = refusal_after_edit(|text| text.replace("position_std_m = 0.25\n", ""));
        assert!(error.to_string().contains("position_std_m"), "{error}");
    }

    #[test]
    fn another_format_or_none_is_refused() {
        let error = refusal_after_edit(|text| text.replace("format = 1", "format = 2"));
        assert_eq!(error.item(), Some("format"));
        assert_eq!(error.line(), Some(1));
        let error = refusal_after_edit(|text| text.replace("format = 1", ""));
        assert!(error.to_string().contains("`format` is missing"), "{error}");
    }

    #[test]
    fn broken_toml_is_refused_with_its_line() {
        let error = refusal_after_edit(|text| format!("{text}\n[[["));
        assert!(error.line().is_some(), "{error}");
        let error = refusal_after_edit(|text| format!("{text}\nx = {}", "[".repeat(100_000)));
        assert!(error.line().is_some());
    }

    #[test]
    fn a_folder_without_a_recording_is_refused() {
        let folder = Folder::new();
        let error = Recording::read(&folder.0).expect_err("is refused");
        assert!(error.file().ends_with(META_FILE));
        Recording::read(folder.0.join("nowhere")).expect_err("is refused");
    }

    /// Not random, so that a failure can be repeated.
    fn places(count: usize, length: usize) -> impl Iterator<Item = usize> {
        (0..count).map(move |n| (n.wrapping_mul(0x9e37_79b9) >> 3) % length)
    }

    #[test]
    fn damaged_arrays_are_refused_or_read_but_never_panic() {
        let folder = Folder::new();
        let dir = folder.0.join("recording");
        example().write(&dir).expect("is written");
        let path = dir.join(ARRAYS_FILE);
        let whole = fs::read(&path).expect("is there");
        for place in places(200, whole.len()) {
            fs::write(&path, &whole[..place]).expect("is written");
            Recording::read(&dir).expect_err("truncated files are refused");
        }
        for (n, place) in places(1000, whole.len()).enumerate() {
            let mut damaged = whole.clone();
            damaged[place] ^= 1 << (n % 8);
            fs::write(&path, damaged).expect("is written");
            let _ = Recording::read(&dir);
        }
    }

    #[test]
    fn damaged_headers_with_right_checksums_never_panic() {
        use super::super::npz::ArchiveWriter;
        // Each byte of a header is damaged before the archive is made, so that no checksum catches it.
        let mut writer = ArchiveWriter::new(std::io::Cursor::new(Vec::new()));
        writer.add("cycle_time_s", Element::F64, &[3], [0u8; 24].into_iter()).expect("is written");
        let bytes = writer.finish().expect("ends").into_inner();
        let mut inside = Vec::new();
        let mut zip = zip::ZipArchive::new(std::io::Cursor::new(bytes)).expect("opens");
        zip.by_index(0).expect("is there").read_to_end(&mut inside).expect("is read");
        for place in 0..128 {
            for bit in 0..8 {
                let mut damaged = inside.clone();
                damaged[place] ^= 1 << bit;
                let mut zip = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
                zip.start_file("cycle_time_s.npy", zip::write::SimpleFileOptions::default()).expect("starts");
                std::io::Write::write_all(&mut zip, &damaged).expect("is written");
                let bytes = zip.finish().expect("ends").into_inner();
                let path = Path::new("test.npz");
                if let Ok(archive) = Archive::new(path, std::io::Cursor::new(bytes)) {
                    let _ = read_arrays(archive, path, &mut example());
                }
            }
        }
    }

    #[test]
    fn very_many_cycles_in_a_small_file_are_refused_before_they_take_memory() {
        use super::super::npz::ArchiveWriter;
        let mut writer = ArchiveWriter::new(std::io::Cursor::new(Vec::new()));
        let count = MAX_CYCLES + 1;
        writer
            .add("cycle_time_s", Element::F64, &[count], std::iter::repeat_n(0u8, 8 * count))
            .expect("is written");
        let path = Path::new("test.npz");
        let archive = Archive::new(path, writer.finish().expect("ends")).expect("opens");
        let error = read_arrays(archive, path, &mut example()).expect_err("is refused");
        assert!(error.to_string().contains("allowed is at most"), "{error}");
    }

    #[test]
    fn a_wrong_type_a_missing_array_and_an_unknown_one_are_named() {
        use super::super::npz::ArchiveWriter;
        let refusal = |arrays: &[(&str, Element, usize)]| {
            let mut writer = ArchiveWriter::new(std::io::Cursor::new(Vec::new()));
            for &(name, element, bytes) in arrays {
                writer.add(name, element, &[3], std::iter::repeat_n(0u8, bytes)).expect("is written");
            }
            let bytes = writer.finish().expect("ends");
            let path = Path::new("test.npz");
            let archive = Archive::new(path, bytes).expect("opens");
            read_arrays(archive, path, &mut example()).expect_err("is refused").to_string()
        };
        assert_eq!(refusal(&[]), "test.npz: `cycle_time_s` is missing from the arrays.");
        assert_eq!(
            refusal(&[("cycle_time_s", Element::F32, 12)]),
            "test.npz: `cycle_time_s` holds float32; allowed is float64."
        );
        let time = ("cycle_time_s", Element::F64, 24);
        assert!(refusal(&[time, ("truth_m", Element::F64, 24)]).contains("`truth_m` is not an array"));
        let ranges = [
            time,
            ("range_cycle", Element::U32, 12),
            ("range_anchor", Element::U8, 3),
            ("range_m", Element::F64, 24),
            ("range_arrival_angle_rad", Element::F64, 24),
        ];
        assert_eq!(refusal(&ranges), "test.npz: `range_departure_angle_rad` is missing from the arrays.");
        assert!(refusal(&[time, ("range_m", Element::F64, 24)]).contains("`range_cycle` is missing"));
        assert_eq!(
            refusal(&[time, ("truth_position_m", Element::F64, 24)]),
            "test.npz: `truth_position_m` has the shape [3]; allowed is [3, 2]."
        );
    }
}
