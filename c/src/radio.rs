//! From what a DW1000 or DW3000 delivers to frames and ranges.

use crate::capacity::COGMINT_MOST_CIR_SAMPLES;
use crate::error::{CogmintError, code};
use crate::pointer::{put, shared, slice, slice_mut};
use crate::{CogmintFrame, CogmintSamples};
use cogmint_core::radio::accumulator::{AccumulatorFormat, Cir, Window, first_path_index};
use cogmint_core::radio::two_way::{AntennaDelays, DoubleSided, SingleSided, Timestamp};

/// How an accumulator stores a sample: in-phase part, then quadrature, each little-endian in two's complement.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CogmintAccumulator {
    /// 16 bits each, 4 bytes per sample: DW1000.
    Bits16 = 16,
    /// 24 bits each, 6 bytes per sample: DW3000.
    Bits24 = 24,
}

/// A channel impulse response as the radio has it.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct CogmintCir {
    /// Bytes of the accumulator, without the byte that a DW1000 sends ahead.
    pub bytes: *const u8,
    /// How many.
    pub byte_count: usize,
    /// Index in the accumulator of the sample that the bytes begin with: what cogmint_cir_first_sample says where the window alone
    /// was read, 0 where all was.
    pub first_sample: u32,
    /// A cogmint_accumulator.
    pub format: u32,
    /// The radio's first-path index, samples: cogmint_first_path_index of its register.
    pub first_path_index: f32,
    /// Samples ahead of the first path that are kept; 32 are usual.
    pub samples_before: u32,
    /// Samples from it on that are kept; 96 are usual.
    pub samples_after: u32,
    /// Index of the anchor.
    pub anchor: u32,
    /// Index of the action that it was received with.
    pub action: u32,
    /// Length of the first path as ranging has it, metres.
    pub first_path_range_m: f32,
    /// By how many samples the pulse's maximum comes behind the index; 2.0 to begin with.
    pub peak_after_first_path_samples: f32,
}

/// A first-path index as the registers have it, 10.6 bits fixed point, in samples.
#[unsafe(no_mangle)]
pub extern "C" fn cogmint_first_path_index(fixed_point: u16) -> f32 {
    first_path_index(fixed_point)
}

/// Writes to `first_sample` at which sample of the accumulator the window around a first path begins, so that no more than
/// `samples_before` + `samples_after` samples from there on need be read.
///
/// # Safety
/// `first_sample`: of a number that may be written to, or NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cogmint_cir_first_sample(
    first_path_index: f32,
    samples_before: u32,
    first_sample: *mut u32,
) -> CogmintError {
    let window = Window { before: samples_before as usize, after: 0 };
    code(window.first_sample(first_path_index).map_err(CogmintError::from).and_then(|sample| {
        // SAFETY: as the caller promises.
        unsafe { put(first_sample, sample as u32) }
    }))
}

/// Makes a frame of the bytes of an accumulator. Its samples are written to `samples`, which has room for so many complex ones and has to
/// stay until the tracker has received the frame. `samples_per_frame` of the configuration has to be their number.
///
/// # Safety
/// `cir` and what it points at may be read; `samples` may be written to, `sample_room` of them; and `frame`. Or they are NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cogmint_cir_frame(
    cir: *const CogmintCir,
    samples: *mut [f32; 2],
    sample_room: usize,
    frame: *mut CogmintFrame,
) -> CogmintError {
    // SAFETY: as the caller promises.
    code(unsafe { cir_frame(cir, samples, sample_room, frame) })
}

/// # Safety
/// As [`cogmint_cir_frame`].
unsafe fn cir_frame(
    cir: *const CogmintCir,
    samples: *mut [f32; 2],
    sample_room: usize,
    frame: *mut CogmintFrame,
) -> Result<(), CogmintError> {
    // SAFETY: as the caller promises.
    let given = unsafe { shared(cir)? };
    // SAFETY: as the caller promises.
    let bytes = unsafe { slice(given.bytes, given.byte_count)? };
    // SAFETY: as the caller promises.
    let room = unsafe { slice_mut(samples, sample_room)? };
    let format = match given.format {
        16 => AccumulatorFormat::Bits16,
        24 => AccumulatorFormat::Bits24,
        _ => return Err(CogmintError::UnknownChoice),
    };
    let window = Window { before: given.samples_before as usize, after: given.samples_after as usize };
    let (first, index) = (given.first_sample as usize, given.first_path_index);
    let cir = Cir::<COGMINT_MOST_CIR_SAMPLES>::from_accumulator(bytes, first, format, index, window)?;
    let kept = cir.samples();
    let room = room.get_mut(..kept.len()).ok_or(CogmintError::CirLength)?;
    room.copy_from_slice(kept);
    let made = CogmintFrame {
        anchor: given.anchor,
        action: given.action,
        has_sequence: 0,
        sequence: 0,
        first_sample_delay_s: cir
            .first_sample_delay_s(given.first_path_range_m, given.peak_after_first_path_samples),
        kind: CogmintSamples::Complex as u32,
        samples: room.as_ptr().cast(),
        sample_count: room.len(),
    };
    // SAFETY: as the caller promises.
    unsafe { put(frame, made) }
}

/// Time stamps of a two-way exchange, ticks of 1 / (128 x 499.2 MHz) of which the lowest 40 bits count.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CogmintTwoWay {
    /// When the initiator sent the poll, by its clock.
    pub poll_sent: u64,
    /// When the responder received it, by its own.
    pub poll_received: u64,
    /// When the responder sent the response.
    pub response_sent: u64,
    /// When the initiator received it.
    pub response_received: u64,
    /// When the initiator sent the final. Double-sided alone.
    pub final_sent: u64,
    /// When the responder received it. Double-sided alone.
    pub final_received: u64,
    /// Antenna delays of the initiator, transmission and reception together, ticks; 0 where its stamps are corrected.
    pub initiator_delay_ticks: u32,
    /// The same of the responder.
    pub responder_delay_ticks: u32,
    /// Rate of the responder's clock over that of the initiator's, minus 1 (at most 1e-4 either way). Single-sided alone.
    pub responder_clock_offset: f32,
}

impl CogmintTwoWay {
    fn delays(&self) -> AntennaDelays {
        AntennaDelays {
            initiator_ticks: self.initiator_delay_ticks,
            responder_ticks: self.responder_delay_ticks,
        }
    }
}

/// Writes the distance of a poll and its response to `range_m`, metres.
///
/// # Safety
/// `stamps` may be read and `range_m` written to, or they are NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cogmint_range_single_sided(
    stamps: *const CogmintTwoWay,
    range_m: *mut f32,
) -> CogmintError {
    // SAFETY: as the caller promises.
    let range = unsafe { shared(stamps) }.and_then(|stamps| {
        let exchange = SingleSided {
            poll_sent: Timestamp::new(stamps.poll_sent),
            poll_received: Timestamp::new(stamps.poll_received),
            response_sent: Timestamp::new(stamps.response_sent),
            response_received: Timestamp::new(stamps.response_received),
            responder_clock_offset: stamps.responder_clock_offset,
        };
        Ok(exchange.range_m(stamps.delays())?)
    });
    // SAFETY: as the caller promises.
    code(range.and_then(|metres| unsafe { put(range_m, metres) }))
}

/// Writes the distance of a poll, its response and the response to that to `range_m`, metres.
///
/// # Safety
/// `stamps` may be read and `range_m` written to, or they are NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn cogmint_range_double_sided(
    stamps: *const CogmintTwoWay,
    range_m: *mut f32,
) -> CogmintError {
    // SAFETY: as the caller promises.
    let range = unsafe { shared(stamps) }.and_then(|stamps| {
        let exchange = DoubleSided {
            poll_sent: Timestamp::new(stamps.poll_sent),
            poll_received: Timestamp::new(stamps.poll_received),
            response_sent: Timestamp::new(stamps.response_sent),
            response_received: Timestamp::new(stamps.response_received),
            final_sent: Timestamp::new(stamps.final_sent),
            final_received: Timestamp::new(stamps.final_received),
        };
        Ok(exchange.range_m(stamps.delays())?)
    });
    // SAFETY: as the caller promises.
    code(range.and_then(|metres| unsafe { put(range_m, metres) }))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn response(bytes: &[u8], samples_after: u32) -> CogmintCir {
        CogmintCir {
            bytes: bytes.as_ptr(),
            byte_count: bytes.len(),
            first_sample: 713,
            format: CogmintAccumulator::Bits16 as u32,
            first_path_index: 745.5,
            samples_before: 32,
            samples_after,
            anchor: 1,
            action: 4,
            first_path_range_m: 7.31,
            peak_after_first_path_samples: 2.0,
        }
    }

    #[test]
    fn a_frame_is_what_the_core_makes_of_the_accumulator() {
        let bytes: [u8; 512] = core::array::from_fn(|n| (37 * n % 256) as u8);
        let mut first = 0;
        // SAFETY: a number of the test's own.
        assert_eq!(unsafe { cogmint_cir_first_sample(745.5, 32, &mut first) }, CogmintError::None);
        assert_eq!(first, 713);
        let mut samples = [[0.0; 2]; 128];
        let mut frame = core::mem::MaybeUninit::uninit();
        let cir = response(&bytes, 96);
        let mut made =
            // SAFETY: all of it is the test's own.
            |cir: &CogmintCir, room| unsafe { cogmint_cir_frame(cir, samples.as_mut_ptr(), room, frame.as_mut_ptr()) };
        assert_eq!(made(&cir, 127), CogmintError::CirLength);
        assert_eq!(made(&response(&bytes, 97), 128), CogmintError::CirBytes);
        assert_eq!(made(&CogmintCir { format: 8, ..cir }, 128), CogmintError::UnknownChoice);
        assert_eq!(made(&CogmintCir { bytes: core::ptr::null(), ..cir }, 128), CogmintError::NullPointer);
        assert_eq!(made(&cir, 128), CogmintError::None);
        // SAFETY: written just now.
        let frame = unsafe { frame.assume_init() };
        let core = Cir::<128>::from_accumulator(&bytes, 713, AccumulatorFormat::Bits16, 745.5, Window::USUAL);
        let core = core.unwrap();
        assert_eq!(samples, core.samples());
        assert_eq!(frame.first_sample_delay_s, core.first_sample_delay_s(7.31, 2.0));
        assert_eq!((frame.anchor, frame.action, frame.sample_count), (1, 4, 128));
    }

    #[test]
    fn stamps_become_ranges() {
        // 1000 ticks of flight, replies of 1e6 ticks, clocks alike.
        let stamps = CogmintTwoWay {
            poll_sent: 0,
            poll_received: 5_001_000,
            response_sent: 6_001_000,
            response_received: 1_002_000,
            final_sent: 2_002_000,
            final_received: 7_003_000,
            initiator_delay_ticks: 0,
            responder_delay_ticks: 0,
            responder_clock_offset: 0.0,
        };
        for range in [cogmint_range_single_sided, cogmint_range_double_sided] {
            let mut range_m = 0.0;
            // SAFETY: both are the test's own.
            assert_eq!(unsafe { range(&stamps, &mut range_m) }, CogmintError::None);
            assert!((range_m - 4.6918).abs() < 1e-3, "{range_m}");
            let backwards = CogmintTwoWay { response_received: u64::MAX, ..stamps };
            // SAFETY: as above.
            assert_eq!(unsafe { range(&backwards, &mut range_m) }, CogmintError::TwoWayOrder);
            // SAFETY: NULL is allowed.
            assert_eq!(unsafe { range(core::ptr::null(), &mut range_m) }, CogmintError::NullPointer);
        }
    }
}
