//! The instruction counter: a 32-bit timer, whose wrap is noticed.
//!
//! QEMU with `-icount shift=0` runs one instruction per virtual nanosecond, and the mps2-an386's timers count at 25 MHz:
//! a tick is 40 instructions, and the timer holds 171 thousand million. The processor's own SysTick has 24 bits and wraps
//! after 671 million without a trace that is sure to be read.

use super::MeterError;

/// Instructions per tick.
const PER_TICK: u32 = 40;
/// Ticks per thousand million instructions.
const TICKS_PER_BILLION: u32 = 1_000_000_000 / PER_TICK;

/// Timer 0 of the mps2-an386 (CMSDK APB timer): counts down, reloads, and marks its wrap as a pending interrupt.
#[repr(C)]
struct Timer {
    control: u32,
    value: u32,
    reload: u32,
    interrupt: u32,
}

const TIMER: *mut Timer = 0x4000_0000 as *mut Timer;
/// Control: enabled, and wraps are marked. No handler runs, since the interrupt controller passes none on.
const RUN: u32 = 0b1001;

/// Number of instructions, to within 40.
#[derive(Clone, Copy)]
pub struct Instructions {
    ticks: u32,
}

impl Instructions {
    pub(super) fn of(ticks: u32) -> Self {
        Self { ticks }
    }

    /// Their number.
    pub fn count(self) -> u64 {
        u64::from(self.ticks) * u64::from(PER_TICK)
    }

    /// Thousand millions, and what is left.
    pub fn parts(self) -> (u32, u32) {
        (self.ticks / TICKS_PER_BILLION, self.ticks % TICKS_PER_BILLION * PER_TICK)
    }
}

/// The running timer.
pub struct Counter {
    limit: u32,
}

impl Counter {
    /// Starts from zero.
    pub fn start() -> Self {
        Self::start_with_limit(u32::MAX)
    }

    /// Starts from zero and wraps after `limit` ticks.
    pub fn start_with_limit(limit: u32) -> Self {
        // SAFETY: the timer's registers are this firmware's alone; writing them has no effect on memory.
        unsafe {
            (&raw mut (*TIMER).control).write_volatile(0);
            (&raw mut (*TIMER).interrupt).write_volatile(1);
            // Writing the reload value also sets the count.
            (&raw mut (*TIMER).reload).write_volatile(limit);
            (&raw mut (*TIMER).control).write_volatile(RUN);
        }
        Self { limit }
    }

    /// Ticks since the start, or since the last wrap.
    pub(super) fn elapsed(&self) -> u32 {
        // SAFETY: reading the timer changes nothing.
        self.limit.wrapping_sub(unsafe { (&raw const (*TIMER).value).read_volatile() })
    }

    /// Ticks since the start.
    ///
    /// # Errors
    /// The counter has wrapped.
    pub fn ticks(&self) -> Result<u32, MeterError> {
        let ticks = self.elapsed();
        // Read after the count: a wrap in between is an error too, never a small figure.
        // SAFETY: reading the timer changes nothing.
        let wraps = unsafe { (&raw const (*TIMER).interrupt).read_volatile() };
        if wraps & 1 == 0 { Ok(ticks) } else { Err(MeterError::CounterWrapped) }
    }
}

/// Instructions that `work` takes.
///
/// # Errors
/// More than the counter holds.
pub fn instructions<T>(work: impl FnOnce() -> T) -> Result<(Instructions, T), MeterError> {
    let counter = Counter::start();
    let result = work();
    Ok((Instructions::of(counter.ticks()?), result))
}
