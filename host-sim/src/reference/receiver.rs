//! Receiver: frames become paths; paths and ranges become one scan per anchor.

use super::association::{Measurement, false_alarm};
use super::channel_estimator::{ChannelEstimate, ChannelEstimator, Cost, NoiseLevel, Residual};
use super::controller::Library;
use super::gain_control::GainControl;
use super::pulse::Pulse;
use super::real::{Real, abs, exp_m1, larger, smaller, speed_of_light, square};
use cogmint_core::Config;
use cogmint_core::config::{Radio, Ranging};
use cogmint_core::model::measurement::LEAST_APART;
use cogmint_core::model::observation::{Frame, Observation, RangeScan, Samples};
use cogmint_core::perceptor::channel_estimator::EstimatorSettings;
use cogmint_core::perceptor::scan::ARTEFACT_RATIO;

/// Longest silence that is told from a longer one, seconds: a day.
const LONGEST_S: f32 = 86_400.0;

/// The paths of a frame, with its anchor.
pub type AnchorEstimate<T> = (usize, ChannelEstimate<T>);

/// What one anchor delivered.
#[derive(Clone, Debug)]
pub struct Scan<T> {
    /// The anchor.
    pub anchor: usize,
    /// The action its frame was received with.
    pub action: usize,
    /// Seconds since the anchor's last scan.
    pub elapsed_s: T,
    /// Ranges, then paths.
    pub measurements: Vec<Measurement<T>>,
    /// The frame, in which a missing path means something; none where there are only ranges.
    pub frame: Option<Level<T>>,
    /// Ranges and paths that there was no room for.
    pub left_out: u32,
    /// What the estimate of the frame has cost.
    pub cost: Cost,
}

/// What the paths of a frame stand out of.
#[derive(Clone, Debug)]
pub struct Level<T> {
    noise: NoiseLevel<T>,
    first_sample_delay_s: T,
    sample_spacing_s: T,
    /// The power that counts as 1.
    unit: T,
    /// Seconds since the anchor's last frame.
    pub elapsed_s: T,
    /// Threshold on the normalised energy of a path.
    pub threshold: T,
    /// Length of a pulse, metres.
    pub resolution_m: T,
    /// What paths have on top of their variances because the last frame's were off alike, square metres.
    pub alike_m2: T,
    /// What is left of the frame, where that is kept.
    pub residual: Option<Residual<T>>,
    /// What the frame counts of one that comes long after the last.
    pub share: T,
}

impl<T: Real> Scan<T> {
    /// Noise where a path of this length arrives, in the frame's unit; none without a frame.
    pub fn level(&self, range_m: T) -> Option<T> {
        let frame = self.frame.as_ref()?;
        let after_s = range_m / speed_of_light() - frame.first_sample_delay_s;
        Some(frame.noise.at(after_s / frame.sample_spacing_s, frame.sample_spacing_s) / frame.unit)
    }

    /// Distance within which two paths cannot be told apart, metres: 0 among ranges.
    pub fn resolution_m(&self) -> T {
        self.frame.as_ref().map_or(T::ZERO, |frame| frame.resolution_m)
    }
}

/// What is agreed on with an anchor, and how it goes.
#[derive(Clone, Copy, Debug)]
pub struct Link {
    /// The action expected next.
    pub expected: usize,
    /// The action held.
    pub held: usize,
    /// The action that a lost tag is sought with.
    pub sought_with: Option<usize>,
    /// Whether it is not known where the tag is.
    pub is_lost: bool,
}

/// The receivers of all anchors.
#[derive(Clone, Debug)]
pub struct Receiver<T> {
    radio: Radio,
    settings: EstimatorSettings,
    most_work: u32,
    ranging: Ranging,
    /// Most measurements of a scan, and most points of what is left of a frame.
    room: usize,
    points: usize,
    /// The estimator of each pulse met so far.
    estimators: Vec<(Pulse<T>, ChannelEstimator<T>)>,
    /// Threshold of the pulse last used.
    pub threshold: T,
    /// What frames are measured in, by anchor.
    pub gain_control: Vec<GainControl<T>>,
    /// Last frame counter seen, by anchor.
    pub last_sequence: Vec<Option<u32>>,
    /// Seconds since the last scan and the last frame, by anchor.
    pub silent_s: Vec<[T; 2]>,
}

impl<T: Real> Receiver<T> {
    /// Receivers of so many anchors, set to `first`, with room for so many measurements per scan.
    pub fn new(config: &Config, [anchors, room, points]: [usize; 3], first: &Pulse<T>) -> Self {
        let mut receiver = Self {
            radio: config.radio,
            settings: config.estimator,
            most_work: config.work.frame(),
            ranging: config.ranging,
            room,
            points: if config.belief.reads_below_threshold { points } else { 0 },
            estimators: Vec::new(),
            threshold: T::ZERO,
            gain_control: vec![GainControl::default(); anchors],
            last_sequence: vec![None; anchors],
            silent_s: vec![[T::ZERO; 2]; anchors],
        };
        receiver.threshold = receiver.estimator(first).threshold(&Samples::Complex(&[]));
        receiver
    }

    /// The paths of every frame, and one scan per anchor heard, of `dt` seconds. `losses_ln`: ln of the power that each action
    /// loses over the first.
    pub fn receive(
        &mut self,
        observations: &[Observation<'_>],
        dt: T,
        links: &[Link],
        losses_ln: &[T],
        library: &Library<T>,
    ) -> (Vec<AnchorEstimate<T>>, Vec<Scan<T>>) {
        for silent_s in self.silent_s.iter_mut().flatten() {
            *silent_s = smaller(*silent_s + dt, T::of(LONGEST_S));
        }
        let mut estimates = Vec::new();
        let mut scans = Vec::new();
        for (anchor, link) in links.iter().enumerate() {
            let mine: Vec<_> = observations.iter().filter(|o| o.anchor() == anchor).collect();
            if mine.is_empty() {
                continue;
            }
            let mut scan = Scan {
                anchor,
                action: link.expected,
                elapsed_s: std::mem::replace(&mut self.silent_s[anchor][0], T::ZERO),
                measurements: Vec::new(),
                frame: None,
                left_out: 0,
                cost: Cost { work: 0, cut_short: false },
            };
            // Ranges first: they outrank the paths near them.
            for observation in &mine {
                if let Observation::Ranges(ranges) = observation {
                    self.take_ranges(ranges, &mut scan);
                }
            }
            for observation in &mine {
                if let Observation::Frame(frame) = observation {
                    let pulse = library.pulse(frame.action, &self.radio);
                    let loss_ln = losses_ln[frame.action];
                    estimates.push((anchor, self.take_frame(frame, &pulse, link, loss_ln, &mut scan)));
                }
            }
            scans.push(scan);
        }
        (estimates, scans)
    }

    /// The ranges in their order, without the worst where there are too many: sorted by variance, then length, then
    /// place, those that follow the capacity.
    fn take_ranges(&self, ranges: &RangeScan<'_>, scan: &mut Scan<T>) {
        let mut all = Vec::new();
        for range in ranges.ranges {
            all.push(Measurement {
                range_m: T::of(range.range_m),
                variance_m2: self.measurement_variance(T::of(range.variance_m2)),
                sinr: T::ZERO,
                energy: T::ZERO,
                false_alarm: T::ONE,
            });
        }
        let mut best: Vec<usize> = (0..all.len()).collect();
        best.sort_by(|&i, &j| {
            let key = |n: usize| (all[n].variance_m2, all[n].range_m, n);
            key(i).partial_cmp(&key(j)).unwrap_or(std::cmp::Ordering::Equal)
        });
        let kept = all.len().min(self.room);
        best.truncate(kept);
        best.sort_unstable();
        scan.left_out += (all.len() - kept) as u32;
        scan.measurements.extend(best.into_iter().map(|n| all[n]));
    }

    /// Seconds since anything was heard before these scans.
    pub fn unheard_s(&self, scans: &[Scan<T>]) -> T {
        let mut unheard_s = T::of(f32::INFINITY);
        for (anchor, [silent_s, _]) in self.silent_s.iter().enumerate() {
            let scan = scans.iter().find(|scan| scan.anchor == anchor);
            unheard_s = smaller(unheard_s, scan.map_or(*silent_s, |scan| scan.elapsed_s));
        }
        unheard_s
    }

    fn take_frame(
        &mut self,
        frame: &Frame<'_>,
        pulse: &Pulse<T>,
        link: &Link,
        loss_ln: T,
        scan: &mut Scan<T>,
    ) -> ChannelEstimate<T> {
        let first_sample_delay_s = T::of(frame.first_sample_delay_s);
        let estimator = self.estimator(pulse);
        let estimate = estimator.estimate(frame.samples, first_sample_delay_s);
        let threshold = estimate.threshold;
        let longest_m = T::of(self.ranging.max_range_m);
        let estimator = self.estimator(pulse);
        let mut residual = estimator.residual(frame.samples, first_sample_delay_s, &estimate, longest_m);
        residual.energies.truncate(self.points);
        let elapsed_s = std::mem::replace(&mut self.silent_s[frame.anchor][1], T::ZERO);
        let unit = self.unit(frame, estimate.noise.white, elapsed_s, link, loss_ln);
        let resolution_m = pulse.duration_s * speed_of_light();
        let ranges = scan.measurements.clone();
        for path in &estimate.paths {
            let range_m = path.delay_s * speed_of_light();
            let near_range = ranges.iter().any(|range| abs(range.range_m - range_m) < resolution_m);
            let outside = range_m <= T::ZERO || range_m > T::of(self.ranging.max_range_m);
            if near_range || outside {
                continue;
            }
            if scan.measurements.len() == self.room {
                scan.left_out += 1;
                continue;
            }
            scan.measurements.push(Measurement {
                range_m,
                variance_m2: self.measurement_variance(pulse.range_variance_m2(path.sinr))
                    + square(T::of(self.ranging.floor_pulses) * resolution_m),
                sinr: path.sinr,
                energy: (square(path.amplitude[0]) + square(path.amplitude[1])) / unit,
                false_alarm: false_alarm(path.sinr, threshold),
            });
        }
        // What lies beside a much stronger path may be a remainder of that.
        for n in ranges.len()..scan.measurements.len() {
            let own = scan.measurements[n];
            let beside = scan.measurements.iter().any(|other| {
                abs(other.range_m - own.range_m) < resolution_m
                    && other.sinr > T::of(ARTEFACT_RATIO) * own.sinr
            });
            if beside {
                scan.measurements[n].false_alarm = T::ONE;
            }
        }
        scan.action = frame.action;
        scan.cost = estimate.cost;
        scan.frame = Some(Level {
            noise: estimate.noise.clone(),
            first_sample_delay_s,
            sample_spacing_s: T::of(self.radio.sample_spacing_s),
            unit,
            elapsed_s,
            threshold,
            resolution_m,
            alike_m2: self.alike_m2(resolution_m, elapsed_s),
            residual: (self.points > 0).then_some(residual),
            share: T::ONE / (T::ONE + T::of(2.0) / self.apart(elapsed_s)),
        });
        self.threshold = threshold;
        if frame.sequence.is_some() {
            self.last_sequence[frame.anchor] = frame.sequence;
        }
        estimate
    }

    /// Errors correlated by rho from frame to frame: (1 + rho) / (1 - rho) - 1 = 2 / (exp(dt / tau) - 1) times their variance more.
    fn alike_m2(&self, resolution_m: T, dt: T) -> T {
        square(T::of(self.ranging.floor_pulses) * resolution_m) * (T::of(2.0) / self.apart(dt))
    }

    /// 1 / rho - 1.
    fn apart(&self, dt: T) -> T {
        larger(exp_m1(dt / T::of(self.ranging.alike_s)), T::of(LEAST_APART))
    }

    /// What the powers of a frame are measured in.
    fn unit(&mut self, frame: &Frame<'_>, white: T, dt: T, link: &Link, loss_ln: T) -> T {
        if !self.radio.gain_control {
            return T::ONE;
        }
        let gain_control = &mut self.gain_control[frame.anchor];
        let own = Some(frame.action);
        // The last frame of a turn may come after it, where choices are announced.
        let turn = link.sought_with == own || gain_control.waiting_with() == own;
        let sought = link.is_lost && frame.action != link.held && turn;
        gain_control.unit(frame.samples, white, dt, frame.action, loss_ln, sought)
    }

    /// The estimator of a pulse.
    fn estimator(&mut self, pulse: &Pulse<T>) -> &ChannelEstimator<T> {
        let index = match self.estimators.iter().position(|(known, _)| known == pulse) {
            Some(index) => index,
            None => {
                let radio = &self.radio;
                let mut estimator = ChannelEstimator::new(
                    pulse.clone(),
                    T::of(radio.sample_spacing_s),
                    radio.samples_per_frame,
                    T::of(radio.false_paths_per_frame),
                    self.room,
                    self.settings,
                );
                estimator.most_work = self.most_work;
                self.estimators.push((pulse.clone(), estimator));
                self.estimators.len() - 1
            }
        };
        &self.estimators[index].1
    }

    /// Inflated, and at least the floor.
    fn measurement_variance(&self, variance_m2: T) -> T {
        T::of(self.ranging.variance_inflation) * variance_m2 + square(T::of(self.ranging.floor_m))
    }
}
