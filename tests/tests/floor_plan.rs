//! Images, availability and the list of sources on the microcontroller's terms against their twins, over plans that no room has.

use cogmint::reference::availability::{self as twin, WallNow as TwinWall};
use cogmint::reference::image::Image as TwinImage;
use cogmint::reference::listing as twin_listing;
use cogmint::reference::plan::FloorPlan as TwinPlan;
use cogmint::reference::surface::Line as TwinLine;
use cogmint_core::Anchor;
use cogmint_core::model::availability::{WallNow, Walls};
use cogmint_core::model::image::Image;
use cogmint_core::model::listing::list;
use cogmint_core::model::plan::{FloorPlan, Plan, PlanSegment, PlanWall};
use cogmint_core::model::surface::{Line, Surface};
use nalgebra::{Matrix2, Vector2};
use rand_core::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro128PlusPlus;

const SEGMENTS: usize = 40;

/// Walls, segments and outline.
struct Told {
    outline_m: Vec<[f32; 2]>,
    walls: Vec<PlanWall>,
    segments: Vec<PlanSegment>,
}

impl Told {
    fn plan(&self) -> Plan<'_> {
        Plan {
            outline_m: &self.outline_m,
            walls: &self.walls,
            segments: &self.segments,
            turn_std_rad: 0.01,
            reflections: 2,
            most_sources: 24,
        }
    }
}

struct Random(Xoshiro128PlusPlus);

impl Random {
    fn uniform(&mut self) -> f32 {
        (self.0.next_u32() >> 8) as f32 / 16_777_216.0
    }

    /// A place in and around the room; now and then on one of its lines.
    fn place_m(&mut self) -> [f32; 2] {
        let [x, y] = [12.0 * self.uniform() - 2.0, 10.0 * self.uniform() - 2.0];
        if self.uniform() < 0.1 { [x, 0.0] } else { [x, y] }
    }

    /// A room and walls in it, each of one or two segments, told in no order.
    fn told(&mut self, inner: usize) -> Told {
        let (w, h) = (4.0 + 5.0 * self.uniform(), 3.0 + 4.0 * self.uniform());
        let corners = [[0.0, 0.0], [w, 0.0], [w, h], [0.0, h]];
        let mut pieces: Vec<(usize, [[f32; 2]; 2])> =
            (0..4).map(|n| (n, [corners[n], corners[(n + 1) % 4]])).collect();
        for wall in 4..4 + inner {
            let ([x, y], [dx, dy]) = (self.place_m(), self.place_m().map(|d| 0.2 + d.abs()));
            let [a, b] = [0.3, 0.5].map(|share| [x + share * dx, y + share * dy]);
            pieces.push((wall, [[x, y], a]));
            if inner < 16 && self.uniform() < 0.5 {
                pieces.push((wall, [b, [x + dx, y + dy]]));
            }
        }
        let mid = pieces.len() / 2;
        pieces.rotate_left(mid);
        let mut std = |most: f32| if self.uniform() < 0.3 { 0.0 } else { 1e-3 + most * self.uniform() };
        let walls = (0..4 + inner)
            .map(|_| PlanWall { offset_std_m: std(0.2), rotation_std_rad: std(0.02) })
            .collect();
        Told {
            outline_m: if self.uniform() < 0.8 { corners.to_vec() } else { vec![] },
            walls,
            segments: pieces.into_iter().map(|(wall, ends_m)| PlanSegment { wall, ends_m }).collect(),
        }
    }
}

fn twin_of(line: &Line) -> TwinLine<f32> {
    TwinLine { centre_m: line.centre_m, normal: line.normal }
}

#[test]
fn core_and_twin_see_the_same_bits() {
    let mut random = Random(Xoshiro128PlusPlus::seed_from_u64(5));
    let (mut compared, mut partly, mut reversed) = (0, 0, 0);
    for problem in 0..600 {
        let told = random.told(if problem % 20 == 0 { 34 } else { problem % 6 });
        let plan = FloorPlan::<SEGMENTS>::new(&told.plan()).unwrap();
        let through: Vec<f32> = told.walls.iter().map(|_| random.uniform()).collect();
        let moves: Vec<[f32; 2]> = told
            .walls
            .iter()
            .map(|_| [0.2 * random.uniform() - 0.1, 0.1 * random.uniform() - 0.05])
            .collect();
        // Told as they are, and moved by the core, which the twin's images check.
        let lines: Vec<Line> =
            plan.walls().iter().zip(&moves).map(|(wall, [o, r])| wall.line.moved(*o, *r)).collect();
        let walls = Walls::new(&plan, |index, wall| WallNow {
            line: lines[index],
            std_m: wall.told.offset_std_m,
            through: through[index],
        });
        let mut twins = Vec::new();
        for (index, mut wall) in TwinPlan::<f32>::new(&told.plan()).walls.into_iter().enumerate() {
            assert_eq!((wall.line.centre_m, wall.line.normal), {
                let line = plan.walls()[index].line;
                (line.centre_m, line.normal)
            });
            wall.line = twin_of(&lines[index]);
            let std_m = wall.told.offset_std_m;
            twins.push(TwinWall::new(wall, std_m, through[index]));
        }
        let anchor_m = random.place_m();
        for _ in 0..4 {
            let (place_m, std_m) = (random.place_m(), [0.0, 0.05, 0.3, 2.0][problem % 4]);
            let paths = walls.paths(anchor_m, place_m, std_m);
            let mut check = |ours: f32, sequence: &[usize]| {
                let theirs = twin::availability(&twins, anchor_m, sequence, place_m, std_m);
                assert_eq!(ours.to_bits(), theirs.to_bits(), "{problem} {sequence:?}: {ours} {theirs}");
                compared += 1;
                partly += usize::from(ours > 0.0 && ours < 1.0);
            };
            check(paths.direct(), &[]);
            let most = told.walls.len();
            for first in (0..most).step_by(1 + most / 8) {
                check(paths.reflected(first, None), &[first]);
                for second in (0..most).filter(|second| *second != first) {
                    check(paths.reflected(first, Some(second)), &[first, second]);
                }
            }
            let pair = [0, 1 + problem % 3];
            let (ours, is_reversed) = paths.either_order(pair);
            let theirs = twin::either_order(&twins, anchor_m, pair, place_m, std_m);
            assert_eq!((ours.to_bits(), is_reversed), (theirs.0.to_bits(), theirs.1));
            reversed += usize::from(is_reversed);
        }
    }
    assert!(compared > 20_000 && partly > 4000 && reversed > 200, "{compared} {partly} {reversed}");
}

#[test]
fn core_and_twin_list_the_same_sources() {
    let mut random = Random(Xoshiro128PlusPlus::seed_from_u64(6));
    let (mut listed, mut either) = (0, 0);
    for problem in 0..120 {
        let told = random.told(problem % 5);
        let plan = FloorPlan::<SEGMENTS>::new(&told.plan()).unwrap();
        let anchors: Vec<Anchor> =
            (0..1 + problem % 3).map(|_| Anchor { position_m: random.place_m(), height_m: 0.0 }).collect();
        let (range_m, walls) = ([8.0, 100.0][problem % 2], [3, 6, 16][problem % 3]);
        let (reflections, pulse_m) = (problem % 7 % 3, [0.15, 0.6][problem % 2]);
        let ours = list::<SEGMENTS, 24>(&plan, &anchors, reflections, range_m, pulse_m, walls);
        let twin = TwinPlan::<f32>::new(&told.plan());
        let theirs = twin_listing::list(&twin, &anchors, reflections, range_m, pulse_m, walls, 24);
        assert_eq!(ours.len(), theirs.len(), "{problem}");
        for (own, twin) in ours.iter().zip(&theirs) {
            let walls: Vec<usize> = std::iter::once(own.first).chain(own.second).collect();
            assert_eq!((own.anchor, &walls), (twin.anchor, &twin.walls), "{problem}");
            assert_eq!(own.is_either_order, twin.is_either_order, "{problem}");
            assert_eq!(own.seen_share.to_bits(), twin.seen_share.to_bits(), "{problem}");
            listed += 1;
            either += usize::from(own.is_either_order);
        }
    }
    assert!(listed > 500 && either > 50, "{listed} {either}");
}

#[test]
fn core_and_twin_see_the_same_images() {
    let mut random = Random(Xoshiro128PlusPlus::seed_from_u64(7));
    for _ in 0..3000 {
        let anchor_m = random.place_m();
        let walls: Vec<(Line, [f32; 2])> = (0..2)
            .map(|_| {
                let turn = 6.3 * random.uniform();
                let line = Line { centre_m: random.place_m(), normal: [turn.cos(), turn.sin()] };
                (line, [2.0 * random.uniform() - 1.0, random.uniform() - 0.5])
            })
            .collect();
        let mut matrix = || Matrix2::from_fn(|_, _| random.uniform());
        let (own, cross) = ([matrix(), matrix()], matrix());
        let state = |n: usize| Vector2::from(walls[n].1);
        let once = Image::first(anchor_m, &Surface::Wall(walls[0].0), &state(0));
        let twice = once.second(&Surface::Wall(walls[1].0), &state(1));
        for (order, ours) in [(1, once), (2, twice)] {
            let twins: Vec<_> =
                walls[..order].iter().map(|(line, numbers)| (twin_of(line), *numbers)).collect();
            let twin = TwinImage::of(anchor_m, &twins);
            assert_eq!(<[f32; 2]>::from(ours.position_m), twin.position_m);
            for (wall, slopes) in twin.slopes.iter().enumerate() {
                for (number, slope) in slopes.iter().enumerate() {
                    assert_eq!(<[f32; 2]>::from(ours.slopes[wall].column(number).into_owned()), *slope);
                }
            }
            let told = own.map(|own| [own.m21, own.m22]);
            let shift = ours.shift_m(&own, &cross);
            assert_eq!(<[f32; 2]>::from(shift), twin.shift_m(&told, [cross.m12, cross.m22]), "{order}");
        }
    }
}
