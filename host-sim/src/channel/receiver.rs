//! The receiver of a scenario with every default filled in, and what it makes of a channel's samples.

use crate::scenario::{Action, Converter, Log, Pulse, Radio, Schedule, Window};
use rustfft::num_complex::Complex64;

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
        Self {
            pulse: radio.pulse(),
            actions: radio.actions(),
            first_action: radio.first_action(),
            schedule: radio.schedule,
            sample_spacing_s: radio.sample_spacing_s(),
            samples: radio.samples(),
            window: radio.window(),
            converter: radio.converter(),
            random_phase: radio.random_phase(),
            log: radio.log,
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
