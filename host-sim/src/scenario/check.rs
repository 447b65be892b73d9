//! What a scenario must fulfil beyond its schema: names that exist, a room that can be, ways that stay inside it, a
//! radio that can sample its pulses.

use std::path::Path;

use rustfft::FftPlanner;
use rustfft::num_complex::Complex;

use super::construction::{self, construction_names, material_names, walls};
use super::{
    Construction, Library, NamedLibrary, Part, Position, Pulse, Room, Scenario, Trajectory, Way, Window,
};
use crate::geometry::{Wall, distance_m, polygon, trajectory};
use crate::input_error::{InputError, number};
use crate::recording::npz::printable;

/// Nothing comes nearer to a wall than this, and no wall is shorter.
pub(crate) const CLEARANCE_M: f64 = 0.01;
/// The least area of a room.
const MIN_AREA_M2: f64 = 0.01;
/// The most candidates for paths: walls to the power of the reflection order.
const MAX_CANDIDATES: f64 = 1e7;
/// The most cycles of a trajectory.
const MAX_CYCLES: f64 = 1e6;
/// The share of a sampled pulse's energy that may lie outside the sampled band.
const MAX_OUT_OF_BAND: f64 = 0.01;

/// What is wrong with a scenario and where.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Fault {
    /// The key's parts; indexes count from 0.
    pub(super) key: Vec<String>,
    reason: String,
    allowed: Option<String>,
}

impl Fault {
    pub(super) fn new(key: &[String], reason: impl Into<String>) -> Self {
        Self { key: key.to_vec(), reason: reason.into(), allowed: None }
    }

    /// A fault at a key with dots between its parts.
    fn at(key: impl AsRef<str>, reason: impl Into<String>) -> Self {
        let key: Vec<String> = key.as_ref().split('.').map(str::to_owned).collect();
        Self::new(&key, reason)
    }

    pub(super) fn allowed(mut self, allowed: impl Into<String>) -> Self {
        self.allowed = Some(allowed.into());
        self
    }

    pub(super) fn in_file(self, file: &Path) -> InputError {
        let key = self.key.iter().map(|part| printable(part)).collect::<Vec<_>>().join(".");
        let error = InputError::new(file, self.reason).for_item(key);
        match self.allowed {
            Some(allowed) => error.allowed(allowed),
            None => error,
        }
    }
}

impl Room {
    /// Whether the geometry is that of a room: walls of some length that meet in single points, an outline that does
    /// not cross itself.
    pub(crate) fn is_sound(&self) -> bool {
        check_geometry("room", self).is_ok()
    }
}

impl Scenario {
    /// The first fault, if any, of a scenario that agrees with its schema.
    pub(super) fn check_meaning(&self) -> Result<(), Fault> {
        check_line("name", &self.name)?;
        for (name, built) in &self.constructions {
            let Construction::Layered { layers } = built else { continue };
            for (index, layer) in layers.iter().enumerate() {
                if construction::material(self, &layer.material).is_none() {
                    let key = ["constructions", name, "layers", &index.to_string(), "material"];
                    return Err(unknown_name(&key.map(str::to_owned), &layer.material, material_names(self)));
                }
            }
        }
        let walls = self.check_room("room", &self.room)?;
        if let Some(room) = &self.prior.floor_plan.room {
            self.check_room("prior.floor_plan.room", room)?;
        }
        self.check_anchors(&walls)?;
        for (index, trajectory) in self.trajectories.iter().enumerate() {
            self.check_trajectory(&format!("trajectories.{index}"), trajectory, &walls)?;
        }
        self.check_radio()?;
        for (index, interference) in self.interference.iter().enumerate() {
            let key = format!("interference.{index}");
            check_part(&format!("{key}.during"), interference.during)?;
            self.check_anchor_names(&format!("{key}.anchors"), &interference.anchors)?;
            let half_band_hz = 0.5 * (1.0 + interference.roll_off) / interference.pulse_duration_s;
            check_carrier(&format!("{key}.carrier_hz"), interference.carrier_hz, half_band_hz)?;
        }
        for (index, obstruction) in self.obstructions.iter().enumerate() {
            check_part(&format!("obstructions.{index}.during"), obstruction.during)?;
            self.check_anchor_names(&format!("obstructions.{index}.anchors"), &obstruction.anchors)?;
        }
        for (index, &gap) in self.lost_frames.gaps.iter().enumerate() {
            check_part(&format!("lost_frames.gaps.{index}"), gap)?;
        }
        Ok(())
    }

    fn check_room(&self, key: &str, room: &Room) -> Result<Vec<Wall>, Fault> {
        let walls = check_geometry(key, room)?;
        let sides = room.sides.iter().enumerate().map(|(index, name)| (format!("{key}.sides.{index}"), name));
        let inner = room.inner_walls.iter().enumerate();
        let inner =
            inner.map(|(n, wall)| (format!("{key}.inner_walls.{n}.construction"), &wall.construction));
        let whole = [(format!("{key}.construction"), &room.construction)];
        for (key, name) in whole.into_iter().chain(sides).chain(inner) {
            if construction::construction(self, name).is_none() {
                let key: Vec<String> = key.split('.').map(str::to_owned).collect();
                return Err(unknown_name(&key, name, construction_names(self)));
            }
        }
        let order = self.propagation.reflection_order;
        let candidates = (walls.len() as f64).powf(order as f64);
        if !(candidates <= MAX_CANDIDATES) {
            let reason = format!("is {order} with {} walls of `{key}`", walls.len());
            return Err(Fault::at("propagation.reflection_order", reason).allowed(format!(
                "at most {}: walls to the power of the order are at most {}",
                MAX_CANDIDATES.log(walls.len() as f64).floor(),
                number(MAX_CANDIDATES)
            )));
        }
        Ok(walls)
    }

    fn check_anchors(&self, walls: &[Wall]) -> Result<(), Fault> {
        for (index, anchor) in self.anchors.iter().enumerate() {
            let key = format!("anchors.{index}");
            check_line(&format!("{key}.name"), &anchor.name)?;
            if self.anchors[..index].iter().any(|other| other.name == anchor.name) {
                let reason = format!("repeats the name {:?}", printable(&anchor.name));
                return Err(Fault::at(format!("{key}.name"), reason));
            }
            self.check_position(&format!("{key}.position_m"), anchor.position_m, walls)?;
        }
        Ok(())
    }

    fn check_anchor_names(&self, key: &str, names: &[String]) -> Result<(), Fault> {
        for (index, name) in names.iter().enumerate() {
            if !self.anchors.iter().any(|anchor| anchor.name == *name) {
                let key: Vec<String> = format!("{key}.{index}").split('.').map(str::to_owned).collect();
                let known = self.anchors.iter().map(|anchor| anchor.name.as_str());
                return Err(unknown_name(&key, name, known));
            }
        }
        Ok(())
    }

    fn check_position(&self, key: &str, position_m: Position, walls: &[Wall]) -> Result<(), Fault> {
        let [x, y] = position_m;
        if !polygon::contains(&self.room.corners_m, position_m) {
            return Err(
                Fault::at(key, format!("is ({x}, {y}), outside the room")).allowed("positions inside it")
            );
        }
        for wall in walls {
            let away_m = polygon::distance_to_wall(wall, position_m);
            if !(away_m >= CLEARANCE_M) {
                let reason = format!("is ({x}, {y}), {} m from {}", number(away_m), spoken(wall));
                return Err(Fault::at(key, reason).allowed(format!("at least {CLEARANCE_M} m")));
            }
        }
        Ok(())
    }

    fn check_trajectory(&self, key: &str, trajectory: &Trajectory, walls: &[Wall]) -> Result<(), Fault> {
        if !trajectory.name.is_empty() {
            check_line(&format!("{key}.name"), &trajectory.name)?;
        }
        // Length or time of the way in cycles; rounding must not cost the last one.
        let (extent, way_key, positions): (f64, _, Vec<Position>) = match &trajectory.way {
            // Its file is checked when it is read.
            Way::Recorded { file } if file.is_empty() => {
                return Err(Fault::at(format!("{key}.way.recorded.file"), "is empty"));
            }
            Way::Recorded { .. } => return Ok(()),
            Way::Polyline { vertices_m, step_m } => {
                let length_m: f64 = vertices_m.windows(2).map(|ends| distance_m(ends[0], ends[1])).sum();
                (length_m / step_m, format!("{key}.way.polyline.vertices_m"), vertices_m.clone())
            }
            Way::Waypoints { points } => {
                let legs = points.windows(2);
                let moving =
                    legs.map(|ends| distance_m(ends[0].position_m, ends[1].position_m) / ends[0].speed_m_s);
                let time_s = moving.sum::<f64>() + points.iter().map(|point| point.pause_s).sum::<f64>();
                let positions = points.iter().map(|point| point.position_m).collect();
                (time_s / trajectory.period_s, format!("{key}.way.waypoints.points"), positions)
            }
        };
        if !(extent > 0.0) {
            return Err(Fault::at(&way_key, "leads nowhere").allowed("a way of some length"));
        }
        let has = (extent + trajectory::ROUNDING).floor() + 1.0;
        match trajectory.cycles {
            Some(cycles) if cycles as f64 > has => {
                let reason = format!("is {cycles}, more than the way has");
                return Err(Fault::at(format!("{key}.cycles"), reason).allowed(format!("1 to {has}")));
            }
            None if has > MAX_CYCLES => {
                return Err(Fault::at(&way_key, format!("has {} cycles", number(has)))
                    .allowed(format!("at most {}, or fewer by `cycles`", number(MAX_CYCLES))));
            }
            _ => {}
        }
        let entry_key = |index: usize| match trajectory.way {
            Way::Waypoints { .. } => format!("{way_key}.{index}.position_m"),
            _ => format!("{way_key}.{index}"),
        };
        self.check_position(&entry_key(0), positions[0], walls)?;
        for (index, ends) in positions.windows(2).enumerate() {
            let leg = Wall { ends_m: [ends[0], ends[1]], construction: 0 };
            // A leg that no wall is near to begins and ends on the same side of all of them.
            let Some(wall) = walls.iter().find(|wall| polygon::nearer(&leg, wall, CLEARANCE_M)) else {
                continue;
            };
            self.check_position(&entry_key(index + 1), ends[1], walls)?;
            let reason = format!("is reached through or along {}", spoken(wall));
            return Err(Fault::at(entry_key(index + 1), reason)
                .allowed(format!("legs at least {CLEARANCE_M} m from every wall")));
        }
        Ok(())
    }

    fn check_radio(&self) -> Result<(), Fault> {
        let radio = &self.radio;
        let actions = radio.actions();
        if radio.first_action() >= actions.len() {
            let reason = format!("is {} in a library of {}", radio.first_action(), actions.len());
            return Err(
                Fault::at("radio.first_action", reason).allowed(format!("0 to {}", actions.len() - 1))
            );
        }
        if let Window::FirstPath { sample } = radio.window()
            && sample >= radio.samples()
        {
            let reason = format!("is {sample} in frames of {} samples", radio.samples());
            return Err(Fault::at("radio.window.first_path.sample", reason)
                .allowed(format!("0 to {}", radio.samples() - 1)));
        }
        let spacing_s = radio.sample_spacing_s();
        let roll_off = match radio.pulse() {
            Pulse::RootRaisedCosine { roll_off } => Some(roll_off),
            Pulse::Hrp => Some(0.5),
            Pulse::Sampled { spacing_s: pulse_spacing_s, samples } => {
                check_sampled_pulse(&samples, pulse_spacing_s, spacing_s)?;
                None
            }
        };
        // These receivers limit channels 4 and 7 themselves.
        let receiver_limits = radio.library() == Library::Named(NamedLibrary::Dw1000);
        for (index, action) in actions.iter().enumerate() {
            let (key, band_hz) = match (&radio.library, roll_off) {
                (Some(Library::Listed(_)), Some(roll_off)) => (
                    format!("radio.library.{index}.pulse_duration_s"),
                    (1.0 + roll_off) / action.pulse_duration_s,
                ),
                (_, Some(roll_off)) => {
                    ("radio.sample_spacing_s".to_owned(), (1.0 + roll_off) / action.pulse_duration_s)
                }
                (_, None) => (String::new(), 1.0 / spacing_s),
            };
            let limited = receiver_limits && action.pulse_duration_s < 2e-9;
            if !(limited || spacing_s * band_hz <= 1.0 + 1e-9) {
                let reason = format!(
                    "leaves a band of {} Hz for samples {} s apart",
                    number(band_hz),
                    number(spacing_s)
                );
                return Err(Fault::at(key, reason)
                    .allowed(format!("a sample spacing of at most {} s", number(1.0 / band_hz))));
            }
            let key = match radio.library {
                Some(Library::Listed(_)) => format!("radio.library.{index}.carrier_hz"),
                _ => "radio.library".into(),
            };
            check_carrier(&key, action.carrier_hz, 0.5 * band_hz)?;
        }
        Ok(())
    }
}

/// The walls of a room whose geometry can be.
fn check_geometry(key: &str, room: &Room) -> Result<Vec<Wall>, Fault> {
    let corners_m = &room.corners_m;
    let corners_key = format!("{key}.corners_m");
    if !room.sides.is_empty() && room.sides.len() != corners_m.len() {
        let reason = format!("has {} entries for {} corners", room.sides.len(), corners_m.len());
        return Err(Fault::at(format!("{key}.sides"), reason).allowed("none, or one per corner"));
    }
    let walls: Vec<Wall> = walls(room).iter().map(|&(ends_m, _)| Wall { ends_m, construction: 0 }).collect();
    let wall_key = |index: usize| match index.checked_sub(corners_m.len()) {
        None => format!("{corners_key}.{index}"),
        Some(inner) => format!("{key}.inner_walls.{inner}"),
    };
    let wall_name = |index: usize| match index.checked_sub(corners_m.len()) {
        None => format!("side {index}"),
        Some(inner) => format!("inner wall {inner}"),
    };
    for (index, wall) in walls.iter().enumerate() {
        let length_m = distance_m(wall.ends_m[0], wall.ends_m[1]);
        if !(length_m > CLEARANCE_M) {
            return Err(Fault::at(wall_key(index), format!("begins a wall {} m long", number(length_m)))
                .allowed(format!("above {CLEARANCE_M} m")));
        }
    }
    if let Some((one, other)) = polygon::self_intersection(corners_m) {
        let reason = format!("makes side {one} cross or touch side {other}");
        return Err(Fault::at(&corners_key, reason).allowed("an outline that does not meet itself"));
    }
    let area_m2 = area_m2(corners_m);
    if !(area_m2 > MIN_AREA_M2) {
        return Err(Fault::at(&corners_key, format!("encloses {} m2", number(area_m2)))
            .allowed(format!("above {MIN_AREA_M2} m2")));
    }
    for (index, wall) in walls.iter().enumerate() {
        if let Some(other) = walls[..index].iter().position(|other| polygon::overlap(other, wall)) {
            let reason = format!("overlaps {} lengthwise", wall_name(other));
            return Err(Fault::at(wall_key(index), reason).allowed("walls that meet in single points"));
        }
    }
    Ok(walls)
}

fn check_line(key: &str, text: &str) -> Result<(), Fault> {
    if text.trim().is_empty() || text.contains(char::is_control) {
        return Err(Fault::at(key, "is empty or not on one line"));
    }
    Ok(())
}

fn check_part(key: &str, Part([from, to]): Part) -> Result<(), Fault> {
    if from < to {
        return Ok(());
    }
    Err(Fault::at(key, format!("is from {from} to {to}")).allowed("a start before the end"))
}

fn unknown_name<'a>(key: &[String], name: &str, known: impl Iterator<Item = &'a str>) -> Fault {
    let known = known.map(printable).collect::<Vec<_>>().join(", ");
    Fault::new(key, format!("is {:?}, which is not defined", printable(name))).allowed(known)
}

/// Refuses a band that reaches down to zero frequency.
fn check_carrier(key: &str, carrier_hz: f64, half_band_hz: f64) -> Result<(), Fault> {
    if carrier_hz > half_band_hz {
        return Ok(());
    }
    let reason = format!("is {} Hz with a band of {} Hz", number(carrier_hz), number(2.0 * half_band_hz));
    Err(Fault::at(key, reason).allowed("carriers above half the band"))
}

/// Refuses a pulse without energy and one wider than the band that a frame's samples can hold.
fn check_sampled_pulse(samples: &[[f64; 2]], spacing_s: f64, frame_spacing_s: f64) -> Result<(), Fault> {
    let key = "radio.pulse.samples";
    // Padded: of a short pulse, too, the spectrum is known finely enough.
    let length = (4 * samples.len()).next_power_of_two().max(4096);
    let mut spectrum: Vec<Complex<f64>> = samples.iter().map(|&[re, im]| Complex::new(re, im)).collect();
    spectrum.resize(length, Complex::default());
    FftPlanner::new().plan_fft_forward(length).process(&mut spectrum);
    let energy: f64 = spectrum.iter().map(Complex::norm_sqr).sum();
    if !(energy.is_normal()) {
        return Err(Fault::at(key, format!("has the energy {}", number(energy))).allowed("not all zero"));
    }
    let half_band_bins = 0.5 * length as f64 * spacing_s / frame_spacing_s;
    let outside = |bin: usize| bin.min(length - bin) as f64 > half_band_bins;
    let out_of_band: f64 =
        (0..length).filter(|&bin| outside(bin)).map(|bin| spectrum[bin].norm_sqr()).sum::<f64>() / energy;
    if out_of_band <= MAX_OUT_OF_BAND {
        return Ok(());
    }
    let percent = (100.0 * out_of_band).round();
    let reason = format!("has {percent} % of its energy outside the band of `radio.sample_spacing_s`");
    Err(Fault::at(key, reason).allowed(format!("at most {} %", 100.0 * MAX_OUT_OF_BAND)))
}

fn spoken(wall: &Wall) -> String {
    let [[x, y], [u, v]] = wall.ends_m;
    format!("the wall from ({x}, {y}) to ({u}, {v})")
}

/// The area that an outline encloses.
fn area_m2(corners_m: &[Position]) -> f64 {
    let next = corners_m.iter().cycle().skip(1);
    0.5 * corners_m.iter().zip(next).map(|([x, y], [u, v])| x * v - u * y).sum::<f64>().abs()
}

#[cfg(test)]
mod tests {
    use super::super::{
        Action, BUILT_IN, InnerWall, Interference, Layer, Obstruction, Profile, Strength, Waypoint,
    };
    use super::*;

    fn example() -> Scenario {
        Scenario::parse(BUILT_IN[0].text, BUILT_IN[0].name).expect("is valid")
    }

    /// The sentence about the example after a change.
    fn refusal_after(change: impl FnOnce(&mut Scenario)) -> String {
        let mut scenario = example();
        change(&mut scenario);
        scenario.check("x.toml").expect_err("is refused").to_string()
    }

    #[track_caller]
    fn assert_says(said: &str, parts: &[&str]) {
        for part in parts {
            assert!(said.contains(part), "{part:?} is missing in: {said}");
        }
    }

    fn inner(from_m: Position, to_m: Position) -> InnerWall {
        InnerWall { from_m, to_m, construction: "glass".into() }
    }

    fn polyline(scenario: &mut Scenario, vertices: &[Position]) {
        scenario.trajectories.truncate(1);
        scenario.trajectories[0].cycles = None;
        scenario.trajectories[0].way = Way::Polyline { vertices_m: vertices.to_vec(), step_m: 0.01 };
    }

    #[test]
    fn an_outline_that_crosses_itself_or_encloses_nothing_is_refused() {
        let said = refusal_after(|scenario| {
            scenario.room.sides.clear();
            scenario.room.corners_m = vec![[0.0, 0.0], [4.0, 4.0], [4.0, 0.0], [0.0, 4.0]];
        });
        assert_says(&said, &["`room.corners_m` makes side 0 cross or touch side 2"]);
        let said = refusal_after(|scenario| {
            scenario.room.sides.clear();
            scenario.room.corners_m = vec![[0.0, 0.0], [0.1, 0.0], [0.0, 0.1]];
        });
        assert_says(&said, &["encloses 0.005", "above 0.01 m2"]);
        let said = refusal_after(|scenario| {
            scenario.room.sides.clear();
            scenario.room.corners_m = vec![[0.0, 0.0], [4.0, 0.0], [4.0, 0.005], [0.0, 4.0]];
        });
        assert_says(&said, &["`room.corners_m.1` begins a wall 0.005 m long"]);
    }

    #[test]
    fn walls_that_run_along_each_other_are_refused_and_those_that_cross_are_not() {
        let along = inner([4.32, 7.0], [4.32, 5.0]);
        let said = refusal_after(|scenario| scenario.room.inner_walls.push(along));
        assert_says(&said, &["`room.inner_walls.0` overlaps side 3 lengthwise"]);
        let mut scenario = example();
        scenario.room.inner_walls = vec![inner([4.0, 5.0], [5.0, 5.0]), inner([4.5, 4.5], [4.5, 5.5])];
        scenario.check("x.toml").expect("is valid");
        let short = inner([4.0, 5.0], [4.005, 5.0]);
        let said = refusal_after(|scenario| scenario.room.inner_walls.push(short));
        assert_says(&said, &["`room.inner_walls.0`", "above 0.01 m"]);
    }

    #[test]
    fn sides_come_once_per_corner_or_not_at_all() {
        let said = refusal_after(|scenario| scenario.room.sides.truncate(5));
        assert_says(&said, &["`room.sides` has 5 entries for 6 corners"]);
    }

    #[test]
    fn names_that_are_not_defined_are_refused_with_those_that_are() {
        let said = refusal_after(|scenario| scenario.room.sides[2] = "straw".into());
        assert_says(&said, &["`room.sides.2` is \"straw\"", "drywall", "flat"]);
        let said = refusal_after(|scenario| {
            let layers = vec![Layer { material: "straw".into(), thickness_m: 0.1 }];
            scenario.constructions.insert("my.wall".into(), Construction::Layered { layers });
        });
        assert_says(&said, &["`constructions.my.wall.layers.0.material` is \"straw\"", "ceiling-board"]);
        let said = refusal_after(|scenario| {
            scenario.obstructions.push(Obstruction {
                during: Part([0.0, 1.0]),
                anchors: vec!["A1".into(), "A9".into()],
                paths: Default::default(),
                loss_db: 10.0,
                excess_m: 0.0,
            });
        });
        assert_says(&said, &["`obstructions.0.anchors.1` is \"A9\"", "allowed is A1, A2."]);
    }

    #[test]
    fn anchors_stand_inside_the_room_off_the_walls_under_names_of_their_own() {
        let said = refusal_after(|scenario| scenario.anchors[0].position_m = [5.0, 7.0]);
        assert_says(&said, &["`anchors.0.position_m` is (5, 7), outside the room"]);
        let said = refusal_after(|scenario| scenario.anchors[1].position_m = [5.77, 3.0]);
        assert_says(&said, &["`anchors.1.position_m`", "m from the wall from (5.775, 0) to (5.775, 6)"]);
        let said = refusal_after(|scenario| scenario.anchors[1].name = "A1".into());
        assert_says(&said, &["`anchors.1.name` repeats the name \"A1\""]);
        let said = refusal_after(|scenario| scenario.anchors[1].name = "A\n1".into());
        assert_says(&said, &["`anchors.1.name` is empty or not on one line"]);
    }

    #[test]
    fn ways_stay_inside_the_room_and_pass_no_wall() {
        let said = refusal_after(|scenario| polyline(scenario, &[[1.0, 1.0], [9.0, 1.0]]));
        assert_says(&said, &["`trajectories.0.way.polyline.vertices_m.1` is (9, 1), outside the room"]);
        // Both ends lie inside; the notch is between them.
        let said = refusal_after(|scenario| polyline(scenario, &[[4.0, 7.0], [5.0, 5.5]]));
        assert_says(&said, &["vertices_m.1` is reached through or along the wall"]);
        let said = refusal_after(|scenario| {
            polyline(scenario, &[[1.0, 1.0], [3.0, 1.0]]);
            scenario.room.inner_walls.push(inner([2.0, 1.005], [2.0, 2.0]));
        });
        assert_says(&said, &["reached through or along the wall from (2, 1.005) to (2, 2)"]);
        let said = refusal_after(|scenario| polyline(scenario, &[[1.0, 1.0], [1.0, 1.0]]));
        assert_says(&said, &["leads nowhere"]);
    }

    #[test]
    fn a_trajectory_has_no_more_cycles_than_its_way() {
        let set = |scenario: &mut Scenario, cycles| {
            polyline(scenario, &[[1.0, 1.0], [3.0, 1.0]]);
            scenario.trajectories[0].cycles = Some(cycles);
        };
        let mut scenario = example();
        set(&mut scenario, 201);
        scenario.check("x.toml").expect("is valid");
        let said = refusal_after(|scenario| set(scenario, 202));
        assert_says(&said, &["`trajectories.0.cycles` is 202", "1 to 201"]);
        let said = refusal_after(|scenario| {
            let point = |x, pause_s| Waypoint { position_m: [x, 1.0], speed_m_s: 1.0, pause_s };
            scenario.trajectories[0].period_s = 1e-4;
            scenario.trajectories[0].cycles = None;
            scenario.trajectories[0].way =
                Way::Waypoints { points: vec![point(1.0, 0.0), point(2.0, 100.0)] };
        });
        assert_says(&said, &["has 1.010001e6 cycles", "at most 1e6"]);
    }

    #[test]
    fn a_way_of_no_whole_number_of_steps_keeps_its_last_cycle_despite_rounding() {
        let mut scenario = example();
        polyline(&mut scenario, &[[1.0, 1.0], [1.1, 1.0], [1.2, 1.0], [1.3, 1.0]]);
        scenario.trajectories[0].cycles = Some(31);
        scenario.check("x.toml").expect("is valid");
    }

    #[test]
    fn parts_of_the_way_begin_before_they_end() {
        let said = refusal_after(|scenario| scenario.lost_frames.gaps.push(Part([0.5, 0.5])));
        assert_says(&said, &["`lost_frames.gaps.0` is from 0.5 to 0.5"]);
        let said = refusal_after(|scenario| {
            scenario.interference.push(Interference {
                carrier_hz: 7e9,
                pulse_duration_s: 0.5e-9,
                roll_off: 0.6,
                during: Part([0.7, 0.3]),
                strength: Strength::Omega1(1e-8),
                profile: Profile::default(),
                onset_s: 0.0,
                fading: Default::default(),
                anchors: Vec::new(),
            });
        });
        assert_says(&said, &["`interference.0.during` is from 0.7 to 0.3"]);
    }

    #[test]
    fn more_candidates_for_paths_than_can_be_tried_are_refused() {
        let said = refusal_after(|scenario| {
            let wall = |n| inner([4.6, 1.0 + 0.01 * f64::from(n)], [5.0, 1.0 + 0.01 * f64::from(n)]);
            scenario.room.inner_walls = (0..100).map(wall).collect();
            scenario.propagation.reflection_order = 4;
        });
        assert_says(&said, &["`propagation.reflection_order` is 4 with 106 walls", "at most 3:"]);
    }

    #[test]
    fn the_floor_plan_that_is_told_is_checked_like_the_room() {
        let said = refusal_after(|scenario| {
            let mut room = scenario.room.clone();
            room.construction = "straw".into();
            scenario.prior.floor_plan.room = Some(room);
        });
        assert_says(&said, &["`prior.floor_plan.room.construction`"]);
    }

    #[test]
    fn pulses_must_be_sampled_often_enough_unless_the_receiver_limits_them() {
        let said = refusal_after(|scenario| scenario.radio.sample_spacing_s = Some(0.4e-9));
        assert_says(&said, &["`radio.sample_spacing_s` leaves a band of 3.2e9 Hz", "3.125e-10 s"]);
        let said = refusal_after(|scenario| {
            let action = |pulse_duration_s| Action { carrier_hz: 7e9, pulse_duration_s };
            scenario.radio.library = Some(Library::Listed(vec![action(1e-9), action(0.3e-9)]));
        });
        assert_says(&said, &["`radio.library.1.pulse_duration_s`"]);
        let mut scenario = example();
        scenario.radio = super::super::Radio { kind: super::super::RadioKind::Dw1000, ..Default::default() };
        scenario.check("x.toml").expect("is valid");
    }

    #[test]
    fn a_sampled_pulse_has_energy_inside_the_band() {
        let pulse = |samples| Some(Pulse::Sampled { spacing_s: 0.05e-9, samples });
        let mut scenario = example();
        // 2 ns long and smooth.
        let smooth = (0..41).map(|n| [1.0 - (std::f64::consts::TAU * f64::from(n) / 40.0).cos(), 0.0]);
        scenario.radio.pulse = pulse(smooth.collect());
        scenario.check("x.toml").expect("is valid");
        let said = refusal_after(|scenario| scenario.radio.pulse = pulse(vec![[0.0; 2]; 9]));
        assert_says(&said, &["`radio.pulse.samples` has the energy 0"]);
        let said = refusal_after(|scenario| scenario.radio.pulse = pulse(vec![[1.0, 0.0], [0.0, 0.0]]));
        assert_says(&said, &["`radio.pulse.samples` has 80 % of its energy outside"]);
    }

    #[test]
    fn indexes_lie_inside_library_and_frame() {
        let said = refusal_after(|scenario| {
            scenario.radio.kind = super::super::RadioKind::Dw3000;
            scenario.radio.library = None;
            scenario.radio.first_action = Some(2);
        });
        assert_says(&said, &["`radio.first_action` is 2 in a library of 2; allowed is 0 to 1"]);
        let said = refusal_after(|scenario| scenario.radio.window = Some(Window::FirstPath { sample: 400 }));
        assert_says(&said, &["`radio.window.first_path.sample` is 400", "0 to 399"]);
    }

    #[test]
    fn a_band_may_not_reach_down_to_zero_frequency() {
        let said = refusal_after(|scenario| {
            let action = Action { carrier_hz: 1e9, pulse_duration_s: 0.5e-9 };
            scenario.radio.library = Some(Library::Listed(vec![action]));
        });
        assert_says(&said, &["`radio.library.0.carrier_hz`", "above half the band"]);
    }
}
