//! The core's modules and what they hand to each other, read from their imports; and the picture of it.
//!
//! The picture is an N-squared chart: the blocks stand on the diagonal in the order in which data goes through them, and
//! what one hands to a later one stands in the row of the first and the column of the second. What would go back would
//! stand below the diagonal: nothing does.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::path::Path;

/// A block of the diagram: a file or a folder of `core/src`, without `.rs`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Block {
    /// Path of the file or folder.
    pub path: &'static str,
    /// The states it owns: types that no later block but the tracker may name.
    pub states: &'static [&'static str],
}

const fn block(path: &'static str, states: &'static [&'static str]) -> Block {
    Block { path, states }
}

/// What all blocks are built on, each on the ones before it.
pub const BASE: [&str; 6] = ["real", "trace", "snapshot", "error", "radio", "model"];

/// The blocks in the order of the cycle.
pub const BLOCKS: [Block; 20] = [
    block("perceptor/channel_estimator", &["ChannelEstimator"]),
    block("perceptor/gain_control", &["GainControl"]),
    block("perceptor/scan", &[]),
    block("perceptor/receiver", &["Receiver"]),
    block("perceptor/expectation", &[]),
    block("perceptor/association", &[]),
    block("perceptor/state_filter", &["StateFilter"]),
    block("perceptor/below_threshold", &[]),
    block("perceptor/belief", &["TagBelief"]),
    block("perceptor/smoother", &["FixedLag"]),
    block("memory/environment", &["EnvironmentMemory"]),
    block("memory/transmission", &["TransmissionMemory"]),
    block("memory/discovery", &["Discovery"]),
    block("memory/clutter", &["ClutterMemory"]),
    block("memory/lateness", &["LatenessMemory"]),
    block("memory/channel", &["ChannelMemory"]),
    block("information", &[]),
    block("controller", &["Controllers", "Controller", "ActionValues"]),
    block("application", &[]),
    block("tracker", &["Tracker"]),
];

/// Where a stage is made of others: it holds their state.
const PARTS: [(&str, &str); 3] = [
    ("perceptor/receiver", "ChannelEstimator"),
    ("perceptor/receiver", "GainControl"),
    ("perceptor/belief", "StateFilter"),
];

/// Files that put the whole together for the user.
const WHOLE: [&str; 4] = ["lib", "config", "observer", "report"];
/// What the crate's root exports again: no block may take the whole by that way.
const ROOT: [&str; 3] = ["Config", "CycleReport", "Tracker"];
/// What may change the whole tracker: the ways in, and the sweep of all state, which mends what is broken.
const ENTRIES: [&str; 20] = [
    "begin",
    "check_seals",
    "cycle",
    "cycle_observed",
    "finish",
    "finish_observed",
    "finish_unswept",
    "mend",
    "poll_cycle",
    "read",
    "receive",
    "receive_observed",
    "restore",
    "restore_map",
    "restrict",
    "start",
    "sweep",
    "switch_antenna",
    "tell_channel",
    "tell_range_bias",
];

/// A source file: its path below `core/src`, without `.rs`, and its code without comments and tests.
#[derive(Clone, Debug)]
pub struct Source {
    /// The path, with `/`.
    pub path: String,
    /// The code.
    pub code: String,
}

impl Source {
    /// Without what belongs to tests and to the reader alone.
    pub fn new(path: &str, text: &str) -> Self {
        let mut parts = text.match_indices("#[cfg(test)]\n");
        let is_tests = |after: &str| after.lines().next().is_some_and(|line| line.contains("mod tests {"));
        let tests = parts.find(|(at, mark)| is_tests(&text[at + mark.len()..]));
        let code = tests.map_or(text, |(at, _)| &text[..at]);
        let lines = code.lines().map(|line| line.split("//").next().unwrap_or_default());
        Self { path: path.to_owned(), code: lines.collect::<Vec<_>>().join("\n") }
    }
}

/// All source files below a folder.
///
/// # Errors
/// A file or folder that cannot be read.
pub fn sources(root: &Path) -> std::io::Result<Vec<Source>> {
    let mut found = Vec::new();
    let mut folders = vec![root.to_path_buf()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder)? {
            let path = entry?.path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                let below = path.strip_prefix(root).unwrap_or(&path).with_extension("");
                let name = below.to_string_lossy().replace('\\', "/");
                found.push(Source::new(&name, &std::fs::read_to_string(&path)?));
            }
        }
    }
    found.sort_by(|a, b| a.path.cmp(&b.path));
    Ok(found)
}

/// Whether a module path is that of a block or base, or lies in it.
fn is_in(path: &str, block: &str) -> bool {
    path == block || path.strip_prefix(block).is_some_and(|rest| rest.starts_with('/'))
}

/// The modules and names that a source imports from the rest of the crate, each as a path `a/b/Name`.
pub fn imports(source: &Source) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    let own: Vec<&str> = source.path.trim_end_matches("/mod").split('/').collect();
    for (start, _) in source.code.match_indices("use ") {
        let statement = &source.code[start + 4..];
        let Some(end) = statement.find(';') else { continue };
        collect(statement[..end].trim(), &own, &[], &mut found);
    }
    // Paths in the code itself.
    for (start, _) in source.code.match_indices("crate::") {
        let path: String = source.code[start + 7..]
            .chars()
            .take_while(|c| c.is_alphanumeric() || matches!(c, '_' | ':'))
            .collect();
        found.insert(path.trim_end_matches(':').replace("::", "/"));
    }
    found.retain(|path| !path.is_empty());
    found
}

/// Resolves one tree of a `use` statement.
fn collect(tree: &str, own: &[&str], before: &[&str], found: &mut BTreeSet<String>) {
    let tree = tree.trim();
    if let Some((head, rest)) = tree.split_once('{').filter(|(head, _)| !head.contains(',')) {
        let segments: Vec<&str> =
            before.iter().copied().chain(head.split("::").map(str::trim).filter(|s| !s.is_empty())).collect();
        let inner = rest.trim().strip_suffix('}').unwrap_or(rest);
        let mut depth = 0;
        let mut begin = 0;
        for (index, c) in inner.char_indices().chain(std::iter::once((inner.len(), ','))) {
            match c {
                '{' => depth += 1,
                '}' => depth -= 1,
                ',' if depth == 0 => {
                    collect(&inner[begin..index], own, &segments, found);
                    begin = index + 1;
                }
                _ => {}
            }
        }
        return;
    }
    let tree = tree.split(" as ").next().unwrap_or(tree);
    let mut segments: Vec<&str> = before.to_vec();
    segments.extend(tree.split("::").map(str::trim).filter(|segment| !segment.is_empty()));
    let path = match segments.split_first() {
        Some((&"crate", rest)) => rest.to_vec(),
        Some((&"super", _)) => {
            let up = segments.iter().take_while(|segment| **segment == "super").count();
            let kept = own.len().saturating_sub(up);
            own[..kept].iter().copied().chain(segments[up..].iter().copied()).collect()
        }
        Some((&"self", rest)) => own.iter().copied().chain(rest.iter().copied()).collect(),
        _ => return,
    };
    if !path.is_empty() {
        found.insert(path.join("/"));
    }
}

/// What breaks the diagram: imports that go back, states named by others, functions that change the whole tracker.
pub fn faults(sources: &[Source]) -> Vec<String> {
    let mut faults = Vec::new();
    let is_whole =
        |path: &str| WHOLE.contains(&path) || path.ends_with("/mod") && path.matches('/').count() == 1;
    for source in sources {
        let module = source.path.trim_end_matches("/mod");
        let base = BASE.iter().position(|block| is_in(module, block));
        let own = BLOCKS.iter().position(|block| is_in(module, block.path));
        if base.is_none() && own.is_none() && !is_whole(&source.path) {
            faults.push(format!("{}: is in no block of the diagram", source.path));
        }
        for import in imports(source) {
            let from_base = BASE.iter().position(|block| is_in(&import, block));
            let from = BLOCKS.iter().position(|block| is_in(&import, block.path));
            let goes_back = match (base, own) {
                (Some(base), _) => from.is_some() || from_base.is_some_and(|from| from > base),
                (None, Some(own)) => from.is_some_and(|from| from > own),
                (None, None) => false,
            };
            let takes_the_whole = own.is_some_and(|own| BLOCKS[own].path != "tracker")
                && (WHOLE.iter().any(|whole| is_in(&import, whole))
                    || ROOT.iter().any(|root| is_in(&import, root)));
            let takes_the_root = base.is_some() && ROOT.iter().any(|root| is_in(&import, root));
            if goes_back || takes_the_whole || takes_the_root || import.ends_with('*') {
                faults.push(format!("{}: imports {import}, which comes after it", source.path));
            }
        }
        for block in BLOCKS {
            for state in block.states {
                let is_part = PARTS.iter().any(|(path, part)| part == state && is_in(module, path));
                let may_name = is_in(module, block.path) || is_in(module, "tracker") || is_part;
                if !may_name
                    && (own.is_some() || is_in(module, "model") || is_in(module, "radio"))
                    && names(&source.code, state)
                {
                    faults.push(format!("{}: names the state {state} of {}", source.path, block.path));
                }
            }
        }
        for way in ["&mut Tracker", "&mut Self", "self: &mut"] {
            if source.code.contains(way) {
                faults.push(format!("{}: takes the whole tracker by {way}", source.path));
            }
        }
        if is_in(module, "tracker") {
            for (start, _) in source.code.match_indices("&mut self") {
                let signature = source.code[..start].rfind("fn ").unwrap_or(0);
                let name = source.code[signature + 3..].split(['(', '<']).next().unwrap_or_default();
                if !ENTRIES.contains(&name) {
                    faults.push(format!("{}: {name} changes the whole tracker and is no entry", source.path));
                }
            }
        }
    }
    faults
}

/// Whether code names a type.
fn names(code: &str, name: &str) -> bool {
    code.match_indices(name).any(|(start, _)| {
        let is_word = |c: char| c.is_alphanumeric() || c == '_';
        !code[..start].ends_with(is_word) && !code[start + name.len()..].starts_with(is_word)
    })
}

/// The names that one block imports from another, without those of modules.
fn handed(sources: &[Source], from: &Block, to: &Block) -> BTreeSet<String> {
    let files = sources.iter().filter(|source| is_in(source.path.trim_end_matches("/mod"), to.path));
    let all = files.flat_map(imports).filter(|import| is_in(import, from.path));
    all.filter_map(|import| import.rsplit('/').next().map(str::to_owned))
        .filter(|name| name.chars().next().is_some_and(char::is_uppercase))
        .filter(|name| name.chars().any(char::is_lowercase))
        .collect()
}

const CELL_W: f64 = 116.0;
const CELL_H: f64 = 46.0;

/// The picture, as SVG.
pub fn draw(sources: &[Source]) -> String {
    // The tracker joins all of them: it is the frame and no block of its own.
    let blocks = &BLOCKS[..BLOCKS.len() - 1];
    let count = blocks.len() as f64;
    let (width, height) = (CELL_W * count + 40.0, CELL_H * count + 110.0);
    let mut svg = String::new();
    let text = |svg: &mut String, x: f64, y: f64, size: f64, weight: &str, content: &str| {
        let _ = writeln!(
            svg,
            r##"<text x="{x}" y="{y}" font-size="{size}" font-weight="{weight}" text-anchor="middle" fill="#1c2733">{content}</text>"##
        );
    };
    let _ = writeln!(
        svg,
        r##"<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" font-family="sans-serif">
<rect width="{width}" height="{height}" fill="#ffffff"/>
<rect x="8" y="8" width="{}" height="{}" rx="6" fill="#f4f6f8" stroke="#8796a5"/>"##,
        width - 16.0,
        CELL_H * count + 44.0
    );
    text(
        &mut svg,
        width / 2.0,
        28.0,
        13.0,
        "bold",
        "tracker: what a block hands to a later one stands right of the first, above the second",
    );
    for (row, from) in blocks.iter().enumerate() {
        let y = 40.0 + CELL_H * row as f64;
        let x = 20.0 + CELL_W * row as f64;
        let fill = match from.path.split('/').next() {
            Some("perceptor") => "#cfe3f5",
            Some("memory") => "#d9ecd0",
            Some("information" | "controller") => "#f8e2c0",
            _ => "#e9dcf1",
        };
        let _ = writeln!(
            svg,
            r##"<rect x="{}" y="{}" width="{}" height="{}" rx="4" fill="{fill}" stroke="#51606f"/>"##,
            x + 2.0,
            y + 3.0,
            CELL_W - 4.0,
            CELL_H - 6.0
        );
        let (folder, name) = from.path.split_once('/').unwrap_or(("", from.path));
        text(&mut svg, x + CELL_W / 2.0, y + 20.0, 10.5, "bold", &name.replace('_', " "));
        text(&mut svg, x + CELL_W / 2.0, y + 34.0, 9.0, "normal", folder);
        for (column, to) in blocks.iter().enumerate().skip(row + 1) {
            let names: Vec<String> = handed(sources, from, to).into_iter().collect();
            let (cx, cy) = (20.0 + CELL_W * (column as f64 + 0.5), y + CELL_H / 2.0);
            let shown = names.len().min(3);
            for (line, name) in names.iter().take(shown).enumerate() {
                let more = names.len() - shown;
                let name =
                    if line + 1 == shown && more > 0 { format!("{name} + {more}") } else { name.clone() };
                let offset = 11.0 * (line as f64 - 0.5 * (shown as f64 - 1.0));
                text(&mut svg, cx, cy + 3.5 + offset, 9.0, "normal", &name);
            }
        }
    }
    let y = CELL_H * count + 62.0;
    let wide = (width - 16.0) / 2.0;
    for (index, (name, what)) in [
        (
            "model",
            "anchors, sources, observations, measurements, motion, range regression, soft update, clock",
        ),
        ("radio", "action library, pulse, link; real, error, trace"),
    ]
    .iter()
    .enumerate()
    {
        let x = 8.0 + wide * index as f64;
        let _ = writeln!(
            svg,
            r##"<rect x="{x}" y="{y}" width="{}" height="38" rx="4" fill="#e3e7eb" stroke="#51606f"/>"##,
            wide - 4.0
        );
        text(&mut svg, x + wide / 2.0, y + 16.0, 11.0, "bold", name);
        text(&mut svg, x + wide / 2.0, y + 30.0, 9.0, "normal", what);
    }
    svg.push_str("</svg>\n");
    svg
}
