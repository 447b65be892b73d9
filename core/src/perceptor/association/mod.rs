//! Association: which measurement belongs to which virtual anchor.
//!
//! For one anchor, K features (its direct path and its virtual anchors) face M measurements. Each feature gives
//! rise to at most one measurement and each measurement comes from at most one feature; the rest is clutter. A
//! joint association b has the probability ~ prod_k psi_{k, b_k}, with
//!
//! psi_k0 = r_k (1 - Pd) + 1 - r_k, psi_km = r_k Pd N(z_m; mean_k, S_km) / lambda_m, 0 beyond the gate,
//!
//! lambda_m being the density of the background at the measurement ([`background`]).
//!
//! Features that compete for measurements form clusters, each a problem of its own. A cluster is solved exactly
//! (marginals and the most probable joint association) as long as the fixed memory suffices, which covers all of
//! three features by three measurements and nearly all that occur; the others go through loopy belief propagation.
//!
//! The direct path is the shortest: measurements below it can only be false alarms, not paths of virtual anchors, mapped or
//! not ([`background`]): those below where it is expected, and, were it measurement m, those clearly below m. No virtual anchor
//! gets one that is clearly shorter than the direct path is expected to be, because
//! a map that is wrong would then explain away that the tag is elsewhere.
//!
//! The sum over all joint associations is the evidence of the scan for the place that it was compared at, of loopy clusters by
//! Bethe's approximation. It is relative to clutter of the usual density, which is the same for all places.

pub mod background;
pub mod belief_propagation;
pub mod exact;
pub mod factors;
pub mod outage;
pub mod outcome;

use super::expectation::Expectation;
use crate::model::measurement::Measurement;
use crate::model::work::{GATED, Work};
use crate::real::{LnProduct, larger};
use crate::snapshot::{Sink, Written, written};
use background::Background;
use exact::{STATES, Trellis};
use factors::{Rows, Stage, members};
use heapless::Vec;
use outage::weigh;

/// Which association the state filter gets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Mode {
    /// Every measurement, weighted by its association probability (the default: a wrong hard decision between
    /// two close features costs more than a blurred one).
    Soft,
    /// The most probable joint association (as published); in clusters too large for it, the most probable pairs
    /// first, conflicts repaired greedily.
    Map,
}

/// What association assumes.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct AssociationSettings {
    /// Soft or most probable.
    pub mode: Mode,
    /// Probability that an existing feature is detected (0.01 to 0.999).
    pub detection_probability: f32,
    /// Mean number of false alarms per anchor and cycle (1e-3 to 100), uniform up to the longest range.
    pub clutter_per_anchor: f32,
    /// Expected number of paths per anchor that come from virtual anchors not in the map, at the start (0 to 100);
    /// adapted to what is seen.
    pub unmapped_per_anchor: f32,
    /// How often a virtual anchor ceases to exist or comes back, per second (0 to 10). Larger gives up walls sooner, and takes
    /// them back sooner.
    pub map_change_per_s: f32,
}

impl AssociationSettings {
    /// Those of a tracker that is not started.
    pub(crate) const NONE: Self = Self {
        mode: Mode::Soft,
        detection_probability: 0.0,
        clutter_per_anchor: 0.0,
        unmapped_per_anchor: 0.0,
        map_change_per_s: 0.0,
    };
}

/// What the most probable joint association of its cluster gives a feature.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Joint {
    /// The cluster was too large to tell, or nobody asked, as in [`Mode::Soft`] nobody does.
    Unknown,
    /// No measurement.
    Missed,
    /// The measurement of this index.
    Measurement(usize),
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
    /// Its part in the most probable joint association.
    pub joint: Joint,
    /// How much more probable the rest of the frame is if its path is there and was not found; 1 where that says nothing.
    pub rest: f32,
}

/// The outcome for one anchor: `direct` path first, then its virtual anchors in the order given.
#[derive(Clone, Debug)]
pub struct Beliefs<const SOURCES: usize, const PATHS: usize> {
    /// The physical anchor's direct path.
    pub direct: Belief<PATHS>,
    /// The anchor's virtual anchors, in the order given.
    pub virtual_anchors: Vec<Belief<PATHS>, SOURCES>,
    /// Probability that measurement m comes from no known feature.
    pub unassociated: [f32; PATHS],
    /// Iterations of belief propagation; 0 where every cluster was solved exactly.
    pub iterations: usize,
    /// ln of the sum over all joint associations, over that in which everything is clutter of the usual density.
    pub evidence_nat: f32,
    /// Probability that the anchor is out: that all of it is clutter.
    pub outage: f32,
    /// What the solutions of the clusters have cost.
    pub work: Work,
}

impl<const SOURCES: usize, const PATHS: usize> Beliefs<SOURCES, PATHS> {
    /// Beliefs of all features, the direct path first.
    pub fn features(&self) -> impl Iterator<Item = &Belief<PATHS>> + Clone {
        core::iter::once(&self.direct).chain(self.virtual_anchors.iter())
    }

    fn features_mut(&mut self) -> impl Iterator<Item = &mut Belief<PATHS>> {
        core::iter::once(&mut self.direct).chain(&mut self.virtual_anchors)
    }

    fn get_mut(&mut self, feature: usize) -> Option<&mut Belief<PATHS>> {
        match feature.checked_sub(1) {
            None => Some(&mut self.direct),
            Some(slot) => self.virtual_anchors.get_mut(slot),
        }
    }

    /// The most probable association: the joint one where the cluster was solved exactly. Among the other features,
    /// pair by pair in decreasing certainty, each takes its most probable measurement not taken yet if that is more
    /// probable than having none.
    ///
    /// Returns, per feature (the direct path first), the index of its measurement.
    #[inline(never)]
    pub fn most_probable(&self) -> (Option<usize>, Vec<Option<usize>, SOURCES>) {
        let known = |belief: &Belief<PATHS>| match belief.joint {
            Joint::Measurement(m) => Some(m),
            Joint::Missed | Joint::Unknown => None,
        };
        let mut direct = known(&self.direct);
        let mut virtual_anchors: Vec<Option<usize>, SOURCES> = Vec::new();
        for belief in &self.virtual_anchors {
            // Capacities are equal: every push succeeds.
            let _ = virtual_anchors.push(known(belief));
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
                if assigned || belief.joint != Joint::Unknown {
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

impl<const SOURCES: usize, const PATHS: usize> Beliefs<SOURCES, PATHS> {
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

    /// Makes them those of an anchor that may be out with this probability: then everything is clutter, and nothing is told of
    /// what exists. `existences` are those before the scan, of all features.
    pub fn doubt(&mut self, outage: f32, existences: impl Iterator<Item = f32>, count: usize) {
        (self.evidence_nat, self.outage) = weigh(outage, self.evidence_nat);
        let heard = 1.0 - self.outage;
        let beliefs = core::iter::once(&mut self.direct).chain(&mut self.virtual_anchors);
        for (belief, existence) in beliefs.zip(existences) {
            belief.missed = 1.0 - heard * (1.0 - belief.missed);
            belief.existence = existence + heard * (belief.existence - existence);
            for associated in &mut belief.associated {
                *associated *= heard;
            }
        }
        for free in self.unassociated.iter_mut().take(count) {
            *free = 1.0 - heard * (1.0 - *free);
        }
    }
}

/// Associates one anchor's `measurements` with its direct path and its virtual anchors, before this background.
pub fn associate<const SOURCES: usize, const PATHS: usize>(
    direct: &Expectation,
    virtual_anchors: &Vec<Expectation, SOURCES>,
    measurements: &Vec<Measurement, PATHS>,
    background: &Background<PATHS>,
) -> Beliefs<SOURCES, PATHS> {
    let mut beliefs = Beliefs::none();
    associate_within(direct, virtual_anchors, measurements, background, STATES, Mode::Map, &mut beliefs);
    beliefs
}

/// As [`associate`], written where the beliefs stay; clusters that need more than `limit` values for an exact solution are not given
/// one, and joint associations are told where the mode needs them.
fn associate_within<const SOURCES: usize, const PATHS: usize>(
    direct: &Expectation,
    virtual_anchors: &Vec<Expectation, SOURCES>,
    measurements: &Vec<Measurement, PATHS>,
    background: &Background<PATHS>,
    limit: usize,
    mode: Mode,
    beliefs: &mut Beliefs<SOURCES, PATHS>,
) {
    let count = measurements.len();
    let mut rows = Rows::empty();
    rows.fill(direct, virtual_anchors, measurements, background);
    beliefs.begin(virtual_anchors.len(), background.evidence_nat(count));
    beliefs.work.add(GATED, rows.iter().fold(0, |sum, row| sum + row.gated.count_ones() as usize));
    solve_clusters(&mut rows, beliefs, limit, mode);
    let mut loopy = [0.0; PATHS];
    if rows.iter().any(|row| row.stage == Stage::Loopy) {
        belief_propagation::propagate(&rows, beliefs, &mut loopy);
    }
    beliefs.conclude(&rows, direct, virtual_anchors, count, &loopy);
}

/// Solves every cluster for which the memory suffices; the others are loopy.
#[inline(never)]
fn solve_clusters<const SOURCES: usize, const PATHS: usize>(
    rows: &mut Rows<SOURCES, PATHS>,
    beliefs: &mut Beliefs<SOURCES, PATHS>,
    limit: usize,
    mode: Mode,
) {
    let mut trellis = Trellis::new();
    let mut evidence = LnProduct::ONE;
    for (row, belief) in rows.iter_mut().zip(beliefs.features_mut()).filter(|(row, _)| row.gated == 0) {
        // Nothing can be its own.
        (belief.missed, belief.joint, row.stage) = (1.0, Joint::Missed, Stage::Exact);
        evidence.times(row.absent);
    }
    loop {
        let gathered = rows.gather_cluster();
        if gathered == 0 {
            break;
        }
        let solved = trellis.solve(rows, gathered, beliefs, &mut evidence, limit, mode == Mode::Map);
        rows.settle_cluster(if solved { Stage::Exact } else { Stage::Loopy });
    }
    beliefs.evidence_nat += evidence.ln();
    beliefs.work.add_all(trellis.work());
}

impl<const SOURCES: usize, const PATHS: usize> Beliefs<SOURCES, PATHS> {
    /// Beliefs about nothing.
    // A function: of a constant, all room for virtual anchors would be copied out of the flash.
    #[inline(always)]
    pub(crate) const fn none() -> Self {
        Self {
            direct: Belief::NONE,
            virtual_anchors: Vec::new(),
            unassociated: [0.0; PATHS],
            iterations: 0,
            evidence_nat: 0.0,
            outage: 0.0,
            work: Work::NONE,
        }
    }

    /// Begins with nothing associated with any of so many virtual anchors; `evidence_nat` is that of clutter alone.
    fn begin(&mut self, virtual_anchors: usize, evidence_nat: f32) {
        self.direct = Belief::NONE;
        self.virtual_anchors.clear();
        for _ in 0..virtual_anchors {
            // Capacities are equal: every push succeeds.
            let _ = self.virtual_anchors.push(Belief::NONE);
        }
        self.unassociated = [0.0; PATHS];
        self.iterations = 0;
        self.evidence_nat = evidence_nat;
        self.outage = 0.0;
        self.work = Work::NONE;
    }

    /// Fills in what the solutions leave: existence, and what is unassociated; `loopy` are the sums of the messages to every
    /// measurement.
    #[inline(never)]
    fn conclude(
        &mut self,
        rows: &Rows<SOURCES, PATHS>,
        direct: &Expectation,
        virtual_anchors: &Vec<Expectation, SOURCES>,
        count: usize,
        loopy: &[f32; PATHS],
    ) {
        for free in self.unassociated.iter_mut().take(count) {
            *free = 1.0;
        }
        let expectations = core::iter::once(direct).chain(virtual_anchors);
        let beliefs = core::iter::once(&mut self.direct).chain(&mut self.virtual_anchors);
        for ((row, belief), expectation) in rows.iter().zip(beliefs).zip(expectations) {
            if row.stage != Stage::Loopy {
                for m in members(row.gated) {
                    if let Some((free, p)) = self.unassociated.get_mut(m).zip(belief.associated.get(m)) {
                        *free -= p;
                    }
                }
            }
            // Of the mass on "missed", the part in which the feature exists but was not detected.
            let undetected = expectation.existence * (1.0 - expectation.detection) / row.absent;
            belief.existence = 1.0 - belief.missed * (1.0 - undetected);
        }
        // A measurement belongs to one cluster, so that one of the two leaves it as it was.
        for (free, sum) in self.unassociated.iter_mut().zip(loopy).take(count) {
            *free = larger(*free, 0.0) / (1.0 + sum);
        }
    }
}

impl<const PATHS: usize> Belief<PATHS> {
    /// Of a feature that gives no measurement.
    pub(crate) const NONE: Self =
        Self { missed: 1.0, associated: [0.0; PATHS], existence: 0.0, joint: Joint::Unknown, rest: 1.0 };
}

impl Written for Mode {
    fn write(&self, to: &mut impl Sink) {
        (*self == Self::Map).write(to);
    }
}

written!(AssociationSettings {
    mode,
    detection_probability,
    clutter_per_anchor,
    unmapped_per_anchor,
    map_change_per_s
});

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::lateness::Lateness;
    use crate::model::measurement::Clutter;

    fn expectation(range_m: f32, deviation_m: f32) -> Expectation {
        Expectation {
            range_m,
            variance_m2: deviation_m * deviation_m,
            existence: 1.0,
            detection: 0.95,
            lateness: Lateness::NONE,
        }
    }

    fn measurement(range_m: f32, deviation_m: f32) -> Measurement {
        Measurement {
            range_m,
            variance_m2: deviation_m * deviation_m,
            sinr: 0.0,
            energy: 0.0,
            false_alarm: 1.0,
        }
    }

    /// False alarms of this density at any range, and no paths that are not in the map.
    fn uniform_background<const M: usize>(
        direct: &Expectation,
        measurements: &Vec<Measurement, M>,
        per_m: f32,
    ) -> Background<M> {
        let clutter = Clutter { false_alarms_per_m: per_m, all_per_m: per_m };
        Background::new(measurements, direct, &clutter, &[1.0; M])
    }

    /// Joint associations of one problem, enumerated one by one in f64.
    struct Enumeration {
        /// p(b_k = 0), then p(b_k = m), per feature.
        marginals: std::vec::Vec<std::vec::Vec<f64>>,
        /// Per measurement, the probability that no feature has it.
        unassociated: std::vec::Vec<f64>,
        best: std::vec::Vec<Option<usize>>,
        /// ln of the sum over all of them, over that in which everything is clutter.
        evidence_nat: f64,
    }

    impl Enumeration {
        /// Where the background has this density at a measurement, and false alarms of the usual strength that one.
        fn new(
            features: &[Expectation],
            measurements: &[Measurement],
            density: impl Fn(&Measurement) -> f64 + Copy,
            false_per_m: f64,
        ) -> Self {
            let columns = measurements.len();
            let direct = &features[0];
            let earlier = |z: &Measurement| {
                let variance = f64::from(direct.variance_m2) + f64::from(z.variance_m2);
                f64::from(z.range_m) < f64::from(direct.range_m) - 2.0 * variance.sqrt()
            };
            let rows = features.iter().enumerate().map(|(k, feature)| {
                let (existence, detection) = (f64::from(feature.existence), f64::from(feature.detection));
                let missed = existence * (1.0 - detection) + (1.0 - existence);
                let taken = measurements.iter().map(move |z| {
                    let variance = f64::from(feature.variance_m2) + f64::from(z.variance_m2);
                    let nis = (f64::from(z.range_m) - f64::from(feature.range_m)).powi(2) / variance;
                    let density_at = (-0.5 * nis).exp() / (core::f64::consts::TAU * variance).sqrt();
                    let possible = nis < 16.0 && (k == 0 || !earlier(z));
                    // Were it the direct path, all that are clearly shorter would be false alarms.
                    let clearly_m = f64::from(z.range_m) - 2.0 * f64::from(z.variance_m2).sqrt();
                    let shorter =
                        measurements.iter().filter(|other| k == 0 && f64::from(other.range_m) < clearly_m);
                    let share =
                        |other: &Measurement| false_per_m * f64::from(other.false_alarm) / density(other);
                    let first: f64 = shorter.map(share).product();
                    if possible { first * existence * detection * density_at / density(z) } else { 0.0 }
                });
                core::iter::once(missed).chain(taken).collect()
            });
            let rows: std::vec::Vec<std::vec::Vec<f64>> = rows.collect();
            let mut found = Self {
                marginals: std::vec![std::vec![0.0; columns + 1]; rows.len()],
                unassociated: std::vec![0.0; columns],
                best: std::vec![None; rows.len()],
                evidence_nat: 0.0,
            };
            let (mut total, mut most) = (0.0, 0.0);
            found.descend(&rows, &mut std::vec::Vec::new(), 1.0, &mut total, &mut most);
            found.marginals.iter_mut().flatten().chain(&mut found.unassociated).for_each(|p| *p /= total);
            found.evidence_nat = total.ln();
            found
        }

        fn descend(
            &mut self,
            rows: &[std::vec::Vec<f64>],
            choices: &mut std::vec::Vec<usize>,
            weight: f64,
            total: &mut f64,
            most: &mut f64,
        ) {
            let Some(row) = rows.get(choices.len()) else {
                *total += weight;
                if weight > *most {
                    *most = weight;
                    self.best = choices.iter().map(|choice| choice.checked_sub(1)).collect();
                }
                for (marginals, &choice) in self.marginals.iter_mut().zip(&*choices) {
                    marginals[choice] += weight;
                }
                for (m, free) in self.unassociated.iter_mut().enumerate() {
                    if !choices.contains(&(m + 1)) {
                        *free += weight;
                    }
                }
                return;
            };
            for (choice, &factor) in row.iter().enumerate() {
                if factor > 0.0 && (choice == 0 || !choices.contains(&choice)) {
                    choices.push(choice);
                    self.descend(rows, choices, weight * factor, total, most);
                    choices.pop();
                }
            }
        }
    }

    #[test]
    fn an_anchor_that_may_be_out_is_one_hypothesis_more() {
        let features = [expectation(2.0, 0.1), Expectation { existence: 0.6, ..expectation(2.5, 0.2) }];
        let measurements: Vec<Measurement, 3> =
            [measurement(2.1, 0.1), measurement(2.4, 0.1), measurement(7.0, 0.1)].into_iter().collect();
        let others: Vec<Expectation, 2> = features[1..].iter().copied().collect();
        let background = uniform_background(&features[0], &measurements, 0.1);
        let heard = Enumeration::new(&features, &measurements, |_| f64::from(0.1_f32), f64::from(0.1_f32));
        let existence = {
            let beliefs = associate(&features[0], &others, &measurements, &background);
            beliefs.features().map(|belief| f64::from(belief.existence)).collect::<std::vec::Vec<_>>()
        };
        for outage in [0.0_f32, 0.3, 0.999, 1.0] {
            let mut beliefs = associate(&features[0], &others, &measurements, &background);
            beliefs.doubt(outage, features.iter().map(|feature| feature.existence), 3);
            // Weights of the two.
            let p = f64::from(outage);
            let all = (1.0 - p) * heard.evidence_nat.exp() + p;
            let out = p / all;
            assert!((f64::from(beliefs.evidence_nat) - all.ln()).abs() < 1e-5, "{outage}");
            assert!((f64::from(beliefs.outage) - out).abs() < 1e-6, "{outage}");
            for (k, (belief, marginals)) in beliefs.features().zip(&heard.marginals).enumerate() {
                let found = core::iter::once(&belief.missed).chain(&belief.associated);
                for (b, (found, marginal)) in found.zip(marginals).enumerate() {
                    let exact = (1.0 - out) * marginal + if b == 0 { out } else { 0.0 };
                    assert!((f64::from(*found) - exact).abs() < 1e-5, "{outage} {k} {b}");
                }
                let exact = (1.0 - out) * existence[k] + out * f64::from(features[k].existence);
                assert!((f64::from(belief.existence) - exact).abs() < 1e-5, "{outage} {k}");
            }
            for (found, exact) in beliefs.unassociated.iter().zip(&heard.unassociated) {
                assert!((f64::from(*found) - (out + (1.0 - out) * exact)).abs() < 1e-5, "{outage}");
            }
        }
    }

    /// How well association agreed with enumeration over many problems.
    #[derive(Debug)]
    struct Agreement {
        /// Shares of the problems: the most probable association is the joint one; no cluster was too large.
        best: f64,
        exact: f64,
        /// Largest error of any probability of a problem: sorted.
        errors: std::vec::Vec<f64>,
        /// Error of the evidence of a problem, nats, without its sign: sorted.
        evidence_nat: std::vec::Vec<f64>,
        /// Its mean with the sign.
        bias_nat: f64,
    }

    fn quantile(sorted: &[f64], q: f64) -> f64 {
        sorted[(q * (sorted.len() - 1) as f64) as usize]
    }

    impl Agreement {
        fn quantile(&self, q: f64) -> f64 {
            quantile(&self.errors, q)
        }
    }

    /// Problems of `K` features spread evenly over `span_m`, all detected with a deviation of 0.1 m, and one false
    /// alarm; each solved within `limit`.
    fn agreement<const K: usize, const M: usize>(problems: usize, span_m: f64, limit: usize) -> Agreement {
        let mut state = 1_u64;
        let mut uniform = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 53) as f64
        };
        let density = 1.0 / 30.0;
        let (mut best, mut exact, mut errors) = (0, 0, std::vec::Vec::new());
        let (mut evidence_nat, mut bias_nat) = (std::vec::Vec::new(), 0.0);
        for _ in 0..problems {
            let mut features = [expectation(0.0, 0.0); K];
            let mut measurements: Vec<Measurement, M> = Vec::new();
            for feature in &mut features {
                feature.range_m = (1.0 + span_m * uniform()) as f32;
                let normal =
                    (-2.0 * (1.0 - uniform()).ln()).sqrt() * (core::f64::consts::TAU * uniform()).cos();
                measurements.push(measurement(feature.range_m + (0.1 * normal) as f32, 0.1)).unwrap();
            }
            measurements.push(measurement((1.0 + span_m * uniform()) as f32, 0.1)).unwrap();
            let (direct, others) = features.split_first().unwrap();
            let others: Vec<Expectation, K> = others.iter().copied().collect();
            let background = uniform_background(direct, &measurements, density as f32);
            let mut beliefs = Beliefs::none();
            associate_within(direct, &others, &measurements, &background, limit, Mode::Map, &mut beliefs);
            let truth = Enumeration::new(
                &features,
                &measurements,
                |_| f64::from(density as f32),
                f64::from(density as f32),
            );
            let (first, rest) = beliefs.most_probable();
            let choices: std::vec::Vec<_> = core::iter::once(first).chain(rest.iter().copied()).collect();
            best += usize::from(choices == truth.best);
            exact += usize::from(beliefs.iterations == 0);
            let mut error: f64 = 0.0;
            for (belief, marginals) in beliefs.features().zip(&truth.marginals) {
                for (p, q) in core::iter::once(&belief.missed).chain(&belief.associated).zip(marginals) {
                    error = error.max((f64::from(*p) - q).abs());
                }
            }
            for (p, q) in beliefs.unassociated.iter().zip(&truth.unassociated) {
                error = error.max((f64::from(*p) - q).abs());
            }
            errors.push(error);
            let off_nat = f64::from(beliefs.evidence_nat) - truth.evidence_nat;
            evidence_nat.push(off_nat.abs());
            bias_nat += off_nat / problems as f64;
        }
        errors.sort_unstable_by(f64::total_cmp);
        evidence_nat.sort_unstable_by(f64::total_cmp);
        let share = |count: usize| count as f64 / problems as f64;
        Agreement { best: share(best), exact: share(exact), errors, evidence_nat, bias_nat }
    }

    fn print(title: &str, found: &Agreement) {
        std::println!(
            "{title}: most probable association is the joint one in {:.2} %, all clusters exact in {:.2} %; \
             probabilities off by {:.1e} (median), {:.1e} (90 %), {:.1e} (at most); evidence by {:.1e}, {:.1e}, \
             {:.1e} nat (on the mean {:+.1e})",
            100.0 * found.best,
            100.0 * found.exact,
            found.quantile(0.5),
            found.quantile(0.9),
            found.quantile(1.0),
            quantile(&found.evidence_nat, 0.5),
            quantile(&found.evidence_nat, 0.9),
            quantile(&found.evidence_nat, 1.0),
            found.bias_nat
        );
    }

    #[test]
    fn exact_clusters_agree_with_enumeration_and_messages_nearly() {
        let exact = agreement::<5, 6>(10_000, 10.0, STATES);
        let small = agreement::<5, 6>(10_000, 10.0, 40);
        let loopy = agreement::<5, 6>(10_000, 10.0, 0);
        print("exact", &exact);
        print("exact up to 3 x 3", &small);
        print("messages alone", &loopy);
        assert!(exact.best >= 0.9999 && exact.quantile(1.0) < 1e-4, "{}", exact.best);
        assert_eq!(exact.exact, 1.0);
        assert!(small.best >= 0.99, "{}", small.best);
        assert!(loopy.best >= 0.97 && loopy.exact == 0.0, "{}", loopy.best);
        assert!(quantile(&exact.evidence_nat, 1.0) < 1e-5, "{exact:?}");
        // Bethe's approximation of a sum over matchings is never above it (Vontobel 2013).
        assert!(quantile(&loopy.evidence_nat, 0.5) < 1e-4 && quantile(&loopy.evidence_nat, 0.9) < 0.5);
        assert!(loopy.bias_nat < 0.0 && loopy.bias_nat > -0.2, "{}", loopy.bias_nat);
    }

    /// Density of what belongs to no known feature, as it is documented, in f64.
    fn density(z: &Measurement, claim: f32, direct: &Expectation, [all, false_alarms]: [f64; 2]) -> f64 {
        let deviation = (f64::from(direct.variance_m2) + f64::from(z.variance_m2)).sqrt();
        let earlier = (f64::from(direct.range_m) - f64::from(z.range_m)) / deviation;
        let later = 1.0 / (1.0 + (f64::from(crate::model::detection::LOGISTIC) * earlier).exp());
        false_alarms * f64::from(z.false_alarm)
            + (all - false_alarms) * later
            + all * (f64::from(claim) - 1.0)
    }

    #[test]
    fn evidence_is_the_sum_over_all_associations_before_any_background() {
        let mut state = 7_u64;
        let mut uniform = |low: f64, high: f64| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (low + (high - low) * ((state >> 11) as f64 / (1_u64 << 53) as f64)) as f32
        };
        let (mut least, mut most, mut worst) = (f64::INFINITY, f64::NEG_INFINITY, 0.0_f64);
        for _ in 0..2000 {
            let mut features = [expectation(0.0, 0.0); 4];
            let mut measurements: Vec<Measurement, 6> = Vec::new();
            for feature in &mut features {
                let (existence, detection) = (uniform(0.0, 1.0), uniform(0.03, 0.95));
                *feature = Expectation {
                    existence,
                    detection,
                    ..expectation(uniform(3.0, 8.0), uniform(0.02, 0.5))
                };
            }
            let mut claims = [1.0; 6];
            for claim in &mut claims {
                let false_alarm = uniform(-9.0, 0.0).exp();
                let own = measurement(uniform(2.0, 9.0), uniform(0.01, 0.3));
                measurements.push(Measurement { false_alarm, ..own }).unwrap();
                *claim = uniform(0.5, 4.0).max(1.0);
            }
            let (direct, others) = features.split_first().unwrap();
            let others: Vec<Expectation, 4> = others.iter().copied().collect();
            let clutter = Clutter { all_per_m: uniform(0.05, 0.4), false_alarms_per_m: 0.04 };
            let background = Background::new(&measurements, direct, &clutter, &claims);
            let beliefs = associate(direct, &others, &measurements, &background);
            assert_eq!(beliefs.iterations, 0);
            let intensities = [f64::from(clutter.all_per_m), f64::from(clutter.false_alarms_per_m)];
            let per_m = |z: &Measurement| {
                let index = measurements.iter().position(|own| own == z).unwrap();
                density(z, claims[index], direct, intensities)
            };
            let alone: f64 = measurements.iter().map(|z| (per_m(z) / intensities[0]).ln()).sum();
            let exact =
                Enumeration::new(&features, &measurements, per_m, intensities[1]).evidence_nat + alone;
            worst = worst.max((f64::from(beliefs.evidence_nat) - exact).abs());
            (least, most) = (least.min(exact), most.max(exact));
        }
        std::println!("evidence from {least:.1} to {most:.1} nat: off by {worst:.1e} at most");
        assert!(worst < 1e-4, "{worst}");
    }

    #[test]
    fn crowded_clusters_agree_with_enumeration_where_memory_suffices() {
        let found = agreement::<7, 8>(300, 3.0, STATES);
        let loopy = agreement::<7, 8>(300, 3.0, 0);
        print("crowded", &found);
        print("crowded, messages alone", &loopy);
        assert!(found.exact > 0.95 && found.best >= found.exact, "{} {}", found.exact, found.best);
        assert!(found.quantile(0.9) < 1e-6, "{}", found.quantile(0.9));
        assert!(loopy.best < 0.95, "messages alone do as well: {}", loopy.best);
        assert!(quantile(&found.evidence_nat, 0.9) < 1e-5, "{found:?}");
        assert!(quantile(&loopy.evidence_nat, 0.5) < 0.5 && quantile(&loopy.evidence_nat, 0.9) < 1.0);
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
        let background = uniform_background(&with(features[0]), &measurements, 1.0 / 30.0);
        let beliefs = associate(&with(features[0]), &others, &measurements, &background);
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
    fn without_measurements_existence_decays_and_nothing_is_associated() {
        let direct = Expectation { existence: 1.0, ..expectation(3.0, 0.1) };
        let mut others: Vec<Expectation, 2> = Vec::new();
        others.push(Expectation { existence: 0.5, ..expectation(4.0, 0.1) }).unwrap();
        let background = uniform_background(&direct, &Vec::new(), 0.03);
        let beliefs = associate::<2, 4>(&direct, &others, &Vec::new(), &background);
        assert_eq!(beliefs.direct.missed, 1.0);
        let exact = 0.5 * 0.05 / (0.5 * 0.05 + 0.5);
        assert!((beliefs.virtual_anchors[0].existence - exact).abs() < 1e-6);
        assert_eq!(beliefs.most_probable().0, None);
    }
}
