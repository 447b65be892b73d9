//! A tracker's state as bytes: see [`crate::snapshot`].

use super::{Phase, Tracker};
use crate::snapshot::{self, Digest, STATE, SnapshotError, Written, stored};

impl<
    const ANCHORS: usize,
    const SURFACES: usize,
    const SOURCES: usize,
    const SEGMENTS: usize,
    const PATHS: usize,
    const ACTIONS: usize,
    const COMPONENTS: usize,
    const POINTS: usize,
    const CANDIDATES: usize,
    const FRAMES: usize,
> Tracker<ANCHORS, SURFACES, SOURCES, SEGMENTS, PATHS, ACTIONS, COMPONENTS, POINTS, CANDIDATES, FRAMES>
{
    /// Writes the state between two cycles; the length of the snapshot, bytes. With no buffer, the error tells that length.
    ///
    /// # Errors
    /// [`SnapshotError::Begun`], [`SnapshotError::NotStarted`]; [`SnapshotError::Room`], and nothing is written then.
    pub fn snapshot(&self, buffer: &mut [u8]) -> Result<usize, SnapshotError> {
        self.check_between()?;
        snapshot::write(&STATE, self.digest(), self, buffer)
    }

    /// Goes on from a snapshot of a tracker that was told the same, with the same bits. What follows it in `bytes` is not looked at.
    ///
    /// # Errors
    /// Any but [`SnapshotError::Room`]; nothing has changed then.
    pub fn restore(&mut self, bytes: &[u8]) -> Result<(), SnapshotError> {
        self.check_between()?;
        snapshot::read(&STATE, self.digest(), self, bytes)?;
        self.seals = self.seals.opened();
        Ok(())
    }

    pub(super) fn check_between(&self) -> Result<(), SnapshotError> {
        match self.phase {
            Phase::Empty => Err(SnapshotError::NotStarted),
            Phase::Begun => Err(SnapshotError::Begun),
            Phase::Between => Ok(()),
        }
    }

    /// Digest of what the tracker was told, actions that it may choose ([`Self::restrict`]) among it, and of its capacities: equal for
    /// trackers whose snapshots are interchangeable. It is the same in every cycle; where it is not, something was told, or a bit has
    /// flipped in it.
    pub fn digest(&self) -> u64 {
        let Self { config, anchors, range_biases_m, plan, library, controllers, map, .. } = self;
        let mut digest = Digest::default();
        [ANCHORS, SURFACES, SOURCES, SEGMENTS, PATHS, ACTIONS, COMPONENTS, POINTS, CANDIDATES]
            .write(&mut digest);
        // As long as all trackers took frames, this was not among them.
        if FRAMES == 0 {
            FRAMES.write(&mut digest);
        }
        config.write(&mut digest);
        anchors.write(&mut digest);
        range_biases_m.write(&mut digest);
        plan.write(&mut digest);
        library.write(&mut digest);
        map.write(&mut digest);
        controllers.seed().write(&mut digest);
        controllers.all().iter().for_each(|controller| controller.allowed().write(&mut digest));
        digest.value()
    }
}

stored!(
    Tracker<
        const ANCHORS, const SURFACES, const SOURCES, const SEGMENTS, const PATHS, const ACTIONS, const COMPONENTS, const POINTS,
        const CANDIDATES, const FRAMES
    > {
        receiver, belief, environment, transmission, discovery, clutter, lateness, channel, controllers, cycle, last_heard,
        lever_arm_m
    }
    told { config, anchors, range_biases_m, plan, library, map }
    // Between two cycles nothing is begun.
    made { phase, begun, scans, seals }
);
