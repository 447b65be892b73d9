//! The channel estimator alone on a Cortex-M4F: for every frame of a feed, the paths it finds and the instructions it
//! takes; at the end its size and the stack it used. `tests/on_target.sh` runs it in QEMU.

#![no_std]
#![no_main]

use cogmint_board::feed::Feed;
use cogmint_board::host::{self, Line};
use cogmint_board::meter::{StackMeter, instructions};
use cogmint_board::{FRAMES, SAMPLES};
use cogmint_core::observation::{Complex, Observation};
use cogmint_core::perceptor::channel_estimator::ChannelEstimator;
use cortex_m_rt::entry;

type Estimator = ChannelEstimator<16>;

#[entry]
fn main() -> ! {
    // SAFETY: see `Once`.
    let samples = unsafe { &mut *FRAMES.0.get() };
    let done = run(samples).is_some();
    if !done {
        host::write(b"error no feed, or a malformed one\n");
    }
    host::exit(done)
}

fn run(samples: &mut [Complex; SAMPLES]) -> Option<()> {
    let mut feed = Feed::open()?;
    let setup = feed.setup()?;
    let radio = setup.config.radio;
    let action = setup.actions.first()?;
    let pulse = radio.pulse(action);
    let estimator =
        Estimator::new(pulse, radio.sample_spacing_s, radio.samples_per_frame, radio.false_paths_per_frame);
    let mut deepest = 0;
    for _ in 0..setup.cycles {
        let input = feed.cycle(samples)?;
        for observation in &input.observations(samples) {
            let Observation::Frame(frame) = observation else { continue };
            let stack = StackMeter::paint();
            let (count, paths) = instructions(|| paths(&estimator, frame));
            deepest = deepest.max(stack.used());
            Line::new().text(b"frame ").decimal(paths).text(b" ").decimal(count).end();
        }
    }
    Line::new()
        .text(b"estimator ")
        .decimal(size_of::<Estimator>() as u32)
        .text(b" stack ")
        .decimal(deepest)
        .end();
    Some(())
}

/// How many paths a frame has. Its own stack frame, so that all scratch of the estimate lies below the painter.
#[inline(never)]
fn paths(estimator: &Estimator, frame: &cogmint_core::observation::Frame<'_>) -> u32 {
    estimator
        .estimate(frame.samples, frame.first_sample_delay_s)
        .map_or(0, |estimate| estimate.paths.len() as u32)
}
