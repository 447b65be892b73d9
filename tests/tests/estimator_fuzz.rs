//! Frames that no radio should deliver: the first few of what `--example fuzz_estimator` runs through.

use cogmint_tests::estimator_fuzz::{BATCH, Tally, batch};

#[test]
fn frames_of_all_kinds_get_a_typed_error_or_finite_paths() {
    let tally = (0..100).map(batch).fold(Tally::default(), Tally::with);
    assert_eq!(tally.frames + tally.refused, 100 * BATCH);
    assert!(tally.refused > 100 && tally.cycles > 1000 && tally.refused_cycles > 100);
}
