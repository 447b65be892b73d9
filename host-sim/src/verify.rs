//! The core against the float reference, number by number.
//!
//! Both run over the same recording. After every cycle each number the core computed on its way or keeps is compared
//! with the reference's, bit for bit; the first that differs is named. Along runs the reference in `f64`: how far its
//! position is from the core's is what `f32` costs. Rounding can also tip a decision (which measurement is whose, what
//! is in the map, which action comes next); from there on the two runs legitimately part, so the errors before are
//! told apart.

use crate::input_error::InputError;
use crate::recording::Recording;
use crate::reference::controller::Controller;
use crate::reference::cycle::Intermediates;
use crate::reference::{Capacity, Reference};
use crate::replay::{
    ACTIONS, COMPONENTS, LARGE_ANCHORS, PATHS, POINTS, SEGMENTS, SMALL_ANCHORS, SOURCES, SURFACES, Setup,
    SizedTracker, Step, inputs, step,
};
use cogmint_core::model::image::Sequence;
use cogmint_core::model::measurement::Measurement;
use cogmint_core::observer::Observer;
use cogmint_core::perceptor::association::{Belief, Beliefs};
use cogmint_core::perceptor::channel_estimator::ChannelEstimate;
use cogmint_core::perceptor::expectation::Sighting;
use cogmint_core::trace::TraceHash;
use serde::Serialize;
use std::fmt;
use std::path::Path;

/// The outcome of a verification.
#[derive(Clone, Debug, Serialize)]
pub struct Verification {
    /// Cycles compared, the one with the first difference included.
    pub cycles: usize,
    /// Numbers compared.
    pub compared: u64,
    /// Whether all had equal bits.
    pub equal: bool,
    /// The first number that did not; the comparison ends with its cycle.
    pub first_difference: Option<Difference>,
    /// How many of the core's numbers were NaN or infinite: none ever should be.
    pub not_finite: u64,
    /// What happened in the cycles compared.
    pub covered: Coverage,
    /// Largest distance between the core's position and that of the reference in `f64`, metres.
    pub f64_position_error_max_m: f64,
    /// Root mean square of that distance, metres.
    pub f64_position_error_rms_m: f64,
    /// Where the `f64` reference first decided otherwise than the `f32` reference.
    pub f64_first_decision_difference: Option<DecisionDifference>,
    /// Largest distance in the cycles before that, metres.
    pub f64_position_error_before_max_m: f64,
    /// Root mean square of the distance in the cycles before that, metres.
    pub f64_position_error_before_rms_m: f64,
    /// How the largest distance grew.
    pub f64_growth: Vec<Growth>,
}

/// A number of which core and reference disagree.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Difference {
    /// The cycle, counted from 0.
    pub cycle: usize,
    /// The stage that computes it.
    pub stage: &'static str,
    /// Its name.
    pub quantity: String,
    /// What the core computed.
    pub core: Number,
    /// What the reference computed.
    pub reference: Number,
}

/// A number and its bits.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Number {
    /// The value.
    pub value: f64,
    /// Its bits, in hexadecimal; those of a count are the count.
    pub bits: String,
}

/// What a verification has been through.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Coverage {
    /// Frames estimated.
    pub frames: u64,
    /// Paths found in them.
    pub paths: u64,
    /// Measurements (ranges and paths) associated or not.
    pub measurements: u64,
    /// Measurements left out because a scan had too many.
    pub left_out: u64,
    /// Components of the belief that counted and found no room.
    pub crowded_out: u64,
    /// Virtual anchors discovered.
    pub discovered: u64,
    /// Virtual anchors forgotten.
    pub forgotten: u64,
    /// Images joined to a surface of others.
    pub joined: u64,
    /// Discoveries dropped because the map was full.
    pub map_full: u64,
    /// Cycles after which it was not known yet where the tag is.
    pub searching: u64,
    /// Cycles after which a lost tag was sought with another action than the one held.
    pub sought_elsewhere: u64,
    /// Changes of action.
    pub action_changes: u64,
    /// Cycles whose observations the core refused.
    pub refused_cycles: u64,
}

/// A decision that rounding tipped.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct DecisionDifference {
    /// The cycle, counted from 0.
    pub cycle: usize,
    /// What was decided.
    pub decision: String,
}

/// Largest position error against `f64` up to some cycle.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Growth {
    /// Cycles run.
    pub cycles: usize,
    /// Largest distance in them, metres.
    pub error_max_m: f64,
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { cycle, stage, quantity, core, reference } = self;
        write!(
            f,
            "cycle {cycle}, {stage}: {quantity} is {} ({}) in the core, {} ({}) in the reference",
            core.value, core.bits, reference.value, reference.bits
        )
    }
}

/// Compares core and reference over a recording, or its first `max_cycles`. `on_progress` is told the number of cycles
/// done. For `seed`, see [`Setup::new`].
///
/// # Errors
/// The core refuses the recording's set-up, or a cycle's time or height.
pub fn verify(
    recording: &Recording,
    file: &Path,
    seed: Option<u64>,
    max_cycles: Option<usize>,
    on_progress: impl FnMut(usize),
) -> Result<Verification, InputError> {
    let setup = Setup::new(recording, file, seed)?;
    verify_setup(&setup, recording, file, max_cycles, on_progress)
}

/// [`verify`] with a set-up of one's own.
///
/// # Errors
/// The core refuses the set-up, or a cycle's time or height.
pub fn verify_setup(
    setup: &Setup,
    recording: &Recording,
    file: &Path,
    max_cycles: Option<usize>,
    mut on_progress: impl FnMut(usize),
) -> Result<Verification, InputError> {
    let most = max_cycles.unwrap_or(usize::MAX);
    compare([setup, setup], [recording, recording], file, most, &mut on_progress)
}

/// The core runs with the first set-up on the first recording, the reference with the second on the second. Not generic: compiled here once, not again in
/// every crate that calls it.
fn compare(
    setups: [&Setup; 2],
    recordings: [&Recording; 2],
    file: &Path,
    most: usize,
    on_progress: &mut dyn FnMut(usize),
) -> Result<Verification, InputError> {
    if setups[0].anchors.len() <= SMALL_ANCHORS {
        run::<SMALL_ANCHORS>(setups, recordings, file, most, on_progress)
    } else {
        run::<LARGE_ANCHORS>(setups, recordings, file, most, on_progress)
    }
}

fn run<const A: usize>(
    [setup, setup_of_reference]: [&Setup; 2],
    [for_core, for_reference]: [&Recording; 2],
    file: &Path,
    most: usize,
    on_progress: &mut dyn FnMut(usize),
) -> Result<Verification, InputError> {
    let mut tracker = setup.tracker::<A>().map_err(|error| InputError::new(file, error.to_string()))?;
    let mut single: Reference<f32> = twin::<f32, A>(setup_of_reference);
    let mut double: Reference<f64> = twin::<f64, A>(setup_of_reference);
    let mut comparison = Comparison::default();
    let mut errors = ErrorGrowth::default();
    let mut covered = Coverage::default();
    let pairs = inputs(for_core).zip(inputs(for_reference)).take(most);
    for (cycle, (core_input, reference_input)) in pairs.enumerate() {
        comparison.cycle = cycle;
        let mut watch = Watch::default();
        let taken = step(&mut tracker, &core_input, &mut watch)
            .map_err(|error| InputError::new(file, format!("cycle {cycle} is refused: {error}")))?;
        // The reference knows no refusal: it sees what the core accepted.
        let mut observations = reference_input.observations();
        if taken.refused.is_some() {
            observations.clear();
        }
        let (elapsed_s, height) = (reference_input.elapsed_s, reference_input.tag_height);
        let arm_m = reference_input.arm_m(&setup_of_reference.config);
        (single.lever_arm_m, double.lever_arm_m) = (arm_m, arm_m);
        let ours = single.cycle(&observations, elapsed_s, height);
        let precise = double.cycle(&observations, elapsed_s, height);

        comparison.intermediates(&watch, &ours);
        comparison.state(&tracker, &single);
        comparison.report(&taken, &ours);
        comparison.hash("hash of all state", taken.hash, state_hash(&single));

        covered.add(&taken, &watch);
        covered.searching += u64::from(tracker.belief().is_searching());
        let sought_with = tracker.controller_of(0).and_then(|controller| controller.sought_with());
        covered.sought_elsewhere += u64::from(sought_with.is_some());
        let decided = decision_difference(&single, &ours, &double, &precise);
        errors.add(cycle, distance(taken.report.position_m, precise.report.position_m), decided);
        on_progress(cycle + 1);
        if comparison.first.is_some() {
            break;
        }
    }
    Ok(Verification {
        cycles: errors.all.count,
        compared: comparison.compared,
        equal: comparison.first.is_none(),
        first_difference: comparison.first,
        not_finite: comparison.not_finite,
        covered,
        f64_position_error_max_m: errors.all.max,
        f64_position_error_rms_m: errors.all.rms(),
        f64_position_error_before_max_m: errors.before.max,
        f64_position_error_before_rms_m: errors.before.rms(),
        f64_growth: errors.growth(),
        f64_first_decision_difference: errors.first,
    })
}

/// The reference of a set-up, with the sizes of the core's type.
fn twin<T: crate::reference::Real, const A: usize>(setup: &Setup) -> Reference<T> {
    let capacity = Capacity {
        anchors: A,
        surfaces: SURFACES,
        sources: SOURCES,
        segments: SEGMENTS,
        paths: PATHS,
        actions: ACTIONS,
        components: COMPONENTS,
        points: POINTS,
    };
    let mut twin =
        Reference::new(setup.config, &setup.anchors, &setup.told(), &setup.actions, setup.seed, capacity);
    for (anchor, [mean_m, std_m]) in setup.range_biases_m.iter().enumerate() {
        twin.tell_range_bias(anchor, *mean_m, *std_m);
    }
    twin
}

fn distance(a: [f32; 2], b: [f64; 2]) -> f64 {
    (f64::from(a[0]) - b[0]).hypot(f64::from(a[1]) - b[1])
}

/// What the core let be seen of a cycle.
#[derive(Default)]
struct Watch {
    estimates: Vec<(usize, ChannelEstimate<PATHS>)>,
    scans: Vec<(usize, Vec<Measurement>, Beliefs<SOURCES, PATHS>)>,
}

impl Observer<SOURCES, PATHS> for Watch {
    fn estimate(&mut self, anchor: usize, estimate: &ChannelEstimate<PATHS>) {
        self.estimates.push((anchor, estimate.clone()));
    }

    fn beliefs(&mut self, anchor: usize, measurements: &[Measurement], beliefs: &Beliefs<SOURCES, PATHS>) {
        self.scans.push((anchor, measurements.to_vec(), beliefs.clone()));
    }
}

/// Compares numbers and keeps the first difference.
#[derive(Default)]
struct Comparison {
    cycle: usize,
    compared: u64,
    not_finite: u64,
    first: Option<Difference>,
}

impl Comparison {
    fn float(&mut self, stage: &'static str, quantity: fmt::Arguments<'_>, core: f32, reference: f32) {
        self.not_finite += u64::from(!core.is_finite());
        let number = |x: f32| Number { value: f64::from(x), bits: format!("{:#010x}", x.to_bits()) };
        let equal = core.to_bits() == reference.to_bits();
        self.note(equal, stage, quantity, || [number(core), number(reference)]);
    }

    fn count(
        &mut self,
        stage: &'static str,
        quantity: fmt::Arguments<'_>,
        core: impl TryInto<u64>,
        reference: impl TryInto<u64>,
    ) {
        let [core, reference] =
            [core.try_into().unwrap_or(u64::MAX), reference.try_into().unwrap_or(u64::MAX)];
        let number = |x: u64| Number { value: x as f64, bits: format!("{x:#010x}") };
        self.note(core == reference, stage, quantity, || [number(core), number(reference)]);
    }

    fn hash(&mut self, quantity: &str, core: u64, reference: u64) {
        let number = |x: u64| Number { value: x as f64, bits: format!("{x:#018x}") };
        let numbers = || [number(core), number(reference)];
        self.note(core == reference, "done", format_args!("{quantity}"), numbers);
    }

    fn note(
        &mut self,
        equal: bool,
        stage: &'static str,
        quantity: fmt::Arguments<'_>,
        numbers: impl FnOnce() -> [Number; 2],
    ) {
        self.compared += 1;
        if !equal && self.first.is_none() {
            let [core, reference] = numbers();
            let quantity = quantity.to_string();
            self.first = Some(Difference { cycle: self.cycle, stage, quantity, core, reference });
        }
    }

    /// The core's numbers against the reference's, named, in the same order.
    fn list(
        &mut self,
        stage: &'static str,
        what: &str,
        core: &[f32],
        visit: impl FnOnce(&mut dyn FnMut(fmt::Arguments<'_>, f32)),
    ) {
        let mut at = 0;
        visit(&mut |quantity, reference| {
            if let Some(value) = core.get(at) {
                self.float(stage, quantity, *value, reference);
            }
            at += 1;
        });
        self.count(stage, format_args!("number of numbers in {what}"), core.len(), at);
    }

    /// Paths, noise, measurements and beliefs.
    fn intermediates(&mut self, core: &Watch, reference: &Intermediates<f32>) {
        let stage = "estimate";
        self.count(stage, format_args!("number of frames"), core.estimates.len(), reference.estimates.len());
        for ((anchor, ours), (same, theirs)) in core.estimates.iter().zip(&reference.estimates) {
            self.count(stage, format_args!("anchor of a frame"), *anchor, *same);
            self.count(
                stage,
                format_args!("number of paths of anchor {anchor}"),
                ours.paths.len(),
                theirs.paths.len(),
            );
            let mut float =
                |name: fmt::Arguments<'_>, core, reference| self.float(stage, name, core, reference);
            float(format_args!("white noise of anchor {anchor}"), ours.noise.white, theirs.noise.white);
            for position in [0.0, 57.3, 1e4] {
                float(
                    format_args!("noise level {position} samples into the frame of anchor {anchor}"),
                    ours.noise.level(position, 1e-9),
                    theirs.noise.at(position, 1e-9),
                );
            }
            for (what, a, b) in [
                ("power", ours.dense.power, theirs.dense.power),
                ("mean delay", ours.dense.mean_delay_s, theirs.dense.mean_delay_s),
                ("delay spread", ours.dense.rms_delay_spread_s, theirs.dense.rms_delay_spread_s),
            ] {
                float(format_args!("{what} of the dense multipath of anchor {anchor}"), a, b);
            }
            for (k, (a, b)) in ours.paths.iter().zip(&theirs.paths).enumerate() {
                float(format_args!("delay of path {k} of anchor {anchor}"), a.delay_s, b.delay_s);
                for (part, name) in ["real", "imaginary"].into_iter().enumerate() {
                    float(
                        format_args!("{name} part of path {k} of anchor {anchor}"),
                        a.amplitude[part],
                        b.amplitude[part],
                    );
                }
                float(format_args!("SINR of path {k} of anchor {anchor}"), a.sinr, b.sinr);
                float(
                    format_args!("delay variance of path {k} of anchor {anchor}"),
                    a.delay_variance_s2,
                    b.delay_variance_s2,
                );
            }
        }
        let stage = "associate";
        self.count(stage, format_args!("number of anchors heard"), core.scans.len(), reference.heard.len());
        for ((anchor, measurements, beliefs), theirs) in core.scans.iter().zip(&reference.heard) {
            self.count(stage, format_args!("anchor heard"), *anchor, theirs.scan.anchor);
            self.measurements(*anchor, measurements, &theirs.scan.measurements);
            self.beliefs(*anchor, beliefs, theirs);
        }
    }

    fn measurements(
        &mut self,
        anchor: usize,
        core: &[Measurement],
        reference: &[crate::reference::association::Measurement<f32>],
    ) {
        let stage = "associate";
        self.count(
            stage,
            format_args!("number of measurements of anchor {anchor}"),
            core.len(),
            reference.len(),
        );
        for (m, (a, b)) in core.iter().zip(reference).enumerate() {
            let numbers = [
                ("range", a.range_m, b.range_m),
                ("variance", a.variance_m2, b.variance_m2),
                ("SINR", a.sinr, b.sinr),
                ("energy", a.energy, b.energy),
                ("density of false alarms", a.false_alarm, b.false_alarm),
            ];
            for (name, a, b) in numbers {
                self.float(stage, format_args!("{name} of measurement {m} of anchor {anchor}"), a, b);
            }
        }
    }

    fn beliefs(
        &mut self,
        anchor: usize,
        core: &Beliefs<SOURCES, PATHS>,
        reference: &crate::reference::association::outcome::Outcome<f32>,
    ) {
        use cogmint_core::model::source::Source;
        let stage = "associate";
        let theirs = &reference.beliefs;
        let features: Vec<&Belief<PATHS>> = core.features().collect();
        self.count(
            stage,
            format_args!("number of features of anchor {anchor}"),
            features.len(),
            theirs.features.len(),
        );
        self.count(stage, format_args!("iterations of anchor {anchor}"), core.iterations, theirs.iterations);
        let sources = reference.expected.iter().map(|expected| expected.regression.source);
        for ((a, b), source) in features.into_iter().zip(&theirs.features).zip(sources) {
            let name = match source {
                Source::Direct { anchor } => format!("direct path of anchor {anchor}"),
                Source::Virtual { slot, .. } => format!("source {slot}"),
            };
            self.float(stage, format_args!("belief that {name} was missed"), a.missed, b.missed);
            self.float(stage, format_args!("existence of {name}"), a.existence, b.existence);
            self.float(stage, format_args!("what the rest of the frame says of {name}"), a.rest, b.rest);
            for (m, (p, q)) in a.associated.iter().zip(&b.associated).enumerate() {
                self.float(stage, format_args!("belief that {name} gave measurement {m}"), *p, *q);
            }
        }
        for (m, (p, q)) in core.unassociated.iter().zip(&theirs.unassociated).enumerate() {
            let quantity = format_args!("belief that nothing known gave measurement {m} of anchor {anchor}");
            self.float(stage, quantity, *p, *q);
        }
    }

    /// All state after a cycle.
    fn state<const A: usize>(&mut self, core: &SizedTracker<A>, reference: &Reference<f32>) {
        let mut numbers = Vec::new();
        core.gain_control().iter().for_each(|control| control.visit(|value| numbers.push(value)));
        self.list("estimate", "gain control", &numbers, |f| visit_gain_control(reference, f));
        numbers.clear();
        core.belief().visit(|value| numbers.push(value));
        self.list("update", "the belief", &numbers, |f| reference.belief.visit(f));

        let stage = "remember";
        for slot in 0..SURFACES {
            let (ours, theirs) = (core.environment().surface(slot), &reference.environment.surfaces[slot]);
            let name = format_args!("presence of surface {slot}");
            self.count(stage, name, u64::from(ours.is_some()), u64::from(theirs.is_some()));
            if let (Some(a), Some(b)) = (ours, theirs) {
                self.float(stage, format_args!("existence of surface {slot}"), a.existence, b.existence);
                let name = format_args!("whether a plan tells of surface {slot}");
                self.count(stage, name, u64::from(a.is_told), u64::from(b.is_told));
                let name = format_args!("whether surface {slot} may be joined");
                self.count(stage, name, u64::from(a.may_join), u64::from(b.may_join));
            }
        }
        for slot in 0..SOURCES {
            let (ours, theirs) = (core.environment().get(slot), &reference.environment.sources[slot]);
            let name = format_args!("presence of source {slot}");
            self.count(stage, name, u64::from(ours.is_some()), u64::from(theirs.is_some()));
            if let (Some(a), Some(b)) = (ours, theirs) {
                self.count(stage, format_args!("anchor of source {slot}"), a.anchor, b.anchor);
                for (name, a, b) in [
                    ("first surface", u32::from(a.sequence.first), u32::from(b.sequence.first)),
                    ("second surface", second_or_none(&a.sequence), second_or_none(&b.sequence)),
                    (
                        "either order",
                        u32::from(a.sequence.is_either_order),
                        u32::from(b.sequence.is_either_order),
                    ),
                    ("sighting", is_hidden(a.sighting), is_hidden(b.sighting)),
                    ("hits", a.hits, b.hits),
                ] {
                    self.count(stage, format_args!("{name} of source {slot}"), a, b);
                }
            }
        }
        numbers.clear();
        core.transmission().visit(core.plan().walls().len(), |value| numbers.push(value));
        self.list(stage, "the transmission memory", &numbers, |f| reference.transmission.visit(f));
        numbers.clear();
        core.channel().visit(|value| numbers.push(value));
        self.list(stage, "the channel memory", &numbers, |f| reference.channel.visit(f));
        for (anchor, (a, b)) in core.unexplained().iter().zip(&reference.clutter.unexplained).enumerate() {
            self.float(stage, format_args!("mean of unexplained measurements of anchor {anchor}"), *a, *b);
        }
        numbers.clear();
        core.lateness().visit(|value| numbers.push(value));
        self.list(stage, "the lateness memory", &numbers, |f| reference.lateness.visit(f));
        for (anchor, (a, b)) in core.backgrounds().iter().zip(&reference.clutter.backgrounds).enumerate() {
            let name = format_args!("share of noise in the rest of the frames of anchor {anchor}");
            self.float(stage, name, a.noise, b.noise);
            for (class, (a, b)) in a.paths.iter().zip(&b.paths).enumerate() {
                let name = format_args!("share of paths of class {class} in those of anchor {anchor}");
                self.float(stage, name, *a, *b);
            }
        }

        let stage = "discover";
        for anchor in 0..A {
            self.count(
                stage,
                format_args!("number of candidates of anchor {anchor}"),
                core.discovery().candidates(anchor),
                reference.discovery.candidates(anchor),
            );
        }
        numbers.clear();
        core.discovery().visit(|value| numbers.push(value));
        self.list(stage, "the candidates", &numbers, |f| reference.discovery.visit(f));

        let stage = "act";
        let names = [
            "action held",
            "action chosen",
            "present action",
            "action announced",
            "cycles without a frame",
            "cycles lost",
            "action sought with",
        ];
        for (index, theirs) in reference.controllers.all.iter().enumerate() {
            let Some(ours) = core.controller_of(index) else { continue };
            for (action, (a, b)) in ours.values().values().iter().zip(&theirs.values).enumerate() {
                self.float(stage, format_args!("value {index} of action {action}"), *a, *b);
            }
            for (action, (a, b)) in ours.policy().iter().zip(&theirs.policy).enumerate() {
                self.float(stage, format_args!("policy {index} of action {action}"), *a, *b);
            }
            for ((name, a), b) in names.iter().zip(ours.words()).zip(theirs.words()) {
                self.count(stage, format_args!("{name} ({index})"), a, b);
            }
        }
    }

    fn report(&mut self, core: &Step, reference: &Intermediates<f32>) {
        let (a, b) = (&core.report, &reference.report);
        let stage = "report";
        let (c, d) = (&a.position_covariance_m2, &b.position_covariance_m2);
        let floats = [
            ("position x", a.position_m[0], b.position_m[0]),
            ("position y", a.position_m[1], b.position_m[1]),
            ("position covariance xx", c.m11, d[0][0]),
            ("position covariance xy", c.m12, d[0][1]),
            ("position covariance yx", c.m21, d[1][0]),
            ("position covariance yy", c.m22, d[1][1]),
            ("probability", a.probability, b.probability),
            ("predicted entropy", a.predicted_entropy_nat, b.predicted_entropy_nat),
            ("entropy", a.entropy_nat, b.entropy_nat),
            ("reward", a.reward, b.reward),
            ("normalised innovation", a.nis, b.nis),
            ("next carrier", a.next.carrier_hz, b.next.carrier_hz),
            ("next pulse duration", a.next.pulse_duration_s, b.next.pulse_duration_s),
        ];
        for (name, a, b) in floats {
            self.float(stage, format_args!("{name}"), a, b);
        }
        let counts = [
            ("cycle", a.cycle, b.cycle),
            ("anchors heard", a.anchors_heard, b.anchors_heard),
            ("measurements", a.measurements, b.measurements),
            ("left out", a.left_out, b.left_out),
            ("cut short", a.cut_short, b.cut_short),
            ("crowded out", a.crowded_out, b.crowded_out),
            ("associated", a.associated, b.associated),
            ("searching", u32::from(a.searching), u32::from(b.searching)),
            ("lost", u32::from(a.lost), u32::from(b.lost)),
            ("discovered", a.discovered, b.discovered),
            ("forgotten", a.forgotten, b.forgotten),
            ("joined", a.joined, b.joined),
            ("map full", a.map_full, b.map_full),
        ];
        for (name, a, b) in counts {
            self.count(stage, format_args!("{name}"), a, b);
        }
        self.count(stage, format_args!("action"), a.action, b.action);
        self.count(stage, format_args!("next action"), a.next_action, b.next_action);
    }
}

/// The second surface of a sequence, as the hash takes it.
fn second_or_none(sequence: &Sequence) -> u32 {
    sequence.second.map_or(u32::MAX, u32::from)
}

/// A sighting, as the hash takes it.
fn is_hidden(sighting: Sighting) -> u32 {
    u32::from(sighting == Sighting::Hidden)
}

fn visit_gain_control(reference: &Reference<f32>, f: &mut dyn FnMut(fmt::Arguments<'_>, f32)) {
    for (anchor, control) in reference.receiver.gain_control.iter().enumerate() {
        control.visit(anchor, f);
    }
}

/// The core's hash, over the reference's state: nothing kept escapes the comparison.
fn state_hash(reference: &Reference<f32>) -> u64 {
    let mut hash = TraceHash::default();
    hash.word(reference.cycle);
    reference.controllers.missing.iter().for_each(|lost| hash.word(*lost));
    // Nobody tells it the full band.
    hash.word(0);
    reference.controllers.all.iter().flat_map(Controller::words).for_each(|word| hash.word(word));
    visit_gain_control(reference, &mut |_, value| hash.float(value));
    for (slot, record) in reference.environment.in_use() {
        hash.word(slot as u32);
        hash.word(record.anchor as u32);
        hash.word(u32::from(record.sequence.first));
        hash.word(second_or_none(&record.sequence));
        hash.word(is_hidden(record.sighting));
        hash.word(record.hits);
    }
    for surface in &reference.environment.surfaces {
        hash.float(surface.map_or(-1.0, |record| record.existence));
    }
    hash.word(reference.environment.turn);
    reference.transmission.visit(&mut |_, value| hash.float(value));
    reference.channel.visit(&mut |_, value| hash.float(value));
    reference.discovery.visit(&mut |_, value| hash.float(value));
    reference.belief.visit(&mut |_, value| hash.float(value));
    for controller in &reference.controllers.all {
        controller.values.iter().chain(&controller.policy).for_each(|value| hash.float(*value));
        hash.float(controller.planned_reward.unwrap_or(0.0));
        hash.float(controller.turn_s);
    }
    reference.clutter.unexplained.iter().for_each(|value| hash.float(*value));
    for background in &reference.clutter.backgrounds {
        hash.float(background.noise);
        background.paths.iter().for_each(|value| hash.float(*value));
    }
    reference.lateness.visit(&mut |_, value| hash.float(value));
    reference.lever_arm_m.iter().for_each(|value| hash.float(*value));
    reference.receiver.silent_s.iter().flatten().for_each(|value| hash.float(*value));
    hash.float(reference.receiver.threshold);
    reference.last_heard.mean.iter().for_each(|value| hash.float(*value));
    // By column, as the core stores a matrix; symmetric.
    reference.last_heard.covariance.iter().flatten().for_each(|value| hash.float(*value));
    for last in &reference.receiver.last_sequence {
        hash.word(u32::from(last.is_some()));
        hash.word(last.unwrap_or(0));
    }
    hash.value()
}

/// The first discrete decision of a cycle on which the two precisions disagree.
fn decision_difference(
    single: &Reference<f32>,
    ours: &Intermediates<f32>,
    double: &Reference<f64>,
    precise: &Intermediates<f64>,
) -> Option<String> {
    for ((anchor, a), (_, b)) in ours.estimates.iter().zip(&precise.estimates) {
        if a.paths.len() != b.paths.len() {
            return Some(format!("number of paths of anchor {anchor}"));
        }
    }
    for (a, b) in ours.heard.iter().zip(&precise.heard) {
        let anchor = a.scan.anchor;
        if a.scan.measurements.len() != b.scan.measurements.len() {
            return Some(format!("number of measurements of anchor {anchor}"));
        }
        if a.beliefs.most_probable() != b.beliefs.most_probable() {
            return Some(format!("most probable association of anchor {anchor}"));
        }
    }
    if single.belief.components.len() != double.belief.components.len() {
        return Some("number of places the tag may be at".to_owned());
    }
    for anchor in 0..single.clutter.unexplained.len() {
        if single.discovery.candidates(anchor) != double.discovery.candidates(anchor) {
            return Some(format!("number of candidates of anchor {anchor}"));
        }
    }
    for slot in 0..SOURCES {
        let [a, b] = [
            single.environment.sources[slot].map(|record| (record.anchor, record.sequence)),
            double.environment.sources[slot].map(|record| (record.anchor, record.sequence)),
        ];
        if a != b {
            return Some(format!("source in slot {slot}"));
        }
    }
    let ours = single.controllers.all.iter().map(|controller| controller.action);
    let precise = double.controllers.all.iter().map(|controller| controller.action);
    (!ours.eq(precise)).then(|| "next action".to_owned())
}

impl Coverage {
    fn add(&mut self, taken: &Step, watch: &Watch) {
        let report = &taken.report;
        self.frames += watch.estimates.len() as u64;
        self.paths += watch.estimates.iter().map(|(_, estimate)| estimate.paths.len() as u64).sum::<u64>();
        self.measurements += u64::from(report.measurements);
        self.left_out += u64::from(report.left_out);
        self.crowded_out += u64::from(report.crowded_out);
        self.discovered += u64::from(report.discovered);
        self.forgotten += u64::from(report.forgotten);
        self.joined += u64::from(report.joined);
        self.map_full += u64::from(report.map_full);
        self.action_changes += u64::from(report.action != report.next_action);
        self.refused_cycles += u64::from(taken.refused.is_some());
    }
}

/// Maximum and root mean square.
#[derive(Clone, Copy, Default)]
struct Summary {
    count: usize,
    max: f64,
    squares: f64,
}

impl Summary {
    fn add(&mut self, error: f64) {
        self.count += 1;
        // A NaN stays.
        if !(error <= self.max) && !self.max.is_nan() {
            self.max = error;
        }
        self.squares += error * error;
    }

    fn rms(&self) -> f64 {
        (self.squares / self.count.max(1) as f64).sqrt()
    }
}

/// Errors against `f64`, over all cycles and over those before the first decision that differs.
#[derive(Default)]
struct ErrorGrowth {
    all: Summary,
    before: Summary,
    first: Option<DecisionDifference>,
    growth: Vec<Growth>,
}

impl ErrorGrowth {
    fn add(&mut self, cycle: usize, error: f64, decided: Option<String>) {
        if self.first.is_none() {
            self.first = decided.map(|decision| DecisionDifference { cycle, decision });
        }
        self.all.add(error);
        if self.first.is_none() {
            self.before.add(error);
        }
        if self.all.count.is_power_of_two() {
            self.growth.push(self.present());
        }
    }

    fn present(&self) -> Growth {
        Growth { cycles: self.all.count, error_max_m: self.all.max }
    }

    /// After 1, 2, 4, ... cycles, and at the end.
    fn growth(&self) -> Vec<Growth> {
        let mut growth = self.growth.clone();
        if growth.last().is_some_and(|last| last.cycles < self.all.count) {
            growth.push(self.present());
        }
        growth
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Wall;
    use crate::geometry::image_source::image_sources;
    use crate::geometry::visibility::trace_image;
    use crate::recording::{
        Action, Anchor, AssociationModel, Cycle, Frame, Motion, Plan, PlanWall, Radio, Range, Samples, Start,
        VirtualAnchor,
    };
    use crate::reference::joining::Constants;
    use crate::reference::pulse::Pulse;
    use cogmint_core::Variant;
    use cogmint_core::config::WorkLimits;
    use cogmint_core::controller::reward::Reward;
    use cogmint_core::model::channel::ChannelKnowledge as _;
    use cogmint_core::model::observation::LONGEST_SCAN;
    use cogmint_core::model::source::Source;
    use cogmint_core::perceptor::association::Mode;
    use cogmint_core::radio::pulse::PulseShape;
    use rand_core::{Rng, SeedableRng};
    use rand_xoshiro::Xoshiro128PlusPlus;

    const SPEED_OF_LIGHT_M_S: f64 = 299_792_458.0;
    const SPACING_S: f64 = 0.25e-9;
    /// Anchors, and images of them: the first two of each anchor stand from the start, the others are discovered.
    const ANCHORS: [[f64; 2]; 2] = [[0.5, 7.0], [5.2, 3.2]];
    const IMAGES: [(usize, [f64; 2]); 4] =
        [(0, [-2.5, 7.0]), (1, [8.8, 3.2]), (0, [0.5, 10.4]), (1, [5.2, -2.2])];

    /// What the anchors deliver.
    #[derive(Clone, Copy, PartialEq)]
    enum Kind {
        Ranges,
        Complex,
        Magnitude,
        /// Complex frames, and in every third cycle a range of the direct path beside them.
        Both,
    }

    fn noise(rng: &mut Xoshiro128PlusPlus) -> f64 {
        // Sum of four uniform numbers, of variance 1.
        let mut uniform = || f64::from(rng.next_u32()) / 4_294_967_296.0 - 0.5;
        (uniform() + uniform() + uniform() + uniform()) * 3.0_f64.sqrt()
    }

    fn recording(kind: Kind, cycles: usize, samples: usize) -> Recording {
        circle(kind, cycles, samples, 0.02)
    }

    /// A tag that turns by `turn` per cycle. Images vanish in the last third, so that what was found is forgotten.
    fn circle(kind: Kind, cycles: usize, samples: usize, turn: f64) -> Recording {
        let mut rng = Xoshiro128PlusPlus::seed_from_u64(5);
        let actions: Vec<Action> = (0..6)
            .map(|n| Action {
                carrier_hz: 6.0e9 + 0.35e9 * f64::from(n),
                pulse_duration_s: if n == 4 { 0.8e-9 } else { 0.5e-9 },
            })
            .collect();
        let mut recording = Recording {
            name: "made".into(),
            source: "made for a test".into(),
            motion: Motion::of_acceleration(0.1),
            start: Start {
                position_m: [4.0, 6.0],
                position_std_m: 0.2,
                velocity_std_m_s: 0.2,
                disc_radius_m: None,
                drawn_about_m: None,
            },
            association: AssociationModel {
                detection_probability: 0.95,
                clutter_per_anchor: 0.5,
                max_range_m: 15.0,
            },
            radio: Radio {
                pulse_duration_s: 0.5e-9,
                roll_off: 0.6,
                sampled_pulse: None,
                gain_control: false,
                begins_with_path: false,
                sample_spacing_s: Some(SPACING_S),
                range_std_m: 0.02,
                range_bias_mean_m: 0.0,
                range_bias_std_m: 0.0,
                range_late_m: 0.0,
                range_floor_pulses: Some(0.0),
            },
            anchors: ANCHORS
                .iter()
                .enumerate()
                .map(|(n, position)| Anchor::new(format!("{n}"), *position, 2.0))
                .collect(),
            virtual_anchors: IMAGES[..2]
                .iter()
                .map(|(anchor, position_m)| VirtualAnchor::new(*anchor, *position_m, 0.05, true))
                .collect(),
            actions,
            walls: Vec::new(),
            plan: None,
            antennas: Vec::new(),
            cycles: Vec::new(),
        };
        for n in 0..cycles {
            let angle = turn * n as f64;
            let position = [3.0 + angle.cos(), 6.0 + angle.sin()];
            let mut cycle = Cycle { time_s: 0.1 * n as f64, ..Cycle::default() };
            cycle.truth_position_m = Some(position);
            for (anchor, at) in ANCHORS.into_iter().enumerate() {
                let mut paths = vec![at];
                if n * 3 < cycles * 2 {
                    paths.extend(IMAGES.iter().filter(|(of, _)| *of == anchor).map(|(_, at)| *at));
                }
                let lengths: Vec<f64> =
                    paths.iter().map(|[x, y]| (position[0] - x).hypot(position[1] - y)).collect();
                if kind == Kind::Ranges || (kind == Kind::Both && n % 3 == 0) {
                    let count = if kind == Kind::Both { 1 } else { lengths.len() };
                    for length in &lengths[..count] {
                        let range_m = length + 0.02 * noise(&mut rng);
                        cycle.ranges.push(Range { anchor, range_m, std_m: None, angles: None });
                    }
                    if kind == Kind::Ranges && rng.next_u32() % 2 == 0 {
                        let range_m = 14.0 * f64::from(rng.next_u32()) / 4_294_967_296.0 + 0.5;
                        cycle.ranges.push(Range { anchor, range_m, std_m: Some(0.05), angles: None });
                    }
                }
                // One frame in nine is lost.
                if kind != Kind::Ranges && rng.next_u32() % 9 != 0 {
                    let action = (n * 5 + anchor) % 6;
                    cycle.frames.push(Frame {
                        anchor,
                        action,
                        first_sample_delay_s: 1e-9,
                        first_path_index: None,
                        line_of_sight: None,
                        samples: frame(kind, &recording.actions[action], &lengths, samples, &mut rng),
                    });
                }
            }
            recording.cycles.push(cycle);
        }
        recording
    }

    fn frame(
        kind: Kind,
        action: &Action,
        lengths: &[f64],
        samples: usize,
        rng: &mut Xoshiro128PlusPlus,
    ) -> Samples {
        let pulse = Pulse::new(action.pulse_duration_s, &PulseShape::RootRaisedCosine { roll_off: 0.6 });
        let mut response = Vec::new();
        for n in 0..samples {
            let mut sample = [0.03 * noise(rng), 0.03 * noise(rng)];
            for length in lengths {
                let delay_s = length / SPEED_OF_LIGHT_M_S;
                let lag = (1e-9 + n as f64 * SPACING_S - delay_s) / action.pulse_duration_s;
                let phase = -std::f64::consts::TAU * action.carrier_hz * delay_s;
                let amplitude = pulse.autocorrelation(lag) * 2.0 / length;
                sample[0] += amplitude * phase.cos();
                sample[1] += amplitude * phase.sin();
            }
            response.push(sample);
        }
        match kind {
            Kind::Magnitude => Samples::Magnitude(response.iter().map(|[x, y]| x.hypot(*y) as f32).collect()),
            _ => Samples::Complex(response.iter().map(|sample| sample.map(|part| part as f32)).collect()),
        }
    }

    /// An L-shaped room with a wall in it that has a door: each wall by its segments.
    fn l_shape() -> Vec<Vec<[[f64; 2]; 2]>> {
        let corners = [[0.0, 0.0], [8.0, 0.0], [8.0, 4.0], [5.0, 4.0], [5.0, 7.0], [0.0, 7.0]];
        let ahead = corners.into_iter().cycle().skip(1);
        let mut walls: Vec<_> = corners.into_iter().zip(ahead).map(|(a, b)| vec![[a, b]]).collect();
        walls.push(vec![[[3.0, 0.0], [3.0, 1.5]], [[3.0, 2.4], [3.0, 3.4]]]);
        walls
    }

    /// A recording in that room, two of whose walls are not where the plan tells them and one of which is not there at all:
    /// the last. `std`: what the plan says of each wall's offset (metres) and rotation (radians). Paths over up to two
    /// reflections, some of them through a wall.
    fn walled(
        kind: Kind,
        cycles: usize,
        samples: usize,
        [offset_std_m, rotation_std_rad]: [f64; 2],
    ) -> Recording {
        let mut rng = Xoshiro128PlusPlus::seed_from_u64(23);
        let mut recording = circle(kind, 0, 0, 0.0);
        let anchors = [[0.6, 6.2], [7.2, 0.7]];
        for (anchor, position_m) in recording.anchors.iter_mut().zip(anchors) {
            anchor.position_m = position_m;
        }
        recording.virtual_anchors.clear();
        recording.start.position_m = [5.3, 2.3];
        let mut told = l_shape();
        let walls: Vec<Wall> =
            told.iter().flatten().map(|ends_m| Wall { ends_m: *ends_m, construction: 0 }).collect();
        for [x, y] in told[0].iter_mut().flatten() {
            *y += 0.06 - 0.01 * *x;
        }
        for [x, _] in told[1].iter_mut().flatten() {
            *x -= 0.12;
        }
        told.push(vec![[[5.6, 1.2], [5.6, 3.0]]]);
        let wall = |segments_m: Vec<[[f64; 2]; 2]>| PlanWall {
            segments_m,
            offset_std_m,
            rotation_std_rad,
            construction: "concrete".into(),
        };
        recording.plan = Some(Plan {
            outline_m: l_shape().iter().take(6).map(|segments| segments[0][0]).collect(),
            turn_std_rad: 0.01,
            reflections: 2,
            most_sources: 24,
            walls: told.into_iter().map(wall).collect(),
        });
        for n in 0..cycles {
            let angle = 0.03 * n as f64;
            let position = [4.0 + 1.3 * angle.cos(), 2.3 + 1.2 * angle.sin()];
            let mut cycle = Cycle { time_s: 0.1 * n as f64, ..Cycle::default() };
            cycle.truth_position_m = Some(position);
            for (anchor, at) in anchors.into_iter().enumerate() {
                let mut lengths = Vec::new();
                for image in image_sources(&walls, at, 2) {
                    let ray = trace_image(&walls, at, &image, position, 1);
                    if let Some(ray) = ray.filter(|ray| ray.crossed.is_empty() || rng.next_u32() % 3 == 0) {
                        lengths.push(ray.length_m());
                    }
                }
                if anchor == 0 {
                    // What no plan tells of.
                    lengths.push((position[0] + 2.0).hypot(position[1] - 8.0));
                }
                if kind == Kind::Ranges {
                    for length in lengths {
                        let range_m = length + 0.02 * noise(&mut rng);
                        cycle.ranges.push(Range { anchor, range_m, std_m: None, angles: None });
                    }
                } else {
                    let action = (n * 5 + anchor) % 6;
                    cycle.frames.push(Frame {
                        anchor,
                        action,
                        first_sample_delay_s: 1e-9,
                        first_path_index: None,
                        line_of_sight: None,
                        samples: frame(kind, &recording.actions[action], &lengths, samples, &mut rng),
                    });
                }
            }
            recording.cycles.push(cycle);
        }
        recording
    }

    fn setup(recording: &Recording) -> Setup {
        Setup::new(recording, Path::new("made"), None).unwrap()
    }

    fn verified(setup: &Setup, recording: &Recording) -> Verification {
        let outcome = verify_setup(setup, recording, Path::new("made"), None, |_| {}).unwrap();
        assert!(outcome.equal, "{}", outcome.first_difference.unwrap());
        assert_eq!(outcome.cycles, recording.cycles.len());
        assert_eq!(outcome.not_finite, 0);
        outcome
    }

    #[test]
    fn ranges_are_equal_while_virtual_anchors_come_and_go() {
        let recording = recording(Kind::Ranges, 400, 0);
        let mut setup = setup(&recording);
        setup.config.controller.choice.exploration_per_s = 0.5;
        let covered = verified(&setup, &recording).covered;
        assert!(covered.discovered > 0 && covered.action_changes > 0, "{covered:?}");
        // What nothing can hide is not there where it is missed.
        setup.config.channel.hiding_per_s = 0.0;
        let covered = verified(&setup, &recording).covered;
        assert!(covered.discovered > 0 && covered.forgotten > 0, "{covered:?}");
    }

    #[test]
    fn ranges_are_equal_with_hard_decisions_biases_heights_and_a_long_horizon() {
        let mut recording = recording(Kind::Ranges, 250, 0);
        for (n, cycle) in recording.cycles.iter_mut().enumerate() {
            // Now and then nobody knows the height.
            cycle.tag_height_m = (n % 7 != 0).then_some(1.2);
            // And now and then not well.
            cycle.tag_height_std_m = (n % 7 != 0).then_some(if n % 5 == 0 { 0.3 } else { 0.0 });
        }
        let mut setup = setup(&recording);
        setup.config.association.mode = Mode::Map;
        setup.config.ranging.bias_mean_m = 0.05;
        setup.config.ranging.bias_std_m = 0.1;
        setup.config.controller.horizon = 5;
        setup.config.controller.reward = Reward::EntropyChange;
        setup.config.controller.planned_actions = 4;
        setup.config.controller.choice.exploration_per_s = 5.0;
        let covered = verified(&setup, &recording).covered;
        assert!(covered.action_changes > 10, "{covered:?}");
    }

    /// Choices announced and for every anchor by itself, over lost frames, and among a part of the library.
    #[test]
    fn frames_are_equal_however_the_next_action_is_agreed_on() {
        let mut recording = recording(Kind::Complex, 120, 200);
        for (n, cycle) in recording.cycles.iter_mut().enumerate() {
            match n {
                // The first anchor is called to the rendezvous, and later all go there.
                40..45 => cycle.frames.retain(|frame| frame.anchor != 0),
                70..75 => cycle.frames.clear(),
                _ => {}
            }
        }
        for (per_anchor, rendezvous) in [(true, None), (false, Some(1)), (true, Some(1))] {
            let mut setup = setup(&recording);
            setup.config.controller.per_anchor = per_anchor;
            setup.config.controller.rendezvous = rendezvous;
            setup.config.controller.horizon = 2;
            setup.config.controller.choice.exploration_per_s = 2.0;
            let covered = verified(&setup, &recording).covered;
            assert!(covered.action_changes > 10, "{covered:?}");
        }
    }

    #[test]
    fn every_variant_is_equal_and_the_conventional_one_never_moves_its_map() {
        let recording = recording(Kind::Ranges, 400, 0);
        let folder = Path::new("made");
        for variant in Variant::ALL {
            let setup = setup(&recording).with_variant(variant, folder).unwrap();
            let covered = verified(&setup, &recording).covered;
            assert_eq!(covered.discovered == 0, variant == Variant::Conventional, "{variant:?}: {covered:?}");

            let mut tracker = setup.tracker::<SMALL_ANCHORS>().unwrap();
            let mut held = true;
            for input in inputs(&recording) {
                step(&mut tracker, &input, &mut ()).unwrap();
                for (slot, mapped) in setup.map.iter().enumerate() {
                    // Forgotten once nothing reflects any more.
                    let Some((mean, covariance)) = tracker.image(slot) else { continue };
                    held &= [mean.x, mean.y] == mapped.position_m && covariance.norm() == 0.0;
                }
            }
            assert_eq!(held, variant == Variant::Conventional, "{variant:?}");
        }
    }

    #[test]
    fn the_conventional_variant_is_refused_without_a_floor_plan() {
        let mut recording = recording(Kind::Ranges, 2, 0);
        recording.virtual_anchors.iter_mut().for_each(|va| va.known = false);
        for variant in Variant::ALL {
            let answer = setup(&recording).with_variant(variant, Path::new("made"));
            match answer {
                Ok(_) => assert_ne!(variant, Variant::Conventional),
                Err(error) => {
                    assert_eq!(variant, Variant::Conventional);
                    assert_eq!(error.item(), Some("virtual_anchors"));
                }
            }
        }
    }

    #[test]
    fn complex_frames_are_equal_for_every_reward() {
        let recording = recording(Kind::Complex, 60, 200);
        for (reward, horizon) in
            [(Reward::InformationGain, 1), (Reward::EntropyChange, 5), (Reward::Published { scale: 1e24 }, 5)]
        {
            let mut setup = setup(&recording);
            setup.config.controller.reward = reward;
            setup.config.controller.horizon = horizon;
            setup.config.controller.learning.bootstrap = horizon == 5;
            let covered = verified(&setup, &recording).covered;
            assert!(covered.paths > 2 * covered.frames && covered.action_changes > 0, "{covered:?}");
        }
    }

    /// A receiver that scales its frames, that an interferer drowns now and then, and that keeps less of the pulse than there is.
    #[test]
    fn frames_under_gain_control_are_equal() {
        for kind in [Kind::Complex, Kind::Magnitude] {
            let mut recording = recording(kind, 60, 200);
            recording.radio.gain_control = true;
            recording.actions[2].pulse_duration_s = 0.35e-9;
            let mut rng = Xoshiro128PlusPlus::seed_from_u64(9);
            for (n, frame) in recording.cycles.iter_mut().flat_map(|cycle| &mut cycle.frames).enumerate() {
                let gain = 10_f64.powf(noise(&mut rng)) as f32;
                let loud = if n % 40 > 30 { 30.0 } else { 0.0 };
                let mut spoilt = |value: &mut f32| *value = gain * (*value + loud * noise(&mut rng) as f32);
                match &mut frame.samples {
                    Samples::Complex(samples) => samples.iter_mut().flatten().for_each(spoilt),
                    Samples::Magnitude(samples) => samples.iter_mut().for_each(|value| {
                        spoilt(value);
                        *value = value.abs();
                    }),
                }
            }
            verified(&setup(&recording), &recording);
        }
    }

    /// A tag that is lost in noise from the first cycle on, until the action that it is sought with is quiet.
    #[test]
    fn frames_in_which_a_tag_is_sought_with_another_action_are_equal() {
        for gain_control in [false, true] {
            let mut clean = recording(Kind::Complex, 110, 200);
            clean.radio.gain_control = gain_control;
            // From a cycle on with another action, which is quiet four cycles later.
            let noisy = |from: usize, action: usize| {
                let mut recording = clean.clone();
                let mut rng = Xoshiro128PlusPlus::seed_from_u64(9);
                for (n, cycle) in recording.cycles.iter_mut().enumerate() {
                    for frame in &mut cycle.frames {
                        let loud = if n < from + 4 { 1.0 } else { 0.0 };
                        frame.action = if n < from { 0 } else { action };
                        let Samples::Complex(samples) = &mut frame.samples else { continue };
                        let values = samples.iter_mut().flatten();
                        values.for_each(|value| *value += loud * noise(&mut rng) as f32);
                    }
                }
                recording
            };
            let recording = noisy(110, 0);
            let mut tracker = setup(&recording).tracker::<SMALL_ANCHORS>().unwrap();
            let turn = inputs(&recording).enumerate().find_map(|(n, input)| {
                step(&mut tracker, &input, &mut ()).unwrap();
                Some((n + 1, tracker.controller_of(0)?.sought_with()?))
            });
            let (from, sought_with) = turn.unwrap();
            let recording = noisy(from, sought_with);
            let covered = verified(&setup(&recording), &recording).covered;
            assert!(covered.sought_elsewhere > 3 && covered.searching < 80, "{from}: {covered:?}");

            let mut tracker = setup(&recording).tracker::<SMALL_ANCHORS>().unwrap();
            for input in inputs(&recording).take(from + 19) {
                step(&mut tracker, &input, &mut ()).unwrap();
            }
            let direct = Source::Direct { anchor: 0 };
            let [jammed, quiet] = [0, sought_with].map(|action| tracker.channel().sinr_ln(direct, action));
            assert!(quiet > jammed + 2.0, "gain control {gain_control}, from {from}: {quiet} {jammed}");
        }
    }

    #[test]
    fn frames_with_ranges_beside_them_are_equal() {
        let mut recording = recording(Kind::Both, 60, 200);
        recording.radio.range_bias_std_m = 0.1;
        verified(&setup(&recording), &recording);
    }

    #[test]
    fn magnitudes_are_equal() {
        let recording = recording(Kind::Magnitude, 60, 200);
        let covered = verified(&setup(&recording), &recording).covered;
        assert!(covered.paths > covered.frames, "{covered:?}");
    }

    #[test]
    fn side_lobes_about_the_threshold_are_equal() {
        let mut recording = recording(Kind::Magnitude, 40, 200);
        for (n, cycle) in recording.cycles.iter_mut().enumerate() {
            for frame in &mut cycle.frames {
                let Samples::Magnitude(samples) = &mut frame.samples else { panic!() };
                let peak = (0..190).max_by(|a, b| samples[*a].total_cmp(&samples[*b])).unwrap();
                // Quiet surroundings, so that a side lobe stands above the noise.
                for (_, sample) in samples.iter_mut().enumerate().filter(|(n, _)| n.abs_diff(peak) > 8) {
                    *sample *= 0.1;
                }
                samples[peak + 5] = samples[peak] * (0.01 + 0.0005 * n as f32).sqrt();
            }
        }
        verified(&setup(&recording), &recording);
    }

    #[test]
    fn a_map_that_is_mostly_wrong_is_equal() {
        let mut covered = Coverage::default();
        // Virtual anchors that are rarely detected and rarely seen stay; the less likely, the longer.
        for (turn, detection_probability) in
            [0.1, 0.2].into_iter().flat_map(|t| [0.03, 0.06, 0.1].map(|p| (t, p)))
        {
            let mut recording = circle(Kind::Ranges, 400, 0, turn);
            recording.motion.acceleration_std_m_s2 = Some(1.0);
            recording.start.velocity_std_m_s = 1.0;
            recording.association.detection_probability = detection_probability;
            recording.virtual_anchors.clear();
            for n in 0..SURFACES {
                // The first is 0.2 m off a true one, the others are nowhere near any.
                let position_m = if n == 0 { [0.5, 10.6] } else { [-8.0 + 0.2 * n as f64, -3.0] };
                let known = VirtualAnchor::new(n % 2, position_m, 1e-3, true);
                recording.virtual_anchors.push(known);
            }
            for cycle in recording.cycles.iter_mut().skip(20).step_by(40) {
                let [x, y] = cycle.truth_position_m.unwrap();
                cycle.ranges.clear();
                for known in &recording.virtual_anchors {
                    let [u, v] = known.position_m;
                    let range_m = (x - u).hypot(y - v);
                    cycle.ranges.push(Range {
                        anchor: known.anchor,
                        range_m,
                        std_m: Some(0.05),
                        angles: None,
                    });
                }
            }
            covered.forgotten += verified(&setup(&recording), &recording).covered.forgotten;
        }
        assert!(covered.forgotten > 0, "{covered:?}");
    }

    /// Which parts of a map of walls a tracker went through.
    #[derive(Debug, Default, PartialEq, Eq)]
    struct WalledCoverage {
        twice_reflected: bool,
        either_order: bool,
        /// Some source was seen, some was out of sight at times.
        seen: bool,
        out_of_sight: bool,
        /// The wall with the door was looked through.
        looked_through: bool,
        /// The wall that is not there became doubtful.
        doubted: bool,
    }

    fn walled_coverage(setup: &Setup, recording: &Recording) -> WalledCoverage {
        let mut tracker = setup.tracker::<SMALL_ANCHORS>().unwrap();
        let mut covered = WalledCoverage::default();
        let usual = tracker.transmission().through(6);
        for input in inputs(recording) {
            let report = step(&mut tracker, &input, &mut ()).unwrap().report;
            for (slot, record) in tracker.environment().iter() {
                let source = Source::Virtual { anchor: record.anchor, slot };
                covered.twice_reflected |= record.sequence.second.is_some() && record.hits > 0;
                covered.either_order |= record.sequence.is_either_order && record.hits > 0;
                let availability = tracker.availability(source, report.position_m);
                covered.seen |= availability > 0.9 && record.hits > 5;
                covered.out_of_sight |= availability < 0.1 && record.hits > 5;
            }
            covered.looked_through |= tracker.transmission().through(6) != usual;
            let absent = tracker.plan().walls()[7].surface.map(usize::from);
            let absent = absent.and_then(|slot| tracker.environment().surface(slot));
            covered.doubted |= absent.is_some_and(|record| record.existence < 0.5);
        }
        covered
    }

    const ALL_OF_WALLED: WalledCoverage = WalledCoverage {
        twice_reflected: true,
        either_order: true,
        seen: true,
        out_of_sight: true,
        looked_through: true,
        doubted: true,
    };

    #[test]
    fn a_plan_of_uncertain_walls_is_equal() {
        let mut recording = walled(Kind::Ranges, 250, 0, [0.1, 0.01]);
        // With every slot taken, which nothing hidden gives up, and with room for what no plan tells of.
        let mut all_in_sight = setup(&recording);
        all_in_sight.config.channel.hiding_per_s = 0.0;
        let covered = verified(&all_in_sight, &recording).covered;
        assert!(covered.map_full > 0 && covered.discovered == 0, "{covered:?}");
        if let Some(plan) = &mut recording.plan {
            plan.most_sources = 12;
        }
        let covered = verified(&setup(&recording), &recording).covered;
        assert!(covered.discovered > 0, "{covered:?}");
    }

    /// With room for all components, for some, for two; walls that nobody walks through and that hide paths, or not; and silence.
    #[test]
    fn what_bounds_the_belief_is_equal() {
        let mut recording = walled(Kind::Ranges, 200, 0, [0.1, 0.01]);
        recording.start.position_std_m = 2.0;
        for cycle in &mut recording.cycles[100..115] {
            cycle.ranges.clear();
        }
        let mut hashes = Vec::new();
        let free = u16::MAX;
        let usual = WorkLimits::default().anchor;
        for (comparisons, anchor, bar, hide) in [
            (free, usual, true, true),
            (12, usual, true, true),
            (6, usual, true, true),
            (2, usual, true, true),
            (free, 500_000, true, true),
            (free, 300_000, true, true),
            (free, usual, false, true),
            (free, usual, true, false),
        ] {
            let mut setup = setup(&recording);
            setup.config.work = WorkLimits { anchor, comparisons };
            setup.config.belief.walls_bar_ways = bar;
            setup.config.belief.walls_hide_paths = hide;
            let covered = verified(&setup, &recording).covered;
            // Three slots or two hold what there can be.
            assert!(comparisons != 12 || covered.crowded_out > 0, "{covered:?}");
            let mut tracker = setup.tracker::<SMALL_ANCHORS>().unwrap();
            let hash =
                inputs(&recording).map(|input| step(&mut tracker, &input, &mut ()).unwrap().hash).last();
            // With less work there may be room for as many as with fewer comparisons.
            assert!(
                !hashes.contains(&hash) || anchor != usual && hash != hashes[0],
                "{comparisons} {anchor} {bar} {hide}: as another"
            );
            hashes.push(hash);
        }
    }

    #[test]
    fn a_plan_of_exact_walls_and_biases_is_equal() {
        let mut recording = walled(Kind::Ranges, 250, 0, [0.0, 0.0]);
        recording.radio.range_bias_std_m = 0.1;
        let setup = setup(&recording);
        verified(&setup, &recording);
        assert_eq!(walled_coverage(&setup, &recording), ALL_OF_WALLED);
    }

    #[test]
    fn a_plan_told_to_every_variant_is_equal_over_frames() {
        // Walls that are shifted but not turned, and few sources.
        let mut recording = walled(Kind::Complex, 60, 200, [0.1, 0.0]);
        if let Some(plan) = &mut recording.plan {
            plan.most_sources = 10;
        }
        for variant in Variant::ALL {
            let setup = setup(&recording).with_variant(variant, Path::new("made")).unwrap();
            let covered = verified(&setup, &recording).covered;
            assert!(covered.paths > covered.frames, "{variant:?}: {covered:?}");
        }
    }

    #[test]
    fn a_plan_that_differs_in_the_width_of_a_door_or_in_a_deviation_is_found() {
        let recording = walled(Kind::Ranges, 250, 0, [0.1, 0.01]);
        let planted: [fn(&mut Plan); 4] = [
            |plan| plan.walls[6].segments_m[1][0][1] += 0.01,
            |plan| plan.walls[3].rotation_std_rad += 1e-6,
            |plan| plan.turn_std_rad += 1e-6,
            |plan| plan.walls[2].segments_m[0][1][0] += 1e-3,
        ];
        for (number, plant) in planted.into_iter().enumerate() {
            let mut other = recording.clone();
            plant(other.plan.as_mut().unwrap());
            let setups = [&setup(&recording), &setup(&other)];
            let outcome = compare(setups, [&recording, &recording], Path::new("made"), 250, &mut |_| {});
            assert!(!outcome.unwrap().equal, "number {number}");
        }
    }

    /// Anchors in the room of [`hall`].
    const HALL: [[f64; 2]; 2] = [[0.6, 4.8], [6.5, 0.7]];

    /// Ranges over up to so many reflections in a room of four walls that two anchors see alike, and a way that tells left from
    /// right.
    fn hall(cycles: usize, reflections: usize) -> Recording {
        let mut rng = Xoshiro128PlusPlus::seed_from_u64(29);
        let mut recording = circle(Kind::Ranges, 0, 0, 0.0);
        for (anchor, position_m) in recording.anchors.iter_mut().zip(HALL) {
            anchor.position_m = position_m;
        }
        recording.virtual_anchors.clear();
        recording.motion = Motion::of_acceleration(0.3);
        recording.association.clutter_per_anchor = 0.1;
        recording.association.max_range_m = 30.0;
        recording.start.position_m = [5.4, 2.7];
        recording.start.velocity_std_m_s = 0.5;
        let walls = four_walls().map(|ends_m| Wall { ends_m, construction: 0 });
        for n in 0..cycles {
            let angle = 0.02 * n as f64;
            let position = [3.6 + 1.8 * angle.cos(), 2.7 + 1.3 * (1.7 * angle).sin()];
            let mut cycle = Cycle { time_s: 0.1 * n as f64, ..Cycle::default() };
            cycle.truth_position_m = Some(position);
            for (anchor, at) in HALL.into_iter().enumerate() {
                for image in image_sources(&walls, at, reflections) {
                    if let Some(ray) = trace_image(&walls, at, &image, position, 1) {
                        let range_m = ray.length_m() + 0.02 * noise(&mut rng);
                        cycle.ranges.push(Range { anchor, range_m, std_m: None, angles: None });
                    }
                }
            }
            recording.cycles.push(cycle);
        }
        recording
    }

    fn four_walls() -> [[[f64; 2]; 2]; 4] {
        let corners = [[0.0, 0.0], [7.3, 0.0], [7.3, 5.4], [0.0, 5.4]];
        [0, 1, 2, 3].map(|n: usize| [corners[n], corners[(n + 1) % 4]])
    }

    /// The hall with a plan that tells the wall at x = 7.3 m to be 1 m behind, for certain: it is doubted before it is moved.
    fn hall_told_wrongly(cycles: usize, reflections: usize) -> Recording {
        let mut recording = hall(cycles, reflections);
        let mut told = four_walls();
        told[1].iter_mut().for_each(|[x, _]| *x += 1.0);
        let wall = |ends_m| PlanWall {
            segments_m: vec![ends_m],
            offset_std_m: 0.05,
            rotation_std_rad: 0.01,
            construction: "concrete".into(),
        };
        recording.plan = Some(Plan {
            outline_m: four_walls().map(|[corner, _]| corner).to_vec(),
            turn_std_rad: 0.01,
            reflections: 2,
            most_sources: 24,
            walls: told.map(wall).to_vec(),
        });
        recording
    }

    #[test]
    fn walls_that_grow_without_a_plan_are_equal() {
        for (reflections, bias_std_m, least) in [(1, 0.0, 4), (2, 0.0, 8), (2, 0.03, 1)] {
            let mut recording = hall(200, reflections);
            recording.radio.range_bias_std_m = bias_std_m;
            let setup = setup(&recording);
            let covered = verified(&setup, &recording).covered;
            assert!(covered.joined >= least, "{reflections} reflections, bias {bias_std_m} m: {covered:?}");
        }
        // What joins both is a wall, and pairs of walls make images in either order.
        let recording = hall(200, 2);
        let mut tracker = setup(&recording).tracker::<SMALL_ANCHORS>().unwrap();
        for input in inputs(&recording) {
            step(&mut tracker, &input, &mut ()).unwrap();
        }
        let sequences = || tracker.environment().iter().map(|(_, record)| record.sequence);
        assert!((0..SURFACES).filter(|slot| tracker.wall(*slot).is_some()).count() >= 4);
        assert!(sequences().any(|sequence| sequence.is_either_order));
    }

    #[test]
    fn a_wall_of_the_plan_that_is_learnt_elsewhere_is_equal() {
        for reflections in [1, 2] {
            let recording = hall_told_wrongly(200, reflections);
            let setup = setup(&recording);
            let covered = verified(&setup, &recording).covered;
            assert!(covered.joined > 0, "{reflections} reflections: {covered:?}");
        }
        // It is found where it is in one cycle: nothing else makes a doubted wall of a plan certain at once.
        let recording = hall_told_wrongly(200, 1);
        let mut tracker = setup(&recording).tracker::<SMALL_ANCHORS>().unwrap();
        let mut was = None;
        let mut learnt_at_m = None;
        for input in inputs(&recording) {
            let joined = step(&mut tracker, &input, &mut ()).unwrap().report.joined;
            let slot = usize::from(tracker.plan().walls()[1].surface.unwrap());
            let now = tracker.wall(slot).unwrap();
            let [x, _] = now.line.centre_m;
            if joined > 0 && was.is_some_and(|was| was < 0.1) && now.existence > 0.5 {
                learnt_at_m = Some(x);
            }
            was = Some(now.existence);
        }
        assert!(learnt_at_m.is_some_and(|x| (x - 7.3).abs() < 0.1), "{learnt_at_m:?}");
    }

    #[test]
    fn a_constant_of_joining_that_differs_is_found() {
        let grown = hall(160, 2);
        let told = hall_told_wrongly(160, 1);
        type Plant = fn(&mut Constants);
        let planted: [(&Recording, Plant); 7] = [
            (&grown, |_| {}),
            (&grown, |c| c.path_std_m *= 1.001),
            (&grown, |c| c.certain = 0.999),
            (&grown, |c| c.first = 1e-4),
            (&grown, |c| c.second = 1e-4),
            (&grown, |c| (c.least_skew, c.skew) = (0.0, 0.0)),
            (&told, |c| c.moved = 1e-3),
        ];
        for (number, (recording, plant)) in planted.into_iter().enumerate() {
            let setup = setup(recording);
            let mut tracker = setup.tracker::<SMALL_ANCHORS>().unwrap();
            let mut reference = twin::<f32, SMALL_ANCHORS>(&setup);
            plant(&mut reference.joining);
            let differs = inputs(recording).any(|input| {
                let hash = step(&mut tracker, &input, &mut ()).unwrap().hash;
                reference.cycle(&input.observations(), input.elapsed_s, input.tag_height);
                state_hash(&reference) != hash
            });
            assert_eq!(differs, number > 0, "number {number}");
        }
    }

    #[test]
    fn more_than_two_anchors_are_equal() {
        let mut recording = recording(Kind::Ranges, 40, 0);
        let third = Anchor::new("third", [1.0, 1.0], 0.5);
        recording.anchors.push(third);
        for cycle in &mut recording.cycles {
            let [x, y] = cycle.truth_position_m.unwrap();
            let range_m = (x - 1.0).hypot(y - 1.0);
            cycle.ranges.push(Range { anchor: 2, range_m, std_m: Some(0.01), angles: None });
        }
        recording.radio.range_bias_std_m = 0.1;
        verified(&setup(&recording), &recording);
    }

    #[test]
    fn scans_with_more_ranges_than_there_is_room_for_are_equal() {
        for kind in [Kind::Ranges, Kind::Both] {
            let mut recording = recording(kind, 60, 200);
            let mut rng = Xoshiro128PlusPlus::seed_from_u64(17);
            for cycle in &mut recording.cycles {
                for n in 0..rng.next_u32() % 60 {
                    // Of a few lengths and deviations only, so that many are equal in one or both.
                    let range_m = 1.0 + f64::from(rng.next_u32() % 12);
                    let std_m = [None, Some(0.05), Some(0.5)][rng.next_u32() as usize % 3];
                    let range = Range { anchor: (n % 2) as usize, range_m, std_m, angles: None };
                    cycle.ranges.insert(rng.next_u32() as usize % (cycle.ranges.len() + 1), range);
                }
            }
            let covered = verified(&setup(&recording), &recording).covered;
            assert!(covered.left_out > 100 && covered.refused_cycles == 0, "{covered:?}");
        }
    }

    #[test]
    fn a_refused_cycle_is_an_empty_one_for_both() {
        let mut recording = recording(Kind::Both, 12, 200);
        // More ranges than the core looks at in one scan.
        let range = Range { anchor: 0, range_m: 5.0, std_m: None, angles: None };
        recording.cycles[4].ranges.extend([range; LONGEST_SCAN + 1]);
        if let Samples::Complex(samples) = &mut recording.cycles[7].frames[0].samples {
            samples[3] = [f32::NAN, 0.0];
        }
        assert_eq!(verified(&setup(&recording), &recording).covered.refused_cycles, 2);
    }

    #[test]
    fn only_the_cycles_asked_for_are_run_and_progress_is_told() {
        let recording = recording(Kind::Ranges, 20, 0);
        let mut done = Vec::new();
        let outcome = verify(&recording, Path::new("made"), Some(3), Some(5), |n| done.push(n)).unwrap();
        assert!(outcome.equal && outcome.cycles == 5 && outcome.compared > 5000);
        assert_eq!(done, [1, 2, 3, 4, 5]);
        assert!(outcome.f64_position_error_max_m < 1e-3);
    }

    #[test]
    fn one_bit_of_one_range_is_found_and_named() {
        let recording = recording(Kind::Ranges, 20, 0);
        let mut other = recording.clone();
        let range = &mut other.cycles[11].ranges[0];
        range.range_m = f64::from((range.range_m as f32).next_up());
        let setup = setup(&recording);
        let outcome =
            compare([&setup, &setup], [&recording, &other], Path::new("made"), 20, &mut |_| {}).unwrap();
        let difference = outcome.first_difference.unwrap();
        assert!(!outcome.equal && outcome.cycles == 12);
        assert_eq!((difference.cycle, difference.stage), (11, "associate"));
        assert_eq!(difference.quantity, "range of measurement 0 of anchor 0");
        let bits = |n: &Number| u32::from_str_radix(&n.bits[2..], 16).unwrap();
        assert_eq!(bits(&difference.core) + 1, bits(&difference.reference));
        assert!(
            difference.to_string().starts_with("cycle 11, associate: range of measurement 0 of anchor 0 is")
        );
    }

    #[test]
    fn one_bit_of_one_sample_is_found_in_the_channel_estimate() {
        let recording = recording(Kind::Complex, 6, 200);
        let mut other = recording.clone();
        let Samples::Complex(samples) = &mut other.cycles[3].frames[0].samples else { panic!() };
        let strongest = (0..200)
            .max_by(|a, b| {
                let power = |n: usize| samples[n][0].hypot(samples[n][1]);
                power(*a).total_cmp(&power(*b))
            })
            .unwrap();
        samples[strongest][0] = samples[strongest][0].next_up();
        let setup = setup(&recording);
        let outcome =
            compare([&setup, &setup], [&recording, &other], Path::new("made"), 20, &mut |_| {}).unwrap();
        let difference = outcome.first_difference.unwrap();
        assert_eq!((difference.cycle, difference.stage), (3, "estimate"));
    }

    #[test]
    fn one_bit_of_state_that_no_number_shows_is_found_in_the_hash() {
        let recording = recording(Kind::Ranges, 3, 0);
        let setup = setup(&recording);
        let mut reference = twin::<f32, SMALL_ANCHORS>(&setup);
        let tracker = setup.tracker::<SMALL_ANCHORS>().unwrap();
        assert_eq!(state_hash(&reference), tracker.hash());
        reference.receiver.last_sequence[1] = Some(0);
        assert_ne!(state_hash(&reference), tracker.hash());
    }
}
