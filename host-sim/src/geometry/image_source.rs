//! Image sources of any order: the mirror images of an anchor in walls, and in walls mirrored again.
//!
//! The image of order k is `a_k = a_(k-1) - 2 (n . (a_(k-1) - A)) n` for a wall through A with the unit normal n
//! (Allen and Berkley 1979; Borish 1984 for any polyhedron). A sequence of walls is followed as a beam (Heckbert and
//! Hanrahan 1984): its apex is the image, its aperture the part of the last wall that the beam before could light. The
//! next wall is clipped to the beam; where nothing is left no tag can see the image, and none beyond it.
//!
//! Walls do not shade each other here, since paths may pass through them; that is [`super::visibility`]'s business.
//!
//! Cost: one step for every beam and wall. W walls make at most `W (W - 1)^(k - 1)` beams of order k. In a plain room
//! the apertures leave few of them: 1 894 of 590 490 at order 6 in a room of ten walls, 961 up to order 8 in a
//! rectangle. Many walls side by side leave many, since they do not shade each other: an office of 36 partitions makes
//! 41, 506, 4 509 and 36 640 up to orders 1 to 4. Whoever takes floor plans from users has to bound both numbers.

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

#[cfg(test)]
mod tests {
    use super::super::shared::{polygon, room_of_ten_walls, seminar_room, wall};
    use super::*;

    /// The image along exactly this sequence.
    fn image_along(images: &[ImageSource], sequence: &[usize]) -> Option<[f64; 2]> {
        let image = images.iter().find(|image| image.sequences.iter().any(|walls| walls == sequence));
        image.map(|image| image.position_m)
    }

    #[test]
    fn the_published_images_of_the_seminar_room_are_found_to_a_centimetre() {
        // Walls: south, east, the projecting corner's two, north, west.
        let walls = seminar_room();
        let first = image_sources(&walls, [0.5, 7.0], 1);
        let second = image_sources(&walls, [5.2, 2.3], 1);
        // The published list has (0.5, -6.996) and (-1.116, 7.0): 4 mm off the walls that its other images give.
        for (images, wall, mirrored_m, published_m) in [
            (&first, 0, [0.5, -7.0], [0.5, -6.996]),
            (&first, 1, [11.05, 7.0], [11.05, 7.0]),
            (&first, 3, [8.14, 7.0], [8.14, 7.0]),
            (&first, 4, [0.5, 10.094], [0.5, 10.094]),
            (&first, 5, [-1.112, 7.0], [-1.116, 7.0]),
            (&second, 0, [5.2, -2.3], [5.2, -2.3]),
            (&second, 4, [5.2, 14.794], [5.2, 14.794]),
            (&second, 5, [-5.812, 2.3], [-5.81, 2.3]),
        ] {
            let image_m = image_along(images, &[wall]).unwrap();
            assert!(length(sub(image_m, mirrored_m)) < 1e-9, "wall {wall}: {image_m:?}");
            assert!(length(sub(image_m, published_m)) < MERGE_M, "wall {wall}: {image_m:?}");
        }
    }

    #[test]
    fn the_published_image_at_13_84_m_is_a_double_bounce_off_a_plane_at_0_m_and_the_projecting_wall() {
        // By way of the west wall, at -0.306 m, it is at 14.452 m: 61 cm off.
        let mut walls = seminar_room();
        let anchor_m = [5.2, 2.3];
        let by_west = image_along(&image_sources(&walls, anchor_m, 2), &[5, 3]).unwrap();
        assert!(length(sub(by_west, [14.452, 2.3])) < 1e-9, "{by_west:?}");
        walls.push(wall([0.0, 0.0], [0.0, 8.547]));
        let by_plane = image_along(&image_sources(&walls, anchor_m, 2), &[6, 3]).unwrap();
        assert!(length(sub(by_plane, [13.84, 2.3])) < 1e-9, "{by_plane:?}");
    }

    #[test]
    fn a_rectangle_has_4_k_images_of_order_k_on_its_lattice() {
        let [x, y] = [1.3, 0.9];
        let walls = polygon(&[[0.0, 0.0], [5.0, 0.0], [5.0, 3.0], [0.0, 3.0]]);
        let images = image_sources(&walls, [x, y], MAX_ORDER);
        for order in 0..=MAX_ORDER {
            let count = images.iter().filter(|image| image.order == order).count();
            assert_eq!(count, (4 * order).max(1), "order {order}");
        }
        for image in &images {
            let on_lattice = |value: f64, width: f64, source: f64| {
                [source, -source].into_iter().find_map(|first| {
                    let copies = (value - first) / (2.0 * width);
                    let reflections = 2.0 * copies.round() - if first == source { 0.0 } else { 1.0 };
                    ((copies - copies.round()).abs() < 1e-9).then_some(reflections.abs() as usize)
                })
            };
            let [across, up] = [
                on_lattice(image.position_m[0], 5.0, x).unwrap(),
                on_lattice(image.position_m[1], 3.0, y).unwrap(),
            ];
            assert_eq!(across + up, image.order, "{image:?}");
        }
    }

    #[test]
    fn images_at_right_angles_and_in_walls_of_one_plane_are_merged() {
        let corners_m = [[0.0, 0.0], [2.0, 0.0], [5.0, 0.0], [5.0, 3.0], [0.0, 3.0]];
        let images = image_sources(&polygon(&corners_m), [1.3, 0.9], 2);
        // As many as without the corner in the middle of the south side.
        assert_eq!(images.len(), 13);
        let south = &images[1];
        assert_eq!((south.order, south.sequences.clone()), (1, vec![vec![0], vec![1]]));
        let north_east = images.iter().find(|image| image.sequences.contains(&vec![2, 3])).unwrap();
        assert_eq!(north_east.sequences, [[2, 3], [3, 2]]);
        assert_eq!(north_east.order, 2);
    }

    #[test]
    fn an_image_next_to_a_shorter_one_is_merged_with_it_whatever_its_order() {
        let walls = [wall([-1.0, 0.0], [1.0, 0.0])];
        let images = image_sources(&walls, [0.0, 0.004], 1);
        assert_eq!(
            images,
            [ImageSource { position_m: [0.0, 0.004], sequences: vec![vec![], vec![0]], order: 0 }]
        );
        assert_eq!(image_sources(&walls, [0.0, 0.006], 1).len(), 2);
    }

    #[test]
    fn walls_in_the_anchors_plane_or_without_length_make_no_image() {
        let walls =
            [wall([1.0, 2.0], [3.0, 2.0]), wall([0.0, 1.0], [0.0, 1.0]), wall([3.0, 0.0], [3.0, 1.0])];
        let images = image_sources(&walls, [0.5, 2.0], 1);
        assert_eq!(images.len(), 2);
        assert_eq!(images[1].sequences, [[2]]);
    }

    #[test]
    fn both_sides_of_a_free_wall_reflect() {
        let walls = [wall([-1.0, 0.0], [1.0, 0.0])];
        for y in [1.0, -1.0] {
            assert_eq!(image_sources(&walls, [0.2, y], 1)[1].position_m, [0.2, -y]);
        }
    }

    #[test]
    fn images_come_by_order_and_then_by_sequence() {
        let images = image_sources(&room_of_ten_walls(), [4.0, 5.0], 4);
        assert!(images[0].sequences == [Vec::<usize>::new()] && images[0].position_m == [4.0, 5.0]);
        let keys: Vec<_> = images.iter().map(|image| (image.order, &image.sequences[0])).collect();
        assert!(keys.is_sorted());
        for image in &images {
            assert_eq!(image.order, image.sequences[0].len());
            assert!(image.sequences.is_sorted_by_key(|sequence| (sequence.len(), sequence)));
        }
        assert_eq!(images, image_sources(&room_of_ten_walls(), [4.0, 5.0], 4));
    }

    /// Counts, because times differ from machine to machine.
    #[test]
    fn clipping_keeps_the_number_of_sequences_small() {
        let walls = room_of_ten_walls();
        let mut counts = [0; 7];
        for image in image_sources(&walls, [4.0, 5.0], 6) {
            for sequence in &image.sequences {
                counts[sequence.len()] += 1;
            }
        }
        println!("sequences of order 0 to 6 in a room of ten walls: {counts:?}");
        assert!(counts[6] > 0 && counts[6] < 10 * 9_usize.pow(5) / 10, "{counts:?}");
    }
}
