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
use cogmint_core::model::detection::detection_probability;
use cogmint_core::model::observation::Samples;
use cogmint_core::perceptor::channel_estimator::ChannelEstimator;

use rayon::prelude::*;

/// The actions of a cycle: one for all anchors, or one for each.
pub type Actions = Vec<usize>;

/// The action that an anchor gets.
pub fn action_of(actions: &[usize], anchor: usize) -> usize {
    actions[if actions.len() == 1 { 0 } else { anchor }]
}

/// Information about the position, per cycle, anchor and action.
#[derive(Clone, Debug)]
pub struct Truth {
    informations: Vec<Vec<Vec<Information>>>,
    elapsed_s: Vec<f64>,
    acceleration_density_m2_s3: f64,
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
                let estimator = ChannelEstimator::<PATHS>::new(
                    radio.pulse(action),
                    radio.sample_spacing_s,
                    radio.samples_per_frame,
                    radio.false_paths_per_frame,
                    setup.config.estimator,
                );
                estimator.threshold(&Samples::Complex(&[]))
            })
            .collect();
        let informations = (0..simulator.cycles())
            .into_par_iter()
            .map(|cycle| {
                let found = |action: usize, sinr: f64| {
                    f64::from(detection_probability(sinr as f32, thresholds[action]))
                };
                let anchors = 0..channel.scenario().anchors.len();
                anchors.map(|anchor| information_found(channel, cycle, anchor, found)).collect()
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
            acceleration_density_m2_s3: f64::from(setup.config.motion.acceleration_density_m2_s3),
            start: Posterior::new(f64::from(start.position_std_m), f64::from(start.velocity_std_m_s)),
        }
    }

    /// Number of cycles.
    pub fn cycles(&self) -> usize {
        self.informations.len()
    }

    /// Information about the position in a cycle with these actions.
    fn information(&self, cycle: usize, actions: &[usize]) -> Information {
        let mut sum = [0.0; 3];
        for (anchor, informations) in self.informations[cycle].iter().enumerate() {
            let own = informations[action_of(actions, anchor)];
            (0..3).for_each(|n| sum[n] += own[n]);
        }
        sum
    }

    /// Entropy of the position after each cycle, nats, given the actions.
    pub fn entropies_nat(&self, actions: &[Actions]) -> Vec<f64> {
        let mut posterior = self.start;
        let mut entropy = |(cycle, actions): (usize, &Actions)| {
            posterior.predict(self.elapsed_s[cycle], self.acceleration_density_m2_s3);
            posterior.update(self.information(cycle, actions));
            posterior.position_entropy_nat()
        };
        actions.iter().enumerate().map(&mut entropy).collect()
    }

    /// The genie's actions, the same for all anchors: in every cycle the one that leaves least entropy, the first of equals.
    pub fn genie(&self) -> Vec<Actions> {
        self.decide(|posterior, cycle| {
            let mut actions = vec![0];
            self.improve(posterior, cycle, &mut actions, 0);
            actions
        })
    }

    /// Those of a genie who tunes every anchor by itself: from its common choice, one anchor after the other, until none
    /// leaves less entropy. An action for each anchor that no other one betters.
    pub fn genie_per_anchor(&self) -> Vec<Actions> {
        self.decide(|posterior, cycle| {
            let mut common = vec![0];
            self.improve(posterior, cycle, &mut common, 0);
            let mut actions = vec![common[0]; self.informations[cycle].len()];
            loop {
                let before = actions.clone();
                (0..actions.len()).for_each(|place| self.improve(posterior, cycle, &mut actions, place));
                if actions == before {
                    return actions;
                }
            }
        })
    }

    /// Puts the action into `place` that leaves least entropy; what is there stays unless another is better.
    fn improve(&self, posterior: &Posterior, cycle: usize, actions: &mut [usize], place: usize) {
        let entropy_nat = |actions: &[usize]| {
            let mut after = *posterior;
            after.update(self.information(cycle, actions));
            after.position_entropy_nat()
        };
        let mut best = (entropy_nat(actions), actions[place]);
        for action in 0..self.informations[cycle].first().map_or(0, Vec::len) {
            actions[place] = action;
            let entropy_nat = entropy_nat(actions);
            if entropy_nat < best.0 {
                best = (entropy_nat, action);
            }
        }
        actions[place] = best.1;
    }

    /// What `choose` takes in every cycle, from the bound as it is predicted.
    fn decide(&self, choose: impl Fn(&Posterior, usize) -> Actions) -> Vec<Actions> {
        let mut posterior = self.start;
        let mut all = Vec::new();
        for cycle in 0..self.cycles() {
            posterior.predict(self.elapsed_s[cycle], self.acceleration_density_m2_s3);
            let actions = choose(&posterior, cycle);
            posterior.update(self.information(cycle, &actions));
            all.push(actions);
        }
        all
    }
}
