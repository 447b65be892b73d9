//! The estimate as data: what a tracker believes after every cycle, as a table with one row a cycle.
//!
//! docs/estimate-table.md says what the columns mean. In CSV a value that is not known is empty, in NPZ it is NaN.

use crate::input_error::InputError;
use crate::recording::Recording;
use crate::recording::npz::{ArchiveWriter, Element};
use crate::whole_file;
use std::io::{self, Cursor, Write};
use std::path::Path;

/// What a tracker believes after a cycle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Mean position, metres.
    pub position_m: [f64; 2],
    /// Mean velocity, m/s; `None` where the tracker knows none.
    pub velocity_m_s: Option<[f64; 2]>,
    /// Covariance of the position, square metres: xx, xy, yy. Of everything that is believed: a tag that may be in two
    /// places is that uncertain.
    pub covariance_m2: [f64; 3],
    /// Whether the tracker says that it does not know where the tag is (yet, or any more).
    pub searching: bool,
    /// Probability that the tag is where `position_m` and `covariance_m2` have it, 0 to 1; `None` from a tracker that gives none.
    pub probability: Option<f64>,
    /// Index of the action that the cycle's frames were received with.
    pub action: Option<usize>,
    /// Differential entropy of the position, nats.
    pub entropy_nat: Option<f64>,
    /// Height of the tag, metres.
    pub height_m: Option<f64>,
}

impl Estimate {
    /// Distance of the mean position from the true one, metres.
    pub fn error_m(&self, [x, y]: [f64; 2]) -> f64 {
        let [u, v] = self.position_m;
        (x - u).hypot(y - v)
    }
}

/// A column: its name, the type of its elements in an archive, and its value in a row.
type Column = (&'static str, Element, fn(&Row) -> Option<f64>);

/// Where a lag was asked for, these follow.
const LAG_COLUMNS: [Column; 2] = [
    ("lag_x_m", Element::F64, |row| row.lag_m.map(|[x, _]| x)),
    ("lag_y_m", Element::F64, |row| row.lag_m.map(|[_, y]| y)),
];

const COLUMNS: [Column; 17] = [
    ("cycle", Element::U32, |row| Some(row.cycle as f64)),
    ("time_s", Element::F64, |row| Some(row.time_s)),
    ("x_m", Element::F64, |row| Some(row.estimate.position_m[0])),
    ("y_m", Element::F64, |row| Some(row.estimate.position_m[1])),
    ("vx_m_s", Element::F64, |row| row.estimate.velocity_m_s.map(|[x, _]| x)),
    ("vy_m_s", Element::F64, |row| row.estimate.velocity_m_s.map(|[_, y]| y)),
    ("cxx_m2", Element::F64, |row| Some(row.estimate.covariance_m2[0])),
    ("cxy_m2", Element::F64, |row| Some(row.estimate.covariance_m2[1])),
    ("cyy_m2", Element::F64, |row| Some(row.estimate.covariance_m2[2])),
    ("searching", Element::U8, |row| Some(f64::from(u8::from(row.estimate.searching)))),
    ("probability", Element::F64, |row| row.estimate.probability),
    ("action", Element::F64, |row| row.estimate.action.map(|action| action as f64)),
    ("entropy_nat", Element::F64, |row| row.estimate.entropy_nat),
    ("height_m", Element::F64, |row| row.estimate.height_m),
    ("true_x_m", Element::F64, |row| row.truth_m.map(|[x, _]| x)),
    ("true_y_m", Element::F64, |row| row.truth_m.map(|[_, y]| y)),
    ("error_m", Element::F64, |row| row.truth_m.map(|truth| row.estimate.error_m(truth))),
];

/// A cycle of a recording with what a tracker made of it.
#[derive(Clone, Copy, Debug)]
struct Row {
    cycle: usize,
    time_s: f64,
    estimate: Estimate,
    truth_m: Option<[f64; 2]>,
    lag_m: Option<[f64; 2]>,
}

/// The file formats of a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// Comma-separated values.
    Csv,
    /// One array per column, as `numpy.load` knows it.
    Npz,
}

impl Format {
    /// The format that the extension of a file stands for.
    ///
    /// # Errors
    /// It is neither `.csv` nor `.npz`.
    pub fn of(file: &Path) -> Result<Self, InputError> {
        let extension = file.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
        match extension.as_str() {
            "csv" => Ok(Self::Csv),
            "npz" => Ok(Self::Npz),
            _ => Err(InputError::new(file, "does not say by its extension which kind of table it is to be")
                .allowed(".csv or .npz")),
        }
    }
}

/// Writes the estimates of a recording's cycles, in their order, to the file `to`; with where the tag was known to have been a lag
/// later, metres, where that is given.
///
/// # Errors
/// The file cannot be written.
pub fn write(
    recording: &Recording,
    estimates: &[Estimate],
    lagged_m: Option<&[Option<[f64; 2]>]>,
    format: Format,
    to: &Path,
) -> io::Result<()> {
    let columns: Vec<Column> = COLUMNS.into_iter().chain(lagged_m.iter().flat_map(|_| LAG_COLUMNS)).collect();
    let cycles = recording.cycles.iter().zip(estimates).enumerate();
    let rows: Vec<Row> = cycles
        .map(|(cycle, (measured, estimate))| Row {
            cycle,
            time_s: measured.time_s,
            estimate: *estimate,
            truth_m: measured.truth_position_m,
            lag_m: lagged_m.and_then(|lagged_m| lagged_m.get(cycle).copied().flatten()),
        })
        .collect();
    whole_file::write(to, |file| match format {
        Format::Csv => write_csv(&columns, &rows, file),
        Format::Npz => file.write_all(&npz(&columns, &rows)?),
    })
}

fn write_csv(columns: &[Column], rows: &[Row], file: &mut dyn Write) -> io::Result<()> {
    let line = |cells: &mut dyn Iterator<Item = String>| cells.collect::<Vec<_>>().join(",");
    writeln!(file, "{}", line(&mut columns.iter().map(|(name, ..)| (*name).to_owned())))?;
    for row in rows {
        // The shortest number that is read back with the same bits.
        let cell = |(.., value): &Column| value(row).map_or_else(String::new, |value| value.to_string());
        writeln!(file, "{}", line(&mut columns.iter().map(cell)))?;
    }
    Ok(())
}

fn npz(columns: &[Column], rows: &[Row]) -> io::Result<Vec<u8>> {
    let mut archive = ArchiveWriter::new(Cursor::new(Vec::new()));
    for &(name, element, value) in columns {
        let mut bytes = Vec::new();
        for value in rows.iter().map(|row| value(row).unwrap_or(f64::NAN)) {
            match element {
                Element::U8 => bytes.push(value as u8),
                Element::U32 => bytes.extend((value as u32).to_le_bytes()),
                _ => bytes.extend(value.to_le_bytes()),
            }
        }
        archive.add(name, element, &[rows.len()], bytes.into_iter())?;
    }
    Ok(archive.finish()?.into_inner())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::npz::Archive;
    use crate::recording::tests::{Folder, example};
    use std::fs;

    /// Three cycles: all known; hardly anything known; no truth.
    fn case() -> (Recording, [Estimate; 3]) {
        let mut recording = example();
        recording.cycles[2].truth_position_m = None;
        let known = Estimate {
            position_m: [3.3, 7.4],
            velocity_m_s: Some([0.5, -0.25]),
            covariance_m2: [0.04, -0.01, 0.09],
            searching: false,
            probability: Some(0.75),
            action: Some(1),
            entropy_nat: Some(-1.5),
            height_m: Some(1.25),
        };
        let unknown = Estimate {
            velocity_m_s: None,
            searching: true,
            probability: None,
            action: None,
            entropy_nat: None,
            height_m: None,
            ..known
        };
        (recording, [known, unknown, known])
    }

    #[test]
    fn a_row_holds_the_columns_in_their_order_and_nothing_where_nothing_is_known() {
        let folder = Folder::new();
        let to = folder.0.join("t.csv");
        let (recording, estimates) = case();
        write(&recording, &estimates, None, Format::Csv, &to).expect("is written");
        let text = fs::read_to_string(to).expect("is there");
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(
            lines[0],
            "cycle,time_s,x_m,y_m,vx_m_s,vy_m_s,cxx_m2,cxy_m2,cyy_m2,searching,probability,action,entropy_nat,height_m,\
             true_x_m,true_y_m,error_m"
        );
        // 0.3 m and 0.4 m off: half a metre.
        let (row, error) = lines[1].rsplit_once(',').expect("has columns");
        assert_eq!(row, "0,0,3.3,7.4,0.5,-0.25,0.04,-0.01,0.09,0,0.75,1,-1.5,1.25,3,7");
        assert!((error.parse::<f64>().expect("is a number") - 0.5).abs() < 1e-12, "{error}");
        assert!(lines[2].starts_with("1,0.1,3.3,7.4,,,0.04,-0.01,0.09,1,,,,,3,7.01,0.49"), "{}", lines[2]);
        assert_eq!(lines[3], "2,0.2,3.3,7.4,0.5,-0.25,0.04,-0.01,0.09,0,0.75,1,-1.5,1.25,,,");
        assert_eq!(lines.len(), 4);
    }

    #[test]
    fn the_archive_holds_the_numbers_of_the_csv_and_nan_where_that_is_empty() {
        let folder = Folder::new();
        let (csv, npz) = (folder.0.join("t.csv"), folder.0.join("t.npz"));
        let (recording, estimates) = case();
        write(&recording, &estimates, None, Format::Csv, &csv).expect("is written");
        write(&recording, &estimates, None, Format::Npz, &npz).expect("is written");
        let mut reader = csv::Reader::from_path(csv).expect("opens");
        let names = reader.headers().expect("has a heading").clone();
        let rows: Vec<csv::StringRecord> = reader.records().map(|row| row.expect("is read")).collect();
        let mut archive = Archive::open(&npz).expect("opens");
        for (index, name) in names.iter().enumerate() {
            let array = archive.read(name).expect("is there");
            array.expect(COLUMNS[index].1, &[Some(3)]).expect("has its type and length");
            for (row, value) in rows.iter().zip(array.floats()) {
                match row[index].parse::<f64>() {
                    Ok(number) => assert_eq!(number.to_bits(), value.to_bits(), "{name}"),
                    Err(_) => assert!(row[index].is_empty() && value.is_nan(), "{name}: {value}"),
                }
            }
        }
    }

    #[test]
    fn the_extension_says_which_format_is_meant() {
        assert_eq!(Format::of(Path::new("a.b/t.CSV")), Ok(Format::Csv));
        assert_eq!(Format::of(Path::new("t.npz")), Ok(Format::Npz));
        for wrong in ["t", "t.txt", "csv", ".csv", "t.csv.gz"] {
            let said = Format::of(Path::new(wrong)).expect_err("is refused").to_string();
            assert!(said.starts_with(wrong) && said.ends_with("allowed is .csv or .npz."), "{said}");
        }
    }
}
