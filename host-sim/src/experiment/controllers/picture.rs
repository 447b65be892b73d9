//! What controllers do over time, as pictures: carriers beside the interferer, entropies of all runs, and what the
//! core's controller thought of every action.

use super::watched::{Occupied, Watched};
use super::{Comparison, Controller, Run};
use crate::plot::{Block, BlockFigure, HeatMap, HeatRows, LineFigure, Picture, Series, Span};

/// Controllers whose carriers are drawn. In all pictures they come in one order, so that a colour is always the same
/// controller's.
const CARRIERS: [Controller; 3] = [Controller::Fixed, Controller::Cognitive, Controller::Genie];
/// Controllers whose entropies are drawn.
const ENTROPIES: [Controller; 4] =
    [Controller::Fixed, Controller::Cognitive, Controller::Genie, Controller::Greedy];
/// Single runs drawn behind their mean, at most: more become an even tint.
const SINGLE_RUNS: usize = 20;
/// Shares of all values that lie below and above their colours and have the colours of the ends: a few that are far off
/// would take the colours from all others.
const BEYOND: [f64; 2] = [0.05, 0.001];
/// A choice held for less than this share of the cycles is drawn as a dot: as a line it would be too short to be seen.
const MOMENT: f64 = 0.004;

/// Pictures of a comparison.
#[derive(Clone, Debug, PartialEq)]
pub struct Pictures {
    /// The pictures with their names.
    pub named: Vec<(&'static str, Picture)>,
    /// What could not be drawn and why, in sentences.
    pub left_out: Vec<String>,
}

impl Pictures {
    /// Of these runs in a scenario, the first of which was watched.
    pub fn new(scenario: &str, comparisons: &[Comparison]) -> Self {
        let mut pictures = Self { named: Vec::new(), left_out: Vec::new() };
        let Some((first, watched)) =
            comparisons.first().and_then(|first| Some((first, first.watched.as_ref()?)))
        else {
            pictures.left_out.push("Nothing is drawn: no run was watched.".into());
            return pictures;
        };
        pictures.named.push(("carrier", Picture::of(carriers(scenario, first, watched))));
        pictures.named.push(("entropy", entropies(scenario, comparisons)));
        match first.of(Controller::Cognitive) {
            Some(run) => {
                pictures.named.push(("value", Picture::of(values(scenario, first, run, watched))));
                pictures.named.push(("policy", Picture::of(policies(scenario, first, run, watched))));
            }
            None => pictures.left_out.push(
                "Without the controller `cognitive` there are no values and no policy: value and policy are left out."
                    .into(),
            ),
        }
        let missing = |among: &[Controller]| -> Vec<&str> {
            among.iter().filter(|one| first.of(**one).is_none()).map(|one| one.name()).collect()
        };
        for (picture, among) in [("carrier", &CARRIERS[..]), ("entropy", &ENTROPIES[..])] {
            let missing = missing(among);
            if !missing.is_empty() {
                let names = missing.join(" and ");
                pictures.left_out.push(format!("Not among the controllers, so not in {picture}: {names}."));
            }
        }
        pictures
    }
}

/// Carriers over the cycles, over the bands and times of the interferers.
fn carriers(scenario: &str, first: &Comparison, watched: &Watched) -> BlockFigure {
    let ghz = |action: usize| watched.carriers_hz.get(action).map_or(f64::NAN, |hz| 1e-9 * hz);
    let mut series = Vec::new();
    for controller in CARRIERS {
        let Some(run) = first.of(controller) else { continue };
        let carriers: Vec<f64> = run.actions.iter().map(|actions| ghz(actions[0])).collect();
        let line = |points, faint| Series { label: controller.name().into(), points, faint };
        let points = held(&carriers);
        // A pale line from level to level leads the eye to those held for a moment.
        series.push(line(points.iter().copied().filter(|point| point[0].is_finite()).collect(), true));
        series.push(line(points, false));
    }
    let block = |one: &Occupied, hz: [f64; 2], label: &str, faint| Block {
        x: [one.cycles.start, one.cycles.end].map(edge),
        y: hz.map(|hz| 1e-9 * hz),
        label: label.into(),
        faint,
    };
    let bands = watched.occupied.iter();
    let bands = bands.map(|one| block(one, one.half_power_hz, "interferer's band (half power)", false));
    let skirts = watched.occupied.iter().map(|one| block(one, one.all_hz, "its skirts", true));
    BlockFigure {
        lines: LineFigure {
            title: format!("{scenario}: carrier, run of seed {}", first.seed),
            x_label: "cycle".into(),
            y_label: "carrier in GHz".into(),
            series,
            ..LineFigure::default()
        },
        blocks: bands.chain(skirts).collect(),
    }
}

/// Entropies over the cycles, the mean of all runs over single ones, above how much of that the genie does not leave.
fn entropies(scenario: &str, comparisons: &[Comparison]) -> Picture {
    let runs = match comparisons.len() {
        1 => "one run".into(),
        count if count <= SINGLE_RUNS => format!("mean of {count} runs, thin: single runs"),
        count => format!("mean of {count} runs, thin: the first {SINGLE_RUNS}"),
    };
    let figure = |title: String, y_label: &str, series: Vec<Series>| LineFigure {
        title,
        x_label: "cycle".into(),
        y_label: y_label.into(),
        series,
        spans: common_spans(comparisons),
        log_y: false,
    };
    let mut levels = Vec::new();
    let mut excesses = Vec::new();
    for controller in ENTROPIES {
        let of = |one: &Comparison| Some(one.of(controller)?.entropies_nat.clone());
        levels.extend(mean_over_runs(controller.name(), comparisons.iter().filter_map(of).collect()));
        let excess = |one: &Comparison| {
            let genie = one.of(Controller::Genie)?.entropies_nat.iter();
            Some(of(one)?.into_iter().zip(genie).map(|(own, genie)| own - genie).collect())
        };
        excesses.extend(match controller {
            // Far above the others under interference; its look is kept for it.
            Controller::Fixed => vec![Series::default()],
            _ => mean_over_runs(controller.name(), comparisons.iter().filter_map(excess).collect()),
        });
    }
    let lines = figure(format!("{scenario}: entropy of the position, {runs}"), "entropy in nat", levels);
    let below = figure("Above the genie's entropy, without fixed".into(), "entropy in nat", excesses);
    Picture::of(BlockFigure { lines, blocks: Vec::new() })
        .below(BlockFigure { lines: below, blocks: Vec::new() })
}

/// The mean of runs over the cycles, over single runs.
fn mean_over_runs(label: &str, runs: Vec<Vec<f64>>) -> Vec<Series> {
    if runs.is_empty() {
        return Vec::new();
    }
    let line = |points, faint| Series { label: label.into(), points, faint };
    // Ways may differ in length; the mean goes as far as all of them do.
    let cycles = runs.iter().map(Vec::len).min().unwrap_or(0);
    let mean = (0..cycles).map(|cycle| runs.iter().map(|run| run[cycle]).sum::<f64>() / runs.len() as f64);
    let single = if runs.len() > 1 { SINGLE_RUNS } else { 0 };
    let mut series: Vec<Series> =
        runs.iter().take(single).map(|run| line(over_cycles(run.iter().copied()), true)).collect();
    series.push(line(over_cycles(mean), false));
    series
}

/// What the core's controller thought every action worth.
fn values(scenario: &str, first: &Comparison, run: &Run, watched: &Watched) -> HeatMap {
    let values_nat = &watched.decisions.values_nat;
    HeatMap {
        title: format!(
            "{scenario}: action values J relative to the carrier in use, run of seed {}",
            first.seed
        ),
        value_label: "J in nat".into(),
        value_range: value_range(decided(values_nat).flatten().copied()),
        ..over_actions(first, run, watched, values_nat)
    }
}

/// The policy of the core's controller.
fn policies(scenario: &str, first: &Comparison, run: &Run, watched: &Watched) -> HeatMap {
    let all = decided(&watched.decisions.policies).flatten().map(|&share| f64::from(share));
    let least = all.fold(1.0, f64::min);
    HeatMap {
        title: format!("{scenario}: policy, run of seed {}", first.seed),
        value_label: "probability".into(),
        value_range: Some([least, 1.0]),
        log: true,
        ..over_actions(first, run, watched, &watched.decisions.policies)
    }
}

/// A map over cycles and actions of what was thought of an action before it was chosen, and the choice.
fn over_actions(first: &Comparison, run: &Run, watched: &Watched, thought: &[Vec<f32>]) -> HeatMap {
    let rows = Rows::new(watched);
    let columns: Vec<&Vec<f32>> = decided(thought).collect();
    let values = rows.order.iter().map(|&action| {
        columns.iter().map(|column| column.get(action).map_or(f64::NAN, |&value| f64::from(value))).collect()
    });
    // The first cycle's action is given, all others were chosen.
    let chosen = run.actions.get(1..).unwrap_or(&[]);
    let chosen: Vec<f64> = chosen.iter().map(|actions| rows.place(actions[0])).collect();
    let points = marked(&held(&chosen), MOMENT * chosen.len() as f64, 1.0);
    // The first look is that of the fixed carrier.
    let chosen = Series { label: "chosen".into(), points, faint: false };
    HeatMap {
        x_label: "cycle".into(),
        y_label: rows.label.into(),
        x: [edge(1), edge(1 + columns.len())],
        values: values.collect(),
        lines: vec![Series::default(), chosen],
        spans: spans(first),
        rows: rows.rows,
        ..HeatMap::default()
    }
}

/// What was thought before a choice: the last cycle's leads to none.
fn decided(thought: &[Vec<f32>]) -> impl Iterator<Item = &Vec<f32>> {
    thought.iter().take(thought.len().saturating_sub(1))
}

/// The scale of values.
fn value_range(values: impl Iterator<Item = f32>) -> Option<[f64; 2]> {
    let mut values: Vec<f64> = values.map(f64::from).filter(|value| value.is_finite()).collect();
    values.sort_by(f64::total_cmp);
    let [below, above] = BEYOND.map(|share| (share * values.len() as f64) as usize);
    Some([*values.get(below)?, *values.iter().nth_back(above)?])
}

/// Where a cycle begins on an axis on which its own number is its middle.
fn edge(cycle: usize) -> f64 {
    cycle as f64 - 0.5
}

fn over_cycles(values: impl Iterator<Item = f64>) -> Vec<[f64; 2]> {
    values.enumerate().map(|(cycle, value)| [cycle as f64, value]).collect()
}

/// Levels cycle by cycle, each as long as it is held and nothing between them: a line from level to level would hide
/// where they are when they change often.
fn held(levels: &[f64]) -> Vec<[f64; 2]> {
    let mut points = Vec::new();
    let mut cycle = 0;
    for run in levels.chunk_by(|a, b| a == b) {
        let next = cycle + run.len();
        points.extend([[edge(cycle), run[0]], [edge(next), run[0]], [f64::NAN; 2]]);
        cycle = next;
    }
    points
}

/// The same, `later` cycles later, with a single point for what is held for less than `least` cycles.
fn marked(held: &[[f64; 2]], least: f64, later: f64) -> Vec<[f64; 2]> {
    let mark = |level: &[[f64; 2]]| match level {
        [[from, y], [to, _], gap] if to - from < least => vec![[0.5 * (from + to) + later, *y], *gap],
        _ => level.iter().map(|[x, y]| [x + later, *y]).collect(),
    };
    held.chunks(3).flat_map(mark).collect()
}

/// The time under interference in one comparison, if any.
fn spans(comparison: &Comparison) -> Vec<Span> {
    let cycles = &comparison.interfered;
    let span = || Span { from: edge(cycles.start), to: edge(cycles.end), label: "interference".into() };
    (!cycles.is_empty()).then(span).into_iter().collect()
}

/// The same where it is the same in all; ways of different lengths have it in different cycles.
fn common_spans(comparisons: &[Comparison]) -> Vec<Span> {
    let Some(first) = comparisons.first() else { return Vec::new() };
    if comparisons.iter().all(|one| one.interfered == first.interfered) { spans(first) } else { Vec::new() }
}

/// The rows of a map over actions, by carrier.
struct Rows {
    /// Actions, row by row.
    order: Vec<usize>,
    rows: HeatRows,
    label: &'static str,
}

impl Rows {
    fn new(watched: &Watched) -> Self {
        let (carriers_hz, durations_s) = (&watched.carriers_hz, &watched.pulse_durations_s);
        let mut order: Vec<usize> = (0..carriers_hz.len()).collect();
        let by_carrier = |&a: &usize, &b: &usize| {
            carriers_hz[a].total_cmp(&carriers_hz[b]).then(durations_s[b].total_cmp(&durations_s[a]))
        };
        order.sort_by(by_carrier);
        let (first, last) = match &order[..] {
            [first, .., last] => (carriers_hz[*first], carriers_hz[*last]),
            _ => (0.0, 0.0),
        };
        let step_hz = (last - first) / (order.len().max(2) - 1) as f64;
        let is_even = |(row, &action): (usize, &usize)| {
            (carriers_hz[action] - first - row as f64 * step_hz).abs() < 1e-3 * step_hz
        };
        if order.len() > 2 && order.iter().enumerate().all(is_even) {
            let edges = [first - 0.5 * step_hz, last + 0.5 * step_hz].map(|hz| 1e-9 * hz);
            return Self { order, rows: HeatRows::Axis(edges), label: "carrier in GHz" };
        }
        // Few channels far apart make no axis in hertz. Names go from the top down, carriers upwards.
        order.reverse();
        let same_pulse = durations_s.windows(2).all(|pair| pair[0] == pair[1]);
        let name = |&action: &usize| {
            let carrier = format!("{:.2} GHz", 1e-9 * carriers_hz[action]);
            if same_pulse { carrier } else { format!("{carrier}, {:.1} ns", 1e9 * durations_s[action]) }
        };
        Self { rows: HeatRows::Named(order.iter().map(name).collect()), order, label: "carrier" }
    }

    /// Where an action lies on the vertical axis.
    fn place(&self, action: usize) -> f64 {
        let row = self.order.iter().position(|&other| other == action).map_or(f64::NAN, |row| row as f64);
        match &self.rows {
            HeatRows::Axis([low, high]) => low + (row + 0.5) * (high - low) / self.order.len() as f64,
            HeatRows::Named(_) => row + 0.5,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Campaign, compare_each};
    use super::*;
    use crate::demo;
    use crate::scenario::{Library, NamedLibrary, Scenario};
    use cogmint_core::Variant;

    const CYCLES: usize = 40;

    /// Two short runs of the seminar room under interference.
    fn comparisons(controllers: &[Controller], watched: bool) -> Vec<Comparison> {
        let (mut scenario, _) = Scenario::find("seminar-room").expect("is built in");
        scenario.radio.library = Some(Library::Named(NamedLibrary::Wide));
        scenario.interference.push(demo::interferer(-8.0));
        scenario.trajectories.truncate(1);
        scenario.trajectories[0].cycles = Some(CYCLES);
        compare_each(
            &scenario,
            None,
            controllers,
            &Campaign { runs: 2, seed: 3, variant: Variant::Soft, watched },
            || {},
        )
        .expect("runs")
    }

    /// The carrier drawn in a cycle, of a line of levels.
    fn level(line: &Series, cycle: usize) -> f64 {
        let mut levels = line.points.chunks(3);
        let holds = |level: &&[[f64; 2]]| level[0][0] <= cycle as f64 && cycle as f64 <= level[1][0];
        levels.find(holds).expect("is drawn")[0][1]
    }

    #[test]
    fn what_is_drawn_is_what_was_run() {
        let comparisons = comparisons(&[Controller::Greedy, Controller::Cognitive], true);
        let [first, second] = &comparisons[..] else { panic!("two runs") };
        let watched = first.watched.as_ref().expect("is watched");
        assert!(second.watched.is_none());

        let figure = carriers("room", first, watched);
        // 2 GHz wide at 7 GHz, from 0.35 to 0.75 of the way; the roll-off of 0.6 adds as much at either side.
        let [band, skirts] = &figure.blocks[..] else { panic!("one interferer") };
        let close = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).abs() < 1e-9 && (a[1] - b[1]).abs() < 1e-9;
        assert!(close(band.x, [13.5, 29.5]) && close(band.y, [6.0, 8.0]), "{band:?}");
        assert!(close(skirts.x, band.x) && close(skirts.y, [5.4, 8.6]) && skirts.faint, "{skirts:?}");
        for controller in CARRIERS {
            let run = first.of(controller).expect("is compared");
            let mut lines = figure.lines.series.iter().filter(|line| line.label == controller.name());
            let line = lines.rfind(|line| !line.faint).expect("is drawn");
            for (cycle, actions) in run.actions.iter().enumerate() {
                assert!((level(line, cycle) - 5.0 - 0.1 * actions[0] as f64).abs() < 1e-9, "{cycle}");
            }
        }

        let Picture { rows } = entropies("room", &comparisons);
        let [crate::plot::Panel::Blocks(top), crate::plot::Panel::Blocks(_)] = &rows.concat()[..] else {
            panic!("two panels")
        };
        // Of four controllers two runs and their mean.
        assert_eq!(top.lines.series.len(), 4 * 3);
        for three in top.lines.series.chunks(3) {
            let [one, other, mean] = three else { panic!("three lines") };
            assert!(one.faint && other.faint && !mean.faint && mean.points.len() == CYCLES);
            for ((one, other), mean) in one.points.iter().zip(&other.points).zip(&mean.points) {
                assert!((mean[1] - 0.5 * (one[1] + other[1])).abs() < 1e-12 && mean[0] == one[0]);
            }
        }

        let run = first.of(Controller::Cognitive).expect("is compared");
        let (values, policies) = (values("room", first, run, watched), policies("room", first, run, watched));
        for map in [&values, &policies] {
            assert_eq!((map.values.len(), map.x), (40, [0.5, CYCLES as f64 - 0.5]));
            assert!(map.values.iter().all(|row| row.len() == CYCLES - 1));
        }
        for cycle in 1..CYCLES {
            // The value of the action chosen is what all others are relative to; rows count upwards.
            assert_eq!(values.values[run.actions[cycle][0]][cycle - 1], 0.0, "{cycle}");
            let sum: f64 = policies.values.iter().map(|row| row[cycle - 1]).sum();
            assert!((sum - 1.0).abs() < 1e-5, "{sum}");
        }
    }

    #[test]
    fn watching_changes_nothing() {
        let [plain, watched] = [false, true].map(|watched| comparisons(&[Controller::Cognitive], watched));
        for (plain, watched) in plain.iter().zip(&watched) {
            for (plain, watched) in plain.runs.iter().zip(&watched.runs) {
                assert_eq!(plain.actions, watched.actions);
                assert_eq!(plain.entropies_nat, watched.entropies_nat);
            }
        }
    }

    #[test]
    fn without_the_cores_controller_the_rest_is_drawn_and_the_lack_told() {
        let Pictures { named, left_out } = Pictures::new("room", &comparisons(&[], true));
        let names: Vec<_> = named.iter().map(|(name, _)| *name).collect();
        assert_eq!(names, ["carrier", "entropy"]);
        let said = left_out.join(" ");
        assert!(said.contains("value and policy") && said.contains("cognitive and greedy"), "{said}");
    }

    #[test]
    fn moments_become_dots_in_their_middle() {
        let points = marked(&held(&[1.0, 1.0, 1.0, 2.0, 1.0, 1.0]), 1.5, 1.0);
        let finite: Vec<_> = points.into_iter().filter(|point| point[0].is_finite()).collect();
        assert_eq!(finite, [[0.5, 1.0], [3.5, 1.0], [4.0, 2.0], [4.5, 1.0], [6.5, 1.0]]);
    }

    #[test]
    fn few_channels_are_rows_of_their_own_from_the_highest_carrier_down() {
        let watched = |carriers_hz: &[f64], durations_s: &[f64]| Watched {
            carriers_hz: carriers_hz.into(),
            pulse_durations_s: durations_s.into(),
            occupied: Vec::new(),
            decisions: Default::default(),
        };
        let two = Rows::new(&watched(&[6.4896e9, 7.9872e9], &[2e-9, 2e-9]));
        assert_eq!(two.rows, HeatRows::Named(vec!["7.99 GHz".into(), "6.49 GHz".into()]));
        assert_eq!([two.place(0), two.place(1)], [1.5, 0.5]);
        let wide = Rows::new(&watched(&[4e9, 4e9], &[2e-9, 1.1e-9]));
        assert_eq!(wide.rows, HeatRows::Named(vec!["4.00 GHz, 1.1 ns".into(), "4.00 GHz, 2.0 ns".into()]));
        let even = Rows::new(&watched(&[6.0e9, 6.5e9, 7.0e9], &[2e-9; 3]));
        let HeatRows::Axis([low, high]) = even.rows else { panic!("evenly spaced carriers make an axis") };
        assert!((low - 5.75).abs() < 1e-9 && (high - 7.25).abs() < 1e-9);
        assert!((even.place(1) - 6.5).abs() < 1e-9);
    }
}
