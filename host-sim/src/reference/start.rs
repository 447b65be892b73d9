//! What is told before the start: virtual anchors and a plan become surfaces and sources.

use super::environment::EnvironmentMemory;
use super::listing::list;
use super::plan::FloorPlan;
use super::real::{Real, square};
use super::state_filter::StateFilter;
use super::surface::Surface;
use cogmint_core::memory::environment::{Origin, TOLD};
use cogmint_core::model::image::Sequence;
use cogmint_core::{Anchor, Config, MappedVirtualAnchor, Plan};

/// The states that hold the map.
pub struct Start<'a, T> {
    /// Where surfaces are.
    pub filter: &'a mut StateFilter<T>,
    /// What is seen in them.
    pub environment: &'a mut EnvironmentMemory<T>,
}

impl<T: Real> Start<'_, T> {
    /// Virtual anchors told by their positions: each is a private surface, in the slots from the first on.
    pub fn enter_virtual_anchors(&mut self, told: &[MappedVirtualAnchor], config: &Config) {
        for (slot, mapped) in told.iter().enumerate() {
            let std_m = if config.exact_map { T::ZERO } else { T::of(mapped.std_m) };
            let position_m = mapped.position_m.map(T::of);
            self.filter.insert_independent(slot, Surface::Private, position_m, [std_m; 2]);
            self.environment.insert_surface(slot, T::of(TOLD), Origin::Position);
            self.environment.insert(slot, mapped.anchor, Sequence::of(slot as u8), 0);
        }
    }

    /// The sources that the plan shows, the most useful first, as many as fit, with the walls that reflect them; `pulse_m` is the
    /// shortest pulse's length.
    pub fn enter_plan(
        &mut self,
        plan: &mut FloorPlan<T>,
        told: &Plan<'_>,
        anchors: &[Anchor],
        config: &Config,
        pulse_m: f32,
    ) {
        let free_surfaces = self.filter.free_slots();
        let most = self.environment.free_slots().min(told.most_sources);
        let (reflections, max_range_m) = (told.reflections, config.ranging.max_range_m);
        for source in list(plan, anchors, reflections, max_range_m, pulse_m, free_surfaces, most) {
            let surfaces: Vec<Option<u8>> =
                source.walls.iter().map(|&wall| self.surface_of(plan, wall, config.exact_map)).collect();
            let (first, second) = match surfaces[..] {
                [Some(first)] => (first, None),
                [Some(first), Some(second)] => (first, Some(second)),
                _ => continue,
            };
            let Some(slot) = self.environment.free_slot() else { break };
            let sequence = Sequence { first, second, is_either_order: source.is_either_order };
            self.environment.insert(slot, source.anchor, sequence, 0);
        }
        let Some(m) = plan.middle_m().filter(|_| !config.exact_map) else { return };
        // The plan may be turned as a whole, about its middle m: that turns a wall, and shifts it by n . J (c - m).
        self.filter.correlate(square(T::of(told.turn_std_rad)), |slot| match plan.wall_of(slot) {
            Some(wall) => {
                let line = &plan.walls[wall].line;
                let ([cx, cy], [nx, ny]) = (line.centre_m, line.normal);
                [ny * (cx - m[0]) - nx * (cy - m[1]), T::ONE]
            }
            None => [T::ZERO; 2],
        });
    }

    /// The slot of a wall, which is entered where it is not yet; none where there is no room.
    fn surface_of(&mut self, plan: &mut FloorPlan<T>, index: usize, is_exact: bool) -> Option<u8> {
        let wall = &mut plan.walls[index];
        if wall.surface.is_none() {
            let slot = self.filter.free_slot()?;
            let told = [wall.told.offset_std_m, wall.told.rotation_std_rad].map(T::of);
            let std = if is_exact { [T::ZERO; 2] } else { told };
            self.filter.insert_independent(slot, Surface::Wall(wall.line), [T::ZERO; 2], std);
            self.environment.insert_surface(slot, T::of(TOLD), Origin::Plan);
            wall.surface = Some(slot);
        }
        wall.surface.map(|slot| slot as u8)
    }
}
