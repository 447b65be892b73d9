//! The state that [`super::told`] filters and the bounds count on: the tag, the anchors' biases, and the map as the
//! plan knows it.
//!
//! State: position p and velocity v of the tag; a range bias per anchor, where the set-up tells of one; per wall of the
//! plan that reflects a told path its offset along its normal and its rotation about its centre; and the deviation of
//! every virtual anchor of which no walls are told. Prior: independent, with the deviations told. So all images in a wall err
//! together, by the mirror's slopes over the wall's errors.
//!
//! A wall with unit normal u0 and tangent t0 through c, offset o, turned by theta, mirrors a point m into
//! m - 2 s u with u = u0 cos theta + t0 sin theta, t = perp u, s = u.(m - c) - o;
//! the slopes are d/do = 2 u and d/dtheta = -2 (q u + s t) with q = t.(m - c), and what came in from the
//! mirrors before is multiplied by 1 - 2 u u'.

use super::Source;
use crate::recording::{PlanWall, Recording};
use crate::replay::Setup;

/// Least deviation of what is told without one, metres and radians: the told position's digits.
const LEAST_STD: f64 = 1e-6;
/// Where the position, the velocity and what is constant begin in the state.
pub(crate) const VELOCITY: usize = 2;
pub(crate) const CONSTANTS: usize = 4;

/// A mirror: a wall of the plan in the state.
#[derive(Clone, Copy, Debug)]
struct Mirror {
    normal: [f64; 2],
    centre_m: [f64; 2],
    /// Its offset in the state; its rotation follows.
    index: usize,
}

/// Where the paths of a virtual anchor come from.
#[derive(Clone, Debug)]
enum Image {
    /// Reflections of the anchor, in order.
    Mirrored { walls: Vec<Mirror>, correction_m: [f64; 2] },
    /// A position with an error of its own, in the state.
    Free { told_m: [f64; 2], index: usize },
}

/// Layout and prior of the state.
#[derive(Clone, Debug)]
pub(crate) struct Map {
    anchors_m: Vec<[f64; 2]>,
    biased: bool,
    images: Vec<Option<Image>>,
    /// Prior means and deviations of the whole state.
    pub(crate) prior: Vec<[f64; 2]>,
    /// Density of the white acceleration's power per axis, m^2/s^3.
    pub(crate) acceleration_density: f64,
}

/// Where a source is, and how its position follows from the state.
#[derive(Clone, Debug)]
pub(crate) struct Place {
    pub(crate) position_m: [f64; 2],
    /// Index in the state and slope of the position over it.
    pub(crate) slopes: Vec<(usize, [f64; 2])>,
}

/// A range as the state has it.
#[derive(Clone, Debug)]
pub(crate) struct Look {
    pub(crate) range_m: f64,
    /// Slope over the state, by index.
    pub(crate) slope: Vec<(usize, f64)>,
    /// Mean and variance that the curvature adds, metres and square metres.
    pub(crate) curved_m: f64,
    pub(crate) curved_m2: f64,
}

impl Map {
    /// The state of a recording: of the virtual anchors that `wanted` takes, with the deviation `std_m` of those of which the
    /// tracker is not told.
    pub(crate) fn new(
        recording: &Recording,
        setup: &Setup,
        wanted: impl Fn(usize) -> Option<Wanted>,
    ) -> Self {
        let start = &setup.config.start;
        let mut prior: Vec<[f64; 2]> = start
            .position_m
            .iter()
            .map(|&x| [f64::from(x), f64::from(start.position_std_m)])
            .chain([[0.0, f64::from(start.velocity_std_m_s)]; 2])
            .collect();
        let ranging = &setup.config.ranging;
        let biased = ranging.bias_std_m > 0.0;
        if biased {
            let bias = [f64::from(ranging.bias_mean_m), f64::from(ranging.bias_std_m)];
            prior.extend(setup.anchors.iter().map(|_| bias));
        }
        let plan_walls = recording.plan.as_ref().map_or(&[][..], |plan| &plan.walls[..]);
        let mut walls: Vec<Option<Mirror>> = vec![None; plan_walls.len()];
        let mut images = Vec::new();
        for (index, va) in recording.virtual_anchors.iter().enumerate() {
            let Some(wanted) = wanted(index) else {
                images.push(None);
                continue;
            };
            let told_m = va.told_position_m.unwrap_or(va.position_m);
            let sequence: Vec<usize> = va.walls.iter().collect();
            if sequence.is_empty() || sequence.iter().any(|&wall| wall >= plan_walls.len()) {
                let std_m = match wanted {
                    Wanted::Told if setup.config.exact_map => LEAST_STD,
                    Wanted::Told => va.std_m.max(LEAST_STD),
                    Wanted::Unknown { std_m } => std_m,
                };
                images.push(Some(Image::Free { told_m, index: prior.len() }));
                prior.extend([[0.0, std_m]; 2]);
                continue;
            }
            let mirrors: Vec<Mirror> = sequence
                .iter()
                .map(|&wall| *walls[wall].get_or_insert_with(|| mirror(&plan_walls[wall], &mut prior)))
                .collect();
            let anchor_m = recording.anchors[va.anchor].position_m;
            let mirrored = reflected(anchor_m, &mirrors, |_| 0.0).position_m;
            // What is told is rounded, or was made by a program of other tolerances.
            let correction_m = match wanted {
                Wanted::Told => [told_m[0] - mirrored[0], told_m[1] - mirrored[1]],
                Wanted::Unknown { .. } => [0.0; 2],
            };
            images.push(Some(Image::Mirrored { walls: mirrors, correction_m }));
        }
        Self {
            anchors_m: recording.anchors.iter().map(|anchor| anchor.position_m).collect(),
            biased,
            images,
            prior,
            acceleration_density: f64::from(setup.config.motion.acceleration_density_m2_s3),
        }
    }

    /// Of the virtual anchors that the tracker is told alone.
    pub(crate) fn told(recording: &Recording, setup: &Setup) -> Self {
        let told = |index: usize| recording.virtual_anchors[index].known && setup.tells_images();
        Self::new(recording, setup, |index| told(index).then_some(Wanted::Told))
    }

    /// Number of states.
    pub(crate) fn states(&self) -> usize {
        self.prior.len()
    }

    /// States of what a source's position follows from; none where it is not in the map.
    pub(crate) fn place(&self, anchor: usize, source: Source, state: &[f64]) -> Option<Place> {
        match source {
            Source::Direct => Some(Place { position_m: *self.anchors_m.get(anchor)?, slopes: Vec::new() }),
            Source::Virtual(index) => match self.images.get(index)?.as_ref()? {
                Image::Free { told_m: [x, y], index } => Some(Place {
                    position_m: [x + state[*index], y + state[index + 1]],
                    slopes: vec![(*index, [1.0, 0.0]), (index + 1, [0.0, 1.0])],
                }),
                Image::Mirrored { walls, correction_m } => {
                    let mut place = reflected(*self.anchors_m.get(anchor)?, walls, |index| state[index]);
                    place.position_m[0] += correction_m[0];
                    place.position_m[1] += correction_m[1];
                    Some(place)
                }
            },
        }
    }

    /// The slope of the range of a source at `place` over the state, by index.
    pub(crate) fn slope(
        &self,
        anchor: usize,
        place: &Place,
        rise_m: f64,
        state: &[f64],
    ) -> Vec<(usize, f64)> {
        let [x, y] = [state[0] - place.position_m[0], state[1] - place.position_m[1]];
        let range_m = (x * x + y * y + rise_m * rise_m).sqrt().max(1e-6);
        let e = [x / range_m, y / range_m];
        let mut slope = vec![(0, e[0]), (1, e[1])];
        slope.extend(place.slopes.iter().map(|&(index, [u, v])| (index, -(e[0] * u + e[1] * v))));
        if self.biased {
            slope.push((CONSTANTS + anchor, 1.0));
        }
        slope
    }

    /// The range of a source at `place` as the state has it, with the covariance (row by row) for the second order.
    pub(crate) fn look(
        &self,
        anchor: usize,
        place: &Place,
        rise_m: f64,
        state: &[f64],
        covariance: &[f64],
    ) -> Look {
        let [x, y] = [state[0] - place.position_m[0], state[1] - place.position_m[1]];
        let range_m = (x * x + y * y + rise_m * rise_m).sqrt().max(1e-6);
        let e = [x / range_m, y / range_m];
        // d = p - m over the state.
        let mut d: Vec<(usize, [f64; 2])> = vec![(0, [1.0, 0.0]), (1, [0.0, 1.0])];
        d.extend(place.slopes.iter().map(|&(index, [u, v])| (index, [-u, -v])));
        let states = self.states();
        let mut of_d = [[0.0; 2]; 2];
        for (i, a) in &d {
            for (j, b) in &d {
                let c = covariance[i * states + j];
                for (row, a) in of_d.iter_mut().zip(a) {
                    row[0] += a * c * b[0];
                    row[1] += a * c * b[1];
                }
            }
        }
        let curvature = [
            [(1.0 - e[0] * e[0]) / range_m, -e[0] * e[1] / range_m],
            [-e[0] * e[1] / range_m, (1.0 - e[1] * e[1]) / range_m],
        ];
        let mut product = [[0.0; 2]; 2];
        for i in 0..2 {
            for j in 0..2 {
                product[i][j] = curvature[i][0] * of_d[0][j] + curvature[i][1] * of_d[1][j];
            }
        }
        let square = product[0][0] * product[0][0]
            + 2.0 * product[0][1] * product[1][0]
            + product[1][1] * product[1][1];
        let bias_m = if self.biased { state[CONSTANTS + anchor] } else { 0.0 };
        Look {
            range_m: range_m + bias_m,
            slope: self.slope(anchor, place, rise_m, state),
            curved_m: 0.5 * (product[0][0] + product[1][1]),
            curved_m2: 0.5 * square,
        }
    }
}

/// What is told of a virtual anchor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Wanted {
    /// Where it is, with its deviation.
    Told,
    /// Nothing: it is where it truly is, with this deviation.
    Unknown { std_m: f64 },
}

/// A wall becomes a mirror, and its errors two more states.
fn mirror(wall: &PlanWall, prior: &mut Vec<[f64; 2]>) -> Mirror {
    let index = prior.len();
    prior.push([0.0, wall.offset_std_m.max(LEAST_STD)]);
    prior.push([0.0, wall.rotation_std_rad.max(LEAST_STD)]);
    Mirror { normal: wall.normal(), centre_m: wall.centre_m(), index }
}

/// The image of a point in mirrors one after the other, whose errors `state` tells by index.
fn reflected(point_m: [f64; 2], mirrors: &[Mirror], state: impl Fn(usize) -> f64) -> Place {
    let mut place = Place { position_m: point_m, slopes: Vec::new() };
    for mirror in mirrors {
        let (sin, cos) = state(mirror.index + 1).sin_cos();
        let [a, b] = mirror.normal;
        let u = [a * cos - b * sin, b * cos + a * sin];
        let t = [-u[1], u[0]];
        let from = [place.position_m[0] - mirror.centre_m[0], place.position_m[1] - mirror.centre_m[1]];
        let s = u[0] * from[0] + u[1] * from[1] - state(mirror.index);
        let q = t[0] * from[0] + t[1] * from[1];
        let [x, y] = place.position_m;
        place.position_m = [x - 2.0 * s * u[0], y - 2.0 * s * u[1]];
        for (_, slope) in &mut place.slopes {
            let along = u[0] * slope[0] + u[1] * slope[1];
            *slope = [slope[0] - 2.0 * along * u[0], slope[1] - 2.0 * along * u[1]];
        }
        let turn = [-2.0 * (q * u[0] + s * t[0]), -2.0 * (q * u[1] + s * t[1])];
        for (index, slope) in [(mirror.index, [2.0 * u[0], 2.0 * u[1]]), (mirror.index + 1, turn)] {
            // A path may meet a wall twice.
            match place.slopes.iter_mut().find(|(known, _)| *known == index) {
                Some((_, known)) => *known = [known[0] + slope[0], known[1] + slope[1]],
                None => place.slopes.push((index, slope)),
            }
        }
    }
    place
}
