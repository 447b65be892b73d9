//! Where the tag is, in the large: searched for, lost, or off on a manoeuvre.
//!
//! [`TagBelief`] holds whether it is known where the tag is. While it is not, [`acquisition`] weighs the places it may be at;
//! while it is, [`loss`] notices when the tag is elsewhere. [`manoeuvre`] says when the tag turns.

pub mod acquisition;
pub mod loss;
pub mod manoeuvre;
pub mod mixture;

use self::acquisition::{Acquisition, AcquisitionSettings, Landmark, Sweep};
use self::loss::{BeliefSettings, LossMonitor};
use crate::model::motion::{Agent, Motion, MotionStep};
use crate::real::smaller;
use nalgebra::{Matrix4, Vector4};

/// Whether it is known where the tag is, and if not, where it may be.
#[derive(Clone, Debug)]
pub struct TagBelief<const ANCHORS: usize> {
    motion: Motion,
    /// Standard deviation of a velocity that nothing is known of, m/s.
    speed_m_s: f32,
    acquiring: AcquisitionSettings,
    settings: BeliefSettings,
    acquisition: Option<Acquisition<ANCHORS>>,
    loss: LossMonitor,
}

impl<const ANCHORS: usize> TagBelief<ANCHORS> {
    /// The tag is somewhere around the prior. `speed_m_s` is the standard deviation per axis of a velocity that nothing is
    /// known of.
    #[inline(always)] // built where it stays
    pub fn new(
        motion: Motion,
        speed_m_s: f32,
        prior: Agent,
        acquiring: AcquisitionSettings,
        settings: BeliefSettings,
    ) -> Self {
        let acquisition = Some(Acquisition::new(prior, speed_m_s * speed_m_s, acquiring));
        Self { motion, speed_m_s, acquiring, settings, acquisition, loss: LossMonitor::default() }
    }

    /// Whether it is not known (yet, or any more) where the tag is.
    pub fn is_acquiring(&self) -> bool {
        self.acquisition.is_some()
    }

    /// The places the tag may be at, while it is not known.
    pub fn acquisition(&self) -> Option<&Acquisition<ANCHORS>> {
        self.acquisition.as_ref()
    }

    /// Whether so much speaks against the place that the map must not be judged from it.
    pub fn is_doubtful(&self) -> bool {
        self.loss.is_doubtful(&self.settings)
    }

    /// Moves ahead by a step of the motion, `elapsed_s` seconds long.
    pub fn predict(&mut self, step: &MotionStep, elapsed_s: f32) {
        if let Some(acquisition) = &mut self.acquisition {
            acquisition.predict(step, self.motion.position_std_limit_m, elapsed_s);
        }
    }

    /// Where anything is heard again: after a gap too long for one Gaussian the tag is somewhere between where it was when it
    /// was `last_heard` and where its velocity would have brought it (`predicted`), and what its velocity was then says little
    /// of now.
    pub fn bridge(&mut self, last_heard: &Agent, predicted: &Agent) {
        let Agent { mean: from, .. } = last_heard;
        let Agent { mean: to, covariance: c } = predicted;
        if self.acquisition.is_some() || !LossMonitor::is_too_wide(c.m11, c.m22) {
            return;
        }
        let reach = self.motion.position_std_limit_m;
        let (dx, dy) = (to.x - from.x, to.y - from.y);
        let within = |variance_m2: f32| smaller(variance_m2, reach * reach);
        let speed_m2_s2 = self.speed_m_s * self.speed_m_s;
        self.lose(
            [from.x, from.y],
            [within(c.m11 + dx * dx), within(c.m22 + dy * dy)],
            [speed_m2_s2 + from.z * from.z, speed_m2_s2 + from.w * from.w],
        );
    }

    /// Gives the tag up: from now on it may be anywhere around this position, with these variances of position and
    /// velocity.
    fn lose(&mut self, position_m: [f32; 2], position_m2: [f32; 2], velocity_m2_s2: [f32; 2]) {
        let ([x, y], [xx, yy], [uu, vv]) = (position_m, position_m2, velocity_m2_s2);
        let prior = Agent {
            mean: Vector4::new(x, y, 0.0, 0.0),
            covariance: Matrix4::from_diagonal(&Vector4::new(xx, yy, uu, vv)),
        };
        self.loss = LossMonitor::default();
        self.acquisition = Some(Acquisition::new(prior, self.speed_m_s * self.speed_m_s, self.acquiring));
    }

    /// While it is not known where the tag is: weighs the places it may be at by one cycle's sweeps (see
    /// [`Acquisition::observe`]). Returns where it is taken to be now, if there was anything to weigh them by; once only one
    /// place is left, it is known again.
    pub fn locate<'a, L: Iterator<Item = Landmark> + Clone>(
        &mut self,
        sweeps: impl Iterator<Item = (usize, Sweep<'a>)> + Clone,
        landmarks: impl Fn(usize) -> L,
        inside: impl Fn([f32; 2], f32) -> f32,
    ) -> Option<Agent> {
        let acquisition = self.acquisition.as_mut()?;
        if !acquisition.observe(sweeps, landmarks, inside) {
            return None;
        }
        match acquisition.settled() {
            Some(agent) => {
                self.acquisition = None;
                Some(agent)
            }
            None => Some(acquisition.summary()),
        }
    }

    /// While it is known where the tag is, enters the evidence of a cycle for that place; whether it turns out to be
    /// elsewhere. `agent` is where it was believed to be.
    pub fn watch(&mut self, evidence_nat: f32, agent: Agent) -> bool {
        if self.acquisition.is_some() {
            return false;
        }
        self.loss.observe(evidence_nat);
        if !self.loss.is_lost(&self.settings) {
            return false;
        }
        let (reach, speed) = (self.motion.position_std_limit_m, self.speed_m_s);
        self.lose([agent.mean.x, agent.mean.y], [reach * reach; 2], [speed * speed; 2]);
        if let Some(acquisition) = &mut self.acquisition {
            acquisition.suggest(agent);
        }
        true
    }

    /// The state of the loss monitor, for traces.
    pub fn visit_loss(&self, f: impl FnMut(f32)) {
        self.loss.visit(f);
    }
}
