//! The exact solution of one cluster, by a recursion over its features in the order of their expected ranges.
//!
//! After the features 0 .. k - 1, all that matters for the rest is which of the measurements that are still wanted
//! have been used: the state s. B_k(s) sums the weights of all choices of the features from k on,
//!
//! B_k(s) = psi_k0 B_k+1(s) + sum over m not in s of psi_km B_k+1(s and m), B_K = 1,
//!
//! and A_k(s) those of all choices before k that lead to s. Then p(b_k = m) ~ sum over s of A_k(s) psi_km
//! B_k+1(s and m). With the largest term instead of the sum, B leads along the most probable joint association.
//!
//! Exact where (K + 2) times the number of states is at most `STATES`, and K at most `FEATURES`.
//!
//! B_k is divided by B_k(nothing used), and A_k+1 by the same number, so that sum_s A_k(s) B_k(s) = 1 for all k.

use crate::reference::Matrix;
use crate::reference::real::{Real, larger};
use cogmint_core::perceptor::association::exact::{FEATURES, STATES};

/// What is found out about one feature.
#[derive(Clone, Debug)]
pub struct Solution<T> {
    /// p(b = 0).
    pub missed: T,
    /// p(b = m).
    pub associated: Vec<T>,
    /// Its measurement in the most probable joint association.
    pub joint: Option<usize>,
}

/// A cluster's features, by expected range.
struct Cluster<T> {
    absent: Vec<T>,
    psi: Matrix<T>,
    /// Per measurement, the first and the last feature that can take it.
    wanted: Vec<Option<(usize, usize)>>,
    /// Per measurement, the bit it has in a state.
    seat: Vec<usize>,
    states: usize,
}

/// Solves the cluster with these factors, one row per feature in the order of expected ranges. None where it is too
/// large, or the probabilities leave the range of numbers. With it, the factors of the sum over all joint associations.
pub fn solve<T: Real>(absent: Vec<T>, psi: Matrix<T>) -> Option<(Vec<Solution<T>>, Vec<T>)> {
    let features = absent.len();
    let cluster = Cluster::new(absent, psi);
    if features > FEATURES || (features + 2) * cluster.states > STATES {
        return None;
    }
    let (sums, totals) = cluster.backward(|sum, term| sum + term);
    let marginals = cluster.marginals(&sums, &totals)?;
    let (largest, _) = cluster.backward(|most, term| larger(term, most));
    let joint = cluster.best(&largest);
    let solutions = marginals.into_iter().zip(joint);
    let solutions =
        solutions.map(|((missed, associated), joint)| Solution { missed, associated, joint }).collect();
    Some((solutions, totals))
}

impl<T: Real> Cluster<T> {
    fn new(absent: Vec<T>, psi: Matrix<T>) -> Self {
        let columns = psi[0].len();
        let wanted: Vec<Option<(usize, usize)>> = (0..columns)
            .map(|m| {
                let takers: Vec<usize> = (0..psi.len()).filter(|&k| psi[k][m] > T::ZERO).collect();
                Some((*takers.first()?, *takers.last()?))
            })
            .collect();
        // Order of the states: as binary numbers. A measurement that several features want gets the lowest seat that
        // is free once the last taker of others has had its turn; at the same feature, lower indices sit lower.
        let mut seat = vec![0; columns];
        let mut states = 1;
        for k in 0..psi.len() {
            for m in 0..columns {
                let Some((first, last)) = wanted[m] else { continue };
                if first != k || last == k {
                    continue;
                }
                let occupied = |place: usize| {
                    (0..columns).any(|other| {
                        let Some((from, to)) = wanted[other] else { return false };
                        let seated = from < k || (from == k && other < m);
                        seated && to > k && seat[other] == place
                    })
                };
                seat[m] = (0..).find(|&place| !occupied(place)).expect("there are as many places as numbers");
                states = states.max(2 << seat[m]);
            }
        }
        Self { absent, psi, wanted, seat, states }
    }

    /// Whether m has been wanted before feature k and still is by k or a later one.
    fn open(&self, m: usize, k: usize) -> bool {
        self.wanted[m].is_some_and(|(first, last)| first < k && k <= last)
    }

    fn used(&self, state: usize, m: usize) -> bool {
        (state >> self.seat[m]) & 1 == 1
    }

    /// The states possible before feature k, upwards.
    fn states(&self, k: usize) -> Vec<usize> {
        let mut possible = 0;
        for m in 0..self.wanted.len() {
            if self.open(m, k) {
                possible |= 1 << self.seat[m];
            }
        }
        (0..self.states).filter(|state| state & !possible == 0).collect()
    }

    /// The state after feature k took nothing.
    fn pass(&self, state: usize, k: usize) -> usize {
        let mut next = 0;
        for m in 0..self.wanted.len() {
            if self.open(m, k) && self.open(m, k + 1) && self.used(state, m) {
                next |= 1 << self.seat[m];
            }
        }
        next
    }

    /// The state after feature k took m; none where m is used or out of the question.
    fn take(&self, state: usize, k: usize, m: usize) -> Option<usize> {
        if self.psi[k][m] <= T::ZERO || (self.open(m, k) && self.used(state, m)) {
            return None;
        }
        let next = self.pass(state, k);
        Some(if self.open(m, k + 1) { next | (1 << self.seat[m]) } else { next })
    }

    /// B_k(s) for all k and s, and what each B_k was divided by.
    fn backward(&self, combine: impl Fn(T, T) -> T) -> (Matrix<T>, Vec<T>) {
        let features = self.absent.len();
        let mut values = vec![vec![T::ZERO; self.states]; features + 1];
        let mut totals = vec![T::ONE; features];
        values[features][0] = T::ONE;
        for k in (0..features).rev() {
            for state in self.states(k) {
                // Order: missed, then the measurements by index.
                let mut value = self.absent[k] * values[k + 1][self.pass(state, k)];
                for m in 0..self.wanted.len() {
                    if let Some(next) = self.take(state, k, m) {
                        value = combine(value, self.psi[k][m] * values[k + 1][next]);
                    }
                }
                if state == 0 {
                    totals[k] = value;
                }
                values[k][state] = value / totals[k];
            }
        }
        (values, totals)
    }

    /// p(b_k = 0) and p(b_k = m) of all features.
    fn marginals(&self, values: &Matrix<T>, totals: &[T]) -> Option<Vec<(T, Vec<T>)>> {
        let mut marginals = Vec::new();
        let mut weights = vec![T::ZERO; self.states];
        weights[0] = T::ONE;
        for k in 0..self.absent.len() {
            let mut missed = T::ZERO;
            let mut associated = vec![T::ZERO; self.wanted.len()];
            let mut next_weights = vec![T::ZERO; self.states];
            // Order: states upwards.
            for state in self.states(k) {
                let weight = weights[state] / totals[k];
                let next = self.pass(state, k);
                next_weights[next] += weight * self.absent[k];
                missed += weight * self.absent[k] * values[k + 1][next];
                for m in 0..self.wanted.len() {
                    if let Some(next) = self.take(state, k, m) {
                        next_weights[next] += weight * self.psi[k][m];
                        associated[m] += weight * self.psi[k][m] * values[k + 1][next];
                    }
                }
            }
            let mut sum = missed;
            for &p in &associated {
                sum += p;
            }
            if !(sum > T::of(0.5) && sum < T::of(2.0)) {
                return None;
            }
            marginals.push((missed / sum, associated.into_iter().map(|p| p / sum).collect()));
            weights = next_weights;
        }
        Some(marginals)
    }

    /// The best choice of each feature; of equals, the first.
    fn best(&self, values: &Matrix<T>) -> Vec<Option<usize>> {
        let mut choices = Vec::new();
        let mut state = 0;
        for k in 0..self.absent.len() {
            let mut choice = None;
            let mut next_state = self.pass(state, k);
            let mut most = self.absent[k] * values[k + 1][next_state];
            for m in 0..self.wanted.len() {
                if let Some(next) = self.take(state, k, m) {
                    let term = self.psi[k][m] * values[k + 1][next];
                    if term > most {
                        (choice, most, next_state) = (Some(m), term, next);
                    }
                }
            }
            choices.push(choice);
            state = next_state;
        }
        choices
    }
}
