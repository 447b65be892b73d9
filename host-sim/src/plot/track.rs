//! The track over the floor plan, with anchors, virtual anchors and their uncertainty.

use std::io;
use std::path::{Path, PathBuf};

use super::Picture;
use super::axis::Frame;
use super::floor::{Plan, Window, draw_arrow, draw_ends, draw_track, ends_legend, is_drawable};
use super::labels::Labels;
use super::svg::{Area, INK, Key, Marker, SOFT_INK, Stroke, Svg, colour, dashes};

/// 95 % of a two-dimensional normal distribution lie within this many standard deviations.
const ELLIPSE_95: f64 = 2.447_746_830_680_816;
/// Of a normal distribution of one dimension as many.
const BAND_95: f64 = 1.959_963_984_540_054;
const WALL: &str = "#c9c1b4";
const TRUTH: &str = "#c4c4c4";
const MAPPED: &str = "#7b3f9e";
const TOLD_WALL: Stroke = Stroke::new(INK, 0.9);

/// A virtual anchor in a figure.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MappedAnchor {
    /// A short name beside the marker; may be empty.
    pub label: String,
    /// Its position, in metres.
    pub position_m: [f64; 2],
    /// The covariance xx, xy, yy of an estimated one, in square metres.
    pub covariance_m2: Option<[f64; 3]>,
    /// Whether it is the truth, else an estimate.
    pub is_truth: bool,
}

/// How a wall of the map differs from what was told.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WallKind {
    /// It was told elsewhere.
    Moved,
    /// It was not told.
    Grown,
    /// It is rather not there.
    Doubted,
}

impl WallKind {
    const ALL: [Self; 3] = [Self::Moved, Self::Grown, Self::Doubted];

    fn label(self) -> &'static str {
        match self {
            Self::Moved => "wall moved by the tracker, 95 % band",
            Self::Grown => "wall grown by the tracker, 95 % band",
            Self::Doubted => "wall doubted",
        }
    }

    fn stroke(self) -> Stroke {
        match self {
            Self::Moved => Stroke::new(MAPPED, 1.6),
            Self::Grown => Stroke::new(colour(2), 1.6),
            Self::Doubted => Stroke { dashes: "5 4", ..Stroke::new(colour(1), 1.6) },
        }
    }
}

/// A wall of the map in a figure.
#[derive(Clone, Debug, PartialEq)]
pub struct MappedWall {
    /// How it differs from what was told.
    pub kind: WallKind,
    /// Its parts, each from end to end, in metres, with the standard deviation across it at places evenly from the one to the
    /// other.
    pub segments: Vec<([[f64; 2]; 2], [f64; Self::PLACES])>,
}

impl MappedWall {
    /// Places along a segment that have a deviation.
    pub const PLACES: usize = 9;
}

/// The corners of a segment's 95 % band, once round.
fn band_of([[ax, ay], [bx, by]]: [[f64; 2]; 2], deviations_m: &[f64; MappedWall::PLACES]) -> Vec<[f64; 2]> {
    let length_m = (bx - ax).hypot(by - ay);
    let [nx, ny] = [(ay - by) / length_m, (bx - ax) / length_m];
    let at = |(n, deviation_m): (usize, &f64), side: f64| {
        let share = n as f64 / (MappedWall::PLACES - 1) as f64;
        let off_m = side * BAND_95 * deviation_m;
        [ax + share * (bx - ax) + off_m * nx, ay + share * (by - ay) + off_m * ny]
    };
    let places = || deviations_m.iter().enumerate();
    places().map(|place| at(place, 1.0)).chain(places().rev().map(|place| at(place, -1.0))).collect()
}

/// A track over the floor plan, with equal scales. Everything is in metres.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TrackFigure {
    /// The title.
    pub title: String,
    /// The true track; may be empty.
    pub truth: Vec<[f64; 2]>,
    /// The estimated tracks with their names. A position that is not finite interrupts the line.
    pub estimates: Vec<(String, Vec<[f64; 2]>)>,
    /// The physical anchors with their names.
    pub anchors: Vec<(String, [f64; 2])>,
    /// True and estimated virtual anchors. Those far outside are arrows at the border.
    pub virtual_anchors: Vec<MappedAnchor>,
    /// Walls, from end to end.
    pub walls: Vec<[[f64; 2]; 2]>,
    /// Walls as the plan tells them, from end to end.
    pub told_walls: Vec<[[f64; 2]; 2]>,
    /// Walls of the map that differ from the plan's.
    pub found_walls: Vec<MappedWall>,
    /// Positions along the first estimated track with their covariances xx, xy, yy, in square metres.
    pub ellipses: Vec<([f64; 2], [f64; 3])>,
    /// Whether the window takes in the virtual anchors, else it keeps to the track and what is near it.
    pub shows_map: bool,
}

impl TrackFigure {
    /// Writes `PATH.svg` and `PATH.png` and gives their paths.
    ///
    /// # Errors
    ///
    /// The disk refuses.
    pub fn write(&self, path_without_extension: impl AsRef<Path>) -> io::Result<[PathBuf; 2]> {
        Picture::of(self.clone()).write(path_without_extension)
    }

    /// What is worth seeing. What must be seen (truth and anchors) sets the scale; the rest is taken in as far as it
    /// does not shrink that much: a diverged track or a distant image leaves the window instead.
    fn window(&self) -> Window {
        let anchors = || self.anchors.iter().map(|(_, position_m)| position_m);
        let estimates = || self.estimates.iter().flat_map(|(_, track)| track);
        let core = match Window::around(self.truth.iter()) {
            Some(_) => Window::around(self.truth.iter().chain(anchors())),
            None => {
                // Without a truth, the bulk of the estimates: the outermost fiftieth at each end may be astray.
                let bulk = |axis: usize| {
                    let mut values: Vec<f64> =
                        estimates().filter(|point| is_drawable(point)).map(|point| point[axis]).collect();
                    values.sort_by(f64::total_cmp);
                    let margin = values.len() / 50;
                    Some((*values.get(margin)?, *values.get(values.len() - 1 - margin)?))
                };
                let corners =
                    bulk(0).zip(bulk(1)).map(|((left, right), (bottom, top))| [[left, bottom], [right, top]]);
                Window::around(corners.iter().flatten().chain(anchors()))
            }
        };
        let Some(core) = core else { return Window { low: [-1.0; 2], high: [1.0; 2] } };
        let scale = core.longer().max(1.0);
        let mut window = core;
        let mut take_in = |points: &mut dyn Iterator<Item = &[f64; 2]>, reach: f64| {
            let limit = core.grown(reach * scale);
            points.filter(|point| limit.contains(point)).for_each(|&point| window.include(point));
        };
        take_in(&mut estimates(), 0.4);
        take_in(&mut self.walls.iter().chain(&self.told_walls).flatten(), 0.5);
        // Images of second order lie up to two rooms away.
        let reach = if self.shows_map { 4.0 } else { 0.5 };
        take_in(&mut self.virtual_anchors.iter().map(|image| &image.position_m), reach);
        window.grown(0.05 * window.longer().max(1.0))
    }

    fn legend(&self, window: &Window) -> Vec<(Key, String)> {
        let mut items = Vec::new();
        if !self.truth.is_empty() {
            items.push((Key::Line(truth_stroke()), "truth".to_owned()));
        }
        for (look, (label, track)) in self.estimates.iter().enumerate() {
            let outside = track.iter().filter(|point| !window.contains(point)).count();
            // The reader must know that not all is shown.
            let label = match outside {
                0 => label.clone(),
                _ => format!("{label} ({outside} of {} positions outside)", track.len()),
            };
            items.push((Key::Line(estimate_stroke(look)), label));
        }
        if self.truth.iter().chain(self.estimates.iter().flat_map(|(_, track)| track)).next().is_some() {
            items.extend(ends_legend());
        }
        let maps_ellipses = self.virtual_anchors.iter().any(|image| image.covariance_m2.is_some());
        if !self.ellipses.is_empty() || maps_ellipses {
            let ink = if self.ellipses.is_empty() { MAPPED } else { colour(0) };
            items.push((Key::Ellipse(ink), "95 % ellipse".to_owned()));
        }
        if !self.anchors.is_empty() {
            items.push((Key::Marker(Marker::Triangle, INK, true), "anchor".to_owned()));
        }
        if self.virtual_anchors.iter().any(|image| image.is_truth) {
            items.push((Key::Marker(Marker::Diamond, SOFT_INK, false), "virtual anchor, true".to_owned()));
        }
        if self.virtual_anchors.iter().any(|image| !image.is_truth) {
            items.push((Key::Marker(Marker::Diamond, MAPPED, true), "virtual anchor, estimated".to_owned()));
        }
        if !self.walls.is_empty() {
            items.push((Key::Line(Stroke::new(WALL, 4.0)), "wall".to_owned()));
        }
        if !self.told_walls.is_empty() {
            items.push((Key::Line(TOLD_WALL), "wall as told".to_owned()));
        }
        for kind in WallKind::ALL {
            if self.found_walls.iter().any(|wall| wall.kind == kind) {
                items.push((Key::Line(kind.stroke()), kind.label().to_owned()));
            }
        }
        items
    }

    pub(super) fn height(&self, width: f64) -> f64 {
        let plan = Plan::new(self.window(), width);
        plan.panel_height(&self.title, &self.legend(&plan.window), width)
    }

    pub(super) fn draw(&self, svg: &mut Svg, area: Area) {
        let plan = Plan::new(self.window(), area.width);
        let frame = plan.draw(svg, area, &self.title, &self.legend(&plan.window));
        svg.begin_clip(frame.area);
        for wall in self.walls.iter().filter(|wall| wall.iter().all(is_drawable)) {
            svg.line(frame.place(wall[0]), frame.place(wall[1]), Stroke::new(WALL, 4.0));
        }
        for wall in self.told_walls.iter().filter(|wall| wall.iter().all(is_drawable)) {
            svg.line(frame.place(wall[0]), frame.place(wall[1]), TOLD_WALL);
        }
        self.draw_found_walls(svg, &frame);
        draw_track(svg, &frame, &self.truth, truth_stroke());
        for &(centre, covariance_m2) in &self.ellipses {
            draw_ellipse(svg, &frame, centre, covariance_m2, colour(0));
        }
        for (look, (_, track)) in self.estimates.iter().enumerate() {
            draw_track(svg, &frame, track, estimate_stroke(look));
        }
        draw_ends(svg, &frame, &self.truth, INK);
        for (look, (_, track)) in self.estimates.iter().enumerate() {
            draw_ends(svg, &frame, track, colour(look));
        }
        svg.end_clip();
        self.draw_anchors(svg, &frame, &plan.window);
    }

    fn draw_found_walls(&self, svg: &mut Svg, frame: &Frame) {
        for MappedWall { kind, segments } in &self.found_walls {
            for (ends_m, deviations_m) in segments.iter().filter(|(ends_m, _)| ends_m.iter().all(is_drawable))
            {
                let band = band_of(*ends_m, deviations_m);
                if *kind != WallKind::Doubted && band.iter().all(is_drawable) {
                    let corners: Vec<_> = band.into_iter().map(|corner_m| frame.place(corner_m)).collect();
                    svg.band(&corners, kind.stroke().colour);
                }
                svg.line(frame.place(ends_m[0]), frame.place(ends_m[1]), kind.stroke());
            }
        }
    }

    /// Anchors and virtual anchors with their names, which keep out of each other's way.
    fn draw_anchors(&self, svg: &mut Svg, frame: &Frame, window: &Window) {
        let mut labels = Labels::within(frame.area);
        let mut names: Vec<([f64; 2], &str, &'static str)> = Vec::new();
        // Truth is drawn first and larger, so that an estimate right on it shows both.
        for is_truth in [true, false] {
            // On a map, estimates are small enough to leave their ellipses visible.
            let estimate_radius = if self.shows_map { 2.2 } else { 4.2 };
            let (ink, radius) = if is_truth { (SOFT_INK, 6.5) } else { (MAPPED, estimate_radius) };
            let images = || self.virtual_anchors.iter().filter(|image| image.is_truth == is_truth);
            svg.begin_clip(frame.area);
            for image in images() {
                if let Some(covariance_m2) = image.covariance_m2 {
                    draw_ellipse(svg, frame, image.position_m, covariance_m2, MAPPED);
                }
            }
            svg.end_clip();
            for image in images() {
                if !is_drawable(&image.position_m) {
                    continue;
                }
                let place = if window.contains(&image.position_m) {
                    let place = frame.place(image.position_m);
                    svg.marker(Marker::Diamond, place, radius, ink, !is_truth);
                    place
                } else {
                    draw_arrow(svg, frame, window, image.position_m, ink)
                };
                labels.take_marker(place, radius);
                names.push((place, &image.label, ink));
            }
        }
        for (name, position_m) in self.anchors.iter().filter(|(_, position_m)| is_drawable(position_m)) {
            let place = frame.place(*position_m);
            svg.marker(Marker::Triangle, place, 7.0, INK, true);
            labels.take_marker(place, 7.0);
            // The anchors' names go first: they matter most when room is short.
            names.insert(0, (place, name, INK));
        }
        for (place, name, ink) in names {
            labels.put(svg, place, name, ink);
        }
    }
}

fn truth_stroke() -> Stroke {
    // Wide and pale, so that an estimate on top of it leaves it visible.
    Stroke::new(TRUTH, 5.0)
}

fn estimate_stroke(look: usize) -> Stroke {
    Stroke { dashes: dashes(look), ..Stroke::new(colour(look), 1.6) }
}

/// The half axes of the 95 % ellipse and the angle of the longer one from the x axis, if the covariance is one.
fn ellipse_of([xx, xy, yy]: [f64; 3]) -> Option<([f64; 2], f64)> {
    let mean = 0.5 * (xx + yy);
    let difference = 0.5 * (xx - yy);
    let root = difference.hypot(xy);
    let (large, small) = (mean + root, mean - root);
    // Rounding may leave a thin one slightly negative. NaN is no covariance.
    if !(large.is_finite() && large >= 0.0 && small >= -1e-6 * large) {
        return None;
    }
    let angle = 0.5 * xy.atan2(difference);
    Some(([ELLIPSE_95 * large.sqrt(), ELLIPSE_95 * small.max(0.0).sqrt()], angle))
}

fn draw_ellipse(
    svg: &mut Svg,
    frame: &Frame,
    centre: [f64; 2],
    covariance_m2: [f64; 3],
    colour: &'static str,
) {
    let Some((half_axes_m, angle)) = ellipse_of(covariance_m2) else { return };
    let pixels_per_m = frame.area.width / (frame.x.high - frame.x.low);
    // One far larger than the window would only tint it.
    if !is_drawable(&centre) || half_axes_m[0] > 2.0 * (frame.x.high - frame.x.low) {
        return;
    }
    // The picture's y axis points down.
    svg.ellipse(
        frame.place(centre),
        half_axes_m.map(|half_m| half_m * pixels_per_m),
        -angle.to_degrees(),
        colour,
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    fn circle(n: usize) -> Vec<[f64; 2]> {
        (0..n)
            .map(|k| k as f64 / n as f64 * std::f64::consts::TAU)
            .map(|angle| [3.0 + angle.cos(), 5.0 + angle.sin()])
            .collect()
    }

    #[test]
    fn a_diverged_estimate_leaves_the_window_as_it_is_and_is_told_of() {
        let mut figure = TrackFigure {
            truth: circle(100),
            estimates: vec![("cognitive".into(), circle(100))],
            ..TrackFigure::default()
        };
        let before = figure.window();
        figure.estimates[0].1.extend([[1e6, -1e6], [f64::NAN, 0.0]]);
        assert_eq!(figure.window(), before);
        assert!(figure.legend(&before)[1].1.contains("2 of 102 positions outside"));
    }

    #[test]
    fn without_a_truth_stray_estimates_do_not_set_the_scale() {
        let mut track = circle(1000);
        track[7] = [1e5, 1e5];
        let figure = TrackFigure { estimates: vec![("alone".into(), track)], ..TrackFigure::default() };
        assert!(figure.window().longer() < 5.0);
    }

    #[test]
    fn images_far_outside_become_arrows() {
        let image =
            |position_m| MappedAnchor { position_m, label: "image".into(), ..MappedAnchor::default() };
        let figure = TrackFigure {
            truth: circle(100),
            virtual_anchors: vec![image([4.5, 5.0]), image([50.0, 5.0]), image([3.0, -80.0])],
            ..TrackFigure::default()
        };
        let window = figure.window();
        let inside: Vec<_> =
            figure.virtual_anchors.iter().map(|image| window.contains(&image.position_m)).collect();
        assert_eq!(inside, [true, false, false]);
        assert!(!Picture::of(figure).svg().contains("NaN"));
    }

    #[test]
    fn a_map_takes_in_distant_images_with_their_ellipses_and_leaves_out_what_is_astray() {
        let image = |position_m, is_truth: bool| MappedAnchor {
            position_m,
            covariance_m2: (!is_truth).then_some([0.04, 0.01, 0.09]),
            is_truth,
            ..MappedAnchor::default()
        };
        let figure = TrackFigure {
            truth: circle(100),
            virtual_anchors: vec![
                image([10.0, 5.0], true),
                image([10.5, 5.0], false),
                image([3.0, -900.0], false),
            ],
            shows_map: true,
            ..TrackFigure::default()
        };
        let window = figure.window();
        assert!(window.contains(&[10.0, 5.0]) && window.contains(&[10.5, 5.0]));
        assert!(!window.contains(&[3.0, -900.0]) && window.longer() < 20.0);
        let ellipses = |figure: TrackFigure| Picture::of(figure).svg().matches("<ellipse").count();
        let without =
            figure.virtual_anchors.iter().map(|image| MappedAnchor { covariance_m2: None, ..image.clone() });
        let without = TrackFigure { virtual_anchors: without.collect(), ..figure.clone() };
        // Two estimates and the legend.
        assert_eq!(ellipses(figure) - ellipses(without), 3);
    }

    #[test]
    fn walls_are_drawn_segment_by_segment_with_bands_where_they_are_believed() {
        let gap = vec![([[1.0, 2.0], [3.0, 2.0]], [0.1; 9]), ([[5.0, 2.0], [6.0, 2.0]], [0.1; 9])];
        let wall = |kind| MappedWall { kind, segments: gap.clone() };
        let figure = TrackFigure { truth: circle(100), ..TrackFigure::default() };
        let marks = |found_walls: Vec<MappedWall>| {
            let told_walls = vec![[[0.0, 3.0], [6.0, 3.0]]];
            let svg = Picture::of(TrackFigure { told_walls, found_walls, ..figure.clone() }).svg();
            [svg.matches("fill-opacity=\"0.22\"").count(), svg.matches("<line").count()]
        };
        let [none, moved, doubted] =
            [marks(vec![]), marks(vec![wall(WallKind::Moved)]), marks(vec![wall(WallKind::Doubted)])];
        // Two segments and the line of the legend.
        assert_eq!((moved[0] - none[0], moved[1] - none[1]), (2, 3));
        assert_eq!((doubted[0] - none[0], doubted[1] - none[1]), (0, 3));
        let band = band_of([[1.0, 2.0], [3.0, 2.0]], &[0.1; 9]);
        assert!(
            band.iter().all(|[_, y]| ((y - 2.0).abs() - BAND_95 * 0.1).abs() < 1e-12) && band.len() == 18
        );
    }

    #[test]
    fn an_ellipse_has_the_axes_of_its_covariance() {
        let ([long_m, short_m], angle) = ellipse_of([2.5, 1.5, 2.5]).expect("is a covariance");
        assert!((long_m - 2.0 * ELLIPSE_95).abs() < 1e-12 && (short_m - ELLIPSE_95).abs() < 1e-12);
        assert!((angle - std::f64::consts::FRAC_PI_4).abs() < 1e-12);
        assert_eq!(ellipse_of([f64::NAN, 0.0, 1.0]), None);
        assert_eq!(ellipse_of([1.0, 5.0, 1.0]), None);
    }
}
