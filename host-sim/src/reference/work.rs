//! How many components of the belief a cycle has work for, by what its frames have cost.

use super::known::Told;
use super::real::Real;
use super::receiver::Scan;
use cogmint_core::model::work::{BACKGROUND, COMPONENT, CYCLE, EXPECTED, PLACE, PLANNED};
use cogmint_core::perceptor::belief::proposal::{ARCS, EARLIEST};

/// That number; `sources` are those of the map by anchor, `proposes` says whether places will be proposed.
pub fn slots<T: Real>(
    told: &Told<'_, T>,
    scans: &[Scan<T>],
    sources: impl Fn(usize) -> usize,
    proposes: bool,
) -> usize {
    let limits = told.config.work;
    let controller = told.config.controller;
    // Each scan with its anchor's direct path and images, and with its measurements.
    let sizes: Vec<[u64; 2]> =
        scans.iter().map(|scan| [1 + sources(scan.anchor) as u64, scan.measurements.len() as u64]).collect();
    let frames: u64 = scans.iter().map(|scan| u64::from(scan.cost.work)).sum();
    let actions = controller.planned_actions.min(told.library.actions.len()) as u64;
    let all: u64 = (0..told.anchors.len()).map(|anchor| 1 + sources(anchor) as u64).sum();
    let ahead = PLANNED[2] * (controller.horizon as u32).saturating_sub(1);
    let each = u64::from(PLANNED[0]) + u64::from(PLANNED[1] + ahead) * actions;
    let planning = if told.library.actions.len() > 1 && actions > 0 { all * each } else { 0 };
    let arcs = if proposes { (ARCS * EARLIEST) as u64 } else { 0 };
    let each_place = |[k, m]: &[u64; 2]| {
        k * (u64::from(PLACE[0]) + u64::from(PLACE[1]) * m) + u64::from(BACKGROUND) * m * m
    };
    let place: u64 = sizes.iter().map(each_place).sum();
    let others = frames + planning + arcs * place + u64::from(CYCLE);
    let mut component = u64::from(COMPONENT);
    for [k, m] in sizes {
        component += u64::from(EXPECTED[0]) + k * (u64::from(EXPECTED[1]) + u64::from(EXPECTED[2]) * m);
    }
    let most = u64::from(limits.anchor) * scans.len() as u64;
    let by_work = most.saturating_sub(others) / component;
    (by_work as usize).min(usize::from(limits.comparisons) / scans.len().max(1))
}
