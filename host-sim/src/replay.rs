//! Replay: a recording becomes what the core takes in, cycle by cycle.

use crate::input_error::InputError;
use crate::recording::{self, ARRAYS_FILE, META_FILE, Recording};
use crate::told_plan::ToldPlan;
use cogmint_core::memory::discovery::USUAL_CANDIDATES;
use cogmint_core::model::observation::{Frame, Observation, Range, RangeScan, Samples, TagHeight};
use cogmint_core::observer::Observer;
use cogmint_core::radio::library::Action;
use cogmint_core::radio::pulse::PulseShape;
use cogmint_core::{Anchor, Config, CycleReport, Error, Map, MappedVirtualAnchor, Setting, Tracker, Variant};
use rand_core::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro128PlusPlus;

/// Surfaces of every tracker on the host.
pub const SURFACES: usize = 24;
/// Images.
pub const SOURCES: usize = 24;
/// Walls, their segments, and corners of the outline: as many as a recording may have.
pub const SEGMENTS: usize = recording::MAX_PLAN_SEGMENTS;
/// Paths per anchor.
pub const PATHS: usize = 16;
/// Actions.
pub const ACTIONS: usize = 40;
/// Components of the belief.
pub const COMPONENTS: usize = 16;
/// Recordings of up to this many anchors run in a smaller tracker: as many as the target's.
pub const SMALL_ANCHORS: usize = 2;
/// The most anchors of any recording.
pub const LARGE_ANCHORS: usize = 8;

/// Surfaces of the target's tracker: the walls of a room.
pub const TARGET_SURFACES: usize = 8;
/// Components of the target's tracker: as many as its memory holds.
pub const TARGET_COMPONENTS: usize = 8;

/// Points of what paths leave of the target's frames: as many as it has for 400 samples of half a pulse duration.
pub const TARGET_POINTS: usize = 800;
/// The same of the host: 4096 samples of half a pulse duration, and 2048 of a whole one.
pub const POINTS: usize = 8192;

/// A tracker of so many anchors, surfaces, components and points.
pub type AnyTracker<const A: usize, const S: usize, const C: usize, const P: usize> =
    Tracker<A, S, SOURCES, SEGMENTS, PATHS, ACTIONS, C, P, USUAL_CANDIDATES>;
/// The tracker of the target.
pub type TargetTracker = AnyTracker<SMALL_ANCHORS, TARGET_SURFACES, TARGET_COMPONENTS, TARGET_POINTS>;
/// The tracker for up to two anchors.
pub type SmallTracker = SizedTracker<SMALL_ANCHORS>;
/// The tracker for up to eight anchors.
pub type LargeTracker = SizedTracker<LARGE_ANCHORS>;
/// A tracker of the host for up to `A` anchors.
pub type SizedTracker<const A: usize> = AnyTracker<A, SURFACES, COMPONENTS, POINTS>;

/// Stack on which trackers are made, bytes. One of eight anchors is 0.32 MB, and without optimisation it is made there before it is moved
/// to the heap.
const BUILDING_STACK_BYTES: usize = 32 << 20;
/// Time before the first cycle: the start prior is about its very moment, and time must advance.
const BEFORE_FIRST_CYCLE_S: f32 = 1e-3;
/// A height beyond this, metres, is the recording's mistake: the cycle goes on without it.
const HIGHEST_TAG_M: f64 = 1e3;
/// Time must advance also where two cycles are closer than single precision tells.
const SHORTEST_STEP_S: f32 = 1e-6;
/// The core's longest step of time; a longer gap makes it no wiser.
const LONGEST_GAP_S: f32 = 3600.0;

/// What a recording is tracked with: a variant of the core's tracker, or that tracker without any reflection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TrackerVariant {
    /// A variant of the core.
    Core(Variant),
    /// The soft variant of the core, set up by [`Setup::without_reflections`].
    Direct,
}

impl TrackerVariant {
    /// All of them.
    pub const ALL: [Self; Variant::ALL.len() + 1] = [
        Self::Core(Variant::Conventional),
        Self::Core(Variant::Probabilistic),
        Self::Core(Variant::Soft),
        Self::Direct,
    ];

    /// Its name, in one lower-case word.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Core(variant) => variant.name(),
            Self::Direct => "direct",
        }
    }
}

impl Default for TrackerVariant {
    fn default() -> Self {
        Self::Core(Variant::Soft)
    }
}

impl From<Variant> for TrackerVariant {
    fn from(variant: Variant) -> Self {
        Self::Core(variant)
    }
}

/// Everything a tracker is started with.
#[derive(Clone, Debug)]
pub struct Setup {
    /// The configuration.
    pub config: Config,
    /// The anchors.
    pub anchors: Vec<Anchor>,
    /// Virtual anchors known a priori whose walls are not.
    pub map: Vec<MappedVirtualAnchor>,
    /// The floor plan, from which the others follow.
    pub plan: Option<ToldPlan>,
    /// Mean and standard deviation of every anchor's range bias, metres.
    pub range_biases_m: Vec<[f32; 2]>,
    /// The action library.
    pub actions: Vec<Action>,
    /// Seed of the tracker's randomness.
    pub seed: u64,
}

impl Setup {
    /// The set-up of a recording. With a `seed`, the start is drawn from the recording's disc (or its normal prior
    /// where it has none), about `drawn_about_m` where the recording has it; without, the tracker starts at the
    /// prior's mean.
    ///
    /// # Errors
    /// The recording asks for more than the tracker holds.
    pub fn new(recording: &Recording, file: &std::path::Path, seed: Option<u64>) -> Result<Self, InputError> {
        let Recording { start, association, radio, .. } = recording;
        let refuse =
            |item: &str, reason: String| Err(InputError::new(file.join(META_FILE), reason).for_item(item));
        if recording.anchors.len() > LARGE_ANCHORS {
            let reason =
                format!("has {} entries, the tracker holds {LARGE_ANCHORS}", recording.anchors.len());
            return refuse("anchors", reason);
        }
        if recording.actions.len() > ACTIONS {
            let reason = format!("has {} entries, the tracker holds {ACTIONS}", recording.actions.len());
            return refuse("actions", reason);
        }
        let known: Vec<_> = recording
            .virtual_anchors
            .iter()
            .filter(|va| va.known && (va.walls.is_empty() || recording.plan.is_none()))
            .collect();
        let most = SURFACES.min(SOURCES);
        if known.len() > most {
            let reason = format!("has {} known entries, the tracker holds {most}", known.len());
            return refuse("virtual_anchors", reason);
        }
        let mut config = Config::default();
        config.motion.acceleration_density_m2_s3 = recording.acceleration_density_m2_s3() as f32;
        if let Some(decay_s) = recording.motion.velocity_decay_s {
            config.motion.velocity_decay_s = decay_s as f32;
        }
        config.start.position_m = single(drawn_start(start, seed));
        config.start.position_std_m = start.position_std_m as f32;
        config.start.velocity_std_m_s = start.velocity_std_m_s as f32;
        config.association.detection_probability = association.detection_probability.min(0.999) as f32;
        config.association.clutter_per_anchor = association.clutter_per_anchor.max(1e-3) as f32;
        config.ranging.max_range_m = association.max_range_m as f32;
        config.ranging.bias_mean_m = radio.range_bias_mean_m as f32;
        config.ranging.bias_std_m = radio.range_bias_std_m as f32;
        config.ranging.late_m = radio.range_late_m as f32;
        if let Some(floor) = radio.range_floor_pulses {
            config.ranging.floor_pulses = floor as f32;
        }
        let arms_m = recording.antennas.iter().filter_map(|antenna| antenna.lever_arm_m);
        // It takes the place of a surface, where there is one to spare.
        config.has_heading = known.len() < most && arms_m.into_iter().any(|arm_m| arm_m != [0.0; 2]);
        config.radio.pulse_shape = pulse_shape(radio);
        config.radio.gain_control = radio.gain_control;
        config.estimator.begins_with_path = radio.begins_with_path;
        if let Some(spacing) = radio.sample_spacing_s {
            config.radio.sample_spacing_s = spacing as f32;
        }
        if let Some(frame) = recording.cycles.iter().find_map(|cycle| cycle.frames.first()) {
            config.radio.samples_per_frame = frame.samples.len();
            config.controller.first_action = frame.action;
        }
        let mut actions: Vec<Action> = recording
            .actions
            .iter()
            .map(|action| Action {
                carrier_hz: action.carrier_hz as f32,
                pulse_duration_s: action.pulse_duration_s as f32,
            })
            .collect();
        if actions.is_empty() {
            // Ranges alone: one action that nothing depends on.
            actions.push(Action { carrier_hz: 7e9, pulse_duration_s: radio.pulse_duration_s as f32 });
        }
        let setup = Self {
            config,
            anchors: recording
                .anchors
                .iter()
                .map(|anchor| Anchor {
                    position_m: single(anchor.position_m),
                    height_m: anchor.height_m as f32,
                })
                .collect(),
            map: known
                .iter()
                .map(|va| MappedVirtualAnchor {
                    anchor: va.anchor,
                    position_m: single(va.told_position_m.unwrap_or(va.position_m)),
                    std_m: va.std_m as f32,
                })
                .collect(),
            plan: recording.plan.as_ref().map(ToldPlan::new),
            range_biases_m: recording
                .anchors
                .iter()
                .map(|anchor| {
                    [
                        anchor.range_bias_mean_m.unwrap_or(radio.range_bias_mean_m) as f32,
                        anchor.range_bias_std_m.unwrap_or(radio.range_bias_std_m) as f32,
                    ]
                })
                .collect(),
            actions,
            seed: seed.unwrap_or(1),
        };
        if let Some(plan) = &setup.plan {
            plan.check_size(file.join(META_FILE), "plan")?;
        }
        // The core has the last word on what it takes.
        match setup.tracker::<LARGE_ANCHORS>() {
            Ok(_) => Ok(setup),
            Err(error) => {
                let anchors_out_of_reach = setup.anchors.iter().any(is_out_of_reach);
                let own_bias = if error == Error::Configuration(Setting::BiasPrior) {
                    refused_bias(recording, file)
                } else {
                    None
                };
                Err(own_bias.unwrap_or_else(|| refusal(error, file, anchors_out_of_reach)))
            }
        }
    }

    /// The same set-up for a variant of the tracker. The conventional one takes the positions told for exact, and nothing
    /// else: where a recording's plan is wrong, so is its map.
    ///
    /// # Errors
    /// The conventional variant needs a floor plan, and the recording in `folder` has none.
    pub fn with_variant(
        mut self,
        variant: impl Into<TrackerVariant>,
        folder: &std::path::Path,
    ) -> Result<Self, InputError> {
        let variant = match variant.into() {
            TrackerVariant::Core(variant) => variant,
            TrackerVariant::Direct => return Ok(self.without_reflections()),
        };
        if variant == Variant::Conventional && !self.tells_images() {
            let reason =
                "has no known entry, and the conventional variant finds none itself: it needs a floor plan";
            return Err(InputError::new(folder.join(META_FILE), reason).for_item("virtual_anchors"));
        }
        self.config = self.config.with_variant(variant);
        Ok(self)
    }

    /// The same set-up without any reflection: no virtual anchor is told, and none is discovered. What belongs to no direct
    /// path is clutter. How much of it there is, the core starts to count at `unmapped_per_anchor` above the false alarms
    /// and adapts to what it sees; it expects the false alarms anywhere, the rest only behind the direct path, where
    /// reflections are.
    #[must_use]
    pub fn without_reflections(mut self) -> Self {
        self.config = self.config.with_variant(Variant::Soft);
        self.config.discovery = false;
        self.map.clear();
        self.plan = None;
        self
    }

    /// Whether the tracker is told of any reflection.
    pub fn tells_images(&self) -> bool {
        !self.map.is_empty() || self.plan.is_some()
    }

    /// What the core is told of the surroundings.
    pub fn told(&self) -> Map<'_> {
        Map { virtual_anchors: &self.map, plan: self.plan.as_ref().map(ToldPlan::plan) }
    }

    /// A fresh tracker of capacity `ANCHORS`. It is built on a thread of its own: most stacks are too small for it.
    ///
    /// # Errors
    /// What the core refuses.
    pub fn tracker<const A: usize>(&self) -> Result<Box<SizedTracker<A>>, Error> {
        self.build()
    }

    /// A fresh tracker of the target's capacity.
    ///
    /// # Errors
    /// What the core refuses; more virtual anchors or walls than the target holds among them.
    pub fn target_tracker(&self) -> Result<Box<TargetTracker>, Error> {
        self.build()
    }

    /// Starts a tracker of any size.
    ///
    /// # Errors
    /// What the core refuses.
    pub fn start<
        const ANCHORS: usize,
        const SURFACES: usize,
        const SOURCES: usize,
        const SEGMENTS: usize,
        const PATHS: usize,
        const ACTIONS: usize,
        const COMPONENTS: usize,
        const POINTS: usize,
        const CANDIDATES: usize,
        const FRAMES: usize,
    >(
        &self,
        tracker: &mut Tracker<
            ANCHORS,
            SURFACES,
            SOURCES,
            SEGMENTS,
            PATHS,
            ACTIONS,
            COMPONENTS,
            POINTS,
            CANDIDATES,
            FRAMES,
        >,
    ) -> Result<(), Error> {
        tracker.start(&self.config, &self.anchors, &self.told(), &self.actions, self.seed)?;
        for (anchor, [mean_m, std_m]) in self.range_biases_m.iter().enumerate() {
            tracker.tell_range_bias(anchor, *mean_m, *std_m)?;
        }
        Ok(())
    }

    /// Starts a tracker that was made where the stack has room for it.
    fn build<const A: usize, const S: usize, const C: usize, const P: usize>(
        &self,
    ) -> Result<Box<AnyTracker<A, S, C, P>>, Error> {
        let build = || {
            let mut tracker = Box::new(Tracker::new());
            self.start(&mut tracker)?;
            Ok(tracker)
        };
        std::thread::scope(|scope| {
            let builder = std::thread::Builder::new().stack_size(BUILDING_STACK_BYTES);
            match builder.spawn_scoped(scope, build) {
                Ok(thread) => thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)),
                Err(_) => build(),
            }
        })
    }
}

/// The core's limits on an anchor's place.
fn is_out_of_reach(anchor: &Anchor) -> bool {
    anchor.position_m.iter().any(|x| x.abs() > 1e4) || anchor.height_m.abs() > 1e3
}

/// The first anchor whose own bias is beyond what the core takes.
fn refused_bias(recording: &Recording, folder: &std::path::Path) -> Option<InputError> {
    recording.anchors.iter().enumerate().find_map(|(index, anchor)| {
        // As single numbers, as the core has them.
        let is_beyond = |value: Option<f64>, least: f32| {
            value.is_some_and(|value| !(least..=10.0).contains(&(value as f32)))
        };
        let (key, allowed) = if is_beyond(anchor.range_bias_mean_m, -10.0) {
            ("range_bias_mean_m", "-10 to 10")
        } else if is_beyond(anchor.range_bias_std_m, 0.0) {
            ("range_bias_std_m", "0 to 10")
        } else {
            return None;
        };
        let reason = format!("of anchor {:?} is beyond what the tracker takes", anchor.name);
        let error = InputError::new(folder.join(META_FILE), reason);
        Some(error.for_item(format!("anchors.{index}.{key}")).allowed(allowed))
    })
}

/// What the core refused, in the recording's terms: file, key and what the tracker takes.
fn refusal(error: Error, folder: &std::path::Path, anchors_out_of_reach: bool) -> InputError {
    let beyond = "is beyond what the tracker takes";
    let (file, item, allowed) = match error {
        Error::Configuration(setting) => match setting {
            Setting::AccelerationDensity => {
                let item = "motion.acceleration_density_m2_s3 or motion.acceleration_std_m_s2";
                (META_FILE, item, "a density of 1e-12 to 1e4 m^2/s^3")
            }
            Setting::VelocityDecay => (META_FILE, "motion.velocity_decay_s", "0.1 to inf"),
            Setting::StartPosition => (META_FILE, "start.position_m", "-1e4 to 1e4"),
            Setting::StartDeviation => {
                (META_FILE, "start.position_std_m or start.velocity_std_m_s", "1e-3 to 1e3")
            }
            Setting::DetectionProbability => (META_FILE, "association.detection_probability", "0.01 to 1"),
            Setting::ClutterPerAnchor => (META_FILE, "association.clutter_per_anchor", "0 to 100"),
            Setting::MaxRange => (META_FILE, "association.max_range_m", "1 to 1e4"),
            Setting::BiasPrior => {
                (META_FILE, "radio.range_bias_mean_m or radio.range_bias_std_m", "-10 to 10, and 0 to 10")
            }
            Setting::Lateness => (META_FILE, "radio.range_late_m", "0 to 100"),
            Setting::RangeFloor => (META_FILE, "radio.range_floor_pulses", "0 to 1"),
            Setting::SampleSpacing => (META_FILE, "radio.sample_spacing_s", "1e-11 to 1e-8"),
            Setting::SampleCount => (ARRAYS_FILE, "frame_samples or frame_magnitude", "16 to 4096 samples"),
            Setting::Carrier => (META_FILE, "actions.carrier_hz", "1e8 to 1e11"),
            Setting::PulseDuration => {
                (META_FILE, "actions.pulse_duration_s or radio.pulse_duration_s", "1e-10 to 1e-8")
            }
            _ => return InputError::new(folder.join(META_FILE), error.to_string()),
        },
        Error::Geometry { .. } if anchors_out_of_reach => {
            (META_FILE, "anchors", "positions within 1e4 m, heights within 1e3 m")
        }
        Error::Geometry { .. } => {
            (META_FILE, "virtual_anchors", "positions within 1e4 m, deviations 1e-4 to 100 m")
        }
        _ => return InputError::new(folder.join(META_FILE), error.to_string()),
    };
    InputError::new(folder.join(file), beyond).for_item(item).allowed(allowed)
}

fn single([x, y]: [f64; 2]) -> [f32; 2] {
    [x as f32, y as f32]
}

/// The first position of a run: drawn with a seed, else the prior's mean.
pub(crate) fn drawn_start(start: &recording::Start, seed: Option<u64>) -> [f64; 2] {
    let Some(seed) = seed else { return start.position_m };
    let [x, y] = start.drawn_about_m.unwrap_or(start.position_m);
    let mut rng = Xoshiro128PlusPlus::seed_from_u64(seed);
    let mut uniform = || (f64::from(rng.next_u32()) + 0.5) / 4_294_967_296.0;
    let (a, b) = (uniform(), uniform());
    let angle = std::f64::consts::TAU * a;
    let radius = match start.disc_radius_m {
        Some(disc) => disc * b.sqrt(),
        None => start.position_std_m * (-2.0 * b.ln()).sqrt(),
    };
    [x + radius * angle.cos(), y + radius * angle.sin()]
}

/// What the pulse of a recording looks like behind the matched filter.
pub fn pulse_shape(radio: &recording::Radio) -> PulseShape {
    match &radio.sampled_pulse {
        None => PulseShape::RootRaisedCosine { roll_off: radio.roll_off as f32 },
        Some(pulse) => PulseShape::Sampled {
            step_s: pulse.step_s as f32,
            autocorrelation: std::array::from_fn(|lag| {
                pulse.autocorrelation.get(lag).map_or(0.0, |r| *r as f32)
            }),
        },
    }
}

/// One cycle of a recording in the core's terms; borrows the samples.
#[derive(Clone, Debug)]
pub struct CycleInput<'a> {
    ranges: Vec<(usize, Vec<Range>)>,
    frames: Vec<Frame<'a>>,
    /// Time since the previous cycle, seconds.
    pub elapsed_s: f32,
    /// Height of the tag, where the recording knows it.
    pub tag_height: Option<TagHeight>,
    /// Where the antenna in use is on the body of the tag: ahead of its centre and to its left, metres.
    pub lever_arm_m: [f32; 2],
}

impl CycleInput<'_> {
    /// The lever arm as a tracker of this configuration is told: none where it estimates no heading.
    pub fn arm_m(&self, config: &Config) -> [f32; 2] {
        if config.has_heading { self.lever_arm_m } else { [0.0; 2] }
    }

    /// What the tracker gets: frames, then ranges, by anchor.
    pub fn observations(&self) -> Vec<Observation<'_>> {
        let frames = self.frames.iter().copied().map(Observation::Frame);
        let ranges = self
            .ranges
            .iter()
            .map(|(anchor, ranges)| Observation::Ranges(RangeScan { anchor: *anchor, ranges }));
        frames.chain(ranges).collect()
    }
}

/// The cycles of a recording in order.
pub fn inputs(recording: &Recording) -> impl Iterator<Item = CycleInput<'_>> {
    let mut previous_s = None;
    recording.cycles.iter().map(move |cycle| input(recording, cycle, previous_s.replace(cycle.time_s)))
}

/// One cycle in the core's terms; `recording` says what it means, `previous_s` is the time of the cycle before it.
pub fn input<'a>(
    recording: &Recording,
    cycle: &'a recording::Cycle,
    previous_s: Option<f64>,
) -> CycleInput<'a> {
    let elapsed_s = previous_s.map_or(BEFORE_FIRST_CYCLE_S, |then| (cycle.time_s - then) as f32);
    let elapsed_s = elapsed_s.clamp(SHORTEST_STEP_S, LONGEST_GAP_S);
    let mut ranges: Vec<(usize, Vec<Range>)> = Vec::new();
    for range in &cycle.ranges {
        if !(range.range_m > 0.0 && range.range_m <= recording.association.max_range_m) {
            // No path has this length: the radio's mistake should not cost the cycle.
            continue;
        }
        let std_m = range.std_m.unwrap_or(recording.radio.range_std_m);
        let range_m = range.range_m as f32;
        let entry = Range { range_m, variance_m2: (std_m * std_m).clamp(1e-6, 1e4) as f32 };
        match ranges.iter_mut().find(|(anchor, _)| *anchor == range.anchor) {
            Some((_, list)) => list.push(entry),
            None => ranges.push((range.anchor, vec![entry])),
        }
    }
    let frames = cycle
        .frames
        .iter()
        .map(|frame| Frame {
            anchor: frame.anchor,
            action: frame.action,
            sequence: None,
            first_sample_delay_s: frame.first_sample_delay_s as f32,
            samples: match &frame.samples {
                recording::Samples::Complex(samples) => Samples::Complex(samples),
                recording::Samples::Magnitude(samples) => Samples::Magnitude(samples),
            },
        })
        .collect();
    let antenna = cycle.antenna.and_then(|antenna| recording.antennas.get(antenna));
    let lever_arm_m =
        antenna.and_then(|antenna| antenna.lever_arm_m).unwrap_or([0.0; 2]).map(|arm_m| arm_m as f32);
    CycleInput {
        ranges,
        frames,
        elapsed_s,
        lever_arm_m,
        tag_height: cycle.tag_height_m.filter(|height_m| height_m.abs() <= HIGHEST_TAG_M).map(|height_m| {
            TagHeight { mean_m: height_m as f32, std_m: cycle.tag_height_std_m.unwrap_or(0.0) as f32 }
        }),
    }
}

/// What a replayed cycle gave.
#[derive(Clone, Debug)]
pub struct Step {
    /// The core's report.
    pub report: CycleReport,
    /// Hash over all state after the cycle.
    pub hash: u64,
    /// Time the core took, seconds.
    pub seconds: f64,
    /// Why the cycle's observations were refused, if they were; the core then only predicted.
    pub refused: Option<Error>,
}

/// Runs one cycle; observations that the core refuses are left out, so that time goes on.
///
/// The observer is a trait object: the compiler then makes the whole tracker once for each capacity, not once for each
/// observer too.
///
/// # Errors
/// The core refuses even the empty cycle: its time or height is wrong.
pub fn step<const A: usize, const S: usize, const C: usize, const P: usize>(
    tracker: &mut AnyTracker<A, S, C, P>,
    input: &CycleInput<'_>,
    mut observer: &mut dyn Observer<SOURCES, PATHS>,
) -> Result<Step, Error> {
    let observations = input.observations();
    tracker.switch_antenna(input.arm_m(tracker.config()))?;
    let begin = std::time::Instant::now();
    let mut refused = None;
    let mut outcome = tracker.cycle_observed(&observations, input.elapsed_s, input.tag_height, &mut observer);
    if let Err(error) = outcome {
        refused = Some(error);
        outcome = tracker.cycle_observed(&[], input.elapsed_s, input.tag_height, &mut observer);
    }
    let seconds = begin.elapsed().as_secs_f64();
    Ok(Step { report: outcome?, hash: tracker.hash(), seconds, refused })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::demo;
    use crate::experiment::tracking::slam_ranges::SlamRanges;
    use std::path::Path;

    /// Of a run: the most virtual anchors that filter and map held after a cycle, and the count of what nothing explained at
    /// the end, by anchor.
    fn most_held(setup: &Setup, recording: &Recording) -> (usize, Vec<f32>) {
        let mut tracker = setup.tracker::<SMALL_ANCHORS>().expect("it starts");
        let held = |tracker: &SmallTracker| {
            let filtered = (0..SURFACES).filter(|slot| tracker.filter().surface(*slot).is_some()).count();
            filtered.max(tracker.environment().iter().count())
        };
        let mut most = held(&tracker);
        for input in inputs(recording) {
            step(&mut tracker, &input, &mut ()).expect("it runs");
            most = most.max(held(&tracker));
        }
        (most, tracker.unexplained().to_vec())
    }

    #[test]
    fn without_reflections_no_virtual_anchor_is_ever_in_the_filter_and_they_count_as_clutter() {
        let room = demo::seminar_room(1, 40).expect("it is made");
        let told = demo::run(&room, true, 1, || {}).expect("it runs").recording;
        let untold = SlamRanges::default().record(1);
        for recording in [&told, &untold] {
            let setup = Setup::new(recording, Path::new("r"), Some(1)).expect("is taken");
            let (with, _) = most_held(&setup, recording);
            assert!(with > 0, "{} has reflections to be left out", recording.name);
            let direct = setup.with_variant(TrackerVariant::Direct, Path::new("r")).expect("needs no plan");
            let (without, unexplained) = most_held(&direct, recording);
            assert_eq!(without, 0, "{}", recording.name);
            // Each anchor delivers more than false alarms, of which the recordings have one a scan at most.
            let clutter = direct.config.association.clutter_per_anchor;
            assert!(unexplained.iter().all(|count| *count > 1.5 * clutter), "{unexplained:?}");
        }
    }
}
