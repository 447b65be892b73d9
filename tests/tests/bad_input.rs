//! What bad input gets: a typed error that names it, and a state unchanged to the bit.

use cogmint_core::application::waypoint::{WaypointError, WaypointSettings};
use cogmint_core::controller::reward::Reward;
use cogmint_core::model::motion::Motion;
use cogmint_core::model::observation::{
    Frame, LONGEST_SCAN, Observation, Range, RangeScan, Samples, TagHeight,
};
use cogmint_core::model::source::Source;
use cogmint_core::radio::library::{Action, LIBRARY_PUBLISHED};
use cogmint_core::{
    Anchor, Config, Error, Map, MappedVirtualAnchor, Plan, PlanSegment, PlanWall, Setting, SnapshotError,
    Tracker,
};

type Small = Tracker<2, 4, 4, 4, 8, 40, 8, 800, 6>;

const ANCHORS: [Anchor; 2] =
    [Anchor { position_m: [0.5, 7.0], height_m: 1.0 }, Anchor { position_m: [5.2, 3.2], height_m: 1.0 }];
/// A wall south of both.
const WALLS: [PlanWall; 1] = [PlanWall { offset_std_m: 0.1, rotation_std_rad: 0.01 }];
const SEGMENTS: [PlanSegment; 1] = [PlanSegment { wall: 0, ends_m: [[0.0, 0.0], [8.0, 0.0]] }];

fn config() -> Config {
    let mut config = Config::default();
    config.start.position_m = [3.0, 7.5];
    config.radio.samples_per_frame = 64;
    config.radio.full_scale = Some(1000.0);
    config
}

/// A tracker in the middle of its life.
fn tracker() -> Small {
    let virtual_anchors = [MappedVirtualAnchor { anchor: 0, position_m: [-0.5, 7.0], std_m: 0.1 }];
    let plan =
        Plan { walls: &WALLS, segments: &SEGMENTS, reflections: 1, most_sources: 1, ..Plan::default() };
    let map = Map { virtual_anchors: &virtual_anchors, plan: Some(plan) };
    let mut tracker = Small::new();
    tracker.start(&config(), &ANCHORS, &map, &LIBRARY_PUBLISHED, 5).unwrap();
    for step in 0..20 {
        let frame = samples(step as f32);
        let observations = [complex(0, &frame), complex(1, &frame)];
        tracker.cycle(&observations, 0.1, Some(TagHeight::exact(1.2))).unwrap();
    }
    tracker
}

fn samples(phase: f32) -> [[f32; 2]; 64] {
    std::array::from_fn(|n| {
        let n = n as f32;
        let pulse = 100.0 * (-(n - 30.0) * (n - 30.0) / 4.0).exp();
        [pulse + (n * 1.7 + phase).sin(), (n * 2.3 + phase).cos()]
    })
}

fn complex(anchor: usize, samples: &[[f32; 2]]) -> Observation<'_> {
    let samples = Samples::Complex(samples);
    Observation::Frame(Frame { anchor, action: 3, sequence: None, first_sample_delay_s: 0.0, samples })
}

fn magnitude(anchor: usize, samples: &[f32]) -> Observation<'_> {
    let samples = Samples::Magnitude(samples);
    Observation::Frame(Frame { anchor, action: 0, sequence: None, first_sample_delay_s: 0.0, samples })
}

/// Asserts that the call is refused with `expected` and that nothing changed.
fn refuses(observations: &[Observation<'_>], elapsed_s: f32, height: Option<TagHeight>, expected: Error) {
    let mut tracker = tracker();
    let before = format!("{tracker:?}");
    let hash = tracker.hash();
    // Debug strings, because NaN differs from itself.
    let error = tracker.cycle(observations, elapsed_s, height).unwrap_err();
    assert_eq!(format!("{error:?}"), format!("{expected:?}"));
    assert!(error.to_string().len() > 10);
    assert_eq!(tracker.hash(), hash, "state hash after {error}");
    assert_eq!(format!("{tracker:?}"), before, "state after {error}");
    // And it goes on.
    let frame = samples(0.3);
    tracker.cycle(&[complex(0, &frame)], 0.1, None).unwrap();
}

#[test]
fn samples_that_are_no_numbers_are_refused() {
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e13] {
        let mut frame = samples(0.0);
        frame[41][1] = bad;
        refuses(&[complex(1, &frame)], 0.1, None, Error::SampleNotFinite { anchor: 1, sample: 41 });
        let mut magnitudes = [1.0; 64];
        magnitudes[7] = bad;
        refuses(&[magnitude(0, &magnitudes)], 0.1, None, Error::SampleNotFinite { anchor: 0, sample: 7 });
    }
}

#[test]
fn a_bad_frame_after_a_good_one_leaves_both_out() {
    let good = samples(0.0);
    let mut bad = good;
    bad[0][0] = f32::NAN;
    let observations = [complex(0, &good), complex(1, &bad)];
    refuses(&observations, 0.1, None, Error::SampleNotFinite { anchor: 1, sample: 0 });
}

#[test]
fn silent_saturated_and_negative_frames_are_refused() {
    refuses(&[complex(0, &[[0.0; 2]; 64])], 0.1, None, Error::SilentFrame { anchor: 0 });
    let mut frame = samples(0.0);
    frame[29][0] = 1000.0;
    frame[30][0] = -1000.0;
    refuses(&[complex(0, &frame)], 0.1, None, Error::SaturatedFrame { anchor: 0, samples: 2 });
    let magnitudes = [-1.0; 64];
    refuses(&[magnitude(0, &magnitudes)], 0.1, None, Error::NegativeMagnitude { anchor: 0, sample: 0 });
}

#[test]
fn frames_of_another_length_are_refused() {
    for length in [0, 1, 63] {
        let frame = vec![[1.0, 0.0]; length];
        let expected = Error::FrameLength { anchor: 0, given: length, expected: 64 };
        refuses(&[complex(0, &frame)], 0.1, None, expected);
    }
}

#[test]
fn unknown_anchors_and_actions_are_refused() {
    let frame = samples(0.0);
    refuses(&[complex(2, &frame)], 0.1, None, Error::UnknownAnchor { anchor: 2 });
    refuses(&[complex(usize::MAX, &frame)], 0.1, None, Error::UnknownAnchor { anchor: usize::MAX });
    let Observation::Frame(frame) = complex(0, &frame) else { unreachable!() };
    let unknown = Observation::Frame(Frame { action: 40, ..frame });
    refuses(&[unknown], 0.1, None, Error::UnknownAction { action: 40 });
}

#[test]
fn duplicate_frames_are_refused_within_a_cycle_and_by_their_counter() {
    let frame = samples(0.0);
    let observations = [complex(1, &frame), complex(1, &frame)];
    refuses(&observations, 0.1, None, Error::DuplicateFrame { anchor: 1 });
    let mut tracker = tracker();
    let Observation::Frame(frame) = complex(0, &frame) else { unreachable!() };
    let counted = [Observation::Frame(Frame { sequence: Some(9), ..frame })];
    tracker.cycle(&counted, 0.1, None).unwrap();
    let hash = tracker.hash();
    assert_eq!(tracker.cycle(&counted, 0.1, None), Err(Error::DuplicateFrame { anchor: 0 }));
    assert_eq!(tracker.hash(), hash);
}

#[test]
fn time_that_stands_still_or_runs_backwards_is_refused() {
    let frame = samples(0.0);
    for elapsed_s in [0.0, -0.1, f32::NAN, f32::INFINITY, 3601.0] {
        refuses(&[complex(0, &frame)], elapsed_s, None, Error::Time { elapsed_s });
    }
}

#[test]
fn delays_and_heights_out_of_range_are_refused() {
    let frame = samples(0.0);
    for height in [f32::NAN, f32::INFINITY, 1001.0] {
        refuses(&[complex(0, &frame)], 0.1, Some(TagHeight::exact(height)), Error::TagHeight);
    }
    for std_m in [f32::NAN, f32::INFINITY, -0.1, 100.1] {
        refuses(&[complex(0, &frame)], 0.1, Some(TagHeight { mean_m: 1.0, std_m }), Error::TagHeight);
    }
    let Observation::Frame(frame) = complex(0, &frame) else { unreachable!() };
    for first_sample_delay_s in [f32::NAN, f32::INFINITY, 1e-3, -1e-3] {
        let late = Observation::Frame(Frame { first_sample_delay_s, ..frame });
        refuses(&[late], 0.1, None, Error::FrameDelay { anchor: 0 });
    }
}

#[test]
fn bad_ranges_are_refused() {
    let good = Range { range_m: 2.0, variance_m2: 0.01 };
    for range_m in [f32::NAN, f32::INFINITY, 0.0, -1.0, 30.1] {
        let ranges = [good, Range { range_m, ..good }];
        let scan = [Observation::Ranges(RangeScan { anchor: 0, ranges: &ranges })];
        refuses(&scan, 0.1, None, Error::Range { anchor: 0, index: 1 });
    }
    for variance_m2 in [f32::NAN, f32::INFINITY, 0.0, -1.0, 1e5] {
        let ranges = [Range { variance_m2, ..good }];
        let scan = [Observation::Ranges(RangeScan { anchor: 1, ranges: &ranges })];
        refuses(&scan, 0.1, None, Error::RangeVariance { anchor: 1, index: 0 });
    }
    let many = [good; LONGEST_SCAN + 1];
    let scan = [Observation::Ranges(RangeScan { anchor: 1, ranges: &many })];
    refuses(&scan, 0.1, None, Error::RangeCount { anchor: 1, given: 4097, limit: 4096 });
    // Far behind those that there is room for, and worse than all of them.
    let mut many = [good; LONGEST_SCAN];
    many[4000].variance_m2 = f32::NAN;
    let scan = [Observation::Ranges(RangeScan { anchor: 1, ranges: &many })];
    refuses(&scan, 0.1, None, Error::RangeVariance { anchor: 1, index: 4000 });
}

/// The tracker holds eight: the test itself picks them, by crossing out the worst until eight are left.
#[test]
fn of_too_many_ranges_the_best_are_kept_in_their_order() {
    let mut state = 7_u64;
    let mut random = move |below: u64| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) % below
    };
    let tracker = tracker();
    for round in 0..200 {
        let count = if round == 0 { LONGEST_SCAN as u64 } else { 1 + random(60) };
        // Few different values, so that many are equal.
        let ranges: Vec<Range> = (0..count)
            .map(|_| Range {
                range_m: 2.0 + 0.5 * random(20) as f32,
                variance_m2: [0.01, 0.04, 0.09][random(3) as usize],
            })
            .collect();
        let mut best = ranges.clone();
        while best.len() > 8 {
            let largest = best.iter().map(|range| range.variance_m2).fold(0.0, f32::max);
            let of_it = |range: &&Range| range.variance_m2 == largest;
            let longest = best.iter().filter(of_it).map(|range| range.range_m).fold(0.0, f32::max);
            let worst =
                best.iter().rposition(|range| range.variance_m2 == largest && range.range_m == longest);
            best.remove(worst.unwrap());
        }
        let outcome = |ranges: &[Range]| {
            let mut tracker = tracker.clone();
            let scan = Observation::Ranges(RangeScan { anchor: 0, ranges });
            let report = tracker.cycle(&[scan], 0.1, Some(TagHeight::exact(1.2))).unwrap();
            (report.left_out, report.measurements, tracker.hash())
        };
        let (left_out, measurements, hash) = outcome(&ranges);
        assert_eq!(u64::from(left_out), count.saturating_sub(8), "round {round}");
        assert_eq!(outcome(&best), (0, measurements, hash), "round {round}");
    }
}

#[test]
fn missing_frames_mean_prediction_only_and_growing_entropy() {
    let mut tracker = tracker();
    let mut entropy = f32::NEG_INFINITY;
    for _ in 0..50 {
        let report = tracker.cycle(&[], 0.1, None).unwrap();
        assert_eq!((report.anchors_heard, report.measurements), (0, 0));
        assert_eq!(report.entropy_nat, report.predicted_entropy_nat);
        assert!(report.entropy_nat > entropy);
        entropy = report.entropy_nat;
    }
}

#[test]
fn a_long_gap_grows_the_uncertainty_up_to_the_reach_of_the_radio() {
    let mut config = config();
    // At constant velocity, an hour leads anywhere.
    config.motion.velocity_decay_s = f32::INFINITY;
    let mut tracker = Small::new();
    tracker.start(&config, &ANCHORS, &Map::default(), &LIBRARY_PUBLISHED, 5).unwrap();
    let gap = tracker.cycle(&[], 3600.0, None).unwrap();
    let reach = config.ranging.max_range_m;
    assert!(gap.entropy_nat.is_finite());
    assert!((gap.position_covariance_m2.m11.sqrt() / reach - 1.0).abs() < 1e-3);
}

#[test]
fn hours_without_any_frame_leave_every_number_finite() {
    for (acceleration, reward) in [
        (100.0, Reward::InformationGain),
        (0.01, Reward::EntropyChange),
        (100.0, Reward::Published { scale: 1e24 }),
        (1e-6, Reward::Published { scale: 1e-30 }),
    ] {
        let mut config = config();
        config.motion.acceleration_density_m2_s3 = acceleration;
        config.start.position_std_m = 1000.0;
        config.start.velocity_std_m_s = 1000.0;
        config.ranging.bias_std_m = 0.15;
        config.controller.reward = reward;
        let mut tracker = Small::new();
        tracker.start(&config, &ANCHORS, &Map::default(), &LIBRARY_PUBLISHED, 1).unwrap();
        for cycle in 0..3000 {
            let report = tracker.cycle(&[], 3600.0, None).unwrap();
            assert!(report.entropy_nat.is_finite() && report.reward.is_finite(), "cycle {cycle}: {report:?}");
        }
        let controller = tracker.controller_of(0).unwrap();
        assert!(controller.values().values().iter().chain(controller.policy()).all(|v| v.is_finite()));
        tracker.filter().visit(|v| assert!(v.is_finite()));
        // A bias nobody observes stays as unknown as it was.
        assert!(tracker.filter().bias_m(1).unwrap().1 <= 0.15 * 0.15 * 1.001);
    }
}

#[test]
fn frames_of_any_accepted_strength_leave_every_number_finite() {
    for strength in [1e-18_f32, 1e-12, 1e-6, 1.0, 1e6, 9e11 / 200.0] {
        for quiet in [1.0_f32, 1e-10, 0.0] {
            let mut config = config();
            config.radio.full_scale = None;
            let mut tracker = Small::new();
            tracker.start(&config, &ANCHORS, &Map::default(), &LIBRARY_PUBLISHED, 1).unwrap();
            for cycle in 0..30 {
                let frame = samples(cycle as f32).map(|sample| {
                    let loud = if sample[0].abs() > 20.0 { strength } else { strength * quiet };
                    sample.map(|part| part * loud)
                });
                tracker.cycle(&[complex(0, &frame), complex(1, &frame)], 0.1, None).unwrap();
            }
            tracker.channel().visit(|v| assert!(v.is_finite(), "strength {strength}, quiet {quiet}"));
            tracker.filter().visit(|v| assert!(v.is_finite(), "strength {strength}, quiet {quiet}"));
        }
    }
}

#[test]
fn configurations_out_of_range_are_refused() {
    let refuse = |change: fn(&mut Config), setting: Setting| {
        let mut config = config();
        change(&mut config);
        let outcome = Small::new().start(&config, &ANCHORS, &Map::default(), &LIBRARY_PUBLISHED, 1);
        assert_eq!(outcome, Err(Error::Configuration(setting)));
    };
    refuse(|c| c.motion.acceleration_density_m2_s3 = f32::NAN, Setting::AccelerationDensity);
    refuse(|c| c.motion.velocity_decay_s = 0.0, Setting::VelocityDecay);
    refuse(|c| c.start.position_m[1] = f32::INFINITY, Setting::StartPosition);
    refuse(|c| c.start.position_std_m = 0.0, Setting::StartDeviation);
    refuse(|c| c.ranging.floor_m = 0.0, Setting::RangeFloor);
    refuse(|c| c.association.detection_probability = 1.0, Setting::DetectionProbability);
    refuse(|c| c.association.clutter_per_anchor = 0.0, Setting::ClutterPerAnchor);
    refuse(|c| c.radio.sample_spacing_s = 0.0, Setting::SampleSpacing);
    refuse(|c| c.radio.samples_per_frame = 15, Setting::SampleCount);
    refuse(|c| c.radio.false_paths_per_frame = 0.0, Setting::FalsePaths);
    refuse(|c| c.estimator.dense_decay_s = 1e-10, Setting::DenseDecay);
    refuse(|c| c.estimator.dense_decay_pulses = 0.0, Setting::DenseDecay);
    refuse(|c| c.work.anchor = 19_999, Setting::AnchorWork);
    refuse(|c| c.estimator.merge_pulses = f32::NAN, Setting::MergeDistance);
    refuse(|c| c.belief.elsewhere_per_s = 0.0, Setting::Elsewhere);
    refuse(|c| c.belief.outages_per_s = -1.0, Setting::Outages);
    refuse(|c| c.belief.returns_per_s = 0.0, Setting::Outages);
    refuse(|c| c.belief.split_above_m = 0.0, Setting::SplitAbove);
    refuse(|c| c.work.comparisons = 0, Setting::Comparisons);
    refuse(|c| c.discovery_settings.begin_below_m = 2.0, Setting::DiscoveryBegin);
    refuse(|c| c.discovery_settings.resolved_hits = 1, Setting::DiscoveryHits);
    refuse(|c| c.discovery_settings.resolved_weight = 1.0, Setting::DiscoveryWeight);
    refuse(|c| c.controller.choice.temperature_nat = 0.0, Setting::Temperature);
    refuse(|c| c.controller.horizon = 0, Setting::Horizon);
    refuse(|c| c.controller.first_action = 40, Setting::FirstAction);
}

#[test]
fn a_tracker_that_is_not_started_takes_nothing_and_one_whose_start_was_refused_is_as_new() {
    let (frame, empty) = (samples(0.0), Small::new());
    let assert_empty = |tracker: &mut Small| {
        assert_eq!(tracker.hash(), empty.hash());
        assert_eq!(tracker.cycle(&[complex(0, &frame)], 0.1, None), Err(Error::NotStarted));
        assert_eq!(tracker.begin(0.1, None), Err(Error::NotStarted));
        assert_eq!(tracker.receive(&complex(0, &frame)), Err(Error::NotStarted));
        assert_eq!(tracker.finish(), Err(Error::NotStarted));
        assert_eq!(tracker.snapshot(&mut [0; 65_536]), Err(SnapshotError::NotStarted));
        assert_eq!(tracker.restore(&[]), Err(SnapshotError::NotStarted));
        assert_eq!(tracker.restrict(0, &[1]), Err(Error::UnknownAnchor { anchor: 0 }));
        assert!(tracker.tell_channel(Source::Direct { anchor: 0 }, &[]).is_err());
        let way = WaypointSettings { speed_m_s: 1.0, period_s: 0.1, metres_per_nat: 1.0 };
        assert_eq!(tracker.choose_waypoint(&[[1.0; 2]], None, None, &way), Err(WaypointError::Searching));
        assert_eq!(tracker.hash(), empty.hash());
        // All of it, not what is hashed alone.
        assert_eq!(format!("{tracker:?}"), format!("{empty:?}"));
    };
    assert_empty(&mut Small::new());
    let image = MappedVirtualAnchor { anchor: 0, position_m: [1.0, 1.0], std_m: 0.1 };
    let far = Anchor { position_m: [f32::NAN, 0.0], height_m: 0.0 };
    let wild = Config { motion: Motion { velocity_decay_s: 0.0, ..config().motion }, ..config() };
    let none = Plan { walls: &WALLS, segments: &[], ..Plan::default() };
    let refused: [(Config, &[Anchor], Map<'_>, &[Action]); 5] = [
        (wild, &ANCHORS, Map::default(), &LIBRARY_PUBLISHED),
        (config(), &[far], Map::default(), &LIBRARY_PUBLISHED),
        (config(), &ANCHORS, Map { virtual_anchors: &[image; 5], plan: None }, &LIBRARY_PUBLISHED),
        (config(), &ANCHORS, Map { virtual_anchors: &[], plan: Some(none) }, &LIBRARY_PUBLISHED),
        (config(), &ANCHORS, Map::default(), &[]),
    ];
    for (config, anchors, map, actions) in &refused {
        for mut tracker in [Small::new(), tracker()] {
            assert!(tracker.start(config, anchors, map, actions, 5).is_err());
            assert_empty(&mut tracker);
        }
    }
}

#[test]
fn a_tracker_that_is_started_again_is_as_one_that_never_ran() {
    let start = |tracker: &mut Small| {
        tracker.start(&config(), &ANCHORS, &Map::default(), &LIBRARY_PUBLISHED, 5).unwrap();
    };
    let (mut fresh, mut again) = (Small::new(), tracker());
    start(&mut fresh);
    // In the middle of a cycle, too.
    again.begin(0.1, None).unwrap();
    again.receive(&complex(1, &samples(3.0))).unwrap();
    start(&mut again);
    assert_eq!(format!("{fresh:?}"), format!("{again:?}"));
    for step in 0..20 {
        let frame = samples(step as f32);
        let observations = [complex(0, &frame), complex(1, &frame)];
        let reports = [&mut fresh, &mut again].map(|own| own.cycle(&observations, 0.1, None).unwrap());
        assert_eq!(reports[0], reports[1]);
        assert_eq!(fresh.hash(), again.hash());
    }
}

#[test]
fn anchors_maps_and_libraries_out_of_range_are_refused() {
    let new = |anchors: &[Anchor], virtual_anchors: &[MappedVirtualAnchor], actions: &[Action]| {
        let map = Map { virtual_anchors, plan: None };
        Small::new().start(&config(), anchors, &map, actions, 1).unwrap_err()
    };
    assert_eq!(new(&[], &[], &LIBRARY_PUBLISHED), Error::AnchorCount { given: 0, limit: 2 });
    assert_eq!(new(&[ANCHORS[0]; 3], &[], &LIBRARY_PUBLISHED), Error::AnchorCount { given: 3, limit: 2 });
    let far = Anchor { position_m: [f32::NAN, 0.0], height_m: 0.0 };
    assert_eq!(new(&[ANCHORS[0], far], &[], &LIBRARY_PUBLISHED), Error::Geometry { index: 1 });
    let image = MappedVirtualAnchor { anchor: 0, position_m: [1.0, 1.0], std_m: 0.1 };
    assert_eq!(
        new(&ANCHORS, &[image; 5], &LIBRARY_PUBLISHED),
        Error::VirtualAnchorCount { given: 5, limit: 4 }
    );
    let orphan = MappedVirtualAnchor { anchor: 2, ..image };
    assert_eq!(new(&ANCHORS, &[orphan], &LIBRARY_PUBLISHED), Error::UnknownAnchor { anchor: 2 });
    let vague = MappedVirtualAnchor { std_m: f32::NAN, ..image };
    assert_eq!(new(&ANCHORS, &[vague], &LIBRARY_PUBLISHED), Error::Geometry { index: 0 });
    // A deviation of 0 is known exactly; one far below what single precision tells of a room is a mistake.
    for std_m in [9e-5, -1e-4, 101.0, f32::INFINITY] {
        let image = MappedVirtualAnchor { std_m, ..image };
        assert_eq!(new(&ANCHORS, &[image], &LIBRARY_PUBLISHED), Error::Geometry { index: 0 });
    }
    let exact = MappedVirtualAnchor { std_m: 0.0, ..image };
    let known = Map { virtual_anchors: &[exact], plan: None };
    assert!(Small::new().start(&config(), &ANCHORS, &known, &LIBRARY_PUBLISHED, 1).is_ok());
    assert_eq!(new(&ANCHORS, &[], &[]), Error::Configuration(Setting::LibraryEmpty));
    let planned = |plan| {
        let map = Map { virtual_anchors: &[], plan: Some(plan) };
        Small::new().start(&config(), &ANCHORS, &map, &LIBRARY_PUBLISHED, 1).unwrap_err()
    };
    let plan = Plan { walls: &WALLS, segments: &SEGMENTS, ..Plan::default() };
    assert_eq!(planned(Plan { segments: &[SEGMENTS[0]; 5], ..plan }), Error::PlanSize { given: 5, limit: 4 });
    assert_eq!(planned(Plan { segments: &[], ..plan }), Error::PlanWall { index: 0 });
    assert_eq!(planned(Plan { walls: &[], ..plan }), Error::PlanSegment { index: 0 });
    assert_eq!(planned(Plan { outline_m: &[[0.0; 2]; 2], ..plan }), Error::PlanOutline { index: 2 });
    assert_eq!(planned(Plan { turn_std_rad: f32::NAN, ..plan }), Error::PlanSettings);
    assert_eq!(planned(Plan { reflections: 3, ..plan }), Error::PlanSettings);
}

/// Not a proof, a net: whatever passes the checks must leave a finite state, and whatever does not must leave it
/// alone.
#[test]
fn random_frames_never_panic_and_never_leave_a_number_that_is_none() {
    let mut state = 12_345_u64;
    let mut random = move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as u32
    };
    let mut tracker = tracker();
    let mut refused = 0;
    for round in 0..3000 {
        let kind = random() % 6;
        let frame: Vec<[f32; 2]> = (0..64)
            .map(|_| match kind {
                0 => [f32::from_bits(random()), f32::from_bits(random())],
                1 => [1e-20 * (random() % 1000) as f32, 0.0],
                2 => [500.0, 0.0],
                3 => [(random() % 2000) as f32 - 1000.0, (random() % 100) as f32],
                4 => [if random() % 64 == 0 { 900.0 } else { 1e-3 }, 0.0],
                _ => [(random() % 100) as f32, (random() % 100) as f32],
            })
            .collect();
        let ranges: Vec<Range> = (0..random() % 9)
            .map(|_| Range {
                range_m: (random() % 3100) as f32 * 0.01,
                variance_m2: 1e-6 * (1 + random() % 10_000) as f32,
            })
            .collect();
        let observations =
            [complex(0, &frame), Observation::Ranges(RangeScan { anchor: 1, ranges: &ranges })];
        let before = tracker.hash();
        let elapsed_s = [0.01, 0.1, 1.0, 60.0][random() as usize % 4];
        match tracker.cycle(&observations, elapsed_s, None) {
            Err(_) => {
                refused += 1;
                assert_eq!(tracker.hash(), before);
            }
            Ok(report) => {
                assert!(report.entropy_nat.is_finite(), "round {round}: {report:?}");
                assert!(report.position_m.iter().all(|x| x.is_finite()), "round {round}");
                tracker.filter().visit(|v| assert!(v.is_finite(), "round {round}"));
                tracker.channel().visit(|v| assert!(v.is_finite(), "round {round}"));
                tracker.discovery().visit(|v| assert!(v.is_finite(), "round {round}"));
            }
        }
    }
    assert!(refused > 300 && refused < 2900, "{refused} refused: the test must see both outcomes");
}

#[test]
fn each_anchor_keeps_to_the_actions_it_may_use() {
    let mut config = config();
    config.controller.per_anchor = true;
    config.controller.choice.exploration_per_s = 5.0;
    config.controller.first_action = 30;
    let mut tracker = Small::new();
    tracker.start(&config, &ANCHORS, &Map::default(), &LIBRARY_PUBLISHED, 1).unwrap();
    assert_eq!(tracker.restrict(9, &[1]), Err(Error::UnknownAnchor { anchor: 9 }));
    assert_eq!(tracker.restrict(0, &[1, 40]), Err(Error::UnknownAction { action: 40 }));
    assert_eq!(tracker.restrict(0, &[]), Err(Error::Configuration(Setting::Restriction)));
    tracker.restrict(0, &[3, 4, 5]).unwrap();
    assert_eq!(tracker.restrict(0, &[6]), Err(Error::Configuration(Setting::Restriction)));
    assert!(tracker.controller_of(ANCHORS.len()).is_none());
    let mut used = [[false; 40]; 2];
    for _ in 0..400 {
        tracker.cycle(&[], 0.1, None).unwrap();
        for (anchor, used) in used.iter_mut().enumerate() {
            used[tracker.controller_of(anchor).unwrap().action_index()] = true;
        }
    }
    let count = |used: &[bool]| used.iter().filter(|used| **used).count();
    assert!(count(&used[0]) == 3 && used[0][3..6].iter().all(|used| *used));
    assert!(count(&used[1]) > 10);
}

#[test]
fn only_what_can_be_is_told() {
    let mut tracker = tracker();
    let hash = tracker.hash();
    let sinr = [10.0; 40];
    let anchor_0 = Source::Direct { anchor: 0 };
    for source in [
        Source::Direct { anchor: 2 },
        Source::Virtual { anchor: 0, slot: 500 },
        Source::Virtual { anchor: 1, slot: 0 },
        Source::Virtual { anchor: 0, slot: 3 },
    ] {
        assert_eq!(tracker.tell_channel(source, &sinr), Err(Error::ToldSinr), "{source:?}");
    }
    for bad in [f32::NAN, f32::INFINITY, -1.0] {
        let mut sinr = sinr;
        sinr[7] = bad;
        assert_eq!(tracker.tell_channel(anchor_0, &sinr), Err(Error::ToldSinr), "{bad}");
    }
    assert_eq!(tracker.tell_channel(anchor_0, &sinr[..39]), Err(Error::ToldSinr));
    assert_eq!(tracker.hash(), hash);
    // From here on it is a memory of the full band, which its hash tells.
    tracker.tell_channel(anchor_0, &sinr).unwrap();
    assert!(tracker.channel().is_full_band());
    assert_ne!(tracker.hash(), hash);
}
