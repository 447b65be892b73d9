//! The pulse behind the matched filter.
//!
//! R(t) = sinc(t/T_p) cos(pi b t/T_p) / (1 - (2 b t/T_p)^2), the autocorrelation of a root-raised-cosine pulse of
//! symbol time T_p and roll-off b; rms bandwidth beta = sqrt(1/12 + b^2 (1/4 - 2/pi^2)) / T_p; and the variance of a
//! range of a given SINR, sigma^2 = c^2 / (8 pi^2 beta^2 SINR). Or any pulse, from samples of its R.
//!
//! The channel estimator uses R from a table of 64 steps per T_p up to 4 T_p, interpolated linearly: the table is
//! part of the contract, not the closed form.

use cogmint_core::radio::pulse::{
    BAND_POINTS, LAG, LEAST_NYQUIST, PULSE_SAMPLES, PulseShape, STEPS, SUPPORT, UNTOUCHED,
};

use super::real::{Real, abs, cos, larger, limited, pi, sin, speed_of_light, sqrt, square, tau};

/// A pulse.
#[derive(Clone, Debug, PartialEq)]
pub struct Pulse<T> {
    /// Duration T_p, seconds.
    pub duration_s: T,
    /// Its shape.
    pub shape: Shape<T>,
}

/// What a pulse looks like behind the matched filter.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape<T> {
    /// Root-raised-cosine of roll-off b.
    RootRaisedCosine(T),
    /// Any other, by R at lags of 0, 1, 2, ... steps.
    Sampled {
        /// Seconds.
        step_s: T,
        /// R.
        autocorrelation: Vec<T>,
    },
}

impl<T: Real> Pulse<T> {
    /// The pulse of a duration that the core's `shape` describes.
    pub fn new(duration_s: T, shape: &PulseShape) -> Self {
        let shape = match shape {
            PulseShape::RootRaisedCosine { roll_off } => Shape::RootRaisedCosine(T::of(*roll_off)),
            PulseShape::Sampled { step_s, autocorrelation } => Shape::Sampled {
                step_s: T::of(*step_s),
                autocorrelation: autocorrelation.iter().map(|r| T::of(*r)).collect(),
            },
        };
        Self { duration_s, shape }
    }

    /// What is left of it where samples are `spacing_s` apart: 33 samples of R by the sum over 32 points of a band that half
    /// the sampling rate ends, beyond 0.8 of it along a cosine. Pulses that end below 0.85 of it are whole, and those shorter
    /// than half a sample.
    pub fn sampled_every(self, spacing_s: T) -> Self {
        let num = T::of;
        let Shape::RootRaisedCosine(roll_off) = self.shape else { return self };
        let nyquist = num(0.5) * self.duration_s / spacing_s;
        if num(0.5) * (T::ONE + roll_off) < num(UNTOUCHED) * nyquist || nyquist < num(LEAST_NYQUIST) {
            return self;
        }
        let mut sums = vec![T::ZERO; PULSE_SAMPLES];
        for n in 0..BAND_POINTS {
            let frequency = (T::of_count(n) + num(0.5)) * (nyquist * num(1.0 / BAND_POINTS as f32));
            let into = (frequency - num(0.5) * (T::ONE - roll_off)) / larger(roll_off, num(1e-3));
            let beyond = (frequency - num(0.8) * nyquist) / (num(0.2) * nyquist);
            let power = falling(into) * falling(beyond);
            // Order: Chebyshev's recursion, not a cosine each.
            let turn = num(2.0) * cos(tau::<T>() * frequency * num(LAG));
            let (mut last, mut now) = (num(0.5) * turn, T::ONE);
            for sum in &mut sums {
                *sum += power * now;
                (last, now) = (now, turn * now - last);
            }
        }
        let energy = sums[0];
        let autocorrelation = sums.into_iter().map(|sum| sum / energy).collect();
        let step_s = num(LAG) * self.duration_s;
        Self { shape: Shape::Sampled { step_s, autocorrelation }, ..self }
    }

    /// R at a lag in pulse durations.
    pub fn autocorrelation(&self, lag: T) -> T {
        match &self.shape {
            Shape::RootRaisedCosine(roll_off) => raised_cosine(lag, *roll_off),
            Shape::Sampled { step_s, autocorrelation } => {
                // Order: the lag times the quotient of durations.
                between_samples(autocorrelation, abs(lag) * (self.duration_s / *step_s))
            }
        }
    }

    /// Rms bandwidth beta, hertz.
    pub fn rms_bandwidth_hz(&self) -> T {
        let num = T::of;
        match &self.shape {
            Shape::RootRaisedCosine(roll_off) => {
                let shape =
                    num(1.0) / num(12.0) + square(*roll_off) * (num(0.25) - num(2.0) / square(pi::<T>()));
                sqrt(shape) / self.duration_s
            }
            Shape::Sampled { step_s, autocorrelation: r } => {
                // -R'' at zero, in steps, by the five-point rule.
                let curvature = (num(15.0) * r[0] + r[2] - num(16.0) * r[1]) / num(6.0);
                sqrt(larger(curvature, num(1e-6))) / (tau::<T>() * *step_s)
            }
        }
    }

    /// T_eff, seconds.
    pub fn effective_duration_s(&self) -> T {
        let num = T::of;
        match &self.shape {
            Shape::RootRaisedCosine(roll_off) => self.duration_s * (T::ONE - num(0.25) * *roll_off),
            Shape::Sampled { step_s, autocorrelation } => {
                let mut squares = T::ZERO;
                for r in autocorrelation {
                    squares += square(*r);
                }
                (num(2.0) * squares - T::ONE) * *step_s
            }
        }
    }

    /// Variance of a range estimated at `sinr` (linear), square metres.
    pub fn range_variance_m2(&self, sinr: T) -> T {
        let num = T::of;
        let beta_over_c = self.rms_bandwidth_hz() / speed_of_light();
        // Order: ((2 tau^2) (beta/c)^2) SINR.
        T::ONE / (num(2.0) * square(tau::<T>()) * square(beta_over_c) * larger(sinr, num(1e-3)))
    }
}

/// 1 at 0, 0 at 1, along a cosine.
fn falling<T: Real>(x: T) -> T {
    T::of(0.5) * (T::ONE + cos(pi::<T>() * limited(x, T::ZERO, T::ONE)))
}

fn raised_cosine<T: Real>(lag: T, roll_off: T) -> T {
    let num = T::of;
    let x = abs(lag);
    let sinc = if x < num(1e-4) { T::ONE } else { sin(pi::<T>() * x) / (pi::<T>() * x) };
    // Order: (2 b) x, and (pi b) x.
    let edge = num(2.0) * roll_off * x;
    let denominator = T::ONE - square(edge);
    // At the pole both vanish; their ratio tends to pi / 4.
    let taper = if abs(denominator) < num(1e-4) {
        pi::<T>() / num(4.0)
    } else {
        cos(pi::<T>() * roll_off * x) / denominator
    };
    sinc * taper
}

/// Lagrange's polynomial through the six samples around a position in steps; even, and zero beyond the samples.
fn between_samples<T: Real>(samples: &[T], position: T) -> T {
    if position >= T::of_count(samples.len() - 1) {
        return T::ZERO;
    }
    let base = position.whole();
    let fraction = position - T::of_count(base as usize);
    let at = |node: i64| if node < 0 { -T::of_count(-node as usize) } else { T::of_count(node as usize) };
    let mut value = T::ZERO;
    for node in -2..=3 {
        let mut weight = T::ONE;
        for other in (-2..=3).filter(|other| *other != node) {
            weight *= (fraction - at(other)) / at(node - other);
        }
        let index = (base + node).unsigned_abs() as usize;
        value += weight * samples.get(index).copied().unwrap_or(T::ZERO);
    }
    value
}

/// R(t), tabulated.
#[derive(Clone, Debug)]
pub struct PulseTable<T> {
    values: Vec<T>,
    steps_per_sample: T,
}

impl<T: Real> PulseTable<T> {
    /// The table of `pulse` for samples `sample_spacing_s` seconds apart.
    pub fn new(pulse: &Pulse<T>, sample_spacing_s: T) -> Self {
        let mut values = Vec::new();
        for step in 0..STEPS * SUPPORT {
            values.push(pulse.autocorrelation(T::of_count(step) / T::of_count(STEPS)));
        }
        // The pulse ends here; the last interval leads down to it.
        values.push(T::ZERO);
        Self { values, steps_per_sample: sample_spacing_s / pulse.duration_s * T::of_count(STEPS) }
    }

    /// R at a lag in samples.
    pub fn at(&self, lag_samples: T) -> T {
        let position = abs(lag_samples) * self.steps_per_sample;
        if position >= T::of_count(STEPS * SUPPORT) {
            return T::ZERO;
        }
        let step = position.whole() as usize;
        let fraction = position - T::of_count(step);
        let (low, high) = (self.values[step], self.values[step + 1]);
        low + fraction * (high - low)
    }

    /// Half the width of the pulse, samples.
    pub fn support_samples(&self) -> T {
        T::of_count(STEPS * SUPPORT) / self.steps_per_sample
    }

    /// Samples per pulse duration.
    pub fn samples_per_pulse(&self) -> T {
        T::of_count(STEPS) / self.steps_per_sample
    }
}
