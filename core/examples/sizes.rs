//! What a tracker takes of RAM, and what one more of each of its sizes adds: the table of docs/firmware.md.
//!
//!     cargo run -p cogmint-core --example sizes
//!
//! The figures of a processor with 32 bits are written down here; a build for such a processor fails where they are wrong.

#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
#[expect(dead_code, reason = "nothing is simulated")]
mod simulated;

use cogmint_core::{RangeTracker, Tracker};

const fn bytes<
    const ANCHORS: usize,
    const SURFACES: usize,
    const SOURCES: usize,
    const SEGMENTS: usize,
    const PATHS: usize,
    const ACTIONS: usize,
    const COMPONENTS: usize,
    const POINTS: usize,
    const CANDIDATES: usize,
>() -> usize {
    size_of::<Tracker<ANCHORS, SURFACES, SOURCES, SEGMENTS, PATHS, ACTIONS, COMPONENTS, POINTS, CANDIDATES>>()
}

/// The reference size.
const REFERENCE: usize = bytes::<2, 8, 24, 32, 16, 40, 8, 800, 6>();
/// A DW3000 among four anchors.
const FOUR: usize = bytes::<4, 6, 12, 8, 8, 2, 4, 256, 2>();

/// What it is of, bytes here, bytes with 32 bits.
const ROWS: [(&str, usize, usize); 23] = [
    ("`<2, 8, 24, 32, 16, 40, 8, 800, 6>`, the reference size", REFERENCE, 41_888),
    ("one anchor more", bytes::<3, 8, 24, 32, 16, 40, 8, 800, 6>() - REFERENCE, 9_760),
    ("one surface more", bytes::<2, 9, 24, 32, 16, 40, 8, 800, 6>() - REFERENCE, 1_952),
    ("one source more", bytes::<2, 8, 25, 32, 16, 40, 8, 800, 6>() - REFERENCE, 208),
    ("one segment more", bytes::<2, 8, 24, 33, 16, 40, 8, 800, 6>() - REFERENCE, 64),
    ("one path more", bytes::<2, 8, 24, 32, 17, 40, 8, 800, 6>() - REFERENCE, 40),
    ("one action more", bytes::<2, 8, 24, 32, 16, 41, 8, 800, 6>() - REFERENCE, 136),
    ("one component more", bytes::<2, 8, 24, 32, 16, 40, 9, 800, 6>() - REFERENCE, 1_352),
    ("16 points more", bytes::<2, 8, 24, 32, 16, 40, 8, 816, 6>() - REFERENCE, 32),
    ("one candidate more", bytes::<2, 8, 24, 32, 16, 40, 8, 800, 7>() - REFERENCE, 1_680),
    ("`<4, 6, 12, 8, 8, 2, 4, 256, 2>`, four DW3000 anchors", FOUR, 27_840),
    ("one anchor more", bytes::<5, 6, 12, 8, 8, 2, 4, 256, 2>() - FOUR, 4_600),
    ("one surface more", bytes::<4, 7, 12, 8, 8, 2, 4, 256, 2>() - FOUR, 1_008),
    ("one source more", bytes::<4, 6, 13, 8, 8, 2, 4, 256, 2>() - FOUR, 64),
    ("one segment more", bytes::<4, 6, 12, 9, 8, 2, 4, 256, 2>() - FOUR, 64),
    ("one path more", bytes::<4, 6, 12, 8, 9, 2, 4, 256, 2>() - FOUR, 80),
    ("one action more", bytes::<4, 6, 12, 8, 8, 3, 4, 256, 2>() - FOUR, 128),
    ("one component more", bytes::<4, 6, 12, 8, 8, 2, 5, 256, 2>() - FOUR, 1_168),
    ("16 points more", bytes::<4, 6, 12, 8, 8, 2, 4, 272, 2>() - FOUR, 64),
    ("one candidate more", bytes::<4, 6, 12, 8, 8, 2, 4, 256, 3>() - FOUR, 3_360),
    ("`<1, 4, 8, 8, 8, 2, 4, 256, 0>`, one anchor", bytes::<1, 4, 8, 8, 8, 2, 4, 256, 0>(), 10_816),
    ("`RangeTracker<3, 2, 4>`, two ranges of three anchors", size_of::<RangeTracker<3, 2, 4>>(), 8_360),
    ("`RangeTracker<3, 2, 1>`, the same without other places", size_of::<RangeTracker<3, 2, 1>>(), 7_616),
];

#[cfg(target_pointer_width = "32")]
const _: () = {
    let mut rows = ROWS.as_slice();
    while let [(_, here, written_down), rest @ ..] = rows {
        assert!(*here == *written_down, "a figure of a processor with 32 bits is wrong");
        rows = rest;
    }
};

#[cfg(not(target_os = "none"))]
fn main() {
    println!("| `Tracker` | bytes, 32 bits | bytes, this machine |\n| --- | --- | --- |");
    for (of, here, with_32_bits) in ROWS {
        println!("| {of} | {with_32_bits} | {here} |");
    }
}

/// Read where the figures have changed.
#[cfg(target_os = "none")]
#[used]
static BYTES: [usize; ROWS.len()] = {
    let mut bytes = [0; ROWS.len()];
    let (mut rows, mut to) = (ROWS.as_slice(), bytes.as_mut_slice());
    while let ([(_, here, _), rows_left @ ..], [first, to_left @ ..]) = (rows, to) {
        *first = *here;
        (rows, to) = (rows_left, to_left);
    }
    bytes
};
