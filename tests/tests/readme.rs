//! The README's commands run: each at reduced size, and none is there that this test does not know.

use cogmint_tests::{Folder, cogmint, root, shared_data};
use std::path::Path;
use std::process::Command;

/// Every `cogmint` command as the README writes it, and what is run for it in a folder that holds a scenario
/// `room.toml`, a recording `r` and the ranges of [`write_inputs`]. `DATA` stands for the recordings that nobody here made:
/// without them, such a line is left out.
const COMMANDS: [(&str, &[&str]); 37] = [
    ("cogmint", &["--cycles 20"]),
    (
        "cogmint scenario list",
        &["scenario list", "scenario show corridor", "scenario check room.toml", "scenario schema"],
    ),
    (
        "cogmint simulate SCENARIO --out DIR [--seed N] [--trajectory K]",
        &["simulate room.toml --out simulated --seed 2 --trajectory 0"],
    ),
    ("cogmint plot room SCENARIO", &["plot room room.toml"]),
    ("cogmint plot carriers SCENARIO", &["plot carriers room.toml"]),
    ("cogmint plot channel DIR --cycle N", &["plot channel r --cycle 3"]),
    (
        "cogmint import bp-slam --anchors F --truth F --ranges F --out DIR",
        &["import bp-slam --anchors anchors.csv --truth truth.csv --ranges ranges.csv --out slam"],
    ),
    (
        "cogmint import miluv F.npz --out DIR [--bodies]",
        &[
            "import miluv DATA/miluv/random_1.npz --out flight",
            "import miluv DATA/miluv/random_1.npz --out drones --bodies",
        ],
    ),
    ("cogmint import warsaw DIR --out DIR", &["import warsaw DATA/warsaw --out flat"]),
    (
        "cogmint import snapshot --places F --paths F --anchor X,Y [--map X,Y]... --out DIR",
        &[
            "import snapshot --places places.csv --paths paths.csv --anchor 0,0 --map 5,5 --map -3,2 --out snapshot",
        ],
    ),
    (
        "cogmint thin DIR --out DIR [--every-s T] [--ranges-per-cycle N]",
        &["thin r --out thinned --every-s 0.25 --ranges-per-cycle 1"],
    ),
    (
        "cogmint plan FILE [--format table\\|toml\\|rust] [--check]",
        &["plan room.toml", "plan corridor --format toml", "plan r --format rust", "plan room.toml --check"],
    ),
    ("cogmint experiment walls [--runs N] [--seed S]", &["experiment walls --runs 1 --seed 3"]),
    (
        "cogmint calibrate DIR... [--out FILE] [--cycles CHOICE] [--no-truth] [--anchor-std-m M] [--format table\\|toml\\|rust]",
        &[
            "calibrate r --out c.toml --cycles odd",
            "calibrate r --no-truth --anchor-std-m 0.05 --format rust",
        ],
    ),
    (
        "cogmint experiment tracking --recording DIR/tag-10 --starts 20 --score even [--calibration FILE]",
        &["experiment tracking --recording r --starts 1 --score even --calibration c.toml"],
    ),
    (
        "cogmint track DIR [--seed N] [--variant NAME] [--lag SECONDS] [--calibration FILE] [--score CHOICE] [--table FILE] [--no-figure] [--json]",
        &[
            "track r --seed 3 --variant direct --table t.csv --no-figure --json",
            "track r --calibration c.toml --score even --no-figure",
        ],
    ),
    ("cogmint track DIR", &["track r"]),
    ("cogmint track DIR/drone-1 --lag 1", &["track r --lag 1 --no-figure"]),
    ("cogmint estimate DIR...", &["estimate r r"]),
    (
        "cogmint experiment estimator [--trials N] [--against all]",
        &["experiment estimator --trials 10 --against all"],
    ),
    ("cogmint experiment estimator --trials 8000", &["experiment estimator --trials 10"]),
    (
        "cogmint experiment tracking [--runs N] [--only NAME,...] [--variant NAME,...]",
        &["experiment tracking --runs 1 --only slam --variant soft,probabilistic"],
    ),
    ("cogmint experiment tracking --runs 100", &["experiment tracking --runs 1 --only known-plan"]),
    (
        "cogmint experiment tracking --recording DIR --starts 20",
        &["experiment tracking --recording r --starts 2"],
    ),
    (
        "cogmint experiment tracking --recording DIR/drone-1 --starts 20",
        &["experiment tracking --recording r --starts 1"],
    ),
    ("cogmint experiment rooms", &["experiment rooms --count 3 --draw"]),
    (
        "cogmint experiment rooms --seed 200001 --count 300 --plan exact,0.1 --start 0.25,1 --interference none",
        &[
            "experiment rooms --count 1 --seed 200001 --plan exact,0.1 --start 0.25,1 --interference none --only ekf",
        ],
    ),
    (
        "cogmint experiment rooms [--count N] [--seed S] [--family NAME,...] [--plan NAME,...] [--start NAME,...] [--interference NAME,...] [--anchors N,...] [--incident NAME] [--defect NAME] [--belief NAME=VALUE] [--only TRACKER,...] [--csv FILE] [--write DIR]",
        &[
            "experiment rooms --count 1 --seed 7 --family stairwell --plan exact,0.1 --start 1 --interference none --belief turns_per_s=1 --only told,ekf --csv rooms.csv --write rooms",
        ],
    ),
    (
        "cogmint experiment trackers DIR... [--only TRACKER,...] [--seed N]",
        &["experiment trackers r --only cogmint,told,direct,ekf,particles --seed 2"],
    ),
    (
        "cogmint experiment controllers [--scenario S] [--interference DB] [--then HZ] [--variant NAME] [--ablation] [--plot DIR]",
        &[
            "experiment controllers --scenario room.toml --runs 1 --only fixed,cognitive --variant probabilistic --plot controllers",
        ],
    ),
    (
        "cogmint experiment controllers --interference=-8 --library wide --runs 6",
        &[
            "experiment controllers --scenario room.toml --interference=-8 --then 6e9 --library wide --runs 1 --only fixed",
        ],
    ),
    (
        "cogmint experiment survival [--library published\\|wide]",
        &["experiment survival --scenario room.toml --runs 1 --strongest 0 --only fixed"],
    ),
    (
        "cogmint experiment survival --library wide --runs 30",
        &["experiment survival --scenario room.toml --library wide --runs 1 --strongest 0 --only fixed"],
    ),
    (
        "cogmint experiment waypoints [--scenario S] [--metres-per-nat M]",
        &["experiment waypoints --scenario room.toml --runs 1"],
    ),
    ("cogmint verify [--recording DIR] [--cycles N] [--json]", &["verify --recording r --cycles 5 --json"]),
    ("cogmint verify", &["verify --recording r --cycles 3"]),
    (
        "cogmint trace [--recording DIR] [--cycles N] [--feed FILE]",
        &["trace --recording r --cycles 3 --feed f.bin"],
    ),
];

/// A room of few carriers and a short way.
const ROOM: &str = r#"
format = 1
name = "A room"

[room]
corners_m = [[0, 0], [6, 0], [6, 4], [0, 4]]
construction = "brick"

[[anchors]]
name = "a"
position_m = [0.5, 3.5]

[[anchors]]
name = "b"
position_m = [5.5, 0.5]

[[trajectories]]
period_s = 0.1
way.polyline = { vertices_m = [[1, 1], [5, 3]], step_m = 0.1 }

[radio]
library = [
    { carrier_hz = 6.5e9, pulse_duration_s = 0.5e-9 },
    { carrier_hz = 7.0e9, pulse_duration_s = 0.5e-9 },
    { carrier_hz = 7.5e9, pulse_duration_s = 0.5e-9 },
]
"#;

fn write_inputs(folder: &Path) {
    let write = |name: &str, text: &str| std::fs::write(folder.join(name), text).unwrap();
    write("room.toml", ROOM);
    write(
        "anchors.csv",
        "sensor,index,is_physical_anchor,x_m,y_m\n1,0,1,0.0,0.0\n1,1,0,4.0,9.0\n2,0,1,5.0,0.0\n",
    );
    write("truth.csv", "step,x_m,y_m\n0,1.0,2.0\n1,1.0,2.01\n2,1.0,2.02\n");
    write("ranges.csv", "step,sensor,range_m\n0,1,2.2\n0,2,4.5\n1,1,2.2\n2,2,4.4\n");
    write("places.csv", "place,x_m,y_m,heading_rad\n0,3.0,4.0,0.0\n1,3.5,4.0,0.0\n2,4.0,4.0,0.0\n");
    write(
        "paths.csv",
        "place,range_m,departure_angle_rad,arrival_angle_rad,power_db\n0,5.0,0.1,0.2,-40\n1,5.3,0.1,0.2,-40\n2,5.7,0.1,0.2,-40\n",
    );
}

/// What the README says in backticks and in blocks of commands.
fn spans(readme: &str) -> Vec<String> {
    let mut spans = Vec::new();
    let mut block: Option<bool> = None;
    for line in readme.lines() {
        if let Some(language) = line.strip_prefix("```") {
            block = if block.is_some() { None } else { Some(language == "sh") };
            continue;
        }
        match block {
            Some(true) => spans.push(line.split('#').next().unwrap_or_default().trim().to_owned()),
            Some(false) => {}
            // Odd pieces are between backticks.
            None => spans.extend(line.split('`').skip(1).step_by(2).map(str::to_owned)),
        }
    }
    spans
}

#[test]
fn every_command_of_the_readme_runs() {
    let readme = std::fs::read_to_string(root().join("README.md")).unwrap();
    let spans = spans(&readme);
    let in_readme = |of: &&String| of.starts_with("cogmint ") || *of == "cogmint";
    for span in spans.iter().filter(in_readme) {
        assert!(COMMANDS.iter().any(|(known, _)| known == span), "no test of `{span}`");
    }
    let folder = Folder::new("readme");
    write_inputs(folder.path());
    let run = |line: &str| {
        let arguments: Vec<&str> = line.split(' ').collect();
        let output = cogmint(folder.path(), &arguments);
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "cogmint {line}: {said}");
        assert!(!output.stdout.is_empty(), "cogmint {line} prints nothing");
    };
    run("simulate room.toml --out r");
    for (command, lines) in COMMANDS {
        assert!(spans.iter().any(|span| span == command), "`{command}` is not in the README");
        for line in lines {
            match line.contains("DATA").then(|| shared_data(".")) {
                None => run(line),
                Some(Some(data)) => run(&line.replace("DATA", &data.to_string_lossy())),
                Some(None) => {}
            }
        }
    }
}

#[test]
fn what_the_readme_says_of_cargo_and_scripts_is_there() {
    let readme = std::fs::read_to_string(root().join("README.md")).unwrap();
    for span in spans(&readme) {
        let words: Vec<&str> = span.split(' ').collect();
        let after = |flag: &str| {
            let place = words.iter().position(|word| *word == flag)?;
            words.get(place + 1).copied()
        };
        match words[..] {
            ["bash", script, ..] => {
                let script = root().join(script);
                let checked = Command::new("bash").arg("-n").arg(&script).status().expect("bash runs");
                assert!(script.is_file() && checked.success(), "`{span}`");
            }
            ["cargo", ..] => {
                let package = after("-p").unwrap_or("cogmint");
                let of_package = root().join(match package {
                    "cogmint" => "host-sim",
                    "cogmint-core" => "core",
                    "cogmint-tests" => "tests",
                    other => panic!("`{span}`: no package {other}"),
                });
                for (flag, parent) in [("--test", "tests"), ("--example", "examples"), ("--bench", "benches")]
                {
                    let Some(name) = after(flag) else { continue };
                    let places = [format!("{parent}/{name}.rs"), format!("{parent}/{name}/main.rs")];
                    assert!(places.iter().any(|place| of_package.join(place).is_file()), "`{span}`");
                }
            }
            _ => {}
        }
    }
}

/// Scripts build with `--locked`: a lock file that is behind stops them on a clean clone.
#[test]
fn every_lock_file_is_current() {
    for folder in ["", "firmware-stub", "c", "c/header", "tests/peer/filters-on-target"] {
        let output = Command::new(env!("CARGO"))
            .args(["metadata", "--locked", "--format-version", "1"])
            .current_dir(root().join(folder))
            .output()
            .expect("cargo runs");
        assert!(output.status.success(), "{folder}: {}", String::from_utf8_lossy(&output.stderr));
    }
}
