//! Action libraries: the carriers (and pulses) a radio can choose from.

use crate::error::{Error, Setting};
use crate::real::{SPEED_OF_LIGHT_M_S, abs, larger, smaller};
use crate::snapshot::written;
use heapless::Vec;

/// What the radio can be told: a carrier and a pulse.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Action {
    /// Carrier frequency, hertz (0.1 to 100 GHz).
    pub carrier_hz: f32,
    /// Pulse duration T_p, seconds (0.1 to 10 ns).
    pub pulse_duration_s: f32,
}

/// The published library: 6.00 to 7.95 GHz in steps of 50 MHz, T_p = 0.5 ns. It can avoid at most 2.3 dB of an
/// interferer 2 GHz wide at 7 GHz.
pub const LIBRARY_PUBLISHED: [Action; 40] = evenly_spaced(6.00e9, 50e6, 0.5e-9);

/// A library wide enough to get away: 5.0 to 8.9 GHz in steps of 100 MHz, T_p = 0.5 ns.
pub const LIBRARY_WIDE: [Action; 40] = evenly_spaced(5.0e9, 100e6, 0.5e-9);

/// Channels 1, 2, 3, 4, 5, 7 of the DW1000; its receiver limits channels 4 and 7 to about 900 MHz.
pub const LIBRARY_DW1000: [Action; 6] = [
    Action { carrier_hz: 3.4944e9, pulse_duration_s: 2.0e-9 },
    Action { carrier_hz: 3.9936e9, pulse_duration_s: 2.0e-9 },
    Action { carrier_hz: 4.4928e9, pulse_duration_s: 2.0e-9 },
    Action { carrier_hz: 3.9936e9, pulse_duration_s: 1.1e-9 },
    Action { carrier_hz: 6.4896e9, pulse_duration_s: 2.0e-9 },
    Action { carrier_hz: 6.4896e9, pulse_duration_s: 1.1e-9 },
];

/// Channels 0 to 15 of IEEE 802.15.4 HRP UWB, with the pulse of each one's bandwidth.
pub const LIBRARY_HRP: [Action; 16] = [
    Action { carrier_hz: 0.4992e9, pulse_duration_s: 2.0e-9 },
    Action { carrier_hz: 3.4944e9, pulse_duration_s: 2.0e-9 },
    Action { carrier_hz: 3.9936e9, pulse_duration_s: 2.0e-9 },
    Action { carrier_hz: 4.4928e9, pulse_duration_s: 2.0e-9 },
    Action { carrier_hz: 3.9936e9, pulse_duration_s: 0.75e-9 },
    Action { carrier_hz: 6.4896e9, pulse_duration_s: 2.0e-9 },
    Action { carrier_hz: 6.9888e9, pulse_duration_s: 2.0e-9 },
    Action { carrier_hz: 6.4896e9, pulse_duration_s: 0.92e-9 },
    Action { carrier_hz: 7.4880e9, pulse_duration_s: 2.0e-9 },
    Action { carrier_hz: 7.9872e9, pulse_duration_s: 2.0e-9 },
    Action { carrier_hz: 8.4864e9, pulse_duration_s: 2.0e-9 },
    Action { carrier_hz: 7.9872e9, pulse_duration_s: 0.75e-9 },
    Action { carrier_hz: 8.9856e9, pulse_duration_s: 2.0e-9 },
    Action { carrier_hz: 9.4848e9, pulse_duration_s: 2.0e-9 },
    Action { carrier_hz: 9.9840e9, pulse_duration_s: 2.0e-9 },
    Action { carrier_hz: 9.4848e9, pulse_duration_s: 0.74e-9 },
];

/// Of those, the 500 MHz channels that the European Union allows without mitigation: 5, 6, 8, 9.
pub const LIBRARY_HRP_EUROPE: [Action; 4] = channels([5, 6, 8, 9]);

/// Channels 5 and 9 of the DW3000.
pub const LIBRARY_DW3000: [Action; 2] = channels([5, 9]);

/// Evaluated at compile time, where an index out of bounds would be a compile error.
#[allow(clippy::indexing_slicing)]
const fn channels<const N: usize>(channels: [usize; N]) -> [Action; N] {
    let mut actions = [LIBRARY_HRP[0]; N];
    let mut i = 0;
    while i < N {
        actions[i] = LIBRARY_HRP[channels[i]];
        i += 1;
    }
    actions
}

/// Evaluated at compile time, where an index out of bounds would be a compile error.
#[allow(clippy::indexing_slicing)]
const fn evenly_spaced<const N: usize>(first_hz: f32, step_hz: f32, pulse_duration_s: f32) -> [Action; N] {
    let mut actions = [Action { carrier_hz: first_hz, pulse_duration_s }; N];
    let mut i = 0;
    while i < N {
        actions[i].carrier_hz = first_hz + i as f32 * step_hz;
        i += 1;
    }
    actions
}

/// Mathematics: rho(x) = int P(f) P(f - x) df / int P^2 df of two raised-cosine spectra of roll-off 0.6 and unit width, at
/// x = 0, 0.05, ..., 1.6; zero beyond.
const OVERLAP: [f32; 33] = [
    1.000000, 0.993986, 0.976321, 0.948041, 0.910646, 0.865889, 0.815576, 0.761391, 0.704763, 0.646788,
    0.588217, 0.529547, 0.471148, 0.413422, 0.356918, 0.302350, 0.250559, 0.202450, 0.158898, 0.120654,
    0.088235, 0.061831, 0.041251, 0.025979, 0.015265, 0.008232, 0.003977, 0.001657, 0.000559, 0.000136,
    0.000018, 0.000001, 0.000000,
];
/// Mathematics: entries of [`OVERLAP`] per unit of x.
const OVERLAP_STEPS: f32 = 20.0;

/// Which entries of a library may be chosen.
pub type Allowed<const ACTIONS: usize> = [bool; ACTIONS];

/// A validated library of at most `ACTIONS` actions.
#[derive(Clone, Debug)]
pub struct Library<const ACTIONS: usize> {
    actions: Vec<Action, ACTIONS>,
}

impl<const ACTIONS: usize> Library<ACTIONS> {
    /// A library of these actions.
    ///
    /// # Errors
    /// [`Error::Configuration`] where there is none or too many, or one is out of range.
    pub fn new(actions: &[Action]) -> Result<Self, Error> {
        let mut library = Self::empty();
        library.start(actions)?;
        Ok(library)
    }

    /// A library without actions: to be started.
    pub const fn empty() -> Self {
        Self { actions: Vec::new() }
    }

    /// Without actions again.
    pub fn clear(&mut self) {
        self.actions.clear();
    }

    /// As [`Self::new`], where it stays.
    ///
    /// # Errors
    /// As [`Self::new`]; the library has no actions then.
    pub fn start(&mut self, actions: &[Action]) -> Result<(), Error> {
        self.clear();
        let filled = self.fill(actions);
        if filled.is_err() {
            self.clear();
        }
        filled
    }

    fn fill(&mut self, actions: &[Action]) -> Result<(), Error> {
        if actions.is_empty() {
            return Err(Error::Configuration(Setting::LibraryEmpty));
        }
        for action in actions {
            if !(action.carrier_hz >= 1e8 && action.carrier_hz <= 1e11) {
                return Err(Error::Configuration(Setting::Carrier));
            }
            if !(action.pulse_duration_s >= 0.99e-10 && action.pulse_duration_s <= 1.01e-8) {
                return Err(Error::Configuration(Setting::PulseDuration));
            }
            self.actions.push(*action).map_err(|_| Error::Configuration(Setting::LibraryLength))?;
        }
        Ok(())
    }

    /// Length of the shortest pulse, metres.
    pub fn shortest_pulse_m(&self) -> f32 {
        let durations_s = self.actions.iter().map(|action| action.pulse_duration_s);
        SPEED_OF_LIGHT_M_S * durations_s.fold(f32::INFINITY, smaller)
    }

    /// Number of actions.
    pub fn len(&self) -> usize {
        self.actions.len()
    }

    /// Whether there is none; a validated library has at least one.
    pub fn is_empty(&self) -> bool {
        self.actions.is_empty()
    }

    /// Every entry, to choose from.
    pub fn all(&self) -> Allowed<ACTIONS> {
        let mut all = [false; ACTIONS];
        all.iter_mut().take(self.len()).for_each(|allowed| *allowed = true);
        all
    }

    /// The action of an index.
    pub fn get(&self, index: usize) -> Option<&Action> {
        self.actions.get(index)
    }

    /// Spectral overlap of two actions' pulses, 0 to 1. For pulses of unequal width the distance counts in mean
    /// widths and the overlap in the narrower one's share of the wider.
    pub fn overlap(&self, a: usize, b: usize) -> f32 {
        let (Some(a), Some(b)) = (self.actions.get(a), self.actions.get(b)) else { return 0.0 };
        let (ta, tb) = (a.pulse_duration_s, b.pulse_duration_s);
        let mean_width_hz = 0.5 * (1.0 / ta + 1.0 / tb);
        let position = abs(a.carrier_hz - b.carrier_hz) / mean_width_hz * OVERLAP_STEPS;
        // Not negative, so truncation is the floor.
        let index = position as usize;
        let low = OVERLAP.get(index).copied().unwrap_or(0.0);
        let high = OVERLAP.get(index.saturating_add(1)).copied().unwrap_or(0.0);
        let narrower = if ta > tb { tb / ta } else { ta / larger(tb, 1e-12) };
        (low + (position - index as f32) * (high - low)) * narrower
    }
}

written!(Action { carrier_hz, pulse_duration_s });
written!(Library<const ACTIONS> { actions });

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_overlap_matches_the_published_numbers() {
        let library = Library::<40>::new(&LIBRARY_WIDE).unwrap();
        assert!((library.overlap(20, 20) - 1.0).abs() < 1e-6);
        assert!((library.overlap(20, 30) - 0.5882).abs() < 2e-4);
        assert!((library.overlap(5, 25) - 0.0882).abs() < 2e-4);
        assert_eq!(library.overlap(3, 17), library.overlap(17, 3));
        assert!((10.0 * library.overlap(10, 15).log10() + 0.63).abs() < 0.01);
    }

    #[test]
    fn the_libraries_span_what_they_say() {
        assert_eq!(LIBRARY_PUBLISHED[0].carrier_hz, 6.00e9);
        assert!((LIBRARY_PUBLISHED[39].carrier_hz - 7.95e9).abs() < 1e3);
        assert!((LIBRARY_WIDE[39].carrier_hz - 8.9e9).abs() < 1e3);
    }

    #[test]
    fn channels_are_multiples_of_the_chip_rate_and_europe_s_lie_in_its_band() {
        let library = Library::<16>::new(&LIBRARY_HRP).unwrap();
        for channel in 0..library.len() {
            let multiple = library.get(channel).unwrap().carrier_hz / 499.2e6;
            assert!((multiple - multiple.round()).abs() < 1e-4, "channel {channel}");
        }
        assert_eq!(LIBRARY_DW3000.map(|action| action.carrier_hz), [6.4896e9, 7.9872e9]);
        for action in LIBRARY_HRP_EUROPE {
            assert!(action.carrier_hz - 249.6e6 > 6.0e9 && action.carrier_hz + 249.6e6 < 8.5e9);
        }
    }

    #[test]
    fn libraries_out_of_range_are_refused() {
        assert!(Library::<4>::new(&[]).is_err());
        assert!(Library::<4>::new(&LIBRARY_DW1000).is_err());
        assert!(Library::<4>::new(&[Action { carrier_hz: f32::NAN, pulse_duration_s: 1e-9 }]).is_err());
        assert!(Library::<4>::new(&[Action { carrier_hz: 7e9, pulse_duration_s: 0.0 }]).is_err());
    }
}
