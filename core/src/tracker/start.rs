//! What is told before the start: virtual anchors and a plan become surfaces and sources.

use crate::config::Config;
use crate::error::{Error, Setting};
use crate::memory::environment::{EnvironmentMemory, Origin, TOLD};
use crate::model::anchor::{Anchor, MappedVirtualAnchor};
use crate::model::image::Sequence;
use crate::model::listing::{Listed, list};
use crate::model::plan::{FloorPlan, Map, Plan, Wall};
use crate::model::surface::Surface;
use crate::perceptor::state_filter::StateFilter;
use crate::radio::library::{Action, Library};
use heapless::Vec;
use nalgebra::Vector2;

/// The bound that these capacities break, if there is one.
#[allow(clippy::too_many_arguments)] // each is a capacity
pub(super) const fn broken_bound(
    anchors: usize,
    surfaces: usize,
    segments: usize,
    paths: usize,
    actions: usize,
    components: usize,
    points: usize,
    frames: usize,
) -> Option<&'static str> {
    if anchors == 0 {
        Some("ANCHORS is 0: a tracker has one anchor at least")
    } else if surfaces > 256 {
        Some("SURFACES is above 256: the slot of a surface is a byte")
    } else if segments > 65_535 {
        Some("SEGMENTS is above 65535: the index of a wall has two bytes")
    } else if paths == 0 {
        Some("PATHS is 0: a scan has one measurement at least")
    } else if paths > 32 {
        Some("PATHS is above 32: sets of paths have 32 bits")
    } else if actions == 0 {
        Some("ACTIONS is 0: a radio has one action at least")
    } else if components == 0 {
        Some("COMPONENTS is 0: a belief has one component at least")
    } else if points > 65_535 {
        Some("POINTS is above 65535: their count has two bytes in a snapshot")
    } else if frames > 1 {
        Some("FRAMES is above 1: one channel estimator serves all anchors")
    } else {
        None
    }
}

/// Checks and keeps what is told, and returns the first action; there are so many surfaces and sources.
///
/// # Errors
/// The first value out of range; what is kept means nothing then.
#[inline(never)]
pub(super) fn take_in<const ANCHORS: usize, const SEGMENTS: usize, const ACTIONS: usize>(
    config: &Config,
    anchors: &[Anchor],
    map: &Map<'_>,
    actions: &[Action],
    (surfaces, sources): (usize, usize),
    (kept, plan, library): (&mut Vec<Anchor, ANCHORS>, &mut FloorPlan<SEGMENTS>, &mut Library<ACTIONS>),
) -> Result<Action, Error> {
    kept.clear();
    plan.clear();
    config.validate()?;
    library.start(actions)?;
    let Some(first) = library.get(config.controller.first_action) else {
        return Err(Error::Configuration(Setting::FirstAction));
    };
    if config.controller.rendezvous.is_some_and(|rendezvous| library.get(rendezvous).is_none()) {
        return Err(Error::Configuration(Setting::Rendezvous));
    }
    if anchors.is_empty() {
        return Err(Error::AnchorCount { given: 0, limit: ANCHORS });
    }
    for (index, anchor) in anchors.iter().enumerate() {
        anchor.check(index)?;
        kept.push(*anchor).map_err(|_| Error::AnchorCount { given: anchors.len(), limit: ANCHORS })?;
    }
    if config.has_heading && surfaces == 0 {
        return Err(Error::Configuration(Setting::Heading));
    }
    let given = map.virtual_anchors.len();
    let limit = surfaces.saturating_sub(usize::from(config.has_heading)).min(sources);
    if given > limit {
        return Err(Error::VirtualAnchorCount { given, limit });
    }
    for (slot, mapped) in map.virtual_anchors.iter().enumerate() {
        mapped.check(slot, anchors.len())?;
    }
    if let Some(told) = &map.plan {
        plan.keep(told)?;
    }
    Ok(*first)
}

/// Enters the heading of the tag's body, in the last slot: no surface of the map takes its place.
#[inline(never)]
pub(super) fn enter_heading<const ANCHORS: usize, const SURFACES: usize, const SOURCES: usize>(
    filter: &mut StateFilter<ANCHORS, SURFACES>,
    environment: &mut EnvironmentMemory<SURFACES, SOURCES>,
    turns_per_s: f32,
) {
    if filter.insert_heading(turns_per_s) {
        environment.insert_surface(SURFACES - 1, TOLD, Origin::Plan);
    }
}

/// Enters virtual anchors told by their positions, each with a private surface, in order from the first slots.
#[inline(never)]
pub(super) fn enter_virtual_anchors<const ANCHORS: usize, const SURFACES: usize, const SOURCES: usize>(
    filter: &mut StateFilter<ANCHORS, SURFACES>,
    environment: &mut EnvironmentMemory<SURFACES, SOURCES>,
    virtual_anchors: &[MappedVirtualAnchor],
    is_exact: bool,
) {
    for (slot, mapped) in virtual_anchors.iter().enumerate() {
        let std_m = if is_exact { 0.0 } else { mapped.std_m };
        let [x, y] = mapped.position_m;
        filter.insert_independent(slot, Surface::Private, Vector2::new(x, y), [std_m; 2]);
        environment.insert_surface(slot, TOLD, Origin::Position);
        environment.insert(slot, mapped.anchor, Sequence::of(slot as u8), 0);
    }
}

/// Enters the sources that a plan shows, the most useful first, with the walls that they are reflected by; `pulse_m` is the length
/// of the shortest pulse.
#[inline(never)]
pub(super) fn enter_plan<
    const ANCHORS: usize,
    const SURFACES: usize,
    const SOURCES: usize,
    const SEGMENTS: usize,
>(
    filter: &mut StateFilter<ANCHORS, SURFACES>,
    environment: &mut EnvironmentMemory<SURFACES, SOURCES>,
    plan: &mut FloorPlan<SEGMENTS>,
    told: &Plan<'_>,
    anchors: &[Anchor],
    config: &Config,
    pulse_m: f32,
) {
    let free_surfaces = (0..SURFACES).filter(|slot| filter.surface(*slot).is_none()).count();
    let room = SOURCES.saturating_sub(environment.iter().count()).min(told.most_sources);
    let range_m = config.ranging.max_range_m;
    let listed = list::<SEGMENTS, SOURCES>(plan, anchors, told.reflections, range_m, pulse_m, free_surfaces);
    for &Listed { anchor, first, second, is_either_order, .. } in listed.iter().take(room) {
        let mut surface = |wall: usize| surface_of(filter, environment, plan, wall, config.exact_map);
        let Some(first) = surface(first) else { continue };
        let second = match second {
            None => None,
            Some(second) => {
                let Some(second) = surface(second) else { continue };
                Some(second)
            }
        };
        let Some(slot) = environment.free_slot() else { break };
        environment.insert(slot, anchor, Sequence { first, second, is_either_order }, 0);
    }
    if !config.exact_map {
        let [mx, my] = plan.middle_m();
        let turn = told.turn_std_rad;
        let variance = turn * turn;
        filter.correlate(variance, |slot, _| {
            // A turn about the middle shifts a wall along its normal by n . J (c - m).
            let Some(wall) = plan.wall_of(slot).and_then(|wall| plan.walls().get(wall)) else {
                return [0.0; 2];
            };
            let ([cx, cy], [nx, ny]) = (wall.line.centre_m, wall.line.normal);
            [ny * (cx - mx) - nx * (cy - my), 1.0]
        });
    }
}

/// A state that knows no more than it was told of the tag, of the walls of the plan that it has surfaces for, and of the heading.
#[inline(never)]
pub(super) fn told_filter<const ANCHORS: usize, const SURFACES: usize, const SEGMENTS: usize>(
    config: &Config,
    range_biases_m: &[[f32; 2]; ANCHORS],
    plan: &FloorPlan<SEGMENTS>,
) -> StateFilter<ANCHORS, SURFACES> {
    let Config { start, ranging, .. } = config;
    let mut filter = StateFilter::new(
        config.motion,
        ranging.max_range_m,
        start.position_m,
        start.position_std_m,
        start.velocity_std_m_s,
        ranging.bias_mean_m,
        ranging.bias_std_m,
    );
    for (anchor, [mean_m, std_m]) in range_biases_m.iter().enumerate() {
        filter.tell_bias(anchor, *mean_m, *std_m);
    }
    if config.has_heading {
        filter.insert_heading(config.belief.turns_per_s);
    }
    for Wall { line, told, surface, .. } in plan.walls() {
        if let Some(slot) = *surface {
            let std = if config.exact_map { [0.0; 2] } else { [told.offset_std_m, told.rotation_std_rad] };
            filter.insert_independent(usize::from(slot), Surface::Wall(*line), Vector2::new(0.0, 0.0), std);
        }
    }
    filter
}

/// The slot of a wall's surface, which is entered where it is not yet; `None` where there is no room.
fn surface_of<const ANCHORS: usize, const SURFACES: usize, const SOURCES: usize, const SEGMENTS: usize>(
    filter: &mut StateFilter<ANCHORS, SURFACES>,
    environment: &mut EnvironmentMemory<SURFACES, SOURCES>,
    plan: &mut FloorPlan<SEGMENTS>,
    wall: usize,
    is_exact: bool,
) -> Option<u8> {
    let Wall { line, told, surface, .. } = *plan.walls().get(wall)?;
    if surface.is_some() {
        return surface;
    }
    let slot = filter.free_slot()?;
    let std = if is_exact { [0.0; 2] } else { [told.offset_std_m, told.rotation_std_rad] };
    filter.insert_independent(slot, Surface::Wall(line), Vector2::new(0.0, 0.0), std);
    environment.insert_surface(slot, TOLD, Origin::Plan);
    plan.assign(wall, slot as u8);
    Some(slot as u8)
}

#[cfg(test)]
mod tests {
    use super::broken_bound;

    #[test]
    fn capacities_out_of_bounds_are_named() {
        const LEAST: [usize; 8] = [1, 0, 0, 1, 1, 1, 0, 0];
        let broken = |index: usize, value: usize| {
            let mut sizes = LEAST;
            sizes[index] = value;
            let [anchors, surfaces, segments, paths, actions, components, points, frames] = sizes;
            broken_bound(anchors, surfaces, segments, paths, actions, components, points, frames)
        };
        assert_eq!(broken(0, 1), None);
        let bounds = [
            (0, "ANCHORS", [None, Some(0)]),
            (1, "SURFACES", [Some(256), Some(257)]),
            (2, "SEGMENTS", [Some(65_535), Some(65_536)]),
            (3, "PATHS", [Some(32), Some(33)]),
            (3, "PATHS", [None, Some(0)]),
            (4, "ACTIONS", [None, Some(0)]),
            (5, "COMPONENTS", [None, Some(0)]),
            (6, "POINTS", [Some(65_535), Some(65_536)]),
            (7, "FRAMES", [Some(1), Some(2)]),
        ];
        for (index, name, [most, beyond]) in bounds {
            assert!(most.is_none_or(|most| broken(index, most).is_none()), "{name}");
            let said = beyond.and_then(|beyond| broken(index, beyond)).unwrap();
            assert!(said.starts_with(name), "{said}");
        }
    }
}
