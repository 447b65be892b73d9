//! Smoother: where the tag was a while ago, by what was heard since.
//!
//! Of every cycle the tag as it was believed to be after it is kept, x and C, with the motion to the next. From the last cycle back,
//! with the prediction x' = F x, C' = F C F' + Q and the gain G = C F' C'^-1 (Rauch, Tung and Striebel 1965):
//!
//! x_s <- x + G (x_s of the next - x'), C_s <- C + G (C_s of the next - C') G'.
//!
//! Biases and map are left as they are: they hardly move in a lag. Where the tag turns out to be elsewhere, further than the motion
//! leads, what comes after says nothing of what was before: that is smoothed up to there.

use super::belief::component::apart;
use crate::model::matrix::{product, product_transposed};
use crate::model::motion::{Agent, Motion, MotionStep};
use crate::real::{abs, larger};
use heapless::Deque;
use nalgebra::{Matrix2, Matrix4, Vector4};

/// Mathematics: squared deviations that one move in a million exceeds: what is further was not moved there.
pub const ELSEWHERE: f32 = 27.6;
/// Guard: against the division by it: least determinant of a covariance of two numbers.
pub const LEAST_DETERMINANT: f32 = 1e-20;

/// The tag after a cycle.
#[derive(Clone, Copy, Debug)]
struct Kept {
    agent: Agent,
    /// The motion to the cycle after it, and how long that took, seconds.
    step: MotionStep,
    elapsed_s: f32,
    /// Whether the tag was elsewhere after it.
    has_leapt: bool,
}

/// The tag a while ago.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Past {
    /// How many cycles ago.
    pub cycles: usize,
    /// How many seconds.
    pub age_s: f32,
    /// The tag then, by what was heard since.
    pub agent: Agent,
}

/// The tag in the last `LAG` cycles (1 at least) at most: about 100 bytes each.
#[derive(Clone, Debug)]
pub struct FixedLag<const LAG: usize> {
    lag_s: f32,
    motion: Motion,
    kept: Deque<Kept, LAG>,
    last: Option<Agent>,
}

impl<const LAG: usize> FixedLag<LAG> {
    /// Nothing kept yet. The tag is told about `lag_s` seconds late, or `LAG` cycles where those are shorter.
    pub const fn new(lag_s: f32, motion: Motion) -> Self {
        Self { lag_s, motion, kept: Deque::new(), last: None }
    }

    /// Enters the tag as it is believed to be after a cycle that was `elapsed_s` seconds long. What has become old enough by it is
    /// told, the last first.
    pub fn enter(&mut self, agent: Agent, elapsed_s: f32, mut tell: impl FnMut(&Past)) {
        let step = self.motion.step(elapsed_s);
        if let Some(last) = self.last.replace(agent) {
            if self.kept.is_full() {
                self.kept.pop_front();
            }
            let has_leapt = apart(&predicted(&last, &step), &agent) > ELSEWHERE;
            // There is room.
            let _ = self.kept.push_back(Kept { agent: last, step, elapsed_s, has_leapt });
        }
        let is_full = self.kept.is_full();
        // Order: from the last back, as below.
        let oldest_s = self.kept.iter().rev().fold(0.0, |age_s, kept| age_s + kept.elapsed_s);
        if !(is_full || oldest_s >= self.lag_s) {
            return;
        }
        let (mut age_s, mut smoothed) = (0.0, agent);
        let mut finished = 0;
        for (number, kept) in self.kept.iter().enumerate().rev() {
            smoothed = if kept.has_leapt { kept.agent } else { kept.smoothed(&smoothed) };
            age_s += kept.elapsed_s;
            if age_s >= self.lag_s || (is_full && number == 0) {
                finished += 1;
                tell(&Past { cycles: self.kept.len() - number, age_s, agent: smoothed });
            }
        }
        for _ in 0..finished {
            self.kept.pop_front();
        }
    }
}

/// The tag after a step.
fn predicted(agent: &Agent, step: &MotionStep) -> Agent {
    let mut ahead = *agent;
    step.carry_mean(&mut ahead.mean);
    step.carry_covariance(&mut ahead.covariance);
    ahead
}

impl Kept {
    /// The tag by what is known of it after the cycle that followed.
    fn smoothed(&self, next: &Agent) -> Agent {
        let Self { agent, step, .. } = self;
        let ahead = predicted(agent, step);
        let [pp, vp, vv] = blocks(&agent.covariance);
        let [ahead_pp, ahead_vp, ahead_vv] = blocks(&ahead.covariance);
        let pv = vp.transpose();
        // C F', by columns: of positions, and of velocities.
        let of_p = [pp + pv * step.drift_s, vp + vv * step.drift_s];
        let of_v = [pv * step.decay, vv * step.decay];
        // G C' = C F' by blocks of C'.
        let inverse_vv = inverse(&ahead_vv);
        let carried = product(&inverse_vv, &ahead_vp);
        let rest = inverse(&(ahead_pp - product(&ahead_vp.transpose(), &carried)));
        let gain = |of_p: Matrix2<f32>, of_v: Matrix2<f32>| {
            let by_p = product(&(of_p - product(&of_v, &carried)), &rest);
            let by_v = product(&(of_v - product_transposed(&by_p, &ahead_vp)), &inverse_vv);
            [by_p, by_v]
        };
        let ([p_p, v_p], [p_v, v_v]) = (of_p, of_v);
        let gains = [gain(p_p, p_v), gain(v_p, v_v)];
        let news = next.mean - ahead.mean;
        let moved = |[by_p, by_v]: &[Matrix2<f32>; 2]| {
            [
                by_p.m11 * news.x + by_p.m12 * news.y + by_v.m11 * news.z + by_v.m12 * news.w,
                by_p.m21 * news.x + by_p.m22 * news.y + by_v.m21 * news.z + by_v.m22 * news.w,
            ]
        };
        let [of_position, of_velocity] = &gains;
        let ([x, y], [u, v]) = (moved(of_position), moved(of_velocity));
        // G (C_s - C') G', which is symmetric.
        let [pp, vp, vv] = blocks(&(next.covariance - ahead.covariance));
        let between = |[a_p, a_v]: &[Matrix2<f32>; 2], [b_p, b_v]: &[Matrix2<f32>; 2]| {
            let left_p = product(a_p, &pp) + product(a_v, &vp);
            let left_v = product_transposed(a_p, &vp) + product(a_v, &vv);
            product_transposed(&left_p, b_p) + product_transposed(&left_v, b_v)
        };
        let pp = between(of_position, of_position);
        let vp = between(of_velocity, of_position);
        let vv = between(of_velocity, of_velocity);
        let change = Matrix4::new(
            pp.m11, pp.m21, vp.m11, vp.m21, pp.m21, pp.m22, vp.m12, vp.m22, vp.m11, vp.m12, vv.m11, vv.m21,
            vp.m21, vp.m22, vv.m21, vv.m22,
        );
        let mut covariance = agent.covariance + change;
        // A difference: rounding must not make a variance negative.
        covariance.m11 = larger(covariance.m11, 0.0);
        covariance.m22 = larger(covariance.m22, 0.0);
        covariance.m33 = larger(covariance.m33, 0.0);
        covariance.m44 = larger(covariance.m44, 0.0);
        Agent { mean: agent.mean + Vector4::new(x, y, u, v), covariance }
    }
}

/// Of a covariance of position and velocity: that of the position, that of velocity (rows) and position, that of the velocity.
fn blocks(c: &Matrix4<f32>) -> [Matrix2<f32>; 3] {
    [
        Matrix2::new(c.m11, c.m21, c.m21, c.m22),
        Matrix2::new(c.m31, c.m32, c.m41, c.m42),
        Matrix2::new(c.m33, c.m43, c.m43, c.m44),
    ]
}

/// The inverse of a covariance of two numbers.
fn inverse(c: &Matrix2<f32>) -> Matrix2<f32> {
    let scale = 1.0 / larger(abs(c.m11 * c.m22 - c.m21 * c.m21), LEAST_DETERMINANT);
    Matrix2::new(c.m22 * scale, -c.m21 * scale, -c.m21 * scale, c.m11 * scale)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_core::{Rng, SeedableRng};
    use std::vec::Vec;

    const MOTION: Motion =
        Motion { acceleration_density_m2_s3: 0.2, velocity_decay_s: 2.0, virtual_anchor_walk_m_sqrt_s: 1e-4 };

    /// A tag that walks, and a filter of its noisy positions: the truth and what the filter says, cycle by cycle.
    fn walk(cycles: usize, elapsed_s: f32, std_m: f32) -> Vec<([f32; 2], Agent)> {
        let mut rng = rand_xoshiro::Xoshiro128PlusPlus::seed_from_u64(7);
        let mut normal = || {
            let uniform = |word: u32| (word >> 8) as f32 / 16_777_216.0;
            (0..12).map(|_| uniform(rng.next_u32())).sum::<f32>() - 6.0
        };
        let step = MOTION.step(elapsed_s);
        let (mut p, mut v) = ([0.0; 2], [0.3, -0.2]);
        let spread = Vector4::new(1.0, 1.0, 1.0, 1.0);
        let mut own = Agent { mean: Vector4::zeros(), covariance: Matrix4::from_diagonal(&spread) };
        let mut run = Vec::new();
        for _ in 0..cycles {
            let ProcessNoiseRoot { along, mixed, left } = root(&step);
            for axis in 0..2 {
                let (a, b) = (normal(), normal());
                p[axis] += step.drift_s * v[axis] + along * a;
                v[axis] = step.decay * v[axis] + mixed * a + left * b;
            }
            own = predicted(&own, &step);
            for axis in 0..2 {
                let column = own.covariance.column(axis).into_owned();
                let variance = column[axis] + std_m * std_m;
                let innovation = p[axis] + std_m * normal() - own.mean[axis];
                own.mean += column * (innovation / variance);
                own.covariance -= column * column.transpose() / variance;
            }
            run.push((p, own));
        }
        run
    }

    struct ProcessNoiseRoot {
        along: f32,
        mixed: f32,
        left: f32,
    }

    /// The Cholesky factor of the process noise of one axis.
    fn root(step: &MotionStep) -> ProcessNoiseRoot {
        let along = step.noise.position_m2.sqrt();
        let mixed = step.noise.cross_m2_s / along;
        ProcessNoiseRoot { along, mixed, left: (step.noise.velocity_m2_s2 - mixed * mixed).sqrt() }
    }

    /// By Gauss and Jordan.
    fn inverted(mut a: Matrix4<f64>) -> Matrix4<f64> {
        let mut inverse = Matrix4::identity();
        for pivot in 0..4 {
            let scale = 1.0 / a[(pivot, pivot)];
            for column in 0..4 {
                a[(pivot, column)] *= scale;
                inverse[(pivot, column)] *= scale;
            }
            for row in (0..4).filter(|row| *row != pivot) {
                let factor = a[(row, pivot)];
                for column in 0..4 {
                    a[(row, column)] -= factor * a[(pivot, column)];
                    inverse[(row, column)] -= factor * inverse[(pivot, column)];
                }
            }
        }
        inverse
    }

    /// The textbook's smoother in f64, from `last` back to `first`.
    fn textbook(
        run: &[([f32; 2], Agent)],
        first: usize,
        last: usize,
        elapsed_s: f32,
    ) -> (Vector4<f64>, Matrix4<f64>) {
        let step = MOTION.step(elapsed_s);
        let (drift, decay) = (f64::from(step.drift_s), f64::from(step.decay));
        let f = Matrix4::new(
            1.0, 0.0, drift, 0.0, 0.0, 1.0, 0.0, drift, 0.0, 0.0, decay, 0.0, 0.0, 0.0, 0.0, decay,
        );
        let mut noise = Matrix4::zeros();
        step.noise.add_to(&mut noise);
        let (_, agent) = run[last];
        let (mut x, mut c) = (agent.mean.cast::<f64>(), agent.covariance.cast::<f64>());
        for k in (first..last).rev() {
            let (own, covariance) = (run[k].1.mean.cast::<f64>(), run[k].1.covariance.cast::<f64>());
            let ahead = f * covariance * f.transpose() + noise.cast::<f64>();
            let gain = covariance * f.transpose() * inverted(ahead);
            x = own + gain * (x - f * own);
            c = covariance + gain * (c - ahead) * gain.transpose();
        }
        (x, c)
    }

    #[test]
    fn the_tag_a_lag_ago_is_that_of_the_textbook() {
        let run = walk(60, 0.1, 0.2);
        let mut smoother = FixedLag::<10>::new(0.45, MOTION);
        for (cycle, (_, agent)) in run.iter().enumerate() {
            let mut told = 0;
            smoother.enter(*agent, 0.1, |Past { cycles, age_s, agent: smoothed }| {
                told += 1;
                assert_eq!(*cycles, 5);
                assert!((age_s - 0.5).abs() < 1e-3, "{age_s}");
                let (mean, covariance) = textbook(&run, cycle - 5, cycle, 0.1);
                for (own, exact) in smoothed.mean.iter().zip(mean.iter()) {
                    assert!((f64::from(*own) - exact).abs() < 1e-4, "{cycle}: {smoothed:?} {mean}");
                }
                for (own, exact) in smoothed.covariance.iter().zip(covariance.iter()) {
                    assert!((f64::from(*own) - exact).abs() < 1e-4, "{cycle}: {smoothed:?} {covariance}");
                }
            });
            assert_eq!(told, usize::from(cycle >= 5), "{cycle}");
        }
    }

    #[test]
    fn a_lag_makes_errors_smaller_and_knows_by_how_much() {
        let run = walk(3000, 0.1, 0.2);
        let mut smoother = FixedLag::<32>::new(0.95, MOTION);
        let (mut causal, mut late, mut claimed, mut count) = (0.0, 0.0, 0.0, 0.0);
        let squared =
            |agent: &Agent, [x, y]: [f32; 2]| (agent.mean.x - x).powi(2) + (agent.mean.y - y).powi(2);
        for (cycle, (truth, agent)) in run.iter().enumerate() {
            causal += squared(agent, *truth);
            smoother.enter(*agent, 0.1, |Past { agent: smoothed, .. }| {
                late += squared(smoothed, run[cycle - 10].0);
                claimed += smoothed.covariance.m11 + smoothed.covariance.m22;
                count += 1.0;
            });
        }
        let causal = causal / run.len() as f32;
        let (late, claimed) = (late / count, claimed / count);
        assert!(late < 0.6 * causal && (late / claimed - 1.0).abs() < 0.15, "{causal} {late} {claimed}");
    }

    #[test]
    fn a_tag_that_is_elsewhere_moves_nothing_of_what_was_before() {
        let run = walk(20, 0.1, 0.2);
        let mut smoother = FixedLag::<10>::new(0.3, MOTION);
        run.iter().for_each(|(_, agent)| smoother.enter(*agent, 0.1, |_| ()));
        let mut elsewhere = run[19].1;
        elsewhere.mean.x += 20.0;
        let mut told = 0;
        for cycle in 0..6 {
            smoother.enter(elsewhere, 0.1, |Past { agent: smoothed, .. }| {
                told += 1;
                let then = if cycle < 3 { run[17 + cycle].1 } else { elsewhere };
                assert!((smoothed.mean.x - then.mean.x).abs() < 0.5, "{cycle}: {smoothed:?}");
            });
        }
        assert_eq!(told, 6);
    }

    #[test]
    fn where_there_is_no_room_the_lag_is_shorter() {
        let run = walk(30, 0.1, 0.2);
        let mut smoother = FixedLag::<4>::new(10.0, MOTION);
        let mut told = 0;
        for (_, agent) in &run {
            smoother.enter(*agent, 0.1, |Past { age_s, .. }| {
                told += 1;
                assert!((age_s - 0.4).abs() < 1e-3, "{age_s}");
            });
        }
        assert_eq!(told, 26);
    }
}
