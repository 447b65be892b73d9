//! One component of the belief: a joint state and its weight.

use super::PLACE_M;
use super::outage::Outages;
use crate::model::motion::Agent;
use crate::perceptor::state_filter::StateFilter;
use crate::real::{larger, ln, sqrt};
use crate::snapshot::stored;

/// Guard: against a plan believed to the letter: least probability of a way through a wall.
pub const LEAST_THROUGH: f32 = 0.05;
/// Guard: against an outline believed to the letter: least probability of a place outside.
pub const OUTSIDE: f32 = 1e-3;
/// Tuned: two tags are one where places and velocities differ by less than this, in squared deviations of their differences.
pub const ONE: f32 = 0.5;
/// Mathematics: squared deviations beyond which a tag has not moved to another place but is elsewhere: three.
pub const LEAPT: f32 = 9.0;
/// Guard: against the division by them: what the variances of differences have on top, square metres and m^2/s^2.
pub const LEAST_SPREAD: [f32; 2] = [1e-6, 1e-4];
/// Guard: against the division by it: least determinant of a covariance.
pub const LEAST_DETERMINANT: f32 = 1e-12;

/// What stands in the way of a component: walls that its tag would have walked through, an outline that it is outside of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hindrance {
    /// Where the tag was when its way was last decided, metres.
    pub from_m: [f32; 2],
    /// ln of the factor of the way since and of the outline in the weight.
    pub nat: f32,
}

/// A joint state and its weight.
#[derive(Clone, Debug)]
pub struct Component<const ANCHORS: usize, const SURFACES: usize> {
    /// Tag, biases and map.
    pub filter: StateFilter<ANCHORS, SURFACES>,
    /// ln of its weight.
    pub weight_nat: f32,
    /// Cycles heard since it was proposed; the largest number once it is established.
    pub age: u16,
    /// What is heard of the anchors.
    pub outages: Outages<ANCHORS>,
    /// What stands in its way.
    pub hindrance: Hindrance,
}

impl<const ANCHORS: usize, const SURFACES: usize> Component<ANCHORS, SURFACES> {
    /// The first one.
    pub fn established(filter: StateFilter<ANCHORS, SURFACES>, outages: Outages<ANCHORS>) -> Self {
        Self { age: u16::MAX, ..Self::newcomer(filter, 0.0, outages) }
    }

    /// One that was just proposed.
    pub fn newcomer(
        filter: StateFilter<ANCHORS, SURFACES>,
        weight_nat: f32,
        outages: Outages<ANCHORS>,
    ) -> Self {
        let from_m = filter.position_m();
        Self { filter, weight_nat, age: 0, outages, hindrance: Hindrance { from_m, nat: 0.0 } }
    }

    /// The axis (a unit vector) along which its position varies most, where it does by more than this variance.
    pub fn axis_above(&self, widest_m2: f32) -> Option<[f32; 2]> {
        let c = self.filter.position_covariance_m2();
        let (half, apart) = (0.5 * (c.m11 + c.m22), 0.5 * (c.m11 - c.m22));
        let major = half + sqrt(apart * apart + c.m21 * c.m21);
        if major <= widest_m2 {
            return None;
        }
        // The longest axis, from the row of C - major that is not nearly zero.
        let (x, y) = if apart > 0.0 { (major - c.m22, c.m21) } else { (c.m21, major - c.m11) };
        let norm = sqrt(x * x + y * y);
        Some(if norm > 0.0 { [x / norm, y / norm] } else { [1.0, 0.0] })
    }

    /// Becomes the middle one of three components along an axis, and its copies the others: weights 1/2 and 1/4 each, a deviation
    /// apart, with half of the variance left. Mean and covariance of the three are those of the one.
    pub fn split(&mut self, axis: [f32; 2], copies: &mut [Self; 2]) {
        for (copy, deviations) in copies.iter_mut().zip([-1.0, 1.0]) {
            copy.filter.narrow(axis, deviations, 0.5);
            copy.weight_nat += ln(0.25);
        }
        self.filter.narrow(axis, 0.0, 0.5);
        self.weight_nat += ln(0.5);
    }

    /// Enters the way since it was last decided, and the place, in place of those entered before. A way that is decided stays in
    /// the weight, and the next one begins.
    pub(super) fn hinder(
        &mut self,
        through: impl Fn([f32; 2], [f32; 2], f32) -> f32,
        inside: impl Fn([f32; 2], f32) -> f32,
    ) {
        let [x, y] = self.filter.position_m();
        let c = self.filter.position_covariance_m2();
        let std_m = sqrt(larger(0.5 * (c.m11 + c.m22), 0.0));
        let Hindrance { from_m: [from_x, from_y], nat } = self.hindrance;
        let way = larger(through([from_x, from_y], [x, y], std_m), LEAST_THROUGH);
        let way_nat = ln(way);
        let place_nat = ln(larger(inside([x, y], std_m), OUTSIDE));
        self.weight_nat += (way_nat + place_nat) - nat;
        self.hindrance.nat = way_nat + place_nat;
        let (dx, dy) = (x - from_x, y - from_y);
        // A short way may be the noise of the position.
        let is_long = dx * dx + dy * dy > PLACE_M * PLACE_M;
        let is_open = way > 1.0 - 2.0 * LEAST_THROUGH;
        let is_blocked = way < 2.0 * LEAST_THROUGH;
        if is_long && (is_open || is_blocked) {
            self.hindrance = Hindrance { from_m: [x, y], nat: place_nat };
        }
    }

    /// Every number of the state, in a fixed order, for traces.
    pub(super) fn visit(&self, f: &mut impl FnMut(f32)) {
        self.filter.visit(&mut *f);
        f(self.weight_nat);
        f(f32::from(self.age));
        self.outages.visit(&mut *f);
        self.hindrance.from_m.into_iter().for_each(&mut *f);
        f(self.hindrance.nat);
    }
}

/// How far one tag is from another, squared, in deviations of the difference.
pub fn apart(a: &Agent, b: &Agent) -> f32 {
    let difference = [a.mean.x - b.mean.x, a.mean.y - b.mean.y];
    let c = a.covariance + b.covariance;
    squared_deviations(difference, [c.m11, c.m21, c.m22], LEAST_SPREAD[0])
}

/// Whether two tags are one: at one place, and moving alike.
pub fn is_one(a: &Agent, b: &Agent) -> bool {
    if apart(a, b) > ONE {
        return false;
    }
    let difference = [a.mean.z - b.mean.z, a.mean.w - b.mean.w];
    let c = a.covariance + b.covariance;
    squared_deviations(difference, [c.m33, c.m43, c.m44], LEAST_SPREAD[1]) <= ONE
}

/// d' C^-1 d, C having `least` more on its diagonal.
fn squared_deviations([dx, dy]: [f32; 2], [xx, yx, yy]: [f32; 3], least: f32) -> f32 {
    let (xx, yy) = (xx + least, yy + least);
    let determinant = larger(xx * yy - yx * yx, LEAST_DETERMINANT);
    (yy * (dx * dx) - 2.0 * (yx * (dx * dy)) + xx * (dy * dy)) / determinant
}

#[cfg(test)]
pub(in crate::perceptor::belief) mod tests {
    use super::super::BeliefSettings;
    use super::*;
    use crate::config::Config;
    use std::cell::Cell;

    /// A component that was established, of a tag that stands here.
    pub fn component(position_m: [f32; 2], std_m: f32, weight_nat: f32) -> Component<2, 1> {
        let filter = StateFilter::new(Config::default().motion, 30.0, position_m, std_m, 0.3, 0.0, 0.0);
        let outages = Outages::usual(&BeliefSettings::default());
        Component { weight_nat, ..Component::established(filter, outages) }
    }

    /// A component that is walked about, beside a wall along x = 1 and inside an outline that ends at y = 5.
    struct Walk {
        component: Component<2, 1>,
        /// What the wall lets through.
        through: f32,
    }

    impl Walk {
        fn new(through: f32) -> Self {
            Self { component: component([0.0, 0.0], 0.05, -1.0), through }
        }

        /// What it has cost so far, nats, once the tag is here.
        fn to(&mut self, position_m: [f32; 2]) -> f32 {
            let mut agent = self.component.filter.agent();
            (agent.mean.x, agent.mean.y) = (position_m[0], position_m[1]);
            self.component.filter.place(&agent);
            self.component.hinder(
                |[from, _], [to, _], _| if (from < 1.0) == (to < 1.0) { 1.0 } else { self.through },
                |[_, y], _| if y < 5.0 { 1.0 } else { 0.0 },
            );
            -1.0 - self.component.weight_nat
        }
    }

    fn assert_costs(found: f32, nat: f32) {
        assert!((found - nat).abs() < 1e-5, "{found} {nat}");
    }

    #[test]
    fn a_way_through_a_wall_costs_what_it_says_once() {
        let wall_nat = -ln(0.06);
        let mut walk = Walk::new(0.06);
        assert_costs(walk.to([0.9, 0.0]), 0.0);
        for x in [1.05, 1.1, 1.3, 2.0, 2.0, 2.5, 4.0] {
            assert_costs(walk.to([x, 0.0]), wall_nat);
        }
        // A wall that nothing is said to pass costs no more than the least.
        let mut walk = Walk::new(0.0);
        walk.to([0.9, 0.0]);
        for x in [1.1, 2.0, 3.0] {
            assert_costs(walk.to([x, 0.0]), -ln(LEAST_THROUGH));
        }
    }

    #[test]
    fn a_way_that_nobody_decided_is_taken_back_and_one_that_was_stays() {
        // Too short a way, and one that may be open.
        for (through, there) in [(0.06, [1.1, 0.0]), (0.4, [2.0, 0.0])] {
            let mut walk = Walk::new(through);
            walk.to([0.9, 0.0]);
            let from_m = walk.component.hindrance.from_m;
            assert_eq!(from_m, [0.9, 0.0]);
            for _ in 0..3 {
                assert_costs(walk.to(there), -ln(through));
                assert_eq!(walk.component.hindrance.from_m, from_m);
                assert_costs(walk.to([0.95, 0.0]), 0.0);
            }
        }
        // One that is blocked for certain stays, and the way back costs as much again.
        let mut walk = Walk::new(0.06);
        walk.to([0.9, 0.0]);
        assert_costs(walk.to([1.3, 0.0]), -ln(0.06));
        assert_eq!(walk.component.hindrance.from_m, [1.3, 0.0]);
        assert_costs(walk.to([0.9, 0.0]), -2.0 * ln(0.06));
    }

    #[test]
    fn outside_of_the_outline_costs_as_long_as_the_tag_is_there() {
        let mut walk = Walk::new(0.06);
        for _ in 0..2 {
            for y in [5.1, 5.2, 6.0, 9.0] {
                assert_costs(walk.to([0.0, y]), -ln(OUTSIDE));
            }
            assert_costs(walk.to([0.0, 4.0]), 0.0);
        }
        // Both at once, and the wall stays paid for.
        assert_costs(walk.to([0.9, 4.0]), 0.0);
        assert_costs(walk.to([1.2, 6.0]), -ln(OUTSIDE) - ln(0.06));
        assert_costs(walk.to([1.2, 4.0]), -ln(0.06));
    }

    #[test]
    fn hindrances_are_asked_from_where_the_way_began_and_as_well_as_the_tag_is_known() {
        let mut own = component([2.0, 1.0], 0.25, 0.0);
        own.hindrance.from_m = [1.0, 1.0];
        let asked = Cell::new(None);
        let place = Cell::new(None);
        own.hinder(
            |from, to, std_m| {
                asked.set(Some((from, to, std_m)));
                1.0
            },
            |at, std_m| {
                place.set(Some((at, std_m)));
                1.0
            },
        );
        assert_eq!(asked.get(), Some(([1.0, 1.0], [2.0, 1.0], 0.25)));
        assert_eq!(place.get(), Some(([2.0, 1.0], 0.25)));
    }

    #[test]
    fn tags_are_one_where_place_and_motion_agree() {
        let own = component([0.0, 0.0], 0.5, 0.0).filter.agent();
        // sqrt(0.5) deviations of the difference, which are 0.5 sqrt 2: half a metre.
        for (x, is_near) in [(0.499, true), (0.501, false)] {
            let other = component([x, 0.0], 0.5, 0.0).filter.agent();
            assert_eq!(is_one(&own, &other), is_near, "{x}: {}", apart(&own, &other));
            // The same, seen along any axis.
            let turned = component([-0.6 * x, 0.8 * x], 0.5, 0.0).filter.agent();
            assert_eq!(is_one(&own, &turned), is_near);
        }
        // The same deviations of the velocities' difference, which are 0.3 sqrt 2: 0.3 m/s.
        for (v, is_near) in [(0.299, true), (0.301, false)] {
            let mut other = own;
            other.mean.w = v;
            assert_eq!(is_one(&own, &other), is_near, "{v}");
        }
        // Correlated positions: d' C^-1 d in f64.
        let mut skewed = own;
        (skewed.covariance.m12, skewed.covariance.m21) = (0.2, 0.2);
        (skewed.mean.x, skewed.mean.y) = (0.7, -0.2);
        let (xx, yx, yy) = (0.5_f64 + 1e-6, 0.2, 0.5_f64 + 1e-6);
        let (dx, dy) = (0.7_f64, -0.2_f64);
        let exact = (yy * dx * dx - 2.0 * yx * dx * dy + xx * dy * dy) / (xx * yy - yx * yx);
        assert!((f64::from(apart(&own, &skewed)) - exact).abs() < 1e-5, "{exact}");
    }
}

stored!(blank Hindrance { from_m, nat });
stored!(blank Component<const ANCHORS, const SURFACES> { filter, weight_nat, age, outages, hindrance });
