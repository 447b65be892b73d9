//! Names that keep out of each other's way.

use super::svg::{Align, Area, Svg, TEXT_SIZE, TextStyle, text_width};

/// Names that keep out of each other's way.
pub(super) struct Labels {
    within: Area,
    taken: Vec<Area>,
}

impl Labels {
    pub(super) fn within(area: Area) -> Self {
        Self { within: area, taken: Vec::new() }
    }

    pub(super) fn take_marker(&mut self, [x, y]: [f64; 2], radius: f64) {
        let side = 2.0 * radius + 2.0;
        self.taken.push(Area { left: x - 0.5 * side, top: y - 0.5 * side, width: side, height: side });
    }

    /// Puts a name beside a marker where there is room; where there is none, it is left out.
    pub(super) fn put(&mut self, svg: &mut Svg, [x, y]: [f64; 2], name: &str, ink: &'static str) {
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
