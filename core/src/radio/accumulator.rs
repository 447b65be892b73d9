//! Channel impulse responses as a DW1000 or DW3000 keeps them: from the bytes of its accumulator to a window of samples around
//! the first path, and to where these samples lie in delay.
//!
//! # Where a sample lies
//!
//! The radio says at which index i of its accumulator the first path begins (`first_path_index`), and two-way ranging how long that
//! path is (`first_path_range_m`, d). The index is on the rising edge: the maximum of the pulse of a direct path comes p samples
//! later (`peak_after_first_path_samples`). What the core calls the delay of a path is where its pulse has its *maximum*. So sample n
//! of the accumulator, with samples T = [`SAMPLE_SPACING_S`] apart, shows the delay
//!
//! ```text
//! delay(n) = d / c + (n - i - p) T,
//! ```
//!
//! and the pulse of a direct path, which is greatest at n = i + p, has the delay of its range, d / c. Whoever leaves out p has every
//! path of every frame too long by p samples: 0.30 m each. p belongs to the radio and its pulse: the authors of MILUV give 2.0 for their
//! DWM1000, and the responses of the Warsaw flat (EVK1000) show 1.2, 0.35 m; `cogmint calibrate` estimates it from recordings
//! ([`crate::radio::presets::RadioPreset::peak_after_first_path_samples`] is where to begin).
//!
//! # From the radio to a frame
//!
//! ```
//! use cogmint_core::radio::accumulator::{AccumulatorFormat, Cir, Window, first_path_index};
//!
//! // What the radio says: its first-path register, 745.5 samples.
//! let index = first_path_index(745 * 64 + 32);
//! let first_sample = Window::USUAL.first_sample(index)?;
//! assert_eq!(first_sample, 713);
//! // Read over SPI: `Window::USUAL.len()` samples from `first_sample` on, here of a DW1000 and all zero.
//! let bytes = [0; 128 * 4];
//! let cir = Cir::<128>::from_accumulator(&bytes, first_sample, AccumulatorFormat::Bits16, index, Window::USUAL)?;
//! let frame = cir.frame(0, 0, 7.31, 2.0);
//! assert_eq!(frame.samples.len(), 128);
//! # Ok::<(), cogmint_core::radio::accumulator::CirError>(())
//! ```

use crate::real::{SPEED_OF_LIGHT_M_S, sqrt};
use core::fmt;
use heapless::Vec;

/// Mathematics: time between two samples of the accumulator, seconds: half a chip, 1 / (2 x 499.2 MHz), about 1.0016 ns (DW1000 and
/// DW3000 user manuals).
pub const SAMPLE_SPACING_S: f32 = 1.0 / 998.4e6;
/// Capacity: first-path indexes end before this: 10 bits ahead of the binary point.
pub const FIRST_PATH_INDEXES: usize = 1024;
/// Mathematics: steps of a first-path index per sample: 6 bits behind the binary point.
const INDEX_STEPS: f32 = 64.0;

/// A first-path index as the registers have it, 10.6 bits fixed point (DW1000 `FP_INDEX` and DW3000 user manuals), in samples. Exact.
pub fn first_path_index(fixed_point: u16) -> f32 {
    f32::from(fixed_point) / INDEX_STEPS
}

/// How the accumulator's samples are stored: in-phase part, then quadrature, each little-endian in two's complement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum AccumulatorFormat {
    /// 16 bits each, 4 bytes per sample: DW1000 (992 samples at 16 MHz of pulse repetition, 1016 at 64 MHz).
    Bits16,
    /// 24 bits each, of which 18 are used, 6 bytes per sample: DW3000.
    Bits24,
}

impl AccumulatorFormat {
    /// Bytes of a sample.
    pub const fn bytes_per_sample(self) -> usize {
        match self {
            Self::Bits16 => 4,
            Self::Bits24 => 6,
        }
    }

    /// A sample of so many bytes; all numbers of 24 bits are exact in f32. `None` with another number of bytes.
    fn sample(self, bytes: &[u8]) -> Option<[f32; 2]> {
        match (self, bytes) {
            (Self::Bits16, &[i0, i1, q0, q1]) => {
                Some([[i0, i1], [q0, q1]].map(|part| f32::from(i16::from_le_bytes(part))))
            }
            (Self::Bits24, &[i0, i1, i2, q0, q1, q2]) => {
                // On top of 32 bits, so that the shift keeps the sign.
                Some([[0, i0, i1, i2], [0, q0, q1, q2]].map(|part| (i32::from_le_bytes(part) >> 8) as f32))
            }
            _ => None,
        }
    }
}

/// Which samples are kept: those from `before` samples ahead of the sample that holds the first path (the index without its
/// fraction) to the `after`-th from it on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Window {
    /// Samples ahead of it. They show the noise; fewer make its level uncertain.
    pub before: usize,
    /// Samples from it on. One more reaches 0.30 m further behind the direct path.
    pub after: usize,
}

impl Window {
    /// 128 samples: 32 of noise, and 96 that reach 28.8 m behind the direct path.
    pub const USUAL: Self = Self { before: 32, after: 96 };

    /// Number of samples.
    pub const fn len(self) -> usize {
        self.before.saturating_add(self.after)
    }

    /// Whether nothing is kept.
    pub const fn is_empty(self) -> bool {
        self.len() == 0
    }

    /// Index in the accumulator of the window's first sample, so that no more than the window need be read over SPI:
    /// [`Self::len`] samples of [`AccumulatorFormat::bytes_per_sample`] bytes from here on. (A DW1000 sends one byte ahead of them that
    /// means nothing, and so do drivers of the DW3000: leave it out, else every sample is shifted by a byte, and no error says so.)
    ///
    /// # Errors
    /// [`CirError::FirstPathIndex`], or [`CirError::WindowOutside`] where it would begin ahead of the accumulator.
    pub fn first_sample(self, first_path_index: f32) -> Result<usize, CirError> {
        // Written so that NaN fails.
        if !(first_path_index >= 0.0 && first_path_index < FIRST_PATH_INDEXES as f32) {
            return Err(CirError::FirstPathIndex { index: first_path_index });
        }
        // Not negative, so truncation is the floor.
        let at = first_path_index as usize;
        at.checked_sub(self.before).ok_or(CirError::WindowOutside { missing: self.before.saturating_sub(at) })
    }
}

/// Why bytes are no response.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum CirError {
    /// The first-path index is NaN, negative, or 1024 or more.
    FirstPathIndex {
        /// The index given.
        index: f32,
    },
    /// The window keeps no sample, or more than `N`.
    WindowLength {
        /// Its samples.
        samples: usize,
        /// The capacity.
        limit: usize,
    },
    /// The window begins ahead of the first sample given, or of the accumulator.
    WindowOutside {
        /// How many samples ahead.
        missing: usize,
    },
    /// The bytes end before the window does.
    TooFewBytes {
        /// Bytes given.
        given: usize,
        /// Bytes needed, from the first one given on.
        needed: usize,
    },
}

impl fmt::Display for CirError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::FirstPathIndex { index } => {
                write!(f, "the first-path index is {index}, 0 to below {FIRST_PATH_INDEXES} allowed")
            }
            Self::WindowLength { samples, limit } => {
                write!(f, "the window has {samples} samples, 1 to {limit} allowed")
            }
            Self::WindowOutside { missing } => {
                write!(f, "the window begins {missing} samples ahead of the first one")
            }
            Self::TooFewBytes { given, needed } => {
                write!(f, "{given} bytes of the accumulator given, {needed} needed")
            }
        }
    }
}

impl core::error::Error for CirError {}

/// A window of a channel impulse response, at most `N` samples of 8 bytes.
#[derive(Clone, Debug, PartialEq)]
pub struct Cir<const N: usize> {
    samples: Vec<[f32; 2], N>,
    /// Index in the accumulator of the first of them.
    first_sample: usize,
    first_path_index: f32,
}

impl<const N: usize> Cir<N> {
    /// The window around `first_path_index` (samples from the beginning of the accumulator, with its fraction; 0 to below 1024) from
    /// `bytes` of the accumulator, which begin with its sample `first_sample`: 0 where all of it was read,
    /// [`Window::first_sample`] where only the window was. The byte that a DW1000 sends ahead is not among them. What comes behind the
    /// window is not used.
    ///
    /// # Errors
    /// The first that is wrong of index, window and bytes.
    pub fn from_accumulator(
        bytes: &[u8],
        first_sample: usize,
        format: AccumulatorFormat,
        first_path_index: f32,
        window: Window,
    ) -> Result<Self, CirError> {
        let begin = window.first_sample(first_path_index)?;
        let samples = window.len();
        if samples == 0 || samples > N {
            return Err(CirError::WindowLength { samples, limit: N });
        }
        let Some(skipped) = begin.checked_sub(first_sample) else {
            return Err(CirError::WindowOutside { missing: first_sample.saturating_sub(begin) });
        };
        // Neither overflows: the window begins before 1024.
        let skipped_bytes = skipped.saturating_mul(format.bytes_per_sample());
        let needed = samples.saturating_mul(format.bytes_per_sample()).saturating_add(skipped_bytes);
        let Some(kept) = bytes.get(skipped_bytes..needed) else {
            return Err(CirError::TooFewBytes { given: bytes.len(), needed });
        };
        let kept = kept.chunks_exact(format.bytes_per_sample()).filter_map(|sample| format.sample(sample));
        // No more than were counted: the pushes succeed. (`collect` can panic.)
        let mut samples = Vec::new();
        for sample in kept {
            let _ = samples.push(sample);
        }
        Ok(Self { samples, first_sample: begin, first_path_index })
    }

    /// The samples, in-phase and quadrature part, as the radio has them: not scaled by the number of symbols accumulated.
    pub fn samples(&self) -> &[[f32; 2]] {
        &self.samples
    }

    /// Index in the accumulator of the first of them.
    pub fn first_sample(&self) -> usize {
        self.first_sample
    }

    /// The radio's first-path index, samples from the beginning of the accumulator.
    pub fn first_path_index(&self) -> f32 {
        self.first_path_index
    }

    /// Their magnitudes, in the same order.
    pub fn magnitudes(&self) -> Vec<f32, N> {
        let mut magnitudes = Vec::new();
        for [i, q] in &self.samples {
            // As many as there are samples: the pushes succeed.
            let _ = magnitudes.push(sqrt(i * i + q * q));
        }
        magnitudes
    }

    /// Delay that the first sample kept shows, seconds: of `n` = [`Self::first_sample`] in the formula at the top of the module.
    /// `first_path_range_m`: the length of the first path, as ranging has it; `peak_after_first_path_samples`: by how many samples the
    /// pulse's maximum comes behind the index. NaN where one of these is.
    pub fn first_sample_delay_s(&self, first_path_range_m: f32, peak_after_first_path_samples: f32) -> f32 {
        // The difference of the indexes first: it is exact.
        let from_index = self.first_sample as f32 - self.first_path_index;
        first_path_range_m / SPEED_OF_LIGHT_M_S
            + (from_index - peak_after_first_path_samples) * SAMPLE_SPACING_S
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::observation::Samples;
    use crate::perceptor::channel_estimator::{ChannelEstimator, EstimatorSettings};
    use crate::radio::presets::RadioPreset;
    use std::vec::Vec as StdVec;

    const WINDOW: Window = Window { before: 1, after: 2 };

    #[test]
    fn samples_of_16_bits_are_little_endian_in_two_s_complement() {
        let bytes = [
            0xff, 0x7f, 0x00, 0x80, // 32767, -32768
            0x34, 0x12, 0xff, 0xff, // 0x1234 = 4660, -1
            0x00, 0x00, 0x01, 0x00, // 0, 1
            0x9c, 0xff, 0x64, 0x00, // -100, 100
        ];
        let read =
            |index| Cir::<3>::from_accumulator(&bytes, 0, AccumulatorFormat::Bits16, index, WINDOW).unwrap();
        assert_eq!(read(1.0).samples(), [[32767.0, -32768.0], [4660.0, -1.0], [0.0, 1.0]]);
        assert_eq!(read(2.0 + 63.0 / 64.0).samples(), [[4660.0, -1.0], [0.0, 1.0], [-100.0, 100.0]]);
        assert_eq!((read(2.5).first_sample(), read(2.5).first_path_index()), (1, 2.5));
    }

    #[test]
    fn samples_of_24_bits_are_exact_over_their_whole_range() {
        let bytes = [
            0xff, 0xff, 0x01, 0x00, 0x00, 0xfe, // 131071, -131072: all that 18 bits hold
            0xff, 0xff, 0xff, 0x00, 0x00, 0x80, // -1, -8388608
            0xff, 0xff, 0x7f, 0x56, 0x34, 0x12, // 8388607, 0x123456 = 1193046
        ];
        let cir = Cir::<4>::from_accumulator(&bytes, 700, AccumulatorFormat::Bits24, 701.3, WINDOW).unwrap();
        assert_eq!(cir.samples(), [[131071.0, -131072.0], [-1.0, -8388608.0], [8388607.0, 1193046.0]]);
        for value in (-(1 << 23)..1 << 23).step_by(977) {
            let [a, b, c, _] = i32::to_le_bytes(value);
            let [i, q] = AccumulatorFormat::Bits24.sample(&[a, b, c, 7, 0, 0]).unwrap();
            assert_eq!((f64::from(i), q), (f64::from(value), 7.0));
        }
    }

    #[test]
    fn magnitudes_are_those_of_pythagoras() {
        let bytes = [0x03, 0, 0x04, 0, 0xfb, 0xff, 0x0c, 0, 0x00, 0x80, 0x00, 0x80];
        let cir = Cir::<3>::from_accumulator(&bytes, 0, AccumulatorFormat::Bits16, 1.0, WINDOW).unwrap();
        assert_eq!(cir.magnitudes().as_slice(), [5.0, 13.0, 32768.0 * core::f32::consts::SQRT_2]);
    }

    #[test]
    fn the_registers_index_has_six_bits_behind_the_point() {
        assert_eq!(first_path_index(0), 0.0);
        assert_eq!(first_path_index(0xba5a), 745.0 + 26.0 / 64.0);
        assert_eq!(first_path_index(u16::MAX), 1024.0 - 1.0 / 64.0);
    }

    #[test]
    fn what_is_wrong_is_said() {
        let bytes = [0; 40];
        let read = |bytes: &[u8], first_sample, index, window| {
            Cir::<4>::from_accumulator(bytes, first_sample, AccumulatorFormat::Bits16, index, window)
                .map(|_| ())
        };
        for index in [-0.1, 1024.0, f32::INFINITY, f32::NEG_INFINITY] {
            assert_eq!(read(&bytes, 0, index, WINDOW), Err(CirError::FirstPathIndex { index }));
        }
        let refused = read(&bytes, 0, f32::NAN, WINDOW);
        assert!(matches!(refused, Err(CirError::FirstPathIndex { index }) if index.is_nan()));
        // Sample 8 is the last that the bytes hold two of.
        assert_eq!(read(&bytes, 0, 8.9, WINDOW), Ok(()));
        assert_eq!(read(&bytes, 0, 9.0, WINDOW), Err(CirError::TooFewBytes { given: 40, needed: 44 }));
        assert_eq!(read(&bytes[..39], 0, 8.9, WINDOW), Err(CirError::TooFewBytes { given: 39, needed: 40 }));
        assert_eq!(read(&[], 0, 1.0, WINDOW), Err(CirError::TooFewBytes { given: 0, needed: 12 }));
        assert_eq!(read(&bytes, 0, 0.9, WINDOW), Err(CirError::WindowOutside { missing: 1 }));
        assert_eq!(read(&bytes, 3, 2.0, WINDOW), Err(CirError::WindowOutside { missing: 2 }));
        assert_eq!(
            read(&bytes, usize::MAX, 2.0, WINDOW),
            Err(CirError::WindowOutside { missing: usize::MAX - 1 })
        );
        for (window, samples) in [
            (Window { before: 0, after: 0 }, 0),
            (Window { before: 2, after: 3 }, 5),
            (Window { before: 1, after: usize::MAX }, usize::MAX),
        ] {
            assert_eq!(read(&bytes, 0, 4.0, window), Err(CirError::WindowLength { samples, limit: 4 }));
        }
    }

    /// As the importer of MILUV has it, whose frames begin with sample 0: the delay of sample 0 is d / c - (i + p) T.
    #[test]
    fn the_delay_of_the_first_sample_is_that_of_the_importers() {
        for (range_m, index, peak) in
            [(7.31, 745.0 + 26.0 / 64.0, 2.0), (0.4, 33.0, 1.2), (29.9, 1000.5, 0.0)]
        {
            let first_sample = Window::USUAL.first_sample(index).unwrap();
            let bytes = [1; 128 * 6];
            let cir = Cir::<128>::from_accumulator(
                &bytes,
                first_sample,
                AccumulatorFormat::Bits24,
                index,
                Window::USUAL,
            )
            .unwrap();
            let frame = cir.frame(1, 3, range_m, peak);
            assert_eq!((frame.anchor, frame.action, frame.sequence), (1, 3, None));
            let spacing_s = 1.0 / (2.0 * 499.2e6_f64);
            let of_sample_0_s =
                f64::from(range_m) / 299_792_458.0 - (f64::from(index) + f64::from(peak)) * spacing_s;
            let expected_s = of_sample_0_s + first_sample as f64 * spacing_s;
            let error_m = (f64::from(frame.first_sample_delay_s) - expected_s) * 299_792_458.0;
            assert!(error_m.abs() < 1e-5, "{error_m}");
        }
    }

    /// A pulse that is greatest 2.0 samples behind the index of the radio, computed in f64 and written as bytes of either radio, gives
    /// a path of the length that was ranged, from all of the accumulator or from the window alone.
    #[test]
    fn the_direct_path_of_a_response_has_the_length_that_was_ranged() {
        let pi = core::f64::consts::PI;
        let raised_cosine = |x: f64| {
            let sinc = if x.abs() < 1e-9 { 1.0 } else { (pi * x).sin() / (pi * x) };
            sinc * (0.5 * pi * x).cos() / (1.0 - x * x)
        };
        let spacing_s = 1.0 / 998.4e6_f64;
        let mut noise = 1_u64;
        let mut worst_m = 0.0_f64;
        for (format, scale) in [(AccumulatorFormat::Bits16, 9000.0), (AccumulatorFormat::Bits24, 60_000.0)] {
            for step in 0..8_u16 {
                // The register, and the range: neither has to do with the other.
                let (register, range_m) = (745 * 64 + 7 * step, 3.0 + f32::from(step) * 1.37);
                let peak = 745.0 + f64::from(7 * step) / 64.0 + 2.0;
                let mut bytes = StdVec::new();
                for n in 0..1016 {
                    let pulse = scale * raised_cosine((f64::from(n) - peak) * spacing_s / 2e-9);
                    for part in [0.8, -0.6] {
                        noise = noise
                            .wrapping_mul(6_364_136_223_846_793_005)
                            .wrapping_add(1_442_695_040_888_963_407);
                        let uniform = (noise >> 40) as f64 / (1_u64 << 24) as f64 - 0.5;
                        let value = (part * pulse + 0.01 * scale * uniform).round() as i32;
                        bytes.extend(value.to_le_bytes().iter().take(format.bytes_per_sample() / 2));
                    }
                }
                let index = first_path_index(register);
                let all = Cir::<128>::from_accumulator(&bytes, 0, format, index, Window::USUAL).unwrap();
                let first = Window::USUAL.first_sample(index).unwrap();
                let read = &bytes[first * format.bytes_per_sample()..][..128 * format.bytes_per_sample()];
                assert_eq!(Cir::from_accumulator(read, first, format, index, Window::USUAL), Ok(all.clone()));
                let frame = all.frame(0, 0, range_m, 2.0);
                let Samples::Complex(samples) = frame.samples else { panic!("no phase") };
                assert_eq!(samples.len(), 128);

                let radio = RadioPreset::Dw1000.radio();
                let pulse = radio.pulse(&RadioPreset::Dw1000.library()[0]);
                let settings = EstimatorSettings::default();
                let estimator =
                    ChannelEstimator::<8>::new(pulse, radio.sample_spacing_s, samples.len(), 0.1, settings);
                let found = estimator.estimate(frame.samples, frame.first_sample_delay_s).unwrap();
                let strongest = found.paths.iter().max_by(|a, b| a.sinr.total_cmp(&b.sinr)).unwrap();
                worst_m = worst_m.max((f64::from(strongest.range_m()) - f64::from(range_m)).abs());
            }
        }
        std::println!("direct path against the range: {worst_m:.5} m at worst");
        assert!(worst_m < 0.005, "{worst_m}");
    }
}
