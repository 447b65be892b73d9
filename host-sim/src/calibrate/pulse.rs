//! The pulse as frames show it: its duration and roll-off, and how far behind the radio's own range it peaks.
//!
//! Of every frame the first path that stands out is compared, from its rising edge to a little behind its peak, with the
//! magnitude of root-raised-cosine pulses behind the matched filter, at the delay and amplitude that fit best. The half of the
//! frames that fit best counts: there, no other path is near. Deviations are those of a jackknife over groups of frames.

use crate::estimate::SPEED_OF_LIGHT_M_S;
use crate::recording::{Frame, Samples};
use cogmint_core::radio::pulse::{Pulse, PulseTable};
use serde::{Deserialize, Serialize};

/// Durations that are compared, in this fraction of an octave about the one told, and how many to either side.
const PER_OCTAVE: f64 = 8.0;
const EITHER_SIDE: i32 = 10;
/// Roll-offs that are compared.
const ROLL_OFFS: [f32; 5] = [0.0, 0.25, 0.5, 0.75, 1.0];
/// A frame's first path is the first local maximum of this share of the highest.
const STANDS_OUT: f32 = 0.5;
/// A frame counts where its peak is this many times the median magnitude.
const LEAST_PEAK: f32 = 10.0;
/// The stretch compared, in half widths of the rising edge: ahead of the peak, and behind it.
const STRETCH: [f64; 2] = [2.5, 0.7];
/// Samples that it needs at least.
const LEAST_SAMPLES: usize = 4;
/// Step of the delays compared, samples.
const DELAY_STEP: f64 = 0.05;
/// Frames that are needed to say anything.
const LEAST_FRAMES: usize = 20;
/// Largest deviations of a duration, as a share of it, and of a roll-off that count as known.
const KNOWN_DURATION: f64 = 0.05;
const KNOWN_ROLL_OFF: f64 = 0.1;
/// Groups of the jackknife.
const GROUPS: usize = 10;

/// A frame with what its own delay axis is to be held against.
#[derive(Clone, Copy, Debug)]
pub struct Shown<'a> {
    /// The frame.
    pub frame: &'a Frame,
    /// Duration of its pulse as told, seconds.
    pub told_duration_s: f64,
    /// The radio's own range of the same exchange, metres, where there is one.
    pub range_m: Option<f64>,
}

/// What frames show of the pulse.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PulseEstimate {
    /// Frames that it is from.
    pub frames: usize,
    /// Duration over that told.
    pub duration_factor: f64,
    /// Its standard deviation.
    pub duration_factor_std: f64,
    /// Roll-off.
    pub roll_off: f64,
    /// Its standard deviation.
    pub roll_off_std: f64,
    /// Energy of the compared stretch that the pulse leaves unexplained, as a share.
    pub unexplained_share: f64,
    /// How far behind the radio's own range the pulse peaks, metres; without ranges it is part of the bias.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub peak_offset_m: Option<f64>,
    /// Its standard deviation, metres.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub peak_offset_std_m: Option<f64>,
}

impl PulseEstimate {
    /// Whether duration and roll-off are known well enough to be told: one that is off makes up for the other on a rising edge, and
    /// not in what the channel estimator does with it.
    pub fn is_shape_known(&self) -> bool {
        self.duration_factor_std <= KNOWN_DURATION * self.duration_factor
            && self.roll_off_std <= KNOWN_ROLL_OFF
    }
}

/// The stretch of a frame about its first path.
struct Edge {
    samples: Vec<f32>,
    /// Index of the first of them in the frame.
    from: usize,
    /// Index of the peak.
    peak: usize,
    energy: f64,
}

impl Edge {
    fn of(frame: &Frame) -> Option<Self> {
        let magnitudes: Vec<f32> = match &frame.samples {
            Samples::Complex(samples) => samples.iter().map(|[re, im]| re.hypot(*im)).collect(),
            Samples::Magnitude(samples) => samples.clone(),
        };
        let highest = magnitudes.iter().copied().fold(0.0, f32::max);
        let mut sorted = magnitudes.clone();
        sorted.sort_by(f32::total_cmp);
        if highest <= LEAST_PEAK * sorted.get(sorted.len() / 2)? {
            return None;
        }
        let is_peak =
            |three: &[f32]| three[1] >= STANDS_OUT * highest && three[1] >= three[0] && three[1] > three[2];
        let peak = 1 + magnitudes.windows(3).position(is_peak)?;
        // Half of the peak on the rising edge, between samples.
        let half = 0.5 * magnitudes[peak];
        let below = (0..peak).rev().find(|&n| magnitudes[n] < half)?;
        let part = (half - magnitudes[below]) / (magnitudes[below + 1] - magnitudes[below]);
        let width = (peak - below) as f64 - f64::from(part);
        let from = (peak as f64 - STRETCH[0] * width).ceil().max(0.0) as usize;
        let to = peak + (STRETCH[1] * width).floor() as usize;
        let samples = magnitudes.get(from..=to)?.to_vec();
        let energy = samples.iter().map(|&x| f64::from(x) * f64::from(x)).sum();
        (samples.len() >= LEAST_SAMPLES).then_some(Self { samples, from, peak, energy })
    }

    /// Share of the energy that a pulse leaves at its best delay and amplitude, and that delay in samples of the frame.
    fn fit(&self, table: &PulseTable) -> (f64, f64) {
        let about = (self.peak - self.from) as f64;
        let steps = (1.0 / DELAY_STEP) as i32;
        let left = |delay: f64| {
            let (mut product, mut power) = (0.0, 1e-12);
            for (n, &x) in self.samples.iter().enumerate() {
                let pulse = f64::from(table.at((n as f64 - delay) as f32).abs());
                product += pulse * f64::from(x);
                power += pulse * pulse;
            }
            1.0 - product * product / (power * self.energy)
        };
        let delays = (-steps..=steps).map(|n| about + DELAY_STEP * f64::from(n));
        let best = delays.map(|delay| (left(delay), delay)).min_by(|a, b| a.0.total_cmp(&b.0));
        best.map_or((1.0, about), |(left, delay)| (left, self.from as f64 + delay))
    }
}

/// A pulse to compare with: its duration over that told, and its roll-off.
type Candidate = (f64, f32);

/// What the frames show; none where they show too little, or nothing else than a sum of paths.
pub fn estimate(shown: &[Shown<'_>], spacing_s: f64) -> Option<PulseEstimate> {
    let edges: Vec<(&Shown<'_>, Edge)> =
        shown.iter().filter_map(|shown| Some((shown, Edge::of(shown.frame)?))).collect();
    if edges.len() < LEAST_FRAMES {
        return None;
    }
    let durations = (-EITHER_SIDE..=EITHER_SIDE).map(|n| (f64::from(n) / PER_OCTAVE).exp2());
    let candidates: Vec<Candidate> =
        durations.flat_map(|factor| ROLL_OFFS.map(|roll_off| (factor, roll_off))).collect();
    // By candidate, then by frame: what is left.
    let left: Vec<Vec<f64>> = candidates
        .iter()
        .map(|&candidate| fits(&edges, candidate, spacing_s).into_iter().map(|(left, _)| left).collect())
        .collect();
    let least_of = |edge: usize| left.iter().map(|of| of[edge]).fold(f64::INFINITY, f64::min);
    let mut order: Vec<usize> = (0..edges.len()).collect();
    order.sort_by(|a, b| least_of(*a).total_cmp(&least_of(*b)));
    let kept = &order[..edges.len() / 2];
    let best_without = |group: Option<usize>| {
        let counts = |place: &usize| group.is_none_or(|group| place % GROUPS != group);
        let cost = |of: &Vec<f64>| -> f64 {
            kept.iter().enumerate().filter(|(place, _)| counts(place)).map(|(_, edge)| of[*edge]).sum()
        };
        let costs: Vec<f64> = left.iter().map(cost).collect();
        let best = (0..costs.len()).min_by(|a, b| costs[*a].total_cmp(&costs[*b])).unwrap_or(0);
        let (factor, roll_off) = candidates[best];
        // A parabola through the neighbours of the same roll-off: finer than the grid.
        let beside = |by: isize| best.checked_add_signed(by).and_then(|n| costs.get(n)).copied();
        let width = ROLL_OFFS.len() as isize;
        let finer = |by: isize, most: f64| match (beside(-by), beside(by)) {
            (Some(before), Some(after)) if before + after > 2.0 * costs[best] => {
                (0.5 * (before - after) / (before + after - 2.0 * costs[best])).clamp(-most, most)
            }
            _ => 0.0,
        };
        let is_inside = best % ROLL_OFFS.len() > 0 && best % ROLL_OFFS.len() + 1 < ROLL_OFFS.len();
        let roll_off = f64::from(roll_off) + if is_inside { 0.25 * finer(1, 0.5) } else { 0.0 };
        (factor * (finer(width, 0.5) / PER_OCTAVE).exp2(), roll_off, costs[best])
    };
    let (duration_factor, roll_off, cost) = best_without(None);
    let groups: Vec<_> = (0..GROUPS).map(|group| best_without(Some(group))).collect();
    let jackknife = |of: &dyn Fn(&(f64, f64, f64)) -> f64| {
        let mean = groups.iter().map(of).sum::<f64>() / GROUPS as f64;
        let squares: f64 = groups.iter().map(|group| (of(group) - mean).powi(2)).sum();
        (squares * (GROUPS as f64 - 1.0) / GROUPS as f64).sqrt()
    };
    let places = fits(&edges, (duration_factor, roll_off as f32), spacing_s);
    let mut offsets_m: Vec<f64> = kept
        .iter()
        .filter_map(|&edge| {
            let shown = edges[edge].0;
            let delay_s = shown.frame.first_sample_delay_s + places[edge].1 * spacing_s;
            Some(delay_s * SPEED_OF_LIGHT_M_S - shown.range_m?)
        })
        .collect();
    let peak = (offsets_m.len() >= LEAST_FRAMES).then(|| median_and_std(&mut offsets_m));
    Some(PulseEstimate {
        frames: kept.len(),
        duration_factor,
        // No finer than a tenth of the grid's step: a jackknife of equal answers claims too much.
        duration_factor_std: jackknife(&|group| group.0).max(0.1 * duration_factor / PER_OCTAVE),
        roll_off,
        roll_off_std: jackknife(&|group| group.1).max(0.05),
        unexplained_share: cost / kept.len() as f64,
        peak_offset_m: peak.map(|(median_m, _)| median_m),
        peak_offset_std_m: peak.map(|(_, std_m)| std_m),
    })
}

/// How every frame fits a pulse, and where.
fn fits(edges: &[(&Shown<'_>, Edge)], (factor, roll_off): Candidate, spacing_s: f64) -> Vec<(f64, f64)> {
    let mut tables: Vec<(f64, PulseTable)> = Vec::new();
    edges
        .iter()
        .map(|(shown, edge)| {
            let told_s = shown.told_duration_s;
            let known = tables.iter().position(|(of_s, _)| *of_s == told_s);
            let place = known.unwrap_or_else(|| {
                let pulse = Pulse::root_raised_cosine((told_s * factor) as f32, roll_off);
                let table = PulseTable::new(&pulse.sampled_every(spacing_s as f32), spacing_s as f32);
                tables.push((told_s, table));
                tables.len() - 1
            });
            edge.fit(&tables[place].1)
        })
        .collect()
}

/// Median, and the standard deviation that the spread about it gives it.
fn median_and_std(values: &mut [f64]) -> (f64, f64) {
    let middle = |values: &mut [f64]| {
        values.sort_by(f64::total_cmp);
        values[values.len() / 2]
    };
    let median = middle(values);
    let mut apart: Vec<f64> = values.iter().map(|value| (value - median).abs()).collect();
    let spread = 1.4826 * middle(&mut apart);
    (median, (std::f64::consts::PI / 2.0).sqrt() * spread / (values.len() as f64).sqrt())
}
