//! How strong an interferer is: its power, and what that leaves of the paths in use.

use crate::channel::{Channel, REFERENCE_HZ, friis, power_of};
use crate::input_error::InputError;
use crate::scenario::{Interference, Scenario};
use std::path::Path;

/// Cycles that the median is taken over, at most.
const SAMPLED_CYCLES: usize = 200;
/// SINR from which on a path counts as used, as where a scenario states an interferer's strength.
const USED_SINR: f64 = 3.0;

/// An interferer's strength at its weakest, and what any other power would leave.
#[derive(Clone, Debug)]
pub struct Strength {
    /// Omega_1 at its weakest, a power gain.
    pub omega_1: f64,
    /// Per path in use: disturbance without the interferer and what its weakest adds, both over the path's power.
    paths: Vec<[f64; 2]>,
}

impl Strength {
    /// The strength that `interference` has on the first way of a scenario.
    ///
    /// # Errors
    /// The scenario cannot be simulated, or no strength leaves the SINR that it states.
    pub fn new(
        scenario: &Scenario,
        folder: Option<&Path>,
        interference: &Interference,
    ) -> Result<Self, InputError> {
        let clean = Channel::new(scenario, folder, 0, None)?;
        let mut disturbed = scenario.clone();
        disturbed.interference.push(interference.clone());
        let disturbed = Channel::new(&disturbed, folder, 0, None)?;
        let carriers = clean.receiver().actions.iter().map(|action| action.carrier_hz);
        let distances = carriers.map(|carrier_hz| (carrier_hz - interference.carrier_hz).abs());
        let nearest = distances.enumerate().min_by(|(_, a), (_, b)| a.total_cmp(b));
        let action = nearest.map_or(0, |(action, _)| action);
        let cycles = clean.cycles_of(interference.during);
        let every = cycles.len().div_ceil(SAMPLED_CYCLES).max(1);
        let reached: Vec<usize> = scenario
            .anchors
            .iter()
            .enumerate()
            .filter(|(_, one)| interference.anchors.is_empty() || interference.anchors.contains(&one.name))
            .map(|(anchor, _)| anchor)
            .collect();
        let mut paths = Vec::new();
        for cycle in cycles.step_by(every) {
            for &anchor in &reached {
                let before = clean.components(cycle, anchor, action);
                let after = disturbed.components(cycle, anchor, action);
                let pairs = before.iter().zip(&after).filter(|(before, _)| before.sinr >= USED_SINR);
                paths.extend(
                    pairs.map(|(before, after)| [1.0 / before.sinr, 1.0 / after.sinr - 1.0 / before.sinr]),
                );
            }
        }
        // The channel tells it over the direct path of 1 m.
        let over_direct_path = disturbed.interference_omega_1().last().copied().unwrap_or(0.0);
        Ok(Self { omega_1: over_direct_path * direct_path_gain(), paths })
    }

    /// Median SINR of the paths in use beside an interferer `power_db` above the weakest, dB; none where no path is.
    pub fn median_sinr_db(&self, power_db: f64) -> Option<f64> {
        let power = power_of(power_db);
        let mut sinrs: Vec<f64> = self.paths.iter().map(|[other, own]| 1.0 / (other + power * own)).collect();
        sinrs.sort_by(f64::total_cmp);
        Some(10.0 * sinrs.get(sinrs.len() / 2)?.log10())
    }

    /// Omega_1 at its weakest over the power of a direct path of 1 m, both at 7 GHz, dB.
    pub fn over_direct_path_db(&self) -> f64 {
        10.0 * (self.omega_1 / direct_path_gain()).log10()
    }

    /// Omega_1 of an interferer `power_db` above the weakest, a power gain.
    pub fn omega_1_at(&self, power_db: f64) -> f64 {
        self.omega_1 * power_of(power_db)
    }
}

/// Power gain of a direct path of 1 m.
fn direct_path_gain() -> f64 {
    friis(1.0, REFERENCE_HZ)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::demo;

    #[test]
    fn power_and_median_sinr_are_those_of_the_channel() {
        let (scenario, _) = Scenario::find("seminar-room").expect("is built in");
        let weak = Strength::new(&scenario, None, &demo::interferer(7.0)).expect("there is such a power");
        let strong = Strength::new(&scenario, None, &demo::interferer(0.0)).expect("there is such a power");
        let left_db = |power_db| weak.median_sinr_db(power_db).expect("paths are in use");
        assert!((left_db(0.0) - 7.0).abs() < 0.05, "{}", left_db(0.0));
        let apart_db = 10.0 * (strong.omega_1 / weak.omega_1).log10();
        assert!((left_db(apart_db) - 0.0).abs() < 0.05, "{} at {apart_db} dB", left_db(apart_db));
        // Noise and the room's own multipath take their part: more than 7 dB are needed.
        assert!(apart_db > 7.3, "{apart_db}");
        assert!((weak.omega_1_at(apart_db) / strong.omega_1 - 1.0).abs() < 1e-9);
    }
}
