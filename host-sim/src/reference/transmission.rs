//! Transmission memory: which share of the paths that cross a wall comes through.
//!
//! Of direct paths that surely cross a wall alone, the share found (in seconds of looking) over that of paths that cross none;
//! at the start as much as walls let through on average, which counts for a while.

use super::availability::Crossing;
use super::real::{Real, larger, smaller};
use cogmint_core::memory::transmission::{LEAST_CLEAR, USUAL_CLEAR, USUAL_S};
use cogmint_core::model::availability::USUAL_THROUGH;
use std::fmt;

/// Seconds of looking.
#[derive(Clone, Copy, Debug)]
struct Looks<T> {
    /// With a path.
    found_s: T,
    /// In all.
    looked_s: T,
}

/// Looks through walls.
#[derive(Clone, Debug)]
pub struct TransmissionMemory<T> {
    clear: Looks<T>,
    walls: Vec<Looks<T>>,
}

impl<T: Real> TransmissionMemory<T> {
    /// For so many walls.
    pub fn new(walls: usize) -> Self {
        let none = Looks { found_s: T::ZERO, looked_s: T::ZERO };
        Self { clear: none, walls: vec![none; walls] }
    }

    /// Share of the paths through a wall that come.
    pub fn through(&self, wall: usize) -> T {
        let (clear, own) = (&self.clear, &self.walls[wall]);
        // As if a second of looking had shown the usual share.
        let found = (clear.found_s + T::of(USUAL_CLEAR)) / (clear.looked_s + T::ONE);
        let found = larger(found, T::of(LEAST_CLEAR));
        let usual_s = T::of(USUAL_S) * (T::of(USUAL_THROUGH) * found);
        smaller((usual_s + own.found_s) / ((T::of(USUAL_S) + own.looked_s) * found), T::ONE)
    }

    /// Enters a look at a direct path: which walls it crosses, and the probability that it was found, `dt` seconds after the
    /// last.
    pub fn remember(&mut self, crossing: Crossing, found: T, dt: T) {
        let looks = match crossing {
            Crossing::None => &mut self.clear,
            Crossing::One(wall) => &mut self.walls[wall],
            Crossing::Unclear => return,
        };
        looks.found_s += dt * found;
        looks.looked_s += dt;
    }

    /// Every number with its name, in the order of the core's `visit`.
    pub fn visit(&self, f: &mut dyn FnMut(fmt::Arguments<'_>, T)) {
        f(format_args!("seconds with a clear path"), self.clear.found_s);
        f(format_args!("seconds of looking where nothing is in the way"), self.clear.looked_s);
        for (wall, looks) in self.walls.iter().enumerate() {
            f(format_args!("seconds with a path through wall {wall}"), looks.found_s);
            f(format_args!("seconds of looking through wall {wall}"), looks.looked_s);
        }
    }
}
