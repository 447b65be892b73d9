//! Incidents: what happens to an anchor or to the radio in a room besides what rooms draw, without any tracker being told.
//!
//! They change the recording, after the room was simulated; which anchor, which way and when follows from the room's seed.

use super::RandomRoom;
use super::draws::{Aspect, Draws};
use crate::channel::SPEED_OF_LIGHT_M_S;
use crate::geometry::distance_m;
use crate::input_error::InputError;
use crate::recording::{Cycle, Recording};
use crate::simulator::Simulator;
use serde::Serialize;

/// How far off an anchor is told to be, metres.
const OFF_M: f64 = 3.0;
/// How fast the clock of an anchor drifts, metres of range per second.
const DRIFT_M_S: f64 = 0.1;
/// How far an anchor is moved, metres.
const MOVED_M: f64 = 2.0;
/// How long nothing of the tag is heard, seconds; on a short way a quarter of it.
const UNHEARD_S: f64 = 10.0;
/// Least by which clutter is later than what the anchor sent, metres.
const CLUTTER_M: f64 = 1.0;
/// When that begins, as a share of the way.
const UNHEARD_FROM: f64 = 0.4;
/// Between which shares of the way a tag is carried off: it goes on at the place between them that is farthest.
const CARRIED: [f64; 2] = [0.4, 0.75];
/// How long that takes, seconds: the logarithm is uniform.
const CARRIED_S: [f64; 2] = [1.0, 3600.0];

/// What happens.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Incident {
    /// An anchor is 3 m from where it is told to be.
    AnchorOff,
    /// The ranges of an anchor grow by 0.1 m/s.
    AnchorDrifting,
    /// An anchor is moved by 2 m half-way.
    AnchorMoved,
    /// No frame arrives for 10 s (at most a quarter of the way).
    Silence,
    /// For as long, the frames show clutter: those of other places, later by 1 m up to half of the longest range.
    Clutter,
    /// The tag is carried to another place of its way, in 1 s to 1 h without any frame.
    Carried,
}

impl Incident {
    /// All of them.
    pub const ALL: [Incident; 6] = [
        Incident::AnchorOff,
        Incident::AnchorDrifting,
        Incident::AnchorMoved,
        Incident::Silence,
        Incident::Clutter,
        Incident::Carried,
    ];

    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Incident::AnchorOff => "anchor-off",
            Incident::AnchorDrifting => "anchor-drifting",
            Incident::AnchorMoved => "anchor-moved",
            Incident::Silence => "silence",
            Incident::Clutter => "clutter",
            Incident::Carried => "carried",
        }
    }

    /// Changes the recording of a room, of at least one cycle. Returns from when to when nothing of the tag is heard, seconds on
    /// the recording's clock, where that is so.
    ///
    /// # Errors
    /// The room cannot be simulated with the anchor elsewhere.
    pub fn befall(
        self,
        room: &RandomRoom,
        recording: &mut Recording,
    ) -> Result<Option<[f64; 2]>, InputError> {
        let mut draws = Draws::new(room.drawn.seed, Aspect::Incident);
        let anchor = draws.below(recording.anchors.len().max(1));
        let Some([first_s, last_s]) =
            recording.cycles.first().zip(recording.cycles.last()).map(|(a, b)| [a.time_s, b.time_s])
        else {
            return Ok(None);
        };
        match self {
            Incident::AnchorOff => {
                if let Some(anchor) = recording.anchors.get_mut(anchor) {
                    anchor.position_m = beside(anchor.position_m, OFF_M, draws.uniform(0.0, 1.0));
                }
                Ok(None)
            }
            Incident::AnchorDrifting => {
                let longest_m = recording.association.max_range_m;
                for cycle in &mut recording.cycles {
                    let drift_s = DRIFT_M_S * (cycle.time_s - first_s) / SPEED_OF_LIGHT_M_S;
                    for frame in cycle.frames.iter_mut().filter(|frame| frame.anchor == anchor) {
                        frame.first_sample_delay_s += drift_s;
                    }
                    leave_out_beyond(cycle, longest_m);
                    for path in cycle.truth_paths.iter_mut().filter(|path| path.anchor == anchor) {
                        path.delay_s += drift_s;
                    }
                }
                Ok(None)
            }
            Incident::AnchorMoved => {
                let elsewhere = moved(room, anchor, &mut draws)?;
                let from_s = 0.5 * (first_s + last_s);
                for (cycle, other) in recording.cycles.iter_mut().zip(elsewhere.cycles) {
                    if cycle.time_s >= from_s {
                        replace(cycle, other, anchor);
                    }
                }
                Ok(None)
            }
            Incident::Silence | Incident::Clutter => {
                let from_s = first_s + UNHEARD_FROM * (last_s - first_s);
                let window_s = [from_s, from_s + UNHEARD_S.min(0.25 * (last_s - first_s))];
                if self == Incident::Silence {
                    for cycle in within(&mut recording.cycles, window_s) {
                        cycle.frames.clear();
                        cycle.truth_paths.clear();
                    }
                } else {
                    clutter(recording, window_s, &mut draws);
                }
                Ok(Some(window_s))
            }
            Incident::Carried => Ok(carry(&mut recording.cycles, &mut draws)),
        }
    }
}

/// A place so far from another one; `turn` (0 to 1) says in which direction.
fn beside([x, y]: [f64; 2], distance_m: f64, turn: f64) -> [f64; 2] {
    let angle = std::f64::consts::TAU * turn;
    [x + distance_m * libm::cos(angle), y + distance_m * libm::sin(angle)]
}

/// The cycles of a window.
fn within(cycles: &mut [Cycle], [from_s, to_s]: [f64; 2]) -> impl Iterator<Item = &mut Cycle> {
    cycles.iter_mut().filter(move |cycle| (from_s..to_s).contains(&cycle.time_s))
}

/// The room as it would have been recorded with an anchor elsewhere, in a direction in which it can stand.
fn moved(room: &RandomRoom, anchor: usize, draws: &mut Draws) -> Result<Recording, InputError> {
    let first = draws.uniform(0.0, 1.0);
    let directions = 16;
    let mut refused = None;
    for direction in 0..directions {
        let mut scenario = room.scenario.clone();
        if let Some(own) = scenario.anchors.get_mut(anchor) {
            own.position_m =
                beside(own.position_m, MOVED_M, first + f64::from(direction) / f64::from(directions));
        }
        match Simulator::new(&scenario, None, 0, None) {
            Ok(simulator) => return Ok(simulator.record(usize::MAX, || {})),
            Err(error) => refused = Some(error),
        }
    }
    // Sixteen were tried.
    Err(refused.unwrap_or_else(|| InputError::new("", "has no place for the anchor")))
}

/// What an anchor sent in one cycle takes the place of what it sent in another. Its true paths are no longer known.
fn replace(cycle: &mut Cycle, other: Cycle, anchor: usize) {
    cycle.frames.retain(|frame| frame.anchor != anchor);
    cycle.frames.extend(other.frames.into_iter().filter(|frame| frame.anchor == anchor));
    cycle.frames.sort_by_key(|frame| frame.anchor);
    cycle.truth_paths.retain(|path| path.anchor != anchor);
}

/// A frame that begins beyond the longest range is none: the tracker would refuse the whole cycle.
pub(super) fn leave_out_beyond(cycle: &mut Cycle, longest_m: f64) {
    cycle.frames.retain(|frame| SPEED_OF_LIGHT_M_S * frame.first_sample_delay_s < longest_m);
}

/// In a window, every frame shows what its anchor sent at some other time, later by [`CLUTTER_M`] up to half of the longest range.
fn clutter(recording: &mut Recording, window_s: [f64; 2], draws: &mut Draws) {
    let before = recording.cycles.clone();
    let longest_m = recording.association.max_range_m;
    for cycle in within(&mut recording.cycles, window_s) {
        let time_s = cycle.time_s;
        for frame in &mut cycle.frames {
            let others: Vec<_> = (before.iter().filter(|other| other.time_s != time_s))
                .flat_map(|other| other.frames.iter().filter(|other| other.anchor == frame.anchor))
                .collect();
            let shift_s = draws.uniform(CLUTTER_M / SPEED_OF_LIGHT_M_S, 0.5 * longest_m / SPEED_OF_LIGHT_M_S);
            if !others.is_empty() {
                *frame = others[draws.below(others.len())].clone();
            }
            frame.first_sample_delay_s += shift_s;
        }
        leave_out_beyond(cycle, longest_m);
        cycle.truth_paths.clear();
    }
}

/// Leaves a part of the way out, in which time passes. Returns when that was.
fn carry(cycles: &mut Vec<Cycle>, draws: &mut Draws) -> Option<[f64; 2]> {
    let at = |share: f64| (share * cycles.len() as f64) as usize;
    let (from, to) = (at(CARRIED[0]), at(CARRIED[1]));
    let gap_s = draws.log_uniform(CARRIED_S[0], CARRIED_S[1]);
    let last = cycles.get(from)?;
    let (last_s, last_m) = (last.time_s, last.truth_position_m?);
    let far = |cycle: &Cycle| cycle.truth_position_m.map_or(0.0, |place_m| distance_m(place_m, last_m));
    let next = (from + 1..to).max_by(|&a, &b| far(&cycles[a]).total_cmp(&far(&cycles[b])))?;
    let later_s = last_s + gap_s - cycles[next].time_s;
    cycles.drain(from + 1..next);
    for cycle in &mut cycles[from + 1..] {
        cycle.time_s += later_s;
    }
    // There is no cycle in between; the first one after it is the first in which the tag can be found.
    let found_s = cycles[from + 1].time_s;
    Some([found_s, found_s])
}

#[cfg(test)]
mod tests {
    use super::super::{Restriction, room};
    use super::*;

    /// A room with two anchors or more and its recording of some cycles, before and after an incident.
    fn befallen(incident: Incident) -> (RandomRoom, Recording, Recording, Option<[f64; 2]>) {
        let rooms = (1..50).map(|seed| room(seed, &Restriction::default()).unwrap());
        let mut room = rooms.into_iter().find(|room| room.drawn.anchors >= 2).unwrap();
        room.scenario.trajectories[0].cycles = Some(60);
        let before = Simulator::new(&room.scenario, None, 0, None).unwrap().record(usize::MAX, || {});
        let mut after = before.clone();
        let window_s = incident.befall(&room, &mut after).unwrap();
        (room, before, after, window_s)
    }

    #[test]
    fn one_anchor_is_off_drifts_or_moves_and_all_else_stays() {
        let (_, before, after, _) = befallen(Incident::AnchorOff);
        let off: Vec<f64> = (before.anchors.iter().zip(&after.anchors))
            .map(|(a, b)| distance_m(a.position_m, b.position_m))
            .collect();
        assert_eq!(off.iter().filter(|off| (**off - OFF_M).abs() < 1e-9).count(), 1, "{off:?}");
        assert_eq!(
            (off.iter().filter(|off| **off == 0.0).count(), &before.cycles),
            (off.len() - 1, &after.cycles)
        );

        let (_, before, after, _) = befallen(Incident::AnchorDrifting);
        let mut drifted = std::collections::BTreeSet::new();
        let first_s = before.cycles[0].time_s;
        for (before, after) in before.cycles.iter().zip(&after.cycles) {
            let drift_m = DRIFT_M_S * (before.time_s - first_s);
            for (a, b) in before.frames.iter().zip(&after.frames) {
                let own_m = SPEED_OF_LIGHT_M_S * (b.first_sample_delay_s - a.first_sample_delay_s);
                if own_m != 0.0 {
                    drifted.insert(a.anchor);
                    assert!((own_m - drift_m).abs() < 1e-6, "{own_m} {drift_m}");
                }
                assert_eq!(a.samples, b.samples);
            }
        }
        assert_eq!(drifted.len(), 1);

        let (_, before, after, _) = befallen(Incident::AnchorMoved);
        let mut changed = std::collections::BTreeSet::new();
        for (index, (before, after)) in before.cycles.iter().zip(&after.cycles).enumerate() {
            for (a, b) in before.frames.iter().zip(&after.frames).filter(|(a, b)| a != b) {
                assert!(a.anchor == b.anchor && index >= 29, "{index}");
                changed.insert(a.anchor);
            }
        }
        assert_eq!(changed.len(), 1);
    }

    #[test]
    fn nothing_of_the_tag_is_heard_in_a_window() {
        for incident in [Incident::Silence, Incident::Clutter] {
            let (_, before, after, window_s) = befallen(incident);
            let [from_s, to_s] = window_s.unwrap();
            let way_s = before.cycles[59].time_s - before.cycles[0].time_s;
            assert!((to_s - from_s - UNHEARD_S.min(0.25 * way_s)).abs() < 1e-9);
            for (before, after) in before.cycles.iter().zip(&after.cycles) {
                let is_inside = (from_s..to_s).contains(&before.time_s);
                let frames = before.frames.len();
                match (is_inside, incident) {
                    (false, _) => assert_eq!(before, after),
                    (true, Incident::Silence) => assert!(after.frames.is_empty()),
                    (true, _) => {
                        assert_eq!(after.frames.len(), frames);
                        assert!(before.frames.iter().zip(&after.frames).all(|(a, b)| a != b));
                    }
                }
                assert_eq!(before.truth_position_m, after.truth_position_m);
            }
        }
    }

    #[test]
    fn a_tag_is_carried_to_the_farthest_place_ahead_and_time_goes_on() {
        let (_, before, after, window_s) = befallen(Incident::Carried);
        let [from_s, to_s] = window_s.unwrap();
        assert_eq!((from_s, to_s), (after.cycles[25].time_s, after.cycles[25].time_s));
        let gap_s = after.cycles[25].time_s - after.cycles[24].time_s;
        assert!((CARRIED_S[0] - 1e-6..=CARRIED_S[1] + 1e-6).contains(&gap_s));
        assert_eq!(before.cycles[..25], after.cycles[..25]);
        let place_m = |cycle: &Cycle| cycle.truth_position_m.unwrap();
        let far = |cycle: &Cycle| distance_m(place_m(cycle), place_m(&before.cycles[24]));
        let farthest = before.cycles[25..45].iter().map(far).fold(0.0, f64::max);
        assert!((far(&after.cycles[25]) - farthest).abs() < 1e-9);
        assert!(after.cycles.windows(2).all(|pair| pair[0].time_s < pair[1].time_s));
    }

    #[test]
    fn what_drifts_beyond_the_longest_range_is_left_out_and_the_other_anchors_stay() {
        let (room, mut recording, ..) = befallen(Incident::AnchorOff);
        // A day later.
        recording.cycles.iter_mut().skip(1).for_each(|cycle| cycle.time_s += 86_400.0);
        let before = recording.clone();
        Incident::AnchorDrifting.befall(&room, &mut recording).unwrap();
        let anchors = |cycle: &Cycle| cycle.frames.iter().map(|frame| frame.anchor).collect::<Vec<_>>();
        let missing = before.cycles.iter().zip(&recording.cycles).skip(1).flat_map(|(before, after)| {
            let left = anchors(after);
            anchors(before).into_iter().filter(move |anchor| !left.contains(anchor))
        });
        let missing: std::collections::BTreeSet<usize> = missing.collect();
        assert_eq!(missing.len(), 1);
    }
}
