//! Walls of a plan: which segments are one wall, and what shifting and turning does to them.
//!
//! A wall with the centre c and the unit normal u that is shifted by o along its normal and turned by theta becomes the
//! line u(theta) . (x - c) = o, with u(theta) = u turned by theta; its segments keep their places along it.

use crate::geometry::{Wall, distance_m};
use crate::recording::{LINE_TOLERANCE_M, PlanWall, off_line_m};

/// Which segments are one wall: those whose ends lie within [`LINE_TOLERANCE_M`] of the line that fits them all, however far
/// apart. Walls by their first segment, segments in order.
pub fn collinear(segments_m: &[[[f64; 2]; 2]]) -> Vec<Vec<usize>> {
    let length_m = |index: usize| distance_m(segments_m[index][0], segments_m[index][1]);
    let mut longest_first: Vec<usize> = (0..segments_m.len()).collect();
    longest_first.sort_by(|&a, &b| length_m(b).total_cmp(&length_m(a)));
    let mut is_free = vec![true; segments_m.len()];
    let mut walls: Vec<Vec<usize>> = Vec::new();
    for longest in longest_first {
        if !is_free[longest] {
            continue;
        }
        let line = Line::through(segments_m[longest]);
        let away_m = |index: usize| {
            let [a, b] = segments_m[index].map(|end| line.place_m(end) - 0.5 * line.length_m);
            a.abs().min(b.abs())
        };
        let mut others: Vec<usize> =
            (0..segments_m.len()).filter(|&index| is_free[index] && index != longest).collect();
        // The nearest first: the line becomes the surer the further it reaches.
        others.sort_by(|&a, &b| away_m(a).total_cmp(&away_m(b)));
        let mut wall = vec![longest];
        for other in others {
            let mut joined = wall.clone();
            joined.push(other);
            joined.sort_unstable();
            let ends_m: Vec<_> = joined.iter().map(|&index| segments_m[index]).collect();
            if off_line_m(&ends_m) <= LINE_TOLERANCE_M {
                wall = joined;
            }
        }
        wall.iter().for_each(|&index| is_free[index] = false);
        walls.push(wall);
    }
    walls.sort();
    walls
}

/// The wall shifted by `offset_m` along its normal and turned left by `rotation_rad` about its centre.
pub fn moved(wall: &PlanWall, offset_m: f64, rotation_rad: f64) -> PlanWall {
    if offset_m == 0.0 && rotation_rad == 0.0 {
        return wall.clone();
    }
    let ([cx, cy], [x, y]) = (wall.centre_m(), wall.direction());
    let (sin, cos) = libm::sincos(rotation_rad);
    let [along_x, along_y] = [cos * x - sin * y, sin * x + cos * y];
    let to = |end: [f64; 2]| {
        let place_m = (end[0] - cx) * x + (end[1] - cy) * y;
        [cx + place_m * along_x - offset_m * along_y, cy + place_m * along_y + offset_m * along_x]
    };
    PlanWall { segments_m: wall.segments_m.iter().map(|ends| ends.map(to)).collect(), ..wall.clone() }
}

/// Whether no point passes through the wall when it becomes `told`: each point beside a segment stays on its side.
pub fn leaves_on_their_sides(
    wall: &PlanWall,
    told: &PlanWall,
    points_m: impl IntoIterator<Item = [f64; 2]>,
) -> bool {
    points_m.into_iter().all(|point_m| {
        wall.segments_m.iter().zip(&told.segments_m).all(|(&was, &is)| {
            let (was, is) = (Line::through(was), Line::through(is));
            let beside = |line: &Line| (0.0..=line.length_m).contains(&line.place_m(point_m));
            !(beside(&was) || beside(&is)) || was.distance_m(point_m) * is.distance_m(point_m) > 0.0
        })
    })
}

/// The segments of all walls in order, as walls for [`crate::geometry`]; `construction` counts upwards.
pub fn segments(walls: &[PlanWall]) -> Vec<Wall> {
    let all = walls.iter().flat_map(|wall| &wall.segments_m).enumerate();
    all.map(|(construction, &ends_m)| Wall { ends_m, construction }).collect()
}

/// A line through two points.
struct Line {
    from_m: [f64; 2],
    along: [f64; 2],
    length_m: f64,
}

impl Line {
    fn through([a, b]: [[f64; 2]; 2]) -> Self {
        let length_m = distance_m(a, b);
        Self { from_m: a, along: [(b[0] - a[0]) / length_m, (b[1] - a[1]) / length_m], length_m }
    }

    /// Positive on the left.
    fn distance_m(&self, [x, y]: [f64; 2]) -> f64 {
        self.along[0] * (y - self.from_m[1]) - self.along[1] * (x - self.from_m[0])
    }

    fn place_m(&self, [x, y]: [f64; 2]) -> f64 {
        self.along[0] * (x - self.from_m[0]) + self.along[1] * (y - self.from_m[1])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wall(segments_m: &[[[f64; 2]; 2]]) -> PlanWall {
        PlanWall {
            segments_m: segments_m.to_vec(),
            offset_std_m: 0.05,
            rotation_std_rad: 0.01,
            construction: "brick".into(),
        }
    }

    #[test]
    fn segments_in_line_are_one_wall_whatever_their_direction_and_the_gaps_between_them() {
        let segments_m = [
            [[0.0, 0.0], [4.0, 0.0]],
            [[4.0, 0.0], [4.0, 3.0]],
            [[9.0, 0.0], [6.0, 0.0]],
            // In line with the second one, drawn half a millimetre beside it.
            [[4.0005, 5.0], [4.0005, 5.5]],
            // The other face of a thin wall.
            [[0.0, 0.1], [4.0, 0.1]],
            // On the line of the first with one end only.
            [[20.0, 0.0], [21.0, 0.01]],
        ];
        assert_eq!(collinear(&segments_m), [vec![0, 2], vec![1, 3], vec![4], vec![5]]);
    }

    #[test]
    fn pieces_between_windows_far_away_and_drawn_to_the_millimetre_are_one_wall() {
        // A facade of 60 m of pieces of 1 m, 700 m from the origin, turned by 0.3 rad: the line of any one piece is off by
        // centimetres at the other end.
        let (sin, cos) = 0.3_f64.sin_cos();
        let at =
            |place_m: f64| [700.0 + place_m * cos, 650.0 + place_m * sin].map(|x| (1e3 * x).round() / 1e3);
        let facade: Vec<_> = (0..20).map(|n| 3.0 * f64::from(n)).map(|x| [at(x), at(x + 1.0)]).collect();
        let line = Line::through(facade[3]);
        assert!(line.distance_m(facade[19][1]).abs() > LINE_TOLERANCE_M);
        assert_eq!(collinear(&facade), [(0..20).collect::<Vec<_>>()]);
    }

    #[test]
    fn segments_of_a_wall_move_together_as_one_rigid_line() {
        let still = wall(&[[[1.0, 2.0], [3.0, 2.0]], [[7.0, 2.0], [5.0, 2.0]]]);
        let (offset_m, turn_rad) = (0.3, 0.02);
        let told = moved(&still, offset_m, turn_rad);
        // The centre, (4, 2), moves along the turned normal.
        let [x, y] = told.centre_m();
        assert!((x - 4.0 + offset_m * turn_rad.sin()).abs() < 1e-12, "{x}");
        assert!((y - 2.0 - offset_m * turn_rad.cos()).abs() < 1e-12, "{y}");
        assert!((told.direction()[1] - turn_rad.sin()).abs() < 1e-12);
        let ends = |wall: &PlanWall| -> Vec<[f64; 2]> { wall.segments_m.iter().flatten().copied().collect() };
        let (was, is) = (ends(&still), ends(&told));
        for a in 0..4 {
            for b in 0..4 {
                assert!((distance_m(was[a], was[b]) - distance_m(is[a], is[b])).abs() < 1e-12);
            }
        }
        assert!(told.off_line_m() < 1e-12);
        assert_eq!(moved(&still, 0.0, 0.0), still);
    }

    #[test]
    fn a_wall_that_sweeps_over_an_anchor_is_noticed_where_it_is_and_not_beyond_its_ends() {
        let still = wall(&[[[0.0, 0.0], [4.0, 0.0]]]);
        let told = moved(&still, 0.1, 0.0);
        assert!(!leaves_on_their_sides(&still, &told, [[2.0, 0.05]]));
        assert!(leaves_on_their_sides(&still, &told, [[2.0, 0.15], [2.0, -0.05]]));
        assert!(leaves_on_their_sides(&still, &told, [[5.0, 0.05]]));
    }
}
