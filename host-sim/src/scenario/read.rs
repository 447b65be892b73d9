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
