//! How many components a cycle has work for, by what its frames have cost and what the rest is expected to cost.

use super::values::Told;
use crate::config::WorkLimits;
use crate::controller::ControllerSettings;
use crate::memory::environment::EnvironmentMemory;
use crate::model::work::{BACKGROUND, COMPONENT, CYCLE, EXPECTED, PLACE, PLANNED, Work};
use crate::perceptor::belief::TagBelief;
use crate::perceptor::belief::proposal::{ARCS, EARLIEST};
use crate::perceptor::receiver::Scans;

/// How many components a cycle has work for, once its frames are estimated.
#[inline(never)]
pub(super) fn slots<
    const ANCHORS: usize,
    const SURFACES: usize,
    const SOURCES: usize,
    const PATHS: usize,
    const ACTIONS: usize,
    const COMPONENTS: usize,
>(
    belief: &TagBelief<ANCHORS, SURFACES, COMPONENTS>,
    told: &Told<'_, ANCHORS, ACTIONS>,
    environment: &EnvironmentMemory<SURFACES, SOURCES>,
    scans: &Scans<ANCHORS, PATHS>,
) -> usize {
    let WorkLimits { anchor, comparisons } = told.config.work;
    let [comparison, source, beside] = EXPECTED;
    let mut others = planning(told, told.anchors.len() + environment.iter().count());
    others.add(CYCLE, 1);
    if belief.will_propose() {
        others.add_all(weighing(environment, scans, ARCS * EARLIEST));
    }
    let mut component = Work::of(COMPONENT);
    for scan in scans {
        others.add_all(scan.work);
        component.add(comparison, 1);
        let sources = 1 + environment.images_of(scan.anchor).count();
        component.add_each([source, beside], sources, scan.measurements.len());
    }
    let most = anchor.saturating_mul(scans.len() as u32);
    let by_work = most.saturating_sub(others.instructions()) / component.instructions();
    (by_work as usize).min(usize::from(comparisons) / scans.len().max(1))
}

/// What planning costs with so many sources.
pub(super) fn planning<const ANCHORS: usize, const ACTIONS: usize>(
    told: &Told<'_, ANCHORS, ACTIONS>,
    sources: usize,
) -> Work {
    let ControllerSettings { planned_actions, horizon, .. } = told.config.controller;
    let actions = told.library.len();
    let planned = planned_actions.min(actions);
    let mut work = Work::NONE;
    if ACTIONS > 1 && actions > 1 && planned > 0 {
        let [source, action, ahead] = PLANNED;
        work.add_each([source, action], sources, planned);
        work.add(ahead, sources * planned * horizon.saturating_sub(1));
    }
    work
}

/// What weighing so many places by all scans costs at most.
fn weighing<const ANCHORS: usize, const SURFACES: usize, const SOURCES: usize, const PATHS: usize>(
    environment: &EnvironmentMemory<SURFACES, SOURCES>,
    scans: &Scans<ANCHORS, PATHS>,
    places: usize,
) -> Work {
    let mut work = Work::NONE;
    for scan in scans {
        let sources = 1 + environment.images_of(scan.anchor).count();
        let measurements = scan.measurements.len();
        work.add_each(PLACE, places * sources, measurements);
        work.add(BACKGROUND, places * measurements * measurements);
    }
    work
}
