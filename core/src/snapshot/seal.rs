//! Seals: a sum over state by which a bit that flips in it is found.
//!
//! Every word changes the sum by a bijection, and so does the sum before it: one word that is not what it was, wherever it is and
//! whatever of it, makes another sum for certain. On the way it is seen whether all numbers are finite and no list is longer than its
//! memory, so that entries outside of it are not read.

use super::{Sink, Written};

/// Mathematics: 2^32 over the golden ratio, odd: multiplying by it is a bijection.
const SPREAD: u32 = 0x9e37_79b9;

/// What was seen of a state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Sealed {
    pub sum: u32,
    is_whole: Whole,
}

/// Whether all numbers are finite, and all lists within their memory. No seal at all is all zeros, as a static tracker has to be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Whole {
    No = 1,
    Yes = 2,
}

impl Sealed {
    /// That of nothing.
    pub const NOTHING: Self = Self { sum: SPREAD, is_whole: Whole::Yes };

    /// Whether all numbers are finite, and all lists within their memory.
    pub fn is_whole(self) -> bool {
        self.is_whole == Whole::Yes
    }
}

/// A seal being made.
pub(crate) struct Seal {
    sum: u32,
    /// 0, or not a number once one was not finite.
    finite: f32,
    fits: bool,
}

/// The sum with a word more.
#[inline(always)]
fn with(sum: u32, word: u32) -> u32 {
    (sum.rotate_left(5) ^ word).wrapping_mul(SPREAD)
}

/// 0 for a number, not a number for what is infinite or none.
#[inline(always)]
#[allow(clippy::eq_op)] // infinity less itself is not a number
fn nothing(value: f32) -> f32 {
    value - value
}

impl Sink for Seal {
    fn byte(&mut self, byte: u8) {
        self.word(u32::from(byte));
    }

    fn bytes(&mut self, bytes: &[u8]) {
        let (words, rest) = bytes.as_chunks();
        words.iter().for_each(|word| self.word(u32::from_le_bytes(*word)));
        rest.iter().for_each(|byte| self.byte(*byte));
    }

    #[inline(always)]
    fn word(&mut self, word: u32) {
        self.sum = with(self.sum, word);
    }

    // In its place, once for each field of the state, it would be 2 KB.
    #[inline(never)]
    fn float(&mut self, value: f32) {
        self.word(value.to_bits());
        self.finite += nothing(value);
    }

    // Most of the state: in registers.
    #[inline(never)]
    fn floats(&mut self, values: &[f32]) {
        let (mut sum, mut finite) = (self.sum, self.finite);
        for value in values {
            sum = with(sum, value.to_bits());
            finite += nothing(*value);
        }
        (self.sum, self.finite) = (sum, finite);
    }

    fn list(&mut self, count: usize, room: usize) -> bool {
        self.word(count as u32);
        let fits = count <= room;
        self.fits &= fits;
        fits
    }
}

/// Seals what is written.
pub(crate) fn seal_with(write: impl FnOnce(&mut Seal)) -> Sealed {
    let mut seal = Seal { sum: SPREAD, finite: 0.0, fits: true };
    write(&mut seal);
    let is_whole = if seal.fits && seal.finite == 0.0 { Whole::Yes } else { Whole::No };
    Sealed { sum: seal.sum, is_whole }
}

/// Seals a state.
#[inline(never)]
pub(crate) fn seal(state: &impl Written) -> Sealed {
    seal_with(|to| state.write(to))
}

#[cfg(test)]
mod tests {
    use super::*;
    use heapless::Vec;

    #[test]
    fn every_bit_that_flips_makes_another_seal() {
        let numbers: [f32; 7] = core::array::from_fn(|index| 1.5 + index as f32);
        let before = seal(&numbers);
        assert!(before.is_whole());
        for bit in 0..7 * 32 {
            let mut flipped = numbers;
            flipped[bit / 32] = f32::from_bits(flipped[bit / 32].to_bits() ^ 1 << (bit % 32));
            let after = seal(&flipped);
            assert_ne!(after.sum, before.sum, "{bit}");
            assert_eq!(after.is_whole(), flipped[bit / 32].is_finite(), "{bit}");
        }
        let bytes: Vec<u8, 11> = Vec::from_slice(&[3; 11]).unwrap();
        let before = seal(&bytes);
        for index in 0..11 {
            let mut other = bytes.clone();
            other[index] = 7;
            assert_ne!(seal(&other).sum, before.sum, "{index}");
        }
    }

    #[test]
    fn what_is_not_finite_and_what_is_too_long_is_not_whole() {
        assert!(!seal(&[1.0, f32::NAN]).is_whole());
        assert!(!seal(&[f32::NEG_INFINITY, 1.0]).is_whole());
        assert!(seal(&[f32::MAX, -f32::MAX]).is_whole());
        let mut own = Seal { sum: 0, finite: 0.0, fits: true };
        assert!(own.list(4, 4) && own.fits);
        assert!(!own.list(5, 4) && !own.fits);
    }
}
