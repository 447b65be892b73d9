//! The stages of a cycle that join the states of several blocks.

use super::joining::join;
use super::values::{Place, Told, detections_anywhere, discovery_view};
use crate::controller::{Controller, Controllers};
use crate::memory::channel::ChannelMemory;
use crate::memory::clutter::ClutterMemory;
use crate::memory::discovery::{Claims, Discovery};
use crate::memory::environment::{Admission, EnvironmentMemory, Placed, Removed};
use crate::memory::transmission::TransmissionMemory;
use crate::model::availability::Walls;
use crate::perceptor::association::outcome::{AssociatedScan, normalised_innovation};
use crate::perceptor::receiver::{Receiver, Scans};
use crate::perceptor::state_filter::StateFilter;
use crate::report::MapChanges;
use heapless::Vec;

/// Every scan with its outcome, and what the candidates for new virtual anchors claim of it.
pub(super) type Outcomes<'a, const ANCHORS: usize, const SOURCES: usize, const PATHS: usize> =
    Vec<(AssociatedScan<'a, SOURCES, PATHS>, Claims<PATHS>), ANCHORS>;

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
    (is_searching, is_sure): (bool, bool),
    controllers: &Controllers<ANCHORS, ACTIONS>,
    outcomes: &Outcomes<'_, ANCHORS, SOURCES, PATHS>,
) {
    let library = told.library;
    let framed = outcomes.iter().map(|(outcome, _)| outcome.scan).filter(|scan| scan.is_framed());
    for scan in framed.filter(|_| !is_searching) {
        // The tag was found: with which action, tells what gain control had hidden.
        if let Some(excess_ln) = receiver.found(scan.anchor) {
            let held = controllers.of(scan.anchor).map_or(0, Controller::held);
            let images = environment.images_of(scan.anchor);
            channel.reattribute(scan.anchor, images, [held, scan.action], excess_ln, library);
        }
    }
    for (outcome, _) in outcomes {
        let scan = outcome.scan;
        clutter.keep(scan, &outcome.beliefs.unassociated);
        // What is missing from a doubtful place may be where it was: the tag is not.
        if !is_sure {
            // Under gain control, what is heard with an action that a lost tag is sought with cannot be compared yet.
            if !receiver.is_sought(scan.anchor) {
                channel.observe(outcome, library, false);
            }
        } else {
            environment.observe(outcome);
            channel.observe(outcome, library, true);
        }
        if !is_searching {
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
    if !told.config.discovery || crate::knob::knob(22) > 0.0 {
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
