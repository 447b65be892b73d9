//! Joining: images that one surface explains become images in it, so that a map without a plan grows walls.
//!
//! Discovery finds images one by one, each in a private surface. An image m of the anchor a is seen in a wall that stands
//! halfway between both and at right angles to the way from one to the other: with u = (m - a) / d, d = |m - a| and t = u
//! turned left, its offset and rotation about the middle move with m by T = [u' / 2; t' / d]. So an image m_s of an anchor j
//! is compared with
//!
//! 1. the images of j in the walls of the map, and in those which the images of other anchors imply,
//! 2. its images by two of the walls of the map and of those which its own other images imply,
//! 3. where it would be if a wall of the plan that is doubted stood elsewhere, but near.
//!
//! Each says where m_s is: its density at the gap to that place, a Gaussian with the covariance of both (they are states of one
//! filter) and of errors of paths, is weighed against that of an image of something else, which may be anywhere in reach. An
//! explanation is taken where it is [`CERTAIN`]. Images of different anchors, and the walls of the map, may imply one wall: these
//! explanations do not compete with each other; all others do.
//!
//! Then the filter is told the gap (a linear constraint), images that imply walls become walls (an exact change of variables),
//! and the private surface goes.
//!
//! Work: one image per cycle is compared with at most S + S^2 explanations, of S surfaces.

use crate::memory::environment::{CONFIRMED, EnvironmentMemory, Removed};
use crate::model::anchor::Anchor;
use crate::model::image::{Image, Sequence};
use crate::model::matrix::product;
use crate::model::surface::{Line, Surface};
use crate::perceptor::state_filter::StateFilter;
use crate::real::{TAU, abs, exp, larger, limited, sqrt};
use heapless::Vec;
use nalgebra::{Matrix2, Vector2};

/// Tuned: posterior probability of an explanation that is taken: as the model has it, one in a hundred is wrong.
pub const CERTAIN: f32 = 0.99;
/// Mathematics: prior probability of each kind of explanation, none being favoured: one reflection, two, a wall of the plan that
/// is doubted and stands elsewhere, anything else.
pub const KIND: f32 = 0.25;
/// Tuned: deviation of images from the walls that explain them, whatever the filter says, metres: errors of paths.
pub const PATH_STD_M: f32 = 0.1;
/// Tuned: deviation of the offset of a wall that is not where the plan says, metres.
pub const MOVED_STD_M: f32 = 1.0;
/// Tuned: deviation of its rotation, radians.
pub const TURNED_STD_RAD: f32 = 0.05;
/// Guard: against images that are the anchor itself: nearest one, metres.
pub const NEAREST_M: f32 = 0.5;
/// Tuned: two walls make one image in either order where so many deviations of their rotations explain what they lack of a
/// right angle, but no more than [`SKEW`].
pub const RIGHT_ANGLE_DEVIATIONS: f32 = 3.0;
/// Tuned: cosine of an angle that is taken for a right one however well both walls are known: as in plans that are told with
/// the usual deviations. Else both orders explain one image equally, and neither with certainty.
pub const LEAST_SKEW: f32 = 0.05;
/// Mathematics: largest cosine of an angle that may be a right one: so many deviations of a wall that is not where the plan says.
pub const SKEW: f32 = RIGHT_ANGLE_DEVIATIONS * TURNED_STD_RAD;

/// A wall that may explain an image.
#[derive(Clone, Copy, Debug)]
struct Face {
    /// Its slot.
    slot: usize,
    line: Line,
    state: Vector2<f32>,
    /// Slopes of its two numbers over the filter's, where these are an image of the anchor given.
    implied: Option<(usize, Matrix2<f32>)>,
    /// Variance of its rotation.
    rotation: f32,
}

/// What explains an image.
#[derive(Clone, Copy, Debug)]
enum Explanation {
    /// One reflection, or two.
    Images { first: Face, second: Option<Face>, is_either_order: bool },
    /// A wall of the plan that stands elsewhere: its slot, its line as told, its numbers there and their slopes over the image.
    Moved { wall: usize, line: Line, state: Vector2<f32>, slopes: Matrix2<f32> },
}

/// An image, and the wall that it implies.
#[derive(Clone, Copy, Debug)]
struct Own {
    anchor: usize,
    anchor_m: [f32; 2],
    surface: usize,
    position_m: Vector2<f32>,
    covariance_m2: Matrix2<f32>,
}

/// What was joined.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Joined {
    /// A source that gave way, being the same image.
    pub removed: Option<Removed>,
}

/// The wall in which the image of an anchor is seen, and the slopes of its offset and rotation over the image; `None` where
/// both are nearly one.
pub fn implied_wall(anchor_m: [f32; 2], image_m: &Vector2<f32>) -> Option<(Line, Matrix2<f32>)> {
    let [x, y] = anchor_m;
    let (dx, dy) = (image_m.x - x, image_m.y - y);
    let distance_m = sqrt(dx * dx + dy * dy);
    if !(distance_m >= NEAREST_M) {
        return None;
    }
    let (ux, uy) = (dx / distance_m, dy / distance_m);
    let line = Line { centre_m: [x + 0.5 * dx, y + 0.5 * dy], normal: [ux, uy] };
    let slopes = Matrix2::new(0.5 * ux, 0.5 * uy, -uy / distance_m, ux / distance_m);
    Some((line, slopes))
}

/// Looks for what explains one of the private images, that of the turn, and joins them. `None` where nothing has changed.
#[inline(never)]
pub fn join<const ANCHORS: usize, const SURFACES: usize, const SOURCES: usize>(
    filter: &mut StateFilter<ANCHORS, SURFACES>,
    environment: &mut EnvironmentMemory<SURFACES, SOURCES>,
    anchors: &[Anchor],
    max_range_m: f32,
) -> Option<Joined> {
    let turn = environment.next_turn();
    let is_private = |slot: usize| own(filter, environment, anchors, slot).is_some();
    let count = (0..SOURCES).filter(|slot| is_private(*slot)).count();
    let turn = (turn as usize).checked_rem(count)?;
    let source = (0..SOURCES).filter(|slot| is_private(*slot)).nth(turn)?;
    let own = own(filter, environment, anchors, source)?;
    match explain(filter, environment, anchors, &own, max_range_m)? {
        Explanation::Images { first, second, is_either_order } => {
            let (parts, gap_m) = gap(&own, &first, second.as_ref());
            filter.constrain(&parts, gap_m, PATH_STD_M * PATH_STD_M);
            for Face { slot, implied, .. } in core::iter::once(first).chain(second) {
                let Some((anchor, _)) = implied else { continue };
                let (_, image_m, _) = filter.surface(slot)?;
                let (line, slopes) = implied_wall(anchors.get(anchor)?.position_m, &image_m)?;
                filter.rebase(slot, Surface::Wall(line), Vector2::new(0.0, 0.0), &slopes);
            }
            let sequence = Sequence {
                first: first.slot as u8,
                second: second.map(|face| face.slot as u8),
                is_either_order,
            };
            environment.join(source, sequence);
            filter.remove(own.surface);
            Some(Joined { removed: None })
        }
        Explanation::Moved { wall, line, state, slopes } => {
            filter.rebase(own.surface, Surface::Wall(line), state, &slopes);
            filter.relocate(own.surface, wall);
            let sequence = Sequence::of(wall as u8);
            let older = environment.source_of(own.anchor, &sequence);
            environment.join(source, sequence);
            Some(Joined { removed: older.map(|older| environment.remove(older)) })
        }
    }
}

/// The image in the slot of a source, where it is resolved and its surface private.
fn own<const ANCHORS: usize, const SURFACES: usize, const SOURCES: usize>(
    filter: &StateFilter<ANCHORS, SURFACES>,
    environment: &EnvironmentMemory<SURFACES, SOURCES>,
    anchors: &[Anchor],
    slot: usize,
) -> Option<Own> {
    let record = environment.get(slot)?;
    let surface = usize::from(record.sequence.first);
    let (Surface::Private, position_m, covariance_m2) = filter.surface(surface)? else { return None };
    if environment.existence(slot) <= CONFIRMED || !environment.surface(surface)?.may_join {
        return None;
    }
    let anchor = record.anchor;
    Some(Own { anchor, anchor_m: anchors.get(anchor)?.position_m, surface, position_m, covariance_m2 })
}

/// What explains an image with certainty.
fn explain<const ANCHORS: usize, const SURFACES: usize, const SOURCES: usize>(
    filter: &StateFilter<ANCHORS, SURFACES>,
    environment: &EnvironmentMemory<SURFACES, SOURCES>,
    anchors: &[Anchor],
    own_image: &Own,
    max_range_m: f32,
) -> Option<Explanation> {
    let mut faces: Vec<Face, SURFACES> = Vec::new();
    let mut doubted: Vec<(usize, Line), SURFACES> = Vec::new();
    for slot in 0..SURFACES {
        let Some((Surface::Wall(line), state, c)) = filter.surface(slot) else { continue };
        let Some(record) = environment.surface(slot) else { continue };
        // As many as surfaces: these pushes succeed.
        if record.existence > CONFIRMED {
            let _ = faces.push(Face { slot, line, state, implied: None, rotation: c.m22 });
        } else if record.is_told {
            let _ = doubted.push((slot, line));
        }
    }
    for source in 0..SOURCES {
        let Some(other) = own(filter, environment, anchors, source) else { continue };
        let Some((line, slopes)) = implied_wall(other.anchor_m, &other.position_m) else { continue };
        if other.surface != own_image.surface {
            let [tx, ty] = [slopes.m21, slopes.m22];
            let c = &other.covariance_m2;
            let rotation = tx * tx * c.m11 + 2.0 * (tx * ty * c.m21) + ty * ty * c.m22;
            let implied = Some((other.anchor, slopes));
            let state = Vector2::new(0.0, 0.0);
            let _ = faces.push(Face { slot: other.surface, line, state, implied, rotation });
        }
    }
    let known = |sequence: &Sequence| environment.source_of(own_image.anchor, sequence).is_some();
    let elsewhere = KIND * (2.0 / (TAU * max_range_m * max_range_m));

    // Two reflections.
    let mut pairs = Best::default();
    let is_own = |face: &&Face| face.implied.is_none_or(|(anchor, _)| anchor == own_image.anchor);
    for first in faces.iter().filter(is_own) {
        for second in faces.iter().filter(is_own).filter(|second| second.slot != first.slot) {
            let is_either_order = is_right_angle(first, second);
            if (is_either_order && first.slot > second.slot) || !is_farther(own_image, [first, second]) {
                continue;
            }
            let sequence =
                Sequence { first: first.slot as u8, second: Some(second.slot as u8), is_either_order };
            if !known(&sequence) {
                let images = Explanation::Images { first: *first, second: Some(*second), is_either_order };
                pairs = pairs.and(density(filter, own_image, first, Some(second)), images);
            }
        }
    }
    // A wall of the plan elsewhere.
    let mut moved = Best::default();
    for (wall, line) in doubted {
        if let Some((density, explanation)) = elsewhere_density(own_image, wall, line) {
            moved = moved.and(density, explanation);
        }
    }
    // One reflection: by the anchor whose images imply the wall; then by the walls of the map.
    let groups = (0..ANCHORS).map(Some).chain([None]).filter(|group| *group != Some(own_image.anchor));
    let of = |group: Option<usize>| {
        let in_group = faces.iter().filter(move |face| face.implied.map(|(anchor, _)| anchor) == group);
        in_group.filter(|face| !known(&Sequence::of(face.slot as u8)))
    };
    let count = groups.clone().map(|group| of(group).count()).sum::<usize>();
    let second = pairs.weight(KIND, pairs.tried);
    let third = moved.weight(KIND, moved.tried);
    let mut taken: Option<(f32, Explanation)> = None;
    let mut take = |best: &Best, prior: f32, count: usize, all: f32| {
        let Some((density, explanation)) = best.best else { return };
        let posterior = prior * density / count.max(1) as f32 / all;
        if posterior > CERTAIN && taken.is_none_or(|(taken, _)| posterior > taken) {
            taken = Some((posterior, explanation));
        }
    };
    let mut most = 0.0;
    for group in groups {
        let mut single = Best::default();
        for face in of(group) {
            if is_same_side(anchors, own_image, face) {
                let images = Explanation::Images { first: *face, second: None, is_either_order: false };
                single = single.and(density(filter, own_image, face, None), images);
            }
        }
        let first = single.weight(KIND, count);
        take(&single, KIND, count, elsewhere + first + second + third);
        most = larger(most, first);
    }
    // These compete with every anchor's.
    let all = elsewhere + most + second + third;
    take(&pairs, KIND, pairs.tried, all);
    take(&moved, KIND, moved.tried, all);
    taken.map(|(_, explanation)| explanation)
}

/// The best of explanations that compete, and the sum of all.
#[derive(Clone, Copy, Debug, Default)]
struct Best {
    tried: usize,
    sum: f32,
    best: Option<(f32, Explanation)>,
}

impl Best {
    /// With one more.
    fn and(mut self, density: f32, explanation: Explanation) -> Self {
        self.tried += 1;
        self.sum += density;
        if self.best.is_none_or(|(best, _)| density > best) {
            self.best = Some((density, explanation));
        }
        self
    }

    /// The sum, with a prior shared by so many.
    fn weight(&self, prior: f32, count: usize) -> f32 {
        prior * self.sum / count.max(1) as f32
    }
}

/// The image that faces make of an anchor, less the one that there is: slopes over the filter's numbers, and the gap.
fn gap(own: &Own, first: &Face, second: Option<&Face>) -> (Vec<(usize, Matrix2<f32>), 3>, [f32; 2]) {
    let mut image = Image::first(own.anchor_m, &Surface::Wall(first.line), &first.state);
    if let Some(second) = second {
        image = image.second(&Surface::Wall(second.line), &second.state);
    }
    let mut parts = Vec::new();
    // One per face and one more: the pushes succeed.
    let _ = parts.push((own.surface, Matrix2::new(1.0, 0.0, 0.0, 1.0)));
    for (face, slopes) in core::iter::once(first).chain(second).zip(&image.slopes) {
        let slopes = match &face.implied {
            None => *slopes,
            Some((_, t)) => product(slopes, t),
        };
        let _ = parts.push((face.slot, -slopes));
    }
    (parts, [image.position_m.x - own.position_m.x, image.position_m.y - own.position_m.y])
}

/// Density of an image where it is, if it is the one that faces make, per square metre.
fn density<const ANCHORS: usize, const SURFACES: usize>(
    filter: &StateFilter<ANCHORS, SURFACES>,
    own: &Own,
    first: &Face,
    second: Option<&Face>,
) -> f32 {
    let (parts, [x, y]) = gap(own, first, second);
    let Some(c) = filter.form_covariance(&parts) else { return 0.0 };
    let floor = PATH_STD_M * PATH_STD_M;
    let (xx, yx, yy) = (c.m11 + floor, c.m21, c.m22 + floor);
    let determinant = xx * yy - yx * yx;
    if !(determinant > 0.0) {
        return 0.0;
    }
    let form = (yy * (x * x) - 2.0 * (yx * (x * y)) + xx * (y * y)) / determinant;
    exp(-0.5 * form) / (TAU * sqrt(determinant))
}

/// Density of an image where it is, if it is seen in a wall of the plan that stands somewhere near where it is told to.
fn elsewhere_density(own: &Own, wall: usize, line: Line) -> Option<(f32, Explanation)> {
    let (implied, _) = implied_wall(own.anchor_m, &own.position_m)?;
    // Both normals on one side.
    let along = |[ax, ay]: [f32; 2], [bx, by]: [f32; 2]| ax * bx + ay * by;
    let [nx, ny] = implied.normal;
    let cos = along(line.normal, implied.normal);
    let normal = if cos < 0.0 { [-nx, -ny] } else { implied.normal };
    // 2 tan(theta / 2) = 2 sin / (1 + cos).
    let rotation = 2.0 * along(line.tangent(), normal) / (1.0 + abs(cos));
    let [cx, cy] = line.centre_m;
    let [ix, iy] = implied.centre_m;
    let state = Vector2::new(along(normal, [ix - cx, iy - cy]), rotation);
    let image = Image::first(own.anchor_m, &Surface::Wall(line), &state);
    let d = image.slopes.first()?;
    let determinant = d.m11 * d.m22 - d.m12 * d.m21;
    if !(abs(determinant) > f32::MIN_POSITIVE) {
        return None;
    }
    let slopes =
        Matrix2::new(d.m22 / determinant, -d.m12 / determinant, -d.m21 / determinant, d.m11 / determinant);
    let c = &own.covariance_m2;
    let spread = |x: f32, y: f32| x * x * c.m11 + 2.0 * (x * y * c.m21) + y * y * c.m22;
    let offset_m2 = MOVED_STD_M * MOVED_STD_M + spread(slopes.m11, slopes.m12);
    let rotation_2 = TURNED_STD_RAD * TURNED_STD_RAD + spread(slopes.m21, slopes.m22);
    let form = state.x * state.x / offset_m2 + rotation * rotation / rotation_2;
    let density = exp(-0.5 * form) / (TAU * sqrt(offset_m2 * rotation_2) * abs(determinant));
    Some((density, Explanation::Moved { wall, line, state, slopes }))
}

/// Whether an image is farther from its anchor than those in each of two walls: else it is one of these two that two
/// reflections explain, by the image and the other one.
fn is_farther(own: &Own, faces: [&Face; 2]) -> bool {
    let distance_m = |image_m: &Vector2<f32>| {
        let [x, y] = own.anchor_m;
        let (dx, dy) = (image_m.x - x, image_m.y - y);
        sqrt(dx * dx + dy * dy)
    };
    let own_m = distance_m(&own.position_m);
    faces.into_iter().all(|face| {
        let single = Image::first(own.anchor_m, &Surface::Wall(face.line), &face.state);
        distance_m(&single.position_m) < own_m
    })
}

/// Whether two walls may be at right angles.
fn is_right_angle(first: &Face, second: &Face) -> bool {
    let normal = |face: &Face| face.line.moved(face.state.x, face.state.y).normal;
    let ([ax, ay], [bx, by]) = (normal(first), normal(second));
    let explained = RIGHT_ANGLE_DEVIATIONS * sqrt(first.rotation + second.rotation);
    abs(ax * bx + ay * by) <= limited(explained, LEAST_SKEW, SKEW)
}

/// Whether a wall that an image of another anchor implies has this one on the same side.
fn is_same_side(anchors: &[Anchor], own: &Own, face: &Face) -> bool {
    let Some((anchor, _)) = face.implied else { return true };
    let Some(other) = anchors.get(anchor) else { return false };
    face.line.distance_m(own.anchor_m) * face.line.distance_m(other.position_m) > 0.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::memory::environment::Origin;

    type Filter = StateFilter<2, 6>;
    type Memory = EnvironmentMemory<6, 6>;

    const ANCHORS: [Anchor; 2] =
        [Anchor { position_m: [1.0, 1.5], height_m: 0.0 }, Anchor { position_m: [5.0, 2.0], height_m: 0.0 }];
    /// Two walls at right angles: x = -1 and y = 6.
    const WEST: Line = Line { centre_m: [-1.0, 3.0], normal: [1.0, 0.0] };
    const NORTH: Line = Line { centre_m: [2.0, 6.0], normal: [0.0, 1.0] };
    const STD_M: f32 = 0.03;

    fn nothing() -> (Filter, Memory) {
        let motion = crate::config::Config::default().motion;
        (Filter::new(motion, 30.0, [2.0, 2.0], 0.3, 0.2, 0.05, 0.1), Memory::default())
    }

    /// Enters an image found of an anchor, in the slot of this number.
    fn find((filter, memory): &mut (Filter, Memory), slot: usize, anchor: usize, [x, y]: [f32; 2]) {
        filter.insert_independent(slot, Surface::Private, Vector2::new(x, y), [STD_M; 2]);
        memory.insert_surface(slot, 0.99, Origin::Discovered);
        memory.insert(slot, anchor, Sequence::of(slot as u8), 30);
    }

    /// Gives every image its turn.
    fn joined((filter, memory): &mut (Filter, Memory)) -> usize {
        (0..12).filter(|_| join(filter, memory, &ANCHORS, 30.0).is_some()).count()
    }

    fn off(line: &Line, [x, y]: [f32; 2]) -> [f32; 2] {
        let [mx, my] = line.mirrored_m([x, y]);
        [mx + 0.04, my - 0.03]
    }

    #[test]
    fn the_wall_that_an_image_implies_moves_with_it() {
        let image_m = Vector2::new(-2.4, 4.1);
        let (line, slopes) = implied_wall(ANCHORS[0].position_m, &image_m).unwrap();
        let own_m = line.mirrored_m(ANCHORS[0].position_m);
        assert!((own_m[0] - image_m.x).abs() < 1e-5 && (own_m[1] - image_m.y).abs() < 1e-5);
        let step_m = 1e-2;
        for axis in 0..2 {
            let moved = |sign: f32| {
                let mut image_m = image_m;
                image_m[axis] += sign * step_m;
                let (moved, _) = implied_wall(ANCHORS[0].position_m, &image_m).unwrap();
                // The offset at the first wall's middle along its normal, and the angle.
                let [nx, ny] = line.normal;
                let [dx, dy] = [moved.centre_m[0] - line.centre_m[0], moved.centre_m[1] - line.centre_m[1]];
                let [tx, ty] = line.tangent();
                [nx * dx + ny * dy, tx * moved.normal[0] + ty * moved.normal[1]]
            };
            let (ahead, back) = (moved(1.0), moved(-1.0));
            for number in 0..2 {
                let slope = (ahead[number] - back[number]) / (2.0 * step_m);
                assert!((slopes[(number, axis)] - slope).abs() < 1e-3, "{axis} {number}");
            }
        }
        assert!(implied_wall([0.0, 0.0], &Vector2::new(0.3, 0.3)).is_none());
    }

    #[test]
    fn images_of_two_anchors_in_one_wall_become_it() {
        let mut map = nothing();
        find(&mut map, 0, 0, off(&WEST, ANCHORS[0].position_m));
        find(&mut map, 3, 1, WEST.mirrored_m(ANCHORS[1].position_m));
        assert_eq!(joined(&mut map), 1);
        let (filter, memory) = map;
        let walls: std::vec::Vec<_> = (0..6).filter_map(|slot| filter.surface(slot)).collect();
        let [(Surface::Wall(line), state, covariance)] = walls[..] else { panic!("{walls:?}") };
        let now = line.moved(state.x, state.y);
        assert!(now.normal[0].abs() > 0.999 && now.distance_m([-1.0, 3.0]).abs() < 0.05, "{now:?}");
        // Two images say more than one of them.
        assert!(covariance.m11 > 0.0 && covariance.m11 < 0.25 * STD_M * STD_M);
        assert_eq!(memory.iter().filter(|(_, record)| record.sequence.order() == 1).count(), 2);
    }

    #[test]
    fn images_of_two_walls_stay_two() {
        let mut map = nothing();
        find(&mut map, 0, 0, WEST.mirrored_m(ANCHORS[0].position_m));
        let [x, y] = WEST.mirrored_m(ANCHORS[1].position_m);
        find(&mut map, 1, 1, [x - 0.6, y]);
        find(&mut map, 2, 1, NORTH.mirrored_m(ANCHORS[1].position_m));
        assert_eq!(joined(&mut map), 0);
    }

    #[test]
    fn an_image_by_two_reflections_shows_both_walls() {
        let mut map = nothing();
        let west_m = WEST.mirrored_m(ANCHORS[0].position_m);
        find(&mut map, 0, 0, west_m);
        find(&mut map, 1, 0, NORTH.mirrored_m(ANCHORS[0].position_m));
        find(&mut map, 2, 0, off(&NORTH, west_m));
        assert_eq!(joined(&mut map), 1);
        let (filter, memory) = map;
        assert!(filter.surface(2).is_none());
        let sequence = memory.get(2).unwrap().sequence;
        assert!(sequence.is_same(&Sequence { first: 1, second: Some(0), is_either_order: true }));
        for slot in 0..2 {
            assert!(matches!(filter.surface(slot), Some((Surface::Wall(_), ..))));
        }
        // What it makes is where all three say.
        let (placed, _) = filter.placed(ANCHORS[0].position_m, &sequence).unwrap();
        let [x, y] = NORTH.mirrored_m(west_m);
        assert!((placed.x - x).hypot(placed.y - y) < 0.06, "{placed}");
    }

    #[test]
    fn a_doubted_wall_of_the_plan_moves_to_the_image_that_it_explains_and_a_believed_one_stays() {
        for existence in [0.01, 0.99] {
            let mut map = nothing();
            let (filter, memory) = &mut map;
            filter.insert_independent(5, Surface::Wall(WEST), Vector2::new(0.0, 0.0), [0.05, 0.01]);
            memory.insert_surface(5, existence, Origin::Plan);
            memory.insert(5, 0, Sequence::of(5), 0);
            // Where the image would be were the wall 0.8 m farther west.
            let [x, y] = WEST.mirrored_m(ANCHORS[0].position_m);
            find(&mut map, 0, 0, [x - 1.6, y]);
            let is_moved = existence < 0.5;
            assert_eq!(joined(&mut map), usize::from(is_moved));
            let (filter, _) = map;
            let (_, state, _) = filter.surface(5).unwrap();
            assert!((state.x + if is_moved { 0.8 } else { 0.0 }).abs() < 1e-3, "{state}");
            assert_eq!(filter.surface(0).is_none(), is_moved);
        }
    }
}
