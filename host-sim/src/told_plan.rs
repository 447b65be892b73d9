//! A recording's plan in the core's terms.

use crate::input_error::InputError;
use crate::recording::Plan;
use crate::replay::SEGMENTS;
use cogmint_core::model::plan::FloorPlan;
use cogmint_core::{PlanSegment, PlanWall};
use std::path::Path;

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
    /// Of a plan, of which each wall may be wrong by what it says. The core takes a wall's line from its first segment, in single
    /// precision: segments are laid on the wall's line before they are rounded, the longest first.
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
            wall.on_line_m().iter().map(segment).collect()
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

    /// What the trackers of the host keep of it; `item` of `file` is what it was told by.
    ///
    /// # Errors
    /// What they refuse.
    pub fn kept(&self, file: impl AsRef<Path>, item: &str) -> Result<FloorPlan<SEGMENTS>, InputError> {
        self.check_size(&file, item)?;
        FloorPlan::new(&self.plan()).map_err(|error| InputError::new(file, error.to_string()).for_item(item))
    }

    /// Whether the trackers of the host have room for it; `item` of `file` is what it was told by.
    ///
    /// # Errors
    /// More walls, segments or corners of the outline than [`SEGMENTS`].
    pub fn check_size(&self, file: impl AsRef<Path>, item: &str) -> Result<(), InputError> {
        let counts = [
            (self.walls.len(), "walls"),
            (self.segments.len(), "segments of walls"),
            (self.outline_m.len(), "corners of the outline"),
        ];
        match counts.into_iter().find(|(count, _)| *count > SEGMENTS) {
            None => Ok(()),
            Some((count, of)) => Err(InputError::new(file, format!("has {count} {of}"))
                .for_item(item)
                .allowed(format!("at most {SEGMENTS}"))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording;

    fn plan(segments_m: Vec<[[f64; 2]; 2]>, corners: usize) -> Plan {
        let told = recording::PlanWall {
            segments_m,
            offset_std_m: 0.05,
            rotation_std_rad: 0.01,
            construction: "brick".into(),
        };
        let corner = |n: usize| {
            let (sin, cos) = (std::f64::consts::TAU * n as f64 / corners as f64).sin_cos();
            [700.0 + 80.0 * cos, 650.0 + 80.0 * sin]
        };
        Plan {
            outline_m: (0..corners).map(corner).collect(),
            turn_std_rad: 0.01,
            reflections: 2,
            most_sources: 24,
            walls: vec![told],
        }
    }

    #[test]
    fn a_facade_far_from_the_origin_that_begins_with_a_short_piece_keeps_its_direction() {
        let (sin, cos) = 0.3_f64.sin_cos();
        let at =
            |place_m: f64| [700.0 + place_m * cos, 650.0 + place_m * sin].map(|x| (1e3 * x).round() / 1e3);
        let mut pieces = vec![[at(0.0), at(0.025)]];
        pieces.extend((1..20).map(|n| 3.0 * f64::from(n)).map(|x| [at(x), at(x + 1.0)]));
        let told = ToldPlan::new(&plan(pieces.clone(), 4));
        let kept = told.kept("facade", "plan").unwrap_or_else(|error| panic!("{error}"));
        let wall = kept.walls()[0];
        let turned = f64::from(wall.line.normal[1]).atan2(f64::from(wall.line.normal[0]))
            - (0.3 + 0.25 * std::f64::consts::TAU);
        assert!(turned.abs() < 2e-4, "{turned}");
        assert!((f64::from(wall.half_length_m) - 29.0).abs() < 0.01);
        // As drawn, the first piece would turn it by centimetres, which the core refuses.
        let segments = pieces.iter().map(|ends| ends.map(|end| end.map(|x| x as f32)));
        let drawn: Vec<_> = segments.map(|ends_m| PlanSegment { wall: 0, ends_m }).collect();
        let refused = FloorPlan::<SEGMENTS>::new(&cogmint_core::Plan { segments: &drawn, ..told.plan() });
        assert!(matches!(refused, Err(cogmint_core::Error::PlanSegment { .. })), "{refused:?}");
    }

    #[test]
    fn a_plan_of_hundreds_of_segments_is_taken_and_one_too_many_is_named() {
        let pieces = |count: usize| -> Vec<_> {
            (0..count).map(|n| [[2.0 * n as f64, 0.0], [2.0 * n as f64 + 1.0, 0.0]]).collect()
        };
        assert!(ToldPlan::new(&plan(pieces(SEGMENTS), SEGMENTS)).kept("office", "plan").is_ok());
        let said = |plan: &Plan| ToldPlan::new(plan).kept("office", "plan").unwrap_err().to_string();
        let most = SEGMENTS + 1;
        assert_eq!(
            said(&plan(pieces(most), 4)),
            format!("office: `plan` has {most} segments of walls; allowed is at most {SEGMENTS}.")
        );
        assert_eq!(
            said(&plan(pieces(1), most)),
            format!("office: `plan` has {most} corners of the outline; allowed is at most {SEGMENTS}.")
        );
    }
}
