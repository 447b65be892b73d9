//! Joining: images that one surface explains become images in it.
//!
//! An image m of an anchor a is seen in a wall half-way between both, at right angles to u = (m - a) / d, d = |m - a|. With t = u
//! turned left, the wall's offset and rotation move with m by T = [u' / 2; t' / d]. The image of the turn, m_s, is explained by
//!
//! 1. one reflection, in a wall of the map or in one that another anchor's image implies,
//! 2. two reflections, in walls of the map or those that other images of its own anchor imply,
//! 3. a wall of the plan that is doubted and stands elsewhere.
//!
//! Of 1 and 2: with the gap e = m(walls) - m_s, to first order a linear form of the filter's states of covariance C, the density
//! is N(e; 0, C + path^2 I). Of 3: with the offset o and rotation w at which the doubted wall would show m_s, and the slopes S of
//! both over m_s, it is N(o; 0, moved^2 + S_o C_mm S_o') N(w; 0, turned^2 + S_w C_mm S_w') / |dm/d(o, w)|. Anything else: uniform
//! over the disc in reach. Images of one kind share the kind's prior. Explanations of 1 by different anchors may be one wall, so
//! that each anchor's compete with 2, 3 and anything else only; what has a posterior above the threshold is taken, the best first.

use super::environment::{CONFIRMED, EnvironmentMemory, Removed};
use super::image::Image;
use super::real::{Real, abs, exp, larger, limited, sqrt, square, tau};
use super::state_filter::StateFilter;
use super::surface::{Line, Surface, dot, less};
use super::{Square, product, transposed};
use cogmint_core::Anchor;
use cogmint_core::model::image::Sequence;
use cogmint_core::model::source::Source;
use cogmint_core::tracker::joining::{
    CERTAIN, KIND, LEAST_SKEW, MOVED_STD_M, NEAREST_M, PATH_STD_M, RIGHT_ANGLE_DEVIATIONS, SKEW,
    TURNED_STD_RAD,
};

/// The core's constants, kept as values, so that a test can change one.
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs)] // those of `cogmint_core::tracker::joining`; its `KIND` for every kind of explanation
pub struct Constants {
    pub certain: f32,
    pub first: f32,
    pub second: f32,
    pub moved: f32,
    pub path_std_m: f32,
    pub moved_std_m: f32,
    pub turned_std_rad: f32,
    pub nearest_m: f32,
    pub right_angle_deviations: f32,
    pub least_skew: f32,
    pub skew: f32,
}

impl Default for Constants {
    fn default() -> Self {
        Self {
            certain: CERTAIN,
            first: KIND,
            second: KIND,
            moved: KIND,
            path_std_m: PATH_STD_M,
            moved_std_m: MOVED_STD_M,
            turned_std_rad: TURNED_STD_RAD,
            nearest_m: NEAREST_M,
            right_angle_deviations: RIGHT_ANGLE_DEVIATIONS,
            least_skew: LEAST_SKEW,
            skew: SKEW,
        }
    }
}

/// What was joined.
#[derive(Clone, Copy, Debug)]
pub struct Joined {
    /// A source that was the same image.
    pub removed: Option<Removed>,
}

/// An image of an anchor that is in a private surface.
#[derive(Clone, Copy, Debug)]
struct Lone<T> {
    source: usize,
    anchor: usize,
    anchor_m: [T; 2],
    surface: usize,
    position_m: [T; 2],
    covariance_m2: Square<T>,
}

/// A wall that may explain an image.
#[derive(Clone, Copy, Debug)]
struct Wall<T> {
    slot: usize,
    line: Line<T>,
    numbers: [T; 2],
    rotation_variance: T,
    /// The anchor whose image implies it, and T.
    implied: Option<(usize, Square<T>)>,
}

/// What may be meant.
#[derive(Clone, Debug)]
enum Explanation<T> {
    /// Reflections in walls, in order.
    Walls { walls: Vec<Wall<T>>, is_either_order: bool },
    /// The doubted wall in this slot, at these numbers, of these slopes over the image.
    Moved { slot: usize, line: Line<T>, numbers: [T; 2], slopes: Square<T> },
}

/// Explanations of which at most one is right: how many, their densities' sum, the best (the first of equals).
#[derive(Clone, Debug)]
struct Rivals<T> {
    count: usize,
    sum: T,
    best: Option<(T, Explanation<T>)>,
}

impl<T: Real> Rivals<T> {
    fn of(all: Vec<(T, Explanation<T>)>) -> Self {
        let mut rivals = Self { count: all.len(), sum: T::ZERO, best: None };
        for (density, explanation) in all {
            rivals.sum += density;
            if rivals.best.as_ref().is_none_or(|(best, _)| density > *best) {
                rivals.best = Some((density, explanation));
            }
        }
        rivals
    }
}

/// The wall that an image implies, with T; none for an image that is the anchor.
fn implied_wall<T: Real>(anchor_m: [T; 2], image_m: [T; 2], nearest_m: f32) -> Option<(Line<T>, Square<T>)> {
    let half = T::of(0.5);
    let way = less(image_m, anchor_m);
    let d = sqrt(dot(way, way));
    if d < T::of(nearest_m) {
        return None;
    }
    let u = way.map(|along| along / d);
    let middle_m = [anchor_m[0] + half * way[0], anchor_m[1] + half * way[1]];
    let slopes = [[half * u[0], half * u[1]], [-u[1] / d, u[0] / d]];
    Some((Line { centre_m: middle_m, normal: u }, slopes))
}

/// x' C x. Order: xx, twice yx, yy.
fn quadratic<T: Real>([x, y]: [T; 2], c: &Square<T>) -> T {
    square(x) * c[0][0] + T::of(2.0) * (x * y * c[1][0]) + square(y) * c[1][1]
}

/// The states that are joined.
pub struct Joining<'a, T> {
    /// Where surfaces are.
    pub filter: &'a mut StateFilter<T>,
    /// What is seen in them.
    pub environment: &'a mut EnvironmentMemory<T>,
    /// The anchors.
    pub anchors: &'a [Anchor],
    /// The reach, metres.
    pub max_range_m: f32,
    /// The constants.
    pub constants: &'a Constants,
}

impl<T: Real> Joining<'_, T> {
    /// Joins the private image of the turn to what explains it, if anything does.
    pub fn join(&mut self) -> Option<Joined> {
        let turn = self.environment.turn;
        self.environment.turn = turn.wrapping_add(1);
        let lone = self.lone();
        if lone.is_empty() {
            return None;
        }
        let own = lone[turn as usize % lone.len()];
        let others: Vec<_> = lone.into_iter().filter(|other| other.surface != own.surface).collect();
        match self.explain(&own, &others)? {
            Explanation::Walls { walls, is_either_order } => {
                let (form, gap_m) = self.gap(&own, &walls);
                self.filter.constrain(&form, gap_m, square(T::of(self.constants.path_std_m)));
                for wall in &walls {
                    let Some((anchor, _)) = wall.implied else { continue };
                    let (_, image_m, _) = self.filter.surface(wall.slot)?;
                    let (line, slopes) =
                        implied_wall(self.anchor_m(anchor), image_m, self.constants.nearest_m)?;
                    self.filter.rebase(wall.slot, Surface::Wall(line), [T::ZERO; 2], &slopes);
                }
                self.environment.join(own.source, Self::sequence(&walls, is_either_order));
                self.filter.remove(own.surface);
                Some(Joined { removed: None })
            }
            Explanation::Moved { slot, line, numbers, slopes } => {
                self.filter.rebase(own.surface, Surface::Wall(line), numbers, &slopes);
                self.filter.relocate(own.surface, slot);
                let sequence = Sequence::of(slot as u8);
                let same = self.environment.source_of(own.anchor, &sequence);
                self.environment.join(own.source, sequence);
                Some(Joined { removed: same.map(|same| self.environment.remove(same)) })
            }
        }
    }

    fn anchor_m(&self, anchor: usize) -> [T; 2] {
        self.anchors[anchor].position_m.map(T::of)
    }

    /// All images that probably exist in private surfaces, by source.
    fn lone(&self) -> Vec<Lone<T>> {
        let mut all = Vec::new();
        for (source, record) in self.environment.in_use() {
            let anchor = record.anchor;
            let surface = usize::from(record.sequence.first);
            let existence = self.environment.existence(Source::Virtual { anchor, slot: source });
            if let Some((Surface::Private, position_m, covariance_m2)) = self.filter.surface(surface)
                && existence > T::of(CONFIRMED)
                && self.environment.surfaces[surface].is_some_and(|record| record.may_join)
            {
                let anchor_m = self.anchor_m(anchor);
                all.push(Lone { source, anchor, anchor_m, surface, position_m, covariance_m2 });
            }
        }
        all
    }

    fn sequence(walls: &[Wall<T>], is_either_order: bool) -> Sequence {
        let first = walls[0].slot as u8;
        Sequence { first, second: walls.get(1).map(|wall| wall.slot as u8), is_either_order }
    }

    /// Whether the anchor has this image already.
    fn is_known(&self, own: &Lone<T>, walls: &[Wall<T>], is_either_order: bool) -> bool {
        self.environment.source_of(own.anchor, &Self::sequence(walls, is_either_order)).is_some()
    }

    /// Walls of the map that probably exist, by slot; then those that images imply, by source.
    fn walls(&self, others: &[Lone<T>]) -> Vec<Wall<T>> {
        let mut walls = Vec::new();
        for slot in 0..self.environment.surfaces.len() {
            if let Some((Surface::Wall(line), numbers, c)) = self.filter.surface(slot)
                && self.environment.surfaces[slot].is_some_and(|record| record.existence > T::of(CONFIRMED))
            {
                walls.push(Wall { slot, line, numbers, rotation_variance: c[1][1], implied: None });
            }
        }
        for other in others {
            let implied = implied_wall(other.anchor_m, other.position_m, self.constants.nearest_m);
            if let Some((line, slopes)) = implied {
                walls.push(Wall {
                    slot: other.surface,
                    line,
                    numbers: [T::ZERO; 2],
                    rotation_variance: quadratic(slopes[1], &other.covariance_m2),
                    implied: Some((other.anchor, slopes)),
                });
            }
        }
        walls
    }

    /// What explains an image with certainty.
    fn explain(&self, own: &Lone<T>, others: &[Lone<T>]) -> Option<Explanation<T>> {
        let Constants { certain, first, second, moved, .. } = *self.constants;
        let [first, second, moved] = [first, second, moved].map(T::of);
        let walls = self.walls(others);
        let reach = T::of(self.max_range_m);
        let anything = (T::ONE - first - second - moved) * (T::of(2.0) / (tau::<T>() * reach * reach));

        let twice = Rivals::of(self.two_reflections(own, &walls));
        let elsewhere = Rivals::of(self.moved_walls(own));
        // By the anchor whose images imply the wall, the walls of the map last.
        let mut groups: Vec<Vec<Wall<T>>> = Vec::new();
        for implied_by in (0..self.anchors.len()).map(Some).chain([None]) {
            if implied_by != Some(own.anchor) {
                let is_in = |wall: &&Wall<T>| wall.implied.map(|(anchor, _)| anchor) == implied_by;
                let group = walls.iter().filter(is_in).copied();
                groups.push(group.filter(|wall| !self.is_known(own, &[*wall], false)).collect());
            }
        }
        let singles: usize = groups.iter().map(Vec::len).sum();
        let share = |prior: T, sum: T, count: usize| prior * sum / T::of_count(count.max(1));
        let both = share(second, twice.sum, twice.count);
        let away = share(moved, elsewhere.sum, elsewhere.count);
        let mut all: Vec<(Rivals<T>, T, usize, T)> = Vec::new();
        let mut strongest = T::ZERO;
        for group in groups {
            let once = Rivals::of(self.one_reflection(own, &group));
            let single = share(first, once.sum, singles);
            strongest = larger(strongest, single);
            // Order: anything else, one, two, elsewhere.
            all.push((once, first, singles, anything + single + both + away));
        }
        let total = anything + strongest + both + away;
        let (pairs, places) = (twice.count, elsewhere.count);
        all.push((twice, second, pairs, total));
        all.push((elsewhere, moved, places, total));
        let mut taken: Option<(T, Explanation<T>)> = None;
        for (rivals, prior, count, total) in all {
            let Some((density, explanation)) = rivals.best else { continue };
            let posterior = share(prior, density, count) / total;
            if posterior > T::of(certain) && taken.as_ref().is_none_or(|(best, _)| posterior > *best) {
                taken = Some((posterior, explanation));
            }
        }
        taken.map(|(_, explanation)| explanation)
    }

    /// A wall that another anchor's image implies reflects on the side where that anchor is.
    fn one_reflection(&self, own: &Lone<T>, group: &[Wall<T>]) -> Vec<(T, Explanation<T>)> {
        let mut all = Vec::new();
        for wall in group {
            let is_before = match wall.implied {
                None => true,
                Some((anchor, _)) => {
                    let sides =
                        wall.line.distance_m(own.anchor_m) * wall.line.distance_m(self.anchor_m(anchor));
                    sides > T::ZERO
                }
            };
            if is_before {
                let walls = vec![*wall];
                let density = self.density(own, &walls);
                all.push((density, Explanation::Walls { walls, is_either_order: false }));
            }
        }
        all
    }

    /// Pairs of walls, those at right angles once only. Two reflections are farther than one of them.
    fn two_reflections(&self, own: &Lone<T>, walls: &[Wall<T>]) -> Vec<(T, Explanation<T>)> {
        let from_anchor_m = |image_m: [T; 2]| {
            let way = less(image_m, own.anchor_m);
            sqrt(dot(way, way))
        };
        let mut usable = Vec::new();
        for wall in walls {
            if wall.implied.is_none_or(|(anchor, _)| anchor == own.anchor) {
                let single = Image::of(own.anchor_m, &[(wall.line, wall.numbers)]);
                usable.push((*wall, from_anchor_m(single.position_m)));
            }
        }
        let own_m = from_anchor_m(own.position_m);
        let mut all = Vec::new();
        for (a, a_m) in &usable {
            for (b, b_m) in &usable {
                if a.slot == b.slot {
                    continue;
                }
                let is_either_order = self.may_be_square(a, b);
                let is_double = is_either_order && a.slot > b.slot;
                let walls = vec![*a, *b];
                let is_farther = *a_m < own_m && *b_m < own_m;
                if !is_double && is_farther && !self.is_known(own, &walls, is_either_order) {
                    let density = self.density(own, &walls);
                    all.push((density, Explanation::Walls { walls, is_either_order }));
                }
            }
        }
        all
    }

    /// Whether two walls may be at right angles, by what is known of their rotations.
    fn may_be_square(&self, a: &Wall<T>, b: &Wall<T>) -> bool {
        let Constants { right_angle_deviations, least_skew, skew, .. } = *self.constants;
        let normal = |wall: &Wall<T>| wall.line.moved(wall.numbers[0], wall.numbers[1]).normal;
        let std = sqrt(a.rotation_variance + b.rotation_variance);
        let most = limited(T::of(right_angle_deviations) * std, T::of(least_skew), T::of(skew));
        abs(dot(normal(a), normal(b))) <= most
    }

    /// Walls of the plan that are doubted, each at the numbers at which it shows the image.
    fn moved_walls(&self, own: &Lone<T>) -> Vec<(T, Explanation<T>)> {
        let mut all = Vec::new();
        for slot in 0..self.environment.surfaces.len() {
            let is_doubted = self.environment.surfaces[slot]
                .is_some_and(|record| record.is_told && record.existence <= T::of(CONFIRMED));
            if is_doubted && let Some((Surface::Wall(line), ..)) = self.filter.surface(slot) {
                all.extend(self.moved_wall(own, slot, line));
            }
        }
        all
    }

    fn moved_wall(&self, own: &Lone<T>, slot: usize, line: Line<T>) -> Option<(T, Explanation<T>)> {
        let (two, half) = (T::of(2.0), T::of(0.5));
        let (there, _) = implied_wall(own.anchor_m, own.position_m, self.constants.nearest_m)?;
        let cos = dot(line.normal, there.normal);
        let normal = if cos < T::ZERO { there.normal.map(|n| -n) } else { there.normal };
        // 2 tan(theta / 2) = 2 sin / (1 + cos).
        let rotation = two * dot(line.tangent(), normal) / (T::ONE + abs(cos));
        let offset = dot(normal, less(there.centre_m, line.centre_m));
        let numbers = [offset, rotation];
        let image = Image::of(own.anchor_m, &[(line, numbers)]);
        // dm/d(o, w), and its inverse S.
        let d = transposed(&image.slopes[0]);
        let determinant = d[0][0] * d[1][1] - d[0][1] * d[1][0];
        if abs(determinant) <= T::of(f32::MIN_POSITIVE) {
            return None;
        }
        let over = |entry: T| entry / determinant;
        let slopes = [[over(d[1][1]), over(-d[0][1])], [over(-d[1][0]), over(d[0][0])]];
        let variance = |std: f32, row: usize| square(T::of(std)) + quadratic(slopes[row], &own.covariance_m2);
        let of_offset = variance(self.constants.moved_std_m, 0);
        let of_rotation = variance(self.constants.turned_std_rad, 1);
        let form = square(offset) / of_offset + square(rotation) / of_rotation;
        let density = exp(-half * form) / (tau::<T>() * sqrt(of_offset * of_rotation) * abs(determinant));
        Some((density, Explanation::Moved { slot, line, numbers, slopes }))
    }

    /// The image by walls less the one that there is: as a form (slots and slopes, those of the image first), and as it is.
    fn gap(&self, own: &Lone<T>, walls: &[Wall<T>]) -> (Vec<(usize, Square<T>)>, [T; 2]) {
        let places: Vec<_> = walls.iter().map(|wall| (wall.line, wall.numbers)).collect();
        let image = Image::of(own.anchor_m, &places);
        let mut form = vec![(own.surface, [[T::ONE, T::ZERO], [T::ZERO, T::ONE]])];
        for (wall, slopes) in walls.iter().zip(&image.slopes) {
            let d = transposed(slopes);
            let over_state = match &wall.implied {
                None => d,
                Some((_, t)) => product(&d, t),
            };
            form.push((wall.slot, over_state.map(|row| row.map(|slope| -slope))));
        }
        (form, less(image.position_m, own.position_m))
    }

    /// N(gap; 0, C + path^2 I), 1/m^2.
    fn density(&self, own: &Lone<T>, walls: &[Wall<T>]) -> T {
        let (form, [x, y]) = self.gap(own, walls);
        let c = self.filter.form_covariance(&form);
        let path_m2 = square(T::of(self.constants.path_std_m));
        let (xx, yx, yy) = (c[0][0] + path_m2, c[1][0], c[1][1] + path_m2);
        let determinant = xx * yy - square(yx);
        if determinant <= T::ZERO {
            return T::ZERO;
        }
        let form = (yy * square(x) - T::of(2.0) * (yx * (x * y)) + xx * square(y)) / determinant;
        exp(T::of(-0.5) * form) / (tau::<T>() * sqrt(determinant))
    }
}
