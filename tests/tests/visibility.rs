//! Image sources and visibility against rays shot in all directions.
//!
//! Nothing of the geometry under test is used to shoot: a ray flies to the nearest wall, turns by the law of reflection
//! and flies on, twice. A tag receives it where the ray passes within half the distance between neighbouring rays
//! (reception sphere, Seidel and Rappaport 1994): `length * dtheta / 2`. The walls met so far are the sequence.
//!
//! A path and the ray nearest to it are at most that far apart all along. They can differ only where an edge (the end
//! of a wall, or where two walls cross) lies between them; a path that passes an edge within `length * dtheta`, twice
//! that distance, is called grazing, whatever its incidence: past a wall at grazing incidence there is its end. Tags
//! and anchors keep 5 cm from the walls, ten times as much.

use cogmint::geometry::Wall;
use cogmint::geometry::image_source::image_sources;
use cogmint::geometry::visibility::{trace, trace_image};
use cogmint::scenario::{BUILT_IN, Scenario};
use rand_core::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::TAU;

const RAYS: u32 = 100_000;
const SPACING_RAD: f64 = TAU / RAYS as f64;
const ORDER: usize = 2;
/// Distance of anchors and tags from walls, metres.
const CLEARANCE_M: f64 = 0.05;

type Point = [f64; 2];

/// A sequence of walls, and where one path along it runs.
type Paths = BTreeMap<Vec<usize>, Vec<Point>>;

#[derive(Debug, Default)]
struct Tally {
    agreements: usize,
    /// Sequences found by one side only, all of them grazing.
    grazing: usize,
    /// The others.
    disagreements: Vec<String>,
}

impl Tally {
    fn add(&mut self, other: Self) {
        self.agreements += other.agreements;
        self.grazing += other.grazing;
        self.disagreements.extend(other.disagreements);
    }
}

/// Compares, for each tag, the sequences of walls that rays find with those that image sources give.
fn agrees(walls: &[Wall], anchor: Point, tags: &[Point]) -> Tally {
    let edges = edges(walls);
    let images = image_sources(walls, anchor, ORDER);
    let mut tally = Tally::default();
    for (&tag, shot) in tags.iter().zip(shoot(walls, anchor, tags)) {
        let mut traced = Paths::new();
        for image in &images {
            let valid = image.sequences.iter().filter_map(|sequence| {
                Some((sequence.clone(), trace(walls, anchor, sequence, tag, 0)?.points_m))
            });
            let before = traced.len();
            traced.extend(valid);
            let seen = trace_image(walls, anchor, image, tag, 0).is_some();
            assert_eq!(seen, traced.len() > before, "{image:?}");
        }
        let sequences: BTreeSet<_> = traced.keys().chain(shot.keys()).collect();
        for sequence in sequences {
            let (by_image, by_ray) = (traced.get(sequence), shot.get(sequence));
            if let (Some(by_image), Some(by_ray)) = (by_image, by_ray) {
                // Along a ray half a spacing off, the closest approach is as far as the tag but for the square of it.
                let difference_m = (length(by_image) - length(by_ray)).abs();
                if difference_m < 1e-6 {
                    tally.agreements += 1;
                } else {
                    tally.disagreements.push(format!("{sequence:?}: {difference_m} m in {walls:?}"));
                }
            } else if [by_image, by_ray].into_iter().flatten().any(|path| grazes(path, &edges)) {
                tally.grazing += 1;
            } else {
                tally.disagreements.push(format!(
                    "{sequence:?} from {anchor:?} to {tag:?}: image {by_image:?}, ray {by_ray:?} in {walls:?}"
                ));
            }
        }
    }
    tally
}

/// What rays from `anchor` find: for each tag the sequences, with the path of the first ray of each.
fn shoot(walls: &[Wall], anchor: Point, tags: &[Point]) -> Vec<Paths> {
    let mut found = vec![Paths::new(); tags.len()];
    for ray in 0..RAYS {
        let (sin, cos) = (SPACING_RAD * f64::from(ray)).sin_cos();
        let (mut at, mut heading) = (anchor, [cos, sin]);
        let mut flown = 0.0;
        let mut path = vec![anchor];
        let mut met = Vec::new();
        loop {
            let hit = nearest_hit(walls, at, heading, met.last().copied());
            let free = hit.map_or(f64::INFINITY, |(distance, _)| distance);
            for (&tag, found) in tags.iter().zip(&mut found) {
                let to_tag = [tag[0] - at[0], tag[1] - at[1]];
                let ahead = to_tag[0] * heading[0] + to_tag[1] * heading[1];
                let aside = (to_tag[0] * heading[1] - to_tag[1] * heading[0]).abs();
                let in_reach = aside <= (flown + ahead) * SPACING_RAD / 2.0;
                if ahead > 0.0 && ahead < free && in_reach && !found.contains_key(&met) {
                    let closest = [at[0] + ahead * heading[0], at[1] + ahead * heading[1]];
                    found.insert(met.clone(), path.iter().copied().chain([closest]).collect());
                }
            }
            let Some((distance, wall)) = hit else { break };
            if met.len() == ORDER {
                break;
            }
            at = [at[0] + distance * heading[0], at[1] + distance * heading[1]];
            flown += distance;
            path.push(at);
            met.push(wall);
            // The part of the heading across the wall is turned round.
            let [[ax, ay], [bx, by]] = walls[wall].ends_m;
            let size = (bx - ax).hypot(by - ay);
            let (ux, uy) = ((bx - ax) / size, (by - ay) / size);
            let along = heading[0] * ux + heading[1] * uy;
            heading = [2.0 * along * ux - heading[0], 2.0 * along * uy - heading[1]];
        }
    }
    found
}

/// Distance and index of the first wall that the ray meets, other than the one that it comes from.
fn nearest_hit(walls: &[Wall], at: Point, heading: Point, from: Option<usize>) -> Option<(f64, usize)> {
    let hits = walls.iter().enumerate().filter_map(|(index, wall)| {
        // at + s heading = a + u (b - a), by Cramer's rule.
        let [[ax, ay], [bx, by]] = wall.ends_m;
        let determinant = heading[1] * (bx - ax) - heading[0] * (by - ay);
        let s = ((ay - at[1]) * (bx - ax) - (ax - at[0]) * (by - ay)) / determinant;
        let u = (heading[0] * (ay - at[1]) - heading[1] * (ax - at[0])) / determinant;
        (s > 0.0 && (0.0..=1.0).contains(&u) && from != Some(index)).then_some((s, index))
    });
    hits.min_by(|a, b| a.0.total_cmp(&b.0))
}

/// The ends of walls and the points where two walls cross.
fn edges(walls: &[Wall]) -> Vec<Point> {
    let mut edges: Vec<Point> = walls.iter().flat_map(|wall| wall.ends_m).collect();
    for (index, wall) in walls.iter().enumerate() {
        let [a, b] = wall.ends_m;
        let size = (b[0] - a[0]).hypot(b[1] - a[1]);
        let heading = [(b[0] - a[0]) / size, (b[1] - a[1]) / size];
        for other in &walls[index + 1..] {
            if let Some((distance, _)) = nearest_hit(std::slice::from_ref(other), a, heading, None)
                && distance <= size
            {
                edges.push([a[0] + distance * heading[0], a[1] + distance * heading[1]]);
            }
        }
    }
    edges
}

/// Whether the path passes an edge within the distance of neighbouring rays at its end.
fn grazes(path: &[Point], edges: &[Point]) -> bool {
    let margin = length(path) * SPACING_RAD;
    path.windows(2).any(|leg| edges.iter().any(|&edge| distance_to_segment(edge, leg[0], leg[1]) <= margin))
}

fn length(path: &[Point]) -> f64 {
    path.windows(2).map(|leg| (leg[1][0] - leg[0][0]).hypot(leg[1][1] - leg[0][1])).sum()
}

fn distance_to_segment(point: Point, a: Point, b: Point) -> f64 {
    let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
    let share = ((point[0] - a[0]) * dx + (point[1] - a[1]) * dy) / (dx * dx + dy * dy);
    let share = share.clamp(0.0, 1.0);
    (point[0] - a[0] - share * dx).hypot(point[1] - a[1] - share * dy)
}

/// Draws rooms.
struct Draw(Xoshiro256PlusPlus);

impl Draw {
    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.0.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn count(&mut self, low: usize, high: usize) -> usize {
        low + (self.0.next_u64() % (high - low + 1) as u64) as usize
    }

    /// Corners at random radii around a point.
    fn star(&mut self) -> Vec<Point> {
        let corners = self.count(5, 12);
        let turn = self.between(0.0, TAU);
        (0..corners)
            .map(|corner| {
                let step = corner as f64 + self.between(-0.35, 0.35);
                let angle = turn + TAU * step / corners as f64;
                let radius = self.between(2.0, 6.0);
                [radius * angle.cos(), radius * angle.sin()]
            })
            .collect()
    }

    /// An L, or a U, with all its angles right; the axes are turned against the room in every second one.
    fn rectilinear(&mut self) -> Vec<Point> {
        let (width, depth) = (self.between(4.0, 9.0), self.between(4.0, 9.0));
        let cut = self.between(0.3, 0.7) * depth;
        let left = self.between(0.2, 0.4) * width;
        let corners = if self.count(0, 1) == 0 {
            vec![[0.0, 0.0], [width, 0.0], [width, cut], [left, cut], [left, depth], [0.0, depth]]
        } else {
            let right = self.between(0.6, 0.8) * width;
            let other = self.between(0.8, 1.1) * depth;
            vec![
                [0.0, 0.0],
                [width, 0.0],
                [width, other],
                [right, other],
                [right, cut],
                [left, cut],
                [left, depth],
                [0.0, depth],
            ]
        };
        let (sin, cos) = if self.count(0, 1) == 0 { (0.0, 1.0) } else { self.between(0.0, TAU).sin_cos() };
        corners.into_iter().map(|[x, y]| [cos * x - sin * y, sin * x + cos * y]).collect()
    }

    /// A place in the box around the walls that keeps its distance from all of them; not always inside the room.
    fn place(&mut self, walls: &[Wall]) -> Point {
        let ends = || walls.iter().flat_map(|wall| wall.ends_m);
        let low = |axis: usize| ends().map(|end| end[axis]).fold(f64::INFINITY, f64::min);
        let high = |axis: usize| ends().map(|end| end[axis]).fold(f64::NEG_INFINITY, f64::max);
        loop {
            let place = [self.between(low(0), high(0)), self.between(low(1), high(1))];
            let near = |wall: &Wall| distance_to_segment(place, wall.ends_m[0], wall.ends_m[1]) < CLEARANCE_M;
            if !walls.iter().any(near) {
                return place;
            }
        }
    }

    fn room(&mut self, number: usize) -> Vec<Wall> {
        let corners = if number.is_multiple_of(3) { self.rectilinear() } else { self.star() };
        let after = corners.iter().cycle().skip(1);
        let mut walls: Vec<Wall> =
            corners.iter().zip(after).map(|(&a, &b)| Wall { ends_m: [a, b], construction: 0 }).collect();
        if number.is_multiple_of(2) {
            for _ in 0..self.count(1, 3) {
                let (from, angle) = (self.place(&walls), self.between(0.0, TAU));
                let size = self.between(0.5, 3.0);
                let to = [from[0] + size * angle.cos(), from[1] + size * angle.sin()];
                walls.push(Wall { ends_m: [from, to], construction: 0 });
            }
        }
        walls
    }
}

#[test]
fn image_sources_and_rays_find_the_same_paths_in_200_random_rooms() {
    const ROOMS: usize = 200;
    let workers = std::thread::available_parallelism().map_or(1, usize::from);
    let tallies = std::thread::scope(|scope| {
        let work = |worker| {
            scope.spawn(move || {
                let mut tally = Tally::default();
                for number in (worker..ROOMS).step_by(workers) {
                    let mut draw = Draw(Xoshiro256PlusPlus::seed_from_u64(number as u64));
                    let walls = draw.room(number);
                    let anchor = draw.place(&walls);
                    let tags: Vec<Point> = (0..8).map(|_| draw.place(&walls)).collect();
                    tally.add(agrees(&walls, anchor, &tags));
                }
                tally
            })
        };
        let threads: Vec<_> = (0..workers).map(work).collect();
        threads.into_iter().map(|thread| thread.join().unwrap()).collect::<Vec<_>>()
    });
    let mut total = Tally::default();
    tallies.into_iter().for_each(|tally| total.add(tally));
    let Tally { agreements, grazing, disagreements } = total;
    println!("{agreements} paths agree, {grazing} differ at an edge, {} differ", disagreements.len());
    assert!(disagreements.is_empty(), "{} differ: {:#?}", disagreements.len(), disagreements.first());
    assert!(agreements > 5000, "only {agreements} paths");
    assert!(grazing * 100 <= agreements, "{grazing} differ at an edge, {agreements} agree");
}

/// Runs `agrees` for every anchor of a scenario, with 20 positions along each trajectory.
fn agrees_in(scenario: &Scenario) -> Tally {
    let walls: Vec<Wall> = cogmint::scenario::walls(&scenario.room)
        .into_iter()
        .map(|(ends_m, _)| Wall { ends_m, construction: 0 })
        .collect();
    let places = |trajectory| {
        let poses = cogmint::geometry::trajectory::poses(trajectory, None).unwrap();
        let step = (poses.len() - 1) as f64 / 19.0;
        (0..20).map(move |n| poses[(f64::from(n) * step) as usize].position_m)
    };
    let tags: Vec<Point> = scenario.trajectories.iter().flat_map(places).collect();
    let mut total = Tally::default();
    std::thread::scope(|scope| {
        let (walls, tags) = (&walls, &tags);
        let each = |anchor: &cogmint::scenario::Anchor| {
            let place = anchor.position_m;
            scope.spawn(move || agrees(walls, place, tags))
        };
        let threads: Vec<_> = scenario.anchors.iter().map(each).collect();
        threads.into_iter().for_each(|thread| total.add(thread.join().unwrap()));
    });
    total
}

#[test]
fn image_sources_and_rays_find_the_same_paths_along_the_ways_of_the_built_in_scenarios() {
    for built_in in BUILT_IN {
        let scenario = Scenario::parse(built_in.text, built_in.name).unwrap();
        let Tally { agreements, grazing, disagreements } = agrees_in(&scenario);
        let share = grazing as f64 / (agreements + grazing) as f64;
        println!("{}: {agreements} paths agree, {grazing} graze ({:.2} %)", built_in.name, 100.0 * share);
        assert!(disagreements.is_empty(), "{}: {disagreements:#?}", built_in.name);
        assert!(agreements > 200, "{}: only {agreements} paths", built_in.name);
        assert!(share < 0.02, "{}: {grazing} of {agreements} graze", built_in.name);
    }
}
