//! What a cycle costs: instructions per stage, and stack.

use cogmint_core::observer::{Observer, Stage};
use core::ptr;

/// QEMU with `-icount shift=0` runs one instruction per virtual nanosecond; SysTick counts at 25 MHz there.
const INSTRUCTIONS_PER_TICK: u32 = 40;
/// SysTick counts down from here.
const RELOAD: u32 = 0x00ff_ffff;
/// Stages that cost something: all but [`Stage::Done`].
const STAGES: usize = 8;

fn start_counter() {
    // SAFETY: the SysTick registers are this firmware's alone; writing them has no effect on memory.
    unsafe {
        let systick = &*cortex_m::peripheral::SYST::PTR;
        systick.rvr.write(RELOAD);
        systick.cvr.write(0);
        // Enabled, no interrupt, processor clock.
        systick.csr.write(0b101);
    }
}

/// Instructions that `work` takes, to within 40; below 600 million.
pub fn instructions<T>(work: impl FnOnce() -> T) -> (u32, T) {
    start_counter();
    let then = cortex_m::peripheral::SYST::get_current();
    let result = work();
    let now = cortex_m::peripheral::SYST::get_current();
    ((then.wrapping_sub(now) & RELOAD).saturating_mul(INSTRUCTIONS_PER_TICK), result)
}

/// Counts the ticks of every stage of a cycle.
pub struct StageMeter {
    ticks: [u32; STAGES],
    running: Option<(usize, u32)>,
}

impl Default for StageMeter {
    fn default() -> Self {
        start_counter();
        Self { ticks: [0; STAGES], running: None }
    }
}

impl StageMeter {
    /// Instructions of each stage, in the order of [`Stage`]; to within 40.
    pub fn per_stage(&self) -> impl Iterator<Item = u32> {
        self.ticks.iter().map(|ticks| ticks.saturating_mul(INSTRUCTIONS_PER_TICK))
    }
}

fn index(stage: Stage) -> Option<usize> {
    match stage {
        Stage::Receive => Some(0),
        Stage::Estimate => Some(1),
        Stage::Predict => Some(2),
        Stage::Associate => Some(3),
        Stage::Update => Some(4),
        Stage::Remember => Some(5),
        Stage::Discover => Some(6),
        Stage::Act => Some(7),
        Stage::Done => None,
    }
}

impl<const VAS: usize, const PATHS: usize> Observer<VAS, PATHS> for StageMeter {
    fn stage(&mut self, stage: Stage) {
        let now = cortex_m::peripheral::SYST::get_current();
        if let Some((stage, then)) = self.running
            && let Some(ticks) = self.ticks.get_mut(stage)
        {
            *ticks += then.wrapping_sub(now) & RELOAD;
        }
        self.running = index(stage).map(|stage| (stage, now));
    }
}

/// Finds how deep the stack went: paints the free part and looks later how much of the paint is left.
pub struct StackMeter {
    top: usize,
}

const PAINT: u32 = 0xc0_97_1d_05;
/// Left unpainted below the stack pointer: the painter's own frame.
const MARGIN: usize = 64;

unsafe extern "C" {
    /// End of the static variables, where the stack may grow down to.
    static mut __sheap: u32;
}

fn floor() -> usize {
    // SAFETY: only the symbol's address is taken.
    ptr::addr_of!(__sheap) as usize
}

impl StackMeter {
    /// Paints the free stack.
    #[inline(never)]
    pub fn paint() -> Self {
        let top = cortex_m::register::msp::read() as usize;
        let mut address = floor();
        while address < top - MARGIN {
            // SAFETY: between the end of the static variables and the stack pointer lies nothing.
            unsafe { ptr::write_volatile(address as *mut u32, PAINT) };
            address += 4;
        }
        Self { top }
    }

    /// Bytes of stack used below the place of painting, at most, since then.
    #[inline(never)]
    pub fn used(&self) -> u32 {
        let mut address = floor();
        // SAFETY: as above; the addresses are mapped RAM.
        while address < self.top && unsafe { ptr::read_volatile(address as *const u32) } == PAINT {
            address += 4;
        }
        (self.top - address) as u32
    }
}
