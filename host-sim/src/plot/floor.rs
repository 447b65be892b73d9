//! What figures over the floor plan share: the window with equal scales, tracks, and arrows to what lies
//! outside.

use super::axis::{Axis, BELOW, Frame, LEFT_ROOM};
use super::svg::{Area, INK, Key, Marker, Stroke, Svg, legend_height, title_height};

const MAX_PLOT_HEIGHT: f64 = 760.0;
const MIN_PLOT_HEIGHT: f64 = 260.0;
const RIGHT_ROOM: f64 = 16.0;

/// The part of the plane that is shown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Window {
    pub(super) low: [f64; 2],
    pub(super) high: [f64; 2],
}

impl Window {
    pub(super) fn around<'a>(points: impl Iterator<Item = &'a [f64; 2]>) -> Option<Self> {
        points.filter(|point| is_drawable(point)).fold(None, |window: Option<Self>, &point| {
            let mut window = window.unwrap_or(Self { low: point, high: point });
            window.include(point);
            Some(window)
        })
    }

    pub(super) fn include(&mut self, point: [f64; 2]) {
        for (axis, coordinate) in point.into_iter().enumerate() {
            self.low[axis] = self.low[axis].min(coordinate);
            self.high[axis] = self.high[axis].max(coordinate);
        }
    }

    pub(super) fn extent(&self) -> [f64; 2] {
        [self.high[0] - self.low[0], self.high[1] - self.low[1]]
    }

    pub(super) fn longer(&self) -> f64 {
        self.extent()[0].max(self.extent()[1])
    }

    pub(super) fn grown(&self, by: f64) -> Self {
        Self { low: self.low.map(|low| low - by), high: self.high.map(|high| high + by) }
    }

    pub(super) fn contains(&self, point: &[f64; 2]) -> bool {
        (0..2).all(|axis| point[axis] >= self.low[axis] && point[axis] <= self.high[axis])
    }

    pub(super) fn centre(&self) -> [f64; 2] {
        [0.5 * (self.low[0] + self.high[0]), 0.5 * (self.low[1] + self.high[1])]
    }
}

pub(super) fn is_drawable(point: &[f64; 2]) -> bool {
    point.iter().all(|coordinate| coordinate.abs() < 1e9)
}

/// A floor plan as it is laid out in a panel: the window widened to fill the frame, and the frame's height.
pub(super) struct Plan {
    pub(super) window: Window,
    height: f64,
}

impl Plan {
    /// Lays out a window in a panel of a width.
    pub(super) fn new(mut window: Window, panel_width: f64) -> Self {
        let width = panel_width - LEFT_ROOM - RIGHT_ROOM;
        let [extent_x, extent_y] = window.extent();
        let height = (width * extent_y / extent_x).clamp(MIN_PLOT_HEIGHT, MAX_PLOT_HEIGHT);
        let metres_per_pixel = (extent_x / width).max(extent_y / height);
        let spare =
            [0.5 * (metres_per_pixel * width - extent_x), 0.5 * (metres_per_pixel * height - extent_y)];
        for (axis, spare) in spare.into_iter().enumerate() {
            window.low[axis] -= spare;
            window.high[axis] += spare;
        }
        Self { window, height }
    }

    /// The height of the panel.
    pub(super) fn panel_height(&self, title: &str, legend: &[(Key, String)], panel_width: f64) -> f64 {
        title_height(title, panel_width) + legend_height(legend, panel_width) + 2.0 + self.height + BELOW
    }

    /// Title, legend and axes.
    pub(super) fn draw(&self, svg: &mut Svg, area: Area, title: &str, legend: &[(Key, String)]) -> Frame {
        let mut top = area.top + svg.title(title, area.left, area.top, area.width);
        top += svg.legend(legend, area.left, top, area.width) + 2.0;
        let width = area.width - LEFT_ROOM - RIGHT_ROOM;
        let axis =
            |index: usize| Axis { low: self.window.low[index], high: self.window.high[index], log: false };
        let area = Area { left: area.left + LEFT_ROOM, top, width, height: self.height };
        let frame = Frame { area, x: axis(0), y: axis(1) };
        frame.draw(svg, "x in m", "y in m");
        frame
    }
}

/// Marks where a track starts and where it ends.
pub(super) fn draw_ends(svg: &mut Svg, frame: &Frame, track: &[[f64; 2]], colour: &'static str) {
    let mut drawable = track.iter().filter(|point| is_drawable(point));
    let Some(&first) = drawable.next() else { return };
    svg.marker(Marker::Circle, frame.place(first), 4.5, colour, false);
    let last = drawable.next_back().copied().unwrap_or(first);
    svg.marker(Marker::Square, frame.place(last), 5.0, colour, true);
}

/// The entries of a legend for [`draw_ends`].
pub(super) fn ends_legend() -> [(Key, String); 2] {
    [
        (Key::Marker(Marker::Circle, INK, false), "start".to_owned()),
        (Key::Marker(Marker::Square, INK, true), "end".to_owned()),
    ]
}

pub(super) fn draw_track(svg: &mut Svg, frame: &Frame, track: &[[f64; 2]], stroke: Stroke) {
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

/// An arrow at the border towards a position outside; gives where it stands.
pub(super) fn draw_arrow(
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scales_are_equal_whatever_the_shape_of_the_window() {
        for high in [[100.0, 1.0], [1.0, 100.0], [5.0, 5.0]] {
            let plan = Plan::new(Window { low: [0.0; 2], high }, 800.0);
            let [extent_x, extent_y] = plan.window.extent();
            let width = 800.0 - LEFT_ROOM - RIGHT_ROOM;
            assert!((extent_x / width - extent_y / plan.height).abs() < 1e-9 * extent_x, "{high:?}");
        }
    }
}
