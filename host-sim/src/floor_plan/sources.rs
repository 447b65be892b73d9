//! Sources of a plan: which walls a path can be reflected by, where its image follows from them, and how it errs.
//!
//! The image of a in a wall with the unit normal u (turned left from its direction), centre c, offset o and rotation
//! theta, with t = u turned left, su = u . (a - c) - o and st = t . (a - c):
//!
//! m = a - 2 su u,   dm/do = 2 u,   dm/dtheta = -2 (st u + su t).
//!
//! A second wall mirrors the first one's derivatives: they are multiplied by I - 2 u u'. Errors of two walls are
//! independent; all images in one wall share its two.

use crate::recording::{PlanWall, WallSequence};

/// Deviations below this are not told, metres: a plan is not drawn more exactly.
pub const LEAST_STD_M: f64 = 1e-3;

/// How an image moves with the errors of one of its walls.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gradient {
    /// Index of the wall.
    pub wall: usize,
    /// Metres per metre of offset along the wall's normal.
    pub offset: [f64; 2],
    /// Metres per radian of rotation, left, about the wall's centre.
    pub rotation: [f64; 2],
}

/// The image of `anchor_m` along a sequence of walls, metres.
///
/// # Panics
///
/// If `sequence` names a wall that does not exist.
pub fn image_m(walls: &[PlanWall], sequence: WallSequence, anchor_m: [f64; 2]) -> [f64; 2] {
    sequence.iter().fold(anchor_m, |image_m, wall| Mirror::of(&walls[wall], image_m).image_m)
}

/// How the image of `anchor_m` along a sequence of walls moves with them, wall by wall.
///
/// # Panics
///
/// If `sequence` names a wall that does not exist.
pub fn gradients(walls: &[PlanWall], sequence: WallSequence, anchor_m: [f64; 2]) -> Vec<Gradient> {
    let mut gradients: Vec<Gradient> = Vec::new();
    let mut image_m = anchor_m;
    for wall in sequence.iter() {
        let mirror = Mirror::of(&walls[wall], image_m);
        for before in &mut gradients {
            (before.offset, before.rotation) =
                (mirror.turned_round(before.offset), mirror.turned_round(before.rotation));
        }
        gradients.push(Gradient { wall, offset: mirror.by_offset, rotation: mirror.by_rotation });
        image_m = mirror.image_m;
    }
    gradients
}

/// Covariance of an image from the deviations of its walls: xx, xy, yy, m².
///
/// # Panics
///
/// If `sequence` names a wall that does not exist.
pub fn covariance_m2(walls: &[PlanWall], sequence: WallSequence, anchor_m: [f64; 2]) -> [f64; 3] {
    let mut covariance = [0.0; 3];
    for Gradient { wall, offset, rotation } in gradients(walls, sequence, anchor_m) {
        for ([x, y], std) in [(offset, walls[wall].offset_std_m), (rotation, walls[wall].rotation_std_rad)] {
            let variance = std * std;
            covariance[0] += variance * x * x;
            covariance[1] += variance * x * y;
            covariance[2] += variance * y * y;
        }
    }
    covariance
}

/// Standard deviation of an image per axis, metres: that of its covariance's mean axis, at least [`LEAST_STD_M`].
///
/// # Panics
///
/// If `sequence` names a wall that does not exist.
pub fn std_m(walls: &[PlanWall], sequence: WallSequence, anchor_m: [f64; 2]) -> f64 {
    let [xx, _, yy] = covariance_m2(walls, sequence, anchor_m);
    (0.5 * (xx + yy)).sqrt().max(LEAST_STD_M)
}

/// What one wall makes of a point.
struct Mirror {
    normal: [f64; 2],
    image_m: [f64; 2],
    by_offset: [f64; 2],
    by_rotation: [f64; 2],
}

impl Mirror {
    fn of(wall: &PlanWall, point_m: [f64; 2]) -> Self {
        let normal @ [ux, uy] = wall.normal();
        let [tx, ty] = [-uy, ux];
        let centre_m = wall.centre_m();
        let [dx, dy] = [point_m[0] - centre_m[0], point_m[1] - centre_m[1]];
        let (across_m, along_m) = (ux * dx + uy * dy, tx * dx + ty * dy);
        Self {
            normal,
            image_m: [point_m[0] - 2.0 * across_m * ux, point_m[1] - 2.0 * across_m * uy],
            by_offset: [2.0 * ux, 2.0 * uy],
            by_rotation: [-2.0 * (along_m * ux + across_m * tx), -2.0 * (along_m * uy + across_m * ty)],
        }
    }

    /// A small step of the point, mirrored.
    fn turned_round(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let across = 2.0 * (self.normal[0] * x + self.normal[1] * y);
        [x - across * self.normal[0], y - across * self.normal[1]]
    }
}

#[cfg(test)]
mod tests {
    use super::super::walls::moved;
    use super::super::walls::segments;
    use super::*;
    use crate::geometry::image_source::image_sources;

    fn wall(segments_m: &[[[f64; 2]; 2]]) -> PlanWall {
        PlanWall {
            segments_m: segments_m.to_vec(),
            offset_std_m: 0.05,
            rotation_std_rad: 0.5_f64.to_radians(),
            construction: "brick".into(),
        }
    }

    /// A skew room with a window in the first wall.
    fn room() -> Vec<PlanWall> {
        vec![
            wall(&[[[0.0, 0.0], [2.0, 0.1]], [[3.0, 0.15], [8.0, 0.4]]]),
            wall(&[[[8.0, 0.4], [7.5, 5.0]]]),
            wall(&[[[7.5, 5.0], [0.3, 4.6]]]),
            wall(&[[[0.3, 4.6], [0.0, 0.0]]]),
        ]
    }

    fn sequence(walls: &[usize]) -> WallSequence {
        WallSequence::new(walls).expect("are two at most")
    }

    #[test]
    fn images_are_those_of_the_mirror_geometry() {
        let walls = room();
        let anchor_m = [1.3, 3.1];
        let segments = segments(&walls);
        let wall_of = [0, 0, 1, 2, 3];
        let images = image_sources(&segments, anchor_m, 2);
        let mut compared = 0;
        for image in images.iter().skip(1) {
            for way in &image.sequences {
                let met: Vec<usize> = way.iter().map(|&segment| wall_of[segment]).collect();
                let ours = image_m(&walls, sequence(&met), anchor_m);
                let away_m = (ours[0] - image.position_m[0]).hypot(ours[1] - image.position_m[1]);
                assert!(away_m < 1e-9, "{way:?}: {ours:?} instead of {:?}", image.position_m);
                compared += 1;
            }
        }
        assert!(compared > 10, "{compared}");
    }

    #[test]
    fn gradients_are_those_of_finite_differences() {
        let walls = room();
        let anchor_m = [1.3, 3.1];
        let step = 1e-5;
        for first in 0..4 {
            for second in (0..4).filter(|second| *second != first) {
                for of in [sequence(&[first]), sequence(&[first, second])] {
                    for gradient in gradients(&walls, of, anchor_m) {
                        let image_after = |offset_m, turn_rad| {
                            let mut walls = walls.clone();
                            walls[gradient.wall] = moved(&walls[gradient.wall], offset_m, turn_rad);
                            image_m(&walls, of, anchor_m)
                        };
                        for (expected, [ahead, back]) in [
                            (gradient.offset, [image_after(step, 0.0), image_after(-step, 0.0)]),
                            (gradient.rotation, [image_after(0.0, step), image_after(0.0, -step)]),
                        ] {
                            for axis in 0..2 {
                                let difference = (ahead[axis] - back[axis]) / (2.0 * step);
                                let near = (difference - expected[axis]).abs() < 1e-6;
                                assert!(near, "{of:?} {gradient:?}: {difference} on axis {axis}");
                            }
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn the_deviation_of_a_wall_shifted_alone_is_that_of_half_a_doubled_offset() {
        let mut walls = room();
        walls.iter_mut().for_each(|wall| wall.rotation_std_rad = 0.0);
        // The image moves by 2 o along one axis: the mean over two axes is 2 o / sqrt(2).
        let expected_m = 2.0 * 0.05 * std::f64::consts::FRAC_1_SQRT_2;
        assert!((std_m(&walls, sequence(&[1]), [1.3, 3.1]) - expected_m).abs() < 1e-12);
        walls.iter_mut().for_each(|wall| wall.offset_std_m = 0.0);
        assert_eq!(std_m(&walls, sequence(&[1]), [1.3, 3.1]), LEAST_STD_M);
    }
}
