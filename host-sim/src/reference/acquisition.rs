//! Acquisition: where the tag is, while the state filter cannot know.
//!
//! The tag is at one of several places, each a Gaussian of [p, v] with a weight. A scan multiplies the weight by what
//! the place makes of it. First the direct path: it is one of the gated measurements m, or none, and each choice is a
//! place of its own, times
//!
//! P_d N(z_m; mean, S) / lambda, or 1 - P_d for none,
//!
//! times lambda_fa / lambda for every measurement clearly shorter than it. Then each virtual anchor, softly, with nu_m
//! what the features before it left of measurement m:
//!
//! L = 1 - r P_d + sum over m of nu_m r P_d N(z_m; mean, S) / lambda, nu_m <- nu_m (1 - its share of L).
//!
//! In the first scans places are proposed: each early range puts the tag on a circle around its anchor, cut into arcs.

use super::association::{Measurement, is_earlier};
use super::motion::{AGENT, Agent, MotionStep, PX, PY, VX, VY, mirror};
use super::plan::FloorPlan;
use super::range::{Line, height_variance_m2, regress_distance};
use super::real::{Real, exp, larger, ln, smaller, sqrt, square, tau};
use super::soft_update::{Moments, SoftUpdate};
use super::zeros;
use cogmint_core::model::range::LEAST_RADIUS2_M2;
use cogmint_core::model::soft_update::LEAST_WEIGHT;
use cogmint_core::perceptor::belief::acquisition::{
    ARC_STD, AcquisitionSettings, BRANCHES, DIRECTIONS, DOUBT, EARLIER, EARLIEST, GATE2, LEAST_DETERMINANT,
    LEAST_FACTOR, LIGHTEST, NEXT_DIRECTION, OUTSIDE, PLACES, PRIOR_GATE2, ROUNDING_MARGIN,
};
use std::cmp::Ordering;
use std::fmt;

/// A direct path or a virtual anchor.
#[derive(Clone, Copy, Debug)]
pub struct Landmark<T> {
    /// Position, metres.
    pub position_m: [T; 2],
    /// Its covariance, square metres.
    pub covariance_m2: [[T; 2]; 2],
    /// Height above the tag, metres: mean and standard deviation.
    pub height_m: [T; 2],
    /// Probability that it exists and is detected.
    pub detection: T,
}

/// What one anchor delivered, and what it may be.
#[derive(Clone, Debug)]
pub struct Sweep<T> {
    /// Index of the anchor.
    pub anchor: usize,
    /// The ranges.
    pub measurements: Vec<Measurement<T>>,
    /// The anchor.
    pub direct: Landmark<T>,
    /// Its virtual anchors, by slot.
    pub reflections: Vec<Landmark<T>>,
    /// Bias of the ranges, metres.
    pub bias_m: T,
    /// Its variance, square metres.
    pub bias_variance_m2: T,
    /// Intensity of measurements of unknown origin at each range, per metre.
    pub all_per_m: Vec<T>,
    /// That of false alarms among them.
    pub false_alarms_per_m: T,
    /// Density of a range that is anywhere, per metre.
    pub anywhere_per_m: T,
}

/// A place.
#[derive(Clone, Debug)]
struct Place<T> {
    agent: Agent<T>,
    /// Logarithm of the weight; the heaviest has 0 after each scan.
    weight_ln: T,
}

/// The mixture.
#[derive(Clone, Debug)]
pub struct Acquisition<T> {
    prior: Agent<T>,
    /// Variance of a velocity of which nothing is known, per axis.
    speed_m2_s2: T,
    settings: AcquisitionSettings,
    places: Vec<Place<T>>,
    /// Cycles with measurements since places were proposed.
    scans: u16,
    /// Logarithm of the weight of a place that is proposed now.
    newcomer_ln: T,
    /// Of every anchor, the shortest ranges of its last scan and of that before, metres.
    earlier_m: Vec<[Vec<T>; 2]>,
    /// How long ago these scans were, seconds.
    earlier_age_s: Vec<[T; 2]>,
}

impl<T: Real> Acquisition<T> {
    /// Around the prior, for so many anchors.
    pub fn new(prior: Agent<T>, speed_m2_s2: T, anchors: usize, settings: AcquisitionSettings) -> Self {
        Self {
            prior,
            speed_m2_s2,
            settings,
            places: Vec::new(),
            scans: 0,
            newcomer_ln: T::ZERO,
            earlier_m: vec![[Vec::new(), Vec::new()]; anchors],
            earlier_age_s: vec![[T::ZERO; 2]; anchors],
        }
    }

    /// Intensity of what belongs to no landmark at each range of a scan of `anchor`, per metre: the larger, the nearer the range
    /// lies to those of the last two scans. `unmapped`: probability that such a range is no false alarm and is heard again.
    pub fn backgrounds(
        &self,
        anchor: usize,
        measurements: &[Measurement<T>],
        all_per_m: T,
        unmapped: T,
    ) -> Vec<T> {
        let velocity_m2_s2 = self.prior.covariance[VX][VX] + self.prior.covariance[VY][VY];
        let mut backgrounds = Vec::new();
        for z in measurements {
            let mut most = T::ZERO;
            for (scan, age_s) in self.earlier_m[anchor].iter().zip(self.earlier_age_s[anchor]) {
                let variance = T::of(2.0) * z.variance_m2 + square(age_s) * velocity_m2_s2;
                let mut density = T::ZERO;
                for earlier_m in scan {
                    let nis = square(z.range_m - *earlier_m) / variance;
                    if nis < T::of(GATE2) {
                        density += exp(T::of(-0.5) * nis) / sqrt(tau::<T>() * variance);
                    }
                }
                most = larger(most, density);
            }
            backgrounds.push(all_per_m + unmapped * most);
        }
        backgrounds
    }

    /// A place as probable as all others.
    pub fn suggest(&mut self, agent: Agent<T>) {
        self.offer(vec![Place { agent, weight_ln: T::ZERO }]);
    }

    /// Number of places.
    pub fn places(&self) -> usize {
        self.places.len()
    }

    /// Prediction by a step of `dt` seconds; a position that is known worse than the limit gets no worse.
    pub fn predict(&mut self, step: &MotionStep<T>, position_std_limit_m: T, dt: T) {
        for age_s in self.earlier_age_s.iter_mut().flatten() {
            *age_s += dt;
        }
        let limit = square(position_std_limit_m);
        let places = self.places.iter_mut().map(|place| &mut place.agent);
        for agent in places.chain([&mut self.prior]) {
            let next = step.predicted(agent);
            let c = &next.covariance;
            if larger(c[PX][PX], c[PY][PY]) > limit {
                // Within reach of where it was, at any speed.
                agent.covariance = zeros(AGENT, AGENT);
                for (p, v) in [(PX, VX), (PY, VY)] {
                    agent.covariance[p][p] = smaller(c[p][p], limit);
                    agent.covariance[v][v] = self.speed_m2_s2;
                    agent.mean[v] = T::ZERO;
                }
            } else {
                *agent = next;
            }
        }
    }

    /// Weighs all places by the sweeps of a cycle, and proposes new ones.
    pub fn observe(&mut self, sweeps: &[Sweep<T>], plan: &FloorPlan<T>) -> bool {
        if sweeps.iter().all(|sweep| sweep.measurements.is_empty()) {
            return false;
        }
        self.scans = self.scans.saturating_add(1);
        let newcomers_matter = self.newcomer_ln > ln(T::of(self.settings.newcomer_weight));
        for place in std::mem::take(&mut self.places) {
            self.offer(place.hear(sweeps, None));
        }
        if newcomers_matter {
            self.scans = 0;
            for s in 0..sweeps.len() {
                self.propose(sweeps, s, plan);
            }
        }
        // A place that comes later was heard by nobody up to here.
        for sweep in sweeps {
            self.remember(sweep);
            self.newcomer_ln += sweep.anywhere_ln();
        }
        self.thin();
        if self.places.is_empty() {
            // No arc within the prior's gate, or no weight that is a number.
            let mut prior = self.prior.clone();
            for p in [PX, PY] {
                for other in [PX, PY] {
                    prior.covariance[p][other] = T::of(DOUBT) * self.prior.covariance[p][other];
                }
                for v in [VX, VY] {
                    prior.covariance[p][v] = T::ZERO;
                    prior.covariance[v][p] = T::ZERO;
                }
            }
            *self = Self::new(prior, self.speed_m2_s2, self.earlier_m.len(), self.settings);
        }
        true
    }

    /// Keeps a scan's shortest ranges for the next two.
    fn remember(&mut self, sweep: &Sweep<T>) {
        let mut ranges_m: Vec<T> = sweep.measurements.iter().map(|z| z.range_m).collect();
        ranges_m.sort_by(|a, b| a.partial_cmp(b).unwrap_or(Ordering::Equal));
        // Equal ranges count once.
        ranges_m.dedup();
        ranges_m.truncate(EARLIER);
        let [last, before] = &mut self.earlier_m[sweep.anchor];
        *before = std::mem::replace(last, ranges_m);
        let [last_s, before_s] = &mut self.earlier_age_s[sweep.anchor];
        *before_s = std::mem::replace(last_s, T::ZERO);
    }

    /// The places at which an early range of sweep `s` would be its direct path.
    fn propose(&mut self, sweeps: &[Sweep<T>], s: usize, plan: &FloorPlan<T>) {
        let sweep = &sweeps[s];
        let mut after = T::ZERO;
        for _ in 0..EARLIEST {
            // The next longer range (the first of equals).
            let mut next: Option<&Measurement<T>> = None;
            for measurement in &sweep.measurements {
                let shorter = next.is_none_or(|least| measurement.range_m < least.range_m);
                if measurement.range_m > after && shorter {
                    next = Some(measurement);
                }
            }
            let Some(measurement) = next else { return };
            after = measurement.range_m;
            let slant = after - sweep.bias_m;
            let radius_m =
                sqrt(larger(square(slant) - square(sweep.direct.height_m[0]), T::of(LEAST_RADIUS2_M2)));
            let of_height = height_variance_m2(sweep.direct.height_m, slant);
            let variance_m2 = measurement.variance_m2 + sweep.bias_variance_m2 + of_height;
            // Order: each direction is the one before, turned once more.
            let mut direction = [T::ONE, T::ZERO];
            for _ in 0..DIRECTIONS {
                // Most arcs are out of reach of the prior.
                let place = self.on_arc(sweep.direct.position_m, direction, radius_m, variance_m2);
                if let Some(mut place) = place {
                    place.weight_ln += ln(larger(inside(&place.agent, plan), T::of(OUTSIDE)));
                    self.offer(place.hear(sweeps, Some((s, after))));
                }
                let ([x, y], [c, s]) = (direction, NEXT_DIRECTION.map(T::of));
                direction = [x * c - y * s, x * s + y * c];
            }
        }
    }

    /// The prior, given that the tag is on an arc of a circle: a Kalman update by the arc's position.
    fn on_arc(&self, centre_m: [T; 2], direction: [T; 2], radius_m: T, variance_m2: T) -> Option<Place<T>> {
        let num = T::of;
        let [ux, uy] = direction;
        let across = square(num(ARC_STD) * radius_m);
        let along = variance_m2 + num(ROUNDING_MARGIN) * across;
        // R of the arc: the range along u, the angle across.
        let xx = along * square(ux) + across * square(uy);
        let yx = (along - across) * (ux * uy);
        let yy = along * square(uy) + across * square(ux);
        let r = [[xx, yx], [yx, yy]];
        let arc = [centre_m[0] + radius_m * ux, centre_m[1] + radius_m * uy];

        // Everything over det(S), S = C + R.
        let c = &self.prior.covariance;
        let (of_prior, of_arc) = (c[PX][PX] * c[PY][PY] - square(c[PY][PX]), along * across);
        let mixed = c[PX][PX] * yy + c[PY][PY] * xx - num(2.0) * (c[PY][PX] * yx);
        let determinant = larger(of_prior + of_arc + mixed, num(LEAST_DETERMINANT));
        let scale = T::ONE / determinant;
        let off = -((c[PY][PX] + yx) * scale);
        let inverse = [[(c[PY][PY] + yy) * scale, off], [off, (c[PX][PX] + xx) * scale]];
        // S^-1 R = (adj(C) R + det(R) 1) / det(S).
        let left = [
            [(c[PY][PY] * xx - c[PY][PX] * yx + of_arc) * scale, (c[PY][PY] * yx - c[PY][PX] * yy) * scale],
            [(c[PX][PX] * yx - c[PY][PX] * xx) * scale, (c[PX][PX] * yy - c[PY][PX] * yx + of_arc) * scale],
        ];
        let nu = [arc[0] - self.prior.mean[PX], arc[1] - self.prior.mean[PY]];
        let form = nu[0] * (inverse[0][0] * nu[0] + inverse[0][1] * nu[1])
            + nu[1] * (inverse[1][0] * nu[0] + inverse[1][1] * nu[1]);
        if form > num(PRIOR_GATE2) {
            return None;
        }
        let mut agent = self.prior.clone();
        for i in 0..AGENT {
            let gain = [0, 1].map(|axis| c[i][PX] * inverse[0][axis] + c[i][PY] * inverse[1][axis]);
            agent.mean[i] += gain[0] * nu[0] + gain[1] * nu[1];
            for j in 0..=i {
                agent.covariance[i][j] = if i <= PY {
                    // C_pp S^-1 R = (det(C) R + det(R) C) / det(S).
                    (of_prior * r[i][j] + of_arc * c[i][j]) * scale
                } else if j <= PY {
                    // C_vp S^-1 R.
                    c[i][PX] * left[0][j] + c[i][PY] * left[1][j]
                } else {
                    // C_vv - C_vp S^-1 C_pv.
                    c[i][j] - (gain[0] * c[j][PX] + gain[1] * c[j][PY])
                };
            }
        }
        mirror(&mut agent.covariance);
        // The prior's density there times the arc's share of the circle, over 2 pi times the radius.
        let share = num(1.0 / DIRECTIONS as f32);
        let weight_ln = self.newcomer_ln + ln(radius_m * share) - num(0.5) * (form + ln(determinant));
        Some(Place { agent, weight_ln })
    }

    fn offer(&mut self, places: Vec<Place<T>>) {
        for place in places {
            keep_heaviest(&mut self.places, PLACES, place);
        }
    }

    /// Scales the heaviest weight to 1, drops light places, and joins those that are one.
    fn thin(&mut self) {
        let mut most = T::of(f32::NEG_INFINITY);
        for place in &self.places {
            most = larger(place.weight_ln, most);
        }
        for place in &mut self.places {
            place.weight_ln -= most;
        }
        self.newcomer_ln -= most;
        let least = ln(T::of(LIGHTEST));
        self.places.retain(|place| place.weight_ln > least);
        let mut joined: Vec<Place<T>> = Vec::new();
        for place in &self.places {
            match joined.iter_mut().find(|other| other.is_same(place)) {
                Some(other) => other.absorb(place),
                None => joined.push(place.clone()),
            }
        }
        self.places = joined;
    }

    /// One Gaussian with the mixture's moments.
    pub fn summary(&self) -> Agent<T> {
        let Some(first) = self.places.first() else { return self.prior.clone() };
        let mut union = first.clone();
        for place in &self.places[1..] {
            union.absorb(place);
        }
        union.agent
    }

    /// The heaviest place (the first of equals), once it has nearly all weight.
    pub fn settled(&self) -> Option<Agent<T>> {
        if self.scans < self.settings.settled_cycles {
            return None;
        }
        let mut heaviest = self.places.first()?;
        for place in &self.places {
            if place.weight_ln > heaviest.weight_ln {
                heaviest = place;
            }
        }
        let (mut near, mut all) = (T::ZERO, T::ZERO);
        for place in &self.places {
            let weight = exp(place.weight_ln - heaviest.weight_ln);
            let away_x = place.agent.mean[PX] - heaviest.agent.mean[PX];
            let away_y = place.agent.mean[PY] - heaviest.agent.mean[PY];
            all += weight;
            if square(away_x) + square(away_y) < square(T::of(self.settings.settled_within_m)) {
                near += weight;
            }
        }
        (near > T::of(self.settings.settled_weight) * all).then(|| self.summary())
    }

    /// Every number with its name, in the order of the core's `visit`.
    pub fn visit(&self, f: &mut dyn FnMut(fmt::Arguments<'_>, T)) {
        f(format_args!("scans"), T::of(f32::from(self.scans)));
        f(format_args!("weight of a newcomer"), self.newcomer_ln);
        f(format_args!("number of places"), T::of_count(self.places.len()));
        for n in 0..=self.places.len() {
            let (agent, name) = match self.places.get(n) {
                Some(place) => (&place.agent, format!("place {n}")),
                None => (&self.prior, "the prior".to_owned()),
            };
            for i in 0..AGENT {
                f(format_args!("state {i} of {name}"), agent.mean[i]);
            }
            // Order: column by column.
            for j in 0..AGENT {
                for i in 0..AGENT {
                    f(format_args!("covariance ({i}, {j}) of {name}"), agent.covariance[i][j]);
                }
            }
        }
        for n in 0..self.places.len() {
            f(format_args!("weight of place {n}"), self.places[n].weight_ln);
        }
        for (anchor, scans) in self.earlier_m.iter().enumerate() {
            for (back, scan) in scans.iter().enumerate() {
                for n in 0..EARLIER {
                    let earlier_m = scan.get(n).copied().unwrap_or(T::ZERO);
                    f(format_args!("range {n} of anchor {anchor}, {} scans ago", back + 1), earlier_m);
                }
            }
        }
        for (anchor, ages_s) in self.earlier_age_s.iter().enumerate() {
            for (back, age_s) in ages_s.iter().enumerate() {
                f(format_args!("age of the scan of anchor {anchor}, {} scans ago", back + 1), *age_s);
            }
        }
    }
}

/// Probability that a tag which is thought to be there is inside the outline.
fn inside<T: Real>(agent: &Agent<T>, plan: &FloorPlan<T>) -> T {
    let c = &agent.covariance;
    let std_m = sqrt(larger(T::of(0.5) * (c[PX][PX] + c[PY][PY]), T::ZERO));
    plan.inside([agent.mean[PX], agent.mean[PY]], std_m)
}

impl<T: Real> Place<T> {
    /// The places that this one becomes by all sweeps. `origin`: the sweep and the range that proposed it, which is the
    /// direct path then and moves nothing.
    fn hear(&self, sweeps: &[Sweep<T>], origin: Option<(usize, T)>) -> Vec<Self> {
        let mut branches = vec![self.clone()];
        for s in 0..sweeps.len() {
            let given = match origin {
                Some((of, range_m)) if of == s => Some(range_m),
                _ => None,
            };
            let mut grown = Vec::new();
            for branch in &branches {
                branch.branch(&sweeps[s], given, &mut grown);
            }
            branches = grown;
        }
        branches
    }

    /// One sweep: a place for every choice of the direct path.
    fn branch(&self, sweep: &Sweep<T>, given: Option<T>, grown: &mut Vec<Self>) {
        let num = T::of;
        let detection = sweep.direct.detection;
        let line = self.regress(&sweep.direct);
        if given.is_none() {
            let expected_m = line.mean + sweep.bias_m;
            let variance_m2 = line.explained + line.residual + sweep.bias_variance_m2;
            let shorter = sweep.shorter_cost(expected_m, variance_m2);
            let mut missed = self.clone();
            missed.weight_ln += ln(larger((T::ONE - detection) * shorter, num(LEAST_FACTOR)));
            missed.weigh_reflections(sweep, None, [expected_m, variance_m2]);
            keep_heaviest(grown, BRANCHES, missed);
        }
        for m in 0..sweep.measurements.len() {
            let measurement = &sweep.measurements[m];
            let noise_m2 = measurement.variance_m2 + sweep.bias_variance_m2;
            let innovation = measurement.range_m - sweep.bias_m - line.mean;
            let variance = line.explained + line.residual + noise_m2;
            let nis = square(innovation) / variance;
            let chosen = given.map_or(nis < num(GATE2), |range_m| range_m == measurement.range_m);
            if !chosen {
                continue;
            }
            // The arc's weight is the integral over the range it comes from.
            let density =
                if given.is_some() { T::ONE } else { exp(num(-0.5) * nis) / sqrt(tau::<T>() * variance) };
            let shorter = sweep.shorter_cost(measurement.range_m, noise_m2);
            let factor = detection * density * shorter / sweep.all_per_m[m];
            let mut heard = self.clone();
            heard.weight_ln += ln(larger(factor, num(LEAST_FACTOR)));
            if given.is_none() {
                let mut moments = Moments::none();
                moments.add(T::ONE, innovation);
                heard.correct(&line, &moments, noise_m2);
            }
            heard.weigh_reflections(sweep, Some(m), [measurement.range_m, noise_m2]);
            keep_heaviest(grown, BRANCHES, heard);
        }
    }

    /// The range of a landmark, from here.
    fn regress(&self, landmark: &Landmark<T>) -> Line<T> {
        let Agent { mean, covariance: c } = &self.agent;
        let a = &landmark.covariance_m2;
        let [ax, ay] = landmark.position_m;
        let spread = [c[PX][PX] + a[0][0], c[PY][PX] + a[1][0], c[PY][PY] + a[1][1]];
        regress_distance([mean[PX] - ax, mean[PY] - ay], spread, landmark.height_m)
    }

    /// Weighs by the virtual anchors, one by one; `taken` is the direct path.
    fn weigh_reflections(
        &mut self,
        sweep: &Sweep<T>,
        taken: Option<usize>,
        [direct_m, direct_variance_m2]: [T; 2],
    ) {
        let num = T::of;
        let columns = sweep.measurements.len();
        let mut left = vec![T::ONE; columns];
        if let Some(taken) = taken {
            left[taken] = T::ZERO;
        }
        for landmark in &sweep.reflections {
            let line = self.regress(landmark);
            let mut shares = vec![T::ZERO; columns];
            let (mut moments, mut noise) = (Moments::none(), T::ZERO);
            for m in 0..columns {
                let own = sweep.measurements[m].variance_m2 + sweep.bias_variance_m2;
                let innovation = sweep.measurements[m].range_m - sweep.bias_m - line.mean;
                let variance = line.explained + line.residual + own;
                let nis = square(innovation) / variance;
                let earlier = is_earlier(&sweep.measurements[m], direct_m, direct_variance_m2);
                if nis < num(GATE2) && !earlier {
                    let density = landmark.detection * exp(num(-0.5) * nis) / sqrt(tau::<T>() * variance);
                    let p = left[m] * density / sweep.all_per_m[m];
                    shares[m] = p;
                    moments.add(p, innovation);
                    noise += p * own;
                }
            }
            let weight = moments.weight;
            let total = weight + (T::ONE - landmark.detection);
            self.weight_ln += ln(larger(total, num(LEAST_FACTOR)));
            for m in 0..columns {
                left[m] *= larger(T::ONE - shares[m] / total, T::ZERO);
            }
            // A virtual anchor's error is the same in every scan: where it is larger than that of the range, the tag
            // would follow it.
            let [gx, gy] = line.slope;
            let a = &landmark.covariance_m2;
            let own = gx * (gx * a[0][0] + gy * a[1][0]) + gy * (gx * a[1][0] + gy * a[1][1]);
            if weight > num(LEAST_WEIGHT) * total && own * weight < noise {
                self.correct(&line, &moments.over(total), noise / weight);
            }
        }
    }

    /// The soft update of the tag alone, by measurements of this variance.
    fn correct(&mut self, line: &Line<T>, innovations: &Moments<T>, noise_m2: T) {
        let Agent { mean, covariance: c } = &mut self.agent;
        let [gx, gy] = line.slope;
        let w: Vec<T> = (0..AGENT).map(|i| gx * c[i][PX] + gy * c[i][PY]).collect();
        let of_tag = gx * w[PX] + gy * w[PY];
        let change = SoftUpdate::new(innovations, line.explained + line.residual + noise_m2, of_tag);
        for i in 0..AGENT {
            mean[i] += w[i] * change.mean;
            for j in 0..=i {
                c[i][j] += change.covariance * w[i] * w[j];
            }
        }
        mirror(c);
    }

    /// Near in terms of both covariances.
    fn is_same(&self, other: &Self) -> bool {
        let (a, b) = (&self.agent, &other.agent);
        let [dx, dy] = [PX, PY].map(|axis| b.mean[axis] - a.mean[axis]);
        let sum = |i: usize, j: usize| a.covariance[i][j] + b.covariance[i][j];
        let [xx, yx, yy] = [sum(PX, PX), sum(PY, PX), sum(PY, PY)];
        let determinant = xx * yy - square(yx);
        // The distance times the determinant.
        let form = yy * square(dx) - T::of(2.0) * (yx * (dx * dy)) + xx * square(dy);
        form < determinant
    }

    /// Union: the sum of the weights, the moments of both.
    fn absorb(&mut self, other: &Self) {
        let top = larger(self.weight_ln, other.weight_ln);
        let (p, q) = (exp(self.weight_ln - top), exp(other.weight_ln - top));
        let (a, b) = (p / (p + q), q / (p + q));
        let (mine, theirs) = (&mut self.agent, &other.agent);
        let away: Vec<T> = (0..AGENT).map(|i| theirs.mean[i] - mine.mean[i]).collect();
        let mut mixed = zeros(AGENT, AGENT);
        for i in 0..AGENT {
            mine.mean[i] += b * away[i];
            for j in 0..=i {
                let within = a * mine.covariance[i][j] + b * theirs.covariance[i][j];
                mixed[i][j] = within + a * b * (away[i] * away[j]);
            }
        }
        mirror(&mut mixed);
        mine.covariance = mixed;
        self.weight_ln = top + ln(p + q);
    }
}

impl<T: Real> Sweep<T> {
    /// What the sweep says of a place of which nothing is known: each landmark's range is anywhere up to the longest.
    fn anywhere_ln(&self) -> T {
        let count = self.measurements.len();
        let floor = T::of(LEAST_FACTOR);
        let mut total = T::ZERO;
        for m in 0..count {
            let range_m = self.measurements[m].range_m;
            // The direct path is this range, or missing in the gap before it.
            let mut before_m = T::ZERO;
            for other in &self.measurements {
                if other.range_m < range_m {
                    before_m = larger(before_m, other.range_m);
                }
            }
            let missing = (T::ONE - self.direct.detection) * ((range_m - before_m) * self.anywhere_per_m);
            let heard = self.direct.detection * self.anywhere_per_m / self.all_per_m[m];
            total += self.shorter_cost(range_m, T::ZERO) * (missing + heard);
        }
        let mut weight_ln = ln(larger(total, floor));
        let mut left = vec![T::ONE; count];
        for landmark in &self.reflections {
            let density = landmark.detection * self.anywhere_per_m;
            let mut weight = T::ZERO;
            for m in 0..count {
                weight += left[m] * density / self.all_per_m[m];
            }
            let total = weight + (T::ONE - landmark.detection);
            weight_ln += ln(larger(total, floor));
            for m in 0..count {
                let share = left[m] * density / self.all_per_m[m] / total;
                left[m] *= larger(T::ONE - share, T::ZERO);
            }
        }
        weight_ln
    }

    /// First-arrival rule: what is more than two deviations shorter than the direct path must be a false alarm.
    fn shorter_cost(&self, direct_m: T, variance_m2: T) -> T {
        let mut factor = T::ONE;
        for (other, all_per_m) in self.measurements.iter().zip(&self.all_per_m) {
            if is_earlier(other, direct_m, variance_m2) {
                factor *= other.false_alarm * self.false_alarms_per_m / *all_per_m;
            }
        }
        factor
    }
}

/// Adds a place; where there is no room, in place of the lightest (the first of equals) if that is lighter.
fn keep_heaviest<T: Real>(places: &mut Vec<Place<T>>, room: usize, place: Place<T>) {
    if places.len() < room {
        places.push(place);
        return;
    }
    let mut lightest = 0;
    for n in 0..places.len() {
        if places[n].weight_ln < places[lightest].weight_ln {
            lightest = n;
        }
    }
    if places[lightest].weight_ln < place.weight_ln {
        places[lightest] = place;
    }
}
