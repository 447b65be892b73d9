//! How good the walls of a map are: of those that no plan told of, those found against those that the images seen could show;
//! of those that a plan told, how far they are from where they are ([`told`]).
//!
//! Two images that were seen show a wall together: those of two anchors in it, or one in it and one of the same anchor by two
//! reflections of which it is one, where the anchor's image in the other wall was seen too.

use super::map::{SEEN_CYCLES, SEEN_SINR};
use crate::geometry::distance_m;
use crate::recording::{PlanWall, Recording};
use serde::Serialize;

/// A wall is found where the line's distance at its middle is within this, metres.
const NEAR_M: f64 = 0.2;
/// And the angle between both within this, radians.
const TURNED_RAD: f64 = 2.0 * std::f64::consts::PI / 180.0;
/// Walls are on one line within this, metres and radians; images are where geometry says likewise.
const SAME: f64 = 1e-3;

/// A wall of a plan was seen where, in this share of a recording's cycles, the path by it alone of one anchor was above
/// [`SEEN_SINR`]: less shows it too rarely to be learnt.
const SEEN_SHARE: f64 = 0.05;

/// A wall that the tracker holds, believed or doubted.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FoundWall {
    /// A point on it, metres.
    pub centre_m: [f64; 2],
    /// Its unit normal.
    pub normal: [f64; 2],
    /// Standard deviation of its offset along the normal at that point, metres.
    pub offset_std_m: f64,
    /// Standard deviation of its rotation about it, radians.
    pub rotation_std_rad: f64,
    /// Covariance of both, metre radians.
    pub offset_rotation_m_rad: f64,
    /// Probability that it exists.
    pub existence: f64,
    /// Whether it is doubted: no more probable than not.
    pub is_doubted: bool,
    /// Whether a plan told of it.
    pub is_told: bool,
    /// Its index in the plan.
    pub plan_wall: Option<usize>,
    /// How far its line is from an end of what the plan tells, at most, metres; none where no plan does.
    pub moved_m: Option<f64>,
    /// Its parts for figures, metres: the plan's, laid on its line, or one from the first to the last reflection on it that was
    /// seen.
    pub segments_m: Vec<[[f64; 2]; 2]>,
}

impl FoundWall {
    /// Whether it is believed and no plan told of it.
    fn is_grown(&self) -> bool {
        !self.is_told && !self.is_doubted
    }

    /// Standard deviation of the wall across its line at a point on it, metres.
    pub fn deviation_m(&self, [x, y]: [f64; 2]) -> f64 {
        let ([cx, cy], [nx, ny]) = (self.centre_m, self.normal);
        // Along the normal turned left; a turn to the left leads the wall towards its back there.
        let place_m = (y - cy) * nx - (x - cx) * ny;
        let turned_m = place_m * self.rotation_std_rad;
        let variance = self.offset_std_m * self.offset_std_m - 2.0 * place_m * self.offset_rotation_m_rad
            + turned_m * turned_m;
        variance.max(0.0).sqrt()
    }
}

/// How far a wall that a plan told is from where it is, at its centre along its normal.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ToldWall {
    /// Its index in the plan.
    pub plan_wall: usize,
    /// As told, metres.
    pub told_m: f64,
    /// After the way, metres; as told where the tracker took up no source by it.
    pub after_m: f64,
    /// The tracker's standard deviation of that, metres.
    pub std_m: f64,
    /// Whether it is doubted.
    pub is_doubted: bool,
}

/// How far a wall that grew is from the one there is, where it is right.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct GrownWall {
    /// Off along its normal at the point that it is given by, metres.
    pub offset_m: f64,
    /// The tracker's standard deviation of that, metres.
    pub offset_std_m: f64,
    /// Turned by, radians.
    pub rotation_rad: f64,
    /// The tracker's standard deviation of that, radians.
    pub rotation_std_rad: f64,
}

/// The walls of the recording's plan that were seen on the way, believed or not; `truth` are the plan's as they stand.
pub fn told(recording: &Recording, truth: &[PlanWall], walls: &[FoundWall]) -> Vec<ToldWall> {
    let Some(plan) = &recording.plan else { return Vec::new() };
    let of = |plan_wall: usize| {
        let (told, real) = (&plan.walls[plan_wall], truth.get(plan_wall)?);
        let [x, y] = real.centre_m();
        let away_m = |[cx, cy]: [f64; 2], [nx, ny]: [f64; 2]| (nx * (x - cx) + ny * (y - cy)).abs();
        let told_m = away_m(told.centre_m(), told.normal());
        let found = walls.iter().find(|found| found.plan_wall == Some(plan_wall));
        Some(ToldWall {
            plan_wall,
            told_m,
            after_m: found.map_or(told_m, |found| away_m(found.centre_m, found.normal)),
            std_m: found.map_or(told.offset_std_m, |found| found.deviation_m([x, y])),
            is_doubted: found.is_some_and(|found| found.is_doubted),
        })
    };
    seen_walls(recording, plan.walls.len()).into_iter().filter_map(of).collect()
}

/// The walls of a plan by which single reflections were seen.
fn seen_walls(recording: &Recording, walls: usize) -> Vec<usize> {
    let cycles = strong_cycles(recording);
    let mut seen = vec![false; walls];
    for (source, cycles) in recording.virtual_anchors.iter().zip(cycles) {
        let sequence: Vec<usize> = source.walls.iter().collect();
        if let [wall] = sequence[..]
            && wall < walls
            && cycles as f64 >= SEEN_SHARE * recording.cycles.len() as f64
            && cycles > 0
        {
            seen[wall] = true;
        }
    }
    (0..walls).filter(|&wall| seen[wall]).collect()
}

/// In how many cycles the path of every virtual anchor was above [`SEEN_SINR`].
fn strong_cycles(recording: &Recording) -> Vec<usize> {
    let mut strong = vec![0; recording.virtual_anchors.len()];
    for path in recording.cycles.iter().flat_map(|cycle| &cycle.truth_paths) {
        if let Some(count) = path.virtual_anchor.and_then(|index| strong.get_mut(index)) {
            *count += usize::from(path.sinr > SEEN_SINR);
        }
    }
    strong
}

/// How far the believed walls that no plan told of are from those there are; those that are on none are left out.
pub fn grown(recording: &Recording, walls: &[FoundWall]) -> Vec<GrownWall> {
    let truth = true_walls(recording);
    let of = |found: &FoundWall| {
        let errors = truth.iter().filter(|wall| is_found(wall, found)).map(|wall| {
            let [[ax, ay], [bx, by]] = wall.ends_m[0];
            let length_m = (bx - ax).hypot(by - ay);
            let ([tx, ty], [cx, cy]) = ([(bx - ax) / length_m, (by - ay) / length_m], found.centre_m);
            let offset_m = (tx * (cy - ay) - ty * (cx - ax)).abs();
            (offset_m, (tx * found.normal[0] + ty * found.normal[1]).abs().asin())
        });
        let (offset_m, rotation_rad) = errors.min_by(|(a, _), (b, _)| a.total_cmp(b))?;
        let FoundWall { offset_std_m, rotation_std_rad, .. } = *found;
        Some(GrownWall { offset_m, offset_std_m, rotation_rad, rotation_std_rad })
    };
    walls.iter().filter(|wall| wall.is_grown()).filter_map(of).collect()
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
        let grown: Vec<_> = walls.iter().filter(|wall| wall.is_grown()).collect();
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
    let seen = recording.virtual_anchors.iter().zip(strong_cycles(recording));
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
            offset_rotation_m_rad: 0.0,
            existence: 1.0,
            is_doubted: false,
            is_told: false,
            plan_wall: None,
            moved_m: None,
            segments_m: vec![[centre_m; 2]],
        }
    }

    #[test]
    fn the_deviation_along_a_wall_is_that_of_its_offset_and_rotation() {
        let (offset_std_m, rotation_std_rad, cross) = (0.1, 0.02, -0.0015);
        let wall = FoundWall {
            offset_std_m,
            rotation_std_rad,
            offset_rotation_m_rad: cross,
            ..found([1.0, 2.0], [0.6, 0.8])
        };
        let [x, y] = wall.centre_m;
        // The core's line n(theta) . (x - c) = o at x = c + d t + h n, t the normal turned left: h = o - theta d.
        for d in [-5.0_f64, 0.0, 3.0] {
            let variance =
                offset_std_m * offset_std_m - 2.0 * d * cross + d * d * rotation_std_rad * rotation_std_rad;
            let deviation_m = wall.deviation_m([x - 0.8 * d, y + 0.6 * d]);
            assert!((deviation_m - variance.sqrt()).abs() < 1e-12, "{d}: {deviation_m}");
        }
    }

    #[test]
    fn walls_told_and_seen_count_whether_they_are_believed_or_not() {
        let mut recording = example();
        let plan = recording.plan.as_mut().expect("has a plan");
        let truth = plan.walls.clone();
        let off_m = 0.2;
        plan.walls[0] = crate::floor_plan::walls::moved(&truth[0], off_m, 0.0);
        let (centre_m, normal) = (truth[0].centre_m(), truth[0].normal());
        recording.virtual_anchors = [0, 1]
            .map(|wall| VirtualAnchor {
                walls: crate::recording::WallSequence::new(&[wall]).expect("is one"),
                ..VirtualAnchor::new(0, [2.0, -3.0], 0.1, true)
            })
            .into();
        recording.cycles = vec![recording.cycles[0].clone(); 100];
        for (cycle, known) in recording.cycles.iter_mut().enumerate() {
            // The first wall in every tenth cycle, the second in three of a hundred.
            let is_seen = [cycle % 10 == 0, cycle < 3];
            known.truth_paths = (0..2)
                .filter(|&wall| is_seen[wall])
                .map(|wall| TruthPath {
                    anchor: 0,
                    virtual_anchor: Some(wall),
                    delay_s: 1e-8,
                    magnitude: 1.0,
                    sinr: 10.0,
                })
                .collect();
        }
        let [nx, ny] = normal;
        let beside = [centre_m[0] + 0.03 * nx, centre_m[1] + 0.03 * ny];
        for is_doubted in [false, true] {
            let found = FoundWall {
                plan_wall: Some(0),
                is_told: true,
                is_doubted,
                offset_std_m: 0.01,
                ..found(beside, normal)
            };
            let [told] = told(&recording, &truth, &[found])[..] else { panic!("one wall was seen") };
            assert!((told.told_m - off_m).abs() < 1e-9 && (told.after_m - 0.03).abs() < 1e-9, "{told:?}");
            assert_eq!((told.plan_wall, told.std_m, told.is_doubted), (0, 0.01, is_doubted));
        }
        let [told] = told(&recording, &truth, &[])[..] else { panic!("one wall was seen") };
        assert!((told.after_m - off_m).abs() < 1e-9 && told.std_m == truth[0].offset_std_m);
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
        let doubted = walls.clone().map(|wall| FoundWall { is_doubted: true, ..wall });
        assert_eq!(WallScore::new(&recording, &doubted, &[]).grown, 0);
        let [right] = grown(&recording, &walls)[..] else { panic!("one is right") };
        assert!((right.offset_m - 0.1).abs() < 1e-12 && right.rotation_rad == 0.0, "{right:?}");
    }
}
