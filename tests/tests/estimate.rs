//! `cogmint estimate`: what it prints, what it finds in recordings whose truth is known, and what wrong use gets.

use cogmint_tests::outcome::{json, refused, text};
use cogmint_tests::{Folder, cogmint, shared_data};
use serde_json::Value;
use std::fs;
use std::path::Path;

/// A simulated recording in `folder/name`.
fn simulated(folder: &Path, scenario: &str, cycles: &str, name: &str) {
    let output = cogmint(folder, &["simulate", scenario, "--cycles", cycles, "--out", name]);
    assert!(output.status.success(), "{}", text(&output.stderr));
}

#[test]
fn paths_and_first_paths_of_a_simulated_room_are_where_they_truly_are() {
    let folder = Folder::new("estimate-room");
    simulated(folder.path(), "seminar-room", "60", "room");
    let outcome = json(&cogmint(folder.path(), &["estimate", "room", "--json"]));
    let recording = &outcome["recordings"][0];
    assert_eq!(recording["frames"].as_array().unwrap().len(), 120);
    for link in recording["links"].as_array().unwrap() {
        assert_eq!((&link["frames"], &link["line_of_sight"]), (&60.into(), &true.into()));
        // A direct path of some 30 dB is worth millimetres; the bound is a fifth of the pulse's 15 cm.
        let error = &link["first_path_error_m"];
        assert_eq!(error["count"], 60);
        assert!(error["median"].as_f64().unwrap().abs() < 0.01, "{error}");
        assert!(error["robust_std"].as_f64().unwrap() < 0.01, "{error}");
        assert!(error["std"].as_f64().unwrap() < 0.03, "{error}");
        let truth = &link["truth"];
        assert!(truth["detected_share_above_12_db"].as_f64().unwrap() > 0.9, "{truth}");
        assert!(truth["false_paths_per_frame"].as_f64().unwrap() < 0.5, "{truth}");
        let (left, noise) = (link["residual_share"].as_f64().unwrap(), link["noise_share"].as_f64().unwrap());
        assert!(noise < left && left < 0.9, "{left} {noise}");
    }
    for extension in ["svg", "png"] {
        let figure = folder.path().join("cogmint-out/room-estimate").with_extension(extension);
        assert!(fs::metadata(&figure).unwrap().len() > 10_000, "{}", figure.display());
    }
}

#[test]
fn cycles_and_anchors_are_chosen_and_paths_tabulated() {
    let folder = Folder::new("estimate-choice");
    simulated(folder.path(), "seminar-room", "12", "room");
    let arguments =
        ["estimate", "room", "--from", "5", "--cycles", "3", "--anchor", "1", "--csv", "paths.csv", "--json"];
    let outcome = json(&cogmint(folder.path(), &arguments));
    let frames = outcome["recordings"][0]["frames"].as_array().unwrap();
    let chosen: Vec<_> =
        frames.iter().map(|frame| (frame["cycle"].as_u64(), frame["anchor"].as_u64())).collect();
    assert_eq!(chosen, [(Some(5), Some(1)), (Some(6), Some(1)), (Some(7), Some(1))]);
    let paths: usize = frames.iter().map(|frame| frame["paths"].as_array().unwrap().len()).sum();
    let table = fs::read_to_string(folder.path().join("paths.csv")).unwrap();
    assert_eq!(table.lines().count(), 1 + paths);
    assert!(table.starts_with("recording,cycle,anchor,first_path_range_m,delay_s,range_m,"), "{table}");
    // More false paths are asked for, more paths are found.
    let lax = json(&cogmint(folder.path(), &["estimate", "room", "--false-paths", "10", "--json"]));
    let strict = json(&cogmint(folder.path(), &["estimate", "room", "--false-paths", "0.001", "--json"]));
    let count = |outcome: &Value| outcome["recordings"][0]["links"][0]["paths_per_frame"].as_f64().unwrap();
    assert!(count(&lax) > count(&strict) + 0.5);
    // The table for people names all that it shows.
    let said = text(&cogmint(folder.path(), &["estimate", "room"]).stdout);
    for part in
        ["first path, m", "against true paths", "direct path free: 2 links", "residual energy", "Figure: "]
    {
        assert!(said.contains(part), "{part:?} is missing in: {said}");
    }
}

#[test]
fn wrong_use_is_refused_with_the_reason() {
    let folder = Folder::new("estimate-wrong");
    simulated(folder.path(), "seminar-room", "10", "room");
    let estimate = |more: &[&str]| cogmint(folder.path(), &[&["estimate"], more].concat());
    refused(&estimate(&["nowhere"]), &["nowhere"]);
    refused(&estimate(&["room/recording.toml"]), &["recording.toml"]);
    refused(&estimate(&["room", "--from", "10"]), &["no cycle 10", "0 to 9"]);
    refused(&estimate(&["room", "--anchor", "2"]), &["no anchor 2", "0 to 1"]);
    refused(&estimate(&["room", "--draw", "10"]), &["no cycle 10"]);
    refused(&estimate(&["room", "--cycles", "0"]), &["--cycles"]);
    for rate in ["0", "11", "NaN", "x"] {
        refused(&estimate(&["room", "--false-paths", rate]), &["--false-paths"]);
    }
    refused(&estimate(&[]), &["DIR"]);
}

/// Real responses, of links whose line of sight is known: the first path scatters less, against the response itself,
/// than the radio's own range and than its own first-path index.
#[test]
fn first_paths_of_real_links_scatter_less_than_the_radios_own() {
    let Some(data) = shared_data("warsaw") else { return };
    let folder = Folder::new("estimate-flat");
    let flat = data.canonicalize().unwrap().to_string_lossy().into_owned();
    assert!(cogmint(folder.path(), &["import", "warsaw", &flat, "--out", "flat"]).status.success());
    let outcome = json(&cogmint(folder.path(), &["estimate", "flat", "--json"]));
    assert_eq!(outcome["recordings"].as_array().unwrap().len(), 18);
    let free = &outcome["summaries"][0];
    assert_eq!((&free["line_of_sight"], &free["links"]), (&true.into(), &5.into()));
    let share = |key: &str| free[key]["by_std"].as_f64().unwrap();
    assert!(share("first_path_spread_no_larger_than_range") >= 0.8, "{free}");
    assert!(share("first_path_spread_no_larger_than_radio") >= 0.8, "{free}");
    // No response without a first path, and none with one far from where the radio saw it.
    for recording in outcome["recordings"].as_array().unwrap() {
        let link = &recording["links"][0];
        if link["line_of_sight"] == true {
            assert_eq!(link["first_path_range_m"]["count"], 40);
            assert!(link["first_path_range_m"]["std"].as_f64().unwrap() < 0.15, "{link}");
        }
    }
}
