//! What a frame costs: counted while it is estimated, about in instructions of a Cortex-M4F, and bounded.
//!
//! Where a frame has cost [`MOST_WORK`], nothing is moved or added any more: what is in hand is ended (one pass of moves, one agreement of
//! all paths, one look at a maximum), the level is refined once if it was not, and the paths found so far are the estimate. Counted is
//! what grows with samples and paths; what each frame costs once is not.

/// Capacity: work on a frame after which nothing more is begun. Less: the weakest of many paths are missed in crowded frames. More: a
/// longer cycle.
pub const MOST_WORK: u32 = 2_000_000;
/// Mathematics: cost of a sample in a pass of the level's fit, and of one in the search for a path.
pub const SAMPLE: [u32; 2] = [40, 20];
/// Mathematics: cost of a sample that a path reaches, beside that, in the same.
pub const REACHED: [u32; 2] = [25, 120];
/// Mathematics: cost of moving a delay once, and of each path taken off there.
pub const MOVE: [u32; 2] = [2000, 180];
/// Mathematics: cost of inverting, over the third power of the size.
pub const INVERSE: u32 = 20;
/// Mathematics: cost of looking at a maximum of magnitudes, and of each path beside it.
pub const MAXIMUM: [u32; 2] = [130, 20];
/// Mathematics: cost of fitting one path to magnitudes, and of each path beside it.
pub const FIT: [u32; 2] = [5200, 250];

/// Work on a frame so far.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Work {
    done: u32,
}

impl Work {
    /// Its cost.
    pub fn done(&self) -> u32 {
        self.done
    }

    /// Whether nothing more may be begun.
    pub fn is_used_up(&self) -> bool {
        self.done >= MOST_WORK
    }

    /// Counts one thing that is done, beside so many paths.
    pub fn add(&mut self, [once, each]: [u32; 2], paths: usize) {
        self.done = self.done.saturating_add(once + each * paths as u32);
    }

    /// Counts a pass over all samples of a frame, some of which paths reach.
    pub fn add_pass(&mut self, pass: Pass, samples: usize, reached: usize) {
        let kind = pass as usize;
        let cost = |costs: [u32; 2]| costs.get(kind).copied().unwrap_or(0);
        let cost = cost(SAMPLE) * samples as u32 + cost(REACHED) * reached as u32;
        self.done = self.done.saturating_add(cost);
    }

    /// Counts the inversion of a matrix of so many rows.
    pub fn add_inverse(&mut self, rows: usize) {
        self.done = self.done.saturating_add(INVERSE * (rows * rows * rows) as u32);
    }
}

/// A pass over the samples.
#[derive(Clone, Copy, Debug)]
pub(super) enum Pass {
    /// Fits the level.
    Level = 0,
    /// Looks for a path.
    Search = 1,
}
