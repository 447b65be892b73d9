//! The channel estimator alone on a Cortex-M4F: for every frame of a feed, the paths it finds and the instructions it
//! takes; at the end its size and the stack it used. `tests/on_target.sh` runs it in QEMU.

#![no_std]
#![no_main]

use cogmint_board::Once;
use cogmint_board::feed::Feed;
use cogmint_board::host::{self, Fault, Line};
use cogmint_board::meter::{Scratch, instructions};
use cogmint_core::model::observation::{Complex, Observation};
use cogmint_core::perceptor::channel_estimator::ChannelEstimator;
use core::cell::UnsafeCell;
use cortex_m_rt::entry;

type Estimator = ChannelEstimator<16>;

/// The samples of one cycle.
static FRAMES: Once<[Complex; 2 * 1024]> = Once(UnsafeCell::new([[0.0; 2]; 2 * 1024]));

#[entry]
fn main() -> ! {
    // SAFETY: see `Once`.
    let samples = unsafe { &mut *FRAMES.0.get() };
    host::end(run(samples))
}

fn run(samples: &mut [Complex]) -> Result<(), Fault> {
    let mut feed = Feed::open().ok_or(Fault::FEED)?;
    let setup = feed.setup::<2, 24, 32, 40>().ok_or(Fault::FEED)?;
    let radio = setup.config.radio;
    let action = setup.actions.first().ok_or(Fault::FEED)?;
    let pulse = radio.pulse(action);
    let estimator = Estimator::new(
        pulse,
        radio.sample_spacing_s,
        radio.samples_per_frame,
        radio.false_paths_per_frame,
        setup.config.estimator,
    );
    let mut deepest = 0;
    for _ in 0..setup.cycles {
        let input = feed.cycle::<2, 16>(samples).ok_or(Fault::FEED)?;
        for observation in &input.observations::<4>(samples) {
            let Observation::Frame(frame) = observation else { continue };
            let stack = Scratch::paint()?;
            let (count, paths) = instructions(|| paths(&estimator, frame))?;
            deepest = deepest.max(stack.used()?);
            Line::new().text(b"frame ").decimal(paths).text(b" ").instructions(count).end();
        }
    }
    Line::new()
        .text(b"estimator ")
        .decimal(size_of::<Estimator>() as u32)
        .text(b" stack ")
        .decimal(deepest)
        .end();
    Ok(())
}

/// How many paths a frame has. Its own stack frame, so that all scratch of the estimate lies below the painter.
#[inline(never)]
fn paths(estimator: &Estimator, frame: &cogmint_core::model::observation::Frame<'_>) -> u32 {
    estimator
        .estimate(frame.samples, frame.first_sample_delay_s)
        .map_or(0, |estimate| estimate.paths.len() as u32)
}
