//! Overlap: what a neighbour within a pulse does to the range of a path.
//!
//! With amplitude ratio rho, distance t and a random phase, it adds rho^2 / 2 (R'(t) / R''(0))^2 to the variance of the
//! delay, rho^2 being the ratio of the SINRs, at most 1. Two paths much closer than a pulse give one measurement.

use super::pulse::Pulse;
use super::real::{Real, abs, exp, larger, limited, speed_of_light, square, tau};
use cogmint_core::perceptor::expectation::overlap::{FARTHEST, STEP};
use cogmint_core::radio::pulse::MERGED;

/// An expected path.
#[derive(Clone, Copy, Debug)]
pub struct Arrival<T> {
    /// Length, metres.
    pub range_m: T,
    /// Probability that it is there.
    pub presence: T,
    /// SINR, linear.
    pub sinr: T,
}

/// What the arrivals other than number `k` do to it: the variance that they add to its range, square metres, and what they
/// leave of the probability `detection` that it gives a measurement of its own.
pub fn overlap<T: Real>(pulse: &Pulse<T>, arrivals: &[Arrival<T>], k: usize, detection: T) -> (T, T) {
    let num = T::of;
    let own = &arrivals[k];
    let resolution_m = pulse.duration_s * speed_of_light();
    let curvature = square(tau::<T>() * (pulse.rms_bandwidth_hz() * pulse.duration_s));
    let (mut variance_m2, mut unresolved) = (T::ZERO, T::ZERO);
    for l in 0..arrivals.len() {
        let lag = abs(own.range_m - arrivals[l].range_m) / resolution_m;
        if l == k || lag > num(FARTHEST) {
            continue;
        }
        let rise = pulse.autocorrelation(lag + num(STEP)) - pulse.autocorrelation(lag - num(STEP));
        // Order: slope over curvature, then the unit of length.
        let shift_m = rise * num(0.5 / STEP) / curvature * resolution_m;
        let ratio = limited(arrivals[l].presence * arrivals[l].sinr / own.sinr, T::ZERO, T::ONE);
        variance_m2 += num(0.5) * (ratio * square(shift_m));
        unresolved = larger(unresolved, arrivals[l].presence * exp(-square(lag / num(MERGED))));
    }
    (variance_m2, detection * (T::ONE - num(0.5) * unresolved))
}
