//! Radios by name: what a tracker is told of each, and what to begin with where it is not measured.
//!
//! [`crate::Config::pedestrian`] and [`crate::Config::robot`] make whole configurations of them. `cogmint calibrate` estimates from
//! recordings what is only assumed here: pulse, where it peaks, noise of the ranges, biases.

use super::Radio;
use super::accumulator::{SAMPLE_SPACING_S, Window};
use super::library::{Action, LIBRARY_DW1000, LIBRARY_DW3000, LIBRARY_PUBLISHED};
use super::pulse::PulseShape;

/// A radio.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum RadioPreset {
    /// The published channel sounder: 2 GHz of band, 400 complex samples 0.25 ns apart from the transmission on, as simulated. It gives
    /// frames and no ranges.
    Sounder,
    /// Decawave DW1000 (DWM1000, EVK1000): complex samples around the first path ([`Window::USUAL`]), ranges by its time stamps.
    Dw1000,
    /// Qorvo DW3000, likewise. No recording of one is part of the project: what is not of its manual is taken over from the DW1000.
    Dw3000,
}

impl RadioPreset {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Sounder, Self::Dw1000, Self::Dw3000];

    /// What its frames look like. With another [`Window`] than the usual one, set `samples_per_frame` to its length; with all of the
    /// accumulator, to 1016, or 992 at 16 MHz of pulse repetition.
    pub const fn radio(self) -> Radio {
        match self {
            Self::Sounder => Radio {
                pulse_shape: PulseShape::RootRaisedCosine { roll_off: 0.6 },
                sample_spacing_s: 0.25e-9,
                samples_per_frame: 400,
                full_scale: None,
                gain_control: false,
                false_paths_per_frame: 0.1,
            },
            Self::Dw1000 | Self::Dw3000 => Radio {
                // The reference pulse of IEEE 802.15.4 HRP UWB, whose symbol time is the action's: assumed by the importers as well.
                pulse_shape: PulseShape::RootRaisedCosine { roll_off: 0.5 },
                sample_spacing_s: SAMPLE_SPACING_S,
                samples_per_frame: Window::USUAL.len(),
                // At which value an accumulator clips depends on the symbols that it sums.
                full_scale: None,
                gain_control: true,
                false_paths_per_frame: 0.1,
            },
        }
    }

    /// The carriers and pulses that it can choose from. Where the firmware keeps to one channel, the tracker is given that one alone.
    pub const fn library(self) -> &'static [Action] {
        match self {
            Self::Sounder => &LIBRARY_PUBLISHED,
            Self::Dw1000 => &LIBRARY_DW1000,
            Self::Dw3000 => &LIBRARY_DW3000,
        }
    }

    /// Standard deviation of its ranges on time, metres, for [`crate::model::observation::Range::variance_m2`]: 0.07 m as fitted to a
    /// flight of MILUV (DW1000), where late ranges are apart (`late_m`). `None`: it has no ranges of its own.
    pub const fn range_std_m(self) -> Option<f32> {
        match self {
            Self::Sounder => None,
            Self::Dw1000 | Self::Dw3000 => Some(0.07),
        }
    }

    /// By how many samples the maximum of the pulse comes behind its first-path index ([`super::accumulator`]), to begin with: 2.0 as the
    /// authors of MILUV give it for DWM1000; the Warsaw flat's EVK1000 show 1.2. `None`: it has no such index.
    pub const fn peak_after_first_path_samples(self) -> Option<f32> {
        match self {
            Self::Sounder => None,
            Self::Dw1000 | Self::Dw3000 => Some(2.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::radio::library::Library;

    #[test]
    fn samples_hold_the_pulses_and_the_window_the_longest_range() {
        for preset in RadioPreset::ALL {
            let radio = preset.radio();
            let library = Library::<40>::new(preset.library()).unwrap();
            for action in preset.library() {
                let pulse = radio.pulse(action);
                // A band that the samples cannot hold is cut: only channels 4 and 7 of the DW1000 have one.
                let is_cut = matches!(pulse.shape, PulseShape::Sampled { .. });
                assert_eq!(is_cut, action.pulse_duration_s == 1.1e-9, "{preset:?} {action:?}");
                assert!(
                    is_cut || pulse.half_band_hz() < 0.5 / radio.sample_spacing_s,
                    "{preset:?} {action:?}"
                );
            }
            assert_eq!(library.len(), preset.library().len());
        }
        let spacing_s = f64::from(RadioPreset::Dw1000.radio().sample_spacing_s);
        assert!((spacing_s - 1.0016e-9).abs() < 1e-13);
        // What the comment of the usual window says.
        assert!((Window::USUAL.after as f64 * spacing_s * 299_792_458.0 - 28.8).abs() < 0.05);
        assert_eq!(RadioPreset::Dw3000.radio().samples_per_frame, 128);
    }
}
