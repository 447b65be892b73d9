//! What a radio is where a scenario leaves it out.

use super::{Action, Converter, Library, NamedLibrary, Pulse, Radio, RadioKind, Window};

/// Chip rate of IEEE 802.15.4 HRP; receivers take two samples per chip.
const CHIP_RATE_HZ: f64 = 499.2e6;

/// Sample at which a DW1000 or DW3000 places the first path.
const FIRST_PATH_SAMPLE: usize = 740;

impl NamedLibrary {
    /// The actions in order.
    pub fn actions(self) -> Vec<Action> {
        // Channels are given by their carrier over the chip rate.
        let channel = |multiple: u32, pulse_duration_s| Action {
            carrier_hz: f64::from(multiple) * CHIP_RATE_HZ,
            pulse_duration_s,
        };
        let evenly = |first_hz: f64, step_hz: f64| {
            let action =
                |n| Action { carrier_hz: first_hz + f64::from(n) * step_hz, pulse_duration_s: 0.5e-9 };
            (0..40_u32).map(action).collect()
        };
        match self {
            Self::Published => evenly(6e9, 50e6),
            Self::Wide => evenly(5e9, 100e6),
            Self::Dw1000 => {
                let channels = [(7, 2e-9), (8, 2e-9), (9, 2e-9), (8, 1.1e-9), (13, 2e-9), (13, 1.1e-9)];
                channels.map(|(multiple, duration_s)| channel(multiple, duration_s)).to_vec()
            }
            Self::Dw3000 => [13, 16].map(|multiple| channel(multiple, 2e-9)).to_vec(),
            Self::HrpEurope => [13, 14, 15, 16].map(|multiple| channel(multiple, 2e-9)).to_vec(),
        }
    }
}

impl Radio {
    fn is_sounder(&self) -> bool {
        self.kind == RadioKind::Sounder
    }

    /// The pulse.
    pub fn pulse(&self) -> Pulse {
        let by_kind =
            || if self.is_sounder() { Pulse::RootRaisedCosine { roll_off: 0.6 } } else { Pulse::Hrp };
        self.pulse.clone().unwrap_or_else(by_kind)
    }

    /// The carriers and pulse durations to choose from.
    pub fn library(&self) -> Library {
        let by_kind = || {
            Library::Named(match self.kind {
                RadioKind::Sounder => NamedLibrary::Published,
                RadioKind::Dw1000 => NamedLibrary::Dw1000,
                RadioKind::Dw3000 => NamedLibrary::Dw3000,
            })
        };
        self.library.clone().unwrap_or_else(by_kind)
    }

    /// The same, spelt out.
    pub fn actions(&self) -> Vec<Action> {
        match self.library() {
            Library::Named(named) => named.actions(),
            Library::Listed(actions) => actions,
        }
    }

    /// Index into the library of the first frame.
    pub fn first_action(&self) -> usize {
        let by_kind = || {
            let from_7_ghz = |action: &Action| (action.carrier_hz - 7e9).abs();
            let actions = self.actions();
            let nearest = (0..actions.len())
                .min_by(|&i, &j| from_7_ghz(&actions[i]).total_cmp(&from_7_ghz(&actions[j])));
            if self.is_sounder() { nearest.unwrap_or(0) } else { 0 }
        };
        self.first_action.unwrap_or_else(by_kind)
    }

    /// Time between two samples, seconds.
    pub fn sample_spacing_s(&self) -> f64 {
        self.sample_spacing_s.unwrap_or(if self.is_sounder() { 0.25e-9 } else { 0.5 / CHIP_RATE_HZ })
    }

    /// Samples per frame.
    pub fn samples(&self) -> usize {
        self.samples.unwrap_or(if self.is_sounder() { 400 } else { 1016 })
    }

    /// How the samples lie in time.
    pub fn window(&self) -> Window {
        self.window.unwrap_or(if self.is_sounder() {
            Window::Absolute { first_sample_delay_s: 0.0 }
        } else {
            Window::FirstPath { sample: FIRST_PATH_SAMPLE }
        })
    }

    /// The converter, if any.
    pub fn converter(&self) -> Option<Converter> {
        let bits = match self.kind {
            RadioKind::Sounder => return self.converter,
            RadioKind::Dw1000 => 16,
            RadioKind::Dw3000 => 18,
        };
        self.converter.or(Some(Converter { bits, level: super::defaults::level() }))
    }

    /// Whether every packet has a random phase.
    pub fn random_phase(&self) -> bool {
        self.random_phase.unwrap_or(!self.is_sounder())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cogmint_core::radio::library::{
        Action as CoreAction, LIBRARY_DW1000, LIBRARY_DW3000, LIBRARY_HRP_EUROPE, LIBRARY_PUBLISHED,
        LIBRARY_WIDE,
    };

    fn same(named: NamedLibrary, core: &[CoreAction]) {
        let actions = named.actions();
        assert_eq!(actions.len(), core.len());
        for (action, core) in actions.iter().zip(core) {
            assert!((action.carrier_hz - f64::from(core.carrier_hz)).abs() < 1e3, "{action:?}");
            assert_eq!(action.pulse_duration_s as f32, core.pulse_duration_s);
        }
    }

    #[test]
    fn named_libraries_are_those_of_the_core() {
        same(NamedLibrary::Published, &LIBRARY_PUBLISHED);
        same(NamedLibrary::Wide, &LIBRARY_WIDE);
        same(NamedLibrary::Dw1000, &LIBRARY_DW1000);
        same(NamedLibrary::Dw3000, &LIBRARY_DW3000);
        same(NamedLibrary::HrpEurope, &LIBRARY_HRP_EUROPE);
    }

    #[test]
    fn a_sounder_starts_at_7_ghz_and_other_radios_with_their_first_channel() {
        let mut radio = Radio::default();
        assert_eq!(radio.actions()[radio.first_action()].carrier_hz, 7e9);
        radio.kind = RadioKind::Dw3000;
        assert_eq!((radio.first_action(), radio.samples()), (0, 1016));
        assert_eq!(radio.converter(), Some(Converter { bits: 18, level: 0.5 }));
    }
}
