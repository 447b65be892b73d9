//! Belief: where the tag is, as a bounded mixture of joint Gaussians.
//!
//! A [`Component`] is a state filter (tag, biases and map) with a weight. All are predicted, compared with the scans and updated
//! by the same motion, expectation and evidence; one that explains the scans better grows. Components are added where one
//! Gaussian is not enough:
//!
//! - **Turn.** Somebody who turns on his heel changes his velocity by more than any acceleration that fits the rest of his way.
//!   Every component has a child whose velocity was drawn anew, with the probability of a turn since anything was last heard.
//! - **Split.** A range is a circle: a component wider than [`BeliefSettings::split_above_m`] becomes three narrower ones along
//!   its longest axis, with the same mean and covariance.
//! - **Newcomers** ([`proposal`]): places that the earliest ranges propose, with the map as it was when the tag was last known.
//!
//! What has become one is merged, the lightest give way ([`reduction`]). The heaviest component leads: its map is the map. Nobody
//! walks through walls, and with an outline told nobody is outside: both are part of the weight ([`component::Hindrance`]).

pub mod component;
pub mod proposal;
pub mod reduction;
pub mod summary;

use self::component::Component;
use self::proposal::Proposal;
use self::reduction::PROTECTED;
use self::summary::Summary;
use crate::model::clock::probability;
use crate::model::motion::Agent;
use crate::perceptor::state_filter::StateFilter;
use crate::real::{exp, larger, ln, sqrt};
use heapless::Vec;
use nalgebra::{Matrix2, Matrix4, Vector2, Vector4};

/// What is assumed of where the tag may be.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct BeliefSettings {
    /// Turns of the tag per second (0 to 10): its velocity is drawn anew. More follows turns sooner and takes false paths for turns.
    pub turns_per_s: f32,
    /// How often the tag turns out to be anywhere else, per second (1e-9 to 1): the weight of newcomers. More finds a lost tag
    /// sooner, and takes mirror images for it.
    pub elsewhere_per_s: f32,
    /// Standard deviation of a position along its longest axis above which a component is split, metres (0.01 to 100). Less: more
    /// components for the same accuracy. More: updates far from a range's line.
    pub split_above_m: f32,
    /// Evidence by which a component may be behind the best before it is dropped, nats (1 to 100). Less: fewer components. More:
    /// unlikely places are kept for longer.
    pub dropped_nat: f32,
    /// Probability of the leading place from which on memories and map are judged from it (0.5 to 0.9999). Less: a map learnt at
    /// wrong places. More: one that is not learnt.
    pub sure_probability: f32,
}

impl Default for BeliefSettings {
    fn default() -> Self {
        Self {
            turns_per_s: 0.2,
            elsewhere_per_s: 1e-4,
            split_above_m: 0.15,
            dropped_nat: 25.0,
            sure_probability: 0.9,
        }
    }
}

/// Mathematics: more probable than not: below this probability of the leading place the tag is searched for.
pub const KNOWN: f32 = 0.5;
/// Tuned: against a map judged from a place known too roughly: largest sum of the position's variances, square metres.
pub const SURE_WITHIN_M2: f32 = 0.25;
/// Tuned: against proposing where the tag is known: doubt below this probability of the leading place,
pub const DOUBT_BELOW: f32 = 0.97;
/// Tuned: or where less than this share of the strong paths is explained.
pub const EXPLAINED_BELOW: f32 = 0.8;
/// Tuned: smoothing of that share, by one cycle.
pub const EXPLAINED_GAIN: f32 = 0.1;
/// Tuned: probability of the leading place from which on the state is kept for newcomers,
pub const TRUSTED_ABOVE: f32 = 0.99;
/// Tuned: where the sum of the position's variances is below this, square metres.
pub const TRUSTED_WITHIN_M2: f32 = 0.04;
/// Tuned: evidence by which a component may be behind the best to count as established, nats.
pub const ESTABLISHED_NAT: f32 = 5.0;
/// Tuned: against work on what hardly counts: children of components that are further behind the best are not made, nats.
pub const CHILDREN_NAT: f32 = 12.0;
/// The same of splitting.
const SPLIT_NAT: f32 = 6.0;

/// The mixture: up to `COMPONENTS` joint states.
#[derive(Clone, Debug)]
pub struct TagBelief<const ANCHORS: usize, const SURFACES: usize, const COMPONENTS: usize> {
    settings: BeliefSettings,
    /// Variance per axis of a velocity that nothing is known of.
    speed_m2_s2: f32,
    components: Vec<Component<ANCHORS, SURFACES>, COMPONENTS>,
    /// Index of the heaviest.
    leader: usize,
    /// The state while the tag was last known: the map of newcomers.
    trusted: StateFilter<ANCHORS, SURFACES>,
    summary: Summary,
    /// Smoothed share of the strong paths that the leader explains.
    explained: f32,
    /// Cycles heard, counted on.
    heard: u32,
}

impl<const ANCHORS: usize, const SURFACES: usize, const COMPONENTS: usize>
    TagBelief<ANCHORS, SURFACES, COMPONENTS>
{
    /// One component. `speed_m_s` is the standard deviation per axis of a velocity that nothing is known of.
    #[inline(always)] // built where it stays
    pub fn new(filter: StateFilter<ANCHORS, SURFACES>, speed_m_s: f32, settings: BeliefSettings) -> Self {
        const { assert!(COMPONENTS > 0, "a belief has a component") };
        let summary = Summary::of_one(&filter.agent());
        let mut components = Vec::new();
        // Capacity is above 0: the push succeeds.
        let _ = components.push(Component::established(filter.clone()));
        Self {
            settings,
            speed_m2_s2: speed_m_s * speed_m_s,
            components,
            leader: 0,
            trusted: filter,
            summary,
            explained: 1.0,
            heard: 0,
        }
    }

    /// The components.
    pub fn components(&self) -> &[Component<ANCHORS, SURFACES>] {
        &self.components
    }

    /// What is believed of where the tag is.
    pub fn summary(&self) -> &Summary {
        &self.summary
    }

    /// The state of the heaviest component.
    pub fn leader(&self) -> &StateFilter<ANCHORS, SURFACES> {
        self.components.get(self.leader).map_or(&self.trusted, |leader| &leader.filter)
    }

    /// The map of newcomers.
    pub fn trusted(&self) -> &StateFilter<ANCHORS, SURFACES> {
        &self.trusted
    }

    /// What is told before the first cycle is told to all states.
    pub fn tell(&mut self, mut tell: impl FnMut(&mut StateFilter<ANCHORS, SURFACES>)) {
        tell(&mut self.trusted);
        for component in &mut self.components {
            component.filter = self.trusted.clone();
        }
    }

    /// Whether it is not known where the tag is.
    pub fn is_searching(&self) -> bool {
        self.summary.probability < KNOWN
    }

    /// Whether the place is known well enough to judge memories and map from it.
    pub fn is_sure(&self) -> bool {
        self.summary.probability > self.settings.sure_probability
            && self.summary.variance_m2() < SURE_WITHIN_M2
    }

    /// Whether newcomers are needed.
    pub fn is_doubtful(&self) -> bool {
        self.summary.probability < DOUBT_BELOW
            || self.summary.variance_m2() > SURE_WITHIN_M2
            || self.explained < EXPLAINED_BELOW
    }

    /// Moves all components `elapsed_s` seconds ahead. Where anything is heard again, `unheard_s` seconds after the last time,
    /// the tag may have turned since.
    #[inline(never)]
    pub fn predict(&mut self, elapsed_s: f32, unheard_s: Option<f32>) {
        for component in &mut self.components {
            component.filter.predict(elapsed_s);
        }
        let Some(unheard_s) = unheard_s else { return };
        self.heard = self.heard.wrapping_add(1);
        for component in &mut self.components {
            component.age = component.age.saturating_add(1);
        }
        let turned = probability(self.settings.turns_per_s, unheard_s);
        if turned > 0.0 {
            let speed_m2_s2 = self.speed_m2_s2;
            self.branch(CHILDREN_NAT, |component| {
                let mut child = component.clone();
                child.filter.turn(speed_m2_s2, unheard_s);
                child.weight_nat += ln(turned);
                component.weight_nat += ln(1.0 - turned);
                [Some(child), None]
            });
        }
        let widest_m2 = self.settings.split_above_m * self.settings.split_above_m;
        self.branch(SPLIT_NAT, |component| component.split(widest_m2));
    }

    /// Adds children of the components within so many nats of the best, the heaviest first, as long as there is room for both and
    /// for newcomers.
    fn branch(
        &mut self,
        within_nat: f32,
        mut children: impl FnMut(&mut Component<ANCHORS, SURFACES>) -> [Option<Component<ANCHORS, SURFACES>>; 2],
    ) {
        let least = self.best_nat() - within_nat;
        let newcomers = self.components.iter().filter(|component| component.age < PROTECTED).count();
        let room = COMPONENTS.saturating_sub((COMPONENTS / 4).saturating_sub(newcomers));
        for index in self.order() {
            if self.components.len() + 2 > room {
                return;
            }
            let Some(component) = self.components.get_mut(index).filter(|own| own.weight_nat > least) else {
                return;
            };
            for child in children(component).into_iter().flatten() {
                // There is room: the push succeeds.
                let _ = self.components.push(child);
            }
        }
    }

    /// Whether places are to be proposed in this cycle: in doubt, and now and then.
    pub fn proposes(&self) -> bool {
        self.is_doubtful() || self.heard.is_multiple_of(proposal::EVERY)
    }

    /// Where the arcs of a cycle begin, turns.
    pub fn phase(&self) -> f32 {
        proposal::phase(self.heard)
    }

    /// Takes a place in, with the trusted map; `reach_m` is how far away a tag may be, `unheard_s` the time in which it may have
    /// come there, seconds.
    pub fn enter(&mut self, proposal: &Proposal, reach_m: f32, unheard_s: f32) {
        let Proposal { position_m: [x, y], radial: [ux, uy], variance_m2: [along, across], .. } = *proposal;
        let xx = along * (ux * ux) + across * (uy * uy);
        let yy = along * (uy * uy) + across * (ux * ux);
        let yx = (along - across) * (ux * uy);
        let v = self.speed_m2_s2;
        let mut filter = self.trusted.clone();
        filter.place(&Agent {
            mean: Vector4::new(x, y, 0.0, 0.0),
            covariance: Matrix4::new(xx, yx, 0.0, 0.0, yx, yy, 0.0, 0.0, 0.0, 0.0, v, 0.0, 0.0, 0.0, 0.0, v),
        });
        // The share of the plane within reach that it stands for.
        let share = core::f32::consts::TAU * sqrt(along * across) / (reach_m * reach_m);
        let elsewhere = probability(self.settings.elsewhere_per_s, unheard_s);
        let weight_nat = self.total_nat() + ln(larger(elsewhere * share, f32::MIN_POSITIVE));
        // Where there is no room, it is left out.
        let _ = self.components.push(Component::newcomer(filter, weight_nat));
    }

    /// The components, to be compared and updated.
    pub fn components_mut(&mut self) -> impl Iterator<Item = &mut Component<ANCHORS, SURFACES>> {
        self.components.iter_mut()
    }

    /// Enters what share of the strong paths of a cycle was explained, if there were any.
    pub fn explain(&mut self, strong: f32, explained: f32) {
        if strong > 0.0 {
            self.explained += EXPLAINED_GAIN * (explained / strong - self.explained);
        }
    }

    /// Ends a cycle: hindrances enter the weights, these are normalised, and what is believed is summed up. `through` gives the
    /// probability that a way from one place to another (metres), known within a deviation (metres), crosses no wall, `inside` that
    /// a place may be one of a tag.
    #[inline(never)]
    pub fn conclude(
        &mut self,
        through: impl Fn([f32; 2], [f32; 2], f32) -> f32,
        inside: impl Fn([f32; 2], f32) -> f32,
        is_heard: bool,
    ) {
        for component in &mut self.components {
            component.hinder(&through, &inside);
        }
        self.reduce();
        let total = self.total_nat();
        let established = self.best_nat() - ESTABLISHED_NAT;
        for component in &mut self.components {
            if component.weight_nat > established {
                component.age = u16::MAX;
            }
            component.weight_nat -= total;
        }
        self.summary = Summary::of(&self.components);
        if is_heard
            && self.summary.probability > TRUSTED_ABOVE
            && self.summary.variance_m2() < TRUSTED_WITHIN_M2
        {
            self.trusted = self.leader().clone();
        }
    }

    /// The map of the leader is changed, and the others follow: what surfaces are new or other in it, they take over as independent
    /// of everything else.
    pub fn revise<R>(
        &mut self,
        revise: impl FnOnce(&mut StateFilter<ANCHORS, SURFACES>) -> Option<R>,
    ) -> Option<R> {
        let leader = &mut self.components.get_mut(self.leader)?.filter;
        let result = revise(leader)?;
        let leader = leader.clone();
        for (index, component) in self.components.iter_mut().enumerate() {
            if index != self.leader {
                component.filter.follow_map(&leader);
            }
        }
        self.trusted.follow_map(&leader);
        Some(result)
    }

    /// Enters a private surface into all states that was found relative to the leader's tag: its deviation is `gain` times that of
    /// the tag's position plus an error of covariance `own`. Where the tag is elsewhere, so is the surface.
    pub fn discover(&mut self, slot: usize, position: Vector2<f32>, gain: &Matrix2<f32>, own: &Matrix2<f32>) {
        let [x, y] = self.leader().position_m();
        let enter = |filter: &mut StateFilter<ANCHORS, SURFACES>| {
            let [own_x, own_y] = filter.position_m();
            let (dx, dy) = (own_x - x, own_y - y);
            let moved = Vector2::new(
                position.x + (gain.m11 * dx + gain.m12 * dy),
                position.y + (gain.m21 * dx + gain.m22 * dy),
            );
            filter.remove(slot);
            filter.insert_relative(slot, moved, gain, own);
        };
        self.components.iter_mut().map(|component| &mut component.filter).for_each(enter);
        enter(&mut self.trusted);
    }

    /// Takes a surface out of all states.
    pub fn remove(&mut self, slot: usize) {
        for component in &mut self.components {
            component.filter.remove(slot);
        }
        self.trusted.remove(slot);
    }

    /// The largest weight, nats. One that is NaN is none.
    fn best_nat(&self) -> f32 {
        self.components.iter().fold(f32::NEG_INFINITY, |best, component| larger(component.weight_nat, best))
    }

    /// ln of the sum of all weights.
    fn total_nat(&self) -> f32 {
        let best = self.best_nat();
        best + ln(self.components.iter().fold(0.0, |sum, component| sum + exp(component.weight_nat - best)))
    }

    /// Every number of the state, in a fixed order, for traces.
    pub fn visit(&self, mut f: impl FnMut(f32)) {
        f(self.components.len() as f32);
        f(self.leader as f32);
        for component in &self.components {
            component.visit(&mut f);
        }
        self.trusted.visit(&mut f);
        self.summary.visit(&mut f);
        f(self.explained);
        f(self.heard as f32);
    }
}
