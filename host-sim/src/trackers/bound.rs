//! Bounds along the true way: what the frames allow, and what the detected paths do. No tracker enters into either.
//!
//! Both are posterior Cramer-Rao bounds in the state of `map` (tag, biases, walls or virtual anchors with
//! the deviations told, motion and start prior as told), by the Kalman recursion of the covariance with all ranges
//! linearised at the truth (Tichavsky, Muravchik, Nehorai 1998, as [`crate::bound::posterior`]).
//!
//! **Frames.** Every true path of a frame that arrived counts, detected or not. A path's amplitude is random and
//! unknown, of the mean power that its SINR s says; of a path alone the information about its delay is then
//! 8 pi^2 beta^2 s^2 / (1 + s) instead of 8 pi^2 beta^2 s. Overlap: with G_kl = R(tau_k - tau_l) and
//! D_kl = R'(tau_k - tau_l), what the other amplitudes, each with the prior of its power, hide is taken off, in the
//! mean over their phases:
//!
//! E_kk = 2 s_k^2 / (1 + s_k) (-R''(0) - (D (G + 1/s)^-1 D')_kk), E_kl = 0.
//!
//! Virtual anchors that are not told have their walls' deviations where the plan has those walls, and else that of the
//! longest range.
//!
//! **Detected.** The labelled paths of the scans whose source is told, with the noise that [`super::told`] gives them.

use super::gaussian::Gaussian;
use super::map::{Map, Wanted};
use super::{CycleScans, Source, rise_m, told};
use crate::recording::{Cycle, Recording};
use crate::replay::Setup;
use cogmint_core::radio::pulse::Pulse;
use cogmint_core::real::SPEED_OF_LIGHT_M_S;
use rayon::prelude::*;

/// Weaker true paths tell nothing, and hide nothing.
const LEAST_SINR: f64 = 1e-2;
/// Paths further apart than this many pulse durations do not overlap.
const REACH: f64 = 30.0;
/// Steps of the derivative of R, pulse durations.
const STEP: f32 = 0.05;
/// At most this many virtual anchors of which nothing is told, those whose paths tell most: the others are rarely seen.
const MOST_UNKNOWN: usize = 30;
/// A cycle is answered below this deviation, metres, and a run in this share of its cycles.
const ANSWERED_M: f64 = 0.3;
const ANSWERED_SHARE: f64 = 0.9;

/// What a source's path in a cycle is worth.
#[derive(Clone, Copy, Debug)]
struct Worth {
    anchor: usize,
    source: Source,
    /// Variance of its length, square metres.
    variance_m2: f64,
}

/// What the frames allow: per cycle the least rms position error, metres; empty where the truth is unknown.
pub fn frames(recording: &Recording, setup: &Setup, cycles: &[CycleScans]) -> Vec<f64> {
    let pulses: Vec<Pulse> = setup.actions.iter().map(|action| setup.config.radio.pulse(action)).collect();
    let worth: Vec<Vec<Worth>> = recording.cycles.par_iter().map(|cycle| all_paths(cycle, &pulses)).collect();
    if worth.iter().all(Vec::is_empty) {
        return Vec::new();
    }
    let mut told_of = vec![0.0; recording.virtual_anchors.len()];
    for worth in worth.iter().flatten() {
        if let Source::Virtual(index) = worth.source {
            told_of[index] += 1.0 / worth.variance_m2;
        }
    }
    let walls_of = |index: usize| !recording.virtual_anchors[index].walls.is_empty();
    let told = |index: usize| recording.virtual_anchors[index].known && setup.tells_images();
    let mut unknown: Vec<usize> = (0..told_of.len()).filter(|&n| !told(n) && !walls_of(n)).collect();
    unknown.sort_by(|&a, &b| told_of[b].total_cmp(&told_of[a]));
    unknown.truncate(MOST_UNKNOWN);
    let std_m = f64::from(setup.config.ranging.max_range_m);
    let map = Map::new(recording, setup, |index| {
        if told(index) {
            Some(Wanted::Told)
        } else if told_of[index] > 0.0 && (walls_of(index) || unknown.contains(&index)) {
            Some(Wanted::Unknown { std_m })
        } else {
            None
        }
    });
    recursion(recording, setup, cycles, &map, &worth)
}

/// The same from the labelled paths that were detected, of the sources that a tracker is told.
pub fn detected(recording: &Recording, setup: &Setup, cycles: &[CycleScans]) -> Vec<f64> {
    let map = Map::told(recording, setup);
    let worth: Vec<Vec<Worth>> = cycles
        .iter()
        .map(|cycle| {
            let of_scan = |scan: &super::Scan| -> Vec<Worth> {
                let labelled = scan.paths.iter().enumerate();
                let worth = labelled.filter_map(|(index, path)| {
                    let information: f64 =
                        told::noise(scan, index).iter().map(|(share, variance_m2)| share / variance_m2).sum();
                    let variance_m2 = 1.0 / information;
                    Some(Worth { anchor: scan.anchor, source: path.source?, variance_m2 })
                });
                worth.collect()
            };
            cycle.scans.iter().flat_map(of_scan).collect()
        })
        .collect();
    recursion(recording, setup, cycles, &map, &worth)
}

/// Whether a run can be answered: the bound of [`detected`] is below 0.3 m in 90 % of its cycles.
pub fn answerable(detected_m: &[f64]) -> bool {
    let answered = detected_m.iter().filter(|deviation_m| **deviation_m < ANSWERED_M).count();
    !detected_m.is_empty() && answered as f64 >= ANSWERED_SHARE * detected_m.len() as f64
}

/// The Kalman recursion along the true way; empty where no true position is known.
fn recursion(
    recording: &Recording,
    setup: &Setup,
    cycles: &[CycleScans],
    map: &Map,
    worth: &[Vec<Worth>],
) -> Vec<f64> {
    let Some(first) = recording.cycles.iter().find_map(|cycle| cycle.truth_position_m) else {
        return Vec::new();
    };
    let mut gaussian = Gaussian::prior(map);
    let mut truth = first;
    let mut bounds_m = Vec::with_capacity(cycles.len());
    for ((cycle, known), worth) in cycles.iter().zip(&recording.cycles).zip(worth) {
        gaussian.predict(cycle.elapsed_s, map.acceleration_density);
        truth = known.truth_position_m.unwrap_or(truth);
        let mut state = vec![0.0; map.states()];
        state[..2].copy_from_slice(&truth);
        for path in worth {
            let Some(mut place) = map.place(path.anchor, path.source, &state) else { continue };
            if let Source::Virtual(index) = path.source {
                place.position_m = recording.virtual_anchors[index].position_m;
            }
            let rise_m = rise_m(setup, path.anchor, cycle.tag_height_m);
            let slope = map.slope(path.anchor, &place, rise_m, &state);
            let (w, explained_m2) = gaussian.along(&slope);
            gaussian.step(&w, 0.0, -1.0 / (explained_m2 + path.variance_m2));
        }
        gaussian.symmetrise();
        let [xx, _, yy] = gaussian.position_m2();
        bounds_m.push((xx + yy).max(0.0).sqrt());
    }
    bounds_m
}

/// All true paths of the frames that arrived in a cycle.
fn all_paths(cycle: &Cycle, pulses: &[Pulse]) -> Vec<Worth> {
    let mut worth = Vec::new();
    for frame in &cycle.frames {
        let Some(pulse) = pulses.get(frame.action) else { continue };
        let paths = cycle.truth_paths.iter().filter(|path| path.anchor == frame.anchor);
        let paths: Vec<_> = paths.filter(|path| path.sinr > LEAST_SINR).collect();
        let delays_s: Vec<f64> = paths.iter().map(|path| path.delay_s).collect();
        let sinrs: Vec<f64> = paths.iter().map(|path| path.sinr).collect();
        for (path, variance_m2) in paths.iter().zip(variances_m2(pulse, &delays_s, &sinrs)) {
            let source = path.virtual_anchor.map_or(Source::Direct, Source::Virtual);
            worth.push(Worth { anchor: frame.anchor, source, variance_m2 });
        }
    }
    worth
}

/// Variances of the lengths of a frame's paths, square metres: 1 / E_kk.
pub(crate) fn variances_m2(pulse: &Pulse, delays_s: &[f64], sinrs: &[f64]) -> Vec<f64> {
    let count = delays_s.len();
    let duration_s = f64::from(pulse.duration_s);
    let value = |lag: f64| f64::from(pulse.autocorrelation(lag as f32));
    let mut gram = vec![vec![0.0; count]; count];
    let mut slopes = vec![vec![0.0; count]; count];
    for k in 0..count {
        gram[k][k] = 1.0 + 1.0 / sinrs[k] + 1e-6;
        for l in 0..k {
            let lag = (delays_s[k] - delays_s[l]) / duration_s;
            if lag.abs() < REACH {
                gram[k][l] = value(lag);
                gram[l][k] = gram[k][l];
                let rise = value(lag + f64::from(STEP)) - value(lag - f64::from(STEP));
                slopes[k][l] = rise / (2.0 * f64::from(STEP));
                slopes[l][k] = -slopes[k][l];
            }
        }
    }
    let factor = crate::bound::cholesky(gram);
    let bandwidth = f64::from(pulse.rms_bandwidth_hz()) * duration_s;
    let alone = (std::f64::consts::TAU * bandwidth).powi(2);
    let unit_m = duration_s * f64::from(SPEED_OF_LIGHT_M_S);
    (0..count)
        .map(|k| {
            let solved = crate::bound::forward(&factor, &slopes[k]);
            let hidden: f64 = solved.iter().map(|x| x * x).sum();
            let s = sinrs[k];
            let information = 2.0 * s * s / (1.0 + s) * (alone - hidden).max(1e-6 * alone);
            unit_m * unit_m / information
        })
        .collect()
}
