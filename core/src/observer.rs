//! Watching a cycle from inside.

use crate::model::measurement::Measurement;
use crate::model::range::Regression;
use crate::perceptor::association::Beliefs;
use crate::perceptor::channel_estimator::ChannelEstimate;

/// The stages of a cycle, for those who watch it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Stage {
    /// Input checks.
    Receive,
    /// Channel estimation.
    Estimate,
    /// Prediction of the state.
    Predict,
    /// Regressions and data association.
    Associate,
    /// Update of the state.
    Update,
    /// Environment and channel memories.
    Remember,
    /// Candidates and the life of virtual anchors.
    Discover,
    /// Reward, learning, planning and choice.
    Act,
    /// The cycle is over.
    Done,
}

/// Watches a cycle from inside: to count instructions per stage, to compare intermediates, to draw.
pub trait Observer<const SOURCES: usize, const PATHS: usize> {
    /// A stage begins.
    fn stage(&mut self, _stage: Stage) {}
    /// The channel estimator's result for a frame.
    fn estimate(&mut self, _anchor: usize, _estimate: &ChannelEstimate<PATHS>) {}
    /// What is expected of an anchor's direct path and of its virtual anchors, in the order of the beliefs that follow.
    fn expectations(&mut self, _anchor: usize, _direct: &Regression, _virtual_anchors: &[Regression]) {}
    /// The measurements of an anchor and the beliefs about them.
    fn beliefs(&mut self, _anchor: usize, _measurements: &[Measurement], _beliefs: &Beliefs<SOURCES, PATHS>) {
    }
}

impl<const SOURCES: usize, const PATHS: usize> Observer<SOURCES, PATHS> for () {}

impl<const SOURCES: usize, const PATHS: usize, O: Observer<SOURCES, PATHS> + ?Sized> Observer<SOURCES, PATHS>
    for &mut O
{
    fn stage(&mut self, stage: Stage) {
        (**self).stage(stage);
    }

    fn estimate(&mut self, anchor: usize, estimate: &ChannelEstimate<PATHS>) {
        (**self).estimate(anchor, estimate);
    }

    fn expectations(&mut self, anchor: usize, direct: &Regression, virtual_anchors: &[Regression]) {
        (**self).expectations(anchor, direct, virtual_anchors);
    }

    fn beliefs(&mut self, anchor: usize, measurements: &[Measurement], beliefs: &Beliefs<SOURCES, PATHS>) {
        (**self).beliefs(anchor, measurements, beliefs);
    }
}
