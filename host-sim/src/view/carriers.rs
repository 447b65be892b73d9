//! How much carriers differ: every path's SINR over the carrier, and the position error bound over carrier and way.

use super::decibel;
use crate::bound::{cycle_information, error_bound_m};
use crate::plot::{HeatMap, HeatRows, Picture, Series};
use crate::simulator::Simulator;
use rayon::prelude::*;
use serde::Serialize;

/// Positions along the way that are looked at, at most.
const LOOKS: usize = 100;

/// A source of paths over the carriers.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Source {
    /// Name of its anchor.
    pub anchor: String,
    /// Index of the virtual anchor in the recording; none for the direct path.
    pub virtual_anchor: Option<usize>,
    /// Share of the way on which it is visible.
    pub visible: f64,
    /// Mean SINR where it is visible, decibels, per action.
    pub sinr_db: Vec<f64>,
    /// Largest less smallest of these, decibels.
    pub spread_db: f64,
}

/// Carriers compared in a scenario.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Carriers {
    /// The scenario's name.
    pub scenario: String,
    /// Carriers, hertz, per action.
    pub carrier_hz: Vec<f64>,
    /// Sources that are visible somewhere, by anchor.
    pub sources: Vec<Source>,
    /// Median over all sources of how much their SINR differs between carriers, decibels.
    pub median_spread_db: f64,
    /// Cycles at which the error bound was looked at.
    pub cycles: Vec<usize>,
    /// Position error bound, metres, per action and look; infinite where the position is not observable.
    #[serde(skip)]
    pub error_bound_m: Vec<Vec<f64>>,
    /// Median over the way of the position error bound, metres, per action.
    pub median_error_bound_m: Vec<f64>,
    /// Median over the way with the best carrier at every place, metres.
    pub best_median_error_bound_m: f64,
}

/// Looks at every carrier along the way.
pub fn compare(simulator: &Simulator) -> Carriers {
    let channel = simulator.channel();
    let actions = &channel.receiver().actions;
    let cycles: Vec<usize> =
        (0..simulator.cycles()).step_by(simulator.cycles().div_ceil(LOOKS).max(1)).collect();
    let mut sources = Vec::new();
    for (anchor, of) in channel.scenario().anchors.iter().enumerate() {
        // Per action and source: sum of the SINR and how often it was visible.
        let tally = |action: usize| {
            let mut tally = vec![(0.0, 0_usize); channel.images(anchor).len()];
            for &cycle in &cycles {
                for component in channel.components(cycle, anchor, action) {
                    tally[component.source].0 += component.sinr;
                    tally[component.source].1 += 1;
                }
            }
            tally
        };
        let tallies: Vec<_> = (0..actions.len()).into_par_iter().map(tally).collect();
        for source in 0..channel.images(anchor).len() {
            let count = tallies[0][source].1;
            if count == 0 {
                continue;
            }
            let sinr_db: Vec<f64> = tallies.iter().map(|t| decibel(t[source].0 / count as f64)).collect();
            let (low, high) = extent(&sinr_db);
            sources.push(Source {
                anchor: of.name.clone(),
                virtual_anchor: simulator.virtual_anchor(anchor, source),
                visible: count as f64 / cycles.len() as f64,
                sinr_db,
                spread_db: high - low,
            });
        }
    }
    let error_bound_m: Vec<Vec<f64>> = (0..actions.len())
        .into_par_iter()
        .map(|action| {
            let at = |&cycle: &usize| error_bound_m(cycle_information(channel, cycle, action));
            cycles.iter().map(at).collect()
        })
        .collect();
    let best = (0..cycles.len())
        .map(|n| error_bound_m.iter().map(|bounds: &Vec<f64>| bounds[n]).fold(f64::INFINITY, f64::min));
    Carriers {
        scenario: channel.scenario().name.clone(),
        carrier_hz: actions.iter().map(|action| action.carrier_hz).collect(),
        median_spread_db: median(sources.iter().map(|source| source.spread_db)),
        median_error_bound_m: error_bound_m.iter().map(|bounds| median(bounds.iter().copied())).collect(),
        best_median_error_bound_m: median(best),
        sources,
        cycles,
        error_bound_m,
    }
}

impl Carriers {
    /// SINR over the carriers for every source, above the error bound over carrier and way.
    pub fn picture(&self) -> Picture {
        let names = self.sources.iter().map(|source| {
            let label = source.virtual_anchor.map_or_else(|| "direct".into(), |index| format!("VA {index}"));
            format!("{} {label}", source.anchor)
        });
        let mut order: Vec<usize> = (0..self.carrier_hz.len()).collect();
        order.sort_by(|&a, &b| self.carrier_hz[a].total_cmp(&self.carrier_hz[b]));
        // Few channels far apart make no axis in hertz: actions are counted instead.
        let edges = self.edges_ghz(&order);
        let (axis, label) = match edges {
            Some(edges) => (edges, "carrier in GHz"),
            None => ([-0.5, self.carrier_hz.len() as f64 - 0.5], "action"),
        };
        let order = if edges.is_some() { order } else { (0..self.carrier_hz.len()).collect() };
        let sinr = HeatMap {
            title: format!("{}: mean SINR of every path", self.scenario),
            x_label: label.into(),
            y_label: String::new(),
            value_label: "SINR in dB".into(),
            x: axis,
            rows: HeatRows::Named(names.collect()),
            values: self
                .sources
                .iter()
                .map(|source| order.iter().map(|&action| source.sinr_db[action]).collect())
                .collect(),
            ..HeatMap::default()
        };
        let step = self.cycles.get(1).map_or(1.0, |&second| second as f64);
        let place = |row: usize| axis[0] + (row as f64 + 0.5) * (axis[1] - axis[0]) / order.len() as f64;
        let best = (0..self.cycles.len()).map(|n| {
            let bound = |row: &usize| self.error_bound_m[order[*row]][n];
            let row = (0..order.len()).min_by(|a, b| bound(a).total_cmp(&bound(b))).unwrap_or(0);
            [(n as f64 + 0.5) * step, place(row)]
        });
        let bound = HeatMap {
            title: "Position error bound of one cycle along the way".into(),
            x_label: "cycle".into(),
            y_label: label.into(),
            value_label: "bound in m".into(),
            x: [0.0, step * self.cycles.len() as f64],
            rows: HeatRows::Axis(axis),
            values: order
                .iter()
                .map(|&action| {
                    let finite = |bound: &f64| if bound.is_finite() { *bound } else { f64::NAN };
                    self.error_bound_m[action].iter().map(finite).collect()
                })
                .collect(),
            log: true,
            lines: vec![Series { label: "best carrier".into(), points: best.collect(), faint: false }],
            ..HeatMap::default()
        };
        Picture { rows: vec![vec![sinr.into()], vec![bound.into()]] }
    }

    /// Outer edges of an even axis of carriers, if they are evenly spaced.
    fn edges_ghz(&self, order: &[usize]) -> Option<[f64; 2]> {
        let (first, last) = (self.carrier_hz[*order.first()?], self.carrier_hz[*order.last()?]);
        let step = (last - first) / (order.len().max(2) - 1) as f64;
        let even = order
            .iter()
            .enumerate()
            .all(|(n, &action)| (self.carrier_hz[action] - first - n as f64 * step).abs() < 1e-3 * step);
        (even && order.len() > 2).then_some([(first - 0.5 * step) * 1e-9, (last + 0.5 * step) * 1e-9])
    }
}

fn extent(values: &[f64]) -> (f64, f64) {
    values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), &v| (low.min(v), high.max(v)))
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}
