//! A recording's plan in the core's terms.

use crate::recording::Plan;
use cogmint_core::model::plan::FloorPlan;
use cogmint_core::{Error, PlanSegment, PlanWall};

/// A plan as the core is told it, with what it borrows.
#[derive(Clone, Debug, PartialEq)]
pub struct ToldPlan {
    outline_m: Vec<[f32; 2]>,
    walls: Vec<PlanWall>,
    segments: Vec<PlanSegment>,
    turn_std_rad: f32,
    reflections: usize,
    most_sources: usize,
}

/// Deviations below these the core takes for none: a plan is not drawn more exactly.
const LEAST_STD: [f64; 2] = [1e-4, 1e-6];

impl ToldPlan {
    /// Of a plan, of which each wall may be wrong by what it says.
    pub fn new(plan: &Plan) -> Self {
        let single = |[x, y]: [f64; 2]| [x as f32, y as f32];
        let std = |std: f64, least: f64| if std < least { 0.0 } else { std as f32 };
        let [least_m, least_rad] = LEAST_STD;
        let wall = |wall: &crate::recording::PlanWall| PlanWall {
            offset_std_m: std(wall.offset_std_m, least_m),
            rotation_std_rad: std(wall.rotation_std_rad, least_rad),
        };
        let of = |(index, wall): (usize, &crate::recording::PlanWall)| -> Vec<PlanSegment> {
            let segment = |ends_m: &[[f64; 2]; 2]| PlanSegment { wall: index, ends_m: ends_m.map(single) };
            wall.segments_m.iter().map(segment).collect()
        };
        Self {
            outline_m: plan.outline_m.iter().copied().map(single).collect(),
            walls: plan.walls.iter().map(wall).collect(),
            segments: plan.walls.iter().enumerate().flat_map(of).collect(),
            turn_std_rad: plan.turn_std_rad as f32,
            reflections: plan.reflections,
            most_sources: plan.most_sources,
        }
    }

    /// What the core is told.
    pub fn plan(&self) -> cogmint_core::Plan<'_> {
        let Self { outline_m, walls, segments, turn_std_rad, reflections, most_sources } = self;
        cogmint_core::Plan {
            outline_m,
            walls,
            segments,
            turn_std_rad: *turn_std_rad,
            reflections: *reflections,
            most_sources: *most_sources,
        }
    }

    /// What the core keeps of it.
    ///
    /// # Errors
    /// What the core refuses.
    pub fn kept<const SEGMENTS: usize>(&self) -> Result<FloorPlan<SEGMENTS>, Error> {
        FloorPlan::new(&self.plan())
    }
}
