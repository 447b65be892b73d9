//! What a cycle costs, counted while it goes on: about in instructions of a Cortex-M4F. The paths of frames count their own
//! ([`crate::perceptor::channel_estimator::work`]).
//!
//! The costs of single things are fitted to instructions counted on the target; `tests/hardest_cycle.sh` compares the sums with them.

/// Mathematics: cost of a cycle in which nothing is heard.
pub const CYCLE: u32 = 60_000;
/// Mathematics: cost of a component of the belief in a cycle: prediction, and what stands in its way.
pub const COMPONENT: u32 = 6_000;
/// Mathematics: cost of weighing a place by a source, and by each of its scan's measurements.
pub const PLACE: [u32; 2] = [460, 46];
/// Mathematics: cost of comparing a component with a scan.
pub const COMPARISON: u32 = 12_700;
/// Mathematics: cost of a source there, and of a measurement beside it.
pub const SOURCE: [u32; 2] = [2_670, 40];
/// Mathematics: cost of what two measurements say of the background of each other.
pub const BACKGROUND: u32 = 12;
/// Mathematics: cost of a measurement within the gate of a source.
pub const GATED: u32 = 300;
/// Mathematics: cost of how near two paths of a frame are.
pub const PAIR: u32 = 190;
/// Mathematics: cost of a leg of a path that may cross a wall.
pub const LEG: u32 = 290;
/// Mathematics: cost of a feature in a pass of the exact association.
pub const STEP: u32 = 400;
/// Mathematics: cost of what a feature may take in a state of the exact association.
pub const TAKING: u32 = 35;
/// Mathematics: cost of a message of the loopy association.
pub const MESSAGE: u32 = 75;
/// Mathematics: cost of an update of the state.
pub const UPDATE: u32 = 3_200;
/// Mathematics: cost of looking for a source in the rest of a frame.
pub const LOOK: u32 = 800;
/// Mathematics: cost of a place where a candidate for a virtual anchor may be, which is expected, and updated.
pub const HYPOTHESIS: u32 = 2_850;
/// Mathematics: cost of what the memories learn of a source.
pub const LESSON: u32 = 1_200;
/// Mathematics: cost of a source in planning, of each action for it, and of each cycle ahead beyond the first.
pub const PLANNED: [u32; 3] = [1_500, 230, 54];
/// Mathematics: what comparing a component with a scan is expected to cost before it is known: of itself, of each source, and of each
/// measurement beside it. Full scans of crowded places cost up to twice that.
pub const EXPECTED: [u32; 3] = [20_000, 6_000, 250];

/// Work done so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Work(u32);

impl Work {
    /// None.
    pub const NONE: Self = Self(0);

    /// Of so many instructions.
    pub const fn of(instructions: u32) -> Self {
        Self(instructions)
    }

    /// About in instructions of a Cortex-M4F.
    pub const fn instructions(self) -> u32 {
        self.0
    }

    /// Counts so many things of this cost.
    pub fn add(&mut self, cost: u32, count: usize) {
        self.0 = self.0.saturating_add(cost.saturating_mul(count as u32));
    }

    /// Counts so many things of the first of these costs, and so many beside each of them of the second one.
    pub fn add_each(&mut self, [once, beside]: [u32; 2], count: usize, others: usize) {
        self.add(once, count);
        self.add(beside, count.saturating_mul(others));
    }

    /// Counts other work too.
    pub fn add_all(&mut self, other: Self) {
        self.0 = self.0.saturating_add(other.0);
    }
}
