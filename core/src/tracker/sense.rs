//! The mixture hears a scan.

use super::values::{Known, Told};
use crate::knob::knob;
use crate::memory::clutter::ClutterMemory;
use crate::model::measurement::Clutter;
use crate::perceptor::association::outcome::AssociatedScan;
use crate::perceptor::association::{Beliefs, Given, associate_given};
use crate::perceptor::belief::mixture::{Mixture, SLOTS};
use crate::perceptor::expectation::{Expectation, Expectations};
use crate::perceptor::scan::Scan;
use crate::real::{TAU, exp, larger, limited, ln, smaller, sqrt};
use crate::memory::environment::EnvironmentMemory;
use crate::memory::channel::ChannelMemory;
use crate::model::availability::Walls;
use crate::model::plan::FloorPlan;
use heapless::Vec;

/// What the heaviest component made of a scan.
pub(super) struct Heard<const SOURCES: usize, const PATHS: usize> {
    pub(super) expected: Expectations<SOURCES>,
    pub(super) beliefs: Beliefs<SOURCES, PATHS>,
    weight_ln: f32,
}

/// Densities of what belongs to nothing known at each measurement, over the usual.
fn background<const PATHS: usize>(
    scan: &Scan<PATHS>,
    direct: &Expectation,
    clutter: &Clutter,
    totals: &[f32; PATHS],
    persistent: &[f32; PATHS],
    pulse_m: f32,
) -> ([f32; PATHS], f32) {
    let false_share = clutter.false_alarms_per_m / clutter.all_per_m;
    let std = sqrt(larger(direct.variance_m2, 0.0));
    let mut claims = [1.0; PATHS];
    let mut sum = 0.0;
    for ((claim, measurement), (total, persistent)) in claims.iter_mut().zip(&scan.measurements).zip(totals.iter().zip(persistent)) {
        let z = 1.7 * (direct.range_m - 0.3 * pulse_m - 0.05 - measurement.range_m) / (std + 0.02);
        let later = 1.0 / (1.0 + exp(limited(z, -40.0, 40.0)));
        *claim = false_share * measurement.false_alarm + (1.0 - false_share) * later + (total - 1.0) + persistent;
        sum += ln(*claim);
    }
    (claims, sum)
}

struct Branch<const SOURCES: usize, const PATHS: usize> {
    given: Vec<Given, 3>,
    beliefs: Beliefs<SOURCES, PATHS>,
}

#[allow(clippy::too_many_arguments)]
#[inline(never)]
pub(super) fn sense<
    const ANCHORS: usize,
    const SURFACES: usize,
    const SOURCES: usize,
    const SEGMENTS: usize,
    const PATHS: usize,
    const ACTIONS: usize,
>(
    mixture: &mut Mixture<ANCHORS, SURFACES>,
    told: &Told<'_, ANCHORS, ACTIONS>,
    environment: &EnvironmentMemory<SURFACES, SOURCES>,
    channel: &ChannelMemory<ANCHORS, SOURCES, ACTIONS>,
    clutter_memory: &ClutterMemory<ANCHORS>,
    (plan, walls): (&FloorPlan<SEGMENTS>, &Walls<'_, SEGMENTS>),
    scan: &Scan<PATHS>,
    totals: &[f32; PATHS],
) -> Option<Heard<SOURCES, PATHS>> {
    let mut clutter = clutter_memory.clutter(scan.anchor);
    let tail_m = knob(19) * scan.resolution_m();
    if scan.is_framed() { clutter.tail_m2 = tail_m * tail_m; }
    let persistent = clutter_memory.persistent(scan);
    let pulse_m = if scan.is_framed() { scan.resolution_m() } else { 0.0 };
    let mut best: Option<Heard<SOURCES, PATHS>> = None;
    for index in 0..mixture.components.len() {
        let room = SLOTS - mixture.components.len();
        let Some(component) = mixture.components.get(index) else { break };
        let base_ln = component.weight_ln;
        let known = Known { filter: &component.filter, environment, channel, clutter: clutter_memory, plan, walls };
        let Some(expected) = known.expect(told, scan) else { continue };
        let (claims, earlier_ln) = background(scan, &expected.direct_path, &clutter, totals, &persistent, pulse_m);
        let run = |given: &[Given]| {
            associate_given(&expected.direct_path, &expected.expectations, &scan.measurements, &claims, &clutter, given)
        };
        let mut branches: Vec<Branch<SOURCES, PATHS>, 8> = Vec::new();
        let _ = branches.push(Branch { given: Vec::new(), beliefs: run(&[]) });
        let most = (knob(6) as usize).min(room + 1).min(8);
        while branches.len() < most {
            let mut choice: Option<(usize, usize, f32)> = None;
            let top = branches.iter().fold(f32::NEG_INFINITY, |most, b| larger(most, b.beliefs.evidence_ln));
            for (b, branch) in branches.iter().enumerate() {
                if branch.given.is_full() { continue; }
                let share = exp(branch.beliefs.evidence_ln - top);
                for (feature, (belief, (regression, expectation))) in branch.beliefs.features().zip(expected.regressions().zip(core::iter::once(&expected.direct_path).chain(&expected.expectations))).enumerate() {
                    let outcomes = u32::from(belief.missed > knob(7)) + belief.associated.iter().map(|p| u32::from(*p > knob(7))).sum::<u32>();
                    if outcomes < 2 || branch.given.iter().any(|(other, _)| *other == feature) { continue; }
                    let (mut noise, mut weight, mut first, mut second) = (0.0, 0.0, 0.0, 0.0);
                    for (m, p) in scan.measurements.iter().zip(&belief.associated) {
                        noise += p * m.variance_m2; weight += p;
                        first += p * m.range_m; second += p * m.range_m * m.range_m;
                    }
                    let _ = (first, second);
                    let noise = noise / larger(weight, 1e-6) + regression.residual_m2;
                    let info = regression.explained_m2 / (regression.explained_m2 + noise);
                    if info < knob(8) { continue; }
                    let largest = belief.associated.iter().fold(belief.missed, |a, b| larger(a, *b));
                    let _ = expectation;
                    let worth = share * info * (1.0 - largest);
                    if choice.is_none_or(|(_, _, w)| worth > w) { choice = Some((b, feature, worth)); }
                }
            }
            let Some((b, feature, _)) = choice else { break };
            let Some(parent) = branches.get(b) else { break };
            let Some(belief) = parent.beliefs.features().nth(feature) else { break };
            let mut outcomes: Vec<(Option<usize>, f32), PATHS> = Vec::new();
            if belief.missed > knob(7) { let _ = outcomes.push((None, belief.missed)); }
            for (m, p) in belief.associated.iter().enumerate() {
                if *p > knob(7) { let _ = outcomes.push((Some(m), *p)); }
            }
            outcomes.sort_unstable_by(|a, b| b.1.total_cmp(&a.1));
            let given = parent.given.clone();
            let mut is_first = true;
            for (outcome, _) in outcomes {
                if branches.len() >= most && !is_first { break; }
                let mut own = given.clone();
                let _ = own.push((feature, outcome));
                let beliefs = run(&own);
                let child = Branch { given: own, beliefs };
                if is_first {
                    if let Some(place) = branches.get_mut(b) { *place = child; }
                    is_first = false;
                } else {
                    let _ = branches.push(child);
                }
            }
        }
        let mut template = None;
        for (number, branch) in branches.into_iter().enumerate() {
            let weight_ln = base_ln + earlier_ln + branch.beliefs.evidence_ln;
            let outcome = AssociatedScan { scan, expected: &expected, beliefs: branch.beliefs, evidence_nat: 0.0, tail_m2: clutter.tail_m2 };
            if number == 0 {
                let Some(component) = mixture.components.get_mut(index) else { break };
                template = Some(component.clone());
                component.filter.update(outcome.innovations());
                component.weight_ln = weight_ln;
            } else if let Some(template) = &template {
                let mut child = template.clone();
                child.filter.update(outcome.innovations());
                child.weight_ln = weight_ln;
                let _ = mixture.components.push(child);
            }
            if best.as_ref().is_none_or(|best| weight_ln > best.weight_ln) {
                let AssociatedScan { beliefs, .. } = outcome;
                best = Some(Heard { expected: expected.clone(), beliefs, weight_ln });
            }
        }
    }
    mixture.reduce();
    best
}

/// Proposes places by the earliest ranges of every scan.
#[allow(clippy::too_many_arguments)]
#[inline(never)]
pub(super) fn propose<
    const ANCHORS: usize,
    const SURFACES: usize,
    const SOURCES: usize,
    const SEGMENTS: usize,
    const PATHS: usize,
    const ACTIONS: usize,
>(
    mixture: &mut Mixture<ANCHORS, SURFACES>,
    told: &Told<'_, ANCHORS, ACTIONS>,
    environment: &EnvironmentMemory<SURFACES, SOURCES>,
    channel: &ChannelMemory<ANCHORS, SOURCES, ACTIONS>,
    clutter_memory: &ClutterMemory<ANCHORS>,
    plan: &FloorPlan<SEGMENTS>,
    scans: &Vec<Scan<PATHS>, ANCHORS>,
    elapsed_s: f32,
) {
    struct Arc { position_m: [f32; 2], radial: [f32; 2], across_m2: f32, score: f32 }
    let limit = knob(4) as usize;
    if limit == 0 { return; }
    let arcs = knob(15) as usize;
    let phase = mixture.phase();
    let mut found: Vec<Arc, 16> = Vec::new();
    let filter = mixture.trusted.clone();
    for scan in scans {
        let Some(sight) = told.sight(scan.anchor) else { continue };
        let Some((bias_m, bias_m2)) = filter.bias_m(scan.anchor) else { continue };
        let mut after = 0.0;
        for _ in 0..2 {
            let Some(m) = scan.measurements.iter().filter(|m| m.range_m > after && m.false_alarm < 0.6).reduce(|a, b| if b.range_m < a.range_m { b } else { a }) else { break };
            after = m.range_m;
            let slant = m.range_m - bias_m;
            let radius2 = slant * slant - sight.height_m * sight.height_m;
            if radius2 <= 0.0 { continue; }
            let radius = sqrt(radius2);
            for arc in 0..arcs {
                let angle = TAU * (phase + arc as f32) / arcs as f32;
                let (uy, ux) = (libm::sinf(angle), libm::cosf(angle));
                let p = [sight.anchor_m[0] + radius * ux, sight.anchor_m[1] + radius * uy];
                let across = 0.3 * TAU * radius / arcs as f32;
                let across_m2 = larger(across * across, 1e-4);
                let mut score = ln(larger(plan.inside(p, across), 1e-3));
                for other in scans {
                    let Some(sight) = told.sight(other.anchor) else { continue };
                    let clutter = clutter_memory.clutter(other.anchor);
                    let Some((bias_m, bias2)) = filter.bias_m(other.anchor) else { continue };
                    let (direct_p, images_p) = super::values::detections_anywhere(told, other, environment, channel);
                    let pulse_m = if other.is_framed() { other.resolution_m() } else { 0.0 };
                    let range_to = |q: [f32; 2]| { let (dx, dy) = (p[0] - q[0], p[1] - q[1]); sqrt(dx * dx + dy * dy + sight.height_m * sight.height_m) + bias_m };
                    let direct_m = range_to(sight.anchor_m);
                    let direct = Expectation { range_m: direct_m, variance_m2: across_m2, existence: 1.0, detection: direct_p };
                    let (claims, sum) = background(other, &direct, &clutter, &[1.0; PATHS], &[0.0; PATHS], pulse_m);
                    score += sum;
                    let mut nus = [1.0; PATHS];
                    let mut weigh = |range_m: f32, variance: f32, q: f32| {
                        let mut s = 0.0;
                        let mut terms = [0.0; PATHS];
                        for (((m, claim), nu), term) in other.measurements.iter().zip(&claims).zip(&nus).zip(terms.iter_mut()) {
                            let v = variance + m.variance_m2;
                            let d = m.range_m - range_m;
                            if d * d > 12.0 * v { continue; }
                            *term = q * nu * exp(-0.5 * d * d / v) / sqrt(TAU * v) / (clutter.all_per_m * claim);
                            s += *term;
                        }
                        let l = 1.0 - q + s;
                        score += ln(l);
                        if s > 0.1 * l {
                            for (nu, term) in nus.iter_mut().zip(&terms) { *nu *= larger(1.0 - term / l, 0.0); }
                        }
                    };
                    weigh(direct_m, across_m2 + bias2, direct_p);
                    for (slot, record) in environment.iter().filter(|(_, r)| r.anchor == other.anchor) {
                        let Some((at, c)) = filter.placed(sight.anchor_m, &record.sequence) else { continue };
                        let (dx, dy) = (p[0] - at.x, p[1] - at.y);
                        let r = range_to([at.x, at.y]);
                        if r < direct_m - 0.3 { continue; }
                        let n2 = larger(dx * dx + dy * dy, 1e-6);
                        let v = (dx * dx * c.m11 + 2.0 * dx * dy * c.m21 + dy * dy * c.m22) / n2;
                        weigh(r, v + across_m2 + bias2, environment.existence(slot) * images_p.get(slot).copied().unwrap_or(0.0));
                    }
                }
                let arc = Arc { position_m: p, radial: [ux, uy], across_m2: larger(across_m2, 0.0025), score };
                if found.len() < limit.min(16) {
                    let _ = found.push(arc);
                } else if let Some(least) = found.iter_mut().reduce(|a, b| if b.score < a.score { b } else { a }) && least.score < arc.score {
                    *least = arc;
                }
            }
            let _ = (bias_m2, smaller(0.0, 0.0));
        }
    }
    for arc in found {
        mixture.enter(arc.position_m, arc.radial, [0.09, arc.across_m2], told.config.ranging.max_range_m, elapsed_s);
    }
}
