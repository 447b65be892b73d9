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

pub mod anywhere;
pub mod component;
pub(crate) mod integrity;
pub mod outage;
pub mod proposal;
pub mod reduction;
pub mod summary;

use self::component::Component;
use self::outage::Outages;
use self::proposal::Proposal;
use self::reduction::PROTECTED;
use self::summary::{Summary, Turned, moments};
use crate::model::clock::probability;
use crate::model::motion::{Agent, ProcessNoise};
use crate::model::region::Region;
use crate::perceptor::association::outage::weigh;
use crate::perceptor::state_filter::StateFilter;
use crate::real::{exp, larger, ln, smaller, sqrt};
use crate::snapshot::{stored, written};
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
    /// Outages of an anchor per second (0 to 10). More keeps the place where an anchor is not heard, and believes anchors less.
    pub outages_per_s: f32,
    /// How soon an outage ends, per second (1e-3 to 100). More believes an anchor sooner.
    pub returns_per_s: f32,
    /// Whether nobody walks through the walls of the plan.
    pub walls_bar_ways: bool,
    /// Whether the walls of the plan hide paths, and end where it tells.
    pub walls_hide_paths: bool,
    /// Whether the rest of a frame is read where sources are expected whose paths were not found.
    pub reads_below_threshold: bool,
}

impl BeliefSettings {
    /// Those of a tracker that is not started.
    pub(crate) const NONE: Self = Self {
        turns_per_s: 0.0,
        elsewhere_per_s: 0.0,
        split_above_m: 0.0,
        outages_per_s: 0.0,
        returns_per_s: 0.0,
        walls_bar_ways: false,
        walls_hide_paths: false,
        reads_below_threshold: false,
    };
}

impl Default for BeliefSettings {
    fn default() -> Self {
        Self {
            turns_per_s: 0.2,
            elsewhere_per_s: 1e-4,
            split_above_m: 0.2,
            outages_per_s: 0.2,
            returns_per_s: 5.0,
            walls_bar_ways: true,
            walls_hide_paths: true,
            reads_below_threshold: true,
        }
    }
}

/// Mathematics: more probable than not: below this probability of the leading place the tag is searched for.
pub const KNOWN: f32 = 0.5;
/// Mathematics: more probable than not: probability of an outage above which an anchor is out.
pub const OUT: f32 = 0.5;
/// Guard: against weights that are no numbers: least weight of anywhere, nats.
pub const LEAST_NAT: f32 = -80.0;
/// Tuned: probability of the leading place from which on memories and map are judged from it. Less: a map learnt at wrong places.
/// More: one that is not learnt.
pub const SURE: f32 = 0.9;
/// Tuned: places nearer to each other than this are one, metres.
pub const PLACE_M: f32 = 0.3;
/// Tuned: probability of the leading place from which on the tag is settled there; below, newcomers are needed.
pub const SETTLED: f32 = 0.98;
/// Tuned: newcomers are needed as well where less than this share of the strong paths is explained.
pub const EXPLAINED_BELOW: f32 = 0.8;
/// Tuned: smoothing of that share, by one cycle.
pub const EXPLAINED_GAIN: f32 = 0.1;
/// Tuned: evidence by which a component may be behind the best and still count, nats: it is established, it is split where it is
/// wide, and where there is no room for it it joins another one, so that the spread stays honest.
pub const COUNTS_NAT: f32 = 6.0;
/// Guard: against work on what does not count any more: components that are further behind the best are dropped, nats.
pub const DROPPED_NAT: f32 = 25.0;
/// Guard: against work on what hardly counts: children of components that are further behind the best are not made, nats.
pub const CHILDREN_NAT: f32 = 12.0;

/// The mixture: up to `COMPONENTS` joint states.
#[derive(Clone, Debug)]
pub struct TagBelief<const ANCHORS: usize, const SURFACES: usize, const COMPONENTS: usize> {
    settings: BeliefSettings,
    /// Variance per axis of a velocity that nothing is known of.
    speed_m2_s2: f32,
    components: Vec<Component<ANCHORS, SURFACES>, COMPONENTS>,
    /// How many of them a cycle has work for.
    slots: usize,
    /// How many of those that count found no room in this cycle.
    crowded_out: u32,
    /// Index of the heaviest.
    leader: usize,
    /// The state while the tag was last known: the map of newcomers.
    trusted: StateFilter<ANCHORS, SURFACES>,
    summary: Summary,
    /// Where a tag is that is at none of the places held.
    region: Region,
    /// ln of the weight of that.
    anywhere_nat: f32,
    /// What is heard of the anchors by a tag there.
    outages: Outages<ANCHORS>,
    /// Smoothed share of the strong paths that the leader explains.
    explained: f32,
    /// Whether it was doubtful where the tag is when it was last heard.
    is_doubtful: bool,
    /// Cycles heard, counted on.
    heard: u32,
}

impl<const ANCHORS: usize, const SURFACES: usize, const COMPONENTS: usize>
    TagBelief<ANCHORS, SURFACES, COMPONENTS>
{
    /// As [`Self::start`], of this state.
    #[cfg(test)]
    pub(crate) fn new(
        filter: StateFilter<ANCHORS, SURFACES>,
        speed_m_s: f32,
        region: Region,
        settings: BeliefSettings,
    ) -> Self {
        let mut own = Self::empty();
        own.start(speed_m_s, region, settings, |trusted| *trusted = filter);
        own
    }

    /// No component: to be started.
    pub const fn empty() -> Self {
        Self {
            settings: BeliefSettings::NONE,
            speed_m2_s2: 0.0,
            components: Vec::new(),
            slots: 0,
            crowded_out: 0,
            leader: 0,
            trusted: StateFilter::empty(),
            summary: Summary::NONE,
            region: Region::NONE,
            anywhere_nat: 0.0,
            outages: Outages::NONE,
            explained: 0.0,
            is_doubtful: false,
            heard: 0,
        }
    }

    /// One component, where it stays, of the state that `fill` makes of an empty one. `speed_m_s` is the standard deviation per axis of
    /// a velocity that nothing is known of.
    #[inline(never)]
    pub fn start(
        &mut self,
        speed_m_s: f32,
        region: Region,
        settings: BeliefSettings,
        fill: impl FnOnce(&mut StateFilter<ANCHORS, SURFACES>),
    ) {
        const { assert!(COMPONENTS > 0, "COMPONENTS is 0: a belief has one component at least") };
        self.clear();
        fill(&mut self.trusted);
        self.settings = settings;
        self.speed_m2_s2 = speed_m_s * speed_m_s;
        self.outages = Outages::usual(&settings);
        // Capacity is above 0: the push succeeds.
        let _ = self.components.push(Component::established(self.trusted.clone(), self.outages));
        self.slots = COMPONENTS;
        self.summary = Summary::of_one(&self.trusted.agent());
        self.region = region;
        self.anywhere_nat = LEAST_NAT;
        self.explained = 1.0;
        self.is_doubtful = self.summary.probability < SETTLED;
    }

    /// No component again.
    pub fn clear(&mut self) {
        self.components.clear();
        self.trusted = StateFilter::empty();
        self.settings = BeliefSettings::NONE;
        self.summary = Summary::NONE;
        self.region = Region::NONE;
        self.outages = Outages::NONE;
        (self.slots, self.leader, self.crowded_out, self.heard) = (0, 0, 0, 0);
        (self.speed_m2_s2, self.anywhere_nat, self.explained) = (0.0, 0.0, 0.0);
        self.is_doubtful = false;
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
            component.filter.clone_from(&self.trusted);
        }
    }

    /// Enters how well an anchor's scan is explained by a tag that is anywhere, nats, `elapsed_s` seconds after the last.
    pub fn hear_anywhere(&mut self, anchor: usize, elapsed_s: f32, evidence_nat: f32) {
        let outage = self.outages.predict(anchor, elapsed_s, &self.settings);
        let (evidence_nat, outage) = weigh(outage, evidence_nat);
        self.anywhere_nat += evidence_nat;
        self.outages.set(anchor, outage);
    }

    /// Whether an anchor is more probably out than heard.
    pub fn is_out(&self, anchor: usize) -> bool {
        self.components.get(self.leader).is_some_and(|leader| leader.outages.of(anchor) > OUT)
    }

    /// Whether an anchor says nothing of where the tag is: it is out, or nothing does.
    pub fn is_lost(&self, anchor: usize) -> bool {
        self.is_searching() || self.is_out(anchor)
    }

    /// What is assumed.
    pub fn settings(&self) -> &BeliefSettings {
        &self.settings
    }

    /// Whether it is not known where the tag is.
    pub fn is_searching(&self) -> bool {
        self.summary.probability < KNOWN
    }

    /// Whether the place is known well enough to judge memories and map from it.
    pub fn is_sure(&self) -> bool {
        self.summary.probability > SURE
    }

    /// Whether newcomers are needed, by what was heard last: prediction alone makes a place wider, not doubtful.
    pub fn is_doubtful(&self) -> bool {
        self.is_doubtful
    }

    fn doubts(&self) -> bool {
        self.summary.probability < SETTLED || self.explained < EXPLAINED_BELOW
    }

    /// How many established components that counted found no room in this cycle: each was joined with the nearest one.
    pub fn crowded_out(&self) -> u32 {
        self.crowded_out
    }

    /// Begins a cycle in which so many scans are heard, and that has work for so many components, two at least.
    pub fn begin(&mut self, scans: usize, slots: usize) {
        self.crowded_out = 0;
        self.slots = slots.max(2).min(COMPONENTS);
        if scans > 0 && self.components.len() > self.slots {
            self.reduce();
            self.normalise();
        }
    }

    /// Moves all components `elapsed_s` seconds ahead. Where anything is heard, `unheard_s` seconds after the last time, the tag may
    /// have turned since.
    #[inline(never)]
    pub fn predict(&mut self, elapsed_s: f32, unheard_s: Option<f32>) {
        for component in &mut self.components {
            component.filter.predict(elapsed_s);
        }
        let Some(unheard_s) = unheard_s else { return };
        self.heard = self.heard.wrapping_add(1);
        // A share of everything turns out to be anywhere else.
        let elsewhere = probability(self.settings.elsewhere_per_s, unheard_s);
        let left_nat = ln(larger(1.0 - elsewhere, f32::MIN_POSITIVE));
        self.anywhere_nat =
            sum_nat(self.anywhere_nat, self.total_nat() + ln(larger(elsewhere, f32::MIN_POSITIVE)));
        for component in &mut self.components {
            component.age = component.age.saturating_add(1);
            component.weight_nat += left_nat;
        }
        // Splits come first: turned children would take their room, and a component so wide that the circle of a range bends away
        // from it loses weight to narrower ones in every cycle, wherever the tag is.
        let widest_m2 = self.settings.split_above_m * self.settings.split_above_m;
        self.branch(
            COUNTS_NAT,
            |component| component.axis_above(widest_m2),
            |component, copies, axis| component.split(axis, copies),
        );
        let turned = probability(self.settings.turns_per_s, unheard_s);
        if turned > 0.0 {
            let speed_m2_s2 = self.speed_m2_s2;
            self.branch(
                CHILDREN_NAT,
                |_| Some(()),
                |component, [child], ()| {
                    child.filter.turn(speed_m2_s2, unheard_s);
                    child.weight_nat += ln(turned);
                    component.weight_nat += ln(larger(1.0 - turned, f32::MIN_POSITIVE));
                },
            );
        }
    }

    /// Adds children of the components within so many nats of the best, the heaviest first, as long as there is room for two and
    /// for newcomers: of those that are `due`, copies, of which `divide` makes what they are. They are copied into their slots: a
    /// component takes kilobytes.
    fn branch<const CHILDREN: usize, T>(
        &mut self,
        within_nat: f32,
        due: impl Fn(&Component<ANCHORS, SURFACES>) -> Option<T>,
        divide: impl Fn(&mut Component<ANCHORS, SURFACES>, &mut [Component<ANCHORS, SURFACES>; CHILDREN], T),
    ) {
        let least = self.best_nat() - within_nat;
        let newcomers = self.components.iter().filter(|component| component.age < PROTECTED).count();
        let room = self.slots.saturating_sub((self.slots / 4).saturating_sub(newcomers));
        for &index in &self.order() {
            let first = self.components.len();
            if first + 2 > room {
                return;
            }
            let Some(parent) = self.components.get(index).filter(|own| own.weight_nat > least) else {
                return;
            };
            let Some(how) = due(parent) else { continue };
            for _ in 0..CHILDREN {
                self.copy(index);
            }
            let Some((parents, children)) = self.components.split_at_mut_checked(first) else { return };
            let Some(parent) = parents.get_mut(index) else { return };
            if let Some(children) = children.first_chunk_mut() {
                divide(parent, children, how);
            }
        }
    }

    /// Adds a copy of a component, where there is room.
    #[inline(never)]
    fn copy(&mut self, index: usize) {
        if let Some(component) = self.components.get(index) {
            let _ = self.components.push(component.clone());
        }
    }

    /// Whether places are to be proposed in this cycle: in doubt, and now and then.
    pub fn proposes(&self) -> bool {
        self.proposes_in(self.heard)
    }

    /// Whether they will be in the next cycle in which anything is heard.
    pub fn will_propose(&self) -> bool {
        self.proposes_in(self.heard.wrapping_add(1))
    }

    fn proposes_in(&self, heard: u32) -> bool {
        self.is_doubtful || heard.is_multiple_of(proposal::EVERY)
    }

    /// Where the arcs of a cycle begin, as a share of an arc.
    pub fn turn(&self) -> [f32; 2] {
        proposal::turn(self.heard)
    }

    /// Takes a place in, with the trusted map: what was anywhere is there in part.
    pub fn enter(&mut self, proposal: &Proposal) {
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
        // The share of the region that it stands for.
        let share = core::f32::consts::TAU * sqrt(along * across) / self.region.area_m2;
        let weight_nat = self.anywhere_nat + ln(smaller(share, 1.0));
        // Where there is no room, it is left out.
        if self.components.len() < self.slots {
            let _ = self.components.push(Component::newcomer(filter, weight_nat, self.outages));
        }
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

    /// Ends a cycle in which something was heard: hindrances enter the weights, these are normalised, and what is believed is
    /// summed up. `through` gives the probability that a way from one place to another (metres), known within a deviation (metres),
    /// crosses no wall, `inside` that a place may be one of a tag.
    #[inline(never)]
    pub fn conclude(
        &mut self,
        through: impl Fn([f32; 2], [f32; 2], f32) -> f32,
        inside: impl Fn([f32; 2], f32) -> f32,
    ) {
        for component in &mut self.components {
            component.hinder(&through, &inside);
        }
        self.reduce();
        self.normalise();
        let established = self.best_nat() - COUNTS_NAT;
        for component in &mut self.components {
            if component.weight_nat > established {
                component.age = u16::MAX;
            }
        }
        self.sum_up(0.0);
        self.is_doubtful = self.doubts();
        if self.summary.probability > SETTLED && self.summary.variance_m2() < PLACE_M * PLACE_M {
            self.trusted = self.leader().clone();
        }
    }

    /// Makes all weights sum up to 1.
    fn normalise(&mut self) {
        let total = sum_nat(self.total_nat(), self.anywhere_nat);
        self.anywhere_nat = larger(self.anywhere_nat - total, LEAST_NAT);
        for component in &mut self.components {
            component.weight_nat -= total;
        }
    }

    /// Covariance over all places as they stand, square metres, where nothing was heard for so long.
    pub fn covariance_m2(&self, unheard_s: f32) -> Matrix2<f32> {
        moments(&self.components, self.turned(unheard_s), &self.region, exp(self.anywhere_nat)).1
    }

    /// That the tag may have turned while nothing was heard: who turned is farther from where the others are, by chance in any
    /// direction, but hardly outside of the region.
    fn turned(&self, unheard_s: f32) -> Turned {
        let [xx, _, yy] = self.region.covariance_m2;
        let noise = ProcessNoise::of_turn(self.speed_m2_s2, unheard_s);
        let position_m2 = probability(self.settings.turns_per_s, unheard_s) * noise.position_m2;
        Turned { position_m2, most_m2: 0.5 * (xx + yy) }
    }

    /// Sums up what is believed: all that is done in a cycle in which nothing was heard, as nothing was for `unheard_s` seconds.
    pub fn sum_up(&mut self, unheard_s: f32) {
        let turned = self.turned(unheard_s);
        self.summary = Summary::of(&self.components, turned, &self.region, exp(self.anywhere_nat));
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
        f(self.anywhere_nat);
        self.outages.visit(&mut f);
        f(self.explained);
        f(f32::from(u8::from(self.is_doubtful)));
        f(self.heard as f32);
    }
}

/// ln of the sum of two weights.
fn sum_nat(a: f32, b: f32) -> f32 {
    let (most, least) = if a > b { (a, b) } else { (b, a) };
    most + ln(1.0 + exp(least - most))
}

stored!(
    TagBelief<const ANCHORS, const SURFACES, const COMPONENTS> {
        components, slots, crowded_out, leader, trusted, summary, anywhere_nat, outages, explained, is_doubtful, heard
    }
    told { settings, speed_m2_s2, region }
);
written!(BeliefSettings {
    turns_per_s,
    elsewhere_per_s,
    split_above_m,
    outages_per_s,
    returns_per_s,
    walls_bar_ways,
    walls_hide_paths,
    reads_below_threshold
});

#[cfg(test)]
mod tests {
    use super::anywhere::evidence_nat;
    use super::proposal::{Landmark, Sweep, propose};
    use super::*;
    use crate::config::Config;
    use crate::model::channel::ChannelPrior;
    use crate::model::measurement::{Clutter, Measurement};
    use crate::model::motion::Motion;
    use crate::model::source::{Sight, Source};
    use crate::model::work::Work;
    use crate::perceptor::association::Mode;
    use crate::perceptor::association::outcome::{AssociatedScan, associate_scan};
    use crate::perceptor::expectation::{Detection, Prospect, Sighting};
    use crate::perceptor::scan::Scan;

    const ANCHORS: [[f32; 2]; 3] = [[0.0, 0.0], [10.0, 0.0], [5.0, 8.0]];
    const CYCLE_S: f32 = 0.1;
    const STD_M: f32 = 0.05;
    const DETECTION: f32 = 0.9;
    const CLUTTER: Clutter = Clutter { all_per_m: 0.05, false_alarms_per_m: 0.02 };
    const SPEED_M_S: f32 = 1.0;
    const REGION: Region =
        Region { centre_m: [5.0, 4.0], covariance_m2: [100.0, 0.0, 100.0], area_m2: 400.0 };

    fn filter(position_m: [f32; 2], std_m: f32) -> StateFilter<3, 2> {
        let motion = Motion {
            acceleration_density_m2_s3: 0.05,
            velocity_decay_s: 10.0,
            virtual_anchor_walk_m_sqrt_s: 3e-4,
        };
        StateFilter::new(motion, 30.0, position_m, std_m, SPEED_M_S, 0.0, 0.0)
    }

    /// A belief that hears ranges of some of the anchors, and nothing else.
    struct Listener<const COMPONENTS: usize> {
        belief: TagBelief<3, 2, COMPONENTS>,
        /// An anchor of which nothing but clutter is heard.
        out: Option<usize>,
        state: u64,
    }

    impl<const COMPONENTS: usize> Listener<COMPONENTS> {
        fn new(filter: StateFilter<3, 2>, settings: BeliefSettings, seed: u64) -> Self {
            Self { belief: TagBelief::new(filter, SPEED_M_S, REGION, settings), out: None, state: seed }
        }

        fn uniform(&mut self) -> f32 {
            self.state =
                self.state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((self.state >> 11) as f64 / (1_u64 << 53) as f64) as f32
        }

        fn normal(&mut self) -> f32 {
            let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
            radius * (core::f32::consts::TAU * self.uniform()).cos()
        }

        /// Every anchor is heard nine times of ten, and now and then something else.
        fn scan(&mut self, anchor: usize, [x, y]: [f32; 2]) -> Scan<4> {
            let mut scan = Scan::new(anchor, 0, CYCLE_S);
            let [ax, ay] = ANCHORS[anchor];
            let range = |range_m| Measurement {
                range_m,
                variance_m2: STD_M * STD_M,
                sinr: 100.0,
                energy: 1.0,
                false_alarm: 0.1,
            };
            if self.uniform() < DETECTION && self.out != Some(anchor) {
                let noisy = (x - ax).hypot(y - ay) + STD_M * self.normal();
                scan.measurements.push(range(noisy)).unwrap();
            }
            if self.uniform() < 0.3 {
                let false_m = 1.0 + 15.0 * self.uniform();
                scan.measurements.push(range(false_m)).unwrap();
            }
            scan
        }

        /// One cycle in which so many anchors are heard from a tag here. Returns how far off it is believed to be, metres.
        fn hear(&mut self, anchors: usize, truth_m: [f32; 2]) -> f32 {
            self.belief.begin(anchors, COMPONENTS);
            self.belief.predict(CYCLE_S, Some(CYCLE_S));
            let scans: std::vec::Vec<Scan<4>> =
                (0..anchors).map(|anchor| self.scan(anchor, truth_m)).collect();
            let belief = &mut self.belief;
            if belief.proposes() {
                let sweeps: std::vec::Vec<_> = scans
                    .iter()
                    .map(|scan| Sweep::new(&scan.measurements, 0.0, (0.0, 0.0), CLUTTER))
                    .collect();
                let landmarks = |sweep: usize| {
                    let position_m = ANCHORS[sweep];
                    core::iter::once(Landmark { position_m, covariance_m2: [0.0; 3], detection: DETECTION })
                };
                for place in &propose(&sweeps, landmarks, |_, _| 1.0, belief.turn(), &mut Work::default()) {
                    belief.enter(place);
                }
            }
            let (mut strong, mut explained) = (0.0, 0.0);
            let settings = *belief.settings();
            for scan in &scans {
                let anchor = scan.anchor;
                let sight = Sight {
                    anchor_m: ANCHORS[anchor],
                    height_m: 0.0,
                    height_std_m: 0.0,
                    lever_arm_m: [0.0; 2],
                };
                let mut best: Option<(f32, f32)> = None;
                for component in belief.components_mut() {
                    let prospect = Prospect {
                        regression: component
                            .filter
                            .regress(Source::Direct { anchor }, &sight, None)
                            .unwrap(),
                        channel: ChannelPrior::UNKNOWN,
                        sinr_here: None,
                        is_unseen_image: false,
                        availability: 1.0,
                    };
                    let detection =
                        Detection { probability: DETECTION, found: DETECTION, sighting: Sighting::Open };
                    let mut outcome = AssociatedScan::<1, 4>::of(scan);
                    outcome.expected.begin(&prospect, &detection);
                    let outage = component.outages.predict(anchor, CYCLE_S, &settings);
                    associate_scan(&mut outcome, &[1.0; 4], &CLUTTER, outage, Mode::Soft);
                    component.outages.set(anchor, outcome.beliefs.outage);
                    component.weight_nat += outcome.beliefs.evidence_nat;
                    component.filter.update(outcome.innovations());
                    if best.is_none_or(|(most, _)| component.weight_nat > most) {
                        best = Some((component.weight_nat, outcome.unexplained()));
                    }
                }
                belief.reduce();
                let detections = core::iter::once(DETECTION);
                let anywhere_nat = evidence_nat(detections, &scan.measurements, &CLUTTER, 30.0);
                belief.hear_anywhere(anchor, CYCLE_S, anywhere_nat);
                strong += scan.measurements.len() as f32;
                explained += scan.measurements.len() as f32 - best.unwrap().1;
            }
            belief.explain(strong, explained);
            belief.conclude(|_, _, _| 1.0, |_, _| 1.0);
            let places: f32 = belief.components().iter().map(|own| own.weight_nat.exp()).sum();
            let total = places + belief.anywhere_nat.exp();
            assert!((total - 1.0).abs() < 1e-4 && belief.components().len() <= COMPONENTS, "{total}");
            let [x, y] = belief.summary().position_m;
            (x - truth_m[0]).hypot(y - truth_m[1])
        }

        /// Probability that the tag is within a metre of this place.
        fn near(&self, [x, y]: [f32; 2]) -> f32 {
            let near = |own: &&Component<3, 2>| {
                let [own_x, own_y] = own.filter.position_m();
                (own_x - x).hypot(own_y - y) < 1.0
            };
            self.belief.components().iter().filter(near).map(|own| own.weight_nat.exp()).sum()
        }
    }

    #[test]
    fn a_start_that_is_wrong_by_a_metre_is_put_right() {
        let mut worst = 0.0_f32;
        for seed in 0..40 {
            let truth_m = [4.0, 3.0];
            let angle = seed as f32 * 2.4;
            let start = filter([truth_m[0] + angle.cos(), truth_m[1] + angle.sin()], 1.0);
            let mut listener = Listener::<8>::new(start, BeliefSettings::default(), seed);
            let errors: std::vec::Vec<f32> = (0..20).map(|_| listener.hear(3, truth_m)).collect();
            worst = errors[10..].iter().fold(worst, |worst, error| worst.max(*error));
            assert!(listener.belief.is_sure() && !listener.belief.is_searching());
        }
        std::println!("a metre off at the start: {worst:.3} m at most from 1 s to 2 s after it");
        assert!(worst < 0.25, "{worst}");
    }

    /// Mean of the largest error within a second of a turn on the heel, over twenty walks, metres.
    fn after_turn(turns_per_s: f32) -> f32 {
        let mut sum = 0.0;
        for seed in 0..20 {
            let settings = BeliefSettings { turns_per_s, ..BeliefSettings::default() };
            let mut listener = Listener::<8>::new(filter([1.0, 3.0], 0.3), settings, seed);
            let mut worst = 0.0_f32;
            for cycle in 0..50 {
                let walked = if cycle < 40 { cycle } else { 80 - cycle };
                let error = listener.hear(3, [1.0 + 0.15 * walked as f32, 3.0]);
                if cycle >= 40 {
                    worst = worst.max(error);
                }
            }
            sum += worst;
        }
        sum / 20.0
    }

    #[test]
    fn a_turn_on_the_heel_is_followed_by_the_child_that_turned() {
        let (with, without) = (after_turn(BeliefSettings::default().turns_per_s), after_turn(0.0));
        std::println!(
            "within a second of a turn: {with:.3} m at most; {without:.3} m where none is expected"
        );
        assert!(with < 0.25 && with < 0.7 * without, "{with} {without}");
    }

    #[test]
    fn the_mirror_place_is_carried_until_a_third_source_decides() {
        let (truth_m, mirror_m) = ([4.0, 3.0], [4.0, -3.0]);
        let (mut least, mut most) = (1.0_f32, 0.0_f32);
        for seed in 0..20 {
            let mut listener = Listener::<8>::new(filter([4.0, 0.0], 3.0), BeliefSettings::default(), seed);
            for _ in 0..20 {
                listener.hear(2, truth_m);
            }
            let [own, other] = [truth_m, mirror_m].map(|place_m| listener.near(place_m));
            assert!(own + other > 0.95, "{seed}: {own} {other}");
            (least, most) = (least.min(own.min(other)), most.max(own.min(other)));
            // Both, and the covariance says so.
            let summary = *listener.belief.summary();
            assert!((summary.probability - own.max(other)).abs() < 0.05, "{seed}: {summary:?}");
            let between = own * other * 36.0;
            assert!((summary.covariance_m2.m22 - between).abs() < 0.1 * between + 0.1, "{seed}: {summary:?}");
            let mut error = f32::INFINITY;
            for _ in 0..15 {
                error = listener.hear(3, truth_m);
            }
            let rest = listener.near(mirror_m);
            assert!(error < 0.25 && rest < 1e-3, "{seed}: {error} {rest}");
            assert!(listener.belief.is_sure(), "{seed}");
        }
        std::println!("the lighter of both places had a probability of {least:.3} to {most:.3}");
        assert!(least > 0.01, "{least}");
    }

    #[test]
    fn a_tag_that_was_carried_elsewhere_is_found_by_newcomers() {
        let mut slowest = 0;
        for seed in 0..20 {
            let mut listener = Listener::<8>::new(filter([2.0, 2.0], 0.3), BeliefSettings::default(), seed);
            for _ in 0..10 {
                listener.hear(3, [2.0, 2.0]);
            }
            assert!(listener.belief.is_sure());
            let cycles = (0..100).take_while(|_| !(listener.hear(3, [8.0, 4.0]) < 0.3)).count();
            slowest = slowest.max(cycles);
        }
        std::println!("carried 6.3 m away: found within {slowest} cycles");
        assert!(slowest < 50, "{slowest}");
    }

    #[test]
    fn a_tag_that_one_anchor_hears_is_somewhere_on_a_circle() {
        let (mut lies, mut doubtful, mut cycles) = (0, 0, 0);
        for seed in 0..60 {
            let mut listener = Listener::<16>::new(filter([5.0, 3.0], 2.0), BeliefSettings::default(), seed);
            let mut truth_m = [5.0 + 2.0 * listener.normal(), 3.0 + 2.0 * listener.normal()];
            let angle = core::f32::consts::TAU * listener.uniform();
            for cycle in 0..60 {
                truth_m = [truth_m[0] + 0.07 * angle.cos(), truth_m[1] + 0.07 * angle.sin()];
                let error = listener.hear(1, truth_m);
                let summary = listener.belief.summary();
                let is_claimed = summary.probability > 0.9;
                if cycle >= 10 {
                    lies +=
                        u32::from(is_claimed && error > 1.0 && error * error > 9.0 * summary.variance_m2());
                    doubtful += u32::from(!is_claimed);
                    cycles += 1;
                }
            }
        }
        let share = |count: u32| f64::from(count) / f64::from(cycles);
        std::println!(
            "one anchor: {:.4} of the cycles lie, {:.3} are in doubt",
            share(lies),
            share(doubtful)
        );
        assert!(share(lies) < 0.02 && share(doubtful) > 0.8, "{} {}", share(lies), share(doubtful));
    }

    #[test]
    fn an_anchor_that_is_out_costs_no_more_than_its_ranges_and_is_believed_again() {
        let (mut told_out, mut told_heard, mut worst) = (0, 0, 0.0_f32);
        let truth_m = [4.0, 3.0];
        for seed in 0..20 {
            let mut listener = Listener::<8>::new(filter(truth_m, 0.3), BeliefSettings::default(), seed);
            (0..20).for_each(|_| _ = listener.hear(3, truth_m));
            listener.out = Some(1);
            for cycle in 0..50 {
                let error = listener.hear(3, truth_m);
                worst = worst.max(error);
                told_out += u32::from(cycle >= 5 && listener.belief.is_out(1));
                told_heard += u32::from(cycle >= 5 && !listener.belief.is_out(0));
            }
            listener.out = None;
            (0..5).for_each(|_| _ = listener.hear(3, truth_m));
            let is_heard = (0..5).any(|_| {
                listener.hear(3, truth_m);
                !listener.belief.is_out(1)
            });
            assert!(is_heard && listener.belief.is_sure(), "{seed}");
        }
        std::println!(
            "out: said in {told_out} of 900 cycles, others not in {told_heard}; {worst:.3} m at most"
        );
        assert!(told_out > 750 && told_heard > 750 && worst < 0.4, "{told_out} {told_heard} {worst}");
    }

    fn last_error<const COMPONENTS: usize>() -> f32 {
        let mut listener = Listener::<COMPONENTS>::new(filter([4.3, 3.0], 0.3), BeliefSettings::default(), 3);
        (0..40).fold(0.0, |_, cycle| listener.hear(3, [4.0 + 0.05 * cycle as f32, 3.0]))
    }

    #[test]
    fn few_components_track_what_needs_no_more() {
        for error in [last_error::<1>(), last_error::<2>(), last_error::<3>(), last_error::<16>()] {
            assert!(error < 0.2, "{error}");
        }
    }

    #[test]
    fn children_share_the_weight_of_their_parents_and_leave_room_for_newcomers() {
        let settings = BeliefSettings { elsewhere_per_s: 1e-9, ..BeliefSettings::default() };
        let mut narrow = TagBelief::<3, 2, 8>::new(filter([0.0, 0.0], 0.05), SPEED_M_S, REGION, settings);
        narrow.predict(0.1, Some(0.1));
        let weights: std::vec::Vec<f32> =
            narrow.components().iter().map(|own| own.weight_nat.exp()).collect();
        // 1 - e^-0.02: nobody turned, or somebody did.
        assert_eq!(weights.len(), 2);
        assert!((weights[1] - 0.019_801_3).abs() < 1e-6 && (weights[0] - 0.980_198_7).abs() < 1e-6);
        assert_eq!(narrow.components()[1].filter.velocity_m_s(), [0.0, 0.0]);
        // Where nothing is heard, nobody is known to have turned.
        let mut unheard = TagBelief::<3, 2, 8>::new(filter([0.0, 0.0], 0.5), SPEED_M_S, REGION, settings);
        unheard.predict(0.1, None);
        assert_eq!((unheard.components().len(), unheard.components()[0].age), (1, u16::MAX));
        // Split in three, two of which turned: two children would take the quarter of the slots that stays free.
        let mut wide = TagBelief::<3, 2, 8>::new(filter([0.0, 0.0], 0.5), SPEED_M_S, REGION, settings);
        for count in [5, 5] {
            wide.predict(0.1, Some(0.1));
            assert_eq!(wide.components().len(), count);
            assert!(wide.total_nat().abs() < 1e-5, "{}", wide.total_nat());
        }
        for count in [6, 7, 8, 8] {
            let place = Proposal {
                position_m: [3.0, 4.0],
                radial: [1.0, 0.0],
                variance_m2: [0.04; 2],
                evidence_nat: 0.0,
            };
            wide.enter(&place);
            assert_eq!(wide.components().len(), count);
        }
    }

    #[test]
    fn a_tag_that_may_have_turned_unheard_is_claimed_to_be_farther_off() {
        let mut belief =
            TagBelief::<3, 2, 8>::new(filter([0.0, 0.0], 0.3), SPEED_M_S, REGION, BeliefSettings::default());
        belief.sum_up(0.0);
        let [mut claimed_m2, mut probability] = [0.0, 1.0];
        for unheard_s in [0.0_f32, 0.5, 2.0, 10.0, 3600.0] {
            let mut unheard = belief.clone();
            unheard.sum_up(unheard_s);
            let turned = -f64::from(-0.2 * unheard_s).exp_m1();
            let exact = turned * f64::from(SPEED_M_S * SPEED_M_S * unheard_s * unheard_s) / 3.0;
            let [xx, _, yy] = REGION.covariance_m2.map(f64::from);
            let exact = 0.18 + 2.0 * exact.min(0.5 * (xx + yy) - 0.09);
            let found = f64::from(unheard.summary().variance_m2());
            assert!((found - exact).abs() < 1e-4 * exact, "{unheard_s} s: {found} {exact}");
            // Wider and less sure, and nothing but the summary has changed.
            assert!(
                unheard.summary().variance_m2() > claimed_m2 && unheard.summary().probability < probability
            );
            (claimed_m2, probability) = (unheard.summary().variance_m2(), unheard.summary().probability);
            unheard.sum_up(0.0);
            assert_eq!(unheard.summary(), belief.summary());
        }
    }

    #[test]
    fn a_cycle_carries_no_more_than_it_has_work_for_and_says_what_found_no_room() {
        for (slots, most) in [(100, 8), (8, 8), (7, 7), (3, 3), (1, 2), (0, 2)] {
            let settings = BeliefSettings { split_above_m: 0.1, ..BeliefSettings::default() };
            let start = filter([4.0, 0.0], 3.0);
            let mut belief = TagBelief::<3, 2, 8>::new(start, SPEED_M_S, REGION, settings);
            let mut crowded_out = 0;
            for _ in 0..10 {
                belief.begin(2, slots);
                belief.predict(0.1, Some(0.1));
                for x in [3.0, 9.0, 15.0] {
                    belief.enter(&Proposal {
                        position_m: [x, 4.0],
                        radial: [1.0, 0.0],
                        variance_m2: [0.04; 2],
                        evidence_nat: 0.0,
                    });
                }
                assert!(belief.components().len() <= most, "{slots}");
                let before = belief.covariance_m2(0.0);
                belief.reduce();
                // What finds no room stays in the spread.
                let after = belief.covariance_m2(0.0);
                assert!((after - before).abs().max() < 0.02 * before.max() + 0.1, "{before} {after}");
                belief.conclude(|_, _, _| 1.0, |_, _| 1.0);
                let total = sum_nat(belief.total_nat(), belief.anywhere_nat);
                assert!(total.abs() < 1e-4, "{total}");
                crowded_out += belief.crowded_out();
            }
            // Two have no children.
            assert_eq!(crowded_out > 0, most > 2, "{slots}");
        }
    }

    #[test]
    fn after_the_longest_gap_every_weight_is_a_number() {
        for gap_s in [10.0, 100.0, 3600.0] {
            let walking = |x: f32| {
                // At constant velocity, as published: nobody slows down.
                let motion = Motion { velocity_decay_s: f32::INFINITY, ..Config::default().motion };
                let mut filter = StateFilter::<3, 2>::new(motion, 30.0, [x, 0.0], 0.1, 0.1, 0.0, 0.0);
                let mut agent = filter.agent();
                agent.mean.z = 3.0;
                filter.place(&agent);
                filter
            };
            let mut belief =
                TagBelief::<3, 2, 16>::new(walking(0.0), SPEED_M_S, REGION, BeliefSettings::default());
            for x in [200.0, 200.1, 400.0] {
                belief.components.push(Component::newcomer(walking(x), -8.0, belief.outages)).unwrap();
            }
            belief.predict(gap_s, Some(gap_s));
            belief.conclude(|_, _, _| 1.0, |_, _| 1.0);
            let places: f32 = belief.components().iter().map(|own| own.weight_nat.exp()).sum();
            let total = places + belief.anywhere_nat.exp();
            assert!((total - 1.0).abs() < 1e-4, "{gap_s}: {total}");
            assert!(belief.components().iter().all(|own| own.weight_nat.is_finite()), "{gap_s}");
        }
    }

    #[test]
    fn a_newcomer_weighs_the_share_of_the_region_that_it_stands_for() {
        let mut belief =
            TagBelief::<3, 2, 8>::new(filter([0.0, 0.0], 0.3), 1.5, REGION, BeliefSettings::default());
        let place = Proposal {
            position_m: [3.0, 4.0],
            radial: [0.6, 0.8],
            variance_m2: [0.04, 0.25],
            evidence_nat: 7.0,
        };
        belief.anywhere_nat = ln(0.02);
        belief.enter(&place);
        let own = &belief.components()[1];
        // 2 pi x 0.2 x 0.5 of 400 square metres.
        let exact = (0.02 * 0.628_318_5 / 400.0_f64).ln();
        assert!((f64::from(own.weight_nat) - exact).abs() < 1e-5);
        assert_eq!((own.age, own.filter.position_m()), (0, [3.0, 4.0]));
        let agent = own.filter.agent();
        // Along the radius and across.
        let c = own.filter.position_covariance_m2();
        for ([x, y], variance) in [([0.6, 0.8], 0.04), ([-0.8, 0.6], 0.25)] {
            assert!((c.m11 * x + c.m12 * y - variance * x).abs() < 1e-6);
            assert!((c.m21 * x + c.m22 * y - variance * y).abs() < 1e-6);
        }
        assert_eq!((agent.covariance.m33, agent.covariance.m44, agent.covariance.m43), (2.25, 2.25, 0.0));
    }

    #[test]
    fn a_surface_found_beside_the_leader_is_entered_beside_every_tag() {
        let mut belief =
            TagBelief::<3, 2, 8>::new(filter([0.0, 0.0], 0.3), 1.0, REGION, BeliefSettings::default());
        let place = Proposal {
            position_m: [3.0, 4.0],
            radial: [1.0, 0.0],
            variance_m2: [0.04; 2],
            evidence_nat: 0.0,
        };
        belief.enter(&place);
        let gain = Matrix2::new(0.5, 0.2, -0.3, 0.9);
        let own = Matrix2::new(0.01, 0.002, 0.002, 0.02);
        belief.discover(1, Vector2::new(7.0, 8.0), &gain, &own);
        let expected = Vector2::new(7.0 + 0.5 * 3.0 + 0.2 * 4.0, 8.0 - 0.3 * 3.0 + 0.9 * 4.0);
        for (component, expected) in belief.components().iter().zip([Vector2::new(7.0, 8.0), expected]) {
            let (_, state, c) = component.filter.surface(1).unwrap();
            assert!((state - expected).abs().max() < 1e-5, "{state} {expected}");
            let exact = gain * component.filter.position_covariance_m2() * gain.transpose() + own;
            assert!((c - exact).abs().max() < 1e-6);
        }
        assert!(belief.trusted().surface(1).is_some());
        // The leader moves it, the others follow only in what it is; then it is gone in all.
        let moved = crate::model::surface::Surface::Wall(crate::model::surface::Line {
            centre_m: [1.0, 1.0],
            normal: [1.0, 0.0],
        });
        let slopes = Matrix2::identity();
        let revised = belief.revise(|leader| leader.rebase(1, moved, Vector2::zeros(), &slopes).then_some(5));
        assert_eq!(revised, Some(5));
        let mut states = belief.components().iter().map(|own| &own.filter).chain([belief.trusted()]);
        assert!(states.all(|own| own.surface(1).is_some_and(|(surface, ..)| surface == moved)));
        drop(states);
        belief.remove(1);
        assert!(belief.components().iter().all(|own| own.filter.surface(1).is_none()));
        assert!(belief.trusted().surface(1).is_none());
    }
}
