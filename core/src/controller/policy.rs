//! Policy: from values to a choice.
//!
//! The published recursion pi <- pi exp(dJ / tau) telescopes to softmax(J / tau), which is computed directly:
//! nothing accumulates and no action's probability dies. A floor of 1e-3 / |C| keeps every action alive.

use super::value::ActionValues;
use crate::model::clock::probability;
use crate::radio::library::Allowed;
use crate::real::{exp, larger, ln};
use crate::snapshot::written;
use rand_core::Rng;

/// Tuned: against turns too short to settle on a place: cycles that a turn of the search for a lost tag has at least: what it takes to settle on a place.
pub const LEAST_TURN_CYCLES: u32 = 15;

/// How the next action is drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Choice {
    /// Temperature tau of the softmax, nats (1e-3 to 100): smaller is greedier.
    pub temperature_nat: f32,
    /// How often an action drawn from the policy is tried for one cycle instead of the best one, per second (0 to 1000).
    pub exploration_per_s: f32,
    /// The best action replaces the present one only if it is worth this much more, nats.
    pub hysteresis_nat: f32,
    /// Time for which a lost tag is looked for with the best action, and then as long with one drawn from the others, in turn,
    /// seconds (0 to 1e6), but no less than [`LEAST_TURN_CYCLES`]; 0: always with the best.
    pub patience_s: f32,
}

/// pi = softmax(J / tau) with a floor, over the actions allowed; zero for the rest.
pub fn policy<const ACTIONS: usize>(
    values: &ActionValues<ACTIONS>,
    allowed: &Allowed<ACTIONS>,
    temperature: f32,
) -> [f32; ACTIONS] {
    let most = values.get(values.best(allowed));
    let mut probabilities = [0.0; ACTIONS];
    let (mut sum, mut count) = (0.0, 0.0);
    for ((p, value), _) in probabilities.iter_mut().zip(values.values()).zip(allowed).filter(is_allowed) {
        *p = exp((value - most) / temperature);
        sum += *p;
        count += 1.0;
    }
    let floor = 1e-3 / larger(count, 1.0);
    let scale = (1.0 - 1e-3) / larger(sum, 1e-30);
    for (p, _) in probabilities.iter_mut().zip(allowed).filter(is_allowed) {
        *p = *p * scale + floor;
    }
    probabilities
}

/// Whether the second of a pair says so.
fn is_allowed<T>((_, allowed): &(T, &bool)) -> bool {
    **allowed
}

/// A uniform number in (0, 1].
pub fn uniform(rng: &mut impl Rng) -> f32 {
    ((rng.next_u32() >> 8) as f32 + 1.0) / 16_777_216.0
}

/// `wanted` distinct actions (two at least) drawn without replacement, half from the policy and half from all alike, so that
/// none is without a fresh plan for long; `keep` always among them.
///
/// Exponential race: the smallest -ln(u) / (pi + 1 / count) win, which has the distribution of successive draws.
pub fn planned_set<const ACTIONS: usize>(
    policy: &[f32; ACTIONS],
    allowed: &Allowed<ACTIONS>,
    wanted: usize,
    keep: [usize; 2],
    rng: &mut impl Rng,
) -> [bool; ACTIONS] {
    let any = 1.0 / larger(allowed.iter().filter(|allowed| **allowed).count() as f32, 1.0);
    let mut arrival = [f32::INFINITY; ACTIONS];
    let draws = arrival.iter_mut().zip(policy).enumerate().zip(allowed).filter(is_allowed);
    for ((action, (time, &p)), _) in draws {
        *time = -ln(uniform(rng)) / (p + any);
        if keep.contains(&action) {
            *time = -1.0;
        }
    }
    let mut chosen = [false; ACTIONS];
    for _ in 0..wanted.max(keep.len()) {
        let mut earliest = (usize::MAX, f32::INFINITY);
        for (action, &time) in arrival.iter().enumerate() {
            if time < earliest.1 {
                earliest = (action, time);
            }
        }
        match (chosen.get_mut(earliest.0), arrival.get_mut(earliest.0)) {
            (Some(flag), Some(time)) => {
                *flag = true;
                *time = f32::INFINITY;
            }
            _ => break,
        }
    }
    chosen
}

/// The action to hold: the one worth most, but the present one where that is not worth enough more.
pub fn settle<const ACTIONS: usize>(
    values: &ActionValues<ACTIONS>,
    allowed: &Allowed<ACTIONS>,
    present: usize,
    choice: &Choice,
) -> usize {
    let best = values.best(allowed);
    if values.get(best) > values.get(present) + choice.hysteresis_nat { best } else { present }
}

/// An action drawn from all that are allowed but one, all alike; `None` where there is no other.
pub fn draw_other<const ACTIONS: usize>(
    allowed: &Allowed<ACTIONS>,
    one: usize,
    rng: &mut impl Rng,
) -> Option<usize> {
    let others = || allowed.iter().enumerate().filter(|(action, allowed)| **allowed && *action != one);
    let drawn = rng.next_u32().checked_rem(others().count() as u32)?;
    others().nth(drawn as usize).map(|(action, _)| action)
}

/// An action to try for one cycle of `elapsed_s` seconds, now and then: one drawn from the policy.
pub fn explore<const ACTIONS: usize>(
    policy: &[f32; ACTIONS],
    allowed: &Allowed<ACTIONS>,
    choice: &Choice,
    elapsed_s: f32,
    rng: &mut impl Rng,
) -> Option<usize> {
    if uniform(rng) > probability(choice.exploration_per_s, elapsed_s) {
        return None;
    }
    let mut left = uniform(rng);
    for ((action, &p), _) in policy.iter().enumerate().zip(allowed).filter(is_allowed) {
        left -= p;
        if left <= 0.0 {
            return Some(action);
        }
    }
    None
}

written!(Choice { temperature_nat, exploration_per_s, hysteresis_nat, patience_s });

#[cfg(test)]
mod tests {
    use super::*;
    use crate::controller::value::Learning;
    use rand_core::SeedableRng;
    use rand_xoshiro::Xoshiro128PlusPlus;

    const LEARNING: Learning = Learning { rate: 1.0, experience_rate: 0.1, discount: 0.5, bootstrap: false };

    #[test]
    fn the_policy_sums_to_one_and_no_action_dies() {
        let mut values = ActionValues::<8>::default();
        values.learn(3, 500.0, &[0.125; 8], &LEARNING);
        let allowed = [true, true, true, true, true, true, false, false];
        let pi = policy(&values, &allowed, 0.1);
        assert!((pi.iter().sum::<f32>() - 1.0).abs() < 1e-6);
        assert!(pi[..6].iter().all(|&p| p > 1e-4) && pi[6] == 0.0 && pi[3] > 0.99);
    }

    #[test]
    fn the_planned_set_has_the_size_asked_for_and_keeps_the_incumbents() {
        let mut rng = Xoshiro128PlusPlus::seed_from_u64(7);
        let values = ActionValues::<40>::default();
        let pi = policy(&values, &[true; 40], 0.1);
        let mut drawn = [0_u32; 40];
        for _ in 0..4000 {
            let set = planned_set(&pi, &[true; 40], 20, [5, 9], &mut rng);
            assert!(set[5] && set[9] && set.iter().filter(|&&b| b).count() == 20);
            set.iter().zip(&mut drawn).for_each(|(&b, n)| *n += u32::from(b));
        }
        for (action, &n) in drawn.iter().enumerate() {
            if action != 5 && action != 9 {
                assert!((f64::from(n) / 4000.0 - 18.0 / 38.0).abs() < 0.04, "{action}: {n}");
            }
        }
    }

    #[test]
    fn hysteresis_holds_the_present_action_and_exploration_leaves_it() {
        let mut rng = Xoshiro128PlusPlus::seed_from_u64(7);
        let mut values = ActionValues::<4>::default();
        values.learn(2, 0.04, &[0.25; 4], &LEARNING);
        let all = [true; 4];
        let pi = policy(&values, &all, 0.1);
        let still =
            Choice { temperature_nat: 0.1, exploration_per_s: 0.0, hysteresis_nat: 0.05, patience_s: 0.0 };
        assert_eq!(settle(&values, &all, 0, &still), 0);
        assert_eq!(explore(&pi, &all, &still, 0.1, &mut rng), None);
        let keen = Choice { hysteresis_nat: 0.0, ..still };
        assert_eq!(settle(&values, &all, 0, &keen), 2);
        let curious = Choice { exploration_per_s: 1e3, ..still };
        let mut seen = [false; 4];
        for _ in 0..200 {
            if let Some(action) = explore(&pi, &all, &curious, 0.1, &mut rng) {
                seen[action] = true;
            }
        }
        assert_eq!(seen, [true; 4]);
    }

    #[test]
    fn another_action_is_any_that_is_allowed_but_the_one() {
        let mut rng = Xoshiro128PlusPlus::seed_from_u64(7);
        let mut drawn = [0_u32; 5];
        for _ in 0..3000 {
            drawn[draw_other(&[true, true, false, true, true], 1, &mut rng).unwrap()] += 1;
        }
        assert!(drawn[1] == 0 && drawn[2] == 0, "{drawn:?}");
        assert!([0, 3, 4].into_iter().all(|action| (900..1100).contains(&drawn[action])), "{drawn:?}");
        assert_eq!(draw_other(&[false, true], 1, &mut rng), None);
    }
}
