//! Channel memory: the SINR of every source (direct path or virtual anchor) at every action.
//!
//! Per source and action it keeps a forgetting mean of ln SINR, as the channel estimator saw it, and how many samples
//! that rests on; per source their slow mean over all actions, the level, which is expected where nothing was heard. It
//! is hopeful: it falls slower than it rises.
//! A path observed with one action also tells of its spectral neighbours, in proportion to the fourth power of the overlap
//! rho of the two pulses' spectra. Everything is compared at the carrier of the first action: by Friis's law a path
//! loses as the carrier squared.
//!
//! A path that was not found has two explanations. Either its SINR was too low: what it would have been follows from
//! the source's energy (distance-compensated, |alpha|^2 d^2) and the frame's own level of noise and interference, so an
//! interferer is noticed in the first frame it disturbs. Or something hides the source: visibility is the state of a
//! two-state Markov chain, and a miss that the SINR does not explain counts against it, not against the carrier.
//!
//! While the tag is lost, the frames' noise alone is remembered: a radio that an interferer has silenced must learn to go
//! elsewhere.
//!
//! The published estimator, moments of the last 40 amplitudes, is not used: amplitudes that differ between carriers and
//! places count as noise there, and after a few changes of the carrier it takes strong paths for lost ones.

use crate::controller::library::Library;
use crate::perceptor::association::Measurement;
use crate::perceptor::state_filter::Source;
use crate::real::{exp, larger, limited, ln};

/// Ageing of every count per cycle: after some 140 cycles half is forgotten.
const AGEING: f32 = 0.995;
/// Least weight of a new sample at its own action.
const FORGETTING: f32 = 0.15;
/// The same where a SINR follows from the frame's noise: that is a mean over many samples, and news.
const NOISE_FORGETTING: f32 = 0.4;
/// The same for the level over all actions, where it rises. It falls five times slower: interference comes and goes, and
/// what is bad here and now is not expected elsewhere.
const LEVEL_RISE: f32 = 0.01;
const LEVEL_FALL: f32 = 0.002;
/// Samples that the level counts for beside those of an action: a single sample deviates as much from an action's mean
/// as actions do from the level.
const LEVEL_COUNT: f32 = 1.0;
/// Samples remembered at most, of an action and of the level.
const WINDOW: f32 = 40.0;
const LEVEL_WINDOW: f32 = 500.0;
/// Probability per cycle that a source hides, or comes out.
const TURNING: f32 = 0.02;

/// How much a sample at one action tells of every action: 1 at its own, 0 to 1 at the others.
pub type Shares<const ACTIONS: usize> = [f32; ACTIONS];

/// What is known of one source at one action, or of its level.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Heard {
    /// Effective number of samples.
    count: f32,
    /// Mean of ln SINR, at the reference carrier.
    sinr_ln: f32,
}

impl Heard {
    /// Takes a sample into the mean; the first ones count in full.
    fn enter(&mut self, sinr_ln: f32, share: f32, forgetting: f32, window: f32) {
        let gain = larger(forgetting * share, share / (self.count + share + 1e-6));
        self.sinr_ln += gain * (sinr_ln - self.sinr_ln);
        self.count = self.count * (1.0 - share * (1.0 / window)) + share;
    }
}

/// What is known of one source.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Row<const ACTIONS: usize> {
    /// Mean over all actions; its count is 0 until the source is seen.
    level: Heard,
    /// Mean of ln energy, at the reference carrier and one metre.
    energy_ln: f32,
    /// Probability that nothing hides the source.
    visibility: f32,
    actions: [Heard; ACTIONS],
}

impl<const ACTIONS: usize> Default for Row<ACTIONS> {
    fn default() -> Self {
        Self {
            level: Heard::default(),
            energy_ln: 0.0,
            visibility: 1.0,
            actions: [Heard::default(); ACTIONS],
        }
    }
}

impl<const ACTIONS: usize> Row<ACTIONS> {
    fn is_seen(&self) -> bool {
        self.level.count > 0.0
    }

    /// Enters ln SINR at the reference carrier.
    fn enter(&mut self, shares: &Shares<ACTIONS>, sinr_ln: f32, weight: f32, forgetting: f32) {
        let is_better = sinr_ln > self.level.sinr_ln;
        self.level.enter(sinr_ln, weight, if is_better { LEVEL_RISE } else { LEVEL_FALL }, LEVEL_WINDOW);
        for (heard, share) in self.actions.iter_mut().zip(shares) {
            heard.enter(sinr_ln, weight * share, forgetting, WINDOW);
        }
    }
}

/// SINR of `ANCHORS` direct paths and `VAS` virtual anchors at `ACTIONS` actions.
#[derive(Clone, Debug)]
pub struct ChannelMemory<const ANCHORS: usize, const VAS: usize, const ACTIONS: usize> {
    direct: [Row<ACTIONS>; ANCHORS],
    virtual_anchors: [Row<ACTIONS>; VAS],
    prior_ln: f32,
    neighbours: bool,
    full_band: bool,
    /// ln of the power lost to the reference carrier, by action.
    loss_ln: [f32; ACTIONS],
}

impl<const ANCHORS: usize, const VAS: usize, const ACTIONS: usize> ChannelMemory<ANCHORS, VAS, ACTIONS> {
    /// An empty memory. `prior_sinr` (linear) is assumed of sources never seen, at the carrier of the first action;
    /// with `neighbours`, actions tell of those whose spectra they overlap.
    pub fn new(prior_sinr: f32, neighbours: bool, library: &Library<ACTIONS>) -> Self {
        let reference_hz = library.get(0).map_or(1.0, |first| first.carrier_hz);
        let mut loss_ln = [0.0; ACTIONS];
        for (action, loss) in loss_ln.iter_mut().enumerate() {
            if let Some(entry) = library.get(action) {
                *loss = 2.0 * ln(entry.carrier_hz / reference_hz);
            }
        }
        Self {
            direct: [Row::default(); ANCHORS],
            virtual_anchors: [Row::default(); VAS],
            prior_ln: ln(prior_sinr),
            neighbours,
            full_band: false,
            loss_ln,
        }
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

    fn loss_ln(&self, action: usize) -> f32 {
        self.loss_ln.get(action).copied().unwrap_or(0.0)
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

    /// A cycle passes: counts age, and what was visible may have gone behind something, or come out.
    pub fn age(&mut self) {
        for row in self.direct.iter_mut().chain(&mut self.virtual_anchors).filter(|row| row.is_seen()) {
            row.visibility += TURNING * (1.0 - 2.0 * row.visibility);
            for heard in &mut row.actions {
                heard.count *= AGEING;
            }
        }
    }

    /// Enters a path observed with `action`, whose `shares` these are, and believed to belong to `source` with
    /// probability `weight`.
    pub fn remember(
        &mut self,
        source: Source,
        action: usize,
        shares: &Shares<ACTIONS>,
        path: &Measurement,
        weight: f32,
    ) {
        let (loss_ln, full_band) = (self.loss_ln(action), self.full_band);
        let Some(row) = self.row_mut(source) else { return };
        if !full_band {
            row.enter(shares, ln(limited(path.sinr, 1e-3, 1e12)) + loss_ln, weight, FORGETTING);
        }
        // The level has counted this sample already.
        let gain = larger(FORGETTING * weight, weight / larger(row.level.count, weight));
        let energy = larger(path.energy * (path.range_m * path.range_m), 1e-30);
        row.energy_ln += gain * (ln(energy) + loss_ln - row.energy_ln);
    }

    /// Enters that `source` was missed with probability `missed` in a frame received with `action`, where it would have
    /// had this SINR and been found with probability `found`, had nothing hidden it.
    pub fn remember_missed(
        &mut self,
        source: Source,
        action: usize,
        shares: &Shares<ACTIONS>,
        (sinr, found): (f32, f32),
        missed: f32,
    ) {
        let (loss_ln, full_band) = (self.loss_ln(action), self.full_band);
        let Some(row) = self.row_mut(source) else { return };
        if !row.is_seen() {
            return;
        }
        let visible = row.visibility * (1.0 - found) / larger(1.0 - row.visibility * found, 1e-6);
        row.visibility = 1.0 + missed * (visible - 1.0);
        if missed > 0.5 && !full_band {
            row.enter(shares, ln(limited(sinr, 1e-3, 1e12)) + loss_ln, missed * visible, NOISE_FORGETTING);
        }
    }

    /// Enters the SINR that `source` would have in a frame received with `action`, by the frame's noise, where nobody knows
    /// which path is whose.
    pub fn remember_noise(&mut self, source: Source, action: usize, shares: &Shares<ACTIONS>, sinr: f32) {
        let (loss_ln, full_band) = (self.loss_ln(action), self.full_band);
        if let Some(row) = self.row_mut(source).filter(|row| row.is_seen() && !full_band) {
            row.enter(shares, ln(limited(sinr, 1e-3, 1e12)) + loss_ln, 1.0, NOISE_FORGETTING);
        }
    }

    /// Tells the SINR (linear, 1e-3 to 1e12) of `source` at every action, and that nothing hides it.
    ///
    /// No radio can know this: it is the published offline condition, where records of the full band were at hand. From then
    /// on the memory is one of the full band ([`Self::is_full_band`]): it believes what it is told and remembers nothing.
    pub fn tell(&mut self, source: Source, sinr: &[f32]) {
        self.full_band = true;
        let loss_ln = self.loss_ln;
        let Some(row) = self.row_mut(source) else { return };
        row.visibility = 1.0;
        row.level = Heard { count: WINDOW, sinr_ln: 0.0 };
        let mut sum = 0.0;
        for ((heard, loss), &sinr) in row.actions.iter_mut().zip(loss_ln).zip(sinr) {
            *heard = Heard { count: f32::MAX, sinr_ln: ln(limited(sinr, 1e-3, 1e12)) + loss };
            sum += heard.sinr_ln;
        }
        row.level.sinr_ln = sum / larger(sinr.len() as f32, 1.0);
    }

    /// Whether it was told what no radio can know.
    pub fn is_full_band(&self) -> bool {
        self.full_band
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

    /// Effective number of samples known of `source` at `action`, neighbours and age counted in.
    pub fn samples(&self, source: Source, action: usize) -> f32 {
        self.row(source).and_then(|row| row.actions.get(action)).map_or(0.0, |heard| heard.count)
    }

    /// Probability that nothing hides `source`.
    pub fn visibility(&self, source: Source) -> f32 {
        self.row(source).map_or(1.0, |row| row.visibility)
    }

    /// ln SINR expected of `source` at `action` where nothing hides it.
    pub fn sinr_ln(&self, source: Source, action: usize) -> f32 {
        let loss_ln = self.loss_ln(action);
        let heard = self.row(source).filter(|row| row.is_seen()).and_then(|row| {
            let heard = row.actions.get(action)?;
            let known = heard.count / (heard.count + LEVEL_COUNT);
            Some(row.level.sinr_ln + known * (heard.sinr_ln - row.level.sinr_ln))
        });
        heard.unwrap_or(self.prior_ln) - loss_ln
    }

    /// SINR (linear) expected of `source` at `action` where nothing hides it.
    pub fn sinr(&self, source: Source, action: usize) -> f32 {
        exp(self.sinr_ln(source, action))
    }

    /// SINR (linear) that `source` would have with `action` `range_m` away over noise of this level (in squared units of
    /// the samples) where nothing hides it; `None` if it was never seen, or is told anyway.
    pub fn sinr_over(&self, source: Source, action: usize, range_m: f32, level: f32) -> Option<f32> {
        let row = self.row(source).filter(|row| row.is_seen() && !self.full_band)?;
        Some(exp(row.energy_ln - self.loss_ln(action)) / larger(level * (range_m * range_m), 1e-30))
    }

    /// Every number of the state, in a fixed order, for traces.
    pub fn visit(&self, mut f: impl FnMut(f32)) {
        for row in self.direct.iter().chain(&self.virtual_anchors) {
            f(row.level.count);
            f(row.level.sinr_ln);
            f(row.energy_ln);
            f(row.visibility);
            for heard in &row.actions {
                f(heard.count);
                f(heard.sinr_ln);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::controller::library::{Action, LIBRARY_DW3000, LIBRARY_WIDE};
    use crate::perceptor::association::detection_probability;
    use rand_core::{Rng, SeedableRng};

    const SOURCE: Source = Source::Direct { anchor: 0 };
    type Memory = ChannelMemory<1, 1, 40>;

    fn path(sinr: f32) -> Measurement {
        Measurement { range_m: 2.0, variance_m2: 1e-4, sinr, energy: sinr * 1e-3, false_alarm: 1.0 }
    }

    fn hear(memory: &mut Memory, library: &Library<40>, action: usize, sinr: f32) {
        let shares = memory.shares(action, library);
        memory.age();
        memory.remember(SOURCE, action, &shares, &path(sinr), 1.0);
        memory.remember_missed(SOURCE, action, &shares, (sinr, 0.9), 0.0);
    }

    #[test]
    fn what_is_heard_is_expected_and_neighbours_share_it() {
        let library = Library::<40>::new(&LIBRARY_WIDE).unwrap();
        let mut rng = rand_xoshiro::Xoshiro128PlusPlus::seed_from_u64(1);
        let mut uniform = || (rng.next_u32() >> 8) as f32 / 16_777_216.0 + 3e-8;
        let mut memory = Memory::new(10.0, true, &library);
        for _ in 0..100 {
            // SINR 100 within a factor of e.
            hear(&mut memory, &library, 20, 100.0 * (2.0 * uniform() - 1.0).exp());
        }
        assert!((memory.sinr_ln(SOURCE, 20) - 100_f32.ln()).abs() < 0.4);
        // 100 MHz on: as much, less 2 ln(7.1 / 7.0) by Friis.
        let step = memory.sinr_ln(SOURCE, 21) - memory.sinr_ln(SOURCE, 20);
        assert!((step + 2.0 * (7.1_f32 / 7.0).ln()).abs() < 0.05, "{step}");
        assert!(memory.samples(SOURCE, 21) > 20.0 && memory.samples(SOURCE, 39) < 0.1);
    }

    #[test]
    fn without_neighbours_an_action_tells_of_itself_alone() {
        let library = Library::<40>::new(&LIBRARY_WIDE).unwrap();
        let mut memory = Memory::new(10.0, false, &library);
        hear(&mut memory, &library, 20, 100.0);
        assert_eq!(memory.samples(SOURCE, 21), 0.0);
        assert!(memory.samples(SOURCE, 20) > 0.9);
    }

    /// Where nothing was ever heard, the prior over Friis's loss: 2 ln(7.9872 / 6.4896) nats between these two.
    #[test]
    fn nothing_known_gives_the_prior() {
        let library = Library::<2>::new(&LIBRARY_DW3000).unwrap();
        let memory = ChannelMemory::<1, 1, 2>::new(10.0, true, &library);
        let unknown = Source::Virtual { anchor: 0, slot: 0 };
        assert!((memory.sinr(unknown, 0) - 10.0).abs() < 1e-5);
        let loss = (7.9872_f32 / 6.4896).powi(2);
        assert!((memory.sinr(unknown, 1) - 10.0 / loss).abs() < 1e-4);
    }

    /// An interferer of 20 dB: the path vanishes in noise that explains it. The carrier is to blame, at once, and neither
    /// the carriers far away nor the source's visibility.
    #[test]
    fn an_interferer_is_noticed_in_a_few_frames_and_where_it_is() {
        let library = Library::<40>::new(&LIBRARY_WIDE).unwrap();
        let mut memory = Memory::new(10.0, true, &library);
        (0..60).for_each(|n| hear(&mut memory, &library, [20, 39][n % 2], 100.0));
        let (jammed, quiet) = (memory.sinr_ln(SOURCE, 20), memory.sinr_ln(SOURCE, 39));
        let shares = memory.shares(20, &library);
        for _ in 0..5 {
            memory.age();
            // The energy of SINR 100 was 0.1 at 2 m: the noise is 100 times that of then.
            let sinr = memory.sinr_over(SOURCE, 20, 2.0, 0.1).unwrap();
            assert!((sinr - 1.0).abs() < 0.35, "{sinr}");
            memory.remember_missed(SOURCE, 20, &shares, (sinr, detection_probability(sinr, 6.0)), 1.0);
        }
        assert!(memory.sinr_ln(SOURCE, 20) < jammed - 1.5);
        assert!(memory.sinr_ln(SOURCE, 39) > quiet - 0.05);
        assert!(memory.visibility(SOURCE) > 0.5);
    }

    /// The forward recursion of a two-state Markov chain, in the textbook's form.
    #[test]
    fn what_hides_in_a_quiet_frame_is_hidden_and_its_carrier_keeps_its_name() {
        let library = Library::<40>::new(&LIBRARY_WIDE).unwrap();
        let mut memory = Memory::new(10.0, true, &library);
        (0..30).for_each(|_| hear(&mut memory, &library, 20, 100.0));
        let before = memory.sinr_ln(SOURCE, 20);
        let shares = memory.shares(20, &library);
        let found = detection_probability(100.0, 6.0);
        let mut visible = f64::from(memory.visibility(SOURCE));
        for _ in 0..20 {
            memory.age();
            memory.remember_missed(SOURCE, 20, &shares, (100.0, found), 1.0);
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
        let mut memory = Memory::new(10.0, true, &library);
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
        let memory = ChannelMemory::<1, 1, 2>::new(10.0, true, &library);
        let [own, other] = memory.shares(0, &library);
        assert!((own - 1.0).abs() < 1e-6 && (other - 0.0625).abs() < 1e-3);
    }
}
