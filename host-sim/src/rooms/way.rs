//! Ways through the free space of a room.

use super::draws::{Aspect, Draws, rounded};
use super::free_space::FreeSpace;
use crate::geometry::distance_m;
use crate::scenario::{Position, Trajectory, Way, Waypoint};
use serde::Serialize;

/// How a tag moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Motion {
    /// Someone who walks: rounded corners, speeds of 0.6 to 1.4 m/s.
    Smooth,
    /// Sharp corners at up to 1.8 m/s, now and then straight back.
    Abrupt,
    /// Someone who stops at every second place.
    StopAndGo,
    /// A robot that keeps to lines along the walls, 0.3 to 0.8 m/s.
    Robot,
}

impl Motion {
    const ALL: [Motion; 4] = [Motion::Smooth, Motion::Abrupt, Motion::StopAndGo, Motion::Robot];

    /// Its name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Motion::Smooth => "smooth",
            Motion::Abrupt => "abrupt",
            Motion::StopAndGo => "stop-and-go",
            Motion::Robot => "robot",
        }
    }

    /// Spectral density of the white acceleration that is told, m^2/s^3. Of people it is known that they walk, not how:
    /// 1 m/s^2 during cycles of 0.1 s, as in the built-in scenarios. What a robot does is known: the squared changes of its
    /// velocity per axis and second, median over 300 rooms.
    pub(super) fn acceleration_density_m2_s3(self) -> f64 {
        match self {
            Motion::Smooth | Motion::Abrupt | Motion::StopAndGo => 0.1,
            Motion::Robot => 0.035,
        }
    }
}

/// Legs on either side of a rounded corner are cut at most this far from it, metres.
const ROUNDING_M: f64 = 0.7;
/// Pieces of a rounded corner.
const PIECES: usize = 5;

/// A way of 300 to 600 cycles, and how the tag moves on it.
pub(super) fn way(seed: u64, space: &FreeSpace, period_s: f64) -> (Trajectory, Motion) {
    let mut draws = Draws::new(seed, Aspect::Way);
    let motion = draws.one_of(&Motion::ALL);
    let cycles = draws.count(300, 600);
    // Rounded corners and speeds that vary make a way shorter or longer than its legs at their common speed.
    let wanted_s = 1.2 * cycles as f64 * period_s;
    let speed_m_s = match motion {
        Motion::Smooth => draws.uniform(0.6, 1.4),
        Motion::Abrupt => draws.uniform(1.0, 1.8),
        Motion::StopAndGo => draws.uniform(0.6, 1.4),
        Motion::Robot => draws.uniform(0.3, 0.8),
    };
    let mut corners = vec![space.place(&mut draws)];
    let mut pauses_s = vec![0.0];
    let mut taken_s = 0.0;
    while taken_s <= wanted_s {
        let here_m = corners[corners.len() - 1];
        let goes_back = motion == Motion::Abrupt && corners.len() > 1 && draws.chance(0.2);
        let legs = if goes_back {
            vec![corners[corners.len() - 2]]
        } else {
            let goal_m = space.place(&mut draws);
            match motion {
                Motion::Robot => space.way_along_axes(here_m, goal_m),
                _ => space.way(here_m, goal_m),
            }
        };
        for leg_m in legs {
            taken_s += distance_m(corners[corners.len() - 1], leg_m) / speed_m_s;
            corners.push(leg_m);
            pauses_s.push(0.0);
        }
        if motion == Motion::StopAndGo && draws.chance(0.5) {
            let pause_s = rounded(draws.uniform(0.5, 8.0), 1);
            let last = pauses_s.len() - 1;
            pauses_s[last] = pause_s;
            taken_s += pause_s;
        }
    }
    let points = if motion == Motion::Smooth { rounded_corners(space, &corners) } else { corners };
    let mut varying = |index: usize| {
        // A walk changes its speed a little from leg to leg; a robot does not.
        let factor = if motion == Motion::Robot { 1.0 } else { draws.uniform(0.85, 1.0) };
        let pause_s = if motion == Motion::StopAndGo { pauses_s[index] } else { 0.0 };
        (rounded(factor * speed_m_s, 3), pause_s)
    };
    let waypoint = |(index, &position_m): (usize, &Position)| {
        let (speed_m_s, pause_s) = varying(index);
        Waypoint { position_m, speed_m_s, pause_s }
    };
    let points = points.iter().enumerate().map(waypoint).collect();
    let name = motion.name().into();
    (Trajectory { name, period_s, cycles: Some(cycles), way: Way::Waypoints { points } }, motion)
}

/// Corners replaced by pieces of a parabola that touches both legs, as far as walls allow.
fn rounded_corners(space: &FreeSpace, corners: &[Position]) -> Vec<Position> {
    let mut points = vec![corners[0]];
    for ends in corners.windows(3) {
        let [a, b, c] = [ends[0], ends[1], ends[2]];
        let most_m = ROUNDING_M.min(0.5 * distance_m(a, b)).min(0.5 * distance_m(b, c));
        // Halved where a wall is in the way; in the end the corner stays.
        let arc = (0..3).map(|halvings| most_m / f64::from(1 << halvings)).find_map(|away_m| {
            let towards = |end: Position| -> Position {
                let share = away_m / distance_m(b, end).max(1e-9);
                std::array::from_fn(|axis| b[axis] + share * (end[axis] - b[axis]))
            };
            let (from, to) = (towards(a), towards(c));
            let at = |piece: usize| -> Position {
                let t = piece as f64 / PIECES as f64;
                std::array::from_fn(|axis| {
                    let value =
                        (1.0 - t) * (1.0 - t) * from[axis] + 2.0 * t * (1.0 - t) * b[axis] + t * t * to[axis];
                    rounded(value, 3)
                })
            };
            let arc: Vec<Position> = (0..=PIECES).map(at).collect();
            let is_clear = away_m > 0.05 && arc.windows(2).all(|ends| space.is_clear(ends[0], ends[1], 0.1));
            is_clear.then_some(arc)
        });
        match arc {
            Some(arc) => points.extend(arc),
            None => points.push(b),
        }
    }
    points.push(corners[corners.len() - 1]);
    points.dedup();
    points
}
