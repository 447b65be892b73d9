//! Feeds the channel estimator and the tracker frames that no radio should deliver, on all cores:
//! `cargo run --release -p cogmint-tests --example fuzz_estimator -- 1000000`. A wrong answer ends it, naming the frame.

use cogmint_tests::estimator_fuzz::{BATCH, Tally, batch};
use rayon::prelude::*;

fn main() {
    let frames = match std::env::args().nth(1).map(|frames| frames.parse::<u64>()) {
        None => 1_000_000,
        Some(Ok(frames)) => frames,
        Some(Err(error)) => {
            eprintln!("the number of frames: {error}");
            std::process::exit(2);
        }
    };
    let tally = (0..frames.div_ceil(BATCH)).into_par_iter().map(batch).reduce(Tally::default, Tally::with);
    println!(
        "{} frames estimated, {} refused; {} cycles, of which {} refused; slowest estimate {:.1} ms",
        tally.frames,
        tally.refused,
        tally.cycles,
        tally.refused_cycles,
        1e3 * tally.slowest.as_secs_f64()
    );
    println!("{:<16} {:<10} {:>8} {:>12} {:>10}", "shape", "mode", "frames", "paths/frame", "all filled");
    for ((shape, magnitude), [frames, paths, filled]) in &tally.shapes {
        println!(
            "{:<16} {:<10} {frames:>8} {:>12.3} {:>8.1} %",
            format!("{shape:?}"),
            if *magnitude { "magnitude" } else { "complex" },
            *paths as f64 / *frames as f64,
            100.0 * *filled as f64 / *frames as f64
        );
    }
}
