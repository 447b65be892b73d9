//! Names that keep out of each other's way.

use super::svg::{Align, Area, Svg, TEXT_SIZE, TextStyle, text_width};

/// The size of names beside markers.
pub(super) const SIZE: f64 = TEXT_SIZE - 1.0;

/// Names that keep out of each other's way.
pub(super) struct Labels {
    within: Area,
    taken: Vec<Area>,
    lines: Vec<[[f64; 2]; 2]>,
}

impl Labels {
    pub(super) fn within(area: Area) -> Self {
        Self { within: area, taken: Vec::new(), lines: Vec::new() }
    }

    pub(super) fn take_marker(&mut self, [x, y]: [f64; 2], radius: f64) {
        let side = 2.0 * radius + 2.0;
        self.taken.push(Area { left: x - 0.5 * side, top: y - 0.5 * side, width: side, height: side });
    }

    /// Keeps names off a line as far as there is other room.
    pub(super) fn avoid(&mut self, line: [[f64; 2]; 2]) {
        self.lines.push(line);
    }

    /// Puts a name beside a marker where there is room; where there is none, it is left out.
    pub(super) fn put(&mut self, svg: &mut Svg, [x, y]: [f64; 2], name: &str, ink: &'static str) {
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
        let places = places.map(|(left, top)| Area { left, top, width, height });
        let mut free = places.into_iter().filter(|place| self.is_free(place));
        let first = free.clone().next();
        let clear = free.find(|place| !self.lines.iter().any(|line| crosses(line, place)));
        let Some(place) = clear.or(first).filter(|_| !name.is_empty()) else { return };
        self.taken.push(place);
        let style =
            TextStyle { align: Align::Start, size: SIZE, colour: ink, halo: true, ..TextStyle::default() };
        svg.text(name, [place.left, place.top + SIZE - 1.0], style);
    }

    fn is_free(&self, place: &Area) -> bool {
        self.within.contains([place.left, place.top])
            && self.within.contains([place.right(), place.bottom()])
            && !self.taken.iter().any(|other| other.overlaps(place))
    }
}

/// Whether a line runs through an area.
fn crosses([from, to]: &[[f64; 2]; 2], area: &Area) -> bool {
    // The part of the line, between 0 and 1, that is inside along both axes. A line that is not finite has
    // none.
    let (mut first, mut last) = (0.0_f64, 1.0_f64);
    for (axis, low, high) in [(0, area.left, area.right()), (1, area.top, area.bottom())] {
        let step = to[axis] - from[axis];
        if step == 0.0 {
            if !(low..=high).contains(&from[axis]) {
                return false;
            }
            continue;
        }
        let [a, b] = [(low - from[axis]) / step, (high - from[axis]) / step];
        if a.is_nan() || b.is_nan() {
            return false;
        }
        first = first.max(a.min(b));
        last = last.min(a.max(b));
    }
    first <= last
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_keeps_off_a_line_if_it_can() {
        let beside = |line: Option<[[f64; 2]; 2]>| {
            let mut labels = Labels::within(Area { left: 0.0, top: 0.0, width: 200.0, height: 100.0 });
            line.into_iter().for_each(|line| labels.avoid(line));
            labels.put(&mut Svg::new(200.0, 100.0), [100.0, 50.0], "name", "#222222");
            labels.taken[0].left
        };
        assert!(beside(None) > 100.0);
        assert!(beside(Some([[120.0, 0.0], [120.0, 90.0]])) < 100.0);
        assert!(beside(Some([[150.0, 0.0], [170.0, 90.0]])) > 100.0);
        assert!(beside(Some([[f64::NAN, 0.0], [120.0, f64::INFINITY]])) > 100.0);
    }
}
