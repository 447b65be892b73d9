//! Snapshots: a tracker that goes on from one has the bits of the one that wrote it, and what is no such snapshot is refused.

use cogmint::replay::{Setup, inputs, step};
use cogmint::scenario::Scenario;
use cogmint::simulator::Simulator;
use cogmint_core::SnapshotError;
use rand_core::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro128PlusPlus;
use std::path::Path;

fn setup(name: &str, cycles: usize) -> (cogmint::recording::Recording, Setup) {
    let (scenario, _) = Scenario::find(name).unwrap();
    let simulator = Simulator::new(&scenario, None, 0, Some(7)).unwrap();
    let recording = simulator.record(cycles, || {});
    let setup = Setup::new(&recording, Path::new(name), None).unwrap();
    (recording, setup)
}

#[test]
fn a_tracker_goes_on_from_a_snapshot_with_the_same_bits() {
    goes_on::<2>("seminar-room", 25);
    goes_on::<4>("dw3000-office", 30);
}

fn goes_on<const ANCHORS: usize>(name: &str, cut: usize) {
    let (recording, setup) = setup(name, 60);
    let mut tracker = setup.tracker::<ANCHORS>().unwrap();
    let mut buffer = vec![0; 1 << 18];
    let (mut length, mut other) = (0, setup.tracker::<ANCHORS>().unwrap());
    for (cycle, input) in inputs(&recording).enumerate() {
        if cycle == cut {
            length = tracker.snapshot(&mut buffer).unwrap();
            other.restore(&buffer[..length]).unwrap();
        }
        let hash = step(&mut tracker, &input, &mut ()).unwrap().hash;
        if cycle >= cut {
            assert_eq!(step(&mut other, &input, &mut ()).unwrap().hash, hash, "{name}, cycle {cycle}");
        }
    }
    println!("{name}: a snapshot of {length} bytes");
    // As does one that had gone another way.
    let mut late = [vec![0; 1 << 18], vec![0; 1 << 18]];
    let ends: Vec<usize> =
        [&tracker, &other].iter().zip(&mut late).map(|(own, to)| own.snapshot(to).unwrap()).collect();
    assert_eq!(late[0][..ends[0]], late[1][..ends[1]]);
    other.restore(&buffer[..length]).unwrap();
    let mut again = vec![0; length];
    assert_eq!(other.snapshot(&mut again), Ok(length));
    assert_eq!(again, buffer[..length]);
}

#[test]
fn a_hundred_thousand_damaged_snapshots_are_refused_and_change_nothing() {
    let (recording, setup) = setup("seminar-room", 12);
    let mut tracker = setup.tracker::<2>().unwrap();
    let mut snapshots = Vec::new();
    for input in inputs(&recording) {
        step(&mut tracker, &input, &mut ()).unwrap();
        let mut buffer = vec![0; 1 << 18];
        let length = tracker.snapshot(&mut buffer).unwrap();
        buffer.truncate(length);
        snapshots.push(buffer);
    }
    let (last, earlier) = snapshots.split_last().unwrap();
    let before = tracker.hash();
    let mut random = Xoshiro128PlusPlus::seed_from_u64(1);
    let mut below = |limit: usize| random.next_u32() as usize % limit;
    // A checksum walks over all bytes: the damage of 200 places of a few snapshots each way.
    for attempt in 0..100_000 {
        let kind = attempt % 4;
        let own = &earlier[attempt % earlier.len()];
        let mut damaged = match kind {
            // Flipped.
            0 => own.clone(),
            // Cut short.
            1 => own[..below(own.len())].to_vec(),
            // Torn: the beginning of a later one over the end of an earlier one.
            2 => {
                let end = own.len().min(last.len());
                let cut = below(end);
                [&last[..cut], &own[cut..]].concat()
            }
            // Foreign.
            _ => (0..below(400)).map(|_| below(256) as u8).collect(),
        };
        if kind == 0 {
            let bit = below(8 * damaged.len());
            damaged[bit / 8] ^= 1 << (bit % 8);
        }
        if snapshots.contains(&damaged) {
            continue;
        }
        assert!(tracker.restore(&damaged).is_err(), "attempt {attempt}");
    }
    assert_eq!(tracker.hash(), before);
}

#[test]
fn a_tracker_that_was_told_something_else_refuses_it() {
    let (_, own) = setup("seminar-room", 2);
    let tracker = own.tracker::<2>().unwrap();
    let mut buffer = vec![0; 1 << 18];
    let Err(SnapshotError::Room { needed }) = tracker.snapshot(&mut []) else { panic!("it has no room") };
    assert_eq!(tracker.snapshot(&mut buffer), Ok(needed));
    let refused = |mut other: Setup, change: &dyn Fn(&mut Setup)| {
        change(&mut other);
        let mut tracker = other.tracker::<2>().unwrap();
        tracker.restore(&buffer)
    };
    let same = || setup("seminar-room", 2).1;
    assert_eq!(refused(same(), &|_| ()), Ok(()));
    let told = Err(SnapshotError::Told);
    assert_eq!(refused(same(), &|setup| setup.config.belief.turns_per_s = 0.3), told);
    assert_eq!(refused(same(), &|setup| setup.config.association.clutter_per_anchor = 2.0), told);
    assert_eq!(refused(same(), &|setup| setup.anchors[0].position_m[0] += 0.01), told);
    assert_eq!(refused(same(), &|setup| setup.seed += 1), told);
    assert_eq!(refused(same(), &|setup| setup.map[0].std_m += 0.01), told);
    // Actions that it may choose are told as well, whenever that is.
    let mut restricted = same().tracker::<2>().unwrap();
    restricted.restrict(0, &[0, 1, 2]).unwrap();
    assert_eq!(restricted.restore(&buffer), told);
    let office = setup("dw3000-office", 2).1.tracker::<4>().unwrap().restore(&buffer);
    assert_eq!(office, told);
    let mut begun = same().tracker::<2>().unwrap();
    begun.begin(0.1, None).unwrap();
    assert_eq!(begun.snapshot(&mut buffer.clone()), Err(SnapshotError::Begun));
    assert_eq!(begun.restore(&buffer), Err(SnapshotError::Begun));
}

/// Length and hash of two snapshots of version 1. Another layout has another version; with it, and where the core's arithmetic changes
/// as it does for the golden trace, they are entered anew.
#[test]
fn the_layout_of_a_snapshot_is_that_of_its_version() {
    let (recording, setup) = setup("dw3000-office", 30);
    let mut tracker = setup.tracker::<4>().unwrap();
    let fingerprint = |tracker: &cogmint::replay::SizedTracker<4>| {
        let mut bytes = vec![0; 1 << 18];
        let length = tracker.snapshot(&mut bytes).unwrap();
        let mut hash = cogmint_core::trace::TraceHash::default();
        bytes[..length].iter().for_each(|byte| hash.word(u32::from(*byte)));
        (cogmint_core::snapshot::VERSION, length, format!("{:016x}", hash.value()))
    };
    let at_start = fingerprint(&tracker);
    for input in inputs(&recording) {
        step(&mut tracker, &input, &mut ()).unwrap();
    }
    assert_eq!(at_start, (1, 24_095, "4694b8ac47fb0c92".to_owned()));
    assert_eq!(fingerprint(&tracker), (1, 66_706, "d6c8f4d419a97c1a".to_owned()));
}
