//! The feed: set-up and cycles of a recording, as the host's `cogmint trace --feed` writes them.
//!
//! Little-endian 32-bit words. `COG5`; counts of anchors, mapped virtual anchors, actions, cycles; seed (two words);
//! 14 configuration words, samples of the pulse's autocorrelation (0: none), roll-off or their spacing, those samples, 7
//! more words; per anchor x, y, height, mean and
//! deviation of its range bias; per mapped virtual anchor its anchor, x, y, deviation; whether there is a plan; of
//! a plan counts of corners, walls and segments, deviation of its turn, reflections, most sources, per corner x, y, per wall
//! the deviations of its offset and rotation, per segment its wall and both ends; per
//! action carrier and pulse duration. Per cycle: elapsed time; whether the height is known and the height; the antenna's lever arm; number
//! of frames; per frame anchor, action, delay of the first sample, kind (0 complex, 1 magnitude), number of
//! samples, samples; number of ranges; per range anchor, range, variance.
//!
//! Kept apart from the replay and what of the core is compiled into it, so that the flash that it takes can be told.

use crate::host::File;
use cogmint_core::model::observation::{Complex, Frame, Observation, Range, RangeScan, Samples, TagHeight};
use cogmint_core::radio::library::Action;
use cogmint_core::radio::pulse::{PULSE_SAMPLES, PulseShape};
use cogmint_core::{Anchor, Config, Map, MappedVirtualAnchor, Plan, PlanSegment, PlanWall};
use heapless::Vec;

const MAGIC: u32 = u32::from_le_bytes(*b"COG5");

/// An open feed.
pub struct Feed {
    file: File,
}

/// What the tracker is started with: as much of everything as it has room for.
pub struct Setup<const ANCHORS: usize, const SOURCES: usize, const SEGMENTS: usize, const ACTIONS: usize> {
    /// The configuration.
    pub config: Config,
    /// The anchors.
    pub anchors: Vec<Anchor, ANCHORS>,
    /// Mean and standard deviation of every anchor's range bias, metres.
    pub range_biases_m: Vec<[f32; 2], ANCHORS>,
    /// Virtual anchors told of.
    pub virtual_anchors: Vec<MappedVirtualAnchor, SOURCES>,
    /// The floor plan.
    pub plan: Option<StoredPlan<SEGMENTS>>,
    /// Carriers and pulses.
    pub actions: Vec<Action, ACTIONS>,
    /// Seed of the tracker.
    pub seed: u64,
    /// Cycles that follow.
    pub cycles: u32,
}

/// A floor plan, with what it consists of.
#[derive(Default)]
pub struct StoredPlan<const SEGMENTS: usize> {
    outline_m: Vec<[f32; 2], SEGMENTS>,
    walls: Vec<PlanWall, SEGMENTS>,
    segments: Vec<PlanSegment, SEGMENTS>,
    turn_std_rad: f32,
    reflections: usize,
    most_sources: usize,
}

impl<const ANCHORS: usize, const SOURCES: usize, const SEGMENTS: usize, const ACTIONS: usize>
    Setup<ANCHORS, SOURCES, SEGMENTS, ACTIONS>
{
    /// What the tracker is told of the surroundings.
    pub fn map(&self) -> Map<'_> {
        Map { virtual_anchors: &self.virtual_anchors, plan: self.plan.as_ref().map(StoredPlan::plan) }
    }
}

impl<const SEGMENTS: usize> StoredPlan<SEGMENTS> {
    fn plan(&self) -> Plan<'_> {
        let Self { outline_m, walls, segments, turn_std_rad, reflections, most_sources } = self;
        Plan {
            outline_m,
            walls,
            segments,
            turn_std_rad: *turn_std_rad,
            reflections: *reflections,
            most_sources: *most_sources,
        }
    }
}

/// A frame whose samples lie in the common buffer.
struct StoredFrame {
    anchor: usize,
    action: usize,
    first_sample_delay_s: f32,
    is_magnitude: bool,
    /// Where its numbers begin and end in the buffer.
    from: usize,
    to: usize,
}

/// One cycle of the feed.
pub struct CycleInput<const ANCHORS: usize, const PATHS: usize> {
    frames: Vec<StoredFrame, ANCHORS>,
    ranges: [Vec<Range, PATHS>; ANCHORS],
    /// Seconds since the cycle before.
    pub elapsed_s: f32,
    /// The tag's height, where it is known.
    pub tag_height: Option<TagHeight>,
    /// Where the antenna in use is on the body of the tag, metres.
    pub lever_arm_m: [f32; 2],
}

impl<const ANCHORS: usize, const PATHS: usize> CycleInput<ANCHORS, PATHS> {
    /// What the tracker gets: frames, then ranges, by anchor; two of each at most.
    #[inline(never)]
    pub fn observations<'a, const OBSERVATIONS: usize>(
        &'a self,
        samples: &'a [Complex],
    ) -> Vec<Observation<'a>, OBSERVATIONS> {
        const { assert!(OBSERVATIONS >= 2 * ANCHORS, "OBSERVATIONS holds a frame and ranges of every anchor") };
        let mut observations = Vec::new();
        for frame in &self.frames {
            let Some(numbers) = samples.as_flattened().get(frame.from..frame.to) else { continue };
            // A frame and ranges of every anchor: every push succeeds.
            let _ = observations.push(Observation::Frame(Frame {
                anchor: frame.anchor,
                action: frame.action,
                sequence: None,
                first_sample_delay_s: frame.first_sample_delay_s,
                samples: if frame.is_magnitude {
                    Samples::Magnitude(numbers)
                } else {
                    Samples::Complex(numbers.as_chunks().0)
                },
            }));
        }
        for (anchor, ranges) in self.ranges.iter().enumerate() {
            if !ranges.is_empty() {
                let _ = observations.push(Observation::Ranges(RangeScan { anchor, ranges }));
            }
        }
        observations
    }
}

impl Feed {
    /// Opens the feed and checks its head.
    #[inline(never)]
    pub fn open() -> Option<Self> {
        let mut feed = Self { file: File::open_feed()? };
        (feed.word()? == MAGIC).then_some(feed)
    }

    fn word(&mut self) -> Option<u32> {
        let mut bytes = [0; 4];
        self.file.read(&mut bytes).then(|| u32::from_le_bytes(bytes))
    }

    fn count(&mut self) -> Option<usize> {
        Some(self.word()? as usize)
    }

    fn float(&mut self) -> Option<f32> {
        Some(f32::from_bits(self.word()?))
    }

    fn pulse_shape(&mut self) -> Option<PulseShape> {
        let samples = self.count()?;
        let first = self.float()?;
        if samples == 0 {
            return Some(PulseShape::RootRaisedCosine { roll_off: first });
        }
        let mut autocorrelation = [0.0; PULSE_SAMPLES];
        if samples != autocorrelation.len() {
            return None;
        }
        for sample in &mut autocorrelation {
            *sample = self.float()?;
        }
        Some(PulseShape::Sampled { step_s: first, autocorrelation })
    }

    /// Reads the set-up, which comes first.
    #[inline(never)]
    pub fn setup<const ANCHORS: usize, const SOURCES: usize, const SEGMENTS: usize, const ACTIONS: usize>(
        &mut self,
    ) -> Option<Setup<ANCHORS, SOURCES, SEGMENTS, ACTIONS>> {
        let (anchors, map, actions) = (self.count()?, self.count()?, self.count()?);
        let cycles = self.word()?;
        let seed = u64::from(self.word()?) | u64::from(self.word()?) << 32;
        let mut config = Config::default();
        config.motion.acceleration_density_m2_s3 = self.float()?;
        config.motion.velocity_decay_s = self.float()?;
        config.start.position_m = [self.float()?, self.float()?];
        config.start.position_std_m = self.float()?;
        config.start.velocity_std_m_s = self.float()?;
        config.association.detection_probability = self.float()?;
        config.association.clutter_per_anchor = self.float()?;
        config.ranging.max_range_m = self.float()?;
        config.ranging.bias_mean_m = self.float()?;
        config.ranging.bias_std_m = self.float()?;
        config.ranging.floor_pulses = self.float()?;
        config.ranging.late_m = self.float()?;
        config.radio.sample_spacing_s = self.float()?;
        config.radio.pulse_shape = self.pulse_shape()?;
        config.radio.samples_per_frame = self.count()?;
        let radio = self.word()?;
        config.radio.gain_control = radio & 1 != 0;
        config.estimator.begins_with_path = radio & 2 != 0;
        config.has_heading = self.word()? != 0;
        config.work.anchor = self.word()?;
        config.work.comparisons = u16::try_from(self.word()?).ok()?;
        config.controller.first_action = self.count()?;
        config.controller.planned_actions = self.count()?;
        let mut setup = Setup {
            config,
            anchors: Vec::new(),
            range_biases_m: Vec::new(),
            virtual_anchors: Vec::new(),
            plan: None,
            actions: Vec::new(),
            seed,
            cycles,
        };
        for _ in 0..anchors {
            let anchor = Anchor { position_m: [self.float()?, self.float()?], height_m: self.float()? };
            setup.anchors.push(anchor).ok()?;
            setup.range_biases_m.push([self.float()?, self.float()?]).ok()?;
        }
        for _ in 0..map {
            let mapped = MappedVirtualAnchor {
                anchor: self.count()?,
                position_m: [self.float()?, self.float()?],
                std_m: self.float()?,
            };
            setup.virtual_anchors.push(mapped).ok()?;
        }
        if self.word()? != 0 {
            self.plan(setup.plan.insert(StoredPlan::default()))?;
        }
        for _ in 0..actions {
            let action = Action { carrier_hz: self.float()?, pulse_duration_s: self.float()? };
            setup.actions.push(action).ok()?;
        }
        Some(setup)
    }

    fn plan<const SEGMENTS: usize>(&mut self, plan: &mut StoredPlan<SEGMENTS>) -> Option<()> {
        let (corners, walls, segments) = (self.count()?, self.count()?, self.count()?);
        plan.turn_std_rad = self.float()?;
        plan.reflections = self.count()?;
        plan.most_sources = self.count()?;
        for _ in 0..corners {
            plan.outline_m.push([self.float()?, self.float()?]).ok()?;
        }
        for _ in 0..walls {
            let wall = PlanWall { offset_std_m: self.float()?, rotation_std_rad: self.float()? };
            plan.walls.push(wall).ok()?;
        }
        for _ in 0..segments {
            let wall = self.count()?;
            let ends_m = [[self.float()?, self.float()?], [self.float()?, self.float()?]];
            plan.segments.push(PlanSegment { wall, ends_m }).ok()?;
        }
        Some(())
    }

    /// Reads the next cycle, its samples into `samples`.
    #[inline(never)]
    pub fn cycle<const ANCHORS: usize, const PATHS: usize>(
        &mut self,
        samples: &mut [Complex],
    ) -> Option<CycleInput<ANCHORS, PATHS>> {
        let elapsed_s = self.float()?;
        let known = self.word()? != 0;
        let height = TagHeight { mean_m: self.float()?, std_m: self.float()? };
        let lever_arm_m = [self.float()?, self.float()?];
        let mut input = CycleInput {
            frames: Vec::new(),
            ranges: [const { Vec::new() }; ANCHORS],
            elapsed_s,
            tag_height: known.then_some(height),
            lever_arm_m,
        };
        let mut from = 0;
        for _ in 0..self.count()? {
            let (anchor, action) = (self.count()?, self.count()?);
            let first_sample_delay_s = self.float()?;
            let is_magnitude = self.word()? != 0;
            let numbers = self.count()?.checked_mul(if is_magnitude { 1 } else { 2 })?;
            let to = usize::checked_add(from, numbers)?;
            self.numbers(samples.as_flattened_mut().get_mut(from..to)?)?;
            let frame = StoredFrame { anchor, action, first_sample_delay_s, is_magnitude, from, to };
            input.frames.push(frame).ok()?;
            from = to;
        }
        for _ in 0..self.count()? {
            let anchor = self.count()?;
            let range = Range { range_m: self.float()?, variance_m2: self.float()? };
            input.ranges.get_mut(anchor)?.push(range).ok()?;
        }
        Some(input)
    }

    fn numbers(&mut self, into: &mut [f32]) -> Option<()> {
        let mut bytes = [0; 512];
        for chunk in into.chunks_mut(bytes.len() / 4) {
            let filled = bytes.get_mut(..chunk.len() * 4)?;
            if !self.file.read(filled) {
                return None;
            }
            for (number, word) in chunk.iter_mut().zip(filled.as_chunks().0) {
                *number = f32::from_le_bytes(*word);
            }
        }
        Some(())
    }
}
