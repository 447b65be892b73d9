//! Published claims, as far as the built-in room shows them.

use cogmint::demo;
use cogmint::room::Room;

/// "Under interference the fixed carrier diverges and the cognitive one moves away from it": the mean over several
/// rooms, because one room may be lucky.
#[test]
fn under_interference_the_cognitive_tracker_moves_away_and_survives() {
    for seed in 1..=4 {
        let room = Room::new(seed, 500);
        let [from, to] = room.interfered();
        let [fixed, cognitive] = [false, true].map(|choose| demo::run(&room, choose, seed, || {}).unwrap());
        assert!(fixed.score.diverged, "seed {seed}: the interferer must be worth avoiding");
        let rmse = cognitive.score.rmse_m.unwrap();
        assert!(!cognitive.score.diverged && rmse < 0.1, "seed {seed}: {rmse} m");
        let carrier = |n: usize| f64::from(cognitive.steps[n].report.next.carrier_hz);
        let late = (from + to) / 2..to;
        let far = late.clone().filter(|&n| (carrier(n) - 7e9).abs() > 1.2e9).count();
        assert!(far * 10 > late.len() * 8, "seed {seed}: {far} of {} cycles away from 7 GHz", late.len());
    }
}

#[test]
fn before_the_interference_both_reach_centimetres() {
    let room = Room::new(2, 300);
    let until = room.interfered()[0];
    for choose in [false, true] {
        let run = demo::run(&room, choose, 2, || {}).unwrap();
        let settled = &run.errors_m[20..until];
        let rmse = (settled.iter().map(|e| e * e).sum::<f64>() / settled.len() as f64).sqrt();
        assert!(rmse < 0.02, "{}: {rmse} m", run.name);
    }
}
