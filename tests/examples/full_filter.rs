//! The state filter at full size on the host: writes the problem for the firmware's `filter`, and prints the hash over
//! all its bits after every step: `cargo run --release -p cogmint-tests --example full_filter -- FORM STEPS FEED`, where the
//! form is `published` (52 states) or `walls` (20).

use cogmint_tests::full_filter::{Problem, VAS, WALLS};
use std::process::ExitCode;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [form, steps, feed] = arguments.as_slice() else {
        eprintln!("full_filter: needs the form, the number of steps and the feed's file");
        return ExitCode::from(2);
    };
    let Ok(steps) = steps.parse() else {
        eprintln!("full_filter: the number of steps is no number: {steps}");
        return ExitCode::from(2);
    };
    let (problem, hashes) = match form.as_str() {
        "published" => {
            let problem = Problem::published(steps);
            let hashes = problem.hashes::<VAS>();
            (problem, hashes)
        }
        "walls" => {
            let problem = Problem::walls(steps);
            let hashes = problem.hashes::<WALLS>();
            (problem, hashes)
        }
        _ => {
            eprintln!("full_filter: unknown form {form} (known: published, walls)");
            return ExitCode::from(2);
        }
    };
    if let Err(error) = std::fs::write(feed, problem.feed()) {
        eprintln!("full_filter: {feed}: {error}");
        return ExitCode::FAILURE;
    }
    for (number, hash) in hashes.iter().enumerate() {
        println!("step {number} hash {hash:016x}");
    }
    ExitCode::SUCCESS
}
