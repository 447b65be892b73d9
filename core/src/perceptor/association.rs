//! Association: which measurement belongs to which virtual anchor.
//!
//! For one anchor, K features (its direct path and its virtual anchors) face M measurements. Each feature gives
//! rise to at most one measurement and each measurement comes from at most one feature; the rest is clutter.
//! Loopy belief propagation (Williams and Lau) on
//!
//! psi_k0 = r_k (1 - Pd) + 1 - r_k, psi_km = r_k Pd N(z_m; mean_k, S_km) / lambda,
//!
//! with the messages mu_km = psi_km / (psi_k0 + sum_{m' != m} psi_km' nu_m'k) and
//! nu_mk = 1 / (1 + sum_{k' != k} mu_k'm), gives p(b_k = m) ~ psi_km nu_mk. Sums that leave one term out are
//! formed from the terms before and after it, never by subtraction, so no digits are lost.
//!
//! The direct path is the shortest: measurements below it can only be false alarms, not paths of virtual
//! anchors yet unmapped. With lambda the intensity of both and lambda_fa that of false alarms alone, each
//! measurement clearly shorter than m costs the hypothesis "m is the direct path" a factor lambda_fa / lambda.

use crate::real::{abs, exp, larger, sqrt};
use heapless::Vec;

/// Beyond this many standard deviations a measurement cannot belong to a feature.
const GATE: f32 = 4.0;
/// Relative change of every message below which the iteration has converged.
const TOLERANCE: f32 = 1e-4;
/// Iteration cap.
const ITERATIONS: usize = 60;

/// A measurement as association and filter see it.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Measurement {
    /// Distance, metres.
    pub range_m: f32,
    /// Variance, square metres.
    pub variance_m2: f32,
    /// Component SINR where the measurement is an estimated path; 0 where nothing is known of it.
    pub sinr: f32,
    /// Energy of the path, squared unit of the samples; 0 where nothing is known of it.
    pub energy: f32,
}

/// What is expected of one feature before the measurements arrive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Expectation {
    /// Expected range, metres.
    pub range_m: f32,
    /// Variance of the expected range, square metres, measurement noise not included.
    pub variance_m2: f32,
    /// Probability that the feature exists.
    pub existence: f32,
    /// Probability that an existing feature is detected.
    pub detection: f32,
}

/// Intensities of measurements that come from no known feature, per metre of range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clutter {
    /// False alarms.
    pub false_alarms_per_m: f32,
    /// False alarms and paths of virtual anchors not in the map.
    pub all_per_m: f32,
}

/// Which association the state filter gets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Mode {
    /// Every measurement, weighted by its association probability (the default: a wrong hard decision between
    /// two close features costs more than a blurred one).
    Soft,
    /// The most probable association, conflicts repaired greedily (as published).
    Map,
}

/// Beliefs about one feature.
#[derive(Clone, Copy, Debug)]
pub struct Belief<const PATHS: usize> {
    /// p(b = 0): the feature gave no measurement.
    pub missed: f32,
    /// p(b = m) for measurement m.
    pub associated: [f32; PATHS],
    /// Posterior probability that the feature exists.
    pub existence: f32,
}

/// One feature's row of factors and messages.
#[derive(Clone, Copy, Debug)]
struct Row<const PATHS: usize> {
    absent: f32,
    psi: [f32; PATHS],
    nu: [f32; PATHS],
    mu: [f32; PATHS],
    /// Running sum over the rows before this one.
    above: [f32; PATHS],
}

/// The outcome for one anchor: `direct` path first, then its virtual anchors in the order given.
#[derive(Clone, Debug)]
pub struct Beliefs<const VAS: usize, const PATHS: usize> {
    /// The physical anchor's direct path.
    pub direct: Belief<PATHS>,
    /// The anchor's virtual anchors, in the order given.
    pub virtual_anchors: Vec<Belief<PATHS>, VAS>,
    /// Probability that measurement m comes from no known feature.
    pub unassociated: [f32; PATHS],
    /// Iterations used.
    pub iterations: usize,
}

impl<const VAS: usize, const PATHS: usize> Beliefs<VAS, PATHS> {
    /// Beliefs of all features, the direct path first.
    pub fn features(&self) -> impl Iterator<Item = &Belief<PATHS>> {
        core::iter::once(&self.direct).chain(self.virtual_anchors.iter())
    }

    /// The most probable association: feature by feature in decreasing certainty, each takes its most probable
    /// measurement not taken yet if that is more probable than having none.
    ///
    /// Returns, per feature (the direct path first), the index of its measurement.
    pub fn most_probable(&self) -> (Option<usize>, Vec<Option<usize>, VAS>) {
        let mut direct = None;
        let mut virtual_anchors: Vec<Option<usize>, VAS> = Vec::new();
        for _ in &self.virtual_anchors {
            // Capacities are equal: every push succeeds.
            let _ = virtual_anchors.push(None);
        }
        let mut taken = [false; PATHS];
        // Each pass assigns the most certain free pair; the loop ends when no pair beats its feature's "missed".
        for _ in 0..PATHS {
            let mut best: Option<(usize, usize, f32)> = None;
            for (k, belief) in self.features().enumerate() {
                let assigned = match k.checked_sub(1) {
                    None => direct.is_some(),
                    Some(slot) => virtual_anchors.get(slot).is_some_and(Option::is_some),
                };
                if assigned {
                    continue;
                }
                for (m, (&p, &is_taken)) in belief.associated.iter().zip(&taken).enumerate() {
                    if !is_taken && p > belief.missed && best.is_none_or(|(_, _, most)| p > most) {
                        best = Some((k, m, p));
                    }
                }
            }
            let Some((k, m, _)) = best else { break };
            if let Some(flag) = taken.get_mut(m) {
                *flag = true;
            }
            match k.checked_sub(1) {
                None => direct = Some(m),
                Some(slot) => {
                    if let Some(choice) = virtual_anchors.get_mut(slot) {
                        *choice = Some(m);
                    }
                }
            }
        }
        (direct, virtual_anchors)
    }
}

impl<const VAS: usize, const PATHS: usize> Beliefs<VAS, PATHS> {
    /// Replaces the association probabilities by the most probable association: ones and zeros. Existence
    /// stays what the soft beliefs made it.
    pub fn harden(&mut self) {
        let (direct, virtual_anchors) = self.most_probable();
        let harden = |belief: &mut Belief<PATHS>, choice: Option<usize>| {
            belief.missed = if choice.is_some() { 0.0 } else { 1.0 };
            for (m, p) in belief.associated.iter_mut().enumerate() {
                *p = if choice == Some(m) { 1.0 } else { 0.0 };
            }
        };
        harden(&mut self.direct, direct);
        for (belief, choice) in self.virtual_anchors.iter_mut().zip(&virtual_anchors) {
            harden(belief, *choice);
        }
    }
}

/// Associates one anchor's `measurements` with its direct path and its virtual anchors.
pub fn associate<const VAS: usize, const PATHS: usize>(
    direct: &Expectation,
    virtual_anchors: &Vec<Expectation, VAS>,
    measurements: &Vec<Measurement, PATHS>,
    clutter: &Clutter,
) -> Beliefs<VAS, PATHS> {
    let mut direct_row = Row::new(direct, measurements, clutter);
    direct_row.discount_later_arrivals(measurements, clutter);
    let mut rows: Vec<Row<PATHS>, VAS> = Vec::new();
    for expectation in virtual_anchors {
        // Capacities are equal: every push succeeds.
        let _ = rows.push(Row::new(expectation, measurements, clutter));
    }
    let count = measurements.len();
    let mut iterations = 0;
    while iterations < ITERATIONS {
        iterations += 1;
        direct_row.send_to_measurements(count);
        for row in &mut rows {
            row.send_to_measurements(count);
        }
        if !send_to_features(&mut direct_row, &mut rows, count) {
            break;
        }
    }
    let mut unassociated = [0.0; PATHS];
    for (m, free) in unassociated.iter_mut().enumerate().take(count) {
        let mut sum = 1.0;
        for row in core::iter::once(&direct_row).chain(rows.iter()) {
            sum += row.mu.get(m).copied().unwrap_or(0.0);
        }
        *free = 1.0 / sum;
    }
    let mut beliefs = Beliefs {
        direct: direct_row.belief(direct, count),
        virtual_anchors: Vec::new(),
        unassociated,
        iterations,
    };
    for (row, expectation) in rows.iter().zip(virtual_anchors) {
        let _ = beliefs.virtual_anchors.push(row.belief(expectation, count));
    }
    beliefs
}

/// The messages nu from every measurement to every feature; true while any still moves.
fn send_to_features<const VAS: usize, const PATHS: usize>(
    direct: &mut Row<PATHS>,
    rows: &mut Vec<Row<PATHS>, VAS>,
    count: usize,
) -> bool {
    let mut sums = [1.0; PATHS];
    for row in core::iter::once(&mut *direct).chain(rows.iter_mut()) {
        for ((above, sum), mu) in row.above.iter_mut().zip(&mut sums).zip(&row.mu).take(count) {
            *above = *sum;
            *sum += mu;
        }
    }
    let mut below = [0.0; PATHS];
    let mut moving = false;
    for row in rows.iter_mut().rev().chain(core::iter::once(direct)) {
        for (((nu, above), sum), mu) in
            row.nu.iter_mut().zip(&row.above).zip(&mut below).zip(&row.mu).take(count)
        {
            let next = 1.0 / (above + *sum);
            moving |= abs(next - *nu) > TOLERANCE * *nu;
            *nu = next;
            *sum += mu;
        }
    }
    moving
}

impl<const PATHS: usize> Row<PATHS> {
    fn new(expectation: &Expectation, measurements: &Vec<Measurement, PATHS>, clutter: &Clutter) -> Self {
        let mut psi = [0.0; PATHS];
        let scale = expectation.existence * expectation.detection / clutter.all_per_m;
        for (factor, measurement) in psi.iter_mut().zip(measurements) {
            let innovation = measurement.range_m - expectation.range_m;
            let variance = expectation.variance_m2 + measurement.variance_m2;
            let nis = innovation * innovation / variance;
            if nis < GATE * GATE {
                *factor = scale * exp(-0.5 * nis) / sqrt(crate::real::TAU * variance);
            }
        }
        let absent = expectation.existence * (1.0 - expectation.detection) + (1.0 - expectation.existence);
        // A feature that cannot be missed would leave no room for lost paths.
        Self { absent: larger(absent, 1e-6), psi, nu: [1.0; PATHS], mu: [0.0; PATHS], above: [0.0; PATHS] }
    }

    /// First-arrival rule (see the module's head); two deviations count as clearly shorter.
    fn discount_later_arrivals(&mut self, measurements: &Vec<Measurement, PATHS>, clutter: &Clutter) {
        let cost = clutter.false_alarms_per_m / clutter.all_per_m;
        for (factor, measurement) in self.psi.iter_mut().zip(measurements) {
            let clearly_shorter = measurement.range_m - 2.0 * sqrt(measurement.variance_m2);
            for other in measurements {
                if other.range_m < clearly_shorter {
                    *factor *= cost;
                }
            }
        }
    }

    /// The messages mu from this feature to every measurement.
    fn send_to_measurements(&mut self, count: usize) {
        let mut before = self.absent;
        for ((mu, psi), nu) in self.mu.iter_mut().zip(&self.psi).zip(&self.nu).take(count) {
            *mu = before;
            before += psi * nu;
        }
        let mut after = 0.0;
        let reversed = self.mu.iter_mut().zip(&self.psi).zip(&self.nu).take(count);
        for ((mu, psi), nu) in reversed.rev() {
            *mu = psi / (*mu + after);
            after += psi * nu;
        }
    }

    fn belief(&self, expectation: &Expectation, count: usize) -> Belief<PATHS> {
        let mut associated = [0.0; PATHS];
        let mut sum = self.absent;
        for ((p, psi), nu) in associated.iter_mut().zip(&self.psi).zip(&self.nu).take(count) {
            *p = psi * nu;
            sum += *p;
        }
        for p in associated.iter_mut().take(count) {
            *p /= sum;
        }
        let missed = self.absent / sum;
        // Of the mass on "missed", the part in which the feature exists but was not detected.
        let undetected = expectation.existence * (1.0 - expectation.detection) / self.absent;
        Belief { missed, associated, existence: 1.0 - missed * (1.0 - undetected) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn expectation(range_m: f32, deviation_m: f32) -> Expectation {
        Expectation { range_m, variance_m2: deviation_m * deviation_m, existence: 1.0, detection: 0.95 }
    }

    fn measurement(range_m: f32, deviation_m: f32) -> Measurement {
        Measurement { range_m, variance_m2: deviation_m * deviation_m, sinr: 0.0, energy: 0.0 }
    }

    /// Exact marginals by enumeration of every joint association, in f64, for one feature list.
    fn enumerate(psi: &[(f64, [f64; 4])], measurements: usize) -> [[f64; 5]; 4] {
        fn recurse(
            psi: &[(f64, [f64; 4])],
            measurements: usize,
            choice: &mut [usize; 4],
            k: usize,
            weight: f64,
            marginals: &mut [[f64; 5]; 4],
        ) {
            if k == psi.len() {
                for (feature, &m) in choice.iter().enumerate().take(k) {
                    marginals[feature][m] += weight;
                }
                return;
            }
            choice[k] = 0;
            recurse(psi, measurements, choice, k + 1, weight * psi[k].0, marginals);
            for m in 0..measurements {
                if choice[..k].contains(&(m + 1)) || psi[k].1[m] == 0.0 {
                    continue;
                }
                choice[k] = m + 1;
                recurse(psi, measurements, choice, k + 1, weight * psi[k].1[m], marginals);
            }
        }
        let mut marginals = [[0.0; 5]; 4];
        recurse(psi, measurements, &mut [0; 4], 0, 1.0, &mut marginals);
        for row in &mut marginals {
            let sum: f64 = row.iter().sum();
            if sum > 0.0 {
                row.iter_mut().for_each(|p| *p /= sum);
            }
        }
        marginals
    }

    #[test]
    fn the_published_vector_is_reproduced() {
        // Deviations differ per feature there, so each feature's own is moved into its prior variance.
        let features = [(3.0, 0.02, 0.03), (5.2, 0.05, 0.05), (5.6, 0.05, 0.08)];
        let z = [3.02, 5.38, 9.0];
        let base = 0.01;
        let with = |(range, prior, noise): (f32, f32, f32)| Expectation {
            variance_m2: prior * prior + noise * noise - base * base,
            ..expectation(range, 0.0)
        };
        let mut others: Vec<Expectation, 4> = Vec::new();
        others.push(with(features[1])).unwrap();
        others.push(with(features[2])).unwrap();
        let mut measurements: Vec<Measurement, 4> = Vec::new();
        for range in z {
            measurements.push(measurement(range, base)).unwrap();
        }
        let density = 1.0 / 30.0;
        let clutter = Clutter { false_alarms_per_m: density, all_per_m: density };
        let beliefs = associate(&with(features[0]), &others, &measurements, &clutter);
        let expected =
            [[0.000185, 0.999815, 0.0, 0.0], [0.559434, 0.0, 0.440566, 0.0], [0.444064, 0.0, 0.555936, 0.0]];
        for (belief, row) in beliefs.features().zip(expected) {
            assert!((belief.missed - row[0]).abs() < 1e-5, "{} {}", belief.missed, row[0]);
            for (p, q) in belief.associated.iter().zip(&row[1..]) {
                assert!((p - q).abs() < 1e-5, "{p} {q}");
            }
        }
        for (p, q) in beliefs.unassociated.iter().zip([0.000185, 0.003498, 1.0]) {
            assert!((p - q).abs() < 1e-5, "{p} {q}");
        }
        let (direct, rest) = beliefs.most_probable();
        assert_eq!((direct, rest.as_slice()), (Some(0), [None, Some(1)].as_slice()));
    }

    #[test]
    fn well_separated_problems_agree_with_enumeration() {
        let mut state = 1_u32;
        let mut uniform = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / 16_777_216.0
        };
        let mut worst = Vec::<f64, 512>::new();
        for _ in 0..500 {
            let density = 1.0 / 30.0;
            let clutter = Clutter { false_alarms_per_m: density, all_per_m: density };
            let mut features: Vec<Expectation, 4> = Vec::new();
            let mut measurements: Vec<Measurement, 4> = Vec::new();
            for _ in 0..4 {
                let range = 10.0 * uniform() + 1.0;
                features.push(expectation(range, 0.05)).unwrap();
                measurements.push(measurement(range + 0.3 * (uniform() - 0.5), 0.1)).unwrap();
            }
            let (direct, rest) = features.split_first().unwrap();
            let rest: Vec<Expectation, 4> = rest.iter().copied().collect();
            let beliefs = associate(direct, &rest, &measurements, &clutter);
            let psi: std::vec::Vec<(f64, [f64; 4])> = features
                .iter()
                .map(|feature| {
                    let mut row = [0.0; 4];
                    for (factor, z) in row.iter_mut().zip(&measurements) {
                        let variance = f64::from(feature.variance_m2 + z.variance_m2);
                        let nis = f64::from(z.range_m - feature.range_m).powi(2) / variance;
                        if nis < 16.0 {
                            *factor =
                                0.95 * (-0.5 * nis).exp() / (core::f64::consts::TAU * variance).sqrt() * 30.0;
                        }
                    }
                    (0.05, row)
                })
                .collect();
            let exact = enumerate(&psi, 4);
            let mut error: f64 = 0.0;
            for (belief, row) in beliefs.features().zip(&exact) {
                error = error.max((f64::from(belief.missed) - row[0]).abs());
            }
            worst.push(error).unwrap();
        }
        worst.sort_unstable_by(f64::total_cmp);
        assert!(worst[250] < 0.01, "median {}", worst[250]);
    }

    #[test]
    fn without_measurements_existence_decays_and_nothing_is_associated() {
        let direct = Expectation { existence: 1.0, ..expectation(3.0, 0.1) };
        let mut others: Vec<Expectation, 2> = Vec::new();
        others.push(Expectation { existence: 0.5, ..expectation(4.0, 0.1) }).unwrap();
        let clutter = Clutter { false_alarms_per_m: 0.03, all_per_m: 0.03 };
        let beliefs = associate::<2, 4>(&direct, &others, &Vec::new(), &clutter);
        assert_eq!(beliefs.direct.missed, 1.0);
        let exact = 0.5 * 0.05 / (0.5 * 0.05 + 0.5);
        assert!((beliefs.virtual_anchors[0].existence - exact).abs() < 1e-6);
        assert_eq!(beliefs.most_probable().0, None);
    }
}
