//! `told`: extended Kalman filters that are told which path belongs to which source; what is left when association is
//! no problem.
//!
//! The state and its prior are those of `map`: the map is the plan's walls where the recording has a plan.
//! Motion: white acceleration in continuous time. The prior is a Gaussian sum (Alspach and Sorenson 1972), so
//! that a wide start and two places that a ring of ranges leaves open are no linearisation errors: a Gaussian whose
//! position is so wide that the curvature of a range matters is split into three along its longest axis.
//!
//! The tag may turn, or be a metre off: beside every Gaussian of weight there is, at a small rate per second, one whose
//! velocity is open again, and one whose position is. Without them a corner between two rare paths loses the tag.
//!
//! Paths, all labelled: the range of a source has the mean and variance of the second-order expansion, and the noise
//!
//! 0.75 N(0, R) + 0.2 N(0, R + (0.2 c Tp)^2) + 0.05 N(0, R + (1 m)^2),
//! R = std^2 + (0.02 c Tp)^2 + (5 mm)^2, + (0.25 c Tp)^2 where another true path overlaps,
//!
//! which is what the errors of labelled paths in simulated rooms look like; a wrong wall is in its last part. A radio's
//! range has no pulse: 0.9 N(0, R) + 0.08 N(0, 9 R) + 0.02 N(0, R + (1 m)^2), R = std^2 + (2 mm)^2. The update is soft: it
//! has the moments over the parts.

use super::gaussian::Gaussian;
use super::map::{Map, Place, VELOCITY};
use super::{CycleScans, Estimate, Scan, rise_m};
use crate::recording::Recording;
use crate::replay::Setup;
use std::time::Instant;

/// Runs the filter over the scans of a recording.
pub fn run(recording: &Recording, setup: &Setup, cycles: &[CycleScans]) -> Vec<Estimate> {
    let map = Map::told(recording, setup);
    let mut mixture = start(&map);
    let mut estimates = Vec::with_capacity(cycles.len());
    for (index, cycle) in cycles.iter().enumerate() {
        let begin = Instant::now();
        manoeuvre(setup, cycle.elapsed_s, &mut mixture);
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
            probability: None,
            searching: false,
            seconds: begin.elapsed().as_secs_f64(),
        });
    }
    estimates
}

/// Most Gaussians after a cycle, and after the first ones, when a wide start is many.
const MOST: usize = 32;
const MOST_EARLY: usize = 256;
const EARLY_CYCLES: usize = 10;
/// Widest Gaussian of the start, metres.
const WIDEST_START_M: f64 = 0.5;
/// Furthest that the start's grid reaches, deviations, and its most points to either side.
const START_REACH: f64 = 3.0;
const START_POINTS: f64 = 30.0;

/// Turns and stops per second, and how often per second all that is believed about the tag may be a metre off.
const TURNS_PER_S: f64 = 0.3;
const JUMPS_PER_S: f64 = 0.01;
/// Deviation of such a jump, metres.
const JUMP_M: f64 = 1.0;
/// Least deviation of the velocity after a turn, m/s.
const LEAST_SPEED_M_S: f64 = 0.3;
/// Gaussians this much lighter than the heaviest turn no more, nat.
const TURN_WITHIN: f64 = 6.0;

/// Beside every Gaussian of some weight one that turns or stops now, and one that is elsewhere.
fn manoeuvre(setup: &Setup, elapsed_s: f64, mixture: &mut Vec<Gaussian>) {
    let heaviest = mixture.iter().map(|gaussian| gaussian.ln_weight).fold(f64::NEG_INFINITY, f64::max);
    let likely = mixture.iter().filter(|gaussian| gaussian.ln_weight > heaviest - TURN_WITHIN);
    let told_m_s = f64::from(setup.config.start.velocity_std_m_s).max(LEAST_SPEED_M_S);
    let children: Vec<Gaussian> = likely
        .flat_map(|gaussian| {
            let speed_m_s = gaussian.mean[VELOCITY].hypot(gaussian.mean[VELOCITY + 1]);
            let std_m_s = told_m_s.max(speed_m_s);
            [(TURNS_PER_S, 0.0), (JUMPS_PER_S, JUMP_M)].map(|(rate, jump_m)| {
                let mut child = gaussian.turned(std_m_s, jump_m);
                child.ln_weight += (rate * elapsed_s).min(0.5).ln();
                child
            })
        })
        .collect();
    mixture.extend(children);
}

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
pub(crate) struct Measurement {
    source: super::Source,
    range_m: f64,
    noise: [(f64, f64); 3],
}

#[cfg(test)]
impl Measurement {
    pub(crate) fn new(source: super::Source, range_m: f64, noise: [(f64, f64); 3]) -> Self {
        Self { source, range_m, noise }
    }
}

/// What is added to the deviation that the estimator states: metres, or pulse lengths.
const RANGE_FLOOR_M: f64 = 2e-3;
const FLOOR_M: f64 = 5e-3;
const FLOOR: f64 = 0.02;
const OVERLAPPED: f64 = 0.25;
/// Deviations of the noise's wide parts: in pulse lengths, and of a wrong wall, metres.
const PULLED: f64 = 0.2;
const WRONG_M: f64 = 1.0;

/// Shares and variances, square metres, of a path's noise.
pub(crate) fn noise(scan: &Scan, index: usize) -> [(f64, f64); 3] {
    let path = &scan.paths[index];
    let stated_m2 = path.std_m * path.std_m;
    if scan.pulse_m == 0.0 {
        let r = stated_m2 + RANGE_FLOOR_M * RANGE_FLOOR_M;
        return [(0.9, r), (0.08, 9.0 * r), (0.02, r + WRONG_M * WRONG_M)];
    }
    let pulses_m2 = |share: f64| (share * scan.pulse_m).powi(2);
    let overlapped_m2 = if path.overlapped { pulses_m2(OVERLAPPED) } else { 0.0 };
    let r = stated_m2 + pulses_m2(FLOOR) + FLOOR_M * FLOOR_M + overlapped_m2;
    [(0.75, r), (0.2, r + pulses_m2(PULLED)), (0.05, r + WRONG_M * WRONG_M)]
}

/// The labelled paths of a scan.
fn measurements(scan: &Scan) -> Vec<Measurement> {
    scan.paths
        .iter()
        .enumerate()
        .filter_map(|(index, path)| {
            Some(Measurement { source: path.source?, range_m: path.range_m, noise: noise(scan, index) })
        })
        .collect()
}

/// A scan's labelled paths, one after the other.
pub(crate) fn update(
    map: &Map,
    anchor: usize,
    rise_m: f64,
    measurements: &[Measurement],
    gaussian: &mut Gaussian,
) {
    for measurement in measurements {
        let Some(place) = map.place(anchor, measurement.source, &gaussian.mean) else { continue };
        let look = map.look(anchor, &place, rise_m, &gaussian.mean, &gaussian.covariance);
        let (w, explained_m2) = gaussian.along(&look.slope);
        let innovation_m = measurement.range_m - look.range_m - look.curved_m;
        let modes = measurement.noise.map(|(share, variance_m2)| {
            let s = explained_m2 + look.curved_m2 + variance_m2;
            let ln =
                share.ln() - 0.5 * (std::f64::consts::TAU * s).ln() - 0.5 * innovation_m * innovation_m / s;
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

/// Splits the Gaussians for which the curvature of a labelled range matters.
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

/// Lighter Gaussians than this below the heaviest are dropped, nat.
const LIGHTEST: f64 = 12.0;

/// Gaussians within these squared distances of position and velocity are one.
const SAME: [f64; 2] = [0.5, 0.7];

/// Drops what is light, joins what is close, and keeps `most` at most.
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
            position < SAME[0] && velocity < SAME[1]
        });
        match near {
            Some(near) => kept[near].join(&gaussian),
            None if kept.len() < most => kept.push(gaussian),
            None => {}
        }
    }
    *mixture = kept;
}

/// Gaussians whose squared distance from the heaviest one's position is below this are one place with it.
const SAME_PLACE: f64 = 9.0;

/// Mean of the heaviest cluster, and the covariance of all about it.
fn moments(mixture: &[Gaussian]) -> ([f64; 2], [f64; 3]) {
    let Some(leader) = mixture.iter().max_by(|a, b| a.ln_weight.total_cmp(&b.ln_weight)) else {
        return ([f64::NAN; 2], [f64::NAN; 3]);
    };
    let weight = |gaussian: &Gaussian| (gaussian.ln_weight - leader.ln_weight).exp();
    let (mut mean, mut sum) = ([0.0; 2], 0.0);
    for gaussian in mixture.iter().filter(|gaussian| leader.distances(gaussian)[0] < SAME_PLACE) {
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
