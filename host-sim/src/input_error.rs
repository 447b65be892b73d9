//! What is said to a person whose file or option cannot be used.

use std::error::Error;
use std::fmt;
use std::path::{Path, PathBuf};

/// Input that was refused. Displayed as one sentence that names the file, the line where there is one, the key or
/// array, the reason and, where it applies, the allowed range. The command answers with exit code 2.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct InputError {
    file: PathBuf,
    line: Option<u64>,
    item: Option<String>,
    reason: String,
    allowed: Option<String>,
}

impl InputError {
    /// An error about a whole file or folder; `reason` completes the sentence "FILE: ...", with no full stop.
    pub fn new(file: impl AsRef<Path>, reason: impl Into<String>) -> Self {
        Self { file: file.as_ref().to_owned(), line: None, item: None, reason: reason.into(), allowed: None }
    }

    /// Adds the line of the file, counted from 1.
    pub fn at_line(mut self, line: impl Into<Option<u64>>) -> Self {
        self.line = line.into();
        self
    }

    /// Adds the key, column or array that the reason is about.
    pub fn for_item(mut self, item: impl Into<String>) -> Self {
        self.item = Some(item.into());
        self
    }

    /// Adds what would have been allowed, for example "0 to 1".
    pub fn allowed(mut self, allowed: impl Into<String>) -> Self {
        self.allowed = Some(allowed.into());
        self
    }

    /// The file or folder that was refused.
    pub fn file(&self) -> &Path {
        &self.file
    }

    /// The line of the file that was refused, counted from 1.
    pub fn line(&self) -> Option<u64> {
        self.line
    }

    /// The key, column or array that was refused.
    pub fn item(&self) -> Option<&str> {
        self.item.as_deref()
    }
}

impl fmt::Display for InputError {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{}", self.file.display())?;
        if let Some(line) = self.line {
            write!(formatter, ", line {line}")?;
        }
        formatter.write_str(": ")?;
        if let Some(item) = &self.item {
            write!(formatter, "`{item}` ")?;
        }
        formatter.write_str(&self.reason)?;
        if let Some(allowed) = &self.allowed {
            write!(formatter, "; allowed is {allowed}")?;
        }
        formatter.write_str(".")
    }
}

impl Error for InputError {}

/// The line, counted from 1, that holds byte `offset` of `text`.
pub fn line_of_offset(text: &str, offset: usize) -> u64 {
    let before = text.as_bytes().get(..offset).unwrap_or(text.as_bytes());
    1 + before.iter().filter(|&&byte| byte == b'\n').count() as u64
}

/// The text of another library's message as part of our one sentence.
pub(crate) fn in_one_line(message: impl fmt::Display) -> String {
    let joined = message.to_string().split_whitespace().collect::<Vec<_>>().join(" ");
    let joined = joined.replace(char::is_control, "?");
    joined.trim_end_matches('.').to_owned()
}

/// A number as part of a sentence: very large and small ones read better as powers of ten.
pub(crate) fn number(value: f64) -> String {
    if value != 0.0 && !(1e-3..1e5).contains(&value.abs()) { format!("{value:e}") } else { value.to_string() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_is_one_sentence_with_all_its_parts() {
        let error = InputError::new("a/recording.toml", "is -1")
            .at_line(4)
            .for_item("start.position_std_m")
            .allowed("above 0");
        assert_eq!(
            error.to_string(),
            "a/recording.toml, line 4: `start.position_std_m` is -1; allowed is above 0."
        );
    }

    #[test]
    fn lines_are_counted_from_one_and_an_offset_past_the_end_is_the_last_line() {
        assert_eq!(line_of_offset("a\nb\nc", 0), 1);
        assert_eq!(line_of_offset("a\nb\nc", 2), 2);
        assert_eq!(line_of_offset("a\nb\nc", 900), 3);
    }

    #[test]
    fn messages_of_many_lines_become_one() {
        assert_eq!(in_one_line("unknown\n  field."), "unknown field");
    }
}
