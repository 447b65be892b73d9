//! The firmware's simulated radio on the host: the tracker chooses its channel, and the radio does what it is told. That the target has the
//! same bits is for `tests/radio_on_target.sh`.

use cogmint_core::{CycleError, CycleReport};
use cogmint_tests::simulated_radio::{BusFault, Defect, Event, RoomTracker, SimulatedRadio, run, start};

/// Every cycle with its hash and how far off it is, metres; and what stopped, with the cycle.
type Run = (Vec<(CycleReport, u64, f32)>, Vec<(u32, CycleError<BusFault>)>);

fn closed_loop(defect: Defect) -> Run {
    let mut tracker = Box::new(RoomTracker::new());
    start(&mut tracker).unwrap();
    let (mut cycles, mut stops) = (vec![], vec![]);
    run(&mut tracker, &mut SimulatedRadio::new(defect), |radio, event| match event {
        Event::Cycle(report, hash) => cycles.push((report, hash, radio.off_m(&report))),
        Event::Stop(cycle, error) => stops.push((cycle, error)),
    });
    (cycles, stops)
}

#[test]
fn the_tracker_leaves_a_channel_that_is_jammed_and_the_radio_follows() {
    let (cycles, stops) = closed_loop(Defect::None);
    assert!(stops.is_empty() && cycles.len() == 90);
    let jammed = cycles.iter().filter(|(report, ..)| match report.cycle {
        0..30 => false,
        30..60 => report.action == 0,
        _ => report.action == 1,
    });
    let jammed = jammed.count();
    assert!((2..12).contains(&jammed), "{jammed} of 60 cycles on the jammed channel");
    let worst_m = cycles.iter().skip(10).fold(0.0, |worst: f32, (_, _, off_m)| worst.max(*off_m));
    println!("{jammed} of 60 cycles on the jammed channel, {worst_m:.3} m off at most");
    assert!(worst_m < 0.3, "{worst_m} m");
}

#[test]
fn a_radio_that_ignores_its_tuning_shows_from_the_first_change_on() {
    let ((obeys, _), (stays, _)) = (closed_loop(Defect::None), closed_loop(Defect::Stays));
    let first = obeys.iter().position(|(report, ..)| report.action != 0).unwrap();
    let differs = obeys.iter().zip(&stays).position(|((_, one, _), (_, other, _))| one != other);
    assert_eq!(differs, Some(first));
}

#[test]
fn a_bus_that_fails_once_is_reported_and_costs_nothing_else() {
    let ((whole, _), (failed, stops)) = (closed_loop(Defect::None), closed_loop(Defect::FailsIn(37)));
    assert_eq!(stops, [(37, CycleError::Radio(BusFault))]);
    assert_eq!(whole, failed);
}
