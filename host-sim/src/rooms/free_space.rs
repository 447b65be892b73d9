//! Where a tag can be in a room, and how it gets from one place to another.

use super::draws::{Draws, centimetres};
use crate::geometry::{Wall, distance_m, polygon};
use crate::scenario::Position;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Nobody walks nearer to a wall than this, metres.
const CLEARANCE_M: f64 = 0.3;
/// Cells on the longer side of the grid, about.
const CELLS: f64 = 120.0;
/// What a turn costs a robot that keeps to lines, in cells.
const TURN_COST: u32 = 6;

/// A grid over a room: the largest connected part of the cells whose centres are free.
#[derive(Clone, Debug)]
pub(super) struct FreeSpace {
    walls: Vec<Wall>,
    origin_m: Position,
    cell_m: f64,
    columns: usize,
    is_free: Vec<bool>,
    free: Vec<usize>,
}

impl FreeSpace {
    pub(super) fn new(corners_m: &[Position], walls: Vec<Wall>) -> Self {
        let bound = |axis: usize| {
            let values = corners_m.iter().map(|corner| corner[axis]);
            (values.clone().fold(f64::INFINITY, f64::min), values.fold(f64::NEG_INFINITY, f64::max))
        };
        let ((west_m, east_m), (south_m, north_m)) = (bound(0), bound(1));
        let cell_m = ((east_m - west_m).max(north_m - south_m) / CELLS).max(0.1);
        let count = |extent_m: f64| ((extent_m / cell_m) as usize).max(1);
        let (columns, rows) = (count(east_m - west_m), count(north_m - south_m));
        let mut space = Self {
            walls,
            origin_m: [west_m, south_m],
            cell_m,
            columns,
            is_free: Vec::new(),
            free: Vec::new(),
        };
        let is_free = |cell: usize| {
            let place_m = space.centre_m(cell);
            polygon::contains(corners_m, place_m)
                && space.walls.iter().all(|wall| polygon::distance_to_wall(wall, place_m) >= CLEARANCE_M)
        };
        let candidates: Vec<bool> = (0..columns * rows).map(is_free).collect();
        space.is_free = candidates;
        space.free = space.largest_part();
        space.is_free.iter_mut().for_each(|is_free| *is_free = false);
        for &cell in &space.free {
            space.is_free[cell] = true;
        }
        space
    }

    /// A free place, all as likely; in whole centimetres.
    pub(super) fn place(&self, draws: &mut Draws) -> Position {
        self.centre_m(self.free[draws.below(self.free.len())])
    }

    pub(super) fn walls(&self) -> &[Wall] {
        &self.walls
    }

    /// Whether a straight leg keeps `distance_m` from every wall.
    pub(super) fn is_clear(&self, from_m: Position, to_m: Position, distance_m: f64) -> bool {
        let leg = Wall { ends_m: [from_m, to_m], construction: 0 };
        self.walls.iter().all(|wall| !polygon::nearer(&leg, wall, distance_m))
    }

    /// The shortest way between two free places, its corners only, the first left out.
    pub(super) fn way(&self, from_m: Position, to_m: Position) -> Vec<Position> {
        let cells = self.search(from_m, to_m, false);
        // Straight legs past every cell that can be skipped.
        let mut corners: Vec<Position> = Vec::new();
        let mut at_m = from_m;
        let mut next = 0;
        while next < cells.len() {
            let sees = |index: &usize| self.is_clear(at_m, self.centre_m(cells[*index]), 0.8 * CLEARANCE_M);
            let farthest = (next..cells.len()).rev().find(sees).unwrap_or(next);
            at_m = self.centre_m(cells[farthest]);
            corners.push(at_m);
            next = farthest + 1;
        }
        corners
    }

    /// The same along x and y only, with few turns.
    pub(super) fn way_along_axes(&self, from_m: Position, to_m: Position) -> Vec<Position> {
        let cells = self.search(from_m, to_m, true);
        let mut corners: Vec<Position> = Vec::new();
        let mut before = from_m;
        for (index, &cell) in cells.iter().enumerate() {
            let here = self.centre_m(cell);
            let is_corner = cells.get(index + 1).is_none_or(|&after| {
                let after = self.centre_m(after);
                // Collinear cells share a coordinate with both neighbours.
                !((before[0] == here[0] && here[0] == after[0])
                    || (before[1] == here[1] && here[1] == after[1]))
            });
            if is_corner {
                corners.push(here);
            }
            before = here;
        }
        corners
    }

    fn centre_m(&self, cell: usize) -> Position {
        let along = |index: usize| (index as f64 + 0.5) * self.cell_m;
        [
            centimetres(self.origin_m[0] + along(cell % self.columns)),
            centimetres(self.origin_m[1] + along(cell / self.columns)),
        ]
    }

    fn cell_of(&self, place_m: Position) -> usize {
        // Places are centres of cells, rounded.
        let index = |axis: usize| libm::floor((place_m[axis] - self.origin_m[axis]) / self.cell_m) as usize;
        index(1) * self.columns + index(0)
    }

    /// Free neighbours: first the four along the axes, then the four across, with the cost of a step times 5.
    fn neighbours(&self, cell: usize, along_axes: bool) -> impl Iterator<Item = (usize, usize, u32)> {
        const STEPS: [([isize; 2], u32); 8] = [
            ([1, 0], 5),
            ([0, 1], 5),
            ([-1, 0], 5),
            ([0, -1], 5),
            ([1, 1], 7),
            ([-1, 1], 7),
            ([-1, -1], 7),
            ([1, -1], 7),
        ];
        let (column, row) = (cell % self.columns, cell / self.columns);
        let rows = self.is_free.len() / self.columns;
        let count = if along_axes { 4 } else { 8 };
        STEPS.iter().take(count).enumerate().filter_map(move |(direction, &([dx, dy], cost))| {
            let (x, y) = (column.checked_add_signed(dx)?, row.checked_add_signed(dy)?);
            let is_there = x < self.columns && y < rows && self.is_free[y * self.columns + x];
            is_there.then_some((y * self.columns + x, direction, cost))
        })
    }

    fn largest_part(&self) -> Vec<usize> {
        let mut seen = vec![false; self.is_free.len()];
        let mut largest = Vec::new();
        for first in 0..self.is_free.len() {
            if !self.is_free[first] || seen[first] {
                continue;
            }
            seen[first] = true;
            let mut part = vec![first];
            let mut next = 0;
            while next < part.len() {
                for (neighbour, ..) in self.neighbours(part[next], true) {
                    if !seen[neighbour] {
                        seen[neighbour] = true;
                        part.push(neighbour);
                    }
                }
                next += 1;
            }
            if part.len() > largest.len() {
                largest = part;
            }
        }
        largest.sort_unstable();
        largest
    }

    /// Dijkstra over cells, and over directions where turns cost; the cells after the first, in order.
    fn search(&self, from_m: Position, to_m: Position, along_axes: bool) -> Vec<usize> {
        let directions = if along_axes { 4 } else { 1 };
        let (start, goal) = (self.cell_of(from_m), self.cell_of(to_m));
        let mut cost = vec![u32::MAX; self.is_free.len() * directions];
        let mut from = vec![usize::MAX; cost.len()];
        let mut heap = BinaryHeap::new();
        for direction in 0..directions {
            cost[start * directions + direction] = 0;
            heap.push(Reverse((0, start * directions + direction)));
        }
        while let Some(Reverse((so_far, node))) = heap.pop() {
            if so_far > cost[node] {
                continue;
            }
            if node / directions == goal {
                let mut cells = Vec::new();
                let mut at = node;
                while at / directions != start {
                    cells.push(at / directions);
                    at = from[at];
                }
                cells.reverse();
                return cells;
            }
            for (neighbour, direction, step) in self.neighbours(node / directions, along_axes) {
                let is_turn = along_axes && node % directions != direction;
                let there = neighbour * directions + direction % directions;
                let total = so_far + step + if is_turn { 5 * TURN_COST } else { 0 };
                if total < cost[there] {
                    cost[there] = total;
                    from[there] = node;
                    heap.push(Reverse((total, there)));
                }
            }
        }
        Vec::new()
    }

    /// Places beside a wall, 0.2 to 0.5 m from one: where anchors are mounted.
    pub(super) fn place_beside_a_wall(&self, draws: &mut Draws, corners_m: &[Position]) -> Option<Position> {
        for _ in 0..200 {
            let wall = self.walls[draws.below(self.walls.len())];
            let [a, b] = wall.ends_m;
            let length_m = distance_m(a, b);
            let along = draws.uniform(0.0, 1.0);
            let away_m = draws.uniform(0.2, 0.5) * if draws.chance(0.5) { 1.0 } else { -1.0 };
            let normal = [(a[1] - b[1]) / length_m, (b[0] - a[0]) / length_m];
            let place_m: Position = std::array::from_fn(|axis| {
                centimetres(a[axis] + along * (b[axis] - a[axis]) + away_m * normal[axis])
            });
            let is_free = polygon::contains(corners_m, place_m)
                && self.walls.iter().all(|wall| polygon::distance_to_wall(wall, place_m) >= 0.15);
            if is_free && !self.is_enclosed(place_m) {
                return Some(place_m);
            }
        }
        None
    }

    /// Whether no free cell is near: inside a pillar or a rack nothing is mounted.
    fn is_enclosed(&self, place_m: Position) -> bool {
        let sees = |&cell: &usize| {
            let centre_m = self.centre_m(cell);
            distance_m(centre_m, place_m) < 1.5 && self.is_clear(centre_m, place_m, 0.05)
        };
        !self.free.iter().any(sees)
    }
}
