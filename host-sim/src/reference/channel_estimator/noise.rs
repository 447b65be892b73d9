//! The level of what is not a path: white noise N0, and dense multipath that may begin anywhere,
//!
//! lambda(n) = N0 + sum over nodes j of theta_j (1 - chi exp(-t/rise)) exp(-t/decay), t = (n - n_j) T_s >= 0.
//!
//! theta and N0 climb the likelihood of exponentially distributed powers by theta_j <- theta_j (U_j / V_j)^2, with U_j and
//! V_j the sums over n of the node's profile times |r|^2 / lambda^2 (cut off) and times 1 / lambda. The profile is the
//! difference of two exponentials; both are carried apart.

use crate::reference::real::{Real, exp, larger, smaller, sqrt, square};
use cogmint_core::perceptor::channel_estimator::EstimatorSettings;
use cogmint_core::perceptor::channel_estimator::noise::{
    BLOCKS, Cut, FIRST_SHARE, NODES, ONSET, RISE_DECAYS, TRIM, TRIMMED_SHARE,
};

/// The dense multipath of a frame: power (integral of its profile), mean delay, root mean square delay spread.
#[derive(Clone, Copy, Debug)]
pub struct DenseMultipath<T> {
    /// Squared units of the samples.
    pub power: T,
    /// Seconds.
    pub mean_delay_s: T,
    /// Seconds.
    pub rms_delay_spread_s: T,
}

/// The noise of a frame.
#[derive(Clone, Debug)]
pub struct NoiseLevel<T> {
    /// N0.
    pub white: T,
    /// The decay and rise times of a profile.
    decay_s: T,
    rise_s: T,
    /// theta_j.
    theta: Vec<T>,
    /// At each node, sums over all nodes up to it: of theta exp(-t/decay), and of theta exp(-t/decay) exp(-t/rise).
    sums: Vec<[T; 2]>,
    /// Samples of a cell, and from node to node.
    cell_samples: usize,
    node_samples: usize,
    /// Samples from the first node to the frame.
    ahead: usize,
    /// Nodes in all.
    nodes: usize,
    sample_spacing_s: T,
}

impl<T: Real> NoiseLevel<T> {
    /// The decay and rise times for a pulse of the effective duration `effective_duration_s`.
    pub(super) fn profile(effective_duration_s: T, settings: &EstimatorSettings) -> [T; 2] {
        let least_s = T::of(settings.dense_decay_pulses) * effective_duration_s;
        let decay_s = larger(T::of(settings.dense_decay_s), least_s);
        [decay_s, T::of(RISE_DECAYS) * decay_s]
    }

    /// White noise and a little dense multipath from every node of a frame, one of which is at sample `beginning`.
    pub(super) fn everywhere(
        white: T,
        [decay_s, rise_s]: [T; 2],
        samples: usize,
        sample_spacing_s: T,
        beginning: usize,
    ) -> Self {
        let mut cell_samples = ((rise_s / sample_spacing_s + T::of(0.5)).whole() as usize).max(1);
        let node_cells = samples.div_ceil(cell_samples).div_ceil(NODES - 1).max(1);
        if node_cells > 1 {
            cell_samples = samples.div_ceil(NODES - 1).div_ceil(node_cells);
        }
        let node_samples = node_cells * cell_samples;
        // The least number of samples ahead that makes `beginning` a multiple of the nodes' distance.
        let ahead =
            (0..node_samples).find(|ahead| (beginning + ahead).is_multiple_of(node_samples)).unwrap_or(0);
        let nodes = (samples + ahead).div_ceil(node_samples);
        let (theta, sums) = (vec![T::ZERO; NODES], vec![[T::ZERO; 2]; NODES]);
        let mut level = Self {
            white,
            decay_s,
            rise_s,
            theta,
            sums,
            cell_samples,
            node_samples,
            ahead,
            nodes,
            sample_spacing_s,
        };
        for j in 0..nodes {
            level.theta[j] = T::of(FIRST_SHARE) * white;
        }
        level.sum_up();
        level
    }

    /// Both exponentials after a number of samples.
    fn exponentials(&self, samples: T) -> [T; 2] {
        let time_s = samples * self.sample_spacing_s;
        let decay = exp(-time_s / self.decay_s);
        [decay, decay * exp(-time_s / self.rise_s)]
    }

    fn sum_up(&mut self) {
        let step = self.exponentials(T::of_count(self.node_samples));
        let mut sum = [T::ZERO; 2];
        for j in 0..self.nodes {
            for part in 0..2 {
                sum[part] = sum[part] * step[part] + self.theta[j];
            }
            self.sums[j] = sum;
        }
    }

    /// lambda at one position.
    pub fn at(&self, position: T, sample_spacing_s: T) -> T {
        if position < T::ZERO {
            return self.white;
        }
        let position = position + T::of_count(self.ahead);
        let node = (position.whole() as usize / self.node_samples).min(NODES - 1);
        let past_s = (position - T::of_count(node * self.node_samples)) * sample_spacing_s;
        let [decaying, rising] = self.sums[node];
        let decay = exp(-past_s / self.decay_s);
        self.white + (decaying - T::of(ONSET) * rising * exp(-past_s / self.rise_s)) * decay
    }

    /// lambda at all samples. Order: from each node on, both sums are carried by multiplication.
    pub(super) fn at_samples(&self, samples: usize) -> Vec<T> {
        let step = self.exponentials(T::ONE);
        let mut levels = Vec::new();
        let mut sum = [T::ZERO; 2];
        for n in 0..self.ahead + samples {
            if n % self.node_samples == 0 {
                sum = self.sums.get(n / self.node_samples).copied().unwrap_or([T::ZERO; 2]);
            }
            levels.push(self.white + (sum[0] - T::of(ONSET) * sum[1]));
            sum = [sum[0] * step[0], sum[1] * step[1]];
        }
        levels.split_off(self.ahead)
    }

    /// Moments of the sum of all nodes' profiles. Order: those of the nodes, then those of one profile.
    pub(super) fn dense_multipath(
        &self,
        first_sample_delay_s: T,
        sample_spacing_s: T,
        effective_duration_s: T,
    ) -> DenseMultipath<T> {
        let num = T::of;
        let mut moments = [T::ZERO; 3];
        for (j, theta) in self.theta.iter().enumerate() {
            let time_s = (T::of_count(j * self.node_samples) - T::of_count(self.ahead)) * sample_spacing_s;
            moments[0] += *theta;
            moments[1] += *theta * time_s;
            moments[2] += *theta * square(time_s);
        }
        if moments[0] <= T::ZERO {
            let none = T::ZERO;
            return DenseMultipath {
                power: none,
                mean_delay_s: first_sample_delay_s,
                rms_delay_spread_s: none,
            };
        }
        let slow = self.decay_s;
        let fast = slow * self.rise_s / (slow + self.rise_s);
        let chi = num(ONSET);
        let integral = slow - chi * fast;
        let mean = (square(slow) - chi * square(fast)) / integral;
        let square_mean = num(2.0) * (square(slow) * slow - chi * (square(fast) * fast)) / integral;
        let node_mean = moments[1] / moments[0];
        let variance = (moments[2] / moments[0] - square(node_mean)) + (square_mean - square(mean));
        DenseMultipath {
            power: moments[0] * integral / effective_duration_s,
            mean_delay_s: first_sample_delay_s + (node_mean + mean),
            rms_delay_spread_s: sqrt(larger(variance, T::ZERO)),
        }
    }

    /// One update of N0 and all theta from the residual's powers; those that are `None` are left out.
    pub(super) fn update(&mut self, cut: &Cut, powers: &[Option<T>], floor: T) {
        let num = T::of;
        let cell_step = self.exponentials(T::of_count(self.cell_samples));
        let middle = self.exponentials(num(0.5) * (T::of_count(self.cell_samples) - T::ONE));
        let node_step = self.exponentials(T::of_count(self.node_samples));
        let mut all = [T::ZERO; 2];
        let powers = [&vec![None; self.ahead], powers].concat();
        // From each node on: sums of |r|^2 / lambda^2, cut off, and of 1 / lambda over the cells, weighted with both
        // exponentials at the cells' middles. Order: from the last node to the first.
        let mut after = [[T::ZERO; 2]; 2];
        for (j, of_node) in powers.chunks(self.node_samples).enumerate().rev() {
            let mut own = [[T::ZERO; 2]; 2];
            let mut weight = middle;
            for cell in of_node.chunks(self.cell_samples) {
                let [decaying, rising] = [0, 1].map(|part| self.sums[j][part] * weight[part]);
                let level = self.white + (decaying - num(ONSET) * rising);
                let mut sum = T::ZERO;
                let mut count = 0;
                for power in cell.iter().flatten() {
                    sum += smaller(*power, num(cut.levels) * level);
                    count += 1;
                }
                let inverse = T::ONE / level;
                // Order: (sum / lambda) (1 / lambda / kept), which does not underflow.
                let u = (sum * inverse) * (inverse * (T::ONE / num(cut.kept)));
                let terms = [u, T::of_count(count) * inverse];
                for term in 0..2 {
                    all[term] += terms[term];
                    for part in 0..2 {
                        own[part][term] += weight[part] * terms[term];
                    }
                }
                weight = [weight[0] * cell_step[0], weight[1] * cell_step[1]];
            }
            for part in 0..2 {
                for term in 0..2 {
                    after[part][term] = own[part][term] + node_step[part] * after[part][term];
                }
            }
            let [u, v] = [0, 1].map(|term| after[0][term] - num(ONSET) * after[1][term]);
            self.theta[j] *= factor(cut, u, v);
        }
        self.white = larger(self.white * factor(cut, all[0], all[1]), floor);
        self.sum_up();
    }
}

/// The square of u / v, this within 1e-3 to 1e3, or 1 where there was nothing to see.
fn factor<T: Real>(cut: &Cut, u: T, v: T) -> T {
    let x = if v > T::ZERO { smaller(larger(u / v, T::of(1e-3)), T::of(1e3)) } else { T::ONE };
    let relaxation = T::of(cut.relaxation);
    x * ((T::ONE - relaxation) + relaxation * x)
}

/// Mean of exponentially distributed powers from those below five times a guess of it; the guess if there are none.
pub(super) fn trimmed_mean<T: Real>(powers: &[T], guess: T) -> T {
    let mut sum = T::ZERO;
    let mut count = 0;
    for power in powers {
        if *power < T::of(TRIM) * guess {
            sum += *power;
            count += 1;
        }
    }
    if count > 0 { sum / (T::of_count(count) * T::of(TRIMMED_SHARE)) } else { guess }
}

/// White noise of a frame: the fourth quietest of 16 block means, then three trimmed means.
pub(super) fn white_level<T: Real>(powers: &[T]) -> T {
    let per_block = (powers.len() / BLOCKS).max(1);
    let mut strongest = T::ZERO;
    for power in powers {
        strongest = larger(*power, strongest);
    }
    let mut means = Vec::new();
    for block in powers.chunks_exact(per_block).take(BLOCKS) {
        let mut sum = T::ZERO;
        for power in block {
            sum += *power;
        }
        means.push(sum / T::of_count(per_block));
    }
    means.sort_by(|a, b| a.to_f64().total_cmp(&b.to_f64()));
    // Frames have at least 16 samples, so there are 16 blocks.
    let mut level = means[3];
    for _ in 0..3 {
        level = trimmed_mean(powers, level);
    }
    larger(level, level_floor(strongest))
}

/// Least white noise beside samples whose strongest power is `strongest`.
pub fn level_floor<T: Real>(strongest: T) -> T {
    larger(strongest * T::of(1e-12), T::of(1e-30))
}
