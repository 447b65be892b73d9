//! Two slots of a flash that snapshots go to in turn, so that a power cut leaves the last one or the one before. To be copied into
//! firmware: it needs no heap, and a NOR flash by the traits of `embedded-storage`.
//!
//! A slot is erased, then the snapshot is written behind a page of its own for the mark, and the mark last: it is what makes a
//! snapshot the newest. A mark that was cut off does not hold; what is in the snapshot, its own checksum says.
//!
//! | bytes of the mark | |
//! | --- | --- |
//! | 0..4 | number of the snapshot, little-endian; the next one counts one more |
//! | 4..8 | the same, inverted |

use cogmint_core::SnapshotError;
use embedded_storage::nor_flash::NorFlash;

/// Bytes of the mark, at least.
const MARK: usize = 8;
/// The most that a flash writes at once, bytes.
const WIDEST: usize = 32;

/// Two slots of equal length in a flash.
pub struct TwoSlots<F> {
    flash: F,
    begin: u32,
    slot_bytes: u32,
    /// Number of the snapshot that was read or written last, and its slot.
    last: Option<(u32, u32)>,
}

/// Why nothing was stored or found.
#[derive(Debug, PartialEq, Eq)]
pub enum StorageError<E> {
    /// The flash reports this.
    Flash(E),
    /// The snapshot does not fit into a slot or the buffer.
    Room,
    /// No slot has a snapshot that this tracker takes; this is what it says of the newest.
    Refused(SnapshotError),
    /// No slot has a snapshot.
    Empty,
}

impl<F: NorFlash> TwoSlots<F> {
    /// Slots of `slot_bytes` each, from `begin` on; both on boundaries of what the flash erases at once.
    pub fn new(flash: F, begin: u32, slot_bytes: u32) -> Self {
        Self { flash, begin, slot_bytes, last: None }
    }

    /// The flash again.
    pub fn into_flash(self) -> F {
        self.flash
    }

    /// Hands the newest snapshot to `restore`, and where that refuses it, the other one. `buffer` has room for a slot.
    ///
    /// # Errors
    /// Nothing is restored: of the flash, [`StorageError::Refused`], or [`StorageError::Empty`].
    pub fn restore(
        &mut self,
        buffer: &mut [u8],
        mut restore: impl FnMut(&[u8]) -> Result<(), SnapshotError>,
    ) -> Result<(), StorageError<F::Error>> {
        let [first, second] = [self.number(0)?, self.number(1)?];
        let newest = match (first, second) {
            // Numbers begin again after 2^32.
            (Some(a), Some(b)) if a.wrapping_sub(b) > u32::MAX / 2 => [(1, second), (0, first)],
            (None, _) => [(1, second), (0, first)],
            _ => [(0, first), (1, second)],
        };
        let mut refused = None;
        for (slot, number) in newest {
            let Some(number) = number else { continue };
            let length = self.slot_bytes as usize - mark_bytes::<F>();
            let bytes = buffer.get_mut(..length).ok_or(StorageError::Room)?;
            self.flash
                .read(self.place(slot) + mark_bytes::<F>() as u32, bytes)
                .map_err(StorageError::Flash)?;
            match restore(bytes) {
                Ok(()) => {
                    self.last = Some((number, slot));
                    return Ok(());
                }
                Err(error) => refused = refused.or(Some(error)),
            }
        }
        Err(refused.map_or(StorageError::Empty, StorageError::Refused))
    }

    /// Stores a snapshot, once the slots were looked at (`restore`), else it may go over the newest: the first `length` bytes of a buffer, which has room for as many more as the flash writes at once.
    ///
    /// # Errors
    /// Of the flash, or [`StorageError::Room`]. The snapshot before is still there.
    pub fn store(&mut self, buffer: &mut [u8], length: usize) -> Result<(), StorageError<F::Error>> {
        let padded = length.next_multiple_of(F::WRITE_SIZE);
        let bytes = buffer.get_mut(..padded).ok_or(StorageError::Room)?;
        if padded + mark_bytes::<F>() > self.slot_bytes as usize {
            return Err(StorageError::Room);
        }
        bytes[length..].fill(0xff);
        // Not onto the one that would be gone on from.
        let (number, slot) = match self.last {
            Some((number, slot)) => (number.wrapping_add(1), 1 - slot),
            None => (0, 0),
        };
        let place = self.place(slot);
        self.flash.erase(place, place + self.slot_bytes).map_err(StorageError::Flash)?;
        self.flash.write(place + mark_bytes::<F>() as u32, bytes).map_err(StorageError::Flash)?;
        let mut mark = [0xff; WIDEST];
        mark[..4].copy_from_slice(&number.to_le_bytes());
        mark[4..8].copy_from_slice(&(!number).to_le_bytes());
        self.flash.write(place, &mark[..mark_bytes::<F>()]).map_err(StorageError::Flash)?;
        self.last = Some((number, slot));
        Ok(())
    }

    fn place(&self, slot: u32) -> u32 {
        self.begin + slot * self.slot_bytes
    }

    /// Number of the snapshot in a slot; `None` where no mark holds.
    fn number(&mut self, slot: u32) -> Result<Option<u32>, StorageError<F::Error>> {
        let mut mark = [0; WIDEST];
        let place = self.place(slot);
        self.flash.read(place, &mut mark[..mark_bytes::<F>()]).map_err(StorageError::Flash)?;
        let [a, b, c, d, e, f, g, h, ..] = mark;
        let number = u32::from_le_bytes([a, b, c, d]);
        Ok((u32::from_le_bytes([e, f, g, h]) == !number).then_some(number))
    }
}

/// Bytes of the mark in such a flash: whole writes.
const fn mark_bytes<F: NorFlash>() -> usize {
    assert!(F::WRITE_SIZE <= WIDEST && F::READ_SIZE <= F::WRITE_SIZE);
    MARK.next_multiple_of(F::WRITE_SIZE)
}
