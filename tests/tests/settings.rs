//! Every number of the core has an owner: settings are few, and constants say what they are.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// Settings in all of the core, at most.
const MOST_SETTINGS: usize = 60;
/// The structs that a user configures the core with.
const ROOTS: [&str; 2] = ["Config", "WaypointSettings"];
/// What a constant may be, as the first word of its comment: mathematics (series, grids, fits), a guard (against what, it says),
/// or a capacity that bounds memory or time.
const CLASSES: [&str; 4] = ["Mathematics: ", "Guard: ", "Capacity: ", TUNED];
/// What is none of these and no setting yet: a number that was tried out. They become settings, follow from others, or go.
const TUNED: &str = "Tuned: ";
const MOST_TUNED: u32 = 39;
fn core_source() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../core/src")
}

/// The core's source files without their unit tests, by path.
fn sources() -> BTreeMap<PathBuf, String> {
    fn walk(folder: &Path, files: &mut BTreeMap<PathBuf, String>) {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                walk(&path, files);
            } else {
                let text = fs::read_to_string(&path).unwrap();
                let code = text.split("#[cfg(test)]\nmod tests").next().unwrap().to_owned();
                files.insert(path, code);
            }
        }
    }
    let mut files = BTreeMap::new();
    walk(&core_source(), &mut files);
    files
}

/// The bodies of all public structs and enums, without comments, by name.
fn bodies() -> BTreeMap<String, String> {
    let mut bodies = BTreeMap::new();
    for text in sources().values() {
        let lines = text.lines().map(|line| line.split("//").next().unwrap_or_default());
        let code = lines.collect::<Vec<_>>().join("\n");
        for keyword in ["pub struct ", "pub enum "] {
            for declaration in code.split(keyword).skip(1) {
                let name: String =
                    declaration.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
                // Declarations of structs and enums end with a brace in the first column.
                let body = declaration.split("\n}").next().unwrap_or_default();
                bodies.insert(name, body.to_owned());
            }
        }
    }
    bodies
}

/// Numbers in the fields of a struct or enum and of those that they are made of. An array is as many as a literal length says,
/// or one table.
fn numbers(name: &str, bodies: &BTreeMap<String, String>, counted: &mut BTreeSet<String>) -> usize {
    let Some(body) = bodies.get(name) else { return 0 };
    counted.insert(name.to_owned());
    let mut sum = 0;
    let mut before = ' ';
    let mut rest = body.as_str();
    while let Some(start) = rest.find(|c: char| c.is_alphanumeric() || c == '_') {
        before = rest[..start].trim_end().chars().last().unwrap_or(before);
        let word_end = rest[start..].find(|c: char| !(c.is_alphanumeric() || c == '_'));
        let end = word_end.map_or(rest.len(), |end| start + end);
        let word = &rest[start..end];
        // A type follows a colon or a bracket; names of fields and variants do not.
        if [':', '<', '[', '('].contains(&before) {
            if ["f32", "f64", "u8", "u16", "u32", "u64", "usize", "i32"].contains(&word) {
                let length = rest[end..].strip_prefix("; ").and_then(|rest| rest.split(']').next());
                sum += length.filter(|_| before == '[').and_then(|length| length.parse().ok()).unwrap_or(1);
            } else if word != name {
                sum += numbers(word, bodies, counted);
            }
        }
        before = ' ';
        rest = &rest[end..];
    }
    sum
}

#[test]
fn the_core_has_at_most_sixty_numbers_to_set() {
    let bodies = bodies();
    let mut counted = BTreeSet::new();
    let sum: usize = ROOTS.iter().map(|root| numbers(root, &bodies, &mut counted)).sum();
    println!("{sum} numbers in {counted:?}");
    for part in ["Motion", "Ranging", "Radio", "EstimatorSettings", "PulseShape", "Choice"] {
        assert!(counted.contains(part), "{part} was not counted");
    }
    assert!(sum <= MOST_SETTINGS, "{sum} numbers to set, at most {MOST_SETTINGS} wanted: {counted:?}");
}

#[test]
fn every_constant_says_what_it_is() {
    let mut wrong = Vec::new();
    let mut classes = BTreeMap::new();
    for (path, text) in sources() {
        let place = path.strip_prefix(core_source()).unwrap().to_owned();
        let mut comment = String::new();
        for line in text.lines() {
            if let Some(more) = line.strip_prefix("/// ") {
                comment.push_str(more);
                comment.push(' ');
                continue;
            }
            let declared = line.trim_start_matches("pub(super) ").trim_start_matches("pub ");
            let kind = declared
                .strip_prefix("const ")
                .filter(|rest| !rest.starts_with("fn "))
                .and_then(|rest| rest.split([':', '=']).nth(1));
            if kind.is_some_and(|kind| {
                ["f32", "u8", "u16", "u32", "usize", "[f32; "].iter().any(|n| kind.trim().starts_with(n))
            }) {
                match CLASSES.iter().find(|class| comment.starts_with(**class)) {
                    Some(class) => *classes.entry(*class).or_insert(0) += 1,
                    None => wrong.push(format!("{}: {line}", place.display())),
                }
            }
            comment.clear();
        }
    }
    println!("{classes:?}");
    assert!(classes.values().sum::<u32>() > 50, "constants were not found: {classes:?}");
    let tuned = classes.get(TUNED).copied().unwrap_or_default();
    assert!(tuned <= MOST_TUNED, "{tuned} tuned constants, {MOST_TUNED} were left");
    assert!(wrong.is_empty(), "constants that do not say what they are:\n{}", wrong.join("\n"));
}
