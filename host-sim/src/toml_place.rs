//! Reading of TOML files such that a refusal can name line and key.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::input_error::{InputError, in_one_line, line_of_offset};
use crate::recording::npz::printable;

/// What people write by hand is a few kilobytes; more than this is something else.
const MAX_BYTES: u64 = 16 << 20;

/// The text of a file.
pub(crate) fn read_text(path: &Path) -> Result<String, InputError> {
    let file = File::open(path)
        .map_err(|error| InputError::new(path, format!("cannot be opened: {}", in_one_line(error))))?;
    let mut text = String::new();
    file.take(MAX_BYTES + 1)
        .read_to_string(&mut text)
        .map_err(|error| InputError::new(path, format!("cannot be read: {}", in_one_line(error))))?;
    if text.len() as u64 > MAX_BYTES {
        return Err(InputError::new(path, "is too long").allowed(format!("at most {MAX_BYTES} bytes")));
    }
    Ok(text)
}

/// What is said where TOML or serde refuse.
pub(crate) fn refusal(path: &Path, text: &str, error: &toml::de::Error) -> InputError {
    let message = in_one_line(error.message());
    let span = error.span();
    let refusal = match span.as_ref().and_then(|span| key_at(text, span.start)) {
        Some(key) => InputError::new(path, format!("cannot be used: {message}")).for_item(key),
        None => InputError::new(path, message),
    };
    refusal.at_line(span.map(|span| line_of_offset(text, span.start)))
}

/// Refuses what is no TOML, and any version but this one of the key `format`. This comes first: another version may
/// have other keys.
pub(crate) fn check_format(path: &Path, text: &str, supported: u32) -> Result<(), InputError> {
    let table = DeTable::parse(text).map_err(|error| refusal(path, text, &error))?;
    let format = table.get_ref().get("format").map(|value| value.get_ref());
    let supported = supported.to_string();
    let reason = match format.and_then(DeValue::as_integer) {
        Some(number) if number.as_str() == supported => return Ok(()),
        Some(number) => format!("is {}", printable(number.as_str())),
        None if format.is_some() => "is no whole number".into(),
        None => "is missing".into(),
    };
    let line = line_of_key(text, ["format"]);
    Err(InputError::new(path, reason).at_line(line).for_item("format").allowed(supported))
}

/// The line of a key given by its parts, as far as it exists: for a missing key the line of its table.
pub(crate) fn line_of_key<'a>(text: &str, key: impl IntoIterator<Item = &'a str>) -> Option<u64> {
    let table = DeTable::parse(text).ok()?;
    let mut offset = None;
    let mut parts = key.into_iter();
    let mut value = table.get_ref().get(parts.next()?)?;
    loop {
        // Arrays of tables have no span of their own.
        if value.span().end > 0 {
            offset = Some(value.span().start);
        }
        let Some(part) = parts.next() else { break };
        let next = match (value.get_ref(), part.parse::<usize>()) {
            (DeValue::Array(array), Ok(index)) => array.get(index),
            (inner, _) => inner.as_table().and_then(|table| table.get(part)),
        };
        let Some(next) = next else { break };
        value = next;
    }
    offset.map(|offset| line_of_offset(text, offset))
}

/// The key whose plain value stands at an offset. Unknown and missing keys have none, but are named in the reason.
fn key_at(text: &str, offset: usize) -> Option<String> {
    fn within(value: &Spanned<DeValue<'_>>, offset: usize) -> Option<String> {
        let joined = |name: &str, rest: String| {
            if rest.is_empty() { name.to_owned() } else { format!("{name}.{rest}") }
        };
        match value.get_ref() {
            DeValue::Table(table) => {
                table.iter().find_map(|(key, value)| Some(joined(key.get_ref(), within(value, offset)?)))
            }
            DeValue::Array(array) => array
                .iter()
                .enumerate()
                .find_map(|(index, value)| Some(joined(&index.to_string(), within(value, offset)?))),
            _ => value.span().contains(&offset).then(String::new),
        }
    }
    let table = DeTable::parse(text).ok()?;
    let span = table.span();
    let key = within(&Spanned::new(span, DeValue::Table(table.into_inner())), offset)?;
    Some(printable(&key))
}
