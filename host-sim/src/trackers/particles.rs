//! `particles`: a bootstrap particle filter with the plan, whose many hypotheses need no linearisation and no association.
//!
//! State: position and velocity; white acceleration in continuous time, as [`super::told`]. The weight of an anchor's
//! scan is that of a Poisson model of its paths,
//!
//! prod_m ( lambda + sum_s q N(z_m; r_s, R_m + C_s) ),
//!
//! over the anchor and its told virtual anchors s, with lambda the density of false and unmapped paths that the
//! set-up tells, q the detection probability told (for a virtual anchor half of it: most are not seen from most places),
//! C_s the deviation of the virtual anchor told, and R_m = 1.44 std^2 + (0.1 c Tp)^2 + (2 mm)^2. A miss costs nothing:
//! which sources are seen from where is not known. The map is not learnt.

use super::{CycleScans, Estimate, Scan, rise_m};
use crate::channel::random::{Purpose, normal, stream, uniform};
use crate::recording::Recording;
use crate::replay::Setup;
use rayon::prelude::*;
use std::time::Instant;

/// The usual number of particles.
pub const PARTICLES: usize = 20_000;
/// Where the start is wider than this share of the outline's longer side, particles begin evenly inside it.
const WIDE: f64 = 0.25;
/// Share of the particles that must count, or they are drawn anew.
const LEAST_SHARE: f64 = 0.5;
/// Drawn anew, particles are spread by this share of the whole spread: those drawn twice would stay together.
const ROUGHENING: f64 = 0.05;
/// Particles of one task; the randomness follows it, whatever the threads.
const CHUNK: usize = 1000;
/// Detection probability of a virtual anchor over that of an anchor.
const REFLECTED: f64 = 0.5;

/// One hypothesis: position and velocity.
type Particle = [f64; 4];

/// A source of paths.
struct Feature {
    anchor: usize,
    position_m: [f64; 2],
    variance_m2: f64,
    detected: f64,
}

/// Runs `count` particles over the scans of a recording.
pub fn run(
    recording: &Recording,
    setup: &Setup,
    cycles: &[CycleScans],
    count: usize,
    seed: u64,
) -> Vec<Estimate> {
    let features = features(recording, setup);
    let density = f64::from(setup.config.motion.acceleration_density_m2_s3);
    let mut particles = start(recording, setup, count, seed);
    let mut ln_weights = vec![0.0; particles.len()];
    let cycle = |(index, cycle): (usize, &CycleScans)| {
        let begin = Instant::now();
        move_on(&mut particles, cycle.elapsed_s, density, seed, index);
        ln_weights.par_iter_mut().zip(&particles).for_each(|(ln_weight, particle)| {
            for scan in &cycle.scans {
                *ln_weight += ln_likelihood(setup, &features, scan, cycle.tag_height_m, particle);
            }
        });
        let most = ln_weights.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let mut weights: Vec<f64> = ln_weights.iter().map(|ln| (ln - most).exp()).collect();
        let sum: f64 = weights.iter().sum();
        weights.iter_mut().for_each(|weight| *weight /= sum);
        let (mean, covariance) = moments(&particles, &weights);
        let squares: f64 = weights.iter().map(|weight| weight * weight).sum();
        if 1.0 / squares < LEAST_SHARE * particles.len() as f64 {
            particles = drawn_anew(&particles, &weights, &covariance, seed, index);
            ln_weights.fill(0.0);
        } else {
            ln_weights.iter_mut().for_each(|ln| *ln -= most);
        }
        Estimate {
            position_m: [mean[0], mean[1]],
            covariance_m2: [covariance[0][0], covariance[0][1], covariance[1][1]],
            probability: None,
            searching: false,
            seconds: begin.elapsed().as_secs_f64(),
        }
    };
    cycles.iter().enumerate().map(cycle).collect()
}

fn features(recording: &Recording, setup: &Setup) -> Vec<Feature> {
    let detected = f64::from(setup.config.association.detection_probability);
    let anchors = setup.anchors.iter().enumerate().map(|(anchor, own)| Feature {
        anchor,
        position_m: own.position_m.map(f64::from),
        variance_m2: 0.0,
        detected,
    });
    let told = recording.virtual_anchors.iter().filter(|va| va.known && setup.tells_images());
    let images = told.map(|va| Feature {
        anchor: va.anchor,
        position_m: va.told_position_m.unwrap_or(va.position_m),
        variance_m2: va.std_m * va.std_m,
        detected: REFLECTED * detected,
    });
    anchors.chain(images).collect()
}

/// Particles of the prior: normal, or evenly over the plan's outline where that is the smaller.
fn start(recording: &Recording, setup: &Setup, count: usize, seed: u64) -> Vec<Particle> {
    let start = &setup.config.start;
    let [x, y] = start.position_m.map(f64::from);
    let (std_m, std_m_s) = (f64::from(start.position_std_m), f64::from(start.velocity_std_m_s));
    let mut rng = stream(seed, Purpose::Experiment, &[count, 0]);
    let outline = recording.plan.as_ref().map(|plan| &plan.outline_m[..]).filter(|outline| outline.len() > 2);
    let extent = outline.map(|outline| {
        let side = |axis: usize| {
            let values = outline.iter().map(move |corner| corner[axis]);
            [values.clone().fold(f64::INFINITY, f64::min), values.fold(f64::NEG_INFINITY, f64::max)]
        };
        [side(0), side(1)]
    });
    let wide = extent.filter(|[x, y]| std_m > WIDE * (x[1] - x[0]).max(y[1] - y[0]));
    let mut particles = Vec::with_capacity(count);
    while particles.len() < count {
        let place = match (wide, outline) {
            (Some([x, y]), Some(outline)) => {
                let place = [x, y].map(|[low, high]: [f64; 2]| low + (high - low) * uniform(&mut rng));
                if !inside(outline, place) {
                    continue;
                }
                place
            }
            _ => [x + std_m * normal(&mut rng), y + std_m * normal(&mut rng)],
        };
        particles.push([place[0], place[1], std_m_s * normal(&mut rng), std_m_s * normal(&mut rng)]);
    }
    particles
}

/// Whether a point is inside a polygon: a ray to the right meets its sides an odd number of times.
fn inside(corners: &[[f64; 2]], [x, y]: [f64; 2]) -> bool {
    let sides = corners.iter().zip(corners.iter().cycle().skip(1));
    let met = sides
        .filter(|([ax, ay], [bx, by])| (*ay > y) != (*by > y) && x < ax + (y - ay) / (by - ay) * (bx - ax));
    met.count() % 2 == 1
}

fn move_on(particles: &mut [Particle], elapsed_s: f64, density: f64, seed: u64, cycle: usize) {
    // Lower root of the noise of position and velocity in white acceleration.
    let speed = (density * elapsed_s).sqrt();
    let (along, across) = (0.5 * elapsed_s * speed, elapsed_s * speed / 12.0_f64.sqrt());
    particles.par_chunks_mut(CHUNK).enumerate().for_each(|(chunk, particles)| {
        let mut rng = stream(seed, Purpose::Experiment, &[cycle, chunk, 1]);
        for particle in particles {
            for axis in 0..2 {
                let (a, b) = (normal(&mut rng), normal(&mut rng));
                particle[axis] += elapsed_s * particle[axis + 2] + along * a + across * b;
                particle[axis + 2] += speed * a;
            }
        }
    });
}

fn ln_likelihood(
    setup: &Setup,
    features: &[Feature],
    scan: &Scan,
    tag_height_m: Option<f64>,
    particle: &Particle,
) -> f64 {
    let association = &setup.config.association;
    let ranging = &setup.config.ranging;
    let clutter = f64::from(association.clutter_per_anchor + association.unmapped_per_anchor)
        / f64::from(ranging.max_range_m);
    let (bias_m, bias_std_m) = (f64::from(ranging.bias_mean_m), f64::from(ranging.bias_std_m));
    let rise_m = rise_m(setup, scan.anchor, tag_height_m);
    let floor_m2 = (0.1 * scan.pulse_m).powi(2) + 4e-6 + bias_std_m * bias_std_m;
    let mut densities = [clutter; crate::replay::PATHS];
    for feature in features.iter().filter(|feature| feature.anchor == scan.anchor) {
        let [x, y] = [particle[0] - feature.position_m[0], particle[1] - feature.position_m[1]];
        let range_m = (x * x + y * y + rise_m * rise_m).sqrt() + bias_m;
        for (density, path) in densities.iter_mut().zip(&scan.paths) {
            let variance_m2 = 1.44 * path.std_m * path.std_m + floor_m2 + feature.variance_m2;
            let off_m = path.range_m - range_m;
            let square = off_m * off_m / variance_m2;
            if square < 60.0 {
                let scale = (std::f64::consts::TAU * variance_m2).sqrt();
                *density += feature.detected * (-0.5 * square).exp() / scale;
            }
        }
    }
    densities.iter().take(scan.paths.len()).map(|density| (density / clutter).ln()).sum()
}

fn moments(particles: &[Particle], weights: &[f64]) -> (Particle, [[f64; 4]; 4]) {
    let mut mean = [0.0; 4];
    for (particle, weight) in particles.iter().zip(weights) {
        (0..4).for_each(|n| mean[n] += weight * particle[n]);
    }
    let mut covariance = [[0.0; 4]; 4];
    for (particle, weight) in particles.iter().zip(weights) {
        for row in 0..4 {
            for column in 0..4 {
                covariance[row][column] +=
                    weight * (particle[row] - mean[row]) * (particle[column] - mean[column]);
            }
        }
    }
    (mean, covariance)
}

/// Systematic resampling, and some of the spread anew.
fn drawn_anew(
    particles: &[Particle],
    weights: &[f64],
    covariance: &[[f64; 4]; 4],
    seed: u64,
    cycle: usize,
) -> Vec<Particle> {
    let count = particles.len();
    let mut rng = stream(seed, Purpose::Experiment, &[cycle, 2]);
    let first = uniform(&mut rng);
    let (mut index, mut reached) = (0, weights[0]);
    let spread: [f64; 4] = std::array::from_fn(|n| ROUGHENING * covariance[n][n].sqrt().min(0.5));
    (0..count)
        .map(|n| {
            let wanted = (n as f64 + first) / count as f64;
            while reached < wanted && index + 1 < count {
                index += 1;
                reached += weights[index];
            }
            std::array::from_fn(|n| particles[index][n] + spread[n] * normal(&mut rng))
        })
        .collect()
}
