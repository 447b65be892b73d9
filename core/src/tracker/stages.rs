//! The stages of a cycle that join the states of several blocks.

use super::values::{Known, Told};
use crate::controller::{Controller, Controllers};
use crate::memory::channel::ChannelMemory;
use crate::memory::clutter::ClutterMemory;
use crate::memory::discovery::{Claims, Discovery};
use crate::memory::environment::{Admission, EnvironmentMemory};
use crate::model::motion::{Agent, ProcessNoise};
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
pub(super) type Outcomes<'a, const ANCHORS: usize, const VAS: usize, const PATHS: usize> =
    Vec<(AssociatedScan<'a, VAS, PATHS>, Claims<PATHS>), ANCHORS>;

/// Every scan with what it is expected to show.
pub(super) type Expected<'a, const ANCHORS: usize, const VAS: usize, const PATHS: usize> =
    Vec<(&'a Scan<PATHS>, Expectations<VAS>), ANCHORS>;

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
    pub(super) fn of<const ANCHORS: usize, const VAS: usize, const PATHS: usize>(
        outcomes: &Outcomes<'_, ANCHORS, VAS, PATHS>,
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
pub(super) fn locate<const ANCHORS: usize, const VAS: usize, const PATHS: usize, const ACTIONS: usize>(
    belief: &mut TagBelief<ANCHORS>,
    told: &Told<'_, ANCHORS, ACTIONS>,
    known: &Known<'_, ANCHORS, VAS, ACTIONS>,
    scans: &Scans<ANCHORS, PATHS>,
) -> Option<Agent> {
    let acquisition = belief.acquisition()?;
    let settings = &told.config.association;
    let per_m = 1.0 / told.config.ranging.max_range_m;
    let mut detections: Vec<(f32, [f32; VAS]), ANCHORS> = Vec::new();
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
            let (a, c) = known.filter.virtual_anchor(slot)?;
            Some(Landmark {
                position_m: [a.x, a.y],
                covariance_m2: [c.m11, c.m21, c.m22],
                height_m,
                height_std_m,
                detection: record.existence * detection?.1.get(slot)?,
            })
        }))
    };
    belief.locate(sweeps, landmarks)
}

/// What every scan is expected to show at the predicted state, which is widened where a manoeuvre explains the scans far
/// better than the motion as configured does.
#[inline(never)]
pub(super) fn expect<'a, const ANCHORS: usize, const VAS: usize, const PATHS: usize, const ACTIONS: usize>(
    filter: &mut StateFilter<ANCHORS, VAS>,
    told: &Told<'_, ANCHORS, ACTIONS>,
    environment: &EnvironmentMemory<VAS>,
    channel: &ChannelMemory<ANCHORS, VAS, ACTIONS>,
    clutter: &ClutterMemory<ANCHORS>,
    scans: &'a Scans<ANCHORS, PATHS>,
    manoeuvre_over_s: Option<f32>,
) -> Expected<'a, ANCHORS, VAS, PATHS> {
    let known = Known { filter, environment, channel, clutter };
    let expected = known.expect_all(told, scans);
    let Some(elapsed_s) = manoeuvre_over_s.filter(|_| is_suspicious(&expected)) else { return expected };
    let motion_nat = total_evidence_nat(&expected, clutter);
    let predicted = filter.agent_covariance();
    let speed_m_s = told.config.start.velocity_std_m_s;
    filter.disturb(&ProcessNoise::of_turn(speed_m_s * speed_m_s, elapsed_s));
    let known = Known { filter, environment, channel, clutter };
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
fn is_suspicious<const ANCHORS: usize, const VAS: usize, const PATHS: usize>(
    expected: &Expected<'_, ANCHORS, VAS, PATHS>,
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
fn total_evidence_nat<const ANCHORS: usize, const VAS: usize, const PATHS: usize>(
    expected: &Expected<'_, ANCHORS, VAS, PATHS>,
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
    const VAS: usize,
    const PATHS: usize,
    const ACTIONS: usize,
>(
    told: &Told<'_, ANCHORS, ACTIONS>,
    known: &Known<'_, ANCHORS, VAS, ACTIONS>,
    discovery: &Discovery<ANCHORS>,
    expected: &'a Expected<'a, ANCHORS, VAS, PATHS>,
    observer: &mut impl Observer<VAS, PATHS>,
) -> Outcomes<'a, ANCHORS, VAS, PATHS> {
    let mut outcomes = Vec::new();
    for (scan, expected) in expected {
        let view = known.discovery_view(told, scan.anchor, &expected.direct);
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
pub(super) fn remember<const ANCHORS: usize, const VAS: usize, const PATHS: usize, const ACTIONS: usize>(
    environment: &mut EnvironmentMemory<VAS>,
    channel: &mut ChannelMemory<ANCHORS, VAS, ACTIONS>,
    clutter: &mut ClutterMemory<ANCHORS>,
    receiver: &mut Receiver<ANCHORS, PATHS>,
    told: &Told<'_, ANCHORS, ACTIONS>,
    belief: &TagBelief<ANCHORS>,
    controllers: &Controllers<ANCHORS, ACTIONS>,
    outcomes: &Outcomes<'_, ANCHORS, VAS, PATHS>,
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

/// The life of virtual anchors: forgets improbable ones, gives what nothing explained to the candidates, and takes resolved
/// candidates into the map.
#[inline(never)]
pub(super) fn revise_map<const ANCHORS: usize, const VAS: usize, const PATHS: usize, const ACTIONS: usize>(
    filter: &mut StateFilter<ANCHORS, VAS>,
    environment: &mut EnvironmentMemory<VAS>,
    channel: &mut ChannelMemory<ANCHORS, VAS, ACTIONS>,
    discovery: &mut Discovery<ANCHORS>,
    clutter: &ClutterMemory<ANCHORS>,
    told: &Told<'_, ANCHORS, ACTIONS>,
    outcomes: &Outcomes<'_, ANCHORS, VAS, PATHS>,
) -> MapChanges {
    let mut changes = MapChanges::default();
    for slot in environment.revise(|slot| filter.virtual_anchor(slot)) {
        filter.remove(slot);
        channel.forget(slot);
        changes.forgotten += 1;
    }
    if !told.config.discovery {
        return changes;
    }
    for (outcome, claims) in outcomes {
        let scan = outcome.scan;
        let Some(sight) = told.sight(scan.anchor) else { continue };
        let known = Known { filter, environment, channel, clutter };
        let Some((viewpoint, background)) = known.discovery_view(told, scan.anchor, &outcome.expected.direct)
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
                |slot| filter.virtual_anchor(slot),
                |environment| {
                    Known { filter, environment, channel, clutter }.detections_anywhere(told, scan).1
                },
            );
            match admission {
                Admission::Known => {}
                Admission::Full => changes.map_full += 1,
                Admission::Entered { slot, replaced } => {
                    if replaced {
                        filter.remove(slot);
                        channel.forget(slot);
                        changes.forgotten += 1;
                    }
                    filter.insert_relative(slot, found.position, &found.gain, &found.covariance);
                    changes.discovered += 1;
                }
            }
        }
    }
    changes
}
