//! The receiver of a scenario with every default filled in, and what it makes of a channel's samples.

use crate::scenario::{
    Action, Converter, Library, Log, NamedLibrary, Pulse, Radio, RadioKind, Schedule, Window,
};
use cogmint_core::controller::library;
use rustfft::num_complex::Complex64;

/// Sampling rate of the DW1000 and DW3000 accumulator: two samples per chip of 499.2 MHz.
const DW_SPACING_S: f64 = 1.0 / 998.4e6;
/// Accumulator length at 64 MHz pulse repetition.
const DW_SAMPLES: usize = 1016;
/// Where the DW radios place the first path in the accumulator.
const DW_FIRST_PATH: usize = 740;
/// Channels 5, 6, 8 and 9 of IEEE 802.15.4 HRP, hertz: what Europe admits without mitigation.
const HRP_EUROPE_HZ: [f64; 4] = [6489.6e6, 6988.8e6, 7488.0e6, 7987.2e6];
/// Carrier that a sounder starts with, hertz.
const START_CARRIER_HZ: f64 = 7e9;

/// A radio with every default filled in.
#[derive(Clone, Debug, PartialEq)]
pub struct Receiver {
    /// The pulse; its duration is the action's.
    pub pulse: Pulse,
    /// Carriers and pulse durations.
    pub actions: Vec<Action>,
    /// Index of the first frame's action.
    pub first_action: usize,
    /// Which action each cycle of a recording uses.
    pub schedule: Schedule,
    /// Time between two samples, seconds.
    pub sample_spacing_s: f64,
    /// Samples per frame.
    pub samples: usize,
    /// How they lie in time.
    pub window: Window,
    /// The converter, if it is modelled.
    pub converter: Option<Converter>,
    /// Whether every packet has a random phase.
    pub random_phase: bool,
    /// What is logged.
    pub log: Log,
}

impl Receiver {
    /// What a scenario's radio is.
    pub fn new(radio: &Radio) -> Self {
        let is_sounder = radio.kind == RadioKind::Sounder;
        let library = radio.library.clone().unwrap_or(Library::Named(match radio.kind {
            RadioKind::Sounder => NamedLibrary::Published,
            RadioKind::Dw1000 => NamedLibrary::Dw1000,
            RadioKind::Dw3000 => NamedLibrary::Dw3000,
        }));
        let actions = actions(&library);
        let distance = |action: &Action| (action.carrier_hz - START_CARRIER_HZ).abs();
        let nearest =
            (0..actions.len()).min_by(|&a, &b| distance(&actions[a]).total_cmp(&distance(&actions[b])));
        let first_action = radio.first_action.unwrap_or(if is_sounder { nearest.unwrap_or(0) } else { 0 });
        let bits = match radio.kind {
            RadioKind::Sounder => None,
            RadioKind::Dw1000 => Some(16),
            RadioKind::Dw3000 => Some(18),
        };
        Self {
            pulse: radio.pulse.clone().unwrap_or(if is_sounder {
                Pulse::RootRaisedCosine { roll_off: 0.6 }
            } else {
                Pulse::Hrp
            }),
            first_action,
            schedule: radio.schedule,
            sample_spacing_s: radio.sample_spacing_s.unwrap_or(if is_sounder {
                0.25e-9
            } else {
                DW_SPACING_S
            }),
            samples: radio.samples.unwrap_or(if is_sounder { 400 } else { DW_SAMPLES }),
            window: radio.window.unwrap_or(if is_sounder {
                Window::Absolute { first_sample_delay_s: 0.0 }
            } else {
                Window::FirstPath { sample: DW_FIRST_PATH.min(radio.samples.unwrap_or(DW_SAMPLES) * 3 / 4) }
            }),
            converter: radio.converter.or(bits.map(|bits| Converter { bits, level: 0.5 })),
            random_phase: radio.random_phase.unwrap_or(!is_sounder),
            log: radio.log,
            actions,
        }
    }

    /// Roll-off of the root-raised-cosine pulse that comes nearest to this radio's: a sampled pulse gives the one of
    /// its rms bandwidth `bandwidth_hz` at `duration_s`.
    pub fn roll_off(&self, bandwidth_hz: f64, duration_s: f64) -> f64 {
        match &self.pulse {
            Pulse::RootRaisedCosine { roll_off } => *roll_off,
            Pulse::Hrp => 0.5,
            Pulse::Sampled { .. } => {
                // beta^2 T^2 = 1/12 + b^2 (1/4 - 2/pi^2).
                let product = bandwidth_hz * duration_s;
                let pi = std::f64::consts::PI;
                ((product * product - 1.0 / 12.0) / (0.25 - 2.0 / (pi * pi))).clamp(0.0, 1.0).sqrt()
            }
        }
    }
}

/// The entries of a library.
pub fn actions(library: &Library) -> Vec<Action> {
    let of_core = |entries: &[library::Action]| {
        let action = |entry: &library::Action| Action {
            // The core holds single precision; carriers are whole multiples of 100 kHz and pulses of 1 ps.
            carrier_hz: libm::round(f64::from(entry.carrier_hz) / 1e5) * 1e5,
            pulse_duration_s: libm::round(f64::from(entry.pulse_duration_s) * 1e12) * 1e-12,
        };
        entries.iter().map(action).collect()
    };
    match library {
        Library::Listed(actions) => actions.clone(),
        Library::Named(NamedLibrary::Published) => of_core(&library::LIBRARY_PUBLISHED),
        Library::Named(NamedLibrary::Wide) => of_core(&library::LIBRARY_WIDE),
        Library::Named(NamedLibrary::Dw1000) => of_core(&library::LIBRARY_DW1000),
        Library::Named(NamedLibrary::Dw3000) => of_core(&library::LIBRARY_DW3000),
        Library::Named(NamedLibrary::HrpEurope) => {
            HRP_EUROPE_HZ.map(|carrier_hz| Action { carrier_hz, pulse_duration_s: 2e-9 }).to_vec()
        }
    }
}

impl Converter {
    /// Rounds samples to counts, with gain control that puts the largest part at the level; gives the gain. Samples
    /// beyond full scale are clipped.
    pub fn convert(&self, samples: &mut [Complex64]) -> f64 {
        let full_scale = libm::exp2(f64::from(self.bits - 1));
        let largest = samples.iter().fold(0.0, |largest: f64, s| largest.max(s.re.abs()).max(s.im.abs()));
        if largest == 0.0 {
            return 1.0;
        }
        let gain = self.level * full_scale / largest;
        let convert = |part: f64| libm::rint(part * gain).clamp(-full_scale, full_scale - 1.0);
        samples.iter_mut().for_each(|s| *s = Complex64::new(convert(s.re), convert(s.im)));
        gain
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sounder_starts_nearest_to_seven_gigahertz() {
        let receiver = Receiver::new(&Radio::default());
        assert_eq!(receiver.actions[receiver.first_action].carrier_hz, 7e9);
        assert_eq!(receiver.actions.len(), 40);
        assert_eq!(receiver.samples, 400);
    }

    #[test]
    fn a_dw3000_has_two_channels_eighteen_bits_and_random_phases() {
        let receiver = Receiver::new(&Radio { kind: RadioKind::Dw3000, ..Radio::default() });
        assert_eq!(receiver.actions.iter().map(|a| a.carrier_hz).collect::<Vec<_>>(), [6489.6e6, 7987.2e6]);
        assert_eq!(receiver.converter.map(|converter| converter.bits), Some(18));
        assert!(receiver.random_phase);
        assert!((receiver.sample_spacing_s - 1.0016e-9).abs() < 1e-13);
    }

    #[test]
    fn a_converter_rounds_to_counts_and_clips_beyond_full_scale() {
        let mut samples = [Complex64::new(1.0, 0.0), Complex64::new(-0.25, 0.1)];
        let gain = Converter { bits: 8, level: 0.5 }.convert(&mut samples);
        assert_eq!(gain, 64.0);
        assert_eq!(samples, [Complex64::new(64.0, 0.0), Complex64::new(-16.0, 6.0)]);
        let mut samples = [Complex64::new(1.0, -1.0), Complex64::new(0.1, 0.0)];
        Converter { bits: 4, level: 2.0 }.convert(&mut samples);
        assert_eq!(samples, [Complex64::new(7.0, -8.0), Complex64::new(2.0, 0.0)]);
    }

    #[test]
    fn a_sampled_pulse_counts_as_the_roll_off_of_its_bandwidth() {
        let pulse = Pulse::Sampled { spacing_s: 1e-10, samples: vec![[1.0, 0.0]; 2] };
        let receiver = Receiver { pulse, ..Receiver::new(&Radio::default()) };
        assert!((receiver.roll_off(633.6626e6, 0.5e-9) - 0.6).abs() < 1e-5);
    }
}
