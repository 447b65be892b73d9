//! Who chooses the next action: what all choosers see, and those that need no memory.

use super::truth::Actions;
use crate::channel::random::uniform;
use crate::replay::SizedTracker;
use cogmint_core::CycleReport;
use rand_core::SeedableRng;
use rand_xoshiro::Xoshiro128PlusPlus;

/// What a chooser sees after a cycle.
pub struct Seen<'a, const A: usize> {
    /// The tracker, with all its memories.
    pub tracker: &'a SizedTracker<A>,
    /// What the tracker made of the cycle.
    pub report: &'a CycleReport,
    /// Number of actions there are.
    pub actions: usize,
    /// Time to the next cycle, seconds.
    pub elapsed_s: f64,
    /// Height of the tag, metres.
    pub tag_height_m: f64,
}

/// Chooses the action of the next cycle.
pub trait Choose<const A: usize>: Send + Sync {
    /// An index below `seen.actions` for all anchors, or one for each.
    fn next(&mut self, seen: &Seen<'_, A>) -> Actions;

    /// Another one that would go on from here in the same way.
    fn again(&self) -> Box<dyn Choose<A>>;
}

/// The core's own choice; also the fixed carrier, where its controller does not plan.
#[derive(Clone)]
pub struct OfTheCore;

impl<const A: usize> Choose<A> for OfTheCore {
    fn next(&mut self, seen: &Seen<'_, A>) -> Actions {
        let tracker = seen.tracker;
        if !tracker.config().controller.per_anchor {
            return vec![seen.report.next_action];
        }
        let anchors = 0..tracker.anchors().len();
        anchors.filter_map(|anchor| Some(tracker.controller_of(anchor)?.action_index())).collect()
    }

    fn again(&self) -> Box<dyn Choose<A>> {
        Box::new(self.clone())
    }
}

/// What was decided before the run.
#[derive(Clone)]
pub struct Decided {
    /// Actions, cycle by cycle.
    pub actions: Vec<Actions>,
}

impl<const A: usize> Choose<A> for Decided {
    fn next(&mut self, seen: &Seen<'_, A>) -> Actions {
        let next = seen.report.cycle as usize + 1;
        self.actions.get(next).cloned().unwrap_or(vec![seen.report.action])
    }

    fn again(&self) -> Box<dyn Choose<A>> {
        Box::new(self.clone())
    }
}

/// Any action, each time anew.
#[derive(Clone)]
pub struct Random {
    rng: Xoshiro128PlusPlus,
}

impl Random {
    /// With the numbers of a seed.
    pub fn new(seed: u64) -> Self {
        Self { rng: Xoshiro128PlusPlus::seed_from_u64(seed) }
    }
}

impl<const A: usize> Choose<A> for Random {
    fn next(&mut self, seen: &Seen<'_, A>) -> Actions {
        vec![(uniform(&mut self.rng) * seen.actions as f64) as usize]
    }

    fn again(&self) -> Box<dyn Choose<A>> {
        Box::new(self.clone())
    }
}

/// Discounted UCB (Garivier, Moulines 2011) on the rewards alone: no model, no memory of the channel.
#[derive(Clone)]
pub struct Bandit {
    /// Per action, the discounted number of its rewards and their sum.
    played: Vec<(f64, f64)>,
}

/// Discount of rewards per cycle.
const DISCOUNT: f64 = 0.98;
/// Padding of the mean, in nats.
const PADDING_NAT: f64 = 0.5;

impl Bandit {
    /// Nothing played yet.
    pub fn new(actions: usize) -> Self {
        Self { played: vec![(0.0, 0.0); actions] }
    }
}

impl<const A: usize> Choose<A> for Bandit {
    fn next(&mut self, seen: &Seen<'_, A>) -> Actions {
        for (count, sum) in &mut self.played {
            *count *= DISCOUNT;
            *sum *= DISCOUNT;
        }
        let (count, sum) = &mut self.played[seen.report.action];
        *count += 1.0;
        *sum += f64::from(seen.report.reward);
        let all: f64 = self.played.iter().map(|(count, _)| count).sum();
        vec![best(self.played.iter().map(|(count, sum)| match count {
            0.0 => f64::INFINITY,
            count => sum / count + PADDING_NAT * (all.ln().max(0.0) / count).sqrt(),
        }))]
    }

    fn again(&self) -> Box<dyn Choose<A>> {
        Box::new(self.clone())
    }
}

/// Index of the largest value, the first of equals.
pub fn best(values: impl Iterator<Item = f64>) -> usize {
    let mut best = (0, f64::NEG_INFINITY);
    for (action, value) in values.enumerate() {
        if value > best.1 {
            best = (action, value);
        }
    }
    best.0
}
