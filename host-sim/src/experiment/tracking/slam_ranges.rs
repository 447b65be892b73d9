//! The reference scenario of belief-propagation multipath SLAM, made afresh with seeds of our own: two anchors known,
//! nine virtual anchors unknown, ranges of 0.1 m deviation, detection 0.95, one false alarm per anchor and step. And
//! what makes it harder: more clutter, less detection, lost scans, gaps, a start that nobody knows.
//!
//! The geometry is that of the publication (Leitinger et al. 2019); the ranges are drawn here.

use crate::recording::{
    Action, Anchor, AssociationModel, Cycle, Motion, Radio, Range, Recording, Start, VirtualAnchor,
};
use rand_core::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro128PlusPlus;

/// The known anchors, metres.
pub const ANCHORS: [[f64; 2]; 2] = [[0.5, 7.0], [5.2, 2.3]];
/// The unknown virtual anchors: index of the anchor and position in metres.
pub const IMAGES: [(usize, [f64; 2]); 9] = [
    (0, [8.14, 7.0]),
    (0, [0.5, -6.996]),
    (0, [11.05, 7.0]),
    (0, [0.5, 10.094]),
    (0, [-1.116, 7.0]),
    (1, [5.2, -2.3]),
    (1, [5.2, 14.794]),
    (1, [-5.81, 2.3]),
    (1, [13.84, 2.3]),
];
/// Corners of the way, with the step at which each is reached: 1 cm per step.
const WAY: [(usize, [f64; 2]); 8] = [
    (0, [3.02, 7.82]),
    (80, [2.22, 7.82]),
    (310, [2.22, 5.52]),
    (430, [1.02, 5.52]),
    (560, [1.02, 4.22]),
    (610, [0.52, 4.22]),
    (714, [0.52, 3.18]),
    (1000, [2.964, 1.710]),
];
/// The way's last step.
const WAY_STEPS: usize = 1000;
/// Steps of a recording, one per second.
pub const STEPS: usize = 900;
/// Deviation of a range, metres.
const RANGE_STD_M: f64 = 0.1;
const LONGEST_RANGE_M: f64 = 30.0;
/// Middle of the room, metres, and a deviation per axis that reaches its corners at two of them.
const ROOM_MIDDLE_M: [f64; 2] = [2.73, 4.27];
const ROOM_STD_M: f64 = 2.5;

/// How the ranges come about. The recording tells the tracker the true detection probability and clutter, as a user
/// who knows the radio would.
#[derive(Clone, Debug, PartialEq)]
pub struct SlamRanges {
    /// Probability that the range of an anchor or virtual anchor is there.
    pub detection_probability: f64,
    /// Mean number of false ranges per anchor and step.
    pub clutter_per_anchor: f64,
    /// Probability that all ranges of an anchor are lost in a step.
    pub loss_probability: f64,
    /// Steps without any range; the tag moves on.
    pub gap: std::ops::Range<usize>,
    /// The tag starts anywhere on the way, which it goes there and back, and the tracker knows no more than the room.
    pub start_unknown: bool,
}

impl Default for SlamRanges {
    fn default() -> Self {
        Self {
            detection_probability: 0.95,
            clutter_per_anchor: 1.0,
            loss_probability: 0.0,
            gap: 0..0,
            start_unknown: false,
        }
    }
}

/// The place on the way, which goes there and back.
fn position(step: usize) -> [f64; 2] {
    let back = step % (2 * WAY_STEPS);
    let step = back.min(2 * WAY_STEPS - back);
    let [(from, start), (to, end)] =
        WAY.windows(2).find(|ends| step <= ends[1].0).map_or([WAY[0]; 2], |ends| [ends[0], ends[1]]);
    let share = (step - from) as f64 / (to - from).max(1) as f64;
    [0, 1].map(|axis| start[axis] + share * (end[axis] - start[axis]))
}

impl SlamRanges {
    /// A recording of [`STEPS`] steps with a seed.
    pub fn record(&self, seed: u64) -> Recording {
        let mut rng = Xoshiro128PlusPlus::seed_from_u64(seed);
        let mut uniform = move || (f64::from(rng.next_u32()) + 0.5) / 4_294_967_296.0;
        // Losses and the start have a stream of their own: what is heard stays the same with and without them.
        let mut apart = Xoshiro128PlusPlus::seed_from_u64(!seed);
        let mut share = move || (f64::from(apart.next_u32()) + 0.5) / 4_294_967_296.0;
        let first = if self.start_unknown { (share() * 2.0 * WAY_STEPS as f64) as usize } else { 0 };
        let mut cycle = |step: usize| {
            let [x, y] = position(first + step);
            let mut ranges = Vec::new();
            for (anchor, place) in ANCHORS.iter().enumerate() {
                let before = ranges.len();
                let mut heard =
                    |range_m: f64| ranges.push(Range { anchor, range_m, std_m: None, angles: None });
                let images = IMAGES.iter().filter(|(of, _)| *of == anchor).map(|(_, image)| image);
                for [ax, ay] in std::iter::once(place).chain(images) {
                    if uniform() < self.detection_probability {
                        let normal =
                            (-2.0 * uniform().ln()).sqrt() * (std::f64::consts::TAU * uniform()).cos();
                        heard((x - ax).hypot(y - ay) + RANGE_STD_M * normal);
                    }
                }
                // Poisson, by the product of uniforms.
                let mut product = uniform();
                while product > (-self.clutter_per_anchor).exp() {
                    heard(LONGEST_RANGE_M * uniform());
                    product *= uniform();
                }
                let lost = self.loss_probability > 0.0 && share() < self.loss_probability;
                if lost || self.gap.contains(&step) {
                    ranges.truncate(before);
                }
            }
            Cycle { time_s: step as f64, truth_position_m: Some([x, y]), ranges, ..Cycle::default() }
        };
        let known = Start {
            position_m: position(0),
            position_std_m: 0.25,
            velocity_std_m_s: 0.03,
            disc_radius_m: Some(0.5),
            drawn_about_m: None,
        };
        // The mean is the room's middle whatever the seed: a disc of no size to speak of.
        let unknown = Start {
            position_m: ROOM_MIDDLE_M,
            position_std_m: ROOM_STD_M,
            disc_radius_m: Some(1e-3),
            drawn_about_m: None,
            ..known
        };
        Recording {
            name: format!("SLAM ranges, seed {seed}"),
            source: format!("simulated ranges of the SLAM reference scenario, seed {seed}"),
            motion: Motion::published(0.01),
            start: if self.start_unknown { unknown } else { known },
            association: AssociationModel {
                detection_probability: self.detection_probability,
                clutter_per_anchor: self.clutter_per_anchor,
                max_range_m: LONGEST_RANGE_M,
            },
            radio: Radio {
                pulse_duration_s: 0.5e-9,
                roll_off: 0.6,
                sampled_pulse: None,
                gain_control: false,
                begins_with_path: false,
                sample_spacing_s: None,
                range_std_m: RANGE_STD_M,
                range_bias_mean_m: 0.0,
                range_bias_std_m: 0.0,
                range_late_m: 0.0,
                range_floor_pulses: None,
            },
            anchors: ANCHORS
                .iter()
                .enumerate()
                .map(|(index, place)| Anchor::new(format!("A{index}"), *place, 0.0))
                .collect(),
            virtual_anchors: IMAGES
                .iter()
                .map(|(anchor, image)| VirtualAnchor::new(*anchor, *image, 0.0, false))
                .collect(),
            walls: Vec::new(),
            plan: None,
            antennas: Vec::new(),
            actions: vec![Action { carrier_hz: 7e9, pulse_duration_s: 0.5e-9 }],
            cycles: (0..STEPS).map(&mut cycle).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ranges per anchor and step, and the same of those within four deviations of a true one.
    fn rates(ranges: &SlamRanges) -> (f64, f64) {
        let (mut all, mut near) = (0, 0);
        for seed in 1..=10 {
            for cycle in &ranges.record(seed).cycles {
                let [x, y] = cycle.truth_position_m.expect("is known");
                for range in &cycle.ranges {
                    let own = IMAGES.iter().filter(|(of, _)| *of == range.anchor).map(|(_, place)| place);
                    let mut places = own.chain([&ANCHORS[range.anchor]]);
                    let fits = |[u, v]: &[f64; 2]| ((x - u).hypot(y - v) - range.range_m).abs() < 0.4;
                    near += usize::from(places.any(fits));
                    all += 1;
                }
            }
        }
        let scans = (10 * STEPS * ANCHORS.len()) as f64;
        (f64::from(all) / scans, near as f64 / scans)
    }

    #[test]
    fn as_many_ranges_are_there_as_detection_clutter_and_loss_say() {
        let usual = SlamRanges::default();
        // 11 sources on 2 anchors. 18,000 scans: a deviation of the mean is at most 0.02.
        let expected = |ranges: &SlamRanges| {
            (5.5 * ranges.detection_probability + ranges.clutter_per_anchor) * (1.0 - ranges.loss_probability)
        };
        for ranges in [
            usual.clone(),
            SlamRanges { clutter_per_anchor: 5.0, ..usual.clone() },
            SlamRanges { detection_probability: 0.6, ..usual.clone() },
            SlamRanges { loss_probability: 0.1, ..usual.clone() },
        ] {
            let (all, near) = rates(&ranges);
            assert!((all - expected(&ranges)).abs() < 0.08, "{ranges:?}: {all}");
            let true_ones = 5.5 * ranges.detection_probability * (1.0 - ranges.loss_probability);
            // Of the false ones, some lie near a true one by chance: 0.8 m around each of 5.5 in 30 m.
            let by_chance = ranges.clutter_per_anchor * 5.5 * 0.8 / 30.0;
            assert!(near > true_ones - 0.05 && near < true_ones + by_chance + 0.05, "{ranges:?}: {near}");
        }
    }

    #[test]
    fn a_gap_has_no_range_and_changes_nothing_else() {
        let usual = SlamRanges::default().record(3);
        let gap = SlamRanges { gap: 450..510, ..SlamRanges::default() }.record(3);
        for (step, (with, without)) in gap.cycles.iter().zip(&usual.cycles).enumerate() {
            assert_eq!(with.truth_position_m, without.truth_position_m);
            let expected = if (450..510).contains(&step) { &Vec::new() } else { &without.ranges };
            assert_eq!(&with.ranges, expected, "step {step}");
        }
    }

    #[test]
    fn an_unknown_start_is_anywhere_on_the_way_and_the_way_is_one_centimetre_per_step() {
        let unknown = SlamRanges { start_unknown: true, ..SlamRanges::default() };
        let mut firsts = Vec::new();
        for seed in 1..=20 {
            let recording = unknown.record(seed);
            let way: Vec<[f64; 2]> =
                recording.cycles.iter().filter_map(|cycle| cycle.truth_position_m).collect();
            for ends in way.windows(2) {
                let step_m = (ends[1][0] - ends[0][0]).hypot(ends[1][1] - ends[0][1]);
                assert!((step_m - 0.01).abs() < 2e-4, "{step_m}");
            }
            assert_eq!(recording.start.position_m, ROOM_MIDDLE_M);
            firsts.push(way[0]);
        }
        let low = firsts.iter().map(|place| place[1]).fold(f64::INFINITY, f64::min);
        let high = firsts.iter().map(|place| place[1]).fold(f64::NEG_INFINITY, f64::max);
        assert!(low < 4.0 && high > 6.0, "{firsts:?}");
    }
}
