//! The main job: the seminar room under interference, with the carrier that the interferer sits on, with one that it
//! leaves alone, and with the tracker's own choice.

use crate::input_error::InputError;
use crate::plot::{LineFigure, MappedAnchor, Panel, Picture, Series, Span, TrackFigure};
use crate::recording::Recording;
use crate::replay::{SMALL_ANCHORS, Setup, Step, input, step};
use crate::scenario::{Fading, Interference, Library, NamedLibrary, Part, Profile, Scenario, Strength};
use crate::score::Score;
use crate::simulator::Simulator;
use std::path::Path;

/// One run through the room.
#[derive(Clone, Debug)]
pub struct Run {
    /// What it is called.
    pub name: String,
    /// What it received, as a recording that replays to the same states.
    pub recording: Recording,
    /// What became of it, cycle by cycle.
    pub steps: Vec<Step>,
    /// Position errors, metres.
    pub errors_m: Vec<f64>,
    /// Its score.
    pub score: Score,
}

/// How a run's carrier is found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Carrier {
    /// The scenario's first one throughout.
    First,
    /// This action of the library throughout: who takes one that stays free knows beforehand which.
    Always(usize),
    /// The tracker's choice, from the scenario's first one on.
    Chosen,
}

/// The lowest carrier of the wide library, 5.0 GHz: 1 GHz below the main job's interferer.
pub const LOWEST: Carrier = Carrier::Always(0);

/// Share of the way on which the interferer is on.
const INTERFERED: Part = Part([0.35, 0.75]);
/// Median SINR that it leaves to the paths in use, at 7 GHz: hardly any can be found.
const LEFT_SINR_DB: f64 = -8.0;

/// The built-in seminar room with carriers to get away to and an interferer to get away from, `cycles` cycles of its
/// first trajectory (at most all of it) with one seed.
///
/// # Errors
/// None: the scenario is built in.
pub fn seminar_room(seed: u64, cycles: usize) -> Result<Simulator, InputError> {
    let (mut scenario, _) = Scenario::find("seminar-room")?;
    scenario.radio.library = Some(Library::Named(NamedLibrary::Wide));
    scenario.interference = vec![interferer(LEFT_SINR_DB)];
    if let Some(way) = scenario.trajectories.first_mut() {
        way.cycles = Some(way.cycles.unwrap_or(cycles).min(cycles));
    }
    Simulator::new(&scenario, None, 0, Some(seed))
}

/// An interferer 2 GHz wide at 7 GHz that leaves the paths in use a median SINR of `median_sinr_db` while it is on.
pub fn interferer(median_sinr_db: f64) -> Interference {
    Interference {
        during: INTERFERED,
        // It keeps no time with the anchors: the same at every delay.
        profile: Profile { rise_s: 1e-11, decay_s: 1e-6, chi: 0.0 },
        onset_s: -200e-9,
        fading: Fading::Independent,
        ..Interference::of(Strength::MedianSinrDb(median_sinr_db))
    }
}

/// The same interferer, moving to `then_hz` half-way through its time; there, too, it leaves the paths in use a median
/// SINR of `median_sinr_db`.
pub fn moving_interferer(median_sinr_db: f64, then_hz: f64) -> [Interference; 2] {
    let first = interferer(median_sinr_db);
    let [from, to] = first.during.0;
    let moves = 0.5 * (from + to);
    let then = Interference { carrier_hz: then_hz, during: Part([moves, to]), ..first.clone() };
    [Interference { during: Part([from, moves]), ..first }, then]
}

/// Cycles during which the first interferer transmits, from and to.
pub fn interfered(simulator: &Simulator) -> [usize; 2] {
    let channel = simulator.channel();
    let part =
        channel.scenario().interference.first().map(|interference| channel.cycles_of(interference.during));
    part.map_or([0, 0], |cycles| [cycles.start, cycles.end])
}

/// Runs a scenario with the tracker choosing carriers (`cognitive`) or staying at the first one.
///
/// # Errors
/// The core refuses something, which would be a defect.
pub fn run(
    simulator: &Simulator,
    cognitive: bool,
    seed: u64,
    on_cycle: impl FnMut(),
) -> Result<Run, InputError> {
    run_with(simulator, if cognitive { Carrier::Chosen } else { Carrier::First }, seed, on_cycle)
}

/// Runs a scenario with its carrier found so.
///
/// # Errors
/// The core refuses something: a carrier that the library does not have.
pub fn run_with(
    simulator: &Simulator,
    carrier: Carrier,
    seed: u64,
    mut on_cycle: impl FnMut(),
) -> Result<Run, InputError> {
    run_told(simulator, carrier, seed, &mut on_cycle)
}

/// Not generic: compiled here once, not again in every crate that calls it.
fn run_told(
    simulator: &Simulator,
    carrier: Carrier,
    seed: u64,
    on_cycle: &mut dyn FnMut(),
) -> Result<Run, InputError> {
    let file = Path::new(&simulator.channel().scenario().name);
    let refused = |error: cogmint_core::Error| InputError::new(file, error.to_string());
    let receiver = simulator.channel().receiver();
    let (first_action, name) = match carrier {
        Carrier::First => (receiver.first_action, "fixed".to_owned()),
        Carrier::Chosen => (receiver.first_action, "cognitive".to_owned()),
        Carrier::Always(action) => {
            let Some(always) = receiver.actions.get(action) else {
                return Err(InputError::new(file, format!("has no action {action}")));
            };
            (action, format!("always {:.1} GHz", always.carrier_hz / 1e9))
        }
    };
    let mut recording = simulator.before();
    recording.cycles.push(simulator.cycle(0, first_action));
    let mut setup = Setup::new(&recording, file, Some(seed))?;
    if carrier != Carrier::Chosen {
        setup.config.controller.planned_actions = 0;
    }
    let mut tracker = setup.tracker::<SMALL_ANCHORS>().map_err(refused)?;
    let mut steps: Vec<Step> = Vec::new();
    let mut errors_m = Vec::new();
    for cycle in 0..simulator.cycles() {
        let action = steps.last().map_or(first_action, |step: &Step| step.report.next_action);
        let received = simulator.cycle(cycle, action);
        let previous_s = cycle.checked_sub(1).map(|previous| recording.cycles[previous].time_s);
        let input = input(&recording, &received, previous_s);
        let step = step(&mut tracker, &input, &mut ()).map_err(refused)?;
        let [x, y] = simulator.channel().poses()[cycle].position_m;
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
    Ok(Run { name, recording, steps, errors_m, score })
}

/// The picture of a comparison: the tracks beside the errors, carriers and entropies over the cycles.
pub fn picture(simulator: &Simulator, runs: &[Run]) -> Picture {
    let Some(first) = runs.first() else { return Picture { rows: Vec::new() } };
    let position = |step: &Step| step.report.position_m.map(f64::from);
    let track = TrackFigure {
        title: format!("{}: true way and estimates", simulator.channel().scenario().name),
        truth: simulator.channel().poses().iter().map(|pose| pose.position_m).collect(),
        estimates: runs
            .iter()
            .map(|run| (run.name.clone(), run.steps.iter().map(position).collect()))
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
        walls: first.recording.walls.clone(),
        told_walls: Vec::new(),
        found_walls: Vec::new(),
        ellipses: Vec::new(),
        shows_map: false,
    };
    let over_cycles =
        |title: &str, y_label: &str, log_y: bool, value: &dyn Fn(&Run, usize) -> f64| LineFigure {
            title: title.into(),
            x_label: "cycle".into(),
            y_label: y_label.into(),
            series: runs
                .iter()
                .map(|run| Series {
                    label: run.name.clone(),
                    points: (0..run.steps.len()).map(|n| [n as f64, value(run, n)]).collect(),
                    faint: false,
                })
                .collect(),
            spans: vec![Span {
                from: interfered(simulator)[0] as f64,
                to: interfered(simulator)[1] as f64,
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
