//! Which paths reach a tag: reflection points, incidence, and the walls that a path passes through.
//!
//! From the tag backwards, the reflection point on wall k is where the line from the image of order k to the point
//! after it meets that wall. A path is valid if every reflection point lies on its wall and the points before and after
//! it on the same side. Every other wall that a leg crosses is passed through.
//!
//! Points within 1 um touch: a reflection point may lie that far beyond the end of its wall, and a leg that meets a
//! wall that close to its own start or end does not cross it, so that walls may abut. A leg through the common corner
//! of two walls crosses exactly one of them: which side an end is on is decided by the same sum for both.

use super::image_source::{ImageSource, MAX_ORDER};
use super::{TOUCH_M, Wall, between, cross, dot, length, sub};

/// A path meets a wall.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crossing {
    /// Index of the wall.
    pub wall: usize,
    /// Cosine of the angle between the path and the wall's normal, horizontally, 0 to 1.
    pub cos_incidence: f64,
}

/// A path from an anchor to a tag.
#[derive(Clone, Debug, PartialEq)]
pub struct Ray {
    /// The anchor, the reflection points and the tag, metres.
    pub points_m: Vec<[f64; 2]>,
    /// The walls that reflect it, in order.
    pub reflections: Vec<Crossing>,
    /// The walls that it passes through, in order.
    pub crossed: Vec<Crossing>,
}

impl Ray {
    /// Its length, metres.
    pub fn length_m(&self) -> f64 {
        self.points_m.windows(2).map(|leg| length(sub(leg[1], leg[0]))).sum()
    }
}

/// The path from the anchor by way of the walls of `sequence` to the tag, if there is one that passes through at most
/// `transmissions` other walls. An empty sequence is the direct path; one of more than [`MAX_ORDER`] walls has none.
///
/// # Panics
///
/// If `sequence` names a wall that does not exist.
pub fn trace(
    walls: &[Wall],
    anchor_m: [f64; 2],
    sequence: &[usize],
    tag_m: [f64; 2],
    transmissions: usize,
) -> Option<Ray> {
    let path = Path::new(walls, anchor_m, sequence, tag_m)?;
    path.crossings(walls, transmissions)?;
    Some(path.ray(walls))
}

/// The path of an image source to the tag: of its sequences the first with the fewest walls passed through, if any has
/// at most `transmissions`.
///
/// # Panics
///
/// If a sequence names a wall that does not exist.
pub fn trace_image(
    walls: &[Wall],
    anchor_m: [f64; 2],
    image: &ImageSource,
    tag_m: [f64; 2],
    transmissions: usize,
) -> Option<Ray> {
    let mut best: Option<(usize, Path)> = None;
    for sequence in &image.sequences {
        let limit = match best {
            Some((0, _)) => break,
            Some((crossings, _)) => crossings - 1,
            None => transmissions,
        };
        if let Some(path) = Path::new(walls, anchor_m, sequence, tag_m)
            && let Some(crossings) = path.crossings(walls, limit)
        {
            best = Some((crossings, path));
        }
    }
    best.map(|(_, path)| path.ray(walls))
}

/// A path of valid reflections, whatever it passes through. Arrays, because nearly all candidates are discarded.
struct Path<'a> {
    sequence: &'a [usize],
    /// The anchor and its images.
    images_m: [[f64; 2]; MAX_ORDER + 1],
    /// The anchor, the reflection points and the tag.
    points_m: [[f64; 2]; MAX_ORDER + 2],
    /// Of each reflection.
    cos_incidence: [f64; MAX_ORDER],
}

impl<'a> Path<'a> {
    fn new(walls: &[Wall], anchor_m: [f64; 2], sequence: &'a [usize], tag_m: [f64; 2]) -> Option<Self> {
        let order = sequence.len();
        if order > MAX_ORDER || sequence.windows(2).any(|pair| pair[0] == pair[1]) {
            return None;
        }
        let mut path = Self {
            sequence,
            images_m: [anchor_m; MAX_ORDER + 1],
            points_m: [anchor_m; MAX_ORDER + 2],
            cos_incidence: [0.0; MAX_ORDER],
        };
        let mut offsets_m = [0.0; MAX_ORDER];
        for (k, &index) in sequence.iter().enumerate() {
            offsets_m[k] = walls[index].offset_m(path.images_m[k]);
            if !(offsets_m[k].abs() > TOUCH_M) {
                return None;
            }
            path.images_m[k + 1] = walls[index].mirror(path.images_m[k], offsets_m[k]);
        }
        path.points_m[order + 1] = tag_m;
        for k in (0..order).rev() {
            let wall = &walls[sequence[k]];
            let (image_m, after_m) = (path.images_m[k + 1], path.points_m[k + 2]);
            // On the source's side it is positive.
            let side_m = |point_m| wall.offset_m(point_m) * offsets_m[k].signum();
            let after_side_m = side_m(after_m);
            // A path through a corner reflects twice in one point: then the next wall must lie on that side.
            let into_corner = || {
                let next = sequence.get(k + 1).map(|&next| walls[next].ends_m);
                after_side_m >= -TOUCH_M
                    && next.is_some_and(|ends| ends.iter().any(|&end| side_m(end) > TOUCH_M))
            };
            if !(after_side_m > TOUCH_M || into_corner()) {
                return None;
            }
            let source_m = offsets_m[k].abs();
            let point_m = between(image_m, after_m, source_m / (source_m + after_side_m));
            let along = wall.direction_m();
            let wall_m = length(along);
            let place_m = dot(along, sub(point_m, wall.ends_m[0])) / wall_m;
            if !(-TOUCH_M <= place_m && place_m <= wall_m + TOUCH_M) {
                return None;
            }
            path.points_m[k + 1] = point_m;
            // The leg may be of no length, but not the way from the image.
            path.cos_incidence[k] = source_m / length(sub(point_m, path.images_m[k]));
        }
        Some(path)
    }

    /// The legs, each with the walls at its ends.
    fn legs(&self) -> impl Iterator<Item = ([f64; 2], [f64; 2], [Option<usize>; 2])> {
        (0..=self.sequence.len()).map(|leg| {
            let reflecting = [leg.checked_sub(1), Some(leg)].map(|k| Some(*self.sequence.get(k?)?));
            (self.points_m[leg], self.points_m[leg + 1], reflecting)
        })
    }

    /// How many walls it passes through, unless more than `limit`.
    fn crossings(&self, walls: &[Wall], limit: usize) -> Option<usize> {
        let mut count = 0;
        for (from_m, to_m, reflecting) in self.legs() {
            for (index, wall) in walls.iter().enumerate() {
                if crossing(wall, from_m, to_m).is_some() && !reflecting.contains(&Some(index)) {
                    count += 1;
                    if count > limit {
                        return None;
                    }
                }
            }
        }
        Some(count)
    }

    fn ray(&self, walls: &[Wall]) -> Ray {
        let mut crossed = Vec::new();
        for (from_m, to_m, reflecting) in self.legs() {
            let mut here: Vec<(f64, usize)> = (0..walls.len())
                .filter(|&index| !reflecting.contains(&Some(index)))
                .filter_map(|index| Some((crossing(&walls[index], from_m, to_m)?, index)))
                .collect();
            here.sort_by(|a, b| a.0.total_cmp(&b.0));
            let leg = sub(to_m, from_m);
            crossed.extend(here.into_iter().map(|(_, wall)| {
                let along = walls[wall].direction_m();
                let cos_incidence = cross(along, leg).abs() / (length(along) * length(leg));
                Crossing { wall, cos_incidence: cos_incidence.min(1.0) }
            }));
        }
        Ray {
            points_m: self.points_m[..self.sequence.len() + 2].to_vec(),
            reflections: self
                .sequence
                .iter()
                .zip(self.cos_incidence)
                .map(|(&wall, cos)| Crossing { wall, cos_incidence: cos.min(1.0) })
                .collect(),
            crossed,
        }
    }
}

/// Where the leg crosses the wall, as a share of the leg.
fn crossing(wall: &Wall, from_m: [f64; 2], to_m: [f64; 2]) -> Option<f64> {
    let leg = sub(to_m, from_m);
    let [a, b] = wall.ends_m;
    if (cross(leg, sub(a, from_m)) < 0.0) == (cross(leg, sub(b, from_m)) < 0.0) {
        return None;
    }
    let along = sub(b, a);
    let from = cross(along, sub(from_m, a));
    let to = cross(along, sub(to_m, a));
    if from * to >= 0.0 || from.abs().max(to.abs()) <= TOUCH_M * length(along) {
        return None;
    }
    let share = from / (from - to);
    (share.min(1.0 - share) * length(leg) > TOUCH_M).then_some(share)
}
