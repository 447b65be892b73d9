//! What is believed of where the tag is, in one place, one covariance and one probability.

use super::component::Component;
use crate::model::motion::Agent;
use crate::real::exp;
use nalgebra::Matrix2;

/// Tuned: components nearer to one than this are one place with it, metres,
pub const ONE_PLACE_M: f32 = 0.3;
/// Mathematics: or nearer than so many of its deviations, squared, per axis.
pub const DEVIATIONS: f32 = 2.0;
/// Guard: against work on what does not count: components lighter than this lead no place, nats.
pub const LIGHTEST_NAT: f32 = -4.0;

/// The leading place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Summary {
    /// Mean of the components there, metres.
    pub position_m: [f32; 2],
    /// Probability that the tag is there.
    pub probability: f32,
    /// Covariance over all places that it may be at, square metres.
    pub covariance_m2: Matrix2<f32>,
}

impl Summary {
    /// Of one component.
    pub(super) fn of_one(agent: &Agent) -> Self {
        let c = &agent.covariance;
        Self {
            position_m: [agent.mean.x, agent.mean.y],
            probability: 1.0,
            covariance_m2: Matrix2::new(c.m11, c.m21, c.m21, c.m22),
        }
    }

    /// Of components whose weights sum up to 1.
    pub(super) fn of<const ANCHORS: usize, const SURFACES: usize>(
        components: &[Component<ANCHORS, SURFACES>],
    ) -> Self {
        let (mut x, mut y) = (0.0, 0.0);
        for component in components {
            let weight = exp(component.weight_nat);
            let [own_x, own_y] = component.filter.position_m();
            x += weight * own_x;
            y += weight * own_y;
        }
        let (mut xx, mut yx, mut yy) = (0.0, 0.0, 0.0);
        for component in components {
            let weight = exp(component.weight_nat);
            let c = component.filter.position_covariance_m2();
            let [own_x, own_y] = component.filter.position_m();
            let (dx, dy) = (own_x - x, own_y - y);
            xx += weight * (c.m11 + dx * dx);
            yx += weight * (c.m21 + dx * dy);
            yy += weight * (c.m22 + dy * dy);
        }
        let mut summary =
            Self { position_m: [x, y], probability: 0.0, covariance_m2: Matrix2::new(xx, yx, yx, yy) };
        for component in components.iter().filter(|component| component.weight_nat > LIGHTEST_NAT) {
            let [x, y] = component.filter.position_m();
            let c = component.filter.position_covariance_m2();
            let near_m2 = ONE_PLACE_M * ONE_PLACE_M + DEVIATIONS * (c.m11 + c.m22);
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
            if weight > summary.probability {
                summary.probability = weight;
                summary.position_m = [sum_x / weight, sum_y / weight];
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
