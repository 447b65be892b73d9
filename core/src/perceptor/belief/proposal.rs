//! Newcomers: places that the earliest ranges of a scan propose.
//!
//! An early strong range is that of the direct path, or of nothing: it puts the tag on a circle around its anchor, cut into
//! [`ARCS`] arcs. Each is weighed by all scans with the trusted map, features one by one, the direct path first, nu_m being what
//! earlier features left of measurement m:
//!
//! L = prod_k [1 - q_k + q_k sum_m nu_m N(z_m; mean_k, S_k) / lambda_m].
//!
//! The best become components, with little weight: what follows decides.

use crate::model::measurement::{Clutter, Measurement};
use crate::perceptor::association::background::Background;
use crate::perceptor::expectation::Expectation;
use crate::real::{TAU, cos, exp, larger, ln, sin, sqrt};
use heapless::Vec;

/// Capacity: arcs of one circle.
pub const ARCS: usize = 16;
/// Capacity: ranges of a scan that are tried as the direct path, the shortest first.
pub const EARLIEST: usize = 2;
/// Capacity: places that a cycle proposes.
pub const PROPOSED: usize = 4;
/// Tuned: where the tag is known, places are proposed in every so manieth cycle heard all the same.
pub const EVERY: u32 = 5;
/// Tuned: ranges that false alarms are so probable of are not tried: their density over that of all.
pub const STRONG: f32 = 0.6;
/// Tuned: standard deviation of a proposed place along the radius, metres.
pub const ALONG_M: f32 = 0.3;
/// Mathematics: standard deviation of an arc along the circle over its length: of a uniform distribution.
const ACROSS: f32 = 0.288_675_13;
/// Tuned: least standard deviation along the circle, metres.
pub const LEAST_ACROSS_M: f32 = 0.05;
/// Mathematics: the golden ratio: arcs of one cycle after the other are spread evenly.
const GOLDEN: f32 = 0.618_034;
/// Guard: against work on what explains nothing: squared deviations.
const GATE2: f32 = 12.0;
/// Guard: against ln 0.
const LEAST_INSIDE: f32 = 1e-3;
/// Guard: against work: a feature below this share of the evidence takes no part of any measurement.
const LEAST_EVIDENCE: f32 = 0.1;

/// A place that the tag may be at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Proposal {
    /// Its position, metres.
    pub position_m: [f32; 2],
    /// The direction from its anchor, a unit vector.
    pub radial: [f32; 2],
    /// Variances along it and across, square metres.
    pub variance_m2: [f32; 2],
    /// Evidence, nats.
    pub evidence_nat: f32,
}

/// What a place expects of a scan: of a direct path, or of an image.
#[derive(Clone, Copy, Debug)]
pub struct Landmark {
    /// Position, metres.
    pub position_m: [f32; 2],
    /// Its covariance (xx, yx, yy), square metres; zero for a physical anchor.
    pub covariance_m2: [f32; 3],
    /// Probability that it exists and is detected.
    pub detection: f32,
}

/// A scan as places are weighed by it.
#[derive(Clone, Copy, Debug)]
pub struct Sweep<'a, const PATHS: usize> {
    /// The measurements.
    pub measurements: &'a Vec<Measurement, PATHS>,
    /// Height of the anchor above the tag, metres.
    pub height_m: f32,
    /// Bias of the anchor's ranges, metres, and its variance, square metres.
    pub bias: (f32, f32),
    /// Intensities of what belongs to nothing.
    pub clutter: Clutter,
}

/// Where the arcs of a cycle begin, as a share of an arc.
pub(super) fn phase(cycle: u32) -> f32 {
    let turns = (cycle % 1024) as f32 * GOLDEN;
    turns - (turns as u32) as f32
}

/// The places that the sweeps propose, at most [`PROPOSED`], the best; `landmarks` gives those of a sweep, the direct path first,
/// `inside` the probability that a place, known within a deviation (metres), may be one of a tag.
#[inline(never)]
pub fn propose<'a, const PATHS: usize, L: Iterator<Item = Landmark>>(
    sweeps: &[Sweep<'a, PATHS>],
    landmarks: impl Fn(usize) -> L,
    inside: impl Fn([f32; 2], f32) -> f32,
    phase: f32,
) -> Vec<Proposal, PROPOSED> {
    let mut best: Vec<Proposal, PROPOSED> = Vec::new();
    for (index, sweep) in sweeps.iter().enumerate() {
        let Some(direct) = landmarks(index).next() else { continue };
        let mut after_m = 0.0;
        for _ in 0..EARLIEST {
            let mut next: Option<&Measurement> = None;
            for measurement in sweep.measurements {
                if measurement.range_m > after_m
                    && measurement.false_alarm < STRONG
                    && next.is_none_or(|next| measurement.range_m < next.range_m)
                {
                    next = Some(measurement);
                }
            }
            let Some(measurement) = next else { break };
            after_m = measurement.range_m;
            let slant_m = after_m - sweep.bias.0;
            let radius2 = slant_m * slant_m - sweep.height_m * sweep.height_m;
            if radius2 <= 0.0 {
                continue;
            }
            let radius = sqrt(radius2);
            for arc in 0..ARCS {
                let angle = TAU / ARCS as f32 * (arc as f32 + phase);
                let radial = [cos(angle), sin(angle)];
                let [x, y] = direct.position_m;
                let position_m = [x + radius * radial[0], y + radius * radial[1]];
                let across_m = larger(ACROSS * (TAU * radius / ARCS as f32), LEAST_ACROSS_M);
                let mut evidence_nat = ln(larger(inside(position_m, across_m), LEAST_INSIDE));
                for (other, sweep) in sweeps.iter().enumerate() {
                    evidence_nat += weigh(position_m, across_m * across_m, sweep, landmarks(other));
                }
                let variance_m2 = [ALONG_M * ALONG_M, across_m * across_m];
                keep(&mut best, Proposal { position_m, radial, variance_m2, evidence_nat });
            }
        }
    }
    best
}

/// Keeps a proposal among the best.
fn keep(best: &mut Vec<Proposal, PROPOSED>, proposal: Proposal) {
    let Err(proposal) = best.push(proposal) else { return };
    let mut least: Option<&mut Proposal> = None;
    for kept in best {
        if least.as_ref().is_none_or(|least| kept.evidence_nat < least.evidence_nat) {
            least = Some(kept);
        }
    }
    if let Some(least) = least
        && least.evidence_nat < proposal.evidence_nat
    {
        *least = proposal;
    }
}

/// Evidence of a sweep for a place of this variance, nats.
fn weigh<const PATHS: usize>(
    [x, y]: [f32; 2],
    place_m2: f32,
    sweep: &Sweep<'_, PATHS>,
    landmarks: impl Iterator<Item = Landmark>,
) -> f32 {
    let (bias_m, bias_m2) = sweep.bias;
    let mut background: Option<(Background<PATHS>, f32)> = None;
    let mut nu = [1.0; PATHS];
    let mut evidence_nat = 0.0;
    for landmark in landmarks {
        let Landmark { position_m: [lx, ly], covariance_m2: [xx, yx, yy], detection } = landmark;
        let (dx, dy) = (x - lx, y - ly);
        let distance2 = dx * dx + dy * dy + sweep.height_m * sweep.height_m;
        let own_m2 = (dx * dx * xx + 2.0 * (dx * dy * yx) + dy * dy * yy) / larger(distance2, 1e-6);
        let range_m = sqrt(distance2) + bias_m;
        let variance_m2 = place_m2 + bias_m2 + own_m2;
        // The direct path is the first.
        let (background, direct_m) = &*background.get_or_insert_with(|| {
            let direct = Expectation { range_m, variance_m2, existence: 1.0, detection };
            let background = Background::new(sweep.measurements, &direct, &sweep.clutter, &[1.0; PATHS]);
            evidence_nat += background.evidence_nat(sweep.measurements.len());
            (background, range_m)
        });
        if range_m < direct_m - ALONG_M {
            continue;
        }
        let mut terms = [0.0; PATHS];
        let mut sum = 0.0;
        let densities = sweep.measurements.iter().zip(background.per_m());
        for ((measurement, per_m), (term, nu)) in densities.zip(terms.iter_mut().zip(&nu)) {
            let variance = variance_m2 + measurement.variance_m2;
            let innovation = measurement.range_m - range_m;
            let squared = innovation * innovation;
            if squared < GATE2 * variance {
                *term = detection * nu * exp(-0.5 * (squared / variance)) / (sqrt(TAU * variance) * per_m);
                sum += *term;
            }
        }
        let evidence = 1.0 - detection + sum;
        evidence_nat += ln(evidence);
        if sum > LEAST_EVIDENCE * evidence {
            for (nu, term) in nu.iter_mut().zip(&terms) {
                *nu *= larger(1.0 - term / evidence, 0.0);
            }
        }
    }
    evidence_nat
}
