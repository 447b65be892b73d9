//! One component of the belief: a joint state and its weight.

use crate::model::motion::Agent;
use crate::perceptor::state_filter::StateFilter;
use crate::real::{larger, ln, sqrt};

/// Guard: against a plan believed to the letter: least probability of a way through a wall.
pub const LEAST_THROUGH: f32 = 0.05;
/// Guard: against the same: least probability that the tag is outside the outline told.
pub const OUTSIDE: f32 = 1e-3;
/// Tuned: against a way that nobody decided: so long is it at least, metres.
pub const SHORTEST_WAY_M: f32 = 0.3;
/// Mathematics: a way is open or blocked where its probability is this sure, as ln: 0.9,
pub const OPEN_NAT: f32 = -0.1;
/// Mathematics: or nearly the least.
pub const BLOCKED_NAT: f32 = -2.5;
/// Tuned: components are one where their positions are nearer than this, as squared deviations of their difference,
pub const ONE_PLACE: f32 = 0.5;
/// Tuned: and their velocities nearer than this.
pub const ONE_VELOCITY: f32 = 0.7;
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
    /// What stands in its way.
    pub hindrance: Hindrance,
}

impl<const ANCHORS: usize, const SURFACES: usize> Component<ANCHORS, SURFACES> {
    /// The first one.
    pub fn established(filter: StateFilter<ANCHORS, SURFACES>) -> Self {
        Self { age: u16::MAX, ..Self::newcomer(filter, 0.0) }
    }

    /// One that was just proposed.
    pub fn newcomer(filter: StateFilter<ANCHORS, SURFACES>, weight_nat: f32) -> Self {
        let from_m = filter.position_m();
        Self { filter, weight_nat, age: 0, hindrance: Hindrance { from_m, nat: 0.0 } }
    }

    /// Where its largest variance is above this, becomes the middle one of three components and returns the others: weights 1/2
    /// and 1/4 each, a deviation apart, with half of the variance left. Mean and covariance of the three are those of the one.
    pub fn split(&mut self, widest_m2: f32) -> [Option<Self>; 2] {
        let c = self.filter.position_covariance_m2();
        let (half, apart) = (0.5 * (c.m11 + c.m22), 0.5 * (c.m11 - c.m22));
        let major = half + sqrt(apart * apart + c.m21 * c.m21);
        if major <= widest_m2 {
            return [None, None];
        }
        // The longest axis, from the row of C - major that is not nearly zero.
        let (x, y) = if apart > 0.0 { (major - c.m22, c.m21) } else { (c.m21, major - c.m11) };
        let norm = sqrt(x * x + y * y);
        let axis = if norm > 0.0 { [x / norm, y / norm] } else { [1.0, 0.0] };
        let side = |deviations: f32| {
            let mut side = self.clone();
            side.filter.narrow(axis, deviations, 0.5);
            side.weight_nat += ln(0.25);
            Some(side)
        };
        let sides = [side(-1.0), side(1.0)];
        self.filter.narrow(axis, 0.0, 0.5);
        self.weight_nat += ln(0.5);
        sides
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
        let way_nat = ln(larger(through([from_x, from_y], [x, y], std_m), LEAST_THROUGH));
        let place_nat = ln(larger(inside([x, y], std_m), OUTSIDE));
        self.weight_nat += (way_nat + place_nat) - nat;
        self.hindrance.nat = way_nat + place_nat;
        let (dx, dy) = (x - from_x, y - from_y);
        let is_long = dx * dx + dy * dy > SHORTEST_WAY_M * SHORTEST_WAY_M;
        if is_long && !(BLOCKED_NAT..=OPEN_NAT).contains(&way_nat) {
            self.hindrance = Hindrance { from_m: [x, y], nat: place_nat };
        }
    }

    /// Every number of the state, in a fixed order, for traces.
    pub(super) fn visit(&self, mut f: impl FnMut(f32)) {
        self.filter.visit(&mut f);
        f(self.weight_nat);
        f(f32::from(self.age));
        self.hindrance.from_m.into_iter().for_each(&mut f);
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
    if apart(a, b) > ONE_PLACE {
        return false;
    }
    let difference = [a.mean.z - b.mean.z, a.mean.w - b.mean.w];
    let c = a.covariance + b.covariance;
    squared_deviations(difference, [c.m33, c.m43, c.m44], LEAST_SPREAD[1]) <= ONE_VELOCITY
}

/// d' C^-1 d, C having `least` more on its diagonal.
fn squared_deviations([dx, dy]: [f32; 2], [xx, yx, yy]: [f32; 3], least: f32) -> f32 {
    let (xx, yy) = (xx + least, yy + least);
    let determinant = larger(xx * yy - yx * yx, LEAST_DETERMINANT);
    (yy * (dx * dx) - 2.0 * (yx * (dx * dy)) + xx * (dy * dy)) / determinant
}
