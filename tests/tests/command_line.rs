//! The command line: what it prints, and what wrong use gets: a sentence with file and reason, exit code 2.

use cogmint_tests::outcome::{json, refused, text};
use cogmint_tests::{Folder, cogmint, shared_data};
use std::fs;
use std::path::Path;

/// A small recording in `folder`, made by the library.
fn small_recording(folder: &Path) {
    let room = cogmint::demo::seminar_room(1, 12).unwrap();
    let run = cogmint::demo::run(&room, true, 1, || {}).unwrap();
    run.recording.write(folder).unwrap();
}

#[test]
fn without_arguments_it_compares_fixed_and_cognitive_and_draws_both() {
    let folder = Folder::new("demo");
    let output = cogmint(folder.path(), &[]);
    let said = text(&output.stdout);
    assert!(output.status.success(), "{}", text(&output.stderr));
    assert!(said.contains("fixed") && said.contains("cognitive") && said.contains("room.png"), "{said}");
    for extension in ["svg", "png"] {
        let figure = folder.path().join("cogmint-out").join("room").with_extension(extension);
        assert!(fs::metadata(&figure).unwrap().len() > 10_000, "{}", figure.display());
    }
}

#[test]
fn track_prints_one_object_with_the_keys_promised() {
    let folder = Folder::new("track");
    small_recording(&folder.path().join("r"));
    let outcome = json(&cogmint(folder.path(), &["track", "r", "--json"]));
    for key in ["cycles", "rmse_m", "p50_m", "p90_m", "p95_m", "max_m", "diverged", "us_per_cycle"] {
        assert!(outcome.get(key).is_some(), "{key} is missing in {outcome}");
    }
    assert_eq!(outcome["cycles"], 12);
    for key in ["nees", "nees_within_95", "nis"] {
        assert!(outcome[key].as_f64().is_some_and(|value| value >= 0.0), "{key} in {outcome}");
    }
    let map = &outcome["virtual_anchors"];
    for key in ["true", "found", "spurious"] {
        assert!(map[key].is_u64(), "{key} in {outcome}");
    }
    assert!(map["ospa_m"].as_f64().is_some_and(|m| (0.0..=1.0).contains(&m)), "{outcome}");
    let listed = outcome["virtual_anchors_found"].as_array().map(Vec::len);
    assert_eq!(map["found"].as_u64(), listed.map(|number| number as u64));
    let table = text(&cogmint(folder.path(), &["track", "r"]).stdout);
    assert!(table.contains("NEES") && table.contains("OSPA"), "{table}");
    assert!(folder.path().join("cogmint-out/r-track.svg").is_file());
    assert!(folder.path().join("cogmint-out/r-track.png").is_file());
}

#[test]
fn an_experiment_on_controllers_names_the_folder_that_it_cannot_draw_into() {
    let folder = Folder::new("experiment-controllers-plot");
    fs::write(folder.path().join("file"), "").unwrap();
    let arguments = ["experiment", "controllers", "--runs", "1", "--plot", "file/pictures"];
    let output = cogmint(folder.path(), &arguments);
    assert_eq!(output.status.code(), Some(1));
    assert!(text(&output.stderr).contains("file/pictures"), "{}", text(&output.stderr));
    // It is noticed before the runs.
    assert!(text(&output.stdout).is_empty(), "{}", text(&output.stdout));
}

#[test]
fn an_experiment_on_tracking_prints_its_figures_as_promised() {
    let folder = Folder::new("experiment-tracking");
    let arguments = ["experiment", "tracking", "--runs", "2", "--only", "slam,known-plan", "--json"];
    let answer = json(&cogmint(folder.path(), &arguments));
    assert_eq!(answer["seed"], 1);
    let scenarios = answer["scenarios"].as_array().unwrap();
    let names: Vec<_> = scenarios.iter().map(|figures| figures["scenario"].as_str().unwrap()).collect();
    assert_eq!(names, ["slam", "known-plan"]);
    for figures in scenarios {
        assert_eq!(figures["runs"], 2);
        for key in ["rmse_m", "rmse_median_m", "rmse_worst_m", "p95_worst_m", "nees", "nis", "us_per_cycle"] {
            assert!(figures[key].as_f64().is_some_and(|value| value > 0.0), "{key} in {figures}");
        }
        for key in ["nees_within_95", "ospa_m"] {
            assert!(
                figures[key].as_f64().is_some_and(|value| (0.0..=1.0).contains(&value)),
                "{key} in {figures}"
            );
        }
        assert!(figures["diverged"].is_array() && figures["virtual_anchors_found"].is_f64(), "{figures}");
    }
    assert_eq!(scenarios[0]["virtual_anchors_true"], 9.0);
    assert!(scenarios[0]["rmse_over_posterior_crlb"].is_null(), "without a map no bound is known");
    // Errors of millimetres: no run is far better than its bound.
    assert!(scenarios[1]["rmse_over_posterior_crlb"].as_f64().is_some_and(|ratio| ratio > 0.8));
    assert!(scenarios[1]["posterior_crlb_m"].as_f64().is_some_and(|m| (1e-4..0.1).contains(&m)));
    let table =
        text(&cogmint(folder.path(), &["experiment", "tracking", "--runs", "1", "--only", "slam"]).stdout);
    assert!(table.contains("must be") && table.contains("NEES"), "{table}");
}

#[test]
fn an_experiment_on_tracking_takes_a_recording_from_several_starts() {
    let folder = Folder::new("experiment-recording");
    small_recording(&folder.path().join("r"));
    let run = |more: &[&str]| cogmint(folder.path(), &[&["experiment", "tracking"], more].concat());
    let answer = json(&run(&["--recording", "r", "--starts", "3", "--seed", "5", "--json"]));
    assert_eq!((&answer["seed"], &answer["scenarios"][0]["runs"]), (&5.into(), &3.into()));
    assert!(answer["scenarios"][0]["rmse_m"].is_f64(), "{answer}");
    for wrong in [
        &["--recording", "nothing-here"][..],
        &["--only", "nonsense"],
        &["--runs", "0"],
        &["--starts", "3"],
        &["--recording", "r", "--only", "slam"],
    ] {
        assert_eq!(run(wrong).status.code(), Some(2), "{wrong:?}");
    }
}

#[test]
fn variants_are_selected_by_name_and_named_in_the_answer() {
    let folder = Folder::new("variants");
    small_recording(&folder.path().join("r"));
    let track = |more: &[&str]| cogmint(folder.path(), &[&["track", "r"], more].concat());
    assert_eq!(json(&track(&["--json"]))["variant"], "soft");
    for variant in ["conventional", "probabilistic", "soft"] {
        let outcome = json(&track(&["--variant", variant, "--json"]));
        assert_eq!(outcome["variant"], variant);
        let still = |va: &serde_json::Value| {
            va["covariance_m2"].as_array().unwrap().iter().all(|entry| entry.as_f64() == Some(0.0))
        };
        let found = outcome["virtual_anchors_found"].as_array().unwrap();
        assert!(!found.is_empty() && found.iter().all(still) == (variant == "conventional"), "{outcome}");
        let table = text(&track(&["--variant", variant]).stdout);
        assert!(table.contains(variant), "{table}");
        let figure = fs::read_to_string(folder.path().join("cogmint-out/r-track.svg")).unwrap();
        assert!(!figure.contains("NaN") && !figure.contains("inf"), "{variant}");
    }
    refused(&track(&["--variant", "guess"]), &["guess", "conventional", "probabilistic", "soft"]);

    let experiment = |more: &[&str]| {
        let arguments = ["experiment", "tracking", "--runs", "1", "--variant", "soft,conventional"];
        cogmint(folder.path(), &[&arguments[..], more].concat())
    };
    let answer = json(&experiment(&["--only", "known-plan", "--json"]));
    let rows: Vec<_> = answer["scenarios"].as_array().unwrap().iter().map(|row| &row["variant"]).collect();
    assert_eq!(rows, ["soft", "conventional"]);
    let table = text(&experiment(&["--only", "known-plan"]).stdout);
    assert!(table.contains("known-plan, conventional"), "{table}");
    refused(&experiment(&["--only", "known-plan,slam"]), &["conventional", "floor plan", "slam"]);
}

/// The names in a folder, in order.
fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name());
    let mut names: Vec<String> = entries.map(|name| name.to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

/// The numbers of a column of a table; `None` where a cell is empty.
fn column(table: &str, name: &str) -> Vec<Option<f64>> {
    let mut lines = table.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let index = lines.next().unwrap().iter().position(|column| *column == name).unwrap();
    lines.map(|cells| (!cells[index].is_empty()).then(|| cells[index].parse().unwrap())).collect()
}

#[test]
fn a_table_has_a_row_a_cycle_and_the_error_that_is_printed() {
    let folder = Folder::new("table");
    let room = cogmint::demo::seminar_room(1, 40).unwrap();
    let mut recording = cogmint::demo::run(&room, true, 1, || {}).unwrap().recording;
    recording.cycles[20].frames.clear();
    // Anywhere in the room, and not heard at first.
    recording.start.position_std_m = 3.0;
    recording.cycles[..3].iter_mut().for_each(|cycle| cycle.frames.clear());
    recording.write(folder.path().join("r")).unwrap();
    let track = |more: &[&str]| cogmint(folder.path(), &[&["track", "r", "--seed", "3"], more].concat());
    let outcome = json(&track(&["--json", "--no-figure", "--table", "new/track.csv"]));
    assert!(outcome["figure"].is_null() && outcome["table"] == "new/track.csv", "{outcome}");
    assert_eq!(names(folder.path()), ["new", "r"], "no figure is written");
    assert_eq!(names(&folder.path().join("new")), ["track.csv"]);

    let table = fs::read_to_string(folder.path().join("new/track.csv")).unwrap();
    let numbers = |name: &str| column(&table, name);
    let all = |name: &str| numbers(name).into_iter().map(Option::unwrap).collect::<Vec<_>>();
    assert_eq!(all("cycle"), (0..40).map(f64::from).collect::<Vec<_>>());
    let errors = all("error_m");
    let rmse = (errors.iter().map(|error| error * error).sum::<f64>() / 40.0).sqrt();
    assert!((rmse - outcome["rmse_m"].as_f64().unwrap()).abs() < 1e-12 * rmse, "{rmse} in {outcome}");
    let searching = all("searching").iter().filter(|searching| **searching == 1.0).count();
    assert_eq!(outcome["cycles_searching"], searching);
    assert!((1..40).contains(&searching), "{searching}: the start is to be searched, then found");
    for (cycle, row) in recording.cycles.iter().enumerate() {
        assert_eq!(all("time_s")[cycle], row.time_s);
        let [x, y] = row.truth_position_m.unwrap();
        assert_eq!((all("true_x_m")[cycle], all("true_y_m")[cycle]), (x, y));
        let distance = (all("x_m")[cycle] - x).hypot(all("y_m")[cycle] - y);
        assert!((errors[cycle] - distance).abs() < 1e-12, "cycle {cycle}");
        assert_eq!(numbers("height_m")[cycle], row.tag_height_m);
        let action = row.frames.iter().min_by_key(|frame| frame.anchor).map(|frame| frame.action as f64);
        assert_eq!(numbers("action")[cycle], action, "cycle {cycle}");
        let is_searching = all("searching")[cycle] == 1.0;
        let probability = all("probability")[cycle];
        assert!((0.0..1.001).contains(&probability) && (probability < 0.5) == is_searching, "{probability}");
        assert_eq!(numbers("vx_m_s")[cycle].is_none(), is_searching, "cycle {cycle}");
        // Entropy of a Gaussian in two dimensions: ln (2 pi e sqrt |C|).
        let (xx, xy, yy) = (all("cxx_m2")[cycle], all("cxy_m2")[cycle], all("cyy_m2")[cycle]);
        let entropy = (std::f64::consts::TAU * std::f64::consts::E * (xx * yy - xy * xy).sqrt()).ln();
        assert!((all("entropy_nat")[cycle] - entropy).abs() < 1e-2, "{entropy} in cycle {cycle}");
    }

    let printed = text(&track(&["--no-figure", "--table", "track.NPZ"]).stdout);
    assert!(printed.contains("Table: track.NPZ") && !printed.contains("Figure"), "{printed}");
    assert!(fs::read(folder.path().join("track.NPZ")).unwrap().starts_with(b"PK"));
}

#[test]
fn what_cannot_be_written_as_a_table_is_refused_and_nothing_is_overwritten() {
    let folder = Folder::new("table-refused");
    let place = folder.path();
    small_recording(&place.join("r"));
    let track = |more: &[&str]| cogmint(place, &[&["track"], more].concat());
    for old in ["t.csv", "t.txt", "p.svg", "p.png"] {
        fs::write(place.join(old), "old").unwrap();
    }
    let arrays = fs::read(place.join("r/recording.npz")).unwrap();

    refused(&track(&["r", "--table", "t.txt"]), &["t.txt", ".csv or .npz"]);
    refused(&track(&["r", "--table", "r/recording.npz"]), &["r/recording.npz", "part of a recording"]);
    refused(&track(&["r", "--no-figure", "--plot", "p"]), &["--no-figure", "--plot"]);
    refused(&track(&["r", "--table", "t.csv", "--variant", "guess"]), &["guess", "direct"]);
    refused(&track(&["nowhere", "--table", "t.csv", "--plot", "p"]), &["nowhere"]);
    refused(&cogmint(place, &["estimate", "r", "--csv", "r/recording.toml"]), &["part of a recording"]);
    let feed = ["trace", "--recording", "r", "--feed", "r/recording.npz"];
    refused(&cogmint(place, &feed), &["part of a recording"]);
    fs::write(place.join("r/recording.npz"), &arrays[..arrays.len() / 2]).unwrap();
    refused(&track(&["r", "--table", "t.csv", "--plot", "p"]), &["recording.npz"]);
    fs::write(place.join("r/recording.npz"), &arrays).unwrap();

    // What the disk refuses is no mistake of the input; it is noticed before the run.
    fs::create_dir(place.join("folder.csv")).unwrap();
    for (to, reason) in [("t.csv/below.csv", "cannot be written"), ("folder.csv", "is a folder")] {
        let output = track(&["r", "--table", to]);
        assert_eq!(output.status.code(), Some(1), "{}", text(&output.stderr));
        let said = text(&output.stderr);
        assert!(said.contains(to) && said.contains(reason), "{said}");
        assert!(output.stdout.is_empty());
    }
    for old in ["t.csv", "t.txt", "p.svg", "p.png"] {
        assert_eq!(fs::read_to_string(place.join(old)).unwrap(), "old", "{old}");
    }
    assert_eq!(names(place), ["folder.csv", "p.png", "p.svg", "r", "t.csv", "t.txt"]);
    assert_eq!(names(&place.join("r")), ["recording.npz", "recording.toml"]);
}

#[cfg(unix)]
#[test]
fn a_folder_that_is_read_only_is_named_and_its_files_stay() {
    use std::os::unix::fs::PermissionsExt;
    let folder = Folder::new("read-only");
    small_recording(&folder.path().join("r"));
    let closed = folder.path().join("closed");
    fs::create_dir(&closed).unwrap();
    fs::write(closed.join("t.csv"), "old").unwrap();
    fs::set_permissions(&closed, fs::Permissions::from_mode(0o555)).unwrap();
    // The superuser writes anywhere but into what the kernel itself presents.
    let is_superuser = fs::write(closed.join("probe"), "").is_ok();
    let folders: &[&str] = if is_superuser { &["/proc"] } else { &["/proc", "closed"] };
    for into in folders {
        for option in ["--table", "--plot"] {
            let to = format!("{into}/t.csv");
            let output = cogmint(folder.path(), &["track", "r", option, &to]);
            assert_eq!(output.status.code(), Some(1), "{option} {to}: {}", text(&output.stderr));
            assert!(text(&output.stderr).contains(&to), "{}", text(&output.stderr));
        }
    }
    assert_eq!(fs::read_to_string(closed.join("t.csv")).unwrap(), "old");
    fs::set_permissions(&closed, fs::Permissions::from_mode(0o755)).unwrap();
    assert_eq!(names(&closed).len(), if is_superuser { 2 } else { 1 });
}

#[test]
fn the_direct_variant_needs_no_plan_and_finds_no_virtual_anchor() {
    let folder = Folder::new("direct");
    small_recording(&folder.path().join("r"));
    let outcome = json(&cogmint(folder.path(), &["track", "r", "--variant", "direct", "--json"]));
    assert_eq!((&outcome["variant"], &outcome["virtual_anchors"]["found"]), (&"direct".into(), &0.into()));
    assert_eq!(outcome["refused_cycles"], 0);
    let arguments =
        ["experiment", "tracking", "--runs", "1", "--variant", "direct", "--only", "slam", "--json"];
    let row = &json(&cogmint(folder.path(), &arguments))["scenarios"][0];
    assert_eq!((&row["variant"], row["virtual_anchors_found"].as_f64()), (&"direct".into(), Some(0.0)));
    refused(
        &cogmint(folder.path(), &["experiment", "controllers", "--variant", "direct"]),
        &["direct", "conventional", "soft"],
    );
}

#[test]
fn the_conventional_variant_is_refused_where_there_is_no_floor_plan() {
    let folder = Folder::new("variants-without-plan");
    let recording = cogmint::experiment::tracking::slam_ranges::SlamRanges::default().record(1);
    recording.write(folder.path().join("r")).unwrap();
    let track = |variant: &str| cogmint(folder.path(), &["track", "r", "--json", "--variant", variant]);
    refused(&track("conventional"), &["recording.toml", "virtual_anchors", "floor plan"]);
    assert!(!folder.path().join("cogmint-out").exists(), "nothing may be written");
    assert_eq!(json(&track("probabilistic"))["variant"], "probabilistic");
}

#[test]
fn more_ranges_than_the_tracker_keeps_cost_no_cycle() {
    let folder = Folder::new("long-scans");
    let mut recording = cogmint::experiment::tracking::slam_ranges::SlamRanges::default().record(1);
    recording.cycles.truncate(20);
    let first = recording.cycles[3].ranges[0];
    let before = recording.cycles[3].ranges.iter().filter(|range| range.anchor == first.anchor).count();
    recording.cycles[3].ranges.extend(vec![cogmint::recording::Range { range_m: 29.0, ..first }; 20]);
    recording.write(folder.path().join("r")).unwrap();
    let outcome = json(&cogmint(folder.path(), &["track", "r", "--json"]));
    assert_eq!(outcome["refused_cycles"], 0);
    assert_eq!(outcome["measurements_left_out"], before + 20 - 16);
    assert!(text(&cogmint(folder.path(), &["track", "r"]).stdout).contains("left out"));
    let feed = ["trace", "--recording", "r", "--feed", "feed.bin"];
    refused(&cogmint(folder.path(), &feed), &["more than 16 ranges", "firmware"]);
}

#[test]
fn what_nobody_knows_is_not_scored() {
    let folder = Folder::new("track-without-truth");
    let room = cogmint::demo::seminar_room(1, 12).unwrap();
    let mut recording = cogmint::demo::run(&room, true, 1, || {}).unwrap().recording;
    recording.virtual_anchors.clear();
    for cycle in &mut recording.cycles {
        cycle.truth_position_m = None;
        cycle.truth_paths.clear();
    }
    recording.write(folder.path().join("r")).unwrap();
    let outcome = json(&cogmint(folder.path(), &["track", "r", "--json"]));
    assert!(outcome["nis"].is_f64(), "{outcome}");
    assert!(outcome["virtual_anchors"]["found"].is_u64(), "{outcome}");
    for key in ["nees", "nees_within_95"] {
        assert!(outcome.get(key).is_some_and(serde_json::Value::is_null), "{key} in {outcome}");
    }
    for key in ["true", "ospa_m", "spurious"] {
        let value = outcome["virtual_anchors"].get(key);
        assert!(value.is_some_and(serde_json::Value::is_null), "{key} in {outcome}");
    }
}

#[test]
fn verify_compares_every_bit_of_the_room_and_of_a_recording() {
    let folder = Folder::new("verify");
    let outcome = json(&cogmint(folder.path(), &["verify", "--cycles", "200", "--json"]));
    assert_eq!((&outcome["cycles"], &outcome["equal"]), (&200.into(), &true.into()), "{outcome}");
    assert!(outcome["compared"].as_u64().unwrap() > 200 * 1000 && outcome["first_difference"].is_null());
    small_recording(&folder.path().join("r"));
    let outcome = json(&cogmint(folder.path(), &["verify", "--recording", "r", "--json"]));
    assert_eq!((&outcome["cycles"], &outcome["equal"]), (&12.into(), &true.into()), "{outcome}");
}

#[test]
fn imports_of_others_data_verify_bit_for_bit() {
    let folder = Folder::new("import");
    let Some(data) = shared_data("bp-slam") else { return };
    let file = |name: &str| data.join(name).canonicalize().unwrap().to_string_lossy().into_owned();
    let (anchors, truth) = (file("anchors_vas.csv"), file("true_trajectory.csv"));
    let ranges = file("measurements_seed1.csv");
    let arguments =
        ["import", "bp-slam", "--anchors", &anchors, "--truth", &truth, "--ranges", &ranges, "--out", "bp"];
    assert!(cogmint(folder.path(), &arguments).status.success());
    let outcome = json(&cogmint(folder.path(), &["verify", "--recording", "bp", "--json"]));
    assert_eq!((&outcome["cycles"], &outcome["equal"]), (&900.into(), &true.into()), "{outcome}");

    let Some(data) = shared_data("miluv") else { return };
    let flight = data.join("random_1.npz").canonicalize().unwrap().to_string_lossy().into_owned();
    for options in [&[][..], &["--bodies"]] {
        let arguments = [&["import", "miluv", &flight, "--out", "flight"], options].concat();
        assert!(cogmint(folder.path(), &arguments).status.success());
    }
    let mut names: Vec<_> =
        fs::read_dir(folder.path().join("flight")).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    names.sort();
    assert_eq!(names, ["drone-1", "tag-10", "tag-11"]);
    let outcome = json(&cogmint(folder.path(), &["verify", "--recording", "flight/drone-1", "--json"]));
    assert_eq!((&outcome["cycles"], &outcome["equal"]), (&954.into(), &true.into()), "{outcome}");

    let Some(data) = shared_data("kampusareena") else { return };
    let file = |name: &str| data.join(name).canonicalize().unwrap().to_string_lossy().into_owned();
    let (places, paths) = (file("places.csv"), file("paths.csv"));
    let arguments = ["import", "snapshot", "--places", &places, "--paths", &paths, "--anchor", "2.25,2.5"];
    let map = ["--map", "5.8,3.3", "--map", "-7.0,-18.5", "--out", "hall"];
    let output = cogmint(folder.path(), &[&arguments[..], &map].concat());
    assert!(output.status.success(), "{}", text(&output.stderr));
    let outcome = json(&cogmint(folder.path(), &["verify", "--recording", "hall", "--json"]));
    assert_eq!((&outcome["cycles"], &outcome["equal"]), (&45.into(), &true.into()), "{outcome}");

    let Some(data) = shared_data("warsaw") else { return };
    let flat = data.canonicalize().unwrap().to_string_lossy().into_owned();
    assert!(cogmint(folder.path(), &["import", "warsaw", &flat, "--out", "flat"]).status.success());
    let outcome = json(&cogmint(folder.path(), &["verify", "--recording", "flat/link_1", "--json"]));
    assert_eq!(outcome["equal"], true, "{outcome}");
}

#[test]
fn unknown_options_and_commands_are_refused() {
    let folder = Folder::new("usage");
    refused(&cogmint(folder.path(), &["track", "r", "--frobnicate"]), &["--frobnicate"]);
    refused(&cogmint(folder.path(), &["frobnicate"]), &["frobnicate"]);
    refused(&cogmint(folder.path(), &["track"]), &["FOLDER"]);
    refused(&cogmint(folder.path(), &["trace", "--cycles", "0"]), &["--cycles"]);
    refused(&cogmint(folder.path(), &["track", "r", "--seed", "x"]), &["--seed"]);
}

#[test]
fn wrong_paths_are_refused_by_name() {
    let folder = Folder::new("paths");
    for command in [
        &["track", "nowhere"][..],
        &["verify", "--recording", "nowhere"],
        &["trace", "--recording", "nowhere"],
    ] {
        refused(&cogmint(folder.path(), command), &["nowhere"]);
    }
    let missing =
        ["import", "bp-slam", "--anchors", "a.csv", "--truth", "t.csv", "--ranges", "r.csv", "--out", "o"];
    refused(&cogmint(folder.path(), &missing), &["a.csv"]);
    refused(&cogmint(folder.path(), &["import", "miluv", "none.npz", "--out", "o"]), &["none.npz"]);
    refused(&cogmint(folder.path(), &["import", "warsaw", "none", "--out", "o"]), &["none"]);
    let snapshot = |places: &str, paths: &str, anchor: &str| {
        let arguments =
            ["import", "snapshot", "--places", places, "--paths", paths, "--anchor", anchor, "--out", "o"];
        cogmint(folder.path(), &arguments)
    };
    refused(&snapshot("p.csv", "q.csv", "1,2"), &["p.csv"]);
    fs::write(folder.path().join("p.csv"), "place,x_m,y_m\n0,1,2\n").unwrap();
    refused(&snapshot("p.csv", "q.csv", "1,2"), &["q.csv"]);
    fs::write(folder.path().join("q.csv"), "place,range_m,departure_angle_rad\n0,1,2\n").unwrap();
    refused(&snapshot("p.csv", "q.csv", "1,2"), &["q.csv", "arrival_angle_rad"]);
    let columns = "place,range_m,departure_angle_rad,arrival_angle_rad";
    fs::write(folder.path().join("q.csv"), format!("{columns}\n0,NaN,0,0\n")).unwrap();
    refused(&snapshot("p.csv", "q.csv", "1,2"), &["q.csv, line 2", "range_m"]);
    refused(&snapshot("p.csv", "q.csv", "1;2"), &["--anchor", "1;2"]);
    refused(&snapshot("p.csv", "q.csv", "1,nan"), &["--anchor", "nan"]);
    assert!(!folder.path().join("o").exists(), "nothing may be written");
}

#[test]
fn malformed_recordings_are_refused_with_file_and_reason() {
    let folder = Folder::new("malformed");
    let place = folder.path().join("r");
    small_recording(&place);
    let toml = fs::read_to_string(place.join("recording.toml")).unwrap();
    let npz = fs::read(place.join("recording.npz")).unwrap();
    let track = || cogmint(folder.path(), &["track", "r"]);

    fs::write(place.join("recording.toml"), toml.replace("roll_off", "rolloff")).unwrap();
    refused(&track(), &["recording.toml", "rolloff"]);
    fs::write(place.join("recording.toml"), "format = ").unwrap();
    refused(&track(), &["recording.toml", "line 1"]);
    fs::write(
        place.join("recording.toml"),
        toml.replace("acceleration_density_m2_s3 = ", "acceleration_density_m2_s3 = -"),
    )
    .unwrap();
    refused(&track(), &["recording.toml", "acceleration_density_m2_s3"]);
    fs::write(place.join("recording.toml"), &toml).unwrap();

    fs::write(place.join("recording.npz"), &npz[..npz.len() / 2]).unwrap();
    refused(&track(), &["recording.npz"]);
    fs::write(place.join("recording.npz"), b"no archive at all").unwrap();
    refused(&track(), &["recording.npz"]);
    fs::remove_file(place.join("recording.npz")).unwrap();
    refused(&track(), &["recording.npz"]);
}

#[test]
fn an_import_never_overwrites_what_is_no_recording() {
    let Some(data) = shared_data("bp-slam") else { return };
    let folder = Folder::new("overwrite");
    let precious = folder.path().join("precious");
    fs::create_dir_all(&precious).unwrap();
    fs::write(precious.join("thesis.txt"), "years").unwrap();
    let file = |name: &str| data.join(name).canonicalize().unwrap().to_string_lossy().into_owned();
    let (anchors, truth) = (file("anchors_vas.csv"), file("true_trajectory.csv"));
    let ranges = file("measurements_seed1.csv");
    let arguments = [
        "import",
        "bp-slam",
        "--anchors",
        &anchors,
        "--truth",
        &truth,
        "--ranges",
        &ranges,
        "--out",
        "precious",
    ];
    refused(&cogmint(folder.path(), &arguments), &["precious"]);
    assert_eq!(fs::read_to_string(precious.join("thesis.txt")).unwrap(), "years");
}

#[test]
fn the_estimators_figures_stay_where_they_were_beside_those_of_other_methods() {
    let folder = Folder::new("against");
    let run = |more: &[&str]| {
        let arguments = [&["experiment", "estimator", "--trials", "10", "--json"], more].concat();
        json(&cogmint(folder.path(), &arguments))
    };
    let (alone, beside) = (run(&[]), run(&["--against", "omp,matched-filter-local"]));
    assert!(alone.get("against").is_none());
    for (key, value) in alone.as_object().unwrap() {
        // A speed is never the same twice.
        if key != "frames_per_second" {
            assert_eq!(value, &beside[key], "{key}");
        }
    }
    let methods: Vec<_> = beside["against"].as_array().unwrap().iter().map(|one| &one["method"]).collect();
    assert_eq!(methods, ["matched-filter-local", "omp"]);
    for key in alone.as_object().unwrap().keys() {
        assert!(beside["against"][0].get(key).is_some(), "{key} is missing");
    }
}

#[test]
fn a_method_or_program_that_is_not_there_is_named_with_what_is_allowed() {
    let folder = Folder::new("against-nothing");
    let run = |more: &[&str]| cogmint(folder.path(), &[&["experiment", "estimator"], more].concat());
    refused(&run(&["--against", "omp,guess"]), &["guess", "matched-filter", "all"]);
    refused(
        &run(&["--against-program", "no/such/program"]),
        &["no/such/program", "--against-program", "cannot be started"],
    );
}
