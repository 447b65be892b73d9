//! Image sources of any order: the mirror images of an anchor in walls, and in walls mirrored again.
//!
//! The image of order k is `a_k = a_(k-1) - 2 (n . (a_(k-1) - A)) n` for a wall through A with the unit normal n
//! (Allen and Berkley 1979; Borish 1984 for any polyhedron). A sequence of walls is followed as a beam (Heckbert and
//! Hanrahan 1984): its apex is the image, its aperture the part of the last wall that the beam before could light. The
//! next wall is clipped to the beam; where nothing is left no tag can see the image, and none beyond it.
//!
//! Walls do not shade each other here, since paths may pass through them; that is [`super::visibility`]'s business.
//!
//! Cost: one step for every beam and wall. With W walls there are at most `W (W - 1)^(k - 1)` beams of order k; the
//! apertures leave about `(2 k)` of them per wall in a convex room, and some `m^k` times as many where a straight line
//! through the room crosses m walls on its way. The numbers are measured in the tests of this module.

use std::collections::HashMap;

use super::{TOUCH_M, Wall, between, cross, length, sub};

/// The highest order.
pub const MAX_ORDER: usize = 8;

/// Images nearer to each other than this are one, metres.
const MERGE_M: f64 = 0.01;

/// Walls are taken to be longer by this at both ends, metres, so that rounding drops no image: ten times what
/// visibility allows.
const GENEROSITY_M: f64 = 10.0 * TOUCH_M;

/// An image of an anchor.
#[derive(Clone, Debug, PartialEq)]
pub struct ImageSource {
    /// Where it is, metres: the image along the first of the sequences.
    pub position_m: [f64; 2],
    /// The walls, by index, in the order in which a ray from the anchor meets them. Several where images coincide (at
    /// right angles, or in walls of one plane), by order and then by wall; empty for the anchor itself.
    pub sequences: Vec<Vec<usize>>,
    /// Reflections of the shortest sequence.
    pub order: usize,
}

/// The part of the plane that rays from the anchor along `sequence` can reach.
struct Beam {
    sequence: Vec<usize>,
    apex_m: [f64; 2],
    /// The lit part of the last wall; `None`: all around.
    aperture_m: Option<[[f64; 2]; 2]>,
}

/// All image sources of an anchor at `anchor_m` up to `order` reflections (at most [`MAX_ORDER`]) that some place can
/// see, by order and then by sequence. The first is the anchor itself, of order 0: the source of the direct path.
///
/// Images less than 1 cm apart become one. An anchor in the plane of a wall has no image in that wall, and neither has
/// a wall without length.
pub fn image_sources(walls: &[Wall], anchor_m: [f64; 2], order: usize) -> Vec<ImageSource> {
    let mut found = Merged::default();
    let mut beams = vec![Beam { sequence: Vec::new(), apex_m: anchor_m, aperture_m: None }];
    for reflections in 0..=order.min(MAX_ORDER) {
        if reflections > 0 {
            beams = beams.iter().flat_map(|beam| reflected(walls, beam)).collect();
        }
        for beam in &beams {
            found.add(beam);
        }
    }
    found.images
}

/// The beams that the walls make of `beam`.
fn reflected<'a>(walls: &'a [Wall], beam: &'a Beam) -> impl Iterator<Item = Beam> + 'a {
    walls.iter().enumerate().filter_map(move |(index, wall)| {
        let offset_m = wall.offset_m(beam.apex_m);
        if !(offset_m.abs() > TOUCH_M) {
            return None;
        }
        let aperture_m = lit(walls, beam, index)?;
        let sequence = beam.sequence.iter().copied().chain([index]).collect();
        Some(Beam { sequence, apex_m: wall.mirror(beam.apex_m, offset_m), aperture_m: Some(aperture_m) })
    })
}

/// The part of the wall `index` that `beam` can light.
fn lit(walls: &[Wall], beam: &Beam, index: usize) -> Option<[[f64; 2]; 2]> {
    let [a, b] = walls[index].ends_m;
    let more = GENEROSITY_M / length(sub(b, a));
    let ends_m = [between(a, b, -more), between(a, b, 1.0 + more)];
    let (Some([left, right]), Some(&last)) = (beam.aperture_m, beam.sequence.last()) else {
        return Some(ends_m);
    };
    if last == index {
        return None;
    }
    let [left, right] = [sub(left, beam.apex_m), sub(right, beam.apex_m)];
    let turn = cross(left, right).signum();
    // A reflected beam starts at its wall, on the side away from its apex.
    let side = -walls[last].offset_m(beam.apex_m).signum();
    let beyond = ends_m.map(|end| side * walls[last].offset_m(end));
    if !(beyond[0] > TOUCH_M || beyond[1] > TOUCH_M) {
        return None;
    }
    let rays = ends_m.map(|end| sub(end, beam.apex_m));
    let mut shares = [0.0_f64, 1.0];
    for [from, to] in [
        beyond.map(|distance| distance + GENEROSITY_M),
        rays.map(|ray| turn * cross(left, ray)),
        rays.map(|ray| turn * cross(ray, right)),
    ] {
        if from < 0.0 && to < 0.0 {
            return None;
        }
        if from < 0.0 {
            shares[0] = shares[0].max(from / (from - to));
        }
        if to < 0.0 {
            shares[1] = shares[1].min(from / (from - to));
        }
    }
    (shares[0] < shares[1]).then(|| shares.map(|share| between(ends_m[0], ends_m[1], share)))
}

/// Images in the order in which they were found, those that coincide as one.
#[derive(Default)]
struct Merged {
    images: Vec<ImageSource>,
    /// Indices of the images in each square of side [`MERGE_M`].
    squares: HashMap<[i64; 2], Vec<usize>>,
}

impl Merged {
    fn add(&mut self, beam: &Beam) {
        let square = beam.apex_m.map(|coordinate| (coordinate / MERGE_M).floor() as i64);
        let near = (-1..=1).flat_map(|x| (-1..=1).map(move |y| [square[0] + x, square[1] + y]));
        let same = near
            .filter_map(|square| self.squares.get(&square))
            .flatten()
            .copied()
            .filter(|&index| length(sub(self.images[index].position_m, beam.apex_m)) < MERGE_M)
            .min();
        if let Some(index) = same {
            self.images[index].sequences.push(beam.sequence.clone());
            return;
        }
        self.squares.entry(square).or_default().push(self.images.len());
        self.images.push(ImageSource {
            position_m: beam.apex_m,
            sequences: vec![beam.sequence.clone()],
            order: beam.sequence.len(),
        });
    }
}
