//! Dense multipath: everything too small and too many to be a path.
//!
//! Its power over the delay after the direct path is the soft-onset profile (Karedal, IEEE 802.15.4a),
//!
//! S_nu(t) = Omega_1 (g1 + gr) / (g1 (g1 + gr (1 - chi))) (1 - chi e^(-t / gr)) e^(-t / g1), t >= 0,
//!
//! with decay g1 and rise gr. It is made of plane waves from fixed scatterers all around: scatterer i has the phasor
//! c_i e^(-j 2 pi f t_i(p)), t_i(p) = T_i - u_i p / c, at every frequency f and place p, so that places and carriers
//! close to each other see nearly the same multipath (over distance: the Bessel function J_0(2 pi f d / c)). T_i is
//! spread evenly over all delays that matter, and c_i is scaled by the profile at the scatterer's present delay after
//! the direct path: the profile is met everywhere although the direct path moves.

use crate::scenario::Profile;
use rand_core::Rng;
use rustfft::num_complex::Complex64;

use super::lattice::{Lattice, Scratch};
use super::random::uniform;
use super::{SPEED_OF_LIGHT_M_S, cis};

/// Multiples of the decay time after which nothing is left of the profile (-61 dB).
const DECAYS: f64 = 14.0;

impl Profile {
    /// Power density at `excess_s` after the onset, 1/s; its integral is 1 but for the millionth behind its end.
    pub fn density(&self, excess_s: f64) -> f64 {
        if !(0.0..self.length_s()).contains(&excess_s) {
            return 0.0;
        }
        let Self { rise_s, decay_s, chi } = *self;
        (decay_s + rise_s) / (decay_s * (decay_s + rise_s * (1.0 - chi)))
            * (1.0 - chi * libm::exp(-excess_s / rise_s))
            * libm::exp(-excess_s / decay_s)
    }

    /// Delay after the onset beyond which the profile is taken as zero, seconds.
    pub fn length_s(&self) -> f64 {
        DECAYS * self.decay_s
    }
}

/// The square root of a profile over the delay, tabulated.
#[derive(Clone, Debug)]
pub struct ProfileTable {
    step_s: f64,
    values: Vec<f64>,
}

impl ProfileTable {
    /// The table of `profile` up to its end.
    pub fn new(profile: &Profile) -> Self {
        let step_s = (0.01 * profile.rise_s).min(0.002 * profile.decay_s).max(profile.length_s() * 1e-5);
        let entries = (profile.length_s() / step_s) as usize + 2;
        let values = (0..entries).map(|n| profile.density(n as f64 * step_s).sqrt()).collect();
        Self { step_s, values }
    }

    /// Power density at `excess_s` after the onset, 1/s.
    pub fn density(&self, excess_s: f64) -> f64 {
        let amplitude = self.amplitude(excess_s);
        amplitude * amplitude
    }

    /// Amplitude density at `excess_s` after the onset, 1/sqrt(s); zero outside the profile.
    fn amplitude(&self, excess_s: f64) -> f64 {
        if excess_s < 0.0 {
            return 0.0;
        }
        let place = excess_s / self.step_s;
        let index = place as usize;
        match (self.values.get(index), self.values.get(index + 1)) {
            (Some(low), Some(high)) => low + (high - low) * (place - index as f64),
            _ => 0.0,
        }
    }
}

#[derive(Clone, Copy, Debug)]
struct Scatterer {
    /// Delay at the centre, seconds.
    delay_s: f64,
    /// Unit vector towards it.
    direction: [f64; 2],
    amplitude: Complex64,
}

/// Fixed scatterers around a room.
#[derive(Clone, Debug)]
pub struct Scatterers {
    centre_m: [f64; 2],
    list: Vec<Scatterer>,
    /// Amplitude that makes their power density 1 per second.
    unit: f64,
}

/// Where scatterers are seen from, and how.
#[derive(Clone, Copy, Debug)]
pub struct View {
    /// Position of the tag, metres.
    pub position_m: [f64; 2],
    /// Delay at which the profile begins, seconds.
    pub onset_s: f64,
    /// Delay of the first sample, seconds.
    pub first_sample_s: f64,
    /// Frequency of the lattice point in the frame's centre, hertz.
    pub centre_hz: f64,
    /// Carrier, hertz.
    pub carrier_hz: f64,
}

impl Scatterers {
    /// Scatterers at delays (at the centre) from `from_s` to `to_s`, `per_second` of them per second of delay, one in
    /// each equal part of the interval.
    pub fn new(rng: &mut impl Rng, centre_m: [f64; 2], [from_s, to_s]: [f64; 2], per_second: f64) -> Self {
        let count = (((to_s - from_s) * per_second).ceil()).max(1.0) as usize;
        let spacing_s = (to_s - from_s) / count as f64;
        let list = (0..count)
            .map(|n| {
                let (sin, cos) = libm::sincos(std::f64::consts::TAU * uniform(rng));
                Scatterer {
                    delay_s: from_s + (n as f64 + uniform(rng)) * spacing_s,
                    direction: [cos, sin],
                    // All of one strength: the profile is met in every room, not just on average over rooms.
                    amplitude: cis(std::f64::consts::TAU * uniform(rng)),
                }
            })
            .collect();
        Self { centre_m, list, unit: spacing_s.sqrt() }
    }

    /// Puts all scatterers onto the lattice's delay grid with power `omega` in total. As seen by `view`, phases are
    /// e^(-j 2 pi (f t - (f - carrier) t_0)) at the centre frequency, t_0 the first sample's delay.
    pub fn spread(
        &self,
        lattice: &Lattice,
        scratch: &mut Scratch,
        view: &View,
        omega: f64,
        table: &ProfileTable,
    ) {
        let scale = self.unit * omega.sqrt();
        let [x, y] = [0, 1].map(|axis| view.position_m[axis] - self.centre_m[axis]);
        let [earliest_s, latest_s] = lattice.reach_s();
        for scatterer in &self.list {
            let [ux, uy] = scatterer.direction;
            let delay_s = scatterer.delay_s - (ux * x + uy * y) / SPEED_OF_LIGHT_M_S;
            let after_first_s = delay_s - view.first_sample_s;
            if !(after_first_s > earliest_s && after_first_s < latest_s) {
                continue;
            }
            let amplitude = table.amplitude(delay_s - view.onset_s);
            if amplitude == 0.0 {
                continue;
            }
            let turns = view.centre_hz * delay_s - (view.centre_hz - view.carrier_hz) * view.first_sample_s;
            let phase = cis(-std::f64::consts::TAU * (turns - libm::floor(turns)));
            lattice.spread(scratch, after_first_s, scatterer.amplitude * phase * (scale * amplitude));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_profile_has_the_golden_peak_and_integral() {
        let profile = Profile::default();
        let step_s = 1e-12;
        let integral: f64 =
            (0..400_000).map(|n| profile.density((f64::from(n) + 0.5) * step_s)).sum::<f64>() * step_s;
        assert!((integral - 1.0).abs() < 2e-6, "{integral}");
        let peak = (0..20_000)
            .map(|n| f64::from(n) * step_s)
            .max_by(|a, b| profile.density(*a).total_cmp(&profile.density(*b)));
        let peak_s = peak.expect("there are delays");
        assert!((peak_s - 7.946e-9).abs() < 1e-12, "{peak_s}");
        // The published 0.033440 is this, rounded up.
        assert!((profile.density(peak_s) * 1e-9 - 0.033440).abs() < 1e-6);
        assert_eq!(profile.density(-1e-12), 0.0);
    }

    #[test]
    fn the_table_follows_the_profile() {
        let profile = Profile { rise_s: 1e-9, decay_s: 12e-9, chi: 1.0 };
        let table = ProfileTable::new(&profile);
        for n in 1..1000 {
            let excess_s = f64::from(n) * 0.1e-9;
            let exact = profile.density(excess_s).sqrt();
            assert!((table.amplitude(excess_s) / exact - 1.0).abs() < 1e-4, "{excess_s}");
        }
        assert_eq!(table.amplitude(-1e-15), 0.0);
        assert_eq!(table.amplitude(1.0), 0.0);
    }
}
