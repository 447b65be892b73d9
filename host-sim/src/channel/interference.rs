//! Interferers: dense multipath limited to a band and to a part of the way.
//!
//! What an interferer of spectrum Q at f_i sends arrives as the dense multipath of its own profile, weighted with
//! sqrt(Q(f - f_i)), and passes the receiver's matched filter sqrt(P(f - f_c)): power Omega_1 S(t) int P Q df.

use super::dense_multipath::{ProfileTable, Scatterers, View};
use super::lattice::Scratch;
use super::pulse::PulseSpectrum;
use super::{Band, Channel};
use crate::input_error::InputError;
use crate::scenario::{Fading, Profile, Strength};
use rustfft::num_complex::Complex64;
use std::ops::Range;

/// Cycles that a strength stated as a median SINR is worked out from, at most.
const SAMPLED_CYCLES: usize = 200;

/// SINR from which on a path counts as used: where visibility begins (4.8 dB).
const USED_SINR: f64 = 3.0;

/// A path that an interferer is to weaken.
struct UsedPath {
    power: f64,
    /// Everything else that disturbs it.
    disturbance: f64,
    /// Disturbance per total power of the interferer.
    share: f64,
}

/// Median SINR of paths beside an interferer of total power `omega`; zero where there is no path.
fn median_sinr(paths: &[UsedPath], omega: f64) -> f64 {
    let sinr = |path: &UsedPath| path.power / (path.disturbance + omega * path.share);
    let mut values: Vec<f64> = paths.iter().map(sinr).collect();
    if values.is_empty() {
        return 0.0;
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// The total power that leaves a median SINR of `sinr`: bisection on its logarithm.
fn omega_for(paths: &[UsedPath], sinr: f64) -> f64 {
    // Up to 130 dB over the white noise: beyond, hardly any of it reaches the paths.
    let (mut low, mut high) = (-30.0, 30.0);
    for _ in 0..80 {
        let middle = 0.5 * (low + high);
        if median_sinr(paths, libm::exp(middle)) > sinr { low = middle } else { high = middle }
    }
    libm::exp(0.5 * (low + high))
}

/// An interferer with its strength worked out.
pub(super) struct Interferer {
    /// Total power over the white noise.
    pub(super) omega: f64,
    carrier_hz: f64,
    spectrum: PulseSpectrum,
    profile: Profile,
    table: ProfileTable,
    onset_s: f64,
    cycles: Range<usize>,
    /// int P Q df, seconds, per action: what its receiver keeps.
    pub(super) received_s: Vec<f64>,
    /// Whether it reaches each anchor.
    reaches: Vec<bool>,
    /// Per anchor, unless drawn anew for every frame.
    scatterers: Vec<Scatterers>,
}

impl Interferer {
    /// The interferer `index` of the channel's scenario, in the channel with all interferers before it.
    ///
    /// # Errors
    /// The SINR that it is to leave is not there without it.
    pub(super) fn new(channel: &Channel, index: usize) -> Result<Self, InputError> {
        let wanted = &channel.scenario.interference[index];
        let anchors = &channel.scenario.anchors;
        let spectrum = PulseSpectrum::root_raised_cosine(wanted.pulse_duration_s, wanted.roll_off);
        let received_s = |band: &Band| {
            let distance_hz = band.carrier_hz - wanted.carrier_hz;
            band.spectrum.overlap(&spectrum, distance_hz) * band.spectrum.effective_duration_s()
        };
        let mut interferer = Self {
            omega: 0.0,
            received_s: channel.bands.iter().map(received_s).collect(),
            carrier_hz: wanted.carrier_hz,
            spectrum,
            profile: wanted.profile,
            table: ProfileTable::new(&wanted.profile),
            onset_s: wanted.onset_s,
            cycles: channel.cycles_of(wanted.during),
            reaches: anchors
                .iter()
                .map(|anchor| wanted.anchors.is_empty() || wanted.anchors.contains(&anchor.name))
                .collect(),
            scatterers: Vec::new(),
        };
        if wanted.fading == Fading::Correlated {
            interferer.scatterers =
                (0..anchors.len()).map(|anchor| interferer.drawn(channel, &[anchor, index + 1])).collect();
        }
        interferer.omega = match wanted.strength {
            Strength::Omega1(gain) => gain / super::friis(1.0, super::REFERENCE_HZ) * channel.snr_at_1_m(),
            Strength::MedianSinrDb(db) => {
                let paths = interferer.used_paths(channel);
                let clean_db = 10.0 * libm::log10(median_sinr(&paths, 0.0));
                if paths.is_empty() || clean_db <= db {
                    let reason = if paths.is_empty() {
                        format!("is {db}, but no path is in use on the interferer's part of the way")
                    } else {
                        format!("is {db}, but without the interferer it is {clean_db:.1} already")
                    };
                    let key = format!("interference.{index}.strength.median_sinr_db");
                    return Err(InputError::new(&channel.scenario.name, reason).for_item(key));
                }
                let omega = omega_for(&paths, super::power_of(db));
                let left_db = 10.0 * libm::log10(median_sinr(&paths, omega));
                if !((left_db - db).abs() < 0.1) {
                    let reason = format!("is {db}, but it hardly reaches the paths: no strength leaves that");
                    let key = format!("interference.{index}.strength.median_sinr_db");
                    return Err(InputError::new(&channel.scenario.name, reason).for_item(key));
                }
                omega
            }
        };
        Ok(interferer)
    }

    fn drawn(&self, channel: &Channel, stream: &[usize]) -> Scatterers {
        channel.scatterers(stream, self.profile.length_s(), self.onset_s)
    }

    /// Power density over the delay, 1/s, at `excess_s` after the direct path, as a pulse smears it.
    pub(super) fn power(&self, anchor: usize, cycle: usize, excess_s: f64, pulse: &PulseSpectrum) -> f64 {
        if self.cycles.contains(&cycle) && self.reaches[anchor] {
            self.omega * self.smeared(pulse, excess_s)
        } else {
            0.0
        }
    }

    fn smeared(&self, pulse: &PulseSpectrum, excess_s: f64) -> f64 {
        pulse.smeared(&self.table, excess_s - self.onset_s) / pulse.effective_duration_s()
    }

    /// The paths that a tracker would use on the interferer's part of the way, at the library's entry nearest to its
    /// carrier: those that are visible by their SINR without it.
    fn used_paths(&self, channel: &Channel) -> Vec<UsedPath> {
        let distance = |band: &Band| (band.carrier_hz - self.carrier_hz).abs();
        let bands = &channel.bands;
        let nearest = (0..bands.len()).min_by(|&a, &b| distance(&bands[a]).total_cmp(&distance(&bands[b])));
        let action = nearest.unwrap_or(0);
        let step = self.cycles.len().div_ceil(SAMPLED_CYCLES).max(1);
        let mut paths = Vec::new();
        for cycle in self.cycles.clone().step_by(step) {
            for anchor in (0..self.reaches.len()).filter(|&anchor| self.reaches[anchor]) {
                let direct_s = channel.direct_delay_s(cycle, anchor);
                let components = channel.components(cycle, anchor, action);
                for component in components.into_iter().filter(|component| component.sinr >= USED_SINR) {
                    let power = component.amplitude.norm_sqr();
                    let density = self.smeared(&bands[action].spectrum, component.delay_s - direct_s);
                    paths.push(UsedPath {
                        power,
                        disturbance: power / component.sinr,
                        share: density * self.received_s[action],
                    });
                }
            }
        }
        paths
    }

    /// Adds what a band receives of it.
    #[allow(clippy::too_many_arguments, reason = "the frame's own indexes and buffers")]
    pub(super) fn add(
        &self,
        channel: &Channel,
        index: usize,
        cycle: usize,
        anchor: usize,
        band: &Band,
        view: &View,
        scratch: &mut Scratch,
        total: &mut [Complex64],
    ) {
        if !self.cycles.contains(&cycle) || !self.reaches[anchor] || self.omega == 0.0 {
            return;
        }
        let view = View { onset_s: view.onset_s + self.onset_s, ..*view };
        channel.lattice.begin_spread(scratch);
        match self.scatterers.get(anchor) {
            Some(scatterers) => {
                scatterers.spread(&channel.lattice, scratch, &view, self.omega, &self.table);
            }
            None => self.drawn(channel, &[anchor, index + 1, channel.trajectory, cycle]).spread(
                &channel.lattice,
                scratch,
                &view,
                self.omega,
                &self.table,
            ),
        }
        let step_hz = channel.lattice.step_hz();
        let weight = |n: usize| {
            let frequency_hz = channel.lattice.frequency_hz(band.first + n as i64);
            let sent = self.spectrum.power(frequency_hz - self.carrier_hz) * step_hz;
            (sent * band.pulse[n]).sqrt()
        };
        channel.lattice.gather(scratch, band.first, band.centre, total, weight);
    }
}
