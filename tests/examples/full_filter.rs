//! The state filter at full size on the host: writes the problem for the firmware's `filter`, and prints the hash over
//! all its bits after every step: `cargo run --release -p cogmint-tests --example full_filter -- STEPS FEED`.

use cogmint_tests::full_filter::{Problem, hash, step};
use std::process::ExitCode;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [steps, feed] = arguments.as_slice() else {
        eprintln!("full_filter: needs the number of steps and the feed's file");
        return ExitCode::from(2);
    };
    let Ok(steps) = steps.parse() else {
        eprintln!("full_filter: the number of steps is no number: {steps}");
        return ExitCode::from(2);
    };
    let problem = Problem::new(steps);
    if let Err(error) = std::fs::write(feed, problem.feed()) {
        eprintln!("full_filter: {feed}: {error}");
        return ExitCode::FAILURE;
    }
    let mut filter = problem.filter();
    for (number, ranges) in problem.ranges_m.iter().enumerate() {
        step(&mut filter, ranges);
        println!("step {number} hash {:016x}", hash(&filter));
    }
    ExitCode::SUCCESS
}
