//! The sources that a plan shows: which images are worth keeping, found from the plan alone.
//!
//! An image's worth is the share of the places in the outline that see it, each counted by the probability that its path is
//! resolved from the direct one there, 1 - exp(-(e / (0.6 p))^2) of the excess e of its length and the length p of the pulse
//! ([`crate::radio::pulse::unresolved`]): an image next to its anchor tells nothing. Heights are left out. Over two reflections
//! half of that counts, because those are detected about half as often (0.14 instead of 0.25 in simulated rooms). Walls are
//! limited first: each is a surface that all anchors share, worth the sum of what its single reflections are worth to them.
//!
//! Work: availability of A W + A V^2 images at no more than 100 places each, of A anchors, W walls and V of them that are
//! used: 13,000 paths at 2 and 8, all used; 75,000 at 8 anchors, 30 walls and 8 used.

use super::anchor::Anchor;
use super::availability::{USUAL_THROUGH, WallNow, Walls};
use super::plan::{FloorPlan, Wall};
use crate::radio::pulse::unresolved;
use crate::real::{TAU, abs, limited, sin, smaller, sqrt};
use heapless::Vec;

/// Capacity: places that are looked from.
const MOST_PLACES: usize = 100;
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
    /// Share (0 to 1) of the places in the outline that see it, each by the probability that it is resolved there.
    pub seen_share: f32,
}

impl Listed {
    /// What lists are ordered by.
    fn worth(&self) -> f32 {
        if self.second.is_some() { SECOND_WORTH * self.seen_share } else { self.seen_share }
    }
}

/// The sources most worth keeping, over up to `reflections` of at most `most_walls` walls and within `max_range_m` of the places
/// that see them, for a shortest pulse that is `pulse_m` long; the best first, equal ones by anchor, first and second wall (none
/// before any).
pub fn list<const SEGMENTS: usize, const SOURCES: usize>(
    plan: &FloorPlan<SEGMENTS>,
    anchors: &[Anchor],
    reflections: usize,
    max_range_m: f32,
    pulse_m: f32,
    most_walls: usize,
) -> Vec<Listed, SOURCES> {
    let mut list = Vec::new();
    if reflections == 0 {
        return list;
    }
    let view = View {
        plan,
        walls: Walls::new(plan, |_, wall| WallNow::told(wall, USUAL_THROUGH)),
        places_m: places_m(plan),
        max_range_m,
        pulse_m,
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
    pulse_m: f32,
}

impl<const SEGMENTS: usize> View<'_, SEGMENTS> {
    /// The walls to be used, in the plan's order: of more than `most` those that are seen reflecting the most widely, of equal
    /// ones the first.
    fn used_walls(&self, anchors: &[Anchor], most: usize) -> Vec<usize, SEGMENTS> {
        let all = self.plan.walls().len();
        let mut worths: Vec<f32, SEGMENTS> = Vec::new();
        for wall in 0..all {
            let mut worth = 0.0;
            if all > most {
                for Anchor { position_m, .. } in anchors {
                    worth += self.seen_share(*position_m, wall, None, false);
                }
            }
            // As many as the plan has: these pushes succeed.
            let _ = worths.push(worth);
        }
        let mut used = Vec::new();
        for (wall, own) in worths.iter().enumerate() {
            let before = |(n, other): &(usize, &f32)| *other > own || (*other == own && *n < wall);
            if worths.iter().enumerate().filter(before).count() < most {
                let _ = used.push(wall);
            }
        }
        used
    }

    /// Share of the places that see the image of `anchor_m`, each by the probability that it is resolved.
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
        let mut seen = 0.0;
        for place_m in &self.places_m {
            let length_m = sqrt(distance2_m2(image_m, *place_m));
            if !(length_m <= self.max_range_m) {
                continue;
            }
            let paths = self.walls.paths(anchor_m, *place_m, PLACE_STD_M);
            let available = match second {
                Some(second) if is_either_order => paths.either_order([first, second]).0,
                _ => paths.reflected(first, second),
            };
            if available > SEEN {
                let excess_m = length_m - sqrt(distance2_m2(anchor_m, *place_m));
                seen += 1.0 - unresolved(excess_m / self.pulse_m);
            }
        }
        // None is seen from nowhere.
        if seen > 0.0 { seen / self.places_m.len() as f32 } else { 0.0 }
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

#[cfg(test)]
mod tests {
    use super::super::plan::{Plan, PlanSegment, PlanWall};
    use super::*;
    use std::collections::BTreeMap;
    use std::vec;

    type Ends = [[f32; 2]; 2];

    const FAR_M: f32 = 1e3;
    const PULSE_M: f32 = 0.15;
    /// Resolves everything.
    const SHORT_M: f32 = 1e-3;
    const EXACT: PlanWall = PlanWall { offset_std_m: 0.0, rotation_std_rad: 0.0 };

    /// A plan of walls of one segment each, the first `corners` of them the outline.
    fn plan(walls: &[Ends], corners: usize, told: PlanWall) -> FloorPlan<16> {
        let segments: vec::Vec<PlanSegment> =
            walls.iter().enumerate().map(|(wall, ends_m)| PlanSegment { wall, ends_m: *ends_m }).collect();
        let outline_m: vec::Vec<[f32; 2]> = walls.iter().take(corners).map(|[from, _]| *from).collect();
        FloorPlan::new(&Plan {
            outline_m: &outline_m,
            walls: &vec![told; walls.len()],
            segments: &segments,
            turn_std_rad: 0.0,
            reflections: 2,
            most_sources: 24,
        })
        .unwrap()
    }

    fn around(corners_m: &[[f32; 2]]) -> vec::Vec<Ends> {
        let ahead = corners_m.iter().cycle().skip(1);
        corners_m.iter().zip(ahead).map(|(from, to)| [*from, *to]).collect()
    }

    fn room() -> vec::Vec<Ends> {
        around(&[[0.0, 0.0], [8.0, 0.0], [8.0, 6.0], [0.0, 6.0]])
    }

    fn at(position_m: [f32; 2]) -> Anchor {
        Anchor { position_m, height_m: 0.0 }
    }

    fn walls_of(listed: &[Listed]) -> vec::Vec<(usize, Option<usize>)> {
        listed.iter().map(|source| (source.first, source.second)).collect()
    }

    #[test]
    fn a_rectangle_shows_four_images_and_eight_of_two_reflections() {
        let plan = plan(&room(), 4, EXACT);
        let found = list::<16, 32>(&plan, &[at([2.0, 1.5])], 2, FAR_M, SHORT_M, 8);
        assert_eq!(found.len(), 12);
        // All single reflections are seen from everywhere but the strips that the walls' deviations leave.
        assert!(found.iter().take(4).all(|source| source.second.is_none() && source.seen_share == 1.0));
        let (corners, facing): (vec::Vec<&Listed>, vec::Vec<&Listed>) =
            found.iter().skip(4).partition(|source| source.is_either_order);
        let pairs = |sources: &[&Listed]| {
            let mut pairs: vec::Vec<_> =
                sources.iter().map(|source| (source.first, source.second.unwrap())).collect();
            pairs.sort_unstable();
            pairs
        };
        assert_eq!(pairs(&corners), [(0, 1), (0, 3), (1, 2), (2, 3)]);
        assert_eq!(pairs(&facing), [(0, 2), (1, 3), (2, 0), (3, 1)]);
        // Equal ones in order; of one reflection alone; none.
        assert_eq!(walls_of(&found[..4]), [(0, None), (1, None), (2, None), (3, None)]);
        assert_eq!(list::<16, 32>(&plan, &[at([2.0, 1.5])], 1, FAR_M, SHORT_M, 8).as_slice(), &found[..4]);
        assert!(list::<16, 32>(&plan, &[at([2.0, 1.5])], 0, FAR_M, SHORT_M, 8).is_empty());
        // What there is room for is the best of it.
        assert_eq!(list::<16, 7>(&plan, &[at([2.0, 1.5])], 2, FAR_M, SHORT_M, 8).as_slice(), &found[..7]);
    }

    #[test]
    fn two_walls_that_may_be_at_right_angles_make_one_image() {
        let skew = around(&[[0.0, 0.0], [8.0, 0.0], [8.3, 6.0], [0.0, 6.0]]);
        let pairs = |rotation_std_rad| {
            let plan = plan(&skew, 4, PlanWall { offset_std_m: 0.1, rotation_std_rad });
            let found = list::<16, 32>(&plan, &[at([2.0, 1.5])], 2, FAR_M, PULSE_M, 8);
            found.iter().filter(|source| source.first + source.second.unwrap_or(9) == 1).count()
        };
        // Off by 0.05 radians: four deviations of two rotations of 0.01 explain 0.057.
        assert_eq!((pairs(0.0), pairs(0.008), pairs(0.01)), (2, 2, 1));
    }

    #[test]
    fn what_no_place_sees_is_not_listed() {
        let mut walls = room();
        // Two walls across the whole room: of what is behind them nothing is left of 0.4 twice, there and back.
        walls.push([[5.0, 0.0], [5.0, 6.0]]);
        walls.push([[6.0, 0.0], [6.0, 6.0]]);
        let found = list::<16, 64>(&plan(&walls, 4, EXACT), &[at([2.0, 1.5])], 1, FAR_M, PULSE_M, 8);
        assert_eq!(found.iter().filter(|source| source.first == 1).count(), 0);
        assert_eq!(found.iter().filter(|source| source.first == 4).count(), 1);
        // Far images likewise: this one is 18 m from the left wall, 10 m from the right one.
        let empty = plan(&room(), 4, EXACT);
        let single = |max_range_m| list::<16, 64>(&empty, &[at([2.0, 3.0])], 1, max_range_m, PULSE_M, 8);
        assert!(single(FAR_M).iter().any(|source| source.first == 1));
        assert!(!single(6.0).iter().any(|source| source.first == 1));
        let half = single(10.0).iter().find(|source| source.first == 1).unwrap().seen_share;
        assert!((0.4..0.6).contains(&half), "{half}");
        // An anchor on a wall has no image in it that can be told from the direct path; nearby, none that can be at many places.
        let found = list::<16, 64>(&empty, &[at([2.0, 0.0])], 1, FAR_M, PULSE_M, 8);
        assert_eq!(walls_of(&found), [(1, None), (2, None), (3, None)]);
        let near = |off_m, pulse_m| {
            let found = list::<16, 64>(&empty, &[at([2.0, off_m])], 1, FAR_M, pulse_m, 8);
            found.iter().find(|source| source.first == 0).map_or(0.0, |source| source.seen_share)
        };
        let shares = [0.02, 0.05, 0.1, 0.3, 1.0].map(|off_m| near(off_m, PULSE_M));
        assert!(shares.windows(2).all(|pair| pair[0] <= pair[1]), "{shares:?}");
        assert!(shares[0] < 0.15 && shares[4] > 0.95, "{shares:?}");
        assert!(near(0.1, 4.0 * PULSE_M) < 0.5 * near(0.1, PULSE_M));
    }

    #[test]
    fn only_so_many_walls_are_used_and_those_are_seen_most() {
        let mut walls = room();
        walls.push([[3.0, 3.0], [3.5, 3.0]]);
        let plan = plan(&walls, 4, EXACT);
        let anchors = [at([2.0, 1.5]), at([6.0, 4.0])];
        let found = list::<16, 64>(&plan, &anchors, 2, FAR_M, PULSE_M, 4);
        assert!(found.iter().all(|source| source.first != 4 && source.second != Some(4)));
        assert_eq!(found.len(), 24);
        assert!(list::<16, 64>(&plan, &anchors, 2, FAR_M, PULSE_M, 5).iter().any(|source| source.first == 4));
        assert!(list::<16, 64>(&plan, &anchors, 2, FAR_M, PULSE_M, 0).is_empty());
    }

    /// Whether an image is seen: mirrored ends of the walls instead of mirrored anchors, the ray from the anchor; f64.
    fn is_seen(walls: &[Ends], anchor_m: [f32; 2], met: &[usize], place_m: [f32; 2]) -> bool {
        type Point = [f64; 2];
        let wide = |[x, y]: [f32; 2]| [f64::from(x), f64::from(y)];
        let cross = |[ax, ay]: Point, [bx, by]: Point| ax * by - ay * bx;
        let less = |[ax, ay]: Point, [bx, by]: Point| [ax - bx, ay - by];
        let mirrored = |[a, b]: [Point; 2], point: Point| {
            let (along, way) = (less(b, a), less(point, a));
            let off = cross(along, way) / (along[0] * along[0] + along[1] * along[1]);
            [point[0] + 2.0 * off * along[1], point[1] - 2.0 * off * along[0]]
        };
        let share = |[p, q]: [Point; 2], [a, b]: [Point; 2]| {
            let (d, e) = (less(q, p), less(b, a));
            let (u, v) = (cross(less(a, p), e) / cross(d, e), cross(less(a, p), d) / cross(d, e));
            (u > 0.0 && u < 1.0 && v > 0.0 && v < 1.0).then_some(u)
        };
        // The world unfolded: behind each wall that is met everything is mirrored, so that the ray is straight.
        let mut world: vec::Vec<[Point; 2]> = walls.iter().map(|ends| ends.map(wide)).collect();
        let mut worlds = vec![world.clone()];
        let (from, mut to) = (wide(anchor_m), wide(place_m));
        let mut folds = vec![];
        for wall in met {
            let fold = world[*wall];
            folds.push(fold);
            world = world.iter().map(|ends| ends.map(|end| mirrored(fold, end))).collect();
            worlds.push(world.clone());
        }
        for fold in met.iter().rev() {
            to = mirrored(walls[*fold].map(wide), to);
        }
        let (mut begin, mut blocks) = (0.0, 0);
        for (n, world) in worlds.iter().enumerate() {
            let end = match folds.get(n) {
                Some(fold) => match share([from, to], *fold) {
                    Some(end) if end > begin => end,
                    _ => return false,
                },
                None => 1.0,
            };
            let blocked = world.iter().enumerate().filter(|(wall, _)| {
                n.checked_sub(1).and_then(|n| met.get(n)) != Some(wall) && met.get(n) != Some(wall)
            });
            let crossed = blocked.filter_map(|(_, ends)| share([from, to], *ends));
            blocks += crossed.filter(|at| *at > begin && *at < end).count();
            begin = end;
        }
        // One wall lets through 0.4, two less than what counts as seen.
        blocks < 2
    }

    /// Probability that an image is resolved from the direct path, from the length of the path folded at its walls; f64.
    fn resolved(walls: &[Ends], anchor_m: [f32; 2], met: &[usize], place_m: [f32; 2]) -> f64 {
        let wide = |[x, y]: [f32; 2]| [f64::from(x), f64::from(y)];
        // The tag is mirrored, by the last wall first.
        let image = met.iter().rev().fold(wide(place_m), |[x, y], wall| {
            let [[ax, ay], [bx, by]] = walls[*wall].map(wide);
            let (dx, dy) = (bx - ax, by - ay);
            let off = (dx * (y - ay) - dy * (x - ax)) / (dx * dx + dy * dy);
            [x + 2.0 * off * dy, y - 2.0 * off * dx]
        });
        let length = |[x, y]: [f64; 2]| (x - wide(anchor_m)[0]).hypot(y - wide(anchor_m)[1]);
        let lag = (length(image) - length(wide(place_m))) / f64::from(PULSE_M);
        1.0 - (-(lag / 0.6).powi(2)).exp()
    }

    #[test]
    fn the_list_of_an_l_is_that_of_tracing_every_ray() {
        let corners = [[0.0, 0.0], [9.0, 0.0], [9.0, 4.0], [4.0, 4.0], [4.0, 8.0], [0.0, 8.0]];
        let mut walls = around(&corners);
        walls.push([[1.0, 5.5], [2.5, 5.0]]);
        let plan = plan(&walls, 6, EXACT);
        let anchors = [at([1.2, 7.1]), at([7.3, 0.08])];
        let found = list::<16, 128>(&plan, &anchors, 2, FAR_M, PULSE_M, 16);
        let shares: BTreeMap<(usize, usize, Option<usize>), f32> = found
            .iter()
            .map(|source| ((source.anchor, source.first, source.second), source.seen_share))
            .collect();
        // Of the box of 9 m by 8 m a finer grid than the core's.
        let grid = (0..90).flat_map(|x| (0..80).map(move |y| [0.1 * x as f32 + 0.05, 0.1 * y as f32 + 0.05]));
        let places: vec::Vec<[f32; 2]> = grid.filter(|[x, y]| (*x > 0.0 && *y < 4.0) || *x < 4.0).collect();
        let mut compared = 0;
        for (anchor, Anchor { position_m, .. }) in anchors.iter().enumerate() {
            for first in 0..7 {
                for second in core::iter::once(None).chain((0..7).map(Some)) {
                    let is_corner =
                        second.is_some_and(|second| (first + second) % 2 == 1 && first.max(second) < 6);
                    if second == Some(first) || (is_corner && second < Some(first)) {
                        continue;
                    }
                    let met: vec::Vec<usize> = core::iter::once(first).chain(second).collect();
                    let back: vec::Vec<usize> = met.iter().rev().copied().collect();
                    let seen = places.iter().filter(|place_m| {
                        is_seen(&walls, *position_m, &met, **place_m)
                            || (is_corner && is_seen(&walls, *position_m, &back, **place_m))
                    });
                    let seen: f64 = seen.map(|place_m| resolved(&walls, *position_m, &met, *place_m)).sum();
                    let exact = (seen / places.len() as f64) as f32;
                    let ours = shares.get(&(anchor, first, second)).copied().unwrap_or(0.0);
                    assert!((ours - exact).abs() < 0.12, "{anchor} {met:?}: {ours} {exact}");
                    // Not listed is only what hardly any place sees.
                    assert!(ours > 0.0 || exact < 0.07, "{anchor} {met:?}: {exact}");
                    compared += usize::from(exact > 0.1);
                }
            }
        }
        assert!(compared > 20, "{compared}");
        let worths: vec::Vec<f32> = found.iter().map(Listed::worth).collect();
        assert!(worths.windows(2).all(|pair| pair[0] >= pair[1]));
    }
}
