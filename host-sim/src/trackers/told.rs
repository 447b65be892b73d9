//! `told`: extended Kalman filters that are told which path belongs to which source; what is left when association is
//! no problem.
//!
//! The state and its prior are those of [`super::map`]: the map is the plan's walls where the recording has a plan.
//! Motion: white acceleration in continuous time. The prior is a Gaussian sum (Alspach and Sorenson 1972), so
//! that a wide start and two places that a ring of ranges leaves open are no linearisation errors: a Gaussian whose
//! position is so wide that the curvature of a range matters is split into three along its longest axis.
//!
//! Paths, all labelled: the range of a source has the mean and variance of the second-order expansion, and the noise
//!
//! 0.75 N(0, R) + 0.2 N(0, R + (0.2 c Tp)^2) + 0.05 N(0, R + wide^2), R = (k std)^2 + (0.03 c Tp)^2 + (5 mm)^2,
//!
//! soft: the update has the moments over the three.

use super::gaussian::Gaussian;
use super::map::{Map, Place, usual_period_s};
use super::{CycleScans, Estimate, Scan, rise_m};
use crate::recording::Recording;
use crate::replay::Setup;
use std::time::Instant;

/// Runs the filter over the scans of a recording.
pub fn run(recording: &Recording, setup: &Setup, cycles: &[CycleScans]) -> Vec<Estimate> {
    let map = Map::told(recording, setup, cycles);
    let mut mixture = start(&map);
    let _ = usual_period_s(cycles);
    let mut estimates = Vec::with_capacity(cycles.len());
    for (index, cycle) in cycles.iter().enumerate() {
        let begin = Instant::now();
        for gaussian in &mut mixture {
            gaussian.predict(cycle.elapsed_s, map.acceleration_density);
        }
        let most = if index < EARLY_CYCLES { MOST_EARLY } else { MOST };
        refine(&map, setup, cycle, &mut mixture, most);
        for scan in &cycle.scans {
            let measurements = measurements(scan);
            let rise_m = rise_m(setup, scan.anchor, cycle.tag_height_m);
            for gaussian in &mut mixture {
                update(&map, scan.anchor, rise_m, &measurements, gaussian);
            }
        }
        reduce(&mut mixture, most);
        let (position_m, covariance_m2) = moments(&mixture);
        estimates.push(Estimate {
            position_m,
            covariance_m2,
            searching: false,
            seconds: begin.elapsed().as_secs_f64(),
        });
    }
    estimates
}

const EARLY_CYCLES: usize = 10;
const MOST_EARLY: usize = 256;
const MOST: usize = 32;
/// Widest Gaussian of the start, metres.
const WIDEST_START_M: f64 = 0.5;
/// Furthest that the start's grid reaches, deviations, and its most points to either side.
const START_REACH: f64 = 3.0;
const START_POINTS: f64 = 30.0;

/// The start as a Gaussian sum.
fn start(map: &Map) -> Vec<Gaussian> {
    let prior = Gaussian::prior(map);
    let [_, std_m] = map.prior[0];
    if std_m <= WIDEST_START_M {
        return vec![prior];
    }
    let spacing_m = WIDEST_START_M.max(START_REACH * std_m / START_POINTS);
    let left_m2 = std_m * std_m - spacing_m * spacing_m;
    let points = (START_REACH * std_m / spacing_m).ceil() as i32;
    let states = map.states();
    let mut mixture = Vec::new();
    for row in -points..=points {
        for column in -points..=points {
            let offset_m = [f64::from(column) * spacing_m, f64::from(row) * spacing_m];
            let mut gaussian = prior.clone();
            for (axis, offset_m) in offset_m.iter().enumerate() {
                gaussian.mean[axis] += offset_m;
                gaussian.covariance[axis * (states + 1)] = spacing_m * spacing_m;
                gaussian.ln_weight -= 0.5 * offset_m * offset_m / left_m2;
            }
            mixture.push(gaussian);
        }
    }
    mixture
}

/// A labelled path with its noise: shares and variances, square metres.
struct Measurement {
    source: super::Source,
    range_m: f64,
    noise: [(f64, f64); 3],
}

pub(crate) fn noise(scan: &Scan, index: usize) -> [(f64, f64); 3] {
    let path = &scan.paths[index];
    if scan.pulse_m == 0.0 {
        let r = 1.44 * path.std_m * path.std_m + 4e-6;
        return [(0.9, r), (0.08, 9.0 * r), (0.02, 1.0 + r)];
    }
    let ev = |n: &str, d: f64| std::env::var(n).map_or(d, |v| v.parse().unwrap());
    let mut r = ev("T_K", 1.44) * path.std_m * path.std_m + (ev("T_FLOOR", 0.03) * scan.pulse_m).powi(2) + 25e-6;
    if path.overlapped { r += (ev("T_OVER", 0.0) * scan.pulse_m).powi(2); }
    let w2 = ev("T_W2", 0.2);
    [(0.95 - w2, r), (w2, r + (0.2 * scan.pulse_m).powi(2)), (0.05, r + 1.0)]
}

fn measurements(scan: &Scan) -> Vec<Measurement> {
    scan.paths
        .iter()
        .enumerate()
        .filter_map(|(index, path)| {
            Some(Measurement { source: path.source?, range_m: path.range_m, noise: noise(scan, index) })
        })
        .collect()
}

fn update(map: &Map, anchor: usize, rise_m: f64, measurements: &[Measurement], gaussian: &mut Gaussian) {
    for measurement in measurements {
        let Some(place) = map.place(anchor, measurement.source, &gaussian.mean) else { continue };
        let look = map.look(anchor, &place, rise_m, &gaussian.mean, &gaussian.covariance);
        let (w, explained_m2) = gaussian.along(&look.slope);
        let innovation_m = measurement.range_m - look.range_m - look.curved_m;
        let modes = measurement.noise.map(|(share, variance_m2)| {
            let s = explained_m2 + look.curved_m2 + variance_m2;
            let ln = share.ln() - 0.5 * (std::f64::consts::TAU * s).ln() - 0.5 * innovation_m * innovation_m / s;
            (ln, s)
        });
        let most = modes.iter().map(|(ln, _)| *ln).fold(f64::NEG_INFINITY, f64::max);
        let sum: f64 = modes.iter().map(|(ln, _)| (ln - most).exp()).sum();
        gaussian.ln_weight += most + sum.ln();
        let (mut gain, mut gain_2, mut shrink) = (0.0, 0.0, 0.0);
        for (ln, s) in modes {
            let beta = (ln - most).exp() / sum;
            let g = innovation_m / s;
            gain += beta * g;
            gain_2 += beta * g * g;
            shrink += beta / s;
        }
        gaussian.step(&w, gain, gain_2 - gain * gain - shrink);
    }
    gaussian.symmetrise();
}

/// Gaussians this much lighter than the heaviest are not split, nat.
const SPLIT_WITHIN: f64 = 6.0;
/// A curvature of this, metres, is no error.
const FLAT_M: f64 = 0.02;

fn refine(map: &Map, setup: &Setup, cycle: &CycleScans, mixture: &mut Vec<Gaussian>, most: usize) {
    let heaviest = mixture.iter().map(|gaussian| gaussian.ln_weight).fold(f64::NEG_INFINITY, f64::max);
    for _ in 0..2 {
        let mut refined = Vec::with_capacity(mixture.len());
        let mut room = (2 * most).saturating_sub(mixture.len());
        for gaussian in mixture.drain(..) {
            let splits = room > 1
                && gaussian.ln_weight > heaviest - SPLIT_WITHIN
                && curvature_m(map, setup, cycle, &gaussian) > FLAT_M;
            if splits {
                refined.extend(gaussian.split());
                room -= 2;
            } else {
                refined.push(gaussian);
            }
        }
        *mixture = refined;
    }
}

/// Largest deviation that the curvature of a labelled range adds, metres.
fn curvature_m(map: &Map, setup: &Setup, cycle: &CycleScans, gaussian: &Gaussian) -> f64 {
    let mut largest_m2 = 0.0_f64;
    for scan in &cycle.scans {
        let rise_m = rise_m(setup, scan.anchor, cycle.tag_height_m);
        for source in scan.paths.iter().filter_map(|path| path.source) {
            let Some(place) = map.place(scan.anchor, source, &gaussian.mean) else { continue };
            // The tag's own part alone: splitting does not help against a wide map.
            let place = Place { slopes: Vec::new(), ..place };
            let look = map.look(scan.anchor, &place, rise_m, &gaussian.mean, &gaussian.covariance);
            largest_m2 = largest_m2.max(look.curved_m2);
        }
    }
    largest_m2.sqrt()
}

const LIGHTEST: f64 = 12.0;

fn reduce(mixture: &mut Vec<Gaussian>, most: usize) {
    mixture.sort_by(|a, b| b.ln_weight.total_cmp(&a.ln_weight));
    let heaviest = mixture.first().map_or(0.0, |gaussian| gaussian.ln_weight);
    let mut kept: Vec<Gaussian> = Vec::new();
    for mut gaussian in mixture.drain(..) {
        gaussian.ln_weight -= heaviest;
        if !(gaussian.ln_weight > -LIGHTEST) {
            break;
        }
        let near = kept.iter().position(|kept| {
            let [position, velocity] = kept.distances(&gaussian);
            position < 0.5 && velocity < 0.7
        });
        match near {
            Some(near) => kept[near].join(&gaussian),
            None if kept.len() < most => kept.push(gaussian),
            None => {}
        }
    }
    *mixture = kept;
}

/// Mean of the heaviest cluster, and the covariance of all about it.
fn moments(mixture: &[Gaussian]) -> ([f64; 2], [f64; 3]) {
    let Some(leader) = mixture.iter().max_by(|a, b| a.ln_weight.total_cmp(&b.ln_weight)) else {
        return ([f64::NAN; 2], [f64::NAN; 3]);
    };
    let weight = |gaussian: &Gaussian| (gaussian.ln_weight - leader.ln_weight).exp();
    let (mut mean, mut sum) = ([0.0; 2], 0.0);
    for gaussian in mixture.iter().filter(|gaussian| leader.distances(gaussian)[0] < 9.0) {
        let w = weight(gaussian);
        sum += w;
        mean[0] += w * gaussian.mean[0];
        mean[1] += w * gaussian.mean[1];
    }
    let mean = mean.map(|x| x / sum);
    let (mut covariance, mut total) = ([0.0; 3], 0.0);
    for gaussian in mixture {
        let w = weight(gaussian);
        let [xx, xy, yy] = gaussian.position_m2();
        let [x, y] = [gaussian.mean[0] - mean[0], gaussian.mean[1] - mean[1]];
        total += w;
        covariance[0] += w * (xx + x * x);
        covariance[1] += w * (xy + x * y);
        covariance[2] += w * (yy + y * y);
    }
    (mean, covariance.map(|c| c / total))
}
