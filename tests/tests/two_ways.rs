//! Two ways in: a cycle at once, and a cycle by its observations, are the same cycle to the bit.

use cogmint::demo;
use cogmint::recording::{self, Recording};
use cogmint::replay::{CycleInput, LARGE_ANCHORS, LargeTracker, Setup, inputs};
use cogmint::scenario::Scenario;
use cogmint::simulator::Simulator;
use cogmint_core::model::observation::{Frame, Observation, Range, RangeScan, Samples, TagHeight};
use cogmint_core::{CycleReport, Error, Map};
use rand_core::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro128PlusPlus;
use std::path::Path;

const FILE: &str = "two ways";

/// The published room, frames of two anchors.
fn seminar_room(cycles: usize) -> Recording {
    let room = demo::seminar_room(1, cycles).unwrap();
    demo::run(&room, true, 1, || {}).unwrap().recording
}

/// An office of four anchors that deliver a frame each and, in most cycles, ranges of the same paths: some replace a path of
/// the frame, some lie beside it, and with all of them a scan overflows.
fn office(cycles: usize) -> Recording {
    let (mut scenario, _) = Scenario::find("dw3000-office").unwrap();
    scenario.trajectories[0].cycles = Some(cycles);
    let mut recording = Simulator::new(&scenario, None, 0, Some(1)).unwrap().record(cycles, || {});
    let mut rng = Xoshiro128PlusPlus::seed_from_u64(7);
    for cycle in &mut recording.cycles {
        for anchor in 0..recording.anchors.len() {
            if rng.next_u32() % 4 == 0 {
                continue;
            }
            let paths = cycle.truth_paths.iter().filter(|path| path.anchor == anchor && path.sinr > 1.0);
            let ranges = paths.map(|path| recording::Range {
                anchor,
                range_m: 299_792_458.0 * path.delay_s + 0.4 * (f64::from(rng.next_u32()) * 2f64.powi(-32)),
                std_m: Some(0.1),
                angles: None,
            });
            cycle.ranges.extend(ranges);
            // Now and then more than a scan holds.
            let false_ranges = if rng.next_u32() % 8 == 0 { 14 } else { 0 };
            cycle.ranges.extend((0..false_ranges).map(|n| recording::Range {
                anchor,
                range_m: 4.0 + 1.3 * f64::from(n),
                std_m: Some(0.2),
                angles: None,
            }));
        }
    }
    recording
}

fn trackers(recording: &Recording) -> (Box<LargeTracker>, Box<LargeTracker>) {
    let setup = Setup::new(recording, Path::new(FILE), Some(1)).unwrap();
    let tracker = setup.tracker::<LARGE_ANCHORS>().unwrap();
    (tracker.clone(), tracker)
}

/// In another order: reversed, or shuffled by a seed.
fn reordered(mut observations: Vec<Observation<'_>>, seed: Option<u64>) -> Vec<Observation<'_>> {
    let Some(seed) = seed else {
        observations.reverse();
        return observations;
    };
    let mut rng = Xoshiro128PlusPlus::seed_from_u64(seed);
    for last in (1..observations.len()).rev() {
        observations.swap(last, rng.next_u32() as usize % (last + 1));
    }
    observations
}

fn one_by_one(
    tracker: &mut LargeTracker,
    input: &CycleInput<'_>,
    observations: &[Observation<'_>],
) -> Result<CycleReport, Error> {
    tracker.begin(input.elapsed_s, input.tag_height)?;
    for observation in observations {
        tracker.receive(observation)?;
    }
    tracker.finish()
}

#[test]
fn observations_one_by_one_in_any_order_give_the_bits_of_all_at_once() {
    for recording in [seminar_room(25), office(25)] {
        let (start, _) = trackers(&recording);
        let mut left_out = 0;
        for order in [None, Some(1), Some(2), Some(3)] {
            let (mut at_once, mut by_observation) = (start.clone(), start.clone());
            for (cycle, input) in inputs(&recording).enumerate() {
                let observations = input.observations();
                let expected = at_once.cycle(&observations, input.elapsed_s, input.tag_height).unwrap();
                let seed = order.map(|seed| seed * 1000 + cycle as u64);
                let observations = reordered(observations, seed);
                let report = one_by_one(&mut by_observation, &input, &observations).unwrap();
                let place = format!("{}, order {order:?}, cycle {cycle}", recording.name);
                assert_eq!(report, expected, "{place}");
                assert_eq!(by_observation.hash(), at_once.hash(), "{place}");
                left_out += report.left_out;
            }
            assert!(!at_once.belief().is_searching(), "{}: more than a search was seen", recording.name);
        }
        let mixed = recording.cycles.iter().any(|cycle| !cycle.ranges.is_empty());
        assert_eq!(left_out > 0, mixed, "{}: full scans were seen", recording.name);
    }
}

/// A call that is refused.
type Refused = Box<dyn Fn(&mut LargeTracker) -> Result<(), Error>>;

/// What is refused while no cycle is begun: the call and its error.
fn refused_between_cycles(recording: &Recording) -> Vec<(Refused, Error)> {
    let input = inputs(recording).last().unwrap();
    let (elapsed_s, height) = (input.elapsed_s, input.tag_height);
    let whole = recording.clone();
    let receive = move |tracker: &mut LargeTracker| {
        let input = inputs(&whole).last().unwrap();
        tracker.receive(&input.observations()[0])
    };
    let mut refused: Vec<(Refused, Error)> = vec![
        (Box::new(receive), Error::NotBegun),
        (Box::new(|tracker| tracker.finish().map(drop)), Error::NotBegun),
        (Box::new(move |tracker| tracker.begin(elapsed_s, Some(TagHeight::exact(1001.0)))), Error::TagHeight),
        (
            Box::new(move |tracker| tracker.begin(elapsed_s, Some(TagHeight::exact(f32::NAN)))),
            Error::TagHeight,
        ),
    ];
    for elapsed_s in [0.0, -0.1, f32::INFINITY, 3601.0] {
        let begin: Refused = Box::new(move |tracker| tracker.begin(elapsed_s, height));
        refused.push((begin, Error::Time { elapsed_s }));
    }
    refused
}

/// What is refused while a cycle is begun in which anchor 0 has delivered a frame and ranges, and anchor 1 nothing.
fn refused_within_a_cycle(recording: &Recording) -> Vec<(Refused, Error)> {
    let given = recording.cycles[0].frames[0].samples.len();
    let ranges = |anchor, range_m, variance_m2| -> Refused {
        Box::new(move |tracker| {
            let ranges = &[Range { range_m: 3.0, variance_m2: 0.01 }, Range { range_m, variance_m2 }];
            tracker.receive(&Observation::Ranges(RangeScan { anchor, ranges }))
        })
    };
    let frame = |anchor, action, samples: Vec<[f32; 2]>| -> Refused {
        Box::new(move |tracker| {
            let samples = Samples::Complex(&samples);
            tracker.receive(&Observation::Frame(Frame {
                anchor,
                action,
                sequence: None,
                first_sample_delay_s: 0.0,
                samples,
            }))
        })
    };
    let good = vec![[1.0, 0.5]; given];
    let mut bad = good.clone();
    bad[3][1] = f32::NAN;
    vec![
        (Box::new(|tracker| tracker.begin(0.1, None)), Error::AlreadyBegun),
        // Also where the time alone would be refused.
        (Box::new(|tracker| tracker.begin(-1.0, None)), Error::AlreadyBegun),
        (Box::new(|tracker| tracker.cycle(&[], 0.1, None).map(drop)), Error::AlreadyBegun),
        (ranges(0, 4.0, 0.01), Error::DuplicateFrame { anchor: 0 }),
        (ranges(1, -4.0, 0.01), Error::Range { anchor: 1, index: 1 }),
        (ranges(1, 4.0, f32::NAN), Error::RangeVariance { anchor: 1, index: 1 }),
        (ranges(4, 4.0, 0.01), Error::UnknownAnchor { anchor: 4 }),
        (frame(0, 0, good.clone()), Error::DuplicateFrame { anchor: 0 }),
        (frame(1, 0, bad), Error::SampleNotFinite { anchor: 1, sample: 3 }),
        (frame(1, 0, vec![[0.0; 2]; given]), Error::SilentFrame { anchor: 1 }),
        (
            frame(1, 0, good[1..].to_vec()),
            Error::FrameLength { anchor: 1, given: given - 1, expected: given },
        ),
        (frame(1, 40, good.clone()), Error::UnknownAction { action: 40 }),
        (frame(LARGE_ANCHORS, 0, good), Error::UnknownAnchor { anchor: LARGE_ANCHORS }),
    ]
}

/// Makes a call that is refused; nothing changes.
fn refuse(tracker: &mut LargeTracker, (call, expected): &(Refused, Error)) {
    let (hash, before) = (tracker.hash(), format!("{tracker:?}"));
    let error = call(tracker).unwrap_err();
    assert_eq!(error, *expected);
    assert_eq!(tracker.hash(), hash, "hash after: {error}");
    assert_eq!(format!("{tracker:?}"), before, "state after: {error}");
}

#[test]
fn a_refused_call_changes_nothing_of_a_cycle_nor_of_the_rest_of_it() {
    let mut recording = office(14);
    // The last but one cycle: anchor 0 delivers both.
    let last = recording.cycles.len() - 2;
    let direct = recording::Range { anchor: 0, range_m: 5.0, std_m: Some(0.1), angles: None };
    recording.cycles[last].ranges.push(direct);
    let (mut start, _) = trackers(&recording);
    let all: Vec<_> = inputs(&recording).collect();
    for input in &all[..last] {
        start.cycle(&input.observations(), input.elapsed_s, input.tag_height).unwrap();
    }
    let (input, after) = (&all[last], &all[last + 1]);
    let mut observations = input.observations();
    observations.sort_by_key(Observation::anchor);
    let (of_first, of_others) = observations.split_at(2);
    assert!(of_first.iter().all(|observation| observation.anchor() == 0));

    let goes_on = |mut tracker: Box<LargeTracker>| {
        of_others.iter().for_each(|observation| tracker.receive(observation).unwrap());
        let report = tracker.finish().unwrap();
        let hash = tracker.hash();
        let next = tracker.cycle(&after.observations(), after.elapsed_s, after.tag_height).unwrap();
        (report, hash, next, tracker.hash())
    };
    let begins = |tracker: &mut LargeTracker| {
        tracker.begin(input.elapsed_s, input.tag_height).unwrap();
        of_first.iter().for_each(|observation| tracker.receive(observation).unwrap());
    };
    let mut undisturbed = start.clone();
    begins(&mut undisturbed);
    let expected = goes_on(undisturbed.clone());
    for refused in refused_between_cycles(&recording) {
        let mut tracker = start.clone();
        refuse(&mut tracker, &refused);
        begins(&mut tracker);
        assert_eq!(goes_on(tracker), expected, "after {}", refused.1);
    }
    for refused in refused_within_a_cycle(&recording) {
        let mut tracker = undisturbed.clone();
        refuse(&mut tracker, &refused);
        assert_eq!(goes_on(tracker), expected, "after {}", refused.1);
    }
}

#[test]
fn the_hash_covers_a_cycle_begun() {
    let recording = office(3);
    let (mut start, _) = trackers(&recording);
    let all: Vec<_> = inputs(&recording).collect();
    start.cycle(&all[0].observations(), all[0].elapsed_s, all[0].tag_height).unwrap();
    let begun = |elapsed_s, height, ranges: Option<&[Range]>| {
        let mut tracker = start.clone();
        tracker.begin(elapsed_s, height).unwrap();
        if let Some(ranges) = ranges {
            tracker.receive(&Observation::Ranges(RangeScan { anchor: 1, ranges })).unwrap();
        }
        tracker.hash()
    };
    let range = |range_m, variance_m2| [Range { range_m, variance_m2 }];
    let hashes = [
        start.hash(),
        begun(0.1, None, None),
        begun(0.2, None, None),
        begun(0.1, Some(TagHeight::exact(0.0)), None),
        begun(0.1, Some(TagHeight::exact(1.0)), None),
        begun(0.1, Some(TagHeight { mean_m: 1.0, std_m: 0.5 }), None),
        begun(0.1, None, Some(&[])),
        begun(0.1, None, Some(&range(3.0, 0.01))),
        begun(0.1, None, Some(&range(3.1, 0.01))),
        begun(0.1, None, Some(&range(3.0, 0.02))),
    ];
    for (index, hash) in hashes.iter().enumerate() {
        assert!(!hashes[..index].contains(hash), "{index}: {hashes:016x?}");
    }
}

/// Each anchor has an action of its own, of another pulse: planning takes its threshold from the last anchor's frame, whichever
/// came last.
#[test]
fn frames_of_unequal_pulses_give_the_same_bits_in_any_order() {
    use cogmint_core::radio::library::Action;
    use cogmint_core::{Anchor, Config, Tracker};
    let actions = [1e-9, 2e-9, 4e-9].map(|pulse_duration_s| Action { carrier_hz: 6.5e9, pulse_duration_s });
    let anchors = [[0.0, 0.0], [9.0, 1.0]].map(|position_m| Anchor { position_m, height_m: 2.0 });
    let mut config = Config::default();
    config.controller.per_anchor = true;
    config.controller.choice.exploration_per_s = 5.0;
    config.start.position_m = [4.0, 3.0];
    let new = || {
        let mut tracker = Tracker::<2, 4, 4, 1, 8, 3, 8, 800, 6>::new();
        tracker.start(&config, &anchors, &Map::default(), &actions, 5).unwrap();
        tracker
    };
    let (mut at_once, mut one_by_one) = (new(), new());
    let mut rng = Xoshiro128PlusPlus::seed_from_u64(9);
    let mut unequal = 0;
    for cycle in 0..80 {
        let place_m = [4.0 + 0.01 * cycle as f32, 3.0];
        let frames = [0, 1].map(|anchor: usize| {
            let [x, y] = anchors[anchor].position_m;
            let delay_s = (place_m[0] - x).hypot(place_m[1] - y) / 299_792_458.0;
            std::array::from_fn::<[f32; 2], 400, _>(|n| {
                let t = (n as f32 * 0.25e-9 - delay_s) / 2e-9;
                let [re, im] = [(); 2].map(|()| rng.next_u32() as f32 * (0.2 / 4_294_967_296.0) - 0.1);
                [re + (-t * t).exp(), im]
            })
        });
        let used = [0, 1].map(|anchor| at_once.controller_of(anchor).unwrap().action_index());
        unequal += usize::from(used[0] != used[1]);
        let observations = [0, 1].map(|anchor: usize| {
            Observation::Frame(Frame {
                anchor,
                action: used[anchor],
                sequence: None,
                first_sample_delay_s: 0.0,
                samples: Samples::Complex(&frames[anchor]),
            })
        });
        let report = at_once.cycle(&observations, 0.1, None).unwrap();
        one_by_one.begin(0.1, None).unwrap();
        observations.iter().rev().for_each(|observation| one_by_one.receive(observation).unwrap());
        assert_eq!(one_by_one.finish().unwrap(), report, "cycle {cycle}");
        assert_eq!(one_by_one.hash(), at_once.hash(), "cycle {cycle}");
    }
    assert!(unequal > 5, "the pulses were equal in all but {unequal} cycles");
}
