//! Where a tag can go: free straight walks between walls, and the task of a run.

use crate::channel::random::{Purpose, stream, uniform};
use crate::geometry::polygon::{contains, nearer};
use crate::geometry::{Wall, distance_m};
use crate::scenario::{Position, Room, walls};

/// A tag keeps this far from every wall, metres.
const CLEARANCE_M: f64 = 0.3;
/// Pairs of places drawn before giving up.
const DRAWS: usize = 100_000;
/// A goal is at least this share of the room's diagonal away from the start.
const LEAST_SHARE: f64 = 0.5;

/// A room's floor.
#[derive(Clone, Debug)]
pub struct Floor {
    corners_m: Vec<Position>,
    walls: Vec<Wall>,
}

impl Floor {
    /// The floor of a room.
    pub fn new(room: &Room) -> Self {
        let wall = |(ends_m, _): ([Position; 2], &str)| Wall { ends_m, construction: 0 };
        Self { corners_m: room.corners_m.clone(), walls: walls(room).into_iter().map(wall).collect() }
    }

    /// Whether one can walk straight from a place inside the room to another.
    pub fn is_free(&self, from_m: Position, to_m: Position) -> bool {
        let leg = Wall { ends_m: [from_m, to_m], construction: 0 };
        !self.walls.iter().any(|wall| nearer(&leg, wall, CLEARANCE_M))
    }

    /// Start and goal of a run: uniform over the floor, with a free straight walk between them, and at least half the
    /// room's diagonal apart. None where the room has no such places.
    pub fn task(&self, seed: u64) -> Option<[Position; 2]> {
        let bound = |axis: usize, of: fn(f64, f64) -> f64, start: f64| {
            self.corners_m.iter().map(|corner| corner[axis]).fold(start, of)
        };
        let low = [0, 1].map(|axis| bound(axis, f64::min, f64::INFINITY));
        let high = [0, 1].map(|axis| bound(axis, f64::max, f64::NEG_INFINITY));
        let least_m = LEAST_SHARE * distance_m(low, high);
        let mut rng = stream(seed, Purpose::Experiment, &[]);
        let mut place = || [0, 1].map(|axis| low[axis] + uniform(&mut rng) * (high[axis] - low[axis]));
        (0..DRAWS).find_map(|_| {
            let (start_m, goal_m) = (place(), place());
            let fits = contains(&self.corners_m, start_m)
                && distance_m(start_m, goal_m) >= least_m
                && self.is_free(start_m, goal_m);
            fits.then_some([start_m, goal_m])
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::polygon::distance_to_wall;
    use crate::scenario::Scenario;

    #[test]
    fn tasks_are_inside_far_apart_and_within_sight() {
        let (scenario, _) = Scenario::find("l-shaped-office").expect("is built in");
        let floor = Floor::new(&scenario.room);
        for seed in 0..50 {
            let [start_m, goal_m] = floor.task(seed).expect("there are such places");
            assert!(distance_m(start_m, goal_m) >= 0.5 * 164_f64.sqrt());
            for share in 0..=20 {
                let t = f64::from(share) / 20.0;
                let place_m = [0, 1].map(|axis| start_m[axis] + t * (goal_m[axis] - start_m[axis]));
                assert!(contains(&scenario.room.corners_m, place_m), "{seed}: {place_m:?}");
                let away = floor.walls.iter().map(|wall| distance_to_wall(wall, place_m));
                assert!(away.fold(f64::INFINITY, f64::min) >= CLEARANCE_M, "{seed}: {place_m:?}");
            }
        }
        // Around the corner of the L there is no straight walk.
        assert!(!floor.is_free([9.0, 1.0], [1.0, 7.0]));
    }
}
