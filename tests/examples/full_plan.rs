//! Planning at full size on the host: writes the problem for the firmware's `planning`, and prints the hash over all
//! rewards of every horizon: `cargo run --release -p cogmint-tests --example full_plan -- FEED`.

use cogmint_tests::full_plan::{HORIZONS, Problem};
use std::process::ExitCode;

fn main() -> ExitCode {
    let Some(feed) = std::env::args().nth(1) else {
        eprintln!("full_plan: needs the feed's file");
        return ExitCode::from(2);
    };
    let problem = Problem::new();
    if let Err(error) = std::fs::write(&feed, problem.feed()) {
        eprintln!("full_plan: {feed}: {error}");
        return ExitCode::FAILURE;
    }
    for steps in HORIZONS {
        println!("horizon {steps} hash {:016x}", problem.hash(steps));
    }
    ExitCode::SUCCESS
}
