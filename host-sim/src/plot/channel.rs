//! A channel response over delay and range, with true and estimated paths.

use std::io;
use std::path::{Path, PathBuf};

use super::Picture;
use super::axis::{ABOVE, Axis, BELOW, Frame, LEFT_ROOM};
use super::labels::SIZE;
use super::lines::draw_line;
use super::svg::{
    Align, Area, INK, Key, Marker, Stroke, Svg, TextStyle, legend_height, shortened, text_width, title_height,
};

const LIGHT_M_PER_S: f64 = 299_792_458.0;
const M_PER_NS: f64 = LIGHT_M_PER_S * 1e-9;
/// No more of the response than this is shown below its peak.
const MAX_RANGE_DB: f64 = 90.0;
/// The paths' names stand in lines at the top of the frame, at most so many.
const MAX_NAME_LINES: usize = 10;
const NAME_LINE: f64 = SIZE + 3.0;
const RIGHT_ROOM: f64 = 16.0;
const MAGNITUDE: Stroke = Stroke::new("#0072b2", 1.6);
const NOISE: Stroke = Stroke::new("#b0b0b0", 2.6);

/// A path in a figure of a channel response.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ChannelPath {
    /// Its delay, in seconds.
    pub delay_s: f64,
    /// Its magnitude, in the unit of the response.
    pub magnitude: f64,
    /// A short name above it; may be empty.
    pub label: String,
}

/// A channel response over delay and range.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ChannelFigure {
    /// The title.
    pub title: String,
    /// The delays of the samples, in seconds, rising.
    pub delay_s: Vec<f64>,
    /// The magnitude of each sample, on a linear scale. One that is not finite interrupts the line.
    pub magnitude: Vec<f64>,
    /// The level of noise and dense multipath at each sample, on the same scale; may be empty.
    pub noise_level: Vec<f64>,
    /// The paths that there are.
    pub true_paths: Vec<ChannelPath>,
    /// The paths that were found.
    pub estimated_paths: Vec<ChannelPath>,
    /// The unit of all magnitudes; may be empty.
    pub unit: String,
    /// Whether the magnitudes are drawn in dB: over the lowest noise level, or over one unit if there is
    /// none.
    pub db: bool,
}

impl ChannelFigure {
    /// Writes `PATH.svg` and `PATH.png` and gives their paths.
    ///
    /// # Errors
    ///
    /// The disk refuses.
    pub fn write(&self, path_without_extension: impl AsRef<Path>) -> io::Result<[PathBuf; 2]> {
        Picture::of(self.clone()).write(path_without_extension)
    }

    fn paths(&self) -> impl Iterator<Item = &ChannelPath> {
        self.true_paths.iter().chain(&self.estimated_paths)
    }

    /// The lowest noise level, which is that of the noise alone.
    fn noise_floor(&self) -> Option<f64> {
        self.noise_level.iter().copied().filter(|level| level.is_finite() && *level > 0.0).reduce(f64::min)
    }

    /// Magnitudes as they are drawn.
    fn drawn(&self) -> impl Fn(f64) -> f64 + use<> {
        let (db, reference) = (self.db, self.noise_floor().unwrap_or(1.0));
        move |magnitude| if db { 20.0 * (magnitude / reference).log10() } else { magnitude }
    }

    fn y_label(&self) -> String {
        match (self.db, self.noise_floor(), self.unit.as_str()) {
            (true, Some(_), _) => "magnitude in dB over the noise".into(),
            (true, None, "") => "magnitude in dB".into(),
            (true, None, unit) => format!("magnitude in dB over 1 {unit}"),
            (false, _, "") => "magnitude".into(),
            (false, _, unit) => format!("magnitude in {unit}"),
        }
    }

    /// The delays that are shown, in nanoseconds: those of the samples, or of the paths if there are none.
    fn delay_axis(&self) -> Axis {
        let axis = Axis::around(self.delay_s.iter().map(|delay_s| 1e9 * delay_s), false);
        match self.delay_s.len() {
            0 => Axis::around(self.paths().map(|path| 1e9 * path.delay_s), false).with_room(),
            _ => axis,
        }
    }

    /// The magnitudes that are shown, as they are drawn, with room above them in a share of the frame.
    fn magnitude_axis(&self, room: f64) -> Axis {
        let magnitudes = self.magnitude.iter().chain(&self.noise_level).copied();
        let magnitudes = magnitudes.chain(self.paths().map(|path| path.magnitude));
        // A fade to almost nothing does not set the scale in dB.
        let mut axis = Axis::around(magnitudes, self.db);
        if self.db {
            let drawn = self.drawn();
            let high = drawn(axis.high);
            axis = Axis { low: drawn(axis.low).max(high - MAX_RANGE_DB), high, log: false };
        } else {
            axis = axis.with_room();
        }
        axis.high += (axis.high - axis.low) * room / (1.0 - room);
        axis
    }

    fn legend(&self) -> Vec<(Key, String)> {
        let mut items = Vec::new();
        if !self.magnitude.is_empty() {
            items.push((Key::Line(MAGNITUDE), "response".to_owned()));
        }
        if !self.noise_level.is_empty() {
            items.push((Key::Line(NOISE), "noise and dense multipath".to_owned()));
        }
        let delays = self.delay_axis();
        for (paths, look, name) in [
            (&self.true_paths, TRUE_PATH, "true path"),
            (&self.estimated_paths, ESTIMATED_PATH, "estimated path"),
        ] {
            let outside = paths.iter().filter(|path| !is_within(&delays, 1e9 * path.delay_s)).count();
            // The reader must know that not all is shown.
            let name = match outside {
                0 => name.to_owned(),
                _ => format!("{name} ({outside} of {} outside)", paths.len()),
            };
            if !paths.is_empty() {
                items.push((Key::Marker(look.marker, look.ink, look.filled), name));
            }
        }
        items
    }

    /// The names of the paths in a frame of a width, from left to right.
    fn names(&self, width: f64) -> Vec<Name> {
        let delays = self.delay_axis();
        let of = |paths: &[ChannelPath], look: PathLook| {
            let drawable =
                |path: &&ChannelPath| is_within(&delays, 1e9 * path.delay_s) && path.magnitude.is_finite();
            let names = paths.iter().filter(drawable).map(|path| Name {
                text: shortened(&path.label, SIZE, 0.25 * width),
                x: width * delays.fraction(1e9 * path.delay_s),
                magnitude: path.magnitude,
                look,
                is_alone: false,
            });
            names.filter(|name| !name.text.is_empty()).collect::<Vec<_>>()
        };
        let mut names = of(&self.true_paths, TRUE_PATH);
        names.extend(of(&self.estimated_paths, ESTIMATED_PATH));
        names.sort_by(|a, b| a.x.total_cmp(&b.x));
        let places: Vec<f64> = names.iter().map(|name| name.x).collect();
        for (index, name) in names.iter_mut().enumerate() {
            let reach = 0.5 * text_width(&name.text, SIZE) + 10.0;
            let is_near = |x: f64| (x - name.x).abs() < reach;
            name.is_alone = reach < name.x
                && name.x < width - reach
                && !places.iter().enumerate().any(|(other, &x)| other != index && is_near(x));
            if name.is_alone {
                // It stands above all markers that are there, also those without names.
                let near = self.paths().filter(|path| is_near(width * delays.fraction(1e9 * path.delay_s)));
                name.magnitude = near.map(|path| path.magnitude).fold(name.magnitude, f64::max);
            }
        }
        names
    }

    /// The fewest lines that hold all names in a panel of a width.
    fn name_lines(&self, panel_width: f64) -> usize {
        let width = panel_width - LEFT_ROOM - RIGHT_ROOM;
        let names = crowded(self.names(width));
        let fits = |&lines: &usize| name_places(&names, width, lines).iter().all(Option::is_some);
        (0..MAX_NAME_LINES).find(fits).unwrap_or(MAX_NAME_LINES)
    }

    pub(super) fn height(&self, width: f64) -> f64 {
        let plot = (0.3 * width).max(210.0) + self.name_lines(width) as f64 * NAME_LINE;
        title_height(&self.title, width) + legend_height(&self.legend(), width) + ABOVE + plot + BELOW
    }

    pub(super) fn draw(&self, svg: &mut Svg, area: Area) {
        let name_lines = self.name_lines(area.width);
        let mut top = area.top + svg.title(&self.title, area.left, area.top, area.width);
        top += svg.legend(&self.legend(), area.left, top, area.width) + ABOVE;
        let height = area.bottom() - BELOW - top;
        // The highest marker and a short line up to its name need room, too.
        let y = self.magnitude_axis((name_lines as f64 * NAME_LINE + 26.0) / height);
        let left = area.left + Frame::left_room(&y.upright_ticks(height));
        // The last tick's label reaches over the frame's end.
        let area = Area { left, top, width: area.right() - left - RIGHT_ROOM, height };
        let frame = Frame { area, x: self.delay_axis(), y };
        frame.draw(svg, "delay in ns", &self.y_label());
        frame.draw_top_axis(svg, M_PER_NS, "range in m");
        svg.begin_clip(area);
        for (levels, stroke) in [(&self.noise_level, NOISE), (&self.magnitude, MAGNITUDE)] {
            let drawn = self.drawn();
            let points: Vec<_> = self
                .delay_s
                .iter()
                .zip(levels)
                // Nothing at all is far below the frame in dB, where the line goes on to be seen to fall.
                .map(|(delay_s, &level)| [1e9 * delay_s, drawn(level).max(2.0 * y.low - y.high)])
                .collect();
            draw_line(svg, &frame, &points, stroke);
        }
        svg.end_clip();
        self.draw_paths(svg, &frame);
        self.draw_names(svg, &frame, name_lines);
    }

    fn draw_paths(&self, svg: &mut Svg, frame: &Frame) {
        let drawn = self.drawn();
        // Truth is drawn first and larger, so that an estimate right on it shows both.
        for (paths, look) in [(&self.true_paths, TRUE_PATH), (&self.estimated_paths, ESTIMATED_PATH)] {
            for path in paths {
                let (delay_ns, level) = (1e9 * path.delay_s, drawn(path.magnitude).max(frame.y.low));
                if !is_within(&frame.x, delay_ns) || !is_within(&frame.y, level) {
                    continue;
                }
                let place = frame.place([delay_ns, level]);
                svg.line([place[0], frame.area.bottom()], place, Stroke::new(look.ink, look.stem));
                svg.marker(look.marker, place, look.radius, look.ink, look.filled);
            }
        }
    }

    fn draw_names(&self, svg: &mut Svg, frame: &Frame, lines: usize) {
        let (area, drawn) = (frame.area, self.drawn());
        let names = self.names(area.width);
        let marker_top = |name: &Name| {
            let level = drawn(name.magnitude).clamp(frame.y.low, frame.y.high);
            frame.place([frame.x.low, level])[1] - name.look.radius - 1.0
        };
        let style =
            |name: &Name| TextStyle { size: SIZE, colour: name.look.ink, halo: true, ..TextStyle::default() };
        for name in names.iter().filter(|name| name.is_alone) {
            let style = TextStyle { align: Align::Middle, ..style(name) };
            svg.text(&name.text, [area.left + name.x, marker_top(name) - 5.0], style);
        }
        let names = crowded(names);
        for (name, place) in names.iter().zip(name_places(&names, area.width, lines)) {
            let Some((line, left)) = place else { continue };
            let x = area.left + name.x;
            let bottom = area.top + 3.0 + (line + 1) as f64 * NAME_LINE;
            let stroke = Stroke { opacity: 0.6, ..Stroke::new(name.look.ink, 0.8) };
            svg.line([x, bottom], [x, marker_top(name).max(bottom)], stroke);
            svg.text(&name.text, [area.left + left, bottom - 4.0], style(name));
        }
    }
}

/// The names that do not have the room above their markers to themselves.
fn crowded(names: Vec<Name>) -> Vec<Name> {
    names.into_iter().filter(|name| !name.is_alone).collect()
}

/// The name of a path above its marker.
struct Name {
    text: String,
    /// Where the marker is, from the left end of the frame.
    x: f64,
    /// The magnitude of the path, or of the highest one that the name would cover.
    magnitude: f64,
    look: PathLook,
    /// Whether there is room for it right above the marker.
    is_alone: bool,
}

/// For each name, from left to right, its line from the top and its left end; none where there is no room. A
/// name stands as high as its line up from the marker can go: past the names before it, which stand higher
/// where they reach over it.
fn name_places(names: &[Name], width: f64, lines: usize) -> Vec<Option<(usize, f64)>> {
    // Up to where each line is taken, by names or by lines up to names above.
    let mut taken = vec![0.0_f64; lines];
    names
        .iter()
        .map(|name| {
            let text = text_width(&name.text, SIZE);
            let wanted = (name.x - 4.0).min(width - text - 3.0).max(1.0);
            let reach = name.x + 2.0;
            let fits = |&(_, left): &(usize, f64)| left <= reach && left + text <= width;
            let passable = taken.iter().rev().take_while(|&&end| end <= reach).count();
            let mut places = (lines - passable..lines).map(|line| (line, wanted.max(taken[line])));
            let (line, left) = places.find(fits)?;
            taken[line] = left + text + 6.0;
            taken[line + 1..].fill(reach);
            Some((line, left))
        })
        .collect()
}

/// How a path looks.
#[derive(Clone, Copy)]
struct PathLook {
    marker: Marker,
    ink: &'static str,
    filled: bool,
    radius: f64,
    stem: f64,
}

const TRUE_PATH: PathLook =
    PathLook { marker: Marker::Diamond, ink: INK, filled: false, radius: 5.8, stem: 1.3 };
const ESTIMATED_PATH: PathLook =
    PathLook { marker: Marker::Circle, ink: "#d55e00", filled: true, radius: 4.0, stem: 0.9 };

fn is_within(axis: &Axis, value: f64) -> bool {
    (axis.low..=axis.high).contains(&value)
}

#[cfg(test)]
mod tests {
    use super::super::png_of;
    use super::*;

    fn path(delay_ns: f64, magnitude: f64) -> ChannelPath {
        ChannelPath { delay_s: 1e-9 * delay_ns, magnitude, label: format!("path at {delay_ns} ns") }
    }

    #[test]
    fn decibels_count_from_the_lowest_noise_level() {
        let mut figure = ChannelFigure {
            noise_level: vec![0.0, 0.2, 0.02],
            unit: "mV".into(),
            db: true,
            ..ChannelFigure::default()
        };
        assert!((figure.drawn()(2.0) - 40.0).abs() < 1e-9);
        assert_eq!(figure.y_label(), "magnitude in dB over the noise");
        figure.noise_level.clear();
        assert!((figure.drawn()(10.0) - 20.0).abs() < 1e-9);
        assert_eq!(figure.y_label(), "magnitude in dB over 1 mV");
        figure.db = false;
        assert_eq!((figure.drawn()(2.0), figure.y_label()), (2.0, "magnitude in mV".into()));
    }

    #[test]
    fn paths_outside_of_the_samples_are_counted_in_the_legend() {
        let figure = ChannelFigure {
            delay_s: (0..100).map(|n| 1e-9 * f64::from(n)).collect(),
            magnitude: vec![1.0; 100],
            true_paths: vec![path(10.0, 3.0), path(400.0, 1.0)],
            ..ChannelFigure::default()
        };
        assert_eq!(figure.delay_axis().high, 99.0);
        assert_eq!(figure.legend()[1].1, "true path (1 of 2 outside)");
    }

    #[test]
    fn names_over_a_crowd_of_paths_neither_overlap_nor_cross_lines() {
        let figure = ChannelFigure {
            true_paths: (0..13).map(|n| path(f64::from(n * n) * 0.5, 1.0)).collect(),
            ..ChannelFigure::default()
        };
        let width = 700.0;
        let names = figure.names(width);
        let alone = names.iter().filter(|name| name.is_alone).count();
        assert_eq!((names.len(), alone > 0), (13, true));
        let names = crowded(names);
        let lines = figure.name_lines(width + LEFT_ROOM + RIGHT_ROOM);
        let places: Vec<_> = name_places(&names, width, lines).into_iter().flatten().collect();
        assert_eq!(places.len(), 13 - alone);
        for (index, &(line, left)) in places.iter().enumerate() {
            let right = left + text_width(&names[index].text, SIZE);
            assert!(left >= 0.0 && right <= width);
            for (other, &(other_line, other_left)) in places.iter().enumerate().filter(|(n, _)| *n != index) {
                let other_right = other_left + text_width(&names[other].text, SIZE);
                assert!(line != other_line || right < other_left || other_right < left, "{index} {other}");
                // The line up to the other name passes this one by if it goes higher.
                let x = names[other].x;
                assert!(other_line >= line || x < left || x > right, "{index} {other}");
            }
        }
    }

    #[test]
    fn odd_responses_are_drawn_too() {
        let odd = [f64::NAN, 0.0, -1.0, f64::INFINITY, 1e-200, 1e200];
        let series = [vec![], vec![1.0], odd.to_vec(), vec![0.5; 1000]];
        for db in [false, true] {
            for delay_s in &series {
                for magnitude in &series {
                    let figure = ChannelFigure {
                        title: "Anchor".into(),
                        delay_s: delay_s.clone(),
                        magnitude: magnitude.clone(),
                        noise_level: magnitude.clone(),
                        true_paths: odd.map(|value| path(value, value)).to_vec(),
                        estimated_paths: odd.map(|value| path(1.0, value)).to_vec(),
                        unit: String::new(),
                        db,
                    };
                    let svg = Picture::of(figure).svg();
                    assert!(!svg.contains("\"NaN") && !svg.contains("inf\""));
                    if delay_s.len() == magnitude.len() {
                        png_of(&svg).expect("is drawn");
                    }
                }
            }
        }
    }
}
