//! The state filter alone on a Cortex-M4F at full size, 26 ranges per step: with 24 virtual anchors (52 states), or with 24
//! images in 8 walls (20 states). For every step of a feed, the hash over all bits of the filter and the instructions of
//! predict, regress and update; at the end its size and the stack it used. `tests/on_target.sh` runs it in QEMU, on the
//! feeds that `tests/src/full_filter.rs` describes.

#![no_std]
#![no_main]

use cogmint_board::Once;
use cogmint_board::host::{self, Fault, File, Line};
use cogmint_board::meter::{Instructions, MeterError, Scratch, instructions};
use cogmint_core::model::image::Sequence;
use cogmint_core::model::motion::Motion;
use cogmint_core::model::range::Regression;
use cogmint_core::model::source::{Sight, Source};
use cogmint_core::model::surface::{self, Surface};
use cogmint_core::nalgebra::Vector2;
use cogmint_core::perceptor::association::outcome::Innovation;
use cogmint_core::perceptor::state_filter::StateFilter;
use cogmint_core::trace::TraceHash;
use core::cell::UnsafeCell;
use core::mem::MaybeUninit;
use cortex_m_rt::entry;
use heapless::Vec;

const ANCHORS: usize = 2;
const VAS: usize = 24;
const WALLS: usize = 8;
const RANGES: usize = ANCHORS + VAS;
const MAGIC: [u8; 4] = *b"COGF";

type Slot<const SURFACES: usize> = Once<MaybeUninit<StateFilter<ANCHORS, SURFACES>>>;

static PUBLISHED: Slot<VAS> = Once(UnsafeCell::new(MaybeUninit::uninit()));
static PLANNED: Slot<WALLS> = Once(UnsafeCell::new(MaybeUninit::uninit()));

#[entry]
fn main() -> ! {
    host::end(start())
}

/// Runs the form that the feed is of.
fn start() -> Result<(), Fault> {
    let mut words = Words(File::open_feed().ok_or(Fault::FEED)?);
    if words.bytes()? != MAGIC {
        return Err(Fault::FEED);
    }
    let (steps, surfaces) = (words.count()?, words.count()?);
    // SAFETY: see `Once`.
    let (published, planned) = unsafe { (&mut *PUBLISHED.0.get(), &mut *PLANNED.0.get()) };
    match surfaces {
        VAS => run(words, steps, published),
        WALLS => run(words, steps, planned),
        _ => Err(Fault::FEED),
    }
}

/// Words of the feed.
struct Words(File);

impl Words {
    fn bytes(&mut self) -> Result<[u8; 4], Fault> {
        let mut bytes = [0; 4];
        self.0.read(&mut bytes).then_some(bytes).ok_or(Fault::FEED)
    }

    fn count(&mut self) -> Result<usize, Fault> {
        self.bytes().map(|bytes| u32::from_le_bytes(bytes) as usize)
    }

    fn float(&mut self) -> Result<f32, Fault> {
        self.bytes().map(f32::from_le_bytes)
    }

    fn pair(&mut self) -> Result<[f32; 2], Fault> {
        Ok([self.float()?, self.float()?])
    }
}

/// What does not change between steps.
struct Scene {
    anchors_m: [[f32; 2]; ANCHORS],
    images: Vec<(usize, Sequence), VAS>,
    variance_m2: f32,
    step_s: f32,
}

fn run<const SURFACES: usize>(
    mut words: Words,
    steps: usize,
    slot: &mut MaybeUninit<StateFilter<ANCHORS, SURFACES>>,
) -> Result<(), Fault> {
    let motion = Motion {
        acceleration_density_m2_s3: words.float()?,
        velocity_decay_s: words.float()?,
        virtual_anchor_walk_m_sqrt_s: words.float()?,
    };
    let reach_m = words.float()?;
    let start_m = words.pair()?;
    let (position_std_m, velocity_std_m_s) = (words.float()?, words.float()?);
    let filter =
        slot.write(StateFilter::new(motion, reach_m, start_m, position_std_m, velocity_std_m_s, 0.0, 0.0));
    let anchors_m = [words.pair()?, words.pair()?];
    for slot in 0..SURFACES {
        let is_wall = words.count()? != 0;
        let line = surface::Line { centre_m: words.pair()?, normal: words.pair()? };
        let [x, y] = words.pair()?;
        let surface = if is_wall { Surface::Wall(line) } else { Surface::Private };
        if !filter.insert_independent(slot, surface, Vector2::new(x, y), words.pair()?) {
            return Err(Fault::FEED);
        }
    }
    let mut images = Vec::new();
    for _ in 0..VAS {
        let anchor = words.count()?;
        let first = words.count()?.checked_sub(1).ok_or(Fault::FEED)? as u8;
        let second = words.count()?.checked_sub(1).map(|second| second as u8);
        // As many places as images.
        let _ = images.push((anchor, Sequence { first, second, is_either_order: false }));
    }
    let scene = Scene { anchors_m, images, variance_m2: words.float()?, step_s: words.float()? };
    let mut deepest = 0;
    for number in 0..steps {
        let mut ranges_m = [0.0; RANGES];
        for range in &mut ranges_m {
            *range = words.float()?;
        }
        let stack = Scratch::paint()?;
        let parts = step(filter, &scene, &ranges_m)?;
        deepest = deepest.max(stack.used()?);
        let mut hash = TraceHash::default();
        filter.visit(|value| hash.float(value));
        let mut line = Line::new();
        line.text(b"step ").decimal(number as u32).text(b" hash ").hex(hash.value());
        for instructions in parts {
            line.text(b" ").instructions(instructions);
        }
        line.end();
    }
    Line::new()
        .text(b"filter ")
        .decimal(size_of::<StateFilter<ANCHORS, SURFACES>>() as u32)
        .text(b" stack ")
        .decimal(deepest)
        .end();
    Ok(())
}

/// One step; the instructions of predict, regress and update. Its own stack frame, so that all scratch lies below the
/// painter.
#[inline(never)]
fn step<const SURFACES: usize>(
    filter: &mut StateFilter<ANCHORS, SURFACES>,
    scene: &Scene,
    ranges_m: &[f32; RANGES],
) -> Result<[Instructions; 3], MeterError> {
    let (predict, ()) = instructions(|| filter.predict(scene.step_s))?;
    let (regress, lines) = instructions(|| lines(filter, scene))?;
    let (update, ()) = instructions(|| {
        filter.update(lines.iter().zip(ranges_m).map(|(regression, range_m)| {
            Innovation::hard(*regression, range_m - regression.range_m, scene.variance_m2)
        }));
    })?;
    Ok([predict, regress, update])
}

/// The regressions of all ranges, physical anchors first.
fn lines<const SURFACES: usize>(
    filter: &StateFilter<ANCHORS, SURFACES>,
    scene: &Scene,
) -> Vec<Regression, RANGES> {
    let direct = (0..ANCHORS).map(|anchor| (Source::Direct { anchor }, None));
    let images = scene.images.iter().enumerate();
    let images =
        images.map(|(slot, (anchor, sequence))| (Source::Virtual { anchor: *anchor, slot }, Some(sequence)));
    let mut lines = Vec::new();
    for (source, sequence) in direct.chain(images) {
        let Some(anchor_m) = scene.anchors_m.get(source.anchor()) else { continue };
        let sight = Sight { anchor_m: *anchor_m, height_m: 0.0, height_std_m: 0.0, lever_arm_m: [0.0; 2] };
        if let Some(line) = filter.regress(source, &sight, sequence) {
            // As many places as sources.
            let _ = lines.push(line);
        }
    }
    lines
}
