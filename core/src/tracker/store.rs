//! A tracker's state as bytes: see [`crate::snapshot`].

use super::Tracker;
use crate::snapshot::{self, Digest, Reader, Sink, SnapshotError, Stored, Written};

impl<
    const ANCHORS: usize,
    const SURFACES: usize,
    const SOURCES: usize,
    const SEGMENTS: usize,
    const PATHS: usize,
    const ACTIONS: usize,
    const COMPONENTS: usize,
    const POINTS: usize,
> Tracker<ANCHORS, SURFACES, SOURCES, SEGMENTS, PATHS, ACTIONS, COMPONENTS, POINTS>
{
    /// Writes the state between two cycles; the length of the snapshot, bytes. With no buffer, the error tells that length.
    ///
    /// # Errors
    /// [`SnapshotError::Begun`]; [`SnapshotError::Room`], and nothing is written then.
    pub fn snapshot(&self, buffer: &mut [u8]) -> Result<usize, SnapshotError> {
        if self.begun.is_some() {
            return Err(SnapshotError::Begun);
        }
        snapshot::write(self.digest(), self, buffer)
    }

    /// Goes on from a snapshot of a tracker that was told the same, with the same bits. What follows it in `bytes` is not looked at.
    ///
    /// # Errors
    /// Any but [`SnapshotError::Room`]; nothing has changed then.
    pub fn restore(&mut self, bytes: &[u8]) -> Result<(), SnapshotError> {
        if self.begun.is_some() {
            return Err(SnapshotError::Begun);
        }
        snapshot::read(self.digest(), self, bytes)
    }

    /// Digest of what the tracker was told, actions that it may choose ([`Self::restrict`]) among it, and of its capacities: equal for trackers whose snapshots are interchangeable. It is the same in
    /// every cycle; where it is not, something was told, or a bit has flipped in it.
    pub fn digest(&self) -> u64 {
        let Self { config, anchors, plan, library, controllers, map, .. } = self;
        let mut digest = Digest::default();
        [ANCHORS, SURFACES, SOURCES, SEGMENTS, PATHS, ACTIONS, COMPONENTS, POINTS].write(&mut digest);
        config.write(&mut digest);
        anchors.write(&mut digest);
        plan.write(&mut digest);
        library.write(&mut digest);
        map.write(&mut digest);
        controllers.seed().write(&mut digest);
        controllers.all().iter().for_each(|controller| controller.allowed().write(&mut digest));
        digest.value()
    }
}

impl<
    const ANCHORS: usize,
    const SURFACES: usize,
    const SOURCES: usize,
    const SEGMENTS: usize,
    const PATHS: usize,
    const ACTIONS: usize,
    const COMPONENTS: usize,
    const POINTS: usize,
> Written for Tracker<ANCHORS, SURFACES, SOURCES, SEGMENTS, PATHS, ACTIONS, COMPONENTS, POINTS>
{
    fn write(&self, to: &mut impl Sink) {
        let Self {
            // Told.
            config: _,
            anchors: _,
            plan: _,
            library: _,
            map: _,
            receiver,
            belief,
            environment,
            transmission,
            discovery,
            clutter,
            lateness,
            channel,
            controllers,
            cycle,
            last_heard,
            lever_arm_m,
            // Nothing is begun.
            begun: _,
            scans: _,
        } = self;
        receiver.write(to);
        belief.write(to);
        environment.write(to);
        transmission.write(to);
        discovery.write(to);
        clutter.write(to);
        lateness.write(to);
        channel.write(to);
        controllers.write(to);
        cycle.write(to);
        last_heard.write(to);
        lever_arm_m.write(to);
    }
}

impl<
    const ANCHORS: usize,
    const SURFACES: usize,
    const SOURCES: usize,
    const SEGMENTS: usize,
    const PATHS: usize,
    const ACTIONS: usize,
    const COMPONENTS: usize,
    const POINTS: usize,
> Stored for Tracker<ANCHORS, SURFACES, SOURCES, SEGMENTS, PATHS, ACTIONS, COMPONENTS, POINTS>
{
    fn read(&mut self, from: &mut Reader<'_>) -> Result<(), SnapshotError> {
        self.receiver.read(from)?;
        self.belief.read(from)?;
        self.environment.read(from)?;
        self.transmission.read(from)?;
        self.discovery.read(from)?;
        self.clutter.read(from)?;
        self.lateness.read(from)?;
        self.channel.read(from)?;
        self.controllers.read(from)?;
        self.cycle.read(from)?;
        self.last_heard.read(from)?;
        self.lever_arm_m.read(from)
    }
}
