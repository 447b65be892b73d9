//! `cogmint calibrate` against planted biases, anchors that are elsewhere, and a pulse of another length: what it says must be
//! right within the deviations that it claims, and a claim that is wrong must be seen.

mod range_recording;

use cogmint::calibrate::file::Calibration;
use cogmint::calibrate::{Options, calibrate};
use cogmint::channel::random::{Purpose, normal, stream, uniform};
use cogmint::cycle_choice::CycleChoice;
use cogmint::input_error::InputError;
use cogmint::recording::{Antenna, Cycle, Frame, Motion, Range, Recording, Samples};
use cogmint_core::radio::pulse::Pulse;
use cogmint_tests::outcome::{json, refused, text};
use cogmint_tests::{Folder, cogmint};
use range_recording::recording_of_ranges;
use std::path::Path;

/// Speed of light, metres per second.
const SPEED_OF_LIGHT_M_S: f64 = 299_792_458.0;
/// Anchors about a hall, metres: position and height.
const ANCHORS: [([f64; 2], f64); 5] =
    [([-4.0, -3.0], 2.2), ([4.5, -3.5], 2.0), ([5.0, 3.0], 2.4), ([-0.5, 4.5], 1.9), ([-5.0, 2.5], 2.1)];
/// Deviation of the anchors' positions as told, metres.
const ANCHOR_STD_M: f64 = 0.1;
/// Noise, share with an excess, its mean, share of false ranges.
const ERRORS: (f64, f64, f64, f64) = (0.1, 0.25, 0.4, 0.01);
const TAG_HEIGHT_M: f64 = 1.0;

/// Longest range, metres.
const LONGEST_M: f64 = 30.0;

/// What is planted.
struct Planted {
    recording: Recording,
    biases_m: Vec<f64>,
    anchors_m: Vec<[f64; 2]>,
    /// Differences of the antennas from their mean.
    differences_m: Vec<f64>,
    /// Where the tag was.
    way_m: Vec<[f64; 2]>,
}

/// A walk of `cycles` cycles of 0.2 s by the motion that the recording tells, with ranges of every anchor in every cycle.
fn planted(seed: u64, cycles: usize, antennas: bool) -> Planted {
    let mut rng = stream(seed, Purpose::Experiment, &[0]);
    let biases_m: Vec<f64> = ANCHORS.iter().map(|_| 0.05 + 0.45 * uniform(&mut rng)).collect();
    let anchors_m: Vec<[f64; 2]> =
        ANCHORS.iter().map(|(told_m, _)| told_m.map(|x| x + ANCHOR_STD_M * normal(&mut rng))).collect();
    let differences_m = if antennas { vec![0.07, -0.07] } else { vec![0.0] };
    let arms_m = [[0.25, 0.0], [-0.25, 0.0]];
    let (density_m2_s3, decay_s, period_s) = (0.05, 3.0, 0.2_f64);
    let ([mut x, mut y], [mut u, mut v], mut heading) = ([0.0, 0.0], [0.2, 0.1], 0.5);
    let mut way_m = Vec::new();
    let (noise_m, excess_share, excess_m, false_share) = ERRORS;
    let cycle = |step: usize| {
        // Fine steps stand for the continuous motion.
        for _ in 0..20 {
            let dt = period_s / 20.0;
            (x, y) = (x + u * dt, y + v * dt);
            let kick = (density_m2_s3 * dt).sqrt();
            u = u * (1.0 - dt / decay_s) + kick * normal(&mut rng);
            v = v * (1.0 - dt / decay_s) + kick * normal(&mut rng);
            heading += (0.1 * dt).sqrt() * normal(&mut rng);
        }
        way_m.push([x, y]);
        let antenna = step % 2;
        let [along, across] = if antennas { arms_m[antenna] } else { [0.0; 2] };
        let (sin, cos) = f64::sin_cos(heading);
        let at = [x + cos * along - sin * across, y + sin * along + cos * across];
        let ranges = anchors_m.iter().enumerate().map(|(anchor, place)| {
            let up = TAG_HEIGHT_M - ANCHORS[anchor].1;
            let length_m = (at[0] - place[0]).hypot(at[1] - place[1]).hypot(up);
            let mut range_m = length_m + biases_m[anchor] + noise_m * normal(&mut rng);
            range_m += if antennas { differences_m[antenna] } else { 0.0 };
            if uniform(&mut rng) < excess_share {
                range_m -= excess_m * uniform(&mut rng).ln();
            }
            if uniform(&mut rng) < false_share {
                range_m = LONGEST_M * uniform(&mut rng);
            }
            Range { anchor, range_m: range_m.max(0.01), std_m: None, angles: None }
        });
        Cycle {
            ranges: ranges.collect(),
            time_s: period_s * step as f64,
            truth_position_m: Some([x, y]),
            tag_height_m: Some(TAG_HEIGHT_M),
            antenna: antennas.then_some(antenna),
            ..Cycle::default()
        }
    };
    let cycles = (0..cycles).map(cycle).collect();
    let antenna = |name: &str, arm_m| Antenna { name: name.into(), lever_arm_m: Some(arm_m) };
    let motion = Motion {
        acceleration_density_m2_s3: Some(density_m2_s3),
        velocity_decay_s: Some(decay_s),
        ..Motion::default()
    };
    let mut recording = recording_of_ranges(format!("planted {seed}"), ANCHORS, motion, cycles);
    recording.radio.sample_spacing_s = Some(1e-9);
    recording.radio.range_bias_std_m = 0.3;
    if antennas {
        recording.antennas = vec![antenna("front", arms_m[0]), antenna("back", arms_m[1])];
    }
    Planted { recording, biases_m, anchors_m, differences_m, way_m }
}

fn options(uses_truth: bool) -> Options {
    Options { cycles: CycleChoice::All, uses_truth, anchor_std_m: ANCHOR_STD_M, bias_std_m: None }
}

fn calibrated(planted: &Planted, options: &Options) -> Calibration {
    // Where a tracker would put the tag, roughly.
    let way = |recording: &Recording, _: &Path| -> Result<Vec<[f64; 2]>, InputError> {
        let wave = |n: usize| 0.3 * (0.37 * n as f64).sin();
        assert_eq!(recording.cycles.len(), planted.way_m.len());
        let beside = planted.way_m.iter().enumerate().map(|(n, [x, y])| [x + wave(n), y - wave(n + 9)]);
        Ok(beside.collect())
    };
    calibrate(&[(planted.recording.clone(), "planted".into())], options, &way).expect("is calibrated")
}

/// Errors over the deviations claimed.
#[derive(Default)]
struct Claims(Vec<f64>);

impl Claims {
    fn add(&mut self, estimate: f64, std: f64, truth: f64) {
        self.0.push((estimate - truth) / std);
    }

    /// Mean square and the share within two deviations.
    fn figures(&self) -> (f64, f64) {
        let count = self.0.len() as f64;
        let mean_square = self.0.iter().map(|z| z * z).sum::<f64>() / count;
        (mean_square, self.0.iter().filter(|z| z.abs() < 2.0).count() as f64 / count)
    }

    /// Whether the deviations claimed are those of the errors: 1 and 95 % of honest ones.
    fn are_honest(&self) -> bool {
        let (mean_square, within) = self.figures();
        (0.5..1.6).contains(&mean_square) && within > 0.89
    }
}

/// Biases, positions and mean errors of `seeds` runs against what was planted, times a sign.
fn claims(seeds: std::ops::Range<u64>, cycles: usize, uses_truth: bool, sign: f64) -> [Claims; 3] {
    let mut claims: [Claims; 3] = Default::default();
    for seed in seeds {
        let planted = planted(seed, cycles, false);
        let calibration = calibrated(&planted, &options(uses_truth));
        assert_eq!(calibration.with_truth, uses_truth);
        let [biases, places, means] = &mut claims;
        for (n, anchor) in calibration.anchors.iter().enumerate() {
            let bias_m = sign * planted.biases_m[n];
            biases.add(anchor.range_bias_m, anchor.range_bias_std_m, bias_m);
            means.add(anchor.mean_error_m, anchor.mean_error_std_m, bias_m + ERRORS.1 * ERRORS.2);
            for axis in 0..2 {
                let told_m = anchor.told_position_m[axis];
                let moved_m = sign * (planted.anchors_m[n][axis] - told_m);
                places.add(anchor.position_m[axis] - told_m, anchor.position_std_m[axis], moved_m);
            }
        }
    }
    claims
}

#[test]
fn what_is_told_of_one_anchors_bias_counts_for_it() {
    let mut planted = planted(1, 120, false);
    let free = calibrated(&planted, &options(true));
    // Surely wrong, so that it shows.
    let wrong_m = planted.biases_m[1] + 0.4;
    planted.recording.anchors[1].range_bias_mean_m = Some(wrong_m);
    planted.recording.anchors[1].range_bias_std_m = Some(0.002);
    let told = calibrated(&planted, &options(true));
    let [found, held] = [&free, &told].map(|calibration| &calibration.anchors[1]);
    assert!((found.range_bias_m - planted.biases_m[1]).abs() < 0.2, "{}", found.range_bias_m);
    assert!((held.range_bias_m - wrong_m).abs() < 0.02 && held.range_bias_std_m <= 0.002, "{held:?}");
    assert!((told.anchors[0].range_bias_m - planted.biases_m[0]).abs() < 0.2, "{:?}", told.anchors[0]);
    // With a deviation for all, its mean is looked at alone.
    let all = Options { bias_std_m: Some(0.3), ..options(true) };
    let loose = &calibrated(&planted, &all).anchors[1];
    assert!((loose.range_bias_m - planted.biases_m[1]).abs() < 0.2, "{}", loose.range_bias_m);
}

#[test]
fn with_truth_planted_biases_and_anchors_are_found_within_the_deviations_claimed() {
    let claims = claims(1..41, 120, true, 1.0);
    for (what, claims) in ["biases", "positions", "mean errors"].into_iter().zip(&claims) {
        println!("{what}: {:?}", claims.figures());
        assert!(claims.are_honest(), "{what}: {:?}", claims.figures());
    }
}

#[test]
fn without_truth_they_are_too() {
    let claims = claims(1..31, 100, false, 1.0);
    for (what, claims) in ["biases", "positions", "mean errors"].into_iter().zip(&claims) {
        println!("{what}: {:?}", claims.figures());
        assert!(claims.are_honest(), "{what}: {:?}", claims.figures());
    }
}

/// One range a cycle, as radios that range in turn: a free way could pass through every range. The noise must not vanish.
#[test]
fn without_truth_and_with_one_range_a_cycle_the_noise_stays() {
    let mut biases = Claims::default();
    for seed in 101..107 {
        let mut planted = planted(seed, 500, false);
        for (index, cycle) in planted.recording.cycles.iter_mut().enumerate() {
            cycle.ranges.retain(|range| range.anchor == index % ANCHORS.len());
        }
        let calibration = calibrated(&planted, &options(false));
        for (anchor, truth_m) in calibration.anchors.iter().zip(&planted.biases_m) {
            assert!((0.06..0.17).contains(&anchor.noise_std_m), "seed {seed}: {anchor:?}");
            biases.add(anchor.range_bias_m, anchor.range_bias_std_m, *truth_m);
        }
    }
    println!("biases: {:?}", biases.figures());
    let (mean_square, _) = biases.figures();
    assert!((0.3..2.0).contains(&mean_square), "{:?}", biases.figures());
}

/// The meter itself: of a calibration with the wrong sign it must not say that all is well.
#[test]
fn a_wrong_sign_is_seen() {
    let claims = claims(1..6, 120, true, -1.0);
    assert!(!claims[0].are_honest(), "biases: {:?}", claims[0].figures());
    assert!(!claims[1].are_honest(), "positions: {:?}", claims[1].figures());
}

#[test]
fn the_shape_of_errors_is_found() {
    let planted = planted(7, 600, false);
    let calibration = calibrated(&planted, &options(true));
    let (noise_m, share, excess_m, false_share) = ERRORS;
    let near = |value: f64, truth: f64, part: f64| (value / truth - 1.0).abs() < part;
    for anchor in &calibration.anchors {
        assert!(near(anchor.noise_std_m, noise_m, 0.2), "{anchor:?}");
        assert!(near(anchor.excess_share, share, 0.35), "{anchor:?}");
    }
    assert!(near(calibration.errors.excess_m, excess_m, 0.2), "{:?}", calibration.errors);
    assert!(near(calibration.errors.false_share, false_share, 0.6), "{:?}", calibration.errors);
}

#[test]
fn a_body_is_calibrated_at_its_antennas() {
    let mut honest = Claims::default();
    for seed in 1..11 {
        let planted = planted(seed, 200, true);
        let calibration = calibrated(&planted, &options(true));
        for (antenna, truth_m) in calibration.antennas.iter().zip(&planted.differences_m) {
            honest.add(antenna.difference_m, antenna.difference_std_m, *truth_m);
            assert!((antenna.difference_m - truth_m).abs() < 0.04, "seed {seed}: {antenna:?}");
        }
    }
    let (mean_square, _) = honest.figures();
    assert!((0.2..3.0).contains(&mean_square), "{:?}", honest.figures());
}

#[test]
fn what_cannot_be_known_is_said() {
    let mut planted = planted(3, 60, false);
    // Two anchors, no truth: where they are, and a bias common to both, is a matter of what was told.
    for cycle in &mut planted.recording.cycles {
        cycle.ranges.retain(|range| range.anchor < 2);
        cycle.truth_position_m = None;
    }
    let calibration = calibrated(&planted, &options(true));
    assert!(!calibration.with_truth);
    let said = calibration.unknown.join("\n");
    for part in
        ["Nothing of anchor 2", "bias common to all", "shift of all anchors", "turn of all", "The pulse"]
    {
        assert!(said.contains(part), "{part} is not in\n{said}");
    }
    // With the truth and five anchors biases are known.
    let known = calibrated(&self::planted(3, 200, false), &options(true)).unknown.join("\n");
    assert!(!known.contains("range bias of") && !known.contains("common to all"), "{known}");
}

/// Frames of a pulse of `duration_s`, the direct path half a metre behind the range and another path well behind it.
fn with_frames(mut planted: Planted, duration_s: f64, is_complex: bool) -> Planted {
    let pulse = Pulse::root_raised_cosine(duration_s as f32, 0.5);
    let mut rng = stream(11, Purpose::Noise, &[]);
    for cycle in &mut planted.recording.cycles {
        let range = cycle.ranges[0];
        let first_sample_delay_s = range.range_m / SPEED_OF_LIGHT_M_S - (30.0 + uniform(&mut rng)) * 1e-9;
        let delay_s = (range.range_m + 0.5) / SPEED_OF_LIGHT_M_S;
        let noisy: Vec<[f32; 2]> = (0..100)
            .map(|n| {
                let time_s = first_sample_delay_s + 1e-9 * f64::from(n);
                let at =
                    |delay_s: f64| f64::from(pulse.autocorrelation(((time_s - delay_s) / duration_s) as f32));
                let re = 100.0 * at(delay_s) + normal(&mut rng);
                [re as f32, (60.0 * at(delay_s + 6.0 * duration_s) + normal(&mut rng)) as f32]
            })
            .collect();
        let samples = match is_complex {
            true => Samples::Complex(noisy),
            false => Samples::Magnitude(noisy.iter().map(|[re, im]| re.hypot(*im)).collect()),
        };
        cycle.frames = vec![Frame {
            anchor: range.anchor,
            action: 0,
            first_sample_delay_s,
            first_path_index: None,
            line_of_sight: None,
            samples,
        }];
    }
    planted
}

#[test]
fn a_pulse_of_another_length_is_found_and_so_is_where_it_peaks() {
    for (is_complex, duration_s) in [(true, 2.8e-9), (false, 2.8e-9), (false, 2.0e-9), (true, 3.6e-9)] {
        let planted = with_frames(planted(5, 150, false), duration_s, is_complex);
        let calibration = calibrated(&planted, &options(true));
        let pulse = calibration.pulse.expect("frames show it");
        let found_s = 2e-9 * pulse.duration_factor;
        assert!((found_s / duration_s - 1.0).abs() < 0.1, "{duration_s:e}: {pulse:?}");
        let off = (pulse.duration_factor - duration_s / 2e-9) / pulse.duration_factor_std;
        assert!(off.abs() < 3.0, "{off} deviations: {pulse:?}");
        let (offset_m, std_m) = (pulse.peak_offset_m.unwrap(), pulse.peak_offset_std_m.unwrap());
        assert!((offset_m - 0.5).abs() < 0.02 + 3.0 * std_m, "{pulse:?}");
    }
}

#[test]
fn a_calibration_is_read_as_it_is_written_and_a_foreign_one_is_refused() {
    let planted = with_frames(planted(2, 60, true), 2e-9, false);
    let calibration = calibrated(&planted, &options(true));
    let folder = std::env::temp_dir().join(format!("cogmint-calibrate-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let path = folder.join("c.toml");
    std::fs::write(&path, calibration.to_toml().unwrap()).unwrap();
    let read = Calibration::read(&path).expect("is read");
    assert_eq!(read, calibration);
    let wrong = |change: &dyn Fn(&mut Recording)| {
        let mut other = planted.recording.clone();
        change(&mut other);
        read.applied(other, &path).expect_err("is refused").to_string()
    };
    assert!(wrong(&|r| r.anchors[1].name = "other".into()).contains("anchor 1, where planted 2 has other"));
    assert!(wrong(&|r| r.anchors[3].position_m[0] += 1.0).contains("anchor 3 told at"));
    assert!(wrong(&|r| r.anchors.truncate(3)).contains("5 anchors"));
    assert!(wrong(&|r| r.antennas.clear()).contains("front, back"));
    let broken = calibration.to_toml().unwrap().replace("range_bias_m", "range_bias");
    std::fs::write(&path, broken).unwrap();
    let refusal = Calibration::read(&path).expect_err("is no calibration").to_string();
    assert!(refusal.contains("range_bias"), "{refusal}");
    std::fs::remove_dir_all(&folder).unwrap();
    let rust = calibration.to_rust();
    for name in [
        "RANGE_CORRECTION_M: [f32; 5]",
        "ANTENNA_CORRECTION_M: [f32; 2]",
        "RANGE_BIAS_STD_M: [f32; 5]",
        "ROLL_OFF",
    ] {
        assert!(rust.contains(name), "{name} is not in\n{rust}");
    }
}

#[test]
fn an_applied_calibration_takes_the_bias_out_of_the_ranges_and_tells_of_the_excess() {
    let planted = planted(9, 200, false);
    let calibration = calibrated(&planted, &options(true));
    let applied = calibration.applied(planted.recording.clone(), Path::new("c.toml")).expect("is its own");
    let mut sums = [(0.0, 0.0); ANCHORS.len()];
    for (cycle, at) in applied.cycles.iter().zip(&planted.way_m) {
        for range in &cycle.ranges {
            let [x, y] = applied.anchors[range.anchor].position_m;
            let up = TAG_HEIGHT_M - ANCHORS[range.anchor].1;
            let error_m = range.range_m - (at[0] - x).hypot(at[1] - y).hypot(up);
            if error_m.abs() < 3.0 {
                sums[range.anchor] = (sums[range.anchor].0 + error_m, sums[range.anchor].1 + 1.0);
            }
        }
    }
    for (sum, count) in sums {
        // The excess stays in them: the tracker knows of it.
        let excess_m = ERRORS.1 * ERRORS.2;
        assert!((sum / count - excess_m).abs() < 0.08, "a mean error of {} m is left", sum / count);
    }
    let late_m = applied.radio.range_late_m;
    assert!((late_m / ERRORS.2).ln().abs() < 0.4, "{late_m}");
    let clutter = applied.association.clutter_per_anchor;
    assert!((0.002..0.05).contains(&clutter), "{clutter}");
}

/// The command on planted recordings in a folder of its own.
#[test]
fn the_command_writes_what_track_takes_and_refuses_what_it_cannot_use() {
    let folder = Folder::new("calibrate");
    let at = |name: &str| folder.path().join(name);
    planted(4, 160, false).recording.write(at("r")).unwrap();
    planted(5, 60, true).recording.write(at("body")).unwrap();
    let run = |line: &str| cogmint(folder.path(), &line.split(' ').collect::<Vec<_>>());

    let answer = json(&run("calibrate r --cycles odd --out c.toml --json"));
    assert_eq!((&answer["cycles"], &answer["with_truth"]), (&"odd".into(), &true.into()));
    assert_eq!(answer["anchors"].as_array().map(Vec::len), Some(ANCHORS.len()));
    let table = text(&run("calibrate r --no-truth --anchor-std-m 0.1").stdout);
    assert!(table.contains("the way estimated") && table.contains("What cannot be known"), "{table}");
    assert!(
        text(&run("calibrate r --format rust").stdout).contains("pub const RANGE_CORRECTION_M: [f32; 5]")
    );
    let printed = text(&run("calibrate r --cycles odd --format toml").stdout);
    assert_eq!(printed.trim(), std::fs::read_to_string(at("c.toml")).unwrap().trim());

    let rmse_m = |line: &str| {
        let outcome = json(&run(&format!("{line} --score even --no-figure --json")));
        assert_eq!((&outcome["cycles"], &outcome["scored"]), (&160.into(), &80.into()), "{outcome}");
        outcome["rmse_m"].as_f64().unwrap()
    };
    let (without_m, with_m) = (rmse_m("track r"), rmse_m("track r --calibration c.toml"));
    println!("even cycles, of odd ones: {without_m} m without, {with_m} m with");
    assert!(with_m < 0.9 * without_m, "{with_m} of {without_m} m");
    let several =
        json(&run("experiment tracking --recording r --starts 2 --score even --calibration c.toml --json"));
    assert!(several["scenarios"][0]["rmse_m"].as_f64().is_some_and(|m| m < 0.9 * without_m), "{several}");

    refused(&run("track body --calibration c.toml --no-figure"), &["c.toml", "antennas", "front, back"]);
    refused(&run("track r --calibration r/recording.toml --no-figure"), &["recording.toml"]);
    refused(&run("track r --calibration nothing.toml"), &["nothing.toml"]);
    refused(&run("track r --score 400.. --no-figure"), &["400..", "0 to 159"]);
    refused(&run("calibrate r body"), &["body", "antennas", "together"]);
    refused(&run("calibrate r --cycles 3..5"), &["10 ranges", "5 per anchor"]);
    refused(&run("calibrate r --cycles half"), &["half", "FROM..TO"]);
    refused(&run("calibrate r --anchor-std-m=-1"), &["--anchor-std-m"]);
    refused(&run("calibrate r --out r/recording.toml"), &["part of a recording"]);
    refused(&run("calibrate nothing"), &["nothing"]);
}
