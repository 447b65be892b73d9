//! Defects of the radio: in what all its frames differ from what trackers are told of it, in every room alike.
//!
//! They change the recording, after the room was simulated.

use super::RandomRoom;
use super::incident::leave_out_beyond;
use crate::channel::SPEED_OF_LIGHT_M_S;
use crate::channel::pulse::PulseSpectrum;
use crate::channel::receiver::Receiver;
use crate::input_error::InputError;
use crate::recording::{Recording, Samples};
use crate::scenario::{Converter, Pulse};
use crate::simulator::Simulator;
use rustfft::num_complex::Complex64;
use serde::Serialize;

/// Pulse that is told, over the true one.
const LONG: f64 = 1.2;
/// How late the peak of the pulse is, metres.
const LATE_M: f64 = 0.1;
/// Bits of a part of a complex sample; one of them is the sign, which a magnitude does not need.
const BITS: u32 = 8;
/// Power of a side lobe over that of the main lobe: -10 dB.
const SIDE_LOBE_POWER: f64 = 0.1;
/// How far it is from the main lobe, pulse durations.
const SIDE_LOBE_PULSES: f64 = 1.5;
/// Samples per pulse duration of a pulse with side lobes: a whole number of them lie between the lobes.
const PULSE_STEPS: f64 = 4.0;
/// How far such a pulse reaches to either side, steps: 16 pulse durations.
const PULSE_REACH: i32 = 64;

/// In what all frames differ from what is told of the radio.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Defect {
    /// The pulse that is told is 20 % longer than the true one.
    PulseLong,
    /// The peak of the pulse is 0.1 m late: all ranges are so much too long.
    PeakLate,
    /// Samples of 8 bits, full scale at the largest part of every frame.
    EightBit,
    /// The pulse has side lobes of -10 dB, 1.5 durations before and after its peak.
    SideLobes,
}

impl Defect {
    /// All of them.
    pub const ALL: [Defect; 4] = [Defect::PulseLong, Defect::PeakLate, Defect::EightBit, Defect::SideLobes];

    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Defect::PulseLong => "pulse-long",
            Defect::PeakLate => "peak-late",
            Defect::EightBit => "eight-bit",
            Defect::SideLobes => "side-lobes",
        }
    }

    /// Changes the recording of a room.
    ///
    /// # Errors
    /// The room cannot be simulated with that pulse.
    pub fn spoil(self, room: &RandomRoom, recording: &mut Recording) -> Result<(), InputError> {
        match self {
            Defect::PulseLong => tell_longer(recording, LONG),
            Defect::PeakLate => delay(recording, LATE_M),
            Defect::EightBit => quantise(recording, BITS),
            Defect::SideLobes => {
                let mut scenario = room.scenario.clone();
                let receiver = Receiver::new(&scenario.radio);
                scenario.radio.pulse = Some(with_side_lobes(&receiver, SIDE_LOBE_POWER));
                let spoilt = Simulator::new(&scenario, None, 0, None)?.record(usize::MAX, || {});
                // All that is told stays.
                recording.cycles = spoilt.cycles;
            }
        }
        Ok(())
    }
}

/// Tells pulses so many times as long.
fn tell_longer(recording: &mut Recording, times: f64) {
    recording.radio.pulse_duration_s *= times;
    if let Some(pulse) = &mut recording.radio.sampled_pulse {
        pulse.step_s *= times;
    }
    for action in &mut recording.actions {
        action.pulse_duration_s *= times;
    }
}

/// Takes every frame for so much later than it is. The true paths stay where they are.
fn delay(recording: &mut Recording, by_m: f64) {
    let longest_m = recording.association.max_range_m;
    for cycle in &mut recording.cycles {
        for frame in &mut cycle.frames {
            frame.first_sample_delay_s += by_m / SPEED_OF_LIGHT_M_S;
        }
        leave_out_beyond(cycle, longest_m);
    }
}

/// Rounds every frame to so many bits, the largest part at full scale. Its unit stays.
fn quantise(recording: &mut Recording, bits: u32) {
    let converter = |bits: u32| {
        let half_range = libm::exp2(f64::from(bits - 1));
        Converter { bits, level: (half_range - 1.0) / half_range }
    };
    for frame in recording.cycles.iter_mut().flat_map(|cycle| &mut cycle.frames) {
        match &mut frame.samples {
            Samples::Complex(samples) => {
                let parts = samples.iter().map(|[re, im]| Complex64::new(f64::from(*re), f64::from(*im)));
                let mut counts: Vec<Complex64> = parts.collect();
                let gain = converter(bits).convert(&mut counts);
                for (sample, count) in samples.iter_mut().zip(counts) {
                    *sample = [(count.re / gain) as f32, (count.im / gain) as f32];
                }
            }
            Samples::Magnitude(samples) => {
                let mut counts: Vec<Complex64> =
                    samples.iter().map(|magnitude| Complex64::new(f64::from(*magnitude), 0.0)).collect();
                let gain = converter(bits + 1).convert(&mut counts);
                for (sample, count) in samples.iter_mut().zip(counts) {
                    *sample = (count.re / gain) as f32;
                }
            }
        }
    }
}

/// The pulse of a receiver's first action with an echo, so that behind the matched filter a lobe of this power stands on either side of
/// its peak: with R what the matched filter makes of the pulse alone, R(t) + s (R(t - d) + R(t + d)), s^2 being that power, over its
/// value at 0.
fn with_side_lobes(receiver: &Receiver, power: f64) -> Pulse {
    let duration_s = receiver.actions[receiver.first_action].pulse_duration_s;
    let own = PulseSpectrum::new(&receiver.pulse, duration_s, receiver.sample_spacing_s);
    let spacing_s = duration_s / PULSE_STEPS;
    let lag = (SIDE_LOBE_PULSES * PULSE_STEPS) as i32;
    // An echo of amplitude a makes lobes of a / (1 + a^2) = s.
    let s = power.sqrt();
    let echo = (1.0 - (1.0 - 4.0 * power).max(0.0).sqrt()) / (2.0 * s);
    let at = |step: i32| {
        if step.abs() > PULSE_REACH { 0.0 } else { own.transmitted(f64::from(step) * spacing_s) }
    };
    let sample = |step: i32| [at(step) + echo * at(step - lag), 0.0];
    Pulse::Sampled { spacing_s, samples: (-PULSE_REACH..=PULSE_REACH + lag).map(sample).collect() }
}

#[cfg(test)]
mod tests {
    use super::super::{Plan, Receiver as Radio, Restriction, Start, room};
    use super::*;
    use crate::experiment::side_by_side::run::{Judging, Run};
    use crate::experiment::side_by_side::{Tracker, run_recording};
    use crate::recording::Frame;
    use crate::replay::Setup;
    use std::path::Path;

    /// The first room of four anchors with such a radio, of some cycles, and its recording.
    fn recorded(radio: Radio) -> (RandomRoom, Recording) {
        let restriction = Restriction {
            plans: vec![Plan::Exact],
            starts: vec![Start::Quarter],
            anchors: vec![4],
            ..Restriction::default()
        };
        let mut rooms = (1..200).map(|seed| room(seed, &restriction).unwrap());
        let mut room = rooms.find(|room| room.drawn.radio == radio).unwrap();
        room.scenario.trajectories[0].cycles = Some(60);
        let recording = record(&room);
        (room, recording)
    }

    fn record(room: &RandomRoom) -> Recording {
        Simulator::new(&room.scenario, None, 0, None).unwrap().record(usize::MAX, || {})
    }

    fn spoilt(defect: Defect, room: &RandomRoom, recording: &Recording) -> Recording {
        let mut spoilt = recording.clone();
        defect.spoil(room, &mut spoilt).unwrap();
        spoilt
    }

    fn frames(recording: &Recording) -> impl Iterator<Item = &Frame> {
        recording.cycles.iter().flat_map(|cycle| &cycle.frames)
    }

    /// The parts of all samples.
    fn parts(frame: &Frame) -> Vec<f64> {
        match &frame.samples {
            Samples::Complex(samples) => samples.iter().flatten().map(|part| f64::from(*part)).collect(),
            Samples::Magnitude(samples) => samples.iter().map(|sample| f64::from(*sample)).collect(),
        }
    }

    #[test]
    fn a_pulse_is_told_longer_and_nothing_else_changes() {
        let (room, before) = recorded(Radio::Dw1000);
        let after = spoilt(Defect::PulseLong, &room, &before);
        assert_eq!(before.cycles, after.cycles);
        for (before, after) in before.actions.iter().zip(&after.actions) {
            assert!((after.pulse_duration_s / before.pulse_duration_s - 1.2).abs() < 1e-12);
            assert_eq!(before.carrier_hz, after.carrier_hz);
        }
        let [told_s, true_s] = [&after, &before].map(|recording| recording.radio.pulse_duration_s);
        assert!((told_s / true_s - 1.2).abs() < 1e-12);
        // What the tracker is told to expect of a frame.
        let pulse = Setup::new(&after, Path::new("r"), None).unwrap().actions[0].pulse_duration_s;
        assert!((f64::from(pulse) / before.actions[0].pulse_duration_s - 1.2).abs() < 1e-6);
    }

    #[test]
    fn every_frame_is_late_by_as_much() {
        let (room, before) = recorded(Radio::Sounder);
        let after = spoilt(Defect::PeakLate, &room, &before);
        assert_eq!(frames(&before).count(), frames(&after).count());
        for (before, after) in frames(&before).zip(frames(&after)) {
            let late_m = SPEED_OF_LIGHT_M_S * (after.first_sample_delay_s - before.first_sample_delay_s);
            assert!((late_m - 0.1).abs() < 1e-6, "{late_m}");
            assert_eq!(before.samples, after.samples);
        }
        assert!(before.cycles.iter().zip(&after.cycles).all(|(a, b)| a.truth_paths == b.truth_paths));
        assert_eq!((&before.radio, &before.actions), (&after.radio, &after.actions));
    }

    #[test]
    fn samples_are_whole_counts_of_eight_bits() {
        for (radio, counts) in [(Radio::Sounder, 127.0), (Radio::Dw1000Magnitude, 255.0)] {
            let (room, before) = recorded(radio);
            let after = spoilt(Defect::EightBit, &room, &before);
            for (before, after) in frames(&before).zip(frames(&after)) {
                let (before, after) = (parts(before), parts(after));
                let step = before.iter().fold(0.0, |most: f64, part| most.max(part.abs())) / counts;
                for (before, after) in before.iter().zip(&after) {
                    let count = after / step;
                    assert!((count - count.round()).abs() < 1e-4 && count.abs() < counts + 0.5, "{count}");
                    assert!((after - before).abs() < 0.501 * step, "{before} {after} {step}");
                }
                assert!(before != after);
            }
        }
    }

    /// Without noise a frame is a sum of pulses: each lobe is the frame itself, six quarters of a pulse duration, here three samples,
    /// earlier or later.
    #[test]
    fn a_frame_with_side_lobes_is_the_frame_three_times() {
        let (mut room, _) = recorded(Radio::Sounder);
        room.scenario.noise.snr_at_1_m_db = 200.0;
        room.scenario.dense_multipath.omega_1_db = -300.0;
        room.scenario.interference.clear();
        let before = record(&room);
        let after = spoilt(Defect::SideLobes, &room, &before);
        assert_eq!((&before.radio, &before.actions), (&after.radio, &after.actions));
        let lobe = 0.1_f64.sqrt();
        // Raised cosine of roll-off 0.6 at 1.5 pulse durations.
        let pi = std::f64::consts::PI;
        let own = (1.5 * pi).sin() / (1.5 * pi) * (0.9 * pi).cos() / (1.0 - 1.8 * 1.8);
        let mut checked = 0;
        for (before, after) in frames(&before).zip(frames(&after)) {
            let (before, after) = (parts(before), parts(after));
            let largest = before.iter().fold(0.0, |most: f64, part| most.max(part.abs()));
            // Pairs of parts.
            for n in 6..before.len() - 6 {
                let expected =
                    (before[n] + lobe * (before[n - 6] + before[n + 6])) / (1.0 + 2.0 * lobe * own);
                assert!((after[n] - expected).abs() < 3e-3 * largest, "{n}: {} {expected}", after[n]);
                checked += usize::from((after[n] - before[n]).abs() > 0.05 * largest);
            }
        }
        assert!(checked > 1000, "{checked}");
    }

    fn tracked(recording: &Recording) -> Run {
        let file = Path::new("r");
        let setup = Setup::new(recording, file, None).unwrap();
        let judging = Judging::default();
        run_recording(recording, &setup, file, &[Tracker::Cogmint], &judging).unwrap().runs.remove(0)
    }

    /// The meter shows a failure: twenty times as late, five times as long, two bits.
    #[test]
    fn what_is_far_worse_loses_the_tag_or_most_of_its_accuracy() {
        let (_, sound) = recorded(Radio::Sounder);
        let usual = tracked(&sound);
        assert!(!usual.lost, "{usual:?}");
        let with = |spoil: &dyn Fn(&mut Recording)| {
            let mut recording = sound.clone();
            spoil(&mut recording);
            tracked(&recording)
        };
        let late = with(&|recording| delay(recording, 20.0 * LATE_M));
        assert!(late.lost, "{late:?}");
        for spoil in [
            &(|recording: &mut Recording| tell_longer(recording, 5.0)) as &dyn Fn(&mut Recording),
            &|recording| quantise(recording, 2),
        ] {
            let worse = with(spoil);
            println!("{:?} {:?}", worse.rmse_m, usual.rmse_m);
            assert!(worse.rmse_m > usual.rmse_m.map(|rmse_m| 1.5 * rmse_m), "{worse:?} {usual:?}");
        }
    }
}
