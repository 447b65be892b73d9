//! The filters of other crates on a Cortex-M4F: instructions, heap and deepest stack of a step at full size (52 states,
//! 26 ranges), one filter after the other over the feed that `tests/src/full_filter.rs` describes.
//! `tests/filter_benchmark.sh` runs it.

#![no_std]
#![no_main]

extern crate alloc;

use alloc::boxed::Box;
use cogmint_board::host::{self, Fault, File, Line};
use cogmint_board::meter::{Instructions, MeterError, Scratch, instructions};
use cogmint_peer_filters::textbook::Textbook;
use cogmint_peer_filters::{ANCHORS, Filter, RANGES, STATES, Scene, VAS, kfilter_crate, minikalman_crate};
use core::alloc::{GlobalAlloc, Layout};
use core::cell::UnsafeCell;
use core::ptr;
use cortex_m_rt::entry;

const HEAP_BYTES: usize = 2 << 20;

/// Hands out memory and never takes it back: the filters allocate at their start only.
#[repr(align(8))]
struct Heap(UnsafeCell<[u8; HEAP_BYTES]>, UnsafeCell<usize>);

// SAFETY: one core, no interrupts.
unsafe impl Sync for Heap {}

// SAFETY: pieces are aligned, lie within the heap and never overlap.
unsafe impl GlobalAlloc for Heap {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: see `Sync`.
        let used = unsafe { &mut *self.1.get() };
        let from = used.next_multiple_of(layout.align());
        if from + layout.size() > HEAP_BYTES {
            return ptr::null_mut();
        }
        *used = from + layout.size();
        self.0.get().cast::<u8>().wrapping_add(from)
    }

    unsafe fn dealloc(&self, _: *mut u8, _: Layout) {}
}

#[global_allocator]
static HEAP: Heap = Heap(UnsafeCell::new([0; HEAP_BYTES]), UnsafeCell::new(0));

fn heap_used() -> u32 {
    // SAFETY: see `Heap`.
    unsafe { *HEAP.1.get() as u32 }
}

/// The board's panic handler calls a function that only exists where panics are allowed: here they are.
#[unsafe(no_mangle)]
extern "C" fn cogmint_has_a_reachable_panic() -> ! {
    host::end(Err(Fault(b"error panic\n")))
}

#[entry]
fn main() -> ! {
    let starts: [(&[u8], fn(&Scene) -> Box<dyn Filter>); 4] = [
        (b"minikalman-ekf", |scene| Box::new(minikalman_crate::extended(scene))),
        (b"kfilter-ekf", |scene| Box::new(kfilter_crate::Extended::new(scene))),
        (b"kfilter-ukf", |scene| Box::new(kfilter_crate::Unscented::new(scene))),
        (b"nalgebra-static", |scene| Box::new(Textbook::new(scene))),
    ];
    host::end(starts.into_iter().try_for_each(|(name, start)| run(name, start)))
}

/// Words of the feed.
struct Words(File);

impl Words {
    fn word(&mut self) -> Result<[u8; 4], Fault> {
        let mut bytes = [0; 4];
        if self.0.read(&mut bytes) { Ok(bytes) } else { Err(Fault::FEED) }
    }

    fn float(&mut self) -> Result<f32, Fault> {
        self.word().map(f32::from_le_bytes)
    }

    fn point(&mut self) -> Result<[f32; 2], Fault> {
        Ok([self.float()?, self.float()?])
    }
}

fn run(name: &[u8], start: fn(&Scene) -> Box<dyn Filter>) -> Result<(), Fault> {
    let mut words = Words(File::open_feed().ok_or(Fault::FEED)?);
    let _magic = words.word()?;
    let steps = u32::from_le_bytes(words.word()?);
    let _surfaces = words.word()?;
    let acceleration_density_m2_s3 = words.float()?;
    let _velocity_decay_s = words.float()?;
    let virtual_anchor_walk_m_sqrt_s = words.float()?;
    let _reach_m = words.float()?;
    let start_m = words.point()?;
    let (position_std_m, velocity_std_m_s) = (words.float()?, words.float()?);
    let mut anchors_m = [[0.0; 2]; ANCHORS];
    for anchor in &mut anchors_m {
        *anchor = words.point()?;
    }
    let mut virtual_anchors_m = [[0.0; 2]; VAS];
    let mut image_std_m = 0.0;
    for place in &mut virtual_anchors_m {
        // All are private surfaces: no line.
        let _is_wall = words.word()?;
        let _line = [words.point()?, words.point()?];
        *place = words.point()?;
        [image_std_m, _] = words.point()?;
    }
    for _ in 0..VAS {
        let _image = [words.word()?, words.word()?, words.word()?];
    }
    let std = [position_std_m, velocity_std_m_s, image_std_m];
    let scene = Scene {
        mean: [0.0; STATES],
        variance: [0.0; STATES],
        anchors_m,
        range_variance_m2: words.float()?,
        step_s: words.float()?,
        acceleration_density_m2_s3,
        virtual_anchor_walk_m_sqrt_s,
    };
    let scene = scene.started(start_m, std, &virtual_anchors_m);
    let heap = heap_used();
    let mut filter = start(&scene);
    let mut deepest = 0;
    let mut total = 0_u64;
    for _ in 0..steps {
        let mut ranges_m = [0.0; RANGES];
        for range in &mut ranges_m {
            *range = words.float()?;
        }
        let stack = Scratch::paint()?;
        total += step(&mut *filter, &ranges_m)?.count();
        deepest = deepest.max(stack.used()?);
    }
    Line::new()
        .text(b"peer ")
        .text(name)
        .text(b" ")
        .decimal((total / u64::from(steps.max(1))) as u32)
        .text(b" ")
        .decimal(heap_used() - heap + deepest)
        .end();
    Ok(())
}

/// One step; its own stack frame, so that all scratch lies below the painter.
#[inline(never)]
fn step(filter: &mut dyn Filter, ranges_m: &[f32; RANGES]) -> Result<Instructions, MeterError> {
    Ok(instructions(|| filter.step(ranges_m))?.0)
}
