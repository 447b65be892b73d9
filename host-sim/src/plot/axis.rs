//! Axes: round tick values, their labels, and the mapping of values to the picture.

use super::svg::{
    Align, Area, GRID, INK, SOFT_INK, Stroke, Svg, TEXT_SIZE, TextStyle, shortened, text_width,
};

/// One axis: an interval of values, linear or logarithmic.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Axis {
    pub(super) low: f64,
    pub(super) high: f64,
    pub(super) log: bool,
}

/// A tick: its value and its label, which is empty for a minor one.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Tick {
    pub(super) value: f64,
    pub(super) label: String,
}

impl Axis {
    /// An axis that holds all finite values. A logarithmic one holds those above zero, but for the lowest hundredth:
    /// an error that is nothing for once would otherwise take up most of the decades.
    pub(super) fn around(values: impl Iterator<Item = f64>, log: bool) -> Self {
        let usable = |value: &f64| value.is_finite() && value.abs() < 1e150 && (!log || *value > 1e-150);
        let mut values: Vec<f64> = values.filter(usable).collect();
        let (mut low, high) =
            values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), &value| {
                (low.min(value), high.max(value))
            });
        if log && values.len() >= 100 {
            let hundredth = values.len() / 100;
            let (_, &mut low_but_few, _) = values.select_nth_unstable_by(hundredth, f64::total_cmp);
            low = low.max(0.5 * low_but_few);
        }
        if low > high {
            return if log { Self { low: 0.1, high: 1.0, log } } else { Self { low: 0.0, high: 1.0, log } };
        }
        if log {
            // A little room, and at least half a decade.
            let middle = (low * high).sqrt();
            return Self { low: (low / 1.15).min(middle / 1.8), high: (high * 1.15).max(middle * 1.8), log };
        }
        let extent = high - low;
        if extent <= 1e-12 * high.abs().max(low.abs()) || extent == 0.0 {
            let room = if high == 0.0 { 1.0 } else { 0.1 * high.abs() };
            return Self { low: low - room, high: high + room, log };
        }
        Self { low, high, log }
    }

    /// Room beyond the values; zero is shown when it is near.
    pub(super) fn with_room(mut self) -> Self {
        if self.log {
            return self;
        }
        let (low, high) = (self.low, self.high);
        let room = 0.05 * (high - low);
        self.low = if low >= 0.0 && low < 0.4 * high { 0.0 } else { low - room };
        self.high = if high <= 0.0 && high > 0.4 * low { 0.0 } else { high + room };
        self
    }

    /// Where a value lies between the low end (0) and the high end (1).
    pub(super) fn fraction(&self, value: f64) -> f64 {
        if self.log {
            (value / self.low).ln() / (self.high / self.low).ln()
        } else {
            (value - self.low) / (self.high - self.low)
        }
    }

    /// Round values inside the axis, about `count` of them labelled.
    pub(super) fn ticks(&self, count: usize) -> Vec<Tick> {
        if self.log { self.log_ticks(count) } else { self.linear_ticks(count) }
    }

    /// Ticks for a horizontal axis of a width.
    pub(super) fn level_ticks(&self, width: f64) -> Vec<Tick> {
        self.ticks((width / 75.0).max(2.0) as usize)
    }

    /// Ticks for a vertical axis of a height.
    pub(super) fn upright_ticks(&self, height: f64) -> Vec<Tick> {
        self.ticks((height / 45.0).max(2.0) as usize)
    }

    fn linear_ticks(&self, count: usize) -> Vec<Tick> {
        let rough = (self.high - self.low) / count.max(1) as f64;
        let power = 10f64.powf(rough.log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0].into_iter().map(|m| m * power).find(|&step| step >= 0.75 * rough);
        let step = step.unwrap_or(10.0 * power);
        let first = (self.low / step - 1e-9).ceil();
        let last = (self.high / step + 1e-9).floor();
        let size = self.low.abs().max(self.high.abs());
        // More ticks than asked for can only come from rounding at the edge of precision.
        (0..=((last - first).max(0.0) as usize).min(4 * count))
            .map(|n| (first + n as f64) * step)
            .map(|value| Tick { value, label: linear_label(value, step, size) })
            .collect()
    }

    fn log_ticks(&self, count: usize) -> Vec<Tick> {
        let (first, last) = (self.low.log10().floor() as i32, self.high.log10().ceil() as i32);
        let decades = (self.high / self.low).log10();
        // Few decades have room for labels in between.
        let labelled: &[u32] = if decades < 1.5 {
            &[1, 2, 3, 5, 7]
        } else if decades < 3.0 {
            &[1, 2, 5]
        } else {
            &[1]
        };
        let every = ((decades / count.max(1) as f64).ceil() as i32).max(1);
        let mut ticks = Vec::new();
        for exponent in first..=last {
            for digit in 1..10 {
                let value = f64::from(digit) * 10f64.powi(exponent);
                if value < 0.999 * self.low || value > 1.001 * self.high {
                    continue;
                }
                let label = if !labelled.contains(&digit) || exponent.rem_euclid(every) != 0 {
                    String::new()
                } else if (-3..4).contains(&exponent) {
                    let decimals = (-exponent).max(0) as usize;
                    format!("{value:.decimals$}")
                } else if digit == 1 {
                    format!("10{}", superscript(exponent))
                } else {
                    format!("{digit}·10{}", superscript(exponent))
                };
                ticks.push(Tick { value, label });
            }
        }
        ticks
    }
}

fn linear_label(value: f64, step: f64, size: f64) -> String {
    let minus = |text: String| text.replace('-', "\u{2212}");
    if value.abs() < 1e-9 * step {
        return "0".into();
    }
    if !(1e-3..1e6).contains(&size) {
        let exponent = size.log10().floor() as i32;
        let decimals = (f64::from(exponent) - step.log10()).ceil().clamp(0.0, 12.0) as usize;
        return minus(format!("{:.decimals$}", value / 10f64.powi(exponent)))
            + "·10"
            + &superscript(exponent);
    }
    let decimals = (-(step * 1.0001).log10().floor()).clamp(0.0, 12.0) as usize;
    minus(format!("{value:.decimals$}"))
}

fn superscript(exponent: i32) -> String {
    exponent
        .to_string()
        .chars()
        .map(|letter| match letter {
            '-' => '⁻',
            '1' => '¹',
            '2' => '²',
            '3' => '³',
            digit => char::from_u32('⁰' as u32 + digit as u32 - '0' as u32).unwrap_or(digit),
        })
        .collect()
}

/// Two axes over a part of the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Frame {
    pub(super) area: Area,
    pub(super) x: Axis,
    pub(super) y: Axis,
}

/// Room below a frame for ticks and the label.
pub(super) const BELOW: f64 = 42.0;
/// Room above a frame for the ticks and the label of an axis on top.
pub(super) const ABOVE: f64 = 40.0;
/// The usual room left of a frame; common to all figures, so that the frames of stacked panels align.
pub(super) const LEFT_ROOM: f64 = 70.0;

impl Frame {
    /// Where a point of values lies in the picture.
    pub(super) fn place(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        [
            self.area.left + self.x.fraction(x) * self.area.width,
            self.area.bottom() - self.y.fraction(y) * self.area.height,
        ]
    }

    /// The room that tick labels and the axis label take to the left of a frame.
    pub(super) fn left_room(y_ticks: &[Tick]) -> f64 {
        (label_width(y_ticks) + TEXT_SIZE + 18.0).max(LEFT_ROOM)
    }

    /// Grid, border, ticks and labels.
    pub(super) fn draw(&self, svg: &mut Svg, x_label: &str, y_label: &str) {
        self.draw_with(svg, x_label, y_label, &self.y.upright_ticks(self.area.height));
    }

    /// Grid, border, ticks and labels, with ticks of one's own on the vertical axis.
    pub(super) fn draw_with(&self, svg: &mut Svg, x_label: &str, y_label: &str, y_ticks: &[Tick]) {
        let area = self.area;
        let soft = |label: &str| Stroke {
            opacity: if label.is_empty() { 0.5 } else { 1.0 },
            ..Stroke::new(GRID, 1.0)
        };
        let label_style = TextStyle { colour: SOFT_INK, ..TextStyle::default() };
        for tick in self.x.level_ticks(area.width) {
            let x = self.place([tick.value, self.y.low])[0];
            svg.line([x, area.top], [x, area.bottom()], soft(&tick.label));
            let style = TextStyle { align: Align::Middle, ..label_style };
            svg.text(&tick.label, [x, area.bottom() + TEXT_SIZE + 4.0], style);
        }
        for tick in y_ticks {
            let y = self.place([self.x.low, tick.value])[1];
            svg.line([area.left, y], [area.right(), y], soft(&tick.label));
            let style = TextStyle { align: Align::End, ..label_style };
            svg.text(&tick.label, [area.left - 6.0, y + 0.36 * TEXT_SIZE], style);
        }
        svg.rect(area, "none", Some(Stroke::new("#999999", 1.0)));
        let middle = TextStyle { align: Align::Middle, colour: INK, ..TextStyle::default() };
        let x_label = shortened(x_label, TEXT_SIZE, area.width + LEFT_ROOM);
        svg.text(&x_label, [area.left + 0.5 * area.width, area.bottom() + BELOW - 6.0], middle);
        let left = area.left - Self::left_room(y_ticks) + TEXT_SIZE;
        let y_label = shortened(y_label, TEXT_SIZE, area.height + BELOW);
        svg.text(&y_label, [left, area.top + 0.5 * area.height], TextStyle { upright: true, ..middle });
    }

    /// A second horizontal axis on top, on which values are larger by a factor.
    pub(super) fn draw_top_axis(&self, svg: &mut Svg, factor: f64, label: &str) {
        let area = self.area;
        let axis = Axis { low: factor * self.x.low, high: factor * self.x.high, log: false };
        for tick in axis.level_ticks(area.width) {
            let x = area.left + axis.fraction(tick.value) * area.width;
            svg.line([x, area.top - 4.0], [x, area.top], Stroke::new("#999999", 1.0));
            let style = TextStyle { align: Align::Middle, colour: SOFT_INK, ..TextStyle::default() };
            svg.text(&tick.label, [x, area.top - 8.0], style);
        }
        let style = TextStyle { align: Align::Middle, ..TextStyle::default() };
        svg.text(label, [area.left + 0.5 * area.width, area.top - TEXT_SIZE - 13.0], style);
    }

    /// The border, and marks outside of it where the ticks are: for frames whose inside hides the grid.
    pub(super) fn draw_marks(&self, svg: &mut Svg, y_ticks: &[Tick]) {
        let (area, edge) = (self.area, Stroke::new("#999999", 1.0));
        for tick in self.x.level_ticks(area.width) {
            let x = self.place([tick.value, self.y.low])[0];
            svg.line([x, area.bottom()], [x, area.bottom() + 4.0], edge);
        }
        for tick in y_ticks {
            let y = self.place([self.x.low, tick.value])[1];
            svg.line([area.left - 4.0, y], [area.left, y], edge);
        }
        svg.rect(area, "none", Some(edge));
    }
}

/// The width of the widest label.
pub(super) fn label_width(ticks: &[Tick]) -> f64 {
    ticks.iter().map(|tick| text_width(&tick.label, TEXT_SIZE)).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(axis: Axis, count: usize) -> Vec<String> {
        axis.ticks(count).into_iter().map(|tick| tick.label).filter(|label| !label.is_empty()).collect()
    }

    #[test]
    fn linear_ticks_are_round() {
        let axis = Axis { low: -0.35, high: 1.02, log: false };
        assert_eq!(labels(axis, 3), ["0", "0.5", "1.0"]);
        assert_eq!(labels(Axis { low: -3.0, high: 3.0, log: false }, 3), ["\u{2212}2", "0", "2"]);
        assert_eq!(labels(Axis { low: 6.0, high: 8.0, log: false }, 4), ["6.0", "6.5", "7.0", "7.5", "8.0"]);
    }

    #[test]
    fn logarithmic_ticks_are_decades_when_there_are_many() {
        assert_eq!(
            labels(Axis { low: 1e-5, high: 1.0, log: true }, 6),
            ["10⁻⁵", "10⁻⁴", "0.001", "0.01", "0.1", "1"]
        );
        assert_eq!(labels(Axis { low: 0.09, high: 0.6, log: true }, 6), ["0.1", "0.2", "0.3", "0.5"]);
    }

    #[test]
    fn no_values_one_value_and_huge_values_make_an_axis() {
        for values in
            [vec![], vec![3.0], vec![0.0], vec![f64::NAN, f64::INFINITY], vec![1e200, 5.0], vec![-7.0, -7.0]]
        {
            for log in [false, true] {
                let axis = Axis::around(values.iter().copied(), log).with_room();
                assert!(axis.low < axis.high, "{values:?}");
                assert!(axis.ticks(5).len() < 60);
            }
        }
    }

    #[test]
    fn a_few_values_near_zero_do_not_take_up_a_logarithmic_axis() {
        let mut values = vec![0.5; 1000];
        values[3] = 1e-9;
        values[4] = 20.0;
        let axis = Axis::around(values.into_iter(), true);
        assert!(axis.low > 0.1 && axis.high > 20.0, "{axis:?}");
    }

    #[test]
    fn zero_is_shown_when_it_is_near() {
        assert_eq!(Axis::around([0.1, 2.0].into_iter(), false).with_room().low, 0.0);
        assert!(Axis::around([6.0, 8.0].into_iter(), false).with_room().low > 5.0);
    }
}
