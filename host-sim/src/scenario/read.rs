//! Reading and writing of scenarios.

use std::path::{Path, PathBuf};

use super::check::Fault;
use super::{BUILT_IN, FORMAT, Scenario, schema};
use crate::input_error::{InputError, in_one_line};
use crate::toml_place;

impl Scenario {
    /// Reads and checks a file of at most 16 MiB.
    ///
    /// # Errors
    ///
    /// Anything that is missing, malformed, out of range or unknown, named in one sentence.
    pub fn read(path: impl AsRef<Path>) -> Result<Self, InputError> {
        let path = path.as_ref();
        Self::parse(&toml_place::read_text(path)?, path)
    }

    /// Reads and checks a file's text; `file` is what messages call it.
    ///
    /// # Errors
    ///
    /// As [`Scenario::read`].
    pub fn parse(text: &str, file: impl AsRef<Path>) -> Result<Self, InputError> {
        let file = file.as_ref();
        toml_place::check_format(file, text, FORMAT)?;
        let table: toml::Table =
            toml::from_str(text).map_err(|error| toml_place::refusal(file, text, &error))?;
        let located = |fault: Fault| {
            let line = toml_place::line_of_key(text, fault.key.iter().map(String::as_str));
            fault.in_file(file).at_line(line)
        };
        schema::check(&table).map_err(located)?;
        let scenario: Self =
            table.try_into().map_err(|error: toml::de::Error| toml_place::refusal(file, text, &error))?;
        scenario.check_meaning().map_err(located)?;
        Ok(scenario)
    }

    /// The built-in scenario of this name, or else the one in this file, then with the file's folder: recorded ways lie
    /// relative to it.
    ///
    /// # Errors
    ///
    /// As [`Scenario::read`]; where there is neither, the built-in names are listed.
    pub fn find(name_or_path: &str) -> Result<(Self, Option<PathBuf>), InputError> {
        if let Some(built_in) = BUILT_IN.iter().find(|built_in| built_in.name == name_or_path) {
            return Ok((Self::parse(built_in.text, built_in.name)?, None));
        }
        let path = Path::new(name_or_path);
        if !path.exists() {
            let names = BUILT_IN.map(|built_in| built_in.name).join(", ");
            return Err(InputError::new(path, "is neither a file nor a built-in scenario")
                .allowed(format!("a file or one of {names}")));
        }
        Ok((Self::read(path)?, path.parent().map(Path::to_owned)))
    }

    /// Checks a scenario that was made or changed by a program; `file` is what messages call it.
    ///
    /// # Errors
    ///
    /// As [`Scenario::read`], without lines.
    pub fn check(&self, file: impl AsRef<Path>) -> Result<(), InputError> {
        let file = file.as_ref();
        let table = toml::Table::try_from(self).map_err(|error| InputError::new(file, in_one_line(error)))?;
        schema::check(&table).and_then(|()| self.check_meaning()).map_err(|fault| fault.in_file(file))
    }

    /// The scenario as a file's text; reading it gives the same scenario.
    ///
    /// # Errors
    ///
    /// Where a number is beyond what TOML can hold; never for a scenario that passes [`Scenario::check`].
    pub fn to_toml(&self) -> Result<String, toml::ser::Error> {
        toml::to_string(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The sentence about a built-in scenario's text after `from` became `to`.
    fn refusal_after(name: &str, from: &str, to: &str) -> String {
        let text = BUILT_IN.iter().find(|built_in| built_in.name == name).expect("is built in").text;
        assert!(text.contains(from), "{from}");
        Scenario::parse(&text.replacen(from, to, 1), "x.toml").expect_err("is refused").to_string()
    }

    #[track_caller]
    fn assert_says(said: &str, parts: &[&str]) {
        assert!(said.starts_with("x.toml, line "), "{said}");
        for part in parts {
            assert!(said.contains(part), "{part:?} is missing in: {said}");
        }
    }

    #[test]
    fn unknown_missing_and_mistyped_keys_are_refused_with_line_and_key() {
        let name = "dw3000-office";
        assert_eq!(
            refusal_after(name, "[radio]\n", "[radio]\nspeed = 3\n").split("; allowed").next(),
            Some("x.toml, line 76: `radio.speed` is unknown"),
        );
        assert_says(&refusal_after(name, "name = \"north-east\"\n", ""), &["`anchors.2.name` is missing"]);
        assert_says(
            &refusal_after(name, "height_m = 1.2", "height_m = \"high\""),
            &["`tag.height_m` is \"high\"; allowed is -100 to 100."],
        );
        assert_says(
            &refusal_after(name, "height_m = 1.2", "height_m = nan"),
            &["`tag.height_m` is NaN; allowed is -100 to 100."],
        );
        assert_says(
            &refusal_after(name, "[4.5, 4.5]", "[4.5, 4.5, 1.0]"),
            &["`trajectories.0.way.waypoints.points.2.position_m` has 3 entries", "a list of 2 entries"],
        );
        assert_says(&refusal_after(name, "[errors]", "[[errors]]"), &["`errors` is a list"]);
    }

    #[test]
    fn what_has_several_shapes_says_which() {
        let name = "dw3000-office";
        let after = |line: &str| refusal_after(name, "log = \"complex\"", line);
        assert_says(&after("log = \"phase\""), &["`radio.log` is \"phase\"; allowed is complex, magnitude."]);
        assert_says(
            &after("pulse = { roll_off = 0.5 }"),
            &["`radio.pulse.shape` is missing; allowed is root-raised-cosine, hrp, sampled."],
        );
        assert_says(&after("pulse = { shape = \"gauss\" }"), &["`radio.pulse.shape` is \"gauss\""]);
        assert_says(
            &after("pulse = { shape = \"hrp\", roll_off = 0.5 }"),
            &["`radio.pulse.roll_off` is unknown; allowed is shape."],
        );
        assert_says(&after("library = \"dw9\""), &["`radio.library` is \"dw9\"", "hrp-europe, a list"]);
        assert_says(&after("library = []"), &["`radio.library` has 0 entries"]);
        assert_says(
            &after("library = [{ carrier_hz = 7e9 }]"),
            &["`radio.library.0.pulse_duration_s` is missing"],
        );
        assert_says(
            &after("window = { absolute = { first_sample_delay_s = 0.0 }, first_path = { sample = 1 } }"),
            &["`radio.window` holds absolute, first_path; allowed is absolute or first_path."],
        );
        assert_says(
            &refusal_after(name, "[errors]", "[constructions.wall]\nlayer = []\n[errors]"),
            &["`constructions.wall` holds layer", "layers or reflection_loss_db with transmission_loss_db"],
        );
        assert_says(
            &refusal_after(name, "[errors]", "[constructions.wall]\nreflection_loss_db = 3\n[errors]"),
            &["`constructions.wall.transmission_loss_db` is missing"],
        );
    }

    #[test]
    fn what_the_schema_cannot_say_is_refused_with_its_line_too() {
        assert_says(
            &refusal_after("dw3000-office", "[4.5, 4.5]", "[4.5, 7.5]"),
            &["line 67: `trajectories.0.way.waypoints.points.2.position_m` is (4.5, 7.5), outside the room"],
        );
    }

    #[test]
    fn another_format_is_refused_before_anything_else() {
        let said = refusal_after("corridor", "format = 1", "format = 2\nwalls = 3");
        assert_says(&said, &["`format` is 2; allowed is 1."]);
    }

    #[test]
    fn a_scenario_is_found_by_name_or_by_path_and_otherwise_the_names_are_listed() {
        let (scenario, folder) = Scenario::find("corridor").expect("is built in");
        assert_eq!((scenario.anchors.len(), folder), (2, None));
        let said = Scenario::find("corridors").expect_err("is refused").to_string();
        assert!(said.contains("neither a file nor a built-in scenario") && said.contains("dw3000-office"));
    }

    #[test]
    fn a_number_beyond_toml_is_refused_when_checked() {
        let (mut scenario, _) = Scenario::find("corridor").expect("is built in");
        scenario.seed = u64::MAX;
        scenario.check("x.toml").expect_err("is refused");
    }

    #[test]
    fn the_committed_schema_is_the_derived_one() {
        let committed: serde_json::Value =
            serde_json::from_str(include_str!("../../../docs/scenario.schema.json")).expect("is JSON");
        assert!(
            committed == *Scenario::schema(),
            "run: cargo run --release -- scenario schema > docs/scenario.schema.json"
        );
    }

    #[test]
    fn the_documentation_names_every_key_of_the_schema() {
        fn names(schema: &serde_json::Value, found: &mut Vec<String>) {
            match schema {
                serde_json::Value::Object(object) => {
                    if let Some(properties) = object.get("properties").and_then(|value| value.as_object()) {
                        found.extend(properties.keys().cloned());
                    }
                    object.values().for_each(|value| names(value, found));
                }
                serde_json::Value::Array(list) => list.iter().for_each(|value| names(value, found)),
                _ => {}
            }
        }
        let mut found = Vec::new();
        names(Scenario::schema(), &mut found);
        assert!(found.len() > 100);
        let text = include_str!("../../../docs/scenario-format.md");
        for name in found {
            let named = [format!("`{name}`"), format!("`{name}."), format!(".{name}`")];
            assert!(named.iter().any(|name| text.contains(name)), "{name} is not documented");
        }
    }
}
