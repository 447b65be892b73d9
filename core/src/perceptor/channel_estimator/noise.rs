//! The level of everything that is not a specular path: white noise, and dense multipath.
//!
//! Dense multipath has a power profile that rises and decays, but how fast, and where it begins, is not taken for
//! granted: it may follow the first path, or belong to an interferer that keeps a time of its own. So the level is
//! lambda(n) = N0 + sum_j theta_j p(n - n_j), a sum of short profiles p(t) = (1 - chi exp(-t/rise)) exp(-t/decay) that
//! begin at nodes n_j throughout the frame, theta_j >= 0.
//!
//! The residual's powers are exponentially distributed with mean lambda(n). Their likelihood is climbed by the
//! multiplicative updates theta_j <- theta_j f(sum_n p u / sum_n p v), v = 1/lambda, u = |r|^2 / lambda^2 (the
//! Itakura-Saito case of non-negative matrix factorisation, Fevotte, Bertin and Durrieu 2009), with |r|^2 / lambda cut
//! off ([`Cut`]), and what exponentially distributed powers lose by that given back, so that a path not yet found counts
//! little: where they are in a share e of the samples, a cut at 3 makes the level rise by (1 - e) / (1 - 3.2 e), where all of them are
//! counted by their SINR. For these sums the level is taken as constant over cells of a
//! few nanoseconds. A profile being two exponentials, the rest are recursions from cell to cell: one pass over the samples,
//! whatever the number of nodes.

use super::EstimatorSettings;
use crate::real::{exp, larger, smaller, sqrt};
use crate::snapshot::written;

/// Mathematics: rise time of a profile's soft onset, and grid step over which the fit takes the level as constant (a cell),
/// decay times.
pub const RISE_DECAYS: f32 = 0.3125;
/// Mathematics: depth of the onset, chi, in the published profile of dense multipath (Karedal et al. 2007).
pub const ONSET: f32 = 0.98;
/// Mathematics: integral of a profile over its peak, decay times.
pub const LENGTH_DECAYS: f32 = 1.56;
/// Capacity: nodes of a frame, which bound the memory. There is one at the beginning of every cell, or of every few cells of
/// longer frames.
pub const NODES: usize = 128;
/// Guard: against a weight of zero, which no factor would change: every node's first share of the white noise.
pub const FIRST_SHARE: f32 = 0.02;
/// How the noise fit bears paths that are not found yet: powers are cut off.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cut {
    /// Powers over the level are cut off here.
    pub levels: f32,
    /// Share of their mean that exponentially distributed powers keep then: 1 - e^-levels.
    pub kept: f32,
    /// Share of the square in an update's factor, x (1 - r + r x): an over-relaxation that needs fewer passes.
    pub relaxation: f32,
    /// Parts in n independent samples by which a peak is lost in a level fitted to n of them, less those by which the level's own
    /// errors bring false ones; fitted to simulated frames.
    pub self_share: f32,
    /// How much of its own energy a point is taken to lift the level by, of an equal share: fitted to simulated frames of noise, beside
    /// what theory has, kept / (1 - (1 + levels) e^-levels) and 1 / kept.
    pub own: [f32; 2],
}

/// Guard: against a level that rests on a handful of samples: most of a point's own energy that is taken out of it.
pub const MOST_OWN: f32 = 0.15;
/// Guard: against paths not yet found, in frames with phases, where they are subtracted one by one.
pub const COMPLEX_CUT: Cut =
    Cut { levels: 5.0, kept: 0.993_262, relaxation: 0.5, self_share: 1.7, own: [1.0, 1.0] };
/// Guard: against paths not yet found, in magnitudes, which cannot be subtracted: a lower cut bears more of them, and is less sure of
/// dense multipath.
pub const MAGNITUDE_CUT: Cut =
    Cut { levels: 3.0, kept: 0.950_213, relaxation: 1.0, self_share: -0.5, own: [1.186_502, 1.052_396] };
/// Guard: against paths in the white level that the noise fit begins with: powers further over it are left out.
pub const TRIM: f32 = 5.0;
/// Mathematics: mean of exponentially distributed powers when those above [`TRIM`] are left out, 1 - 5 / (e^5 - 1).
pub const TRIMMED_SHARE: f32 = 0.9661;
/// Mathematics: grid of blocks by which the quietest parts of a frame are found.
pub const BLOCKS: usize = 16;

/// The profile that begins at a node.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub(super) struct Profile {
    decay_s: f32,
    rise_s: f32,
}

impl Profile {
    /// No profile.
    pub const NONE: Self = Self { decay_s: 0.0, rise_s: 0.0 };

    /// That for a pulse of the effective duration `effective_duration_s`.
    pub fn new(effective_duration_s: f32, settings: &EstimatorSettings) -> Self {
        let decay_s = larger(settings.dense_decay_s, settings.dense_decay_pulses * effective_duration_s);
        Self { decay_s, rise_s: RISE_DECAYS * decay_s }
    }

    /// Its integral over its peak, seconds: the time over which a node gathers its level.
    pub fn length_s(&self) -> f32 {
        LENGTH_DECAYS * self.decay_s
    }
}

/// The dense multipath of a frame as a whole.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct DenseMultipath {
    /// Its power: the integral of its power delay profile, in squared units of the samples; on this scale a path has the
    /// square of its amplitude.
    pub power: f32,
    /// Mean delay of that power, seconds; the first sample's where there is none.
    pub mean_delay_s: f32,
    /// Root mean square delay spread, seconds.
    pub rms_delay_spread_s: f32,
}

/// Noise and dense multipath at the matched filter's output.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct NoiseLevel {
    /// White noise power N0, in squared units of the samples.
    pub white: f32,
    profile: Profile,
    /// theta of every node.
    weights: [f32; NODES],
    /// Sums over all nodes up to each one: of theta exp(-t/decay), and of theta exp(-t/decay - t/rise).
    decaying: [f32; NODES],
    rising: [f32; NODES],
    /// Samples from node to node, and from the first node to the frame.
    node_samples: usize,
    lead: usize,
}

impl NoiseLevel {
    /// White noise and the beginnings of dense multipath everywhere in a frame.
    pub(super) fn open(white: f32, steps: &LevelSteps) -> Self {
        let none = [0.0; NODES];
        let mut level = Self {
            white,
            profile: steps.profile,
            weights: none,
            decaying: none,
            rising: none,
            node_samples: steps.node_samples(),
            lead: steps.lead,
        };
        for weight in level.weights.iter_mut().take(steps.nodes) {
            *weight = FIRST_SHARE * white;
        }
        level.accumulate(steps);
        level
    }

    /// The sums over the nodes.
    fn accumulate(&mut self, steps: &LevelSteps) {
        let (mut decaying, mut rising) = (0.0, 0.0);
        let sums = self.decaying.iter_mut().zip(&mut self.rising);
        for (weight, (decaying_sum, rising_sum)) in self.weights.iter().zip(sums).take(steps.nodes) {
            decaying = decaying * steps.node.decay + weight;
            rising = rising * steps.node.rise + weight;
            *decaying_sum = decaying;
            *rising_sum = rising;
        }
    }

    /// Level `position` samples into a frame whose samples are `sample_spacing_s` seconds apart, in squared units of
    /// the samples.
    pub fn level(&self, position: f32, sample_spacing_s: f32) -> f32 {
        // Before the frame there is white noise alone. Truncation is the floor of what is not negative.
        if position < 0.0 {
            return self.white;
        }
        let position = position + self.lead as f32;
        let node = (position as usize / self.node_samples.max(1)).min(NODES - 1);
        let past_s = (position - (node * self.node_samples) as f32) * sample_spacing_s;
        let (Some(decaying), Some(rising)) = (self.decaying.get(node), self.rising.get(node)) else {
            return self.white;
        };
        let Profile { decay_s, rise_s } = self.profile;
        let decay = exp(-past_s / decay_s);
        self.white + (decaying - ONSET * rising * exp(-past_s / rise_s)) * decay
    }

    /// Power, mean delay and delay spread of the dense multipath, whose profile S the matched filter makes a level of
    /// T_eff S: T_eff is `effective_duration_s`.
    pub(super) fn dense_multipath(
        &self,
        first_sample_delay_s: f32,
        sample_spacing_s: f32,
        effective_duration_s: f32,
    ) -> DenseMultipath {
        let (mut sum, mut first, mut second) = (0.0, 0.0, 0.0);
        for (node, weight) in self.weights.iter().enumerate() {
            let time_s = ((node * self.node_samples) as f32 - self.lead as f32) * sample_spacing_s;
            sum += weight;
            first += weight * time_s;
            second += weight * (time_s * time_s);
        }
        if !(sum > 0.0) {
            return DenseMultipath {
                power: 0.0,
                mean_delay_s: first_sample_delay_s,
                rms_delay_spread_s: 0.0,
            };
        }
        // Moments of a node's profile, a difference of exponentials of the decay times d and e.
        let Profile { decay_s: d, rise_s } = self.profile;
        let e = d * rise_s / (d + rise_s);
        let integral = d - ONSET * e;
        let profile_mean = (d * d - ONSET * (e * e)) / integral;
        let profile_square = 2.0 * (d * d * d - ONSET * (e * e * e)) / integral;
        let node_mean = first / sum;
        let variance =
            (second / sum - node_mean * node_mean) + (profile_square - profile_mean * profile_mean);
        DenseMultipath {
            power: sum * integral / effective_duration_s,
            mean_delay_s: first_sample_delay_s + (node_mean + profile_mean),
            rms_delay_spread_s: sqrt(larger(variance, 0.0)),
        }
    }

    /// One update of all levels. `powers` gives the residual's powers in a cell, each cut off at a second argument; nodes come from
    /// the last to the first. White noise is never taken as less than `floor`.
    pub(super) fn refine(
        &mut self,
        steps: &LevelSteps,
        by: &Cut,
        floor: f32,
        mut powers: impl FnMut(Cell, f32) -> CutPowers,
    ) {
        let (mut all_u, mut all_v) = (0.0, 0.0);
        // Sums of u and v from a node on, weighted by each of the two exponentials since the node.
        let mut after = [0.0_f32; 4];
        let mut node = steps.nodes.min(NODES);
        // Slices, which are walked back from their ends in half the instructions of what takes so many.
        let weights = self.weights.get_mut(..node).unwrap_or(&mut []).iter_mut().rev();
        let [decaying, rising] =
            [&self.decaying, &self.rising].map(|sums| sums.get(..node).unwrap_or(&[]).iter().rev());
        for (weight, (decaying, rising)) in weights.zip(decaying.zip(rising)) {
            node = node.wrapping_sub(1);
            let mut own = [0.0_f32; 4];
            let Factors { mut decay, mut rise } = steps.half_cell;
            // Cells ahead of the frame are empty.
            let mut next = node * self.node_samples;
            for _ in 0..steps.node_cells {
                let level = self.white + (decaying * decay - ONSET * (rising * rise));
                let (from, to) = steps.cell_at(next);
                next += steps.cell_samples;
                let CutPowers { sum, count } = powers(Cell { node, from, to }, by.levels * level);
                let inverse = 1.0 / level;
                let v = count * inverse;
                // In this order neither underflows.
                let u = (sum * inverse) * (inverse * (1.0 / by.kept));
                all_u += u;
                all_v += v;
                let [decaying_u, decaying_v, rising_u, rising_v] = own;
                own = [
                    decaying_u + decay * u,
                    decaying_v + decay * v,
                    rising_u + rise * u,
                    rising_v + rise * v,
                ];
                decay *= steps.cell.decay;
                rise *= steps.cell.rise;
            }
            let [decaying_u, decaying_v, rising_u, rising_v] = after;
            let Factors { decay, rise } = steps.node;
            let carried = [decay * decaying_u, decay * decaying_v, rise * rising_u, rise * rising_v];
            for ((after, own), carried) in after.iter_mut().zip(own).zip(carried) {
                *after = own + carried;
            }
            let [decaying_u, decaying_v, rising_u, rising_v] = after;
            *weight *= by.factor(decaying_u - ONSET * rising_u, decaying_v - ONSET * rising_v);
        }
        self.white = larger(self.white * by.factor(all_u, all_v), floor);
        self.accumulate(steps);
    }
}

/// A cell: its node, and its samples from one to another.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cell {
    pub node: usize,
    pub from: usize,
    pub to: usize,
}

/// Sums of a frame's powers by cell, for the cells that no path reaches and in which no power is cut off: nearly all of them, in
/// every pass of the fit. Frames whose nodes have several cells have none: they are too long to be kept.
#[derive(Clone, Debug)]
pub(super) struct CellPowers {
    sums: [f32; NODES],
    largest: [f32; NODES],
}

impl CellPowers {
    /// Those of a frame whose sample `n` has `power(n)`.
    pub fn new(steps: &LevelSteps, power: impl Fn(usize) -> f32) -> Self {
        let mut powers = Self { sums: [0.0; NODES], largest: [f32::MAX; NODES] };
        if steps.node_cells == 1 {
            let cells = powers.sums.iter_mut().zip(&mut powers.largest).enumerate();
            for (cell, (sum, largest)) in cells.take(steps.nodes) {
                let (from, to) = steps.cell_at(cell * steps.cell_samples);
                *largest = 0.0;
                for n in from..to {
                    let here = power(n);
                    *sum += here;
                    *largest = larger(*largest, here);
                }
            }
        }
        powers
    }

    /// The sum of the cell of a node where none of its powers exceeds `cut`.
    #[inline]
    pub fn below(&self, node: usize, cut: f32) -> Option<f32> {
        let (sum, largest) = (self.sums.get(node)?, self.largest.get(node)?);
        (*largest <= cut).then_some(*sum)
    }
}

/// Sum and number of powers, each cut off.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct CutPowers {
    sum: f32,
    count: f32,
}

impl CutPowers {
    /// So many powers, none of them cut off.
    #[inline]
    pub fn whole(sum: f32, count: usize) -> Self {
        Self { sum, count: count as f32 }
    }

    #[inline]
    pub fn add(&mut self, power: f32, cut: f32) {
        self.sum += smaller(power, cut);
        self.count += 1.0;
    }
}

impl Cut {
    /// Factor of an update: x (1 - r + r x) with x = u / v; 1 where nothing was seen. The update still contracts, as the plain one has
    /// eigenvalues from 0 to 1, and below 0.85 where powers are cut off at 3 levels. Bounded, so that one update changes no level
    /// beyond repair.
    fn factor(&self, u: f32, v: f32) -> f32 {
        let ratio = if v > 0.0 { smaller(larger(u / v, 1e-3), 1e3) } else { 1.0 };
        ratio * ((1.0 - self.relaxation) + self.relaxation * ratio)
    }

    /// An energy over the level, without what the point itself has lifted that by: of `share` of the samples that the level rests on.
    pub(super) fn without_own(&self, energy: f32, share: f32) -> f32 {
        let [follows, kept] = self.own;
        let own = smaller(share * follows, MOST_OWN);
        energy * (1.0 - own) / (1.0 - own * (smaller(energy, self.levels) * kept))
    }
}

/// Factors of the profile's exponentials, exp(-t/decay) and exp(-t/decay - t/rise), over some time.
#[derive(Clone, Copy, Debug)]
struct Factors {
    decay: f32,
    rise: f32,
}

impl Factors {
    fn over(time_s: f32, profile: &Profile) -> Self {
        let decay = exp(-time_s / profile.decay_s);
        Self { decay, rise: decay * exp(-time_s / profile.rise_s) }
    }
}

/// How a frame is cut into cells and nodes, and the profile's factors over their parts.
#[derive(Clone, Copy, Debug)]
pub(super) struct LevelSteps {
    profile: Profile,
    sample: Factors,
    cell: Factors,
    /// From a cell's first sample to its middle.
    half_cell: Factors,
    node: Factors,
    /// Samples of a cell; cells from node to node; nodes and samples in the frame.
    cell_samples: usize,
    node_cells: usize,
    nodes: usize,
    samples: usize,
    /// Samples from the first node to the frame.
    lead: usize,
}

impl LevelSteps {
    /// For frames of `samples` samples, with a node at sample `beginning`.
    pub fn new(profile: Profile, sample_spacing_s: f32, samples: usize, beginning: usize) -> Self {
        // Positive and small: truncation is the floor.
        let cell_samples = ((profile.rise_s / sample_spacing_s + 0.5) as usize).max(1);
        // One node more stands ahead of the frame.
        let most = NODES - 1;
        let node_cells = samples.div_ceil(cell_samples).div_ceil(most).max(1);
        // Where nodes are scarce, no further apart than they must be.
        let cell_samples =
            if node_cells > 1 { samples.div_ceil(most).div_ceil(node_cells).max(1) } else { cell_samples };
        let node_samples = (node_cells * cell_samples).max(1);
        let lead = (node_samples - beginning % node_samples) % node_samples;
        let over = |samples: f32| Factors::over(samples * sample_spacing_s, &profile);
        Self {
            profile,
            sample: over(1.0),
            cell: over(cell_samples as f32),
            half_cell: over(0.5 * (cell_samples as f32 - 1.0)),
            node: over(node_samples as f32),
            cell_samples,
            node_cells,
            nodes: (samples + lead).div_ceil(node_samples),
            samples,
            lead,
        }
    }

    fn node_samples(&self) -> usize {
        self.node_cells * self.cell_samples
    }

    /// The samples, from and to, of the cell that begins so many after the first node: none where it is ahead of the frame.
    fn cell_at(&self, first: usize) -> (usize, usize) {
        let within = |place: usize| place.saturating_sub(self.lead).min(self.samples);
        (within(first), within(first + self.cell_samples))
    }
}

/// Walks the level along the samples of a frame: two products per sample instead of two exponentials.
#[derive(Clone, Copy, Debug)]
pub(super) struct LevelWalk<'a> {
    level: &'a NoiseLevel,
    factors: Factors,
    node: usize,
    within: usize,
    decaying: f32,
    rising: f32,
    white: f32,
}

impl<'a> LevelWalk<'a> {
    pub fn new(level: &'a NoiseLevel, steps: &LevelSteps) -> Self {
        let mut walk = Self {
            level,
            factors: steps.sample,
            node: 0,
            within: 0,
            decaying: 0.0,
            rising: 0.0,
            white: level.white,
        };
        for _ in 0..level.lead {
            let _ = walk.next();
        }
        walk
    }

    /// The node at or before the next sample, and how many samples there are up to the next one.
    #[inline]
    pub fn node(&self) -> (usize, usize) {
        (self.node, self.level.node_samples.saturating_sub(self.within))
    }

    /// Goes on to the next node.
    #[inline]
    pub fn leave_node(&mut self) {
        (self.node, self.within) = (self.node + 1, 0);
    }

    /// The level at sample 0, 1, 2, ...
    #[inline]
    pub fn next(&mut self) -> f32 {
        if self.within == 0 {
            self.decaying = self.level.decaying.get(self.node).copied().unwrap_or(0.0);
            self.rising = self.level.rising.get(self.node).copied().unwrap_or(0.0);
        }
        let level = self.white + (self.decaying - ONSET * self.rising);
        self.decaying *= self.factors.decay;
        self.rising *= self.factors.rise;
        self.within += 1;
        if self.within == self.level.node_samples {
            self.leave_node();
        }
        level
    }
}

/// Mean of exponentially distributed powers from those below five times a first guess of it. Cut off there, they
/// have [`TRIMMED_SHARE`] of the full mean, which is undone; iterated, the guess converges.
#[derive(Clone, Copy, Debug)]
struct TrimmedMean {
    guess: f32,
    sum: f32,
    count: u32,
}

impl TrimmedMean {
    fn below(guess: f32) -> Self {
        Self { guess, sum: 0.0, count: 0 }
    }

    fn add(&mut self, power: f32) {
        if power < TRIM * self.guess {
            self.sum += power;
            self.count += 1;
        }
    }

    /// The mean; the guess where no power was below the cut.
    fn mean(&self) -> f32 {
        if self.count > 0 { self.sum / (self.count as f32 * TRIMMED_SHARE) } else { self.guess }
    }
}

/// White noise power from the powers of a frame's samples: the fourth quietest of 16 block means,
/// then three passes of [`TrimmedMean`].
///
/// `powers` is walked four times. The result is at least 1e-12 of the strongest power.
pub(super) fn white_level<I: Iterator<Item = f32>>(powers: impl Fn() -> I, samples: usize) -> f32 {
    let per_block = (samples / BLOCKS).max(1);
    let mut block_means = [f32::INFINITY; BLOCKS];
    let mut strongest = 0.0;
    {
        let mut blocks = block_means.iter_mut();
        let mut sum = 0.0;
        let mut count = 0_usize;
        for power in powers() {
            strongest = larger(power, strongest);
            sum += power;
            count += 1;
            if count == per_block {
                if let Some(mean) = blocks.next() {
                    *mean = sum / per_block as f32;
                }
                sum = 0.0;
                count = 0;
            }
        }
    }
    let mut level = 0.0;
    for _ in 0..4 {
        let mut quietest = f32::INFINITY;
        for &mean in &block_means {
            if mean < quietest {
                quietest = mean;
            }
        }
        if quietest == f32::INFINITY {
            quietest = level;
        }
        for mean in &mut block_means {
            if *mean == quietest {
                *mean = f32::INFINITY;
                break;
            }
        }
        level = larger(level, quietest);
    }
    for _ in 0..3 {
        let mut trimmed = TrimmedMean::below(level);
        powers().for_each(|power| trimmed.add(power));
        level = trimmed.mean();
    }
    larger(level, level_floor(strongest))
}

/// Least white noise beside samples whose strongest power is `strongest`: -120 dB of it, and never zero.
pub(super) fn level_floor(strongest: f32) -> f32 {
    larger(strongest * 1e-12, 1e-30)
}

written!(Profile { decay_s, rise_s });

#[cfg(test)]
mod tests {
    use super::*;
    use rand_core::{Rng, SeedableRng};

    #[test]
    fn the_white_level_is_found_beside_strong_paths() {
        let mut rng = rand_xoshiro::Xoshiro128PlusPlus::seed_from_u64(4);
        let mut mean = 0.0;
        for _ in 0..50 {
            let mut powers = [0.0_f32; 400];
            for (n, power) in powers.iter_mut().enumerate() {
                let uniform = (rng.next_u32() as f32 + 1.0) / 4_294_967_808.0;
                *power = -3.0 * uniform.ln() + if (100..130).contains(&n) { 400.0 } else { 0.0 };
            }
            mean += white_level(|| powers.iter().copied(), 400) / 50.0;
        }
        assert!((mean / 3.0 - 1.0).abs() < 0.06, "{mean}");
    }

    #[test]
    fn the_walk_and_the_level_agree() {
        let steps = LevelSteps::new(Profile::new(0.425e-9, &EstimatorSettings::default()), 0.25e-9, 400, 0);
        let mut noise = NoiseLevel::open(0.5, &steps);
        noise.weights[3] = 2.0;
        noise.accumulate(&steps);
        let mut walk = LevelWalk::new(&noise, &steps);
        for n in 0..400 {
            let walked = walk.next();
            assert!((walked - noise.level(n as f32, 0.25e-9)).abs() < 1e-4 * walked, "{n}");
        }
        assert_eq!(noise.level(-1.0, 0.25e-9), 0.5);
    }

    /// Powers whose mean is a profile that begins somewhere: the level follows it.
    #[test]
    fn the_level_follows_dense_multipath_wherever_it_begins() {
        let mut rng = rand_xoshiro::Xoshiro128PlusPlus::seed_from_u64(4);
        let steps = LevelSteps::new(Profile::new(0.425e-9, &EstimatorSettings::default()), 0.25e-9, 400, 0);
        for onset in [0.0_f32, 57.0, 200.0] {
            let truth = |n: usize| {
                let t = (n as f32 - onset) * 0.25;
                let profile = if t < 0.0 { 0.0 } else { (1.0 - 0.98 * (-t / 5.0).exp()) * (-t / 20.0).exp() };
                2.0 + 20.0 * profile
            };
            let (mut error, mut count) = (0.0, 0.0);
            let (mut power, mut mean_delay_s, mut spread_s) = (0.0, 0.0, 0.0);
            for _ in 0..40 {
                let mut powers = [0.0_f32; 400];
                for (n, power) in powers.iter_mut().enumerate() {
                    let uniform = (rng.next_u32() as f32 + 1.0) / 4_294_967_808.0;
                    *power = -truth(n) * uniform.ln();
                }
                let mut noise = NoiseLevel::open(white_level(|| powers.iter().copied(), 400), &steps);
                for _ in 0..16 {
                    noise.refine(&steps, &COMPLEX_CUT, 1e-9, |Cell { from, to, .. }, cut| {
                        let mut sum = CutPowers::default();
                        powers[from..to].iter().for_each(|power| sum.add(*power, cut));
                        sum
                    });
                }
                let dense = noise.dense_multipath(0.0, 0.25e-9, 0.4e-9);
                power += dense.power / 40.0;
                mean_delay_s += dense.mean_delay_s / 40.0;
                spread_s += dense.rms_delay_spread_s / 40.0;
                for n in (0..400).step_by(5) {
                    error += (noise.level(n as f32, 0.25e-9) / truth(n)).ln().powi(2);
                    count += 1.0;
                }
            }
            // The profile's integral is 16.08 ns, its mean 23.9 ns, its deviation 20.4 ns.
            assert!((power / (20.0 * 16.08e-9 / 0.4e-9) - 1.0).abs() < 0.2, "onset {onset}: {power}");
            let mean_s = onset * 0.25e-9 + 23.9e-9;
            assert!((mean_delay_s - mean_s).abs() < 5e-9, "onset {onset}: {mean_delay_s}");
            // White noise takes part of the tail.
            assert!((spread_s - 20.4e-9).abs() < 7e-9, "onset {onset}: {spread_s}");
            let deviation = (error / count).sqrt();
            assert!(deviation < 0.25, "onset {onset}: {deviation}");
        }
    }
}
