//! What is believed of where the tag is, in one place, one covariance and one probability.

use super::PLACE_M;
use super::component::Component;
use crate::model::motion::Agent;
use crate::model::region::Region;
use crate::real::{exp, larger, smaller};
use crate::snapshot::stored;
use nalgebra::Matrix2;

/// Mathematics: components are one place where they are nearer than so many deviations of the one, squared, per axis, beyond
/// [`PLACE_M`].
pub const DEVIATIONS: f32 = 2.0;
/// Mathematics: what the probability that is reported is of: that the tag is no farther than this, metres, from where it is
/// reported to be.
pub const WITHIN_M: f32 = 1.0;
/// Guard: against the division by it: least second moment, square metres.
pub const LEAST_MOMENT_M2: f32 = 1e-4;
/// Guard: against work on what does not count: components lighter than this lead no place, nats.
pub const LIGHTEST_NAT: f32 = -4.0;

/// That the tag may have turned since it was last heard.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Turned {
    /// What that adds to the variance of its position, per axis, square metres.
    pub(super) position_m2: f32,
    /// The variance per axis up to which it does.
    pub(super) most_m2: f32,
}

impl Turned {
    /// The covariance of a component's position, square metres.
    fn position_covariance_m2<const ANCHORS: usize, const SURFACES: usize>(
        &self,
        component: &Component<ANCHORS, SURFACES>,
    ) -> Matrix2<f32> {
        let mut c = component.filter.position_covariance_m2();
        let room_m2 = larger(self.most_m2 - 0.5 * (c.m11 + c.m22), 0.0);
        let more_m2 = smaller(self.position_m2, room_m2);
        c.m11 += more_m2;
        c.m22 += more_m2;
        c
    }
}

/// The leading place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Summary {
    /// Mean of the components there, metres.
    pub position_m: [f32; 2],
    /// Probability that the tag is within [`WITHIN_M`] of it.
    pub probability: f32,
    /// Covariance over all places that it may be at, square metres.
    pub covariance_m2: Matrix2<f32>,
}

impl Summary {
    /// Nothing is believed.
    pub(super) const NONE: Self =
        Self { position_m: [0.0; 2], probability: 0.0, covariance_m2: Matrix2::new(0.0, 0.0, 0.0, 0.0) };

    /// Of one component.
    pub(super) fn of_one(agent: &Agent) -> Self {
        let c = &agent.covariance;
        Self {
            position_m: [agent.mean.x, agent.mean.y],
            probability: 1.0 - exp(-(WITHIN_M * WITHIN_M) / larger(c.m11 + c.m22, LEAST_MOMENT_M2)),
            covariance_m2: Matrix2::new(c.m11, c.m21, c.m21, c.m22),
        }
    }

    /// Of components that may have `turned`, and of a tag that is `anywhere` in a region with this probability; all of it sums up
    /// to 1.
    pub(super) fn of<const ANCHORS: usize, const SURFACES: usize>(
        components: &[Component<ANCHORS, SURFACES>],
        turned: Turned,
        region: &Region,
        anywhere: f32,
    ) -> Self {
        let (position_m, covariance_m2) = moments(components, turned, region, anywhere);
        let mut summary = Self { position_m, probability: 0.0, covariance_m2 };
        let mut most = 0.0;
        for component in components.iter().filter(|component| component.weight_nat > LIGHTEST_NAT) {
            let [x, y] = component.filter.position_m();
            let c = turned.position_covariance_m2(component);
            let near_m2 = PLACE_M * PLACE_M + DEVIATIONS * (c.m11 + c.m22);
            let (mut weight, mut sum_x, mut sum_y) = (0.0, 0.0, 0.0);
            for other in components {
                let [other_x, other_y] = other.filter.position_m();
                let (dx, dy) = (other_x - x, other_y - y);
                if dx * dx + dy * dy < near_m2 {
                    let own = exp(other.weight_nat);
                    weight += own;
                    sum_x += own * other_x;
                    sum_y += own * other_y;
                }
            }
            if weight > most {
                most = weight;
                summary.position_m = [sum_x / weight, sum_y / weight];
                summary.probability = within(components, turned, summary.position_m, [x, y], near_m2);
            }
        }
        summary
    }

    /// Sum of the position's variances, square metres.
    pub fn variance_m2(&self) -> f32 {
        self.covariance_m2.m11 + self.covariance_m2.m22
    }

    /// Every number, in a fixed order, for traces.
    pub(super) fn visit(&self, mut f: impl FnMut(f32)) {
        self.position_m.into_iter().for_each(&mut f);
        f(self.probability);
        self.covariance_m2.iter().for_each(|v| f(*v));
    }
}

/// Mean (metres) and covariance (square metres) over all places; see [`Summary::of`].
pub(super) fn moments<const ANCHORS: usize, const SURFACES: usize>(
    components: &[Component<ANCHORS, SURFACES>],
    turned: Turned,
    region: &Region,
    anywhere: f32,
) -> ([f32; 2], Matrix2<f32>) {
    let [centre_x, centre_y] = region.centre_m;
    let (mut x, mut y) = (anywhere * centre_x, anywhere * centre_y);
    for component in components {
        let weight = exp(component.weight_nat);
        let [own_x, own_y] = component.filter.position_m();
        x += weight * own_x;
        y += weight * own_y;
    }
    let (dx, dy) = (centre_x - x, centre_y - y);
    let [c_xx, c_yx, c_yy] = region.covariance_m2;
    let mut xx = anywhere * (c_xx + dx * dx);
    let mut yx = anywhere * (c_yx + dx * dy);
    let mut yy = anywhere * (c_yy + dy * dy);
    for component in components {
        let weight = exp(component.weight_nat);
        let c = turned.position_covariance_m2(component);
        let [own_x, own_y] = component.filter.position_m();
        let (dx, dy) = (own_x - x, own_y - y);
        xx += weight * (c.m11 + dx * dx);
        yx += weight * (c.m21 + dx * dy);
        yy += weight * (c.m22 + dy * dy);
    }
    ([x, y], Matrix2::new(xx, yx, yx, yy))
}

/// Probability that the tag is within [`WITHIN_M`] of a position, by the components of the place around `of_m`: of each, as if its
/// second moment about the position were that of an isotropic Gaussian.
fn within<const ANCHORS: usize, const SURFACES: usize>(
    components: &[Component<ANCHORS, SURFACES>],
    turned: Turned,
    [x, y]: [f32; 2],
    [of_x, of_y]: [f32; 2],
    near_m2: f32,
) -> f32 {
    let mut sum = 0.0;
    for component in components {
        let [own_x, own_y] = component.filter.position_m();
        let (dx, dy) = (own_x - of_x, own_y - of_y);
        if dx * dx + dy * dy < near_m2 {
            let c = turned.position_covariance_m2(component);
            let (dx, dy) = (own_x - x, own_y - y);
            let moment_m2 = larger(c.m11 + c.m22 + (dx * dx + dy * dy), LEAST_MOMENT_M2);
            sum += exp(component.weight_nat) * (1.0 - exp(-(WITHIN_M * WITHIN_M) / moment_m2));
        }
    }
    sum
}

stored!(Summary { position_m, probability, covariance_m2 } told {});

#[cfg(test)]
mod tests {
    use super::super::component::tests::component;
    use super::*;
    use crate::real::ln;

    const REGION: Region = Region { centre_m: [2.0, -3.0], covariance_m2: [30.0, 4.0, 20.0], area_m2: 400.0 };

    const NOT_TURNED: Turned = Turned { position_m2: 0.0, most_m2: 9.0 };

    fn of(components: &[Component<2, 1>]) -> Summary {
        Summary::of(components, NOT_TURNED, &REGION, 0.0)
    }

    /// Probability of being within a metre of a place, by the second moment about it, in f64.
    fn within_a_metre(moment_m2: f32) -> f32 {
        (1.0 - (-1.0 / f64::from(moment_m2)).exp()) as f32
    }

    fn assert_near(found: f32, exact: f32, what: &str) {
        assert!((found - exact).abs() < 1e-5, "{what}: {found} {exact}");
    }

    #[test]
    fn two_places_are_the_heavier_one_and_the_covariance_of_both() {
        for swap in [false, true] {
            let heavy = component([1.0, 2.0], 0.1, ln(0.6));
            let light = component([4.0, 6.0], 0.2, ln(0.4));
            let found = of(&if swap { [light, heavy] } else { [heavy, light] });
            assert_near(found.probability, 0.6 * within_a_metre(0.02), "probability");
            assert_eq!(found.position_m, [1.0, 2.0]);
            // Within: 0.6 x 0.01 + 0.4 x 0.04; between: 0.6 x 0.4 of (3, 4) (3, 4)'.
            let exact = Matrix2::new(0.022 + 0.24 * 9.0, 0.24 * 12.0, 0.24 * 12.0, 0.022 + 0.24 * 16.0);
            for (found, exact) in found.covariance_m2.iter().zip(exact.iter()) {
                assert_near(*found, *exact, "covariance");
            }
            assert_near(found.variance_m2(), 0.044 + 0.24 * 25.0, "variance");
        }
    }

    #[test]
    fn a_place_of_many_components_outweighs_the_heaviest_one_elsewhere() {
        let offsets = [-0.05_f32, 0.0, 0.1];
        let mut all: std::vec::Vec<_> = offsets.map(|x| component([x, 0.0], 0.05, ln(0.2))).into();
        all.push(component([5.0, 0.0], 0.05, ln(0.4)));
        let found = of(&all);
        assert_near(found.probability, 0.6, "probability");
        assert_near(found.position_m[0], 0.05 / 3.0, "x");
        assert_near(found.position_m[1], 0.0, "y");
        // Alone it is certain.
        for own in &mut all {
            own.weight_nat = ln(1.0 / 3.0);
        }
        let found = of(&all[..3]);
        assert_near(found.probability, 1.0, "probability");
        assert_near(found.position_m[0], 0.05 / 3.0, "x");
        let mean = 0.05_f32 / 3.0;
        let spread = offsets.iter().map(|x| (x - mean) * (x - mean)).sum::<f32>() / 3.0;
        assert_near(found.covariance_m2.m11, 0.0025 + spread, "covariance");
        assert_near(found.covariance_m2.m22, 0.0025, "covariance");
    }

    #[test]
    fn what_is_near_depends_on_how_well_the_component_is_known() {
        // sqrt(0.09 + 2 (0.04 + 0.04)): half a metre.
        for (x, is_one) in [(0.499_f32, true), (0.501, false)] {
            let own = component([0.0, 0.0], 0.2, ln(0.7));
            let other = component([x, 0.0], 0.01, ln(0.3));
            let mean = if is_one { 0.3 * x } else { 0.0 };
            let mut probability = 0.7 * within_a_metre(0.08 + mean * mean);
            if is_one {
                probability += 0.3 * within_a_metre(0.0002 + (x - mean) * (x - mean));
            }
            assert_near(of(&[own, other]).probability, probability, "probability");
        }
    }

    #[test]
    fn of_one_component_it_is_that_component() {
        let own = component([3.0, -1.0], 0.4, 0.0);
        let (all, one) = (of(core::slice::from_ref(&own)), Summary::of_one(&own.filter.agent()));
        assert_eq!(all, one);
        assert_eq!(one.position_m, [3.0, -1.0]);
        assert_near(one.probability, within_a_metre(0.32), "probability");
        assert_near(one.variance_m2(), 0.32, "variance");
    }

    #[test]
    fn who_may_have_turned_is_as_much_farther_off_as_there_is_room_for() {
        let own = |std_m: f32| [component([0.0, 0.0], std_m, ln(0.7)), component([3.0, 1.0], std_m, ln(0.3))];
        for (position_m2, most_m2, wide_m) in
            [(0.16, 9.0, 0.5), (0.16, 0.25, 0.5), (5.0, 0.16, 0.4), (5.0, 0.01, 0.3)]
        {
            let turned = Turned { position_m2, most_m2 };
            let (found, exact) = (Summary::of(&own(0.3), turned, &REGION, 0.0), of(&own(wide_m)));
            assert_eq!(found.position_m, exact.position_m);
            assert_near(found.probability, exact.probability, "probability");
            for (found, exact) in found.covariance_m2.iter().zip(exact.covariance_m2.iter()) {
                assert_near(*found, *exact, "covariance");
            }
        }
    }

    #[test]
    fn a_tag_that_may_be_anywhere_is_claimed_to_be() {
        let own = component([1.0, 1.0], 0.1, ln(0.25));
        let found = Summary::of(&[own], NOT_TURNED, &REGION, 0.75);
        assert_near(found.probability, 0.25 * within_a_metre(0.02), "probability");
        assert_eq!(found.position_m, [1.0, 1.0]);
        // Within, and between: 1/4 x 3/4 of (1, -4) (1, -4)'.
        let exact = [0.0025 + 22.5 + 0.1875, 3.0 - 0.1875 * 4.0, 0.0025 + 15.0 + 0.1875 * 16.0];
        let c = found.covariance_m2;
        for (found, exact) in [c.m11, c.m21, c.m22].into_iter().zip(exact) {
            assert_near(found, exact, "covariance");
        }
        // Nowhere else: the middle of the region, as wide as it is.
        let found = Summary::of(&[component([1.0, 1.0], 0.1, -60.0)], NOT_TURNED, &REGION, 1.0);
        assert_eq!((found.probability, found.position_m), (0.0, REGION.centre_m));
        assert_near(found.variance_m2(), 50.0, "variance");
    }
}
