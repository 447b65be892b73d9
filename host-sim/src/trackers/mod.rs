//! Trackers side by side on the same path estimates, and the bounds they are judged by.
//!
//! [`scans::scans`] runs the core's channel estimator over a recording once; every other tracker works on its result
//! and on the same [`Setup`]: anchors, told virtual anchors, start and motion. The trackers:
//!
//! | module | tracker |
//! | --- | --- |
//! | [`core`] | `cogmint` itself, and `direct`: cogmint without any reflection |
//! | [`told`] | extended Kalman filters that are told which path belongs to which source: the bound of association |
//! | [`first_path_ekf`] | `ekf`: a plain extended Kalman filter on the first path of every anchor |
//! | [`particles`] | a particle filter with the plan |
//! | [`bound`] | no tracker: posterior bounds along the true way |

pub mod bound;
pub mod core;
pub mod first_path_ekf;
mod gaussian;
mod map;
pub mod particles;
pub mod scans;
pub mod told;

#[cfg(test)]
mod tests;

pub use scans::scans;

use crate::replay::Setup;

/// What a path was reflected by.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Source {
    /// Nothing: the direct path.
    Direct,
    /// A virtual anchor: its index in [`crate::recording::Recording::virtual_anchors`].
    Virtual(usize),
}

/// One estimated path, or one range of a radio.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScanPath {
    /// Its length, metres.
    pub range_m: f64,
    /// Standard deviation that its estimator states, metres.
    pub std_m: f64,
    /// Its power over that of noise and dense multipath (linear); 0 for a radio's range, which has none.
    pub sinr: f64,
    /// What it truly was reflected by; none for a false path and where the truth is unknown. For [`told`] and the
    /// bounds alone.
    pub source: Option<Source>,
    /// Whether another true path of at least a tenth of the power lies within a pulse of that true path: its length is then
    /// less certain than stated. As `source`.
    pub overlapped: bool,
}

/// What an anchor delivered in a cycle.
#[derive(Clone, Debug, PartialEq)]
pub struct Scan {
    /// Index of the anchor.
    pub anchor: usize,
    /// Index of the action its frame was received with; 0 where there was none.
    pub action: usize,
    /// Length of the frame's pulse, c Tp, metres: nearer paths overlap. 0 where there was no frame.
    pub pulse_m: f64,
    /// The paths, by length; none where the frame showed none.
    pub paths: Vec<ScanPath>,
}

/// The scans of a cycle.
#[derive(Clone, Debug, PartialEq)]
pub struct CycleScans {
    /// The time, seconds from the recording's zero.
    pub time_s: f64,
    /// Time since the cycle before, seconds.
    pub elapsed_s: f64,
    /// Height of the tag, metres, where the recording knows it.
    pub tag_height_m: Option<f64>,
    /// One scan per anchor heard, by anchor.
    pub scans: Vec<Scan>,
}

/// What a tracker believes after a cycle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Position, metres.
    pub position_m: [f64; 2],
    /// Covariance of all that it believes about the position, square metres: xx, xy, yy.
    pub covariance_m2: [f64; 3],
    /// Probability that it gives that position; none where it gives none.
    pub probability: Option<f64>,
    /// Whether it says that it does not know where the tag is.
    pub searching: bool,
    /// Time it took for the cycle, seconds; that of the channel estimator is in it for cogmint alone.
    pub seconds: f64,
}

/// Difference of height between an anchor and the tag, metres; 0 where the tag's height is unknown, as in the core.
pub(crate) fn rise_m(setup: &Setup, anchor: usize, tag_height_m: Option<f64>) -> f64 {
    tag_height_m.map_or(0.0, |height| f64::from(setup.anchors[anchor].height_m) - height)
}
