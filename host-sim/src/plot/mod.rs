//! Figures for people, as SVG and PNG: tracks and rooms as floor plans, lines over time or probability, channel
//! responses, and maps of values.
//!
//! The SVG is written here, so that a figure is the same on every machine; the PNG is rendered from it with a font
//! that the command carries, so that no font need be installed. Panels can be put side by side and stacked in a
//! [`Picture`].

mod axis;
mod blocks;
mod channel;
mod floor;
mod heat_map;
mod labels;
mod lines;
mod room;
mod svg;
mod track;

use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use resvg::tiny_skia::{Color, Pixmap, Transform};
use resvg::usvg;

use crate::whole_file;

pub use blocks::{Block, BlockFigure};
pub use channel::{ChannelFigure, ChannelPath};
pub use heat_map::{HeatMap, HeatRows};
pub use lines::{LineFigure, Series, Span};
pub use room::{RoomFigure, RoomWall, VirtualAnchor};
use svg::{Area, Svg};
pub use track::{MappedAnchor, MappedWall, TrackFigure, WallKind};

/// Width of every picture, in SVG units (CSS pixels).
const PICTURE_WIDTH: f64 = 920.0;
const GAP: f64 = 18.0;
const MARGIN: f64 = 10.0;
/// PNG pixels per SVG unit: legible on dense screens and in print.
const PNG_SCALE: f32 = 2.0;

/// One panel of a picture.
#[derive(Clone, Debug, PartialEq)]
pub enum Panel {
    /// A track over the floor plan.
    Track(TrackFigure),
    /// Lines over a common axis.
    Lines(LineFigure),
    /// Lines over shaded blocks.
    Blocks(BlockFigure),
    /// A map of values as colours.
    HeatMap(HeatMap),
    /// A channel response and the paths in it.
    Channel(ChannelFigure),
    /// A room with its anchors and virtual anchors.
    Room(RoomFigure),
}

impl From<TrackFigure> for Panel {
    fn from(figure: TrackFigure) -> Self {
        Self::Track(figure)
    }
}

impl From<LineFigure> for Panel {
    fn from(figure: LineFigure) -> Self {
        Self::Lines(figure)
    }
}

impl From<BlockFigure> for Panel {
    fn from(figure: BlockFigure) -> Self {
        Self::Blocks(figure)
    }
}

impl From<HeatMap> for Panel {
    fn from(figure: HeatMap) -> Self {
        Self::HeatMap(figure)
    }
}

impl From<ChannelFigure> for Panel {
    fn from(figure: ChannelFigure) -> Self {
        Self::Channel(figure)
    }
}

impl From<RoomFigure> for Panel {
    fn from(figure: RoomFigure) -> Self {
        Self::Room(figure)
    }
}

impl Panel {
    /// The height that the panel needs at a given width.
    fn height(&self, width: f64) -> f64 {
        match self {
            Self::Track(figure) => figure.height(width),
            Self::Lines(figure) => figure.height(width),
            Self::Blocks(figure) => figure.height(width),
            Self::HeatMap(figure) => figure.height(width),
            Self::Channel(figure) => figure.height(width),
            Self::Room(figure) => figure.height(width),
        }
    }

    fn draw(&self, svg: &mut Svg, area: Area) {
        match self {
            Self::Track(figure) => figure.draw(svg, area),
            Self::Lines(figure) => figure.draw(svg, area),
            Self::Blocks(figure) => figure.draw(svg, area),
            Self::HeatMap(figure) => figure.draw(svg, area),
            Self::Channel(figure) => figure.draw(svg, area),
            Self::Room(figure) => figure.draw(svg, area),
        }
    }
}

/// Panels in rows: those of one row side by side, the rows stacked.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Picture {
    /// The rows, from top to bottom; the panels of each from left to right.
    pub rows: Vec<Vec<Panel>>,
}

impl Picture {
    /// A picture of one panel.
    pub fn of(panel: impl Into<Panel>) -> Self {
        Self { rows: vec![vec![panel.into()]] }
    }

    /// Adds a row of one panel below the others.
    pub fn below(mut self, panel: impl Into<Panel>) -> Self {
        self.rows.push(vec![panel.into()]);
        self
    }

    /// Adds a panel to the right end of the last row.
    pub fn beside(mut self, panel: impl Into<Panel>) -> Self {
        match self.rows.last_mut() {
            Some(row) => row.push(panel.into()),
            None => self.rows.push(vec![panel.into()]),
        }
        self
    }

    /// The picture as SVG text, fit to be embedded in HTML: it uses no identifiers that could clash.
    pub fn svg(&self) -> String {
        let mut layout = Vec::new();
        let mut top = MARGIN;
        for row in self.rows.iter().filter(|row| !row.is_empty()) {
            let count = row.len() as f64;
            let width = (PICTURE_WIDTH - 2.0 * MARGIN - GAP * (count - 1.0)) / count;
            let height = row.iter().map(|panel| panel.height(width)).fold(0.0, f64::max);
            for (column, panel) in row.iter().enumerate() {
                let left = MARGIN + column as f64 * (width + GAP);
                layout.push((panel, Area { left, top, width, height }));
            }
            top += height + GAP;
        }
        let height = (top - GAP + MARGIN).max(2.0 * MARGIN);
        let mut svg = Svg::new(PICTURE_WIDTH, height);
        for (panel, area) in layout {
            panel.draw(&mut svg, area);
        }
        svg.finish()
    }

    /// Writes `PATH.svg` and `PATH.png` and gives their paths. Both are rendered before either is written, and neither
    /// takes the place of an older figure before both are complete ([`crate::whole_file`]).
    ///
    /// # Errors
    ///
    /// The picture is too large to be drawn, or the disk refuses.
    pub fn write(&self, path_without_extension: impl AsRef<Path>) -> io::Result<[PathBuf; 2]> {
        let svg = self.svg();
        let base = path_without_extension.as_ref();
        let png = png_of(&svg)
            .map_err(|error| io::Error::new(error.kind(), format!("{}: {error}", base.display())))?;
        // Appended, not replaced: a name may have dots of its own.
        let with = |extension: &str| {
            let mut name = base.as_os_str().to_owned();
            name.push(extension);
            PathBuf::from(name)
        };
        let paths = [with(".svg"), with(".png")];
        whole_file::write_all(&[(&paths[0], svg.as_bytes()), (&paths[1], &png)])?;
        Ok(paths)
    }
}

/// Renders an SVG picture of this module.
fn png_of(svg: &str) -> io::Result<Vec<u8>> {
    static FONTS: OnceLock<Arc<usvg::fontdb::Database>> = OnceLock::new();
    let fonts = FONTS.get_or_init(|| {
        let mut fonts = usvg::fontdb::Database::new();
        fonts.load_font_data(dejavu::sans::regular().to_vec());
        fonts.load_font_data(dejavu::sans::bold().to_vec());
        Arc::new(fonts)
    });
    let options = usvg::Options {
        font_family: svg::FONT.into(),
        fontdb: Arc::clone(fonts),
        ..usvg::Options::default()
    };
    let tree = usvg::Tree::from_str(svg, &options).map_err(io::Error::other)?;
    let size = tree.size();
    let pixels = |length: f32| (length * PNG_SCALE).ceil() as u32;
    let mut pixmap = Pixmap::new(pixels(size.width()), pixels(size.height()))
        .ok_or_else(|| io::Error::other("the picture is too large to be drawn"))?;
    pixmap.fill(Color::WHITE);
    resvg::render(&tree, Transform::from_scale(PNG_SCALE, PNG_SCALE), &mut pixmap.as_mut());
    pixmap.encode_png().map_err(io::Error::other)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::tests::Folder;
    use std::fs;

    #[test]
    fn a_picture_is_written_as_svg_and_png() {
        let folder = Folder::new();
        let line = LineFigure {
            title: "Error <over> time & more".into(),
            x_label: "time in s".into(),
            y_label: "error in m".into(),
            series: vec![Series {
                label: "l = 1".into(),
                points: (0..100).map(|n| [f64::from(n), f64::from(n % 7)]).collect(),
                faint: false,
            }],
            ..LineFigure::default()
        };
        let picture = Picture::of(TrackFigure::default()).beside(line.clone()).below(line);
        let [svg, png] = picture.write(folder.0.join("figures/v0.1 error")).expect("is written");
        assert!(svg.ends_with("v0.1 error.svg"));
        let text = fs::read_to_string(svg).expect("is there");
        assert!(text.contains("Error &lt;over&gt; time &amp; more"));
        assert!(fs::read(png).expect("is there").starts_with(b"\x89PNG"));
    }

    #[test]
    fn text_is_rendered_without_any_installed_font() {
        let picture = |title: &str| Picture::of(LineFigure { title: title.into(), ..LineFigure::default() });
        let with_text = png_of(&picture("Title").svg()).expect("is drawn");
        let without = png_of(&picture("").svg()).expect("is drawn");
        assert_ne!(with_text, without);
    }

    #[test]
    fn an_empty_picture_is_still_a_picture() {
        png_of(&Picture::default().svg()).expect("is drawn");
        png_of(&Picture::of(LineFigure::default()).svg()).expect("is drawn");
    }
}
