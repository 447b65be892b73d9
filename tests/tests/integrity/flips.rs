//! Single bits flipped in the memory of a tracker between two cycles of a recording, and what becomes of it.
//!
//! A child process flips and follows the tracker, so that one that crashes or hangs is counted and does not end the campaign.

use cogmint::recording::Recording;
use cogmint::replay::{Setup, TargetTracker, inputs, step};
use cogmint::scenario::{Scenario, Told};
use cogmint::simulator::Simulator;
use cogmint_core::Error;
use rand_core::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro128PlusPlus;
use std::collections::BTreeMap;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::mpsc;
use std::time::Duration;

/// Says to the child which flips it makes: the first and the one after the last.
const CHILD: &str = "COGMINT_FLIPS_OF_CHILD";
/// Where it is set, all bits of a word become ones in place of one that flips: a number becomes none.
pub const WORDS: &str = "COGMINT_WORDS";
/// Cycles at whose end bits flip.
const FIRST: usize = 15;
const LAST: usize = 60;
/// Cycles that are followed then.
const FOLLOWED: usize = 45;
/// So many cycles are looked at even where all state is as if nothing had flipped: every part has had its turn.
const AT_LEAST: usize = 10;
/// An error that counts, metres, and for how many cycles it has to last.
const WRONG_M: f64 = 1.0;
const LASTS: usize = 20;

/// What became of a flip.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Outcome {
    /// The tracker says that what it was told is not that any more.
    Refused,
    /// It reports the part.
    Reported,
    /// All state becomes what it is without the flip: memory that nothing reads, or reads before it is written.
    WithoutEffect,
    /// Nothing is reported; the position stays within a metre, or comes back within so many cycles.
    Healed,
    /// Not reported but wrong for longer, and the tracker says that it searches.
    Searching,
    /// Not reported, wrong for longer, and the tracker claims to know.
    SilentlyWrong,
    /// The last position is no number.
    NotANumber,
    /// It refuses all cycles for another reason.
    Stuck,
    /// It neither went on nor ended.
    Hung,
    /// The process died.
    Crashed,
}

const OUTCOMES: [(Outcome, &str); 10] = [
    (Outcome::Refused, "refused"),
    (Outcome::Reported, "reported"),
    (Outcome::WithoutEffect, "without effect"),
    (Outcome::Healed, "healed"),
    (Outcome::Searching, "searching"),
    (Outcome::SilentlyWrong, "silently wrong"),
    (Outcome::NotANumber, "not a number"),
    (Outcome::Stuck, "stuck"),
    (Outcome::Hung, "hung"),
    (Outcome::Crashed, "crashed"),
];

/// Of every part of the tracker, how many flips had which outcome.
pub type Outcomes = BTreeMap<(String, Outcome), usize>;

/// How many of them: in parts that `is` says, with an outcome.
pub fn count(outcomes: &Outcomes, is: impl Fn(&str) -> bool, outcome: Outcome) -> usize {
    outcomes.iter().filter(|((part, own), _)| is(part) && *own == outcome).map(|(_, count)| count).sum()
}

/// A table of them.
pub fn print(outcomes: &Outcomes) {
    let mut parts: Vec<&String> = outcomes.keys().map(|(part, _)| part).collect();
    parts.dedup();
    let head: Vec<&str> = OUTCOMES.iter().map(|(_, name)| *name).collect();
    println!("| part | {} |", head.join(" | "));
    for part in parts {
        let row = OUTCOMES.map(|(outcome, _)| count(outcomes, |own| own == part, outcome).to_string());
        println!("| {part} | {} |", row.join(" | "));
    }
}

/// The seminar room, told by its walls, in the target's tracker.
fn room() -> (Recording, Setup) {
    let (mut scenario, _) = Scenario::find("seminar-room").unwrap();
    scenario.prior.floor_plan.told = Told::Walls;
    let simulator = Simulator::new(&scenario, None, 0, Some(1)).unwrap();
    let recording = simulator.record(LAST + FOLLOWED + 1, || {});
    let setup = Setup::new(&recording, Path::new("the room"), Some(1)).unwrap();
    (recording, setup)
}

/// Which part of a tracker a byte lies in.
fn part_of(tracker: &TargetTracker, byte: usize) -> &'static str {
    let at = std::ptr::from_ref(tracker).addr() + byte;
    let holds = |begin: usize, length: usize| (begin..begin + length).contains(&at);
    macro_rules! is {
        ($field:expr) => {
            holds(std::ptr::from_ref($field).addr(), size_of_val($field))
        };
    }
    if is!(tracker.config()) || is!(tracker.plan()) || is!(tracker.library()) || is!(tracker.anchors()) {
        "told"
    } else if is!(tracker.belief()) {
        "belief"
    } else if is!(tracker.environment()) {
        "environment"
    } else if is!(tracker.transmission()) {
        "transmission"
    } else if is!(tracker.discovery()) {
        "discovery"
    } else if is!(tracker.channel()) {
        "channel"
    } else if is!(tracker.lateness()) {
        "lateness"
    } else {
        "receiver, clutter, controllers, rest"
    }
}

/// Flips a bit of a value; or sets all bits of the word of 32 that it is in.
fn flip<T>(value: &mut T, bit: usize, is_word: bool) {
    assert!(bit < 8 * size_of::<T>() && align_of::<T>() >= 4);
    let first = if is_word { bit / 32 * 4 } else { bit / 8 };
    for byte in first..first + if is_word { 4 } else { 1 } {
        let at = std::ptr::from_mut(value).cast::<u8>().wrapping_add(byte);
        // SAFETY: the byte lies in the value, which is borrowed mutably and as long as whole words. What is changed may be padding, or
        // make a value that its type has not: that is what is to be seen, in a process of its own.
        unsafe { at.write_volatile(if is_word { 0xff } else { at.read_volatile() ^ 1 << (bit % 8) }) }
    }
}

/// Follows a tracker after a flip. `expected` are the hashes of one in which nothing has flipped.
fn follow(tracker: &mut TargetTracker, recording: &Recording, from: usize, expected: &[u64]) -> Outcome {
    let (mut reported, mut wrong, mut silent, mut lost) = (false, 0, false, false);
    let mut last = [0.0_f32; 2];
    for (cycle, input) in inputs(recording).enumerate().skip(from).take(FOLLOWED) {
        let mut outcome = step(tracker, &input, &mut ());
        if matches!(outcome, Err(Error::AlreadyBegun)) {
            // As the guide says.
            let _ = tracker.finish();
            outcome = step(tracker, &input, &mut ());
        }
        let own = match outcome {
            Ok(own) => own,
            Err(Error::ToldChanged) => return Outcome::Refused,
            Err(_) => return Outcome::Stuck,
        };
        reported |= !own.report.integrity.is_intact();
        last = own.report.position_m;
        let [x, y] = recording.cycles[cycle].truth_position_m.unwrap();
        // Written so that NaN counts.
        let is_right = (f64::from(last[0]) - x).hypot(f64::from(last[1]) - y) <= WRONG_M;
        wrong = if is_right { 0 } else { wrong + 1 };
        if wrong > LASTS && !reported {
            silent |= !own.report.searching;
            lost |= own.report.searching;
        }
        if !reported && own.hash == expected[cycle] && cycle >= from + AT_LEAST {
            return Outcome::WithoutEffect;
        }
    }
    if !last.iter().all(|coordinate| coordinate.is_finite()) {
        Outcome::NotANumber
    } else if reported {
        Outcome::Reported
    } else if silent {
        Outcome::SilentlyWrong
    } else if lost {
        Outcome::Searching
    } else {
        Outcome::Healed
    }
}

/// What the child does where it is told to: a line before each flip and one after it.
pub fn child() {
    let Ok(told) = std::env::var(CHILD) else { return };
    let (first, end) = told.split_once(' ').unwrap();
    let (recording, setup) = room();
    let mut tracker = setup.target_tracker().unwrap();
    let mut trackers = Vec::new();
    let mut hashes = Vec::new();
    for (cycle, input) in inputs(&recording).enumerate() {
        if cycle > FIRST && cycle <= LAST {
            trackers.push((cycle, tracker.clone()));
        }
        let own = step(&mut tracker, &input, &mut ()).unwrap();
        assert!(own.report.integrity.is_intact());
        hashes.push(own.hash);
        let [x, y] = recording.cycles[cycle].truth_position_m.unwrap();
        let [own_x, own_y] = own.report.position_m.map(f64::from);
        let error_m = (own_x - x).hypot(own_y - y);
        assert!(cycle <= FIRST || error_m < WRONG_M, "without a flip it is {error_m} m off in cycle {cycle}");
    }
    for index in first.parse::<u64>().unwrap()..end.parse().unwrap() {
        let mut random = Xoshiro128PlusPlus::seed_from_u64(index);
        let (cycle, before) = &trackers[random.next_u32() as usize % trackers.len()];
        let mut tracker = before.clone();
        let bit = random.next_u32() as usize % (8 * size_of::<TargetTracker>());
        println!("\nflip {index} {}", part_of(&tracker, bit / 8));
        flip(&mut *tracker, bit, std::env::var(WORDS).is_ok());
        let outcome = follow(&mut tracker, &recording, *cycle, &hashes);
        let name = OUTCOMES.iter().find(|(own, _)| *own == outcome).unwrap().1;
        println!("\nbecame {name}");
        // Dropping what is broken may end the process as well: nothing has to be dropped.
        std::mem::forget(tracker);
    }
    println!("\nend");
}

/// Makes so many flips, from the `first` on, by children that run the test `name`.
pub fn campaign(name: &str, first: u64, flips: u64) -> Outcomes {
    let mut outcomes = Outcomes::new();
    let mut next = first;
    while next < first + flips {
        let mut child = Command::new(std::env::current_exe().unwrap())
            .args([name, "--exact", "--nocapture"])
            .env(CHILD, format!("{next} {}", first + flips))
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let stdout = BufReader::new(child.stdout.take().unwrap());
        let (sender, lines) = mpsc::channel();
        let reader = std::thread::spawn(move || {
            for line in stdout.lines().map_while(Result::ok) {
                if sender.send(line).is_err() {
                    break;
                }
            }
        });
        let mut part = None;
        let died = loop {
            match lines.recv_timeout(Duration::from_secs(60)) {
                Ok(line) => {
                    if let Some(flip) = line.strip_prefix("flip ") {
                        let (index, own) = flip.split_once(' ').unwrap();
                        next = index.parse::<u64>().unwrap() + 1;
                        part = Some(own.to_owned());
                    } else if let Some(name) = line.strip_prefix("became ") {
                        let outcome = OUTCOMES.iter().find(|(_, own)| *own == name).unwrap().0;
                        *outcomes.entry((part.take().unwrap(), outcome)).or_default() += 1;
                    }
                }
                Err(mpsc::RecvTimeoutError::Timeout) => break Outcome::Hung,
                Err(mpsc::RecvTimeoutError::Disconnected) => break Outcome::Crashed,
            }
        };
        let _ = child.kill();
        let _ = child.wait();
        reader.join().unwrap();
        match part {
            Some(part) => {
                println!("flip {}: {died:?} in {part}", next - 1);
                *outcomes.entry((part, died)).or_default() += 1;
            }
            // Between two flips it ends only behind the last one.
            None => assert!(next == first + flips, "the child made no flip"),
        }
    }
    outcomes
}
