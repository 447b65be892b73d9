//! Newcomers: places that the earliest ranges of a scan propose.
//!
//! An early strong range is that of the direct path, or of nothing: it puts the tag on a circle around its anchor, cut into
//! [`ARCS`] arcs. Anchors take turns, which bounds the work. Each arc is weighed by all scans with the trusted map, features one by one, the direct path first, nu_m being what
//! earlier features left of measurement m:
//!
//! L = prod_k [1 - q_k + q_k sum_m nu_m f(z_m; mean_k, S_k) / lambda_m],
//!
//! f being a polynomial near the normal density, of the same variance S_k, in which all measurements of a scan have the least variance
//! among them: next to a place's it is small.
//! The best become components, with little weight: what follows decides.

use super::PLACE_M;
use crate::model::lateness::Lateness;
use crate::model::measurement::{Clutter, Measurement};
use crate::model::work::{BACKGROUND, PLACE, Work};
use crate::perceptor::association::background::Background;
use crate::perceptor::expectation::Expectation;
use crate::real::{LnProduct, TAU, cos, larger, ln, sin, smaller, sqrt};
use heapless::Vec;

/// Capacity: arcs of one circle.
pub const ARCS: usize = 16;
/// Capacity: ranges of a scan that are tried as the direct path, the shortest first.
pub const EARLIEST: usize = 2;
/// Capacity: places that a cycle proposes.
pub const PROPOSED: usize = 4;
/// Capacity: where the tag is known, places are still proposed once in so many cycles in which anything is heard.
pub const EVERY: u32 = 5;
/// Tuned: a path is strong, is tried as a direct one, and raises doubt where nothing explains it, where the density of false
/// alarms of its strength over that of all is below this.
pub const STRONG: f32 = 0.3;
/// Mathematics: standard deviation of an arc along the circle over its length: of a uniform distribution.
pub const ACROSS: f32 = 0.288_675_13;
/// Guard: against an arc without a length, where the tag is at the anchor: least standard deviation along the circle, metres.
pub const LEAST_ACROSS_M: f32 = 0.05;
/// Mathematics: the golden ratio: arcs of one cycle after the other are spread evenly.
pub const GOLDEN: f32 = 0.618_034;
/// Mathematics: the inverse square of the plastic number: turns are spread evenly, also of every fifth cycle.
pub const PLASTIC: f32 = 0.569_840_3;
/// Mathematics: squared deviations that the density (1 - q / 15)^6 of a place reaches: near the normal one, of the same variance.
pub const REACH2: f32 = 15.0;
/// Mathematics: its integral over a deviation: sqrt(15) B(1/2, 7).
pub const AREA: f32 = 2.641_315_3;
/// Guard: against ln 0.
pub const LEAST_INSIDE: f32 = 1e-3;
/// Guard: against work on what hardly counts: a feature whose measurements are below this share of its evidence leaves them to
/// the later ones as they are.
pub const LEAST_EVIDENCE: f32 = 0.1;

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
    measurements: &'a Vec<Measurement, PATHS>,
    height_m: f32,
    bias: (f32, f32),
    /// Least variance of the measurements, square metres, which all count as having: next to a place's it is small.
    least_m2: f32,
    clutter: Clutter,
}

impl<'a, const PATHS: usize> Sweep<'a, PATHS> {
    /// Of these measurements of an anchor that hangs so high above the tag, metres, whose ranges have a `bias` of this mean, metres, and
    /// variance, square metres; `clutter` are the intensities of what belongs to nothing.
    pub fn new(
        measurements: &'a Vec<Measurement, PATHS>,
        height_m: f32,
        bias: (f32, f32),
        clutter: Clutter,
    ) -> Self {
        let least_m2 = measurements.iter().fold(f32::INFINITY, |least, z| smaller(z.variance_m2, least));
        Self { measurements, height_m, bias, least_m2, clutter }
    }
}

/// Where the arcs of a cycle begin, as a share of an arc, and whose turn it is, as a share of all scans.
pub(super) fn turn(cycle: u32) -> [f32; 2] {
    [GOLDEN, PLASTIC].map(|ratio| {
        let turns = (cycle % 1024) as f32 * ratio;
        turns - (turns as u32) as f32
    })
}

/// The places that the sweeps propose, at most [`PROPOSED`], the best; `landmarks` gives those of a sweep, the direct path first,
/// `inside` the probability that a place, known within a deviation (metres), may be one of a tag. Proposed is by one sweep, the first with
/// a strong range from this share of them on; where arcs begin is a share of an arc. What is done is added to the `work`.
#[inline(never)]
pub fn propose<'a, const PATHS: usize, L: Iterator<Item = Landmark>>(
    sweeps: &[Sweep<'a, PATHS>],
    landmarks: impl Fn(usize) -> L,
    inside: impl Fn([f32; 2], f32) -> f32,
    [phase, turn]: [f32; 2],
    work: &mut Work,
) -> Vec<Proposal, PROPOSED> {
    let mut best: Vec<Proposal, PROPOSED> = Vec::new();
    let first = (turn * sweeps.len() as f32) as usize;
    for (index, sweep) in sweeps.iter().enumerate().cycle().skip(first).take(sweeps.len()) {
        if !best.is_empty() {
            break;
        }
        let Some(direct) = landmarks(index).next() else { continue };
        let mut after_m = 0.0;
        for _ in 0..EARLIEST {
            let mut next: Option<&Measurement> = None;
            for measurement in sweep.measurements {
                if measurement.range_m > after_m
                    && measurement.is_strong(STRONG)
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
                    evidence_nat += weigh(position_m, across_m * across_m, sweep, landmarks(other), work);
                }
                let variance_m2 = [PLACE_M * PLACE_M, across_m * across_m];
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
    work: &mut Work,
) -> f32 {
    let (bias_m, bias_m2) = sweep.bias;
    let mut background: Option<(Background<PATHS>, f32)> = None;
    let mut nu = [1.0; PATHS];
    let mut terms = [0.0; PATHS];
    let mut of_background_nat = 0.0;
    let mut evidence = LnProduct::ONE;
    let (mut sources, mut within) = (0, 0);
    for landmark in landmarks {
        sources += 1;
        let Landmark { position_m: [lx, ly], covariance_m2: [xx, yx, yy], detection } = landmark;
        let (dx, dy) = (x - lx, y - ly);
        let distance2 = dx * dx + dy * dy + sweep.height_m * sweep.height_m;
        let own_m2 = (dx * dx * xx + 2.0 * (dx * dy * yx) + dy * dy * yy) / larger(distance2, 1e-6);
        let range_m = sqrt(distance2) + bias_m;
        let variance_m2 = place_m2 + bias_m2 + own_m2;
        // The direct path is the first.
        let (background, direct_m) = &*background.get_or_insert_with(|| {
            let direct =
                Expectation { range_m, variance_m2, existence: 1.0, detection, lateness: Lateness::NONE };
            let background = Background::new(sweep.measurements, &direct, &sweep.clutter, &[1.0; PATHS]);
            of_background_nat = background.evidence_nat(sweep.measurements.len());
            (background, range_m)
        });
        if range_m < direct_m - PLACE_M {
            continue;
        }
        let variance = variance_m2 + sweep.least_m2;
        let reach_m2 = REACH2 * variance;
        let mut most_per_m = None;
        let mut sum = 0.0;
        let densities = sweep.measurements.iter().zip(background.per_m()).zip(terms.iter_mut().zip(&nu));
        for ((measurement, per_m), (term, nu)) in densities {
            let innovation = measurement.range_m - range_m;
            let squared = innovation * innovation;
            *term = 0.0;
            if squared < reach_m2 {
                let most_per_m = *most_per_m.get_or_insert_with(|| detection / (AREA * sqrt(variance)));
                let shape = 1.0 - squared / reach_m2;
                let shape2 = shape * shape;
                *term = most_per_m * nu * (shape2 * shape2 * shape2) / per_m;
                sum += *term;
                within += 1;
            }
        }
        let own = 1.0 - detection + sum;
        evidence.times(own);
        if sum > LEAST_EVIDENCE * own {
            for (nu, term) in nu.iter_mut().zip(&terms) {
                if *term > 0.0 {
                    *nu *= larger(1.0 - term / own, 0.0);
                }
            }
        }
    }
    let [source, beside] = PLACE;
    work.add(source, sources);
    work.add(beside, within);
    work.add(BACKGROUND, sweep.measurements.len() * sweep.measurements.len());
    of_background_nat + evidence.ln()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::Cell;

    const CLUTTER: Clutter = Clutter { all_per_m: 0.2, false_alarms_per_m: 0.03 };
    /// Two anchors, and the image of the first in a wall along y = 6.
    const ANCHORS: [[f32; 2]; 2] = [[0.0, 0.0], [9.0, 1.0]];
    const IMAGE: [f32; 2] = [0.0, 12.0];
    const STD_M: f32 = 0.05;

    /// Evenly distributed from 0 to 1, and a normal variable.
    fn uniform(state: &mut u64) -> f64 {
        *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (*state >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn normal(state: &mut u64) -> f32 {
        let radius = (-2.0 * (1.0 - uniform(state)).ln()).sqrt();
        (radius * (std::f64::consts::TAU * uniform(state)).cos()) as f32
    }

    fn measurement(range_m: f32, false_alarm: f32) -> Measurement {
        Measurement { range_m, variance_m2: STD_M * STD_M, sinr: 100.0, energy: 1.0, false_alarm }
    }

    fn landmarks(sweep: usize) -> impl Iterator<Item = Landmark> {
        let direct = Landmark { position_m: ANCHORS[sweep], covariance_m2: [0.0; 3], detection: 0.9 };
        let image = Landmark { position_m: IMAGE, covariance_m2: [0.01, 0.002, 0.02], detection: 0.5 };
        core::iter::once(direct).chain((sweep == 0).then_some(image))
    }

    fn distance([ax, ay]: [f32; 2], [bx, by]: [f32; 2]) -> f32 {
        (ax - bx).hypot(ay - by)
    }

    /// What both anchors deliver of a tag here, with one weak false alarm each.
    fn scans(place_m: [f32; 2], state: &mut u64) -> [Vec<Measurement, 4>; 2] {
        let mut scans = [Vec::new(), Vec::new()];
        for (scan, anchor) in scans.iter_mut().zip(ANCHORS) {
            let noisy = distance(place_m, anchor) + STD_M * normal(state);
            scan.push(measurement(noisy, 1e-4)).unwrap();
            scan.push(measurement(1.0 + 14.0 * uniform(state) as f32, 0.9)).unwrap();
        }
        let noisy = distance(place_m, IMAGE) + STD_M * normal(state);
        scans[0].push(measurement(noisy, 0.1)).unwrap();
        scans
    }

    fn sweeps(scans: &[Vec<Measurement, 4>; 2]) -> [Sweep<'_, 4>; 2] {
        let sweep = |measurements| Sweep::new(measurements, 0.0, (0.0, 0.0), CLUTTER);
        [sweep(&scans[0]), sweep(&scans[1])]
    }

    /// Whether a place is within three deviations of a proposal.
    fn covers(proposal: &Proposal, [x, y]: [f32; 2]) -> bool {
        let ([px, py], [ux, uy], [along, across]) =
            (proposal.position_m, proposal.radial, proposal.variance_m2);
        let (dx, dy) = (x - px, y - py);
        let (a, b) = (ux * dx + uy * dy, ux * dy - uy * dx);
        a * a / along + b * b / across < 9.0
    }

    #[test]
    fn the_true_place_is_among_the_proposals() {
        let mut state = 3;
        let (mut found, mut first) = (0, 0);
        for cycle in 0..200 {
            let place_m =
                [(-3.0 + 14.0 * uniform(&mut state)) as f32, (-5.0 + 10.5 * uniform(&mut state)) as f32];
            let scans = scans(place_m, &mut state);
            let places = propose(&sweeps(&scans), landmarks, |_, _| 1.0, turn(cycle), &mut Work::default());
            found += usize::from(places.iter().any(|place| covers(place, place_m)));
            let best = places.iter().max_by(|a, b| a.evidence_nat.total_cmp(&b.evidence_nat)).unwrap();
            first += usize::from(covers(best, place_m));
        }
        std::println!("of 200 places, {found} were among the proposals, {first} the best one");
        assert!(found >= 190, "{found}");
    }

    #[test]
    fn no_more_arcs_are_weighed_than_their_number_and_no_more_places_proposed() {
        let mut state = 4;
        let weighed = Cell::new(0);
        let count = |scans: &[Vec<Measurement, 4>; 2], share: f32| {
            weighed.set(0);
            let inside = |_, _| {
                weighed.set(weighed.get() + 1);
                1.0
            };
            let places = propose(&sweeps(scans), landmarks, inside, [0.3, share], &mut Work::default());
            (weighed.get(), places.len())
        };
        let usual = scans([3.0, 2.0], &mut state);
        // Two strong ranges of the first anchor, one of the second; weak ones are not tried.
        assert_eq!(count(&usual, 0.4), (2 * ARCS, PROPOSED));
        assert_eq!(count(&usual, 0.6), (ARCS, PROPOSED));
        let mut many = [Vec::new(), Vec::new()];
        for scan in &mut many {
            for range_m in [7.0, 3.0, 9.0, 5.0] {
                scan.push(measurement(range_m, 1e-4)).unwrap();
            }
        }
        assert_eq!(count(&many, 0.9), (EARLIEST * ARCS, PROPOSED));
        assert_eq!(count(&[Vec::new(), Vec::new()], 0.0), (0, 0));
        let mut weak = usual;
        weak.iter_mut().flatten().for_each(|measurement| measurement.false_alarm = STRONG);
        assert_eq!(count(&weak, 0.0), (0, 0));
        // Of ranges, no strength is known: they are tried, also where the scan whose turn it is has nothing.
        weak[1][0].sinr = 0.0;
        assert_eq!(count(&weak, 0.0), (ARCS, PROPOSED));
    }

    #[test]
    fn places_lie_on_the_circles_of_the_two_shortest_strong_ranges() {
        let mut one: Vec<Measurement, 4> = Vec::new();
        for range_m in [7.0, 3.0, 5.0] {
            one.push(measurement(range_m, 1e-4)).unwrap();
        }
        let sweep = Sweep::new(&one, 1.0, (0.2, 0.0), CLUTTER);
        let places = propose(&[sweep], |_| landmarks(1), |_, _| 1.0, [0.7, 0.0], &mut Work::default());
        assert_eq!(places.len(), PROPOSED);
        for place in &places {
            let radius = distance(place.position_m, ANCHORS[1]);
            let slant = (radius * radius + 1.0).sqrt() + 0.2;
            assert!((slant - 3.0).abs() < 1e-5 || (slant - 5.0).abs() < 1e-5, "{slant}");
            let [ux, uy] = place.radial;
            assert!((ux * radius + ANCHORS[1][0] - place.position_m[0]).abs() < 1e-5);
            assert!((uy * radius + ANCHORS[1][1] - place.position_m[1]).abs() < 1e-5);
            // Of a uniform distribution along the arc.
            let arc = TAU * radius / ARCS as f32;
            assert!((place.variance_m2[1] - arc * arc / 12.0).abs() < 1e-5);
        }
        // A range that is shorter than the anchor is high proposes nothing.
        let low = Sweep { height_m: 5.0, ..sweep };
        assert!(propose(&[low], |_| landmarks(1), |_, _| 1.0, [0.7, 0.0], &mut Work::default()).is_empty());
    }

    /// L of the module's description, in f64.
    fn evidence(place: &Proposal, scans: &[Vec<Measurement, 4>; 2]) -> f64 {
        let mut sum = 0.0;
        for (sweep, measurements) in scans.iter().enumerate() {
            let place_m2 = f64::from(place.variance_m2[1]);
            let [x, y] = place.position_m.map(f64::from);
            let mut nu = std::vec![1.0; measurements.len()];
            let mut direct: Option<(f64, f64)> = None;
            for landmark in landmarks(sweep) {
                let [lx, ly] = landmark.position_m.map(f64::from);
                let [xx, yx, yy] = landmark.covariance_m2.map(f64::from);
                let range = (x - lx).hypot(y - ly);
                let (ux, uy) = ((x - lx) / range, (y - ly) / range);
                let own = place_m2 + ux * ux * xx + 2.0 * ux * uy * yx + uy * uy * yy;
                let (direct_m, direct_m2) = *direct.get_or_insert((range, own));
                let per_m = |z: &Measurement| {
                    let deviation = (direct_m2 + f64::from(z.variance_m2)).sqrt();
                    let later = 1.0 / (1.0 + (-1.702 * (f64::from(z.range_m) - direct_m) / deviation).exp());
                    0.03 * f64::from(z.false_alarm) + 0.17 * later
                };
                if range == direct_m {
                    sum += measurements.iter().map(|z| (per_m(z) / 0.2).ln()).sum::<f64>();
                }
                if range < direct_m - f64::from(PLACE_M) {
                    continue;
                }
                let q = f64::from(landmark.detection);
                let terms: std::vec::Vec<f64> = measurements
                    .iter()
                    .zip(&nu)
                    .map(|(z, nu)| {
                        let s = own + f64::from(z.variance_m2);
                        let squared = (f64::from(z.range_m) - range).powi(2) / s;
                        let shape = (1.0 - squared / 15.0).max(0.0).powi(6);
                        q * nu * shape / ((15.0 * s).sqrt() * 92_160.0 / 135_135.0) / per_m(z)
                    })
                    .collect();
                let seen: f64 = terms.iter().sum();
                let all = 1.0 - q + seen;
                sum += all.ln();
                if seen > f64::from(LEAST_EVIDENCE) * all {
                    nu.iter_mut().zip(&terms).for_each(|(nu, term)| *nu *= 1.0 - term / all);
                }
            }
        }
        sum
    }

    #[test]
    fn the_density_of_a_place_has_its_variance_and_is_near_the_normal_one() {
        let steps = 100_000;
        let step = 2.0 * f64::from(REACH2).sqrt() / f64::from(steps);
        let (mut sum, mut variance, mut apart) = (0.0, 0.0, 0.0_f64);
        for n in 0..steps {
            let x = step * (f64::from(n) + 0.5) - f64::from(REACH2).sqrt();
            let density = (1.0 - x * x / f64::from(REACH2)).powi(6) / f64::from(AREA);
            sum += step * density;
            variance += step * x * x * density;
            apart = apart.max((density - (-0.5 * x * x).exp() / std::f64::consts::TAU.sqrt()).abs());
        }
        assert!((sum - 1.0).abs() < 1e-6 && (variance - 1.0).abs() < 1e-6, "{sum} {variance}");
        // Of 0.4.
        assert!(apart < 0.025, "{apart}");
    }

    #[test]
    fn evidence_is_that_of_the_features_one_by_one() {
        let mut state = 5;
        let mut worst = 0.0_f64;
        for _ in 0..500 {
            let place_m = [(9.0 * uniform(&mut state)) as f32, (5.0 * uniform(&mut state)) as f32];
            let scans = scans(place_m, &mut state);
            for place in &propose(
                &sweeps(&scans),
                landmarks,
                |_, _| 0.25,
                [0.0; 2].map(|_| uniform(&mut state) as f32),
                &mut Work::default(),
            ) {
                let exact = evidence(place, &scans) + 0.25_f64.ln();
                worst = worst.max((f64::from(place.evidence_nat) - exact).abs());
            }
        }
        assert!(worst < 1e-3, "{worst}");
    }

    #[test]
    fn the_best_places_are_kept() {
        let mut state = 6;
        for count in [2, 4, 5, 100] {
            let mut best = Vec::new();
            let mut all: std::vec::Vec<f32> = (0..count).map(|_| normal(&mut state)).collect();
            for evidence_nat in &all {
                let evidence_nat = *evidence_nat;
                let place = Proposal {
                    position_m: [0.0; 2],
                    radial: [1.0, 0.0],
                    variance_m2: [1.0; 2],
                    evidence_nat,
                };
                keep(&mut best, place);
            }
            all.sort_by(|a, b| b.total_cmp(a));
            let mut kept: std::vec::Vec<f32> = best.iter().map(|place| place.evidence_nat).collect();
            kept.sort_by(|a, b| b.total_cmp(a));
            assert_eq!(kept, all[..count.min(PROPOSED)]);
        }
    }

    #[test]
    fn arcs_of_one_cycle_after_the_other_are_spread_evenly() {
        let phases: std::vec::Vec<f32> = (0..1024).map(|cycle| turn(cycle)[0]).collect();
        assert!(phases.iter().all(|phase| (0.0..1.0).contains(phase)));
        // Three distances (Sós 1958): the largest of n is below golden^-2 / n, and never far above the mean.
        let mut worst = 0.0_f32;
        for begin in [0, 100, 900] {
            for count in 1..=124 {
                let mut some = phases[begin..begin + count].to_vec();
                some.sort_by(f32::total_cmp);
                let around = some[0] + 1.0 - some[count - 1];
                let largest = some.windows(2).map(|pair| pair[1] - pair[0]).fold(around, f32::max);
                worst = worst.max(largest * count as f32);
            }
        }
        assert!(worst < 2.62, "{worst}");
        assert_eq!(turn(1024 + 7), turn(7));
    }
}
