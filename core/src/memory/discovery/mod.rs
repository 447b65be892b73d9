//! Discovery: virtual anchors that no floor plan told of, from the paths that association left over.
//!
//! A range alone puts a virtual anchor on a circle around the tag. A candidate therefore starts as a ring of
//! `hypothesis` Gaussians; every later range updates each of them and weighs it by its
//! likelihood. Motion along a line leaves two mirror images, a turn leaves one; a candidate is resolved when one
//! hypothesis holds nearly all weight and is small enough for a Gaussian in the plane. Bounded: `CANDIDATES` per
//! anchor, [`HYPOTHESES`] each.
//!
//! Whether there is a virtual anchor at all is a Bernoulli variable of its own, weighed by hits and misses against the
//! intensity of measurements that nothing explains.

pub mod candidate;
mod common_motion;
pub mod hypothesis;

use self::candidate::Candidate;
use self::common_motion::{Correction, Prediction};
use crate::model::measurement::Measurement;
use crate::model::motion::{Agent, MotionStep};
use crate::real::{abs, larger, sqrt};
use crate::snapshot::{stored, written};
use heapless::Vec;
use nalgebra::{Matrix2, Vector2};

/// Capacity: candidates per anchor of the reference size, which bound memory and time; with 0, nothing is looked for, and that takes
/// neither.
pub const USUAL_CANDIDATES: usize = 6;
/// Mathematics: grid of hypotheses on a ring; capacity of a candidate.
pub const HYPOTHESES: usize = 12;

/// Guard: against work on what explains nothing: gate, standard deviations.
pub const GATE: f32 = 3.0;
/// Guard: against candidates that a lost tag would carry off: they are given up when its position's variances exceed this
/// together, square metres.
pub const LOST_M2: f32 = 1.0;
/// Guard: against a second candidate for the direct path: deviations by which a reflection is at least longer than it.
pub const CLEARLY: f32 = 3.0;
/// Capacity: rounds of messages, which bound the time.
pub const ROUNDS: usize = 10;
/// Guard: against candidates that never get a chance: least probability that a new leftover is the path of a virtual anchor.
pub const LEAST_PRIOR: f32 = 0.1;
/// Guard: against the division by it: least probability that known features leave a measurement free.
pub const LEAST_FREE: f32 = 1e-6;

/// When a candidate is begun, and when it is taken for a virtual anchor.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct DiscoverySettings {
    /// A candidate is begun only while the tag's position is known to this standard deviation per axis, metres (1e-3 to 1), or
    /// as well as the range. Less: later discoveries. More: rings that begin around a wrong place. Chosen on development rooms.
    pub begin_below_m: f32,
    /// Ranges that a candidate has had at least when it is taken for a virtual anchor (2 to 1000). Less: sooner, and more false
    /// virtual anchors. Chosen on development rooms.
    pub resolved_hits: u16,
    /// Probability of the one place taken (0.5 to 0.99999). Less: sooner, and now and then its mirror image. Chosen on
    /// development rooms.
    pub resolved_weight: f32,
}

impl DiscoverySettings {
    /// Those of a tracker that is not started.
    pub(crate) const NONE: Self = Self { begin_below_m: 0.0, resolved_hits: 0, resolved_weight: 0.0 };
}

impl Default for DiscoverySettings {
    fn default() -> Self {
        Self { begin_below_m: 0.05, resolved_hits: 8, resolved_weight: 0.9995 }
    }
}

/// A virtual anchor found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Discovered {
    /// Position, metres.
    pub position: Vector2<f32>,
    /// How it moves with the tag's position: slope of its expectation over the latter.
    pub gain: Matrix2<f32>,
    /// Covariance of what the tag's position does not explain, square metres.
    pub covariance: Matrix2<f32>,
}

/// From where an anchor's candidates are seen.
#[derive(Clone, Copy, Debug)]
pub struct Viewpoint {
    /// The tag.
    pub agent: Agent,
    /// Height of the anchor (and so of its images in walls) above the tag, metres.
    pub height_m: f32,
    /// Standard deviation of that height, metres.
    pub height_std_m: f32,
    /// Bias of the anchor's ranges, metres.
    pub bias_m: f32,
    /// Range of the direct path, bias included, metres: whatever is reflected is longer.
    pub direct_m: f32,
    /// Its variance, square metres.
    pub direct_variance_m2: f32,
}

/// How well candidates explain the measurements of a scan.
#[derive(Clone, Debug, Default)]
pub struct Claims<const PATHS: usize, const CANDIDATES: usize> {
    /// psi of each candidate and measurement.
    psi: Vec<[f32; PATHS], CANDIDATES>,
    /// Probability that each candidate gives no measurement.
    absent: Vec<f32, CANDIDATES>,
}

/// What a leftover may be other than the path of a candidate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Background {
    /// Intensity of measurements that nothing known explains, per metre of range.
    pub all_per_m: f32,
    /// Of these, false alarms.
    pub false_alarms_per_m: f32,
    /// Probability that an existing virtual anchor is detected.
    pub detection_probability: f32,
}

/// The candidates of every anchor: at most `CANDIDATES` of each.
#[derive(Clone, Debug)]
pub struct Discovery<const ANCHORS: usize, const CANDIDATES: usize> {
    settings: DiscoverySettings,
    candidates: [Vec<Candidate, CANDIDATES>; ANCHORS],
}

impl<const PATHS: usize, const CANDIDATES: usize> Claims<PATHS, CANDIDATES> {
    /// Messages from candidates to measurements, given those the other way.
    fn messages(&self, nu: &Vec<[f32; PATHS], CANDIDATES>) -> Vec<[f32; PATHS], CANDIDATES> {
        let mut messages = Vec::new();
        for ((psi, absent), nu) in self.psi.iter().zip(&self.absent).zip(nu) {
            let mut total = *absent;
            for (psi, nu) in psi.iter().zip(nu) {
                total += psi * nu;
            }
            let mut row = [0.0; PATHS];
            for ((mu, psi), nu) in row.iter_mut().zip(psi).zip(nu) {
                *mu = psi / larger(total - psi * nu, *absent);
            }
            // Capacities are equal: every push succeeds.
            let _ = messages.push(row);
        }
        messages
    }

    /// By how much candidates make each measurement more probable than clutter alone.
    pub fn totals(&self) -> [f32; PATHS] {
        // The messages of each, where all the others' are 1.
        let mut totals = [1.0; PATHS];
        for (psi, absent) in self.psi.iter().zip(&self.absent) {
            let own = psi.iter().fold(*absent, |sum, psi| sum + psi);
            for (total, psi) in totals.iter_mut().zip(psi).filter(|(_, psi)| **psi > 0.0) {
                *total += psi / larger(own - psi, *absent);
            }
        }
        totals
    }
}

impl<const ANCHORS: usize, const CANDIDATES: usize> Discovery<ANCHORS, CANDIDATES> {
    /// No candidates.
    pub const fn new(settings: DiscoverySettings) -> Self {
        Self { settings, candidates: [const { Vec::new() }; ANCHORS] }
    }

    /// As [`Self::new`], where it stays.
    pub fn start(&mut self, settings: DiscoverySettings) {
        self.settings = settings;
        self.clear();
    }

    /// The candidates by anchor. Where there is room for none the compiler knows that there is none.
    fn lists(&self) -> &[Vec<Candidate, CANDIDATES>] {
        if CANDIDATES == 0 { &[] } else { &self.candidates }
    }

    /// Number of candidates of an anchor.
    pub fn candidates(&self, anchor: usize) -> usize {
        self.candidates.get(anchor).map_or(0, |candidates| candidates.len())
    }

    /// Number of places where they may be, of all of them.
    pub fn hypotheses(&self, anchor: usize) -> usize {
        let candidates = self.lists().get(anchor).into_iter().flatten();
        candidates.fold(0, |sum, candidate| sum + candidate.hypotheses.len())
    }

    /// Forgets all candidates.
    pub fn clear(&mut self) {
        self.candidates.iter_mut().for_each(Vec::clear);
    }

    /// Whether lists are within their memory.
    pub(crate) fn fits(&self) -> bool {
        self.lists().iter().all(|own| own.len() <= CANDIDATES && own.iter().all(Candidate::fits))
    }

    /// Whether finite numbers are what they may be.
    pub(crate) fn is_sound(&self) -> bool {
        self.lists().iter().flatten().all(Candidate::is_sound)
    }

    /// The state filter has predicted the agent by a step of the motion.
    pub fn predict(&mut self, before: &Agent, after: &Agent, step: &MotionStep) {
        if CANDIDATES == 0 {
            return;
        }
        if after.covariance.m11 + after.covariance.m22 > LOST_M2 {
            self.clear();
            return;
        }
        let step = Prediction::new(before, after, step.drift_s);
        self.candidates.iter_mut().flatten().for_each(|candidate| candidate.predict(&step));
    }

    /// The state filter has updated the agent: what that says about the candidates.
    pub fn follow(&mut self, before: &Agent, after: &Agent) {
        if CANDIDATES == 0 {
            return;
        }
        let step = Correction::new(before, after);
        self.candidates.iter_mut().flatten().for_each(|candidate| candidate.follow(&step));
    }

    /// Compares an anchor's candidates with its measurements, before anything has been made of these.
    pub fn claim<const PATHS: usize>(
        &self,
        anchor: usize,
        viewpoint: &Viewpoint,
        measurements: &Vec<Measurement, PATHS>,
        background: &Background,
    ) -> Claims<PATHS, CANDIDATES> {
        let mut claims = Claims { psi: Vec::new(), absent: Vec::new() };
        for candidate in self.candidates.get(anchor).into_iter().flatten() {
            // Capacities are equal: every push succeeds.
            let _ = claims.psi.push(candidate.ratios(viewpoint, measurements, background));
            let _ = claims.absent.push(1.0 - candidate.existence * candidate.detection(background));
        }
        claims
    }

    /// Gives an anchor's measurements to its candidates, as far as they are `free` of known features (probability of
    /// each). What nothing explains becomes a new candidate, but not where it may be a part of a known path:
    /// `known_m` are the ranges expected of known features, `resolution_m` how far apart two paths must be to be told
    /// apart.
    #[allow(clippy::too_many_arguments)] // each is one thing that candidates depend on
    pub fn observe<const PATHS: usize>(
        &mut self,
        anchor: usize,
        viewpoint: &Viewpoint,
        measurements: &Vec<Measurement, PATHS>,
        claims: &Claims<PATHS, CANDIDATES>,
        free: &[f32; PATHS],
        background: &Background,
        known_m: impl Iterator<Item = f32> + Clone,
        resolution_m: f32,
    ) {
        let Some(candidates) = self.candidates.get_mut(anchor) else { return };
        // What known features claim, without what candidates do.
        let known = {
            let mut known = claims.totals();
            for (total, free) in known.iter_mut().zip(free) {
                *total *= 1.0 / larger(*free, LEAST_FREE) - 1.0;
            }
            known
        };
        let mut nu: Vec<[f32; PATHS], CANDIDATES> = Vec::new();
        for _ in &claims.psi {
            // Capacities are equal: every push succeeds.
            let _ = nu.push(known.map(|known| 1.0 / (1.0 + known)));
        }
        // What a sum over the others cannot be below, whatever rounding leaves of the difference.
        let mut unclaimed = *free;
        for _ in 0..ROUNDS {
            let mu = claims.messages(&nu);
            let mut sums = known.map(|known| 1.0 + known);
            for row in &mu {
                for (sum, mu) in sums.iter_mut().zip(row) {
                    *sum += mu;
                }
            }
            unclaimed = sums.map(|sum| 1.0 / sum);
            for (row, mu) in nu.iter_mut().zip(&mu) {
                for (((nu, sum), mu), known) in row.iter_mut().zip(&sums).zip(mu).zip(&known) {
                    *nu = 1.0 / larger(sum - mu, 1.0 + known);
                }
            }
        }
        let psi = &claims.psi;
        for ((candidate, psi), nu) in candidates.iter_mut().zip(psi).zip(&nu) {
            candidate.update(viewpoint, measurements, psi, nu, background);
        }
        candidates.retain(Candidate::is_plausible);
        let c = &viewpoint.agent.covariance;
        let tag = 0.5 * (c.m11 + c.m22);
        let begin_below_m = self.settings.begin_below_m;
        let prior = larger(1.0 - background.false_alarms_per_m / background.all_per_m, LEAST_PRIOR);
        for (measurement, unclaimed) in measurements.iter().zip(&unclaimed) {
            let deviation = sqrt(viewpoint.direct_variance_m2 + measurement.variance_m2);
            let is_reflection = measurement.range_m > viewpoint.direct_m + CLEARLY * deviation;
            let apart = known_m.clone().all(|known_m| abs(measurement.range_m - known_m) >= resolution_m);
            let settled = tag < larger(measurement.variance_m2, begin_below_m * begin_below_m);
            if *unclaimed > 0.5 && settled && is_reflection && apart && !candidates.is_full() {
                let _ = candidates.push(Candidate::ring(viewpoint, measurement, prior));
            }
        }
    }

    /// Takes a resolved candidate of an anchor out, if there is one.
    pub fn take_resolved(&mut self, anchor: usize) -> Option<Discovered> {
        let candidates = self.candidates.get_mut(anchor)?;
        let mut found = None;
        candidates.retain(|candidate| {
            if found.is_none() {
                found = candidate.resolved(&self.settings);
                found.is_none()
            } else {
                true
            }
        });
        found
    }

    /// Every number of the state, in a fixed order, for traces.
    pub fn visit(&self, mut f: impl FnMut(f32)) {
        for candidates in &self.candidates {
            f(candidates.len() as f32);
        }
        self.lists().iter().flatten().for_each(|candidate| candidate.visit(&mut f));
    }
}

stored!(Discovery<const ANCHORS, const CANDIDATES> { candidates } told { settings });
written!(DiscoverySettings { begin_below_m, resolved_hits, resolved_weight });

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::motion::ProcessNoise;
    use nalgebra::{Matrix4, Vector4};

    fn walk(points: impl Iterator<Item = [f32; 2]>, truth: [f32; 2]) -> Option<Discovered> {
        let mut discovery = Discovery::<1, USUAL_CANDIDATES>::new(DiscoverySettings::default());
        let mut noise = 0.013;
        let still = ProcessNoise { position_m2: 0.0, cross_m2_s: 0.0, velocity_m2_s2: 0.0 };
        let step = MotionStep { drift_s: 1.0, decay: 1.0, noise: still };
        for [x, y] in points {
            // The tag's error is fresh in every scan.
            let covariance = Matrix4::from_diagonal(&Vector4::new(1e-4, 1e-4, 1e-4, 1e-4));
            let agent = Agent { mean: Vector4::new(x, y, 0.0, 0.0), covariance };
            let mut forgotten = agent;
            forgotten.covariance *= 2.0;
            discovery.predict(&agent, &forgotten, &step);
            discovery.follow(&forgotten, &agent);
            let viewpoint = Viewpoint {
                agent,
                height_m: 0.0,
                height_std_m: 0.0,
                bias_m: 0.0,
                direct_m: 0.0,
                direct_variance_m2: 0.0,
            };
            noise = -noise;
            let range_m = (x - truth[0]).hypot(y - truth[1]) + noise;
            let mut leftovers: Vec<Measurement, 4> = Vec::new();
            leftovers
                .push(Measurement { range_m, variance_m2: 4e-4, sinr: 0.0, energy: 0.0, false_alarm: 1.0 })
                .unwrap();
            let background =
                Background { all_per_m: 0.2, false_alarms_per_m: 0.03, detection_probability: 0.95 };
            let claims = discovery.claim(0, &viewpoint, &leftovers, &background);
            discovery.observe(
                0,
                &viewpoint,
                &leftovers,
                &claims,
                &[1.0; 4],
                &background,
                core::iter::empty(),
                0.0,
            );
            if let Some(found) = discovery.take_resolved(0) {
                return Some(found);
            }
        }
        None
    }

    #[test]
    fn a_straight_walk_leaves_the_mirror_ambiguity_open() {
        assert!(walk((0..300).map(|n| [0.01 * n as f32, 0.0]), [2.0, 5.0]).is_none());
    }

    #[test]
    fn nor_does_it_resolve_when_the_virtual_anchor_lies_broadside() {
        // The two images then lie in opposite directions.
        for broadside in 0..60 {
            let x = 1.5 + 0.01 * (broadside as f32 - 30.0);
            assert!(walk((0..300).map(|n| [0.01 * n as f32, 0.0]), [x, 4.0]).is_none(), "at {x} m");
        }
    }

    #[test]
    fn a_turn_resolves_it() {
        let bent =
            (0..600).map(|n| if n < 200 { [0.01 * n as f32, 0.0] } else { [2.0, 0.01 * (n - 200) as f32] });
        let found = walk(bent, [2.5, 6.0]).unwrap();
        let (dx, dy) = (found.position.x - 2.5, found.position.y - 6.0);
        assert!(dx.hypot(dy) < 0.3, "{found:?}");
    }
}
