//! The track over the floor plan, with anchors, virtual anchors and their uncertainty.

use std::io;
use std::path::{Path, PathBuf};

use super::Picture;
use super::axis::{Axis, BELOW, Frame, LEFT_ROOM};
use super::svg::{
    Align, Area, INK, Key, Marker, SOFT_INK, Stroke, Svg, TEXT_SIZE, TextStyle, colour, dashes,
    legend_height, text_width, title_height,
};

/// 95 % of a two-dimensional normal distribution lie within this many standard deviations.
const ELLIPSE_95: f64 = 2.447_746_830_680_816;
const WALL: &str = "#8d8478";
const TRUTH: &str = "#c4c4c4";
const MAPPED: &str = "#7b3f9e";
const MAX_PLOT_HEIGHT: f64 = 760.0;
const MIN_PLOT_HEIGHT: f64 = 260.0;
const RIGHT_ROOM: f64 = 16.0;

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
    /// Positions along the first estimated track with their covariances xx, xy, yy, in square metres.
    pub ellipses: Vec<([f64; 2], [f64; 3])>,
}

/// The part of the plane that is shown.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Window {
    low: [f64; 2],
    high: [f64; 2],
}

impl Window {
    fn around<'a>(points: impl Iterator<Item = &'a [f64; 2]>) -> Option<Self> {
        points.filter(|point| is_drawable(point)).fold(None, |window: Option<Self>, &point| {
            let mut window = window.unwrap_or(Self { low: point, high: point });
            window.include(point);
            Some(window)
        })
    }

    fn include(&mut self, point: [f64; 2]) {
        for (axis, coordinate) in point.into_iter().enumerate() {
            self.low[axis] = self.low[axis].min(coordinate);
            self.high[axis] = self.high[axis].max(coordinate);
        }
    }

    fn extent(&self) -> [f64; 2] {
        [self.high[0] - self.low[0], self.high[1] - self.low[1]]
    }

    fn longer(&self) -> f64 {
        self.extent()[0].max(self.extent()[1])
    }

    fn grown(&self, by: f64) -> Self {
        Self { low: self.low.map(|low| low - by), high: self.high.map(|high| high + by) }
    }

    fn contains(&self, point: &[f64; 2]) -> bool {
        (0..2).all(|axis| point[axis] >= self.low[axis] && point[axis] <= self.high[axis])
    }

    fn centre(&self) -> [f64; 2] {
        [0.5 * (self.low[0] + self.high[0]), 0.5 * (self.low[1] + self.high[1])]
    }
}

fn is_drawable(point: &[f64; 2]) -> bool {
    point.iter().all(|coordinate| coordinate.abs() < 1e9)
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
        take_in(&mut self.walls.iter().flatten(), 0.5);
        take_in(&mut self.virtual_anchors.iter().map(|image| &image.position_m), 0.5);
        window.grown(0.05 * window.longer().max(1.0))
    }

    /// The window widened to fill a frame of a width, and the frame's height.
    fn fitted(&self, width: f64) -> (Window, f64) {
        let mut window = self.window();
        let [extent_x, extent_y] = window.extent();
        let height = (width * extent_y / extent_x).clamp(MIN_PLOT_HEIGHT, MAX_PLOT_HEIGHT);
        let metres_per_pixel = (extent_x / width).max(extent_y / height);
        let spare =
            [0.5 * (metres_per_pixel * width - extent_x), 0.5 * (metres_per_pixel * height - extent_y)];
        for (axis, spare) in spare.into_iter().enumerate() {
            window.low[axis] -= spare;
            window.high[axis] += spare;
        }
        (window, height)
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
            items.push((Key::Marker(Marker::Circle, INK, false), "start".to_owned()));
            items.push((Key::Marker(Marker::Square, INK, true), "end".to_owned()));
        }
        if !self.ellipses.is_empty() || self.virtual_anchors.iter().any(|image| image.covariance_m2.is_some())
        {
            items.push((Key::Ellipse(colour(0)), "95 % ellipse".to_owned()));
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
            items.push((Key::Line(Stroke::new(WALL, 2.6)), "wall".to_owned()));
        }
        items
    }

    pub(super) fn height(&self, width: f64) -> f64 {
        let (window, plot_height) = self.fitted(width - LEFT_ROOM - RIGHT_ROOM);
        title_height(&self.title, width)
            + legend_height(&self.legend(&window), width)
            + 2.0
            + plot_height
            + BELOW
    }

    pub(super) fn draw(&self, svg: &mut Svg, area: Area) {
        let width = area.width - LEFT_ROOM - RIGHT_ROOM;
        let (window, height) = self.fitted(width);
        let mut top = area.top + svg.title(&self.title, area.left, area.top, area.width);
        top += svg.legend(&self.legend(&window), area.left, top, area.width) + 2.0;
        let axis = |index: usize| Axis { low: window.low[index], high: window.high[index], log: false };
        let frame =
            Frame { area: Area { left: area.left + LEFT_ROOM, top, width, height }, x: axis(0), y: axis(1) };
        frame.draw(svg, "x in m", "y in m");
        svg.begin_clip(frame.area);
        for wall in self.walls.iter().filter(|wall| wall.iter().all(is_drawable)) {
            svg.line(frame.place(wall[0]), frame.place(wall[1]), Stroke::new(WALL, 2.6));
        }
        draw_track(svg, &frame, &self.truth, truth_stroke());
        for &(centre, covariance_m2) in &self.ellipses {
            draw_ellipse(svg, &frame, centre, covariance_m2, colour(0));
        }
        for (look, (_, track)) in self.estimates.iter().enumerate() {
            draw_track(svg, &frame, track, estimate_stroke(look));
        }
        self.draw_ends(svg, &frame);
        svg.end_clip();
        self.draw_anchors(svg, &frame, &window);
    }

    fn draw_ends(&self, svg: &mut Svg, frame: &Frame) {
        let estimates = self.estimates.iter().enumerate().map(|(look, (_, track))| (colour(look), track));
        for (colour, track) in std::iter::once((INK, &self.truth)).chain(estimates) {
            let mut drawable = track.iter().filter(|point| is_drawable(point));
            let Some(&first) = drawable.next() else { continue };
            svg.marker(Marker::Circle, frame.place(first), 4.5, colour, false);
            let last = drawable.next_back().copied().unwrap_or(first);
            svg.marker(Marker::Square, frame.place(last), 5.0, colour, true);
        }
    }

    /// Anchors and virtual anchors with their names, which keep out of each other's way.
    fn draw_anchors(&self, svg: &mut Svg, frame: &Frame, window: &Window) {
        let mut labels = Labels { within: frame.area, taken: Vec::new() };
        let mut names: Vec<([f64; 2], &str, &'static str)> = Vec::new();
        svg.begin_clip(frame.area);
        for image in self.virtual_anchors.iter().filter(|image| is_drawable(&image.position_m)) {
            if let Some(covariance_m2) = image.covariance_m2 {
                draw_ellipse(svg, frame, image.position_m, covariance_m2, MAPPED);
            }
        }
        svg.end_clip();
        // Truth is drawn first and larger, so that an estimate right on it shows both.
        for is_truth in [true, false] {
            let (ink, radius) = if is_truth { (SOFT_INK, 6.5) } else { (MAPPED, 4.2) };
            for image in self.virtual_anchors.iter().filter(|image| image.is_truth == is_truth) {
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

fn draw_track(svg: &mut Svg, frame: &Frame, track: &[[f64; 2]], stroke: Stroke) {
    for run in track.split(|point| !is_drawable(point)) {
        let mut places: Vec<[f64; 2]> = Vec::new();
        for &point in run {
            let place = frame.place(point);
            // Steps below a fifth of a pixel cannot be seen.
            if places.last().is_none_or(|last| (last[0] - place[0]).hypot(last[1] - place[1]) > 0.2) {
                places.push(place);
            }
        }
        svg.polyline(&places, stroke);
    }
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

/// An arrow at the border towards a position outside; gives where it stands.
fn draw_arrow(
    svg: &mut Svg,
    frame: &Frame,
    window: &Window,
    position_m: [f64; 2],
    ink: &'static str,
) -> [f64; 2] {
    let centre = frame.place(window.centre());
    let far = frame.place(position_m);
    let (dx, dy) = (far[0] - centre[0], far[1] - centre[1]);
    let inset = 11.0;
    let scale =
        ((0.5 * frame.area.width - inset) / dx.abs()).min((0.5 * frame.area.height - inset) / dy.abs());
    let place = [centre[0] + scale * dx, centre[1] + scale * dy];
    let length = dx.hypot(dy);
    let [ux, uy] = [dx / length, dy / length];
    let at =
        |along: f64, across: f64| [place[0] + along * ux - across * uy, place[1] + along * uy + across * ux];
    svg.polygon(&[at(9.0, 0.0), at(-4.0, 5.0), at(-1.0, 0.0), at(-4.0, -5.0)], ink, None);
    place
}

/// Names that keep out of each other's way.
struct Labels {
    within: Area,
    taken: Vec<Area>,
}

impl Labels {
    fn take_marker(&mut self, [x, y]: [f64; 2], radius: f64) {
        let side = 2.0 * radius + 2.0;
        self.taken.push(Area { left: x - 0.5 * side, top: y - 0.5 * side, width: side, height: side });
    }

    /// Puts a name beside a marker where there is room; where there is none, it is left out.
    fn put(&mut self, svg: &mut Svg, [x, y]: [f64; 2], name: &str, ink: &'static str) {
        const SIZE: f64 = TEXT_SIZE - 1.0;
        let (width, height) = (text_width(name, SIZE), SIZE + 2.0);
        let (left, centre, right) = (x - width - 10.0, x - 0.5 * width, x + 10.0);
        let (above, middle, below) = (y - height - 8.0, y - 0.5 * height, y + 9.0);
        let places = [
            (right, middle),
            (left, middle),
            (centre, above),
            (centre, below),
            (right, above),
            (right, below),
            (left, above),
            (left, below),
        ];
        let free = places.into_iter().map(|(left, top)| Area { left, top, width, height }).find(|place| {
            self.within.contains([place.left, place.top])
                && self.within.contains([place.right(), place.bottom()])
                && !self.taken.iter().any(|other| other.overlaps(place))
        });
        let Some(place) = free.filter(|_| !name.is_empty()) else { return };
        self.taken.push(place);
        let style =
            TextStyle { align: Align::Start, size: SIZE, colour: ink, halo: true, ..TextStyle::default() };
        svg.text(name, [place.left, place.top + SIZE - 1.0], style);
    }
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
    fn scales_are_equal_whatever_the_shape_of_the_window() {
        for truth in
            [vec![[0.0, 0.0], [100.0, 1.0]], vec![[0.0, 0.0], [1.0, 100.0]], vec![[2.0, 2.0]], vec![]]
        {
            let figure = TrackFigure { truth, ..TrackFigure::default() };
            let (window, height) = figure.fitted(800.0);
            let [extent_x, extent_y] = window.extent();
            assert!((extent_x / 800.0 - extent_y / height).abs() < 1e-9 * extent_x, "{window:?} {height}");
        }
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
    fn an_ellipse_has_the_axes_of_its_covariance() {
        let ([long_m, short_m], angle) = ellipse_of([2.5, 1.5, 2.5]).expect("is a covariance");
        assert!((long_m - 2.0 * ELLIPSE_95).abs() < 1e-12 && (short_m - ELLIPSE_95).abs() < 1e-12);
        assert!((angle - std::f64::consts::FRAC_PI_4).abs() < 1e-12);
        assert_eq!(ellipse_of([f64::NAN, 0.0, 1.0]), None);
        assert_eq!(ellipse_of([1.0, 5.0, 1.0]), None);
    }
}
