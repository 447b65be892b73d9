//! The sources that a plan shows: which images are worth keeping, found from the plan alone.
//!
//! An image's worth is the share of the places in the outline that see it, and half of that over two reflections, because
//! those are detected about half as often (0.14 instead of 0.25 in simulated rooms). Walls are limited first: each is a
//! surface that all anchors share, worth the sum of what its single reflections are worth to them.
//!
//! Work: availability of A W + A V^2 images at no more than 100 places each, of A anchors, W walls and V of them that are
//! used: 13,000 paths at 2 and 8, all used; 75,000 at 8 anchors, 30 walls and 8 used.

use super::anchor::Anchor;
use super::availability::{WallNow, Walls};
use super::plan::{FloorPlan, Wall};
use crate::real::{TAU, abs, limited, sin, smaller, sqrt};
use heapless::Vec;

/// Capacity: places that are looked from.
const MOST_PLACES: usize = 100;
/// Tuned: what a wall lets through while sources are listed.
pub const THROUGH: f32 = 0.4;
/// Tuned: deviation of a place while sources are listed, metres.
pub const PLACE_STD_M: f32 = 0.05;
/// Tuned: availability above which a place sees an image.
const SEEN: f32 = 0.3;
/// Tuned: an image that no more than this share of the places sees is not worth its work.
const LEAST_SHARE: f32 = 0.02;
/// Tuned: worth of two reflections over that of one; see above.
const SECOND_WORTH: f32 = 0.5;
/// Mathematics: two walls are at right angles where so many deviations of their rotations explain the rest.
const RIGHT_ANGLE_DEVIATIONS: f32 = 4.0;
/// Guard: against two images of one corner whose rotations are told as exact, radians.
const RIGHT_ANGLE_RAD: f32 = 1e-3;
/// Guard: against an image that is the anchor itself, metres.
const NO_IMAGE_M: f32 = 1e-3;

/// A source worth keeping.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Listed {
    /// Index of its anchor.
    pub anchor: usize,
    /// Index of the wall that reflects first, from the anchor.
    pub first: usize,
    /// Index of the wall that reflects after it.
    pub second: Option<usize>,
    /// Whether the two may come in either order: at right angles to each other they make one image.
    pub is_either_order: bool,
    /// Share (0 to 1) of the places in the outline that see it.
    pub seen_share: f32,
}

impl Listed {
    /// What lists are ordered by.
    fn worth(&self) -> f32 {
        if self.second.is_some() { SECOND_WORTH * self.seen_share } else { self.seen_share }
    }
}

/// The sources most worth keeping, over up to `reflections` of at most `most_walls` walls and within `max_range_m` of the places
/// that see them; the best first, equal ones by anchor, first and second wall (none before any).
pub fn list<const SEGMENTS: usize, const SOURCES: usize>(
    plan: &FloorPlan<SEGMENTS>,
    anchors: &[Anchor],
    reflections: usize,
    max_range_m: f32,
    most_walls: usize,
) -> Vec<Listed, SOURCES> {
    let mut list = Vec::new();
    if reflections == 0 {
        return list;
    }
    let view = View {
        plan,
        walls: Walls::new(plan, |_, wall| WallNow::told(wall, THROUGH)),
        places_m: places_m(plan),
        max_range_m,
    };
    let walls = view.used_walls(anchors, most_walls);
    for (anchor, Anchor { position_m, .. }) in anchors.iter().enumerate() {
        for &first in &walls {
            let mut add = |second, is_either_order| {
                let seen_share = view.seen_share(*position_m, first, second, is_either_order);
                if seen_share > LEAST_SHARE {
                    insert(&mut list, Listed { anchor, first, second, is_either_order, seen_share });
                }
            };
            add(None, false);
            if reflections == 1 {
                continue;
            }
            for &second in walls.iter().filter(|second| **second != first) {
                let is_either_order = view.is_right_angle(first, second);
                if !is_either_order || first < second {
                    add(Some(second), is_either_order);
                }
            }
        }
    }
    list
}

/// Puts a source behind those worth as much, and drops the last where there is no room.
fn insert<const SOURCES: usize>(list: &mut Vec<Listed, SOURCES>, mut source: Listed) {
    let mut is_placed = false;
    for slot in list.iter_mut() {
        is_placed = is_placed || source.worth() > slot.worth();
        if is_placed {
            core::mem::swap(slot, &mut source);
        }
    }
    let _ = list.push(source);
}

/// What is seen from where.
struct View<'a, const SEGMENTS: usize> {
    plan: &'a FloorPlan<SEGMENTS>,
    walls: Walls<'a, SEGMENTS>,
    places_m: Vec<[f32; 2], MOST_PLACES>,
    max_range_m: f32,
}

impl<const SEGMENTS: usize> View<'_, SEGMENTS> {
    /// The walls to be used, in the plan's order: of more than `most` those that are seen reflecting the most widely, of equal
    /// ones the first.
    fn used_walls(&self, anchors: &[Anchor], most: usize) -> Vec<usize, SEGMENTS> {
        let all = 0..self.plan.walls().len();
        if all.len() <= most {
            return all.collect();
        }
        let worth = |wall| -> f32 {
            anchors.iter().map(|anchor| self.seen_share(anchor.position_m, wall, None, false)).sum()
        };
        let worths: Vec<f32, SEGMENTS> = all.map(worth).collect();
        let before = |(wall, own): (usize, &f32)| {
            worths
                .iter()
                .enumerate()
                .filter(|(n, other)| *other > own || (*other == own && *n < wall))
                .count()
        };
        worths.iter().enumerate().filter(|each| before(*each) < most).map(|(wall, _)| wall).collect()
    }

    /// Share of the places that see the image of `anchor_m`; 0 where it is the anchor itself.
    fn seen_share(
        &self,
        anchor_m: [f32; 2],
        first: usize,
        second: Option<usize>,
        is_either_order: bool,
    ) -> f32 {
        let mirrored = |point_m, wall: usize| {
            self.plan.walls().get(wall).map_or(point_m, |wall: &Wall| wall.line.mirrored_m(point_m))
        };
        let once_m = mirrored(anchor_m, first);
        let image_m = second.map_or(once_m, |second| mirrored(once_m, second));
        if distance2_m2(image_m, anchor_m) < NO_IMAGE_M * NO_IMAGE_M {
            return 0.0;
        }
        let is_seen = |place_m: &&[f32; 2]| {
            let available = match second {
                _ if !(distance2_m2(image_m, **place_m) <= self.max_range_m * self.max_range_m) => 0.0,
                Some(second) if is_either_order => {
                    self.walls.either_order(anchor_m, [first, second], **place_m, PLACE_STD_M).0
                }
                _ => self.walls.reflected(anchor_m, first, second, **place_m, PLACE_STD_M),
            };
            available > SEEN
        };
        let seen = self.places_m.iter().filter(is_seen).count();
        // None is seen from nowhere.
        if seen == 0 { 0.0 } else { seen as f32 / self.places_m.len() as f32 }
    }

    /// Whether two walls may be at right angles.
    fn is_right_angle(&self, first: usize, second: usize) -> bool {
        let (Some(a), Some(b)) = (self.plan.walls().get(first), self.plan.walls().get(second)) else {
            return false;
        };
        let ([ax, ay], [bx, by]) = (a.line.normal, b.line.normal);
        let (ra, rb) = (a.told.rotation_std_rad, b.told.rotation_std_rad);
        let explained_rad = RIGHT_ANGLE_RAD + RIGHT_ANGLE_DEVIATIONS * sqrt(ra * ra + rb * rb);
        abs(ax * bx + ay * by) <= sin(smaller(explained_rad, 0.25 * TAU))
    }
}

/// Places spread evenly over the outline.
fn places_m<const SEGMENTS: usize>(plan: &FloorPlan<SEGMENTS>) -> Vec<[f32; 2], MOST_PLACES> {
    let [[left, bottom], [right, top]] = plan.box_m();
    let (width_m, height_m) = (right - left, top - bottom);
    let most = MOST_PLACES as f32;
    // As near to squares as whole numbers allow.
    let columns = limited(sqrt(most * (width_m / height_m)) + 0.5, 1.0, most) as usize;
    let rows = MOST_PLACES / columns.max(1);
    let mut places_m = Vec::new();
    for row in 0..rows {
        for column in 0..columns {
            let place_m = [
                left + width_m * ((column as f32 + 0.5) / columns as f32),
                bottom + height_m * ((row as f32 + 0.5) / rows as f32),
            ];
            if plan.depth_m(place_m) >= 0.0 {
                // No more than 100: the pushes succeed.
                let _ = places_m.push(place_m);
            }
        }
    }
    places_m
}

fn distance2_m2([ax, ay]: [f32; 2], [bx, by]: [f32; 2]) -> f32 {
    let (dx, dy) = (ax - bx, ay - by);
    dx * dx + dy * dy
}
