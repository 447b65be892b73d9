//! Published claims, as far as the seminar room shows them.

use cogmint::demo;
use cogmint::replay::Setup;
use cogmint::simulator::Simulator;
use cogmint::track::track_setup;
use std::path::Path;

/// Errors of the fixed carrier, metres, where frames are read no further than to their paths.
fn fixed_as_published(room: &Simulator, seed: u64) -> Vec<f64> {
    let first_action = room.channel().receiver().first_action;
    let mut recording = room.before();
    recording.cycles.extend((0..room.cycles()).map(|cycle| room.cycle(cycle, first_action)));
    let file = Path::new("the seminar room");
    let mut setup = Setup::new(&recording, file, Some(seed)).unwrap();
    setup.config.controller.planned_actions = 0;
    setup.config.belief.reads_below_threshold = false;
    let track = track_setup(&setup, &recording, file, || {}).unwrap();
    track.errors_m.into_iter().map(|(_, error_m)| error_m).collect()
}

/// "Under interference the fixed carrier diverges and the cognitive one moves away from it": several seeds, because
/// one may be lucky. What is read below the threshold keeps the tag on the jammed carrier too, to decimetres.
#[test]
fn under_interference_the_cognitive_tracker_moves_away_and_survives() {
    for seed in 1..=4 {
        let room = demo::seminar_room(seed, 1000).unwrap();
        let [from, to] = demo::interfered(&room);
        let [fixed, cognitive] = [false, true].map(|choose| demo::run(&room, choose, seed, || {}).unwrap());
        let rms =
            |errors_m: &[f64]| (errors_m.iter().map(|e| e * e).sum::<f64>() / errors_m.len() as f64).sqrt();
        let [jammed_m, avoided_m] = [&fixed, &cognitive].map(|run| rms(&run.errors_m[from..to]));
        println!("seed {seed}: under interference {jammed_m} m on the fixed carrier, {avoided_m} m");
        assert!(
            jammed_m > 4.0 * avoided_m,
            "seed {seed}: the interferer must be worth avoiding, {jammed_m} m"
        );
        let lost_m = fixed_as_published(&room, seed).into_iter().skip(from).fold(0.0, f64::max);
        assert!(lost_m > 2.0, "seed {seed}: the fixed carrier as published must lose the tag, {lost_m} m");
        let rmse = cognitive.score.rmse_m.unwrap();
        assert!(!cognitive.score.diverged && rmse < 0.05, "seed {seed}: {rmse} m");
        let carrier = |n: usize| f64::from(cognitive.steps[n].report.next.carrier_hz);
        let late = (from + to) / 2..to;
        let far = late.clone().filter(|&n| (carrier(n) - 7e9).abs() > 1.2e9).count();
        assert!(far * 10 > late.len() * 8, "seed {seed}: {far} of {} cycles away from 7 GHz", late.len());
    }
}

#[test]
fn before_the_interference_both_reach_centimetres() {
    let room = demo::seminar_room(2, 400).unwrap();
    let until = demo::interfered(&room)[0];
    for choose in [false, true] {
        let run = demo::run(&room, choose, 2, || {}).unwrap();
        let settled = &run.errors_m[20..until];
        let rmse = (settled.iter().map(|e| e * e).sum::<f64>() / settled.len() as f64).sqrt();
        assert!(rmse < 0.02, "{}: {rmse} m", run.name);
    }
}
