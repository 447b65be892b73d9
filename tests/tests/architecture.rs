//! The core's modules are the diagram of docs/architecture.md: data goes through the blocks one way, no block names the
//! state of another, and only the entries change the whole tracker.

use cogmint_tests::architecture::{BLOCKS, Source, draw, faults, imports, sources};
use std::path::PathBuf;

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("..")
}

#[test]
fn data_goes_through_the_blocks_one_way_and_no_block_names_the_state_of_another() {
    let faults = faults(&sources(&root().join("core/src")).unwrap());
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn the_picture_is_drawn_from_the_modules() {
    let drawn = draw(&sources(&root().join("core/src")).unwrap());
    let kept = std::fs::read_to_string(root().join("docs/architecture.svg")).unwrap();
    assert!(
        drawn == kept,
        "run `cargo run --release --example architecture` and look at docs/architecture.svg"
    );
}

#[test]
fn every_block_has_a_paragraph() {
    let text = std::fs::read_to_string(root().join("docs/architecture.md")).unwrap();
    for block in BLOCKS {
        assert!(
            text.contains(&format!("`{}`", block.path)),
            "docs/architecture.md says nothing of {}",
            block.path
        );
    }
}

/// Violations of every kind, each planted alone.
#[test]
fn a_planted_violation_is_found() {
    let planted = [
        ("perceptor/expectation/mod", "use crate::controller::planning::Visible;", "comes after it"),
        ("perceptor/scan", "use super::association::Belief;", "comes after it"),
        ("model/motion", "fn f(x: crate::perceptor::scan::Scan<4>) {}", "comes after it"),
        ("memory/channel/observe", "use crate::config::Config;", "comes after it"),
        ("radio/pulse", "use crate::model::source::Source;", "comes after it"),
        (
            "controller/planning",
            "use crate::memory::channel::{self, ChannelMemory};",
            "names the state ChannelMemory",
        ),
        ("memory/clutter", "fn f(filter: &StateFilter<1, 1>) {}", "names the state StateFilter"),
        ("perceptor/association/exact", "fn f(g: GainControl) {}", "names the state GainControl"),
        ("tracker/stages", "impl T { fn hidden(&mut self, x: u32) {} }", "hidden changes the whole tracker"),
        ("tracker/state", "impl T { pub fn step(&mut self) {} }", "step changes the whole tracker"),
        (
            "tracker/stages",
            "fn f(tracker: &mut Tracker<1, 1, 1, 1, 1, 1, 1, 1, 1>) {}",
            "takes the whole tracker",
        ),
        ("perceptor/scan", "use crate::Config;", "comes after it"),
        ("model/motion", "fn f(t: &crate::Tracker<1, 1, 1, 1, 1, 1, 1, 1, 1>) {}", "names the state Tracker"),
        ("memory/clutter", "use crate::memory::channel::*;", "comes after it"),
        ("utils", "", "is in no block"),
    ];
    for (path, code, fault) in planted {
        let found = faults(&[Source::new(path, code)]);
        assert!(found.iter().any(|found| found.contains(fault)), "{path}: {code}: {found:?}");
    }
    // What is said in comments and tests breaks nothing.
    let quiet = "// ChannelMemory\nfn f() {}\n#[cfg(test)]\nmod tests { use crate::tracker::Tracker; }";
    assert!(faults(&[Source::new("perceptor/scan", quiet)]).is_empty());
    let shared = quiet.replace("mod tests", "pub(super) mod tests");
    assert!(faults(&[Source::new("perceptor/scan", &shared)]).is_empty());
}

#[test]
fn imports_are_resolved() {
    let code = "use super::scan::{Scan, FrameLevel as Level};\nuse crate::{model::source::Source, real};\nuse self::overlap::Overlap;\nuse heapless::Vec;";
    let found = imports(&Source::new("perceptor/expectation/mod", code));
    let expected = [
        "model/source/Source",
        "perceptor/expectation/overlap/Overlap",
        "perceptor/scan/FrameLevel",
        "perceptor/scan/Scan",
        "real",
    ];
    assert_eq!(found.into_iter().collect::<Vec<_>>(), expected);
}
