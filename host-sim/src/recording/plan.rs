//! The floor plan that a tracker is told: an outline, and walls that may each be shifted and turned.

use serde::{Deserialize, Serialize};

/// As well as a plan is laid over a survey, degrees.
pub const USUAL_TURN_STD_DEG: f64 = 0.5;
/// Sources that are listed of a plan which says nothing else.
pub const USUAL_SOURCES: usize = 24;
/// No plan has more walls than this.
pub const MAX_PLAN_WALLS: usize = 400;
/// No wall of a plan has more segments than this, and no outline more corners.
pub const MAX_PLAN_SEGMENTS: usize = 400;
/// No told source reflects more often than this.
pub const MAX_SEQUENCE: usize = 2;
/// Segments of a wall lie within this of its line, metres: they are stored to the digits that were written.
pub const LINE_TOLERANCE_M: f64 = 1e-3;

/// A floor plan as it is told: each wall may really be shifted along its normal and turned about its centre.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Plan {
    /// Corners of the outline in order, either way round, in metres: the tag is inside.
    pub outline_m: Vec<[f64; 2]>,
    /// Standard deviation of the angle by which the plan as a whole may be turned, in radians.
    #[serde(default = "usual_turn_std_rad")]
    pub turn_std_rad: f64,
    /// Reflections per path that sources are listed for.
    #[serde(default = "usual_reflections")]
    pub reflections: usize,
    /// Sources that are listed at most.
    #[serde(default = "usual_most_sources")]
    pub most_sources: usize,
    /// The walls, those of the outline among them.
    #[serde(default)]
    pub walls: Vec<PlanWall>,
}

fn usual_turn_std_rad() -> f64 {
    USUAL_TURN_STD_DEG.to_radians()
}

fn usual_reflections() -> usize {
    MAX_SEQUENCE
}

fn usual_most_sources() -> usize {
    USUAL_SOURCES
}

/// A wall of a plan: collinear segments that are shifted and turned together.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlanWall {
    /// Its parts, each from end to end, in metres; all on one line, at least one of them, none without length.
    pub segments_m: Vec<[[f64; 2]; 2]>,
    /// Standard deviation of the offset along its normal, in metres.
    pub offset_std_m: f64,
    /// Standard deviation of the rotation about its centre, in radians.
    pub rotation_std_rad: f64,
    /// What it is built of; where it is several things, what its first segment is.
    pub construction: String,
}

impl PlanWall {
    /// Unit vector along the wall, the way that its first segment runs.
    pub fn direction(&self) -> [f64; 2] {
        let (_, direction) = line_of(&self.segments_m);
        direction
    }

    /// Unit normal: the direction turned left, (-y, x).
    pub fn normal(&self) -> [f64; 2] {
        let [x, y] = self.direction();
        [-y, x]
    }

    /// Midpoint of the extent of all segments, in metres: what the rotation is about.
    pub fn centre_m(&self) -> [f64; 2] {
        let ([from_m, to_m], (a, [x, y])) = (self.extent_m(), line_of(&self.segments_m));
        let middle_m = 0.5 * (from_m + to_m);
        [a[0] + middle_m * x, a[1] + middle_m * y]
    }

    /// Half the length from the first end of any segment to the last, gaps included, in metres.
    pub fn half_length_m(&self) -> f64 {
        let [from_m, to_m] = self.extent_m();
        0.5 * (to_m - from_m)
    }

    /// Its segments laid on its line, the longest first and running along its direction, the others in order: what is lost
    /// when they are rounded then turns the wall the least.
    pub fn on_line_m(&self) -> Vec<[[f64; 2]; 2]> {
        if self.segments_m.len() < 2 {
            return self.segments_m.clone();
        }
        let (a, [x, y]) = line_of(&self.segments_m);
        let place_m = |end: [f64; 2]| (end[0] - a[0]) * x + (end[1] - a[1]) * y;
        let mut places_m: Vec<[f64; 2]> = self.segments_m.iter().map(|ends_m| ends_m.map(place_m)).collect();
        let length_m = |[from_m, to_m]: [f64; 2]| (to_m - from_m).abs();
        let longer = |longest: usize, n: usize| {
            if length_m(places_m[n]) > length_m(places_m[longest]) { n } else { longest }
        };
        let longest = (0..places_m.len()).fold(0, longer);
        places_m[..=longest].rotate_right(1);
        places_m[0].sort_by(f64::total_cmp);
        let end_m = |place_m: f64| [a[0] + place_m * x, a[1] + place_m * y];
        places_m.into_iter().map(|places_m| places_m.map(end_m)).collect()
    }

    /// Least and largest place of any end along the wall, from the point that its line is given by, in metres.
    fn extent_m(&self) -> [f64; 2] {
        let (a, [x, y]) = line_of(&self.segments_m);
        let places = self.segments_m.iter().flatten().map(|end| (end[0] - a[0]) * x + (end[1] - a[1]) * y);
        places.fold([0.0, 0.0], |[from, to]: [f64; 2], place| [from.min(place), to.max(place)])
    }

    /// Largest distance of any end from the wall's line, in metres.
    pub(crate) fn off_line_m(&self) -> f64 {
        off_line_m(&self.segments_m)
    }
}

/// A point on the line of segments, and the unit vector along it, the way that the first runs. One segment is its line; several
/// have the one with the least square distance from all their points, so that a short segment does not turn a long wall.
fn line_of(segments_m: &[[[f64; 2]; 2]]) -> ([f64; 2], [f64; 2]) {
    let Some(&[origin_m, to_m]) = segments_m.first() else { return ([0.0; 2], [1.0, 0.0]) };
    let first = [to_m[0] - origin_m[0], to_m[1] - origin_m[1]];
    let unit = |[x, y]: [f64; 2]| {
        let length = (x * x + y * y).sqrt();
        [x / length, y / length]
    };
    if segments_m.len() == 1 {
        return (origin_m, unit(first));
    }
    // From the first end: far from the origin no digits are lost.
    let pieces = || {
        segments_m.iter().map(|[a, b]| {
            let [x, y] = [b[0] - a[0], b[1] - a[1]];
            let middle_m = [0.5 * (a[0] + b[0]) - origin_m[0], 0.5 * (a[1] + b[1]) - origin_m[1]];
            ((x * x + y * y).sqrt(), middle_m, [x, y])
        })
    };
    let total_m: f64 = pieces().map(|(length_m, ..)| length_m).sum();
    let mean = |axis: usize| {
        pieces().map(|(length_m, middle_m, _)| length_m * middle_m[axis]).sum::<f64>() / total_m
    };
    let mean_m = [mean(0), mean(1)];
    let moment = |i: usize, j: usize| -> f64 {
        let of = |(length_m, middle_m, along): (f64, [f64; 2], [f64; 2])| {
            let between = (middle_m[i] - mean_m[i]) * (middle_m[j] - mean_m[j]);
            length_m * (between + along[i] * along[j] / 12.0)
        };
        pieces().map(of).sum()
    };
    let (half, cross) = (0.5 * (moment(0, 0) - moment(1, 1)), moment(0, 1));
    let root = half.hypot(cross);
    let [x, y] = unit(if half < 0.0 { [cross, root - half] } else { [root + half, cross] });
    let direction = if x * first[0] + y * first[1] < 0.0 { [-x, -y] } else { [x, y] };
    ([origin_m[0] + mean_m[0], origin_m[1] + mean_m[1]], direction)
}

/// Largest distance of any end of segments from their line, in metres.
pub(crate) fn off_line_m(segments_m: &[[[f64; 2]; 2]]) -> f64 {
    let (a, [x, y]) = line_of(segments_m);
    let away = segments_m.iter().flatten().map(|end| ((end[1] - a[1]) * x - (end[0] - a[0]) * y).abs());
    away.fold(0.0, f64::max)
}

/// The walls of a plan that a path meets, by index, in order from the anchor outwards: at most [`MAX_SEQUENCE`].
/// Empty where it is not known.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(try_from = "Vec<u16>", into = "Vec<u16>")]
pub struct WallSequence([Option<u16>; MAX_SEQUENCE]);

impl WallSequence {
    /// The sequence of these walls; `None` for more than [`MAX_SEQUENCE`] or an index beyond 65535.
    pub fn new(walls: &[usize]) -> Option<Self> {
        let mut sequence = Self::default();
        if walls.len() > MAX_SEQUENCE {
            return None;
        }
        for (slot, &wall) in sequence.0.iter_mut().zip(walls) {
            *slot = Some(u16::try_from(wall).ok()?);
        }
        Some(sequence)
    }

    /// The walls in order.
    pub fn iter(&self) -> impl DoubleEndedIterator<Item = usize> + '_ {
        self.0.iter().flatten().map(|&wall| usize::from(wall))
    }

    /// Number of walls: the order of the reflection.
    pub fn len(&self) -> usize {
        self.iter().count()
    }

    /// Whether the walls are not known.
    pub fn is_empty(&self) -> bool {
        self.0[0].is_none()
    }
}

impl TryFrom<Vec<u16>> for WallSequence {
    type Error = String;

    fn try_from(walls: Vec<u16>) -> Result<Self, String> {
        let walls: Vec<usize> = walls.into_iter().map(usize::from).collect();
        Self::new(&walls)
            .ok_or_else(|| format!("{} walls where at most {MAX_SEQUENCE} are allowed", walls.len()))
    }
}

impl From<WallSequence> for Vec<u16> {
    fn from(sequence: WallSequence) -> Self {
        sequence.0.into_iter().flatten().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_centre_of_a_wall_is_the_middle_of_all_its_segments() {
        let wall = PlanWall {
            segments_m: vec![[[1.0, 1.0], [2.0, 2.0]], [[5.0, 5.0], [4.0, 4.0]]],
            offset_std_m: 0.1,
            rotation_std_rad: 0.01,
            construction: "brick".into(),
        };
        let near = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).abs() < 1e-12 && (a[1] - b[1]).abs() < 1e-12;
        let half = std::f64::consts::FRAC_1_SQRT_2;
        assert!(near(wall.centre_m(), [3.0, 3.0]), "{:?}", wall.centre_m());
        assert!(near(wall.direction(), [half, half]) && near(wall.normal(), [-half, half]));
        assert!((wall.half_length_m() - 8.0_f64.sqrt()).abs() < 1e-12 && wall.off_line_m() < 1e-12);
    }

    #[test]
    fn a_short_first_segment_does_not_turn_a_long_wall() {
        // As drawn to the millimetre: the first has a direction wrong by 20 mrad of its own.
        let wall = PlanWall {
            segments_m: vec![[[700.0, 500.0], [700.03, 500.0006]], [[701.0, 500.0], [712.0, 500.001]]],
            offset_std_m: 0.1,
            rotation_std_rad: 0.01,
            construction: "brick".into(),
        };
        let [_, turned] = wall.direction();
        assert!(
            turned.abs() < 2e-4 && wall.off_line_m() < LINE_TOLERANCE_M,
            "{turned} {}",
            wall.off_line_m()
        );
        let [[a, b], [c, d]] = wall.on_line_m()[..] else { panic!("two segments") };
        assert!((b[0] - a[0] - 11.0).abs() < 1e-3 && (d[0] - c[0] - 0.03).abs() < 1e-3);
        assert!(off_line_m(&[[a, b], [c, d]]) < 1e-9);
    }

    #[test]
    fn a_sequence_holds_two_walls_in_order_and_no_more() {
        let sequence = WallSequence::new(&[7, 2]).unwrap();
        assert_eq!((sequence.iter().collect::<Vec<_>>(), sequence.len()), (vec![7, 2], 2));
        assert!(WallSequence::new(&[]).unwrap().is_empty());
        assert_eq!(WallSequence::new(&[1, 2, 3]), None);
        assert_eq!(WallSequence::new(&[1 << 16]), None);
    }
}
