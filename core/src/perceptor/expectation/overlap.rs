//! Overlap: what two paths that arrive within a pulse of each other do to each other's ranges.
//!
//! A path that the channel estimator does not resolve from another pulls the maximum of the matched filter's output. To
//! first order in the ratio rho of the two amplitudes, a path at a distance of `t` with relative phase phi shifts it by
//! rho cos(phi) R'(t) / R''(0). The phase turns with every centimetre, so that the shift has no mean and the variance
//! rho^2 / 2 (R'(t) / R''(0))^2: up to a quarter of a pulse duration of deviation, where the bound of a path alone knows
//! of millimetres. rho^2 is the ratio of the SINRs, and counts as 1 at most: of two unequal paths the stronger is the one
//! that is found.
//!
//! Two paths much closer than a pulse give one measurement (unresolved measurements, Koch and van Keuk 1997).

use crate::radio::pulse::{Pulse, unresolved};
use crate::real::{SPEED_OF_LIGHT_M_S, TAU, abs, larger, limited};

/// Guard: against work on paths that do not disturb each other: those farther apart than this many pulse durations.
pub const FARTHEST: f32 = 2.0;
/// Mathematics: step of the numerical derivative, pulse durations.
pub const STEP: f32 = 1.0 / 16.0;

/// A path that is expected.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arrival {
    /// Its length, metres.
    pub range_m: f32,
    /// Probability that it is there.
    pub presence: f32,
    /// Its SINR, linear.
    pub sinr: f32,
}

/// What its neighbours do to a path.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Overlap {
    /// Variance that they add to its range, square metres.
    pub variance_m2: f32,
    /// Probability (0 to 1) that the nearest of them is one with it.
    pub unresolved: f32,
}

/// How near two paths are: the same for both.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nearness {
    /// Square of the shift that the one has of the other where they are equally strong and in phase, square metres.
    shift_m2: f32,
    /// Probability (0 to 1) that they are one where they are both there.
    unresolved: f32,
}

impl Nearness {
    /// Of two paths received with `pulse`; `None` where they do not disturb each other.
    pub fn of(pulse: &Pulse, one: &Arrival, other: &Arrival) -> Option<Self> {
        let resolution_m = pulse.duration_s * SPEED_OF_LIGHT_M_S;
        let lag = abs(one.range_m - other.range_m) / resolution_m;
        if lag > FARTHEST {
            return None;
        }
        let rise = pulse.autocorrelation(lag + STEP) - pulse.autocorrelation(lag - STEP);
        let slope = rise * (0.5 / STEP);
        let bandwidth = TAU * (pulse.rms_bandwidth_hz() * pulse.duration_s);
        let shift_m = slope / (bandwidth * bandwidth) * resolution_m;
        Some(Self { shift_m2: shift_m * shift_m, unresolved: unresolved(lag) })
    }
}

impl Overlap {
    /// Adds what `other`, this near, does to `own`.
    pub fn add(&mut self, near: &Nearness, own: &Arrival, other: &Arrival) {
        let ratio = limited(other.presence * other.sinr / own.sinr, 0.0, 1.0);
        self.variance_m2 += 0.5 * (ratio * near.shift_m2);
        self.unresolved = larger(self.unresolved, other.presence * near.unresolved);
    }

    /// Of the probability that the path gives a measurement of its own, what is left: of two that are one, either has it.
    pub fn resolved(&self, detection: f32) -> f32 {
        detection * (1.0 - 0.5 * self.unresolved)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PULSE_S: f32 = 0.5e-9;

    /// Largest magnitude of two pulses, the second of amplitude `rho` and phase `phi` at `lag` pulse durations: its place.
    fn peak(pulse: &Pulse, rho: f32, phi: f32, lag: f32) -> f32 {
        let magnitude = |t: f32| {
            let (a, b) = (pulse.autocorrelation(t), rho * pulse.autocorrelation(t - lag));
            let (re, im) = (a + b * phi.cos(), b * phi.sin());
            re * re + im * im
        };
        let places = (-400..=400).map(|n| n as f32 / 1000.0);
        places.fold(0.0, |best, t| if magnitude(t) > magnitude(best) { t } else { best })
    }

    #[test]
    fn the_variance_is_that_of_the_peak_of_two_pulses_over_their_phase() {
        let pulse = Pulse::root_raised_cosine(PULSE_S, 0.6);
        let resolution_m = PULSE_S * SPEED_OF_LIGHT_M_S;
        for (rho, lag) in [(0.1_f32, 0.4_f32), (0.2, 0.7), (0.3, 1.0), (0.2, 1.3)] {
            let own = Arrival { range_m: 5.0, presence: 1.0, sinr: 1000.0 };
            let other =
                Arrival { range_m: 5.0 + lag * resolution_m, presence: 1.0, sinr: 1000.0 * rho * rho };
            let mut overlap = Overlap::default();
            overlap.add(&Nearness::of(&pulse, &own, &other).unwrap(), &own, &other);
            let shifts = (0..64).map(|n| peak(&pulse, rho, TAU * n as f32 / 64.0, lag) * resolution_m);
            let variance_m2 = shifts.map(|shift| shift * shift).sum::<f32>() / 64.0;
            let ratio = overlap.variance_m2 / variance_m2;
            assert!((0.6..1.6).contains(&ratio), "{rho} {lag}: {ratio}");
        }
    }

    #[test]
    fn what_is_far_away_or_not_there_disturbs_nothing_and_one_place_is_one_path() {
        let pulse = Pulse::root_raised_cosine(PULSE_S, 0.6);
        let own = Arrival { range_m: 5.0, presence: 1.0, sinr: 100.0 };
        let of = |other: Arrival| {
            let mut overlap = Overlap::default();
            if let Some(near) = Nearness::of(&pulse, &own, &other) {
                overlap.add(&near, &own, &other);
            }
            overlap
        };
        assert_eq!(of(Arrival { range_m: 5.4, ..own }), Overlap::default());
        assert_eq!(of(Arrival { range_m: 5.1, presence: 0.0, ..own }), Overlap::default());
        let same = of(own);
        assert!(same.variance_m2 < 1e-10 && same.unresolved == 1.0 && same.resolved(0.9) == 0.45);
    }
}
