//! Channel memory: the SINR of every source (direct path or virtual anchor) at every action.
//!
//! What belongs to the place is kept apart from what belongs to the carrier. Per source: its energy (distance-compensated,
//! |alpha|^2 d^2) and the level of noise and dense multipath where its path arrives; both change as the tag moves, for all
//! actions alike, and are followed whichever is heard. Per source and action: by how much the noise exceeds that level there,
//! which is interference. So when the tag walks behind something, no other carrier is expected to do better, and when an
//! interferer comes, those are that it is not known to reach.
//!
//! Which of the two has changed is told by the sources together: noise that comes suddenly and to all of an anchor's
//! sources is interference; what comes slowly is the place, up to a limit beyond which it is interference as well. Noise
//! heard with an action that was hardly used tells of that action; with a familiar one, of the place. Actions also tell of
//! their spectral neighbours, in proportion to the fourth power of the overlap rho of the two pulses' spectra, and by
//! Friis's law a path loses as the carrier squared: energies are compared at the carrier of the first action.
//!
//! A path that was not found although the frame's own noise let it is hidden: visibility is the state of a two-state Markov
//! chain, in scans of ranges likewise. While the tag is lost, the frames' noise alone is remembered: a radio that an interferer
//! has silenced must learn to go elsewhere. (Under gain control, not that of an action which it is sought with, before it is
//! found.)
//!
//! The published estimator, moments of the last 40 amplitudes, is not used: amplitudes that differ between carriers and
//! places count as noise there, and after a few changes of the carrier it takes strong paths for lost ones.

mod observe;

use crate::memory::clutter::WALK_PER_S;
use crate::model::channel::{ChannelKnowledge, ChannelPrior};
use crate::model::clock::{gain, probability};
use crate::model::measurement::Measurement;
use crate::model::source::Source;
use crate::radio::library::Library;
use crate::real::{abs, exp, is_probability, larger, limited, ln, smaller};
use crate::snapshot::{stored, written};

/// How the channel memory follows what it hears.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ChannelMemorySettings {
    /// How fast frames heard and interference are forgotten, per second (0 to 10). More: a carrier that was left is tried again
    /// sooner. Less: known interference is avoided longer. Between the 0.005 and 0.05 that suited cycles of 1 and 0.1 s.
    pub forgetting_per_s: f32,
    /// How fast the energy of a source changes, as the variance of its walk per second over that of one frame (0 to 100). More
    /// follows a moving tag faster and averages less. Chosen so that at 10 Hz 15 % of a deviation is followed.
    pub energy_walk_per_s: f32,
    /// The same of the noise where its path arrives (0 to 100): 20 % at 10 Hz.
    pub noise_walk_per_s: f32,
    /// How far the place alone raises noise above the usual, as ln (0 to 10): what goes on rising beyond that, however slowly, is
    /// interference. Chosen on development rooms.
    pub place_ln: f32,
    /// How often a source hides, or comes out, per second (0 to 10). More: misses are taken for hiding, and a path that was
    /// missed is expected again sooner. Between the 0.02 and 0.2 that suited cycles of 1 and 0.1 s.
    pub hiding_per_s: f32,
}

impl ChannelMemorySettings {
    /// Those of a tracker that is not started.
    pub(crate) const NONE: Self = Self {
        forgetting_per_s: 0.0,
        energy_walk_per_s: 0.0,
        noise_walk_per_s: 0.0,
        place_ln: 0.0,
        hiding_per_s: 0.0,
    };
}

impl Default for ChannelMemorySettings {
    fn default() -> Self {
        Self {
            forgetting_per_s: 0.02,
            energy_walk_per_s: 0.26,
            noise_walk_per_s: 0.5,
            place_ln: 0.7,
            hiding_per_s: 0.1,
        }
    }
}

/// Mathematics: how fast the usual noise falls, as the variance of its walk per second over that of one frame: as fast as the
/// surroundings change that clutter comes from.
pub const USUAL_FALL_PER_S: f32 = WALK_PER_S;
/// Tuned: the same, rising: 1 % at 10 Hz.
pub const USUAL_RISE_PER_S: f32 = 0.001;
/// Tuned: the same of the excess of noise at a familiar action: 3 % at 10 Hz. More blames the carrier for what changes slowly.
pub const EXCESS_WALK_PER_S: f32 = 0.01;
/// Tuned: how much faster the excess of an action never heard before follows.
pub const EXCESS_NEWS: f32 = 0.5;
/// Tuned: how fast that of any action follows when interference comes or goes.
pub const EXCESS_JUMP: f32 = 0.6;
/// Tuned: mean change of an anchor's noise, as ln, from which on it is interference in part.
pub const JUMP_LN: f32 = 0.6;
/// Tuned: over which it becomes so as a whole.
pub const JUMP_WIDTH_LN: f32 = 0.4;
/// Guard: against overflow: bounds of ln SINR (1e-3 to 1e12).
pub const LEAST_SINR_LN: f32 = -6.9;
/// Guard: the upper one.
pub const MOST_SINR_LN: f32 = 27.6;

/// Guard: against overflow: most that ln of an energy is raised to (1e30).
pub const MOST_ENERGY_LN: f32 = 69.0;

/// How much a sample at one action tells of every action: 1 at its own, 0 to 1 at the others.
pub type Shares<const ACTIONS: usize> = [f32; ACTIONS];

/// How far noise has changed because interference came or went, 0 to 1, where it deviates from what was expected by this
/// mean over the sources, as ln.
pub fn jump(noise_ln: f32) -> f32 {
    limited((abs(noise_ln) - JUMP_LN) / JUMP_WIDTH_LN, 0.0, 1.0)
}

/// What is known of one source.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Row<const ACTIONS: usize> {
    /// Paths that the energy rests on; 0 until the source is seen.
    paths: f32,
    /// Mean of ln energy, at the reference carrier and one metre.
    energy_ln: f32,
    /// ln of the square of its distance in the last frame, metres.
    spread_ln: f32,
    /// Probability that nothing hides the source.
    visibility: f32,
    /// Probability that nothing has hidden it since it was last seen.
    lasting: f32,
    /// Probability that its path is there although no frame has shown it.
    unseen: f32,
    /// ln of the level of noise where its path arrives, without interference; `None` before the first frame.
    noise_ln: Option<f32>,
    /// Slow mean of that.
    usual_ln: f32,
    /// By how much noise exceeds `noise_ln` at an action, as ln: interference.
    excess_ln: [f32; ACTIONS],
}

impl<const ACTIONS: usize> Default for Row<ACTIONS> {
    fn default() -> Self {
        Self {
            paths: 0.0,
            energy_ln: 0.0,
            spread_ln: 0.0,
            visibility: 1.0,
            lasting: 1.0,
            unseen: 0.5,
            noise_ln: None,
            usual_ln: 0.0,
            excess_ln: [0.0; ACTIONS],
        }
    }
}

impl<const ACTIONS: usize> Row<ACTIONS> {
    /// Of a memory that is not started.
    const NONE: Self = Self {
        paths: 0.0,
        energy_ln: 0.0,
        spread_ln: 0.0,
        visibility: 0.0,
        lasting: 0.0,
        unseen: 0.0,
        noise_ln: None,
        usual_ln: 0.0,
        excess_ln: [0.0; ACTIONS],
    };

    fn is_seen(&self) -> bool {
        self.paths > 0.0
    }

    fn excess_ln(&self, action: usize) -> f32 {
        self.excess_ln.get(action).copied().unwrap_or(0.0)
    }
}

/// SINR of `ANCHORS` direct paths and `SOURCES` virtual anchors at `ACTIONS` actions.
#[derive(Clone, Debug)]
pub struct ChannelMemory<const ANCHORS: usize, const SOURCES: usize, const ACTIONS: usize> {
    direct: [Row<ACTIONS>; ANCHORS],
    virtual_anchors: [Row<ACTIONS>; SOURCES],
    /// Effective number of frames of an anchor at an action, neighbours and age counted in.
    heard: [[f32; ACTIONS]; ANCHORS],
    settings: ChannelMemorySettings,
    prior_ln: f32,
    neighbours: bool,
    full_band: bool,
    /// ln of the power lost to the reference carrier, by action.
    loss_ln: [f32; ACTIONS],
}

impl<const ANCHORS: usize, const SOURCES: usize, const ACTIONS: usize>
    ChannelMemory<ANCHORS, SOURCES, ACTIONS>
{
    /// An empty memory. `prior_sinr` (linear) is assumed of sources never seen, at the carrier of the first action;
    /// with `neighbours`, actions tell of those whose spectra they overlap.
    pub fn new(
        settings: ChannelMemorySettings,
        prior_sinr: f32,
        neighbours: bool,
        library: &Library<ACTIONS>,
    ) -> Self {
        let mut own = Self::empty();
        own.start(settings, prior_sinr, neighbours, library);
        own
    }

    /// Not even a prior: to be started.
    pub const fn empty() -> Self {
        Self {
            direct: [Row::NONE; ANCHORS],
            virtual_anchors: [Row::NONE; SOURCES],
            heard: [[0.0; ACTIONS]; ANCHORS],
            settings: ChannelMemorySettings::NONE,
            prior_ln: 0.0,
            neighbours: false,
            full_band: false,
            loss_ln: [0.0; ACTIONS],
        }
    }

    /// As [`Self::new`], where it stays.
    pub fn start(
        &mut self,
        settings: ChannelMemorySettings,
        prior_sinr: f32,
        neighbours: bool,
        library: &Library<ACTIONS>,
    ) {
        self.settings = settings;
        self.prior_ln = ln(prior_sinr);
        self.neighbours = neighbours;
        self.full_band = false;
        self.direct.iter_mut().chain(&mut self.virtual_anchors).for_each(|row| *row = Row::default());
        self.heard.iter_mut().flatten().for_each(|heard| *heard = 0.0);
        let reference_hz = library.get(0).map_or(1.0, |first| first.carrier_hz);
        for (action, loss) in self.loss_ln.iter_mut().enumerate() {
            *loss = library.get(action).map_or(0.0, |entry| 2.0 * ln(entry.carrier_hz / reference_hz));
        }
    }

    /// Without a prior again.
    pub fn clear(&mut self) {
        self.direct.iter_mut().chain(&mut self.virtual_anchors).for_each(|row| *row = Row::NONE);
        self.heard.iter_mut().flatten().for_each(|heard| *heard = 0.0);
        self.loss_ln = [0.0; ACTIONS];
        self.settings = ChannelMemorySettings::NONE;
        (self.prior_ln, self.neighbours, self.full_band) = (0.0, false, false);
    }

    fn row(&self, source: Source) -> Option<&Row<ACTIONS>> {
        match source {
            Source::Direct { anchor } => self.direct.get(anchor),
            Source::Virtual { slot, .. } => self.virtual_anchors.get(slot),
        }
    }

    fn row_mut(&mut self, source: Source) -> Option<&mut Row<ACTIONS>> {
        match source {
            Source::Direct { anchor } => self.direct.get_mut(anchor),
            Source::Virtual { slot, .. } => self.virtual_anchors.get_mut(slot),
        }
    }

    /// ln of the power lost to the carrier of the first action (Friis).
    pub fn loss_ln(&self, action: usize) -> f32 {
        self.loss_ln.get(action).copied().unwrap_or(0.0)
    }

    /// How unfamiliar an action of an anchor is: 1 to 0.
    fn news(&self, anchor: usize, action: usize) -> f32 {
        1.0 / (1.0 + self.frames(anchor, action))
    }

    /// What `action` tells of every action of the library.
    pub fn shares(&self, action: usize, library: &Library<ACTIONS>) -> Shares<ACTIONS> {
        let mut shares = [0.0; ACTIONS];
        for (other, share) in shares.iter_mut().enumerate().take(library.len()) {
            let overlap = library.overlap(action, other);
            let squared = overlap * overlap;
            *share = if self.neighbours || other == action { squared * squared } else { 0.0 };
        }
        shares
    }

    /// Time passes: counts of frames are forgotten, and what was visible may have gone behind something, or come out.
    pub fn predict(&mut self, elapsed_s: f32) {
        // A symmetric two-state chain forgets its state at twice the rate at which it turns.
        let turned = 0.5 * probability(2.0 * self.settings.hiding_per_s, elapsed_s);
        let kept = 1.0 - probability(self.settings.forgetting_per_s, elapsed_s);
        for row in self.direct.iter_mut().chain(&mut self.virtual_anchors) {
            row.visibility += turned * (1.0 - 2.0 * row.visibility);
            row.lasting *= 1.0 - turned;
            row.unseen += turned * (1.0 - 2.0 * row.unseen);
        }
        for count in self.heard.iter_mut().flatten() {
            *count *= kept;
        }
    }

    /// ln of the level of noise in a frame received with `action` where the path of `source` arrives, over that expected;
    /// `None` if none was ever received.
    pub fn noise_innovation_ln(&self, source: Source, action: usize, level: f32) -> Option<f32> {
        let row = self.row(source)?;
        Some(level_ln(level) - (row.noise_ln? + row.excess_ln(action)))
    }

    /// ln of a path's energy, at the reference carrier and one metre.
    fn compensated_ln(&self, action: usize, path: &Measurement) -> f32 {
        level_ln(path.energy * (path.range_m * path.range_m)) + self.loss_ln(action)
    }

    /// Enters the level of noise in a frame received with `action`, whose `shares` these are, where the path of `source`
    /// arrives if it is `range_m` long, `elapsed_s` seconds after the last; `jump` is [`jump`].
    pub fn remember_noise(
        &mut self,
        source: Source,
        action: usize,
        shares: &Shares<ACTIONS>,
        (range_m, level): (f32, f32),
        jump: f32,
        elapsed_s: f32,
    ) {
        if self.full_band {
            return;
        }
        let level_ln = level_ln(level);
        let settings = self.settings;
        let news = self.news(source.anchor(), action);
        // A virtual anchor begins with what disturbs the direct path of its anchor.
        let excess_ln = self.direct.get(source.anchor()).map_or([0.0; ACTIONS], |direct| direct.excess_ln);
        let Some(row) = self.row_mut(source) else { return };
        row.spread_ln = ln(larger(range_m * range_m, 1e-6));
        let noise_ln = match row.noise_ln {
            Some(noise_ln) => noise_ln,
            None => {
                row.excess_ln = excess_ln;
                row.usual_ln = level_ln - row.excess_ln(action);
                row.usual_ln
            }
        };
        let innovation = level_ln - (noise_ln + row.excess_ln(action));
        let rate = larger(EXCESS_JUMP * jump, gain(EXCESS_WALK_PER_S, elapsed_s) + EXCESS_NEWS * news);
        let noise_ln = noise_ln
            + gain(settings.noise_walk_per_s, elapsed_s) * (1.0 - jump) * ((1.0 - rate) * innovation);
        let above = larger(noise_ln - (row.usual_ln + settings.place_ln), 0.0);
        let entered = rate * innovation + above;
        let kept = 1.0 - probability(settings.forgetting_per_s, elapsed_s);
        for (excess, share) in row.excess_ln.iter_mut().zip(shares) {
            *excess = kept * *excess + share * entered;
        }
        let noise_ln = noise_ln - above;
        let walk_per_s = if noise_ln < row.usual_ln { USUAL_FALL_PER_S } else { USUAL_RISE_PER_S };
        row.usual_ln += gain(walk_per_s, elapsed_s) * (noise_ln - row.usual_ln);
        row.noise_ln = Some(noise_ln);
    }

    /// Enters that frames were measured in too large a unit: that the noise taken for the receiver's own was, by this, as ln,
    /// interference with the action whose `shares` these are. The level of noise begins anew, and with it the interference of a
    /// virtual anchor, from that of its direct path.
    pub fn unmask(&mut self, source: Source, shares: &Shares<ACTIONS>, excess_ln: f32) {
        if self.full_band {
            return;
        }
        let Some(row) = self.row_mut(source) else { return };
        row.energy_ln = smaller(row.energy_ln + excess_ln, MOST_ENERGY_LN);
        row.noise_ln = None;
        for (excess, share) in row.excess_ln.iter_mut().zip(shares) {
            *excess += share * excess_ln;
        }
    }

    /// Enters a path observed with `action`, `elapsed_s` seconds after the last frame, and believed to belong to `source` with
    /// probability `weight`.
    pub fn remember(
        &mut self,
        source: Source,
        action: usize,
        path: &Measurement,
        weight: f32,
        elapsed_s: f32,
    ) {
        let news = self.news(source.anchor(), action);
        let settings = self.settings;
        let energy_ln = self.compensated_ln(action, path);
        let Some(row) = self.row_mut(source) else { return };
        let innovation = energy_ln - row.energy_ln;
        let familiar = gain(settings.energy_walk_per_s, elapsed_s) * (1.0 - news) * weight;
        row.energy_ln += larger(familiar, weight / (row.paths + weight + 1e-6)) * innovation;
        if !row.is_seen() {
            // No frame has told of it until now.
            (row.visibility, row.lasting) = (1.0, 1.0);
        }
        row.paths += weight;
    }

    /// Enters that `source` was missed with probability `missed` in a scan where it would have been found with probability
    /// `found`, had nothing hidden it. The rest of the frame is `rest` times as probable if it was there and not found.
    pub fn remember_missed(&mut self, source: Source, found: f32, missed: f32, rest: f32) {
        if let Some(row) = self.row_mut(source) {
            let there = (1.0 - found) * rest;
            let left = there / larger(1.0 - row.visibility * (1.0 - there), 1e-6);
            row.visibility = 1.0 + missed * (row.visibility * left - 1.0);
            row.lasting = 1.0 + missed * (row.lasting * smaller(left, 1.0) - 1.0);
        }
    }

    /// Enters the same of one that no frame has shown yet.
    pub fn remember_unseen(&mut self, source: Source, missed: f32, rest: f32) {
        if let Some(row) = self.row_mut(source) {
            let left = rest / larger(1.0 - row.unseen * (1.0 - rest), 1e-6);
            row.unseen = 1.0 + missed * (row.unseen * left - 1.0);
        }
    }

    /// Enters that a frame of an anchor was received, after what it told of its sources.
    pub fn remember_frame(&mut self, anchor: usize, shares: &Shares<ACTIONS>) {
        let Some(heard) = self.heard.get_mut(anchor) else { return };
        for (count, share) in heard.iter_mut().zip(shares) {
            *count += share;
        }
    }

    /// Tells the SINR (linear, 1e-3 to 1e12) of `source` at every action, and that nothing hides it.
    ///
    /// No radio can know this: it is the published offline condition, where records of the full band were at hand. From then
    /// on the memory is one of the full band ([`Self::is_full_band`]): it believes what it is told.
    pub fn tell(&mut self, source: Source, sinr: &[f32]) {
        self.full_band = true;
        let Some(row) = self.row_mut(source) else { return };
        row.visibility = 1.0;
        row.lasting = 1.0;
        row.paths = larger(row.paths, 1.0);
        for (excess, &sinr) in row.excess_ln.iter_mut().zip(sinr) {
            *excess = -ln(limited(sinr, 1e-3, 1e12));
        }
    }

    /// Whether it was told what no radio can know.
    pub fn is_full_band(&self) -> bool {
        self.full_band
    }

    /// Whether finite numbers are what they may be.
    pub(crate) fn is_sound(&self) -> bool {
        self.direct.iter().chain(&self.virtual_anchors).all(|row| {
            row.paths >= 0.0
                && is_probability(row.visibility)
                && is_probability(row.lasting)
                && is_probability(row.unseen)
        }) && self.heard.iter().flatten().all(|frames| *frames >= 0.0)
    }

    /// Forgets the virtual anchor in `slot`.
    pub fn forget(&mut self, slot: usize) {
        if let Some(row) = self.virtual_anchors.get_mut(slot) {
            *row = Row::default();
        }
    }

    /// Whether `source` was ever seen.
    pub fn has_seen(&self, source: Source) -> bool {
        self.row(source).is_some_and(Row::is_seen)
    }

    /// Effective number of frames of an anchor at `action`, neighbours and age counted in.
    pub fn frames(&self, anchor: usize, action: usize) -> f32 {
        self.heard.get(anchor).and_then(|heard| heard.get(action)).copied().unwrap_or(0.0)
    }

    /// SINR (linear) expected of `source` at `action` where nothing hides it.
    pub fn sinr(&self, source: Source, action: usize) -> f32 {
        exp(self.sinr_ln(source, action))
    }

    /// Every number of the state, in a fixed order, for traces; 0 for noise never received.
    pub fn visit(&self, mut f: impl FnMut(f32)) {
        for row in self.direct.iter().chain(&self.virtual_anchors) {
            f(row.paths);
            f(row.energy_ln);
            f(row.spread_ln);
            f(row.visibility);
            f(row.lasting);
            f(row.unseen);
            f(row.noise_ln.unwrap_or(0.0));
            f(row.usual_ln);
            row.excess_ln.iter().for_each(|value| f(*value));
        }
        self.heard.iter().flatten().for_each(|value| f(*value));
    }
}

impl<const ANCHORS: usize, const SOURCES: usize, const ACTIONS: usize> ChannelKnowledge
    for ChannelMemory<ANCHORS, SOURCES, ACTIONS>
{
    fn visibility(&self, source: Source) -> f32 {
        self.row(source).filter(|row| row.is_seen()).map_or(1.0, |row| row.visibility)
    }

    fn of_ranges(&self, source: Source) -> ChannelPrior {
        let (visibility, lasting) = self.row(source).map_or((1.0, 1.0), |row| (row.visibility, row.lasting));
        ChannelPrior { visibility, lasting, ..ChannelPrior::UNKNOWN }
    }

    fn sinr_ln(&self, source: Source, action: usize) -> f32 {
        let loss_ln = self.loss_ln(action);
        let Some(row) = self.row(source) else { return self.prior_ln - loss_ln };
        let excess_ln = row.excess_ln(action);
        if !row.is_seen() {
            // What nobody has seen is disturbed like the rest.
            return limited(self.prior_ln - loss_ln - excess_ln, LEAST_SINR_LN, MOST_SINR_LN);
        }
        if self.full_band {
            return -excess_ln;
        }
        let noise_ln = row.noise_ln.unwrap_or(0.0) + excess_ln;
        let sinr_ln = row.energy_ln - (row.spread_ln + loss_ln) - noise_ln;
        limited(sinr_ln, LEAST_SINR_LN, MOST_SINR_LN)
    }

    fn sinr_over(&self, source: Source, action: usize, range_m: f32, level: f32) -> Option<f32> {
        let row = self.row(source).filter(|row| row.is_seen() && !self.full_band)?;
        let energy = exp(row.energy_ln - self.loss_ln(action));
        Some(energy / larger(level * (range_m * range_m), 1e-30))
    }

    fn prior(&self, source: Source, action: usize) -> ChannelPrior {
        ChannelPrior {
            seen: self.has_seen(source),
            visibility: self.visibility(source),
            lasting: self.row(source).filter(|row| row.is_seen()).map_or(1.0, |row| row.lasting),
            sinr: self.sinr(source, action),
            present: self
                .row(source)
                .map_or(1.0, |row| if row.is_seen() { row.visibility } else { row.unseen }),
        }
    }
}

/// ln of a power, bounded.
fn level_ln(level: f32) -> f32 {
    ln(limited(level, 1e-30, 1e30))
}

stored!(
    Row<const ACTIONS> {
        paths, energy_ln, spread_ln, visibility, lasting, unseen, noise_ln, usual_ln, excess_ln
    } told {}
);
stored!(
    ChannelMemory<const ANCHORS, const SOURCES, const ACTIONS> { direct, virtual_anchors, heard, full_band, loss_ln }
    told { settings, prior_ln, neighbours }
);
written!(ChannelMemorySettings {
    forgetting_per_s,
    energy_walk_per_s,
    noise_walk_per_s,
    place_ln,
    hiding_per_s
});

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::detection::detection_probability;
    use crate::radio::library::{Action, LIBRARY_DW3000, LIBRARY_WIDE};
    use rand_core::{Rng, SeedableRng};

    const SOURCE: Source = Source::Direct { anchor: 0 };
    type Memory = ChannelMemory<1, 1, 40>;

    /// Level of noise in a quiet frame; a path of 100 times that is 2 m away.
    const QUIET: f32 = 1e-3;

    fn path(sinr: f32) -> Measurement {
        Measurement { range_m: 2.0, variance_m2: 1e-4, sinr, energy: sinr * QUIET, false_alarm: 1.0 }
    }

    /// A frame over noise of this level, with this path.
    fn receive(
        memory: &mut Memory,
        library: &Library<40>,
        action: usize,
        level: f32,
        path: Option<Measurement>,
    ) {
        let shares = memory.shares(action, library);
        memory.predict(0.1);
        let jump = jump(memory.noise_innovation_ln(SOURCE, action, level).unwrap_or(0.0));
        if let Some(path) = &path {
            memory.remember(SOURCE, action, path, 1.0, 0.1);
        }
        memory.remember_noise(SOURCE, action, &shares, (2.0, level), jump, 0.1);
        let found = detection_probability(memory.sinr(SOURCE, action), 6.0);
        memory.remember_missed(SOURCE, found, if path.is_some() { 0.0 } else { 1.0 }, 1.0);
        memory.remember_frame(0, &shares);
    }

    fn hear(memory: &mut Memory, library: &Library<40>, action: usize, sinr: f32) {
        receive(memory, library, action, QUIET, Some(path(sinr)));
    }

    #[test]
    fn what_is_heard_is_expected_and_everywhere_but_for_friis() {
        let library = Library::<40>::new(&LIBRARY_WIDE).unwrap();
        let mut rng = rand_xoshiro::Xoshiro128PlusPlus::seed_from_u64(1);
        let mut uniform = || (rng.next_u32() >> 8) as f32 / 16_777_216.0 + 3e-8;
        let mut memory = Memory::new(ChannelMemorySettings::default(), 10.0, true, &library);
        for _ in 0..100 {
            // SINR 100 within a factor of e.
            hear(&mut memory, &library, 20, 100.0 * (2.0 * uniform() - 1.0).exp());
        }
        assert!((memory.sinr_ln(SOURCE, 20) - 100_f32.ln()).abs() < 0.4);
        for (action, carrier_ghz) in [(21, 7.1_f32), (39, 8.9)] {
            let step = memory.sinr_ln(SOURCE, action) - memory.sinr_ln(SOURCE, 20);
            assert!((step + 2.0 * (carrier_ghz / 7.0).ln()).abs() < 1e-3, "{step}");
        }
        assert!(memory.frames(0, 21) > 20.0 && memory.frames(0, 39) < 0.1);
    }

    /// The tag walks behind something: energy falls by 30 dB within 60 frames. No other carrier is expected to do better.
    #[test]
    fn what_belongs_to_the_place_is_not_taken_for_the_carrier() {
        let library = Library::<40>::new(&LIBRARY_WIDE).unwrap();
        let mut memory = Memory::new(ChannelMemorySettings::default(), 10.0, true, &library);
        (0..60).for_each(|n| hear(&mut memory, &library, [20, 39][n % 2], 1e4));
        let before = memory.sinr_ln(SOURCE, 39) - memory.sinr_ln(SOURCE, 20);
        (0..60).for_each(|n| hear(&mut memory, &library, 20, 1e4 * 10_f32.powf(-0.05 * n as f32)));
        let after = memory.sinr_ln(SOURCE, 39) - memory.sinr_ln(SOURCE, 20);
        assert!((after - before).abs() < 1e-3 && memory.sinr(SOURCE, 20) < 100.0);
        // Nor does noise that rises slowly and a little: by half a nat. Where it goes on, to 2.5 nats, it is interference.
        let mut rise = |factor: f32, to: f32| {
            for n in 0..100 {
                receive(&mut memory, &library, 20, to * factor.powi(n - 99), Some(path(100.0)));
            }
            memory.sinr_ln(SOURCE, 39) - memory.sinr_ln(SOURCE, 20) - after
        };
        let (place, carrier) = (rise(1.005, 1.64 * QUIET), rise(1.02, 12.2 * QUIET));
        assert!(place < 0.15 && carrier > 0.6, "{place} {carrier}");
    }

    #[test]
    fn without_neighbours_an_action_tells_of_itself_alone() {
        let library = Library::<40>::new(&LIBRARY_WIDE).unwrap();
        let mut memory = Memory::new(ChannelMemorySettings::default(), 10.0, false, &library);
        hear(&mut memory, &library, 20, 100.0);
        assert_eq!(memory.frames(0, 21), 0.0);
        assert!(memory.frames(0, 20) > 0.9);
    }

    /// Where nothing was ever heard, the prior over Friis's loss: 2 ln(7.9872 / 6.4896) nats between these two.
    #[test]
    fn nothing_known_gives_the_prior() {
        let library = Library::<2>::new(&LIBRARY_DW3000).unwrap();
        let memory = ChannelMemory::<1, 1, 2>::new(ChannelMemorySettings::default(), 10.0, true, &library);
        let unknown = Source::Virtual { anchor: 0, slot: 0 };
        assert!((memory.sinr(unknown, 0) - 10.0).abs() < 1e-5);
        let loss = (7.9872_f32 / 6.4896).powi(2);
        assert!((memory.sinr(unknown, 1) - 10.0 / loss).abs() < 1e-4);
    }

    /// Where a path is expected that was never seen, interference is known all the same.
    #[test]
    fn interference_disturbs_what_was_never_seen() {
        let library = Library::<40>::new(&LIBRARY_WIDE).unwrap();
        let mut memory = Memory::new(ChannelMemorySettings::default(), 10.0, true, &library);
        (0..30).for_each(|_| receive(&mut memory, &library, 20, QUIET, None));
        (0..5).for_each(|_| receive(&mut memory, &library, 20, 100.0 * QUIET, None));
        assert!(!memory.has_seen(SOURCE));
        assert!(memory.sinr_ln(SOURCE, 39) > memory.sinr_ln(SOURCE, 20) + 2.5);
    }

    /// Twenty frames in noise that is taken for the receiver's own, until another carrier shows that 3 nats of it are not.
    #[test]
    fn what_is_unmasked_is_charged_to_its_carrier() {
        let library = Library::<40>::new(&LIBRARY_WIDE).unwrap();
        let mut memory = Memory::new(ChannelMemorySettings::default(), 10.0, true, &library);
        (0..20).for_each(|_| hear(&mut memory, &library, 20, 100.0));
        let before = [20, 39].map(|action| memory.sinr_ln(SOURCE, action));
        let shares = memory.shares(20, &library);
        memory.unmask(SOURCE, &shares, 3.0);
        // In the smaller unit, the path is stronger; the quiet frame has the level that the frames before had in theirs.
        receive(&mut memory, &library, 39, QUIET, Some(path(100.0 * 3_f32.exp())));
        let [left, here] = [20, 39].map(|action| memory.sinr_ln(SOURCE, action));
        assert!(
            (left - before[0]).abs() < 0.2 && (here - before[1] - 3.0).abs() < 0.2,
            "{left} {here} {before:?}"
        );
    }

    /// An interferer of 20 dB: the path vanishes in noise that explains it. The carrier is to blame, at once, and neither
    /// the carriers far away nor the source's visibility.
    #[test]
    fn an_interferer_is_noticed_in_a_few_frames_and_where_it_is() {
        let library = Library::<40>::new(&LIBRARY_WIDE).unwrap();
        let mut memory = Memory::new(ChannelMemorySettings::default(), 10.0, true, &library);
        (0..60).for_each(|n| hear(&mut memory, &library, [20, 39][n % 2], 100.0));
        let (jammed, quiet) = (memory.sinr_ln(SOURCE, 20), memory.sinr_ln(SOURCE, 39));
        for frame in 0..5 {
            let sinr = memory.sinr_over(SOURCE, 20, 2.0, 100.0 * QUIET).unwrap();
            // Equal SINRs at two carriers are unequal energies, by 2 ln(8.9 / 7.0): their mean is known.
            assert!((sinr - 1.0).abs() < 0.35, "{sinr}");
            receive(&mut memory, &library, 20, 100.0 * QUIET, None);
            // More than half of the 4.6 nats in one frame.
            assert!(memory.sinr_ln(SOURCE, 20) < jammed - 2.5, "{frame}");
        }
        assert!(memory.sinr_ln(SOURCE, 20) < jammed - 4.0);
        // The last JUMP_LN of it pass for the place, and so for every carrier.
        assert!(memory.sinr_ln(SOURCE, 39) > quiet - JUMP_LN);
        assert!(memory.visibility(SOURCE) > 0.5);
        // And as soon that it is gone.
        (0..2).for_each(|_| hear(&mut memory, &library, 20, 100.0));
        assert!(memory.sinr_ln(SOURCE, 20) > jammed - 1.0);
    }

    /// The forward recursion of a two-state Markov chain, in the textbook's form.
    #[test]
    fn what_hides_in_a_quiet_frame_is_hidden_and_its_carrier_keeps_its_name() {
        let library = Library::<40>::new(&LIBRARY_WIDE).unwrap();
        let mut memory = Memory::new(ChannelMemorySettings::default(), 10.0, true, &library);
        (0..30).for_each(|_| hear(&mut memory, &library, 20, 100.0));
        let before = memory.sinr_ln(SOURCE, 20);
        let found = detection_probability(memory.sinr(SOURCE, 20), 6.0);
        let mut visible = f64::from(memory.visibility(SOURCE));
        for _ in 0..20 {
            receive(&mut memory, &library, 20, QUIET, None);
            let ahead = 0.98 * visible + 0.02 * (1.0 - visible);
            let both = [ahead * (1.0 - f64::from(found)), 1.0 - ahead];
            visible = both[0] / (both[0] + both[1]);
            assert!((f64::from(memory.visibility(SOURCE)) - visible).abs() < 1e-4);
        }
        assert!(memory.visibility(SOURCE) < 0.05);
        assert!((memory.sinr_ln(SOURCE, 20) - before).abs() < 0.2);
    }

    #[test]
    fn the_full_band_is_believed_to_the_letter_and_said_so() {
        let library = Library::<40>::new(&LIBRARY_WIDE).unwrap();
        let mut memory = Memory::new(ChannelMemorySettings::default(), 10.0, true, &library);
        assert!(!memory.is_full_band());
        let truth: std::vec::Vec<f32> = (0..40).map(|action| 1.0 + action as f32).collect();
        memory.tell(SOURCE, &truth);
        hear(&mut memory, &library, 3, 1e6);
        assert!(memory.is_full_band());
        for (action, sinr) in truth.iter().enumerate() {
            assert!((memory.sinr(SOURCE, action) / sinr - 1.0).abs() < 1e-4);
        }
    }

    #[test]
    fn pulses_of_unequal_width_share_less() {
        let pair = [
            Action { carrier_hz: 4e9, pulse_duration_s: 2e-9 },
            Action { carrier_hz: 4e9, pulse_duration_s: 1e-9 },
        ];
        let library = Library::<2>::new(&pair).unwrap();
        let memory = ChannelMemory::<1, 1, 2>::new(ChannelMemorySettings::default(), 10.0, true, &library);
        let [own, other] = memory.shares(0, &library);
        assert!((own - 1.0).abs() < 1e-6 && (other - 0.0625).abs() < 1e-3);
    }
}
