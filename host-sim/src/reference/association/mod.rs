//! Association of one anchor's measurements with its features.
//!
//! Feature k (the direct path, then the virtual anchors) has a factor for "no measurement" and one for each
//! measurement m, with existence r_k, detection probability Pd, and lambda_m the intensity of everything unknown there:
//!
//! psi_k0 = r_k (1 - Pd) + 1 - r_k, psi_km = r_k Pd N(z_m; mean_k, S_km) / lambda_m.
//!
//! Of lambda, a share is false alarms; the rest comes after the direct path only. c_m, the claim on m, is by how much the
//! candidates of the discovery make it more probable than lambda alone:
//!
//! lambda_m = lambda_fa f_m + (lambda - lambda_fa) p(z_m > direct path) + lambda (c_m - 1).
//!
//! Features that want the same measurements form a cluster, solved exactly in [`exact`] or, where it is too large, by
//! messages that go back and forth until they stand still:
//!
//! mu_km = psi_km / (psi_k0 + sum over m' != m of psi_km' nu_m'k),
//! nu_mk = 1 / (1 + sum over k' != k of mu_k'm).
//!
//! Beliefs: p(b_k = m) ~ psi_km nu_mk, p(b_k = 0) ~ psi_k0. The sum over all joint associations is the evidence of the scan; by
//! messages it is Bethe's approximation.
//!
//! Order: a sum that leaves one term out is (the terms before it, summed upwards from the first) + (the terms after
//! it, summed downwards from the last), each starting from its constant (psi_k0 or 1 before, 0 after).

pub mod exact;
pub mod outcome;

use super::Matrix;
use super::lateness::{Lateness, Timing};
use super::outage::weigh;
use super::real::{Real, abs, exp, larger, limited, ln_product, sqrt, square, tau};
use cogmint_core::model::detection::{LEAST_FALSE_ALARM, LOGISTIC};
pub use cogmint_core::perceptor::association::Joint;
use cogmint_core::perceptor::association::background::LARGEST_EXPONENT;
use cogmint_core::perceptor::association::belief_propagation::{MESSAGES, TOLERANCE};
use cogmint_core::perceptor::association::factors::{GATE, LEAST_ABSENT};

/// One path or range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measurement<T> {
    /// Distance, metres.
    pub range_m: T,
    /// Variance, square metres.
    pub variance_m2: T,
    /// Component SINR; 0 if unknown.
    pub sinr: T,
    /// Energy; 0 if unknown.
    pub energy: T,
    /// Density of false alarms of its strength over that of all.
    pub false_alarm: T,
}

impl<T: Real> Measurement<T> {
    /// Whether false alarms so strong have less than this density, of all of them; a range may be anything.
    pub fn is_strong(&self, density: f32) -> bool {
        self.sinr == T::ZERO || self.false_alarm < T::of(density)
    }
}

/// What is expected of a feature.
#[derive(Clone, Copy, Debug)]
pub struct Expectation<T> {
    /// Mean of the range, metres.
    pub range_m: T,
    /// Its variance, square metres.
    pub variance_m2: T,
    /// Probability that the feature exists.
    pub existence: T,
    /// Probability that it is detected if it exists.
    pub detection: T,
    /// How late ranges to it are.
    pub lateness: Lateness<T>,
}

impl<T: Real> Expectation<T> {
    /// What a range says that may be late, were it this feature's; nothing of others.
    pub fn timing(&self, z: &Measurement<T>) -> Option<Timing<T>> {
        let may_be_late = z.sinr == T::ZERO && self.lateness.is_any();
        may_be_late.then(|| self.lateness.timing(z.range_m - self.range_m, self.variance_m2 + z.variance_m2))
    }
}

/// Intensities of measurements of unknown origin, per metre.
#[derive(Clone, Copy, Debug)]
pub struct Clutter<T> {
    /// False alarms.
    pub false_alarms_per_m: T,
    /// False alarms and paths of unmapped virtual anchors.
    pub all_per_m: T,
}

/// Beliefs about one feature.
#[derive(Clone, Debug)]
pub struct Belief<T> {
    /// p(b = 0).
    pub missed: T,
    /// p(b = m).
    pub associated: Vec<T>,
    /// Posterior existence.
    pub existence: T,
    /// Its part in the most probable joint association of its cluster.
    pub joint: Joint,
    /// How much more probable the rest of the frame is if its path is there and was not found.
    pub rest: T,
}

/// The outcome for one anchor.
#[derive(Clone, Debug)]
pub struct Beliefs<T> {
    /// The features, the direct path first.
    pub features: Vec<Belief<T>>,
    /// Probability that each measurement comes from no known feature.
    pub unassociated: Vec<T>,
    /// Rounds of messages; 0 where none were needed.
    pub iterations: usize,
    /// ln of the sum over all joint associations, over that in which everything is clutter of the usual density.
    pub evidence_nat: T,
    /// Probability that all of it is clutter, because the anchor is out.
    pub outage: T,
}

/// Probability that a path is detected: that its `sinr` passes `threshold`, both on normalised energy.
///
/// Q_1(sqrt(2 SINR), sqrt(2 kappa)) (Marcum), by the logistic curve in the difference of its arguments.
pub fn detection_probability<T: Real>(sinr: T, threshold: T) -> T {
    let [sinr, threshold] = [sinr, threshold].map(|x| sqrt(larger(x, T::ZERO)));
    T::ONE / (T::ONE + missed_odds(sinr, threshold))
}

/// (1 - P_d) / P_d from the roots of SINR and threshold.
pub fn missed_odds<T: Real>(sinr_root: T, threshold_root: T) -> T {
    // Order: both constants first.
    let slope = T::of(LOGISTIC) * T::of(std::f32::consts::SQRT_2);
    exp(slope * (threshold_root - sinr_root))
}

/// Whether a measurement lies two deviations or more ahead of a direct path.
pub fn is_earlier<T: Real>(z: &Measurement<T>, direct_m: T, variance_m2: T) -> bool {
    z.range_m < direct_m - T::of(2.0) * sqrt(variance_m2 + z.variance_m2)
}

/// How likely a false alarm is this strong, next to one that just passes the threshold.
pub fn false_alarm<T: Real>(sinr: T, threshold: T) -> T {
    limited(exp(T::of(0.5) * (threshold - sinr)), T::of(LEAST_FALSE_ALARM), T::ONE)
}

/// Associates `measurements`, each with the claim on it, with `features`, of which the first is the direct path.
pub fn associate<T: Real>(
    features: &[Expectation<T>],
    measurements: &[Measurement<T>],
    claims: &[T],
    clutter: &Clutter<T>,
) -> Beliefs<T> {
    let (rows, columns) = (features.len(), measurements.len());

    // The factors.
    let per_m = background_per_m(&features[0], measurements, claims, clutter);
    let mut evidence_nat = ln_product(per_m.iter().map(|per_m| *per_m / clutter.all_per_m));
    let mut absent = Vec::new();
    let mut psi: Matrix<T> = Vec::new();
    for feature in features {
        let missing = feature.existence * (T::ONE - feature.detection) + (T::ONE - feature.existence);
        absent.push(larger(missing, T::of(LEAST_ABSENT)));
        let pairs = measurements.iter().zip(&per_m);
        psi.push(pairs.map(|(measurement, per_m)| likelihood(feature, measurement, *per_m)).collect());
    }
    discount_later_arrivals(&mut psi[0], measurements, clutter, &per_m);
    // Nothing is reflected ahead of the direct path.
    for row in &mut psi[1..] {
        for (factor, z) in row.iter_mut().zip(measurements) {
            if is_earlier(z, features[0].range_m, features[0].variance_m2) {
                *factor = T::ZERO;
            }
        }
    }

    // The clusters.
    let mut exact: Vec<Option<exact::Solution<T>>> = features.iter().map(|_| None).collect();
    let mut loopy = Vec::new();
    // Order: the features to which nothing can belong, then cluster by cluster.
    let mut evidence: Vec<T> = Vec::new();
    let has_any = |k: usize| psi[k].iter().any(|psi| *psi > T::ZERO);
    for k in (0..rows).filter(|&k| !has_any(k)) {
        let (associated, joint) = (vec![T::ZERO; columns], None);
        exact[k] = Some(exact::Solution { missed: T::ONE, associated, joint });
        evidence.push(absent[k]);
    }
    for mut cluster in clusters(&psi).into_iter().filter(|cluster| has_any(cluster[0])) {
        // Stable: equal ranges stay in the order of the features.
        cluster.sort_by(|&a, &b| {
            features[a].range_m.partial_cmp(&features[b].range_m).unwrap_or(core::cmp::Ordering::Equal)
        });
        let rows = cluster.iter().map(|&k| psi[k].clone()).collect();
        match exact::solve(cluster.iter().map(|&k| absent[k]).collect(), rows) {
            Some((solutions, totals)) => {
                evidence.extend(totals);
                for (&k, solution) in cluster.iter().zip(solutions) {
                    exact[k] = Some(solution);
                }
            }
            None => loopy.extend(cluster),
        }
    }
    loopy.sort_unstable();
    evidence_nat += ln_product(evidence);

    // The messages.
    let mut mu = super::zeros::<T>(rows, columns);
    let mut nu = vec![vec![T::ONE; columns]; rows];
    let mut iterations = 0;
    let gated: usize = loopy.iter().map(|&k| psi[k].iter().filter(|psi| **psi > T::ZERO).count()).sum();
    while iterations * gated < MESSAGES && !loopy.is_empty() {
        iterations += 1;
        for &k in &loopy {
            for m in 0..columns {
                let mut before = absent[k];
                for other in 0..m {
                    before += psi[k][other] * nu[k][other];
                }
                let mut after = T::ZERO;
                for other in (m + 1..columns).rev() {
                    after += psi[k][other] * nu[k][other];
                }
                mu[k][m] = psi[k][m] / (before + after);
            }
        }
        let mut moving = false;
        for &k in &loopy {
            for m in 0..columns {
                let mut above = T::ONE;
                for &other in loopy.iter().filter(|&&other| other < k) {
                    above += mu[other][m];
                }
                let mut below = T::ZERO;
                for &other in loopy.iter().rev().filter(|&&other| other > k) {
                    below += mu[other][m];
                }
                let next = T::ONE / (above + below);
                // A message beyond the gate moves nothing.
                if psi[k][m] > T::ZERO && abs(next - nu[k][m]) > T::of(TOLERANCE) * nu[k][m] {
                    moving = true;
                }
                nu[k][m] = next;
            }
        }
        if !moving {
            break;
        }
    }

    // Bethe's evidence: by feature, then by measurement.
    if !loopy.is_empty() {
        let (mut more, mut less) = (Vec::new(), Vec::new());
        for &k in &loopy {
            let mut own = absent[k];
            for m in (0..columns).filter(|&m| psi[k][m] > T::ZERO) {
                own += psi[k][m] * nu[k][m];
                less.push(T::ONE + mu[k][m] * nu[k][m]);
            }
            more.push(own);
        }
        for m in 0..columns {
            let mut sum = T::ONE;
            for &k in loopy.iter().filter(|&&k| psi[k][m] > T::ZERO) {
                sum += mu[k][m];
            }
            if sum > T::ONE {
                more.push(sum);
            }
        }
        evidence_nat += ln_product(more) - ln_product(less);
    }

    // The beliefs.
    let mut beliefs = Vec::new();
    for (k, exact) in exact.into_iter().enumerate() {
        let (missed, associated, joint) = match exact {
            Some(solution) => {
                let joint = solution.joint.map_or(Joint::Missed, Joint::Measurement);
                (solution.missed, solution.associated, joint)
            }
            None => {
                let mut sum = absent[k];
                let mut associated = vec![T::ZERO; columns];
                for m in 0..columns {
                    associated[m] = psi[k][m] * nu[k][m];
                    sum += associated[m];
                }
                for m in 0..columns {
                    associated[m] /= sum;
                }
                (absent[k] / sum, associated, Joint::Unknown)
            }
        };
        // The part of "no measurement" in which the feature exists.
        let undetected = features[k].existence * (T::ONE - features[k].detection) / absent[k];
        let existence = T::ONE - missed * (T::ONE - undetected);
        beliefs.push(Belief { missed, associated, existence, joint, rest: T::ONE });
    }
    let mut unassociated = Vec::new();
    for m in 0..columns {
        // A measurement is of one cluster: either nothing is subtracted or nothing is added.
        let mut free = T::ONE;
        let mut sum = T::ZERO;
        for k in 0..rows {
            if loopy.contains(&k) {
                sum += mu[k][m];
            } else {
                free -= beliefs[k].associated[m];
            }
        }
        unassociated.push(larger(free, T::ZERO) / (T::ONE + sum));
    }
    Beliefs { features: beliefs, unassociated, iterations, evidence_nat, outage: T::ZERO }
}

impl<T: Real> Beliefs<T> {
    /// Beliefs of an anchor that is out with this probability. An outage tells nothing of what there is.
    pub fn doubt(&mut self, outage: T, features: &[Expectation<T>]) {
        (self.evidence_nat, self.outage) = weigh(outage, self.evidence_nat);
        let heard = T::ONE - self.outage;
        for (belief, feature) in self.features.iter_mut().zip(features) {
            belief.missed = T::ONE - heard * (T::ONE - belief.missed);
            belief.existence = feature.existence + heard * (belief.existence - feature.existence);
            for p in &mut belief.associated {
                *p *= heard;
            }
        }
        for free in &mut self.unassociated {
            *free = T::ONE - heard * (T::ONE - *free);
        }
    }
}

/// The features of each cluster: those joined by measurements that two of them can take.
fn clusters<T: Real>(psi: &Matrix<T>) -> Vec<Vec<usize>> {
    let compete = |a: usize, b: usize| (0..psi[a].len()).any(|m| psi[a][m] > T::ZERO && psi[b][m] > T::ZERO);
    let mut clusters: Vec<Vec<usize>> = Vec::new();
    for k in 0..psi.len() {
        // Feature k joins all clusters it competes with into one.
        let (mut joined, apart): (Vec<_>, Vec<_>) =
            clusters.into_iter().partition(|cluster| cluster.iter().any(|&other| compete(k, other)));
        joined.push(vec![k]);
        clusters = apart;
        clusters.push(joined.concat());
    }
    for cluster in &mut clusters {
        cluster.sort_unstable();
    }
    // Order: by their first features.
    clusters.sort_unstable();
    clusters
}

/// psi_km; zero outside the gate.
fn likelihood<T: Real>(feature: &Expectation<T>, measurement: &Measurement<T>, per_m: T) -> T {
    let innovation = measurement.range_m - feature.range_m;
    let variance = feature.variance_m2 + measurement.variance_m2;
    let nis = square(innovation) / variance;
    if let Some(timing) = feature.timing(measurement) {
        let [shortest_m, longest_m] = feature.lateness.gate_m(GATE, sqrt(variance));
        return if innovation > shortest_m && innovation < longest_m {
            feature.existence * feature.detection * timing.per_m / per_m
        } else {
            T::ZERO
        };
    }
    if nis < T::of(GATE) * T::of(GATE) {
        // Order: ((r Pd) exp) / (sqrt lambda).
        let detected = feature.existence * feature.detection;
        detected * exp(T::of(-0.5) * nis) / (sqrt(tau::<T>() * variance) * per_m)
    } else {
        T::ZERO
    }
}

/// lambda_m, per metre, where the direct path is expected so.
pub fn background_per_m<T: Real>(
    direct: &Expectation<T>,
    measurements: &[Measurement<T>],
    claims: &[T],
    clutter: &Clutter<T>,
) -> Vec<T> {
    let Clutter { false_alarms_per_m, all_per_m } = *clutter;
    let most = T::of(LARGEST_EXPONENT);
    let mut background = Vec::new();
    for (z, claim) in measurements.iter().zip(claims) {
        let deviation = sqrt(direct.variance_m2 + z.variance_m2);
        let ahead = T::of(LOGISTIC) * ((direct.range_m - z.range_m) / deviation);
        let later = T::ONE / (T::ONE + exp(limited(ahead, -most, most)));
        let of_scan = false_alarms_per_m * z.false_alarm + (all_per_m - false_alarms_per_m) * later;
        background.push(of_scan + all_per_m * (*claim - T::ONE));
    }
    background
}

/// Nothing that is not in the map is shorter than the direct path: were it measurement m, all that are more than two deviations
/// shorter would be false alarms.
fn discount_later_arrivals<T: Real>(
    psi: &mut [T],
    measurements: &[Measurement<T>],
    clutter: &Clutter<T>,
    per_m: &[T],
) {
    for (factor, z) in psi.iter_mut().zip(measurements) {
        let clearly_shorter = z.range_m - T::of(2.0) * sqrt(z.variance_m2);
        for (other, per_m) in measurements.iter().zip(per_m) {
            if other.range_m < clearly_shorter {
                // Order: the share first.
                *factor *= clutter.false_alarms_per_m * other.false_alarm / *per_m;
            }
        }
    }
}

impl<T: Real> Beliefs<T> {
    /// The most probable association: the joint one where the cluster was solved exactly; else greedily, the most
    /// probable pair of feature and measurement first, as long as it is more probable than that the feature was missed.
    /// Per feature, the index of its measurement.
    pub fn most_probable(&self) -> Vec<Option<usize>> {
        let columns = self.unassociated.len();
        let known = |belief: &Belief<T>| match belief.joint {
            Joint::Measurement(m) => Some(m),
            Joint::Missed | Joint::Unknown => None,
        };
        let mut choice: Vec<Option<usize>> = self.features.iter().map(known).collect();
        let mut taken = vec![false; columns];
        loop {
            let mut best: Option<(usize, usize)> = None;
            let mut most = T::ZERO;
            for k in 0..self.features.len() {
                for m in 0..columns {
                    let p = self.features[k].associated[m];
                    let open = self.features[k].joint == Joint::Unknown && choice[k].is_none();
                    let free = open && !taken[m];
                    // Order: the first of equals.
                    if free && p > self.features[k].missed && (best.is_none() || p > most) {
                        best = Some((k, m));
                        most = p;
                    }
                }
            }
            let Some((k, m)) = best else { return choice };
            choice[k] = Some(m);
            taken[m] = true;
        }
    }

    /// Replaces association probabilities by the most probable association. Existence stays.
    pub fn harden(&mut self) {
        let choice = self.most_probable();
        for k in 0..self.features.len() {
            self.features[k].missed = if choice[k].is_some() { T::ZERO } else { T::ONE };
            for m in 0..self.unassociated.len() {
                self.features[k].associated[m] = if choice[k] == Some(m) { T::ONE } else { T::ZERO };
            }
        }
    }
}
