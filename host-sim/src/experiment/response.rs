//! Single channel responses with known paths: what the channel estimator is measured on.
//!
//! Samples leave the matched filter in standard deviations of the white noise. Dense multipath is drawn anew for
//! every response, with its power given by the soft-onset profile from an onset of its own.

use crate::channel::dense_multipath::{ProfileTable, Scatterers, View};
use crate::channel::lattice::{Lattice, Scratch};
use crate::channel::pulse::PulseSpectrum;
use crate::channel::random::complex_normal;
use crate::scenario::Profile;
use rand_core::Rng;
use rustfft::num_complex::Complex64;

/// Scatterers per pulse duration.
const SCATTERERS_PER_PULSE: f64 = 8.0;

/// A path of a response.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TruePath {
    /// Delay after the first sample, seconds.
    pub delay_s: f64,
    /// Amplitude after the matched filter.
    pub amplitude: Complex64,
}

/// Dense multipath of a response.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dense {
    /// Total power Omega over the white noise.
    pub omega: f64,
    /// Where it begins after the first sample, seconds.
    pub onset_s: f64,
}

/// Makes responses of one pulse.
pub struct ResponseMaker {
    lattice: Lattice,
    pulse: PulseSpectrum,
    /// P times the lattice step, and the offset of each point from the carrier, hertz.
    band: Vec<(f64, f64)>,
    first: i64,
    profile: Profile,
    table: ProfileTable,
    span_s: f64,
    scratch: Scratch,
}

impl ResponseMaker {
    /// Responses of `samples` samples, `spacing_s` apart.
    pub fn new(pulse: PulseSpectrum, samples: usize, spacing_s: f64) -> Self {
        let lattice = Lattice::new(samples, spacing_s, pulse.duration_s());
        let last = lattice.nearest(pulse.half_band_hz());
        let band = (-last..=last).map(|point| {
            let offset_hz = lattice.frequency_hz(point);
            (pulse.power(offset_hz) * lattice.step_hz(), offset_hz)
        });
        let profile = Profile::default();
        Self {
            band: band.collect(),
            first: -last,
            lattice,
            pulse,
            table: ProfileTable::new(&profile),
            profile,
            span_s: samples as f64 * spacing_s,
            scratch: Scratch::default(),
        }
    }

    /// Level of noise and dense multipath after the matched filter at a delay, over the white noise.
    pub fn level(&self, dense: Option<Dense>, delay_s: f64) -> f64 {
        let dense = dense.map_or(0.0, |dense| dense.omega * self.profile.density(delay_s - dense.onset_s));
        1.0 + dense * self.pulse.effective_duration_s()
    }

    /// One response.
    pub fn draw(&mut self, rng: &mut impl Rng, paths: &[TruePath], dense: Option<Dense>) -> Vec<[f32; 2]> {
        let mut total: Vec<Complex64> =
            self.band.iter().map(|(pulse, _)| complex_normal(rng) * pulse.sqrt()).collect();
        for path in paths {
            for (value, (pulse, offset_hz)) in total.iter_mut().zip(&self.band) {
                let turn = crate::channel::cis(-std::f64::consts::TAU * offset_hz * path.delay_s);
                *value += path.amplitude * turn * *pulse;
            }
        }
        if let Some(dense) = dense {
            let per_second = SCATTERERS_PER_PULSE / self.pulse.duration_s();
            let interval_s = [dense.onset_s, dense.onset_s.max(self.span_s * 1.1)];
            let scatterers = Scatterers::new(rng, [0.0; 2], interval_s, per_second);
            let view = View {
                position_m: [0.0; 2],
                onset_s: dense.onset_s,
                first_sample_s: 0.0,
                centre_hz: 0.0,
                carrier_hz: 0.0,
            };
            self.lattice.begin_spread(&mut self.scratch);
            scatterers.spread(&self.lattice, &mut self.scratch, &view, dense.omega, &self.table);
            let weight = |n: usize| self.band[n].0;
            self.lattice.gather(&mut self.scratch, self.first, 0, &mut total, weight);
        }
        let samples = self.lattice.samples(&mut self.scratch, self.first, 0, 0.0, &total);
        samples.iter().map(|sample| [sample.re as f32, sample.im as f32]).collect()
    }
}
