//! The radio: its actions (carrier and pulse), the pulse as the receiver sees it, and how both ends of a link change their
//! action together.
//!
//! For firmware of a DW1000 or DW3000: [`presets`] is what to tell the tracker of the radio, [`accumulator`] makes a frame of the bytes of
//! a channel impulse response, and [`two_way`] a range of time stamps. The trait that a driver stands behind is
//! [`Transceiver`](../model/transceiver/trait.Transceiver.html), beside the observations that it delivers.

pub mod accumulator;
pub mod library;
pub mod link;
pub mod presets;
pub mod pulse;
pub mod two_way;

use crate::snapshot::written;
use library::Action;
use pulse::{Pulse, PulseShape};

/// What the radio's frames look like.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Radio {
    /// Shape of the pulse: roll-off 0 to 1, or samples of its autocorrelation (1 at first, none beyond 1.001, the second
    /// below the first, 1e-12 to 1e-8 s apart). Its duration is the action's.
    pub pulse_shape: PulseShape,
    /// Sample spacing, seconds (0.01 to 10 ns); at most 1 / (bandwidth), half the pulse duration is usual.
    pub sample_spacing_s: f32,
    /// Samples per frame (16 to 4096).
    pub samples_per_frame: usize,
    /// Full scale of the converter in the unit of the samples, if it has one: frames that reach it are refused.
    pub full_scale: Option<f32>,
    /// Whether the receiver scales every frame as it likes (automatic gain control): powers are then measured in the frame's
    /// white noise (`perceptor::gain_control`).
    pub gain_control: bool,
    /// False paths per frame in pure noise (1e-4 to 10). More finds weaker paths and more phantoms.
    pub false_paths_per_frame: f32,
}

impl Radio {
    /// That of a tracker that is not started.
    pub(crate) const NONE: Self = Self {
        pulse_shape: PulseShape::RootRaisedCosine { roll_off: 0.0 },
        sample_spacing_s: 0.0,
        samples_per_frame: 0,
        full_scale: None,
        gain_control: false,
        false_paths_per_frame: 0.0,
    };

    /// The pulse of an action, as the receiver keeps it.
    pub fn pulse(&self, action: &Action) -> Pulse {
        Pulse { duration_s: action.pulse_duration_s, shape: self.pulse_shape }
            .sampled_every(self.sample_spacing_s)
    }
}

written!(Radio {
    pulse_shape,
    sample_spacing_s,
    samples_per_frame,
    full_scale,
    gain_control,
    false_paths_per_frame
});
