//! Snapshots: the state of a tracker as bytes, to go on after a power cut with the same bits.
//!
//! A snapshot is, byte for byte and on every machine the same,
//!
//! | bytes | |
//! | --- | --- |
//! | 0..4 | `COGS` |
//! | 4..8 | version |
//! | 8..16 | digest of what the tracker was told: configuration, anchors, plan, actions, capacities |
//! | 16..20 | length of the state in bytes |
//! | 20.. | the state: all numbers little-endian in a fixed order, floats by their bits, options and lists after a count |
//! | last 8 | checksum over all bytes before it (FNV-1a, 64 bits) |
//!
//! What the tracker was told is not in it: firmware has it in flash, and starts the tracker with it. A snapshot of a tracker that was told
//! anything else is refused, as is one that is torn, cut short or flipped anywhere; nothing has changed then. Every type codes its own
//! fields (`Stored`), all of them: a field that is added and not coded does not compile. By the same code state is sealed (`seal`): a bit
//! that flips in it between two cycles is found.

mod seal;
mod stored;

use crate::trace::TraceHash;
use core::fmt;

pub(crate) use seal::{Sealed, seal, seal_with};
pub(crate) use stored::{Blank, Stored, Told, Written, stored, written};

/// Guard: against snapshots of another layout, which are refused: counts the versions of the format.
pub const VERSION: u32 = 1;
/// What stands in front of the bytes of one kind.
pub(crate) struct Form {
    pub magic: [u8; 4],
    pub version: u32,
}

/// That of a tracker's whole state.
pub(crate) const STATE: Form = Form { magic: *b"COGS", version: VERSION };
/// Capacity: bytes ahead of the state.
const HEADER: usize = 20;
/// Capacity: bytes behind it.
const CHECKSUM: usize = 8;

/// Why a snapshot was not taken or is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum SnapshotError {
    /// The buffer is too short.
    Room {
        /// Bytes that it takes.
        needed: usize,
    },
    /// A cycle is begun and not finished; or, of a map, the first one was.
    Begun,
    /// The tracker is not started.
    NotStarted,
    /// It is no snapshot, or is cut short.
    Foreign,
    /// It is of another version.
    Version {
        /// Of the snapshot.
        found: u32,
    },
    /// It is of a tracker that was told something else, or has other capacities.
    Told,
    /// Bytes of it are not as they were written.
    Damaged,
}

impl fmt::Display for SnapshotError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Room { needed } => write!(f, "the snapshot takes {needed} bytes"),
            Self::Begun => write!(f, "a cycle is begun"),
            Self::NotStarted => write!(f, "the tracker is not started"),
            Self::Foreign => write!(f, "no snapshot, or cut short"),
            Self::Version { found } => write!(f, "a snapshot of version {found}, not {VERSION}"),
            Self::Told => write!(f, "a snapshot of a tracker that was told something else"),
            Self::Damaged => write!(f, "the snapshot is damaged"),
        }
    }
}

impl core::error::Error for SnapshotError {}

/// Where state goes, byte by byte; or by larger pieces, where that is faster.
pub(crate) trait Sink {
    fn byte(&mut self, byte: u8);

    fn bytes(&mut self, bytes: &[u8]) {
        bytes.iter().for_each(|byte| self.byte(*byte));
    }

    fn word(&mut self, word: u32) {
        self.bytes(&word.to_le_bytes());
    }

    fn float(&mut self, value: f32) {
        self.word(value.to_bits());
    }

    fn floats(&mut self, values: &[f32]) {
        values.iter().for_each(|value| self.float(*value));
    }

    /// A list of so many entries begins, of which its memory has room for `room`; whether they are to follow.
    fn list(&mut self, count: usize, _room: usize) -> bool {
        self.bytes(&(count as u16).to_le_bytes());
        true
    }
}

/// The digest of what is told.
#[derive(Default)]
pub(crate) struct Digest(TraceHash);

impl Digest {
    pub fn value(&self) -> u64 {
        self.0.value()
    }
}

impl Sink for Digest {
    fn byte(&mut self, byte: u8) {
        self.0.word(u32::from(byte));
    }
}

/// A snapshot being written. What there is no room for is only counted.
struct Writer<'a> {
    buffer: &'a mut [u8],
    length: usize,
    hash: Digest,
}

impl Sink for Writer<'_> {
    fn byte(&mut self, byte: u8) {
        if let Some(place) = self.buffer.get_mut(self.length) {
            *place = byte;
        }
        self.length += 1;
        self.hash.byte(byte);
    }
}

/// The state in a snapshot being read.
#[derive(Clone)]
pub(crate) struct Reader<'a> {
    bytes: &'a [u8],
    /// Whether values are only checked.
    is_trial: bool,
}

impl Reader<'_> {
    /// The next bytes.
    pub fn take<const N: usize>(&mut self) -> Result<[u8; N], SnapshotError> {
        let (head, tail) = self.bytes.split_first_chunk().ok_or(SnapshotError::Damaged)?;
        self.bytes = tail;
        Ok(*head)
    }

    /// Whether nothing is left.
    pub fn is_empty(&self) -> bool {
        self.bytes.is_empty()
    }

    /// Whether values are only checked.
    pub fn is_trial(&self) -> bool {
        self.is_trial
    }
}

/// Writes a snapshot of `state`; its length.
pub(crate) fn write(
    form: &Form,
    digest: u64,
    state: &impl Written,
    buffer: &mut [u8],
) -> Result<usize, SnapshotError> {
    let mut counter = Writer { buffer: &mut [], length: 0, hash: Digest::default() };
    state.write(&mut counter);
    let length = counter.length;
    let needed = HEADER + length + CHECKSUM;
    if buffer.len() < needed {
        return Err(SnapshotError::Room { needed });
    }
    let mut writer = Writer { buffer, length: 0, hash: Digest::default() };
    form.magic.write(&mut writer);
    form.version.write(&mut writer);
    digest.write(&mut writer);
    (length as u32).write(&mut writer);
    state.write(&mut writer);
    let checksum = writer.hash.value();
    checksum.write(&mut writer);
    Ok(needed)
}

/// Looks at what stands in front of the state, and at the checksum; the state.
pub(crate) fn open<'a>(form: &Form, digest: u64, bytes: &'a [u8]) -> Result<Reader<'a>, SnapshotError> {
    let mut header = Reader { bytes, is_trial: false };
    let mut word = || header.take::<4>().map_err(|_| SnapshotError::Foreign);
    if word()? != form.magic {
        return Err(SnapshotError::Foreign);
    }
    let found = u32::from_le_bytes(word()?);
    let told = [word()?, word()?];
    let length = u32::from_le_bytes(word()?) as usize;
    let end = HEADER.saturating_add(length);
    let (Some(checked), Some(body)) = (bytes.get(..end), bytes.get(HEADER..end)) else {
        return Err(SnapshotError::Foreign);
    };
    let Some(checksum) = bytes.get(end..).and_then(|rest| rest.first_chunk::<CHECKSUM>()) else {
        return Err(SnapshotError::Foreign);
    };
    let mut hash = Digest::default();
    checked.iter().for_each(|byte| hash.byte(*byte));
    if u64::from_le_bytes(*checksum) != hash.value() {
        return Err(SnapshotError::Damaged);
    }
    if found != form.version {
        return Err(SnapshotError::Version { found });
    }
    let [low, high] = told.map(u32::from_le_bytes);
    if u64::from(low) | u64::from(high) << 32 != digest {
        return Err(SnapshotError::Told);
    }
    Ok(Reader { bytes: body, is_trial: false })
}

/// Reads a snapshot into `state`, all of it or nothing.
pub(crate) fn read(
    form: &Form,
    digest: u64,
    state: &mut impl Stored,
    bytes: &[u8],
) -> Result<(), SnapshotError> {
    let body = open(form, digest, bytes)?;
    for is_trial in [true, false] {
        let mut reader = Reader { is_trial, ..body.clone() };
        state.read(&mut reader)?;
        if !reader.bytes.is_empty() {
            return Err(SnapshotError::Damaged);
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use heapless::Vec;

    type State = (u32, [f32; 2], Vec<u16, 4>, Option<u8>);

    fn state() -> State {
        (7, [1.5, -0.0], Vec::from_slice(&[3, 4, 5]).unwrap(), Some(9))
    }

    #[test]
    fn a_snapshot_has_the_bytes_documented() {
        let mut buffer = [0xaa; 64];
        let length = write(&STATE, 0x0102_0304_0506_0708, &state(), &mut buffer).unwrap();
        let mut expected = std::vec::Vec::from(*b"COGS\x01\0\0\0\x08\x07\x06\x05\x04\x03\x02\x01");
        // 4 + 8 + 2 and 6 + 1 and 1 bytes of state.
        expected.extend(22_u32.to_le_bytes());
        expected.extend(7_u32.to_le_bytes());
        expected.extend(1.5_f32.to_le_bytes());
        expected.extend((-0.0_f32).to_le_bytes());
        expected.extend([3, 0, 3, 0, 4, 0, 5, 0, 1, 9]);
        assert_eq!(buffer[..length - 8], expected[..]);
        assert_eq!(length, 20 + 22 + 8);
        assert!(buffer[length..].iter().all(|byte| *byte == 0xaa));
    }

    #[test]
    fn what_was_written_is_read() {
        let mut buffer = [0; 64];
        let length = write(&STATE, 1, &state(), &mut buffer).unwrap();
        let mut other: State = (0, [0.0; 2], Vec::from_slice(&[1, 1, 1, 1]).unwrap(), None);
        // What follows it does no harm: pages of a flash are longer.
        read(&STATE, 1, &mut other, &buffer).unwrap();
        assert_eq!(other, state());
        assert!(other.1[1].is_sign_negative());
        assert_eq!(
            write(&STATE, 1, &state(), &mut buffer[..length - 1]),
            Err(SnapshotError::Room { needed: length })
        );
    }

    #[test]
    fn every_damage_is_refused_and_changes_nothing() {
        let mut buffer = [0; 64];
        let length = write(&STATE, 1, &state(), &mut buffer).unwrap();
        let mut other: State = (0, [0.5; 2], Vec::new(), None);
        let before = other.clone();
        for end in 0..length {
            assert!(read(&STATE, 1, &mut other, &buffer[..end]).is_err(), "{end}");
        }
        for bit in 0..8 * length {
            let mut flipped = buffer;
            flipped[bit / 8] ^= 1 << (bit % 8);
            assert!(read(&STATE, 1, &mut other, &flipped).is_err(), "{bit}");
        }
        assert_eq!(read(&STATE, 2, &mut other, &buffer), Err(SnapshotError::Told));
        assert_eq!(other, before);
        // A list that is longer than there is room for, under a checksum that holds.
        let long: Vec<u16, 8> = Vec::from_slice(&[1; 6]).unwrap();
        write(&STATE, 1, &(7_u32, [0.0_f32; 2], long, Some(1_u8)), &mut buffer).unwrap();
        assert_eq!(read(&STATE, 1, &mut other, &buffer), Err(SnapshotError::Damaged));
        assert_eq!(other, before);
    }
}
