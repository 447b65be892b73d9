//! Newcomers: early ranges put the tag on circles around their anchors; the arcs that all scans like best are proposed.

use super::association::{Clutter, Expectation, Measurement, background_per_m};
use super::lateness::Lateness;
use super::real::{Real, cos, larger, ln, ln_product, sin, smaller, sqrt, square, tau};
use cogmint_core::perceptor::belief::PLACE_M;
pub use cogmint_core::perceptor::belief::proposal::EVERY;
use cogmint_core::perceptor::belief::proposal::{
    ACROSS, ARCS, AREA, EARLIEST, GOLDEN, LEAST_ACROSS_M, LEAST_EVIDENCE, LEAST_INSIDE, PLASTIC, PROPOSED,
    REACH2, STRONG,
};

/// A place that the tag may be at.
#[derive(Clone, Copy, Debug)]
pub struct Proposal<T> {
    /// Metres.
    pub position_m: [T; 2],
    /// Direction from the anchor.
    pub radial: [T; 2],
    /// Variances along it and across, square metres.
    pub variance_m2: [T; 2],
    /// Nats.
    pub evidence_nat: T,
}

/// What a place expects: the direct path or an image.
#[derive(Clone, Copy, Debug)]
pub struct Landmark<T> {
    /// Metres.
    pub position_m: [T; 2],
    /// Its covariance (xx, yx, yy), square metres.
    pub covariance_m2: [T; 3],
    /// Probability that it is there and found.
    pub detection: T,
}

/// A scan with what a place expects of it.
#[derive(Clone, Debug)]
pub struct Sweep<T> {
    /// What was measured.
    pub measurements: Vec<Measurement<T>>,
    /// Height of the anchor above the tag, metres.
    pub height_m: T,
    /// Bias of its ranges, metres.
    pub bias_m: T,
    /// Its variance, square metres.
    pub bias_m2: T,
    /// What belongs to nothing.
    pub clutter: Clutter<T>,
    /// The direct path, then the images by slot.
    pub landmarks: Vec<Landmark<T>>,
}

/// Where the arcs of a cycle begin, as a share of an arc, and whose turn it is, as a share of all scans.
pub fn turn<T: Real>(cycle: u32) -> [T; 2] {
    [GOLDEN, PLASTIC].map(|ratio| {
        let turns = T::of_count((cycle % 1024) as usize) * T::of(ratio);
        turns - T::of_count(turns.whole() as usize)
    })
}

/// The best places.
pub fn propose<T: Real>(
    sweeps: &[Sweep<T>],
    inside: impl Fn([T; 2], T) -> T,
    [phase, turn]: [T; 2],
) -> Vec<Proposal<T>> {
    let num = T::of;
    let mut best: Vec<Proposal<T>> = Vec::new();
    let arcs = T::of_count(ARCS);
    // In turn: from one scan on, the first that proposes any place.
    let first = (turn * T::of_count(sweeps.len())).whole() as usize;
    let order = (0..sweeps.len()).map(|n| (first + n) % sweeps.len());
    for sweep in order.map(|n| &sweeps[n]) {
        if !best.is_empty() {
            break;
        }
        let mut early: Vec<T> = sweep
            .measurements
            .iter()
            .filter(|z| z.range_m > T::ZERO && z.is_strong(STRONG))
            .map(|z| z.range_m)
            .collect();
        early.sort_by(|a, b| a.partial_cmp(b).unwrap_or(std::cmp::Ordering::Equal));
        early.dedup();
        for range_m in early.into_iter().take(EARLIEST) {
            let radius2 = square(range_m - sweep.bias_m) - square(sweep.height_m);
            if radius2 <= T::ZERO {
                continue;
            }
            let radius = sqrt(radius2);
            for arc in 0..ARCS {
                let angle = tau::<T>() / arcs * (T::of_count(arc) + phase);
                let radial = [cos(angle), sin(angle)];
                let anchor_m = sweep.landmarks[0].position_m;
                let position_m = [0, 1].map(|axis| anchor_m[axis] + radius * radial[axis]);
                let across_m = larger(num(ACROSS) * (tau::<T>() * radius / arcs), num(LEAST_ACROSS_M));
                let mut evidence_nat = ln(larger(inside(position_m, across_m), num(LEAST_INSIDE)));
                for other in sweeps {
                    evidence_nat += other.evidence_nat(position_m, square(across_m));
                }
                let variance_m2 = [square(num(PLACE_M)), square(across_m)];
                let proposal = Proposal { position_m, radial, variance_m2, evidence_nat };
                if best.len() < PROPOSED {
                    best.push(proposal);
                    continue;
                }
                // The first of equals is the least.
                let mut least = 0;
                for index in 1..best.len() {
                    if best[index].evidence_nat < best[least].evidence_nat {
                        least = index;
                    }
                }
                if best[least].evidence_nat < evidence_nat {
                    best[least] = proposal;
                }
            }
        }
    }
    best
}

impl<T: Real> Sweep<T> {
    /// For a place of this variance, nats: feature by feature, each with what is left of the measurements.
    fn evidence_nat(&self, place_m: [T; 2], place_m2: T) -> T {
        let num = T::of;
        let count = self.measurements.len();
        // All count as having the least variance among them.
        let variances = self.measurements.iter().map(|z| z.variance_m2);
        let least_m2 = variances.fold(num(f32::INFINITY), |least, variance| smaller(variance, least));
        let mut left = vec![T::ONE; count];
        let mut factors = Vec::new();
        let mut unexplained_nat = T::ZERO;
        let mut background = Vec::new();
        let mut direct_m = T::ZERO;
        for (index, landmark) in self.landmarks.iter().enumerate() {
            let [dx, dy] = [0, 1].map(|axis| place_m[axis] - landmark.position_m[axis]);
            let distance2 = dx * dx + dy * dy + square(self.height_m);
            let [xx, yx, yy] = landmark.covariance_m2;
            let own = dx * dx * xx + num(2.0) * (dx * dy * yx) + dy * dy * yy;
            let own_m2 = own / larger(distance2, num(1e-6));
            let range_m = sqrt(distance2) + self.bias_m;
            let variance_m2 = place_m2 + self.bias_m2 + own_m2;
            if index == 0 {
                let direct = Expectation {
                    range_m,
                    variance_m2,
                    existence: T::ONE,
                    detection: landmark.detection,
                    lateness: Lateness::none(),
                };
                background =
                    background_per_m(&direct, &self.measurements, &vec![T::ONE; count], &self.clutter);
                unexplained_nat = ln_product(background.iter().map(|per_m| *per_m / self.clutter.all_per_m));
                direct_m = range_m;
            }
            if range_m < direct_m - num(PLACE_M) {
                continue;
            }
            let variance = variance_m2 + least_m2;
            let reach_m2 = num(REACH2) * variance;
            let most_per_m = landmark.detection / (num(AREA) * sqrt(variance));
            let mut terms = vec![T::ZERO; count];
            let mut sum = T::ZERO;
            for (m, z) in self.measurements.iter().enumerate() {
                let squared = square(z.range_m - range_m);
                if squared < reach_m2 {
                    // Order: the sixth power as the product of three squares.
                    let shape = square(T::ONE - squared / reach_m2);
                    terms[m] = most_per_m * left[m] * (shape * shape * shape) / background[m];
                    sum += terms[m];
                }
            }
            let evidence = T::ONE - landmark.detection + sum;
            factors.push(evidence);
            if sum > num(LEAST_EVIDENCE) * evidence {
                for (left, term) in left.iter_mut().zip(terms) {
                    *left *= larger(T::ONE - term / evidence, T::ZERO);
                }
            }
        }
        unexplained_nat + ln_product(factors)
    }
}
