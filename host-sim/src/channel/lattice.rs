//! The lattice of frequencies on which channels are put together, and the way from there to samples.
//!
//! Frequencies are whole multiples of the step 1 / (N T_s), the same for all carriers: what a wall does at one of them
//! is computed once. A frame is the inverse Fourier transform of N lattice points around its carrier, turned by what
//! the carrier lies off the lattice. N exceeds the frame's samples, so that what wraps round falls outside of it.
//!
//! Thousands of scatterers go onto the lattice at once: each is spread over a few cells of a delay grid twice as fine
//! as the samples, by the kernel exp(beta (sqrt(1 - x^2) - 1)); one transform and a division by the kernel's
//! own transform give the sum of their phasors on all lattice points to about 1e-5 (a non-uniform Fourier transform).

use rustfft::num_complex::Complex64;
use rustfft::{Fft, FftPlannerScalar};
use std::sync::Arc;

use super::cis;

/// Pulse durations that a period is longer than the frame, at least.
const GUARD_PULSES: f64 = 16.0;
/// Cells on either side of a scatterer.
const REACH: usize = 3;
/// Sharpness of the kernel for cells half a sample wide.
const BETA: f64 = 2.3 * (2 * REACH) as f64;
/// Places within a cell at which the kernel is tabulated.
const TABLE_STEPS: usize = 512;

/// Frequencies, and transforms between them and delays.
pub struct Lattice {
    /// Samples of a frame.
    samples: usize,
    spacing_s: f64,
    /// Lattice points of one period.
    length: usize,
    inverse: Arc<dyn Fft<f64>>,
    spread: Arc<dyn Fft<f64>>,
    /// Per place within a cell: the kernel at all cells in reach.
    kernel: Vec<[f64; 2 * REACH]>,
    /// One over the kernel's transform, for lattice offsets from 0 to half the period.
    correction: Vec<f64>,
}

/// Buffers of one thread; what they hold between calls does not matter.
#[derive(Default)]
pub struct Scratch {
    cells: Vec<Complex64>,
    period: Vec<Complex64>,
    fft: Vec<Complex64>,
}

impl Lattice {
    /// A lattice for frames of `samples` samples, `spacing_s` apart, and pulses of `duration_s` at most.
    pub fn new(samples: usize, spacing_s: f64, duration_s: f64) -> Self {
        // Room for the pulses of paths just outside the frame: they must not come in again at its other end.
        let pulses = (GUARD_PULSES * duration_s / spacing_s).ceil() as usize;
        let least = samples + (samples / 8).max(64).max(pulses);
        let length = [1, 3, 5]
            .into_iter()
            .map(|odd| odd * (least.div_ceil(odd)).next_power_of_two())
            .min()
            .unwrap_or(least);
        let mut planner: FftPlannerScalar<f64> = FftPlannerScalar::new();
        let inverse = planner.plan_fft_inverse(length);
        let spread = planner.plan_fft_forward(2 * length);
        let at = |row: usize, cell: usize| {
            let place = row as f64 / TABLE_STEPS as f64 + (REACH - 1) as f64;
            kernel((place - cell as f64).abs() / REACH as f64)
        };
        let kernel = (0..=TABLE_STEPS).map(|row| std::array::from_fn(|cell| at(row, cell))).collect();
        let correction = (0..=length / 2).map(|k| 1.0 / kernel_transform(k as f64 / (2 * length) as f64));
        let correction = correction.collect();
        Self { samples, spacing_s, length, inverse, spread, kernel, correction }
    }

    /// Step between two lattice points, hertz.
    pub fn step_hz(&self) -> f64 {
        1.0 / (self.length as f64 * self.spacing_s)
    }

    /// The lattice point nearest to a frequency.
    pub fn nearest(&self, frequency_hz: f64) -> i64 {
        libm::round(frequency_hz / self.step_hz()) as i64
    }

    /// Frequency of a lattice point, hertz.
    pub fn frequency_hz(&self, point: i64) -> f64 {
        point as f64 * self.step_hz()
    }

    /// Delays after the first sample between which a path leaves anything in the frame, seconds.
    pub fn reach_s(&self) -> [f64; 2] {
        let guard = 0.5 * (self.length - self.samples) as f64;
        [-guard * self.spacing_s, (self.samples as f64 + guard) * self.spacing_s]
    }

    /// Most lattice points that a band can have.
    pub fn widest_band(&self) -> usize {
        self.length
    }

    /// Clears the delay grid.
    pub fn begin_spread(&self, scratch: &mut Scratch) {
        scratch.cells.clear();
        scratch.cells.resize(2 * self.length, Complex64::new(0.0, 0.0));
    }

    /// Puts a scatterer of this amplitude, `delay_s` after the first sample, onto the delay grid.
    pub fn spread(&self, scratch: &mut Scratch, delay_s: f64, amplitude: Complex64) {
        let cells = 2 * self.length;
        let place = delay_s / self.spacing_s * 2.0;
        let whole = libm::floor(place);
        let step = (place - whole) * TABLE_STEPS as f64;
        let row = (step as usize).min(TABLE_STEPS - 1);
        let share = step - row as f64;
        let weights = self.kernel[row].iter().zip(&self.kernel[row + 1]);
        let weights = weights.map(|(low, high)| low + (high - low) * share);
        let first = (whole as i64 - (REACH as i64 - 1)).rem_euclid(cells as i64) as usize;
        match scratch.cells.get_mut(first..first + 2 * REACH) {
            Some(reached) => {
                reached.iter_mut().zip(weights).for_each(|(cell, weight)| *cell += amplitude * weight);
            }
            None => weights
                .enumerate()
                .for_each(|(n, weight)| scratch.cells[(first + n) % cells] += amplitude * weight),
        }
    }

    /// Adds what was spread, as it is on the lattice points around `centre` that the band `first..` of `into` covers:
    /// entry n is the point `first + n`, multiplied by `weight(n)`.
    pub fn gather(
        &self,
        scratch: &mut Scratch,
        first: i64,
        centre: i64,
        into: &mut [Complex64],
        weight: impl Fn(usize) -> f64,
    ) {
        scratch.fft.resize(self.spread.get_inplace_scratch_len(), Complex64::new(0.0, 0.0));
        self.spread.process_with_scratch(&mut scratch.cells, &mut scratch.fft);
        let cells = scratch.cells.len() as i64;
        for (n, value) in into.iter_mut().enumerate() {
            let offset = first + n as i64 - centre;
            let correction = self.correction.get(offset.unsigned_abs() as usize).copied().unwrap_or(0.0);
            *value += scratch.cells[offset.rem_euclid(cells) as usize] * (correction * weight(n));
        }
    }

    /// The samples of a band: sum over its points of `band[n]` e^(j 2 pi (f - carrier) t) at t = 0, T_s, 2 T_s, ...
    pub fn samples(
        &self,
        scratch: &mut Scratch,
        first: i64,
        centre: i64,
        carrier_hz: f64,
        band: &[Complex64],
    ) -> Vec<Complex64> {
        scratch.period.clear();
        scratch.period.resize(self.length, Complex64::new(0.0, 0.0));
        for (n, value) in band.iter().enumerate() {
            let place = (first + n as i64 - centre).rem_euclid(self.length as i64) as usize;
            scratch.period[place] += value;
        }
        scratch.fft.resize(self.inverse.get_inplace_scratch_len(), Complex64::new(0.0, 0.0));
        self.inverse.process_with_scratch(&mut scratch.period, &mut scratch.fft);
        let turns = (self.frequency_hz(centre) - carrier_hz) * self.spacing_s;
        let turn = cis(std::f64::consts::TAU * turns);
        let mut phase = Complex64::new(1.0, 0.0);
        scratch.period[..self.samples]
            .iter()
            .map(|value| {
                let turned = value * phase;
                phase *= turn;
                turned
            })
            .collect()
    }
}

/// The spreading kernel at x from 0 (the scatterer) to 1 (the end of its reach).
fn kernel(x: f64) -> f64 {
    if x >= 1.0 { 0.0 } else { libm::exp(BETA * ((1.0 - x * x).sqrt() - 1.0)) }
}

/// Transform of the kernel at `frequency` in cycles per cell; Gauss's substitution x = sin makes the integrand smooth.
fn kernel_transform(frequency: f64) -> f64 {
    let points = 400;
    let step = std::f64::consts::PI / f64::from(points);
    let angle = |n: u32| (f64::from(n) + 0.5) * step - std::f64::consts::FRAC_PI_2;
    (0..points)
        .map(|n| {
            let (sine, cosine) = libm::sincos(angle(n));
            let turn = libm::cos(std::f64::consts::TAU * frequency * REACH as f64 * sine);
            kernel(sine.abs()) * cosine * turn
        })
        .sum::<f64>()
        * step
        * REACH as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spread_scatterers_are_the_sum_of_their_phasors() {
        let lattice = Lattice::new(400, 0.25e-9, 0.5e-9);
        let mut scratch = Scratch::default();
        lattice.begin_spread(&mut scratch);
        let scatterers: Vec<(f64, Complex64)> = (0..50)
            .map(|n| {
                let n = f64::from(n);
                (1e-9 * (1.7 * n - 5.0), Complex64::new((n * 0.7).cos(), (n * 1.3).sin()))
            })
            .collect();
        for (delay_s, amplitude) in &scatterers {
            lattice.spread(&mut scratch, *delay_s, *amplitude);
        }
        let centre = 900;
        let mut band = vec![Complex64::new(0.0, 0.0); 411];
        lattice.gather(&mut scratch, centre - 205, centre, &mut band, |_| 1.0);
        for (n, value) in band.iter().enumerate() {
            let offset_hz = (n as f64 - 205.0) * lattice.step_hz();
            let exact: Complex64 = scatterers
                .iter()
                .map(|(delay_s, amplitude)| amplitude * cis(-std::f64::consts::TAU * offset_hz * delay_s))
                .sum();
            assert!((value - exact).norm() < 1e-4 * 7.0, "{n}: {value} {exact}");
        }
    }

    #[test]
    fn samples_are_the_sum_over_the_band_also_off_the_lattice() {
        let lattice = Lattice::new(100, 1e-9, 2e-9);
        let mut scratch = Scratch::default();
        let carrier_hz = 6.4896e9;
        let centre = lattice.nearest(carrier_hz);
        let band: Vec<Complex64> =
            (0..61).map(|n| Complex64::new(f64::from(n).sin(), f64::from(n * n).cos())).collect();
        let first = centre - 30;
        let samples = lattice.samples(&mut scratch, first, centre, carrier_hz, &band);
        assert_eq!(samples.len(), 100);
        for n in [0, 1, 57, 99] {
            let t = n as f64 * 1e-9;
            let exact: Complex64 = band
                .iter()
                .enumerate()
                .map(|(k, value)| {
                    let offset_hz = lattice.frequency_hz(first + k as i64) - carrier_hz;
                    value * cis(std::f64::consts::TAU * offset_hz * t)
                })
                .sum();
            assert!((samples[n] - exact).norm() < 1e-9, "{n}: {} {exact}", samples[n]);
        }
    }
}
