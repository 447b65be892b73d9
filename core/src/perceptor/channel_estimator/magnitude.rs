//! Magnitude-only mode, for radios that log no phase.
//!
//! Stated model: y(t) = sum_k a_k exp(j phi_k) R(t - tau_k) + n(t), of which |y| is known. Noise and dense multipath
//! have the same level lambda(t) as in complex frames, since |n|^2 is exponentially distributed whatever its phase.
//! Magnitudes do not add up, and the phase of one path against another is unknown: two paths that make one maximum are
//! reported as one, somewhere between them, and maxima closer than 0.8 pulse durations are one path's; beside a path whose neighbour
//! has the energy E at its delay, the neighbour's overlap shifts the delay. The SINR counts this overlap as noise.
//!
//! One path: three samples m_i half a pulse apart, around a maximum of |y|, are fitted with a R(t_i - tau). Turned by
//! phi, y has the path in its real part, and there noise of variance lambda / 2 and correlation R. Given a and tau the
//! expectation of that real part is m A(2 m a R / lambda), A = I_1 / I_0: this undoes the bias of a Rice distributed
//! magnitude, and gives a sample far from the pulse no say. Expectation and generalised least squares alternate. At
//! two samples per pulse the three hold all of the delay's information but 6 % (variance).
//!
//! A path is kept where the energy that stronger paths cannot explain, whatever their phases,
//! (a - sum_j a_j |R(tau - tau_j)|)^2, exceeds kappa lambda: side lobes stay out by the pulse's own shape. A path
//! whose pulse is cut off by the frame's ends (half a pulse) is not looked for.

use super::beginning::{Beginning, Tail};
use super::noise::{
    Cell, CellPowers, CutPowers, LevelSteps, LevelWalk, MAGNITUDE_CUT, NoiseLevel, level_floor, white_level,
};
use super::work::{FIT, FrameWork, LEVEL, MAXIMUM};
use super::{ChannelEstimate, ChannelEstimator, Path, SPARE_ROUNDS};
use crate::radio::pulse::PulseTable;
use crate::real::{abs, larger, limited, sqrt};
use heapless::Vec;

/// Capacity: passes of the noise fit before the first path, which bound its time.
pub const FIRST_REFINEMENTS: usize = 6;
/// Capacity: passes of the noise fit before each further path, which bound its time.
pub const REFINEMENTS: usize = 2;
/// Capacity: passes of the fit of one path, which bound its time.
pub const PASSES: usize = 6;
/// Guard: against a path midway between two samples that noise lowers further: share of its energy that the larger one keeps,
/// nearly always.
pub const SCALLOPING: f32 = 0.8;
/// Guard: against paths in the noise fit, which cannot subtract them without their phases: it leaves out samples in which
/// they have more energy than this, over the level.
pub const EXPLAINED: f32 = 0.5;
/// Guard: against finding one path twice: maxima closer than this to a path found are its own, pulse durations.
pub const OWN_PULSES: f32 = 0.8;
/// Mathematics: half the interval of the pulse's numerical slope, pulse durations.
pub const SLOPE_PULSES: f32 = 0.0625;
/// Guard: against a singular variance of the three samples, to which it is added: the tabulated pulse is not quite positive
/// definite.
pub const RIDGE: f32 = 1e-3;

/// One path while it is being estimated.
#[derive(Clone, Copy, Debug)]
struct Peak {
    /// Sample of the maximum.
    sample: usize,
    /// Delay, samples into the frame.
    position: f32,
    amplitude: f32,
    /// Level of noise and dense multipath at the delay.
    level: f32,
    /// Energy that the other paths cannot explain, over the level.
    gain: f32,
    /// kappa: with no more gain it is none.
    threshold: f32,
}

/// A frame and what is known of it.
struct Search<'a, const PATHS: usize> {
    estimator: &'a ChannelEstimator<PATHS>,
    samples: &'a [f32],
    peaks: Vec<Peak, PATHS>,
    noise: &'a mut NoiseLevel,
    /// Powers of the samples as they are.
    cells: CellPowers,
    /// Done so far.
    work: FrameWork,
    triple: Triple,
    /// kappa in this frame.
    threshold: f32,
}

impl<const PATHS: usize> ChannelEstimator<PATHS> {
    pub(super) fn estimate_magnitude(
        &self,
        samples: &[f32],
        first_sample_delay_s: f32,
        most_work: u32,
    ) -> ChannelEstimate<PATHS> {
        let white = white_level(|| samples.iter().map(|m| m * m), samples.len());
        let strongest = samples.iter().map(|m| m * m).fold(0.0, larger);
        let powers = |n: usize| samples.get(n).map_or(0.0, |m| m * m);
        let threshold = self.magnitude_threshold * white;
        let beginning = Beginning::find(powers, samples.len(), self.sample_spacing_s, threshold);
        let begins = beginning.filter(|_| self.settings.begins_with_path).map(|beginning| beginning.sample);
        let steps = LevelSteps::new(self.profile, self.sample_spacing_s, samples.len(), begins.unwrap_or(0));
        let mut estimate = self.without_paths(NoiseLevel::open(white, &steps));
        let mut fit = Search {
            estimator: self,
            samples,
            peaks: Vec::new(),
            noise: &mut estimate.noise,
            cells: CellPowers::new(&steps, powers),
            work: FrameWork::of(samples.len(), most_work),
            triple: Triple::new(&self.table),
            threshold: self.magnitude_threshold,
        };
        if let Some(peak) = begins.and_then(|sample| fit.fit(None, sample)) {
            // There is room.
            let _ = fit.peaks.push(peak);
        }
        for _ in 0..FIRST_REFINEMENTS {
            fit.fit_noise(&steps, level_floor(strongest));
        }
        fit.work.begin_search(samples.len() / 2);
        if let Some(Beginning { ahead, .. }) = beginning {
            fit.measure_tail(ahead, &steps);
        }
        if begins.is_some() {
            fit.refit();
        }
        for round in 0..PATHS + SPARE_ROUNDS {
            // A path at the beginning that is none was left out of the level.
            if round > 0 || begins.is_some() {
                for _ in 0..REFINEMENTS {
                    fit.fit_noise(&steps, level_floor(strongest));
                }
                fit.refit();
            }
            if fit.work.is_used_up() || !fit.add_strongest() {
                break;
            }
        }
        estimate.threshold = fit.threshold;
        (estimate.work, estimate.cut_short) = (fit.work.done(), fit.work.is_cut_short());
        fit.take_paths(first_sample_delay_s, &mut estimate.paths);
        estimate.dense = self.dense_multipath(&estimate.noise, first_sample_delay_s);
        estimate
    }
}

impl<const PATHS: usize> Search<'_, PATHS> {
    /// One pass over the powers beside the paths refines the levels of white noise and dense multipath.
    fn fit_noise(&mut self, steps: &LevelSteps, floor: f32) {
        let (estimator, peaks, samples, cells) = (self.estimator, &self.peaks, self.samples, &self.cells);
        let support = estimator.table.support_samples();
        let reached = peaks.len() * ((2.0 * support) as usize).min(samples.len());
        self.work.add_pass(LEVEL, samples.len(), reached);
        self.noise.refine(steps, &MAGNITUDE_CUT, floor, |Cell { node, from, to }, cut| {
            // Those whose pulses end before the cell, or begin after it, explain nothing there.
            let mut reaching: Vec<&Peak, PATHS> = Vec::new();
            for peak in peaks {
                if peak.position + support >= from as f32 && peak.position - support <= to as f32 {
                    // As many as paths at most: the push succeeds.
                    let _ = reaching.push(peak);
                }
            }
            if reaching.is_empty()
                && let Some(sum) = cells.below(node, cut)
            {
                return CutPowers::whole(sum, to - from);
            }
            let mut powers = CutPowers::default();
            // Counted in floats, exact for any frame.
            let mut place = from as f32;
            for sample in samples.get(from..to).unwrap_or(&[]) {
                let explained = reaching.iter().any(|peak| {
                    let share = peak.amplitude * estimator.table.at(place - peak.position);
                    share * share > EXPLAINED * peak.level
                });
                if !explained {
                    powers.add(sample * sample, cut);
                }
                place += 1.0;
            }
            powers
        });
    }

    /// The threshold, from the tail of the noise in so many samples ahead of the response.
    fn measure_tail(&mut self, ahead: usize, steps: &LevelSteps) {
        let mut walk = LevelWalk::new(self.noise, steps);
        let tail = Tail::of(self.samples.iter().take(ahead).map(|sample| sample * sample / walk.next()));
        self.threshold = tail.threshold(self.estimator.magnitude_threshold);
        for peak in &mut self.peaks {
            peak.threshold = tail.threshold(self.estimator.beginning_threshold);
        }
    }

    /// Adds the path with the largest gain above kappa; false where there is none or no room.
    fn add_strongest(&mut self) -> bool {
        // A path midway between two samples looks this weak: what falls short by more need not be fitted.
        let midway = self.estimator.table.at(0.5);
        let mut floor = SCALLOPING * (midway * midway) * self.threshold;
        let mut best: Option<Peak> = None;
        let own_samples = OWN_PULSES * self.estimator.table.samples_per_pulse();
        for (n, window) in (1..).zip(self.samples.windows(3)) {
            let &[before, here, after] = window else { continue };
            if here < before || here <= after {
                continue;
            }
            if self.work.is_used_up() {
                break;
            }
            // A path's own.
            if self.peaks.iter().any(|peak| abs(n as f32 - peak.position) < own_samples) {
                continue;
            }
            self.work.add(MAXIMUM, self.peaks.len());
            let unexplained = self.unexplained(None, n as f32, here);
            let energy = unexplained * unexplained;
            // The level is nowhere below the white noise, which costs no exponentials.
            if energy <= floor * self.noise.white
                || energy <= floor * self.noise.level(n as f32, self.estimator.sample_spacing_s)
            {
                continue;
            }
            self.work.add(FIT, self.peaks.len());
            let Some(peak) = self.fit(None, n) else { continue };
            let stronger = best.is_none_or(|best| peak.gain > best.gain);
            if peak.gain > self.threshold && stronger {
                floor = SCALLOPING * (midway * midway) * peak.gain;
                best = Some(peak);
            }
        }
        best.is_some_and(|peak| self.peaks.push(peak).is_ok())
    }

    /// What is left of a magnitude when all paths but `own` are taken off it, whatever their phases.
    fn unexplained(&self, own: Option<usize>, position: f32, magnitude: f32) -> f32 {
        let mut left = magnitude;
        for (k, peak) in self.peaks.iter().enumerate() {
            if own != Some(k) {
                left -= peak.amplitude * abs(self.estimator.table.at(position - peak.position));
            }
        }
        larger(left, 0.0)
    }

    /// Fits every path again at the present level and beside the others; drops the weakest that fell below kappa.
    fn refit(&mut self) {
        for k in 0..self.peaks.len() {
            let Some(sample) = self.peaks.get(k).map(|peak| peak.sample) else { return };
            self.work.add(FIT, self.peaks.len());
            let refitted = self.fit(Some(k), sample);
            if let (Some(peak), Some(refitted)) = (self.peaks.get_mut(k), refitted) {
                *peak = refitted;
            }
        }
        let mut weakest: Option<(usize, f32)> = None;
        for (k, peak) in self.peaks.iter().enumerate() {
            if peak.gain <= peak.threshold && weakest.is_none_or(|(_, gain)| peak.gain < gain) {
                weakest = Some((k, peak.gain));
            }
        }
        if let Some((weakest, _)) = weakest {
            // In order: the first found stays the first reported.
            let mut k = 0;
            self.peaks.retain(|_| {
                k += 1;
                k - 1 != weakest
            });
        }
    }

    /// The path whose maximum is sample `n`, beside all others but `own`; none at the frame's ends.
    fn fit(&self, own: Option<usize>, n: usize) -> Option<Peak> {
        let table = &self.estimator.table;
        let stride = self.triple.stride;
        let places = [n.checked_sub(stride)?, n, n + stride];
        let level = self.noise.level(n as f32, self.estimator.sample_spacing_s);
        let mut magnitudes = [0.0; 3];
        let mut levels = [level; 3];
        for ((place, magnitude), level) in places.iter().zip(&mut magnitudes).zip(&mut levels) {
            *magnitude = *self.samples.get(*place)?;
            // A neighbour's phase is unknown: its energy counts as noise.
            for (k, peak) in self.peaks.iter().enumerate() {
                if own != Some(k) {
                    let share = peak.amplitude * table.at(*place as f32 - peak.position);
                    *level += share * share;
                }
            }
        }
        let [_, here, _] = magnitudes;
        let reach = stride as f32;
        let slope_samples = SLOPE_PULSES * table.samples_per_pulse();
        let mut amplitude = here;
        let mut shift = 0.0;
        for _ in 0..PASSES {
            let mut shape = [0.0; 3];
            let mut slope = [0.0; 3];
            let mut misfit = [0.0; 3];
            let lags = [-reach - shift, -shift, reach - shift];
            for (i, lag) in lags.iter().enumerate() {
                let (Some(shape), Some(slope), Some(misfit)) =
                    (shape.get_mut(i), slope.get_mut(i), misfit.get_mut(i))
                else {
                    continue;
                };
                let (Some(&magnitude), Some(&level)) = (magnitudes.get(i), levels.get(i)) else { continue };
                *shape = table.at(*lag);
                *slope =
                    (table.at(*lag - slope_samples) - table.at(*lag + slope_samples)) / (2.0 * slope_samples);
                let coherence = alignment(2.0 * (magnitude / level) * (amplitude * *shape));
                *misfit = magnitude * coherence / amplitude - *shape;
            }
            let [shape, slope, misfit] = [shape, slope, misfit].map(Triple::parts);
            let shape_shape = self.triple.inner(&shape, &shape);
            let shape_slope = self.triple.inner(&shape, &slope);
            let slope_slope = self.triple.inner(&slope, &slope);
            let shape_misfit = self.triple.inner(&shape, &misfit);
            let slope_misfit = self.triple.inner(&slope, &misfit);
            let determinant = shape_shape * slope_slope - shape_slope * shape_slope;
            if !(determinant > 1e-6 * (shape_shape * slope_slope)) {
                break;
            }
            let growth = (slope_slope * shape_misfit - shape_slope * slope_misfit) / determinant;
            let move_samples = (shape_shape * slope_misfit - shape_slope * shape_misfit) / determinant;
            amplitude *= 1.0 + limited(growth, -0.5, 1.0);
            // The maximum is the sample in the middle: the path is not far from it.
            shift = limited(
                shift + limited(move_samples, -0.5 * reach, 0.5 * reach),
                -0.75 * reach,
                0.75 * reach,
            );
        }
        let position = n as f32 + shift;
        let left = self.unexplained(own, position, amplitude);
        // Half the noise power is missing from the square of the fitted amplitude.
        let gain = left * left / level + 0.5;
        let threshold = own.and_then(|k| self.peaks.get(k)).map_or(self.threshold, |peak| peak.threshold);
        Some(Peak { sample: n, position, amplitude, level, gain, threshold })
    }

    /// Power that the other paths' overlap is worth beside path `own`, by how far it moves the delay: a neighbour's
    /// energy times the square of the pulse's slope there, over the pulse's curvature at its peak.
    fn overlap(&self, own: usize, position: f32) -> f32 {
        let table = &self.estimator.table;
        let slope_samples = SLOPE_PULSES * table.samples_per_pulse();
        let curvature = 2.0 * (1.0 - table.at(slope_samples)) / (slope_samples * slope_samples);
        let mut overlap = 0.0;
        for (k, peak) in self.peaks.iter().enumerate() {
            if k != own {
                let lag = position - peak.position;
                let slope =
                    (table.at(lag + slope_samples) - table.at(lag - slope_samples)) / (2.0 * slope_samples);
                overlap += peak.amplitude * peak.amplitude * (slope * slope / curvature);
            }
        }
        overlap
    }

    fn take_paths(self, first_sample_delay_s: f32, paths: &mut Vec<Path, PATHS>) {
        for (k, peak) in self.peaks.iter().enumerate() {
            let level = peak.level + self.overlap(k, peak.position);
            let sinr = peak.amplitude * peak.amplitude / level - 0.5;
            let amplitude = [peak.amplitude, 0.0];
            // Capacities are equal: every push succeeds.
            let _ = paths.push(self.estimator.path(peak.position, first_sample_delay_s, amplitude, sinr));
        }
    }
}

/// Three samples about half a pulse apart and the inverse of their noise's correlation R, split into the part of
/// their half difference and that of middle and half sum.
#[derive(Clone, Copy, Debug)]
struct Triple {
    /// Samples between two of them.
    stride: usize,
    odd: f32,
    middle: f32,
    mixed: f32,
    even: f32,
}

impl Triple {
    fn new(table: &PulseTable) -> Self {
        // Positive and small: truncation is the floor.
        let stride = ((0.5 * table.samples_per_pulse() + 0.5) as usize).max(1);
        let near = table.at(stride as f32);
        let far = table.at(2.0 * stride as f32);
        // Variances of (m_+ - m_-) / 2, of the middle and of (m_+ + m_-) / 2, and what the latter two share.
        let odd = 0.5 * (1.0 - far) + RIDGE;
        let even = 0.5 * (1.0 + far) + RIDGE;
        let middle = 1.0 + RIDGE;
        let determinant = larger(middle * even - near * near, RIDGE);
        Self {
            stride,
            odd: 1.0 / odd,
            middle: even / determinant,
            mixed: -near / determinant,
            even: middle / determinant,
        }
    }

    /// Half the difference of the outer two, the middle, and half their sum.
    fn parts([before, here, after]: [f32; 3]) -> [f32; 3] {
        [0.5 * (after - before), here, 0.5 * (after + before)]
    }

    /// u' C^-1 v of the parts of u and v.
    fn inner(&self, [u_odd, u_here, u_even]: &[f32; 3], [v_odd, v_here, v_even]: &[f32; 3]) -> f32 {
        self.odd * (u_odd * v_odd)
            + self.middle * (u_here * v_here)
            + self.mixed * (u_here * v_even + u_even * v_here)
            + self.even * (u_even * v_even)
    }
}

/// I_1(x) / I_0(x), the mean cosine of a phase known with concentration x, by Amos's (1974) bound: exact at both ends,
/// at most 0.033 too small between.
fn alignment(x: f32) -> f32 {
    x / (0.5 + sqrt(x * x + 2.25))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::radio::pulse::Pulse;

    #[test]
    fn the_alignment_is_the_mean_cosine_of_a_concentrated_phase() {
        for concentration in [0.0_f64, 0.3, 1.0, 2.5, 6.0, 40.0] {
            let (mut sum, mut cosines) = (0.0, 0.0);
            for step in 0..10_000 {
                let angle = std::f64::consts::PI * (f64::from(step) + 0.5) / 10_000.0;
                let weight = (concentration * (angle.cos() - 1.0)).exp();
                sum += weight;
                cosines += weight * angle.cos();
            }
            let error = cosines / sum - f64::from(alignment(concentration as f32));
            assert!((-1e-6..0.0331).contains(&error), "{concentration}: {error}");
        }
    }

    /// C^-1 of the three samples' correlations by Gaussian elimination.
    #[test]
    fn the_triple_weights_by_the_inverse_correlation() {
        for (roll_off, spacing_s) in [(0.6, 0.25e-9), (0.25, 0.05e-9), (1.0, 0.4e-9)] {
            let table = PulseTable::new(&Pulse::root_raised_cosine(0.5e-9, roll_off), spacing_s);
            let triple = Triple::new(&table);
            let r = |i: usize, j: usize| f64::from(table.at((i.abs_diff(j) * triple.stride) as f32));
            let u = [0.3_f32, 1.0, -0.2];
            let mut rows: [[f64; 4]; 3] =
                std::array::from_fn(|i| [r(i, 0), r(i, 1), r(i, 2), f64::from(u[i])]);
            for (i, row) in rows.iter_mut().enumerate() {
                row[i] += f64::from(RIDGE);
            }
            for pivot in 0..3 {
                for i in (0..3).filter(|&i| i != pivot) {
                    let factor = rows[i][pivot] / rows[pivot][pivot];
                    let subtracted = rows[pivot].map(|entry| factor * entry);
                    for (entry, subtracted) in rows[i].iter_mut().zip(subtracted) {
                        *entry -= subtracted;
                    }
                }
            }
            let v = [0.7_f32, 0.4, 0.9];
            let expected: f64 = (0..3).map(|i| f64::from(v[i]) * rows[i][3] / rows[i][i]).sum();
            let error = f64::from(triple.inner(&Triple::parts(u), &Triple::parts(v))) / expected - 1.0;
            assert!(error.abs() < 0.02, "roll-off {roll_off}: {error}");
        }
    }
}
