//! A scenario's floor plan, and which paths exist along the way.

use super::decibel;
use crate::plot::{HeatMap, HeatRows, Panel, Picture, RoomFigure, RoomWall, VirtualAnchor};
use crate::scenario;
use crate::simulator::Simulator;
use rayon::prelude::*;

/// Columns of the visibility panel, at most.
const COLUMNS: usize = 800;
/// Rows of it, at most: the strongest sources.
const ROWS: usize = 32;

/// The picture: the plan with everything in it, above the SINR of every source along the way.
pub fn picture(simulator: &Simulator) -> Picture {
    Picture { rows: vec![vec![Panel::Room(plan(simulator))], vec![visibility(simulator).into()]] }
}

/// The name of a virtual anchor of the recording.
fn name(index: usize) -> String {
    format!("VA {index}")
}

fn plan(simulator: &Simulator) -> RoomFigure {
    let channel = simulator.channel();
    let scenario = channel.scenario();
    let recording = simulator.before();
    let walls = scenario::walls(&scenario.room);
    let visible = recording.virtual_anchors.iter().enumerate().filter(|(_, va)| va.exists);
    RoomFigure {
        title: format!("{}: floor plan, trajectory {}", scenario.name, simulator.trajectory()),
        walls: walls
            .into_iter()
            .map(|(ends_m, construction)| RoomWall { ends_m, construction: construction.into() })
            .collect(),
        anchors: recording.anchors.iter().map(|anchor| (anchor.name.clone(), anchor.position_m)).collect(),
        virtual_anchors: visible
            .map(|(index, va)| VirtualAnchor {
                position_m: va.position_m,
                label: index.to_string(),
                anchor: va.anchor,
                order: simulator.order(index),
            })
            .collect(),
        trajectories: vec![("way".into(), channel.poses().iter().map(|pose| pose.position_m).collect())],
        people: scenario.people.iter().map(|person| person.way_m.clone()).collect(),
        rays: Vec::new(),
    }
}

fn visibility(simulator: &Simulator) -> HeatMap {
    let channel = simulator.channel();
    let action = channel.receiver().first_action;
    let cycles = simulator.cycles();
    let step = cycles.div_ceil(COLUMNS).max(1);
    let looks: Vec<usize> = (0..cycles).step_by(step).collect();
    // Per anchor and source: its name and its SINR at every look.
    let mut rows: Vec<(String, Vec<f64>)> = Vec::new();
    for (anchor, of) in channel.scenario().anchors.iter().enumerate() {
        let seen: Vec<_> = looks.par_iter().map(|&cycle| channel.components(cycle, anchor, action)).collect();
        let mut values = vec![vec![f64::NAN; looks.len()]; channel.images(anchor).len()];
        for (look, components) in seen.iter().enumerate() {
            for component in components {
                values[component.source][look] = decibel(component.sinr);
            }
        }
        for (source, values) in values.into_iter().enumerate() {
            let label = match simulator.virtual_anchor(anchor, source) {
                Some(index) => name(index),
                None if source == 0 => "direct".into(),
                None => continue,
            };
            rows.push((format!("{} {label}", of.name), values));
        }
    }
    let strength = |values: &[f64]| values.iter().filter(|v| v.is_finite()).map(|v| v.max(0.0)).sum::<f64>();
    let all = rows.len();
    if all > ROWS {
        let mut strengths: Vec<f64> = rows.iter().map(|(_, values)| strength(values)).collect();
        strengths.sort_by(|a, b| b.total_cmp(a));
        let least = strengths[ROWS - 1];
        rows.retain(|(_, values)| strength(values) >= least);
    }
    let shown =
        if rows.len() < all { format!(" (the {} strongest of {all})", rows.len()) } else { String::new() };
    let carrier_ghz = channel.receiver().actions[action].carrier_hz * 1e-9;
    let (names, values) = rows.into_iter().unzip();
    HeatMap {
        title: format!("Visible paths{shown}, SINR at {carrier_ghz:.2} GHz"),
        x_label: "cycle".into(),
        y_label: String::new(),
        value_label: "SINR in dB".into(),
        x: [0.0, (looks.len() * step) as f64],
        rows: HeatRows::Named(names),
        values,
        ..HeatMap::default()
    }
}
