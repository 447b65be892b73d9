//! Reduction: components that have become one are merged, and the lightest give way.

use super::component::{Component, apart, is_one};
use super::{COUNTS_NAT, DROPPED_NAT, TagBelief};
use crate::real::{exp, larger, ln};
use heapless::Vec;

/// Tuned: against dropping a newcomer before it could show anything: cycles heard in which it stays whatever its weight.
pub const PROTECTED: u16 = 5;
/// Guard: against work on what changes nothing: share below which a merged component's state is not mixed in.
pub const LEAST_SHARE: f32 = 1e-4;

/// What becomes of a component.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Fate {
    Kept,
    /// Becomes part of another, with which it is one.
    Merged(usize),
    /// Counts, finds no room and becomes part of the nearest.
    Crowded(usize),
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
            // Takes that place, and every later one the next; `Vec::insert` has a panic that no compiler finds unreachable.
            let mut last = index;
            for later in order.iter_mut().skip(place) {
                core::mem::swap(later, &mut last);
            }
            // As many as components: the push succeeds.
            let _ = order.push(last);
        }
        order
    }

    /// Merges what is one and keeps the heaviest: established ones in half of the slots that the cycle has work for and newcomers in
    /// a quarter, each rounded up.
    #[inline(never)]
    pub fn reduce(&mut self) {
        let order = self.order();
        let best = self.best_nat();
        let mut kept: Vec<usize, COMPONENTS> = Vec::new();
        let (mut established, mut newcomers, mut crowded_out) = (0, 0, 0);
        let mut is_kept = [false; COMPONENTS];
        for &index in &order {
            match self.fate(index, best, &kept, established, newcomers) {
                Fate::Dropped => {}
                Fate::Merged(other) => self.merge(other, index),
                Fate::Crowded(other) => {
                    self.merge(other, index);
                    crowded_out += 1;
                }
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
        self.crowded_out += crowded_out;
        let mut flags = is_kept.iter();
        self.components.retain(|_| flags.next().copied().unwrap_or(false));
        if self.components.is_empty() {
            // No weight was a number. There is room: the push succeeds.
            let _ = self.components.push(Component::established(self.trusted.clone(), self.outages));
        }
        self.leader = self.order().first().copied().unwrap_or(0);
    }

    /// What becomes of a component, when these heavier ones are kept.
    fn fate(&self, index: usize, best: f32, kept: &[usize], established: usize, newcomers: usize) -> Fate {
        let Some(own) = self.components.get(index) else { return Fate::Dropped };
        let is_new = own.age < PROTECTED;
        let agent = own.filter.agent();
        let behind = best - own.weight_nat;
        // Written so that NaN is dropped.
        if !is_new && !(behind <= DROPPED_NAT) || behind.is_nan() {
            return Fate::Dropped;
        }
        let others = || kept.iter().filter_map(|&other| Some((other, self.components.get(other)?)));
        if let Some((other, _)) = others().find(|(_, other)| is_one(&other.filter.agent(), &agent)) {
            return Fate::Merged(other);
        }
        let fits = if is_new {
            newcomers < larger_half(self.slots / 2)
        } else {
            established < larger_half(self.slots)
        };
        if fits && kept.len() < self.slots {
            return Fate::Kept;
        }
        if is_new || behind > COUNTS_NAT {
            return Fate::Dropped;
        }
        let mut nearest: Option<(usize, f32)> = None;
        for (other, component) in others().filter(|(_, component)| component.age >= PROTECTED) {
            let distance = apart(&component.filter.agent(), &agent);
            if nearest.is_none_or(|(_, least)| distance < least) {
                nearest = Some((other, distance));
            }
        }
        nearest.map_or(Fate::Dropped, |(other, _)| Fate::Crowded(other))
    }

    /// Makes component `from` part of component `into`.
    fn merge(&mut self, into: usize, from: usize) {
        let Ok([into, from]) = self.components.get_disjoint_mut([into, from]) else { return };
        let heavier = larger(into.weight_nat, from.weight_nat);
        let (own, other) = (exp(into.weight_nat - heavier), exp(from.weight_nat - heavier));
        let share = other / (own + other);
        if share > LEAST_SHARE {
            into.filter.merge(&from.filter, share);
            into.outages.merge(&from.outages, share);
        }
        into.weight_nat = heavier + ln(own + other);
        into.age = into.age.max(from.age);
    }
}

/// Half of it, rounded up, at least 1.
fn larger_half(count: usize) -> usize {
    count.div_ceil(2).max(1)
}

#[cfg(test)]
mod tests {
    use super::super::BeliefSettings;
    use super::super::component::Component;
    use super::super::component::tests::component;
    use super::*;
    use crate::model::region::Region;

    fn belief<const COMPONENTS: usize>(components: &[Component<2, 1>]) -> TagBelief<2, 1, COMPONENTS> {
        let mut belief = TagBelief::new(
            components[0].filter.clone(),
            1.0,
            Region::reached(&[], 1.0),
            BeliefSettings::default(),
        );
        belief.components.clear();
        for component in components {
            assert!(belief.components.push(component.clone()).is_ok());
        }
        belief
    }

    fn newcomer(position_m: [f32; 2], weight_nat: f32) -> Component<2, 1> {
        Component { age: 0, ..component(position_m, 0.1, weight_nat) }
    }

    /// x and weight (nats) of every component, by x.
    fn places<const COMPONENTS: usize>(belief: &TagBelief<2, 1, COMPONENTS>) -> std::vec::Vec<(f32, f32)> {
        let place = |own: &Component<2, 1>| (own.filter.position_m()[0], own.weight_nat);
        let mut places: std::vec::Vec<_> = belief.components.iter().map(place).collect();
        places.sort_by(|a, b| a.0.total_cmp(&b.0));
        places
    }

    fn assert_places<const COMPONENTS: usize>(belief: &TagBelief<2, 1, COMPONENTS>, expected: &[(f32, f32)]) {
        let found = places(belief);
        assert_eq!(found.len(), expected.len(), "{found:?} {expected:?}");
        for ((x, nat), (exact_x, exact_nat)) in found.iter().zip(expected) {
            assert!((x - exact_x).abs() < 1e-4 && (nat - exact_nat).abs() < 1e-5, "{found:?} {expected:?}");
        }
    }

    /// All orders of so many things.
    fn orders(count: usize) -> std::vec::Vec<std::vec::Vec<usize>> {
        let Some(last) = count.checked_sub(1) else { return std::vec![std::vec![]] };
        let shorter = orders(last);
        let place = |order: &std::vec::Vec<usize>, at: usize| {
            let mut longer = order.clone();
            longer.insert(at, last);
            longer
        };
        (0..count)
            .flat_map(|at| shorter.iter().map(move |order| place(order, at)).collect::<std::vec::Vec<_>>())
            .collect()
    }

    #[test]
    fn what_is_one_is_merged_whatever_the_order_of_the_slots() {
        let parts = [
            component([0.0, 0.0], 0.1, ln(0.3)),
            component([0.05, 0.0], 0.1, ln(0.1)),
            component([2.0, 0.0], 0.1, ln(0.35)),
            component([2.02, 0.0], 0.1, ln(0.05)),
            component([4.0, 0.0], 0.1, ln(0.2)),
        ];
        let (first, second) = (0.005_f32 / 0.4, (0.7_f32 + 0.101) / 0.4);
        let orders = orders(parts.len());
        assert_eq!(orders.len(), 120);
        for order in orders {
            let shuffled: std::vec::Vec<_> = order.iter().map(|index| parts[*index].clone()).collect();
            let mut belief = belief::<12>(&shuffled);
            belief.reduce();
            assert_places(&belief, &[(first, ln(0.4)), (second, ln(0.4)), (4.0, ln(0.2))]);
            // Within 0.01, between 3/4 x 1/4 x 0.05^2.
            let merged = belief.components.iter().find(|own| own.filter.position_m()[0] < 1.0).unwrap();
            let variance_m2 = merged.filter.position_covariance_m2().m11;
            assert!((variance_m2 - (0.01 + 0.1875 * 0.0025)).abs() < 1e-7, "{variance_m2}");
        }
    }

    #[test]
    fn what_moves_otherwise_is_another_one() {
        let mut other = component([0.0, 0.0], 0.1, -1.0);
        let mut agent = other.filter.agent();
        agent.mean.z = 1.0;
        other.filter.place(&agent);
        let mut belief = belief::<8>(&[component([0.0, 0.0], 0.1, 0.0), other]);
        belief.reduce();
        assert_eq!(belief.components.len(), 2);
    }

    #[test]
    fn half_of_the_slots_are_kept_and_a_quarter_of_newcomers() {
        let mut parts: std::vec::Vec<_> =
            (0..5).map(|n| component([n as f32, 0.0], 0.1, -2.0 * n as f32)).collect();
        parts.extend((0..3).map(|n| newcomer([10.0 + n as f32, 0.0], -30.0 - n as f32)));
        // The fifth is 8 nats behind the best: too far to be joined. Newcomers stay however light.
        let kept = [(0.0, 0.0), (1.0, -2.0), (2.0, -4.0), (3.0, -6.0), (10.0, -30.0), (11.0, -31.0)];
        for reversed in [false, true] {
            let mut belief = belief::<8>(&parts);
            belief.reduce();
            assert_places(&belief, &kept);
            assert_eq!(belief.leader().position_m(), [0.0, 0.0]);
            if !reversed {
                parts.reverse();
            }
        }
    }

    #[test]
    fn what_finds_no_room_near_the_best_joins_the_nearest_established() {
        let parts = [
            component([0.0, 0.0], 0.1, 0.0),
            component([1.0, 0.0], 0.1, -0.5),
            component([5.0, 0.0], 0.1, -1.0),
            component([8.0, 0.0], 0.1, -1.5),
            newcomer([1.3, 0.0], -2.0),
            component([1.6, 0.0], 0.1, -3.0),
        ];
        let mut belief = belief::<8>(&parts);
        let before = belief.total_nat();
        belief.reduce();
        assert!((belief.total_nat() - before).abs() < 1e-6);
        let weights = [(-0.5_f32).exp(), (-3.0_f32).exp()];
        let sum = weights[0] + weights[1];
        let x = (weights[0] + 1.6 * weights[1]) / sum;
        assert_places(&belief, &[(0.0, 0.0), (x, ln(sum)), (1.3, -2.0), (5.0, -1.0), (8.0, -1.5)]);
        // The spread stays honest.
        let joined =
            belief.components.iter().find(|own| own.filter.position_m()[0] == places(&belief)[1].0).unwrap();
        let between = weights[0] * weights[1] / (sum * sum) * 0.36;
        assert!((joined.filter.position_covariance_m2().m11 - (0.01 + between)).abs() < 1e-6);
    }

    #[test]
    fn the_far_behind_is_dropped_unless_it_is_new() {
        let far = -DROPPED_NAT;
        let mut belief = belief::<8>(&[
            component([0.0, 0.0], 0.1, 0.0),
            component([1.0, 0.0], 0.1, far + 0.1),
            component([2.0, 0.0], 0.1, far - 0.1),
            newcomer([3.0, 0.0], far - 50.0),
        ]);
        belief.reduce();
        assert_places(&belief, &[(0.0, 0.0), (1.0, far + 0.1), (3.0, far - 50.0)]);
    }

    #[test]
    fn a_weight_that_is_no_number_is_dropped_alone() {
        for bad in 0..5 {
            for is_new in [false, true] {
                let mut parts: std::vec::Vec<_> =
                    (0..5).map(|n| component([n as f32, 0.0], 0.1, -f32::from(n as u8 % 3))).collect();
                let mut expected: std::vec::Vec<_> =
                    parts.iter().map(|own| (own.filter.position_m()[0], own.weight_nat)).collect();
                expected.remove(bad);
                parts[bad].weight_nat = f32::NAN;
                parts[bad].age = if is_new { 0 } else { u16::MAX };
                let mut belief = belief::<10>(&parts);
                belief.reduce();
                assert_places(&belief, &expected);
                let best = expected.iter().find(|(_, nat)| *nat == belief.best_nat()).unwrap();
                assert_eq!(belief.leader().position_m()[0], best.0, "{bad}");
                assert!(belief.total_nat().is_finite());
            }
        }
    }

    #[test]
    fn merging_keeps_the_sum_of_the_weights() {
        let mut seed = 5_u32;
        let mut draw = || {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (seed >> 8) as f32 / 16_777_216.0
        };
        let (mut merged, mut worst) = (0, 0.0_f32);
        for _ in 0..500 {
            // None so far behind that it is dropped.
            let mut part = || component([draw(), draw()], 0.05 + 0.3 * draw(), -COUNTS_NAT * draw());
            let parts: std::vec::Vec<_> = (0..12).map(|_| part()).collect();
            let mut belief = belief::<12>(&parts);
            let before = belief.total_nat();
            belief.reduce();
            worst = worst.max((belief.total_nat() - before).abs());
            merged += 12 - belief.components.len();
            assert!(belief.components.len() <= 6);
        }
        std::println!(
            "{merged} of 6000 components were merged; the sum of weights changed by {worst:.1e} nat at most"
        );
        assert!(merged > 3000 && worst < 3e-6, "{merged} {worst}");
    }

    #[test]
    fn of_equals_the_first_leads_and_stays() {
        let parts: std::vec::Vec<_> = (0..6).map(|n| component([n as f32, 0.0], 0.01, -1.0)).collect();
        let mut belief = belief::<6>(&parts);
        assert_eq!(belief.order().as_slice(), [0, 1, 2, 3, 4, 5]);
        belief.reduce();
        let kept: std::vec::Vec<_> = places(&belief).iter().map(|(x, _)| *x).collect();
        // Three are kept; the others join the nearest of them, the third.
        assert_eq!(kept.len(), 3);
        assert_eq!(kept[..2], [0.0, 1.0]);
        assert_eq!(belief.leader, 2);
        // Heavier by what joined it; before, it was the first.
        let mut two = belief_of_two();
        two.reduce();
        assert_eq!((two.leader, two.leader().position_m()), (0, [3.0, 0.0]));
    }

    fn belief_of_two() -> TagBelief<2, 1, 4> {
        belief(&[component([3.0, 0.0], 0.1, -1.0), component([0.0, 0.0], 0.1, -1.0)])
    }

    #[test]
    fn few_slots_are_enough_for_the_heaviest() {
        let both = [component([0.0, 0.0], 0.1, -1.0), component([3.0, 0.0], 0.1, 0.0)];
        let mut one = belief::<1>(&both[..1]);
        one.reduce();
        assert_places(&one, &[(0.0, -1.0)]);
        let mut two = belief::<2>(&both);
        two.reduce();
        // The lighter one is near enough in weight to join.
        assert_eq!(two.components.len(), 1);
        assert!((two.total_nat() - ln(1.0 + (-1.0_f32).exp())).abs() < 1e-6);
        let mut with_newcomer = belief::<2>(&[newcomer([0.0, 0.0], -1.0), both[1].clone()]);
        with_newcomer.reduce();
        assert_places(&with_newcomer, &[(0.0, -1.0), (3.0, 0.0)]);
        assert_eq!(with_newcomer.leader().position_m(), [3.0, 0.0]);
        let mut three = belief::<3>(&[newcomer([6.0, 0.0], -2.0), both[0].clone(), both[1].clone()]);
        three.reduce();
        assert_places(&three, &[(0.0, -1.0), (3.0, 0.0), (6.0, -2.0)]);
    }
}
