//! Transmission memory: which share of the paths that cross a wall of the plan comes through.
//!
//! Told by direct paths: those that surely cross one wall and no other, against those that surely cross none. What a place
//! shows it shows for a while, so that time counts and not scans. A wall that no path crossed yet has the share that walls
//! have on average.

use crate::model::availability::{Crossing, USUAL_THROUGH};
use crate::real::{larger, smaller};
use crate::snapshot::{Reader, Sink, SnapshotError, Stored, Written, stored};

/// Tuned: seconds of looking that this counts for.
pub const USUAL_S: f32 = 2.0;
/// Guard: against the division by it: least share of direct paths that come where nothing is in the way.
pub const LEAST_CLEAR: f32 = 0.1;
/// Guard: against a reference from few looks: share of clear direct paths that are found; it counts for a second.
pub const USUAL_CLEAR: f32 = 0.8;

/// Seconds of looking, and of them with a path.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Looks {
    found_s: f32,
    looked_s: f32,
}

impl Looks {
    const NONE: Self = Self { found_s: 0.0, looked_s: 0.0 };

    fn add(&mut self, found: f32, elapsed_s: f32) {
        self.found_s += elapsed_s * found;
        self.looked_s += elapsed_s;
    }
}

/// Looks through every wall of a plan.
#[derive(Clone, Debug)]
pub struct TransmissionMemory<const SEGMENTS: usize> {
    clear: Looks,
    walls: [Looks; SEGMENTS],
}

impl<const SEGMENTS: usize> TransmissionMemory<SEGMENTS> {
    /// Nobody has looked yet.
    pub const fn empty() -> Self {
        Self { clear: Looks::NONE, walls: [Looks::NONE; SEGMENTS] }
    }

    /// Share (0 to 1) of the paths through a wall that come.
    pub fn through(&self, wall: usize) -> f32 {
        let clear = larger((self.clear.found_s + USUAL_CLEAR) / (self.clear.looked_s + 1.0), LEAST_CLEAR);
        let Looks { found_s, looked_s } = self.walls.get(wall).copied().unwrap_or(Looks::NONE);
        smaller((USUAL_S * (USUAL_THROUGH * clear) + found_s) / ((USUAL_S + looked_s) * clear), 1.0)
    }

    /// Enters a look at a direct path that crosses these walls: the probability that it was found, after `elapsed_s` seconds.
    pub fn observe(&mut self, crossing: Crossing, found: f32, elapsed_s: f32) {
        match crossing {
            Crossing::None => self.clear.add(found, elapsed_s),
            Crossing::One(wall) => {
                if let Some(looks) = self.walls.get_mut(wall) {
                    looks.add(found, elapsed_s);
                }
            }
            Crossing::Unclear => {}
        }
    }

    /// Writes what is known of so many walls, for a stored map.
    pub(crate) fn write_walls(&self, walls: usize, to: &mut impl Sink) {
        let walls = walls.min(SEGMENTS);
        (walls as u16).write(to);
        self.clear.write(to);
        self.walls.iter().take(walls).for_each(|looks| looks.write(to));
    }

    /// Reads it.
    ///
    /// # Errors
    /// The bytes end; part of it may have been read then.
    pub(crate) fn restore(&mut self, from: &mut Reader<'_>) -> Result<(), SnapshotError> {
        let mut walls = 0_u16;
        walls.read(from)?;
        self.clear.read(from)?;
        self.walls.iter_mut().take(usize::from(walls)).try_for_each(|looks| looks.read(from))
    }

    /// Whether finite numbers are what they may be.
    pub(crate) fn is_sound(&self) -> bool {
        let is_share = |looks: &Looks| looks.found_s >= 0.0 && looks.found_s <= 1.001 * looks.looked_s + 1e-3;
        core::iter::once(&self.clear).chain(&self.walls).all(is_share)
    }

    /// Every number of so many walls, in a fixed order, for traces.
    pub fn visit(&self, walls: usize, mut f: impl FnMut(f32)) {
        for Looks { found_s, looked_s } in core::iter::once(&self.clear).chain(self.walls.iter().take(walls))
        {
            f(*found_s);
            f(*looked_s);
        }
    }
}

stored!(Looks { found_s, looked_s } told {});
stored!(TransmissionMemory<const SEGMENTS> { clear, walls } told {});

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wall_lets_through_what_it_was_seen_to_and_before_that_what_walls_do() {
        let mut memory = TransmissionMemory::<2>::empty();
        assert!((memory.through(1) - USUAL_THROUGH).abs() < 1e-6);
        for _ in 0..1000 {
            memory.observe(Crossing::None, 0.6, 0.1);
            memory.observe(Crossing::One(0), 0.54, 0.1);
            memory.observe(Crossing::Unclear, 1.0, 0.1);
        }
        assert!((memory.through(0) - 0.9).abs() < 0.02, "{}", memory.through(0));
        assert!((memory.through(1) - USUAL_THROUGH).abs() < 1e-6);
        (0..1000).for_each(|_| memory.observe(Crossing::One(1), 1.0, 0.1));
        assert_eq!(memory.through(1), 1.0);
    }
}
