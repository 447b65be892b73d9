//! What a frame costs: counted while it is estimated, about in instructions of a Cortex-M4F, and bounded.
//!
//! Where the search for paths has cost as much as it may ([`crate::config::WorkLimits::frame`]), nothing is moved or added any more: what is
//! in hand is ended (one pass of moves, one agreement of all paths, one look at a maximum), the level is refined once if it was not, and
//! the paths found so far are the estimate. What every frame of as many samples costs, whatever is in it, comes before and is not limited.

/// Capacity: work on the paths of a frame after which nothing more is begun, where nothing else is told.
pub const MOST_WORK: u32 = 1_500_000;
/// Mathematics: cost of what is done once in every frame, and of each of its samples there.
pub const FRAME: [u32; 2] = [160_000, 75];
/// Mathematics: cost of a sample in a pass of the level's fit, and what each path that reaches it adds.
pub const LEVEL: [u32; 2] = [33, 68];
/// Mathematics: the same in the search for a path. Most samples are passed over.
pub const SEARCH: [u32; 2] = [2, 260];
/// Mathematics: cost of moving a delay once, and of each path taken off there.
pub const MOVE: [u32; 2] = [1300, 200];
/// Mathematics: cost of solving for the paths of a cluster: of each, and over the third power of how many they are.
pub const SOLVE: [u32; 2] = [430, 8];
/// Mathematics: cost of looking at a maximum of magnitudes, and of each path beside it.
pub const MAXIMUM: [u32; 2] = [80, 21];
/// Mathematics: cost of fitting one path to magnitudes, and of each path beside it.
pub const FIT: [u32; 2] = [5100, 105];

/// Work on a frame so far.
#[derive(Clone, Copy, Debug)]
pub(super) struct FrameWork {
    done: u32,
    /// Where nothing more is begun: what comes with every frame, and what its search may cost.
    most: u32,
    cut_short: bool,
}

impl FrameWork {
    /// On a frame of so many samples, whose search may cost so much.
    pub fn of(samples: usize, most: u32) -> Self {
        let [frame, sample] = FRAME;
        Self { done: frame + sample * samples as u32, most, cut_short: false }
    }

    /// Its cost.
    pub fn done(&self) -> u32 {
        self.done
    }

    /// From now on paths are looked for, among so many maxima at most.
    pub fn begin_search(&mut self, maxima: usize) {
        let [maximum, _] = MAXIMUM;
        self.most = self.most.saturating_add(self.done + maximum * maxima as u32);
    }

    /// Whether nothing more may be begun, which is noted.
    pub fn is_used_up(&mut self) -> bool {
        let is_used_up = self.done >= self.most;
        self.cut_short |= is_used_up;
        is_used_up
    }

    /// Whether anything was not begun.
    pub fn is_cut_short(&self) -> bool {
        self.cut_short
    }

    /// Counts one thing that is done, beside so many paths.
    pub fn add(&mut self, [once, each]: [u32; 2], paths: usize) {
        self.done = self.done.saturating_add(once + each * paths as u32);
    }

    /// Counts a pass over all samples of a frame, of which paths reach so many, each counted for every path.
    pub fn add_pass(&mut self, [sample, each]: [u32; 2], samples: usize, reached: usize) {
        self.done = self.done.saturating_add(sample * samples as u32 + each * reached as u32);
    }

    /// Counts the solution for a cluster of so many paths.
    pub fn add_solution(&mut self, paths: usize) {
        let [each, cube] = SOLVE;
        let paths = paths as u32;
        self.done = self.done.saturating_add(each * paths + cube * (paths * paths * paths));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::observation::Samples;
    use crate::perceptor::channel_estimator::{ChannelEstimator, EstimatorSettings};
    use crate::radio::pulse::Pulse;
    use rand_core::{Rng, SeedableRng};
    use std::vec::Vec;

    /// Sixty paths of 10 to 50 dB in 1024 samples cost more than there is; three cost what they cost.
    #[test]
    fn a_crowded_frame_ends_where_its_work_does() {
        const SPACING_S: f32 = 0.25e-9;
        let pulse = Pulse::root_raised_cosine(0.5e-9, 0.6);
        let estimator =
            ChannelEstimator::<16>::new(pulse, SPACING_S, 1024, 0.01, EstimatorSettings::default());
        let mut rng = rand_xoshiro::Xoshiro128PlusPlus::seed_from_u64(3);
        let mut uniform = || (rng.next_u32() as f32 + 0.5) / 4_294_967_296.0;
        let mut frame = |paths: usize, within: f32| {
            let mut samples: Vec<[f32; 2]> =
                (0..1024).map(|_| [uniform() - 0.5, uniform() - 0.5].map(|x| 2.4 * x)).collect();
            for _ in 0..paths {
                let (at, size) = (within * uniform(), 10.0_f32.powf(0.5 + 2.0 * uniform()));
                let (sin, cos) = (core::f32::consts::TAU * uniform()).sin_cos();
                for (n, [re, im]) in samples.iter_mut().enumerate() {
                    let r = size * pulse.autocorrelation((n as f32 - at) * SPACING_S / pulse.duration_s);
                    *re += r * cos;
                    *im += r * sin;
                }
            }
            samples
        };
        let mut cut = [0_u32; 2];
        // Close together they are moved against each other; far apart each is a maximum of magnitudes.
        for (paths, within) in [(3, 1000.0), (60, 100.0), (60, 1000.0)] {
            let crowded = paths > 3;
            for _ in 0..10 {
                let complex = frame(paths, within);
                let magnitudes: Vec<f32> = complex.iter().map(|[re, im]| re.hypot(*im)).collect();
                for (cut, samples) in
                    cut.iter_mut().zip([Samples::Complex(&complex), Samples::Magnitude(&magnitudes)])
                {
                    let estimate = estimator.estimate(samples, 0.0).unwrap();
                    assert!(crowded || !estimate.cut_short, "{} of a plain frame", estimate.work);
                    // One pass of moves, the agreement after it, and the level once more.
                    let fixed = FRAME[0] + 1024 * (FRAME[1] + 8 * LEVEL[0]);
                    assert!(estimate.work < fixed + MOST_WORK + MOST_WORK / 2, "{}", estimate.work);
                    *cut += u32::from(estimate.cut_short);
                }
            }
        }
        std::println!("of twenty crowded frames, cut short: {cut:?}, complex and magnitudes");
        assert!(cut.iter().all(|cut| *cut >= 5), "{cut:?}");
    }

    #[test]
    fn the_longest_frame_is_searched_with_the_least_work_too() {
        const SPACING_S: f32 = 0.25e-9;
        let pulse = Pulse::root_raised_cosine(0.5e-9, 0.6);
        let estimator =
            ChannelEstimator::<16>::new(pulse, SPACING_S, 4096, 0.01, EstimatorSettings::default());
        let mut rng = rand_xoshiro::Xoshiro128PlusPlus::seed_from_u64(4);
        let mut noise = || (rng.next_u32() as f32 - 2_147_483_648.0) / 2_147_483_648.0;
        let complex: Vec<[f32; 2]> = (0..4096)
            .map(|n| {
                let r = pulse.autocorrelation((n as f32 - 1000.3) * SPACING_S / pulse.duration_s);
                [40.0 * r + noise(), 20.0 * r + noise()]
            })
            .collect();
        let magnitudes: Vec<f32> = complex.iter().map(|[re, im]| re.hypot(*im)).collect();
        for samples in [Samples::Complex(&complex), Samples::Magnitude(&magnitudes)] {
            let estimate = estimator.estimate_within(samples, 0.0, 10_000).unwrap();
            let [path] = &estimate.paths[..] else { panic!("{:?}", estimate.paths) };
            assert!((path.delay_s / SPACING_S - 1000.3).abs() < 0.2 && estimate.cut_short, "{path:?}");
        }
    }
}
