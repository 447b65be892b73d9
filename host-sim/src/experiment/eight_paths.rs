//! Frames of eight paths in dense multipath, as a recording: what the estimator's cost on the target is counted on.

use super::response::{Dense, ResponseMaker, TruePath as DrawnPath};
use crate::channel::cis;
use crate::channel::pulse::PulseSpectrum;
use crate::channel::random::{Purpose, stream, uniform};
use crate::recording::{
    Action, Anchor, AssociationModel, Cycle, Frame, Motion, Radio, Recording, Samples, Start, TruthPath,
};

const DURATION_S: f64 = 0.5e-9;
const ROLL_OFF: f64 = 0.6;
const SPACING_S: f64 = 0.25e-9;
const SAMPLES: usize = 400;
/// Delay in ns and SINR in dB: a direct path, one 1.4 T_p after it, and six later ones.
const EIGHT: [(f64, f64); 8] = [
    (12.0, 34.0),
    (12.7, 25.0),
    (17.0, 22.0),
    (22.5, 20.0),
    (29.0, 18.0),
    (37.0, 17.0),
    (46.0, 16.0),
    (57.0, 16.0),
];
/// Power of the dense multipath over the white noise.
const OMEGA: f64 = 316.227_766;

/// `frames` such frames, one per cycle, of one anchor, with true paths.
pub fn eight_paths(frames: usize, seed: u64) -> Recording {
    let mut maker =
        ResponseMaker::new(PulseSpectrum::root_raised_cosine(DURATION_S, ROLL_OFF), SAMPLES, SPACING_S);
    let cycles = (0..frames).map(|cycle| {
        let mut rng = stream(seed, Purpose::Experiment, &[600, cycle]);
        let dense = |onset_s| Some(Dense { omega: OMEGA, onset_s });
        let mut sinrs = Vec::new();
        let mut paths = Vec::new();
        for (delay_ns, sinr_db) in EIGHT {
            let delay_s = (delay_ns + 0.25 * (uniform(&mut rng) - 0.5)) * 1e-9;
            let sinr = 10f64.powf(sinr_db / 10.0);
            let power = sinr * maker.level(dense(EIGHT[0].0 * 1e-9), delay_ns * 1e-9);
            let amplitude = cis(std::f64::consts::TAU * uniform(&mut rng)) * power.sqrt();
            sinrs.push(sinr);
            paths.push(DrawnPath { delay_s, amplitude });
        }
        let samples = maker.draw(&mut rng, &paths, dense(paths[0].delay_s));
        let truth = paths.iter().zip(sinrs).map(|(path, sinr)| TruthPath {
            anchor: 0,
            virtual_anchor: None,
            delay_s: path.delay_s,
            magnitude: path.amplitude.norm(),
            sinr,
        });
        Cycle {
            time_s: cycle as f64,
            frames: vec![Frame {
                anchor: 0,
                action: 0,
                first_sample_delay_s: 0.0,
                first_path_index: None,
                line_of_sight: None,
                samples: Samples::Complex(samples),
            }],
            truth_paths: truth.collect(),
            ..Cycle::default()
        }
    });
    Recording {
        name: "eight-paths".into(),
        source: format!("simulated: eight paths per frame in dense multipath, seed {seed}"),
        motion: Motion::of_acceleration(0.01),
        start: Start {
            position_m: [3.6, 0.0],
            position_std_m: 0.25,
            velocity_std_m_s: 0.03,
            disc_radius_m: None,
            drawn_about_m: None,
        },
        association: AssociationModel {
            detection_probability: 0.95,
            clutter_per_anchor: 1.0,
            max_range_m: 30.0,
        },
        radio: Radio {
            pulse_duration_s: DURATION_S,
            roll_off: ROLL_OFF,
            sampled_pulse: None,
            gain_control: false,
            begins_with_path: false,
            sample_spacing_s: Some(SPACING_S),
            range_std_m: 0.05,
            range_bias_mean_m: 0.0,
            range_bias_std_m: 0.0,
            range_late_m: 0.0,
            range_floor_pulses: None,
        },
        anchors: vec![Anchor::new("A", [0.0, 0.0], 0.0)],
        virtual_anchors: Vec::new(),
        actions: vec![Action { carrier_hz: 7e9, pulse_duration_s: DURATION_S }],
        walls: Vec::new(),
        plan: None,
        antennas: Vec::new(),
        cycles: cycles.collect(),
    }
}
