//! Scan: what one anchor delivered in a cycle, as measurements.

use super::channel_estimator::NoiseLevel;
use crate::model::detection::false_alarm;
use crate::model::measurement::Measurement;
use crate::model::work::Work;
use crate::real::{SPEED_OF_LIGHT_M_S, abs};
use heapless::Vec;

/// Guard: against artefacts that a path this much stronger leaves beside itself, power ratio.
pub const ARTEFACT_RATIO: f32 = 4.0;

/// What a frame says besides its paths.
#[derive(Clone, Debug)]
pub struct FrameLevel {
    /// Noise and dense multipath over delay.
    pub level: NoiseLevel,
    /// The unit of its powers.
    pub unit: f32,
    /// Delay of the first sample, seconds.
    pub first_sample_delay_s: f32,
    /// Sample spacing, seconds.
    pub sample_spacing_s: f32,
    /// Time since the anchor's last frame, seconds.
    pub elapsed_s: f32,
    /// Threshold of the frame's pulse on the normalised energy of a path.
    pub threshold: f32,
    /// How far apart two paths must be to be told apart, metres.
    pub resolution_m: f32,
    /// What the filter adds to the variances of paths, because their errors are in part those of the last frame, square metres.
    pub alike_m2: f32,
}

/// What an anchor delivered, as measurements, and the action it was received with.
#[derive(Clone, Debug)]
pub struct Scan<const PATHS: usize> {
    /// Index of the anchor.
    pub anchor: usize,
    /// Index of the action.
    pub action: usize,
    /// Time since the anchor's last scan, seconds.
    pub elapsed_s: f32,
    /// Ranges, then paths.
    pub measurements: Vec<Measurement, PATHS>,
    /// `None` without a frame: only with one does a missing path say something about the carrier.
    pub frame: Option<FrameLevel>,
    /// Ranges and paths that there was no room for.
    pub left_out: u32,
    /// Whether the estimate of the frame was ended for its work.
    pub cut_short: bool,
    /// What it has cost.
    pub work: Work,
    /// How many of the measurements are ranges.
    ranges: usize,
}

impl<const PATHS: usize> Scan<PATHS> {
    /// Nothing delivered yet, `elapsed_s` seconds after the last scan.
    pub fn new(anchor: usize, action: usize, elapsed_s: f32) -> Self {
        let measurements = Vec::new();
        Self {
            anchor,
            action,
            elapsed_s,
            measurements,
            frame: None,
            left_out: 0,
            cut_short: false,
            work: Work::NONE,
            ranges: 0,
        }
    }

    /// Whether a frame was received.
    pub fn is_framed(&self) -> bool {
        self.frame.is_some()
    }

    /// Threshold of the frame's pulse on the normalised energy of a path; 0 without a frame.
    pub fn threshold(&self) -> f32 {
        self.frame.as_ref().map_or(0.0, |frame| frame.threshold)
    }

    /// Time since the anchor's last frame, seconds; 0 without a frame.
    pub fn since_frame_s(&self) -> f32 {
        self.frame.as_ref().map_or(0.0, |frame| frame.elapsed_s)
    }

    /// How far apart two paths must be to be told apart, metres; 0 without a frame.
    pub fn resolution_m(&self) -> f32 {
        self.frame.as_ref().map_or(0.0, |frame| frame.resolution_m)
    }

    /// What the filter adds to the variance of a measurement, square metres; 0 for a range.
    pub fn alike_m2(&self, measurement: &Measurement) -> f32 {
        match &self.frame {
            Some(frame) if measurement.sinr > 0.0 => frame.alike_m2,
            _ => 0.0,
        }
    }

    /// Level of noise and dense multipath where a path of this length arrives, in the unit of the frame; `None` without one.
    pub fn level(&self, range_m: f32) -> Option<f32> {
        let FrameLevel { level, unit, first_sample_delay_s, sample_spacing_s, .. } = self.frame.as_ref()?;
        let position = (range_m / SPEED_OF_LIGHT_M_S - first_sample_delay_s) / sample_spacing_s;
        Some(level.level(position, *sample_spacing_s) / unit)
    }

    /// Takes ranges in. They replace the paths of a frame within its resolution, whichever came first.
    pub fn take_ranges(&mut self, ranges: impl Iterator<Item = Measurement>) {
        let paths = core::mem::take(&mut self.measurements);
        for range in ranges {
            self.take_range(range);
        }
        self.ranges = self.measurements.len();
        for path in paths {
            self.take_path(path);
        }
    }

    /// Takes a range in; where all places are taken, in the place of the one that tells least, if that is worse: the
    /// larger variance, then the longer, then the later. The others keep their order.
    fn take_range(&mut self, measurement: Measurement) {
        let Err(measurement) = self.measurements.push(measurement) else { return };
        self.left_out += 1;
        let is_worse = |a: &Measurement, b: &Measurement| {
            a.variance_m2 > b.variance_m2 || (a.variance_m2 == b.variance_m2 && a.range_m > b.range_m)
        };
        let mut worst: Option<(usize, Measurement)> = None;
        for (index, kept) in self.measurements.iter().enumerate() {
            if worst.is_none_or(|(_, worst)| !is_worse(&worst, kept)) {
                worst = Some((index, *kept));
            }
        }
        let Some((index, worst)) = worst else { return };
        if is_worse(&worst, &measurement) {
            // The later ones move up from behind.
            let mut next = measurement;
            for place in self.measurements.iter_mut().skip(index).rev() {
                next = core::mem::replace(place, next);
            }
        }
    }

    /// Takes a path of the frame in, unless a range lies within its resolution. Where ranges took up room, the latest paths
    /// are left out.
    pub fn take_path(&mut self, path: Measurement) {
        let resolution_m = self.resolution_m();
        let ranges = self.measurements.iter().take(self.ranges);
        if !ranges.clone().any(|range| abs(range.range_m - path.range_m) < resolution_m) {
            self.left_out += u32::from(self.measurements.push(path).is_err());
        }
    }

    /// How probable a false alarm of each path's strength is. Beside a path much stronger than itself, a path may be what
    /// the pulse's model left of that, however strong it is: a false alarm like any other.
    #[inline(never)]
    pub fn grade_paths(&mut self) {
        let (threshold, resolution_m) = (self.threshold(), self.resolution_m());
        for index in self.ranges..self.measurements.len() {
            let Some(own) = self.measurements.get(index).copied() else { return };
            let is_beside = self.measurements.iter().any(|other| {
                abs(other.range_m - own.range_m) < resolution_m && other.sinr > ARTEFACT_RATIO * own.sinr
            });
            if let Some(measurement) = self.measurements.get_mut(index) {
                measurement.false_alarm = if is_beside { 1.0 } else { false_alarm(own.sinr, threshold) };
            }
        }
    }
}
