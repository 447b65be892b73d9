//! Discovery: candidates for virtual anchors, from measurements that nothing known explains.
//!
//! A range puts a virtual anchor on a circle around the tag: a `candidate` is a ring of Gaussians (`hypothesis`)
//! around the place where it was first heard, each of the virtual anchor and the tag's position together. What the
//! state filter learns of the tag reaches them through `common_motion`.
//!
//! Which measurement belongs to which candidate is settled by messages as in the association. With psi_im the likelihood
//! of measurement m under candidate i against that of being unexplained, and r_i and P_i existence and detection
//! probability:
//!
//! mu_im = psi_im / (1 - r_i P_i + sum over m' != m of psi_im' nu_im'),
//! nu_im = 1 / (1 + k_m + sum over i' != i of mu_i'm).
//!
//! k_m is what known features claim. They are associated first, told by c_m = 1 + sum over i of mu_im (all nu being 1)
//! what the candidates make of m; where they leave m free with the probability f_m, k_m = c_m (1 / f_m - 1).
//!
//! Order: a sum that leaves one term out is the whole sum, minus that term, and never less than what it starts with.

mod candidate;
mod common_motion;
mod hypothesis;

use self::candidate::Candidate;
use self::common_motion::{Correction, Prediction};
use super::association::Measurement;
use super::motion::{Agent, MotionStep, PX, PY};
use super::real::{Real, abs, larger, sqrt, square};
use super::{Matrix, Square, zeros};
use cogmint_core::memory::discovery::{
    CLEARLY, DiscoverySettings, LEAST_FREE, LEAST_PRIOR, LOST_M2, ROUNDS, USUAL_CANDIDATES,
};
use std::fmt;

/// Where an anchor's candidates are seen from.
#[derive(Clone, Debug)]
pub struct Viewpoint<T> {
    /// The tag.
    pub agent: Agent<T>,
    /// Height of the anchor above the tag, metres: mean and standard deviation.
    pub height_m: [T; 2],
    /// Bias of the anchor's ranges, metres.
    pub bias_m: T,
    /// Range of the direct path, metres, and its variance, square metres.
    pub direct_m: T,
    /// See [`Self::direct_m`].
    pub direct_variance_m2: T,
}

/// What candidates make of the measurements of a scan.
#[derive(Clone, Debug)]
pub struct Claims<T> {
    /// Of every candidate and measurement.
    psi: Matrix<T>,
    /// 1 - r P of every candidate.
    absent: Vec<T>,
    /// Number of measurements.
    columns: usize,
}

impl<T: Real> Claims<T> {
    /// mu, given nu.
    fn messages(&self, nu: &Matrix<T>) -> Matrix<T> {
        let mut mu = zeros(self.psi.len(), self.columns);
        for i in 0..self.psi.len() {
            let mut total = self.absent[i];
            for m in 0..self.columns {
                total += self.psi[i][m] * nu[i][m];
            }
            for m in 0..self.columns {
                mu[i][m] = self.psi[i][m] / larger(total - self.psi[i][m] * nu[i][m], self.absent[i]);
            }
        }
        mu
    }

    /// c_m.
    pub fn totals(&self) -> Vec<T> {
        let mu = self.messages(&vec![vec![T::ONE; self.columns]; self.psi.len()]);
        let mut totals = vec![T::ONE; self.columns];
        for row in &mu {
            for m in 0..self.columns {
                totals[m] += row[m];
            }
        }
        totals
    }
}

impl<T: Real> Viewpoint<T> {
    fn position_m(&self) -> [T; 2] {
        [self.agent.mean[PX], self.agent.mean[PY]]
    }
}

/// What else a leftover may be.
#[derive(Clone, Copy, Debug)]
pub struct Background<T> {
    /// Intensity of measurements of unknown origin, per metre.
    pub all_per_m: T,
    /// That of false alarms among them.
    pub false_alarms_per_m: T,
    /// Probability that a virtual anchor is detected.
    pub detection_probability: T,
}

/// A virtual anchor found: a Gaussian given the tag's position.
#[derive(Clone, Copy, Debug)]
pub struct Discovered<T> {
    /// Where it is if the tag is where the state filter sees it, metres.
    pub position_m: [T; 2],
    /// How far it moves with the tag.
    pub gain: Square<T>,
    /// Covariance around that, square metres.
    pub covariance_m2: Square<T>,
}

/// The candidates of every anchor.
#[derive(Clone, Debug)]
pub struct Discovery<T> {
    settings: DiscoverySettings,
    candidates: Vec<Vec<Candidate<T>>>,
}

impl<T: Real> Discovery<T> {
    /// No candidates.
    pub fn new(anchors: usize, settings: DiscoverySettings) -> Self {
        Self { settings, candidates: vec![Vec::new(); anchors] }
    }

    /// Number of candidates of an anchor.
    pub fn candidates(&self, anchor: usize) -> usize {
        self.candidates[anchor].len()
    }

    /// Forgets all candidates.
    pub fn clear(&mut self) {
        for candidates in &mut self.candidates {
            candidates.clear();
        }
    }

    /// After the state filter's prediction by a step.
    pub fn predict(&mut self, before: &Agent<T>, after: &Agent<T>, step: &MotionStep<T>) {
        let lost = after.covariance[PX][PX] + after.covariance[PY][PY] > T::of(LOST_M2);
        let step = Prediction::new(before, after, step.drift_s);
        for candidates in &mut self.candidates {
            if lost {
                candidates.clear();
            }
            for candidate in candidates {
                for hypothesis in &mut candidate.hypotheses {
                    hypothesis.predict(&step);
                }
            }
        }
    }

    /// After the state filter's update.
    pub fn follow(&mut self, before: &Agent<T>, after: &Agent<T>) {
        let step = Correction::new(before, after);
        for candidates in &mut self.candidates {
            for candidate in candidates {
                for hypothesis in &mut candidate.hypotheses {
                    hypothesis.follow(&step);
                }
            }
        }
    }

    /// What an anchor's candidates make of a scan.
    pub fn claim(
        &self,
        anchor: usize,
        viewpoint: &Viewpoint<T>,
        measurements: &[Measurement<T>],
        background: &Background<T>,
    ) -> Claims<T> {
        let mut claims = Claims { psi: Vec::new(), absent: Vec::new(), columns: measurements.len() };
        for candidate in &self.candidates[anchor] {
            claims.psi.push(candidate.ratios(viewpoint, measurements, background));
            claims.absent.push(T::ONE - candidate.existence * candidate.detection(background));
        }
        claims
    }

    /// Gives an anchor's measurements, each with the probability that no known feature claims it, to the candidates;
    /// what they do not claim either starts candidates of its own.
    #[allow(clippy::too_many_arguments)] // as in the core
    pub fn observe(
        &mut self,
        anchor: usize,
        viewpoint: &Viewpoint<T>,
        measurements: &[Measurement<T>],
        claims: &Claims<T>,
        free: &[T],
        background: &Background<T>,
        known_m: &[T],
        resolution_m: T,
    ) {
        let num = T::of;
        let candidates = &mut self.candidates[anchor];
        let (rows, columns) = (candidates.len(), measurements.len());
        // 1 + k_m.
        let mut claimed = Vec::new();
        for (m, total) in claims.totals().into_iter().enumerate() {
            claimed.push(T::ONE + total * (T::ONE / larger(free[m], num(LEAST_FREE)) - T::ONE));
        }
        let mut nu: Matrix<T> =
            (0..rows).map(|_| claimed.iter().map(|claimed| T::ONE / *claimed).collect()).collect();
        let mut unclaimed = free.to_vec();
        for _ in 0..ROUNDS {
            let mu = claims.messages(&nu);
            for m in 0..columns {
                let mut sum = claimed[m];
                for i in 0..rows {
                    sum += mu[i][m];
                }
                unclaimed[m] = T::ONE / sum;
                for i in 0..rows {
                    nu[i][m] = T::ONE / larger(sum - mu[i][m], claimed[m]);
                }
            }
        }
        for i in 0..rows {
            candidates[i].update(viewpoint, measurements, [&claims.psi[i], &nu[i]], background);
        }
        candidates.retain(Candidate::is_plausible);

        let c = &viewpoint.agent.covariance;
        let tag = num(0.5) * (c[PX][PX] + c[PY][PY]);
        let prior = larger(T::ONE - background.false_alarms_per_m / background.all_per_m, num(LEAST_PRIOR));
        for m in 0..columns {
            let known = larger(measurements[m].variance_m2, square(num(self.settings.begin_below_m)));
            let deviation = sqrt(viewpoint.direct_variance_m2 + measurements[m].variance_m2);
            let reflected = measurements[m].range_m > viewpoint.direct_m + num(CLEARLY) * deviation;
            let free = unclaimed[m] > num(0.5) && candidates.len() < USUAL_CANDIDATES;
            let apart = known_m.iter().all(|known_m| abs(measurements[m].range_m - *known_m) >= resolution_m);
            if free && reflected && apart && tag < known {
                candidates.push(Candidate::ring(viewpoint, &measurements[m], prior));
            }
        }
    }

    /// Takes the first resolved candidate of an anchor out.
    pub fn take_resolved(&mut self, anchor: usize) -> Option<Discovered<T>> {
        for i in 0..self.candidates[anchor].len() {
            if let Some(found) = self.candidates[anchor][i].resolved(&self.settings) {
                self.candidates[anchor].remove(i);
                return Some(found);
            }
        }
        None
    }

    /// Every number with its name, in the order of the core's `visit`.
    pub fn visit(&self, f: &mut dyn FnMut(fmt::Arguments<'_>, T)) {
        for j in 0..self.candidates.len() {
            let count = T::of_count(self.candidates[j].len());
            f(format_args!("number of candidates of anchor {j}"), count);
        }
        for j in 0..self.candidates.len() {
            for i in 0..self.candidates[j].len() {
                self.candidates[j][i].visit(&mut |name, value| {
                    f(format_args!("{name} of candidate {i} of anchor {j}"), value);
                });
            }
        }
    }
}
