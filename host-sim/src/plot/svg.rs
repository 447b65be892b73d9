//! The few SVG elements that the figures need, and the widths of their letters.

use std::fmt::Write;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use resvg::tiny_skia::{IntSize, Pixmap};

/// The font that the PNG is rendered with; a browser may fall back to another of similar width.
pub(super) const FONT: &str = "DejaVu Sans";
pub(super) const TEXT_SIZE: f64 = 13.0;
pub(super) const TITLE_SIZE: f64 = 15.0;
pub(super) const INK: &str = "#222222";
pub(super) const SOFT_INK: &str = "#666666";
pub(super) const GRID: &str = "#e6e6e6";

/// Colours that stay distinct for most colour-blind readers and in grey print.
const COLOURS: [&str; 6] = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#a07500"];
const DASHES: [&str; 4] = ["", "7 3", "2 3", "9 3 2 3"];

/// The colour of the n-th line; lines past the last colour differ by their dashes.
pub(super) fn colour(n: usize) -> &'static str {
    COLOURS[n % COLOURS.len()]
}

/// The dashes of the n-th line.
pub(super) fn dashes(n: usize) -> &'static str {
    DASHES[n / COLOURS.len() % DASHES.len()]
}

/// A rectangle of the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Area {
    pub(super) left: f64,
    pub(super) top: f64,
    pub(super) width: f64,
    pub(super) height: f64,
}

impl Area {
    pub(super) fn right(&self) -> f64 {
        self.left + self.width
    }

    pub(super) fn bottom(&self) -> f64 {
        self.top + self.height
    }

    pub(super) fn contains(&self, [x, y]: [f64; 2]) -> bool {
        x >= self.left && x <= self.right() && y >= self.top && y <= self.bottom()
    }

    pub(super) fn overlaps(&self, other: &Self) -> bool {
        self.left < other.right()
            && other.left < self.right()
            && self.top < other.bottom()
            && other.top < self.bottom()
    }
}

/// Advance widths of the letters from space to tilde, in thousandths of the size.
#[rustfmt::skip]
const ADVANCES: [u16; 95] = [
    318, 401, 460, 838, 636, 950, 780, 275, 390, 390, 500, 838, 318, 361, 318, 337, 636, 636, 636, 636, 636, 636, 636,
    636, 636, 636, 337, 337, 838, 838, 838, 531, 1000, 684, 686, 698, 770, 632, 575, 775, 752, 295, 295, 656, 557, 863,
    748, 787, 603, 787, 695, 635, 611, 732, 684, 989, 685, 611, 685, 390, 337, 390, 838, 500, 500, 613, 635, 550, 635,
    615, 352, 635, 634, 278, 278, 579, 278, 974, 634, 612, 635, 635, 411, 521, 392, 634, 592, 818, 592, 592, 525, 636,
    337, 636, 838,
];

/// The width of a text in regular weight.
pub(super) fn text_width(text: &str, size: f64) -> f64 {
    let thousandths: u32 = text
        .chars()
        .map(|letter| {
            (letter as usize).checked_sub(32).and_then(|index| ADVANCES.get(index)).copied().unwrap_or(700)
        })
        .map(u32::from)
        .sum();
    f64::from(thousandths) * size / 1000.0
}

/// Breaks a text into lines that fit into a width; a single word may still be wider.
pub(super) fn wrapped(text: &str, size: f64, width: f64) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if text_width(line, size) + text_width(word, size) + 0.4 * size <= width => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

/// A text cut to a width; an ellipsis stands for what was cut.
pub(super) fn shortened(text: &str, size: f64, width: f64) -> String {
    if text_width(text, size) <= width {
        return text.to_owned();
    }
    let mut kept = text.to_owned();
    while kept.pop().is_some() && text_width(&kept, size) + size > width {}
    format!("{}…", kept.trim_end())
}

/// Where a text hangs from its point.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Align {
    Start,
    Middle,
    End,
}

/// How a text looks.
#[derive(Clone, Copy)]
pub(super) struct TextStyle {
    pub(super) align: Align,
    pub(super) size: f64,
    pub(super) bold: bool,
    pub(super) colour: &'static str,
    /// A white edge, for texts over lines.
    pub(super) halo: bool,
    /// Turned to read from bottom to top.
    pub(super) upright: bool,
}

impl Default for TextStyle {
    fn default() -> Self {
        Self { align: Align::Start, size: TEXT_SIZE, bold: false, colour: INK, halo: false, upright: false }
    }
}

/// How a line looks.
#[derive(Clone, Copy)]
pub(super) struct Stroke {
    pub(super) colour: &'static str,
    pub(super) width: f64,
    pub(super) dashes: &'static str,
    pub(super) opacity: f64,
}

impl Stroke {
    pub(super) const fn new(colour: &'static str, width: f64) -> Self {
        Self { colour, width, dashes: "", opacity: 1.0 }
    }
}

/// The shape of a marker.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Marker {
    Circle,
    Square,
    Triangle,
    Diamond,
}

/// What stands before a legend's text.
#[derive(Clone, Copy)]
pub(super) enum Key {
    Line(Stroke),
    Marker(Marker, &'static str, bool),
    Ellipse(&'static str),
}

/// A picture that is being drawn.
pub(super) struct Svg {
    text: String,
}

// Writing to a String cannot fail, so the results of write! are dropped throughout.
impl Svg {
    pub(super) fn new(width: f64, height: f64) -> Self {
        let mut text = String::new();
        let _ = write!(
            text,
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width:.0}\" height=\"{height:.0}\" \
             viewBox=\"0 0 {width:.0} {height:.0}\" font-family=\"'{FONT}', Verdana, sans-serif\">\n\
             <rect width=\"{width:.0}\" height=\"{height:.0}\" fill=\"#ffffff\"/>\n"
        );
        Self { text }
    }

    pub(super) fn finish(mut self) -> String {
        self.text.push_str("</svg>\n");
        self.text
    }

    /// What is drawn until [`Svg::end_clip`] shows inside the area only. Coordinates stay those of the picture.
    pub(super) fn begin_clip(&mut self, area: Area) {
        let Area { left, top, width, height } = area;
        // An inner svg clips without an identifier, which could clash inside a page with several pictures.
        let _ = writeln!(
            self.text,
            "<svg x=\"{left:.2}\" y=\"{top:.2}\" width=\"{width:.2}\" height=\"{height:.2}\" \
             viewBox=\"{left:.2} {top:.2} {width:.2} {height:.2}\">"
        );
    }

    pub(super) fn end_clip(&mut self) {
        self.text.push_str("</svg>\n");
    }

    pub(super) fn rect(&mut self, area: Area, fill: &str, stroke: Option<Stroke>) {
        let Area { left, top, width, height } = area;
        let _ = write!(
            self.text,
            "<rect x=\"{left:.2}\" y=\"{top:.2}\" width=\"{width:.2}\" height=\"{height:.2}\" fill=\"{fill}\""
        );
        self.stroke(stroke);
        self.text.push_str("/>\n");
    }

    fn stroke(&mut self, stroke: Option<Stroke>) {
        let Some(Stroke { colour, width, dashes, opacity }) = stroke else { return };
        let _ = write!(self.text, " stroke=\"{colour}\" stroke-width=\"{width}\"");
        if !dashes.is_empty() {
            let _ = write!(self.text, " stroke-dasharray=\"{dashes}\"");
        }
        if opacity < 1.0 {
            let _ = write!(self.text, " stroke-opacity=\"{opacity}\"");
        }
    }

    pub(super) fn line(&mut self, from: [f64; 2], to: [f64; 2], stroke: Stroke) {
        let _ = write!(
            self.text,
            "<line x1=\"{:.2}\" y1=\"{:.2}\" x2=\"{:.2}\" y2=\"{:.2}\" stroke-linecap=\"round\"",
            from[0], from[1], to[0], to[1]
        );
        self.stroke(Some(stroke));
        self.text.push_str("/>\n");
    }

    pub(super) fn polyline(&mut self, points: &[[f64; 2]], stroke: Stroke) {
        match points {
            [] => {}
            // A lone point would be invisible.
            [point] => self.marker(Marker::Circle, *point, stroke.width, stroke.colour, true),
            _ => {
                self.text.push_str("<polyline fill=\"none\" stroke-linejoin=\"round\" points=\"");
                self.points(points);
                self.text.push('"');
                self.stroke(Some(stroke));
                self.text.push_str("/>\n");
            }
        }
    }

    fn points(&mut self, points: &[[f64; 2]]) {
        for (index, [x, y]) in points.iter().enumerate() {
            let gap = if index == 0 { "" } else { " " };
            let _ = write!(self.text, "{gap}{x:.2},{y:.2}");
        }
    }

    pub(super) fn polygon(&mut self, points: &[[f64; 2]], fill: &str, stroke: Option<Stroke>) {
        self.text.push_str("<polygon points=\"");
        self.points(points);
        let _ = write!(self.text, "\" fill=\"{fill}\"");
        self.stroke(stroke);
        self.text.push_str("/>\n");
    }

    /// A polygon that leaves visible what is below it.
    pub(super) fn band(&mut self, points: &[[f64; 2]], colour: &str) {
        self.text.push_str("<polygon points=\"");
        self.points(points);
        let _ = writeln!(self.text, "\" fill=\"{colour}\" fill-opacity=\"0.22\"/>");
    }

    /// A marker of a radius; hollow ones are filled with white.
    pub(super) fn marker(
        &mut self,
        marker: Marker,
        [x, y]: [f64; 2],
        radius: f64,
        colour: &'static str,
        filled: bool,
    ) {
        let fill = if filled { colour } else { "#ffffff" };
        let edge = Some(Stroke::new(if filled { "#ffffff" } else { colour }, if filled { 0.8 } else { 1.8 }));
        match marker {
            Marker::Circle => {
                let _ = write!(
                    self.text,
                    "<circle cx=\"{x:.2}\" cy=\"{y:.2}\" r=\"{radius:.2}\" fill=\"{fill}\""
                );
                self.stroke(edge);
                self.text.push_str("/>\n");
            }
            Marker::Square => {
                let side = 1.8 * radius;
                let area = Area { left: x - 0.9 * radius, top: y - 0.9 * radius, width: side, height: side };
                self.rect(area, fill, edge);
            }
            Marker::Triangle => {
                let (half, low) = (1.1 * radius, 0.8 * radius);
                self.polygon(&[[x, y - 1.2 * radius], [x + half, y + low], [x - half, y + low]], fill, edge);
            }
            Marker::Diamond => {
                let half = 1.2 * radius;
                self.polygon(&[[x, y - half], [x + half, y], [x, y + half], [x - half, y]], fill, edge);
            }
        }
    }

    /// An ellipse whose longer half axis is turned by an angle, clockwise in the picture.
    pub(super) fn ellipse(
        &mut self,
        [x, y]: [f64; 2],
        half_axes: [f64; 2],
        degrees: f64,
        colour: &'static str,
    ) {
        let [a, b] = half_axes;
        let _ = writeln!(
            self.text,
            "<ellipse cx=\"{x:.2}\" cy=\"{y:.2}\" rx=\"{a:.2}\" ry=\"{b:.2}\" \
             transform=\"rotate({degrees:.2} {x:.2} {y:.2})\" fill=\"{colour}\" fill-opacity=\"0.13\" \
             stroke=\"{colour}\" stroke-width=\"0.9\" stroke-opacity=\"0.7\"/>"
        );
    }

    /// An image of square-cornered pixels, row by row from the top, stretched over an area. Where there is no
    /// colour, what lies below shows.
    pub(super) fn image(&mut self, area: Area, width: usize, pixels: &[Option<[u8; 3]>]) {
        let Some(png) = png_of(width, pixels) else { return };
        let Area { left, top, width, height } = area;
        let _ = writeln!(
            self.text,
            "<image x=\"{left:.2}\" y=\"{top:.2}\" width=\"{width:.2}\" height=\"{height:.2}\" \
             preserveAspectRatio=\"none\" style=\"image-rendering:pixelated\" \
             href=\"data:image/png;base64,{}\"/>",
            STANDARD.encode(png)
        );
    }

    pub(super) fn text(&mut self, text: &str, [x, y]: [f64; 2], style: TextStyle) {
        let TextStyle { align, size, bold, colour, halo, upright } = style;
        let anchor = match align {
            Align::Start => "start",
            Align::Middle => "middle",
            Align::End => "end",
        };
        let _ = write!(
            self.text,
            "<text x=\"{x:.2}\" y=\"{y:.2}\" font-size=\"{size}\" fill=\"{colour}\" text-anchor=\"{anchor}\""
        );
        if bold {
            self.text.push_str(" font-weight=\"bold\"");
        }
        if halo {
            self.text.push_str(
                " stroke=\"#ffffff\" stroke-width=\"3\" stroke-linejoin=\"round\" paint-order=\"stroke\"",
            );
        }
        if upright {
            let _ = write!(self.text, " transform=\"rotate(-90 {x:.2} {y:.2})\"");
        }
        self.text.push('>');
        for letter in text.chars() {
            match letter {
                '&' => self.text.push_str("&amp;"),
                '<' => self.text.push_str("&lt;"),
                '>' => self.text.push_str("&gt;"),
                // XML has no place for these, not even escaped.
                letter if letter.is_control() || matches!(letter, '\u{fffe}' | '\u{ffff}') => {
                    self.text.push(' ')
                }
                letter => self.text.push(letter),
            }
        }
        self.text.push_str("</text>\n");
    }

    /// A bold title from the left; gives the height it took.
    pub(super) fn title(&mut self, title: &str, left: f64, top: f64, width: f64) -> f64 {
        for (index, line) in title_lines(title, width).iter().enumerate() {
            let baseline = top + TITLE_SIZE + index as f64 * 1.25 * TITLE_SIZE;
            let style = TextStyle { size: TITLE_SIZE, bold: true, ..TextStyle::default() };
            self.text(line, [left, baseline], style);
        }
        title_height(title, width)
    }

    /// A legend in lines of at most a width; gives the height it took.
    pub(super) fn legend(&mut self, items: &[(Key, String)], left: f64, top: f64, width: f64) -> f64 {
        for ((key, label), [x, y]) in items.iter().zip(legend_places(items, width)) {
            let (x, middle) = (left + x, top + y + 0.5 * LEGEND_LINE);
            let centre = [x + 0.5 * LEGEND_KEY, middle];
            match *key {
                Key::Line(stroke) => self.line([x, middle], [x + LEGEND_KEY, middle], stroke),
                Key::Marker(marker, colour, filled) => self.marker(marker, centre, 5.0, colour, filled),
                Key::Ellipse(colour) => self.ellipse(centre, [0.45 * LEGEND_KEY, 5.0], 0.0, colour),
            }
            self.text(label, [x + LEGEND_KEY + 6.0, middle + 0.36 * TEXT_SIZE], TextStyle::default());
        }
        legend_height(items, width)
    }
}

/// Pixels as a PNG file; none if there are no whole rows of them.
fn png_of(width: usize, pixels: &[Option<[u8; 3]>]) -> Option<Vec<u8>> {
    let rgba = pixels.iter().flat_map(|pixel| match *pixel {
        Some([red, green, blue]) => [red, green, blue, u8::MAX],
        None => [0; 4],
    });
    let height = pixels.len().checked_div(width)?;
    let size = IntSize::from_wh(width.try_into().ok()?, height.try_into().ok()?)?;
    Pixmap::from_vec(rgba.collect(), size)?.encode_png().ok()
}

const LEGEND_LINE: f64 = 19.0;
const LEGEND_KEY: f64 = 24.0;

// Bold letters are about a tenth wider.
fn title_lines(title: &str, width: f64) -> Vec<String> {
    wrapped(title, 1.12 * TITLE_SIZE, width)
}

pub(super) fn title_height(title: &str, width: f64) -> f64 {
    title_lines(title, width).len() as f64 * 1.25 * TITLE_SIZE + 4.0
}

/// Where each item of a legend stands.
fn legend_places(items: &[(Key, String)], width: f64) -> Vec<[f64; 2]> {
    let (mut x, mut y) = (0.0, 0.0);
    items
        .iter()
        .map(|(_, label)| {
            let item_width = LEGEND_KEY + 6.0 + text_width(label, TEXT_SIZE);
            if x > 0.0 && x + item_width > width {
                (x, y) = (0.0, y + LEGEND_LINE);
            }
            let place = [x, y];
            x += item_width + 18.0;
            place
        })
        .collect()
}

pub(super) fn legend_height(items: &[(Key, String)], width: f64) -> f64 {
    legend_places(items, width).last().map_or(0.0, |[_, y]| y + LEGEND_LINE + 4.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_titles_are_wrapped_and_keep_their_words() {
        let title = "a rather long title ".repeat(10);
        let lines = wrapped(&title, TITLE_SIZE, 300.0);
        assert!(lines.len() > 3);
        assert!(lines.iter().all(|line| text_width(line, TITLE_SIZE) <= 300.0));
        assert_eq!(lines.join(" "), title.trim());
    }

    #[test]
    fn a_text_that_is_too_long_is_cut() {
        assert_eq!(shortened("short", TEXT_SIZE, 100.0), "short");
        let cut = shortened(&"long ".repeat(100), TEXT_SIZE, 100.0);
        assert!(cut.ends_with('…') && text_width(&cut, TEXT_SIZE) <= 100.0, "{cut}");
        assert_eq!(shortened("long", TEXT_SIZE, 0.0), "…");
    }

    #[test]
    fn a_legend_that_is_too_wide_goes_on_in_the_next_line() {
        let items: Vec<_> =
            (0..9).map(|n| (Key::Ellipse(INK), format!("a label of some length {n}"))).collect();
        assert!(legend_height(&items, 400.0) > 3.0 * LEGEND_LINE);
        assert_eq!(legend_height(&[], 400.0), 0.0);
    }

    #[test]
    fn lines_past_the_last_colour_differ_by_their_dashes() {
        let looks: std::collections::HashSet<_> = (0..24).map(|n| (colour(n), dashes(n))).collect();
        assert_eq!(looks.len(), 24);
    }

    #[test]
    fn letters_that_xml_forbids_are_left_out() {
        let mut svg = Svg::new(10.0, 10.0);
        svg.text("a\u{0}<b>\u{1b}&", [0.0, 0.0], TextStyle::default());
        assert!(svg.finish().contains(">a &lt;b&gt; &amp;</text>"));
    }
}
