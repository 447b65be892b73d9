//! The map alone: it outlives other settings, actions and sizes, and is of the anchors and of the map told.

use cogmint::recording::Recording;
use cogmint::replay::{AnyTracker, Setup, inputs, step};
use cogmint::scenario::Scenario;
use cogmint::simulator::Simulator;
use cogmint_core::{MapRestored, SnapshotError};
use std::path::Path;

/// A recording of the seminar room of which the tracker is told nothing but the anchors.
fn unplanned(trajectory: usize, seed: u64, cycles: usize) -> (Recording, Setup) {
    let (scenario, _) = Scenario::find("seminar-room").unwrap();
    let simulator = Simulator::new(&scenario, None, trajectory, Some(seed)).unwrap();
    let recording = simulator.record(cycles, || {});
    let mut setup = Setup::new(&recording, Path::new("seminar-room"), Some(seed)).unwrap();
    setup.map.clear();
    setup.plan = None;
    (recording, setup)
}

/// Root mean square of the error over all cycles, metres.
fn error_m<const A: usize, const S: usize, const C: usize, const P: usize>(
    tracker: &mut AnyTracker<A, S, C, P>,
    recording: &Recording,
) -> f64 {
    let mut sum = 0.0;
    for (cycle, input) in inputs(recording).enumerate() {
        let report = step(tracker, &input, &mut ()).unwrap().report;
        assert!(report.integrity.is_intact(), "cycle {cycle}: {:?}", report.integrity);
        let [x, y] = recording.cycles[cycle].truth_position_m.unwrap();
        let [own_x, own_y] = report.position_m.map(f64::from);
        sum += (own_x - x).powi(2) + (own_y - y).powi(2);
    }
    (sum / recording.cycles.len() as f64).sqrt()
}

fn map_of<const A: usize, const S: usize, const C: usize, const P: usize>(
    tracker: &AnyTracker<A, S, C, P>,
) -> Vec<u8> {
    let Err(SnapshotError::Room { needed }) = tracker.map_snapshot(&mut []) else { panic!("no room") };
    let mut bytes = vec![0; needed];
    assert_eq!(tracker.map_snapshot(&mut bytes), Ok(needed));
    bytes
}

#[test]
fn a_map_learnt_in_one_tracker_helps_another_of_other_sizes_and_settings_at_its_start() {
    let (learnt_in, setup) = unplanned(0, 11, 300);
    let mut tracker = setup.tracker::<2>().unwrap();
    error_m(&mut tracker, &learnt_in);
    let map = map_of(&tracker);
    let Err(SnapshotError::Room { needed }) = tracker.snapshot(&mut []) else { panic!("it has no room") };
    let surfaces = (0..24).filter(|slot| tracker.filter().surface(*slot).is_some()).count();
    let sources = tracker.environment().iter().count();
    println!("{} bytes of map, {needed} of all state; {surfaces} surfaces, {sources} sources", map.len());
    assert!(map.len() < needed / 4);
    let (mut with, mut without) = (0.0, 0.0);
    for seed in [21, 22, 23, 24] {
        let (recording, mut setup) = unplanned(1, seed, 30);
        setup.config.association.clutter_per_anchor *= 1.2;
        // Where it starts is hardly known: two anchors leave a place and its mirror image.
        setup.config.start.position_std_m = 3.0;
        let mut fresh = setup.target_tracker().unwrap();
        let mut other = setup.target_tracker().unwrap();
        let restored = other.restore_map(&map).unwrap();
        let MapRestored { surfaces: own, surfaces_left_out, sources: seen, sources_left_out, .. } = restored;
        assert_eq!((own + surfaces_left_out) as usize, surfaces);
        assert_eq!((seen + sources_left_out) as usize, sources);
        assert!(own <= 8);
        let errors = [error_m(&mut fresh, &recording), error_m(&mut other, &recording)];
        println!("seed {seed}: {:.3} m without the map, {:.3} m with it, {restored:?}", errors[0], errors[1]);
        without += errors[0];
        with += errors[1];
    }
    assert!(with < 0.5 * without, "{with} {without}");
}

#[test]
fn a_map_comes_back_as_it_was() {
    let (recording, setup) = unplanned(0, 11, 200);
    let mut tracker = setup.tracker::<2>().unwrap();
    error_m(&mut tracker, &recording);
    let map = map_of(&tracker);
    let mut other = setup.tracker::<2>().unwrap();
    let restored = other.restore_map(&map).unwrap();
    assert_eq!((restored.surfaces_left_out, restored.sources_left_out), (0, 0));
    assert_eq!(map_of(&other), map);
    // Another one, told a plan, likewise.
    let (scenario, _) = Scenario::find("dw3000-office").unwrap();
    let recording = Simulator::new(&scenario, None, 0, Some(7)).unwrap().record(60, || {});
    let setup = Setup::new(&recording, Path::new("office"), None).unwrap();
    let mut tracker = setup.tracker::<4>().unwrap();
    error_m(&mut tracker, &recording);
    let office = map_of(&tracker);
    let mut other = setup.tracker::<4>().unwrap();
    other.restore_map(&office).unwrap();
    assert_eq!(map_of(&other), office);
    assert_eq!(tracker.restore_map(&office), Err(SnapshotError::Begun));
}

#[test]
fn a_map_of_another_room_and_a_damaged_one_are_refused() {
    let (recording, setup) = unplanned(0, 11, 60);
    let mut tracker = setup.tracker::<2>().unwrap();
    error_m(&mut tracker, &recording);
    let map = map_of(&tracker);
    let refused = |change: &dyn Fn(&mut Setup), bytes: &[u8]| {
        let (_, mut other) = unplanned(0, 11, 2);
        change(&mut other);
        other.tracker::<2>().unwrap().restore_map(bytes)
    };
    assert!(refused(&|_| (), &map).is_ok());
    // Settings and actions may be others, anchors and what was told of the surroundings may not.
    assert!(refused(&|setup| setup.config.belief.turns_per_s = 0.3, &map).is_ok());
    assert!(refused(&|setup| setup.actions.truncate(30), &map).is_ok());
    assert_eq!(refused(&|setup| setup.anchors[0].position_m[0] += 0.01, &map), Err(SnapshotError::Told));
    let told = unplanned(0, 11, 2).1.anchors.len();
    assert_eq!(told, 2);
    let mut state = vec![0; 1 << 18];
    let length = tracker.snapshot(&mut state).unwrap();
    assert_eq!(refused(&|_| (), &state[..length]), Err(SnapshotError::Foreign));
    let (_, own) = unplanned(0, 11, 2);
    let mut other = own.tracker::<2>().unwrap();
    let before = other.hash();
    for bit in (0..8 * map.len()).step_by(7) {
        let mut flipped = map.clone();
        flipped[bit / 8] ^= 1 << (bit % 8);
        assert!(other.restore_map(&flipped).is_err(), "{bit}");
    }
    for end in 0..map.len() {
        assert!(other.restore_map(&map[..end]).is_err(), "{end}");
    }
    assert_eq!(other.hash(), before);
}
