//! Availability: how probable it is that the walls let a path through to a place.
//!
//! Every decision is a number of a mean and a deviation being positive, with the probability of the quintic step: on which
//! side of a wall a point is (its distance; deviations of point and wall), whether a path meets a segment (the distance from
//! its ends along the wall; (f s, s_w) times the slant). Where a path starts, at an anchor or its image, is inside the outline:
//! near a wall of it, the distance is counted from 2.5 deviations outside. A path's reflections count by the least of their
//! probabilities, the walls that it crosses by the product of what they let through.
//!
//! Each wall is asked for each leg: no bounds, no bits.

use super::plan::Wall;
use super::real::{Real, abs, larger, limited, smaller};
pub use cogmint_core::model::availability::Crossing;
use cogmint_core::model::availability::LEAST_STD_M;

/// A wall and what it lets through.
#[derive(Clone, Debug)]
pub struct WallNow<T> {
    /// The wall.
    pub wall: Wall<T>,
    /// Its deviation, metres.
    pub std_m: T,
    /// Share of detection that it lets through.
    pub through: T,
}

impl<T: Real> WallNow<T> {
    /// A wall, its deviation at least 0.05 m.
    pub fn new(wall: Wall<T>, std_m: T, through: T) -> Self {
        Self {
            wall,
            std_m: limited(std_m, T::of(LEAST_STD_M), T::of(1e4)),
            through: limited(through, T::ZERO, T::ONE),
        }
    }
}

/// A point and its deviation per axis, metres; no deviation: an anchor.
#[derive(Clone, Copy)]
struct Point<T> {
    at_m: [T; 2],
    std_m: Option<T>,
}

/// Probability that a number is positive: from u = mean / 2.5 deviations, 1/2 + (15 u - 10 u^3 + 3 u^5) / 16.
fn positive<T: Real>(mean: T, std: T) -> T {
    let num = T::of;
    let reach = num(2.5) * std;
    if mean >= reach {
        return T::ONE;
    }
    if !(mean > -reach) {
        return T::ZERO;
    }
    let u = mean / reach;
    // Order: Horner over u^2.
    num(0.5) + u * (num(0.9375) + u * u * (num(0.1875) * (u * u) - num(0.625)))
}

/// About the root of a^2 + b^2.
fn root<T: Real>(a: T, b: T) -> T {
    T::of(0.96) * larger(a, b) + T::of(0.4) * smaller(a, b)
}

/// Where a path from `near` before a wall to `far` behind it meets it: share of its way, place along the wall, probability
/// of a segment.
fn meeting<T: Real>(now: &WallNow<T>, near: T, far: T, from_m: [T; 2], to_m: [T; 2], to_std: T) -> [T; 3] {
    let per = T::ONE / (near + abs(far) + T::of(1e-3));
    let mut share = near * per;
    // It does not reach the wall: the nearer end.
    if far < T::ZERO {
        share = if near + far < T::ZERO { T::ZERO } else { T::ONE };
    }
    let begin = now.wall.line.place_m(from_m);
    let along = now.wall.line.place_m(to_m) - begin;
    let place = begin + share * along;
    let slant = smaller(root(T::ONE, abs(along) * per), T::of(4.0));
    let std = root(share * to_std, now.std_m) * slant;
    let mut within = T::ZERO;
    for [from, to] in &now.wall.segments_m {
        within += larger(positive(place - *from, std) + positive(*to - place, std) - T::ONE, T::ZERO);
    }
    [share, place, smaller(within, T::ONE)]
}

/// How far before a wall a start of a path is, as it counts.
fn side<T: Real>(now: &WallNow<T>, at_m: [T; 2]) -> T {
    let reach = T::of(2.5) * now.std_m;
    let away = now.wall.line.distance_m(at_m);
    if abs(away) >= T::of(2.0) * reach {
        return away;
    }
    // The nearest segment, the first of equal ones.
    let place = now.wall.line.place_m(at_m);
    let (mut nearest, mut inside) = (T::of(f32::INFINITY), T::ZERO);
    for (index, &[from, to]) in now.wall.segments_m.iter().enumerate() {
        let off = larger(from - place, place - to);
        if off < nearest {
            (nearest, inside) = (off, now.wall.inside[index]);
        }
    }
    away + inside * reach
}

/// Probability that two points are on the same side of a wall, the first this far before it.
fn same_side<T: Real>(now: &WallNow<T>, side: T, from_std: T, behind: T, to_std: T) -> T {
    let toward = if side < T::ZERO { -behind } else { behind };
    let near = positive(abs(side), root(from_std, now.std_m));
    let far = positive(toward, root(to_std, now.std_m));
    near * far + (T::ONE - near) * (T::ONE - far)
}

/// Probability that a leg crosses a wall.
fn crossed<T: Real>(now: &WallNow<T>, from: Point<T>, to: Point<T>) -> T {
    let (before, behind) = (now.wall.line.distance_m(from.at_m), now.wall.line.distance_m(to.at_m));
    let start = if from.std_m.is_none() { side(now, from.at_m) } else { before };
    let (from_std, to_std) = (from.std_m.unwrap_or(T::ZERO), to.std_m.unwrap_or(T::ZERO));
    let sides = same_side(now, start, from_std, -behind, to_std);
    let beyond = if start < T::ZERO { behind } else { -behind };
    let [_, _, within] = meeting(now, abs(before), beyond, from.at_m, to.at_m, to_std);
    sides * within
}

/// A reflection: probability of one side, probability of a segment, and where it is.
fn bounce<T: Real>(now: &WallNow<T>, from_m: [T; 2], to: Point<T>) -> ([T; 2], Point<T>) {
    let (before, behind) = (now.wall.line.distance_m(from_m), now.wall.line.distance_m(to.at_m));
    let start = side(now, from_m);
    let std = to.std_m.unwrap_or(T::ZERO);
    let one_side = same_side(now, start, T::ZERO, behind, std);
    if one_side < T::of(0.01) {
        return ([T::ZERO; 2], to);
    }
    let far = if start < T::ZERO { -behind } else { behind };
    let [share, place, within] = meeting(now, abs(before), far, from_m, to.at_m, std);
    let tangent = now.wall.line.tangent();
    let at_m =
        [now.wall.line.centre_m[0] + place * tangent[0], now.wall.line.centre_m[1] + place * tangent[1]];
    ([one_side, within], Point { at_m, std_m: Some(std * share) })
}

/// Share that all walls let through to a path with these corners, whose reflections are by these walls; a leg does not cross a
/// wall that reflects at its ends.
fn through<T: Real>(walls: &[WallNow<T>], corners: &[Point<T>], sequence: &[usize]) -> T {
    let mut through = T::ONE;
    // Order: by wall, and then along the path.
    for index in 0..walls.len() {
        for leg in 0..corners.len() - 1 {
            let reflects = (leg > 0 && sequence[leg - 1] == index) || sequence.get(leg) == Some(&index);
            if !reflects {
                let crossed = crossed(&walls[index], corners[leg], corners[leg + 1]);
                through *= T::ONE - crossed * (T::ONE - walls[index].through);
            }
        }
    }
    through
}

/// Anchor and tag.
fn ends<T: Real>(anchor_m: [T; 2], place_m: [T; 2], std_m: T) -> [Point<T>; 2] {
    let std_m = Some(limited(std_m, T::ZERO, T::of(1e4)));
    [Point { at_m: anchor_m, std_m: None }, Point { at_m: place_m, std_m }]
}

/// Availability of a path reflected by the walls `sequence`, from the anchor outwards, and its least probability of sides.
fn traced<T: Real>(walls: &[WallNow<T>], [anchor, tag]: [Point<T>; 2], sequence: &[usize]) -> (T, T) {
    let least = T::of(0.01);
    let mut images = vec![anchor.at_m];
    for n in 0..sequence.len() {
        images.push(walls[sequence[n]].wall.line.mirrored_m(images[n]));
    }
    let mut corners = vec![tag];
    let (mut sides, mut segments) = (T::ONE, T::ONE);
    for n in (0..sequence.len()).rev() {
        let ([side, within], corner) = bounce(&walls[sequence[n]], images[n], corners[0]);
        (sides, segments) = (smaller(sides, side), smaller(segments, within));
        if smaller(sides, segments) < least {
            return (T::ZERO, sides);
        }
        corners.insert(0, corner);
    }
    corners.insert(0, anchor);
    let available = smaller(sides, segments) * through(walls, &corners, sequence);
    (if available < least && !sequence.is_empty() { T::ZERO } else { available }, sides)
}

/// Availability of the path reflected by one or two walls, or by none.
pub fn availability<T: Real>(
    walls: &[WallNow<T>],
    anchor_m: [T; 2],
    sequence: &[usize],
    place_m: [T; 2],
    std_m: T,
) -> T {
    traced(walls, ends(anchor_m, place_m, std_m), sequence).0
}

/// Availability of an image that two walls make in either order, and whether the reversed order is the path's: the last wall is
/// that to which the tag is nearer, as a share of the anchor's distance. An order that is sure is the only one.
pub fn either_order<T: Real>(
    walls: &[WallNow<T>],
    anchor_m: [T; 2],
    [first, second]: [usize; 2],
    place_m: [T; 2],
    std_m: T,
) -> (T, bool) {
    let away = |wall: usize, at_m: [T; 2]| walls[wall].wall.line.distance_m(at_m);
    let is_reversed = abs(away(first, place_m) * away(second, anchor_m))
        < abs(away(second, place_m) * away(first, anchor_m));
    let ends = ends(anchor_m, place_m, std_m);
    let (a, a_sides) = traced(walls, ends, &if is_reversed { [second, first] } else { [first, second] });
    let (b, _) = traced(walls, ends, &if is_reversed { [first, second] } else { [second, first] });
    (if a_sides >= T::ONE { a } else { smaller(a + b, T::ONE) }, is_reversed)
}

/// The walls that the direct path crosses, by a probability above 0.9; below 0.1 it does not.
pub fn crossing<T: Real>(walls: &[WallNow<T>], anchor_m: [T; 2], place_m: [T; 2], std_m: T) -> Crossing {
    let [anchor, tag] = ends(anchor_m, place_m, std_m);
    let clear = T::of(0.9);
    let crossed: Vec<T> = walls.iter().map(|wall| crossed(wall, anchor, tag)).collect();
    let perhaps: Vec<usize> = (0..walls.len()).filter(|&n| crossed[n] > T::ONE - clear).collect();
    match perhaps[..] {
        [] => Crossing::None,
        [wall] if crossed[wall] > clear => Crossing::One(wall),
        _ => Crossing::Unclear,
    }
}
