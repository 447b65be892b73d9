//! What floor plans are checked with: polygons that cross themselves, walls that lie on each other, distances.
//!
//! Points within 1 um touch.

use super::{TOUCH_M, Wall, between, cross, dot, length, sub};

/// The first two sides of the polygon that cross, touch other than at their common corner, or lie on each other; side n
/// runs from corner n to the next. A corner that is there twice gives such sides too.
pub fn self_intersection(corners_m: &[[f64; 2]]) -> Option<(usize, usize)> {
    let count = corners_m.len();
    let side =
        |n: usize| Wall { ends_m: [corners_m[n % count], corners_m[(n + 1) % count]], construction: 0 };
    let pairs = (0..count).flat_map(|first| (first + 1..count).map(move |second| (first, second)));
    pairs.into_iter().find(|&(first, second)| {
        let (a, b) = (side(first), side(second));
        if second == first + 1 {
            folds_back(a.ends_m[0], &a, b.ends_m[1], &b)
        } else if (second + 1) % count == first {
            folds_back(a.ends_m[1], &a, b.ends_m[0], &b)
        } else {
            touch(&a, &b)
        }
    })
}

/// Whether two sides with a common corner lie on each other, given the other end of each.
fn folds_back(end_a: [f64; 2], a: &Wall, end_b: [f64; 2], b: &Wall) -> bool {
    distance_to_wall(b, end_a) <= TOUCH_M || distance_to_wall(a, end_b) <= TOUCH_M
}

fn touch(a: &Wall, b: &Wall) -> bool {
    let apart = |wall: &Wall, other: &Wall| {
        let [first, second] = other.ends_m.map(|end| cross(wall.direction_m(), sub(end, wall.ends_m[0])));
        first * second >= 0.0
    };
    let near =
        |wall: &Wall, other: &Wall| other.ends_m.iter().any(|&end| distance_to_wall(wall, end) <= TOUCH_M);
    !(apart(a, b) || apart(b, a)) || near(a, b) || near(b, a)
}

/// Whether two walls cross, touch, or come nearer to each other than `distance_m`.
pub fn nearer(a: &Wall, b: &Wall, distance_m: f64) -> bool {
    let apart = |axis: usize| {
        let low = |wall: &Wall| wall.ends_m[0][axis].min(wall.ends_m[1][axis]);
        let high = |wall: &Wall| wall.ends_m[0][axis].max(wall.ends_m[1][axis]);
        low(a) > high(b) + distance_m || low(b) > high(a) + distance_m
    };
    let end_near =
        |wall: &Wall, other: &Wall| other.ends_m.iter().any(|&end| distance_to_wall(wall, end) < distance_m);
    // Most pairs are told apart by their boxes.
    !(apart(0) || apart(1)) && (touch(a, b) || end_near(a, b) || end_near(b, a))
}

/// Whether two walls lie on each other: in one plane, and with more than a point in common.
pub fn overlap(a: &Wall, b: &Wall) -> bool {
    let along = a.direction_m();
    let length_m = length(along);
    let shares = b.ends_m.map(|end| dot(along, sub(end, a.ends_m[0])) / (length_m * length_m));
    // The part of b beside a.
    let beside = [shares[0].min(shares[1]).max(0.0), shares[0].max(shares[1]).min(1.0)];
    let on_a = |share: f64| {
        let on_b = between(b.ends_m[0], b.ends_m[1], (share - shares[0]) / (shares[1] - shares[0]));
        a.offset_m(on_b).abs() <= TOUCH_M
    };
    (beside[1] - beside[0]) * length_m > TOUCH_M && beside.into_iter().all(on_a)
}

/// Whether the point lies inside the polygon; on its sides either may be the answer.
pub fn contains(corners_m: &[[f64; 2]], point_m: [f64; 2]) -> bool {
    let after = corners_m.iter().cycle().skip(1);
    let crossed = corners_m.iter().zip(after).filter(|&(&a, &b)| {
        // A line from the point towards +x crosses the side.
        (a[1] > point_m[1]) != (b[1] > point_m[1])
            && (cross(sub(b, a), sub(point_m, a)) > 0.0) == (b[1] > a[1])
    });
    crossed.count() % 2 == 1
}

/// Distance of the point from the nearest point of the wall, metres.
pub fn distance_to_wall(wall: &Wall, point_m: [f64; 2]) -> f64 {
    let along = wall.direction_m();
    let share = dot(along, sub(point_m, wall.ends_m[0])) / dot(along, along);
    // A wall without length has no share: both ends are the nearest point.
    let share = if share.is_nan() { 0.0 } else { share.clamp(0.0, 1.0) };
    length(sub(point_m, between(wall.ends_m[0], wall.ends_m[1], share)))
}

#[cfg(test)]
mod tests {
    use super::super::shared::wall;
    use super::*;

    const L_SHAPE: [[f64; 2]; 6] = [[0.0, 0.0], [4.0, 0.0], [4.0, 2.0], [2.0, 2.0], [2.0, 4.0], [0.0, 4.0]];

    #[test]
    fn a_simple_polygon_does_not_intersect_itself_either_way_round() {
        assert_eq!(self_intersection(&L_SHAPE), None);
        let mut reversed = L_SHAPE;
        reversed.reverse();
        assert_eq!(self_intersection(&reversed), None);
        assert_eq!(self_intersection(&[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]), None);
    }

    #[test]
    fn sides_that_cross_touch_or_fold_back_are_found() {
        let bow_tie = [[0.0, 0.0], [2.0, 2.0], [2.0, 0.0], [0.0, 2.0]];
        assert_eq!(self_intersection(&bow_tie), Some((0, 2)));
        let corner_on_a_side = [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [2.0, 0.0], [0.0, 4.0]];
        assert_eq!(self_intersection(&corner_on_a_side), Some((0, 2)));
        let spike = [[0.0, 0.0], [4.0, 0.0], [4.0, 3.0], [4.0, 1.0], [0.0, 4.0]];
        assert_eq!(self_intersection(&spike), Some((1, 2)));
        let spike_at_corner_0 = [[0.0, 0.0], [4.0, 0.0], [4.0, 3.0], [2.0, 0.0]];
        assert!(self_intersection(&spike_at_corner_0).is_some());
        let corner_twice = [[0.0, 0.0], [4.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]];
        assert!(self_intersection(&corner_twice).is_some());
        assert!(self_intersection(&[[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]]).is_some());
    }

    #[test]
    fn only_walls_of_one_plane_with_a_common_stretch_overlap() {
        let base = wall([1.0, 1.0], [3.0, 2.0]);
        assert!(overlap(&base, &base));
        assert!(overlap(&base, &wall([5.0, 3.0], [2.0, 1.5])));
        assert!(overlap(&base, &wall([-1.0, 0.0], [5.0, 3.0])), "one within the other");
        assert!(!overlap(&base, &wall([3.0, 2.0], [5.0, 3.0])), "end to end");
        assert!(!overlap(&base, &wall([5.0, 3.0], [7.0, 4.0])), "apart");
        assert!(!overlap(&base, &wall([1.0, 1.001], [3.0, 2.001])), "parallel");
        assert!(!overlap(&base, &wall([1.0, 2.0], [3.0, 1.0])), "crossing");
        assert!(!overlap(&base, &wall([1.0, 3.0], [3.0, -1.0])), "at a right angle");
        assert!(!overlap(&base, &wall([2.0, 1.5], [2.0, 1.5])), "without length");
        assert!(!overlap(&wall([2.0, 1.5], [2.0, 1.5]), &base), "without length");
    }

    #[test]
    fn a_point_is_inside_or_outside_an_l_shaped_room() {
        for inside in [[1.0, 1.0], [3.0, 1.0], [1.0, 3.0], [1.9, 2.0]] {
            assert!(contains(&L_SHAPE, inside), "{inside:?}");
        }
        for outside in [[3.0, 3.0], [-1.0, 2.0], [5.0, 0.0], [2.1, 2.1], [1.0, 5.0], [-1.0, 0.0], [-1.0, 4.0]]
        {
            assert!(!contains(&L_SHAPE, outside), "{outside:?}");
        }
        assert!(!contains(&[], [0.0, 0.0]));
    }

    #[test]
    fn the_distance_to_a_wall_is_to_its_nearest_point() {
        let base = wall([0.0, 0.0], [4.0, 3.0]);
        assert!((distance_to_wall(&base, [2.0 - 0.6, 1.5 + 0.8]) - 1.0).abs() < 1e-12);
        assert!((distance_to_wall(&base, [-3.0, -4.0]) - 5.0).abs() < 1e-12);
        assert!((distance_to_wall(&wall([1.0, 1.0], [1.0, 1.0]), [1.0, 3.0]) - 2.0).abs() < 1e-12);
    }
}
