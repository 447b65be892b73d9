//! How good the walls of a map are that no plan told of: those found against those that the images seen could show.
//!
//! Two images that were seen show a wall together: those of two anchors in it, or one in it and one of the same anchor by two
//! reflections of which it is one, where the anchor's image in the other wall was seen too.

use super::map::{SEEN_CYCLES, SEEN_SINR};
use crate::geometry::distance_m;
use crate::recording::Recording;
use serde::Serialize;

/// A wall is found where the line's distance at its middle is within this, metres.
const NEAR_M: f64 = 0.2;
/// And the angle between both within this, radians.
const TURNED_RAD: f64 = 2.0 * std::f64::consts::PI / 180.0;
/// Walls are on one line within this, metres and radians; images are where geometry says likewise.
const SAME: f64 = 1e-3;

/// A wall that the tracker holds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct FoundWall {
    /// A point on it, metres.
    pub centre_m: [f64; 2],
    /// Its unit normal.
    pub normal: [f64; 2],
    /// Standard deviation of its offset along the normal at that point, metres.
    pub offset_std_m: f64,
    /// Standard deviation of its rotation about it, radians.
    pub rotation_std_rad: f64,
    /// Probability that it exists.
    pub existence: f64,
    /// Whether a plan told of it.
    pub is_told: bool,
    /// Its index in the plan.
    pub plan_wall: Option<usize>,
    /// Its end points for figures, metres: as told, or from the first to the last reflection on it that was seen.
    pub ends_m: [[f64; 2]; 2],
}

/// Walls found against those that could be.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct WallScore {
    /// Walls that the images seen could show.
    pub shown: usize,
    /// Of those, found.
    pub found: usize,
    /// Walls in the map of which no plan told.
    pub grown: usize,
    /// Of those, on no wall there is.
    pub false_ones: usize,
    /// Images by one reflection in these walls that were seen, and how many of them the map has within 0.3 m.
    pub images: [usize; 2],
}

/// A wall there is, with the images in it that were seen.
#[derive(Clone, Debug)]
struct TrueWall {
    ends_m: Vec<[[f64; 2]; 2]>,
    /// Anchors whose image in it was seen.
    singles: Vec<(usize, [f64; 2])>,
    is_shown: bool,
}

impl WallScore {
    /// The images by one reflection in walls shown that were seen and that the map has not within 0.3 m.
    pub fn missed(recording: &Recording, images: &[(usize, [f64; 2])]) -> Vec<(usize, [f64; 2])> {
        let truth = true_walls(recording);
        let singles = truth.iter().filter(|wall| wall.is_shown).flat_map(|wall| wall.singles.clone());
        singles.filter(|single| !is_mapped(single, images)).collect()
    }

    /// Scores walls; `images` are those in the map, by anchor and position in metres.
    pub fn new(recording: &Recording, walls: &[FoundWall], images: &[(usize, [f64; 2])]) -> Self {
        let truth = true_walls(recording);
        let grown: Vec<_> = walls.iter().filter(|wall| !wall.is_told).collect();
        let shown: Vec<_> = truth.iter().filter(|wall| wall.is_shown).collect();
        let found = shown.iter().filter(|wall| grown.iter().any(|found| is_found(wall, found))).count();
        let is_false = |found: &&&FoundWall| !truth.iter().any(|wall| is_found(wall, found));
        let singles: Vec<_> = shown.iter().flat_map(|wall| &wall.singles).collect();
        Self {
            shown: shown.len(),
            found,
            grown: grown.len(),
            false_ones: grown.iter().filter(is_false).count(),
            images: [singles.len(), singles.iter().filter(|single| is_mapped(single, images)).count()],
        }
    }
}

fn is_mapped((anchor, m): &(usize, [f64; 2]), images: &[(usize, [f64; 2])]) -> bool {
    images.iter().any(|(of, image)| of == anchor && distance_m(*m, *image) < 0.3)
}

fn is_found(wall: &TrueWall, found: &FoundWall) -> bool {
    let [nx, ny] = found.normal;
    wall.ends_m.iter().any(|[[ax, ay], [bx, by]]| {
        let length = (bx - ax).hypot(by - ay);
        let sin = ((bx - ax) * nx + (by - ay) * ny) / length;
        let [cx, cy] = found.centre_m;
        let off_m = nx * (0.5 * (ax + bx) - cx) + ny * (0.5 * (ay + by) - cy);
        sin.abs() < TURNED_RAD.sin() && off_m.abs() < NEAR_M
    })
}

/// The walls of a recording, those on one line taken together.
fn true_walls(recording: &Recording) -> Vec<TrueWall> {
    let mut walls: Vec<TrueWall> = Vec::new();
    for ends_m in &recording.walls {
        let on_line = |wall: &&mut TrueWall| {
            ends_m.iter().all(|end_m| distance_m(mirrored(*end_m, &wall.ends_m[0]), *end_m) < 2.0 * SAME)
        };
        match walls.iter_mut().find(on_line) {
            Some(wall) => wall.ends_m.push(*ends_m),
            None => {
                walls.push(TrueWall { ends_m: vec![*ends_m], singles: Vec::new(), is_shown: false });
            }
        }
    }
    let mut strong = vec![0; recording.virtual_anchors.len()];
    for path in recording.cycles.iter().flat_map(|cycle| &cycle.truth_paths) {
        if let Some(count) = path.virtual_anchor.and_then(|index| strong.get_mut(index)) {
            *count += usize::from(path.sinr > SEEN_SINR);
        }
    }
    let seen = recording.virtual_anchors.iter().zip(strong);
    let seen: Vec<_> =
        seen.filter(|(va, strong)| va.exists && *strong >= SEEN_CYCLES).map(|(va, _)| va).collect();
    let anchor_m = |anchor: usize| recording.anchors[anchor].position_m;
    for va in &seen {
        for wall in &mut walls {
            if distance_m(mirrored(anchor_m(va.anchor), &wall.ends_m[0]), va.position_m) < SAME {
                wall.singles.push((va.anchor, va.position_m));
            }
        }
    }
    let mut is_shown: Vec<bool> = walls
        .iter()
        .map(|wall| wall.singles.iter().any(|(anchor, _)| *anchor != wall.singles[0].0))
        .collect();
    for va in &seen {
        let has = |wall: &TrueWall| wall.singles.iter().any(|(anchor, _)| *anchor == va.anchor);
        for (x, first) in walls.iter().enumerate().filter(|(_, wall)| has(wall)) {
            for (y, second) in walls.iter().enumerate().filter(|(y, wall)| *y != x && has(wall)) {
                let once = mirrored(anchor_m(va.anchor), &first.ends_m[0]);
                if distance_m(mirrored(once, &second.ends_m[0]), va.position_m) < SAME {
                    is_shown[x] = true;
                    is_shown[y] = true;
                }
            }
        }
    }
    for (wall, is_shown) in walls.iter_mut().zip(is_shown) {
        wall.is_shown = is_shown;
    }
    walls
}

/// The mirror image of a point in the line through two.
pub fn mirrored([x, y]: [f64; 2], [[ax, ay], [bx, by]]: &[[f64; 2]; 2]) -> [f64; 2] {
    let (tx, ty) = (bx - ax, by - ay);
    let share = ((x - ax) * tx + (y - ay) * ty) / (tx * tx + ty * ty);
    [2.0 * (ax + share * tx) - x, 2.0 * (ay + share * ty) - y]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::tests::example;
    use crate::recording::{TruthPath, VirtualAnchor};

    fn found(centre_m: [f64; 2], normal: [f64; 2]) -> FoundWall {
        FoundWall {
            centre_m,
            normal,
            offset_std_m: 0.0,
            rotation_std_rad: 0.0,
            existence: 1.0,
            is_told: false,
            plan_wall: None,
            ends_m: [centre_m; 2],
        }
    }

    #[test]
    fn walls_are_asked_for_where_two_images_show_them() {
        let mut recording = example();
        recording.walls = vec![[[0.0, 0.0], [9.0, 0.0]], [[9.0, 0.0], [9.0, 7.0]], [[9.0, 7.0], [0.0, 7.0]]];
        recording.anchors[0].position_m = [2.0, 3.0];
        // In the first wall, in the second, in both.
        recording.virtual_anchors = [[2.0, -3.0], [16.0, 3.0], [16.0, -3.0]]
            .map(|position_m| VirtualAnchor::new(0, position_m, 0.0, false))
            .into();
        let path = |virtual_anchor| TruthPath {
            anchor: 0,
            virtual_anchor: Some(virtual_anchor),
            delay_s: 1e-8,
            magnitude: 1.0,
            sinr: 10.0,
        };
        let seen = |recording: &mut Recording, paths: &[usize]| {
            recording.cycles[0].truth_paths = paths.iter().map(|index| path(*index)).collect();
            let strong = recording.cycles[0].clone();
            recording.cycles = vec![strong; SEEN_CYCLES];
        };
        let walls = [found([4.0, 0.1], [0.0, 1.0]), found([4.0, 3.0], [0.6, 0.8])];
        seen(&mut recording, &[0, 1]);
        assert_eq!(WallScore::new(&recording, &walls, &[]).shown, 0);
        seen(&mut recording, &[0, 1, 2]);
        let score = WallScore::new(&recording, &walls, &[(0, [2.1, -3.0])]);
        let expected = WallScore { shown: 2, found: 1, grown: 2, false_ones: 1, images: [2, 1] };
        assert_eq!(score, expected);
    }
}
