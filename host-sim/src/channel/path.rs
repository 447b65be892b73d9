//! Paths: which exist between an anchor and the tag, how long they are, and what walls, antennas and people leave of
//! them.
//!
//! Walls are vertical: a path runs in the plan as its horizontal projection and climbs evenly, so that with a length
//! l in the plan and a difference h in height it is sqrt(l^2 + h^2) long, and meets each wall at an angle whose cosine
//! is that in the plan times l / sqrt(l^2 + h^2).

use super::SPEED_OF_LIGHT_M_S;
use super::person::shadow;
use super::wall::WallTable;
use crate::geometry::image_source::ImageSource;
use crate::geometry::trajectory::{Pose, person_at};
use crate::geometry::visibility::{Ray, trace_image};
use crate::geometry::{Wall, distance_m};
use crate::scenario::{Antenna, ObstructedPaths, Obstruction, Person, Scenario};
use rustfft::num_complex::Complex64;

/// A path between an anchor and the tag.
#[derive(Clone, Debug)]
pub struct Path {
    source: usize,
    anchor: usize,
    delay_s: f64,
    gain: f64,
    sin_elevation: f64,
    points_m: Vec<[f64; 2]>,
    /// Construction and cosine of incidence of each reflection, then of each wall passed through.
    reflected: Vec<(usize, f64)>,
    passed: Vec<(usize, f64)>,
}

/// What paths depend on.
pub(super) struct PathContext<'a> {
    pub(super) scenario: &'a Scenario,
    pub(super) walls: &'a [Wall],
    pub(super) images: &'a [ImageSource],
    pub(super) anchor: usize,
    pub(super) pose: &'a Pose,
    pub(super) tag_height_m: f64,
    /// Share of the way that lies behind.
    pub(super) share: f64,
}

/// All paths, the direct one first where it exists, then by image source.
pub(super) fn paths(context: &PathContext<'_>) -> Vec<Path> {
    let PathContext { scenario, walls, images, anchor, pose, .. } = context;
    let from_m = scenario.anchors[*anchor].position_m;
    let transmissions = scenario.propagation.transmissions;
    let seen = images.iter().enumerate().filter_map(|(source, image)| {
        Some((source, trace_image(walls, from_m, image, pose.position_m, transmissions)?))
    });
    seen.map(|(source, ray)| Path::new(context, source, ray)).collect()
}

impl Path {
    fn new(context: &PathContext<'_>, source: usize, ray: Ray) -> Self {
        let scenario = context.scenario;
        let in_plan_m = ray.length_m();
        let rise_m = context.tag_height_m - scenario.anchors[context.anchor].height_m;
        // An anchor right at the tag still has a wavefront.
        let length_m = (in_plan_m * in_plan_m + rise_m * rise_m).sqrt().max(0.01);
        let level = in_plan_m / length_m;
        let name = &scenario.anchors[context.anchor].name;
        let applies = |obstruction: &&Obstruction| {
            let [from, to] = obstruction.during.0;
            (from..to).contains(&context.share)
                && (obstruction.anchors.is_empty() || obstruction.anchors.contains(name))
                && (obstruction.paths == ObstructedPaths::All || source == 0)
        };
        let (mut detour_m, mut loss_db) = (0.0, 0.0);
        for obstruction in scenario.obstructions.iter().filter(applies) {
            detour_m += obstruction.excess_m;
            loss_db += obstruction.loss_db;
        }
        let at_walls = |crossings: &[crate::geometry::visibility::Crossing]| {
            let at = |c: &crate::geometry::visibility::Crossing| {
                (context.walls[c.wall].construction, c.cos_incidence * level)
            };
            crossings.iter().map(at).collect()
        };
        Self {
            source,
            anchor: context.anchor,
            delay_s: (length_m + detour_m) / SPEED_OF_LIGHT_M_S,
            gain: libm::pow(10.0, -loss_db / 20.0) / length_m,
            sin_elevation: rise_m / length_m,
            reflected: at_walls(&ray.reflections),
            passed: at_walls(&ray.crossed),
            points_m: ray.points_m,
        }
    }

    /// Index of its image source; 0: the direct path.
    pub fn source(&self) -> usize {
        self.source
    }

    /// Delay of propagation, seconds.
    pub fn delay_s(&self) -> f64 {
        self.delay_s
    }

    /// Anchor, points of reflection, tag, in the plan, metres.
    pub fn points_m(&self) -> &[[f64; 2]] {
        &self.points_m
    }

    /// Amplitude over that of 1 m of free space, before walls and antennas.
    pub(super) fn gain(&self) -> f64 {
        self.gain
    }

    /// What people leave of the amplitude at a time and frequency.
    pub(super) fn shadow(&self, people: &[Person], time_s: f64, frequency_hz: f64) -> f64 {
        let of = |person: &Person| {
            let person_m = person_at(&person.way_m, person.speed_m_s, time_s);
            let legs = self.points_m.windows(2);
            legs.map(|leg| shadow(leg[0], leg[1], person_m, person.width_m, frequency_hz)).product::<f64>()
        };
        people.iter().map(of).product()
    }

    /// Multiplies by both antennas' gains; `frequency_hz(n)` is that of entry n.
    pub(super) fn apply_antennas(
        &self,
        scenario: &Scenario,
        spectrum: &mut [Complex64],
        frequency_hz: impl Fn(usize) -> f64,
    ) {
        let &[first, second, ..] = self.points_m.as_slice() else { return };
        let &[.., before_last, last] = self.points_m.as_slice() else { return };
        let ends: [(&Antenna, [f64; 2], f64); 2] = [
            (&scenario.anchors[self.anchor].antenna, direction(first, second), self.sin_elevation),
            (&scenario.tag.antenna, direction(last, before_last), -self.sin_elevation),
        ];
        for (antenna, direction, sin_elevation) in ends {
            if antenna.is_flat() {
                let gain = antenna.gain(direction, sin_elevation, super::REFERENCE_HZ);
                if gain != 1.0 {
                    spectrum.iter_mut().for_each(|value| *value *= gain);
                }
            } else {
                for (n, value) in spectrum.iter_mut().enumerate() {
                    *value *= antenna.gain(direction, sin_elevation, frequency_hz(n));
                }
            }
        }
    }

    /// Multiplies by the response of every wall on the way; entry 0 is entry `first` of the tables.
    pub(super) fn apply_walls(&self, tables: &[WallTable], spectrum: &mut [Complex64], first: usize) {
        for &(construction, cosine) in &self.reflected {
            tables[construction].apply(spectrum, first, cosine, |response| response.reflection);
        }
        for &(construction, cosine) in &self.passed {
            tables[construction].apply(spectrum, first, cosine, |response| response.transmission);
        }
    }

    /// Whether no wall on the way changes the pulse's shape.
    pub(super) fn is_mirrored_unchanged(&self, tables: &[WallTable]) -> bool {
        self.reflected.iter().chain(&self.passed).all(|&(construction, _)| tables[construction].is_flat())
    }
}

/// Unit vector; along x where the points coincide.
fn direction(from: [f64; 2], to: [f64; 2]) -> [f64; 2] {
    let length = distance_m(from, to);
    if length < 1e-12 { [1.0, 0.0] } else { [(to[0] - from[0]) / length, (to[1] - from[1]) / length] }
}
