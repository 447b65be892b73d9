//! What is received becomes one scan of measurements per anchor: bad input is refused, frames become paths.

use super::Tracker;
use crate::config::Config;
use crate::error::Error;
use crate::observation::{Frame, FrameRules, Observation, RangeScan, check_frame, check_scan};
use crate::observer::Observer;
use crate::perceptor::association::{Measurement, false_alarm};
use crate::perceptor::channel_estimator::{ChannelEstimator, NoiseLevel};
use crate::pulse::Pulse;
use crate::real::{SPEED_OF_LIGHT_M_S, abs};
use heapless::Vec;

/// A path this much stronger may leave artefacts beside it, power ratio.
const ARTEFACT_RATIO: f32 = 4.0;

/// Noise and dense multipath of a frame, over delay, and the unit of its powers.
struct FrameNoise {
    level: NoiseLevel,
    unit: f32,
    first_sample_delay_s: f32,
    sample_spacing_s: f32,
}

/// What an anchor delivered, as measurements, and the action its frame was received with.
pub(super) struct Scan<const PATHS: usize> {
    pub(super) anchor: usize,
    pub(super) action: usize,
    pub(super) measurements: Vec<Measurement, PATHS>,
    /// Whether a frame was received: only then does a missing path say something about the carrier.
    pub(super) framed: bool,
    /// Threshold of the frame's pulse on the normalised energy of a path; 0 without a frame.
    pub(super) threshold: f32,
    /// None without a frame.
    noise: Option<FrameNoise>,
    /// Ranges and paths that there was no room for.
    pub(super) left_out: u32,
}

impl<const PATHS: usize> Scan<PATHS> {
    /// Level of noise and dense multipath where a path of this length arrives, in the unit of the frame; `None` without one.
    pub(super) fn level(&self, range_m: f32) -> Option<f32> {
        let FrameNoise { level, unit, first_sample_delay_s, sample_spacing_s } = self.noise.as_ref()?;
        let position = (range_m / SPEED_OF_LIGHT_M_S - first_sample_delay_s) / sample_spacing_s;
        Some(level.level(position, *sample_spacing_s) / unit)
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

    /// Beside a path much stronger than itself, a path may be what the pulse's model left of that, however strong it is:
    /// a false alarm like any other. Those before `first` are ranges.
    #[inline(never)]
    fn allow_artefacts(&mut self, first: usize, resolution_m: f32) {
        for index in first..self.measurements.len() {
            let Some(own) = self.measurements.get(index).copied() else { return };
            let beside = self.measurements.iter().any(|other| {
                abs(other.range_m - own.range_m) < resolution_m && other.sinr > ARTEFACT_RATIO * own.sinr
            });
            if let Some(measurement) = self.measurements.get_mut(index)
                && beside
            {
                measurement.false_alarm = 1.0;
            }
        }
    }
}

impl<const ANCHORS: usize, const VAS: usize, const PATHS: usize, const ACTIONS: usize>
    Tracker<ANCHORS, VAS, PATHS, ACTIONS>
{
    /// Refuses bad input before anything is touched.
    pub(super) fn check(
        &self,
        observations: &[Observation<'_>],
        elapsed_s: f32,
        tag_height_m: Option<f32>,
    ) -> Result<(), Error> {
        if !(elapsed_s > 0.0 && elapsed_s <= 3600.0) {
            return Err(Error::Time { elapsed_s });
        }
        if let Some(height) = tag_height_m
            && !(abs(height) <= 1000.0)
        {
            return Err(Error::TagHeight);
        }
        let rules = FrameRules {
            samples: self.config.radio.samples_per_frame,
            full_scale: self.config.radio.full_scale,
            max_range_m: self.config.ranging.max_range_m,
        };
        let mut framed = [false; ANCHORS];
        let mut ranged = [false; ANCHORS];
        for observation in observations {
            let anchor = observation.anchor();
            if anchor >= self.anchors.len() {
                return Err(Error::UnknownAnchor { anchor });
            }
            let seen = match observation {
                Observation::Frame(_) => framed.get_mut(anchor),
                Observation::Ranges(_) => ranged.get_mut(anchor),
            };
            let Some(seen) = seen else { return Err(Error::UnknownAnchor { anchor }) };
            if core::mem::replace(seen, true) {
                return Err(Error::DuplicateFrame { anchor });
            }
            match observation {
                Observation::Frame(frame) => {
                    if self.library.get(frame.action).is_none() {
                        return Err(Error::UnknownAction { action: frame.action });
                    }
                    if let (Some(sequence), Some(Some(last))) =
                        (frame.sequence, self.last_sequence.get(anchor))
                        && sequence == *last
                    {
                        return Err(Error::DuplicateFrame { anchor });
                    }
                    check_frame(frame, &rules)?;
                }
                Observation::Ranges(scan) => check_scan(scan, rules.max_range_m)?,
            }
        }
        Ok(())
    }

    /// Frames become paths, and paths and ranges become one scan of measurements per anchor heard.
    pub(super) fn estimate(
        &mut self,
        observations: &[Observation<'_>],
        observer: &mut impl Observer<VAS, PATHS>,
    ) -> Vec<Scan<PATHS>, ANCHORS> {
        let mut scans: Vec<Scan<PATHS>, ANCHORS> = Vec::new();
        for anchor in 0..self.anchors.len() {
            let mut scan = Scan {
                anchor,
                action: self.next_action(anchor),
                measurements: Vec::new(),
                framed: false,
                threshold: 0.0,
                noise: None,
                left_out: 0,
            };
            let mut heard = false;
            // Ranges first: they outrank the paths near them.
            for observation in observations {
                match observation {
                    Observation::Ranges(ranges) if ranges.anchor == anchor => {
                        self.take_ranges(ranges, &mut scan);
                        heard = true;
                    }
                    _ => {}
                }
            }
            for observation in observations {
                match observation {
                    Observation::Frame(frame) if frame.anchor == anchor => {
                        self.take_frame(frame, &mut scan, observer);
                        heard = true;
                    }
                    _ => {}
                }
            }
            if heard {
                // One per anchor: the push succeeds.
                let _ = scans.push(scan);
            }
        }
        scans
    }

    fn take_ranges(&self, scan: &RangeScan<'_>, into: &mut Scan<PATHS>) {
        for range in scan.ranges {
            let variance_m2 = self.measurement_variance(range.variance_m2);
            into.take_range(Measurement {
                range_m: range.range_m,
                variance_m2,
                sinr: 0.0,
                energy: 0.0,
                false_alarm: 1.0,
            });
        }
    }

    // Stages are kept apart so that each reuses the stack of the one before.
    #[inline(never)]
    fn take_frame(
        &mut self,
        frame: &Frame<'_>,
        into: &mut Scan<PATHS>,
        observer: &mut impl Observer<VAS, PATHS>,
    ) {
        let Some(action) = self.library.get(frame.action) else { return };
        let pulse = self.config.radio.pulse(action);
        if pulse != self.estimator_pulse {
            self.estimator = build_estimator(&self.config, pulse);
            self.estimator_pulse = pulse;
        }
        let estimate = self.estimator.estimate_checked(frame.samples, frame.first_sample_delay_s);
        observer.estimate(frame.anchor, &estimate);
        let unit = self.unit(frame, estimate.noise.white);
        into.action = frame.action;
        into.framed = true;
        into.threshold = self.estimator.threshold();
        into.noise = Some(FrameNoise {
            level: estimate.noise,
            unit,
            first_sample_delay_s: frame.first_sample_delay_s,
            sample_spacing_s: self.config.radio.sample_spacing_s,
        });
        let ranges = into.measurements.len();
        let resolution_m = pulse.duration_s * SPEED_OF_LIGHT_M_S;
        for path in &estimate.paths {
            let range_m = path.range_m();
            let near_range =
                into.measurements.iter().take(ranges).any(|m| abs(m.range_m - range_m) < resolution_m);
            if near_range || range_m <= 0.0 || range_m > self.config.ranging.max_range_m {
                continue;
            }
            let variance_m2 = self.measurement_variance(pulse.range_variance_m2(path.sinr));
            let [re, im] = path.amplitude;
            let measurement = Measurement {
                range_m,
                variance_m2,
                sinr: path.sinr,
                energy: (re * re + im * im) / unit,
                false_alarm: false_alarm(path.sinr, into.threshold),
            };
            // Where ranges took up room, the latest paths are left out.
            into.left_out += u32::from(into.measurements.push(measurement).is_err());
        }
        into.allow_artefacts(ranges, resolution_m);
    }

    /// What the powers of a frame with this level of white noise are measured in.
    fn unit(&mut self, frame: &Frame<'_>, white: f32) -> f32 {
        let Some(controller) = self.controller_of(frame.anchor) else { return 1.0 };
        let (held, turn) = (controller.held(), controller.sought_with());
        let is_lost = self.acquisition.is_some();
        let Some(gain_control) = self.gain_control.get_mut(frame.anchor) else { return 1.0 };
        if !self.config.radio.gain_control {
            return 1.0;
        }
        // Where choices are announced, the last frame of a turn comes after it.
        let own = Some(frame.action);
        let is_sought = is_lost && frame.action != held && (turn == own || gain_control.sought_with() == own);
        let loss_ln = self.channel.loss_ln(frame.action);
        gain_control.unit(frame.samples, white, frame.action, loss_ln, is_sought)
    }

    /// The variance the filter works with: inflated, and never below the floor.
    fn measurement_variance(&self, variance_m2: f32) -> f32 {
        let ranging = &self.config.ranging;
        ranging.variance_inflation * variance_m2 + ranging.floor_m * ranging.floor_m
    }
}

pub(super) fn build_estimator<const PATHS: usize>(config: &Config, pulse: Pulse) -> ChannelEstimator<PATHS> {
    let radio = &config.radio;
    ChannelEstimator::new(pulse, radio.sample_spacing_s, radio.samples_per_frame, radio.false_paths_per_frame)
}
