//! Belief: where the tag is, as a mixture of joint Gaussians with weights.
//!
//! All components are predicted, compared with the scans and updated alike. A turn, a wide Gaussian and early ranges add
//! components; those that have become one are merged, and the lightest give way. The heaviest leads.

use super::association::{Clutter, Measurement};
use super::clock::probability;
use super::motion::{Agent, PX, PY, ProcessNoise, VX, VY};
use super::outage::{Outages, weigh};
use super::proposal::{self, Proposal};
use super::real::{Real, exp, larger, ln, smaller, sqrt, square, tau};
use super::region::Region;
use super::state_filter::StateFilter;
use super::{Square, zeros};
use cogmint_core::perceptor::belief::anywhere::{LARGEST_RATIO, MOST_EXPECTED};
use cogmint_core::perceptor::belief::component::{
    LEAST_DETERMINANT, LEAST_SPREAD, LEAST_THROUGH, ONE, OUTSIDE,
};
use cogmint_core::perceptor::belief::reduction::{LEAST_SHARE, PROTECTED};
use cogmint_core::perceptor::belief::summary::{DEVIATIONS, LEAST_MOMENT_M2, LIGHTEST_NAT, WITHIN_M};
use cogmint_core::perceptor::belief::{
    BeliefSettings, CHILDREN_NAT, COUNTS_NAT, DROPPED_NAT, EXPLAINED_BELOW, EXPLAINED_GAIN, KNOWN, LEAST_NAT,
    OUT, PLACE_M, SETTLED, SURE,
};
use std::fmt;

/// One of the places that the tag may be at, with its own map.
#[derive(Clone, Debug)]
pub struct Component<T> {
    /// Tag, biases and surfaces.
    pub filter: StateFilter<T>,
    /// ln of its weight.
    pub weight_nat: T,
    /// Cycles heard since it was proposed; the largest number where it is established.
    age: u16,
    /// Of which anchors it hears nothing.
    pub outages: Outages<T>,
    /// Where its way began, metres.
    from_m: [T; 2],
    /// ln of the factor of that way and of the outline in its weight.
    hindrance_nat: T,
}

/// The leading place.
#[derive(Clone, Debug)]
pub struct Summary<T> {
    /// Its mean, metres.
    pub position_m: [T; 2],
    /// Probability that the tag is there.
    pub probability: T,
    /// Covariance over all places, square metres.
    pub covariance_m2: Square<T>,
}

/// The belief.
#[derive(Clone, Debug)]
pub struct Belief<T> {
    settings: BeliefSettings,
    capacity: usize,
    /// Of these, how many a cycle has work for.
    slots: usize,
    /// Components that counted and found no room in this cycle.
    pub crowded_out: u32,
    /// Variance of a velocity of which nothing is known, per axis.
    speed_m2_s2: T,
    /// The components.
    pub components: Vec<Component<T>>,
    /// Which of them is the heaviest.
    pub leader: usize,
    /// The state when the tag was last known.
    pub trusted: StateFilter<T>,
    /// What is believed.
    pub summary: Summary<T>,
    region: Region<T>,
    /// ln of the weight of a tag that is anywhere in it.
    pub anywhere_nat: T,
    /// Of which anchors nothing is heard there.
    pub outages: Outages<T>,
    explained: T,
    /// Whether what was heard last left doubt.
    is_doubtful: bool,
    heard: u32,
}

impl<T: Real> Belief<T> {
    /// A single component, of at most `capacity`.
    pub fn new(
        filter: StateFilter<T>,
        velocity_std_m_s: f32,
        region: Region<T>,
        settings: BeliefSettings,
        capacity: usize,
    ) -> Self {
        let agent = filter.agent();
        let summary = Summary {
            position_m: filter.position_m(),
            probability: within(spread_m2(&agent)),
            covariance_m2: position_block(&agent),
        };
        let outages = Outages::usual(filter.anchors, &settings);
        let first = Component {
            outages: outages.clone(),
            from_m: filter.position_m(),
            filter: filter.clone(),
            weight_nat: T::ZERO,
            age: u16::MAX,
            hindrance_nat: T::ZERO,
        };
        Self {
            settings,
            capacity,
            slots: capacity,
            crowded_out: 0,
            speed_m2_s2: square(T::of(velocity_std_m_s)),
            components: vec![first],
            leader: 0,
            trusted: filter,
            is_doubtful: summary.probability < T::of(SETTLED),
            summary,
            region,
            anywhere_nat: T::of(LEAST_NAT),
            outages,
            explained: T::ONE,
            heard: 0,
        }
    }

    /// The state of the heaviest component.
    pub fn leading(&self) -> &StateFilter<T> {
        &self.components[self.leader].filter
    }

    /// Whether it is not known where the tag is.
    pub fn is_searching(&self) -> bool {
        self.summary.probability < T::of(KNOWN)
    }

    /// Whether an anchor is more probably out than heard.
    pub fn is_out(&self, anchor: usize) -> bool {
        self.components[self.leader].outages.0[anchor] > T::of(OUT)
    }

    /// Enters an anchor's scan, `dt` seconds after the last, as a tag that is anywhere explains it.
    pub fn hear_anywhere(&mut self, anchor: usize, dt: T, evidence_nat: T) {
        let outage = self.outages.predict(anchor, dt, &self.settings);
        let (evidence_nat, outage) = weigh(outage, evidence_nat);
        self.anywhere_nat += evidence_nat;
        self.outages.0[anchor] = outage;
    }

    /// Whether memories and map may be judged.
    pub fn is_sure(&self) -> bool {
        self.summary.probability > T::of(SURE)
    }

    /// Whether places are proposed in this cycle.
    pub fn proposes(&self) -> bool {
        self.is_doubtful || self.heard.is_multiple_of(proposal::EVERY)
    }

    /// Whether they are in the next one that hears anything.
    pub fn will_propose(&self) -> bool {
        self.is_doubtful || self.heard.wrapping_add(1).is_multiple_of(proposal::EVERY)
    }

    /// Where its arcs begin.
    pub fn turn(&self) -> [T; 2] {
        proposal::turn(self.heard)
    }

    /// A cycle of so many scans begins: it has work for this many components.
    pub fn begin(&mut self, scans: usize, slots: usize) {
        self.crowded_out = 0;
        self.slots = slots.max(2).min(self.capacity);
        if scans > 0 && self.components.len() > self.slots {
            self.reduce();
            self.normalise();
        }
    }

    /// `dt` seconds later; `unheard_s` is the time since anything was heard, where something is.
    pub fn predict(&mut self, dt: T, unheard_s: Option<T>) {
        for component in &mut self.components {
            component.filter.predict(dt);
        }
        let Some(unheard_s) = unheard_s else { return };
        self.heard = self.heard.wrapping_add(1);
        let floor = T::of(f32::MIN_POSITIVE);
        let elsewhere = probability(self.settings.elsewhere_per_s, unheard_s);
        let moved_nat = self.total_nat() + ln(larger(elsewhere, floor));
        self.anywhere_nat = sum_nat(self.anywhere_nat, moved_nat);
        for component in &mut self.components {
            component.age = component.age.saturating_add(1);
            component.weight_nat += ln(larger(T::ONE - elsewhere, floor));
        }
        // Split first, then turn.
        let room = self.room();
        for parent in self.parents(COUNTS_NAT) {
            if self.components.len() + 2 > room {
                break;
            }
            self.split(parent);
        }
        let turned = probability(self.settings.turns_per_s, unheard_s);
        if turned > T::ZERO {
            let room = self.room();
            for parent in self.parents(CHILDREN_NAT) {
                if self.components.len() + 2 > room {
                    break;
                }
                let mut child = self.components[parent].clone();
                child.filter.turn(self.speed_m2_s2, unheard_s);
                child.weight_nat += ln(turned);
                self.components[parent].weight_nat += ln(larger(T::ONE - turned, T::of(f32::MIN_POSITIVE)));
                self.components.push(child);
            }
        }
    }

    /// The components within so many nats of the best, the heaviest first.
    fn parents(&self, within_nat: f32) -> Vec<usize> {
        let least = self.best_nat() - T::of(within_nat);
        let mut order = self.order();
        order.retain(|&index| self.components[index].weight_nat > least);
        order
    }

    /// How many components there may be without taking the place of newcomers.
    fn room(&self) -> usize {
        let newcomers = self.components.iter().filter(|component| component.age < PROTECTED).count();
        self.slots - (self.slots / 4).saturating_sub(newcomers)
    }

    /// A wide component becomes three along its longest axis.
    fn split(&mut self, index: usize) {
        let num = T::of;
        let component = &self.components[index];
        let c = &component.filter.agent_covariance();
        let half = num(0.5) * (c[PX][PX] + c[PY][PY]);
        let apart = num(0.5) * (c[PX][PX] - c[PY][PY]);
        let major = half + sqrt(square(apart) + square(c[PY][PX]));
        if major <= square(num(self.settings.split_above_m)) {
            return;
        }
        // An eigenvector, from the row that is not nearly zero.
        let [x, y] =
            if apart > T::ZERO { [major - c[PY][PY], c[PY][PX]] } else { [c[PY][PX], major - c[PX][PX]] };
        let norm = sqrt(square(x) + square(y));
        let axis = if norm > T::ZERO { [x / norm, y / norm] } else { [T::ONE, T::ZERO] };
        for deviations in [-1.0, 1.0] {
            let mut side = self.components[index].clone();
            side.filter.narrow(axis, num(deviations), num(0.5));
            side.weight_nat += ln(num(0.25));
            self.components.push(side);
        }
        let middle = &mut self.components[index];
        middle.filter.narrow(axis, T::ZERO, num(0.5));
        middle.weight_nat += ln(num(0.5));
    }

    /// Takes a proposed place in, if there is room.
    pub fn enter(&mut self, proposal: &Proposal<T>) {
        let Proposal { position_m, radial: [ux, uy], variance_m2: [along, across], .. } = *proposal;
        let mut agent = Agent { mean: vec![T::ZERO; 4], covariance: zeros(4, 4) };
        let c = &mut agent.covariance;
        c[PX][PX] = along * square(ux) + across * square(uy);
        c[PY][PY] = along * square(uy) + across * square(ux);
        c[PY][PX] = (along - across) * (ux * uy);
        c[PX][PY] = c[PY][PX];
        for (axis, (p, v)) in [(PX, VX), (PY, VY)].into_iter().enumerate() {
            agent.mean[p] = position_m[axis];
            c[v][v] = self.speed_m2_s2;
        }
        let mut filter = self.trusted.clone();
        filter.place(&agent);
        // The share of the region.
        let share = tau::<T>() * sqrt(along * across) / self.region.area_m2;
        let weight_nat = self.anywhere_nat + ln(smaller(share, T::ONE));
        if self.components.len() < self.slots {
            let (from_m, hindrance_nat) = (filter.position_m(), T::ZERO);
            let outages = self.outages.clone();
            self.components.push(Component { filter, weight_nat, age: 0, outages, from_m, hindrance_nat });
        }
    }

    /// Enters how many strong paths there were, and how many of them are explained.
    pub fn explain(&mut self, strong: T, explained: T) {
        if strong > T::ZERO {
            self.explained += T::of(EXPLAINED_GAIN) * (explained / strong - self.explained);
        }
    }

    /// Merges and drops components, and finds the leader.
    pub fn reduce(&mut self) {
        let best = self.best_nat();
        let mut kept: Vec<usize> = Vec::new();
        let (mut established, mut newcomers) = (0, 0);
        for index in self.order() {
            let own = &self.components[index];
            let agent = own.filter.agent();
            let is_new = own.age < PROTECTED;
            let behind = best - own.weight_nat;
            let is_number = behind.to_f64() >= 0.0;
            if !is_number || (!is_new && behind > T::of(DROPPED_NAT)) {
                continue;
            }
            let components = &self.components;
            let same = |&other: &usize| is_one(&components[other].filter.agent(), &agent);
            if let Some(other) = kept.iter().copied().find(same) {
                self.merge(other, index);
                continue;
            }
            let half = |count: usize| count.div_ceil(2).max(1);
            let fits = if is_new { newcomers < half(self.slots / 2) } else { established < half(self.slots) };
            if fits && kept.len() < self.slots {
                kept.push(index);
                newcomers += usize::from(is_new);
                established += usize::from(!is_new);
            } else if !is_new && behind <= T::of(COUNTS_NAT) {
                let mut nearest: Option<(usize, T)> = None;
                for &other in kept.iter().filter(|&&other| self.components[other].age >= PROTECTED) {
                    let distance = apart(&self.components[other].filter.agent(), &agent);
                    if nearest.is_none_or(|(_, least)| distance < least) {
                        nearest = Some((other, distance));
                    }
                }
                if let Some((other, _)) = nearest {
                    self.crowded_out += 1;
                    self.merge(other, index);
                }
            }
        }
        kept.sort_unstable();
        self.components = kept.into_iter().map(|index| self.components[index].clone()).collect();
        if self.components.is_empty() {
            let filter = self.trusted.clone();
            let from_m = filter.position_m();
            self.components.push(Component {
                filter,
                weight_nat: T::ZERO,
                age: u16::MAX,
                outages: self.outages.clone(),
                from_m,
                hindrance_nat: T::ZERO,
            });
        }
        self.leader = self.order()[0];
    }

    /// Component `from` becomes part of `into`.
    fn merge(&mut self, into: usize, from: usize) {
        let other = self.components[from].clone();
        let own = &mut self.components[into];
        let most = larger(own.weight_nat, other.weight_nat);
        let [a, b] = [own.weight_nat, other.weight_nat].map(|weight| exp(weight - most));
        let share = b / (a + b);
        if share > T::of(LEAST_SHARE) {
            own.filter.merge(&other.filter, share);
            own.outages.merge(&other.outages, share);
        }
        own.weight_nat = most + ln(a + b);
        own.age = own.age.max(other.age);
    }

    /// Ends a cycle. `through` and `inside` as in the core.
    pub fn conclude(&mut self, through: impl Fn([T; 2], [T; 2], T) -> T, inside: impl Fn([T; 2], T) -> T) {
        for component in &mut self.components {
            component.hinder(&through, &inside);
        }
        self.reduce();
        self.normalise();
        let established = self.best_nat() - T::of(COUNTS_NAT);
        for component in &mut self.components {
            if component.weight_nat > established {
                component.age = u16::MAX;
            }
        }
        self.summarise(T::ZERO);
        self.is_doubtful =
            self.summary.probability < T::of(SETTLED) || self.explained < T::of(EXPLAINED_BELOW);
        let is_known = self.summary.probability > T::of(SETTLED);
        if is_known && self.summary.variance_m2() < square(T::of(PLACE_M)) {
            self.trusted = self.leading().clone();
        }
    }

    /// All weights sum up to 1.
    fn normalise(&mut self) {
        let total = sum_nat(self.total_nat(), self.anywhere_nat);
        self.anywhere_nat = larger(self.anywhere_nat - total, T::of(LEAST_NAT));
        for component in &mut self.components {
            component.weight_nat -= total;
        }
    }

    /// The components' weights and tags. Where nothing was heard for so long, the tag may have turned: that widens what is not yet
    /// as wide as the region.
    fn places(&self, unheard_s: T) -> (Vec<T>, Vec<Agent<T>>) {
        let turned = probability(self.settings.turns_per_s, unheard_s);
        let turn_m2 = turned * ProcessNoise::of_turn(self.speed_m2_s2, unheard_s).position;
        let [xx, _, yy] = self.region.covariance_m2;
        let most_m2 = T::of(0.5) * (xx + yy);
        let weights = self.components.iter().map(|component| exp(component.weight_nat)).collect();
        let mut agents: Vec<Agent<T>> =
            self.components.iter().map(|component| component.filter.agent()).collect();
        for agent in &mut agents {
            let own_m2 = T::of(0.5) * spread_m2(agent);
            let more_m2 = smaller(turn_m2, larger(most_m2 - own_m2, T::ZERO));
            for axis in [PX, PY] {
                agent.covariance[axis][axis] += more_m2;
            }
        }
        (weights, agents)
    }

    /// Mean and covariance over all places, where nothing was heard for so long.
    pub fn moments(&self, unheard_s: T) -> ([T; 2], Square<T>) {
        let (weights, agents) = self.places(unheard_s);
        let anywhere = exp(self.anywhere_nat);
        let mut mean = self.region.centre_m.map(|centre| anywhere * centre);
        for (weight, agent) in weights.iter().zip(&agents) {
            for axis in [PX, PY] {
                mean[axis] += *weight * agent.mean[axis];
            }
        }
        let mut covariance_m2 = [[T::ZERO; 2]; 2];
        let d = [0, 1].map(|axis| self.region.centre_m[axis] - mean[axis]);
        for (n, (row, column)) in [(0, 0), (1, 0), (1, 1)].into_iter().enumerate() {
            covariance_m2[row][column] = anywhere * (self.region.covariance_m2[n] + d[column] * d[row]);
        }
        for (weight, agent) in weights.iter().zip(&agents) {
            let d = [agent.mean[PX] - mean[0], agent.mean[PY] - mean[1]];
            for (row, column) in [(0, 0), (1, 0), (1, 1)] {
                covariance_m2[row][column] += *weight * (agent.covariance[row][column] + d[column] * d[row]);
            }
        }
        covariance_m2[0][1] = covariance_m2[1][0];
        (mean, covariance_m2)
    }

    /// Position, probability and covariance, where nothing was heard for so long.
    pub fn summarise(&mut self, unheard_s: T) {
        let num = T::of;
        let (weights, agents) = self.places(unheard_s);
        let (mean, covariance_m2) = self.moments(unheard_s);
        let mut summary = Summary { position_m: mean, probability: T::ZERO, covariance_m2 };
        let mut most = T::ZERO;
        for (component, agent) in self.components.iter().zip(&agents) {
            if component.weight_nat <= num(LIGHTEST_NAT) {
                continue;
            }
            let c = &agent.covariance;
            let near_m2 = square(num(PLACE_M)) + num(DEVIATIONS) * (c[PX][PX] + c[PY][PY]);
            let mut weight = T::ZERO;
            let mut sum = [T::ZERO; 2];
            for (own, other) in weights.iter().zip(&agents) {
                let d = [PX, PY].map(|p| other.mean[p] - agent.mean[p]);
                if square(d[0]) + square(d[1]) < near_m2 {
                    weight += *own;
                    for axis in [PX, PY] {
                        sum[axis] += *own * other.mean[axis];
                    }
                }
            }
            if weight > most {
                most = weight;
                summary.position_m = sum.map(|sum| sum / weight);
                summary.probability = T::ZERO;
                for (own, other) in weights.iter().zip(&agents) {
                    let d = [PX, PY].map(|p| other.mean[p] - agent.mean[p]);
                    if square(d[0]) + square(d[1]) < near_m2 {
                        let off = [PX, PY].map(|p| other.mean[p] - summary.position_m[p]);
                        let moment_m2 = spread_m2(other) + (square(off[0]) + square(off[1]));
                        summary.probability += *own * within(moment_m2);
                    }
                }
            }
        }
        self.summary = summary;
    }

    /// The others have the leader's map, where it has changed.
    pub fn follow(&mut self) {
        let leader = self.leading().clone();
        for component in &mut self.components {
            component.filter.follow_map(&leader);
        }
        self.trusted.follow_map(&leader);
    }

    /// A private surface, found relative to the leader's tag, in all states.
    pub fn discover(&mut self, slot: usize, position_m: [T; 2], gain: Square<T>, own: Square<T>) {
        let led = self.leading().position_m();
        for filter in self.states() {
            let d = [0, 1].map(|axis| filter.position_m()[axis] - led[axis]);
            let moved = [0, 1].map(|row| position_m[row] + (gain[row][0] * d[0] + gain[row][1] * d[1]));
            filter.insert_relative(slot, moved, gain, own);
        }
    }

    /// Takes a surface out of all states.
    pub fn remove(&mut self, slot: usize) {
        self.states().for_each(|filter| filter.remove(slot));
    }

    /// All states: of the components, and the trusted one.
    fn states(&mut self) -> impl Iterator<Item = &mut StateFilter<T>> {
        self.components
            .iter_mut()
            .map(|component| &mut component.filter)
            .chain(std::iter::once(&mut self.trusted))
    }

    /// Indices by weight, the heaviest first. Stable: the first of equals.
    fn order(&self) -> Vec<usize> {
        let mut order: Vec<usize> = (0..self.components.len()).collect();
        let weight = |index: usize| self.components[index].weight_nat;
        order.sort_by(|&a, &b| weight(b).partial_cmp(&weight(a)).unwrap_or(std::cmp::Ordering::Equal));
        order
    }

    fn best_nat(&self) -> T {
        let weights = self.components.iter().map(|component| component.weight_nat);
        weights.fold(T::of(f32::NEG_INFINITY), |best, weight| larger(weight, best))
    }

    fn total_nat(&self) -> T {
        let best = self.best_nat();
        let mut sum = T::ZERO;
        for component in &self.components {
            sum += exp(component.weight_nat - best);
        }
        best + ln(sum)
    }

    /// Every number of the state with its name, in the order of the core's `visit`.
    pub fn visit(&self, f: &mut dyn FnMut(fmt::Arguments<'_>, T)) {
        f(format_args!("number of components"), T::of_count(self.components.len()));
        f(format_args!("leading component"), T::of_count(self.leader));
        for (index, component) in self.components.iter().enumerate() {
            component.filter.visit(&mut |name, value| f(format_args!("component {index}: {name}"), value));
            f(format_args!("weight of component {index}"), component.weight_nat);
            f(format_args!("age of component {index}"), T::of_count(usize::from(component.age)));
            for outage in &component.outages.0 {
                f(format_args!("outage of an anchor in component {index}"), *outage);
            }
            for axis in 0..2 {
                f(format_args!("beginning of the way of component {index}"), component.from_m[axis]);
            }
            f(format_args!("hindrance of component {index}"), component.hindrance_nat);
        }
        self.trusted.visit(&mut |name, value| f(format_args!("trusted state: {name}"), value));
        for axis in 0..2 {
            f(format_args!("position believed"), self.summary.position_m[axis]);
        }
        f(format_args!("probability of the position"), self.summary.probability);
        for value in self.summary.covariance_m2.iter().flatten() {
            f(format_args!("covariance believed"), *value);
        }
        f(format_args!("weight of anywhere"), self.anywhere_nat);
        for outage in &self.outages.0 {
            f(format_args!("outage of an anchor anywhere"), *outage);
        }
        f(format_args!("share of strong paths explained"), self.explained);
        f(format_args!("doubt"), T::of_count(usize::from(self.is_doubtful)));
        f(format_args!("cycles heard"), T::of_count(self.heard as usize));
    }
}

impl<T: Real> Component<T> {
    /// The way since it was last decided and the place enter the weight, in place of those before.
    fn hinder(&mut self, through: impl Fn([T; 2], [T; 2], T) -> T, inside: impl Fn([T; 2], T) -> T) {
        let num = T::of;
        let agent = self.filter.agent();
        let position_m = self.filter.position_m();
        let c = &agent.covariance;
        let std_m = sqrt(larger(num(0.5) * (c[PX][PX] + c[PY][PY]), T::ZERO));
        let open = larger(through(self.from_m, position_m, std_m), num(LEAST_THROUGH));
        let way_nat = ln(open);
        let place_nat = ln(larger(inside(position_m, std_m), num(OUTSIDE)));
        self.weight_nat += (way_nat + place_nat) - self.hindrance_nat;
        self.hindrance_nat = way_nat + place_nat;
        let way = [0, 1].map(|axis| position_m[axis] - self.from_m[axis]);
        let is_long = square(way[0]) + square(way[1]) > square(num(PLACE_M));
        let is_open = open > num(1.0 - 2.0 * LEAST_THROUGH);
        let is_blocked = open < num(2.0 * LEAST_THROUGH);
        if is_long && (is_open || is_blocked) {
            self.from_m = position_m;
            self.hindrance_nat = place_nat;
        }
    }
}

impl<T: Real> Summary<T> {
    /// Sum of the position's variances, square metres.
    pub fn variance_m2(&self) -> T {
        self.covariance_m2[0][0] + self.covariance_m2[1][1]
    }
}

/// ln of the sum of two weights.
fn sum_nat<T: Real>(a: T, b: T) -> T {
    let (most, least) = if a > b { (a, b) } else { (b, a) };
    most + ln(T::ONE + exp(least - most))
}

/// Evidence of a scan for a tag that is anywhere, of which paths are expected with these probabilities, nats: the sum over how many
/// of them are found, and over which measurements they are.
pub fn anywhere_nat<T: Real>(
    paths: &[T],
    measurements: &[Measurement<T>],
    clutter: &Clutter<T>,
    reach_m: T,
) -> T {
    let most = measurements.len();
    let mut found = vec![T::ZERO; most + 1];
    found[0] = T::ONE;
    for path in paths {
        let q = smaller(*path, T::of(MOST_EXPECTED));
        for count in (0..=most).rev() {
            let hit = if count > 0 { found[count - 1] * q } else { T::ZERO };
            found[count] =
                if count > 0 { found[count] * (T::ONE - q) + hit } else { found[count] * (T::ONE - q) };
        }
    }
    let mut selections = vec![T::ZERO; most + 1];
    selections[0] = T::ONE;
    let mut sum_nat = T::ZERO;
    for z in measurements {
        let background =
            clutter.false_alarms_per_m * z.false_alarm + (clutter.all_per_m - clutter.false_alarms_per_m);
        sum_nat += ln(background / clutter.all_per_m);
        let ratio = smaller(T::ONE / (reach_m * background), T::of(LARGEST_RATIO));
        for count in (1..=most).rev() {
            selections[count] = selections[count] + T::of_count(count) * (ratio * selections[count - 1]);
        }
    }
    let mut sum = found[0];
    for (found, selections) in found.iter().zip(&selections).skip(1) {
        sum += *found * *selections;
    }
    sum_nat + ln(larger(sum, T::of(f32::MIN_POSITIVE)))
}

/// Sum of the variances of the position.
fn spread_m2<T: Real>(agent: &Agent<T>) -> T {
    agent.covariance[PX][PX] + agent.covariance[PY][PY]
}

/// Probability of a distance of at most [`WITHIN_M`] where its square has this mean, of an isotropic Gaussian.
fn within<T: Real>(moment_m2: T) -> T {
    T::ONE - exp(-square(T::of(WITHIN_M)) / larger(moment_m2, T::of(LEAST_MOMENT_M2)))
}

/// The covariance of the position.
fn position_block<T: Real>(agent: &Agent<T>) -> Square<T> {
    let c = &agent.covariance;
    [[c[PX][PX], c[PY][PX]], [c[PY][PX], c[PY][PY]]]
}

/// Squared distance of two tags, in deviations of the difference.
pub fn apart<T: Real>(a: &Agent<T>, b: &Agent<T>) -> T {
    squared_deviations(a, b, [PX, PY], LEAST_SPREAD[0])
}

/// Whether two tags are at one place and move alike.
fn is_one<T: Real>(a: &Agent<T>, b: &Agent<T>) -> bool {
    apart(a, b) <= T::of(ONE) && squared_deviations(a, b, [VX, VY], LEAST_SPREAD[1]) <= T::of(ONE)
}

/// d' C^-1 d of two states, `least` being added to both variances.
fn squared_deviations<T: Real>(a: &Agent<T>, b: &Agent<T>, [i, j]: [usize; 2], least: f32) -> T {
    let d = [i, j].map(|state| a.mean[state] - b.mean[state]);
    let sum = |row: usize, column: usize| a.covariance[row][column] + b.covariance[row][column];
    let (xx, yx, yy) = (sum(i, i) + T::of(least), sum(j, i), sum(j, j) + T::of(least));
    let determinant = larger(xx * yy - square(yx), T::of(LEAST_DETERMINANT));
    // Order: the products of d first.
    let cross = T::of(2.0) * (yx * (d[0] * d[1]));
    (yy * square(d[0]) - cross + xx * square(d[1])) / determinant
}
