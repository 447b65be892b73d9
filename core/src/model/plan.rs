//! The floor plan that a device is told: an outline, and walls that may each be shifted and turned.

use super::anchor::MappedVirtualAnchor;
use super::detection::LOGISTIC;
use super::surface::Line;
use crate::error::Error;
use crate::real::{abs, exp, larger, smaller, sqrt};
use crate::snapshot::{Digest, Sink, Written, written};
use heapless::Vec;

/// Guard: against an outline believed to the letter: its deviation, metres.
pub const OUTLINE_STD_M: f32 = 0.3;
/// Capacity: reflections of a source at most.
pub const MOST_REFLECTIONS: usize = 2;
/// Guard: against a wall without a direction: shortest segment, metres.
const SHORTEST_M: f32 = 1e-3;
/// Guard: against outlines drawn along the faces of walls: the outline's inside is looked for at this distance from a segment,
/// metres.
const FACE_M: f32 = 0.1;
/// Guard: against a wall that is no line: segments lie within this of it, metres. Plans are told to the millimetre.
const OFF_LINE_M: f32 = 0.01;

/// What is known of the surroundings before the start.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Map<'a> {
    /// Virtual anchors whose walls are not known, by their positions.
    pub virtual_anchors: &'a [MappedVirtualAnchor],
    /// The floor plan.
    pub plan: Option<Plan<'a>>,
}

/// A floor plan.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Plan<'a> {
    /// Corners of the outline in order, either way round, metres: the tag is inside. Empty where there is none.
    pub outline_m: &'a [[f32; 2]],
    /// The walls, those of the outline among them.
    pub walls: &'a [PlanWall],
    /// What the walls consist of.
    pub segments: &'a [PlanSegment],
    /// Standard deviation of the angle by which the plan as a whole may be turned, radians (0 to 1).
    pub turn_std_rad: f32,
    /// Reflections per path that sources are listed for: 0 to 2.
    pub reflections: usize,
    /// Sources that are listed at most; no more than fit are.
    pub most_sources: usize,
}

/// A wall of a plan: how far it may be from where it is told. 0 and 0: it is exactly there.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct PlanWall {
    /// Standard deviation of its offset along its normal, metres (0, or 1e-4 to 100).
    pub offset_std_m: f32,
    /// Standard deviation of its rotation about its centre, radians (0, or 1e-6 to 1).
    pub rotation_std_rad: f32,
}

/// A segment of a wall. All segments of a wall are on one line.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct PlanSegment {
    /// Index of its wall.
    pub wall: usize,
    /// Both ends, metres (within 10 km of the origin).
    pub ends_m: [[f32; 2]; 2],
}

/// A wall as it is kept.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wall {
    /// Its line: the centre in the middle of its extent, the normal turned left from the first segment's direction.
    pub line: Line,
    /// Half its extent, metres.
    pub half_length_m: f32,
    /// How far it may be from there.
    pub told: PlanWall,
    /// Its slot in the state filter, where a source is reflected by it.
    pub surface: Option<u8>,
    /// Where its segments begin and end among all.
    segments: [u16; 2],
}

/// On which side of a segment the outline's inside is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Inside {
    /// Before it alone, where the normal of its wall leads.
    Before,
    /// Behind it alone.
    Behind,
    /// On both or none.
    Either,
}

/// A segment as it is kept: part of a wall's line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Segment {
    /// Index of its wall.
    pub wall: u16,
    /// Where the outline's inside is.
    pub inside: Inside,
    /// Where it begins and ends along the line's tangent, from the centre, metres; ascending.
    pub extent_m: [f32; 2],
}

/// A floor plan as it is kept.
#[derive(Clone, Debug, PartialEq)]
pub struct FloorPlan<const SEGMENTS: usize> {
    walls: Vec<Wall, SEGMENTS>,
    segments: Vec<Segment, SEGMENTS>,
    outline_m: Vec<[f32; 2], SEGMENTS>,
}

impl<const SEGMENTS: usize> FloorPlan<SEGMENTS> {
    /// The plan as told.
    ///
    /// # Errors
    /// The first wall, segment or corner that is out of range, or more of them than there is room for.
    pub fn new(plan: &Plan<'_>) -> Result<Self, Error> {
        let mut kept = Self::empty();
        kept.keep(plan)?;
        Ok(kept)
    }

    /// Keeps a plan in the place of what was kept.
    ///
    /// # Errors
    /// As [`Self::new`]; nothing is kept then.
    #[inline(never)]
    pub fn keep(&mut self, plan: &Plan<'_>) -> Result<(), Error> {
        self.clear();
        let kept = self.fill(plan);
        if kept.is_err() {
            self.clear();
        }
        kept
    }

    /// No plan.
    pub const fn empty() -> Self {
        Self { walls: Vec::new(), segments: Vec::new(), outline_m: Vec::new() }
    }

    /// No plan again.
    pub fn clear(&mut self) {
        self.walls.clear();
        self.segments.clear();
        self.outline_m.clear();
    }

    fn fill(&mut self, plan: &Plan<'_>) -> Result<(), Error> {
        let Plan { outline_m, walls, segments, turn_std_rad, reflections, most_sources: _ } = *plan;
        let given = larger_count(outline_m.len(), larger_count(walls.len(), segments.len()));
        if given > SEGMENTS {
            return Err(Error::PlanSize { given, limit: SEGMENTS });
        }
        let is_angle = (0.0..=1.0).contains(&turn_std_rad);
        if !is_angle || reflections > MOST_REFLECTIONS {
            return Err(Error::PlanSettings);
        }
        // As many of everything as were counted: the pushes succeed.
        for corner_m in outline_m {
            let _ = self.outline_m.push(*corner_m);
        }
        for (index, told) in walls.iter().enumerate() {
            let wall = wall(index, told, segments).ok_or(Error::PlanWall { index })?;
            let _ = self.walls.push(wall);
        }
        for (index, segment) in segments.iter().enumerate() {
            let wall = self.walls.get(segment.wall).ok_or(Error::PlanSegment { index })?;
            let [from, to] = segment.ends_m;
            let is_on_line =
                abs(wall.line.distance_m(from)) <= OFF_LINE_M && abs(wall.line.distance_m(to)) <= OFF_LINE_M;
            let [a, b] = [wall.line.place_m(from), wall.line.place_m(to)];
            if !is_on_line || !(abs(b - a) >= SHORTEST_M) || !are_near(&segment.ends_m) {
                return Err(Error::PlanSegment { index });
            }
        }
        let outline_m = &self.outline_m;
        for (index, wall) in self.walls.iter_mut().enumerate() {
            let begin = self.segments.len() as u16;
            for segment in segments.iter().filter(|segment| segment.wall == index) {
                let [a, b] = segment.ends_m.map(|end_m| wall.line.place_m(end_m));
                let extent_m = [smaller(a, b), larger(a, b)];
                let inside = inside(outline_m, &wall.line, 0.5 * (a + b));
                let _ = self.segments.push(Segment { wall: index as u16, inside, extent_m });
            }
            wall.segments = [begin, self.segments.len() as u16];
        }
        if outline_m.len() == 1 || outline_m.len() == 2 {
            return Err(Error::PlanOutline { index: outline_m.len() });
        }
        match outline_m.iter().position(|corner_m| !are_near(core::slice::from_ref(corner_m))) {
            Some(index) => Err(Error::PlanOutline { index }),
            None => Ok(()),
        }
    }

    /// The walls.
    // Here and below: where there is no room the compiler knows that there is no entry.
    pub fn walls(&self) -> &[Wall] {
        if SEGMENTS == 0 { &[] } else { &self.walls }
    }

    /// The segments of all walls, by wall.
    pub fn segments(&self) -> &[Segment] {
        if SEGMENTS == 0 { &[] } else { &self.segments }
    }

    /// The segments of a wall of this plan.
    pub fn segments_of(&self, wall: &Wall) -> &[Segment] {
        let [begin, end] = wall.segments.map(usize::from);
        self.segments.get(begin..end).unwrap_or_default()
    }

    /// Corners of the outline, metres.
    pub fn outline_m(&self) -> &[[f32; 2]] {
        if SEGMENTS == 0 { &[] } else { &self.outline_m }
    }

    /// Gives a wall its slot in the state filter.
    pub fn assign(&mut self, wall: usize, surface: u8) {
        if let Some(wall) = self.walls.get_mut(wall) {
            wall.surface = Some(surface);
        }
    }

    /// The wall that has a slot in the state filter.
    pub fn wall_of(&self, surface: usize) -> Option<usize> {
        self.walls().iter().position(|wall| wall.surface.map(usize::from) == Some(surface))
    }

    /// The box of the outline, or of the walls where there is no outline: its lower left and upper right corners, metres;
    /// infinite and the wrong way round where there is neither.
    pub fn box_m(&self) -> [[f32; 2]; 2] {
        let mut low = [f32::INFINITY; 2];
        let mut high = [f32::NEG_INFINITY; 2];
        let mut cover = |[x, y]: [f32; 2]| {
            let ([left, bottom], [right, top]) = (low, high);
            low = [smaller(left, x), smaller(bottom, y)];
            high = [larger(right, x), larger(top, y)];
        };
        self.outline_m.iter().for_each(|corner_m| cover(*corner_m));
        if self.outline_m.is_empty() {
            for Wall { line, half_length_m, .. } in &self.walls {
                let ([x, y], [tx, ty]) = (line.centre_m, line.tangent());
                let (dx, dy) = (half_length_m * tx, half_length_m * ty);
                cover([x - dx, y - dy]);
                cover([x + dx, y + dy]);
            }
        }
        [low, high]
    }

    /// The middle of that box, metres.
    pub fn middle_m(&self) -> [f32; 2] {
        let [[left, bottom], [right, top]] = self.box_m();
        [0.5 * (left + right), 0.5 * (bottom + top)]
    }

    /// Probability that the tag may be around a point known within a deviation per axis, metres: that this is inside the outline,
    /// which is as uncertain as [`OUTLINE_STD_M`]. 1 where there is no outline.
    pub fn inside(&self, point_m: [f32; 2], std_m: f32) -> f32 {
        let depth_m = self.depth_m(point_m);
        if depth_m == f32::INFINITY {
            return 1.0;
        }
        let deviation_m = sqrt(std_m * std_m + OUTLINE_STD_M * OUTLINE_STD_M);
        1.0 / (1.0 + exp(-LOGISTIC * (depth_m / deviation_m)))
    }

    /// By how far a point lies inside the outline, negative outside, metres; infinite where there is no outline.
    pub fn depth_m(&self, point_m: [f32; 2]) -> f32 {
        if self.outline_m().is_empty() { f32::INFINITY } else { depth_m(&self.outline_m, point_m) }
    }
}

/// See [`FloorPlan::depth_m`]: of an outline that has corners.
#[inline(never)]
fn depth_m(outline_m: &[[f32; 2]], point_m: [f32; 2]) -> f32 {
    let [x, y] = point_m;
    let mut is_inside = false;
    let mut nearest = f32::INFINITY;
    let ahead = outline_m.iter().cycle().skip(1);
    for ([ax, ay], [bx, by]) in outline_m.iter().zip(ahead) {
        if (*ay > y) != (*by > y) && x < (bx - ax) * ((y - ay) / (by - ay)) + ax {
            is_inside = !is_inside;
        }
        let (sx, sy) = (bx - ax, by - ay);
        let length2 = larger(sx * sx + sy * sy, f32::MIN_POSITIVE);
        let share = crate::real::limited(((x - ax) * sx + (y - ay) * sy) / length2, 0.0, 1.0);
        let (dx, dy) = (x - (ax + share * sx), y - (ay + share * sy));
        nearest = smaller(nearest, dx * dx + dy * dy);
    }
    if is_inside { sqrt(nearest) } else { -sqrt(nearest) }
}

/// On which side of a line, where it is `place_m` from its centre, the outline's inside is.
fn inside(outline_m: &[[f32; 2]], line: &Line, place_m: f32) -> Inside {
    if outline_m.is_empty() {
        return Inside::Either;
    }
    let ([cx, cy], [nx, ny], [tx, ty]) = (line.centre_m, line.normal, line.tangent());
    let [x, y] = [cx + place_m * tx, cy + place_m * ty];
    let is_inside = |off_m: f32| depth_m(outline_m, [x + off_m * nx, y + off_m * ny]) >= 0.0;
    match (is_inside(FACE_M), is_inside(-FACE_M)) {
        (true, false) => Inside::Before,
        (false, true) => Inside::Behind,
        _ => Inside::Either,
    }
}

fn larger_count(a: usize, b: usize) -> usize {
    if a > b { a } else { b }
}

/// Whether points are within 10 km of the origin.
fn are_near(points_m: &[[f32; 2]]) -> bool {
    // Written so that NaN fails.
    points_m.iter().all(|[x, y]| abs(*x) <= 1e4 && abs(*y) <= 1e4)
}

/// The wall that these segments make; `None` where it has none, or deviations out of range.
fn wall(index: usize, told: &PlanWall, segments: &[PlanSegment]) -> Option<Wall> {
    let PlanWall { offset_std_m: o, rotation_std_rad: r } = *told;
    let is_told = (o == 0.0 || (1e-4..=100.0).contains(&o)) && (r == 0.0 || (1e-6..=1.0).contains(&r));
    let own = segments.iter().filter(|segment| segment.wall == index);
    let [[ax, ay], [bx, by]] = own.clone().next()?.ends_m;
    let (dx, dy) = (bx - ax, by - ay);
    let length_m = sqrt(dx * dx + dy * dy);
    if !is_told || !(length_m >= SHORTEST_M) || !are_near(&[[ax, ay], [bx, by]]) {
        return None;
    }
    let [tx, ty] = [dx / length_m, dy / length_m];
    // Along the tangent, from the first end.
    let (mut from_m, mut to_m) = (0.0, length_m);
    for [x, y] in own.flat_map(|segment| segment.ends_m) {
        let place_m = tx * (x - ax) + ty * (y - ay);
        (from_m, to_m) = (smaller(from_m, place_m), larger(to_m, place_m));
    }
    let middle_m = 0.5 * (from_m + to_m);
    let line = Line { centre_m: [ax + middle_m * tx, ay + middle_m * ty], normal: [-ty, tx] };
    Some(Wall { line, half_length_m: 0.5 * (to_m - from_m), told: *told, surface: None, segments: [0; 2] })
}

impl Written for Inside {
    fn write(&self, to: &mut impl Sink) {
        let kind: u8 = match self {
            Self::Before => 0,
            Self::Behind => 1,
            Self::Either => 2,
        };
        kind.write(to);
    }
}

written!(PlanWall { offset_std_m, rotation_std_rad });
written!(PlanSegment { wall, ends_m });
written!(Wall { line, half_length_m, told, surface, segments });
written!(Segment { wall, inside, extent_m });
written!(FloorPlan<const SEGMENTS> { walls, segments, outline_m });

impl Map<'_> {
    /// Digest of all that it tells.
    pub(crate) fn digest(&self) -> u64 {
        let mut digest = Digest::default();
        self.virtual_anchors.len().write(&mut digest);
        self.virtual_anchors.iter().for_each(|mapped| mapped.write(&mut digest));
        if let Some(Plan { outline_m, walls, segments, turn_std_rad, reflections, most_sources }) = &self.plan
        {
            outline_m.iter().for_each(|corner_m| corner_m.write(&mut digest));
            walls.iter().for_each(|wall| wall.write(&mut digest));
            segments.iter().for_each(|segment| segment.write(&mut digest));
            [outline_m.len(), walls.len(), segments.len(), *reflections, *most_sources].write(&mut digest);
            turn_std_rad.write(&mut digest);
        }
        digest.value()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const EXACT: PlanWall = PlanWall { offset_std_m: 0.0, rotation_std_rad: 0.0 };

    fn segment(wall: usize, a: [f32; 2], b: [f32; 2]) -> PlanSegment {
        PlanSegment { wall, ends_m: [a, b] }
    }

    fn plan<'a>(
        outline_m: &'a [[f32; 2]],
        walls: &'a [PlanWall],
        segments: &'a [PlanSegment],
    ) -> Result<FloorPlan<8>, Error> {
        FloorPlan::new(&Plan {
            outline_m,
            walls,
            segments,
            turn_std_rad: 0.01,
            reflections: 2,
            most_sources: 24,
        })
    }

    #[test]
    fn collinear_segments_are_one_wall_about_the_middle_of_its_extent() {
        let segments = [segment(0, [1.0, 2.0], [3.0, 2.0]), segment(0, [9.0, 2.0], [5.0, 2.0])];
        let plan = plan(&[], &[EXACT], &segments).unwrap();
        let wall = plan.walls()[0];
        assert_eq!(wall.line, Line { centre_m: [5.0, 2.0], normal: [0.0, 1.0] });
        assert_eq!(wall.half_length_m, 4.0);
        // Along the tangent, which is the normal turned left: against the first segment here.
        assert_eq!(plan.segments()[1].extent_m, [-4.0, 0.0]);
        assert_eq!(plan.depth_m([1e3, 0.0]), f32::INFINITY);
    }

    #[test]
    fn what_is_no_plan_is_refused_by_name() {
        let ok = [segment(0, [0.0, 0.0], [1.0, 0.0])];
        let nan = PlanWall { offset_std_m: f32::NAN, rotation_std_rad: 0.0 };
        assert_eq!(plan(&[], &[nan], &ok).unwrap_err(), Error::PlanWall { index: 0 });
        assert_eq!(plan(&[], &[EXACT, EXACT], &ok).unwrap_err(), Error::PlanWall { index: 1 });
        assert_eq!(plan(&[], &[], &ok).unwrap_err(), Error::PlanSegment { index: 0 });
        let bent = [ok[0], segment(0, [2.0, 0.0], [3.0, 0.1])];
        assert_eq!(plan(&[], &[EXACT], &bent).unwrap_err(), Error::PlanSegment { index: 1 });
        assert_eq!(plan(&[[0.0; 2]; 2], &[EXACT], &ok).unwrap_err(), Error::PlanOutline { index: 2 });
        let far = [[0.0, 0.0], [1e5, 0.0], [1.0, 1.0]];
        assert_eq!(plan(&far, &[EXACT], &ok).unwrap_err(), Error::PlanOutline { index: 1 });
        assert_eq!(plan(&[[0.0; 2]; 9], &[], &[]).unwrap_err(), Error::PlanSize { given: 9, limit: 8 });
        let turned = Plan { turn_std_rad: -0.1, ..Plan::default() };
        assert_eq!(FloorPlan::<8>::new(&turned).unwrap_err(), Error::PlanSettings);
    }

    #[test]
    fn depth_is_the_distance_from_the_outline_with_a_sign() {
        let corners = [[0.0, 0.0], [10.0, 0.0], [10.0, 4.0], [5.0, 4.0], [5.0, 8.0], [0.0, 8.0]];
        let plan = plan(&corners, &[], &[]).unwrap();
        for (point, depth) in [([1.0, 4.0], 1.0), ([7.0, 6.0], -2.0), ([-3.0, -4.0], -5.0), ([8.0, 2.0], 2.0)]
        {
            assert!((plan.depth_m(point) - depth).abs() < 1e-6, "{point:?}: {}", plan.depth_m(point));
        }
        assert_eq!(plan.middle_m(), [5.0, 4.0]);
    }
}
