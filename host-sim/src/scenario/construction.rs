//! What walls are made of: the built-in materials and constructions, and how a scenario's own come before them.

use super::{Construction, Layer, Material, Position, Room, Scenario};

/// Rec. ITU-R P.2040-3, table 3: name, a, b, c and d.
const MATERIALS: [(&str, [f64; 4]); 12] = [
    ("air", [1.0, 0.0, 0.0, 0.0]),
    ("concrete", [5.24, 0.0, 0.0462, 0.7822]),
    ("brick", [3.91, 0.0, 0.0238, 0.16]),
    ("plasterboard", [2.73, 0.0, 0.0085, 0.9395]),
    ("wood", [1.99, 0.0, 0.0047, 1.0718]),
    ("glass", [6.31, 0.0, 0.0036, 1.3394]),
    ("ceiling-board", [1.48, 0.0, 0.0011, 1.075]),
    ("chipboard", [2.58, 0.0, 0.0217, 0.78]),
    ("plywood", [2.71, 0.0, 0.33, 0.0]),
    ("marble", [7.074, 0.0, 0.0055, 0.9262]),
    ("floorboard", [3.66, 0.0, 0.0044, 1.3515]),
    ("metal", [1.0, 0.0, 1e7, 0.0]),
];

/// The layers of each construction, thickness in metres.
const LAYERED: [(&str, &[(&str, f64)]); 13] = [
    ("concrete", &[("concrete", 0.2)]),
    ("brick", &[("brick", 0.12)]),
    ("plasterboard", &[("plasterboard", 0.0125)]),
    ("plasterboard-double", &[("plasterboard", 0.025)]),
    ("drywall", &[("plasterboard", 0.0125), ("air", 0.075), ("plasterboard", 0.0125)]),
    ("glass", &[("glass", 0.006)]),
    ("glass-4mm", &[("glass", 0.004)]),
    ("double-glazing", &[("glass", 0.004), ("air", 0.012), ("glass", 0.004)]),
    ("wood", &[("wood", 0.04)]),
    ("chipboard", &[("chipboard", 0.018)]),
    ("plywood", &[("plywood", 0.018)]),
    ("marble", &[("marble", 0.02)]),
    ("metal", &[("metal", 0.001)]),
];

/// The construction that is the same at every frequency; nothing passes through.
const FLAT: (&str, Construction) =
    ("flat", Construction::Flat { reflection_loss_db: 3.0, transmission_loss_db: 200.0 });

/// A material by name: the scenario's own, else a built-in one.
pub fn material(scenario: &Scenario, name: &str) -> Option<Material> {
    let built_in = || {
        let (_, [a, b, c, d]) = *MATERIALS.iter().find(|(known, _)| *known == name)?;
        Some(Material { a, b, c, d })
    };
    scenario.materials.get(name).copied().or_else(built_in)
}

/// A construction by name: the scenario's own, else a built-in one.
pub fn construction(scenario: &Scenario, name: &str) -> Option<Construction> {
    let built_in = || {
        if name == FLAT.0 {
            return Some(FLAT.1);
        }
        let (_, layers) = LAYERED.iter().find(|(known, _)| *known == name)?;
        let layer = |&(material, thickness_m): &(&str, f64)| Layer { material: material.into(), thickness_m };
        Some(Construction::Layered { layers: layers.iter().map(layer).collect() })
    };
    scenario.constructions.get(name).cloned().or_else(built_in)
}

/// The names of all materials of a scenario, its own first.
pub(super) fn material_names(scenario: &Scenario) -> impl Iterator<Item = &str> {
    let own = scenario.materials.keys().map(String::as_str);
    own.chain(MATERIALS.iter().map(|(name, _)| *name))
}

/// The names of all constructions of a scenario, its own first.
pub(super) fn construction_names(scenario: &Scenario) -> impl Iterator<Item = &str> {
    let own = scenario.constructions.keys().map(String::as_str);
    own.chain(LAYERED.iter().map(|(name, _)| *name)).chain([FLAT.0])
}

/// The ends of a room's walls with the names of their constructions: the sides in order, then the inner walls.
pub fn walls(room: &Room) -> Vec<([Position; 2], &str)> {
    let sides = room.corners_m.iter().enumerate().map(|(index, &corner)| {
        let next = room.corners_m[(index + 1) % room.corners_m.len()];
        ([corner, next], room.sides.get(index).unwrap_or(&room.construction).as_str())
    });
    let inner = room.inner_walls.iter().map(|wall| ([wall.from_m, wall.to_m], wall.construction.as_str()));
    sides.chain(inner).collect()
}

#[cfg(test)]
mod tests {
    use super::super::BUILT_IN;
    use super::*;

    fn scenario() -> Scenario {
        Scenario::parse(BUILT_IN[0].text, BUILT_IN[0].name).expect("is valid")
    }

    #[test]
    fn every_built_in_construction_is_made_of_built_in_materials() {
        let scenario = scenario();
        for name in construction_names(&scenario) {
            if let Some(Construction::Layered { layers }) = construction(&scenario, name) {
                assert!(!layers.is_empty());
                for layer in layers {
                    assert!(material(&scenario, &layer.material).is_some(), "{name}: {}", layer.material);
                }
            }
        }
    }

    #[test]
    fn what_a_scenario_defines_comes_before_what_is_built_in() {
        let mut scenario = scenario();
        let own = Material { a: 4.0, b: 0.0, c: 0.1, d: 1.0 };
        scenario.materials.insert("glass".into(), own);
        assert_eq!(material(&scenario, "glass"), Some(own));
        scenario.constructions.insert("brick".into(), FLAT.1);
        assert_eq!(construction(&scenario, "brick"), Some(FLAT.1));
        assert_eq!(construction(&scenario, "straw"), None);
    }

    #[test]
    fn walls_come_as_sides_in_order_and_then_inner_walls() {
        let mut room = scenario().room;
        room.corners_m = vec![[0.0, 0.0], [4.0, 0.0], [4.0, 3.0]];
        room.sides = Vec::new();
        room.construction = "brick".into();
        room.inner_walls = vec![super::super::InnerWall {
            from_m: [1.0, 0.5],
            to_m: [2.0, 0.5],
            construction: "glass".into(),
        }];
        let walls = walls(&room);
        assert_eq!(walls.len(), 4);
        assert_eq!(walls[2], ([[4.0, 3.0], [0.0, 0.0]], "brick"));
        assert_eq!(walls[3], ([[1.0, 0.5], [2.0, 0.5]], "glass"));
    }
}
