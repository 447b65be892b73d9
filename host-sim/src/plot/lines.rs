//! Lines over a common axis: carrier, entropy or error over time, and distributions.

use std::io;
use std::path::{Path, PathBuf};

use super::Picture;
use super::axis::{Axis, BELOW, Frame};
use super::blocks::{Block, block_legend, draw_blocks};
use super::svg::{
    Align, Area, Key, SOFT_INK, Stroke, Svg, TEXT_SIZE, TextStyle, colour, dashes, legend_height, text_width,
    title_height,
};

/// One line.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Series {
    /// Its name in the legend; lines of the same name share a colour and one entry. Empty: no entry.
    pub label: String,
    /// Its points, in drawing order. A point that is not finite interrupts the line.
    pub points: Vec<[f64; 2]>,
    /// Whether it stays in the background, as single runs behind their mean.
    pub faint: bool,
}

/// A shaded interval of the horizontal axis.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Span {
    /// Where it starts.
    pub from: f64,
    /// Where it ends.
    pub to: f64,
    /// What it stands for, written at its top.
    pub label: String,
}

/// A figure of lines.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LineFigure {
    /// The title.
    pub title: String,
    /// What the horizontal axis shows, with its unit.
    pub x_label: String,
    /// What the vertical axis shows, with its unit.
    pub y_label: String,
    /// The lines; later ones are drawn over earlier ones, faint ones below all others.
    pub series: Vec<Series>,
    /// Shaded intervals, behind the lines.
    pub spans: Vec<Span>,
    /// Whether the vertical axis is logarithmic; values that are not above zero are then not drawn.
    pub log_y: bool,
}

impl LineFigure {
    /// Writes `PATH.svg` and `PATH.png` and gives their paths.
    ///
    /// # Errors
    ///
    /// The disk refuses.
    pub fn write(&self, path_without_extension: impl AsRef<Path>) -> io::Result<[PathBuf; 2]> {
        Picture::of(self.clone()).write(path_without_extension)
    }

    pub(super) fn height(&self, width: f64) -> f64 {
        self.height_over(width, &[])
    }

    /// The height with blocks behind the lines.
    pub(super) fn height_over(&self, width: f64, blocks: &[Block]) -> f64 {
        let (_, mut legend) = looks(&self.series);
        legend.extend(block_legend(blocks));
        title_height(&self.title, width) + legend_height(&legend, width) + (0.36 * width).max(230.0) + BELOW
    }

    pub(super) fn draw(&self, svg: &mut Svg, area: Area) {
        self.draw_over(svg, area, &[], 0.0);
    }

    /// Draws the figure over shaded blocks, which its vertical axis then holds too. Every line of a new name is `nesting`
    /// thinner than those before it, so that lines on each other all remain visible.
    pub(super) fn draw_over(&self, svg: &mut Svg, area: Area, blocks: &[Block], nesting: f64) {
        let (looks, mut legend) = looks(&self.series);
        let last = looks.iter().copied().max().unwrap_or(0);
        let extra = |look: usize| nesting * (last - look) as f64;
        // Every name has a look; those without an entry in the legend are empty.
        let named = self.series.iter().zip(&looks).filter(|(series, _)| !series.label.is_empty());
        let mut named: Vec<usize> = named.map(|(_, &look)| look).collect();
        named.sort_unstable();
        named.dedup();
        for ((key, _), &look) in legend.iter_mut().zip(&named) {
            if let Key::Line(stroke) = key {
                stroke.width += extra(look);
            }
        }
        legend.extend(block_legend(blocks));
        let mut top = area.top + svg.title(&self.title, area.left, area.top, area.width);
        top += svg.legend(&legend, area.left, top, area.width) + 2.0;
        let height = area.bottom() - BELOW - top;
        let points = || self.series.iter().flat_map(|series| &series.points);
        let drawable = |point: &&[f64; 2]| is_drawable(point, self.log_y);
        let ends = self.spans.iter().flat_map(|span| [span.from, span.to]);
        let x = match points().next() {
            Some(_) => Axis::around(points().filter(drawable).map(|point| point[0]), false),
            None => Axis::around(ends, false),
        };
        let levels = points().filter(drawable).map(|point| point[1]);
        let edges = blocks.iter().flat_map(|block| block.y);
        let y = Axis::around(levels.chain(edges), self.log_y).with_room();
        let left = area.left + Frame::left_room(&y.upright_ticks(height));
        // The last tick's label reaches over the frame's end.
        let frame = Frame { area: Area { left, top, width: area.right() - left - 16.0, height }, x, y };
        draw_spans(svg, &self.spans, &frame);
        draw_blocks(svg, blocks, &frame);
        frame.draw(svg, &self.x_label, &self.y_label);
        svg.begin_clip(frame.area);
        for faint in [true, false] {
            for (series, &look) in self.series.iter().zip(&looks).filter(|(series, _)| series.faint == faint)
            {
                let mut stroke = stroke(look, faint);
                stroke.width += if faint { 0.0 } else { extra(look) };
                draw_line(svg, &frame, &series.points, stroke);
            }
        }
        svg.end_clip();
        label_spans(svg, &self.spans, &frame);
    }
}

/// For each line the number of its name among all names, which decides its look.
pub(super) fn looks(series: &[Series]) -> (Vec<usize>, Vec<(Key, String)>) {
    let mut names: Vec<&str> = Vec::new();
    let looks = series
        .iter()
        .map(|series| {
            names.iter().position(|name| *name == series.label).unwrap_or_else(|| {
                names.push(&series.label);
                names.len() - 1
            })
        })
        .collect();
    let legend = names
        .iter()
        .enumerate()
        .filter(|(_, name)| !name.is_empty())
        .map(|(look, name)| (Key::Line(stroke(look, false)), (*name).to_owned()))
        .collect();
    (looks, legend)
}

/// Where the spans lie in a frame.
pub(super) fn visible_spans<'a>(spans: &'a [Span], frame: &Frame) -> Vec<(Area, &'a str)> {
    spans
        .iter()
        .filter_map(|span| {
            let (from, to) =
                (span.from.min(span.to).max(frame.x.low), span.from.max(span.to).min(frame.x.high));
            if from.is_nan() || to.is_nan() || to < from {
                return None;
            }
            let (left, right) = (frame.place([from, frame.y.low])[0], frame.place([to, frame.y.low])[0]);
            Some((Area { left, width: (right - left).max(1.0), ..frame.area }, span.label.as_str()))
        })
        .collect()
}

fn draw_spans(svg: &mut Svg, spans: &[Span], frame: &Frame) {
    for (area, _) in visible_spans(spans, frame) {
        svg.rect(area, "#fbf0d9", None);
    }
}

/// Writes the spans' names at the top of a frame.
pub(super) fn label_spans(svg: &mut Svg, spans: &[Span], frame: &Frame) {
    let mut taken: Vec<Area> = Vec::new();
    for (area, label) in visible_spans(spans, frame) {
        let width = text_width(label, TEXT_SIZE);
        let middle = (area.left + 0.5 * area.width)
            .min(frame.area.right() - 0.5 * width - 4.0)
            .max(frame.area.left + 0.5 * width + 4.0);
        let mut place =
            Area { left: middle - 0.5 * width, top: frame.area.top + 4.0, width, height: TEXT_SIZE + 3.0 };
        // Neighbours with long labels step down.
        while taken.iter().any(|other| other.overlaps(&place)) && place.bottom() < frame.area.bottom() {
            place.top += place.height;
        }
        taken.push(place);
        let style = TextStyle { align: Align::Middle, colour: SOFT_INK, halo: true, ..TextStyle::default() };
        svg.text(label, [middle, place.top + TEXT_SIZE - 1.0], style);
    }
}

fn is_drawable(point: &[f64; 2], log_y: bool) -> bool {
    point.iter().all(|value| value.is_finite()) && (!log_y || point[1] > 0.0)
}

/// A line that points which cannot be drawn interrupt.
pub(super) fn draw_line(svg: &mut Svg, frame: &Frame, points: &[[f64; 2]], stroke: Stroke) {
    for run in points.split(|point| !is_drawable(point, frame.y.log)) {
        let places: Vec<_> = run.iter().map(|&point| frame.place(point)).collect();
        svg.polyline(&thinned(&places), stroke);
    }
}

pub(super) fn stroke(look: usize, faint: bool) -> Stroke {
    let (width, opacity) = if faint { (0.9, 0.3) } else { (1.8, 1.0) };
    Stroke { dashes: if faint { "" } else { dashes(look) }, opacity, ..Stroke::new(colour(look), width) }
}

/// Drops points that no eye can tell: of the neighbours within half a pixel to the side, the first, lowest, highest
/// and last stay.
fn thinned(places: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let mut kept = Vec::new();
    for column in places.chunk_by(|a, b| (2.0 * a[0]).floor() == (2.0 * b[0]).floor()) {
        if column.len() <= 4 {
            kept.extend_from_slice(column);
            continue;
        }
        let by_height = |&a: &usize, &b: &usize| column[a][1].total_cmp(&column[b][1]);
        let lowest = (0..column.len()).min_by(by_height).unwrap_or(0);
        let highest = (0..column.len()).max_by(by_height).unwrap_or(0);
        let mut places = [0, lowest.min(highest), lowest.max(highest), column.len() - 1].to_vec();
        places.dedup();
        kept.extend(places.into_iter().map(|index| column[index]));
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_lines_are_thinned_but_keep_their_extremes() {
        let places: Vec<[f64; 2]> = (0..100_000)
            .map(|n| [f64::from(n) * 0.008, if n == 55_555 { 99.0 } else { f64::from(n % 5) }])
            .collect();
        let kept = thinned(&places);
        assert!(kept.len() < 8000, "{}", kept.len());
        assert!(kept.contains(&places[55_555]));
        assert_eq!((kept.first(), kept.last()), (places.first(), places.last()));
    }

    #[test]
    fn lines_of_one_name_share_a_look_and_one_legend_entry() {
        let series = |label: &str, faint| Series { label: label.into(), points: Vec::new(), faint };
        let figure = LineFigure {
            series: vec![series("a", true), series("b", false), series("a", false), series("", false)],
            ..LineFigure::default()
        };
        let (looks, legend) = looks(&figure.series);
        assert_eq!(looks, [0, 1, 0, 2]);
        assert_eq!(legend.len(), 2);
    }

    #[test]
    fn values_that_cannot_be_drawn_interrupt_the_line() {
        let figure = LineFigure {
            series: vec![Series {
                label: "a".into(),
                points: vec![[0.0, 1.0], [1.0, 2.0], [2.0, f64::NAN], [3.0, 0.0], [4.0, 1.0], [5.0, 3.0]],
                faint: false,
            }],
            log_y: true,
            ..LineFigure::default()
        };
        let svg = Picture::of(figure).svg();
        assert_eq!(svg.matches("<polyline").count(), 2);
        assert!(!svg.contains("NaN") && !svg.contains("inf"));
    }
}
