//! Writing of files: whole or not at all.
//!
//! The contents go to a temporary file in the folder of the target, which is flushed to the disk and then renamed to the
//! target. Whatever fails, the target holds what it held before, and the temporary file is removed. A device or a pipe
//! cannot be replaced by a file: it is written to directly.

use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

/// Start of the name of a file that is not finished.
const UNFINISHED: &str = ".cogmint-unfinished";
/// Names tried before the folder is given up: each failure is a file that a killed process of the same number left.
const MOST_NAMES: u32 = 1000;

/// Writes the file `to`, making its folder first; `contents` writes what is to be in it.
///
/// # Errors
/// `contents` fails, `to` is a folder or may not be written, or the disk refuses. The error names `to`.
pub fn write(to: &Path, contents: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<()> {
    let mut file = Unfinished::create(to)?;
    contents(&mut file.writer).map_err(|error| about(to, &error))?;
    file.complete()?.put_in_place()
}

/// Writes several files: none takes its place before all are complete.
///
/// # Errors
/// As [`write()`].
pub fn write_all(files: &[(&Path, &[u8])]) -> io::Result<()> {
    let complete = |(to, contents): &(&Path, &[u8])| {
        let mut file = Unfinished::create(to)?;
        file.writer.write_all(contents).map_err(|error| about(to, &error))?;
        file.complete()
    };
    let files: Vec<Complete> = files.iter().map(complete).collect::<io::Result<_>>()?;
    files.into_iter().try_for_each(Complete::put_in_place)
}

/// Whether `to` can be written, to be asked before long work. Makes its folder; `to` itself stays as it is.
///
/// # Errors
/// As [`write()`].
pub fn check(to: &Path) -> io::Result<()> {
    // The reader of a pipe would take a writer that comes and goes for the end.
    if fs::metadata(to).is_ok_and(|old| !old.is_file() && !old.is_dir()) {
        return Ok(());
    }
    Unfinished::create(to).map(drop)
}

/// A path of a fresh name in `parent`, with what `make` made there; `make` must fail where the path is taken.
///
/// # Errors
/// `make` fails for another reason.
pub(crate) fn fresh<T>(
    parent: &Path,
    prefix: &str,
    make: impl Fn(&Path) -> io::Result<T>,
) -> io::Result<(PathBuf, T)> {
    let mut count = 0;
    loop {
        let path = parent.join(format!("{prefix}-{}-{count}", std::process::id()));
        match make(&path) {
            Ok(made) => return Ok((path, made)),
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists && count < MOST_NAMES => count += 1,
            Err(error) => return Err(error),
        }
    }
}

/// A file that is being written. The writer is closed before the temporary file is removed.
struct Unfinished {
    writer: BufWriter<File>,
    place: Place,
}

/// A file whose contents are on the disk, not yet under its name.
struct Complete(Place);

/// Where a file is and where it is to go.
struct Place {
    /// The path as it was given, for messages.
    to: PathBuf,
    /// The temporary file and its target, links followed; `None` where the target is written to directly.
    moved: Option<(Temporary, PathBuf)>,
}

/// A temporary file, removed when dropped.
struct Temporary(PathBuf);

impl Drop for Temporary {
    fn drop(&mut self) {
        // Nothing more can be done if it stays; once renamed it is gone already.
        let _ = fs::remove_file(&self.0);
    }
}

impl Unfinished {
    fn create(to: &Path) -> io::Result<Self> {
        Self::create_for(to).map_err(|error| about(to, &error))
    }

    fn create_for(to: &Path) -> io::Result<Self> {
        // A link stays a link: the file behind it is the one replaced.
        let target = fs::canonicalize(to).unwrap_or_else(|_| to.to_owned());
        if target.file_name().is_none() {
            return Err(io::Error::new(io::ErrorKind::InvalidInput, "is not a name that a file can have"));
        }
        let old = fs::metadata(&target).ok();
        if old.as_ref().is_some_and(fs::Metadata::is_dir) {
            return Err(io::Error::new(io::ErrorKind::IsADirectory, "is a folder"));
        }
        // A file that may not be written may not be replaced either.
        let opened = old.as_ref().map(|_| OpenOptions::new().write(true).open(&target)).transpose()?;
        if let (Some(old), Some(file)) = (&old, opened)
            && !old.is_file()
        {
            return Ok(Self {
                writer: BufWriter::new(file),
                place: Place { to: to.to_owned(), moved: None },
            });
        }
        let parent = target.parent().filter(|parent| !parent.as_os_str().is_empty());
        let parent = parent.unwrap_or(Path::new(".")).to_owned();
        fs::create_dir_all(&parent)?;
        let (path, file) = fresh(&parent, UNFINISHED, |path| File::create_new(path))?;
        let temporary = Temporary(path);
        if let Some(old) = old {
            file.set_permissions(old.permissions())?;
        }
        let moved = Some((temporary, target));
        Ok(Self { writer: BufWriter::new(file), place: Place { to: to.to_owned(), moved } })
    }

    fn complete(self) -> io::Result<Complete> {
        let Self { writer, place } = self;
        let is_file = place.moved.is_some();
        writer
            .into_inner()
            .map_err(io::IntoInnerError::into_error)
            // Devices and pipes have nothing to synchronise and say so.
            .and_then(|file| if is_file { file.sync_all() } else { Ok(()) })
            .map_err(|error| about(&place.to, &error))?;
        Ok(Complete(place))
    }
}

impl Complete {
    fn put_in_place(self) -> io::Result<()> {
        let Place { to, moved } = self.0;
        match moved {
            Some((temporary, target)) => fs::rename(&temporary.0, target).map_err(|error| about(&to, &error)),
            None => Ok(()),
        }
    }
}

/// An error with the path that it is about.
fn about(to: &Path, error: &io::Error) -> io::Error {
    io::Error::new(error.kind(), format!("{}: cannot be written: {error}", to.display()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::tests::Folder;

    fn names(folder: &Path) -> Vec<String> {
        let entries = fs::read_dir(folder).expect("is a folder").map(|entry| entry.expect("is listed"));
        let mut names: Vec<String> =
            entries.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }

    #[test]
    fn a_writer_that_fails_leaves_the_old_file_and_nothing_else() {
        let folder = Folder::new();
        let to = folder.0.join("table.csv");
        fs::write(&to, "old").expect("is written");
        let error = write(&to, |file| {
            // More than any buffer holds: half of the new file is on the disk when it fails.
            file.write_all(&vec![b'x'; 1 << 20])?;
            Err(io::Error::other("the source ran dry"))
        })
        .expect_err("fails");
        let said = error.to_string();
        assert!(said.contains("table.csv") && said.contains("the source ran dry"), "{said}");
        assert_eq!(fs::read_to_string(&to).expect("is there"), "old");
        assert_eq!(names(&folder.0), ["table.csv"]);

        write(&to, |file| file.write_all(b"new")).expect("is written");
        assert_eq!(fs::read_to_string(&to).expect("is there"), "new");
        assert_eq!(names(&folder.0), ["table.csv"]);
    }

    #[test]
    fn the_old_file_is_whole_until_the_new_one_is() {
        let folder = Folder::new();
        let to = folder.0.join("f");
        fs::write(&to, "old").expect("is written");
        write(&to, |file| {
            file.write_all(b"new")?;
            assert_eq!(fs::read_to_string(&to)?, "old");
            Ok(())
        })
        .expect("is written");
        assert_eq!(fs::read_to_string(&to).expect("is there"), "new");
    }

    #[test]
    fn of_several_files_none_is_replaced_where_one_cannot_be() {
        let folder = Folder::new();
        let (first, second) = (folder.0.join("a.svg"), folder.0.join("a.png"));
        fs::write(&first, "old").expect("is written");
        fs::create_dir(&second).expect("is made");
        let error = write_all(&[(&first, b"new"), (&second, b"new")]).expect_err("is refused");
        assert!(error.to_string().contains("a.png: cannot be written: is a folder"), "{error}");
        assert_eq!(fs::read_to_string(&first).expect("is there"), "old");
        assert_eq!(names(&folder.0), ["a.png", "a.svg"]);
    }

    #[test]
    fn asking_whether_a_file_can_be_written_leaves_no_trace() {
        let folder = Folder::new();
        let to = folder.0.join("f");
        check(&to).expect("can be written");
        assert!(names(&folder.0).is_empty());
        fs::write(&to, "old").expect("is written");
        check(&to).expect("can be written");
        assert_eq!(fs::read_to_string(&to).expect("is there"), "old");
        check(&to.join("below")).expect_err("is below a file");
        check(Path::new("/")).expect_err("is a folder");
        check(Path::new("")).expect_err("is no name");
        assert_eq!(names(&folder.0), ["f"]);
    }

    #[cfg(unix)]
    #[test]
    fn links_permissions_and_devices_stay_what_they_are() {
        use std::os::unix::fs::{FileTypeExt, PermissionsExt, symlink};
        let folder = Folder::new();
        let (to, link) = (folder.0.join("f"), folder.0.join("link"));
        fs::write(&to, "old").expect("is written");
        fs::set_permissions(&to, fs::Permissions::from_mode(0o640)).expect("is set");
        symlink("f", &link).expect("is made");
        write(&link, |file| file.write_all(b"new")).expect("is written");
        assert!(fs::symlink_metadata(&link).expect("is there").is_symlink());
        assert_eq!(fs::read_to_string(&to).expect("is there"), "new");
        assert_eq!(fs::metadata(&to).expect("is there").permissions().mode() & 0o777, 0o640);

        write(Path::new("/dev/null"), |file| file.write_all(b"new")).expect("is written");
        assert!(fs::metadata("/dev/null").expect("is there").file_type().is_char_device());
    }
}
