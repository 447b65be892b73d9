//! The stages of a cycle that join the states of several blocks.

use super::joining::join;
use super::values::{
    Known, Place, Seen, Told, detections_anywhere, discovery_view, leader_view, planning_state, walls_now,
};
use crate::controller::{Controller, Controllers, Decision};
use crate::memory::channel::ChannelMemory;
use crate::memory::clutter::ClutterMemory;
use crate::memory::discovery::{Claims, Discovery};
use crate::memory::environment::{Admission, EnvironmentMemory, Placed, Removed};
use crate::memory::lateness::LatenessMemory;
use crate::memory::transmission::TransmissionMemory;
use crate::model::availability::Walls;
use crate::model::lateness::Lateness;
use crate::model::plan::FloorPlan;
use crate::model::work::{LOOK, UPDATE, Work};
use crate::perceptor::association::outcome::{
    AssociatedScan, NormalisedInnovation, Outcomes, associate_scan,
};
use crate::perceptor::belief::proposal::{Landmark, PROPOSED, Proposal, STRONG, Sweep, propose};
use crate::perceptor::belief::{TagBelief, anywhere};
use crate::perceptor::below_threshold::{Reader, missed};
use crate::perceptor::receiver::{Receiver, Scans};
use crate::perceptor::scan::Scan;
use crate::perceptor::state_filter::StateFilter;
use crate::report::MapChanges;
use heapless::Vec;

/// What the candidates for new virtual anchors claim of every scan that has an outcome.
pub(super) type Claimed<const ANCHORS: usize, const PATHS: usize, const CANDIDATES: usize> =
    Vec<Claims<PATHS, CANDIDATES>, ANCHORS>;

/// How much of the strong paths of a cycle is explained.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Explained {
    /// Ranges, and paths that hardly any false alarm is as strong as.
    pub(super) strong: f32,
    /// Of those, how many are expected to belong to a known source.
    pub(super) known: f32,
}

impl Explained {
    /// With a scan more.
    pub(super) fn with<const SOURCES: usize, const PATHS: usize>(
        mut self,
        outcome: &AssociatedScan<'_, SOURCES, PATHS>,
    ) -> Self {
        for (measurement, free) in outcome.scan.measurements.iter().zip(&outcome.beliefs.unassociated) {
            if measurement.is_strong(STRONG) {
                self.strong += 1.0;
                self.known += 1.0 - free;
            }
        }
        self
    }
}

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
    #[inline(never)]
    pub(super) fn of<const ANCHORS: usize, const SOURCES: usize, const PATHS: usize>(
        outcomes: &Outcomes<'_, ANCHORS, SOURCES, PATHS>,
    ) -> Self {
        let mut heard = Self::default();
        let mut innovation = NormalisedInnovation::default();
        outcomes.each(|outcome| {
            innovation.add(outcome);
            let (measurements, associated) = outcome.counts();
            heard.anchors += 1;
            heard.measurements += measurements;
            heard.associated += associated;
        });
        heard.nis = innovation.mean();
        heard
    }
}

/// What an anchor's candidates claim of its scan as the leader sees them, which becomes the last that is claimed; by how much they make each
/// measurement more probable than clutter alone.
#[inline(never)]
pub(super) fn claim<
    const ANCHORS: usize,
    const SURFACES: usize,
    const PATHS: usize,
    const ACTIONS: usize,
    const CANDIDATES: usize,
>(
    discovery: &Discovery<ANCHORS, CANDIDATES>,
    told: &Told<'_, ANCHORS, ACTIONS>,
    leader: &StateFilter<ANCHORS, SURFACES>,
    clutter: &ClutterMemory<ANCHORS>,
    scan: &Scan<PATHS>,
    claimed: &mut Claimed<ANCHORS, PATHS, CANDIDATES>,
) -> Option<[f32; PATHS]> {
    if CANDIDATES == 0 {
        return Some([1.0; PATHS]);
    }
    let (viewpoint, background) = &leader_view(told, leader, clutter, scan.anchor)?;
    let claims = discovery.claim(scan.anchor, viewpoint, &scan.measurements, background);
    let totals = claims.totals();
    // As many as scans: the push succeeds.
    let _ = claimed.push(claims);
    Some(totals)
}

/// What reads the rest of the frame in a scan; `None` where that is not kept.
pub(super) fn reader<
    'a,
    const ANCHORS: usize,
    const PATHS: usize,
    const ACTIONS: usize,
    const POINTS: usize,
    const FRAMES: usize,
>(
    told: &Told<'_, ANCHORS, ACTIONS>,
    receiver: &'a Receiver<ANCHORS, PATHS, POINTS, FRAMES>,
    clutter: &'a ClutterMemory<ANCHORS>,
    scan: &Scan<PATHS>,
) -> Option<Reader<'a, POINTS>> {
    let share = told.config.ranging.share(scan.since_frame_s());
    Some(Reader::new(scan, receiver.residual(scan)?, clutter.background(scan.anchor), share))
}

/// What is left of the frames where nothing is expected.
#[inline(never)]
pub(super) fn look_beside<
    const ANCHORS: usize,
    const SOURCES: usize,
    const PATHS: usize,
    const ACTIONS: usize,
    const POINTS: usize,
    const FRAMES: usize,
>(
    clutter: &mut ClutterMemory<ANCHORS>,
    told: &Told<'_, ANCHORS, ACTIONS>,
    receiver: &Receiver<ANCHORS, PATHS, POINTS, FRAMES>,
    outcomes: &Outcomes<'_, ANCHORS, SOURCES, PATHS>,
) {
    outcomes.each(|outcome| {
        let scan = outcome.scan;
        let background = reader(told, receiver, clutter, scan).and_then(|reader| reader.background(outcome));
        if let Some(background) = background {
            clutter.observe_background(scan.anchor, &background, scan.since_frame_s());
        }
    });
}

/// Updates a state by a scan, and by what is left of its frame where sources were missed; ln of how much more probable that is than
/// where there are none.
#[inline(never)]
fn update<
    const ANCHORS: usize,
    const SURFACES: usize,
    const SOURCES: usize,
    const PATHS: usize,
    const POINTS: usize,
>(
    filter: &mut StateFilter<ANCHORS, SURFACES>,
    outcome: &mut AssociatedScan<'_, SOURCES, PATHS>,
    reader: Option<&Reader<'_, POINTS>>,
    work: &mut Work,
) -> f32 {
    let innovations = outcome.innovations().inspect(|_| work.add(UPDATE, 1));
    let Some(reader) = reader else {
        filter.update(innovations);
        return 0.0;
    };
    let mut looks = reader.begin();
    filter.update_and_read(innovations, missed(outcome), |source, range_m, variance_m2| {
        looks.look(&source, range_m, variance_m2)
    });
    work.add(LOOK, looks.count());
    looks.note(&mut outcome.beliefs)
}

/// Compares all components with a scan and updates them by it; `claims` says how much more probable candidates make each of its
/// measurements. What the heaviest of them makes of it becomes the last of the outcomes, and is shown; `None` where no component expects
/// anything.
#[inline(never)]
#[allow(clippy::too_many_arguments)] // each is a state, or what it is told
pub(super) fn hear<
    'a,
    const ANCHORS: usize,
    const SURFACES: usize,
    const SOURCES: usize,
    const SEGMENTS: usize,
    const PATHS: usize,
    const ACTIONS: usize,
    const COMPONENTS: usize,
    const POINTS: usize,
>(
    belief: &mut TagBelief<ANCHORS, SURFACES, COMPONENTS>,
    told: &Told<'_, ANCHORS, ACTIONS>,
    environment: &EnvironmentMemory<SURFACES, SOURCES>,
    channel: &ChannelMemory<ANCHORS, SOURCES, ACTIONS>,
    clutter: &ClutterMemory<ANCHORS>,
    lateness: &Lateness,
    (plan, walls): (&FloorPlan<SEGMENTS>, &Walls<'_, SEGMENTS>),
    (scan, reader): (&'a Scan<PATHS>, Option<&Reader<'_, POINTS>>),
    claims: &[f32; PATHS],
    outcomes: &mut Outcomes<'a, ANCHORS, SOURCES, PATHS>,
    work: &mut Work,
    show: impl FnOnce(&AssociatedScan<'a, SOURCES, PATHS>),
) -> Option<()> {
    // The one outcome at hand: it takes kilobytes.
    let mut outcome = AssociatedScan::of(scan);
    let mut most = None;
    let mut is_kept = false;
    let mode = told.config.association.mode;
    let settings = *belief.settings();
    for component in belief.components_mut() {
        let known = Known { filter: &component.filter, environment, channel, plan, walls };
        if known.expect(told, scan, &mut outcome.expected, work).is_none() {
            is_kept = false;
            continue;
        }
        outcome.expected.delay(*lateness);
        let outage = component.outages.predict(scan.anchor, scan.elapsed_s, &settings);
        associate_scan(&mut outcome, claims, &clutter.clutter(scan.anchor), outage, mode);
        component.outages.set(scan.anchor, outcome.beliefs.outage);
        component.weight_nat += outcome.beliefs.evidence_nat;
        work.add_all(outcome.beliefs.work);
        component.weight_nat += update(&mut component.filter, &mut outcome, reader, work);
        is_kept = most.is_none_or(|most| component.weight_nat > most);
        if is_kept {
            outcomes.keep(&outcome);
            most = Some(component.weight_nat);
        }
    }
    belief.reduce();
    most?;
    if !is_kept {
        outcomes.last(&mut outcome);
    }
    let evidence_nat = anywhere::evidence_nat(
        outcome.expected.paths(),
        &scan.measurements,
        &clutter.clutter(scan.anchor),
        told.config.ranging.max_range_m,
    );
    belief.hear_anywhere(scan.anchor, scan.elapsed_s, evidence_nat);
    show(&outcome);
    Some(())
}

/// Places that the scans propose.
#[inline(never)]
#[allow(clippy::too_many_arguments)] // each is a state, or what it is told
pub(super) fn propose_places<
    const ANCHORS: usize,
    const SURFACES: usize,
    const SOURCES: usize,
    const SEGMENTS: usize,
    const PATHS: usize,
    const ACTIONS: usize,
>(
    trusted: &StateFilter<ANCHORS, SURFACES>,
    told: &Told<'_, ANCHORS, ACTIONS>,
    environment: &EnvironmentMemory<SURFACES, SOURCES>,
    channel: &ChannelMemory<ANCHORS, SOURCES, ACTIONS>,
    clutter: &ClutterMemory<ANCHORS>,
    plan: &FloorPlan<SEGMENTS>,
    scans: &Scans<ANCHORS, PATHS>,
    turn: [f32; 2],
    work: &mut Work,
) -> Vec<Proposal, PROPOSED> {
    let mut sweeps: Vec<Sweep<'_, PATHS>, ANCHORS> = Vec::new();
    let mut landmarks: Vec<Vec<Landmark, SOURCES>, ANCHORS> = Vec::new();
    let mut direct: Vec<Landmark, ANCHORS> = Vec::new();
    for scan in scans {
        let (Some(sight), Some(bias)) = (told.sight(scan.anchor), trusted.bias_m(scan.anchor)) else {
            continue;
        };
        let (seen, detections) = detections_anywhere(told, scan, environment, channel);
        let mut images = Vec::new();
        for slot in environment.images_of(scan.anchor) {
            let record = environment.get(slot);
            let placed = record.and_then(|record| trusted.placed(sight.anchor_m, &record.sequence));
            if let (Some((at, c)), Some(detection)) = (placed, detections.get(slot)) {
                // One per slot: the push succeeds.
                let _ = images.push(Landmark {
                    position_m: [at.x, at.y],
                    covariance_m2: [c.m11, c.m21, c.m22],
                    detection: environment.existence(slot) * detection,
                });
            }
        }
        // As many as scans: the pushes succeed.
        let _ = landmarks.push(images);
        let _ =
            direct.push(Landmark { position_m: sight.anchor_m, covariance_m2: [0.0; 3], detection: seen });
        let clutter = clutter.clutter(scan.anchor);
        let _ = sweeps.push(Sweep::new(&scan.measurements, sight.height_m, bias, clutter));
    }
    propose(
        &sweeps,
        |sweep| direct.get(sweep).into_iter().chain(landmarks.get(sweep).into_iter().flatten()).copied(),
        |place_m, std_m| plan.inside(place_m, std_m),
        turn,
        work,
    )
}

/// Ends the update of the belief: nobody walks through the walls of the plan, where they `bar` ways, or out of its outline.
#[inline(never)]
pub(super) fn conclude<
    const ANCHORS: usize,
    const SURFACES: usize,
    const SOURCES: usize,
    const SEGMENTS: usize,
    const COMPONENTS: usize,
>(
    belief: &mut TagBelief<ANCHORS, SURFACES, COMPONENTS>,
    environment: &EnvironmentMemory<SURFACES, SOURCES>,
    plan: &FloorPlan<SEGMENTS>,
    bar: bool,
) {
    let barrier = &walls_now(plan, belief.leader(), environment, bar, |_| 0.0);
    belief.conclude(
        |from_m, to_m, std_m| barrier.paths(from_m, to_m, std_m).direct(),
        |place_m, std_m| plan.inside(place_m, std_m),
    );
}

/// Learns from what was `earned` in the cycle, plans with the sources as they are seen from where the tag is, and chooses the next
/// action.
#[inline(never)]
pub(super) fn act<
    const ANCHORS: usize,
    const SURFACES: usize,
    const SOURCES: usize,
    const SEGMENTS: usize,
    const PATHS: usize,
    const ACTIONS: usize,
>(
    controllers: &mut Controllers<ANCHORS, ACTIONS>,
    known: &Known<'_, ANCHORS, SURFACES, SOURCES, SEGMENTS, ACTIONS>,
    told: &Told<'_, ANCHORS, ACTIONS>,
    earned: f32,
    (is_searching, is_lost): (bool, impl Fn(usize) -> bool),
    scans: &Scans<ANCHORS, PATHS>,
    (threshold, elapsed_s): (f32, f32),
) -> Decision {
    let agent = known.filter.agent();
    let state = &planning_state(told.config, &agent, threshold, elapsed_s);
    let place = Place::of(&agent);
    // With one action there is nothing to plan.
    let seen =
        if ACTIONS > 1 { Seen::new(known.visible(told, place)) } else { Seen::<ANCHORS, SOURCES>::NONE };
    controllers.decide(earned, is_searching, is_lost, scans, state, seen.iter(), known.channel, told.library)
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
    const POINTS: usize,
    const FRAMES: usize,
>(
    environment: &mut EnvironmentMemory<SURFACES, SOURCES>,
    channel: &mut ChannelMemory<ANCHORS, SOURCES, ACTIONS>,
    clutter: &mut ClutterMemory<ANCHORS>,
    lateness: &mut LatenessMemory<ANCHORS>,
    receiver: &mut Receiver<ANCHORS, PATHS, POINTS, FRAMES>,
    told: &Told<'_, ANCHORS, ACTIONS>,
    is_lost: impl Fn(usize) -> bool,
    (is_searching, is_sure): (bool, bool),
    controllers: &Controllers<ANCHORS, ACTIONS>,
    outcomes: &Outcomes<'_, ANCHORS, SOURCES, PATHS>,
) {
    let library = told.library;
    let is_framed = Receiver::<ANCHORS, PATHS, POINTS, FRAMES>::has_frame;
    let framed = outcomes.scans().filter(|scan| is_framed(scan));
    for scan in framed.filter(|scan| !is_lost(scan.anchor)) {
        // The tag was found: with which action, tells what gain control had hidden.
        if let Some(excess_ln) = receiver.found(scan.anchor) {
            let held = controllers.of(scan.anchor).map_or(0, Controller::held);
            let images = environment.images_of(scan.anchor);
            channel.reattribute(scan.anchor, images, [held, scan.action], excess_ln, library);
        }
    }
    outcomes.each(|outcome| {
        let scan = outcome.scan;
        // What is missing from a doubtful place may be where it was: the tag is not.
        if !is_sure {
            // Under gain control, what is heard with an action that a lost tag is sought with cannot be compared yet.
            if is_framed(scan) && !receiver.is_sought(scan.anchor) {
                channel.observe_frame(outcome, library, false);
            }
        } else {
            environment.observe(outcome);
            for (timing, probability) in outcome.timings() {
                lateness.observe(scan.anchor, &timing, probability);
            }
            if is_framed(scan) {
                channel.observe_frame(outcome, library, true);
            } else {
                channel.observe_ranges(outcome);
            }
        }
        if !is_searching {
            clutter.observe(scan.anchor, outcome.unexplained(), scan.elapsed_s);
        }
    });
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
    outcomes.each(|outcome| {
        let scan = outcome.scan;
        let Some(sight) = told.sight(scan.anchor) else { return };
        let crossing = walls.paths(sight.anchor_m, place.position_m, place.std_m).crossing();
        transmission.observe(crossing, 1.0 - outcome.beliefs.direct.missed, scan.elapsed_s);
    });
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
    const COMPONENTS: usize,
    const CANDIDATES: usize,
>(
    belief: &mut TagBelief<ANCHORS, SURFACES, COMPONENTS>,
    environment: &mut EnvironmentMemory<SURFACES, SOURCES>,
    channel: &mut ChannelMemory<ANCHORS, SOURCES, ACTIONS>,
    discovery: &mut Discovery<ANCHORS, CANDIDATES>,
    clutter: &ClutterMemory<ANCHORS>,
    told: &Told<'_, ANCHORS, ACTIONS>,
    outcomes: &Outcomes<'_, ANCHORS, SOURCES, PATHS>,
    claimed: &Claimed<ANCHORS, PATHS, CANDIDATES>,
) -> MapChanges {
    let mut changes = MapChanges::default();
    let removed = environment.revise(|environment, slot| placed(told, environment, belief.leader(), slot));
    for removed in &removed {
        take_out(belief, channel, removed);
        changes.forgotten += 1;
    }
    if CANDIDATES == 0 || !told.config.discovery {
        return changes;
    }
    let mut claimed = claimed.iter();
    outcomes.each(|outcome| {
        let scan = outcome.scan;
        let (Some(claims), Some(sight)) = (claimed.next(), told.sight(scan.anchor)) else { return };
        let Some((viewpoint, background)) =
            discovery_view(told, belief.leader(), clutter, scan.anchor, &outcome.expected.direct)
        else {
            return;
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
                |environment, slot| placed(told, environment, belief.leader(), slot),
                |environment| detections_anywhere(told, scan, environment, channel).1,
            );
            match admission {
                Admission::Known => {}
                Admission::Full => changes.map_full += 1,
                Admission::Entered { slot, surface, replaced } => {
                    if let Some(replaced) = replaced {
                        take_out(belief, channel, &replaced);
                        changes.forgotten += 1;
                    }
                    // A free slot ages as well.
                    channel.forget(slot);
                    belief.discover(surface, found.position, &found.gain, &found.covariance);
                    changes.discovered += 1;
                }
            }
        }
    });
    // Cycles in which nothing is heard change nothing.
    if outcomes.is_empty() {
        return changes;
    }
    let range_m = told.config.ranging.max_range_m;
    if let Some(joined) = belief.revise(|filter| join(filter, environment, told.anchors, range_m)) {
        changes.joined += 1;
        if let Some(removed) = joined.removed {
            take_out(belief, channel, &removed);
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
fn take_out<
    const ANCHORS: usize,
    const SURFACES: usize,
    const SOURCES: usize,
    const ACTIONS: usize,
    const COMPONENTS: usize,
>(
    belief: &mut TagBelief<ANCHORS, SURFACES, COMPONENTS>,
    channel: &mut ChannelMemory<ANCHORS, SOURCES, ACTIONS>,
    removed: &Removed,
) {
    for surface in removed.surfaces.into_iter().flatten() {
        belief.remove(surface);
    }
    channel.forget(removed.slot);
}
