//! A thinned recording is the same tag measured less often.

use cogmint::recording::{Frame, Motion, Range, Recording, Samples, TruthPath};
use cogmint::replay::inputs;
use cogmint::scenario::Scenario;
use cogmint::simulator::Simulator;
use cogmint::thin::Thinning;
use cogmint_tests::{Folder, cogmint};

/// Four anchors, each with a frame and two ranges in every cycle, ten cycles a second.
fn whole() -> Recording {
    let (scenario, _) = Scenario::find("dw3000-office").unwrap();
    let mut recording = Simulator::new(&scenario, None, 0, Some(1)).unwrap().before();
    recording.motion = Motion::of_acceleration(2.0);
    let cycle = |n: usize| cogmint::recording::Cycle {
        time_s: 5.0 + 0.1 * n as f64,
        truth_position_m: Some([1.0 + 0.01 * n as f64, 2.0]),
        tag_height_m: Some(1.2),
        ranges: (0..8)
            .map(|k| Range { anchor: k % 4, range_m: 1.0 + k as f64, std_m: Some(0.1), angles: None })
            .collect(),
        frames: (0..4)
            .map(|anchor| Frame {
                anchor,
                action: 0,
                first_sample_delay_s: 0.0,
                first_path_index: None,
                line_of_sight: None,
                samples: Samples::Magnitude(vec![1.0; 32]),
            })
            .collect(),
        truth_paths: (0..4)
            .map(|anchor| TruthPath {
                anchor,
                virtual_anchor: None,
                delay_s: 1e-8,
                magnitude: 1.0,
                sinr: 10.0,
            })
            .collect(),
        ..Default::default()
    };
    recording.cycles = (0..40).map(cycle).collect();
    recording
}

#[test]
fn cycles_kept_are_far_enough_apart_and_their_times_add_up() {
    let whole = whole();
    let thinned = Thinning { every_s: Some(0.3), ranges_per_cycle: None }.of(&whole);
    let kept: Vec<_> = whole.cycles.iter().step_by(3).cloned().collect();
    assert_eq!(thinned.cycles, kept);
    // The first has nothing before it.
    let elapsed = |recording: &Recording| inputs(recording).skip(1).map(|input| input.elapsed_s).sum::<f32>();
    assert!((elapsed(&thinned) - elapsed(&whole)).abs() < 1e-4);
    // A time that is no multiple of the period: the next cycle after it.
    let thinned = Thinning { every_s: Some(0.25), ranges_per_cycle: None }.of(&whole);
    assert_eq!(thinned.cycles, kept);
    // The motion is that of the whole recording, though cycles are longer.
    assert_eq!(thinned.acceleration_density_m2_s3(), whole.acceleration_density_m2_s3());
    assert!((thinned.acceleration_density_m2_s3() - 0.4).abs() < 1e-6);
}

#[test]
fn anchors_take_turns_and_bring_their_frames() {
    let whole = whole();
    for (most, turns) in
        [(1, [vec![0], vec![1], vec![2], vec![3]]), (3, [vec![0, 1], vec![2, 3], vec![0, 1], vec![2, 3]])]
    {
        let thinned = Thinning { every_s: None, ranges_per_cycle: Some(most) }.of(&whole);
        assert_eq!(thinned.cycles.len(), whole.cycles.len());
        for (kept, cycle) in thinned.cycles.iter().zip(&whole.cycles) {
            assert_eq!((kept.time_s, kept.truth_position_m), (cycle.time_s, cycle.truth_position_m));
            assert_eq!(kept.ranges.len(), most);
        }
        for (n, turn) in turns.iter().enumerate() {
            let kept = &thinned.cycles[n];
            let frames: Vec<usize> = kept.frames.iter().map(|frame| frame.anchor).collect();
            let paths: Vec<usize> = kept.truth_paths.iter().map(|path| path.anchor).collect();
            let mut ranges: Vec<usize> = kept.ranges.iter().map(|range| range.anchor).collect();
            ranges.dedup();
            assert_eq!((&ranges, &frames, &paths), (turn, turn, turn), "{most} ranges, cycle {n}");
        }
    }
    // Frames alone take turns as well.
    let mut framed = whole;
    framed.cycles.iter_mut().for_each(|cycle| cycle.ranges.clear());
    let thinned = Thinning { every_s: None, ranges_per_cycle: Some(2) }.of(&framed);
    let turns = thinned.cycles.iter().map(|cycle| [cycle.frames[0].anchor, cycle.frames[1].anchor]);
    assert_eq!(turns.take(3).collect::<Vec<_>>(), [[0, 1], [2, 3], [0, 1]]);
}

#[test]
fn the_command_writes_what_it_keeps_and_refuses_to_keep_everything() {
    let folder = Folder::new("thin");
    whole().write(folder.path().join("whole")).unwrap();
    let run = |arguments: &str| cogmint(folder.path(), &arguments.split(' ').collect::<Vec<_>>());
    let output = run("thin whole --out thinned --every-s 0.5 --ranges-per-cycle 1");
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(said.contains("8 of 40 cycles, 8 of 320 ranges, 8 of 160 frames"), "{said}");
    let thinned = Recording::read(folder.path().join("thinned")).unwrap();
    assert_eq!(thinned, Thinning { every_s: Some(0.5), ranges_per_cycle: Some(1) }.of(&whole()));
    for refused in ["thin whole --out t", "thin whole --out t --every-s 0", "thin none --out t --every-s 1"] {
        assert_eq!(run(refused).status.code(), Some(2), "{refused}");
    }
    assert!(!folder.path().join("t").exists());
}
