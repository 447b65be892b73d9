//! What is kept of one run to be drawn: the carriers, who else is on the air, what the core's controller thought.

use crate::channel::Channel;
use crate::scenario::Interference;
use std::ops::Range;

/// A run, as far as it is drawn.
#[derive(Clone, Debug, PartialEq)]
pub struct Watched {
    /// Carrier per action, hertz.
    pub carriers_hz: Vec<f64>,
    /// Pulse duration per action, seconds.
    pub pulse_durations_s: Vec<f64>,
    /// The interferers.
    pub occupied: Vec<Occupied>,
    /// What the core's controller thought; nothing where it did not run.
    pub decisions: Decisions,
}

impl Watched {
    /// The carriers and interferers of a channel.
    pub fn new(channel: &Channel) -> Self {
        let actions = &channel.receiver().actions;
        let occupied =
            |one: &Interference| Occupied { cycles: channel.cycles_of(one.during), ..Occupied::of(one) };
        Self {
            carriers_hz: actions.iter().map(|action| action.carrier_hz).collect(),
            pulse_durations_s: actions.iter().map(|action| action.pulse_duration_s).collect(),
            occupied: channel.scenario().interference.iter().map(occupied).collect(),
            decisions: Decisions::default(),
        }
    }
}

/// The cycles and frequencies that an interferer takes up.
#[derive(Clone, Debug, PartialEq)]
pub struct Occupied {
    /// Its cycles.
    pub cycles: Range<usize>,
    /// Where its power density has fallen to half, hertz, the lower one first.
    pub half_power_hz: [f64; 2],
    /// Where it has fallen to nothing, hertz, the lower one first.
    pub all_hz: [f64; 2],
}

impl Occupied {
    /// The frequencies of an interferer, in no cycle yet: those of a raised cosine.
    fn of(interferer: &Interference) -> Self {
        let half_hz = 0.5 / interferer.pulse_duration_s;
        let around = |half_hz: f64| [interferer.carrier_hz - half_hz, interferer.carrier_hz + half_hz];
        Self {
            cycles: 0..0,
            half_power_hz: around(half_hz),
            all_hz: around((1.0 + interferer.roll_off) * half_hz),
        }
    }
}

/// What the core's controller thought after every cycle, when it chose for the next one.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Decisions {
    /// Action values relative to the action chosen, nats, per cycle and action.
    pub values_nat: Vec<Vec<f32>>,
    /// Probabilities of the policy, per cycle and action.
    pub policies: Vec<Vec<f32>>,
}

impl Decisions {
    /// Puts down the values and the policy that a controller of `actions` actions has come to.
    pub fn push(&mut self, values_nat: &[f32], policy: &[f32], actions: usize) {
        self.values_nat.push(values_nat.iter().copied().take(actions).collect());
        self.policies.push(policy.iter().copied().take(actions).collect());
    }
}
