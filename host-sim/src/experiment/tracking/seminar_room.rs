//! The built-in seminar room with its frames, and what makes it easier or harder: frequency-flat walls, one anchor, a
//! floor plan that is wrong, frames lost, a start that nobody knows.
//!
//! No interference; white noise and dense multipath as the scenario has them; the first carrier throughout. Seed 1 goes
//! the scenario's first way, seed 2 its second, and so on round.

use super::figures::AgainstBound;
use crate::bound::frame_information;
use crate::bound::posterior::Posterior;
use crate::channel::random::{Purpose, stream};
use crate::input_error::InputError;
use crate::recording::Recording;
use crate::scenario::{Construction, InnerWall, Part, Room, Scenario, Way};
use crate::simulator::Simulator;
use crate::track::Track;
use rand_core::Rng;

const SCENARIO: &str = "seminar-room";
/// How far every wall of a wrong plan is off, metres.
const WALLS_OFF_M: f64 = 0.3;
/// The part of the way without frames: 3 of 1000 cycles of 1 s.
const GAP: Part = Part([0.5, 0.503]);
/// Middle of the room, metres, and a deviation per axis that reaches its corners at two of them.
const ROOM_MIDDLE_M: [f64; 2] = [2.73, 4.27];
const ROOM_STD_M: f64 = 2.5;

/// What the tracker is told of the virtual anchors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Plan {
    /// Each just where it is, with this deviation, metres.
    Exact(f64),
    /// Each off at random by 0.1 m per axis, those of second order by 0.2 m; the tracker knows how much.
    Rough,
    /// As `Rough`, and every wall 0.3 m too far out or in, by a sign of its own that the seed draws.
    WallsOff,
    /// As `Rough`, and without one of the walls, which the seed says.
    WallMissing,
    /// As `Rough`, and with a wall across the room that is not there.
    WallAdded,
}

/// A kind of run through the room.
#[derive(Clone, Debug, PartialEq)]
pub struct SeminarRoom {
    /// Whether all walls reflect the same at every frequency, without shifting delays; else layers, as built in.
    pub walls_flat: bool,
    /// Whether only the first anchor is there.
    pub one_anchor: bool,
    /// What the tracker is told.
    pub plan: Plan,
    /// Probability that a frame is lost.
    pub loss_probability: f64,
    /// Whether nothing arrives for 3 s in the middle.
    pub gap: bool,
    /// Whether the start may be at either end of the way and the tracker knows no more than the room.
    pub start_unknown: bool,
}

impl SeminarRoom {
    /// With layered walls and a plan, two anchors, all frames.
    pub fn with(plan: Plan) -> Self {
        Self {
            walls_flat: false,
            one_anchor: false,
            plan,
            loss_probability: 0.0,
            gap: false,
            start_unknown: false,
        }
    }

    /// The scenario as a user would write it, for a seed.
    ///
    /// # Errors
    /// None: the scenario is built in.
    pub fn scenario(&self, seed: u64) -> Result<Scenario, InputError> {
        let (mut scenario, _) = Scenario::find(SCENARIO)?;
        scenario.seed = seed;
        if self.walls_flat {
            scenario.room.construction = "flat".into();
            scenario.room.sides = Vec::new();
        }
        if self.one_anchor {
            scenario.anchors.truncate(1);
        }
        scenario.lost_frames.probability = self.loss_probability;
        if self.gap {
            scenario.lost_frames.gaps = vec![GAP];
        }
        if self.start_unknown {
            scenario.prior.position_m = Some(ROOM_MIDDLE_M);
            scenario.prior.position_std_m = ROOM_STD_M;
            // The mean is the room's middle whatever the seed.
            scenario.prior.disc_radius_m = 1e-3;
            let ways = scenario.trajectories.len() as u64;
            if seed.wrapping_sub(1) / ways % 2 == 1 {
                for trajectory in &mut scenario.trajectories {
                    if let Way::Polyline { vertices_m, .. } = &mut trajectory.way {
                        vertices_m.reverse();
                    }
                }
            }
        }
        self.tell(&mut scenario, seed);
        Ok(scenario)
    }

    fn tell(&self, scenario: &mut Scenario, seed: u64) {
        let floor_plan = &mut scenario.prior.floor_plan;
        let mut rng = stream(seed, Purpose::Experiment, &[700]);
        match self.plan {
            Plan::Rough => {}
            Plan::Exact(std_m) => {
                floor_plan.exact = true;
                floor_plan.first_order_std_m = std_m;
                floor_plan.higher_order_std_m = std_m;
            }
            Plan::WallsOff => {
                floor_plan.room = Some(walls_off(&scenario.room, || rng.next_u32() & 1 == 1));
            }
            Plan::WallMissing => {
                let mut room = scenario.room.clone();
                let sides = room.corners_m.len();
                room.sides.resize(sides, room.construction.clone());
                if let Some(side) = room.sides.get_mut(rng.next_u32() as usize % sides) {
                    *side = "absorber".into();
                }
                floor_plan.room = Some(room);
                let absorber = Construction::Flat { reflection_loss_db: 100.0, transmission_loss_db: 200.0 };
                scenario.constructions.insert("absorber".into(), absorber);
            }
            Plan::WallAdded => {
                let mut room = scenario.room.clone();
                room.inner_walls.push(InnerWall {
                    from_m: [1.6, 4.5],
                    to_m: [5.6, 4.5],
                    construction: "concrete".into(),
                });
                floor_plan.room = Some(room);
            }
        }
    }

    /// The simulator of a seed.
    ///
    /// # Errors
    /// None: the scenario is built in.
    pub fn simulator(&self, seed: u64) -> Result<Simulator, InputError> {
        let scenario = self.scenario(seed)?;
        let way = seed.wrapping_sub(1) % scenario.trajectories.len() as u64;
        Simulator::new(&scenario, None, way as usize, Some(seed))
    }
}

/// A room of walls along the axes, each moved along its normal.
fn walls_off(room: &Room, mut is_outward: impl FnMut() -> bool) -> Room {
    let mut room = room.clone();
    let count = room.corners_m.len();
    for side in 0..count {
        let (from, to) = (room.corners_m[side], room.corners_m[(side + 1) % count]);
        // The axis across the wall: its ends are the same there.
        let across = usize::from(from[0] != to[0]);
        let off_m = if is_outward() { WALLS_OFF_M } else { -WALLS_OFF_M };
        room.corners_m[side][across] += off_m;
        room.corners_m[(side + 1) % count][across] += off_m;
    }
    room
}

/// The squared errors of a run beside the posterior bound of the frames that arrived.
pub fn against_bound(simulator: &Simulator, recording: &Recording, run: &Track) -> AgainstBound {
    let mut posterior = Posterior::new(recording.start.position_std_m, recording.start.velocity_std_m_s);
    let density_m2_s3 = recording.acceleration_density_m2_s3();
    let mut sums = AgainstBound::default();
    let mut errors = run.errors_m.iter().peekable();
    let mut previous_s = None;
    for (index, cycle) in recording.cycles.iter().enumerate() {
        let elapsed_s = previous_s.replace(cycle.time_s).map_or(0.0, |then| cycle.time_s - then);
        posterior.predict(elapsed_s, density_m2_s3);
        for frame in &cycle.frames {
            posterior.update(frame_information(simulator.channel(), index, frame.anchor, frame.action));
        }
        if let Some((_, error_m)) = errors.next_if(|(of, _)| *of == index) {
            sums.squares_m2 += error_m * error_m;
            sums.bounds_m2 += posterior.position_trace_m2();
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all() -> Vec<SeminarRoom> {
        let mut all: Vec<_> =
            [Plan::Exact(0.03), Plan::Rough, Plan::WallsOff, Plan::WallMissing, Plan::WallAdded]
                .map(SeminarRoom::with)
                .into();
        all.push(SeminarRoom { walls_flat: true, ..SeminarRoom::with(Plan::Exact(1e-3)) });
        all.push(SeminarRoom { one_anchor: true, ..SeminarRoom::with(Plan::Exact(0.03)) });
        all.push(SeminarRoom { start_unknown: true, gap: true, ..SeminarRoom::with(Plan::Rough) });
        all
    }

    #[test]
    fn every_scenario_can_be_written_down_and_read_again() {
        for room in all() {
            for seed in 1..=12 {
                let scenario = room.scenario(seed).expect("it is built in");
                let text = scenario.to_toml().expect("it can be written");
                let again = Scenario::parse(&text, "written.toml")
                    .unwrap_or_else(|error| panic!("{room:?}: {error}"));
                assert_eq!(again, scenario);
            }
        }
    }

    #[test]
    fn a_wrong_plan_is_wrong_as_its_name_says() {
        let before = |plan| SeminarRoom::with(plan).simulator(3).expect("it is built in").before();
        let exact = before(Plan::Exact(0.03));
        assert!(exact.virtual_anchors.iter().filter(|va| va.known).count() > 10);
        for va in exact.virtual_anchors.iter().filter(|va| va.known) {
            assert_eq!((va.told_position_m, va.std_m, va.exists), (Some(va.position_m), 0.03, true));
        }
        let phantoms =
            |recording: &Recording| recording.virtual_anchors.iter().filter(|va| !va.exists).count();
        assert!(phantoms(&before(Plan::WallAdded)) >= 2);
        let missing = before(Plan::WallMissing);
        assert_eq!(phantoms(&missing), 0);
        let unknown = missing.virtual_anchors.iter().filter(|va| !va.known).count();
        assert!(unknown > exact.virtual_anchors.iter().filter(|va| !va.known).count());
    }

    #[test]
    fn walls_that_are_off_move_by_as_much_and_stay_along_the_axes() {
        let room = SeminarRoom::with(Plan::Rough).scenario(1).expect("it is built in").room;
        let mut outward = [true, false, true, true, false, true].into_iter().cycle();
        let off = walls_off(&room, || outward.next().unwrap_or(true));
        for side in 0..6 {
            let [from, to] = [side, (side + 1) % 6].map(|corner| off.corners_m[corner]);
            let [was_from, was_to] = [side, (side + 1) % 6].map(|corner| room.corners_m[corner]);
            let across = usize::from(was_from[0] != was_to[0]);
            assert!((from[across] - to[across]).abs() < 1e-12);
            assert!(((from[across] - was_from[across]).abs() - 0.3).abs() < 1e-12);
        }
    }
}
