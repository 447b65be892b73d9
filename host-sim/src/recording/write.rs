//! Writing of recordings: whole or not at all.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::check::Place;
use super::npz::{ArchiveWriter, Element};
use super::{
    ARRAYS_FILE, Action, Anchor, Antenna, AssociationModel, Cycle, DIRECT_PATH, FORMAT, META_FILE, Motion,
    Plan, Radio, Recording, Samples, Start, TruthPath, VirtualAnchor,
};
use crate::input_error::{InputError, in_one_line};
use crate::whole_file;

/// The keys of `recording.toml`, in the order in which they are written.
#[derive(Serialize)]
struct Meta<'a> {
    format: u32,
    name: &'a str,
    source: &'a str,
    motion: &'a Motion,
    start: &'a Start,
    association: &'a AssociationModel,
    radio: &'a Radio,
    anchors: &'a [Anchor],
    virtual_anchors: &'a [VirtualAnchor],
    #[serde(skip_serializing_if = "<[_]>::is_empty")]
    antennas: &'a [Antenna],
    actions: &'a [Action],
    #[serde(skip_serializing_if = "<[_]>::is_empty")]
    walls: &'a [[[f64; 2]; 2]],
    #[serde(skip_serializing_if = "Option::is_none")]
    plan: Option<&'a Plan>,
}

impl Recording {
    /// Writes the recording to the folder `dir`, which may be absent, empty or an older recording.
    ///
    /// Both files are finished in a folder beside it, which then takes its place: whatever fails, `dir` holds a whole
    /// recording or what it held before. The same recording gives the same bytes.
    ///
    /// # Errors
    ///
    /// The recording is not valid, `dir` holds anything else, or the disk refuses.
    pub fn write(&self, dir: impl AsRef<Path>) -> Result<(), InputError> {
        let dir = dir.as_ref();
        self.check().map_err(|fault| {
            let (file, item) = match fault.place {
                Place::Key(key) => (META_FILE, key),
                Place::Array(name) => (ARRAYS_FILE, name.to_owned()),
            };
            let error = InputError::new(dir.join(file), fault.reason).for_item(item);
            match fault.allowed {
                Some(allowed) => error.allowed(allowed),
                None => error,
            }
        })?;
        // A link to a folder stays a link: the folder behind it is the one replaced.
        let target = fs::canonicalize(dir).unwrap_or_else(|_| dir.to_owned());
        let Some(name) = target.file_name() else {
            return Err(InputError::new(dir, "is not a name that a recording can be written to"));
        };
        refuse_other_contents(dir, &target)?;
        let parent =
            target.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let failed =
            |error: io::Error| InputError::new(dir, format!("cannot be written: {}", in_one_line(error)));
        fs::create_dir_all(parent).map_err(failed)?;
        let unfinished =
            TemporaryFolder::beside(parent, &format!(".{}.new", name.display())).map_err(failed)?;
        self.write_files(&unfinished.0).map_err(failed)?;
        put_in_place(&unfinished.0, &target, parent).map_err(failed)
    }

    /// Whether `dir` could be written: it is new, empty, or an older recording.
    ///
    /// # Errors
    /// It holds anything else.
    pub fn may_replace(dir: impl AsRef<Path>) -> Result<(), InputError> {
        let dir = dir.as_ref();
        refuse_other_contents(dir, &fs::canonicalize(dir).unwrap_or_else(|_| dir.to_owned()))
    }

    /// Whether `file` is one of the two files of a recording that is there: no other file may take its place.
    pub fn is_part_of_one(file: impl AsRef<Path>) -> bool {
        let file = fs::canonicalize(&file).unwrap_or_else(|_| file.as_ref().to_owned());
        let is_named = file.file_name().is_some_and(|name| name == META_FILE || name == ARRAYS_FILE);
        is_named && file.with_file_name(META_FILE).is_file()
    }

    fn write_files(&self, dir: &Path) -> io::Result<()> {
        let meta = Meta {
            format: FORMAT,
            name: &self.name,
            source: &self.source,
            motion: &self.motion,
            start: &self.start,
            association: &self.association,
            radio: &self.radio,
            anchors: &self.anchors,
            virtual_anchors: &self.virtual_anchors,
            antennas: &self.antennas,
            actions: &self.actions,
            walls: &self.walls,
            plan: self.plan.as_ref(),
        };
        let text = toml::to_string(&meta).map_err(io::Error::other)?;
        let mut file = File::create_new(dir.join(META_FILE))?;
        file.write_all(text.as_bytes())?;
        file.sync_all()?;
        let file = File::create_new(dir.join(ARRAYS_FILE))?;
        let file =
            self.write_arrays(BufWriter::new(file))?.into_inner().map_err(|error| error.into_error())?;
        file.sync_all()
    }

    fn write_arrays<W: Write + io::Seek>(&self, writer: W) -> io::Result<W> {
        let cycles = &self.cycles;
        let mut archive = ArchiveWriter::new(writer);
        let add_floats = |archive: &mut ArchiveWriter<W>, name, shape: &[usize], values: &[f64]| {
            archive.add(name, Element::F64, shape, values.iter().flat_map(|value| value.to_le_bytes()))
        };
        let times: Vec<f64> = cycles.iter().map(|cycle| cycle.time_s).collect();
        add_floats(&mut archive, "cycle_time_s", &[cycles.len()], &times)?;
        if cycles.iter().any(|cycle| cycle.truth_position_m.is_some()) {
            let truth: Vec<f64> =
                cycles.iter().flat_map(|cycle| cycle.truth_position_m.unwrap_or([f64::NAN; 2])).collect();
            add_floats(&mut archive, "truth_position_m", &[cycles.len(), 2], &truth)?;
        }
        let heights: Vec<f64> = cycles.iter().filter_map(|cycle| cycle.tag_height_m).collect();
        if !heights.is_empty() {
            add_floats(&mut archive, "tag_height_m", &[cycles.len()], &heights)?;
        }
        let deviations: Vec<f64> = cycles.iter().filter_map(|cycle| cycle.tag_height_std_m).collect();
        if !deviations.is_empty() {
            add_floats(&mut archive, "tag_height_std_m", &[cycles.len()], &deviations)?;
        }
        if !self.antennas.is_empty() {
            // An antenna's index is below 16, as the checks saw.
            let antennas = cycles.iter().filter_map(|cycle| cycle.antenna).map(|antenna| antenna as u8);
            archive.add("cycle_antenna", Element::U8, &[cycles.len()], antennas)?;
        }

        let ranges: Vec<_> = numbered(cycles.iter().map(|cycle| &cycle.ranges));
        if !ranges.is_empty() {
            let shape = [ranges.len()];
            archive.add(
                "range_cycle",
                Element::U32,
                &shape,
                ranges.iter().flat_map(|(n, _)| n.to_le_bytes()),
            )?;
            // An anchor's index is below 64, as the checks saw.
            archive.add(
                "range_anchor",
                Element::U8,
                &shape,
                ranges.iter().map(|(_, range)| range.anchor as u8),
            )?;
            let lengths: Vec<f64> = ranges.iter().map(|(_, range)| range.range_m).collect();
            add_floats(&mut archive, "range_m", &shape, &lengths)?;
            let deviations: Vec<f64> = ranges.iter().filter_map(|(_, range)| range.std_m).collect();
            if !deviations.is_empty() {
                add_floats(&mut archive, "range_std_m", &shape, &deviations)?;
            }
            let angles: Vec<_> = ranges.iter().filter_map(|(_, range)| range.angles).collect();
            if !angles.is_empty() {
                let departures: Vec<f64> = angles.iter().map(|angles| angles.departure_rad).collect();
                add_floats(&mut archive, "range_departure_angle_rad", &shape, &departures)?;
                let arrivals: Vec<f64> = angles.iter().map(|angles| angles.arrival_rad).collect();
                add_floats(&mut archive, "range_arrival_angle_rad", &shape, &arrivals)?;
            }
        }

        write_truth_paths(&mut archive, cycles)?;
        let frames: Vec<_> = numbered(cycles.iter().map(|cycle| &cycle.frames));
        let Some((_, first)) = frames.first() else { return archive.finish() };
        let shape = [frames.len()];
        archive.add("frame_cycle", Element::U32, &shape, frames.iter().flat_map(|(n, _)| n.to_le_bytes()))?;
        archive.add(
            "frame_anchor",
            Element::U8,
            &shape,
            frames.iter().map(|(_, frame)| frame.anchor as u8),
        )?;
        let actions = frames.iter().flat_map(|(_, frame)| (frame.action as u16).to_le_bytes());
        archive.add("frame_action", Element::U16, &shape, actions)?;
        let delays: Vec<f64> = frames.iter().map(|(_, frame)| frame.first_sample_delay_s).collect();
        add_floats(&mut archive, "frame_first_sample_delay_s", &shape, &delays)?;
        let first_paths: Vec<f64> = frames.iter().filter_map(|(_, frame)| frame.first_path_index).collect();
        if !first_paths.is_empty() {
            add_floats(&mut archive, "frame_first_path_index", &shape, &first_paths)?;
        }
        if first.line_of_sight.is_some() {
            let free = frames.iter().filter_map(|(_, frame)| frame.line_of_sight).map(u8::from);
            archive.add("frame_line_of_sight", Element::U8, &shape, free)?;
        }
        let (name, element) = match first.samples {
            Samples::Complex(_) => ("frame_samples", Element::Complex64),
            Samples::Magnitude(_) => ("frame_magnitude", Element::F32),
        };
        let parts = frames.iter().flat_map(|(_, frame)| match &frame.samples {
            Samples::Complex(samples) => samples.as_flattened(),
            Samples::Magnitude(samples) => samples,
        });
        let bytes = parts.flat_map(|part| part.to_le_bytes());
        archive.add(name, element, &[frames.len(), first.samples.len()], bytes)?;
        archive.finish()
    }
}

fn write_truth_paths<W: Write + io::Seek>(
    archive: &mut ArchiveWriter<W>,
    cycles: &[Cycle],
) -> io::Result<()> {
    let paths: Vec<_> = numbered(cycles.iter().map(|cycle| &cycle.truth_paths));
    if paths.is_empty() {
        return Ok(());
    }
    let shape = [paths.len()];
    let cycle_of = paths.iter().flat_map(|(n, _)| n.to_le_bytes());
    archive.add("truth_path_cycle", Element::U32, &shape, cycle_of)?;
    archive.add("truth_path_anchor", Element::U8, &shape, paths.iter().map(|(_, path)| path.anchor as u8))?;
    let sources = paths
        .iter()
        .flat_map(|(_, path)| path.virtual_anchor.map_or(DIRECT_PATH, |index| index as u16).to_le_bytes());
    archive.add("truth_path_virtual_anchor", Element::U16, &shape, sources)?;
    let mut add = |name, value: &dyn Fn(&TruthPath) -> f64| {
        let bytes = paths.iter().flat_map(|(_, path)| value(path).to_le_bytes());
        archive.add(name, Element::F64, &shape, bytes)
    };
    add("truth_path_delay_s", &|path| path.delay_s)?;
    add("truth_path_magnitude", &|path| path.magnitude)?;
    add("truth_path_sinr", &|path| path.sinr)
}

/// All items of all cycles, each with the index of its cycle.
fn numbered<'a, T: 'a>(cycles: impl Iterator<Item = &'a Vec<T>>) -> Vec<(u32, &'a T)> {
    (0u32..).zip(cycles).flat_map(|(cycle, items)| items.iter().map(move |item| (cycle, item))).collect()
}

/// An existing folder is only replaced if nothing but an older recording is lost.
fn refuse_other_contents(dir: &Path, target: &Path) -> Result<(), InputError> {
    let Ok(kind) = fs::symlink_metadata(target) else { return Ok(()) };
    if !kind.is_dir() {
        return Err(InputError::new(dir, "is a file, which a recording would overwrite"));
    }
    let entries = fs::read_dir(target)
        .map_err(|error| InputError::new(dir, format!("cannot be listed: {}", in_one_line(error))))?;
    for entry in entries {
        let name = entry.map(|entry| entry.file_name()).unwrap_or_default();
        if name != META_FILE && name != ARRAYS_FILE {
            return Err(InputError::new(
                dir,
                format!("holds {:?}, which a recording does not; it is left as it is", name.display()),
            ));
        }
    }
    Ok(())
}

/// Moves the finished folder to its place; what was there before comes back when that fails.
fn put_in_place(finished: &Path, target: &Path, parent: &Path) -> io::Result<()> {
    if !target.exists() {
        return fs::rename(finished, target);
    }
    let old = TemporaryFolder::beside(parent, ".old-recording")?;
    let kept = old.0.join("kept");
    fs::rename(target, &kept)?;
    if let Err(error) = fs::rename(finished, target) {
        if fs::rename(&kept, target).is_err() {
            // Rather leave it under another name than remove it.
            std::mem::forget(old);
        }
        return Err(error);
    }
    Ok(())
}

/// A folder with a fresh name, removed with what is left in it.
struct TemporaryFolder(PathBuf);

impl TemporaryFolder {
    fn beside(parent: &Path, prefix: &str) -> io::Result<Self> {
        whole_file::fresh(parent, prefix, |path| fs::create_dir(path)).map(|(path, ())| Self(path))
    }
}

impl Drop for TemporaryFolder {
    fn drop(&mut self) {
        // Nothing more can be done if it stays; after success it is gone already.
        let _ = fs::remove_dir_all(&self.0);
    }
}

#[cfg(test)]
mod tests {
    use super::super::Range;
    use super::super::tests::{Folder, example};
    use super::*;

    #[test]
    fn a_recording_is_read_back_as_it_was_written() {
        let folder = Folder::new();
        let dir = folder.0.join("a/b");
        let mut recording = example();
        recording.write(&dir).expect("is written");
        assert_eq!(Recording::read(&dir).expect("is read"), recording);

        // Magnitudes, without anything optional, over the first one.
        (recording.start.disc_radius_m, recording.start.drawn_about_m) = (None, None);
        recording.plan = None;
        recording.virtual_anchors.clear();
        recording.walls.clear();
        recording.antennas.clear();
        for cycle in &mut recording.cycles {
            cycle.truth_paths.clear();
            cycle.truth_position_m = None;
            (cycle.tag_height_m, cycle.tag_height_std_m) = (None, None);
            cycle.antenna = None;
            cycle.ranges.clear();
            for frame in &mut cycle.frames {
                (frame.first_path_index, frame.line_of_sight) = (None, None);
                frame.samples = Samples::Magnitude(vec![0.0, 1.0, 2.5]);
            }
        }
        recording.write(&dir).expect("is written over the old one");
        assert_eq!(Recording::read(&dir).expect("is read"), recording);
        assert_eq!(fs::read_dir(folder.0.join("a")).expect("is a folder").count(), 1, "nothing else is left");
    }

    #[test]
    fn ranges_alone_and_empty_cycles_are_kept() {
        let folder = Folder::new();
        let mut recording = example();
        recording.actions.clear();
        recording.antennas.clear();
        recording.radio.sample_spacing_s = None;
        recording.cycles = (0..4)
            .map(|step| Cycle {
                time_s: f64::from(step),
                ranges: vec![Range { anchor: 0, range_m: 2.0, std_m: None, angles: None }; step as usize % 3],
                ..Cycle::default()
            })
            .collect();
        recording.write(folder.0.join("r")).expect("is written");
        assert_eq!(Recording::read(folder.0.join("r")).expect("is read"), recording);
    }

    #[test]
    fn a_folder_with_other_files_is_left_alone() {
        let folder = Folder::new();
        fs::write(folder.0.join("thesis.txt"), "years of work").expect("is written");
        let error = example().write(&folder.0).expect_err("is refused");
        assert!(error.to_string().contains("thesis.txt"), "{error}");
        assert_eq!(fs::read_dir(&folder.0).expect("is a folder").count(), 1);
        let error = example().write(folder.0.join("thesis.txt")).expect_err("is refused");
        assert!(error.to_string().contains("is a file"), "{error}");
    }

    #[test]
    fn an_invalid_recording_is_not_written_and_the_old_one_stays() {
        let folder = Folder::new();
        let dir = folder.0.join("r");
        example().write(&dir).expect("is written");
        let mut broken = example();
        broken.cycles[0].ranges[0].range_m = f64::NAN;
        let error = broken.write(&dir).expect_err("is refused");
        assert_eq!(error.item(), Some("range_m"));
        assert_eq!(Recording::read(&dir).expect("is read"), example());
    }

    #[test]
    fn an_empty_folder_may_be_filled() {
        let folder = Folder::new();
        example().write(&folder.0).expect("is written");
        assert_eq!(Recording::read(&folder.0).expect("is read"), example());
    }

    #[test]
    fn the_same_recording_gives_the_same_bytes() {
        let folder = Folder::new();
        for name in ["a", "b"] {
            example().write(folder.0.join(name)).expect("is written");
        }
        for file in [META_FILE, ARRAYS_FILE] {
            let read = |name: &str| fs::read(folder.0.join(name).join(file)).expect("is there");
            assert_eq!(read("a"), read("b"));
        }
    }
}
