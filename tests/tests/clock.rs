//! The clock: what the tracker makes of a walk depends on when it was measured, not on how often cycles pass.

use cogmint_core::model::motion::{Agent, Motion};
use cogmint_core::model::observation::{Observation, Range, RangeScan};
use cogmint_core::model::surface::Surface;
use cogmint_core::perceptor::state_filter::StateFilter;
use cogmint_core::radio::library::Action;
use cogmint_core::{Anchor, Config, Map, Tracker};
use nalgebra::{Matrix4, Vector2, Vector4};
use rand_core::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro128PlusPlus;

type Small = Tracker<4, 4, 4, 1, 8, 1, 16, 800, 6>;

const ANCHORS: [Anchor; 4] = [
    Anchor { position_m: [0.0, 0.0], height_m: 2.5 },
    Anchor { position_m: [12.0, 0.0], height_m: 2.5 },
    Anchor { position_m: [12.0, 9.0], height_m: 2.5 },
    Anchor { position_m: [0.0, 9.0], height_m: 2.5 },
];
const START_M: [f64; 2] = [6.0, 4.5];
const RANGE_STD_M: f64 = 0.1;

struct Noise(Xoshiro128PlusPlus);

impl Noise {
    fn new(seed: u64) -> Self {
        Self(Xoshiro128PlusPlus::seed_from_u64(seed))
    }

    fn uniform(&mut self) -> f64 {
        (f64::from(self.0.next_u32()) + 0.5) / 4_294_967_296.0
    }

    fn normal(&mut self) -> f64 {
        (-2.0 * self.uniform().ln()).sqrt() * (std::f64::consts::TAU * self.uniform()).cos()
    }
}

fn motion(velocity_decay_s: f32) -> Motion {
    Motion { acceleration_density_m2_s3: 0.1, velocity_decay_s, ..Config::default().motion }
}

fn tracker(velocity_decay_s: f32) -> Small {
    let mut config = Config { motion: motion(velocity_decay_s), ..Config::default() };
    config.start.position_m = START_M.map(|x| x as f32);
    config.start.position_std_m = 0.5;
    config.start.velocity_std_m_s = 0.7;
    config.ranging.max_range_m = 30.0;
    let actions = [Action { carrier_hz: 7e9, pulse_duration_s: 2e-9 }];
    let mut tracker = Small::new();
    tracker.start(&config, &ANCHORS, &Map::default(), &actions, 1).unwrap();
    tracker
}

/// The ranges of all anchors at a place of the tag, as high as the anchors.
fn measured(place_m: [f64; 2], noise: &mut Noise) -> Vec<(usize, Range)> {
    let range = |(anchor, own): (usize, &Anchor)| {
        let [x, y] = own.position_m.map(f64::from);
        let range_m = (place_m[0] - x).hypot(place_m[1] - y) + RANGE_STD_M * noise.normal();
        (anchor, Range { range_m: range_m as f32, variance_m2: (RANGE_STD_M * RANGE_STD_M) as f32 })
    };
    ANCHORS.iter().enumerate().map(range).collect()
}

/// One cycle of ranges; none where nothing was measured.
fn cycle(tracker: &mut Small, ranges: &[(usize, Range)], elapsed_s: f32) -> bool {
    let scans: Vec<Observation<'_>> = ranges
        .iter()
        .map(|(anchor, range)| {
            Observation::Ranges(RangeScan { anchor: *anchor, ranges: std::slice::from_ref(range) })
        })
        .collect();
    let report = tracker.cycle(&scans, elapsed_s, None).unwrap();
    report.searching
}

/// Means and deviations of [x, y, u, v].
fn moments(agent: &Agent) -> ([f64; 4], [f64; 4]) {
    let mean = std::array::from_fn(|i| f64::from(agent.mean[i]));
    (mean, std::array::from_fn(|i| f64::from(agent.covariance[(i, i)]).sqrt()))
}

#[test]
fn a_walk_sampled_at_1_10_and_100_hertz_gives_trackers_that_agree() {
    for velocity_decay_s in [1.5, 10.0, f32::INFINITY] {
        // Measured once a second.
        let mut noise = Noise::new(3);
        let way = drawn_walk(5, f64::from(velocity_decay_s.min(10.0)), 1.0, 60);
        let seconds: Vec<Vec<(usize, Range)>> =
            (1..=60_usize).map(|second| measured(way[second - 1], &mut noise)).collect();
        let run = |rate: u32| -> Vec<(bool, Agent)> {
            let mut tracker = tracker(velocity_decay_s);
            let elapsed_s = 1.0 / rate as f32;
            let second = |ranges: &Vec<(usize, Range)>| {
                for _ in 1..rate {
                    cycle(&mut tracker, &[], elapsed_s);
                }
                (cycle(&mut tracker, ranges, elapsed_s), tracker.filter().agent())
            };
            seconds.iter().map(second).collect()
        };
        let usual = run(1);
        let (mut apart_m, mut wider) = (0.0_f64, 0.0_f64);
        for rate in [10, 100] {
            for (second, ((acquiring, agent), (usually, usual))) in run(rate).iter().zip(&usual).enumerate() {
                let place = format!("{rate} Hz, decay {velocity_decay_s} s, second {}", second + 1);
                assert_eq!(acquiring, usually, "{place}");
                let ((mean, std), (usual_mean, usual_std)) = (moments(agent), moments(usual));
                for axis in 0..4 {
                    let apart = (mean[axis] - usual_mean[axis]).abs();
                    let ratio = (std[axis] / usual_std[axis] - 1.0).abs();
                    assert!(apart <= 1e-3, "{place}: {mean:?} {usual_mean:?}");
                    assert!(ratio <= 0.01, "{place}: {std:?} {usual_std:?}");
                    (apart_m, wider) = (apart_m.max(apart), wider.max(ratio));
                }
            }
        }
        let searched = usual.iter().filter(|(acquiring, _)| *acquiring).count();
        println!(
            "decay {velocity_decay_s} s: at most {apart_m:.2e} m (m/s) and {wider:.2e} of a deviation apart, {searched} s searched"
        );
        assert!(searched < 30, "{searched} s searched: it is tracking that was compared");
    }
}

/// Whether two trackers search alike and agree to a millimetre and a hundredth.
fn agree(one: &[(bool, Agent)], other: &[(bool, Agent)], place: &str) {
    for (second, ((acquiring, agent), (usually, usual))) in one.iter().zip(other).enumerate() {
        assert_eq!(acquiring, usually, "{place}, {second}");
        let ((mean, std), (usual_mean, usual_std)) = (moments(agent), moments(usual));
        for axis in 0..4 {
            assert!(
                (mean[axis] - usual_mean[axis]).abs() <= 1e-3,
                "{place}, {second}: {mean:?} {usual_mean:?}"
            );
            assert!(
                (std[axis] / usual_std[axis] - 1.0).abs() <= 0.01,
                "{place}, {second}: {std:?} {usual_std:?}"
            );
        }
    }
}

/// Two anchors whose reflections in two walls nobody told of: candidates for virtual anchors are predicted over the time since
/// anything was heard, not cycle by cycle.
#[test]
fn what_is_discovered_does_not_depend_on_empty_cycles() {
    for seed in 0..4 {
        let mut noise = Noise::new(100 + seed);
        let way = drawn_walk(seed, 10.0, 1.0, 60);
        let seconds: Vec<[Vec<Range>; 2]> = way
            .iter()
            .map(|place| {
                [0, 1].map(|anchor: usize| {
                    let [x, y] = ANCHORS[anchor].position_m.map(f64::from);
                    let images = [[x, y], [x, -6.0 - y], [-8.0 - x, y]];
                    let range = |[a, b]: [f64; 2]| {
                        let range_m = (place[0] - a).hypot(place[1] - b) + 0.05 * noise.normal();
                        Range { range_m: range_m as f32, variance_m2: 0.0025 }
                    };
                    images.map(range).into_iter().filter(|range| range.range_m < 29.0).collect()
                })
            })
            .collect();
        let run = |rate: u32| -> Vec<(bool, Agent)> {
            let mut tracker = tracker(10.0);
            let elapsed_s = 1.0 / rate as f32;
            let second = |anchors: &[Vec<Range>; 2]| {
                for _ in 1..rate {
                    cycle(&mut tracker, &[], elapsed_s);
                }
                let scans = [0, 1]
                    .map(|anchor: usize| Observation::Ranges(RangeScan { anchor, ranges: &anchors[anchor] }));
                let report = tracker.cycle(&scans, elapsed_s, None).unwrap();
                (report.searching, tracker.filter().agent())
            };
            seconds.iter().map(second).collect()
        };
        agree(&run(10), &run(1), &format!("seed {seed}"));
    }
}

/// Measured every two seconds, one Gaussian becomes too wide: where the tag is searched from does not depend on when.
#[test]
fn what_is_given_up_in_a_gap_does_not_depend_on_empty_cycles() {
    for seed in 0..6 {
        let mut noise = Noise::new(seed);
        let way = drawn_walk(20 + seed, 10.0, 2.0, 30);
        let measurements: Vec<Vec<(usize, Range)>> =
            way.iter().map(|place| measured(*place, &mut noise)).collect();
        let run = |cycles: u32| -> Vec<(bool, Agent)> {
            let mut tracker = tracker(10.0);
            let elapsed_s = 2.0 / cycles as f32;
            let gap = |ranges: &Vec<(usize, Range)>| {
                for _ in 1..cycles {
                    cycle(&mut tracker, &[], elapsed_s);
                }
                (cycle(&mut tracker, ranges, elapsed_s), tracker.filter().agent())
            };
            measurements.iter().map(gap).collect()
        };
        agree(&run(20), &run(1), &format!("seed {seed}"));
    }
}

/// Mean and covariance of [x, y, u, v] after `elapsed_s` seconds by the stochastic differential equation, in f64: dx/dt = A x
/// and dP/dt = A P + P A' + diag(0, 0, q, q), in small steps of the classical Runge-Kutta rule.
fn integrated(motion: &Motion, start: &Agent, elapsed_s: f64) -> (Vector4<f64>, Matrix4<f64>) {
    let decay_per_s = 1.0 / f64::from(motion.velocity_decay_s);
    let density = f64::from(motion.acceleration_density_m2_s3);
    let mut a = Matrix4::zeros();
    let mut q = Matrix4::zeros();
    for axis in 0..2 {
        a[(axis, axis + 2)] = 1.0;
        a[(axis + 2, axis + 2)] = -decay_per_s;
        q[(axis + 2, axis + 2)] = density;
    }
    let (mut x, mut p): (Vector4<f64>, Matrix4<f64>) = (start.mean.cast(), start.covariance.cast());
    let steps = (elapsed_s * (20.0 + 20.0 * decay_per_s)).ceil().max(20.0);
    let dt = elapsed_s / steps;
    let rate = |p: &Matrix4<f64>| a * p + p * a.transpose() + q;
    for _ in 0..steps as usize {
        let k1 = rate(&p);
        let k2 = rate(&(p + k1 * (0.5 * dt)));
        let k3 = rate(&(p + k2 * (0.5 * dt)));
        let k4 = rate(&(p + k3 * dt));
        p += (k1 + (k2 + k3) * 2.0 + k4) * (dt / 6.0);
        let k1 = a * x;
        let k2 = a * (x + k1 * (0.5 * dt));
        let k3 = a * (x + k2 * (0.5 * dt));
        let k4 = a * (x + k3 * dt);
        x += (k1 + (k2 + k3) * 2.0 + k4) * (dt / 6.0);
    }
    (x, p)
}

#[test]
fn a_filters_prediction_cut_in_parts_is_the_whole_and_that_of_the_differential_equation() {
    let start = Agent {
        mean: Vector4::new(3.0, -2.0, 1.2, -0.7),
        covariance: Matrix4::new(
            0.04, 0.01, 0.02, 0.0, //
            0.01, 0.09, 0.0, -0.03, //
            0.02, 0.0, 0.25, 0.05, //
            0.0, -0.03, 0.05, 0.36,
        ),
    };
    let (mut from_truth, mut from_whole) = (0.0_f64, 0.0_f64);
    for velocity_decay_s in [0.1, 0.5, 1.5, 10.0, 1e3, 1e6, f32::INFINITY] {
        for elapsed_s in [1e-3_f32, 0.02, 0.1, 0.75, 3.0, 10.0] {
            let motion = motion(velocity_decay_s);
            let predicted = |parts: &[f32]| {
                let mut filter = StateFilter::<1, 2>::new(motion, 1e4, [0.0, 0.0], 0.2, 0.5, 0.0, 0.1);
                filter.insert_independent(0, Surface::Private, Vector2::new(1.0, 1.0), [0.1; 2]);
                filter.place(&start);
                parts.iter().for_each(|part| filter.predict(part * elapsed_s));
                (filter.agent(), filter.surface(0).unwrap().2)
            };
            let (whole, mapped) = predicted(&[1.0]);
            let (mean, covariance) = integrated(&motion, &start, elapsed_s.into());
            let place = format!("decay {velocity_decay_s} s, {elapsed_s} s");
            let scale = |i: usize, j: usize| (covariance[(i, i)] * covariance[(j, j)]).sqrt();
            let compare = |agent: &Agent, expected: &(Vector4<f64>, Matrix4<f64>), limit: f64, what: &str| {
                let mut worst = 0.0_f64;
                for i in 0..4 {
                    let error =
                        (f64::from(agent.mean[i]) - expected.0[i]).abs() / scale(i, i).sqrt().max(1.0);
                    worst = worst.max(error);
                    for j in 0..4 {
                        let error = (f64::from(agent.covariance[(i, j)]) - expected.1[(i, j)]).abs();
                        worst = worst.max(error / scale(i, j));
                    }
                }
                assert!(worst <= limit, "{place}, {what}: {worst:.2e} {agent:?} {expected:?}");
                worst
            };
            from_truth = from_truth.max(compare(&whole, &(mean, covariance), 1e-5, "against f64"));
            let expected = (whole.mean.cast(), whole.covariance.cast());
            for parts in [vec![0.5; 2], vec![0.1, 0.9], vec![0.05; 20]] {
                let (cut, cut_mapped) = predicted(&parts);
                let what = format!("in {} parts", parts.len());
                from_whole = from_whole.max(compare(&cut, &expected, 1e-5, &what));
                let ratio = cut_mapped.m11 / mapped.m11;
                assert!((ratio - 1.0).abs() < 1e-5, "{place}, {what}: {mapped} {cut_mapped}");
            }
        }
    }
    println!(
        "from the differential equation at most {from_truth:.2e}, from the whole step at most {from_whole:.2e}"
    );
}

/// A draw of the motion itself: positions `period_s` apart; a weak spring holds it in the room.
fn drawn_walk(seed: u64, velocity_decay_s: f64, period_s: f64, count: usize) -> Vec<[f64; 2]> {
    let mut noise = Noise::new(seed);
    let density = 0.1;
    let (mut position, mut velocity) = (START_M, [0.5 * noise.normal(), 0.5 * noise.normal()]);
    let fine_s = period_s / 10.0;
    let step = |_| {
        for _ in 0..10 {
            for axis in 0..2 {
                let change = -velocity[axis] / velocity_decay_s - 0.15 * (position[axis] - START_M[axis]);
                velocity[axis] += change * fine_s + (density * fine_s).sqrt() * noise.normal();
                position[axis] += velocity[axis] * fine_s;
            }
        }
        position
    };
    (0..count).map(step).collect()
}

#[test]
fn one_walk_measured_at_50_hertz_is_known_no_worse_than_at_5() {
    let (mut squares, mut counted) = ([0.0_f64; 2], 0);
    let mut better = 0;
    for seed in 0..60 {
        let fine = drawn_walk(1000 + seed, 10.0, 0.02, 1500);
        let run = |every: usize, noise: &mut Noise| {
            let mut tracker = tracker(10.0);
            let mut errors = Vec::new();
            for (index, place) in fine.iter().enumerate() {
                if (index + 1) % every != 0 {
                    continue;
                }
                cycle(&mut tracker, &measured(*place, noise), 0.02 * every as f32);
                // At the times that both have, once the tag is found.
                if (index + 1) % 10 == 0 && index >= 250 {
                    let [x, y] = tracker.filter().position_m().map(f64::from);
                    errors.push((x - place[0]).powi(2) + (y - place[1]).powi(2));
                }
            }
            errors
        };
        let mut noise = Noise::new(seed);
        let [slow, fast] = [run(10, &mut noise), run(1, &mut noise)];
        assert_eq!(slow.len(), fast.len());
        counted += slow.len();
        let sums = [slow.iter().sum::<f64>(), fast.iter().sum::<f64>()];
        better += u32::from(sums[1] <= sums[0]);
        (0..2).for_each(|rate| squares[rate] += sums[rate]);
    }
    let [slow_m, fast_m] = squares.map(|sum| (sum / counted as f64).sqrt());
    println!("RMSE {slow_m:.4} m at 5 Hz, {fast_m:.4} m at 50 Hz; better in {better} of 60 walks");
    assert!(fast_m <= slow_m, "{fast_m} m at 50 Hz, {slow_m} m at 5 Hz");
    // Ten times as many ranges: where white acceleration limits it, the deviation falls by 10^(3/8), to 0.42 of it.
    assert!(fast_m <= 0.6 * slow_m && better == 60 && slow_m < 0.1, "{better} of 60, {slow_m} m, {fast_m} m");
}

/// Walks straight at 1.5 m/s for six seconds, then is not heard for an hour of cycles of this length. Where it was lost, its
/// speed then, where it is thought to be after, and the largest deviation of the position on the way.
fn silent_hour(velocity_decay_s: f32, period_s: f32) -> ([f64; 2], f64, [f64; 2], f64) {
    let mut tracker = tracker(velocity_decay_s);
    let mut noise = Noise::new(9);
    for step in 1..=60 {
        let along = 1.5 * 0.1 * f64::from(step) - 4.5;
        let place = [START_M[0] + 0.8 * along, START_M[1] + 0.6 * along];
        cycle(&mut tracker, &measured(place, &mut noise), 0.1);
    }
    assert!(!tracker.belief().is_searching(), "it was followed");
    let lost_m = tracker.filter().position_m().map(f64::from);
    let [u, v] = tracker.filter().velocity_m_s().map(f64::from);
    let mut widest_m = 0.0_f64;
    for _ in 0..(3600.0 / period_s) as usize {
        cycle(&mut tracker, &[], period_s);
        let c = tracker.filter().position_covariance_m2();
        assert!(c.iter().all(|entry| entry.is_finite()));
        widest_m = widest_m.max(f64::from(c.m11.max(c.m22)).sqrt());
    }
    (lost_m, u.hypot(v), tracker.filter().position_m().map(f64::from), widest_m)
}

#[test]
fn a_tag_that_is_not_heard_comes_to_rest() {
    for velocity_decay_s in [1.5_f32, 10.0] {
        for period_s in [0.1, 10.0] {
            let (lost_m, speed_m_s, after_m, widest_m) = silent_hour(velocity_decay_s, period_s);
            let moved_m = (after_m[0] - lost_m[0]).hypot(after_m[1] - lost_m[1]);
            let reach_m = f64::from(velocity_decay_s) * speed_m_s;
            println!(
                "decay {velocity_decay_s} s, cycles of {period_s} s: lost at {speed_m_s:.2} m/s, then {moved_m:.2} m \
                 (reach {reach_m:.2} m), deviation up to {widest_m:.2} m"
            );
            assert!((1.0..1.7).contains(&speed_m_s), "{speed_m_s} m/s");
            assert!(moved_m <= 1.001 * reach_m, "{moved_m} m, {reach_m} m");
            // It does move, as far as that.
            assert!(moved_m > 0.5 * reach_m, "{moved_m} m, {reach_m} m");
            assert!(widest_m <= 30.0 * 1.001, "{widest_m} m");
        }
    }
    // At constant velocity nothing comes to rest.
    let (lost_m, _, after_m, _) = silent_hour(f32::INFINITY, 0.1);
    assert!((after_m[0] - lost_m[0]).hypot(after_m[1] - lost_m[1]) > 20.0, "{lost_m:?} {after_m:?}");
}
