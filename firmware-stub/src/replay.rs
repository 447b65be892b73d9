//! The replay of a feed through a tracker of any size.

use crate::feed::Feed;
use crate::host::{Fault, Line};
use crate::meter::{StageMeter, stack};
use cogmint_core::Tracker;
use cogmint_core::model::observation::Complex;

/// Starts the tracker; how many cycles follow. Apart from the replay, whose stack the set-up would take.
///
/// # Errors
/// The feed is malformed, or what is in it is refused.
#[inline(never)]
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
    feed: &mut Feed,
) -> Result<u32, Fault> {
    let setup = feed.setup::<ANCHORS, SOURCES, SEGMENTS, ACTIONS>().ok_or(Fault::FEED)?;
    tracker
        .start(&setup.config, &setup.anchors, &setup.map(), &setup.actions, setup.seed)
        .map_err(|_| Fault(b"error refused set-up\n"))?;
    for (anchor, [mean_m, std_m]) in setup.range_biases_m.iter().enumerate() {
        tracker.tell_range_bias(anchor, *mean_m, *std_m).map_err(|_| Fault(b"error refused bias\n"))?;
    }
    Ok(setup.cycles)
}

/// Replays the whole feed, and prints for every cycle the hash over all state and the instructions per stage; at the end, how
/// much stack was used since reset.
///
/// # Errors
/// The feed is malformed, what is in it is refused, or something cannot be measured.
pub fn replay<
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
    const OBSERVATIONS: usize,
>(
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
    samples: &mut [Complex],
) -> Result<(), Fault> {
    let mut feed = Feed::open().ok_or(Fault(b"error no feed\n"))?;
    let started = start(tracker, &mut feed);
    // Where it ran into the tracker, that is why it was refused.
    stack::check_guard()?;
    let cycles = started?;
    Line::new().text(b"start stack ").decimal(stack::deepest_from_reset()?).end();
    for cycle in 0..cycles {
        let input = feed.cycle::<ANCHORS, PATHS>(samples).ok_or(Fault(b"error malformed cycle\n"))?;
        let observations = input.observations::<OBSERVATIONS>(samples);
        let mut stages = StageMeter::default();
        tracker.switch_antenna(input.lever_arm_m).map_err(|_| Fault(b"error refused antenna\n"))?;
        tracker
            .cycle_observed(&observations, input.elapsed_s, input.tag_height, &mut stages)
            .map_err(|_| Fault(b"error refused cycle\n"))?;
        let mut line = Line::new();
        line.text(b"cycle ").decimal(cycle).text(b" hash ").hex(tracker.hash());
        for instructions in stages.per_stage()? {
            line.text(b" ").instructions(instructions);
        }
        line.end();
    }
    Line::new()
        .text(b"stack ")
        .decimal(stack::deepest_from_reset()?)
        .text(b" tracker ")
        .decimal(size_of_val(tracker) as u32)
        .text(b" frames ")
        .decimal(size_of_val(samples) as u32)
        .end();
    Ok(())
}
