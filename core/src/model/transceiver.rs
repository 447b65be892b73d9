//! The radio as the tracker uses it: a trait that firmware implements over its driver.
//!
//! [`Tracker::poll_cycle`](crate::Tracker::poll_cycle) runs a cycle over it: it tunes the radio for each anchor, begins, and takes what
//! is received, one observation after the other. Nothing here waits: what is not there yet is [`Poll::Pending`], as everywhere in
//! `core`. A driver that blocks never says so; with an executor, firmware polls again when its waker says so (docs/firmware.md).

use super::observation::{Observation, TagHeight};
use crate::radio::library::Action;
use core::task::Poll;

/// What the exchanges with an anchor are to use in the next cycle.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Tuning {
    /// Index of the action in the library: [`Frame::action`](super::observation::Frame::action) of what is received with it.
    pub index: usize,
    /// The action: carrier and pulse.
    pub action: Action,
    /// Index of the action after that, which every frame sent is to announce ([`crate::radio::link`]); `None` where choices are not
    /// announced.
    pub announced: Option<usize>,
}

/// When a cycle is, and what is known of it beside what is received.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Moment {
    /// Seconds since the last cycle began, by a clock (above 0, at most 3600); of the first one since anything.
    pub elapsed_s: f32,
    /// The tag's height, where it is known.
    pub tag_height: Option<TagHeight>,
}

/// A radio that asks anchors and delivers what they answer.
///
/// Its errors are those of the radio as a whole: a bus that fails, a chip that does not answer. An anchor that does not answer, or an exchange
/// of which nothing can be made, is none: that observation is left out.
pub trait Transceiver {
    /// What can go wrong with the radio.
    type Error;

    /// Exchanges with this anchor use this from now on. Called ahead of every cycle for every anchor, and again with the same where
    /// the cycle does not begin yet: a radio that was reset has its carrier from here as well.
    ///
    /// # Errors
    /// The radio's; the tracker has not changed then, and tells it again.
    fn tune(&mut self, anchor: usize, tuning: &Tuning) -> Result<(), Self::Error>;

    /// Begins a cycle, whatever was left of the last one; pending until it is time for one.
    ///
    /// # Errors
    /// The radio's; the tracker has not changed then.
    fn begin(&mut self) -> Poll<Result<Moment, Self::Error>>;

    /// The next observation of the cycle, in any order of the anchors: one frame and one scan of ranges of each at most. `None` where
    /// there is nothing more to come in it; pending where there is.
    ///
    /// # Errors
    /// The radio's. The cycle goes on: it is asked again.
    fn receive(&mut self) -> Poll<Result<Option<Observation<'_>>, Self::Error>>;
}
