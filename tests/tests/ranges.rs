//! Ranges of a radio that is blocked now and then, of two antennas on one body, one range a cycle: what knowing of it is worth, and
//! core and reference in every bit.

mod range_recording;

use cogmint::channel::random::{Purpose, normal, stream, uniform};
use cogmint::recording::{Antenna, Cycle, Motion, Range, Recording};
use cogmint::replay::{LARGE_ANCHORS, Setup};
use cogmint::track::track;
use cogmint::verify::verify;
use cogmint_core::{Anchor, Config, Error, Map, Setting, Tracker};
use range_recording::recording_of_ranges;
use std::path::Path;

/// Anchors about a hall, metres.
const ANCHORS_M: [[f64; 2]; 5] = [[-4.0, -3.0], [4.5, -3.5], [5.0, 3.0], [-0.5, 4.5], [-5.0, 2.5]];
const ARM_M: f64 = 0.25;
const NOISE_M: f64 = 0.07;
/// Share of late ranges of even and of odd anchors, and their mean excess, metres.
const LATE: ([f64; 2], f64) = ([0.1, 0.4], 0.5);
const PERIOD_S: f64 = 0.2;

/// A body that walks and turns, its antennas in turn.
fn flight(seed: u64, cycles: usize) -> Recording {
    let mut rng = stream(seed, Purpose::Experiment, &[0]);
    let (density_m2_s3, decay_s) = (0.1, 2.0);
    let ([mut x, mut y], [mut u, mut v], mut heading) = ([0.0, 0.0], [0.2, 0.1], 0.5);
    let cycle = |step: usize| {
        for _ in 0..20 {
            let dt = PERIOD_S / 20.0;
            (x, y) = (x + u * dt, y + v * dt);
            let kick = f64::sqrt(density_m2_s3 * dt);
            u = u * (1.0 - dt / decay_s) + kick * normal(&mut rng);
            v = v * (1.0 - dt / decay_s) + kick * normal(&mut rng);
            heading += f64::sqrt(0.1 * dt) * normal(&mut rng);
        }
        let (antenna, anchor) = (step % 2, step % ANCHORS_M.len());
        let arm_m = if antenna == 0 { ARM_M } else { -ARM_M };
        let [ax, ay] = ANCHORS_M[anchor];
        let length_m = (x + arm_m * heading.cos() - ax).hypot(y + arm_m * heading.sin() - ay);
        let (shares, mean_m) = LATE;
        let is_late = uniform(&mut rng) < shares[anchor % 2];
        let excess_m = if is_late { -mean_m * uniform(&mut rng).ln() } else { 0.0 };
        let range_m = length_m + NOISE_M * normal(&mut rng) + excess_m;
        Cycle {
            ranges: vec![Range { anchor, range_m, std_m: None, angles: None }],
            time_s: PERIOD_S * step as f64,
            truth_position_m: Some([x, y]),
            antenna: Some(antenna),
            ..Cycle::default()
        }
    };
    let antenna = |name: &str, arm_m: f64| Antenna { name: name.into(), lever_arm_m: Some([arm_m, 0.0]) };
    let motion = Motion {
        acceleration_density_m2_s3: Some(density_m2_s3),
        velocity_decay_s: Some(decay_s),
        ..Motion::default()
    };
    let anchors = ANCHORS_M.map(|position_m| (position_m, 0.0));
    let cycles = (0..cycles).map(cycle).collect();
    let mut recording = recording_of_ranges(format!("flight {seed}"), anchors, motion, cycles);
    recording.association.clutter_per_anchor = 0.01;
    recording.radio.range_std_m = NOISE_M;
    recording.radio.range_bias_std_m = 0.1;
    recording.radio.range_late_m = 1.0;
    recording.antennas = vec![antenna("front", ARM_M), antenna("back", -ARM_M)];
    recording
}

/// Root mean square errors in metres, at once and a second later, and the NEES, over some flights.
fn errors(change: impl Fn(&mut Recording)) -> [f64; 3] {
    let mut sums = [0.0; 3];
    const FLIGHTS: u64 = 6;
    for seed in 1..=FLIGHTS {
        let mut recording = flight(seed, 600);
        change(&mut recording);
        let file = Path::new("a flight");
        let run = track(&recording, file, Some(seed), || {}).unwrap();
        let setup = Setup::new(&recording, file, Some(seed)).unwrap();
        let late_m = run.lagged(&setup, &recording, 1.0).rmse_m.unwrap();
        let own = [run.score.rmse_m.unwrap(), late_m, run.consistency.nees.unwrap()];
        sums = std::array::from_fn(|n| sums[n] + own[n] / FLIGHTS as f64);
    }
    sums
}

#[test]
fn who_knows_of_late_ranges_and_of_the_body_is_better_off_and_knows_by_how_much() {
    let knowing = errors(|_| ());
    // The deviation of all errors, for who takes them as Gaussian.
    let gaussian = errors(|recording| {
        recording.radio.range_late_m = 0.0;
        recording.radio.range_std_m = 0.35;
    });
    let one_point = errors(|recording| {
        for antenna in &mut recording.antennas {
            antenna.lever_arm_m = None;
        }
    });
    println!(
        "RMSE at once, a second later, NEES: {knowing:?}; Gaussian {gaussian:?}; one point {one_point:?}"
    );
    let [at_once, later, nees] = knowing;
    assert!(at_once < 0.9 * gaussian[0] && at_once < 0.8 * one_point[0]);
    assert!(later < 0.7 * at_once);
    assert!((0.5..2.0).contains(&nees) && one_point[2] > 1.3 * nees);
}

#[test]
fn lateness_is_learnt_of_every_anchor() {
    let recording = flight(11, 1500);
    let setup = Setup::new(&recording, Path::new("a flight"), Some(1)).unwrap();
    let mut tracker = setup.tracker::<LARGE_ANCHORS>().unwrap();
    for input in cogmint::replay::inputs(&recording) {
        cogmint::replay::step(&mut tracker, &input, &mut ()).unwrap();
    }
    let (shares, mean_m) = LATE;
    for anchor in 0..ANCHORS_M.len() {
        let learnt = tracker.lateness().of(anchor);
        println!("anchor {anchor}: {learnt:?}");
        assert!((f64::from(learnt.share) - shares[anchor % 2]).abs() < 0.2, "{anchor}: {learnt:?}");
        assert!((f64::from(learnt.mean_m) / mean_m).ln().abs() < 0.7, "{anchor}: {learnt:?}");
    }
    let share = |anchor: usize| tracker.lateness().of(anchor).share;
    assert!(share(1).min(share(3)) > share(0).max(share(2)).max(share(4)));
}

/// Two anchors are long for good, as behind a wall; who knows is told by about how much, and that the others are calibrated.
fn behind_walls(recording: &mut Recording, is_told: bool) {
    const LONG_M: [f64; 2] = [0.9, 0.6];
    for cycle in &mut recording.cycles {
        for range in &mut cycle.ranges {
            range.range_m += LONG_M.get(range.anchor).copied().unwrap_or(0.0);
        }
    }
    if is_told {
        for (index, anchor) in recording.anchors.iter_mut().enumerate() {
            let long_m = LONG_M.get(index).map(|long_m| long_m + 0.1);
            anchor.range_bias_mean_m = long_m;
            anchor.range_bias_std_m = Some(if long_m.is_some() { 0.2 } else { 0.02 });
        }
    }
}

#[test]
fn a_bias_told_of_each_anchor_is_worth_more_than_one_for_all() {
    let told = errors(|recording| behind_walls(recording, true));
    let untold = errors(|recording| behind_walls(recording, false));
    let all_alike = errors(|recording| {
        behind_walls(recording, false);
        recording.radio.range_bias_mean_m = 0.3;
        recording.radio.range_bias_std_m = 0.4;
    });
    let free = errors(|_| ());
    println!(
        "told {told:?}; one for all, as it was {untold:?}, as it is {all_alike:?}; nobody is behind {free:?}"
    );
    assert!(told[0] < 0.8 * untold[0] && told[0] < 0.95 * all_alike[0] && told[0] < 1.2 * free[0]);
    assert!((0.5..2.0).contains(&told[2]), "{told:?}");
}

#[test]
fn a_bias_is_told_of_an_anchor_there_is_before_the_first_cycle() {
    let recording = flight(2, 1);
    let setup = Setup::new(&recording, Path::new("a flight"), Some(1)).unwrap();
    let mut tracker = setup.tracker::<LARGE_ANCHORS>().unwrap();
    let bias = |error| Err(Error::Configuration(error));
    assert_eq!(tracker.tell_range_bias(5, 0.1, 0.1), Err(Error::UnknownAnchor { anchor: 5 }));
    for (mean_m, std_m) in [(f32::NAN, 0.1), (10.5, 0.1), (0.1, f32::NAN), (0.1, -0.1), (0.1, 11.0)] {
        assert_eq!(tracker.tell_range_bias(0, mean_m, std_m), bias(Setting::BiasPrior));
    }
    assert_eq!(tracker.filter().bias_m(0), Some((0.0, 0.1_f32 * 0.1)));
    tracker.tell_range_bias(0, 0.5, 0.0).unwrap();
    tracker.tell_range_bias(1, -0.2, 0.3).unwrap();
    let expected = [(0.5, 0.0), (-0.2, 0.3_f32 * 0.3), (0.0, 0.1_f32 * 0.1)];
    for (anchor, expected) in expected.into_iter().enumerate() {
        assert_eq!(tracker.filter().bias_m(anchor), Some(expected));
    }
    tracker.begin(0.1, None).unwrap();
    assert_eq!(tracker.tell_range_bias(0, 0.1, 0.1), Err(Error::AlreadyBegun));
    tracker.finish().unwrap();
    assert_eq!(tracker.tell_range_bias(0, 0.1, 0.1), Err(Error::AlreadyBegun));
    // Known exactly, it stays.
    assert_eq!(tracker.filter().bias_m(0), Some((0.5, 0.0)));
}

#[test]
fn core_and_reference_agree_in_every_bit() {
    let alike = flight(3, 150);
    let mut apart = flight(4, 150);
    behind_walls(&mut apart, true);
    let mut one_alone = flight(5, 150);
    one_alone.radio.range_bias_std_m = 0.0;
    one_alone.anchors[2].range_bias_std_m = Some(0.3);
    for recording in [alike, apart, one_alone] {
        let outcome = verify(&recording, Path::new("a flight"), Some(3), None, |_| ()).unwrap();
        assert!(outcome.equal && outcome.cycles == 150, "{:?}", outcome.first_difference);
    }
}

#[test]
fn a_bias_beyond_what_the_tracker_takes_is_refused_by_key_and_anchor() {
    let refused = |change: &dyn Fn(&mut Recording)| {
        let mut recording = flight(3, 2);
        change(&mut recording);
        Setup::new(&recording, Path::new("a flight"), None).map(|_| ()).unwrap_err().to_string()
    };
    let name = flight(3, 2).anchors[1].name.clone();
    let mean = refused(&|recording| recording.anchors[1].range_bias_mean_m = Some(-10.5));
    assert!(mean.contains("`anchors.1.range_bias_mean_m`") && mean.contains(&format!("{name:?}")), "{mean}");
    assert!(mean.ends_with("allowed is -10 to 10."), "{mean}");
    let std = refused(&|recording| recording.anchors[1].range_bias_std_m = Some(11.0));
    assert!(std.contains("`anchors.1.range_bias_std_m`") && std.ends_with("allowed is 0 to 10."), "{std}");
    let all = refused(&|recording| recording.radio.range_bias_mean_m = 10.5);
    assert!(all.contains("radio.range_bias_mean_m"), "{all}");
}

#[test]
fn an_antenna_beside_the_centre_needs_a_heading() {
    type Small = Tracker<1, 2, 2, 2, 4, 2, 2, 0, 6>;
    let anchors = [Anchor { position_m: [0.0, 0.0], height_m: 0.0 }];
    let library = &cogmint_core::radio::library::LIBRARY_DW3000;
    let mut plain = Small::new();
    plain.start(&Config::default(), &anchors, &Map::default(), library, 1).unwrap();
    assert_eq!(plain.switch_antenna([0.2, 0.0]), Err(Error::LeverArm));
    assert_eq!(plain.switch_antenna([0.0, 0.0]), Ok(()));
    let config = Config { has_heading: true, ..Config::default() };
    let mut body = Small::new();
    body.start(&config, &anchors, &Map::default(), library, 1).unwrap();
    for wrong in [[f32::NAN, 0.0], [0.0, 2e3]] {
        assert_eq!(body.switch_antenna(wrong), Err(Error::LeverArm));
    }
    assert_eq!(body.switch_antenna([0.2, -0.1]), Ok(()));
    let (mean, covariance) = body.filter().heading().unwrap();
    assert_eq!((mean.x, mean.y, covariance.m11, covariance.m22), (0.0, 0.0, 0.5, 0.5));
    body.begin(0.1, None).unwrap();
    assert_eq!(body.switch_antenna([0.1, 0.0]), Err(Error::AlreadyBegun));
}
