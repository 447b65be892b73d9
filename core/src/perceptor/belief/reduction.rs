//! Reduction: components that have become one are merged, and the lightest give way.

use super::TagBelief;
use super::component::{apart, is_one};
use crate::real::{exp, larger, ln};
use heapless::Vec;

/// Tuned: against dropping a newcomer before it could show anything: cycles heard in which it stays whatever its weight.
pub const PROTECTED: u16 = 5;
/// Tuned: a component that finds no room but is so near to the best, nats, joins the nearest, so that the spread stays honest.
pub const JOINED_NAT: f32 = 7.0;
/// Guard: against work on what changes nothing: share below which a merged component's state is not mixed in.
const LEAST_SHARE: f32 = 1e-4;

/// What becomes of a component.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Fate {
    Kept,
    /// Becomes part of another.
    Merged(usize),
    Dropped,
}

impl<const ANCHORS: usize, const SURFACES: usize, const COMPONENTS: usize>
    TagBelief<ANCHORS, SURFACES, COMPONENTS>
{
    /// The indices of the components, the heaviest first, of equals the first.
    pub(super) fn order(&self) -> Vec<usize, COMPONENTS> {
        let mut order: Vec<usize, COMPONENTS> = Vec::new();
        for (index, component) in self.components.iter().enumerate() {
            // Written so that NaN stands in the way of nothing.
            let heavier = |&other: &usize| {
                self.components.get(other).is_some_and(|other| !(other.weight_nat < component.weight_nat))
            };
            let place = order.iter().take_while(|other| heavier(other)).count();
            // As many as components: the insertion succeeds.
            let _ = order.insert(place, index);
        }
        order
    }

    /// Merges what is one and keeps the heaviest: half as many as there may be components, and a quarter of newcomers.
    #[inline(never)]
    pub fn reduce(&mut self) {
        let order = self.order();
        let best = self.best_nat();
        let mut kept: Vec<usize, COMPONENTS> = Vec::new();
        let (mut established, mut newcomers) = (0, 0);
        let mut is_kept = [false; COMPONENTS];
        for index in order {
            match self.fate(index, best, &kept, established, newcomers) {
                Fate::Dropped => {}
                Fate::Merged(other) => self.merge(other, index),
                Fate::Kept => {
                    let is_new = self.components.get(index).is_some_and(|own| own.age < PROTECTED);
                    newcomers += usize::from(is_new);
                    established += usize::from(!is_new);
                    // As many as components: the push succeeds.
                    let _ = kept.push(index);
                    if let Some(is_kept) = is_kept.get_mut(index) {
                        *is_kept = true;
                    }
                }
            }
        }
        let mut flags = is_kept.iter();
        self.components.retain(|_| flags.next().copied().unwrap_or(false));
        self.leader = self.order().first().copied().unwrap_or(0);
    }

    /// What becomes of a component, when these heavier ones are kept.
    fn fate(&self, index: usize, best: f32, kept: &[usize], established: usize, newcomers: usize) -> Fate {
        let Some(own) = self.components.get(index) else { return Fate::Dropped };
        let is_new = own.age < PROTECTED;
        let agent = own.filter.agent();
        let behind = best - own.weight_nat;
        // Written so that NaN is dropped.
        if !is_new && !(behind <= self.settings.dropped_nat) || behind.is_nan() {
            return Fate::Dropped;
        }
        let others = || kept.iter().filter_map(|&other| Some((other, self.components.get(other)?)));
        if let Some((other, _)) = others().find(|(_, other)| is_one(&other.filter.agent(), &agent)) {
            return Fate::Merged(other);
        }
        let fits = if is_new {
            newcomers < larger_half(COMPONENTS / 2)
        } else {
            established < larger_half(COMPONENTS)
        };
        if fits {
            return Fate::Kept;
        }
        if is_new || behind > JOINED_NAT {
            return Fate::Dropped;
        }
        let mut nearest: Option<(usize, f32)> = None;
        for (other, component) in others().filter(|(_, component)| component.age >= PROTECTED) {
            let distance = apart(&component.filter.agent(), &agent);
            if nearest.is_none_or(|(_, least)| distance < least) {
                nearest = Some((other, distance));
            }
        }
        nearest.map_or(Fate::Dropped, |(other, _)| Fate::Merged(other))
    }

    /// Makes component `from` part of component `into`.
    fn merge(&mut self, into: usize, from: usize) {
        let Ok([into, from]) = self.components.get_disjoint_mut([into, from]) else { return };
        let heavier = larger(into.weight_nat, from.weight_nat);
        let (own, other) = (exp(into.weight_nat - heavier), exp(from.weight_nat - heavier));
        let share = other / (own + other);
        if share > LEAST_SHARE {
            into.filter.merge(&from.filter, share);
        }
        into.weight_nat = heavier + ln(own + other);
        into.age = into.age.max(from.age);
    }
}

/// Half of it, at least 1.
fn larger_half(count: usize) -> usize {
    count.div_ceil(2).max(1)
}
