//! The meters themselves, on work whose cost is known beforehand, and on work that they cannot measure: then they must
//! say so. The feed is three words: `COGX`, what to do, and how much of it. `tests/target_meters.sh` runs it in QEMU.

#![no_std]
#![no_main]

use cogmint_board::host::{self, Fault, File, Line};
use cogmint_board::meter::counter::Counter;
use cogmint_board::meter::{instructions, stack};
use core::arch::asm;
use core::hint::black_box;
use cortex_m_rt::entry;

const MAGIC: u32 = u32::from_le_bytes(*b"COGX");

/// What to do.
const COUNT: u32 = 0;
const COUNT_AFTER_LIMIT: u32 = 1;
const DIG: u32 = 2;
/// Ticks after which the counter wraps where it is limited.
const LIMIT_TICKS: u32 = 1_000_000;
/// Bytes of one stack frame of [`dig`], at least.
const BLOCK_BYTES: usize = 256;

#[entry]
fn main() -> ! {
    host::end(run())
}

fn run() -> Result<(), Fault> {
    let mut feed = File::open_feed().ok_or(Fault::FEED)?;
    let mut word = || {
        let mut bytes = [0; 4];
        feed.read(&mut bytes).then(|| u32::from_le_bytes(bytes)).ok_or(Fault::FEED)
    };
    if word()? != MAGIC {
        return Err(Fault::FEED);
    }
    let (what, amount) = (word()?, word()?);
    match what {
        COUNT => {
            let (count, ()) = instructions(|| spend(amount))?;
            Line::new().text(b"counted ").instructions(count).end();
        }
        COUNT_AFTER_LIMIT => {
            let counter = Counter::start_with_limit(LIMIT_TICKS);
            spend(amount);
            Line::new().text(b"ticks ").decimal(counter.ticks()?).end();
        }
        DIG => {
            let lowest = dig(amount as usize);
            let deepest = stack::deepest_from_reset()?;
            Line::new().text(b"pointer ").decimal((stack::top() - lowest) as u32).end();
            Line::new().text(b"deepest ").decimal(deepest).end();
        }
        _ => return Err(Fault::FEED),
    }
    Ok(())
}

/// Takes two instructions per turn, and four more.
fn spend(turns: u32) {
    // SAFETY: counts a register down to zero; `turns` of zero goes once around all of its values.
    unsafe {
        asm!("1: subs {turns}, #1", "bne 1b", turns = inout(reg) turns => _, options(nomem, nostack));
    }
}

/// Uses so many bytes of stack, rounded up to whole frames; the stack pointer in the deepest one.
#[inline(never)]
fn dig(bytes: usize) -> usize {
    let mut block = [0_u8; BLOCK_BYTES];
    black_box(&mut block);
    let lowest = match bytes.checked_sub(BLOCK_BYTES) {
        Some(left) => dig(left),
        None => cortex_m::register::msp::read() as usize,
    };
    // Keeps the block alive until here: no tail call.
    black_box(&mut block);
    lowest
}
