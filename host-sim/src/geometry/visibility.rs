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
    let crossings = path.crossings(walls, transmissions)?;
    Some(path.ray(walls, crossings))
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
    best.map(|(crossings, path)| path.ray(walls, crossings))
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

    /// The path as it is given out; `crossings` is how many walls it passes through.
    fn ray(&self, walls: &[Wall], crossings: usize) -> Ray {
        let mut crossed = Vec::with_capacity(crossings);
        for (from_m, to_m, reflecting) in self.legs() {
            if crossed.len() == crossings {
                break;
            }
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

#[cfg(test)]
mod tests {
    use super::super::image_source::image_sources;
    use super::super::shared::{polygon, room_of_ten_walls, seminar_room, wall};
    use super::*;

    fn near(a: f64, b: f64) {
        assert!((a - b).abs() < 1e-9, "{a} instead of {b}");
    }

    /// Places all over the room of ten walls.
    fn places() -> impl Iterator<Item = [f64; 2]> {
        (0..60).map(|n| {
            let n = f64::from(n);
            [0.4 + 8.0 * (n * 0.754_877).fract(), 0.5 + 5.0 * (n * 0.569_84).fract()]
        })
    }

    #[test]
    fn a_rectangle_shows_every_image_once_with_its_closed_form_length() {
        let walls = polygon(&[[0.0, 0.0], [5.0, 0.0], [5.0, 3.0], [0.0, 3.0]]);
        let (anchor_m, tag_m) = ([1.3, 0.9], [3.9, 2.2]);
        let mut lengths_m = Vec::new();
        for image in image_sources(&walls, anchor_m, 4) {
            let rays: Vec<Ray> = image
                .sequences
                .iter()
                .filter_map(|walls_hit| trace(&walls, anchor_m, walls_hit, tag_m, 0))
                .collect();
            assert_eq!(rays.len(), 1, "{image:?}");
            assert_eq!(trace_image(&walls, anchor_m, &image, tag_m, 0), Some(rays[0].clone()));
            assert_eq!(rays[0].reflections.len(), image.order);
            lengths_m.push(rays[0].length_m());
        }
        // Across and up independently: n reflections put the source at n W + x, or n W + W - x for odd n.
        let mirrored =
            |n: i32, width: f64, x: f64| f64::from(n) * width + if n % 2 == 0 { x } else { width - x };
        let mut expected_m = Vec::new();
        for across in -4_i32..=4 {
            for up in -4_i32..=4 {
                if across.abs() + up.abs() <= 4 {
                    let x_m = mirrored(across, 5.0, anchor_m[0]) - tag_m[0];
                    let y_m = mirrored(up, 3.0, anchor_m[1]) - tag_m[1];
                    expected_m.push(x_m.hypot(y_m));
                }
            }
        }
        lengths_m.sort_by(f64::total_cmp);
        expected_m.sort_by(f64::total_cmp);
        assert_eq!(lengths_m.len(), 41);
        for (length_m, expected_m) in lengths_m.into_iter().zip(expected_m) {
            near(length_m, expected_m);
        }
    }

    #[test]
    fn incidence_is_measured_from_the_walls_normal() {
        let walls = [wall([-5.0, 0.0], [5.0, 0.0]), wall([2.0, 0.5], [4.0, 2.5])];
        let ray = trace(&walls, [0.0, 3.0], &[0], [4.0, 1.0], 1).unwrap();
        assert_eq!(ray.points_m, [[0.0, 3.0], [3.0, 0.0], [4.0, 1.0]]);
        near(ray.length_m(), 32.0_f64.sqrt());
        near(ray.reflections[0].cos_incidence, 0.5_f64.sqrt());
        // The incoming leg meets the slanted wall at a right angle; the other leg runs parallel to it.
        assert_eq!(ray.crossed.len(), 1);
        assert_eq!(ray.crossed[0].wall, 1);
        near(ray.crossed[0].cos_incidence, 1.0);
    }

    #[test]
    fn walls_in_the_way_block_unless_as_many_may_be_passed_through() {
        let walls = [wall([2.0, -1.0], [2.0, 1.0]), wall([1.0, -1.0], [1.0, 1.0])];
        let through = |transmissions| trace(&walls, [0.0, 0.0], &[], [3.0, 0.0], transmissions);
        assert_eq!((through(0), through(1)), (None, None));
        let crossed: Vec<usize> = through(2).unwrap().crossed.iter().map(|crossing| crossing.wall).collect();
        assert_eq!(crossed, [1, 0], "in the order of the path");
        assert!(trace(&walls, [0.0, 0.0], &[], [0.9, 0.0], 0).is_some());
        assert!(trace(&walls, [0.0, 0.0], &[], [3.0, 4.0], 0).is_some(), "past the ends");
    }

    #[test]
    fn a_leg_along_a_wall_does_not_cross_it() {
        let slanted = wall([1.0, 1.0 / 3.0], [2.0, 2.0 / 3.0]);
        assert!(trace(&[slanted], [0.0, 0.0], &[], [3.0, 1.0], 0).is_some());
        assert!(trace(&[slanted], [0.0, 0.1], &[], [3.0, 1.1], 0).is_some());
    }

    #[test]
    fn a_reflection_needs_both_ends_on_one_side_and_the_point_on_the_wall() {
        let walls = [wall([0.0, 0.0], [2.0, 0.0])];
        let bounce = |anchor_m, tag_m| trace(&walls, anchor_m, &[0], tag_m, 8).is_some();
        assert!(bounce([0.0, 1.0], [2.0, 1.0]) && bounce([0.0, -1.0], [2.0, -1.0]));
        assert!(!bounce([0.0, 1.0], [2.0, -1.0]), "through it");
        assert!(!bounce([3.0, 1.0], [5.0, 1.0]), "past it");
        assert!(!bounce([0.0, 0.0], [2.0, 1.0]) && !bounce([0.0, 1.0], [2.0, 0.0]), "in its plane");
        assert!(bounce([1.0, 1.0], [3.0 + 1e-6, 1.0]) && !bounce([1.0, 1.0], [3.0 + 3e-6, 1.0]), "its end");
        assert_eq!(trace(&walls, [0.0, 1.0], &[0, 0], [1.0, -1.0], 8), None, "twice in a row");
        assert_eq!(trace(&walls, [0.0, 1.0], &[0; 9], [1.0, 1.0], 8), None);
        assert_eq!(trace(&walls, [f64::NAN, 1.0], &[0], [1.0, 1.0], 8), None);
    }

    #[test]
    fn a_path_into_a_right_angled_corner_comes_back_by_exactly_one_merged_image() {
        let walls = polygon(&[[0.0, 0.0], [5.0, 0.0], [5.0, 5.0], [0.0, 5.0]]);
        let images = image_sources(&walls, [1.0, 1.0], 2);
        let corner = images.iter().find(|image| image.sequences.contains(&vec![0, 3])).unwrap();
        assert_eq!(corner.sequences.len(), 2);
        // On the diagonal both reflections are in the corner itself.
        for tag_m in [[3.0, 3.0], [3.0, 3.0 + 1e-13], [3.0, 3.1], [3.1, 3.0]] {
            let ray = trace_image(&walls, [1.0, 1.0], corner, tag_m, 0).unwrap();
            near(ray.length_m(), (1.0 + tag_m[0]).hypot(1.0 + tag_m[1]));
            assert!(ray.reflections.iter().all(|reflection| reflection.cos_incidence > 0.6));
        }
    }

    #[test]
    fn a_wall_in_two_pieces_reflects_and_blocks_at_the_joint_like_one() {
        let walls = polygon(&[[0.0, 0.0], [2.0, 0.0], [5.0, 0.0], [5.0, 3.0], [0.0, 3.0]]);
        let images = image_sources(&walls, [1.0, 1.0], 1);
        for tag_m in [[3.0, 1.0], [3.0 - 1e-12, 1.0], [3.0 + 1e-12, 1.0]] {
            let ray = trace_image(&walls, [1.0, 1.0], &images[1], tag_m, 0).unwrap();
            near(ray.length_m(), 8.0_f64.sqrt());
        }
        for tag_m in [[3.0, -1.0], [3.0 - 1e-12, -1.0], [3.0 + 1e-12, -1.0]] {
            let ray = trace(&walls, [1.0, 1.0], &[], tag_m, 8).unwrap();
            assert_eq!(ray.crossed.len(), 1);
            // Nor does the joint turn a path back that goes straight on.
            assert_eq!(trace(&walls, [1.0, 1.0], &[0, 1], tag_m, 8), None);
        }
    }

    #[test]
    fn an_inner_wall_that_abuts_leaves_the_reflection_beside_it_alone() {
        let mut walls = polygon(&[[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]]);
        for end_y_m in [0.0, 1e-9, -1e-9] {
            walls.truncate(4);
            walls.push(wall([2.0, end_y_m], [2.0, 1.0]));
            // The path meets the outer wall where the inner one does: it touches, and the rest is free.
            assert!(trace(&walls, [1.0, 2.0], &[0], [3.0, 2.0], 0).is_some());
            assert!(trace(&walls, [1.0, 2.0], &[0], [3.1, 2.0], 0).is_none(), "through the inner wall");
            let legs = trace(&walls, [1.0, 2.0], &[0], [3.1, 2.0], 1).unwrap();
            assert_eq!(legs.crossed[0].wall, 4);
        }
    }

    #[test]
    fn the_sequence_with_the_fewest_walls_passed_through_is_taken() {
        // Two pieces of one plane, the first behind a curtain.
        let walls =
            [wall([0.0, 0.0], [2.0, 0.0]), wall([-1.0, 0.5], [3.0, 0.5]), wall([0.0, -1.0], [2.0, -1.0])];
        let image =
            ImageSource { position_m: [0.0; 2], sequences: vec![vec![0], vec![1], vec![2]], order: 1 };
        let ray = trace_image(&walls, [0.5, 1.0], &image, [1.5, 1.0], 8).unwrap();
        assert_eq!((ray.reflections[0].wall, ray.crossed.len()), (1, 0));
        let hidden = ImageSource { sequences: vec![vec![2], vec![0]], ..image };
        let ray = trace_image(&walls, [0.5, 1.0], &hidden, [1.5, 1.0], 8).unwrap();
        assert_eq!((ray.reflections[0].wall, ray.crossed.len()), (0, 2));
        assert_eq!(trace_image(&walls, [0.5, 1.0], &hidden, [1.5, 1.0], 1), None);
    }

    #[test]
    fn a_path_is_as_long_as_the_way_from_its_image_and_the_same_backwards() {
        let walls = room_of_ten_walls();
        let anchor_m = [4.0, 5.0];
        let images = image_sources(&walls, anchor_m, 4);
        let mut paths = 0;
        for tag_m in places() {
            let backwards = image_sources(&walls, tag_m, 4);
            for image in &images {
                for sequence in &image.sequences {
                    let Some(ray) = trace(&walls, anchor_m, sequence, tag_m, 2) else { continue };
                    paths += 1;
                    if sequence == &image.sequences[0] {
                        near(ray.length_m(), length(sub(tag_m, image.position_m)));
                    }
                    let reversed: Vec<usize> = sequence.iter().rev().copied().collect();
                    let back = trace(&walls, tag_m, &reversed, anchor_m, 2).unwrap();
                    near(back.length_m(), ray.length_m());
                    let walls_of =
                        |crossings: &[Crossing]| crossings.iter().map(|c| c.wall).collect::<Vec<_>>();
                    assert!(walls_of(&ray.crossed).iter().rev().eq(&walls_of(&back.crossed)));
                    assert!(
                        backwards.iter().any(|image| image.sequences.contains(&reversed)),
                        "{reversed:?}"
                    );
                    for (there, again) in ray.reflections.iter().zip(back.reflections.iter().rev()) {
                        near(there.cos_incidence, again.cos_incidence);
                    }
                }
            }
        }
        assert!(paths > 1000, "{paths}");
    }

    /// The pruning against every sequence there is.
    #[test]
    fn clipping_drops_no_sequence_that_some_place_can_see() {
        let mut rooms = vec![room_of_ten_walls(), seminar_room()];
        // Free walls, one of them abutting, with a joint in one plane and a small gap.
        rooms.push(vec![
            wall([0.0, 0.0], [3.0, 0.0]),
            wall([3.0, 0.0], [6.0, 0.0]),
            wall([2.0, 0.0], [2.5, 2.0]),
            wall([0.0, 4.0], [4.0, 4.2]),
            wall([4.1, 4.2], [6.0, 3.0]),
            wall([5.0, -1.0], [5.0, 3.0]),
        ]);
        for walls in rooms {
            let anchor_m = [2.2, 3.1];
            let images = image_sources(&walls, anchor_m, 3);
            let kept: std::collections::HashSet<&Vec<usize>> =
                images.iter().flat_map(|image| &image.sequences).collect();
            let count = walls.len();
            for code in 0..count.pow(3) {
                let walls_hit = [code % count, code / count % count, code / count / count];
                for length in 1..=3 {
                    let sequence = walls_hit[..length].to_vec();
                    let seen = places().any(|tag_m| trace(&walls, anchor_m, &sequence, tag_m, 8).is_some());
                    assert!(!seen || kept.contains(&sequence), "{sequence:?}");
                }
            }
        }
    }
}
