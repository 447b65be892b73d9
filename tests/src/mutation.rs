//! Damage to scenario files, and what the command may say about them.

use proptest::prelude::*;
use proptest::sample::Index;
use proptest::test_runner::{Config, RngAlgorithm, TestRng, TestRunner};
use std::process::Output;

/// Damage to a scenario's text.
#[derive(Clone, Debug)]
pub enum Mutation {
    /// A line is left out.
    DeleteLine(Index),
    /// A line stands there twice: mostly a repeated key or table.
    RepeatLine(Index),
    /// Two blocks between empty lines change places.
    SwapBlocks(Index, Index),
    /// A number is replaced.
    Number(Index, &'static str),
    /// A value, whatever it is, becomes one of another type.
    Type(Index, &'static str),
    /// A key that nobody knows.
    UnknownKey(Index),
    /// The text ends early.
    Truncate(Index),
    /// Bytes that may not even be text.
    Bytes(Index, Vec<u8>),
    /// Lists in lists in lists, or tables in tables.
    Nest(Index, u32, &'static str),
}

/// What numbers become.
const NUMBERS: [&str; 10] =
    ["nan", "inf", "-inf", "1e300", "-1e300", "-1", "0", "1e-300", "99999999999999999999", "-0.0"];
/// What values become.
const VALUES: [&str; 11] =
    ["\"text\"", "true", "[]", "[[[1]]]", "{}", "{ a = 1 }", "1979-05-27", "7", "0.5", "nan", ""];

/// Any mutation.
pub fn mutation() -> impl Strategy<Value = Mutation> {
    let at = any::<Index>;
    prop_oneof![
        at().prop_map(Mutation::DeleteLine),
        at().prop_map(Mutation::RepeatLine),
        (at(), at()).prop_map(|(one, other)| Mutation::SwapBlocks(one, other)),
        (at(), prop::sample::select(&NUMBERS[..])).prop_map(|(place, to)| Mutation::Number(place, to)),
        (at(), prop::sample::select(&VALUES[..])).prop_map(|(place, to)| Mutation::Type(place, to)),
        at().prop_map(Mutation::UnknownKey),
        at().prop_map(Mutation::Truncate),
        (at(), prop::collection::vec(any::<u8>(), 1..40))
            .prop_map(|(place, what)| Mutation::Bytes(place, what)),
        (at(), 1..5000_u32, prop::sample::select(&["[", "{a=", "a."][..]))
            .prop_map(|(place, depth, what)| Mutation::Nest(place, depth, what)),
    ]
}

/// The text with the damage done; what is damaged too much already stays as it is.
pub fn mutated(text: &str, mutation: &Mutation) -> Vec<u8> {
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    let value_lines: Vec<usize> = (0..lines.len()).filter(|&line| lines[line].contains(" = ")).collect();
    let numbers = numbers(text);
    if value_lines.is_empty() || numbers.is_empty() {
        return text.as_bytes().to_vec();
    }
    match mutation {
        Mutation::DeleteLine(at) => {
            lines.remove(at.index(lines.len()));
        }
        Mutation::RepeatLine(at) => {
            let line = at.index(lines.len());
            lines.insert(line, lines[line].clone());
        }
        Mutation::SwapBlocks(one, other) => {
            let mut blocks: Vec<&str> = text.split("\n\n").collect();
            let (one, other) = (one.index(blocks.len()), other.index(blocks.len()));
            blocks.swap(one, other);
            return blocks.join("\n\n").into_bytes();
        }
        Mutation::Number(at, to) => {
            let (from, until) = numbers[at.index(numbers.len())];
            return format!("{}{to}{}", &text[..from], &text[until..]).into_bytes();
        }
        Mutation::Type(at, to) => {
            let line = &mut lines[value_lines[at.index(value_lines.len())]];
            let from = line.find(" = ").map_or(0, |place| place + 3);
            line.replace_range(from.., to);
        }
        Mutation::UnknownKey(at) => {
            let line = at.index(lines.len());
            lines.insert(line, "colour = \"red\"".into());
        }
        Mutation::Truncate(at) => return text.as_bytes()[..at.index(text.len())].to_vec(),
        Mutation::Bytes(at, what) => {
            let mut bytes = text.as_bytes().to_vec();
            let place = at.index(bytes.len());
            bytes.splice(place..place, what.iter().copied());
            return bytes;
        }
        Mutation::Nest(at, depth, what) => {
            let line = at.index(lines.len());
            let nested = what.repeat(*depth as usize);
            let nested = if *what == "a." { format!("{nested}a = 1") } else { format!("deep = {nested}") };
            lines.insert(line, nested);
        }
    }
    lines.join("\n").into_bytes()
}

/// The text with one damage after the other.
pub fn damaged(text: &str, mutations: &[Mutation]) -> Vec<u8> {
    let mut bytes = text.as_bytes().to_vec();
    for mutation in mutations {
        // What is no text any more stays as it is.
        if let Ok(text) = std::str::from_utf8(&bytes) {
            bytes = mutated(text, mutation);
        }
    }
    bytes
}

/// Where the numbers of a text are, comments and names aside.
fn numbers(text: &str) -> Vec<(usize, usize)> {
    let belongs = |letter: char| letter.is_ascii_alphanumeric() || "._-+\"".contains(letter);
    let mut found = Vec::new();
    let mut from = 0;
    for word in text.split_inclusive(|letter| !belongs(letter)) {
        let number = word.trim_end_matches(|letter| !belongs(letter));
        let comment = text[..from].rsplit('\n').next().is_some_and(|line| line.contains('#'));
        if !comment && number.parse::<f64>().is_ok() {
            found.push((from, from + number.len()));
        }
        from += word.len();
    }
    found
}

/// Asserts that the command accepted the file or refused it with exit code 2 and one sentence about it.
pub fn answered_in_a_sentence(output: &Output, file: &str) -> Result<(), TestCaseError> {
    let said = String::from_utf8_lossy(&output.stderr);
    prop_assert!(!said.contains("panicked"), "{said}");
    match output.status.code() {
        Some(0) => prop_assert!(said.is_empty(), "{said}"),
        code => {
            prop_assert_eq!(code, Some(2), "{}", said);
            prop_assert!(output.stdout.is_empty());
            prop_assert!(said.starts_with(&format!("cogmint: {file}")), "{said}");
            prop_assert!(said.ends_with(".\n") && said.lines().count() == 1, "{said}");
            prop_assert!(said.len() < 2000, "{said}");
        }
    }
    Ok(())
}

/// The same cases every time, so that a failure can be repeated.
pub fn runner(cases: u32) -> TestRunner {
    let config = Config { cases, failure_persistence: None, ..Config::default() };
    TestRunner::new_with_rng(config, TestRng::deterministic_rng(RngAlgorithm::ChaCha))
}
