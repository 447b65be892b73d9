//! Belief: where the tag is, as a bounded mixture of joint Gaussians.

use crate::knob::knob;
use crate::model::motion::{Motion, MotionStep};
use crate::perceptor::state_filter::StateFilter;
use crate::real::{exp, larger, ln, smaller, sqrt};
use heapless::Vec;
use nalgebra::{Matrix2, Matrix4, Vector4};

/// Capacity.
pub const SLOTS: usize = 40;

/// One of the places the tag may be at, with its own map.
#[derive(Clone, Debug)]
pub struct Component<const ANCHORS: usize, const SURFACES: usize> {
    /// Joint state.
    pub filter: StateFilter<ANCHORS, SURFACES>,
    /// ln of its weight.
    pub weight_ln: f32,
    /// Cycles heard since it was proposed; large where it is established.
    pub age: u16,
    /// Last place decided.
    pub from_m: [f32; 2],
    /// ln of the factor of barrier and outline in its weight.
    pub hindrance_ln: f32,
}

/// What is believed of where the tag is.
#[derive(Clone, Copy, Debug)]
pub struct Summary {
    /// Mean of the leading places.
    pub position_m: [f32; 2],
    /// Their share of the weight.
    pub probability: f32,
    /// Covariance of all places.
    pub covariance_m2: Matrix2<f32>,
}

/// The mixture. The first component leads.
#[derive(Clone, Debug)]
pub struct Mixture<const ANCHORS: usize, const SURFACES: usize> {
    /// The components, the heaviest first.
    pub components: Vec<Component<ANCHORS, SURFACES>, SLOTS>,
    /// The state while it was last certain.
    pub trusted: StateFilter<ANCHORS, SURFACES>,
    speed_m2_s2: f32,
    /// What is believed.
    pub summary: Summary,
    /// Smoothed share of the strong paths that are explained.
    pub explained: f32,
    cycles: u32,
}

const ESTABLISHED: u16 = 100;

impl<const ANCHORS: usize, const SURFACES: usize> Mixture<ANCHORS, SURFACES> {
    /// The start.
    pub fn new(filter: &StateFilter<ANCHORS, SURFACES>, speed_m_s: f32) -> Self {
        Self {
            components: Vec::new(),
            trusted: filter.clone(),
            speed_m2_s2: speed_m_s * speed_m_s,
            summary: Summary { position_m: filter.position_m(), probability: 1.0, covariance_m2: filter.position_covariance_m2() },
            explained: 1.0,
            cycles: 0,
        }
    }

    /// The first cycle.
    pub fn begin(&mut self, filter: &StateFilter<ANCHORS, SURFACES>) {
        if !self.components.is_empty() {
            return;
        }
        self.trusted = filter.clone();
        let agent = filter.agent();
        let std_m = sqrt(agent.covariance.m11);
        for a in -1..=1 {
            for b in -1..=1 {
                let (a, b) = (a as f32, b as f32);
                let mut own = filter.clone();
                let mut at = agent;
                at.mean.x += a * std_m;
                at.mean.y += b * std_m;
                at.covariance.m11 *= 0.36;
                at.covariance.m22 *= 0.36;
                own.place(&at);
                let from_m = own.position_m();
                let _ = self.components.push(Component { filter: own, weight_ln: -0.5 * (a * a + b * b), age: ESTABLISHED, from_m, hindrance_ln: 0.0 });
            }
        }
    }

    fn most_ln(&self) -> f32 {
        self.components.iter().fold(f32::NEG_INFINITY, |most, c| larger(most, c.weight_ln))
    }

    /// Time passes.
    pub fn predict(&mut self, elapsed_s: f32, turns_per_s: f32, is_heard: bool) {
        let most = self.most_ln();
        let turned = smaller(turns_per_s * knob(3) * elapsed_s, 0.5);
        let count = self.components.len();
        if turned > 0.0 {
            for index in 0..count {
                let Some(component) = self.components.get_mut(index) else { break };
                if component.weight_ln < most - 12.0 {
                    continue;
                }
                let mut child = component.clone();
                child.filter.turn(self.speed_m2_s2);
                child.weight_ln += ln(turned);
                component.weight_ln += ln(1.0 - turned);
                if self.components.push(child).is_err() {
                    break;
                }
            }
        }
        for component in &mut self.components {
            component.filter.predict(elapsed_s);
            if is_heard && component.age < ESTABLISHED {
                component.age += 1;
            }
        }
        self.split();
    }

    fn split(&mut self) {
        let most = self.most_ln();
        let widest = knob(2);
        for index in 0..self.components.len() {
            let Some(component) = self.components.get_mut(index) else { break };
            let c = component.filter.position_covariance_m2();
            let (half, apart) = (0.5 * (c.m11 + c.m22), 0.5 * (c.m11 - c.m22));
            let root = sqrt(apart * apart + c.m21 * c.m21);
            let major = half + root;
            if major <= widest * widest || component.weight_ln < most - 6.0 {
                continue;
            }
            let (mut ex, mut ey) = (c.m21, major - c.m11);
            if ex * ex + ey * ey < 1e-12 * major * major {
                (ex, ey) = if c.m11 >= c.m22 { (1.0, 0.0) } else { (0.0, 1.0) };
            }
            let norm = sqrt(ex * ex + ey * ey);
            let direction = [ex / norm, ey / norm];
            let mut sides = [component.clone(), component.clone()];
            component.filter.narrow(direction, 0.0, 0.5);
            component.weight_ln += ln(0.5);
            for (side, sign) in sides.iter_mut().zip([-1.0, 1.0]) {
                side.filter.narrow(direction, sign, 0.5);
                side.weight_ln += ln(0.25);
            }
            for side in sides {
                if self.components.push(side).is_err() {
                    return;
                }
            }
        }
    }

    /// Whether places should be proposed.
    pub fn is_in_doubt(&self) -> bool {
        let c = &self.summary.covariance_m2;
        self.summary.probability < 0.97 || c.m11 + c.m22 > 0.25 || self.explained < 0.8
    }

    /// Whether it is time to propose.
    pub fn proposes(&mut self) -> bool {
        self.cycles = self.cycles.wrapping_add(1);
        self.is_in_doubt() || self.cycles % (knob(16) as u32).max(1) == 0
    }

    /// First direction of arcs.
    pub fn phase(&self) -> f32 {
        let turns = self.cycles as f32 * 0.618_034;
        turns - libm::floorf(turns)
    }

    /// Enters a place: of a Gaussian with these variances along the radius from an anchor and across.
    pub fn enter(&mut self, position_m: [f32; 2], radial: [f32; 2], [along_m2, across_m2]: [f32; 2], reach_m: f32, elapsed_s: f32) {
        let total = self.total_ln();
        let [ux, uy] = radial;
        let mut filter = self.trusted.clone();
        let mut agent = filter.agent();
        let [x, y] = position_m;
        agent.mean = Vector4::new(x, y, 0.0, 0.0);
        let xx = along_m2 * ux * ux + across_m2 * uy * uy;
        let yy = along_m2 * uy * uy + across_m2 * ux * ux;
        let yx = (along_m2 - across_m2) * ux * uy;
        let v = self.speed_m2_s2;
        agent.covariance = Matrix4::new(xx, yx, 0.0, 0.0, yx, yy, 0.0, 0.0, 0.0, 0.0, v, 0.0, 0.0, 0.0, 0.0, v);
        filter.place(&agent);
        let share = knob(5) * elapsed_s * core::f32::consts::TAU * sqrt(along_m2 * across_m2) / (reach_m * reach_m);
        let weight_ln = total + ln(larger(share, 1e-30));
        let _ = self.components.push(Component { filter, weight_ln, age: 0, from_m: position_m, hindrance_ln: 0.0 });
    }

    fn total_ln(&self) -> f32 {
        let most = self.most_ln();
        let sum = self.components.iter().fold(0.0, |sum, c| sum + exp(c.weight_ln - most));
        most + ln(sum)
    }

    /// Merges what is one, and keeps the heaviest.
    pub fn reduce(&mut self) {
        let (cap, newcomers) = (knob(0) as usize, knob(4) as usize);
        let components = &mut self.components;
        // Heaviest first.
        components.sort_unstable_by(|a, b| b.weight_ln.total_cmp(&a.weight_ln));
        let best = components.first().map_or(0.0, |c| c.weight_ln);
        let (mut kept, mut established, mut new) = (0, 0, 0);
        for index in 0..components.len() {
            let Some(candidate) = components.get(index) else { break };
            let is_new = candidate.age < 5;
            if candidate.weight_ln < best - knob(9) && !is_new {
                continue;
            }
            let same = (0..kept).find(|&other| {
                components.get(other).is_some_and(|other| is_one(&other.filter, &candidate.filter))
            });
            let fits = if is_new { new < newcomers } else { established < cap };
            let target = match same {
                Some(other) => Some(other),
                None if fits => None,
                None if !is_new && candidate.weight_ln > best - knob(17) => (0..kept)
                    .filter(|&other| components.get(other).is_some_and(|c| c.age >= 5))
                    .min_by(|&a, &b| {
                        let d = |other: usize| components.get(other).map_or(f32::MAX, |c| apart(&c.filter, &candidate.filter));
                        d(a).total_cmp(&d(b))
                    }),
                None => continue,
            };
            match target {
                Some(other) => {
                    let (head, tail) = components.split_at_mut(index);
                    if let (Some(into), Some(from)) = (head.get_mut(other), tail.first()) {
                        let most = larger(into.weight_ln, from.weight_ln);
                        let (a, b) = (exp(into.weight_ln - most), exp(from.weight_ln - most));
                        let share = b / (a + b);
                        if share > 1e-4 {
                            into.filter.merge(&from.filter, share);
                        }
                        into.weight_ln = most + ln(a + b);
                        into.age = into.age.max(from.age);
                    }
                }
                None if fits => {
                    components.swap(kept, index);
                    kept += 1;
                    if is_new { new += 1 } else { established += 1 }
                }
                None => {}
            }
        }
        components.truncate(kept);
        components.sort_unstable_by(|a, b| b.weight_ln.total_cmp(&a.weight_ln));
    }

    /// Normalises and sums up.
    pub fn conclude(&mut self, through: impl Fn([f32; 2], [f32; 2], f32) -> f32, inside: impl Fn([f32; 2], f32) -> f32, is_heard: bool) {
        for c in &mut self.components {
            let p = c.filter.position_m();
            let cov = c.filter.position_covariance_m2();
            let std_m = sqrt(larger(0.5 * (cov.m11 + cov.m22), 0.0));
            let mut hindrance = 0.0;
            let mut barrier = 0.0;
            if knob(12) > 0.0 {
                barrier = ln(larger(through(c.from_m, p, std_m), 0.05));
                hindrance += barrier;
            }
            if knob(13) > 0.0 {
                hindrance += ln(larger(inside(p, std_m), 1e-3));
            }
            c.weight_ln += hindrance - c.hindrance_ln;
            c.hindrance_ln = hindrance;
            let [dx, dy] = [p[0] - c.from_m[0], p[1] - c.from_m[1]];
            if dx * dx + dy * dy > 0.09 && (barrier > -0.1 || barrier < -2.5) {
                c.from_m = p;
                c.hindrance_ln -= barrier;
            }
        }
        self.reduce();
        let total = self.total_ln();
        let best = self.most_ln();
        let (mut mx, mut my) = (0.0, 0.0);
        for c in &mut self.components {
            if c.weight_ln > best - 5.0 {
                c.age = ESTABLISHED;
            }
            c.weight_ln -= total;
            let w = exp(c.weight_ln);
            let [x, y] = c.filter.position_m();
            mx += w * x;
            my += w * y;
        }
        let mut cov = Matrix2::new(0.0, 0.0, 0.0, 0.0);
        for c in &self.components {
            let w = exp(c.weight_ln);
            let [x, y] = c.filter.position_m();
            let own = c.filter.position_covariance_m2();
            let (dx, dy) = (x - mx, y - my);
            cov.m11 += w * (own.m11 + dx * dx);
            cov.m21 += w * (own.m21 + dx * dy);
            cov.m22 += w * (own.m22 + dy * dy);
        }
        cov.m12 = cov.m21;
        let mut summary = Summary { position_m: [mx, my], probability: -1.0, covariance_m2: cov };
        for c in &self.components {
            if c.weight_ln < -4.0 {
                continue;
            }
            let [x, y] = c.filter.position_m();
            let own = c.filter.position_covariance_m2();
            let near = 0.09 + 2.0 * (own.m11 + own.m22);
            let (mut w, mut sx, mut sy) = (0.0, 0.0, 0.0);
            for d in &self.components {
                let [a, b] = d.filter.position_m();
                if (a - x) * (a - x) + (b - y) * (b - y) < near {
                    let p = exp(d.weight_ln);
                    w += p;
                    sx += p * a;
                    sy += p * b;
                }
            }
            if w > summary.probability {
                summary.probability = w;
                summary.position_m = [sx / w, sy / w];
            }
        }
        self.summary = summary;
        if summary.probability > 0.99 && cov.m11 + cov.m22 < 0.04 && is_heard && let Some(leader) = self.components.first() {
            self.trusted = leader.filter.clone();
        }
    }

    /// Whether the map may be judged.
    pub fn is_sure(&self) -> bool {
        let c = &self.summary.covariance_m2;
        self.summary.probability > knob(14) && c.m11 + c.m22 < 0.25
    }

    /// The leader's map is `filter`'s now; others take over what changed.
    pub fn follow_map(&mut self, filter: &StateFilter<ANCHORS, SURFACES>) {
        if let Some((leader, others)) = self.components.split_first_mut() {
            leader.filter = filter.clone();
            for other in others {
                other.filter.follow_map(filter);
            }
        }
        self.trusted.follow_map(filter);
    }
    /// Step.
    pub fn _step(_: &MotionStep, _: &Motion) {}
}

fn apart<const A: usize, const S: usize>(a: &StateFilter<A, S>, b: &StateFilter<A, S>) -> f32 {
    let (p, q) = (a.position_m(), b.position_m());
    let (c, d) = (a.position_covariance_m2(), b.position_covariance_m2());
    distance2([p[0] - q[0], p[1] - q[1]], [c.m11 + d.m11 + 1e-6, c.m21 + d.m21, c.m22 + d.m22 + 1e-6])
}

fn distance2([dx, dy]: [f32; 2], [xx, yx, yy]: [f32; 3]) -> f32 {
    let det = larger(xx * yy - yx * yx, 1e-12);
    (yy * dx * dx - 2.0 * yx * dx * dy + xx * dy * dy) / det
}

fn is_one<const A: usize, const S: usize>(a: &StateFilter<A, S>, b: &StateFilter<A, S>) -> bool {
    if apart(a, b) > knob(10) {
        return false;
    }
    let (c, d) = (a.agent_covariance(), b.agent_covariance());
    let (v, w) = (a.velocity_m_s(), b.velocity_m_s());
    distance2([v[0] - w[0], v[1] - w[1]], [c.m33 + d.m33 + 1e-4, c.m43 + d.m43, c.m44 + d.m44 + 1e-4]) <= knob(11)
}
