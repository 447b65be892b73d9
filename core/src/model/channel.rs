//! What is known of the channels from the sources: read by expectation, planning and application, kept by the channel
//! memory.

use super::source::Source;

/// What is known of the channel of a source at one action.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChannelPrior {
    /// Whether the source was ever seen.
    pub seen: bool,
    /// Probability that nothing hides it.
    pub visibility: f32,
    /// Probability that nothing has hidden it since it was last seen.
    pub lasting: f32,
    /// SINR (linear) where nothing hides it, as far away as in the last frame.
    pub sinr: f32,
    /// Probability that its path is there, found or not.
    pub present: f32,
}

impl ChannelPrior {
    /// Nothing.
    pub const UNKNOWN: Self = Self { seen: false, visibility: 1.0, lasting: 1.0, sinr: 0.0, present: 1.0 };
}

/// What is known of the channels of all sources.
pub trait ChannelKnowledge {
    /// ln SINR expected of `source` at `action` where nothing hides it.
    fn sinr_ln(&self, source: Source, action: usize) -> f32;

    /// Probability that nothing hides `source` from frames; 1 where none has shown it yet.
    fn visibility(&self, source: Source) -> f32;

    /// What is known of `source` in scans of ranges: how probably nothing hides it.
    fn of_ranges(&self, source: Source) -> ChannelPrior;

    /// SINR (linear) that `source` would have with `action` `range_m` away over noise of this level where nothing hides it;
    /// `None` if that is not known.
    fn sinr_over(&self, source: Source, action: usize, range_m: f32, level: f32) -> Option<f32>;

    /// What is known of `source` at `action`.
    fn prior(&self, source: Source, action: usize) -> ChannelPrior;
}
