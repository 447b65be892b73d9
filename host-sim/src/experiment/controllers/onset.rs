//! How soon a controller answers an interferer that appears, in one band or another.
//!
//! After every onset there is a gain to be reached: the genie's over the carrier that the interferer took, held all the
//! way. That is what there is to lose by staying where it transmits, whichever carrier the run's fixed one is: once an
//! interferer has left the fixed carrier, a gain over that says nothing.
//!
//! A controller that is somewhere else already has nothing to answer. So the runs count in which it was hit; where none
//! was, all do, and the answer is at once if it is as good as the genie there.

use super::truth::Actions;
use super::{Comparison, Controller, Run};
use crate::channel::Channel;
use crate::scenario::Interference;
use serde::Serialize;
use std::ops::Range;

/// Cycles that the gain after an onset is averaged over.
const SMOOTHED: usize = 5;
/// Share of the reachable gain that counts as reached.
const REACHED: f64 = 0.9;

/// When and where an interferer begins in a run.
#[derive(Clone, Debug)]
pub struct Onset {
    /// The first cycle.
    pub cycle: usize,
    /// The cycle at which the next one begins, or interference ends.
    pub until: usize,
    /// Which actions are hit: those whose carrier is within half of its bandwidth of that of one that begins here.
    pub hits: Vec<bool>,
    /// Entropy of the position after each cycle with the action nearest to the first of them held all the way, nats.
    pub held_nat: Vec<f64>,
}

/// How soon a controller had answered.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Answer {
    /// The onset's cycle, in the first run.
    pub cycle: usize,
    /// Runs whose action was hit.
    pub runs_hit: usize,
    /// Cycles from the onset until 90 % of the genie's gain over the carrier that was taken, by the mean of these runs (of
    /// all where none was hit) over five cycles; none where that is not reached until the next onset or the end.
    pub cycles_to_90_percent: Option<usize>,
}

/// The onsets in a channel, one per cycle in which any interferer begins; `entropies_nat` follows given actions.
pub fn onsets(channel: &Channel, entropies_nat: impl Fn(&[Actions]) -> Vec<f64>) -> Vec<Onset> {
    let mut interferers: Vec<(Range<usize>, &Interference)> = channel
        .scenario()
        .interference
        .iter()
        .map(|interferer| (channel.cycles_of(interferer.during), interferer))
        .filter(|(cycles, _)| !cycles.is_empty())
        .collect();
    interferers.sort_by_key(|(cycles, _)| cycles.start);
    let end = interferers.iter().map(|(cycles, _)| cycles.end).max().unwrap_or(0);
    let mut begins: Vec<usize> = interferers.iter().map(|(cycles, _)| cycles.start).collect();
    begins.dedup();
    let actions = &channel.receiver().actions;
    let distance_hz = |action: usize, one: &Interference| (actions[action].carrier_hz - one.carrier_hz).abs();
    let onset = |(index, &cycle): (usize, &usize)| {
        let own: Vec<&Interference> =
            interferers.iter().filter(|(cycles, _)| cycles.start == cycle).map(|(_, one)| *one).collect();
        let is_hit = |action| own.iter().any(|one| distance_hz(action, one) <= 0.5 / one.pulse_duration_s);
        let distance = |action: usize| own.first().map_or(0.0, |one| distance_hz(action, one));
        let nearest = (0..actions.len()).min_by(|&a, &b| distance(a).total_cmp(&distance(b)));
        Onset {
            cycle,
            until: begins.get(index + 1).copied().unwrap_or(end),
            hits: (0..actions.len()).map(is_hit).collect(),
            held_nat: entropies_nat(&vec![vec![nearest.unwrap_or(0)]; channel.poses().len()]),
        }
    };
    begins.iter().enumerate().map(onset).collect()
}

/// A controller's answers to all onsets, which must be as many in every run.
pub fn answers(controller: Controller, comparisons: &[Comparison]) -> Vec<Answer> {
    let count = comparisons.iter().map(|one| one.onsets.len()).min().unwrap_or(0);
    (0..count).filter_map(|index| answer(controller, index, comparisons)).collect()
}

/// The slowest of all answers; none where one never came, or without onsets.
pub fn slowest(answers: &[Answer]) -> Option<usize> {
    let cycles: Option<Vec<usize>> = answers.iter().map(|answer| answer.cycles_to_90_percent).collect();
    cycles?.into_iter().max()
}

fn answer(controller: Controller, index: usize, comparisons: &[Comparison]) -> Option<Answer> {
    let all: Vec<(&Onset, &Run, &Run)> = comparisons
        .iter()
        .filter_map(|one| Some((one.onsets.get(index)?, one.of(controller)?, one.of(Controller::Genie)?)))
        .collect();
    let cycle = all.first()?.0.cycle;
    let is_hit = |(onset, own, _): &&(&Onset, &Run, &Run)| {
        let in_use = own.actions.get(onset.cycle.saturating_sub(1));
        in_use.is_some_and(|actions| actions.iter().any(|&action| onset.hits.get(action) == Some(&true)))
    };
    let hit: Vec<(&Onset, &Run, &Run)> = all.iter().filter(is_hit).copied().collect();
    let runs_hit = hit.len();
    let counted = if hit.is_empty() { all } else { hit };
    // Gains after the onset, cycle by cycle, summed over the runs: their own, and what is reachable.
    let length = counted.iter().map(|(onset, ..)| onset.until.saturating_sub(onset.cycle)).min()?;
    let gains: Vec<[f64; 2]> = (0..length)
        .map(|after| {
            let mut sums = [0.0; 2];
            for (onset, own, genie) in &counted {
                let held_nat = onset.held_nat[onset.cycle + after];
                sums[0] += held_nat - own.entropies_nat[onset.cycle + after];
                sums[1] += held_nat - genie.entropies_nat[onset.cycle + after];
            }
            sums
        })
        .collect();
    let cycles_to_90_percent = gains.windows(SMOOTHED).position(|window| {
        let sum = |which: usize| window.iter().map(|gains| gains[which]).sum::<f64>();
        sum(0) >= REACHED * sum(1)
    });
    Some(Answer { cycle, runs_hit, cycles_to_90_percent })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::demo;
    use crate::experiment::survival::strength::Strength;
    use crate::scenario::Scenario;
    use crate::score::Score;

    fn run(controller: Controller, action: usize, entropy_nat: impl Fn(usize) -> f64) -> Run {
        Run {
            controller,
            actions: vec![vec![action]; 40],
            entropies_nat: (0..40).map(entropy_nat).collect(),
            score: Score::default(),
        }
    }

    /// Forty cycles; interference begins at cycle 10 where action 0 is, and moves in cycle 20 to action 1, until 30.
    fn comparison(action: usize, entropy_nat: impl Fn(usize) -> f64) -> Comparison {
        let held = |from: usize, until: usize| {
            (0..40).map(|cycle| if (from..until).contains(&cycle) { -1.0 } else { -5.0 }).collect()
        };
        let onset = |cycle, hits| Onset { cycle, until: cycle + 10, hits, held_nat: held(cycle, cycle + 10) };
        Comparison {
            seed: 1,
            interfered: 10..30,
            watched: None,
            onsets: vec![onset(10, vec![true, false]), onset(20, vec![false, true])],
            runs: vec![run(Controller::Greedy, action, entropy_nat), run(Controller::Genie, 0, |_| -5.0)],
        }
    }

    #[test]
    fn every_onset_has_its_answer_and_the_slowest_counts() {
        // Three cycles without gain after the first onset, four after the second.
        let entropy_nat = |cycle| if matches!(cycle, 10..=12 | 20..=23) { -1.0 } else { -5.0 };
        let given = answers(Controller::Greedy, &[comparison(0, entropy_nat)]);
        let expected = [(10, 1, Some(3)), (20, 0, Some(4))];
        let told: Vec<_> = given.iter().map(|a| (a.cycle, a.runs_hit, a.cycles_to_90_percent)).collect();
        assert_eq!(told, expected);
        assert_eq!(slowest(&given), Some(4));
        // Half of the gain, or all of it in the last cycle of the first onset only, is too little.
        for reached_from in [19, 40] {
            let late = |cycle| if cycle < reached_from { -3.0 } else { -5.0 };
            let given = answers(Controller::Greedy, &[comparison(0, late)]);
            assert_eq!(given[0].cycles_to_90_percent, None, "from {reached_from}");
            assert_eq!(slowest(&given), None);
        }
        assert_eq!((answers(Controller::Greedy, &[]).len(), slowest(&[])), (0, None));
    }

    #[test]
    fn runs_that_are_not_hit_do_not_make_the_others_faster() {
        let slow = |cycle| if (20..26).contains(&cycle) { -1.0 } else { -5.0 };
        let hit = comparison(1, slow);
        let elsewhere = comparison(0, |_| -5.0);
        let mut all = vec![hit];
        all.extend(std::iter::repeat_n(elsewhere, 20));
        let given = answers(Controller::Greedy, &all)[1];
        assert_eq!((given.runs_hit, given.cycles_to_90_percent), (1, None));
        // The genie holds action 0, which the second onset leaves alone: there at once.
        let genie = answers(Controller::Genie, &all)[1];
        assert_eq!((genie.runs_hit, genie.cycles_to_90_percent), (0, Some(0)));
    }

    #[test]
    fn an_interferer_that_moves_begins_twice() {
        let (mut scenario, _) = Scenario::find("seminar-room").expect("is built in");
        scenario.interference.extend(demo::moving_interferer(-5.0, 6.22e9));
        let channel = Channel::new(&scenario, None, 0, None).expect("is simulated");
        let cycles: Vec<_> = scenario.interference.iter().map(|one| channel.cycles_of(one.during)).collect();
        assert_eq!(cycles, [350..550, 550..750]);
        // What is held is told by its number.
        let found = onsets(&channel, |actions| vec![actions[0][0] as f64]);
        let places: Vec<_> = found.iter().map(|onset| (onset.cycle, onset.until)).collect();
        assert_eq!(places, [(350, 550), (550, 750)]);
        let carrier_hz = |onset: &Onset| channel.receiver().actions[onset.held_nat[0] as usize].carrier_hz;
        assert!((carrier_hz(&found[0]) - 7e9).abs() < 1e6 && (carrier_hz(&found[1]) - 6.2e9).abs() < 1e6);
        for (action, carrier) in channel.receiver().actions.iter().enumerate() {
            assert_eq!(found[1].hits[action], carrier.carrier_hz < 7.21e9, "{}", carrier.carrier_hz);
        }
        // In both bands it leaves as much.
        let clean = Scenario { interference: Vec::new(), ..scenario.clone() };
        for interferer in &scenario.interference {
            let strength = Strength::new(&clean, None, interferer).expect("there is such a power");
            let left_db = strength.median_sinr_db(0.0).expect("paths are in use");
            assert!((left_db + 5.0).abs() < 0.1, "{left_db} dB at {} Hz", interferer.carrier_hz);
        }
    }
}
