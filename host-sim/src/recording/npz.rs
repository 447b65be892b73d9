//! Reading and writing of NPZ: a ZIP archive with one NPY array per entry, as `numpy.load` and `numpy.savez` know it.
//!
//! The archive itself (compression, checksums) is the `zip` crate's work. The NPY part is here, because a declared
//! shape must never decide how much memory is taken: every length is checked against the bytes that are really there,
//! and nothing in a header nests.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, Read, Seek, Write};
use std::path::{Path, PathBuf};

use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipArchive, ZipWriter};

use crate::input_error::{InputError, in_one_line};

/// All arrays of one archive together may not unpack to more than this.
const MAX_UNPACKED_BYTES: u64 = 1 << 30;
/// An archive may not hold more entries than this.
const MAX_ENTRIES: usize = 4096;
/// Deflate cannot do better than this; an entry that claims more is a bomb or broken.
const MAX_DEFLATE_RATIO: u64 = 1032;
/// A plain array's header is below 200 bytes.
const MAX_HEADER_BYTES: usize = 4096;

/// The types of array elements that are understood, all little-endian.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Element {
    U8,
    U16,
    U32,
    I32,
    I64,
    F32,
    F64,
    Complex64,
}

impl Element {
    const ALL: [Element; 8] =
        [Self::U8, Self::U16, Self::U32, Self::I32, Self::I64, Self::F32, Self::F64, Self::Complex64];

    /// numpy's descriptor, as it stands in the header.
    fn descriptor(self) -> &'static str {
        match self {
            Self::U8 => "|u1",
            Self::U16 => "<u2",
            Self::U32 => "<u4",
            Self::I32 => "<i4",
            Self::I64 => "<i8",
            Self::F32 => "<f4",
            Self::F64 => "<f8",
            Self::Complex64 => "<c8",
        }
    }

    /// numpy's name.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::U8 => "uint8",
            Self::U16 => "uint16",
            Self::U32 => "uint32",
            Self::I32 => "int32",
            Self::I64 => "int64",
            Self::F32 => "float32",
            Self::F64 => "float64",
            Self::Complex64 => "complex64",
        }
    }

    fn size_bytes(self) -> usize {
        match self {
            Self::U8 => 1,
            Self::U16 => 2,
            Self::U32 | Self::I32 | Self::F32 => 4,
            Self::I64 | Self::F64 | Self::Complex64 => 8,
        }
    }
}

/// An archive that is open for reading. Entries are unpacked one at a time, when asked for.
pub(crate) struct Archive<R> {
    file: PathBuf,
    zip: ZipArchive<R>,
    entries: BTreeMap<String, usize>,
    budget_bytes: u64,
}

impl Archive<BufReader<File>> {
    /// Opens the archive in `path`.
    pub(crate) fn open(path: &Path) -> Result<Self, InputError> {
        let file = File::open(path)
            .map_err(|error| InputError::new(path, format!("cannot be opened: {}", in_one_line(error))))?;
        Self::new(path, BufReader::new(file))
    }
}

impl<R: Read + Seek> Archive<R> {
    /// Opens the archive that `reader` holds; `path` is only for messages.
    pub(crate) fn new(path: &Path, reader: R) -> Result<Self, InputError> {
        let zip = ZipArchive::new(reader).map_err(|error| {
            InputError::new(path, format!("is not a whole NPZ file: {}", in_one_line(error)))
        })?;
        if zip.len() > MAX_ENTRIES {
            return Err(InputError::new(path, format!("holds {} arrays", zip.len()))
                .allowed(format!("at most {MAX_ENTRIES}")));
        }
        let mut entries = BTreeMap::new();
        for index in 0..zip.len() {
            let name = zip.name_for_index(index).and_then(Result::ok).ok_or_else(|| {
                InputError::new(path, format!("has an entry, number {index}, whose name is not text"))
            })?;
            let name = name.strip_suffix(".npy").unwrap_or(&name).to_owned();
            if entries.insert(name.clone(), index).is_some() {
                return Err(InputError::new(path, "is there twice").for_item(printable(&name)));
            }
        }
        Ok(Self { file: path.to_owned(), zip, entries, budget_bytes: MAX_UNPACKED_BYTES })
    }

    /// The names of the arrays, in alphabetical order.
    pub(crate) fn names(&self) -> impl Iterator<Item = &str> {
        self.entries.keys().map(String::as_str)
    }

    /// Unpacks one array; an absent one is an error.
    pub(crate) fn read(&mut self, name: &str) -> Result<Array, InputError> {
        self.read_optional(name)?
            .ok_or_else(|| InputError::new(&self.file, "is missing from the arrays").for_item(name))
    }

    /// Unpacks one array; an absent one is `None`.
    pub(crate) fn read_optional(&mut self, name: &str) -> Result<Option<Array>, InputError> {
        let Some(&index) = self.entries.get(name) else { return Ok(None) };
        let refuse = |reason: String| InputError::new(&self.file, reason).for_item(name);
        let entry = self
            .zip
            .by_index(index)
            .map_err(|error| refuse(format!("cannot be unpacked: {}", in_one_line(error))))?;
        let size_bytes = entry.size();
        if size_bytes > self.budget_bytes {
            return Err(refuse(format!("would bring the unpacked arrays above {MAX_UNPACKED_BYTES} bytes")));
        }
        if size_bytes > entry.compressed_size().saturating_mul(MAX_DEFLATE_RATIO).saturating_add(64) {
            return Err(refuse(format!("claims {size_bytes} bytes, more than its packed data can hold")));
        }
        let capacity = usize::try_from(size_bytes)
            .ok()
            .and_then(|size| size.checked_add(1))
            .ok_or_else(|| refuse("is too large for this machine".into()))?;
        let mut bytes = Vec::new();
        bytes.try_reserve_exact(capacity).map_err(|_| refuse("does not fit into memory".into()))?;
        // One byte more than declared, so that a longer entry is noticed.
        entry
            .take(size_bytes.saturating_add(1))
            .read_to_end(&mut bytes)
            .map_err(|error| refuse(format!("cannot be unpacked: {}", in_one_line(error))))?;
        if bytes.len() as u64 != size_bytes {
            return Err(refuse("has another length than the archive declares".into()));
        }
        self.budget_bytes -= size_bytes;
        Array::parse(&self.file, name, bytes).map(Some)
    }
}

/// One array, its bytes as they stood in the file.
pub(crate) struct Array {
    file: PathBuf,
    name: String,
    element: Element,
    fortran_order: bool,
    shape: Vec<usize>,
    bytes: Vec<u8>,
    data_offset: usize,
}

impl Array {
    fn parse(file: &Path, name: &str, bytes: Vec<u8>) -> Result<Self, InputError> {
        let refuse = |reason: String| InputError::new(file, reason).for_item(name);
        let (header, data_offset) = header_text(&bytes).map_err(|reason| refuse(reason.into()))?;
        let Header { descriptor, fortran_order, shape } =
            Header::parse(header).ok_or_else(|| refuse("has a header that is not a plain array's".into()))?;
        let Some(element) = Element::ALL.into_iter().find(|element| element.descriptor() == descriptor)
        else {
            return Err(refuse(format!("has the element type '{}'", printable(descriptor)))
                .allowed(Element::ALL.map(|element| element.descriptor()).join(", ")));
        };
        let expected_bytes =
            shape.iter().try_fold(element.size_bytes(), |product, &length| product.checked_mul(length));
        let present_bytes = bytes.len() - data_offset;
        if expected_bytes != Some(present_bytes) {
            return Err(refuse(format!(
                "declares the shape {shape:?} of {}, which its {present_bytes} bytes of data do not fill exactly",
                element.name()
            )));
        }
        Ok(Self {
            file: file.to_owned(),
            name: name.to_owned(),
            element,
            fortran_order,
            shape,
            bytes,
            data_offset,
        })
    }

    pub(crate) fn shape(&self) -> &[usize] {
        &self.shape
    }

    /// An error about this array.
    pub(crate) fn refuse(&self, reason: impl Into<String>) -> InputError {
        InputError::new(&self.file, reason).for_item(&self.name)
    }

    /// Checks the element type and the shape; `None` stands for any length.
    pub(crate) fn expect(&self, element: Element, shape: &[Option<usize>]) -> Result<(), InputError> {
        if self.element != element {
            return Err(self.refuse(format!("holds {}", self.element.name())).allowed(element.name()));
        }
        self.expect_shape(shape)
    }

    /// Checks the shape; `None` stands for any length.
    pub(crate) fn expect_shape(&self, shape: &[Option<usize>]) -> Result<(), InputError> {
        let fits = self.shape.len() == shape.len()
            && self
                .shape
                .iter()
                .zip(shape)
                .all(|(&found, wanted)| wanted.is_none_or(|wanted| wanted == found));
        if fits {
            return Ok(());
        }
        let wanted: Vec<_> =
            shape.iter().map(|length| length.map_or("any".into(), |l| l.to_string())).collect();
        Err(self
            .refuse(format!("has the shape {:?}", self.shape))
            .allowed(format!("[{}]", wanted.join(", "))))
    }

    fn data(&self) -> &[u8] {
        &self.bytes[self.data_offset..]
    }

    /// Where the element at `flat` (row by row) lies among the elements of the file.
    fn place(&self, flat: usize) -> usize {
        match self.shape[..] {
            [rows, columns] if self.fortran_order && columns > 0 => flat % columns * rows + flat / columns,
            _ => flat,
        }
    }

    /// The number of elements.
    pub(crate) fn len(&self) -> usize {
        self.shape.iter().product()
    }

    /// One element as a float; exact for every type but 64-bit integers. Complex numbers give NaN.
    pub(crate) fn float(&self, flat: usize) -> f64 {
        let place = self.place(flat);
        match self.element {
            Element::U8 => f64::from(self.data()[place]),
            Element::U16 => f64::from(u16::from_le_bytes(self.data().as_chunks().0[place])),
            Element::U32 => f64::from(u32::from_le_bytes(self.data().as_chunks().0[place])),
            Element::I32 => f64::from(i32::from_le_bytes(self.data().as_chunks().0[place])),
            Element::I64 => i64::from_le_bytes(self.data().as_chunks().0[place]) as f64,
            Element::F32 => f64::from(f32::from_le_bytes(self.data().as_chunks().0[place])),
            Element::F64 => f64::from_le_bytes(self.data().as_chunks().0[place]),
            Element::Complex64 => f64::NAN,
        }
    }

    /// All elements as floats, row by row.
    pub(crate) fn floats(&self) -> Vec<f64> {
        (0..self.len()).map(|flat| self.float(flat)).collect()
    }

    /// All elements as whole numbers, row by row; a fraction or a negative number is an error.
    pub(crate) fn indexes(&self) -> Result<Vec<usize>, InputError> {
        (0..self.len())
            .map(|flat| {
                let value = self.float(flat);
                if value.fract() == 0.0 && (0.0..=f64::from(u32::MAX)).contains(&value) {
                    Ok(value as usize)
                } else {
                    Err(self.refuse(format!("is {value} at index {flat}")).allowed("whole numbers from 0"))
                }
            })
            .collect()
    }

    /// One row of a two-dimensional array as `f32`.
    pub(crate) fn float_row(&self, row: usize) -> Vec<f32> {
        let columns = self.shape.get(1).copied().unwrap_or(1);
        (0..columns).map(|column| self.float(row * columns + column) as f32).collect()
    }

    /// One row of a two-dimensional array of complex numbers, as pairs of real and imaginary part. The element type
    /// is to be checked first.
    pub(crate) fn complex_row(&self, row: usize) -> Vec<[f32; 2]> {
        let columns = self.shape.get(1).copied().unwrap_or(1);
        let parts = self.data().as_chunks().0;
        (0..columns)
            .map(|column| {
                let place = self.place(row * columns + column);
                [f32::from_le_bytes(parts[2 * place]), f32::from_le_bytes(parts[2 * place + 1])]
            })
            .collect()
    }
}

/// The dictionary of an NPY header and where the data start.
fn header_text(bytes: &[u8]) -> Result<(&str, usize), &'static str> {
    const BROKEN: &str = "has a truncated or foreign NPY header";
    let rest = bytes.strip_prefix(b"\x93NUMPY").ok_or(BROKEN)?;
    let (version, rest) = rest.split_first_chunk::<2>().ok_or(BROKEN)?;
    let (length, rest) = match version[0] {
        1 => rest.split_first_chunk().map(|(&length, rest)| (usize::from(u16::from_le_bytes(length)), rest)),
        2 | 3 => rest.split_first_chunk().map(|(&length, rest)| (u32::from_le_bytes(length) as usize, rest)),
        _ => None,
    }
    .ok_or(BROKEN)?;
    if length > MAX_HEADER_BYTES {
        return Err("has an NPY header longer than a plain array's");
    }
    let header = rest.get(..length).ok_or(BROKEN)?;
    let header = std::str::from_utf8(header).map_err(|_| BROKEN)?;
    Ok((header, bytes.len() - rest.len() + length))
}

/// The three facts of an NPY header.
#[derive(Debug, PartialEq)]
struct Header<'a> {
    descriptor: &'a str,
    fortran_order: bool,
    shape: Vec<usize>,
}

impl<'a> Header<'a> {
    /// Parses the one form of dictionary that plain arrays have; the keys may come in any order.
    fn parse(text: &'a str) -> Option<Self> {
        let mut rest = text.trim().strip_prefix('{')?.strip_suffix('}')?.trim();
        let (mut descriptor, mut fortran_order, mut shape) = (None, None, None);
        while !rest.is_empty() {
            let (key, after) = quoted(rest)?;
            let value = after.trim_start().strip_prefix(':')?.trim_start();
            rest = match key {
                "descr" => {
                    let (found, after) = quoted(value)?;
                    descriptor = Some(found);
                    after
                }
                "fortran_order" => {
                    let word = if value.starts_with("True") { "True" } else { "False" };
                    fortran_order = Some(word == "True");
                    value.strip_prefix(word)?
                }
                "shape" => {
                    let (inside, after) = value.strip_prefix('(')?.split_once(')')?;
                    let lengths = inside.split(',').map(str::trim).filter(|length| !length.is_empty());
                    shape = Some(lengths.map(|length| length.parse().ok()).collect::<Option<Vec<usize>>>()?);
                    after
                }
                _ => return None,
            }
            .trim_start();
            rest = match rest.strip_prefix(',') {
                Some(after) => after.trim_start(),
                None if rest.is_empty() => rest,
                None => return None,
            };
        }
        Some(Self { descriptor: descriptor?, fortran_order: fortran_order?, shape: shape? })
    }
}

/// Takes a string in quotes from the front.
fn quoted(text: &str) -> Option<(&str, &str)> {
    let quote = text.chars().next().filter(|quote| matches!(quote, '\'' | '"'))?;
    text[1..].split_once(quote)
}

/// A name from a file, cut and cleaned so that it can stand in a message.
pub(crate) fn printable(name: &str) -> String {
    name.chars().take(60).map(|letter| if letter.is_control() { '?' } else { letter }).collect()
}

/// An archive that is being written.
pub(crate) struct ArchiveWriter<W: Write + Seek> {
    zip: ZipWriter<W>,
    budget_bytes: u64,
}

impl<W: Write + Seek> ArchiveWriter<W> {
    pub(crate) fn new(writer: W) -> Self {
        Self { zip: ZipWriter::new(writer), budget_bytes: MAX_UNPACKED_BYTES }
    }

    /// Adds one array; `bytes` are its little-endian elements, row by row. The same arrays give the same file: the
    /// entries carry no time of writing.
    pub(crate) fn add(
        &mut self,
        name: &str,
        element: Element,
        shape: &[usize],
        bytes: impl Iterator<Item = u8>,
    ) -> std::io::Result<()> {
        let lengths: String = shape.iter().map(|length| format!("{length}, ")).collect();
        let mut header = format!(
            "{{'descr': '{}', 'fortran_order': False, 'shape': ({}), }}",
            element.descriptor(),
            if shape.len() == 1 { lengths.trim_end() } else { lengths.trim_end_matches(", ") }
        );
        // Magic, version and length take 10 bytes; the data start at a multiple of 64.
        while (10 + header.len() + 1) % 64 != 0 {
            header.push(' ');
        }
        header.push('\n');
        let mut npy = b"\x93NUMPY\x01\x00".to_vec();
        npy.extend((header.len() as u16).to_le_bytes());
        npy.extend(header.as_bytes());
        npy.extend(bytes);
        // What the reader would refuse is not written.
        self.budget_bytes = self.budget_bytes.checked_sub(npy.len() as u64).ok_or_else(|| {
            std::io::Error::other(format!("the arrays take more than {MAX_UNPACKED_BYTES} bytes"))
        })?;
        let options = SimpleFileOptions::default()
            .compression_method(CompressionMethod::Deflated)
            .last_modified_time(zip::DateTime::default())
            .unix_permissions(0o644);
        self.zip.start_file(format!("{name}.npy"), options).map_err(std::io::Error::other)?;
        self.zip.write_all(&npy)
    }

    /// Ends the archive and gives the writer back.
    pub(crate) fn finish(self) -> std::io::Result<W> {
        self.zip.finish().map_err(std::io::Error::other)
    }
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use super::*;

    fn archive_of(entries: &[(&str, &[u8])]) -> Archive<Cursor<Vec<u8>>> {
        let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
        for (name, bytes) in entries {
            zip.start_file(format!("{name}.npy"), SimpleFileOptions::default()).expect("starts");
            zip.write_all(bytes).expect("is written");
        }
        let bytes = zip.finish().expect("ends").into_inner();
        Archive::new(Path::new("test.npz"), Cursor::new(bytes)).expect("opens")
    }

    fn npy(header: &str, data: &[u8]) -> Vec<u8> {
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((header.len() as u16).to_le_bytes());
        bytes.extend(header.as_bytes());
        bytes.extend(data);
        bytes
    }

    fn refusal(header: &str, data: &[u8]) -> String {
        let mut archive = archive_of(&[("a", &npy(header, data))]);
        archive.read("a").err().expect("is refused").to_string()
    }

    #[test]
    fn an_array_is_read_back_as_it_was_written() {
        let mut writer = ArchiveWriter::new(Cursor::new(Vec::new()));
        let values = [1.5f64, -2.0, 3.25, 0.0, 1e300, 7.0];
        writer
            .add("a", Element::F64, &[3, 2], values.iter().flat_map(|value| value.to_le_bytes()))
            .expect("is written");
        let bytes = writer.finish().expect("ends").into_inner();
        let mut archive = Archive::new(Path::new("test.npz"), Cursor::new(bytes)).expect("opens");
        let array = archive.read("a").expect("is there");
        array.expect(Element::F64, &[None, Some(2)]).expect("has its type and shape");
        assert_eq!(array.floats(), values);
    }

    #[test]
    fn an_array_stored_column_by_column_is_read_row_by_row() {
        let header = "{'descr': '|u1', 'fortran_order': True, 'shape': (2, 3), }\n";
        let mut archive = archive_of(&[("a", &npy(header, &[1, 4, 2, 5, 3, 6]))]);
        assert_eq!(archive.read("a").expect("is there").floats(), [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
    }

    #[test]
    fn keys_of_a_header_may_come_in_any_order() {
        let header =
            Header::parse("{\"shape\": (2,), 'fortran_order': False, 'descr': '<f8'}").expect("parses");
        assert_eq!(header, Header { descriptor: "<f8", fortran_order: false, shape: vec![2] });
    }

    #[test]
    fn a_declared_shape_takes_no_memory() {
        for shape in ["(4611686018427387904,)", "(4611686018427387904, 0)", "(1152921504606846976, 16)"] {
            let message =
                refusal(&format!("{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}\n"), &[]);
            assert!(message.contains("`a`"), "{message}");
        }
    }

    #[test]
    fn structured_types_objects_and_nesting_are_refused() {
        for descriptor in ["[('x', '<f8')]", "'|O'", "'>f8'"] {
            let header = format!("{{'descr': {descriptor}, 'fortran_order': False, 'shape': (0,), }}\n");
            refusal(&header, &[]);
        }
        refusal(&"(".repeat(4000), &[]);
        refusal(&"{".repeat(60_000), &[]);
    }

    #[test]
    fn an_array_that_is_not_there_is_named() {
        let mut archive = archive_of(&[]);
        assert_eq!(
            archive.read("b").err().expect("refused").to_string(),
            "test.npz: `b` is missing from the arrays."
        );
    }

    #[test]
    fn an_entry_that_claims_more_than_its_data_is_refused() {
        let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
        zip.start_file("a.npy", SimpleFileOptions::default()).expect("starts");
        zip.write_all(b"tiny").expect("is written");
        let mut bytes = zip.finish().expect("ends").into_inner();
        // The unpacked size stands 24 bytes into the entry of the central directory.
        let central = bytes.windows(4).position(|window| window == b"PK\x01\x02").expect("has a directory");
        bytes[central + 24..central + 28].copy_from_slice(&0x3fff_ffffu32.to_le_bytes());
        let refused = match Archive::new(Path::new("test.npz"), Cursor::new(bytes)) {
            Ok(mut archive) => archive.read("a").is_err(),
            Err(_) => true,
        };
        assert!(refused);
    }
}
