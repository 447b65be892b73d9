//! The simulated channel against closed forms: what goes in comes back out of the samples.

use cogmint::channel::pulse::PulseSpectrum;
use cogmint::channel::{Channel, FrameScratch, SPEED_OF_LIGHT_M_S, friis};
use cogmint::recording::Samples;
use cogmint::scenario::{BUILT_IN, Scenario};
use cogmint::simulator::Simulator;
use std::f64::consts::TAU;

/// A hall without reflections whose direct path is gone as well: what is left is noise, dense multipath and
/// interference. The way is 500 positions, 4 cm apart.
fn hall(more: &str) -> Scenario {
    let text = format!(
        r#"
        format = 1
        name = "hall"
        room = {{ corners_m = [[0, 0], [60, 0], [60, 60], [0, 60]], construction = "flat" }}
        anchors = [{{ name = "A", position_m = [10, 12] }}]
        trajectories = [{{ way.polyline = {{ vertices_m = [[18, 15], [36, 25]], step_m = 0.04 }}, cycles = 500 }}]
        propagation = {{ reflection_order = 0 }}
        obstructions = [{{ during = [0, 1], loss_db = 300 }}]
        {more}
        "#
    );
    Scenario::parse(&text, "hall").expect("is a valid scenario")
}

/// Frames that begin 10 ns before the direct path.
const WINDOW: &str = "radio = { window = { first_path = { sample = 40 } } }";
const QUIET: &str = "dense_multipath = { omega_1_db = -300 }";

/// The samples of every cycle of several seeds, first sample at the straight line's delay less `lead_s`.
fn frames(scenario: &Scenario, seeds: u64, action: usize, lead_s: f64) -> Vec<Vec<[f64; 2]>> {
    let mut frames = Vec::new();
    let mut scratch = FrameScratch::default();
    for seed in 0..seeds {
        let channel = Channel::new(scenario, None, 0, Some(seed)).expect("is usable");
        for cycle in 0..channel.poses().len() {
            let origin_s = channel.direct_delay_s(cycle, 0) - lead_s;
            let samples = channel.samples(cycle, 0, action, origin_s, &mut scratch, None);
            frames.push(samples.iter().map(|sample| [sample.re, sample.im]).collect());
        }
    }
    frames
}

/// Mean power per sample.
fn power(frames: &[Vec<[f64; 2]>]) -> Vec<f64> {
    let mut sum = vec![0.0; frames[0].len()];
    for frame in frames {
        sum.iter_mut().zip(frame).for_each(|(sum, [re, im])| *sum += re * re + im * im);
    }
    sum.iter().map(|sum| sum / frames.len() as f64).collect()
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

#[test]
fn the_white_noise_has_unit_power_and_the_colour_of_the_matched_filter() {
    let frames = frames(&hall(QUIET), 20, 20, 0.0);
    assert_eq!(frames.len(), 10_000);
    let total = mean(&power(&frames));
    assert!((total - 1.0).abs() < 0.003, "{total}");
    // Correlation of neighbours, half a pulse duration apart: the raised-cosine pulse.
    let mut sum = 0.0;
    for frame in &frames {
        sum += frame.windows(2).map(|pair| pair[0][0] * pair[1][0] + pair[0][1] * pair[1][1]).sum::<f64>();
    }
    let lag = sum / (frames.len() * 399) as f64;
    let (x, b) = (0.5, 0.6);
    let pi = std::f64::consts::PI;
    let expected = (pi * x).sin() / (pi * x) * (pi * b * x).cos() / (1.0 - (2.0 * b * x).powi(2));
    assert!((lag - expected).abs() < 0.01, "{lag} {expected}");
    println!("noise variance {total:.4} (1), neighbour correlation {lag:.4} ({expected:.4})");
}

#[test]
fn the_power_profile_of_dense_multipath_comes_back_from_ten_thousand_frames() {
    for fading in ["correlated", "independent"] {
        let more = format!(
            "radio = {{ window = {{ first_path = {{ sample = 40 }} }} }}\n noise = {{ snr_at_1_m_db = 80 }}\n dense_multipath = {{ omega_1_db = -10, fading = '{fading}' }}"
        );
        let lead_s = 10e-9;
        let frames = frames(&hall(&more), 20, 20, lead_s);
        assert_eq!(frames.len(), 10_000);
        let measured = power(&frames);
        // int S(t') R^2(t - t') dt' by the closed forms, and the fall of 1 / f^2 over the band.
        let (pi, b, duration) = (std::f64::consts::PI, 0.6, 0.5);
        let r = |t_ns: f64| {
            let x = t_ns / duration;
            if x.abs() < 1e-9 {
                return 1.0;
            }
            (pi * x).sin() / (pi * x) * (pi * b * x).cos() / (1.0 - (2.0 * b * x).powi(2))
        };
        let (g1, gr, chi) = (20.0, 5.0, 0.98);
        let profile = |t: f64| {
            if t < 0.0 {
                return 0.0;
            }
            (g1 + gr) / (g1 * (g1 + gr * (1.0 - chi))) * (1.0 - chi * (-t / gr).exp()) * (-t / g1).exp()
        };
        let pulse = PulseSpectrum::root_raised_cosine(0.5e-9, 0.6);
        let (mut weighted, mut plain) = (0.0, 0.0);
        for n in -400..400 {
            let offset_hz = (f64::from(n) + 0.5) * 4e6;
            let squared = pulse.power(offset_hz).powi(2);
            weighted += squared * (7e9 / (7e9 + offset_hz)).powi(2);
            plain += squared;
        }
        let expected = |t_ns: f64| {
            let step = 0.0123;
            let sum: f64 = (-400..400)
                .map(|n| (f64::from(n) + 0.5) * step)
                .map(|u| profile(t_ns - u) * r(u) * r(u) * step)
                .sum();
            1.0 + 1e7 * sum * weighted / plain
        };
        let mut worst = 0.0_f64;
        // Groups of 5 ns from 2 ns after the onset on.
        for group in 0..17 {
            let from = ((lead_s * 1e9 + 2.0 + 5.0 * f64::from(group)) / 0.25) as usize;
            let at = from..from + 20;
            let ours = mean(&measured[at.clone()]);
            let theirs = mean(&at.map(|n| expected(n as f64 * 0.25 - lead_s * 1e9)).collect::<Vec<_>>());
            worst = worst.max((ours / theirs - 1.0).abs());
        }
        println!("{fading}: power profile within {:.2} % in every group of 5 ns", 100.0 * worst);
        assert!(worst < 0.03, "{fading}: {worst}");
        // Before the onset there is noise alone.
        assert!((mean(&measured[..24]) - 1.0).abs() < 0.1, "{}", mean(&measured[..24]));
    }
}

#[test]
fn dense_multipath_is_correlated_over_space_by_the_bessel_function() {
    let mut worst = 0.0_f64;
    let pulse = PulseSpectrum::root_raised_cosine(0.5e-9, 0.6);
    for step_mm in [2.0, 5.0, 10.0, 16.4, 22.0, 30.0] {
        let mut scenario = hall(&format!(
            "{WINDOW}\n noise = {{ snr_at_1_m_db = 120 }}\n dense_multipath = {{ omega_1_db = -10 }}"
        ));
        // Pairs of positions, step_mm apart, every 40 cm.
        let mut vertices = Vec::new();
        for pair in 0..50 {
            let x = 15.0 + 0.4 * f64::from(pair);
            vertices.extend([[x, 30.0], [x + 1e-3 * step_mm, 30.0]]);
        }
        let poses = vertices.iter().enumerate().map(|(n, &position_m)| cogmint::geometry::trajectory::Pose {
            time_s: n as f64,
            position_m,
            height_m: None,
        });
        let poses: Vec<_> = poses.collect();
        scenario.noise.snr_at_1_m_db = 120.0;
        let (mut cross, mut own) = (0.0, 0.0);
        let mut scratch = FrameScratch::default();
        for seed in 0..17 {
            let channel = Channel::along(&scenario, poses.clone(), seed).expect("is usable");
            for pair in 0..50 {
                // The same clock for both: what moves is the tag.
                let origin_s = channel.direct_delay_s(2 * pair, 0) - 5e-9;
                let [a, b] =
                    [0, 1].map(|n| channel.samples(2 * pair + n, 0, 20, origin_s, &mut scratch, None));
                for (a, b) in a.iter().zip(&b) {
                    cross += (a * b.conj()).re;
                    own += 0.5 * (a.norm_sqr() + b.norm_sqr());
                }
            }
        }
        let (mut weighted, mut plain) = (0.0, 0.0);
        for n in -400..400 {
            let f_hz = 7e9 + (f64::from(n) + 0.5) * 4e6;
            let weight = (pulse.power(f_hz - 7e9) / f_hz).powi(2);
            weighted += weight * libm::j0(TAU * f_hz * 1e-3 * step_mm / SPEED_OF_LIGHT_M_S);
            plain += weight;
        }
        let (measured, expected) = (cross / own, weighted / plain);
        println!("{step_mm} mm apart: correlation {measured:.3}, J0 over the band {expected:.3}");
        worst = worst.max((measured - expected).abs());
    }
    assert!(worst < 0.03, "{worst}");
}

#[test]
fn an_interferer_is_heard_by_the_overlap_of_the_two_spectra() {
    let more = "noise = { snr_at_1_m_db = 80 }\n radio = { library = 'wide', window = { first_path = { sample = 40 } } }\n \
                dense_multipath = { omega_1_db = -300 }\n \
                interference = [{ during = [0, 0.5], strength = { omega_1 = 1.161517e-6 }, fading = 'independent' }]";
    let scenario = hall(more);
    let heard = |action: usize| {
        let frames = frames(&scenario, 8, action, 0.0);
        let during: Vec<_> =
            frames.iter().enumerate().filter(|(n, _)| n % 500 < 250).map(|(_, f)| f.clone()).collect();
        let after: Vec<_> =
            frames.iter().enumerate().filter(|(n, _)| n % 500 >= 250).map(|(_, f)| f.clone()).collect();
        assert!((mean(&power(&after)) - 1.0).abs() < 0.01, "silence after its part of the way");
        mean(&power(&during)) - 1.0
    };
    let own = heard(20);
    // Omega_1 of -10 dB at 80 dB: 1e7, of which 100 ns from the direct path on hold nearly all; T_eff / 100 ns of it
    // per sample.
    assert!((own / (1e7 * 0.425e-9 / 100e-9) - 1.0).abs() < 0.03, "{own}");
    for (action, overlap) in [(30, 0.5882), (10, 0.5882), (0, 0.0882)] {
        let share = heard(action) / own;
        println!("{:.1} GHz away: {share:.4} ({overlap})", (action as f64 - 20.0) / 10.0);
        assert!((share / overlap - 1.0).abs() < 0.03, "{action}: {share}");
    }
}

#[test]
fn a_direct_path_has_the_amplitude_of_friis_and_the_phase_of_its_carrier() {
    let mut scenario = hall("noise = { snr_at_1_m_db = 160 }\n dense_multipath = { omega_1_db = -300 }");
    scenario.obstructions.clear();
    let channel = Channel::new(&scenario, None, 0, None).expect("is usable");
    for action in [0, 13, 39] {
        let carrier_hz = channel.receiver().actions[action].carrier_hz;
        let delay_s = channel.direct_delay_s(7, 0);
        let origin_s = delay_s - 100.0 * 0.25e-9;
        let sample = channel.samples(7, 0, action, origin_s, &mut FrameScratch::default(), None)[100];
        let range_m = delay_s * SPEED_OF_LIGHT_M_S;
        let expected = 1e8 * (friis(range_m, carrier_hz) / friis(1.0, 7e9)).sqrt();
        // The mean of 1 / f over the band is a little more than at its middle: 1 + (beta / f)^2.
        let mean = 1.0 + (633.6626e6 / carrier_hz).powi(2);
        assert!((sample.norm() / (expected * mean) - 1.0).abs() < 1e-3, "{} {expected}", sample.norm());
        let phase = (sample.arg() + TAU * (carrier_hz * delay_s).fract()).rem_euclid(TAU);
        assert!(phase.min(TAU - phase) < 1e-3, "{action}: {phase}");
    }
    assert!((friis(1.0, 7e9) / 1.161517e-5 - 1.0).abs() < 1e-6);
}

#[test]
fn the_same_seed_gives_the_same_bits_whatever_the_number_of_threads() {
    for built_in in BUILT_IN {
        let scenario = Scenario::parse(built_in.text, built_in.name).expect("is valid");
        let with = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("starts");
            pool.install(|| Simulator::new(&scenario, None, 0, Some(7)).expect("is usable").record(12, || {}))
        };
        let (one, three) = (with(1), with(3));
        assert!(one == three, "{}", built_in.name);
        let simulator = Simulator::new(&scenario, None, 0, Some(7)).expect("is usable");
        let alone = simulator.cycle(11, simulator.scheduled_action(11));
        assert!(alone == one.cycles[11], "{}: a frame depends on those before it", built_in.name);
        let other = Simulator::new(&scenario, None, 0, Some(8)).expect("is usable").record(12, || {});
        assert!(other.cycles[3] != one.cycles[3], "{}: seeds do not matter", built_in.name);
    }
}

#[test]
fn a_strength_stated_as_a_median_sinr_is_met() {
    let text = BUILT_IN.iter().find(|b| b.name == "seminar-room").expect("is built in").text;
    let mut refused = Scenario::parse(text, "test").expect("is valid");
    refused.interference =
        Scenario::parse(&format!("{text}\n[[interference]]\nstrength.median_sinr_db = 60.0\n"), "test")
            .expect("is valid")
            .interference;
    let error = Channel::new(&refused, None, 1, None).err().expect("no path is that strong").to_string();
    assert!(error.contains("strength.median_sinr_db") && error.contains("already"), "{error}");
    println!("{error}");
    for wanted_db in [8.0, 5.0, 0.0] {
        let more =
            format!("\n[[interference]]\nduring = [0.3, 0.7]\nstrength.median_sinr_db = {wanted_db:.1}\n");
        let scenario = Scenario::parse(&format!("{text}{more}"), "test").expect("is valid");
        let channel = Channel::new(&scenario, None, 1, None).expect("is usable");
        let clean = Channel::new(&Scenario::parse(text, "test").expect("is valid"), None, 1, None);
        let clean = clean.expect("is usable");
        let mut sinrs = Vec::new();
        for cycle in 300..700 {
            for anchor in 0..2 {
                let used = clean.components(cycle, anchor, 20).into_iter().filter(|c| c.sinr >= 3.0);
                let used: Vec<usize> = used.map(|component| component.source).collect();
                let heard = channel.components(cycle, anchor, 20).into_iter();
                let heard = heard.filter(|component| used.contains(&component.source));
                sinrs.extend(heard.map(|component| 10.0 * component.sinr.log10()));
            }
        }
        sinrs.sort_by(f64::total_cmp);
        let median = sinrs[sinrs.len() / 2];
        assert!((median - wanted_db).abs() < 0.3, "{median} {wanted_db}");
    }
}

#[test]
fn a_dw3000_logs_counts_around_the_first_path_with_a_known_delay() {
    let text = BUILT_IN.iter().find(|b| b.name == "dw3000-office").expect("is built in").text;
    let mut scenario = Scenario::parse(text, "test").expect("is valid");
    scenario.errors.timestamp_std_s = 0.0;
    scenario.errors.clock_offset_s = 2e-9;
    for magnitude in [false, true] {
        if magnitude {
            scenario.radio.log = cogmint::scenario::Log::Magnitude;
        }
        let simulator = Simulator::new(&scenario, None, 0, None).expect("is usable");
        let cycle = simulator.cycle(3, 0);
        for frame in &cycle.frames {
            let parts: Vec<f32> = match &frame.samples {
                Samples::Complex(samples) => samples.iter().flatten().copied().collect(),
                Samples::Magnitude(samples) => samples.clone(),
            };
            let largest = parts.iter().fold(0.0_f32, |largest, part| largest.max(part.abs()));
            assert!(largest < 131_072.0 * 1.5 && largest > 30_000.0, "{largest}");
            if magnitude {
                assert!(parts.iter().all(|&part| part >= 0.0));
            } else {
                assert!(parts.iter().all(|part| part.fract() == 0.0), "counts");
            }
            let first_s = simulator.channel().first_path_s(3, frame.anchor);
            // Where the logged axis shows the first path: its delay and the clock's offset.
            let index = (first_s + 2e-9 - frame.first_sample_delay_s) * 998.4e6;
            assert!((740.0..741.0).contains(&index), "{index}");
        }
    }
}

#[test]
fn dense_multipath_belongs_to_the_room_and_noise_to_the_trajectory() {
    let two_ways = |more: &str| {
        let mut scenario = hall(more);
        let mut second = scenario.trajectories[0].clone();
        // The same places, and more of them behind.
        second.cycles = Some(510);
        scenario.trajectories.push(second);
        [0, 1].map(|trajectory| Channel::new(&scenario, None, trajectory, Some(3)).expect("is usable"))
    };
    let correlation = |channels: &[Channel; 2]| {
        let (mut cross, mut own) = (0.0, 0.0);
        for cycle in (0..500).step_by(25) {
            let [a, b] =
                [0, 1].map(|n| channels[n].samples(cycle, 0, 20, 30e-9, &mut FrameScratch::default(), None));
            for (a, b) in a.iter().zip(&b) {
                cross += (a * b.conj()).re;
                own += 0.5 * (a.norm_sqr() + b.norm_sqr());
            }
        }
        cross / own
    };
    let same =
        correlation(&two_ways("noise = { snr_at_1_m_db = 120 }\n dense_multipath = { omega_1_db = -10 }"));
    assert!(same > 0.999, "{same}");
    let noise = correlation(&two_ways(QUIET));
    assert!(noise.abs() < 0.05, "{noise}");
    let independent = "noise = { snr_at_1_m_db = 120 }\n dense_multipath = { fading = 'independent' }";
    let independent = correlation(&two_ways(independent));
    assert!(independent.abs() < 0.1, "{independent}");
}

/// What is said of noise and multipath at the direct path's delay is what the samples there show, also for pulses as
/// long as the profile's onset.
#[test]
fn the_disturbance_that_sinr_counts_is_the_power_of_the_samples() {
    for (radio, pulse) in [
        ("kind = 'sounder'", "0.5 ns"),
        ("kind = 'dw1000', window = { first_path = { sample = 100 } }", "2 ns"),
    ] {
        let more = format!(
            "radio = {{ {radio} }}\n noise = {{ snr_at_1_m_db = 70 }}\n dense_multipath = {{ omega_1_db = -10, fading = 'independent' }}"
        );
        let mut scenario = hall(&more);
        // The direct path is as good as gone: what is left at its delay disturbs it.
        scenario.obstructions[0].loss_db = 300.0;
        let (mut measured, mut claimed) = (0.0, 0.0);
        let mut scratch = FrameScratch::default();
        for seed in 0..8 {
            let channel = Channel::new(&scenario, None, 0, Some(seed)).expect("is usable");
            let spacing_s = channel.receiver().sample_spacing_s;
            let action = channel.receiver().first_action;
            for cycle in 0..500 {
                let delay_s = channel.direct_delay_s(cycle, 0);
                let origin_s = delay_s - 20.0 * spacing_s;
                let samples = channel.samples(cycle, 0, action, origin_s, &mut scratch, None);
                measured += samples[20].norm_sqr();
                claimed += channel.disturbance(cycle, 0, action, delay_s);
            }
        }
        println!("{pulse}: measured over claimed disturbance {:.3}", measured / claimed);
        // 4000 exponentially distributed powers: 1.6 %.
        assert!((measured / claimed - 1.0).abs() < 0.07, "{pulse}: {}", measured / claimed);
    }
}
