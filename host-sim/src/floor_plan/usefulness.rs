//! Which sources of a plan are worth being told, judged by the plan alone: no way through the room enters.
//!
//! About [`PLACES`] places on a grid stand for the outline. At each, a source has the signal-to-noise ratio that the
//! plan predicts: its path is traced along the plan's segments, passes through at most `propagation.transmissions`
//! walls, and loses what the constructions reflect and let through on average over the first action's band:
//!
//! SNR = SNR_1m (7 GHz / f)^2 / d^2 G_anchor^2 G_tag^2 prod |Gamma|^2 prod |T|^2 min((d - d_0) / (c Tp), 1)^2,
//!
//! 0 where there is no path. The last factor leaves of a path what the direct one, d_0 long, does not cover: the image in
//! the wall that an anchor hangs on is strong everywhere and tells next to nothing.
//!
//! The usefulness of a source is the mean of ln(1 + SNR) over all places, in nat: what its path could tell if noise were
//! the only disturbance. Sources seen from a larger part of the outline come before rarely seen ones, stronger before
//! weaker, and ten times the power makes up for no more than it should.

use crate::channel::wall::Slab;
use crate::channel::{REFERENCE_HZ, SPEED_OF_LIGHT_M_S, power_of};
use crate::geometry::visibility::{Ray, trace};
use crate::geometry::{Wall, distance_m, polygon};
use crate::recording::WallSequence;
use crate::scenario::{Anchor, Polarisation, Scenario};
use rayon::prelude::*;

use super::sources::Candidate;

/// Places that stand for an outline, about.
pub const PLACES: usize = 400;
/// A source whose mean SNR over the outline is below this is none.
const FAINTEST_SNR: f64 = 1e-3;
/// Carriers over which a wall's losses are averaged.
const CARRIERS: usize = 5;
/// Cosines of incidence in a table of losses, but one.
const COSINES: usize = 64;

/// How useful a source is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Usefulness {
    /// The order in which its walls are met from most of the places.
    pub walls: WallSequence,
    /// Mean of ln(1 + SNR) over the outline, nat.
    pub nat: f64,
    /// Share of the outline from which it is seen.
    pub seen_share: f64,
}

/// Places on a square grid inside an outline, metres: [`PLACES`] of them if it were a rectangle.
pub fn places_m(outline_m: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let bound = |axis: usize, pick: fn(f64, f64) -> f64, start: f64| {
        outline_m.iter().map(|corner| corner[axis]).fold(start, pick)
    };
    let low = [bound(0, f64::min, f64::INFINITY), bound(1, f64::min, f64::INFINITY)];
    let high = [bound(0, f64::max, f64::NEG_INFINITY), bound(1, f64::max, f64::NEG_INFINITY)];
    let step_m = (polygon_area_m2(outline_m) / PLACES as f64).sqrt();
    if !(step_m > 0.0) {
        return Vec::new();
    }
    // No more steps than a thin diagonal room needs; the corners of a plan are bounded by its reader.
    let steps = |axis: usize| ((high[axis] - low[axis]) / step_m).ceil().min(20.0 * PLACES as f64) as usize;
    let at = |axis: usize, n: usize| low[axis] + (n as f64 + 0.5) * step_m;
    let all = (0..steps(1)).flat_map(|y| (0..steps(0)).map(move |x| (x, y)));
    all.map(|(x, y)| [at(0, x), at(1, y)]).filter(|&place_m| polygon::contains(outline_m, place_m)).collect()
}

/// Area of a polygon, m².
fn polygon_area_m2(corners_m: &[[f64; 2]]) -> f64 {
    let after = corners_m.iter().cycle().skip(1);
    let twice: f64 = corners_m.iter().zip(after).map(|(a, b)| a[0] * b[1] - a[1] * b[0]).sum();
    0.5 * twice.abs()
}

/// Predicts strengths over the plan of a scenario.
pub struct Prediction<'a> {
    scenario: &'a Scenario,
    /// Segments of the plan; each construction is an index of the losses.
    segments: &'a [Wall],
    losses: Vec<Losses>,
    carrier_hz: f64,
    pulse_length_m: f64,
}

impl<'a> Prediction<'a> {
    /// For the segments of a plan, whose constructions count `slabs`.
    pub fn new(scenario: &'a Scenario, segments: &'a [Wall], slabs: &[Slab]) -> Self {
        let action = scenario.radio.actions()[scenario.radio.first_action()];
        let spacing_hz = 1.0 / (action.pulse_duration_s * CARRIERS as f64);
        let middle = 0.5 * (CARRIERS - 1) as f64;
        let carriers_hz: Vec<f64> =
            (0..CARRIERS).map(|n| action.carrier_hz + (n as f64 - middle) * spacing_hz).collect();
        let polarisation = scenario.propagation.polarisation;
        let losses = slabs.iter().map(|slab| Losses::new(slab, &carriers_hz, polarisation)).collect();
        Self {
            scenario,
            segments,
            losses,
            carrier_hz: action.carrier_hz,
            pulse_length_m: SPEED_OF_LIGHT_M_S * action.pulse_duration_s,
        }
    }

    /// How useful each candidate of an anchor is over the places; none for those never seen, or too faint to matter.
    pub fn usefulness(
        &self,
        anchor: &Anchor,
        candidates: &[Candidate],
        places_m: &[[f64; 2]],
    ) -> Vec<Option<Usefulness>> {
        let at_place = |place_m: &[f64; 2]| -> Vec<(usize, usize, f64)> {
            let seen = candidates.iter().enumerate().filter_map(|(index, candidate)| {
                let (sequence, snr) = self.strongest(anchor, candidate, *place_m)?;
                Some((index, sequence, snr))
            });
            seen.collect()
        };
        let seen: Vec<_> = places_m.par_iter().map(at_place).collect();
        // Sums in the order of the places, whatever the threads.
        let mut sums = vec![([0_usize; 2], 0.0, 0.0); candidates.len()];
        for &(index, sequence, snr) in seen.iter().flatten() {
            let (counts, nat, total) = &mut sums[index];
            counts[sequence.min(1)] += 1;
            *nat += libm::log1p(snr);
            *total += snr;
        }
        let count = places_m.len() as f64;
        let of = |(candidate, (counts, nat, total)): (&Candidate, ([usize; 2], f64, f64))| {
            let most = usize::from(counts[1] > counts[0]);
            (total > FAINTEST_SNR * count).then(|| Usefulness {
                walls: candidate.sequences[most],
                nat: nat / count,
                seen_share: (counts[0] + counts[1]) as f64 / count,
            })
        };
        candidates.iter().zip(sums).map(of).collect()
    }

    /// The strongest of the candidate's paths to a place: index of its sequence, and its SNR.
    fn strongest(&self, anchor: &Anchor, candidate: &Candidate, place_m: [f64; 2]) -> Option<(usize, f64)> {
        let transmissions = self.scenario.propagation.transmissions;
        let snr_of = |(sequence, way): &(usize, Vec<usize>)| {
            let ray = trace(self.segments, anchor.position_m, way, place_m, transmissions)?;
            Some((*sequence, self.snr(anchor, &ray)))
        };
        candidate.ways.iter().filter_map(snr_of).max_by(|a, b| a.1.total_cmp(&b.1))
    }

    fn snr(&self, anchor: &Anchor, ray: &Ray) -> f64 {
        let in_plan_m = ray.length_m();
        let rise_m = self.scenario.tag.height_m - anchor.height_m;
        // A place right at the anchor still has a wavefront, as in the channel.
        let length_m = (in_plan_m * in_plan_m + rise_m * rise_m).sqrt().max(0.01);
        let (level, sin_elevation) = (in_plan_m / length_m, rise_m / length_m);
        let losses = |segment: usize| &self.losses[self.segments[segment].construction];
        let reflected: f64 =
            ray.reflections.iter().map(|at| losses(at.wall).reflected(at.cos_incidence * level)).product();
        let passed: f64 =
            ray.crossed.iter().map(|at| losses(at.wall).passed(at.cos_incidence * level)).product();
        let ends_m = [ray.points_m[0], ray.points_m[ray.points_m.len() - 1]];
        let direct_m = distance_m(ends_m[0], ends_m[1]).hypot(rise_m);
        let clear = ((length_m - direct_m) / self.pulse_length_m).clamp(0.0, 1.0);
        let [first, last] = [[0, 1], [ray.points_m.len() - 1, ray.points_m.len() - 2]]
            .map(|[at, next]| direction(ray.points_m[at], ray.points_m[next]));
        let gain = anchor.antenna.gain(first, sin_elevation, self.carrier_hz)
            * self.scenario.tag.antenna.gain(last, -sin_elevation, self.carrier_hz)
            * (REFERENCE_HZ / self.carrier_hz)
            / length_m;
        power_of(self.scenario.noise.snr_at_1_m_db) * gain * gain * reflected * passed * clear * clear
    }
}

/// Unit vector; along x where the points coincide.
fn direction(from: [f64; 2], to: [f64; 2]) -> [f64; 2] {
    let [x, y] = [to[0] - from[0], to[1] - from[1]];
    let length = (x * x + y * y).sqrt();
    if length < 1e-12 { [1.0, 0.0] } else { [x / length, y / length] }
}

/// Power that a construction reflects and lets through, averaged over a band, by the cosine of incidence.
struct Losses {
    reflected: [f64; COSINES + 1],
    passed: [f64; COSINES + 1],
}

impl Losses {
    fn new(slab: &Slab, carriers_hz: &[f64], polarisation: Polarisation) -> Self {
        let mut losses = Self { reflected: [0.0; COSINES + 1], passed: [0.0; COSINES + 1] };
        let share = 1.0 / carriers_hz.len() as f64;
        for (n, (reflected, passed)) in losses.reflected.iter_mut().zip(&mut losses.passed).enumerate() {
            for &carrier_hz in carriers_hz {
                let response = slab.response(carrier_hz, n as f64 / COSINES as f64, polarisation);
                *reflected += share * response.reflection.norm_sqr();
                *passed += share * response.transmission.norm_sqr();
            }
        }
        losses
    }

    fn reflected(&self, cosine: f64) -> f64 {
        between(&self.reflected, cosine)
    }

    fn passed(&self, cosine: f64) -> f64 {
        between(&self.passed, cosine)
    }
}

fn between(table: &[f64; COSINES + 1], cosine: f64) -> f64 {
    let place = cosine.clamp(0.0, 1.0) * COSINES as f64;
    let below = (place as usize).min(COSINES - 1);
    let share = place - below as f64;
    table[below] * (1.0 - share) + table[below + 1] * share
}

#[cfg(test)]
mod tests {
    use super::super::sources::candidates;
    use super::super::walls::segments;
    use super::*;
    use crate::recording::PlanWall;

    #[test]
    fn places_fill_the_outline_evenly_and_stay_inside() {
        let outline_m = [[0.0, 0.0], [10.0, 0.0], [10.0, 4.0], [5.0, 4.0], [5.0, 8.0], [0.0, 8.0]];
        let places_m = places_m(&outline_m);
        assert!(places_m.len().abs_diff(PLACES) < PLACES / 10, "{}", places_m.len());
        let in_upper_leg = places_m.iter().filter(|place| place[1] > 4.0).count() as f64;
        assert!((in_upper_leg / places_m.len() as f64 - 20.0 / 60.0).abs() < 0.03);
        assert!(places_m.iter().all(|place| place[0] < 5.0 || place[1] < 4.0));
    }

    /// A room of 6 m by 4 m with flat walls of two losses.
    fn scenario() -> Scenario {
        let text = r#"
            format = 1
            name = "Small"
            room = { corners_m = [[0, 0], [6, 0], [6, 4], [0, 4]] }
            anchors = [{ name = "A", position_m = [1.0, 1.0] }]
            trajectories = [{ way.polyline = { vertices_m = [[1.0, 3.0], [5.0, 3.0]], step_m = 0.1 } }]
        "#;
        Scenario::parse(text, "small.toml").expect("is valid")
    }

    fn told(walls: &[PlanWall], slabs: &[Slab], places_m: &[[f64; 2]]) -> Vec<Option<Usefulness>> {
        let scenario = scenario();
        let anchor = &scenario.anchors[0];
        let segments = segments(walls);
        let found = candidates(walls, anchor.position_m, 1);
        Prediction::new(&scenario, &segments, slabs).usefulness(anchor, &found, places_m)
    }

    fn wall(from_m: [f64; 2], to_m: [f64; 2]) -> PlanWall {
        PlanWall {
            segments_m: vec![[from_m, to_m]],
            offset_std_m: 0.05,
            rotation_std_rad: 0.01,
            construction: String::new(),
        }
    }

    #[test]
    fn the_usefulness_of_one_wall_at_one_place_is_that_of_its_path() {
        let walls = [wall([0.0, 0.0], [6.0, 0.0])];
        let slab = Slab::Flat { reflection: -0.5, transmission: 0.0 };
        let found = told(&walls, &[slab], &[[4.0, 3.0], [60.0, 3.0]]);
        // From (1, -1) to (4, 3) it is 5 m, with a quarter of the power; from the other place it misses the wall.
        let snr = 1e4 * 0.25 / 25.0;
        let Usefulness { nat, seen_share, .. } = found[0].expect("is seen");
        assert!((nat - 0.5 * f64::ln(1.0 + snr)).abs() < 1e-9, "{nat}");
        assert_eq!(seen_share, 0.5);
    }

    #[test]
    fn an_image_within_a_pulse_of_its_anchor_is_hardly_of_use() {
        // The anchor, at (1, 1), is 2 cm off: its image comes 4 cm behind it, where a pulse is 15 cm long.
        let slab = || Slab::Flat { reflection: -1.0, transmission: 0.0 };
        let place_m = [[1.0, 3.0]];
        let close = told(&[wall([0.0, 0.98], [6.0, 0.98])], &[slab()], &place_m)[0].expect("is seen");
        let far = told(&[wall([0.0, 0.5], [6.0, 0.5])], &[slab()], &place_m)[0].expect("is seen");
        let pulse_m = SPEED_OF_LIGHT_M_S * 0.5e-9;
        let snr = |length_m: f64, clear: f64| 1e4 / (length_m * length_m) * clear * clear;
        assert!((close.nat - f64::ln(1.0 + snr(2.04, 0.04 / pulse_m))).abs() < 1e-9, "{}", close.nat);
        assert!((far.nat - f64::ln(1.0 + snr(3.0, 1.0))).abs() < 1e-9, "{}", far.nat);
    }

    #[test]
    fn a_wall_in_the_way_hides_a_source_and_a_faint_one_is_none() {
        let walls = [wall([0.0, 0.0], [6.0, 0.0]), wall([0.0, 2.0], [6.0, 2.0])];
        let mirror = || Slab::Flat { reflection: -1.0, transmission: 1.0 };
        let found = told(&walls, &[mirror(), mirror()], &[[4.0, 3.0]]);
        assert_eq!(found, [None, None]);
        let faint = Slab::Flat { reflection: -1e-5, transmission: 1.0 };
        assert_eq!(told(&walls[..1], &[faint], &[[4.0, 3.0]]), [None]);
    }
}
