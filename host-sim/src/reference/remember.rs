//! What the memories keep of a cycle: existence, how well sources are heard, and how much nothing explained.

use super::association::Belief;
use super::association::outcome::Outcome;
use super::availability::{WallNow, crossing};
use super::channel_memory::{ChannelMemory, Received, jump};
use super::clutter::ClutterMemory;
use super::controllers::Controllers;
use super::environment::{EnvironmentMemory, Look};
use super::known::{Place, Told};
use super::lateness::LatenessMemory;
use super::real::{Real, larger};
use super::receiver::{Receiver, Scan};
use super::transmission::TransmissionMemory;
use cogmint_core::model::source::Source;

/// The memories.
pub struct Memories<'a, T> {
    /// Which surfaces exist.
    pub environment: &'a mut EnvironmentMemory<T>,
    /// How well sources are heard.
    pub channel: &'a mut ChannelMemory<T>,
    /// What nothing explains.
    pub clutter: &'a mut ClutterMemory<T>,
    /// How late ranges are.
    pub lateness: &'a mut LatenessMemory<T>,
}

impl<T: Real> Memories<'_, T> {
    /// Enters the scans of a cycle.
    pub fn remember(
        &mut self,
        told: &Told<'_, T>,
        out: &[bool],
        (is_searching, is_sure): (bool, bool),
        receiver: &mut Receiver<T>,
        controllers: &Controllers<T>,
        outcomes: &[Outcome<T>],
    ) {
        if !is_searching {
            self.unmask(told, out, receiver, controllers, outcomes);
        }
        for outcome in outcomes {
            let scan = &outcome.scan;
            let received = received(self.channel, told, outcome);
            // From a doubtful place, what is missing may well be there.
            if !is_sure {
                // What waits for the tag is not compared.
                if receiver.gain_control[scan.anchor].waiting_with().is_none() {
                    self.remember_noise(outcome, &received);
                }
            } else {
                self.remember_sources(outcome, &received);
                for (timing, probability) in outcome.timings() {
                    self.lateness.remember(scan.anchor, &timing, probability);
                }
            }
            if !is_searching {
                self.clutter.remember(scan.anchor, outcome.unexplained(), scan.elapsed_s);
            }
        }
    }

    /// The tag was found: what gain control hid until another action was tried is charged to the one held.
    fn unmask(
        &mut self,
        told: &Told<'_, T>,
        out: &[bool],
        receiver: &mut Receiver<T>,
        controllers: &Controllers<T>,
        outcomes: &[Outcome<T>],
    ) {
        for Outcome { scan, .. } in outcomes {
            if scan.frame.is_none() || out[scan.anchor] {
                continue;
            }
            let Some(excess_ln) = receiver.gain_control[scan.anchor].found() else { continue };
            let mut shares = self.channel.shares(controllers.of(scan.anchor).held, told.library);
            shares[scan.action] = T::ZERO;
            for source in self.environment.sources_of(scan.anchor) {
                self.channel.unmask(source, &shares, excess_ln);
            }
        }
    }

    /// The noise of a frame, for every source, where association means nothing.
    fn remember_noise(&mut self, outcome: &Outcome<T>, received: &Received<T>) {
        let scan = &outcome.scan;
        for expected in &outcome.expected {
            let range_m = expected.regression.range_m;
            if let Some(level) = scan.level(range_m) {
                self.channel.remember_noise(expected.regression.source, received, [range_m, level]);
            }
        }
        if scan.frame.is_some() {
            self.channel.remember_frame(scan.anchor, received);
        }
    }

    /// Every source: whether it is there, its paths, the noise, and whether it was missed.
    fn remember_sources(&mut self, outcome: &Outcome<T>, received: &Received<T>) {
        let scan = &outcome.scan;
        for (expected, belief) in outcome.expected.iter().zip(&outcome.beliefs.features) {
            let (source, range_m) = (expected.regression.source, expected.regression.range_m);
            if let Source::Virtual { slot, .. } = source {
                let look = Look {
                    prior: expected.feature.existence,
                    posterior: belief.existence,
                    seen: belief.missed < T::of(0.5),
                    sighting: expected.sighting,
                    lasting: expected.lasting,
                };
                self.environment.remember(slot, &look, scan.elapsed_s);
            }
            if let Some(level) = scan.level(range_m) {
                for m in own_paths(scan, belief) {
                    self.channel.remember(source, received, &scan.measurements[m], belief.associated[m]);
                }
                self.channel.remember_noise(source, received, [range_m, level]);
            }
            if scan.frame.is_none() || self.channel.has_seen(source) {
                self.channel.remember_missed(source, expected.found, belief.missed, belief.rest);
            } else {
                self.channel.remember_unseen(source, belief.missed, belief.rest);
            }
        }
        if scan.frame.is_some() {
            self.channel.remember_frame(scan.anchor, received);
        }
    }
}

/// What direct paths tell of the walls that they cross, the tag being where it is.
pub fn look_through<T: Real>(
    transmission: &mut TransmissionMemory<T>,
    told: &Told<'_, T>,
    walls: &[WallNow<T>],
    place: &Place<T>,
    outcomes: &[Outcome<T>],
) {
    for Outcome { scan, beliefs, .. } in outcomes {
        let anchor_m = told.sight(scan.anchor).anchor_m;
        let crossing = crossing(walls, anchor_m, place.position_m, place.std_m);
        transmission.remember(crossing, T::ONE - beliefs.features[0].missed, scan.elapsed_s);
    }
}

/// A frame as the channel memory takes it: whether the mean change of the noise is a jump.
fn received<T: Real>(channel: &ChannelMemory<T>, told: &Told<'_, T>, outcome: &Outcome<T>) -> Received<T> {
    let Outcome { scan, expected, .. } = outcome;
    let action = scan.action;
    let (mut noise, mut count) = (T::ZERO, T::ZERO);
    for expected in expected {
        let level = scan.level(expected.regression.range_m);
        if let Some(level) = level
            && let Some(change) = channel.noise_change(expected.regression.source, action, level)
        {
            noise += change;
            count += T::ONE;
        }
    }
    let shares = channel.shares(action, told.library);
    let elapsed_s = scan.frame.as_ref().map_or(T::ZERO, |frame| frame.elapsed_s);
    Received { action, elapsed_s, shares, jump: jump(noise / larger(count, T::ONE)) }
}

/// Indices of the measurements that are probably a feature's, and come from a frame.
fn own_paths<T: Real>(scan: &Scan<T>, belief: &Belief<T>) -> Vec<usize> {
    (0..scan.measurements.len())
        .filter(|&m| belief.associated[m] > T::of(0.5) && scan.measurements[m].sinr > T::ZERO)
        .collect()
}
