//! What every action would have told, from the simulator's own knowledge: the yardstick of all controllers.
//!
//! In cycle n, action c tells of the position I_n(c), the information of all paths, each weighed with the probability
//! that the channel estimator finds it (of a path below the threshold nothing is learned, however good its bound). The
//! posterior Cramer-Rao bound carries that through the tracker's motion model. A controller's entropy is that of the
//! bound after the actions it chose; the genie takes the action that leaves least entropy, cycle by cycle.

use crate::bound::posterior::Posterior;
use crate::bound::{Information, information_found};
use crate::replay::{PATHS, Setup};
use crate::simulator::Simulator;
use cogmint_core::perceptor::association::detection_probability;
use cogmint_core::perceptor::channel_estimator::ChannelEstimator;
use cogmint_core::pulse::Pulse;

use rayon::prelude::*;

/// Information about the position, per cycle and action.
#[derive(Clone, Debug)]
pub struct Truth {
    informations: Vec<Vec<Information>>,
    elapsed_s: Vec<f64>,
    acceleration_std_m_s2: f64,
    start: Posterior,
}

impl Truth {
    /// Looks at every cycle and action of a simulation.
    pub fn new(simulator: &Simulator, setup: &Setup) -> Self {
        let channel = simulator.channel();
        let radio = &setup.config.radio;
        let thresholds: Vec<f32> = setup
            .actions
            .iter()
            .map(|action| {
                let pulse = Pulse { duration_s: action.pulse_duration_s, shape: radio.pulse_shape };
                let estimator = ChannelEstimator::<PATHS>::new(
                    pulse,
                    radio.sample_spacing_s,
                    radio.samples_per_frame,
                    radio.false_paths_per_frame,
                );
                estimator.threshold()
            })
            .collect();
        let informations = (0..simulator.cycles())
            .into_par_iter()
            .map(|cycle| {
                let found = |action: usize, sinr: f64| {
                    f64::from(detection_probability(sinr as f32, thresholds[action]))
                };
                information_found(channel, cycle, found)
            })
            .collect();
        let start = &setup.config.start;
        let poses = channel.poses();
        Self {
            informations,
            elapsed_s: (0..simulator.cycles())
                .map(|cycle| {
                    cycle.checked_sub(1).map_or(1e-3, |last| poses[cycle].time_s - poses[last].time_s)
                })
                .collect(),
            acceleration_std_m_s2: f64::from(setup.config.motion.acceleration_std_m_s2),
            start: Posterior::new(f64::from(start.position_std_m), f64::from(start.velocity_std_m_s)),
        }
    }

    /// Number of cycles.
    pub fn cycles(&self) -> usize {
        self.informations.len()
    }

    /// Entropy of the position after each cycle, nats, given the actions.
    pub fn entropies_nat(&self, actions: &[usize]) -> Vec<f64> {
        let mut posterior = self.start;
        let mut entropy = |(cycle, &action): (usize, &usize)| {
            posterior.predict(self.elapsed_s[cycle], self.acceleration_std_m_s2);
            posterior.update(self.informations[cycle][action]);
            posterior.position_entropy_nat()
        };
        actions.iter().enumerate().map(&mut entropy).collect()
    }

    /// The genie's actions: in every cycle the one that leaves least entropy, the first of equals.
    pub fn genie(&self) -> Vec<usize> {
        let mut posterior = self.start;
        let mut actions = Vec::new();
        for cycle in 0..self.cycles() {
            posterior.predict(self.elapsed_s[cycle], self.acceleration_std_m_s2);
            let mut best: Option<(f64, usize, Posterior)> = None;
            for (action, information) in self.informations[cycle].iter().enumerate() {
                let mut after = posterior;
                after.update(*information);
                let entropy_nat = after.position_entropy_nat();
                if best.as_ref().is_none_or(|(least, ..)| entropy_nat < *least) {
                    best = Some((entropy_nat, action, after));
                }
            }
            if let Some((_, action, after)) = best {
                posterior = after;
                actions.push(action);
            }
        }
        actions
    }
}
