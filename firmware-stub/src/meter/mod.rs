//! What a cycle costs: instructions per stage, and stack. Both meters report an error where they cannot measure.

pub mod counter;
pub mod stack;

pub use self::counter::{Instructions, instructions};
pub use self::stack::Scratch;

use self::counter::Counter;
use crate::host::Fault;
use cogmint_core::observer::{Observer, Stage};

/// Stages that cost something: all but [`Stage::Done`].
const STAGES: usize = 8;

/// Why there is no figure.
#[derive(Clone, Copy)]
pub enum MeterError {
    /// More instructions than the counter holds.
    CounterWrapped,
    /// The stack came within [`stack::GUARD_BYTES`] of the static variables, or ran into them.
    StackExhausted,
}

impl From<MeterError> for Fault {
    fn from(error: MeterError) -> Self {
        Self(match error {
            MeterError::CounterWrapped => {
                b"error the instruction counter wrapped: the work takes longer than it can count\n"
            }
            MeterError::StackExhausted => {
                b"error the stack is used up: it came within 1024 bytes of the static variables or ran into them\n"
            }
        })
    }
}

/// Counts the instructions of every stage of a cycle.
pub struct StageMeter {
    counter: Counter,
    ticks: [u32; STAGES],
    running: Option<(usize, u32)>,
    is_stack_free: bool,
}

impl Default for StageMeter {
    fn default() -> Self {
        Self { counter: Counter::start(), ticks: [0; STAGES], running: None, is_stack_free: true }
    }
}

impl StageMeter {
    /// Instructions of each stage, in the order of [`Stage`].
    ///
    /// # Errors
    /// The cycle was longer than the counter, or the stack is used up.
    #[inline(never)]
    pub fn per_stage(&self) -> Result<impl Iterator<Item = Instructions>, MeterError> {
        self.counter.ticks()?;
        if !self.is_stack_free {
            return Err(MeterError::StackExhausted);
        }
        stack::check_guard()?;
        Ok(self.ticks.iter().map(|ticks| Instructions::of(*ticks)))
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

impl<const SOURCES: usize, const PATHS: usize> Observer<SOURCES, PATHS> for StageMeter {
    fn stage(&mut self, stage: Stage) {
        // The guard cannot show a large stack frame of which nothing is written; the stack pointer can.
        self.is_stack_free &= stack::is_pointer_above_guard();
        let now = self.counter.elapsed();
        if let Some((stage, then)) = self.running
            && let Some(ticks) = self.ticks.get_mut(stage)
        {
            *ticks = ticks.wrapping_add(now.wrapping_sub(then));
        }
        self.running = index(stage).map(|stage| (stage, now));
    }
}
