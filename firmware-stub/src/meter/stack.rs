//! The stack meter: at reset, before anything else runs, cortex-m-rt paints all RAM from the static variables to the
//! initial stack pointer (its feature `paint-stack`), and the paint that is left says how deep the stack went. The lowest
//! part of the paint is a guard: where it is touched there is no figure but an error.

use super::MeterError;
use core::ptr;

const PAINT: u32 = cortex_m_rt::STACK_PAINT_VALUE;
/// Left unpainted below the stack pointer: the painter's own stack frame.
const MARGIN_BYTES: usize = 64;
/// Bytes above the static variables that the stack must leave alone.
pub const GUARD_BYTES: usize = 1024;

unsafe extern "C" {
    /// End of the static variables, where the stack may grow down to.
    static _stack_end: u32;
    static _stack_start: u32;
}

fn floor() -> usize {
    // Only the symbol's address is taken.
    &raw const _stack_end as usize
}

/// The initial stack pointer.
pub fn top() -> usize {
    // Only the symbol's address is taken.
    &raw const _stack_start as usize
}

fn pointer() -> usize {
    cortex_m::register::msp::read() as usize
}

/// Paints from the static variables to the stack pointer.
#[inline(never)]
fn paint() {
    let end = pointer() - MARGIN_BYTES;
    let mut address = floor();
    while address < end {
        // SAFETY: between the end of the static variables and the stack pointer lies nothing.
        unsafe { ptr::write_volatile(address as *mut u32, PAINT) };
        address += 4;
    }
}

/// The lowest address without paint.
fn lowest_used() -> usize {
    let mut address = floor();
    // SAFETY: up to the initial stack pointer all is RAM.
    while address < top() && unsafe { ptr::read_volatile(address as *const u32) } == PAINT {
        address += 4;
    }
    address
}

/// Whether the stack pointer is above the guard now.
pub fn is_pointer_above_guard() -> bool {
    pointer() >= floor() + GUARD_BYTES
}

/// Whether the guard is untouched.
///
/// # Errors
/// It is not.
#[inline(never)]
pub fn check_guard() -> Result<(), MeterError> {
    let mut address = floor();
    while address < floor() + GUARD_BYTES {
        // SAFETY: as above. A volatile read: the paint is written behind the compiler's back.
        if address >= top() || unsafe { ptr::read_volatile(address as *const u32) } != PAINT {
            return Err(MeterError::StackExhausted);
        }
        address += 4;
    }
    Ok(())
}

/// Bytes of stack used at most, from the initial stack pointer.
///
/// # Errors
/// The guard is touched.
pub fn deepest_from_reset() -> Result<u32, MeterError> {
    check_guard()?;
    Ok((top() - lowest_used()) as u32)
}

/// Stack of one piece of work: painted anew below the stack pointer. What [`deepest_from_reset`] says afterwards is the
/// deepest since the last such painting.
pub struct Scratch {
    top: usize,
}

impl Scratch {
    /// Paints the free stack.
    ///
    /// # Errors
    /// The guard was touched before.
    #[inline(never)]
    pub fn paint() -> Result<Self, MeterError> {
        check_guard()?;
        let top = pointer();
        paint();
        Ok(Self { top })
    }

    /// Bytes of stack used at most below the place of painting, since then.
    ///
    /// # Errors
    /// The guard is touched.
    #[inline(never)]
    pub fn used(&self) -> Result<u32, MeterError> {
        check_guard()?;
        Ok(self.top.saturating_sub(lowest_used()) as u32)
    }
}
