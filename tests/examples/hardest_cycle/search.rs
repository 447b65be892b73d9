//! The search: random cases, and the worst so far with one to three fields changed. The measure is the work that the core counts
//! ([`cogmint_core::CycleReport::work`]), the same on every machine; the firmware's instructions say how true it is.

use super::case::{self, FIELD_COUNT, SEEDS};
use cogmint::recording::Recording;
use cogmint::replay::{Setup, inputs, step};
use cogmint_core::config::WorkLimits;
use rand_core::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro128PlusPlus;
use std::path::Path;
use std::time::{Duration, Instant};

/// Searches that go on side by side, each with worst cases of its own, so that what is found does not depend on how fast they are.
const SEARCHES: u64 = 4;
/// The worst cases that a search keeps and changes.
const KEPT: usize = 32;
/// Share of new cases among those tried.
const NEW_SHARE: f64 = 0.25;
/// A case ends when its cycles have cost so much, about in instructions: the firmware in QEMU has to do them too.
const LONGEST_CASE: u64 = 1_000_000_000;
/// A later cycle must be harder by this much to count, so that the firmware runs few cycles.
const HARDER: f64 = 1.02;

/// A case that was run.
#[derive(Clone)]
pub struct Tried {
    /// What it is drawn from.
    pub seed: u64,
    /// Its hardest cycle.
    pub cycle: usize,
    /// Work of every cycle up to that, about in instructions.
    pub work: Vec<u32>,
    /// Hash over all state after each of them.
    pub hashes: Vec<u64>,
    /// Number of cycles that were run.
    pub cycles: u64,
}

impl Tried {
    /// Work of the hardest cycle.
    pub fn hardest(&self) -> u32 {
        self.work.last().copied().unwrap_or(0)
    }
}

/// What a search found.
pub struct Found {
    /// Number of cases that were run.
    pub searched: usize,
    /// Number of their cycles.
    pub cycles: u64,
    /// The worst cases, the worst first.
    pub worst: Vec<Tried>,
}

/// How far a search goes.
#[derive(Clone, Copy)]
pub struct Extent {
    /// It ends after so many cycles,
    pub cycles: u64,
    /// or after this time.
    pub time: Duration,
    /// Whether the core may do as much in a cycle as there is to do.
    pub is_uncapped: bool,
}

/// The recording of a case and what its tracker is started with.
pub fn build(seed: u64, is_uncapped: bool) -> Result<(Recording, Setup), String> {
    let recording = case::recording(seed);
    let mut setup = Setup::new(&recording, Path::new("case"), None).map_err(|error| error.to_string())?;
    setup.config.controller.planned_actions = setup.actions.len();
    if is_uncapped {
        setup.config.work = WorkLimits { anchor: 1_000_000_000, comparisons: u16::MAX };
    }
    Ok((recording, setup))
}

/// Runs the case of a seed.
///
/// # Errors
/// The core refuses it: then it was not legal.
pub fn run(seed: u64, is_uncapped: bool) -> Result<Tried, String> {
    let (recording, setup) = build(seed, is_uncapped)?;
    let mut tracker = setup.target_tracker().map_err(|error| error.to_string())?;
    let mut tried = Tried { seed, cycle: 0, work: Vec::new(), hashes: Vec::new(), cycles: 0 };
    let (mut hardest, mut total) = (0.0, 0);
    for (cycle, input) in inputs(&recording).enumerate() {
        let step = step(&mut tracker, &input, &mut ()).map_err(|error| error.to_string())?;
        if let Some(error) = step.refused {
            return Err(format!("cycle {cycle}: {error}"));
        }
        let work = step.report.work;
        tried.hashes.push(step.hash);
        tried.work.push(work);
        tried.cycles += 1;
        total += u64::from(work);
        if f64::from(work) > HARDER * hardest {
            (tried.cycle, hardest) = (cycle, f64::from(work));
        }
        if total > LONGEST_CASE {
            break;
        }
    }
    tried.hashes.truncate(tried.cycle + 1);
    tried.work.truncate(tried.cycle + 1);
    Ok(tried)
}

/// The worst cases found, the seed's own among those tried.
pub fn search(seed: u64, extent: &Extent) -> Found {
    let begin = Instant::now();
    let parts: Vec<Found> = std::thread::scope(|scope| {
        let own = |search| {
            move || {
                let mut random = Xoshiro128PlusPlus::seed_from_u64(seed ^ search << 60);
                let mut found = Found { searched: 0, cycles: 0, worst: Vec::new() };
                found.enter(run(seed, extent.is_uncapped));
                while found.cycles < extent.cycles / SEARCHES && begin.elapsed() < extent.time {
                    let next = next(&mut random, &found.worst);
                    // Every seed is legal; the tests hold that.
                    found.enter(run(next, extent.is_uncapped));
                }
                found
            }
        };
        let searches: Vec<_> = (0..SEARCHES).map(|search| scope.spawn(own(search))).collect();
        searches.into_iter().map(|search| search.join().expect("no search panics")).collect()
    });
    let mut all = Found { searched: 0, cycles: 0, worst: Vec::new() };
    for Found { searched, cycles, worst } in parts {
        all.searched += searched;
        all.cycles += cycles;
        for tried in worst {
            if all.worst.iter().all(|kept| kept.seed != tried.seed) {
                all.worst.push(tried);
            }
        }
    }
    all.worst.sort_by_key(|tried| std::cmp::Reverse(tried.hardest()));
    all
}

impl Found {
    fn enter(&mut self, tried: Result<Tried, String>) {
        let Ok(tried) = tried else { return };
        self.searched += 1;
        self.cycles += tried.cycles;
        if self.worst.iter().all(|kept| kept.seed != tried.seed) {
            self.worst.push(tried);
            self.worst.sort_by_key(|tried| std::cmp::Reverse(tried.hardest()));
            self.worst.truncate(KEPT);
        }
    }
}

fn next(random: &mut Xoshiro128PlusPlus, worst: &[Tried]) -> u64 {
    let mut word = || u64::from(random.next_u32()) << 32 | u64::from(random.next_u32());
    let is_new = word() as f64 / u64::MAX as f64;
    let fresh = word() % SEEDS;
    if worst.is_empty() || is_new < NEW_SHARE {
        return fresh;
    }
    let mut seed = worst[word() as usize % worst.len()].seed;
    for _ in 0..=word() % 3 {
        seed = case::with_field(seed, word() as usize % FIELD_COUNT, word() >> 8);
    }
    seed
}

#[cfg(test)]
mod tests {
    use super::*;
    use cogmint::trace::feed;

    /// Seeds all over their range.
    fn seeds(count: u64) -> impl Iterator<Item = u64> {
        let mut random = Xoshiro128PlusPlus::seed_from_u64(19);
        (0..count).map(move |_| (u64::from(random.next_u32()) << 32 | u64::from(random.next_u32())) % SEEDS)
    }

    #[test]
    fn every_seed_is_a_legal_case_that_the_firmware_has_room_for() {
        for seed in seeds(40) {
            let tried = run(seed, false).unwrap_or_else(|reason| panic!("seed {seed}: {reason}"));
            assert!(tried.hardest() > 0 && tried.hashes.len() == tried.cycle + 1);
            let (recording, setup) = build(seed, false).unwrap();
            assert!(feed(&setup, &recording, Path::new("case")).is_ok(), "seed {seed}");
            for cycle in &recording.cycles {
                assert!(!cycle.ranges.is_empty() || !cycle.frames.is_empty());
                assert!(cycle.frames.iter().all(|frame| frame.samples.len() <= 1024));
            }
        }
    }

    #[test]
    fn a_search_of_so_many_cycles_finds_the_same_again() {
        let extent = Extent { cycles: 400, time: Duration::MAX, is_uncapped: false };
        let seeds = || {
            let found = search(7, &extent);
            assert!(found.cycles >= 400);
            found.worst.iter().map(|tried| (tried.seed, tried.hardest())).collect::<Vec<_>>()
        };
        let worst = seeds();
        assert!(worst.is_sorted_by(|(_, a), (_, b)| a >= b));
        assert_eq!(worst, seeds());
    }

    #[test]
    fn a_seed_recreates_its_case() {
        for seed in seeds(5) {
            let bytes = || {
                let (recording, setup) = build(seed, false).unwrap();
                feed(&setup, &recording, Path::new("case")).unwrap()
            };
            assert_eq!(bytes(), bytes(), "seed {seed}");
        }
    }

    #[test]
    fn one_field_changes_and_the_others_stay() {
        for seed in seeds(20) {
            for field in 0..FIELD_COUNT {
                let ones = case::with_field(seed, field, u64::MAX);
                let zeros = case::with_field(seed, field, 0);
                assert!(ones < SEEDS && zeros < SEEDS);
                // The row of bits that differ is one field; all fields together are all bits.
                assert_eq!(ones & zeros, zeros);
                assert!(seed & !(ones ^ zeros) == zeros);
            }
            let all = (0..FIELD_COUNT).fold(0, |bits, field| bits | case::with_field(0, field, u64::MAX));
            assert_eq!(all, SEEDS - 1);
        }
    }

    #[test]
    fn the_worst_are_kept_and_each_once() {
        let mut found = Found { searched: 0, cycles: 0, worst: Vec::new() };
        for n in 0..3 * KEPT as u64 {
            let work = vec![n as u32 / 2];
            found.enter(Ok(Tried { seed: n / 2, cycle: 0, work, hashes: Vec::new(), cycles: 1 }));
        }
        assert_eq!((found.searched, found.cycles), (3 * KEPT, 3 * KEPT as u64));
        let kept: Vec<u64> = found.worst.iter().map(|tried| tried.seed).collect();
        let last = 3 * KEPT as u64 / 2 - 1;
        assert_eq!(kept, (0..KEPT as u64).map(|n| last - n).collect::<Vec<_>>());
    }
}
