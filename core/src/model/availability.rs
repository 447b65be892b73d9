//! Availability: how probable it is that the walls let a path through to a place.
//!
//! A path is there where every reflection falls on a segment of its wall and no other wall is in between. Both are soft: the
//! tag is known to within a deviation s per axis, a wall to within s_w. For a leg from an exact point to the tag that meets a
//! wall at the share f of its way, h across and g along the wall, the meeting's deviation along the wall is
//!
//! sqrt((f s)^2 + s_w^2) min(sqrt(1 + (g / h)^2), 4),
//!
//! f s (1, g / h) being the slopes over the tag's position, and the wall's ends as uncertain as the wall itself. A reflection is
//! met on the way from the mirror image, so that both cases are one.
//!
//! Two points are on one side of a wall by the normal distribution of the distance of each over its own deviation and the
//! wall's. An anchor hangs in the room, and so does what its paths come from where an image stands near a wall: by a wall of the
//! outline they count as `SURE` deviations of the wall farther on the inside, so that they are inside unless surely outside.
//! By a partition they are on either side as their distance says.
//!
//! What the reflections of a path depend on counts by its least probability: in a corner, on which side of one wall a path is
//! and whether it meets the other are the same question. Walls that are crossed count as independent, by the product.
//!
//! Many legs are asked for at every place: roots of sums of squares are formed to within 4 %, and the normal distribution by a
//! polynomial, to within 0.015.

use super::plan::{FloorPlan, Inside, Segment, Wall};
use super::surface::Line;
use crate::real::{abs, larger, limited, smaller};
use core::cell::Cell;
use heapless::Vec;

/// Guard: against certainty where a wall is told as exact: its least deviation, metres. Walls are thick.
pub const LEAST_STD_M: f32 = 0.05;
/// Mathematics: deviations beyond which the normal distribution counts as 0 or 1. The quintic step of this width comes
/// closest to it.
const SURE: f32 = 2.5;
/// Guard: against meetings without a place, of legs along a wall: most that the angle multiplies their deviation by.
const MOST_OBLIQUE: f32 = 4.0;
/// Guard: against division by nothing, of a path along a wall: what is added to its way across it, metres.
const LEAST_ACROSS_M: f32 = 1e-3;
/// Guard: against work for what nobody sees: availability below this is 0.
const LEAST: f32 = 0.01;
/// Guard: against overflow: largest deviation, metres.
const MOST_STD_M: f32 = 1e4;
/// Tuned: share of direct paths that are found behind one wall, over those found behind none: 0.32 / 0.58 over twelve rooms of
/// others, and less behind two.
pub const USUAL_THROUGH: f32 = 0.35;
/// Tuned: a wall is surely crossed above this share, surely not crossed below what is left of 1.
const CLEAR: f32 = 0.9;

/// A wall as it stands now, with what it lets through.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WallNow {
    /// Its line, shifted and turned as it is believed to be.
    pub line: Line,
    /// Standard deviation of where that is, metres; 0.05 at least is taken.
    pub std_m: f32,
    /// Share of detection (0 to 1) that it leaves to a path that crosses it.
    pub through: f32,
}

impl WallNow {
    /// A wall where the plan tells it.
    pub fn told(wall: &Wall, through: f32) -> Self {
        Self { line: wall.line, std_m: wall.told.offset_std_m, through }
    }
}

/// The walls of a plan as they stand now. Walls are named by their index in the plan.
#[derive(Clone, Debug)]
pub struct Walls<'a, const SEGMENTS: usize> {
    walls: Vec<Standing<'a>, SEGMENTS>,
    /// Whether they hide paths, and end where the plan tells.
    hide: bool,
}

/// A wall as it stands, with its segments.
#[derive(Clone, Debug)]
struct Standing<'a> {
    now: WallNow,
    segments: &'a [Segment],
    /// Half the way from where the first of them begins to where the last one ends, about the line's centre, metres.
    half_m: f32,
    /// Distance at which a point without deviation is surely on one side, metres.
    reach_m: f32,
}

/// The walls that a direct path crosses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Crossing {
    /// Surely none.
    None,
    /// Surely this one, and no other.
    One(usize),
    /// Several, or it is not sure.
    Unclear,
}

/// The paths from an anchor to a place, by which walls whatever they are reflected.
#[derive(Clone, Debug)]
pub struct Paths<'a, const SEGMENTS: usize> {
    walls: &'a Walls<'a, SEGMENTS>,
    anchor: Corner,
    tag: Corner,
    beside: Vec<Beside<'a>, SEGMENTS>,
    /// Legs that may have crossed a wall, of all paths asked for.
    legs: Cell<u32>,
}

/// A corner of a path: an end of it or a reflection.
#[derive(Clone, Copy, Debug)]
struct Corner {
    at_m: [f32; 2],
    /// Deviation of that per axis, metres.
    std_m: f32,
}

/// Mathematics: the bit of a path's first corner, the anchor.
const ANCHOR: u8 = 1;
/// Mathematics: that of its first reflection.
const FIRST: u8 = 2;
/// Mathematics: that of its second one.
const SECOND: u8 = 4;
/// Mathematics: that of its end, the tag.
const TAG: u8 = 8;

/// A wall as it lies to both ends of all paths, its normal turned to the tag's side.
#[derive(Clone, Copy, Debug)]
struct Beside<'a> {
    wall: &'a Standing<'a>,
    normal: [f32; 2],
    /// Points x with normal . x from here on are surely on the tag's side, metres.
    from_m: f32,
    /// Points up to here are surely on the other, metres.
    to_m: f32,
    /// Which of anchor and tag are surely on the tag's side, as bits of their corners.
    before: u8,
    /// Likewise on the other.
    behind: u8,
}

impl<'a, const SEGMENTS: usize> Walls<'a, SEGMENTS> {
    /// The walls of `plan`, each by its index and as told to `now`.
    #[inline(always)] // built where it stays
    pub fn new(plan: &'a FloorPlan<SEGMENTS>, now: impl Fn(usize, &Wall) -> WallNow) -> Self {
        let mut walls = Vec::new();
        for (index, wall) in plan.walls().iter().enumerate() {
            let WallNow { line, std_m, through } = now(index, wall);
            let (std_m, through) = (limited(std_m, LEAST_STD_M, MOST_STD_M), limited(through, 0.0, 1.0));
            let now = WallNow { line, std_m, through };
            // As many as in the plan: the pushes succeed.
            let (segments, half_m, reach_m) = (plan.segments_of(wall), wall.half_length_m, SURE * std_m);
            let _ = walls.push(Standing { now, segments, half_m, reach_m });
        }
        Self { walls, hide: true }
    }

    /// From now on every path is available if its walls are there at all.
    pub fn open(&mut self) {
        self.hide = false;
    }

    /// The paths from an anchor to a place known within `std_m` per axis.
    #[inline(always)] // likewise
    pub fn paths(&self, anchor_m: [f32; 2], place_m: [f32; 2], std_m: f32) -> Paths<'_, SEGMENTS> {
        let std_m = limited(std_m, 0.0, MOST_STD_M);
        let (anchor, tag) = (Corner { at_m: anchor_m, std_m: 0.0 }, Corner { at_m: place_m, std_m });
        let mut paths = Paths { walls: self, anchor, tag, beside: Vec::new(), legs: Cell::new(0) };
        if SEGMENTS > 0 {
            self.look(&mut paths.beside, anchor_m, &tag);
        }
        paths
    }

    /// How every wall lies to an anchor and a tag.
    #[inline(never)]
    fn look<'s>(&'s self, all: &mut Vec<Beside<'s>, SEGMENTS>, anchor_m: [f32; 2], tag: &Corner) {
        for wall in &self.walls {
            let Line { centre_m: [cx, cy], normal: [nx, ny] } = wall.now.line;
            let tag_m = wall.now.line.distance_m(tag.at_m);
            let sign = if tag_m < 0.0 { -1.0 } else { 1.0 };
            let side_m = sign * wall.side_m(anchor_m, wall.now.line.distance_m(anchor_m));
            // No corner of a path is less sure than the tag.
            let reach_m = SURE * tag.std_m + wall.reach_m;
            let own_m = sign * (nx * cx + ny * cy);
            // As many as walls: the pushes succeed.
            let _ = all.push(Beside {
                wall,
                normal: [sign * nx, sign * ny],
                from_m: own_m + reach_m,
                to_m: own_m - reach_m,
                before: ANCHOR * u8::from(side_m >= wall.reach_m) + TAG * u8::from(sign * tag_m >= reach_m),
                behind: ANCHOR * u8::from(side_m <= -wall.reach_m),
            });
        }
    }
}

impl<const SEGMENTS: usize> Paths<'_, SEGMENTS> {
    /// Availability (0 to 1) of the direct path: the product over all walls of what each lets through.
    pub fn direct(&self) -> f32 {
        if SEGMENTS == 0 || !self.walls.hide {
            return 1.0;
        }
        self.through(&[self.anchor, self.tag, self.tag, self.tag], ANCHOR, [usize::MAX; 2]).0
    }

    /// Availability (0 to 1) of the path reflected by wall `first` and then, where there is one, by wall `second`; 0 below 0.01,
    /// and where there is no such wall.
    pub fn reflected(&self, first: usize, second: Option<usize>) -> f32 {
        self.traced(first, second).0
    }

    /// Availability of a reflected path, and the least probability of being on the walls' right sides; 0 for both where the path
    /// is given up before.
    #[inline(never)]
    fn traced(&self, first: usize, second: Option<usize>) -> (f32, f32) {
        let walls = &self.walls.walls;
        let last = second.unwrap_or(first);
        let (Some(wall), Some(last_wall)) = (walls.get(first), walls.get(last)) else { return (0.0, 0.0) };
        let mut corners = [self.anchor, self.tag, self.tag, self.tag];
        if !self.walls.hide {
            return (1.0, 0.0);
        }
        let [anchor, outer, inner, _] = &mut corners;
        let image_m = if second.is_some() { wall.now.line.mirrored_m(anchor.at_m) } else { anchor.at_m };
        let [mut sides, mut within] = last_wall.bounce(image_m, inner);
        *outer = *inner;
        let mut legs = ANCHOR | SECOND;
        if second.is_some() && smaller(sides, within) >= LEAST {
            let [side, own] = wall.bounce(anchor.at_m, outer);
            (sides, within) = (smaller(sides, side), smaller(within, own));
            legs |= FIRST;
        }
        let mut available = smaller(sides, within);
        if available >= LEAST {
            available *= self.through(&corners, legs, [first, last]).0;
        }
        (if available < LEAST { 0.0 } else { available }, sides)
    }

    /// Share that all walls let through to a path with these corners, two of them on these walls, of its legs those from the
    /// corners whose bits are set, and which walls those cross; in the walls' order, and for each along the path.
    #[inline(never)]
    fn through(&self, corners: &[Corner; 4], legs: u8, [first, second]: [usize; 2]) -> (f32, Crossing) {
        let [_, Corner { at_m: [ax, ay], .. }, Corner { at_m: [bx, by], .. }, _] = *corners;
        let (mut through, mut crossing) = (1.0, Crossing::None);
        for (index, beside) in self.beside.iter().enumerate() {
            let Beside { wall, normal: [nx, ny], from_m, to_m, .. } = *beside;
            let (a_m, b_m) = (nx * ax + ny * ay, nx * bx + ny * by);
            if beside.before == ANCHOR + TAG && a_m >= from_m && b_m >= from_m {
                continue;
            }
            let bits = |a: bool, b: bool| u32::from(FIRST) * u32::from(a) + u32::from(SECOND) * u32::from(b);
            let before = u32::from(beside.before) | bits(a_m >= from_m, b_m >= from_m);
            let behind = u32::from(beside.behind) | bits(a_m <= to_m, b_m <= to_m);
            // A leg by the bit of its first corner. Those that end on the wall do not cross it.
            let mut left = u32::from(legs) & !((before & (before >> 1)) | (behind & (behind >> 1)));
            if index == first {
                left &= !u32::from(ANCHOR | FIRST);
            }
            if index == second {
                left &= !u32::from(FIRST | SECOND);
            }
            let surely = (before & (behind >> 1)) | (behind & (before >> 1));
            while left != 0 {
                let leg = left.trailing_zeros() as usize;
                left &= left - 1;
                self.legs.set(self.legs.get().wrapping_add(1));
                let Some([from, to]) = corners.get(leg..leg + 2) else { break };
                let crossed = wall.crossed(from, leg == 0, to, surely & (1 << leg) != 0);
                if crossed > 0.0 {
                    through *= 1.0 - crossed * (1.0 - wall.now.through);
                    if legs == ANCHOR && crossed > 1.0 - CLEAR {
                        let is_only = crossed > CLEAR && crossing == Crossing::None;
                        crossing = if is_only { Crossing::One(index) } else { Crossing::Unclear };
                    }
                }
            }
        }
        (through, crossing)
    }

    /// Availability (0 to 1) of an image that two walls make in either order, and whether it is rather the reversed order,
    /// `second` first, that the path takes: seen from the tag, the ray to the image meets that wall first to which the tag is
    /// nearer, as a share of the anchor's distance. Where the sides of that order are sure, the other one does not count.
    pub fn either_order(&self, [first, second]: [usize; 2]) -> (f32, bool) {
        let (Some(a), Some(b)) = (self.walls.walls.get(first), self.walls.walls.get(second)) else {
            return (0.0, false);
        };
        let away_m = |wall: &Standing<'_>, end: &Corner| wall.now.line.distance_m(end.at_m);
        let is_reversed = abs(away_m(a, &self.tag) * away_m(b, &self.anchor))
            < abs(away_m(b, &self.tag) * away_m(a, &self.anchor));
        let [outer, inner] = if is_reversed { [second, first] } else { [first, second] };
        let (available, sides) = self.traced(outer, Some(inner));
        if sides >= 1.0 {
            return (available, is_reversed);
        }
        let (other, _) = self.traced(inner, Some(outer));
        (smaller(available + other, 1.0), is_reversed)
    }

    /// How often a leg was near enough to a wall to be compared with it, in all that was asked so far.
    pub fn legs(&self) -> u32 {
        self.legs.get()
    }

    /// The walls that the direct path crosses.
    pub fn crossing(&self) -> Crossing {
        if SEGMENTS == 0 {
            return Crossing::None;
        }
        self.through(&[self.anchor, self.tag, self.tag, self.tag], ANCHOR, [usize::MAX; 2]).1
    }
}

impl Standing<'_> {
    /// How far a point of this distance from the line, an anchor or where its path seems to come from, counts as before the
    /// wall, metres: it is in the room, and the plan tells on which side that is.
    #[inline(always)] // most are far
    fn side_m(&self, at_m: [f32; 2], away_m: f32) -> f32 {
        if abs(away_m) < 2.0 * self.reach_m { away_m + self.told_side_m(at_m) } else { away_m }
    }

    /// By how much it counts as farther on the side of the outline's inside, metres.
    #[inline(never)]
    fn told_side_m(&self, at_m: [f32; 2]) -> f32 {
        let place_m = self.now.line.place_m(at_m);
        let (mut side_m, mut nearest_m) = (0.0, f32::INFINITY);
        for Segment { extent_m: [begin_m, end_m], inside, .. } in self.segments {
            let off_m = larger(begin_m - place_m, place_m - end_m);
            if off_m < nearest_m {
                nearest_m = off_m;
                side_m = match inside {
                    Inside::Before => self.reach_m,
                    Inside::Behind => -self.reach_m,
                    Inside::Either => 0.0,
                };
            }
        }
        side_m
    }

    /// Probability that a leg crosses the wall, `is_opposite` where its ends are surely on different sides.
    #[inline(always)]
    fn crossed(&self, from: &Corner, is_anchor: bool, to: &Corner, is_opposite: bool) -> f32 {
        let WallNow { line, std_m, .. } = &self.now;
        let (before, behind) = (line.distance_m(from.at_m), line.distance_m(to.at_m));
        let (mut sides, mut beyond_m) = (1.0, abs(behind));
        if !is_opposite {
            let side_m = if is_anchor { self.side_m(from.at_m, before) } else { before };
            beyond_m = if side_m < 0.0 { behind } else { -behind };
            let near = probability(abs(side_m), root(from.std_m, *std_m));
            let beyond = probability(beyond_m, root(to.std_m, *std_m));
            sides = near * beyond + (1.0 - near) * (1.0 - beyond);
            if !(sides > 0.0) {
                return 0.0;
            }
        }
        let (_, _, within) = self.meeting(abs(before), beyond_m, from.at_m, to);
        sides * within
    }

    /// Moves a corner to where the path that leads there from an image's or anchor's position is reflected; returns the
    /// probabilities that both ends are on the same side of the wall and that this is on a segment of it.
    #[inline(never)]
    fn bounce(&self, from_m: [f32; 2], to: &mut Corner) -> [f32; 2] {
        let WallNow { line, std_m, .. } = &self.now;
        let (before, behind) = (line.distance_m(from_m), line.distance_m(to.at_m));
        let side_m = self.side_m(from_m, before);
        let far_m = if side_m < 0.0 { -behind } else { behind };
        let is_sure = far_m >= SURE * to.std_m + self.reach_m;
        let mut same_side = if is_sure { 1.0 } else { probability(far_m, root(to.std_m, *std_m)) };
        if abs(side_m) < self.reach_m {
            let near = probability(abs(side_m), root(0.0, *std_m));
            same_side = near * same_side + (1.0 - near) * (1.0 - same_side);
        }
        if same_side < LEAST {
            return [0.0; 2];
        }
        let (share, place_m, within) = self.meeting(abs(before), far_m, from_m, to);
        let ([cx, cy], [tx, ty]) = (line.centre_m, line.tangent());
        to.at_m = [cx + place_m * tx, cy + place_m * ty];
        to.std_m *= share;
        [same_side, within]
    }

    /// Where a path that starts `near_m` before the wall and ends `far_m` behind it meets it, one that does not reach it at its
    /// nearer end: the share of its way, the place along the wall, metres, and the probability that this is on a segment.
    #[inline(always)]
    fn meeting(&self, near_m: f32, far_m: f32, from_m: [f32; 2], to: &Corner) -> (f32, f32, f32) {
        let WallNow { line, std_m, .. } = &self.now;
        let per_m = 1.0 / (near_m + abs(far_m) + LEAST_ACROSS_M);
        let share = if far_m >= 0.0 { near_m * per_m } else { nearer_end(near_m, far_m) };
        let begin_m = line.place_m(from_m);
        let along_m = line.place_m(to.at_m) - begin_m;
        let place_m = begin_m + share * along_m;
        // Surely off all segments, or on the only one: by bounds of the roots below.
        let slope = abs(along_m) * per_m;
        let (off_m, bound_m) = (abs(place_m) - self.half_m, (SURE * to.std_m + self.reach_m) * (1.0 + slope));
        if off_m > bound_m {
            return (share, place_m, 0.0);
        }
        if off_m < -bound_m && self.segments.len() == 1 {
            return (share, place_m, 1.0);
        }
        let std_m = root(share * to.std_m, *std_m) * smaller(root(1.0, slope), MOST_OBLIQUE);
        let reach_m = SURE * std_m;
        let mut within = 0.0;
        for Segment { extent_m: [begin_m, end_m], .. } in self.segments {
            let (past_m, left_m) = (place_m - begin_m, end_m - place_m);
            let nearer_m = smaller(past_m, left_m);
            if nearer_m >= reach_m {
                return (share, place_m, 1.0);
            }
            if nearer_m > -reach_m {
                // The difference of two distribution functions: segments that join leave no gap.
                within += larger(probability(past_m, std_m) + probability(left_m, std_m) - 1.0, 0.0);
            }
        }
        (share, place_m, smaller(within, 1.0))
    }
}

/// Share of its way at which a path is nearest to a wall that it does not reach.
#[cold]
fn nearer_end(near_m: f32, far_m: f32) -> f32 {
    if near_m + far_m < 0.0 { 0.0 } else { 1.0 }
}

/// The root of a^2 + b^2 (neither below 0), to within 4 %.
fn root(a: f32, b: f32) -> f32 {
    let (more, less) = if a > b { (a, b) } else { (b, a) };
    0.96 * more + 0.4 * less
}

/// The quintic step from 0 at -1 to 1 at 1, whose slope is the square of 1 - u^2.
fn step(u: f32) -> f32 {
    let u2 = u * u;
    0.5 + u * (0.9375 + u2 * (0.1875 * u2 - 0.625))
}

/// Probability that a number of this mean and deviation (above 0) is positive.
fn probability(mean: f32, std: f32) -> f32 {
    let reach = SURE * std;
    if mean >= reach {
        1.0
    } else if mean > -reach {
        step(mean / reach)
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::super::plan::{Plan, PlanSegment, PlanWall};
    use super::*;
    use std::vec;

    type Ends = [[f64; 2]; 2];
    type Scene = std::vec::Vec<std::vec::Vec<Ends>>;

    const EXACT: PlanWall = PlanWall { offset_std_m: 0.0, rotation_std_rad: 0.0 };
    const THROUGH: f32 = 0.4;

    fn plan(scene: &Scene) -> FloorPlan<16> {
        plan_within(scene, &[])
    }

    fn plan_within(scene: &Scene, outline_m: &[[f32; 2]]) -> FloorPlan<16> {
        let segments: std::vec::Vec<PlanSegment> = scene
            .iter()
            .enumerate()
            .flat_map(|(wall, segments)| segments.iter().map(move |ends| (wall, ends)))
            .map(|(wall, ends)| PlanSegment { wall, ends_m: ends.map(|end| end.map(|x| x as f32)) })
            .collect();
        let walls = vec![EXACT; scene.len()];
        FloorPlan::new(&Plan {
            outline_m,
            walls: &walls,
            segments: &segments,
            turn_std_rad: 0.0,
            reflections: 2,
            most_sources: 24,
        })
        .unwrap()
    }

    fn told(plan: &FloorPlan<16>) -> Walls<'_, 16> {
        Walls::new(plan, |_, wall| WallNow::told(wall, THROUGH))
    }

    /// Numbers between 0 and 1 (xorshift).
    struct Random(u64);

    impl Random {
        fn uniform(&mut self) -> f64 {
            self.0 ^= self.0 << 13;
            self.0 ^= self.0 >> 7;
            self.0 ^= self.0 << 17;
            (self.0 >> 11) as f64 / (1u64 << 53) as f64
        }

        fn within(&mut self, low: f64, high: f64) -> f64 {
            low + (high - low) * self.uniform()
        }

        fn normal(&mut self) -> f64 {
            (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
        }
    }

    /// A rectangular room and two walls in it, the second with a door.
    fn scene(random: &mut Random) -> Scene {
        let (w, h) = (random.within(6.0, 12.0), random.within(5.0, 9.0));
        let x = random.within(0.3 * w, 0.7 * w);
        let (a, b) = (random.within(0.2, 0.4) * h, random.within(0.5, 0.8) * h);
        let skew = random.within(-0.5, 0.5);
        vec![
            vec![[[0.0, 0.0], [w, 0.0]]],
            vec![[[w, 0.0], [w, h]]],
            vec![[[w, h], [0.0, h]]],
            vec![[[0.0, h], [0.0, 0.0]]],
            vec![[[x, 0.0], [x, a]], [[x, b], [x, h]]],
            vec![[[0.1 * w, b], [0.25 * w, b + skew]]],
        ]
    }

    /// A place in the room and off every wall.
    fn inside(plan: &FloorPlan<16>, random: &mut Random) -> [f64; 2] {
        loop {
            let place = [random.within(0.0, 12.0), random.within(0.0, 9.0)];
            let [x, y] = place.map(|x| x as f32);
            let away = plan.walls().iter().map(|wall| wall.line.distance_m([x, y]));
            // The outer walls are told anticlockwise: their normals, to the left, lead inside.
            if away.enumerate().all(|(n, away_m)| if n < 4 { away_m > 0.4 } else { away_m.abs() > 0.4 }) {
                return place;
            }
        }
    }

    /// Where on the first piece (share of it) and on the second the two meet, if they do.
    fn cut([p, q]: Ends, [a, b]: Ends) -> Option<[f64; 2]> {
        let (d, e) = ([q[0] - p[0], q[1] - p[1]], [b[0] - a[0], b[1] - a[1]]);
        let determinant = d[0] * e[1] - d[1] * e[0];
        let way = [a[0] - p[0], a[1] - p[1]];
        let [u, v] =
            [(way[0] * e[1] - way[1] * e[0]) / determinant, (way[0] * d[1] - way[1] * d[0]) / determinant];
        ((0.0..1.0).contains(&u) && (0.0..1.0).contains(&v)).then_some([u, v])
    }

    /// What exact walls let through to an exact place, by tracing the ray backwards from the place; f64.
    fn traced(scene: &Scene, anchor: [f64; 2], sequence: &[usize], place: [f64; 2]) -> f64 {
        let mirrored = |[x, y]: [f64; 2], wall: usize| {
            let [[ax, ay], [bx, by]] = scene[wall][0];
            let (dx, dy) = (bx - ax, by - ay);
            let along = ((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy);
            let (fx, fy) = (ax + along * dx, ay + along * dy);
            [2.0 * fx - x, 2.0 * fy - y]
        };
        let mut images = vec![anchor];
        for &wall in sequence {
            images.push(mirrored(*images.last().unwrap(), wall));
        }
        let mut corners = vec![place];
        for (n, &wall) in sequence.iter().enumerate().rev() {
            let ([px, py], [mx, my]) = (*corners.last().unwrap(), images[n + 1]);
            let hit = scene[wall].iter().find_map(|segment| cut([[px, py], [mx, my]], *segment));
            let Some([u, _]) = hit else { return 0.0 };
            corners.push([px + u * (mx - px), py + u * (my - py)]);
        }
        corners.push(anchor);
        let mut through = 1.0;
        for (n, leg) in corners.windows(2).enumerate() {
            // Its ends reflect: the walls around leg n, from the place.
            let ends = [sequence.len().wrapping_sub(n + 1), sequence.len().wrapping_sub(n)];
            let reflect: std::vec::Vec<_> = ends.iter().filter_map(|&n| sequence.get(n)).collect();
            for (_, segments) in scene.iter().enumerate().filter(|(wall, _)| !reflect.contains(&wall)) {
                if segments.iter().any(|segment| cut([leg[0], leg[1]], *segment).is_some()) {
                    through *= f64::from(THROUGH);
                }
            }
        }
        through
    }

    /// The scene with every wall moved across and along by a deviation.
    fn moved(scene: &Scene, std_m: f64, random: &mut Random) -> Scene {
        let mut scene = scene.clone();
        for wall in &mut scene {
            let [[ax, ay], [bx, by]] = wall[0];
            let length = (bx - ax).hypot(by - ay);
            let (tx, ty) = ((bx - ax) / length, (by - ay) / length);
            let (across, along) = (std_m * random.normal(), std_m * random.normal());
            for [x, y] in wall.iter_mut().flatten() {
                *x += along * tx - across * ty;
                *y += along * ty + across * tx;
            }
        }
        scene
    }

    fn sequences() -> std::vec::Vec<std::vec::Vec<usize>> {
        let mut all = vec![vec![]];
        for first in 0..6 {
            all.push(vec![first]);
            all.extend((0..6).filter(|second| *second != first).map(|second| vec![first, second]));
        }
        all
    }

    fn ours(walls: &Walls<'_, 16>, anchor: [f64; 2], sequence: &[usize], place: [f64; 2], std_m: f32) -> f64 {
        let [anchor_m, place_m] = [anchor, place].map(|point| point.map(|x| x as f32));
        f64::from(match sequence {
            [] => walls.paths(anchor_m, place_m, std_m).direct(),
            [first, rest @ ..] => {
                walls.paths(anchor_m, place_m, std_m).reflected(*first, rest.first().copied())
            }
        })
    }

    #[test]
    fn roots_and_the_normal_distribution_are_near_enough() {
        let (step, mut phi) = (1e-3_f64, 0.5);
        for n in 0..4000 {
            let z = f64::from(n) * step;
            let ours = f64::from(probability((3.0 * z) as f32, 3.0));
            assert!((ours - phi).abs() < 0.015, "{z}: {ours} {phi}");
            assert!((ours + f64::from(probability((-3.0 * z) as f32, 3.0)) - 1.0).abs() < 1e-6);
            phi += step * (-0.5 * (z + 0.5 * step).powi(2)).exp() / (2.0 * core::f64::consts::PI).sqrt();
            let ratio = f64::from(root(2.0, 2.0 * z as f32)) / (2.0 * 1.0_f64.hypot(z));
            assert!((ratio - 1.0).abs() < 0.041, "{z}: {ratio}");
        }
    }

    #[test]
    fn where_no_deviation_changes_what_is_seen_it_is_what_a_ray_tracer_sees() {
        let mut random = Random(7);
        let (mut seen, mut hidden) = ([0; 3], 0);
        for _ in 0..120 {
            let scene = scene(&mut random);
            let plan = plan(&scene);
            let walls = told(&plan);
            let (anchor, place) = (inside(&plan, &mut random), inside(&plan, &mut random));
            for sequence in sequences() {
                let exact = traced(&scene, anchor, &sequence, place);
                let is_clear = (0..100).all(|_| {
                    let moved = moved(&scene, 0.2, &mut random);
                    let place = place.map(|x| x + 0.2 * random.normal());
                    traced(&moved, anchor, &sequence, place) == exact
                });
                if is_clear {
                    let ours = ours(&walls, anchor, &sequence, place, 0.0);
                    assert!((ours - exact).abs() < 0.02, "{sequence:?} {anchor:?} {place:?}: {ours} {exact}");
                    if exact > 0.0 {
                        seen[sequence.len()] += 1;
                    } else {
                        hidden += 1;
                    }
                }
            }
        }
        assert!(seen.iter().all(|count| *count > 30) && hidden > 300, "{seen:?} {hidden}");
    }

    #[test]
    fn the_soft_value_is_the_mean_over_places_and_walls() {
        let mut random = Random(11);
        for std_m in [0.1, 0.3] {
            let (mut sum, mut far, mut count) = (0.0, 0_u32, 0_u32);
            for _ in 0..25 {
                let scene = scene(&mut random);
                let plan = plan(&scene);
                let walls = told(&plan);
                let (anchor, place) = (inside(&plan, &mut random), inside(&plan, &mut random));
                for sequence in sequences() {
                    let draws = 200;
                    let mean = (0..draws)
                        .map(|_| {
                            let moved = moved(&scene, f64::from(LEAST_STD_M), &mut random);
                            let place = place.map(|x| x + std_m * random.normal());
                            traced(&moved, anchor, &sequence, place)
                        })
                        .sum::<f64>()
                        / f64::from(draws);
                    let off = (ours(&walls, anchor, &sequence, place, std_m as f32) - mean).abs();
                    // Where it is nothing for both, nothing is learnt.
                    if mean > 0.01 || off > 0.01 {
                        sum += off;
                        far += u32::from(off > 0.1);
                        count += 1;
                    }
                }
            }
            assert!(count > 200 && far * 20 < count, "{std_m}: {far} of {count}");
            assert!(sum < 0.025 * f64::from(count), "{std_m}: {sum} of {count}");
        }
    }

    /// A room of 8 m by 6 m; a wall across it at x = 5 m, down to y = 3 m.
    fn room() -> Scene {
        vec![
            vec![[[0.0, 0.0], [8.0, 0.0]]],
            vec![[[8.0, 0.0], [8.0, 6.0]]],
            vec![[[8.0, 6.0], [0.0, 6.0]]],
            vec![[[0.0, 6.0], [0.0, 0.0]]],
            vec![[[5.0, 3.0], [5.0, 6.0]]],
        ]
    }

    const OUTLINE_M: [[f32; 2]; 4] = [[0.0, 0.0], [8.0, 0.0], [8.0, 6.0], [0.0, 6.0]];

    #[test]
    fn an_anchor_is_inside_the_outline_wall_that_it_hangs_on() {
        // The second time told clockwise, and the wall from its other end.
        let mut turned = room();
        turned[0][0].reverse();
        let mut back = OUTLINE_M;
        back.reverse();
        for (scene, outline_m) in [(room(), OUTLINE_M), (turned, back)] {
            let plan = plan_within(&scene, &outline_m);
            let walls = told(&plan);
            for off_m in [0.0, 0.01, 0.05, 0.3] {
                let (anchor_m, place_m) = ([2.0, off_m], [3.0, 3.5]);
                let paths = walls.paths(anchor_m, place_m, 0.05);
                assert_eq!(paths.direct(), 1.0, "{off_m}");
                assert_eq!(paths.reflected(2, None), 1.0, "{off_m}");
                assert_eq!(paths.reflected(0, None), 1.0, "{off_m}");
                // So is its image in the wall beside it.
                assert_eq!(paths.either_order([0, 3]), (1.0, false), "{off_m}");
            }
            // Well outside it is not.
            assert!((walls.paths([2.0, -0.5], [3.0, 3.5], 0.05).direct() - THROUGH).abs() < 1e-6);
        }
    }

    #[test]
    fn an_anchor_on_a_partition_is_on_either_side_as_its_distance_says() {
        let plan = plan_within(&room(), &OUTLINE_M);
        let wide =
            |std_m| Walls::new(&plan, move |_, wall: &Wall| WallNow { std_m, ..WallNow::told(wall, 0.0) });
        let direct = |walls: &Walls<'_, 16>, x| walls.paths([x, 4.5], [2.0, 4.5], 0.05).direct();
        for std_m in [0.05, 0.1] {
            let walls = wide(std_m);
            // Phi of the distance over the wall's deviation, to within 0.015 and the root's 4 %.
            for (deviations, expected) in [(-3.0, 1.0), (-1.0, 0.841), (0.0, 0.5), (1.0, 0.159), (3.0, 0.0)] {
                let ours = direct(&walls, 5.0 + deviations * std_m);
                assert!((ours - expected).abs() < 0.03, "{std_m} {deviations}: {ours}");
            }
            let image = |x| walls.paths([x, 4.5], [2.0, 4.5], 0.05).reflected(4, None);
            assert!((image(5.0) - 0.5).abs() < 0.01 && image(5.0 - 3.0 * std_m) == 1.0);
        }
    }

    #[test]
    fn no_step_is_made_where_an_anchor_is_moved_past_a_wall() {
        let plan = plan_within(&room(), &OUTLINE_M);
        let walls = Walls::new(&plan, |_, wall| WallNow { std_m: 0.1, ..WallNow::told(wall, 0.0) });
        let mut steepest = 0.0_f32;
        for (along, place_m) in [([0.0, 1.0], [3.0, 4.0]), ([1.0, 0.0], [2.0, 5.0])] {
            let values = |n: i32| {
                let off_m = 0.005 * n as f32;
                let anchor_m = if along == [0.0, 1.0] { [2.0, off_m] } else { [5.0 + off_m, 4.5] };
                let paths = walls.paths(anchor_m, place_m, 0.05);
                let wall = if along == [0.0, 1.0] { 0 } else { 4 };
                [paths.direct(), paths.reflected(wall, None), paths.reflected(2, None)]
            };
            for n in -200..200 {
                for (a, b) in values(n).into_iter().zip(values(n + 1)) {
                    steepest = larger(steepest, abs(a - b));
                }
            }
        }
        // The steepest distribution function climbs 0.4 over a deviation, here 20 steps.
        assert!((0.01..0.05).contains(&steepest), "{steepest}");
    }

    #[test]
    fn a_wall_that_is_crossed_alone_is_named() {
        let plan = plan(&room());
        let walls = told(&plan);
        let anchor_m = [2.0, 4.5];
        for (place_m, expected) in [
            ([3.0, 3.0], Crossing::None),
            ([7.0, 4.5], Crossing::One(4)),
            // Past the end of the wall, and behind two of them.
            ([8.0, 1.5], Crossing::Unclear),
            ([9.0, 4.5], Crossing::Unclear),
        ] {
            assert_eq!(walls.paths(anchor_m, place_m, 0.1).crossing(), expected, "{place_m:?}");
        }
    }

    #[test]
    fn a_corner_shows_its_image_in_the_order_that_the_ray_takes() {
        let plan = plan(&room());
        let walls = told(&plan);
        let anchor_m = [2.0, 2.0];
        let at = |x, y| walls.paths(anchor_m, [x, y], 0.1).either_order([0, 3]);
        // The ray comes from (-2, -2): to the right of the diagonal it crosses the left wall first.
        assert_eq!(at(4.0, 1.0), (1.0, true));
        assert_eq!(at(1.0, 4.0), (1.0, false));
        let (middle, _) = at(3.0, 3.0);
        assert!(middle > 0.6, "{middle}");
        // From here the ray to the image (3.5, 7) passes below the end of wall 4, then crosses the line of wall 2.
        let unseen = |walls_met| walls.paths([6.5, 5.0], [5.5, 0.5], 0.1).either_order(walls_met);
        assert_eq!((unseen([4, 2]), unseen([2, 4])), ((0.0, true), (0.0, false)));
    }

    #[test]
    fn whatever_the_places_it_is_a_probability() {
        let mut random = Random(3);
        let mut pick = |values: &[f64]| values[(random.uniform() * values.len() as f64) as usize];
        let some = [0.0, 1e-6, 0.04, 0.05, 1.0, 1.0 + 1e-6, 5.0, -3.0, 1e4, -1e4];
        let stds = [0.0, 1e-6, 0.3, 1e4, 1e30, f32::INFINITY, f32::NAN, -1.0].map(f64::from);
        for _ in 0..3000 {
            let scene: Scene = (0..5)
                .map(|_| {
                    let (a, length) = ([pick(&some), pick(&some)], pick(&[0.02, 1.0, 7.0]));
                    let [dx, dy] = [[1.0, 0.0], [0.0, 1.0], [0.6, 0.8]][pick(&[0.0, 1.0, 2.0]) as usize];
                    let end = [a[0] + length * dx, a[1] + length * dy];
                    let is_near = end.iter().all(|x| x.abs() < 1e4);
                    vec![if is_near { [a, end] } else { [[0.0, 0.0], [1.0, 0.0]] }]
                })
                .collect();
            let plan = plan(&scene);
            let walls = told(&plan);
            let point = |x: f64, y: f64| [x as f32, y as f32];
            let (anchor_m, place_m) = (point(pick(&some), pick(&some)), point(pick(&some), pick(&some)));
            let std_m = pick(&stds) as f32;
            let (either, _) = walls.paths(anchor_m, place_m, std_m).either_order([1, 2]);
            let all = [
                either,
                walls.paths(anchor_m, place_m, std_m).direct(),
                walls.paths(anchor_m, place_m, std_m).reflected(0, None),
                walls.paths(anchor_m, place_m, std_m).reflected(0, Some(1)),
                // The same wall twice is no path, but no harm either.
                walls.paths(anchor_m, place_m, std_m).reflected(3, Some(3)),
            ];
            assert!(all.iter().all(|value| (0.0..=1.0).contains(value)), "{scene:?} {anchor_m:?}: {all:?}");
            assert_eq!(walls.paths(anchor_m, place_m, std_m).reflected(0, Some(9)), 0.0);
        }
    }
}
