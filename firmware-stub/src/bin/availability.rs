//! Images and availability alone on a Cortex-M4F: 24 sources of two anchors over 8 walls of 11 segments, at places spread over
//! the room. For every place, the hash over all images and availabilities and the instructions; beside that the stack, the
//! memory of the walls, and what listing the sources took. The plan is below: no feed.

#![no_std]
#![no_main]

use cogmint_board::host::{self, Fault, Line};
use cogmint_board::meter::{Instructions, MeterError, Scratch, instructions};
use cogmint_core::Anchor;
use cogmint_core::model::availability::{WallNow, Walls};
use cogmint_core::model::image::Image;
use cogmint_core::model::listing::{Listed, list};
use cogmint_core::model::plan::{FloorPlan, Plan, PlanSegment, PlanWall};
use cogmint_core::model::surface::Surface;
use cogmint_core::nalgebra::Vector2;
use cogmint_core::trace::TraceHash;
use cortex_m_rt::entry;
use heapless::Vec;

const SOURCES: usize = 24;
const SEGMENTS: usize = 16;
const WALL: PlanWall = PlanWall { offset_std_m: 0.07, rotation_std_rad: 0.0087 };
const OUTLINE_M: [[f32; 2]; 4] = [[0.0, 0.0], [8.0, 0.0], [8.0, 6.0], [0.0, 6.0]];
const ANCHORS_M: [[f32; 2]; 2] = [[0.5, 0.4], [7.2, 5.7]];

/// A room of 8 m by 6 m and four walls in it, two of them with doors.
const PIECES: [(usize, [[f32; 2]; 2]); 11] = [
    (0, [[0.0, 0.0], [8.0, 0.0]]),
    (1, [[8.0, 0.0], [8.0, 6.0]]),
    (2, [[8.0, 6.0], [0.0, 6.0]]),
    (3, [[0.0, 6.0], [0.0, 0.0]]),
    (4, [[5.0, 0.0], [5.0, 1.5]]),
    (4, [[5.0, 2.4], [5.0, 3.5]]),
    (5, [[0.0, 3.5], [1.0, 3.5]]),
    (5, [[1.9, 3.5], [3.0, 3.5]]),
    (5, [[4.0, 3.5], [5.0, 3.5]]),
    (6, [[3.0, 3.5], [3.0, 4.5]]),
    (7, [[6.2, 4.2], [7.0, 4.2]]),
];

#[entry]
fn main() -> ! {
    host::end(run())
}

fn run() -> Result<(), Fault> {
    let segments = PIECES.map(|(wall, ends_m)| PlanSegment { wall, ends_m });
    let told = Plan {
        outline_m: &OUTLINE_M,
        walls: &[WALL; 8],
        segments: &segments,
        turn_std_rad: 0.0,
        reflections: 2,
        most_sources: SOURCES,
    };
    let plan = FloorPlan::<SEGMENTS>::new(&told).map_err(|_| Fault(b"error refused plan\n"))?;
    let anchors = ANCHORS_M.map(|position_m| Anchor { position_m, height_m: 0.0 });
    let stack = Scratch::paint()?;
    let (count, sources) = sources(&plan, &anchors)?;
    let deepest = stack.used()?;
    let mut line = Line::new();
    line.text(b"listed ").decimal(sources.len() as u32).text(b" ").instructions(count);
    line.text(b" stack ").decimal(deepest).end();
    let mut number = 0;
    let stack = Scratch::paint()?;
    for std_m in [0.1, 0.5] {
        for row in 0..4 {
            for column in 0..5 {
                let place_m = [0.8 + 1.6 * column as f32, 0.75 + 1.5 * row as f32];
                let (count, hash) = place(&plan, &sources, place_m, std_m)?;
                let mut line = Line::new();
                line.text(b"place ").decimal(number).text(b" hash ").hex(hash);
                line.text(b" ").instructions(count).end();
                number += 1;
            }
        }
    }
    Line::new()
        .text(b"walls ")
        .decimal(size_of::<Walls<'_, 32>>() as u32)
        .text(b" stack ")
        .decimal(stack.used()?)
        .end();
    Ok(())
}

#[inline(never)]
fn sources(
    plan: &FloorPlan<SEGMENTS>,
    anchors: &[Anchor],
) -> Result<(Instructions, Vec<Listed, SOURCES>), MeterError> {
    instructions(|| list::<SEGMENTS, SOURCES>(plan, anchors, 2, 60.0, 0.15, 8))
}

/// All sources at a place.
#[inline(never)]
fn place(
    plan: &FloorPlan<SEGMENTS>,
    sources: &Vec<Listed, SOURCES>,
    place_m: [f32; 2],
    std_m: f32,
) -> Result<(Instructions, u64), MeterError> {
    let mut found: Vec<(Image, f32), SOURCES> = Vec::new();
    let (count, ()) = instructions(|| {
        let walls = Walls::new(plan, |_, wall| WallNow::told(wall, 0.4));
        let [a_m, b_m] = ANCHORS_M;
        let paths = [walls.paths(a_m, place_m, std_m), walls.paths(b_m, place_m, std_m)];
        for source in sources {
            let Some(paths) = paths.get(source.anchor) else { continue };
            let Some(anchor_m) = ANCHORS_M.get(source.anchor).copied() else { continue };
            let state = Vector2::new(0.02, 0.001);
            let (available, order) = match source.second {
                Some(second) if source.is_either_order => {
                    let (available, is_reversed) = paths.either_order([source.first, second]);
                    (available, if is_reversed { [second, source.first] } else { [source.first, second] })
                }
                second => {
                    (paths.reflected(source.first, second), [source.first, second.unwrap_or(source.first)])
                }
            };
            let surface = |wall: usize| {
                plan.walls().get(wall).map_or(Surface::Private, |wall| Surface::Wall(wall.line))
            };
            let [first, second] = order;
            let mut image = Image::first(anchor_m, &surface(first), &state);
            if source.second.is_some() {
                image = image.second(&surface(second), &state);
            }
            let _ = found.push((image, available));
        }
    })?;
    let mut hash = TraceHash::default();
    for (image, available) in &found {
        hash.float(image.position_m.x);
        hash.float(image.position_m.y);
        image.slopes.iter().flat_map(|slope| slope.iter()).for_each(|value| hash.float(*value));
        hash.float(*available);
    }
    Ok((count, hash.value()))
}
