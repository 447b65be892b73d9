//! Holds a scenario to its JSON schema: keys, types, lengths and bounds, whatever the schema says.
//!
//! Only what the derived schema uses is understood: `$ref`, `oneOf` and `anyOf`, `const`, types, `properties` with
//! `required` and `additionalProperties`, and the bounds of numbers, lists and texts.

use std::sync::LazyLock;

use serde_json::Value as Schema;
use toml::{Table, Value};

use super::Scenario;
use super::check::Fault;
use crate::input_error::number;
use crate::recording::npz::printable;

static SCHEMA: LazyLock<Schema> = LazyLock::new(|| schemars::schema_for!(Scenario).to_value());

impl Scenario {
    /// The JSON schema of the file format, with every bound.
    pub fn schema() -> &'static Schema {
        &SCHEMA
    }
}

/// The first place, if any, where a file's contents and the schema disagree.
pub(super) fn check(contents: &Table) -> Result<(), Fault> {
    check_table(contents, &SCHEMA, &mut Vec::new())
}

fn check_value(value: &Value, schema: &Schema, key: &mut Vec<String>) -> Result<(), Fault> {
    let alternatives = alternatives(schema);
    let fits = |alternative: &&Schema| types(alternative).any(|name| is_of_type(value, name));
    let fitting: Vec<&Schema> = alternatives.iter().copied().filter(fits).collect();
    let refuse = |reason: String| Err(Fault::new(key, reason).allowed(describe(&alternatives)));
    match (value, &fitting[..]) {
        (_, []) => refuse(format!("is {}", spoken(value))),
        (Value::Table(table), [schema]) => check_table(table, schema, key),
        (Value::Table(table), _) => check_table(table, chosen(table, &fitting, key)?, key),
        (Value::Array(list), [schema, ..]) => {
            if !within(list.len() as f64, schema, "minItems", "maxItems") {
                return refuse(format!("has {} entries", list.len()));
            }
            for (index, entry) in list.iter().enumerate() {
                key.push(index.to_string());
                check_value(entry, &schema["items"], key)?;
                key.pop();
            }
            Ok(())
        }
        (Value::String(text), schemas) => {
            let allows = |schema: &&Schema| match schema.get("const") {
                Some(only) => only == text,
                None => within(text.chars().count() as f64, schema, "minLength", "maxLength"),
            };
            if schemas.iter().any(allows) {
                return Ok(());
            }
            refuse(format!("is {}", spoken(value)))
        }
        (_, [schema, ..]) => {
            let value_is = match value {
                Value::Integer(value) => *value as f64,
                Value::Float(value) => *value,
                _ => return Ok(()),
            };
            // Only what has no upper bound may be infinite.
            let may_be = value_is.is_finite() || value_is > 0.0 && schema.get("maximum").is_none();
            if may_be && within(value_is, schema, "minimum", "maximum") {
                return Ok(());
            }
            refuse(format!("is {}", spoken(value)))
        }
    }
}

fn check_table(table: &Table, schema: &Schema, key: &mut Vec<String>) -> Result<(), Fault> {
    let others = schema.get("additionalProperties").filter(|others| others.is_object());
    for (name, value) in table {
        key.push(name.clone());
        let Some(schema) = schema["properties"].get(name).or(others) else {
            return Err(Fault::new(key, "is unknown").allowed(names_of(schema)));
        };
        check_value(value, schema, key)?;
        key.pop();
    }
    for name in required(schema) {
        if !table.contains_key(name) {
            key.push(name.to_owned());
            return Err(Fault::new(key, "is missing"));
        }
    }
    Ok(())
}

/// Which of several tables is meant: the one with the right tag, or the one whose keys are there.
fn chosen<'a>(table: &Table, schemas: &[&'a Schema], key: &mut Vec<String>) -> Result<&'a Schema, Fault> {
    let tag_of = |schema: &'a Schema| {
        let mut properties = schema["properties"].as_object()?.iter();
        properties.find_map(|(name, property)| Some((name, property.get("const")?.as_str()?)))
    };
    let tags: Vec<(&String, &str)> = schemas.iter().filter_map(|schema| tag_of(schema)).collect();
    if let Some(&(name, _)) = tags.first() {
        let given = table.get(name);
        let is_given = |(_, tag): &(&String, &str)| given.and_then(Value::as_str) == Some(tag);
        if let Some(position) = tags.iter().position(is_given) {
            return Ok(schemas[position]);
        }
        key.push(name.clone());
        let reason = given.map_or_else(|| "is missing".into(), |given| format!("is {}", spoken(given)));
        return Err(Fault::new(key, reason).allowed(joined(tags.iter().map(|&(_, tag)| tag.to_owned()))));
    }
    let begun = |schema: &&&Schema| required(schema).any(|name| table.contains_key(name));
    let mut candidates = schemas.iter().filter(begun);
    if let (Some(only), None) = (candidates.next(), candidates.next()) {
        return Ok(only);
    }
    let reason = if table.is_empty() {
        "is empty".into()
    } else {
        format!("holds {}", printable(&joined(table.keys().cloned())))
    };
    let sets = schemas.iter().map(|schema| required(schema).collect::<Vec<_>>().join(" with "));
    Err(Fault::new(key, reason).allowed(sets.collect::<Vec<_>>().join(" or ")))
}

/// What a schema stands for, once references and choices are followed; TOML has no null.
fn alternatives(schema: &Schema) -> Vec<&Schema> {
    if let Some(reference) = schema["$ref"].as_str() {
        let target = SCHEMA.pointer(reference.trim_start_matches('#'));
        return target.map(alternatives).unwrap_or_default();
    }
    match schema["oneOf"].as_array().or(schema["anyOf"].as_array()) {
        Some(choices) => choices.iter().flat_map(alternatives).collect(),
        None if schema["type"] == "null" => Vec::new(),
        None => vec![schema],
    }
}

fn types(schema: &Schema) -> impl Iterator<Item = &str> {
    let one = schema["type"].as_str();
    let several = schema["type"].as_array().into_iter().flatten().filter_map(Schema::as_str);
    one.into_iter().chain(several).filter(|&name| name != "null")
}

fn required(schema: &Schema) -> impl Iterator<Item = &str> {
    schema["required"].as_array().into_iter().flatten().filter_map(Schema::as_str)
}

fn is_of_type(value: &Value, name: &str) -> bool {
    match value {
        Value::String(_) => name == "string",
        Value::Integer(_) => name == "integer" || name == "number",
        Value::Float(_) => name == "number",
        Value::Boolean(_) => name == "boolean",
        Value::Array(_) => name == "array",
        Value::Table(_) => name == "object",
        Value::Datetime(_) => false,
    }
}

fn within(value: f64, schema: &Schema, low: &str, high: &str) -> bool {
    schema[low].as_f64().is_none_or(|low| value >= low)
        && schema[high].as_f64().is_none_or(|high| value <= high)
}

/// A value as part of a sentence.
fn spoken(value: &Value) -> String {
    match value {
        Value::String(text) => format!("{:?}", printable(text)),
        Value::Integer(value) => value.to_string(),
        Value::Float(value) => number(*value),
        Value::Boolean(value) => value.to_string(),
        Value::Datetime(_) => "a date".into(),
        Value::Array(_) => "a list".into(),
        Value::Table(_) => "a table".into(),
    }
}

/// What the schemas allow, as part of a sentence.
fn describe(schemas: &[&Schema]) -> String {
    let describe_one = |schema: &&Schema| {
        let from_to = |low: &str, high: &str| match (schema[low].as_f64(), schema[high].as_f64()) {
            (Some(low), Some(high)) if low == high => Some(number(low)),
            (Some(low), Some(high)) => Some(format!("{} to {}", number(low), number(high))),
            (Some(low), None) => Some(format!("at least {}", number(low))),
            (None, Some(high)) => Some(format!("at most {}", number(high))),
            (None, None) => None,
        };
        let counted = |what: &str, low, high, unit: &str| match from_to(low, high) {
            Some(range) => format!("{what} of {range} {unit}"),
            None => what.to_owned(),
        };
        if let Some(only) = schema["const"].as_str() {
            return only.to_owned();
        }
        match types(schema).next().unwrap_or_default() {
            "string" => counted("a text", "minLength", "maxLength", "characters"),
            "array" => counted("a list", "minItems", "maxItems", "entries"),
            "object" => "a table".into(),
            "boolean" => joined(["true".into(), "false".into()]),
            "integer" => from_to("minimum", "maximum")
                .map_or_else(|| "any whole number".into(), |range| format!("a whole number, {range}")),
            _ => from_to("minimum", "maximum").unwrap_or_else(|| "any finite number".into()),
        }
    };
    let mut described: Vec<String> = schemas.iter().map(describe_one).collect();
    described.dedup();
    joined(described)
}

fn names_of(schema: &Schema) -> String {
    joined(schema["properties"].as_object().into_iter().flat_map(|properties| properties.keys().cloned()))
}

fn joined(names: impl IntoIterator<Item = String>) -> String {
    names.into_iter().collect::<Vec<_>>().join(", ")
}
