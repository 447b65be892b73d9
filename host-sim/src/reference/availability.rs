//! TEMPORARY: until the one of branch `avail` is here.

use super::plan::{FloorPlan, Wall};
use super::real::Real;
use super::surface::Line;
pub use cogmint_core::model::availability::Crossing;

/// A wall as it stands.
#[derive(Clone, Copy, Debug)]
pub struct WallNow<T> {
    /// Line.
    pub line: Line<T>,
    /// Deviation.
    pub std_m: T,
    /// Share.
    pub through: T,
}

/// All.
#[derive(Clone, Debug)]
pub struct Walls<T>(Vec<WallNow<T>>);

impl<T: Real> Walls<T> {
    /// Of a plan.
    pub fn new(plan: &FloorPlan<T>, now: impl Fn(usize, &Wall<T>) -> WallNow<T>) -> Self {
        Self(plan.walls.iter().enumerate().map(|(index, wall)| now(index, wall)).collect())
    }
    /// Direct.
    pub fn direct(&self, _anchor_m: [T; 2], _place_m: [T; 2], _std_m: T) -> T {
        T::ONE
    }
    /// Reflected.
    pub fn reflected(
        &self,
        _anchor_m: [T; 2],
        _first: usize,
        _second: Option<usize>,
        _place_m: [T; 2],
        _std_m: T,
    ) -> T {
        T::ONE
    }
    /// Either.
    pub fn either_order(
        &self,
        _anchor_m: [T; 2],
        _walls: [usize; 2],
        _place_m: [T; 2],
        _std_m: T,
    ) -> (T, bool) {
        (T::ONE, false)
    }
    /// Crossing.
    pub fn crossing(&self, _anchor_m: [T; 2], _place_m: [T; 2], _std_m: T) -> Crossing {
        Crossing::None
    }
}
