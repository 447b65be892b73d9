//! A virtual anchor in the making: a ring of hypotheses around the place it was first heard at.

use super::common_motion::{Correction, Prediction};
use super::hypothesis::{Hypothesis, turned};
use super::{Background, Discovered, DiscoverySettings, GATE, HYPOTHESES, Viewpoint};
use crate::model::detection::HIDDEN_DETECTION;
use crate::model::measurement::Measurement;
use crate::model::range::{LEAST_RADIUS2_M2, height_variance_m2};
use crate::model::soft_update::{LEAST_WEIGHT, Moments};
use crate::real::{TAU, exp, is_probability, larger, limited, smaller, sqrt};
use crate::snapshot::stored;
use heapless::Vec;
use nalgebra::{Matrix2, Vector2};

/// Mathematics: cosine and sine of the direction of a ring's first hypothesis, at pi / 12.
pub const FIRST_DIRECTION: [f32; 2] = [0.965_925_8, 0.258_819_04];
/// Mathematics: cosine and sine of the rotation to each next one, pi / 6: 12 in all.
pub const NEXT_DIRECTION: [f32; 2] = [0.866_025_4, 0.5];
/// Guard: against work on what has no say: hypotheses lighter than this are dropped.
pub const LIGHTEST: f32 = 1e-4;
/// Capacity: candidates less probable than this make room.
pub const LEAST_EXISTENCE: f32 = 0.02;
/// Mathematics: a candidate is taken for an image where it is as sure to exist as one that a plan tells of.
pub const RESOLVED_EXISTENCE: f32 = crate::memory::environment::TOLD;
/// Guard: against certainty that no miss would undo: most that existence may become.
pub const MOST_EXISTENCE: f32 = 0.999;
/// Guard: against a detection probability from few scans: the one told counts for so many.
pub const DETECTION_PRIOR: f32 = 4.0;
/// Guard: against work on what explains nothing: gate of a single hypothesis within that of its candidate, squared standard
/// deviations; wide, because hypotheses are told apart by it.
pub const HYPOTHESIS_GATE2: f32 = 50.0;

#[derive(Clone, Debug)]
pub(super) struct Candidate {
    /// Where the tag was when the candidate was first heard, metres.
    pub origin_m: [f32; 2],
    pub hypotheses: Vec<Hypothesis, HYPOTHESES>,
    /// Probability that there is a virtual anchor.
    pub existence: f32,
    pub hits: u16,
    pub age: u16,
    pub missed: bool,
}

impl Candidate {
    /// Whether its list is within its memory.
    pub fn fits(&self) -> bool {
        self.hypotheses.len() <= HYPOTHESES
    }

    /// Whether finite numbers are what they may be.
    pub fn is_sound(&self) -> bool {
        is_probability(self.existence)
            && self.hypotheses.iter().all(|own| {
                let [aa, _, rr] = own.covariance;
                is_probability(own.weight) && own.radius_m >= 0.0 && aa >= 0.0 && rr >= 0.0
            })
    }

    /// A ring of hypotheses around the tag, each as wide along the ring as half its share of it.
    pub fn ring(viewpoint: &Viewpoint, measurement: &Measurement, existence: f32) -> Self {
        let slant = measurement.range_m - viewpoint.bias_m;
        let height = viewpoint.height_m;
        let radius_m = sqrt(larger(slant * slant - height * height, LEAST_RADIUS2_M2));
        // d radius = (slant / radius) d slant.
        let stretch = slant / radius_m;
        let of_height = height_variance_m2(height, viewpoint.height_std_m, slant);
        let half_angle = core::f32::consts::PI / HYPOTHESES as f32;
        let c = &viewpoint.agent.covariance;
        let mut hypotheses = Vec::new();
        let mut direction = FIRST_DIRECTION;
        for _ in 0..HYPOTHESES {
            // The circle is drawn around where the tag is, the radius counts from where it is believed to be.
            let [ux, uy] = direction;
            let (ax, ay) = (ux * c.m11 + uy * c.m21, ux * c.m21 + uy * c.m22);
            let range = (measurement.variance_m2 + of_height) * (stretch * stretch);
            let hypothesis = Hypothesis {
                direction,
                radius_m,
                covariance: [half_angle * half_angle, 0.0, range + (ux * ax + uy * ay)],
                cross: Matrix2::new(0.0, 0.0, ax, ay),
                tag_shift_m: Vector2::new(0.0, 0.0),
                tag_covariance: Matrix2::new(c.m11, c.m21, c.m21, c.m22),
                weight: 1.0 / HYPOTHESES as f32,
            };
            // The loop runs to the capacity: every push succeeds.
            let _ = hypotheses.push(hypothesis);
            direction = turned(direction, NEXT_DIRECTION);
        }
        let [x, y] = [viewpoint.agent.mean.x, viewpoint.agent.mean.y];
        Self { origin_m: [x, y], hypotheses, existence, hits: 1, age: 1, missed: false }
    }

    pub fn predict(&mut self, step: &Prediction) {
        for hypothesis in &mut self.hypotheses {
            hypothesis.predict(step);
        }
    }

    pub fn follow(&mut self, step: &Correction) {
        for hypothesis in &mut self.hypotheses {
            hypothesis.follow(step);
        }
    }

    /// Mean and variance of the range that the mixture expects.
    pub fn expectation(&self, viewpoint: &Viewpoint) -> (f32, f32) {
        let offset = self.offset(viewpoint);
        let mut mean = 0.0;
        let mut second = 0.0;
        // Relative to the first hypothesis, so that the variance keeps its digits.
        let mut origin = None;
        for hypothesis in &self.hypotheses {
            let line = hypothesis.regress(offset, viewpoint.height_m, viewpoint.height_std_m);
            let relative = line.range_m - *origin.get_or_insert(line.range_m);
            mean += hypothesis.weight * relative;
            second += hypothesis.weight * (relative * relative + line.variance_m2);
        }
        (origin.unwrap_or(0.0) + mean, larger(second - mean * mean, 0.0))
    }

    /// psi of every measurement over that of none, were the candidate sure to exist; 0 beyond the gate.
    pub fn ratios<const PATHS: usize>(
        &self,
        viewpoint: &Viewpoint,
        measurements: &Vec<Measurement, PATHS>,
        background: &Background,
    ) -> [f32; PATHS] {
        let (range_m, variance_m2) = self.expectation(viewpoint);
        let scale = self.existence * self.detection(background) / background.all_per_m;
        let mut psi = [0.0; PATHS];
        for (psi, measurement) in psi.iter_mut().zip(measurements) {
            let innovation = measurement.range_m - viewpoint.bias_m - range_m;
            let variance = variance_m2 + measurement.variance_m2;
            let nis = innovation * innovation / variance;
            if nis < GATE * GATE {
                *psi = scale * exp(-0.5 * nis) / sqrt(TAU * variance);
            }
        }
        psi
    }

    /// Bernoulli update by the measurements of a scan, each with the message `nu` that says how far it is free.
    pub fn update<const PATHS: usize>(
        &mut self,
        viewpoint: &Viewpoint,
        measurements: &Vec<Measurement, PATHS>,
        psi: &[f32; PATHS],
        nu: &[f32; PATHS],
        background: &Background,
    ) {
        let detection = self.detection(background);
        self.age = self.age.saturating_add(1);
        let offset = self.offset(viewpoint);
        let scale = detection / background.all_per_m;
        let mut sum = 0.0;
        let mut hit = 0.0;
        for hypothesis in &mut self.hypotheses {
            let line = hypothesis.regress(offset, viewpoint.height_m, viewpoint.height_std_m);
            let mut associated = Moments::default();
            let mut noise = 0.0;
            for ((measurement, &psi), &nu) in measurements.iter().zip(psi).zip(nu) {
                if psi <= 0.0 {
                    continue;
                }
                let variance = line.variance_m2 + measurement.variance_m2;
                let innovation = measurement.range_m - viewpoint.bias_m - line.range_m;
                let nis = innovation * innovation / variance;
                if nis < HYPOTHESIS_GATE2 {
                    let p = nu * (scale * exp(-0.5 * nis) / sqrt(TAU * variance));
                    associated.weight += p;
                    associated.first_m += p * innovation;
                    associated.second_m2 += p * (innovation * innovation);
                    noise += p * measurement.variance_m2;
                }
            }
            let total = associated.weight + (1.0 - detection);
            hit += hypothesis.weight * associated.weight;
            hypothesis.weight *= total;
            sum += hypothesis.weight;
            if associated.weight > LEAST_WEIGHT * total {
                let variance = line.variance_m2 + noise / associated.weight;
                associated.weight /= total;
                associated.first_m /= total;
                associated.second_m2 /= total;
                hypothesis.correct(&line, &associated, variance);
            }
        }
        self.missed = hit < 0.5 * sum;
        if !self.missed {
            self.hits = self.hits.saturating_add(1);
        }
        self.weigh(sum);
        let mut kept = 0.0;
        self.hypotheses.retain(|hypothesis| {
            let keep = hypothesis.weight > LIGHTEST * sum;
            if keep {
                kept += hypothesis.weight;
            }
            keep
        });
        for hypothesis in &mut self.hypotheses {
            hypothesis.weight /= kept;
        }
        self.merge_neighbours();
    }

    fn weigh(&mut self, likelihood_ratio: f32) {
        let for_it = self.existence * likelihood_ratio;
        self.existence = smaller(for_it / (for_it + (1.0 - self.existence)), MOST_EXISTENCE);
    }

    /// Detection probability: what was told, and what was seen.
    pub fn detection(&self, background: &Background) -> f32 {
        let told = background.detection_probability;
        let seen = DETECTION_PRIOR * told + f32::from(self.hits) - 1.0;
        limited(seen / (DETECTION_PRIOR + f32::from(self.age) - 1.0), HIDDEN_DETECTION, told)
    }

    /// From the tag to the origin, metres.
    fn offset(&self, viewpoint: &Viewpoint) -> [f32; 2] {
        let [ox, oy] = self.origin_m;
        [ox - viewpoint.agent.mean.x, oy - viewpoint.agent.mean.y]
    }

    /// Merges hypotheses that ran together. They stay in the order of the ring, so only neighbours can.
    fn merge_neighbours(&mut self) {
        let mut last: Option<Hypothesis> = None;
        let mut merged: Vec<Hypothesis, HYPOTHESES> = Vec::new();
        for hypothesis in &self.hypotheses {
            match &mut last {
                Some(previous) if previous.is_close(hypothesis) => previous.absorb(hypothesis),
                _ => {
                    if let Some(previous) = last.replace(*hypothesis) {
                        // Capacities are equal: every push succeeds.
                        let _ = merged.push(previous);
                    }
                }
            }
        }
        // The ring closes: the last and the first are neighbours too.
        if let (Some(previous), Some(first)) = (&last, merged.first_mut())
            && previous.is_close(first)
        {
            first.absorb(previous);
            last = None;
        }
        if let Some(previous) = last {
            let _ = merged.push(previous);
        }
        self.hypotheses = merged;
    }

    fn heaviest(&self) -> Option<&Hypothesis> {
        self.hypotheses
            .iter()
            .reduce(|best, hypothesis| if hypothesis.weight > best.weight { hypothesis } else { best })
    }

    pub fn is_plausible(&self) -> bool {
        self.existence > LEAST_EXISTENCE && !self.hypotheses.is_empty()
    }

    /// The virtual anchor, once all hypotheses that matter are about one place.
    pub fn resolved(&self, settings: &DiscoverySettings) -> Option<Discovered> {
        let heaviest = self.heaviest()?;
        if self.hits < settings.resolved_hits
            || self.existence < RESOLVED_EXISTENCE
            // A candidate that has just missed may be dying.
            || self.missed
        {
            return None;
        }
        let mut union: Option<Hypothesis> = None;
        for hypothesis in &self.hypotheses {
            if !hypothesis.is_beside(heaviest) {
                continue;
            }
            match &mut union {
                Some(union) => union.absorb(hypothesis),
                None => union = Some(*hypothesis),
            }
        }
        let union = union?;
        let [aa, _, rr] = union.covariance;
        // An arc of one standard deviation may stray from its chord by the radius' deviation: only then is it a Gaussian in the
        // plane.
        let bend = 0.5 * aa * union.radius_m;
        if union.weight <= settings.resolved_weight || bend * bend > rr {
            return None;
        }
        let (position, gain, covariance) = union.given_tag(self.origin_m);
        Some(Discovered { position, gain, covariance })
    }

    /// Every number, in a fixed order, for traces.
    pub fn visit(&self, f: &mut impl FnMut(f32)) {
        f(self.hypotheses.len() as f32);
        f(self.existence);
        f(f32::from(self.hits));
        f(f32::from(self.age));
        f(if self.missed { 1.0 } else { 0.0 });
        self.origin_m.iter().for_each(|v| f(*v));
        self.hypotheses.iter().for_each(|hypothesis| hypothesis.visit(f));
    }
}

stored!(blank Candidate { origin_m, hypotheses, existence, hits, age, missed });
