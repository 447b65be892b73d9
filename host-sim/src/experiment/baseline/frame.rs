//! A frame between its samples, and the pulse that stands in it.

use crate::channel::pulse::PulseSpectrum;
use rustfft::num_complex::Complex64;

/// Taps of the interpolation to either side, and their parameter: from the pulse's band edge at 0.4 of the sampling rate
/// to its image at 0.6 the Kaiser window of this length falls by 75 dB.
const REACH: usize = 12;
const KAISER: f64 = 7.5;
/// Steps per sample of the tables.
const KERNEL_STEPS: usize = 256;
const PULSE_STEPS: usize = 32;
/// Samples to which the pulse reaches; what is beyond is less than 1e-5 of its peak.
const PULSE_REACH: usize = 59;

/// The radio's pulse and the interpolation, tabulated once for all frames.
#[derive(Clone, Debug)]
pub(super) struct Radio {
    pub spectrum: PulseSpectrum,
    pub spacing_s: f64,
    kernel: Vec<f64>,
    pulse: Vec<f64>,
    /// Largest |R| at a lag or beyond.
    envelope: Vec<f64>,
}

impl Radio {
    /// The radio of the experiment.
    pub fn of_the_experiment() -> Self {
        let spectrum = PulseSpectrum::root_raised_cosine(
            super::super::estimator::DURATION_S,
            super::super::estimator::ROLL_OFF,
        );
        let spacing_s = super::super::estimator::SPACING_S;
        let tap = |step: usize| {
            let x = step as f64 / KERNEL_STEPS as f64;
            let turn = std::f64::consts::PI * x;
            let sinc = if step == 0 { 1.0 } else { libm::sin(turn) / turn };
            let within = (1.0 - (x / REACH as f64).powi(2)).max(0.0);
            sinc * bessel_i0(KAISER * within.sqrt()) / bessel_i0(KAISER)
        };
        let kernel = (0..=REACH * KERNEL_STEPS + 1).map(tap).collect();
        let at = |step: usize| spectrum.autocorrelation(step as f64 / PULSE_STEPS as f64 * spacing_s)[0];
        let pulse: Vec<f64> = (0..=PULSE_REACH * PULSE_STEPS + 2).map(at).collect();
        let mut envelope = pulse.clone();
        let mut largest = 0.0_f64;
        for value in envelope.iter_mut().rev() {
            largest = largest.max(value.abs());
            *value = largest;
        }
        Self { spectrum, spacing_s, kernel, pulse, envelope }
    }

    /// R at a lag in samples, by the cubic through four entries of the table (error below 1e-5).
    pub fn pulse(&self, lag: f64) -> f64 {
        let position = lag.abs() * PULSE_STEPS as f64;
        let step = position as usize;
        if step >= PULSE_REACH * PULSE_STEPS {
            return 0.0;
        }
        let t = position - step as f64;
        // R is even.
        let before = self.pulse[if step == 0 { 1 } else { step - 1 }];
        let [here, next, after] = [self.pulse[step], self.pulse[step + 1], self.pulse[step + 2]];
        let slope = 0.5 * (next - before);
        let next_slope = 0.5 * (after - here);
        let rise = next - here;
        here + t
            * (slope + t * (3.0 * rise - 2.0 * slope - next_slope + t * (slope + next_slope - 2.0 * rise)))
    }

    /// The largest |R| at this lag in samples or beyond.
    pub fn envelope(&self, lag: f64) -> f64 {
        let step = (lag.abs() * PULSE_STEPS as f64) as usize;
        self.envelope.get(step).copied().unwrap_or(0.0)
    }

    fn tap(&self, lag: f64) -> f64 {
        let position = lag.abs() * KERNEL_STEPS as f64;
        let step = position as usize;
        if step >= REACH * KERNEL_STEPS {
            return 0.0;
        }
        let t = position - step as f64;
        self.kernel[step] + t * (self.kernel[step + 1] - self.kernel[step])
    }
}

/// The modified Bessel function of order zero, by its series.
fn bessel_i0(x: f64) -> f64 {
    let quarter = 0.25 * x * x;
    let (mut term, mut sum) = (1.0, 1.0);
    for n in 1..40 {
        term *= quarter / f64::from(n * n);
        sum += term;
    }
    sum
}

/// A path under estimation: position in samples after the first, amplitude.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Component {
    pub position: f64,
    pub amplitude: Complex64,
}

/// One frame with what lies halfway between its samples.
pub(super) struct Frame<'a> {
    pub radio: &'a Radio,
    pub samples: Vec<Complex64>,
    /// The frame every half sample, so that no peak is missed by more than a quarter.
    half: Vec<Complex64>,
}

impl<'a> Frame<'a> {
    pub fn new(radio: &'a Radio, samples: &[[f32; 2]]) -> Self {
        let samples: Vec<Complex64> =
            samples.iter().map(|[re, im]| Complex64::new(f64::from(*re), f64::from(*im))).collect();
        let mut frame = Self { radio, samples, half: Vec::new() };
        let at = |n: usize| if n.is_multiple_of(2) { frame.samples[n / 2] } else { frame.at(0.5 * n as f64) };
        frame.half = (0..(2 * frame.samples.len()).saturating_sub(1)).map(at).collect();
        frame
    }

    /// The frame at a position, band-limited interpolation.
    pub fn at(&self, position: f64) -> Complex64 {
        let middle = position.floor() as i64;
        let from = (middle + 1 - REACH as i64).max(0);
        let to = (middle + REACH as i64).min(self.samples.len() as i64 - 1);
        (from..=to).map(|n| self.samples[n as usize] * self.radio.tap(position - n as f64)).sum()
    }

    /// What is left at a position when components are taken away.
    pub fn residual(&self, position: f64, components: &[Component]) -> Complex64 {
        self.at(position) - self.sum(position, components)
    }

    /// What is left every half sample.
    pub fn half_residual(&self, components: &[Component]) -> Vec<Complex64> {
        let at = |(n, value): (usize, &Complex64)| value - self.sum(0.5 * n as f64, components);
        self.half.iter().enumerate().map(at).collect()
    }

    /// Powers of what is left at the samples.
    pub fn residual_powers(&self, components: &[Component]) -> Vec<f64> {
        let at = |(n, value): (usize, &Complex64)| (value - self.sum(n as f64, components)).norm_sqr();
        self.samples.iter().enumerate().map(at).collect()
    }

    fn sum(&self, position: f64, components: &[Component]) -> Complex64 {
        components.iter().map(|one| one.amplitude * self.radio.pulse(position - one.position)).sum()
    }

    /// Whether a position lies in the frame.
    pub fn holds(&self, position: f64) -> bool {
        position >= 0.0 && position <= (self.samples.len().max(1) - 1) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_between_its_samples_is_the_pulse_itself() {
        let radio = Radio::of_the_experiment();
        let pulse = |position: f64| radio.spectrum.autocorrelation((position - 200.3) * radio.spacing_s)[0];
        let samples: Vec<[f32; 2]> = (0..400).map(|n| [pulse(f64::from(n)) as f32, 0.0]).collect();
        let frame = Frame::new(&radio, &samples);
        for n in 0..300 {
            let position = 180.0 + 0.137 * f64::from(n);
            let expected = pulse(position);
            assert!((frame.at(position).re - expected).abs() < 3e-4, "{position}");
            assert!((radio.pulse(position - 200.3) - expected).abs() < 2e-5, "{position}");
        }
    }
}
