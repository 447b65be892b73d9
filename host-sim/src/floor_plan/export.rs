//! What a device is told, written down: as data, and as constants for firmware.

use crate::input_error::InputError;
use crate::recording::{Anchor, Plan, Recording, WallSequence};
use crate::scenario::Scenario;
use serde::Serialize;
use std::fmt::Write;

/// Everything that a device is told before it starts but for its radio.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Export {
    /// What it is of.
    pub name: String,
    /// The anchors.
    pub anchors: Vec<Anchor>,
    /// The plan; none in a recording that tells virtual anchors alone.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub plan: Option<Plan>,
    /// The sources in order of use.
    pub sources: Vec<Source>,
}

/// A source with what is known of it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Source {
    /// Index of its anchor.
    pub anchor: usize,
    /// The walls that reflect its paths, in order from the anchor outwards; empty where they are not known.
    pub walls: WallSequence,
    /// Where the device is told that its image is, metres.
    pub position_m: [f64; 2],
    /// Standard deviation of that per axis, metres.
    pub std_m: f64,
    /// Share of the outline from which it is seen; a recording does not keep it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub seen_share: Option<f64>,
    /// Whether its two walls may come in either order; a recording does not keep it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub is_either_order: Option<bool>,
}

impl Export {
    /// What a device is told of a scenario's plan, with the errors of a seed or as it stands; see [`super::told`].
    ///
    /// # Errors
    /// A wall's construction is unknown.
    pub fn of_scenario(scenario: &Scenario, seed: Option<u64>) -> Result<Self, InputError> {
        let told = super::told(scenario, seed)?;
        let anchor = |anchor: &crate::scenario::Anchor| {
            Anchor::new(anchor.name.clone(), anchor.position_m, anchor.height_m)
        };
        let source = |source: super::ToldSource| Source {
            anchor: source.anchor,
            walls: source.walls,
            position_m: source.position_m,
            std_m: source.std_m,
            seen_share: Some(source.seen_share),
            is_either_order: Some(source.is_either_order),
        };
        Ok(Self {
            name: scenario.name.clone(),
            anchors: scenario.anchors.iter().map(anchor).collect(),
            plan: Some(told.plan),
            sources: told.sources.into_iter().map(source).collect(),
        })
    }

    /// What the tracker of a recording is told.
    pub fn of_recording(recording: &Recording) -> Self {
        let known = recording.virtual_anchors.iter().filter(|va| va.known);
        let sources = known.map(|va| Source {
            anchor: va.anchor,
            walls: va.walls,
            position_m: va.told_position_m.unwrap_or(va.position_m),
            std_m: va.std_m,
            seen_share: None,
            is_either_order: None,
        });
        Self {
            name: recording.name.clone(),
            sources: sources.collect(),
            anchors: recording.anchors.clone(),
            plan: recording.plan.clone(),
        }
    }

    /// As TOML: the tables `plan` and `plan.walls` are those of a recording.
    ///
    /// # Errors
    /// Never for numbers that TOML can hold.
    pub fn to_toml(&self) -> Result<String, toml::ser::Error> {
        toml::to_string(self)
    }

    /// As Rust: constants of the core's types for firmware. With a plan, the core lists the sources itself: those with walls
    /// are comments only.
    pub fn to_rust(&self) -> String {
        let private: Vec<&Source> =
            self.sources.iter().filter(|source| self.plan.is_none() || source.walls.is_empty()).collect();
        let names: &[&str] = match (&self.plan, private.is_empty()) {
            (Some(_), true) => &["Anchor", "Map", "Plan", "PlanSegment", "PlanWall"],
            (Some(_), false) => &["Anchor", "Map", "MappedVirtualAnchor", "Plan", "PlanSegment", "PlanWall"],
            (None, true) => &["Anchor", "Map"],
            (None, false) => &["Anchor", "Map", "MappedVirtualAnchor"],
        };
        let mut text = format!(
            "// What a device is told of {}: made by `cogmint plan`.\n\
             use cogmint_core::{{{}}};\n\n\
             /// The anchors.\npub const ANCHORS: [Anchor; {}] = [\n",
            self.name.escape_default(),
            names.join(", "),
            self.anchors.len()
        );
        // Writing to a string cannot fail.
        for Anchor { name, position_m, height_m, .. } in &self.anchors {
            let _ = writeln!(
                text,
                "    // {}\n    Anchor {{ position_m: {}, height_m: {:?} }},",
                name.escape_default(),
                point(*position_m),
                *height_m as f32
            );
        }
        text.push_str("];\n");
        if !private.is_empty() {
            let _ = write!(
                text,
                "\n/// The virtual anchors whose walls are not known.\n\
                 pub const VIRTUAL_ANCHORS: [MappedVirtualAnchor; {}] = [\n",
                private.len()
            );
            for source in &private {
                let anchor = self.anchors.get(source.anchor).map_or("", |anchor| &anchor.name);
                let _ = writeln!(
                    text,
                    "    // {}\n    MappedVirtualAnchor {{ anchor: {}, position_m: {}, std_m: {:?} }},",
                    anchor.escape_default(),
                    source.anchor,
                    point(source.position_m),
                    source.std_m as f32
                );
            }
            text.push_str("];\n");
        }
        if let Some(plan) = &self.plan {
            self.write_plan(&mut text, plan);
        }
        let virtual_anchors = if private.is_empty() { "&[]" } else { "&VIRTUAL_ANCHORS" };
        let plan = if self.plan.is_some() { "Some(PLAN)" } else { "None" };
        let _ = write!(
            text,
            "\n/// What the tracker is told.\n\
             pub const MAP: Map<'static> = Map {{ virtual_anchors: {virtual_anchors}, plan: {plan} }};\n"
        );
        text
    }

    fn write_plan(&self, text: &mut String, plan: &Plan) {
        let _ = write!(
            text,
            "\n/// Corners of the outline, metres.\npub const OUTLINE_M: [[f32; 2]; {}] = [\n",
            plan.outline_m.len()
        );
        for &corner_m in &plan.outline_m {
            let _ = writeln!(text, "    {},", point(corner_m));
        }
        let _ = write!(text, "];\n\n/// The walls.\npub const WALLS: [PlanWall; {}] = [\n", plan.walls.len());
        for wall in &plan.walls {
            let _ = writeln!(
                text,
                "    PlanWall {{ offset_std_m: {:?}, rotation_std_rad: {:?} }},",
                wall.offset_std_m as f32, wall.rotation_std_rad as f32
            );
        }
        let segments = plan
            .walls
            .iter()
            .enumerate()
            .flat_map(|(n, wall)| wall.on_line_m().into_iter().map(move |ends| (n, ends)));
        let _ = write!(
            text,
            "];\n\n/// What they consist of.\npub const SEGMENTS: [PlanSegment; {}] = [\n",
            segments.clone().count()
        );
        for (wall, [from_m, to_m]) in segments {
            let ends = format!("[{}, {}]", point(from_m), point(to_m));
            let _ = writeln!(text, "    PlanSegment {{ wall: {wall}, ends_m: {ends} }},");
        }
        text.push_str("];\n\n/// The plan. The core lists these sources, the most useful first:\n///\n");
        for source in self.sources.iter().filter(|source| !source.walls.is_empty()) {
            let anchor = self.anchors.get(source.anchor).map_or("", |anchor| &anchor.name);
            let _ = writeln!(text, "/// - {}{}", anchor.escape_default(), self.by_way_of(source.walls));
        }
        let _ = write!(
            text,
            "pub const PLAN: Plan<'static> = Plan {{\n    outline_m: &OUTLINE_M,\n    walls: &WALLS,\n    \
             segments: &SEGMENTS,\n    turn_std_rad: {:?},\n    reflections: {},\n    most_sources: {},\n}};\n",
            plan.turn_std_rad as f32, plan.reflections, plan.most_sources
        );
    }

    /// ", walls 3 and 0", as part of a comment.
    fn by_way_of(&self, walls: WallSequence) -> String {
        let mut walls = walls.iter();
        match (walls.next(), walls.next()) {
            (Some(one), None) => format!(", wall {one}"),
            (Some(first), Some(second)) => format!(", walls {first} and {second}"),
            _ => String::new(),
        }
    }
}

fn point([x, y]: [f64; 2]) -> String {
    format!("[{:?}, {:?}]", x as f32, y as f32)
}
