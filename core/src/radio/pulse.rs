//! The transmitted pulse as the receiver's matched filter sees it: its autocorrelation R(t), and its rms bandwidth
//! beta, which sets what a range can be worth: sigma^2 = c^2 / (8 pi^2 beta^2 SINR).
//!
//! A root-raised-cosine pulse of symbol time `T_p` and roll-off `b` leaves the matched filter as the raised-cosine
//! pulse R(t) = sinc(t/T_p) cos(pi b t/T_p) / (1 - (2 b t/T_p)^2), with beta = sqrt(1/12 + b^2 (1/4 - 2/pi^2)) / T_p.
//! Any other pulse comes as samples of its R, for example one measured over a cable: beta^2 = -R''(0) / (4 pi^2).

use crate::real::{SPEED_OF_LIGHT_M_S, TAU, abs, cos, exp, larger, limited, sin, sqrt};
use crate::snapshot::{Sink, Written, written};

/// Mathematics: grid of the table, steps per pulse duration.
pub const STEPS: usize = 64;
/// Mathematics: the pulse is taken as zero beyond this many pulse durations.
pub const SUPPORT: usize = 4;
/// Capacity: table entries: zero to [`SUPPORT`] pulse durations, and one more to interpolate into.
const ENTRIES: usize = STEPS * SUPPORT + 2;
/// Capacity: samples of a sampled pulse's autocorrelation, from lag zero on.
pub const PULSE_SAMPLES: usize = 33;
/// Mathematics: grid step between them where the pulse is a limited one, pulse durations.
pub const LAG: f32 = SUPPORT as f32 / (PULSE_SAMPLES - 1) as f32;
/// Mathematics: nodes of the integral over a limited pulse's spectrum.
pub const BAND_POINTS: usize = 32;
/// Guard: against work on pulses that the receiver keeps: those that end below this share of half the sampling rate.
pub const UNTOUCHED: f32 = 0.85;
/// Guard: against pulses shorter than half a sample, of which what is left is longer than the table: least half sampling rate,
/// in inverse pulse durations.
pub const LEAST_NYQUIST: f32 = 0.25;

/// Mathematics: scale of the distance within which the channel estimator does not resolve two paths, pulse durations; fitted to
/// simulated frames: at 25 dB, equal paths 0.7 apart are resolved in most.
pub const MERGED: f32 = 0.6;

/// What a pulse looks like behind the matched filter.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum PulseShape {
    /// Root-raised-cosine, its symbol time the pulse duration.
    RootRaisedCosine {
        /// Roll-off b, 0 to 1.
        roll_off: f32,
    },
    /// Any pulse whose spectrum is symmetric about the carrier, so that R is real.
    Sampled {
        /// Time between two samples, seconds; an eighth of the pulse duration, say, so that the samples end where the
        /// estimator takes the pulse as zero.
        step_s: f32,
        /// R at lags of 0, 1, 2, ... steps; 1 at lag 0.
        autocorrelation: [f32; PULSE_SAMPLES],
    },
}

/// A pulse.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Pulse {
    /// Duration T_p, seconds; 0.1 ns to 10 ns. The nominal bandwidth is its inverse.
    pub duration_s: f32,
    /// Its shape.
    pub shape: PulseShape,
}

impl Pulse {
    /// No pulse.
    pub(crate) const NONE: Self =
        Self { duration_s: 0.0, shape: PulseShape::RootRaisedCosine { roll_off: 0.0 } };

    /// A root-raised-cosine pulse of symbol time `duration_s` (seconds) and roll-off `roll_off` (0 to 1).
    pub fn root_raised_cosine(duration_s: f32, roll_off: f32) -> Self {
        Self { duration_s, shape: PulseShape::RootRaisedCosine { roll_off } }
    }

    /// The pulse as a receiver that samples every `spacing_s` seconds keeps it: a band that sampling cannot hold is cut, by a
    /// cosine from 0.8 of half the sampling rate on. Sampled pulses are taken to be what such a receiver made of them.
    pub fn sampled_every(self, spacing_s: f32) -> Self {
        let PulseShape::RootRaisedCosine { roll_off } = self.shape else { return self };
        let nyquist = 0.5 * self.duration_s / spacing_s;
        if 0.5 * (1.0 + roll_off) < UNTOUCHED * nyquist || nyquist < LEAST_NYQUIST {
            return self;
        }
        let mut autocorrelation = [0.0; PULSE_SAMPLES];
        for n in 0..BAND_POINTS {
            // Cycles per pulse duration.
            let frequency = (n as f32 + 0.5) * (nyquist * (1.0 / BAND_POINTS as f32));
            let into = (frequency - 0.5 * (1.0 - roll_off)) / larger(roll_off, 1e-3);
            let power = falling(into) * falling((frequency - 0.8 * nyquist) / (0.2 * nyquist));
            // cos((k + 1) x) = 2 cos x cos(k x) - cos((k - 1) x)
            let turn = 2.0 * cos(TAU * frequency * LAG);
            let [mut last, mut now] = [0.5 * turn, 1.0];
            for r in &mut autocorrelation {
                *r += power * now;
                [last, now] = [now, turn * now - last];
            }
        }
        let [energy, ..] = autocorrelation;
        autocorrelation.iter_mut().for_each(|r| *r /= energy);
        Self { shape: PulseShape::Sampled { step_s: LAG * self.duration_s, autocorrelation }, ..self }
    }

    /// Autocorrelation R at lag `lag` (in pulse durations); R(0) = 1.
    pub fn autocorrelation(&self, lag: f32) -> f32 {
        match &self.shape {
            PulseShape::RootRaisedCosine { roll_off } => raised_cosine(lag, *roll_off),
            PulseShape::Sampled { step_s, autocorrelation } => {
                between_samples(autocorrelation, abs(lag) * (self.duration_s / step_s))
            }
        }
    }

    /// Rms (effective) bandwidth beta, hertz.
    pub fn rms_bandwidth_hz(&self) -> f32 {
        let pi = core::f32::consts::PI;
        match &self.shape {
            PulseShape::RootRaisedCosine { roll_off: b } => {
                sqrt(1.0 / 12.0 + b * b * (0.25 - 2.0 / (pi * pi))) / self.duration_s
            }
            PulseShape::Sampled { step_s, autocorrelation: [zero, one, two, ..] } => {
                // R'' at zero from five samples, two of them by symmetry.
                let curvature = (15.0 * zero + two - 16.0 * one) / 6.0;
                sqrt(larger(curvature, 1e-6)) / (TAU * step_s)
            }
        }
    }

    /// Beyond this distance from the carrier the pulse has nothing, hertz: of a sampled pulse the edge of the widest
    /// raised cosine with its rms bandwidth.
    pub fn half_band_hz(&self) -> f32 {
        match &self.shape {
            PulseShape::RootRaisedCosine { roll_off } => 0.5 * (1.0 + roll_off) / self.duration_s,
            PulseShape::Sampled { .. } => 2.77 * self.rms_bandwidth_hz(),
        }
    }

    /// T_eff, the integral over R^2, seconds: time over which the matched filter smears one sample of noise.
    pub fn effective_duration_s(&self) -> f32 {
        match &self.shape {
            PulseShape::RootRaisedCosine { roll_off } => self.duration_s * (1.0 - 0.25 * roll_off),
            PulseShape::Sampled { step_s, autocorrelation } => {
                let squares: f32 = autocorrelation.iter().map(|r| r * r).sum();
                (2.0 * squares - 1.0) * step_s
            }
        }
    }

    /// Variance of a range estimated at `sinr` (linear power ratio): the single-path Cramer-Rao bound, square metres.
    pub fn range_variance_m2(&self, sinr: f32) -> f32 {
        let beta_over_c = self.rms_bandwidth_hz() / SPEED_OF_LIGHT_M_S;
        1.0 / (2.0 * (TAU * TAU) * (beta_over_c * beta_over_c) * larger(sinr, 1e-3))
    }
}

/// Probability that two paths that are `lag` pulse durations apart give one measurement.
pub fn unresolved(lag: f32) -> f32 {
    let near = lag / MERGED;
    exp(-(near * near))
}

/// Half a period of a cosine, from 1 at 0 to 0 at 1.
fn falling(x: f32) -> f32 {
    0.5 * (1.0 + cos(core::f32::consts::PI * limited(x, 0.0, 1.0)))
}

fn raised_cosine(lag: f32, roll_off: f32) -> f32 {
    let pi = core::f32::consts::PI;
    let x = abs(lag);
    let sinc = if x < 1e-4 { 1.0 } else { sin(pi * x) / (pi * x) };
    let edge = 2.0 * roll_off * x;
    let taper_denominator = 1.0 - edge * edge;
    // At the pole |t| = T_p / (2 b) numerator and denominator vanish together; their ratio is pi / 4.
    let taper =
        if abs(taper_denominator) < 1e-4 { pi / 4.0 } else { cos(pi * roll_off * x) / taper_denominator };
    sinc * taper
}

/// An even function at `position` (not negative) between its samples, by the polynomial through six of them; zero
/// beyond the last.
fn between_samples(samples: &[f32; PULSE_SAMPLES], position: f32) -> f32 {
    if !(position < (PULSE_SAMPLES - 1) as f32) {
        return 0.0;
    }
    // Not negative, so truncation is the floor.
    let base = position as i32;
    let fraction = position - base as f32;
    let mut value = 0.0;
    for node in -2_i32..=3 {
        let mut weight = 1.0;
        for other in -2_i32..=3 {
            if other != node {
                weight *= (fraction - other as f32) / (node - other) as f32;
            }
        }
        let index = (base + node).unsigned_abs() as usize;
        value += weight * samples.get(index).copied().unwrap_or(0.0);
    }
    value
}

/// R(t) tabulated at `T_p / 64` up to 4 `T_p`; linear interpolation between entries errs by at most 1.5e-4.
#[derive(Clone, Debug)]
pub struct PulseTable {
    values: [f32; ENTRIES],
    /// Table steps per sample of the frame.
    steps_per_sample: f32,
}

impl PulseTable {
    /// Tabulates `pulse` for frames sampled every `sample_spacing_s` seconds.
    pub fn new(pulse: &Pulse, sample_spacing_s: f32) -> Self {
        let mut table = Self::empty();
        table.fill(pulse, sample_spacing_s);
        table
    }

    /// No pulse: to be filled.
    pub const fn empty() -> Self {
        Self { values: [0.0; ENTRIES], steps_per_sample: 0.0 }
    }

    /// As [`Self::new`], where it stays.
    pub fn fill(&mut self, pulse: &Pulse, sample_spacing_s: f32) {
        for (step, value) in self.values.iter_mut().enumerate() {
            let is_inside = step < STEPS * SUPPORT;
            *value = if is_inside { pulse.autocorrelation(step as f32 / STEPS as f32) } else { 0.0 };
        }
        self.steps_per_sample = sample_spacing_s / pulse.duration_s * STEPS as f32;
    }

    /// R at a lag of `lag_samples` samples.
    pub fn at(&self, lag_samples: f32) -> f32 {
        let position = abs(lag_samples) * self.steps_per_sample;
        if position >= (STEPS * SUPPORT) as f32 {
            return 0.0;
        }
        // Not negative, so truncation is the floor.
        let step = position as usize;
        let fraction = position - step as f32;
        match (self.values.get(step), self.values.get(step + 1)) {
            (Some(&low), Some(&high)) => low + fraction * (high - low),
            _ => 0.0,
        }
    }

    /// Samples on either side of a path beyond which R is zero.
    pub fn support_samples(&self) -> f32 {
        (STEPS * SUPPORT) as f32 / self.steps_per_sample
    }

    /// Samples per pulse duration.
    pub fn samples_per_pulse(&self) -> f32 {
        STEPS as f32 / self.steps_per_sample
    }
}

written!(PulseTable { values, steps_per_sample });
written!(Pulse { duration_s, shape });

impl Written for PulseShape {
    fn write(&self, to: &mut impl Sink) {
        match self {
            Self::RootRaisedCosine { roll_off } => (0_u8, *roll_off).write(to),
            Self::Sampled { step_s, autocorrelation } => {
                (1_u8, *step_s).write(to);
                autocorrelation.write(to);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rms_bandwidth_and_range_deviation_match_the_published_numbers() {
        let pulse = Pulse::root_raised_cosine(0.5e-9, 0.6);
        assert!((pulse.rms_bandwidth_hz() / 633.6626e6 - 1.0).abs() < 1e-5);
        assert!((pulse.range_variance_m2(100.0).sqrt() - 5.32e-3).abs() < 5e-6);
        assert!((pulse.range_variance_m2(1.0).sqrt() - 53.2e-3).abs() < 5e-5);
    }

    #[test]
    fn the_table_follows_the_closed_form() {
        for roll_off in [0.0, 0.25, 0.5, 0.6, 1.0] {
            let pulse = Pulse::root_raised_cosine(2.0e-9, roll_off);
            let table = PulseTable::new(&pulse, 1.0016e-9);
            for i in 0..1000 {
                let lag_samples = i as f32 * 0.0075;
                let lag = f64::from(lag_samples) * 1.0016 / 2.0;
                let pi = core::f64::consts::PI;
                let b = f64::from(roll_off);
                let sinc = if lag == 0.0 { 1.0 } else { (pi * lag).sin() / (pi * lag) };
                let denominator = 1.0 - (2.0 * b * lag).powi(2);
                let taper =
                    if denominator.abs() < 1e-6 { pi / 4.0 } else { (pi * b * lag).cos() / denominator };
                let error = f64::from(table.at(lag_samples)) - sinc * taper;
                assert!(error.abs() < 3e-4, "roll-off {roll_off}, lag {lag}: {error}");
            }
        }
    }

    /// A Gaussian pulse has a Gaussian autocorrelation exp(-(t/w)^2), beta = 1 / (sqrt(2) pi w) and
    /// T_eff = w sqrt(pi/2).
    #[test]
    fn a_sampled_pulse_has_the_values_of_its_closed_form() {
        let (width_s, step_s) = (0.4e-9_f32, 0.0625e-9);
        let at = |t_s: f32| (-(t_s / width_s).powi(2)).exp();
        let shape = PulseShape::Sampled {
            step_s,
            autocorrelation: std::array::from_fn(|step| at(step as f32 * step_s)),
        };
        let pulse = Pulse { duration_s: 0.5e-9, shape };
        for i in 0..500 {
            let lag = i as f32 * 0.007;
            assert!((pulse.autocorrelation(lag) - at(lag * 0.5e-9)).abs() < 1e-5, "{lag}");
        }
        assert_eq!(pulse.autocorrelation(4.0), 0.0);
        let beta_hz = 1.0 / (2.0_f32.sqrt() * core::f32::consts::PI * width_s);
        assert!((pulse.rms_bandwidth_hz() / beta_hz - 1.0).abs() < 1e-3);
        let effective_s = width_s * (core::f32::consts::PI / 2.0).sqrt();
        assert!((pulse.effective_duration_s() / effective_s - 1.0).abs() < 1e-3);
    }

    /// What a receiver of 998.4 MHz leaves of pulses that need more: the integral over their spectrum, in f64.
    #[test]
    fn a_limited_pulse_has_the_transform_of_its_spectrum() {
        let spacing_s = 1.0 / 998.4e6_f32;
        let narrow = Pulse::root_raised_cosine(2e-9, 0.5);
        assert_eq!(narrow.sampled_every(spacing_s), narrow);
        for (duration_s, roll_off) in [(1.1e-9, 0.5), (0.75e-9, 0.6), (1.1e-9, 1.0), (1.1e-9, 0.0)] {
            let pulse = Pulse::root_raised_cosine(duration_s, roll_off).sampled_every(spacing_s);
            let pi = core::f64::consts::PI;
            let slope = |f: f64, from: f64, to: f64| match f {
                f if f <= from => 1.0,
                f if f >= to => 0.0,
                f => 0.5 + 0.5 * (pi * (f - from) / (to - from)).cos(),
            };
            let [width, b] = [f64::from(duration_s), f64::from(roll_off)];
            let power = |f: f64| {
                slope(f, 0.5 * (1.0 - b) / width, 0.5 * (1.0 + b) / width) * slope(f, 399.36e6, 499.2e6)
            };
            let integral = |weight: &dyn Fn(f64) -> f64| {
                (0..20_000).map(|n| (f64::from(n) + 0.5) * 25e3).map(|f| power(f) * weight(f)).sum::<f64>()
            };
            let energy = integral(&|_| 1.0);
            // Towards 4 the samples end.
            for step in 0..380 {
                let lag = 0.01 * step as f32;
                let lag_s = f64::from(lag) * width;
                let error = f64::from(pulse.autocorrelation(lag))
                    - integral(&|f| (2.0 * pi * f * lag_s).cos()) / energy;
                assert!(error.abs() < 2e-3, "{duration_s} {roll_off} {lag}: {error}");
            }
            let beta_hz = (integral(&|f| f * f) / energy).sqrt();
            assert!((f64::from(pulse.rms_bandwidth_hz()) / beta_hz - 1.0).abs() < 5e-3);
        }
    }

    /// The raised cosine from its samples is the raised cosine.
    #[test]
    fn a_sampled_raised_cosine_is_one() {
        for roll_off in [0.0, 0.5, 1.0] {
            let closed = Pulse::root_raised_cosine(0.5e-9, roll_off);
            let autocorrelation = std::array::from_fn(|step| closed.autocorrelation(step as f32 / 8.0));
            let shape = PulseShape::Sampled { step_s: 0.0625e-9, autocorrelation };
            let sampled = Pulse { duration_s: 0.5e-9, shape };
            for i in 0..380 {
                let lag = i as f32 * 0.01;
                let error = sampled.autocorrelation(lag) - closed.autocorrelation(lag);
                assert!(error.abs() < 1e-3, "roll-off {roll_off}, lag {lag}: {error}");
            }
            assert!((sampled.rms_bandwidth_hz() / closed.rms_bandwidth_hz() - 1.0).abs() < 2e-3);
            // A sinc has 2.5 % of its energy beyond four pulse durations.
            assert!((sampled.effective_duration_s() / closed.effective_duration_s() - 1.0).abs() < 3e-2);
        }
    }
}
