//! Lines that may lie on each other, over shaded blocks: what was used, over what was occupied when.

use super::axis::Frame;
use super::lines::LineFigure;
use super::svg::{Area, Key, Marker, Svg};

/// Something that takes up an interval of either axis, such as a transmission its time and its band.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Block {
    /// From where to where on the horizontal axis, the lower one first.
    pub x: [f64; 2],
    /// From where to where on the vertical axis, the lower one first.
    pub y: [f64; 2],
    /// Its name in the legend; blocks of the same name share one entry. Empty: no entry.
    pub label: String,
    /// Whether it is paler: there is less of what it stands for.
    pub faint: bool,
}

/// Lines that may lie on each other, over shaded blocks. Earlier lines are wider, so that later ones leave them
/// visible; the vertical axis holds lines and blocks.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BlockFigure {
    /// The lines.
    pub lines: LineFigure,
    /// The blocks, behind the lines; faint ones below all others.
    pub blocks: Vec<Block>,
}

impl BlockFigure {
    pub(super) fn height(&self, width: f64) -> f64 {
        self.lines.height_over(width, &self.blocks)
    }

    pub(super) fn draw(&self, svg: &mut Svg, area: Area) {
        self.lines.draw_over(svg, area, &self.blocks, NESTING);
    }
}

const SHADE: &str = "#f2d08a";
const FAINT_SHADE: &str = "#f9e9c6";
/// By how much lines of one name are wider than those of the next.
const NESTING: f64 = 1.7;

fn shade(block: &Block) -> &'static str {
    if block.faint { FAINT_SHADE } else { SHADE }
}

/// One entry per name.
pub(super) fn block_legend(blocks: &[Block]) -> Vec<(Key, String)> {
    let mut entries: Vec<(Key, String)> = Vec::new();
    for block in blocks.iter().filter(|block| !block.label.is_empty()) {
        if !entries.iter().any(|(_, label)| *label == block.label) {
            entries.push((Key::Marker(Marker::Square, shade(block), true), block.label.clone()));
        }
    }
    entries
}

pub(super) fn draw_blocks(svg: &mut Svg, blocks: &[Block], frame: &Frame) {
    svg.begin_clip(frame.area);
    let finite = |block: &&Block| block.x.iter().chain(&block.y).all(|end| end.is_finite());
    let of = |faint: bool| blocks.iter().filter(move |block| block.faint == faint).filter(finite);
    for block in of(true).chain(of(false)) {
        let [left, bottom] = frame.place([block.x[0], block.y[0]]);
        let [right, top] = frame.place([block.x[1], block.y[1]]);
        if right > left && bottom > top {
            svg.rect(Area { left, top, width: right - left, height: bottom - top }, shade(block), None);
        }
    }
    svg.end_clip();
}

#[cfg(test)]
mod tests {
    use super::super::{Picture, Series};
    use super::*;

    fn figure(blocks: Vec<Block>) -> BlockFigure {
        let line = Series {
            label: "carrier".into(),
            points: (0..=100).map(|n| [f64::from(n), 7.0]).collect(),
            faint: false,
        };
        BlockFigure { lines: LineFigure { series: vec![line], ..LineFigure::default() }, blocks }
    }

    /// Left edge, top edge, width and height of every rectangle of a colour.
    fn rectangles(svg: &str, fill: &str) -> Vec<[f64; 4]> {
        let number = |line: &str, name: &str| -> f64 {
            let rest = line.split_once(&format!(" {name}=\"")).expect("has it").1;
            rest.split('"').next().and_then(|number| number.parse().ok()).expect("is a number")
        };
        svg.lines()
            .filter(|line| line.starts_with("<rect") && line.contains(&format!("fill=\"{fill}\"")))
            .map(|line| ["x", "y", "width", "height"].map(|name| number(line, name)))
            .collect()
    }

    #[test]
    fn blocks_lie_where_their_axes_say_and_share_one_entry_of_the_legend() {
        let block = |x, y| Block { x, y, label: "interferer".into(), faint: false };
        let blocks = vec![block([20.0, 40.0], [6.0, 8.0]), block([60.0, 70.0], [6.0, 7.0])];
        let svg = Picture::of(figure(blocks)).svg();
        let [first, second, key] = rectangles(&svg, SHADE)[..] else { panic!("two blocks and a key: {svg}") };
        let (first, second) = if first[2] > 11.0 { (first, second) } else { (second, key) };
        // Twice as long and twice as high; the lower edges on one line.
        assert!((first[2] / second[2] - 2.0).abs() < 1e-2 && (first[3] / second[3] - 2.0).abs() < 1e-2);
        assert!((first[1] + first[3] - second[1] - second[3]).abs() < 0.02);
        assert_eq!(svg.matches(">interferer<").count(), 1);
    }

    #[test]
    fn lines_on_each_other_all_remain_visible() {
        let line =
            |label: &str| Series { label: label.into(), points: vec![[0.0, 7.0], [1.0, 7.0]], faint: false };
        let series = vec![line(""), line("a"), line("b")];
        let lines = LineFigure { series, ..LineFigure::default() };
        let svg = Picture::of(BlockFigure { lines, blocks: Vec::new() }).svg();
        let widths = |element: &str| -> Vec<f64> {
            let lines = svg.lines().filter(|line| line.starts_with(element) && !line.contains("#e6e6e6"));
            let width = |line: &str| line.split("stroke-width=\"").nth(1)?.split('"').next()?.parse().ok();
            lines.filter_map(width).collect()
        };
        let drawn = widths("<polyline");
        assert!(drawn.len() == 3 && drawn.windows(2).all(|pair| pair[0] > pair[1] + 1.0), "{drawn:?}");
        // The legend shows the same.
        assert_eq!(widths("<line"), drawn[1..]);
    }

    #[test]
    fn blocks_that_are_none_are_not_drawn() {
        let block = |x| Block { x, y: [6.0, 8.0], ..Block::default() };
        let svg = Picture::of(figure(vec![block([30.0, 30.0]), block([f64::NAN, 40.0])])).svg();
        assert!(rectangles(&svg, SHADE).is_empty() && !svg.contains("NaN"));
    }
}
