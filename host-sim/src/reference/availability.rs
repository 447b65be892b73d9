//! Availability: how probable it is that the walls let a path through to a place.
//!
//! Every decision is a number of a mean and a deviation being positive, with the probability of the quintic step: on which
//! side of a wall a point is (its distance; deviations of point and wall), whether a path meets a segment (the distance from
//! its ends along the wall; (f s, s_w) times the slant). A path's reflections count by the least of their probabilities, the
//! walls that it crosses by the product of what they let through.
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
    let across = larger(near + abs(far), T::of(0.01));
    let mut share = near / across;
    // It does not reach the wall: the nearer end.
    if far < T::ZERO {
        share = if near + far < T::ZERO { T::ZERO } else { T::ONE };
    }
    let begin = now.wall.line.place_m(from_m);
    let along = now.wall.line.place_m(to_m) - begin;
    let place = begin + share * along;
    let slant = smaller(root(T::ONE, abs(along) / across), T::of(4.0));
    let std = root(share * to_std, now.std_m) * slant;
    let mut within = T::ZERO;
    for [from, to] in &now.wall.segments_m {
        within += positive(place - *from, std) + positive(*to - place, std) - T::ONE;
    }
    [share, place, limited(within, T::ZERO, T::ONE)]
}

/// Probability that a leg crosses a wall.
fn crossed<T: Real>(now: &WallNow<T>, from: Point<T>, to: Point<T>) -> T {
    let (mut near, mut beyond) = (now.wall.line.distance_m(from.at_m), -now.wall.line.distance_m(to.at_m));
    if near < T::ZERO {
        (near, beyond) = (-near, -beyond);
    }
    let to_std = to.std_m.unwrap_or(T::ZERO);
    let is_beyond = positive(beyond, root(to_std, now.std_m));
    let sides = match from.std_m {
        // Behind the wall that it hangs on an anchor is not.
        None if near <= T::of(0.05) => T::ZERO,
        None => is_beyond,
        Some(std) => {
            let is_near = positive(near, root(std, now.std_m));
            is_near * is_beyond + (T::ONE - is_near) * (T::ONE - is_beyond)
        }
    };
    let [_, _, within] = meeting(now, near, beyond, from.at_m, to.at_m, to_std);
    sides * within
}

/// A reflection: probability of one side, probability of a segment, and where it is.
fn bounce<T: Real>(now: &WallNow<T>, from_m: [T; 2], to: Point<T>) -> ([T; 2], Point<T>) {
    let (before, behind) = (now.wall.line.distance_m(from_m), now.wall.line.distance_m(to.at_m));
    let far = if abs(before) <= T::of(0.05) {
        abs(behind)
    } else if before < T::ZERO {
        -behind
    } else {
        behind
    };
    let std = to.std_m.unwrap_or(T::ZERO);
    let side = positive(far, root(std, now.std_m));
    if side < T::of(0.01) {
        return ([T::ZERO; 2], to);
    }
    let [share, place, within] = meeting(now, abs(before), far, from_m, to.at_m, std);
    let tangent = now.wall.line.tangent();
    let at_m =
        [now.wall.line.centre_m[0] + place * tangent[0], now.wall.line.centre_m[1] + place * tangent[1]];
    ([side, within], Point { at_m, std_m: Some(share * std) })
}

/// Share that all walls but some let through.
fn leg<T: Real>(walls: &[WallNow<T>], from: Point<T>, to: Point<T>, without: &[usize]) -> T {
    let mut through = T::ONE;
    for n in 0..walls.len() {
        if !without.contains(&n) {
            through *= T::ONE - crossed(&walls[n], from, to) * (T::ONE - walls[n].through);
        }
    }
    through
}

/// Anchor and tag.
fn ends<T: Real>(anchor_m: [T; 2], place_m: [T; 2], std_m: T) -> [Point<T>; 2] {
    let std_m = Some(limited(std_m, T::ZERO, T::of(1e4)));
    [Point { at_m: anchor_m, std_m: None }, Point { at_m: place_m, std_m }]
}

/// The reflections of a path by the walls `sequence`, from the anchor outwards, with the least probability of sides, and of
/// sides and segments.
fn bounces<T: Real>(
    walls: &[WallNow<T>],
    [anchor, tag]: [Point<T>; 2],
    sequence: &[usize],
) -> ([T; 2], Vec<Point<T>>) {
    let mut images = vec![anchor.at_m];
    for n in 0..sequence.len() {
        images.push(walls[sequence[n]].wall.line.mirrored_m(images[n]));
    }
    let mut points = vec![tag];
    let (mut sides, mut all) = (T::ONE, T::ONE);
    for n in (0..sequence.len()).rev() {
        let ([side, within], point) = bounce(&walls[sequence[n]], images[n], points[0]);
        sides = smaller(sides, side);
        all = smaller(all, smaller(side, within));
        points.insert(0, point);
    }
    points.insert(0, anchor);
    ([sides, all], points)
}

/// Availability of the path reflected by one or two walls, or by none.
pub fn availability<T: Real>(
    walls: &[WallNow<T>],
    anchor_m: [T; 2],
    sequence: &[usize],
    place_m: [T; 2],
    std_m: T,
) -> T {
    let ends = ends(anchor_m, place_m, std_m);
    if sequence.is_empty() {
        return leg(walls, ends[0], ends[1], &[]);
    }
    let least = T::of(0.01);
    let ([_, mut available], points) = bounces(walls, ends, sequence);
    let last = points.len() - 1;
    // Order: the last leg, that between two walls, the first; nothing is left below the least.
    for n in (0..last).rev() {
        if available < least {
            return T::ZERO;
        }
        let reflecting = [n.checked_sub(1), Some(n)];
        let without: Vec<usize> =
            reflecting.iter().flatten().filter_map(|&n| sequence.get(n)).copied().collect();
        available *= leg(walls, points[n], points[n + 1], &without);
    }
    if available < least { T::ZERO } else { available }
}

/// Availability of an image that two walls make in either order, and whether the reversed order counts.
pub fn either_order<T: Real>(
    walls: &[WallNow<T>],
    anchor_m: [T; 2],
    [first, second]: [usize; 2],
    place_m: [T; 2],
    std_m: T,
) -> (T, bool) {
    let orders = [[first, second], [second, first]];
    let [a, b] = orders.map(|order| availability(walls, anchor_m, &order, place_m, std_m));
    if a == T::ZERO && b == T::ZERO {
        let sides = |order: [usize; 2]| bounces(walls, ends(anchor_m, place_m, std_m), &order).0[0];
        return (T::ZERO, sides(orders[1]) > sides(orders[0]));
    }
    (smaller(a + b, T::ONE), b > a)
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
