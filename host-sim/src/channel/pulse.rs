//! The pulse in frequency: its power spectrum P(f), which is what the matched filter leaves of a path.
//!
//! P is scaled to a unit integral, so that the matched-filter output of a path of amplitude alpha peaks at alpha. A
//! root-raised-cosine pulse has the raised-cosine P; any sampled pulse has the |S(f)|^2 of its samples. What noise and
//! dense multipath of density N keep is N: white noise after the matched filter has the spectrum P; dense multipath
//! has T_eff S_nu with T_eff = int P^2 df = T_p (1 - b / 4).

use crate::scenario::Pulse;
use rustfft::num_complex::Complex64;

use super::cis;
use super::dense_multipath::ProfileTable;

/// A pulse's power spectrum around its carrier, of unit integral.
#[derive(Clone, Debug)]
pub struct PulseSpectrum {
    shape: Shape,
    duration_s: f64,
    /// Band edge, hertz from the carrier.
    half_band_hz: f64,
    /// Inverse of the integral before scaling.
    scale: f64,
    effective_duration_s: f64,
    /// R^2 times the step around zero lag, its sum T_eff.
    smear: Vec<f64>,
    /// P times the step, at the middles of equal parts of the band.
    coarse: Vec<f64>,
    /// Beyond the first of these the receiver's filter begins to cut, at the second it has: hertz from the carrier.
    receiver_hz: [f64; 2],
}

#[derive(Clone, Debug)]
enum Shape {
    RaisedCosine { roll_off: f64 },
    Sampled { spacing_s: f64, samples: Vec<[f64; 2]> },
}

/// Points of the integrals over the band.
const POINTS: usize = 4096;
/// Lags per pulse duration at which dense multipath is smeared, and how many to either side.
const SMEAR_STEPS: f64 = 4.0;
const SMEAR_REACH: i32 = 12;
/// Points of the autocorrelation: enough for lags of 30 pulse durations.
const COARSE_POINTS: usize = 128;

impl PulseSpectrum {
    /// The spectrum of `pulse` of duration `duration_s` in a receiver that samples every `sample_spacing_s`: from 0.8
    /// of half the sampling rate on it cuts what sampling could not tell apart. Pulses that are sampled well below
    /// critical spacing are not touched by that.
    pub fn new(pulse: &Pulse, duration_s: f64, sample_spacing_s: f64) -> Self {
        let nyquist_hz = 0.5 / sample_spacing_s;
        let (shape, band_hz) = match pulse {
            Pulse::RootRaisedCosine { roll_off } => {
                (Shape::RaisedCosine { roll_off: *roll_off }, (1.0 + roll_off) / (2.0 * duration_s))
            }
            Pulse::Hrp => (Shape::RaisedCosine { roll_off: 0.5 }, 1.5 / (2.0 * duration_s)),
            Pulse::Sampled { spacing_s, samples } => {
                (Shape::Sampled { spacing_s: *spacing_s, samples: samples.clone() }, 0.5 / spacing_s)
            }
        };
        let mut spectrum = Self {
            shape,
            duration_s,
            half_band_hz: band_hz.min(nyquist_hz),
            scale: 1.0,
            effective_duration_s: 0.0,
            smear: Vec::new(),
            coarse: Vec::new(),
            receiver_hz: [0.8 * nyquist_hz, nyquist_hz],
        };
        spectrum.scale = 1.0 / spectrum.integral(|_, power| power);
        spectrum.effective_duration_s = spectrum.integral(|_, power| power * power);
        let step_hz = 2.0 * spectrum.half_band_hz / COARSE_POINTS as f64;
        let middle_hz = |n: usize| -spectrum.half_band_hz + (n as f64 + 0.5) * step_hz;
        spectrum.coarse = (0..COARSE_POINTS).map(|n| spectrum.power(middle_hz(n)) * step_hz).collect();
        let squares = (-SMEAR_REACH..=SMEAR_REACH).map(|n| {
            let [r, ..] = spectrum.autocorrelation(f64::from(n) * duration_s / SMEAR_STEPS);
            r * r
        });
        let squares: Vec<f64> = squares.collect();
        let scale = spectrum.effective_duration_s / squares.iter().sum::<f64>();
        spectrum.smear = squares.into_iter().map(|square| square * scale).collect();
        spectrum
    }

    /// Root-raised-cosine of roll-off `roll_off`, sampled densely enough not to be cut.
    pub fn root_raised_cosine(duration_s: f64, roll_off: f64) -> Self {
        Self::new(&Pulse::RootRaisedCosine { roll_off }, duration_s, 0.1 * duration_s)
    }

    /// P at `offset_hz` from the carrier, 1/Hz.
    pub fn power(&self, offset_hz: f64) -> f64 {
        if offset_hz.abs() >= self.half_band_hz {
            return 0.0;
        }
        let pi = std::f64::consts::PI;
        let power = match &self.shape {
            Shape::RaisedCosine { roll_off } => {
                // Distance into the slope, 0 at its upper end and 1 at its lower.
                let edge = 0.5 / self.duration_s;
                let into = (offset_hz.abs() - (1.0 - roll_off) * edge) / (2.0 * roll_off * edge);
                if into <= 0.0 || *roll_off == 0.0 {
                    1.0
                } else {
                    0.5 * (1.0 + libm::cos(pi * into.min(1.0)))
                }
            }
            Shape::Sampled { spacing_s, samples } => {
                let turn = cis(-std::f64::consts::TAU * offset_hz * spacing_s);
                // Horner's rule.
                let sum = samples
                    .iter()
                    .rev()
                    .fold(Complex64::new(0.0, 0.0), |sum, [re, im]| sum * turn + Complex64::new(*re, *im));
                sum.norm_sqr()
            }
        };
        let [from_hz, to_hz] = self.receiver_hz;
        let cut = ((offset_hz.abs() - from_hz) / (to_hz - from_hz)).clamp(0.0, 1.0);
        self.scale * power * 0.5 * (1.0 + libm::cos(pi * cut))
    }

    /// Nominal duration T_p, seconds.
    pub fn duration_s(&self) -> f64 {
        self.duration_s
    }

    /// The band's edge, hertz from the carrier.
    pub fn half_band_hz(&self) -> f64 {
        self.half_band_hz
    }

    /// T_eff = int P^2 df, seconds: what the matched filter keeps of a flat dense multipath.
    pub fn effective_duration_s(&self) -> f64 {
        self.effective_duration_s
    }

    /// Root mean square bandwidth, hertz.
    pub fn rms_bandwidth_hz(&self) -> f64 {
        let mean = self.integral(|offset_hz, power| power * offset_hz);
        self.integral(|offset_hz, power| power * (offset_hz - mean) * (offset_hz - mean)).sqrt()
    }

    /// The pulse after the matched filter, R(t) = int P cos(2 pi f t) df at a lag, with its first two derivatives.
    pub fn autocorrelation(&self, lag_s: f64) -> [f64; 3] {
        let mut sum = [0.0; 3];
        let step_hz = 2.0 * self.half_band_hz / self.coarse.len() as f64;
        for (n, power) in self.coarse.iter().enumerate() {
            let turn = std::f64::consts::TAU * (-self.half_band_hz + (n as f64 + 0.5) * step_hz);
            let (sin, cos) = libm::sincos(turn * lag_s);
            sum[0] += power * cos;
            sum[1] -= power * turn * sin;
            sum[2] -= power * turn * turn * cos;
        }
        sum
    }

    /// The pulse as it is sent, of linear phase: int sqrt(P) cos(2 pi f t) df at a time from its middle, within 40 pulse durations.
    pub fn transmitted(&self, time_s: f64) -> f64 {
        let step_hz = 2.0 * self.half_band_hz / self.coarse.len() as f64;
        let at = |(n, power): (usize, &f64)| {
            let offset_hz = -self.half_band_hz + (n as f64 + 0.5) * step_hz;
            (power * step_hz).sqrt() * libm::cos(std::f64::consts::TAU * offset_hz * time_s)
        };
        self.coarse.iter().enumerate().map(at).sum()
    }

    /// What the matched filter keeps of a profile at `excess_s` after its onset: int S(t - u) R^2(u) du.
    pub fn smeared(&self, profile: &ProfileTable, excess_s: f64) -> f64 {
        let step_s = self.duration_s / SMEAR_STEPS;
        let at = |(n, weight): (usize, &f64)| {
            let lag_s = (n as f64 - (self.smear.len() / 2) as f64) * step_s;
            weight * profile.density(excess_s - lag_s)
        };
        self.smear.iter().enumerate().map(at).sum()
    }

    /// Share of what `other`, `distance_hz` away, sends that this pulse's matched filter keeps, over what it would
    /// keep of its own kind at no distance: int P Q(f - D) df / int P^2 df.
    pub fn overlap(&self, other: &Self, distance_hz: f64) -> f64 {
        self.integral(|offset_hz, power| power * other.power(offset_hz - distance_hz))
            / self.effective_duration_s()
    }

    /// Midpoint rule over the band, which for smooth spectra that end in zero is far better than its order.
    fn integral(&self, integrand: impl Fn(f64, f64) -> f64) -> f64 {
        let step = 2.0 * self.half_band_hz / POINTS as f64;
        let at = |n: usize| -self.half_band_hz + (n as f64 + 0.5) * step;
        (0..POINTS).map(|n| integrand(at(n), self.power(at(n)))).sum::<f64>() * step
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bandwidth_and_effective_duration_are_the_golden_numbers() {
        let pulse = PulseSpectrum::root_raised_cosine(0.5e-9, 0.6);
        assert!((pulse.rms_bandwidth_hz() / 633.6626e6 - 1.0).abs() < 1e-7, "{}", pulse.rms_bandwidth_hz());
        assert!((pulse.effective_duration_s() / 0.425e-9 - 1.0).abs() < 1e-7);
        for (roll_off, product) in [(0.25, 0.29376), (0.5, 0.30850), (1.0, 0.36151)] {
            let beta_hz = PulseSpectrum::root_raised_cosine(2e-9, roll_off).rms_bandwidth_hz();
            assert!((beta_hz * 2e-9 - product).abs() < 1e-5, "{roll_off}: {beta_hz}");
        }
    }

    #[test]
    fn the_overlap_with_an_interferer_is_the_golden_numbers() {
        let pulse = PulseSpectrum::root_raised_cosine(0.5e-9, 0.6);
        assert!((pulse.overlap(&pulse, 1e9) - 0.5882).abs() < 5e-5);
        assert!((pulse.overlap(&pulse, 2e9) - 0.0882).abs() < 5e-5);
        let table = [(0.25, -0.16), (0.5, -0.63), (0.75, -1.35), (1.25, -3.54), (1.5, -5.19), (2.5, -20.8)];
        for (distance_ghz, expected_db) in table {
            let db = 10.0 * pulse.overlap(&pulse, distance_ghz * 1e9).log10();
            assert!((db - expected_db).abs() < 0.06, "{distance_ghz} GHz: {db}");
        }
    }

    /// The samples are taken from the closed form of the pulse in time.
    #[test]
    fn a_sampled_root_raised_cosine_has_the_raised_cosine_spectrum() {
        let (duration_s, roll_off) = (2e-9, 0.5);
        let spacing_s = 0.25e-9;
        let pi = std::f64::consts::PI;
        let at = |t: f64| {
            let x = t / duration_s;
            if x.abs() < 1e-12 {
                return 1.0 + roll_off * (4.0 / pi - 1.0);
            }
            let pole = 1.0 - (4.0 * roll_off * x).powi(2);
            if pole.abs() < 1e-9 {
                let (s, c) = (pi / (4.0 * roll_off)).sin_cos();
                return roll_off / 2f64.sqrt() * ((1.0 + 2.0 / pi) * s + (1.0 - 2.0 / pi) * c);
            }
            ((pi * x * (1.0 - roll_off)).sin() + 4.0 * roll_off * x * (pi * x * (1.0 + roll_off)).cos())
                / (pi * x * pole)
        };
        let samples = (-400..=400).map(|n| [at(f64::from(n) * spacing_s) * 37.0, 0.0]).collect();
        let sampled = PulseSpectrum::new(&Pulse::Sampled { spacing_s, samples }, duration_s, 0.1e-9);
        let closed = PulseSpectrum::root_raised_cosine(duration_s, roll_off);
        for n in -40..=40 {
            let offset_hz = f64::from(n) * 1e7;
            let error = (sampled.power(offset_hz) - closed.power(offset_hz)) / closed.power(0.0);
            assert!(error.abs() < 2e-4, "{offset_hz}: {error}");
        }
    }

    #[test]
    fn the_autocorrelation_is_the_raised_cosine_pulse_with_its_bandwidth_as_curvature() {
        let pulse = PulseSpectrum::root_raised_cosine(0.5e-9, 0.6);
        let pi = std::f64::consts::PI;
        for n in 0..12 {
            let x = 0.37 * f64::from(n) + 1e-9;
            let expected = (pi * x).sin() / (pi * x) * (pi * 0.6 * x).cos() / (1.0 - (1.2 * x).powi(2));
            assert!((pulse.autocorrelation(x * 0.5e-9)[0] - expected).abs() < 1e-4, "{x}");
        }
        let [one, flat, bend] = pulse.autocorrelation(0.0);
        assert!((one - 1.0).abs() < 1e-4 && flat.abs() < 1.0);
        assert!((bend / -(std::f64::consts::TAU * 633.6626e6).powi(2) - 1.0).abs() < 1e-3);
    }

    #[test]
    fn a_receiver_cuts_what_its_sampling_cannot_tell_apart() {
        let spacing_s = 1.0 / 998.4e6;
        let wide = PulseSpectrum::new(&Pulse::Hrp, 1.1e-9, spacing_s);
        assert!(wide.half_band_hz() <= 0.5 / spacing_s);
        assert!((wide.integral(|_, power| power) - 1.0).abs() < 1e-12);
        let narrow = PulseSpectrum::new(&Pulse::Hrp, 2e-9, spacing_s);
        let uncut = PulseSpectrum::root_raised_cosine(2e-9, 0.5);
        assert!((narrow.power(1.3e8) - uncut.power(1.3e8)).abs() < 1e-15);
    }
}
