//! Belief: whether it is known where the tag is, and if not, where it may be.

use super::acquisition::{Acquisition, Sweep};
use super::loss::LossMonitor;
use super::motion::{Agent, MotionStep, PX, PY, VX, VY};
use super::plan::FloorPlan;
use super::real::{Real, smaller, square};
use super::zeros;
use cogmint_core::Config;
use cogmint_core::perceptor::belief::acquisition::AcquisitionSettings;
use cogmint_core::perceptor::belief::loss::BeliefSettings;

/// The belief.
#[derive(Clone, Debug)]
pub struct Belief<T> {
    position_std_limit_m: T,
    acquiring: AcquisitionSettings,
    settings: BeliefSettings,
    /// Variance of a velocity of which nothing is known, per axis.
    speed_m2_s2: T,
    anchors: usize,
    /// Places the tag may be at, while it is not known where it is.
    pub acquisition: Option<Acquisition<T>>,
    /// Whether it is where it is believed to be.
    pub loss: LossMonitor<T>,
}

impl<T: Real> Belief<T> {
    /// The tag is somewhere around the prior.
    pub fn new(config: &Config, prior: Agent<T>, anchors: usize) -> Self {
        let speed_m2_s2 = square(T::of(config.start.velocity_std_m_s));
        let (acquiring, settings) = (config.acquisition, config.belief);
        let acquisition = Some(Acquisition::new(prior, speed_m2_s2, anchors, acquiring));
        let position_std_limit_m = T::of(config.motion.position_std_limit_m);
        let loss = LossMonitor::new();
        Self { position_std_limit_m, acquiring, settings, speed_m2_s2, anchors, acquisition, loss }
    }

    /// Whether it is not known where the tag is.
    pub fn is_acquiring(&self) -> bool {
        self.acquisition.is_some()
    }

    /// The map must not be judged from where the tag is believed to be.
    pub fn is_doubtful(&self) -> bool {
        self.loss.is_doubtful(&self.settings)
    }

    /// A step of `dt` seconds later.
    pub fn predict(&mut self, step: &MotionStep<T>, dt: T) {
        if let Some(acquisition) = &mut self.acquisition {
            acquisition.predict(step, self.position_std_limit_m, dt);
        }
    }

    /// Something is heard. After a gap the tag is between where it was last heard and where its velocity would have brought it.
    pub fn bridge(&mut self, last: &Agent<T>, predicted: &Agent<T>) {
        let c = &predicted.covariance;
        if self.acquisition.is_none() && LossMonitor::is_too_wide(c[PX][PX], c[PY][PY]) {
            let reach = self.position_std_limit_m;
            let position_m2 = [PX, PY].map(|p| {
                let way = predicted.mean[p] - last.mean[p];
                smaller(c[p][p] + square(way), square(reach))
            });
            let velocity_m2_s2 = [VX, VY].map(|v| self.speed_m2_s2 + square(last.mean[v]));
            self.lose([last.mean[PX], last.mean[PY]], position_m2, velocity_m2_s2);
        }
    }

    /// From now on the tag may be anywhere around a position; variances of position and velocity per axis.
    fn lose(&mut self, position_m: [T; 2], position_m2: [T; 2], velocity_m2_s2: [T; 2]) {
        let mut prior = Agent { mean: vec![T::ZERO; 4], covariance: zeros(4, 4) };
        for (axis, (p, v)) in [(PX, VX), (PY, VY)].into_iter().enumerate() {
            prior.mean[p] = position_m[axis];
            prior.covariance[p][p] = position_m2[axis];
            prior.covariance[v][v] = velocity_m2_s2[axis];
        }
        self.loss = LossMonitor::new();
        self.acquisition = Some(Acquisition::new(prior, self.speed_m2_s2, self.anchors, self.acquiring));
    }

    /// Weighs the places the tag may be at; where it is taken to be, if anything was heard. Once there is only one place, it is
    /// there.
    pub fn locate(&mut self, sweeps: &[Sweep<T>], plan: &FloorPlan<T>) -> Option<Agent<T>> {
        let acquisition = self.acquisition.as_mut()?;
        if !acquisition.observe(sweeps, plan) {
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

    /// Enters a cycle's evidence that the tag is where it is believed to be; true where it must be elsewhere.
    pub fn watch(&mut self, evidence_nat: T, believed: &Agent<T>) -> bool {
        if self.is_acquiring() {
            return false;
        }
        self.loss.observe(evidence_nat);
        let lost = self.loss.is_lost(&self.settings);
        if lost {
            let reach = self.position_std_limit_m;
            let position_m = [believed.mean[PX], believed.mean[PY]];
            self.lose(position_m, [square(reach); 2], [self.speed_m2_s2; 2]);
            if let Some(acquisition) = &mut self.acquisition {
                acquisition.suggest(believed.clone());
            }
        }
        lost
    }
}
