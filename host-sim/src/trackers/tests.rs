//! The trackers against closed forms, their own models, and the core.

use super::map::Map;
use super::*;
use crate::channel::random::{Purpose, normal, stream, uniform};
use crate::recording::{
    Anchor, AssociationModel, Cycle, Motion, Plan, PlanWall, Radio, Recording, Start, VirtualAnchor,
    WallSequence,
};
use crate::replay::{PATHS, SOURCES, inputs};
use crate::scenario::Scenario;
use crate::simulator::Simulator;
use cogmint_core::observer::Observer;
use cogmint_core::perceptor::channel_estimator::ChannelEstimate;
use rand_core::Rng;
use std::path::Path;

/// A recording of ranges, without cycles.
fn recording(
    anchors_m: &[[f64; 2]],
    position_std_m: f64,
    velocity_std_m_s: f64,
    acceleration: f64,
) -> Recording {
    Recording {
        name: "ranges".into(),
        source: "made for a test".into(),
        motion: Motion::published(acceleration),
        start: Start {
            position_m: [3.0, 2.0],
            position_std_m,
            velocity_std_m_s,
            disc_radius_m: None,
            drawn_about_m: None,
        },
        association: AssociationModel {
            detection_probability: 0.9,
            clutter_per_anchor: 0.1,
            max_range_m: 30.0,
        },
        radio: Radio {
            pulse_duration_s: 1e-9,
            roll_off: 0.6,
            sampled_pulse: None,
            gain_control: false,
            begins_with_path: false,
            sample_spacing_s: None,
            range_std_m: 0.05,
            range_bias_mean_m: 0.0,
            range_bias_std_m: 0.0,
            range_late_m: 0.0,
            range_floor_pulses: None,
        },
        anchors: anchors_m
            .iter()
            .enumerate()
            .map(|(n, position_m)| Anchor::new(format!("a{n}"), *position_m, 1.0))
            .collect(),
        virtual_anchors: Vec::new(),
        actions: Vec::new(),
        antennas: Vec::new(),
        walls: Vec::new(),
        plan: None,
        cycles: Vec::new(),
    }
}

fn setup(recording: &Recording) -> Setup {
    Setup::new(recording, Path::new("test"), None).expect("the core takes it")
}

fn path(range_m: f64, std_m: f64, source: Source) -> ScanPath {
    ScanPath { range_m, std_m, sinr: 0.0, source: Some(source), overlapped: false }
}

fn scan(anchor: usize, paths: Vec<ScanPath>) -> Scan {
    Scan { anchor, action: 0, pulse_m: 0.0, paths }
}

fn cycle(n: usize, period_s: f64, scans: Vec<Scan>) -> CycleScans {
    CycleScans { time_s: n as f64 * period_s, elapsed_s: period_s, tag_height_m: Some(1.0), scans }
}

/// Ranges of a place at rest from all anchors, with normal errors.
fn at_rest(
    recording: &Recording,
    place: [f64; 2],
    cycles: usize,
    std_m: f64,
    rng: &mut impl Rng,
) -> Vec<CycleScans> {
    (0..cycles)
        .map(|n| {
            let scans = recording.anchors.iter().enumerate().map(|(anchor, own)| {
                let [x, y] = own.position_m;
                let range_m = (place[0] - x).hypot(place[1] - y) + std_m * normal(rng);
                scan(anchor, vec![path(range_m, std_m, Source::Direct)])
            });
            cycle(n, 0.1, scans.collect())
        })
        .collect()
}

/// Two anchors 9 km away measure x and y of a tag at rest: the weighted mean of the prior and all ranges.
#[test]
fn where_ranges_are_linear_told_gives_the_weighted_mean() {
    let mut recording = recording(&[[-9000.0, 2.0], [3.0, -9000.0]], 0.4, 1e-3, 1e-6);
    recording.association.max_range_m = 1e4;
    let setup = setup(&recording);
    let mut rng = stream(1, Purpose::Experiment, &[]);
    let (std_m, count) = (0.2, 60);
    let mut cycles = at_rest(&recording, [3.3, 1.8], count, std_m, &mut rng);
    // So that what the velocity adds stays out of it.
    cycles.iter_mut().for_each(|cycle| cycle.elapsed_s = 1e-4);
    let map = Map::told(&recording, &setup);
    let mut gaussian = super::gaussian::Gaussian::prior(&map);
    let variance_m2 = std_m * std_m;
    let mut sums = [0.0; 2];
    for cycle in &cycles {
        gaussian.predict(cycle.elapsed_s, map.acceleration_density);
        for scan in &cycle.scans {
            let range_m = scan.paths[0].range_m;
            sums[scan.anchor] += range_m - [9003.0, 9002.0][scan.anchor] + [3.0, 2.0][scan.anchor];
            let noise = [(1.0, variance_m2), (0.0, 1.0), (0.0, 1.0)];
            told::update(
                &map,
                scan.anchor,
                0.0,
                &[told::Measurement::new(Source::Direct, range_m, noise)],
                &mut gaussian,
            );
        }
    }
    let (prior, each) = (1.0 / 0.16, 1.0 / variance_m2);
    let information = prior + count as f64 * each;
    for (axis, start_m) in [3.0, 2.0].into_iter().enumerate() {
        let expected_m = (prior * start_m + each * sums[axis]) / information;
        assert!(
            (gaussian.mean[axis] - expected_m).abs() < 1e-3,
            "{axis}: {} {expected_m}",
            gaussian.mean[axis]
        );
        let variance = gaussian.position_m2()[2 * axis];
        assert!((variance * information - 1.0).abs() < 1e-3, "{axis}: {variance}");
    }
}

/// A rectangular plan whose four walls are each off by what is told.
fn plan_room(rng: &mut impl Rng) -> (Recording, Vec<[f64; 2]>) {
    let corners = [[0.0, 0.0], [8.0, 0.0], [8.0, 6.0], [0.0, 6.0]];
    let mut recording = recording(&[[0.5, 0.6], [7.0, 5.0]], 0.3, 0.3, 0.4);
    let (offset_std_m, rotation_std_rad) = (0.1, 0.01);
    let walls: Vec<PlanWall> = (0..4)
        .map(|n| PlanWall {
            segments_m: vec![[corners[n], corners[(n + 1) % 4]]],
            offset_std_m,
            rotation_std_rad,
            construction: "brick".into(),
        })
        .collect();
    // The true walls: told ones with the errors in them.
    let errors: Vec<[f64; 2]> =
        walls.iter().map(|_| [offset_std_m * normal(rng), rotation_std_rad * normal(rng)]).collect();
    let mirror = |point: [f64; 2], wall: usize, [offset, turn]: [f64; 2]| {
        let ([a, b], c) = (walls[wall].normal(), walls[wall].centre_m());
        let u = [a * turn.cos() - b * turn.sin(), a * turn.sin() + b * turn.cos()];
        let s = u[0] * (point[0] - c[0]) + u[1] * (point[1] - c[1]) - offset;
        [point[0] - 2.0 * s * u[0], point[1] - 2.0 * s * u[1]]
    };
    let sequences: Vec<Vec<usize>> = (0..4).map(|n| vec![n]).chain([vec![0, 1], vec![2, 0]]).collect();
    for anchor in 0..2 {
        for sequence in &sequences {
            let from = recording.anchors[anchor].position_m;
            let image = |errors: &dyn Fn(usize) -> [f64; 2]| {
                sequence.iter().fold(from, |point, &wall| mirror(point, wall, errors(wall)))
            };
            let (truth, told) = (image(&|wall| errors[wall]), image(&|_| [0.0, 0.0]));
            recording.virtual_anchors.push(VirtualAnchor {
                told_position_m: Some(told),
                walls: WallSequence::new(sequence).expect("two at most"),
                ..VirtualAnchor::new(anchor, truth, 0.2, true)
            });
        }
    }
    recording.plan = Some(Plan {
        outline_m: corners.to_vec(),
        turn_std_rad: 0.0,
        reflections: 2,
        most_sources: 24,
        walls,
    });
    let truth = recording.virtual_anchors.iter().map(|va| va.position_m).collect();
    (recording, truth)
}

/// Ranges of all sources along a way drawn from the motion model, with the noise that `told` counts on.
fn drawn_from_the_model(
    recording: &mut Recording,
    images: &[[f64; 2]],
    rng: &mut impl Rng,
) -> Vec<CycleScans> {
    let (period_s, std_m) = (0.1, 0.05);
    let mut tag = recording.start.position_m.map(|x| x + recording.start.position_std_m * normal(rng));
    let mut velocity = [0.0; 2].map(|_: f64| recording.start.velocity_std_m_s * normal(rng));
    // White acceleration in continuous time that changes the velocity as much per cycle as the core's.
    let root = recording.motion.acceleration_std_m_s2.unwrap() * period_s;
    let mut cycles = Vec::new();
    for n in 0..40 {
        for axis in 0..2 {
            let (a, b) = (normal(rng), normal(rng));
            tag[axis] += period_s * (velocity[axis] + root * (0.5 * a + b / 12.0_f64.sqrt()));
            velocity[axis] += root * a;
        }
        let known = Cycle { time_s: n as f64 * period_s, truth_position_m: Some(tag), ..Cycle::default() };
        recording.cycles.push(known);
        let mut scans: Vec<Scan> =
            (0..recording.anchors.len()).map(|anchor| scan(anchor, Vec::new())).collect();
        let direct = recording.anchors.iter().enumerate();
        let direct = direct.map(|(anchor, own)| (anchor, Source::Direct, own.position_m));
        let reflected = recording.virtual_anchors.iter().zip(images).enumerate();
        let reflected = reflected.map(|(index, (va, place))| (va.anchor, Source::Virtual(index), *place));
        for (anchor, source, place) in direct.chain(reflected) {
            let mut drawn = path((tag[0] - place[0]).hypot(tag[1] - place[1]), std_m, source);
            let mut left = uniform(rng);
            let noise = told::noise(&scan(anchor, vec![drawn]), 0);
            let mode = noise.iter().find(|(share, _)| {
                left -= share;
                left < 0.0
            });
            drawn.range_m += mode.map_or(0.0, |(_, variance_m2)| variance_m2.sqrt()) * normal(rng);
            scans[anchor].paths.push(drawn);
        }
        cycles.push(cycle(n, period_s, scans));
    }
    cycles
}

#[test]
fn the_errors_of_told_are_as_large_as_it_claims_where_its_model_holds() {
    let (mut sum, mut terms) = (0.0, 0);
    for seed in 0..60 {
        let mut rng = stream(seed, Purpose::Experiment, &[]);
        let (mut recording, images) = plan_room(&mut rng);
        let cycles = drawn_from_the_model(&mut recording, &images, &mut rng);
        let estimates = told::run(&recording, &setup(&recording), &cycles);
        for (cycle, estimate) in recording.cycles.iter().zip(&estimates).skip(5) {
            let [x, y] = cycle.truth_position_m.expect("is known");
            let [x, y] = [estimate.position_m[0] - x, estimate.position_m[1] - y];
            let [xx, xy, yy] = estimate.covariance_m2;
            sum += 0.5 * (yy * x * x - 2.0 * xy * x * y + xx * y * y) / (xx * yy - xy * xy);
            terms += 1;
        }
    }
    // Errors hang together over a run: 60 runs are 120 independent squares or more, whose mean is within 0.26 (two
    // deviations) of 1.
    let nees = sum / f64::from(terms);
    assert!((0.8..1.3).contains(&nees), "{nees}");
}

/// All images of a wall move with it: against differences of the mirrored point.
#[test]
fn the_slopes_of_an_image_over_its_walls_are_its_derivatives() {
    let mut rng = stream(3, Purpose::Experiment, &[]);
    let (recording, images) = plan_room(&mut rng);
    let map = Map::told(&recording, &setup(&recording));
    let state: Vec<f64> = (0..map.states()).map(|_| 0.05 * normal(&mut rng)).collect();
    for index in 0..images.len() {
        let anchor = recording.virtual_anchors[index].anchor;
        let at = |state: &[f64]| map.place(anchor, Source::Virtual(index), state).expect("is in the map");
        let slopes = at(&state).slopes;
        assert!(!slopes.is_empty());
        for parameter in 4..map.states() {
            let h = 1e-6;
            let (mut up, mut down) = (state.clone(), state.clone());
            up[parameter] += h;
            down[parameter] -= h;
            for axis in 0..2 {
                let expected = (at(&up).position_m[axis] - at(&down).position_m[axis]) / (2.0 * h);
                let ours = slopes.iter().find(|(known, _)| *known == parameter).map_or(0.0, |(_, s)| s[axis]);
                assert!((ours - expected).abs() < 1e-6, "{index} {parameter} {axis}: {ours} {expected}");
            }
        }
    }
}

/// With an exact map the bound is that of [`crate::bound::posterior`], which has no map in its state.
#[test]
fn with_an_exact_map_the_bound_is_the_posterior_one() {
    let mut rng = stream(4, Purpose::Experiment, &[]);
    let (mut recording, images) = plan_room(&mut rng);
    for (va, image) in recording.virtual_anchors.iter_mut().zip(&images) {
        (va.told_position_m, va.walls) = (Some(*image), WallSequence::default());
    }
    let mut setup = setup(&recording);
    setup.config.exact_map = true;
    let cycles = drawn_from_the_model(&mut recording, &images, &mut rng);
    let bounds_m = bound::detected(&recording, &setup, &cycles);
    let density = f64::from(setup.config.motion.acceleration_density_m2_s3);
    let mut posterior = crate::bound::posterior::Posterior::new(0.3, 0.3);
    for ((cycle, known), bound_m) in cycles.iter().zip(&recording.cycles).zip(&bounds_m) {
        posterior.predict(cycle.elapsed_s, density);
        let [x, y] = known.truth_position_m.expect("is known");
        let mut information = [0.0; 3];
        for scan in &cycle.scans {
            for (index, path) in scan.paths.iter().enumerate() {
                let [a, b] = match path.source {
                    Some(Source::Virtual(index)) => images[index],
                    _ => recording.anchors[scan.anchor].position_m,
                };
                let worth: f64 = told::noise(scan, index).iter().map(|(share, r)| share / r).sum();
                let length = (x - a).hypot(y - b);
                let [u, v] = [(x - a) / length, (y - b) / length];
                information[0] += worth * u * u;
                information[1] += worth * u * v;
                information[2] += worth * v * v;
            }
        }
        posterior.update(information);
        let expected_m = posterior.position_trace_m2().sqrt();
        assert!((bound_m / expected_m - 1.0).abs() < 0.005, "{bound_m} {expected_m}");
    }
    assert!(bound::answerable(&bounds_m));
    assert!(!bound::answerable(&[0.1, 0.1, 0.1, 0.1, 0.4]));
}

/// A frame's paths alone and far apart are worth s^2 / (1 + s), and a wide map makes them worth less.
#[test]
fn what_a_path_alone_is_worth_is_its_closed_form_and_overlap_takes_off() {
    let pulse = cogmint_core::radio::pulse::Pulse::root_raised_cosine(0.5e-9, 0.6);
    let apart = bound::variances_m2(&pulse, &[10e-9, 30e-9], &[100.0, 0.5]);
    for (variance_m2, s) in apart.iter().zip([100.0_f64, 0.5]) {
        let expected_m2 = f64::from(pulse.range_variance_m2(1.0)) * (1.0 + s) / (s * s);
        assert!((variance_m2 / expected_m2 - 1.0).abs() < 0.01, "{variance_m2} {expected_m2}");
    }
    let beside = bound::variances_m2(&pulse, &[10e-9, 10.25e-9], &[100.0, 100.0]);
    assert!(beside[0] > 1.5 * apart[0], "{beside:?} {apart:?}");
    // A faint one beside it hides next to nothing.
    let faint = bound::variances_m2(&pulse, &[10e-9, 10.25e-9], &[100.0, 0.02]);
    assert!(faint[0] < 1.05 * apart[0], "{faint:?} {apart:?}");
}

#[test]
fn three_anchors_in_sight_are_enough_for_the_plain_filter() {
    let mut recording = recording(&[[0.0, 0.0], [8.0, 0.0], [2.0, 7.0]], 0.5, 0.1, 0.1);
    let mut rng = stream(5, Purpose::Experiment, &[]);
    let tag = [3.4, 2.3];
    let cycles = at_rest(&recording, tag, 100, 0.05, &mut rng);
    recording.virtual_anchors.push(VirtualAnchor::new(0, [3.0, 2.0], 0.1, true));
    let estimates = first_path_ekf::run(&recording, &setup(&recording), &cycles);
    let last = estimates.last().expect("there are cycles");
    let [x, y] = last.position_m;
    let [xx, xy, yy] = last.covariance_m2;
    assert!((x - tag[0]).hypot(y - tag[1]) < 4.0 * (xx + yy).sqrt(), "{last:?}");
    assert!((xx + yy).sqrt() < 0.05 && xx * yy > xy * xy, "{last:?}");
}

#[test]
fn particles_find_the_tag_from_anywhere_and_the_same_way_again() {
    let mut recording = recording(&[[0.0, 0.0], [8.0, 0.0]], 20.0, 0.1, 0.1);
    // Inside the outline alone, or the tag might be behind the anchors' line.
    let outline_m = vec![[0.0, 0.0], [8.0, 0.0], [8.0, 6.0], [0.0, 6.0]];
    recording.plan =
        Some(Plan { outline_m, turn_std_rad: 0.0, reflections: 2, most_sources: 24, walls: Vec::new() });
    let mut rng = stream(6, Purpose::Experiment, &[]);
    let tag = [5.4, 3.3];
    let cycles = at_rest(&recording, tag, 30, 0.1, &mut rng);
    let setup = setup(&recording);
    let run = |seed| particles::run(&recording, &setup, &cycles, 5000, seed);
    let (first, again, other) = (run(1), run(1), run(2));
    for estimates in [&first, &other] {
        let last = estimates.last().expect("there are cycles");
        let error_m = (last.position_m[0] - tag[0]).hypot(last.position_m[1] - tag[1]);
        assert!(error_m < 0.15, "{last:?}");
    }
    let places = |run: &[Estimate]| run.iter().map(|e| (e.position_m, e.covariance_m2)).collect::<Vec<_>>();
    assert_eq!(places(&first), places(&again));
    assert_ne!(places(&first), places(&other));
}

/// The paths of every frame, as the core's own estimator gives them in a tracker.
#[derive(Default)]
struct Seen(Vec<(usize, Vec<f64>)>);

impl Observer<SOURCES, PATHS> for Seen {
    fn estimate(&mut self, anchor: usize, estimate: &ChannelEstimate<PATHS>) {
        self.0.push((anchor, estimate.paths.iter().map(|path| f64::from(path.range_m())).collect()));
    }
}

#[test]
fn the_scans_are_what_the_core_sees_and_their_labels_are_near_the_truth() {
    for name in ["single-anchor", "dw3000-office"] {
        let (scenario, folder) = Scenario::find(name).expect("is built in");
        let simulator =
            Simulator::new(&scenario, folder.as_deref(), 0, Some(1)).expect("it can be simulated");
        let mut recording = simulator.record(12, || {});
        // What the core refuses nobody gets.
        if let Some(crate::recording::Samples::Complex(samples)) =
            recording.cycles[5].frames.first_mut().map(|frame| &mut frame.samples)
        {
            samples[0] = [f32::NAN, 0.0];
        }
        let setup = setup(&recording);
        let cycles = scans(&recording, &setup);
        let mut tracker = setup.tracker::<{ crate::replay::LARGE_ANCHORS }>().expect("the core takes it");
        let (mut labelled, mut all) = (0, 0);
        for ((cycle, input), known) in cycles.iter().zip(inputs(&recording)).zip(&recording.cycles) {
            let mut seen = Seen::default();
            crate::replay::step(&mut tracker, &input, &mut seen).expect("time goes on");
            let longest_m = f64::from(setup.config.ranging.max_range_m);
            for (_, ranges) in &mut seen.0 {
                ranges.retain(|range_m| *range_m > 0.0 && *range_m <= longest_m);
                ranges.sort_by(f64::total_cmp);
            }
            let ours: Vec<(usize, Vec<f64>)> = cycle
                .scans
                .iter()
                .map(|scan| (scan.anchor, scan.paths.iter().map(|path| path.range_m).collect()))
                .collect();
            assert_eq!(ours, seen.0, "{name}");
            for scan in &cycle.scans {
                let mut sources: Vec<Source> = scan.paths.iter().filter_map(|path| path.source).collect();
                all += scan.paths.len();
                labelled += sources.len();
                for path in &scan.paths {
                    let Some(source) = path.source else { continue };
                    let truth = known.truth_paths.iter().find(|truth| {
                        truth.anchor == scan.anchor
                            && truth.virtual_anchor.map_or(Source::Direct, Source::Virtual) == source
                    });
                    let range_m = truth.expect("is a true path").delay_s * 299_792_458.0;
                    assert!((path.range_m - range_m).abs() < scan.pulse_m + 1.0);
                }
                let count = sources.len();
                sources.sort_by_key(|source| format!("{source:?}"));
                sources.dedup();
                assert_eq!(count, sources.len(), "a true path is two estimated ones");
            }
        }
        assert!(labelled * 10 > all * 8, "{name}: {labelled} of {all}");
    }
}
