//! What the firmware's programs share: the debugger's host, the feed it reads, and the meters.
//!
//! No panic: the handler calls a function that does not exist, so a program links only if no panic is reachable.

#![no_std]

pub mod feed;
pub mod host;
pub mod meter;
pub mod replay;

use core::cell::UnsafeCell;

/// Memory that lives outside the stack and is handed out once, to `main`.
pub struct Once<T>(pub UnsafeCell<T>);

// SAFETY: the only access is the one `&mut` that the entry point takes before anything else runs; this firmware
// has neither interrupts that touch it nor a second core.
unsafe impl<T> Sync for Once<T> {}

/// A fault of the processor, such as an access outside of memory, ends the run instead of stopping it in silence.
#[cortex_m_rt::exception(trampoline = false)]
unsafe fn HardFault() -> ! {
    extern "C" fn report() -> ! {
        host::end(Err(host::Fault(
            b"error hard fault: an access outside of memory, or a stack that left it\n",
        )))
    }
    // SAFETY: a fresh stack, since the fault may be that the old one left the memory, to which nothing returns.
    unsafe { cortex_m::asm::bootstrap(meter::stack::top() as *const u32, report as *const u32) }
}

/// Never linked: see the head of this file.
#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    unsafe extern "C" {
        fn cogmint_has_a_reachable_panic() -> !;
    }
    // SAFETY: the symbol does not exist; an image that reaches this line does not link.
    unsafe { cogmint_has_a_reachable_panic() }
}
