//! Golden traces: one 64-bit hash per cycle over all state.
//!
//! FNV-1a over 32-bit words; floats enter by their bits, counters as `u32`. Nothing that depends on pointer
//! width, addresses or time may enter, so equal hashes mean equal bits on any machine.

/// A running hash.
#[derive(Clone, Copy, Debug)]
pub struct TraceHash {
    state: u64,
}

impl Default for TraceHash {
    fn default() -> Self {
        Self { state: 0xcbf2_9ce4_8422_2325 }
    }
}

impl TraceHash {
    /// Adds a word.
    #[inline(never)] // in its place, once for each number of the state, it would be 1 KB
    pub fn word(&mut self, word: u32) {
        self.state = (self.state ^ u64::from(word)).wrapping_mul(0x0000_0100_0000_01b3);
    }

    /// Adds a float by its bits.
    pub fn float(&mut self, value: f32) {
        self.word(value.to_bits());
    }

    /// The hash of everything added.
    pub fn value(&self) -> u64 {
        self.state
    }
}
