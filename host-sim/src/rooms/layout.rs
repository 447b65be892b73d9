//! Floor plans of the families.

use super::draws::{Aspect, Draws, centimetres};
use crate::geometry::{Wall, polygon};
use crate::scenario::{InnerWall, Position, Room};
use serde::Serialize;

/// The kind of floor plan.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Family {
    /// A flat: a rectangle divided again and again, a door in every wall.
    Flat,
    /// A corridor with side rooms on one or both sides.
    Corridor,
    /// An open plan with glass boxes, partitions and pillars.
    OpenPlan,
    /// A hall with rows of racks.
    Hall,
    /// A room in the shape of an L or a T.
    LOrT,
    /// A stairwell: small, high, a wall between the flights.
    Stairwell,
    /// An irregular polygon.
    Polygon,
}

impl Family {
    /// All of them.
    pub const ALL: [Family; 7] = [
        Family::Flat,
        Family::Corridor,
        Family::OpenPlan,
        Family::Hall,
        Family::LOrT,
        Family::Stairwell,
        Family::Polygon,
    ];

    /// Its name on the command line and in tables.
    pub fn name(self) -> &'static str {
        match self {
            Family::Flat => "flat",
            Family::Corridor => "corridor",
            Family::OpenPlan => "open-plan",
            Family::Hall => "hall",
            Family::LOrT => "l-or-t",
            Family::Stairwell => "stairwell",
            Family::Polygon => "polygon",
        }
    }
}

/// A floor plan with the height that anchors can be mounted at.
#[derive(Clone, Debug)]
pub(super) struct Layout {
    pub(super) room: Room,
    pub(super) ceiling_m: f64,
}

/// Constructions of outer walls, of inner walls, and of what is of glass.
const OUTER: [(&str, f64); 7] = [
    ("concrete", 3.0),
    ("brick", 3.0),
    ("drywall", 2.0),
    ("double-glazing", 1.0),
    ("glass", 1.0),
    ("metal", 1.0),
    ("wood", 1.0),
];
const INNER: [(&str, f64); 8] = [
    ("drywall", 3.0),
    ("plasterboard", 1.0),
    ("plasterboard-double", 1.0),
    ("brick", 2.0),
    ("concrete", 1.0),
    ("glass-4mm", 1.0),
    ("wood", 1.0),
    ("chipboard", 1.0),
];
const GLASS: [(&str, f64); 3] = [("glass", 1.0), ("glass-4mm", 1.0), ("double-glazing", 1.0)];
const RACKS: [(&str, f64); 2] = [("metal", 3.0), ("chipboard", 1.0)];

/// What an inner wall is for.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Use {
    Partition,
    Glass,
    Rack,
    Pillar,
}

/// A floor plan without constructions.
struct Bare {
    corners_m: Vec<Position>,
    inner: Vec<([Position; 2], Use)>,
    ceiling_m: f64,
}

/// The floor plan of a family.
pub(super) fn layout(seed: u64, family: Family) -> Layout {
    let mut draws = Draws::new(seed, Aspect::Layout);
    let bare = match family {
        Family::Flat => flat(&mut draws),
        Family::Corridor => corridor(&mut draws),
        Family::OpenPlan => open_plan(&mut draws),
        Family::Hall => hall(&mut draws),
        Family::LOrT => l_or_t(&mut draws),
        Family::Stairwell => stairwell(&mut draws),
        Family::Polygon => irregular(&mut draws),
    };
    let mut draws = Draws::new(seed, Aspect::Constructions);
    // Either one construction for all sides, or one for each.
    let common = draws.weighted(&OUTER);
    let is_mixed = draws.chance(0.5);
    let side = |draws: &mut Draws| if is_mixed { draws.weighted(&OUTER) } else { common };
    let sides = bare.corners_m.iter().map(|_| side(&mut draws).to_owned()).collect();
    let [partition, glass, rack] = [draws.weighted(&INNER), draws.weighted(&GLASS), draws.weighted(&RACKS)];
    let are_mixed = draws.chance(0.5);
    let inner = |([from_m, to_m], of_use): ([Position; 2], Use)| {
        let construction = match of_use {
            Use::Partition if are_mixed => draws.weighted(&INNER),
            Use::Partition => partition,
            Use::Glass => glass,
            Use::Rack => rack,
            Use::Pillar => "concrete",
        };
        InnerWall { from_m, to_m, construction: construction.into() }
    };
    let inner_walls = bare.inner.into_iter().map(inner).collect();
    let room = Room { corners_m: bare.corners_m, construction: "concrete".into(), sides, inner_walls };
    Layout { room, ceiling_m: bare.ceiling_m }
}

fn rectangle(width_m: f64, depth_m: f64) -> Vec<Position> {
    vec![[0.0, 0.0], [width_m, 0.0], [width_m, depth_m], [0.0, depth_m]]
}

/// A wall along an axis that divides a part of a floor plan, with the places where other walls abut on it.
struct Divider {
    /// 0: along x, at a constant y; 1: along y, at a constant x.
    axis: usize,
    across_m: f64,
    span_m: [f64; 2],
    abutments_m: Vec<f64>,
}

impl Divider {
    fn point_m(&self, along_m: f64) -> Position {
        if self.axis == 0 { [along_m, self.across_m] } else { [self.across_m, along_m] }
    }

    /// Its two pieces beside a door, which lies where nothing abuts; the whole wall where there is no room for one.
    fn pieces(&self, draws: &mut Draws) -> Vec<[Position; 2]> {
        let [from_m, to_m] = self.span_m;
        let mut marks = vec![from_m];
        let mut between = self.abutments_m.clone();
        between.sort_by(f64::total_cmp);
        marks.extend(between);
        marks.push(to_m);
        let gaps: Vec<[f64; 2]> =
            marks.windows(2).map(|ends| [ends[0], ends[1]]).filter(|[a, b]| b - a > 1.5).collect();
        let width_m = draws.length_m(0.8, 1.1);
        if gaps.is_empty() {
            return Vec::new();
        }
        let [a, b] = draws.one_of(&gaps);
        let door_m = draws.length_m(a + 0.15, b - 0.15 - width_m);
        [[from_m, door_m], [centimetres(door_m + width_m), to_m]]
            .into_iter()
            .map(|ends| ends.map(|end| self.point_m(end)))
            .collect()
    }
}

fn flat(draws: &mut Draws) -> Bare {
    let (width_m, depth_m) = (draws.length_m(7.0, 14.0), draws.length_m(6.0, 11.0));
    let mut dividers: Vec<Divider> = Vec::new();
    let mut parts = vec![[[0.0, width_m], [0.0, depth_m]]];
    while let Some(part) = parts.pop() {
        let sizes_m = part.map(|[a, b]| b - a);
        let longer = usize::from(sizes_m[1] > sizes_m[0]);
        // Rooms of less than 2.2 m are not made, and not all that could be divided are.
        if sizes_m[longer] < 4.6 || (dividers.len() >= 2 && draws.chance(0.3)) {
            continue;
        }
        let [a, b] = part[longer];
        let across_m = draws.length_m(a + 2.2, b - 2.2);
        // The wall stands across the longer side and runs along the other.
        let along = 1 - longer;
        let span_m = part[along];
        for divider in &mut dividers {
            let [from_m, to_m] = divider.span_m;
            let meets = span_m.contains(&divider.across_m) && across_m > from_m && across_m < to_m;
            if divider.axis == longer && meets {
                divider.abutments_m.push(across_m);
            }
        }
        dividers.push(Divider { axis: along, across_m, span_m, abutments_m: Vec::new() });
        let (mut first, mut second) = (part, part);
        first[longer] = [a, across_m];
        second[longer] = [across_m, b];
        parts.extend([first, second]);
    }
    let pieces = dividers.iter().flat_map(|divider| divider.pieces(draws));
    let inner = pieces.map(|ends_m| (ends_m, Use::Partition)).collect();
    Bare { corners_m: rectangle(width_m, depth_m), inner, ceiling_m: draws.length_m(2.4, 2.8) }
}

fn corridor(draws: &mut Draws) -> Bare {
    let (length_m, width_m) = (draws.length_m(14.0, 30.0), draws.length_m(1.8, 2.6));
    let [south_m, north_m] =
        if draws.chance(0.5) { [true, true] } else { draws.one_of(&[[true, false], [false, true]]) }
            .map(|is_there| if is_there { draws.length_m(3.0, 5.0) } else { 0.0 });
    let depth_m = centimetres(south_m + width_m + north_m);
    let mut inner = Vec::new();
    for (wall_m, far_m) in [(south_m, 0.0), (centimetres(south_m + width_m), depth_m)] {
        if (wall_m - far_m).abs() < 1.0 {
            continue;
        }
        // Rooms of 3 to 6 m, each with a door to the corridor.
        let mut ends_m = vec![0.0];
        while let Some(&last_m) = ends_m.last()
            && length_m - last_m >= 6.0
        {
            ends_m.push(centimetres(last_m + draws.length_m(3.0, (length_m - last_m - 3.0).min(6.0))));
        }
        ends_m.push(length_m);
        for side in ends_m.windows(2) {
            let span_m = [side[0], side[1]];
            let wall = Divider { axis: 0, across_m: wall_m, span_m, abutments_m: Vec::new() };
            inner.extend(wall.pieces(draws).into_iter().map(|ends_m| (ends_m, Use::Partition)));
        }
        let partitions = ends_m[1..ends_m.len() - 1].iter();
        inner.extend(partitions.map(|&x| ([[x, wall_m], [x, far_m]], Use::Partition)));
    }
    Bare { corners_m: rectangle(length_m, depth_m), inner, ceiling_m: draws.length_m(2.4, 3.2) }
}

fn open_plan(draws: &mut Draws) -> Bare {
    let (width_m, depth_m) = (draws.length_m(12.0, 24.0), draws.length_m(9.0, 16.0));
    let corners_m = rectangle(width_m, depth_m);
    let mut inner: Vec<([Position; 2], Use)> = Vec::new();
    // Glass boxes in corners, each with a door in the wall along x.
    let mut free = vec![[false, false], [true, false], [false, true], [true, true]];
    for _ in 0..draws.count(1, 3) {
        let [is_east, is_north] = free.swap_remove(draws.below(free.len()));
        let (wide_m, deep_m) = (draws.length_m(2.8, 0.35 * width_m), draws.length_m(2.5, 0.35 * depth_m));
        let x = if is_east { centimetres(width_m - wide_m) } else { wide_m };
        let y = if is_north { centimetres(depth_m - deep_m) } else { deep_m };
        let span_m = if is_east { [x, width_m] } else { [0.0, x] };
        let wall = Divider { axis: 0, across_m: y, span_m, abutments_m: Vec::new() };
        inner.extend(wall.pieces(draws).into_iter().map(|ends_m| (ends_m, Use::Glass)));
        inner.push(([[x, y], [x, if is_north { depth_m } else { 0.0 }]], Use::Glass));
    }
    for _ in 0..draws.count(1, 4) {
        let length_m = draws.length_m(1.5, 4.0);
        free_standing(draws, &corners_m, &mut inner, length_m, Use::Partition);
    }
    for _ in 0..draws.count(0, 4) {
        let side_m = draws.length_m(0.3, 0.6);
        let (x, y) = (draws.length_m(2.0, width_m - 2.6), draws.length_m(2.0, depth_m - 2.6));
        block(&corners_m, &mut inner, [x, y], [side_m, side_m], Use::Pillar);
    }
    Bare { corners_m, inner, ceiling_m: draws.length_m(2.6, 3.6) }
}

fn hall(draws: &mut Draws) -> Bare {
    let (width_m, depth_m) = (draws.length_m(20.0, 45.0), draws.length_m(14.0, 28.0));
    let corners_m = rectangle(width_m, depth_m);
    let mut inner = Vec::new();
    // Rows along x, with aisles of 2.2 m or more between them and at their ends.
    let rows = draws.count(2, 6).min(((depth_m - 3.0) / 3.4) as usize);
    let pitch_m = (depth_m - 3.0) / rows as f64;
    for row in 0..rows {
        let y =
            centimetres(2.5 + pitch_m * row as f64 + draws.length_m(0.0, (pitch_m - 3.4).clamp(0.0, 1.0)));
        let from_m = draws.length_m(2.2, 0.25 * width_m);
        let to_m = draws.length_m(0.65 * width_m, width_m - 2.2);
        block(&corners_m, &mut inner, [from_m, y], [centimetres(to_m - from_m), 1.0], Use::Rack);
    }
    Bare { corners_m, inner, ceiling_m: draws.length_m(5.0, 9.0) }
}

fn l_or_t(draws: &mut Draws) -> Bare {
    let (width_m, depth_m) = (draws.length_m(7.0, 14.0), draws.length_m(7.0, 14.0));
    let arm_m = draws.length_m(2.8, 0.5 * depth_m);
    let stem_m = draws.length_m(2.8, 0.5 * width_m);
    let corners_m = if draws.chance(0.5) {
        vec![[0.0, 0.0], [width_m, 0.0], [width_m, arm_m], [stem_m, arm_m], [stem_m, depth_m], [0.0, depth_m]]
    } else {
        // A T: the bar in the south, the stem to the north.
        let west_m = draws.length_m(1.0, width_m - stem_m - 1.0);
        let east_m = centimetres(west_m + stem_m);
        vec![
            [0.0, 0.0],
            [width_m, 0.0],
            [width_m, arm_m],
            [east_m, arm_m],
            [east_m, depth_m],
            [west_m, depth_m],
            [west_m, arm_m],
            [0.0, arm_m],
        ]
    };
    let mut inner = Vec::new();
    for _ in 0..draws.count(0, 2) {
        let length_m = draws.length_m(1.0, 2.0);
        free_standing(draws, &corners_m, &mut inner, length_m, Use::Partition);
    }
    Bare { corners_m, inner, ceiling_m: draws.length_m(2.4, 3.2) }
}

fn stairwell(draws: &mut Draws) -> Bare {
    let (width_m, depth_m) = (draws.length_m(2.6, 4.2), draws.length_m(4.5, 7.5));
    let x = centimetres(0.5 * width_m + draws.uniform(-0.15, 0.15));
    let landing_m = draws.length_m(1.1, 1.4);
    let flights = ([[x, landing_m], [x, centimetres(depth_m - landing_m)]], Use::Partition);
    let inner = if draws.chance(0.7) { vec![flights] } else { Vec::new() };
    Bare { corners_m: rectangle(width_m, depth_m), inner, ceiling_m: draws.length_m(6.0, 14.0) }
}

fn irregular(draws: &mut Draws) -> Bare {
    let count = draws.count(5, 8);
    let radius_m = draws.uniform(4.0, 8.0);
    let stretch = draws.uniform(0.6, 1.0);
    // Angles in order, no two nearer than a third of an even share.
    let share = std::f64::consts::TAU / count as f64;
    let corner = |index: usize, draws: &mut Draws| {
        let angle = share * (index as f64 + draws.uniform(-0.33, 0.33));
        let away_m = radius_m * draws.uniform(0.6, 1.1);
        let (sin, cos) = libm::sincos(angle);
        [centimetres(away_m * cos), centimetres(stretch * away_m * sin)]
    };
    let corners_m: Vec<Position> = (0..count).map(|index| corner(index, draws)).collect();
    let mut inner = Vec::new();
    for _ in 0..draws.count(0, 2) {
        let length_m = draws.length_m(1.0, 2.5);
        free_standing(draws, &corners_m, &mut inner, length_m, Use::Partition);
    }
    Bare { corners_m, inner, ceiling_m: draws.length_m(2.4, 4.0) }
}

/// Free space around whatever stands in a room, metres: people pass.
const PASSAGE_M: f64 = 0.9;

fn walls(corners_m: &[Position], inner: &[([Position; 2], Use)]) -> Vec<Wall> {
    let count = corners_m.len();
    let sides = (0..count).map(|n| [corners_m[n], corners_m[(n + 1) % count]]);
    sides
        .chain(inner.iter().map(|(ends_m, _)| *ends_m))
        .map(|ends_m| Wall { ends_m, construction: 0 })
        .collect()
}

/// A wall of this length along an axis somewhere in the room; left out where twenty places have no room for it.
fn free_standing(
    draws: &mut Draws,
    corners_m: &[Position],
    inner: &mut Vec<([Position; 2], Use)>,
    length_m: f64,
    of_use: Use,
) {
    let all = walls(corners_m, inner);
    let bound = |axis: usize| {
        let values = corners_m.iter().map(|corner| corner[axis]);
        (values.clone().fold(f64::INFINITY, f64::min), values.fold(f64::NEG_INFINITY, f64::max))
    };
    let ((west_m, east_m), (south_m, north_m)) = (bound(0), bound(1));
    for _ in 0..20 {
        let from_m = [draws.length_m(west_m, east_m), draws.length_m(south_m, north_m)];
        let mut to_m = from_m;
        let axis = draws.below(2);
        to_m[axis] = centimetres(to_m[axis] + length_m);
        let wall = Wall { ends_m: [from_m, to_m], construction: 0 };
        let is_inside = wall.ends_m.iter().all(|&end| polygon::contains(corners_m, end));
        if is_inside && all.iter().all(|other| !polygon::nearer(&wall, other, PASSAGE_M)) {
            inner.push((wall.ends_m, of_use));
            return;
        }
    }
}

/// Four walls around a block; left out where something else is too near.
fn block(
    corners_m: &[Position],
    inner: &mut Vec<([Position; 2], Use)>,
    [x, y]: Position,
    [width_m, depth_m]: [f64; 2],
    of_use: Use,
) {
    let (east_m, north_m) = (centimetres(x + width_m), centimetres(y + depth_m));
    let corners = [[x, y], [east_m, y], [east_m, north_m], [x, north_m]];
    let sides: Vec<[Position; 2]> = (0..4).map(|n| [corners[n], corners[(n + 1) % 4]]).collect();
    let all = walls(corners_m, inner);
    let is_free = sides.iter().all(|&ends_m| {
        let side = Wall { ends_m, construction: 0 };
        all.iter().all(|other| !polygon::nearer(&side, other, PASSAGE_M))
    });
    if is_free && corners.iter().all(|&corner| polygon::contains(corners_m, corner)) {
        inner.extend(sides.into_iter().map(|ends_m| (ends_m, of_use)));
    }
}
