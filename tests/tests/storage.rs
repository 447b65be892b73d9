//! A tracker's state in a flash: whenever the power is cut, it goes on from the last snapshot or from the one before, to the bit.

#[path = "storage/two_slots.rs"]
mod two_slots;

use cogmint_core::model::observation::{Observation, Range, RangeScan};
use cogmint_core::radio::presets::RadioPreset;
use cogmint_core::{Anchor, Config, Map, SnapshotError, Tracker};
use embedded_storage::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash, check_erase, check_write,
};
use two_slots::{StorageError, TwoSlots};

type SmallTracker = Tracker<2, 1, 2, 1, 2, 2, 2, 0, 6>;

/// Where the slots are, and how long they are, bytes.
const BEGIN: u32 = 4096;
const SLOT: u32 = 2 * 4096;

/// A NOR flash of four pages before and after which nothing is, whose power is cut while it erases or writes.
#[derive(Clone)]
struct Flash {
    bytes: Vec<u8>,
    /// Bytes that are still changed before the power is cut.
    left: usize,
}

#[derive(Debug, PartialEq, Eq)]
enum FlashError {
    PowerCut,
    /// The caller's fault.
    Use(NorFlashErrorKind),
}

impl NorFlashError for FlashError {
    fn kind(&self) -> NorFlashErrorKind {
        match self {
            Self::PowerCut => NorFlashErrorKind::Other,
            Self::Use(kind) => *kind,
        }
    }
}

impl Flash {
    fn erased() -> Self {
        Self { bytes: vec![0xff; (BEGIN + 2 * SLOT + 4096) as usize], left: usize::MAX }
    }

    /// Changes bytes one by one; of the one at which the power is cut, half of the bits.
    fn change(&mut self, offset: u32, values: impl Iterator<Item = u8>) -> Result<(), FlashError> {
        for (byte, value) in self.bytes[offset as usize..].iter_mut().zip(values) {
            if self.left == 0 {
                *byte = (*byte & 0xf0) | (value & 0x0f);
                return Err(FlashError::PowerCut);
            }
            self.left -= 1;
            *byte = value;
        }
        Ok(())
    }
}

impl ErrorType for Flash {
    type Error = FlashError;
}

impl ReadNorFlash for Flash {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), FlashError> {
        let from = offset as usize;
        let kept = self.bytes.get(from..from + bytes.len());
        bytes.copy_from_slice(kept.ok_or(FlashError::Use(NorFlashErrorKind::OutOfBounds))?);
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.bytes.len()
    }
}

impl NorFlash for Flash {
    const WRITE_SIZE: usize = 4;
    const ERASE_SIZE: usize = 4096;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), FlashError> {
        check_erase(self, from, to).map_err(FlashError::Use)?;
        self.change(from, (from..to).map(|_| 0xff))
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), FlashError> {
        check_write(self, offset, bytes.len()).map_err(FlashError::Use)?;
        let at = offset as usize;
        assert!(self.bytes[at..at + bytes.len()].iter().all(|byte| *byte == 0xff), "written twice");
        self.change(offset, bytes.iter().copied())
    }
}

fn tracker() -> SmallTracker {
    let anchors = [[0.0, 0.0], [10.0, 0.0]].map(|position_m| Anchor { position_m, height_m: 0.0 });
    let mut config = Config::pedestrian(RadioPreset::Dw3000);
    config.start.position_m = [4.0, 3.0];
    let mut tracker = SmallTracker::new();
    tracker.start(&config, &anchors, &Map::default(), RadioPreset::Dw3000.library(), 1).unwrap();
    tracker
}

fn walk(tracker: &mut SmallTracker, cycles: u8) {
    for n in 0..cycles {
        let x = 4.0 + 0.05 * f32::from(n);
        let ranges = [x, 10.0 - x].map(|across| [Range { range_m: across.hypot(3.0), variance_m2: 5e-3 }]);
        let scans = [0, 1].map(|anchor| Observation::Ranges(RangeScan { anchor, ranges: &ranges[anchor] }));
        tracker.cycle(&scans, 0.1, None).unwrap();
    }
}

/// Room for a snapshot and the filling of its last write.
fn buffer() -> Vec<u8> {
    vec![0; SLOT as usize]
}

fn store(slots: &mut TwoSlots<Flash>, tracker: &SmallTracker) -> Result<usize, StorageError<FlashError>> {
    let mut buffer = buffer();
    let length = tracker.snapshot(&mut buffer).unwrap();
    slots.store(&mut buffer, length).map(|()| length)
}

/// The hash of a tracker that is switched on with this flash.
fn switched_on(flash: Flash) -> Result<(u64, TwoSlots<Flash>), StorageError<FlashError>> {
    let mut slots = TwoSlots::new(flash, BEGIN, SLOT);
    let mut tracker = tracker();
    slots.restore(&mut buffer(), |bytes| tracker.restore(bytes))?;
    Ok((tracker.hash(), slots))
}

#[test]
fn a_power_cut_at_any_byte_leaves_the_last_state_or_the_one_before() {
    let mut own = tracker();
    let mut slots = TwoSlots::new(Flash::erased(), BEGIN, SLOT);
    let mut hashes = vec![];
    let mut cuts = 0;
    // The first two are written to erased slots, the others over older ones.
    for round in 0..4 {
        walk(&mut own, 5);
        let before = slots.into_flash();
        let mut next = TwoSlots::new(before.clone(), BEGIN, SLOT);
        if round > 0 {
            next = switched_on(before.clone()).unwrap().1;
        }
        let length = store(&mut next, &own).unwrap();
        let (old, new) = (hashes.last().copied(), own.hash());
        let whole = next.into_flash();
        // Erase, snapshot, mark: every byte of them.
        let changed = SLOT as usize + length.next_multiple_of(4) + 8;
        let mut were_new = 0;
        for left in 0..=changed {
            let flash = Flash { left, ..before.clone() };
            let mut torn = match old {
                Some(_) => switched_on(flash).unwrap().1,
                None => TwoSlots::new(flash, BEGIN, SLOT),
            };
            let stored = store(&mut torn, &own);
            assert_eq!(stored.is_ok(), left == changed, "{left}");
            let flash = Flash { left: usize::MAX, ..torn.into_flash() };
            let found = match switched_on(flash.clone()) {
                Ok((hash, slots)) => {
                    assert!(hash == new || Some(hash) == old, "round {round}, cut after {left} bytes");
                    were_new += usize::from(hash == new);
                    Some((hash, slots))
                }
                Err(error) => {
                    assert_eq!((error, old), (StorageError::Empty, None), "cut after {left} bytes");
                    None
                }
            };
            // What was torn does not stand in the way of the next snapshot.
            if left % 97 == 0 {
                let mut again = found.map_or_else(|| TwoSlots::new(flash, BEGIN, SLOT), |(_, slots)| slots);
                store(&mut again, &own).unwrap();
                assert_eq!(switched_on(again.into_flash()).unwrap().0, new, "after {left} bytes");
            }
            cuts += 1;
        }
        // Within the mark, whose last bytes are those of an erased flash while numbers are small.
        assert!((1..=8).contains(&were_new), "{were_new}");
        hashes.push(new);
        slots = TwoSlots::new(whole, BEGIN, SLOT);
        println!("round {round}: a snapshot of {length} bytes");
    }
    println!("{cuts} power cuts");
}

#[test]
fn a_snapshot_that_has_rotted_gives_way_to_the_one_before() {
    let mut own = tracker();
    let mut slots = TwoSlots::new(Flash::erased(), BEGIN, SLOT);
    assert_eq!(switched_on(Flash::erased()).err(), Some(StorageError::Empty));
    walk(&mut own, 5);
    store(&mut slots, &own).unwrap();
    let older = own.hash();
    walk(&mut own, 5);
    let length = store(&mut slots, &own).unwrap();
    let mut flash = slots.into_flash();
    let second = (BEGIN + SLOT) as usize + 8;
    flash.bytes[second + length / 2] ^= 1;
    let (hash, mut slots) = switched_on(flash).unwrap();
    assert_eq!(hash, older);
    // And the next one goes over what has rotted.
    store(&mut slots, &own).unwrap();
    let mut flash = slots.into_flash();
    assert_eq!(switched_on(flash.clone()).unwrap().0, own.hash());
    for slot in [BEGIN as usize, second] {
        flash.bytes[slot + 100] ^= 1;
    }
    assert_eq!(switched_on(flash).err(), Some(StorageError::Refused(SnapshotError::Damaged)));
}

#[test]
fn numbers_begin_again_and_what_does_not_fit_is_refused() {
    let mut own = tracker();
    let mut flash = Flash::erased();
    // As if 2^32 - 1 snapshots had been written; the last of them into the first slot.
    let mut slots = TwoSlots::new(flash.clone(), BEGIN, SLOT);
    store(&mut slots, &own).unwrap();
    flash.bytes = slots.into_flash().bytes;
    let at = BEGIN as usize;
    flash.bytes[at..at + 8].copy_from_slice(&[0xff, 0xff, 0xff, 0xff, 0, 0, 0, 0]);
    let (_, mut slots) = switched_on(flash).unwrap();
    for _ in 0..3 {
        walk(&mut own, 1);
        store(&mut slots, &own).unwrap();
        let (hash, next) = switched_on(slots.into_flash()).unwrap();
        assert_eq!(hash, own.hash());
        slots = next;
    }
    let mut long = vec![0; 2 * SLOT as usize];
    assert_eq!(slots.store(&mut long, SLOT as usize - 4), Err(StorageError::Room));
    assert_eq!(slots.store(&mut long[..100], 101), Err(StorageError::Room));
}
