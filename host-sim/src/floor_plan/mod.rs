//! The floor plan that a tracker is told, and which virtual anchors follow from it.
//!
//! What a user has is a plan: walls, more or less right, and anchors. [`told`] makes of that what a device is told,
//! without any way through the room: walls with deviations, and the sources that the core lists of them
//! ([`cogmint_core::model::listing`]), each with the image and the deviation that follow from its walls ([`sources`]). In a simulation each
//! wall has an error ([`walls`]), drawn from the seed, so that all images in a wall err together.
//!
//! The published experiments have it otherwise ([`along_way`]): virtual anchors by their strength along the true way, each
//! with an error of its own. `prior.floor_plan.told` says which.
//!
//! In a recording, what is told comes first, in order of use; then the other images that some position of the way sees.

pub mod along_way;
pub mod check;
pub mod export;
pub mod sources;
pub mod walls;

use crate::channel::random::{Purpose, normal, stream};
use crate::channel::{Channel, structure};
use crate::geometry::distance_m;
use crate::input_error::InputError;
use crate::recording::{MAX_SEQUENCE, Plan, PlanWall, VirtualAnchor, WallSequence};
use crate::replay::{SEGMENTS, SOURCES, SURFACES};
use crate::scenario::{self, Construction, Room, Scenario, Told, construction};
use cogmint_core::model::listing::{Listed, list};
use cogmint_core::real::SPEED_OF_LIGHT_M_S;
use serde::Serialize;

/// An image of a wrong plan stands for the room's image of the same order within this distance, metres.
const MATCH_M: f64 = 1.5;
/// Images of one sequence of walls coincide within this, metres, as in [`crate::geometry::image_source`].
const SAME_M: f64 = 0.01;
/// A wall that reflects less, decibels, is one that the plan lacks.
const ABSORBER_DB: f64 = 30.0;
/// An error that would put an anchor on the other side of a wall is drawn again, so often.
const MOST_DRAWS: usize = 1000;

/// The virtual anchors of a recording, and the plan.
#[derive(Clone, Debug)]
pub struct FloorPlan {
    /// All virtual anchors.
    pub virtual_anchors: Vec<VirtualAnchor>,
    /// Per anchor: which of them each of its image sources is, where some position sees it or the plan knows it.
    pub index_of: Vec<Vec<Option<usize>>>,
    /// The plan as it is told, where walls are.
    pub plan: Option<Plan>,
}

/// What a device is told.
#[derive(Clone, Debug, PartialEq)]
pub struct ToldPlan {
    /// Outline and walls, as told.
    pub plan: Plan,
    /// The sources in order of use.
    pub sources: Vec<ToldSource>,
}

/// A source that a device is told of.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ToldSource {
    /// Index of its anchor.
    pub anchor: usize,
    /// The walls that reflect its paths, in order from the anchor outwards; indexes of the plan's.
    pub walls: WallSequence,
    /// Where its image follows from the walls as told, metres.
    pub position_m: [f64; 2],
    /// Standard deviation per axis that follows from the walls' deviations, metres.
    pub std_m: f64,
    /// Whether the two walls may come in either order.
    pub is_either_order: bool,
    /// Share of the outline from which it is seen.
    pub seen_share: f64,
}

/// What a device is told of a scenario's plan: `prior.floor_plan.room`, or the room. With a `seed`, every wall has the
/// error that a recording of that seed tells (none where the plan is exact); without, the plan is told as it stands.
///
/// Nothing but room, anchors, radio, noise and prior enters: no way.
///
/// # Errors
/// A wall's construction is unknown.
pub fn told(scenario: &Scenario, seed: Option<u64>) -> Result<ToldPlan, InputError> {
    Drawn::new(scenario, seed)?.told(scenario)
}

/// The virtual anchors of a channel's recordings, and the plan that they tell.
///
/// # Errors
/// The floor plan's room names something unknown.
pub fn of(channel: &Channel) -> Result<FloorPlan, InputError> {
    let plan = &channel.scenario().prior.floor_plan;
    if plan.told == Told::VirtualAnchors || !plan.known {
        return along_way::of(channel);
    }
    let drawn = Drawn::new(channel.scenario(), Some(channel.seed()))?;
    let ToldPlan { plan, sources } = drawn.told(channel.scenario())?;
    let mut listed = Vec::new();
    let mut index_of: Vec<Vec<Option<usize>>> = (0..channel.scenario().anchors.len())
        .map(|anchor| vec![None; channel.images(anchor).len()])
        .collect();
    for source in sources {
        let (position_m, image, exists) = drawn.truth(channel, &source, &index_of[source.anchor]);
        if let Some(image) = image {
            index_of[source.anchor][image] = Some(listed.len());
        }
        listed.push(VirtualAnchor {
            told_position_m: Some(source.position_m),
            walls: source.walls,
            exists,
            ..VirtualAnchor::new(source.anchor, position_m, source.std_m, true)
        });
    }
    for (anchor, index_of) in index_of.iter_mut().enumerate() {
        for image in along_way::seen(channel, anchor) {
            if index_of[image].is_none() {
                index_of[image] = Some(listed.len());
                let position_m = channel.images(anchor)[image].position_m;
                let walls = drawn.sequences(channel, anchor, image).next().unwrap_or_default();
                listed.push(VirtualAnchor { walls, ..VirtualAnchor::new(anchor, position_m, 0.0, false) });
            }
        }
    }
    Ok(FloorPlan { virtual_anchors: listed, index_of, plan: Some(plan) })
}

/// A plan before and after its errors were drawn.
struct Drawn {
    /// Whether the plan is of another room than the true one.
    is_other_room: bool,
    /// As it stands.
    nominal: Vec<PlanWall>,
    /// As it is told.
    told: Plan,
    /// Wall of the plan that each wall of the room belongs to; none for absorbers.
    wall_of: Vec<Option<usize>>,
}

impl Drawn {
    fn new(scenario: &Scenario, seed: Option<u64>) -> Result<Self, InputError> {
        let settings = &scenario.prior.floor_plan;
        let room = settings.room.as_ref().unwrap_or(&scenario.room);
        let (room_walls, _) = structure(scenario, room)?;
        let names = scenario::walls(room);
        let kept: Vec<usize> =
            (0..names.len()).filter(|&index| !swallows_all(scenario, names[index].1)).collect();
        let segments_m: Vec<[[f64; 2]; 2]> = kept.iter().map(|&index| room_walls[index].ends_m).collect();
        let mut nominal: Vec<PlanWall> = Vec::new();
        let mut told: Vec<PlanWall> = Vec::new();
        let mut wall_of = vec![None; names.len()];
        let mut told_ends_m = vec![None; names.len()];
        for (index, of) in walls::collinear(&segments_m).into_iter().enumerate() {
            let wall = PlanWall {
                segments_m: of.iter().map(|&segment| segments_m[segment]).collect(),
                offset_std_m: settings.wall_offset_std_m(),
                rotation_std_rad: settings.wall_rotation_std_deg.to_radians(),
                construction: names[kept[of[0]]].1.to_owned(),
            };
            let moved = match seed {
                Some(seed) if !settings.exact => drawn(&wall, scenario, seed, index),
                _ => wall.clone(),
            };
            for (&segment, &ends_m) in of.iter().zip(&moved.segments_m) {
                wall_of[kept[segment]] = Some(index);
                told_ends_m[kept[segment]] = Some(ends_m);
            }
            nominal.push(wall);
            told.push(moved);
        }
        Ok(Self {
            is_other_room: settings.room.is_some(),
            nominal,
            told: Plan {
                outline_m: outline_m(room, &told_ends_m),
                turn_std_rad: if settings.exact { 0.0 } else { settings.turn_std_deg.to_radians() },
                reflections: scenario.propagation.reflection_order.min(MAX_SEQUENCE),
                most_sources: settings.max_virtual_anchors,
                walls: told,
            },
            wall_of,
        })
    }

    /// What is told of it: the sources that the core lists, of the plan alone.
    fn told(&self, scenario: &Scenario) -> Result<ToldPlan, InputError> {
        let walls = &self.told.walls;
        let item = if self.is_other_room { "prior.floor_plan.room" } else { "room" };
        let kept = crate::told_plan::ToldPlan::new(&self.told).kept(&scenario.name, item)?;
        let anchor = |anchor: &scenario::Anchor| cogmint_core::Anchor {
            position_m: anchor.position_m.map(|x| x as f32),
            height_m: anchor.height_m as f32,
        };
        let anchors: Vec<_> = scenario.anchors.iter().map(anchor).collect();
        let longest_m = scenario.prior.max_range_m as f32;
        let durations_s = scenario.radio.actions().into_iter().map(|action| action.pulse_duration_s as f32);
        let shortest_s = durations_s.fold(f32::INFINITY, f32::min);
        let listed = list::<SEGMENTS, SOURCES>(
            &kept,
            &anchors,
            self.told.reflections,
            longest_m,
            SPEED_OF_LIGHT_M_S * shortest_s,
            SURFACES,
        );
        let of = |listed: Listed| {
            let sequence: Vec<usize> = std::iter::once(listed.first).chain(listed.second).collect();
            let walls_met = WallSequence::new(&sequence).unwrap_or_default();
            let anchor_m = scenario.anchors[listed.anchor].position_m;
            ToldSource {
                anchor: listed.anchor,
                walls: walls_met,
                position_m: sources::image_m(walls, walls_met, anchor_m),
                std_m: sources::std_m(walls, walls_met, anchor_m),
                is_either_order: listed.is_either_order,
                seen_share: f64::from(listed.seen_share),
            }
        };
        let sources = listed.into_iter().take(self.told.most_sources).map(of).collect();
        Ok(ToldPlan { plan: self.told.clone(), sources })
    }

    /// Where a told image really is, which image of the channel it is, and whether it is there at all. What stands for
    /// another source already (`taken`) does not stand for this one as well.
    fn truth(
        &self,
        channel: &Channel,
        source: &ToldSource,
        taken: &[Option<usize>],
    ) -> ([f64; 2], Option<usize>, bool) {
        let anchor_m = channel.scenario().anchors[source.anchor].position_m;
        let nominal_m = sources::image_m(&self.nominal, source.walls, anchor_m);
        let images = channel.images(source.anchor);
        let away_m = |image: usize| distance_m(images[image].position_m, nominal_m);
        let within = if self.is_other_room { MATCH_M } else { SAME_M };
        let near = (1..images.len()).filter(|&image| {
            let same_walls = !self.is_other_room
                && self.sequences(channel, source.anchor, image).any(|walls| walls == source.walls);
            taken[image].is_none()
                && images[image].order == source.walls.len()
                && (same_walls || away_m(image) < within)
        });
        match near.min_by(|&a, &b| away_m(a).total_cmp(&away_m(b))) {
            Some(image) => (images[image].position_m, Some(image), true),
            // The room's walls make this image also where no light reaches; those of another room do not.
            None => (nominal_m, None, !self.is_other_room),
        }
    }

    /// The sequences of the plan's walls that an image of the true room has, where the plan is of that room.
    fn sequences<'a>(
        &'a self,
        channel: &'a Channel,
        anchor: usize,
        image: usize,
    ) -> impl Iterator<Item = WallSequence> + 'a {
        let ways = if self.is_other_room { &[][..] } else { &channel.images(anchor)[image].sequences[..] };
        ways.iter().filter_map(|way| {
            let walls: Option<Vec<usize>> = way.iter().map(|&wall| self.wall_of[wall]).collect();
            WallSequence::new(&walls?)
        })
    }
}

/// A wall with the error that the seed gives it.
fn drawn(wall: &PlanWall, scenario: &Scenario, seed: u64, index: usize) -> PlanWall {
    let mut rng = stream(seed, Purpose::Walls, &[index]);
    for _ in 0..MOST_DRAWS {
        let offset_m = wall.offset_std_m * normal(&mut rng);
        let rotation_rad = wall.rotation_std_rad * normal(&mut rng);
        let moved = walls::moved(wall, offset_m, rotation_rad);
        // Nobody draws a plan with an anchor in or behind the wall that it hangs on.
        if walls::leaves_on_their_sides(wall, &moved, scenario.anchors.iter().map(|anchor| anchor.position_m))
        {
            return moved;
        }
    }
    wall.clone()
}

/// Whether hardly anything comes back from a construction: a wall that is not there.
fn swallows_all(scenario: &Scenario, name: &str) -> bool {
    match construction::construction(scenario, name) {
        Some(Construction::Flat { reflection_loss_db, .. }) => reflection_loss_db > ABSORBER_DB,
        _ => false,
    }
}

/// The outline as told: each corner in the middle between the ends of its two sides as told.
fn outline_m(room: &Room, told_ends_m: &[Option<[[f64; 2]; 2]>]) -> Vec<[f64; 2]> {
    let sides = room.corners_m.len();
    let corner = |(n, &corner_m): (usize, &[f64; 2])| {
        let before = told_ends_m[(n + sides - 1) % sides].map(|ends| ends[1]);
        let after = told_ends_m[n].map(|ends| ends[0]);
        match (before, after) {
            (Some(a), Some(b)) => [0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])],
            (Some(only), None) | (None, Some(only)) => only,
            (None, None) => corner_m,
        }
    };
    room.corners_m.iter().enumerate().map(corner).collect()
}
