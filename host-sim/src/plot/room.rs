//! A room as a floor plan: walls by construction, anchors and their virtual anchors, trajectories, people and
//! rays.

use std::io;
use std::path::{Path, PathBuf};

use super::Picture;
use super::axis::Frame;
use super::floor::{Plan, Window, draw_arrow, draw_ends, draw_track, ends_legend, is_drawable};
use super::labels::Labels;
use super::svg::{Area, INK, Key, Marker, Stroke, Svg, colour};

/// Quiet colours, unlike those of the anchors.
const WALLS: [&str; 6] = ["#8d8478", "#c9a66b", "#93a9bd", "#6b4f3f", "#8fa585", "#b9a3b0"];
const TRAJECTORIES: [&str; 3] = [INK, "#7b3f9e", "#8a8a8a"];
const RAY: Stroke = Stroke { opacity: 0.7, ..Stroke::new("#e0a030", 0.8) };
const PERSON: &str = "#7d7d7d";

/// A wall in a figure of a room.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RoomWall {
    /// Its two ends, in metres.
    pub ends_m: [[f64; 2]; 2],
    /// What it is made of; walls of the same construction share a colour. May be empty.
    pub construction: String,
}

/// A virtual anchor in a figure of a room.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct VirtualAnchor {
    /// Its position, in metres.
    pub position_m: [f64; 2],
    /// A short name beside the marker; may be empty.
    pub label: String,
    /// The index of the anchor it is an image of.
    pub anchor: usize,
    /// The number of reflections: 1 for a single one.
    pub order: usize,
}

/// A room as a floor plan, with equal scales. Everything is in metres.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RoomFigure {
    /// The title.
    pub title: String,
    /// The walls.
    pub walls: Vec<RoomWall>,
    /// The physical anchors with their names.
    pub anchors: Vec<(String, [f64; 2])>,
    /// The virtual anchors, in the colours of their anchors. Those far outside are arrows at the border.
    pub virtual_anchors: Vec<VirtualAnchor>,
    /// Trajectories of tags with their names. A position that is not finite interrupts the line.
    pub trajectories: Vec<(String, Vec<[f64; 2]>)>,
    /// Where each person walks, or stands if there is one position.
    pub people: Vec<Vec<[f64; 2]>>,
    /// Rays from anchor to tag, from corner to corner.
    pub rays: Vec<Vec<[f64; 2]>>,
}

impl RoomFigure {
    /// Writes `PATH.svg` and `PATH.png` and gives their paths.
    ///
    /// # Errors
    ///
    /// The disk refuses.
    pub fn write(&self, path_without_extension: impl AsRef<Path>) -> io::Result<[PathBuf; 2]> {
        Picture::of(self.clone()).write(path_without_extension)
    }

    /// What is worth seeing: all of the room, and virtual anchors not far from it.
    fn window(&self) -> Window {
        let walls = self.walls.iter().flat_map(|wall| &wall.ends_m);
        let anchors = self.anchors.iter().map(|(_, position_m)| position_m);
        let trajectories = self.trajectories.iter().flat_map(|(_, track)| track);
        let room =
            Window::around(walls.chain(anchors).chain(trajectories).chain(self.people.iter().flatten()));
        let images = || self.virtual_anchors.iter().map(|image| &image.position_m);
        let Some(mut window) = room.or_else(|| Window::around(images().chain(self.rays.iter().flatten())))
        else {
            return Window { low: [-1.0; 2], high: [1.0; 2] };
        };
        let limit = window.grown(0.5 * window.longer().max(1.0));
        images().filter(|image| limit.contains(image)).for_each(|&image| window.include(image));
        window.grown(0.06 * window.longer().max(1.0))
    }

    /// The constructions, in the order of their first walls.
    fn constructions(&self) -> Vec<&str> {
        let mut names: Vec<&str> = Vec::new();
        for wall in &self.walls {
            if !names.contains(&wall.construction.as_str()) {
                names.push(&wall.construction);
            }
        }
        names
    }

    fn legend(&self) -> Vec<(Key, String)> {
        let mut items = Vec::new();
        for (look, name) in self.constructions().into_iter().enumerate() {
            let name = if name.is_empty() { "wall".to_owned() } else { format!("wall: {name}") };
            items.push((Key::Line(wall_stroke(look)), name));
        }
        if !self.anchors.is_empty() {
            items.push((Key::Marker(Marker::Triangle, colour(0), true), "anchor".to_owned()));
        }
        for (first, name) in [(true, "virtual anchor, first order"), (false, "virtual anchor, higher order")]
        {
            if self.virtual_anchors.iter().any(|image| (image.order <= 1) == first) {
                items.push((Key::Marker(Marker::Diamond, colour(0), first), name.to_owned()));
            }
        }
        for (look, (name, _)) in self.trajectories.iter().enumerate() {
            items.push((Key::Line(trajectory_stroke(look)), name.clone()));
        }
        if self.trajectories.iter().any(|(_, track)| track.iter().any(is_drawable)) {
            items.extend(ends_legend());
        }
        if !self.people.is_empty() {
            items.push((Key::Marker(Marker::Circle, PERSON, true), "person".to_owned()));
        }
        if !self.rays.is_empty() {
            items.push((Key::Line(RAY), "ray".to_owned()));
        }
        items
    }

    pub(super) fn height(&self, width: f64) -> f64 {
        Plan::new(self.window(), width).panel_height(&self.title, &self.legend(), width)
    }

    pub(super) fn draw(&self, svg: &mut Svg, area: Area) {
        let plan = Plan::new(self.window(), area.width);
        let frame = plan.draw(svg, area, &self.title, &self.legend());
        svg.begin_clip(frame.area);
        for ray in &self.rays {
            draw_track(svg, &frame, ray, RAY);
        }
        let constructions = self.constructions();
        for wall in self.walls.iter().filter(|wall| wall.ends_m.iter().all(is_drawable)) {
            let look = constructions.iter().position(|name| *name == wall.construction).unwrap_or(0);
            let [from, to] = wall.ends_m.map(|end| frame.place(end));
            svg.line(from, to, wall_stroke(look));
        }
        for person in &self.people {
            draw_track(svg, &frame, person, Stroke { dashes: "2 4", ..Stroke::new(PERSON, 1.4) });
            if let Some(&start) = person.iter().find(|position| is_drawable(position)) {
                svg.marker(Marker::Circle, frame.place(start), 6.0, PERSON, true);
            }
        }
        for (look, (_, track)) in self.trajectories.iter().enumerate() {
            draw_track(svg, &frame, track, trajectory_stroke(look));
            draw_ends(svg, &frame, track, trajectory_stroke(look).colour);
        }
        svg.end_clip();
        self.draw_anchors(svg, &frame, &plan.window);
    }

    /// Anchors and virtual anchors with their names, which keep out of each other's way.
    fn draw_anchors(&self, svg: &mut Svg, frame: &Frame, window: &Window) {
        let mut labels = Labels::within(frame.area);
        self.walls.iter().for_each(|wall| labels.avoid(wall.ends_m.map(|end| frame.place(end))));
        for pair in self.trajectories.iter().flat_map(|(_, track)| track.windows(2)) {
            labels.avoid([frame.place(pair[0]), frame.place(pair[1])]);
        }
        let mut names: Vec<([f64; 2], &str, &'static str)> = Vec::new();
        for (index, (name, position_m)) in self.anchors.iter().enumerate() {
            if is_drawable(position_m) {
                let place = frame.place(*position_m);
                svg.marker(Marker::Triangle, place, 7.5, colour(index), true);
                labels.take_marker(place, 7.5);
                names.push((place, name, colour(index)));
            }
        }
        let mut images: Vec<_> =
            self.virtual_anchors.iter().filter(|image| is_drawable(&image.position_m)).collect();
        // When room for names is short, those of the first order matter most.
        images.sort_by_key(|image| image.order);
        for image in images {
            let (ink, is_first) = (colour(image.anchor), image.order <= 1);
            let radius = if is_first { 6.0 } else { 4.0 };
            let place = if window.contains(&image.position_m) {
                let place = frame.place(image.position_m);
                svg.marker(Marker::Diamond, place, radius, ink, is_first);
                place
            } else {
                draw_arrow(svg, frame, window, image.position_m, ink)
            };
            labels.take_marker(place, radius);
            names.push((place, &image.label, ink));
        }
        for (place, name, ink) in names {
            labels.put(svg, place, name, ink);
        }
    }
}

fn wall_stroke(look: usize) -> Stroke {
    let dashes = ["", "9 4", "3 4"][look / WALLS.len() % 3];
    Stroke { dashes, ..Stroke::new(WALLS[look % WALLS.len()], 4.0) }
}

fn trajectory_stroke(look: usize) -> Stroke {
    let dashes = ["", "7 4", "2 3"][look / TRAJECTORIES.len() % 3];
    Stroke { dashes, ..Stroke::new(TRAJECTORIES[look % TRAJECTORIES.len()], 1.6) }
}

#[cfg(test)]
mod tests {
    use super::super::png_of;
    use super::*;

    fn wall(ends_m: [[f64; 2]; 2], construction: &str) -> RoomWall {
        RoomWall { ends_m, construction: construction.into() }
    }

    fn image(position_m: [f64; 2], order: usize) -> VirtualAnchor {
        VirtualAnchor { position_m, label: "a very long name of a virtual anchor".into(), anchor: 9, order }
    }

    #[test]
    fn virtual_anchors_near_the_room_widen_the_window_and_far_ones_do_not() {
        let mut figure = RoomFigure {
            walls: vec![wall([[0.0, 0.0], [8.0, 0.0]], "brick"), wall([[8.0, 0.0], [8.0, 6.0]], "glass")],
            ..RoomFigure::default()
        };
        let alone = figure.window();
        figure.virtual_anchors = vec![image([4.0, -40.0], 1)];
        assert_eq!(figure.window(), alone);
        figure.virtual_anchors.push(image([4.0, -3.0], 1));
        assert!(figure.window().low[1] < -3.0 && figure.window().high[1] < 7.0);
    }

    #[test]
    fn walls_of_one_construction_share_an_entry() {
        let ends_m = [[0.0, 0.0], [1.0, 0.0]];
        let figure = RoomFigure {
            walls: vec![
                wall(ends_m, "brick"),
                wall(ends_m, "glass"),
                wall(ends_m, "brick"),
                wall(ends_m, ""),
            ],
            ..RoomFigure::default()
        };
        let names: Vec<String> = figure.legend().into_iter().map(|(_, name)| name).collect();
        assert_eq!(names, ["wall: brick", "wall: glass", "wall"]);
    }

    #[test]
    fn odd_rooms_are_drawn_too() {
        let points = [[f64::NAN, 0.0], [0.0, 0.0], [1e300, 2.0], [3.0, f64::NEG_INFINITY], [1e8, 4.0]];
        for points in [&points[..0], &points[..1], &points[..2], &points[..]] {
            let figure = RoomFigure {
                title: "Room".into(),
                walls: points.iter().map(|&point| wall([point, point], "")).collect(),
                anchors: points.iter().map(|&point| (String::new(), point)).collect(),
                virtual_anchors: points.iter().map(|&point| image(point, 0)).collect(),
                trajectories: vec![("tag".into(), points.to_vec())],
                people: vec![points.to_vec(), vec![]],
                rays: vec![points.to_vec(), vec![]],
            };
            let only_rays = RoomFigure { rays: figure.rays.clone(), ..RoomFigure::default() };
            for figure in [figure, only_rays] {
                let svg = Picture::of(figure).svg();
                assert!(!svg.contains("NaN") && !svg.contains("inf\""));
                png_of(&svg).expect("is drawn");
            }
        }
    }
}
