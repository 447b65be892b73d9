//! Planning alone on a Cortex-M4F at full size: 20 of 40 actions, two physical and 24 virtual anchors. For every horizon,
//! the hash over all rewards, the instructions and the stack. `tests/on_target.sh` runs it in QEMU, on the feed that
//! `tests/src/full_plan.rs` describes.

#![no_std]
#![no_main]

use cogmint_board::Once;
use cogmint_board::host::{self, Fault, File, Line};
use cogmint_board::meter::{Instructions, MeterError, Scratch, instructions};
use cogmint_core::Config;
use cogmint_core::config::Radio;
use cogmint_core::controller::planning::{Horizon, LONGEST_HORIZON, Planner, PlanningState, Visible};
use cogmint_core::controller::reward::Reward;
use cogmint_core::information::fisher::PositionInformation;
use cogmint_core::memory::channel::{ChannelMemory, ChannelMemorySettings};
use cogmint_core::model::motion::Motion;
use cogmint_core::model::source::Source;
use cogmint_core::nalgebra::{Matrix2, Matrix4};
use cogmint_core::radio::library::{LIBRARY_WIDE, Library};
use cogmint_core::radio::pulse::PulseShape;
use cogmint_core::trace::TraceHash;
use core::cell::UnsafeCell;
use core::mem::MaybeUninit;
use cortex_m_rt::entry;
use heapless::Vec;

const ANCHORS: usize = 2;
const VAS: usize = 24;
const SOURCES: usize = ANCHORS + VAS;
const ACTIONS: usize = 40;
const HORIZONS: [usize; 2] = [1, 5];
const MAGIC: [u8; 4] = *b"COGP";

type Memory = ChannelMemory<ANCHORS, VAS, ACTIONS>;

static MEMORY: Once<MaybeUninit<Memory>> = Once(UnsafeCell::new(MaybeUninit::uninit()));

#[entry]
fn main() -> ! {
    // SAFETY: see `Once`.
    let slot = unsafe { &mut *MEMORY.0.get() };
    host::end(run(slot))
}

fn float(feed: &mut File) -> Result<f32, Fault> {
    let mut bytes = [0; 4];
    feed.read(&mut bytes).then(|| f32::from_le_bytes(bytes)).ok_or(Fault::FEED)
}

fn run(slot: &mut MaybeUninit<Memory>) -> Result<(), Fault> {
    let mut feed = File::open_feed().ok_or(Fault::FEED)?;
    let mut magic = [0; 4];
    if !feed.read(&mut magic) || magic != MAGIC {
        return Err(Fault::FEED);
    }
    let outlook = outlook(&mut feed)?;
    let library = Library::<ACTIONS>::new(&LIBRARY_WIDE).map_err(|_| Fault(b"error refused library\n"))?;
    let memory = slot.write(Memory::new(ChannelMemorySettings::default(), 10.0, true, &library));
    let mut visible: Vec<Visible, SOURCES> = Vec::new();
    for index in 0..SOURCES {
        let source = match index.checked_sub(ANCHORS) {
            None => Source::Direct { anchor: index },
            Some(slot) => Source::Virtual { anchor: slot % ANCHORS, slot },
        };
        let position_m = [float(&mut feed)?, float(&mut feed)?];
        let (xx, yx, yy) = (float(&mut feed)?, float(&mut feed)?, float(&mut feed)?);
        let mut sinr = [0.0; ACTIONS];
        for sinr in &mut sinr {
            *sinr = float(&mut feed)?;
        }
        memory.tell(source, &sinr);
        let covariance_m2 = Matrix2::new(xx, yx, yx, yy);
        // As many places as sources.
        let _ = visible.push(Visible { source, position_m, height_m: 0.0, covariance_m2, availability: 1.0 });
    }
    for steps in HORIZONS {
        let stack = Scratch::paint()?;
        let (count, hash) = measure(steps, &outlook, &visible, memory, &library)?;
        let deepest = stack.used()?;
        let mut line = Line::new();
        line.text(b"horizon ").decimal(steps as u32).text(b" hash ").hex(hash);
        line.text(b" ").instructions(count).text(b" stack ").decimal(deepest);
        line.end();
    }
    Ok(())
}

fn outlook(feed: &mut File) -> Result<PlanningState, Fault> {
    let mut floats = [0.0; 14];
    for place in &mut floats {
        *place = float(feed)?;
    }
    let [x, y, u, v, xx, yy, uu, vv, elapsed_s, acceleration_density_m2_s3, ..] = floats;
    let [.., variance_inflation, range_floor_m, roll_off, threshold] = floats;
    Ok(PlanningState {
        position_m: [x, y],
        velocity_m_s: [u, v],
        covariance: Matrix4::new(xx, 0.0, 0.0, 0.0, 0.0, yy, 0.0, 0.0, 0.0, 0.0, uu, 0.0, 0.0, 0.0, 0.0, vv),
        elapsed_s,
        motion: Motion {
            acceleration_density_m2_s3,
            velocity_decay_s: f32::INFINITY,
            ..Config::default().motion
        },
        variance_inflation,
        range_floor_m,
        range_floor_pulses: 0.0,
        radio: Radio { pulse_shape: PulseShape::RootRaisedCosine { roll_off }, ..Config::default().radio },
        threshold,
    })
}

/// One plan: its instructions, and the hash over its rewards. Its own stack frame, so that all scratch lies below the
/// painter.
#[inline(never)]
fn measure(
    steps: usize,
    outlook: &PlanningState,
    visible: &Vec<Visible, SOURCES>,
    memory: &Memory,
    library: &Library<ACTIONS>,
) -> Result<(Instructions, u64), MeterError> {
    let mut planned = [false; ACTIONS];
    planned.iter_mut().step_by(2).for_each(|wanted| *wanted = true);
    let horizon = Horizon { steps, discount: 0.5, reward: Reward::InformationGain };
    let given = [PositionInformation::default(); LONGEST_HORIZON];
    let (count, rewards) = instructions(|| {
        Planner::new(horizon, outlook, memory, library).plan(&planned, visible.iter().copied(), &given)
    })?;
    let mut hash = TraceHash::default();
    rewards.iter().for_each(|reward| hash.float(*reward));
    Ok((count, hash.value()))
}
