//! The controller: which action comes next.
//!
//! Every action c has a value J(c), what it is worth beyond the present one: J <- (1 - alpha) J + alpha (r - r_present) of
//! the rewards that planning predicts for a drawn set of actions, and J <- J + beta (earned - planned) for the one
//! applied. The policy is
//! pi = softmax(J / tau) with a floor; the best action is held, and with probability epsilon one from the policy tried.

use super::Matrix;
use super::association::missed_odds;
use super::channel_memory::ChannelMemory;
use super::clock::probability;
use super::information::{PositionInformation, determinant, position_entropy_nat, range_slope};
use super::motion::{AGENT, Agent, MotionStep};
use super::pulse::Pulse;
use super::real::{Real, abs, exp, larger, limited, ln, speed_of_light, sqrt, square};
use cogmint_core::config::{ControllerSettings, Radio};
use cogmint_core::controller::policy::LEAST_TURN_CYCLES;
use cogmint_core::controller::reward::Reward;
use cogmint_core::controller::value::Learning;
use cogmint_core::model::source::Source;
use cogmint_core::radio::library::Action;
use rand_core::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro128PlusPlus;

/// Overlap of two raised-cosine spectra of roll-off 0.6 and unit width, at distances 0, 0.05, ..., 1.6.
const OVERLAP: [f32; 33] = [
    1.000000, 0.993986, 0.976321, 0.948041, 0.910646, 0.865889, 0.815576, 0.761391, 0.704763, 0.646788,
    0.588217, 0.529547, 0.471148, 0.413422, 0.356918, 0.302350, 0.250559, 0.202450, 0.158898, 0.120654,
    0.088235, 0.061831, 0.041251, 0.025979, 0.015265, 0.008232, 0.003977, 0.001657, 0.000559, 0.000136,
    0.000018, 0.000001, 0.000000,
];
/// Entries per unit of distance.
const OVERLAP_STEPS: f32 = 20.0;

/// The actions.
#[derive(Clone, Debug)]
pub struct Library<T> {
    /// Carriers and pulses, as configured.
    pub actions: Vec<Action>,
    carrier_hz: Vec<T>,
    duration_s: Vec<T>,
}

impl<T: Real> Library<T> {
    /// A library of these actions.
    pub fn new(actions: &[Action]) -> Self {
        Self {
            actions: actions.to_vec(),
            carrier_hz: actions.iter().map(|action| T::of(action.carrier_hz)).collect(),
            duration_s: actions.iter().map(|action| T::of(action.pulse_duration_s)).collect(),
        }
    }

    /// Number of actions.
    pub fn len(&self) -> usize {
        self.actions.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.actions.is_empty()
    }

    /// Carrier of an action, hertz.
    pub fn carrier_hz(&self, action: usize) -> T {
        self.carrier_hz[action]
    }

    /// The pulse of an action.
    pub fn pulse(&self, action: usize, radio: &Radio) -> Pulse<T> {
        Pulse::new(self.duration_s[action], &radio.pulse_shape).sampled_every(T::of(radio.sample_spacing_s))
    }

    /// Spectral overlap of two actions, by linear interpolation of the table over their distance in mean widths, times
    /// the narrower one's share of the wider.
    pub fn overlap(&self, a: usize, b: usize) -> T {
        let (ta, tb) = (self.duration_s[a], self.duration_s[b]);
        let width_hz = T::of(0.5) * (T::ONE / ta + T::ONE / tb);
        let position = abs(self.carrier_hz[a] - self.carrier_hz[b]) / width_hz * T::of(OVERLAP_STEPS);
        let index = position.whole() as usize;
        let entry = |i: usize| T::of(if i < OVERLAP.len() { OVERLAP[i] } else { 0.0 });
        let (low, high) = (entry(index), entry(index + 1));
        let narrower = if ta > tb { tb / ta } else { ta / larger(tb, T::of(1e-12)) };
        (low + (position - T::of_count(index)) * (high - low)) * narrower
    }
}

/// What a cycle was worth, from the agent's covariance before, after prediction and after the update.
pub fn reward<T: Real>(
    kind: Reward,
    previous: &Matrix<T>,
    predicted: &Matrix<T>,
    posterior: &Matrix<T>,
) -> T {
    let num = T::of;
    match kind {
        Reward::InformationGain => {
            let gain = position_entropy_nat(predicted) - position_entropy_nat(posterior);
            limited(gain, num(-100.0), num(100.0))
        }
        Reward::EntropyChange => {
            let change = position_entropy_nat(previous) - position_entropy_nat(posterior);
            limited(change, num(-3.0), num(3.0))
        }
        Reward::Published { scale } => {
            let change = num(scale) * (determinant(previous) - determinant(posterior));
            let change = limited(change, num(-1e37), num(1e37));
            if abs(change) < num(1e-37) {
                T::ZERO
            } else if change > T::ZERO {
                abs(ln(change))
            } else {
                -abs(ln(-change))
            }
        }
    }
}

/// J(c) <- (1 - alpha) J(c) + alpha (r + gamma sum pi J), the sum only with the bootstrap.
pub fn learn<T: Real>(values: &mut [T], action: usize, reward: T, policy: &[T], learning: &Learning) {
    let mut target = reward;
    if learning.bootstrap {
        let mut expected = T::ZERO;
        for c in 0..values.len() {
            expected += policy[c] * values[c];
        }
        target += T::of(learning.discount) * expected;
    }
    let rate = T::of(learning.rate);
    values[action] = (T::ONE - rate) * values[action] + rate * target;
}

/// The first of the best actions allowed.
pub fn best<T: Real>(values: &[T], allowed: &[usize]) -> usize {
    let mut best = allowed[0];
    for &c in allowed {
        if values[c] > values[best] {
            best = c;
        }
    }
    best
}

/// pi = softmax(J / tau) with a floor; zero for what is not allowed.
pub fn policy<T: Real>(values: &[T], allowed: &[usize], temperature: T) -> Vec<T> {
    let num = T::of;
    let most = values[best(values, allowed)];
    let mut probabilities = vec![T::ZERO; values.len()];
    let mut sum = T::ZERO;
    for &c in allowed {
        probabilities[c] = exp((values[c] - most) / temperature);
        sum += probabilities[c];
    }
    let floor = num(1e-3) / larger(T::of_count(allowed.len()), T::ONE);
    let scale = (T::ONE - num(1e-3)) / larger(sum, num(1e-30));
    for &c in allowed {
        probabilities[c] = probabilities[c] * scale + floor;
    }
    probabilities
}

/// Uniform in (0, 1]; exact in either precision.
pub fn uniform<T: Real>(rng: &mut impl Rng) -> T {
    T::of_count((rng.next_u32() >> 8) as usize + 1) / T::of(16_777_216.0)
}

/// `wanted` actions drawn without replacement, half from the policy and half from all alike, those in `keep` first: the
/// smallest -ln(u) / (pi + 1 / count) win.
pub fn planned_set<T: Real>(
    policy: &[T],
    allowed: &[usize],
    wanted: usize,
    keep: [usize; 2],
    rng: &mut impl Rng,
) -> Vec<usize> {
    let any = T::ONE / T::of_count(allowed.len());
    let mut arrivals = Vec::new();
    for &c in allowed {
        // Order: an action that is kept draws its number all the same.
        let time = -ln(uniform::<T>(rng)) / (policy[c] + any);
        arrivals.push((c, if keep.contains(&c) { T::of(-1.0) } else { time }));
    }
    let mut chosen = Vec::new();
    // Both actions to keep fit in any case.
    while chosen.len() < wanted.max(keep.len()) && !arrivals.is_empty() {
        let mut earliest = 0;
        for place in 1..arrivals.len() {
            if arrivals[place].1 < arrivals[earliest].1 {
                earliest = place;
            }
        }
        chosen.push(arrivals.remove(earliest).0);
    }
    chosen.sort_unstable();
    chosen
}

/// An action drawn from the policy; none where rounding leaves a rest.
pub fn draw<T: Real>(policy: &[T], allowed: &[usize], rng: &mut impl Rng) -> Option<usize> {
    let mut left = uniform::<T>(rng);
    allowed.iter().copied().find(|&c| {
        left -= policy[c];
        left <= T::ZERO
    })
}

/// Any of the actions allowed but `one`; none where there is no other.
pub fn draw_other(allowed: &[usize], one: usize, rng: &mut impl Rng) -> Option<usize> {
    // Order: the number is drawn in any case.
    let number = rng.next_u32() as usize;
    let others: Vec<usize> = allowed.iter().copied().filter(|c| *c != one).collect();
    if others.is_empty() { None } else { Some(others[number % others.len()]) }
}

/// A source that planning counts on.
#[derive(Clone, Copy, Debug)]
pub struct Visible<T> {
    /// Which one.
    pub source: Source,
    /// Position, metres.
    pub position_m: [T; 2],
    /// Height above the tag, metres.
    pub height_m: T,
    /// Covariance of its position, square metres.
    pub covariance_m2: [[T; 2]; 2],
    /// Probability that the plan lets its path through.
    pub availability: T,
}

/// Where planning starts from.
#[derive(Clone, Debug)]
pub struct Outlook<T> {
    /// Position of the tag, metres.
    pub position_m: [T; 2],
    /// Velocity, m/s.
    pub velocity_m_s: [T; 2],
    /// Covariance of both.
    pub covariance: Matrix<T>,
    /// Length of a cycle, seconds.
    pub elapsed_s: T,
    /// The motion in a cycle.
    pub step: MotionStep<T>,
    /// Factor on range variances.
    pub variance_inflation: T,
    /// Least standard deviation of a range, metres.
    pub range_floor_m: T,
    /// What comes on top for paths, pulse lengths.
    pub range_floor_pulses: T,
    /// The radio.
    pub radio: Radio,
    /// Threshold on the normalised energy of a path.
    pub threshold: T,
}

/// How far and by what planning judges.
#[derive(Clone, Copy, Debug)]
pub struct Horizon {
    /// Steps ahead.
    pub steps: usize,
    /// Discount per step.
    pub discount: f32,
    /// The reward.
    pub reward: Reward,
}

/// What a choice depends on.
pub struct Prospect<'a, T> {
    /// Where the tag is.
    pub outlook: &'a Outlook<T>,
    /// The sources received with the action to choose.
    pub own: Vec<Visible<T>>,
    /// All others, with the action each is received with.
    pub others: Vec<(Visible<T>, usize)>,
    /// How well sources are heard.
    pub memory: &'a ChannelMemory<T>,
    /// The actions.
    pub library: &'a Library<T>,
}

impl<T: Real> Prospect<'_, T> {
    /// What holding one action over the horizon would earn: the discounted mean of its rewards.
    ///
    /// At step l the tag is expected where the motion carries it; every visible source adds the information of one range, of
    /// the variance that its remembered SINR allows plus its own uncertainty along the line of sight.
    fn plan_one(&self, action: usize, horizon: &Horizon) -> T {
        let outlook = self.outlook;
        let mut covariance = outlook.covariance.clone();
        let mut total = T::ZERO;
        let mut weight = T::ONE;
        let mut weights = T::ZERO;
        for ahead in 1..=horizon.steps {
            let mut information = PositionInformation::none();
            for (source, theirs) in &self.others {
                self.tell(&mut information, source, *theirs, ahead);
            }
            for source in &self.own {
                self.tell(&mut information, source, action, ahead);
            }
            let agent = Agent { mean: vec![T::ZERO; AGENT], covariance };
            let predicted = outlook.step.predicted(&agent).covariance;
            let posterior = information.posterior(&predicted);
            total += weight * reward(horizon.reward, &agent.covariance, &predicted, &posterior);
            weights += weight;
            weight *= T::of(horizon.discount);
            covariance = posterior;
        }
        total / larger(weights, T::of(1e-6))
    }

    /// Adds what a source tells with an action, so many steps ahead.
    fn tell(
        &self,
        information: &mut PositionInformation<T>,
        source: &Visible<T>,
        action: usize,
        ahead: usize,
    ) {
        let (outlook, memory) = (self.outlook, self.memory);
        let pulse = self.library.pulse(action, &outlook.radio);
        // Order: the variance at SINR 1, inflated, divided by the SINR.
        let unit = outlook.variance_inflation * pulse.range_variance_m2(T::ONE);
        // Order: relative to the source, step by step.
        let [mut d, mut v] = [outlook.position_m, outlook.velocity_m_s];
        for axis in 0..2 {
            d[axis] -= source.position_m[axis];
            for _ in 0..ahead {
                d[axis] += outlook.step.drift_s * v[axis];
                v[axis] *= outlook.step.decay;
            }
        }
        let slope = range_slope(d, source.height_m);
        let [ux, uy] = slope;
        let c = &source.covariance_m2;
        let map = square(ux) * c[0][0] + T::of(2.0) * (ux * uy) * c[1][0] + square(uy) * c[1][1];
        // P_d / (unit / SINR + rest), with one division.
        let root = exp(T::of(0.5) * memory.sinr_ln(source.source, action));
        let sinr = square(root);
        let found = memory.visibility(source.source)[0] * source.availability * sinr;
        let odds = T::ONE + missed_odds(root, sqrt(larger(outlook.threshold, T::ZERO)));
        let rest = square(outlook.range_floor_m) + map;
        let unresolved = square(outlook.range_floor_pulses * (pulse.duration_s * speed_of_light::<T>()));
        information.add_weighted(slope, found / (odds * (unit + (rest + unresolved) * sinr)));
    }
}

/// How a cycle went, for a controller.
#[derive(Clone, Copy, Debug)]
pub struct Outcome<T> {
    /// The action received with.
    pub applied: usize,
    /// Its reward, where that says something of it.
    pub earned: Option<T>,
    /// Whether anything was received.
    pub heard: bool,
    /// How long it was, seconds.
    pub elapsed_s: T,
    /// Whether the tag is looked for.
    pub lost: bool,
    /// Whether one of several anchors has to be met at the rendezvous.
    pub called: bool,
}

/// The choice for one anchor, or for all.
#[derive(Clone, Debug)]
pub struct Controller<T> {
    settings: ControllerSettings,
    seed: u64,
    allowed: Vec<usize>,
    /// Action values J.
    pub values: Vec<T>,
    /// Policy pi.
    pub policy: Vec<T>,
    /// The action held.
    pub held: usize,
    /// The action chosen: the one held, or one that is tried.
    pub chosen: usize,
    /// What that was planned to earn; none where it was not planned.
    pub planned_reward: Option<T>,
    /// Cycles of the present turn of a search that count.
    pub turn_cycles: u32,
    /// Their seconds.
    pub turn_s: T,
    /// The action it is looked for with in place of the one held.
    pub sought_with: Option<usize>,
    /// The present action.
    pub action: usize,
    /// The action that the next frame announces.
    pub announced: usize,
    /// Cycles in a row in which nothing was received.
    pub silent_cycles: u32,
}

impl<T: Real> Controller<T> {
    /// One that may choose any of the library's actions, and holds the first of its settings; `capacity` numbers are kept.
    pub fn new(settings: ControllerSettings, library: &Library<T>, capacity: usize, seed: u64) -> Self {
        let allowed: Vec<usize> = (0..library.len()).collect();
        let values = vec![T::ZERO; capacity];
        let first = settings.first_action;
        Self {
            settings,
            seed,
            policy: policy(&values, &allowed, T::of(settings.choice.temperature_nat)),
            allowed,
            values,
            held: first,
            chosen: first,
            planned_reward: None,
            turn_cycles: 0,
            turn_s: T::ZERO,
            sought_with: None,
            action: first,
            announced: first,
            silent_cycles: 0,
        }
    }

    /// Learns from cycle number `cycle` and chooses the action of the next.
    pub fn decide(&mut self, cycle: u32, outcome: &Outcome<T>, prospect: &Prospect<'_, T>) {
        self.choose(cycle, outcome, prospect);
        self.agree(outcome);
    }

    fn choose(&mut self, cycle: u32, outcome: &Outcome<T>, prospect: &Prospect<'_, T>) {
        let settings = self.settings;
        let temperature = T::of(settings.choice.temperature_nat);
        // One generator per cycle, from seed and cycle number.
        let mixed = self.seed ^ u64::from(cycle).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        let mut rng = Xoshiro128PlusPlus::seed_from_u64(mixed);

        // The tag looked for, or nothing heard, or another action than chosen: nothing to learn from.
        if let (Some(earned), Some(planned), true) =
            (outcome.earned, self.planned_reward, outcome.applied == self.chosen)
        {
            self.values[self.chosen] += T::of(settings.learning.experience_rate) * (earned - planned);
        }
        if !outcome.lost {
            // Found, and with it?
            if outcome.heard && self.sought_with == Some(outcome.applied) {
                self.held = outcome.applied;
            }
            self.sought_with = None;
        }
        self.policy = policy(&self.values, &self.allowed, temperature);
        if settings.planned_actions == 0 || self.allowed.len() < 2 {
            return;
        }
        let present = self.held;
        let keep = [present, best(&self.values, &self.allowed)];
        let planned = planned_set(&self.policy, &self.allowed, settings.planned_actions, keep, &mut rng);
        let horizon = Horizon {
            steps: settings.horizon,
            discount: settings.learning.discount,
            reward: settings.reward,
        };
        let mut rewards = vec![None; self.values.len()];
        for &action in &planned {
            rewards[action] = Some(prospect.plan_one(action, &horizon));
        }
        let standard = rewards[present].unwrap_or(T::ZERO);
        for &action in &planned {
            if let Some(worth) = rewards[action] {
                learn(&mut self.values, action, worth - standard, &self.policy, &settings.learning);
            }
        }
        self.policy = policy(&self.values, &self.allowed, temperature);
        let hysteresis = T::of(settings.choice.hysteresis_nat);
        let favourite = best(&self.values, &self.allowed);
        // Nothing is judged while another is sought with.
        if self.sought_with.is_none() && self.values[favourite] > self.values[present] + hysteresis {
            self.held = favourite;
        }
        let standard = self.values[self.held];
        for &c in &self.allowed {
            self.values[c] -= standard;
        }
        let exploration = probability(settings.choice.exploration_per_s, outcome.elapsed_s);
        let tries = uniform::<T>(&mut rng) <= exploration;
        let tried = if tries { draw(&self.policy, &self.allowed, &mut rng) } else { None };
        if !outcome.lost {
            (self.turn_cycles, self.turn_s) = (0, T::ZERO);
        }
        let patience_s = T::of(settings.choice.patience_s);
        let counts = outcome.heard || self.sought_with.is_some();
        if outcome.lost && counts && patience_s > T::ZERO {
            self.turn_cycles += 1;
            self.turn_s += outcome.elapsed_s;
            if self.turn_cycles >= LEAST_TURN_CYCLES && self.turn_s >= patience_s {
                (self.turn_cycles, self.turn_s) = (0, T::ZERO);
                // By turns the one held and another.
                self.sought_with = if self.sought_with.is_some() {
                    None
                } else {
                    draw_other(&self.allowed, self.held, &mut rng)
                };
            }
        }
        self.chosen = self.sought_with.or(tried).unwrap_or(self.held);
        self.planned_reward = rewards[self.chosen];
    }

    /// The action that both ends use next: the one chosen, or where there is a rendezvous, the one announced a cycle ago.
    fn agree(&mut self, outcome: &Outcome<T>) {
        let Some(rendezvous) = self.settings.rendezvous else {
            self.action = self.chosen;
            return;
        };
        if outcome.heard {
            self.silent_cycles = 0;
            self.action = self.announced;
            self.announced = if outcome.called { rendezvous } else { self.chosen };
        } else {
            self.silent_cycles = self.silent_cycles.saturating_add(1);
            if self.silent_cycles >= 3 {
                self.action = rendezvous;
                self.announced = rendezvous;
            }
        }
    }

    /// The core's `Controller::words`: without a rendezvous nothing is announced and nobody counts.
    pub fn words(&self) -> [u32; 7] {
        let [held, chosen] = [self.held, self.chosen].map(|action| action as u32);
        let hop = match self.settings.rendezvous {
            None => [chosen, 0, 0],
            Some(_) => [self.action as u32, self.announced as u32, self.silent_cycles],
        };
        let sought_with = match self.sought_with {
            None => 0,
            Some(action) => action as u32 + 1,
        };
        [held, chosen, hop[0], hop[1], hop[2], self.turn_cycles, sought_with]
    }
}
