//! The search: random cases, and the worst so far with one to three fields changed. The measure is the processor time of
//! the core's slowest cycle on this thread; it only has to rank, since the firmware's instruction count decides.

use super::case::{self, FIELD_COUNT, SEEDS};
use cogmint::recording::Recording;
use cogmint::replay::{Setup, inputs, step};
use rand_core::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro128PlusPlus;
use std::path::Path;
use std::sync::Mutex;
use std::time::{Duration, Instant};

/// The worst cases that are kept and changed.
const KEPT: usize = 16;
/// Of these, those that are timed again, and those that the firmware runs.
const TIMED_AGAIN: usize = 8;
const FINALISTS: usize = 3;
/// Share of new cases among those tried.
const NEW_SHARE: f64 = 0.25;
/// A case ends when its cycles took so long, seconds: the firmware in QEMU takes thirty times as long.
const LONGEST_CASE_S: f64 = 0.5;
/// A later cycle must be harder by this much to count, so that the firmware runs few cycles.
const HARDER: f64 = 1.02;

/// A case that was run.
#[derive(Clone)]
pub struct Tried {
    /// What it is drawn from.
    pub seed: u64,
    /// Its hardest cycle.
    pub cycle: usize,
    /// Processor time of that cycle, seconds.
    pub seconds: f64,
    /// Hash over all state after each cycle up to the hardest.
    pub hashes: Vec<u64>,
}

/// What a search found.
pub struct Found {
    /// Number of cases that were run.
    pub searched: usize,
    /// The worst cases, the worst first.
    pub worst: Vec<Tried>,
}

/// The recording of a case and what its tracker is started with.
pub fn build(seed: u64) -> Result<(Recording, Setup), String> {
    let recording = case::recording(seed);
    let mut setup = Setup::new(&recording, Path::new("case"), None).map_err(|error| error.to_string())?;
    setup.config.controller.planned_actions = setup.actions.len();
    Ok((recording, setup))
}

/// Runs the case of a seed.
///
/// # Errors
/// The core refuses it: then it was not legal.
pub fn run(seed: u64) -> Result<Tried, String> {
    let (recording, setup) = build(seed)?;
    let mut tracker = setup.target_tracker().map_err(|error| error.to_string())?;
    let mut tried = Tried { seed, cycle: 0, seconds: 0.0, hashes: Vec::new() };
    let (mut hashes, mut total_s) = (Vec::new(), 0.0);
    for (cycle, input) in inputs(&recording).enumerate() {
        let begin = thread_time_s();
        let step = step(&mut tracker, &input, &mut ()).map_err(|error| error.to_string())?;
        let seconds = thread_time_s() - begin;
        if let Some(error) = step.refused {
            return Err(format!("cycle {cycle}: {error}"));
        }
        hashes.push(step.hash);
        total_s += seconds;
        if seconds > HARDER * tried.seconds {
            tried = Tried { cycle, seconds, ..tried };
        }
        if total_s > LONGEST_CASE_S {
            break;
        }
    }
    hashes.truncate(tried.cycle + 1);
    Ok(Tried { hashes, ..tried })
}

/// Time that this thread has computed for, seconds; where the system does not say, the time of day.
fn thread_time_s() -> f64 {
    #[cfg(unix)]
    {
        let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
        time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
    }
    #[cfg(not(unix))]
    {
        use std::sync::LazyLock;
        static BEGIN: LazyLock<Instant> = LazyLock::new(Instant::now);
        BEGIN.elapsed().as_secs_f64()
    }
}

/// The worst cases found in a time, the seed's own among those tried. The choice of what is tried starts from the seed
/// too, but depends on how fast cases ran.
pub fn search(seed: u64, time: Duration) -> Found {
    let begin = Instant::now();
    let first = run(seed);
    let found = Mutex::new(Found { searched: 1, worst: first.into_iter().collect() });
    let threads = std::thread::available_parallelism().map_or(1, usize::from) as u64;
    std::thread::scope(|scope| {
        for thread in 0..threads {
            let found = &found;
            scope.spawn(move || {
                let mut random = Xoshiro128PlusPlus::seed_from_u64(seed ^ thread << 60);
                while begin.elapsed() < time {
                    let next = next(&mut random, &found.lock().expect("no search panics").worst);
                    // Every seed is legal; the tests hold that.
                    let Ok(tried) = run(next) else { continue };
                    let mut found = found.lock().expect("no search panics");
                    found.searched += 1;
                    found.enter(tried);
                }
            });
        }
    });
    let mut found = found.into_inner().expect("no search panics");
    // What was disturbed while it was timed seemed harder than it is.
    found.worst.truncate(TIMED_AGAIN);
    for tried in &mut found.worst {
        if let Ok(again) = run(tried.seed)
            && again.seconds < tried.seconds
        {
            *tried = again;
        }
    }
    found.worst.sort_by(|a, b| b.seconds.total_cmp(&a.seconds));
    found.worst.truncate(FINALISTS);
    found
}

impl Found {
    fn enter(&mut self, tried: Tried) {
        if self.worst.iter().all(|kept| kept.seed != tried.seed) {
            self.worst.push(tried);
            self.worst.sort_by(|a, b| b.seconds.total_cmp(&a.seconds));
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
            let tried = run(seed).unwrap_or_else(|reason| panic!("seed {seed}: {reason}"));
            assert!(tried.seconds > 0.0 && tried.hashes.len() == tried.cycle + 1);
            let (recording, setup) = build(seed).unwrap();
            assert!(feed(&setup, &recording, Path::new("case")).is_ok(), "seed {seed}");
            for cycle in &recording.cycles {
                assert!(!cycle.ranges.is_empty() || !cycle.frames.is_empty());
                assert!(cycle.frames.iter().all(|frame| frame.samples.len() <= 1024));
            }
        }
    }

    #[test]
    fn a_seed_recreates_its_case() {
        for seed in seeds(5) {
            let bytes = || {
                let (recording, setup) = build(seed).unwrap();
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
        let mut found = Found { searched: 0, worst: Vec::new() };
        for n in 0..3 * KEPT as u64 {
            let tried = Tried { seed: n / 2, cycle: 0, seconds: (n / 2) as f64, hashes: Vec::new() };
            found.enter(tried);
        }
        let kept: Vec<u64> = found.worst.iter().map(|tried| tried.seed).collect();
        let last = 3 * KEPT as u64 / 2 - 1;
        assert_eq!(kept, (0..KEPT as u64).map(|n| last - n).collect::<Vec<_>>());
    }
}
