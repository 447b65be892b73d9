//! The main job: the built-in room, once with a fixed carrier and once with the tracker's own choice.

use crate::input_error::InputError;
use crate::plot::{LineFigure, MappedAnchor, Panel, Picture, Series, Span, TrackFigure};
use crate::recording::Recording;
use crate::replay::{SMALL_ANCHORS, Setup, Step, input, step};
use crate::room::{FIRST_ACTION, Room};
use crate::score::Score;
use std::path::Path;

/// One run through the room.
#[derive(Clone, Debug)]
pub struct Run {
    /// What it is called: fixed or cognitive.
    pub name: &'static str,
    /// What it received, as a recording that replays to the same states.
    pub recording: Recording,
    /// What became of it, cycle by cycle.
    pub steps: Vec<Step>,
    /// Position errors, metres.
    pub errors_m: Vec<f64>,
    /// Its score.
    pub score: Score,
}

/// Runs the room with the tracker choosing carriers (`cognitive`) or staying at the first one.
///
/// # Errors
/// The core refuses something, which would be a defect.
pub fn run(room: &Room, cognitive: bool, seed: u64, mut on_cycle: impl FnMut()) -> Result<Run, InputError> {
    let file = Path::new("the built-in room");
    let refused = |error: cogmint_core::Error| InputError::new(file, error.to_string());
    let mut recording = room.before();
    recording.cycles.push(room.cycle(0, FIRST_ACTION));
    let mut setup = Setup::new(&recording, file, Some(seed))?;
    if !cognitive {
        setup.config.controller.planned_actions = 0;
    }
    let mut tracker = setup.tracker::<SMALL_ANCHORS>().map_err(refused)?;
    let mut steps: Vec<Step> = Vec::new();
    let mut errors_m = Vec::new();
    for cycle in 0..room.cycles() {
        let action = steps.last().map_or(FIRST_ACTION, |step: &Step| step.report.next_action);
        let received = room.cycle(cycle, action);
        let previous_s = cycle.checked_sub(1).map(|previous| recording.cycles[previous].time_s);
        let input = input(&recording, &received, previous_s);
        let step = step(&mut tracker, &input, &mut ()).map_err(refused)?;
        let [x, y] = room.position_m(cycle);
        let [u, v] = step.report.position_m;
        errors_m.push((x - f64::from(u)).hypot(y - f64::from(v)));
        steps.push(step);
        if cycle > 0 {
            // The first is there already: the set-up was made from it.
            recording.cycles.push(received);
        }
        on_cycle();
    }
    let seconds = steps.iter().map(|step| step.seconds).sum();
    let score = Score::new(steps.len(), &errors_m, seconds);
    Ok(Run { name: if cognitive { "cognitive" } else { "fixed" }, recording, steps, errors_m, score })
}

/// The picture of a comparison: the tracks beside the errors, carriers and entropies over the cycles.
pub fn picture(room: &Room, runs: &[Run]) -> Picture {
    let Some(first) = runs.first() else { return Picture { rows: Vec::new() } };
    let position = |step: &Step| step.report.position_m.map(f64::from);
    let track = TrackFigure {
        title: "Built-in room: true way and estimates".into(),
        truth: (0..room.cycles()).map(|cycle| room.position_m(cycle)).collect(),
        estimates: runs
            .iter()
            .map(|run| (run.name.into(), run.steps.iter().map(position).collect()))
            .collect(),
        anchors: first.recording.anchors.iter().map(|a| (a.name.clone(), a.position_m)).collect(),
        virtual_anchors: first
            .recording
            .virtual_anchors
            .iter()
            .map(|va| MappedAnchor {
                label: String::new(),
                position_m: va.position_m,
                covariance_m2: None,
                is_truth: true,
            })
            .collect(),
        walls: room.walls(),
        ellipses: Vec::new(),
    };
    let over_cycles =
        |title: &str, y_label: &str, log_y: bool, value: &dyn Fn(&Run, usize) -> f64| LineFigure {
            title: title.into(),
            x_label: "cycle".into(),
            y_label: y_label.into(),
            series: runs
                .iter()
                .map(|run| Series {
                    label: run.name.into(),
                    points: (0..run.steps.len()).map(|n| [n as f64, value(run, n)]).collect(),
                    faint: false,
                })
                .collect(),
            spans: vec![Span {
                from: room.interfered()[0] as f64,
                to: room.interfered()[1] as f64,
                label: "interferer at 7 GHz".into(),
            }],
            log_y,
        };
    let error = over_cycles("Position error", "error in m", true, &|run, n| run.errors_m[n].max(1e-4));
    let carrier = over_cycles("Carrier", "carrier in GHz", false, &|run, n| {
        let action = run.recording.cycles[n].frames.first().map_or(0, |frame| frame.action);
        run.recording.actions[action].carrier_hz / 1e9
    });
    let entropy = over_cycles("Entropy of the position", "entropy in nat", false, &|run, n| {
        f64::from(run.steps[n].report.entropy_nat)
    });
    Picture { rows: vec![vec![Panel::Track(track), error.into()], vec![carrier.into(), entropy.into()]] }
}
