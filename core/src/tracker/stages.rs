//! The stages of a cycle that join the states of several blocks.

use super::joining::join;
use super::values::{Known, Place, Told, detections_anywhere, discovery_view};
use crate::controller::{Controller, Controllers};
use crate::memory::channel::ChannelMemory;
use crate::memory::clutter::ClutterMemory;
use crate::memory::discovery::{Claims, Discovery};
use crate::memory::environment::{Admission, EnvironmentMemory, Placed, Removed};
use crate::memory::transmission::TransmissionMemory;
use crate::model::availability::Walls;
use crate::model::motion::{Agent, ProcessNoise};
use crate::model::plan::FloorPlan;
use crate::observer::Observer;
use crate::perceptor::association::evidence::evidence_nat;
use crate::perceptor::association::outcome::{AssociatedScan, associate_scan, normalised_innovation};
use crate::perceptor::belief::TagBelief;
use crate::perceptor::belief::acquisition::{Landmark, Sweep};
use crate::perceptor::belief::manoeuvre::{Suspicion, is_manoeuvre};
use crate::perceptor::expectation::Expectations;
use crate::perceptor::receiver::{Receiver, Scans};
use crate::perceptor::scan::Scan;
use crate::perceptor::state_filter::StateFilter;
use crate::real::smaller;
use crate::report::MapChanges;
use heapless::Vec;

/// Every scan with its outcome, and what the candidates for new virtual anchors claim of it.
pub(super) type Outcomes<'a, const ANCHORS: usize, const SOURCES: usize, const PATHS: usize> =
    Vec<(AssociatedScan<'a, SOURCES, PATHS>, Claims<PATHS>), ANCHORS>;

/// Every scan with what it is expected to show.
pub(super) type Expected<'a, const ANCHORS: usize, const SOURCES: usize, const PATHS: usize> =
    Vec<(&'a Scan<PATHS>, Expectations<SOURCES>), ANCHORS>;

/// What was heard in a cycle.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Heard {
    pub(super) anchors: u32,
    /// Measurements, and how many of them more likely than not belong to a known source.
    pub(super) measurements: u32,
    pub(super) associated: u32,
    /// Mean normalised innovation squared.
    pub(super) nis: f32,
}

impl Heard {
    pub(super) fn of<const ANCHORS: usize, const SOURCES: usize, const PATHS: usize>(
        outcomes: &Outcomes<'_, ANCHORS, SOURCES, PATHS>,
    ) -> Self {
        let mut heard = Self {
            nis: normalised_innovation(outcomes.iter().map(|(outcome, _)| outcome)),
            ..Self::default()
        };
        for (outcome, _) in outcomes {
            let (measurements, associated) = outcome.counts();
            heard.anchors += 1;
            heard.measurements += measurements;
            heard.associated += associated;
        }
        heard
    }
}

/// While it is not known where the tag is: weighs the places it may be at. Returns where it is taken to be now.
#[inline(never)]
pub(super) fn locate<
    const ANCHORS: usize,
    const SURFACES: usize,
    const SOURCES: usize,
    const SEGMENTS: usize,
    const PATHS: usize,
    const ACTIONS: usize,
>(
    belief: &mut TagBelief<ANCHORS>,
    told: &Told<'_, ANCHORS, ACTIONS>,
    known: &Known<'_, ANCHORS, SURFACES, SOURCES, SEGMENTS, ACTIONS>,
    scans: &Scans<ANCHORS, PATHS>,
) -> Option<Agent> {
    let acquisition = belief.acquisition()?;
    let settings = &told.config.association;
    let per_m = 1.0 / told.config.ranging.max_range_m;
    let mut detections: Vec<(f32, [f32; SOURCES]), ANCHORS> = Vec::new();
    let mut backgrounds: Vec<[f32; PATHS], ANCHORS> = Vec::new();
    for scan in scans {
        let clutter = known.clutter.clutter(scan.anchor);
        let false_share = clutter.false_alarms_per_m / clutter.all_per_m;
        let unmapped = (1.0 - false_share) * settings.detection_probability;
        // As many as scans: the pushes succeed.
        let _ = detections.push(known.detections_anywhere(told, scan));
        let all_per_m = clutter.all_per_m;
        let _ =
            backgrounds.push(acquisition.backgrounds(scan.anchor, &scan.measurements, all_per_m, unmapped));
    }
    let sweeps = scans.iter().zip(&backgrounds).map(|(scan, all_per_m)| {
        let (bias_m, bias_variance_m2) = known.filter.bias_m(scan.anchor).unwrap_or((0.0, 0.0));
        let sweep = Sweep {
            measurements: &scan.measurements,
            bias_m,
            bias_variance_m2,
            all_per_m,
            false_alarms_per_m: known.clutter.clutter(scan.anchor).false_alarms_per_m,
            anywhere_per_m: per_m,
        };
        (scan.anchor, sweep)
    });
    let landmarks = |anchor: usize| {
        let sight = told.sight(anchor);
        let (height_m, height_std_m) = sight.map_or((0.0, 0.0), |sight| (sight.height_m, sight.height_std_m));
        let scan = scans.iter().position(|scan| scan.anchor == anchor).unwrap_or(0);
        let detection = detections.get(scan);
        let direct = sight.map(|sight| Landmark {
            position_m: sight.anchor_m,
            covariance_m2: [0.0; 3],
            height_m,
            height_std_m,
            detection: detection.map_or(0.0, |(direct, _)| *direct),
        });
        let reflected = known.environment.iter().filter(move |(_, record)| record.anchor == anchor);
        direct.into_iter().chain(reflected.filter_map(move |(slot, record)| {
            let (a, c) = known.filter.placed(sight?.anchor_m, &record.sequence)?;
            Some(Landmark {
                position_m: [a.x, a.y],
                covariance_m2: [c.m11, c.m21, c.m22],
                height_m,
                height_std_m,
                detection: known.environment.existence(slot) * detection?.1.get(slot)?,
            })
        }))
    };
    belief.locate(sweeps, landmarks, |place_m, std_m| known.plan.inside(place_m, std_m))
}

/// What every scan is expected to show at the predicted state, which is widened where a manoeuvre explains the scans far
/// better than the motion as configured does.
#[inline(never)]
#[allow(clippy::too_many_arguments)] // each is a state, or what it is told
pub(super) fn expect<
    'a,
    const ANCHORS: usize,
    const SURFACES: usize,
    const SOURCES: usize,
    const SEGMENTS: usize,
    const PATHS: usize,
    const ACTIONS: usize,
>(
    filter: &mut StateFilter<ANCHORS, SURFACES>,
    told: &Told<'_, ANCHORS, ACTIONS>,
    environment: &EnvironmentMemory<SURFACES, SOURCES>,
    channel: &ChannelMemory<ANCHORS, SOURCES, ACTIONS>,
    clutter: &ClutterMemory<ANCHORS>,
    (plan, walls): (&FloorPlan<SEGMENTS>, &Walls<'_, SEGMENTS>),
    scans: &'a Scans<ANCHORS, PATHS>,
    manoeuvre_over_s: Option<f32>,
) -> Expected<'a, ANCHORS, SOURCES, PATHS> {
    let known = Known { filter, environment, channel, clutter, plan, walls };
    let expected = known.expect_all(told, scans);
    let Some(elapsed_s) = manoeuvre_over_s.filter(|_| is_suspicious(&expected)) else { return expected };
    let motion_nat = total_evidence_nat(&expected, clutter);
    let predicted = filter.agent_covariance();
    let speed_m_s = told.config.start.velocity_std_m_s;
    filter.disturb(&ProcessNoise::of_turn(speed_m_s * speed_m_s, elapsed_s));
    let known = Known { filter, environment, channel, clutter, plan, walls };
    let widened = known.expect_all(told, scans);
    if is_manoeuvre(
        motion_nat,
        total_evidence_nat(&widened, clutter),
        told.config.belief.turns_per_s,
        elapsed_s,
    ) {
        return widened;
    }
    filter.undisturb(&predicted);
    expected
}

/// Whether the direct paths are not near where they are expected.
fn is_suspicious<const ANCHORS: usize, const SOURCES: usize, const PATHS: usize>(
    expected: &Expected<'_, ANCHORS, SOURCES, PATHS>,
) -> bool {
    let mut suspicion = Suspicion::default();
    for (scan, expected) in expected {
        let direct = &expected.direct_path;
        let mut nearest = f32::INFINITY;
        for measurement in &scan.measurements {
            let innovation = measurement.range_m - direct.range_m;
            let variance = direct.variance_m2 + measurement.variance_m2;
            nearest = smaller(nearest, innovation * innovation / variance);
        }
        suspicion.enter(direct.detection, nearest);
    }
    suspicion.is_raised()
}

/// Evidence of all scans that the tag is where it is predicted to be, nats.
fn total_evidence_nat<const ANCHORS: usize, const SOURCES: usize, const PATHS: usize>(
    expected: &Expected<'_, ANCHORS, SOURCES, PATHS>,
    clutter: &ClutterMemory<ANCHORS>,
) -> f32 {
    let mut evidence = 0.0;
    for (scan, Expectations { direct_path, expectations, .. }) in expected {
        let clutter = clutter.clutter(scan.anchor);
        evidence += evidence_nat(&scan.measurements, direct_path, expectations.iter(), &clutter);
    }
    evidence
}

/// Compares every scan with what it is expected to show.
#[inline(never)]
pub(super) fn associate<
    'a,
    const ANCHORS: usize,
    const SURFACES: usize,
    const SOURCES: usize,
    const SEGMENTS: usize,
    const PATHS: usize,
    const ACTIONS: usize,
>(
    told: &Told<'_, ANCHORS, ACTIONS>,
    known: &Known<'_, ANCHORS, SURFACES, SOURCES, SEGMENTS, ACTIONS>,
    discovery: &Discovery<ANCHORS>,
    expected: &'a Expected<'a, ANCHORS, SOURCES, PATHS>,
    observer: &mut impl Observer<SOURCES, PATHS>,
) -> Outcomes<'a, ANCHORS, SOURCES, PATHS> {
    let mut outcomes = Vec::new();
    for (scan, expected) in expected {
        let view = discovery_view(told, known.filter, known.clutter, scan.anchor, &expected.direct);
        let Some((viewpoint, background)) = view else { continue };
        let claims = discovery.claim(scan.anchor, &viewpoint, &scan.measurements, &background);
        let clutter = known.clutter.clutter(scan.anchor);
        let mode = told.config.association.mode;
        let outcome = associate_scan(scan, expected, &claims.totals(), &clutter, mode);
        let Expectations { direct, virtual_anchors, .. } = expected;
        observer.expectations(scan.anchor, direct, virtual_anchors);
        observer.beliefs(scan.anchor, &scan.measurements, &outcome.beliefs);
        // As many as scans: the push succeeds.
        let _ = outcomes.push((outcome, claims));
    }
    outcomes
}

/// What the memories keep of a cycle: existence, SINR of every source whose path was probably seen, and how much of each
/// scan nothing explained.
#[inline(never)]
#[allow(clippy::too_many_arguments)] // each is a state, or what it is told
pub(super) fn remember<
    const ANCHORS: usize,
    const SURFACES: usize,
    const SOURCES: usize,
    const PATHS: usize,
    const ACTIONS: usize,
>(
    environment: &mut EnvironmentMemory<SURFACES, SOURCES>,
    channel: &mut ChannelMemory<ANCHORS, SOURCES, ACTIONS>,
    clutter: &mut ClutterMemory<ANCHORS>,
    receiver: &mut Receiver<ANCHORS, PATHS>,
    told: &Told<'_, ANCHORS, ACTIONS>,
    belief: &TagBelief<ANCHORS>,
    controllers: &Controllers<ANCHORS, ACTIONS>,
    outcomes: &Outcomes<'_, ANCHORS, SOURCES, PATHS>,
) {
    let library = told.library;
    let framed = outcomes.iter().map(|(outcome, _)| outcome.scan).filter(|scan| scan.is_framed());
    for scan in framed.filter(|_| !belief.is_acquiring()) {
        // The tag was found: with which action, tells what gain control had hidden.
        if let Some(excess_ln) = receiver.found(scan.anchor) {
            let held = controllers.of(scan.anchor).map_or(0, Controller::held);
            let images = environment.images_of(scan.anchor);
            channel.reattribute(scan.anchor, images, [held, scan.action], excess_ln, library);
        }
    }
    for (outcome, _) in outcomes {
        let scan = outcome.scan;
        // What is missing from a doubtful place may be where it was: the tag is not.
        if belief.is_acquiring() || belief.is_doubtful() {
            // Under gain control, what is heard with an action that a lost tag is sought with cannot be compared yet.
            if !receiver.is_sought(scan.anchor) {
                channel.observe(outcome, library, false);
            }
        } else {
            environment.observe(outcome);
            channel.observe(outcome, library, true);
        }
        if !belief.is_acquiring() {
            clutter.observe(scan.anchor, outcome.unexplained(), scan.elapsed_s);
        }
    }
}

/// What direct paths tell of the walls that they cross.
#[inline(never)]
pub(super) fn look_through<
    const ANCHORS: usize,
    const SOURCES: usize,
    const SEGMENTS: usize,
    const PATHS: usize,
    const ACTIONS: usize,
>(
    transmission: &mut TransmissionMemory<SEGMENTS>,
    told: &Told<'_, ANCHORS, ACTIONS>,
    walls: &Walls<'_, SEGMENTS>,
    place: &Place,
    outcomes: &Outcomes<'_, ANCHORS, SOURCES, PATHS>,
) {
    for (outcome, _) in outcomes {
        let scan = outcome.scan;
        let Some(sight) = told.sight(scan.anchor) else { continue };
        let Some((_, direct)) = outcome.features().next() else { continue };
        let crossing = walls.paths(sight.anchor_m, place.position_m, place.std_m).crossing();
        transmission.observe(crossing, 1.0 - direct.missed, scan.elapsed_s);
    }
}

/// The life of surfaces and images: forgets improbable ones, gives what nothing explained to the candidates, and takes resolved
/// candidates into the map, and joins what one surface explains.
#[inline(never)]
#[allow(clippy::too_many_arguments)] // each is a state, or what it is told
pub(super) fn revise_map<
    const ANCHORS: usize,
    const SURFACES: usize,
    const SOURCES: usize,
    const PATHS: usize,
    const ACTIONS: usize,
>(
    filter: &mut StateFilter<ANCHORS, SURFACES>,
    environment: &mut EnvironmentMemory<SURFACES, SOURCES>,
    channel: &mut ChannelMemory<ANCHORS, SOURCES, ACTIONS>,
    discovery: &mut Discovery<ANCHORS>,
    clutter: &ClutterMemory<ANCHORS>,
    told: &Told<'_, ANCHORS, ACTIONS>,
    outcomes: &Outcomes<'_, ANCHORS, SOURCES, PATHS>,
) -> MapChanges {
    let mut changes = MapChanges::default();
    let removed = environment.revise(|environment, slot| placed(told, environment, filter, slot));
    for removed in &removed {
        take_out(filter, channel, removed);
        changes.forgotten += 1;
    }
    if !told.config.discovery {
        return changes;
    }
    for (outcome, claims) in outcomes {
        let scan = outcome.scan;
        let Some(sight) = told.sight(scan.anchor) else { continue };
        let Some((viewpoint, background)) =
            discovery_view(told, filter, clutter, scan.anchor, &outcome.expected.direct)
        else {
            continue;
        };
        discovery.observe(
            scan.anchor,
            &viewpoint,
            &scan.measurements,
            claims,
            &outcome.beliefs.unassociated,
            &background,
            outcome.expected.regressions().map(|regression| regression.range_m),
            scan.resolution_m(),
        );
        while let Some(found) = discovery.take_resolved(scan.anchor) {
            let admission = environment.admit(
                scan.anchor,
                sight.anchor_m,
                found.position,
                |environment, slot| placed(told, environment, filter, slot),
                |environment| detections_anywhere(told, scan, environment, channel).1,
            );
            match admission {
                Admission::Known => {}
                Admission::Full => changes.map_full += 1,
                Admission::Entered { surface, replaced, .. } => {
                    if let Some(replaced) = replaced {
                        take_out(filter, channel, &replaced);
                        changes.forgotten += 1;
                    }
                    filter.insert_relative(surface, found.position, &found.gain, &found.covariance);
                    changes.discovered += 1;
                }
            }
        }
    }
    // Cycles in which nothing is heard change nothing.
    if outcomes.is_empty() {
        return changes;
    }
    if let Some(joined) = join(filter, environment, told.anchors, told.config.ranging.max_range_m) {
        changes.joined += 1;
        if let Some(removed) = joined.removed {
            take_out(filter, channel, &removed);
        }
    }
    changes
}

/// Where the image of a source is.
fn placed<const ANCHORS: usize, const SURFACES: usize, const SOURCES: usize, const ACTIONS: usize>(
    told: &Told<'_, ANCHORS, ACTIONS>,
    environment: &EnvironmentMemory<SURFACES, SOURCES>,
    filter: &StateFilter<ANCHORS, SURFACES>,
    slot: usize,
) -> Option<Placed> {
    let record = environment.get(slot)?;
    filter.placed(told.anchors.get(record.anchor)?.position_m, &record.sequence)
}

/// Takes a source out of the state and out of the channel memory.
fn take_out<const ANCHORS: usize, const SURFACES: usize, const SOURCES: usize, const ACTIONS: usize>(
    filter: &mut StateFilter<ANCHORS, SURFACES>,
    channel: &mut ChannelMemory<ANCHORS, SOURCES, ACTIONS>,
    removed: &Removed,
) {
    for surface in removed.surfaces.into_iter().flatten() {
        filter.remove(surface);
    }
    channel.forget(removed.slot);
}
