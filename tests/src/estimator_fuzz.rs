//! Frames that no radio should deliver, and what the channel estimator and the tracker may answer.
//!
//! Every frame is drawn from its number alone, so that a failure names the frame that shows it.

use cogmint_core::model::observation::{Complex, Frame, Observation, SampleFault, Samples};
use cogmint_core::perceptor::channel_estimator::{ChannelEstimate, ChannelEstimator, EstimatorSettings};
use cogmint_core::radio::library::Action;
use cogmint_core::radio::pulse::{Pulse, SUPPORT};
use cogmint_core::{Anchor, Config, Error, Map, Tracker};
use rand_core::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro128PlusPlus;
use std::time::{Duration, Instant};

/// Frames that share a pulse, a sample spacing and a tracker.
pub const BATCH: u64 = 40;
/// Longest frame.
const LONGEST: usize = 1024;
/// No frame may take longer; about ten times the slowest.
const TIME_LIMIT: Duration = Duration::from_millis(250);
/// How often a frame is timed before it counts as slow: a busy machine stalls anything once.
const TIMINGS: usize = 5;
const PATHS: usize = 16;

/// What a frame is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Shape {
    /// Nothing.
    Silence,
    /// One value.
    Constant,
    /// One value that begins or ends within the frame.
    Step,
    /// A straight line.
    Ramp,
    /// A complex tone.
    Tone,
    /// Two values in turn.
    Alternating,
    /// Single samples on nothing.
    Spikes,
    /// White noise.
    Noise,
    /// White noise on a constant.
    Offset,
    /// Noise rounded to whole numbers, mostly zero.
    Rounded,
    /// An exponential decay.
    Decay,
    /// Paths in noise.
    Paths,
    /// Paths without noise, most of them at the same delay.
    IdenticalPaths,
    /// Paths at the frame's ends.
    EdgePaths,
    /// Paths cut off at a level.
    Clipped,
    /// Numbers around the smallest.
    Denormal,
    /// Any bits, numbers or not.
    Bits,
    /// Noise with one sample that is no number.
    NotFinite,
}

const SHAPES: [Shape; 18] = [
    Shape::Silence,
    Shape::Constant,
    Shape::Step,
    Shape::Ramp,
    Shape::Tone,
    Shape::Alternating,
    Shape::Spikes,
    Shape::Noise,
    Shape::Offset,
    Shape::Rounded,
    Shape::Decay,
    Shape::Paths,
    Shape::IdenticalPaths,
    Shape::EdgePaths,
    Shape::Clipped,
    Shape::Denormal,
    Shape::Bits,
    Shape::NotFinite,
];

/// A generator of frames.
struct Source {
    rng: Xoshiro128PlusPlus,
}

impl Source {
    fn new(seed: u64) -> Self {
        Self { rng: Xoshiro128PlusPlus::seed_from_u64(seed) }
    }

    fn uniform(&mut self) -> f32 {
        (self.rng.next_u32() >> 8) as f32 / 16_777_216.0
    }

    fn below(&mut self, count: usize) -> usize {
        self.rng.next_u32() as usize % count
    }

    fn chance(&mut self, one_in: usize) -> bool {
        self.below(one_in) == 0
    }

    /// Uniform in its logarithm.
    fn spread(&mut self, low: f32, high: f32) -> f32 {
        ((low.ln() + (high.ln() - low.ln()) * self.uniform()).exp()).clamp(low, high)
    }

    fn complex(&mut self, magnitude: f32) -> Complex {
        let angle = std::f32::consts::TAU * self.uniform();
        [magnitude * angle.cos(), magnitude * angle.sin()]
    }

    fn normal(&mut self) -> Complex {
        let radius = (-(1.0 - self.uniform()).ln()).sqrt();
        self.complex(radius)
    }

    fn scale(&mut self) -> f32 {
        match self.below(8) {
            0 => 1e-30,
            1 => 1e-18,
            2 => self.spread(1e-12, 1e-3),
            3 => self.spread(1e3, 1e9),
            4 => 1e11,
            5 => 9e11,
            _ => 1.0,
        }
    }

    /// The paths' sum at every sample.
    fn pulses(&mut self, length: usize, pulse: &Pulse, spacing_s: f32, delays: &[f32]) -> Vec<Complex> {
        let paths: Vec<(f32, Complex)> = delays
            .iter()
            .map(|&delay| {
                let amplitude = self.spread(1.0, 1e3);
                (delay, self.complex(amplitude))
            })
            .collect();
        let at = |n: usize| {
            paths.iter().fold([0.0, 0.0], |[re, im], (delay, amplitude)| {
                let r = pulse.autocorrelation((n as f32 - delay) * spacing_s / pulse.duration_s);
                [re + r * amplitude[0], im + r * amplitude[1]]
            })
        };
        (0..length).map(at).collect()
    }

    fn samples(&mut self, shape: Shape, length: usize, pulse: &Pulse, spacing_s: f32) -> Vec<Complex> {
        let value = self.normal();
        let other = self.normal();
        let place = self.below(length.max(1));
        let each = |value: &mut dyn FnMut(usize) -> Complex| (0..length).map(value).collect::<Vec<_>>();
        match shape {
            Shape::Silence => vec![[0.0, if place == 0 { -0.0 } else { 0.0 }]; length],
            Shape::Constant => vec![value; length],
            Shape::Step => {
                let first = self.chance(2);
                each(&mut |n| if (n < place) == first { value } else { [0.0, 0.0] })
            }
            Shape::Ramp => each(&mut |n| value.map(|x| x * (n as f32 - place as f32))),
            Shape::Tone => {
                let turn = std::f32::consts::TAU * self.uniform();
                each(&mut |n| [(turn * n as f32).cos(), (turn * n as f32).sin()])
            }
            Shape::Alternating => each(&mut |n| if n % 2 == 0 { value } else { other }),
            Shape::Spikes => {
                let one_in = 2 + self.below(60);
                each(&mut |_| if self.chance(one_in) { self.normal() } else { [0.0, 0.0] })
            }
            Shape::Noise => each(&mut |_| self.normal()),
            Shape::Offset => {
                let weight = self.spread(0.1, 1e4);
                each(&mut |_| {
                    let [re, im] = self.normal();
                    [re + weight * value[0], im + weight * value[1]]
                })
            }
            Shape::Rounded => {
                let weight = self.spread(0.2, 5.0);
                each(&mut |_| self.normal().map(|x| (weight * x).round()))
            }
            Shape::Decay => {
                let decay = self.spread(0.5, 500.0);
                each(&mut |n| value.map(|x| x * (-(n as f32) / decay).exp()))
            }
            Shape::Paths | Shape::Clipped => {
                let delays: Vec<f32> =
                    (0..1 + self.below(20)).map(|_| self.uniform() * length as f32).collect();
                let mut samples = self.pulses(length, pulse, spacing_s, &delays);
                for sample in &mut samples {
                    let noise = self.normal();
                    *sample = [sample[0] + noise[0], sample[1] + noise[1]];
                }
                if shape == Shape::Clipped {
                    let limit = self.spread(1.0, 300.0);
                    samples.iter_mut().for_each(|sample| *sample = sample.map(|x| x.clamp(-limit, limit)));
                }
                samples
            }
            Shape::IdenticalPaths => {
                let delay = self.uniform() * length as f32;
                let delays: Vec<f32> = (0..2 + self.below(10))
                    .map(|_| if self.chance(4) { delay + self.uniform() } else { delay })
                    .collect();
                self.pulses(length, pulse, spacing_s, &delays)
            }
            Shape::EdgePaths => {
                let end = length as f32;
                let delays = [-0.4, 0.0, 0.3, end - 1.3, end - 1.0, end - 0.5];
                let count = 1 + self.below(6);
                let first = self.below(6);
                let chosen: Vec<f32> = (0..count).map(|k| delays[(first + k) % 6]).collect();
                self.pulses(length, pulse, spacing_s, &chosen)
            }
            Shape::Denormal => {
                each(&mut |_| [0, 1].map(|_| f32::from_bits(self.rng.next_u32() & 0x807f_ffff)))
            }
            Shape::Bits => {
                let finite = self.chance(2);
                each(&mut |_| {
                    [0, 1].map(|_| {
                        let number = f32::from_bits(self.rng.next_u32());
                        if finite && !(number.abs() < 1e12) { 0.0 } else { number }
                    })
                })
            }
            Shape::NotFinite => {
                let mut samples = each(&mut |_| self.normal());
                let bad = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e12, -2e30][self.below(5)];
                let part = self.below(2);
                if let Some(sample) = samples.get_mut(place) {
                    sample[part] = bad;
                }
                samples
            }
        }
    }

    /// A frame of one shape, or of two laid over each other or end to end.
    fn frame(
        &mut self,
        length: usize,
        pulse: &Pulse,
        spacing_s: f32,
    ) -> (Shape, Option<Shape>, Vec<Complex>) {
        let shape = SHAPES[self.below(SHAPES.len())];
        let mut samples = self.samples(shape, length, pulse, spacing_s);
        let second = self.chance(3).then(|| SHAPES[self.below(SHAPES.len())]);
        if let Some(second) = second {
            let more = self.samples(second, length, pulse, spacing_s);
            let from = if self.chance(2) { 0 } else { self.below(length.max(1)) };
            let weight = self.spread(1e-4, 1e4);
            for (n, (sample, more)) in samples.iter_mut().zip(more).enumerate() {
                if from == 0 {
                    *sample = [sample[0] + weight * more[0], sample[1] + weight * more[1]];
                } else if n >= from {
                    *sample = more.map(|x| weight * x);
                }
            }
        }
        let scale = self.scale();
        if scale != 1.0 && !matches!(shape, Shape::Bits | Shape::Denormal) {
            samples.iter_mut().for_each(|sample| *sample = sample.map(|x| x * scale));
        }
        (shape, second, samples)
    }
}

/// What the frames of a run got.
#[derive(Clone, Debug, Default)]
pub struct Tally {
    /// Frames estimated.
    pub frames: u64,
    /// Frames refused.
    pub refused: u64,
    /// Per shape, unmixed, complex and magnitudes: frames estimated, paths, and frames that filled all paths.
    pub shapes: std::collections::BTreeMap<(Shape, bool), [u64; 3]>,
    /// The slowest estimate.
    pub slowest: Duration,
    /// Cycles of trackers.
    pub cycles: u64,
    /// Cycles that they refused.
    pub refused_cycles: u64,
}

impl Tally {
    /// Both together.
    pub fn with(mut self, other: Self) -> Self {
        self.frames += other.frames;
        self.refused += other.refused;
        self.slowest = self.slowest.max(other.slowest);
        self.cycles += other.cycles;
        self.refused_cycles += other.refused_cycles;
        for (shape, counts) in other.shapes {
            let sum = self.shapes.entry(shape).or_default();
            for (sum, count) in sum.iter_mut().zip(counts) {
                *sum += count;
            }
        }
        self
    }
}

/// Runs batch `number`; panics, naming the frame, where an answer is not allowed.
pub fn batch(number: u64) -> Tally {
    let mut source = Source::new(number);
    let duration_s = source.spread(0.1e-9, 10e-9);
    let roll_off = [0.0, 1.0, 0.6, source.uniform()][source.below(4)];
    let pulse = Pulse::root_raised_cosine(duration_s, roll_off);
    // From 40 samples per pulse to one.
    let spacing_s = (duration_s * source.spread(1.0 / 40.0, 1.0)).clamp(1e-11, 1e-8);
    let false_paths = source.spread(1e-4, 10.0);
    let configured = source.spread(16.0, LONGEST as f32) as usize;
    let estimator = ChannelEstimator::<PATHS>::new(
        pulse,
        spacing_s,
        configured,
        false_paths,
        EstimatorSettings::default(),
    );

    let mut config = Config::default();
    config.radio.pulse_shape = pulse.shape;
    config.radio.sample_spacing_s = spacing_s;
    config.radio.samples_per_frame = configured;
    config.radio.false_paths_per_frame = false_paths;
    config.radio.full_scale = source.chance(2).then_some(3e10);
    config.controller.planned_actions = 1;
    let anchors =
        [Anchor { position_m: [0.5, 7.0], height_m: 1.0 }, Anchor { position_m: [5.2, 3.2], height_m: 1.0 }];
    let actions = [Action { carrier_hz: 7e9, pulse_duration_s: duration_s }];
    let mut tracker = Tracker::<2, 4, 4, 1, PATHS, 1, 8, 256, 6>::new();
    tracker.start(&config, &anchors, &Map::default(), &actions, number).expect("the settings are in range");

    let mut tally = Tally::default();
    for index in 0..BATCH {
        let name = format!("frame {index} of batch {number}");
        // The tracker takes one length only.
        let length = if source.chance(2) { configured } else { source.spread(1.0, 1024.99) as usize };
        let length = if source.chance(200) { 0 } else { length };
        let (shape, second, samples) = source.frame(length, &pulse, spacing_s);
        let first_sample_delay_s = [0.0, -1e-7, 5e-8][source.below(3)];
        let magnitudes: Option<Vec<f32>> = source.chance(2).then(|| {
            // Now and then something that is no magnitude.
            let signed = source.chance(20);
            samples.iter().map(|[re, im]| if signed { *re } else { re.hypot(*im) }).collect()
        });
        let name = format!(
            "{name}: {length} samples, {shape:?} with {second:?}, {}, {pulse:?}, spacing {spacing_s}, rate {false_paths}",
            if magnitudes.is_some() { "magnitudes" } else { "complex" }
        );
        let samples = match &magnitudes {
            Some(magnitudes) => Samples::Magnitude(magnitudes),
            None => Samples::Complex(&samples),
        };
        let fault = fault(samples);
        let timed = || {
            let begin = Instant::now();
            let answer = estimator.estimate(samples, first_sample_delay_s);
            (answer, begin.elapsed())
        };
        let (answer, mut took) = timed();
        for _ in 1..TIMINGS {
            if took > TIME_LIMIT / 10 {
                took = took.min(timed().1);
            }
        }
        assert!(took < TIME_LIMIT, "{name}: took {took:?}");
        tally.slowest = tally.slowest.max(took);
        match (answer, fault) {
            (Err(given), Some(expected)) => {
                assert_eq!(given, expected, "{name}");
                tally.refused += 1;
            }
            (Ok(estimate), None) => {
                check_estimate(&estimate, length, first_sample_delay_s, &pulse, spacing_s, &name);
                tally.frames += 1;
                if second.is_none() {
                    let counts = tally.shapes.entry((shape, magnitudes.is_some())).or_default();
                    counts[0] += 1;
                    counts[1] += estimate.paths.len() as u64;
                    counts[2] += u64::from(estimate.paths.len() == PATHS);
                }
                // What has no pulse in it has no path, unless noise is let through (a kappa of 3 stops 95 % of it).
                let featureless = match shape {
                    Shape::Constant => true,
                    Shape::Ramp => magnitudes.is_some(),
                    _ => false,
                };
                if second.is_none() && featureless && estimator.threshold(&Samples::Magnitude(&[])) > 3.0 {
                    assert!(estimate.paths.is_empty(), "{name}: {:?}", estimate.paths);
                }
            }
            (given, expected) => panic!("{name}: {given:?}, but the samples have {expected:?}"),
        }
        if length == configured || index % 8 == 0 {
            let frame = Frame {
                anchor: (index % 2) as usize,
                action: 0,
                sequence: None,
                first_sample_delay_s: 0.0,
                samples,
            };
            tally.cycles += 1;
            tally.refused_cycles += u64::from(!cycle(&mut tracker, &frame, &config, fault, &name));
        }
    }
    tally
}

/// What is wrong with samples.
fn fault(samples: Samples<'_>) -> Option<SampleFault> {
    let parts: Vec<[f32; 2]> = match samples {
        Samples::Complex(samples) => samples.to_vec(),
        Samples::Magnitude(samples) => samples.iter().map(|m| [*m, 0.0]).collect(),
    };
    let is_magnitude = matches!(samples, Samples::Magnitude(_));
    if parts.is_empty() {
        return Some(SampleFault::Empty);
    }
    for (sample, part) in parts.iter().enumerate() {
        if part.iter().any(|x| x.is_nan() || x.abs() >= 1e12) {
            return Some(SampleFault::NotFinite { sample });
        }
        if is_magnitude && part[0] < 0.0 {
            return Some(SampleFault::Negative { sample });
        }
    }
    parts.iter().flatten().all(|x| *x == 0.0).then_some(SampleFault::Silent)
}

fn check_estimate(
    estimate: &ChannelEstimate<PATHS>,
    length: usize,
    first_sample_delay_s: f32,
    pulse: &Pulse,
    spacing_s: f32,
    name: &str,
) {
    let positive = |x: f32| x.is_finite() && x > 0.0;
    assert!(positive(estimate.noise.white), "{name}: white noise {}", estimate.noise.white);
    for n in 0..length {
        let level = estimate.noise.level(n as f32, spacing_s);
        assert!(positive(level), "{name}: level {level} at sample {n}");
    }
    let support_s = SUPPORT as f32 * pulse.duration_s;
    let last_s = first_sample_delay_s + length as f32 * spacing_s + support_s;
    for path in &estimate.paths {
        let within = path.delay_s > first_sample_delay_s - support_s && path.delay_s < last_s;
        assert!(within, "{name}: {path:?} outside the frame");
        assert!(path.amplitude.iter().all(|x| x.is_finite()), "{name}: {path:?}");
        assert!(positive(path.sinr) && positive(path.delay_variance_s2), "{name}: {path:?}");
    }
}

/// One cycle of a tracker; whether it took the frame.
fn cycle(
    tracker: &mut Tracker<2, 4, 4, 1, PATHS, 1, 8, 256, 6>,
    frame: &Frame<'_>,
    config: &Config,
    fault: Option<SampleFault>,
    name: &str,
) -> bool {
    let (anchor, given) = (frame.anchor, frame.samples.len());
    let at_full_scale = |x: f32| config.radio.full_scale.is_some_and(|full_scale| x.abs() >= full_scale);
    let saturated = match frame.samples {
        Samples::Complex(samples) => {
            samples.iter().filter(|parts| parts.iter().any(|x| at_full_scale(*x))).count()
        }
        Samples::Magnitude(samples) => samples.iter().filter(|x| at_full_scale(**x)).count(),
    };
    let expected = config.radio.samples_per_frame;
    let expected = match fault {
        _ if given != expected => Some(Error::FrameLength { anchor, given, expected }),
        Some(SampleFault::NotFinite { sample }) => Some(Error::SampleNotFinite { anchor, sample }),
        Some(SampleFault::Negative { sample }) => Some(Error::NegativeMagnitude { anchor, sample }),
        Some(SampleFault::Silent) => Some(Error::SilentFrame { anchor }),
        _ if saturated > 1 => Some(Error::SaturatedFrame { anchor, samples: saturated }),
        _ => None,
    };
    let before = tracker.hash();
    match tracker.cycle(&[Observation::Frame(*frame)], 0.1, None) {
        Err(error) => {
            assert_eq!(Some(error), expected, "{name}");
            assert_eq!(tracker.hash(), before, "{name}: the state changed");
            false
        }
        Ok(report) => {
            assert_eq!(expected, None, "{name}");
            let covariance = report.position_covariance_m2;
            let finite = report.position_m.iter().chain(covariance.iter()).all(|x| x.is_finite());
            let definite = covariance[(0, 0)] > 0.0 && covariance[(1, 1)] > 0.0;
            assert!(finite && definite, "{name}: {report:?}");
            assert!(report.entropy_nat.is_finite() && report.reward.is_finite(), "{name}: {report:?}");
            true
        }
    }
}
