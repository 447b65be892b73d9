//! The built-in room: enough of a channel to see the cycle at work without a file.
//!
//! A rectangular room with two anchors; image sources to second order in its four walls (12 per anchor, the
//! reference size of the core), flat reflection; Friis gain
//! at the carrier, coherent phases; dense multipath behind every direct path; white noise; and, for part of the way,
//! an interferer 2 GHz wide at 7 GHz that a carrier further away hears less of, as the overlap of the two spectra
//! says. Frames are what leaves the receiver's matched filter.
//!
//! Everything random follows from the seed, the cycle and the anchor, so a frame does not depend on which were asked
//! for before it.

use crate::recording::{self, Recording};
use cogmint_core::controller::library::{Action, LIBRARY_WIDE, Library};
use cogmint_core::pulse::Pulse;
use rand_core::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro128PlusPlus;

const SPEED_OF_LIGHT_M_S: f64 = 299_792_458.0;
/// Width and depth, metres.
const ROOM_M: [f64; 2] = [6.0, 8.5];
/// The anchors, metres.
const ANCHORS_M: [[f64; 2]; 2] = [[0.5, 7.0], [5.2, 3.2]];
/// Corners of the tag's way, metres; it moves 1 cm per cycle.
const WAY_M: [[f64; 2]; 4] = [[3.0, 7.8], [2.2, 7.8], [2.2, 5.5], [1.0, 5.5]];
/// Way per cycle, metres, and time per cycle, seconds.
const STEP_M: f64 = 0.01;
const PERIOD_S: f64 = 1.0;
const PULSE_DURATION_S: f64 = 0.5e-9;
const ROLL_OFF: f64 = 0.6;
const SAMPLE_SPACING_S: f64 = 0.25e-9;
/// 400 samples: 100 ns, 30 m.
const SAMPLES: usize = 400;
/// Amplitude left by a reflection: 3 dB of power lost.
const REFLECTION: f64 = 0.708;
/// SNR of the direct path at 1 m and 7 GHz: 40 dB.
const SNR_AT_1_M: f64 = 1e4;
/// Energy of the dense multipath over the direct path's at 1 m: -17 dB.
const DENSE_SHARE: f64 = 0.02;
/// Carrier of the interferer, hertz, and its power over the white noise at its own carrier.
const INTERFERER_HZ: f64 = 7e9;
const INTERFERER_OVER_NOISE: f64 = 250.0;
/// Share of the way during which the interferer transmits.
const INTERFERED: [f64; 2] = [0.3, 0.8];
/// Standard deviation of the virtual anchors on the floor plan that the tracker gets, metres.
const PLAN_STD_M: f64 = 0.1;

/// The carrier the tracker starts with, and the fixed one keeps: 7 GHz.
pub const FIRST_ACTION: usize = 20;

/// The room with one seed's randomness.
#[derive(Clone, Debug)]
pub struct Room {
    seed: u64,
    cycles: usize,
    library: Library<40>,
    /// The pulse's autocorrelation between half-sample lags, for colouring noise: root-raised-cosine taps.
    filter: Vec<f64>,
}

impl Room {
    /// A room whose tag walks for `cycles` cycles; the way has room for 420, then the tag turns round.
    pub fn new(seed: u64, cycles: usize) -> Self {
        let library = Library::new(&LIBRARY_WIDE).expect("the library's own actions are in range");
        let filter = (-24..=24).map(|n| root_raised_cosine(f64::from(n) * 0.5) * 0.5_f64.sqrt()).collect();
        Self { seed, cycles, library, filter }
    }

    /// Walls, each from end to end, metres.
    pub fn walls(&self) -> Vec<[[f64; 2]; 2]> {
        let [w, d] = ROOM_M;
        vec![[[0.0, 0.0], [w, 0.0]], [[w, 0.0], [w, d]], [[w, d], [0.0, d]], [[0.0, d], [0.0, 0.0]]]
    }

    /// Number of cycles.
    pub fn cycles(&self) -> usize {
        self.cycles
    }

    /// Cycles during which the interferer transmits, from and to.
    pub fn interfered(&self) -> [usize; 2] {
        INTERFERED.map(|share| (share * self.cycles as f64) as usize)
    }

    /// True position of the tag, metres.
    pub fn position_m(&self, cycle: usize) -> [f64; 2] {
        let legs: Vec<f64> =
            WAY_M.windows(2).map(|ends| (ends[1][0] - ends[0][0]).hypot(ends[1][1] - ends[0][1])).collect();
        let total: f64 = legs.iter().sum();
        let walked = cycle as f64 * STEP_M;
        // There and back again.
        let phase = walked % (2.0 * total);
        let mut left = if phase > total { 2.0 * total - phase } else { phase };
        for (ends, leg) in WAY_M.windows(2).zip(&legs) {
            if left <= *leg {
                let share = left / leg;
                return [0, 1].map(|axis| ends[0][axis] + share * (ends[1][axis] - ends[0][axis]));
            }
            left -= leg;
        }
        WAY_M[WAY_M.len() - 1]
    }

    /// Images of an anchor in the four walls to second order, with their number of reflections. A rectangle tiles
    /// the plane with mirrored copies of itself, and every image is seen from everywhere.
    fn images_m(anchor: usize) -> Vec<([f64; 2], i32)> {
        let coordinate = |tile: i32, axis: usize| {
            let (size, inside) = (ROOM_M[axis], ANCHORS_M[anchor][axis]);
            f64::from(tile) * size + if tile % 2 == 0 { inside } else { size - inside }
        };
        let tiles = (-2..=2).flat_map(|i: i32| (-2..=2).map(move |j: i32| (i, j, i.abs() + j.abs())));
        tiles
            .filter(|(_, _, order)| (1..=2).contains(order))
            .map(|(i, j, order)| ([coordinate(i, 0), coordinate(j, 1)], order))
            .collect()
    }

    /// The recording of this room without any cycle: what a tracker knows before it starts. The floor plan is off by
    /// its stated deviation.
    pub fn before(&self) -> Recording {
        let mut rng = self.rng(usize::MAX, 0);
        let virtual_anchors = (0..ANCHORS_M.len())
            .flat_map(|anchor| Self::images_m(anchor).into_iter().map(move |(image, _)| (anchor, image)))
            .map(|(anchor, [x, y])| {
                let [ex, ey] = complex_normal(&mut rng).map(|e| e * std::f64::consts::SQRT_2 * PLAN_STD_M);
                recording::VirtualAnchor::new(anchor, [x + ex, y + ey], PLAN_STD_M, true)
            })
            .collect();
        let action = |action: &Action| recording::Action {
            carrier_hz: f64::from(action.carrier_hz),
            pulse_duration_s: f64::from(action.pulse_duration_s),
        };
        Recording {
            name: "built-in room".into(),
            source: format!("simulated by cogmint, seed {}", self.seed),
            motion: recording::Motion { acceleration_std_m_s2: 0.01 },
            start: recording::Start {
                position_m: self.position_m(0),
                position_std_m: 0.25,
                velocity_std_m_s: 0.03,
                disc_radius_m: Some(0.5),
            },
            association: recording::AssociationModel {
                detection_probability: 0.8,
                clutter_per_anchor: 0.1,
                max_range_m: 30.0,
            },
            radio: recording::Radio {
                pulse_duration_s: PULSE_DURATION_S,
                roll_off: ROLL_OFF,
                sample_spacing_s: Some(SAMPLE_SPACING_S),
                range_std_m: 0.05,
                range_bias_mean_m: 0.0,
                range_bias_std_m: 0.0,
            },
            anchors: ANCHORS_M
                .iter()
                .enumerate()
                .map(|(index, position_m)| recording::Anchor {
                    name: format!("A{}", index + 1),
                    position_m: *position_m,
                    height_m: 0.0,
                })
                .collect(),
            virtual_anchors,
            actions: LIBRARY_WIDE.iter().map(action).collect(),
            walls: self.walls(),
            cycles: Vec::new(),
        }
    }

    /// What both anchors' frames of a cycle look like when received with `action`.
    pub fn cycle(&self, cycle: usize, action: usize) -> recording::Cycle {
        recording::Cycle {
            time_s: cycle as f64 * PERIOD_S,
            truth_position_m: Some(self.position_m(cycle)),
            tag_height_m: None,
            ranges: Vec::new(),
            truth_paths: Vec::new(),
            frames: (0..ANCHORS_M.len())
                .map(|anchor| recording::Frame {
                    anchor,
                    action,
                    first_sample_delay_s: 0.0,
                    samples: recording::Samples::Complex(self.samples(cycle, anchor, action)),
                })
                .collect(),
        }
    }

    fn rng(&self, cycle: usize, anchor: usize) -> Xoshiro128PlusPlus {
        let mixed = (cycle as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ (anchor as u64) << 56;
        Xoshiro128PlusPlus::seed_from_u64(self.seed ^ mixed)
    }

    /// Samples in units of the white noise's standard deviation.
    fn samples(&self, cycle: usize, anchor: usize, action: usize) -> Vec<[f32; 2]> {
        let mut rng = self.rng(cycle, anchor);
        let carrier_hz =
            self.library.get(action).map_or(INTERFERER_HZ, |action| f64::from(action.carrier_hz));
        let pulse = Pulse { duration_s: PULSE_DURATION_S as f32, roll_off: ROLL_OFF as f32 };
        let [x, y] = self.position_m(cycle);
        let sources = std::iter::once((ANCHORS_M[anchor], 1.0))
            .chain(Self::images_m(anchor).into_iter().map(|(image, order)| (image, REFLECTION.powi(order))));
        // Amplitude of a path of 1 m at this carrier.
        let gain = SNR_AT_1_M.sqrt() * (INTERFERER_HZ / carrier_hz);
        let mut samples = self.noise(cycle, action, &mut rng);
        let mut direct_s = 0.0;
        for (index, ([ax, ay], reflection)) in sources.enumerate() {
            let length_m = (x - ax).hypot(y - ay);
            let delay_s = length_m / SPEED_OF_LIGHT_M_S;
            let amplitude = gain * reflection / length_m;
            let phase = -std::f64::consts::TAU * (carrier_hz * delay_s).fract();
            add_pulse(&mut samples, &pulse, delay_s, [amplitude * phase.cos(), amplitude * phase.sin()]);
            if index == 0 {
                direct_s = delay_s;
            }
        }
        self.add_dense(&mut samples, &pulse, direct_s, gain, &mut rng);
        samples.iter().map(|[re, im]| [*re as f32, *im as f32]).collect()
    }

    /// White noise and what of the interferer passes the matched filter, coloured by it.
    fn noise(&self, cycle: usize, action: usize, rng: &mut Xoshiro128PlusPlus) -> Vec<[f64; 2]> {
        let [from, to] = self.interfered();
        let mut power = 1.0;
        if (from..to).contains(&cycle) {
            power += INTERFERER_OVER_NOISE * f64::from(self.library.overlap(action, FIRST_ACTION));
        }
        let scale = power.sqrt();
        let white: Vec<[f64; 2]> = (0..SAMPLES + self.filter.len()).map(|_| complex_normal(rng)).collect();
        let coloured = |n: usize| {
            let mut sum = [0.0, 0.0];
            for (tap, [re, im]) in self.filter.iter().zip(&white[n..]) {
                sum = [sum[0] + tap * re, sum[1] + tap * im];
            }
            sum.map(|part| part * scale)
        };
        (0..SAMPLES).map(coloured).collect()
    }

    /// Dense multipath: one small path every quarter pulse, powers by the soft-onset profile (rise 5 ns, decay 20 ns).
    fn add_dense(
        &self,
        samples: &mut [[f64; 2]],
        pulse: &Pulse,
        direct_s: f64,
        gain: f64,
        rng: &mut Xoshiro128PlusPlus,
    ) {
        let step_s = PULSE_DURATION_S / 4.0;
        let profile = |excess_s: f64| (1.0 - 0.98 * (-excess_s / 5e-9).exp()) * (-excess_s / 20e-9).exp();
        let count = (80e-9 / step_s) as usize;
        let integral: f64 = (0..count).map(|n| profile(n as f64 * step_s)).sum();
        for n in 0..count {
            let excess_s = n as f64 * step_s;
            let deviation = gain * (DENSE_SHARE * profile(excess_s) / integral).sqrt();
            let amplitude = complex_normal(rng).map(|part| part * deviation);
            add_pulse(samples, pulse, direct_s + excess_s, amplitude);
        }
    }
}

/// Adds a path to matched-filter samples.
fn add_pulse(samples: &mut [[f64; 2]], pulse: &Pulse, delay_s: f64, [re, im]: [f64; 2]) {
    let centre = delay_s / SAMPLE_SPACING_S;
    let reach = 5.0 * PULSE_DURATION_S / SAMPLE_SPACING_S;
    let from = (centre - reach).max(0.0) as usize;
    let to = ((centre + reach) as usize).min(samples.len());
    for (n, sample) in samples.iter_mut().enumerate().take(to).skip(from) {
        let lag = (n as f64 * SAMPLE_SPACING_S - delay_s) / PULSE_DURATION_S;
        let r = f64::from(pulse.autocorrelation(lag as f32));
        *sample = [sample[0] + r * re, sample[1] + r * im];
    }
}

/// The unit-energy root-raised-cosine pulse of unit duration at `t`, roll-off 0.6.
fn root_raised_cosine(t: f64) -> f64 {
    let (pi, b) = (std::f64::consts::PI, ROLL_OFF);
    if t.abs() < 1e-9 {
        return 1.0 + b * (4.0 / pi - 1.0);
    }
    let denominator = pi * t * (1.0 - (4.0 * b * t).powi(2));
    ((pi * t * (1.0 - b)).sin() + 4.0 * b * t * (pi * t * (1.0 + b)).cos()) / denominator
}

/// A complex normal number of unit variance.
fn complex_normal(rng: &mut impl Rng) -> [f64; 2] {
    let mut uniform = || (f64::from(rng.next_u32()) + 0.5) / 4_294_967_296.0;
    let radius = (-uniform().ln()).sqrt();
    let angle = std::f64::consts::TAU * uniform();
    [radius * angle.cos(), radius * angle.sin()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_seed_and_cycle_give_the_same_frame() {
        let room = Room::new(3, 100);
        assert_eq!(room.cycle(50, 7), room.cycle(50, 7));
        assert_ne!(room.cycle(50, 7), room.cycle(51, 7));
        assert_ne!(room.cycle(50, 7), Room::new(4, 100).cycle(50, 7));
    }

    #[test]
    fn an_image_in_the_west_wall_is_as_far_from_the_wall_as_its_anchor() {
        let images = Room::images_m(0);
        assert_eq!(images.len(), 12);
        let [x, y] = ANCHORS_M[0];
        let [w, d] = ROOM_M;
        for (expected, order) in
            [([-x, y], 1), ([2.0 * w - x, y], 1), ([-x, -y], 2), ([x, y + 2.0 * d], 2), ([x - 2.0 * w, y], 2)]
        {
            let near = |([u, v], o): &([f64; 2], i32)| {
                (u - expected[0]).hypot(v - expected[1]) < 1e-9 && *o == order
            };
            assert!(images.iter().any(near), "{expected:?}");
        }
    }

    #[test]
    fn the_tag_moves_one_centimetre_per_cycle() {
        let room = Room::new(1, 1000);
        for cycle in 0..1000 {
            let ([x, y], [u, v]) = (room.position_m(cycle), room.position_m(cycle + 1));
            assert!((x - u).hypot(y - v) < 0.0101);
        }
    }

    #[test]
    fn white_noise_has_unit_power_and_the_interferer_weakens_away_from_its_carrier() {
        let room = Room::new(9, 100);
        let power = |cycle: usize, action: usize| {
            let mut sum = 0.0;
            for draw in 0..40 {
                let noise = room.noise(cycle, action, &mut room.rng(draw, 0));
                sum +=
                    noise.iter().map(|[re, im]| re * re + im * im).sum::<f64>() / noise.len() as f64 / 40.0;
            }
            sum
        };
        assert!((power(0, FIRST_ACTION) - 1.0).abs() < 0.03);
        assert!((power(50, FIRST_ACTION) / 251.0 - 1.0).abs() < 0.03);
        assert!(power(50, 0) < 30.0);
    }
}
