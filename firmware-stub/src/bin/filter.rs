//! The state filter alone on a Cortex-M4F at full size: 24 virtual anchors (52 states), 26 ranges per step. For every
//! step of a feed, the hash over all bits of the filter and the instructions of predict, regress and update; at the end
//! its size and the stack it used. `tests/on_target.sh` runs it in QEMU, on the feed that `tests/src/full_filter.rs`
//! describes.

#![no_std]
#![no_main]

use cogmint_board::Once;
use cogmint_board::host::{self, Fault, File, Line};
use cogmint_board::meter::{Instructions, MeterError, Scratch, instructions};
use cogmint_core::model::motion::Motion;
use cogmint_core::model::range::Regression;
use cogmint_core::model::source::{Sight, Source};
use cogmint_core::perceptor::association::outcome::Innovation;
use cogmint_core::perceptor::state_filter::StateFilter;
use cogmint_core::trace::TraceHash;
use core::cell::UnsafeCell;
use core::mem::MaybeUninit;
use cortex_m_rt::entry;
use heapless::Vec;

const ANCHORS: usize = 2;
const VAS: usize = 24;
const RANGES: usize = ANCHORS + VAS;
const MAGIC: [u8; 4] = *b"COGF";

type Filter = StateFilter<ANCHORS, VAS>;

static FILTER: Once<MaybeUninit<Filter>> = Once(UnsafeCell::new(MaybeUninit::uninit()));

#[entry]
fn main() -> ! {
    // SAFETY: see `Once`.
    let slot = unsafe { &mut *FILTER.0.get() };
    host::end(run(slot))
}

/// Words of the feed.
struct Words(File);

impl Words {
    fn bytes(&mut self) -> Result<[u8; 4], Fault> {
        let mut bytes = [0; 4];
        self.0.read(&mut bytes).then_some(bytes).ok_or(Fault::FEED)
    }

    fn float(&mut self) -> Result<f32, Fault> {
        self.bytes().map(f32::from_le_bytes)
    }
}

/// What does not change between steps.
struct Scene {
    anchors_m: [[f32; 2]; ANCHORS],
    variance_m2: f32,
    step_s: f32,
}

fn run(slot: &mut MaybeUninit<Filter>) -> Result<(), Fault> {
    let mut words = Words(File::open_feed().ok_or(Fault::FEED)?);
    if words.bytes()? != MAGIC {
        return Err(Fault::FEED);
    }
    let steps = u32::from_le_bytes(words.bytes()?);
    let motion = Motion {
        acceleration_density_m2_s3: words.float()?,
        velocity_decay_s: words.float()?,
        virtual_anchor_walk_m_sqrt_s: words.float()?,
        position_std_limit_m: words.float()?,
    };
    let start_m = [words.float()?, words.float()?];
    let (position_std_m, velocity_std_m_s) = (words.float()?, words.float()?);
    let virtual_anchor_std_m = words.float()?;
    let filter = slot.write(Filter::new(motion, start_m, position_std_m, velocity_std_m_s, 0.0, 0.0));
    let mut anchors_m = [[0.0; 2]; ANCHORS];
    for anchor in &mut anchors_m {
        *anchor = [words.float()?, words.float()?];
    }
    for slot in 0..VAS {
        if !filter.insert_independent(slot, [words.float()?, words.float()?], virtual_anchor_std_m) {
            return Err(Fault::FEED);
        }
    }
    let scene = Scene { anchors_m, variance_m2: words.float()?, step_s: words.float()? };
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
        line.text(b"step ").decimal(number).text(b" hash ").hex(hash.value());
        for instructions in parts {
            line.text(b" ").instructions(instructions);
        }
        line.end();
    }
    Line::new().text(b"filter ").decimal(size_of::<Filter>() as u32).text(b" stack ").decimal(deepest).end();
    Ok(())
}

/// One step; the instructions of predict, regress and update. Its own stack frame, so that all scratch lies below the
/// painter.
#[inline(never)]
fn step(
    filter: &mut Filter,
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
fn lines(filter: &Filter, scene: &Scene) -> Vec<Regression, RANGES> {
    let direct = (0..ANCHORS).map(|anchor| Source::Direct { anchor });
    let images = (0..VAS).map(|slot| Source::Virtual { anchor: slot % ANCHORS, slot });
    let mut lines = Vec::new();
    for source in direct.chain(images) {
        let Some(anchor_m) = scene.anchors_m.get(source.anchor()) else { continue };
        if let Some(line) =
            filter.regress(source, &Sight { anchor_m: *anchor_m, height_m: 0.0, height_std_m: 0.0 })
        {
            // As many places as sources.
            let _ = lines.push(line);
        }
    }
    lines
}
