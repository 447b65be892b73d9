//! A map of values over two axes as colours, or over one axis and named rows.

use std::io;
use std::path::{Path, PathBuf};

use super::Picture;
use super::axis::{Axis, BELOW, Frame, Tick, label_width};
use super::lines::{Series, Span, draw_line, label_spans, looks, stroke, visible_spans};
use super::svg::{
    Align, Area, INK, Key, Marker, SOFT_INK, Stroke, Svg, TEXT_SIZE, TextStyle, legend_height, shortened,
    title_height,
};

/// Colours from low to high values: of evenly rising lightness, so that equal steps look equal, also in grey
/// print and to the colour-blind.
const RAMP: [[u8; 3]; 11] = [
    [41, 1, 99],
    [39, 35, 124],
    [16, 64, 146],
    [2, 93, 145],
    [4, 118, 150],
    [5, 143, 156],
    [8, 169, 157],
    [34, 196, 146],
    [124, 213, 129],
    [190, 226, 114],
    [250, 236, 112],
];
/// Cells without a value.
const MISSING: &str = "#c9c9c9";
/// More cells than PNG pixels cannot be told apart.
const MAX_CELLS: [usize; 2] = [1600, 1200];
const BAR_GAP: f64 = 14.0;
const BAR_WIDTH: f64 = 15.0;
const LINE_WIDTH: f64 = 2.0;
const SPAN_LINE: f64 = TEXT_SIZE + 8.0;

/// What the rows of a heat map stand for.
#[derive(Clone, Debug, PartialEq)]
pub enum HeatRows {
    /// Intervals of a vertical axis: its outer edges, from the first row's low one up to the last row's high
    /// one.
    Axis([f64; 2]),
    /// Things of these names, from the top down, as the sources of paths.
    Named(Vec<String>),
}

impl Default for HeatRows {
    fn default() -> Self {
        Self::Axis([0.0, 1.0])
    }
}

/// Values over two axes, or over one axis and named rows, as colours. With named rows it shows well what was
/// visible when.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct HeatMap {
    /// The title.
    pub title: String,
    /// What the horizontal axis shows, with its unit.
    pub x_label: String,
    /// What the vertical axis shows, with its unit; may be empty for named rows.
    pub y_label: String,
    /// What the colours show, with its unit.
    pub value_label: String,
    /// The outer edges of the first and the last column, the lower one first.
    pub x: [f64; 2],
    /// What the rows stand for.
    pub rows: HeatRows,
    /// The values, row by row. One that is not finite leaves its cell grey, or blank in a named row; a row
    /// that is shorter than others goes on so. Maps finer than the picture are averaged.
    pub values: Vec<Vec<f64>>,
    /// The values at the ends of the colour scale, the lower one first, so that maps can be compared;
    /// else, or where there can be no such scale, those of this map.
    pub value_range: Option<[f64; 2]>,
    /// Whether the colour scale is logarithmic; values that are not above zero then have the lowest colour.
    pub log: bool,
    /// Lines over the map. With named rows, the n-th row from the top lies between n - 1 and n on their
    /// vertical axis.
    pub lines: Vec<Series>,
    /// Intervals of the horizontal axis, marked at their ends.
    pub spans: Vec<Span>,
}

impl HeatMap {
    /// Writes `PATH.svg` and `PATH.png` and gives their paths.
    ///
    /// # Errors
    ///
    /// The disk refuses.
    pub fn write(&self, path_without_extension: impl AsRef<Path>) -> io::Result<[PathBuf; 2]> {
        Picture::of(self.clone()).write(path_without_extension)
    }

    fn row_count(&self) -> usize {
        match &self.rows {
            HeatRows::Axis(_) => self.values.len(),
            HeatRows::Named(names) => names.len().max(self.values.len()),
        }
    }

    fn column_count(&self) -> usize {
        self.values.iter().map(Vec::len).max().unwrap_or(0)
    }

    fn legend(&self) -> Vec<(Key, String)> {
        let (_, mut legend) = looks(&self.lines);
        for (key, _) in &mut legend {
            if let Key::Line(stroke) = key {
                stroke.width = LINE_WIDTH;
            }
        }
        let columns = self.column_count();
        let has_gap = |row: &Vec<f64>| row.len() < columns || row.iter().any(|value| !value.is_finite());
        if matches!(self.rows, HeatRows::Axis(_)) && self.values.iter().any(has_gap) {
            legend.push((Key::Marker(Marker::Square, MISSING, true), "no value".into()));
        }
        legend
    }

    /// The height of the frame in a panel of a width.
    fn plot_height(&self, width: f64) -> f64 {
        match self.rows {
            HeatRows::Axis(_) => (0.36 * width).max(230.0),
            HeatRows::Named(_) => (19.0 * self.row_count() as f64).clamp(80.0, 700.0),
        }
    }

    /// The height of the title, the legend and the names of the spans.
    fn head_height(&self, width: f64) -> f64 {
        let spans = if self.spans.iter().any(|span| !span.label.is_empty()) { SPAN_LINE } else { 8.0 };
        title_height(&self.title, width) + legend_height(&self.legend(), width) + spans
    }

    pub(super) fn height(&self, width: f64) -> f64 {
        self.head_height(width) + self.plot_height(width) + BELOW
    }

    pub(super) fn draw(&self, svg: &mut Svg, area: Area) {
        let below_title = area.top + svg.title(&self.title, area.left, area.top, area.width);
        svg.legend(&self.legend(), area.left, below_title, area.width);
        let top = area.top + self.head_height(area.width);
        let height = match self.rows {
            HeatRows::Axis(_) => area.bottom() - BELOW - top,
            // Few rows do not become thick beside a taller panel.
            HeatRows::Named(_) => self.plot_height(area.width),
        };
        let scale = match self.value_range {
            Some([low, high]) if low < high && (!self.log || low > 0.0) && (high - low).is_finite() => {
                Axis { low, high, log: self.log }
            }
            _ => Axis::around(self.values.iter().flatten().copied(), self.log),
        };
        let (y, y_ticks) = self.y_axis(height, 0.3 * area.width);
        let left = area.left + Frame::left_room(&y_ticks);
        let bar_ticks = scale.ticks((height / 45.0).max(3.0) as usize);
        let bar_room = BAR_GAP + BAR_WIDTH + bar_label_width(&bar_ticks) + TEXT_SIZE + 18.0;
        let area = Area { left, top, width: area.right() - bar_room - left, height };
        let frame = Frame { area, x: Axis::around(self.x.into_iter(), false), y };
        frame.draw_with(svg, &self.x_label, &self.y_label, &y_ticks);
        if matches!(self.rows, HeatRows::Axis(_)) && !self.values.is_empty() {
            svg.rect(area, MISSING, None);
        }
        self.draw_cells(svg, area, &scale);
        frame.draw_marks(svg, &y_ticks);
        self.draw_over(svg, &frame);
        let bar = Area { left: area.right() + BAR_GAP, width: BAR_WIDTH, ..area };
        self.draw_bar(svg, bar, scale, &bar_ticks);
    }

    /// The vertical axis and its ticks for a frame of a height, with names of at most a width.
    fn y_axis(&self, height: f64, name_width: f64) -> (Axis, Vec<Tick>) {
        match &self.rows {
            HeatRows::Axis(ends) => {
                let axis = Axis::around(ends.iter().copied(), false);
                (axis, axis.upright_ticks(height))
            }
            HeatRows::Named(names) => {
                let count = self.row_count().max(1) as f64;
                // From the top down.
                let axis = Axis { low: count, high: 0.0, log: false };
                // Where rows are too thin for all names, some stand for their neighbours.
                let every = ((TEXT_SIZE + 2.0) * count / height).ceil().max(1.0) as usize;
                let tick = |(index, name): (usize, &String)| Tick {
                    value: index as f64 + 0.5,
                    label: shortened(name, TEXT_SIZE, name_width),
                };
                (axis, names.iter().enumerate().step_by(every).map(tick).collect())
            }
        }
    }

    fn draw_cells(&self, svg: &mut Svg, area: Area, scale: &Axis) {
        let size = [self.column_count(), self.row_count()];
        if size.contains(&0) {
            return;
        }
        let steps = [0, 1].map(|axis| size[axis].div_ceil(MAX_CELLS[axis]));
        let [columns, rows] = [0, 1].map(|axis| size[axis].div_ceil(steps[axis]));
        let cell = |column: usize, row: usize| {
            let values = self.values.iter().skip(row * steps[1]).take(steps[1]);
            let values = values.flat_map(|row| row.iter().skip(column * steps[0]).take(steps[0]));
            let (sum, count) = values
                .filter(|value| value.is_finite())
                .fold((0.0, 0.0), |(sum, count), value| (sum + value, count + 1.0));
            (count > 0.0).then(|| ramp(scale.fraction(sum / count)))
        };
        let upward = matches!(self.rows, HeatRows::Axis(_));
        let pixels: Vec<_> = (0..rows)
            .flat_map(|row| {
                (0..columns).map(move |column| (column, if upward { rows - 1 - row } else { row }))
            })
            .map(|(column, row)| cell(column, row))
            .collect();
        // The last averaged row and column may reach over the map's edge.
        let width = area.width * (columns * steps[0]) as f64 / size[0] as f64;
        let height = area.height * (rows * steps[1]) as f64 / size[1] as f64;
        let top = if upward { area.bottom() - height } else { area.top };
        svg.begin_clip(area);
        svg.image(Area { left: area.left, top, width, height }, columns, &pixels);
        svg.end_clip();
    }

    /// Lines and spans, and gaps between named rows.
    fn draw_over(&self, svg: &mut Svg, frame: &Frame) {
        let area = frame.area;
        let count = self.row_count();
        if matches!(self.rows, HeatRows::Named(_)) && area.height > 8.0 * count as f64 {
            for row in 1..count {
                let y = frame.place([frame.x.low, row as f64])[1];
                svg.line([area.left, y], [area.right(), y], Stroke::new("#ffffff", 2.0));
            }
            svg.rect(area, "none", Some(Stroke::new("#999999", 1.0)));
        }
        svg.begin_clip(area);
        for (span, _) in visible_spans(&self.spans, frame) {
            for x in [span.left, span.right()] {
                svg.line([x, area.top], [x, area.bottom()], Stroke::new("#ffffff", 3.0));
                svg.line(
                    [x, area.top],
                    [x, area.bottom()],
                    Stroke { dashes: "4 3", ..Stroke::new(INK, 1.2) },
                );
            }
        }
        let (looks, _) = looks(&self.lines);
        for (series, look) in self.lines.iter().zip(looks) {
            let width = if series.faint { 0.6 } else { 1.0 } * LINE_WIDTH;
            // A white edge sets the line off from whatever colour is below.
            draw_line(svg, frame, &series.points, Stroke::new("#ffffff", width + 2.4));
            draw_line(svg, frame, &series.points, Stroke { width, ..stroke(look, false) });
        }
        svg.end_clip();
        // Their names stand above, off the colours.
        let above = Area { top: area.top - SPAN_LINE, height: SPAN_LINE, ..area };
        label_spans(svg, &self.spans, &Frame { area: above, ..*frame });
    }

    fn draw_bar(&self, svg: &mut Svg, bar: Area, scale: Axis, ticks: &[Tick]) {
        let steps = 200;
        let colours: Vec<_> =
            (0..steps).map(|step| Some(ramp(1.0 - (f64::from(step) + 0.5) / f64::from(steps)))).collect();
        svg.image(bar, 1, &colours);
        svg.rect(bar, "none", Some(Stroke::new("#999999", 1.0)));
        let finite = || self.values.iter().flatten().filter(|value| value.is_finite());
        let middle = bar.left + 0.5 * bar.width;
        // A tip at an end tells of values beyond it, which have the colour of that end.
        let below = finite().any(|&value| value < scale.low);
        let above = finite().any(|&value| value > scale.high);
        for (beyond, y, tip, fraction) in [(below, bar.bottom(), 7.0, 0.0), (above, bar.top, -7.0, 1.0)] {
            if beyond {
                let corners = [[bar.left, y], [bar.right(), y], [middle, y + tip]];
                let [red, green, blue] = ramp(fraction);
                svg.polygon(
                    &corners,
                    &format!("#{red:02x}{green:02x}{blue:02x}"),
                    Some(Stroke::new("#999999", 1.0)),
                );
            }
        }
        for tick in ticks {
            let y = bar.bottom() - scale.fraction(tick.value) * bar.height;
            let length = if tick.label.is_empty() { 2.5 } else { 4.0 };
            svg.line([bar.right(), y], [bar.right() + length, y], Stroke::new("#999999", 1.0));
            let style = TextStyle { colour: SOFT_INK, ..TextStyle::default() };
            svg.text(&tick.label, [bar.right() + 7.0, y + 0.36 * TEXT_SIZE], style);
        }
        let x = bar.right() + bar_label_width(ticks) + 11.0 + TEXT_SIZE;
        let label = shortened(&self.value_label, TEXT_SIZE, bar.height + BELOW);
        let style = TextStyle { align: Align::Middle, upright: true, ..TextStyle::default() };
        svg.text(&label, [x, bar.top + 0.5 * bar.height], style);
    }
}

/// The room for the labels of the colour bar; mostly the same, so that the frames of stacked panels align.
fn bar_label_width(ticks: &[Tick]) -> f64 {
    label_width(ticks).max(34.0)
}

/// The colour of a fraction of the scale; below the low end and above the high end, that of the end.
fn ramp(fraction: f64) -> [u8; 3] {
    // The logarithm of a value below zero is not a number: it lies below.
    let fraction = if fraction > 0.0 { fraction.min(1.0) } else { 0.0 };
    let place = fraction * (RAMP.len() - 1) as f64;
    let index = (place as usize).min(RAMP.len() - 2);
    let part = place - index as f64;
    std::array::from_fn(|channel| {
        let (from, to) = (f64::from(RAMP[index][channel]), f64::from(RAMP[index + 1][channel]));
        (from + part * (to - from)).round() as u8
    })
}

#[cfg(test)]
mod tests {
    use super::super::png_of;
    use super::*;

    /// The part of white's light that a colour of the ramp gives back, as the eye grades it: CIE L*.
    fn lightness(colour: [u8; 3]) -> f64 {
        let linear = colour.map(|channel| {
            let channel = f64::from(channel) / 255.0;
            if channel <= 0.04045 { channel / 12.92 } else { ((channel + 0.055) / 1.055).powf(2.4) }
        });
        let luminance = 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2];
        if luminance > 0.008_856 { 116.0 * luminance.cbrt() - 16.0 } else { 903.3 * luminance }
    }

    fn map(values: Vec<Vec<f64>>, rows: HeatRows) -> HeatMap {
        HeatMap {
            title: "Likelihood".into(),
            x_label: "time in s".into(),
            y_label: "range in m".into(),
            value_label: "SINR in dB".into(),
            x: [0.0, 10.0],
            rows,
            values,
            ..HeatMap::default()
        }
    }

    #[test]
    fn the_colours_become_lighter_evenly() {
        let steps: Vec<f64> = (0..10)
            .map(|n| lightness(ramp(f64::from(n + 1) / 10.0)) - lightness(ramp(f64::from(n) / 10.0)))
            .collect();
        assert!(steps.iter().all(|&step| (5.5..11.5).contains(&step)), "{steps:?}");
    }

    #[test]
    fn values_outside_the_scale_have_the_colours_of_its_ends() {
        assert_eq!((ramp(-3.0), ramp(7.0)), (RAMP[0], RAMP[10]));
        assert_eq!((ramp(f64::NAN), ramp(f64::INFINITY)), (RAMP[0], RAMP[10]));
        let tips = |figure: &HeatMap| Picture::of(figure.clone()).svg().matches("<polygon").count();
        let mut figure = map(vec![vec![-1.0, 0.5, 2.0]], HeatRows::default());
        assert_eq!(tips(&figure), 0);
        figure.value_range = Some([0.0, 1.0]);
        assert_eq!(tips(&figure), 2);
    }

    #[test]
    fn the_first_row_is_lowest_on_an_axis_and_highest_by_name() {
        let values = vec![vec![0.0], vec![1.0], vec![f64::NAN]];
        let pixel_at = |rows: HeatRows, share: f64| {
            let figure = map(values.clone(), rows);
            let picture = Picture::of(figure.clone());
            let png = png_of(&picture.svg()).expect("is drawn");
            let pixmap = resvg::tiny_skia::Pixmap::decode_png(&png).expect("is a PNG");
            // The title takes the top, the axis the bottom.
            let (top, bottom) = (10.0 + title_height("Likelihood", 900.0) + 8.0, BELOW + 10.0);
            let top = if matches!(figure.rows, HeatRows::Axis(_)) { top + 23.0 } else { top };
            let height = f64::from(pixmap.height()) / 2.0 - top - bottom;
            let y = (2.0 * (top + share * height)) as u32;
            let pixel = pixmap.pixel(pixmap.width() / 3, y).expect("is inside");
            [pixel.red(), pixel.green(), pixel.blue()]
        };
        let named = || HeatRows::Named(vec!["a".into(), "b".into(), "c".into()]);
        assert_eq!(pixel_at(HeatRows::default(), 0.9), RAMP[0]);
        assert_eq!(pixel_at(HeatRows::default(), 0.6), RAMP[10]);
        assert_eq!(pixel_at(HeatRows::default(), 0.1), [0xc9; 3]);
        assert_eq!(pixel_at(named(), 0.1), RAMP[0]);
        assert_eq!(pixel_at(named(), 0.4), RAMP[10]);
        assert_eq!(pixel_at(named(), 0.9), [0xff; 3]);
    }

    #[test]
    fn a_large_map_is_one_image_and_a_small_text() {
        let values: Vec<Vec<f64>> =
            (0..40).map(|row| (0..5000).map(|n| f64::from(n * row % 977)).collect()).collect();
        let svg = Picture::of(map(values, HeatRows::Axis([0.0, 8.0]))).svg();
        assert_eq!(svg.matches("<image").count(), 2);
        assert!(svg.len() < 300_000, "{}", svg.len());
    }

    #[test]
    fn odd_maps_are_drawn_too() {
        let nan = f64::NAN;
        for values in [
            vec![],
            vec![vec![]],
            vec![vec![3.0]],
            vec![vec![nan; 3]; 2],
            vec![vec![1.0, nan], vec![], vec![0.0, -1.0, 1e300, f64::INFINITY]],
        ] {
            for names in [0, 2, 200] {
                for (x, log) in [([0.0, 1.0], true), ([nan, nan], false), ([5.0, 5.0], false)] {
                    let rows = match names {
                        0 => HeatRows::Axis(x),
                        _ => HeatRows::Named(vec!["a rather long name of a source ".repeat(5); names]),
                    };
                    let line =
                        Series { label: "a".into(), points: vec![[0.0, nan], [1.0, 1.0]], faint: true };
                    let figure =
                        HeatMap { x, log, lines: vec![line], value_range: None, ..map(values.clone(), rows) };
                    let svg = Picture::of(figure).svg();
                    assert!(!svg.contains("NaN") && !svg.contains("inf\""));
                    if names == 0 && !log {
                        png_of(&svg).expect("is drawn");
                    }
                }
            }
        }
    }
}
