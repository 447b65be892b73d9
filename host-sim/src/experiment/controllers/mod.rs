//! What choosing the carrier is worth: the core's controller against others, in the same simulated rooms.
//!
//! Every run has a seed and goes along one trajectory of the scenario, in turn. All controllers of a run see the same
//! room, interferer and noise; each steers a tracker of its own. What they chose is judged by the simulator's own
//! knowledge ([`truth`]), so that a controller can neither gain by a filter that thinks too well of itself nor lose by
//! chance; how well the tag was tracked meanwhile is told beside it.

pub mod choice;
pub mod figures;
mod full_band;
pub mod on_memory;
pub mod onset;
pub mod picture;
pub mod steered;
pub mod truth;
pub mod watched;

use crate::input_error::InputError;
use crate::replay::{LARGE_ANCHORS, SMALL_ANCHORS, Setup};
use crate::scenario::Scenario;
use crate::score::Score;
use crate::simulator::Simulator;
use cogmint_core::Variant;
use cogmint_core::config::ControllerSettings;
use cogmint_core::controller::reward::Reward;
use figures::Figures;
use onset::{Onset, onsets};
use rayon::prelude::*;
use std::ops::Range;
use std::path::Path;
use steered::{Steered, SteeredCycle};
use truth::{Actions, Truth};
use watched::{Decisions, Watched};

/// A controller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Controller {
    /// The scenario's first action, always.
    Fixed,
    /// Any action, each time anew.
    Random,
    /// Discounted UCB on the rewards alone.
    Bandit,
    /// The action that should tell most, by the tracker's memories.
    Greedy,
    /// The same, the SINR read as an optimist.
    Ucb,
    /// The same, the SINR drawn from what is known of it.
    Thompson,
    /// The core's learning and planning.
    Cognitive,
    /// The same, told the true SINR of every carrier in every cycle: what no radio can know, the published offline
    /// condition.
    FullBand,
    /// The core's with one thing changed: an index into [`ABLATIONS`].
    Ablated(usize),
    /// The action that tells most, by the simulator's own knowledge.
    Genie,
    /// The same, with an action of its own for every anchor.
    GeniePerAnchor,
}

impl Controller {
    /// All of them.
    pub const ALL: [Self; 8] = [
        Self::Fixed,
        Self::Random,
        Self::Bandit,
        Self::Greedy,
        Self::Ucb,
        Self::Thompson,
        Self::Cognitive,
        Self::Genie,
    ];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Fixed => "fixed",
            Self::Random => "random",
            Self::Bandit => "bandit",
            Self::Greedy => "greedy",
            Self::Ucb => "ucb",
            Self::Thompson => "thompson",
            Self::Cognitive => "cognitive",
            Self::FullBand => "full-band",
            Self::Ablated(index) => ABLATIONS.get(index).map_or("unknown", |(name, _)| name),
            Self::Genie => "genie",
            Self::GeniePerAnchor => "genie-per-anchor",
        }
    }
}

/// Something that is done to the core's settings.
type Change = fn(&mut ControllerSettings);

/// What the core's controller is tried without, or with instead.
pub const ABLATIONS: [(&str, Change); 20] = [
    ("no-planning", |settings| {
        settings.planned_actions = 1;
        settings.learning.rate = 0.0;
        settings.learning.experience_rate = 0.5;
        settings.choice.exploration_per_s = 1.0;
    }),
    ("no-neighbours", |settings| settings.neighbours = false),
    ("reward-published", |settings| settings.reward = Reward::Published { scale: 1e24 }),
    ("reward-entropy", |settings| settings.reward = Reward::EntropyChange),
    ("horizon-3", |settings| settings.horizon = 3),
    ("horizon-5", |settings| settings.horizon = 5),
    ("subset-5", |settings| settings.planned_actions = 5),
    ("subset-10", |settings| settings.planned_actions = 10),
    ("subset-40", |settings| settings.planned_actions = 40),
    ("no-exploration", |settings| settings.choice.exploration_per_s = 0.0),
    ("exploration-0.5", |settings| settings.choice.exploration_per_s = 0.5),
    ("no-search", |settings| settings.choice.patience_s = 0.0),
    ("no-hysteresis", |settings| settings.choice.hysteresis_nat = 0.0),
    ("rate-0.2", |settings| settings.learning.rate = 0.2),
    ("rate-1", |settings| settings.learning.rate = 1.0),
    ("no-experience", |settings| settings.learning.experience_rate = 0.0),
    ("experience-0.2", |settings| settings.learning.experience_rate = 0.2),
    ("bootstrap", |settings| settings.learning.bootstrap = true),
    ("per-anchor", |settings| settings.per_anchor = true),
    ("announced", |settings| settings.rendezvous = Some(settings.first_action)),
];

/// What one controller made of one run.
#[derive(Clone, Debug)]
pub struct Run {
    /// Which controller.
    pub controller: Controller,
    /// The actions used, cycle by cycle.
    pub actions: Vec<Actions>,
    /// Entropy of the position after each cycle by the yardstick, nats.
    pub entropies_nat: Vec<f64>,
    /// How well the tag was tracked.
    pub score: Score,
}

/// One run: the same room with every controller.
#[derive(Clone, Debug)]
pub struct Comparison {
    /// Its seed.
    pub seed: u64,
    /// Cycles under interference; empty where there is none.
    pub interfered: Range<usize>,
    /// Where interference begins, in order.
    pub onsets: Vec<Onset>,
    /// The runs.
    pub runs: Vec<Run>,
    /// What is drawn of it beyond the runs; only where that was asked for.
    pub watched: Option<Watched>,
}

/// How often and with which trackers.
#[derive(Clone, Copy, Debug)]
pub struct Campaign {
    /// Runs per controller, each along the next of the scenario's trajectories.
    pub runs: u32,
    /// Seed of the first run; the others count on.
    pub seed: u64,
    /// The variant of all trackers.
    pub variant: Variant,
    /// Whether the first run is watched: no controller notices, and a long campaign carries no more for it than one run's
    /// values.
    pub watched: bool,
}

/// Compares `controllers` (fixed and genie always among them) in the runs of a scenario.
///
/// # Errors
/// The scenario cannot be simulated.
pub fn compare(
    scenario: &Scenario,
    folder: Option<&Path>,
    controllers: &[Controller],
    campaign: &Campaign,
    on_run: impl Fn() + Sync,
) -> Result<Figures, InputError> {
    let comparisons = compare_each_told(scenario, folder, controllers, campaign, &on_run)?;
    Ok(Figures::new(&scenario.name, &comparisons))
}

/// The runs that [`compare`] makes its figures of.
///
/// # Errors
/// The scenario cannot be simulated, or the variant needs a floor plan that it has not.
pub fn compare_each(
    scenario: &Scenario,
    folder: Option<&Path>,
    controllers: &[Controller],
    campaign: &Campaign,
    on_run: impl Fn() + Sync,
) -> Result<Vec<Comparison>, InputError> {
    compare_each_told(scenario, folder, controllers, campaign, &on_run)
}

/// Not generic: compiled here once, not again in every crate that calls it.
fn compare_each_told(
    scenario: &Scenario,
    folder: Option<&Path>,
    controllers: &[Controller],
    campaign: &Campaign,
    on_run: &(dyn Fn() + Sync),
) -> Result<Vec<Comparison>, InputError> {
    let ways = scenario.trajectories.len().max(1);
    let comparisons = (0..campaign.runs as usize).into_par_iter().map(|run| {
        let seed = campaign.seed.wrapping_add(run as u64);
        let simulator = Simulator::new(scenario, folder, run % ways, Some(seed))?;
        let setup = set_up(&simulator)?.with_variant(campaign.variant, Path::new(&scenario.name))?;
        compare_once(&simulator, &setup, controllers, campaign.watched && run == 0, on_run)
    });
    comparisons.collect()
}

/// One run with every controller; `watched`, with what is drawn of it.
///
/// # Errors
/// The core refuses something, which would be a defect.
pub fn compare_once(
    simulator: &Simulator,
    setup: &Setup,
    controllers: &[Controller],
    watched: bool,
    on_run: &(dyn Fn() + Sync),
) -> Result<Comparison, InputError> {
    let channel = simulator.channel();
    let truth = Truth::new(simulator, setup);
    // The fixed carrier and the genie are what all are measured by.
    let others = controllers.iter().filter(|one| !matches!(one, Controller::Fixed | Controller::Genie));
    let asked = [Controller::Fixed].into_iter().chain(others.copied()).chain([Controller::Genie]);
    let mut watched = watched.then(|| Watched::new(channel));
    let runs = asked.map(|controller| {
        let decisions = watched.as_mut().filter(|_| controller == Controller::Cognitive);
        let decisions = decisions.map(|watched| &mut watched.decisions);
        let run = if setup.anchors.len() <= SMALL_ANCHORS {
            steer::<SMALL_ANCHORS>(simulator, setup, &truth, controller, decisions)
        } else {
            steer::<LARGE_ANCHORS>(simulator, setup, &truth, controller, decisions)
        };
        on_run();
        run
    });
    let runs: Vec<Run> = runs.collect::<Result<_, _>>()?;
    let interference = channel.scenario().interference.iter().map(|one| channel.cycles_of(one.during));
    Ok(Comparison {
        seed: channel.seed(),
        interfered: interference.reduce(|a, b| a.start.min(b.start)..a.end.max(b.end)).unwrap_or(0..0),
        onsets: onsets(channel, |actions| truth.entropies_nat(actions)),
        runs,
        watched,
    })
}

/// The set-up of the trackers of a simulation.
pub(super) fn set_up(simulator: &Simulator) -> Result<Setup, InputError> {
    let mut recording = simulator.before();
    recording.cycles.push(simulator.cycle(0, simulator.channel().receiver().first_action));
    Setup::new(&recording, Path::new(&simulator.channel().scenario().name), Some(simulator.channel().seed()))
}

/// Runs a tracker that takes its actions from a controller. Where `decisions` are given, the core's are put there.
fn steer<const A: usize>(
    simulator: &Simulator,
    setup: &Setup,
    truth: &Truth,
    controller: Controller,
    mut decisions: Option<&mut Decisions>,
) -> Result<Run, InputError> {
    let genie = match controller {
        Controller::Genie => truth.genie(),
        Controller::GeniePerAnchor => truth.genie_per_anchor(),
        _ => Vec::new(),
    };
    let mut steered = Steered::<A>::new(simulator, setup, controller, &genie)?;
    let (mut actions, mut errors_m, mut seconds) = (Vec::new(), Vec::new(), 0.0);
    for cycle in 0..simulator.cycles() {
        let SteeredCycle { actions: used, step, error_m } = steered.cycle(simulator, cycle)?;
        errors_m.push(error_m);
        seconds += step.seconds;
        actions.push(used);
        if let (Some(decisions), Some(controller)) = (&mut decisions, steered.tracker.controller_of(0)) {
            decisions.push(controller.values().values(), controller.policy(), setup.actions.len());
        }
    }
    Ok(Run {
        controller,
        entropies_nat: truth.entropies_nat(&actions),
        score: Score::new(errors_m.len(), &errors_m, seconds),
        actions,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::demo;

    #[test]
    fn the_genie_leaves_less_entropy_than_any_carrier_held() {
        let simulator = demo::seminar_room(1, 40).expect("is built in");
        let setup = set_up(&simulator).expect("is taken");
        let truth = Truth::new(&simulator, &setup);
        let mean = |actions: &[Actions]| {
            let entropies = truth.entropies_nat(actions);
            entropies.iter().sum::<f64>() / entropies.len() as f64
        };
        let genie = truth.genie();
        assert_eq!(genie.len(), truth.cycles());
        for action in 0..setup.actions.len() {
            let held = mean(&vec![vec![action]; truth.cycles()]);
            assert!(mean(&genie) < held + 1e-9, "action {action}: {held}");
        }
        let apart = truth.genie_per_anchor();
        assert!(apart.iter().all(|actions| actions.len() == setup.anchors.len()));
        assert!(mean(&apart) <= mean(&genie) + 1e-9);
    }

    #[test]
    fn the_same_seed_gives_the_same_figures_on_any_number_of_threads() {
        let (mut scenario, _) = Scenario::find("seminar-room").expect("is built in");
        for way in &mut scenario.trajectories {
            way.cycles = Some(12);
        }
        let campaign = Campaign { runs: 3, seed: 5, variant: Variant::Soft, watched: false };
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads start");
            let all = || compare(&scenario, None, &Controller::ALL, &campaign, || {}).expect("runs");
            pool.install(all)
        };
        let alone = run(1);
        assert_eq!(alone, run(3));
        assert_eq!(alone.controllers.len(), Controller::ALL.len());
    }

    /// Two channels, and gain control: what a DW3000 can do about a neighbour on channel 5, who comes later or was there before.
    #[test]
    fn a_jammed_radio_with_gain_control_goes_where_it_is_quiet_and_keeps_the_tag() {
        let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/jammed-office.toml");
        let (mut scenario, _) = Scenario::find(file).expect("is in the repository");
        for (begins, least) in [(0.3, 0.9), (0.0, 0.8)] {
            scenario.interference[0].during.0[0] = begins;
            let campaign = Campaign { runs: 1, seed: 21, variant: Variant::Soft, watched: false };
            let figures = compare(&scenario, None, &[Controller::Cognitive], &campaign, || {}).expect("runs");
            let [fixed, cognitive, _] = &figures.controllers[..] else { panic!("fixed, cognitive, genie") };
            assert!(fixed.diverged > 0 && cognitive.diverged == 0, "{figures:?}");
            assert!(cognitive.fraction_of_genie > least, "{figures:?}");
        }
    }
}
