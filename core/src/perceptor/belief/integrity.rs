//! What becomes of a belief in which a bit has flipped.
//!
//! Every component has a seal of its own: one that is broken is dropped, and the others go on. While the tag is known, the trusted state
//! is a copy of the leader's, so that nothing is lost with that. With the last component goes where the tag is: it is searched for then,
//! on the map that is left.

use super::component::Component;
use super::outage::Outages;
use super::{LEAST_NAT, PLACE_M, SETTLED, TagBelief};
use crate::model::motion::Agent;
use crate::perceptor::state_filter::StateFilter;
use crate::real::{is_probability, ln};
use crate::snapshot::{Sealed, Written, seal, seal_with};
use nalgebra::{Matrix4, Vector4};

/// Seals of a belief, by its pieces.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct BeliefSeals<const COMPONENTS: usize> {
    common: Option<Sealed>,
    trusted: Option<Sealed>,
    /// Of those that were sealed.
    components: [Option<Sealed>; COMPONENTS],
}

impl<const COMPONENTS: usize> BeliefSeals<COMPONENTS> {
    /// Which components were sealed.
    pub(crate) fn sealed(&self) -> [bool; COMPONENTS] {
        self.components.map(|sealed| sealed.is_some())
    }

    /// Of a belief that was not sealed yet.
    pub(crate) const NONE: Self = Self { common: None, trusted: None, components: [None; COMPONENTS] };
}

/// The pieces of a belief that are broken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct BrokenBelief<const COMPONENTS: usize> {
    common: bool,
    trusted: bool,
    components: [bool; COMPONENTS],
}

impl<const COMPONENTS: usize> BrokenBelief<COMPONENTS> {
    const NONE: Self = Self { common: false, trusted: false, components: [false; COMPONENTS] };

    /// Those whose seals are not the `last` ones.
    #[inline(never)]
    pub(crate) fn flipped(seals: &BeliefSeals<COMPONENTS>, last: &BeliefSeals<COMPONENTS>) -> Self {
        let mut broken = Self::NONE;
        broken.common = seals.common != last.common;
        broken.trusted = seals.trusted != last.trusted;
        let places = seals.components.iter().zip(&last.components);
        for (is_broken, (own, last)) in broken.components.iter_mut().zip(places) {
            // Where it is not known how many there are, those that were not sealed may be none.
            *is_broken = if last.is_some() { own != last } else { broken.common };
        }
        broken
    }

    /// Whether any is.
    pub(crate) fn is_any(&self) -> bool {
        self.common || self.trusted || self.components.contains(&true)
    }
}

impl<const ANCHORS: usize, const SURFACES: usize, const COMPONENTS: usize>
    TagBelief<ANCHORS, SURFACES, COMPONENTS>
{
    /// Seals it: the leader, and of the other components those that are `due`.
    #[inline(never)]
    pub(crate) fn seals(&self, due: &[bool; COMPONENTS]) -> BeliefSeals<COMPONENTS> {
        let common = seal_with(|to| {
            let is_whole = crate::snapshot::Sink::list(to, self.components.len(), COMPONENTS);
            (is_whole, self.slots, self.leader, self.heard).write(to);
            self.summary.write(to);
            self.outages.write(to);
            [self.anywhere_nat, self.explained].write(to);
            self.is_doubtful.write(to);
        });
        let mut components = [None; COMPONENTS];
        let places = components.iter_mut().zip(due);
        for (index, ((sealed, due), component)) in places.zip(&self.components).enumerate() {
            if index == self.leader || *due {
                *sealed = Some(seal(component));
            }
        }
        BeliefSeals { common: Some(common), trusted: Some(seal(&self.trusted)), components }
    }

    /// What is broken: where numbers are not finite, or not what they may be.
    #[inline(never)]
    pub(crate) fn broken(
        &self,
        seals: &BeliefSeals<COMPONENTS>,
        is_sound: impl Fn(&StateFilter<ANCHORS, SURFACES>) -> bool,
    ) -> BrokenBelief<COMPONENTS> {
        let is_weight = |nat: f32| nat <= 1e-3;
        let mut broken = BrokenBelief::NONE;
        broken.common = !seals.common.is_some_and(Sealed::is_whole)
            || self.leader >= self.components.len()
            || !is_probability(self.summary.probability)
            || !is_probability(self.explained)
            || !is_weight(self.anywhere_nat)
            || !self.outages.is_sound();
        broken.trusted = !seals.trusted.is_some_and(Sealed::is_whole) || !is_sound(&self.trusted);
        for (broken, (own, component)) in
            broken.components.iter_mut().zip(seals.components.iter().zip(&self.components))
        {
            let Some(own) = own else { continue };
            *broken = !own.is_whole()
                || !is_weight(component.weight_nat)
                || !component.outages.is_sound()
                || !is_sound(&component.filter);
        }
        broken
    }

    /// Drops what is broken. Where no map is left, it is that which was `told`.
    #[inline(never)]
    pub(crate) fn mend(
        &mut self,
        broken: &BrokenBelief<COMPONENTS>,
        told: impl FnOnce() -> StateFilter<ANCHORS, SURFACES>,
    ) {
        let settled = !broken.common
            && !broken.trusted
            && self.summary.probability > SETTLED
            && self.summary.variance_m2() < PLACE_M * PLACE_M;
        let is_leader_broken = broken.components.get(self.leader) == Some(&true);
        if self.components.len() > COMPONENTS {
            self.components.clear();
        }
        let mut flags = broken.components.iter();
        self.components.retain(|_| flags.next() == Some(&false));
        if broken.common {
            self.outages = Outages::usual(&self.settings);
            (self.anywhere_nat, self.explained, self.heard) = (LEAST_NAT, 1.0, 0);
        }
        if broken.trusted {
            match self.components.iter().max_by(|a, b| a.weight_nat.total_cmp(&b.weight_nat)) {
                Some(heaviest) => self.trusted = heaviest.filter.clone(),
                None => self.trusted = told(),
            }
        }
        if settled && is_leader_broken && self.components.len() < COMPONENTS {
            let _ = self.components.push(Component::established(self.trusted.clone(), self.outages));
        } else if self.components.is_empty() {
            // Anywhere in the region: half of it as a component that is as wide, so that the map has a tag.
            let ([x, y], [xx, yx, yy]) = (self.region.centre_m, self.region.covariance_m2);
            let v = self.speed_m2_s2;
            let mut component = Component::established(self.trusted.clone(), self.outages);
            component.filter.place(&Agent {
                mean: Vector4::new(x, y, 0.0, 0.0),
                covariance: Matrix4::new(
                    xx, yx, 0.0, 0.0, yx, yy, 0.0, 0.0, 0.0, 0.0, v, 0.0, 0.0, 0.0, 0.0, v,
                ),
            });
            component.hindrance.from_m = [x, y];
            (component.weight_nat, self.anywhere_nat) = (ln(0.5), ln(0.5));
            let _ = self.components.push(component);
        }
        self.leader = self.order().first().copied().unwrap_or(0);
        self.normalise();
        self.sum_up(0.0);
        self.is_doubtful = self.doubts();
    }
}
