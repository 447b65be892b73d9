//! A candidate: a ring of hypotheses, and whether there is a virtual anchor at all.
//!
//! With L_h = 1 - P + sum over m of nu_m P N(z_m; h) / lambda, the likelihood of a scan under hypothesis h against that
//! of nothing being there: w_h <- w_h L_h, normalised, and r <- r L / (r L + 1 - r) with L the sum of w_h L_h.
//! Light hypotheses are dropped, neighbours that ran together are merged. One heavy, small Gaussian is a discovery.

use super::hypothesis::{Hypothesis, turned};
use super::{Background, Discovered, Viewpoint};
use crate::reference::association::Measurement;
use crate::reference::motion::{PX, PY};
use crate::reference::range::height_variance_m2;
use crate::reference::real::{Real, exp, larger, limited, pi, smaller, sqrt, square, tau};
use crate::reference::soft_update::Moments;
use cogmint_core::memory::discovery::candidate::{
    DETECTION_PRIOR, FIRST_DIRECTION, HYPOTHESIS_GATE2, LEAST_EXISTENCE, LIGHTEST, MOST_EXISTENCE,
    NEXT_DIRECTION, RESOLVED_EXISTENCE,
};
use cogmint_core::memory::discovery::{DiscoverySettings, GATE, HYPOTHESES};
use cogmint_core::model::detection::HIDDEN_DETECTION;
use cogmint_core::model::range::LEAST_RADIUS2_M2;
use cogmint_core::model::soft_update::LEAST_WEIGHT;
use std::fmt;

/// A ring.
#[derive(Clone, Debug)]
pub struct Candidate<T> {
    origin_m: [T; 2],
    /// Along the ring.
    pub hypotheses: Vec<Hypothesis<T>>,
    /// Probability that there is a virtual anchor.
    pub existence: T,
    hits: u16,
    age: u16,
    missed: bool,
}

impl<T: Real> Candidate<T> {
    /// A full ring around the tag at the distance measured, each Gaussian as wide as half its share.
    pub fn ring(viewpoint: &Viewpoint<T>, measurement: &Measurement<T>, existence: T) -> Self {
        let num = T::of;
        let slant = measurement.range_m - viewpoint.bias_m;
        let radius_m = sqrt(larger(square(slant) - square(viewpoint.height_m[0]), num(LEAST_RADIUS2_M2)));
        // d radius = (slant / radius) d slant.
        let stretch = slant / radius_m;
        let of_height = height_variance_m2(viewpoint.height_m, slant);
        let half_angle = pi::<T>() / T::of_count(HYPOTHESES);
        let c = &viewpoint.agent.covariance;
        let tag_covariance = [[c[PX][PX], c[PY][PX]], [c[PY][PX], c[PY][PY]]];
        let mut hypotheses = Vec::new();
        // Order: each direction is the one before, turned once more.
        let mut direction = FIRST_DIRECTION.map(T::of);
        for _ in 0..HYPOTHESES {
            // The radius is around where the tag was believed to be: its error u'(p - E p) is in it.
            let [ux, uy] = direction;
            let with_tag = [
                ux * tag_covariance[0][0] + uy * tag_covariance[1][0],
                ux * tag_covariance[0][1] + uy * tag_covariance[1][1],
            ];
            let radius_variance = (measurement.variance_m2 + of_height) * square(stretch)
                + (ux * with_tag[0] + uy * with_tag[1]);
            hypotheses.push(Hypothesis {
                direction,
                radius_m,
                covariance: [square(half_angle), T::ZERO, radius_variance],
                cross: [[T::ZERO; 2], with_tag],
                tag_shift_m: [T::ZERO; 2],
                tag_covariance,
                weight: T::ONE / T::of_count(HYPOTHESES),
            });
            direction = turned(direction, NEXT_DIRECTION.map(T::of));
        }
        Self { origin_m: viewpoint.position_m(), hypotheses, existence, hits: 1, age: 1, missed: false }
    }

    /// From the tag to the origin.
    fn offset(&self, viewpoint: &Viewpoint<T>) -> [T; 2] {
        let [x, y] = viewpoint.position_m();
        [self.origin_m[0] - x, self.origin_m[1] - y]
    }

    /// Probability that the virtual anchor is detected, if it exists: the one told, moved by what was seen of it.
    pub fn detection(&self, background: &Background<T>) -> T {
        let num = T::of;
        let told = background.detection_probability;
        let hits = num(DETECTION_PRIOR) * told + num(f32::from(self.hits)) - T::ONE;
        let scans = num(DETECTION_PRIOR) + num(f32::from(self.age)) - T::ONE;
        limited(hits / scans, num(HIDDEN_DETECTION), told)
    }

    /// Mean and variance of the mixture's range. Order: moments relative to the first hypothesis' mean.
    fn expectation(&self, viewpoint: &Viewpoint<T>) -> (T, T) {
        let offset = self.offset(viewpoint);
        let first = self.hypotheses[0].regress(offset, viewpoint.height_m).range_m;
        let mut mean = T::ZERO;
        let mut second = T::ZERO;
        for hypothesis in &self.hypotheses {
            let line = hypothesis.regress(offset, viewpoint.height_m);
            let relative = line.range_m - first;
            mean += hypothesis.weight * relative;
            second += hypothesis.weight * (square(relative) + line.variance_m2);
        }
        (first + mean, larger(second - square(mean), T::ZERO))
    }

    /// psi of every measurement, under one Gaussian with the mixture's moments; 0 beyond the gate.
    pub fn ratios(
        &self,
        viewpoint: &Viewpoint<T>,
        measurements: &[Measurement<T>],
        background: &Background<T>,
    ) -> Vec<T> {
        let (range_m, variance_m2) = self.expectation(viewpoint);
        let scale = self.existence * self.detection(background) / background.all_per_m;
        let mut psi = Vec::new();
        for measurement in measurements {
            let variance = variance_m2 + measurement.variance_m2;
            let nis = square(measurement.range_m - viewpoint.bias_m - range_m) / variance;
            psi.push(if nis < T::of(GATE) * T::of(GATE) {
                likelihood(scale, nis, variance)
            } else {
                T::ZERO
            });
        }
        psi
    }

    /// Update by a scan; `psi` says which measurements are near, `nu` how far they are free.
    pub fn update(
        &mut self,
        viewpoint: &Viewpoint<T>,
        measurements: &[Measurement<T>],
        [psi, nu]: [&[T]; 2],
        background: &Background<T>,
    ) {
        let num = T::of;
        let detection = self.detection(background);
        let offset = self.offset(viewpoint);
        let scale = detection / background.all_per_m;
        let mut sum = T::ZERO;
        let mut hit = T::ZERO;
        for hypothesis in &mut self.hypotheses {
            let line = hypothesis.regress(offset, viewpoint.height_m);
            let mut moments = Moments::none();
            let mut noise = T::ZERO;
            for m in 0..measurements.len() {
                let variance = line.variance_m2 + measurements[m].variance_m2;
                let innovation = measurements[m].range_m - viewpoint.bias_m - line.range_m;
                let nis = square(innovation) / variance;
                if psi[m] > T::ZERO && nis < num(HYPOTHESIS_GATE2) {
                    let p = nu[m] * likelihood(scale, nis, variance);
                    moments.add(p, innovation);
                    noise += p * measurements[m].variance_m2;
                }
            }
            let seen = moments.weight;
            let total = seen + (T::ONE - detection);
            hit += hypothesis.weight * seen;
            hypothesis.weight *= total;
            sum += hypothesis.weight;
            if seen > num(LEAST_WEIGHT) * total {
                let variance = line.variance_m2 + noise / seen;
                hypothesis.correct(&line, &moments.over(total), variance);
            }
        }

        self.age = self.age.saturating_add(1);
        self.missed = hit < num(0.5) * sum;
        if !self.missed {
            self.hits = self.hits.saturating_add(1);
        }
        let exists = self.existence * sum;
        self.existence = smaller(exists / (exists + (T::ONE - self.existence)), num(MOST_EXISTENCE));

        self.hypotheses.retain(|hypothesis| hypothesis.weight > num(LIGHTEST) * sum);
        let mut kept = T::ZERO;
        for hypothesis in &self.hypotheses {
            kept += hypothesis.weight;
        }
        for hypothesis in &mut self.hypotheses {
            hypothesis.weight /= kept;
        }
        self.merge_neighbours();
    }

    /// Merges neighbours: along the ring, then the last into the first.
    fn merge_neighbours(&mut self) {
        let mut merged: Vec<Hypothesis<T>> = Vec::new();
        for hypothesis in &self.hypotheses {
            match merged.last_mut() {
                Some(last) if last.is_close(hypothesis) => last.absorb(hypothesis),
                _ => merged.push(*hypothesis),
            }
        }
        if merged.len() > 1 {
            let last = merged[merged.len() - 1];
            if last.is_close(&merged[0]) {
                merged[0].absorb(&last);
                merged.pop();
            }
        }
        self.hypotheses = merged;
    }

    /// Worth keeping.
    pub fn is_plausible(&self) -> bool {
        self.existence > T::of(LEAST_EXISTENCE) && !self.hypotheses.is_empty()
    }

    /// The heaviest hypothesis (the first of equals).
    fn heaviest(&self) -> &Hypothesis<T> {
        let mut best = &self.hypotheses[0];
        for hypothesis in &self.hypotheses {
            if hypothesis.weight > best.weight {
                best = hypothesis;
            }
        }
        best
    }

    /// The discovery, once the hypotheses beside the heaviest hold nearly all weight and make a Gaussian in the plane.
    pub fn resolved(&self, settings: &DiscoverySettings) -> Option<Discovered<T>> {
        let num = T::of;
        let uncertain = self.existence < num(RESOLVED_EXISTENCE);
        if self.hits < settings.resolved_hits || uncertain || self.missed {
            return None;
        }
        let heaviest = self.heaviest();
        let beside: Vec<_> = self.hypotheses.iter().filter(|other| other.is_beside(heaviest)).collect();
        let mut union = **beside.first()?;
        for other in &beside[1..] {
            union.absorb(other);
        }
        let [angle_variance, _, radius_variance] = union.covariance;
        // The arc of one standard deviation strays from its tangent by a^2 r / 2.
        let bend = num(0.5) * angle_variance * union.radius_m;
        let bent = square(bend) > radius_variance;
        if union.weight <= num(settings.resolved_weight) || bent {
            return None;
        }
        let (position_m, gain, covariance_m2) = union.given_tag(self.origin_m);
        Some(Discovered { position_m, gain, covariance_m2 })
    }

    /// Every number with its name, in the order of the core's `visit`.
    pub fn visit(&self, f: &mut dyn FnMut(fmt::Arguments<'_>, T)) {
        let count = |n: u16| T::of(f32::from(n));
        f(format_args!("number of hypotheses"), T::of_count(self.hypotheses.len()));
        f(format_args!("existence"), self.existence);
        f(format_args!("hits"), count(self.hits));
        f(format_args!("age"), count(self.age));
        f(format_args!("last miss"), if self.missed { T::ONE } else { T::ZERO });
        f(format_args!("origin x"), self.origin_m[0]);
        f(format_args!("origin y"), self.origin_m[1]);
        for h in 0..self.hypotheses.len() {
            self.hypotheses[h].visit(&mut |name, value| f(format_args!("{name} of hypothesis {h}"), value));
        }
    }
}

/// Gaussian density times `scale`. Order: (scale exp) / sqrt.
fn likelihood<T: Real>(scale: T, nis: T, variance: T) -> T {
    scale * exp(T::of(-0.5) * nis) / sqrt(tau::<T>() * variance)
}
