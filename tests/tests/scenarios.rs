//! Scenarios: the built-in ones hold, and whatever a file may contain, the command answers with one sentence.

use cogmint::scenario::{BUILT_IN, Scenario};
use cogmint_tests::mutation::{answered_in_a_sentence, damaged, mutated, mutation, runner};
use cogmint_tests::{Folder, cogmint};
use proptest::prelude::*;
use serde_json::Value as Schema;
use std::fs;

fn read_back(scenario: &Scenario) -> Scenario {
    let text = scenario.to_toml().unwrap();
    Scenario::parse(&text, "again.toml").unwrap_or_else(|error| panic!("{error}\n{text}"))
}

#[test]
fn built_in_scenarios_are_valid_and_come_back_from_their_own_text() {
    for built_in in BUILT_IN {
        let scenario =
            Scenario::parse(built_in.text, built_in.name).unwrap_or_else(|error| panic!("{error}"));
        scenario.check(built_in.name).unwrap();
        assert_eq!(read_back(&scenario), scenario, "{}", built_in.name);
    }
}

#[test]
fn the_documents_shortest_scenario_is_one() {
    let document = include_str!("../../docs/scenario-format.md");
    let text = document.split("```toml\n").nth(1).unwrap().split("```").next().unwrap();
    let scenario = Scenario::parse(text, "scenario-format.md").unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(read_back(&scenario), scenario);
}

#[test]
fn the_published_ways_have_a_thousand_positions_each() {
    let (scenario, _) = Scenario::find("seminar-room").unwrap();
    let cycles: Vec<_> = scenario.trajectories.iter().map(|trajectory| trajectory.cycles).collect();
    assert_eq!(cycles, [Some(1000); 5]);
}

#[test]
fn the_command_lists_shows_and_checks_what_is_built_in() {
    let folder = Folder::new("scenario-commands");
    let run = |arguments: &[&str]| cogmint(folder.path(), arguments);
    let listed = String::from_utf8(run(&["scenario", "list"]).stdout).unwrap();
    for built_in in BUILT_IN {
        assert!(listed.contains(built_in.name) && listed.contains(built_in.summary), "{listed}");
        let shown = run(&["scenario", "show", built_in.name]);
        assert_eq!(String::from_utf8(shown.stdout).unwrap(), built_in.text);
    }
    let schema: Schema = serde_json::from_slice(&run(&["scenario", "schema"]).stdout).unwrap();
    assert_eq!(schema, *Scenario::schema());
    fs::write(folder.path().join("my.toml"), BUILT_IN[3].text).unwrap();
    let checked = run(&["scenario", "check", "my.toml"]);
    assert!(checked.status.success());
    assert!(String::from_utf8_lossy(&checked.stdout).starts_with("my.toml: is a valid scenario: Corridor"));
    for (arguments, expected) in
        [(["scenario", "check", "your.toml"], "your.toml"), (["scenario", "show", "attic"], "attic")]
    {
        let output = run(&arguments);
        answered_in_a_sentence(&output, expected).unwrap();
        assert_eq!(output.status.code(), Some(2));
        assert!(String::from_utf8_lossy(&output.stderr).contains("seminar-room"));
    }
}

#[test]
fn damaged_scenarios_get_one_sentence_or_are_still_valid() {
    let folder = Folder::new("scenario-damage");
    let file = folder.path().join("damaged.toml");
    let refused = std::cell::Cell::new(0);
    runner(200)
        .run(&(0..BUILT_IN.len(), prop::collection::vec(mutation(), 1..3)), |(which, mutations)| {
            fs::write(&file, damaged(BUILT_IN[which].text, &mutations)).unwrap();
            let output = cogmint(folder.path(), &["scenario", "check", "damaged.toml"]);
            refused.set(refused.get() + u32::from(!output.status.success()));
            answered_in_a_sentence(&output, "damaged.toml")
        })
        .unwrap_or_else(|error| panic!("{error}"));
    assert!(refused.get() >= 100, "only {} were refused", refused.get());
}

#[test]
fn text_of_any_kind_never_makes_the_reader_panic() {
    runner(5000)
        .run(&(0..BUILT_IN.len(), mutation(), mutation()), |(which, one, other)| {
            let text = String::from_utf8_lossy(&mutated(BUILT_IN[which].text, &one)).into_owned();
            let text = mutated(&text, &other);
            match Scenario::parse(&String::from_utf8_lossy(&text), "x.toml") {
                Ok(scenario) => prop_assert_eq!(read_back(&scenario), scenario),
                Err(error) => prop_assert!(!error.to_string().contains(char::is_control), "{error}"),
            }
            Ok(())
        })
        .unwrap_or_else(|error| panic!("{error}"));
}

/// A scenario in which every key of the schema occurs; what excludes each other is in further ones.
fn complete() -> Vec<toml::Table> {
    let everything = r#"
        format = 1
        name = "everything"
        description = "every key"
        seed = 1
        noise = { snr_at_1_m_db = 40.0 }
        room = { corners_m = [[0.0, 0.0], [6.0, 0.0], [6.0, 4.0], [0.0, 4.0]], construction = "mine", sides = ["mine", "mine", "mine", "lossy"], inner_walls = [{ from_m = [3.0, 1.0], to_m = [3.0, 2.0], construction = "glass" }] }
        materials.own = { a = 2.0, b = 0.0, c = 0.1, d = 0.0 }
        constructions.mine = { layers = [{ material = "own", thickness_m = 0.1 }] }
        constructions.lossy = { reflection_loss_db = 3.0, transmission_loss_db = 10.0 }
        propagation = { reflection_order = 2, transmissions = 1, polarisation = "horizontal" }
        anchors = [{ name = "A", position_m = [1.0, 1.0], height_m = 2.0, range_bias_m = 0.0, antenna = { pattern = "patch", boresight_deg = 0.0, gain_dbi = 0.0, ripple = 0.1, ripple_turn_deg_per_ghz = 1.0 } }]
        tag = { height_m = 1.0, height_std_m = 0.0, antenna = { pattern = "dipole" } }
        trajectories = [
            { name = "p", period_s = 1.0, cycles = 2, way.polyline = { vertices_m = [[1.0, 3.0], [2.0, 3.0]], step_m = 0.1 } },
            { name = "w", way.waypoints = { points = [{ position_m = [1.0, 3.0], speed_m_s = 1.0, pause_s = 1.0 }, { position_m = [2.0, 3.0] }] } },
            { name = "r", way.recorded = { file = "way.csv" } },
        ]
        interference = [
            { carrier_hz = 7e9, pulse_duration_s = 5e-10, roll_off = 0.6, during = [0.2, 0.6], strength.omega_1 = 1e-8, profile = { rise_s = 5e-9, decay_s = 2e-8, chi = 0.9 }, onset_s = 0.0, fading = "independent", anchors = ["A"] },
            { strength.median_sinr_db = 5.0 },
        ]
        obstructions = [{ during = [0.2, 0.6], anchors = ["A"], paths = "all", loss_db = 10.0, excess_m = 0.1 }]
        people = [{ way_m = [[4.0, 1.0], [4.0, 3.0]], speed_m_s = 1.0, width_m = 0.5 }]
        lost_frames = { probability = 0.1, gaps = [[0.2, 0.3]] }
        errors = { clock_offset_s = 0.0, clock_drift = 0.0, timestamp_std_s = 0.0 }

        [dense_multipath]
        omega_1_db = -17.0
        fading = "correlated"
        profile = { rise_s = 5e-9, decay_s = 2e-8, chi = 0.9 }

        [radio]
        kind = "sounder"
        first_action = 0
        schedule = "random"
        sample_spacing_s = 2.5e-10
        samples = 400
        converter = { bits = 12, level = 0.5 }
        random_phase = true
        log = "magnitude"
        PULSE
        LIBRARY
        WINDOW

        [prior]
        acceleration_std_m_s2 = 0.01
        acceleration_density_m2_s3 = 1e-4
        velocity_decay_s = 10.0
        position_m = [1.0, 1.0]
        position_std_m = 0.25
        velocity_std_m_s = 0.03
        disc_radius_m = 0.5
        detection_probability = 0.8
        clutter_per_anchor = 0.1
        max_range_m = 30.0
        range_bias_std_m = 0.0
        range_floor_pulses = 0.1
        floor_plan = { known = true, exact = false, told = "walls", wall_offset_std_m = 0.05, wall_rotation_std_deg = 0.5, turn_std_deg = 0.5, first_order_std_m = 0.1, higher_order_std_m = 0.2, max_virtual_anchors = 24, room = { corners_m = [[0.0, 0.0], [6.0, 0.0], [6.0, 4.0]] } }
    "#;
    let variant = |pulse, library, window| {
        let text = everything.replace("PULSE", pulse).replace("LIBRARY", library).replace("WINDOW", window);
        let scenario = Scenario::parse(&text, "everything.toml").unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(read_back(&scenario), scenario);
        toml::from_str(&text).unwrap()
    };
    vec![
        variant(
            "pulse = { shape = \"root-raised-cosine\", roll_off = 0.6 }",
            "library = [{ carrier_hz = 7e9, pulse_duration_s = 5e-10 }]",
            "window.absolute = { first_sample_delay_s = 0.0 }",
        ),
        variant(
            "pulse = { shape = \"sampled\", spacing_s = 2.5e-10, samples = [[0.0, 0.0], [1.0, 0.0]] }",
            "library = \"wide\"",
            "window.first_path = { sample = 40 }",
        ),
        variant("pulse.shape = \"hrp\"", "", ""),
    ]
}

/// One bound of the schema and a place of a complete scenario that it holds for.
struct Bound {
    key: Vec<String>,
    kind: &'static str,
    limit: f64,
}

/// Collects the bounds that hold for `value`, and the places of the schema that they come from.
fn bounds(
    value: &toml::Value,
    place: &str,
    key: &[String],
    found: &mut Vec<Bound>,
    seen: &mut std::collections::BTreeSet<String>,
) {
    let Some(schema) = Scenario::schema().pointer(place) else { return };
    if let Some(reference) = schema["$ref"].as_str() {
        return bounds(value, reference.trim_start_matches('#'), key, found, seen);
    }
    for choice in ["oneOf", "anyOf"] {
        for index in 0..schema[choice].as_array().map_or(0, Vec::len) {
            bounds(value, &format!("{place}/{choice}/{index}"), key, found, seen);
        }
    }
    let types = schema["type"].to_string();
    let below = |part: &str| [key, &[part.to_owned()]].concat();
    let kinds: &[&'static str] = match value {
        toml::Value::Integer(_) | toml::Value::Float(_)
            if types.contains("number") || types.contains("integer") =>
        {
            &["minimum", "maximum"]
        }
        toml::Value::String(_) if types.contains("string") => &["minLength", "maxLength"],
        toml::Value::Array(list) if types.contains("array") => {
            for (index, entry) in list.iter().enumerate() {
                bounds(entry, &format!("{place}/items"), &below(&index.to_string()), found, seen);
            }
            &["minItems", "maxItems"]
        }
        toml::Value::Table(table) => {
            let required = schema["required"].as_array().into_iter().flatten();
            if !required.filter_map(Schema::as_str).all(|name| table.contains_key(name)) {
                return;
            }
            for (name, value) in table {
                if schema["properties"].get(name).is_some() {
                    bounds(value, &format!("{place}/properties/{name}"), &below(name), found, seen);
                } else {
                    bounds(value, &format!("{place}/additionalProperties"), &below(name), found, seen);
                }
            }
            return;
        }
        _ => return,
    };
    for kind in kinds {
        if let Some(limit) = schema[*kind].as_f64()
            && seen.insert(format!("{place}/{kind}"))
        {
            found.push(Bound { key: key.to_vec(), kind, limit });
        }
    }
}

fn at<'a>(table: &'a mut toml::Table, key: &[String]) -> &'a mut toml::Value {
    let (first, rest) = key.split_first().unwrap();
    rest.iter().fold(&mut table[first.as_str()], |value, part| match value {
        toml::Value::Array(list) => &mut list[part.parse::<usize>().unwrap()],
        value => &mut value[part.as_str()],
    })
}

/// How often a keyword of a bound occurs in the schema.
fn occurrences(schema: &Schema) -> usize {
    const KINDS: [&str; 6] = ["minimum", "maximum", "minLength", "maxLength", "minItems", "maxItems"];
    match schema {
        Schema::Object(object) => object
            .iter()
            .filter(|(name, _)| *name != "default")
            .map(|(name, value)| usize::from(KINDS.contains(&name.as_str())) + occurrences(value))
            .sum(),
        Schema::Array(list) => list.iter().map(occurrences).sum(),
        _ => 0,
    }
}

#[test]
fn just_beyond_each_bound_of_the_schema_is_refused_by_key_and_the_bound_itself_is_not() {
    let mut seen = std::collections::BTreeSet::new();
    let mut tried = 0;
    for table in complete() {
        let mut found = Vec::new();
        bounds(&toml::Value::Table(table.clone()), "", &[], &mut found, &mut seen);
        for Bound { key, kind, limit } in found {
            let with = |amount: f64| {
                let mut table = table.clone();
                let value = at(&mut table, &key);
                *value = match &*value {
                    toml::Value::Integer(_) => toml::Value::Integer(amount as i64),
                    toml::Value::Float(_) => toml::Value::Float(amount),
                    toml::Value::String(_) => toml::Value::String("x".repeat(amount as usize)),
                    toml::Value::Array(list) => {
                        toml::Value::Array(list.iter().cycle().take(amount as usize).cloned().collect())
                    }
                    other => panic!("{other} has no bounds"),
                };
                let text = toml::to_string(&table).unwrap();
                Scenario::parse(&text, "x.toml").err().map(|error| error.to_string()).unwrap_or_default()
            };
            let low = kind.starts_with("min");
            let whole = kind.ends_with("Length")
                || kind.ends_with("Items")
                || matches!(at(&mut table.clone(), &key), toml::Value::Integer(_));
            let beyond = match (whole, low) {
                (true, true) => limit - 1.0,
                (true, false) => limit + 1.0,
                (false, true) => limit.next_down(),
                (false, false) => limit.next_up(),
            };
            let name = key.join(".");
            tried += 1;
            let said = with(beyond);
            assert!(said.contains(&format!("`{name}` ")), "{name} {kind} {limit} beyond: {said:?}");
            let allowed = said.split_once("; allowed is ").map_or("nothing", |(_, allowed)| allowed);
            // Other rules may refuse the bound, but not this one.
            let said = with(limit);
            let again = said.contains(&format!("`{name}` ")) && said.ends_with(allowed);
            assert!(!again, "{name} {kind} {limit}: {said}");
        }
    }
    assert_eq!(tried, occurrences(Scenario::schema()), "bounds that were not tried");
}
